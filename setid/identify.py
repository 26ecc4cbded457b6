"""From a record to proved parameter intervals.

    formulate -> linear?  exact linear programs
              -> else     box from the data -> the engine, all ends over one feasible set
                                            -> simulations, cones of denominators (long records)

Linear problems (equation errors, exact regressors) are settled without rounding. Otherwise
the box of the parameters comes from the data alone and is part of the proof; the engine
then tightens all 2 p ends together. Where a prior adds unknowns to rows of data that are linear,
the box is as narrow as they allow. If points near its ends satisfy the prior, that is the result.
"""

from __future__ import annotations

import logging
import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.consistency import consistency
from setid.data.checks import FrozenMapping, frozen
from setid.data.noise import Noise
from setid.data.record import IOData
from setid.errors import DataError, NoiseError, SetidError, SetidWarning, warns_once
from setid.feasible_points.cascades import (
    CascadeEnds,
    attained_result,
    cascade_ends,
    cascade_of,
    is_cascade,
    on_box,
    point_of,
    tightened_cascade,
)
from setid.feasible_points.inner_ends import inner_ends
from setid.feasible_points.linear_ends import linear_ends
from setid.feasible_points.search import coupled, recheck_results, search_ends
from setid.feasible_points.start import Repair, first_point
from setid.feasible_set.start import find_box
from setid.formulation.formulation import Formulation, formulate
from setid.formulation.units import InUnits, in_units
from setid.identifiability.common_factor import find_unbounded
from setid.identifiability.reference import reference_model, refuse
from setid.minimum_noise.cones.feasible_box import denominator_box, settles
from setid.minimum_noise.conflicting_samples import conflicting_rows, conflicting_samples
from setid.minimum_noise.discretisation import remark, with_estimate
from setid.models.block import BlockStructured
from setid.models.equations import Structure
from setid.models.general import from_unknown_start
from setid.models.lti import TransferFunction
from setid.options import Options, checked_options, with_executor
from setid.priors.base import Prior
from setid.proofs.existence import admitted, proved_point, solved_rows
from setid.proofs.intervals import IntervalStatus, ParameterInterval
from setid.proofs.parameter_box import ProvedBox, objectives, problem_on_box
from setid.proofs.row_boxes import RowBox
from setid.proofs.simulated.outputs import Recursion, recursion_of
from setid.proofs.uniqueness.free_parameters import free_parameters
from setid.proofs.uniqueness.normalisation import unidentifiable
from setid.proofs.uniqueness.unbounded import Unbounded
from setid.result.assembling import (
    Outcome,
    empty_result,
    free_text,
    result_of,
    signals_text,
    simpler_text,
    unbounded_text,
)
from setid.result.holdout import Holdout, members
from setid.result.identification import Identification
from setid.result.progress import OnProgress, Progress
from sparsepop_py.budget import EARLY, Deadline
from sparsepop_py.result import INTERRUPTED
from sparsepop_py.verified.points.feasible_point import valued

__all__ = ["identify"]

_LOG = logging.getLogger(__name__)

