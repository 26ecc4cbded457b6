"""Exceptions: wrong input and missing software.

Mathematical outcomes (infeasible, unbounded, nothing proved) are statuses of a
:class:`~sparsepop_py.result.Result`, never exceptions.
"""

from __future__ import annotations

import numbers
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "CONVERTED",
    "ClaimError",
    "DenominatorError",
    "FormatError",
    "OutputError",
    "ParameterWarning",
    "ProblemError",
    "SolverNotFound",
    "SparsePOPError",
    "check_choice",
    "check_kind",
    "check_number",
    "check_switch",
    "check_whole",
    "check_writable",
    "doubles",
    "entries_of",
    "shown",
]

CONVERTED = (str, bytes, np.datetime64, np.timedelta64)  # of which numpy makes numbers


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
    try:
        good = not target.is_dir() and target.parent.is_dir()
    except (OSError, ValueError):  # too long, or with letters that no name has
        good = False
    if not good:
        raise ProblemError(f"{field}: found {path!r}, expected a file in a directory that exists")


def check_kind(given: Any, kinds: type | tuple[type, ...], field: str) -> None:
    """Check that an argument is an instance of a class.

    Raises
    ------
    ProblemError
        If it is not; the message names the field, what was found and the classes.
    """
    if not isinstance(given, kinds):
        names = " or ".join(kind.__name__ for kind in np.atleast_1d(np.array(kinds, object)))
        raise ProblemError(f"{field}: found {type(given).__name__}, expected a {names}")


def check_switch(given: Any, field: str) -> None:
    """Check that an argument is True or False.

    Raises
    ------
    ProblemError
    """
    if not isinstance(given, (bool, np.bool_)):
        raise ProblemError(f"{field}: found {shown(given)}, expected True or False")


def check_whole(given: Any, field: str, least: int, most: int | None = None) -> int:
    """Return an argument as an integer in a range; booleans and fractions are refused.

    Raises
    ------
    ProblemError
    """
    whole = isinstance(given, numbers.Integral) and not isinstance(given, bool)
    if not whole or int(given) < least or (most is not None and int(given) > most):
        wanted = f", at least {least}" if most is None else f" from {least} to {most}"
        raise ProblemError(f"{field}: found {shown(given)}, expected an integer{wanted}")
    return int(given)


def check_number(given: Any, field: str, least: float = -np.inf) -> float:
    """Return an argument as a double, at least a number; booleans and NaN are refused.

    Raises
    ------
    ProblemError
    """
    real = isinstance(given, numbers.Real) and not isinstance(given, bool)
    try:
        value = float(given) if real else np.nan
    except OverflowError:
        value = np.nan
    if not value >= least:
        bound = "" if least == -np.inf else f" >= {least:g}"
        raise ProblemError(f"{field}: found {shown(given)}, expected a number{bound}")
    return value


def check_choice(given: Any, field: str, choices: Collection[str]) -> None:
    """Check that an argument is one of some words.

    Raises
    ------
    ProblemError
    """
    if not isinstance(given, str) or given not in choices:
        listed = " or ".join(map(repr, choices))
        raise ProblemError(f"{field}: found {shown(given)}, expected {listed}")


def shown(given: Any) -> str:
    """Return the beginning of what Python prints of a value, for messages."""
    try:
        return f"{given!r:.60}"
    except Exception:  # beyond Python's limit of digits, or lists in lists without end
        if isinstance(given, numbers.Integral):
            return "an integer of thousands of digits"
        return f"{type(given).__name__} that cannot be printed"


def entries_of(given: Any, field: str, expected: str) -> list[Any]:
    """Return the entries of a list or of another iterable that is no text.

    Raises
    ------
    ProblemError
        If it has none; ``expected`` goes into the message.
    """
    try:
        entries = None if isinstance(given, (str, bytes)) else iter(given)
    except TypeError:  # an array without axes has no entries either
        entries = None
    if entries is None:
        raise ProblemError(f"{field}: found {type(given).__name__}, expected {expected}")
    return list(entries)


def refuse_masked(given: Any, field: str) -> None:
    """Refuse arrays of ``numpy.ma`` in which elements are masked: they have no value.

    Raises
    ------
    ProblemError
    """
    if np.ma.is_masked(given):
        raise ProblemError(f"{field}: found masked elements, expected a number in each place")


def doubles(given: ArrayLike, field: str) -> NDArray[np.float64]:
    """Return numbers as an array of doubles.

    Raises
    ------
    ProblemError
        If they are no numbers, masked, or larger than all doubles.
    """
    refuse_masked(given, field)
    try:
        array = np.asarray(given)
        if array.dtype.kind in "cUSmM" or (  # whose imaginary parts, texts or dates numpy converts
            array.dtype.kind == "O" and any(isinstance(item, CONVERTED) for item in array.flat)
        ):
            raise TypeError
        return np.asarray(array, float)
    except (TypeError, ValueError):
        raise ProblemError(f"{field}: found {shown(given)}, expected numbers") from None
    except OverflowError:
        raise ProblemError(
            f"{field}: found a number beyond all doubles, expected smaller ones, inf or -inf"
        ) from None
