"""The least factor on all noise bounds: its problem, the claims, and their check."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import inf, isnan
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import frozen
from setid.data.noise import Noise
from setid.formulation.formulation import Formulation, formulate, multiplied_out
from setid.formulation.regression import Regression
from setid.formulation.units import in_units
from setid.proofs.denominators.denominator_cells import DenominatorCells
from setid.proofs.evidence import Verification
from setid.proofs.existence import admitted, proved_point
from setid.proofs.parameter_box import ProvedBox, box_follows
from sparsepop_py.algebra.polynomial_rows import polynomial_rows
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.verified.uncertain_rows.sign_tree import ParameterBox

__all__ = [
    "NoiseScale",
    "admitted_point",
    "attained_factor",
    "last_variable",
    "linear_problem",
    "problem_with_factor",
    "proved_factor",
    "rows_of_exact_readings",
    "scaled_noise",
    "stated_at",
    "verify_scale",
]


@dataclass(frozen=True, slots=True, eq=False)
class NoiseScale(ReadOnly):
    """The least factor on all noise bounds that explains a record, with its evidence.

    Parameters
    ----------
    scale : (float, float)
        No parameters are consistent with a factor below ``scale[0]`` (proved), some are with
        ``scale[1]`` (attained; infinite where none was found).
    theta : (p,) float or None
        Parameters that attain the upper end.
    witness : (n,) float or None
        All unknowns of ``formulation`` there, noise included.
    formulation : Formulation
        The data with noise bounds at the largest factor that was looked at.
    limit : float
        That factor.
    problem : sparsepop_py.Problem
        Whose last variable is the factor, as a fraction of ``limit``.
    bound : sparsepop_py.LinearBound or None
        The exact optimum, where the problem is linear.
    result : sparsepop_py.Result or None
        What the engine proved, otherwise.
    box : ParameterBox, DirectionBox, LiftedBox, CellBox or None
        The box of the parameters with the factor at ``limit``.
    refuted : (float, ParameterBox or DenominatorCells) or None
        A factor at which no parameters are proved to be consistent, by rows or by denominators;
        infinite where rows that no noise enters contradict each other.
    noise : Noise
        As given: a factor of 1.
    """

    scale: tuple[float, float]
    theta: NDArray[np.float64] | None
    witness: NDArray[np.float64] | None
    formulation: Formulation
    limit: float
    problem: sp.Problem
    bound: sp.LinearBound | None
    result: sp.Result | None
    box: ProvedBox | None
    refuted: tuple[float, ParameterBox | DenominatorCells] | None
    noise: Noise

    @property
    def explains(self) -> bool | None:
        """True if the noise bounds as given explain the data; None where that is open."""
        low, high = self.scale
        return True if high <= 1.0 else (False if low > 1.0 else None)


# ---- the problem --------------------------------------------------------------------------


def scaled_noise(bounds: tuple[NDArray[Any], ...], factor: float) -> Noise:
    """Multiply noise bounds by a factor, rounded up."""
    parts = [np.where(b > 0, np.nextafter(b * factor, inf), 0.0) for b in bounds]
    if factor == 1.0:
        parts = list(bounds)
    return Noise(output=parts[0], input=parts[1], equation=parts[2])


def linear_problem(formulation: Formulation) -> sp.Problem:
    """State the rows abs(Y + R theta) <= s w0 and the priors, in theta and s."""
    rows, problem = formulation.regression, formulation.problem
    assert rows is not None
    n, names = problem.dimension, (*problem.names, "noise factor")
    left, right = np.column_stack([rows.target, rows.regressors]), rows.radius[:, None]
    values = np.stack([np.hstack([-left, right]), np.hstack([left, right])], axis=1)
    values = values.reshape(-1, n + 2)
    words = np.arange(n + 2, dtype=np.int32)[:, None]
    made = polynomial_rows(np.broadcast_to(words, (*values.shape, 1)), values, n + 1, names)
    lines = [sp.Constraint(row, sp.Kind.NONNEGATIVE) for row in made]
    lines += [_lifted(problem, row) for row in _prior_rows(formulation)]
    s = sp.Polynomial(words[-1:], np.ones(1), n + 1, names)
    return sp.Problem(s, lines, np.append(problem.lower, 0.0), np.append(problem.upper, inf))


def _prior_rows(formulation: Formulation) -> list[int]:
    return [i for i, origin in enumerate(formulation.rows.origin) if origin == "prior"]


def _lifted(problem: sp.Problem, row: int) -> sp.Constraint:
    """A constraint in one more variable."""
    given = problem.constraints[row]
    return sp.Constraint(given.polynomial.within(problem.dimension + 1), given.kind, given.name)


def _with_factor(
    problem: sp.Problem, bounds: dict[int, tuple[float, float]]
) -> dict[int, sp.Constraint]:
    """Rows whose bound is size s + spare instead of size, where these are (size, spare).

    The constant, less size - spare, is rounded once; twice the rounding is in the spare part.
    Rows with equal shapes are made together.
    """
    n, shapes = problem.dimension, dict[tuple[int, ...], list[int]]()
    for row in bounds:
        shapes.setdefault(problem.constraints[row].polynomial.words.shape, []).append(row)
    found = {}
    for (terms, degree), rows in shapes.items():
        own = [problem.constraints[row].polynomial for row in rows]
        sizes = np.array([bounds[row] for row in rows])
        width = max(degree, 1)
        words = np.zeros((len(rows), terms + 2, width), np.int32)
        words[:, 1:-1, width - degree :] = [p.words for p in own]
        words[:, -1, -1] = n + 1
        values = np.zeros((len(rows), terms + 2))
        values[:, 1:-1] = [p.coefficients for p in own]
        constant = ~np.any(words[:, 1], axis=1) & (terms > 0)  # first in graded order
        values[constant, 0], values[constant, 1] = values[constant, 1], 0.0
        values[:, 0] -= sizes[:, 0] - sizes[:, 1]
        values[:, -1] = sizes[:, 0]
        for row, p in zip(rows, polynomial_rows(words, values, n + 1), strict=True):
            given = problem.constraints[row]
            found[row] = sp.Constraint(p, given.kind, given.name)
    return found


def rows_of_exact_readings(formulation: Formulation, noise: Noise) -> Formulation | None:
    """State only the rows that no noise enters: they hold with every factor on it.

    Parameters
    ----------
    formulation : Formulation
        Says data, structure and priors.
    noise : Noise
        Whose bounds count as zero or not, whatever their size.

    Returns
    -------
    Formulation or None
        Whose ``smoothed`` are these rows; None where there are none.
    """
    parts = [np.where(b > 0, 1.0, 0.0) for b in noise.bounds(formulation.data)]
    loud = Noise(output=parts[0], input=parts[1], equation=parts[2])
    given = formulation.model, loud, formulation.priors
    stated = multiplied_out(formulate(formulation.data, *given))
    rows = stated.smoothed
    if rows is None:
        return None
    exact = (rows.radius == 0.0) & ~np.any(rows.radii > 0.0, axis=1)
    if not np.any(exact):
        return None
    arrays = (getattr(rows, item.name)[exact] for item in fields(rows) if item.name != "names")
    return replace(stated, smoothed=Regression(rows.names, *map(frozen, arrays)))


def last_variable(problem: sp.Problem) -> sp.Polynomial:
    """State the factor as a polynomial."""
    word = np.array([[problem.dimension]], np.int32)
    return sp.Polynomial.from_words(word, np.ones(1), problem.dimension)


def problem_with_factor(
    formulation: Formulation, box: ProvedBox | None, scaled: float | None = None
) -> sp.Problem:
    """State the problem with one more unknown in [0, 1] that multiplies all noise bounds.

    Parameters
    ----------
    formulation : Formulation
    box : ParameterBox, DirectionBox, LiftedBox, CellBox or None
    scaled : float, optional
        The part of each output noise bound that it multiplies, and nothing else.
    """
    problem, layout = formulation.problem, formulation.layout
    n, p = problem.dimension, len(formulation.parameters)
    s = sp.Polynomial(np.array([[n + 1]], np.int32), np.ones(1), n + 1)
    bounds = _row_bounds(formulation) if scaled is None else {}
    widened = _with_factor(problem, {row: bound for row, bound in bounds.items() if bound[0]})
    rows = range(len(problem.constraints))
    lines = [widened[row] if row in widened else _lifted(problem, row) for row in rows]
    for group in ("eta", "xi") if scaled is None else ("eta",):
        numbers = layout.group(group)
        for number in numbers[numbers >= 0].tolist():
            size = float(problem.upper[number])
            part = size if scaled is None else min(scaled, size)
            rest = float(np.nextafter(size - part, inf)) if part < size else 0.0
            words = np.array([[0], [number + 1], [n + 1]], np.int32)[int(not rest) :]
            for sign in (-1.0, 1.0):  # part s + rest + sign x >= 0
                values = np.array([rest, sign, part])[int(not rest) :]
                lines.append(
                    sp.Constraint(sp.Polynomial(words, values, n + 1), sp.Kind.NONNEGATIVE)
                )
    lower, upper = np.append(problem.lower, 0.0), np.append(problem.upper, 1.0)
    if box is not None and not box.empty:
        lower[:p], upper[:p] = np.maximum(lower[:p], box.lower), np.minimum(upper[:p], box.upper)
    return sp.Problem(s, lines, lower, upper, (*problem.names, "noise factor"))


def _row_bounds(formulation: Formulation) -> dict[int, tuple[float, float]]:
    """Bounds of the equation errors of rows, and the share of rounded readings."""
    width, rows = formulation.noise.bounds(formulation.data).equation, formulation.rows
    found = {}
    for row, constraint in enumerate(formulation.problem.constraints):
        if rows.origin[row] == "model" and constraint.kind is sp.Kind.NONNEGATIVE:
            start = formulation.data.starts[rows.record[row] - 1]
            size = float(width[start + rows.sample[row] - 1, int(rows.equation[row][1:]) - 1])
            found[row] = size, 4e-16 * (abs(constraint.polynomial.constant_term) + size)
    return found


def attained_factor(formulation: Formulation, s: float) -> float:
    """Compute the factor that a point of :func:`problem_with_factor` needs where it attains s."""
    bounds = _row_bounds(formulation).values()
    share = max((spare / size for size, spare in bounds if size), default=0.0)
    return (s + share) * (1.0 + 1e-15)


# ---- the check ---------------------------------------------------------------------------


def proved_factor(result: sp.Result, limit: float) -> float:
    """Compute the factor below which nothing is consistent by the engine, rounded down."""
    proof = result.certificate
    share = 0.0 if proof is None else min(max(0.0, proof.bound), 1.0)
    return float(np.nextafter(share * limit, 0.0))


def verify_scale(found: NoiseScale) -> Verification:
    """Check both ends of a least factor from the data, without any solver.

    Parameters
    ----------
    found : NoiseScale
    """
    if reason := _misstated(found):
        return Verification(False, reason)
    again = stated_at(found, found.limit)
    if again.problem.fingerprint != found.formulation.problem.fingerprint:
        return Verification(False, "the problem is not that of the data, the noise and the limit")
    found = replace(found, formulation=again)  # what a fingerprint does not hold is stated again
    if found.bound is not None:
        return _verify_linear(found, found.bound)
    proved, attained = 0.0, False
    if found.refuted is not None:
        factor, box = found.refuted
        if not box.empty or not _emptiness_follows(box, found, factor):
            return Verification(False, "emptiness of the box does not follow")
        proved = factor
    if found.result is not None:
        if found.box is not None and not box_follows(found.box, stated_at(found, found.limit)):
            return Verification(False, "the box does not follow from the data")
        reason, attained = _result_fails(found)
        if reason:
            return Verification(False, reason)
        proved = max(proved, proved_factor(found.result, found.limit))
    if not attained and found.scale[1] < inf and not _explained(found):
        return Verification(False, "nothing attains the upper end")
    good = found.scale[0] <= proved
    return Verification(good, "" if good else "the lower end does not follow")


def _misstated(found: NoiseScale) -> str:
    """Say why a claim has no meaning; empty where it has one."""
    if any(map(isnan, found.scale)):
        return "an end is no number"
    if found.noise.constraints:
        return "noise with constraints over the record has no factor"
    return ""


def _emptiness_follows(
    box: ParameterBox | DenominatorCells, found: NoiseScale, factor: float
) -> bool:
    """Check that no parameters are consistent at a factor, or at any where that is infinite."""
    if factor == inf:
        exact = rows_of_exact_readings(found.formulation, found.noise)
        return exact is not None and isinstance(box, ParameterBox) and box_follows(box, exact)
    stated = stated_at(found, factor)
    return box.verify(stated) if isinstance(box, DenominatorCells) else box_follows(box, stated)


def _verify_linear(found: NoiseScale, bound: sp.LinearBound) -> Verification:
    """Check the optimum of the linear problem, whose factor is that on the noise as given."""
    linear = found.formulation.problem.dimension == len(found.formulation.parameters)
    if not linear or found.limit != 1.0:
        return Verification(False, "the linear problem is not that of the noise as given")
    problem = linear_problem(found.formulation)
    verdict = bound.verify(problem, last_variable(problem))
    if not verdict.ok:
        return Verification(False, verdict.reason)
    if found.scale != (bound.lower, bound.upper):
        return Verification(False, "the ends are not those of the linear problem")
    stated = found.theta is not None or bound.x is not None
    if stated and (bound.x is None or not _attained_by(found, bound.x)):
        return Verification(False, "the parameters are not those of the linear problem")
    return Verification(True)


def _attained_by(found: NoiseScale, x: NDArray[np.float64], near: Any = 0.0) -> bool:
    """Check that the parameters are those of a point, which is known up to a distance."""
    p = len(found.formulation.parameters)
    if found.theta is None or found.theta.shape != (p,):
        return False
    return bool(np.all(np.abs(found.theta - x[:p]) <= near))


def admitted_point(
    formulation: Formulation, units: NDArray[np.float64], point: sp.ProvedPoint
) -> bool:
    """Prove that a point in units is what the priors mean.

    Parameters
    ----------
    formulation : Formulation
    units : (n,) float
    point : ProvedPoint
    """
    p = len(formulation.parameters)
    return admitted(formulation, point.x[:p] * units[:p], point.radius * units[:p])


def stated_at(found: NoiseScale, factor: float) -> Formulation:
    """State the problem at one factor once more from the data.

    Parameters
    ----------
    found : NoiseScale
    factor : float
    """
    given = found.formulation
    noise = scaled_noise(found.noise.bounds(given.data), factor)
    return formulate(given.data, given.model, noise, given.priors)


def _explained(found: NoiseScale) -> bool:
    """Prove again that the parameters at the upper end are consistent."""
    if found.theta is None or found.witness is None:
        return False
    stated = stated_at(found, found.scale[1])
    if found.theta.shape != (len(stated.parameters),):
        return False
    if found.witness.shape != (stated.problem.dimension,):
        return False
    point = proved_point(stated, stated.problem, found.witness)
    held = point is not None and np.array_equal(point.x[: found.theta.size], found.theta)
    return held and admitted(stated, found.theta)


def _result_fails(found: NoiseScale) -> tuple[str, bool]:
    """Find a fault of the engine's result, and check that its point attains the end."""
    result = found.result
    assert result is not None
    problem = problem_with_factor(found.formulation, found.box)
    scaled = in_units(problem, found.formulation)
    if result.certificate is not None:
        verdict = result.certificate.verify(scaled.problem)
        if not verdict.ok:
            return verdict.reason, False
    if result.attained is None:
        return "", False
    point = result.attained.recheck(scaled.problem)
    if point is None:
        return "the attained point could not be proved again", False
    reached = attained_factor(found.formulation, point.value) * found.limit
    if not admitted_point(found.formulation, scaled.units, point):
        return "", False
    near = 2.0 * point.radius * scaled.units[: len(found.formulation.parameters)]
    if not _attained_by(found, point.x * scaled.units, near):
        return "", False
    return ("", True) if reached <= found.scale[1] else ("the upper end is not attained", False)
