"""What multipliers multiply: one numbering for relaxations and certificates.

With m constraints and n variables, generator 0 is the constant 1, 1..m are the
constraints, and three families of n follow for the bounds of each variable:

    box    (u - x)(x - l)    where both bounds are finite,
    lower  x - l             where l is finite,
    upper  u - x             where u is finite;

the zero polynomial stands where a bound is missing or the variable is fixed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from . import monomials
from .monomials import Words

__all__ = ["bound_family", "bound_terms", "count", "single_letters", "stack_words"]


def count(rows: int, dimension: int) -> int:
    """Number of generators of a problem with that many constraints and variables."""
    return 1 + rows + 3 * dimension


def bound_family(rows: int, dimension: int) -> tuple[slice, slice, slice]:
    """Where the families box, lower and upper stand."""
    starts = 1 + rows + dimension * np.arange(4)
    box, lower, upper = (slice(int(a), int(b)) for a, b in zip(starts, starts[1:], strict=False))
    return box, lower, upper


def bound_terms(
    lower: NDArray[np.float64], upper: NDArray[np.float64], rows: int
) -> tuple[Words, NDArray[np.float64], NDArray[np.int64]]:
    """Words, coefficients and generator numbers of the bounds' polynomials.

    For bounds 0 and +-1, as scaled variables have them, every coefficient is exact.
    """
    n = lower.size
    open_ = lower < upper
    low, high = np.isfinite(lower) & open_, np.isfinite(upper) & open_
    both = low & high
    l, u = np.where(low, lower, 0.0), np.where(high, upper, 0.0)
    letter = np.arange(1, n + 1, dtype=np.int32)
    zero = np.zeros(n, np.int32)
    one, linear, square = (
        np.stack(pair, axis=1) for pair in ((zero, zero), (zero, letter), (letter, letter))
    )
    box, first, second = (np.arange(f.start, f.stop) for f in bound_family(rows, n))
    parts = [
        (one, np.where(both, -l * u, 0.0), box),
        (linear, np.where(both, l + u, 0.0), box),
        (square, np.where(both, -1.0, 0.0), box),
        (one, -l, first),
        (linear, low * 1.0, first),
        (one, u, second),
        (linear, high * -1.0, second),
    ]
    words = np.concatenate([w for w, _, _ in parts])
    values = np.concatenate([v for _, v, _ in parts])
    index = np.concatenate([i for _, _, i in parts])
    keep = np.flatnonzero(values)
    keep = keep[np.argsort(index[keep], kind="stable")]
    return words[keep], values[keep], index[keep]


def stack_words(constraints: Words, bounds: Words) -> Words:
    """The words of all generators: of the constant 1, of the constraints, of the bounds."""
    width = max(constraints.shape[1], bounds.shape[1])
    parts = [np.zeros((1, width), np.int32), constraints, bounds]
    return np.concatenate([monomials.widen(part, width) for part in parts])


def single_letters(
    lower: NDArray[np.float64], upper: NDArray[np.float64], rows: int, generator: NDArray
) -> NDArray[np.int32]:
    """The word that each generator is up to sign: 0 for 1, v for x_v >= 0 or <= 0, else -1."""
    n = lower.size
    letter = np.full(count(rows, n), -1, np.int32)
    letter[0] = 0
    _, low, high = bound_family(rows, n)
    names = np.arange(1, n + 1)
    letter[low] = np.where((lower == 0) & np.isinf(upper), names, -1)
    letter[high] = np.where((upper == 0) & np.isinf(lower), names, -1)
    return letter[generator]
