"""Expressions with divisions by polynomials, as sums of ratios.

An expression is taken apart at its signs, products and parentheses only as far as needed:
what has no such division is a polynomial and is read by
:mod:`sparsepop_py.io.expressions`.
"""

from __future__ import annotations

import numbers
from collections.abc import Sequence
from itertools import accumulate

from sparsepop_py.algebra.polynomial import Polynomial, total
from sparsepop_py.algebra.rational import Rational
from sparsepop_py.errors import ProblemError
from sparsepop_py.io.expressions import (
    MAX_DEPTH,
    MAX_PRODUCTS,
    DivisionError,
    ExpressionError,
    Token,
    Vocabulary,
    parse_expression,
    parse_number,
    tokenize,
)

__all__ = ["parse_rational", "split_outside"]

_LARGEST = 10  # exponent of a ratio
_MOST_PAIRS = 10_000  # of ratios when sums of them are multiplied out


def split_outside(tokens: Sequence[Token], kind: str) -> list[list[Token]]:
    """Split before tokens of a kind that stand outside parentheses, between two operands.

    Parameters
    ----------
    tokens : sequence of Token
    kind : str

    Returns
    -------
    list of list of Token
    """
    pieces: list[list[Token]] = [[]]
    depth = 0
    for token in tokens:
        if token[0] == kind and depth == 0 and pieces[-1]:
            if pieces[-1][-1][0] in ("number", "name", "close"):
                pieces.append([])
        depth += {"open": 1, "close": -1}.get(token[0], 0)
        pieces[-1].append(token)
    return pieces


def parse_rational(
    source: str | Sequence[Token], vocabulary: Vocabulary | Sequence[str]
) -> Polynomial | Rational:
    """Read an expression that may divide by polynomials.

    Parameters
    ----------
    source : str or sequence of Token
    vocabulary : Vocabulary or sequence of str
        As for :func:`~sparsepop_py.io.expressions.parse_expression`.

    Returns
    -------
    Polynomial or Rational
        A Polynomial where nothing is divided by variables.

    Raises
    ------
    ExpressionError
        If the text is no sum of ratios of polynomials, divides by a ratio, or has coefficients
        that overflow.

    Examples
    --------
    >>> print(parse_rational("x + 2*(x - y)/(1 + y^2)", ["x", "y"]))
    x + (2*x - 2*y)/(1 + y^2)
    """
    if not isinstance(vocabulary, Vocabulary):
        vocabulary = Vocabulary(vocabulary)
    tokens = tokenize(source) if isinstance(source, str) else list(source)
    try:
        return parse_expression(tokens, vocabulary)
    except DivisionError:
        _check_parentheses(tokens)
    try:
        return _sum_of_ratios(tokens, vocabulary)
    except ExpressionError:
        raise
    except ProblemError as error:  # of the arithmetic of ratios
        raise ExpressionError(str(error), "finite coefficients", tokens[0][2]) from None


def _check_parentheses(tokens: Sequence[Token]) -> None:
    """Refuse parentheses that are not closed, or are nested too deeply to take apart."""
    opened: list[int] = []
    for kind, _, position in tokens:
        if kind == "open":
            opened.append(position)
        elif kind == "close" and not opened:
            raise ExpressionError("')'", "a matching '(' before it", position)
        elif kind == "close":
            opened.pop()
        if len(opened) > MAX_DEPTH:
            raise ExpressionError("more", f"at most {MAX_DEPTH} nested parentheses", position)
    if opened:
        raise ExpressionError("'(' that is not closed", "a matching ')'", opened[-1])


def _inside(tokens: list[Token]) -> list[Token]:
    """Return what stands in the parentheses that the first token opens and the last closes."""
    steps = ({"open": 1, "close": -1}.get(kind, 0) for kind, _, _ in tokens)
    closed = list(accumulate(steps)).index(0)
    if closed + 1 < len(tokens):
        _, text, position = tokens[closed + 1]
        raise ExpressionError(repr(text), "one of + - * / ^ or the end of the expression", position)
    return tokens[1:-1]


def _sum(tokens: list[Token], vocabulary: Vocabulary) -> Polynomial | Rational:
    try:
        return parse_expression(tokens, vocabulary)
    except DivisionError:
        return _sum_of_ratios(tokens, vocabulary)


