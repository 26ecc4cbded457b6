"""From a record to proved parameter intervals.

    formulate -> linear?  exact linear programs
              -> else     box from the data -> the engine, all ends over one feasible set

Linear problems (equation errors, exact regressors) are settled without rounding. Otherwise
the box of the parameters comes from the data alone and is part of the proof; the engine
then narrows all 2 p ends together.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from fractions import Fraction
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import frozen
from setid.data.noise import Noise
from setid.data.record import IOData
from setid.errors import SetidError
from setid.feasible_points.inner_ends import inner_ends
from setid.feasible_points.search import attained_ends, checked, coupled
from setid.feasible_points.start import first_point, repair
from setid.feasible_set.start import find_box
from setid.formulation.formulation import Formulation, formulate
from setid.formulation.units import InUnits, in_units
from setid.identifiability.common_factor import Endless, endless_by
from setid.identifiability.equivalence import unidentifiable
from setid.identifiability.unnormalised import reference_model, refuse
from setid.minimum_noise.conflicting_samples import driving_rows, driving_samples
from setid.minimum_noise.discretisation import remark, with_estimate
from setid.models.block import BlockStructured
from setid.models.equations import Structure
from setid.models.lti import TransferFunction
from setid.options import Options
from setid.priors.base import Prior
from setid.proofs.existence import proved_point
from setid.proofs.free_parameters import idle_parameters
from setid.proofs.intervals import IntervalStatus, ParameterInterval
from setid.proofs.parameter_box import ProvedBox, objectives, problem_on_box
from setid.result.assembling import empty_result, endless_text, free_text, result_of, unbounded_text
from setid.result.identification import Identification
from setid.result.progress import Progress

__all__ = ["identify"]

_DIRECT = (
    "partial outputs have no bounds from the data: the denominators are multiplied out, which "
    "keeps every consistent parameter vector (and may keep more)"
)
_SEARCH = 10.0  # seconds, and what the proof took, to find samples that contradict each other
_FEW = 60  # unknowns up to which linear problems are solved in rationals


def identify(
    data: IOData,
    model: Structure,
    noise: Noise,
    priors: Iterable[Prior | sp.Constraint] | Prior | sp.Constraint = (),
    options: Options | None = None,
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

    Returns
    -------
    Identification
        An empty feasible set, unbounded intervals and open gaps are statuses of the result,
        never exceptions. Ctrl-C ends the work; what is proved by then is returned.

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
    b0 in [1.91667, 2.1093], attained [1.91667, 2.1093], certified
    """
    settings = options or Options()
    if not isinstance(settings, Options):
        raise SetidError(f"options: found {type(settings).__name__}, expected setid.Options")
    if isinstance(model, BlockStructured) and isinstance(data, IOData):
        if settings.unidentifiable == "report" and (affected := unidentifiable(model)):
            return _reported(data, model, noise, priors, settings, set(affected))
        refuse(model)
    until, timings = settings.deadline(), dict[str, float]()
    model, noise, given = _timed(
        timings, "delta", lambda: with_estimate(data, model, noise, priors, until)
    )
    formulation = _timed(timings, "formulate", lambda: formulate(data, model, noise, given))
    return _with_remarks(_settle(formulation, settings, timings, until))


def _settle(
    formulation: Formulation, settings: Options, timings: dict[str, float], until: float
) -> Identification:
    problem = formulation.problem
    if problem.degree <= 1 and problem.dimension <= _FEW:
        return _linear(formulation, settings, timings)
    direct = _direct(formulation)
    if direct is not None:
        return _identify(direct, settings, timings, until, (_DIRECT,))
    return _identify(formulation, settings, timings, until, ())


def _with_remarks(found: Identification) -> Identification:
    middle = np.array([interval.centre for interval in found.intervals.values()])
    told = "" if found.empty else remark(found.formulation, middle)
    return replace(found, notes=(*found.notes, told)) if told else found


