"""Pictures of identification results.

Proved sets are filled in blue, what is attained or sampled is orange. Every legend says
which it is. Functions return axes and change nothing but them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from setid.errors import SetidError
from setid.plots.records import over_time, require_matplotlib

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from setid.bands.outputs import Comparison, OutputBand
    from setid.bands.residuals import Residuals
    from setid.bands.responses import FrequencyBand, StepBand
    from setid.feasible_set.projections import Projection
    from setid.result.identification import Identification

__all__ = [
    "new_axes",
    "plot_comparison",
    "plot_frequency_band",
    "plot_intervals",
    "plot_output_band",
    "plot_projection",
    "plot_residuals",
    "plot_step_band",
    "require_matplotlib",
]

_PROVED, _ATTAINED, _DATA = "#0072B2", "#D55E00", "black"  # Okabe and Ito
_COLOUR = {"proved": _PROVED, "sampled": _ATTAINED}


def new_axes(ax: Axes | None, size: tuple[float, float] = (7.0, 4.5)) -> Axes:
    """The given axes, or those of a new figure."""
    plt = require_matplotlib()
    if ax is not None:
        return ax
    return plt.subplots(figsize=size, layout="constrained")[1]


def plot_intervals(result: Identification, ax: Axes | None = None) -> Axes:
    """Draw the interval of each parameter, proved and attained, relative to its centre.

    Parameters
    ----------
    result : Identification
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
        labels.append(f"{interval.name} in [{low:.5g}, {high:.5g}]{mark}")
        if not np.isfinite(interval.centre):
            axes.text(0.0, place, str(interval.status), ha="center", va="center")
            continue
        unit = _unit(interval.centre, interval.width)
        ends = np.array([low, high]) - interval.centre
        axes.plot(ends / unit, [place, place], color=_PROVED, lw=7, solid_capstyle="butt")
        if interval.inner is not None:
            inner = np.array(interval.inner) - interval.centre
            axes.plot(inner / unit, [place, place], color=_ATTAINED, lw=2.5)
    axes.plot([], [], color=_PROVED, lw=7, label="outer (proved)")
    axes.plot([], [], color=_ATTAINED, lw=2.5, label="inner (attained)")
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(len(labels) - 0.4, -0.6)
    axes.set_xlabel("distance from the centre, % of the centre (* of half the width)")
    axes.legend(loc="best")
    axes.grid(alpha=0.3, axis="x")
    return axes


def _unit(centre: float, width: float) -> float:
    """1 % of the centre, or of half the width where the interval holds zero."""
    unit = abs(centre) / 100.0 if _by_centre(centre, width) else width / 200.0
    return unit or 1.0


def _by_centre(centre: float, width: float) -> bool:
    return abs(centre) > width


# ---- frequency and step responses -------------------------------------------------------


def plot_frequency_band(band: FrequencyBand, kind: str = "bode") -> NDArray[Any] | Axes:
    """Draw a band of a frequency response.

    Parameters
    ----------
    band : FrequencyBand
    kind : {"bode", "nyquist", "nichols"}

    Returns
    -------
    array of two matplotlib Axes for a Bode plot, else matplotlib Axes
    """
    drawers: dict[str, Callable[[FrequencyBand], NDArray[Any] | Axes]] = {
        "bode": _bode,
        "nyquist": _nyquist,
        "nichols": _nichols,
    }
    if kind not in drawers:
        raise SetidError(f"kind: found {kind!r}, expected one of {', '.join(drawers)}")
    require_matplotlib()
    return drawers[kind](band)


def _bode(band: FrequencyBand) -> NDArray[Any]:
    plt = require_matplotlib()
    _, axes = plt.subplots(2, 1, sharex=True, figsize=(7.0, 5.5), layout="constrained")
    nominal = 20 * np.log10(np.maximum(np.abs(band.nominal), np.finfo(float).tiny))
    angle = np.degrees(np.unwrap(np.angle(band.nominal)))
    for ax, ends, centre, label in (
        (axes[0], _finite(band.decibel), nominal, "magnitude, dB"),
        (axes[1], np.degrees(band.phase), angle, "phase, degrees"),
    ):
        ax.fill_between(
            band.omega, *ends.T, color=_COLOUR[band.kind], alpha=0.35, lw=0, label=band.kind
        )
        ax.semilogx(band.omega, centre, color=_DATA, lw=1, label="nominal")
        ax.set_ylabel(label)
        ax.grid(alpha=0.3, which="both")
    axes[0].legend(loc="best")
    axes[0].set_title(f"y{band.output} from u{band.input}")
    axes[1].set_xlabel("frequency, rad per unit of time")
    return np.asarray(axes)


