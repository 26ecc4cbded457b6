"""Clarabel in a process of its own: the same solutions, and an end with the time limit."""

from __future__ import annotations

import time

import numpy as np

import sparsepop_py as sp
from sparsepop_py import solvers
from sparsepop_py.budget import cpu_seconds
from sparsepop_py.solvers import clarabel_


def test_a_process_of_its_own_returns_the_same(monkeypatch) -> None:
    """With a time limit large programs are solved apart, so that their iterations can be ended."""
    x, y = sp.variables(2)
    problem = sp.Problem(x**4 - 3 * x * y + y**2, [x**2 + y**2 <= 2])
    program = sp.assemble(sp.relax(problem, 2), problem.objective)
    for solver in ("clarabel", "clarabel-moment"):
        here = sp.solve_conic(program, solver, 60.0)
        monkeypatch.setattr(clarabel_, "_LARGE", 0)
        before = time.process_time(), cpu_seconds()
        apart = sp.solve_conic(program, solver, 60.0)
        assert cpu_seconds() - before[1] > time.process_time() - before[0]
        monkeypatch.undo()
        assert (apart.status, apart.iterations) == (here.status, here.iterations)
        np.testing.assert_array_equal(apart.z, here.z)
        np.testing.assert_array_equal(apart.y, here.y)


def test_a_process_of_its_own_ends_with_the_limit(monkeypatch) -> None:
    """The process takes longer to start than the limit."""
    x, y = sp.variables(2)
    problem = sp.Problem(x**4 - 3 * x * y + y**2, [x**2 + y**2 <= 2])
    program = sp.assemble(sp.relax(problem, 2), problem.objective)
    monkeypatch.setattr(clarabel_, "_LARGE", 0)
    monkeypatch.setattr(solvers, "_UNSTOPPABLE", ())
    found = sp.solve_conic(program, "clarabel", 1e-3)
    assert (found.status, found.detail, found.iterations) == ("failed", "MaxTime", 0)
    assert not found.z.any()
    result = sp.solve(problem, sp.Options(effort="plain", order=2, time_limit=1e-2))
    assert result.status is sp.Status.LIMIT and result.lower_bound == -np.inf
