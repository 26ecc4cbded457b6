"""The polynomial optimization problem: what is asked.

minimise  f(x)   subject to   g_i(x) >= 0,   h_j(x) == 0,   lower <= x <= upper

and to matrices of polynomials being positive semidefinite.
"""

from __future__ import annotations

import copy
import hashlib
import numbers
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, is_dataclass, replace
from dataclasses import fields as fields_of
from fractions import Fraction
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sparsepop_py.algebra import sympy_ as symbolic
from sparsepop_py.algebra.matrix_constraints import Matrices, SymbolicCone
from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial, total
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.errors import ProblemError, check_number, doubles, entries_of, shown
from sparsepop_py.problem.rounding import (
    OBJECTIVE,
    Rounding,
    rounded_bounds,
    rounded_constraints,
    rounding_of,
)
from sparsepop_py.verified.arithmetic.sum_of_squares import Weighted, constant_above, expanded

__all__ = ["Problem", "check_objective", "encoding"]

Sense = Literal["min", "max"]


@dataclass(frozen=True, eq=False, init=False)
class Problem(ReadOnly):
    """A polynomial optimization problem, always stored as a minimisation.

    Parameters
    ----------
    objective : Polynomial, number or sympy expression
        The polynomial f to be minimised.
    constraints : iterable of Constraint or sympy relation
        Inequalities g >= 0 and equalities h == 0, as comparisons make them; cones and
        matrices, as :func:`sparsepop_py.second_order` and :func:`sparsepop_py.psd` do.
    lower, upper : float or array_like (n,), optional
        Simple bounds, -inf and +inf where there are none.
    names : sequence of str, optional
        Names of the variables; those of the objective when left out.
    squares : iterable of Polynomial or (weight, Polynomial), optional
        The objective as a constant plus a (non-negatively weighted) sum of squares.
        Expanding hides this form, and with it a box for the variables:
        ``weight * r(x)^2 <= f(x) - constant``. The identity is checked exactly.
    sense : {"min", "max"}
        A memo for readers and writers of files. It does not change what is solved:
        ``objective`` is minimised, and bounds refer to it. ``"max"`` says that it is the
        negative of what was to be maximised. To maximise f write ``Problem(-f, rows)``.

    Raises
    ------
    ProblemError
        If dimensions, names or bounds do not fit; the message names the field.

    Notes
    -----
    Numbers that are no doubles as they were written, such as the coefficients of
    ``(x - 0.1)**2`` and the bound ``Fraction(1, 3)``, are rounded here, once. ``rounding`` says
    which, and by how much.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2, ["x", "y"])
    >>> problem = sp.Problem(x * y, [x**2 + y**2 == 1], lower=-1, upper=1)
    >>> problem.violation([1.0, 0.0])
    0.0
    """

    objective: Polynomial
    constraints: tuple[Constraint, ...]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    names: tuple[str, ...]
    squares: tuple[Weighted, ...]
    sense: Sense
    rounding: tuple[Rounding, ...] = field(init=False)

    def __init__(
        self,
        objective: Any,
        constraints: Iterable[Any] = (),
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        names: Sequence[str] | None = None,
        squares: Iterable[Any] | None = None,
        sense: Sense = "min",
    ) -> None:
        single = isinstance(constraints, (Constraint, SymbolicCone))
        rows: list[Any] = [constraints]
        if not single:
            rows = entries_of(constraints, "constraints", "a list of constraints")
        objective, rows = symbolic.convert(objective, rows, names)
        objective = _as_objective(objective, rows)
        n = objective.dimension
        for number, row in enumerate(rows):
            _check_constraint(number, row, n)
        if not isinstance(sense, str) or sense not in ("min", "max"):
            raise ProblemError(f"sense: found {shown(sense)}, expected 'min' or 'max'")
        low, high = _bounds("lower", lower, n, -np.inf), _bounds("upper", upper, n, np.inf)
        wrong = np.flatnonzero((low > high) | (low == np.inf) | (high == -np.inf))
        if wrong.size:
            v = int(wrong[0])
            raise ProblemError(
                f"lower, upper: found [{low[v]}, {high[v]}] for variable {v + 1}, "
                "expected lower <= upper"
            )
        stated, changed = _rounded(objective, low, high)
        stated_rows, more = rounded_constraints(rows, low, high)
        more += rounded_bounds("lower", lower) + rounded_bounds("upper", upper)
        fields = {
            "objective": stated,
            "constraints": tuple(stated_rows),
            "lower": low,
            "upper": high,
            "names": _names(names, objective),
            "squares": _squares(squares, stated),
            "sense": sense,
            "rounding": (*changed, *more),
        }
        for key, value in fields.items():
            object.__setattr__(self, key, value)

    @property
    def dimension(self) -> int:
        """Number of variables n."""
        return self.objective.dimension

    @cached_property
    def degree(self) -> int:
        """Largest degree of objective and constraints."""
        return max([self.objective.degree, *(c.degree for c in self.constraints)])

    @cached_property
    def rows(self) -> PolynomialSystem:
        """The constraints stacked for fast evaluation; row i is constraint i."""
        return PolynomialSystem.stack([c.polynomial for c in self.constraints], self.dimension)

    @cached_property
    def matrices(self) -> Matrices:
        """The matrices of those constraints that have one."""
        return Matrices.of(self.constraints, self.dimension)

    @cached_property
    def objective_row(self) -> PolynomialSystem:
        """The objective as a system of one row."""
        return PolynomialSystem.stack([self.objective], self.dimension)

    @cached_property
    def equality(self) -> NDArray[np.bool_]:
        """Equalities among the constraints, shape (m,)."""
        return _frozen(np.array([c.kind is Kind.ZERO for c in self.constraints], bool))

    @cached_property
    def first_alike(self) -> NDArray[np.int64]:
        """Number of the first constraint with the same polynomial up to its sign, shape (m,).

        Where one of them is zero, all of them are. A constraint without others alike, or whose
        polynomial is zero, has its own number.
        """
        first: dict[tuple[Any, ...], int] = {}
        numbers = np.arange(len(self.constraints))
        for number, constraint in enumerate(self.constraints):
            p = constraint.polynomial
            if p.coefficients.size:
                values = p.coefficients * np.copysign(1.0, p.coefficients[0])
                key = p.words.shape, p.words.tobytes(), values.tobytes()
                numbers[number] = first.setdefault(key, number)
        return _frozen(numbers)

    @cached_property
    def equations(self) -> NDArray[np.int64]:
        """Constraints that are equations, each once, shape (e,).

        These are equalities and pairs of opposite inequalities, p >= 0 and -p >= 0.
        """
        leading = (c.polynomial.coefficients[:1].tolist() for c in self.constraints)
        positive = np.array([value > [0.0] for value in leading], bool)
        both = np.intersect1d(self.first_alike[positive], self.first_alike[~positive])
        return _frozen(np.union1d(self.first_alike[self.equality], both).astype(np.int64))

    @cached_property
    def squares_constant(self) -> float | None:
        """The constant of f = constant + sum w r^2, rounded down.

        None without squares, or if the identity does not hold exactly in the given doubles.
        """
        if not self.squares:
            return None
        return constant_above(self.objective, self.squares)

    def violation(self, x: ArrayLike) -> float:
        """Compute the largest violation of constraints and bounds at ``x``.

        Parameters
        ----------
        x : array_like (n,)

        Returns
        -------
        float
            In the user's units: how far below 0 an inequality is, how far from 0 an equation, how
            far outside a variable. A matrix is violated by its negative eigenvalues. 0.0 where all
            hold, as evaluated in floating point, and inf where ``x`` has a NaN.

        Raises
        ------
        ProblemError
            If ``x`` has another shape.

        Examples
        --------
        >>> import sparsepop_py as sp
        >>> x, y = sp.variables(2)
        >>> disc = sp.Problem(x * y, [x**2 + y**2 <= 1])
        >>> disc.violation([1.0, 1.0]), disc.violation([0.5, 0.5])
        (1.0, 0.0)
        """
        point = doubles(x, "x")
        if point.shape != (self.dimension,):
            raise ProblemError(f"x: found shape {point.shape}, expected ({self.dimension},)")
        with np.errstate(invalid="ignore", over="ignore"):
            values = self.rows.values(point)
            worst = np.where(self.equality, np.abs(values), -values)
            worst[self.matrices.constraints] = 0.0  # what follows from a matrix is not asked twice
            least = -self.matrices.least_eigenvalue(point[None])
            parts = [worst, self.lower - point, point - self.upper, np.zeros(1), least]
            largest = np.concatenate(parts)
        return float("inf") if np.any(np.isnan(largest)) else float(np.max(largest))

    @cached_property
    def bound_rows(self) -> NDArray[np.bool_]:
        """Constraints that are linear in one variable, that is, bounds, shape (m,)."""
        polynomials = (c.polynomial for c in self.constraints)
        return _frozen(np.array([p.degree == 1 and p.support.size == 1 for p in polynomials], bool))

    @cached_property
    def sharpened(self) -> Problem:
        """The same problem with the bounds that :attr:`bound_rows` hide, rounded inwards.

        A point that is feasible here is feasible in the original problem.
        """
        lower, upper = self.lower.copy(), self.upper.copy()
        for number in np.flatnonzero(self.bound_rows):
            p = self.constraints[number].polynomial
            slope, variable = float(p.coefficients[-1]), int(p.support[0])
            edge = -p.constant_term / slope
            if not np.isfinite(edge):
                continue  # beyond all doubles: the row says it better
            rounded = Fraction(edge) * Fraction(slope) != -Fraction(p.constant_term)
            if self.equality[number] or slope > 0:
                inner = np.nextafter(edge, np.inf) if rounded else edge
                lower[variable] = max(lower[variable], inner)
            if self.equality[number] or slope < 0:
                inner = np.nextafter(edge, -np.inf) if rounded else edge
                upper[variable] = min(upper[variable], inner)
        if np.array_equal(lower, self.lower) and np.array_equal(upper, self.upper):
            return self
        if np.any(lower > upper):
            return self
        return Problem(self.objective, self.constraints, lower, upper, self.names)

    def with_objective(self, objective: Polynomial) -> Problem:
        """Return the same feasible set with another objective.

        Parameters
        ----------
        objective : Polynomial
            To be minimised, in the n variables of the problem.

        Returns
        -------
        Problem
            A minimisation, without ``squares``, which speak of the old objective.

        Raises
        ------
        ProblemError
            If it is no polynomial in n variables.

        Examples
        --------
        >>> import sparsepop_py as sp
        >>> x, y = sp.variables(2)
        >>> print(sp.Problem(x * y, [x**2 + y**2 <= 1]).with_objective(-x))
        min -x1
          s.t. 1 - x1^2 - x2^2 >= 0
        """
        check_objective(objective, self.dimension, "objective")
        self.__dict__.setdefault("_encoded", [])
        other = copy.copy(self)
        other.__dict__.clear()
        kept = {name: value for name, value in self.__dict__.items() if name in _OF_THE_SET}
        stated, changed = _rounded(objective, self.lower, self.upper)
        of_set = [record for record in self.rounding if record.place != OBJECTIVE]
        fields: dict[str, Any] = {"objective": stated, "squares": (), "sense": "min"}
        fields["rounding"] = (*changed, *of_set)
        other.__dict__.update(kept | fields)
        return other

    def __getstate__(self) -> dict[str, Any]:
        """Leave out bytes that follow from the rest."""
        return {name: value for name, value in self.__dict__.items() if name != "_encoded"}

    @cached_property
    def fingerprint(self) -> str:
        """Hash of all that certificates rest on, ``"v2:"`` and SHA-256 of :func:`encoding`."""
        return "v2:" + hashlib.sha256(encoding(self)).hexdigest()

    def __str__(self) -> str:
        return written(self)

    def __repr__(self) -> str:
        equalities, matrices = int(self.equality.sum()), self.matrices.constraints.size
        inequalities = len(self.constraints) - equalities - matrices
        last = f", {matrices} matrices" if matrices else ""
        return (
            f"<Problem: {self.dimension} variables, {inequalities} inequalities, "
            f"{equalities} equalities{last}, degree {self.degree}>"
        )


