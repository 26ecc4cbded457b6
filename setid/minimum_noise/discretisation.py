"""Discretisation errors: of given coefficients, and the least one that explains a record.

The least consistent bound is no estimate of the true error. Where the exact sampled model
has no more freedom than the recursion (a held input, m = n - 1), other coefficients absorb
the whole error and the least bound is zero. So the error at what was found is computed as
well, and a result says where its bound does not cover it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from math import inf

import numpy as np
from numpy.typing import ArrayLike, NDArray

import sparsepop_py as sp
from setid.data.checks import channels_of, frozen, number, parameters_of
from setid.data.digits import all_digits
from setid.data.noise import EstimatedBound, Noise
from setid.data.record import IOData
from setid.errors import DataError, ModelError
from setid.feasible_points.start import candidates
from setid.feasible_points.witness import Witness, least_noise
from setid.formulation.completion import held_unknowns
from setid.formulation.formulation import Formulation, formulate
from setid.formulation.units import in_units
from setid.minimum_noise.factor import on_box
from setid.models.continuous import INDIRECT_WARNING, ContinuousTransferFunction, without_delta
from setid.models.equations import Structure
from setid.options import Options, checked_options, limited
from setid.priors.base import Prior, listed
from setid.proofs.least_noise.noise_scale import admitted_point, problem_with_factor
from setid.proofs.parameter_box import start_of
from setid.simulation.simulate import simulate
from sparsepop_py.budget import Deadline
from sparsepop_py.uncertain_rows.sign_tree import parameter_box
from sparsepop_py.verified.arithmetic.display import rounded

__all__ = ["discretisation_error", "estimate_delta", "remark", "with_estimate"]

_STEPS = 30  # halvings of the bound that an estimate needs
_NEAR = 1e-9  # relative, by which an estimate may miss a prior
_MOST = 30.0  # seconds for an estimate, or units of work


def discretisation_error(
    model: ContinuousTransferFunction, theta: ArrayLike | Mapping[str, float], u: ArrayLike
) -> NDArray[np.float64]:
    """Compute the distance of the recursion from the exact sampled response, from rest.

    Parameters
    ----------
    model : ContinuousTransferFunction
        With Ts.
    theta : (p,) array_like or mapping of names to numbers
    u : (N,) array_like
        Samples of an input that is as ``hold`` says between them.

    Raises
    ------
    SetidError
        If the structure has no recursion in physical coefficients, or numbers do not fit it.

    Returns
    -------
    (N,) float
        Recursion minus exact response; its largest absolute value is the ``delta`` that
        these coefficients need for this input. Computed, not proved.

    Examples
    --------
    >>> import setid
    >>> model = setid.ContinuousTransferFunction(1, 0, hold="constant", Ts=0.1)
    >>> error = setid.discretisation_error(model, [1.0, 1.0], [1.0] * 20)
    >>> bool(0 < abs(error).max() < 1e-2)
    True
    """
    from scipy.signal import cont2discrete, lfilter

    if not isinstance(model, ContinuousTransferFunction):
        raise ModelError(
            f"model: found {type(model).__name__}, expected a ContinuousTransferFunction"
        )
    if model.method == "indirect":
        raise ModelError("model: found method='indirect', expected one of physical coefficients")
    columns = channels_of(u, "u")
    if columns.shape[1] != 1:
        raise DataError(f"u: found {columns.shape[1]} columns, expected one input")
    inputs, count = columns[:, 0], model.n + model.m + 1
    values = parameters_of(theta, model.parameters)[:count]  # constants pass all recursions
    recursion = simulate(replace(model, offset=False), values, inputs)[:, 0]
    kind = "zoh" if model.hold == "constant" else "foh"
    system = np.append(1.0, values[: model.n]), values[model.n :]
    top, bottom, _ = cont2discrete((system[1], system[0]), model.Ts, method=kind)
    exact = lfilter(np.ravel(top), bottom, inputs)
    return np.asarray(recursion - exact, np.float64)


def remark(formulation: Formulation, theta: NDArray[np.float64]) -> str:
    """Write a warning if the discretisation is too coarse at nominal coefficients."""
    model, data = formulation.model, formulation.data
    if not isinstance(model, ContinuousTransferFunction):
        return ""
    if model.method == "indirect":
        return INDIRECT_WARNING
    if np.any(np.isnan(data.u)) or not np.all(np.isfinite(theta)):
        return ""
    records = np.split(data.u[:, 0], data.starts[1:])
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable middle of the intervals
        size = max(float(np.abs(discretisation_error(model, theta, u)).max()) for u in records)
    allowed = formulation.noise.model_error
    if not size > allowed * (1.0 + 1e-6) + 1e-9 * float(np.nanmax(np.abs(data.y))):
        return ""
    return (
        f"at the middle of the intervals the recursion is off by {rounded(size, True, 3)} for this "
        f"input, more than delta = {all_digits(allowed)}: give delta >= {rounded(size, True, 2)}, "
        "or sample faster, lest the true coefficients be lost"
    )


Priors = Iterable[Prior | sp.Constraint] | Prior | sp.Constraint


def with_estimate(
    data: IOData, model: Structure, noise: Noise, priors: Priors, until: float = inf
) -> tuple[Structure, Noise, list[Prior | sp.Constraint]]:
    """Settle ``delta="estimate"``; return structure, noise, and the priors as a list.

    Half of the time until ``until``, a reading of ``time.monotonic``, is for this at most. Where
    that is infinite work is counted.
    """
    given = listed(priors)
    if not isinstance(model, ContinuousTransferFunction) or model.delta != "estimate":
        return model, noise, given
    found = estimate_delta(data, model, noise, given, limited(Deadline.before(until, _MOST, 0.5)))
    return without_delta(model), noise.covering(found), given


def estimate_delta(
    data: IOData,
    model: Structure,
    noise: Noise,
    priors: Priors = (),
    options: Options | None = None,
    margin: float = 1.0,
) -> EstimatedBound:
    """Estimate the least discretisation error ``delta`` that is consistent with a record.

    Parameters
    ----------
    data : IOData
    model : ContinuousTransferFunction
        Its own ``delta`` is not used.
    noise : Noise
        The bounds of the noise alone, which stay as they are.
    priors : iterable of priors and ``sp`` constraints
    options : Options, optional
        30 seconds when left out.
    margin : float
        Factor >= 1 on what was found. The true error may be larger than the least one that the
        record shows. With margin 1, the default, the true coefficients may then lie outside the
        intervals.

    Returns
    -------
    EstimatedBound
        In the unit of the output, for :meth:`Noise.covering`. It is consistent with data and priors
        (attained), or twice the largest reading where none was found consistent; its text says
        which, and what is proved to be too small.

    Raises
    ------
    ModelError
        If the structure has no discretisation error.
    SetidError
        If the parts do not fit together.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, 2, 1, 1, 0, 1], [0.0, 0.6, 1.5, 1.3, 1.2, 0.4])
    >>> model = setid.ContinuousTransferFunction(1, 0, hold="constant")
    >>> bound = setid.estimate_delta(data, model, setid.Noise(output=0.01))
    >>> bool(0 < bound.value[0] < 0.1)
    True
    """
    if not isinstance(model, ContinuousTransferFunction) or model.method == "indirect":
        raise ModelError(
            f"model: found {model!r:.60}, expected a ContinuousTransferFunction of method 'tustin' "
            "or 'lambda', whose recursion is an approximation"
        )
    factor = number(margin, "margin", ModelError)
    if not 1.0 <= factor < inf:
        raise ModelError(f"margin: found {margin!r}, expected a factor >= 1")
    exact = without_delta(model)
    given = listed(priors)

    def stated(delta: float) -> Formulation:
        return formulate(data, exact, noise.covering(delta), given)

    settings = checked_options(options, Options(time_limit=_MOST))
    until = settings.deadline()
    limit, x = _explaining(data, stated, until)
    low, attained = 0.0, limit if x is not None else inf
    if limit > 0.0:
        low, attained = _least(stated(limit), limit, x, settings, until)
    value = min(attained, limit)
    value = float(np.nextafter(value * factor, inf)) if value > 0.0 else 0.0
    text = _sentence(value, low, factor, attained < inf)
    return EstimatedBound(frozen(np.array([value])), frozen(np.zeros(1)), text)


def _explaining(
    data: IOData, stated: Callable[[float], Formulation], until: float
) -> tuple[float, NDArray[np.float64] | None]:
    """Find a bound with which some estimate is consistent, with its unknowns; near its least one.

    Without unknowns where no estimate is: the largest bound that is tried.
    """
    largest = 2.0 * float(np.nanmax(np.abs(data.y))) or 1.0
    unit = stated(largest)
    best: tuple[float, NDArray[np.float64] | None] = (largest, None)
    for theta in candidates(unit, unit.problem):
        exact = stated(0.0)
        found = least_noise(exact, theta)
        if not _obeyed(exact, found):
            continue
        if found.level <= 1.0:
            return 0.0, found.x
        low, high = largest * 2.0**-_STEPS, largest
        if least_noise(unit, theta).level > 1.0:
            continue
        while high > 1.05 * low and time.monotonic() < until:
            middle = float(np.sqrt(low * high))
            low, high = (
                (low, middle) if least_noise(stated(middle), theta).level <= 1 else (middle, high)
            )
        if high < best[0]:
            best = high, least_noise(stated(high), theta).x
    return best


def _obeyed(formulation: Formulation, found: Witness) -> bool:
    """Check priors at a witness, up to rounding; the noise does not count."""
    problem, x = formulation.problem, np.nan_to_num(found.x)
    known = np.isfinite(found.x) & ~held_unknowns(formulation)
    outside = np.maximum(problem.lower - x, x - problem.upper) > _NEAR * (1.0 + np.abs(x))
    rows = zip(problem.constraints, formulation.rows.origin, strict=True)
    off = [_missed(row, x) for row, origin in rows if origin == "prior"]
    return not np.any(outside & known) and max(off, default=0.0) <= _NEAR


def _missed(row: sp.Constraint, x: NDArray[np.float64]) -> float:
    """By how much a row fails, relative to its coefficients."""
    value = float(row.polynomial(x)) / (1.0 + np.abs(row.polynomial.coefficients).max(initial=0.0))
    return abs(value) if row.kind is sp.Kind.ZERO else -value


def _least(
    formulation: Formulation,
    limit: float,
    x: NDArray[np.float64] | None,
    settings: Options,
    until: float,
) -> tuple[float, float]:
    """Proved lower end and attained value of the least bound up to the limit.

    The value is infinite where none is attained.
    """
    known = limit if x is not None else inf
    rows = formulation.smoothed
    box = None if rows is None else parameter_box(rows, start_of(formulation), until)
    asked = problem_with_factor(formulation, box, limit)
    result = on_box(formulation, asked, settings.for_engine("absolute", until), x)
    if result is None:
        return 0.0, known
    low = max(0.0, result.lower_bound) * limit if np.isfinite(result.lower_bound) else 0.0
    units = in_units(asked, formulation).units
    point = result.attained
    if point is not None and not admitted_point(formulation, units, point):
        point = None
    value = known if point is None else min(1.0, point.value) * limit
    return float(np.nextafter(low, 0.0)), min(value * (1.0 + 1e-9), limit)


def _sentence(value: float, low: float, factor: float, attained: bool) -> str:
    """The assumption that a delta makes, and what is proved of smaller ones."""
    origin = "the least one that was found consistent with the data"
    if not attained:
        origin = "twice the largest reading, as none was found consistent with the data"
    return (
        f"discretisation error: at most delta = {all_digits(value)}, {origin} "
        f"(proved: none below {rounded(low, False, 6)} is)"
        + (f", times {all_digits(factor)}" if factor > 1.0 else "")
        + "; the true error may be larger"
    )
