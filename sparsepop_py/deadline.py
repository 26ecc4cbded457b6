"""Wall time that is left for a solve."""

from __future__ import annotations

import time

import numpy as np

__all__ = ["Deadline"]


class Deadline:
    """Remaining wall time."""

    def __init__(self, limit: float | None) -> None:
        self._end = None if limit is None else time.monotonic() + limit
        self.stopped = False

    def stop(self) -> None:
        """Time is over: the user interrupted."""
        self._end, self.stopped = time.monotonic(), True

    @property
    def left(self) -> float | None:
        """Seconds left, None without a limit."""
        return None if self._end is None else max(1e-3, self._end - time.monotonic())

    @property
    def end(self) -> float:
        """When time is over on the monotonic clock, inf without a limit."""
        return np.inf if self._end is None else self._end

    @property
    def over(self) -> bool:
        """Whether the limit has passed."""
        return self._end is not None and time.monotonic() >= self._end
