"""Bounds and rows of a prior, checked where they come in, since anyone may write priors.

All of :mod:`setid` asks a prior through the functions of this module. A prior that raises
something else than a :class:`~setid.errors.PriorError`, or states what means nothing, ends in one
that names it. The priors of this package need no check.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

import numpy as np

import sparsepop_py as sp
from setid.data.checks import asked, is_double
from setid.errors import PriorError
from setid.models.equations import Structure
from setid.priors.base import Facts, Interval, Prior, Symbols

__all__ = [
    "admits_box",
    "bounds_of",
    "completion_of",
    "description_of",
    "rows_of_prior",
    "stable_of",
    "unknowns_of",
]

T = TypeVar("T")
_OWN = "setid.priors."  # where priors are that need no check


def description_of(prior: Prior) -> str:
    """Ask a prior for its description.

    Raises
    ------
    PriorError
        If the prior raises, or it is no text.
    """
    if not _plugged(prior, "describe"):
        return prior.describe()
    text: Any = _asked(prior, "describe", prior.describe)
    return str(text) if isinstance(text, str) else _refuse(prior, "describe", text, "a text")


def bounds_of(prior: Prior, model: Structure) -> Mapping[str, Interval]:
    """Ask a prior for bounds of parameters.

    Raises
    ------
    PriorError
        If the prior raises, or states no intervals of parameters.
    """
    if not _plugged(prior, "bounds"):
        return prior.bounds(model)
    found = _asked(prior, "bounds", lambda: prior.bounds(model))
    return _intervals(prior, "bounds", found)


def unknowns_of(prior: Prior, model: Structure) -> Mapping[str, Interval]:
    """Ask a prior for unknowns of its own and their boxes.

    Raises
    ------
    PriorError
        If the prior raises, or states no intervals.
    """
    if not _plugged(prior, "unknowns"):
        return prior.unknowns(model)
    found = _asked(prior, "unknowns", lambda: prior.unknowns(model))
    return _intervals(prior, "unknowns", found)


def stable_of(prior: Prior, model: Structure) -> frozenset[tuple[str, ...]]:
    """Ask a prior for the denominators that it makes stable.

    Raises
    ------
    PriorError
        If the prior raises, or names something else than parameters.
    """
    if not _plugged(prior, "stable"):
        return prior.stable(model)
    found: Any = _asked(prior, "stable", lambda: prior.stable(model))
    good = isinstance(found, (set, frozenset)) and all(
        isinstance(names, tuple) and all(name in model.parameters for name in names)
        for names in found
    )
    if not good:
        _refuse(prior, "stable", found, "a set of tuples of parameters")
    return frozenset(found)


def rows_of_prior(
    prior: Prior, model: Structure, symbols: Symbols, facts: Facts
) -> list[sp.Constraint]:
    """Ask a prior for its rows.

    Raises
    ------
    PriorError
        If the prior raises, or states something else than constraints in its symbols.
    """
    if not _plugged(prior, "rows"):
        return list(prior.rows(model, symbols, facts))
    given: Any = _asked(prior, "rows", lambda: prior.rows(model, symbols, facts))
    if not isinstance(given, Iterable) or isinstance(given, str):
        _refuse(prior, "rows", given, "a list of constraints")
    found = _asked(prior, "rows", lambda: list(given))  # a generator raises here
    dimension = next(iter(symbols.values())).dimension
    for row in found:
        if not isinstance(row, sp.Constraint) or row.kind.is_matrix:
            _refuse(prior, "rows", row, "polynomial inequalities and equations")
        if row.polynomial.dimension != dimension:
            raise PriorError(
                f"{type(prior).__name__}.rows: found a constraint in {row.polynomial.dimension} "
                f"variables, expected the {dimension} that it is given"
            )
    return found


def completion_of(prior: Prior, model: Structure, theta: Mapping[str, float]) -> dict[str, float]:
    """Ask a prior for values of its own unknowns.

    Raises
    ------
    PriorError
        If the prior raises, or states something else than numbers for its unknowns.
    """
    if not _plugged(prior, "complete"):
        return dict(prior.complete(model, theta))
    found: Any = _asked(prior, "complete", lambda: prior.complete(model, theta))
    if not isinstance(found, Mapping) or not all(map(is_double, found.values())):
        _refuse(prior, "complete", found, "a mapping of names to finite doubles")
    if not set(found) <= set(unknowns_of(prior, model)):
        _refuse(prior, "complete", found, "values of its own unknowns alone")
    return {name: float(value) for name, value in found.items()}


def admits_box(prior: Prior, model: Structure, box: Mapping[str, Interval]) -> bool:
    """Ask a prior whether its rows say all that it means of a box; true where it has no answer.

    Raises
    ------
    PriorError
        If the prior raises, or answers neither True nor False.
    """
    admits: Any = getattr(prior, "admits", None)
    if admits is None:
        return True
    if not _plugged(prior, "admits"):
        return bool(admits(model, box))
    found: Any = _asked(prior, "admits", lambda: admits(model, box))
    good = isinstance(found, (bool, np.bool_))
    return bool(found) if good else _refuse(prior, "admits", found, "True or False")


def _plugged(prior: Prior, name: str) -> bool:
    """Check that a method of a prior comes from outside."""
    owner = next((kind for kind in type(prior).__mro__ if name in vars(kind)), type(prior))
    return not owner.__module__.startswith(_OWN)


def _asked(prior: Prior, method: str, question: Callable[[], T]) -> T:
    """Ask a prior, and name it where it raises."""
    return asked(f"{type(prior).__name__}.{method}", question, PriorError)


def _refuse(prior: Prior, method: str, found: Any, expected: str) -> Any:
    kind = type(found).__name__
    raise PriorError(
        f"{type(prior).__name__}.{method}: found {kind} {found!r:.60}, expected {expected}"
    )


def _intervals(prior: Prior, method: str, found: Any) -> dict[str, Interval]:
    if not isinstance(found, Mapping):
        _refuse(prior, method, found, "a mapping of names to (low, high)")
    return {name: _ends(prior, method, name, ends) for name, ends in found.items()}


def _ends(prior: Prior, method: str, name: Any, given: Any) -> Interval:
    """Check both ends of an interval: doubles, or infinite outwards."""
    ends = given.tolist() if isinstance(given, np.ndarray) else given
    pair = isinstance(ends, (tuple, list)) and len(ends) == 2
    low, high = ends if pair else (float("nan"), float("nan"))
    ordered = (
        (is_double(low) or low == -float("inf"))
        and (is_double(high) or high == float("inf"))
        and low <= high
    )
    if not isinstance(name, str) or not name or not ordered:
        raise PriorError(
            f"{type(prior).__name__}.{method}: found {given!r:.60} for {name!r:.60}, expected a "
            "name and (low, high), doubles with low <= high or infinite ends"
        )
    return float(low), float(high)
