"""Outputs of 3000, gains of 200 and noise that leaves widths of 30 %: nothing may fail."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from exact_polynomials import value_at
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from slow_values import slow_unless

import setid
import sparsepop_py as sp
from setid.formulation.units import in_units

QUICK = setid.Options(time_limit=60.0, progress=False)
FIRST, SECOND = setid.TransferFunction(1, 1), setid.TransferFunction(2, 2, 1)
TRUTH = {FIRST: (-0.9, 200.0), SECOND: (-1.5, 0.7, 200.0, -90.0)}


def record(model: setid.TransferFunction, noise: setid.Noise, samples: int) -> setid.Simulated:
    """Steps of a slow input, so that outputs reach the static gain."""
    u = np.repeat(np.random.default_rng(4).uniform(-2.0, 2.0, samples), 4)[:samples]
    return setid.simulate_record(model, TRUTH[model], u, noise, 4)


def explained(data: setid.IOData, bound: float, a: float, b: float) -> bool:
    """Whether some |eta| <= bound explains a record of order one, by a linear program."""
    y, u = data.y.ravel(), data.u.ravel()
    count = y.size
    step = np.eye(count)[1:] + a * np.eye(count)[:-1]
    found = linprog(
        np.zeros(count), A_eq=step, b_eq=step @ y - b * u[1:], bounds=[(-bound, bound)] * count
    )
    return found.status == 0


def test_wide_intervals_of_large_numbers_agree_with_linear_programs_on_a_grid() -> None:
    bound = 700.0
    truth = record(FIRST, setid.Noise(output=bound), 24)
    assert np.abs(truth.y).max() > 1500 and np.abs(truth.data.y).max() > 2000
    result = setid.identify(truth.data, FIRST, setid.Noise(output=bound), options=QUICK)
    assert result.status == "certified" and bool(result.verify(truth.data))
    assert all(v in result.intervals[n] for n, v in truth.theta.items())
    (low_a, high_a), (low_b, high_b) = (result.intervals[n].outer for n in ("a1", "b0"))
    assert high_b - low_b > 0.3 * 200.0  # strong noise
    wide = 0.25 * (high_a - low_a), 0.25 * (high_b - low_b)
    inside = 0
    for a in np.linspace(low_a - wide[0], high_a + wide[0], 13):
        for b in np.linspace(low_b - wide[1], high_b + wide[1], 13):
            if explained(truth.data, bound, float(a), float(b)):
                inside += 1
                assert low_a <= a <= high_a and low_b <= b <= high_b
    assert inside > 5
    for name, place in (("a1", 0), ("b0", 1)):  # what is attained is explained
        for witness in result.intervals[name].witnesses:
            assert witness is not None
            theta = witness[:2]
            assert explained(truth.data, bound * (1 + 1e-7), *theta.tolist())
            assert (
                min(abs(theta[place] - e) for e in result.intervals[name].outer)
                < 1e-2 * wide[place] * 4
            )


@pytest.mark.slow
def test_errors_in_variables_of_order_two_scale_with_their_units() -> None:
    """Intervals in other units, 4096 times smaller, contain what is attained in these."""
    noise = setid.Noise(output=30.0, input=0.01)
    truth = record(SECOND, noise, 14)
    assert np.abs(truth.y).max() > 1000
    small = setid.IOData(truth.data.u, truth.data.y / 4096.0)
    less = setid.Noise(output=30.0 / 4096.0, input=0.01)
    pair = [
        setid.identify(data, SECOND, bounds, options=QUICK)
        for data, bounds in ((truth.data, noise), (small, less))
    ]
    for result in pair:
        assert bool(result.verify())
    for name, value in truth.theta.items():
        large, other = (result.intervals[name] for result in pair)
        factor = 1.0 if name[0] == "a" else 4096.0
        assert value in large and large.inner is not None and other.inner is not None
        for mine, theirs in ((large, other.inner), (other, large.inner)):
            unit = factor if mine is large else 1.0 / factor
            assert mine.outer[0] <= theirs[0] * unit and theirs[1] * unit <= mine.outer[1]
        assert large.status == other.status == "certified"


@pytest.mark.parametrize(
    ("y_unit", "u_unit"),
    slow_unless(
        lambda y_unit, u_unit: (y_unit, u_unit) in ((1e12, 1e-9), (1e-10, 1e-10)),
        [(1e-9, 1.0), (1e12, 1.0), (1.0, 1e6), (1e12, 1e-9), (1e-10, 1e-10)],
    ),
)
def test_units_of_a_record_change_nothing_but_the_units_of_the_intervals(
    y_unit: float, u_unit: float
) -> None:
    """What is proved in one unit holds what is attained in the other."""
    model, noise = setid.TransferFunction(1, 1, 1), setid.Noise(output=0.05, input=0.03)
    u = np.random.default_rng(3).uniform(-1.0, 1.0, 25)
    plain = setid.simulate_record(model, (-0.5, 1.0), u, noise, 7).data
    other = setid.IOData(plain.u * u_unit, plain.y * y_unit)
    strange = setid.Noise(output=0.05 * y_unit, input=0.03 * u_unit)
    mine = setid.identify(plain, model, noise, options=QUICK)
    theirs = setid.identify(other, model, strange, options=QUICK)
    assert mine.status == theirs.status == "certified"
    assert bool(theirs.verify(other))
    for name, factor in (("a1", 1.0), ("b1", y_unit / u_unit)):
        one, two = mine.intervals[name], theirs.intervals[name]
        spare = 1e-9 * one.width  # units that are no powers of two round the readings
        assert one.inner is not None and two.inner is not None
        assert one.outer[0] - spare <= two.inner[0] / factor
        assert two.inner[1] / factor <= one.outer[1] + spare
        assert two.outer[0] / factor <= one.inner[0] + spare
        assert one.inner[1] - spare <= two.outer[1] / factor
        for end, witness in enumerate(two.witnesses):
            assert witness is not None and witness[{"a1": 0, "b1": 1}[name]] == pytest.approx(
                two.inner[end], rel=1e-9
            )
            assert setid.least_noise(theirs.formulation, witness[:2]).level <= 1.0 + 1e-6


def test_estimates_scale_with_their_units() -> None:
    u = np.random.default_rng(3).uniform(-1.0, 1.0, 60)
    noise = setid.Noise(output=0.05)
    plain = setid.simulate_record(SECOND, (-1.2, 0.4, 1.0, 0.5), u, noise, 7).data
    for y_unit, u_unit in ((1e-12, 1e-12), (1e12, 1e-9), (1e-30, 1e20)):
        other = setid.IOData(plain.u * u_unit, plain.y * y_unit)
        scale = np.array([1.0, 1.0, u_unit / y_unit, u_unit / y_unit])
        for estimate in (setid.linf, setid.l1, setid.least_squares):
            found, known = estimate(other, SECOND).theta * scale, estimate(plain, SECOND).theta
            assert np.allclose(found, known, rtol=1e-6)
        known = setid.formulate(other, SECOND, setid.Noise(output=0.05 * y_unit))
        level = setid.least_noise(known, estimate(other, SECOND).theta).level
        first = setid.least_noise(
            setid.formulate(plain, SECOND, noise), estimate(plain, SECOND).theta
        ).level
        assert abs(level - first) <= 1e-6 * first
        assert 0.1 < level  # not zero: the tolerance of a solver is no noise


@given(st.integers(-120, 120), st.integers(-120, 120), st.integers(0, 5))
@settings(max_examples=25, deadline=None)
def test_a_problem_in_units_has_the_same_feasible_points(y: int, u: int, seed: int) -> None:
    """In rationals: rows at units * z are powers of two times the rows in z."""
    rng = np.random.default_rng(seed)
    data = setid.IOData(np.ldexp(rng.uniform(-1, 1, 6), u), np.ldexp(rng.uniform(-1, 1, 6), y))
    noise = setid.Noise(output=np.ldexp(0.1, y), input=np.ldexp(0.2, u))
    known = setid.formulate(data, setid.TransferFunction(1, 1), noise, [setid.Stable()])
    scaled = in_units(known.problem, known)
    assert np.all(np.frexp(scaled.units)[0] == 0.5)
    assert np.array_equal(scaled.problem.lower * scaled.units, known.problem.lower)
    assert np.array_equal(scaled.problem.upper * scaled.units, known.problem.upper)
    z = [Fraction(int(v)) / 16 for v in rng.integers(-16, 17, scaled.units.size)]
    x = [a * Fraction(float(b)) for a, b in zip(z, scaled.units, strict=True)]
    for mine, theirs in zip(known.problem.constraints, scaled.problem.constraints, strict=True):
        assert mine.kind is theirs.kind
        ratio = Fraction(float(mine.polynomial.coefficients[0])) / Fraction(
            float(theirs.polynomial.coefficients[0])
        )
        for letter in mine.polynomial.words[0].tolist():
            ratio *= Fraction(float(scaled.units[letter - 1])) if letter else 1
        one, two = value_at(mine.polynomial, x), value_at(theirs.polynomial, z)
        assert ratio > 0 and one == two * ratio
        assert (ratio.numerator & (ratio.numerator - 1)) == 0  # a power of two
        assert (ratio.denominator & (ratio.denominator - 1)) == 0


@pytest.mark.parametrize("power", [-40, -16, 0, 16, 40])
def test_powers_of_bounded_signals_have_units_of_their_size(power: int) -> None:
    """The square of a signal within 2^power is within 4^power, its cube within 8^power."""
    linear, u = setid.TransferFunction(1, 1, 1), np.linspace(-1.0, 1.0, 5)
    model = setid.Wiener(linear, 3, normalise="gamma1")
    noise = setid.Noise(output=np.ldexp(0.125, power))
    known = setid.formulate(setid.IOData(u, np.ldexp(u, power)), model, noise)
    groups = known.layout.groups
    lower, upper = known.problem.lower.copy(), known.problem.upper.copy()
    assert np.all(np.isinf(in_units(known.problem, known).problem.upper[groups["p[z^2]"]]))
    lower[groups["z"]], upper[groups["z"]] = -np.ldexp(1.0, power), np.ldexp(1.0, power)
    about = known.problem
    boxed = sp.Problem(about.objective, about.constraints, lower, upper, about.names)
    units = in_units(boxed, known).units
    for name, exponent in (("z", 1), ("p[z^2]", 2), ("p[z^3]", 3)):
        ratios = np.log2(units[groups[name]]) - exponent * power
        assert np.all(np.abs(ratios) <= 9)  # units are powers of 2^16


@pytest.mark.slow
@pytest.mark.parametrize("power", [-17, 17])
def test_ends_of_wiener_structures_do_not_depend_on_the_unit_of_outputs(power: int) -> None:
    """What is attained in one unit lies within what is proved in the other, and both close."""
    model = setid.Wiener(setid.TransferFunction(1, 1, 1), 2, normalise="gamma1")
    u = np.random.default_rng(1).uniform(-1.0, 1.0, 40)
    bound = 2.0**-5
    plain = setid.simulate_record(model, (-0.6, 0.8, 0.3), u, setid.Noise(output=bound), 2).data
    other = setid.IOData(plain.u, np.ldexp(plain.y, power))
    strange = setid.Noise(output=np.ldexp(bound, power))
    mine = setid.identify(plain, model, setid.Noise(output=bound), [setid.Stable()], QUICK)
    theirs = setid.identify(other, model, strange, [setid.Stable()], QUICK)
    assert mine.status == theirs.status == "certified" and bool(theirs.verify(other))
    for name, factor in (("a1", 1.0), ("b1", 2.0**power), ("gamma2", 2.0**-power)):
        one, two = mine.intervals[name], theirs.intervals[name]
        assert one.inner is not None and two.inner is not None
        assert one.outer[0] * factor <= two.inner[0] <= two.inner[1] <= one.outer[1] * factor
        assert two.outer[0] <= one.inner[0] * factor <= one.inner[1] * factor <= two.outer[1]


@pytest.mark.slow
def test_subnormal_signals_keep_the_units_in_which_they_are_exact() -> None:
    """Exact data of a1 = -1/2, b0 = 2^-1018: a unit would round what it multiplies."""
    tiny, source = 2.0**-1074, np.random.default_rng(3)
    m = [int(v) for v in source.integers(-(2**34), 2**34, 8)]
    y = np.array([v * tiny for v in m])
    u = np.array([2.0**-22, *((2 * b - a) * 2.0**-57 for a, b in pairwise(m))])
    for k in range(1, 8):
        exact = Fraction(y[k]) - Fraction(y[k - 1]) / 2 - Fraction(2) ** -1018 * Fraction(u[k])
        assert exact == 0
    noise = setid.Noise(output=2 * tiny)
    result = setid.identify(setid.IOData(u, y), FIRST, noise, options=QUICK)
    assert -0.5 in result.intervals["a1"] and 2.0**-1018 in result.intervals["b0"]
    known = setid.formulate(setid.IOData(u, y), FIRST, noise)
    assert np.all(in_units(known.problem, known).units == 1.0)


@pytest.mark.parametrize("bound", [1e307, 1e308])
def test_bounds_near_the_largest_double_have_units(bound: float) -> None:
    """Rows are divided by powers of two that are doubles themselves."""
    data = setid.IOData([4.0, -3.0, 2.0, 1.0], [0.0, -6.25, 1.175, 2.0875])
    result = setid.identify(data, FIRST, setid.Noise(equation=bound), options=QUICK)
    found = in_units(result.problem, result.formulation)
    assert np.all(np.isfinite(found.units)) and 0 < found.factor < np.inf
    assert setid.Identification.from_json(result.to_json()).status == result.status
