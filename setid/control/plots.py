"""Pictures of designs and certificates."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

import numpy as np

from setid.control.engine import new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from setid.control.certificates.certificate import StabilityCertificate
    from setid.control.loops import LoopStep
    from setid.control.references import Matching

__all__ = ["plot_certificate", "plot_loop_step", "plot_matching"]

_PROVED, _NOMINAL, _WANTED = "#0072B2", "#D55E00", "black"  # Okabe and Ito


def plot_certificate(certificate: StabilityCertificate, ax: Axes | None = None) -> Axes:
    """Draw the proved bound of abs(Delta) on every arc, with the limit 1."""
    ax = new_axes(ax)
    finite = [arc for arc in certificate.arcs if np.isfinite(arc[2])]
    for place, (low, high, bound) in enumerate(finite):
        label = "proved bound on arcs" if place == 0 else None
        ax.plot([low, high], [bound, bound], color=_PROVED, linewidth=2, label=label)
    if certificate.parameters is not None and not certificate.parameters.empty and finite:
        omega = np.linspace(1e-3, pi, 400)
        ax.plot(omega, _nominal(certificate, omega), color=_NOMINAL, label="nominal plant")
    ax.axhline(1.0, color="black", linestyle=":", linewidth=1, label="limit of small gain")
    ax.set_yscale("log")
    ax.set_xlabel("frequency (rad a sample)")
    ax.set_ylabel("abs(Delta)")
    missing = len(certificate.arcs) - len(finite)
    note = f"; no finite bound on {missing} arcs" if missing else ""
    ax.set_title(f"{certificate.verdict} by {certificate.method}{note}")
    ax.legend(fontsize=8)
    return ax


def _nominal(certificate: StabilityCertificate, omega: np.ndarray) -> np.ndarray:
    from setid.control.certificates.characteristic import polynomials_of
    from setid.control.transfer import Transfer

    assert certificate.parameters is not None
    below, top = polynomials_of(certificate.model, certificate.parameters.centre)
    plant = Transfer(top, below)
    k, m = certificate.controller, certificate.reference
    values = [Transfer(x.numerator, x.denominator).response(omega) for x in (k, m)]
    return np.abs(values[1] - values[0] * plant.response(omega) * (1.0 - values[1]))


def plot_matching(matching: Matching, ax: Axes | None = None) -> Axes:
    """Draw the step response of a closed loop beside that of the reference model."""
    ax = new_axes(ax)
    ax.step(matching.time, matching.wanted, where="post", color=_WANTED, label="reference model")
    label = f"closed loop, fit {matching.fit:.1f} %"
    ax.step(matching.time, matching.response, where="post", color=_NOMINAL, label=label)
    ax.set_xlabel("time")
    ax.set_ylabel("step response")
    ax.set_title("stable" if matching.stable else "unstable")
    ax.legend(fontsize=8)
    return ax


def plot_loop_step(step: LoopStep, ax: Axes | None = None) -> Axes:
    """Draw the proved band of closed-loop step responses."""
    ax = new_axes(ax)
    known = np.isfinite(step.low) & np.isfinite(step.high)
    ax.fill_between(
        step.time[known],
        step.low[known],
        step.high[known],
        step="post",
        color=_PROVED,
        alpha=0.3,
        label="every consistent plant (proved)",
    )
    ax.step(step.time, step.nominal, where="post", color=_NOMINAL, label="nominal plant")
    ax.set_xlabel("time")
    ax.set_ylabel("closed-loop step response")
    ax.legend(fontsize=8)
    return ax
