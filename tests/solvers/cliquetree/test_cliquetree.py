"""The clique-tree interior-point method: values, identities, statuses, reuse."""

from collections import OrderedDict
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sps
from relaxed import safe_value

import sparsepop_py as sp
from sparsepop_py import Problem
from sparsepop_py.conic.program import Cones, ConicProgram
from sparsepop_py.solvers import cliquetree, preferred, solve_conic
from sparsepop_py.solvers.interface import SolverSettings


def program(problem, order, **options):
    return sp.assemble(sp.relax(problem, order, **options), problem.objective)


def boxed(make, n):
    return Problem(make(n).objective, lower=-1, upper=1)


def least_eigenvalues(cones, z):
    """The least eigenvalue of each semidefinite block of z."""
    found, offset = [], cones.zero + cones.nonnegative
    for size in cones.psd:
        j, i = np.tril_indices(size)
        matrix = np.zeros((size, size))
        part = z[offset : offset + i.size]
        matrix[i, j] = matrix[j, i] = part * np.where(i == j, 1.0, np.sqrt(0.5))
        found.append(np.linalg.eigvalsh(matrix)[0])
        offset += i.size
    return np.array(found)


def output_error(seed, samples=12, box=lambda a, b: (a, b), prior=lambda a, b: []):
    """Simulated first-order data with noise: bounds on a in y = eta + e, eta = a eta- + b u-."""
    rng = np.random.default_rng(seed)
    u = rng.choice([-1.0, 1.0], samples)
    true = np.zeros(samples)
    for k in range(1, samples):
        true[k] = 0.5 * true[k - 1] + 0.4 * u[k - 1]
    y = true + rng.uniform(-0.05, 0.05, samples)
    x = sp.variables(2 + samples)
    (a, b), e = box(x[0], x[1]), x[2:]
    rows = [
        (y[k] - 0.05 * e[k]) - a * (y[k - 1] - 0.05 * e[k - 1]) - b * u[k - 1] == 0
        for k in range(1, samples)
    ]
    return Problem(x[0], rows + prior(a, b), lower=-1, upper=1)


x, y, z = sp.variables(3)
BY_HAND = {
    # an interval
    "interval": (Problem(x + 0.0 * y, lower=-1, upper=1), 1, -1.0),
    # derivative 4 t^3 = 1
    "quartic": (Problem(sp.variables(1)[0] ** 4 - sp.variables(1)[0], lower=-1, upper=1), 2,
                -0.75 * 4 ** (-1 / 3)),
    # distance of the origin to a line: 1 / 5
    "line": (Problem(x**2 + y**2, [x + 2 * y == 1], -1, 1), 1, 0.2),
    # three vectors at 120 degrees
    "triangle": (
        Problem(x * y + y * z + x * z, [v**2 == 1 for v in (x, y, z)], -1, 1),
        1,
        -1.5,
    ),
    # the corner (2/3, 2/3) of two half-planes
    "corner": (Problem(-1 * x - y, [x + 2 * y <= 2, 2 * x + y <= 2], -1, 1), 1, -4 / 3),
    # x y is least at opposite corners, and y z then too
    "path": (Problem(x * y + y * z, lower=-1, upper=1), 2, -2.0),
}  # fmt: skip


@pytest.mark.parametrize("name", sorted(BY_HAND))
def test_values_by_hand(name):
    problem, order, value = BY_HAND[name]
    p = program(problem, order)
    found = cliquetree.solve(p)
    assert found.status == "solved"
    assert found.dual == pytest.approx(value, abs=1e-6)
    assert found.primal == pytest.approx(value, abs=1e-6)


@pytest.mark.parametrize(
    "make, order, value",
    [
        (sp.problems.rosenbrock, 2, 1.0),  # at (1, ..., 1), which is in the box
        (sp.problems.chained_wood, 2, 1.0),
        (sp.problems.chained_singular, 2, 0.0),  # at the origin, singular
        (sp.problems.broyden_tridiagonal, 2, 0.0),
        (sp.problems.rosenbrock, 3, 1.0),
    ],
)
def test_chains_have_their_known_optimum(make, order, value):
    p = program(boxed(make, 12), order)
    found = cliquetree.solve(p)
    assert found.status in ("solved", "almost")
    assert value - 5e-6 <= safe_value(p, found.z) <= value + 1e-6