_DIRECT = (
    "partial outputs have no bounds from the data: the denominators are multiplied out, which "
    "keeps every consistent parameter vector (and may keep more)"
)
_SHARE = 0.7  # of the time, for the problem with all priors, where fewer make an easier one
_FITS = 0.25  # of the time left, for fits of a cascade from many starts
_FIT = 0.6  # ... and of a long record from one
_MORE = 1.5  # times what the proof of one point took: what is kept for each
_OPEN = "time ended before all cells of the parameters were small: give more time"
_NO_BOX = "time ended in the search for a box from the data: give more time"
_STOPPED = "interrupted in the search for a box from the data"
_SEARCH = 10.0  # seconds, and what the proof took, to find samples that contradict each other
_FIRST = 0.75  # of the time, for the part of a record that is not held out
_LEAST = 1e-3  # seconds for the part that is, when the time is over
_FEW = 60  # unknowns up to which linear problems are solved in rationals
_MANY = 200  # equations beyond which records of noisy outputs are simulated first
_CELLS = 2000  # regions that are parted at most
_REGIONS = 1000  # equations beyond which regions are parted before the engine is asked
_NEAR = 0.01  # ... if the first one reaches no more widths beyond the attained ends
_CONES = 0.9  # of the time, for cones of denominators
_ENDS = 0.7  # of the tolerance: what they leave beyond attained ends
_LONG = 1000  # equations beyond which the engine solves no system at once


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
        identification (as of :meth:`IOData.split`: 0.5 holds out the second half), or another
        record. The result says with which factor on the bounds they are explained, whatever the
        signals before them.
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
    task = _Task(settings, settings.limits(), {}, on_progress)
    model, noise, given = task.timed(
        "delta", lambda: with_estimate(data, model, noise, priors, task.until)
    )
    formulation = task.timed("formulate", lambda: formulate(data, model, noise, given))
    return _with_remarks(_intersected(formulation, task), task)


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
    first, rest = (data, holdout) if isinstance(holdout, IOData) else data.split(holdout)
    own, other = _noise_of(noise, data, first, rest)
    share = None if settings.time_limit is None else _FIRST * settings.time_limit
    timed = replace(settings, time_limit=share)
    found = identify(first, model, own, priors, timed, on_progress=on_progress)
    if found.empty or found.interrupted:
        return found
    known = found.formulation
    given = members(known, found.intervals)
    left = _SEARCH if until == inf else max(until - time.monotonic(), _LEAST)
    other = other.covering(known.noise.model_error)
    goes_on = from_unknown_start(known.model)  # a part goes on from the one before it
    level = consistency(rest, goes_on, other, given, replace(settings, time_limit=left))
    return replace(found, holdout=Holdout(level))


def _noise_of(noise: Noise, data: IOData, first: IOData, rest: IOData) -> tuple[Noise, Noise]:
    """Noise of both parts of a record; bounds that are given one a sample are split as it is."""
    each = [np.shape(getattr(noise, kind))[:1] for kind in ("output", "input", "equation")]
    if first is data or (data.samples,) not in each:
        return noise, noise
    eta, xi, e = noise.bounds(data)
    k = first.samples
    return Noise(eta[:k], xi[:k], e[:k]), Noise(eta[k:], xi[k:], e[k:])


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """Settings, limits, seconds by stage, and what is called with new bounds."""

    settings: Options
    deadline: Deadline
    timings: dict[str, float]
    on_progress: OnProgress | None = None

    @property
    def until(self) -> float:
        """The reading of ``time.monotonic`` at which work ends, as it is expected now."""
        return self.deadline.end

    def timed(self, stage: str, work: Callable[[], Any]) -> Any:
        """Add the CPU seconds of some work to its stage."""
        begin = time.process_time()
        try:
            return work()
        finally:
            spent = time.process_time() - begin
            self.timings[stage] = self.timings.get(stage, 0.0) + spent
            _LOG.debug("%s: %.3f CPU seconds", stage, spent)

    def kept(self, stage: str, work: Callable[[], Any], otherwise: Any) -> Any:
        """Do timed work within the limits; what there is otherwise if it is ended before."""
        if self.deadline.stopped:
            return otherwise
        try:
            with self.deadline.kept():
                return self.timed(stage, work)
        except EARLY as cause:
            self.deadline.ended(cause)
            return otherwise

    def empty(self, formulation: Formulation, outcome: Outcome) -> Identification:
        """Put an empty result together."""
        return empty_result(formulation, self.settings, self.timings, outcome)

    def result(
        self, formulation: Formulation, items: Sequence[ParameterInterval], outcome: Outcome
    ) -> Identification:
        """Put a result together."""
        return result_of(formulation, self.settings, self.timings, items, outcome)


def _settle(formulation: Formulation, task: _Task) -> Identification:
    """Settle all intervals of one formulation, by linear programs or by the engine."""
    problem = formulation.problem
    if problem.degree <= 1 and problem.dimension <= _FEW:
        asked = objectives(formulation)
        work = partial(sp.linear_bounds, problem, asked)
        bounds = task.kept("linear programs", work, None)
        if bounds is not None:
            return _linear(formulation, task, tuple(bounds))
    direct = _direct(formulation)
    if direct is not None:
        return _on_box(direct, task, (_DIRECT,))
    return _on_box(formulation, task, ())


