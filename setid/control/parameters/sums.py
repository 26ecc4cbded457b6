"""Sums of rows in which the noise is bounded only after it has been summed.

Bounded row by row, noise that several rows share is counted in each of them. In a sum of
rows with weights l, sample m of the noise has the coefficient c_m(x) = c0_m + C_m x, affine in the
parameters x, and the sum obeys abs(l'(Y + R x)) <= sum_m D_m abs(c_m(x)). Weights that whiten
the noise make its coefficients nearly 1 for one sample and 0 for the others; weights from the
duals of a linearised program are the best ones for the ends of each interval. Any weights give
rows that hold: nothing proved rests on how they were found.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import TypeVar

import numpy as np
import scipy.linalg as sla
import scipy.sparse as sps
from numpy.typing import NDArray

from setid.control.parameters.polytope import Polytope, box_of
from setid.control.parameters.rows import NoisyRows
from sparsepop_py.budget import LimitReached
from sparsepop_py.lp.highs import LinearModel, LinearSolution
from sparsepop_py.lp.scaled import solve_scaled

__all__ = [
    "Frame",
    "Sums",
    "best_fit",
    "cover_by_sums",
    "first_box",
    "in_time",
    "least_noise_fit",
    "return_factor",
    "rows_on_box",
    "sums_of",
    "within_doubles",
]

Reals = NDArray[np.float64]
T = TypeVar("T")
_EPS = 2.0**-52
_MOST_WHITE = 300  # whitened rows
_ROUNDS = 25  # of shrinking the box
_GAIN = 0.98  # of the widths: less is not worth another round
_STEPS = 40  # Gauss-Newton
_PROGRAMS = 5  # of a fit with the least largest noise
_HUGE = 1e50  # of parameters that are tried
_UNITS = (1e-100, 1e100)  # of noise, in which axes and their products are doubles
_HALVINGS = 6  # of a step that makes the fit worse


def within_doubles(compute: Callable[[], T]) -> T | None:
    """Compute something; None where a number on the way leaves the doubles.

    Examples
    --------
    >>> float(within_doubles(lambda: np.float64(1e200) * 1e100))
    1e+300
    >>> within_doubles(lambda: np.float64(1e200) * 1e200) is None
    True
    """
    try:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            return compute()
    except (FloatingPointError, np.linalg.LinAlgError):
        return None


def in_time(until: float) -> None:
    """Raise ``LimitReached`` after a reading of ``time.monotonic``.

    What a proof rests on is made whole or not at all: the check of the proof has no clock, and is
    to make it again.
    """
    if time.monotonic() >= until:
        raise LimitReached


def _doubles(values: Reals) -> Reals:
    """Return values, all of them finite: products of sparse matrices overflow in silence."""
    if not np.all(np.isfinite(values)):
        raise FloatingPointError("overflow")
    return values


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """Coordinates z of the parameters x = origin + axes z, in which errors are of one size.

    Parameters
    ----------
    origin, axes : (q,), (q, q) float
    """

    origin: Reals
    axes: Reals

    def box_around(self, lower: Reals, upper: Reals) -> Polytope | None:
        """Enclose a box of x in z; None where the axes are nearly dependent.

        With W about the inverse of the axes, z = W (x - origin) + (I - W axes) z.
        """
        inverse, q = np.linalg.pinv(self.axes), self.origin.size
        size = np.abs(inverse) @ np.abs(self.axes)
        rest = np.abs(np.eye(q) - inverse @ self.axes) + 4 * (q + 4) * _EPS * (size + 1.0)
        reach = np.maximum(np.abs(lower - self.origin), np.abs(upper - self.origin))
        most = (np.abs(inverse) @ reach) * (1.0 + 1e-12) + 1e-300
        if not np.all(np.isfinite(most)) or not rest.sum(axis=1).max() < 0.5:
            return None
        most = (most + rest.sum(axis=1) * 2.0 * most.max()) * (1.0 + 1e-12)
        slack = 8 * (q + 4) * _EPS * (np.abs(self.axes) @ most + reach + np.abs(self.origin))
        rows = np.concatenate([self.axes, -self.axes])
        right = np.concatenate([upper - self.origin + slack, self.origin - lower + slack])
        return Polytope(-most, most, rows, right)


@dataclass(frozen=True, slots=True, eq=False)
class Sums:
    """Sums of rows: target + regressors z = sum_m (noise + sum_j z_j slopes_j)_m w_m.

    Parameters
    ----------
    target, regressors : (S,), (S, q) float
    noise, slopes : (S, M), (q, S, M) float
    bound : (M,) float
    target_loss, regressor_loss : (S,), (S, q) float
        Bounds of the rounding errors of target and regressors.
    noise_loss, slope_loss : (S,), (q, S) float
        The same, summed over the noise samples with their bounds.
    """

    target: Reals
    regressors: Reals
    noise: Reals
    slopes: Reals
    bound: Reals
    target_loss: Reals
    regressor_loss: Reals
    noise_loss: Reals
    slope_loss: Reals


def sums_of(rows: NoisyRows, weights: Reals, frame: Frame) -> Sums:
    """Sum rows with weights (S, R), in the coordinates of a frame.

    Parameters
    ----------
    rows : NoisyRows
    weights : (S, R) float
        Any numbers.
    frame : Frame
    """
    unit, size = 4 * (weights.shape[1] + frame.origin.size + 8) * _EPS, np.abs(weights)
    x0, axes = frame.origin, frame.axes
    regressors = weights @ rows.regressors
    slopes = np.stack([np.asarray(weights @ slope) for slope in rows.slopes])
    regressor_size = size @ rows.regressor_size
    slope_size = np.stack([np.asarray(size @ abs(s)) @ rows.bound for s in rows.slopes])
    noise_size = np.asarray(size @ abs(rows.noise)) @ rows.bound
    return Sums(
        weights @ rows.target + regressors @ x0,
        regressors @ axes,
        np.asarray(weights @ rows.noise) + np.tensordot(x0, slopes, axes=1),
        np.tensordot(axes.T, slopes, axes=1),
        rows.bound,
        unit * (size @ rows.target_size + regressor_size @ np.abs(x0)),
        unit * (regressor_size @ np.abs(axes)),
        unit * (noise_size + np.abs(x0) @ slope_size),
        unit * (np.abs(axes).T @ slope_size),
    )


# ---- an estimate ------------------------------------------------------------------------


def best_fit(rows: NoisyRows) -> Frame:
    """Fit parameters with least squares of the noise; find the axes of their errors.

    Gauss-Newton on min sum (w / bound)^2 subject to the rows, from least squares.

    References
    ----------
    B. De Moor, "Structured total least squares and L2 approximation problems", Linear
    Algebra and its Applications 188 (1993) 163-207.
    """
    begin = np.linalg.lstsq(rows.regressors, -rows.target, rcond=None)[0]
    best = np.asarray(begin, np.float64)
    least, step, _ = _newton(rows, best)
    for _ in range(_STEPS):
        for _ in range(_HALVINGS):
            cost, following = _tried(rows, best + step)
            if cost < least:
                break
            step = 0.5 * step
        if not cost < least:
            break
        small = np.abs(step).max(initial=0.0) <= 1e-9 * (1.0 + np.abs(best).max(initial=0.0))
        best, least, step = best + step, cost, following
        if small:
            break
    return Frame(best, _axes(rows, best))


def least_noise_fit(rows: NoisyRows, x: Reals) -> Reals:
    """Fit parameters (q,) of least largest noise sample, from a start, by linear programs.

    Each program takes the rows linearised at the noise of the last one (computed, not proved).
    """
    count = rows.bound.size
    cost = np.concatenate([np.zeros(x.size + count), [1.0]])
    for _ in range(_PROGRAMS):
        noise = _residual_noise(rows, x)
        moved = np.stack([slope @ noise for slope in rows.slopes], axis=1)
        shape = rows.shape_of_noise(x) * rows.relative[None, :]
        columns = [sps.csr_array(rows.regressors - moved), -shape]
        equal = sps.hstack([*columns, sps.csr_array((rows.target.size, 1))]).tocsr()
        eye, one = sps.eye_array(count), sps.csr_array(np.ones((count, 1)))
        blank = sps.csr_array((count, x.size))
        below = sps.vstack([sps.hstack([blank, s * eye, -one]) for s in (1.0, -1.0)]).tocsr()
        residual = rows.target + rows.regressors @ x
        free = np.full(x.size + count, inf)
        ends = np.append(-free, 0.0), np.append(free, inf)
        found = solve_scaled(cost, (below, np.zeros(2 * count)), (equal, -residual), ends)
        if found.status != "solved":
            break
        x = x + found.x[: x.size]
    return x


def _tried(rows: NoisyRows, x: Reals) -> tuple[float, Reals]:
    """Cost and step at a point; an infinite cost where numbers overflow."""
    if np.all(np.abs(x) < _HUGE):
        try:
            with np.errstate(all="ignore"):
                cost, step, _ = _newton(rows, x)
        except (np.linalg.LinAlgError, FloatingPointError):  # numbers that overflow
            return np.inf, x
        if np.isfinite(cost) and np.all(np.isfinite(step)):
            return cost, step
    return np.inf, x


def _axes(rows: NoisyRows, x: Reals) -> Reals:
    """Principal axes of the errors of a least-squares fit, each of the size of its deviation."""
    metric = _newton(rows, x)[2]
    noise = _residual_noise(rows, x)
    clean = rows.regressors - np.stack([slope @ noise for slope in rows.slopes], axis=1)
    values, vectors = np.linalg.eigh(_doubles(metric @ clean))
    if not values[-1] > 0.0:  # signals so small that their squares vanish say nothing of errors
        return np.eye(x.size)
    unit = float(np.clip(rows.largest, *_UNITS))
    return np.asarray(vectors * unit / np.sqrt(np.maximum(values, 1e-12 * values[-1])), np.float64)


def _residual_noise(rows: NoisyRows, x: Reals) -> Reals:
    """Noise (M,) of least squares that explains the rows at x."""
    residual = rows.target + rows.regressors @ x
    dual = sla.cho_solve_banded((_whitening(rows, x), True), _doubles(residual))
    return np.asarray(rows.relative**2 * (rows.shape_of_noise(x).T @ dual), np.float64)


def _newton(rows: NoisyRows, x: Reals) -> tuple[float, Reals, Reals]:
    """Cost, step, and the transposed cleaned regressors in the metric of the noise."""
    factor = _whitening(rows, x)
    residual = rows.target + rows.regressors @ x
    white = _below(factor, residual)
    shape = rows.shape_of_noise(x)
    dual = _above(factor, white)
    noise = rows.relative**2 * (shape.T @ dual)
    moved = [slope @ noise for slope in rows.slopes]
    clean = rows.regressors - np.stack(moved, axis=1) if moved else rows.regressors
    inside = _below(factor, clean)
    step = np.linalg.lstsq(_doubles(inside), -_doubles(white), rcond=1e-13)[0]
    metric = _above(factor, inside).T
    return float(white @ white), np.asarray(step, np.float64), metric


def _whitening(rows: NoisyRows, x: Reals) -> Reals:
    """Cholesky factor of the noise's covariance at x, a little lifted, by diagonals (b + 1, R).

    Noise samples occur in neighbouring rows only, so that the covariance has few diagonals.
    """
    shape = rows.shape_of_noise(x) * rows.relative[None, :]
    covariance = sps.coo_array(shape @ shape.T)
    lower = covariance.row - covariance.col
    kept = lower >= 0
    bands = np.zeros((int(lower.max(initial=0)) + 1, covariance.shape[0]))
    bands[lower[kept], covariance.col[kept]] = covariance.data[kept]
    mean = float(_doubles(bands)[0].mean())
    bands[0] += 1e-10 * mean if mean > 0.0 else 1.0  # without noise all rows weigh the same
    return np.asarray(sla.cholesky_banded(bands, lower=True), np.float64)


def _below(factor: Reals, right: Reals) -> Reals:
    """Solve L z = right for a factor L that is given by its diagonals."""
    return np.asarray(sla.solve_banded((len(factor) - 1, 0), factor, _doubles(right)), np.float64)


def _above(factor: Reals, right: Reals) -> Reals:
    """Solve L' z = right for a factor L that is given by its diagonals."""
    size = factor.shape[1]
    upper = np.zeros_like(factor)
    for lag, diagonal in enumerate(factor):
        upper[len(factor) - 1 - lag, lag:] = diagonal[: size - lag]
    return np.asarray(sla.solve_banded((0, len(factor) - 1), upper, _doubles(right)), np.float64)


