"""MPS files: linear and quadratic rows, bounds, integers, a quadratic objective.

Whatever a line says counts or is refused by its number: other readers pass over words that they
do not expect, read ``3,5`` as 3 and add the right-hand sides of free rows to the objective.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from sparsepop_py.algebra.polynomial import Constraint, Polynomial
from sparsepop_py.errors import FormatError
from sparsepop_py.files import read_bytes
from sparsepop_py.io.other_software.integers import between, problem_with_integers
from sparsepop_py.problem.problem import Problem

__all__ = ["read_mps"]

_INFINITE = 1e20  # ends of this size and more are none
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eEdD][+-]?[0-9]+)?")
_INFINITY = re.compile(r"[+-]?inf(?:inity)?", re.IGNORECASE)
_MAXIMISE = {"MAX": True, "MAXIMIZE": True, "MIN": False, "MINIMIZE": False}
_SIDES = {  # kinds of bounds: which ends they set, whether with a number, whether of an integer
    "LO": ("lower", True, False),
    "UP": ("upper", True, False),
    "FX": ("lower upper", True, False),
    "FR": ("lower upper", False, False),
    "MI": ("lower", False, False),
    "PL": ("upper", False, False),
    "BV": ("lower upper", False, True),
    "LI": ("lower", True, True),
    "UI": ("upper", True, True),
}
_SECTIONS = (
    *("NAME", "OBJSENSE", "ROWS", "COLUMNS", "RHS", "RANGES", "BOUNDS"),
    *("QUADOBJ", "QMATRIX", "QSECTION", "QCMATRIX", "ENDATA"),
)


def read_mps(path: str | os.PathLike[str]) -> Problem:
    r"""Read a problem from an ``.mps`` file whose names hold no spaces.

    Parameters
    ----------
    path : path-like
        The first free row is the objective, and its right-hand side the negative constant; other
        free rows say nothing. Integers have two bounds each; those between markers that have no
        bounds in the file are binary. Ends of 1e20 and more in size are none.

    Returns
    -------
    Problem
        A row with two different ends gives two constraints. A maximisation is stored negated,
        with ``sense="max"``.

    Raises
    ------
    FormatError
        ``FILE:LINE: found ..., expected ...``.

    Examples
    --------
    >>> import pathlib
    >>> text = "NAME t\nROWS\n N obj\n G c\nCOLUMNS\n x obj 1 c 1\n y c 2\nRHS\n s c 1 obj -7\n"
    >>> _ = pathlib.Path("small.mps").write_text(text + "BOUNDS\n UP b y 4\nENDATA\n")
    >>> print(read_mps("small.mps"))
    min 7 + x
      s.t. c: -1 + x + 2*y >= 0
      0 <= x <= inf
      0 <= y <= 4
    """
    data = read_bytes(path)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    file = _File(str(path))
    file.read(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"))
    return file.problem()


Product = tuple[int, int]


@dataclass(slots=True)
class _Row:
    """A row, or the objective, as far as it was read. Mutable."""

    name: str
    kind: str
    linear: dict[int, float] = field(default_factory=dict)
    squares: dict[Product, float] = field(default_factory=dict)
    side: float | None = None
    width: float | None = None

    def ends(self) -> tuple[float | Fraction, float | Fraction]:
        """Return both ends, -inf and inf for none."""
        side = self.side or 0.0
        low = side if self.kind in "EG" and side > -_INFINITE else -math.inf
        high = side if self.kind in "EL" and side < _INFINITE else math.inf
        if self.width is None or not math.isfinite(max(low, -high)):
            return low, high
        width = Fraction(abs(self.width))
        down = self.kind == "L" or (self.kind == "E" and self.width < 0)
        return (Fraction(high) - width, high) if down else (low, Fraction(low) + width)


@dataclass(slots=True)
class _Column:
    """A variable as far as it was read; None for ends not given. Mutable."""

    name: str
    integer: bool
    lower: float | None = None
    upper: float | None = None

    def ends(self) -> tuple[float, float]:
        """Return both ends with those that hold where the file gives none."""
        if self.integer and self.lower is None and self.upper is None:
            return 0.0, 1.0
        low = 0.0 if self.lower is None else self.lower
        high = math.inf if self.upper is None else self.upper
        return low, high


@dataclass(slots=True)
class _File:
    """A file as far as it was read. Mutable."""

    path: str
    number: int = 0
    section: str = ""
    about: str = ""  # the row of a section of products
    rows: dict[str, _Row] = field(default_factory=dict)
    columns: list[_Column] = field(default_factory=list)
    places: dict[str, int] = field(default_factory=dict)
    sets: dict[str, str] = field(default_factory=dict)  # names of right-hand sides and so on
    seen: list[str] = field(default_factory=list)
    halves: dict[str, dict[Product, float]] = field(default_factory=dict)
    maximise: bool | None = None
    objective: str | None = None
    integer: bool = False

    def error(self, found: str, expected: str) -> FormatError:
        """Make the error for the line read last."""
        return FormatError(f"{self.path}:{self.number}: found {found}, expected {expected}")

    def read(self, lines: list[str]) -> None:
        """Read all lines."""
        for line in lines:
            self.number += 1
            words = line.split()
            if not words or line.startswith("*"):
                continue
            if self.section == "ENDATA":
                raise self.error(f"{words[0]!r} after ENDATA", "nothing")
            if line[0].isspace():
                _READERS.get(self.section, _File.nothing)(self, words)
            else:
                self.begin(words)
        if self.section != "ENDATA":
            raise self.error("the end of the file", "ENDATA")

    def begin(self, words: list[str]) -> None:
        """Begin a section."""
        name, *rest = words
        if name not in _SECTIONS:
            raise self.error(f"the section {name!r}", f"one of {', '.join(_SECTIONS)}")
        about = " ".join(rest)
        if name in self.seen and name != "QCMATRIX":
            raise self.error(f"a second section {name}", "only one")
        self.seen.append(name)
        self.section, self.about = name, about
        if name == "OBJSENSE" and rest:
            self.sense(rest)
        elif name in ("QSECTION", "QCMATRIX"):
            self.products_of(rest)
        elif rest and name != "NAME":
            raise self.error(f"{about!r} behind {name}", "nothing")

    def nothing(self, words: list[str]) -> None:
        """Refuse a line of no section, or of one that has none."""
        raise self.error(f"{' '.join(words)!r}", "a section, from the first column on")

    # ---- rows and columns -------------------------------------------------------------------

    def sense(self, words: list[str]) -> None:
        """Read the direction."""
        word = " ".join(words).upper()
        if word not in _MAXIMISE or self.maximise is not None:
            raise self.error(f"{' '.join(words)!r}", "MAX or MIN, once")
        self.maximise = _MAXIMISE[word]

    def row(self, words: list[str]) -> None:
        """Read kind and name of a row."""
        if len(words) != 2 or words[0] not in ("N", "E", "L", "G"):
            raise self.error(f"{' '.join(words)!r}", "N, E, L or G and a name without spaces")
        kind, name = words
        if name in self.rows:
            raise self.error(f"the row {name!r} twice", "distinct names")
        self.rows[name] = _Row(name, kind)
        if kind == "N" and self.objective is None:
            self.objective = name

    def column(self, words: list[str]) -> None:
        """Read entries of a column, or a marker."""
        if len(words) == 3 and words[1] == "'MARKER'":
            self.mark(words[2])
            return
        if len(words) not in (3, 5):
            raise self.error(f"{' '.join(words)!r}", "a column, and one or two rows with numbers")
        if not self.columns or self.columns[-1].name != words[0]:
            if words[0] in self.places:
                raise self.error(f"the column {words[0]!r} again", "its entries in one place")
            self.places[words[0]] = len(self.columns)
            self.columns.append(_Column(words[0], self.integer))
        place = len(self.columns) - 1
        for row, value in self.pairs(words[1:]):
            if place in row.linear:
                raise self.error(f"a second entry of {words[0]!r} in {row.name!r}", "only one")
            row.linear[place] = value

    def mark(self, word: str) -> None:
        if word not in ("'INTORG'", "'INTEND'") or self.integer == (word == "'INTORG'"):
            raise self.error(word, "'INTORG' and 'INTEND' in turn")
        self.integer = word == "'INTORG'"

    def pairs(self, words: list[str]) -> Iterator[tuple[_Row, float]]:
        """Read names of rows with numbers."""
        for name, word in zip(words[::2], words[1::2], strict=True):
            if name not in self.rows:
                raise self.error(f"the row {name!r}", "one of ROWS")
            yield self.rows[name], self.value(word)

    def value(self, word: str, infinite: bool = False) -> float:
        """Read a number; where it may be infinite, also such a word."""
        if infinite and _INFINITY.fullmatch(word):
            return float(word)
        found = _NUMBER.fullmatch(word)
        value = float(word.lower().replace("d", "e")) if found else math.nan
        if math.isnan(value) or (math.isinf(value) and not infinite):
            raise self.error(repr(word), "a number")
        return value

    # ---- right-hand sides, ranges, bounds ---------------------------------------------------

    def vector(self, words: list[str]) -> None:
        """Read right-hand sides or widths of ranges."""
        if len(words) not in (2, 3, 4, 5):
            raise self.error(f"{' '.join(words)!r}", "one or two rows with numbers")
        if len(words) % 2:
            self.one_set(words.pop(0))
        for name, word in zip(words[::2], words[1::2], strict=True):
            if name not in self.rows:
                raise self.error(f"the row {name!r}", "one of ROWS")
            attribute = "side" if self.section == "RHS" else "width"
            row, value = self.rows[name], self.value(word, infinite=True)
            if getattr(row, attribute) is not None:
                raise self.error(f"a second entry of {name!r} in {self.section}", "only one")
            self.check_end(row, value)
            setattr(row, attribute, value)

    def check_end(self, row: _Row, value: float) -> None:
        """Refuse ends and widths that no row has."""
        if self.section == "RANGES" and row.kind == "N":
            raise self.error(f"a range of the free row {row.name!r}", "none")
        large = abs(value) >= _INFINITE
        none = self.section == "RHS" and row.kind == ("G" if value < 0 else "L")
        if large and not none:
            raise self.error(f"{value:g} of {row.name!r}", "a finite number")

    def one_set(self, name: str) -> None:
        """Refuse a second set of right-hand sides, ranges or bounds."""
        known = self.sets.setdefault(self.section, name)
        if known != name:
            raise self.error(f"a second set {name!r} in {self.section}", f"{known!r} alone")

    def bound(self, words: list[str]) -> None:
        """Read a bound."""
        if words[0] not in _SIDES:
            raise self.error(f"the bound {words[0]!r}", f"one of {', '.join(_SIDES)}")
        sides, numbered, integer = _SIDES[words[0]]
        name, word = self.bounded(words[1:], numbered)
        column = self.columns[self.places[name]]
        ends = self.ends_of(words[0], word)
        for side in sides.split():
            if getattr(column, side) is not None:
                raise self.error(f"a second {side} bound of {name!r}", "only one")
            setattr(column, side, ends[side])
        column.integer |= integer

    def bounded(self, words: list[str], numbered: bool) -> tuple[str, str]:
        """Return the name of a column and its number; check the set."""
        least = 2 if numbered else 1
        if len(words) == least + 1 or (len(words) == 3 and words[1] in self.places):
            self.one_set(words.pop(0))
        if not least <= len(words) <= 2 or words[0] not in self.places:
            raise self.error(f"{' '.join(words)!r}", "a column of COLUMNS with its bound")
        return words[0], (*words, "0")[1]

    def ends_of(self, kind: str, word: str) -> dict[str, float]:
        """Return the ends that a bound sets."""
        if kind == "BV":
            return {"lower": 0.0, "upper": 1.0}
        if not _SIDES[kind][1]:
            return {"lower": -math.inf, "upper": math.inf}
        value = self.value(word, infinite=True)
        if abs(value) >= _INFINITE:
            value = math.copysign(math.inf, value)
        wrong = {"LO": math.inf, "LI": math.inf, "UP": -math.inf, "UI": -math.inf}
        if wrong.get(kind) == value or (kind == "FX" and math.isinf(value)):
            raise self.error(f"the bound {word!r}", "a finite number")
        return {"lower": value, "upper": value}

    # ---- products ---------------------------------------------------------------------------

    def products_of(self, names: list[str]) -> None:
        """Read the row that a section of products is about."""
        row = self.rows.get(names[0]) if len(names) == 1 else None
        free = self.section == "QSECTION"
        if row is None or (row.name != self.objective if free else row.kind == "N"):
            found = f"{' '.join(names)!r} behind {self.section}"
            raise self.error(found, "the objective" if free else "a row that is not free")
        if self.about in self.halves:
            raise self.error(f"products of {self.about!r} again", "one section of them")

    def product(self, words: list[str]) -> None:
        """Read one product."""
        if len(words) != 3 or words[0] not in self.places or words[1] not in self.places:
            raise self.error(f"{' '.join(words)!r}", "two columns and a number")
        i, j = self.places[words[0]], self.places[words[1]]
        name = self.about if self.section == "QCMATRIX" else self.objective or ""
        half = self.halves.setdefault(name, {})
        pair = (i, j) if self.section in ("QMATRIX", "QCMATRIX") else (min(i, j), max(i, j))
        if pair in half:
            raise self.error(f"a second entry of {words[0]!r} and {words[1]!r}", "only one")
        half[pair] = self.value(words[2])

    def add_products(self) -> None:
        """Give rows their products."""
        for name, half in self.halves.items():
            squares = self.rows[name].squares
            whole = name != self.objective or "QMATRIX" in self.seen
            factor = 0.5 if name == self.objective else 1.0
            for (i, j), value in half.items():
                if whole and half.get((j, i)) != value:
                    found = f"an entry of {self.columns[i].name!r} and {self.columns[j].name!r}"
                    raise self.error(f"{found} of {name!r} without its mirror image", "both")
                if i <= j:
                    squares[i, j] = factor * value if i == j else 2 * factor * value

    # ---- the problem ------------------------------------------------------------------------

    def problem(self) -> Problem:
        """Make the problem."""
        if self.objective is None or not self.columns:
            raise self.error("no free row or no columns", "an objective and variables")
        if sum(name in self.seen for name in ("QUADOBJ", "QMATRIX", "QSECTION")) > 1:
            raise self.error("several sections with products of the objective", "one")
        self.add_products()
        low, high = zip(*(self.ends(column) for column in self.columns), strict=True)
        names = [column.name for column in self.columns]
        goal = self.rows[self.objective]
        objective = _polynomial(goal, names) - (goal.side or 0.0)
        return problem_with_integers(
            -objective if self.maximise else objective,
            list(self.constraints(names)),
            (low, high),
            names,
            [v for v, column in enumerate(self.columns) if column.integer],
            "max" if self.maximise else "min",
        )

    def ends(self, column: _Column) -> tuple[float, float]:
        """Return the bounds of a column."""
        low, high = column.ends()
        if column.lower is None and high < 0:
            raise self.error(
                f"the upper bound {high:g} of {column.name!r} and no lower one, which some readers "
                "take for 0 and others for none",
                "a lower one too, such as MI",
            )
        return low, high

    def constraints(self, names: list[str]) -> Iterator[Constraint]:
        for row in self.rows.values():
            if row.kind != "N":
                yield from between(_polynomial(row, names), *row.ends(), row.name)


def _polynomial(row: _Row, names: list[str]) -> Polynomial:
    words = [(0, v + 1) for v in row.linear] + [(i + 1, j + 1) for i, j in row.squares]
    values = [*row.linear.values(), *row.squares.values()]
    array = np.array(words, np.int32).reshape(-1, 2)
    return Polynomial.from_words(array, np.array(values, float), len(names), names)


_READERS: dict[str, Callable[[_File, list[str]], None]] = {
    "OBJSENSE": _File.sense,
    "ROWS": _File.row,
    "COLUMNS": _File.column,
    "RHS": _File.vector,
    "RANGES": _File.vector,
    "BOUNDS": _File.bound,
    **dict.fromkeys(("QUADOBJ", "QMATRIX", "QSECTION", "QCMATRIX"), _File.product),
}
