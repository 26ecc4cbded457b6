"""Pictures of records."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from setid.plots.axes import over_time, plain

if TYPE_CHECKING:
    from setid.data.record import IOData

__all__ = ["plot_record"]


def plot_record(data: IOData, ax: Any = None) -> NDArray[Any]:
    """Draw each output and each input of a record over time.

    Parameters
    ----------
    data : IOData
        Records are drawn one after the other, with a gap; missing samples are gaps.
    ax : array of matplotlib Axes, optional
        One a channel; those of a new figure when left out.

    Returns
    -------
    (ny + nu,) array of matplotlib.axes.Axes
        Outputs first.

    Raises
    ------
    SolverNotFound
        If matplotlib is missing; the message says how to install it.
    """
    names = (*data.output_labels, *data.input_labels)
    channels = list(zip(names, [*data.y.T, *data.u.T], strict=True))
    axes, time = over_time(data, len(channels), 1.6, ax)
    for place, (axis, (name, values)) in enumerate(zip(axes, channels, strict=True)):
        for record in range(data.records):
            part = data.record == record
            style = "steps-post" if place >= data.outputs else "default"
            axis.plot(time[part], values[part], drawstyle=style, color=f"C{record}", lw=1)
        axis.set_ylabel(plain(name))
    return axes
