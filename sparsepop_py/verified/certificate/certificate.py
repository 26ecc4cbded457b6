"""Certificates: a claim about one problem and the argument for it.

``verify`` replays the whole chain from the exact doubles of the problem: the steps that
made the box, the branching that split it, and a bound or a proof of emptiness on every leaf.
It needs no solver and trusts no stored number but as a multiplier, a cutoff or a claim.

A cutoff needs no attained point to be sound. Points with f(x) > cutoff satisfy
f >= cutoff; for the others the steps that use f(x) <= cutoff are valid. So, whatever the
cutoff is,

    min f  >=  min(cutoff, smallest bound of all leaves),

and the claim can never exceed the cutoff. (A cutoff that no point attains only makes the
claim weak.) Without any cutoff, leaves that are all empty prove that nothing is feasible.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.budget import check
from sparsepop_py.errors import ProblemError, check_kind
from sparsepop_py.problem.problem import Problem
from sparsepop_py.verified.arithmetic.array_checks import is_index
from sparsepop_py.verified.arithmetic.display import rounded
from sparsepop_py.verified.arithmetic.interval import Interval, require_ieee
from sparsepop_py.verified.arithmetic.polynomial_range import range_over
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.certificate.exact_dual import ExactDual
from sparsepop_py.verified.certificate.lp_dual import LinearDual
from sparsepop_py.verified.certificate.rational_gram import ExactGram
from sparsepop_py.verified.certificate.sos_identity import Identity
from sparsepop_py.verified.certificate.steps import BoxProof, Known, Replay, Sublevel, Tightening

__all__ = ["Certificate", "Node", "Proved", "Verdict", "certify", "claim", "prove", "split_box"]

Argument = Identity | LinearDual | ExactGram | ExactDual


class Verdict(NamedTuple):
    """Outcome of a verification, true where the claim holds.

    Parameters
    ----------
    ok : bool
        Whether the claim holds.
    bound : float
        The recomputed lower bound.
    reason : str
        Sentence on why the claim fails; empty if it holds.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, = sp.variables(1)
    >>> certificate = sp.solve(sp.Problem(x, lower=0, upper=1)).certificate
    >>> certificate.verify(sp.Problem(x, lower=-1, upper=1)).reason
    'the certificate belongs to another problem'
    >>> bool(certificate.verify(sp.Problem(x, lower=-1, upper=1)))
    False
    """

    ok: bool
    bound: float
    reason: str

    def __bool__(self) -> bool:
        """Be true where the claim holds, though a tuple of three items never is empty."""
        return self.ok


class Proved(NamedTuple):
    """Proved bound of one node (+inf if it is empty), and the cost of rounding.

    Parameters
    ----------
    bound, correction : float
    reason : str
        Sentence on why the argument is weak; may be empty.
    """

    bound: float
    correction: float
    reason: str


@dataclass(frozen=True, eq=False)
class Node:
    """Node of a branch-and-bound tree: steps, then a bound or a branch.

    Parameters
    ----------
    box : BoxProof
        Steps from the box of the node to a smaller one.
    argument : Identity, LinearDual, ExactGram, ExactDual or None
        Multipliers of the objective; of the constant 0 where ``empty``.
    empty : bool
        Whether the argument proves that the box holds no feasible point.
    branch : (int, float) or None
        Variable and branching point: the children are x_v <= point and x_v >= point.
    children : tuple of Node
        Two for a branch, none for a leaf.
    """

    box: BoxProof = field(default_factory=BoxProof)
    argument: Argument | None = None
    empty: bool = False
    branch: tuple[int, float] | None = None
    children: tuple[Node, ...] = ()

    def __post_init__(self) -> None:
        self.__dict__["children"] = tuple(self.children)
        if not isinstance(self.box, BoxProof):
            raise ProblemError(f"box: found {type(self.box).__name__}, expected a BoxProof")
        for child in self.children:
            if not isinstance(child, Node):
                raise ProblemError(f"children: found {type(child).__name__}, expected a Node")

    def __iter__(self) -> Iterator[Node]:
        """Iterate over the node and all its descendants."""
        stack = [self]
        while stack:
            node = stack.pop()
            yield node
            stack.extend(node.children)

    def __reduce__(self) -> tuple[Any, ...]:
        """List all nodes, so that pickling a deep tree does not recurse."""
        rows = [(n.box, n.argument, n.empty, n.branch, len(n.children)) for n in self]
        return _tree, (rows,)


def _tree(rows: list[tuple[Any, ...]]) -> Node:
    """Rebuild the tree whose nodes are listed in the order of iteration."""
    made: list[Node] = []
    for box, argument, empty, branch, count in reversed(rows):
        children = tuple(made[len(made) - count :])  # the last node was iterated over first
        del made[len(made) - count :]
        made.append(Node(box, argument, empty, branch, children))
    return made[0]


def split_box(box: Interval, branch: tuple[int, float]) -> tuple[Interval, Interval]:
    """Split a box in two boxes that cover it, wherever the branching point lies."""
    variable, point = branch
    low, high = box.hi.copy(), box.lo.copy()
    low[variable] = min(low[variable], point)
    high[variable] = max(high[variable], point)
    return Interval(box.lo, low), Interval(high, box.hi)


def prove(replay: Replay, box: Interval, argument: Argument | None, empty: bool) -> Proved:
    """Compute the bound of the objective on a box that an argument proves.

    It is at least the bound of interval arithmetic alone.

    Parameters
    ----------
    replay : Replay
        The problem and the cutoff.
    box : Interval
    argument : Identity, LinearDual, ExactGram, ExactDual or None
    empty : bool
        Whether the argument is to prove that the box holds no feasible point.

    Returns
    -------
    Proved
    """
    problem = replay.problem
    if is_empty(box):
        return Proved(np.inf, 0.0, "")
    bound = _without_multipliers(problem, box)
    if argument is None:
        return Proved(bound, 0.0, "")
    if isinstance(argument, ExactGram):
        value = -np.inf if empty else argument.bound(problem.objective)
        return Proved(max(bound, value), 0.0, "" if np.isfinite(value) else "no sum of squares")
    fits = argument.covers if isinstance(argument, ExactDual) else argument.scaling.contains
    if not fits(box):
        return Proved(bound, 0.0, "the box is larger than the multipliers assume")
    if isinstance(argument, ExactDual):
        return _proved_exactly(problem, argument, empty, bound)
    objective = problem.objective_row
    if empty:
        objective = PolynomialSystem.stack([problem.objective * 0.0], problem.dimension)
    correction, reason = 0.0, ""
    if isinstance(argument, LinearDual):
        value = float(argument.evaluate(problem.rows, problem.equality, objective)[0])
        correction = 1e-13 * abs(value)
    else:
        rows, equality, matrices = problem.rows, problem.equality, problem.matrices
        found = argument.evaluate(rows, equality, objective, matrices)
        value, correction, reason = found.bound, found.correction, found.reason
    if empty:
        value, correction = (np.inf, correction) if value > 0 else (-np.inf, 0.0)
    if not value >= bound:  # or no number
        return Proved(bound, 0.0, reason)
    return Proved(value, correction, reason)


def _proved_exactly(problem: Problem, argument: ExactDual, empty: bool, bound: float) -> Proved:
    """Compute the bound of rational multipliers, at least a bound that is known."""
    objective = problem.objective * 0.0 if empty else problem.objective
    value = argument.bound(problem.rows, problem.equality, objective)
    if empty:
        value = np.inf if value > 0 else -np.inf
    reason = "" if value > -np.inf else "the multipliers leave no sum of squares"
    return Proved(max(bound, value), 0.0, reason)


@dataclass(frozen=True, eq=False, repr=False)
class Certificate:
    """Proof of a lower bound of the objective, or that no point is feasible.

    Parameters
    ----------
    fingerprint : str
        Of the problem that the claim is about.
    bound : float
        The claim; +inf says that no point is feasible.
    root : Node
        The argument: one node, or a tree of nodes that cover the problem's box.
    cutoff : float or None
        The objective value above which nothing is claimed; the claim cannot exceed it.
    correction : float
        Largest cost of the remainder in one node, in units of the objective.
    assumptions : tuple of str
        Conditions of the conclusion; empty for problems given as numbers.
    problem : Problem, optional
        That of the result it belongs to, for :meth:`to_coq`; no check uses it.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> problem = sp.Problem(x * y, [x**2 + y**2 <= 1])
    >>> certificate = sp.solve(problem).certificate
    >>> certificate.verify(problem).ok
    True
    """

    fingerprint: str
    bound: float
    root: Node = field(default_factory=Node)
    cutoff: float | None = None
    correction: float = 0.0
    assumptions: tuple[str, ...] = ()
    problem: Problem | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        self.__dict__["assumptions"] = tuple(self.assumptions)
        for name, kind in (("fingerprint", str), ("root", Node)):
            value = getattr(self, name)
            if not isinstance(value, kind):
                raise ProblemError(
                    f"{name}: found {type(value).__name__}, expected {kind.__name__}"
                )

    def verify(self, problem: Problem, known: dict[Any, Any] | None = None) -> Verdict:
        """Recompute the bound from the problem's exact doubles, without any solver.

        Parameters
        ----------
        problem : Problem
            The one that was solved, or an equal one; fingerprints are compared.
        known : dict, optional
            Filled with results that hold for other objectives too; pass one dict to verify
            certificates over the same feasible set faster.

        Returns
        -------
        Verdict
            ``ok`` is true exactly when the problem is the one that was certified and the
            recomputed bound is at least the claimed one. Nothing is raised for another problem, or
            for something that is none: ``reason`` says so.

        Examples
        --------
        >>> import sparsepop_py as sp
        >>> x, y = sp.variables(2)
        >>> disc = sp.Problem(x * y, [x**2 + y**2 <= 1])
        >>> verdict = sp.solve(disc).certificate.verify(disc)
        >>> verdict.ok, round(verdict.bound, 6)
        (True, -0.5)
        """
        if not isinstance(problem, Problem):
            return Verdict(False, -np.inf, f"found {type(problem).__name__}, expected a Problem")
        if self.fingerprint != problem.fingerprint:
            return Verdict(False, -np.inf, "the certificate belongs to another problem")
        recomputed, _, reason = self.recompute(problem, known)
        if recomputed >= self.bound:
            return Verdict(True, recomputed, "")
        reason = reason or "the argument proves less than what is claimed"
        return Verdict(False, recomputed, reason)

    def to_coq(self, path: str | os.PathLike[str], problem: Problem | None = None) -> None:
        """Write a Coq file that states the problem in rationals and proves the bound.

        Parameters
        ----------
        path : str or PathLike
            Ends in ``.v``; ``coqc`` checks it with Coq 8.16 and its standard library.
        problem : Problem, optional
            That of the result it belongs to when left out.

        Raises
        ------
        ProblemError
            If the problem is missing or another one, or the certificate holds an argument that
            the export does not cover; the message names it.
        OutputError
            If the file cannot be written.
        """
        about = self.problem if problem is None else problem
        if about is None:
            raise ProblemError("to_coq: found no problem, expected the one that was certified")
        import_module("sparsepop_py.io.coq").write_coq(self, path, about)  # no part of a check

    def recompute(
        self, problem: Problem, known: dict[Any, Any] | None = None
    ) -> tuple[float, float, str]:
        """Recompute the bound that the argument proves.

        The result is kept in ``known`` under the certificate's ``id``, so that a certificate that
        others quote is checked once. The certificate is kept with it: while it is alive, Python
        gives its id to no other object.

        Parameters
        ----------
        problem : Problem
        known : dict, optional
            As in :meth:`verify`.

        Returns
        -------
        bound : float
        correction : float
            Cost of rounding.
        reason : str
            Sentence on why the bound is weak; may be empty.

        Raises
        ------
        ProblemError
            If ``problem`` is no Problem, or ``known`` no dict.
        """
        check_kind(problem, Problem, "problem")
        known = {} if known is None else known
        check_kind(known, dict, "known")
        key = ("certificate", problem.fingerprint, id(self))
        if key not in known:
            known[key] = (self, (-np.inf, np.inf, "it quotes itself"))  # till it is known
            try:
                known[key] = (self, self._recomputed(problem, known))
            except BaseException:  # interrupted
                del known[key]
                raise
        found: tuple[float, float, str] = known[key][1]
        return found

    def settled(self, problem: Problem, known: dict[Any, Any] | None = None) -> Certificate | None:
        """Lower the claim to the bound that verification reaches.

        The cutoff falls while a search goes on, and the boxes of its nodes shrink with it.
        Verification repeats all steps with the last cutoff. Rounding may then leave slightly larger
        boxes, so that a claim may be too large by a few units in the last place.

        Parameters
        ----------
        problem : Problem
            The problem that the certificate is about.
        known : dict, optional
            As in :meth:`verify`.

        Returns
        -------
        Certificate or None
            With the largest claim that verifies, at most that of this one; None where nothing is
            proved of the problem.

        Examples
        --------
        >>> import sparsepop_py as sp
        >>> x, = sp.variables(1)
        >>> problem = sp.Problem(x, lower=0, upper=1)
        >>> certificate = sp.solve(problem).certificate
        >>> certificate.settled(problem).bound == certificate.bound
        True
        """
        found = bound, correction, _ = self.recompute(problem, known)
        if bound >= self.bound:
            return self
        lowered = claim(Proved(bound, correction, ""))
        if lowered == -np.inf:
            return None
        made = replace(self, bound=lowered)
        if known is not None:  # what is recomputed does not depend on the claim
            known["certificate", problem.fingerprint, id(made)] = made, found
        return made

    def _recomputed(self, problem: Problem, known: dict[Any, Any]) -> tuple[float, float, str]:
        """Recompute node by node, so that memory does not grow; see :meth:`recompute`."""
        require_ieee()
        cutoff = None if self.cutoff is None else float(self.cutoff)
        if cutoff is not None and not np.isfinite(cutoff):
            return -np.inf, np.inf, "the cutoff is not a number"
        replay = Replay(problem, cutoff, known)
        self._settle(replay)
        bound, correction, reason, uses_cutoff = np.inf, 0.0, "", False
        stack: list[tuple[Node, Interval | None]] = [(self.root, None)]
        while stack:
            node, outer = stack.pop()
            check()
            box = node.box.replay(replay, outer)
            uses_cutoff |= node.box.uses_cutoff
            if node.branch is not None and len(node.children) == 2 and not is_empty(box):
                if not is_index(node.branch[0], problem.dimension) or not np.isfinite(
                    node.branch[1]
                ):
                    return -np.inf, np.inf, "a branch is malformed"
                halves = split_box(box, node.branch)
                stack += list(zip(node.children, halves, strict=True))
                continue
            proved = prove(replay, box, node.argument, node.empty)
            if proved.bound < bound:
                bound, reason = proved.bound, proved.reason
            correction = max(correction, proved.correction)
        if uses_cutoff and cutoff is not None and not bound <= cutoff:
            return cutoff, correction, "nothing is proved above the cutoff"
        return bound, correction, reason

    def _settle(self, replay: Replay) -> None:
        """Check the quoted certificates one after the other: chains of them are long."""
        for variable, side, proof in self._chain():
            replay.holds(variable, side, proof)

    def _chain(self) -> list[tuple[Any, Any, Certificate]]:
        """List all quoted certificates, each after those that it quotes."""
        found: list[tuple[Any, Any, Certificate]] = []
        seen: set[int] = set()
        stack = [(*quote, False) for quote in self.quotes]
        while stack:
            variable, side, proof, ready = stack.pop()
            if ready:
                found.append((variable, side, proof))
            elif isinstance(proof, Certificate) and id(proof) not in seen:
                seen.add(id(proof))
                stack.append((variable, side, proof, True))
                stack += [(*quote, False) for quote in proof.quotes]
        return found

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle quoted certificates first, so that a long chain does not recurse."""
        values = [getattr(self, each.name) for each in fields(self)]
        return _after, (self.quoted, *values)

    @property
    def quoted(self) -> list[Certificate]:
        """All certificates that this one rests on, each after those that it quotes itself."""
        return [proof for _, _, proof in self._chain()]

    @cached_property
    def quotes(self) -> tuple[tuple[int, int, Any], ...]:
        """Variable, side and certificate of each bound that is quoted."""
        steps = [step for node in self.root for step in node.box.steps]
        known = [step for step in steps if isinstance(step, Known)]
        return tuple(quote for step in known for quote in step.bounds)

    @property
    def box(self) -> BoxProof:
        """Steps that tightened the box before any branching."""
        return self.root.box

    @property
    def identity(self) -> Argument | None:
        """Multipliers of the root, where there is one node only."""
        return self.root.argument

    @property
    def leaves(self) -> int:
        """Number of leaves of the tree."""
        return sum(not node.children for node in self.root)

    @property
    def numbers(self) -> int:
        """Number of stored multipliers, without those of bounds of other objectives."""
        return sum(_numbers(node) for node in self.root)

    @property
    def uses_cutoff(self) -> bool:
        """True if some step relies on the cutoff."""
        return any(node.box.uses_cutoff for node in self.root)

    def __repr__(self) -> str:
        return f"<{self}>"

    def __str__(self) -> str:
        least = rounded(self.bound, False, 12)
        claim = "no feasible point" if self.bound == np.inf else f"objective >= {least}"
        steps = sum(len(node.box.steps) for node in self.root)
        words = [claim, f"{steps} box steps", f"{self.numbers} multipliers"]
        if self.leaves > 1:
            words.append(f"{self.leaves} leaves")
        if self.cutoff is not None:
            words.append(f"cutoff at {self.cutoff:.12g}")
        others = sum(len(s.bounds) for n in self.root for s in n.box.steps if isinstance(s, Known))
        if others:
            words.append(f"{others} bounds of other objectives")
        return "certificate: " + ", ".join(words)


