"""Proof of a box: steps that tighten the problem's bounds, replayed from exact data.

Each step names its argument and its scope. Steps that use the cutoff f(x) <= cutoff hold
where f is at most that cutoff, whatever the cutoff is; a box that is empty after them proves
f > cutoff, and nothing about feasibility. Steps without the cutoff hold for every
objective over the same feasible set.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.matrix_constraints import Matrices
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.budget import check
from sparsepop_py.problem.problem import Problem
from sparsepop_py.verified.arithmetic.array_checks import are_indices, is_index
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.left_inverse import LeftInverse
from sparsepop_py.verified.box.propagation import (
    Rows,
    box_rows,
    is_empty,
    propagate,
    sweep,
    with_cutoff,
)
from sparsepop_py.verified.certificate.exact_dual import ExactDual
from sparsepop_py.verified.certificate.lp_dual import LinearDual
from sparsepop_py.verified.certificate.sos_identity import Identity

__all__ = [
    "BoxProof",
    "Known",
    "Propagation",
    "Replay",
    "Step",
    "Sublevel",
    "Tightening",
    "box_rows",
    "coordinates",
    "shrunk",
    "sublevel_box",
    "tighten",
    "with_cutoff",
]


_MOST_SWEEPS = 1000


@dataclass(frozen=True)
class Propagation:
    """``sweeps`` passes of interval propagation, with the cutoff row or without it.

    More than 1000 are not replayed: a box that creeps would keep a reader of files for ever.
    """

    sweeps: int
    uses_cutoff: bool


@dataclass(frozen=True, eq=False)
class Sublevel:
    """Bounds of variables where f <= cutoff, from a sum-of-squares identity.

    The sum-of-squares identity proves 0 >= -K + e sum_b (b(t))^2 on that set with a floor e > 0,
    the sum running over the monomials of the moment blocks, among them t_v^d; so
    |t_v| <= (K / e - c)^(1 / 2d). c is 1 where the
    monomial 1 is among them, else 0. The identity is evaluated at its own cutoff, so that the box
    is the same whatever lower cutoff it is used at.
    """

    identity: Identity
    cutoff: float

    @property
    def uses_cutoff(self) -> bool:
        """Always true: the set is f <= cutoff."""
        return True


@dataclass(frozen=True, eq=False)
class Tightening:
    """Bounds of single variables from linear programs or one relaxation on the box (OBBT).

    Parameters
    ----------
    variable, side : (K,) int
        Side +1 says x_v >= value, side -1 says x_v <= value.
    value : (K,) float
        The claims; a claim that the argument does not reach is skipped.
    argument : LinearDual, Identity or ExactDual
        Of the K polynomials side * x_v; the last two speak of one.
    uses_cutoff : bool
        Whether the row cutoff - f(x) >= 0 stands behind the constraints.
    """

    variable: NDArray[np.int64]
    side: NDArray[np.int64]
    value: NDArray[np.float64]
    argument: LinearDual | Identity | ExactDual
    uses_cutoff: bool

    def reached(
        self, system: PolynomialSystem, equality: NDArray[np.bool_], matrices: Matrices
    ) -> NDArray[np.float64]:
        """Compute proved lower bounds of side * x_v, (K,), from the constraints."""
        asked = coordinates(self.variable, self.side, system.dimension)
        if isinstance(self.argument, LinearDual):
            return self.argument.evaluate(system, equality, asked)
        if self.value.size != 1:
            return np.full(self.value.size, -np.inf)
        if isinstance(self.argument, ExactDual):
            target = Polynomial.from_words(asked.words, asked.coefficients, asked.dimension)
            return np.array([self.argument.bound(system, equality, target)])
        return np.array([self.argument.evaluate(system, equality, asked, matrices).bound])


class Proof(Protocol):
    """Argument behind a :class:`Known` bound: the certificate of another objective."""

    @property
    def bound(self) -> float:
        """The claim."""

    def recompute(
        self, problem: Problem, known: dict[Any, Any] | None = None
    ) -> tuple[float, float, str]:
        """Recompute the bound that holds, the cost of rounding, and a reason for none."""


@dataclass(frozen=True, eq=False)
class Known:
    """Bounds of single variables that are certificates of their own (other objectives).

    Parameters
    ----------
    bounds : tuple of (variable, side, proof)
        Each proof is about the problem with the objective side * x_v.
    """

    bounds: tuple[tuple[int, int, Proof], ...]

    @property
    def uses_cutoff(self) -> bool:
        """Always false: these bounds hold on the whole feasible set."""
        return False


Step = Propagation | Sublevel | LeftInverse | Tightening | Known


@dataclass(eq=False)
class Replay:
    """Problem and cutoff for replaying steps, with a memory. Mutable.

    Parameters
    ----------
    problem : Problem
    cutoff : float or None
        Steps may use f(x) <= cutoff.
    known : dict
        Results of arguments that hold for all objectives, by feasible set and argument; replays
        of other problems may fill it too.
    """

    problem: Problem
    cutoff: float | None
    known: dict[Any, Any] = field(default_factory=dict)
    _rows: dict[bool, Rows] = field(default_factory=dict)
    _systems: dict[bool, tuple[PolynomialSystem, NDArray[Any]]] = field(default_factory=dict)

    def rows(self, uses_cutoff: bool) -> Rows:
        """Build the rows of propagation."""
        if uses_cutoff not in self._rows:
            cutoff = self.cutoff if uses_cutoff else None
            self._rows[uses_cutoff] = box_rows(self.problem, cutoff)
        return self._rows[uses_cutoff]

    def system(self, uses_cutoff: bool) -> tuple[PolynomialSystem, NDArray[np.bool_]]:
        """Stack the constraints, with the cutoff row behind them if asked; mark equalities."""
        if uses_cutoff not in self._systems:
            pair = (self.problem.rows, self.problem.equality)
            if uses_cutoff and self.cutoff is not None:
                pair = with_cutoff(self.problem, self.cutoff)
            self._systems[uses_cutoff] = pair
        return self._systems[uses_cutoff]

    def step(self, step: Step, box: Interval) -> Interval:
        """Apply a step to a box; where its argument fails, the box stays."""
        if step.uses_cutoff and self.cutoff is None:
            return box
        if isinstance(step, Propagation):
            rows = self.rows(step.uses_cutoff)
            for _ in range(min(step.sweeps, _MOST_SWEEPS)):
                check()
                old, box = box, sweep(rows, box)
                moved = np.count_nonzero(old.lo != box.lo) or np.count_nonzero(old.hi != box.hi)
                if not moved or is_empty(box):
                    break
            return box
        if isinstance(step, Sublevel):
            return sublevel_box(self.problem, self.cutoff, step, box)
        if isinstance(step, LeftInverse):
            return step.shrink(self.problem, box)
        if isinstance(step, Tightening):
            return self._tightened(step, box)
        return self._quoted_bounds(step, box)

    def begun(self, steps: tuple[Step, ...]) -> tuple[Interval, int]:
        """Apply the first steps, which hold for all objectives, to the problem's bounds.

        Certificates over one feasible set mostly begin alike: their boxes are remembered.
        """
        count = next((k for k, step in enumerate(steps) if step.uses_cutoff), len(steps))
        keys = [(self._feasible_set, *map(id, steps[: k + 1])) for k in range(count)]
        done = max((k + 1 for k in range(count) if keys[k] in self.known), default=0)
        box = Interval(self.problem.lower, self.problem.upper)
        box = self.known[keys[done - 1]][1] if done else box
        for k in range(done, count):
            if is_empty(box):
                return box, k
            box = self.step(steps[k], box)
            self.known[keys[k]] = (steps[: k + 1], box)
        return box, count

    def _tightened(self, step: Tightening, box: Interval) -> Interval:
        n = self.problem.dimension
        shapes = step.variable.shape == step.side.shape == step.value.shape
        if not shapes or step.variable.ndim != 1 or not are_indices(step.variable, n):
            return box
        floats = step.value.dtype in (np.float64, np.float32)  # others may overflow when negated
        if not floats or not np.all((step.side == 1) | (step.side == -1)):
            return box
        argument = step.argument
        fits = argument.covers if isinstance(argument, ExactDual) else argument.scaling.contains
        if not fits(box):
            return box

        def proved() -> NDArray[np.float64]:
            return step.reached(*self.system(step.uses_cutoff), self.problem.matrices)

        bound = proved() if step.uses_cutoff else self._remembered(step, (), proved)
        holds = (bound >= step.value) & np.isfinite(step.value)
        return shrunk(box, step.variable[holds], step.side[holds], step.value[holds])

    def _quoted_bounds(self, step: Known, box: Interval) -> Interval:
        for variable, side, proof in step.bounds:
            if self.holds(variable, side, proof):
                one = np.array([variable])
                box = shrunk(box, one, np.array([side]), np.array([float(proof.bound)]))
        return box

    def holds(self, variable: int, side: int, proof: Proof) -> bool:
        """Check that another objective's certificate proves its claim on side * x_v."""
        sensible = is_index(variable, self.problem.dimension) and side in (1, -1)
        if not sensible or not np.isfinite(proof.bound):
            return False
        quoted = partial(self._quoted, proof, variable, side)
        return bool(self._remembered(proof, (variable, side), quoted) >= proof.bound)

    def _quoted(self, proof: Proof, variable: int, side: int) -> float:
        """Compute the bound of side * x_v that another objective's certificate proves."""
        return proof.recompute(self.about(variable, side), self.known)[0]

    def about(self, variable: int, side: int) -> Problem:
        """Return the problem with the objective side * x_v."""
        word, value = np.array([[variable + 1]], np.int32), np.array([float(side)])
        target = Polynomial.from_words(word, value, self.problem.dimension)
        return self.problem.with_objective(target)

    @cached_property
    def _feasible_set(self) -> str:
        """A name of the feasible set, the same for all objectives."""
        return self.about(0, 1).fingerprint

    def _remembered(
        self, argument: object, about: tuple[int, ...], prove: Callable[[], Any]
    ) -> Any:
        """Compute once what an argument proves on this feasible set.

        The result is kept under the argument's ``id``. The argument is kept with it: while it is
        alive, Python gives its id to no other object.
        """
        key = (self._feasible_set, id(argument), about)
        if key not in self.known:
            self.known[key] = (argument, prove())
        return self.known[key][1]


