"""Pictures of outputs with their bands."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from setid.feasible_points.modelled_outputs import per_cent
from setid.plots.axes import (
    ATTAINED,
    COLOUR,
    clip,
    far,
    fill_between,
    ink,
    over_time,
    plain,
    title,
)

if TYPE_CHECKING:
    from setid.analysis.fit import Fit
    from setid.bands.comparison import Comparison
    from setid.bands.outputs import OutputBand

__all__ = ["plot_comparison", "plot_fit", "plot_output_band"]

Reals = NDArray[np.float64]


def plot_output_band(band: OutputBand, ax: Any = None) -> NDArray[Any]:
    """Draw readings, nominal output and bands; one axis an output.

    The vertical axis follows the readings; a band that goes far beyond is clipped, and a caption
    says at how many samples.

    Parameters
    ----------
    band : OutputBand
    ax : array of matplotlib Axes, optional
        One an output.

    Returns
    -------
    (ny,) array of matplotlib Axes
    """
    data = band.data
    axes, time = over_time(data, data.outputs, 2.4, ax)
    colour = COLOUR[band.kind]
    for i, axis in enumerate(axes):
        wide = band.reading_low[:, i], band.reading_high[:, i]
        models = band.low[:, i], band.high[:, i]
        fill_between(axis, time, *far(*wide), colour, f"readings ({band.kind})", 0.15)
        fill_between(axis, time, *far(*models), colour, f"models ({band.kind})", 0.35)
        attained = _attained(band, i)
        if attained is not None:
            fill_between(axis, time, *attained, ATTAINED, "models (attained)", 0.5)
        axis.plot(time, band.nominal[:, i], color=colour, lw=1, label="nominal")
        axis.plot(time, data.y[:, i], ".", color=ink(), ms=3, label="reading")
        clip(axis, data.y[:, i], wide)
        axis.set_ylabel(plain(data.output_labels[i]))
    axes[0].legend(loc="best", ncols=5, fontsize="small")
    return axes


def _attained(band: OutputBand, i: int) -> tuple[Reals, Reals] | None:
    """Range of one output over members, None where unknown."""
    if band.attained_low is None or band.attained_high is None:
        return None
    low, high = band.attained_low[:, i], band.attained_high[:, i]
    return (low, high) if np.any(np.isfinite(high - low)) else None


def plot_fit(found: Fit, ax: Any = None) -> NDArray[Any]:
    """Draw readings and outputs of a fit, the fit of each output in its title.

    Parameters
    ----------
    found : Fit
    ax : array of matplotlib Axes, optional
        One an output.

    Returns
    -------
    (ny,) array of matplotlib Axes
    """
    data = found.data
    axes, time = over_time(data, data.outputs, 2.4, ax)
    for i, axis in enumerate(axes):
        axis.plot(time, found.outputs[:, i], color=COLOUR["sampled"], lw=1, label="model")
        axis.plot(time, data.y[:, i], ".", color=ink(), ms=3, label="reading")
        axis.set_ylabel(plain(data.output_labels[i]))
        axis.set_title(f"fit {per_cent(found.fit[i : i + 1])}")
    axes[0].legend(loc="best", ncols=2, fontsize="small")
    return axes


def plot_comparison(comparison: Comparison, ax: Any = None) -> NDArray[Any]:
    """Draw the band of a comparison, the fit of each output in its title.

    Parameters
    ----------
    comparison : Comparison
    ax : array of matplotlib Axes, optional
        One an output.

    Returns
    -------
    (ny,) array of matplotlib Axes
    """
    axes = plot_output_band(comparison.band, ax)
    for axis, value in zip(axes, comparison.fit, strict=True):
        title(axis, f"{comparison.band.mode}: fit {per_cent(np.array([value]))}")
    return axes
