"""Forged identities and linear duals: each case has a known minimum that the forgery exceeds.

Where rounding decides, the exact bound is computed in rationals.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from exact_polynomials import least, plus, times

import sparsepop_py as sp
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.problem import generators
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.certificate.lp_dual import LinearDual
from sparsepop_py.verified.certificate.multipliers import Multipliers, ScaledGenerators
from sparsepop_py.verified.certificate.sos_identity import Identity, Priced, losses

INF = np.inf
NONE = np.zeros((0, 2), np.int64)
x, y = sp.variables(2)
(z,) = sp.variables(1)


def scaling(boxed, ends=None, side=None):
    """x = t; ``ends`` are bounds of t."""
    n = len(boxed)
    sides = np.zeros(n, int) if side is None else np.array(side)
    bounds = None if ends is None else tuple(np.array(e, float) for e in ends)
    return Scaling(np.zeros(n), np.ones(n), np.array(boxed), sides, bounds)


def evaluate(problem, identity):
    rows = problem.rows, problem.equality, problem.objective_row
    with np.errstate(all="ignore"):
        return identity.evaluate(*rows, problem.matrices)


def bound_of(problem, scale, *groups, products=NONE, priced=None):
    return evaluate(problem, Identity(scale, groups, products, priced)).bound


def squares(generator, basis, factor, floor=0.0, place=None):
    """Blocks of one shape: numbers of generators, monomials as words, factors."""
    single = np.isscalar(generator)
    numbers = np.array([generator] if single else generator)
    words = np.array([basis] if single else basis, np.int32)
    values = np.array([factor] if single else factor, float)
    return Multipliers(numbers, words, values, floor, place)


def free(generator, value, word=0):
    words = np.full((np.size(generator), 1, 1), word, np.int32)
    values = np.broadcast_to(np.array(value, float), (np.size(generator), 1)).copy()
    return Multipliers(np.atleast_1d(generator), words, values)


ONE = [[0]]


# ---- monomials without a box ------------------------------------------------------------------


@pytest.mark.parametrize("order", [(True, False), (False, True)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_boxed_factor_does_not_bound_a_product(order, sign):
    """x y with |x| <= 1 and y free has no lower bound."""
    problem = sp.Problem(sign * x * y)
    scale = scaling(order)
    assert bound_of(problem, scale) == -INF
    dual = LinearDual(
        scale, np.zeros(0, int), np.zeros((0, 1), np.int32), np.zeros(0), np.zeros(0, int), NONE
    )
    assert dual.evaluate(problem.rows, problem.equality, problem.objective_row)[0] == -INF


def test_monomials_that_may_vanish_are_not_forgotten():
    """Coefficients [0, e] and [-e, 0] of a free variable are not zero: 1e-400 t is unbounded.

    (x + 1e-200)^2 = x^2 + 2e-200 x + 1e-400; times y the last is 1e-400 y.
    """
    tiny = 1e-200
    scale = replace(scaling([True, False]), centre=np.array([tiny, 0.0]))
    for sign in (1.0, -1.0):
        problem = sp.Problem(sign * x**2 * y)
        assert bound_of(problem, scale) == -INF
        # only the constant of (tiny + t)^2 multiplies y when t is fixed
        fixed = replace(scale, scale=np.array([0.0, 1.0]))
        assert bound_of(problem, fixed) == -INF
        dual = LinearDual(
            fixed, np.zeros(0, int), np.zeros((0, 1), np.int32), np.zeros(0), np.zeros(0, int), NONE
        )
        assert dual.evaluate(problem.rows, problem.equality, problem.objective_row)[0] == -INF


def test_what_the_blocks_do_not_absorb_is_refused():
    """z^2 + 3 z needs more than the floor 1 of {1, z} has; z^3 is in no block of it."""
    basis, zero = [[0], [1]], [[0.0], [0.0]]
    for objective in (z**2 + 3 * z, z**2 + z**3, z**2 + 2 * z + z**3):
        problem = sp.Problem(objective + 1.0)
        assert bound_of(problem, scaling([False]), squares(0, basis, zero, 1.0)) == -INF
    problem = sp.Problem(z**2 + 1.75 * z + 1)  # its minimum is 1 - 1.75^2 / 4 > 0
    found = bound_of(problem, scaling([False]), squares(0, basis, zero, 1.0))
    assert -1e-12 <= found <= 0.0


def test_blocks_without_a_floor_absorb_nothing():
    problem = sp.Problem(z**2 + 1e-3 * z + 1)
    basis = [[0], [1]]
    assert bound_of(problem, scaling([False]), squares(0, basis, np.eye(2), 0.0)) == -INF


@pytest.mark.parametrize("count", [1, 2])
def test_only_blocks_of_a_known_sign_absorb(count):
    """1e9 z: a floor of a multiplier of g = 1 - z^2 may be changed where g >= 0 only.

    The set |z| <= 1 is not boxed here, and a block that is half of the constant counts no more.
    """
    problem = sp.Problem(-1000.0 * z**3, [1 - 0.0 * z >= 0, z - z**3 >= 0])
    basis, zero = [[0], [1]], [[0.0], [0.0]]
    groups = {
        1: (squares(2, basis, zero, 1e4),),
        2: (squares([0, 2], [basis, basis], [zero, zero], 1e4),),
    }[count]
    assert bound_of(problem, scaling([False]), *groups) == -INF


def test_monomials_go_where_the_letter_of_a_block_puts_them():
    """Over z >= 0: a block of t with the basis {1, z} absorbs z and z^2, and not the constant."""
    problem = sp.Problem(z**3 - 0.5 * z**2 + z, lower=0)
    scale = scaling([False], side=[1])
    low = generators.bound_family(0, 1)[1].start
    block = squares(low, [[0], [1]], [[0.0], [0.0]], 1.0)
    found = bound_of(problem, scale, block)  # z (1 - z / 2 + z^2) >= 0
    assert -1e-12 <= found <= 0.0
    worse = sp.Problem(z**3 - 3 * z**2 + z, lower=0)  # -1.06... near 1.8
    assert bound_of(worse, scale, block) == -INF
    linear = sp.Problem(-0.5 * z + z**3 + z, lower=0)
    assert bound_of(linear, scale, block) <= 0.0


@pytest.mark.parametrize("basis", [[[1], [2], [3]], [[1, 1], [1, 2], [2, 2]]])
def test_each_entry_beside_the_diagonal_costs_both_rows(basis):
    """floor I + E with the row sums 2 e in the middle: definite for floor > 2 e or so, not less."""
    n = 3
    v = sp.variables(n)
    words = [[0] * (2 - len(w)) + w for w in basis]
    parts = []
    for w in words:
        term = 1.0
        for letter in w:
            term = term * (v[letter - 1] if letter else 1.0)
        parts.append(term)
    squares_ = sp.total([p * p for p in parts])
    for size, definite in ((0.9, True), (1.3, False)):
        # the middle row has two entries of size / 2: eigenvalues 1 +- size / sqrt(2), 1
        problem = sp.Problem(squares_ + size * parts[0] * parts[1] + size * parts[1] * parts[2])
        group = squares(0, words, np.zeros((3, 1)), 1.0)
        found = bound_of(problem, scaling([False] * n), group)
        assert (found > -INF) == definite
        assert found <= 0.0


def test_row_sums_count_in_whichever_row_they_are():
    """One entry (1, 2) of size 3 / 2 and the floor 1: the form is indefinite."""
    v = sp.variables(3)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        problem = sp.Problem(sp.total([u * u for u in v]) + 3.0 * v[i] * v[j])
        group = squares(0, [[1], [2], [3]], np.zeros((3, 1)), 1.0)
        assert bound_of(problem, scaling([False] * 3), group) == -INF
    # both rows of three entries in a star are full before each leaf is
    star = sp.Problem(sp.total([u * u for u in v]) + 1.5 * v[2] * v[0] + 1.5 * v[2] * v[1])
    group = squares(0, [[1], [2], [3]], np.zeros((3, 1)), 1.0)
    assert bound_of(star, scaling([False] * 3), group) == -INF


def test_what_is_left_of_a_floor_is_rounded_down():
    """floor - share in rationals, for shares that doubles lose."""
    for coefficient in (1e-20, 0.3, 1e-30):
        problem = sp.Problem(z**2 + coefficient * z + 1)
        found = evaluate(
            problem,
            Identity(scaling([False]), (squares(0, [[0], [1]], [[0.0], [0.0]], 1.0),)),
        )
        assert Fraction(found.floor) <= 1 - Fraction(coefficient) / 2
        assert found.floor >= 1 - coefficient / 2 - 1e-12


def test_the_least_floor_of_all_moment_blocks_is_left():
    """One block pays for x, one has little to begin with, one belongs to a constraint as well."""
    basis, zero = [[0], [1]], np.zeros((2, 1))
    one, small = squares(0, basis, zero, 1.0), squares(0, [[0], [2]], zero, 0.125)
    problem = sp.Problem(x**2 + 0.125 * y**2 + 0.5 * x + 2.0)
    for groups in ((one, small), (small, one)):
        found = evaluate(problem, Identity(scaling([False, False]), groups))
        assert found.bound > -INF and 0.12 < found.floor <= 0.125
    mixed = squares([0, 1], [basis, basis], [zero, zero], 0.25)
    problem = sp.Problem(1.5 * x**2 + 0 * y + 0.5 * x + 2.0, [1 - 0 * x >= 0])
    for groups in ((one, mixed), (mixed, one)):
        found = evaluate(problem, Identity(scaling([False, True]), groups))
        assert found.bound > -INF and 0.0 < found.floor <= 0.25


def test_a_floor_that_pays_for_one_tiny_entry_is_rounded_down():
    """z^2 goes to the first block; the second pays 5e-21 for z, which doubles lose beside 1."""
    problem = sp.Problem(3.0 * z**2 + 1.0 + 1e-20 * z)
    first = squares(0, [[1]], np.zeros((1, 1)), 2.0)
    second = squares(0, [[0], [1]], np.zeros((2, 1)), 1.0)
    found = evaluate(problem, Identity(scaling([False]), (first, second)))
    assert found.bound > -INF
    assert 1 - 1e-12 < found.floor and Fraction(found.floor) <= 1 - Fraction(1e-20) / 2


def test_monomials_between_those_of_a_block_are_not_its_own():
    """{1, z^2} has the products 1, z^2 and z^4: neither z nor z^3 is among them."""
    group = squares(0, [[0, 0], [1, 1]], np.zeros((2, 1)), 1.0)
    assert bound_of(sp.Problem(z**4 + 0.1 * z**2 + 1), scaling([False]), group) > -INF
    for term in (z, z**3):
        problem = sp.Problem(z**4 + 1 + 0.1 * term)
        assert bound_of(problem, scaling([False]), group) == -INF


@pytest.mark.parametrize("copies", [40, 400])
def test_the_floor_pays_for_the_upper_ends_of_coefficients(copies):
    """Many times the equation k x y = 0: the sum of all multipliers times k is paid in full."""
    rng = np.random.default_rng(copies)
    k, values = 1 + rng.uniform(), rng.uniform(0.5, 1, copies) / copies
    for sign in (1.0, -1.0):
        problem = sp.Problem(x**2 + y**2, [sign * k * x * y == 0] * copies)
        group = squares(0, [[0], [1], [2]], np.zeros((3, 1)), 1.0)
        multipliers = free(np.arange(1, copies + 1), values[:, None])
        scale = scaling([False, False])
        found = evaluate(problem, Identity(scale, (group, multipliers)))
        exact = sum(map(Fraction, values.tolist()), Fraction(0)) * Fraction(k) / 2
        assert Fraction(found.floor) <= 1 - exact
        assert found.floor >= 1 - float(exact) - 1e-9


def test_row_sums_are_taken_at_their_upper_ends():
    """Row 0 holds half of every linear coefficient: their sum in rationals, of 60 variables."""
    rng = np.random.default_rng(5)
    v = sp.variables(60)
    for _ in range(10):
        values = rng.uniform(0.5, 1, 60) / 60
        objective = sp.total([1.0 + 0 * v[0], *(u * u for u in v)])
        linear = sp.total([float(c) * u for c, u in zip(values, v, strict=True)])
        basis = [[k] for k in range(61)]
        group = squares(0, basis, np.zeros((61, 1)), 1.0)
        problem = sp.Problem(objective + linear)
        found = evaluate(problem, Identity(scaling([False] * 60), (group,)))
        exact = sum(map(Fraction, values.tolist()), Fraction(0)) / 2
        assert Fraction(found.floor) <= 1 - exact
        assert found.floor >= 1 - float(exact) - 1e-12


# ---- rounding ---------------------------------------------------------------------------------


def table(polynomial):
    return {
        tuple(v for v in w if v): Fraction(c)
        for w, c in zip(polynomial.words.tolist(), polynomial.coefficients.tolist(), strict=True)
    }


@pytest.mark.parametrize("seed", range(40))
def test_constants_losses_and_prices_are_rounded_down(seed):
    """Numbers with all digits: r_0 - sum |r_a| + prices in rationals."""
    rng = np.random.default_rng(seed)
    terms = [1.0 + 0 * x, x, y, x * y, x**2, y**3]
    values = rng.normal(size=6) * 10.0 ** rng.integers(-12, 3, 6)
    problem = sp.Problem(sp.total(float(c) * t for c, t in zip(values, terms, strict=True)))
    words = np.array([[0, 0, 1], [0, 1, 2], [2, 2, 2]], np.int32)
    prices = rng.normal(size=3) * 10.0 ** rng.integers(-12, 3, 3)
    scale = scaling([True, True])
    rest = table(problem.objective)
    assert Fraction(bound_of(problem, scale)) <= least(rest)
    total = Fraction(0)
    for word, price in zip(words.tolist(), prices.tolist(), strict=True):
        rest = plus(rest, {tuple(v for v in word if v): Fraction(price)}, Fraction(-1))
        total -= abs(Fraction(price))  # all three reach -1 and 1
    found = bound_of(problem, scale, priced=Priced(words, prices))
    assert Fraction(found) <= least(rest) + total
    assert found >= float(least(rest) + total) - 1e-9 * (1 + np.abs(values).sum())


def test_a_price_that_the_constant_swallows_still_counts():
    """1 - 1e-17 x^2 with the price -1.5e-17 of x^2: what is left, 5e-18 x^2, costs nothing."""
    price = -1.5e-17
    problem = sp.Problem(1.0 - 1e-17 * x**2 + 0 * y)
    priced = Priced(np.array([[1, 1]], np.int32), np.array([price]))
    found = bound_of(problem, scaling([True, True]), priced=priced)
    assert Fraction(found) <= 1 - Fraction(1e-17) and found >= 1 - 1e-12


@pytest.mark.parametrize("seed", range(20))
def test_prices_are_least_values_over_the_box(seed):
    """Monomials over [a, b]^2 in [-1, 1]^2, in rationals at the corners."""
    rng = np.random.default_rng(seed)
    low = rng.uniform(-1, 1, 2)
    high = low + rng.uniform(0, 1, 2) * (1 - low)
    words = np.array([[0, 1], [1, 1], [1, 2], [0, 2]], np.int32)
    prices = rng.normal(size=4)
    problem = sp.Problem(0 * x + 1.0)
    scale = scaling([True, True], ends=(low, high))
    priced = Priced(words, prices)
    exact = Fraction(0)
    for word, price in zip(words.tolist(), prices.tolist(), strict=True):
        letters = [v for v in word if v]
        corners = [[Fraction(low[v - 1]), Fraction(high[v - 1])] for v in letters]
        if letters == [1, 1]:
            values = [c * c for c in corners[0]] + [Fraction(0)] * bool(low[0] < 0 < high[0])
        elif len(letters) == 2:
            values = [a * b for a in corners[0] for b in corners[1]]
        else:
            values = corners[0]
        exact += min(Fraction(price) * v for v in values)
    assert Fraction(priced.least(scale)) <= exact
    assert priced.least(scale) == pytest.approx(float(exact), rel=1e-12, abs=1e-13)
    dear = sp.Problem(
        sp.total(float(p) * t for p, t in zip(prices, (x, x * x, x * y, y), strict=True))
    )
    found = bound_of(dear, scale, priced=priced)
    assert Fraction(found) <= exact
    assert problem.dimension == 2


def test_a_price_of_a_variable_without_a_box_is_refused():
    """z has no least value: of z + (1 + z^2) / 1000 the minimum is about -250, and not 0."""
    basis, zero = [[0], [1]], np.zeros((2, 1))
    for sign in (1.0, -1.0):
        problem = sp.Problem(sign * z + 0.001 * z * z + 0.001)
        group = squares(0, basis, zero, 0.0006)
        priced = Priced(np.array([[1]], np.int32), np.array([sign]))
        assert bound_of(problem, scaling([False]), group, priced=priced) == -INF
        # where z has the sign of its price, the least value is 0
        found = bound_of(problem, scaling([False], side=[int(sign)]), group, priced=priced)
        assert -1e-9 <= found <= 0.001


@pytest.mark.parametrize("seed", range(30))
def test_losses_are_sums_of_upper_ends(seed):
    """Coefficients as intervals: odd monomials cost the larger end, even ones the lower if < 0."""
    rng = np.random.default_rng(seed)
    words = np.array([[0, 1], [1, 1], [1, 2], [2, 2], [0, 2]], np.int32)
    low = rng.normal(size=5)
    high = low + rng.uniform(0, 2, 5)
    owner = rng.integers(0, 2, 5)
    found = losses(words, Interval(low, high), owner, 2)
    for k in range(2):
        exact = Fraction(0)
        for row in np.flatnonzero(owner == k):
            a, b = Fraction(low[row]), Fraction(high[row])
            even = words[row].tolist() in ([1, 1], [2, 2])
            exact += max(Fraction(0), -a) if even else max(abs(a), abs(b))
        assert Fraction(found[k]) >= exact
        assert float(found[k]) == pytest.approx(float(exact), rel=1e-12)


# ---- bounds of t ------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(60))
def test_products_of_the_ends_of_t_are_enclosed(seed):
    """(b - t)(t - a) - its own expansion is 0 in rationals, and not in doubles."""
    rng = np.random.default_rng(seed)
    a, b = -rng.uniform(0.1, 1), rng.uniform(0.1, 1)
    box, low, high = generators.bound_family(0, 1)
    scale = scaling([True], ends=([a], [b]))
    made = ScaledGenerators.of(sp.Problem(z).rows, scale, NONE)
    exact = {
        box.start: {(): -Fraction(a) * Fraction(b), (1,): Fraction(a) + Fraction(b), (1, 1): -1},
        low.start: {(): -Fraction(a), (1,): 1},
        high.start: {(): Fraction(b), (1,): -1},
    }
    for number, expected in exact.items():
        _, terms = made.system.terms_of(np.array([number]))
        found = {
            tuple(v for v in made.system.words[t].tolist() if v): (
                made.value.lo[t],
                made.value.hi[t],
            )
            for t in terms
        }
        for word, value in expected.items():
            lo, hi = found.get(word, (0.0, 0.0))
            assert Fraction(float(lo)) <= Fraction(value) <= Fraction(float(hi))
    objective = sp.total([-1.0 * z * z, (a + b) * z, 0.0 * z - a * b])
    problem = sp.Problem(objective)
    rest = plus(table(objective), exact[box.start], Fraction(-1))
    found = bound_of(problem, scale, squares(box.start, ONE, [[1.0]]))
    assert Fraction(found) <= least(rest)


@pytest.mark.parametrize("seed", range(20))
def test_products_of_generators_are_enclosed(seed):
    """g h of two linear constraints with all digits, and the square of a block with all digits."""
    rng = np.random.default_rng(seed)
    c = rng.normal(size=6)
    g, h = (float(p) * x + float(q) * y + float(r) for p, q, r in (c[:3], c[3:]))
    weight = rng.uniform(0.5, 2, 3)
    objective = sp.total(
        [float(v) * t for v, t in zip(rng.normal(size=4), (x, y, x * y, x * x), strict=True)]
    )
    problem = sp.Problem(objective, [g >= 0, h >= 0], -1, 1)
    single = generators.count(2, 2)
    factor = rng.normal(size=(2, 2))
    groups = (
        squares(single, ONE, [[float(weight[0])]]),
        squares(single + 1, ONE, [[float(weight[1])]]),
        squares(0, [[0], [1]], factor, 0.1),
    )
    products = np.array([[1, 2], [single, 2]])
    found = bound_of(problem, scaling([True, True]), *groups, products=products)
    one = times(table(g), table(h))
    made = [one, times(one, table(h))]
    rest = table(objective)
    for w, p in zip(weight, made, strict=False):
        rest = plus(rest, p, -(Fraction(w) ** 2))
    gram = [
        [sum(Fraction(a) * Fraction(b) for a, b in zip(u, v, strict=True)) for v in factor]
        for u in factor
    ]
    floor = Fraction(0.1)
    rest = plus(
        rest,
        {(): gram[0][0] + floor, (1,): 2 * gram[0][1], (1, 1): gram[1][1] + floor},
        Fraction(-1),
    )
    assert Fraction(found) <= least(rest)
    assert found >= float(least(rest)) - 1e-9 * (1 + float(abs(least(rest))))


FIXED = Scaling(np.array([0.0, 0.7]), np.array([1.0, 0.0]), np.ones(2, bool), np.zeros(2, int))


def in_fixed(rng):
    """A polynomial in y with all digits, and its exact value at y = 7/10 (the double)."""
    values = rng.uniform(0.5, 1, 6)
    p = sp.total([float(c) * y**k if k else float(c) + 0 * y for k, c in enumerate(values)])
    at = Fraction(0.7)
    return p, sum(Fraction(c) * at**k for k, c in enumerate(values.tolist()))


@pytest.mark.parametrize("seed", range(20))
def test_constants_of_generators_are_taken_at_their_upper_ends(seed):
    """-p(y) <= -p(0.7) with y fixed: one inequality, a product of two, an entry of a matrix."""
    rng = np.random.default_rng(seed)
    (p, first), (q, second) = in_fixed(rng), in_fixed(rng)
    zero = sp.Problem(0 * x + 0 * y, [p - x**2 >= 0, q >= 0])
    one = squares(1, ONE, [[1.0]])
    found = bound_of(zero, FIXED, one)
    assert Fraction(found) <= -first and found >= -float(first) * (1 + 1e-13)
    single = generators.count(2, 2)
    products = np.array([[1, 2]])
    pair = squares(single, ONE, [[1.0]])
    plain = sp.Problem(0 * x + 0 * y, [p >= 0, q >= 0])
    found = bound_of(plain, FIXED, pair, products=products)
    assert Fraction(found) <= -first * second and found >= -float(first * second) * (1 + 1e-13)
    matrix = sp.Problem(0 * x + 0 * y, [sp.psd([[p, 0.0], [0.0, q]])])
    for place, value in ((0, first), (1, second)):
        group = squares(1, ONE, [[1.0]], place=np.array([[place]]))
        found = bound_of(matrix, FIXED, group)
        assert Fraction(found) <= -value and found >= -float(value) * (1 + 1e-13)
    for number, value in ((1, first), (single, first * second)):
        found = dual_bounds(plain, FIXED, [number], [1.0], products=products)[0]
        assert Fraction(found) <= -value and found >= -float(value) * (1 + 1e-13)


@pytest.mark.parametrize("seed", range(20))
def test_entries_of_squares_that_cancel_are_enclosed(seed):
    """10 x^2 + 10 y^2 less a square whose entry x y nearly cancels: it costs what doubles lose."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(1, 2, 2)
    c = float(np.nextafter(1 / a, 2))
    factor = np.array([[a, b], [b * c, -a * c]])
    problem = sp.Problem(10 * x**2 + 10 * y**2)
    exact = sum(Fraction(u) * Fraction(v) for u, v in zip(*factor, strict=True))
    group = squares(0, [[1], [2]], factor)
    found = bound_of(problem, scaling([True, True]), group)
    assert Fraction(found) <= -2 * abs(exact)
    assert found >= -1e-14


