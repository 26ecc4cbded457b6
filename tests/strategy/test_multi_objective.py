"""Many objectives over one feasible set: bounds, statuses, and what one proves for another."""

from __future__ import annotations

import itertools
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from random_cases import on_grid, random_case
from slow_values import slow_after
from solved import INF, check, region

import sparsepop_py as sp
from sparsepop_py import Options, Problem, ProblemError, Status
from sparsepop_py.local_search.feasibility import prove_feasible
from sparsepop_py.local_search.multistart import best_attained
from sparsepop_py.strategy.multi_objective import MultiObjectiveSearch

AUTO = Options(effort="auto")
WIDTH = Options(effort="auto", gap=1e-3, gap_kind="width")


def grid(problem, steps):
    """Points of a grid over the box that satisfy the inequalities, and the objective's rows."""
    axes = [np.linspace(a, b, steps) for a, b in zip(problem.lower, problem.upper, strict=True)]
    points = np.array(list(itertools.product(*axes)))
    inside = np.ones(points.shape[0], bool)
    for c in problem.constraints:
        inside &= on_grid(c.polynomial, points) >= 0
    return points[inside]


def both_signs(x):
    return [side * v for v in x for side in (1.0, -1.0)]


def verified(problem, objectives, results):
    """Every certificate, alone and with a memory that all share."""
    shared = {}
    for objective, result in zip(objectives, results, strict=True):
        own = problem.with_objective(objective)
        check(own, result)
        if result.certificate is not None:
            alone = result.certificate.verify(own)
            assert result.certificate.verify(own, shared) == alone
    return results


@pytest.mark.parametrize("gap_kind", slow_after(2, ["width", "relative", "absolute"]))
def test_the_disc(gap_kind):
    x = sp.variables(2)
    disc = Problem(x[0], [x[0] ** 2 + x[1] ** 2 <= 1])
    objectives = [*both_signs(x), x[0] + x[1], -x[0] - x[1]]
    options = Options(effort="auto", gap_kind=gap_kind)
    results = verified(disc, objectives, sp.solve_each(disc, objectives, options))
    for result, least in zip(results, [-1.0] * 4 + [-np.sqrt(2)] * 2, strict=True):
        assert result.status is Status.OPTIMAL
        assert result.lower_bound <= least + 1e-12
        assert result.upper_bound >= least - 1e-12
        assert result.gap <= 3e-6


def test_objectives_that_are_no_coordinates_against_a_grid():
    problem, objectives = region()
    objectives = [*objectives, -objectives[4], -objectives[5], objectives[0] ** 4 - objectives[2]]
    boxed = Problem(problem.objective, problem.constraints, -1, 1)
    points = grid(boxed, 81)
    results = verified(boxed, objectives, sp.solve_each(boxed, objectives, AUTO))
    for objective, result in zip(objectives, results, strict=True):
        values = on_grid(objective, points)
        assert result.status is Status.OPTIMAL
        assert result.lower_bound <= values.min()
        assert result.upper_bound >= values.min() - 0.1  # a grid this fine comes as near


def identification(seed, samples=4):
    """y_k = (a + b e) u_k with errors, written with products of few parameters and many errors."""
    rng = np.random.default_rng(seed)
    theta, reach = rng.uniform(0.3, 0.9, 2), 0.1
    u = rng.uniform(-2, 2, samples + 1)
    y, e = np.zeros(samples + 1), rng.uniform(-reach, reach, samples + 1)
    for k in range(1, samples + 1):
        y[k] = theta[0] * y[k - 1] + theta[1] * u[k - 1]
    z = y + e
    x = sp.variables(2 + samples + 1)
    rows = [
        z[k] - x[2 + k] == x[0] * (z[k - 1] - x[1 + k]) + x[1] * u[k - 1]
        for k in range(1, samples + 1)
    ]
    low = np.append([0.0, 0.0], np.full(samples + 1, -reach))
    problem = Problem(x[0], rows, low, np.append([2.0, 2.0], np.full(samples + 1, reach)))
    return problem, x, z, u, reach, theta


