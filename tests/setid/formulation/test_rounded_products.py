"""Products of samples that no double holds are an assumption that the verdict names."""

from fractions import Fraction

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import setid
from setid.formulation.formulation import _is_rounded

reals = st.floats(-1e3, 1e3, allow_nan=False).filter(lambda x: x == 0 or abs(x) > 1e-100)


@given(st.lists(st.tuples(reals, reals, reals), min_size=1, max_size=5))
def test_rounded_products_are_those_that_rationals_find(rows) -> None:
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    for row, found in zip(rows, _is_rounded(columns), strict=True):
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
