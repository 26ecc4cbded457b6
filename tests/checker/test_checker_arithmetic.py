"""Exact polynomials, fixed-point intervals and elimination of the second checker."""

from __future__ import annotations

import itertools
import math
import random
from fractions import Fraction

import pytest

from checker.arithmetic import interval as iv
from checker.arithmetic.polynomial import (
    ONE,
    Polynomial,
    Substitution,
    power_of_two,
    powers,
    split,
    total,
)
from checker.certificates.elimination import eliminated, semidefinite, solution

INF = math.inf
UNIT = Fraction(1, 2**1152)  # of the fixed point
PLACES = [-INF, Fraction(-2), -3 * UNIT, Fraction(0), UNIT, Fraction(1, 2), Fraction(3), INF]
RANGES = [(a, b) for a in PLACES for b in PLACES if a <= b and a != INF and b != -INF]


def stored(ends):
    return iv.around(*ends)


def inside(ends):
    """Points of an interval: its ends, zero, and far ones where it has no end."""
    low = ends[0] if ends[0] != -INF else min(Fraction(-4), ends[1])
    high = ends[1] if ends[1] != INF else max(Fraction(4), ends[0])
    return {low, high, Fraction(0)} if low <= 0 <= high else {low, high}


def holds(found, value):
    low, high = iv.exactly(found)
    return low <= value <= high


def near(found, low, high):
    """Whether an interval has these ends, rounded outwards to the next multiple of the unit."""
    got = iv.exactly(found)
    return low - UNIT < got[0] <= low and high <= got[1] < high + UNIT


@pytest.mark.parametrize(
    "value", [Fraction(1, 3), Fraction(-1, 3), UNIT / 2, -UNIT / 2, Fraction(5)]
)
def test_numbers_are_rounded_outwards(value):
    assert near((iv.below(value), iv.above(value)), value, value)
    assert near(iv.around(value, value + 1), value, value + 1)


@pytest.mark.parametrize(("number", "exp"), [(5, -1154), (-5, -1154), (3, 1), (-3, -1), (1, -1152)])
def test_coefficients_are_rounded_outwards(number, exp):
    value = number * Fraction(2) ** exp
    assert near(iv.scaled(number, exp), value, value)


def test_infinite_ends_stay():
    assert (iv.below(-INF), iv.above(INF), iv.below(INF), iv.above(-INF)) == (-INF, INF, INF, -INF)
    assert iv.exactly((-INF, INF)) == (-INF, INF)


def test_sums_differences_and_products_of_intervals_hold_those_of_their_points():
    for x, y in itertools.product(RANGES, RANGES):
        one, other = stored(x), stored(y)
        found = iv.plus(one, other), iv.minus(one, other), iv.times(one, other)
        for a, b in itertools.product(inside(x), inside(y)):
            assert holds(found[0], a + b)
            assert holds(found[1], a - b)
            assert holds(found[2], a * b)


def test_products_are_no_wider_than_rounding_makes_them():
    thirds = stored((Fraction(-1, 3), Fraction(2, 3)))
    assert near(iv.times(thirds, (3 << 1152, 3 << 1152)), *(3 * v for v in iv.exactly(thirds)))
    assert iv.times((0, 0), (-INF, INF)) == (0, 0)
    assert iv.times((0, INF), (-INF, -1)) == (-INF, 0)
    assert iv.times((-INF, -1), (-INF, -1 << 1152)) == (1, INF)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_powers_hold_those_of_all_points(n):
    for x in RANGES:
        found = iv.power(stored(x), n)
        assert all(holds(found, a**n) for a in inside(x))
        if n % 2 == 0:
            assert found[0] >= 0
    assert near(iv.power(stored((-2, 3)), n), *{1: (-2, 3), 2: (0, 9), 3: (-8, 27), 4: (0, 81)}[n])


def test_quotients_hold_all_that_a_divisor_takes_into_the_target():
    for target, divisor in itertools.product(RANGES, RANGES):
        low, high = iv.exactly(iv.quotient(stored(target), stored(divisor)))
        for t, d in itertools.product(inside(target), inside(divisor)):
            if d:
                assert low <= t / d <= high, (target, divisor, t / d)
            elif t == 0:
                assert (low, high) == (-INF, INF)


def test_quotients_are_narrow():
    assert near(iv.quotient(stored((1, 2)), stored((3, 7))), Fraction(1, 7), Fraction(2, 3))
    assert near(iv.quotient(stored((-1, 2)), stored((-7, -3))), Fraction(-2, 3), Fraction(1, 3))
    assert iv.exactly(iv.quotient(stored((1, 2)), stored((0, 4)))) == (Fraction(1, 4), INF)


