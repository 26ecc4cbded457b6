"""Exceptions for wrong input; each message names the field, what was found, what was expected.

Mathematical outcomes (an empty feasible set, an unbounded interval) are statuses of
results, never exceptions.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from contextvars import ContextVar
from functools import wraps
from typing import ParamSpec, TypeVar

__all__ = [
    "DataError",
    "EmptySetError",
    "ModelError",
    "NoiseError",
    "PriorError",
    "SetidError",
    "SetidWarning",
    "warn",
    "warns_once",
]


P = ParamSpec("P")
T = TypeVar("T")
_SAID: ContextVar[set[str] | None] = ContextVar("said", default=None)  # texts in a call


class SetidError(ValueError):
    """Base of every exception that this package raises on purpose."""


class DataError(SetidError):
    """A record is malformed, or does not fit the model."""


class NoiseError(SetidError):
    """A noise bound or a noise constraint is malformed, or does not fit the data."""


class ModelError(SetidError):
    """A model structure is malformed, or cannot do what is asked of it."""


class EmptySetError(SetidError):
    """A feasible set is proved empty where its result does not say so."""


class PriorError(SetidError):
    """A prior names an unknown parameter, contradicts another, or cannot be stated."""


class SetidWarning(UserWarning):
    """Input that is legal but probably not what was meant."""


def warn(text: str) -> None:
    """Warn at the line that called the caller, once in a call of :func:`warns_once`.

    Parameters
    ----------
    text : str
    """
    said = _SAID.get()
    if said is not None and text in said:
        return
    if said is not None:
        said.add(text)
    warnings.warn(text, SetidWarning, stacklevel=3)


def warns_once(function: Callable[P, T]) -> Callable[P, T]:
    """Decorate a function that states problems again and again: each warning comes once.

    Parameters
    ----------
    function : callable
    """

    @wraps(function)
    def once(*args: P.args, **kwargs: P.kwargs) -> T:
        if _SAID.get() is not None:  # called by another such function
            return function(*args, **kwargs)
        token = _SAID.set(set())
        try:
            return function(*args, **kwargs)
        finally:
            _SAID.reset(token)

    return once
