"""From a problem to a result: bounds, statuses, shared relaxations, options, old traps."""

from __future__ import annotations

import numpy as np
import pytest
from solved import INF, LAB_OPTIMUM, check, double_well_chain, region

import sparsepop_py as sp
from sparsepop_py import problems

# ---- the laboratory problem -------------------------------------------------------------------


@pytest.fixture(scope="module")
def laboratory():
    return {
        order: sp.solve(problems.laboratory(), sp.Options(order=order)) for order in range(1, 6)
    }


def test_the_optimum_of_the_laboratory_problem():
    """On the branch x1 > 7, x2 = 10 / (x1 - 7), by a fine grid; for x1 < 7 nothing is feasible."""
    left = np.linspace(-50, 7, 100001)[:-1]
    assert np.all(10 / (left - 7) + 0.5 * left < 1)
    x1 = np.linspace(7.5, 12, 2000001)
    x2 = 10 / (x1 - 7)
    f = x1**2 + x2**2 - 4 * x1 - 6 * x2 + 13
    best = int(np.argmin(f))
    assert f[best] == pytest.approx(LAB_OPTIMUM, abs=1e-9)
    assert (x1[best], x2[best]) == pytest.approx((8.8605284, 5.3748171), abs=1e-5)


@pytest.mark.parametrize("order", range(1, 6))
def test_laboratory_bounds(laboratory, order):
    result = check(problems.laboratory(), laboratory[order])
    low = 28.55 if order == 1 else 52.7064
    assert low <= result.lower_bound <= 52.7066065447
    assert 52.70660654 <= result.upper_bound <= 52.706607
    assert result.x == pytest.approx([8.8605284, 5.3748171], abs=1e-6)
    assert result.attained is not None
    if order > 1:
        assert result.status is sp.Status.OPTIMAL


def test_laboratory_bounds_do_not_fall_with_the_order(laboratory):
    bounds = [laboratory[order].lower_bound for order in range(1, 6)]
    assert all(b >= a - 1e-6 for a, b in zip(bounds, bounds[1:], strict=False))


# ---- no feasible point ------------------------------------------------------------------------

EMPTY = {
    "disc and hyperbola": "min x+y; s.t. 1-x^2-y^2>=0; x*y>=1; x+2>=0; 2-x>=0; y+2>=0; 2-y>=0",
    "just empty": "min x+y; s.t. 1-x^2-y^2>=0; x*y>=0.51; x+2>=0; 2-x>=0; y+2>=0; 2-y>=0",
    "negative square": "min x; s.t. x^2==-1",
    "linear": "min x+y; s.t. x+y>=3; x<=1; y<=1; x>=0; y>=0",
    "parallel": "min x; s.t. x-y>=1; y-x>=1; x>=-5; x<=5; y>=-5; y<=5",
    "parity": "min x; s.t. x^2==1; y^2==1; x+y==1",
    "chain": "min a; s.t. a>=1; b>=a; c>=b; d>=c; d<=0.5",
    "cube": "min x; s.t. x^3==8; x<=1",
}


@pytest.mark.parametrize("effort", ["presolve", "plain"])
@pytest.mark.parametrize(
    "name", [pytest.param("disc and hyperbola", marks=pytest.mark.slow), *list(EMPTY)[1:]]
)
def test_emptiness_is_proved(name, effort):
    problem = sp.parse(EMPTY[name])
    result = sp.solve(problem, sp.Options(order=2, effort=effort))
    boxed = np.isfinite(problem.lower).all() and np.isfinite(problem.upper).all()
    if effort == "plain" and not boxed:  # no box: a Farkas proof would need one
        assert result.status in (sp.Status.INFEASIBLE, sp.Status.UNPROVED, sp.Status.FAILED)
        assert result.upper_bound == INF
        return
    assert result.status is sp.Status.INFEASIBLE
    assert result.lower_bound == result.upper_bound == INF
    assert result.gap == 0.0
    assert result.attained is None
    assert result.certificate.bound == INF
    assert result.certificate.cutoff is None
    verdict = result.certificate.verify(problem)
    assert verdict.ok
    assert verdict.bound == INF


def test_both_arguments_of_emptiness_occur():
    by_boxes = sp.solve(sp.parse(EMPTY["cube"])).certificate
    assert by_boxes.identity is None
    by_farkas = sp.solve(sp.parse(EMPTY["just empty"])).certificate
    assert by_farkas.identity is not None


