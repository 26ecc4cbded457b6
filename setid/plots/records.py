"""Pictures of records."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from setid.plots.axes import over_time

if TYPE_CHECKING:
    from setid.data.record import IOData

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
