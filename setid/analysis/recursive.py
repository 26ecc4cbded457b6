"""Set-membership identification sample by sample, with a proved box and bounded cost.

Each sample adds an uncertain row. A limited number of samples is retained, each with the few before
it that its rows need, as a small record of its own. What is claimed rests on retained samples
alone, so that :meth:`Recursive.verify` states the problem again from them and checks the
evidence as for any record. A row that is left out can only make the set larger.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from concurrent.futures import Executor
from copy import copy
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import sparsepop_py as sp
from setid.data.checks import FrozenMapping, frozen, natural, number, real_array
from setid.data.noise import Noise
from setid.data.record import IOData
from setid.errors import DataError, ModelError, NoiseError, SetidError, SetidWarning
from setid.feasible_set.start import find_box
from setid.formulation.formulation import Formulation, check_priors, formulate
from setid.html import section
from setid.html import table as html_table
from setid.models.checked_structures import check_structure, regression_of
from setid.models.continuous import at_rate, interval_of
from setid.models.equations import Structure
from setid.models.general import from_unknown_start
from setid.options import check_executor
from setid.priors.base import Prior, listed
from setid.priors.checked_priors import bounds_of
from setid.proofs.evidence import Evidence, Verification
from setid.proofs.existence import rows_say_all
from setid.proofs.intervals import IntervalStatus, ParameterInterval
from setid.proofs.parameter_box import objectives, problem_on_box, start_of
from setid.proofs.verification import verify
from sparsepop_py.executors.dispatch import map_in_order
from sparsepop_py.executors.threads import silent
from sparsepop_py.verified.arithmetic.display import rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Recursive", "UpdateCost"]

Reals = NDArray[np.float64]
_BOX_SECONDS = 5.0  # for one box from uncertain rows
_MOST_LINEAR = 60  # unknowns up to which linear problems are solved in rationals
_NEAR = -1e-12  # relative: rows that end this far from the box are redundant, rounding included
_RETAINED = 60  # samples, where no limit is given and few parameters need no more
_KINDS = ("output", "input", "equation")
_TRACE = 1000  # past boxes kept for the picture


@dataclass(frozen=True, slots=True)
class UpdateCost:
    """Cost of updates so far.

    Parameters
    ----------
    samples : int
        That were given.
    solved : int
        At which bounds were computed anew: those that may cut the box, and all as long as none
        is left out.
    retained : int
        Samples on which the claims may rest now; at most the limit.
    last, largest, mean : float
        CPU seconds of an update.

    Examples
    --------
    >>> import setid
    >>> setid.Recursive(setid.TransferFunction(1, 1, 1), setid.Noise(equation=0.1)).cost.samples
    0
    """

    samples: int = 0
    solved: int = 0
    retained: int = 0
    last: float = 0.0
    largest: float = 0.0
    mean: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class _Window:
    """A sample with those before it that its rows need."""

    sample: int
    u: Reals
    y: Reals


class Recursive:
    """A proved outer box of the parameters, updated sample by sample.

    Parameters
    ----------
    model : Structure
        With a regression form. What comes before the first sample is unknown, whatever
        ``initial`` says.
    noise : Noise
        Bounds, one number or one a channel.
    priors : iterable of priors and ``sp`` constraints
        Their bounds hold from the beginning. Without a prior, intervals are infinite until the
        samples bound them.
    limit : int, optional
        Largest number of samples that are retained (the complexity); at least 4 p^2. When left
        out, the larger of 60 and 4 p^2.
    window : int, optional
        Forget older samples than this many: what is claimed then holds for parameters that are
        consistent with the equations of the last ``window`` samples, which reach back to
        readings before these. All samples count when left out. Where outputs have equations of
        several lags, more than the difference of these.
    Ts : float, optional
        Sampling time; that of a continuous-time structure, or 1, when left out.
    executor : concurrent.futures.Executor, optional
        For equation errors: solves the linear programs of the ends, one a task. It pays where a
        program takes longer than a task's overhead, with many parameters and a large ``limit``.

    Raises
    ------
    ModelError
        If the structure has no regression form.
    NoiseError
        If bounds are one a sample, or the noise has constraints over the record.
    PriorError
        If a prior speaks of other parameters.

    Notes
    -----
    For equation errors with linear priors the set is a polytope, bounded by exact linear programs
    over the rows that were retained. As long as ``complete`` no sample was left out, and the
    attained ends are proved too. As long as ``exact`` rows that were left out were found redundant,
    in floating-point arithmetic with a margin, and no reading was missing, so that the box is that
    of the whole set. For noisy sensors the box is what the uncertain rows prove one by one.

    References
    ----------
    E. Fogel, Y. F. Huang, "On the value of information in system identification", Automatica 18
    (1982) 229-238. H. Piet-Lahanier, E. Walter, "Exact recursive characterization of feasible
    parameter sets in the linear case", Math. and Computers in Simulation 32 (1990) 495-504.

    Examples
    --------
    >>> import setid
    >>> online = setid.Recursive(setid.TransferFunction(na=1, nb=1), setid.Noise(equation=0.5))
    >>> for u, y in zip([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875]):
    ...     _ = online.update(u, y)
    >>> online.intervals["a1"]
    a1 in [-0.523256, -0.345333], attained [-0.523255, -0.345334], certified
    >>> online.inconsistent_at is None, bool(online.verify())
    (True, True)
    """

    def __init__(
        self,
        model: Structure,
        noise: Noise,
        priors: Iterable[Prior | sp.Constraint] | Prior | sp.Constraint = (),
        *,
        limit: int | None = None,
        window: int | None = None,
        Ts: float | None = None,
        executor: Executor | None = None,
    ) -> None:
        self.Ts = number(interval_of(model, Ts), "Ts", DataError)
        if not 0 < self.Ts < inf:
            raise DataError(f"Ts: found {Ts!r}, expected a positive number")
        self.model = _from_unknown(model if Ts is None else at_rate(model, self.Ts))
        self.noise = _check_noise(noise, self.model)
        self.priors = tuple(listed(priors))
        check_priors(self.priors, self.model)
        self._given = _bounds_of(self.priors, self.model)
        check_executor(executor)
        least = 4 * len(self.model.parameters) ** 2
        retained = max(_RETAINED, least) if limit is None else limit
        self.limit = natural(retained, "limit", SetidError, least=least)
        self._executor = executor
        lags = [equation.lag for equation in regression_of(self.model)]
        self._lag, self._early = max(lags), max(lags) - min(lags)
        # equations of a shorter lag have rows at samples before the one that is kept
        least = 1 + self._early
        self.window = None if window is None else natural(window, "window", SetidError, least=least)
        self.restart()

    # ---- state --------------------------------------------------------------------------

    def restart(self) -> None:
        """Forget all samples and begin anew, as after a fault."""
        self.inconsistent_at: int | None = None
        self.exact = True
        self.complete = True
        self.cost = UpdateCost()
        self._recent: list[tuple[Reals, Reals]] = []
        self._kept: list[_Window] = []
        self._claims: list[tuple[Evidence, frozenset[int]]] = []
        self._spent = 0.0
        self._trace: list[tuple[int, Reals]] = []

    @property
    def samples(self) -> int:
        """Number of samples that were given."""
        return self.cost.samples

    @property
    def retained(self) -> tuple[int, ...]:
        """Numbers, from 0, of the samples that are retained."""
        return tuple(kept.sample for kept in self._kept)

    @property
    def intervals(self) -> Mapping[str, ParameterInterval]:
        """Proved intervals now; all are empty once inconsistency is proved."""
        names = self.model.parameters
        if self.inconsistent_at is not None:
            empty = IntervalStatus.EMPTY
            return FrozenMapping({n: ParameterInterval(n, (inf, -inf), None, empty) for n in names})
        return FrozenMapping({name: self._interval(name) for name in names})

    def _interval(self, name: str) -> ParameterInterval:
        found = [evidence.intervals[name] for evidence, _ in self._claims]
        if not found:
            outer = self._given.get(name, (-inf, inf))
            free = self.complete and not self.priors  # only then any value is consistent
            status = IntervalStatus.UNBOUNDED if free else IntervalStatus.PARTIAL
            return ParameterInterval(name, outer, None, status)
        if self.complete and len(found) == 1:
            return found[0]
        outer = max(i.outer[0] for i in found), min(i.outer[1] for i in found)
        return ParameterInterval(name, outer, None, IntervalStatus.PARTIAL)

    @property
    def box(self) -> tuple[Reals, Reals]:
        """Lower and upper ends of the intervals, each (p,)."""
        ends = np.array([item.outer for item in self.intervals.values()])
        return ends[:, 0], ends[:, 1]

    # ---- updates ------------------------------------------------------------------------

    def update(self, u: ArrayLike, y: ArrayLike) -> bool:
        """Take one sample, or several in their order; where it raises, it takes none.

        Parameters
        ----------
        u : float, (nu,) or (K, nu) array_like
            For one input also (K,).
        y : float, (ny,) or (K, ny) array_like
            For one output also (K,). NaN marks missing readings.

        Returns
        -------
        bool
            False once it is proved that no parameters are consistent. Later samples are then
            counted and left aside, until :meth:`restart`.

        Raises
        ------
        DataError
            If shapes do not fit.
        """
        inputs = _rows_of(u, "u", self.model.inputs)
        outputs = _rows_of(y, "y", self.model.outputs)
        if len(inputs) != len(outputs):
            raise DataError(
                f"u, y: found {len(inputs)} and {len(outputs)} samples, expected equal numbers"
            )
        before = dict(vars(self))  # each is replaced, none is changed in place
        try:
            for one, other in zip(inputs, outputs, strict=True):
                begin = time.process_time()
                solved = self._one(one, other)
                self._count(time.process_time() - begin, solved)
        except BaseException:  # Ctrl-C too
            vars(self).update(before)
            raise
        return self.inconsistent_at is None

    def _count(self, seconds: float, solved: bool) -> None:
        self._spent += seconds
        count = self.cost.samples + 1
        self.cost = UpdateCost(
            samples=count,
            solved=self.cost.solved + int(solved),
            retained=len(self._kept),
            last=seconds,
            largest=max(self.cost.largest, seconds),
            mean=self._spent / count,
        )

    def _one(self, u: Reals, y: Reals) -> bool:
        """Take one sample; tell whether bounds were computed."""
        k = self.cost.samples
        self._recent = [*self._recent[-self._lag :], (u, y)] if self._lag else [(u, y)]
        if self.inconsistent_at is not None:
            return False
        lost = self._forget(k)
        if len(self._recent) <= self._lag:
            return lost and self._bound(k)
        new = _Window(
            k, np.array([pair[0] for pair in self._recent]), np.array([p[1] for p in self._recent])
        )
        if np.any(np.isnan(new.u)) or np.any(np.isnan(new.y)):
            self.exact = self.complete = False
            return lost and self._bound(k)
        room = self.complete and len(self._kept) < self.limit
        cuts = lost or room or self._cuts(new)
        if cuts or self.window is not None:
            self._kept = [*self._kept, new]
        else:
            self.complete = False
        solved = cuts and self._bound(k)
        self._drop()
        return solved

    def _forget(self, k: int) -> bool:
        """Drop samples that are older than the window; tell whether a claim rested on them."""
        if self.window is None:
            return False
        first = k - self.window + 1  # no row of an earlier sample counts
        old = {kept.sample for kept in self._kept if kept.sample - self._early < first}
        if any(sample >= first for sample in old):
            self.exact = self.complete = False
        self._kept = [kept for kept in self._kept if kept.sample not in old]
        before = len(self._claims)
        self._claims = [(claim, used) for claim, used in self._claims if not used & old]
        return len(self._claims) < before

    def _stated(self, windows: list[_Window]) -> Formulation:
        """The formulation of retained samples, each a record of its own."""
        size = self._lag + 1
        data = _quiet(
            lambda: IOData(
                np.concatenate([w.u for w in windows]),
                np.concatenate([w.y for w in windows]),
                self.Ts,
                starts=np.arange(len(windows)) * size,
            )
        )
        noise = _spread(self.noise, data.samples)
        return _quiet(lambda: formulate(data, self.model, noise, self.priors))

    def _cuts(self, new: _Window) -> bool:
        """Check whether a row of a sample may exclude a part of the box."""
        low, high = self.box
        if not np.all(np.isfinite(low) & np.isfinite(high)):
            return True
        excess = self._excess([new], low, high)
        return bool(np.any(excess > _NEAR))

    def _excess(self, windows: list[_Window], low: Reals, high: Reals) -> Reals:
        """Relative reach of each row beyond its bound over the box, (W,)."""
        rows = self._stated(windows).regression
        if rows is None:
            return np.full(len(windows), inf)
        centre, half = (low + high) / 2, (high - low) / 2
        away = np.abs(rows.target + rows.regressors @ centre)
        # the noise that theta allows is least where its size is least
        least = np.where((low <= 0) & (high >= 0), 0.0, np.minimum(np.abs(low), np.abs(high)))
        bound = rows.radius + rows.radii @ least
        reach = away + np.abs(rows.regressors) @ half - bound
        found = np.full(len(windows), -inf)
        size = np.maximum(np.abs(low), np.abs(high))
        scale = np.abs(rows.target) + np.abs(rows.regressors) @ size + rows.radius + 1e-300
        np.maximum.at(found, rows.record - 1, reach / scale)
        return found

    # ---- bounds -------------------------------------------------------------------------

    def _bound(self, k: int) -> bool:
        """Bound the parameters anew over the retained samples."""
        if not self._kept:
            return False
        formulation = self._stated(self._kept)
        problem, p = formulation.problem, len(formulation.parameters)
        linear = problem.degree <= 1 and problem.dimension <= max(_MOST_LINEAR, p)
        linear = linear and rows_say_all(formulation)
        claim, used = _linear(formulation, self._executor) if linear else _boxed(formulation)
        self.exact = self.exact and linear
        samples = frozenset(self._kept[record].sample for record in used)
        if claim.empty:
            self.inconsistent_at = k
            self._claims = [(claim, samples)]
            return True
        self._claims = (
            [(claim, samples)] if linear else self._best([*self._claims, (claim, samples)])
        )
        low, high = self.box
        if np.any(low > high):  # two claims that contradict each other
            self.inconsistent_at = k
        self._trace = [*self._trace[-_TRACE:], (k, np.array([low, high]))]
        return True

    def _best(
        self, claims: list[tuple[Evidence, frozenset[int]]]
    ) -> list[tuple[Evidence, frozenset[int]]]:
        """Claims that give the best end of some parameter, later ones first among equals."""
        kept: set[int] = set()
        for name in self.model.parameters:
            ends = [evidence.intervals[name].outer for evidence, _ in claims]
            kept.add(max(range(len(ends)), key=lambda i: (ends[i][0], i)))
            kept.add(max(range(len(ends)), key=lambda i: (-ends[i][1], i)))
        return [claims[i] for i in sorted(kept)]

    def _drop(self) -> None:
        """Keep as many samples as the limit allows; those that claims rest on stay."""
        if len(self._kept) <= self.limit:
            return
        needed = frozenset().union(*(used for _, used in self._claims))
        low, high = self.box
        finite = np.all(np.isfinite(low) & np.isfinite(high))
        excess = self._excess(self._kept, low, high) if finite else np.zeros(len(self._kept))
        order = sorted(
            range(len(self._kept)),
            key=lambda i: (self._kept[i].sample in needed, excess[i], self._kept[i].sample),
        )
        gone = set(order[: len(self._kept) - self.limit])
        # a row that nowhere cuts the box is redundant; with a window it may count again later
        if any(excess[i] > _NEAR or not finite for i in gone) or self.window is not None:
            self.exact = False
        self.complete = False
        self._kept = [kept for i, kept in enumerate(self._kept) if i not in gone]

    # ---- what comes of it ---------------------------------------------------------------

    def verify(self) -> Verification:
        """Check the claims again from the retained samples, without any solver.

        Returns
        -------
        Verification
            True where each interval, or the inconsistency, follows from retained samples.
        """
        if reason := self._foreign():
            return Verification(False, reason)
        for evidence, _ in self._claims:
            verdict = _quiet(lambda evidence=evidence: verify(evidence))
            if not verdict:
                return verdict
        if self.inconsistent_at is not None and not any(e.empty for e, _ in self._claims):
            if not self._claims or not np.any(np.greater(*_common(e for e, _ in self._claims))):
                return Verification(False, "inconsistency does not follow")
        return Verification(True)

    def _foreign(self) -> str:
        """Say why claims are not about structure, noise and priors; empty where they are."""
        if self._given != _bounds_of(self.priors, self.model):
            return "the bounds before the first equation are not those of the priors"
        for evidence, _ in self._claims:
            known = evidence.formulation
            noise = _spread(self.noise, known.data.samples)
            again = _quiet(
                lambda data=known.data, noise=noise: formulate(data, self.model, noise, self.priors)
            )
            if known.data.Ts != self.Ts or again.problem.fingerprint != known.problem.fingerprint:
                return "a claim is about another structure, noise or priors"
            whole = known.data.records == len(self._kept) and self._none_left_out()
            if self.complete and self.inconsistent_at is None and not whole:
                return "samples were left out, attained ends are those of the others"
        return ""

    def _none_left_out(self) -> bool:
        """Check that all samples, of a window those in it, are retained from the first row on."""
        first = self._lag if self.window is None else min(self.retained, default=self._lag)
        return self.retained == tuple(range(first, self.samples))

    def summary(self) -> str:
        """Describe intervals, what they rest on, and the cost."""
        lines = [
            f"{i.name} in [{rounded(i.outer[0], False, 8)}, {rounded(i.outer[1], True, 8)}]"
            if self.inconsistent_at is None
            else f"{i.name}: empty"
            for i in self.intervals.values()
        ]
        if self.inconsistent_at is not None:
            lines.append(f"proved inconsistent at sample {self.inconsistent_at}")
        cost = self.cost
        lines.append(
            f"{cost.samples} samples, bounds computed anew at {cost.solved} of them, "
            f"{cost.retained} retained; "
            f"CPU seconds a sample: {cost.mean:.2g}, at most {cost.largest:.2g}"
        )
        if self.window is not None:
            lines.append(f"samples older than {self.window} are forgotten")
        if self._claims or not self.exact:
            lines.append("the exact set" if self.exact else "an outer box of the set")
        else:
            lines.append("no equation so far: what the bounds of priors say")
        return "\n".join(lines)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the proved intervals over the samples; returns the axes.

        Parameters
        ----------
        ax : matplotlib Axes, optional
        """
        from setid.plots.decisions import plot_recursive

        return plot_recursive(self.model.parameters, self._trace, self.inconsistent_at, ax)

    def _repr_html_(self) -> str:
        rows = [
            (i.name, rounded(i.outer[0], False, 8), rounded(i.outer[1], True, 8), i.status)
            for i in self.intervals.values()
        ]
        head = ["parameter", "outer (proved)", "", "status"]
        return section(f"{self!r}"[1:-1], html_table(head, rows))

    def __repr__(self) -> str:
        where = self.inconsistent_at
        state = "consistent so far" if where is None else f"inconsistent at sample {where}"
        return f"<Recursive: {self.samples} samples, {state}>"


