"""Repair nearly feasible vectors until a feasible point is proved to exist.

Candidates are the vector snapped to bounds and round numbers, then pulled off nearly active
inequalities by linear programs. The proof itself is
:func:`sparsepop_py.verified.points.feasible_point.prove_point`, which trusts nothing from here.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.budget import LimitReached, before_check, check
from sparsepop_py.local_search.own_units import in_own_units
from sparsepop_py.lp.highs import solve_lp
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.units import InUnits
from sparsepop_py.verified.points.feasible_point import ProvedPoint, prove_point

__all__ = ["prove_feasible"]

_SOME_ROWS = 20  # equations from which exact repair comes second
_MANY_ROWS = 60  # equations from which exact repair is not tried
_CORNER_ROWS = 120  # linear rows that are solved together, which are sparse, at most
_WORSE = 1e-8  # relative loss of objective that another candidate might avoid
_CUTS = 12  # linear programs at most that pull a point into a matrix
_MARGIN = 0.1  # of a depth: less is as good as none
_DENSE = 10_000  # entries of the largest Jacobian that is dense
_SECONDS_OF_PRODUCT = 2e-10  # at least, for one in a QR, which nothing stops
_ACTIVE = 1e-6  # closer than this (relative) to a bound or to a zero row counts as active


def prove_feasible(problem: Problem, x: NDArray[np.float64]) -> ProvedPoint | None:
    """Search a feasible point near ``x`` and prove that it exists.

    Parameters
    ----------
    problem : Problem
    x : (n,) float
        A nearly feasible vector, as a local search returns it.

    Returns
    -------
    ProvedPoint or None
        The first candidate that passes, or the second where the first costs objective;
        candidates further inside cost more.

    Examples
    --------
    >>> import numpy as np, sparsepop_py as sp
    >>> a, b = sp.variables(2)
    >>> circle = sp.Problem(a + b, [a**2 + b**2 == 1])
    >>> point = prove_feasible(circle, np.array([-0.7071, -0.7071]))
    >>> point.proof, point.radius < 1e-12
    ('krawczyk', True)
    """
    problem = problem.sharpened
    x = np.clip(np.asarray(x, float), problem.lower, problem.upper)
    return _proved(problem, x.tobytes()) if np.all(np.isfinite(x)) else None


@lru_cache(maxsize=8)  # searches begin with vectors that were tried, and end there
def _proved(problem: Problem, vector: bytes) -> ProvedPoint | None:
    x = np.frombuffer(vector)
    goal = problem.objective(x)
    goal += _WORSE * (1.0 + abs(goal))
    best: ProvedPoint | None = None
    tried: set[bytes] = set()
    scaled = in_own_units(problem)
    for candidate, pulled in _candidates(scaled.problem, x / scaled.units):
        check()
        if candidate.tobytes() in tried:
            continue
        tried.add(candidate.tobytes())
        proved = _first_proof(problem, scaled, candidate)
        if proved is None:
            continue
        if best is not None or pulled or proved.value <= goal:
            return proved if best is None or proved.value < best.value else best
        best = proved  # a round number that costs objective: one more is tried
    return best


def _first_proof(
    problem: Problem, scaled: InUnits, candidate: NDArray[np.float64]
) -> ProvedPoint | None:
    """Prove a point of a problem by the plans for it in other units."""
    for rows, solved, proof in _plans(scaled.problem, candidate):
        proved = prove_point(problem, candidate * scaled.units, rows, solved, proof)
        if proved is not None:
            return proved
    return None


def _candidates(problem: Problem, x: NDArray[Any]) -> Iterator[tuple[NDArray[np.float64], bool]]:
    """Yield x snapped to bounds and round numbers, then pulled further and further inside.

    Those that are pulled are marked: what follows them costs more.
    """
    size = 1.0 + np.abs(x)
    snapped = np.where(x - problem.lower <= _ACTIVE * size, problem.lower, x)
    snapped = np.where(problem.upper - x <= _ACTIVE * size, problem.upper, snapped)
    rounded: NDArray[np.float64] = np.round(snapped, 4).astype(float)
    inside = (rounded >= problem.lower) & (rounded <= problem.upper)
    rounded = np.where(inside & (np.abs(rounded - snapped) <= 1e-6 * size), rounded, snapped)
    yield rounded, False
    if np.any(rounded != snapped):
        yield snapped, False
    if len(problem.constraints):
        for depth in (1e-9, 1e-8, 1e-7, 1e-6, 1e-5):
            for start, loose in ((snapped, False), (x, False), (snapped, True)):
                pulled = _pull_inside(problem, start, depth, loose)
                if pulled is not None:
                    yield pulled, True


def _pull_inside(
    problem: Problem, x: NDArray[Any], depth: float, loose: bool
) -> NDArray[np.float64] | None:
    """Move by a linear program to where nearly active inequalities hold with a margin.

    maximise t, then minimise f' d, subject to the linearised rows h + h' d = 0,
    g + g' d >= t |g'| for nearly active g, bounds with a margin for variables off their
    bounds, and 0 <= t <= depth.
    Variables on a bound stay there unless ``loose``. A matrix enters by rows v' G v for
    eigenvectors v, more of them as long as the point that is reached has negative ones.
    """
    n = problem.dimension
    values, jacobian, size = _linearised(problem, x)
    reach = 1e2 * depth * (1.0 + np.abs(x))
    first, equal = problem.first_alike, problem.equations[size[problem.equations] > 0]
    close = ~np.isin(first, equal) & (values <= 1e3 * depth * (1.0 + size)) & (size > 0)
    at_low, at_high = x == problem.lower, x == problem.upper
    low = np.where(at_low | at_high, 0.0, np.maximum(-reach, problem.lower + depth - x))
    high = np.where(at_low | at_high, 0.0, np.minimum(reach, problem.upper - depth - x))
    if loose:
        low = np.where(at_high & ~at_low, -reach, low)
        high = np.where(at_low & ~at_high, reach, high)
    crossed = low > high
    low, high = np.where(crossed, 0.0, low), np.where(crossed, 0.0, high)
    active = np.flatnonzero(close)
    slopes, sizes, held = jacobian[active], size[active], values[active]
    slope = problem.objective_row.gradient(x)
    slope = slope / max(1e-300, np.abs(slope).sum())
    shares = 1e-3, 1e-1 * depth / reach.max(initial=depth)  # no loss outweighs the margin then
    moved = x
    has_matrices = bool(problem.matrices.constraints.size)
    for _ in range(_CUTS if has_matrices else 1):
        if has_matrices:
            value, row = problem.matrices.cuts(x, moved)
            length = np.sqrt(np.asarray(row.power(2).sum(axis=1)).ravel())
            tight = (value <= 1e3 * depth * (1.0 + length)) & (length > 0)
            slopes = sps.csr_array(sps.vstack([slopes, row[tight]]))
            sizes, held = np.append(sizes, length[tight]), np.append(held, value[tight])
        step = np.zeros(n + 1)
        for share in shares:
            found = solve_lp(
                np.append(share * slope, -1.0),
                (slopes, sizes, held),
                (jacobian[equal], -values[equal]),
                (np.append(low, 0.0), np.append(high, depth)),
            )
            if found is None:
                return None
            step = found
            if step[n] > _MARGIN * depth:
                break
        moved = np.clip(x + step[:n], problem.lower, problem.upper)
        if not has_matrices or problem.matrices.least_eigenvalue(moved[None])[0] >= 0:
            break
    return moved


def _linearised(
    problem: Problem, x: NDArray[Any]
) -> tuple[NDArray[np.float64], sps.csr_array | NDArray[np.float64], NDArray[np.float64]]:
    """Values of the rows, their Jacobian (dense where it is small) and its row norms."""
    values = problem.rows.values(x)
    if values.size * x.size > _DENSE or problem.matrices.constraints.size:
        sparse = problem.rows.jacobian(x)
        return values, sparse, np.sqrt(np.asarray(sparse.power(2).sum(axis=1)).ravel())
    dense = problem.rows.dense_jacobian(x)
    return values, dense, np.sqrt((dense * dense).sum(axis=1))


def _plans(problem: Problem, x: NDArray[Any]) -> Iterator[tuple[NDArray[Any], NDArray[Any], str]]:
    """Yield rows, the variables to solve them for, and the kind of proof."""
    equal = problem.equations
    if equal.size:
        yield from _of_equations(problem, x, equal)
    else:
        yield equal, equal, "exact"
    rows, solved = _corner(problem, x)
    if rows.size:
        yield rows, solved, "exact"


def _of_equations(
    problem: Problem, x: NDArray[Any], equal: NDArray[np.int64]
) -> Iterator[tuple[NDArray[Any], NDArray[Any], str]]:
    """Yield equalities, the variables to solve them for, and the kind of proof."""
    jacobian = problem.rows.take(equal).dense_jacobian(x)
    distance = np.minimum(x - problem.lower, problem.upper - x)
    weight = np.clip(distance, 0.0, 1.0)
    movable = np.any(jacobian * weight, axis=1)  # rows of variables on their bounds are checked
    equal, jacobian = equal[movable], jacobian[movable]
    if equal.size > _SOME_ROWS:  # rationals take longer, and so do their pivots
        solved = _leading_columns(jacobian * weight)
        if solved is not None:
            yield equal, solved, "krawczyk"
            if equal.size > _MANY_ROWS:
                return
    couplings = _couplings(problem.rows.take(equal))
    for blocked in (couplings, None):
        rows, solved = _pivots(jacobian, weight, blocked)
        proof = "krawczyk" if blocked is None else "exact"
        yield equal[rows], solved, proof


def _corner(problem: Problem, x: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Select linear rows that are zero at x, and variables to solve them for.

    Products of such rows are zero then without rounding (complementarity), which no box around
    a point can show.
    """
    degree = np.array([c.polynomial.degree for c in problem.constraints], np.int64)
    linear, nothing = degree == 1, np.zeros(0, np.int64)
    large = np.count_nonzero(linear) * x.size > 100 * _DENSE
    if large or not np.any(linear & ~problem.equality) or not _has_products(problem, x, ~linear):
        return nothing, nothing
    system = problem.rows.take(np.flatnonzero(linear))
    jacobian = system.dense_jacobian(x)
    size = 1.0 + np.sqrt((jacobian * jacobian).sum(axis=1))
    active = problem.equality[linear] | (np.abs(system.values(x)) <= _ACTIVE * size)
    weight = np.clip(np.minimum(x - problem.lower, problem.upper - x), 0.0, 1.0)
    rows, solved = _pivots(jacobian[active], weight, None)
    if not 0 < rows.size <= _CORNER_ROWS:
        return nothing, nothing
    return np.flatnonzero(linear)[active][rows], solved