# ---- boxes ------------------------------------------------------------------------------


def first_box(
    rows: NoisyRows, frame: Frame, until: float = inf, best: bool = True
) -> Polytope | None:
    """Find a box from a left inverse of the rows.

    It follows from abs(z - z0) <= d + G abs(z - z0); d has the noise summed first.

    Parameters
    ----------
    rows : NoisyRows
    frame : Frame
    until : float
        Reading of ``time.monotonic`` that ends it by ``LimitReached``.
    best : bool
        Whether linear programs look for the left inverse, where the first one gives no box.

    Returns
    -------
    Polytope or None
        In z; contains every consistent one. None where the noise is too strong.
    """
    metric = frame.axes.T @ _newton(rows, frame.origin)[2]
    inverse = np.linalg.pinv(_doubles(metric @ rows.regressors @ frame.axes)) @ metric
    found = _contraction(rows, frame, inverse)
    if found is not None or not best:
        return found
    return _contraction(rows, frame, _least_noise_inverse(rows, frame, until))


def _least_noise_inverse(rows: NoisyRows, frame: Frame, until: float) -> Reals | None:
    """Left inverse (q, R) whose rows sum the least noise, by linear programs.

    The duals of max z_i subject to regressors z = noise: the least sum_m D_m abs(c_m).
    """
    x, count = frame.origin, rows.bound.size
    scaled = rows.shape_of_noise(x) * rows.relative[None, :]
    matrix = sps.hstack([sps.csr_array(rows.regressors @ frame.axes), -scaled]).tocsr()
    zero = np.zeros(rows.target.size)
    ends = np.append(np.full(x.size, inf), np.ones(count))
    program = LinearModel(matrix, (zero, zero), (-ends, ends))
    found = []
    for i in range(x.size):
        cost = np.zeros(x.size + count)
        cost[i] = 1.0
        result = _solved(program, cost, until)
        if result.status != "solved":
            return None
        found.append(result.dual)
    return np.array(found)


