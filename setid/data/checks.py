"""Validation shared by the front half: arrays and numbers become what is stored, or raise."""

from __future__ import annotations

import numbers
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from math import isfinite, nan
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from setid.errors import DataError, ModelError, SetidError
from sparsepop_py.algebra.exact_terms import require_doubles
from sparsepop_py.budget import LimitReached
from sparsepop_py.errors import CONVERTED, FormatError, shown
from sparsepop_py.files import as_path

__all__ = [
    "MOST_TERMS",
    "FrozenMapping",
    "asked",
    "channel_pair",
    "channels_of",
    "entries_of",
    "frozen",
    "is_double",
    "natural",
    "number",
    "parameters_of",
    "path_of",
    "range_of",
    "real_array",
    "seconds_of",
    "seed_of",
    "starts_of",
    "switch",
    "texts_of",
    "without_mask",
    "word",
]

K = TypeVar("K")
V = TypeVar("V")

MOST_TERMS = 100_000  # orders, channels and exponents of a structure


class FrozenMapping(Mapping[K, V]):
    """A read-only copy of a mapping, in its order; pickles, and compares like a dict.

    Parameters
    ----------
    items : mapping

    Examples
    --------
    >>> FrozenMapping({"a1": -0.5})
    {'a1': -0.5}
    """

    __slots__ = ("_items",)

    def __init__(self, items: Mapping[K, V]) -> None:
        self._items = dict(items)

    def __getitem__(self, key: K) -> V:
        return self._items[key]

    def __iter__(self) -> Iterator[K]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __reduce__(self) -> tuple[type[FrozenMapping[K, V]], tuple[dict[K, V]]]:
        return type(self), (self._items,)

    def __or__(self, other: Mapping[K, V]) -> dict[K, V]:
        return {**self._items, **other}

    def __hash__(self) -> int:
        return hash(frozenset(self._items.items()))

    def __repr__(self) -> str:
        return repr(self._items)


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """Make an array read-only and return it."""
    array.flags.writeable = False
    return array


def without_mask(given: Any) -> NDArray[Any]:
    """Copy an array, with NaN (among dates NaT) where elements of ``numpy.ma`` are masked."""
    parts = given if isinstance(given, (list, tuple)) else [given]
    if not any(isinstance(part, np.ma.MaskedArray) for part in parts):
        return np.array(given)
    found = np.ma.array(given)
    array, mask = np.ma.getdata(found), np.ma.getmaskarray(found)
    if array.dtype.kind in "biu":  # which have no NaN
        array = array.astype(object)
    return np.where(mask, np.array("NaT", array.dtype) if array.dtype.kind in "mM" else nan, array)


def real_array(given: Any, field: str, error: type[SetidError]) -> NDArray[np.float64]:
    """Copy as doubles; NaN is kept, masked is NaN, infinity and non-numbers raise.

    Parameters
    ----------
    given : array_like
    field : str
        What the message calls it.
    error : type
        The exception to raise.
    """
    try:
        array = without_mask(given)
        if np.iscomplexobj(array) or array.dtype.kind in "USmM":  # text, durations, dates
            raise TypeError
        if array.dtype.kind == "O" and any(isinstance(x, CONVERTED) for x in array.flat):
            raise TypeError
        values = np.array(array, float)
    except (TypeError, ValueError, OverflowError):
        raise error(
            f"{field}: found {type(given).__name__} {shown(given)}, expected real numbers"
        ) from None
    require_doubles(given, field, error)
    if np.any(np.isinf(values)):
        where = f" at {np.argwhere(np.isinf(values))[0].tolist()}" if values.ndim else ""
        raise error(f"{field}: found an infinite value{where}, expected finite numbers")
    return values


def switch(given: Any, field: str, error: type[SetidError]) -> bool:
    """Check True or False; words such as "no" raise."""
    if not isinstance(given, (bool, np.bool_)):
        raise error(f"{field}: found {shown(given)}, expected True or False")
    return bool(given)


def word(given: Any, field: str, words: Iterable[str], error: type[SetidError]) -> str:
    """Check one of some words; arrays and others that cannot be compared raise too."""
    known = list(words)
    if not isinstance(given, str) or given not in known:
        listed = " or ".join(map(repr, known)) if len(known) < 3 else f"one of {', '.join(known)}"
        raise error(f"{field}: found {shown(given)}, expected {listed}")
    return given


def entries_of(given: Any, field: str, what: str, error: type[SetidError]) -> list[Any]:
    """List the items of a list; what cannot be gone through raises."""
    try:
        return list(given)
    except TypeError:
        raise error(f"{field}: found {type(given).__name__}, expected {what}") from None


def texts_of(given: Any, field: str, error: type[SetidError]) -> list[str]:
    """List texts; a text alone, whose letters would be taken for texts, raises."""
    if isinstance(given, (str, bytes)):
        raise error(f"{field}: found {shown(given)}, expected a list of texts")
    return [str(text) for text in entries_of(given, field, "a list of texts", error)]


def path_of(path: Any) -> Path:
    """Check the name of a file to be read."""
    try:
        return as_path(path)
    except FormatError as error:
        raise DataError(str(error)) from None


def channel_pair(output: Any, input: Any, outputs: int, inputs: int) -> tuple[int, int]:
    """Check the numbers of an output and of an input, from 1."""
    pair = natural(output, "output", ModelError, 1), natural(input, "input", ModelError, 1)
    if pair[0] > outputs or pair[1] > inputs:
        raise ModelError(
            f"output, input: found {output}, {input}, expected at most {outputs}, {inputs}, "
            "counted from 1"
        )
    return pair


