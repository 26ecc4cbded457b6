"""Boxes from an exact Gram matrix of the objective: quartics under equations, without bounds."""

from __future__ import annotations

import numpy as np
import pytest

import sparsepop_py as sp


def quartic():
    """Problem 79 of Hock and Schittkowski, Lect. Notes Econ. Math. Syst. 187 (1981)."""
    x = sp.variables(5)
    f = (x[0] - 1) ** 2 + (x[0] - x[1]) ** 2 + (x[1] - x[2]) ** 2
    f = f + (x[2] - x[3]) ** 4 + (x[3] - x[4]) ** 4
    root = 2**0.5
    rows = [x[0] + x[1] ** 2 + x[2] ** 3 == 2 + 3 * root, x[1] - x[2] ** 2 + x[3] == -2 + 2 * root]
    return sp.Problem(f, [*rows, x[0] * x[4] == 2])


@pytest.mark.parametrize("effort", [pytest.param("presolve", marks=pytest.mark.slow), "auto"])
def test_a_quartic_in_free_variables_under_nonlinear_equations(effort):
    """Its least value is 0.0787768 (loc. cit.); before, 0 was proved, by the squares alone."""
    result = sp.solve(quartic(), sp.Options(effort=effort, time_limit=60))
    assert result.status == "OPTIMAL"
    assert result.lower_bound == pytest.approx(0.0787768, abs=2e-6)
    again = sp.from_json(sp.to_json(result))
    assert again.lower_bound == result.lower_bound
    steps = [type(step).__name__ for step in result.certificate.box.steps]
    assert "Tightening" in steps


def test_the_box_is_that_of_an_ellipse():
    """Where (x - y)^2 + y^2 <= 2: |x| <= 2, |y| <= sqrt(2); x y = 1 at (1, 1) attains 1."""
    x, y = sp.variables(2)
    problem = sp.Problem((x - y) ** 2 + y**2, [x * y == 1])
    result = sp.solve(problem)
    least = 2 * 2**0.5 - 2  # x = sqrt(2) y, y^4 = 1/2
    assert result.lower_bound <= least + 1e-12 <= result.upper_bound + 1e-9
    assert np.isclose(result.lower_bound, least, rtol=0, atol=1e-5)
