"""Polytopes from sums of rows, and bounds on arcs: nothing consistent may be lost."""

from __future__ import annotations

import time
from fractions import Fraction
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

import setid
from setid.control.certificates.arcs import Family, first_arcs, ratio_on_arcs, zero_free
from setid.control.parameters.parameter_set import ParameterSet, consistent_set
from setid.control.parameters.polytope import Polytope
from setid.control.parameters.ratios import ratio_range
from setid.control.parameters.rows import noisy_rows
from setid.control.parameters.sums import Frame, rows_on_box, sums_of


def record(
    seed: int, output: float, input: float, samples: int = 60
) -> tuple[setid.IOData, np.ndarray]:
    rng = np.random.default_rng(seed)
    theta = np.array([-1.2, 0.5, 1.0, 0.4])
    u = rng.uniform(-1, 1, samples)
    y = lfilter([0, *theta[2:]], [1, *theta[:2]], u)
    noisy = (
        u + input * rng.choice([-1.0, 1.0], samples),
        y + output * rng.choice([-1.0, 1.0], samples),
    )
    return setid.IOData(*noisy), theta


MODEL = setid.TransferFunction(2, 2, nk=1)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("output", "input"), [(0.01, 0.0), (0.0, 0.005), (0.01, 0.002)])
def test_the_true_parameters_stay_inside_with_extreme_noise(
    seed: int, output: float, input: float
) -> None:
    data, theta = record(seed, output, input)
    found = consistent_set(data, MODEL, setid.Noise(output=output, input=input))
    assert found is not None
    low, high = found.box
    assert np.all(low <= theta) and np.all(theta <= high)
    assert np.all(np.abs(theta) <= found._reach)
    assert np.all(high - low < 0.5)
    z = np.linalg.solve(found.frame.axes, theta - found.frame.origin)
    assert np.all(found.polytope.matrix @ z <= found.polytope.right + 1e-9)


def test_the_set_is_little_wider_than_what_is_attained() -> None:
    data, _ = record(0, 0.01, 0.0)
    noise = setid.Noise(output=0.012)
    found = consistent_set(data, MODEL, noise)
    assert found is not None
    options = setid.Options(time_limit=20.0, progress=False)
    engine = setid.identify(data, MODEL, noise, options=options)
    low, high = found.box
    for place, item in enumerate(engine.intervals.values()):
        assert item.inner is not None
        assert low[place] <= item.inner[0] and item.inner[1] <= high[place]
        assert high[place] - low[place] < 1.5 * (item.inner[1] - item.inner[0])


def test_too_small_a_noise_bound_is_proved_empty() -> None:
    data, _ = record(3, 0.05, 0.0)
    found = consistent_set(data, MODEL, setid.Noise(output=0.01))
    assert found is not None and found.empty


def test_an_integrator_is_a_linear_row() -> None:
    rng = np.random.default_rng(0)
    u = rng.uniform(-1, 1, 60)
    y = lfilter([0, 1.0, 0.4], np.poly([1.0, 0.6]), u) + rng.uniform(-0.02, 0.02, 60)
    found = consistent_set(setid.IOData(u, y), MODEL, setid.Noise(output=0.02), integrators=1)
    assert found is not None
    low, high = found.ranges(np.ones(1), np.array([[1.0, 1.0, 0.0, 0.0]]))
    assert -1e-12 < low[0] <= 0.0 <= high[0] < 1e-12
    ends = found.box
    truth = np.array([-1.6, 0.6, 1.0, 0.4])
    assert np.all(ends[0] <= truth) and np.all(truth <= ends[1])


def test_rows_hold_for_every_noise_within_its_bounds() -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        data, theta = record(int(rng.integers(1000)), 0.05, 0.03, samples=20)
        rows = noisy_rows(data, MODEL, setid.Noise(output=0.05, input=0.03))
        frame = Frame(theta + rng.normal(0, 0.1, 4), rng.normal(0, 1, (4, 4)))
        z = np.linalg.solve(frame.axes, theta - frame.origin)
        box = Polytope(
            z - rng.uniform(0, 0.3, 4), z + rng.uniform(0, 0.3, 4), np.zeros((0, 4)), np.zeros(0)
        )
        sums = sums_of(rows, rng.normal(0, 1, (30, rows.target.size)), frame)
        matrix, right = rows_on_box(sums, box)
        assert np.all(matrix @ z <= right + 1e-9)


