"""Identified records: what is measured holds, and what would not hold is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import setid
from benchmarks import runner
from benchmarks.measuring.measure import Setting
from benchmarks.measuring.registry import Selection
from benchmarks.problems import block_structured, intervals
from benchmarks.problems.families import REGISTRY
from benchmarks.problems.intervals import Experiment, results_of
from benchmarks.tables.report import report


@pytest.mark.parametrize("kind", ["oe", "eiv"])
@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.slow
def test_the_truth_is_feasible_and_the_noise_is_what_was_asked(kind: str, order: int) -> None:
    experiment = Experiment(kind, order, 20, 5.0, 1)
    task, truth = experiment.task(), experiment.record()
    assert np.abs(truth.output).max() <= 0.05 * np.abs(truth.y).max()
    assert (np.abs(truth.input).max() > 0) == (kind == "eiv")
    x = task.known.point(truth.theta, output=truth.output, input=truth.input)
    assert task.problem.violation(x) <= 1e-9
    p = len(truth.theta)
    assert np.all(x[:p] >= task.problem.lower[:p]) and np.all(x[:p] <= task.problem.upper[:p])
    assert len(task.objectives) == len(task.labels) == 2 * p == 2 * len(task.start_widths)


def test_a_stable_prior_is_part_of_the_problem() -> None:
    free, bound = (next(iter(REGISTRY[n].chosen(Selection(sizes=(20,), noises=(5.0,))))).make()
                   for n in ("identify", "identify-stable"))  # fmt: skip
    assert bound.problem.upper[0] <= 1.0 < free.problem.dimension


def test_rows_of_a_record_and_their_report() -> None:
    family = REGISTRY["identify"]
    wanted = Selection(names=("oe order 1",), sizes=(20,), noises=(5.0,))
    (case,) = family.chosen(wanted)
    own, peer = runner.measure(family, case, Setting(repeats=1, peer_limit=20.0))
    assert own.valid and own.verified and own.closed == own.objectives == 4
    assert own.problem == "oe order 1 N=20 5%" and own.gap_kind == "width"
    assert peer.solver == "SCIP" and peer.closed == 4 and peer.variables == own.variables
    for mine, other in zip(own.details, peer.details, strict=True):
        assert mine["lower"] <= other["upper"] + 1e-6  # the same problem
    assert "| oe order 1 5% | 1 | 1 | 1 | 0 | 100 % |" in report([own, peer])


@pytest.mark.slow
def test_a_record_without_a_finite_box_is_a_row() -> None:
    family = REGISTRY["identify"]
    wanted = Selection(names=("eiv order 3",), sizes=(8,), noises=(10.0,))
    (case,) = family.chosen(wanted)
    (row,) = runner.measure(family, case, Setting(repeats=1))
    assert row.status == "unbounded, proved" and row.valid and row.closed == 0
    assert "| all | 1 | 1 | 0 | 1 |  |" in report([row])


def test_wrong_claims_are_found() -> None:
    task = Experiment("oe", 1, 20, 5.0, 0).task()
    known, truth = task.known, Experiment("oe", 1, 20, 5.0, 0).record()
    options = setid.Options(progress=False, time_limit=60.0)
    result = setid.identify(known.data, known.model, known.noise, options=options)
    assert list(intervals.findings(result, truth)) == []
    item = result.intervals["a1"]
    forged = replace(item, outer=(truth.theta["a1"] + 1e-6, item.outer[1]))
    wrong = replace(result, intervals={**result.intervals, "a1": forged})
    texts = list(intervals.findings(wrong, truth))
    assert len(texts) == 3
    assert "is outside" in texts[0] and "is not inside" in texts[1] and "verify" in texts[2]


@pytest.mark.slow
def test_block_structures_stand_beside_the_peer_on_the_same_box() -> None:
    family = REGISTRY["block_structured"]
    wanted = Selection(names=("lure 1",), sizes=(20,), noises=(1.0,))
    (case,) = family.chosen(wanted)
    own, peer = runner.measure(family, case, Setting(repeats=1, peer_limit=20.0))
    assert own.valid and own.verified and own.closed == own.objectives == 6
    assert peer.solver == "SCIP" and peer.closed == 6 and peer.variables == own.variables
    for mine, other in zip(own.details, peer.details, strict=True):
        assert mine["lower"] <= other["upper"] + 1e-6


def test_feedback_loops_stay_bounded() -> None:
    """Also under the input that drives them furthest: -1 throughout."""
    for kind in ("lure 1", "lure 2"):
        model, theta, _ = block_structured.KINDS[kind]
        y = setid.simulate(model, theta, -np.ones(300))
        assert np.all(np.abs(y) < 3.0)


def test_ends_that_the_box_alone_proves_count() -> None:
    """Cones of denominators close this record; the engine proves nothing of its own."""
    known = Experiment("oe", 1, 500, 1.0, 0).task().known
    result = setid.identify(known.data, known.model, known.noise)
    found = results_of(result)
    for place, interval in enumerate(result.intervals.values()):
        low, high = found[2 * place], found[2 * place + 1]
        width = interval.outer[1] - interval.outer[0]
        assert low.upper_bound - low.lower_bound < 1e-2 * width
        assert high.upper_bound - high.lower_bound < 1e-2 * width
