"""Continuous-time structures: their rows, their recursion and its error.

Tustin's rows of orders 1 and 2 are the textbook ones (numerator T (T b0 + 2 b1), 2 T^2 b0,
T (T b0 - 2 b1) over T^2 a0 + 2 T a1 + 4, 2 (T^2 a0 - 4), T^2 a0 - 2 T a1 + 4, by substituting
s = 2 (z - 1) / (T (z + 1)) by hand); higher orders are expanded by sympy.
"""

from __future__ import annotations

import re
from fractions import Fraction

import mpmath
import numpy as np
import pytest
import sympy
from continuous_cases import SCIPY, THETA, exact_samples, levels
from scipy.signal import cont2discrete, lfilter, lsim

import setid
from setid.models.continuous import at_rate
from setid.models.equations import Structure

T = 0.25  # a power of two: rows are then exact


def row_of(model: setid.ContinuousTransferFunction) -> dict[tuple[str, str, int], float]:
    """Coefficients by parameter, signal and lag."""
    (equation,) = model.equations()
    found: dict[tuple[str, str, int], float] = {}
    for term in equation.terms:
        (lagged,) = term.signals
        key = "".join(term.parameters), lagged.signal, lagged.lag
        assert key not in found
        found[key] = term.coefficient
    return found


@pytest.mark.parametrize(("n", "m"), [(1, 0), (1, 1), (2, 0), (2, 1), (2, 2), (3, 1), (4, 3)])
def test_rows_of_tustin_are_the_substitution(n: int, m: int) -> None:
    z = sympy.Symbol("z")  # q^-1
    step = sympy.Rational(1, 4)
    s = 2 / step * (1 - z) / (1 + z)
    row = row_of(setid.ContinuousTransferFunction(n, m, Ts=T))
    expected: dict[tuple[str, str, int], float] = {}
    scale = (step / 2) ** n * (1 + z) ** n
    for name, signal, power, sign in (
        [("", "y1", n, 1)]
        + [(f"a{i}", "y1", i, 1) for i in range(n)]
        + [(f"b{i}", "u1", i, -1) for i in range(m + 1)]
    ):
        whole = sympy.Poly(sympy.cancel(sign * s**power * scale), z)
        for (lag,), value in whole.terms():
            expected[name, signal, lag] = float(value)
    assert row == {key: value for key, value in expected.items() if value}


def test_rows_of_order_two_are_the_textbook_ones() -> None:
    a1, a0, b1, b0 = 3.0, 2.0, 1.0, 4.0
    for step in (0.1, 0.5):
        model = setid.ContinuousTransferFunction(2, 1, Ts=step)
        numerator, denominator = model.discrete([a1, a0, b1, b0])
        bottom = np.array(
            [
                step**2 * a0 + 2 * step * a1 + 4,
                2 * (step**2 * a0 - 4),
                step**2 * a0 - 2 * step * a1 + 4,
            ]
        )
        top = step * np.array([step * b0 + 2 * b1, 2 * step * b0, step * b0 - 2 * b1])
        np.testing.assert_allclose(denominator, bottom / bottom[0], rtol=1e-14)
        np.testing.assert_allclose(numerator, top / bottom[0], rtol=1e-13)
    first = setid.ContinuousTransferFunction(1, 1, Ts=0.1).discrete([2.0, 0.5, 3.0])
    np.testing.assert_allclose(first[0], np.array([0.3 + 1.0, 0.3 - 1.0]) / 2.2, rtol=1e-14)
    np.testing.assert_allclose(first[1], [1.0, (0.2 - 2.0) / 2.2], rtol=1e-14)


