"""Constraints: what a comparison of polynomials makes, and matrices of polynomials."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import isqrt
from typing import TYPE_CHECKING

from sparsepop_py.errors import ProblemError

if TYPE_CHECKING:
    from sparsepop_py.algebra.polynomial import Polynomial

__all__ = ["Constraint", "Kind"]


class Kind(Enum):
    """What a constraint asks of its polynomial p, and of its matrix G if it has one."""

    NONNEGATIVE = "p >= 0"
    ZERO = "p == 0"
    SECOND_ORDER = "p >= |(f2, ..., fk)|"
    PSD = "G positive semidefinite"

    @property
    def is_matrix(self) -> bool:
        """Whether the constraint says that a matrix of polynomials is positive semidefinite."""
        return self in (Kind.SECOND_ORDER, Kind.PSD)


@dataclass(frozen=True, eq=False)
class Constraint:
    """A polynomial that has to be non-negative or zero, or a matrix that has to be semidefinite.

    Comparisons of polynomials make constraints; ``bool()`` of one raises, so that
    ``0 <= x <= 1`` cannot silently lose half of itself. Matrices are made by
    :func:`sparsepop_py.second_order` and :func:`sparsepop_py.psd`.

    Parameters
    ----------
    polynomial : Polynomial
        With a matrix: something that follows from it and is asked for as well, ``p >= 0``.
    kind : Kind
    name : str
        Used in messages; empty when not given.
    entries : tuple of Polynomial
        Of a matrix: the axis f1 and the rest f2, ..., fk of a second-order cone, or the
        lower triangle of G row by row. Else empty.

    Raises
    ------
    ProblemError
        If kind and entries do not belong together.
    """

    polynomial: Polynomial
    kind: Kind
    name: str = ""
    entries: tuple[Polynomial, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.kind, Kind):
            raise ProblemError(f"kind: found {self.kind!r}, expected a Kind")
        count = len(self.entries)
        if not self.kind.is_matrix:
            if count:
                raise ProblemError(f"entries: found {count} for {self.kind.name}, expected none")
        elif self.side < 2:
            raise ProblemError(f"entries: found {count}, expected those of a matrix: use psd()")
        elif self.kind is Kind.PSD and count != self.side * (self.side + 1) // 2:
            raise ProblemError(f"entries: found {count}, expected a lower triangle")

    @property
    def side(self) -> int:
        """Number of rows of the matrix, 0 without one."""
        if self.kind is Kind.PSD:
            return (isqrt(8 * len(self.entries) + 1) - 1) // 2
        return len(self.entries)

    @property
    def degree(self) -> int:
        """Largest degree of the polynomial and of all entries."""
        return max(p.degree for p in (self.polynomial, *self.entries))

    def position(self, i: int, j: int) -> int | None:
        """Which of ``entries`` stands in row i and column j of the matrix, None for a zero.

        A second-order cone is the matrix with f1 on its diagonal and f2, ..., fk beside it
        in the first row and column: its least eigenvalue is f1 - |(f2, ..., fk)|.
        """
        i, j = max(i, j), min(i, j)
        if self.kind is Kind.PSD:
            return i * (i + 1) // 2 + j
        if i == j:
            return 0
        return i if j == 0 else None

    def __bool__(self) -> bool:
        raise ProblemError("a constraint has no truth value: write 0 <= x <= 1 as two constraints")

    def __str__(self) -> str:
        label = f"{self.name}: " if self.name else ""
        if self.kind is Kind.SECOND_ORDER:
            return f"{label}second_order({', '.join(map(str, self.entries))})"
        if self.kind is Kind.PSD:
            rows = [
                ", ".join(str(self.entries[self.position(i, j) or 0]) for j in range(self.side))
                for i in range(self.side)
            ]
            return f"{label}psd([{', '.join(f'[{row}]' for row in rows)}])"
        relation = "==" if self.kind is Kind.ZERO else ">="
        return f"{label}{self.polynomial} {relation} 0"