def _intersected(formulation: Formulation, task: _Task) -> Identification:
    """Settle all intervals; what stays open is also bounded without priors that add unknowns.

    Such a prior makes a larger problem, whose bounds can be weaker when time runs out. What
    is proved without it holds with it. Cones of denominators do not see what such a prior adds.
    """
    kept = [prior for prior in formulation.priors if not prior.unknowns(formulation.model)]
    by_cones = _long_record(formulation) is not None and settles(formulation)
    if len(kept) == len(formulation.priors) or by_cones:
        return _settle(formulation, task)
    first = replace(task, deadline=task.deadline.part(_SHARE))
    found = _settle(formulation, first)
    if _closed(found) or first.deadline.stopped:
        return found
    # of the form that `found` speaks of: denominators may be multiplied out there
    model = found.formulation.model
    fewer = formulate(formulation.data, model, formulation.noise, kept)
    return _intersect(found, _settle(fewer, task), task.settings.tol)


def _is_open(item: ParameterInterval) -> bool:
    return item.status is IntervalStatus.PARTIAL


def _intersect(found: Identification, other: Identification, tol: float) -> Identification:
    """A result whose intervals are also within those of a result with fewer priors."""
    if other.empty:
        items = {
            name: replace(
                item,
                outer=(inf, -inf),
                inner=None,
                witnesses=(None, None),
                status=IntervalStatus.EMPTY,
            )
            for name, item in found.intervals.items()
        }
        return replace(found, intervals=FrozenMapping(items), fewer_priors=other)
    items = {}
    for name, item in found.intervals.items():
        low, high = other.intervals[name].outer
        within = replace(item, outer=(max(low, item.outer[0]), min(high, item.outer[1])))
        closed = _is_open(item) and (within.gap <= tol * (1.0 + 1e-9))
        items[name] = replace(within, status=IntervalStatus.CERTIFIED) if closed else within
    if all(items[name].outer == item.outer for name, item in found.intervals.items()):
        return found
    note = "some ends are proved without the priors that add unknowns, in less time"
    return replace(
        found, intervals=FrozenMapping(items), fewer_priors=other, notes=(*found.notes, note)
    )


def _with_remarks(found: Identification, task: _Task) -> Identification:
    """Add what is to be said of the discretisation, and of an interrupt, if anything."""
    middle = np.array([interval.centre for interval in found.intervals.values()])
    text = "" if found.empty else remark(found.formulation, middle)
    ended = INTERRUPTED if task.deadline.stopped and not found.empty else ""
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
    formulation = formulate(data, model, noise, priors)
    reference, nonzero = reference_model(data, model, noise, formulation.priors)
    found = identify(data, reference, noise, formulation.priors, settings, on_progress=on_progress)
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


def _direct(formulation: Formulation) -> Formulation | None:
    """The same data with denominators multiplied out, where partial outputs have no bounds."""
    model, n = formulation.model, len(formulation.parameters)
    problem = formulation.problem
    open_ = np.isinf(problem.lower[n:]) | np.isinf(problem.upper[n:])
    if not isinstance(model, TransferFunction) or not np.any(open_) or model.form == "direct":
        return None
    other = replace(model, form="direct")
    if model.offset:  # on the outputs themselves; its first samples tell nothing then
        other = replace(model, form="multiplied", initial="free")
    return formulate(formulation.data, other, formulation.noise, formulation.priors)


def _on_box(formulation: Formulation, task: _Task, notes: tuple[str, ...]) -> Identification:
    """Find a box from the data, then settle all intervals on it."""
    late = object()
    box = task.kept("box", lambda: find_box(formulation, task.until), late)
    if box is late:
        box, notes = None, (*notes, _STOPPED if task.deadline.stopped else _NO_BOX)
    if box is not None and box.empty:
        left = min(_SEARCH, task.until - time.monotonic())
        keys = conflicting_rows(formulation, box) or conflicting_samples(formulation, None, left)
        return task.empty(formulation, Outcome(box=box, samples=keys, notes=notes))
    if box is not None and box.cut_short:
        notes = (*notes, _STOPPED if task.deadline.stopped else _NO_BOX)
    parts, settled = cascade_of(formulation, box) or _long_record(formulation), None
    if parts is not None:
        settled = _by_simulation(formulation, task, parts, box, notes)
    if settled is not None and (is_cascade(formulation) or _closed(settled)):
        return settled
    points: list[sp.ProvedPoint] = []
    if settled is not None:
        box = settled.evidence.box
        points = [end.attained for end in settled.evidence.ends if end.attained is not None]
    problem = problem_on_box(formulation, box)
    outcome = Outcome(problem=problem, box=box, notes=notes)
    at_ends = None if settled is not None else _at_linear_ends(formulation, task, outcome)
    if at_ends is not None and _closed(at_ends):
        return at_ends
    p = len(formulation.parameters)
    loose = np.flatnonzero(np.isinf(problem.lower[:p]) | np.isinf(problem.upper[:p]))
    if loose.size and (box is not None or isinstance(formulation.model, BlockStructured)):
        return _without_box(formulation, task, outcome, loose)
    return _by_engine(formulation, task, outcome, bool(loose.size), points)


