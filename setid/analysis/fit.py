"""Global fits: parameters with the least error, and a proved lower bound of what is possible."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import inf
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import scipy.linalg
import scipy.sparse as sps
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import FrozenMapping, frozen, word
from setid.data.record import IOData
from setid.errors import SetidError, warns_once
from setid.feasible_points.best import fit as fit_of
from setid.feasible_points.best import per_cent, predicted
from setid.feasible_points.fits.output_error import (
    least_error_at,
    least_largest_error,
    output_error_fit,
)
from setid.feasible_points.fits.separate_denominators import has_separate_denominators
from setid.feasible_set.start import find_box
from setid.formulation.formulation import Formulation, without_partial_outputs
from setid.formulation.regression import Regression, check_channels, regression_of_data
from setid.html import section, table
from setid.minimum_noise.claims import FoundDenominators
from setid.minimum_noise.denominators import least_output_noise
from setid.minimum_noise.fits import fit_of_denominator
from setid.minimum_noise.separate_noise import separate_noise
from setid.models.equations import Structure
from setid.models.lti import TransferFunction
from setid.options import Options, checked_options
from setid.priors.base import Prior, listed
from setid.proofs.denominators.denominator_cells import DenominatorCells
from setid.proofs.evidence import Verification
from setid.proofs.existence import proved_point
from setid.proofs.least_noise.least_error import (
    Multipliers,
    Norm,
    OutputErrors,
    attained_norm,
    equation_bound,
    error_rows,
    exact_norm,
    in_units_of,
    output_bound,
    stated,
    verify_output,
)
from sparsepop_py.budget import Deadline
from sparsepop_py.lp.scaled import solve_scaled
from sparsepop_py.solvers.threads import one_thread
from sparsepop_py.verified.arithmetic.display import rounded
from sparsepop_py.verified.arithmetic.rational import solve_matrix

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Fit", "fit"]

Reals = NDArray[np.float64]
Errors = Literal["output", "equation"]

_MARGIN = 1e-4  # of the radius within which parameters are looked for, over the error of a fit
_ULPS = 1e-12  # by which a value may change where its proof is repeated
_ROOM = 1e-9  # of the largest error: room for the rounding of errors that a proof solves for
_CELLS = 0.5  # of the time, for cones of denominators
_PART = 0.5  # of the tolerance, for them
_OPEN = 1e-2  # relative gap from which on a summary says why it is open
_WIDER = 12  # times that larger errors are tried, each by twice the factor of the one before
_GAPS = (
    "equations with missing samples are left out, and no simulation across them is proved: with "
    "IOData(..., y_range=(low, high)) missing outputs are unknowns"
)
_STARTS = 3  # denominators of a search that are fitted


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
        ``attained`` says so. Where equations with missing samples are left out it is not proved.
    attained : bool
    lower_bound : float
        Proved: no parameters have a smaller error.
    certificate : sparsepop_py.Certificate, DenominatorCells, Multipliers or None
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
    certificate: sp.Certificate | DenominatorCells | Multipliers | None
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
        units = in_units_of(known).units[: self.theta.size]
        point = known.attained
        if point is None or not np.array_equal(point.x[: units.size] * units, self.theta):
            return "the parameters are not those of the attained point"
        return ""

    def summary(self) -> str:
        """Describe the fit in a few lines."""
        pairs = ", ".join(f"{name} = {value:.6g}" for name, value in self.parameters.items())
        low, high = rounded(self.lower_bound, False, 6), rounded(self.error, True, 6)
        word = "attained" if self.attained else "not proved to be attained"
        lines = [
            pairs,
            f"{self.norm} norm of the {self.errors} errors: {high} ({word}), no parameters "
            f"have less than {low} (proved); gap {100 * self.gap:.2g} %",
            f"fit {per_cent(self.fit)}",
        ]
        if self.gap > _OPEN and self.errors == "output":
            lines.append(f"the gap is open: {self._cause()}")
        if self.evidence is not None and self.evidence.formulation.dropped:
            lines.append(_GAPS)
        return "\n".join(lines)

    def _cause(self) -> str:
        """Say what keeps the lower bound from the error."""
        box = None if self.evidence is None else self.evidence.box
        if box is None or not np.all(np.isfinite([box.lower, box.upper])):
            return (
                "in the time given no finite box of the parameters was found to search in; priors "
                "such as Box and Stable give one"
            )
        return "give more time, or priors that leave less to search"

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


@warns_once
@one_thread
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
    squares, are corrected in rationals and prove the bound. Output errors are not: cells of
    denominators refute smaller errors of a single output, and the engine minimises over the
    parameters that a local fit does not exclude where a gap is left.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, 0, 2, 1, 0, 1], [0, 1, 0.5, 2.25, 2.1, 1.0])
    >>> found = setid.fit(data, setid.TransferFunction(1, 1, 1), norm="l2")
    >>> 0 < found.lower_bound <= found.error, bool(found.verify())
    (True, True)
    """
    word(norm, "norm", ("linf", "l2", "l1"), SetidError)
    check_channels(data, model)
    settings = checked_options(options, Options(time_limit=60.0))
    if word(errors, "errors", ("output", "equation"), SetidError) == "equation":
        if listed(priors):
            raise SetidError("priors: found some, expected none for equation errors")
        return _equation(data, model, norm)
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
        scaled, size = _in_units(a)
        theta = -np.linalg.lstsq(scaled, y, rcond=None)[0]
        return theta / size, np.asarray(y + scaled @ theta, np.float64)
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
    signs[np.argsort(np.abs(errors))[: _independent(a).size]] = 0.0
    return theta, signs


