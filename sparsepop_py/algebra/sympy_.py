"""The door for sympy: expressions and relations in, polynomials and constraints out.

sympy is imported only when one of its objects is handed in.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import scipy.sparse as sps

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.exact_terms import ExactTerms
from sparsepop_py.algebra.matrix_constraints import SymbolicCone, cone
from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial
from sparsepop_py.algebra.rational import AnyConstraint, Rational, constraint
from sparsepop_py.errors import ProblemError

__all__ = ["convert", "convert_ratios", "natural_key"]

Reader = Callable[[Any, list[Any], list[str], str], Polynomial | Rational]


def _is_symbolic(item: Any) -> bool:
    package = (type(item).__module__ or "").partition(".")[0]  # none for applied functions
    return package == "sympy" or hasattr(item, "free_symbols")


def convert(
    objective: Any, constraints: list[Any], names: Sequence[str] | None
) -> tuple[Any, list[Any]]:
    """Replace sympy expressions, relations and cones by polynomials and constraints.

    The variables are the symbols named in ``names``, or all symbols that occur, in
    natural order (x2 before x10). The assumed sign of a symbol (``positive=True``) becomes a
    constraint, after those given. What is not symbolic passes unchanged.
    """
    return _converted(objective, constraints, names, _polynomial)


def convert_ratios(
    objective: Any, constraints: list[Any], names: Sequence[str] | None
) -> tuple[Any, list[Any]]:
    """Do the same where expressions may be sums of ratios."""
    return _converted(objective, constraints, names, _rational)


def _converted(
    objective: Any, constraints: list[Any], names: Sequence[str] | None, read: Reader
) -> tuple[Any, list[Any]]:
    parts = [objective, *constraints]
    parts += [e for row in constraints if isinstance(row, SymbolicCone) for e in row.entries]
    if not any(_is_symbolic(item) for item in parts):
        return objective, constraints
    import sympy

    if isinstance(objective, sympy.Poly) and not objective.domain.is_FiniteField:
        objective = objective.as_expr()
    given = [sympy.sympify(item) for item in parts if _is_symbolic(item)]
    if isinstance(objective, Polynomial) or any(isinstance(row, Constraint) for row in constraints):
        raise ProblemError("objective, constraints: sympy expressions and Polynomials are mixed")
    free = set().union(*(item.free_symbols for item in given))
    found = {str(symbol): symbol for symbol in free}
    labels = list(names) if names is not None else sorted(found, key=natural_key)
    missing = sorted(set(found) - set(labels))
    if missing:
        raise ProblemError(f"names: sympy symbols {', '.join(missing)} are not among the names")
    symbols = [found.get(label, sympy.Symbol(label)) for label in labels]
    if not symbols:
        raise ProblemError("objective: found no symbol, expected at least one variable")
    _check_real(symbols)
    polynomial = read(sympy.sympify(objective), symbols, labels, "objective")
    rows = [
        _constraint(row, symbols, labels, f"constraints[{number}]", read)
        for number, row in enumerate(constraints)
    ]
    return polynomial, rows + _signs(symbols, labels)


def _check_real(symbols: list[Any]) -> None:
    """Refuse symbols that are assumed to be integers, or not to be real numbers."""
    whole = [str(symbol) for symbol in symbols if symbol.is_integer]
    if whole:
        raise ProblemError(
            f"objective, constraints: found the integer symbols {', '.join(whole)}, expected real "
            "ones (b with the constraint b**2 == b is binary)"
        )
    others = [str(s) for s in symbols if s.is_commutative and s.is_extended_real is False]
    if others:
        raise ProblemError(
            f"objective, constraints: found the symbols {', '.join(others)}, which are not real, "
            "expected real ones"
        )


def _signs(symbols: list[Any], labels: list[str]) -> list[Constraint]:
    """State the assumed signs of symbols, with which sympy simplifies."""
    rows = []
    for symbol in symbols:
        sign = int(bool(symbol.is_nonnegative)) - int(bool(symbol.is_nonpositive))
        if sign:
            place = f"symbol {symbol}"
            rows.append(
                Constraint(_polynomial(sign * symbol, symbols, labels, place), Kind.NONNEGATIVE)
            )
    return rows


def natural_key(name: str) -> tuple[list[tuple[int, str]], str]:
    """Sort key of names, with their numbers as numbers of any length: x2 before x10.

    Examples
    --------
    >>> sorted(["x10", "x2", "x", "x02"], key=natural_key)
    ['x', 'x02', 'x2', 'x10']
    """
    parts = [part for part in re.split(r"(\d+)", name) if part]
    digits = [(part.isdecimal(), part.lstrip("0"), part) for part in parts]
    return [(len(short), short) if number else (-1, part) for number, short, part in digits], name


def _polynomial(expression: Any, symbols: list[Any], labels: list[str], where: str) -> Polynomial:
    import sympy

    if not isinstance(expression, sympy.Expr):  # sympy reads the equation a = b as a - b
        raise ProblemError(f"{where}: found {expression}, expected a polynomial")
    floats = {number: sympy.Rational(number) for number in expression.atoms(sympy.Float)}
    try:
        terms = sympy.Poly(expression.xreplace(floats), *symbols)  # multiplied out exactly
    except sympy.polys.polyerrors.BasePolynomialError as error:
        raise ProblemError(f"{where}: found {expression}, expected a polynomial: {error}") from None
    pairs = terms.terms() or [((0,) * len(symbols), 0)]
    exponents = np.array([powers for powers, _ in pairs], int)
    try:
        coefficients = [_fraction(value) for _, value in pairs]
    except (TypeError, ValueError, OverflowError):
        raise ProblemError(f"{where}: found {expression}, expected real coefficients") from None
    words = monomials.from_exponents(sps.csr_array(exponents))
    exact = ExactTerms.of_fractions(words, coefficients, len(symbols))
    if not all(value.is_Rational for value in terms.coeffs()):
        exact = replace(exact, followed=False)  # some were rounded before
    return Polynomial._of_exact(exact, len(symbols), tuple(labels))


def _fraction(value: Any) -> Fraction:
    """Take a rational coefficient exactly, and others as the double next to them."""
    if getattr(value, "is_Rational", False):
        return Fraction(int(value.p), int(value.q))
    return Fraction(float(value))


def _rational(
    expression: Any, symbols: list[Any], labels: list[str], where: str
) -> Polynomial | Rational:
    """Read a sum term by term, each as a numerator over a denominator."""
    import sympy

    found: Polynomial | Rational = _polynomial(sympy.Integer(0), symbols, labels, where)
    for part in sympy.Add.make_args(expression):
        numerator, denominator = sympy.fraction(sympy.together(part))
        top = _polynomial(numerator, symbols, labels, where)
        bottom = _polynomial(denominator, symbols, labels, where)
        found = found + top / bottom
    return found


def _constraint(
    row: Any, symbols: list[Any], labels: list[str], where: str, read: Reader
) -> AnyConstraint:
    import sympy

    if isinstance(row, SymbolicCone):
        entries = [_polynomial(sympy.sympify(e), symbols, labels, where) for e in row.entries]
        return cone(row.kind, entries, row.name)
    relations = {
        sympy.Ge: (Kind.NONNEGATIVE, 1),
        sympy.Le: (Kind.NONNEGATIVE, -1),
        sympy.Eq: (Kind.ZERO, 1),
    }
    if type(row) not in relations:
        raise ProblemError(f"{where}: found {row}, expected a sympy relation >=, <= or Eq")
    kind, sign = relations[type(row)]
    return constraint(read(row.lhs - row.rhs, symbols, labels, where) * sign, kind)
