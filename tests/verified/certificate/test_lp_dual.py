"""Linear certificates: whatever the multipliers are, the bounds hold; optimal ones reach the LP."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from exact_polynomials import exact_generators, in_t, least, plus, times, value_at
from hypothesis import given, settings
from random_cases import SEEDS, on_grid, random_case, some_polynomial
from scipy.optimize import linprog

import sparsepop_py as sp
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.problem import generators
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.certificate.certificate import Certificate, Node
from sparsepop_py.verified.certificate.lp_dual import LinearDual
from sparsepop_py.verified.certificate.steps import BoxProof, Replay, Tightening

INF = np.inf
NONE = np.zeros((0, 2), np.int64)


def scaling_of(problem):
    return Scaling.of_box(Interval(problem.lower, problem.upper))


def dual_of(scaling, generator, value, owner=None, word=None, products=NONE):
    count = len(generator)
    return LinearDual(
        scaling,
        np.array(generator, np.int64),
        np.zeros((count, 1), np.int32) if word is None else np.array(word, np.int32),
        np.array(value),
        np.zeros(count, np.int64) if owner is None else np.array(owner, np.int64),
        np.array(products, np.int64),
    )


def bounds(dual, problem, objectives=None):
    asked = [problem.objective] if objectives is None else objectives
    stacked = PolynomialSystem.stack(asked, problem.dimension)
    return dual.evaluate(problem.rows, problem.equality, stacked)


def random_dual(rng, problem, owners):
    """Any multipliers of any sign, on products and products of products too."""
    n, m = problem.dimension, len(problem.constraints)
    single = generators.count(m, n)
    products = [rng.integers(0, single + k, 2) for k in range(int(rng.integers(0, 5)))]
    count = int(rng.integers(0, 12))
    generator = rng.integers(0, single + len(products), count)
    value = rng.normal(size=count) * 10.0 ** rng.integers(-4, 3, count)
    word = rng.integers(0, n + 1, (count, 2))
    equal = np.append(False, problem.equality)
    free = equal[np.where(generator <= m, generator, 0)]
    word[~free] = 0
    dual = dual_of(
        scaling_of(problem),
        generator,
        value,
        rng.integers(0, owners, count),
        word,
        np.array(products).reshape(-1, 2),
    )
    return replace(dual, value=dual.value.astype("f4")) if rng.integers(2) else dual


def exact_bound(dual, problem, objective, owner):
    """The same bound in rationals; negative multipliers of inequalities count as zero."""
    made, rest = exact_generators(problem, dual), in_t(objective, dual.scaling)
    equal = np.append(False, problem.equality).tolist()
    for g, word, value, own in zip(
        dual.generator.tolist(), dual.word.tolist(), dual.value.tolist(), dual.owner, strict=True
    ):
        free = g < len(equal) and equal[g]
        if own == owner and (free or value > 0):
            monomial = {tuple(v for v in sorted(word) if v): Fraction(value)}
            rest = plus(rest, times(monomial, made[g]), Fraction(-1))
    return least(rest)


# ---- any multipliers --------------------------------------------------------------------------


@given(SEEDS)
@settings(max_examples=60, deadline=None)
def test_any_multipliers_prove_what_they_prove_in_rationals_and_no_more(seed):
    case, rng = random_case(seed), np.random.default_rng([seed, 7])
    problem = case.problem
    x = sp.variables(problem.dimension)
    objectives = [problem.objective] + [some_polynomial(rng, x, 3) for _ in range(2)]
    dual = random_dual(rng, problem, len(objectives))
    found = bounds(dual, problem, objectives)
    assert found.shape == (3,)
    for owner, (objective, value) in enumerate(zip(objectives, found.tolist(), strict=True)):
        true = exact_bound(dual, problem, objective, owner)
        assert value <= true  # rounded downward ...
        assert value >= float(true) - 1e-9 * (1.0 + abs(float(true)))  # ... and not by much
        assert value <= on_grid(objective, case.points).min()


@pytest.mark.parametrize("size", [1e-320, 1e-300, 1e-160, 1e-30, 1e30, 1e150, 1e300, 1.7e308])
def test_sizes_at_the_ends_of_the_doubles_round_downward_or_prove_nothing(size):
    """min x y over [0, s]^2 is 0: the multipliers 1 and s of the bounds can be of any size."""
    x, y = sp.variables(2)
    for side in (1.0, 2.0**-200, 1e-3, 1e100):
        problem = sp.Problem(x * y - x, [x * y >= 0], lower=0, upper=side)
        single = generators.count(1, 2)
        for g in (1, 6, 8, single):
            dual = dual_of(scaling_of(problem), [g, 0], [size, size], products=[[6, 7]])
            for objective in (problem.objective, 0.0 * x, size * x):
                [value] = bounds(dual, problem, [objective])
                assert value <= exact_bound(dual, problem, objective, 0)
                assert value <= 0.0


def test_nothing_is_lost_without_multipliers():
    """2 x y - 3 x over [-1, 1]^2 is at least -5, and a constant is itself."""
    x, y = sp.variables(2)
    problem = sp.Problem(2 * x * y - 3 * x, lower=-1, upper=1)
    none = dual_of(scaling_of(problem), [], [])
    assert bounds(none, problem)[0] == pytest.approx(-5.0, abs=1e-9)
    assert bounds(none, problem)[0] <= -5.0
    assert bounds(none, problem, [0 * x + 0.1]).tolist() == [0.1]
    assert bounds(none, problem, []).shape == (0,)


# ---- optimal multipliers ----------------------------------------------------------------------


def mccormick(n, m=0):
    """Numbers of the products of the bounds of each pair of variables, on top of m rows."""
    single = generators.count(m, n)
    _, low, high = generators.bound_family(m, n)
    sides = (low.start, high.start)
    pairs = [(i + a, j + b) for i in range(n) for j in range(i) for a in sides for b in sides]
    return np.array(pairs, np.int64).reshape(-1, 2), single


def relaxed_minimum(problem, dual, objective):
    """The LP in the monomials of the multipliers' generators: minimum and prices, from SciPy."""
    made = exact_generators(problem, dual)
    equal = np.append(False, problem.equality).tolist()
    rows = []
    for g, word in zip(dual.generator.tolist(), dual.word.tolist(), strict=True):
        row = times({tuple(v for v in word if v): Fraction(1)}, made[g])
        rows.append((row, g < len(equal) and equal[g]))
    target = in_t(objective, dual.scaling)
    names = sorted({w for p in [target, *(r for r, _ in rows)] for w in p} - {()})
    number = {w: k for k, w in enumerate(names)}

    def vector(p):
        values = np.zeros(len(names))
        for w, value in p.items():
            if w:
                values[number[w]] = float(value)
        return values

    def split(kind):
        chosen = [(vector(r), float(r.get((), 0))) for r, free in rows if free == kind]
        matrix = np.array([v for v, _ in chosen]).reshape(-1, len(names))
        return matrix, np.array([c for _, c in chosen])

    (le, low), (eq, rest) = split(False), split(True)
    even = [all(w.count(v) % 2 == 0 for v in w) for w in names]
    box = [(0.0 if e else -1.0, 1.0) for e in even]
    found = linprog(vector(target), -le, low, eq, -rest, box, method="highs")
    assert found.status == 0
    price = np.zeros(len(rows))
    kinds = np.array([free for _, free in rows])
    price[~kinds], price[kinds] = -found.ineqlin.marginals, found.eqlin.marginals
    return found.fun + float(target.get((), 0)), price


