"""Sums of ratios of polynomials, and the constraints that comparisons of them make.

``p / q`` with polynomials p and q is a :class:`Rational`. Ratios with the same denominator
are added, others are kept side by side: their common denominator would have a large degree,
and would join variables that do not meet.
"""

from __future__ import annotations

import numbers
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial
from sparsepop_py.errors import ProblemError, entries_of

__all__ = ["Rational", "RationalConstraint", "constraint", "key_of", "ratio"]

Pair = tuple[Polynomial, Polynomial]  # numerator and denominator


def key_of(polynomial: Polynomial) -> tuple[object, ...]:
    """Make a key that two polynomials share if all their words and doubles agree."""
    words, values = polynomial.words, polynomial.coefficients
    return polynomial.dimension, words.shape, words.tobytes(), values.tobytes()


@dataclass(frozen=True, eq=False, repr=False)
class Rational:
    """Sum of a polynomial and of ratios of polynomials.

    Built by dividing polynomials or by :func:`ratio`. Ratios are merged where
    their denominators agree in all doubles.

    Parameters
    ----------
    whole : Polynomial
        What has no denominator.
    ratios : tuple of (Polynomial, Polynomial)
        Numerators and denominators; denominators differ and are not constant.

    Raises
    ------
    ProblemError
        If a part is no polynomial, dimensions differ, or a denominator is constant or occurs
        twice.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> f = x / (1 + x**2) + (y - 1) / (1 + y**2) + 2
    >>> print(f)
    2 + (x1)/(1 + x1^2) + (-1 + x2)/(1 + x2^2)
    >>> f([1.0, 1.0])
    2.5
    """

    whole: Polynomial
    ratios: tuple[Pair, ...]

    __array_ufunc__ = None  # numpy scalars and arrays leave the arithmetic to us

    def __post_init__(self) -> None:
        listed = entries_of(self.ratios, "ratios", "a list of pairs")
        pairs = tuple(_pair(pair, f"ratios[{k}]") for k, pair in enumerate(listed))
        self.__dict__["ratios"] = pairs
        for part in self.parts:
            if not isinstance(part, Polynomial):
                raise ProblemError(f"ratio: found {type(part).__name__}, expected a Polynomial")
            if part.dimension != self.whole.dimension:
                raise ProblemError(
                    f"ratio: found polynomials of {self.whole.dimension} and {part.dimension} "
                    "variables, expected the same variables()"
                )
        for _, q in pairs:
            if q.degree == 0:
                raise ProblemError(f"ratio: found the denominator {q}, expected one with variables")
        if len({key_of(q) for _, q in pairs}) < len(pairs):
            raise ProblemError("ratio: found a denominator twice, expected distinct ones")

    @staticmethod
    def of(whole: Polynomial, fractions: Iterable[Pair]) -> Rational:
        """Add fractions to a polynomial; those with the same denominator are merged.

        Parameters
        ----------
        whole : Polynomial
        fractions : iterable of (Polynomial, Polynomial)
            Numerators and denominators.

        Returns
        -------
        Rational
        """
        merged: dict[tuple[object, ...], Pair] = {}
        for p, q in fractions:
            before = merged.get(key_of(q))
            if before is not None:
                p, q = before[0] + p, q if before[1].exact is None else before[1]
            merged[key_of(q)] = (p, q)
        return Rational(whole, tuple(merged.values()))

    def as_rounded(self) -> Rational:
        """Return the sum of ratios whose coefficients are these doubles, without memory.

        Returns
        -------
        Rational
        """
        if all(part.exact is None for part in self.parts):
            return self
        pairs = tuple((p.as_rounded(), q.as_rounded()) for p, q in self.ratios)
        return Rational(self.whole.as_rounded(), pairs)

    # ---- views --------------------------------------------------------------------------

    @property
    def dimension(self) -> int:
        """Number of variables n."""
        return self.whole.dimension

    @property
    def names(self) -> tuple[str, ...] | None:
        """Names of the variables, None where none were given."""
        return next((part.names for part in self.parts if part.names), None)

    @property
    def parts(self) -> tuple[Polynomial, ...]:
        """The polynomial, then numerators and denominators by turns."""
        return (self.whole, *(part for pair in self.ratios for part in pair))

    @property
    def is_fraction(self) -> bool:
        """True for one ratio and no polynomial beside it."""
        return len(self.ratios) == 1 and not self.whole.terms

    def __call__(self, x: ArrayLike) -> Any:
        """Evaluate at ``x`` in floating point: (n,) gives a float, (N, n) an array (N,)."""
        value = self.whole(x)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for p, q in self.ratios:
                value = value + np.divide(p(x), q(x))
        return float(value) if np.ndim(value) == 0 else value

    # ---- arithmetic ---------------------------------------------------------------------

    def _operand(self, other: Any) -> Rational | None:
        if isinstance(other, Rational):
            self.whole._operand(other.whole)  # the same variables, or an exception
            return other
        polynomial = self.whole._operand(other)
        return None if polynomial is None else Rational(polynomial, ())

    def __add__(self, other: Any) -> Rational:
        right = self._operand(other)
        if right is None:
            return NotImplemented
        return Rational.of(self.whole + right.whole, (*self.ratios, *right.ratios))

    __radd__ = __add__

    def __neg__(self) -> Rational:
        return Rational(-self.whole, tuple((-p, q) for p, q in self.ratios))

    def __sub__(self, other: Any) -> Rational:
        right = self._operand(other)
        return NotImplemented if right is None else self + (-right)

    def __rsub__(self, other: Any) -> Rational:
        left = self._operand(other)
        return NotImplemented if left is None else left + (-self)

    def __mul__(self, other: Any) -> Rational:
        right = self._operand(other)
        if right is None:
            return NotImplemented
        mixed = [(p * right.whole, q) for p, q in self.ratios]
        mixed += [(self.whole * p, q) for p, q in right.ratios]
        if right.ratios and self.ratios:
            mixed = [(p, q) for p, q in mixed if p.terms]
        mixed += [(p * r, q * s) for p, q in self.ratios for r, s in right.ratios]
        return Rational.of(self.whole * right.whole, mixed)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Rational:
        if isinstance(other, Rational):
            raise ProblemError(
                "division by a ratio: expected a polynomial or a number; multiply numerator "
                "and denominator by what makes both polynomials"
            )
        if isinstance(other, numbers.Real):
            return Rational(self.whole / other, tuple((p / other, q) for p, q in self.ratios))
        divisor = self.whole._operand(other)
        if divisor is None:
            return NotImplemented
        if divisor.degree == 0 and divisor.terms:
            return self / divisor.fractions[0]
        fractions = [(p, q * divisor) for p, q in self.ratios]
        if self.whole.terms or not fractions:
            fractions.append((self.whole, divisor))
        return Rational.of(self.whole * 0.0, fractions)

    def __rtruediv__(self, other: Any) -> Rational:
        return Rational(self.whole, ()) / self  # refused

    def __pow__(self, power: Any) -> Rational:
        if not isinstance(power, numbers.Real) or power < 0 or float(power) % 1 != 0:
            raise ProblemError(f"exponent: found {power!r}, expected a non-negative integer")
        result = Rational(self.whole._constant(1.0), ())
        for _ in range(int(float(power))):
            result = result * self
        return result

    # ---- comparisons make constraints ---------------------------------------------------

    def _compare(self, other: Any, kind: Kind, sign: float) -> Any:
        right = self._operand(other)
        if right is None:
            return NotImplemented
        return constraint((self - right) * sign, kind)

    def __ge__(self, other: Any) -> RationalConstraint:
        return self._compare(other, Kind.NONNEGATIVE, 1.0)

    def __le__(self, other: Any) -> RationalConstraint:
        return self._compare(other, Kind.NONNEGATIVE, -1.0)

    # The type system asks for a bool here; models are written with ==, so it makes an equation,
    # whose bool() raises.
    def __eq__(self, other: Any) -> RationalConstraint:  # type: ignore[override]
        return self._compare(other, Kind.ZERO, 1.0)

    def __gt__(self, other: Any) -> RationalConstraint:
        raise ProblemError("strict inequalities are not closed sets: use >= and <=")

    __lt__ = __gt__

    def __ne__(self, other: Any) -> bool:
        raise ProblemError("ratios are not compared by !=; == makes an equality constraint")

    # ---- printing -----------------------------------------------------------------------

    def __str__(self) -> str:
        parts = [str(self.whole)] if self.whole.terms or not self.ratios else []
        return " + ".join(parts + [f"({p})/({q})" for p, q in self.ratios])

    def __repr__(self) -> str:
        terms = self.whole.terms + sum(p.terms + q.terms for p, q in self.ratios)
        if terms <= 24:
            return f"<Rational {self}>"
        return f"<Rational of {len(self.ratios)} ratios, {terms} terms>"


