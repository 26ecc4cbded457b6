"""Coefficients of rows that are rounded to doubles, and how that is said.

A row multiplies parameters with sums of products of numbers and samples. Each coefficient is
computed in doubles; where that is not exact, the row is about another number than the record's.
With no noise at all exact data may fail such a row. So it is said beside the assumptions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from setid.data.record import IOData
from setid.models.equations import Equation, Term

__all__ = ["is_rounded_product", "is_rounded_sum", "rounded_coefficients"]

Reals = NDArray[np.float64]
Mask = NDArray[np.bool_]
_BITS = 26  # of a number that a structure computes: with more, it is taken for rounded
_WHOLE = 2.0**53  # whole numbers up to here are doubles


def rounded_coefficients(
    data: IOData, equations: Sequence[Equation], computed: bool = False
) -> tuple[str, ...]:
    """Say how many products of samples, and how many sums, are no doubles.

    Parameters
    ----------
    data : IOData
    equations : sequence of Equation
    computed : bool
        Whether numbers in terms were computed from others, such as powers of the sampling time.

    Returns
    -------
    tuple of str
        None, one or two sentences.

    Examples
    --------
    >>> from setid.models.equations import Lagged, term
    >>> data = IOData([1.0, 0.5, 0.25], [0.1, 0.2, 0.3])
    >>> own = Equation("y1", (term(1.0, "", Lagged("y1")), term(0.1, "a", Lagged("y1", 1))))
    >>> rounded_coefficients(data, [own])[0][:37]
    '2 coefficients of rows are rounded to'
    """
    signals = {f"y{k + 1}": data.y[:, k] for k in range(data.outputs)}
    signals |= {f"u{k + 1}": data.u[:, k] for k in range(data.inputs)}
    monomials = {item.signals for equation in equations for item in equation.terms}
    products = sum(
        int(np.count_nonzero(is_rounded_product(_factors([Term(1.0, (), monomial)], signals)[0])))
        for monomial in monomials
        if len(monomial) > 1 and all(factor.signal in signals for factor in monomial)
    )
    sums = 0
    for equation in equations:
        groups = dict[tuple[str, ...], list[Term]]()
        for item in equation.terms:
            if all(factor.signal in signals for factor in item.signals):
                groups.setdefault(item.parameters, []).append(item)
        sums += sum(_count(group, signals, computed) for group in groups.values())
    found = []
    if products:
        found.append(
            f"{products} products of samples are rounded to nearest doubles, each by at most "
            "1.2e-16 of its size: what is proved is about the rounded products"
        )
    if sums:
        found.append(
            f"{sums} coefficients of rows are rounded to doubles, by about 1e-16 of the sizes that "
            "are added in each: what is proved is about the rounded rows"
        )
    return tuple(found)


def _factors(items: Sequence[Term], signals: Mapping[str, Reals]) -> list[list[Reals]]:
    """The samples of each term's factors, in all rows from the largest lag on."""
    longest = max((factor.lag for item in items for factor in item.signals), default=0)
    return [
        [signals[f.signal][longest - f.lag : signals[f.signal].size - f.lag] for f in item.signals]
        for item in items
    ]


def _count(items: Sequence[Term], signals: Mapping[str, Reals], computed: bool) -> int:
    """Count rows in which the coefficient that terms make together is no double."""
    if len(items) == 1 and _bits(items[0].coefficient) == 1:
        return 0
    summands, rounded = list[Reals](), np.zeros(1, bool)
    for item, factors in zip(items, _factors(items, signals), strict=True):
        value = np.array([item.coefficient])
        with np.errstate(all="ignore"):
            product = np.atleast_1d(np.prod(np.broadcast_arrays(1.0, *factors), axis=0))
        if _bits(item.coefficient) > 1:
            rounded = rounded | is_rounded_product([product, np.broadcast_to(value, product.shape)])
        if computed and _bits(item.coefficient) > _BITS:
            rounded = rounded | (product != 0.0)
        with np.errstate(all="ignore"):
            summands.append(np.atleast_1d(value * product))
    found = rounded | is_rounded_sum(summands)
    return int(np.count_nonzero(found & ~np.isnan(sum(summands, np.zeros(1)))))


def _bits(value: float) -> int:
    """Count binary digits from the first to the last one that is not zero."""
    whole = abs(value.as_integer_ratio()[0])
    return (whole // (whole & -whole)).bit_length() if whole else 0


def is_rounded_sum(summands: Sequence[Reals]) -> Mask:
    """Find sums of doubles that may be no doubles, in whatever order they are added.

    Parameters
    ----------
    summands : sequence of (N,) float

    Returns
    -------
    (N,) bool
        False only where all partial sums are doubles: the sizes add up to at most 2^53 units of
        the last digit in any of them.

    Examples
    --------
    >>> is_rounded_sum([np.array([0.5, 0.1]), np.array([0.25, 0.2])])
    array([False,  True])
    """
    if len(summands) < 2:
        return np.zeros(1, bool)
    table = np.array(np.broadcast_arrays(*summands))
    fraction, exponent = np.frexp(np.where(np.isfinite(table), table, 0.0))
    whole = np.abs(fraction * _WHOLE).astype(np.int64)
    last = np.frexp((whole & -whole).astype(np.float64))[1] - 1
    unit = np.where(whole != 0, exponent - 53 + last, 2**20).min(axis=0)
    with np.errstate(over="ignore"):
        size = np.ldexp(np.abs(fraction), exponent - unit).sum(axis=0)
    return np.asarray((np.count_nonzero(whole, axis=0) > 1) & (size > _WHOLE))


def is_rounded_product(factors: Sequence[Reals]) -> Mask:
    """Find products of arrays that are no doubles (T. J. Dekker, 1971, mul12).

    Parameters
    ----------
    factors : sequence of (N,) float
    """
    product, lost = factors[0], np.zeros(factors[0].size, bool)
    with np.errstate(all="ignore"):
        for other in factors[1:]:
            found = product * other
            one, two = _halves(product), _halves(other)
            error = one[0] * two[0] - found + one[0] * two[1] + one[1] * two[0] + one[1] * two[1]
            tiny = (np.abs(found) < 1e-290) & (product != 0) & (other != 0)
            lost |= (error != 0) | tiny
            product = found
    return lost & ~np.isnan(product)


def _halves(x: Reals) -> tuple[Reals, Reals]:
    """Split doubles into two of 26 bits each (G. W. Veltkamp)."""
    high = x * 134217729.0
    high = high - (high - x)
    return high, x - high
