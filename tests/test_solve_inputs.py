"""Starting points, options and inputs of solve: what is accepted, named and left alone."""

from __future__ import annotations

import pickle
from dataclasses import fields, replace

import numpy as np
import pytest
from solved import INF, LAB_OPTIMUM, check, double_well_chain, region

import sparsepop_py as sp
from sparsepop_py import problems
from sparsepop_py.bounding import relaxation_bound
from sparsepop_py.local_search import multistart

# ---- starting points --------------------------------------------------------------------------


def test_the_local_search_begins_at_the_starting_point(monkeypatch):
    x, y = sp.variables(2)
    problem = sp.Problem((x - 40) ** 2 * (x + 1) ** 2 + y**2 - 0.5 * x, lower=-100, upper=100)
    start = np.array([39.25, 0.125])
    seen = []
    search = multistart.local_search

    def spy(problem, begin, *rest):
        seen.append(np.array(begin))
        return search(problem, begin, *rest)

    monkeypatch.setattr(multistart, "local_search", spy)
    result = sp.solve(problem, start=start)
    assert any(np.array_equal(begin, start) for begin in seen)
    assert result.upper_bound <= -20.0
    seen.clear()
    sp.solve_each(problem, [problem.objective, x + y], start=start)
    assert sum(np.array_equal(begin, start) for begin in seen) >= 2
    seen.clear()
    none = sp.solve(problem, sp.Options(refine="none"), start=start)
    assert not seen
    assert none.attained is None
    assert none.upper_bound == INF


_START = r"start: found (shape .*, expected \(2,\)|\[.*\], expected) finite numbers"


@pytest.mark.parametrize(
    "start", [np.zeros(3), [0.0], np.zeros((2, 1)), np.zeros((1, 2)), 5.0, [np.nan, 0], [0, INF]]
)
def test_wrong_starting_points_are_named(start):
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, [x**2 + y**2 <= 1])
    for call in (
        lambda: sp.solve(problem, start=start),
        lambda: sp.solve_each(problem, [x], start=start),
    ):
        with pytest.raises(sp.ProblemError, match=_START):
            call()


def test_a_start_outside_the_bounds_is_no_error():
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, [x**2 + y**2 <= 1], lower=-0.5)
    check(problem, sp.solve(problem, start=[1e6, -1e6]), -1.0)


# ---- options ----------------------------------------------------------------------------------

WRONG = {
    "order": [0, -1, 2.0, 2.5, "2", [2]],
    "effort": ["ladder", "", None, []],
    "gap": [-1e-9, np.nan, "small", None],
    "gap_kind": ["rel", None],
    "tolerance": [-1.0, np.nan, "1e-6", None],
    "chordal": ["amd", None],
    "refine": ["fmincon", True],
    "time_limit": [0, -3.0, np.nan],
}


@pytest.mark.parametrize(
    ("name", "value"), [(name, value) for name, values in WRONG.items() for value in values]
)
def test_wrong_options_name_themselves(name, value):
    with pytest.raises(sp.ProblemError, match=rf"Options\.{name}: found .*, expected"):
        sp.Options(**{name: value})


@pytest.mark.parametrize(
    ("name", "value"),
    [("time_limit", "5"), ("seed", -1), ("seed", "a"), ("seed", 1.5), ("solver", 3)],
)
def test_more_wrong_options_name_themselves(name, value):
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, [x**2 + y**2 <= 1])
    try:
        sp.solve(problem, sp.Options(**{name: value}))
    except sp.SparsePOPError as error:
        assert name in str(error)
    else:
        raise AssertionError("accepted")


def test_unknown_solvers_are_named():
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, [x**2 + y**2 <= 1])
    for name in ("sedumi", "", "cvxpy:NOSUCH", "Clarabel"):
        with pytest.raises(sp.SolverNotFound, match="solver: "):
            sp.solve(problem, sp.Options(solver=name))


def test_options_are_frozen_and_kept():
    options = sp.Options(order=np.int64(2), gap=1e-3)
    with pytest.raises(AttributeError):
        options.order = 3
    x, y = sp.variables(2)
    assert sp.solve(sp.Problem(x * y, [x**2 + y**2 <= 1]), options).options is options


