"""Exceptions for wrong input; each message names the field, what was found, what was expected.

Mathematical outcomes (an empty feasible set, an unbounded interval) are statuses of
results, never exceptions.
"""

from __future__ import annotations

__all__ = [
    "DataError",
    "ModelError",
    "NoiseError",
    "PriorError",
    "SetidError",
    "SetidWarning",
]


class SetidError(ValueError):
    """Base of every exception that this package raises on purpose."""


class DataError(SetidError):
    """A record is malformed, or does not fit the model."""


class NoiseError(SetidError):
    """A noise bound or a noise constraint is malformed, or does not fit the data."""


class ModelError(SetidError):
    """A model structure is malformed, or cannot do what is asked of it."""


class PriorError(SetidError):
    """A prior names an unknown parameter, contradicts another, or cannot be stated."""


class SetidWarning(UserWarning):
    """Input that is legal but probably not what was meant."""
