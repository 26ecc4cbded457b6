"""Axes, colours and fills of all pictures of setid.

Proved sets are filled in blue, what is attained or sampled is orange. Every legend says
which it is. Functions return axes and change nothing but them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from setid.errors import SetidError
from sparsepop_py.errors import ProblemError
from sparsepop_py.plots import new_axes as engine_axes
from sparsepop_py.plots import plain, require_matplotlib

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from setid.data.record import IOData

__all__ = [
    "ATTAINED",
    "COLOUR",
    "PROVED",
    "clip",
    "far",
    "fill_between",
    "ink",
    "new_axes",
    "over_time",
    "plain",
    "remark",
    "require_matplotlib",
    "stacked_axes",
    "time_label",
    "title",
]

PROVED, ATTAINED = "#0072B2", "#D55E00"  # Okabe and Ito
_FAR = 1e30
COLOUR = {"proved": PROVED, "sampled": ATTAINED}


def ink() -> str:
    """Take the colour of texts in the style: black on light, white on dark pages."""
    return str(require_matplotlib().rcParams["text.color"])


def new_axes(ax: Axes | None, size: tuple[float, float] = (7.0, 5.2)) -> Axes:
    """Take the given axes, or make those of a new figure.

    Parameters
    ----------
    ax : matplotlib Axes or None
    size : (float, float)
        Of a new figure, in inches.

    Raises
    ------
    SetidError
        If ``ax`` is something else.
    """
    try:
        return engine_axes(ax, size)
    except ProblemError as error:
        raise SetidError(str(error)) from None


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
        If there are more or fewer, or others than axes.
    """
    plt = require_matplotlib()
    if ax is not None:
        given = np.ravel(np.asarray(ax, object))
        if given.size != count:
            raise SetidError(f"ax: found {given.size} axes, expected {count}, one below the other")
        return np.array([new_axes(each) for each in given], object)
    size = (8.0, height * count + 0.8)
    _, grid = plt.subplots(count, 1, sharex=True, squeeze=False, figsize=size, layout="constrained")
    return np.asarray(grid[:, 0])


def over_time(
    data: IOData, count: int, height: float, ax: Any = None
) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Make axes one below the other, and the times of all samples (N,)."""
    axes = stacked_axes(ax, count, height)
    for axis in axes:
        axis.grid(alpha=0.3)
    axes[-1].set_xlabel(time_label(data.time_unit))
    return axes, np.asarray((np.arange(data.samples) + data.record) * data.Ts, np.float64)


def time_label(unit: str) -> str:
    """Write the label of an axis of times, with their unit where there is one."""
    return plain(f"time [{unit}]") if unit else "time"


def fill_between(
    ax: Axes,
    time: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    colour: str,
    label: str,
    alpha: float = 0.3,
    step: Literal["post"] | None = None,
) -> None:
    """Fill between two lines or stairs, leaving gaps where one of them is not finite."""
    finite = np.isfinite(low) & np.isfinite(high)
    a, b = np.where(finite, low, 0.0), np.where(finite, high, 0.0)
    style: dict[str, Any] = {"color": colour, "alpha": alpha, "lw": 0, "label": label}
    ax.fill_between(time, a, b, where=finite, step=step, **style)


def far(
    low: NDArray[np.float64], high: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Move infinite ends of a band far outside; for pictures that :func:`clip` it."""
    return np.clip(low, -_FAR, _FAR), np.clip(high, -_FAR, _FAR)


_ABOVE = 14.0  # points: a title above a remark
_ROOM = 0.5  # of the range of what a picture follows, above and below it


def clip(ax: Axes, shown: NDArray[np.float64], band: tuple[NDArray[Any], NDArray[Any]]) -> bool:
    """Let the vertical axis follow some values where a band goes far beyond, and say so.

    Parameters
    ----------
    ax : matplotlib Axes
    shown : (M,) float
        What is to be seen, such as readings; others than numbers are left out.
    band : (low, high), each (N,) float

    Returns
    -------
    bool
        Whether the band was clipped.
    """
    known = shown[np.isfinite(shown)]
    if not known.size:
        return False
    low, high = float(known.min()), float(known.max())
    room = _ROOM * ((high - low) or abs(high) or 1.0)
    ends = low - room, high + room
    with np.errstate(invalid="ignore"):
        beyond = (band[0] < ends[0]) | (band[1] > ends[1])
        silent = (band[0] < ends[0]) & (band[1] > ends[1])
    if not np.any(beyond):
        return False
    ax.set_ylim(*ends)
    lines = [f"band clipped at {int(np.sum(beyond))} of {beyond.size} samples"]
    if np.any(silent):
        lines.append(f"fills the picture at {int(np.sum(silent))}")
    remark(ax, ", ".join(lines))
    return True


def remark(ax: Axes, text: str) -> None:
    """Write what a picture does not show above its right corner; nothing where there is no text."""
    if text:
        ax.text(1.0, 1.01, text, transform=ax.transAxes, fontsize="x-small", ha="right")


def title(ax: Axes, text: str) -> None:
    """Write a title, above a remark where there is one."""
    ax.set_title(text, pad=_ABOVE if ax.texts else None)
