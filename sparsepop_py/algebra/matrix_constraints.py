"""Constraints that say a matrix of polynomials is positive semidefinite, and many of them stacked.

A second-order cone is one of them too, by its arrow matrix. Each carries a polynomial that
follows from it, so that whatever knows polynomials alone (linear relaxations, products of
bounds, branching) stays valid without knowing matrices.

References
----------
C. W. J. Hol, C. W. Scherer, Sum of squares relaxations for polynomial semidefinite
programming, MTNS 2004.
D. Henrion, J. B. Lasserre, Convergent relaxations of polynomial matrix inequalities and
static output feedback, IEEE Trans. Automatic Control 51, 2006.
"""

from __future__ import annotations

import numbers
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial, total
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.errors import ProblemError, doubles

__all__ = ["Matrices", "SymbolicCone", "cone", "psd", "second_order"]


@dataclass(frozen=True, eq=False)
class SymbolicCone:
    """A matrix constraint of sympy expressions; a problem knows which symbols are variables."""

    kind: Kind
    entries: tuple[Any, ...]
    name: str = ""


def second_order(*entries: Any, name: str = "") -> Constraint | SymbolicCone:
    """Constrain f1 >= |(f2, ..., fk)|, the Euclidean norm.

    Parameters
    ----------
    *entries : Polynomial, number or sympy expression
        The axis f1 and the rest, or one sequence of all of them.
    name : str
        Used in messages.

    Returns
    -------
    Constraint
        Of kind ``SECOND_ORDER``, whose polynomial is f1; ``f1 >= 0`` where there is no rest.
        For sympy expressions, an object that a Problem of sympy expressions accepts.

    Raises
    ------
    ProblemError
        If an entry is none of these, or none is a polynomial.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> print(sp.second_order(2, x, y))
    second_order(2, x1, x2)
    """
    if len(entries) == 1 and _is_sequence(entries[0]):
        entries = tuple(entries[0])
    if not entries:
        raise ProblemError("second_order: found no entries, expected the axis and the rest")
    return _made(Kind.SECOND_ORDER, list(entries), "second_order", name)


def psd(matrix: Any, name: str = "") -> Constraint | SymbolicCone:
    """Constrain a symmetric matrix of polynomials to be positive semidefinite.

    Parameters
    ----------
    matrix : (m, m) nested sequences, array or sympy Matrix
        Polynomials, numbers or sympy expressions.
    name : str
        Used in messages.

    Returns
    -------
    Constraint
        Of kind ``PSD``. Its polynomial is the trace, or a diagonal entry where the
        coefficients of the trace are no doubles. ``p >= 0`` for a matrix of one entry.
        For sympy expressions, an object that a Problem of sympy expressions accepts.

    Raises
    ------
    ProblemError
        If the matrix is not square or not symmetric, an entry is none of these, or none
        is a polynomial.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, = sp.variables(1)
    >>> problem = sp.Problem(x, [sp.psd([[1, x], [x, 1]])])
    >>> abs(sp.solve(problem).lower_bound + 1) < 1e-6
    True
    """
    rows = matrix.tolist() if hasattr(matrix, "tolist") else matrix
    if not _is_sequence(rows) or not all(_is_sequence(row) for row in rows):
        raise ProblemError(f"psd: found {type(matrix).__name__}, expected a square matrix")
    table = [list(row) for row in rows]
    side = len(table)
    for number, row in enumerate(table):
        if len(row) != side:
            raise ProblemError(f"psd: found {len(row)} entries in row {number}, expected {side}")
    if not side:
        raise ProblemError("psd: found an empty matrix, expected at least one entry")
    for i in range(side):
        for j in range(i):
            if not _same(table[i][j], table[j][i]):
                raise ProblemError(
                    f"psd: found {table[i][j]} and {table[j][i]} in rows {i} and {j}, "
                    "expected a symmetric matrix"
                )
    lower = [table[i][j] for i in range(side) for j in range(i + 1)]
    return _made(Kind.PSD, lower, "psd", name)


