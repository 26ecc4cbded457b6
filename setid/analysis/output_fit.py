"""Least output errors: a local fit, cones of denominators below it, and the engine between.

A fit of the simulation gives parameters and an error. Cones of denominators refute smaller errors
of a single output. Where a gap is left the engine minimises over the parameters whose errors are
within the radius of the fit; where priors leave none of these, larger radii are tried.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import hypot, inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.record import IOData
from setid.feasible_points.fits.output_error import (
    least_error_at,
    least_largest_error,
    output_error_fit,
)
from setid.feasible_points.fits.separate_denominators import has_separate_denominators
from setid.feasible_points.fits.separate_noise import separate_noise
from setid.feasible_set.start import find_box
from setid.formulation.formulation import Formulation, without_partial_outputs
from setid.minimum_noise.claims import FoundDenominators
from setid.minimum_noise.denominators import least_output_noise
from setid.minimum_noise.fits import fit_of_denominator
from setid.models.checked_structures import coefficients_of
from setid.models.equations import Structure
from setid.models.lti import TransferFunction
from setid.options import Options
from setid.proofs.existence import proved_point
from setid.proofs.least_noise.least_error import (
    Norm,
    OutputErrors,
    attained_norm,
    error_rows,
    in_units_of,
    output_bound,
    stated,
    verify_output,
)
from sparsepop_py.budget import EARLY, Deadline

__all__ = ["FoundOutputErrors", "least_output_errors"]

Reals = NDArray[np.float64]
Fitted = tuple[Reals, Reals]  # parameters, and the outputs that are simulated with them

_MARGIN = 1e-4  # of the radius within which parameters are looked for, over the error of a fit
_ULPS = 1e-12  # by which a value may change where its proof is repeated
_DIGITS = 1e-4  # of the largest reading, times the room of errors
_EXACT = 1e-12  # of the largest reading: the least radius
_ROOM = 1e-9  # of the largest error: room for the rounding of errors that a proof solves for
_CELLS = 0.5  # of the time, for cones of denominators
_PART = 0.5  # of the tolerance, for them
_LAST = 0.5  # of the time, that the last verification may take longer
_WIDER = 12  # times that larger errors are tried, each by twice the factor of the one before
_STARTS = 3  # denominators of a search that are fitted


class FoundOutputErrors(NamedTuple):
    """Parameters with the least error that was found, and a proved lower bound.

    Parameters
    ----------
    model : Structure
        In the form that was searched.
    theta : (p,) float
    outputs : (N, ny) float
        Of the simulation.
    error : float
    attained : bool
        Whether the error is proved to be attained.
    lower_bound : float
    evidence : OutputErrors or None
    """

    model: Structure
    theta: Reals
    outputs: Reals
    error: float
    attained: bool
    lower_bound: float
    evidence: OutputErrors | None


def least_output_errors(
    data: IOData, model: Structure, norm: Norm, priors: tuple[Any, ...], settings: Options
) -> FoundOutputErrors:
    """Search the parameters of least output error, and bound it from below.

    Parameters
    ----------
    data : IOData
    model : Structure
    norm : {"linf", "l2", "l1"}
    priors : tuple of priors and constraints
    settings : Options
    """
    deadline = settings.limits()
    until = deadline.end
    formulation = without_partial_outputs(stated(data, model, priors, 1.0), from_rest=True)
    model = formulation.model
    local = output_error_fit(data, model, until)
    refuted = _refuted(formulation, norm, settings, deadline.part(_CELLS))
    fits = [local, *_of_denominators(formulation, norm, local[0], refuted.best, deadline)]
    fits.sort(key=lambda fit: _norm(data.y - fit[1], norm))
    fitted = fits[0]
    known: OutputErrors | None = None
    for one in fits:
        found = _known(data, model, norm, priors, one, refuted, deadline)
        if found is not None and found.attained is not None:
            known, fitted = found, one
            break
        known = known or found
    error, low, attained = _norm(data.y - fitted[1], norm), 0.0, False
    if known is not None:
        is_open = known.attained is None or known.level < (1.0 - settings.tol) * error
        if is_open and not deadline.late:
            known = _by_engine(known, fitted, settings, deadline)
        low = output_bound(known)
        if known.attained is not None:
            value = known.attained.value
            claimed = attained_norm(known, value + _ULPS * abs(value))
            if _is_verified(known, claimed, deadline):
                attained, error = True, claimed
                fitted = _of_point(known, known.attained)
    return FoundOutputErrors(model, *fitted, error, attained, min(low, error), known)


def _of_denominators(
    formulation: Formulation, norm: Norm, theta: Reals, best: Sequence[Reals], deadline: Deadline
) -> list[Fitted]:
    """Fit the other parameters for the denominators of a fit and of a search; single outputs.

    An interrupt leaves the fits before it.
    """
    data, model, until = formulation.data, formulation.model, deadline.end
    rows = error_rows(formulation, norm, 1.0)
    if rows is None or not isinstance(model, TransferFunction):
        return []
    found: list[Fitted] = []
    try:
        if has_separate_denominators(model):
            apart = separate_noise(formulation, until) if norm == "linf" else None
            return [] if apart is None else [apart]
        places = [model.parameters.index(name) for name in coefficients_of(model, 1, 1).denominator]
        if not best and norm == "linf" and time.monotonic() < until:
            best = [least_largest_error(data, model, np.ones_like(data.y), until=until)[places]]
        for denominator in [theta[places], *best[:_STARTS]]:
            if found and time.monotonic() >= until:
                break
            fitted = fit_of_denominator(data, model, rows, denominator)
            found.append(fitted or least_error_at(data, model, norm, denominator, until))
    except KeyboardInterrupt as cause:
        deadline.ended(cause)
    return found


def _known(
    data: IOData,
    model: Structure,
    norm: Norm,
    priors: tuple[Any, ...],
    fitted: Fitted,
    refuted: FoundDenominators,
    deadline: Deadline,
) -> OutputErrors | None:
    """State the least error within that of a fit, and prove in time that it is attained."""
    least = _EXACT * float(np.nanmax(np.abs(data.y), initial=0.0))  # where a fit is exact
    radius = max(float(_norm(data.y - fitted[1], norm) * (1.0 + _MARGIN)), least)
    if not 0.0 < _objective(norm, radius) < inf:
        return None
    formulation, level = stated(data, model, priors, radius), refuted.factor
    known = OutputErrors(norm, radius, formulation, None, None, None, level, refuted.cells)
    try:
        with deadline.kept():
            return replace(known, attained=_at_fit(known, fitted))
    except EARLY as cause:
        deadline.ended(cause)
        return known


def _is_verified(known: OutputErrors, error: float, deadline: Deadline) -> bool:
    """Check that an error is attained; false where that takes too long."""
    try:
        with deadline.kept(_LAST):
            return bool(verify_output(known, 0.0, error))
    except EARLY as cause:
        deadline.ended(cause)
        return False


def _refuted(
    formulation: Formulation, norm: Norm, settings: Options, deadline: Deadline
) -> FoundDenominators:
    """Refute errors by cones of denominators, where there is one output."""
    rows = error_rows(formulation, norm, 1.0)
    if rows is None or rows.order == 0:
        return FoundDenominators(0.0, None, ())
    return least_output_noise(rows, 0, _PART * settings.tol, deadline)


def _vector(known: OutputErrors, fitted: Fitted, room: float = 0.0) -> Reals:
    """All unknowns of the problem of the least error at a fit; sizes with some room.

    The room is for the rounding of errors, and that of outputs where a fit is exact.
    """
    formulation, norm, (theta, outputs) = known.formulation, known.norm, fitted
    numbers = formulation.layout.group("eta")
    errors = (formulation.data.y - outputs)[numbers >= 0]
    x = np.zeros(formulation.problem.dimension)
    x[formulation.layout.group("theta")] = theta
    x[numbers[numbers >= 0]] = errors
    if norm == "l2":
        return x
    sizes = np.abs(errors) if norm == "l1" else np.abs(errors).max(keepdims=True)
    more = float(np.abs(errors).max()) + _DIGITS * float(np.nanmax(np.abs(formulation.data.y)))
    return np.concatenate([x, sizes + room * more])


def _at_fit(known: OutputErrors, fitted: Fitted) -> sp.ProvedPoint | None:
    """Prove that the error of a fit is attained."""
    scaled = in_units_of(known)
    x = _vector(known, fitted, _ROOM) / scaled.units
    return proved_point(known.formulation, scaled.problem, x)


def _by_engine(
    known: OutputErrors, fitted: Fitted, settings: Options, deadline: Deadline
) -> OutputErrors:
    """Bound and attain the least error, from the local fit; an interrupt leaves what is proved.

    Where priors leave no parameters within the error of the local fit, larger errors are tried.
    """
    found = known
    try:
        for one in _by_larger_errors(known, fitted, settings, deadline):
            found = one
        if found.radius > known.radius and found.attained is not None and not deadline.late:
            found = _by_less(found, settings, deadline)
    except EARLY as cause:
        deadline.ended(cause)
    return found


def _by_larger_errors(
    known: OutputErrors, fitted: Fitted, settings: Options, deadline: Deadline
) -> Iterator[OutputErrors]:
    """Minimise over the parameters within the radius, and within larger ones while none are."""
    found = _minimised(known, fitted, settings, deadline)
    yield found
    for step in range(_WIDER):
        if output_bound(found) < found.radius or deadline.late:
            return
        radius = found.radius * 2.0 ** (step + 1)
        if found.attained is not None:  # beyond the radius, which samples alone obey
            fitted = _of_point(found, found.attained)
            radius = attained_norm(found, found.attained.value) * (1.0 + _MARGIN)
        wider = _minimised(_within(found, radius), fitted, settings, deadline)
        if wider.attained is None and output_bound(wider) < output_bound(found):
            return  # time ended, or the box is not finite: what was proved is kept
        found = wider
        yield found


def _by_less(found: OutputErrors, settings: Options, deadline: Deadline) -> OutputErrors:
    """Minimise once more within the error that is attained, where the gap is open."""
    assert found.attained is not None
    fitted = _of_point(found, found.attained)
    error = attained_norm(found, found.attained.value)
    if output_bound(found) >= (1.0 - settings.tol) * error:
        return found
    nearer = _within(found, error * (1.0 + _MARGIN))
    again = _minimised(nearer, fitted, settings, deadline)
    better = again.attained is not None and output_bound(again) >= output_bound(found)
    return again if better else found


def _within(known: OutputErrors, radius: float) -> OutputErrors:
    """State the same claim for errors within another radius, without its evidence."""
    old = known.formulation
    formulation = stated(old.data, old.model, old.priors, radius)
    level, cells = known.level, known.cells
    return OutputErrors(known.norm, radius, formulation, None, None, None, level, cells)


def _minimised(
    known: OutputErrors, fitted: Fitted, settings: Options, deadline: Deadline
) -> OutputErrors:
    """Minimise the error over the box of its radius; as it was without a finite box."""
    given, until = known, deadline.end
    known = replace(known, box=find_box(known.formulation, until), attained=None)
    if known.box is not None and known.box.empty:
        return known
    scaled = in_units_of(known)
    lower, upper = scaled.problem.lower, scaled.problem.upper
    p = len(known.formulation.parameters)
    if not np.all(np.isfinite(lower[:p]) & np.isfinite(upper[:p])):
        return given
    point = _at_fit(known, fitted)
    start = np.clip(_vector(known, fitted) / scaled.units, lower, upper)
    size = _objective(known.norm, known.radius)  # for a relative gap
    usual = settings.for_engine("absolute", until)
    options = replace(usual, gap=settings.tol * size / scaled.factor)
    found = sp.solve(scaled.problem, options, start=start)
    if found.status is sp.Status.INTERRUPTED:
        deadline.stop()
    best = found.attained
    if best is None or (point is not None and point.value < best.value):
        best = point
    return replace(known, certificate=found.certificate, attained=best)


def _of_point(known: OutputErrors, point: sp.ProvedPoint) -> Fitted:
    """Parameters and noise-free outputs of a point of the problem in units."""
    formulation = known.formulation
    x = point.x * in_units_of(known).units
    numbers = formulation.layout.group("eta")
    outputs = np.where(
        numbers >= 0, formulation.data.y - x[np.where(numbers >= 0, numbers, 0)], np.nan
    )
    return np.asarray(x[formulation.layout.group("theta")], np.float64), outputs


def _objective(norm: Norm, error: float) -> float:
    """Compute what a gap of the objective is relative to: of squares twice as much."""
    return 2.0 * error * error if norm == "l2" else error


def _norm(errors: Reals, norm: Norm) -> float:
    size = np.abs(errors[~np.isnan(errors)])
    if norm == "l2":
        return hypot(*size.tolist())  # whose squares neither overflow nor vanish
    return float(size.sum() if norm == "l1" else size.max())
