"""Read problems from JSON, strictly: whatever is not what the format page says is refused."""

from __future__ import annotations

import json
from collections.abc import Callable, Sized
from dataclasses import dataclass, field
from fractions import Fraction
from math import isfinite, isqrt
from pathlib import Path
from struct import pack, unpack
from types import SimpleNamespace
from typing import Any

from ..arithmetic.polynomial import INF, Polynomial, Word

VERSIONS = {"sparsepop-py": (3, 4, 5, 6, 7), "setid": (1, 2, 3, 4, 5, 6, 7, 8, 9, 10)}
KINDS = ("NONNEGATIVE", "ZERO", "SECOND_ORDER", "PSD")


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
        """True if the polynomial has to be zero."""
        return self.kind == "ZERO"

    @property
    def side(self) -> int:
        """Rows of the matrix, 0 without one."""
        count = len(self.entries)
        return (isqrt(8 * count + 1) - 1) // 2 if self.kind == "PSD" else count

    def words(self) -> set[tuple[int, ...]]:
        """Collect the words of the polynomial and of all entries."""
        return {word for p in (self.polynomial, *self.entries) for word in p.terms}

    def place(self, i: int, j: int) -> int:
        """Find which entry stands in row i and column j, -1 for a zero."""
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

    def minimising(self, objective: Polynomial) -> Problem:
        """Replace the objective over the same feasible set."""
        given = self.constraints, self.lower, self.upper, self.names
        return Problem(self.dimension, objective, *given)

    def about(self, variable: int, side: int) -> Problem:
        """Replace the objective by side * x_variable over the same feasible set."""
        return self.minimising(Polynomial({(variable + 1,): side}))


# ---- JSON ------------------------------------------------------------------------------------


def load(path: str | Path) -> Any:
    """Load a JSON text; refuse names twice in one object, NaN and Infinity."""

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
    """Read the kind of a file and what it holds, of a known version."""
    name = text(item(found, "format", place), f"{place}.format")
    version = whole(item(found, "version", place), f"{place}.version")
    if version not in VERSIONS.get(name, ()):
        raise Malformed(f"{place}: format {name!r:.40} of version {version} is not known")
    whose, name = name, text(item(found, "is", place), f"{place}.is")
    if whose == "setid" and name != "identification":
        raise Malformed(
            f"{place} holds a {name!r:.40} of setid, as its to_json writes it; this program reads "
            "what setid identify --certificate writes"
        )
    if name.startswith("rational_") and version < 4:
        raise Malformed(f"{place}: {name!r:.40} in a file of version {version}")
    return name, item(found, name, place)


def item(found: Any, name: str, place: str) -> Any:
    """Take a field of an object."""
    if not isinstance(found, dict) or name not in found:
        raise Malformed(f"{place}: there is no field {name!r}")
    return found[name]


def finite(found: Any, place: str) -> float:
    """Check a double that is finite."""
    try:
        if type(found) in (int, float) and isfinite(value := float(found)):
            return value
    except OverflowError:
        pass
    raise Malformed(f"{place}: {found!r:.40} is not a finite number")


def number(found: Any, place: str) -> Any:
    """Read a double as a Fraction, or the strings "inf" and "-inf" as INF, -INF."""
    if found in ("inf", "-inf"):
        return INF if found == "inf" else -INF
    return Fraction(finite(found, place))


def unit(found: Any, place: str) -> Fraction:
    """Read a positive power of two."""
    value = exact(found, place)
    if value <= 0 or value.numerator & (value.numerator - 1):  # a double has such a denominator
        raise Malformed(f"{place}: not a power of two")
    return value


def times(value: Any, unit: Fraction) -> Any:
    """Convert an end from units to those of the record."""
    return value if value in (INF, -INF) else value * unit


def exact(found: Any, place: str) -> Fraction:
    """Read a finite double as a Fraction."""
    return Fraction(finite(found, place))


def rational(found: Any, place: str) -> Fraction:
    """Read a fraction from a text, such as "-3/7"."""
    try:
        above, _, below = text(found, place).partition("/")
        return Fraction(int(above), int(below or "1"))
    except (ValueError, ZeroDivisionError):
        raise Malformed(f"{place}: {found!r:.40} is no fraction") from None


