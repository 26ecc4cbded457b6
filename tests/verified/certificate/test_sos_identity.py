"""The identity behind a bound, recomputed here in rationals, with good and bad multipliers."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from exact_polynomials import exact_bound

import sparsepop_py as sp
from sparsepop_py.relaxation.recover_multipliers import identity_of, margin, repaired
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaled, Scaling
from sparsepop_py.verified.certificate.sos_identity import Identity, Multipliers

INF = np.inf


def evaluate(identity, problem):
    return identity.evaluate(problem.rows, problem.equality, problem.objective_row)


def words(*rows):
    """One block's basis from tuples of letters, as the package stores it."""
    width = max([1, *map(len, rows)])
    padded = [(0,) * (width - len(row)) + tuple(row) for row in rows]
    return np.array([padded], np.int32)


def squares(generator, basis, factor, floor=0.0):
    return Multipliers(np.array([generator]), basis, np.array([factor], float), floor)


def free(generator, basis, values):
    return Multipliers(np.array([generator]), basis, np.array([values], float))


def unscaled(problem):
    """x = t, boxed where the bounds are [-1, 1]."""
    n = problem.dimension
    boxed = np.isfinite(problem.lower) & np.isfinite(problem.upper)
    side = np.where(boxed, 0, np.where(np.isfinite(problem.lower), 1, 0))
    return Scaling(np.zeros(n), np.ones(n), boxed, side)


def model(problem, order):
    """The scaled problem on its own bounds and a relaxation of it."""
    scaling = Scaling.of_box(Interval(problem.lower, problem.upper))
    scaled = Scaled.of(problem, scaling, (problem.objective,))
    return scaled, sp.relax(scaled.problem, order)


# ---- the same bound in rational arithmetic ----------------------------------------------------


def small_problem(seed):
    """Two boxed variables, an inequality, sometimes an equality, coefficients in eighths."""
    rng = np.random.default_rng(seed)
    x, y = sp.variables(2)
    terms = [x, y, x * y, x**2, y**2, x**2 * y, y**4]

    def some():
        return sp.total(
            float(c) / 8 * t for c, t in zip(rng.integers(-16, 17, 7), terms, strict=True)
        )

    rows = [some() + 3 >= 0]
    if seed % 2:
        rows.append(x * y - 0.25 * x == float(rng.integers(-2, 3)) / 16)
    low = rng.integers(-3, 1, 2) / 2
    return sp.Problem(some(), rows, low, low + rng.integers(1, 5, 2) / 3)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("kind", ["solved", "noisy", "float32", "random", "zero"])
def test_the_bound_is_the_exact_one_up_to_rounding(seed, kind):
    problem = small_problem(seed)
    scaled, relaxation = model(problem, 2)
    program = sp.assemble(relaxation, scaled.objectives[0])
    z = sp.solve_conic(program).z
    rng = np.random.default_rng([seed, 1])
    z = {
        "solved": z,
        "noisy": z + 1e-3 * rng.normal(size=z.size),
        "float32": z.astype(np.float32).astype(float),
        "random": rng.normal(size=z.size),
        "zero": 0.0 * z,
    }[kind]
    identity = identity_of(relaxation, scaled, z, scaled.objective_sizes[0])
    found, exact = evaluate(identity, problem), exact_bound(identity, problem)
    assert Fraction(found.bound) <= exact
    size = sum(float(np.abs(m.values).sum()) ** 2 + 1.0 for m in identity.multipliers)
    assert float(exact - Fraction(found.bound)) <= 1e-12 * (size + abs(found.bound))
    assert found.reason == ""


def test_products_of_generators_count_as_generators():
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, lower=-1, upper=1)
    # (1 + x)(1 - y) + (1 - x)(1 + y) = 2 - 2 x y, hence x y <= 1, and with signs x y >= -1
    pairs = np.array([[3, 4], [5, 6]])  # generators: 1, box x2, lower x2, upper x2
    half = [[np.sqrt(0.5)]]
    one = words(())
    identity = Identity(unscaled(problem), (squares(7, one, half), squares(8, one, half)), pairs)
    assert evaluate(identity, problem).bound == pytest.approx(-1.0, abs=1e-12)
    assert Fraction(evaluate(identity, problem).bound) <= exact_bound(identity, problem)


# ---- identities by hand -----------------------------------------------------------------------