# Newton's method ends by a step of 1 for some of these.
ONE_STEP = [265, 160 * UNIT, 343, 197 * UNIT, 96, 273 * UNIT]


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
@pytest.mark.parametrize(
    "value", [0, UNIT, 2 * UNIT, 7 * UNIT, Fraction(1, 3), 1, 2, 32, 81, 4096, *ONE_STEP]
)
def test_roots_are_rounded_outwards(n, value):
    stored_value = iv.below(Fraction(value))
    low, high = (iv.exact(root(stored_value, n)) for root in (iv.root_below, iv.root_above))
    exact = iv.exact(stored_value)
    assert low**n <= exact <= high**n
    assert (low + UNIT) ** n > exact
    assert high == 0 or (high - UNIT) ** n < exact
    assert iv.root_below(INF, n) == iv.root_above(INF, n) == INF


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_roots_hold_all_points_with_their_power_in_the_value(n):
    """For all z in x with z^n in the value."""
    for x, value in itertools.product(RANGES, RANGES):
        low, high = iv.exactly(iv.roots(stored(value), n, stored(x)))
        for z in inside(x):
            if value[0] <= z**n <= value[1]:
                assert low <= z <= high
    if n == 2:
        four_to_nine = stored((4, 9))
        assert iv.exactly(iv.roots(four_to_nine, 2, stored((-1, 5)))) == (2, 3)
        assert iv.exactly(iv.roots(four_to_nine, 2, stored((-5, 1)))) == (-3, -2)
        assert iv.exactly(iv.roots(four_to_nine, 2, stored((-5, 5)))) == (-3, 3)
        assert iv.roots(stored((-9, -4)), 2, stored((-5, 5)))[0] == INF


@pytest.mark.parametrize("n", [2, 3, 4, 5])
def test_roots_of_intervals_are_rounded_outwards(n):
    """Of 1/3 and 2/3, whose roots are no doubles; ends that are roots are kept."""
    low, high = iv.exactly(iv.roots(stored((Fraction(1, 3), Fraction(2, 3))), n, (0, INF)))
    assert low**n <= Fraction(1, 3) < Fraction(2, 3) <= high**n
    if n % 2:
        found = iv.exactly(iv.roots(stored((Fraction(-2, 3), Fraction(-1, 3))), n, (-INF, INF)))
        assert found == (-high, -low)
    else:
        value = stored((2**n, 3**n))
        assert iv.exactly(iv.roots(value, n, stored((-2, 5)))) == (-3, 3)
        assert iv.exactly(iv.roots(value, n, stored((-5, 2)))) == (-3, 3)


def test_ranges_of_polynomials_hold_their_values():
    """x^2 y - 3 y + 0.1 over boxes, at their corners and zeros."""
    p = Polynomial.of([(1, 1, 2), (2,), ()], [1.0, -3.0, 0.1])
    for x, y in itertools.product(RANGES[::2], RANGES[::3]):
        low, high = iv.exactly(iv.range_over(p, [stored(x), stored(y)]))
        for a, b in itertools.product(inside(x), inside(y)):
            assert low <= a * a * b - 3 * b + Fraction(0.1) <= high
    assert near(iv.monomial_range((1, 1, 2), [stored((-2, 1)), stored((-1, 3))]), -4, 12)


def test_intersections_and_sums_of_several():
    assert iv.met((1, 5), (2, 9)) == iv.met((2, 9), (1, 5)) == (2, 5)
    assert iv.total([(1, 2), (-5, INF), (3, 4)]) == (-1, INF)


# ---- polynomials --------------------------------------------------------------------------------


def some(chance, count=5, n=3, degree=3):
    """Words with coefficients of very different sizes."""
    words = {
        tuple(sorted(chance.choices(range(1, n + 1), k=chance.randrange(degree + 1))))
        for _ in range(count)
    }
    return {w: chance.uniform(-1, 1) * 2.0 ** chance.randrange(-80, 80) for w in words}


def made(terms):
    return Polynomial.of(list(terms), list(terms.values()))


def value(terms, x):
    """The sum of the terms, from the definition of a word."""
    return sum(
        (
            Fraction(c) * math.prod((x[v - 1] for v in word), start=Fraction(1))
            for word, c in terms.items()
        ),
        Fraction(0),
    )


@pytest.mark.parametrize("seed", range(6))
def test_operations_with_polynomials_are_exact(seed):
    chance = random.Random(seed)
    f, g = some(chance), some(chance)
    p, q = made(f), made(g)
    x = [Fraction(chance.randrange(-9, 10), chance.randrange(1, 9)) for _ in range(3)]
    a, b = value(f, x), value(g, x)
    assert p.at(x) == a
    assert p.times(q).at(x) == a * b
    assert p.minus(q).at(x) == a - b
    assert p.signed(-1).at(x) == -a
    assert total([p, q, p]).at(x) == 2 * a + b
    p.add(q, -1)
    assert p.at(x) == a - b
    assert q.at(x) == b
    for word, c in g.items():
        assert q.coefficient(word) == q.coefficients()[word] == Fraction(c)
    assert q.open() == {word: Fraction(c) for word, c in g.items() if word}


