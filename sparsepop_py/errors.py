"""Exceptions: wrong input and missing software.

Mathematical outcomes (infeasible, unbounded, nothing proved) are statuses of a
:class:`~sparsepop_py.result.Result`, never exceptions.
"""

from __future__ import annotations

from pathlib import Path

__all__ = [
    "DenominatorError",
    "FormatError",
    "OutputError",
    "ParameterWarning",
    "ProblemError",
    "SolverNotFound",
    "SparsePOPError",
    "check_writable",
]


class SparsePOPError(Exception):
    """Base of every exception that this package raises on purpose."""


class ProblemError(SparsePOPError, ValueError):
    """A problem, polynomial, struct or option is malformed.

    The message names the field, what was found and what was expected.
    """


class DenominatorError(ProblemError):
    """The sign of a denominator is not proved where it has to be known.

    The message names the denominator and what is proved about it.
    """


class ClaimError(ProblemError):
    """A stored result claims more than its certificate or its point proves.

    The message names the claim and what is proved.
    """


class FormatError(SparsePOPError, ValueError):
    """A file or a text cannot be read.

    The message names file, line, statement and what was expected.
    """


class OutputError(SparsePOPError, OSError):
    """A file cannot be written; what was there before is unchanged."""


class SolverNotFound(SparsePOPError, ImportError):
    """A solver or an optional package is missing; the message says what to install."""


class ParameterWarning(UserWarning):
    """A parameter of the original SparsePOP is unknown here or has no effect."""


def check_writable(path: str, field: str) -> None:
    """Check that a file can be written, as far as that shows before the work.

    Parameters
    ----------
    path : str
    field : str
        Name of the field for the message.

    Raises
    ------
    ProblemError
        If the path is a directory, or its directory does not exist.
    """
    target = Path(path)
    if target.is_dir() or not target.parent.is_dir():
        raise ProblemError(f"{field}: found {path!r}, expected a file in a directory that exists")
