"""Interval propagation: what each constraint says about each variable.

A row says sum_k atom_k(x) in [lower, upper]. Over the current box every atom has a
range, so atom_k lies in [lower, upper] minus the ranges of the others, and a variable
in what the inverse of its atom makes of that. Atoms are monomials, and c1 x + c2 x^2
taken together (completing the square bounds a variable from nothing). All rows are
swept at once; every operation is rounded outward, so the box that results contains
every point of the old box that satisfies the rows.

References
----------
P. Belotti et al., Branching and bounds tightening techniques for non-convex MINLP,
Optimization Methods and Software 24, 2009 (feasibility-based bound tightening).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.budget import check
from sparsepop_py.problem.problem import Problem
from sparsepop_py.verified.arithmetic.interval import Interval, down, sum_by, up
from sparsepop_py.verified.arithmetic.polynomial_range import Factors, product

__all__ = ["Rows", "box_rows", "propagate", "sweep", "with_cutoff"]

_PROGRESS = 0.02  # of a width: propagation ends where no sweep gains as much
_POINT = 1e-9  # widths below this (relative) need not shrink further


@dataclass(frozen=True, eq=False)
class Rows:
    """Stacked polynomials with the interval that each must lie in.

    Parameters
    ----------
    system : PolynomialSystem
    target : Interval (m,)
    minors : (P, 3) int
        Rows a, b, c with a(x)^2 <= b(x) c(x) and b, c >= 0, as in semidefinite matrices.
    """

    system: PolynomialSystem
    target: Interval
    minors: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 3), np.int64))

    @cached_property
    def _quadratic(
        self,
    ) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Pairs c1 x + c2 x^2: row, variable, c1, c2, and which terms remain monomials."""
        system = self.system
        degree = monomials.degrees(system.words)
        last = system.words[:, -1].astype(np.int64)
        before = system.words[:, -2] if system.words.shape[1] > 1 else np.zeros_like(last)
        key = system.row * (system.dimension + 1) + last
        linear = np.flatnonzero(degree == 1)
        square = np.flatnonzero((degree == 2) & (before == last))
        _, one, two = np.intersect1d(key[linear], key[square], return_indices=True)
        one, two = linear[one], square[two]
        rest = np.ones(system.row.size, bool)
        rest[one] = rest[two] = False
        return (
            system.row[one],
            last[one] - 1,
            system.coefficients[one],
            system.coefficients[two],
            np.flatnonzero(rest),
        )

    @cached_property
    def _extrema(self) -> tuple[Interval, Interval]:
        """Places and values of the extrema of the pairs."""
        _, _, c1, c2, _ = self._quadratic
        return _vertex(Interval.point(c1), Interval.point(c2))

    @cached_property
    def _factors(self) -> Factors:
        return Factors.of(self.system.words[self._quadratic[4]], self.system.dimension)

    @cached_property
    def _slots(self) -> tuple[tuple[NDArray[Any], NDArray[Any], NDArray[Any]], ...]:
        """Terms that have a factor in each slot, its power and its variable."""
        power, variable = self._factors.power, self._factors.variable
        slots = [(np.flatnonzero(power[:, k]), k) for k in range(power.shape[1])]
        return tuple((real, power[real, k], variable[real, k]) for real, k in slots)


def propagate(rows: Rows, box: Interval, limit: int = 60) -> tuple[Interval, int]:
    """Sweep until nothing moves much; returns the box and the number of sweeps.

    An empty box (lo > hi somewhere) proves that no point satisfies rows and box.
    """
    for number in range(1, limit + 1):
        check()
        tighter = sweep(rows, box)
        if is_empty(tighter) or not _moved(box, tighter):
            return tighter, number
        box = tighter
    return box, limit


def is_empty(box: Interval) -> bool:
    """Check whether the box holds no point."""
    return bool(np.count_nonzero(box.lo > box.hi))


def _moved(old: Interval, new: Interval) -> bool:
    if np.any(np.isinf(old.lo) & np.isfinite(new.lo)):
        return True
    if np.any(np.isinf(old.hi) & np.isfinite(new.hi)):
        return True
    finite = np.isfinite(old.lo) & np.isfinite(old.hi)
    with np.errstate(invalid="ignore", over="ignore"):
        width, left = (old.hi - old.lo)[finite], (new.hi - new.lo)[finite]
        least = _POINT * (1.0 + np.maximum(np.abs(old.lo), np.abs(old.hi)))[finite]
        half = ~finite & (
            (np.isfinite(old.lo) & (new.lo - old.lo > 0.1 * (1 + np.abs(old.lo))))
            | (np.isfinite(old.hi) & (old.hi - new.hi > 0.1 * (1 + np.abs(old.hi))))
        )
        narrower = (width - left > _PROGRESS * width) & (width > least)
    return bool(np.any(narrower) or np.any(half))