@pytest.mark.parametrize("seed", range(12))
def test_optimal_prices_reach_the_linear_program_and_not_the_vertices(seed):
    """A multilinear objective on a box has its minimum at a vertex."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    x = sp.variables(n)
    terms = [*x, *(x[i] * x[j] for i in range(n) for j in range(i))]
    f = sp.total(float(c) * t for c, t in zip(rng.integers(-9, 10, len(terms)), terms, strict=True))
    low = rng.integers(-3, 1, n).astype(float)
    problem = sp.Problem(f, lower=low, upper=low + rng.integers(1, 5, n))
    products, single = mccormick(n)
    every = np.arange(single + len(products))
    dual = dual_of(scaling_of(problem), every, np.zeros(every.size), products=products)
    optimum, price = relaxed_minimum(problem, dual, f)
    [value] = bounds(replace(dual, value=price), problem)
    corners = product(*zip(problem.lower.tolist(), problem.upper.tolist(), strict=True))
    true = min(value_at(f, corner) for corner in corners)
    assert value <= true
    assert value == pytest.approx(optimum, abs=1e-8)
    # short floats cost little, and what they cost is paid for
    [short] = bounds(replace(dual, value=price.astype("f4")), problem)
    assert short <= optimum + 1e-12
    assert short == pytest.approx(optimum, abs=1e-4)
    # prices of the wrong sign prove no more
    assert bounds(replace(dual, value=-price), problem)[0] <= value + 1e-9


@pytest.mark.parametrize("seed", range(8))
def test_equations_times_monomials_reach_the_linear_program(seed):
    """min c'x over x + y + z = 1 (times x, y, z), x y >= 1/16 in the unit box, on a fine grid."""
    rng = np.random.default_rng(seed)
    x, y, z = sp.variables(3)
    f = sp.total(
        float(c) * t for c, t in zip(rng.integers(-5, 6, 4), (x, y, x * y, y * z), strict=True)
    )
    problem = sp.Problem(f, [x + y + z == 1, x * y >= 0.0625], lower=0, upper=1)
    products, single = mccormick(3, 2)
    generator = [*range(single), *range(single, single + len(products)), 1, 1, 1]
    word = np.zeros((len(generator), 1), np.int32)
    word[-3:, 0] = [1, 2, 3]
    dual = dual_of(
        scaling_of(problem), generator, np.zeros(len(generator)), word=word, products=products
    )
    optimum, price = relaxed_minimum(problem, dual, f)
    [value] = bounds(replace(dual, value=price), problem)
    a, b = np.meshgrid(np.arange(65) / 64, np.arange(65) / 64)
    points = np.stack([a.ravel(), b.ravel(), 1 - a.ravel() - b.ravel()], axis=1)
    points = points[(points[:, 2] >= 0) & (points[:, 0] * points[:, 1] >= 0.0625)]
    assert value <= on_grid(f, points).min()
    assert value == pytest.approx(optimum, abs=1e-8)
    bent = price.copy()
    bent[[1, -3, -2, -1]] += rng.normal(size=4)
    assert bounds(replace(dual, value=bent), problem)[0] <= optimum + 1e-9


