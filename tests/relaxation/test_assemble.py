"""Conic programs and solvers: one convention, and its identities per solver and form.

A y + s = b,  s in K,   q + A'z = 0,  z in K*,   primal = dual
"""

import gc
import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sps

import sparsepop_py as sp
from sparsepop_py import (
    ConicProgram,
    FormatError,
    Problem,
    SolverNotFound,
    assemble,
    relax,
)
from sparsepop_py.conic.program import Cones
from sparsepop_py.relaxation.assemble import split_dual
from sparsepop_py.solvers import solve_conic, solver_names

SOLVERS = {
    "clarabel": 1e-6,
    "clarabel-moment": 1e-5,
    "cvxpy:CLARABEL": 1e-5,
    "cvxpy:SCS": 5e-3,
}


def closed_forms():
    """Problems, orders and the values of their relaxations, by hand."""
    x, y, z = sp.variables(3)
    a, b = sp.variables(2)
    t = sp.variables(1)[0]
    return {
        # an interval: exact at order 1
        "interval": (Problem(t, lower=-1, upper=1), 1, -1.0),
        # (t - 1/4)^2 + 3
        "parabola": (Problem((t - 0.25) ** 2 + 3.0), 1, 3.0),
        # derivative 4 t^3 = 1
        "quartic": (Problem(t**4 - t, lower=-1, upper=1), 2, -0.75 * 4 ** (-1 / 3)),
        # least eigenvalue of [[0, 1/2], [1/2, 0]]
        "circle": (Problem(a * b, [a**2 + b**2 == 1]), 1, -0.5),
        # distance of the origin to a line: 4 / 5
        "line": (Problem(a**2 + b**2, [a + 2 * b == 2]), 1, 0.8),
        # the same with an inequality that is active
        "halfplane": (Problem(a**2 + b**2, [a + 2 * b >= 2], -3, 3), 1, 0.8),
        # three vectors at 120 degrees
        "triangle": (
            Problem(x * y + y * z + x * z, [v**2 == 1 for v in (x, y, z)]),
            1,
            -1.5,
        ),
        # linear programming
        "corner": (Problem(-1 * a - b, [a + 2 * b <= 2, 2 * a + b <= 2], 0, 1), 1, -4 / 3),
    }


def parts(cones, vector):
    """Zero rows, nonnegative rows and symmetric matrices of a vector in the cone's order."""
    zero = vector[: cones.zero]
    linear = vector[cones.zero : cones.zero + cones.nonnegative]
    matrices, offset = [], cones.zero + cones.nonnegative
    for size in cones.psd:
        matrix = np.zeros((size, size))
        for j in range(size):
            for i in range(j + 1):
                weight = 1.0 if i == j else 1 / np.sqrt(2.0)
                matrix[i, j] = matrix[j, i] = vector[offset] * weight
                offset += 1
        matrices.append(matrix)
    assert offset == vector.size
    return zero, linear, matrices


def distance_to_cone(cones, vector, dual):
    zero, linear, matrices = parts(cones, vector)
    worst = [0.0] if dual else [float(np.abs(zero).max(initial=0.0))]
    worst.append(float(np.max(-linear, initial=0.0)))
    worst += [-float(np.linalg.eigvalsh(m).min()) for m in matrices]
    return max(worst)


# ---- identities --------------------------------------------------------------------------


@pytest.mark.parametrize("solver", sorted(SOLVERS))
@pytest.mark.parametrize("name", sorted(closed_forms()))
def test_solutions_satisfy_the_identities_of_the_convention(name, solver):
    problem, order, expected = closed_forms()[name]
    tolerance = SOLVERS[solver]
    program = assemble(relax(problem, order), problem.objective)
    solution = solve_conic(program, solver)
    assert solution.status in ("solved", "almost")
    assert solution.solver == solver
    y, s, z = solution.y, solution.s, solution.z
    assert (y.size, s.size, z.size) == (program.q.size, program.b.size, program.b.size)
    assert np.allclose(program.A @ y + s, program.b, rtol=0, atol=1e-12 * (1 + np.abs(s).max()))
    assert distance_to_cone(program.cones, s, dual=False) <= tolerance
    assert distance_to_cone(program.cones, z, dual=True) <= tolerance
    stationarity = np.abs(program.q + program.A.T @ z).max()
    assert stationarity <= tolerance
    assert solution.residual == pytest.approx(stationarity, rel=1e-6, abs=1e-15)
    assert abs(s @ z) <= tolerance * (1 + abs(expected)) * 3
    assert solution.primal == pytest.approx(program.q @ y + program.offset, abs=1e-12)
    assert solution.dual == pytest.approx(program.offset - program.b @ z, abs=1e-12)
    assert solution.primal == pytest.approx(expected, abs=tolerance * (1 + abs(expected)))
    assert solution.dual == pytest.approx(expected, abs=tolerance * (1 + abs(expected)))


