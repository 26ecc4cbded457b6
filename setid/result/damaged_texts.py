"""Damaged texts: parts of another type are refused, and what else they end in."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from enum import Enum
from typing import Any, TypeVar

import numpy as np

from setid.errors import SetidError
from setid.proofs.evidence import DAMAGE
from setid.proofs.fields import fits

__all__ = [
    "list_of",
    "member_of",
    "object_of",
    "refused",
    "table_of",
    "texts_of",
]

K = TypeVar("K", bound=Enum)


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
        if not fits(value, kind):
            raise SetidError(f"{place}.{key}: found {value!r:.60}, expected a {kind.__name__}")
    return {key: kind(value) for key, value in found.items()}


def member_of(kind: type[K], found: Any, place: str) -> K:
    """Choose a member of an enumeration by its name."""
    names = list(kind.__members__)
    if not isinstance(found, str) or found not in names:
        raise SetidError(f"{place}: found {found!r:.60}, expected one of {', '.join(names)}")
    return kind[found]
