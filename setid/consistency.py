"""The least noise that explains the data, for a structure and its noise bounds.

All noise bounds are multiplied by one factor s. Below the proved lower end of s no
parameters are consistent with the data; at the upper end some are, with a witness.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import frozen
from setid.data.noise import Noise
from setid.data.record import IOData
from setid.errors import ModelError, NoiseError, SetidError, warns_once
from setid.feasible_points.estimators import least_squares, linf
from setid.feasible_points.fits.output_error import least_largest_error
from setid.feasible_points.fits.separate_denominators import has_separate_denominators
from setid.feasible_points.fits.separate_noise import estimates_of_little_noise
from setid.feasible_points.fits.stable_poles import monic
from setid.feasible_points.witness import Witness, consistent, least_noise
from setid.formulation.formulation import (
    Formulation,
    count_equations,
    formulate,
    settled,
    without_partial_outputs,
)
from setid.formulation.regression import check_channels
from setid.formulation.units import in_units
from setid.minimum_noise.conflicting_samples import conflicting_rows
from setid.minimum_noise.consistency_result import Consistency, assumptions_of
from setid.minimum_noise.denominators import least_output_noise
from setid.minimum_noise.factor import least_factor, refuted_factor, rounding_factor, search_factor
from setid.models.checked_structures import coefficients_of
from setid.models.continuous import without_delta
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
    rows_of_exact_readings,
    scaled_noise,
)
from setid.proofs.parameter_box import ProvedBox, start_of
from sparsepop_py.budget import EARLY, Deadline
from sparsepop_py.executors.threads import while_solving
from sparsepop_py.uncertain_rows.sign_tree import parameter_box
from sparsepop_py.verified.uncertain_rows.sign_tree import ParameterBox

__all__ = ["consistency"]

Reals = NDArray[np.float64]
Samples = tuple[tuple[int, int], ...]  # records, from 1, and samples, from 0
Refuted = tuple[float, ParameterBox | DenominatorCells]  # a factor, and why it is too small
T = TypeVar("T")

_SEARCH, _SEARCH_SHARE = 5.0, 0.6  # seconds for a better estimate, or units of work; of the time
_MANY = 100  # equations: where cones of denominators come first
_LARGE = 200  # equations: where the engine's relaxations are large
_SHARE = 0.85  # of the time, for what refutes denominators
_ROWS, _NEAR = 0.4, 0.2  # of the time, and of the tolerance, where sums of products are unknowns
_MORE = 1.0 + 1e-3  # times what an estimate needs: room to prove that it is consistent
_BEYOND = 2.0  # times a refuted factor, where none is known to be attained
_STARTS = 3  # denominators from which a fit begins
_FIT = 0.5  # of the time left, for a fit of several denominators: its proof needs some


@warns_once
@while_solving
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
    For equation errors this is a linear program, settled exactly if time allows. Otherwise
    emptiness of boxes gives a first bound, and the factor is an unknown that the engine minimises.
    Noise as small as the rounding of the readings is not resolved further. Long records of noisy
    outputs are bounded from below by cones of denominators, which need no box of the parameters.
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
    if not any(np.any(bound > 0) for bound in bounds):
        raise NoiseError("noise: found no positive bound, expected one that can be scaled")
    asked = _Question(data, without_delta(model), noise, listed(priors), settings, deadline)
    formulation = asked.stated(1.0)
    on_sensors = np.any(bounds.output) or np.any(bounds.input)
    linear = formulation.problem.degree <= 1 and not on_sensors
    if (
        linear
        and rows_say_all(formulation)
        and formulation.problem.dimension == len(formulation.parameters)
    ):
        return _exactly(asked, formulation)
    formulation = _of_one_offset(without_partial_outputs(formulation, from_rest=True))
    asked = replace(asked, model=formulation.model)
    never = _by_exact_readings(asked, formulation)
    if never is not None:
        return never
    least = None
    if _is_long(formulation):
        least = _by_denominators(asked)
        whole = least.refuted is not None and not has_separate_denominators(asked.model)
        if whole or count_equations(formulation) > _LARGE or least.is_within(settings.tol):
            return least
    return _by_engine(asked, least)


@dataclass(frozen=True, slots=True, eq=False)
class _Question:
    """Data and what is assumed of them, the noise aside from its factor; settings and limits."""

    data: IOData
    model: Structure
    noise: Noise
    priors: list[Any]
    settings: Options
    deadline: Deadline

    def stated(self, factor: float) -> Formulation:
        """State the problem at one factor."""
        noise = scaled_noise(self.noise.bounds(self.data), factor)
        return formulate(self.data, self.model, noise, self.priors)

    @property
    def rounding(self) -> float:
        """The least factor that is resolved: noise as small as the rounding of the readings."""
        return rounding_factor(self.data, self.noise.bounds(self.data))

    def kept(self, work: Callable[[], T]) -> T | None:
        """Do work within the limits; None where they or the user end it."""
        if self.deadline.stopped:
            return None
        try:
            with self.deadline.kept():
                return work()
        except EARLY as cause:
            self.deadline.ended(cause)
            return None

    def answer(
        self,
        formulation: Formulation,
        scale: tuple[float, float],
        witness: Reals | None,
        problem: sp.Problem,
        *,
        limit: float = 1.0,
        bound: sp.LinearBound | None = None,
        result: sp.Result | None = None,
        box: ProvedBox | None = None,
        refuted: Refuted | None = None,
        samples: Samples = (),
    ) -> Consistency:
        """State what was found, with the parameters of the witness."""
        witness = None if witness is None else frozen(witness)
        return Consistency(
            scale=scale,
            theta=None if witness is None else witness[: len(formulation.parameters)],
            witness=witness,
            formulation=formulation,
            limit=limit,
            problem=problem,
            bound=bound,
            result=result,
            box=box,
            refuted=refuted,
            noise=self.noise,
            assumptions=assumptions_of(formulation, self.noise),
            samples=samples,
        )


class _Explained(NamedTuple):
    """A problem at a factor, all unknowns there, and a witness where these are proved."""

    formulation: Formulation
    limit: float
    x: Reals | None
    witness: Reals | None


def _of_one_offset(formulation: Formulation) -> Formulation:
    """State rows with an offset of the equation, which data bound, where nothing is given of it."""
    found = driven(formulation) if formulation.model.initial == "free" else None
    same = found is not None and len(found.priors) == len(formulation.priors)
    return found if found is not None and same else formulation


# ---- equation errors: one linear program ------------------------------------------------


def _exactly(asked: _Question, formulation: Formulation) -> Consistency:
    problem, rows = linear_problem(formulation), formulation.regression
    assert rows is not None
    found = asked.kept(partial(sp.linear_bounds, problem, [last_variable(problem)]))
    if found is None:
        return asked.answer(formulation, (0.0, inf), None, problem)
    (bound,) = found
    used = [number // 2 for number, _ in bound.multipliers if number < 2 * rows.target.size]
    samples = {(int(rows.record[r]), int(rows.sample[r]) - 1) for r in used}
    witness = None if bound.x is None else bound.x[:-1]
    scale = bound.lower, bound.upper
    held = tuple(sorted(samples))
    return asked.answer(formulation, scale, witness, problem, bound=bound, samples=held)


# ---- readings without noise: no factor is large enough ----------------------------------


def _by_exact_readings(asked: _Question, formulation: Formulation) -> Consistency | None:
    """Prove that rows which no noise enters contradict each other; None where they do not."""
    output, _, equation = asked.noise.bounds(asked.data)
    if not (np.any(output == 0.0) and np.any(equation == 0.0)):
        return None
    exact = rows_of_exact_readings(formulation, asked.noise)
    if exact is None or exact.smoothed is None:
        return None
    search = partial(parameter_box, exact.smoothed, start_of(exact), asked.deadline.end)
    box = asked.kept(search)
    if box is None or not box.empty:
        return None
    problem, found = problem_with_factor(formulation, None), conflicting_rows(exact, box)
    samples = tuple((record, k - 1) for record, k in found)
    refuted = inf, box
    return asked.answer(formulation, (inf, inf), None, problem, refuted=refuted, samples=samples)


# ---- otherwise: the factor is an unknown ------------------------------------------------


def _by_engine(asked: _Question, before: Consistency | None) -> Consistency:
    until, rounding = asked.deadline.end, asked.rounding
    formulation, limit, x, witness = _begun(asked, before)
    high = inf if witness is None else _rounded_up(limit)
    attained = witness is not None
    by_rows = asked.kept(partial(refuted_factor, asked.stated, limit, until, attained))
    refuted = _larger(None if before is None else before.refuted, by_rows)
    low = 0.0 if refuted is None else refuted[0]
    if low >= limit and not attained:
        limit = _BEYOND * low
        formulation, x = asked.stated(limit), None
    box, result = None, None
    if limit > rounding:
        least = partial(
            least_factor, asked.stated, (low, limit), x, asked.settings, until, attained
        )
        formulation, limit, box, result = asked.kept(least) or (formulation, limit, None, None)
    problem = problem_with_factor(formulation, box)
    if result is not None:
        low = max(low, proved_factor(result, limit))
        units = in_units(problem, formulation).units
        if result.attained is not None and admitted_point(formulation, units, result.attained):
            high = attained_factor(formulation, result.attained.value) * limit
            witness = (result.attained.x * units)[:-1]
    return asked.answer(
        formulation,
        (low, high),
        witness,
        problem,
        limit=limit,
        result=result,
        box=box,
        refuted=refuted,
        samples=_conflicting(asked, refuted),
    )


def _begun(asked: _Question, before: Consistency | None) -> _Explained:
    """A problem that explains the data as far as is known, perhaps with less noise."""
    if before is None or before.witness is None:
        begun = _explaining(asked)
    else:
        formulation = asked.stated(before.limit)
        begun = _Explained(formulation, before.limit, before.witness, before.witness)
    until = asked.deadline.end
    if _is_boxed(begun.formulation, until):
        return begun
    search = partial(
        search_factor, begun.formulation, begun.x, Deadline.before(until, _SEARCH, _SEARCH_SHARE)
    )
    found = asked.kept(search)
    if found is None or not found.share < 1.0:
        return begun
    limit = max(begun.limit * found.share * _MORE, asked.rounding)
    less = asked.stated(limit)
    witness = asked.kept(partial(_witness, less, found.x))
    if witness is None and begun.witness is not None:
        return begun
    return _Explained(less, limit, found.x, witness)


def _rounded_up(factor: float) -> float:
    return factor * (1.0 + 1e-15)


# ---- long records of noisy outputs: cones of denominators --------------------------------


def _is_long(formulation: Formulation) -> bool:
    """Check that a record is long, and of noisy outputs alone."""
    if count_equations(formulation) <= _MANY:
        return False
    outputs = range(formulation.model.outputs)
    return all(output_rows(formulation, output) is not None for output in outputs)


def _by_denominators(asked: _Question) -> Consistency:
    given = asked.stated(1.0)
    refuted, best = _refuted_denominators(given, asked.settings, asked.deadline)
    formulation, limit, _, witness = _explaining(asked, best)
    high = inf if witness is None else _rounded_up(limit)
    scale = 0.0 if refuted is None else refuted[0], high
    problem = problem_with_factor(formulation, None)
    return asked.answer(formulation, scale, witness, problem, limit=limit, refuted=refuted)


def _refuted_denominators(
    formulation: Formulation, settings: Options, deadline: Deadline
) -> tuple[Refuted | None, tuple[Reals, ...]]:
    """The largest factor that an output refutes, and denominators to begin from."""
    refuted, outputs = None, formulation.model.outputs
    share, tol = _SHARE, 0.5 * settings.tol
    if has_separate_denominators(formulation.model):  # rows say less than the structure
        share, tol = _ROWS, _NEAR * settings.tol
    best: tuple[Reals, ...] = ()
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


def _conflicting(asked: _Question, refuted: Refuted | None) -> Samples:
    """Records, from 1, and samples, from 0, whose rows refute a factor."""
    if refuted is None or isinstance(refuted[1], DenominatorCells):
        return ()
    found = conflicting_rows(asked.stated(refuted[0]), refuted[1])
    return tuple((record, k - 1) for record, k in found)


def _is_boxed(formulation: Formulation, until: float) -> bool:
    """Check that some rows bound the parameters."""
    rows = formulation.smoothed
    if rows is None:
        return True
    box = parameter_box(rows, start_of(formulation), until)
    return bool(np.all(np.isfinite(box.lower) & np.isfinite(box.upper)))


def _explaining(asked: _Question, denominators: Iterable[Reals] = ()) -> _Explained:
    """Prove that an estimate explains the data with a little more noise than it needs."""
    first: _Explained | None = None
    for level, x in _estimates(asked, asked.stated(1.0), denominators):
        limit = max(level * _MORE, asked.rounding)
        formulation = asked.stated(limit)
        witness = asked.kept(partial(_witness, formulation, x))
        found = _Explained(formulation, limit, x if witness is None else witness, witness)
        if witness is not None:
            return found
        first = first or found
    if first is not None:
        return first
    limit = max(1.0, asked.rounding)
    return _Explained(asked.stated(limit), limit, None, None)


def _estimates(
    asked: _Question, formulation: Formulation, denominators: Iterable[Reals] = ()
) -> Iterator[tuple[float, Reals]]:
    """Factors that estimates need, with all unknowns; the least one first."""
    data = asked.data
    if has_separate_denominators(formulation.model) and not np.any(np.isnan(data.u)):
        yield from _estimates_apart(asked, formulation)
        return
    found: list[tuple[float, Reals]] = []
    until = asked.deadline.end
    estimates: list[Callable[[], Reals]] = [
        lambda: linf(data, formulation.model).theta,
        lambda: least_squares(data, formulation.model).theta,
    ]
    output = formulation.noise.bounds(data).output
    if np.any(output > 0):
        fit = partial(least_largest_error, data, formulation.model, output, until=until)
        begun = [partial(fit, denominator) for denominator in denominators]
        estimates = [*begun[:1], fit, *begun[1:], *estimates]
    for estimate in estimates:
        if len(found) > 1 and time.monotonic() > until:
            break
        try:
            witness = asked.kept(partial(_explained, formulation, estimate, until))
        except (ModelError, ValueError):
            continue
        if witness is None:
            break
        if np.isfinite(witness.level):
            found.append((witness.level, witness.x))
    yield from sorted(found, key=lambda pair: pair[0])


def _estimates_apart(asked: _Question, formulation: Formulation) -> Iterator[tuple[float, Reals]]:
    """The same of several denominators; later ones need more noise, but are easier to prove."""
    estimates = estimates_of_little_noise(formulation, asked.deadline.part(_FIT).end)
    while (theta := asked.kept(partial(next, estimates, None))) is not None:
        witness = asked.kept(partial(_clipped, formulation, theta))
        if witness is not None and np.isfinite(witness.level):
            yield witness.level, witness.x


def _explained(
    formulation: Formulation, estimate: Callable[[], Reals], until: float
) -> Witness | None:
    """Find the least noise with which an estimate, moved into its priors, explains the data."""
    return _clipped(formulation, _poles_inside(formulation, estimate(), until))


def _clipped(formulation: Formulation, theta: Reals) -> Witness:
    """Find the least noise of parameters that are moved within their bounds."""
    low, high = formulation.problem.lower[: theta.size], formulation.problem.upper[: theta.size]
    return least_noise(formulation, np.clip(theta, low, high))


def _poles_inside(formulation: Formulation, theta: Reals, until: float) -> Reals:
    """Draw poles into the unit disc where a prior wants them there, and fit all else again."""
    model, data = formulation.model, formulation.data
    bound = formulation.noise.bounds(data)[0]
    if not isinstance(model, TransferFunction) or model.outputs > 1 or not np.any(bound > 0):
        return theta
    names = coefficients_of(model, 1, 1).denominator
    if not any(names in prior.stable(model) for prior in formulation.priors):
        return theta
    a = np.append(1.0, theta[[model.parameters.index(name) for name in names]])
    drawn = monic(a, stable=True)
    if drawn is None or np.array_equal(drawn, a):
        return theta
    return least_largest_error(data, model, bound, drawn[1:], until)


def _witness(formulation: Formulation, x: Reals) -> Reals | None:
    """Prove that the parameters in some unknowns are consistent."""
    return consistent(formulation, x[: len(formulation.parameters)], x)
