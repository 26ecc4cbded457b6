"""Read columns of numbers from text tables, so that no row can vanish.

A row that is dropped makes its neighbours consecutive samples, and what is then proved is about
another record. So there are three kinds of lines. Lines before the table may be blank or comments.
One line may hold names, and further header lines are skipped where the user says how many there
are. Every line after that is a sample, with missing fields perhaps, or an error that names it.
Whatever was skipped is returned, and stands in the assumptions of the record.
"""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import path_of, word
from setid.errors import DataError

__all__ = ["column_names", "Column", "Table", "check_distinct", "read_table"]

Column = str | int
PathLike = str | os.PathLike[str]

_MISSING = {"", "nan", "na", "n/a", "null", "none", "?"}
# What spreadsheets write where a formula has no value: the sample is missing.
_MISSING |= {"#n/a", "#div/0!", "#value!", "#ref!", "#num!", "#name?", "#null!"}
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_MARKS = ("#", "%")
_HEADER = "; if this line is a second header, say header=2 (--header 2)"
_MOST_QUOTED = 60  # characters of a line that a message shows


@dataclass(frozen=True)
class Table:
    """Columns of a text table, and what was skipped on the way to them.

    Parameters
    ----------
    columns : list of (N,) float
        One array for each column that was asked for; missing samples are NaN.
    skipped : tuple of str
        A sentence for each line, or run of lines, that holds no sample.
    names : tuple of str or None
        Of the columns that were asked for, where there is a line of names.
    units : tuple of str or None
        The second header line at these columns, where there is one.
    """

    columns: list[NDArray[np.float64]]
    skipped: tuple[str, ...]
    names: tuple[str, ...] | None = None
    units: tuple[str, ...] | None = None


def read_table(
    path: PathLike,
    columns: Sequence[Column],
    decimal: str = ".",
    header: int | None = None,
    time: Column | None = None,
) -> Table:
    """Read columns of a text table.

    Parameters
    ----------
    path : path-like
        UTF-8 text; fields are separated by semicolons, tabs, commas or blanks, whichever of them
        comes first in this order in the first line of the table.
    columns : sequence of str or int
        Names from the line of names, or numbers from 0.
    decimal : {".", ","}
        The decimal mark. With a comma, commas separate nothing.
    header : int, optional
        Number of lines before the first sample, blank lines and comments left out; the first of
        them holds the names. By default one if the first line holds no number, else none.
    time : str or int, optional
        A further column, the last of the table that is returned. Dates of ISO 8601, such as
        2026-03-01T12:00:00.5, count in seconds since the first.

    Raises
    ------
    DataError
        With file, line, column and what was found: a field that is neither a number nor a mark of
        a missing sample, a line with another number of fields, a blank line or a comment between
        samples, a first line that is half names and half numbers.
    """
    word(decimal, "decimal", (".", ","), DataError)
    lines = _lines(path, decimal)
    begin = next((k for k, (_, line) in enumerate(lines) if not _is_comment(line)), len(lines))
    if begin >= len(lines):
        raise DataError(f"{path}: found no lines, expected a table of numbers")
    separator = _separator(lines[begin][1], decimal)
    while not lines[-1][1]:
        lines.pop()
    rows = [(number, _fields(path, number, line, separator)) for number, line in lines[begin:]]
    width = len(rows[0][1])
    names_at = _header_lines(path, rows[0], decimal, header)
    if len(rows) <= names_at:
        raise DataError(
            f"{path}: found {len(rows)} lines and {names_at} of headers, expected samples"
        )
    _refuse_samples_in_headers(path, rows[1:names_at], decimal)
    names = [field.strip() for field in rows[0][1]] if names_at else None
    _refuse_samples_in_comments(path, lines[:begin], separator, width, decimal)
    asked = [*columns] if time is None else [*columns, time]
    places = [_place(path, column, names, width) for column in asked]
    check_distinct(path, asked, places)
    samples = rows[names_at:]
    if time is not None:
        samples = _with_seconds(path, samples, places[-1], decimal)
    values = _samples(path, lines[begin + names_at :], samples, places, width, decimal)
    skipped = _skipped(path, lines[:begin], rows[1:names_at] if names_at else [])
    if separator == "," and names is None:
        skipped += _doubtful_commas(path, rows)
    chosen = None if names is None else tuple(names[place] for place in places)
    units = None
    if names_at > 1 and len(rows[1][1]) == width:
        units = tuple(rows[1][1][place].strip().strip("[]()") for place in places)
    distinct = chosen if chosen is not None and all(chosen) else None
    return Table([values[:, k].copy() for k in range(len(places))], skipped, distinct, units)


