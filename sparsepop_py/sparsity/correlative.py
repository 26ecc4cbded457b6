"""Correlative sparsity: which variables meet, and the cliques that follow from it.

Two variables are adjacent if one monomial of the objective or one constraint contains
both. A chordal extension of that graph has a clique tree, and moment matrices over its
maximal cliques are enough (Waki, Kim, Kojima, Muramatsu 2006; Lasserre 2006).

References
----------
H. Waki, S. Kim, M. Kojima, M. Muramatsu, SIAM J. Optim. 17 (2006) 218-242.
J. B. Lasserre, SIAM J. Optim. 17 (2006) 822-843.
C. Josz, D. K. Molzahn, Lasserre hierarchy for large scale polynomial optimization in real
and complex variables, SIAM J. Optim. 28 (2018) 1017-1048.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Literal, get_args

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial import Polynomial, polynomials_of
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.errors import ProblemError, check_choice, check_kind, check_switch
from sparsepop_py.problem.problem import Problem
from sparsepop_py.sparsity.chordal import (
    Members,
    Method,
    chordal_extension,
    clique_tree,
    incidence,
    join,
)
from sparsepop_py.verified.arithmetic.array_checks import read_only

__all__ = [
    "Cliques",
    "Joined",
    "chordal_extension",
    "csp_graph",
    "find_cliques",
    "satisfies_running_intersection",
]

_SHOWN = 12  # cliques of a printed tree
Joined = Literal["constraints", "monomials", "partners"]


@dataclass(frozen=True, eq=False)
class Cliques(ReadOnly):
    """Maximal cliques of a chordal extension, with the homes of constraints and variables.

    Parameters
    ----------
    members : tuple of sorted tuples of int
        The variables (from 0) of each of the K cliques.
    home : (m,) int
        The clique of each constraint: the largest that contains its variables, the
        lowest index on ties; 0 for a constraint without variables, -1 where none contains
        them.
    home_of_variable : (n,) int
        The largest clique containing each variable, the lowest index on ties.
    tree : (K,) int
        Parent of each clique in a clique tree, -1 at roots. Parents come before their
        children: clique k meets the union of the cliques before it inside its parent
        (running intersection).
    graph : (n, n) sparse bool
        The chordal graph, symmetric with an empty diagonal.
    order : (n,) int
        A perfect elimination order of ``graph``.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x = sp.variables(3)
    >>> cliques = sp.find_cliques(sp.Problem(x[0] * x[1], [x[1] + x[2] <= 1]))
    >>> cliques.members, cliques.home.tolist(), cliques.tree.tolist()
    (((0, 1), (1, 2)), [1], [-1, 0])
    """

    members: Members
    home: NDArray[np.int64]
    home_of_variable: NDArray[np.int64]
    tree: NDArray[np.int64]
    graph: sps.csr_array
    order: NDArray[np.int64]

    def __post_init__(self) -> None:
        for name in ("home", "home_of_variable", "tree", "order"):
            self.__dict__[name] = read_only(getattr(self, name), "i", name)
        self.__dict__["members"] = tuple(map(tuple, self.members))
        if self.tree.size != len(self.members):
            raise ProblemError(
                f"tree: found {self.tree.size} parents, expected one of {len(self.members)} cliques"
            )

    def __len__(self) -> int:
        return len(self.members)

    @property
    def sizes(self) -> NDArray[np.int64]:
        """Number of variables of each clique, shape (K,)."""
        return np.array([len(clique) for clique in self.members], np.int64)

    def __str__(self) -> str:
        counts = sorted(Counter(self.sizes.tolist()).items(), reverse=True)
        lines = [f"{len(self)} cliques of {self.graph.shape[0]} variables"]
        lines += [f"  {count:6d} of size {size}" for size, count in counts]
        holds = "holds" if satisfies_running_intersection(self) else "does not hold"
        lines += [f"running intersection property: {holds}", "clique tree (shared with parent):"]
        return "\n".join([*lines, *self._tree_lines()])

    def _tree_lines(self) -> list[str]:
        """Draw the clique tree, indented by depth; of a large one the first cliques."""
        depth: list[int] = []
        lines = []
        for k, parent in enumerate(self.tree.tolist()):
            depth.append(0 if parent < 0 else depth[parent] + 1)
            if k < _SHOWN:
                shared = set(self.members[k]).intersection(self.members[parent]) if depth[k] else ()
                names = " ".join(f"x{v + 1}" for v in self.members[k])
                common = " ".join(f"x{v + 1}" for v in sorted(shared))
                lines.append("  " * (depth[k] + 1) + names + (f"  ({common})" if common else ""))
        hidden = len(self) - _SHOWN
        return lines + ([f"  ... {hidden} more"] if hidden > 0 else [])

    def __repr__(self) -> str:
        return f"<Cliques: {len(self)} of at most {self.sizes.max(initial=0)} variables>"


def csp_graph(
    problem: Problem, objectives: Sequence[Polynomial] = (), joined: Joined = "constraints"
) -> sps.csr_array:
    """Build the graph of the correlative sparsity pattern.

    Parameters
    ----------
    problem : Problem
    objectives : sequence of Polynomial, optional
        Further objectives that shall share the cliques.
    joined : {"constraints", "monomials", "partners"}
        See :func:`find_cliques`.

    Returns
    -------
    (n, n) sparse bool
        Symmetric adjacency with an empty diagonal.

    Raises
    ------
    ProblemError
        If an extra objective has another number of variables.

    References
    ----------
    Waki, Kim, Kojima, Muramatsu (2006), section 3.1.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y, z = sp.variables(3)
    >>> csp_graph(sp.Problem(x * y + z**2, [y + z >= 1])).toarray().astype(int).tolist()
    [[0, 1, 0], [1, 0, 1], [0, 1, 0]]
    """
    n = problem.dimension
    given = polynomials_of(objectives, "objectives", n)
    others = [p for p in given if p is not problem.objective]
    terms = _terms([p.words for p in (problem.objective, *others)], n)
    return join(sps.csr_array(sps.vstack([_joined(problem, terms, joined), terms])))


def find_cliques(
    problem: Problem,
    sparse: bool = True,
    method: Method = "auto",
    objectives: Sequence[Polynomial] = (),
    joined: Joined = "constraints",
) -> Cliques:
    """Find the maximal cliques of a chordal extension of the correlative sparsity pattern.

    Parameters
    ----------
    problem : Problem
    sparse : bool
        False gives one clique of all variables (and a complete graph, n^2 entries).
    method : {"auto", "min-degree", "min-fill", "mcs-m"}
        See :func:`chordal_extension`.
    objectives : sequence of Polynomial, optional
        Further objectives that shall share the cliques.
    joined : {"constraints", "monomials", "partners"}
        Rule by which variables of the constraints are adjacent. ``"monomials"``: one monomial of a
        constraint, as in the objective; a constraint that no clique contains has the home
        -1 and a constant multiplier (Josz, Molzahn 2018). ``"partners"``: one constraint,
        together with the variables that its variables multiply anywhere, so that it can be
        multiplied by these.

    Returns
    -------
    Cliques
        Variables that meet no other one are cliques of one.

    Raises
    ------
    ProblemError
        If ``method`` is unknown, or an extra objective has another number of variables.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x = sp.variables(4)
    >>> cliques = find_cliques(sp.Problem(x[0] * x[1] + x[1] * x[2] + x[3]))
    >>> cliques.members
    ((0, 1), (1, 2), (3,))
    >>> print(cliques)
    3 cliques of 4 variables
           2 of size 2
           1 of size 1
    running intersection property: holds
    clique tree (shared with parent):
      x1 x2
        x2 x3  (x2)
      x4
    """
    check_kind(problem, Problem, "problem")
    check_switch(sparse, "sparse")
    check_choice(method, "method", get_args(Method))
    check_choice(joined, "joined", get_args(Joined))
    n = problem.dimension
    if sparse:
        found = csp_graph(problem, objectives, joined)
        graph, order, members, tree = _decomposed(
            found.indptr.tobytes(), found.indices.tobytes(), found.indptr.dtype.str, method
        )
    else:
        graph = sps.csr_array(~np.eye(n, dtype=bool))
        order, members, tree = np.arange(n), (tuple(range(n)),), np.array([-1])
    home, home_of_variable = _homes(problem, members)
    for array in (home, home_of_variable, tree, order):
        array.flags.writeable = False
    return Cliques(members, home, home_of_variable, tree, graph, order)


@lru_cache(maxsize=2)  # of a problem and its scaled form, which have one pattern
def _decomposed(
    starts: bytes, columns: bytes, kind: str, method: Method
) -> tuple[sps.csr_array, NDArray[np.int64], Members, NDArray[np.int64]]:
    """Extend a graph, given by bytes, to a chordal one; list its cliques."""
    indptr, indices = np.frombuffer(starts, kind), np.frombuffer(columns, kind)
    n = indptr.size - 1
    given = sps.csr_array((np.ones(indices.size, bool), indices, indptr), shape=(n, n))
    graph, order = chordal_extension(given, method)
    return graph, order, *clique_tree(graph, order)


def satisfies_running_intersection(cliques: Cliques) -> bool:
    """Check that each clique meets the union of the former ones inside its parent.

    Parameters
    ----------
    cliques : Cliques

    Returns
    -------
    bool

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y, z = sp.variables(3)
    >>> satisfies_running_intersection(find_cliques(sp.Problem(x * y + y * z)))
    True
    """
    seen: set[int] = set()
    for k, (clique, parent) in enumerate(zip(cliques.members, cliques.tree, strict=True)):
        shared = seen.intersection(clique)
        allowed = set(cliques.members[parent]) if 0 <= parent < k else set()
        if parent >= k or not shared <= allowed:
            return False
        seen.update(clique)
    return True


def _constraint_terms(problem: Problem) -> tuple[Words, NDArray[np.int64]]:
    """List every monomial of the constraints, with matrix entries, and its constraint."""
    rows, matrices = problem.rows, problem.matrices
    words = monomials.stack((rows.words, matrices.system.words))
    return words, np.append(rows.row, matrices.owner[matrices.system.row])


def _constraint_incidence(problem: Problem) -> sps.csr_array:
    """Mark the variables of each constraint, (m, n), indices sorted and distinct."""
    words, row = _constraint_terms(problem)
    term, variable, _ = monomials.runs(words)
    shape = (len(problem.constraints), problem.dimension)
    groups = incidence(row[term], variable, shape)
    groups.sum_duplicates()
    groups.data[:] = 1  # counts could overflow in the product
    return groups


def _terms(tables: Sequence[Words], n: int) -> sps.csr_array:
    """Mark the variables of each monomial, one monomial a row."""
    found = []
    for words in tables:
        term, variable, _ = monomials.runs(words)
        found.append(incidence(term, variable, (words.shape[0], n)))
    return sps.csr_array(sps.vstack(found))


def _joined(problem: Problem, others: sps.csr_array, joined: Joined) -> sps.csr_array:
    """Group variables that the constraints make adjacent, one group a row.

    ``others`` are the monomials of the objectives, which make partners too.
    """
    if joined == "constraints":
        return _constraint_incidence(problem)
    terms = _terms([_constraint_terms(problem)[0]], problem.dimension)
    if joined == "monomials":
        return terms
    every = sps.vstack([terms, others])
    met = sps.csr_array(_constraint_incidence(problem) @ sps.csr_array(every.T @ every) > 0)
    row, variable = met.nonzero()
    return incidence(row, variable, met.shape)


def _homes(problem: Problem, members: Members) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find the largest clique of each constraint and of each variable."""
    sizes = np.array([len(clique) for clique in members])
    clique = np.repeat(np.arange(len(members)), sizes)
    variable = np.fromiter((v for row in members for v in row), np.int64, clique.size)
    ranked = np.lexsort((clique, -sizes[clique], variable))
    starts = np.searchsorted(variable[ranked], np.arange(problem.dimension + 1))
    ranked = clique[ranked]

    sets = [frozenset(row) for row in members]
    groups = _constraint_incidence(problem)
    spread = np.diff(starts)
    home = np.zeros(len(problem.constraints), np.int64)
    known: dict[bytes, int] = {}
    for i, (a, b) in enumerate(pairwise(groups.indptr.tolist())):
        support = groups.indices[a:b]
        if a == b:
            continue
        key = support.tobytes()
        if key not in known:
            # Only the cliques of the variable that occurs in fewest of them come into
            # question, and they are listed by falling size: the first that fits is it.
            rare = support[np.argmin(spread[support])]
            wanted = support.tolist()
            candidates = ranked[starts[rare] : starts[rare + 1]].tolist()
            known[key] = next((k for k in candidates if sets[k].issuperset(wanted)), -1)
        home[i] = known[key]
    return home, ranked[starts[:-1]]