def test_the_sum_of_squares_form_is_stationary_to_rounding_level():
    for problem, order, _ in closed_forms().values():
        program = assemble(relax(problem, order), problem.objective)
        assert solve_conic(program, "clarabel").residual <= 1e-8


def test_weak_duality_holds_for_any_multipliers_in_the_cone():
    """q'y - (-b'z) = s'z + (q + A'z)'y for every y, z: the identity behind every bound."""
    rng = np.random.default_rng(0)
    problem, order, _ = closed_forms()["halfplane"]
    program = assemble(relax(problem, order), problem.objective)
    for _ in range(5):
        y, z = rng.normal(size=program.q.size), rng.normal(size=program.b.size)
        s = program.b - program.A @ y
        gap = program.q @ y + program.b @ z
        assert gap == pytest.approx(s @ z + (program.q + program.A.T @ z) @ y, abs=1e-9)


# ---- infeasible and unbounded ------------------------------------------------------------


def infeasible():
    x, y = sp.variables(2)
    return {
        "square is negative": Problem(x, [x**2 == -1]),
        "rows contradict": Problem(x + y, [x + y >= 2, x + y <= 1], -1, 1),
        "outside the box": Problem(x, [x * y == 2], -1, 1),
    }


@pytest.mark.parametrize("solver", ["clarabel", "clarabel-moment"])
@pytest.mark.parametrize("name", sorted(infeasible()))
def test_infeasible_programs_come_with_a_farkas_ray(name, solver):
    """z in K*, A'z = 0 and b'z < 0: then s'z = b'z < 0 for no s in K."""
    problem = infeasible()[name]
    program = assemble(relax(problem, 1), problem.objective)
    solution = solve_conic(program, solver)
    assert solution.status == "infeasible"
    size = -float(program.b @ solution.z)
    assert size > 0
    ray = solution.z / size
    assert np.abs(program.A.T @ ray).max() <= 1e-6
    assert distance_to_cone(program.cones, ray, dual=True) <= 1e-6


@pytest.mark.parametrize("solver", ["cvxpy:CLARABEL", "cvxpy:SCS"])
def test_infeasible_programs_are_recognised_by_cvxpy_too(solver):
    problem = infeasible()["rows contradict"]
    program = assemble(relax(problem, 1), problem.objective)
    assert solve_conic(program, solver).status == "infeasible"


@pytest.mark.parametrize("solver", ["clarabel", "clarabel-moment", "cvxpy:CLARABEL"])
def test_unbounded_programs_are_called_unbounded(solver):
    x, y = sp.variables(2)
    problem = Problem(x * y, [x**2 >= y**2])
    program = assemble(relax(problem, 1), problem.objective)
    assert solve_conic(program, solver).status == "unbounded"


# ---- assembling --------------------------------------------------------------------------


def test_the_offset_is_the_constant_of_the_objective():
    x, y = sp.variables(2)
    relaxation = relax(Problem(x * y, lower=-1, upper=1), 1)
    plain, moved = assemble(relaxation, x * y), assemble(relaxation, x * y + 7.5)
    assert moved.offset == plain.offset + 7.5
    assert np.array_equal(moved.q, plain.q)
    values = [solve_conic(p).dual for p in (plain, moved)]
    assert values[1] - values[0] == pytest.approx(7.5, abs=1e-6)


def test_cones_count_their_rows():
    assert Cones(3, 2, (1, 2, 4)).rows == 3 + 2 + 1 + 3 + 10
    assert Cones(0, 0, ()).rows == 0


def test_split_dual_gives_matrices_with_the_same_inner_products():
    """z's = sum of <Z, S> over the blocks, in the order of the groups."""
    x, y = sp.variables(2)
    relaxation = relax(Problem(x * y, [x**2 + y**2 == 1, x >= y], -1, 1), 2)
    program = assemble(relaxation, x * y)
    rng = np.random.default_rng(3)
    z, s = rng.normal(size=program.b.size), rng.normal(size=program.b.size)
    z_parts, s_parts = split_dual(relaxation, z), split_dual(relaxation, s)
    total = 0.0
    for group, left, right in zip(relaxation.groups, z_parts, s_parts, strict=True):
        shape = (group.size,) if group.free else (group.size, group.size)
        assert left.shape == (group.count, *shape)
        if not group.free:
            assert np.array_equal(left, np.swapaxes(left, 1, 2))
        total += float(np.sum(left * right))
    assert total == pytest.approx(z @ s, abs=1e-9)