def cone(kind: Kind, entries: Sequence[Polynomial], name: str = "") -> Constraint:
    """Build the matrix constraint with these entries, ordered as in :class:`Constraint`."""
    if len(entries) == 1:
        return Constraint(entries[0], Kind.NONNEGATIVE, name)
    implied = entries[0]
    if kind is Kind.PSD:
        diagonal = [entries[k] for k in _diagonal(len(entries))]
        diagonal = [p.as_rounded() for p in diagonal]  # of the doubles that a problem is about
        varying = next((p for p in diagonal if p.degree), diagonal[0])
        implied = _exact_sum(diagonal) or varying
    return Constraint(implied, kind, name, tuple(entries))


def _made(kind: Kind, entries: list[Any], where: str, name: str) -> Constraint | SymbolicCone:
    known = next((p for p in entries if isinstance(p, Polynomial)), None)
    unknown = [p for p in entries if not isinstance(p, (Polynomial, numbers.Real))]
    if unknown and all(type(p).__module__.partition(".")[0] == "sympy" for p in unknown):
        if known is not None:
            raise ProblemError(f"{where}: sympy expressions and Polynomials are mixed")
        return SymbolicCone(kind, tuple(entries), name)
    if unknown:
        raise ProblemError(
            f"{where}: found {type(unknown[0]).__name__} among the entries, expected "
            "Polynomials, numbers or sympy expressions"
        )
    if known is None:
        raise ProblemError(f"{where}: found numbers alone, expected at least one Polynomial")
    nothing = known * 0.0

    def number(entry: Any) -> float:
        return float(doubles(entry, where))

    filled = [p if isinstance(p, Polynomial) else total([nothing, number(p)]) for p in entries]
    for p in filled:
        total([nothing, p])  # says so where the numbers of variables differ
    return cone(kind, filled, name)


def _is_sequence(item: Any) -> bool:
    return isinstance(item, (list, tuple)) or (isinstance(item, np.ndarray) and item.ndim > 0)


def _same(a: Any, b: Any) -> bool:
    if not isinstance(a, Polynomial) or not isinstance(b, Polynomial):
        if not isinstance(a, Polynomial) and not isinstance(b, Polynomial):
            return bool(a == b)
        mixed, other = (a, b) if isinstance(a, Polynomial) else (b, a)
        return isinstance(other, numbers.Real) and not total([mixed, -float(other)]).terms
    return a.dimension != b.dimension or not total([a.as_rounded(), -b.as_rounded()]).terms


def _diagonal(count: int) -> list[int]:
    """Places of the diagonal in a lower triangle of that many entries."""
    places, place, row = [], 0, 0
    while place < count:
        places.append(place)
        row += 1
        place += row + 1
    return places


def _exact_sum(polynomials: Sequence[Polynomial]) -> Polynomial | None:
    """Add polynomials if all sums are doubles: a rounded one might lose points."""
    sums: dict[tuple[int, ...], Fraction] = {}
    for p in polynomials:
        for word, value in zip(p.words.tolist(), p.coefficients.tolist(), strict=True):
            key = tuple(letter for letter in word if letter)
            sums[key] = sums.get(key, Fraction(0)) + Fraction(value)
    rounded = total(polynomials)
    found = {
        tuple(letter for letter in word if letter): Fraction(value)
        for word, value in zip(rounded.words.tolist(), rounded.coefficients.tolist(), strict=True)
    }
    return rounded if found == {key: value for key, value in sums.items() if value} else None


