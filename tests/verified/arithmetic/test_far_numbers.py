"""Numbers at the ends of what doubles hold: bounds stay proved, and nothing overflows."""

from __future__ import annotations

import pytest

import sparsepop_py as sp

x, y = sp.variables(2)
FAR = 1e308


@pytest.mark.parametrize("effort", ["presolve", "auto"])
@pytest.mark.parametrize(
    "problem, least",
    [
        (sp.Problem(x, [1e-300 * x >= -1e300], -1, 1), -1.0),  # the row's bound is no double
        (sp.Problem(x, lower=-FAR, upper=FAR), -FAR),  # the width is none
        (sp.Problem(x + y, [1e-300 * y >= 1e-300], -2, 2), -1.0),
        (sp.Problem(1e300 * x, [x**2 + y**2 <= 1]), -1e300),
    ],
)
def test_the_bound_is_proved_and_near(problem, least, effort):
    result = sp.solve(problem, sp.Options(effort=effort, time_limit=2.0))
    assert least * (1 + 1e-6) <= result.lower_bound <= least
    assert result.certificate.verify(problem).ok


def test_a_row_beyond_all_doubles_leaves_no_point():
    problem = sp.Problem(x, [1e-300 * x >= 1e300], -1, 1)
    assert sp.solve(problem).status is sp.Status.INFEASIBLE
