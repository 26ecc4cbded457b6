"""Local searches from several starts, and proofs for the best points.

A search ends early at a value that needs no improvement, so that a relaxation that is tight
asks for one search from its moments.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Constraint, Kind
from sparsepop_py.local_search.feasibility import prove_feasible
from sparsepop_py.local_search.matrix_rows import RowForm
from sparsepop_py.local_search.own_units import in_own_units, largest_violation
from sparsepop_py.local_search.slp import sequential_search
from sparsepop_py.local_search.solvers import DENSE_LIMIT, local_search
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.shapes import Products
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.points.feasible_point import ProvedPoint

__all__ = ["Aim", "best_attained", "starting_points"]

_FEW = 40  # variables up to which SLSQP may follow where sequential programs failed on a star
_CREEPING = 1e-4  # relative: smaller gains in ten steps are left to other methods that are tried
_SMALL = 12  # variables up to which several methods are tried from each start
_AGAIN = 1e-7  # of the incumbent's value: a search that ends this near has led to it again
_CLOSE = 0.02  # of that value: a bound this near says that the incumbent is hardly beaten
_SAME = 1e-9  # difference from a vector near which a point was proved: another proof says no more
_FAR = 1e12  # points farther away than this and than all bounds are no candidates
_PROOFS = 12  # vectors at most that a proof is tried for, the best ones
_ENOUGH = 5  # searches that end at the best value before the rest is left out,
_NEAR = 1e-5  # relative: about the best value
_WIDE = 50.0  # half the width from which the random points of a box say little about its middle
_STARTS = 3  # from at least so many starts


def starting_points(
    problem: Problem, box: Interval, count: int, seed: int
) -> list[NDArray[np.float64]]:
    """Choose the middle of a box and random points in it as starts.

    The middle is 0 or a bound where the box is unbounded; there, points spread over three scales:
    2, 10 and 50, and so does every other point of a wide box. In very many variables, in wide
    boxes and of many squares, random points lead to poor minima; there the vectors of all 1 and all
    -1 come before them.

    Parameters
    ----------
    problem : Problem
    box : Interval
    count : int
        Number of random points.
    seed : int

    Returns
    -------
    list of (n,) float
    """
    rng = np.random.default_rng(seed)
    points = []
    half = 0.5 * box.hi - 0.5 * box.lo
    wide, near = np.isfinite(half) & (half > _WIDE), 0.5 * np.clip(0.0, box.lo, box.hi)
    for number in range(count + 1):
        size = (2.0, 10.0, 50.0)[number % 3]
        from_high = np.where(np.isfinite(box.hi), box.hi - 2 * size, -size)
        from_low = np.where(np.isfinite(box.lo), box.lo + 2 * size, size)
        low = np.where(np.isfinite(box.lo), box.lo, from_high)
        high = np.where(np.isfinite(box.hi), box.hi, from_low)
        low, high = 0.5 * low, 0.5 * high  # widths may be beyond all doubles
        if number % 2:
            low = np.where(wide, np.maximum(low, near - 0.5 * size), low)
            high = np.where(wide, np.minimum(high, near + 0.5 * size), high)
        points.append(2.0 * rng.uniform(low, high) if number else low + high)
    many = problem.dimension > DENSE_LIMIT or bool(wide.any())
    if (many or problem.squares) and not problem.constraints:
        both = (np.full(problem.dimension, v) for v in (1.0, -1.0))
        points[1:1] = [np.clip(x, box.lo, box.hi) for x in both]
    return points


def _decide(problem: Problem, x: NDArray[np.float64]) -> Problem:
    """Fix variables by the start in rows of two alternatives.

    They are a x_i x_j == 0 and x_i^2 == c x_i. Local searches stall on such rows, whose gradients
    vanish or contradict each other.
    """
    lower, upper = problem.lower.copy(), problem.upper.copy()
    decided = False
    for constraint in problem.constraints:
        p = constraint.polynomial
        if constraint.kind is not Kind.ZERO or p.degree != 2 or p.terms > 2:
            continue
        letters = p.words[-1][-2:] - 1
        if p.terms == 1 and letters[0] >= 0:
            chosen = letters[np.argmin(np.abs(x[letters]))]
            value = 0.0
        elif p.terms == 2 and letters[0] == letters[1] and p.words[0][-1] - 1 == letters[0]:
            chosen, root = letters[0], -p.coefficients[0] / p.coefficients[1]
            value = root if abs(x[chosen] - root) < abs(x[chosen]) else 0.0
        else:
            continue
        if lower[chosen] <= value <= upper[chosen]:
            lower[chosen] = upper[chosen] = value
            decided = True
    if not decided:
        return problem
    rest = [c for c in problem.constraints if not _settled(c, lower, upper)]
    return Problem(problem.objective, rest, lower, upper, problem.names)


def _settled(constraint: Constraint, lower: NDArray[Any], upper: NDArray[Any]) -> bool:
    """Check whether fixed variables make an equality hold, by zero factors or altogether."""
    p = constraint.polynomial
    if constraint.kind is not Kind.ZERO:
        return False
    fixed = lower == upper
    if np.all(fixed[p.support]):
        return abs(p(np.where(fixed, lower, 0.0))) == 0.0
    zero = np.append(False, fixed & (lower == 0.0))
    return bool(np.all(zero[p.words].any(axis=1)))


def _tries(
    rows: RowForm, start: NDArray[Any], tolerance: float, method: str | None, end: float
) -> Iterator[NDArray[np.float64]]:
    """Yield the start and the ends of local searches from it, the cheapest search first."""
    problem, start = rows.problem, rows.start(start)
    yield start
    if method == "prove":
        return
    # without an inequality there are no vertices for linear programs to end at
    corners = bool(
        np.any(np.isfinite([problem.lower, problem.upper])) or not problem.equality.all()
    )
    bilinear = problem.degree <= 2 and bool(problem.constraints) and corners and not rows.factored
    star = bilinear and Products.of(problem).has_star  # made for linear programs
    large = problem.dimension > (_FEW if star else DENSE_LIMIT)  # then the others are slow
    small = problem.dimension <= _SMALL
    branch = _decide(problem, start)
    failed = True

    def feasible(x: NDArray[Any]) -> bool:
        return largest_violation(rows.given, rows.point(x)) <= tolerance

    # vertices of linear programs satisfy equations better, and their existence is proved sooner
    first = small and branch is problem and not (bilinear and bool(problem.equality.any()))
    if first:
        yield local_search(problem, start, method, end)
    creeping = _CREEPING if small else 0.0
    if bilinear and method is None:
        x = local_search(problem, start, "sequential", end, creeping)
        failed = not feasible(x)
        yield x
    if branch is not problem:
        x = local_search(branch, start, method, end)
        yield x
        if small and feasible(x):
            return  # others would stall on what is decided here
    if not first and (small or (failed and not (bilinear and large))):
        x = local_search(problem, start, method, end)
        failed = failed and not feasible(x)
        yield x
    curved = corners and bool(problem.constraints) and not rows.factored and not bilinear
    if method is None and ((small and bilinear) or (failed and curved)):
        free = in_own_units(problem.sharpened)  # nothing held
        x = sequential_search(free.problem, start / free.units, end=end, creeping=creeping)
        yield free.units * x


@dataclass(frozen=True)
class Aim:
    """Purpose of a search from several starts.

    Parameters
    ----------
    tolerance : float
        Largest violation, in the user's units, of a vector that is kept.
    enough : float
        A value that needs no improvement, such as a proved bound with the allowed gap.
    any : bool
        Whether any local minimum will do.
    known : float
        The value of the incumbent, +inf without one.
    gain : float
        Least improvement of the value that is worth another proof.
    brief : bool
        Whether a start that leads back to the incumbent is left to no other method.
    """

    tolerance: float
    enough: float = -np.inf
    any: bool = False
    known: float = np.inf
    gain: float = 0.0
    brief: bool = False


def _candidates(
    rows: RowForm, start: NDArray[Any], aim: Aim, method: str | None, end: float
) -> list[tuple[float, NDArray[np.float64]]]:
    """List nearly feasible (value, vector) pairs that one start leads to."""
    kept: list[tuple[float, NDArray[np.float64]]] = []
    size = 1.0 + abs(aim.known)
    close = np.isfinite(size) and aim.known - aim.enough <= _CLOSE * size  # else others lead away
    accurate = not rows.given.equality.any()  # linear programs come first there, and end rough
    near = _AGAIN * size if (close or aim.brief) and accurate and np.isfinite(size) else -1.0
    for number, found in enumerate(_tries(rows, start, aim.tolerance, method, end)):
        ended = _rated(rows, [found], aim)
        kept += ended
        known = number > 1 and min((value for value, _ in kept), default=np.inf) <= aim.enough
        again = number > 0 and any(abs(value - aim.known) <= near for value, _ in ended)
        if known or again or (number and ended and aim.any):
            break
    return kept


def _rated(
    rows: RowForm, found: list[NDArray[Any]], aim: Aim
) -> list[tuple[float, NDArray[np.float64]]]:
    """Select the nearly feasible vectors, with their values."""
    kept = []
    ends = np.abs([rows.given.lower, rows.given.upper])
    far = max(_FAR, ends.max(initial=0.0, where=np.isfinite(ends)))
    for x in map(rows.point, found):
        if np.all(np.isfinite(x)) and np.abs(x).max(initial=0.0) <= far:
            with np.errstate(all="ignore"):
                value, violation = rows.given.objective(x), largest_violation(rows.given, x)
            if np.isfinite(value) and violation <= aim.tolerance:
                kept.append((value, x))
    return kept


def best_attained(
    problem: Problem,
    starts: Iterable[NDArray[np.float64]],
    aim: Aim,
    method: str | None = None,
    end: float = np.inf,
) -> tuple[ProvedPoint | None, list[NDArray[np.float64]]]:
    """Search from every start and prove the best points.

    Parameters
    ----------
    problem : Problem
    starts : iterable of (n,) float
        No more are taken from an iterator than the aim asks for.
    aim : Aim
    method : {None, "ipopt", "prove"}
        ``"prove"``: no search, the starts alone.
    end : float
        End on the monotonic clock; what was found until then is kept.

    Returns
    -------
    point : ProvedPoint or None
        The best proved point.
    vectors : list of (n,) float
        All nearly feasible vectors, by value.
    """
    found: list[tuple[float, NDArray[np.float64]]] = []
    best: ProvedPoint | None = None
    rows = RowForm.of(problem)
    reached: list[float] = []  # the best value that each start led to
    for start in starts:
        if time.monotonic() >= end:
            break
        ends = _candidates(rows, start, aim, method, end)
        found += ends
        reached.append(min((value for value, _ in ends), default=np.inf))
        best_value = min(reached)
        if reached[-1] <= aim.enough or (aim.any and ends):
            best = _best_proved(problem, ends, best, aim, end)
            if best is not None and (aim.any or best.value <= aim.enough):
                break
        about_best = best_value + _NEAR * (1.0 + abs(best_value))
        starts_there = sum(value <= about_best for value in reached)
        if starts_there >= _STARTS and sum(value <= about_best for value, _ in found) >= _ENOUGH:
            break
    found.sort(key=lambda entry: entry[0])
    if best is None or not (aim.any or best.value <= aim.enough):
        best = _best_proved(problem, found[:_PROOFS], best, aim, end)
    if best is not None and best.value > aim.enough > -np.inf and method is None:
        if _SMALL < problem.dimension <= _FEW and time.monotonic() < end:
            last = _rated(rows, [local_search(rows.problem, rows.start(best.x), None, end)], aim)
            found = last + found
            best = _best_proved(problem, last, best, aim, end)
    return best, [x for _, x in found]


def _best_proved(
    problem: Problem,
    found: list[tuple[float, NDArray[Any]]],
    best: ProvedPoint | None,
    aim: Aim,
    end: float,
) -> ProvedPoint | None:
    """Prove the best points in turn; keep the one known before if none is better.

    When time is over one proof is still tried: without any point no gap is known.
    """
    tried: list[NDArray[Any]] = []
    for number, (value, x) in enumerate(sorted(found, key=lambda entry: entry[0])):
        known = aim.known if best is None else min(best.value, aim.known)
        if value >= known - aim.gain or (number and time.monotonic() >= end):
            break
        if any(np.all(np.abs(x - other) <= _SAME * (1.0 + np.abs(x))) for other in tried):
            continue
        proved = prove_feasible(problem, x)
        if proved is not None:
            tried.append(x)
        if proved is not None and (best is None or proved.value < best.value):
            best = proved
    return best