def _corrected(rows: Regression, dual: Reals, norm: Norm) -> Multipliers:
    """Rational multipliers near given ones with R'lambda = 0, by changes at p rows."""
    a = rows.regressors
    a = a[:, _independent(a)]  # a sum of columns is orthogonal where these are
    p = a.shape[1]
    values = [Fraction(float(v)) for v in dual]
    size = np.abs(dual)
    if norm == "l1":  # change those that are not at their bound
        weight = np.where(size > 0, 1e-6, 1.0)
    else:
        weight = size + 1e-3 * size.max(initial=1e-300)
    order = _by_size((_in_units(a)[0] * weight[:, None]).T)
    if order.size < p:
        return Multipliers(())
    pivots = order.tolist()
    left = [
        sum((v * Fraction(float(a[k, i])) for k, v in enumerate(values) if v), Fraction(0))
        for i in range(p)
    ]
    matrix = [[Fraction(float(a[k, i])) for k in pivots] for i in range(p)]
    changes = solve_matrix(matrix, [[-value] for value in left])
    if changes is not None:
        for place, (change,) in zip(pivots, changes, strict=True):
            values[place] += change
    return Multipliers(tuple(values))


def _in_units(matrix: Reals) -> tuple[Reals, Reals]:
    """Divide columns by their largest sizes; return both."""
    size = np.abs(matrix).max(axis=0, initial=0.0)
    size = np.where(size > 0, size, 1.0)
    return np.asarray(matrix / size, np.float64), size


def _by_size(matrix: Reals) -> NDArray[np.int64]:
    """Choose independent columns, those first that are far from the span of others."""
    _, upper, order = scipy.linalg.qr(matrix, mode="economic", pivoting=True)
    diagonal = np.abs(np.diag(upper))
    rank = int(np.sum(diagonal > 1e-12 * diagonal.max(initial=1e-300)))
    return np.asarray(order[:rank], np.int64)


def _independent(matrix: Reals) -> NDArray[np.int64]:
    """Choose columns that span all of them."""
    return np.sort(_by_size(_in_units(matrix)[0]))


# ---- output errors ----------------------------------------------------------------------


