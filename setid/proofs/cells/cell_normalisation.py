"""Boxes of parameters from cells, in the normalisation of the structure.

A cell knows the numerator of G up to a factor, and coefficients of the map for its own scale. What
the structure fixes (a coefficient, a product, a static gain) gives each cell its factor; the hull
of all cells is the box.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, nextafter

import numpy as np
from numpy.typing import NDArray

from setid.formulation.formulation import Formulation
from setid.models.block import BlockStructured
from setid.proofs.cells.arithmetic import Fitted
from setid.proofs.cells.parts import Parts
from sparsepop_py.verified.arithmetic.scalar_interval import Ends, power, product, quotient, times
from sparsepop_py.verified.uncertain_rows.products import Total, contracted

__all__ = ["converted", "divided", "factor_of"]

Reals = NDArray[np.float64]
_MOST = float(np.finfo(float).max)
_LEAST = float(np.finfo(float).tiny)  # smaller results have fewer digits
_MOST_ASKED = 2000  # cells that are asked one by one where one says nothing of the map
_TINY = 1e-300  # more than what underflow takes from a sum


def converted(
    parts: Parts, formulation: Formulation, start: Reals, cells: Reals, fit: Fitted | None
) -> tuple[Reals, NDArray[np.int64]]:
    """Compute the hull (2, p) of all cells in the normalisation of the model.

    Parameters
    ----------
    parts : Parts
    formulation : Formulation
    start : (2, p) float
        Bounds of priors.
    cells : (C, 2, d) float
    fit : Fitted or None
        Coefficients of the map in each cell; None where there are no cells, or too many to ask
        each.

    Returns
    -------
    hull : (2, p) float
    kept : (K,) int
        Numbers of the cells that are not empty; all of them where none was asked.
    """
    model, p = formulation.model, start.shape[1]
    assert isinstance(model, BlockStructured)
    hull, kept = np.array([np.full(p, np.inf), np.full(p, -np.inf)]), list[int]()
    if not len(cells):
        return hull, np.array(kept, np.int64)
    place = {name: i for i, name in enumerate(formulation.parameters)}
    poles = _poles_alone(parts, start, cells, place), np.arange(len(cells))
    if fit is None:
        return poles
    factor = factor_of(parts, model, cells, fit)
    if len(cells) > _MOST_ASKED and np.any(_says_nothing(fit, factor)):
        return poles
    for c in range(len(cells)):
        box = _one_cell(parts, model, start, cells[c], fit, c, factor[c], place)
        if np.any(box[0] > box[1]):
            continue
        kept.append(c)
        hull = np.array([np.minimum(hull[0], box[0]), np.maximum(hull[1], box[1])])
    return hull, np.array(kept, np.int64)


def _says_nothing(fit: Fitted, factor: Reals) -> NDArray[np.bool_]:
    """Mark the cells (C,) that bound nothing but the poles: with one of them, neither do all."""
    return ~fit.bounded & ~np.all(np.isfinite(factor), axis=1)


def _poles_alone(parts: Parts, start: Reals, cells: Reals, place: Mapping[str, int]) -> Reals:
    """Compute the hull (2, p) of cells of which no single one is asked about the map."""
    hull = start.copy()
    for i, name in enumerate(parts.poles):
        hull[0, place[name]] = max(start[0, place[name]], cells[:, 0, i].min())
        hull[1, place[name]] = min(start[1, place[name]], cells[:, 1, i].max())
    return hull


def factor_of(parts: Parts, model: BlockStructured, cells: Reals, fit: Fitted) -> Reals:
    """Bound the factor from the face of each cell to the model's normalisation, (C, 2).

    Parameters
    ----------
    parts : Parts
    model : BlockStructured
    cells : (C, 2, d) float
    fit : Fitted
    """
    n = len(parts.poles)
    everything = np.tile([-np.inf, np.inf], (len(cells), 1))
    fixed = dict(model.fixed)
    for place, word in enumerate(parts.words):
        if all(name in fixed for name in word):
            asked = _product_of([fixed[name] for name in word])
            top = quotient(asked, _near(float(parts.constants[place])))
            return divided(np.tile(top, (len(cells), 1)), cells[:, :, n + place])
    for m, column in enumerate(parts.columns, len(parts.past)):
        goal = float(np.prod([fixed.get(name, 0.0) for name in column.word]))
        if column.power == 1 and _LEAST <= abs(goal) <= _MOST:
            ends = np.stack(
                [fit.gamma[:, m] - fit.radius[:, m], fit.gamma[:, m] + fit.radius[:, m]], axis=1
            )
            with np.errstate(over="ignore", invalid="ignore"):  # where it is NaN nothing is known
                ends = np.sort(ends / goal, axis=1)
                ends = ends + 0.9e-14 * np.abs(ends) * [-1.0, 1.0]
            return np.nextafter(ends, [-np.inf, np.inf])
    if parts.label in model.unit_gain:
        return _by_static_gain(parts, model, cells)
    return everything


def _by_static_gain(parts: Parts, model: BlockStructured, cells: Reals) -> Reals:
    """The factor with which the coefficients of G's numerator add up to 1 + sum a."""
    n, (places, known) = len(parts.poles), _numerator_of(parts, model)
    top = np.ones((len(cells), 2)) + cells[:, :, :n].sum(axis=2)
    lost = 1e-14 * (1.0 + np.abs(cells[:, :, :n]).sum(axis=2))  # near a pole at 1 it is much
    top = top + lost * [-1.0, 1.0]
    with np.errstate(over="ignore", invalid="ignore"):
        shares = cells[:, :, [n + place for place in places]] * parts.constants[places] / known
        below = np.sort(shares, axis=1).sum(axis=2)
        slack = 1e-14 * np.abs(shares).sum(axis=2).max(axis=1, keepdims=True) + _TINY
        below = below + slack * [-1.0, 1.0]
    if not places or not np.all(np.isfinite(below)):
        return np.tile([-np.inf, np.inf], (len(cells), 1))
    return divided(top, below)