def test_a_set_of_one_point_is_not_empty():
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, [x**2 + y**2 <= 0.5, x * y >= 0.25], lower=-2, upper=2)
    result = check(problem, sp.solve(problem), -1.0)  # (1/2, 1/2) and (-1/2, -1/2)
    assert result.status is not sp.Status.INFEASIBLE


# ---- no bounds on the variables ---------------------------------------------------------------


def expanded(problem):
    """The same objective with nothing known of its squares."""
    return sp.Problem(problem.objective, problem.constraints, problem.lower, problem.upper)


UNBOUNDED_SETS = {
    "quartic chain": (lambda: double_well_chain(5), 2, 0.0),
    "broyden tridiagonal": (lambda: expanded(problems.broyden_tridiagonal(4)), 2, 0.0),
    "six-hump camel": (
        lambda: sp.parse("min 4*x1^2-2.1*x1^4+(1/3)*x1^6+x1*x2-4*x2^2+4*x2^4"),
        3,
        -1.031628453489877,
    ),
    "himmelblau": (
        lambda: expanded(sp.parse("min (x1^2+x2-11)^2+(x1+x2^2-7)^2")),
        2,
        0.0,
    ),
    "wood": (
        lambda: expanded(
            sp.parse(
                "min 100*(x2-x1^2)^2+(1-x1)^2+90*(x4-x3^2)^2+(1-x3)^2"
                "+10.1*((x2-1)^2+(x4-1)^2)+19.8*(x2-1)*(x4-1)"
            )
        ),
        2,
        0.0,
    ),
    "quartic with margin": (
        lambda: sp.parse("min 1+x1^4+x2^4+x3^4+x1^2*x2^2+x1^2*x3^2+x2^2*x3^2+x2*x3"),
        2,
        11 / 12,
    ),
}


@pytest.mark.parametrize("name", UNBOUNDED_SETS)
def test_bounds_are_proved_without_a_box(name):
    make, order, optimum = UNBOUNDED_SETS[name]
    problem = make()
    assert not problem.squares
    assert not np.isfinite(problem.lower).any()
    result = sp.solve(problem, sp.Options(order=order))
    check(problem, result, optimum)
    assert result.upper_bound <= optimum + 1e-5


@pytest.mark.parametrize("name", ["broyden", "wood", "himmelblau"])
def test_squares_bound_what_expansion_hides(name):
    problem = {
        "broyden": lambda: problems.broyden_tridiagonal(6),
        "wood": lambda: problems.chained_wood(8),
        "himmelblau": lambda: sp.parse("min (x1^2+x2-11)^2+(x1+x2^2-7)^2"),
    }[name]()
    optimum = 1.0 if name == "wood" else 0.0
    result = check(problem, sp.solve(problem), optimum, tight=0.0)
    assert result.status is sp.Status.OPTIMAL
    assert result.lower_bound == optimum  # the constant of the squares, exactly


@pytest.mark.parametrize(
    "refine",
    ["none", pytest.param("scipy", marks=pytest.mark.slow)],  # a long flat valley
)
def test_an_infimum_that_is_not_attained(refine):
    """x^2 + (1 - x y)^2 > 0 has the infimum 0, at y -> inf.

    In (x, u), u = x y, it is strictly convex, so a margin is there to be found; without it
    the answer has to be -inf and the name of what is missing.
    """
    x, y = sp.variables(2, ["x", "y"])
    problem = sp.Problem(x**2 + (1 - x * y) ** 2)
    options = sp.Options(refine=refine)
    result = check(problem, sp.solve(problem, options))
    assert result.upper_bound > 0
    if result.status is sp.Status.UNPROVED:
        assert result.lower_bound == -INF
        assert result.certificate is None
        note = next(note for note in result.notes if "finite bounds" in note)
        assert note.rstrip(".").split("for ")[-1].split(", ")[-1] == "y"
        assert note in result.summary()
    else:
        assert -1e-5 <= result.lower_bound <= 0.0
    known = sp.Problem(x**2 + (1 - x * y) ** 2, squares=[x, 1 - x * y])
    assert check(known, sp.solve(known, options)).lower_bound == 0.0


def test_what_is_missing_is_named():
    """Motzkin's polynomial plus any constant is no sum of squares; two variables have no box."""
    u, v, w = sp.variables(3, ["u", "v", "w"])
    motzkin = u**4 * v**2 + u**2 * v**4 - 3 * u**2 * v**2
    problem = sp.Problem(motzkin + w, lower=[-INF, -INF, 0], upper=[INF, INF, 1])
    result = sp.solve(problem, sp.Options(order=3, effort="plain"))
    assert result.status is sp.Status.UNPROVED
    assert result.lower_bound == -INF
    assert result.certificate is None
    note = next(note for note in result.notes if "finite bounds" in note)
    assert note.endswith("no finite bounds are known for u, v")
    assert "lower and upper bounds" in result.message
    assert note in result.summary()