# What with_objective keeps: the fields but the objective's, and what is derived from them alone.
_OF_THE_SET = frozenset(
    ("constraints", "lower", "upper", "names", "rows", "matrices", "equality", "bound_rows")
    + ("first_alike", "equations")
    + ("_encoded",)  # the bytes of the constraints, once one of the problems needs them
)


def written(problem: Any) -> str:
    """Write a problem, with or without ratios, for people, in its own names."""
    lines = [f"min {_labelled(problem.objective, problem.names)}"]
    lines += [f"  s.t. {_labelled(row, problem.names)}" for row in problem.constraints]
    for name, low, high in zip(problem.names, problem.lower, problem.upper, strict=True):
        if np.isfinite(low) or np.isfinite(high):
            lines.append(f"  {low:g} <= {name} <= {high:g}")
    lines += [f"  {record}" for record in problem.rounding]
    return "\n".join(lines)


def _labelled(item: Any, names: tuple[str, ...]) -> Any:
    """Give polynomials, ratios and constraints the names of a problem."""
    if isinstance(item, Polynomial):
        return item if item.names == names else item.within(len(names), names)
    if isinstance(item, tuple):
        return tuple(_labelled(part, names) for part in item)
    if not is_dataclass(item) or isinstance(item, type):
        return item
    parts = {part.name: _labelled(getattr(item, part.name), names) for part in fields_of(item)}
    return replace(item, **parts)


