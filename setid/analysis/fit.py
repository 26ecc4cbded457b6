"""Global fits: parameters with the least error, and a proved lower bound of what is possible."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from math import inf
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import scipy.linalg
import scipy.sparse as sps
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import FrozenMapping, frozen
from setid.data.record import IOData
from setid.errors import SetidError
from setid.feasible_points.best import fit as fit_of
from setid.feasible_points.best import predicted
from setid.feasible_points.output_error import output_error_fit
from setid.feasible_set.start import find_box
from setid.formulation.formulation import Formulation
from setid.formulation.printing import rounded
from setid.formulation.regression import Regression, check_channels, regression_of_data
from setid.formulation.units import in_units
from setid.html import section, table
from setid.models.equations import Structure
from setid.options import Options
from setid.priors.base import Prior, listed
from setid.proofs.evidence import Verification
from setid.proofs.least_noise.least_error import (
    Multipliers,
    Norm,
    OutputErrors,
    attained_norm,
    equation_bound,
    error_problem,
    exact_norm,
    output_bound,
    stated,
    verify_output,
)
from sparsepop_py.lp.scaled import solve_scaled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Fit", "fit"]

Reals = NDArray[np.float64]
Errors = Literal["output", "equation"]

_MARGIN = 1e-4  # of the radius within which parameters are looked for, over the error of a fit
_ULPS = 1e-12  # by which a value may change where its proof is repeated


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Fit:
    """Parameters of a small error, and the bound below which no parameters come.

    Parameters
    ----------
    names : tuple of str
    theta : (p,) float
    norm : {"linf", "l2", "l1"}
        Largest size, Euclidean norm or sum of sizes.
    errors : {"output", "equation"}
        Of a simulation, with the best initial values where they are free; or of one-step
        predictions.
    error : float
        The error of ``theta``, attained: a point with at most this error provably exists where
        ``attained`` says so.
    attained : bool
    lower_bound : float
        Proved: no parameters have a smaller error.
    certificate : sparsepop_py.Certificate, Multipliers or None
        What proves it; None where nothing is proved and the bound is 0.
    outputs : (N, ny) float
        Outputs of the model, NaN where there are none.
    data : IOData
    model : Structure
    evidence : OutputErrors or None
        Of output errors: what the certificate is about.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> found = setid.fit(data, setid.TransferFunction(1, 1), norm="linf", errors="equation")
    >>> round(found.error, 6), found.gap < 1e-9, bool(found.verify())
    (0.339028, True, True)
    """

    names: tuple[str, ...]
    theta: Reals
    norm: Norm
    errors: Errors
    error: float
    attained: bool
    lower_bound: float
    certificate: sp.Certificate | Multipliers | None
    outputs: Reals
    data: IOData
    model: Structure
    evidence: OutputErrors | None = None

    @property
    def parameters(self) -> Mapping[str, float]:
        """Parameters by name."""
        return FrozenMapping(dict(zip(self.names, self.theta.tolist(), strict=True)))

    @property
    def gap(self) -> float:
        """Distance of error and lower bound, relative to the error."""
        return (self.error - self.lower_bound) / self.error if self.error > 0 else 0.0

    @property
    def fit(self) -> Reals:
        """100 (1 - |y - yhat| / |y - mean y|) in per cent, one an output."""
        return fit_of(self.data.y, self.outputs)

    def verify(self, data: IOData | None = None) -> Verification:
        """Check error and lower bound again from the data, without any solver.

        Parameters
        ----------
        data : IOData, optional
            The record; the one that was stored when left out.
        """
        record = self.data if data is None else data
        if np.isnan([self.lower_bound, self.error]).any():
            return Verification(False, "an end is no number")
        if self.evidence is not None:
            reason = self._foreign(self.evidence)
            if reason:
                return Verification(False, reason)
            claimed = self.error if self.attained else inf
            return verify_output(self.evidence, self.lower_bound, claimed, record)
        if self.errors == "output":
            proved = self.lower_bound <= 0 and not self.attained
            return Verification(proved, "" if proved else "no evidence is stored")
        rows = regression_of_data(record, self.model)
        if self.error < exact_norm(rows, self.theta, self.norm):
            return Verification(False, "the error is not attained")
        proof = self.certificate
        bound = equation_bound(rows, self.norm, proof) if isinstance(proof, Multipliers) else 0.0
        good = self.lower_bound <= bound
        return Verification(good, "" if good else "the lower bound does not follow")

    def _foreign(self, known: OutputErrors) -> str:
        """Say why evidence is not about this fit; empty where it is."""
        formulation = known.formulation
        own = repr(self.model), self.norm, self.errors, tuple(self.names)
        if own != (repr(formulation.model), known.norm, "output", formulation.parameters):
            return "the evidence is of another structure, norm or kind of error"
        if not self.attained:
            return ""
        problem = error_problem(formulation, known.box, known.norm, known.radius)
        units = in_units(problem, formulation).units[: self.theta.size]
        point = known.attained
        if point is None or not np.array_equal(point.x[: units.size] * units, self.theta):
            return "the parameters are not those of the attained point"
        return ""

    def summary(self) -> str:
        """A few lines for people."""
        pairs = ", ".join(f"{name} = {value:.6g}" for name, value in self.parameters.items())
        low, high = rounded(self.lower_bound, False, 6), rounded(self.error, True, 6)
        word = "attained" if self.attained else "not proved to be attained"
        fits = ", ".join(f"{value:.1f} %" for value in self.fit)
        return "\n".join(
            [
                pairs,
                f"{self.norm} norm of the {self.errors} errors: {high} ({word}), no parameters "
                f"have less than {low} (proved); gap {100 * self.gap:.2g} %",
                f"fit {fits}",
            ]
        )

    def plot(self, ax: Axes | NDArray[Any] | None = None) -> NDArray[Any]:
        """Draw readings and outputs of the model; returns the axes.

        Parameters
        ----------
        ax : array of matplotlib Axes, optional
            One an output.
        """
        from setid.plots.outputs import plot_fit

        return plot_fit(self, ax)

    def _repr_html_(self) -> str:
        rows = [(name, f"{value:.6g}") for name, value in self.parameters.items()]
        rows += [("error", rounded(self.error, True, 6))]
        rows += [("no parameters have less (proved)", rounded(self.lower_bound, False, 6))]
        return section(f"{self.norm} fit of {self.errors} errors", table(["", "value"], rows))

    def __repr__(self) -> str:
        low, high = rounded(self.lower_bound, False, 6), rounded(self.error, True, 6)
        return f"<Fit: {self.norm}, error {high}, at least {low} (proved)>"


def fit(
    data: IOData,
    model: Structure,
    norm: Norm = "l2",
    errors: Errors = "output",
    priors: Iterable[Prior | sp.Constraint] | Prior | sp.Constraint = (),
    options: Options | None = None,
) -> Fit:
    """Find the parameters of least error, with a proved lower bound of it.

    Parameters
    ----------
    data : IOData
        Inputs are taken as exact.
    model : Structure
    norm : {"linf", "l2", "l1"}
    errors : {"output", "equation"}
        Of a simulation over the whole record (free initial values count as parameters), or of
        one-step predictions.
    priors : iterable of priors and ``sp`` constraints
        For output errors.
    options : Options, optional
        ``tol`` is the relative gap; 60 seconds when left out.

    Returns
    -------
    Fit
        The bound holds for all parameters; a gap that is open is a number, not an exception.

    Raises
    ------
    ModelError
        If equation errors are asked of a structure that is not linear in its parameters.
    SetidError
        If the parts do not fit together.

    Notes
    -----
    Equation errors are convex: the multipliers of a linear program, or the residuals of least
    squares, are corrected in rationals and prove the bound. Output errors are not: the engine
    minimises over the parameters that a local fit does not exclude.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, 0, 2, 1, 0, 1], [0, 1, 0.5, 2.25, 2.1, 1.0])
    >>> found = setid.fit(data, setid.TransferFunction(1, 1, 1), norm="l2")
    >>> 0 < found.lower_bound <= found.error, bool(found.verify())
    (True, True)
    """
    if norm not in ("linf", "l2", "l1"):
        raise SetidError(f"norm: found {norm!r}, expected 'linf', 'l2' or 'l1'")
    check_channels(data, model)
    settings = options or Options(time_limit=60.0)
    if errors == "equation":
        if listed(priors):
            raise SetidError("priors: found some, expected none for equation errors")
        return _equation(data, model, norm)
    if errors != "output":
        raise SetidError(f"errors: found {errors!r}, expected 'output' or 'equation'")
    return _output(data, model, norm, tuple(listed(priors)), settings)


# ---- equation errors --------------------------------------------------------------------


def _equation(data: IOData, model: Structure, norm: Norm) -> Fit:
    rows = regression_of_data(data, model)
    theta, dual = _convex(rows, norm)
    proof = _corrected(rows, dual, norm)
    return Fit(
        names=rows.names,
        theta=frozen(theta),
        norm=norm,
        errors="equation",
        error=exact_norm(rows, theta, norm),
        attained=True,
        lower_bound=equation_bound(rows, norm, proof),
        certificate=proof,
        outputs=frozen(predicted(model, theta, data)),
        data=data,
        model=model,
    )


def _convex(rows: Regression, norm: Norm) -> tuple[Reals, Reals]:
    """A minimiser of |Y + R theta|, and multipliers (R,) that nearly prove it."""
    y, a = rows.target, rows.regressors
    if norm == "l2":
        theta = -np.linalg.lstsq(a, y, rcond=None)[0]
        return np.asarray(theta, np.float64), np.asarray(y + a @ theta, np.float64)
    count, p = a.shape
    size = sps.csr_array(np.ones((count, 1))) if norm == "linf" else sps.eye_array(count).tocsr()
    dense = sps.csr_array(a)
    below = sps.vstack([sps.hstack([dense, -size]), sps.hstack([-dense, -size])]).tocsr()
    cost = np.append(np.zeros(p), np.ones(size.shape[1]))
    found = solve_scaled(cost, (below, np.concatenate([-y, y])))
    if found.status != "solved":
        raise SetidError("data: the linear program has no solution; are numbers near overflow?")
    theta = found.x[:p]
    if norm == "linf":
        return theta, np.abs(found.dual[:count]) - np.abs(found.dual[count : 2 * count])
    errors = y + a @ theta  # a vertex: the signs of errors, and what balances them where it is zero
    signs = np.sign(errors)
    signs[np.argsort(np.abs(errors))[:p]] = 0.0
    return theta, signs


def _corrected(rows: Regression, dual: Reals, norm: Norm) -> Multipliers:
    """Rational multipliers near given ones with R'lambda = 0, by changes at p rows."""
    a, p = rows.regressors, rows.regressors.shape[1]
    values = [Fraction(float(v)) for v in dual]
    size = np.abs(dual)
    if norm == "l1":  # change those that are not at their bound
        weight = np.where(size > 0, 1e-6, 1.0)
    else:
        weight = size + 1e-3 * size.max(initial=1e-300)
    _, upper, order = scipy.linalg.qr((a * weight[:, None]).T, mode="economic", pivoting=True)
    diagonal = np.abs(np.diag(upper))
    rank = int(np.sum(diagonal > 1e-12 * diagonal.max(initial=1e-300)))
    if rank < p:
        return Multipliers(())
    pivots = order[:p].tolist()
    left = [
        sum((v * Fraction(float(a[k, i])) for k, v in enumerate(values) if v), Fraction(0))
        for i in range(p)
    ]
    matrix = [[Fraction(float(a[k, i])) for k in pivots] for i in range(p)]
    for place, change in zip(pivots, _solved(matrix, [-v for v in left]), strict=True):
        values[place] += change
    return Multipliers(tuple(values))


