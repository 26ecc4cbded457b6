"""Controllers straight from data: the set of all that make the closed loop the reference model."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from operator import mul
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from setid.control.classes import Controller, Fixed, is_class
from setid.control.engine import (
    Box,
    DataError,
    FrozenMapping,
    Identification,
    IntervalStatus,
    IOData,
    ModelError,
    Noise,
    NoiseError,
    Options,
    ParameterInterval,
    Prior,
    PriorError,
    SetidError,
    TransferFunction,
    entries_of,
    frozen,
)
from setid.control.parameters.parameter_set import (
    ParameterSet,
    consistent_set,
    identified,
    tightened,
)
from setid.control.parameters.ratios import ratio_range, series_times
from setid.control.parameters.rows import NoisyRows, noisy_rows
from setid.control.parameters.sums import best_fit, least_noise_fit, within_doubles
from setid.control.references import (
    Matching,
    check_matching,
    closed_loop,
    gain_of_one,
    loop_function,
    with_unit_gain,
)
from setid.control.transfer import Transfer, as_transfer, simulate_exactly
from setid.minimum_noise.conflicting_samples import samples_listed
from setid.priors.stability import rounded_up
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.budget import Deadline, LimitReached

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Design", "Refuted", "design"]

Reals = NDArray[np.float64]
_MEMBERS = "raise the order, change the reference model, or raise the noise bound"
_TAKEN = (
    "the reference model is what the closed loop is to be on this experiment",
    "the target signal M / (1 - M) r is that of the doubles next to it",
)
_SECONDS = 30.0  # where options say nothing
_SUMS = 0.5  # of the time left, at most, for sums of rows


@dataclass(frozen=True, slots=True, eq=False)
class Refuted:
    """An order of which no controller is consistent, with the proof.

    Parameters
    ----------
    order : int
    result : Identification
        Empty, with the samples that contradict each other; ``result.verify()`` checks it.
    """

    order: int
    result: Identification

    def __repr__(self) -> str:
        samples = samples_listed(self.result.samples, self.result.formulation.data.records)
        return f"<order {self.order}: proved empty{f' by samples {samples}' if samples else ''}>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Design(ReadOnly):
    """All controllers of a class that are consistent with an experiment and a reference model.

    Parameters
    ----------
    intervals : mapping of str to ParameterInterval
        Of the controller's parameters: ``outer`` proved, ``inner`` attained.
    result : Identification or None
        The identification of the controller from the measured output to the target signal;
        of the last order that was tried where every one is refuted.
    refuted : tuple of Refuted
        Orders below, with their proofs of emptiness.
    fixed : Fixed
        The class of the result.
    parameters : ParameterSet or None
        A polytope that contains every consistent parameter vector.
    reference : Transfer
    data : IOData
        The experiment.
    target : (N,) float
        The signal that the controller is to give.
    fit : (p,) float
        Parameters of ``fixed.model`` with least squares of the noise.
    boxed : bool
        Whether the identification began in a box that sums of rows had proved.
    seconds : mapping of str to float
    """

    intervals: Mapping[str, ParameterInterval]
    result: Identification
    refuted: tuple[Refuted, ...]
    fixed: Fixed
    parameters: ParameterSet | None
    reference: Transfer
    data: IOData
    target: Reals
    fit: Reals
    boxed: bool
    seconds: Mapping[str, float]

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Assumptions of the intervals, without boxes that follow from the data."""
        known = "prior: Box(" if self.boxed else "\0"
        return tuple(t for t in self.result.assumptions if not t.startswith(known))

    @property
    def empty(self) -> bool:
        """True if it is proved that no controller is consistent."""
        return self.result.empty

    @property
    def order(self) -> int:
        """Order of the controllers, the known part of the denominator included."""
        return max(
            self.fixed.model.na[0][0] + len(self.fixed.known) - 1, self.fixed.model.nb[0][0] - 1
        )

    @property
    def centre(self) -> Transfer:
        """The controller in the middle of the proved intervals; an integrator stays exact.

        Raises
        ------
        SetidError
            If the set is empty or an interval is not finite.
        """
        self._require_members()
        ends = np.array([item.outer for item in self.intervals.values()])
        if not np.all(np.isfinite(ends)):
            raise SetidError(
                "intervals: found infinite ends, expected finite ones: the set says nothing of "
                "some parameters; take a lower noise bound, more samples or a lower order"
            )
        return self._of(ends.mean(axis=1))

    @property
    def feasible(self) -> Transfer:
        """A controller that is consistent with the experiment.

        Raises
        ------
        SetidError
            If the set is empty or no member is known.
        """
        self._require_members()
        try:
            values = self.result.feasible
        except SetidError:  # the engine had no time for a point: the least noise may give one
            found = self._least_noise()
            if found is None:
                raise
            values = found
        return self.fixed.controller([Fraction(float(t)) for t in values], self.data.Ts)

    def _least_noise(self) -> Reals | None:
        """Parameters with the least largest noise, where they are proved to be consistent."""
        formulation = self.result.formulation
        if np.isnan(formulation.data.u).any():
            return None
        model, noise = self.fixed.model, formulation.noise
        rows = noisy_rows(formulation.data, model, noise, self.fixed.integrators)
        theta = _with_least_noise(rows)
        return None if theta is None or self.result.consistent(theta) is None else theta

    @property
    def estimate(self) -> Transfer:
        """The controller that needs the least noise in the sense of least squares.

        It is there where the set is not bounded, too; nothing is proved of it.
        """
        return self.fixed.controller([Fraction(float(t)) for t in self.fit], self.data.Ts)

    @property
    def help(self) -> tuple[str, ...]:
        """Sentences on what keeps intervals open; none where all are certified."""
        if self.empty:
            return (f"no controller of this class is consistent: {_MEMBERS}",)
        loose = [n for n, i in self.intervals.items() if not np.all(np.isfinite(i.outer))]
        if loose:
            lower = self._lower_order()
            if lower:
                return (
                    f"a controller of order {lower} is consistent, too: with factors that cancel "
                    f"there are others of order {lower + 1}, and nothing bounds "
                    f"{', '.join(loose)}; take order {lower} or less",
                )
            return (
                f"the data give no finite bounds of {', '.join(loose)}: the noise is strong for "
                "this class; take a lower order, a longer record or a lower noise bound",
            )
        partial = [n for n, i in self.intervals.items() if i.status is IntervalStatus.PARTIAL]
        if partial and self.result.status is IntervalStatus.CERTIFIED:
            return (
                f"the outer ends of {', '.join(partial)} are proved; controllers were sought at "
                f"the ends of {', '.join(self.result.intervals)} alone, which are certified, so "
                "that more time changes nothing",
            )
        if partial:
            return (
                "the outer ends are proved, but not attained within the tolerance: give more time "
                "(options)",
            )
        return ()

    def _lower_order(self) -> int:
        """The order below, where one of its controllers is proved consistent; else 0."""
        model, bound = self.fixed.model, self.result.formulation.noise
        na, nb = model.na[0][0], model.nb[0][0]
        record = self.result.formulation.data
        free = (*self.fixed.known, na, nb - 1) == (Fraction(1), na, na)  # LTI: all orders alike
        if not free or na <= max(self.fixed.integrators, 1) or np.isnan(record.u).any():
            return 0
        rows = noisy_rows(record, TransferFunction(na - 1, nb - 1), bound, self.fixed.integrators)
        theta = _with_least_noise(rows)
        if theta is None:
            return 0
        padded = np.concatenate([theta[: na - 1], [0.0], theta[na - 1 :], [0.0]])
        return 0 if self.result.consistent(padded) is None else na - 1

    def _require_members(self) -> None:
        if self.empty:
            raise SetidError(
                f"controller: found an empty set, expected consistent controllers; {_MEMBERS}"
            )

    def _of(self, values: Reals) -> Transfer:
        exact = [Fraction(float(v)) for v in values]
        theta = [
            sum((Fraction(float(c)) * v for c, v in zip(row, exact, strict=True)), Fraction(0))
            for row in self.fixed.basis
        ]
        return self.fixed.controller(theta, self.data.Ts)

    def to_control(self) -> Any:
        """Convert the central controller to a model of python-control."""
        return self.centre.to_control()

    def ideal_form(self) -> dict[str, tuple[float, float]]:
        """Bound K, Ti and Td of K (1 + 1/(Ti s) + Td s), for PID classes.

        Raises
        ------
        ModelError
            If the class is no PID.
        SetidError
            If the set of parameters is empty or not finite.
        """
        if self.fixed.names[:2] != ("Kp", "Ki"):
            raise ModelError("form: found a class without Kp and Ki, expected control.PID")
        self._require_members()
        if self.parameters is None:
            raise SetidError("form: found no finite set of parameters, expected one")
        rows = _inverse(self.fixed.basis)
        found = {"K": self.intervals["Kp"].outer}
        found["Ti"] = ratio_range(self.parameters, rows[0], rows[1])
        if len(rows) > 2:
            found["Td"] = ratio_range(self.parameters, rows[2], rows[0])
        return found

    def series_form(self) -> dict[str, tuple[float, float]]:
        """Bound Ti and Td of K (1 + 1/(Ti s)) (1 + Td s), for PID classes.

        NaN where the two zeros may be complex, so that there is no series form.
        """
        ideal = self.ideal_form()
        times = series_times(ideal["Ti"], ideal.get("Td", (0.0, 0.0)))
        return {"Ti": times[0], "Td": times[1]}

    # ---- closed loops -------------------------------------------------------------------

    def closed_loop(self, plant: Any, controller: Transfer | None = None) -> Transfer:
        """Compute K P / (1 + K P) with a known plant, for simulations."""
        known = as_transfer(plant, self.data.Ts, "plant")
        own = controller if controller is not None else self.centre
        return closed_loop(as_transfer(own, self.data.Ts, "controller"), known)

    def matching(self, plant: Any, controller: Transfer | None = None) -> Matching:
        """Compare the closed loop with the reference model; see :func:`check_matching`."""
        own = controller if controller is not None else self.centre
        return check_matching(plant, own, self.reference)

    def simulate(self, plant: Any, r: ArrayLike) -> Reals:
        """Simulate the output (N,) of the closed loop with the central controller, from rest."""
        return self.closed_loop(plant).simulate(r)

    def plot(self, plant: Any, ax: Axes | None = None) -> Axes:
        """Draw the step response of the closed loop beside the reference model's."""
        from setid.control.plots import plot_matching

        return plot_matching(self.matching(plant), ax)

    def summary(self) -> str:
        """Summarise refutations, intervals, what keeps them open, and their assumptions."""
        lines = [repr(item) for item in self.refuted]
        lines += [repr(item) for item in self.intervals.values()]
        lines += [f"help: {text}" for text in self.help]
        lines += [f"assumed: {text}" for text in self.assumptions]
        return "\n".join(lines)

    def __repr__(self) -> str:
        state = "empty" if self.empty else f"{len(self.intervals)} parameters"
        return f"<Design: order {self.order}, {state}, {len(self.refuted)} orders refuted>"


