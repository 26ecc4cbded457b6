"""Residuals of a parameter vector against what the noise bounds can explain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import frozen, parameters_of
from setid.feasible_points.members import nominal
from setid.feasible_set.coordinates import coordinates_of
from setid.feasible_set.feasible_set import FeasibleSet, check_result
from sparsepop_py.algebra.read_only import ReadOnly

if TYPE_CHECKING:
    from matplotlib.axes import Axes


__all__ = ["Residuals", "residuals"]

Reals = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Residuals(ReadOnly):
    """One-step residuals of a parameter vector against the noise that explains them.

    Parameters
    ----------
    theta : (p,) float
    values : (R,) float
        Y_k + R_k theta, row by row; where products of parameters occur, theta stands for them too.
    bound : (R,) float
        w0_k + W_k abs(theta): larger residuals no admissible noise explains.
    row, output : (R,) int
        Row of the data from 0, output from 1.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> setid.residuals(result).bound
    array([0.5, 0.5, 0.5])
    """

    theta: Reals
    values: Reals
    bound: Reals
    row: NDArray[np.int64]
    output: NDArray[np.int64]

    def __repr__(self) -> str:
        return f"<Residuals: {self.values.size} values, {len(self.outside)} outside their bounds>"

    @property
    def outside(self) -> NDArray[np.int64]:
        """Places of residuals beyond their bound, or beyond the range of numbers."""
        within = np.isfinite(self.values) & (np.abs(self.values) <= self.bound * (1.0 + 1e-9))
        return np.flatnonzero(~within)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw residuals and bounds; returns the axes.

        Parameters
        ----------
        ax : matplotlib Axes, optional
        """
        from setid.plots.residuals import plot_residuals

        return plot_residuals(self, ax)


def residuals(result: FeasibleSet, theta: Reals | None = None) -> Residuals:
    """Compute one-step residuals of a parameter vector, with the bounds that noise can explain.

    Parameters
    ----------
    result : FeasibleSet
        Of a structure whose outputs obey equations in readings and parameters, as for
        :func:`setid.predict`.
    theta : (p,) array_like, optional
        The nominal model when left out.

    Returns
    -------
    Residuals
        One value a row, in the unit of the output; ``outside`` lists rows that noise within its
        bounds does not explain by themselves.

    Raises
    ------
    SetidError
        If the structure has no such equations, or theta is no parameter vector of it.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> found = setid.residuals(result, [-0.5, 2.0])
    >>> found.values.round(4), found.outside
    (array([-0.25,  0.3 , -0.5 ]), array([], dtype=int64))
    """
    check_result(result)
    formulation = result.formulation
    coordinates = coordinates_of(formulation.model, "no one-step residuals")
    rows = coordinates.rows(formulation)
    values = nominal(result) if theta is None else parameters_of(theta, formulation.parameters)
    with np.errstate(over="ignore", invalid="ignore"):
        extended = coordinates.values(values)
        found = rows.target + rows.regressors @ extended
        bound = rows.radius + rows.radii @ np.abs(extended)
    return Residuals(
        frozen(np.array(values)),
        frozen(found),
        frozen(bound),
        rows.row,
        rows.output,
    )
