"""The loop over relaxations: its history, steps that may be left out, and extreme problems."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from loop_cases import ALL_SPECS, CASES, hierarchy_options, least_of_bilinear, least_of_star, star
from matplotlib import pyplot
from search_cases import bilinear, branched_on
from solved import INF, LAB_OPTIMUM, check

import sparsepop_py as sp
from sparsepop_py import Options, Problem, ProblemError, Status
from sparsepop_py.branch_and_bound import node
from sparsepop_py.budget import LimitReached
from sparsepop_py.options import SKIPPED
from sparsepop_py.strategy import order_loop, without_box
from sparsepop_py.strategy.shared_state import SharedState
from sparsepop_py.tightening import obbt_lp
from sparsepop_py.verified.certificate.steps import Known

# ---- the history ---------------------------------------------------------------------------


@pytest.mark.parametrize("case", CASES)
def test_every_step_is_recorded_and_bounds_only_improve(case):
    problem, least = (made() for made in CASES[case])
    skip = () if case == "bilinear" else ("full",)
    options = hierarchy_options(node_limit=40, skip=skip, gap=1e-6)
    result = check(problem, sp.solve(problem, options))
    names = [entry.name for entry in result.history]
    assert len(names) >= (2 if case == "bilinear" else 1)
    for name in names:
        known = ("linear", "star", "split", "mixed", "order ", "branch")
        assert name.startswith(known)
    for name in set(names) - {"branch"}:  # only branch and bound is taken up again
        assert names.count(name) == 1
    lower = np.array([entry.lower_bound for entry in result.history])
    upper = np.array([entry.upper_bound for entry in result.history])
    assert np.all(np.diff(lower) >= 0)
    assert np.all(np.diff(upper) <= 0)
    assert lower[-1] <= result.lower_bound <= least + 1e-9
    assert upper[-1] == result.upper_bound
    assert result.lower_bound >= least - 0.05 * abs(least)
    nodes = [entry.nodes for entry in result.history]
    assert nodes == sorted(nodes)
    assert max(nodes) <= 40
    for entry in result.history:
        assert entry.seconds >= 0
        assert (entry.moments > 0) == (entry.name != "branch")
        assert entry.name.startswith("order ") == (entry.order > 0)
        if entry.name in ("star", "split") or entry.order > 1:
            assert entry.largest_block > 1


def test_the_table_says_what_the_history_holds():
    result = sp.solve(star(), hierarchy_options(node_limit=5))
    head, line, *rows = result.history_table().splitlines()
    assert head.count("|") == line.count("|") == 9
    assert set(line) == {"|", "-"}
    assert len(rows) == len(result.history) > 0
    for row, entry in zip(rows, result.history, strict=True):
        name, low, high, gap, seconds, block, moments, nodes = row.strip("| ").split(" | ")
        assert name == entry.name
        assert float(low) <= entry.lower_bound
        assert float(high) >= entry.upper_bound
        assert float(low) == pytest.approx(entry.lower_bound, abs=1e-6)
        assert float(high) == pytest.approx(entry.upper_bound, abs=1e-6)
        assert float(gap) == pytest.approx(
            entry.upper_bound - entry.lower_bound, rel=0.1, abs=1e-12
        )
        assert float(seconds) == pytest.approx(entry.seconds, abs=0.006)
        sizes = entry.largest_block, entry.moments, entry.nodes
        assert (int(block), int(moments), int(nodes)) == sizes
        assert f"  {name}: >= " in result.summary()


def test_the_picture_of_the_history():
    result = sp.solve(star(), hierarchy_options())
    ax = result.plot_history()
    try:
        (curve,) = ax.get_lines()
        seconds = list(itertools.accumulate(entry.seconds for entry in result.history))
        assert np.allclose(curve.get_xdata(), seconds)
        gaps = [max(r.upper_bound - r.lower_bound, 1e-16) for r in result.history]
        assert np.allclose(curve.get_ydata(), gaps)
        assert [text.get_text() for text in ax.texts] == [entry.name for entry in result.history]
        assert ax.get_yscale() == "log"
        assert ax.get_xlabel() == "CPU seconds"
        own = pyplot.figure().add_subplot()
        assert result.plot_history(own) is own
        assert len(own.get_lines()) == 1
        ax.figure.canvas.draw()
    finally:
        pyplot.close("all")


ZOO = {
    "rosenbrock": (sp.problems.rosenbrock(4), 1.0),
    "broyden": (sp.problems.broyden_tridiagonal(4), 0.0),
    "singular": (sp.problems.chained_singular(4), 0.0),
    "motzkin": (sp.problems.motzkin(), 0.0),
    "quartic": (sp.problems.random_quartic(4, 3, seed=1), 1.0),
    "laboratory": (sp.problems.laboratory(), LAB_OPTIMUM),
}


@pytest.mark.parametrize("name", ZOO)
def test_never_worse_than_one_order(name):
    problem, optimum = ZOO[name]
    one = check(problem, sp.solve(problem, Options(effort="presolve")))
    # a tree of Motzkin's polynomial depends on the speed of the machine
    skip = ("branch",) if name == "motzkin" else ()
    all_ = check(problem, sp.solve(problem, Options(effort="auto", skip=skip)))
    unit = max(1.0, abs(optimum))
    assert all_.lower_bound >= one.lower_bound - 1e-6 * unit  # both may end in a closed gap
    assert all_.status is Status.OPTIMAL
    assert all_.lower_bound == pytest.approx(optimum, abs=2e-6 * unit)
    assert all_.upper_bound == pytest.approx(optimum, abs=2e-6 * unit)


# ---- what is left out ------------------------------------------------------------------------


def belongs(step, name):
    """Check whether an entry of that name belongs to a step that can be left out."""
    words = {"full": "order ", "monomials": "monomial", "partners": "partner"}
    if step == "components":  # these blocks belong to the usual orders
        return False
    if step in ("full", "mixed"):
        return name.startswith(words.get(step, step))
    return words.get(step, step) in name


def all_specs(problem, skip=(), order=None):
    options = Options(effort="auto", skip=skip, order=order)
    return SharedState.of(problem, (problem.objective,), options).specs


@pytest.mark.parametrize("step", SKIPPED[:9])
def test_parts_left_out_are_there_otherwise(step):
    x = sp.variables(8)
    rows = [sp.total([*x[2:], x[0] * x[2]]) <= 3, x[1] * x[7] + x[3] <= 1]
    objective = x[0] * sp.total(x[2:5]) + x[1] * sp.total(x[5:])
    cubic = (step == "monomials") * x[2] * x[3] * x[4]  # order 1 has none of them
    problem = Problem(objective + cubic, rows, -1.0, 1.0)
    with_, without = all_specs(problem), all_specs(problem, (step,))
    kinds = [{r.shape, r.joined, r.terms} for r in with_]
    assert any(step in kind for kind in kinds)
    for spec in without:
        assert step not in {spec.shape, spec.joined, spec.terms}
        assert not belongs(step, spec.name)
    kept = {r.name for r in without}
    lost = {r.name for r, kind in zip(with_, kinds, strict=True) if step in kind}
    assert kept == {r.name for r in with_} - (set() if step == "components" else lost)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("step", [p for p in SKIPPED if p not in ("quote", "obbt_sdp")])
def test_bounds_are_valid_without_any_step(step, case, monkeypatch):
    def refused(*args, **kwargs):
        raise AssertionError("bounds of variables are tightened")

    if step == "obbt_lp":
        monkeypatch.setattr(obbt_lp, "tighten_bounds", refused)
        monkeypatch.setattr(node, "tighten_bounds", refused)
    problem, least = (made() for made in CASES[case])
    options = Options(effort="auto", skip=[step], gap=1e-5, node_limit=30, time_limit=10.0)
    result = check(problem, sp.solve(problem, options))
    assert result.history
    assert not [entry.name for entry in result.history if belongs(step, entry.name)]
    assert least - 0.05 * abs(least) <= result.lower_bound <= least + 1e-9
    if step == "cutoff":
        assert result.certificate.cutoff is None
        assert not result.certificate.uses_cutoff
    if step == "branch":
        assert result.certificate.leaves == 1
        assert all(entry.nodes == 0 for entry in result.history)


@pytest.mark.parametrize("effort", ["auto", "presolve"])
def test_an_unbounded_set_without_a_cutoff(effort):
    problem = sp.problems.laboratory()
    options = Options(effort=effort, skip=["cutoff"], time_limit=0.7)
    result = check(problem, sp.solve(problem, options))
    assert result.lower_bound <= LAB_OPTIMUM + 1e-9


@pytest.mark.parametrize("skip", [(), ("quote",)])
def test_bounds_of_one_objective_are_quoted_by_the_others_unless_left_out(skip):
    x = sp.variables(3)
    rows = [x[0] * x[1] + x[1] * x[2] >= 1.5, x[0] ** 2 + x[1] ** 2 <= 1.5, x[2] * x[0] <= 0.5]
    problem = Problem(x[0], rows, -2.0, 2.0)
    objectives = [side * v for v in x for side in (1.0, -1.0)]
    options = Options(effort="auto", skip=(*skip, "obbt_lp"))
    results = sp.solve_each(problem, objectives, options)
    known = 0
    for objective, result in zip(objectives, results, strict=True):
        own = check(problem.with_objective(objective), result)
        assert own.status is Status.OPTIMAL
        steps = [step for node in result.certificate.root for step in node.box.steps]
        known += sum(isinstance(step, Known) for step in steps)
    assert (known > 0) == (not skip)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_an_order_asked_for_leaves_out_everything_below(order):
    specs = all_specs(star(), order=order)
    assert {r.order for r in specs if r.shape == "full"} >= {order, order + 1}
    assert (min(r.order or 0 for r in specs) == 0) == (order == 1)
    assert all((r.order or 1) >= order for r in specs)


# ---- wrong values ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("skip", "branch"),
        ("skip", ("nothing",)),
        ("skip", ["star", 3]),
        ("branch_on", [-1]),
        ("branch_on", [0.5]),
        ("branch_on", "x"),
        ("node_limit", -1),
        ("node_limit", 2.5),
        ("node_limit", "many"),
        ("executor", 4),
        ("executor", "threads"),
        ("gap_kind", "percent"),
        ("gap_kind", None),
        ("time_limit", 0),
        ("time_limit", -1.0),
        ("time_limit", np.nan),
        ("effort", "much"),
    ],
)
def test_wrong_values_name_their_field(name, value):
    with pytest.raises(ProblemError, match=rf"^Options\.{name}: found .*, expected"):
        Options(**{name: value})


def test_branching_variables_must_exist():
    problem = bilinear()
    with pytest.raises(ProblemError, match=r"Options\.branch_on: found 4"):
        sp.solve(problem, Options(branch_on=[0, 4]))
    with pytest.raises(ProblemError, match=r"Options\.branch_on: found 9"):
        sp.solve_each(problem, [problem.objective], branch_on=[9])


# ---- sets without end, empty sets ---------------------------------------------------------------


def far(kind):
    x, y = sp.variables(2)
    return {
        "falls": Problem(x, [x * y >= 1]),
        "falls in an orthant": Problem(x * y - x, [x + y >= 1], lower=0),
        "falls in one variable": Problem(x**3),
        "empty": Problem(x, [x**2 + y**2 <= -1]),
        "empty for products": Problem(x, [x * y >= 1, x**2 + y**2 <= 1.5]),
        "empty and unbounded": Problem(x, [x * y >= 1, x + y <= 1], lower=0),
    }[kind]


@pytest.mark.parametrize("kind", ["falls", "falls in an orthant", "falls in one variable"])
def test_objectives_that_fall_for_ever(kind):
    problem = far(kind)
    result = sp.solve(problem, Options(effort="auto", time_limit=10.0))
    assert result.status is Status.UNBOUNDED
    assert result.lower_bound == -INF
    assert problem.violation(result.x) <= 1e-8


@pytest.mark.parametrize("kind", ["empty", "empty for products", "empty and unbounded"])
def test_sets_without_points(kind):
    problem = far(kind)
    result = check(problem, sp.solve(problem, Options(effort="auto", time_limit=10.0)))
    assert result.status is Status.INFEASIBLE
    assert result.lower_bound == INF
    assert result.x is None or problem.violation(result.x) > 0


def test_sets_without_end_but_with_an_answer():
    x, y = sp.variables(2)
    options = Options(effort="auto", time_limit=10.0)
    above = Problem(x + 4 * y, [x * y >= 1], lower=0)  # 4 at (2, 1/2), by the means of x and 4 y
    check(above, sp.solve(above, options), 4.0)
    hidden = Problem((x * y - 1) ** 2 + x**2)  # 0, but nowhere attained
    result = check(hidden, sp.solve(hidden, Options(effort="auto", time_limit=1.0)))
    assert result.lower_bound <= 0.0 < result.upper_bound
    assert result.status is not Status.UNBOUNDED


# ---- several objectives ---------------------------------------------------------------------


@pytest.mark.parametrize("effort", ["auto", "presolve"])
def test_progress_is_reported_between_the_bounds(effort):
    problem, reports = bilinear(), []
    objectives = [problem.objective, -problem.objective]
    results = sp.solve_each(
        problem, objectives, Options(effort=effort), on_progress=lambda *args: reports.append(args)
    )
    assert {number for number, _, _ in reports} == {0, 1}
    for number, lower, upper in reports:
        assert lower <= results[number].lower_bound
        assert upper >= results[number].upper_bound
    assert results[0].lower_bound <= least_of_bilinear()


def test_what_terms_leave_as_it_is_is_solved_once(monkeypatch):
    monkeypatch.setattr(
        "sparsepop_py.strategy.shared_state.relaxation_specs",
        lambda *args: tuple(r for r in ALL_SPECS(*args) if r.order == 4),
    )
    x, y, z = sp.variables(3)  # so coupled that chordal terms of order 4 are all terms
    problem = Problem(x**4 * y + y * z**3 - x * z, [x**2 + y**2 <= 1, y * z <= 0.3], -1, 1)
    options = Options(effort="auto", gap=0.0, node_limit=0)
    result = check(problem, sp.solve(problem, options))
    sizes = [(entry.largest_block, entry.moments) for entry in result.history]
    assert len(sizes) == len(set(sizes)) > 0


@pytest.mark.parametrize("limit", [100.0, 0.1])
def test_orders_without_constraints_of_high_degree_prove_bounds(monkeypatch, limit):
    """Least x + y on the disc is -sqrt 2; with x^4 + y^4 <= 1/10 it is larger."""
    chosen = []

    def partial(*args):
        chosen[:] = [r for r in ALL_SPECS(*args) if r.partial]
        return tuple(chosen)

    monkeypatch.setattr("sparsepop_py.strategy.shared_state.relaxation_specs", partial)
    x, y = sp.variables(2)
    problem = Problem(x + y, [x**2 + y**2 <= 1, x**4 + y**4 <= limit], -1, 1)
    result = check(problem, sp.solve(problem, Options(effort="auto", gap=1e-6, node_limit=0)))
    assert [r.name for r in chosen] == ["order 1, constraints of degree 2 at most"]
    assert not any(r.whole for r in chosen)
    least = -np.sqrt(2.0) if limit > 1 else -2.0 * (limit / 2.0) ** 0.25
    assert result.upper_bound == pytest.approx(least, abs=1e-5)
    low = least - 1e-5 if limit > 1 else -np.sqrt(2.0)
    assert low <= result.lower_bound <= least + 1e-9


@pytest.mark.parametrize("value", [None, 1e9, np.nan])
def test_repaired_vectors_are_only_starting_points(value):
    problem, seen = star(), []

    def repair(x):
        seen.append(x.copy())
        return x if value is None else np.full(x.size, value)

    options = hierarchy_options(skip=("linear", "full"))
    (result,) = sp.solve_each(problem, [problem.objective], options, repair=repair)
    check(problem, result)
    assert seen
    assert all(x.shape == (7,) and np.all(np.isfinite(x)) for x in seen)
    assert result.lower_bound <= least_of_star() + 1e-9


@pytest.mark.parametrize("effort", ["presolve", "auto"])
@pytest.mark.parametrize(
    ("value", "found"),
    [(None, r"shape \(\)"), ([1.0], r"shape \(1,\)"), (["a"] * 7, "expected numbers")],
)
def test_repaired_vectors_are_vectors(effort, value, found):
    problem, options = star(), Options(effort=effort, skip=("linear",))
    with pytest.raises(sp.ProblemError, match=rf"repair: found .*{found}|repair: found {found}"):
        sp.solve_each(problem, [problem.objective], options, repair=lambda x: value)


def test_branching_variables_of_several_objectives(monkeypatch):
    monkeypatch.setattr(
        "sparsepop_py.strategy.shared_state.relaxation_specs",
        lambda *args: tuple(r for r in ALL_SPECS(*args) if r.shape == "linear"),
    )
    problem = bilinear()
    objectives = [problem.objective, -problem.objective]
    options = Options(effort="auto", branch_on=[0], node_limit=15, skip=["obbt_lp"])
    results = sp.solve_each(problem, objectives, options, branch_on=[1, 2])
    cuts = set().union(*(branched_on(result.certificate) for result in results))
    assert cuts == {1, 2}
    for objective, result in zip(objectives, results, strict=True):
        check(problem.with_objective(objective), result)
        assert result.options.branch_on == (1, 2)


def test_orders_far_too_large_come_down_at_once() -> None:
    """The disc of the README: order 2 is exact; 231 monomials of order 20 would take minutes."""
    x, y = sp.variables(2)
    problem = sp.Problem(x**4 - 3 * x * y + y**2, [x**2 + y**2 <= 2])
    result = sp.solve(problem, sp.Options(order=20))
    assert result.status is sp.Status.OPTIMAL
    lowered = [note for note in result.notes if "lowered" in note]
    assert len(lowered) == 1 and lowered[0].startswith("order 20 lowered to ")


def transport() -> tuple[sp.Problem, float]:
    """Concave costs of transport take integers at a vertex: all are tried for the least value."""
    supply, demand = (6, 7, 8), (5, 11, 5)
    linear = np.array([[19, 8, 9], [18, 11, 9], [17, 8, 11]])
    bent = np.array([[2, 2, 1], [1, 2, 2], [2, 2, 2]])
    least = INF
    for free in itertools.product(range(7), range(7), range(8), range(8)):
        a = np.array(free).reshape(2, 2)
        a = np.column_stack([a, np.array(supply[:2]) - a.sum(axis=1)])
        flow = np.vstack([a, np.array(demand) - a.sum(axis=0)])
        if flow.min() >= 0:
            least = min(least, float(np.sum(linear * flow - bent * flow**2)))
    x = np.array(sp.variables(9), object).reshape(3, 3)
    costs = linear.astype(object) * x - bent.astype(object) * x**2
    rows = [sp.total(x[i]) == supply[i] for i in range(3)]
    rows += [sp.total(x[:, j]) == demand[j] for j in range(3)]
    upper = np.minimum.outer(supply, demand).ravel()
    problem = sp.Problem(sp.total(costs.ravel()), rows, 0, upper)
    return problem, least


def test_the_form_without_products_follows_the_lean_one() -> None:
    problem, least = transport()
    result = check(problem, sp.solve(problem, Options(order=2, memory_limit=3e5)))
    assert [entry.name for entry in result.history] == ["order 2", "order 2"]
    assert result.history[0].lower_bound < least - 0.1  # blocks of 28 would close it as well
    assert result.upper_bound == least
    assert result.status is Status.OPTIMAL


def test_what_the_lean_form_proves_is_kept_where_time_ends_in_the_next(monkeypatch) -> None:
    problem, least = transport()
    own, built = order_loop.build_relaxations, []

    def ended(*args):
        if built:
            raise LimitReached
        return own(*args)

    def bound_order(*args):
        built.append(args)
        return bounded(*args)

    bounded = order_loop.bound_order
    monkeypatch.setattr(order_loop, "bound_order", bound_order)
    monkeypatch.setattr(order_loop, "build_relaxations", ended)
    result = check(problem, sp.solve(problem, Options(order=2, memory_limit=3e5)))
    assert len(built) == 1 and result.status in (Status.LIMIT, Status.BOUNDED)
    assert [entry.name for entry in result.history] == ["order 2"]
    assert result.lower_bound == result.history[0].lower_bound > least - 10.0


def test_relaxations_precede_exact_gram_matrices_that_take_longer(monkeypatch):
    """A dense quartic of twelve variables: the matrix takes ten times as long as the order."""

    def refused(*_: object) -> None:
        raise AssertionError("a Gram matrix was looked for")

    monkeypatch.setattr(without_box, "unconstrained_bound", refused)
    planted = sp.problems.random_quartic(12)
    problem = Problem(planted.objective, (), planted.lower, planted.upper)  # coefficients alone
    result = check(problem, sp.solve(problem, Options(effort="auto")))
    assert result.status is Status.OPTIMAL
    assert result.lower_bound <= 1.0 <= result.upper_bound  # as planted


@pytest.mark.parametrize("refine", ["none", "prove", "scipy"])
@pytest.mark.parametrize(
    ("lower", "power", "right", "least"),
    [(1, 1, 1, 1.0), (-1, 2, 0, 0.0), (1, 2, -1, INF)],
    ids=["y = 1", "y^2 = 0", "y^2 = -1"],
)
def test_boxes_that_are_points_have_relaxations_without_moments(refine, lower, power, right, least):
    (y,) = sp.variables(1)
    problem = Problem(y, [y**power == right], lower, 1)
    options = Options(effort="auto", refine=refine)
    result = sp.solve(problem, options)
    attained = Status.BOUNDED if refine == "none" else Status.OPTIMAL
    assert result.status == (Status.INFEASIBLE if least == INF else attained)
    assert result.lower_bound == pytest.approx(least, abs=1e-6)
    ratio = sp.solve(sp.RationalProblem(y / (1 + y**2), [y**power == right], lower, 1), options)
    assert ratio.lower_bound == pytest.approx(least if least == INF else least / 2, abs=1e-6)


def test_a_bound_without_a_box_follows_relaxations_that_take_their_time(monkeypatch):
    """(x^2 - y)^2 + y^2 - 2 y is -1 at (1, 1), in which x + y >= -9 plays no part."""

    def endless(*_):
        raise LimitReached

    monkeypatch.setattr(order_loop, "_run_orders", endless)
    x, y = sp.variables(2)
    problem = Problem((x**2 - y) ** 2 + y**2 - 2 * y, [x + y >= -9])
    result = sp.solve(problem, Options(time_limit=60))
    assert -1 - 1e-6 <= result.lower_bound <= -1.0