def _has_products(problem: Problem, x: NDArray[Any], chosen: NDArray[np.bool_]) -> bool:
    """Check for equations among rows, or inequalities without constant that are zero at x."""
    if np.any(problem.equality & chosen):
        return True
    near = np.flatnonzero(chosen)
    near = near[np.abs(problem.rows.take(near).values(x)) <= _ACTIVE]
    return any(problem.constraints[k].polynomial.constant_term == 0 for k in near.tolist())


def _leading_columns(matrix: NDArray[Any]) -> NDArray[np.int64] | None:
    """Select as many columns as rows by QR with pivoting; None if rows depend."""
    if matrix.shape[0] * matrix.size * _SECONDS_OF_PRODUCT > before_check():
        raise LimitReached
    triangle, pivots = scipy.linalg.qr(matrix, mode="r", pivoting=True)
    m = matrix.shape[0]
    size = np.abs(np.diag(triangle))
    if size.size < m or size[-1] <= 1e-9 * max(size[0], 1e-300):
        return None
    return np.sort(pivots[:m]).astype(np.int64)


def _couplings(system: PolynomialSystem) -> set[tuple[int, int]]:
    """List pairs of variables that occur in one term (a variable with itself when squared)."""
    pairs = set()
    for letters in np.unique(system.words, axis=0):
        used = letters[letters > 0] - 1
        for position, a in enumerate(used):
            for b in used[position + 1 :]:
                pairs.add((int(a), int(b)))
    return pairs