@pytest.mark.parametrize("hold", ["linear", "constant"])
@pytest.mark.parametrize("n", [1, 2, 4])
def test_rows_of_lambda_are_static_in_filtered_signals(n: int, hold: str) -> None:
    """Divided by the filter's denominator they are tau^(n-i) (1 - lam)^i lam^(n-i)."""
    step, tau = 0.3, 0.7
    model = setid.ContinuousTransferFunction(n, n - 1, method="lambda", tau=tau, hold=hold, Ts=step)
    z = np.exp(-1j * np.linspace(0.1, 3.0, 7))

    def filter_of(kind: str) -> np.ndarray:
        top, bottom, _ = cont2discrete(([1.0], [tau, 1.0]), step, method=SCIPY[kind])
        return np.polyval(top.ravel()[::-1], z) / np.polyval(bottom[::-1], z)

    lam, held = filter_of("linear"), filter_of(hold)
    decay = np.exp(-step / tau)
    scale = ((1 - decay * z) / ((1 - decay) * tau / step)) ** n
    for i in range(n + 1):
        static = tau ** (n - i) * (1 - lam) ** i * lam ** (n - i)
        row = np.polyval(model.operator(i)[::-1], z)
        np.testing.assert_allclose(row, static * scale, rtol=1e-10)
        if i < n:
            driven = np.polyval(model.operator(i, "u")[::-1], z)
            np.testing.assert_allclose(driven, static / lam * held * scale, rtol=1e-10)


@pytest.mark.parametrize("tau", [0.05, 0.4, 3.0])
def test_first_order_lambda_recovers_coefficients_from_filtered_signals(tau: float) -> None:
    """y = (1 - a0 tau) y' + b1 u + (b0 tau - b1) u' in signals filtered exactly by scipy."""
    a0, b1, b0 = 2.0, 0.5, 3.0
    model = setid.ContinuousTransferFunction(1, 1, method="lambda", tau=tau, Ts=0.1)
    u = np.random.default_rng(2).uniform(-1, 1, 60)
    u[0] = 0.0
    y = setid.simulate(model, [a0, b1, b0], u)[:, 0]
    time = 0.1 * np.arange(60)
    system = ([1.0], [tau, 1.0])
    filtered = [lsim(system, signal, time)[1] for signal in (y, u)]
    g1, g2, g3 = np.linalg.lstsq(np.stack([filtered[0], u, filtered[1]], 1), y, rcond=None)[0]
    found = [(1 - g1) / tau, g2, (g3 + g2) / tau]
    np.testing.assert_allclose(found, [a0, b1, b0], rtol=1e-8)


@pytest.mark.parametrize("hold", ["linear", "constant"])
def test_lambda_is_exact_for_a_response_with_its_time_constant(hold: str) -> None:
    theta = [2.0, 3.0] if hold == "constant" else [2.0, 0.5, 3.0]
    u = np.random.default_rng(0).uniform(-1, 1, 50)

    def error(**how: object) -> float:
        model = setid.ContinuousTransferFunction(1, len(theta) - 2, hold=hold, Ts=0.1, **how)
        return float(np.abs(setid.discretisation_error(model, theta, u)).max())

    assert error(method="lambda", tau=0.5) < 1e-14
    assert error() > 1e-4
    assert error(method="lambda", tau=1e5) == pytest.approx(error(), rel=1e-4)


@pytest.mark.parametrize("hold", ["linear", "constant"])
def test_the_error_falls_with_the_square_of_the_interval(hold: str) -> None:
    sizes = []
    for step in (0.2, 0.1, 0.05):
        time = step * np.arange(round(12 / step))
        u = levels(step, 30) if hold == "constant" else np.sin(time) + np.sin(2.2 * time)
        model = setid.ContinuousTransferFunction(2, 1, hold=hold, Ts=step)
        error = setid.discretisation_error(model, THETA, u)
        np.testing.assert_allclose(
            error, setid.simulate(model, THETA, u)[:, 0] - exact_samples(u, step, hold), atol=1e-12
        )
        sizes.append(np.abs(error).max())
    assert 3.5 < sizes[0] / sizes[1] < 4.5 and 3.5 < sizes[1] / sizes[2] < 4.5


@pytest.mark.parametrize("method", ["tustin", "lambda"])
def test_simulation_solves_for_the_sample(method: str) -> None:
    tau = 0.3 if method == "lambda" else None
    model = setid.ContinuousTransferFunction(2, 2, method=method, tau=tau, Ts=0.2)
    theta = [1.2, 2.0, 0.3, 0.5, 2.0]
    u = np.random.default_rng(5).uniform(-1, 1, 40)
    numerator, denominator = model.discrete(theta)
    expected = lfilter(numerator, denominator, u)
    np.testing.assert_allclose(setid.simulate(model, theta, u)[:, 0], expected, atol=1e-12)
    data = setid.IOData(u, expected, Ts=0.2)
    from setid.simulation.responses import run

    np.testing.assert_allclose(run(model, theta, data)[:, 0], expected, atol=1e-12)


