"""Exceptions: wrong input and missing software.

Mathematical outcomes (infeasible, unbounded, nothing proved) are statuses of a
:class:`~sparsepop_py.result.Result`, never exceptions.
"""

from __future__ import annotations

__all__ = [
    "FormatError",
    "ParameterWarning",
    "ProblemError",
    "SolverNotFound",
    "SparsePOPError",
]


class SparsePOPError(Exception):
    """Base of every exception that this package raises on purpose."""


class ProblemError(SparsePOPError, ValueError):
    """A problem, polynomial, struct or option is malformed.

    The message names the field, what was found and what was expected.
    """


class FormatError(SparsePOPError, ValueError):
    """A file or a text cannot be read.

    The message names file, line, statement and what was expected.
    """


class SolverNotFound(SparsePOPError, ImportError):
    """A solver or an optional package is missing; the message says what to install."""


class ParameterWarning(UserWarning):
    """A parameter of the original SparsePOP is unknown here or has no effect."""
