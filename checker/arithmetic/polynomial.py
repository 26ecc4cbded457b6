"""Polynomials with exact dyadic coefficients, and numbers that are read from files.

A word is the sorted tuple of the variables (from 1) of a monomial, each as often as its power:
``(1, 1, 3)`` is x1^2 x3, ``()`` is 1. A polynomial is a dictionary from words to integers and
one exponent: its value is the sum of ``terms[word] * 2**exp * monomial``. No operation rounds.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from fractions import Fraction
from itertools import groupby
from math import comb
from typing import TypeVar

Word = tuple[int, ...]
Terms = dict[Word, Fraction]  # a polynomial with rational coefficients
Number = TypeVar("Number")
INF = float("inf")  # a mark for "no bound": it is compared and negated, nothing else


def dyadic(values: Sequence[float | Fraction]) -> tuple[list[int], int]:
    """Write doubles and dyadic fractions as integer * 2**exponent, with one exponent."""
    ratios = [value.as_integer_ratio() for value in values]
    bits = max((below.bit_length() - 1 for _, below in ratios), default=0)
    return [above << (bits - below.bit_length() + 1) for above, below in ratios], -bits


def power_of_two(exponent: int) -> Fraction:
    """Compute 2**exponent."""
    return Fraction(1 << exponent) if exponent >= 0 else Fraction(1, 1 << -exponent)


class Polynomial:
    """See the module."""

    __slots__ = ("exp", "terms")

    def __init__(self, terms: dict[Word, int] | None = None, exp: int = 0) -> None:
        self.terms = {} if terms is None else terms
        self.exp = exp

    @staticmethod
    def of(words: Sequence[Word], values: Sequence[float | Fraction]) -> Polynomial:
        """Collect distinct words with doubles as coefficients."""
        numbers, exp = dyadic(values)
        return Polynomial({w: c for w, c in zip(words, numbers, strict=True) if c}, exp)

    @staticmethod
    def affine(variable: int, slope: float, constant: float) -> Polynomial:
        """Make the polynomial slope * x + constant."""
        return Polynomial.of([(variable,), ()], [slope, constant])

    def add(self, other: Polynomial, sign: int = 1) -> None:
        """Add another polynomial, in place."""
        shift = other.exp - self.exp
        if shift < 0:
            self.terms = {word: value << -shift for word, value in self.terms.items()}
            self.exp, shift = other.exp, 0
        terms = self.terms
        for word, value in other.terms.items():
            terms[word] = terms.get(word, 0) + sign * (value << shift)

    def times(self, other: Polynomial) -> Polynomial:
        """Multiply by another polynomial."""
        found: dict[Word, int] = {}
        for left, a in self.terms.items():
            for right, b in other.terms.items():
                word = tuple(sorted(left + right)) if left and right else left or right
                found[word] = found.get(word, 0) + a * b
        return Polynomial(found, self.exp + other.exp)

    def signed(self, sign: int) -> Polynomial:
        """Multiply by 1 or -1."""
        return Polynomial({word: sign * value for word, value in self.terms.items()}, self.exp)

    def minus(self, other: Polynomial) -> Polynomial:
        """Subtract another polynomial."""
        found = self.signed(1)
        found.add(other, -1)
        return found

    def coefficient(self, word: Word = ()) -> Fraction:
        """Find the coefficient of a word."""
        return self.terms.get(word, 0) * power_of_two(self.exp)

    def coefficients(self) -> dict[Word, Fraction]:
        """List the words with their coefficients, which may be zero."""
        unit = power_of_two(self.exp)
        return {word: value * unit for word, value in self.terms.items()}

    def open(self) -> dict[Word, Fraction]:
        """List all words but 1 with a coefficient that is not zero."""
        return {word: value for word, value in self.coefficients().items() if value and word}

    def linear(self, n: int) -> list[Fraction] | None:
        """List the slopes of x1, ..., xn and the constant; None where there are other words."""
        words = [*((v,) for v in range(1, n + 1)), ()]
        if not self.open().keys() <= set(words):
            return None
        return [self.coefficient(word) for word in words]

    def at(self, x: Sequence[Fraction]) -> Fraction:
        """Evaluate at a rational point."""
        total = Fraction(0)
        for word, value in self.terms.items():
            term = Fraction(value)
            for letter in word:
                term *= x[letter - 1]
            total += term
        return total * power_of_two(self.exp)

    def derivative(self, variable: int) -> Polynomial:
        """Differentiate with respect to a variable, counted from 1."""
        found: dict[Word, int] = {}
        for word, value in self.terms.items():
            count = word.count(variable)
            if count:
                place = word.index(variable)
                found[word[:place] + word[place + 1 :]] = value * count
        return Polynomial(found, self.exp)


def total(parts: Iterable[Polynomial]) -> Polynomial:
    """Sum polynomials."""
    found = Polynomial()
    for part in parts:
        found.add(part)
    return found


ONE = Polynomial({(): 1})


def add_terms(found: Terms, terms: Terms, word: Word = (), factor: Fraction | int = 1) -> None:
    """Add a multiple of a polynomial times a monomial, in place."""
    for letters, value in terms.items():
        key = tuple(sorted(letters + word))
        found[key] = found.get(key, Fraction(0)) + value * factor


def split(terms: Mapping[Word, Number], inside: Container[int]) -> dict[Word, dict[Word, Number]]:
    """Collect what multiplies each product of the variables inside."""
    found: dict[Word, dict[Word, Number]] = {}
    for word, value in terms.items():
        head = tuple(v for v in word if v in inside)
        found.setdefault(head, {})[tuple(v for v in word if v not in inside)] = value
    return found


def powers(word: Word) -> list[tuple[int, int]]:
    """List the variables of a word, counted from 0, with their powers."""
    return [(letter - 1, len(list(run))) for letter, run in groupby(word)]


class Substitution:
    """Polynomials in t, where x = centre + scale * t, for doubles centre and scale."""

    def __init__(self, centre: Sequence[float], scale: Sequence[float]) -> None:
        pairs = [dyadic(pair) for pair in zip(centre, scale, strict=True)]
        self._numbers = [(c, s, exp) for (c, s), exp in pairs]
        self._powers: dict[tuple[int, int], Polynomial] = {}

    def _power(self, variable: int, power: int) -> Polynomial:
        key = variable, power
        if key not in self._powers:
            c, s, exp = self._numbers[variable]
            terms = {
                (variable + 1,) * k: comb(power, k) * c ** (power - k) * s**k
                for k in range(power + 1)
            }
            kept = {word: value for word, value in terms.items() if value}
            self._powers[key] = Polynomial(kept, exp * power)
        return self._powers[key]

    def into(self, polynomial: Polynomial) -> Polynomial:
        """Substitute to a polynomial in t."""
        found = Polynomial()
        for word, value in polynomial.terms.items():
            term = Polynomial({(): value}, polynomial.exp)
            for variable, power in powers(word):
                term = term.times(self._power(variable, power))
            found.add(term)
        return found