def _sum_of_ratios(tokens: list[Token], vocabulary: Vocabulary) -> Rational:
    terms = [_product(term, vocabulary) for term in split_outside(tokens, "sign")]
    whole = total([term.whole if isinstance(term, Rational) else term for term in terms])
    ratios = [pair for term in terms if isinstance(term, Rational) for pair in term.ratios]
    return Rational.of(whole, ratios)


def _product(tokens: list[Token], vocabulary: Vocabulary) -> Polynomial | Rational:
    signs = next((k for k, token in enumerate(tokens) if token[0] != "sign"), len(tokens))
    negative = [text for _, text, _ in tokens[:signs]].count("-") % 2
    found: Polynomial | Rational = parse_expression("1", vocabulary)
    for piece in split_outside(tokens[signs:], "times"):
        operator, factor = "*", piece
        if piece and piece[0][0] == "times":
            operator, factor = piece[0][1], piece[1:]
        value = _factor(factor, vocabulary)
        position = factor[0][2] if factor else tokens[-1][2]
        combine = _divided if operator == "/" else _times
        found = combine(found, value, position)
    return -found if negative else found


def _times(
    found: Polynomial | Rational, value: Polynomial | Rational, position: int
) -> Polynomial | Rational:
    sizes = [_size(found), _size(value)]
    pairs, products = (left * right for left, right in zip(*sizes, strict=True))
    if pairs > _MOST_PAIRS or products > MAX_PRODUCTS:
        raise ExpressionError(
            f"a product that has {pairs} pairs of ratios and {products} terms",
            f"at most {_MOST_PAIRS} pairs and {MAX_PRODUCTS} terms",
            position,
        )
    product: Polynomial | Rational = found * value
    return product


def _size(value: Polynomial | Rational) -> tuple[int, int]:
    """Count the polynomial and the ratios of a sum, and their terms."""
    parts = value.parts if isinstance(value, Rational) else (value,)
    return 1 + len(parts) // 2, sum(part.terms for part in parts)


def _divided(
    found: Polynomial | Rational, value: Polynomial | Rational, position: int
) -> Polynomial | Rational:
    if isinstance(value, Rational):
        raise ExpressionError(
            "a division by a ratio", "a polynomial after '/': multiply both sides out", position
        )
    if not value.terms:
        raise ExpressionError("a division by zero", "a number other than zero after '/'", position)
    try:
        quotient: Polynomial | Rational = found / value
    except ProblemError as error:
        raise ExpressionError(str(error), "a polynomial after '/'", position) from None
    return quotient


def _factor(tokens: list[Token], vocabulary: Vocabulary) -> Polynomial | Rational:
    try:
        return parse_expression(tokens, vocabulary)
    except DivisionError:
        pass
    if tokens[0][0] == "sign":
        return _product(tokens, vocabulary)
    base, *exponents = split_outside(tokens, "power")
    if len(exponents) == 1:
        return _raised(_factor(base, vocabulary), exponents[0][1:], base[0][2])
    if not exponents and base[0][0] == "open":
        return _sum(_inside(base), vocabulary)
    if not exponents and base[0][1].lower() == "sqr":
        two = [("number", "2", base[0][2])]
        return _raised(_sum(_inside(base[1:]), vocabulary), two, base[0][2])
    if not exponents and base[0][1].lower() == "power":
        inside, *exponents = split_outside(_inside(base[1:]), "comma")
        if len(exponents) == 1:
            return _raised(_sum(inside, vocabulary), exponents[0][1:], base[0][2])
    raise ExpressionError(
        repr(base[0][1]), "a ratio in parentheses, perhaps with one exponent", base[0][2]
    )


def _raised(
    base: Polynomial | Rational, exponent: list[Token], position: int
) -> Polynomial | Rational:
    power = parse_number(exponent)
    if isinstance(base, Polynomial) and power % 1 == 0 and -_LARGEST <= power < 0:
        below = base ** int(-power)
        return _divided(0.0 * below + 1.0, below, position)
    if not isinstance(power, numbers.Real) or power % 1 != 0 or not 0 <= power <= _LARGEST:
        raise ExpressionError(
            f"the exponent {power:g} of a ratio", f"an integer from 0 to {_LARGEST}", position
        )
    found = base**0
    for _ in range(int(power)):
        found = _times(found, base, position)
    return found
