"""Damaged texts and objects: fields of another type are refused, and what else they end in."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from enum import Enum
from functools import cache
from sys import float_info
from types import UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from setid.errors import SetidError
from setid.proofs.evidence import DAMAGE

__all__ = [
    "check_fields",
    "list_of",
    "member_of",
    "object_of",
    "refused",
    "table_of",
    "texts_of",
]

K = TypeVar("K", bound=Enum)

_ROOM = re.compile(r"(\w+\.)+")  # in names of types


@contextmanager
def refused(place: str, expected: str) -> Iterator[None]:
    """Turn what damage raises in the body of a with statement into ``SetidError``.

    Numbers overflow there without a warning.

    Parameters
    ----------
    place : str
        What is read or verified, for the message.
    expected : str

    Raises
    ------
    SetidError

    Examples
    --------
    >>> with refused("box", "a stored box"):
    ...     [0.5][2]
    Traceback (most recent call last):
    ...
    setid.errors.SetidError: box: IndexError('list index out of range'), expected a stored box
    """
    try:
        with np.errstate(all="ignore"):
            yield
    except SetidError:
        raise
    except DAMAGE as error:
        raise SetidError(f"{place}: {error!r:.200}, expected {expected}") from error


def object_of(found: Any, place: str, keys: Iterable[str] = ()) -> dict[str, Any]:
    """Check an object of JSON that has some entries.

    Parameters
    ----------
    found : object
    place : str
        For the message.
    keys : iterable of str
        Entries that it needs; it may have others.

    Raises
    ------
    SetidError
        Naming the place or the entry.
    """
    if type(found) is not dict:
        raise SetidError(f"{place}: found {found!r:.60}, expected an object")
    for key in keys:
        if key not in found:
            raise SetidError(f"{place}.{key}: found nothing, expected an entry of that name")
    return found


def list_of(found: Any, place: str) -> list[Any]:
    """Check a list of JSON."""
    if type(found) is not list:
        raise SetidError(f"{place}: found {found!r:.60}, expected a list")
    return found


def texts_of(found: Any, place: str) -> tuple[str, ...]:
    """Check a list of texts."""
    if type(found) is not list or not all(type(text) is str for text in found):
        raise SetidError(f"{place}: found {found!r:.60}, expected a list of texts")
    return tuple(found)


def table_of(found: Any, place: str, kind: type[float] | type[bool]) -> dict[str, Any]:
    """Check an object of JSON whose values are numbers or booleans."""
    for key, value in object_of(found, place).items():
        if not _fits(value, kind):
            raise SetidError(f"{place}.{key}: found {value!r:.60}, expected a {kind.__name__}")
    return {key: kind(value) for key, value in found.items()}


def member_of(kind: type[K], found: Any, place: str) -> K:
    """Choose a member of an enumeration by its name."""
    names = list(kind.__members__)
    if not isinstance(found, str) or found not in names:
        raise SetidError(f"{place}: found {found!r:.60}, expected one of {', '.join(names)}")
    return kind[found]


def check_fields(made: Any, place: str) -> None:
    """Check that the fields of an object are of the types that its class states.

    Parameters
    ----------
    made : dataclass or named tuple
    place : str
        Where it stands, for the message.

    Raises
    ------
    SetidError
        Naming the field.
    """
    kind: Any = type(made)
    for name, hint in _hints(kind).items():
        if not _fits(getattr(made, name), hint):
            stated = str(hint) if get_args(hint) else hint.__name__
            raise SetidError(
                f"{place}.{name}: found {getattr(made, name)!r:.60}, "
                f"expected {_ROOM.sub('', stated)}"
            )


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _fits(value: Any, hint: Any) -> bool:
    """Tell whether a value is of a type; of mappings and functions no more is asked."""
    kind, parts = get_origin(hint) or hint, get_args(hint)
    if kind in (Union, UnionType):
        return any(_fits(value, part) for part in parts)
    if kind is Literal:
        return isinstance(value, str) and value in parts
    if kind is tuple:
        return type(value) is tuple and _items_fit(value, parts)
    if kind is np.ndarray:
        return isinstance(value, np.ndarray) and value.dtype == get_args(parts[1])[0]
    if kind is float:
        return type(value) is float or (type(value) is int and abs(value) <= float_info.max)
    return kind is Any or (isinstance(value, kind) and (kind is bool or type(value) is not bool))


def _items_fit(values: tuple[Any, ...], hints: tuple[Any, ...]) -> bool:
    if hints[-1] is Ellipsis:
        if hints[0] in (int, float) and set(map(type, values)) <= {hints[0]}:
            return True
        hints = hints[:1] * len(values)
    return len(values) == len(hints) and all(map(_fits, values, hints))
