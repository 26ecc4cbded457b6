"""The interface of priors, and what those in :mod:`setid.priors` share."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import inf
from typing import Any, Protocol, runtime_checkable

import numpy as np

import sparsepop_py as sp
from setid.data.checks import FrozenMapping, entries_of, number
from setid.errors import PriorError
from setid.models.block import BlockStructured
from setid.models.checked_structures import coefficients_of
from setid.models.equations import Structure

__all__ = [
    "Facts",
    "Interval",
    "Plain",
    "Prior",
    "Symbols",
    "denominators",
    "finite",
    "interval_of",
    "items_of",
    "listed",
    "named",
    "stored",
]

Interval = tuple[float, float]
Symbols = Mapping[str, sp.Polynomial]


def listed(given: Any) -> list[Any]:
    """List one prior or several."""
    if isinstance(given, (Prior, sp.Constraint)):
        return [given]
    return entries_of(given, "priors", "a list of priors", PriorError)


@dataclass(frozen=True, slots=True)
class Facts:
    """Bounds of parameters and stable denominators that the other priors settle."""

    bounds: Mapping[str, Interval]
    stable: frozenset[tuple[str, ...]]

    def of(self, name: str) -> Interval:
        """Find the bounds of a parameter."""
        return self.bounds.get(name, (-inf, inf))


@runtime_checkable
class Prior(Protocol):
    """Bounds, unknowns and rows: the interface of all priors."""

    def describe(self) -> str:
        """Describe the prior in one line."""

    def bounds(self, model: Structure) -> Mapping[str, Interval]:
        """Bound single parameters."""

    def stable(self, model: Structure) -> frozenset[tuple[str, ...]]:
        """Name the denominators that this prior makes stable."""

    def unknowns(self, model: Structure) -> Mapping[str, Interval]:
        """Name further unknowns with their boxes."""

    def rows(self, model: Structure, x: Symbols, facts: Facts) -> list[sp.Constraint]:
        """State constraints in parameters and own unknowns."""

    def complete(self, model: Structure, theta: Mapping[str, float]) -> Mapping[str, float]:
        """Compute values of the own unknowns that go with theta."""


class Plain:
    """A prior without bounds, unknowns and rows, to be overridden."""

    __slots__ = ()

    def describe(self) -> str:
        """Write the call that makes it."""
        return repr(self)

    def bounds(self, model: Structure) -> Mapping[str, Interval]:
        """Bound no parameters."""
        return {}

    def stable(self, model: Structure) -> frozenset[tuple[str, ...]]:
        """Name no denominators."""
        return frozenset()

    def unknowns(self, model: Structure) -> Mapping[str, Interval]:
        """Add no unknowns."""
        return {}

    def rows(self, model: Structure, x: Symbols, facts: Facts) -> list[sp.Constraint]:
        """State no rows."""
        return []

    def complete(self, model: Structure, theta: Mapping[str, float]) -> Mapping[str, float]:
        """Complete nothing."""
        return {}

    def admits(self, model: Structure, box: Mapping[str, Interval]) -> bool:
        """Prove that rows say all that the prior means of a box: always true here."""
        return True


def named(rows: Iterable[sp.Constraint], label: str) -> list[sp.Constraint]:
    """Name the same rows for messages and files."""
    return [sp.Constraint(row.polynomial, row.kind, label) for row in rows]


def items_of(given: Any, field: str) -> list[tuple[str, Any]]:
    """Read pairs of a mapping from parameter names."""
    if not isinstance(given, Mapping) or not given:
        raise PriorError(
            f"{field}: found {given!r:.60}, expected a mapping of parameter names, "
            'such as {"a1": ...}'
        )
    return [(str(name), value) for name, value in given.items()]


def interval_of(given: Any, field: str) -> Interval:
    """Read both ends of an interval, None standing for no end."""
    try:
        low, high = given
    except (TypeError, ValueError):
        raise PriorError(f"{field}: found {given!r}, expected (low, high)") from None
    low = -inf if low is None else number(low, f"{field}: low", PriorError)
    high = inf if high is None else number(high, f"{field}: high", PriorError)
    if low > high or low == inf or high == -inf:
        raise PriorError(f"{field}: found [{low:g}, {high:g}], expected low <= high")
    return low, high


def finite(given: Any, field: str) -> float:
    """Check a finite number."""
    value = number(given, field, PriorError)
    if not np.isfinite(value):
        raise PriorError(f"{field}: found {value}, expected a finite number")
    return value


def stored(prior: Any, field: str, values: Mapping[str, Any]) -> None:
    """Put a read-only copy into a frozen field."""
    object.__setattr__(prior, field, FrozenMapping(dict(values)))


def denominators(model: Structure) -> list[tuple[str, ...]]:
    """Name distinct denominators; in a block structure those of all linear blocks."""
    if isinstance(model, BlockStructured):
        return list(dict.fromkeys(t.denominator for t in model.linear_blocks.values()))
    pairs = [(i, j) for i in range(model.outputs) for j in range(model.inputs)]
    return list(dict.fromkeys(coefficients_of(model, i + 1, j + 1).denominator for i, j in pairs))
