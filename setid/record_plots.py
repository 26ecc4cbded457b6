"""Pictures of records. The only module that imports matplotlib for them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp

from .data import IOData

__all__ = ["plot_record"]


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
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise sp.SolverNotFound(
            "plot: matplotlib is missing; install it with: pip install 'sparsepop-py[plot]'"
        ) from error
    channels = [(f"y{i + 1}", column) for i, column in enumerate(data.y.T)]
    channels += [(f"u{i + 1}", column) for i, column in enumerate(data.u.T)]
    size = (8, 1.6 * len(channels) + 0.8)
    _, grid = plt.subplots(
        len(channels), 1, sharex=True, squeeze=False, figsize=size, layout="constrained"
    )
    axes = grid[:, 0]
    time = (np.arange(data.samples) + data.record) * data.Ts
    for axis, (name, values) in zip(axes, channels, strict=True):
        for record in range(data.records):
            part = data.record == record
            style = "steps-post" if name.startswith("u") else "default"
            axis.plot(time[part], values[part], drawstyle=style, color=f"C{record}", lw=1)
        axis.set_ylabel(name)
        axis.grid(alpha=0.3)
    axes[-1].set_xlabel("time")
    return axes
