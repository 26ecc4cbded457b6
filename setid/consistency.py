"""The least noise that explains the data, for a structure and its noise bounds.

All noise bounds are multiplied by one factor s. Below the proved lower end of s no
parameters are consistent with the data; at the upper end some are, with a witness.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from math import inf
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.noise import Noise
from setid.data.record import IOData
from setid.errors import ModelError, NoiseError, SetidError, warns_once
from setid.feasible_points.estimators import least_squares, linf
from setid.feasible_points.fits.output_error import least_largest_error
from setid.feasible_points.fits.separate_denominators import has_separate_denominators
from setid.feasible_points.witness import Witness, consistent, least_noise
from setid.formulation.formulation import (
    Formulation,
    count_equations,
    formulate,
    settled,
    without_partial_outputs,
)
from setid.formulation.lifting import DRIVEN, LIFTED
from setid.formulation.regression import check_channels
from setid.formulation.units import in_units
from setid.minimum_noise.conflicting_samples import conflicting_rows
from setid.minimum_noise.consistency_result import Consistency
from setid.minimum_noise.denominators import least_output_noise
from setid.minimum_noise.factor import least_factor, refuted_factor, rounding_factor, search_factor
from setid.minimum_noise.separate_noise import separate_noise
from setid.models.continuous import ContinuousTransferFunction, without_delta
from setid.models.equations import Structure
from setid.models.lti import TransferFunction
from setid.options import Options, checked_options, with_executor
from setid.priors.base import Prior, listed
from setid.proofs.denominators.denominator_cells import DenominatorCells
from setid.proofs.denominators.output_rows import output_rows
from setid.proofs.driven import driven
from setid.proofs.existence import rows_say_all
from setid.proofs.least_noise.noise_scale import (
    admitted_point,
    attained_factor,
    last_variable,
    linear_problem,
    problem_with_factor,
    proved_factor,
    scaled_noise,
)
from setid.proofs.parameter_box import start_of
from sparsepop_py.budget import EARLY, Deadline
from sparsepop_py.solvers.threads import one_thread
from sparsepop_py.uncertain_rows.sign_tree import parameter_box
from sparsepop_py.verified.uncertain_rows.sign_tree import ParameterBox

__all__ = ["consistency"]

Refuted = tuple[float, ParameterBox | DenominatorCells]  # a factor, and why it is too small
T = TypeVar("T")

_MULTIPLIED = (
    "denominators are multiplied out, which keeps every consistent parameter vector; the attained "
    "factor may be that of one whose denominators have a common zero"
)
_DRIVEN = "an offset drives the equation: it is that of the output times the denominators at q = 1"
_SEARCH = 5.0  # seconds for a better estimate
_MANY = 100  # equations: where cones of denominators come first
_LARGE = 200  # equations: where the engine's relaxations are large
_SHARE = 0.85  # of the time, for what refutes denominators
_ROWS, _NEAR = 0.4, 0.2  # of the time, and of the tolerance, where sums of products are unknowns
_STARTS = 3  # denominators from which a fit begins


@warns_once
@one_thread
def consistency(
    data: IOData,
    model: Structure,
    noise: Noise,
    priors: Iterable[Prior | sp.Constraint] | Prior | sp.Constraint = (),
    options: Options | None = None,
    executor: Executor | None = None,
) -> Consistency:
    """Find the least factor on the noise bounds with which the data are consistent.

    Parameters
    ----------
    data : IOData
    model : Structure
    noise : Noise
        Bounds alone; at least one must be positive.
    priors : iterable of priors and ``sp`` constraints
    options : Options, optional
        ``tol`` is the gap of the factor, relative to it; 60 seconds when left out.
    executor : concurrent.futures.Executor, optional
        Processes the nodes of branch and bound, as for :func:`setid.identify`, and refutes
        several cones of denominators at once.

    Returns
    -------
    Consistency

    Raises
    ------
    NoiseError
        If the noise has constraints over the record, or is zero.
    SetidError
        If the parts do not fit together.

    Notes
    -----
    For equation errors this is a linear program and settled exactly. Otherwise emptiness of
    boxes gives a first bound, and the factor is an unknown that the engine minimises. Noise as
    small as the rounding of the readings is not resolved further. Long records of noisy outputs
    are bounded from below by cones of denominators, which need no box of the parameters.
    A discretisation error bound ``delta`` of a continuous-time model counts as output noise: the
    factor multiplies the noise bounds and ``delta`` together.
    Of several denominators with an offset the rows have the offset of the equation in place of that
    of the output, unless a prior speaks of it; ``formulation.model`` and ``assumptions`` say so.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> found = setid.consistency(data, setid.TransferFunction(1, 1), setid.Noise(output=0.5))
    >>> found.explains, bool(found.verify())
    (True, True)
    """
    settings = checked_options(options, Options(time_limit=60.0))
    if not isinstance(noise, Noise):
        raise SetidError(f"noise: found {type(noise).__name__}, expected setid.Noise")
    check_channels(data, model)
    settings, deadline = with_executor(settings, executor), settings.limits()
    if noise.constraints:
        raise NoiseError("noise: found constraints over the record, expected bounds alone")
    model, noise = settled(data, model, noise)
    bounds = noise.bounds(data)
    model = without_delta(model)
    if not any(np.any(bound > 0) for bound in bounds):
        raise NoiseError("noise: found no positive bound, expected one that can be scaled")
    given = listed(priors)
    formulation = formulate(data, model, scaled_noise(bounds, 1.0), given)
    linear = formulation.problem.degree <= 1 and not np.any(bounds[0]) and not np.any(bounds[1])
    if (
        linear
        and rows_say_all(formulation)
        and formulation.problem.dimension == len(formulation.parameters)
    ):
        return _exactly(formulation, noise)
    formulation = _of_one_offset(without_partial_outputs(formulation, from_rest=True))
    model = formulation.model
    least = None
    if _is_long(formulation):
        least = _by_denominators(data, model, noise, given, settings, deadline)
        whole = least.refuted is not None and not has_separate_denominators(model)
        if whole or count_equations(formulation) > _LARGE or least.is_within(settings.tol):
            return least
    return _by_engine(data, model, noise, given, settings, deadline, least)


def _kept(deadline: Deadline, work: Callable[[], T]) -> T | None:
    """Do work within the limits; None where they or the user end it."""
    if deadline.stopped:
        return None
    try:
        with deadline.kept():
            return work()
    except EARLY as cause:
        deadline.ended(cause)
        return None


def _of_one_offset(formulation: Formulation) -> Formulation:
    """State rows with an offset of the equation, which data bound, where nothing is given of it."""
    found = driven(formulation) if formulation.model.initial == "free" else None
    same = found is not None and len(found.priors) == len(formulation.priors)
    return found if found is not None and same else formulation


def _assumptions(formulation: Formulation, noise: Noise) -> tuple[str, ...]:
    model, texts = formulation.model, [*noise.assumptions, *formulation.assumptions]
    if noise.model_error and isinstance(model, ContinuousTransferFunction):  # with delta as noise
        given = replace(model, delta=noise.model_error)
        said = {f"the system is a {model!r}": f"the system is a {given!r}"}
        said[model.between_samples(0.0)] = given.between_samples(noise.model_error)
        texts = [said.get(text, text) for text in texts]
    if isinstance(model, TransferFunction) and model.form == DRIVEN:
        texts.append(_DRIVEN)
    if isinstance(model, TransferFunction) and model.form in (LIFTED, DRIVEN):
        texts.append(_MULTIPLIED)
    return tuple(dict.fromkeys(texts))


# ---- equation errors: one linear program ------------------------------------------------


def _exactly(formulation: Formulation, noise: Noise) -> Consistency:
    problem = linear_problem(formulation)
    factor = last_variable(problem)
    (bound,) = sp.linear_bounds(problem, [factor])
    rows, p = formulation.regression, len(formulation.parameters)
    assert rows is not None
    used = [number // 2 for number, _ in bound.multipliers if number < 2 * rows.target.size]
    samples = {(int(rows.record[r]), int(rows.sample[r]) - 1) for r in used}
    x = bound.x
    return Consistency(
        scale=(bound.lower, bound.upper),
        theta=None if x is None else x[:p],
        witness=None if x is None else x[:-1],
        formulation=formulation,
        limit=1.0,
        problem=problem,
        bound=bound,
        result=None,
        box=None,
        refuted=None,
        noise=noise,
        assumptions=_assumptions(formulation, noise),
        samples=tuple(sorted(samples)),
    )


# ---- otherwise: the factor is an unknown ------------------------------------------------


def _by_engine(
    data: IOData,
    model: Structure,
    noise: Noise,
    priors: list[Any],
    settings: Options,
    deadline: Deadline,
    before: Consistency | None = None,
) -> Consistency:
    bounds, until = noise.bounds(data), deadline.end

    def stated(factor: float) -> Formulation:
        return formulate(data, model, scaled_noise(bounds, factor), priors)

    if before is None or before.witness is None:
        limit, x = _explaining(data, stated(1.0), deadline)
    else:
        limit, x = before.limit, before.witness
    rounding = rounding_factor(data, bounds)
    limit = max(limit, rounding)
    formulation, theta, witness, high = stated(limit), None, None, inf
    if not _is_boxed(formulation, until):  # perhaps with less noise than the estimate needs
        less = partial(search_factor, formulation, x, min(until, time.monotonic() + _SEARCH))
        found = _kept(deadline, less)
        if found is not None and found.share < 1.0:
            limit, x = max(limit * found.share * (1.0 + 1e-3), rounding), found.x
            formulation = stated(limit)
    if x is not None:
        witness = _kept(deadline, partial(_witness, formulation, x))
    if witness is not None:
        theta, high = witness[: len(formulation.parameters)], limit * (1.0 + 1e-15)
    by_rows = _kept(deadline, partial(refuted_factor, stated, limit, until))
    refuted = _larger(None if before is None else before.refuted, by_rows)
    low = 0.0 if refuted is None else refuted[0]
    box, result = None, None
    if limit > rounding:
        least = partial(least_factor, stated, (low, limit), x, settings, until)
        found_least = _kept(deadline, least) or (formulation, limit, None, None)
        formulation, limit, box, result = found_least
    problem = problem_with_factor(formulation, box)
    if result is not None:
        low = max(low, proved_factor(result, limit))
        units = in_units(problem, formulation).units
        if result.attained is not None and admitted_point(formulation, units, result.attained):
            z = result.attained.x * units
            high, witness = attained_factor(formulation, result.attained.value) * limit, z[:-1]
            theta = witness[: len(formulation.parameters)]
    return Consistency(
        scale=(low, high),
        theta=theta,
        witness=witness,
        formulation=formulation,
        limit=limit,
        problem=problem,
        bound=None,
        result=result,
        box=box,
        refuted=refuted,
        noise=noise,
        assumptions=_assumptions(formulation, noise),
        samples=_conflicting(stated, refuted),
    )


# ---- long records of noisy outputs: cones of denominators --------------------------------


def _is_long(formulation: Formulation) -> bool:
    """Check that a record is long, and of noisy outputs alone."""
    if count_equations(formulation) <= _MANY:
        return False
    outputs = range(formulation.model.outputs)
    return all(output_rows(formulation, output) is not None for output in outputs)


def _by_denominators(
    data: IOData,
    model: Structure,
    noise: Noise,
    priors: list[Any],
    settings: Options,
    deadline: Deadline,
) -> Consistency:
    bounds = noise.bounds(data)

    def stated(factor: float) -> Formulation:
        return formulate(data, model, scaled_noise(bounds, factor), priors)

    given = stated(1.0)
    refuted, best = _refuted_denominators(given, settings, deadline)
    formulation, limit, theta, witness, high = given, 1.0, None, None, inf
    for level, x in _estimates(data, given, deadline, best):
        limit = max(level * (1.0 + 1e-3), rounding_factor(data, bounds))
        formulation = stated(limit)
        witness = _kept(deadline, partial(_witness, formulation, x))
        if witness is not None:
            theta, high = witness[: len(formulation.parameters)], limit * (1.0 + 1e-15)
            break
    return Consistency(
        scale=(0.0 if refuted is None else refuted[0], high),
        theta=theta,
        witness=witness,
        formulation=formulation,
        limit=limit,
        problem=problem_with_factor(formulation, None),
        bound=None,
        result=None,
        box=None,
        refuted=refuted,
        noise=noise,
        assumptions=_assumptions(formulation, noise),
        samples=(),
    )


def _refuted_denominators(
    formulation: Formulation, settings: Options, deadline: Deadline
) -> tuple[Refuted | None, tuple[NDArray[np.float64], ...]]:
    """The largest factor that an output refutes, and denominators to begin from."""
    refuted, outputs = None, formulation.model.outputs
    share, tol = _SHARE, 0.5 * settings.tol
    if has_separate_denominators(formulation.model):  # rows say less than the structure
        share, tol = _ROWS, _NEAR * settings.tol
    best: tuple[NDArray[np.float64], ...] = ()
    for output in range(outputs):
        rows = output_rows(formulation, output)
        assert rows is not None
        executor = None if settings.engine is None else settings.engine.executor
        part = deadline.part(share / (outputs - output))
        found = least_output_noise(rows, output, tol, part, executor)
        if found.cells is not None and (refuted is None or found.factor > refuted[0]):
            refuted = found.factor, found.cells
        best = found.best[:_STARTS] if outputs == 1 else ()
    return refuted, best


def _larger(one: Refuted | None, two: Refuted | None) -> Refuted | None:
    """Take what refutes more."""
    return max((each for each in (one, two) if each), key=lambda each: each[0], default=None)


def _conflicting(
    stated: Callable[[float], Formulation], refuted: Refuted | None
) -> tuple[tuple[int, int], ...]:
    """Records and samples, counted from 0, whose rows refute a factor."""
    if refuted is None or isinstance(refuted[1], DenominatorCells):
        return ()
    found = conflicting_rows(stated(refuted[0]), refuted[1])
    return tuple((record, k - 1) for record, k in found)


def _is_boxed(formulation: Formulation, until: float) -> bool:
    """Check that some rows bound the parameters."""
    rows = formulation.smoothed
    if rows is None:
        return True
    box = parameter_box(rows, start_of(formulation), until)
    return bool(np.all(np.isfinite(box.lower) & np.isfinite(box.upper)))


def _explaining(
    data: IOData, formulation: Formulation, deadline: Deadline
) -> tuple[float, NDArray[np.float64] | None]:
    """A factor with which some estimate is consistent, a little more than its least one."""
    found = _estimates(data, formulation, deadline)
    if not found:
        return 1.0, None
    level, x = found[0]
    return level * (1.0 + 1e-3), x


def _estimates(
    data: IOData,
    formulation: Formulation,
    deadline: Deadline,
    denominators: Iterable[NDArray[np.float64]] = (),
) -> list[tuple[float, NDArray[np.float64]]]:
    """Factors that estimates need, with all unknowns; the least one first."""
    found: list[tuple[float, NDArray[np.float64]]] = []
    until = deadline.end
    estimates: list[Callable[[], NDArray[np.float64]]] = [
        lambda: linf(data, formulation.model).theta,
        lambda: least_squares(data, formulation.model).theta,
    ]
    output = formulation.noise.bounds(data)[0]
    if has_separate_denominators(formulation.model) and not np.any(np.isnan(data.u)):
        found_apart = separate_noise(formulation, until)
        estimates = [] if found_apart is None else [lambda: found_apart[0]]
    elif np.any(output > 0):
        fit = partial(least_largest_error, data, formulation.model, output, until=until)
        begun = [partial(fit, denominator) for denominator in denominators]
        estimates = [*begun[:1], fit, *begun[1:], *estimates]
    for estimate in estimates:
        if len(found) > 1 and time.monotonic() > until:
            break

        try:
            witness = _kept(deadline, partial(_explained, formulation, estimate))
        except (ModelError, ValueError):
            continue
        if witness is None:
            break
        if np.isfinite(witness.level):
            found.append((witness.level, witness.x))
    return sorted(found, key=lambda pair: pair[0])


def _explained(
    formulation: Formulation, estimate: Callable[[], NDArray[np.float64]]
) -> Witness | None:
    """Find the least noise with which an estimate, moved into its priors, explains the data."""
    theta = estimate()
    low, high = formulation.problem.lower[: theta.size], formulation.problem.upper[: theta.size]
    return least_noise(formulation, np.clip(theta, low, high))


def _witness(formulation: Formulation, x: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Prove that the parameters in some unknowns are consistent."""
    return consistent(formulation, x[: len(formulation.parameters)], x)