def _at_linear_ends(
    formulation: Formulation, task: _Task, outcome: Outcome
) -> Identification | None:
    """Attain all ends of the box where rows of data are linear; None where they are not."""
    ends = task.kept("points", partial(linear_ends, formulation), [])
    if not ends:
        return None
    scaled = in_units(_stated(outcome), formulation)
    attain = partial(_attained_at, formulation, scaled, ends)
    results = task.kept("points", attain, ())
    items = _intervals(formulation, scaled, results, task.settings.tol)
    return task.result(formulation, items, replace(outcome, results=results))


def _attained_at(
    formulation: Formulation, scaled: InUnits, ends: Sequence[NDArray[np.float64]]
) -> tuple[sp.Result, ...]:
    """Results that claim the points near these vectors, where they are proved."""
    made, known = [], solved_rows(formulation, scaled.problem)
    for objective, x in zip(objectives(formulation), ends, strict=True):
        about = scaled.problem.with_objective(scaled.asked(objective)[0])
        point = proved_point(formulation, about, x / scaled.units, known)
        made.append(attained_result(about, point))
    return tuple(made)


def _equations(formulation: Formulation) -> int:
    return int(np.count_nonzero(formulation.problem.equality))


def _long_record(formulation: Formulation) -> Recursion | None:
    """A long record of noisy outputs as a simulation; None for others."""
    return recursion_of(formulation) if _equations(formulation) > _MANY else None


def _closed(found: Identification) -> bool:
    return found.empty or not any(_is_open(item) for item in found.intervals.values())


# ---- linear problems --------------------------------------------------------------------


def _linear(
    formulation: Formulation, task: _Task, bounds: tuple[sp.LinearBound, ...]
) -> Identification:
    problem = formulation.problem
    if bounds[0].status is sp.Status.INFEASIBLE:
        rows = formulation.rows
        used = [number for number, _ in bounds[0].multipliers if number < len(rows.origin)]
        samples = {(int(rows.record[r]), int(rows.sample[r])) for r in used if rows.sample[r]}
        return task.empty(formulation, Outcome(bounds=bounds, samples=tuple(sorted(samples))))
    items = []
    for place, name in enumerate(formulation.parameters):
        low, high = bounds[2 * place], bounds[2 * place + 1]
        status = IntervalStatus.CERTIFIED
        if sp.Status.UNBOUNDED in (low.status, high.status):
            status = IntervalStatus.UNBOUNDED
        if low.status is high.status is sp.Status.UNBOUNDED and _is_line(problem, low):
            status = IntervalStatus.UNIDENTIFIABLE
        outer, inner = (low.lower, -high.lower), (low.upper, -high.upper)
        items.append(ParameterInterval(name, outer, inner, status, (low.x, high.x)))
    return task.result(formulation, items, Outcome(bounds=bounds))


def _is_line(problem: sp.Problem, bound: sp.LinearBound) -> bool:
    """Check that no row changes along the ray, so that the whole line is feasible."""
    if bound.ray is None:
        return False
    along = [i for i, step in enumerate(bound.ray) if step]
    if np.any(np.isfinite(problem.lower[along])) or np.any(np.isfinite(problem.upper[along])):
        return False
    for row in problem.constraints:
        polynomial = row.polynomial
        pairs = zip(polynomial.words[:, -1].tolist(), polynomial.coefficients, strict=True)
        if sum(Fraction(float(c)) * bound.ray[letter - 1] for letter, c in pairs if letter):
            return False
    return True


# ---- simulations ------------------------------------------------------------------------