def _common(claims: Iterable[Evidence]) -> tuple[Reals, Reals]:
    """Intersect the boxes of claims, low above high where there is nothing."""
    boxes = np.array([[i.outer for i in claim.intervals.values()] for claim in claims])
    return boxes[..., 0].max(axis=0), boxes[..., 1].min(axis=0)


# ---- parts ------------------------------------------------------------------------------


def _end(task: tuple[sp.Problem, sp.Polynomial]) -> sp.LinearBound:
    """Bound one end; in a worker process if there is an executor."""
    return sp.linear_bounds(task[0], [task[1]])[0]


def _linear(
    formulation: Formulation, executor: Executor | None = None
) -> tuple[Evidence, set[int]]:
    """Exact bounds by linear programs, and the records that they use."""
    problem, wanted = formulation.problem, objectives(formulation)
    if executor is None:
        bounds = tuple(sp.linear_bounds(problem, wanted))
    else:
        bounds = tuple(map_in_order(executor, _end, [(problem, item) for item in wanted]))
    rows = formulation.rows
    numbers = {n for bound in bounds for n, _ in bound.multipliers if n < len(rows.origin)}
    used = {int(rows.record[n]) - 1 for n in numbers if rows.sample[n]}
    items = {}
    empty = bounds[0].status is sp.Status.INFEASIBLE
    for place, name in enumerate(formulation.parameters):
        low, high = bounds[2 * place], bounds[2 * place + 1]
        status = IntervalStatus.CERTIFIED
        outer, inner = (low.lower, -high.lower), (low.upper, -high.upper)
        if sp.Status.UNBOUNDED in (low.status, high.status):
            status = IntervalStatus.UNBOUNDED
        if empty:
            items[name] = ParameterInterval(name, (inf, -inf), None, IntervalStatus.EMPTY)
        else:
            items[name] = ParameterInterval(name, outer, inner, status, (low.x, high.x))
    claim = Evidence(formulation, FrozenMapping(items), formulation.problem, bounds=bounds)
    return claim, used