def test_a_square_proves_its_constant_without_bounds():
    (x,) = sp.variables(1)
    problem = sp.Problem(x**2 - 2 * x + 3)
    identity = Identity(unscaled(problem), (squares(0, words((), (1,)), [[1.0], [-1.0]]),))
    evaluated = evaluate(identity, problem)  # (1 - x)^2 + 2: no floor, so no rounding is paid
    assert evaluated.bound == -INF
    assert "without finite bounds" in evaluated.reason
    scarce = Identity(
        unscaled(problem),
        (squares(0, words((), (1,)), [[1.0], [-1.0 + 1e-6]], floor=1e-5),),
    )
    assert 2.0 - 1e-4 < evaluate(scarce, problem).bound <= 2.0


def test_the_floor_absorbs_what_it_can_and_no_more():
    (x,) = sp.variables(1)
    problem = sp.Problem(x**2 + 0.5 * x)  # = floor (1 + x^2) + r with r = 0.5 x - 1, floor = 1
    basis = words((), (1,))
    identity = Identity(unscaled(problem), (squares(0, basis, [[0.0], [0.0]], floor=1.0),))
    evaluated = evaluate(identity, problem)
    # 0.5 x goes to the off-diagonal entries, 0.25 each, and the constant -1 stays
    assert -1.0 - 1e-12 <= evaluated.bound <= -1.0
    assert 0.75 - 1e-12 <= evaluated.floor <= 0.75
    steep = sp.Problem(x**2 + 2.125 * x)
    evaluated = evaluate(identity, steep)
    assert evaluated.bound == -INF
    assert "margin" in evaluated.reason


def test_a_monomial_outside_every_block_is_not_absorbed():
    (x,) = sp.variables(1)
    problem = sp.Problem(x**4 + x**2 + 1)
    identity = Identity(unscaled(problem), (squares(0, words((), (1,)), [[0.0]] * 2, 1.0),))
    evaluated = evaluate(identity, problem)
    assert evaluated.bound == -INF
    assert "outside every block" in evaluated.reason


def test_even_monomials_cost_nothing_when_positive():
    (x,) = sp.variables(1)
    nothing = ()
    up = sp.Problem(x**2, lower=-1, upper=1)
    down = sp.Problem(-(x**2), lower=-1, upper=1)
    odd = sp.Problem(x**3, lower=-1, upper=1)
    assert evaluate(Identity(unscaled(up), nothing), up).bound == pytest.approx(0.0, abs=1e-12)
    for problem in (down, odd):
        bound = evaluate(Identity(unscaled(problem), nothing), problem).bound
        assert -1.0 - 1e-12 <= bound <= -1.0


def test_a_free_multiplier_on_an_equality_may_have_either_sign():
    x, y = sp.variables(2)
    # x y with x == 1 - y on [-1, 1]^2: x y = (x + y - 1) y + y - y^2 ... lower bound -2 at y = -1
    problem = sp.Problem(x * y, [x + y == 1], lower=-1, upper=1)
    for sign in (1.0, -1.0):
        identity = Identity(unscaled(problem), (free(1, words((2,)), [sign]),))
        bound = evaluate(identity, problem).bound
        # points: (x, y) = (0, 1), (1, 0), (0.5, 0.5) have x y >= 0
        assert bound <= 0.0
        assert np.isfinite(bound)
    exact = Identity(unscaled(problem), (free(1, words((2,)), [1.0]),))
    assert evaluate(exact, problem).bound == pytest.approx(-2.0, abs=1e-12)  # r = y - y^2


def bad(problem, multiplier, products=None):
    pairs = np.zeros((0, 2), np.int64) if products is None else np.array(products)
    return evaluate(Identity(unscaled(problem), (multiplier,), pairs), problem)


def test_malformed_multipliers_are_refused_with_a_reason():
    x, y = sp.variables(2)
    problem = sp.Problem(x, [y >= 0, x * y == 0], lower=-1, upper=1)
    one = words(())
    good = squares(1, one, [[1.0]])
    cases = [
        (free(1, one, [-1.0]), None, "inequality"),
        (free(0, one, [-1.0]), None, "inequality"),
        (free(3, one, [-1.0]), None, "inequality"),
        (squares(9, one, [[1.0]]), None, "does not exist"),
        (squares(-1, one, [[1.0]]), None, "does not exist"),
        (good, [[1, 9]], "does not exist"),
        (good, [[-1, 0]], "does not exist"),
        (squares(1, one, [[np.nan]]), None, "not finite"),
        (squares(1, one, [[np.inf]]), None, "not finite"),
        (squares(1, words((3,)), [[1.0]]), None, "malformed"),
        (squares(1, words((-1,)), [[1.0]]), None, "malformed"),
        (squares(1, one, [[1.0]], floor=-1.0), None, "malformed"),
        (squares(1, one, [[1.0]], floor=np.nan), None, "malformed"),
    ]
    assert np.isfinite(bad(problem, good).bound)
    for multiplier, products, message in cases:
        evaluated = bad(problem, multiplier, products)
        assert evaluated.bound == -INF
        assert message in evaluated.reason
    # a product of an equality and an inequality is still no equality for a free multiplier
    assert bad(problem, free(9, one, [-1.0]), [[2, 1]]).bound == -INF


