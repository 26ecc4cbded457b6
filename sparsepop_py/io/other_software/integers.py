"""Rows with two ends, and integer variables: binaries by an equation, others as bits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction

import numpy as np

from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial
from sparsepop_py.errors import ProblemError
from sparsepop_py.problem.problem import Problem, Sense

__all__ = ["between", "problem_with_integers"]

_MOST_BITS = 30  # an integer variable may take at most 2^30 values


def problem_with_integers(
    objective: Polynomial,
    constraints: Iterable[Constraint],
    bounds: tuple[Sequence[float | Fraction], Sequence[float | Fraction]],
    names: Sequence[str],
    integer: Iterable[int],
    sense: Sense = "min",
) -> Problem:
    """Make a problem some of whose variables are integers.

    Parameters
    ----------
    objective : Polynomial
        In the n variables; as stored, so that it is minimised whatever ``sense`` is.
    constraints : iterable of Constraint
    bounds : (n,) numbers, (n,) numbers
        Lower and upper; -inf and inf for none.
    names : sequence of str
    integer : iterable of int
        Variables, from 0. One with bounds 0 and 1 adds b^2 - b == 0, one with a single value
        nothing. Any other is its lower bound plus a sum of bits, further variables ``NAME_bit0``
        and so on.
    sense : {"min", "max"}

    Returns
    -------
    Problem
        Its first n variables are those that were given.

    Raises
    ------
    ProblemError
        If an integer variable has no two bounds, or no integer between them.
    """
    low, high = (np.array(side, object) for side in bounds)  # as given
    chosen = sorted(set(integer))
    count = {v: _bits(names[v], low[v], high[v]) for v in chosen}
    labels = [*names, *(f"{names[v]}_bit{k}" for v in chosen for k in range(count[v]))]
    n, bit = len(labels), len(names)
    rows = [Constraint(_wider(row.polynomial, labels), row.kind, row.name) for row in constraints]
    for v in chosen:
        low[v], high[v] = math.ceil(low[v]), math.floor(high[v])
        if not count[v]:
            if low[v] < high[v]:
                rows.append(_binary(v, n, labels, names[v]))
            continue
        letters = np.array([0, v + 1, *(bit + 1 + k for k in range(count[v]))], np.int32)
        values = np.array([-low[v], 1.0, *(-(2.0**k) for k in range(count[v]))])
        sum_of_bits = Polynomial.from_words(letters[:, None], values, n, labels)
        rows.append(Constraint(sum_of_bits, Kind.ZERO, f"integer {names[v]}"))
        rows += [_binary(bit + k, n, labels, labels[bit + k]) for k in range(count[v])]
        bit += count[v]
    extra = n - len(names)
    return Problem(
        _wider(objective, labels),
        rows,
        np.append(low, np.zeros(extra)),
        np.append(high, np.ones(extra)),
        labels,
        sense=sense,
    )


def between(
    body: Polynomial, low: float | Fraction, high: float | Fraction, name: str
) -> Iterator[Constraint]:
    """Make the constraints of a row with two ends; -inf and inf for none."""
    if low == high:
        yield Constraint(body - low, Kind.ZERO, name)
        return
    if low > -math.inf:
        yield Constraint(body - low, Kind.NONNEGATIVE, name)
    if high < math.inf:
        yield Constraint(high - body, Kind.NONNEGATIVE, name)


def _bits(name: str, low: float, high: float) -> int:
    """Count the bits that hold the distance from the lower bound, 0 for a binary."""
    ends = f"{float(low):g}, {float(high):g}"
    if not math.isfinite(low) or not math.isfinite(high) or high - low >= 2**_MOST_BITS:
        raise ProblemError(
            f"{name}: found an integer variable with bounds {ends}, expected two bounds less "
            f"than 2^{_MOST_BITS} apart"
        )
    least, most = math.ceil(low), math.floor(high)
    if least > most:
        raise ProblemError(f"{name}: found no integer between its bounds {ends}")
    if max(-least, most) > 2**53:
        raise ProblemError(
            f"{name}: found an integer variable with bounds {ends}, expected none beyond 2^53"
        )
    return 0 if (least, most) == (0, 1) else (most - least).bit_length()


def _binary(variable: int, n: int, labels: Sequence[str], name: str) -> Constraint:
    letter = variable + 1
    words = np.array([[0, letter], [letter, letter]], np.int32)
    row = Polynomial.from_words(words, np.array([-1.0, 1.0]), n, labels)
    return Constraint(row, Kind.ZERO, f"binary {name}")


def _wider(polynomial: Polynomial, labels: Sequence[str]) -> Polynomial:
    """Take more variables; monomials and coefficients stay."""
    return polynomial.within(len(labels), tuple(labels))