# ---- malformed --------------------------------------------------------------------------------


def good():
    """min x over [-1, 1]^2 with x >= y, y == 0 is 0."""
    problem = sp.Problem(x + 0 * y, [x - y >= 0, y == 0], -1, 1)
    return problem, scaling([True, True])


def test_free_multipliers_need_equations_each():
    """The row x - y >= 0 beside the equation y = 0, in one group; with -1 it says x <= y."""
    problem, scale = good()
    negative = sp.Problem(-1.0 * x + 0 * y, problem.constraints, -1, 1)  # its minimum is -1
    assert bound_of(problem, scale, squares(1, ONE, [[1.0]]), free(2, 1.0)) >= -1e-12
    for number in ([1], [1, 2], [2, 1], [0], [3], [2, 0]):
        group = free(np.array(number), -1.0)
        assert bound_of(negative, scale, group) == -INF, number
        dual = LinearDual(
            scale,
            np.array(number),
            np.ones((len(number), 1), np.int32),
            np.full(len(number), -1.0),
            np.zeros(len(number), int),
            NONE,
        )
        rows = negative.rows, negative.equality, negative.objective_row
        found = dual.evaluate(*rows)[0]
        assert found <= -1.0


def test_the_number_of_an_equation_is_its_own():
    """With generator 2 the equation; 1 is the inequality, and 0 the constant."""
    problem, scale = good()
    for number in (0, 1, 3):
        dual = LinearDual(
            scale,
            np.array([number]),
            np.array([[1]], np.int32),
            np.array([0.5]),
            np.zeros(1, int),
            NONE,
        )
        rows = problem.rows, problem.equality, problem.objective_row
        assert dual.evaluate(*rows)[0] == -INF
        assert np.isfinite(replace(dual, generator=np.array([2])).evaluate(*rows)[0])


