"""Further cases of the course: chapters 3.1 and 5, laboratories 1, 2, 2b and 3.

Source: V. Cerone, course notes, Laboratory of Robust Identification and Control, Politecnico
di Torino (2024/25), and independent computations where that is said. Laboratories 1 and 2 are
mostly in ``test_setid_estimators.py``, ``test_setid_identify.py``, ``test_setid_consistency.py``
and ``test_setid_projections.py``, laboratory 5 in ``test_setid_identify.py``.
"""

from __future__ import annotations

import numpy as np
import pytest
from identification_cases import PLANT, laboratory_two_first
from scipy.signal import cont2discrete

import setid
import sparsepop_py as sp
from setid.priors.stability import step_down

QUICK = setid.Options(time_limit=60.0, progress=False)
SECOND = setid.TransferFunction(2, 3)


def test_the_plant_of_laboratory_one() -> None:
    """100 / (s^2 + 1.2 s + 1) with a hold of 1 s; its static gain is kept."""
    top, bottom, _ = cont2discrete(([100.0], [1.0, 1.2, 1.0]), 1.0, method="zoh")
    np.testing.assert_allclose(top.ravel()[1:], [32.23692235, 21.41034903], rtol=0, atol=5e-9)
    np.testing.assert_allclose(bottom[1:], [-0.7647215, 0.30119421], rtol=0, atol=5e-9)
    theta = [*bottom[1:], *top.ravel()]
    step = setid.simulate(SECOND, theta, np.ones(200)).ravel()
    assert step[-1] == pytest.approx(100.0, abs=1e-9)
    data = setid.IOData(np.arange(9.0) % 4, setid.simulate(SECOND, theta, np.arange(9.0) % 4))
    for gain, holds in ((100.0, True), (99.0, False)):
        prior = setid.DCGain(gain - 1e-6, gain + 1e-6)
        known = setid.formulate(data, SECOND, setid.Noise(output=1.0), prior)
        assert (known.problem.violation(known.point(theta)) < 1e-9) is holds


def test_the_record_of_laboratory_two() -> None:
    """y(1) = 0 is imposed, so that its error takes b0 u(1) away."""
    model, u = setid.TransferFunction(1, 1), [4.0, -3.0, 2.0, 1.0]
    y = setid.simulate(model, [-0.5, 2.0], u, [-8.0, -0.25, 0.3, -0.5])
    np.testing.assert_allclose(y.ravel(), [0, -6.25, 1.175, 2.0875], rtol=0, atol=1e-15)
    np.testing.assert_allclose(laboratory_two_first().y, y, rtol=0, atol=1e-15)


def test_laboratory_two_b_has_a_stationary_point_that_is_not_feasible() -> None:
    """Its value lies below the minimum: what a local point would report as the optimum."""
    x, y = sp.variables(2)
    cost = x**2 + y**2 - 4 * x - 6 * y + 13
    problem = sp.Problem(cost, [x * y - 7 * y == 10, y >= -x / 2 + 1])
    stationary = [0.799982, -1.612898]
    assert cost(stationary) == pytest.approx(22.718876, abs=5e-6)
    assert problem.violation(stationary) > 1.0
    result = sp.solve(problem, sp.Options(effort="auto", gap=1e-9))
    assert 52.706606 < result.lower_bound <= 52.7066065447 + 1e-8
    np.testing.assert_allclose(result.x, [8.8605284, 5.3748171], rtol=0, atol=1e-4)


# ---- chapter 5: stability -----------------------------------------------------------------


def jury(coefficients: np.ndarray) -> np.ndarray:
    """Whether 1 + a1 q^-1 + ... is stable, by Jury's recursion with |c_0| > |c_last|."""
    row = np.hstack([np.ones((len(coefficients), 1)), coefficients])
    stable = np.ones(len(row), bool)
    while row.shape[1] > 1:
        stable &= np.abs(row[:, 0]) > np.abs(row[:, -1])
        row = row[:, :1] * row - row[:, -1:] * row[:, ::-1]
        row = row[:, :-1] / np.maximum(np.abs(row[:, :1]), 1e-300)
    return stable