def design(
    data: IOData,
    reference_model: Any,
    controller: Controller,
    noise: Noise | ArrayLike,
    priors: Iterable[Prior] = (),
    options: Options | None = None,
) -> Design:
    """Find all controllers of a class that match a reference model on an experiment.

    With s = M / (1 - M) r, a controller K gives the closed loop M on this experiment if
    s = K y, and y is the measured output less its noise: an identification of K with noise on
    its input only.

    Parameters
    ----------
    data : IOData
        The experiment on the plant alone: input r, measured output.
    reference_model : Transfer, (numerator, denominator) or python-control model
    controller : Controller
        Such as ``LTI(3)`` or ``PID()``. Without an order, orders are raised until the set is
        not proved empty.
    noise : Noise or array_like
        Bound of the output's noise: one, or one a sample, as ``Noise(output=noise)`` reads it.
    priors : iterable of priors
        On the parameters of the identification.
    options : Options, optional
        Of the identification; a time limit of 30 seconds when left out. Limits in time are for the
        whole call, with all orders and sums of rows; a stage under way may take longer.

    Returns
    -------
    Design

    Raises
    ------
    SetidError
        If the parts do not fit together.

    References
    ----------
    V. Cerone, D. Regruto, M. Abuabiah, "Direct data-driven control design through
    set-membership errors-in-variables identification techniques", American Control
    Conference 2017, 388-393.

    Examples
    --------
    >>> import numpy as np, setid
    >>> from setid import control
    >>> P, M = control.Transfer([0, 1], [1, -0.5]), control.Transfer([0, 0.4], [1, -0.6])
    >>> r = np.random.default_rng(0).uniform(-1, 1, 40)
    >>> data = setid.IOData(r, P.simulate(r))
    >>> found = control.design(data, M, control.LTI(1), setid.Noise(output=1e-4))
    >>> control.check_matching(P, found.centre, M).stable
    True
    """
    if not is_class(controller):
        raise ModelError(
            f"controller: found {controller!r:.60}, expected an object such as LTI(3) or PID()"
        )
    bound = _input_noise(noise)
    reference, missed = with_unit_gain(_checked(data, reference_model))
    taken = (*_TAKEN, gain_of_one(missed)) if missed else _TAKEN
    if options is not None and not isinstance(options, Options):
        raise ModelError(f"options: found {type(options).__name__}, expected setid.Options")
    settings = options or Options(time_limit=_SECONDS, progress=False)
    known = tuple(entries_of(priors, "priors", "a list of priors", PriorError))
    refuted: list[Refuted] = []
    limits = settings, settings.limits()
    orders = controller.orders or (None,)
    for order in orders:
        fixed = controller.fixed(data.Ts, order)
        found = _one(data, reference, fixed, bound, known, limits, tuple(refuted), taken)
        if not found.empty or order is None:
            return found
        refuted.append(Refuted(order, found.result))
    return found