def test_every_multiplier_of_a_matrix_needs_its_matrix():
    """The first group is right, and the second reads beyond the end of the smaller matrix."""
    big = sp.psd([[1, x, 0], [x, 1, 0], [0, 0, 1 + 0 * x]])
    small = sp.psd([[1, y], [y, 1]])
    problem = sp.Problem(x + y, [big, small], -1, 1)
    scale = scaling([True, True])
    words, factor = [[0], [0]], np.full((2, 1), 0.5)

    def group(numbers, places):
        count = len(numbers)
        return Multipliers(
            np.array(numbers),
            np.array([words] * count, np.int32),
            np.array([factor] * count),
            0.0,
            np.array(places),
        )

    right = group([1], [[0, 2]])
    assert bound_of(problem, scale, right) > -INF
    for wrong in (
        group([2], [[0, 2]]),
        group([2], [[2, 2]]),
        group([1, 2], [[0, 2], [0, 2]]),
        group([2, 1], [[0, 2], [0, 2]]),
        group([1], [[0, 3]]),
        group([1], [[-1, 0]]),
        group([3], [[0, 1]]),
        group([0], [[0, 1]]),
    ):
        for groups in ((wrong,), (right, wrong), (wrong, right)):
            assert bound_of(problem, scale, *groups) == -INF
    assert bound_of(problem, scale, group([2], [[0, 1]]), right) > -INF