def test_the_inequalities_of_order_three() -> None:
    """The corrected rows agree with the roots; those with -1 + a1 - a2 + a3 > 0 do not."""
    a1, a2, a3 = triples = np.random.default_rng(5).uniform(-2, 2, (3, 20000))
    rest = (np.abs(a3) < 1) & ((a3 * a1 - a2) ** 2 < (a3**2 - 1) ** 2) & (1 + a1 + a2 + a3 > 0)
    roots = np.array([np.abs(np.roots([1.0, *a])).max() for a in triples.T])
    assert np.array_equal(rest & (1 - a1 + a2 - a3 > 0), roots < 1)
    assert np.count_nonzero((rest & (-1 + a1 - a2 + a3 > 0)) != (roots < 1)) > 500
    assert np.array_equal(jury(triples.T), roots < 1)


@pytest.mark.parametrize("order", [3, 4, 5, 6])
def test_reflection_coefficients_say_what_jury_and_the_roots_say(order: int) -> None:
    rng = np.random.default_rng(order)
    theta = np.array([np.poly(rng.uniform(-1.15, 1.15, order))[1:] for _ in range(4000)])
    roots = np.array([np.abs(np.roots([1.0, *a])).max() for a in theta])
    clear = np.abs(roots - 1.0) > 1e-6
    assert np.array_equal(jury(theta)[clear], (roots < 1)[clear])
    inside = theta[clear & (roots < 1)][:300]
    assert all(max(abs(k[-1]) for k in step_down(a)) < 1.0 for a in inside)


# ---- laboratory 3 and the levels of bounds --------------------------------------------------


def laboratory_three(samples: int, scale: float = 1.0) -> tuple[setid.IOData, setid.Noise]:
    """Errors in variables, |eta| <= 1, |xi| <= 0.01, input uniform on [0, 1]."""
    r = np.random.RandomState(5489)
    u, eta, xi = (r.random_sample(50) for _ in range(3))
    y = setid.simulate(SECOND, PLANT, u).ravel() + scale * (2 * eta - 1)
    data = setid.IOData((u + 0.01 * scale * (2 * xi - 1))[:samples], y[:samples])
    return data, setid.Noise(output=scale, input=0.01 * scale)


def widths(result: setid.Identification) -> np.ndarray:
    return np.array([item.width for item in result.intervals.values()])


@pytest.mark.slow
def test_laboratory_three_collapses_with_the_noise() -> None:
    """Widths are about proportional to the noise, and the truth stays inside."""
    found = []
    for scale in (0.1, 1e-3):
        data, noise = laboratory_three(14, scale)
        found.append(setid.identify(data, SECOND, noise, options=QUICK))
        for name, value in zip(SECOND.parameters, PLANT.tolist(), strict=True):
            assert value in found[-1].intervals[name]
    assert np.all(widths(found[1]) < 0.02 * widths(found[0]))


@pytest.mark.slow
def test_laboratory_three_is_nested() -> None:
    (short, noise), (long, _) = laboratory_three(25), laboratory_three(50)
    options = setid.Options(time_limit=200.0, progress=False)
    before, after = (setid.identify(d, SECOND, noise, options=options) for d in (short, long))
    for name, value in zip(SECOND.parameters, PLANT.tolist(), strict=True):
        low, high = before.intervals[name].outer
        inner = after.intervals[name].inner
        assert value in before.intervals[name] and value in after.intervals[name]
        assert inner is not None and low <= inner[0] and inner[1] <= high


@pytest.mark.slow
def test_each_level_of_bounds_contains_the_next() -> None:
    """The box from the data, the engine's bounds, attained values; and what no time proves."""
    data, noise = laboratory_three(14, 0.1)
    result = setid.identify(data, SECOND, noise, options=QUICK)
    box = result.box
    assert isinstance(box, setid.ParameterBox)
    first = setid.identify(
        data, SECOND, noise, options=setid.Options(time_limit=1e-3, progress=False)
    )
    for place, (name, item) in enumerate(result.intervals.items()):
        outer = first.intervals[name].outer
        assert outer[0] <= item.inner[0] <= item.inner[1] <= outer[1]
        assert box.lower[place] <= item.outer[0] <= item.inner[0]
        assert item.inner[1] <= item.outer[1] <= box.upper[place]
    assert np.all(widths(result) < 0.9 * (box.upper - box.lower))