def _after(quoted: list[Certificate], *values: Any) -> Certificate:
    """Rebuild a certificate after those that it quotes."""
    return Certificate(*values)


def _numbers(node: Node) -> int:
    count = _stored(node.argument)
    for step in node.box.steps:
        if isinstance(step, Tightening):
            count += _stored(step.argument)
        elif isinstance(step, Sublevel):
            count += _stored(step.identity)
    return count


def _stored(argument: Argument | None) -> int:
    if isinstance(argument, Identity):
        return sum(m.numbers for m in argument.multipliers)
    return argument.numbers if argument is not None else 0


def _without_multipliers(problem: Problem, box: Interval) -> float:
    """Bound the objective by its range over the box, or the constant of its squares."""
    bound = float(range_over(problem.objective_row, box).lo[0])
    constant = problem.squares_constant
    bound = bound if np.isfinite(bound) else -np.inf
    return bound if constant is None else max(bound, constant)


def claim(proved: Proved) -> float:
    """Reduce a bound a little, since another machine may add in another order."""
    if not np.isfinite(proved.bound) or proved.correction == 0.0:
        return proved.bound
    return proved.bound - 0.01 * proved.correction - 1e-15 * abs(proved.bound)


def certify(replay: Replay, root: Node, proved: Proved) -> Certificate | None:
    """Build the certificate of a tree, None where nothing is proved.

    Parameters
    ----------
    replay : Replay
        The problem and its cutoff.
    root : Node
    proved : Proved
        The smallest bound of all leaves, as :func:`prove` returned it.

    Returns
    -------
    Certificate or None
    """
    bound = claim(proved)
    cutoff = replay.cutoff if any(node.box.uses_cutoff for node in root) else None
    if cutoff is not None:
        bound = min(bound, cutoff)
    if bound == -np.inf:
        return None
    return Certificate(replay.problem.fingerprint, bound, root, cutoff, proved.correction)