@pytest.mark.parametrize("seed", range(6))
def test_substitutions_are_exact(seed):
    """p(c + s t) at t, for centres and scales of different sizes, zero too."""
    chance = random.Random(seed)
    terms = some(chance, degree=5)
    centre = [chance.choice([0.0, chance.uniform(-1, 1) * 2.0**40]) for _ in range(3)]
    scale = [chance.choice([0.0, 1.0, chance.uniform(0, 1) * 2.0**-30]) for _ in range(3)]
    t = [Fraction(chance.randrange(-9, 10), 7) for _ in range(3)]
    x = [Fraction(c) + Fraction(s) * v for c, s, v in zip(centre, scale, t, strict=True)]
    assert Substitution(centre, scale).into(made(terms)).at(t) == value(terms, x)


def test_derivatives_slopes_and_parts():
    p = Polynomial.of([(1, 1, 1, 2), (2, 2), (1,), ()], [2.0, 0.5, -3.0, 7.0])
    x = [Fraction(2), Fraction(5)]
    assert p.derivative(1).at(x) == 6 * 4 * 5 - 3
    assert p.derivative(2).at(x) == 2 * 8 + 5
    assert p.derivative(3).at([*x, Fraction(1)]) == 0
    assert p.linear(2) is None
    assert Polynomial.of([(2,), ()], [0.5, -3.0]).linear(3) == [0, 0.5, 0, -3]
    assert Polynomial.affine(2, 0.25, -1.5).at(x) == Fraction(5, 4) - Fraction(3, 2)
    assert split({(1, 2, 2): 4, (2,): 5, (): 6}, {2}) == {
        (2, 2): {(1,): 4},
        (2,): {(): 5},
        (): {(): 6},
    }
    assert split({(1, 1, 2): 4, (1,): 5}, {2}) == {(2,): {(1, 1): 4}, (): {(1,): 5}}
    product = Polynomial.affine(2, 1.0, 0.5).times(Polynomial.affine(1, 2.0, 0.0))
    assert product.open() == {(1, 2): 2, (1,): 1}
    assert power_of_two(3) == 8 == 1 / power_of_two(-3)
    assert powers((1, 1, 3)) == [(0, 2), (2, 1)]
    assert ONE.at(x) == 1


# ---- elimination --------------------------------------------------------------------------------


def determinant(rows):
    if not rows:
        return 1
    return sum(
        (-1) ** j * first * determinant([row[:j] + row[j + 1 :] for row in rows[1:]])
        for j, first in enumerate(rows[0])
    )


def minor(matrix, chosen):
    return determinant([[matrix[i][j] for j in chosen] for i in chosen])


def test_semidefinite_matrices_have_principal_minors_that_are_not_negative():
    subsets = [s for k in (1, 2, 3) for s in itertools.combinations(range(3), k)]
    for a, b, c, d, e, f in itertools.product((-1, 0, 1, 2), repeat=6):
        matrix = [[a, b, c], [b, d, e], [c, e, f]]
        wanted = all(minor(matrix, chosen) >= 0 for chosen in subsets)
        assert semidefinite([[Fraction(v) for v in row] for row in matrix]) == wanted


def test_equations_are_solved_where_they_have_one_solution():
    """All systems of two equations in two unknowns with coefficients -1, 0, 1, 2."""
    for a, b, c, d in itertools.product((-1, 0, 1, 2), repeat=4):
        for e, f in ((0, 0), (3, -5)):
            rows = ((a, b, e), (c, d, f))
            table = [
                {k: Fraction(v) for k, v in zip((0, 1, -1), row, strict=True) if v or k < 0}
                for row in rows
            ]
            done = eliminated(table)
            if a * d == b * c:
                assert done is None
                continue
            found = solution(done, {-1: Fraction(1)})
            assert sorted(found) == [0, 1]
            assert all(p * found[0] + q * found[1] + r == 0 for p, q, r in rows)


@pytest.mark.parametrize("seed", range(20))
def test_random_equations_are_solved(seed):
    chance = random.Random(seed)
    size = 3 + seed % 4
    rows = [[chance.choice((-2, -1, 0, 0, 1, 3)) for _ in range(size + 1)] for _ in range(size)]
    if determinant([row[:-1] for row in rows]) == 0:
        for k, row in enumerate(rows):
            row[k] += 20  # larger than the sum of all others
    table = [
        {k if k < size else -1: Fraction(v) for k, v in enumerate(row) if v or k == size}
        for row in rows
    ]
    x = solution(eliminated(table), {-1: Fraction(1)})
    assert all(sum(row[k] * x[k] for k in range(size)) + row[-1] == 0 for row in rows)
