"""Simulated records for :func:`setid.identify`: models of order 1 to 3, errors of 1 to 10 %.

Inputs are uniform on [-1, 1] and the system is at rest before the record. The bound of the
output errors is a share of the largest noise-free output; with errors in variables ("eiv") that
of the input errors is a third of this share of the largest input, as in the laboratory's
record, whose bounds are 1 for outputs of about 30 and 0.01 for inputs up to 1. The peer gets
the problem of the formulation on the box that identification proves from the data.

References
----------
Plants of order 1 and 2: V. Cerone, course notes, Laboratory of Robust Identification and
Control, Politecnico di Torino (2024/25), laboratory 2. That of order 3 has its poles at 0.8 and
0.3 +- 0.6i, so that no mode hides: where fewer explain the data, the set of order 3 is unbounded.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

import setid
import sparsepop_py as sp
from setid.feasible_set.start import find_box
from setid.formulation.units import in_units
from setid.proofs.parameter_box import ProvedBox, objectives, problem_on_box

from ..measuring.measure import Setting, key_of, own_rows, peer_rows, peers_of, settings_of
from ..measuring.records import Row
from ..measuring.registry import Case, Family, Selection, Task

__all__ = ["PLANTS", "Experiment", "cases", "findings", "nesting", "results_of", "rows"]

PLANTS: Mapping[int, tuple[setid.TransferFunction, tuple[float, ...]]] = MappingProxyType(
    {
        1: (setid.TransferFunction(1, 1), (-0.5, 2.0)),
        2: (setid.TransferFunction(2, 3), (-0.7647, 0.3012, 0.0, 32.24, 21.41)),
        3: (setid.TransferFunction(3, 3, 1), (-1.4, 0.93, -0.36, 1.0, -0.5, 0.8)),
    }
)
SIZES = (20, 50, 100, 200, 500)
PERCENT = (1.0, 5.0, 10.0)
_INPUT_SHARE = 1.0 / 3.0
_BRIEFLY = 5.0  # seconds for the first half of a record: any proved interval is a check


@dataclass(frozen=True)
class Experiment:
    """How one record is simulated and identified.

    Parameters
    ----------
    kind : {"oe", "eiv"}
    order : {1, 2, 3}
    samples : int
    percent : float
        Bound of the output errors in per cent of the largest noise-free output.
    seed : int
    priors : tuple of Prior

    Examples
    --------
    >>> experiment = Experiment("oe", 1, 20, 5.0, 0)
    >>> experiment.name, experiment.record().data.samples
    ('oe order 1 N=20 5%', 20)
    """

    kind: str
    order: int
    samples: int
    percent: float
    seed: int
    priors: tuple[setid.Stable, ...] = ()

    @property
    def name(self) -> str:
        """The same for all seeds."""
        return f"{self.kind} order {self.order} N={self.samples} {self.percent:g}%"

    def record(self) -> setid.Simulated:
        """The record with the truth behind it."""
        model, theta = PLANTS[self.order]
        source = np.random.default_rng([self.seed, self.order, self.samples])
        u = source.uniform(-1.0, 1.0, self.samples)
        return setid.simulate_record(model, theta, u, self._noise(u), source)

    def _noise(self, u: np.ndarray) -> setid.Noise:
        model, theta = PLANTS[self.order]
        share = self.percent / 100.0
        output = share * float(np.abs(setid.simulate(model, theta, u)).max())
        below = share * _INPUT_SHARE * float(np.abs(u).max()) * (self.kind == "eiv")
        return setid.Noise(output=output, input=below)

    def task(self) -> RecordTask:
        """All ends of all intervals, on the box that the data alone give."""
        truth = self.record()
        noise = self._noise(truth.u.ravel())
        known = setid.formulate(truth.data, PLANTS[self.order][0], noise, self.priors)
        box = find_box(known)
        assert box is not None
        return RecordTask.on_box(known, truth, box)


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordTask(Task):
    """All ends of the intervals of one record.

    Parameters
    ----------
    known : setid.Formulation
    truth : setid.Simulated
    """

    known: setid.Formulation
    truth: setid.Simulated

    @staticmethod
    def on_box(
        known: setid.Formulation, truth: setid.Simulated, box: ProvedBox | None
    ) -> RecordTask:
        """The problem of a formulation, in units, on the box that data and priors prove."""
        scaled, p = in_units(problem_on_box(known, box), known), len(known.parameters)
        problem = scaled.problem
        labels = [f"{sense} {name}" for name in known.parameters for sense in ("min", "max")]
        widths = tuple((problem.upper[:p] - problem.lower[:p]).tolist())
        asked = tuple(scaled.asked(objective)[0] for objective in objectives(known))
        return RecordTask(problem, asked, tuple(labels), True, widths, known=known, truth=truth)


def cases(stable: bool, selection: Selection) -> Iterator[Case]:
    """Records of all orders, kinds, sizes, levels and seeds; orders and kinds by ``--names``."""
    levels = selection.noises or PERCENT
    sizes, orders = selection.sizes or SIZES, sorted(PLANTS)
    priors = (setid.Stable(),) if stable else ()
    wanted = itertools.product(("oe", "eiv"), orders, sizes, levels, selection.seeds)
    for kind, order, samples, percent, seed in wanted:
        made = Experiment(kind, order, samples, percent, seed, priors)
        yield Case(made.name, made.task, samples, seed)


def rows(family: Family, case: Case, setting: Setting) -> Iterator[Row]:
    """What identification proves and attains of one record, and SCIP on the same problem.

    SCIP is not asked where there is no finite box: it has none to be given.
    """
    settings = settings_of(family, case, setting)
    tolerance, own = float(settings["gap"]), None
    found: list[tuple[setid.Identification, setid.Simulated]] = []

    def solve(task: Task) -> list[sp.Result]:
        assert isinstance(task, RecordTask)
        found.clear()
        known, options = task.known, _options(settings)
        result = setid.identify(known.data, known.model, known.noise, known.priors, options)
        found.append((result, task.truth))
        return results_of(result)

    if "sparsepop_py" in setting.solvers:
        for measured in own_rows(family, case, "default", solve, tolerance, setting.repeats):
            said = [text for each in found for text in findings(*each)]
            said += [text for each, _ in found for text in _against_beginning(each, settings)]
            notes = (*measured.notes, *(f"finding: {text}" for text in said))
            own = replace(measured, valid=bool(found) and not said, notes=notes)
            if found and str(found[0][0].status) == "unbounded":
                own = replace(own, status="unbounded, proved")
            yield own
    own = own or setting.known.get(key_of(family, case))
    for name in peers_of(setting) if own is None or math.isfinite(own.gap) else ():
        yield from peer_rows(family, case, own, tolerance, setting, name)


def results_of(result: setid.Identification) -> list[sp.Result]:
    """List results of all ends, each with what its interval proves.

    The engine's are not all: a box that the data prove may be closer.

    Parameters
    ----------
    result : setid.Identification
    """
    if not result.results:
        return []
    units = in_units(result.problem, result.formulation).units.tolist()
    found = []
    for place, interval in enumerate(result.intervals.values()):
        ends = interval.outer[0] / units[place], -interval.outer[1] / units[place]
        for end, one in zip(ends, result.results[2 * place : 2 * place + 2], strict=True):
            unproved = one.status is sp.Status.UNPROVED and math.isfinite(end)
            status = sp.Status.BOUNDED if unproved else one.status
            found.append(replace(one, lower_bound=max(one.lower_bound, end), status=status))
    return found


def _options(settings: Mapping[str, Any]) -> setid.Options:
    """Fields of the engine's options as options of identification."""
    own = {"tol": settings["gap"], "time_limit": settings.get("time_limit"), "progress": False}
    rest = {name: value for name, value in settings.items() if name not in ("gap", "time_limit")}
    if "solver" in rest:
        own["solver"] = rest["solver"]
    return setid.Options(**own, engine=sp.Options(**rest))


