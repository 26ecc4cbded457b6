"""Deadline of a solve in wall time."""

from __future__ import annotations

import time

import numpy as np

__all__ = ["Deadline"]


class Deadline:
    """Remaining wall time of a solve. Mutable: an interrupt ends it.

    Parameters
    ----------
    limit : float or None
        Seconds from now; None: without limit.
    """

    def __init__(self, limit: float | None) -> None:
        self._end = None if limit is None else time.monotonic() + limit
        self.stopped = False

    def stop(self) -> None:
        """End the time now: the user interrupted."""
        self._end, self.stopped = time.monotonic(), True

    @property
    def left(self) -> float | None:
        """Seconds left, at least 1e-3; None without a limit."""
        return None if self._end is None else max(1e-3, self._end - time.monotonic())

    @property
    def end(self) -> float:
        """End of the time on the monotonic clock, inf without a limit."""
        return np.inf if self._end is None else self._end

    @property
    def over(self) -> bool:
        """True if the limit has passed."""
        return self._end is not None and time.monotonic() >= self._end
