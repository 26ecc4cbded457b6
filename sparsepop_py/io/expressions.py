"""Polynomial expressions as text: numbers, names, ``+ - * / ^ **``, parentheses.

One recursive descent over tokens. Terms are collected in one dictionary a sum and
become arrays once at the end, so that 10^5 terms take about a second, and only nested
parentheses recurse. A number is the double next to it; what is made of numbers is exact, and
is rounded when a problem is made.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import chain
from operator import eq

import numpy as np

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.exact_terms import LARGEST_BITS, ExactTerms
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
    "parse_exact_number",
    "parse_number",
    "tokenize",
]

Token = tuple[str, str, int]  # kind, text, position in the whole text
Number = int | Fraction
Terms = dict[tuple[int, ...], Number]  # sorted letters (variables from 1) -> coefficient
Value = Number | tuple[int, ...] | Terms  # a number, a product of variables, a sum

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
    """Split ``text[start:]`` into tokens; relations are tokens too, spaces are left out.

    Raises
    ------
    ExpressionError
        If a name holds a number that is no digit, as superscripts are.
    """
    found = [
        (match.lastgroup or "other", match.group(), match.start())
        for match in _TOKEN.finditer(text, start)
        if match.lastgroup != "space"
    ]
    if not text.isascii():
        for kind, word, place in found:
            if kind == "name" and any(c.isnumeric() and not c.isdecimal() for c in word):
                raise ExpressionError(repr(word), "x^2 for a power, and digits in names", place)
    return found


def names_in(tokens: Sequence[Token]) -> set[str]:
    """List names of variables among the tokens: names that no parenthesis follows."""
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
    """Read the polynomial of an expression.

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
    return parser.polynomial(parser.whole())


def parse_number(source: str | Sequence[Token]) -> float:
    """Compute the value of an expression without variables.

    Raises
    ------
    ExpressionError
        If the text is no expression, holds a name, or its value is not finite.

    Examples
    --------
    >>> parse_number("-(1 + 1/2)^2")
    -2.25
    """
    return float(parse_exact_number(source))


def parse_exact_number(source: str | Sequence[Token]) -> Number:
    """Compute the value of an expression without variables, exactly.

    Raises
    ------
    ExpressionError
        As of :func:`parse_number`.

    Examples
    --------
    >>> parse_exact_number("1/3 + 1")
    Fraction(4, 3)
    """
    parser = _Parser(source, Vocabulary(()))
    value = parser.whole().get((), 0)
    try:
        float(value)
    except OverflowError:
        found = "-inf" if value < 0 else "inf"
        raise ExpressionError(found, "a finite number", parser.start) from None
    return value


def _words(terms: Terms) -> monomials.Words:
    degrees = np.fromiter(map(len, terms), np.int64, len(terms))
    width = max(1, int(degrees.max(initial=0)))
    words = np.zeros((len(terms), width), np.int32)
    letters = np.fromiter(chain.from_iterable(terms), np.int32, int(degrees.sum()))
    words[np.arange(width) >= width - degrees[:, None]] = letters
    return words


def _exact(terms: Terms, dimension: int) -> ExactTerms:
    return ExactTerms.of_fractions(_words(terms), [*map(Fraction, terms.values())], dimension)


def _is_long(value: Number) -> bool:
    bits = max(value.numerator.bit_length(), value.denominator.bit_length())
    return bits > LARGEST_BITS


def _quotient(number: Number, divisor: Number) -> Number:
    found = Fraction(number) / divisor
    return found.numerator if found.denominator == 1 else found


def _near(number: Number) -> float:
    try:
        return float(number)
    except OverflowError:
        return -math.inf if number < 0 else math.inf