def consistent(problem, z, u, reach, point):
    """Whether parameters explain the data: the errors follow one another from the first."""
    first = np.linspace(-reach, reach, 4001)
    e, fits = first, np.ones(first.size, bool)
    for k in range(1, z.size):
        e = z[k] - point[0] * (z[k - 1] - e) - point[1] * u[k - 1]
        fits &= np.abs(e) <= reach
    return fits.any()


@pytest.mark.parametrize("seed", [0, 1])
def test_intervals_of_parameters_contain_all_that_explain_the_data(seed):
    problem, x, z, u, reach, theta = identification(seed)
    objectives = both_signs(x[:2])
    results = verified(problem, objectives, sp.solve_each(problem, objectives, WIDTH))
    low, high = results[0].lower_bound, -results[1].lower_bound
    assert low <= theta[0] <= high
    axis = np.linspace(0.0, 2.0, 81)
    found = [p for p in itertools.product(axis, axis) if consistent(problem, z, u, reach, p)]
    found = np.array([*found, theta])
    for v in range(2):
        lower, upper = results[2 * v], results[2 * v + 1]
        assert lower.lower_bound <= found[:, v].min()
        assert -upper.lower_bound >= found[:, v].max()
        assert lower.upper_bound <= found[:, v].min() + 1e-3
        width = -upper.upper_bound - lower.upper_bound
        for result in (lower, upper):
            assert result.status is Status.OPTIMAL
            assert result.gap <= 1e-3 * width * (1 + 1e-9)


@pytest.mark.parametrize("seed", slow_after(5, range(12)))
def test_random_sets_of_any_degree_against_their_grids(seed):
    case = random_case(seed)
    problem, x = case.problem, sp.variables(case.problem.dimension)
    objectives = [*both_signs(x), problem.objective, -problem.objective]
    options = Options(effort="auto", time_limit=5.0)
    for objective, result in zip(
        objectives,
        verified(problem, objectives, sp.solve_each(problem, objectives, options)),
        strict=True,
    ):
        assert result.lower_bound <= on_grid(objective, case.points).min()
        assert result.status in (Status.OPTIMAL, Status.LIMIT, Status.BOUNDED)


def test_degree_four_set():
    # x^4 + y^4 <= 1: |x| + |y| <= 2^(3/4)
    x, y = sp.variables(2)
    ball = Problem(x, [x**4 + y**4 <= 1])
    objectives = [x, -x, x + y, -x - y]
    results = verified(ball, objectives, sp.solve_each(ball, objectives, WIDTH))
    for result, least in zip(results, [-1.0, -1.0, -(2**0.75), -(2**0.75)], strict=True):
        assert result.status is Status.OPTIMAL
        assert least - 4e-3 <= result.lower_bound <= least + 1e-12


def test_a_box_alone():
    x = sp.variables(2)
    box = Problem(x[0] * x[1], lower=[-1.0, 0.0], upper=[2.0, 3.0])
    objectives = [*both_signs(x), x[0] * x[1], -x[0] * x[1]]
    results = verified(box, objectives, sp.solve_each(box, objectives, AUTO))
    for result, least in zip(results, [-1.0, -2.0, 0.0, -3.0, -3.0, -6.0], strict=True):
        assert result.status is Status.OPTIMAL
        assert result.lower_bound <= least <= result.upper_bound + 1e-12
        assert result.gap <= 1e-5


def test_a_variable_that_occurs_nowhere():
    x, y, z = sp.variables(3)
    problem = Problem(x, [x * y == 1], lower=[0.5, 0.5, -1.0], upper=[4.0, 1.0, 5.0])
    objectives = both_signs((x, z))
    results = verified(problem, objectives, sp.solve_each(problem, objectives, AUTO))
    for result, least in zip(results, [1.0, -2.0, -1.0, -5.0], strict=True):
        assert result.status is Status.OPTIMAL
        assert result.lower_bound == pytest.approx(least, abs=1e-5)


