"""Fits where the denominator is given, against dense linear programs and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog, minimize_scalar
from scipy.signal import lfilter

import setid
from setid.minimum_noise.fits import fit_of_denominator
from setid.proofs.least_noise.least_error import Norm, error_rows, stated

Reals = NDArray[np.float64]


def fitted(
    data: setid.IOData, model: setid.TransferFunction, norm: Norm, a: Reals
) -> tuple[Reals, Reals]:
    rows = error_rows(stated(data, model, (), 1.0), norm, 1.0)
    assert rows is not None
    found = fit_of_denominator(data, model, rows, a)
    assert found is not None
    return found


def least(columns: Reals, y: Reals, norm: Norm) -> float:
    """The least norm of y - columns x, by numpy or HiGHS."""
    if norm == "l2":
        return float(np.linalg.norm(y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]))
    count, k = columns.shape
    sizes = np.ones((count, 1)) if norm == "linf" else np.eye(count)
    solved = linprog(
        np.append(np.zeros(k), np.ones(sizes.shape[1])),
        A_ub=np.vstack([np.hstack([columns, -sizes]), np.hstack([-columns, -sizes])]),
        b_ub=np.append(y, -y),
        bounds=[(None, None)] * (k + sizes.shape[1]),
        method="highs",
    )
    assert solved.status == 0
    return float(solved.fun)


def size_of(errors: Reals, norm: Norm) -> float:
    return float(np.linalg.norm(errors.ravel(), {"linf": np.inf, "l2": 2, "l1": 1}[norm]))


@pytest.mark.parametrize("norm", ["linf", "l2", "l1"])
@pytest.mark.parametrize("records", [1, 2])
def test_the_error_is_the_least_for_the_denominator(norm: Norm, records: int) -> None:
    """Responses to the input, to a constant, and to pulses at the first samples of each record."""
    random, a = np.random.default_rng(2), np.poly([0.9, 0.5])
    u, y = random.uniform(-1.0, 1.0, (2, records, 40))
    data = setid.IOData.concat([setid.IOData(*pair) for pair in zip(u, y, strict=True)])
    model = setid.TransferFunction(2, 1, 1, offset=True)
    theta, outputs = fitted(data, model, norm, a[1:])
    columns = np.zeros((records, 40, 2 + 2 * records))
    for r in range(records):
        drive = np.zeros((40, 2))
        drive[2:] = np.column_stack([u[r, 1:-1], np.ones(38)])
        columns[r, :, :2] = lfilter([1.0], a, drive, axis=0)
        columns[r, :, 2 + 2 * r : 4 + 2 * r] = lfilter([1.0], a, np.eye(40)[:, :2], axis=0)
    best = least(columns.reshape(-1, columns.shape[2]), y.ravel(), norm)
    assert size_of(outputs - data.y, norm) == pytest.approx(best, rel=2e-3)
    x = outputs.reshape(records, 40)
    rest = x[:, 2:] + theta[0] * x[:, 1:-1] + theta[1] * x[:, :-2] - theta[2] * u[:, 1:-1]
    np.testing.assert_allclose(rest, theta[3], atol=1e-9)


def test_poles_outside_the_unit_disc_are_as_good() -> None:
    """y(k) = 2 y(k-1) + u(k-1) backwards from y = 1: a simulation forward loses all digits."""
    random = np.random.default_rng(3)
    u, y = random.uniform(-1.0, 1.0, 200), np.ones(200)
    for k in range(199, 0, -1):
        y[k - 1] = (y[k] - u[k - 1]) / 2.0
    data = setid.IOData(u, y + 0.01 * np.sign(random.uniform(-1.0, 1.0, 200)))
    theta, outputs = fitted(data, setid.TransferFunction(1, 1, 1), "linf", np.array([-2.0]))
    assert abs(outputs - data.y).max() <= 0.01 * (1 + 1e-3)
    assert theta[0] == -2.0 and theta[1] == pytest.approx(1.0, abs=0.03)


def test_columns_that_depend_on_each_other_are_fitted_as_well() -> None:
    """A constant input and an offset: y = 3 beside an error of 1 at each second sample."""
    with pytest.warns(setid.SetidWarning, match="constant"):
        data = setid.IOData(np.full(20, 9.0), 3.0 + (-1.0) ** np.arange(20))
    model = setid.TransferFunction(1, 1, 1, offset=True)
    theta, outputs = fitted(data, model, "linf", np.array([-0.5]))
    assert abs(outputs - data.y).max() == pytest.approx(1.0, rel=2e-3)
    assert 9.0 * theta[1] + theta[2] == pytest.approx(1.5, abs=0.2)


def test_missing_readings_are_left_to_simulations() -> None:
    u, y = np.random.default_rng(4).uniform(-1.0, 1.0, (2, 20))
    y[7] = np.nan
    model = setid.TransferFunction(1, 1, 1)
    rows = error_rows(stated(setid.IOData(u, y), model, (), 1.0), "linf", 1.0)
    assert rows is not None
    assert fit_of_denominator(setid.IOData(u, y), model, rows, np.array([-0.5])) is None


@pytest.mark.parametrize("norm", ["linf", "l2", "l1"])
def test_fits_from_rest_are_those_of_one_gain(norm: Norm) -> None:
    """With a pole at 1/2, y = b x for the response x from rest: one unknown, by SciPy."""
    u, y = np.random.default_rng(4).uniform(-1.0, 1.0, (2, 20))
    data, model = setid.IOData(u, y), setid.TransferFunction(1, 1, 1, initial="zero")
    x = lfilter([0.0, 1.0], [1.0, -0.5], u)
    rows = error_rows(stated(data, model, (), 1.0), norm, 1.0)
    assert rows is not None
    fitted = fit_of_denominator(data, model, rows, np.array([-0.5]))
    assert fitted is not None
    (theta, outputs), order = fitted, {"linf": np.inf, "l2": 2, "l1": 1}[norm]
    least = minimize_scalar(lambda b: np.linalg.norm(y - b * x, order), (-1.0, 1.0), tol=1e-12)
    assert theta[0] == -0.5 and abs(theta[1] - least.x) < 1e-5
    assert np.abs(outputs[:, 0] - theta[1] * x).max() < 1e-9
