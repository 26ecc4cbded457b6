"""From a record to proved parameter intervals.

    data, model, noise, priors -> formulate -> bounding/ -> Identification

What is not unique is reported or refused before; samples that are held out are asked after.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from concurrent.futures import Executor
from copy import copy
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.bounding.context import BoundingContext
from setid.bounding.methods import bound_parameters
from setid.consistency import consistency
from setid.data.noise import Noise
from setid.data.record import IOData
from setid.errors import DataError, ModelError, NoiseError, SetidError, SetidWarning, warns_once
from setid.formulation.formulation import formulate
from setid.formulation.regression import check_channels
from setid.identifiability.reference import reference_model, refuse
from setid.minimum_noise.discretisation import remark, with_estimate
from setid.models.block import BlockStructured
from setid.models.continuous import without_delta
from setid.models.equations import Structure
from setid.models.general import from_unknown_start
from setid.options import Options, checked_options, limited, with_executor
from setid.priors.base import Prior
from setid.proofs.intervals import IntervalStatus, ParameterInterval
from setid.proofs.uniqueness.normalisation import unidentifiable
from setid.result.assembling import (
    Outcome,
    empty_result,
    result_of,
)
from setid.result.holdout import Holdout, priors_with_box
from setid.result.identification import Identification
from setid.result.progress import OnProgress
from sparsepop_py.budget import Deadline, LimitReached
from sparsepop_py.result import INTERRUPTED

__all__ = ["identify"]

Reals = NDArray[np.float64]

_FIRST = 0.75  # of the time, for the part of a record that is not held out
_REST = 10.0  # units of work for that part, where no time is given


@warns_once
def identify(
    data: IOData,
    model: Structure,
    noise: Noise,
    priors: Iterable[Prior | sp.Constraint] | Prior | sp.Constraint = (),
    options: Options | None = None,
    *,
    holdout: IOData | float | None = None,
    on_progress: OnProgress | None = None,
    executor: Executor | None = None,
) -> Identification:
    """Prove an uncertainty interval for each parameter.

    Parameters
    ----------
    data : IOData
    model : Structure
        Such as :class:`TransferFunction`, :class:`PolynomialNARX` or
        :class:`ContinuousTransferFunction`.
    noise : Noise
    priors : iterable of priors and ``sp`` constraints
    options : Options, optional
    holdout : float, int or IOData, optional
        Samples that check the noise bounds: a part of the record that is left out of the
        identification (as of :meth:`IOData.split`: 0.7 identifies the first 70 % and holds out
        the rest), or another record. The result says with which factor on the bounds they are
        explained, whatever the signals before them.
    on_progress : callable, optional
        Called with the name of a parameter, its proved and its attained interval so far, when they
        change and at the next stage after two seconds; ends are infinite where there is none.
        Where it raises ``KeyboardInterrupt``, what is proved is returned.
    executor : concurrent.futures.Executor, optional
        Bounds several ends at a time, as ``options.engine.executor`` does.

    Returns
    -------
    Identification
        An empty feasible set, unbounded intervals and open gaps are statuses of the result,
        never exceptions. Ctrl-C ends the work; what is proved by then is returned, and a note
        says so. Where it comes while the problem is stated, or between two stages, it goes on.

    Raises
    ------
    SetidError
        If the parts do not fit together.

    References
    ----------
    V. Cerone, D. Piga, D. Regruto, "Set-membership error-in-variables identification
    through convex relaxation techniques", IEEE Trans. Automatic Control 57 (2012) 517-522.
    M. Milanese, A. Vicino, "Optimal estimation theory for dynamic systems with set
    membership uncertainty: an overview", Automatica 27 (1991) 997-1009.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> model = setid.TransferFunction(na=1, nb=1)
    >>> result = setid.identify(data, model, setid.Noise(equation=0.5))
    >>> result.intervals["b0"]
    b0 in [1.91666, 2.10931], attained [1.91667, 2.1093], certified
    """
    settings = checked_options(options)
    if not (on_progress is None or callable(on_progress)):
        raise SetidError(f"on_progress: found {on_progress!r:.60}, expected a callable")
    settings = with_executor(settings, executor)
    if settings.for_engine().effort == "presolve":
        text = "Options.engine: found effort 'presolve', which bounds each end by one relaxation; "
        warnings.warn(text + "expected effort='auto'", SetidWarning, stacklevel=2)
    if holdout is not None:
        return _held_out((data, model, noise, priors), settings, holdout, on_progress)
    if isinstance(model, BlockStructured) and isinstance(data, IOData):
        if settings.unidentifiable == "report" and (affected := unidentifiable(model)):
            parts = data, model, noise, priors
            return _reported(parts, settings, set(affected), on_progress)
        refuse(model)
    context = BoundingContext(settings, settings.limits(), {}, on_progress)
    model, noise, given = context.timed(
        "delta", lambda: with_estimate(data, model, noise, priors, context.until)
    )
    formulation = context.timed("formulate", lambda: formulate(data, model, noise, given))
    return _with_remarks(bound_parameters(formulation, context), context)


def _held_out(
    parts: tuple[IOData, Structure, Noise, Any],
    settings: Options,
    holdout: IOData | float,
    on_progress: OnProgress | None,
) -> Identification:
    """Identify from one part, and find the factor on the noise bounds that the other needs."""
    data, model, noise, priors = parts
    if not isinstance(data, IOData):
        raise SetidError(f"data: found {type(data).__name__}, expected IOData")
    if isinstance(holdout, IOData) and holdout.Ts != data.Ts:
        raise DataError(f"holdout: found Ts = {holdout.Ts:g}, expected {data.Ts:g} as in data")
    if isinstance(noise, Noise) and noise.constraints:  # before the work, which would be lost
        raise NoiseError(
            "noise: found constraints over the record, expected bounds alone for holdout"
        )
    until = settings.deadline()
    try:
        first, rest = (data, holdout) if isinstance(holdout, IOData) else data.split(holdout)
    except DataError as error:
        raise DataError(str(error).replace("at:", "holdout:", 1)) from None
    own, other = _noise_of(noise, data, first)
    check_channels(data, model)
    for part, its, what in ((first, own, "to identify from"), (rest, other, "held out")):
        if part is not data:  # before the work, which would be lost
            _check_part(part, model, its, what)
    share = None if settings.time_limit is None else _FIRST * settings.time_limit
    timed = replace(settings, time_limit=share)
    found = identify(first, model, own, priors, timed, on_progress=on_progress)
    if found.empty or found.interrupted:
        return found
    known = found.formulation
    given = priors_with_box(known, found.intervals)
    other = other.covering(known.noise.model_error)
    goes_on = from_unknown_start(known.model)  # a part goes on from the one before it
    timed = limited(Deadline.before(until, _REST if until == inf else inf), settings)
    level = consistency(rest, goes_on, other, given, timed)
    return replace(found, holdout=Holdout(level))


def _check_part(data: IOData, model: Structure, noise: Noise, what: str) -> None:
    """Refuse a part of the samples that does not fit, or has no equation."""
    try:
        formulate(data, from_unknown_start(without_delta(model)), noise)
    except (DataError, NoiseError) as error:
        raise type(error)(f"holdout: of the samples {what}, {error}") from None


def _noise_of(noise: Noise, data: IOData, first: IOData) -> tuple[Noise, Noise]:
    """Noise of both parts of a record; bounds that are given one a sample are split as it is."""
    each = [np.shape(getattr(noise, kind))[:1] for kind in ("output", "input", "equation")]
    if first is data or (data.samples,) not in each:
        return noise, noise
    bounds = noise.covering(0.0).bounds(data)
    k = first.samples
    return (
        _with_bounds(noise, *(values[:k] for values in bounds)),
        _with_bounds(noise, *(values[k:] for values in bounds)),
    )


def _with_bounds(noise: Noise, output: Reals, input: Reals, equation: Reals) -> Noise:
    """Noise with bounds one a sample; what it says of where they come from, it says still."""
    found, more = copy(noise), {"output": output, "input": input, "equation": equation}
    for field, value in {**more, "relative": False}.items():
        object.__setattr__(found, field, value)
    return found


def _with_remarks(found: Identification, context: BoundingContext) -> Identification:
    """Add what is to be said of the discretisation, and of an interrupt, if anything."""
    middle = np.array([interval.centre for interval in found.intervals.values()])
    text = "" if found.empty else remark(found.formulation, middle)
    ended = INTERRUPTED if context.deadline.stopped and not found.empty else ""
    notes = dict.fromkeys([*found.notes, *filter(None, (text, ended))])
    return replace(found, notes=tuple(notes))


def _reported(
    parts: tuple[IOData, BlockStructured, Noise, Any],
    settings: Options,
    affected: set[str],
    on_progress: OnProgress | None,
) -> Identification:
    """Identify what does not depend on a normalisation."""
    data, model, noise, priors = parts
    deadline = settings.limits()
    formulation = formulate(data, model, noise, priors)
    try:
        with deadline.kept():
            reference, nonzero = reference_model(data, model, noise, formulation.priors)
    except LimitReached:
        raise ModelError(
            f"normalise: found that {', '.join(sorted(affected))} are not unique, and no proof in "
            "the time that some normalisation excludes nothing; expected a normalisation, or a "
            "larger time_limit"
        ) from None
    rest = settings.within(deadline)
    found = identify(data, reference, noise, formulation.priors, rest, on_progress=on_progress)
    note = f"{', '.join(sorted(affected))} are not unique; the rest is that of {reference!r}"
    notes = () if found.empty else (note, *found.notes)
    outcome = Outcome(notes=notes, reference=found, nonzero=nonzero)
    if found.empty:
        return empty_result(formulation, settings, found.timings, outcome)
    items = []
    for name in formulation.parameters:
        free = ParameterInterval(name, (-inf, inf), None, IntervalStatus.UNIDENTIFIABLE)
        items.append(free if name in affected else found.intervals[name])
    items = [replace(item, witnesses=(None, None)) for item in items]
    return result_of(formulation, settings, found.timings, items, outcome)
