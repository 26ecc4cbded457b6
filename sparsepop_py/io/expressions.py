"""Polynomial expressions as text: numbers, names, ``+ - * / ^ **``, parentheses.

One recursive descent over tokens. Terms are collected in one dictionary a sum and
become arrays once at the end, so that 10^5 terms take about a second, and only nested
parentheses recurse.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from itertools import chain

import numpy as np

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.errors import FormatError, ProblemError

__all__ = [
    "DivisionError",
    "ExpressionError",
    "Token",
    "Vocabulary",
    "excerpt",
    "names_in",
    "parse_expression",
    "parse_number",
    "tokenize",
]

Token = tuple[str, str, int]  # kind, text, position in the whole text
Terms = dict[tuple[int, ...], float]  # sorted letters (variables from 1) -> coefficient
Value = float | tuple[int, ...] | Terms  # a number, a product of variables, a sum

MAX_DEPTH = 100  # of parentheses: far inside Python's own limit of recursion
MAX_DEGREE = 1000
MAX_PRODUCTS = 20_000_000  # of terms when parentheses are multiplied out

_TOKEN = re.compile(
    r"""(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)
      | (?P<name>[^\W\d]\w*)
      | (?P<power>\^|\*\*)
      | (?P<times>[*/])
      | (?P<sign>[+-])
      | (?P<open>\()
      | (?P<close>\))
      | (?P<comma>,)
      | (?P<relation>[<>=!]=?)
      | (?P<space>\s+)
      | (?P<other>.)""",
    re.VERBOSE | re.DOTALL,
)


class ExpressionError(FormatError):
    """An expression is no polynomial; callers add file, line and statement.

    Parameters
    ----------
    found, expected : str
    position : int
        Where, counted from 0 in the text that was given.
    """

    def __init__(self, found: str, expected: str, position: int) -> None:
        super().__init__(found, expected, position)
        self.found, self.expected, self.position = found, expected, position

    def __str__(self) -> str:
        return f"position {self.position}: found {self.found}, expected {self.expected}"


class DivisionError(ExpressionError):
    """An expression divides by variables; it may be a sum of ratios."""


class Vocabulary:
    """The names that an expression may use, in the order of the variables.

    Parameters
    ----------
    names : sequence of str
    ignore_case : bool
        Whether ``X1`` and ``x1`` are the same variable (they are in GAMS).
    """

    def __init__(self, names: Sequence[str], ignore_case: bool = False) -> None:
        self.names = tuple(names)
        self.ignore_case = ignore_case
        self._letters = {self._key(name): v for v, name in enumerate(self.names, 1)}

    def _key(self, name: str) -> str:
        return name.lower() if self.ignore_case else name

    def letter(self, name: str) -> int | None:
        """Look up the number of a variable from 1, None for an unknown name."""
        return self._letters.get(self._key(name))

    def __str__(self) -> str:
        shown = ", ".join(self.names[:8])
        return f"one of {shown}{', ...' if len(self.names) > 8 else ''}" if shown else "a number"


def tokenize(text: str, start: int = 0) -> list[Token]:
    """Tokens of ``text[start:]``; relations are tokens too, spaces are left out."""
    return [
        (match.lastgroup or "other", match.group(), match.start())
        for match in _TOKEN.finditer(text, start)
        if match.lastgroup != "space"
    ]


def names_in(tokens: Sequence[Token]) -> set[str]:
    """Names of variables among the tokens: names that no parenthesis follows."""
    following = chain((token[0] for token in tokens[1:]), ["end"])
    return {
        text
        for (kind, text, _), after in zip(tokens, following, strict=True)
        if kind == "name" and after != "open"
    }


def excerpt(statement: str, position: int = 0) -> str:
    """Quote a statement on one line, shortened around ``position``."""
    start = max(0, position - 40)
    piece = " ".join(statement[start : start + 80].split())
    before = "..." if start else ""
    after = "..." if len(statement) > start + 80 else ""
    return f"'{before}{piece}{after}'"


def parse_expression(
    source: str | Sequence[Token], vocabulary: Vocabulary | Sequence[str]
) -> Polynomial:
    """Polynomial of an expression.

    Parameters
    ----------
    source : str or sequence of Token
        ``-x^2`` is ``-(x^2)``; ``^`` and ``**`` are the same; division is by numbers;
        ``sqr(p)`` and ``power(p, k)`` are the only functions.
    vocabulary : Vocabulary or sequence of str
        The names of the variables, which make the dimension.

    Raises
    ------
    ExpressionError
        If the text is no polynomial in these names; says what was found, where, and
        what was expected.

    Examples
    --------
    >>> print(parse_expression("3*2*x1 - (x1 - x2/2)^2", ["x1", "x2"]))
    6*x1 - x1^2 + x1*x2 - 0.25*x2^2
    """
    if not isinstance(vocabulary, Vocabulary):
        vocabulary = Vocabulary(vocabulary)
    parser = _Parser(source, vocabulary)
    return _polynomial(parser.whole(), vocabulary, parser.start)


def parse_number(source: str | Sequence[Token]) -> float:
    """Value of an expression without variables.

    Raises
    ------
    ExpressionError
        If the text is no expression, holds a name, or its value is not finite.

    Examples
    --------
    >>> parse_number("-(1 + 1/2)^2")
    -2.25
    """
    parser = _Parser(source, Vocabulary(()))
    value = parser.whole().get((), 0.0)
    if not math.isfinite(value):
        raise ExpressionError(str(value), "a finite number", parser.start)
    return value


def _polynomial(terms: Terms, vocabulary: Vocabulary, position: int) -> Polynomial:
    degrees = np.fromiter(map(len, terms), np.int64, len(terms))
    width = max(1, int(degrees.max(initial=0)))
    words = np.zeros((len(terms), width), np.int32)
    letters = np.fromiter(chain.from_iterable(terms), np.int32, int(degrees.sum()))
    words[np.arange(width) >= width - degrees[:, None]] = letters
    values = np.fromiter(terms.values(), float, len(terms))
    try:
        return Polynomial._merged(words, values, len(vocabulary.names), vocabulary.names)
    except ProblemError as error:
        raise ExpressionError(
            "a coefficient that overflows", "finite coefficients", position
        ) from error


def _add(terms: Terms, coefficient: float, word: tuple[int, ...], rest: Terms | None) -> None:
    """Add ``coefficient * word * rest`` to the terms."""
    for other, value in rest.items() if rest is not None else (((), 1.0),):
        product = tuple(sorted(word + other)) if other else word
        terms[product] = terms.get(product, 0.0) + coefficient * value


def _simplest(terms: Terms) -> Value:
    """Reduce a constant sum to a number, so that one may divide by it."""
    terms = {word: value for word, value in terms.items() if value != 0.0}
    if not any(terms):
        return terms.get((), 0.0)
    return terms


class _Parser:
    """Recursive descent: sum of products of powers of primaries."""

    def __init__(self, source: str | Sequence[Token], vocabulary: Vocabulary) -> None:
        tokens = tokenize(source) if isinstance(source, str) else list(source)
        self.start = tokens[0][2] if tokens else 0
        end = tokens[-1][2] + len(tokens[-1][1]) if tokens else 0
        self.tokens = [*tokens, ("end", "", end)]
        self.vocabulary = vocabulary
        self.at = 0
        self.depth = 0

    def fail(self, expected: str, found: str = "", position: int = -1) -> ExpressionError:
        kind, text, here = self.tokens[self.at]
        if not found:
            found = "the end of the expression" if kind == "end" else repr(text)
        return ExpressionError(found, expected, here if position < 0 else position)

    def whole(self) -> Terms:
        terms = self.sum()
        kind = self.tokens[self.at][0]
        if kind == "close":
            raise self.fail("a matching '(' before it")
        if kind != "end":
            raise self.fail("one of + - * / ^ or the end of the expression")
        return terms

    def sum(self) -> Terms:
        terms: Terms = {}
        sign = 1.0
        while True:
            self.product(terms, sign)
            kind, text, _ = self.tokens[self.at]
            if kind != "sign":
                return terms
            sign = -1.0 if text == "-" else 1.0
            self.at += 1

    def product(self, terms: Terms, coefficient: float) -> None:
        """Read one term and add it to ``terms``."""
        letters: list[int] = []
        rest: Terms | None = None
        operator = "*"
        while True:
            coefficient *= self.signs()
            position = self.tokens[self.at][2]
            value = self.power()
            if operator == "/":
                coefficient /= self.divisor(value, position)
            elif isinstance(value, float):
                coefficient *= value
            elif isinstance(value, tuple):
                letters.extend(value)
            else:
                rest = value if rest is None else self.multiply(rest, value, position)
            kind, operator, _ = self.tokens[self.at]
            if kind != "times":
                break
            self.at += 1
        _add(terms, coefficient, tuple(sorted(letters)), rest)

    def signs(self) -> float:
        sign = 1.0
        while self.tokens[self.at][0] == "sign":
            sign = -sign if self.tokens[self.at][1] == "-" else sign
            self.at += 1
        return sign

    def divisor(self, value: Value, position: int) -> float:
        if not isinstance(value, float):
            raise DivisionError("a division by variables", "a number after '/'", position)
        if value == 0.0:
            raise self.fail("a number other than zero after '/'", "a division by zero", position)
        return value

    def power(self) -> Value:
        position = self.tokens[self.at][2]
        base = self.primary()
        if self.tokens[self.at][0] != "power":
            return base
        self.at += 1
        exponent = self.signs() * self.constant(self.primary(), "exponent")
        if self.tokens[self.at][0] == "power":
            raise self.fail("parentheses that say which power comes first", "a second exponent")
        return self.raised(base, exponent, position)

    def constant(self, value: Value, role: str) -> float:
        if not isinstance(value, float):
            position = self.tokens[self.at - 1][2]
            raise self.fail(f"a number as {role}", f"an {role} with variables", position)
        return value

    def raised(self, base: Value, exponent: float, position: int) -> Value:
        if isinstance(base, float):
            return self.raised_number(base, exponent, position)
        if exponent < 0 or exponent % 1 != 0:
            raise self.fail(
                "a non-negative integer as exponent", f"the exponent {exponent:g}", position
            )
        degree = len(base) if isinstance(base, tuple) else max(map(len, base))
        if degree * exponent > MAX_DEGREE:
            raise self.fail(
                f"at most degree {MAX_DEGREE}", f"degree {degree * exponent:.0f}", position
            )
        if isinstance(base, tuple):
            return base * int(exponent)
        result: Terms = {(): 1.0}
        for bit in f"{int(exponent):b}":
            result = self.multiply(result, result, position)
            if bit == "1":
                result = self.multiply(result, base, position)
        return result

    def raised_number(self, base: float, exponent: float, position: int) -> float:
        try:
            value = base**exponent
        except (OverflowError, ZeroDivisionError):
            value = math.inf
        if isinstance(value, complex) or not math.isfinite(value):
            raise self.fail("a finite real number", f"the power {base:g}^{exponent:g}", position)
        return value

    def multiply(self, left: Terms, right: Terms, position: int) -> Terms:
        if len(left) * len(right) > MAX_PRODUCTS:
            raise self.fail(
                f"at most {MAX_PRODUCTS}",
                f"a product of parentheses with {len(left) * len(right)} terms",
                position,
            )
        terms: Terms = {}
        for word, value in left.items():
            _add(terms, value, word, right)
        return terms

    def primary(self) -> Value:
        kind, text, _ = self.tokens[self.at]
        if kind == "number":
            value = float(text)
            if not math.isfinite(value):
                raise self.fail("a number that a double can hold")
            self.at += 1
            return value
        if kind == "name":
            if self.tokens[self.at + 1][0] == "open":
                return self.function(text)
            letter = self.vocabulary.letter(text)
            if letter is None:
                raise self.fail(str(self.vocabulary), f"the unknown name {text!r}")
            self.at += 1
            return (letter,)
        if kind == "open":
            return _simplest(self.arguments()[0])
        raise self.fail("a number, a name or '('")

    def arguments(self, count: int = 1) -> list[Terms]:
        """Parse ``count`` sums in parentheses, with commas between them."""
        if self.depth == MAX_DEPTH:
            raise self.fail(f"at most {MAX_DEPTH} nested parentheses", "more")
        self.depth += 1
        values: list[Terms] = []
        for number in range(count):
            wanted, label = ("open", "'('") if number == 0 else ("comma", "','")
            if self.tokens[self.at][0] != wanted:
                raise self.fail(label)
            self.at += 1
            values.append(self.sum())
        if self.tokens[self.at][0] != "close":
            raise self.fail("one of + - * / ^ or ')'")
        self.at += 1
        self.depth -= 1
        return values

    def function(self, name: str) -> Value:
        position = self.tokens[self.at][2]
        kind = name.lower()
        if kind not in ("sqr", "power"):
            raise self.fail(
                "a polynomial, whose only functions are sqr and power", f"the function {name!r}"
            )
        self.at += 1
        if kind == "sqr":
            return self.raised(_simplest(self.arguments()[0]), 2.0, position)
        base, exponent = map(_simplest, self.arguments(2))
        return self.raised(base, self.constant(exponent, "exponent"), position)