def return_factor(rows: NoisyRows, frame: Frame) -> float:
    """Compute the spectral radius of G that :func:`first_box` multiplies abs(z - z0) by.

    A box follows where it is below 1.

    Parameters
    ----------
    rows : NoisyRows
    frame : Frame
    """
    metric = frame.axes.T @ _newton(rows, frame.origin)[2]
    inverse = np.linalg.pinv(_doubles(metric @ rows.regressors @ frame.axes)) @ metric
    coupling = _coupling(sums_of(rows, inverse, frame))
    return float(np.abs(np.linalg.eigvals(coupling)).max())


def _coupling(sums: Sums) -> Reals:
    """By how much sums of rows let the parameters depend on each other, (q, q)."""
    loose = np.abs(sums.slopes) @ sums.bound + sums.slope_loss
    rest = np.abs(np.eye(len(loose)) - sums.regressors) + sums.regressor_loss + 8 * _EPS
    return np.asarray((rest + loose.T) * (1.0 + 1e-12), np.float64)


def _contraction(rows: NoisyRows, frame: Frame, inverse: Reals | None) -> Polytope | None:
    """The box of one left inverse, None where it is no contraction."""
    if inverse is None or not np.all(np.isfinite(inverse)):
        return None
    q = frame.origin.size
    sums = sums_of(rows, inverse, frame)
    z0 = -sums.target
    if not np.all(np.isfinite(z0)):
        return None
    away = np.abs(sums.target + sums.regressors @ z0) + sums.target_loss
    away = away + sums.regressor_loss @ np.abs(z0) + 8 * _EPS * (q + 4) * np.abs(z0)
    shape = np.abs(sums.noise + np.tensordot(z0, sums.slopes, axes=1)) @ sums.bound
    loss = sums.noise_loss + np.abs(z0) @ sums.slope_loss
    drive = (away + shape + loss) * (1.0 + 1e-12)
    coupling = _coupling(sums)
    if not np.all(np.isfinite(coupling)) or np.abs(np.linalg.eigvals(coupling)).max() > 0.999:
        return None
    radius = np.linalg.solve(np.eye(q) - coupling, drive) * 1.001 + 1e-300
    reached = (coupling @ radius + drive) * (1.0 + 1e-12)
    if not (np.all(radius > 0) and np.all(reached < radius)):
        return None
    return box_of(np.nextafter(z0 - radius, -np.inf), np.nextafter(z0 + radius, np.inf))