def seed_of(given: Any) -> int | np.random.Generator:
    """Check a seed: an integer, at least 0, or a generator of numpy."""
    if isinstance(given, np.random.Generator):
        return given
    return natural(given, "seed", SetidError)


def natural(
    given: Any, field: str, error: type[SetidError], least: int = 0, most: int | None = None
) -> int:
    """Check an integer from ``least`` to ``most``; booleans and fractions raise."""
    whole = isinstance(given, numbers.Integral) and not isinstance(given, (bool, np.bool_))
    if not whole or int(given) < least:
        raise error(f"{field}: found {shown(given)}, expected an integer >= {least}")
    if most is not None and int(given) > most:
        raise error(f"{field}: found a number above {most}, expected at most that")
    return int(given)


def number(given: Any, field: str, error: type[SetidError]) -> float:
    """Check a real number that is not NaN; infinity is allowed."""
    real = isinstance(given, numbers.Real) and not isinstance(given, (bool, np.bool_))
    try:
        value = float(given) if real else np.nan
    except OverflowError:
        raise error(f"{field}: found a number beyond all doubles, expected a smaller one") from None
    if np.isnan(value):
        raise error(f"{field}: found {shown(given)}, expected a number")
    if isinstance(given, (numbers.Integral, np.longdouble)):  # fractions mean the double nearby
        require_doubles(given, field, error)
    return value


def asked(place: str, question: Callable[[], V], error: type[SetidError]) -> V:
    """Ask what comes from outside; name its place where it raises.

    Parameters
    ----------
    place : str
        Its name for messages.
    question : callable
    error : type of SetidError
        What an exception becomes. Those of this type and the end of the time pass.

    Examples
    --------
    >>> from setid.errors import ModelError
    >>> asked("Own.equations", lambda: (), ModelError)
    ()
    """
    try:
        return question()
    except (error, LimitReached):
        raise
    except Exception as cause:  # whatever was written outside
        raise error(f"{place}: raised {type(cause).__name__}: {cause}") from cause


def is_double(given: Any) -> bool:
    """Check for a finite number that a double can be."""
    if not isinstance(given, numbers.Real) or isinstance(given, bool):
        return False
    try:
        return isfinite(float(given)) and float(given) == given
    except OverflowError:
        return False


def seconds_of(time_limit: Any) -> float:
    """Check a time limit: seconds, at least 0."""
    value = number(time_limit, "time_limit", SetidError)
    if value < 0:
        raise SetidError(f"time_limit: found {time_limit!r}, expected seconds >= 0")
    return value


def parameters_of(theta: Any, names: Sequence[str]) -> NDArray[np.float64]:
    """Read parameters (p,) in order, from an array or a mapping; none may be missing."""
    if isinstance(theta, Mapping):
        if set(theta) != set(names):
            raise SetidError(f"theta: found names {sorted(theta)}, expected {sorted(names)}")
        theta = [theta[name] for name in names]
    values = real_array(theta, "theta", SetidError)
    if values.shape != (len(names),):
        raise SetidError(f"theta: found shape {values.shape}, expected {len(names)} numbers")
    if np.any(np.isnan(values)):
        raise SetidError(f"theta: found NaN for {names[int(np.isnan(values).argmax())]}")
    return values


def channels_of(given: ArrayLike, field: str) -> NDArray[np.float64]:
    """Check samples as rows and channels as columns, (N, channels), each with some number."""
    values = real_array(given, field, DataError)
    if values.ndim == 1:
        values = values[:, None]
    if values.ndim != 2 or 0 in values.shape:
        raise DataError(f"{field}: found shape {values.shape}, expected (N,) or (N, channels)")
    empty = np.flatnonzero(np.all(np.isnan(values), axis=0))
    if empty.size:
        raise DataError(f"{field}: found no number in channel {empty[0] + 1}, expected some")
    return frozen(values)


def _array_of(given: Any, field: str) -> NDArray[Any]:
    """Copy as an array; lists of unequal lengths raise."""
    try:
        return np.array(given)
    except (TypeError, ValueError):
        raise DataError(f"{field}: found {shown(given)}, expected a list of numbers") from None


def starts_of(given: Sequence[int] | NDArray[np.int64] | None, samples: int) -> NDArray[np.int64]:
    """Check the row numbers at which records begin."""
    values = np.zeros(1, np.int64) if given is None else _array_of(given, "starts")
    whole = values.ndim == 1 and values.size > 0 and np.issubdtype(values.dtype, np.integer)
    if not whole or values[0] != 0 or np.any(np.diff(values) <= 0) or values[-1] >= samples:
        raise DataError(
            f"starts: found {shown(values.tolist())}, expected 0 and then increasing row numbers "
            f"below {samples}"
        )
    return frozen(values.astype(np.int64))


def range_of(given: ArrayLike | None, field: str, channels: int) -> NDArray[np.float64] | None:
    """Check a range for each channel, (channels, 2)."""
    if given is None:
        return None
    values = real_array(given, field, DataError)
    if values.shape not in ((2,), (channels, 2)) or not np.all(values[..., 0] <= values[..., 1]):
        raise DataError(f"{field}: found {values.tolist()}, expected (low, high), low <= high")
    return frozen(np.broadcast_to(values, (channels, 2)).copy())