def _boxed(formulation: Formulation) -> tuple[Evidence, set[int]]:
    """The box that uncertain rows prove, resting on all records."""
    box = find_box(formulation, time.monotonic() + _BOX_SECONDS)
    names, used = formulation.parameters, set(range(formulation.data.records))
    if box is not None and box.empty:
        empty = IntervalStatus.EMPTY
        items = {n: ParameterInterval(n, (inf, -inf), None, empty) for n in names}
        return Evidence(formulation, FrozenMapping(items), formulation.problem, box=box), used
    problem = problem_on_box(formulation, box)
    items = {}
    low, high = start_of(formulation)  # the problem on the box holds unused parameters at zero
    if box is not None:
        low, high = np.maximum(low, box.lower), np.minimum(high, box.upper)
    for place, name in enumerate(names):
        outer = float(low[place]), float(high[place])
        items[name] = ParameterInterval(name, outer, None, IntervalStatus.PARTIAL)
    return Evidence(formulation, FrozenMapping(items), problem, box=box), used


def _from_unknown(model: Structure) -> Structure:
    """The structure with unknown signals before each record."""
    check_structure(model)
    if not regression_of(model):
        raise ModelError(
            f"model: found {type(model).__name__} without a regression form, expected a structure "
            "whose outputs follow from readings alone: for several inputs a transfer function "
            "with common_denominator=True, or a PolynomialNARX"
        )
    return from_unknown_start(model)


