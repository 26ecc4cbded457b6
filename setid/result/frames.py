"""Tables of results for pandas, which is optional."""

from __future__ import annotations

from math import nan
from typing import Any

from setid.data.frames import require_pandas
from setid.feasible_set.feasible_set import FeasibleSet

__all__ = ["to_frame"]


def to_frame(result: FeasibleSet) -> Any:
    """Make a DataFrame of the intervals, one row a parameter.

    Parameters
    ----------
    result : FeasibleSet

    Returns
    -------
    pandas.DataFrame
    """
    rows = {}
    for name, item in result.intervals.items():
        inner = (nan, nan) if item.inner is None else item.inner
        rows[name] = (*item.outer, *inner, item.width, item.centre, str(item.status))
    columns = ["outer_low", "outer_high", "inner_low", "inner_high", "width", "centre", "status"]
    frame = require_pandas().DataFrame.from_dict(rows, orient="index", columns=columns)
    frame.index.name = "parameter"
    return frame