def _input_noise(noise: Noise | ArrayLike) -> Noise:
    """The output's noise of the experiment as that of the controller's input."""
    given = noise if isinstance(noise, Noise) else Noise(output=noise)
    for field in ("input", "equation"):
        if np.any(np.asarray(getattr(given, field)) > 0):
            raise NoiseError(
                f"noise.{field}: found a bound > 0, expected the output's noise alone: the input "
                "of the experiment is known, and s = K y has no equation error"
            )
    if given.constraints:
        raise NoiseError("noise.constraints: found sets over the record, expected bounds alone")
    found = Noise(input=given.output, relative=given.relative)
    texts = tuple(text.replace("output noise", "measured output") for text in given.assumptions)
    object.__setattr__(found, "assumptions", texts)
    return found


def _checked(data: IOData, reference_model: Any) -> Transfer:
    if not isinstance(data, IOData):
        raise DataError(f"data: found {type(data).__name__}, expected IOData")
    if data.inputs != 1 or data.outputs != 1 or data.records != 1:
        raise DataError(
            f"data: found {data.inputs} inputs, {data.outputs} outputs, {data.records} records, "
            "expected one of each"
        )
    if np.isnan(data.u).any():
        raise DataError("data.u: found missing samples, expected all of them")
    reference = as_transfer(reference_model, data.Ts, "reference_model")
    loop_function(reference)
    return reference


