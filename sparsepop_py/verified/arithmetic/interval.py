"""Verified arithmetic: every number that a proof rests on passes through here.

Floating-point results are turned into enclosures in two ways. Elementwise
operations are rounded outward by one unit in the last place (the IEEE error of
a correctly rounded operation is at most half of that). Sums and dot products of
c terms carry the a-priori bound gamma_c * sum |terms| with
gamma_c = c u / (1 - c u), u = 2^-53, which holds for every order of summation,
with or without fused multiply-add (Higham 2002, sections 3.1 and 4.2). Where
decisions hang on exact zeros, :func:`exact_values` uses rationals.

References
----------
N. J. Higham, Accuracy and Stability of Numerical Algorithms, SIAM, 2002.
S. M. Rump, Fast and parallel interval arithmetic, BIT 39, 1999.
A. Neumaier, Interval Methods for Systems of Equations, Cambridge, 1990.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import ArrayLike, NDArray

from sparsepop_py.algebra.monomials import Words

__all__ = [
    "Interval",
    "applied",
    "down",
    "exact_values",
    "gram",
    "matmul",
    "require_ieee",
    "sum_by",
    "up",
]

_UNIT = 2.0**-53  # relative rounding error of doubles (IEEE 754)
_TINY = 2.0**-1022  # least normal double
_SMALL = 2.0**-500  # products of two larger numbers are normal


def require_ieee() -> None:
    """Raise ``FloatingPointError`` if this process flushes subnormal numbers to zero.

    Some libraries switch the whole process to that mode; enclosures would not hold in it.
    """
    smallest = np.full(2, _TINY)
    if not np.all(smallest * 0.5 > 0.0):
        raise FloatingPointError(
            "this process flushes subnormal numbers to zero (a library built with fast-math "
            "flags is loaded); proofs need IEEE arithmetic"
        )


def down(x: ArrayLike) -> NDArray[np.float64]:
    """Take the next double towards minus infinity."""
    return np.nextafter(x, -np.inf)


def up(x: ArrayLike) -> NDArray[np.float64]:
    """Take the next double towards plus infinity."""
    return np.nextafter(x, np.inf)


def _times(a: NDArray[Any], b: NDArray[Any]) -> NDArray[np.float64]:
    """Multiply with 0 * inf = 0; only exact zeros give zero, not underflow."""
    with np.errstate(invalid="ignore", over="ignore", under="ignore"):
        product = a * b
        if np.count_nonzero(np.abs(product) > 0.0) == np.size(product):
            return product
        lost = np.copysign(2.0**-1074, product)
    return np.where((a == 0) | (b == 0), 0.0, np.where(product == 0, lost, product))


def _plain(factors: Sequence[NDArray[Any]]) -> bool:
    """Check that products of any two cannot underflow, and that none is 0 times infinity."""
    size = np.abs(np.concatenate(factors, axis=None))
    size[size == 0] = 1.0
    return bool(size.min(initial=1.0) > _SMALL and size.max(initial=1.0) < np.inf)


@dataclass(frozen=True, eq=False)
class Interval:
    """Arrays of closed intervals [lo, hi]; infinite ends are allowed.

    Examples
    --------
    >>> third = Interval.point([1.0]) / Interval.point([3.0])
    >>> bool(third.lo[0] < third.hi[0]), float(third.hi[0] - third.lo[0]) < 1e-15
    (True, True)
    """

    lo: NDArray[np.float64]
    hi: NDArray[np.float64]

    @staticmethod
    def point(values: ArrayLike) -> Interval:
        """Make intervals of width zero."""
        array = np.asarray(values, float)
        return Interval(array, array)

    @staticmethod
    def of_fraction(value: Fraction) -> Interval:
        """Enclose a rational number by the tightest doubles."""
        try:
            near = float(value)
        except OverflowError:
            edge = np.float64(np.finfo(float).max)
            ends = (edge, np.inf) if value > 0 else (-np.inf, -edge)
            return Interval(np.float64(ends[0]), np.float64(ends[1]))  # type: ignore[arg-type]
        exact = Fraction(near)
        lo = near if exact <= value else np.nextafter(near, -np.inf)
        hi = near if exact >= value else np.nextafter(near, np.inf)
        return Interval(np.float64(lo), np.float64(hi))  # type: ignore[arg-type]

    def __getitem__(self, key: Any) -> Interval:
        low = self.lo[key]
        return Interval(low, low if self.hi is self.lo else self.hi[key])

    def __neg__(self) -> Interval:
        return Interval(-self.hi, -self.lo)

    def __add__(self, other: Interval) -> Interval:
        with np.errstate(over="ignore"):
            return Interval(down(self.lo + other.lo), up(self.hi + other.hi))

    def __sub__(self, other: Interval) -> Interval:
        return self + (-other)

    def __mul__(self, other: Interval) -> Interval:
        left = (self.lo,) if self.lo is self.hi else (self.lo, self.hi)
        right = (other.lo,) if other.lo is other.hi else (other.lo, other.hi)
        with np.errstate(invalid="ignore", over="ignore", under="ignore"):
            low, high = _extremes([a * b for a in left for b in right])
            count = np.size(low)
            some = np.count_nonzero(np.abs(low) > 0.0) == count == np.count_nonzero(high)
            if some:  # no end is 0 or no number; what lies between does not matter
                return Interval(down(low), up(high))
            if not _plain(left + right):
                shape = np.shape(low)
                first, second = np.empty((2, 1, *shape)), np.empty((1, 2, *shape))
                first[0], first[1] = self.lo, self.hi
                second[:, 0], second[:, 1] = other.lo, other.hi
                products = _times(first, second)  # all at once: small arrays cost by the call
                low, high = products.min(axis=(0, 1)), products.max(axis=(0, 1))
            return Interval(np.where(low == 0, 0.0, down(low)), np.where(high == 0, 0.0, up(high)))

    def __truediv__(self, other: Interval) -> Interval:
        """Quotient; the whole line where the divisor contains zero."""
        safe = (other.lo > 0) | (other.hi < 0)
        with np.errstate(divide="ignore", over="ignore", under="ignore"):
            low = np.where(safe, down(1.0 / np.where(safe, other.hi, 1.0)), -np.inf)
            high = np.where(safe, up(1.0 / np.where(safe, other.lo, 1.0)), np.inf)
        quotient = self * Interval(low, high)
        return Interval(np.where(safe, quotient.lo, -np.inf), np.where(safe, quotient.hi, np.inf))

    def power(self, exponent: NDArray[np.int64]) -> Interval:
        """Raise to integer powers, each >= 0 and broadcast against the interval."""
        exponent = np.asarray(exponent)
        higher = np.count_nonzero(exponent > 1)
        if higher == exponent.size:
            return self._higher_power(exponent)
        one = exponent == 0
        lo = np.where(one, 1.0, self.lo)
        hi = lo if self.hi is self.lo else np.where(one, 1.0, self.hi)
        if higher:
            exponent = np.broadcast_to(exponent, lo.shape)
            here = exponent > 1
            found = Interval(lo[here], hi[here])._higher_power(exponent[here])
            lo, hi = lo.copy(), hi.copy()
            lo[here], hi[here] = found.lo, found.hi
        return Interval(lo, hi)

    def _higher_power(self, exponent: NDArray[np.int64]) -> Interval:
        """Powers of exponents > 1."""
        low, high = self.lo, self.hi
        low_size, high_size = np.abs(low), np.abs(high)
        near = np.where((low <= 0) & (high >= 0), 0.0, np.minimum(low_size, high_size))
        near_power = _power(near, exponent, down)
        far_power = _power(np.maximum(low_size, high_size), exponent, up)
        even = exponent % 2 == 0
        lo, hi = np.maximum(near_power, 0.0), far_power
        if np.count_nonzero(even) < even.size:
            low_power, high_power = _power(low_size, exponent, up), _power(high_size, exponent, up)
            lo = np.where(even, lo, np.where(low >= 0, near_power, -low_power))
            hi = np.where(even, far_power, np.where(high <= 0, -near_power, high_power))
        return Interval(lo, hi)

    def magnitude(self) -> NDArray[np.float64]:
        """Compute the largest absolute value in each interval."""
        return np.maximum(np.abs(self.lo), np.abs(self.hi))

    def middle(self) -> NDArray[np.float64]:
        """Compute a double near the middle of each interval, NaN for [-inf, inf]."""
        with np.errstate(invalid="ignore"):
            return 0.5 * self.lo + 0.5 * self.hi

    def radius(self, middle: NDArray[np.float64]) -> NDArray[np.float64]:
        """Bound the distance of all points of each interval from a number, rounded up."""
        with np.errstate(over="ignore", invalid="ignore"):
            return np.maximum(up(self.hi - middle), up(middle - self.lo))

    def width(self) -> NDArray[np.float64]:
        """Compute hi - lo to nearest, to choose by; infinite where it exceeds all doubles."""
        with np.errstate(over="ignore"):
            return self.hi - self.lo

    def intersect(self, other: Interval) -> Interval:
        """Intersect; empty where lo > hi."""
        return Interval(np.maximum(self.lo, other.lo), np.minimum(self.hi, other.hi))


def _extremes(parts: list[NDArray[Any]]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Least and largest entries of several arrays, no number where one is none."""
    low = high = parts[0]
    for part in parts[1:]:
        low, high = np.minimum(low, part), np.maximum(high, part)
    return low, high