def test_huge_multipliers_give_no_number():
    (x,) = sp.variables(1)
    problem = sp.Problem(x, lower=-1, upper=1)
    with np.errstate(all="ignore"):
        evaluated = bad(problem, squares(0, words(()), [[1e200]]))
    assert evaluated.bound == -INF
    assert "overflow" in evaluated.reason


# ---- scaling ----------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(20))
def test_a_scaling_contains_its_own_box_and_no_larger_one(seed):
    rng = np.random.default_rng(seed)
    low = rng.normal(size=4) * 10.0 ** rng.integers(-6, 7, 4)
    high = low + np.abs(rng.normal(size=4)) * 10.0 ** rng.integers(-6, 7, 4)
    low[2], high[3] = -INF, low[3]
    box = Interval(low, high)
    scaling = Scaling.of_box(box)
    assert scaling.contains(box)
    for v in (0, 1):
        # exactly: centre -+ scale reaches the bounds
        centre, size = Fraction(scaling.centre[v]), Fraction(scaling.scale[v])
        assert centre - size <= Fraction(low[v])
        assert Fraction(high[v]) <= centre + size
        wider = high.copy()
        wider[v] += 1e-3 * (high[v] - low[v]) + 1e-9 * abs(high[v])
        assert not scaling.contains(Interval(low, wider))
        wider = high.copy()
        wider[v] = INF
        assert not scaling.contains(Interval(low, wider))
    moved = high.copy()
    moved[3] = np.nextafter(high[3], INF)
    assert not scaling.contains(Interval(low, moved))


def test_a_side_is_an_assumption_that_is_checked():
    scaling = Scaling.of_box(Interval(np.array([1.0]), np.array([INF])))
    assert scaling.contains(Interval(np.array([1.0]), np.array([INF])))
    assert scaling.contains(Interval(np.array([2.0]), np.array([3.0])))
    assert not scaling.contains(Interval(np.array([np.nextafter(1.0, 0.0)]), np.array([INF])))


@pytest.mark.parametrize("scale", [0.0, -1.0])
def test_a_degenerate_scale_of_an_unbounded_variable_is_refused(scale):
    """x = 0 + 0 t says x = 0, and x = -t with t >= 0 turns x >= 0 around."""
    box = Interval(np.array([0.0]), np.array([INF]))
    honest = Scaling.of_box(box)
    assert honest.contains(box)
    assert not replace(honest, scale=np.array([scale])).contains(box)


# ---- repair, margin ---------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 2, 4, 6])  # without the equality: all feasible
def test_repair_makes_the_residual_small_and_stays_near(seed):
    problem = small_problem(seed)
    scaled, relaxation = model(problem, 2)
    program = sp.assemble(relaxation, scaled.objectives[0])
    z = sp.solve_conic(program).z
    rough = z + 1e-5 * np.random.default_rng(seed).normal(size=z.size)
    before = np.abs(program.q + program.A.T @ rough).max()
    better = repaired(program, rough)
    assert np.abs(program.q + program.A.T @ better).max() <= 1e-6 * before
    assert np.abs(better - rough).max() <= 1.0

    def bound(multipliers):
        identity = identity_of(relaxation, scaled, multipliers, scaled.objective_sizes[0])
        return evaluate(identity, problem).bound

    assert bound(rough) < bound(better) <= bound(z) + 1e-4


def test_the_margin_is_the_sum_of_squares_of_the_bases():
    x, y = sp.variables(2)
    relaxation = sp.relax(sp.Problem(x**4 + y**4 + x * y), 2)
    kept = [w for g in relaxation.groups if not g.free for w in g.basis.reshape(-1, 2).tolist()]
    expected = sp.total([x * 0.0] + [np.prod([(1.0, x, y)[v] ** 2 for v in word]) for word in kept])
    difference = margin(relaxation) - expected
    assert difference.terms == 0
    assert margin(relaxation)(np.zeros(2)) == 1.0  # the monomial 1 is among them
