"""Arrays that certificates have in common: objectives over one feasible set share most of them.

What multipliers multiply, and by which monomials, is the same for all objectives and for most
parts of a tree; only the numbers differ. Equal arrays are one object where certificates are made,
so that those that are stored together hold them once.
"""

from __future__ import annotations

import hashlib
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

__all__ = ["indices", "interned"]

_IN_USE: WeakValueDictionary[bytes, NDArray[Any]] = WeakValueDictionary()


def interned(array: NDArray[Any]) -> NDArray[Any]:
    """Return the array in use that equals this one; read-only, the first time a copy.

    Parameters
    ----------
    array : array
        Equal means the same type, shape and entries.

    Returns
    -------
    array

    Examples
    --------
    >>> import numpy as np
    >>> first = interned(np.arange(3))
    >>> interned(np.arange(3)) is first
    True
    """
    about = f"{array.dtype.str} {array.shape} ".encode()
    key = hashlib.blake2b(about + array.tobytes(), digest_size=20).digest()
    found = _IN_USE.get(key)
    if found is None or found.shape != array.shape or found.tobytes() != array.tobytes():
        found = np.array(array, order="C")
        found.flags.writeable = False
        _IN_USE[key] = found
    return found


def indices(array: NDArray[Any]) -> NDArray[np.int32]:
    """Read whole numbers from 0 to below 2^31, as certificates store them."""
    return interned(array.astype(np.int32))