def sweep(rows: Rows, box: Interval) -> Interval:
    """Propagate all rows once, together; the returned box lies in ``box``."""
    system, target = rows.system, rows.target
    q_row, q_var, c1, c2, plain = rows._quadratic
    factors = rows._factors
    ranges = factors.ranges(box)
    monomial = Interval.point(system.coefficients[plain]) * product(ranges)
    atoms, row = monomial, system.row[plain]
    if q_var.size:
        quadratic = _quadratic_range(c1, c2, box[q_var], rows._extrema)
        atoms = Interval(np.append(atoms.lo, quadratic.lo), np.append(atoms.hi, quadratic.hi))
        row = np.append(row, q_row)
    if rows.minors.size:
        target = _within_minors(rows, sum_by(row, atoms, system.size).hi)
    allowed = _allowed(row, atoms, target, system.size)
    lo, hi = box.lo.copy(), box.hi.copy()
    if is_empty(allowed):
        return Interval(np.full_like(lo, np.inf), np.full_like(hi, -np.inf))
    split = plain.size
    if q_var.size:
        _tighten_quadratics(lo, hi, q_var, c1, c2, box, allowed[split:], rows._extrema)
    _tighten_monomials(lo, hi, rows, ranges, allowed[:split])
    lo, hi = np.where(np.isnan(lo), box.lo, lo), np.where(np.isnan(hi), box.hi, hi)
    return Interval(lo + 0.0, hi + 0.0)  # no negative zeros


def _within_minors(rows: Rows, high: NDArray[np.float64]) -> Interval:
    """Bound each row by 2x2 minors, |a| <= sqrt(b c), from upper ends."""
    a, b, c = rows.minors.T
    limit = Interval.point(np.maximum(high[b], 0.0)) * Interval.point(np.maximum(high[c], 0.0))
    reach = up(np.sqrt(up(limit.hi)))
    lo, hi = rows.target.lo.copy(), rows.target.hi.copy()
    np.maximum.at(lo, a, -reach)
    np.minimum.at(hi, a, reach)
    return Interval(lo, hi)


def _allowed(row: NDArray[Any], atoms: Interval, target: Interval, size: int) -> Interval:
    """Bound each atom by the target of its row minus other atoms, and its range."""
    alone = np.bincount(row, minlength=size)[row] == 1
    unbounded = atoms.lo == -np.inf, atoms.hi == np.inf
    low, high = (
        np.where(far, 0.0, end) for far, end in zip(unbounded, (atoms.lo, atoms.hi), strict=True)
    )
    total = sum_by(row, Interval(low, high), size)[row]
    with np.errstate(over="ignore"):
        low, high = down(total.lo - low), up(total.hi - high)
    rest = Interval(
        _of_others(low, alone, row, unbounded[0], -np.inf),
        _of_others(high, alone, row, unbounded[1], np.inf),
    )
    exact = (rest.lo == 0) & (rest.hi == 0)
    shifted = target[row] - rest
    asked = Interval(
        np.where(exact, target.lo[row], shifted.lo), np.where(exact, target.hi[row], shifted.hi)
    )
    return asked.intersect(atoms)


def _of_others(
    finite: NDArray[Any],
    alone: NDArray[Any],
    row: NDArray[Any],
    unbounded: NDArray[Any],
    infinity: float,
) -> NDArray[np.float64]:
    """Ends of the sums of other atoms, from those of finite ones."""
    finite = np.where(alone, 0.0, finite)
    if not np.count_nonzero(unbounded):
        return finite
    blocked = np.bincount(row, weights=unbounded)[row] - unbounded > 0
    return np.where(blocked, infinity, finite)