def _pair(given: Any, place: str) -> Pair:
    """Take what is listed as one ratio apart."""
    entries = entries_of(given, place, "a numerator and a denominator")
    if len(entries) != 2:
        raise ProblemError(
            f"{place}: found {len(entries)} entries, expected a numerator and a denominator"
        )
    return entries[0], entries[1]


def _one_fraction(expression: Rational) -> Rational:
    """Bring one ratio and a polynomial over the denominator: a row without new variables."""
    if len(expression.ratios) != 1 or not expression.whole.terms:
        return expression
    ((p, q),) = expression.ratios
    return Rational(expression.whole * 0.0, ((p + expression.whole * q, q),))


@dataclass(frozen=True, eq=False)
class RationalConstraint:
    """Constraint on a sum of ratios: non-negative or zero.

    Comparisons make constraints. One ratio compared with a polynomial becomes a single
    fraction, whose sign is that of its numerator times that of its denominator.

    Parameters
    ----------
    expression : Rational
    kind : Kind
        ``NONNEGATIVE`` or ``ZERO``.
    name : str
        Used in messages; empty when not given.

    Raises
    ------
    ProblemError
        If a field has another type.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> print(x / (1 + y**2) >= 2)
    (-2 + x1 - 2*x2^2)/(1 + x2^2) >= 0
    """

    expression: Rational
    kind: Kind
    name: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.expression, Rational):
            raise ProblemError(
                f"expression: found {type(self.expression).__name__}, expected a Rational"
            )
        if not isinstance(self.kind, Kind) or self.kind.is_matrix:
            raise ProblemError(f"kind: found {self.kind!r}, expected Kind.NONNEGATIVE or Kind.ZERO")
        if not isinstance(self.name, str):
            raise ProblemError(f"name: found {self.name!r}, expected a string")

    def __bool__(self) -> bool:
        raise ProblemError("a constraint has no truth value: write 0 <= f <= 1 as two constraints")

    def __str__(self) -> str:
        label = f"{self.name}: " if self.name else ""
        relation = "==" if self.kind is Kind.ZERO else ">="
        return f"{label}{self.expression} {relation} 0"


