"""Progress line and CPU seconds by stage; the line is drawn only on a terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["Line", "Stages"]


class Line:
    """One line on standard error that changes in place.

    Parameters
    ----------
    show : bool
        Draw the line; ignored unless standard error is a terminal.
    """

    def __init__(self, show: bool) -> None:
        self._show = show and sys.stderr.isatty()

    def draw(self, text: str) -> None:
        """Replace the text of the line.

        Parameters
        ----------
        text : str
        """
        if self._show:
            sys.stderr.write(f"\r\x1b[K{text}")
            sys.stderr.flush()

    def close(self) -> None:
        """Erase the line."""
        self.draw("")


class Stages:
    """CPU seconds by stage, shown as one changing line when asked for. Mutable.

    Parameters
    ----------
    show : bool
        Draw the line; ignored unless standard error is a terminal.
    """

    def __init__(self, show: bool = False) -> None:
        self.seconds: dict[str, float] = {}
        self._line = Line(show)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the body of a with statement for the stage of that name."""
        self._line.draw(f"{name} ...")
        start = time.process_time()
        try:
            yield
        finally:
            spent = time.process_time() - start
            self.seconds[name] = self.seconds.get(name, 0.0) + spent

    def close(self) -> None:
        """Erase the line."""
        self._line.close()
