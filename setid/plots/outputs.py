"""Pictures of outputs with their bands."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from setid.plots.axes import COLOUR, READING, fill_between, over_time

if TYPE_CHECKING:
    from setid.bands.outputs import Comparison, OutputBand

__all__ = ["plot_comparison", "plot_output_band"]


def plot_output_band(band: OutputBand) -> NDArray[Any]:
    """Draw readings, nominal output, and both bands; one axis an output.

    Parameters
    ----------
    band : OutputBand

    Returns
    -------
    (ny,) array of matplotlib Axes
    """
    data = band.data
    axes, time = over_time(data, data.outputs, 2.4)
    colour = COLOUR[band.kind]
    for i, ax in enumerate(axes):
        wide = band.reading_low[:, i], band.reading_high[:, i]
        fill_between(ax, time, *wide, colour, f"readings ({band.kind})", 0.15)
        fill_between(
            ax, time, band.low[:, i], band.high[:, i], colour, f"models ({band.kind})", 0.35
        )
        ax.plot(time, band.nominal[:, i], color=colour, lw=1, label="nominal")
        ax.plot(time, data.y[:, i], ".", color=READING, ms=3, label="reading")
        ax.set_ylabel(data.output_labels[i])
    axes[0].legend(loc="best", ncols=4, fontsize="small")
    return axes


def plot_comparison(comparison: Comparison) -> NDArray[Any]:
    """Draw the band of a comparison, the fit of each output in its title.

    Parameters
    ----------
    comparison : Comparison

    Returns
    -------
    (ny,) array of matplotlib Axes
    """
    axes = plot_output_band(comparison.band)
    for ax, value in zip(axes, comparison.fit, strict=True):
        ax.set_title(f"{comparison.band.mode}: fit {value:.1f} %")
    return axes
