"""Least squares, l1 and l-infinity against published numbers and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from identification_cases import PLANT, laboratory_two_first, laboratory_two_second
from scipy.signal import lfilter

import setid

SECOND_ORDER = setid.TransferFunction(na=2, nb=3)
ZOH = np.array([-0.7647215, 0.30119421, 0.0, 32.23692235, 21.41034903])  # 100/(s^2+1.2s+1), 1 s


def test_least_squares_is_exact_without_noise() -> None:
    u = np.random.default_rng(1).uniform(size=7)
    y = setid.simulate(SECOND_ORDER, ZOH, u)
    found = setid.least_squares(setid.IOData(u, y), SECOND_ORDER)
    assert found.row.tolist() == [2, 3, 4, 5, 6]
    np.testing.assert_allclose(found.theta, ZOH, rtol=0, atol=1e-9)
    assert found["b1"] == pytest.approx(ZOH[3])


def limit_for_output_noise(deviation: float) -> np.ndarray:
    """E[phi phi']^-1 E[phi y] for u uniform on [0, 1] and white output noise."""
    impulse = lfilter(ZOH[2:], [1.0, *ZOH[:2]], np.eye(1, 200).ravel())
    mean = 0.5 * impulse.sum()

    def yy(lag: int) -> float:
        white = deviation**2 if lag == 0 else 0.0
        return float(impulse[lag:] @ impulse[: 200 - lag] / 12 + mean**2 + white)

    def yu(lag: int) -> float:  # E[y(k) u(k - lag)]
        return float((impulse[lag] if lag >= 0 else 0.0) / 12 + 0.5 * mean)

    signals = [("y", 1, -1.0), ("y", 2, -1.0), ("u", 0, 1.0), ("u", 1, 1.0), ("u", 2, 1.0)]

    def moment(one: tuple, two: tuple) -> float:
        (a, i, s), (b, j, t) = one, two
        if a == b == "y":
            return s * t * yy(abs(i - j))
        if a == b:
            return s * t * (1 / 3 if i == j else 1 / 4)
        return s * t * (yu(j - i) if a == "y" else yu(i - j))

    matrix = np.array([[moment(a, b) for b in signals] for a in signals])
    return np.linalg.solve(matrix, [moment(("y", 0, 1.0), b) for b in signals])


def test_the_limit_for_output_noise_is_the_published_one() -> None:
    published = np.array([-0.5326, 0.1319, -0.37, 31.92, 28.51])
    found = limit_for_output_noise(5.0)
    assert np.all(np.abs(found - published) < [0.01, 0.01, 0.03, 0.05, 0.05])
    np.testing.assert_allclose(limit_for_output_noise(0.0), ZOH, atol=1e-9)


@pytest.mark.parametrize(
    ("samples", "width"),
    [(200_000, 0.2), pytest.param(2_000_000, 0.06, marks=pytest.mark.slow)],
)
@pytest.mark.parametrize("kind", ["equation", "output"])
def test_consistency_for_equation_error_and_bias_for_output_error(
    kind: str, samples: int, width: float
) -> None:
    """Ljung 1999, section 7.3: least squares converges to the truth for white e only."""
    rng = np.random.default_rng(8)
    u, noise = rng.uniform(size=samples), 5.0 * rng.standard_normal(samples)
    denominator = [1.0, *ZOH[:2]]
    y = lfilter(ZOH[2:], denominator, u)
    y = y + (noise if kind == "output" else lfilter([1.0], denominator, noise))
    found = setid.least_squares(setid.IOData(u, y), SECOND_ORDER)
    limit = limit_for_output_noise(5.0) if kind == "output" else ZOH
    assert np.all(np.abs(found.theta - limit) < np.array([0.05, 0.05, 1, 1, 1]) * width)
    if kind == "output":
        assert abs(found.theta[0] - ZOH[0]) > 0.2


def test_linf_and_l1_of_the_second_laboratory() -> None:
    data = laboratory_two_second(0.5)
    least = setid.linf(data, SECOND_ORDER)
    expected = [-0.76481451, 0.30129821, -0.00135928, 32.24145171, 21.40612136]
    np.testing.assert_allclose(least.theta, expected, rtol=0, atol=2e-8)
    assert least.cost == pytest.approx(0.49818148, abs=1e-8)

    absolute = setid.l1(data, SECOND_ORDER)
    expected = [-0.76108736, 0.29886006, 0.04800532, 32.1944369, 21.55518708]
    np.testing.assert_allclose(absolute.theta, expected, rtol=0, atol=2e-7)
    assert absolute.cost == pytest.approx(243.97124516, abs=1e-7)

    squares = setid.least_squares(data, SECOND_ORDER)
    expected = [-0.76393353, 0.30087898, 0.0420185, 32.21865818, 21.45030917]
    np.testing.assert_allclose(squares.theta, expected, rtol=0, atol=1e-7)


def test_linf_gives_the_least_equation_error() -> None:
    found = setid.linf(laboratory_two_first(), setid.TransferFunction(na=1, nb=1))
    assert found.cost == pytest.approx(0.3390283401, abs=1e-9)
    np.testing.assert_allclose(found.theta, [-0.3882591, 1.9703239], rtol=0, atol=1e-7)


def test_the_costs_are_the_least_of_their_kind() -> None:
    data = laboratory_two_second(10.0, 60)
    found = [f(data, SECOND_ORDER) for f in (setid.least_squares, setid.l1, setid.linf)]
    sizes = [lambda r: float(r @ r), lambda r: float(np.abs(r).sum()), lambda r: np.abs(r).max()]
    for own, size in zip(found, sizes, strict=True):
        assert own.cost == pytest.approx(size(own.residuals))
        assert all(own.cost <= size(other.residuals) + 1e-9 for other in found)


def test_recursive_least_squares_is_the_ridge_solution() -> None:
    """Ljung 1999, eq. (11.17): P_0 adds (theta - theta_0)' P_0^-1 (theta - theta_0)."""
    data = laboratory_two_second(1.0, 40)
    start, spread = np.array([0.1, 0.2, 1.0, 2.0, 3.0]), 50.0
    found = setid.recursive_least_squares(data, SECOND_ORDER, initial=start, covariance=spread)
    y, u = data.y.ravel(), data.u.ravel()
    a = np.stack([-y[1:-1], -y[:-2], u[2:], u[1:-1], u[:-2]], axis=1)
    normal = a.T @ a + np.eye(5) / spread
    expected = np.linalg.solve(normal, a.T @ y[2:] + start / spread)
    np.testing.assert_allclose(found.theta, expected, rtol=1e-8)
    assert found.history is not None and found.history.shape == (38, 5)
    flat = setid.recursive_least_squares(data, SECOND_ORDER, covariance=1e10)
    batch = setid.least_squares(data, SECOND_ORDER)
    np.testing.assert_allclose(flat.theta, batch.theta, rtol=1e-5, atol=1e-5)


def test_forgetting_follows_a_change() -> None:
    model = setid.TransferFunction(na=0, nb=1)
    u = np.random.default_rng(2).uniform(1, 2, 80)
    y = np.where(np.arange(80) < 40, 1.0, 3.0) * u
    slow = setid.recursive_least_squares(setid.IOData(u, y), model)
    fast = setid.recursive_least_squares(setid.IOData(u, y), model, forgetting=0.7)
    assert abs(fast.theta[0] - 3) < 1e-4 < 0.5 < abs(slow.theta[0] - 3)


def test_rows_with_missing_samples_are_left_out() -> None:
    u = np.random.default_rng(3).uniform(size=12)
    y = setid.simulate(SECOND_ORDER, PLANT, u).ravel()
    y[6] = np.nan
    found = setid.least_squares(setid.IOData(u, y, y_range=(-50, 50)), SECOND_ORDER)
    assert found.row.tolist() == [2, 3, 4, 5, 9, 10, 11]
    np.testing.assert_allclose(found.theta, PLANT, atol=1e-9)


def test_several_outputs_and_records_share_parameters() -> None:
    model = setid.TransferFunction(1, 1, 1, inputs=2, outputs=2, common_denominator=True)
    theta = [-0.6, 1.0, 2.0, 3.0, -4.0]
    rng = np.random.default_rng(4)
    parts = []
    for _ in range(2):
        u = rng.uniform(size=(6, 2))
        parts.append(setid.IOData(u, setid.simulate(model, theta, u)))
    found = setid.least_squares(setid.IOData.concat(parts), model)
    assert found.residuals.size == 2 * 2 * 5
    np.testing.assert_allclose(found.theta, theta, atol=1e-10)


def test_wrong_inputs() -> None:
    data = setid.IOData([[1, 2], [2, 1], [0, 1]], [1, 2, 3])
    separate = setid.TransferFunction(1, 1, inputs=2)
    with pytest.raises(setid.ModelError, match="not linear in the parameters"):
        setid.least_squares(data, separate)
    with pytest.raises(setid.DataError, match="found 2 inputs and 1 outputs, expected 1 and 1"):
        setid.l1(data, SECOND_ORDER)
    short = setid.IOData([1, 2], [1, 2])
    with pytest.raises(setid.DataError, match="no complete row"):
        setid.linf(short, SECOND_ORDER)
    with pytest.raises(setid.SetidError, match="forgetting: found 0"):
        setid.recursive_least_squares(short, setid.TransferFunction(0, 1), forgetting=0)
    gain = setid.TransferFunction(0, 1)
    with pytest.raises(setid.SetidError, match=r"initial, covariance: found shapes \(2,\)"):
        setid.recursive_least_squares(short, gain, initial=[1, 2])
    with pytest.raises(setid.SetidError, match="initial: found list"):
        setid.recursive_least_squares(short, gain, initial=[1j])
    with pytest.raises(setid.SetidError, match="covariance: expected a symmetric positive"):
        setid.recursive_least_squares(short, gain, covariance=-1.0)
    with pytest.raises(setid.SetidError, match="name: found 'b9', expected one of b0"):
        setid.least_squares(short, setid.TransferFunction(0, 1))["b9"]