def test_a_low_order_is_raised_with_a_note():
    x, y = sp.variables(2)
    result = sp.solve(sp.Problem(x**4 + x * y - 4 * x, [y**2 <= 4]), sp.Options(order=1))
    assert result.relaxation.order == 2
    assert any("order 1 raised to 2" in note for note in result.notes)


def test_the_gap_decides_the_status():
    x, y = sp.variables(2)
    # order 2 leaves a gap of 0.0025 here (Nie, Example 6.1); in [1e-3, 0.0521]
    z = sp.variables(3)
    problem = sp.Problem(z[0] * z[1] * (10 - z[2]), [z[0] + z[1] + z[2] <= 1], lower=0)
    wide = sp.solve(problem, sp.Options(order=2, gap=0.06, gap_kind="absolute"))
    narrow = sp.solve(problem, sp.Options(order=2, gap=1e-9, gap_kind="absolute"))
    for result in (wide, narrow):
        check(problem, result, 0.0, tight=0.0521)
    assert wide.status is sp.Status.OPTIMAL
    assert narrow.status in (sp.Status.BOUNDED, sp.Status.OPTIMAL)
    assert (narrow.status is sp.Status.OPTIMAL) == (narrow.gap <= 1e-9)
    # relative gaps are divided by max(1, |attained|): 1e6 (x y + 1) is closed by 1e-3 at once
    large = sp.Problem(1e6 * x * y, lower=-1, upper=1)
    result = sp.solve(large, sp.Options(gap=1e-3, gap_kind="relative"))
    assert result.status is sp.Status.OPTIMAL
    assert result.gap <= 1e-3 * 1e6


@pytest.mark.parametrize("limit", [1e-6, 0.01, 0.3])
def test_a_time_limit_leaves_a_valid_result(limit):
    x = sp.variables(6)
    rng = np.random.default_rng(2)
    f = sp.total(
        float(c) * x[i] * x[j] * x[k] + x[i] ** 4
        for c, (i, j, k) in zip(rng.normal(size=20), rng.integers(0, 6, (20, 3)), strict=True)
    )
    problem = sp.Problem(f, [sp.total(v**2 for v in x) <= 5], lower=-1, upper=1)
    result = sp.solve(problem, sp.Options(order=3, time_limit=limit))
    check(problem, result)
    assert result.status in (sp.Status.LIMIT, sp.Status.OPTIMAL, sp.Status.BOUNDED)
    assert result.lower_bound > -INF  # the box alone proves something
    for point in rng.uniform(-1, 1, (200, 6)):
        if problem.violation(point) == 0.0:
            assert result.lower_bound <= f(point)


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate:UserWarning")  # of cvxpy
@pytest.mark.parametrize("solver", ["clarabel-moment", "cvxpy:SCS", "cvxpy:CLARABEL"])
def test_other_solvers_prove_valid_bounds(solver):
    x, y = sp.variables(2)
    problem = sp.Problem(x * y + x**2, [x**2 + y**2 <= 1, x + y >= 0.5])
    angle = np.linspace(-np.pi, np.pi, 400001)
    # the minimum is on the circle or on the line; both by brute force
    a, b = np.cos(angle), np.sin(angle)
    on_circle = (a * b + a**2)[a + b >= 0.5].min()
    t = np.linspace(-1, 1, 400001)
    on_line = (t * (0.5 - t) + t**2)[t**2 + (0.5 - t) ** 2 <= 1].min()
    optimum = min(on_circle, on_line)
    result = sp.solve(problem, sp.Options(solver=solver, order=2))
    check(problem, result)
    assert optimum - 1e-2 <= result.lower_bound <= optimum + 1e-9
    assert optimum - 1e-9 <= result.upper_bound <= optimum + 1e-5


def test_wrong_multipliers_cannot_make_a_wrong_bound(monkeypatch):
    """A solver that lies: noise in its duals, "solved" in its status, a proud value."""
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, [x**2 + y**2 <= 1])  # optimum -1/2
    honest = relaxation_bound.solve_conic
    rng = np.random.default_rng(1)
    for lie in (
        lambda s: replace(s, z=s.z + rng.normal(size=s.z.size), primal=99.0, dual=99.0),
        lambda s: replace(s, z=0.0 * s.z, primal=99.0),
        lambda s: replace(s, status="infeasible", z=rng.normal(size=s.z.size)),
        lambda s: replace(s, status="failed", z=-s.z),
    ):
        monkeypatch.setattr(relaxation_bound, "solve_conic", lambda *a, lie=lie: lie(honest(*a)))
        result = check(problem, sp.solve(problem))
        assert result.lower_bound <= -0.5 <= result.upper_bound
        assert result.status is not sp.Status.INFEASIBLE