def test_ranges_of_a_polytope_are_those_of_its_vertices() -> None:
    square = Polytope(-np.ones(2), np.ones(2), np.array([[1.0, 1.0]]), np.array([1.0]))
    vertices = np.array([[-1, -1], [-1, 1], [0, 1], [1, 0], [1, -1]], float)
    directions = np.random.default_rng(0).normal(size=(50, 2))
    low, high = square.ranges(directions)
    values = directions @ vertices.T
    np.testing.assert_allclose(low, values.min(axis=1), atol=1e-9)
    np.testing.assert_allclose(high, values.max(axis=1), atol=1e-9)
    assert np.all(low <= values.min(axis=1)) and np.all(high >= values.max(axis=1))


def test_contradictory_rows_are_proved_empty() -> None:
    ends = -np.ones(2), np.ones(2)
    rows = np.array([[1.0, 1.0], [-1.0, -1.0]])
    assert Polytope(*ends, rows, np.array([0.5, -0.6])).proved_empty()
    assert not Polytope(*ends, rows, np.array([0.6, -0.5])).proved_empty()


def narrow() -> tuple:
    data, theta = record(0, 0.01, 0.0)
    found = consistent_set(data, MODEL, setid.Noise(output=0.01))
    assert found is not None
    z = np.random.default_rng(0).uniform(found.polytope.lower, found.polytope.upper, (400, 4))
    inside = np.all(z @ found.polytope.matrix.T <= found.polytope.right, axis=1)
    members = [found.theta(v) for v in z[inside]]
    return found, [theta, *members]


