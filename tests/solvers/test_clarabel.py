"""Clarabel in a process of its own: the same solutions, and an end with the time limit."""

from __future__ import annotations

import time

import numpy as np
import pytest
import scipy.sparse as sps

import sparsepop_py as sp
from sparsepop_py import solvers
from sparsepop_py.budget import cpu_seconds
from sparsepop_py.conic.program import Cones
from sparsepop_py.solvers import clarabel_
from sparsepop_py.solvers.interface import SolverSettings


def test_a_process_of_its_own_returns_the_same(monkeypatch) -> None:
    """With a time limit large programs are solved apart, so that their iterations can be ended."""
    x, y = sp.variables(2)
    problem = sp.Problem(x**4 - 3 * x * y + y**2, [x**2 + y**2 <= 2])
    program = sp.assemble(sp.relax(problem, 2), problem.objective)
    for solver in ("clarabel", "clarabel-moment"):
        here = sp.solve_conic(program, solver, 60.0)
        monkeypatch.setattr(clarabel_, "_may_overrun", lambda *_: True)
        before = time.process_time(), cpu_seconds()
        apart = sp.solve_conic(program, solver, 60.0)
        assert cpu_seconds() - before[1] > time.process_time() - before[0]
        monkeypatch.undo()
        assert (apart.status, apart.iterations) == (here.status, here.iterations)
        np.testing.assert_array_equal(apart.z, here.z)
        np.testing.assert_array_equal(apart.y, here.y)


def test_programs_that_are_large_for_their_limit_are_solved_apart(monkeypatch) -> None:
    """A linear program of 60 000 entries goes to a process with 10 s, not with an hour."""
    used = []
    monkeypatch.setattr(clarabel_, "Processes", lambda count: used.append(count) or 1 / 0)
    size = 60_000
    unit, ones = sps.eye_array(size, format="csc"), np.ones(size)
    free, cones = sps.csc_array((size, size)), Cones(0, size, ())

    def solved(limit: float) -> clarabel_.Output:
        """Minimise -sum(x) for x <= 1."""
        return clarabel_.run_clarabel(
            free, -ones, unit, ones, cones, SolverSettings(time_limit=limit)
        )

    np.testing.assert_allclose(solved(3600.0).x, ones, atol=1e-6)
    assert not used
    with pytest.raises(ZeroDivisionError):
        solved(10.0)
    assert used == [1]


def test_a_process_of_its_own_ends_with_the_limit(monkeypatch) -> None:
    """The process takes longer to start than the limit."""
    x, y = sp.variables(2)
    problem = sp.Problem(x**4 - 3 * x * y + y**2, [x**2 + y**2 <= 2])
    program = sp.assemble(sp.relax(problem, 2), problem.objective)
    monkeypatch.setattr(clarabel_, "_may_overrun", lambda *_: True)
    monkeypatch.setattr(solvers, "_UNSTOPPABLE", ())
    found = sp.solve_conic(program, "clarabel", 1e-3)
    assert (found.status, found.detail, found.iterations) == ("failed", "MaxTime", 0)
    assert not found.z.any()
    result = sp.solve(problem, sp.Options(effort="plain", order=2, time_limit=1e-2))
    assert result.status is sp.Status.LIMIT and result.lower_bound == -np.inf