@dataclass(frozen=True, eq=False)
class Matrices(ReadOnly):
    """The matrices of all constraints, their distinct entries stacked.

    Parameters
    ----------
    system : PolynomialSystem
        All entries, constraint by constraint, and the zero polynomial as the last row.
    owner : (E,) int
        The constraint of each entry.
    side : (m,) int
        Rows of the matrix of each constraint, 0 where it has none.
    first : (m,) int
        Where the positions of each matrix start in ``table``.
    table : (sum of side^2,) int
        Row of ``system`` at each position, row by row.
    second_order : (m,) bool
        Which of them are second-order cones.
    """

    system: PolynomialSystem
    owner: NDArray[np.int64]
    side: NDArray[np.int64]
    first: NDArray[np.int64]
    table: NDArray[np.int64]
    second_order: NDArray[np.bool_]

    @staticmethod
    def of(constraints: Sequence[Constraint], dimension: int) -> Matrices:
        """Collect the matrices of constraints in ``dimension`` variables."""
        held = {k: c for k, c in enumerate(constraints) if c.entries}  # mostly none of many
        entries = [p for c in held.values() for p in c.entries]
        stacked, zero = PolynomialSystem.stack(entries, dimension), len(entries)
        words, values, row = stacked.words, stacked.coefficients, stacked.row
        side, second_order = np.zeros(len(constraints), np.int64), np.zeros(len(constraints), bool)
        owner: list[int] = []
        table: list[int] = []
        for k, c in held.items():
            base = len(owner)
            side[k], second_order[k] = c.side, c.kind is Kind.SECOND_ORDER
            owner += [k] * len(c.entries)
            for i in range(c.side):
                places = (c.position(i, j) for j in range(c.side))
                table += [zero if place is None else base + place for place in places]
        first = np.cumsum(side**2) - side**2
        arrays = np.array(owner, np.int64), side, first, np.array(table, np.int64), second_order
        for array in arrays:
            array.flags.writeable = False
        return Matrices(PolynomialSystem(words, values, row, zero + 1, dimension), *arrays)

    @property
    def constraints(self) -> NDArray[np.int64]:
        """The constraints that have a matrix."""
        return np.flatnonzero(self.side)

    def entry(
        self, constraint: NDArray[Any], i: NDArray[Any], j: NDArray[Any]
    ) -> NDArray[np.int64]:
        """Number the row of ``system`` at place (i, j) of each constraint."""
        return self.table[self.first[constraint] + i * self.side[constraint] + j]

    def layout(self, constraint: int) -> NDArray[np.int64]:
        """Arrange rows of ``system`` as they stand in one matrix, (side, side)."""
        side, first = int(self.side[constraint]), int(self.first[constraint])
        return self.table[first : first + side**2].reshape(side, side)

    def least_eigenvalue(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the least eigenvalue of all matrices at points (N, n), shape (N,).

        In floating point; infinite without any matrix, and -inf where an entry is no number.
        """
        if not self.constraints.size:
            return np.full(points.shape[0], np.inf)
        system = self.system
        terms = monomials.evaluate(system.words, points) * system.coefficients
        shape = (system.row.size, system.size)
        adding = sps.csr_array((np.ones(shape[0]), (np.arange(shape[0]), system.row)), shape=shape)
        values = np.asarray(terms @ adding)
        least = np.full(points.shape[0], np.inf)
        for k in self.constraints:
            layout = self.layout(k)
            known = np.isfinite(values[:, np.unique(layout)]).all(axis=1)
            least[~known] = -np.inf
            at = values[known]
            if self.second_order[k]:
                found = at[:, layout[0, 0]] - np.linalg.norm(at[:, layout[0, 1:]], axis=1)
            else:
                found = np.linalg.eigvalsh(at[:, layout])[:, 0]
            least[known] = np.minimum(least[known], found)
        return least

    def cuts(
        self, x: NDArray[np.float64], near: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], sps.csr_array]:
        """Evaluate v' G v and its gradients (C, n) for eigenvectors v of G.

        Parameters
        ----------
        x : (n,) float
            The point of values and gradients.
        near : (n,) float
            The point of the eigenvectors.
        """
        values, jacobian = self.system.values(x), self.system.jacobian(x)
        there = self.system.values(near)
        found, rows = [np.zeros(0)], [np.zeros((0, self.system.size))]
        for k in self.constraints:
            layout = self.layout(k)
            vectors = np.linalg.eigh(there[layout])[1]
            weight = np.zeros((vectors.shape[1], self.system.size))
            for row, v in zip(weight, vectors.T, strict=True):
                np.add.at(row, layout.ravel(), np.outer(v, v).ravel())
            found.append(weight @ values)
            rows.append(weight)
        weights = sps.csr_array(np.concatenate(rows))
        return np.concatenate(found), sps.csr_array(weights @ jacobian)

    def propagation(self) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Find non-negative entries, and entries a, b, c with a^2 <= b c."""
        diagonal = np.zeros(self.system.size, bool)
        triples: set[tuple[int, int, int]] = set()
        for k in self.constraints:
            layout = self.layout(k)
            diagonal[np.diag(layout)] = True
            for i, j in zip(*np.tril_indices(layout.shape[0], -1), strict=True):
                if layout[i, j] < self.system.size - 1:
                    triples.add((int(layout[i, j]), int(layout[i, i]), int(layout[j, j])))
        return diagonal[:-1], np.array(sorted(triples), np.int64).reshape(-1, 3)
