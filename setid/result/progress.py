"""Progress over all bounds: a changing line, a callback, a log."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence

from sparsepop_py.progress import Line
from sparsepop_py.verified.arithmetic.display import rounded

__all__ = ["OnProgress", "Progress"]

Ends = tuple[float, float]
OnProgress = Callable[[str, Ends, Ends], None]

_LOG = logging.getLogger(__name__)
logging.getLogger("setid").addHandler(logging.NullHandler())
_BAR = 24


class Progress:
    """Progress of all ends of intervals: settled ones, and the last gap that moved.

    Parameters
    ----------
    names : sequence of str
        One a parameter; objectives 2 i and 2 i + 1 are its two ends.
    tol : float
        Gap that counts as closed, as a fraction of the attained width.
    show : bool
        Draw the line; ignored unless standard error is a terminal or a notebook listens.
    units : sequence of float, optional
        Units of the parameters in what is reported; 1 when left out.
    on_progress : callable, optional
        Called with a parameter's name, its proved and its attained interval.
    """

    def __init__(
        self,
        names: Sequence[str],
        tol: float,
        show: bool,
        units: Sequence[float] | None = None,
        on_progress: OnProgress | None = None,
    ) -> None:
        self._names, self._tol = list(names), tol
        self._units = [1.0] * len(self._names) if units is None else [float(u) for u in units]
        self._ends = [(float("-inf"), float("inf"))] * (2 * len(self._names))
        self._shown, self._on_progress = Line(show), on_progress

    def report(self, index: int, lower_bound: float, upper_bound: float) -> None:
        """Note what is proved and attained of one objective."""
        self._ends[index] = (lower_bound, upper_bound)
        self._shown.draw(self.line(index))
        name, (outer, inner) = self._names[index // 2], self._interval(index // 2)
        sides = zip((*outer, *inner), (False, True, True, False), strict=True)
        shown = [rounded(end, upwards, 8) for end, upwards in sides]
        _LOG.info("%s: proved [%s, %s], attained [%s, %s]", name, *shown)
        if self._on_progress is not None:
            self._on_progress(name, outer, inner)

    def _interval(self, place: int) -> tuple[Ends, Ends]:
        """Return the proved and the attained interval of one parameter."""
        low, high, unit = *self._ends[2 * place : 2 * place + 2], self._units[place]
        return (low[0] * unit, -high[0] * unit), (low[1] * unit, -high[1] * unit)

    @property
    def settled(self) -> int:
        """Number of ends whose gap is closed."""
        return sum(self._gap(index) <= self._tol for index in range(len(self._ends)))

    def _gap(self, index: int) -> float:
        (low, high), other = self._ends[index], self._ends[index ^ 1][1]
        width = -other - high
        if not width < float("inf") or not high - low < float("inf"):
            return float("inf")
        return (high - low) / width if width > 0 else float(high > low)

    def line(self, index: int) -> str:
        """Write the text of the line."""
        full = round(_BAR * self.settled / max(1, len(self._ends)))
        name, (outer, _) = self._names[index // 2], self._interval(index // 2)
        count = f"{self.settled}/{len(self._ends)} ends"
        side = "low" if index % 2 == 0 else "high"
        low = rounded(outer[0], False, 6)
        high = rounded(outer[1], True, 6)
        last = f"{name} in [{low}, {high}], {side}: gap {self._gap(index):.2g}"
        return f"[{'#' * full}{'.' * (_BAR - full)}] {count}, {last}"

    def close(self) -> None:
        """Erase the line."""
        self._shown.close()