def _power(
    magnitude: NDArray[Any], exponent: NDArray[Any], rounded: Callable[[NDArray[Any]], NDArray[Any]]
) -> NDArray[np.float64]:
    """Powers of non-negative numbers by rounded multiplications, for exponents > 0."""
    result: NDArray[np.float64] = magnitude
    for step in range(1, int(exponent.max(initial=0))):
        product = rounded(_times(result, magnitude))
        result = np.where(exponent > step, product, result)
    return np.where(magnitude == 0, 0.0, result)


def sum_by(index: NDArray[Any], terms: Interval, size: int) -> Interval:
    """Enclose the sums of ``terms`` that share an index, shape (size,).

    Single terms and empty sums stay exact.
    """
    count = np.bincount(index, minlength=size)
    several = count > 1
    if not np.count_nonzero(several):
        low, high = (
            np.bincount(index, weights=end, minlength=size).astype(float)
            for end in (terms.lo, terms.hi)
        )
        return Interval(low, high)
    relative = (count + 4.0) * (1.001 * _UNIT)
    with np.errstate(invalid="ignore", over="ignore"):
        ends: list[NDArray[np.float64]] = []
        for end, sign in ((terms.lo, -1.0), (terms.hi, 1.0)):
            value = np.bincount(index, weights=end, minlength=size)
            error = relative * np.bincount(index, weights=np.abs(end), minlength=size)
            shifted = np.nextafter(value + sign * error, sign * np.inf)
            # a partial sum may overflow although the sum is finite: then nothing is known
            shifted[~np.isfinite(shifted)] = sign * np.inf
            ends.append(np.where(several, shifted, value))
    return Interval(ends[0], ends[1])


