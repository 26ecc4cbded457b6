"""Checks of single values of SparsePOP's ``param``."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable, Mapping
from typing import Any, NoReturn

from sparsepop_py.errors import ProblemError

__all__ = ["CHECKS", "check_error_bounds", "check_level", "check_one_of", "check_order", "wrong"]

_LEAST = 0.9e-10  # smaller tolerances and perturbations are errors in the original too


def wrong(name: str, found: Any, expected: str) -> NoReturn:
    """Raise the error for a value."""
    raise ProblemError(f"param.{name}: found {found!r}, expected {expected}")


def check_one_of(name: str, value: Any, legal: tuple[Any, ...]) -> Any:
    """A switch."""
    if isinstance(value, (list, str)) or value not in legal:
        wrong(name, value, "one of " + ", ".join(map(str, legal)))
    return value


def check_order(value: Any) -> float:
    """The relaxation order, an integer where it is whole."""
    number = _number("relaxOrder", value, "a number >= 0")
    if number < 0:
        wrong("relaxOrder", value, "a number >= 0")
    return max(1, int(number)) if number.is_integer() else number


def check_level(value: Any) -> tuple[int, int]:
    """Print levels of screen and file."""
    expected = "0, 1 or 2, or two of these (screen, file)"
    pair = list(value) if isinstance(value, (list, tuple)) else [value, 0]
    if len(pair) > 2 or any(not isinstance(v, numbers.Real) or v not in (0, 1, 2) for v in pair):
        wrong("printLevel", value, expected)
    return int(pair[0]), int(pair[1]) if len(pair) == 2 else 0


def _number(name: str, value: Any, expected: str) -> float:
    if not isinstance(value, numbers.Real) or not math.isfinite(value):
        wrong(name, value, expected)
    return float(value)


def _small(name: str, value: Any) -> float:
    """0, or a size that is large enough to be meant."""
    number = abs(_number(name, value, "0 or a number of at least 1e-10"))
    if 0 < number < _LEAST or (name == "eqTolerance" and value < 0):
        wrong(name, value, "0 or a number of at least 1e-10")
    return number


def _factor(name: str, value: Any) -> float:
    """How far cliques may grow; any text stands for without limit."""
    if isinstance(value, str):
        return math.inf
    if value == math.inf:
        return math.inf
    number = _number(name, value, "a number from 0 to dimVar, or a string")
    if number < 0:
        wrong(name, value, "a number from 0 to dimVar, or a string")
    return number


def _positive(name: str, value: Any) -> float:
    number = _number(name, value, "a number > 0")
    if number <= 0:
        wrong(name, value, "a number > 0")
    return number


def _count(name: str, value: Any) -> int:
    number = _number(name, value, "a positive integer")
    if number < 1 or not number.is_integer():
        wrong(name, value, "a positive integer")
    return int(number)


def _log(name: str, value: Any) -> Any:
    if isinstance(value, str) and value:
        return value
    if isinstance(value, (str, list)) or value not in (0, 1):
        wrong(name, value, "0, 1 or the name of a file")
    return int(value)


def _file(name: str, value: Any) -> str:
    if not isinstance(value, str):
        wrong(name, value, "the name of a file")
    return value


def _sdpa(name: str, value: Any) -> str:
    if not isinstance(value, str) or (value and not value.endswith(".dat-s")):
        wrong(name, value, "the name of a file that ends in .dat-s")
    return value


def _upper(name: str, value: Any) -> Any:
    return value if value == "" else _number(name, value, "a number")


def _indices(name: str, value: Any) -> Any:
    """'', 'a', indices from 1, or a list of these."""
    expected = "'a', indices of variables from 1, or a list of these"
    if isinstance(value, str):
        if value not in ("", "a"):
            wrong(name, value, expected)
        return value
    items = value if isinstance(value, (list, tuple)) else [value]
    for item in items:
        if isinstance(item, (list, tuple)) or item == "a":
            _indices(name, list(item) if isinstance(item, tuple) else item)
        elif not isinstance(item, numbers.Real) or item < 1 or item % 1 != 0:
            wrong(name, value, expected)
    return value


CHECKS: dict[str, Callable[[str, Any], Any]] = {
    "multiCliquesFactor": _factor,
    "eqTolerance": _small,
    "perturbation": _small,
    "SDPsolverEpsilon": _positive,
    "SDPsolverMaxIter": _count,
    "SDPsolverOutFile": _log,
    "printFileName": _log,
    "sdpaDataFile": _sdpa,
    "detailedInfFile": _file,
    "errorBdIdx": _indices,
    "fValueUbd": _upper,
}


def check_error_bounds(values: Mapping[str, Any]) -> None:
    """An upper bound of the objective belongs to error bounds."""
    asked = values.get("errorBdIdx", "")
    if values.get("fValueUbd", "") != "" and isinstance(asked, str) and not asked:
        wrong("fValueUbd", values["fValueUbd"], "nothing, since errorBdIdx is empty")
