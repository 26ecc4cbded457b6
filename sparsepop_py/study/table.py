"""The table of a study, as text, CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, overload

from sparsepop_py.errors import ProblemError
from sparsepop_py.files import as_path, write_text

__all__ = ["Table"]

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Table(Sequence[Row]):
    """Rows of a study: a sequence of mappings that prints as a table.

    ``pandas.DataFrame(table)`` makes a data frame of it.

    Parameters
    ----------
    columns : tuple of str
    rows : tuple of mapping
        From columns to numbers and texts; what is missing shows as empty.

    Examples
    --------
    >>> table = Table(("name", "lower_bound"), ({"name": "disc", "lower_bound": -0.5},))
    >>> print(table)
    name  lower_bound
    disc  -0.5
    >>> len(table), table[0]["name"]
    (1, 'disc')
    """

    columns: tuple[str, ...]
    rows: tuple[Row, ...]

    @overload
    def __getitem__(self, place: int) -> Row: ...
    @overload
    def __getitem__(self, place: slice) -> tuple[Row, ...]: ...
    def __getitem__(self, place: int | slice) -> Row | tuple[Row, ...]:
        return self.rows[place]

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[Row]:
        return iter(self.rows)

    def __str__(self) -> str:
        shown = [list(self.columns), *([_text(v) for v in self._values(row)] for row in self)]
        widths = [max(map(len, column)) for column in zip(*shown, strict=True)]
        lines = ["  ".join(t.ljust(w) for t, w in zip(row, widths, strict=True)) for row in shown]
        return "\n".join(line.rstrip() for line in lines)

    def _values(self, row: Row) -> list[Any]:
        return [row.get(column) for column in self.columns]

    def csv(self) -> str:
        """Write the table as CSV text; numbers have all their digits, infinities are ``inf``.

        Returns
        -------
        str
        """
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows([_text(value) for value in self._values(row)] for row in self)
        return out.getvalue()

    def json(self) -> str:
        """Write the table as JSON text: a list of objects; infinities are strings.

        Returns
        -------
        str
        """
        rows = [{c: _number(row.get(c)) for c in self.columns} for row in self]
        return json.dumps(rows, indent=1, allow_nan=False)

    def write(self, path: str | Path) -> None:
        """Write the table to a ``.csv`` or ``.json`` file, whole or not at all.

        Parameters
        ----------
        path : str or Path

        Raises
        ------
        ProblemError
            If the ending is another one.
        OutputError
            If the file cannot be written.
        """
        texts = {".csv": self.csv, ".json": self.json}
        ending = as_path(path).suffix.lower()
        if ending not in texts:
            raise ProblemError(f"{path}: found the ending {ending!r}, expected .csv or .json")
        write_text(path, texts[ending]())


def _text(value: Any) -> str:
    return "" if value is None else repr(value) if isinstance(value, float) else str(value)


def _number(value: Any) -> Any:
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