def test_the_dual_is_in_the_cone_and_stationary():
    problem = Problem(x * y - z, [x**2 + z**2 <= 1, y + z == 0.25], -1, 1)
    p = program(problem, 2, lean=True, products=True)
    assert min(p.cones.zero, p.cones.nonnegative, len(p.cones.psd)) > 0
    found = cliquetree.solve(p)
    linear = found.z[p.cones.zero : p.cones.zero + p.cones.nonnegative]
    assert found.status == "solved"
    assert found.residual <= 1e-8
    assert linear.min() >= 0 and least_eigenvalues(p.cones, found.z).min() >= 0
    np.testing.assert_allclose(p.A @ found.y + found.s, p.b, atol=1e-12)
    assert found.primal - found.dual == pytest.approx(found.s @ found.z, abs=1e-6)


def tree_problem(seed, n=9):
    """A random quadratic form and quartic terms along a random tree."""
    rng = np.random.default_rng(seed)
    v = sp.variables(n)
    f = sp.total([float(rng.normal()) * t for t in v])
    for i in range(1, n):
        j = int(rng.integers(0, i))
        f = f + float(rng.normal()) * v[i] * v[j] + float(rng.normal()) * v[i] ** 2 * v[j]
        f = f + abs(float(rng.normal())) * v[i] ** 4
    return Problem(f, lower=-1, upper=1)


CASES = {
    **{f"tree {seed}": (tree_problem(seed), 2, {}) for seed in range(4)},
    "tree, order 3": (tree_problem(7, 5), 3, {}),
    "output error": (output_error(0), 2, {}),
    "output error, lean": (output_error(1), 2, {"lean": True}),
    "output error, products": (output_error(2), 1, {"lean": True, "products": True}),
    "no reduction": (output_error(3, 6), 2, {"reduce": False}),
    "maximum": (replace(output_error(0), objective=-1 * output_error(0).objective), 2, {}),
    "two components": (Problem(x * y + z**2 - z, lower=-1, upper=1), 2, {}),
}


@pytest.mark.parametrize("name", sorted(CASES))
def test_the_safe_value_is_as_good_as_clarabels(name):
    problem, order, options = CASES[name]
    p = program(problem, order, **options)
    found, other = cliquetree.solve(p), solve_conic(p, "clarabel")
    assert found.status == "solved"
    scale = max(1.0, abs(other.primal))
    assert safe_value(p, found.z) >= safe_value(p, other.z) - 1e-6 * scale
    assert safe_value(p, found.z) <= found.primal + 1e-6 * scale


