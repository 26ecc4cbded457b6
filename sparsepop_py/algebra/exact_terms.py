"""Coefficients kept as exact rationals while expressions are multiplied out.

Sums and products of doubles are doubles in most problems, and a :data:`Grid` shows it at the
cost of a few operations: where all coefficients are multiples of 2^step and their sizes add up
to less than 2^(step + 52), no sum and no product of them was rounded. Elsewhere terms are kept
as integers over one denominator, so that each coefficient is rounded once, at the end.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.errors import ProblemError

__all__ = [
    "LARGEST_BITS",
    "ExactTerms",
    "Grid",
    "exact_fraction",
    "grid_of",
    "grid_of_number",
    "held",
    "require_doubles",
]

Grid = tuple[int, float]  # step, and at least the sum of |c|: each c is a multiple of 2^step

LARGEST_BITS = 4096  # of an integer: beyond, coefficients are rounded on the way
_NOTHING: Grid = (0, 0.0)
_ANY_STEP = 1100  # of zeros and of whole numbers


def exact_fraction(number: Any) -> Fraction | None:
    """Return a real number that is no double as a fraction, else None.

    Raises
    ------
    ProblemError
        If it is larger than all doubles, or no double and of a type that gives no fraction.
    """
    if type(number) is float or (type(number) is int and abs(number) <= 2**53):
        return None
    if isinstance(number, numbers.Rational):
        exact = Fraction(int(number.numerator), int(number.denominator))  # those of NumPy overflow
    elif isinstance(number, float | np.float32 | np.float16):
        return None
    elif not isinstance(number, numbers.Real):
        return None
    else:  # long doubles, and numbers of sympy and mpmath
        near = float(number)
        if near == number or near != near:
            return None
        if not isinstance(number, np.longdouble):
            raise ProblemError(
                f"a number: found {type(number).__name__} {number!s:.40}, which is no double, "
                "expected a float or a Fraction"
            )
        exact = Fraction(*number.as_integer_ratio())
    try:
        return None if Fraction(float(exact)) == exact else exact
    except OverflowError:
        raise ProblemError("a number is too large for a double") from None


def require_doubles(given: Any, field: str, error: type[Exception] = ProblemError) -> None:
    """Refuse arrays of numbers one of which no double holds, as some large integers.

    Parameters
    ----------
    given : array_like
        What is no number passes.
    field : str
        What the message calls it.
    error : type
        The exception to raise.
    """
    array = np.asarray(given)
    if array.dtype.kind not in "iufO":
        return
    if array.dtype.kind != "O" and array.dtype.itemsize <= 8:
        values = array.astype(float)
        if not np.any(np.isfinite(values) & (np.abs(values) >= 2.0**53)):
            return
    stated = np.asarray(given, object).ravel()  # beside floats numpy rounds integers
    for number in stated:
        if exact_fraction(number) is not None:
            raise error(f"{field}: found {number!s:.40}, which no double holds, expected doubles")


def grid_of_number(value: float) -> Grid:
    """Find the grid of a finite double."""
    denominator = value.as_integer_ratio()[1]
    return 1 - denominator.bit_length(), abs(value)


def grid_of(values: NDArray[np.float64]) -> Grid:
    """Find the grid of finite doubles, its step as large as it can be."""
    if not values.size:
        return _NOTHING
    mantissa, exponent = np.frexp(values)
    whole = np.ldexp(mantissa, 53).astype(np.int64)
    lowest = np.frexp((whole & -whole).astype(float))[1]  # 1 + the place of the last bit
    steps = np.where(whole != 0, exponent + lowest - 54, _ANY_STEP)
    with np.errstate(over="ignore"):
        return int(steps.min()), float(np.abs(values).sum())


def held(step: int, size: float) -> bool:
    """Tell whether all sums of numbers on a grid are doubles.

    They are where ``size`` < 2^(step + 52): one bit less than doubles have, since ``size``
    itself was added up in doubles.
    """
    return step >= -1074 and size < math.ldexp(1.0, min(step + 52, 1000))


@dataclass(frozen=True, eq=False, slots=True)
class ExactTerms:
    """Terms of a polynomial with rational coefficients.

    Parameters
    ----------
    words : (T, D) int32
        Distinct monomials in graded order.
    numerators : (T,) object
        Integers, none of them zero.
    denominator : int
        Positive, of all terms.
    followed : bool
        False where numbers grew beyond ``LARGEST_BITS`` and were rounded on the way.
    """

    words: Words
    numerators: NDArray[Any]
    denominator: int
    followed: bool = True

    @staticmethod
    def of_doubles(words: Words, values: NDArray[np.float64]) -> ExactTerms:
        """Take over terms whose coefficients are doubles."""
        numerators, denominator = _over_one([v.as_integer_ratio() for v in values.tolist()])
        return ExactTerms(words, numerators, denominator)

    @staticmethod
    def of_fractions(words: Words, values: Sequence[Fraction], dimension: int) -> ExactTerms:
        """Merge terms, equal monomials among them."""
        numerators, denominator = _over_one([v.as_integer_ratio() for v in values])
        return _merged(words, numerators, denominator, dimension, True)

    @property
    def fractions(self) -> list[Fraction]:
        """The coefficients."""
        return [Fraction(number, self.denominator) for number in self.numerators.tolist()]

    def times(self, other: ExactTerms, dimension: int) -> ExactTerms:
        """Multiply two polynomials."""
        words = monomials.multiply(self.words[:, None, :], other.words[None, :, :])
        products = np.multiply.outer(self.numerators, other.numerators).ravel()
        return _merged(
            words.reshape(products.size, words.shape[-1]),
            products,
            self.denominator * other.denominator,
            dimension,
            self.followed and other.followed,
        )

    def scaled(self, factor: Fraction) -> ExactTerms:
        """Multiply by a number other than zero."""
        up, down = factor.as_integer_ratio()
        return _within_bits(
            ExactTerms(self.words, self.numerators * up, self.denominator * down, self.followed)
        )

    def differentiated(
        self, rows: NDArray[np.int64], power: NDArray[np.int64], words: Words, dimension: int
    ) -> ExactTerms:
        """Multiply the coefficients of some terms by powers and give them other monomials."""
        numbers = self.numerators[rows] * power.astype(object)
        return _merged(words, numbers, self.denominator, dimension, self.followed)

    @staticmethod
    def added(parts: Sequence[ExactTerms], dimension: int) -> ExactTerms:
        """Add polynomials."""
        common = math.lcm(*{part.denominator for part in parts})
        return _merged(
            monomials.stack(part.words for part in parts),
            np.concatenate([part.numerators * (common // part.denominator) for part in parts]),
            common,
            dimension,
            all(part.followed for part in parts),
        )

    def rounded(self) -> NDArray[np.float64]:
        """Round each coefficient to the nearest double; 0 where it is too small for one.

        Raises
        ------
        ProblemError
            If one is too large for a double.
        """
        below = self.denominator
        try:
            return np.array([number / below for number in self.numerators.tolist()], float)
        except OverflowError:
            raise ProblemError(
                "coefficients: a product or a sum of equal monomials overflows"
            ) from None

    def are_doubles(self, values: NDArray[np.float64]) -> bool:
        """Tell whether these doubles, as :meth:`rounded` gives them, are the coefficients."""
        below = self.denominator
        for number, value in zip(self.numerators.tolist(), values.tolist(), strict=True):
            up, down = value.as_integer_ratio()
            if number * down != up * below:
                return False
        return self.followed


def _over_one(ratios: list[tuple[int, int]]) -> tuple[NDArray[Any], int]:
    common = math.lcm(*{down for _, down in ratios})
    numerators = np.empty(len(ratios), object)
    numerators[:] = [up * (common // down) for up, down in ratios]
    return numerators, common


def _merged(
    words: Words, numerators: NDArray[Any], denominator: int, dimension: int, followed: bool
) -> ExactTerms:
    words = monomials.trim(words)
    unique, where = monomials.collect(words, dimension)
    if unique.shape[0] < words.shape[0]:
        order = np.argsort(where, kind="stable")
        starts = np.searchsorted(where[order], np.arange(unique.shape[0]))
        sums = np.add.reduceat(numerators[order], starts)
    else:
        sums = np.empty_like(numerators)
        sums[where] = numerators
    keep = sums.astype(bool)
    terms = ExactTerms(monomials.trim(unique[keep]), sums[keep], denominator, followed)
    return _within_bits(terms)


def _within_bits(terms: ExactTerms) -> ExactTerms:
    """Round to doubles where integers have grown too long, after a try to shorten them."""
    numbers, below = terms.numerators.tolist(), terms.denominator
    if _longest(numbers, below) <= LARGEST_BITS:
        return terms
    common = math.gcd(below, *numbers)
    numbers, below = [number // common for number in numbers], below // common
    shorter = np.empty(len(numbers), object)
    shorter[:] = numbers
    terms = ExactTerms(terms.words, shorter, below, terms.followed)
    if _longest(numbers, below) <= LARGEST_BITS:
        return terms
    values = terms.rounded()
    keep = values != 0.0
    near = ExactTerms.of_doubles(monomials.trim(terms.words[keep]), values[keep])
    return ExactTerms(near.words, near.numerators, near.denominator, False)


def _longest(numbers: list[int], below: int) -> int:
    return max([below.bit_length(), *(number.bit_length() for number in numbers)])
