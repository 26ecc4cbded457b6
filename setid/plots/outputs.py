"""Pictures of outputs with their bands."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from setid.plots.axes import COLOUR, fill_between, ink, over_time

if TYPE_CHECKING:
    from setid.bands.outputs import Comparison, OutputBand
    from setid.fit import Fit

__all__ = ["plot_comparison", "plot_fit", "plot_output_band"]


def plot_output_band(band: OutputBand, ax: Any = None) -> NDArray[Any]:
    """Draw readings, nominal output, and both bands; one axis an output.

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
        fill_between(axis, time, *wide, colour, f"readings ({band.kind})", 0.15)
        fill_between(
            axis, time, band.low[:, i], band.high[:, i], colour, f"models ({band.kind})", 0.35
        )
        axis.plot(time, band.nominal[:, i], color=colour, lw=1, label="nominal")
        axis.plot(time, data.y[:, i], ".", color=ink(), ms=3, label="reading")
        axis.set_ylabel(data.output_labels[i])
    axes[0].legend(loc="best", ncols=4, fontsize="small")
    return axes


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
        axis.set_ylabel(data.output_labels[i])
        axis.set_title(f"fit {found.fit[i]:.1f} %")
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
        axis.set_title(f"{comparison.band.mode}: fit {value:.1f} %")
    return axes