def test_products_of_products_bound_a_cubic():
    """The objective (1 + x)(1 + y)(1 + z) is itself a product of three bounds."""
    x, y, z = sp.variables(3)
    f = (1 + x) * (1 + y) * (1 + z)
    problem = sp.Problem(f, lower=-1, upper=1)
    _, low, _ = generators.bound_family(0, 3)
    single = generators.count(0, 3)
    products = [[low.start, low.start + 1], [single, low.start + 2]]
    unit = Scaling(np.zeros(3), np.ones(3), np.ones(3, bool), np.zeros(3, int))
    [value] = bounds(dual_of(unit, [single + 1], [1.0], products=products), problem)
    assert -1e-12 <= value <= 0.0
    [without] = bounds(dual_of(unit, [], []), problem)
    assert without == pytest.approx(1 - 7, abs=1e-12)


def test_a_proof_of_emptiness_by_prices():
    """x + y >= 1.5 and x y <= 0.4 on the unit box: (1 - x)(1 - y) = 1 - (x + y) + x y < 0."""
    x, y = sp.variables(2)
    rows = [x + y >= 1.5, x * y <= 0.4]
    problem = sp.Problem(x, rows, lower=0, upper=1)
    _, _, high = generators.bound_family(2, 2)
    single = generators.count(2, 2)
    # in t the last product is (1 - t)(1 - s), 4 times the one in x (but for rounding)
    dual = dual_of(
        scaling_of(problem),
        [1, 2, single],
        [1.0, 1.0, 0.25],
        products=[[high.start, high.start + 1]],
    )
    node = Node(argument=dual, empty=True)
    assert Certificate(problem.fingerprint, INF, node).verify(problem).ok
    fuller = sp.Problem(x, [x + y >= 1.5, x * y <= 0.5], lower=0, upper=1)  # (1, 1/2) fits
    verdict = Certificate(fuller.fingerprint, INF, node).verify(fuller)
    assert not verdict.ok
    assert verdict.bound <= 0.5


# ---- malformed and forged ---------------------------------------------------------------------


def square():
    x, y = sp.variables(2)
    return sp.Problem(x * y, [x + y >= 0.5, x == y], lower=-1, upper=1)


BROKEN = {
    "generator too large": {"generator": np.array([0, 99])},
    "generator negative": {"generator": np.array([0, -1])},
    "generator too short": {"generator": np.array([0])},
    "generator of bits": {"generator": np.array([True, False])},
    "generator of bytes": {"generator": np.array([0, 1], np.int8)},
    "generator of floats": {"generator": np.array([0.0, 1.0])},
    "owner too large": {"owner": np.array([0, 1])},
    "owner negative": {"owner": np.array([0, -1])},
    "owner of floats": {"owner": np.array([0.0, 0.0])},
    "owner two rows": {"owner": np.zeros((2, 1), np.int64)},
    "word flat": {"word": np.zeros(2, np.int32)},
    "word empty": {"word": np.zeros((2, 0), np.int32)},
    "word too large": {"word": np.array([[0], [3]], np.int32)},
    "word negative": {"word": np.array([[0], [-1]], np.int32)},
    "word of floats": {"word": np.array([[0.0], [0.5]])},
    "monomial times an inequality": {"word": np.array([[1], [0]], np.int32)},
    "value flat": {"value": np.zeros((2, 1))},
    "value not a number": {"value": np.array([1.0, np.nan])},
    "value endless": {"value": np.array([1.0, INF])},
    "product of itself": {"products": np.array([[9, 0]])},
    "product of later": {"products": np.array([[10, 0], [0, 0]])},
    "product negative": {"products": np.array([[-1, 0]])},
    "product of three": {"products": np.zeros((1, 3), np.int64)},
    "product flat": {"products": np.zeros(2, np.int64)},
    "product of bits": {"products": np.array([[True, True]])},
    "scaling too short": {
        "scaling": Scaling(np.zeros(1), np.ones(1), np.ones(1, bool), np.zeros(1, int))
    },
}


