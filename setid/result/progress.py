"""A progress line over all bounds, drawn only on a terminal."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from sparsepop_py.progress import Line

__all__ = ["Progress"]

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
        Draw the line; ignored unless standard error is a terminal.
    listener : callable, optional
        Called with the number of settled ends and of all ends after each report.
    """

    def __init__(
        self,
        names: Sequence[str],
        tol: float,
        show: bool,
        listener: Callable[[int, int], None] | None = None,
    ) -> None:
        self._names, self._tol, self._listener = list(names), tol, listener
        self._ends = [(float("-inf"), float("inf"))] * (2 * len(self._names))
        self._shown = Line(show)

    def report(self, index: int, lower_bound: float, upper_bound: float) -> None:
        """Note what is proved and attained of one objective."""
        self._ends[index] = (lower_bound, upper_bound)
        self._shown.draw(self.line(index))
        if self._listener is not None:
            self._listener(self.settled, len(self._ends))

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
        """The text of the line."""
        full = round(_BAR * self.settled / max(1, len(self._ends)))
        side = "low" if index % 2 == 0 else "high"
        name, gap = self._names[index // 2], self._gap(index)
        count = f"{self.settled}/{len(self._ends)} ends"
        return f"[{'#' * full}{'.' * (_BAR - full)}] {count}, {name} {side}: gap {gap:.2g}"

    def close(self) -> None:
        """Erase the line."""
        self._shown.close()
