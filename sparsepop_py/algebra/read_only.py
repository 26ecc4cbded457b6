"""Arrays that stay read-only in deep copies and pickles, which NumPy makes writable.

What follows from arrays is kept beside them, so that a change of one would leave the rest.
"""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["ReadOnly"]


class ReadOnly:
    """Base of records whose copies have read-only arrays, as they themselves do.

    Examples
    --------
    >>> import copy
    >>> import sparsepop_py as sp
    >>> x, = sp.variables(1)
    >>> copy.deepcopy(x).coefficients.flags.writeable
    False
    """

    def __setstate__(self, state: dict[str, Any]) -> None:
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
        self.__dict__.update(state)
