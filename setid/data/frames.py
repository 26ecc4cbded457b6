"""The door of setid to pandas, which is optional, and to other tables with columns by name."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import real_array, without_mask
from setid.data.tables import Column
from setid.errors import DataError

__all__ = ["check_indices", "frame_column", "require_pandas", "series_names"]


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


def series_names(given: Any) -> tuple[str, ...] | None:
    """Read column names of a DataFrame or of a Series; None without any.

    Parameters
    ----------
    given : object
        Anything that stands for channels.
    """
    names = getattr(given, "columns", None)
    every = [getattr(given, "name", None)] if names is None else list(names)
    texts = tuple(name for name in every if isinstance(name, str) and name)
    return texts if texts and len(texts) == len(every) else None


def check_indices(u: Any, y: Any) -> None:
    """Refuse tables whose rows have different indices: samples are paired by place.

    Parameters
    ----------
    u, y : object
        Anything that stands for channels.

    Raises
    ------
    DataError
        If both have an index, and these differ.
    """
    one, two = getattr(u, "index", None), getattr(y, "index", None)
    if one is None or two is None or not hasattr(one, "equals"):
        return
    if not one.equals(two):
        raise DataError(
            "u, y: found two indices that differ, expected one: samples are paired by their "
            "place; join them first, or give u.to_numpy() and y.to_numpy()"
        )


def frame_column(frame: Any, name: Column, dates: bool = False) -> tuple[NDArray[np.float64], str]:
    """Read a DataFrame's column (N,) as doubles, missing values as NaN, and its unit.

    Parameters
    ----------
    frame : DataFrame
        Of pandas, or another with columns by name that go to numpy.
    name : str or int
        As the frame calls it. Where the frame has two lines of names, the first of them; the
        second holds the unit.
    dates : bool
        Whether dates are wanted, as seconds since the first, and the index where that has the
        name, or none and ``"index"`` is asked for.

    Raises
    ------
    DataError
        If there is no such column, or it holds something else.
    """
    column, unit = _found(frame, name, dates)
    values = _seconds(column) if dates else None
    if values is not None:
        return values, "s"
    values = without_mask(column)
    if values.dtype.kind == "O":  # columns with marks of missing values
        values = np.array([np.nan if _is_gap(item) else item for item in values], object)
    wrong = values.dtype.kind in "bmM"  # all of them
    for sample, value in enumerate(values.tolist()):
        if wrong or isinstance(value, (str, bytes, bool)):
            raise DataError(
                f"frame, column {name!r}, sample {sample}: found {values[sample]!r:.40}, "
                "expected a real number"
            )
    found = real_array(values, f"frame, column {name!r}", DataError)
    if found.ndim != 1:
        raise DataError(f"frame, column {name!r}: found shape {found.shape}, expected (N,)")
    return found, unit


def _found(frame: Any, name: Column, index: bool) -> tuple[Any, str]:
    """The column or index of a name, and its unit."""
    known = getattr(frame, "columns", None)
    if known is None:
        raise DataError(f"frame: found {type(frame).__name__}, expected a DataFrame")
    known = list(known)
    pairs = [key for key in known if isinstance(key, tuple) and len(key) == 2 and key[0] == name]
    if known.count(name) == 1:
        return frame[name], ""
    if len(pairs) == 1:
        return frame[pairs[0]], str(pairs[0][1]).strip("[]()")
    own = getattr(frame, "index", None)
    if index and own is not None and (own.name == name or (own.name is None and name == "index")):
        return own, ""
    raise DataError(f"frame: found no single column {name!r}, expected one of {known!r:.200}")


def _seconds(column: Any) -> NDArray[np.float64] | None:
    """Seconds since the first of dates or of spans of time, NaN where one is missing."""
    dates = getattr(column, "dt", column)
    if getattr(dates, "tz", None) is not None:
        column = dates.tz_convert(None)
    values = without_mask(column)
    if values.dtype.kind not in "mM":
        return None
    if values.size == 0:
        return np.zeros(0)
    return np.asarray((values - values[0]) / np.timedelta64(1, "s"), np.float64)


def _is_gap(item: Any) -> bool:
    """Tell marks of missing values of any table from values."""
    return item is None or type(item).__name__ in ("NAType", "NaTType")