def _against_beginning(result: setid.Identification, settings: Mapping[str, Any]) -> Iterator[str]:
    """What contradicts the first half of the record, whose set holds that of the whole."""
    known = result.formulation
    limit = min(_BRIEFLY, settings.get("time_limit") or _BRIEFLY)
    half = known.data.split(known.data.samples // 2)[0]
    options = _options({**settings, "time_limit": limit})
    yield from nesting(
        result, setid.identify(half, known.model, known.noise, known.priors, options)
    )


def nesting(longer: setid.Identification, beginning: setid.Identification) -> Iterator[str]:
    """Inner intervals of a record that are not inside the outer ones of its beginning.

    Parameters
    ----------
    longer, beginning : setid.Identification
    """
    for name, interval in longer.intervals.items():
        outer, inner = beginning.intervals[name].outer, interval.inner
        if inner is not None and not (outer[0] <= inner[0] and inner[1] <= outer[1]):
            yield f"{name}: inner {inner} is not inside {outer} of the first half"


def findings(result: setid.Identification, truth: setid.Simulated) -> Iterator[str]:
    """What is wrong with an identification, one sentence each; nothing where all claims hold.

    Parameters
    ----------
    result : setid.Identification
    truth : setid.Simulated
        The record it was made from.
    """
    if result.empty:
        yield "empty, but the true parameters are consistent"
    for name, interval in result.intervals.items():
        if truth.theta[name] not in interval:
            yield f"{name}: the truth {truth.theta[name]!r} is outside {interval.outer}"
        if interval.inner is not None and not (
            interval.outer[0] <= interval.inner[0] and interval.inner[1] <= interval.outer[1]
        ):
            yield f"{name}: inner {interval.inner} is not inside outer {interval.outer}"
    verified = result.verify(truth.data)
    if not verified:
        yield f"the result does not verify: {verified.reason}"
