"""Damaged texts and objects: fields of another type are refused, and what else they end in."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, wraps
from sys import float_info
from types import UnionType
from typing import Any, Literal, ParamSpec, Union, get_args, get_origin, get_type_hints

import numpy as np

import sparsepop_py as sp
from setid.errors import SetidError
from setid.proofs.evidence import Verification

__all__ = ["as_verdict", "check_fields", "refused"]

P = ParamSpec("P")

_ROOM = re.compile(r"(\w+\.)+")  # in names of types
_DAMAGE = (
    sp.SparsePOPError,
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    TypeError,
    ValueError,
    RecursionError,
)


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
    except _DAMAGE as error:
        raise SetidError(f"{place}: {error!r:.200}, expected {expected}") from error


def as_verdict(verify: Callable[P, Verification]) -> Callable[P, Verification]:
    """Make a check return a verdict, also where fields do not fit each other.

    Stored results come from anywhere: arrays of other shapes and missing parts are forgeries, for
    which False is an answer and an exception is none. Numbers overflow there without a warning.

    Examples
    --------
    >>> as_verdict(lambda pair: Verification(pair[2] == 1))((0, 1))
    Verification(ok=False, reason='the fields do not fit each other: tuple index out of range')
    """

    @wraps(verify)
    def checked(*args: P.args, **kwargs: P.kwargs) -> Verification:
        try:
            with np.errstate(all="ignore"):
                return verify(*args, **kwargs)
        except FloatingPointError:  # of a process whose arithmetic proves nothing
            raise
        except SetidError as error:
            return Verification(False, str(error))
        except _DAMAGE as error:
            return Verification(False, f"the fields do not fit each other: {error!s:.200}")

    return checked


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
