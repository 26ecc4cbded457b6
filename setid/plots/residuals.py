"""Pictures of residuals and their bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from setid.plots.axes import PROVED, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from setid.bands.residuals import Residuals

__all__ = ["plot_residuals"]


def plot_residuals(residuals: Residuals, ax: Axes | None = None) -> Axes:
    """Draw one-step residuals as shares of the bound that noise can explain.

    Parameters
    ----------
    residuals : Residuals
    ax : matplotlib Axes, optional

    Returns
    -------
    matplotlib Axes
    """
    axes = new_axes(ax, (8.0, 3.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = residuals.values / residuals.bound
    for output in np.unique(residuals.output):
        part = residuals.output == output
        axes.plot(residuals.row[part], share[part], ".", ms=4, label=f"y{output}")
    for edge in (-1.0, 1.0):
        axes.axhline(edge, color=PROVED, lw=1)
    axes.set_xlabel("sample")
    axes.set_ylabel("residual / bound")
    axes.legend(loc="best")
    axes.grid(alpha=0.3)
    return axes
