"""Records that say nothing of some parameters, and time that all proofs share."""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np
import pytest

import setid
import sparsepop_py as sp
from setid.proofs.uniqueness.free_parameters import free_parameters

QUICK = setid.Options(time_limit=60.0, progress=False)
SILENT = np.zeros(12)
DRIVEN = np.random.default_rng(0).uniform(-1.0, 1.0, 12)
FIRST, SECOND = setid.TransferFunction(1, 1), setid.TransferFunction(2, 3)
MIMO = setid.TransferFunction(1, 1, inputs=2, outputs=2, common_denominator=True)
PAIR = np.column_stack([SILENT, SILENT])

RECORDS = [
    (SILENT, SILENT, FIRST, setid.Noise(output=1.0), ["a1", "b0"]),
    (SILENT, SILENT, FIRST, setid.Noise(equation=1.0), ["a1", "b0"]),
    (SILENT, SILENT, SECOND, setid.Noise(output=1.0), ["a1", "a2", "b0", "b1", "b2"]),
    (SILENT, 0.1 * DRIVEN, FIRST, setid.Noise(output=0.1), ["a1", "b0"]),
    (0.1 * DRIVEN, 0.1 * DRIVEN, FIRST, setid.Noise(output=0.1, input=0.1), ["a1", "b0"]),
    (DRIVEN, 0.1 * DRIVEN, FIRST, setid.Noise(output=0.1), ["a1"]),
    (PAIR, PAIR, MIMO, setid.Noise(output=1.0), list(MIMO.parameters)),
]


@pytest.mark.filterwarnings("ignore::setid.SetidWarning")
@pytest.mark.parametrize(("u", "y", "model", "noise", "names"), RECORDS)
def test_what_noise_alone_explains_is_unidentifiable(
    u: np.ndarray, y: np.ndarray, model: setid.TransferFunction, noise: setid.Noise, names: list
) -> None:
    data = setid.IOData(u, y)
    result = setid.identify(data, model, noise, options=QUICK)
    for name, item in result.intervals.items():
        assert (item.status == "unidentifiable") == (name in names)
    assert all(result.intervals[name].inner == (-inf, inf) for name in names)
    assert bool(result.verify(data))
    free, x = free_parameters(result.formulation)
    for name in free:  # any value is feasible with the same noise
        for value in (-1e3, 0.7, 1e5):
            moved = np.array(x)
            moved[result.formulation.parameters.index(name)] = value
            assert result.formulation.problem.violation(moved) <= 1e-11 * abs(value)


def test_a_record_that_noise_does_not_cover_has_no_idle_parameters() -> None:
    data = setid.IOData(DRIVEN, np.append(0.1 * DRIVEN[:-1], 0.11))  # one reading is too large
    known = setid.formulate(data, FIRST, setid.Noise(output=0.1))
    assert free_parameters(known) == ((), None)
    bounded = setid.formulate(data, FIRST, setid.Noise(output=0.2), [setid.Box({"a1": (-1, 1)})])
    assert free_parameters(bounded) == ((), None)


@pytest.mark.filterwarnings("ignore::setid.SetidWarning")
def test_an_idle_parameter_keeps_the_bounds_that_are_given() -> None:
    data = setid.IOData(SILENT, 0.9 ** np.arange(12))
    result = setid.identify(
        data, FIRST, setid.Noise(output=0.001), [setid.Box({"b0": (0, 5)})], QUICK
    )
    assert result.intervals["b0"].outer == (0.0, 5.0)
    assert result.intervals["b0"].status == "unidentifiable" and bool(result.verify(data))


def test_a_forged_claim_of_freedom_is_refused() -> None:
    noise = setid.Noise(output=0.1)
    truth = setid.simulate_record(FIRST, [-0.5, 2.0], DRIVEN, noise, 2)
    result = setid.identify(truth.data, FIRST, noise, options=QUICK)
    free = setid.IntervalStatus.UNIDENTIFIABLE
    item = setid.ParameterInterval("a1", (-inf, inf), (-inf, inf), free)
    claim = replace(result, intervals={**result.intervals, "a1": item})
    assert "a1 is unidentifiable" in claim.verify().reason
    claim = replace(
        result,
        intervals={**result.intervals, "a1": replace(item, status=setid.IntervalStatus.PARTIAL)},
    )
    assert "a1 is not attained" in claim.verify().reason


@pytest.mark.filterwarnings("ignore::setid.SetidWarning")
def test_a_parameter_of_no_row_is_not_said_to_be_zero() -> None:
    data = setid.IOData(SILENT, 0.9 ** np.arange(12))
    result = setid.identify(data, FIRST, setid.Noise(output=0.001), options=QUICK)
    assert result.intervals["b0"].outer == (-inf, inf) and bool(result.verify())
    item = replace(
        result.intervals["b0"], outer=(0.0, 0.0), inner=None, status=setid.IntervalStatus.PARTIAL
    )
    claim = replace(result, intervals={**result.intervals, "b0": item})
    assert "b0 does not follow" in claim.verify().reason


@pytest.mark.slow
def test_box_and_engine_share_one_time(monkeypatch: pytest.MonkeyPatch) -> None:
    module = sys.modules["setid.feasible_set.start"]
    box, solve, given = module.parameter_box, sp.solve_each, []

    def slow(*arguments: Any) -> setid.ParameterBox:
        end = time.monotonic() + 0.5
        while time.monotonic() < end:
            pass
        return box(*arguments)

    def noted(problem: sp.Problem, objectives: Any, options: sp.Options, **rest: Any) -> Any:
        given.append(options.time_limit)
        return solve(problem, objectives, options, **rest)

    monkeypatch.setattr(module, "parameter_box", slow)
    monkeypatch.setattr(sp, "solve_each", noted)
    noise = setid.Noise(output=0.1)
    truth = setid.simulate_record(FIRST, [-0.5, 2.0], DRIVEN, noise, 2)
    for limit in (0.6, 0.2):
        options = setid.Options(time_limit=limit, progress=False)
        result = setid.identify(truth.data, FIRST, noise, options=options)
        assert given.pop() <= max(limit - 0.5, 1e-3)
        assert all(v in result.intervals[n] for n, v in truth.theta.items())
    setid.identify(truth.data, FIRST, noise)
    assert given == [None]


@pytest.mark.parametrize("name", ["nothing", "cvxpy:NOTHING"])
def test_unknown_solvers_are_refused_with_the_options(name: str) -> None:
    with pytest.raises(sp.SolverNotFound, match="solver: "):
        setid.Options(solver=name)
    with pytest.raises(sp.SolverNotFound, match="solver: "):
        sp.Options(solver=name)