def _numerator_of(parts: Parts, model: BlockStructured) -> tuple[list[int], float]:
    """Places where a known factor multiplies each coefficient of G's numerator, and the factor.

    The factor is 1, or, where a map drives G, a coefficient of that map that is fixed. No places
    where none is.
    """
    fixed, numerator = dict(model.fixed), set(model.linear_blocks[parts.label].numerator)
    words = {word: place for place, word in enumerate(parts.words)}
    for rest in dict.fromkeys(frozenset(word) - numerator for word in words):
        same = [place for word, place in words.items() if frozenset(word) - numerator == rest]
        known = float(np.prod([fixed.get(name, 0.0) for name in rest]))
        if len(rest) <= 1 and len(same) == len(numerator) and known != 0.0:
            return same, known
    return [], 1.0


def divided(top: Reals, below: Reals) -> Reals:
    """Divide intervals (C, 2), rounded outwards; everything where zero divides.

    Parameters
    ----------
    top, below : (C, 2) float
    """
    zero = (below[:, 0] <= 0) & (below[:, 1] >= 0)
    safe = np.where(zero[:, None], 1.0, below)
    with np.errstate(over="ignore"):
        corners = np.stack([top[:, i] / safe[:, j] for i in (0, 1) for j in (0, 1)], axis=1)
    low, high = corners.min(axis=1), corners.max(axis=1)
    low = np.nextafter(np.minimum(low, _MOST) * (1.0 - 0.9e-12 * np.sign(low)), -np.inf)
    high = np.nextafter(np.maximum(high, -_MOST) * (1.0 + 0.9e-12 * np.sign(high)), np.inf)
    return np.stack([np.where(zero, -np.inf, low), np.where(zero, np.inf, high)], axis=1)


def _one_cell(
    parts: Parts,
    model: BlockStructured,
    start: Reals,
    cell: Reals,
    fit: Fitted,
    number: int,
    factor: Reals,
    place: Mapping[str, int],
) -> Reals:
    """The box of theta in one cell."""
    n, fixed = len(parts.poles), dict(model.fixed)
    box = start.copy()
    for i, name in enumerate(parts.poles):
        box[0, place[name]] = max(box[0, place[name]], cell[0, i])
        box[1, place[name]] = min(box[1, place[name]], cell[1, i])
    known_factor = bool(np.all(np.isfinite(factor)))
    scale = (float(factor[0]), float(factor[1])) if known_factor else (-inf, inf)
    ends: dict[Total, Ends] = {}
    for i, word in enumerate(parts.words):
        known = _product_of([fixed[name] for name in word if name in fixed])
        constant = quotient(_near(float(parts.constants[i])), known)
        free = tuple(sorted(place[name] for name in word if name not in fixed))
        if free and known_factor and np.all(np.isfinite(constant)):
            low, high = cell[:, n + i].tolist()
            ends[free,] = product([scale, (low, high), constant])
    if not fit.bounded[number]:
        return contracted(box, ends, ())
    ends |= _row_ends(parts, fixed, fit, number, scale, place)
    if not parts.numerator or set(parts.numerator) & set(fixed):
        return contracted(box, ends, ())
    numerator, past = (
        tuple(place[name] for name in part) for part in (parts.numerator, parts.past)
    )
    return contracted(box, ends, [(numerator, past)])


def _row_ends(
    parts: Parts,
    fixed: Mapping[str, float],
    fit: Fitted,
    number: int,
    scale: Ends,
    place: Mapping[str, int],
) -> dict[Total, Ends]:
    """Ends of what the rows hold in one cell, in the normalisation of the model."""
    low, high = fit.gamma[number] - fit.radius[number], fit.gamma[number] + fit.radius[number]
    ends: dict[Total, Ends] = {}
    for m, name in enumerate(parts.past):
        ends[((place[name],),)] = _outwards(low[m], high[m])
    for m, column in enumerate(parts.columns, len(parts.past)):
        free = tuple(sorted(place[name] for name in column.word if name not in fixed))
        known = _product_of([fixed[name] for name in column.word if name in fixed])
        divisor = times(power(scale, column.power), known)
        apart = divisor[0] > 0.0 or divisor[1] < 0.0
        if free and apart and np.all(np.isfinite(divisor)):
            ends[free,] = quotient(_outwards(low[m], high[m]), divisor)
    return ends


def _outwards(low: float, high: float) -> Ends:
    """The range between two numbers that were rounded once."""
    return nextafter(float(low), -inf), nextafter(float(high), inf)


def _near(number: float) -> Ends:
    """The range of what is rounded to a number."""
    return _outwards(number, number)


def _product_of(numbers: list[float]) -> Ends:
    """The range of a product; exact for a single number."""
    return product([(number, number) for number in numbers])
