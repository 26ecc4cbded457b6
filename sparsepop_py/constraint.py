"""Constraints: what a comparison of polynomials makes."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from .errors import ProblemError

if TYPE_CHECKING:
    from .polynomial import Polynomial

__all__ = ["Constraint", "Kind"]


class Kind(Enum):
    """What a constraint asks of its polynomial p."""

    NONNEGATIVE = "p >= 0"
    ZERO = "p == 0"


@dataclass(frozen=True, eq=False)
class Constraint:
    """A polynomial that has to be non-negative or zero.

    Comparisons of polynomials make constraints; ``bool()`` of one raises, so that
    ``0 <= x <= 1`` cannot silently lose half of itself.

    Parameters
    ----------
    polynomial : Polynomial
    kind : Kind
    name : str
        Used in messages; empty when not given.
    """

    polynomial: Polynomial
    kind: Kind
    name: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.kind, Kind):
            raise ProblemError(f"kind: found {self.kind!r}, expected a Kind")

    def __bool__(self) -> bool:
        raise ProblemError("a constraint has no truth value: write 0 <= x <= 1 as two constraints")

    def __str__(self) -> str:
        relation = "==" if self.kind is Kind.ZERO else ">="
        label = f"{self.name}: " if self.name else ""
        return f"{label}{self.polynomial} {relation} 0"