def _reported(
    data: IOData,
    model: BlockStructured,
    noise: Noise,
    priors: Any,
    settings: Options,
    affected: set[str],
) -> Identification:
    """Intervals of what does not depend on a normalisation."""
    formulation = formulate(data, model, noise, priors)
    reference = reference_model(data, model, noise, formulation.priors)
    found = identify(data, reference, noise, formulation.priors, settings)
    if found.empty:
        return replace(empty_result(formulation, settings, found.timings), reference=found)
    items = []
    for name in formulation.parameters:
        free = ParameterInterval(name, (-inf, inf), None, IntervalStatus.UNIDENTIFIABLE)
        items.append(free if name in affected else found.intervals[name])
    items = [replace(item, witnesses=(None, None)) for item in items]
    note = f"{', '.join(sorted(affected))} are not unique; the rest is that of {reference!r}"
    return result_of(
        formulation,
        settings,
        found.timings,
        items,
        notes=(note, *found.notes),
        reference=found,
    )


def _direct(formulation: Formulation) -> Formulation | None:
    """The same data with denominators multiplied out, where partial outputs have no bounds."""
    model, n = formulation.model, len(formulation.parameters)
    problem = formulation.problem
    open_ = np.isinf(problem.lower[n:]) | np.isinf(problem.upper[n:])
    if not isinstance(model, TransferFunction) or not np.any(open_) or model.form == "direct":
        return None
    other = replace(model, form="direct")
    return formulate(formulation.data, other, formulation.noise, formulation.priors)


def _identify(
    formulation: Formulation,
    settings: Options,
    timings: dict[str, float],
    until: float,
    notes: tuple[str, ...],
) -> Identification:
    """Box first, then the engine on it, in one time."""
    box = _timed(timings, "box", lambda: find_box(formulation, until))
    if box is not None and box.empty:
        left = min(_SEARCH, until - time.monotonic())
        driving = driving_rows(formulation, box) or driving_samples(formulation, None, left)
        return empty_result(formulation, settings, timings, box, samples=driving, notes=notes)
    if box is not None and box.cut_short:
        notes = (*notes, "time ended in the search for a box from the data: give more time")
    return _engine(formulation, settings, timings, until, box, notes)


def _timed(timings: dict[str, float], stage: str, work: Callable[[], Any]) -> Any:
    begin = time.process_time()
    try:
        return work()
    finally:
        timings[stage] = timings.get(stage, 0.0) + time.process_time() - begin


# ---- linear problems --------------------------------------------------------------------


def _linear(
    formulation: Formulation, settings: Options, timings: dict[str, float]
) -> Identification:
    problem, asked = formulation.problem, objectives(formulation)
    bounds = _timed(timings, "linear programs", lambda: tuple(sp.linear_bounds(problem, asked)))
    if bounds[0].status is sp.Status.INFEASIBLE:
        rows = formulation.rows
        used = [number for number, _ in bounds[0].multipliers if number < len(rows.origin)]
        samples = {(int(rows.record[r]), int(rows.sample[r])) for r in used if rows.sample[r]}
        found = tuple(sorted(samples))
        return empty_result(formulation, settings, timings, bounds=bounds, samples=found)
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
    return result_of(formulation, settings, timings, items, bounds=bounds)


def _is_line(problem: sp.Problem, bound: sp.LinearBound) -> bool:
    """Whether no row changes along the ray, so that the whole line is feasible."""
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


# ---- the engine -------------------------------------------------------------------------


def _engine(
    formulation: Formulation,
    settings: Options,
    timings: dict[str, float],
    until: float,
    box: ProvedBox | None,
    notes: tuple[str, ...],
) -> Identification:
    problem = problem_on_box(formulation, box)
    p = len(formulation.parameters)
    scaled = in_units(problem, formulation)
    idle = np.array([i for i in range(p) if not np.any(problem.rows.words == i + 1)], int)
    loose = np.flatnonzero(np.isinf(problem.lower[:p]) | np.isinf(problem.upper[:p]))
    parts: dict[str, Any] = {"box": box, "problem": problem}
    results: tuple[sp.Result, ...] = ()
    endless: Endless | None = None
    free, alone = idle_parameters(formulation) if loose.size else ((), None)
    blocks = isinstance(formulation.model, BlockStructured)
    if loose.size and (box is not None or blocks):
        if not free:
            endless = _timed(timings, "common factor", lambda: endless_by(formulation, until))
            parts["endless"] = endless
        why = (unbounded_text(formulation, loose),) if endless is None else endless_text(endless)
        parts["notes"] = (*notes, *(free_text(free) or why))
    else:
        results = _timed(
            timings, "engine", lambda: _solved(formulation, problem, scaled, settings, until)
        )
        told = (note for found in results for note in found.notes)
        parts["notes"] = tuple(dict.fromkeys([*notes, *told]))
        for found in results:
            for stage, seconds in found.timings.items():
                timings[f"engine: {stage}"] = timings.get(f"engine: {stage}", 0.0) + seconds
    parts["results"] = results
    if any(r.status is sp.Status.INFEASIBLE for r in results):
        parts.pop("box")
        spent = sum(timings[stage] for stage in ("box", "engine"))
        left = _SEARCH + spent if until == inf else until - time.monotonic()
        parts["samples"] = _timed(
            timings,
            "driving samples",
            lambda: driving_samples(formulation, settings.for_engine("absolute"), left),
        )
        return empty_result(formulation, settings, timings, box, **parts)
    items = _intervals(formulation, scaled, results, settings.tol, set(idle.tolist()))
    items = [_open(item, endless, free, alone) for item in items]
    return result_of(formulation, settings, timings, items, **parts)