def _quadratic_range(
    c1: NDArray[Any],
    c2: NDArray[Any],
    x: Interval,
    extrema: tuple[Interval, Interval] | None = None,
) -> Interval:
    """Range of c1 x + c2 x^2."""
    a, b = Interval.point(c1), Interval.point(c2)
    ends = []
    for end in (x.lo, x.hi):
        finite = np.isfinite(end)
        point = Interval.point(np.where(finite, end, 0.0))
        value = point * (a + b * point)
        infinite = np.where(c2 > 0, np.inf, -np.inf)
        ends.append(
            Interval(np.where(finite, value.lo, infinite), np.where(finite, value.hi, infinite))
        )
    vertex, depth = _vertex(a, b) if extrema is None else extrema
    outside = (vertex.hi < x.lo) | (vertex.lo > x.hi)
    lo, hi = np.minimum(ends[0].lo, ends[1].lo), np.maximum(ends[0].hi, ends[1].hi)
    lo = np.where((c2 > 0) & ~outside, np.minimum(lo, depth.lo), lo)
    hi = np.where((c2 < 0) & ~outside, np.maximum(hi, depth.hi), hi)
    return Interval(lo, hi)


def _vertex(a: Interval, b: Interval) -> tuple[Interval, Interval]:
    """Place and value of the extremum of a x + b x^2."""
    twice = b * Interval.point(2.0)
    vertex = -(a / twice)
    return vertex, -(a * a) / (twice * Interval.point(2.0))


def _tighten_quadratics(
    lo: NDArray[Any],
    hi: NDArray[Any],
    variable: NDArray[Any],
    c1: NDArray[Any],
    c2: NDArray[Any],
    box: Interval,
    allowed: Interval,
    extrema: tuple[Interval, Interval] | None = None,
) -> None:
    """Solve c1 x + c2 x^2 in ``allowed``: |x - vertex| between two radii."""
    vertex, depth = extrema or _vertex(Interval.point(c1), Interval.point(c2))
    squared = (allowed - depth) / Interval.point(c2)
    empty = squared.hi < 0
    outer = up(np.sqrt(np.where(empty, 0.0, squared.hi)))
    inner = down(np.sqrt(np.maximum(squared.lo, 0.0)))
    x = box[variable]
    new_lo = np.where(empty, np.inf, down(vertex.lo - outer))
    new_hi = np.where(empty, -np.inf, up(vertex.hi + outer))
    gap = inner > 0
    beyond_left = gap & (x.lo > up(vertex.hi - inner))
    beyond_right = gap & (x.hi < down(vertex.lo + inner))
    new_lo = np.where(beyond_left, np.maximum(new_lo, down(vertex.lo + inner)), new_lo)
    new_hi = np.where(beyond_right, np.minimum(new_hi, up(vertex.hi - inner)), new_hi)
    np.maximum.at(lo, variable, new_lo)
    np.minimum.at(hi, variable, new_hi)


def _tighten_monomials(
    lo: NDArray[Any], hi: NDArray[Any], rows: Rows, ranges: Interval, allowed: Interval
) -> None:
    """Solve coefficient * product of powers in ``allowed`` for each factor."""
    slots = rows._slots
    ahead = [Interval.point(rows.system.coefficients[rows._quadratic[4]])]
    for slot in range(len(slots) - 1):
        ahead.append(ahead[-1] * ranges[:, slot])
    behind: Interval | None = None
    for slot in reversed(range(len(slots))):
        real, power, variable = slots[slot]
        if real.size:
            others = (ahead[slot] if behind is None else ahead[slot] * behind)[real]
            x = Interval(lo[variable], hi[variable])
            wanted = _root(_quotient(allowed[real], others), power, x)
            np.maximum.at(lo, variable, wanted.lo)
            np.minimum.at(hi, variable, wanted.hi)
        if slot:
            behind = ranges[:, slot] if behind is None else behind * ranges[:, slot]


def _quotient(target: Interval, divisor: Interval) -> Interval:
    """Hull of all q with q * d in ``target`` for some d in ``divisor``."""
    with np.errstate(divide="ignore", over="ignore", under="ignore", invalid="ignore"):
        low, high = down(1.0 / divisor.hi), up(1.0 / divisor.lo)
    zero = (divisor.lo <= 0) & (divisor.hi >= 0)
    if not np.count_nonzero(zero):
        return target * Interval(low, high)
    both = (target.lo <= 0) & (target.hi >= 0) & zero
    straddles = (divisor.lo < 0) & (divisor.hi > 0)
    nothing = (divisor.lo == 0) & (divisor.hi == 0) & ~both
    whole = both | straddles | nothing
    low, high = np.where(divisor.hi == 0, -np.inf, low), np.where(divisor.lo == 0, np.inf, high)
    quotient = target * Interval(np.where(whole, 0.0, low), np.where(whole, 0.0, high))
    return Interval(np.where(whole, -np.inf, quotient.lo), np.where(whole, np.inf, quotient.hi))


