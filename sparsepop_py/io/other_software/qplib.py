"""Files of QPLIB, the library of quadratic programs.

References
----------
F. Furini et al., QPLIB: a library of quadratic programming instances, Math. Program. Comput. 11
(2019) 237-265; the format is described on the library's pages.
"""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.errors import FormatError
from sparsepop_py.files import read_text
from sparsepop_py.io.other_software.integers import between, problem_with_integers
from sparsepop_py.problem.problem import Problem

__all__ = ["read_qplib"]

_MOST = 10**7  # variables and rows
_COUNT = re.compile(r"[0-9]{1,9}")
_NUMBER = re.compile(
    r"[+-]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:e[+-]?[0-9]+)?|inf(?:inity)?)", re.IGNORECASE
)
Index = TypeVar("Index")

_OBJECTIVES, _VARIABLES, _ROWS = "LDCQ", "CBMIG", "NBLDCQ"


def read_qplib(path: str | os.PathLike[str]) -> Problem:
    r"""Read a problem from a ``.qplib`` file.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    Problem
        Variables x1, x2, ... where the file has no names. A maximisation is stored negated, with
        ``sense="max"``.

    Raises
    ------
    FormatError
        Naming file and line.

    Examples
    --------
    >>> import pathlib
    >>> lines = "tiny, QCL, minimize, 2, 1, 1, 1 1 2, 0, 1, 2 -3, 5, 2, 1 1 1, 1 2 1, 1e20, 1, 0, "
    >>> lines += "1e20, 0, 0, 0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0"
    >>> _ = pathlib.Path("tiny.qplib").write_text("\n".join(lines.split(", ")))
    >>> print(read_qplib("tiny.qplib"))
    min 5 - 3*x2 + x1^2
      s.t. row1: -1 + x1 + x2 >= 0
      0 <= x1 <= 4
      0 <= x2 <= 4
    """
    lines = _Lines(str(path), read_text(path))
    lines.word("the name of the problem")
    kind = lines.word("the type, such as QCQ").upper()
    if len(kind) != 3 or any(
        letter not in known
        for letter, known in zip(kind, (_OBJECTIVES, _VARIABLES, _ROWS), strict=True)
    ):
        raise lines.error(kind, "three letters such as QCQ")
    direction = lines.word("minimize or maximize").lower()
    if direction not in ("minimize", "maximize"):
        raise lines.error(direction, "minimize or maximize")
    n = lines.count("the number of variables", least=1, most=_MOST)
    m = lines.count("the number of constraints", most=_MOST) if kind[2] not in "NB" else 0
    terms = _Terms(m + 1)
    if kind[0] != "L":
        terms.squares(lines, n, rows=0)
    terms.linear(0, lines.vector(n, "objective"))
    terms.add(0, (0, 0), lines.number("the constant of the objective"))
    if kind[2] not in "NBL":
        terms.squares(lines, n, rows=m)
    if m:
        terms.entries(lines, n, m)
    infinity = lines.number("the value of infinity")
    if infinity <= 0:
        raise lines.error(f"{infinity:g}", "a value of infinity above 0")
    left, right = (lines.vector(m, side) for side in ("left", "right")) if m else ([], [])
    low, high, whole = _variables(lines, kind[1], n)
    names = _names(lines, n, m)
    objective, *bodies = terms.polynomials(n, names[0])
    if direction == "maximize":
        objective = -objective
    sides = zip(bodies, _ends(left, infinity), _ends(right, infinity), names[1], strict=True)
    rows = [row for side in sides for row in between(*side)]
    bounds = (_ends(low, infinity), _ends(high, infinity))
    sense = "max" if direction == "maximize" else "min"
    return problem_with_integers(objective, rows, bounds, names[0], whole, sense)  # type: ignore[arg-type]


