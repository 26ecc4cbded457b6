"""Feasible sets that are products of others: bounds of the parts hold for the whole."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.local_search.feasibility import prove_feasible
from sparsepop_py.strategy import independent_parts as module
from sparsepop_py.strategy.independent_parts import independent_parts
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.steps import Known

AUTO = sp.Options(effort="auto", gap=1e-6)
WIDTH = sp.Options(effort="auto", gap=1e-4, gap_kind="width")


def parts_of(problem: sp.Problem, objectives: list[sp.Polynomial]) -> list[list[int]]:
    box = Interval(problem.lower, problem.upper)
    return [part.numbers for part in independent_parts(problem, objectives, box)]


def ring_and_hyperbola() -> tuple[sp.Problem, list[sp.Polynomial], list[float]]:
    """x^2 + y^2 = 2 with x y >= 1/2; u v >= 1 on [0, 4]^2. Least values by hand."""
    x, u, y, v = sp.variables(4, ["x", "u", "y", "v"])
    rows = [x**2 + y**2 == 2, x * y >= 0.5, u * v >= 1]
    problem = sp.Problem(x, rows, [0, 0, 0, 0], [2, 4, 2, 4])
    far = np.sqrt(1 + np.sqrt(0.75))  # x^2 + 1 / (4 x^2) = 2
    near = np.sqrt(1 - np.sqrt(0.75))
    return problem, [x, -x, u, -u, u + v, x + y], [near, -far, 0.25, -4.0, 2.0, near + far]


def test_a_problem_is_split_where_no_constraint_joins_it():
    problem, objectives, _ = ring_and_hyperbola()
    assert parts_of(problem, objectives) == [[0, 1, 5], [2, 3, 4]]
    x, u = objectives[0], objectives[2]
    assert parts_of(problem, [x, x + u]) == []  # over both parts
    assert parts_of(problem, [x, -x]) == []  # the other part decides whether it is feasible
    joined = sp.Problem(x, [*problem.constraints, x + u <= 5], problem.lower, problem.upper)
    assert parts_of(joined, objectives) == []


@pytest.mark.parametrize("options", [AUTO, WIDTH], ids=["absolute", "width"])
def test_bounds_of_parts_are_proved_of_the_whole(options):
    problem, objectives, wanted = ring_and_hyperbola()
    if options is WIDTH:
        pairs = zip(objectives[:4], wanted[:4], strict=True)
        objectives, wanted = map(list, zip(*pairs, strict=True))
    seen: dict[int, float] = {}
    found = sp.solve_each(
        problem, objectives, options, on_progress=lambda n, low, _: seen.update({n: low})
    )
    assert sorted(seen) == list(range(len(objectives)))
    for number, (result, value) in enumerate(zip(found, wanted, strict=True)):
        assert result.status is sp.Status.OPTIMAL
        assert result.lower_bound <= value <= result.upper_bound + 1e-12
        assert result.upper_bound - result.lower_bound < 5e-4
        assert result.certificate.verify(problem.with_objective(objectives[number])).ok
        assert problem.violation(result.attained.x) < 1e-8
        assert seen[number] == pytest.approx(result.lower_bound, abs=1e-6)
        again = sp.from_json(sp.to_json(result))
        assert again.lower_bound == result.lower_bound


def test_a_part_without_a_feasible_point_is_said_to_have_none():
    x, y, u, v = sp.variables(4)
    rows = [x * y >= 1, (u - v) ** 2 <= 0.01, u + v == 2, u * v <= 0.9]
    problem = sp.Problem(x, rows, 0, 4)
    found = sp.solve_each(problem, [x, u, -u], AUTO)
    assert [r.status for r in found[1:]] == [sp.Status.INFEASIBLE] * 2
    assert found[0].lower_bound == pytest.approx(0.25, abs=1e-5)
    assert found[0].attained is None  # there is no point of the whole


def steps_of(result: sp.Result) -> list[type]:
    return [type(step) for node in result.certificate.root for step in node.box.steps]


def test_bounds_that_others_of_a_part_prove_are_quoted_in_it():
    """Known steps name variables of the whole, and their certificates verify there."""
    rng, theta = np.random.default_rng(3), sp.variables(2 + 2 * 14)
    rows, lower, upper = [], [-4.0, -4.0], [4.0, 4.0]
    for part in range(2):
        a, e = theta[part], theta[2 + 14 * part : 16 + 14 * part]
        y = rng.uniform(-0.1, 0.1, 14) + 0.5 ** np.arange(14)
        rows += [(y[k + 1] - e[k + 1]) - a * (y[k] - e[k]) == 0 for k in range(13)]
        lower, upper = [*lower, *[-0.1] * 14], [*upper, *[0.1] * 14]
    problem = sp.Problem(theta[0], rows, lower, upper)
    asked = [sign * theta[k] for k in (1, 0) for sign in (1.0, -1.0)]
    assert parts_of(problem, asked) == [[0, 1], [2, 3]]
    found = sp.solve_each(problem, asked, sp.Options(effort="auto", gap=1e-7, gap_kind="width"))
    alone = [sp.solve(problem.with_objective(each), AUTO) for each in asked]
    for one, other in zip(found, alone, strict=True):
        assert one.status is sp.Status.OPTIMAL
        assert one.lower_bound == pytest.approx(other.lower_bound, abs=2e-6)
    assert any(Known in steps_of(result) for result in found)


def test_starts_repairs_points_and_branching_are_those_of_the_part():
    problem, objectives, wanted = ring_and_hyperbola()
    seen = []

    def repair(z):
        seen.append(z.shape)
        return z

    start = np.array([1.0, 2.0, 1.0, 2.0])
    point = prove_feasible(problem, start)
    found = sp.solve_each(
        problem, objectives, AUTO, start=start, repair=repair, points=[point], branch_on=[0, 1]
    )
    assert set(seen) == {(4,)}
    for result, value in zip(found, wanted, strict=True):
        assert result.lower_bound == pytest.approx(value, abs=1e-5)


def test_workers_bound_parts_as_one_process_does():
    problem, objectives, wanted = ring_and_hyperbola()
    with ProcessPoolExecutor(2) as executor:
        found = sp.solve_each(problem, objectives, AUTO, executor=executor)
    for result, value in zip(found, wanted, strict=True):
        assert result.status is sp.Status.OPTIMAL
        assert result.lower_bound == pytest.approx(value, abs=1e-5)


def test_time_that_one_part_used_up_is_said(monkeypatch):
    """Each part has its share; of one whose time ended before any search results are LIMIT."""
    problem, objectives, wanted = ring_and_hyperbola()
    ends, run = [], module.MultiObjectiveSearch.run

    def late(self):
        ends.append(self.deadline.wall_end)
        if len(ends) == 1:
            monkeypatch.setattr(self.deadline, "_ends", lambda *_: (0.0, 0.0))
        return run(self)

    monkeypatch.setattr(module.MultiObjectiveSearch, "run", late)
    options = sp.Options(effort="auto", gap=1e-6, time_limit=60.0)
    found = sp.solve_each(problem, objectives, options)
    assert ends[1] - ends[0] > 20.0
    for number, (result, value) in enumerate(zip(found, wanted, strict=True)):
        assert result.lower_bound <= value
        if number in (0, 1, 5):  # of the part without time
            assert result.status is sp.Status.LIMIT
        else:
            assert result.lower_bound >= value - 1e-5
