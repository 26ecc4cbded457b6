"""Pictures of parameter intervals and ranges."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from setid.plots.axes import ATTAINED, PROVED, ink, new_axes
from sparsepop_py.verified.arithmetic.display import rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from setid.analysis.reparametrise import Reparametrisation
    from setid.export.continuous import ContinuousEstimate
    from setid.feasible_set.feasible_set import FeasibleSet

__all__ = ["plot_intervals", "plot_ranges"]


def plot_intervals(result: FeasibleSet | Reparametrisation, ax: Axes | None = None) -> Axes:
    """Draw the interval of each parameter, proved and attained, relative to its centre.

    Parameters
    ----------
    result : FeasibleSet or Reparametrisation
    ax : matplotlib Axes, optional

    Returns
    -------
    matplotlib Axes
        One line a parameter; the label gives the outer interval, the axis is the distance
        from its centre in per cent of the centre (in half widths where it is about zero).
    """
    intervals = list(result.intervals.values())
    axes = new_axes(ax, (7.0, 0.45 * len(intervals) + 1.4))
    labels = []
    for place, interval in enumerate(intervals):
        low, high = interval.outer
        mark = "" if _by_centre(interval.centre, interval.width) else " *"
        shown = f"[{rounded(low, False, 5)}, {rounded(high, True, 5)}]"
        labels.append(f"{interval.name} in {shown}{mark}")
        if not np.isfinite(interval.centre):
            axes.text(0.0, place, str(interval.status), ha="center", va="center")
            continue
        unit = _unit(interval.centre, interval.width)
        ends = np.array([low, high]) - interval.centre
        axes.plot(ends / unit, [place, place], color=PROVED, lw=7, solid_capstyle="butt")
        if interval.inner is not None:
            inner = np.array(interval.inner) - interval.centre
            axes.plot(inner / unit, [place, place], color=ATTAINED, lw=2.5)
    axes.plot([], [], color=PROVED, lw=7, label="outer (proved)")
    axes.plot([], [], color=ATTAINED, lw=2.5, label="inner (attained)")
    _label_rows(axes, labels, "distance from the centre, % of the centre (* of half the width)")
    return axes


def plot_ranges(found: ContinuousEstimate, ax: Axes | None = None) -> Axes:
    """Draw the range of each sampled coefficient, relative to that of the nominal model.

    Parameters
    ----------
    found : ContinuousEstimate
    ax : matplotlib Axes, optional

    Returns
    -------
    matplotlib Axes
        One line a coefficient; the axis is the distance from the nominal value in per cent of
        it (in half widths where it is within one width of zero).
    """
    axes = new_axes(ax, (7.0, 0.45 * len(found.names) + 1.4))
    labels = []
    for place, (name, value, ends) in enumerate(
        zip(found.names, found.nominal, found.ranges, strict=True)
    ):
        low, high = ends
        mark = "" if _by_centre(value, high - low) else " *"
        labels.append(f"{name}: {low:.5g} to {high:.5g}{mark}")
        axes.plot((ends - value) / _unit(value, high - low), [place] * 2, color=ATTAINED, lw=5)
        axes.plot([0.0], [place], "|", color=ink(), ms=14)
    axes.plot([], [], color=ATTAINED, lw=5, label="members (sampled)")
    axes.plot([], [], "|", color=ink(), ms=14, label="nominal model")
    _label_rows(axes, labels, "distance from the nominal value, % of it (* of half the range)")
    return axes


def _label_rows(axes: Axes, labels: list[str], along: str) -> None:
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(len(labels) - 0.4, -0.6)
    axes.set_xlabel(along)
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False)
    axes.grid(alpha=0.3, axis="x")


def _unit(centre: float, width: float) -> float:
    """1 % of the centre, or of half the width where the interval holds zero."""
    unit = abs(centre) / 100.0 if _by_centre(centre, width) else width / 200.0
    return unit or 1.0


def _by_centre(centre: float, width: float) -> bool:
    return abs(centre) > width