def test_entries_beside_the_diagonal_of_a_matrix_count():
    """<L L', [1 x; x 1]> with L = (1, -1) / sqrt 2 is 1 - x: min -x is -1, and not more."""
    problem = sp.Problem(-1.0 * x + 0 * y, [sp.psd([[1, x], [x, 1]])], -2, 2)
    scale = Scaling(np.zeros(2), np.full(2, 2.0), np.ones(2, bool), np.zeros(2, int))
    for factor, expected in (([1.0, -1.0], -1.0), ([1.0, 1.0], -5.0)):
        values = np.array(factor)[:, None] * 2.0**-0.5
        group = squares(1, [[0], [0]], values, place=np.array([[0, 1]]))
        found = bound_of(problem, scale, group)
        assert expected - 1e-12 <= found <= expected


@pytest.mark.parametrize("seed", range(10))
def test_entries_of_matrices_are_enclosed(seed):
    """A matrix with entries of all digits around a centre that is no integer, in rationals."""
    rng = np.random.default_rng(seed)
    a, b, c = rng.normal(size=3)
    centre, size = rng.uniform(0.1, 0.9), rng.uniform(0.1, 0.9)
    entries = [float(a) * z + 1, float(b) * z * z, float(c) * z + 2]
    problem = sp.Problem(0.0 * z, [sp.psd([entries[:2], entries[1:]])])
    scale = Scaling(np.array([centre]), np.array([size]), np.ones(1, bool), np.zeros(1, int))
    factor = rng.normal(size=(2, 2))
    group = squares(1, [[0], [1]], factor, 0.25, place=np.array([[0, 1]]))
    found = bound_of(problem, scale, group)
    t = {(): Fraction(centre), (1,): Fraction(size)}
    moved = []
    for p in entries:
        total = {}
        for word, value in table(p).items():
            term = {(): value}
            for _ in word:
                term = times(term, t)
            total = plus(total, term)
        moved.append(total)
    gram = [
        [sum(Fraction(u) * Fraction(v) for u, v in zip(p, q, strict=True)) for q in factor]
        for p in factor
    ]
    rest = {}
    for i, j, word in ((0, 0, ()), (0, 1, (1,)), (1, 0, (1,)), (1, 1, (1, 1))):
        weight = gram[i][j] + (Fraction(0.25) if i == j else 0)
        rest = plus(rest, times({word: weight}, moved[i + j]), Fraction(-1))
    assert Fraction(found) <= least(rest)
    assert found >= float(least(rest)) - 1e-10 * (1 + float(abs(least(rest))))


