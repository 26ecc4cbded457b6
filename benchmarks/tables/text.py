"""Markdown tables of results."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

__all__ = ["number", "table"]


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    r"""A Markdown table; bars inside cells are escaped.

    Examples
    --------
    >>> print(table(["a", "b"], [["1", "2|3"]]))
    | a | b |
    |---|---|
    | 1 | 2\|3 |
    """
    lines = [_line(head), "|" + "---|" * len(head)]
    return "\n".join(lines + [_line(row) for row in rows])


def _line(cells: Sequence[str]) -> str:
    shown = (" ".join(cell.split()).replace("|", "\\|") for cell in cells)
    return "| " + " | ".join(shown) + " |"


def number(value: float, digits: int = 2) -> str:
    """A number in few digits, nothing for nan.

    Examples
    --------
    >>> number(1234.5), number(0.00012), number(float("nan")), number(float("inf"))
    ('1.2e+03', '0.00012', '', 'inf')
    """
    return "" if math.isnan(value) else f"{value:.{digits}g}"
