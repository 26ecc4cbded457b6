"""Products of samples that no double holds are an assumption that the verdict names."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import setid
from setid.formulation.rounding import is_rounded_product, is_rounded_sum

reals = st.floats(-1e3, 1e3, allow_nan=False).filter(lambda x: x == 0 or abs(x) > 1e-100)


@given(st.lists(st.tuples(reals, reals, reals), min_size=1, max_size=5))
def test_rounded_products_are_those_that_rationals_find(rows) -> None:
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    for row, found in zip(rows, is_rounded_product(columns), strict=True):
        first = Fraction(row[0]) * Fraction(row[1])
        rounded = Fraction(row[0] * row[1])
        second = rounded * Fraction(row[2])
        exact = first == rounded and second == Fraction(float(rounded) * row[2])
        assert found == (not exact)


def consistent(exact: bool) -> setid.IOData:
    """y(k) = y(k-1) u(k) - u(k-1)^2 to the last bit of every double that is stored."""
    generator = np.random.default_rng(3)
    u = generator.integers(-4, 5, 12) / (8.0 if exact else 10.0)
    y = [0.5]
    for k in range(1, 12):
        y.append(float(Fraction(y[-1]) * Fraction(u[k]) - Fraction(u[k - 1]) ** 2))
    return setid.IOData(u, y)


def identified(data: setid.IOData) -> setid.Identification:
    model = setid.PolynomialNARX(ny=1, nu=1, terms=["y1*u0", "u1^2"])
    return setid.identify(data, model, setid.Noise(equation=0.0))


def test_an_empty_set_rests_on_the_rounding_that_it_names() -> None:
    found = identified(consistent(exact=False))
    assert any("products of samples are rounded" in text for text in found.assumptions)


def test_products_that_doubles_hold_need_no_assumption() -> None:
    data = setid.IOData([1.0, 0.5, 2.0, -1.0, 0.25], [0.5, -0.75, -1.75, -2.25, -1.5625])
    found = identified(data)
    assert not any("rounded" in text for text in found.assumptions)
    assert str(found.status) != "empty"


# ---- sums ---------------------------------------------------------------------------------

short = st.integers(-(2**20), 2**20).map(lambda n: n / 64)


@given(st.lists(st.one_of(reals, short), min_size=2, max_size=5), st.randoms())
def test_sums_that_are_not_named_are_exact_in_every_order(values, chance) -> None:
    chance.shuffle(values)
    total, exact = 0.0, Fraction(0)
    for value in values:
        total, exact = total + value, exact + Fraction(value)
    if not is_rounded_sum([np.array([value]) for value in values])[0]:
        assert Fraction(total) == exact


@given(st.lists(short, min_size=2, max_size=5))
def test_sums_of_short_numbers_are_not_named(values) -> None:
    assert not is_rounded_sum([np.array([value]) for value in values])[0]


def named(result: setid.Identification) -> bool:
    return any("coefficients of rows are rounded" in text for text in result.assumptions)


def by_tustin(Ts: float) -> tuple[setid.IOData, np.ndarray]:
    """y'' + 1.25 y' + 2.5 y = 1.5 u by Tustin's rule, with its equation errors rounded upwards."""
    h = Fraction(Ts) / 2
    bottom = [1 + h * 5 / 4 + h * h * 5 / 2, 5 * h * h - 2, 1 - h * 5 / 4 + h * h * 5 / 2]
    top = [h * h * 3 / 2, 3 * h * h, h * h * 3 / 2]
    u = np.random.default_rng(0).integers(-4, 5, 14).astype(float)
    y, bound = [0.0, 0.0], [0.0, 0.0]
    for k in range(2, 14):
        right = sum(t * Fraction(u[k - i]) for i, t in enumerate(top))
        past = bottom[1] * Fraction(y[-1]) + bottom[2] * Fraction(y[-2])
        y.append(float((right - past) / bottom[0]))
        error = sum(b * Fraction(y[k - i]) for i, b in enumerate(bottom)) - right
        bound.append(float(np.nextafter(float(abs(error)), np.inf)))
    return setid.IOData(u, y, Ts=Ts), np.array(bound)


@pytest.mark.parametrize("Ts", [2.0, 0.1])
def test_rows_in_continuous_time_name_their_rounding(Ts: float) -> None:
    data, bound = by_tustin(Ts)
    model, noise = setid.ContinuousTransferFunction(2, 0), setid.Noise(equation=bound)
    found = setid.identify(data, model, noise, options=setid.Options(time_limit=5, progress=False))
    inside = all(
        item.outer[0] <= value <= item.outer[1]
        for item, value in zip(found.intervals.values(), (1.25, 2.5, 1.5), strict=True)
    )
    assert inside or named(found)
    short_numbers = setid.IOData(data.u, np.round(data.y * 8) / 8, Ts=2.0)
    exact = setid.formulate(short_numbers, model, setid.Noise(equation=1.0))
    assert not any("rounded" in text for text in exact.assumptions)


def test_fixed_coefficients_name_their_rounding() -> None:
    """0.3 u is no double, although every power of u is one."""
    u = np.float32(np.random.default_rng(1).uniform(-1, 1, 20)).astype(float)
    data = setid.IOData(u, u)
    for value, expected in ((0.3, True), (0.5, False)):
        model = setid.Hammerstein(setid.TransferFunction(1, 1, 1), 2, normalise={"gamma1": value})
        known = setid.formulate(data, model, setid.Noise(equation=1.0))
        assert any("rounded" in text for text in known.assumptions) == expected


def test_linear_structures_round_nothing() -> None:
    rng = np.random.default_rng(2)
    data = setid.IOData(rng.normal(size=30), rng.normal(size=30))
    for model in (setid.TransferFunction(2, 2, 1), setid.TransferFunction(1, 1, offset=True)):
        known = setid.formulate(data, model, setid.Noise(equation=1.0))
        assert not any("rounded" in text for text in known.assumptions)


def test_powers_of_the_sampling_time_are_numbers_that_are_computed() -> None:
    """Readings of 0 and 1 leave no sum to round; (Ts / 2)^2 itself is no double at Ts = 0.1."""
    data = setid.IOData([1.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 1.0], Ts=0.1)
    known = setid.formulate(data, setid.ContinuousTransferFunction(2, 0), setid.Noise(equation=1.0))
    assert any("coefficients of rows are rounded" in text for text in known.assumptions)
    exact = setid.formulate(
        setid.IOData(data.u, data.y, Ts=0.5),
        setid.ContinuousTransferFunction(2, 0),
        setid.Noise(equation=1.0),
    )
    assert not any("rounded" in text for text in exact.assumptions)


def test_products_of_fixed_coefficients_are_numbers_that_are_computed() -> None:
    """0.3 times 0.7 is no double, though a reading of 1 rounds nothing more."""
    data = setid.IOData([1.0, 0.0, 1.0, 1.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0, 1.0, 0.0])
    for fixed, expected in (
        ({"gamma1": 0.3, "b1": 0.7}, True),
        ({"gamma1": 0.5, "b1": 0.25}, False),
    ):
        model = setid.Hammerstein(setid.TransferFunction(1, 1, 1), 2, normalise=fixed)
        known = setid.formulate(data, model, setid.Noise(equation=1.0))
        assert any("rounded" in text for text in known.assumptions) == expected
