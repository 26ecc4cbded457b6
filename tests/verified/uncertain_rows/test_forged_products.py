"""Bounds of factors from bounds of products: no factor is lost, and closed forms are reached."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sparsepop_py.errors import ProblemError
from sparsepop_py.uncertain_rows import ProductRows, UncertainRows
from sparsepop_py.verified.uncertain_rows.products import _sum_by, contracted, merged

INF = np.inf
F = Fraction
SEEDS = st.integers(0, 2**32 - 1)


def rows_of(columns, parameters, gains=()):
    """Columns of sums of monomials; the rows themselves say nothing."""
    count = len(columns)
    names = tuple(f"c{k}" for k in range(count))
    nothing = UncertainRows(names, [0.0], np.zeros((1, count)), [1.0], np.zeros((1, count)))
    return ProductRows(nothing, tuple(columns), parameters, gains)


def value(monomial, theta):
    total = F(1)
    for i in monomial:
        total *= F(float(theta[i]))
    return total


def around(exact, rng):
    """An interval that holds a rational, now and then at its end."""
    near = float(exact)
    width = float(rng.choice([0.0, 0.0, 1e-3, 1.0])) * abs(near)
    low, high = near - width, near + width
    while F(low) > exact:
        low = float(np.nextafter(low, -INF))
    while F(high) < exact:
        high = float(np.nextafter(high, INF))
    return low, high


@settings(max_examples=150, deadline=None)
@given(SEEDS)
def test_no_parameters_are_lost(seed):
    """Planted parameters of all sizes; products and sums of products enclosed around them."""
    rng = np.random.default_rng(seed)
    p = int(rng.integers(1, 4))
    theta = rng.uniform(-2, 2, p) * 10.0 ** rng.integers(-3, 4, p)
    theta[rng.integers(p)] *= float(rng.integers(0, 2))
    totals = {}
    for _ in range(int(rng.integers(1, 4))):
        size = int(rng.integers(1, 4))
        monomials = {
            tuple(sorted(rng.integers(0, p, int(rng.integers(1, 4))).tolist())) for _ in range(size)
        }
        total = tuple(sorted(monomials))
        totals[total] = around(sum((value(m, theta) for m in total), F(0)), rng)
    low = np.where(rng.integers(0, 2, p), -INF, theta - rng.choice([0.0, 1.0], p))
    high = np.where(rng.integers(0, 2, p), INF, theta + rng.choice([0.0, 1.0], p))
    box = contracted(np.array([low, high]), totals, ())
    assert np.all(box[0] <= theta) and np.all(theta <= box[1])


@settings(max_examples=150, deadline=None)
@given(SEEDS)
def test_static_gains_lose_no_parameters(seed):
    """Sum b = 1 + sum a in dyadic numbers, and gamma times each b."""
    rng = np.random.default_rng(seed)
    nb, na = int(rng.integers(1, 4)), int(rng.integers(0, 3))
    a = rng.integers(-64, 65, na) / 64
    b = rng.integers(-64, 65, nb) / 64
    b[0] = 1 + a.sum() - b[1:].sum()
    gamma = float(rng.integers(-64, 65)) / 16
    theta = np.concatenate([b, a, [gamma]])
    numerator, denominator = tuple(range(nb)), tuple(range(nb, nb + na))
    place = nb + na
    totals = {((i, place),): around(value((i, place), theta), rng) for i in numerator}
    if rng.integers(2):
        parts = tuple((i, place) for i in numerator)
        totals[parts] = around(sum((value(m, theta) for m in parts), F(0)), rng)
    if denominator and rng.integers(2):
        poles = tuple((i,) for i in denominator)
        totals[poles] = around(sum((value(m, theta) for m in poles), F(0)), rng)
    width = rng.choice([0.0, 0.25, 2.0, INF], theta.size)
    start = np.array([theta - width, theta + width])
    box = contracted(start, totals, ((numerator, denominator),))
    assert np.all(box[0] <= theta) and np.all(theta <= box[1])


def denominators_of(rng) -> tuple[np.ndarray, tuple]:
    """Two or three denominators with zeros anywhere up to 3, their coefficients as doubles."""
    theta, factors = [], []
    for _ in range(int(rng.integers(2, 4))):
        zeros = rng.uniform(-3, 3, int(rng.integers(1, 4)))
        if zeros.size > 1 and rng.integers(2):
            zeros = np.append(zeros[2:], zeros[0] * np.exp([1j, -1j]))
        own = np.poly(zeros).real[1:]
        factors.append(tuple(range(len(theta), len(theta) + own.size)))
        theta += own.tolist()
    return np.array(theta), tuple(factors)


@settings(max_examples=100, deadline=None)
@given(SEEDS)
def test_factors_of_a_product_are_not_lost(seed):
    """What is known of the coefficients of a product bounds those of its factors, from nothing."""
    rng = np.random.default_rng(seed)
    theta, factors = denominators_of(rng)
    coefficients = multiplied_by_hand(factors)
    totals = {
        tuple(parts): around(sum((value(m, theta) for m in parts), F(0)), rng)
        for lag, parts in coefficients.items()
        if lag
    }
    start = np.array([np.full(theta.size, -INF), np.full(theta.size, INF)])
    box = contracted(start, totals, (), (factors,))
    assert np.all(box[0] <= theta) and np.all(theta <= box[1])
    assert np.all(np.isfinite(box))


def multiplied_by_hand(factors):
    """Monomials at each lag, by adding one denominator after the other."""
    found = {0: [()]}
    for names in factors:
        longer = {}
        for lag, parts in found.items():
            longer.setdefault(lag, []).extend(parts)
            for k, i in enumerate(names, 1):
                longer.setdefault(lag + k, []).extend(tuple(sorted((*m, i))) for m in parts)
        found = longer
    return found


def test_coefficients_of_two_denominators_by_hand():
    """a + a' = 3, a a' = 2: M <= sqrt(14). (1, 2) and 1: sqrt(1 + 9 + 25 + 9), twice for a1."""
    one = ((0,), (1,))
    start = np.array([[-INF, -INF], [INF, INF]])
    box = contracted(start, {((0,), (1,)): (3.0, 3.0), ((0, 1),): (2.0, 2.0)}, (), (one,))
    close(box[:, 0], 3 - np.sqrt(14), np.sqrt(14))  # with a' = 3 - a
    totals = {((0,), (2,)): (3.0, 3.0), ((1,), (0, 2)): (-5.0, 5.0), ((1, 2),): (3.0, 3.0)}
    start = np.array([[-INF, -INF, -INF], [INF, INF, INF]])
    box = contracted(start, totals, (), (((0, 1), (2,)),))
    most = np.sqrt(44)
    close(box[:, 1], -most, most)
    close(box[:, 2], -most, most)
    close(box[:, 0], 3 - most, 3 + most)
    half = contracted(start, {((1, 2),): (3.0, 3.0)}, (), (((0, 1), (2,)),))
    assert np.all(np.isinf(half))  # not all coefficients of the product are known


def test_columns_bound_what_they_are_part_of():
    """c + c a + c a' + c a a' = 3 with a + a' in [-1, 0], a a' in [1, 2]: c in [1, 3]."""
    totals = {
        ((2,), (0, 2), (1, 2), (0, 1, 2)): (3.0, 3.0),
        ((0,), (1,)): (-1.0, 0.0),
        ((0, 1),): (1.0, 2.0),
    }
    start = np.array([[-9.0, -9.0, -INF], [9.0, 9.0, INF]])
    close(contracted(start, totals, ())[:, 2], 1.0, 3.0)


def test_denominators_at_one_are_a_product():
    """c (1 + a) (1 + a') = 2 with a, a' in [-3/4, 1]; 1 + a + a' + a a' may be zero by terms."""
    totals = {((2,), (0, 2), (1, 2), (0, 1, 2)): (2.0, 2.0)}
    start = np.array([[-0.75, -0.75, -INF], [1.0, 1.0, INF]])
    assert np.isinf(contracted(start, totals, ())[1, 2])
    lone = contracted(start, totals, (), (((0,), (1,)),))
    close(lone[:, 2], 0.5, 32.0)
    start = np.array([[0.0, 1.0, -INF], [1.0, 2.0, INF]])  # c (1 + a) has nothing to do with a'
    part = contracted(start, {((2,), (0, 2)): (2.0, 2.0)}, (), (((0,), (1,)),))
    close(part[:, 2], 1.0, 2.0)


def close(found, low, high):
    assert low - 1e-9 <= found[0] <= low and high <= found[1] <= high + 1e-9


def test_a_factor_is_the_quotient():
    """a b in [1, 2] with b in [1/2, 1] gives a in [1, 4]."""
    box = contracted(np.array([[-INF, 0.5], [INF, 1.0]]), {((0, 1),): (1.0, 2.0)}, ())
    close(box[:, 0], 1.0, 4.0)


def test_a_square_has_two_roots_and_its_factor_is_itself():
    """a^2 in [1, 4] with a in [1/2, 9]: a = a^2 / a."""
    box = contracted(np.array([[0.5], [9.0]]), {((0, 0),): (1.0, 4.0)}, ())
    assert box[0, 0] <= 1.0 and 2.0 <= box[1, 0] <= 8.1


def test_sums_of_products_are_solved_for_each():
    """a b + c in [3, 4] with b = 2 and c in [0, 1]: a in [1, 2]."""
    start = np.array([[-INF, 2.0, 0.0], [INF, 2.0, 1.0]])
    box = contracted(start, {((0, 1), (2,)): (3.0, 4.0)}, ())
    close(box[:, 0], 1.0, 2.0)


def test_a_factor_that_all_share_is_a_quotient():
    """c + c a + c a b in [6, 12], a in [1, 2], b in [0, 1]: c in 6 / [2, 5] to 12 / [2, 5]."""
    start = np.array([[-INF, 1.0, 0.0], [INF, 2.0, 1.0]])
    box = contracted(start, {((0,), (0, 1), (0, 1, 2)): (6.0, 12.0)}, ())
    close(box[:, 0], 1.2, 6.0)
    np.testing.assert_array_equal(box[:, 1:], start[:, 1:])


def test_squares_and_factors_of_some_are_not_shared():
    """a^2 + a b = 2 at a = b = 1 and at a = -2, b = 1; c + a b = 2 at c = 0, a = 2, b = 1."""
    box = contracted(np.array([[-2.0, 1.0], [2.0, 1.0]]), {((0, 0), (0, 1)): (2.0, 2.0)}, ())
    assert box[0, 0] == -2.0 and box[1, 0] >= 1.0
    start = np.array([[0.0, 1.0, -1.0], [4.0, 1.0, 3.0]])
    box = contracted(start, {((2,), (0, 1)): (2.0, 2.0)}, ())
    assert box[0, 2] <= 0.0 and box[1, 2] >= 2.0 and box[0, 0] <= 0.0 and box[1, 0] >= 3.0


def test_a_gain_gives_its_last_number():
    """b0 + b1 = 1 + a with b0 = 1/4, a in [0, 1/2]: b1 in [3/4, 5/4]; and a from the b."""
    gains = (((0, 1), (2,)),)
    box = contracted(np.array([[0.25, -INF, 0.0], [0.25, INF, 0.5]]), {}, gains)
    close(box[:, 1], 0.75, 1.25)
    box = contracted(np.array([[0.25, 0.5, -INF], [0.25, 1.0, INF]]), {}, gains)
    close(box[:, 2], -0.25, 0.25)


@pytest.mark.parametrize("known", ["products", "their sum"])
def test_a_map_is_the_sum_of_its_products_by_the_gain(known):
    """(b0 + b1) gamma = (1 + a) gamma: 1/2 + 1 over 1 + [0, 1/2] gives gamma in [1, 3/2]."""
    gains = (((0, 1), (2,)),)
    totals = {((0, 3),): (0.5, 0.5), ((1, 3),): (1.0, 1.0)}
    if known == "their sum":
        totals = {((0, 3),): (0.0, 2.0), ((1, 3),): (0.0, 2.0), ((0, 3), (1, 3)): (1.5, 1.5)}
    start = np.array([[-9.0, -9.0, 0.0, -INF], [9.0, 9.0, 0.5, INF]])
    box = contracted(start, totals, gains)
    close(box[:, 3], 1.0, 1.5)


def test_squares_of_the_numerator_are_no_maps():
    """b0^2 + b0 b1 = b0 (1 + a) holds for i in the numerator as well, and is left alone."""
    gains = (((0, 1), ()),)
    totals = {((0, 0),): (0.25, 0.25), ((0, 1),): (0.25, 0.25)}
    box = contracted(np.array([[-1.0, -1.0], [1.0, 1.0]]), totals, gains)
    assert box[0, 0] <= 0.5 <= box[1, 0] and box[0, 1] <= 0.5 <= box[1, 1]


def test_contradictions_cross_the_ends():
    box = contracted(np.array([[2.0, 2.0], [3.0, 3.0]]), {((0, 1),): (0.0, 1.0)}, ())
    assert np.any(box[0] > box[1])


def test_columns_that_multiply_the_same_are_one():
    """a b and c share their factor: one column, their sum, with bounds of both."""
    rows = rows_of([((0, 1),), ((2,),), ((0,),)], ("a", "b", "c"))
    found = merged(rows, ["same", "same", "other"])
    assert found.columns == (((0, 1), (2,)), ((0,),))
    assert found.regression.names == ("c0+c1", "c2")
    box = np.array([[1.0, 2.0, -1.0], [2.0, 3.0, 1.0]])
    start = found.start(box)
    assert start[0, 0] <= 1.0 and 7.0 <= start[1, 0] <= 7.0 + 1e-12
    assert start[:, 1].tolist() == [1.0, 2.0]


def test_monomials_of_a_sum_count_as_often_as_they_stand_there():
    """(1 + a / q)^2 has the coefficient a + a: with 1 <= a <= 2 it lies in [2, 4]."""
    box, once, twice = [(-9.0, 9.0)], ((0,),), ((0,), (0,))
    for terms, known, (least, most) in (
        (twice, {once: (1.0, 2.0)}, (-8.0, 11.0)),  # one of them is known
        (twice, {twice: (2.0, 4.0)}, (2.0, 4.0)),
        (once, {twice: (2.0, 4.0)}, (-9.0, 9.0)),
    ):
        low, high = _sum_by(box, terms, known)
        assert least - 1e-9 <= low <= least and most <= high <= most + 1e-9
    theta = 3.0  # 2 a = 6 and a^2 = 9
    square = {((0,),): (theta, theta), ((0, 0),): (theta**2, theta**2)}
    box = contracted(np.array([[-INF], [INF]]), square, (), (((0,), (0,)),))
    assert box[0, 0] <= theta <= box[1, 0]


@pytest.mark.parametrize("columns", [[((0,), (0,))], [()], [((0,),), ((1,),)]])
def test_columns_are_sums_of_distinct_monomials(columns):
    """2 a = 2 would say that a = 2: what the other summand is was taken for nothing."""
    nothing = UncertainRows(("c",), [-2.0], [[1.0]], [0.0], [[0.0]])
    with pytest.raises(ProblemError, match="columns"):
        ProductRows(nothing, tuple(columns), ("a", "b"))
