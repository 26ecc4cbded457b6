"""Pooling and separation problems are closed by effort "auto".

Optima: Handbook of Test Problems in Local and Global Optimization (Floudas et al. 1999),
5.2.5 and 5.3.2; SCIP finds 1.86415945 for the second.
"""

from __future__ import annotations

import numpy as np
import pytest

import sparsepop_py as sp
from benchmarks.problems import networks


def test_the_pooling_problem_is_the_one_of_the_handbook():
    problem = networks.pooling().problem
    assert problem.dimension == 32 and len(problem.constraints) == 19
    # at full demand all of the fifth source: each product pays price - 10 a unit
    x = np.zeros(32)
    x[:3] = 1.0  # pools of the first source, empty
    x[12:17] = [0, 200, 100, 0, 0]
    assert problem.objective(x) == -(5 * 200 + 9 * 100)
    assert problem.violation(x) == pytest.approx(100 + 0.0)  # quality of the second product


@pytest.mark.parametrize("make", [networks.pooling, networks.separation])
@pytest.mark.slow
def test_networks_are_closed_and_proved(make):
    context = make()
    result = sp.solve(context.problem, sp.Options(effort="auto", gap=1e-5, gap_kind="relative"))
    assert result.status is sp.Status.OPTIMAL
    assert result.lower_bound <= context.optimum + 1e-7 * abs(context.optimum)
    assert result.upper_bound == pytest.approx(context.optimum, rel=2e-5)
    assert result.certificate.verify(context.problem).ok