MALFORMED = {
    "generator of bits": {"generator": np.array([True])},
    "generator flat": {"generator": np.array(1)},
    "basis flat": {"basis": np.zeros((1, 1), np.int32)},
    "basis of more blocks": {"basis": np.zeros((2, 1, 1), np.int32)},
    "basis of more monomials": {"basis": np.zeros((1, 2, 1), np.int32)},
    "basis of empty words": {"basis": np.zeros((1, 1, 0), np.int32)},
    "basis of unknown variables": {"basis": np.full((1, 1, 1), 3, np.int32)},
    "basis of negative variables": {"basis": np.full((1, 1, 1), -1, np.int32)},
    "values of four dimensions": {"values": np.ones((1, 1, 1, 1))},
    "values of one dimension": {"values": np.ones(1)},
    "values of more blocks": {"values": np.ones((2, 1, 1))},
    "values that are none": {"values": np.full((1, 1, 1), np.nan)},
    "no blocks": {
        "generator": np.zeros(0, int),
        "basis": np.zeros((0, 1, 1), np.int32),
        "values": np.zeros((0, 1, 1)),
    },
    "places of a free multiplier": {"values": np.ones((1, 1)), "place": np.zeros((1, 1), int)},
    "places of another shape": {"place": np.zeros((1, 2), int)},
    "floor infinite": {"floor": INF},
    "floor negative": {"floor": -0.5},
    "floor none": {"floor": np.nan},
}