def column_names(path: PathLike, decimal: str = ".", header: int | None = None) -> list[str | int]:
    """List the columns of a table by their names, or by numbers from 0 where there are none.

    Without names, columns that are empty in every line are left out, such as the one that a
    separator at the end of each line leaves.

    Parameters
    ----------
    path, decimal, header
        As of :func:`read_table`.

    Raises
    ------
    DataError
        If there is no table, or its first line is half names and half numbers.
    """
    lines = [(number, line) for number, line in _lines(path, decimal) if not _is_comment(line)]
    if not lines:
        raise DataError(f"{path}: found no lines, expected a table of numbers")
    separator = _separator(lines[0][1], decimal)
    fields = _fields(path, *lines[0], separator)
    if _header_lines(path, (lines[0][0], fields), decimal, header):
        return [field.strip() for field in fields]
    rows = [fields, *(_fields(path, *line, separator) for line in lines[1:])]
    return [
        k
        for k in range(len(fields))
        if any(field.strip() for row in rows for field in row[k : k + 1])
    ]


# ---- lines and fields -------------------------------------------------------------------


def _lines(path: PathLike, decimal: str) -> list[tuple[int, str]]:
    """Numbered lines without the blanks around them; only line feeds and returns end lines.

    Tabs that separate fields stay, since a missing first or last field is empty.
    """
    named = path_of(path)
    try:
        text = named.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise DataError(f"{path}: {error.strerror}, expected a table of numbers") from None
    except UnicodeDecodeError as error:
        if Path(path).suffix == ".mat":
            raise DataError(
                f"{path}: found a MATLAB file, expected a table of text; "
                "setid.IOData.from_mat reads its variables"
            ) from None
        raise DataError(
            f"{path}: found bytes that are no UTF-8 text (at {error.start}), "
            "expected a table of numbers; save it as UTF-8"
        ) from None
    lines = re.split(r"\r\n|\n|\r", text)
    first = next((line for line in lines if not _is_comment(line)), "")
    blanks = " " if _separator(first.strip(" \t"), decimal) == "\t" else " \t"
    return [(number, line.strip(blanks)) for number, line in enumerate(lines, 1)]


def _is_comment(line: str) -> bool:
    return not line.strip(" \t") or line.lstrip(" \t").startswith(_MARKS)


def _separator(line: str, decimal: str) -> str | None:
    marks = (";", "\t", ",") if decimal == "." else (";", "\t")
    return next((mark for mark in marks if mark in line), None)


