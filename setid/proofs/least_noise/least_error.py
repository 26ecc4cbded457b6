"""Lower bounds of the least error of a fit, and their check.

Equation errors: for each theta the norm of Y + R theta is at least lambda'Y / |lambda|_*, whatever
lambda is with R'lambda = 0 (the dual norm below; S. Boyd, L. Vandenberghe, Convex Optimization,
2004, section 5.1.6). Multipliers are rational, so that R'lambda = 0 holds exactly.

Output errors: parameters with an error of at most a radius are consistent with output noise
within it, for each of the three norms. The least error over those is a polynomial problem, whose
bound the engine certifies; all other parameters have a larger error than the radius. Of one output
cones of denominators refute errors up to a level in the same norm
(:mod:`setid.proofs.denominators.denominator_cells`), whatever the radius is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from math import inf, isnan, isqrt
from typing import Literal

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.noise import Noise
from setid.data.record import IOData
from setid.formulation.formulation import Formulation, formulate
from setid.formulation.regression import Regression
from setid.formulation.units import InUnits, in_units
from setid.models.equations import Structure
from setid.priors.base import Prior
from setid.proofs.denominators.denominator_cells import DenominatorCells
from setid.proofs.denominators.output_rows import OutputRows, output_rows
from setid.proofs.evidence import Verification
from setid.proofs.existence import admitted
from setid.proofs.fields import well_formed
from setid.proofs.parameter_box import ProvedBox, box_follows, problem_on_box
from sparsepop_py.algebra.polynomial_rows import polynomial_rows
from sparsepop_py.verified.arithmetic.interval import exact_values

__all__ = [
    "Multipliers",
    "Norm",
    "OutputErrors",
    "attained_norm",
    "equation_bound",
    "error_problem",
    "error_rows",
    "exact_norm",
    "in_units_of",
    "output_bound",
    "stated",
    "verify_output",
    "weighted_sums",
]

Norm = Literal["linf", "l2", "l1"]


# ---- equation errors --------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Multipliers:
    """Rational multipliers of the rows of an equation-error fit.

    Parameters
    ----------
    values : tuple of Fraction
        One a row, with R'lambda = 0.
    """

    values: tuple[Fraction, ...]


def equation_bound(rows: Regression, norm: Norm, proof: Multipliers) -> float:
    """Compute the bound that multipliers prove of the least norm of Y + R theta.

    Parameters
    ----------
    rows : Regression
    norm : {"linf", "l2", "l1"}
    proof : Multipliers

    Returns
    -------
    float
        0 where they prove nothing; rounded down.
    """
    values = proof.values
    if len(values) != rows.target.size or not well_formed(proof):
        return 0.0
    if any(weighted_sums(rows.regressors, values)):
        return 0.0
    [gain] = weighted_sums(rows.target[:, None], values)
    if gain <= 0:
        return 0.0
    if norm == "l2":
        each = np.arange(1, len(values) + 1, dtype=np.int32)
        squares = np.stack([each, each], axis=1), np.ones(each.size), np.zeros(each.size, np.int64)
        [square] = exact_values(*squares, 1, values)
        return _root(gain * gain / square, up=False)
    sizes = [abs(v) for v in values]
    return _double(gain / (max(sizes) if norm == "l1" else sum(sizes)), up=False)


def weighted_sums(table: NDArray[np.float64], weights: Sequence[Fraction]) -> list[Fraction]:
    """Sum the rows of a table, each with a weight, exactly.

    Parameters
    ----------
    table : (R, p) float
    weights : sequence of Fraction, length R
    """
    count, p = table.shape
    words = np.repeat(np.arange(1, count + 1, dtype=np.int32), p)[:, None]
    return exact_values(words, table.ravel(), np.tile(np.arange(p), count), p, weights)


def exact_norm(rows: Regression, theta: NDArray[np.float64], norm: Norm) -> float:
    """Compute the norm of Y + R theta for given doubles, rounded up.

    Parameters
    ----------
    rows : Regression
    theta : (p,) float
    norm : {"linf", "l2", "l1"}
    """
    count, p = rows.regressors.shape
    words = np.tile(np.arange(p + 1, dtype=np.int32), count)[:, None]  # 0 for the target
    terms = np.column_stack([rows.target, rows.regressors]).ravel()
    place = np.repeat(np.arange(count), p + 1)
    point = [Fraction(value) for value in theta.tolist()]
    errors = exact_values(words, terms, place, count, point)
    unit = max((e.denominator for e in errors), default=1)  # powers of two
    sizes = [abs(e.numerator) * (unit // e.denominator) for e in errors]
    if norm == "l2":
        return _root(Fraction(sum(size * size for size in sizes), unit * unit), up=True)
    return _double(Fraction(sum(sizes) if norm == "l1" else max(sizes), unit), up=True)


def _double(value: Fraction, up: bool) -> float:
    """The next double on one side; of more than all doubles the largest, or infinity."""
    try:
        found = float(value)
    except OverflowError:
        found = inf if value > 0 else -inf
        if up == (value > 0):
            return found
        return float(np.nextafter(found, 0.0))
    if up:
        return found if Fraction(found) >= value else float(np.nextafter(found, inf))
    return found if Fraction(found) <= value else float(np.nextafter(found, -inf))


def _root(square: Fraction, up: bool) -> float:
    """A square root, rounded to one side."""
    small = square.denominator.bit_length() - square.numerator.bit_length()
    shift = 1 << (128 + max(small, 0))  # the root of the multiple has 128 bits or more
    scaled = square * shift * shift
    whole = isqrt(scaled.numerator // scaled.denominator)
    return _double(Fraction(whole + (1 if up else 0), shift), up)


# ---- output errors ----------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class OutputErrors:
    """Claim about the least output error, with its evidence.

    Parameters
    ----------
    norm : {"linf", "l2", "l1"}
    radius : float
        Parameters with a larger error are left out of the problem.
    formulation : Formulation
        The record with output noise within the radius.
    box : ParameterBox, DirectionBox, LiftedBox, CellBox or None
        Of the parameters, from the data alone.
    certificate : sparsepop_py.Certificate or None
        Of the problem in units.
    attained : sparsepop_py.ProvedPoint or None
        A point of it.
    level : float
        Errors up to here are refuted by ``cells``.
    cells : DenominatorCells or None
    """

    norm: Norm
    radius: float
    formulation: Formulation
    box: ProvedBox | None
    certificate: sp.Certificate | None
    attained: sp.ProvedPoint | None
    level: float = 0.0
    cells: DenominatorCells | None = None


def stated(
    data: IOData, model: Structure, priors: Sequence[Prior | sp.Constraint], radius: float
) -> Formulation:
    """State a record with output noise within a radius.

    Parameters
    ----------
    data : IOData
    model : Structure
    priors : sequence of priors
    radius : float
    """
    return formulate(data, model, Noise(output=radius), priors)


def error_rows(formulation: Formulation, norm: Norm, level: float) -> OutputRows | None:
    """State the rows of a single output with errors up to a level; None for other structures.

    Parameters
    ----------
    formulation : Formulation
    norm : {"linf", "l2", "l1"}
    level : float
    """
    if formulation.model.outputs != 1 or not 0.0 < level < inf:
        return None
    rows = output_rows(formulation, 0)
    if rows is None:
        return None
    return rows._replace(bound=np.where(rows.inside, level, 0.0), norm=norm)


def error_problem(
    formulation: Formulation, box: ProvedBox | None, norm: Norm, radius: float
) -> sp.Problem:
    """State the least error over parameters with an error within the radius.

    Parameters
    ----------
    formulation : Formulation
    box : ParameterBox, DirectionBox, LiftedBox, CellBox or None
    norm : {"linf", "l2", "l1"}
        The objective is the largest size, the sum of squares or the sum of sizes.
    radius : float
    """
    problem = problem_on_box(formulation, box)
    numbers = formulation.layout.group("eta")
    noise = [int(number) for number in numbers[numbers >= 0]]
    n = problem.dimension
    if norm == "l2":
        squares = np.repeat(1 + np.sort(np.array(noise, np.int32))[:, None], 2, axis=1)
        objective = sp.Polynomial(squares, np.ones(len(noise)), n)
        return sp.Problem(
            objective, problem.constraints, problem.lower, problem.upper, problem.names
        )
    count = len(noise) if norm == "l1" else 1
    names = (*problem.names, *(f"size {i + 1}" for i in range(count)))
    lines = [
        sp.Constraint(row.polynomial.within(n + count), row.kind, row.name)
        for row in problem.constraints
    ]
    words = np.empty((len(noise), 2, 2, 1), np.int32)  # by error, side and term
    words[:, :, 0, 0] = 1 + np.array(noise, np.int32)[:, None]
    words[:, :, 1, 0] = n + 1 + (np.arange(count)[:, None] if norm == "l1" else 0)
    signs = np.broadcast_to([[-1.0, 1.0], [1.0, 1.0]], (len(noise), 2, 2))
    sides = polynomial_rows(words.reshape(-1, 2, 1), signs.reshape(-1, 2), n + count)
    lines += [sp.Constraint(side, sp.Kind.NONNEGATIVE) for side in sides]  # size -+ error >= 0
    sizes = np.arange(n + 1, n + count + 1, dtype=np.int32)[:, None]
    objective = sp.Polynomial(sizes, np.ones(count), n + count)
    lower = np.append(problem.lower, np.zeros(count))
    upper = np.append(problem.upper, np.full(count, radius))
    return sp.Problem(objective, lines, lower, upper, names)


def in_units_of(found: OutputErrors) -> InUnits:
    """State the problem of the least error in units; the last two are remembered.

    Parameters
    ----------
    found : OutputErrors
    """
    return _in_units(found.formulation, found.box, found.norm, found.radius)


@lru_cache(maxsize=2)  # formulations and boxes are equal where they are the same object
def _in_units(
    formulation: Formulation, box: ProvedBox | None, norm: Norm, radius: float
) -> InUnits:
    return in_units(error_problem(formulation, box, norm, radius), formulation)


def output_bound(found: OutputErrors) -> float:
    """Compute the bound that the evidence proves of the least output error.

    Parameters
    ----------
    found : OutputErrors
        Whose certificate and cells were verified.

    Returns
    -------
    float
        0 where it proves nothing.
    """
    return max(_engine_bound(found), 0.0 if found.cells is None else found.level)


def _engine_bound(found: OutputErrors) -> float:
    """The bound that box and certificate prove."""
    if found.box is not None and found.box.empty:
        return found.radius
    if found.certificate is None:
        return 0.0
    factor = in_units_of(found).factor
    value = Fraction(found.certificate.bound) * Fraction(factor) if _is_finite(found) else None
    if value is None:  # no point within the radius
        return found.radius if found.certificate.bound == inf else 0.0
    least = Fraction(found.radius)
    if value <= 0:
        return 0.0
    return (
        _root(min(value, least * least), False)
        if found.norm == "l2"
        else _double(min(value, least), False)
    )


def attained_norm(found: OutputErrors, value: float) -> float:
    """Convert a value of the problem in units to an error, rounded up.

    Parameters
    ----------
    found : OutputErrors
    value : float
    """
    factor = in_units_of(found).factor
    error = max(Fraction(value) * Fraction(factor), Fraction(0))
    return _root(error, True) if found.norm == "l2" else _double(error, True)


def verify_output(
    found: OutputErrors, lower_bound: float, error: float, data: IOData | None = None
) -> Verification:
    """Check both ends of a least output error from the data, without any solver.

    Parameters
    ----------
    found : OutputErrors
    lower_bound, error : float
        What is claimed; an infinite error claims nothing.
    data : IOData, optional
        The record; the one that was stored when left out.
    """
    given = found.formulation
    again = stated(given.data if data is None else data, given.model, given.priors, found.radius)
    if again.problem.fingerprint != given.problem.fingerprint:
        return Verification(False, "the result belongs to other data")
    found = replace(found, formulation=again)  # what a fingerprint does not hold is stated again
    if isnan(lower_bound) or isnan(error):
        return Verification(False, "an end is no number")
    if reason := _not_proved(found):
        return Verification(False, reason)
    if found.box is not None and found.box.empty:  # no parameters, and no problem on the box
        proved = lower_bound <= output_bound(found) and error == inf
        return Verification(proved, "" if proved else "an end does not follow from an empty box")
    scaled = in_units_of(found)
    if found.certificate is not None:
        verdict = found.certificate.verify(scaled.problem)
        if not verdict.ok:
            return Verification(False, verdict.reason)
    if lower_bound > output_bound(found):
        return Verification(False, "the lower bound does not follow")
    reason = _not_attained(found, error) if error < inf else ""
    return Verification(not reason, reason)


def _not_attained(found: OutputErrors, error: float) -> str:
    """Say why the point does not attain an error; empty where it does."""
    scaled, formulation = in_units_of(found), found.formulation
    if formulation.dropped:  # the point may begin anew behind them, a simulation does not
        return "equations with missing samples are left out: no simulation is proved"
    point = None if found.attained is None else found.attained.recheck(scaled.problem)
    if point is None or attained_norm(found, point.value) > error:
        return "the error is not attained"
    p = len(formulation.parameters)
    units = scaled.units[:p]
    if not admitted(formulation, point.x[:p] * units, point.radius * units):
        return "the attained point is not what the priors mean"
    return ""


def _not_proved(found: OutputErrors) -> str:
    """Say why box or cells prove nothing; empty where they do."""
    if found.box is not None and not box_follows(found.box, found.formulation):
        return "the box does not follow from the data"
    if found.cells is None:
        return ""
    rows = error_rows(found.formulation, found.norm, found.level)
    follows = rows is not None and found.cells.output == 0 and found.cells.follows(rows)
    return "" if follows else "the cells of denominators do not refute the level"


def _is_finite(found: OutputErrors) -> bool:
    return found.certificate is not None and abs(found.certificate.bound) < inf
