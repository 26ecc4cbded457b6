"""Steps of the linear program of a cone, by numpy and LAPACK.

The notation is that of ``linear_programs.py``. The slacks u, v = sizes -+ filtered with their duals
a, b leave a step by the diagonal matrix a / u + b / v. The multipliers then have the banded matrix
F' diag(4 / (u / a + v / b)) F, where F filters. Flat multipliers have those of a row together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded
from scipy.linalg.lapack import dtbtrs

__all__ = [
    "Coupled",
    "Fixed",
    "Half",
    "Reduced",
    "Sized",
    "Totals",
    "advanced",
    "backward",
    "eliminated",
    "filtered_pairs",
    "forward",
    "paired_columns",
]

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]


class Fixed(NamedTuple):
    """Data that are the same in all steps.

    Parameters
    ----------
    w : (S,) float
        Noise bounds, of sum 1.
    target : float
    vectors : (K, K) float
    places : (K, K) int
        Number of the pair of two vectors.
    columns : (R K, m) float
        Right-hand sides: pairs, the sum of sizes, known columns. Zeros fill the rest.
    silent : (...,) int
        Numbers of multipliers among the R K that stay 0; columns are 0 there.
    """

    w: Reals
    target: float
    vectors: Reals
    places: Integers
    columns: Reals
    silent: Integers


class Sized(NamedTuple):
    """Sizes, what is below them, and the dual values of both sides; also changes of these.

    Parameters
    ----------
    sizes, filtered, above, below : (pairs, S) float
    """

    sizes: Reals
    filtered: Reals
    above: Reals
    below: Reals


class Coupled(NamedTuple):
    """Unknowns that are left where sizes and multipliers are eliminated.

    Parameters
    ----------
    weights : (pairs,) float
    dual_level : float
    """

    weights: Reals
    dual_level: float


class Reduced(NamedTuple):
    """A step's matrix without sizes, factored.

    Parameters
    ----------
    fine : bool
        False where it is as good as singular.
    total, skew : (pairs, S) float
        a / u + b / v, and a / u - b / v divided by it.
    factor : (..., ...) float
        Of the banded matrix of multipliers.
    columns : (R K, m) float
        Right-hand sides, solved by the lower factor.
    curve : (pairs,) float
        Sums of w^2 / total.
    inner : (m, m) float
        Products of the solved columns.
    loss : (R K,) float
        What multipliers have to gain by weights beside what the sides give.
    """

    fine: bool
    total: Reals
    skew: Reals
    factor: Reals
    columns: Reals
    curve: Reals
    inner: Reals
    loss: Reals


class Totals(NamedTuple):
    """Sums over the record.

    Parameters
    ----------
    sizes, noise : (pairs,) float
        Of w sizes and w abs(filtered).
    products : (m,) float
        Of the multipliers with the columns as they are in ``Fixed``.
    """

    sizes: Reals
    noise: Reals
    products: Reals


class Half(NamedTuple):
    """The right-hand side of a step, half solved.

    Parameters
    ----------
    first, second, size : (pairs, S) float
        What the sides and the sizes have to gain.
    moved : (pairs,) float
        Sums of w size / total.
    drive : (R K,) float
        Of the multipliers, solved by the lower factor.
    inner : (m,) float
        Products of ``drive`` with the solved columns.
    """

    first: Reals
    second: Reals
    size: Reals
    moved: Reals
    drive: Reals
    inner: Reals


def eliminated(at: Sized, weights: Reals, fixed: Fixed) -> Reduced:
    """Eliminate sizes, factor the matrix of multipliers, and solve for the columns beside it.

    Parameters
    ----------
    at : Sized
    weights : (pairs,) float
    fixed : Fixed
    """
    one, two = at.above / (at.sizes - at.filtered), at.below / (at.sizes + at.filtered)
    total = one + two
    skew = (one - two) / total
    w, target, pairs = fixed.w, fixed.target, weights.size
    curve = (w * w / total).sum(axis=1)
    loss = fixed.columns[:, :pairs] @ weights
    columns = fixed.columns.copy()
    band = _band(4.0 * one * two / total, fixed.vectors, fixed.places)
    _silence(band, fixed.silent)
    try:
        factor = cholesky_banded(band, lower=True, overwrite_ab=True, check_finite=True)
    except (np.linalg.LinAlgError, ValueError):
        inner = np.zeros((columns.shape[1], columns.shape[1]))
        return Reduced(False, total, skew, band, columns, curve, inner, loss)
    spread = paired_columns(w * skew, fixed.vectors)
    columns[:, :pairs] += target * spread.T
    columns[:, pairs] += spread.sum(axis=0)
    columns[fixed.silent] = 0.0
    columns = _substituted(factor, columns)
    inner = columns.T @ columns
    return Reduced(True, total, skew, factor, columns, curve, inner, loss)


def forward(
    aim: float, at: Sized, step: Sized, now: Coupled, fixed: Fixed, reduced: Reduced
) -> Half:
    """Solve for half of a direction in which products of slacks and duals become ``aim``.

    Parameters
    ----------
    aim : float
    at : Sized
    step : Sized
        A direction whose products of second order are taken off; zeros for none.
    now : Coupled
        Present values.
    fixed : Fixed
    reduced : Reduced
    """
    less, more = step.sizes - step.filtered, step.sizes + step.filtered
    first = (aim - less * step.above) / (at.sizes - at.filtered)
    second = (aim - more * step.below) / (at.sizes + at.filtered)
    pull = (fixed.target * now.weights[:, None] + now.dual_level) * fixed.w
    size = first + second - pull
    moved = (fixed.w * size / reduced.total).sum(axis=1)
    push = paired_columns(first - second - reduced.skew * size, fixed.vectors).sum(axis=0)
    push += reduced.loss
    push[fixed.silent] = 0.0
    drive = _substituted(reduced.factor, push)
    return Half(first, second, size, moved, drive, drive @ reduced.columns)


def backward(
    solved: Reals, half: Half, at: Sized, change: Coupled, fixed: Fixed, reduced: Reduced
) -> tuple[Reals, Sized, Reals, Reals]:
    """Solve for the other half of a direction.

    Parameters
    ----------
    solved : (m,) float
        Changes of what the columns belong to.
    half : Half
    at : Sized
    change : Coupled
    fixed : Fixed
    reduced : Reduced

    Returns
    -------
    multipliers : (K, R) float
    step : Sized
    least : (2,) float
        Least quotients of change and value, of slacks and of dual values; 0 where none is below.
    sums : (4,) float
        Of slack times dual, change times dual, slack times change, and change times change.
    """
    vectors, w = fixed.vectors, fixed.w
    right = half.drive + reduced.columns @ solved
    back = _substituted(reduced.factor, right, transposed=True)
    multipliers = -back.reshape(-1, len(vectors)).T
    filtered = filtered_pairs(multipliers, vectors, w.size)
    pull = (fixed.target * change.weights[:, None] + change.dual_level) * w
    sizes = (half.size - pull) / reduced.total + reduced.skew * filtered
    slacks = np.array([at.sizes - at.filtered, at.sizes + at.filtered])
    changes = np.array([sizes - filtered, sizes + filtered])
    duals = np.array([at.above, at.below])
    ratios = changes / slacks
    turns = np.array([half.first, half.second]) - duals - duals * ratios
    least = np.minimum(0.0, [ratios.min(), (turns / duals).min()])
    sums = np.array([np.vdot(x, y) for y in (duals, turns) for x in (slacks, changes)])
    return multipliers, Sized(sizes, filtered, turns[0], turns[1]), least, sums


def advanced(
    at: Sized, step: Sized, primal: float, dual: float, multipliers: Reals, fixed: Fixed
) -> tuple[Sized, Totals]:
    """Go a part of a direction, in sizes and in their dual values.

    Parameters
    ----------
    at, step : Sized
    primal, dual : float
    multipliers : (K, R) float
        After the step.
    fixed : Fixed
    """
    found = Sized(
        at.sizes + primal * step.sizes,
        at.filtered + primal * step.filtered,
        at.above + dual * step.above,
        at.below + dual * step.below,
    )
    noise = np.abs(found.filtered) @ fixed.w
    return found, Totals(found.sizes @ fixed.w, noise, multipliers.T.ravel() @ fixed.columns)


def paired_columns(filtered: Reals, vectors: Reals) -> Reals:
    """Transpose the filters pair by pair, from (pairs, S) to (pairs, R K)."""
    size, back = len(vectors), _windows(filtered, len(vectors))
    every, (one, two) = np.arange(len(filtered)), np.triu_indices(size)
    found = np.zeros((len(filtered), back.shape[2], size))
    found[every, :, two] += np.einsum("pi,ipr->pr", vectors[one], back)
    found[every, :, one] += np.einsum("pi,ipr->pr", vectors[two], back)
    return found.reshape(len(filtered), -1)


def filtered_pairs(multipliers: Reals, vectors: Reals, samples: int) -> Reals:
    """Filter multipliers (K, R) by the vectors (K, n + 1), pair by pair, (pairs, S)."""
    size = len(vectors)
    padded = np.zeros((size, samples + size - 1))
    padded[:, size - 1 : samples] = multipliers
    shifted = np.stack([padded[:, i : i + samples] for i in range(size)])
    each = (vectors @ shifted.reshape(size, -1)).reshape(size, size, samples)
    one, two = np.triu_indices(size)
    return np.asarray(each[one, two] + each[two, one], np.float64)


def _band(weights: Reals, vectors: Reals, places: Integers) -> Reals:
    """The lower band of F' diag(weights) F, (K K, R K)."""
    size, back = len(vectors), _windows(weights, len(vectors))
    rows, doubled = back.shape[2], np.eye(size) + 1.0
    found = np.zeros((size, size, rows, size))
    for c in range(size):
        for e in range(size):
            for d in range(1 if e < c else 0, size):
                if c == e:
                    by = (doubled[c, :, None] ** 2 * vectors[:, : size - d] * vectors[:, d:]).T
                    entries = np.einsum("ik,ikr->r", by, back[: size - d, places[c]])
                else:
                    entries = (vectors[e, : size - d] * vectors[c, d:]) @ back[
                        : size - d, places[c, e]
                    ]
                place = d * size + e - c
                found[place // size, place % size, :, c] = entries
    return found.reshape(size * size, -1)


def _silence(band: Reals, silent: Integers) -> None:
    """Part unknowns from all others, with 1 on the diagonal."""
    for place in range(1, len(band)):
        band[place, silent] = 0.0
        band[place, silent[silent >= place] - place] = 0.0
    band[0, silent] = 1.0


def _windows(table: Reals, size: int) -> Reals:
    n, rows = size - 1, table.shape[1] - size + 1
    return np.stack([table[:, n - i : n - i + rows] for i in range(size)])


def _substituted(factor: Reals, right: Reals, transposed: bool = False) -> Reals:
    """Solve L x = r or L' x = r with the lower band (b + 1, n) of L, for columns r."""
    found, info = dtbtrs(factor, right, uplo="L", trans="T" if transposed else "N")
    if info:
        raise np.linalg.LinAlgError
    return np.asarray(found, np.float64)