def _pivots(
    jacobian: NDArray[Any], weight: NDArray[Any], blocked: set[tuple[int, int]] | None
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Select rows and columns of a well-conditioned square part, by full pivoting.

    Columns are weighted by their distance to the bounds; with ``blocked``, no two chosen
    columns may occur in one term, so that the rows are linear in them jointly.
    """
    matrix = jacobian * weight
    scale = np.abs(matrix).max(axis=1, initial=0.0)
    neighbours: dict[int, list[int]] = {}
    for a, b in blocked or ():
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
        if a == b:
            matrix[:, a] = 0.0
    rows, columns = [], []
    left, largest = np.ones(matrix.shape[0], bool), np.abs(matrix).max(axis=1, initial=0.0)
    for _ in range(min(matrix.shape)):
        row = int(np.argmax(np.where(left, largest, -1.0)))
        if largest[row] <= 1e-9 * max(1e-3, scale[row]):
            break
        column = int(np.argmax(np.abs(matrix[row])))
        pivot, left[row] = matrix[row] / matrix[row, column], False
        gone = [column, *neighbours.get(column, ())]
        touched = np.flatnonzero(left & matrix[:, gone].any(axis=1))  # rows are sparse
        matrix[touched] -= np.outer(matrix[touched, column], pivot)
        matrix[np.ix_(touched, gone)] = 0.0
        largest[touched] = np.abs(matrix[touched]).max(axis=1, initial=0.0)
        rows.append(row)
        columns.append(column)
    return np.array(rows, np.int64), np.array(columns, np.int64)