@pytest.mark.parametrize("what", MALFORMED)
def test_malformed_groups_prove_nothing_and_raise_nothing(what):
    """Also beside a group that is right."""
    problem, scale = good()
    matrix = sp.Problem(x + 0 * y, [sp.psd([[1, x], [x, 1]]), y == 0], -1, 1)
    right = squares(1, ONE, [[1.0]])
    for each in (problem, matrix):
        assert bound_of(each, scale, right) > -INF
        wrong = replace(right, **MALFORMED[what])
        for groups in ((wrong,), (right, wrong), (wrong, right)):
            assert bound_of(each, scale, *groups) == -INF


@pytest.mark.parametrize(
    "words, values",
    [
        (np.zeros(1, np.int32), np.zeros(1)),
        (np.zeros((1, 0), np.int32), np.zeros(1)),
        (np.zeros((1, 1), np.int32), np.zeros(2)),
        (np.zeros((2, 1), np.int32), np.zeros(1)),
        (np.zeros((1, 1), np.int32), np.zeros((1, 1))),
        (np.full((1, 1), 3, np.int32), np.ones(1)),
        (np.full((1, 1), -1, np.int32), np.ones(1)),
        (np.ones((1, 1)), np.ones(1)),
        (np.ones((1, 1), np.int8), np.ones(1)),
        (np.ones((1, 1), np.int32), np.array([np.nan])),
        (np.ones((1, 1), np.int32), np.array([np.inf])),
        (np.ones((1, 1), np.int32), np.ones(1, object)),
        (np.ones((1, 1), np.int32), np.ones(1, np.longdouble)),
    ],
)
def test_malformed_prices_prove_nothing_and_raise_nothing(words, values):
    problem, scale = good()
    assert bound_of(problem, scale, priced=Priced(words, values)) == -INF


