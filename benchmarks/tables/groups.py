"""Rows of one problem and one program together: medians over repetitions, then over seeds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np

from ..measuring.records import Row

__all__ = ["OURS", "Group", "exponent", "groups_of", "series_of"]

OURS = "sparsepop_py"


@dataclass(frozen=True)
class Group:
    """All rows of one problem, one program and one variant: its repetitions and seeds.

    Parameters
    ----------
    rows : tuple of Row
        At least one.
    """

    rows: tuple[Row, ...]

    @property
    def first(self) -> Row:
        """A row for what all have in common."""
        return self.rows[0]

    @property
    def key(self) -> tuple[str, str]:
        """What peers share: family and problem, with the size."""
        return (self.first.problem, str(self.first.size))

    def middle(self, name: str) -> float:
        """Median over seeds of the medians over repetitions of a field."""
        return self._median([float(getattr(row, name)) for row in self.rows])

    def phase(self, name: str) -> float:
        """The same for the seconds of a phase."""
        return self._median([row.phases.get(name, 0.0) for row in self.rows])

    def _median(self, values: Sequence[float]) -> float:
        seeds: dict[int, list[float]] = {}
        for row, value in zip(self.rows, values, strict=True):
            if not math.isnan(value):
                seeds.setdefault(row.seed, []).append(value)
        return median(median(each) for each in seeds.values()) if seeds else math.nan

    def worst(self, name: str) -> float:
        """The largest value of a field that is a number."""
        values = [float(getattr(row, name)) for row in self.rows]
        return max((v for v in values if not math.isnan(v)), default=math.nan)

    @property
    def status(self) -> str:
        """Each status that occurred, the most frequent first."""
        words = [row.status for row in self.rows]
        return " / ".join(sorted(set(words), key=words.count, reverse=True))

    @property
    def closed(self) -> str:
        """How many objectives were closed, of how many, over all rows."""
        done = sum(row.closed for row in self.rows)
        return f"{done}/{sum(row.objectives for row in self.rows)}"

    @property
    def valid(self) -> str:
        """Whether known optima lie between the bounds, and certificates verify."""
        judged = [v for row in self.rows for v in (row.valid, row.verified) if v is not None]
        return "" if not judged else "yes" if all(judged) else "NO"


def groups_of(rows: Iterable[Row]) -> list[Group]:
    """Rows grouped by problem, size, program and variant, in the order of appearance."""
    found: dict[tuple, list[Row]] = {}
    for row in rows:
        key = (row.family, row.problem, row.size, row.solver, row.variant)
        found.setdefault(key, []).append(row)
    return [Group(tuple(each)) for each in found.values()]


def exponent(groups: Sequence[Group]) -> float:
    """Slope of log CPU seconds over log size; nan with fewer than two sizes."""
    points = {g.first.size: g.middle("cpu_seconds") for g in groups if g.first.size}
    points = {size: s for size, s in points.items() if s > 0}
    if len(points) < 2:
        return math.nan
    x, y = np.log(list(points.keys())), np.log(list(points.values()))
    return float(np.polyfit(x, y, 1)[0])


def series_of(groups: Sequence[Group]) -> dict[str, list[Group]]:
    """Groups that differ in size alone, by a common name."""
    found: dict[str, list[Group]] = {}
    for group in groups:
        row = group.first
        if row.size:
            words = [w for w in row.problem.split() if not w.endswith(f"={row.size}")]
            name = " ".join([*words, row.solver])
            name += f", {row.variant}" if row.variant != "default" else ""
            found.setdefault(name, []).append(group)
    return found