def _open(
    item: ParameterInterval,
    endless: Endless | None,
    free: tuple[str, ...],
    witness: NDArray[np.float64] | None,
) -> ParameterInterval:
    """An interval with what is proved of parameters that nothing bounds."""
    if item.name in free:
        ends, status = (-inf, inf), IntervalStatus.UNIDENTIFIABLE
        return ParameterInterval(item.name, ends, ends, status, (witness, witness))
    proved = endless is not None and item.name in endless.names
    return replace(item, status=IntervalStatus.UNBOUNDED) if proved else item


def _solved(
    formulation: Formulation,
    problem: sp.Problem,
    scaled: InUnits,
    settings: Options,
    until: float,
) -> tuple[sp.Result, ...]:
    """All ends over one feasible set, in units."""
    progress = Progress(formulation.parameters, settings.tol, settings.progress)
    start = first_point(formulation, problem)
    points: list[sp.ProvedPoint] = []
    branch_on = None
    if coupled(formulation):
        branch_on = range(len(formulation.parameters))
        ends = [] if start is None else attained_ends(formulation, problem, start)
        again = (proved_point(formulation, scaled.problem, end.x / scaled.units) for end in ends)
        points = [point for point in again if point is not None]
    engine = settings.for_engine(until=until)
    engine = replace(engine, refine="none") if points else engine
    try:
        found = sp.solve_each(
            scaled.problem,
            [scaled.asked(objective)[0] for objective in objectives(formulation)],
            engine,
            start=None if start is None else start / scaled.units,
            repair=repair(formulation, problem, scaled.units),
            points=points,
            branch_on=branch_on,
            on_progress=progress.told,
        )
        return checked(scaled.problem, found) if points else tuple(found)
    finally:
        progress.close()


def _intervals(
    formulation: Formulation,
    scaled: InUnits,
    results: Sequence[sp.Result],
    tol: float,
    idle: set[int],
) -> list[ParameterInterval]:
    problem, attained = scaled.problem, [r.attained for r in results if r.attained is not None]
    items = []
    for place, name in enumerate(formulation.parameters):
        low, high = float(problem.lower[place]), float(problem.upper[place])
        if place in idle:
            ends = formulation.problem.lower[place], formulation.problem.upper[place]
            outer = (float(ends[0]), float(ends[1]))
            inner = outer if attained else None
            free = IntervalStatus.UNIDENTIFIABLE if attained else IntervalStatus.PARTIAL
            items.append(ParameterInterval(name, outer, inner, free))
            continue
        if results:
            low = max(low, results[2 * place].lower_bound)
            high = min(high, -results[2 * place + 1].lower_bound)
        inner, witnesses = inner_ends(attained, results, place)
        if inner is not None and problem.lower[place] == problem.upper[place]:
            inner = (low, high)  # whatever point is attained has this value
        item = ParameterInterval(name, (low, high), inner, IntervalStatus.PARTIAL, witnesses)
        if item.gap <= tol * (1.0 + 1e-9) or inner == item.outer:
            item = replace(item, status=IntervalStatus.CERTIFIED)
        items.append(_restored(item, float(scaled.units[place]), scaled.units))
    return items


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
