"""Programs of a fit grow with the number of samples, not with its square."""

from __future__ import annotations

import time
import tracemalloc

import numpy as np
import pytest

import setid
from setid.feasible_points.fits import output_error


def test_a_step_of_least_sums_takes_memory_in_proportion_to_the_samples() -> None:
    rng = np.random.default_rng(0)
    values, slope = rng.normal(size=1500), rng.normal(size=(1500, 2))
    tracemalloc.start()
    try:
        step = output_error._linear_step(values, slope, np.full(2, 10.0), "l1")
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert step is not None
    assert np.abs(values + slope @ step).sum() <= np.abs(values).sum()
    assert peak < 1500**2 * 8  # one dense matrix of the samples


def test_a_given_denominator_is_not_refined_when_time_is_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    steps = []
    known = output_error._linear_step
    monkeypatch.setattr(
        output_error, "_linear_step", lambda *given: steps.append(1) or known(*given)
    )
    rng = np.random.default_rng(1)
    data = setid.IOData(rng.uniform(-1, 1, 30), rng.uniform(-1, 1, 30))
    model = setid.TransferFunction(1, 1, 1, initial="zero")
    output_error.least_error_at(data, model, "l1", np.array([-0.5]), time.monotonic())
    assert len(steps) == 1
