"""Proved ranges of static maps and of internal signals of block structures.

A map N(x) = sum_m gamma_m phi_m(x) is linear in its coefficients at each x: its range over the
feasible set is that of a linear function over the cover of the parameters. Arguments that are
measured, x = x~ - xi with abs(xi) <= w, change a monomial from its value at the readings by at
most

    prod_i (abs(x~_i) + w_i)^p_i  -  prod_i abs(x~_i)^p_i,

and the map by the sum of these, each times the largest size of its coefficient. Internal signals
that are unknowns are simulated over the box of the parameters, where the structure is a recursion.
"""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import NDArray

from setid.formulation.formulation import Formulation
from setid.models.block import BlockStructured
from setid.models.maps import StaticMap
from setid.proofs.cells.output_cells import cell_box
from setid.proofs.parameter_box import start_of
from setid.proofs.simulated.forms import Region
from setid.proofs.simulated.outputs import recursion_of

__all__ = ["map_deviation", "map_ends", "map_slopes", "simulated_ends"]

Reals = NDArray[np.float64]
_EPS = float(np.finfo(float).eps)
_EXPONENT = 900  # of products that are normal doubles
_TINY = 1e-300
_MORE = 1.0 + 1e-12  # more than the rounding of sums of positive numbers


def map_slopes(model: BlockStructured, target: str, points: Reals) -> tuple[Reals, Reals]:
    """Compute slopes (K, p) and constants (K,): the map is slopes theta + constant.

    Parameters
    ----------
    model : BlockStructured
    target : str
        The signal that the map defines.
    points : (K, arguments) float

    Examples
    --------
    >>> from setid import Hammerstein, TransferFunction
    >>> model = Hammerstein(TransferFunction(0, 1), 2, normalise="b0")
    >>> [part.tolist() for part in map_slopes(model, "w", np.array([[0.5]]))]
    [[[0.5, 0.25]], [0.0]]
    """
    item, fixed = dict(model.maps)[target], dict(model.fixed)
    place = {name: i for i, name in enumerate(model.parameters)}
    slopes, constant = np.zeros((len(points), len(place))), np.zeros(len(points))
    for m, weight in enumerate(model.wiring.weights(target)):
        values = item.value(m, *points.T)
        if weight in fixed:
            constant = constant + fixed[weight] * values
        else:
            slopes[:, place[weight]] = values
    return slopes, constant


def map_deviation(
    model: BlockStructured, target: str, points: Reals, reach: Reals, box: tuple[Reals, Reals]
) -> Reals:
    """Bound the distance (K,) of a map from its slopes: rounding, and errors in the arguments.

    Functions that are given are taken as they are; they need arguments without errors. Where no
    distance is proved it is infinite.

    Parameters
    ----------
    model : BlockStructured
    target : str
        The signal that the map defines.
    points : (K, arguments) float
    reach : (K, arguments) float
        Bounds of the errors of the arguments, at least 0.
    box : (lower, upper), each (p,) float
        Of the parameters.

    Examples
    --------
    >>> from setid import Hammerstein, TransferFunction
    >>> model = Hammerstein(TransferFunction(0, 1), 2, normalise="b0")
    >>> box = np.zeros(2), np.ones(2)
    >>> map_deviation(model, "w", np.array([[0.5]]), np.array([[0.1]]), box).round(2).tolist()
    [0.21]
    """
    item, (low, high) = dict(model.maps)[target], box
    largest = dict(zip(model.parameters, np.maximum(-low, high), strict=True))
    largest |= {name: abs(value) for name, value in model.fixed}
    off, weights = np.zeros(len(points)), model.wiring.weights(target)
    for m, weight in enumerate(weights):
        powers = item.basis[m]
        with np.errstate(all="ignore"):
            if callable(powers):
                far, rounding = np.abs(item.value(m, *points.T)), 0
                apart = np.where(np.any(reach > 0, axis=1), inf, 0.0)
            else:
                far, apart = _monomial(item, m, powers, points, reach)
                rounding = 2 * sum(powers)
            apart += (rounding + len(weights) + 4) * _EPS * far
        found = ~(apart == 0.0)
        off[found] += largest[weight] * apart[found]
    return np.where(np.isnan(off), inf, off) * _MORE


def _monomial(
    item: StaticMap, m: int, powers: tuple[int, ...], points: Reals, reach: Reals
) -> tuple[Reals, Reals]:
    """The largest size of a monomial (K,), and how far it may be from that at the points."""
    used, most = np.array(powers) > 0, 2.0 ** (_EXPONENT / max(sum(powers), 1))
    size = np.abs(points) + reach
    far, near = item.value(m, *size.T), item.value(m, *np.abs(points).T)
    size = size[:, used]
    normal = np.all((size == 0.0) | ((size >= 1.0 / most) & (size <= most)), axis=1)
    apart = far - near + np.where(normal, 0.0, _TINY)  # below 1 underflow loses no more than that
    return far, np.where(normal | np.all(size <= 1.0, axis=1), apart, inf)


def map_ends(ends: Reals, constant: Reals, off: Reals) -> tuple[Reals, Reals]:
    """Bound a map from what its slopes reach; return the lower and the upper ends (K,).

    Parameters
    ----------
    ends : (K, 2) float
        Proved bounds of slopes theta.
    constant : (K,) float
    off : (K,) float
        As of :func:`map_deviation`.
    """
    size = off + 8 * _EPS * (np.abs(ends).max(axis=1) + np.abs(constant))
    return ends[:, 0] + constant - size, ends[:, 1] + constant + size


def simulated_ends(
    formulation: Formulation, name: str, box: tuple[Reals, Reals]
) -> tuple[Reals, Reals] | None:
    """Bound a signal (N,) by simulation over a box; None for what is no recursion.

    Parameters
    ----------
    formulation : Formulation
    name : str
        An internal signal.
    box : (lower, upper), each (p,) float
        Of the parameters.
    """
    parts = recursion_of(formulation)
    if parts is None:
        cells = cell_box(formulation, start_of(formulation))
        parts = None if cells is None else recursion_of(formulation, cells)
    if parts is None or not np.all(np.isfinite(box)):
        return None
    lower, upper = parts.box(*box)
    region = Region(lower, upper, np.zeros((0, lower.size)), np.zeros(0), np.zeros(0))
    form = parts.run(region)[name]
    with np.errstate(over="ignore", invalid="ignore"):
        off = (region.reach(form.slope) + form.rest) * _MORE + 1e-15 * np.abs(form.value)
        low, high = form.value - off, form.value + off
    return np.where(np.isnan(low), -inf, low), np.where(np.isnan(high), inf, high)