@pytest.mark.parametrize("what", BROKEN)
def test_malformed_multipliers_prove_nothing_and_raise_nothing(what):
    problem = square()
    sound = dual_of(scaling_of(problem), [1, 2], [0.5, -0.5])
    assert np.isfinite(bounds(sound, problem)).all()
    assert bounds(replace(sound, **BROKEN[what]), problem).tolist() == [-INF]


def test_monomials_of_variables_without_a_box_prove_nothing():
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, [y >= 0], lower=[0, -INF], upper=[1, INF])
    none = dual_of(scaling_of(problem), [], [])
    found = bounds(none, problem, [x, y, 0 * x, x * y, x + 0 * y])
    assert found[[1, 3]].tolist() == [-INF, -INF]
    assert found[[0, 2, 4]] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert found.max() <= 0.0
    # y - y leaves an interval around zero, which times an unbounded y is anything
    assert bounds(dual_of(scaling_of(problem), [1], [1 / 3]), problem, [y / 3])[0] <= 0.0


def step_of(problem, **fields):
    """x_1 >= 1/4 from x_1 >= 1/4 times 1, as a step."""
    dual = dual_of(scaling_of(problem), [1], [1.0])
    step = Tightening(np.array([0]), np.array([1]), np.array([0.25 - 1e-9]), dual, False)
    return replace(step, **fields)


def tightened(problem, step):
    return BoxProof((step,)).replay(Replay(problem, None))


def quarter():
    x, y = sp.variables(2)
    return sp.Problem(y, [x >= 0.25], lower=-1, upper=1)


@pytest.mark.parametrize("side", [0, 2, -2, 3, 0.5, 1j, np.nan, True, False])
def test_a_side_that_is_none_shrinks_nothing_wrongly(side):
    """2 x >= 1/4 is no x >= 1/4, and 0 >= 0 nothing at all."""
    x, y = sp.variables(2)
    problem = sp.Problem(y, [2 * x >= 0.25], lower=-1, upper=1)  # x may be 1/8
    for value in (0.25 - 1e-9, 0.0, -1e-9, -0.5):
        step = step_of(problem, side=np.array([side]), value=np.array([value]))
        box = tightened(problem, step)
        assert box.lo[0] <= 0.125
        assert box.hi.tolist() == [1.0, 1.0]


@pytest.mark.parametrize(
    "fields",
    [
        {"variable": np.array([True])},
        {"variable": np.array([0], np.int8)},
        {"variable": np.array([0.0])},
        {"variable": np.array([2])},
        {"variable": np.array([-1])},
        {"variable": np.array([0, 0])},
        {"variable": np.array([[0]])},
        {"variable": np.array([[0]]), "side": np.array([[1]]), "value": np.array([[0.2]])},
        {"value": np.array([np.nan])},
        {"value": np.array([INF])},
        {"value": np.array([0.25 + 1e-9])},
    ],
)
def test_a_malformed_or_greedy_step_leaves_the_box_alone(fields):
    problem = quarter()
    assert tightened(problem, step_of(problem)).lo.tolist() == [0.25 - 1e-9, -1.0]
    assert tightened(problem, step_of(problem, **fields)).lo.tolist() == [-1.0, -1.0]


def test_bits_are_no_variable_numbers():
    """[True, True] names x_2 twice, but as a mask it would shrink x_1 as well."""
    x, y = sp.variables(2)
    problem = sp.Problem(x, [y >= 0.25], lower=-1, upper=1)
    dual = dual_of(scaling_of(problem), [1, 1], [1.0, 1.0], owner=[0, 1])
    step = Tightening(np.array([1, 1]), np.array([1, 1]), np.full(2, 0.2), dual, False)
    assert tightened(problem, step).lo.tolist() == [-1.0, 0.2]
    assert tightened(problem, replace(step, variable=np.array([True, True]))).lo[0] == -1.0


def test_a_step_assumes_a_box_that_it_does_not_prove():
    problem = quarter()
    half = Scaling.of_box(Interval(np.full(2, -0.5), np.full(2, 0.5)))
    step = step_of(problem)
    small = replace(step, argument=replace(step.argument, scaling=half))
    assert tightened(problem, small).lo.tolist() == [-1.0, -1.0]