@pytest.mark.parametrize("order", [3, 4])
@pytest.mark.parametrize("effort", ["plain", "presolve"])
def test_motzkin_without_bounds_never_gets_a_number_above_zero(order, effort):
    problem = problems.motzkin()
    result = sp.solve(problem, sp.Options(order=order, effort=effort))
    assert result.lower_bound <= 0.0
    assert 0.0 <= result.upper_bound <= 1e-9
    check(problem, result)


# ---- traps of the original --------------------------------------------------------------------

SQUARES = {
    "cube of a root": ("min x^3; s.t. x^2==4; x>=-5; x<=5", -8.0),
    "cube, no bounds": ("min x^3; s.t. x^2==4", -8.0),
    "square equals multiple": ("min -x^2; s.t. x^2==3*x; x>=0; x<=10", -9.0),
    "two of them": ("min x^2*y; s.t. x^2==4; y^2==1", -4.0),
    "ordinary binary": ("min x^3-2*x*y; s.t. x^2==x; y^2==y", -1.0),
    "minus one to one": ("min x*y+x; s.t. x^2==1; y^2==1", -2.0),
}


@pytest.mark.parametrize("name", SQUARES)
def test_square_equations_keep_their_coefficients(name):
    text, optimum = SQUARES[name]
    problem = sp.parse(text)
    result = check(problem, sp.solve(problem), optimum)
    assert result.status is sp.Status.OPTIMAL
    assert result.upper_bound == pytest.approx(optimum, abs=1e-9)
    plain = sp.solve(problem, sp.Options(effort="plain", order=2))
    assert plain.lower_bound <= optimum


@pytest.mark.parametrize("effort", ["plain", "presolve"])
def test_points_that_are_fixed_altogether(effort):
    x, y = sp.variables(2)
    for low, rows, status in [
        ([3.0, 3.0], [x + y >= 6], sp.Status.OPTIMAL),
        ([3.0, 3.0], [x + y >= 7], sp.Status.INFEASIBLE),
        ([3.0, 3.0], [x + y >= 6.0 + 2**-40], sp.Status.INFEASIBLE),
        ([0.1, 0.2], [x + y == 0.25], sp.Status.INFEASIBLE),
        ([0.5, 0.25], [x * y == 0.125], sp.Status.OPTIMAL),
    ]:
        problem = sp.Problem(x + y, rows, low, low)
        result = sp.solve(problem, sp.Options(effort=effort))
        assert result.status is status
        if status is sp.Status.INFEASIBLE:
            assert result.lower_bound == result.upper_bound == INF
            assert result.certificate.verify(problem).ok
        else:
            check(problem, result, sum(low), tight=1e-12)


@pytest.mark.parametrize("effort", ["plain", "presolve"])
def test_a_fixed_point_that_fails_by_one_bit_is_never_attained(effort):
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, [x + y >= np.nextafter(6.0, 7.0)], lower=3, upper=3)
    result = sp.solve(problem, sp.Options(effort=effort))
    assert result.attained is None
    assert result.upper_bound == INF
    assert result.status in (sp.Status.INFEASIBLE, sp.Status.BOUNDED)


def test_tiny_coefficients_are_kept():
    x, y = sp.variables(2)
    problem = sp.Problem(x + 1e-12 * y, lower=-1, upper=1)
    result = check(problem, sp.solve(problem, sp.Options(gap=0.0)), -1.0 - 1e-12, tight=1e-14)
    assert result.lower_bound < -1.0
    only = sp.Problem(1e-14 * x, lower=-1, upper=1)
    result = check(only, sp.solve(only, sp.Options(gap=0.0)), -1e-14)
    assert -1.001e-14 <= result.lower_bound <= -1e-14 <= result.upper_bound
    # 1e-9 x >= 1 means x >= 1e9: with x <= 2 nothing is feasible
    empty = sp.Problem(y, [1e-9 * x >= 1], lower=0, upper=2)
    assert sp.solve(empty).status is sp.Status.INFEASIBLE
    # and 1e-9 x^2 y <= 1e-9 is a constraint: x y <= sqrt(y) <= sqrt(2)
    row = sp.Problem(-x * y, [1e-9 * x**2 * y <= 1e-9], lower=0, upper=2)
    check(row, sp.solve(row, sp.Options(order=3)), -np.sqrt(2.0))


