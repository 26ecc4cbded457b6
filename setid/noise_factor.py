"""Problems in which one more unknown, s, multiplies all noise bounds."""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp

from .boxes import ParameterBox
from .formulation import Formulation
from .noise import Noise

__all__ = ["last_variable", "linear_problem", "problem_with_factor", "scaled_noise"]


def scaled_noise(bounds: tuple[NDArray, ...], factor: float) -> Noise:
    """Noise bounds times a factor, rounded up."""
    parts = [np.where(b > 0, np.nextafter(b * factor, inf), 0.0) for b in bounds]
    if factor == 1.0:
        parts = list(bounds)
    return Noise(output=parts[0], input=parts[1], equation=parts[2])


def linear_problem(formulation: Formulation) -> sp.Problem:
    """Rows abs(Y + R theta) <= s w0 and the priors, in theta and s."""
    rows, problem = formulation.regression, formulation.problem
    assert rows is not None
    *theta, s = sp.variables(problem.dimension + 1, (*problem.names, "noise factor"))
    lines = []
    for y, r, w in zip(rows.target, rows.regressors, rows.radius, strict=True):
        left = sp.total([float(y), *(float(c) * x for c, x in zip(r, theta, strict=True)), 0.0 * s])
        lines += [float(w) * s - left >= 0, float(w) * s + left >= 0]
    lines += [_lifted(problem, row) for row in _prior_rows(formulation)]
    return sp.Problem(s, lines, np.append(problem.lower, 0.0), np.append(problem.upper, inf))


def _prior_rows(formulation: Formulation) -> list[int]:
    return [i for i, origin in enumerate(formulation.rows.origin) if origin == "prior"]


def _lifted(problem: sp.Problem, row: int, extra: sp.Polynomial | None = None) -> sp.Constraint:
    """A constraint in one more variable, and something added to it."""
    constraint, n = problem.constraints[row], problem.dimension
    p = constraint.polynomial
    wide = sp.Polynomial(p.words, p.coefficients, n + 1)
    return sp.Constraint(wide if extra is None else wide + extra, constraint.kind, constraint.name)


def last_variable(problem: sp.Problem) -> sp.Polynomial:
    """The factor, as a polynomial."""
    word = np.array([[problem.dimension]], np.int32)
    return sp.Polynomial.from_words(word, np.ones(1), problem.dimension)


def problem_with_factor(
    formulation: Formulation, box: ParameterBox | None, scaled: float | None = None
) -> sp.Problem:
    """The problem with one more unknown in [0, 1] that multiplies all noise bounds.

    Parameters
    ----------
    formulation : Formulation
    box : ParameterBox or None
    scaled : float, optional
        The part of each output noise bound that it multiplies, and nothing else.
    """
    problem, layout = formulation.problem, formulation.layout
    n, p = problem.dimension, len(formulation.parameters)
    variables = sp.variables(n + 1, (*problem.names, "noise factor"))
    s = variables[-1]
    width = formulation.noise.bounds(formulation.data)[2]
    rows, starts, lines = formulation.rows, formulation.data.starts, []
    inequality = sp.Kind.NONNEGATIVE if scaled is None else None
    for row, origin in enumerate(rows.origin):
        extra = None
        if origin == "model" and problem.constraints[row].kind is inequality:
            sample = int(starts[rows.record[row] - 1] + rows.sample[row] - 1)
            size = float(width[sample, int(rows.equation[row][1:]) - 1])
            spare = 4e-16 * (abs(problem.constraints[row].polynomial.constant_term) + size)
            extra = size * s - (size - spare)  # the bound is size s instead of size
        lines.append(_lifted(problem, row, extra))
    for group in ("eta", "xi") if scaled is None else ("eta",):
        numbers = layout.group(group)
        for number in numbers[numbers >= 0].tolist():
            size = float(problem.upper[number])
            part = size if scaled is None else min(scaled, size)
            limit = part * s + (float(np.nextafter(size - part, inf)) if part < size else 0.0)
            lines += [limit - variables[number] >= 0, limit + variables[number] >= 0]
    lower, upper = np.append(problem.lower, 0.0), np.append(problem.upper, 1.0)
    if box is not None and not box.empty:
        lower[:p], upper[:p] = np.maximum(lower[:p], box.lower), np.minimum(upper[:p], box.upper)
    return sp.Problem(s, lines, lower, upper)