def test_fixed_variables():
    x, y = sp.variables(2)
    problem = Problem(x, [x * y <= 1, x**2 >= 0.25], lower=[0.0, 2.0], upper=[1.0, 2.0])
    objectives = both_signs((x, y))
    results = verified(problem, objectives, sp.solve_each(problem, objectives, AUTO))
    for result, value in zip(results, [0.5, -0.5, 2.0, -2.0], strict=True):
        assert result.status is Status.OPTIMAL
        assert result.lower_bound <= value <= result.upper_bound
        assert result.lower_bound == pytest.approx(value, abs=1e-6)


def test_duplicates_get_the_same_bounds():
    x, y = sp.variables(2)
    problem = Problem(x, [x**2 + x * y + y**2 <= 1], -2, 2)
    objectives = [x, -x, x, -x, 1.0 * x]
    results = verified(problem, objectives, sp.solve_each(problem, objectives, WIDTH))
    for result in results:  # x^2 + x y + y^2 <= 1: |x| <= 2 / sqrt 3
        assert result.status is Status.OPTIMAL
        assert -2 / np.sqrt(3) - 3e-3 <= result.lower_bound <= -2 / np.sqrt(3) + 1e-12


def test_no_objectives():
    x, y = sp.variables(2)
    problem = Problem(x, [x * y >= 1], 0, 2)
    assert sp.solve_each(problem, [], AUTO) == []
    assert sp.solve_each(problem, [], WIDTH) == []


@pytest.mark.parametrize("count", [1, 3])
def test_width_without_the_negative(count):
    x = sp.variables(2)
    problem = Problem(x[0], [x[0] * x[1] >= 1], 0, 2)
    for effort in ("auto", "presolve"):
        options = Options(effort=effort, gap_kind="width")
        with pytest.raises(ProblemError, match=r"Options\.gap_kind"):
            sp.solve_each(problem, [x[0], -x[0], x[1]][-count:], options)


def test_width_of_one_objective_alone_is_refused():
    x, y = sp.variables(2)
    problem = Problem(x, [x * y >= 1], 0, 2)
    with pytest.raises(ProblemError, match=r"Options\.gap_kind"):
        sp.solve_each(problem, [x], WIDTH)


@pytest.mark.parametrize("options", [AUTO, WIDTH])
@pytest.mark.parametrize(
    "rows",
    [
        lambda x, y: [x + y >= 5],
        lambda x, y: [x * y >= 1, x**2 + y**2 <= 1.5],
        lambda x, y: [x**2 + y**2 == 1, x**2 + 2 * y**2 >= 2.1],
    ],
)
def test_empty_sets(rows, options):
    x, y = sp.variables(2)
    problem = Problem(x, rows(x, y), -2, 2)
    objectives = [x, -x, x * y, -x * y]
    results = verified(problem, objectives, sp.solve_each(problem, objectives, options))
    for result in results:
        assert result.status is Status.INFEASIBLE
        assert result.lower_bound == INF


def test_an_unbounded_set():
    x, y = sp.variables(2)
    problem = Problem(x, [x * y >= 1], lower=0)
    objectives = [x, -x, x + y, -x - y]
    results = sp.solve_each(problem, objectives, AUTO)
    verified(problem, objectives, results)
    assert results[2].lower_bound == pytest.approx(2.0, abs=1e-4)
    for result in (results[1], results[3]):
        assert result.status is Status.UNBOUNDED
        assert result.lower_bound == -INF


def test_progress_is_reported_and_bounds_only_improve():
    problem, x, *_ = identification(2)
    reports = {}

    def hear(number, lower, upper):
        reports.setdefault(number, []).append((lower, upper))

    results = sp.solve_each(problem, both_signs(x[:2]), WIDTH, on_progress=hear)
    assert reports
    for number, values in reports.items():
        result = results[number]
        lower, upper = np.array(values).T
        assert np.all(np.diff(lower) >= 0)
        assert np.all(upper[1:] <= upper[:-1])
        assert lower[-1] <= result.lower_bound
        assert upper[-1] >= result.upper_bound


def test_a_certificate_of_one_objective_does_not_serve_another():
    problem, x, *_ = identification(0)
    objectives = both_signs(x[:2])
    results = sp.solve_each(problem, objectives, WIDTH)
    other = problem.with_objective(objectives[1])
    assert not results[0].certificate.verify(other).ok
    smaller = Problem(x[0], problem.constraints, problem.lower, problem.upper - 1e-9)
    assert not results[0].certificate.verify(smaller).ok