def cover_by_sums(
    rows: NoisyRows,
    box: Polytope,
    frame: Frame,
    fit: Reals | None = None,
    rounds: int = _ROUNDS,
    until: float = inf,
    best: bool = True,
) -> Polytope:
    """Shrink a box by linear programs over sums of rows.

    Parameters
    ----------
    rows : NoisyRows
    box : Polytope
        Contains every consistent x; its rows are kept.
    frame : Frame
        The coordinates.
    fit : (q,) float, optional
        What the weights are made for; the origin of the frame when left out.
    rounds : int
        At most.
    until : float
        Reading of ``time.monotonic`` that ends it by ``LimitReached``.
    best : bool
        Whether linear programs look for weights, without ``fit``.

    Returns
    -------
    Polytope
        Contains every consistent x as well. Its box may be crossed: then none is consistent.
    """
    around = frame if fit is None else Frame(fit, frame.axes)
    sums = sums_of(rows, _weights(rows, around, best and fit is None, until), frame)
    eye = np.eye(frame.origin.size)
    for _ in range(rounds):
        in_time(until)
        cover = box.with_rows(*rows_on_box(sums, box))
        if cover.proved_empty():
            return Polytope(box.upper + 1.0, box.lower - 1.0, box.matrix, box.right)
        low, high = cover.ranges(eye)
        smaller = cover.essential().within(low, high)
        if np.any(smaller.lower > smaller.upper):
            return smaller
        shrunk = np.any(smaller.upper - smaller.lower < _GAIN * (box.upper - box.lower))
        box = smaller
        if not shrunk:
            break
    return _cutting(box.with_rows(*rows_on_box(sums, box)))


