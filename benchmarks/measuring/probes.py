"""What a process uses: CPU seconds and memory."""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sparsepop_py.budget import cpu_seconds

__all__ = ["Watch", "watched"]

_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


class Watch:
    """CPU seconds and peak memory of a ``with watched()`` block, once it has ended."""

    seconds: float = float("nan")
    peak_mb: float = float("nan")
    wall: float = float("nan")


@contextmanager
def watched() -> Iterator[Watch]:
    """Measure what runs inside.

    On Linux the peak is that of the block (with what the process held before it);
    elsewhere that of the process so far.

    Examples
    --------
    >>> with watched() as watch:
    ...     numbers = list(range(1000))
    >>> watch.seconds >= 0 and watch.peak_mb > 0
    True
    """
    watch = Watch()
    forgotten = _forget_peak()
    start, begin = cpu_seconds(), time.monotonic()
    try:
        yield watch
    finally:
        watch.wall = time.monotonic() - begin
        watch.seconds = cpu_seconds() - start
        watch.peak_mb = _peak_of_block() if forgotten else _peak_of_process()


def _forget_peak() -> bool:
    """Ask Linux to start counting the peak anew."""
    try:
        _RESET.write_text("5")
    except OSError:
        return False
    return True


def _peak_of_block() -> float:
    for line in _STATUS.read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024
    return _peak_of_process()


def _peak_of_process() -> float:
    unit = 1024**2 if sys.platform == "darwin" else 1024  # bytes there, kilobytes here
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit
