"""Pictures of the feasible set on two parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

from setid.plots.axes import ATTAINED, PROVED, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from setid.feasible_set.projections import Projection

__all__ = ["plot_projection"]


def plot_projection(projection: Projection, ax: Axes | None = None) -> Axes:
    """Draw the outline of the feasible set on two parameters, and attained points.

    Parameters
    ----------
    projection : Projection
    ax : matplotlib Axes, optional

    Returns
    -------
    matplotlib Axes
    """
    axes = new_axes(ax, (5.5, 5.0))
    word = "exact" if projection.exact else "proved outline"
    axes.fill(*projection.outline.T, color=PROVED, alpha=0.3, label=word)
    axes.plot(*projection.attained.T, "o", color=ATTAINED, ms=4, label="attained")
    axes.set_xlabel(projection.names[0])
    axes.set_ylabel(projection.names[1])
    axes.grid(alpha=0.3)
    axes.legend(loc="best")
    return axes
