"""Columns of times, checked against the sampling time that the equations take for granted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from setid.errors import DataError

__all__ = ["sampling_time"]

_HALF = 0.5  # of a sampling interval: farther off, a sample is missing or stands twice
_DRIFT = 1e-2  # relative difference of a given Ts from the mean interval
_EXACT = 1e-6  # of a sampling interval: less is the rounding of the column


def sampling_time(
    times: NDArray[np.float64], Ts: float | None, place: str
) -> tuple[float, tuple[str, ...]]:
    """Compute the sampling time of a column of times, or check a given one.

    Parameters
    ----------
    times : (N,) float
    Ts : float or None
        Taken from the column (the mean interval) when None.
    place : str
        What messages call the column.

    Returns
    -------
    float, tuple of str
        The sampling time, and what is taken for granted with it: the jitter.

    Raises
    ------
    DataError
        If a time is missing, times do not increase, an interval differs from the sampling time
        by half of it or more (samples are missing, or stand twice), Ts is another one, or a
        sample lies half an interval or more from equidistant times.

    Examples
    --------
    >>> import numpy as np
    >>> from setid.data.times import sampling_time
    >>> sampling_time(np.array([0.0, 0.1, 0.2, 0.3]), 0.1, "time")
    (0.1, ())
    """
    if np.any(np.isnan(times)):
        row = int(np.flatnonzero(np.isnan(times))[0])
        raise DataError(f"{place}: found no time at sample {row}, expected one for each sample")
    if times.size < 2:
        raise DataError(f"{place}: found {times.size} times, expected at least two")
    steps = np.diff(times)
    middle = float(np.sort(steps)[(steps.size - 1) // 2])  # of two middle ones the shorter
    if not middle > 0:
        raise DataError(f"{place}: found intervals about {middle:g}, expected increasing times")
    off = np.abs(steps - middle)
    if np.any(off >= _HALF * middle):
        row = int(np.flatnonzero(off >= _HALF * middle)[0])
        raise DataError(
            f"{place}: found an interval of {steps[row]:g} between samples {row} and {row + 1}, "
            f"expected about {middle:g}; write missing samples as rows with empty fields"
        )
    mean = float(times[-1] - times[0]) / (times.size - 1)
    if Ts is not None and not abs(mean - Ts) <= _DRIFT * Ts:
        raise DataError(f"{place}: found intervals of {mean:g} on average, expected Ts = {Ts:g}")
    off = np.abs(times - times[0] - mean * np.arange(times.size))
    if np.any(off >= _HALF * mean):
        row = int(np.argmax(off))
        raise DataError(
            f"{place}: found sample {row} {off[row] / mean:.2g} intervals from equidistant times "
            f"of {mean:g}, expected less than half of one; resample the record at equal intervals"
        )
    step = _plain(mean, times) if Ts is None else Ts
    jitter = float(np.max(np.abs(times - times[0] - step * np.arange(times.size))))
    if jitter <= _EXACT * step:
        return step, ()
    return step, (
        f"{place}: times differ from multiples of Ts = {step:g} by up to {jitter:.3g} "
        f"({100 * jitter / step:.2g} % of Ts); samples are taken as equidistant",
    )


def _plain(mean: float, times: NDArray[np.float64]) -> float:
    """The shortest decimal that the column cannot tell from the mean interval."""
    for digits in range(1, 16):
        short = float(f"{mean:.{digits}g}")
        if abs(short - mean) * times.size <= 1e-9 * abs(mean):
            return short
    return mean
