"""Global fits: parameters with the least error, and a proved lower bound of what is possible."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.analysis.equation_fit import corrected, minimiser
from setid.analysis.output_fit import least_output_errors
from setid.data.checks import FrozenMapping, frozen, word
from setid.data.record import IOData
from setid.errors import SetidError, warns_once
from setid.feasible_points.modelled_outputs import fit as fit_of
from setid.feasible_points.modelled_outputs import per_cent, predicted
from setid.formulation.regression import check_channels, regression_of_data
from setid.html import section, table
from setid.models.equations import Structure
from setid.options import Options, checked_options
from setid.priors.base import Prior, listed
from setid.proofs.denominators.denominator_cells import DenominatorCells
from setid.proofs.evidence import Verification, as_verdict
from setid.proofs.least_noise.least_error import (
    Multipliers,
    Norm,
    OutputErrors,
    equation_bound,
    exact_norm,
    in_units_of,
    output_bound,
    verify_output,
)
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.budget import EARLY
from sparsepop_py.executors.threads import while_solving
from sparsepop_py.verified.arithmetic.display import rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Fit", "fit"]

Reals = NDArray[np.float64]
Errors = Literal["output", "equation"]

_OPEN = 1e-2  # relative gap from which on a summary says why it is open
_GAPS = (
    "equations with missing samples are left out, and no simulation across them is proved: with "
    "IOData(..., y_range=(low, high)) missing outputs are unknowns"
)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Fit(ReadOnly):
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
        Outputs of the model as they were computed, NaN where there are none: nothing is proved of
        them, and ``verify`` does not look at them.
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

    @as_verdict
    def verify(self, data: IOData | None = None) -> Verification:
        """Check error and lower bound again from the data, without any solver.

        Parameters
        ----------
        data : IOData, optional
            The record; the one that was stored when left out.
        """
        record = self.data if data is None else data
        if reason := self._misstated():
            return Verification(False, reason)
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
        if self.names != rows.names:
            return Verification(False, "the names are not those of the parameters")
        if self.error < exact_norm(rows, self.theta, self.norm):
            return Verification(False, "the error is not attained")
        proof = self.certificate
        bound = equation_bound(rows, self.norm, proof) if isinstance(proof, Multipliers) else 0.0
        good = self.lower_bound <= bound
        return Verification(good, "" if good else "the lower bound does not follow")

    def _misstated(self) -> str:
        """Say what means nothing; empty where nothing does."""
        if np.isnan([self.lower_bound, self.error]).any():
            return "an end is no number"
        if self.norm not in get_args(Norm) or self.errors not in get_args(Errors):
            return "the norm or the kind of error is none"
        return "" if self.theta.shape == (len(self.names),) else "the parameters have no names"

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
                "no finite box of the parameters was searched; give more time, a smaller tol, or "
                "priors such as Box and Stable, which give such a box"
            )
        return "give more time, a smaller tol, or priors that leave less to search"

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
@while_solving
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
        return _equation(data, model, norm, settings)
    return _output(data, model, norm, tuple(listed(priors)), settings)


def _equation(data: IOData, model: Structure, norm: Norm, settings: Options) -> Fit:
    rows, deadline = regression_of_data(data, model), settings.limits()
    try:
        with deadline.kept():
            theta, dual = minimiser(rows, norm)
    except EARLY as cause:  # residuals of least squares prove something in each norm
        deadline.ended(cause)
        theta, dual = minimiser(rows, "l2")
    proof = corrected(rows, dual, norm)
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


def _output(
    data: IOData, model: Structure, norm: Norm, priors: tuple[Any, ...], settings: Options
) -> Fit:
    found = least_output_errors(data, model, norm, priors, settings)
    known = found.evidence
    return Fit(
        names=found.model.parameters if known is None else known.formulation.parameters,
        theta=frozen(found.theta),
        norm=norm,
        errors="output",
        error=found.error,
        attained=found.attained,
        lower_bound=found.lower_bound,
        certificate=None if known is None else _proof(known),
        outputs=frozen(found.outputs),
        data=data,
        model=found.model,
        evidence=known,
    )


def _proof(known: OutputErrors) -> sp.Certificate | DenominatorCells | None:
    """The cells, or the certificate of the engine where that proves more."""
    by_cells = known.certificate is None or output_bound(known) <= known.level
    return known.cells if by_cells else known.certificate
