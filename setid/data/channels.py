"""Names and units of channels, for tables and axes: labels, on which no claim rests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from setid.errors import DataError

__all__ = ["labels", "names_of", "text_of", "units_of"]


def names_of(
    given: Sequence[Any] | str | None, count: int, field: str, letter: str
) -> tuple[str, ...]:
    """Check distinct names, one a channel; u1, ... or y1, ... when left out.

    Parameters
    ----------
    given : str, sequence of str or None
    count : int
        Number of channels.
    field : str
        What messages call it.
    letter : str
        Of the names that stand for none.

    Raises
    ------
    DataError
        If there are more or fewer, one occurs twice, or one is no text of Unicode.
    """
    if given is None:
        return tuple(f"{letter}{i + 1}" for i in range(count))
    names = _texts(given, count, field)
    if len(set(names)) != count or not all(names):
        raise DataError(f"{field}: found {list(names)}, expected {count} distinct names")
    return names


def units_of(given: Sequence[Any] | str | None, count: int, field: str) -> tuple[str, ...]:
    """Check units, one a channel; empty when left out.

    Parameters
    ----------
    given, count, field
        As of :func:`names_of`.

    Raises
    ------
    DataError
        If there are more or fewer, or one is no text of Unicode.
    """
    return ("",) * count if given is None else _texts(given, count, field)


def labels(names: tuple[str, ...], units: tuple[str, ...]) -> tuple[str, ...]:
    """Write names with their units in brackets.

    Parameters
    ----------
    names, units : tuple of str
    """
    pairs = zip(names, units, strict=True)
    return tuple(f"{name} [{unit}]" if unit else name for name, unit in pairs)


def text_of(given: Any, field: str) -> str:
    """Check a text that files and pictures can hold; halves of surrogate pairs raise.

    Parameters
    ----------
    given : object
    field : str
        What the message calls it.

    Raises
    ------
    DataError
        If it has no encoding.
    """
    text = str(given)
    try:
        text.encode()
    except UnicodeEncodeError:
        raise DataError(f"{field}: found {text!r:.60}, expected a text of Unicode") from None
    return text


def _texts(given: Sequence[Any] | str, count: int, field: str) -> tuple[str, ...]:
    try:
        found = (given,) if isinstance(given, str) else tuple(str(item).strip() for item in given)
    except TypeError:
        found = ()
    if len(found) != count:
        raise DataError(f"{field}: found {given!r:.60}, expected {count}, one a channel")
    return tuple(text_of(text, field) for text in found)