def of_type(kind: type) -> Callable[[Any, str], Any]:
    """Check that a value is of exactly that type."""

    def read(found: Any, place: str) -> Any:
        if type(found) is not kind or (isinstance(found, str) and not found.isprintable()):
            raise Malformed(f"{place}: {found!r:.40} is no {kind.__name__}")
        return found

    return read


whole, flag, text, items = map(of_type, (int, bool, str, list))
READERS: dict[str, Callable[[Any, str], Any]]
READERS = {"f": finite, "F": number, "e": exact, "q": rational, "u": unit}
READERS |= {"i": whole, "b": flag, "t": text, "l": items}


def each(kind: Callable[..., Any]) -> Callable[..., list[Any]]:
    """Make a reader of lists from one of (found, n, place)."""

    def read(found: Any, n: int, place: str) -> list[Any]:
        return [kind(one, n, f"{place}[{k}]") for k, one in enumerate(items(found, place))]

    return read


def together(*kinds: Any) -> Callable[[Any, int, str], list[Any]]:
    """Make a reader of lists with one entry of each kind."""

    def read_(found: Any, n: int, place: str) -> list[Any]:
        if len(items(found, place)) != len(kinds):
            raise Malformed(f"{place}: {len(found)} entries, not {len(kinds)}")
        pairs = zip(found, kinds, strict=True)
        return [read(one, kind, f"{place}[{k}]", n) for k, (one, kind) in enumerate(pairs)]

    return read_


def perhaps(kind: Callable[..., Any]) -> Callable[..., Any]:
    """Make a reader that allows null from one of (found, n, place)."""
    return lambda found, n, place: None if found is None else kind(found, n, place)


def array(found: Any, kind: str, rank: int, place: str) -> list[Any]:
    """Read nested lists of finite (f) or any (F) doubles, integers (i), flags (b)."""
    name = text(item(found, "type", place), f"{place}.type")
    shape = [whole(n, f"{place}.shape") for n in items(item(found, "shape", place), place)]
    data = items(item(found, "data", place), f"{place}.data")
    size = 1
    for length in shape:
        size *= length
    fits = len(shape) == rank and 0 <= min(shape) <= max(shape) < 10**7 and size == len(data)
    if name not in ("f8", "f4", "i8", "i4", "b1") or name[0] != kind.lower() or not fits:
        raise Malformed(f"{place}: {len(data)} numbers as an array {name!r:.9} of shape {shape}")
    values = [READERS[kind](value, f"{place}.data") for value in data]
    if name == "f4" and not all(map(is_short, values)):
        raise Malformed(f"{place}.data: a number that 32 bits do not hold")
    return nested(values, shape)


def is_short(value: Any) -> bool:
    """Check that a number is one of 32 bits, or infinite."""
    try:
        return bool(unpack("<f", pack("<f", value))[0] == value)
    except OverflowError:
        return False


def nested(values: list[Any], shape: list[int]) -> list[Any]:
    """Convert a flat list to lists of lists."""
    if len(shape) == 1:
        return values
    size = len(values) // shape[0] if shape[0] else 0
    parts = (values[k * size : (k + 1) * size] for k in range(shape[0]))
    return [nested(part, shape[1:]) for part in parts]


def words(rows: list[list[int]], n: int, place: str) -> list[Word]:
    """Read rows of letters as words in n variables."""
    if any(not 0 <= letter <= n for row in rows for letter in row):
        raise Malformed(f"{place}: a variable outside 1..{n}")
    return [tuple(sorted(letter for letter in row if letter)) for row in rows]


def read(found: Any, kind: Any, place: str, n: int = 0) -> Any:
    """Read a value, by what it has to be.

    A kind is a letter of ``READERS``; with a digit an array of that rank; "w" and a digit an array
    of words in n variables; or a class or function of (found, n, place). Stars make lists of these
    within lists, and a last "?" allows null.
    """
    if not isinstance(kind, str):
        return kind(found, n, place)
    if kind.endswith("?"):
        return None if found is None else read(found, kind[:-1], place, n)
    if kind.endswith("*"):
        entries = enumerate(items(found, place))
        return [read(one, kind[:-1], f"{place}[{k}]", n) for k, one in entries]
    if kind == "w2":
        return words(array(found, "i", 2, place), n, place)
    if kind == "w3":
        return [words(rows, n, place) for rows in array(found, "i", 3, place)]
    return array(found, kind[0], int(kind[1]), place) if kind[1:] else READERS[kind](found, place)


