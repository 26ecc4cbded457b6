"""Ratios of polynomials: arithmetic against evaluation by hand, refusals."""

from fractions import Fraction

import numpy as np
import pytest

import sparsepop_py as sp

X, Y = sp.variables(2)


def test_arithmetic_agrees_with_fractions():
    f, g = X / (1 + Y**2), (Y - 2) / (3 + X**2)
    cases = {
        "sum": (f + g, lambda a, b: a / (1 + b * b) + (b - 2) / (3 + a * a)),
        "less": (2 - f, lambda a, b: 2 - a / (1 + b * b)),
        "times": (f * g, lambda a, b: a / (1 + b * b) * (b - 2) / (3 + a * a)),
        "mixed": ((1 + f) * (Y + 1), lambda a, b: (1 + a / (1 + b * b)) * (b + 1)),
        "cross": ((1 + f) * (Y + f), lambda a, b: (1 + a / (1 + b * b)) * (b + a / (1 + b * b))),
        "power": (f**2, lambda a, b: (a / (1 + b * b)) ** 2),
        "number": (4 / (1 + X**2), lambda a, b: 4 / (1 + a * a)),
        "twice": (f / (2 + Y**2) / 2, lambda a, b: a / (1 + b * b) / (2 + b * b) / 2),
        "whole": ((X + f) / (1 + X**2), lambda a, b: (a + a / (1 + b * b)) / (1 + a * a)),
    }  # fmt: skip
    for a, b in ((Fraction(1), Fraction(2)), (Fraction(-3, 2), Fraction(1, 4))):
        for name, (rational, exact) in cases.items():
            value = rational([float(a), float(b)])
            assert value == pytest.approx(float(exact(a, b)), rel=1e-14), name


def test_equal_denominators_are_merged_and_others_are_not():
    f = X / (1 + X**2) + Y / (1 + Y**2) + 3 / (1 + X**2)
    assert [str(p) for p, _ in f.ratios] == ["3 + x1", "x2"]


def test_a_numerator_that_cancels_keeps_its_denominator():
    f = X / Y - X / Y
    assert len(f.ratios) == 1 and f.ratios[0][0].terms == 0  # x/y - x/y has no value at y = 0


def test_comparisons_with_one_ratio_make_one_fraction():
    row = X / (1 + Y**2) <= 2
    assert row.expression.is_fraction
    assert str(row) == "(2 - x1 + 2*x2^2)/(1 + x2^2) >= 0"
    reflected = X + 1 >= X / (1 + Y**2)
    assert str(reflected) == "(1 + x2^2 + x1*x2^2)/(1 + x2^2) >= 0"
    two = X / (1 + Y**2) + Y / (1 + X**2) >= 1
    assert not two.expression.is_fraction and two.expression.whole.constant_term == -1
    assert (X / Y == 2).kind is sp.Kind.ZERO


def test_many_points_are_evaluated_at_once():
    f = X / (1 + Y**2)
    np.testing.assert_array_equal(f([[1.0, 0.0], [2.0, 1.0]]), [1.0, 1.0])


def test_constants_divide_as_numbers():
    assert isinstance(X / (0 * X + 2), sp.Polynomial)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: X / (X / Y), "division by a ratio"),
        (lambda: 1 / (X / Y), "division by a ratio"),
        (lambda: X / (0 * X), "expected one with variables"),
        (lambda: sp.ratio(X, 2), "denominator: found int"),
        (lambda: sp.ratio("x", X), "numerator: found str"),
        (lambda: X / sp.variables(3)[0], "2 and 3 variables|3 and 2 variables"),
        (lambda: (X / Y) ** -1, "exponent: found -1"),
        (lambda: (X / Y) > 1, "strict inequalities"),
        (lambda: bool(X / Y >= 1), "no truth value"),
        (lambda: sp.Rational(X, ((X, Y), (1 + X, Y))), "a denominator twice"),
    ],
)
def test_refusals(make, message):
    with pytest.raises(sp.ProblemError, match=message):
        make()