def test_split_dual_agrees_with_the_upper_triangle_by_columns():
    x, y = sp.variables(2)
    relaxation = relax(Problem(x * y, [x**2 == y], -1, 1), 1)
    program = assemble(relaxation, x * y)
    z = np.arange(1.0, program.b.size + 1)
    zero, linear, matrices = parts(program.cones, z)
    found = split_dual(relaxation, z)
    free = np.concatenate(
        [p.ravel() for p, g in zip(found, relaxation.groups, strict=True) if g.free]
    )
    rest = [m for p, g in zip(found, relaxation.groups, strict=True) if not g.free for m in p]
    assert np.array_equal(free, zero)
    assert np.allclose([float(m[0, 0]) for m in rest if m.size == 1], linear)
    for a, b in zip([m for m in rest if m.size > 1], matrices, strict=True):
        assert np.allclose(a, b, rtol=1e-15)


# ---- files -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    ["program.npz", "program", "program.dat"],
)
def test_a_saved_program_is_read_back_to_the_last_bit(tmp_path, name):
    problem, order, _ = closed_forms()["triangle"]
    program = assemble(relax(problem, order), problem.objective + 0.1)
    path = tmp_path / name
    program.save(path)
    back = ConicProgram.load(path)
    assert np.array_equal(back.q, program.q)
    assert np.array_equal(back.b, program.b)
    assert np.array_equal(back.A.toarray(), program.A.toarray())
    assert back.A.shape == program.A.shape
    assert back.cones == program.cones
    assert back.offset == program.offset
    assert back.cones.rows == back.b.size


def test_a_program_without_blocks_is_read_back(tmp_path):
    program = ConicProgram(
        np.array([1.0]), sps.csc_array(np.array([[-1.0]])), np.array([0.0]), Cones(0, 1, ())
    )
    program.save(tmp_path / "p.npz")
    assert ConicProgram.load(tmp_path / "p.npz").cones == Cones(0, 1, ())


def write_nothing(path):
    pass


def write_text(path):
    path.write_text("min x1")


def write_broken_archive(path):
    path.write_bytes(b"PK\x03\x04 no archive")


def write_empty(path):
    path.write_bytes(b"")


def write_other_archive(path):
    np.savez(path, a=np.zeros(2))


def write_plain_array(path):
    with path.open("wb") as file:
        np.save(file, np.zeros(2))


@pytest.mark.filterwarnings("ignore::ResourceWarning")  # numpy leaves a broken archive open
@pytest.mark.parametrize(
    "write",
    [
        write_nothing,
        write_text,
        write_other_archive,
        write_broken_archive,
        write_empty,
        write_plain_array,
    ],
)
def test_what_is_no_saved_program_is_refused_with_its_path(tmp_path, write):
    path = tmp_path / "bad.npz"
    write(path)
    with pytest.raises(FormatError, match=f"^{re.escape(str(path))}: expected a saved conic"):
        ConicProgram.load(path)
    gc.collect()


# ---- names of solvers --------------------------------------------------------------------


@pytest.mark.parametrize("name", ["sedumi", "", "Clarabel", "cvxpy", "cvxpy:NOPE", "cvxpy:"])
def test_unknown_solvers_are_refused_with_what_there_is(name):
    problem, order, _ = closed_forms()["interval"]
    program = assemble(relax(problem, order), problem.objective)
    with pytest.raises(SolverNotFound, match="solver: .*found"):
        solve_conic(program, name)


def test_the_names_offered_are_the_names_accepted():
    problem, order, expected = closed_forms()["interval"]
    program = assemble(relax(problem, order), problem.objective)
    for name in solver_names():
        solution = solve_conic(program, name.replace("NAME", "clarabel"))
        assert solution.dual == pytest.approx(expected, abs=1e-4)


def test_programs_are_not_modified_by_solving():
    problem, order, _ = closed_forms()["corner"]
    program = assemble(relax(problem, order), problem.objective)
    copy = replace(program, q=program.q.copy(), A=program.A.copy(), b=program.b.copy())
    for solver in sorted(SOLVERS):
        solve_conic(program, solver)
    assert np.array_equal(program.q, copy.q)
    assert np.array_equal(program.b, copy.b)
    assert np.array_equal(program.A.toarray(), copy.A.toarray())