def _by_simulation(
    formulation: Formulation,
    task: _Task,
    parts: Recursion,
    box: ProvedBox | None,
    notes: tuple[str, ...],
) -> Identification | None:
    """Settle all ends by simulations over regions; None where no box to begin with is finite.

    Regions are parted where the engine has no better way: for cascades, and for long records whose
    first region is near the attained ends.
    """
    fits = task.deadline.part(_FITS if is_cascade(formulation) else _FIT)
    found = task.kept("start", lambda: cascade_ends(formulation, parts, box, fits), None)
    if found is None:
        return None
    begin, number = time.monotonic(), 2 * len(formulation.parameters)
    task.timed("points", lambda: _attained_ends(formulation, box, found, [0], task.deadline))
    last = _MORE * number * (time.monotonic() - begin)  # expected, for points on the final box
    share = 1.0 if task.until == inf else max(_LEAST, 1.0 - last / max(_left(task), _LEAST))
    cells = _CELLS if is_cascade(formulation) or _equations(formulation) > _REGIONS else 0
    near = inf if is_cascade(formulation) else _NEAR
    deadline, tol = task.deadline.part(share), task.settings.tol
    tighten = partial(tightened_cascade, found, box, tol, deadline, cells, near)
    tightened: ProvedBox | None = task.kept("cells", tighten, None)
    if not is_cascade(formulation) and found.ends and (tightened is None or tightened.cut_short):
        cones = partial(_by_denominators, formulation, task, found, box, deadline.part(_CONES))
        tightened = task.kept("cones", cones, None) or tightened
    if tightened is not None and tightened.empty:
        return task.empty(formulation, Outcome(box=tightened, notes=notes))
    cut_short = tightened is None or tightened.cut_short
    box = box if tightened is None else tightened
    problem = problem_on_box(formulation, box)
    every = range(number)
    results = task.timed(
        "points", lambda: _attained_ends(formulation, box, found, every, task.deadline)
    )
    items = _intervals(formulation, in_units(problem, formulation), results, task.settings.tol)
    task.kept("report", lambda: _report(formulation, task, items), None)
    if cut_short and any(map(_is_open, items)) and not task.deadline.stopped:
        notes = (*notes, _OPEN)
    return task.result(
        formulation, items, Outcome(problem=problem, box=box, results=results, notes=notes)
    )


def _by_denominators(
    formulation: Formulation,
    task: _Task,
    found: CascadeEnds,
    box: ProvedBox | None,
    deadline: Deadline,
) -> ProvedBox | None:
    """A box from cones of denominators, and from one region where time ended before the gains'."""
    if not isinstance(box, RowBox | None):
        return None
    points = np.array(found.ends)[:, : len(formulation.parameters)]
    attained, tol = (points.min(axis=0), points.max(axis=0)), _ENDS * task.settings.tol
    executor = task.settings.for_engine().executor
    cones = denominator_box(formulation, box, attained, tol, deadline, executor)
    if cones is None or cones.empty or not cones.cut_short:
        return cones
    return tightened_cascade(on_box(found, cones), cones, tol, task.deadline, 0) or cones


def _report(formulation: Formulation, task: _Task, items: Sequence[ParameterInterval]) -> None:
    """Tell who listens of all ends."""
    settings = task.settings
    progress = Progress(
        formulation.parameters, settings.tol, settings.progress, None, task.on_progress
    )
    try:
        for place, item in enumerate(items):
            low, high = (inf, -inf) if item.inner is None else item.inner
            progress.report(2 * place, item.outer[0], low)
            progress.report(2 * place + 1, -item.outer[1], -high)
    finally:
        progress.close()


def _left(task: _Task) -> float:
    return task.until - time.monotonic()


def _attained_ends(
    formulation: Formulation,
    box: ProvedBox | None,
    found: CascadeEnds,
    ends: Iterable[int],
    deadline: Deadline,
) -> tuple[sp.Result, ...]:
    """Prove the points at which simulations reach ends; nothing else is claimed of them.

    When time is over only the first is proved.
    """
    scaled, asked = in_units(problem_on_box(formulation, box), formulation), objectives(formulation)
    known, made = solved_rows(formulation, scaled.problem), list[sp.Result]()
    for number in ends:
        about, point = scaled.problem.with_objective(scaled.asked(asked[number])[0]), None
        if found.ends and not (made and deadline.over):
            x = point_of(formulation, found.fitting, found.ends[number])
            try:
                point = proved_point(formulation, about, x / scaled.units, known)
            except EARLY as cause:
                deadline.ended(cause)
        made.append(attained_result(about, point))
    return tuple(made)


