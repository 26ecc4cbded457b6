"""Pictures of records, and the one door to matplotlib for all pictures."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.record import IOData

__all__ = ["over_time", "plot_record", "require_matplotlib"]


def require_matplotlib() -> ModuleType:
    """matplotlib.pyplot.

    Raises
    ------
    SolverNotFound
        If matplotlib is missing; the message says how to install it.
    """
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise sp.SolverNotFound(
            "plot: matplotlib is missing; install it with: pip install 'sparsepop-py[plot]'"
        ) from error
    return plt


def plot_record(data: IOData) -> NDArray[Any]:
    """Draw each output and each input of a record over time.

    Parameters
    ----------
    data : IOData
        Records are drawn one after the other, with a gap; missing samples are gaps.

    Returns
    -------
    (ny + nu,) array of matplotlib.axes.Axes
        Outputs first.

    Raises
    ------
    SolverNotFound
        If matplotlib is missing; the message says how to install it.
    """
    channels = [(f"y{i + 1}", column) for i, column in enumerate(data.y.T)]
    channels += [(f"u{i + 1}", column) for i, column in enumerate(data.u.T)]
    axes, time = over_time(data, len(channels), 1.6)
    for axis, (name, values) in zip(axes, channels, strict=True):
        for record in range(data.records):
            part = data.record == record
            style = "steps-post" if name.startswith("u") else "default"
            axis.plot(time[part], values[part], drawstyle=style, color=f"C{record}", lw=1)
        axis.set_ylabel(name)
    return axes


def over_time(data: IOData, count: int, height: float) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Axes one below the other, each of that height, and the times of all samples (N,)."""
    _, grid = require_matplotlib().subplots(
        count,
        1,
        sharex=True,
        squeeze=False,
        figsize=(8.0, height * count + 0.8),
        layout="constrained",
    )
    axes = np.asarray(grid[:, 0])
    for axis in axes:
        axis.grid(alpha=0.3)
    axes[-1].set_xlabel("time")
    return axes, np.asarray((np.arange(data.samples) + data.record) * data.Ts, np.float64)
