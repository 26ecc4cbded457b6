"""The repair of the dual: it removes the residual and stays in the cone."""

from dataclasses import replace

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py import Problem
from sparsepop_py.solvers import cliquetree
from sparsepop_py.solvers.cliquetree.iterations.numbers import Numbers
from sparsepop_py.solvers.cliquetree.iterations.repair import Repair, safe_value
from sparsepop_py.solvers.cliquetree.kernels.batched import OutOfTime


@pytest.fixture
def solved():
    """Numbers and last point of a program with equalities, inequalities and blocks."""
    x = sp.variables(5)
    f = x[0] * x[1] + x[1] * x[2] - x[3] * x[4]
    problem = Problem(f, [x[0] + x[1] * x[2] == 0.25, x[3] - x[4] <= 0.5], -1, 1)
    program = sp.assemble(sp.relax(problem, 2, lean=True), f)
    done = cliquetree.run(program, settings=cliquetree.Settings(gap=1e-3, accepted=1e-3))
    return Numbers.of(program, done.symbolic), done.outcome.iterate


def residual(n, at):
    return np.abs(n.q + n.Ct @ at.z + n.Et @ at.w).sum()


def test_a_disturbed_dual_is_repaired_inside_the_cone(solved):
    numbers, point = solved
    rng = np.random.default_rng(0)
    noise = numbers.C @ rng.normal(size=numbers.q.size)
    disturbed = replace(point, z=point.z + 1e-9 * noise, w=point.w + 1e-6)
    repaired = Repair(numbers, numbers.factor())(disturbed)
    assert residual(numbers, repaired) < 1e-3 * residual(numbers, disturbed)
    assert safe_value(numbers, repaired) > safe_value(numbers, disturbed)
    numbers.cone.inverse_factor(repaired.z)  # raises outside


@pytest.mark.parametrize("size", [1e-6, 1e-2, 1.0, 1e3])
def test_the_result_is_better_and_inside_or_the_same_point(solved, size):
    numbers, point = solved
    rng = np.random.default_rng(1)
    moved = replace(point, w=point.w + size * rng.normal(size=point.w.size))
    repaired = Repair(numbers, numbers.factor())(moved)
    if repaired is not moved:
        assert safe_value(numbers, repaired) > safe_value(numbers, moved)
        numbers.cone.inverse_factor(repaired.z)


def test_what_would_leave_the_cone_stays_as_it_was(solved):
    numbers, point = solved
    outside = replace(point, z=point.z - 1e3 * (numbers.C @ np.ones(numbers.q.size)) ** 2)
    assert Repair(numbers, numbers.factor())(outside) is outside


def test_the_clock_is_kept(solved):
    numbers, point = solved
    with pytest.raises(OutOfTime):
        Repair(numbers, numbers.factor(), deadline=0.0)(point)