def test_unused_variables_do_no_harm():
    x = sp.variables(5)
    problem = sp.Problem(x[1] ** 2 - x[1], [x[3] >= -1])
    check(problem, sp.solve(problem), -0.25)


def test_a_constant_objective():
    x, y = sp.variables(2)
    problem = sp.Problem(0.0 * x + 3.5, [x + y == 1], lower=0, upper=1)
    result = check(problem, sp.solve(problem), 3.5, tight=1e-12)
    assert result.status is sp.Status.OPTIMAL


# ---- many objectives over one set -------------------------------------------------------------


def test_objectives_share_one_relaxation():
    problem, objectives = region()
    together = sp.solve_each(problem, objectives, sp.Options(order=2))
    assert len(together) == len(objectives)
    assert len({id(result.relaxation) for result in together}) == 1
    for objective, result in zip(objectives, together, strict=True):
        single = problem.with_objective(objective)
        check(single, result)
        alone = sp.solve(single, sp.Options(order=2))
        for a, b in ((result, alone), (alone, result)):
            assert a.lower_bound <= b.upper_bound
        assert result.lower_bound == pytest.approx(alone.lower_bound, abs=2e-6)
        # nothing of one objective's cutoff is in the box that all share
        assert result.certificate.cutoff is None
        assert not result.certificate.box.uses_cutoff
        assert result.problem.fingerprint == single.fingerprint
    grid = np.linspace(-1, 1, 201)
    a, b = (axis.ravel() for axis in np.meshgrid(grid, grid))
    inside = (a**2 + b**2 <= 1) & (a + b >= -0.5) & (a * b <= 0.25)
    points = np.stack([a[inside], b[inside]], axis=1)
    for objective, result in zip(objectives, together, strict=True):
        values = [objective(p) for p in points]
        assert result.lower_bound <= min(values)
        assert min(values) - 0.05 <= result.lower_bound


def test_a_shared_certificate_speaks_of_its_own_objective_only():
    problem, objectives = region()
    first, second, *_ = sp.solve_each(problem, objectives)
    assert not first.certificate.verify(second.problem).ok
    assert first.certificate.verify(first.problem).ok


def test_objectives_without_a_common_box_get_their_own():
    x, y = sp.variables(2)
    problem = sp.Problem(x, [x - y >= 0], lower=0)
    low, falls, bowl = sp.solve_each(problem, [x, -x, x**2 - x])
    check(low.problem, low, 0.0)
    check(bowl.problem, bowl, -0.25)
    assert falls.status is sp.Status.UNBOUNDED
    assert falls.lower_bound == -INF


@pytest.mark.slow
def test_an_empty_set_is_empty_for_every_objective():
    problem = sp.parse(EMPTY["just empty"])
    x, y = sp.variables(2)
    for result in sp.solve_each(problem, [x, -x, x * y]):
        assert result.status is sp.Status.INFEASIBLE
        assert result.certificate.verify(result.problem).ok


def test_wrong_objectives_are_named():
    problem, _ = region()
    x, _ = sp.variables(2)
    assert sp.solve_each(problem, []) == []
    for wrong in (3, "x", sp.variables(3)[0], x >= 0):
        with pytest.raises(sp.ProblemError, match=r"objectives\[1\]"):
            sp.solve_each(problem, [x, wrong])


@pytest.mark.parametrize("size", [1e15, pytest.param(2.0**54, marks=pytest.mark.slow)])
def test_a_corner_of_a_huge_box_is_attained(size):
    """x + y on [0, size]^2: the least value is 0, and the search ends."""
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, [], 0.0, size)
    result = check(problem, sp.solve(problem, sp.Options(time_limit=60.0)), 0.0)
    assert result.status is sp.Status.OPTIMAL
    assert result.upper_bound == 0.0


def test_no_summary_calls_minus_infinity_proved() -> None:
    """On x1 x2 = 1 the variable x2 has no bounds, so that this order proves nothing."""
    x1, x2 = sp.variables(2)
    rows = [x1**2 <= 1, x1 * x2 == 1]
    unbounded = sp.solve(sp.Problem(x1**2 * x2, rows))
    assert unbounded.lower_bound == -INF
    assert "lower bound   -inf  nothing proved" in unbounded.summary()
    bounded = sp.solve(sp.Problem(x1**2 * x2, rows, lower=-10, upper=10))
    assert "nothing proved" not in bounded.summary()
