"""Arrays that stay read-only in deep copies and pickles, which NumPy makes writable.

What follows from arrays is kept beside them, so that a change of one would leave the rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

__all__ = ["ReadOnly"]


class ReadOnly:
    """Base of records whose copies have read-only arrays, as they themselves do.

    Arrays in tuples, lists and mappings of a record are meant too.

    Examples
    --------
    >>> import copy
    >>> import sparsepop_py as sp
    >>> x, = sp.variables(1)
    >>> copy.deepcopy(x).coefficients.flags.writeable
    False
    """

    __slots__ = ()

    def __init_subclass__(cls, **named: Any) -> None:
        """Name the method in each class: dataclasses with slots add one where they find none."""
        super().__init_subclass__(**named)
        cls.__setstate__ = ReadOnly.__setstate__  # type: ignore[method-assign]

    def __setstate__(self, state: dict[str, Any] | list[Any]) -> None:
        """Fill a copy: attributes by name, or those of a dataclass with slots in order."""
        if isinstance(state, dict):
            self.__dict__.update(state)
            values = list(state.values())
        else:
            values = state
            for field, value in zip(fields(self), values, strict=True):  # type: ignore[arg-type]
                object.__setattr__(self, field.name, value)
        _freeze(values)


def _freeze(value: Any) -> None:
    if isinstance(value, np.ndarray):
        value.flags.writeable = False
    elif isinstance(value, (tuple, list)):
        for part in value:
            _freeze(part)
    elif isinstance(value, Mapping):
        _freeze(list(value.values()))