def _nyquist(band: FrequencyBand) -> Axes:
    ax = new_axes(None, (5.5, 5.5))
    colour = _COLOUR[band.kind]
    if band.kind == "proved":
        for corners in band.regions[np.all(np.isfinite(band.regions), axis=1)]:
            ax.fill(corners.real, corners.imag, color=colour, alpha=0.25, lw=0.3)
        ax.fill([], [], color=colour, alpha=0.25, label="proved, at each frequency")
    else:
        ax.plot(band.regions.real, band.regions.imag, color=colour, alpha=0.3, lw=0.5)
        ax.plot([], [], color=colour, label="sampled")
    ax.plot(band.nominal.real, band.nominal.imag, color=_DATA, lw=1, label="nominal")
    ax.plot([-1], [0], "+", color=_DATA)
    ax.set_xlabel("real part")
    ax.set_ylabel("imaginary part")
    ax.grid(alpha=0.3)
    ax.legend(loc="best")
    return ax


def _nichols(band: FrequencyBand) -> Axes:
    ax = new_axes(None, (5.5, 5.5))
    decibel, phase = _finite(band.decibel), np.degrees(band.phase)
    for (low, high), (left, right) in zip(decibel, phase, strict=True):
        ax.fill(
            [left, right, right, left], [low, low, high, high], color=_COLOUR[band.kind], alpha=0.2
        )
    ax.fill([], [], color=_COLOUR[band.kind], alpha=0.2, label=f"{band.kind}, at each frequency")
    gains = 20 * np.log10(np.maximum(np.abs(band.nominal), np.finfo(float).tiny))
    ax.plot(np.degrees(np.unwrap(np.angle(band.nominal))), gains, color=_DATA, lw=1)
    ax.plot([-180], [0], "+", color=_DATA)
    ax.set_xlabel("phase, degrees")
    ax.set_ylabel("magnitude, dB")
    ax.grid(alpha=0.3)
    ax.legend(loc="best")
    return ax


def _finite(ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """Infinite ends moved to where the eye takes them for the edge of the picture."""
    known = ends[np.isfinite(ends)]
    low, high = (known.min(), known.max()) if known.size else (-1.0, 1.0)
    return np.clip(ends, low - 20.0, high + 20.0)


def plot_step_band(band: StepBand, ax: Axes | None = None) -> Axes:
    """Draw a band of a step response.

    Parameters
    ----------
    band : StepBand
    ax : matplotlib Axes, optional

    Returns
    -------
    matplotlib Axes
    """
    axes = new_axes(ax)
    _fill(axes, band.time, band.low, band.high, _COLOUR[band.kind], band.kind)
    axes.step(band.time, band.nominal, color=_DATA, lw=1, where="post", label="nominal")
    axes.set_xlabel("time")
    axes.set_ylabel(f"y{band.output} for a step in u{band.input}")
    axes.grid(alpha=0.3)
    axes.legend(loc="best")
    return axes


# ---- records ----------------------------------------------------------------------------


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
    colour = _COLOUR[band.kind]
    for i, ax in enumerate(axes):
        wide = band.reading_low[:, i], band.reading_high[:, i]
        _fill(ax, time, *wide, colour, f"readings ({band.kind})", 0.15)
        _fill(ax, time, band.low[:, i], band.high[:, i], colour, f"models ({band.kind})", 0.35)
        ax.plot(time, band.nominal[:, i], color=colour, lw=1, label="nominal")
        ax.plot(time, data.y[:, i], ".", color=_DATA, ms=3, label="reading")
        ax.set_ylabel(f"y{i + 1}")
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
        axes.plot(residuals.row[part] + 1, share[part], ".", ms=4, label=f"y{output}")
    for edge in (-1.0, 1.0):
        axes.axhline(edge, color=_PROVED, lw=1)
    axes.set_xlabel("sample")
    axes.set_ylabel("residual / bound")
    axes.legend(loc="best")
    axes.grid(alpha=0.3)
    return axes


def _fill(
    ax: Axes,
    time: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    colour: str,
    label: str,
    alpha: float = 0.3,
) -> None:
    finite = np.isfinite(low) & np.isfinite(high)
    a, b = np.where(finite, low, 0.0), np.where(finite, high, 0.0)
    ax.fill_between(time, a, b, where=finite, color=colour, alpha=alpha, lw=0, label=label)


# ---- projections ------------------------------------------------------------------------


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
    axes.fill(*projection.outline.T, color=_PROVED, alpha=0.3, label=word)
    axes.plot(*projection.attained.T, "o", color=_ATTAINED, ms=4, label="attained")
    axes.set_xlabel(projection.names[0])
    axes.set_ylabel(projection.names[1])
    axes.grid(alpha=0.3)
    axes.legend(loc="best")
    return axes
