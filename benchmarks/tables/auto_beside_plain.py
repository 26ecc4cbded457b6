"""Bound that effort auto reaches with half as much time again as the plain order takes.

For each problem the plain relaxation of an order is solved and proved. Then auto gets 1.5 times
that CPU time and 0.2 seconds, and its bound is put beside the plain one. Repeated, medians count.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median_low

import sparsepop_py as sp
from sparsepop_py.budget import cpu_seconds

from ..measuring.registry import Family, Selection
from .text import number, table

__all__ = ["Beside", "auto_beside_plain", "beside_table", "files_of", "members_of"]

FACTOR, EXTRA = 1.5, 0.2  # CPU seconds
TOLERANCE = 1e-6  # relative


@dataclass(frozen=True)
class Beside:
    """One problem at one order.

    Parameters
    ----------
    name : str
    order : int
    plain, auto : float
        Proved bounds.
    plain_seconds, auto_seconds : float
        CPU seconds.
    status : str
        Of auto.
    """

    name: str
    order: int
    plain: float
    auto: float
    plain_seconds: float
    auto_seconds: float
    status: str

    @property
    def reached(self) -> bool:
        """True if auto proved as much as the plain order."""
        return self.auto >= self.plain - TOLERANCE * max(1.0, abs(self.plain))


def auto_beside_plain(
    problems: Iterable[tuple[str, sp.Problem]],
    orders: Sequence[int],
    limit: float,
    repeat: int = 1,
) -> Iterator[Beside]:
    """Measure each problem at each order that the plain relaxation finishes.

    Parameters
    ----------
    problems : iterable of (name, Problem)
    orders : sequence of int
        Orders below the least of a problem are left out.
    limit : float
        CPU seconds of a plain order; what takes longer is left out.
    repeat : int
        Solves of each kind, of which the median counts.
    """
    for name, problem in problems:
        least = max(1, (problem.degree + 1) // 2)
        for order in [o for o in orders if o >= least]:
            settings = sp.Options(effort="plain", order=order, cpu_limit=limit, progress=False)
            plain, seconds = _median(problem, settings, repeat)
            if plain.status is sp.Status.LIMIT:
                continue
            allowed = FACTOR * seconds + EXTRA
            settings = sp.Options(effort="auto", cpu_limit=allowed, progress=False)
            auto, used = _median(problem, settings, repeat)
            bounds = plain.lower_bound, auto.lower_bound
            yield Beside(name, order, *bounds, seconds, used, auto.status.name)


def _median(problem: sp.Problem, options: sp.Options, repeat: int) -> tuple[sp.Result, float]:
    """Solve several times; return the result with the median bound, and the median seconds."""
    runs = [_timed(problem, options) for _ in range(repeat)]
    middle = median_low(result.lower_bound for result, _ in runs)
    result = next(result for result, _ in runs if result.lower_bound == middle)
    return result, median_low(seconds for _, seconds in runs)


def _timed(problem: sp.Problem, options: sp.Options) -> tuple[sp.Result, float]:
    start = cpu_seconds()
    return sp.solve(problem, options), cpu_seconds() - start


def beside_table(rows: Sequence[Beside]) -> str:
    """Lay out a Markdown table, a last line counts."""
    head = ["problem", "order", "plain proved", "s", "auto proved", "s", "status", "reached"]
    lines = [
        [
            row.name,
            str(row.order),
            number(row.plain),
            f"{row.plain_seconds:.2f}",
            number(row.auto),
            f"{row.auto_seconds:.2f}",
            row.status,
            "yes" if row.reached else "**no**",
        ]
        for row in rows
    ]
    reached = sum(row.reached for row in rows)
    return f"{table(head, lines)}\n\nreached in {reached} of {len(rows)} rows"


def files_of(paths: Sequence[Path]) -> list[tuple[str, sp.Problem]]:
    """Problems of ``.gms`` files without ratios, by their names."""
    found = [(path, sp.read_gms(path)) for path in paths]
    return [(path.stem, each) for path, each in found if isinstance(each, sp.Problem)]


def members_of(family: Family, names: Sequence[str] = ()) -> Iterator[tuple[str, sp.Problem]]:
    """Problems of a family with an objective of their own, by their names."""
    for case in family.chosen(Selection(names=tuple(names))):
        yield case.name, case.make().problem