# ---- the engine -------------------------------------------------------------------------


def _without_box(
    formulation: Formulation, task: _Task, outcome: Outcome, loose: NDArray[np.int64]
) -> Identification:
    """Say what is proved where some parameters have no finite box."""
    free, alone = free_parameters(formulation)
    unbounded: Unbounded | None = None
    if not free:
        find = partial(find_unbounded, formulation, task.until)
        unbounded = task.kept("common factor", find, None)
    why = (unbounded_text(formulation, loose),) if unbounded is None else simpler_text(unbounded)
    notes = (*outcome.notes, *(free_text(free) or why))
    scaled = in_units(_stated(outcome), formulation)
    items = _intervals(formulation, scaled, (), task.settings.tol)
    items = [_open(item, unbounded, free, alone) for item in items]
    return task.result(formulation, items, replace(outcome, notes=notes, unbounded=unbounded))


def _stated(outcome: Outcome) -> sp.Problem:
    assert outcome.problem is not None
    return outcome.problem


def _by_engine(
    formulation: Formulation,
    task: _Task,
    outcome: Outcome,
    loose: bool,
    points: Sequence[sp.ProvedPoint] = (),
) -> Identification:
    """Settle all ends over one feasible set, in units; points may be known."""
    scaled = in_units(_stated(outcome), formulation)
    free, alone = free_parameters(formulation) if loose else ((), None)
    results = task.timed(
        "engine", lambda: _solve(formulation, _stated(outcome), scaled, task, points)
    )
    if any(found.status is sp.Status.INTERRUPTED for found in results):
        task.deadline.stop()
    notes = dict.fromkeys([*outcome.notes, *(note for found in results for note in found.notes)])
    for found in results:
        for stage, seconds in found.timings.items():
            key = f"engine: {stage}"
            task.timings[key] = task.timings.get(key, 0.0) + seconds
    outcome = replace(outcome, results=results, notes=tuple(notes))
    if any(r.status is sp.Status.INFEASIBLE for r in results):
        spent = sum(task.timings[stage] for stage in ("box", "engine"))
        left = _SEARCH + spent if task.until == inf else task.until - time.monotonic()
        options = task.settings.for_engine("absolute")
        keys = task.timed(
            "conflicting samples", lambda: conflicting_samples(formulation, options, left)
        )
        return task.empty(formulation, replace(outcome, samples=keys))
    items = _intervals(formulation, scaled, results, task.settings.tol)
    items = [_open(item, None, free, alone) for item in items]
    if any(item.status is IntervalStatus.PARTIAL for item in items):
        why = signals_text(formulation, _stated(outcome))
        outcome = replace(outcome, notes=(*outcome.notes, *why))
    return task.result(formulation, items, outcome)


def _open(
    item: ParameterInterval,
    unbounded: Unbounded | None,
    free: tuple[str, ...],
    witness: NDArray[np.float64] | None,
) -> ParameterInterval:
    """An interval with what is proved of parameters that nothing bounds."""
    if item.name in free:
        ends, status = (-inf, inf), IntervalStatus.UNIDENTIFIABLE
        return ParameterInterval(item.name, ends, ends, status, (witness, witness))
    proved = unbounded is not None and item.name in unbounded.names
    return replace(item, status=IntervalStatus.UNBOUNDED) if proved else item


def _solve(
    formulation: Formulation,
    problem: sp.Problem,
    scaled: InUnits,
    task: _Task,
    known: Sequence[sp.ProvedPoint],
) -> tuple[sp.Result, ...]:
    """Bound and attain all ends over one feasible set, in units."""
    settings = task.settings
    units = scaled.units[: len(formulation.parameters)].tolist()
    progress = Progress(
        formulation.parameters, settings.tol, settings.progress, units, task.on_progress
    )
    branch_on = range(len(formulation.parameters)) if coupled(formulation) else None
    if known:
        start, points = known[0].x * scaled.units, list(known)
    else:
        find = partial(_start, formulation, problem, scaled)
        start, points = task.kept("start", find, (None, []))
    engine = settings.for_engine(until=task.deadline.wall_end)
    if task.deadline.cpu_left is not None:
        engine = replace(engine, cpu_limit=task.deadline.cpu_left)
    attained = known or coupled(formulation) or _equations(formulation) > _LONG
    engine = replace(engine, refine="none") if points and attained else engine
    try:
        found = sp.solve_each(
            scaled.problem,
            [scaled.asked(objective)[0] for objective in objectives(formulation)],
            engine,
            start=None if start is None else start / scaled.units,
            repair=Repair(formulation, problem, scaled.units),
            points=points,
            branch_on=branch_on,
            on_progress=progress.report,
        )
        return recheck_results(scaled.problem, _attained(found, points)) if points else tuple(found)
    finally:
        progress.close()