# ---- inputs and repetition --------------------------------------------------------------------


def frozen(problem):
    rows = [c.polynomial for c in problem.constraints]
    arrays = [a.tobytes() for p in [problem.objective, *rows] for a in (p.words, p.coefficients)]
    return arrays, problem.lower.tobytes(), problem.upper.tobytes(), problem.names


def test_inputs_are_not_modified():
    problem, objectives = region()
    start = np.array([0.1, 0.2])
    before = frozen(problem), [pickle.dumps(f) for f in objectives], start.tobytes()
    options = sp.Options(order=2)
    copied = {f.name: getattr(options, f.name) for f in fields(options)}
    sp.solve(problem, options, start=start)
    sp.solve_each(problem, objectives, options, start=start)
    assert (frozen(problem), [pickle.dumps(f) for f in objectives], start.tobytes()) == before
    assert {f.name: getattr(options, f.name) for f in fields(options)} == copied
    state = np.random.get_state()[1].copy()  # noqa: NPY002
    sp.solve(problem, options)
    assert np.array_equal(state, np.random.get_state()[1])  # noqa: NPY002


@pytest.mark.parametrize(
    "make", [problems.laboratory, lambda: double_well_chain(4), lambda: region()[0]]
)
def test_two_runs_are_equal(make):
    first, second = sp.solve(make()), sp.solve(make())
    assert first.lower_bound == second.lower_bound
    assert first.upper_bound == second.upper_bound
    assert first.status is second.status
    assert np.array_equal(first.x, second.x)
    assert len(first.points) == len(second.points)
    for a, b in zip(first.points, second.points, strict=True):
        assert np.array_equal(a.x, b.x)


def test_another_seed_changes_no_bound_beyond_the_gap():
    for seed in (1, 2):
        result = sp.solve(problems.laboratory(), sp.Options(order=2, seed=seed))
        assert 52.7064 <= result.lower_bound <= LAB_OPTIMUM + 1e-9 <= result.upper_bound + 2e-9


def test_results_describe_themselves():
    problem = problems.laboratory()
    result = sp.solve(problem, sp.Options(order=2))
    text = result.summary()
    assert "OPTIMAL" in text
    assert str(result) == text
    assert "52.7066" in repr(result)
    assert result.timings["solve"] >= 0
    assert all(
        point.violation == problem.violation(point.x) and point.value == problem.objective(point.x)
        for point in result.points
    )
    assert np.array_equal(result.points[0].x, result.x)
    for status in sp.Status:
        assert status.message.endswith(".")


def test_what_is_no_problem_is_named():
    (x,) = sp.variables(1)
    with pytest.raises(sp.ProblemError, match="problem: found Polynomial, expected a Problem"):
        sp.solve(x**2)
    with pytest.raises(sp.ProblemError, match="problem: found str, expected a Problem"):
        sp.solve_each("min x1", [x])


@pytest.mark.parametrize(("old", "new"), [("narrow", "obbt_lp"), ("squeeze", "obbt_sdp")])
def test_earlier_names_of_steps_to_skip_are_accepted_with_a_warning(old, new):
    with pytest.warns(DeprecationWarning, match=rf"Options.skip: '{old}' is now called '{new}'"):
        options = sp.Options(skip=["branch", old])
    assert options.skip == ("branch", new)
    assert options == sp.Options(skip=("branch", new))


def test_other_types_are_named() -> None:
    """Each call once raised an AttributeError or a TypeError from inside."""
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, lower=0, upper=1)
    for call, message in (
        (lambda: sp.solve(problem, {"order": 2}), "options: found dict"),
        (lambda: sp.solve_each(problem, [x], 3), "options: found int"),
        (lambda: sp.solve_each(problem, x), "objectives: found one polynomial"),
        (lambda: sp.Problem(x, None), "constraints: found NoneType"),
    ):
        with pytest.raises(sp.ProblemError, match=message):
            call()
    for value in (3, None):
        with pytest.raises(sp.FormatError, match="text: found"):
            sp.parse(value)
    verdict = sp.solve(problem).certificate.verify(None)
    assert not verdict.ok and "expected a Problem" in verdict.reason
