"""Columns of numbers from CSV and MATLAB files."""

from __future__ import annotations

import csv
import os
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import real_array
from setid.errors import DataError

__all__ = ["Column", "listed", "read_csv_columns", "read_mat_columns", "stacked", "text_lines"]

Column = str | int
_MISSING = {"", "nan", "na", "n/a", "null", "none", "?"}


def read_csv_columns(
    path: str | os.PathLike[str], columns: Sequence[Column]
) -> list[NDArray[np.float64]]:
    """Columns of a text table.

    Parameters
    ----------
    path : path-like
        Separated by commas, semicolons, tabs or blanks; the first line may hold names.
        Lines that begin with ``#`` or ``%`` are skipped; empty fields are missing samples.
    columns : sequence of str or int
        Names from the first line, or numbers from 0.

    Raises
    ------
    DataError
        With file, line, column and the text found; or where two columns are the same.
    """
    lines = _table(path)
    header = None if all(map(_is_number, lines[0][1])) else [f.strip() for f in lines[0][1]]
    body = lines[1:] if header else lines
    places = [_place(path, column, header, len(lines[0][1])) for column in columns]
    _check_distinct(path, columns, places)
    values = np.empty((len(body), len(places)))
    for row, (number, fields) in enumerate(body):
        if len(fields) != len(lines[0][1]):
            raise DataError(
                f"{path}, line {number}: found {len(fields)} fields, "
                f"expected {len(lines[0][1])} as in the first line"
            )
        for out, place in enumerate(places):
            values[row, out] = _number(path, number, place, fields[place])
    return [values[:, out].copy() for out in range(len(places))]


def _check_distinct(
    path: str | os.PathLike[str], columns: Sequence[Column], places: list[Any]
) -> None:
    """Refuse one column for two signals."""
    for column, place in zip(columns, places, strict=True):
        if places.count(place) > 1:
            raise DataError(
                f"{path}: found column {column!r} for two signals, expected one for each"
            )


def _table(path: str | os.PathLike[str]) -> list[tuple[int, list[str]]]:
    """Numbered lines of fields."""
    lines = text_lines(path)
    if not lines:
        raise DataError(f"{path}: found no lines, expected a table of numbers")
    first = lines[0][1]
    separator = next((mark for mark in (";", "\t", ",") if mark in first), None)
    if separator is None:
        return [(number, line.split()) for number, line in lines]
    return [(n, next(csv.reader([line], delimiter=separator))) for n, line in lines]


def text_lines(path: str | os.PathLike[str]) -> list[tuple[int, str]]:
    """Numbered lines of a text file, without blank lines and comments.

    Raises
    ------
    DataError
        If there is no such file, or it is no text.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise DataError(f"{path}: {error.strerror}, expected a table of numbers") from None
    except UnicodeDecodeError as error:
        raise DataError(
            f"{path}: found bytes that are no UTF-8 text (at {error.start}), "
            "expected a table of numbers"
        ) from None
    lines = ((number, line.strip()) for number, line in enumerate(text.splitlines(), 1))
    return [(number, line) for number, line in lines if line and line[0] not in "#%"]


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return field.strip().lower() in _MISSING
    return True


def _number(path: str | os.PathLike[str], line: int, place: int, field: str) -> float:
    if field.strip().lower() in _MISSING:
        return float("nan")
    try:
        return float(field)
    except ValueError:
        raise DataError(
            f"{path}, line {line}, column {place}: found {field!r}, expected a number"
        ) from None


def _place(
    path: str | os.PathLike[str], column: Column, header: list[str] | None, width: int
) -> int:
    if isinstance(column, str):
        if header is None or header.count(column) != 1:
            raise DataError(
                f"{path}: found no single column {column!r}, expected one of "
                f"{header if header else f'the numbers 0..{width - 1} (no line of names)'}"
            )
        return header.index(column)
    if not 0 <= column < width:
        raise DataError(f"{path}: found column {column}, expected 0..{width - 1}")
    return int(column)


def read_mat_columns(
    path: str | os.PathLike[str], names: Sequence[str]
) -> list[NDArray[np.float64]]:
    """Variables of a MATLAB file (up to version 7), each as columns (N, c).

    Rows and columns are told apart by length: the longer side holds the samples.

    Raises
    ------
    DataError
        If a variable is missing or not a real matrix.
    """
    import scipy.io  # loaded by those who read such files

    try:
        version = scipy.io.matlab.matfile_version(os.fspath(path))
        found = {} if version[0] > 1 else scipy.io.loadmat(os.fspath(path))
    except OSError as error:
        raise DataError(f"{path}: {error.strerror}, expected a MATLAB file") from None
    except (ValueError, TypeError, scipy.io.matlab.MatReadError, zlib.error) as cause:
        raise DataError(f"{path}: {cause}, expected a MATLAB file of version 7 or older") from None
    if version[0] > 1:
        raise DataError(
            f"{path}: found a MATLAB 7.3 file, expected version 7 or older (save with '-v7')"
        )
    _check_distinct(path, names, list(names))
    arrays = []
    for name in names:
        if name not in found or name.startswith("__"):
            known = sorted(key for key in found if not key.startswith("__"))
            raise DataError(f"{path}: found no variable {name!r}, expected one of {known}")
        values = np.atleast_2d(real_array(found[name], f"{path}: {name}", DataError))
        if values.ndim != 2:
            raise DataError(f"{path}: {name}: found shape {values.shape}, expected a matrix")
        arrays.append(values.T.copy() if values.shape[0] < values.shape[1] else values)
    return arrays


def listed(given: Column | Sequence[Column]) -> list[Any]:
    """One column or several, as a list."""
    return [given] if isinstance(given, (str, int)) else list(given)


def stacked(columns: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Columns side by side, shape (N, channels)."""
    if not columns:
        raise DataError("inputs, outputs: found no column, expected at least one each")
    if len({column.shape[0] for column in columns}) > 1:
        lengths = [column.shape[0] for column in columns]
        raise DataError(f"channels: found {lengths} samples, expected equal numbers")
    return np.column_stack(columns)