def shrunk(
    box: Interval, variable: NDArray[Any], side: NDArray[Any], value: NDArray[Any]
) -> Interval:
    """Intersect a box with side * x_v >= value."""
    lo, hi = box.lo.copy(), box.hi.copy()
    low = side > 0
    np.maximum.at(lo, variable[low], value[low])
    np.minimum.at(hi, variable[~low], -value[~low])
    return Interval(lo, hi)


def coordinates(
    variable: NDArray[np.int64], side: NDArray[np.int64], dimension: int
) -> PolynomialSystem:
    """Stack the polynomials side * x_v."""
    words = (variable + 1).astype(np.int32)[:, None]
    row = np.arange(variable.size)
    return PolynomialSystem(words, side.astype(float), row, variable.size, dimension)


@dataclass(frozen=True)
class BoxProof:
    """Steps that lead from one box to a smaller one."""

    steps: tuple[Step, ...] = ()

    def __post_init__(self) -> None:
        self.__dict__["steps"] = tuple(self.steps)

    @property
    def uses_cutoff(self) -> bool:
        """True if the box holds only where the objective is at most the cutoff."""
        return any(step.uses_cutoff for step in self.steps)

    def replay(self, replay: Replay, box: Interval | None = None) -> Interval:
        """Recompute the box from ``box``, by default from the bounds of the problem.

        lo > hi somewhere proves that it holds no feasible point (with f <= cutoff).
        """
        steps = self.steps
        if box is None:
            box, done = replay.begun(steps)
            steps = steps[done:]
        for step in steps:
            if is_empty(box):
                break
            box = replay.step(step, box)
        return box


