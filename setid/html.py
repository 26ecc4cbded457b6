"""Small HTML for notebooks: tables and lists that look the same on light and dark pages."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

__all__ = ["listing", "section", "table"]

_NUMBER = "text-align:right;padding:.15em .8em;font-variant-numeric:tabular-nums"
_TEXT = "text-align:left;padding:.15em .8em"


def table(head: Sequence[object], rows: Iterable[Sequence[object]]) -> str:
    """Write a table; texts are escaped, numbers stand on the right of their columns.

    Parameters
    ----------
    head : sequence
    rows : iterable of sequences

    Returns
    -------
    str

    Examples
    --------
    >>> from setid.html import table
    >>> "a &lt; b" in table(["name"], [["a < b"]])
    True
    """
    lines = ["<table>", "<thead>", _row(head, "th"), "</thead>", "<tbody>"]
    lines += [_row(row, "td") for row in rows]
    return "\n".join([*lines, "</tbody>", "</table>"])


def listing(title: str, items: Iterable[object]) -> str:
    """Write a list under a title; empty where there are no items.

    Parameters
    ----------
    title : str
    items : iterable
    """
    found = [f"<li>{escape(str(item))}</li>" for item in items]
    if not found:
        return ""
    summary = f"<summary>{escape(title)} ({len(found)})</summary>"
    return f"<details>{summary}<ul>{''.join(found)}</ul></details>"


def section(title: str, *parts: str) -> str:
    """Write a title and the parts below it.

    Parameters
    ----------
    title : str
    *parts : str
        HTML; empty ones are left out.
    """
    return "\n".join([f"<div><strong>{escape(title)}</strong>", *filter(None, parts), "</div>"])


def _row(cells: Sequence[object], kind: str) -> str:
    pairs = [(str(cell), _NUMBER if _is_number(cell) else _TEXT) for cell in cells]
    made = [f'<{kind} style="{style}">{escape(text)}</{kind}>' for text, style in pairs]
    return "".join(["<tr>", *made, "</tr>"])


def _is_number(cell: object) -> bool:
    try:
        float(str(cell))
    except ValueError:
        return False
    return True
