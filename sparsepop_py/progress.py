"""Progress of a solve: CPU seconds by stage, bounds, a changing line, a log.

The line is drawn in a terminal or a notebook only, by tqdm where that is installed. A thread
draws it anew each second, so that it moves while a solver runs. The log goes to the logger of the
package: stages at level DEBUG, bounds at level INFO, what went wrong on the way at WARNING.
"""

from __future__ import annotations

import logging
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from sparsepop_py.budget import check, cpu_seconds
from sparsepop_py.verified.arithmetic.display import rounded

__all__ = ["Line", "OnProgress", "Stages"]

OnProgress = Callable[[int, float, float], None]

_LOG = logging.getLogger(__name__)
logging.getLogger("sparsepop_py").addHandler(logging.NullHandler())

_REDRAWN = 1.0  # seconds after which the line is drawn anew
_REPORTED = 2.0  # seconds after which bounds are reported although they did not change


def _in_terminal() -> bool:
    """Check that standard error is seen; services have none, or one that is closed."""
    stream = sys.stderr
    return stream is not None and not getattr(stream, "closed", False) and stream.isatty()


def _in_notebook() -> bool:
    """Check for a kernel of IPython, whose output is no terminal and yet is seen."""
    shell = sys.modules.get("IPython")
    running = shell.get_ipython() if shell is not None else None
    return running is not None and getattr(running, "kernel", None) is not None


def _bar() -> Any:
    """Make a bar of tqdm that shows a text alone, None where tqdm is missing."""
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return None
    return tqdm(bar_format="{desc}", leave=False, file=sys.stderr)


class Line:
    """One line on standard error that changes in place, with the seconds since its start.

    Parameters
    ----------
    show : bool
        Draw the line; ignored unless standard error is a terminal or a notebook listens.

    Examples
    --------
    >>> from sparsepop_py.progress import Line
    >>> line = Line(False)
    >>> line.draw("solve ...")  # nothing: it is not to be shown
    >>> line.close()
    """

    def __init__(self, show: bool) -> None:
        self._show = bool(show) and (_in_terminal() or _in_notebook())
        self._begin, self._text = time.monotonic(), ""
        self._lock, self._closed = threading.Lock(), threading.Event()
        self._thread: threading.Thread | None = None
        self._tqdm: Any = None

    @property
    def shown(self) -> bool:
        """True if there is somebody to see it."""
        return self._show

    def draw(self, text: str) -> None:
        """Replace the text of the line.

        Parameters
        ----------
        text : str
        """
        self._text = text
        if self._show:
            self._start()
            self._redraw()

    def close(self) -> None:
        """Erase the line; the next text opens it again."""
        if self._thread is None:
            return
        self._closed.set()
        self._thread.join()
        self._thread = None
        with self._lock:
            if self._tqdm is not None:
                self._tqdm.close()
                self._tqdm = None
            else:
                self._write("")

    def _start(self) -> None:
        if self._thread is None:
            self._closed.clear()
            self._tqdm = _bar()
            self._thread = threading.Thread(target=self._tick, name="progress line", daemon=True)
            self._thread.start()

    def _tick(self) -> None:
        while not self._closed.wait(_REDRAWN):
            self._redraw()

    def _redraw(self) -> None:
        shown = f"{time.monotonic() - self._begin:.0f} s  {self._text}"
        with self._lock:
            if self._tqdm is not None:
                self._tqdm.set_description_str(shown)
            else:
                self._write(shown)

    def _write(self, text: str) -> None:
        sys.stderr.write(f"\r\x1b[K{text}")
        sys.stderr.flush()


class Stages:
    """CPU seconds by stage and bounds so far, shown and logged. Mutable.

    Parameters
    ----------
    show : bool
        Draw a :class:`Line`.
    on_progress : callable, optional
        Called with the number of the objective and its proved and attained values: when they
        change, and at the next stage after two seconds. An exception of its own ends the solve;
        ``KeyboardInterrupt`` keeps what is proved.
    """

    def __init__(self, show: bool = False, on_progress: OnProgress | None = None) -> None:
        self.seconds: dict[str, float] = {}
        self.notes: list[str] = []
        self.searched = 0.0  # CPU seconds, or work, of local searches so far
        self._line = Line(show)
        self._listeners = [] if on_progress is None else [on_progress]
        self._number: int | None = None
        self._known, self._reported = (-float("inf"), float("inf")), -float("inf")
        self._name, self._silent = "", True  # nothing was reported yet

    def __reduce__(self) -> tuple[type[Stages], tuple[()]]:
        """Begin anew in another process, unseen and unheard."""
        return Stages, ()

    def of_objective(self, number: int) -> Stages:
        """Return stages of one of several objectives, which share line and callback."""
        made = Stages()
        made._line, made._listeners, made._number = self._line, self._listeners, number
        return made

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the body of a with statement for the stage of that name.

        Raises
        ------
        LimitReached
            If the limits kept in this thread have passed.
        """
        check()
        self._name = name
        self._draw()
        if not self._silent and time.monotonic() - self._reported > _REPORTED:
            self._report()
        start = cpu_seconds()
        try:
            yield
        finally:
            spent = cpu_seconds() - start
            self.seconds[name] = self.seconds.get(name, 0.0) + spent
            _LOG.debug("%s: %.3f CPU seconds", name, spent)

    def bounds(self, lower: float, upper: float) -> None:
        """Show, log and report the proved and the attained value, if they changed.

        Parameters
        ----------
        lower, upper : float
            -inf and +inf where there is none.
        """
        if (lower, upper) == self._known and not self._silent:
            return
        self._known = lower, upper
        if _LOG.isEnabledFor(logging.INFO):
            low, high = rounded(lower, False, 10), rounded(upper, True, 10)
            _LOG.info("%sproved %s, attained %s", self._where, low, high)
        self._draw()
        self._report()

    def note(self, text: str, level: int = logging.INFO) -> None:
        """Keep a sentence for the user, once, and log it."""
        if text not in self.notes:
            self.notes.append(text)
            _LOG.log(level, text)

    def include(self, seconds: Mapping[str, float], notes: Sequence[str], searched: float) -> None:
        """Add what another process spent and left here.

        Parameters
        ----------
        seconds : mapping
            CPU seconds by stage.
        notes : sequence of str
        searched : float
            CPU seconds, or work, of local searches.
        """
        for name, spent in seconds.items():
            self.seconds[name] = self.seconds.get(name, 0.0) + spent
        for text in notes:
            self.note(text)
        self.searched += searched

    def close(self) -> None:
        """Erase the line."""
        self._line.close()

    @property
    def _where(self) -> str:
        return "" if self._number is None else f"objective {self._number}: "

    def _draw(self) -> None:
        if not self._line.shown:
            return
        low = rounded(self._known[0], False, 8)
        high = rounded(self._known[1], True, 8)
        self._line.draw(f"{self._where}{low} <= minimum <= {high}  {self._name} ...")

    def _report(self) -> None:
        self._reported, self._silent = time.monotonic(), False
        for listener in list(self._listeners):
            try:
                listener(self._number or 0, *self._known)
            except BaseException:
                self._listeners.clear()  # it ended the solve and hears no more
                raise