def _fields(path: PathLike, number: int, line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    try:
        return next(csv.reader([line], delimiter=separator, strict=True), [])
    except csv.Error as error:
        raise DataError(f"{path}, line {number}: {error}, expected fields") from None


def _is_missing(field: str) -> bool:
    return field.strip().lower() in _MISSING


def _value(field: str, decimal: str) -> float | None:
    """The number in a field, NaN for a missing one, None for anything else."""
    if _is_missing(field):
        return float("nan")
    text = field.strip()
    text = text.replace(",", ".") if decimal == "," and "." not in text else text
    if decimal == "," and "." in field:
        return None
    return float(text) if _NUMBER.fullmatch(text) else None


# ---- the header -------------------------------------------------------------------------


def _header_lines(
    path: PathLike, first: tuple[int, list[str]], decimal: str, header: int | None
) -> int:
    """Count the lines of the table that hold names, units and the like."""
    if header is not None:
        if isinstance(header, bool) or not isinstance(header, int) or header < 0:
            raise DataError(f"header: found {header!r}, expected a number of lines from 0")
        return header
    number, fields = first
    readable = [_value(field, decimal) is not None for field in fields]
    if all(readable):
        return 0
    with_number = [f for f, known in zip(fields, readable, strict=True) if known]
    if any(not _is_missing(field) for field in with_number):
        odd = fields[readable.index(False)]
        raise DataError(
            f"{path}, line {number}: found {odd!r} beside numbers, expected a line of names or a "
            "sample (say header=1 if these are names)"
        )
    return 1


def _refuse_samples_in_headers(
    path: PathLike, headers: list[tuple[int, list[str]]], decimal: str
) -> None:
    """Refuse header lines after the first that hold numbers alone."""
    for number, fields in headers:
        values = [_value(field, decimal) for field in fields]
        if None not in values and not np.all(np.isnan(np.array(values, float))):
            raise DataError(
                f"{path}, line {number}: found a sample, {_quoted(' '.join(fields))}, expected a "
                "header; header= counts lines of the table, and comments above it are none"
            )


def _refuse_samples_in_comments(
    path: PathLike, comments: list[tuple[int, str]], separator: str | None, width: int, decimal: str
) -> None:
    """Refuse a comment that reads like a sample, as ``#N/A,0.3`` does."""
    for number, line in comments:
        fields = line.split(separator) if separator else line.split()
        values = [_value(field, decimal) for field in fields]
        if width > 1 and len(fields) == width and None not in values:
            raise DataError(
                f"{path}, line {number}: found {_quoted(line)} above the table, which reads like "
                "a sample, expected a comment; write a missing first field as an empty one"
            )


def _skipped(
    path: PathLike, comments: list[tuple[int, str]], headers: list[tuple[int, list[str]]]
) -> tuple[str, ...]:
    found = [
        f"{Path(path).name}: line {number}, a comment, was skipped: {_quoted(line)}"
        for number, line in comments
        if line
    ]
    found += [
        f"{Path(path).name}: line {number} was skipped as a header: {_quoted(' '.join(fields))}"
        for number, fields in headers
    ]
    return tuple(found)


def _doubtful_commas(path: PathLike, rows: list[tuple[int, list[str]]]) -> tuple[str, ...]:
    """Say that commas were read as separators where they may have been decimal marks."""
    width = len(rows[0][1])
    whole = all("." not in field for _, fields in rows for field in fields)
    if not whole or width % 2:
        return ()
    return (
        f"{Path(path).name}: commas were read as separators of whole numbers; "
        "if they are decimal marks, say decimal=',' (--decimal ,)",
    )


def _is_number(field: str) -> bool:
    return not _is_missing(field) and any(_value(field, mark) is not None for mark in ".,")


def _quoted(line: str) -> str:
    return repr(line if len(line) <= _MOST_QUOTED else line[:_MOST_QUOTED] + "...")


# ---- samples ----------------------------------------------------------------------------


def _samples(
    path: PathLike,
    lines: list[tuple[int, str]],
    rows: list[tuple[int, list[str]]],
    places: list[int],
    width: int,
    decimal: str,
) -> NDArray[np.float64]:
    values = np.empty((len(rows), len(places)))
    for row, ((number, line), (_, fields)) in enumerate(zip(lines, rows, strict=True)):
        if not line:
            raise DataError(
                f"{path}, line {number}: found an empty line between samples, expected "
                f"{width} fields; a missing sample keeps its separators"
            )
        if len(fields) != width:
            raise DataError(
                f"{path}, line {number}: found {len(fields)} fields, "
                f"expected {width} as in the first line"
            )
        for out, place in enumerate(places):
            value = _value(fields[place], decimal)
            if value is None:
                mark = "," if decimal == "." else "."
                hint = f"; if that is a decimal mark, say decimal={mark!r} (--decimal {mark})"
                if _value(fields[place], mark) is None:
                    hint = _HEADER if not any(map(_is_number, fields)) and row == 0 else ""
                raise DataError(
                    f"{path}, line {number}, column {place}: found {_quoted(fields[place])}, "
                    f"expected a number{hint}"
                )
            if np.isinf(value):
                raise DataError(
                    f"{path}, line {number}, column {place}: found {fields[place]!r:.40}, beyond "
                    "all doubles, expected a smaller number"
                )
            values[row, out] = value
    return values


def _with_seconds(
    path: PathLike, rows: list[tuple[int, list[str]]], place: int, decimal: str
) -> list[tuple[int, list[str]]]:
    """Write the dates of a column as seconds since the first; other fields stay as they are."""
    first: datetime | None = None
    found = []
    for number, fields in rows:
        moment = _date(fields[place], decimal) if place < len(fields) else None
        if moment is not None:
            first = moment if first is None else first
            try:
                seconds = (moment - first).total_seconds()
            except TypeError:
                raise DataError(
                    f"{path}, line {number}, column {place}: found {_quoted(fields[place])}, "
                    "expected dates all with a time zone, or all without"
                ) from None
            text = repr(seconds).replace(".", decimal)
            fields = [*fields[:place], text, *fields[place + 1 :]]
        found.append((number, fields))
    return found


def _date(field: str, decimal: str) -> datetime | None:
    """The moment that a field says, None where it is no date."""
    if _value(field, decimal) is not None:
        return None
    try:
        return datetime.fromisoformat(field.strip())
    except ValueError:
        return None


# ---- columns ----------------------------------------------------------------------------


def _place(path: PathLike, column: Column, names: list[str] | None, width: int) -> int:
    if isinstance(column, str):
        if names is None or names.count(column) != 1:
            raise DataError(
                f"{path}: found no single column {column!r}, expected one of "
                f"{names if names else f'the numbers 0..{width - 1} (no line of names)'}; "
                "say which by inputs= and outputs= (--input, --output)"
            )
        return names.index(column)
    if isinstance(column, bool) or not isinstance(column, (int, np.integer)):
        raise DataError(f"{path}: found column {column!r}, expected a name or a number")
    if not 0 <= column < width:
        raise DataError(f"{path}: found column {column}, expected 0..{width - 1}")
    return int(column)


def check_distinct(path: PathLike, columns: Sequence[Column], places: list[Any]) -> None:
    """Refuse one column for two signals."""
    for column, place in zip(columns, places, strict=True):
        if places.count(place) > 1:
            raise DataError(
                f"{path}: found column {column!r} for two signals, expected one for each"
            )