def _simplest(terms: Terms) -> Value:
    """Reduce a constant sum to a number, so that one may divide by it."""
    terms = {word: value for word, value in terms.items() if value}
    if not any(terms):
        return terms.get((), 0)
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
        self.followed = True  # no number grew so long that it was rounded on the way

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

    def polynomial(self, terms: Terms) -> Polynomial:
        """Make the polynomial of the terms of the whole expression."""
        n, names = len(self.vocabulary.names), self.vocabulary.names
        try:
            values = [float(value) for value in terms.values()]
            if self.followed and all(map(eq, values, terms.values())):
                return Polynomial._merged(_words(terms), np.array(values, float), n, names)
            exact = _exact(terms, n)
            return Polynomial._of_exact(replace(exact, followed=self.followed), n, names)
        except (OverflowError, ProblemError):
            raise self.overflow(self.start) from None

    def overflow(self, position: int) -> ExpressionError:
        found = "a coefficient that overflows"
        return ExpressionError(found, "finite coefficients", position)

    def short(self, value: Number) -> Number:
        """Round a number that grew too long."""
        if not _is_long(value):
            return value
        self.followed = False
        try:
            return Fraction(float(value))
        except OverflowError:
            raise self.overflow(self.start) from None

    def add(
        self, terms: Terms, coefficient: Number, word: tuple[int, ...], rest: Terms | None
    ) -> None:
        """Add ``coefficient * word * rest`` to the terms."""
        for other, value in rest.items() if rest is not None else (((), 1),):
            product = tuple(sorted(word + other)) if other else word
            added = coefficient if value == 1 else coefficient * value
            before = terms.get(product)
            terms[product] = added if before is None else self.short(before + added)

    def sum(self) -> Terms:
        terms: Terms = {}
        sign = 1
        while True:
            self.product(terms, sign)
            kind, text, _ = self.tokens[self.at]
            if kind != "sign":
                return terms
            sign = -1 if text == "-" else 1
            self.at += 1

    def product(self, terms: Terms, coefficient: Number) -> None:
        """Read one term and add it to ``terms``."""
        letters: list[int] = []
        rest: Terms | None = None
        operator = "*"
        while True:
            sign = self.signs()
            coefficient = coefficient if sign > 0 else -coefficient
            position = self.tokens[self.at][2]
            value = self.power()
            if operator == "/":
                divisor = self.divisor(value, position)
                coefficient = self.short(_quotient(coefficient, divisor))
            elif isinstance(value, (int, Fraction)):
                coefficient = value if coefficient == 1 else self.short(coefficient * value)
            elif isinstance(value, tuple):
                letters.extend(value)
            else:
                rest = value if rest is None else self.multiply(rest, value, position)
            kind, operator, _ = self.tokens[self.at]
            if kind != "times":
                break
            self.at += 1
        self.add(terms, coefficient, tuple(sorted(letters)), rest)

    def signs(self) -> int:
        sign = 1
        while self.tokens[self.at][0] == "sign":
            sign = -sign if self.tokens[self.at][1] == "-" else sign
            self.at += 1
        return sign

    def divisor(self, value: Value, position: int) -> Number:
        if not isinstance(value, (int, Fraction)):
            raise DivisionError("a division by variables", "a number after '/'", position)
        if value == 0:
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

    def constant(self, value: Value, role: str) -> Number:
        if not isinstance(value, (int, Fraction)):
            position = self.tokens[self.at - 1][2]
            raise self.fail(f"a number as {role}", f"an {role} with variables", position)
        return value

    def raised(self, base: Value, exponent: Number, position: int) -> Value:
        if isinstance(base, (int, Fraction)):
            return self.raised_number(base, exponent, position)
        if exponent < 0 or exponent % 1 != 0:
            kind = DivisionError if exponent % 1 == 0 else ExpressionError
            found = f"the exponent {_near(exponent):g}"
            raise kind(found, "a non-negative integer as exponent", position)
        degree = len(base) if isinstance(base, tuple) else max(map(len, base))
        if degree * exponent > MAX_DEGREE:
            raise self.fail(
                f"at most degree {MAX_DEGREE}", f"degree {_near(degree * exponent):.0f}", position
            )
        if isinstance(base, tuple):
            return base * int(exponent)
        result: Terms = {(): 1}
        for bit in f"{int(exponent):b}":
            result = self.multiply(result, result, position)
            if bit == "1":
                result = self.multiply(result, base, position)
        return result

    def raised_number(self, base: Number, exponent: Number, position: int) -> Number:
        near, power = _near(base), _near(exponent)
        try:
            value = near**power
        except (OverflowError, ZeroDivisionError):
            value = math.inf
        if isinstance(value, complex) or not math.isfinite(value):
            raise self.fail("a finite real number", f"the power {near:g}^{power:g}", position)
        bits = max(base.numerator.bit_length(), base.denominator.bit_length())
        if exponent.denominator == 1 and bits * abs(int(exponent)) <= LARGEST_BITS:
            return Fraction(base) ** int(exponent)
        self.followed = False
        return Fraction(value)

    def multiply(self, left: Terms, right: Terms, position: int) -> Terms:
        if len(left) * len(right) > MAX_PRODUCTS:
            raise self.fail(
                f"at most {MAX_PRODUCTS}",
                f"a product of parentheses with {len(left) * len(right)} terms",
                position,
            )
        if any(type(v) is not int or _is_long(v) for v in chain(left.values(), right.values())):
            return self.multiply_rationals(left, right, position)
        terms: Terms = {}
        for word, value in left.items():
            self.add(terms, value, word, right)
        return terms

    def multiply_rationals(self, left: Terms, right: Terms, position: int) -> Terms:
        n = len(self.vocabulary.names)
        try:
            product = _exact(left, n).times(_exact(right, n), n)
        except ProblemError:
            raise self.overflow(position) from None
        self.followed = self.followed and product.followed
        words = product.words.tolist()
        letters = (tuple(letter for letter in word if letter) for word in words)
        return dict(zip(letters, product.fractions, strict=True))

    def primary(self) -> Value:
        kind, text, _ = self.tokens[self.at]
        if kind == "number":
            value = float(text)
            vanished = value == 0.0 and re.search("[1-9]", text.lower().partition("e")[0])
            if not math.isfinite(value) or vanished:
                raise self.fail("a number that a double can hold")
            self.at += 1
            return int(value) if value.is_integer() else Fraction(value)
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
            return self.raised(_simplest(self.arguments()[0]), 2, position)
        base, exponent = map(_simplest, self.arguments(2))
        return self.raised(base, self.constant(exponent, "exponent"), position)