def gram(factor: NDArray[np.float64]) -> Interval:
    """Enclose L L' for a stack of matrices L of shape (K, s, r).

    L L' is positive semidefinite for every real L, so a Gram matrix that is stored by
    its factor needs no eigenvalue test.
    """
    transposed = np.swapaxes(factor, -1, -2)
    inner = factor.shape[-1] + 4.0
    with np.errstate(over="ignore", invalid="ignore"):
        product = factor @ transposed
        size = np.abs(factor) @ np.abs(transposed)
        error = inner * (1.001 * _UNIT) * size + inner * _TINY
        lo, hi = down(product - error), up(product + error)
    known = np.isfinite(lo) & np.isfinite(hi)
    return Interval(np.where(known, lo, -np.inf), np.where(known, hi, np.inf))


def matmul(left: Interval, right: Interval) -> Interval:
    """Enclose the matrix product, by midpoints and radii (Rump 1999)."""
    a, b = left.middle(), right.middle()
    a_radius, b_radius = left.radius(a), right.radius(b)
    inner = a.shape[-1] + 4.0
    with np.errstate(over="ignore", invalid="ignore"):
        product = a @ b
        size = np.abs(a) @ (np.abs(b) + b_radius)
        reach = np.abs(a) @ b_radius + a_radius @ up(np.abs(b) + b_radius)
        # every sum above is of c non-negative terms: gamma_c covers its own rounding too
        error = inner * (1.01 * _UNIT) * (size + reach) + inner * _TINY
        lo, hi = down(product - up(reach + 2.0 * error)), up(product + up(reach + 2.0 * error))
    known = np.isfinite(lo) & np.isfinite(hi)
    return Interval(np.where(known, lo, -np.inf), np.where(known, hi, np.inf))