AnyConstraint = Constraint | RationalConstraint


def constraint(expression: Polynomial | Rational, kind: Kind, name: str = "") -> AnyConstraint:
    """Make the constraint that an expression is non-negative or zero.

    Parameters
    ----------
    expression : Polynomial or Rational
        One ratio beside a polynomial becomes a single fraction.
    kind : Kind
    name : str

    Returns
    -------
    Constraint or RationalConstraint
    """
    if isinstance(expression, Polynomial):
        return Constraint(expression, kind, name)
    return RationalConstraint(_one_fraction(expression), kind, name)


def ratio(numerator: Any, denominator: Any) -> Rational:
    """Divide a polynomial or number by a polynomial.

    Parameters
    ----------
    numerator : Polynomial, Rational or float
    denominator : Polynomial
        Not constant. Its sign on the feasible set is proved when the problem is solved.

    Returns
    -------
    Rational

    Raises
    ------
    ProblemError
        If an argument is something else.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, = sp.variables(1)
    >>> print(sp.ratio(1, 1 + x**2))
    (1)/(1 + x1^2)
    """
    if not isinstance(denominator, Polynomial):
        raise ProblemError(
            f"denominator: found {type(denominator).__name__}, expected a Polynomial"
        )
    if isinstance(numerator, Rational):
        return numerator / denominator
    top = denominator._operand(numerator)
    if top is None:
        raise ProblemError(
            f"numerator: found {type(numerator).__name__}, expected a Polynomial or a number"
        )
    return Rational(denominator * 0.0, ((top, denominator),))