def encoding(problem: Problem) -> bytes:
    """Encode a problem as bytes: equal bytes only for equal problems.

    Names and the memo ``sense`` do not count. The bytes are a list of parts, each after its
    length in bytes; numbers are little-endian, lengths and counts of 8 bytes:

    1. ``sparsepop-py problem 2``
    2. n, the number m of constraints, the number of squares
    3. the names of the m kinds, joined by commas
    4. the number of entries of the matrix of each constraint (0 without one)
    5. for each polynomial its number of terms and the letters of each of its words;
       the objective comes first, then each constraint's polynomial and its entries, then
       the squares
    6. all words of all polynomials, 4 bytes a letter
    7. all coefficients, as doubles
    8. lower bounds, 9. upper bounds, 10. weights of the squares, as doubles, without -0.0

    Parts 2 to 5 say how the others fall apart, so that the problem can be read back.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    bytes

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> encoding(sp.Problem(x, lower=0)) == encoding(sp.Problem(x, lower=0, names=["a", "b"]))
    True
    """
    rows, squares = problem.constraints, problem.squares
    held = problem.__dict__.setdefault("_encoded", [])
    if not held:
        kinds = ",".join(row.kind.name for row in rows).encode()
        sizes = np.array([len(row.entries) for row in rows], "<i8").tobytes()
        stacked = _encoded([p for row in rows for p in (row.polynomial, *row.entries)])
        held.append((kinds, sizes, stacked))
    kinds, sizes, stacked = held[0]
    first, last = _encoded([problem.objective]), _encoded([p for _, p in squares])
    parts = [
        b"sparsepop-py problem 2",
        np.array([problem.dimension, len(rows), len(squares)], "<i8").tobytes(),
        kinds,
        sizes,
        *(b"".join(pieces) for pieces in zip(first, stacked, last, strict=True)),
        (problem.lower + 0.0).astype("<f8").tobytes(),
        (problem.upper + 0.0).astype("<f8").tobytes(),
        (np.array([weight for weight, _ in squares], float) + 0.0).astype("<f8").tobytes(),
    ]
    return b"".join(len(part).to_bytes(8, "little") + part for part in parts)


