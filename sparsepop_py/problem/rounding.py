"""Records of what rounding changed where expressions became the doubles of a problem.

Expressions are multiplied out exactly and each coefficient is rounded once, when a problem is
made of them, and so is each bound of a variable. What is proved is about the rounded numbers;
these records say how far they lie from what was written.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.exact_terms import ExactTerms, exact_fraction
from sparsepop_py.algebra.polynomial import Constraint, Polynomial
from sparsepop_py.errors import ProblemError
from sparsepop_py.verified.arithmetic.display import rounded
from sparsepop_py.verified.arithmetic.interval import Interval

__all__ = [
    "OBJECTIVE",
    "Rounding",
    "above",
    "note",
    "place_of",
    "rounded_bounds",
    "rounded_constraint",
    "rounded_constraints",
    "rounding_of",
]

OBJECTIVE = "objective"
BOUNDS = ("lower", "upper")
Reals = NDArray[np.float64]


@dataclass(frozen=True)
class Rounding:
    """Numbers of an objective, a constraint or bounds that were no doubles as written.

    Parameters
    ----------
    place : str
        ``"objective"``, or the constraint by its number and name; ``"lower"`` and ``"upper"`` for
        the bounds of variables.
    coefficients : int
        How many were rounded.
    largest : float
        At least the change of each, relative to its exact value; inf where exact values grew
        too long to be kept.
    shift : float
        At least the change of the value at any point within the bounds of the variables; inf
        where they are infinite. For bounds at least the change of each.

    Raises
    ------
    ProblemError
        If a field has another type or is negative.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, = sp.variables(1)
    >>> (rounding,) = sp.Problem((x - 0.1) ** 2, lower=-1, upper=1).rounding
    >>> rounding.place, rounding.coefficients, rounding.largest < 1e-16
    ('objective', 1, True)
    """

    place: str
    coefficients: int
    largest: float
    shift: float

    def __post_init__(self) -> None:
        if not isinstance(self.place, str):
            raise ProblemError(f"rounding: found the place {self.place!r}, expected a string")
        whole = isinstance(self.coefficients, numbers.Integral)
        if not whole or isinstance(self.coefficients, bool) or self.coefficients < 1:
            raise ProblemError(
                f"rounding: found {self.coefficients!r} coefficients, expected at least one"
            )
        for size in (self.largest, self.shift):
            if not isinstance(size, numbers.Real) or not size >= 0:
                raise ProblemError(f"rounding: found the size {size!r}, expected a number >= 0")

    def __str__(self) -> str:
        word = "bound" if self.place in BOUNDS else "coefficient"
        return f"{self.place}: {_counted(self.coefficients, word)} rounded{_by(self.largest)}"


def rounding_of(
    place: str, polynomials: Iterable[Polynomial], lower: Reals, upper: Reals
) -> Rounding | None:
    """Compare polynomials with what they were before they were rounded, None if nothing was."""
    exact = [p.exact for p in polynomials if p.exact is not None]
    if not exact:
        return None
    count, largest, shift, followed = 0, Fraction(0), 0.0, True
    for terms in exact:
        words, values, errors = _changes(terms)
        sizes = [abs(error / value) for error, value in zip(errors, values, strict=True)]
        count, largest = count + len(errors), max([largest, *sizes])
        shift = max(shift, _shift(words, errors, lower, upper))
        followed = followed and terms.followed
    if not followed:
        return Rounding(place, max(count, 1), math.inf, math.inf)
    return Rounding(place, count, above(largest), shift)


def place_of(number: int, row: Any) -> str:
    """Name the place of a constraint."""
    name = getattr(row, "name", "")
    return f"constraint {number}" + (f" ({name})" if name else "")


def rounded_constraint(
    place: str, row: Constraint, lower: Reals, upper: Reals
) -> tuple[Constraint, list[Rounding]]:
    """Take a constraint by its doubles, with a record if that changed one."""
    if all(p.exact is None for p in (row.polynomial, *row.entries)):
        return row, []
    stated = row.entries or (row.polynomial,)  # what follows from a matrix is not asked
    record = rounding_of(place, stated, lower, upper)
    entries = tuple(p.as_rounded() for p in row.entries)
    kept = replace(row, polynomial=row.polynomial.as_rounded(), entries=entries)
    return kept, [] if record is None else [record]


def rounded_constraints(
    rows: Sequence[Constraint], lower: Reals, upper: Reals
) -> tuple[list[Constraint], list[Rounding]]:
    """Do the same for all constraints of a problem."""
    kept, found = [], []
    for number, row in enumerate(rows):
        if row.polynomial.exact is not None or row.entries:
            row, records = rounded_constraint(place_of(number, row), row, lower, upper)
            found += records
        kept.append(row)
    return kept, found


def rounded_bounds(place: str, given: Any) -> list[Rounding]:
    """Record the bounds that are no doubles as they were given."""
    if isinstance(given, np.ndarray) and given.dtype.kind == "f" and given.dtype.itemsize <= 8:
        return []
    stated = np.asarray(given, object).ravel()  # beside floats numpy would round integers
    exact = [value for value in map(exact_fraction, stated) if value is not None]
    if not exact:
        return []
    changes = [abs(Fraction(float(value)) - value) for value in exact]
    largest = max(change / abs(value) for change, value in zip(changes, exact, strict=True))
    return [Rounding(place, len(exact), above(largest), above(max(changes)))]


def note(records: Sequence[Rounding]) -> list[str]:
    """Say in one sentence what was rounded, none where nothing was."""
    goal = [record for record in records if record.place == OBJECTIVE]
    bounds = [record for record in records if record.place in BOUNDS]
    rows = [record for record in records if record.place not in (OBJECTIVE, *BOUNDS)]
    parts = [f"objective: {_counts(goal)}"] if goal else []
    if len(rows) == 1:
        parts.append(f"{rows[0].place}: {_counts(rows)}")
    elif rows:
        parts.append(f"{len(rows)} constraints: {_counts(rows)}")
    parts += map(str, bounds)
    if not parts:
        return []
    words = ["coefficients"] * (len(bounds) < len(parts)) + ["bounds"] * bool(bounds)
    about = f"what is proved is about the rounded {' and '.join(words)}, see result.problem"
    return ["; ".join([*parts, about])]


def _counts(records: Sequence[Rounding]) -> str:
    count = sum(record.coefficients for record in records)
    shift = max(record.shift for record in records)
    largest = max(record.largest for record in records)
    moved = f", which moves it by at most {_short(shift)} within the bounds of the variables"
    when = f" when {'they were' if len(records) > 1 else 'it was'} multiplied out"
    return (
        f"{_counted(count, 'coefficient')} rounded"
        + (when if largest < math.inf else "")  # else perhaps where they were read
        + _by(largest)
        + (moved if len(records) == 1 and shift < math.inf else "")
    )


def _counted(count: int, word: str) -> str:
    return f"{count} {word}s were" if count > 1 else f"1 {word} was"


def _by(largest: float) -> str:
    if largest == math.inf:
        return ", on the way too, by an unknown amount"
    return f", by at most {_short(largest)} of each"


def _short(size: float) -> str:
    return rounded(size, True, 2)


def _changes(terms: ExactTerms) -> tuple[monomials.Words, list[Fraction], list[Fraction]]:
    """Terms that were rounded: words, exact values and errors."""
    doubles = terms.rounded().tolist()
    values = terms.fractions
    errors = [Fraction(double) - value for double, value in zip(doubles, values, strict=True)]
    changed = [k for k, error in enumerate(errors) if error]
    return terms.words[changed], [values[k] for k in changed], [errors[k] for k in changed]


def _shift(words: monomials.Words, errors: list[Fraction], lower: Reals, upper: Reals) -> float:
    """Bound the sum of |error * monomial| over a box."""
    letters = monomials.distinct(words)
    letters = letters[letters > 0]
    sizes = np.maximum(np.abs(lower[letters - 1]), np.abs(upper[letters - 1]))
    if not np.all(np.isfinite(sizes)):
        return math.inf
    reach = dict(zip(letters.tolist(), map(Fraction, sizes.tolist()), strict=True))
    reach[0] = Fraction(1)
    total = Fraction(0)
    for word, error in zip(words.tolist(), errors, strict=True):
        total += abs(error) * math.prod((reach[letter] for letter in word), start=Fraction(1))
    return above(total)


def above(value: Fraction) -> float:
    """Round a rational number up to a double."""
    return float(Interval.of_fraction(value).hi)
