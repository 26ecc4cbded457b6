"""Pairs of functions that turn values into JSON and back, checking what they read.

Floats keep every bit: finite ones as the shortest decimal that reads back the same, others as
strings. Arrays carry their type and shape.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.errors import ProblemError

__all__ = [
    "Codec",
    "array",
    "array_of",
    "bound",
    "checked",
    "field_of",
    "finite",
    "flag",
    "mapping",
    "number",
    "number_of",
    "optional",
    "parsed",
    "rational",
    "reader_of",
    "record",
    "sequence",
    "tagged",
    "text",
    "whole",
]

_TYPES = {"f8": np.float64, "f4": np.float32, "i8": np.int64, "i4": np.int32, "b1": np.bool_}
_NAMES = {np.dtype(kind): name for name, kind in _TYPES.items()}
_LONGEST = 10**7
_RATIONAL = re.compile("-?[0-9]+(/0*[1-9][0-9]*)?")
_SPECIAL = {"inf": np.inf, "-inf": -np.inf, "nan": np.nan}


@dataclass(frozen=True)
class Codec:
    """Pair of functions that write and read values of one kind.

    ``read`` names the place of errors.
    """

    write: Callable[[Any], Any]
    read: Callable[[Any, str], Any]


def parsed(source: str) -> Any:
    """Parse JSON text, without names twice in one object and without NaN and Infinity.

    Raises
    ------
    ValueError
        If the text is no such JSON; the message says what was found and expected.
    """
    if not isinstance(source, str | bytes | bytearray):
        raise ValueError(f"found {type(source).__name__}, expected JSON text")
    try:
        return json.loads(source, object_pairs_hook=_distinct, parse_constant=_no_constant)
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        raise ValueError(f"found no JSON ({error.msg} at {place}), expected JSON text") from None
    except UnicodeDecodeError:
        raise ValueError("found bytes that are not UTF-8, expected JSON text") from None
    except RecursionError:
        raise ValueError("found objects or lists nested too deeply, expected JSON text") from None


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        name = next(name for k, (name, _) in enumerate(pairs) if name in dict(pairs[:k]))
        raise ValueError(f"found the name {name!r:.40} twice in one object, expected it once")
    return found


def _no_constant(name: str) -> Any:
    raise ValueError(f"found {name}, expected a number")


def wrong(place: str, found: Any, expected: str) -> ProblemError:
    """Build the error for a value at a place of a JSON text."""
    shown = repr(found)
    shown = shown if len(shown) < 60 else shown[:57] + "..."
    return ProblemError(f"{place}: found {shown}, expected {expected}")


def field_of(found: Any, name: str, place: str) -> Any:
    """Return a field of a JSON object."""
    fields = fields_of(found, place)
    if name not in fields:
        raise ProblemError(f"{place}.{name}: found nothing, expected a value")
    return fields[name]


def reader_of(found: Any, place: str) -> Callable[[str, Codec], Any]:
    """Make a function that reads a field of a JSON object by a codec."""
    return lambda name, codec: codec.read(field_of(found, name, place), f"{place}.{name}")


def fields_of(found: Any, place: str) -> dict[str, Any]:
    """Return the fields of a JSON object.

    Raises
    ------
    ProblemError
        If it is no object.
    """
    if not isinstance(found, dict):
        raise wrong(place, found, "an object")
    return found


def _write_number(value: Any) -> Any:
    value = float(value)
    return value if np.isfinite(value) else str(value)


def _read_number(found: Any, place: str) -> float:
    if isinstance(found, str) and found in _SPECIAL:
        return float(_SPECIAL[found])
    if isinstance(found, bool) or not isinstance(found, (int, float)):
        raise wrong(place, found, "a number")
    try:
        return float(found)
    except OverflowError:
        raise wrong(place, found, "a double") from None


def _read_whole(found: Any, place: str) -> int:
    if isinstance(found, bool) or not isinstance(found, int):
        raise wrong(place, found, "an integer")
    if not -(2**63) <= found < 2**63:
        raise wrong(place, found, "an integer of 64 bits")
    return found


def _read_text(found: Any, place: str) -> str:
    if not isinstance(found, str):
        raise wrong(place, found, "a string")
    return found


def _read_flag(found: Any, place: str) -> bool:
    if not isinstance(found, bool):
        raise wrong(place, found, "true or false")
    return found


def _read_rational(found: Any, place: str) -> Fraction:
    if not isinstance(found, str) or not _RATIONAL.fullmatch(found):
        raise wrong(place, found, "a rational number such as '-2/3'")
    try:
        return Fraction(found)
    except ValueError:  # Python's limit of digits
        raise wrong(place, found, "a rational number of fewer digits") from None


number = Codec(_write_number, _read_number)
whole = Codec(int, _read_whole)
text = Codec(str, _read_text)
flag = Codec(bool, _read_flag)
rational = Codec(str, _read_rational)


def _write_array(values: Any) -> Any:
    values = np.asarray(values)
    name = _NAMES[values.dtype] if values.dtype in _NAMES else "f8"
    flat = values.ravel().tolist()
    if values.dtype.kind == "f" and not np.all(np.isfinite(values)):
        flat = [_write_number(v) for v in flat]
    return {"type": name, "shape": list(values.shape), "data": flat}


def _read_lengths(shape: Any, data: Any, place: str) -> tuple[int, ...]:
    """Read the shape of an array, which has to fit its data."""
    lengths: tuple[int, ...] = sequence(whole).read(shape, f"{place}.shape")
    if not isinstance(data, list):
        raise wrong(f"{place}.data", data, "a list of numbers")
    if any(not 0 <= length < _LONGEST for length in lengths):
        raise wrong(f"{place}.shape", shape, f"lengths from 0 to {_LONGEST - 1}")
    size = math.prod(lengths)
    if size != len(data):
        raise wrong(f"{place}.data", f"{len(data)} numbers", f"{size}, as the shape says")
    return lengths


def _read_array(found: Any, place: str) -> NDArray[Any]:
    name, shape, data = (field_of(found, key, place) for key in ("type", "shape", "data"))
    if not isinstance(name, str) or name not in _TYPES:
        raise wrong(f"{place}.type", name, "one of " + ", ".join(_TYPES))
    lengths = _read_lengths(shape, data, place)
    each = number if name[0] == "f" else whole if name[0] == "i" else flag
    if name[0] == "f" and not all(type(v) is float for v in data):
        data = [each.read(v, f"{place}.data") for v in data]
    elif name[0] != "f":
        data = [each.read(v, f"{place}.data") for v in data]
    try:
        wide = np.array(data, np.float64 if name[0] == "f" else None).reshape(lengths)
        with np.errstate(over="ignore"):
            values: NDArray[Any] = wide.astype(_TYPES[name])
    except (OverflowError, ValueError, TypeError):
        raise wrong(f"{place}.data", data, f"numbers of type {name}") from None
    if name == "f4" and not np.array_equal(values, wide, equal_nan=True):
        raise wrong(f"{place}.data", data, "numbers that 32 bits hold")
    limit = np.iinfo(np.int32)
    if name == "i4" and any(not limit.min <= v <= limit.max for v in data):
        raise wrong(f"{place}.data", data, "32-bit integers")
    values.flags.writeable = False
    return values


array = Codec(_write_array, _read_array)


def array_of(kind: str, *ranks: int) -> Codec:
    """Build the codec of arrays of one kind with one of these numbers of axes.

    Kinds are "i" whole numbers, "b" flags, "f" finite doubles and "F" doubles that may be infinite.
    """

    def read(found: Any, place: str) -> NDArray[Any]:
        values = _read_array(found, place)
        if values.dtype.kind != kind.lower() or values.ndim not in ranks:
            axes = " or ".join(map(str, ranks))
            shown = f"type {found['type']} and shape {found['shape']}"
            raise wrong(place, shown, f"{_CALLED[kind]} with {axes} axes")
        bad = {"f": ~np.isfinite(values), "F": np.isnan(values)}.get(kind, np.zeros(0, bool))
        if bad.any():
            raise wrong(f"{place}.data", float(values[bad][0]), _CALLED[kind])
        return values

    return Codec(_write_array, read)


def number_of(expected: str, fits: Callable[[float], bool]) -> Codec:
    """Build the codec of doubles that have to satisfy a condition."""

    def read(found: Any, place: str) -> float:
        value = _read_number(found, place)
        if not fits(value):
            raise wrong(place, found, expected)
        return value

    return Codec(_write_number, read)


_CALLED = {"i": "whole numbers", "b": "flags", "f": "finite numbers", "F": "numbers"}
finite = number_of("a finite number", math.isfinite)
bound = number_of("a number", lambda value: not math.isnan(value))


def checked(codec: Codec, check: Callable[[Any, str], None]) -> Codec:
    """Add a check that gets what was read and its place, and raises."""

    def read(found: Any, place: str) -> Any:
        value = codec.read(found, place)
        check(value, place)
        return value

    return Codec(codec.write, read)


def optional(codec: Codec) -> Codec:
    """Make a codec that writes None as null."""
    return Codec(
        lambda value: None if value is None else codec.write(value),
        lambda found, place: None if found is None else codec.read(found, place),
    )


def sequence(codec: Codec) -> Codec:
    """Build the codec of a tuple of values of one kind."""

    def read(found: Any, place: str) -> tuple[Any, ...]:
        if not isinstance(found, list):
            raise wrong(place, found, "a list")
        return tuple(codec.read(item, f"{place}[{k}]") for k, item in enumerate(found))

    return Codec(lambda values: [codec.write(value) for value in values], read)


def mapping(codec: Codec) -> Codec:
    """Build the codec of a dict with names as keys."""

    def read(found: Any, place: str) -> dict[str, Any]:
        fields = fields_of(found, place)
        return {key: codec.read(value, f"{place}.{key}") for key, value in fields.items()}

    return Codec(lambda values: {k: codec.write(v) for k, v in values.items()}, read)


def record(make: Callable[..., Any], /, **fields: Codec) -> Codec:
    """Build the codec of an object, fields in the order of the maker's arguments."""

    def write(value: Any) -> dict[str, Any]:
        return {name: codec.write(getattr(value, name)) for name, codec in fields.items()}

    def read(found: Any, place: str) -> Any:
        part = reader_of(found, place)
        return make(**{name: part(name, codec) for name, codec in fields.items()})

    return Codec(write, read)


def tagged(codecs: Mapping[type, Codec]) -> Codec:
    """Build the codec of several classes, tagged by the name of the class."""
    by_name = {kind.__name__: codec for kind, codec in codecs.items()}

    def read(found: Any, place: str) -> Any:
        name = field_of(found, "is", place)
        if not isinstance(name, str) or name not in by_name:
            raise wrong(f"{place}.is", name, "one of " + ", ".join(by_name))
        return by_name[name].read(found, place)

    return Codec(
        lambda value: {"is": type(value).__name__, **codecs[type(value)].write(value)}, read
    )