def _output(
    data: IOData, model: Structure, norm: Norm, priors: tuple[Any, ...], settings: Options
) -> Fit:
    until = settings.deadline()
    formulation = without_partial_outputs(stated(data, model, priors, 1.0), from_rest=True)
    model = formulation.model
    local = output_error_fit(data, model, until)
    refuted = _refuted(formulation, norm, settings, until)
    fits = [local, *_of_denominators(formulation, norm, local[0], refuted.best, until)]
    fits.sort(key=lambda fit: _norm(data.y - fit[1], norm))
    theta, outputs = fits[0]
    known: OutputErrors | None = None
    for one in fits:
        found = _known(data, model, norm, priors, one, refuted)
        if found is not None and found.attained is not None:
            known, (theta, outputs) = found, one
            break
        known = known or found
    error, low, attained = _norm(data.y - outputs, norm), 0.0, False
    if known is not None:
        late = time.monotonic() >= until
        if not late and (known.attained is None or known.level < (1.0 - settings.tol) * error):
            known = _by_engine(known, outputs, (theta, settings, until))
        low = output_bound(known)
        if known.attained is not None:
            value = known.attained.value
            claimed = attained_norm(known, value + _ULPS * abs(value))
            if verify_output(known, 0.0, claimed):
                attained, error = True, claimed
                theta, outputs = _of_point(known, known.attained)
    return Fit(
        names=model.parameters if known is None else known.formulation.parameters,
        theta=frozen(theta),
        norm=norm,
        errors="output",
        error=error,
        attained=attained,
        lower_bound=min(low, error),
        certificate=None if known is None else _proof(known),
        outputs=frozen(outputs),
        data=data,
        model=model,
        evidence=known,
    )


def _of_denominators(
    formulation: Formulation, norm: Norm, theta: Reals, best: Sequence[Reals], until: float
) -> list[tuple[Reals, Reals]]:
    """Fit the other parameters for the denominators of a fit and of a search; single outputs."""
    data, model = formulation.data, formulation.model
    rows = error_rows(formulation, norm, 1.0)
    if rows is None or not isinstance(model, TransferFunction):
        return []
    if has_separate_denominators(model):
        apart = separate_noise(formulation, until) if norm == "linf" else None
        return [] if apart is None else [apart]
    places = [model.parameters.index(name) for name in model.transfer(1, 1).denominator]
    if not best and norm == "linf" and time.monotonic() < until:
        best = [least_largest_error(data, model, np.ones_like(data.y), until=until)[places]]
    found: list[tuple[Reals, Reals]] = []
    for denominator in [theta[places], *best[:_STARTS]]:
        if found and time.monotonic() >= until:
            break
        fitted = fit_of_denominator(data, model, rows, denominator)
        found.append(fitted or least_error_at(data, model, norm, denominator, until))
    return found


def _known(
    data: IOData,
    model: Structure,
    norm: Norm,
    priors: tuple[Any, ...],
    fitted: tuple[Reals, Reals],
    refuted: FoundDenominators,
) -> OutputErrors | None:
    """State the least error within that of a fit, and prove that it is attained, if it can be."""
    theta, outputs = fitted
    radius = float(_norm(data.y - outputs, norm) * (1.0 + _MARGIN))
    if not 0.0 < radius < inf:
        return None
    formulation, level = stated(data, model, priors, radius), refuted.factor
    known = OutputErrors(norm, radius, formulation, None, None, None, level, refuted.cells)
    return replace(known, attained=_at_fit(known, theta, outputs))


def _refuted(
    formulation: Formulation, norm: Norm, settings: Options, until: float
) -> FoundDenominators:
    """Refute errors by cones of denominators, where there is one output."""
    rows = error_rows(formulation, norm, 1.0)
    if rows is None or rows.order == 0:
        return FoundDenominators(0.0, None, ())
    left = None if until == inf else _CELLS * max(until - time.monotonic(), 1e-3)
    return least_output_noise(rows, 0, _PART * settings.tol, Deadline(left))


def _vector(known: OutputErrors, theta: Reals, outputs: Reals, room: float = 0.0) -> Reals:
    """All unknowns of the problem of the least error at a fit; sizes with some room."""
    formulation, norm = known.formulation, known.norm
    numbers = formulation.layout.group("eta")
    errors = (formulation.data.y - outputs)[numbers >= 0]
    x = np.zeros(formulation.problem.dimension)
    x[formulation.layout.group("theta")] = theta
    x[numbers[numbers >= 0]] = errors
    if norm == "l2":
        return x
    sizes = np.abs(errors) if norm == "l1" else np.abs(errors).max(keepdims=True)
    return np.concatenate([x, sizes + room * float(np.abs(errors).max())])