def test_ratios_on_arcs_hold_between_grid_points() -> None:
    found, members = narrow()
    top = Family(np.zeros(3), np.array([[0, 0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]))
    below = Family(np.array([1.0, 0, 0]), np.array([[0, 0, 0, 0], [1.0, 0, 0, 0], [0, 1.0, 0, 0]]))
    arcs = ratio_on_arcs(found, top, below, found.centre, 0.0)
    assert arcs[0][0] == 0.0 and arcs[-1][1] == pytest.approx(np.pi)
    for (_, end, _), (begin, _, _) in zip(arcs[:-1], arcs[1:], strict=True):
        assert begin <= end  # no gap
    for theta in members[:40]:
        for low, high, bound in arcs:
            step = np.exp(-1j * np.linspace(low, high, 5)[:, None] * np.arange(3))
            values = np.abs((step @ top.at(theta)) / (step @ below.at(theta)))
            assert np.all(values <= bound)


def test_a_zero_on_the_circle_is_never_excluded() -> None:
    found, members = narrow()
    for number, theta in enumerate(members[:20]):
        w = 0.1 + 0.14 * number
        # 1 + x a1 + y a2 of this member vanishes at exp(j w): solve for a known factor
        a = np.array([1.0, *theta[:2]])
        value = a @ np.exp(-1j * w * np.arange(3))
        constant = Family(
            np.array([1.0, 0, 0]), np.array([[0] * 4, [1.0, 0, 0, 0], [0, 1.0, 0, 0]])
        )
        # subtract a fixed polynomial p with p(w) = value, so that the member's difference vanishes
        p1 = -value.imag / np.sin(w)
        p = np.array([value.real - p1 * np.cos(w), p1, 0.0])
        family = Family(constant.constants - p, constant.weights)
        assert abs(family.at(theta) @ np.exp(-1j * w * np.arange(3))) < 1e-12
        assert zero_free(found, family, found.centre)


def test_stable_denominators_are_free_of_zeros() -> None:
    found, _ = narrow()
    family = Family(np.array([1.0, 0, 0]), np.array([[0] * 4, [1.0, 0, 0, 0], [0, 1.0, 0, 0]]))
    assert zero_free(found, family, found.centre) == []


def test_bounds_on_arcs_keep_a_deadline_and_stay_bounds() -> None:
    found, members = narrow()
    top = Family(np.zeros(3), np.array([[0, 0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]))
    below = Family(np.array([1.0, 0, 0]), np.array([[0, 0, 0, 0], [1.0, 0, 0, 0], [0, 1.0, 0, 0]]))
    arcs = ratio_on_arcs(found, top, below, found.centre, 0.0, until=0.0)
    assert len(arcs) == len(first_arcs()) < len(ratio_on_arcs(found, top, below, found.centre, 0.0))
    for theta in members[:10]:
        for low, high, bound in arcs:
            step = np.exp(-1j * np.linspace(low, high, 5)[:, None] * np.arange(3))
            assert np.all(np.abs((step @ top.at(theta)) / (step @ below.at(theta))) <= bound)
    # zeros at 0.999 exp(+-j): more than the first arcs are needed, and a deadline says where
    r = 0.999
    near = Family(np.array([1.0, -2 * r * np.cos(1.0), r * r]), np.zeros((3, 4)))
    assert zero_free(found, near, found.centre) == []
    late = zero_free(found, near, found.centre, until=0.0)
    assert late and all(abs(w - 1.0) < 0.2 for w in late)


def test_a_clock_only_chooses_between_two_sets(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is made under a limit is made again by a check without one; a set cut short is not."""
    u = np.random.default_rng(4).uniform(-1, 1, 16)
    y = lfilter([0, 0.8], [1, -0.2, -0.3], u)
    parts = setid.IOData(u, y), setid.TransferFunction(2, 1, 1), setid.Noise(output=0.003)
    full, brief = (consistent_set(*parts, brief=short).box for short in (False, True))
    assert not np.array_equal(full, brief)
    whole = []
    for last in (0, 9, 25, 60, 10**6):
        clock = (0.0 if reading < last else 2.0 for reading in count())
        monkeypatch.setattr(time, "monotonic", clock.__next__)
        box = consistent_set(*parts, until=1.0).box
        whole.append(np.array_equal(box, full))
        assert whole[-1] or np.array_equal(box, brief)
    assert whole == sorted(whole) and not whole[0] and whole[-1]


@pytest.mark.parametrize("reach", [1.0, np.inf])
def test_the_rounding_of_weights_is_paid_for(reach: float) -> None:
    """At theta = (1, 1) the weights 10^17 + 1/3 and -10^17 give 1/3, as doubles 0."""
    third, large = Fraction(1, 3), Fraction(10**17)
    point = SimpleNamespace(
        ranges=lambda constants, weights: (weights.sum(axis=1), weights.sum(axis=1)),
        _reach=[reach, reach],
    )
    low, high = ParameterSet.exact_ranges(point, [[large + third, -large], [large, -large]])
    assert low[0] <= third <= high[0]
    assert (low[1], high[1]) == (0.0, 0.0)
    assert np.isfinite(high[0]) == np.isfinite(reach)


def in_a_box(*box: tuple[float, float]) -> SimpleNamespace:
    """Stand for a set of parameters with these ranges."""
    low, high = np.array(box).T

    def ranges(constants: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        ends = np.sort(np.stack([weights * low, weights * high]), axis=0).sum(axis=2)
        return constants + ends[0], constants + ends[1]

    found = SimpleNamespace(ranges=ranges, _reach=np.maximum(-low, high).tolist())
    found.exact_ranges = lambda weights: ParameterSet.exact_ranges(found, weights)
    return found


def test_ratios_of_weights_that_no_double_holds() -> None:
    """Of 1/3 theta_1 by theta_2, theta_1 in [3, 6] and theta_2 in [1, 2]."""
    found = in_a_box((3.0, 6.0), (1.0, 2.0))
    low, high = ratio_range(found, [Fraction(1, 3), Fraction()], [Fraction(), Fraction(1)])
    assert 0.5 - 1e-12 <= low <= 0.5 and 2.0 <= high <= 2.0 + 1e-12


def test_ratios_whose_weights_are_beyond_all_doubles() -> None:
    """Of theta_1 by 7 theta_2, theta_2 in [1e-300, 2e-300]: bisection tries 7 * 1e308."""
    found = in_a_box((1.0, 1e8), (1e-300, 2e-300))
    low, high = ratio_range(found, [Fraction(1), Fraction()], [Fraction(), Fraction(7)])
    assert low <= 1 / 14e-300 and 1e8 / 7e-300 <= high
    huge = [[Fraction(10) ** 400, Fraction(1)]]
    low, high = found.exact_ranges(huge)
    assert (low[0], high[0]) == (-np.inf, np.inf)