def _solved(matrix: list[list[Fraction]], right: list[Fraction]) -> list[Fraction]:
    """Solve a regular system in rationals, by Gauss and Jordan."""
    size = len(right)
    rows = [[*line, value] for line, value in zip(matrix, right, strict=True)]
    for i in range(size):
        pivot = next((k for k in range(i, size) if rows[k][i]), None)
        if pivot is None:
            return [Fraction(0)] * size
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [value / rows[i][i] for value in rows[i]]
        for k in range(size):
            if k != i and rows[k][i]:
                factor = rows[k][i]
                rows[k] = [b - factor * c for b, c in zip(rows[k], rows[i], strict=True)]
    return [line[-1] for line in rows]


# ---- output errors ----------------------------------------------------------------------


def _output(
    data: IOData, model: Structure, norm: Norm, priors: tuple[Any, ...], settings: Options
) -> Fit:
    until = settings.deadline()
    theta, outputs = output_error_fit(data, model, until)
    error = _norm(data.y - outputs, norm)
    radius = float(error * (1.0 + _MARGIN))
    known: OutputErrors | None = None
    low, attained = 0.0, False
    if 0 < radius < inf:
        formulation = stated(data, model, priors, radius)
        box = find_box(formulation, until)
        found = _solve(formulation, box, norm, radius, outputs, (theta, settings, until))
        proof = None if found is None else found.certificate
        point = None if found is None else found.attained
        known = OutputErrors(norm, radius, formulation, box, proof, point)
        low = output_bound(known)
        if found is not None and found.attained is not None:
            value = found.attained.value
            claimed = attained_norm(known, value + _ULPS * abs(value))
            if verify_output(known, 0.0, claimed):
                attained, error = True, claimed
                theta, outputs = _of_point(known, found.attained)
    return Fit(
        names=model.parameters if known is None else known.formulation.parameters,
        theta=frozen(theta),
        norm=norm,
        errors="output",
        error=error,
        attained=attained,
        lower_bound=min(low, error),
        certificate=None if known is None else known.certificate,
        outputs=frozen(outputs),
        data=data,
        model=model,
        evidence=known,
    )