def fields(found: Any, place: str, n: int, /, **kinds: Any) -> Any:
    """Read the fields of an object, by the kinds of ``read``."""
    got = SimpleNamespace(where=place)
    for name, kind in kinds.items():
        setattr(got, name, read(item(found, name, place), kind, f"{place}.{name}", n))
    return got


def kind_of(found: Any, kinds: dict[str, Any], place: str) -> Any:
    """Find which of several kinds an object is, by its name."""
    name = item(found, "is", place)
    if not isinstance(name, str) or name not in kinds:
        raise Malformed(f"{place}.is: {name!r:.40} is not one of {', '.join(kinds)}")
    return kinds[name]


def one_of(*kinds: type) -> Callable[[Any, int, str], Any]:
    """Make a reader of objects of one of several classes, by their names."""
    named = {kind.__name__: kind for kind in kinds}
    return lambda found, n, place: kind_of(found, named, place)(found, n, place)


def branch(found: Any, n: int, place: str) -> tuple[int, Fraction]:
    """Read the variable and the place of a split."""
    variable, at = together("i", "e")(found, n, place)
    below([variable], n, place)
    return variable, at


def alike(place: str, *lists: Sized) -> None:
    """Refuse lists of several lengths."""
    if len({len(values) for values in lists}) > 1:
        raise Malformed(f"{place}: its arrays do not belong together")


def below(values: list[int], stop: int, place: str) -> None:
    """Refuse numbers that are not in 0, ..., stop - 1."""
    if any(not 0 <= value < stop for value in values):
        raise Malformed(f"{place}: a number outside 0..{stop - 1}")


# ---- problems --------------------------------------------------------------------------------


def polynomial(found: Any, n: int, place: str) -> Polynomial:
    """Read a polynomial in n variables; its words have to be distinct."""
    got = fields(found, place, n, dimension="i", words="w2", coefficients="f1")
    alike(place, got.words, got.coefficients)
    if got.dimension != n or len(set(got.words)) < len(got.words):
        raise Malformed(f"{place}: {got.dimension} variables, or a word that stands twice")
    return Polynomial.of(got.words, got.coefficients)


def constraint(found: Any, n: int, place: str) -> Constraint:
    """Read a constraint of a problem in n variables."""
    got = fields(found, place, n, kind="t", polynomial=polynomial, entries=each(polynomial))
    made = Constraint(got.kind, got.polynomial, got.entries)
    matrix = made.kind in ("SECOND_ORDER", "PSD")
    triangle = made.kind != "PSD" or len(got.entries) == made.side * (made.side + 1) // 2
    sized = made.side > 1 if matrix else not got.entries
    if made.kind not in KINDS or not sized or not triangle:
        raise Malformed(f"{place}: kind {made.kind!r:.20} with {len(got.entries)} entries")
    return made


def weighted(found: Any, n: int, place: str) -> tuple[Fraction, Polynomial]:
    """Read a weight >= 0 and a polynomial."""
    weight, squared = together("e", polynomial)(found, n, place)
    if weight < 0:
        raise Malformed(f"{place}: a negative weight")
    return weight, squared


def problem(found: Any, place: str = "problem") -> Problem:
    """Read a problem."""
    n = whole(item(item(found, "objective", place), "dimension", place), place)
    kinds = {"lower": "F1", "upper": "F1", "names": "t*", "sense": "t", "objective": polynomial}
    got = fields(found, place, n, **kinds, constraints=each(constraint), squares=each(weighted))
    alike(place, got.lower, got.upper, got.names, range(n))
    for low, high in zip(got.lower, got.upper, strict=True):
        if not low <= high or low == INF or high == -INF:
            raise Malformed(f"{place}: bounds {low}, {high}")
    given = got.constraints, got.lower, got.upper, got.names, got.squares, got.sense
    return Problem(n, got.objective, *given)