def _at_fit(known: OutputErrors, theta: Reals, outputs: Reals) -> sp.ProvedPoint | None:
    """Prove that the error of a fit is attained."""
    scaled = in_units_of(known)
    x = _vector(known, theta, outputs, _ROOM) / scaled.units
    return proved_point(known.formulation, scaled.problem, x)


def _by_engine(
    known: OutputErrors, outputs: Reals, rest: tuple[Reals, Options, float]
) -> OutputErrors:
    """Bound and attain the least error, from the local fit.

    Where priors leave no parameters within the error of the local fit, larger errors are tried.
    """
    theta, settings, until = rest
    found = _minimised(known, outputs, rest)
    for step in range(_WIDER):
        if output_bound(found) < found.radius or time.monotonic() >= until:
            break
        radius = found.radius * 2.0 ** (step + 1)
        if found.attained is not None:  # beyond the radius, which samples alone obey
            theta, outputs = _of_point(found, found.attained)
            radius = attained_norm(found, found.attained.value) * (1.0 + _MARGIN)
        wider = _minimised(_within(found, radius), outputs, (theta, settings, until))
        if wider.attained is None and output_bound(wider) < output_bound(found):
            break  # time ended, or the box is not finite: what was proved is kept
        found = wider
    if found.radius > known.radius and found.attained is not None and time.monotonic() < until:
        theta, outputs = _of_point(found, found.attained)
        error = attained_norm(found, found.attained.value)
        if output_bound(found) >= (1.0 - settings.tol) * error:
            return found
        again = _minimised(
            _within(found, error * (1.0 + _MARGIN)), outputs, (theta, settings, until)
        )
        if again.attained is not None and output_bound(again) >= output_bound(found):
            return again
    return found


def _within(known: OutputErrors, radius: float) -> OutputErrors:
    """State the same claim for errors within another radius, without its evidence."""
    old = known.formulation
    formulation = stated(old.data, old.model, old.priors, radius)
    level, cells = known.level, known.cells
    return OutputErrors(known.norm, radius, formulation, None, None, None, level, cells)


def _minimised(
    known: OutputErrors, outputs: Reals, rest: tuple[Reals, Options, float]
) -> OutputErrors:
    """Minimise the error over the box of its radius; as it was without a finite box."""
    theta, settings, until = rest
    given, known = known, replace(known, box=find_box(known.formulation, until), attained=None)
    if known.box is not None and known.box.empty:
        return known
    scaled = in_units_of(known)
    lower, upper = scaled.problem.lower, scaled.problem.upper
    p = len(known.formulation.parameters)
    if not np.all(np.isfinite(lower[:p]) & np.isfinite(upper[:p])):
        return given
    point = _at_fit(known, theta, outputs)
    start = np.clip(_vector(known, theta, outputs) / scaled.units, lower, upper)
    left = None if until == inf else max(until - time.monotonic(), 1e-3)
    size = 2.0 * known.radius**2 if known.norm == "l2" else known.radius  # for a relative gap
    options = sp.Options(
        effort="auto",
        gap=settings.tol * size / scaled.factor,
        gap_kind="absolute",
        solver=settings.solver,
        time_limit=left,
    )
    found = sp.solve(scaled.problem, options, start=start)
    best = found.attained
    if best is None or (point is not None and point.value < best.value):
        best = point
    return replace(known, certificate=found.certificate, attained=best)


def _proof(known: OutputErrors) -> sp.Certificate | DenominatorCells | None:
    """The cells, or the certificate of the engine where that proves more."""
    by_cells = known.certificate is None or output_bound(known) <= known.level
    return known.cells if by_cells else known.certificate


def _of_point(known: OutputErrors, point: sp.ProvedPoint) -> tuple[Reals, Reals]:
    """Parameters and noise-free outputs of a point of the problem in units."""
    formulation = known.formulation
    x = point.x * in_units_of(known).units
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
