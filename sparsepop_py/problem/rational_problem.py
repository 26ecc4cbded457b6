"""Problems with ratios of polynomials, and the polynomial problems that they become.

minimise  f(x) = w(x) + sum_i p_i(x) / q_i(x)   subject to polynomial constraints, bounds,
and constraints of the same form as f, >= 0 or == 0.

The set of the polynomial constraints and bounds alone is the *base*. Every denominator has
to have one sign on it. If it has, s_i = 1 / q_i(x) is a variable with the polynomial equation
s_i q_i(x) == 1 and with bounds that follow from those of q_i, and everything else is a
polynomial in x and s, with the very same doubles as coefficients (Bugarin, Henrion, Lasserre
2016 have a measure with the density s_i for each ratio).
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sparsepop_py.algebra.monomials import widen
from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial, total
from sparsepop_py.algebra.rational import AnyConstraint, Rational, RationalConstraint, key_of
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.algebra.sympy_ import convert_ratios
from sparsepop_py.errors import ProblemError, check_kind, doubles, entries_of, shown
from sparsepop_py.problem.problem import Problem, Sense, encoding, written
from sparsepop_py.problem.rounding import (
    OBJECTIVE,
    Rounding,
    place_of,
    rounded_constraint,
    rounding_of,
)
from sparsepop_py.verified.arithmetic.interval import Interval

__all__ = ["Range", "RationalProblem"]


@dataclass(frozen=True)
class Range:
    """Sign and size of a denominator q on a set.

    Parameters
    ----------
    sign : int
        1 or -1: that of q.
    least, most : float
        0 < least <= |q| <= most; most may be infinite.

    Raises
    ------
    ProblemError
        If the numbers are no such range.
    """

    sign: int
    least: float
    most: float

    def __post_init__(self) -> None:
        if self.sign not in (1, -1) or not 0 < self.least <= self.most:
            raise ProblemError(
                f"range: found sign {self.sign}, {self.least} to {self.most}, "
                "expected 1 or -1 and 0 < least <= most"
            )

    @property
    def reciprocal(self) -> tuple[float, float]:
        """Bounds of 1 / q, rounded outwards."""
        low = 0.0 if self.most == np.inf else float(_inverse(self.most).lo)
        high = np.inf if self.least == np.inf else float(_inverse(self.least).hi)
        return (low, high) if self.sign > 0 else (-high, -low)


def _inverse(value: float) -> Interval:
    return Interval.of_fraction(1 / Fraction(value))


@dataclass(frozen=True, eq=False, init=False)
class RationalProblem(ReadOnly):
    """Problem with ratios in the objective or in constraints, stored as a minimisation.

    Parameters
    ----------
    objective : Rational, Polynomial or sympy expression
    constraints : iterable of Constraint, RationalConstraint or sympy relation
        As comparisons make them.
    lower, upper : float or array_like (n,), optional
        Simple bounds, -inf and +inf where there are none.
    names : sequence of str, optional
    sense : {"min", "max"}
        A memo as for :class:`sparsepop_py.Problem`: the objective is minimised.

    Raises
    ------
    ProblemError
        If a part has another type, or dimensions, names or bounds do not fit.

    Notes
    -----
    A point is feasible if it satisfies all constraints and bounds. Denominators have to have
    one sign where the polynomial constraints and the bounds hold: :func:`sparsepop_py.solve`
    proves it, or raises :class:`sparsepop_py.DenominatorError`.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, = sp.variables(1)
    >>> result = sp.solve(sp.RationalProblem(x / (1 + x**2)))
    >>> result.status, abs(result.lower_bound + 0.5) < 1e-6
    (<Status.OPTIMAL: 'OPTIMAL'>, True)
    """

    objective: Rational
    constraints: tuple[AnyConstraint, ...]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    names: tuple[str, ...]
    sense: Sense
    rounding: tuple[Rounding, ...] = field(init=False)
    base: Problem  # the polynomial constraints and bounds, with the objective 0

    def __init__(
        self,
        objective: Any,
        constraints: Iterable[Any] = (),
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        names: Sequence[str] | None = None,
        sense: Sense = "min",
    ) -> None:
        single = isinstance(constraints, (Constraint, RationalConstraint))
        given = [constraints]
        if not single:
            given = entries_of(constraints, "constraints", "a list of constraints")
        objective, listed = convert_ratios(objective, given, names)
        rows = tuple(listed)
        function = _as_rational(objective, rows)
        rows, rounding = _rounded_rows(rows, _changed(OBJECTIVE, function))
        function = function.as_rounded()
        polynomial = [row for row in rows if not isinstance(row, RationalConstraint)]
        zero = Polynomial.from_words(
            np.zeros((0, 1), np.int32), np.zeros(0), function.dimension, function.names
        )
        base = Problem(zero, polynomial, lower, upper, names, sense=sense)
        for number, row in enumerate(rows):
            if isinstance(row, RationalConstraint):
                if row.expression.dimension != function.dimension:
                    raise ProblemError(
                        f"constraints[{number}]: found {row.expression.dimension} variables, "
                        f"expected {function.dimension}"
                    )
        fields = {
            "objective": function,
            "constraints": rows,
            "lower": base.lower,
            "upper": base.upper,
            "names": base.names,
            "sense": sense,
            "rounding": (*rounding, *base.rounding),
            "base": base,
        }
        for key, value in fields.items():
            object.__setattr__(self, key, value)

    @property
    def dimension(self) -> int:
        """Number of variables n."""
        return self.objective.dimension

    @property
    def degree(self) -> int:
        """Largest degree of polynomials, numerators and denominators."""
        rows = [row.expression for row in self.rational_rows]
        parts = [part.degree for f in (self.objective, *rows) for part in f.parts]
        return max(self.base.degree, *parts)

    @property
    def rational_rows(self) -> list[RationalConstraint]:
        """The constraints with ratios, in their order."""
        return [row for row in self.constraints if isinstance(row, RationalConstraint)]

    @cached_property
    def denominators(self) -> tuple[Polynomial, ...]:
        """Distinct denominators: of the objective, then of each constraint."""
        expressions = (self.objective, *(row.expression for row in self.rational_rows))
        listed = [q for expression in expressions for _, q in expression.ratios]
        return tuple({key_of(q): q for q in listed}.values())  # in the order of first occurrence

    @cached_property
    def _places(self) -> dict[tuple[object, ...], int]:
        return {key_of(q): k for k, q in enumerate(self.denominators)}

    def place(self, denominator: Polynomial) -> int:
        """Locate a denominator in ``denominators``.

        Parameters
        ----------
        denominator : Polynomial

        Returns
        -------
        int

        Raises
        ------
        ProblemError
            If it is not among them.
        """
        check_kind(denominator, Polynomial, "denominator")
        place = self._places.get(key_of(denominator))
        if place is None:
            raise ProblemError(
                f"denominator: found {denominator}, expected one of this problem's denominators"
            )
        return place

    def violation(self, x: ArrayLike) -> float:
        """Compute the largest violation of constraints and bounds at ``x``.

        Parameters
        ----------
        x : array_like (n,)

        Returns
        -------
        float
            As evaluated in floating point; inf where a denominator is zero.
        """
        point = doubles(x, "x")
        worst = [self.base.violation(point)]
        for row in self.rational_rows:
            value = float(row.expression(point))
            worst.append(abs(value) if row.kind is Kind.ZERO else -value)
        return float("inf") if np.any(np.isnan(worst)) else max(worst)

    # ---- the polynomial problem ---------------------------------------------------------

    def lifted_places(self, level: float | None = None) -> tuple[int, ...]:
        """List the denominators whose reciprocals are variables of the polynomial problem.

        Those of the objective (none with a level), and those of constraints that are not
        one fraction.

        Parameters
        ----------
        level : float, optional
            As for :meth:`lifted`.

        Returns
        -------
        tuple of int
            Places in ``denominators``, ascending.
        """
        wanted = set[int]()
        expressions = [] if level is not None else [self.objective]
        expressions += [
            row.expression for row in self.rational_rows if not row.expression.is_fraction
        ]
        for expression in expressions:
            wanted |= {self.place(q) for _, q in expression.ratios}
        return tuple(sorted(wanted))

    def lifted(self, ranges: Sequence[Range], level: float | None = None) -> Problem:
        """Build the polynomial problem in x, the reciprocals s, and the level.

        Its constraints are those of the base; s q == 1 for each reciprocal; for each rational
        constraint sign(q) p if it is one fraction p / q, else w + sum p s. Without a level the
        objective is w + sum p s. With a level c, for an objective of one ratio p / q beside a
        constant, it is sign(q) (p - z q) with a last variable z that is fixed at c.

        Parameters
        ----------
        ranges : sequence of Range
            Of each denominator on the base, proved.
        level : float, optional

        Returns
        -------
        Problem

        Raises
        ------
        ProblemError
            If there are not as many ranges as denominators, or the level does not fit.
        """
        ranges = entries_of(ranges, "ranges", "a list, one a denominator")
        for number, size in enumerate(ranges):
            check_kind(size, Range, f"ranges[{number}]")
        if len(ranges) != len(self.denominators):
            raise ProblemError(
                f"ranges: found {len(ranges)}, expected {len(self.denominators)}, one a denominator"
            )
        places = self.lifted_places(level)
        n, extra = self.dimension, len(places) + (level is not None)
        letters = {place: n + 1 + k for k, place in enumerate(places)}
        names = _with_new(self.names, [f"s{place + 1}" for place in places])
        names = names if level is None else _with_new(names, ["level"])

        def wide(polynomial: Polynomial, letter: int = 0) -> Polynomial:
            return _times_letter(polynomial, letter, n + extra, names)

        def linear(expression: Rational) -> Polynomial:
            parts = [wide(p, letters[self.place(q)]) for p, q in expression.ratios]
            return total([wide(expression.whole), *parts])

        rows = [
            Constraint(wide(c.polynomial), c.kind, c.name, tuple(wide(e) for e in c.entries))
            for c in self.base.constraints
        ]
        rows += [
            Constraint(total([wide(self.denominators[k], letters[k]), -1.0]), Kind.ZERO)
            for k in places
        ]
        for row in self.rational_rows:
            if row.expression.is_fraction:
                ((p, q),) = row.expression.ratios
                left = wide(p * float(ranges[self.place(q)].sign))
            else:
                left = linear(row.expression)
            rows.append(Constraint(left, row.kind, row.name))
        bounds = [ranges[k].reciprocal for k in places]
        if level is None:
            objective = linear(self.objective)
        else:
            p, q = self.single_ratio(level)
            sign = float(ranges[self.place(q)].sign)
            objective = total([wide(p * sign), wide(q * -sign, n + extra)])
            bounds.append((level, level))
        lower = np.concatenate([self.lower, [low for low, _ in bounds]])
        upper = np.concatenate([self.upper, [high for _, high in bounds]])
        return Problem(objective, rows, lower, upper, names)

    @property
    def has_level(self) -> bool:
        """True if the objective is one ratio, perhaps with a constant beside it."""
        return len(self.objective.ratios) == 1 and self.objective.whole.degree == 0

    def single_ratio(self, level: float) -> tuple[Polynomial, Polynomial]:
        """Return the ratio of an objective that may be compared with a level.

        Parameters
        ----------
        level : float

        Returns
        -------
        numerator, denominator : Polynomial

        Raises
        ------
        ProblemError
            If the objective is another one, or the level is not finite.
        """
        number = doubles(level, "level")
        if not self.has_level or number.shape or not np.isfinite(number):
            raise ProblemError(
                f"level: found {shown(level)} for {self.objective!r}, expected a finite number "
                "and an objective of one ratio beside a constant"
            )
        return self.objective.ratios[0]

    @cached_property
    def fingerprint(self) -> str:
        """Hash of all that certificates rest on, ``"r1:"`` and SHA-256.

        Of the bytes of polynomial problems that list, in order: the base; for the objective
        and for each rational constraint (its kind with it) the polynomial part, numerators
        and denominators.
        """
        digest = hashlib.sha256(b"sparsepop-py rational problem 1")
        kinds = ["objective", *(row.kind.name for row in self.rational_rows)]
        expressions = [self.objective, *(row.expression for row in self.rational_rows)]
        parts = [encoding(self.base)]
        for kind, expression in zip(kinds, expressions, strict=True):
            rows = [Constraint(part, Kind.ZERO) for part in expression.parts]
            parts += [kind.encode(), encoding(Problem(expression.whole * 0.0, rows))]
        for part in parts:
            digest.update(len(part).to_bytes(8, "little") + part)
        return "r1:" + digest.hexdigest()

    def __str__(self) -> str:
        return written(self)

    def __repr__(self) -> str:
        return (
            f"<RationalProblem: {self.dimension} variables, {len(self.constraints)} constraints, "
            f"{len(self.denominators)} denominators>"
        )


def _as_rational(objective: Any, rows: tuple[Any, ...]) -> Rational:
    if isinstance(objective, Rational):
        return objective
    for row in rows:
        if isinstance(row, RationalConstraint) and not isinstance(objective, Polynomial):
            objective = row.expression.whole._operand(objective)
            break
    if not isinstance(objective, Polynomial):
        raise ProblemError(
            f"objective: found {type(objective).__name__}, expected a Rational or a Polynomial"
        )
    return Rational(objective, ())


def _changed(place: str, expression: Rational) -> tuple[Rounding, ...]:
    """Record what rounding changes in numerators, denominators and the polynomial part."""
    anywhere = np.full(expression.dimension, np.inf)
    record = rounding_of(place, expression.parts, -anywhere, anywhere)
    return () if record is None else (replace(record, shift=np.inf),)


def _rounded_rows(
    rows: tuple[Any, ...], before: tuple[Rounding, ...]
) -> tuple[tuple[Any, ...], tuple[Rounding, ...]]:
    """Take rows by their doubles, with records of those that were rounded."""
    kept: list[Any] = []
    for number, row in enumerate(rows):
        place = place_of(number, row)
        if isinstance(row, RationalConstraint):
            before += _changed(place, row.expression)
            row = replace(row, expression=row.expression.as_rounded())
        elif isinstance(row, Constraint):
            anywhere = np.full(row.polynomial.dimension, np.inf)
            row, records = rounded_constraint(place, row, -anywhere, anywhere)
            before += tuple(records)
        kept.append(row)
    return tuple(kept), before


def _with_new(names: tuple[str, ...], wanted: list[str]) -> tuple[str, ...]:
    """Append names, with underscores where they are taken."""
    for name in wanted:
        while name in names:
            name += "_"
        names = (*names, name)
    return names


def _times_letter(
    polynomial: Polynomial, letter: int, dimension: int, names: tuple[str, ...]
) -> Polynomial:
    """Multiply by one new variable (none for 0), in more variables; no double changes."""
    words = polynomial.words
    if letter:
        words = widen(words, words.shape[1] + 1).copy()
        words[:, 0] = letter
        words.sort(axis=1)
    return Polynomial.from_words(words, polynomial.coefficients, dimension, names)
