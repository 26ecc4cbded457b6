"""Types of the fields of stored proofs: one gate for files and for objects in memory.

A proof is what its class states: arrays of doubles, whole numbers of Python. In short integers a
sign or a sum wraps, so that numbers that pass each comparison prove what is false.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import is_dataclass
from functools import cache
from sys import float_info
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

import sparsepop_py as sp
from setid.errors import SetidError
from sparsepop_py.verified.arithmetic.interval import require_ieee

__all__ = ["check_fields", "fits", "well_formed"]

_ROOM = re.compile(r"(\w+\.)+")  # in names of types
_PROOFS = ("setid.proofs.", "setid.neural.", "sparsepop_py.verified.")  # what is looked into
_GIVEN = ("setid.neural.models.",)  # parts of the question, which constructors check


def well_formed(proof: Any) -> bool:
    """Check a proof before its numbers are: the types of all fields, and how doubles are rounded.

    Parameters
    ----------
    proof : dataclass or named tuple
        What it holds is looked into, but for certificates, which have a check of their own.

    Raises
    ------
    FloatingPointError
        Where the arithmetic of this process proves nothing.
    """
    require_ieee()
    waiting = [proof]
    while waiting:
        part = waiting.pop()
        kind: Any = type(part)
        if kind is tuple:
            waiting += part
        elif isinstance(part, Mapping):
            waiting += part.values()
        elif _is_proof(kind):
            if _wrong_field(part):
                return False
            waiting += [getattr(part, name) for name in _hints(kind)]
    return True


def _is_proof(kind: type) -> bool:
    room = kind.__module__
    return room.startswith(_PROOFS) and not room.startswith(_GIVEN) and kind is not sp.Certificate


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
    if name := _wrong_field(made):
        kind: Any = type(made)
        hint = _hints(kind)[name]
        stated = str(hint) if get_args(hint) else hint.__name__
        raise SetidError(
            f"{place}.{name}: found {getattr(made, name)!r:.60}, expected {_ROOM.sub('', stated)}"
        )


def _wrong_field(made: Any) -> str:
    """Name the first field of another type than its class states; empty where there is none."""
    kind: Any = type(made)
    pairs = _hints(kind).items()
    return next((name for name, hint in pairs if not fits(getattr(made, name), hint)), "")


@cache
def _hints(kind: type) -> dict[str, Any]:
    """List the types of fields; none of what is no record, such as members of enumerations."""
    record = is_dataclass(kind) or hasattr(kind, "_fields")
    return get_type_hints(kind) if record else {}


def fits(value: Any, hint: Any) -> bool:
    """Tell whether a value is of a type; of mappings and functions no more is asked."""
    kind, parts = get_origin(hint) or hint, get_args(hint)
    if kind in (Union, UnionType):
        return any(fits(value, part) for part in parts)
    if kind is Literal:
        return isinstance(value, str) and value in parts
    if kind is tuple:
        return type(value) is tuple and _items_fit(value, parts)
    if kind is np.ndarray:
        return type(value) is np.ndarray and value.dtype == get_args(parts[1])[0]
    if kind is float:
        return isinstance(value, float) or (type(value) is int and abs(value) <= float_info.max)
    if kind is int:
        return type(value) is int
    return kind is Any or (isinstance(value, kind) and (kind is bool or type(value) is not bool))


def _items_fit(values: tuple[Any, ...], hints: tuple[Any, ...]) -> bool:
    if hints[-1] is Ellipsis:
        if hints[0] in (int, float) and set(map(type, values)) <= {hints[0]}:
            return True
        hints = hints[:1] * len(values)
    return len(values) == len(hints) and all(map(fits, values, hints))