def _one(
    data: IOData,
    reference: Transfer,
    fixed: Fixed,
    noise: Noise,
    priors: tuple[Prior, ...],
    limits: tuple[Options, Deadline],
    refuted: tuple[Refuted, ...],
    taken: tuple[str, ...],
) -> Design:
    """Design for one order: the set by sums of rows, then by the engine, in the time left."""
    begin = time.process_time()
    settings, deadline = limits
    loop = loop_function(reference)
    signal = data.u.ravel().tolist()
    wanted = simulate_exactly(loop, signal)
    filtered = Transfer(loop.numerator, loop.denominator, data.Ts) * Transfer(
        fixed.known, [1], data.Ts
    )
    record = IOData(
        data.y,
        simulate_exactly(filtered, signal),
        data.Ts,
        assumptions=(*data.assumptions, *taken),
        u_range=data.y_range,
    )
    found = None
    if not np.isnan(data.y).any():
        until = deadline.part(_SUMS).end
        found = consistent_set(record, fixed.model, noise, fixed.integrators, until=until)
    sums = time.process_time() - begin
    left = settings.within(deadline)
    result = identified(record, fixed.model, noise, found, fixed.integrators, left, priors=priors)
    boxed = found is not None and not found.empty and not any(isinstance(p, Box) for p in priors)
    if not result.empty:
        found = _after(record, fixed, noise, found, result, deadline.end)
    spent = {"sums of rows": sums, "in all": time.process_time() - begin}
    return Design(
        intervals=FrozenMapping(_intervals(fixed, result, found, settings.tol)),
        result=result,
        refuted=refuted,
        fixed=fixed,
        parameters=found,
        reference=reference,
        data=data,
        target=frozen(wanted),
        fit=frozen(_fit(record, fixed, noise)),
        boxed=boxed,
        seconds=FrozenMapping(spent),
    )


def _fit(record: IOData, fixed: Fixed, noise: Noise) -> Reals:
    """Parameters with least squares of the noise; NaN where samples or doubles are missing."""
    if np.isnan(record.u).any():
        return np.full(len(fixed.model.parameters), np.nan)
    rows = noisy_rows(record, fixed.model, noise, fixed.integrators)
    fit = within_doubles(lambda: rows.offset + rows.basis @ best_fit(rows).origin)
    return np.full(rows.offset.size, np.nan) if fit is None else np.asarray(fit, np.float64)