def _solve(
    formulation: Formulation,
    box: Any,
    norm: Norm,
    radius: float,
    outputs: Reals,
    rest: tuple[Reals, Options, float],
) -> sp.Result | None:
    """Bound and attain the least error, from the local fit; None without a finite box."""
    theta, settings, until = rest
    if box is not None and box.empty:
        return None
    problem = error_problem(formulation, box, norm, radius)
    p = len(formulation.parameters)
    if not np.all(np.isfinite(problem.lower[:p]) & np.isfinite(problem.upper[:p])):
        return None
    scaled = in_units(problem, formulation)
    x = np.zeros(problem.dimension)
    x[formulation.layout.group("theta")] = theta
    numbers = formulation.layout.group("eta")
    errors = (formulation.data.y - outputs)[numbers >= 0]
    x[numbers[numbers >= 0]] = errors
    sizes = problem.dimension - formulation.problem.dimension
    if sizes:
        x[-sizes:] = np.abs(errors) if norm == "l1" else np.abs(errors).max()
    start = np.clip(x, problem.lower, problem.upper) / scaled.units
    left = None if until == inf else max(until - time.monotonic(), 1e-3)
    size = 2.0 * radius**2 if norm == "l2" else radius  # of the objective, for a relative gap
    options = sp.Options(
        effort="auto",
        gap=settings.tol * size / scaled.factor,
        gap_kind="absolute",
        solver=settings.solver,
        time_limit=left,
    )
    return sp.solve(scaled.problem, options, start=start)


def _of_point(known: OutputErrors, point: sp.ProvedPoint) -> tuple[Reals, Reals]:
    """Parameters and noise-free outputs of a point of the problem in units."""
    formulation = known.formulation
    problem = error_problem(formulation, known.box, known.norm, known.radius)
    x = point.x * in_units(problem, formulation).units
    numbers = formulation.layout.group("eta")
    outputs = np.where(
        numbers >= 0, formulation.data.y - x[np.where(numbers >= 0, numbers, 0)], np.nan
    )
    return np.asarray(x[formulation.layout.group("theta")], np.float64), outputs


def _norm(errors: Reals, norm: Norm) -> float:
    size = np.abs(errors[~np.isnan(errors)])
    if norm == "l2":
        return float(np.linalg.norm(size))
    return float(size.sum() if norm == "l1" else size.max())
