"""What every solved problem must satisfy, and problems with known answers."""

from __future__ import annotations

import numpy as np

import sparsepop_py as sp

INF = np.inf


def check(problem, result, optimum=None, tight=1e-5):
    """What holds of every result; and with ``optimum``, that it lies between the bounds."""
    assert result.lower_bound <= result.upper_bound
    if result.certificate is None:
        assert result.lower_bound == -INF
    else:
        assert result.certificate.verify(problem).ok
        assert result.certificate.bound == result.lower_bound
    if result.attained is not None:
        assert problem.violation(result.x) <= 1e-8
        assert result.attained.recheck(problem) is not None
    if optimum is not None:
        rounding = 1e-12 * (1 + abs(optimum))
        assert result.lower_bound <= optimum + rounding
        assert result.upper_bound >= optimum - rounding
        assert result.lower_bound >= optimum - tight * max(1.0, abs(optimum))
    return result


LAB_OPTIMUM = 52.7066065447  # 10 digits: min over x1 > 7 of f(x1, 10 / (x1 - 7)), see below


def double_well_chain(n):
    """sum (x_i^2 - 1)^2 + sum (x_i - x_{i+1})^2: 0 at +-(1, ..., 1)."""
    x = sp.variables(n)
    wells = [(v**2 - 1) ** 2 for v in x]
    return sp.Problem(sp.total(wells + [(a - b) ** 2 for a, b in zip(x, x[1:], strict=False)]))


def region():
    x, y = sp.variables(2)
    rows = [x**2 + y**2 <= 1, x + y >= -0.5, x * y <= 0.25]
    return sp.Problem(0.0 * x, rows), [x, -x, y, -y, x * y, x - 2 * y]
