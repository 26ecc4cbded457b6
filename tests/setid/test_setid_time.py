"""Whatever the record, work ends soon after ``time_limit``: no stage has a clock of its own."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import setid
from setid.feasible_set.start import find_box

MODEL = setid.TransferFunction(3, 3, 1)
THETA = (-1.4, 0.93, -0.36, 1.0, -0.5, 0.8)
NOISE = setid.Noise(output=0.15, input=0.05)
SPARE = 3.0  # seconds of processor time, which is no more than what passes on the clock


@pytest.fixture(scope="module")
def heavy() -> setid.IOData:
    """Errors in variables of order three, 200 samples, noise of 10 % of the output."""
    u = np.random.default_rng(3).uniform(-1.0, 1.0, 200)
    return setid.simulate_record(MODEL, THETA, u, NOISE, 3).data


def seconds(work: Callable[[], Any]) -> tuple[Any, float]:
    begin = time.process_time()
    return work(), time.process_time() - begin


@pytest.mark.parametrize("priors", [(), (setid.Stable(),)])
def test_identification_ends_in_time(heavy: setid.IOData, priors: tuple[setid.Prior, ...]) -> None:
    options = setid.Options(time_limit=0.5, progress=False)
    found, spent = seconds(lambda: setid.identify(heavy, MODEL, NOISE, priors, options))
    assert spent < 0.5 + SPARE
    assert all(v in found.intervals[n] for n, v in zip(MODEL.parameters, THETA, strict=True))


def test_consistency_and_selection_end_in_time(heavy: setid.IOData) -> None:
    options = setid.Options(time_limit=0.5, progress=False)
    found, spent = seconds(lambda: setid.consistency(heavy, MODEL, NOISE, (), options))
    assert spent < 0.5 + SPARE and found.scale[0] <= 1.0 and bool(found.verify())
    family = setid.TransferFunction
    chosen, spent = seconds(
        lambda: setid.select(heavy, family, NOISE, (1, 2, 3), (1,), (), options)
    )
    assert spent < 0.5 + SPARE and 1 <= len(chosen.steps) <= 3


@pytest.mark.slow
def test_a_projection_has_the_time_of_its_result(heavy: setid.IOData) -> None:
    options = setid.Options(time_limit=0.5, progress=False)
    box = setid.Box({name: (-5.0, 5.0) for name in MODEL.parameters})
    found = setid.identify(heavy, MODEL, NOISE, box, options)
    shadow, spent = seconds(lambda: setid.project(found, "a1", "a2"))
    assert spent < 0.5 + SPARE
    for angle in np.linspace(0.0, 6.0, 7):
        normal = np.array([np.cos(angle), np.sin(angle)])
        assert normal @ np.array(THETA[:2]) <= np.max(shadow.outline @ normal) + 1e-9


def test_cells_are_halved_no_more_when_time_is_over() -> None:
    """The box is wider than with all the time, holds it, and is found again without a clock."""
    plant = setid.TransferFunction(1, 1, 1)
    model, theta = setid.Wiener(plant, 2, "gamma1", initial="zero"), [-0.7, 0.3, 0.3]
    u = np.random.default_rng(1).uniform(-1.0, 1.0, 20)
    noise = setid.Noise(output=0.01)
    data = setid.simulate_record(model, theta, u, noise, 1).data
    known = setid.formulate(data, model, noise, [setid.Stable()])
    start = np.array([known.problem.lower[: len(theta)], known.problem.upper[: len(theta)]])
    short, whole = find_box(known, time.monotonic()), find_box(known)
    assert short is not None and whole is not None and short.verify(known, start)
    assert short.rounds == 0 < whole.rounds
    assert np.all(short.lower <= whole.lower) and np.all(whole.upper <= short.upper)
    assert np.all(whole.lower <= theta) and np.all(theta <= whole.upper)


def test_an_estimated_discretisation_error_leaves_time_for_the_rest() -> None:
    model = setid.ContinuousTransferFunction(2, 1, delta="estimate")
    u = np.random.default_rng(2).uniform(-1.0, 1.0, 150)
    plant = setid.ContinuousTransferFunction(2, 1, Ts=0.1)
    noise = setid.Noise(output=0.05)
    data = setid.simulate_record(plant, (1.2, 2.0, 0.5, 2.0), u, noise, 2, Ts=0.1).data
    options = setid.Options(time_limit=0.5, progress=False)
    found, spent = seconds(lambda: setid.identify(data, model, noise, (), options))
    assert spent < 0.5 + SPARE and not found.empty