def _root(value: Interval, power: NDArray[Any], x: Interval) -> Interval:
    """Hull of the z in x with z^power in ``value``."""
    higher = power > 1
    count = np.count_nonzero(higher)
    if not count:
        return value
    if count < higher.size:
        root = _root(value[higher], power[higher], x[higher])
        lo, hi = value.lo.copy(), value.hi.copy()
        lo[higher], hi[higher] = root.lo, root.hi
        return Interval(lo, hi)
    even = power % 2 == 0
    far = _outer_root(np.maximum(np.abs(value.lo), np.abs(value.hi)), power)
    high = _outer_root(np.abs(value.hi), power)
    low = _outer_root(np.abs(value.lo), power)
    near = _inner_root(np.maximum(value.lo, 0.0), power)
    odd_lo = np.where(value.lo < 0, -low, near)
    odd_hi = np.where(value.hi > 0, high, -_inner_root(np.abs(value.hi), power))
    empty = even & (value.hi < 0)
    even_lo = np.where(x.lo > -near, near, -far)
    even_hi = np.where(x.hi < near, -near, far)
    even_lo, even_hi = np.where(near > 0, even_lo, -high), np.where(near > 0, even_hi, high)
    lo = np.where(even, np.where(empty, np.inf, even_lo), odd_lo)
    hi = np.where(even, np.where(empty, -np.inf, even_hi), odd_hi)
    return Interval(lo, hi)


def _outer_root(value: NDArray[Any], power: NDArray[Any]) -> NDArray[np.float64]:
    """Upper bounds of value^(1/power) for value >= 0, checked by multiplication."""
    return _checked_root(value, power, 1.0)


def _inner_root(value: NDArray[Any], power: NDArray[Any]) -> NDArray[np.float64]:
    """Lower bounds of value^(1/power) for value >= 0, checked by multiplication."""
    return _checked_root(value, power, -1.0)


def _checked_root(value: NDArray[Any], power: NDArray[Any], side: float) -> NDArray[np.float64]:
    with np.errstate(over="ignore", under="ignore"):
        root = value ** (1.0 / power) * (1.0 + side * 1e-15)
    back = Interval.point(root).power(power)
    holds = back.lo >= value if side > 0 else back.hi <= value
    fallback = np.where(side > 0, np.inf, 0.0)
    return np.where(holds | (value == 0), root, fallback)


def box_rows(problem: Problem, cutoff: float | None) -> Rows:
    """Collect the rows of propagation: constraints, and with a cutoff objective and squares.

    From f = constant + sum w r^2 and f <= value follows |r| <= sqrt((value - constant) / w), from a
    matrix G >= 0 that G_ii >= 0 and G_ij^2 <= G_ii G_jj.
    """
    high = [np.where(problem.equality, 0.0, np.inf)]
    low = [np.zeros(len(problem.constraints))]
    polynomials = [c.polynomial for c in problem.constraints]
    if cutoff is not None:
        polynomials.append(problem.objective)
        low.append(np.array([-np.inf]))
        high.append(np.array([cutoff]))
        constant = problem.squares_constant
        if constant is not None:
            room = max(0.0, float(np.nextafter(cutoff - constant, np.inf)))
            weights = np.array([w for w, _ in problem.squares if w > 0])
            radius = up(np.sqrt(up(room / weights)))
            polynomials += [r for w, r in problem.squares if w > 0]
            low.append(-radius)
            high.append(radius)
    diagonal, minors = problem.matrices.propagation()
    minors = minors + len(polynomials)
    polynomials += [p for c in problem.constraints for p in c.entries]
    low.append(np.where(diagonal, 0.0, -np.inf))
    high.append(np.full(diagonal.size, np.inf))
    system = PolynomialSystem.stack(polynomials, problem.dimension)
    return Rows(system, Interval(np.concatenate(low), np.concatenate(high)), minors)


def with_cutoff(problem: Problem, cutoff: float) -> tuple[PolynomialSystem, NDArray[np.bool_]]:
    """Append the row value - f >= 0 to the constraints, without rounding.

    Returns
    -------
    system : PolynomialSystem
    equality : (m + 1,) bool
    """
    rows, objective = problem.rows, problem.objective_row
    words = monomials.stack((rows.words, objective.words, np.zeros((1, 1), np.int32)))
    values = np.concatenate([rows.coefficients, -objective.coefficients, [cutoff]])
    index = np.concatenate([rows.row, np.full(objective.row.size + 1, rows.size)])
    system = PolynomialSystem(words, values, index, rows.size + 1, problem.dimension)
    return system, np.append(problem.equality, False)
