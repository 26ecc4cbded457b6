"""Physical parameters: further unknowns that give the coefficients of a structure by relations."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import isfinite, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import FrozenMapping, entries_of
from setid.errors import PriorError
from setid.models.equations import Structure
from setid.priors.base import Facts, Interval, Plain, Symbols, interval_of, items_of, named, stored
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.errors import SparsePOPError
from sparsepop_py.io.expressions import ExpressionError, Vocabulary
from sparsepop_py.io.rational_expressions import parse_rational
from sparsepop_py.verified.arithmetic import interval
from sparsepop_py.verified.arithmetic.polynomial_range import range_over

__all__ = ["Physical"]

_RELATION = re.compile(r"(==|=|<=|>=)")
_NAME = re.compile(r"[^\W\d]\w*")
_STEPS, _STILL = 40, 1e-13


@dataclass(frozen=True, slots=True)
class Physical(Plain):
    """Physical parameters and how the coefficients of the structure follow from them.

    Parameters
    ----------
    intervals : mapping of str to (low, high)
        Names of the physical parameters with what is known of them; None for no end.
    relations : sequence of str
        Equations and inequalities such as ``"a1 = R/L"`` between the structure's parameters
        and the physical ones: sums, products, powers and quotients.

    Raises
    ------
    PriorError
        If a name or a relation is malformed.

    Notes
    -----
    A denominator has to have one sign for all parameters within the bounds that priors give,
    which interval arithmetic proves; relations are multiplied by it. Numbers in relations are
    doubles, and their products are rounded, as in :func:`sparsepop_py.parse`.

    Examples
    --------
    >>> import setid
    >>> setid.Physical({"R": (1, 3), "C": (0.1, 2)}, ["a0 = 1/(R*C)", "b0 = 1/(R*C)"])
    Physical({'R': (1.0, 3.0), 'C': (0.1, 2.0)}, ('a0 = 1/(R*C)', 'b0 = 1/(R*C)'))
    """

    intervals: Mapping[str, tuple[float | None, float | None]]
    relations: tuple[str, ...]

    def __init__(
        self,
        intervals: Mapping[str, tuple[float | None, float | None]],
        relations: Iterable[str],
    ) -> None:
        ends = {name: interval_of(v, name) for name, v in items_of(intervals, "Physical")}
        for name in ends:
            if not _NAME.fullmatch(name):
                raise PriorError(f"Physical: found the name {name!r}, expected letters and digits")
        listed = entries_of(relations, "relations", "a list of texts", PriorError)
        texts = (relations,) if isinstance(relations, str) else tuple(listed)
        for text in texts:
            if not isinstance(text, str) or len(_RELATION.findall(text)) != 1:
                raise PriorError(
                    f"relations: found {text!r}, expected an equation or inequality as text, "
                    "such as 'a1 = R/L'"
                )
        if not texts:
            raise PriorError("relations: found none, expected at least one")
        stored(self, "intervals", ends)
        object.__setattr__(self, "relations", texts)

    def __repr__(self) -> str:
        return f"Physical({dict(self.intervals)!r}, {self.relations!r})"

    @property
    def names(self) -> tuple[str, ...]:
        """The physical parameters in their order."""
        return tuple(self.intervals)

    def unknowns(self, model: Structure) -> Mapping[str, Interval]:
        """Name the physical parameters with their intervals.

        Parameters
        ----------
        model : Structure
        """
        for name in self.intervals:
            if name in model.parameters:
                raise PriorError(
                    f"Physical: found {name!r}, which is a parameter of the structure, expected "
                    "other names"
                )
        return {name: interval_of(ends, name) for name, ends in self.intervals.items()}

    def rows(self, model: Structure, x: Symbols, facts: Facts) -> list[sp.Constraint]:
        """State the relations, multiplied by their denominators.

        Parameters
        ----------
        model : Structure
        x : mapping of str to Polynomial
            Parameters and own unknowns by name.
        facts : Facts
            Bounds from all priors.
        """
        mine = self.unknowns(model)
        ends = [mine[n] if n in mine else facts.of(n) for n in x]
        box = interval.Interval(*np.array(ends, float).T.copy())
        return named([_row(text, x, box) for text in self.relations], "physical")

    def complete(self, model: Structure, theta: Mapping[str, float]) -> Mapping[str, float]:
        """Fit physical parameters to the relations, from the middle of their box.

        Parameters
        ----------
        model : Structure
        theta : mapping of str to float
        """
        own = self.unknowns(model)
        names = [*theta, *own]
        x = dict(zip(names, sp.variables(len(names), names), strict=True))
        facts = Facts({name: (value, value) for name, value in theta.items()}, frozenset())
        polynomials = [row.polynomial for row in self.rows(model, x, facts) if _is_zero(row)]
        low, high = np.array(list(own.values())).T
        start = np.array([_middle(*ends) for ends in own.values()])
        values = _newton(polynomials, np.array(list(theta.values()), float), start, (low, high))
        return FrozenMapping(dict(zip(own, values.tolist(), strict=True)))


def _is_zero(row: sp.Constraint) -> bool:
    return row.kind is sp.Kind.ZERO


def _middle(low: float, high: float) -> float:
    """A point of an interval: the geometric mean of positive ends, which may differ by decades."""
    if low > 0 and isfinite(high):
        return sqrt(low) * sqrt(high)
    if isfinite(low) and isfinite(high):
        return 0.5 * low + 0.5 * high
    return min(max(1.0, low), high)


def _row(text: str, x: Symbols, box: interval.Interval) -> sp.Constraint:
    """One relation as a polynomial row."""
    left, relation, right = _RELATION.split(text)
    vocabulary = Vocabulary(tuple(x))
    try:
        difference: Any = parse_rational(left, vocabulary) - parse_rational(right, vocabulary)
    except ExpressionError as error:
        raise PriorError(
            f"relations: {text!r}: found {error.found}, expected {error.expected}"
        ) from None
    except SparsePOPError as error:
        raise PriorError(f"relations: {text!r}: {error}") from None
    if relation == "<=":
        difference = -difference
    kind = sp.Kind.NONNEGATIVE if relation in ("<=", ">=") else sp.Kind.ZERO
    if isinstance(difference, sp.Polynomial):
        return sp.Constraint(difference, kind)
    return sp.Constraint(_cleared(difference, text, box), kind)


def _cleared(difference: sp.Rational, text: str, box: interval.Interval) -> sp.Polynomial:
    """Multiply a sum of ratios by its denominators, each with its sign."""
    found = difference.whole
    done = found * 0.0 + 1.0  # the product of the denominators so far, positive on the box
    for p, q in difference.ratios:
        sign = _sign(q, text, box)
        found = found * (q * sign) + p * sign * done
        done = done * (q * sign)
    return found


def _sign(q: sp.Polynomial, text: str, box: interval.Interval) -> float:
    """Prove the sign of a denominator by interval arithmetic."""
    size = range_over(PolynomialSystem.stack([q], q.dimension), box)
    low, high = float(size.lo[0]), float(size.hi[0])
    if low > 0:
        return 1.0
    if high < 0:
        return -1.0
    raise PriorError(
        f"relations: {text!r}: the sign of the denominator {q} is not proved, only "
        f"{low:.6g} <= {q} <= {high:.6g}; expected intervals that keep it away from zero"
    )


def _newton(
    rows: list[sp.Polynomial],
    theta: NDArray[np.float64],
    start: NDArray[np.float64],
    box: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> NDArray[np.float64]:
    """Least squares of the rows in the last variables, by Gauss-Newton steps inside a box."""
    first, values = theta.size, np.clip(start, *box)
    slopes = [[row.derivative(first + i) for i in range(start.size)] for row in rows]
    for _ in range(_STEPS if rows else 0):
        point = np.concatenate([theta, values])
        residual = np.array([row(point) for row in rows])
        matrix = np.array([[slope(point) for slope in line] for line in slopes])
        size = np.maximum(np.abs(values), 1e-300)
        step = size * np.linalg.lstsq(matrix * size, -residual, rcond=1e-12)[0]
        after = np.clip(values + step, *box)
        if np.all(np.abs(after - values) <= _STILL * size):
            break
        values = after
    return values
