"""Exact values of polynomials, ratios, cones and matrices at points of rationals."""

from __future__ import annotations

from fractions import Fraction

import sparsepop_py as sp

__all__ = ["Point", "is_feasible", "value_at"]

Point = tuple[Fraction, ...]


def value_at(expression: sp.Polynomial | sp.Rational, point: Point) -> Fraction:
    """Evaluate a polynomial or a sum of ratios.

    Parameters
    ----------
    expression : Polynomial or Rational
        Without a denominator that vanishes at the point.
    point : tuple of Fraction

    Returns
    -------
    Fraction
    """
    if isinstance(expression, sp.Rational):
        parts = (value_at(p, point) / value_at(q, point) for p, q in expression.ratios)
        return sum(parts, value_at(expression.whole, point))
    total = Fraction(0)
    for word, value in zip(
        expression.words.tolist(), expression.coefficients.tolist(), strict=True
    ):
        term = Fraction(value)
        for letter in word:
            term *= point[letter - 1] if letter else 1
        total += term
    return total


def is_feasible(problem: sp.Problem | sp.RationalProblem, point: Point) -> bool:
    """Check bounds and rows.

    Parameters
    ----------
    problem : Problem or RationalProblem
    point : tuple of Fraction

    Returns
    -------
    bool
    """
    ends = zip(point, problem.lower.tolist(), problem.upper.tolist(), strict=True)
    return all(low <= x <= high for x, low, high in ends) and all(
        _holds(row, point) for row in problem.constraints
    )


def _holds(row: sp.Constraint | sp.RationalConstraint, point: Point) -> bool:
    if row.kind.is_matrix and isinstance(row, sp.Constraint):
        return _is_semidefinite(_matrix(row, point))
    expression = row.polynomial if isinstance(row, sp.Constraint) else row.expression
    value = value_at(expression, point)
    return value == 0 if row.kind is sp.Kind.ZERO else value >= 0


def _matrix(row: sp.Constraint, point: Point) -> list[list[Fraction]]:
    """A cone is an arrow matrix."""
    values = [value_at(entry, point) for entry in row.entries]
    places = [[row.position(i, j) for j in range(row.side)] for i in range(row.side)]
    return [[Fraction(0) if k is None else values[k] for k in line] for line in places]


def _is_semidefinite(matrix: list[list[Fraction]]) -> bool:
    """Eliminate: pivots are positive, or zero with nothing beside them."""
    rest = [list(line) for line in matrix]
    while rest:
        (pivot, *beside), *lower = rest
        if pivot < 0 or (pivot == 0 and any(beside)):
            return False
        rest = [
            [
                v - (line[0] * w / pivot if pivot else 0)
                for v, w in zip(line[1:], beside, strict=True)
            ]
            for line in lower
        ]
    return True