def test_badly_scaled_rows_and_objective():
    p = program(tree_problem(3), 2)
    scale = np.repeat(10.0 ** np.arange(-3, 4), 1 + p.b.size // 7)[: p.b.size]
    start = p.cones.zero + p.cones.nonnegative
    for size in p.cones.psd:  # one factor a block
        rows = size * (size + 1) // 2
        scale[start : start + rows] = scale[start]
        start += rows
    rows = sps.csc_array(sps.diags_array(scale) @ p.A)
    scaled = ConicProgram(1e4 * p.q, rows, scale * p.b, p.cones, 1e4 * p.offset)
    plain, found = cliquetree.solve(p), cliquetree.solve(scaled)
    assert found.status == "solved"
    assert found.dual == pytest.approx(1e4 * plain.dual, rel=1e-6)


@pytest.mark.parametrize("shape", ["star", "split"])
@pytest.mark.parametrize("width", [0.03, 0.003])
def test_inequalities_far_from_their_boundary_change_nothing(width, shape):
    """A prior |a| <= 1 holds all over a small box of a: its rows are 1 / width in units of a."""

    def small(a, b):
        return 0.5 + width * a, 0.4 + width * b

    def stable(a, b):
        return [(1 - a) / width >= 0, (1 + a) / width >= 0]

    problems = output_error(0, box=small), output_error(0, box=small, prior=stable)
    found = [cliquetree.solve(program(p, None, shape=shape, products=True)) for p in problems]
    assert [each.status for each in found] == ["solved", "solved"]
    assert found[1].dual == pytest.approx(found[0].dual, abs=1e-5)


@pytest.mark.parametrize(
    "rows", [[x + y >= 2.5], [x * y == 1.5], [x**2 + y**2 == 0.5, x + y >= 1.1]]
)
def test_emptiness_is_seen(rows):
    p = program(Problem(x * y + z, rows, -1, 1), 2)
    found = cliquetree.solve(p)
    assert found.status == "infeasible"
    assert safe_value(p, found.z) > np.abs(p.q).sum() + p.offset


def test_what_is_not_compact_fails_and_says_so():
    free = ConicProgram(np.ones(2), sps.csc_array(-np.eye(2)[:1]), np.zeros(1), Cones(0, 1, ()))
    for p in (program(Problem(x**4 - y**3 * x), 2), free):
        found = cliquetree.solve(p)
        assert found.status == "failed"
        assert found.detail


def test_a_target_stops_early():
    p = program(boxed(sp.problems.broyden_tridiagonal, 20), 2)
    whole, early = cliquetree.solve(p), cliquetree.solve(p, target=-0.5)
    assert early.status == "solved" and early.detail == "target"
    assert early.iterations < whole.iterations
    assert -0.5 <= safe_value(p, early.z) <= 1e-6


def test_time_limit_is_kept():
    p = program(boxed(sp.problems.broyden_tridiagonal, 20), 2)
    found = cliquetree.solve(p, time_limit=0.0)
    assert found.status == "failed" and found.detail == "time limit"


def test_one_analysis_serves_all_objectives_and_data():
    problem = output_error(0)
    relaxation = sp.relax(problem, 2)
    names = problem.objective
    first = sp.assemble(relaxation, names)
    symbolic = cliquetree.analyse(first)
    second = sp.assemble(relaxation, -1 * names)
    assert cliquetree.run(second).symbolic.key == symbolic.key
    low, high = cliquetree.solve(first, symbolic), cliquetree.solve(second, symbolic)
    assert low.dual <= 0.5 <= -high.dual  # the true parameter
    other = program(output_error(5), 2)
    again = cliquetree.run(other, settings=cliquetree.Settings(kernels="numpy"))
    assert cliquetree.solve(other, symbolic).dual == again.solution.dual


def test_a_warm_start_gives_the_same_value():
    p = program(output_error(0), 2)
    cold = cliquetree.run(p)
    settings = cliquetree.Settings(gap=1e-2, accepted=1e-2)
    early = cliquetree.run(p, settings=settings)
    assert len(early.outcome.log) < len(cold.outcome.log)
    warm = cliquetree.solve(p, early.symbolic, start=early.outcome.iterate)
    assert warm.status == "solved"
    assert warm.dual == pytest.approx(cold.solution.dual, abs=1e-6)


def test_an_early_point_saves_steps_on_another_objective():
    p = program(output_error(0, 20), 2)
    first, cold = cliquetree.run(p), cliquetree.run(replace(p, q=-p.q))
    warm = cliquetree.run(replace(p, q=-p.q), start=first.outcome.early)
    assert len(warm.outcome.log) < len(cold.outcome.log)
    assert warm.solution.dual == pytest.approx(cold.solution.dual, abs=1e-6)


@pytest.mark.parametrize(
    "largest, moments, first",
    [(9, 300, True), (8, 300, False), (6, 1200, True), (3, 4999, False), (0, 10**6, False)],
)
def test_the_domain_of_the_default(largest, moments, first):
    assert (preferred(largest, moments, True)[0] == "cliquetree") == first
    assert preferred(largest, moments, False)[0] == "clarabel"
    assert preferred(largest, moments, True)[-2:] == ("clarabel", "clarabel-moment")


def test_a_warm_start_from_the_opposite_objective_does_no_harm():
    p = program(output_error(0), 2)
    late = cliquetree.run(replace(p, q=-p.q))
    warm = cliquetree.solve(p, late.symbolic, start=late.outcome.iterate)
    assert warm.status == "solved"
    assert warm.dual == pytest.approx(cliquetree.solve(p).dual, abs=1e-6)


def test_another_pattern_is_refused():
    symbolic = cliquetree.analyse(program(tree_problem(0), 2))
    with pytest.raises(ValueError, match="another pattern"):
        cliquetree.solve(program(tree_problem(0), 3), symbolic)


def test_patterns_are_kept_up_to_a_number_of_entries(monkeypatch):
    """Objectives that take turns come back to theirs; four are kept whatever their size."""
    patterns, seen, analyse = [tree_problem(0, n) for n in range(5, 11)], [], cliquetree.analyse
    programs = [program(problem, 2) for problem in patterns]

    def watched(program, compiled=False):
        seen.append(program.q.size)
        return analyse(program, compiled)

    monkeypatch.setattr(cliquetree, "analyse", watched)
    sizes = [p.A.nnz for p in programs]
    for entries, again in ((sum(sizes), []), (sum(sizes) - 1, [0]), (0, [0, 1])):
        monkeypatch.setattr(cliquetree, "_analysed", OrderedDict())
        monkeypatch.setattr(cliquetree, "_ENTRIES", entries)
        for p in programs:
            cliquetree.solve(p)
        assert seen == [p.q.size for p in programs]
        seen.clear()
        for p in programs[2:] + [programs[k] for k in again]:  # the newest first: kept in any case
            cliquetree.solve(p)
        assert seen == [programs[k].q.size for k in again]
        seen.clear()


def test_runs_are_repeatable():
    p = program(tree_problem(1), 2)
    first, second = cliquetree.solve(p), cliquetree.solve(p)
    np.testing.assert_array_equal(first.z, second.z)
    np.testing.assert_array_equal(first.y, second.y)


def test_the_run_shows_what_happened():
    done = cliquetree.run(program(tree_problem(1), 2))
    log = done.outcome.log
    assert len(log) == done.solution.iterations + 1
    assert log[-1].mu < 1e-6 < log[0].mu
    assert set(done.outcome.seconds) >= {"assembly", "factor", "solves", "steps"}
    assert done.symbolic.tree.sizes.shape[1] == 2
    assert "fronts up to" in str(done) and len(str(done).splitlines()) == len(log) + 4


def test_programs_without_matrices_or_rows():
    # maximise y1 + y2 on the simplex: a linear program
    rows = sps.csc_array(np.array([[1.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]))
    p = ConicProgram(np.array([-1.0, -2.0]), rows, np.array([1.0, 0, 0]), Cones(0, 3, ()))
    assert cliquetree.solve(p).dual == pytest.approx(-2.0, abs=1e-6)
    nothing = ConicProgram(np.zeros(1), sps.csc_array((0, 1)), np.zeros(0), Cones(0, 0, ()), 3.0)
    assert cliquetree.solve(nothing).dual == 3.0


@pytest.mark.parametrize("constant", [0.0, 1e4, -1e6])
def test_a_constant_does_not_loosen_the_gap_of_rough_solves(constant: float) -> None:
    """The least value of x1 x2 + x2 x3 on the box is -2, whatever is added to it."""
    x1, x2, x3 = sp.variables(3)
    problem = sp.Problem(x1 * x2 + x2 * x3, lower=-1, upper=1)
    moved = replace(program(problem, 2), offset=constant)
    found = cliquetree.clique_tree(moved, SolverSettings(accuracy=5e-3))
    assert found.status == "solved"
    assert -2.01 <= found.dual - constant <= -2.0 + 1e-6