def _bounds_of(
    priors: Iterable[Prior | sp.Constraint], model: Structure
) -> dict[str, tuple[float, float]]:
    """Intersect the bounds that priors give, which hold before the first equation."""
    found: dict[str, tuple[float, float]] = {}
    for prior in priors:
        if isinstance(prior, sp.Constraint):
            continue
        for name, (low, high) in bounds_of(prior, model).items():
            before = found.get(name, (-inf, inf))
            found[name] = max(before[0], low), min(before[1], high)
    return found


def _check_noise(noise: Noise, model: Structure) -> Noise:
    if not isinstance(noise, Noise):
        raise NoiseError(f"noise: found {type(noise).__name__}, expected Noise")
    if noise.constraints:
        raise NoiseError("noise: found constraints over the record, expected bounds alone")
    for kind in _KINDS:
        shape = np.shape(getattr(noise, kind))
        channels = model.inputs if kind == "input" else model.outputs
        if len(shape) > 1:
            raise NoiseError(f"noise.{kind}: found bounds one a sample, expected one a channel")
        if shape not in ((), (channels,)):
            raise NoiseError(
                f"noise.{kind}: found {shape[0]} bounds, expected one or {channels}, one a channel"
            )
    return noise


def _spread(noise: Noise, samples: int) -> Noise:
    """The noise with bounds of channels written out for samples, whose number may be the same."""
    found = copy(noise)
    for kind in _KINDS:
        bound = getattr(noise, kind)
        if np.ndim(bound):
            object.__setattr__(found, kind, frozen(np.tile(bound, (samples, 1))))
    return found


def _rows_of(given: ArrayLike, field: str, channels: int) -> Reals:
    """Samples as rows (K, channels)."""
    values = real_array(given, field, DataError)
    if values.ndim == 0:
        values = values.reshape(1, 1)
    elif values.ndim == 1:
        values = values[:, None] if channels == 1 else values[None, :]
    if values.ndim != 2 or values.shape[1] != channels:
        raise DataError(f"{field}: found shape {values.shape}, expected (K, {channels})")
    return values


def _quiet(make: Any) -> Any:
    """Without warnings on inputs that never change, which single samples are."""
    with silent(SetidWarning):
        return make()