def _encoded(polynomials: list[Polynomial]) -> tuple[bytes, bytes, bytes]:
    """Encode shapes, words and coefficients of polynomials."""
    return (
        np.array([p.words.shape for p in polynomials], "<i8").tobytes(),
        b"".join(p.words.astype("<i4", copy=False).tobytes() for p in polynomials),
        b"".join(p.coefficients.astype("<f8", copy=False).tobytes() for p in polynomials),
    )


def _rounded(
    objective: Polynomial, lower: NDArray[np.float64], upper: NDArray[np.float64]
) -> tuple[Polynomial, list[Rounding]]:
    """Take an objective by its doubles, with a record if that changed one."""
    record = rounding_of(OBJECTIVE, [objective], lower, upper)
    return objective.as_rounded(), [] if record is None else [record]


def _as_objective(objective: Any, rows: list[Any]) -> Polynomial:
    if isinstance(objective, Polynomial):
        return objective
    first = next((row for row in rows if isinstance(row, Constraint)), None)
    if first is not None and isinstance(objective, numbers.Real):
        return total([first.polynomial * 0.0, check_number(objective, "objective")])
    raise ProblemError(
        f"objective: found {type(objective).__name__}, expected a Polynomial "
        "(see sparsepop_py.variables) or a sympy expression; for ratios use RationalProblem"
    )


