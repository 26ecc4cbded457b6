"""Limit a solve by wall time, or by work that a fixed model counts.

Clocks differ from run to run, and the adaptive search learns from them. Under a work limit every
decision rests on work instead: solvers, linear programs, local searches and nodes each report
iterations times a cost that depends on sizes only. Runs are then reproducible, and a run with a
larger limit begins like one with a smaller limit.

One unit of work is about one second of one core of 2020. The model is a convention: it is fixed
by the constants in this module and in the modules that call :func:`spend`.
"""

from __future__ import annotations

import threading
import time

import numpy as np

__all__ = ["Deadline", "spend", "spent"]


class _Meter(threading.local):
    """Work done in this thread since it began."""

    total = 0.0


_METER = _Meter()


def spend(work: float) -> None:
    """Count work that was done in this thread.

    Parameters
    ----------
    work : float
        In units of about one second.
    """
    _METER.total += work


def spent() -> float:
    """Return the work that was counted in this thread so far."""
    return _METER.total


class Deadline:
    """Deadline of a solve: after some wall time, or after some work. Mutable.

    Parameters
    ----------
    limit : float or None
        Seconds of wall time from now; None for no limit.
    work_limit : float or None
        Units of work from now. With it nothing is decided by a clock, unless ``limit`` is given
        too.

    Examples
    --------
    >>> from sparsepop_py.budget import Deadline, spend
    >>> deadline = Deadline(None, work_limit=1.0)
    >>> deadline.over, deadline.left
    (False, None)
    >>> spend(2.0)
    >>> deadline.over
    True
    """

    def __init__(self, limit: float | None = None, work_limit: float | None = None) -> None:
        self._end = None if limit is None else time.monotonic() + limit
        self._last = None if work_limit is None else spent() + work_limit
        self.stopped = False

    def stop(self) -> None:
        """End now: the user interrupted."""
        self._end, self.stopped = time.monotonic(), True

    @property
    def counts_work(self) -> bool:
        """True if decisions rest on work and not on clocks."""
        return self._last is not None

    def now(self) -> float:
        """Return CPU seconds, or units of work under a work limit; only differences matter."""
        return spent() if self.counts_work else time.process_time()

    @property
    def left(self) -> float | None:
        """Seconds of wall time left, None without such a limit."""
        return None if self._end is None else max(1e-3, self._end - time.monotonic())

    @property
    def end(self) -> float:
        """Moment on the monotonic clock when time is over, inf without a limit."""
        return np.inf if self._end is None else self._end

    @property
    def over(self) -> bool:
        """True if a limit has passed."""
        late = self._end is not None and time.monotonic() >= self._end
        return late or (self._last is not None and spent() >= self._last)
