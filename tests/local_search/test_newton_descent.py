"""Newton and Gauss-Newton descents find known minimisers, with dense and with sparse matrices."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.local_search.newton_descent import newton_polish, zeros_of_squares

SIZES = [2, 10, 60, 61, 100]  # sparse from 61 on


@pytest.mark.parametrize("n", SIZES)
def test_zeros_of_squares_are_found(n: int) -> None:
    """Rosenbrock's squares vanish at (1, ..., 1) alone."""
    x = zeros_of_squares(sp.problems.rosenbrock(n), np.full(n, 0.5), inf)
    assert np.allclose(x[1:], 1.0, atol=1e-6) and np.allclose(np.abs(x[0]), 1.0, atol=1e-6)


@pytest.mark.parametrize("n", SIZES)
def test_minimisers_at_bounds_are_found(n: int) -> None:
    """Of the sum of x^4 - 32 x, which falls up to 2, over x <= 1 for every other variable."""
    x = sp.variables(n)
    upper = [1.0 if k % 2 else inf for k in range(n)]
    problem = sp.Problem(sum(v**4 - 32.0 * v for v in x), upper=upper)
    found = newton_polish(problem, np.full(n, 0.9), inf)
    assert np.allclose(found, np.where(np.isfinite(upper), 1.0, 2.0), atol=1e-8)
