"""Pictures of noise levels and of structure loops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from setid.plots.axes import ATTAINED, PROVED, ink, new_axes, plain, time_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from setid.analysis.advise import Advice, Excitation
    from setid.analysis.select import Selection
    from setid.analysis.sensitivity import Sensitivity
    from setid.minimum_noise.consistency_result import Consistency

__all__ = [
    "plot_advice",
    "plot_consistency",
    "plot_excitation",
    "plot_recursive",
    "plot_selection",
    "plot_sensitivity",
]

_CYCLE = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00"]  # Okabe and Ito
_COLOUR = {"refuted": PROVED, "kept": ATTAINED}


def plot_consistency(found: Consistency, ax: Axes | None = None) -> Axes:
    """Draw which factors on the noise bounds are refuted, open and attained.

    Parameters
    ----------
    found : Consistency
    ax : matplotlib Axes, optional
    """
    axes = new_axes(ax, (7.0, 1.8))
    low, high = found.scale
    end = 1.25 * max(1.0, *(value if value < np.inf else 0.0 for value in found.scale))
    axes.axvspan(0.0, min(low, end), color=PROVED, alpha=0.35, lw=0, label="inconsistent (proved)")
    if np.isfinite(high):
        axes.axvspan(high, end, color=ATTAINED, alpha=0.35, lw=0, label="consistent (attained)")
    axes.axvline(1.0, color=ink(), lw=1, label="the bounds as given")
    axes.set_xlim(0.0, end)
    axes.set_yticks([])
    axes.set_xlabel(f"factor on {found.noise.scaled}")
    axes.legend(loc="best", fontsize="small")
    return axes


def plot_sensitivity(found: Sensitivity, ax: Axes | None = None) -> Axes:
    """Draw the widths of the intervals over the noise factor, and where signs are lost.

    Parameters
    ----------
    found : Sensitivity
    ax : matplotlib Axes, optional
    """
    axes = new_axes(ax, (7.0, 4.0))
    order = np.argsort(found.factors)
    low, high = found.outer[order, :, 0], found.outer[order, :, 1]
    finite = np.isfinite(low) & np.isfinite(high)
    with np.errstate(invalid="ignore", divide="ignore"):
        size = np.where(finite, np.maximum(np.abs(low), np.abs(high)), 0.0).max(axis=0)
        width = np.where(finite, high - low, np.nan) / size
    for i, name in enumerate(found.names):
        colour = _CYCLE[i % len(_CYCLE)]
        axes.plot(found.factors[order], width[:, i], "o-", ms=4, color=colour, label=name)
        proved, attained = found.lost.get(name, (np.inf, np.inf))
        end, what = (attained, "lost") if np.isfinite(attained) else (proved, "proved up to here")
        if end <= found.factors.max():
            axes.axvline(end, color=colour, ls=":", lw=1.5, label=f"sign of {name} {what}")
    axes.set_xlabel(f"factor on {found.base.formulation.noise.scaled}")
    axes.set_ylabel("outer width, relative")
    axes.grid(alpha=0.3)
    axes.legend(loc="best", fontsize="small")
    return axes


def plot_advice(found: Advice, ax: Axes | None = None) -> Axes:
    """Draw a step response, and the transient that is to be sampled.

    Parameters
    ----------
    found : Advice
    ax : matplotlib Axes, optional
    """
    axes, data = new_axes(ax, (7.0, 3.2)), found.record
    for name, values in zip(data.output_labels, data.y.T, strict=True):
        axes.plot(data.time, values, lw=1, color=ink(), label=plain(name))
    if np.isfinite(found.settling_time):
        change = np.nan_to_num(np.abs(np.diff(data.u, axis=0)))  # missing samples say nothing
        begin = data.time[int(np.argmax(change.max(axis=1))) + 1]
        end = begin + found.settling_time
        axes.axvspan(begin, end, color=PROVED, alpha=0.2, lw=0, label="transient")
    axes.set_xlabel(time_label(data.time_unit))
    axes.legend(loc="best", fontsize="small")
    return axes


def plot_excitation(found: Excitation, ax: Axes | None = None) -> Axes:
    """Draw expected widths of intervals relative to the parameters.

    Parameters
    ----------
    found : Excitation
    ax : matplotlib Axes, optional
    """
    axes = new_axes(ax, (7.0, 0.4 * len(found.names) + 1.2))
    with np.errstate(divide="ignore"):
        share = 50.0 * found.widths / np.abs(found.theta)
    shown = np.where(np.isfinite(share), share, 0.0)
    axes.barh(range(len(found.names)), shown, color=ATTAINED)
    for place in np.flatnonzero(~np.isfinite(share)):
        half = 0.5 * found.widths[place]
        text = f"± {half:.3g}, of zero" if np.isfinite(half) else "unbounded"
        axes.text(0.0, float(place), text, va="center")
    axes.axvline(30.0, color=ink(), lw=1)
    axes.set_yticks(range(len(found.names)), found.names)
    axes.invert_yaxis()
    axes.set_xlabel("expected half width, % of the parameter")
    return axes


def plot_recursive(
    names: Sequence[str],
    trace: Sequence[tuple[int, NDArray[np.float64]]],
    inconsistent_at: int | None,
    ax: Axes | None = None,
) -> Axes:
    """Draw proved intervals over the samples at which they changed.

    Parameters
    ----------
    names : sequence of str
    trace : sequence of (sample, (2, p) float)
    inconsistent_at : int or None
    ax : matplotlib Axes, optional
    """
    axes = new_axes(ax, (8.0, 4.0))
    for i, name in enumerate(names):
        found = [(k, *box[:, i]) for k, box in trace if np.all(np.isfinite(box[:, i]))]
        if found:
            k, low, high = np.array(found).T
            colour = _CYCLE[i % len(_CYCLE)]
            axes.fill_between(k, low, high, step="post", color=colour, alpha=0.4, label=name)
    if inconsistent_at is not None:
        axes.axvline(inconsistent_at, color=ink(), lw=1, label="proved inconsistent")
    axes.set_xlabel("sample")
    axes.set_ylabel("parameters (proved)")
    axes.grid(alpha=0.3)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="best", fontsize="small")
    return axes


def plot_selection(found: Selection, ax: Axes | None = None) -> Axes:
    """Draw the decision on each structure that was tried.

    Parameters
    ----------
    found : Selection
    ax : matplotlib Axes, optional
    """
    axes = new_axes(ax, (7.0, 0.4 * len(found.steps) + 1.0))
    for place, step in enumerate(found.steps):
        axes.barh(place, 1.0, color=_COLOUR.get(step.decision, "0.5"), alpha=0.35, lw=0)
        axes.text(0.02, place, f"{step.decision}: {step.reason}", va="center", fontsize="small")
    axes.set_xlim(0.0, 1.0)
    axes.set_xticks([])
    names = [f"order {step.order}, degree {step.degree}" for step in found.steps]
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    return axes
