"""Read the columns of a table of samples, to compare them with the record of a file."""

from __future__ import annotations

import csv
import re
from fractions import Fraction
from pathlib import Path
from typing import Any

from .reading import Malformed, finite

MISSING = {"", "nan", "na", "n/a", "null", "none", "?"}
MISSING |= {"#n/a", "#div/0!", "#value!", "#ref!", "#num!", "#name?", "#null!"}
NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")


def table_of(path: str, decimal: str, header: int | None) -> tuple[list[str], list[list[Any]]]:
    """Read names (or none) and columns; a first line with a word is a header."""
    try:
        lines = Path(path).read_text(encoding="utf-8-sig").split("\n")
        while lines and lines[0].strip()[:1] in ("", "#", "%"):
            del lines[0]
        marks = ";\t," if decimal == "." else ";\t"
        mark = next((m for m in marks if lines and m in lines[0].strip(" \t")), None)
        lines = [line.strip(" " if mark == "\t" else " \t") for line in lines]
        while lines and not lines[-1]:
            lines.pop()
        rows = [[field.strip() for field in fields_of(line, mark)] for line in lines]
    except (OSError, ValueError, csv.Error) as error:
        raise Malformed(f"{path}: {error}") from None
    if header is None:
        header = int(bool(rows) and any(reading(field, decimal) == "no" for field in rows[0]))
    names, rows = rows[0] if header and rows else [], rows[header:]
    if len({len(row) for row in rows}) != 1 or len(names) not in (0, len(rows[0])):
        raise Malformed(f"{path}: lines of several lengths, or none")
    columns = zip(*rows, strict=True)
    return names, [[reading(field, decimal) for field in column] for column in columns]


def fields_of(line: str, mark: str | None) -> list[str]:
    """Split a stripped line at its separator, but not within quotes; without one at blanks."""
    if mark is None:
        return line.split()
    return next(csv.reader([line], delimiter=mark, strict=True), [])


def part_of(columns: list[list[Any]], rows: str) -> list[list[Any]]:
    """Take the samples FIRST:END of a table; either may be left out, as in Python."""
    try:
        first, end = (int(word) if word else None for word in rows.split(":"))
    except ValueError:
        raise Malformed(f"--rows: found {rows!r:.40}, expected FIRST:END") from None
    return [column[first:end] for column in columns]


def reading(field: str, decimal: str) -> Any:
    """Read a reading: None where it is missing, "no" where it is something else."""
    if field.lower() in MISSING:
        return None
    if decimal == ",":
        field = "no" if "." in field else field.replace(",", ".")
    try:
        return Fraction(finite(float(field), "reading")) if NUMBER.fullmatch(field) else "no"
    except Malformed:
        return "no"
