"""Pictures of bands of frequency and step responses, and of the uncertainty about a model."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import word
from setid.errors import SetidError
from setid.plots.axes import (
    ATTAINED,
    COLOUR,
    clip,
    far,
    fill_between,
    ink,
    new_axes,
    plain,
    remark,
    require_matplotlib,
    stacked_axes,
    time_label,
    title,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from setid.bands.responses import FrequencyBand
    from setid.bands.steps import StepBand
    from setid.export.python_control import ControlModels

__all__ = ["plot_frequency_band", "plot_step_band", "plot_uncertainty"]

Reals = NDArray[np.float64]


def plot_frequency_band(
    band: FrequencyBand, kind: str = "bode", ax: Any = None
) -> NDArray[Any] | Axes:
    """Draw a band of a frequency response.

    Parameters
    ----------
    band : FrequencyBand
    kind : {"bode", "nyquist", "nichols"}
    ax : matplotlib Axes, or two of them for a Bode plot, optional

    A remark above the picture says at how many of the frequencies drawn it is clipped, since a gain
    may be zero or has no proved end, and at how many any phase is possible.

    Returns
    -------
    array of two matplotlib Axes for a Bode plot, else matplotlib Axes
    """
    drawers: dict[str, Callable[[FrequencyBand, Any], NDArray[Any] | Axes]] = {
        "bode": _bode,
        "nyquist": _nyquist,
        "nichols": _nichols,
    }
    draw = drawers[word(kind, "kind", drawers, SetidError)]
    require_matplotlib()
    return draw(band, ax)


def _bode(band: FrequencyBand, given: Any) -> NDArray[Any]:
    axes = stacked_axes(given, 2, 2.4)
    nominal, angle = _nominal(band)
    omega, decibel, phase = _everywhere(band)
    for ax, ends, centre, label, said in (
        (axes[0], _finite(decibel, nominal), nominal, "magnitude, dB", _of_gains(decibel)),
        (axes[1], np.degrees(phase), angle, "phase, degrees", _of_phases(phase)),
    ):
        remark(ax, said)
        ax.fill_between(omega, *ends.T, color=COLOUR[band.kind], alpha=0.35, lw=0, label=band.kind)
        ax.semilogx(band.omega, centre, color=ink(), lw=1, label="nominal")
        ax.set_ylabel(label)
        ax.grid(alpha=0.3, which="both")
    axes[0].legend(loc="best")
    where = "" if band.arcs is None else ", proved at all frequencies"
    output, input_ = band.labels or (f"y{band.output}", f"u{band.input}")
    title(axes[0], plain(f"{output} from {input_}{where}"))
    axes[1].set_xlabel(plain(f"frequency, rad per {band.time_unit or 'unit of time'}"))
    return np.asarray(axes)


_DENSE = 400  # frequencies at which a band that is proved everywhere is drawn


def _everywhere(band: FrequencyBand) -> tuple[Reals, Reals, Reals]:
    """Frequencies, decibels and phases to draw: dense where the band is proved everywhere."""
    if band.arcs is None or band.omega.size < 2:
        return band.omega, band.decibel, band.phase
    omega = np.union1d(np.geomspace(band.omega[0], band.omega[-1], _DENSE), band.omega)
    gains, phase = band.between(np.clip(omega, band.omega[0], band.omega[-1]))
    with np.errstate(divide="ignore"):
        return omega, 20.0 * np.log10(gains), phase


def _nyquist(band: FrequencyBand, given: Any) -> Axes:
    ax = new_axes(given, (5.5, 5.5))
    colour = COLOUR[band.kind]
    if band.kind == "proved":
        known = np.all(np.isfinite(band.regions), axis=1)
        for corners in band.regions[known]:
            ax.fill(corners.real, corners.imag, color=colour, alpha=0.25, lw=0.3)
        if left := int(np.sum(~known)):
            remark(ax, f"nothing proved, nothing drawn at {left} of {known.size} frequencies")
        ax.fill([], [], color=colour, alpha=0.25, label="proved, at each frequency")
    else:
        ax.plot(band.regions.real, band.regions.imag, color=colour, alpha=0.3, lw=0.5)
        ax.plot([], [], color=colour, label="sampled")
    ax.plot(band.nominal.real, band.nominal.imag, color=ink(), lw=1, label="nominal")
    ax.plot([-1], [0], "+", color=ink())
    ax.set_xlabel("real part")
    ax.set_ylabel("imaginary part")
    ax.grid(alpha=0.3)
    ax.legend(loc="best")
    return ax


def _nichols(band: FrequencyBand, given: Any) -> Axes:
    ax = new_axes(given, (5.5, 5.5))
    gains, angle = _nominal(band)
    decibel, phase = _finite(band.decibel, gains), np.degrees(band.phase)
    remark(ax, "\n".join(filter(None, (_of_gains(band.decibel), _of_phases(band.phase)))))
    for (low, high), (left, right) in zip(decibel, phase, strict=True):
        ax.fill(
            [left, right, right, left], [low, low, high, high], color=COLOUR[band.kind], alpha=0.2
        )
    ax.fill([], [], color=COLOUR[band.kind], alpha=0.2, label=f"{band.kind}, at each frequency")
    ax.plot(angle, gains, color=ink(), lw=1, label="nominal")
    ax.plot([-180], [0], "+", color=ink())
    ax.set_xlabel("phase, degrees")
    ax.set_ylabel("magnitude, dB")
    ax.grid(alpha=0.3)
    ax.legend(loc="best")
    return ax


def _nominal(band: FrequencyBand) -> tuple[Reals, Reals]:
    """Decibels and degrees of the nominal response."""
    with np.errstate(divide="ignore"):
        decibel = np.asarray(20.0 * np.log10(np.abs(band.nominal)), np.float64)
    return decibel, np.degrees(np.unwrap(np.angle(band.nominal)))


def _finite(ends: Reals, nominal: Reals) -> Reals:
    """Infinite ends moved to the edges of the picture, beyond all that is finite in it."""
    shown = np.append(ends, nominal)
    known = shown[np.isfinite(shown)]
    low, high = (known.min(), known.max()) if known.size else (-1.0, 1.0)
    return np.clip(ends, low - 20.0, high + 20.0)


def _of_gains(decibel: Reals) -> str:
    """Say at how many frequencies a gain has no end in the picture; empty where at none."""
    zero, open_ = np.isneginf(decibel[:, 0]), np.isposinf(decibel[:, 1])
    if not np.any(zero | open_):
        return ""
    text = f"gain clipped at {int(np.sum(zero | open_))} of {zero.size} frequencies"
    parts = ((zero & ~open_, "may be 0 at"), (open_, "no largest proved at"))
    return ", ".join([text, *(f"{what} {int(np.sum(at))}" for at, what in parts if np.any(at))])


def _of_phases(phase: Reals) -> str:
    """Say at how many frequencies any phase is possible; empty where at none."""
    whole = phase[:, 1] - phase[:, 0] >= 2 * np.pi * (1.0 - 1e-9)
    if not np.any(whole):
        return ""
    return f"any phase (full circle) at {int(np.sum(whole))} of {whole.size} frequencies"


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
    whole = far(band.low, band.high)
    fill_between(axes, band.time, *whole, COLOUR[band.kind], band.kind, step="post")
    attained = band.attained_low, band.attained_high
    if band.kind == "proved" and np.any(np.isfinite(attained)):
        fill_between(axes, band.time, *attained, ATTAINED, "attained", 0.5, step="post")
    clip(axes, np.concatenate([band.nominal, *attained]), (band.low, band.high))
    axes.step(band.time, band.nominal, color=ink(), lw=1, where="post", label="nominal")
    axes.set_xlabel(time_label(band.time_unit))
    output, input_ = band.labels or (f"y{band.output}", f"u{band.input}")
    axes.set_ylabel(plain(f"{output} for a step in {input_}"))
    axes.grid(alpha=0.3)
    axes.legend(loc="best")
    return axes


def plot_uncertainty(models: ControlModels, ax: Axes | None = None) -> Axes:
    """Draw the relative distance of models from the nominal one, and the weight that covers it.

    Parameters
    ----------
    models : ControlModels
    ax : matplotlib Axes, optional

    Returns
    -------
    matplotlib Axes
        One line a pair of channels.
    """
    axes = new_axes(ax)
    colour = COLOUR["sampled" if models.label == "sampled" else "proved"]
    radius = models.radius.reshape(models.omega.size, -1)
    axes.plot(models.omega, radius, color=colour)
    axes.lines[-1].set_label(f"|G / G0 - 1|, {models.label}")
    if models.weight is not None:
        step = models.weight.dt
        at = np.exp(1j * models.omega * step) if step else 1j * models.omega
        axes.plot(models.omega, np.abs(models.weight(at)), "--", color=ink(), label="weight")
    axes.set_xscale("log")
    axes.set_xlabel("frequency, rad per unit of time")
    axes.set_ylabel("relative distance from the nominal model")
    axes.grid(alpha=0.3)
    axes.legend(loc="best")
    return axes