def check_objective(given: Any, dimension: int, place: str) -> None:
    """Check for a polynomial in as many variables as a problem has.

    Raises
    ------
    ProblemError
        Naming the place.
    """
    if isinstance(given, Polynomial) and given.dimension == dimension:
        return
    known = isinstance(given, Polynomial)
    found = f"a Polynomial in {given.dimension} variables" if known else shown(given)
    raise ProblemError(f"{place}: found {found}, expected a Polynomial in {dimension} variables")


def _check_constraint(number: int, row: Any, n: int) -> None:
    if not isinstance(row, Constraint):
        raise ProblemError(
            f"constraints[{number}]: found {type(row).__name__}, expected a comparison of "
            "polynomials such as x1 + x2 >= 1; for ratios use RationalProblem"
        )
    for polynomial in (row.polynomial, *row.entries):
        if polynomial.dimension != n:
            raise ProblemError(
                f"constraints[{number}]: found {polynomial.dimension} variables, expected {n}"
            )


def _frozen(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array


def _bounds(field: str, given: ArrayLike | None, n: int, default: float) -> NDArray[np.float64]:
    values = doubles(default if given is None else given, field).copy()
    if values.ndim == 0:
        values = np.full(n, float(values))
    if values.shape != (n,):
        raise ProblemError(f"{field}: found shape {values.shape}, expected ({n},)")
    if np.any(np.isnan(values)):
        where = int(np.flatnonzero(np.isnan(values))[0]) + 1
        raise ProblemError(f"{field}: found NaN for variable {where}, expected a number")
    return _frozen(values)


def _names(names: Sequence[str] | None, objective: Polynomial) -> tuple[str, ...]:
    n = objective.dimension
    if names is None:
        return objective.names or tuple(f"x{v + 1}" for v in range(n))
    labels = tuple(str(name) for name in entries_of(names, "names", f"{n} names"))
    if len(labels) != n or len(set(labels)) != n:
        raise ProblemError(f"names: found {len(labels)} names, expected {n} distinct ones")
    return labels


def _squares(squares: Iterable[Any] | None, objective: Polynomial) -> tuple[Weighted, ...]:
    pairs = []
    given = () if squares is None else squares
    for item in entries_of(
        given, "squares", "a list of polynomials, or of weights and polynomials"
    ):
        pair = isinstance(item, tuple) and len(item) == 2
        weight, polynomial = item if pair else (1.0, item)
        if not isinstance(polynomial, Polynomial) or polynomial.dimension != objective.dimension:
            found = type(polynomial).__name__
            raise ProblemError(
                f"squares: found {found}, expected polynomials in the objective's variables"
            )
        factor = doubles(weight, "squares")
        if factor.ndim or not 0 <= factor < np.inf:
            raise ProblemError(f"squares: found weight {weight}, expected one >= 0")
        pairs.append((float(factor), polynomial.as_rounded()))
    if pairs:
        rest = objective - expanded(pairs, objective.dimension)
        rest = rest - rest.constant_term
        scale = max(np.abs(objective.coefficients).max(initial=1.0), 1.0)
        if np.abs(rest.coefficients).max(initial=0.0) > 1e-9 * scale:
            raise ProblemError(
                f"squares: their sum differs from the objective by more than a constant: {rest!r}"
            )
    return tuple(pairs)