def _with_least_noise(rows: NoisyRows) -> Reals | None:
    """Parameters that need the least largest noise; None where numbers leave the doubles."""

    def fitted() -> Reals:
        x = least_noise_fit(rows, best_fit(rows).origin)
        return np.asarray(rows.offset + rows.basis @ x, np.float64)

    return within_doubles(fitted)


def _after(
    record: IOData,
    fixed: Fixed,
    noise: Noise,
    found: ParameterSet | None,
    result: Identification,
    until: float,
) -> ParameterSet | None:
    """The polytope within the engine's intervals."""
    ends = np.array([item.outer for item in result.intervals.values()]).T
    if found is None and np.all(np.isfinite(ends)) and not np.isnan(record.u).any():
        box = ends[0], ends[1]
        known = record, fixed.model, noise, fixed.integrators
        return consistent_set(*known, box=box, until=until)
    if found is None or found.empty:
        return found
    try:
        return tightened(found, result, until)
    except LimitReached:
        return found


def _inverse(basis: Reals) -> list[list[Fraction]]:
    """Invert a small matrix by elimination in rationals."""
    size = len(basis)
    rows = [
        [Fraction(float(c)) for c in row] + [Fraction(int(i == j)) for j in range(size)]
        for i, row in enumerate(basis)
    ]
    for i in range(size):
        pivot = next(r for r in range(i, size) if rows[r][i])
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [c / rows[i][i] for c in rows[i]]
        for r in range(size):
            if r != i and rows[r][i]:
                rows[r] = [c - rows[r][i] * d for c, d in zip(rows[r], rows[i], strict=True)]
    return [row[size:] for row in rows]


def _intervals(
    fixed: Fixed, result: Identification, found: ParameterSet | None, tol: float
) -> dict[str, ParameterInterval]:
    """Proved and attained ranges of the user's parameters."""
    plain = np.array_equal(fixed.basis, np.eye(len(fixed.basis)))
    if result.empty or (found is None and plain):
        pairs = zip(fixed.names, result.intervals.values(), strict=True)
        plain_ones = {
            name: ParameterInterval(name, i.outer, i.inner, i.status, i.witnesses)
            for name, i in pairs
        }
        return _with_known_pole(fixed, plain_ones)
    exact = _inverse(fixed.basis)
    count = len(exact)
    low, high = np.full(count, -np.inf), np.full(count, np.inf)
    if found is not None:
        low, high = found.exact_ranges(exact)
    known = [[Fraction(value) for value in theta] for theta in result.attained.tolist()]
    intervals = {}
    for place, name in enumerate(fixed.names):
        outer = (float(low[place]), float(high[place]))
        inner: tuple[float, float] | None = None
        witnesses: tuple[Reals | None, Reals | None] = (None, None)
        if plain:
            old = result.intervals[fixed.model.parameters[place]]
            outer = max(outer[0], old.outer[0]), min(outer[1], old.outer[1])
            inner, witnesses = old.inner, old.witnesses
        elif known:
            values = [sum(map(mul, exact[place], theta), Fraction()) for theta in known]
            inner = rounded_up(min(values)), -rounded_up(-max(values))
        status = _status(outer, inner, tol)
        intervals[name] = ParameterInterval(name, outer, inner, status, witnesses)
    return _with_known_pole(fixed, intervals)


def _with_known_pole(
    fixed: Fixed, intervals: dict[str, ParameterInterval]
) -> dict[str, ParameterInterval]:
    """Settle the denominator of order one with an integrator: its coefficient is -1."""
    first, *others = intervals.values()
    attained = [i for i in others if i.inner is not None and i.inner[0] <= i.inner[1]]
    if (fixed.integrators, fixed.model.na) != (1, ((1,),)) or not attained:
        return intervals
    ends = (-1.0, -1.0)
    witnesses = attained[0].witnesses
    known = ParameterInterval(first.name, ends, ends, IntervalStatus.CERTIFIED, witnesses)
    return {**intervals, first.name: known}


def _status(
    outer: tuple[float, float], inner: tuple[float, float] | None, tol: float
) -> IntervalStatus:
    if inner is None or not np.all(np.isfinite(outer)):
        return IntervalStatus.PARTIAL
    open_ = max(inner[0] - outer[0], outer[1] - inner[1])
    closed = open_ <= tol * (inner[1] - inner[0])
    return IntervalStatus.CERTIFIED if closed else IntervalStatus.PARTIAL
