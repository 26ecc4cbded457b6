"""The door of setid to pandas, which is optional."""

from __future__ import annotations

from types import ModuleType

import sparsepop_py as sp

__all__ = ["require_pandas"]


def require_pandas() -> ModuleType:
    """Import pandas.

    Raises
    ------
    SolverNotFound
        If it is missing; the message says how to install it.
    """
    try:
        import pandas
    except ImportError as error:
        raise sp.SolverNotFound(
            "pandas is missing; install it with: pip install 'sparsepop-py[frames]'"
        ) from error
    return pandas
