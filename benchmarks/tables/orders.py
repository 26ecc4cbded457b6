"""Relaxation orders of one's own problems side by side: what is proved, and what it costs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import sparsepop_py as sp
from sparsepop_py.verified.arithmetic.display import rounded

from ..errors import BenchmarkError
from ..measuring.measure import own_rows
from ..measuring.records import Row
from ..measuring.registry import Case, Family, Task
from ..measuring.settings import options_from
from .text import number, table

__all__ = ["compare", "order_table"]

_CHOICES = {"sparse": (True,), "dense": (False,), "both": (True, False)}
_HEAD = [
    "problem",
    "order",
    "cliques",
    "status",
    "proved bound",
    "attained value",
    "relative gap",
    "solver value",
    "largest block",
    "blocks",
    "moments",
    "CPU s",
    "remarks",
]


def compare(
    paths: Sequence[Path],
    orders: Sequence[int],
    sparse: str = "both",
    settings: dict[str, Any] | None = None,
    repeats: int = 1,
) -> Iterator[Row]:
    """One row for each file, order, choice of cliques and repetition.

    Parameters
    ----------
    paths : sequence of Path
        GAMS files.
    orders : sequence of int
    sparse : {"both", "sparse", "dense"}
    settings : dict, optional
        Further fields of Options; effort is "plain" unless set here.
    repeats : int

    Raises
    ------
    BenchmarkError
        If a file does not exist, or an order or a choice is wrong.
    FormatError
        If a file cannot be read.
    """
    settings = {"effort": "plain", **(settings or {})}
    if sparse not in _CHOICES:
        raise BenchmarkError(f"--sparse: found {sparse!r}, expected both, sparse or dense")
    for order in orders:
        options_from({**settings, "order": order})
    for path in paths:
        if not path.is_file():
            raise BenchmarkError(f"FILE: found {str(path)!r}, expected a file that exists")
        sp.read_gms(path)  # a malformed file is an error, not a row
    for path in paths:
        for order in orders:
            for each in _CHOICES[sparse]:
                yield from _rows(path, {**settings, "order": order, "sparse": each}, repeats)


def _rows(path: Path, settings: dict[str, Any], repeats: int) -> Iterator[Row]:
    family = Family("orders", "relaxation orders", lambda _: ())
    case = Case(path.stem, partial(_task, path), settings["order"])
    options = options_from(settings)
    last: list[sp.Result] = []

    def solve(task: Task) -> list[sp.Result]:
        last[:] = [sp.solve(task.problem, options)]
        return list(last)

    variant = "sparse" if settings["sparse"] else "dense"
    for row in own_rows(family, case, variant, solve, options.gap, repeats):
        yield row if row.status.startswith("error") else _with_sizes(row, last[0])


def _task(path: Path) -> Task:
    return Task.of(sp.read_gms(path))


def _with_sizes(row: Row, result: sp.Result) -> Row:
    """The row with the solver's value, the histogram of blocks and the sense of the file."""
    sizes = result.relaxation.block_sizes if result.relaxation is not None else {}
    blocks = ", ".join(f"{sizes[s]} x {s}" for s in sorted(sizes, reverse=True) if s > 1)
    extra = {
        "sense": result.problem.sense,
        "solver_value": result.solver_value,
        "blocks": blocks,
    }
    notes = list(row.notes)
    if result.relaxation is not None and result.relaxation.order != row.size:
        notes.insert(0, f"solved at order {result.relaxation.order}")
    return replace(row, details=({**row.details[0], **extra},), notes=tuple(notes))


def order_table(rows: Sequence[Row]) -> str:
    """Markdown table in the sense of the files: for a maximum, bounds are upper bounds."""
    return table(_HEAD, [_cells(row) for row in rows])


def _cells(row: Row) -> list[str]:
    detail = row.details[0] if row.details else {}
    maximum = detail.get("sense") == "max"
    low, high = (-row.lower, -row.upper) if maximum else (row.lower, row.upper)
    value = float(detail.get("solver_value", math.nan))
    return [
        row.problem,
        str(row.size),
        row.variant,
        row.status,
        rounded(low, maximum, 9),
        rounded(high, not maximum, 9),
        number(row.gap),
        f"{-value if maximum else value:.9g}",
        str(row.largest_block),
        str(detail.get("blocks", "")),
        str(row.moments),
        f"{row.cpu_seconds:.3f}",
        "; ".join(row.notes[:2]),
    ]
