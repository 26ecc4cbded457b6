"""Axes, colours and fills of all pictures of setid.

Proved sets are filled in blue, what is attained or sampled is orange. Every legend says
which it is. Functions return axes and change nothing but them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from setid.errors import SetidError
from sparsepop_py.plots import new_axes, require_matplotlib

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from setid.data.record import IOData

__all__ = [
    "ATTAINED",
    "COLOUR",
    "PROVED",
    "READING",
    "fill_between",
    "ink",
    "new_axes",
    "over_time",
    "require_matplotlib",
    "stacked_axes",
]

PROVED, ATTAINED, READING = "#0072B2", "#D55E00", "black"  # Okabe and Ito
COLOUR = {"proved": PROVED, "sampled": ATTAINED}


def ink() -> str:
    """The colour of texts in the style that is in use: black on light, white on dark pages."""
    return str(require_matplotlib().rcParams["text.color"])


def stacked_axes(ax: Any, count: int, height: float) -> NDArray[Any]:
    """Take the given axes, or make axes one below the other.

    Parameters
    ----------
    ax : matplotlib Axes, array of Axes or None
        As many as are needed.
    count : int
    height : float
        Of each new one, in inches.

    Raises
    ------
    SetidError
        If there are more or fewer.
    """
    plt = require_matplotlib()
    if ax is not None:
        given = np.ravel(np.asarray(ax, object))
        if given.size != count:
            raise SetidError(f"ax: found {given.size} axes, expected {count}, one a channel")
        return given
    size = (8.0, height * count + 0.8)
    _, grid = plt.subplots(count, 1, sharex=True, squeeze=False, figsize=size, layout="constrained")
    return np.asarray(grid[:, 0])


def over_time(
    data: IOData, count: int, height: float, ax: Any = None
) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Axes one below the other, and the times of all samples (N,)."""
    axes = stacked_axes(ax, count, height)
    for axis in axes:
        axis.grid(alpha=0.3)
    axes[-1].set_xlabel(f"time [{data.time_unit}]" if data.time_unit else "time")
    return axes, np.asarray((np.arange(data.samples) + data.record) * data.Ts, np.float64)


def fill_between(
    ax: Axes,
    time: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    colour: str,
    label: str,
    alpha: float = 0.3,
) -> None:
    """Fill between two lines, leaving gaps where one of them is not finite."""
    finite = np.isfinite(low) & np.isfinite(high)
    a, b = np.where(finite, low, 0.0), np.where(finite, high, 0.0)
    ax.fill_between(time, a, b, where=finite, color=colour, alpha=alpha, lw=0, label=label)