@pytest.mark.parametrize(
    "products",
    [
        [[9, 9]],
        [[0, 9]],
        [[-1, 0]],
        [[10, 0], [0, 0]],
        [[0, 0], [0, 10]],
        [[0, 0, 0]],
        [0, 0],
    ],
)
def test_malformed_products_prove_nothing_and_raise_nothing(products):
    """Nine generators: 1, two rows and six of bounds; a product refers to those before it."""
    problem, scale = good()
    assert generators.count(2, 2) == 9
    right = squares(1, ONE, [[1.0]])
    assert bound_of(problem, scale, right, products=np.array([[0, 8], [9, 1]])) > -INF
    for kind in (np.int64, np.int32):
        assert bound_of(problem, scale, right, products=np.array(products, kind)) == -INF
    small = np.array([[1, 2]])
    for kind in (np.int8, float, bool, np.uint64):
        assert bound_of(problem, scale, right, products=small.astype(kind)) == -INF


def test_malformed_scalings_prove_nothing_and_raise_nothing():
    problem, scale = good()
    right = squares(1, ONE, [[1.0]])
    dual = LinearDual(
        scale, np.array([1]), np.zeros((1, 1), np.int32), np.ones(1), np.zeros(1, int), NONE
    )
    rows = problem.rows, problem.equality, problem.objective_row
    assert np.isfinite(dual.evaluate(*rows)[0])
    two = np.ones(2)
    for fields in (
        {"centre": np.zeros(1)},
        {"scale": np.ones(3)},
        {"boxed": np.ones(2, int)},
        {"boxed": np.ones(1, bool)},
        {"side": np.zeros(1, int)},
        {"centre": np.zeros(2, np.float32)},
        {"scale": np.ones(2, np.longdouble)},
        {"ends": (-2 * two, two)},
        {"ends": (-two, 2 * two)},
        {"ends": (two, -two)},
        {"ends": (np.array([-1.0, 0.5]), np.array([1.0, 0.25]))},
        {"ends": (np.array([-1.0, -2.0]), two)},
        {"ends": (-two, np.array([1.0, 1e-200]))},
        {"ends": (-two, np.array([1.0, np.nan]))},
        {"ends": (-two, np.array([1.0]))},
    ):
        wrong = replace(scale, **fields)
        assert not wrong.fits(2)
        assert bound_of(problem, wrong, right) == -INF
        assert replace(dual, scaling=wrong).evaluate(*rows)[0] == -INF


# ---- linear duals -----------------------------------------------------------------------------


def dual_bounds(problem, scale, number, value, word=None, owner=None, products=NONE, asked=None):
    count = len(number)
    dual = LinearDual(
        scale,
        np.array(number, int),
        np.zeros((count, 1), np.int32) if word is None else np.array(word, np.int32),
        np.array(value, float),
        np.zeros(count, int) if owner is None else np.array(owner),
        products,
    )
    target = problem.objective_row if asked is None else PolynomialSystem.stack(asked, 2)
    with np.errstate(all="ignore"):
        return dual.evaluate(problem.rows, problem.equality, target)