def _cutting(cover: Polytope) -> Polytope:
    """Without the rows that hold all over the box."""
    most = np.maximum(cover.matrix * cover.lower, cover.matrix * cover.upper).sum(axis=1)
    cuts = most > cover.right
    return Polytope(cover.lower, cover.upper, cover.matrix[cuts], cover.right[cuts])


def rows_on_box(sums: Sums, box: Polytope) -> tuple[Reals, Reals]:
    """Write linear rows matrix x <= right that hold for consistent x in a box.

    abs(c_m(x)) is affine where its sign is known on the box, and below its chord elsewhere.

    Parameters
    ----------
    sums : Sums
    box : Polytope
    """
    centre, radius = box.centre, np.nextafter(box.upper - box.centre, np.inf)
    radius = np.maximum(radius, np.nextafter(box.centre - box.lower, np.inf))
    middle = sums.noise + np.tensordot(centre, sums.slopes, axes=1)
    reach = np.tensordot(radius, np.abs(sums.slopes), axes=1)
    reach = reach * (1.0 + 1e-12) + 1e-300
    low, high = middle - reach, middle + reach
    mixed, span = (low < 0) & (high > 0), np.maximum(high - low, 1e-300)
    slope = np.where(mixed, (high + low) / span, np.where(low >= 0, 1.0, -1.0))
    level = np.where(mixed, -2.0 * low * (high / span), 0.0)
    level = level + np.where(mixed, 1e-14 * span, 0.0)
    # sum_m D_m (slope c_m(x) + level), with c_m(x) = middle + slopes (x - centre)
    weight = slope * sums.bound
    constant = (weight * middle).sum(axis=1) + level @ sums.bound
    linear = np.einsum("sm,jsm->sj", weight, sums.slopes)
    size = np.maximum(np.abs(box.lower), np.abs(box.upper))
    spread = (np.abs(middle) + reach) @ sums.bound
    unit = 8 * (sums.bound.size + centre.size + 8) * _EPS
    loss = sums.noise_loss + size @ sums.slope_loss + sums.target_loss
    loss = loss + sums.regressor_loss @ size + unit * (spread + np.abs(linear) @ size)
    loss = loss + unit * (np.abs(sums.target) + np.abs(sums.regressors) @ size)
    # +-(target + regressors x) <= constant + linear (x - centre)
    right = constant - linear @ centre + loss
    matrix = np.concatenate([sums.regressors - linear, -sums.regressors - linear])
    return matrix, np.concatenate([right - sums.target, right + sums.target])