def test_names_fall_with_the_power_of_s() -> None:
    model = setid.ContinuousTransferFunction(3, 1)
    assert isinstance(model, Structure)
    assert model.parameters == ("a2", "a1", "a0", "b1", "b0")
    transfer = model.transfer(1, 1)
    assert transfer.continuous and transfer.delay == 2 and transfer.numerator == ("b1", "b0")
    indirect = setid.ContinuousTransferFunction(2, 1, method="indirect", hold="constant")
    assert indirect.parameters == ("a1", "a2", "b1", "b2")
    assert setid.ContinuousTransferFunction(2, 1, method="indirect").parameters[2:] == (
        "b0",
        "b1",
        "b2",
    )


C = setid.ContinuousTransferFunction


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: C(0, 0), "n: found 0, expected an integer >= 1"),
        (lambda: C(2, 3), "m: found 3, expected at most n = 2"),
        (lambda: C(2, 2, hold="constant"), "m: found 2, expected at most n = 2, and less"),
        (lambda: C(2, 1, method="euler"), "method: found 'euler', expected one of tustin"),
        (lambda: C(2, 1, method="lambda"), "tau: found None, expected the time constant"),
        (lambda: C(2, 1, tau=1.0), "tau: found 1.0, expected .* none otherwise"),
        (lambda: C(2, 1, method="lambda", tau=0.0), "tau: found 0.0, expected a finite number > 0"),
        (lambda: C(2, 1, delta=-0.1), "delta: found -0.1, expected a finite number >= 0"),
        (lambda: C(2, 1, delta="guess"), "delta: found 'guess', expected a number"),
        (lambda: C(2, 1, method="indirect", delta=0.1), "delta: found 0.1, expected 0 with"),
        (lambda: C(2, 1, initial="zero", offset=True), "offset: found True with initial='zero'"),
        (lambda: C(2, 1, Ts=0), "Ts: found 0, expected a finite number > 0"),
        (lambda: setid.simulate(C(2, 1), THETA, [1.0, 2.0]), "Ts: found None, expected the sampl"),
        (lambda: at_rate(C(2, 1, Ts=0.1), 0.2), "Ts: found 0.1 in the model, expected 0.2"),
        (lambda: setid.simulate(C(1, 0, Ts=2.0), [-1.0, 1.0], [1.0]), "found a factor of zero"),
        (
            lambda: setid.formulate(
                setid.IOData([1, 2, 1], [1, 2, 3]), C(1, 0, delta="estimate"), setid.Noise(0.1)
            ),
            "delta: found 'estimate', expected a number",
        ),
        (
            lambda: setid.estimate_delta(
                setid.IOData([1, 2, 1], [1, 2, 3]), C(1, 0, method="indirect"), setid.Noise(0.1)
            ),
            "model: found .* expected a ContinuousTransferFunction of method",
        ),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(wrong: object, message: str) -> None:
    with pytest.raises(setid.ModelError, match=message):
        wrong()


@pytest.mark.parametrize(
    ("interval", "n", "fits"),
    [
        (5e-324, 1, False),  # half of it is 0
        (1e-308, 1, False),
        (1e-200, 2, False),
        (1e300, 3, False),
        (1e-280, 1, True),
        (1e-9, 8, True),
        (1e30, 8, True),
    ],
)
def test_intervals_whose_powers_leave_the_range_of_doubles_are_refused(
    interval: float, n: int, fits: bool
) -> None:
    """Rounding is relative only within it: at 5e-324 a consistent record was proved empty."""
    model = setid.ContinuousTransferFunction(n, 0, Ts=interval)
    if fits:
        weights = model.operator(0)
        assert np.all(weights > 0)
        first = Fraction(interval) ** n / 2**n  # Tustin's rule: (interval / 2)^n (1 + q^-1)^n
        assert abs(Fraction(weights[0]) / first - 1) <= Fraction(1, 2**48)
    else:
        with pytest.raises(
            setid.ModelError, match=re.escape(f"Ts: found {interval!r}, whose powers")
        ):
            model.operator(0)


