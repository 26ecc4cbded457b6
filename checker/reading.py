"""Read problems from JSON, strictly: whatever is not what the format page says is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction
from math import isfinite, isqrt
from pathlib import Path
from typing import Any

from .polynomial import INF, Polynomial, Word

VERSIONS = (2, 3)
KINDS = ("NONNEGATIVE", "ZERO", "SECOND_ORDER", "PSD")
TYPES = {"f8": float, "f4": float, "i8": int, "i4": int, "b1": bool}


class Malformed(Exception):
    """The input is no problem, certificate or result of this format."""


@dataclass
class Constraint:
    """p >= 0, p == 0, or p >= 0 and a matrix of polynomials that is positive semidefinite."""

    kind: str
    polynomial: Polynomial
    entries: list[Polynomial] = field(default_factory=list)

    @property
    def equality(self) -> bool:
        """Whether the polynomial has to be zero."""
        return self.kind == "ZERO"

    @property
    def side(self) -> int:
        """Rows of the matrix, 0 without one."""
        count = len(self.entries)
        return (isqrt(8 * count + 1) - 1) // 2 if self.kind == "PSD" else count

    def place(self, i: int, j: int) -> int:
        """Which entry stands in row i and column j, -1 for a zero."""
        i, j = max(i, j), min(i, j)
        if self.kind == "PSD":
            return i * (i + 1) // 2 + j
        return 0 if i == j else (i if j == 0 else -1)


@dataclass
class Problem:
    """Minimise the objective subject to constraints and bounds."""

    dimension: int
    objective: Polynomial
    constraints: list[Constraint]
    lower: list[Any]  # Fraction or -INF
    upper: list[Any]
    names: list[str]
    squares: list[tuple[Fraction, Polynomial]] = field(default_factory=list)
    sense: str = "min"

    def about(self, variable: int, side: int) -> Problem:
        """The problem with the objective side * x_variable over the same feasible set."""
        objective = Polynomial({(variable + 1,): side})
        given = self.constraints, self.lower, self.upper, self.names
        return Problem(self.dimension, objective, *given)

    def bits(self) -> int:
        """The least k such that all numbers of the problem are whole multiples of 2**-k."""
        rows = [self.objective, *(p for _, p in self.squares)]
        rows += [p for c in self.constraints for p in (c.polynomial, *c.entries)]
        ends = [end for end in (*self.lower, *self.upper) if end not in (INF, -INF)]
        exponents = [-p.exp for p in rows]
        return max([0, *exponents, *(end.denominator.bit_length() for end in ends)])


# ---- JSON ------------------------------------------------------------------------------------


def load(path: str | Path) -> Any:
    """A JSON text, without names twice in one object and without NaN and Infinity."""

    def distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        if len(found := dict(pairs)) < len(pairs):
            raise Malformed(f"{path}: a name stands twice in one object")
        return found

    def no_constant(text: str) -> Any:
        raise Malformed(f"{path}: {text} is no number of JSON")

    try:
        text = Path(path).read_text(encoding="utf-8")
        return json.loads(text, parse_constant=no_constant, object_pairs_hook=distinct)
    except (OSError, ValueError, RecursionError) as error:
        raise Malformed(f"{path}: {error}") from None


def content(found: Any, place: str) -> tuple[str, Any]:
    """The kind of a file and what it holds, if its format and version are known."""
    if item(found, "format", place) != "sparsepop-py":
        raise Malformed(f"{place}: its format is not 'sparsepop-py'")
    version = item(found, "version", place)
    if type(version) is not int or version not in VERSIONS:
        raise Malformed(f"{place}: version {version!r} is not one of {VERSIONS}")
    name = text(item(found, "is", place), f"{place}.is")
    return name, item(found, name, place)


def item(found: Any, name: str, place: str) -> Any:
    """A field of an object."""
    if not isinstance(found, dict) or name not in found:
        raise Malformed(f"{place}: there is no field {name!r}")
    return found[name]


def items(found: Any, place: str) -> list[Any]:
    """A list."""
    if not isinstance(found, list):
        raise Malformed(f"{place}: not a list")
    return found


def optional(found: Any, read: Callable[[Any, str], Any], place: str) -> Any:
    """None where null stands."""
    return None if found is None else read(found, place)


def text(found: Any, place: str) -> str:
    """A string."""
    if not isinstance(found, str):
        raise Malformed(f"{place}: not a string")
    return found


def flag(found: Any, place: str) -> bool:
    """True or false."""
    if not isinstance(found, bool):
        raise Malformed(f"{place}: not true or false")
    return found


def whole(found: Any, place: str) -> int:
    """A whole number."""
    if type(found) is not int or abs(found) >= 2**63:
        raise Malformed(f"{place}: not a whole number")
    return found


def number(found: Any, place: str) -> float:
    """A double, or one of the strings "inf" and "-inf"."""
    if isinstance(found, str) and found in ("inf", "-inf"):
        return INF if found == "inf" else -INF
    try:
        if type(found) in (int, float) and isfinite(value := float(found)):
            return value
    except OverflowError:
        pass
    raise Malformed(f"{place}: {found!r:.40} is not a number")


def finite(found: Any, place: str) -> float:
    """A double that is finite."""
    if not isfinite(value := number(found, place)):
        raise Malformed(f"{place}: not finite")
    return value


def array(found: Any, kinds: str, rank: int, place: str) -> list[Any]:
    """An array as nested lists; its type is one of 'f', 'i', 'b' and its rank is given."""
    name = text(item(found, "type", place), f"{place}.type")
    shape = [whole(n, f"{place}.shape") for n in items(item(found, "shape", place), place)]
    data = items(item(found, "data", place), f"{place}.data")
    if name not in TYPES or name[0] not in kinds or len(shape) != rank:
        raise Malformed(f"{place}: an array of type {name!r} and rank {len(shape)}")
    if name[0] == "f":
        data = [number(value, place) for value in data]
    elif any(type(value) is not TYPES[name] for value in data):
        raise Malformed(f"{place}: data of another type than {name!r}")
    size = 1
    for length in shape:
        size *= length
    if min(shape, default=0) < 0 or size != len(data):
        raise Malformed(f"{place}: {len(data)} numbers do not fit the shape {shape}")
    return nested(data, shape)


def nested(data: list[Any], shape: list[int]) -> list[Any]:
    """A flat list as lists of lists."""
    if len(shape) <= 1:
        return data
    size = len(data) // shape[0] if shape[0] else 0
    rows = [data[k * size : (k + 1) * size] for k in range(shape[0])]
    return [nested(row, shape[1:]) for row in rows]


def reals(found: Any, rank: int, place: str) -> list[Any]:
    """An array of finite doubles."""
    flat = array(found, "f", rank, place)
    if any(not isfinite(value) for value in item(found, "data", place) if type(value) is float):
        raise Malformed(f"{place}: not finite")
    if any(type(value) is str for value in item(found, "data", place)):
        raise Malformed(f"{place}: not finite")
    return flat


def indices(found: Any, stop: int, place: str, start: int = 0) -> list[int]:
    """A list of whole numbers from ``start`` to below ``stop``."""
    values = array(found, "i", 1, place)
    if any(not start <= value < stop for value in values):
        raise Malformed(f"{place}: a number outside {start}..{stop - 1}")
    return values


def word(letters: list[int], n: int, place: str) -> Word:
    """A monomial: the letters of a row without its zeros."""
    if any(type(v) is not int or not 0 <= v <= n for v in letters):
        raise Malformed(f"{place}: a variable outside 1..{n}")
    return tuple(sorted(letter for letter in letters if letter))


# ---- problems --------------------------------------------------------------------------------


def polynomial(found: Any, n: int | None, place: str) -> tuple[Polynomial, int]:
    """A polynomial and its number of variables, which has to be n."""
    dimension = whole(item(found, "dimension", place), f"{place}.dimension")
    if dimension < 1 or (n is not None and dimension != n):
        raise Malformed(f"{place}: {dimension} variables")
    rows = array(item(found, "words", place), "i", 2, f"{place}.words")
    values = reals(item(found, "coefficients", place), 1, f"{place}.coefficients")
    words = [word(row, dimension, place) for row in rows]
    if len(words) != len(values) or len(set(words)) < len(words):
        raise Malformed(f"{place}: words and coefficients do not belong together")
    return Polynomial.of(words, values), dimension


def constraint(found: Any, n: int, place: str) -> Constraint:
    """A constraint of a problem in n variables."""
    kind = text(item(found, "kind", place), f"{place}.kind")
    given = items(item(found, "entries", place), f"{place}.entries")
    entries = [polynomial(entry, n, f"{place}.entries[{k}]")[0] for k, entry in enumerate(given)]
    own = polynomial(item(found, "polynomial", place), n, f"{place}.polynomial")[0]
    made = Constraint(kind, own, entries)
    matrix = kind in ("SECOND_ORDER", "PSD")
    triangle = kind != "PSD" or len(entries) == made.side * (made.side + 1) // 2
    if kind not in KINDS or matrix != (made.side > 1) or not triangle:
        raise Malformed(f"{place}: kind {kind!r} with {len(entries)} entries")
    return made


def problem(found: Any, place: str = "problem") -> Problem:
    """A problem."""
    objective, n = polynomial(item(found, "objective", place), None, f"{place}.objective")
    rows = items(item(found, "constraints", place), f"{place}.constraints")
    ends = []
    for name in ("lower", "upper"):
        values = array(item(found, name, place), "f", 1, f"{place}.{name}")
        ends.append([v if v in (INF, -INF) else Fraction(v) for v in values])
    lower, upper = ends
    if len(lower) != n or len(upper) != n or INF in lower or -INF in upper:
        raise Malformed(f"{place}: bounds that do not fit {n} variables")
    if any(low > high for low, high in zip(lower, upper, strict=True)):
        raise Malformed(f"{place}: a lower bound above the upper one")
    squares = []
    for k, pair in enumerate(items(item(found, "squares", place), f"{place}.squares")):
        here = f"{place}.squares[{k}]"
        if len(items(pair, here)) != 2 or finite(pair[0], here) < 0:
            raise Malformed(f"{here}: not a weight >= 0 and a polynomial")
        squares.append((Fraction(finite(pair[0], here)), polynomial(pair[1], n, here)[0]))
    given = items(item(found, "names", place), f"{place}.names")
    names = [text(name, f"{place}.names") for name in given]
    if len(names) != n:
        raise Malformed(f"{place}: {len(names)} names for {n} variables")
    sense = text(item(found, "sense", place), f"{place}.sense")
    made = [constraint(row, n, f"{place}.constraints[{k}]") for k, row in enumerate(rows)]
    return Problem(n, objective, made, lower, upper, names, squares, sense)