# ---- weights ----------------------------------------------------------------------------


def _weights(rows: NoisyRows, frame: Frame, best: bool, until: float) -> Reals:
    """Rows as they are, whitened rows, a left inverse, and the best ones for each end.

    Where numbers overflow, rows as they are remain; whatever the weights, what sums prove holds.
    """
    count = rows.target.size
    kept = np.unique(np.linspace(0, count - 1, min(count, _MOST_WHITE)).astype(int))
    plain = np.zeros((kept.size, count))
    plain[np.arange(kept.size), kept] = 1.0
    parts = [plain]
    try:
        factor = _whitening(rows, frame.origin)
        parts += [_above(factor, plain.T).T, frame.axes.T @ _newton(rows, frame.origin)[2]]
        parts += [_best(rows, frame, until)] if best else []
    except (np.linalg.LinAlgError, ValueError):  # numbers that overflow
        pass
    found = np.concatenate(parts)
    size = np.abs(found).max(axis=1, keepdims=True)
    found = found / np.where(size > 0, size, 1.0)
    return np.asarray(found[np.all(np.isfinite(found), axis=1)], np.float64)


def _best(rows: NoisyRows, frame: Frame, until: float) -> Reals:
    """Duals of max +-x_i and +-z_i subject to the rows linearised at the origin."""
    x = frame.origin
    residual = rows.target + rows.regressors @ x
    noise = _residual_noise(rows, x)
    moved = [slope @ noise for slope in rows.slopes]
    clean = (rows.regressors - np.stack(moved, axis=1)) @ frame.axes
    q, count = x.size, rows.bound.size
    scaled = rows.shape_of_noise(x) * rows.bound[None, :]
    matrix = sps.hstack([sps.csr_array(clean), -scaled]).tocsr()
    ends = np.append(np.full(q, inf), np.ones(count))
    program = LinearModel(matrix, (-residual, -residual), (-ends, ends))
    found = []
    for goal in np.concatenate([np.eye(q), -np.eye(q), frame.axes, -frame.axes]):
        cost = np.concatenate([goal / np.abs(goal).max(), np.zeros(count)])
        result = _solved(program, cost, until)
        if result.status == "solved":
            found.append(result.dual)
    return np.reshape(found, (-1, rows.target.size))


def _solved(program: LinearModel, cost: Reals, until: float) -> LinearSolution:
    """Solve a linear program; ``LimitReached`` where time ends it."""
    in_time(until)
    found = program.solve(cost, None if until == inf else until - time.monotonic())
    if found.status == "stopped":
        raise LimitReached
    return found
