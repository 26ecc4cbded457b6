"""Check arrays that come from outside, and keep them from changing afterwards."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.errors import ProblemError

__all__ = ["are_indices", "are_numbers", "at_least", "frozen", "is_index", "read_only"]


def read_only(values: Any, kinds: str, field: str, dimensions: int = 1) -> NDArray[Any]:
    """Return a read-only array, a copy unless the given one is read-only already.

    Parameters
    ----------
    values : array_like
    kinds : str
        Kinds of entries that are allowed, as NumPy calls them: "f" floats, "i" integers,
        "b" booleans. Integers become doubles where only floats are allowed.
    field : str
        Name for the message.
    dimensions : int

    Raises
    ------
    ProblemError
        If the entries are of another kind, or the array has another number of dimensions.
    """
    try:
        array = np.asarray(values)
    except ValueError:
        array = np.array(values, object)
    if kinds == "f" and array.dtype.kind in "iu":
        array = array.astype(float)
    if not array.size and array.dtype.kind not in kinds:
        array = np.zeros(array.shape, "i8" if kinds == "i" else float)  # of an empty list
    if array.dtype.kind not in kinds or array.ndim != dimensions:
        raise ProblemError(
            f"{field}: found {array.dtype} of shape {array.shape}, expected {dimensions} "
            f"dimension(s) of {_KINDS[kinds]}"
        )
    if array.flags.writeable or not array.flags.owndata:
        array = array.copy()
        array.flags.writeable = False
    return array


_KINDS = {"f": "numbers", "i": "integers", "b": "booleans"}


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


def at_least(array: NDArray[Any], other: NDArray[Any]) -> bool:
    """Check that no entry is below that of another array, which has the same shape.

    Parameters
    ----------
    array, other : array
        Without this check of shapes an empty array would be at least anything.
    """
    return array.shape == other.shape and bool(np.all(array >= other))


def is_index(number: object, stop: int) -> bool:
    """Check that an object is a whole number from 0 to below ``stop``."""
    whole = isinstance(number, (int, np.integer)) and not isinstance(number, bool)
    return whole and 0 <= number < stop  # type: ignore[operator]
