"""Fits of outputs that are sums over several denominators: exact records, and other programs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog, minimize

import setid
from setid.feasible_points.fits.separate_denominators import (
    SeparateOutput,
    has_separate_denominators,
    separate_fit,
)
from setid.feasible_points.fits.separate_noise import estimates_of_little_noise, separate_noise
from setid.formulation.formulation import without_partial_outputs
from setid.simulation.responses import run

THETA = [-0.8, -0.5, 1.0, 0.3, -0.6, 0.2, 2.0]
MODEL = setid.TransferFunction(1, 2, 1, inputs=2, offset=True)


def record(rest: bool, noise: float = 0.0, count: int = 80) -> setid.IOData:
    """Two systems of order 1 with an offset; not at rest, the first 30 samples are left out."""
    rng = np.random.default_rng(4)
    u = rng.uniform(-1.0, 1.0, (count + 30, 2))
    y = setid.simulate(MODEL, THETA, u) + noise * rng.uniform(-1.0, 1.0, (count + 30, 1))
    return setid.IOData(u, y) if rest else setid.IOData(u[30:], y[30:])


def test_structures_with_separate_denominators_are_told() -> None:
    assert has_separate_denominators(MODEL)
    assert not has_separate_denominators(setid.TransferFunction(2, 1, 1))
    common = setid.TransferFunction(2, 1, 1, inputs=2, common_denominator=True)
    assert not has_separate_denominators(common)


@pytest.mark.parametrize("rest", [True, False])
@pytest.mark.parametrize("form", ["auto", "lifted"])
def test_exact_records_are_fitted_exactly(rest: bool, form: str) -> None:
    """The parameters that made the record, whether or not it begins at rest."""
    initial = "zero" if rest and form == "auto" else "free"
    fields = {"inputs": 2, "offset": True, "initial": initial, "form": form}
    model = setid.TransferFunction(1, 2, 1, **fields)
    found = separate_fit(record(rest), model)
    assert found is not None
    assert np.allclose(found[0], THETA, atol=1e-6)
    assert np.allclose(found[1], record(rest).y, atol=1e-6)


def test_an_offset_of_the_equation_is_told_from_one_of_the_output() -> None:
    """``form="direct"`` puts (1 - .8)(1 - .5) 2 = .2 into the equation."""
    model = setid.TransferFunction(1, 2, 1, inputs=2, offset=True, form="direct")
    found = separate_fit(record(False), model)
    assert found is not None
    assert np.allclose(found[0], [*THETA[:-1], 0.2], atol=1e-6)


def test_simulations_go_on_from_the_first_readings() -> None:
    data = record(False)
    assert np.allclose(run(MODEL, THETA, data), data.y, atol=1e-9)
    gone = setid.IOData(data.u, np.vstack([data.y[:5], np.full((75, 1), np.nan)]))
    assert np.allclose(run(MODEL, THETA, gone), data.y, atol=1e-9)


def test_sparse_readings_leave_simulations_at_rest() -> None:
    """There are no two readings in a row to start from; predictions do not exist here."""
    data = record(True)
    y = data.y.copy()
    y[1::2] = np.nan
    assert np.allclose(run(MODEL, THETA, setid.IOData(data.u, y)), data.y, atol=1e-9)


def test_records_one_after_another_have_first_samples_of_their_own() -> None:
    whole = record(False)
    two = setid.IOData(whole.u, whole.y, starts=[0, 40])
    found = separate_fit(two, MODEL)
    assert found is not None and np.allclose(found[0], THETA, atol=1e-6)


def test_missing_readings_are_left_out() -> None:
    data = record(False)
    y = data.y.copy()
    y[[7, 20, 21, 50]] = np.nan
    found = separate_fit(setid.IOData(data.u, y), MODEL)
    assert found is not None and np.allclose(found[0], THETA, atol=1e-6)


def test_little_noise_is_found_and_witnessed() -> None:
    """No descent from the truth, over exact linear programs, ends lower."""
    data = record(False, noise=0.1)
    given = setid.formulate(data, MODEL, setid.Noise(output=1.0), setid.Stable())
    formulation = without_partial_outputs(given)
    found = separate_noise(formulation)
    assert found is not None
    theta, outputs = found
    level = setid.least_noise(formulation, theta).level
    assert abs(level - np.abs(outputs - data.y).max()) < 2e-3 * level

    def least(a: np.ndarray) -> float:
        if np.any(np.abs(a) >= 1.0):
            return np.inf
        values = SeparateOutput(data, formulation.model, 0).at(a)[1]
        return setid.least_noise(formulation, [values[n] for n in MODEL.parameters]).level

    assert level <= least(np.array(THETA[:2]))
    end = minimize(least, THETA[:2], method="Nelder-Mead", options={"maxfev": 40})
    assert level <= end.fun


@pytest.mark.parametrize("seed", range(3))
def test_sums_of_products_are_witnessed_whatever_their_rounding(seed: int) -> None:
    """Definitions hold up to rounding alone; programs have nothing to choose there."""
    formulation = without_partial_outputs(
        setid.formulate(record(False, noise=0.1), MODEL, setid.Noise(output=1.0), setid.Stable())
    )
    rng = np.random.default_rng(seed)
    for _ in range(10):
        theta = rng.uniform(-0.99, 0.99, 7) * [1, 1, 3, 3, 3, 3, 300]
        assert np.isfinite(setid.least_noise(formulation, theta).level)


def test_estimates_end_with_impulse_responses_that_need_the_least_noise() -> None:
    """With all poles at 0 the least noise is that of one linear program."""
    data = record(False, noise=0.1, count=24)
    given = setid.formulate(data, MODEL, setid.Noise(output=1.0), setid.Stable())
    formulation = without_partial_outputs(given)
    *_, last = estimates_of_little_noise(formulation, enough=np.inf)
    assert not np.any(last[:2])
    y, u = data.y[3:, 0], data.u[1:]  # the first samples are free
    rows = np.column_stack([u[1:-1, 0], u[:-2, 0], u[1:-1, 1], u[:-2, 1], np.ones(21)])
    sizes = np.ones((21, 1))
    program = linprog(
        [0.0] * 5 + [1.0],
        np.block([[rows, -sizes], [-rows, -sizes]]),
        np.concatenate([y, -y]),
        bounds=[(None, None)] * 6,
    )
    found = setid.least_noise(formulation, last).level
    assert program.fun <= found * (1 + 1e-9) and found <= 1.002 * program.fun