@dataclass(slots=True)
class _Lines:
    """Lines that say something, one after the other. Mutable."""

    path: str
    text: str
    place: int = 0
    lines: list[tuple[int, list[str]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        for number, line in enumerate(self.text.splitlines(), 1):
            words = line.partition("#")[0].split()
            if words and not words[0].startswith(("!", "%")):
                self.lines.append((number, words))

    def error(self, found: str, expected: str) -> FormatError:
        """Make the error for the line read last."""
        number = self.lines[self.place - 1][0] if self.place else 1
        return FormatError(f"{self.path}:{number}: found {found!r}, expected {expected}")

    def words(self, expected: str) -> list[str]:
        """Read the next line."""
        self.place += 1
        if self.place > len(self.lines):
            self.place = len(self.lines)
            raise self.error("the end of the file", expected)
        return self.lines[self.place - 1][1]

    def word(self, expected: str) -> str:
        """Read the first word of the next line."""
        return self.words(expected)[0]

    def number(self, expected: str) -> float:
        """Read a number."""
        return self.value(self.word(expected), expected)

    def value(self, word: str, expected: str) -> float:
        """Read a number in a word; Python's own words for numbers may hold underscores."""
        if not _NUMBER.fullmatch(word):
            raise self.error(word, expected)
        return float(word)

    def count(self, expected: str, least: int = 0, most: int = 10**9) -> int:
        """Read an integer."""
        word = self.word(expected)
        if not _COUNT.fullmatch(word) or not least <= int(word) <= most:
            raise self.error(word, f"{expected}, from {least} to {most}")
        return int(word)

    def entry(self, limits: list[int], expected: str) -> tuple[list[int], float]:
        """Read indices, from 1 to their limits, and a number."""
        words = self.words(expected)
        whole = all(map(_COUNT.fullmatch, words[: len(limits)]))
        if len(words) <= len(limits) or not whole:
            raise self.error(" ".join(words), expected)
        indices = [int(word) for word in words[: len(limits)]]
        if not all(1 <= i <= limit for i, limit in zip(indices, limits, strict=True)):
            raise self.error(" ".join(words), expected)
        return indices, self.value(words[len(limits)], expected)

    def once(self, seen: set[Index], index: Index, expected: str) -> None:
        """Refuse what comes a second time."""
        if index in seen:
            raise self.error(" ".join(self.lines[self.place - 1][1]), expected)
        seen.add(index)

    def vector(self, size: int, what: str) -> list[float]:
        """Read a default and the entries that differ from it."""
        values = [self.number(f"the default of {what}")] * size
        seen: set[int] = set()
        for _ in range(self.count(f"how many entries of {what} differ from the default")):
            (i,), value = self.entry([size], f"an index and a value of {what}")
            self.once(seen, i, f"one value of {what} for each index")
            values[i - 1] = value
        return values

    @property
    def done(self) -> bool:
        """Check for the end of the file."""
        return self.place >= len(self.lines)


class _Terms:
    """Terms of the objective, row 0, and of constraints."""

    def __init__(self, rows: int) -> None:
        self._terms: list[list[tuple[tuple[int, int], float]]] = [[] for _ in range(rows)]

    def add(self, row: int, word: tuple[int, int], value: float) -> None:
        self._terms[row].append((word, value))

    def linear(self, row: int, values: list[float]) -> None:
        for v, value in enumerate(values, 1):
            self.add(row, (0, v), value)

    def squares(self, lines: _Lines, n: int, rows: int) -> None:
        """Read the quadratic terms of the objective, or of all rows."""
        limits = [rows, n, n] if rows else [n, n]
        seen: set[tuple[int, ...]] = set()
        for _ in range(lines.count("the number of quadratic entries")):
            indices, value = lines.entry(limits, "indices and a value of a quadratic term")
            i, j = sorted(indices[-2:])
            lines.once(seen, (*indices[:-2], i, j), "each product once")
            self.add(indices[0] if rows else 0, (i, j), 0.5 * value if i == j else value)

    def entries(self, lines: _Lines, n: int, rows: int) -> None:
        seen: set[tuple[int, int]] = set()
        for _ in range(lines.count("the number of linear entries")):
            (k, i), value = lines.entry([rows, n], "row, variable and a value")
            lines.once(seen, (k, i), "each entry once")
            self.add(k, (0, i), value)

    def polynomials(self, n: int, names: list[str]) -> list[Polynomial]:
        found = []
        for terms in self._terms:
            words = np.array([word for word, _ in terms], np.int32).reshape(-1, 2)
            values = np.array([value for _, value in terms], float)
            found.append(Polynomial.from_words(words, values, n, names))
        return found


def _variables(lines: _Lines, kind: str, n: int) -> tuple[list[float], list[float], list[int]]:
    """Read bounds and kinds of variables."""
    if kind == "B":
        return [0.0] * n, [1.0] * n, list(range(n))
    low, high = lines.vector(n, "lower bounds"), lines.vector(n, "upper bounds")
    if kind in "CI":
        return low, high, list(range(n)) if kind == "I" else []
    kinds = lines.vector(n, "kinds of variables")
    for found in set(kinds) - {0, 1, 2}:
        raise lines.error(f"{found:g}", "kinds 0 (continuous), 1 (integer) and 2 (binary)")
    for v in (v for v in range(n) if kinds[v] == 2):  # binary
        low[v], high[v] = max(low[v], 0.0), min(high[v], 1.0)
    return low, high, [v for v in range(n) if kinds[v] in (1, 2)]


def _names(lines: _Lines, n: int, m: int) -> tuple[list[str], list[str]]:
    """Skip the starting points and read the names that follow them."""
    variables, rows = [f"x{v + 1}" for v in range(n)], [f"row{k + 1}" for k in range(m)]
    for size in (n, m, n):  # of x, of the multipliers of rows if there are any, of those of bounds
        if size and not lines.done:
            lines.vector(size, "a starting point")
    for names in (variables, rows):
        for _ in range(lines.count("the number of names") if not lines.done else 0):
            index, name = (*lines.words("an index and a name"), "")[:2]
            if not _COUNT.fullmatch(index) or not 1 <= int(index) <= len(names) or not name:
                raise lines.error(f"{index} {name}", "an index and a name")
            names[int(index) - 1] = name
    if not lines.done:
        raise lines.error(" ".join(lines.words("nothing")), "the end of the file")
    return variables, rows


def _ends(values: list[float], infinity: float) -> list[float]:
    return [math.copysign(math.inf, v) if abs(v) >= infinity else v for v in values]
