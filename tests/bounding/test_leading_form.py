"""Polynomials whose leading forms vanish along lines: Gram matrices in other coordinates."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from slow_values import slow_after

import sparsepop_py as sp
from sparsepop_py.bounding.leading_form import coordinates_of_leading_form
from sparsepop_py.bounding.unconstrained import may_be_squares


def goldstein_price():
    """Goldstein and Price, Math. Comp. 25 (1971) 569-574: least value 3, at (0, -1)."""
    x, y = sp.variables(2)
    first = 1 + (x + y + 1) ** 2 * (19 - 14 * x + 3 * x**2 - 14 * y + 6 * x * y + 3 * y**2)
    inner = 18 - 32 * x + 12 * x**2 + 48 * y - 36 * x * y + 27 * y**2
    return first * (30 + (2 * x - 3 * y) ** 2 * inner)


@pytest.mark.parametrize("effort", slow_after(1, ["auto", "presolve"]))
def test_goldstein_and_price(effort):
    problem = sp.Problem(goldstein_price())
    result = sp.solve(problem, sp.Options(effort=effort, time_limit=60))
    assert result.status == "OPTIMAL"
    assert 3.0 - 3e-6 <= result.lower_bound <= 3.0 <= result.upper_bound
    assert result.certificate.verify(problem).ok
    again = sp.from_json(sp.to_json(result))
    assert again.certificate.verify(problem).bound >= result.lower_bound


@pytest.mark.slow
def test_a_product_of_quartics_of_two_forms():
    """u = x + 2 y and v = x - y are free: ((u - 1)^4 + 1)((v - 7)^4 + 3) has the minimum 3."""
    x, y = sp.variables(2)
    problem = sp.Problem(((x + 2 * y - 1) ** 4 + 1) * ((x - y - 7) ** 4 + 3))
    result = sp.solve(problem, sp.Options(effort="auto", time_limit=60))
    assert 3.0 - 1e-4 <= result.lower_bound <= 3.0


@pytest.mark.parametrize("form", list(product((1, -2, 5, 0), (1, 3, -7, 0))))
def test_coordinates_are_exact(form):
    """(a x + b y)^4 + x^2 + y: one line, completed to coordinates of determinant 1."""
    x, y = sp.variables(2)
    a, b = form
    objective = (a * x + b * y) ** 4 + x**2 + y
    found = coordinates_of_leading_form(objective)
    if a * b == 0:
        assert found is None
        return
    matrix = np.array(found.forms, float)
    assert abs(round(np.linalg.det(matrix))) == 1
    for point in np.array(list(product(range(-3, 4), repeat=2)), float):
        assert found.polynomial(matrix @ point) == objective(point)
    assert found.polynomial.exponents.toarray()[:, 1].max() <= 2


def test_definite_leading_forms_and_other_dimensions_have_no_lines():
    x, y, z = sp.variables(3)
    assert coordinates_of_leading_form((x + y) ** 4 + z) is None
    x, y = sp.variables(2)
    assert coordinates_of_leading_form(x**4 + y**4) is None
    assert coordinates_of_leading_form((x**2 - 2 * y**2) ** 2) is None  # irrational slopes


@pytest.mark.parametrize("effort", ["plain", "presolve", "auto"])
def test_squares_on_a_wide_box(effort):
    """NONSCOMP (CUTE): (x1 - 1)^2 + 4 sum (x_i - x_{i-1}^2)^2 on [-100, 100] is 0 at 1."""
    v = sp.variables(6)
    f = (v[0] - 1) ** 2 + sp.total(4 * (v[i] - v[i - 1] ** 2) ** 2 for i in range(1, 6))
    lower = np.array([1.0, -100.0] * 3)
    result = sp.solve(sp.Problem(f, (), lower, 100.0), sp.Options(effort=effort, order=2))
    assert result.status == "OPTIMAL"
    assert -1e-9 <= result.lower_bound <= 0.0
    assert result.certificate.verify(result.problem).ok


@pytest.mark.parametrize(
    ("text", "may"),
    [
        ("x1^4 + x1*x2^3 + x2^4", True),
        ("x1^4 - x1^2", True),
        ("-x1^4 + x2^2", False),
        ("x1^4 + x2^3", False),
        ("x1^2*x2^2 + x1^3", False),
    ],
)
def test_highest_powers_tell_what_is_no_sum_of_squares(text, may):
    assert may_be_squares(sp.parse(f"min {text}").objective) is may


def test_coefficients_of_lower_degree_may_be_rounded():
    """With z = 4 x + y: z^4 + x^2 + y^2 + 0.1 x y is 0 at 0; 0.7 more of x moves it below."""
    x, y = sp.variables(2)
    problem = sp.Problem((4 * x + y) ** 4 + x**2 + y**2 + 0.1 * x * y + 0.7 * x)
    result = sp.solve(problem)
    grid = np.array(list(product(np.linspace(-0.5, 0.5, 201), repeat=2)))
    assert result.status == "OPTIMAL"
    assert result.lower_bound <= problem.objective(grid).min() <= result.upper_bound + 1e-3
    assert result.certificate.verify(problem).ok