def applied(matrix: NDArray[np.float64] | sps.csr_array, vector: Interval) -> Interval:
    """Enclose the product of a matrix of numbers with a vector of intervals.

    Parameters
    ----------
    matrix : (m, n) float
        Dense or sparse.
    vector : Interval (n,)

    Returns
    -------
    Interval (m,)
    """
    inner = matrix.shape[1] + 4.0
    relative = inner * (1.01 * _UNIT)
    with np.errstate(over="ignore", invalid="ignore"):
        middle = vector.middle()
        doubt = up(vector.radius(middle) + up(relative * np.abs(middle)))
        product, reach = matrix @ middle, abs(matrix) @ (doubt + inner * _TINY)
        # a sum of c non-negative terms: gamma_c covers its own rounding too
        reach = up(up(reach + up(2.0 * relative * reach)) + inner * _TINY)
        lo, hi = down(product - reach), up(product + reach)
    known = np.isfinite(lo) & np.isfinite(hi)
    return Interval(np.where(known, lo, -np.inf), np.where(known, hi, np.inf))


def exact_values(
    words: Words,
    coefficients: NDArray[np.float64],
    row: NDArray[np.int64],
    size: int,
    x: Sequence[Fraction],
) -> list[Fraction]:
    """Evaluate stacked polynomials at a rational point, exactly.

    Terms are integers over powers of two and odd denominators, so that only sums of terms with
    different odd denominators need fractions: few, since doubles have none.

    Parameters
    ----------
    words : (T, D) int32
    coefficients : (T,) float
    row : (T,) int
        The polynomial of each term.
    size : int
        Number of polynomials.
    x : sequence of Fraction, length n
    """
    places = [(v.denominator & -v.denominator).bit_length() - 1 for v in x]
    parts = [
        (v.numerator, place, v.denominator >> place) for v, place in zip(x, places, strict=True)
    ]
    sums: dict[tuple[int, int], tuple[int, int]] = {}  # by polynomial and odd denominator
    vanishes = np.array([False, *(v == 0 for v in x)])
    left = ~vanishes[words].any(axis=1)
    for letters, coefficient, number in zip(
        words[left].tolist(), coefficients[left].tolist(), row[left].tolist(), strict=True
    ):
        top, bottom = coefficient.as_integer_ratio()
        place, odd = bottom.bit_length() - 1, 1  # the term is top / (odd 2^place)
        for letter in letters:
            if letter:
                factor, more, part = parts[letter - 1]
                top, place, odd = top * factor, place + more, odd * part
        before, at = sums.get((number, odd), (0, 0))
        common = max(place, at)
        sums[number, odd] = (before << common - at) + (top << common - place), common
    values = [Fraction(0)] * size
    for (number, odd), (top, place) in sums.items():
        values[number] += Fraction(top, odd << place)
    return values