def _attained(results: Sequence[sp.Result], points: Sequence[sp.ProvedPoint]) -> list[sp.Result]:
    """Results that claim the best of known points where time ended before one was adopted."""
    made: list[sp.Result] = []
    for found in results:
        if points and found.attained is None and found.status is not sp.Status.INFEASIBLE:
            best = min((valued(point, found.problem) for point in points), key=lambda p: p.value)
            found = replace(found, attained=best, upper_bound=best.value)
        made.append(found)
    return made


def _start(
    formulation: Formulation, problem: sp.Problem, scaled: InUnits
) -> tuple[NDArray[np.float64] | None, list[sp.ProvedPoint]]:
    """Find a consistent vector, and proved points where the engine would find none.

    Those are ends where rows couple samples, and any point of a long record, whose equations are
    solved one after the other for their newest samples.
    """
    start = first_point(formulation, problem)
    if start is None:
        return None, []
    found = [start]
    if coupled(formulation):
        found = [end.x for end in search_ends(formulation, problem, start)]
    elif _equations(formulation) <= _MANY:
        return start, []
    known = solved_rows(formulation, scaled.problem)
    again = (proved_point(formulation, scaled.problem, x / scaled.units, known) for x in found)
    return start, [point for point in again if point is not None]


def _intervals(
    formulation: Formulation,
    scaled: InUnits,
    results: Sequence[sp.Result],
    tol: float,
) -> list[ParameterInterval]:
    problem = scaled.problem
    points = [_admitted_point(formulation, scaled, r.attained) for r in results]
    attained = any(point is not None for point in points)
    items = []
    for place, name in enumerate(formulation.parameters):
        low, high = float(problem.lower[place]), float(problem.upper[place])
        if not np.any(problem.rows.words == place + 1):
            ends = formulation.problem.lower[place], formulation.problem.upper[place]
            outer = (float(ends[0]), float(ends[1]))
            inner = outer if attained else None
            free = IntervalStatus.UNIDENTIFIABLE if attained else IntervalStatus.PARTIAL
            items.append(ParameterInterval(name, outer, inner, free))
            continue
        if results:
            low = max(low, results[2 * place].lower_bound)
            high = min(high, -results[2 * place + 1].lower_bound)
        inner, witnesses = inner_ends(points, place)
        if inner is not None and problem.lower[place] == problem.upper[place]:
            inner = (low, high)  # whatever point is attained has this value
        item = ParameterInterval(name, (low, high), inner, IntervalStatus.PARTIAL, witnesses)
        if item.gap <= tol * (1.0 + 1e-9) or inner == item.outer:
            item = replace(item, status=IntervalStatus.CERTIFIED)
        items.append(_restored(item, float(scaled.units[place]), scaled.units))
    return items


def _admitted_point(
    formulation: Formulation, scaled: InUnits, point: sp.ProvedPoint | None
) -> sp.ProvedPoint | None:
    """Keep a point that passes the priors' own tests, which may ask for more than their rows."""
    if point is None:
        return None
    p = len(formulation.parameters)
    units = scaled.units[:p]
    return point if admitted(formulation, point.x[:p] * units, point.radius * units) else None


def _restored(
    item: ParameterInterval, unit: float, units: NDArray[np.float64]
) -> ParameterInterval:
    """An interval in z as one in x: powers of two round nothing."""
    low, high = item.witnesses
    return replace(
        item,
        outer=(item.outer[0] * unit, item.outer[1] * unit),
        inner=None if item.inner is None else (item.inner[0] * unit, item.inner[1] * unit),
        witnesses=(
            None if low is None else frozen(low * units),
            None if high is None else frozen(high * units),
        ),
    )
