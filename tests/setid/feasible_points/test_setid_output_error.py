"""Output-error fits: the largest error they need, and long records that rest on them."""

from __future__ import annotations

import time

import numpy as np
import pytest

import setid
from setid.feasible_points.fits import output_error
from setid.feasible_points.fits.output_error import least_largest_error, output_error_fit
from sparsepop_py.budget import Deadline, LimitReached

TRUTH = [-0.7, 1.5]
MODEL = setid.TransferFunction(1, 1, nk=1)


def record(samples: int, bound: float, seed: int = 0) -> setid.IOData:
    """Samples of y(k) = .7 y(k-1) + 1.5 u(k-1), read with errors up to a bound."""
    rng = np.random.default_rng(seed)
    u, y = rng.uniform(-1, 1, samples), np.zeros(samples)
    for k in range(1, samples):
        y[k] = 0.7 * y[k - 1] + 1.5 * u[k - 1]
    return setid.IOData(u, y + rng.uniform(-bound, bound, samples))


def largest_error(data: setid.IOData, theta: np.ndarray, first: float) -> float:
    """Largest error of a simulation from a first sample, by hand."""
    y, u = data.y.ravel(), data.u.ravel()
    errors, state = [abs(first - y[0])], first
    for k in range(1, y.size):
        state = -theta[0] * state + theta[1] * u[k - 1]
        errors.append(abs(state - y[k]))
    return max(errors)


@pytest.mark.parametrize("seed", range(4))
def test_the_largest_error_is_no_larger_than_that_of_the_truth(seed: int) -> None:
    data = record(80, 0.2, seed)
    theta = least_largest_error(data, MODEL, np.full((80, 1), 0.2))
    firsts = np.linspace(data.y[0, 0] - 0.25, data.y[0, 0] + 0.25, 2001)
    assert min(largest_error(data, theta, v) for v in firsts) <= largest_error(
        data, np.array(TRUTH), 0.0
    )


def test_exact_readings_give_the_truth() -> None:
    data = record(40, 0.0)
    theta, outputs = output_error_fit(data, MODEL)
    assert theta == pytest.approx(TRUTH, abs=1e-6)
    assert outputs == pytest.approx(data.y, abs=1e-6)


def test_no_readings_with_a_bound_leave_the_fit_of_least_squares() -> None:
    data = record(40, 0.1)
    found = least_largest_error(data, MODEL, np.zeros((40, 1)))
    assert found == pytest.approx(output_error_fit(data, MODEL)[0])


def test_fits_without_time_take_the_best_vector_so_far(monkeypatch) -> None:
    """The first simulation counts; gradients of a fit and programs for it take many more."""
    data, runs = record(40, 0.1), []
    own = output_error.run
    monkeypatch.setattr(output_error, "run", lambda *args: runs.append(1) or own(*args))
    theta, outputs = output_error_fit(data, MODEL, until=time.monotonic())
    first = len(runs)
    assert first <= 4
    assert outputs.shape == (40, 1) and np.all(np.isfinite(theta))
    minimax = least_largest_error(data, MODEL, np.full((40, 1), 0.1), until=time.monotonic())
    assert len(runs) - first <= 6 and np.all(np.isfinite(minimax))
    runs.clear()
    fitted = output_error_fit(data, MODEL)[1]
    assert len(runs) > first
    assert np.linalg.norm(fitted - data.y) <= np.linalg.norm(outputs - data.y)


def test_a_fit_looks_at_the_limit_that_is_kept() -> None:
    with Deadline(1e-9).kept(), pytest.raises(LimitReached):
        output_error_fit(record(40, 0.1), MODEL)


@pytest.mark.slow
def test_a_long_record_has_attained_points() -> None:
    """More equations than Krawczyk's test takes at once are solved one after the other."""
    data = record(1010, 0.05)
    options = setid.Options(time_limit=30.0, progress=False)
    result = setid.identify(data, MODEL, setid.Noise(output=0.05), options=options)
    for value, interval in zip(TRUTH, result.intervals.values(), strict=True):
        assert interval.inner is not None
        assert interval.outer[0] <= value <= interval.outer[1]
    assert result.verify().ok


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_numerators_keep_their_digits_near_a_double_pole_at_1(seed: int) -> None:
    """With the denominator of the truth no more noise is needed than was put in, .02."""
    poles = np.poly([1.0 - 1e-5, 1.0 - 1e-5, 0.9375])
    u, x = np.sign(np.sin(np.arange(500) / 8.0)), np.zeros(500)
    for k in range(3, 500):
        x[k] = 1e-4 * u[k - 3 : k].sum() - poles[1:] @ x[k - 3 : k][::-1]
    random = np.random.default_rng(seed)
    data = setid.IOData(u, x + random.uniform(-0.02, 0.02, 500))
    model = setid.TransferFunction(3, 3, 1)
    theta = least_largest_error(data, model, np.ones((500, 1)), poles[1:])
    known = setid.formulate(data, model, setid.Noise(output=1.0))
    assert setid.least_noise(known, theta).level <= 0.02
