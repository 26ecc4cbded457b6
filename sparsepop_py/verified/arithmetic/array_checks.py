"""Checks of arrays that come from outside: certificates are read from files."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["are_indices", "are_numbers", "frozen", "is_index"]


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """Make an array read-only and return it."""
    array.flags.writeable = False
    return array


def are_indices(array: NDArray[Any], stop: int) -> bool:
    """Check for whole numbers in [0, stop) of a type that does not wrap."""
    whole = array.dtype in (np.int32, np.int64)
    return bool(whole and np.all(array >= 0) and np.all(array < stop))


def are_numbers(array: NDArray[Any]) -> bool:
    """Check that entries are finite numbers that doubles hold without rounding."""
    return bool(array.dtype in (np.float64, np.float32) and np.all(np.isfinite(array)))


def is_index(number: object, stop: int) -> bool:
    """Check that an object is a whole number from 0 to below ``stop``."""
    whole = isinstance(number, (int, np.integer)) and not isinstance(number, bool)
    return whole and 0 <= number < stop  # type: ignore[operator]
