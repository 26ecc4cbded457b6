"""Polynomials as tables of exact rationals, the oracle of their arithmetic."""

from fractions import Fraction

import sympy

import sparsepop_py as sp

N = 3


SYMBOLS = sympy.symbols("x1:4")


def build(table):
    """A polynomial from exponents -> coefficients, made by arithmetic of variables."""
    x = sp.variables(N)
    terms = [c * x[0] ** e[0] * x[1] ** e[1] * x[2] ** e[2] for e, c in table.items()]
    return sp.total([x[0] * 0.0, *terms])


def read(polynomial):
    """Exponents -> Fraction of a polynomial."""
    rows = polynomial.exponents.toarray().tolist()
    values = polynomial.coefficients.tolist()
    return {tuple(e): Fraction(c) for e, c in zip(rows, values, strict=True)}


def clean(table):
    return {e: Fraction(c) for e, c in table.items() if c}


def added(left, right, sign=1):
    keys = {*left, *right}
    return clean({e: Fraction(left.get(e, 0)) + sign * Fraction(right.get(e, 0)) for e in keys})


def multiplied(left, right):
    result = {}
    for e, c in left.items():
        for f, d in right.items():
            key = tuple(a + b for a, b in zip(e, f, strict=True))
            result[key] = result.get(key, Fraction(0)) + Fraction(c) * Fraction(d)
    return clean(result)


def raised(table, power):
    result = {(0,) * N: Fraction(1)}
    for _ in range(power):
        result = multiplied(result, table)
    return result


def as_sympy(table):
    terms = (
        sympy.Rational(Fraction(c)) * sympy.prod(s**k for s, k in zip(SYMBOLS, e, strict=True))
        for e, c in table.items()
    )
    return sympy.Add(*terms)


def from_sympy(expression):
    return clean(
        {e: Fraction(int(c.p), int(c.q)) for e, c in sympy.Poly(expression, *SYMBOLS).terms()}
    )


def read2(polynomial):
    rows = polynomial.exponents.toarray().tolist()
    return dict(zip(map(tuple, rows), polynomial.coefficients.tolist(), strict=True))