@pytest.mark.parametrize("effort", ["plain", "presolve", "auto"])
def test_the_objective_of_the_problem_itself_is_ignored(effort):
    x = sp.variables(5)
    rows = [x[i] * x[i + 1] <= 0.5 for i in range(4)]
    coupled = sp.Problem(sp.total(x) ** 6, rows, -1, 1)  # joins all variables, to degree 6
    plain = sp.Problem(0.0 * x[0], rows, -1, 1)
    objectives = both_signs(x[:1])
    options = sp.Options(effort=effort, node_limit=0)
    for one, other in zip(
        *(sp.solve_each(p, objectives, options) for p in (coupled, plain)), strict=True
    ):
        assert one.lower_bound == other.lower_bound
        assert one.problem.fingerprint == other.problem.fingerprint
        assert [(r.name, r.moments) for r in one.history] == [
            (r.name, r.moments) for r in other.history
        ]
        if effort != "auto":
            assert one.relaxation.order == other.relaxation.order == 1
            assert one.relaxation.block_sizes == other.relaxation.block_sizes


@pytest.mark.parametrize("effort", ["presolve", "auto"])
@pytest.mark.slow
def test_what_is_repaired_is_searched_from_once(effort, monkeypatch):
    searched, repaired = [], []

    def best(problem, starts, *rest):
        searched.append([tuple(x) for x in starts])
        return best_attained(problem, starts, *rest)

    def repair(x):
        repaired.append(tuple(x))
        return x

    monkeypatch.setattr("sparsepop_py.local_search.incumbents.best_attained", best)
    x, y = sp.variables(2)
    unbounded = {"presolve": np.inf, "auto": 1.0}[effort]
    problem = sp.Problem(x, [x * y >= 0.25, x + y <= 1], [0, -unbounded], unbounded)
    options = sp.Options(effort=effort)
    sp.solve_each(problem, both_signs([x]), options, start=[0.5, 0.5], repair=repair)
    assert (0.5, 0.5) in repaired
    assert set(repaired) == {start for starts in searched for start in starts}
    for starts in searched:
        assert len(set(starts)) == len(starts)


@pytest.mark.parametrize(
    ("left", "steps", "tightens"),
    [(30.0, 1, True), (3.0, 1, False), (3.0, 2, True), (0.9, 1, False), (0.9, 2, False)],
)
def test_a_gap_that_is_nearly_closed_does_not_yet_ask_for_a_tighter_box(
    left, steps, tightens, monkeypatch
):
    """What other objectives prove may close it."""
    asked = []
    for name in ("_share_points", "_quote"):
        monkeypatch.setattr(MultiObjectiveSearch, name, lambda *_: None)
    monkeypatch.setattr(MultiObjectiveSearch, "_tighten", lambda *_: asked.append(1))
    search = MultiObjectiveSearch(*(cast(Any, None),) * 7)
    context = SimpleNamespace(best=None, report=lambda bound: None)
    adaptive = SimpleNamespace(
        gap_ratio=left, over=left < 1.0, history=[1] * steps, context=context
    )
    adaptive.bound = 0.0
    search.searches = cast(Any, [adaptive])
    search._share(0)
    assert bool(asked) is tightens


def test_of_known_points_the_first_is_proved_again_however_little_time_there_is(monkeypatch):
    x, y = sp.variables(2)
    problem = sp.Problem(x, [x * y >= 0.25, x + y <= 2], 0.0, 2.0)
    points = [prove_feasible(problem, np.array(p)) for p in ((0.5, 0.5), (1.0, 0.5), (0.5, 1.0))]
    proofs, own = [], sp.ProvedPoint.recheck
    monkeypatch.setattr(
        sp.ProvedPoint, "recheck", lambda self, about: proofs.append(1) or own(self, about)
    )
    late = sp.Options(effort="auto", time_limit=1e-9)
    sp.solve_each(problem, [x], late, points=points)
    assert len(proofs) == 1
    sp.solve_each(problem, [x], replace(late, time_limit=60.0), points=points)
    assert len(proofs) >= 4