def tighten(replay: Replay, box: Interval, limit: int = 60) -> tuple[Interval, Propagation]:
    """Propagate to a fixed point, with the cutoff if there is one.

    Returns
    -------
    box : Interval
    step : Propagation
        The step that proves it.
    """
    uses_cutoff = replay.cutoff is not None
    tighter, sweeps = propagate(replay.rows(uses_cutoff), box, limit)
    return tighter, Propagation(sweeps, uses_cutoff)


def sublevel_box(problem: Problem, cutoff: float | None, step: Sublevel, box: Interval) -> Interval:
    """Intersect a box with the bounds of a sublevel identity, if its cutoff suffices."""
    scaling = step.identity.scaling
    if cutoff is None or not cutoff <= step.cutoff < np.inf or not scaling.contains(box):
        return box
    system, equality = with_cutoff(problem, float(step.cutoff))
    nothing = PolynomialSystem.stack([problem.objective * 0.0], problem.dimension)
    proved = step.identity.evaluate(system, equality, nothing, problem.matrices)
    if not proved.floor > 0 or not np.isfinite(proved.bound):
        return box
    size = Interval.point(-proved.bound) / Interval.point(proved.floor)
    power = np.zeros(problem.dimension + 1, np.int64)
    one = 0.0
    for group in step.identity.multipliers:
        if group.floor > 0 and not group.free:
            words = group.basis[group.generator == 0].reshape(-1, group.basis.shape[2])
            one = max(one, float(not words.any(axis=1).all()))
            row, variable, exponent = monomials.runs(words)
            pure = np.bincount(row, minlength=words.shape[0]) == 1
            keep = pure[row]
            np.maximum.at(power, variable[keep], exponent[keep])
    power = power[:-1]
    above = max(0.0, float((size - Interval.point(one)).hi))
    radius = np.where(power > 0, _root_above(above, 2 * np.maximum(power, 1)), np.inf)
    reach = Interval.point(scaling.scale) * Interval.point(np.where(power > 0, radius, 0.0))
    centre = Interval.point(scaling.centre)
    low, high = (centre - reach).lo, (centre + reach).hi
    return Interval(
        np.where(power > 0, np.maximum(box.lo, low), box.lo),
        np.where(power > 0, np.minimum(box.hi, high), box.hi),
    )


def _root_above(value: float, power: NDArray[Any]) -> NDArray[np.float64]:
    """Upper bounds of value^(1/power), checked by multiplication."""
    root = value ** (1.0 / power) * (1.0 + 1e-12)
    holds = Interval.point(root).power(power).lo >= value
    return np.where(holds, root, max(1.0, value))