@pytest.mark.parametrize("seed", range(40))
def test_linear_bounds_are_rounded_down(seed):
    """Multipliers with all digits of a row, an equation times x and a product, in rationals."""
    rng = np.random.default_rng(seed)
    c = rng.normal(size=(4, 3)) * 10.0 ** rng.integers(-6, 3, (4, 1))
    line = [float(p) * x + float(q) * y + float(r) for p, q, r in c]
    problem = sp.Problem(line[0], [line[1] >= 0, line[2] == 0], -1, 1)
    values = rng.uniform(0.1, 2, 3)
    single = generators.count(2, 2)
    products = np.array([[1, 1]])
    found = dual_bounds(
        problem,
        scaling([True, True]),
        [1, 2, single],
        values,
        word=[[0], [1], [0]],
        owner=[0, 0, 1],
        products=products,
        asked=[line[0], line[3]],
    )
    g, h = table(line[1]), table(line[2])
    rest = plus(table(line[0]), g, -Fraction(values[0]))
    rest = plus(rest, times({(1,): Fraction(values[1])}, h), Fraction(-1))
    other = plus(table(line[3]), times(g, g), -Fraction(values[2]))
    for value, exact in zip(found, (least(rest), least(other)), strict=True):
        assert Fraction(value) <= exact
        assert value >= float(exact) - 1e-9 * (1 + abs(float(exact)))


@pytest.mark.parametrize("seed", range(10))
def test_coefficients_of_objectives_are_taken_at_their_upper_ends(seed):
    """x p(y) with y fixed has the minimum -p(0.7); 1 + 1e-17 x is not 1."""
    p, value = in_fixed(np.random.default_rng(seed))
    problem = sp.Problem(x * p)
    for found in (dual_bounds(problem, FIXED, [], [])[0], bound_of(problem, FIXED)):
        assert Fraction(found) <= -value and found >= -float(value) * (1 + 1e-13)
    tiny = sp.Problem(1 + 1e-17 * x + 0 * y)
    for found in (dual_bounds(tiny, FIXED, [], [])[0], bound_of(tiny, FIXED)):
        assert Fraction(found) <= 1 - Fraction(1e-17) and found >= 1 - 1e-12


@pytest.mark.parametrize("kind", [np.longdouble, complex, object, int])
def test_multipliers_of_linear_duals_are_doubles(kind):
    problem, scale = good()
    dual = LinearDual(
        scale, np.array([1]), np.zeros((1, 1), np.int32), np.ones(1), np.zeros(1, int), NONE
    )
    rows = problem.rows, problem.equality, problem.objective_row
    assert np.isfinite(dual.evaluate(*rows)[0])
    assert replace(dual, value=dual.value.astype(kind)).evaluate(*rows)[0] == -INF
    for count in (0, 2, 3):
        wrong = replace(dual, word=np.zeros((count, 1), np.int32))
        assert wrong.evaluate(*rows)[0] == -INF


def test_a_negative_multiplier_of_an_inequality_counts_as_nothing():
    """x >= 0 times -1 would prove -x >= 0, but the minimum of -x is -1."""
    problem = sp.Problem(-1.0 * x + 0 * y, [x >= 0], -1, 1)
    for number in (1, generators.bound_family(1, 2)[1].start):
        found = dual_bounds(problem, scaling([True, True]), [number], [-1.0])[0]
        assert -1 - 1e-12 <= found <= -1.0


def test_an_inequality_times_a_monomial_is_no_inequality():
    """x (y + 1) >= 0 is false for x < 0: min x y + x over the square is -2."""
    problem = sp.Problem(x * y + x, [y + 1 >= 0], -1, 1)
    for word in ([[1]], [[2]]):
        assert dual_bounds(problem, scaling([True, True]), [1], [1.0], word)[0] <= -2.0
    right = sp.Problem(x * y + x, [y + 1 == 0], -1, 1)
    assert dual_bounds(right, scaling([True, True]), [1], [1.0], [[1]])[0] >= -1e-12


def test_multipliers_belong_to_their_bound():
    """x >= 1/2 proves the first, and nothing of the second."""
    problem = sp.Problem(x + 0 * y, [x >= 0.5], -1, 1)
    for owners in ([0], [1]):
        found = dual_bounds(
            problem, scaling([True, True]), [1], [1.0], owner=owners, asked=[x + 0 * y, y + 0 * x]
        )
        assert found[1] == pytest.approx(-1.0, abs=1e-12) or owners == [1]
        assert found[1] <= -1.0 and found[0] <= 0.5
        if owners == [1]:
            assert found[0] <= -1.0


def test_multipliers_that_overflow_prove_nothing():
    problem = sp.Problem(x + 0 * y, [1e300 * x >= 0], -1, 1)
    for value in (1e300, 1e308):
        found = dual_bounds(problem, scaling([True, True]), [1], [value])[0]
        assert found == -INF
        square = bound_of(problem, scaling([True, True]), squares(1, ONE, [[np.sqrt(value)]]))
        assert square == -INF
    assert (
        dual_bounds(
            problem,
            scaling([True, True]),
            [0],
            [
                1e308,
            ][:1],
        )[0]
        <= -1e308
    )