@pytest.mark.parametrize("ratio", [1e-9, 1e-5, 9e-4, 1.1e-3, 0.03, 2.0])
def test_the_first_weight_of_lambda_to_high_precision(ratio: float) -> None:
    """tau (1 - e) / e with e = (1 - exp(-x)) / x, by mpmath with 60 digits."""
    step, tau = 0.25, 0.25 / ratio
    model = setid.ContinuousTransferFunction(1, 0, method="lambda", tau=tau, Ts=step)
    with mpmath.workdps(60):
        e = -mpmath.expm1(-mpmath.mpf(step) / tau) / (mpmath.mpf(step) / tau)
        weight = float(tau * (1 - e) / e)
    first, second = model.operator(0)
    np.testing.assert_allclose([first, second], [weight, step - weight], rtol=1e-11)


@pytest.mark.parametrize(("n", "method"), [(1, "tustin"), (2, "tustin"), (3, "lambda")])
def test_the_row_of_an_offset_holds_at_rest(n: int, method: str) -> None:
    """At rest a0 y = c, by hand: derivatives vanish."""
    tau = 0.7 if method == "lambda" else None
    model = setid.ContinuousTransferFunction(n, 0, method, tau=tau, Ts=T, offset=True)
    found = dict.fromkeys(("", *model.parameters), 0.0)
    for term in model.equations()[0].terms:
        if not term.signals or term.signals[0].signal == "y1":
            found["".join(term.parameters)] += term.coefficient
    assert found["a0"] > 0
    np.testing.assert_allclose([found["a0"], found["c"]], [T**n, -(T**n)], rtol=1e-12)
    others = [value for name, value in found.items() if name not in ("a0", "c")]
    np.testing.assert_allclose(others, 0.0, atol=1e-14)


def test_the_indirect_recursion_is_that_of_its_discrete_coefficients() -> None:
    """y(k) - 0.5 y(k-1) = u(k) + 2 u(k-1), and with a held input 3 u(k-1) alone."""
    indirect = setid.ContinuousTransferFunction(1, 1, method="indirect", Ts=0.1)
    top, bottom = indirect.discrete({"a1": -0.5, "b0": 1.0, "b1": 2.0})
    assert top.tolist() == [1.0, 2.0]
    assert bottom.tolist() == [1.0, -0.5]
    held = setid.ContinuousTransferFunction(1, 0, method="indirect", hold="constant", Ts=0.1)
    top, bottom = held.discrete([-0.5, 3.0])
    assert top.tolist() == [0.0, 3.0]
    assert bottom.tolist() == [1.0, -0.5]


@pytest.mark.parametrize(
    ("theta", "u", "message"),
    [
        ([1.0, 1.0, 7.0], [1.0, 2.0], r"theta: found shape \(3,\), expected 2 numbers"),
        ([1.0, 1j], [1.0, 2.0], "theta: found list"),
        ({"a0": 1.0}, [1.0, 2.0], "theta: found names"),
        ([1.0, 1.0], [[1.0, 2.0], [3.0, 4.0]], "u: found 2 columns, expected one input"),
        ([1.0, 1.0], ["1", "2"], "u: found list"),
    ],
)
def test_numbers_that_do_not_fit_have_no_discretisation_error(
    theta: object, u: object, message: str
) -> None:
    with pytest.raises(setid.SetidError, match=message):
        setid.discretisation_error(setid.ContinuousTransferFunction(1, 0, Ts=0.1), theta, u)


def test_coefficients_of_recursions_are_counted() -> None:
    with pytest.raises(setid.SetidError, match="theta: found shape"):
        setid.ContinuousTransferFunction(1, 0, Ts=2.0).discrete([1.0])


def test_discrete_coefficients_have_no_discretisation_error() -> None:
    model = setid.ContinuousTransferFunction(1, 1, method="indirect", Ts=0.1)
    with pytest.raises(setid.ModelError, match="expected one of physical coefficients"):
        setid.discretisation_error(model, [-0.5, 1.0, 2.0], [1.0, 2.0])
