"""The least equation error of a given network on a record, and its proved one-step band."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from setid import DataError, IOData, ModelError, Verification
from setid.data.checks import real_array
from setid.neural.arithmetic import (
    Interval,
    at_least,
    nowhere_above,
    quiet_overflow,
    require_ieee,
    up,
)
from setid.neural.models.regressor import RegressorNetwork, check_record, regressors
from setid.neural.status import Status, agreed
from setid.proofs.evidence import as_verdict
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.verified.arithmetic.display import rounded

__all__ = ["EquationError", "equation_error", "rows_of"]

Reals = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class EquationError(ReadOnly):
    """The largest one-step error of a network on a record, enclosed.

    Parameters
    ----------
    net : NNARX or NNOE
    data : IOData
    status : Status
        ``"proved"``, or ``"open"`` where a network output is beyond the doubles.
    lower_bound, upper_bound : (ny,) float
        The least bound E with abs(y_t - N(phi_t)) <= E for all t lies between them.
    low, high : (N, ny) float
        Proved enclosure of the network's prediction, NaN where there is none.
    row : (T,) int
        Rows of the data, from 0, that have a regressor.
    """

    net: RegressorNetwork
    data: IOData
    status: Status
    lower_bound: Reals
    upper_bound: Reals
    low: Reals
    high: Reals
    row: NDArray[np.int64]

    @quiet_overflow
    def band(self, error: float | Reals | None = None) -> tuple[Reals, Reals]:
        """Bound readings one step ahead, if the plant is the network with a bounded error.

        Parameters
        ----------
        error : float or (ny,) float, optional
            Bound of the equation error; what this record shows where left out.

        Returns
        -------
        low, high : (N, ny) float
        """
        width = self.upper_bound
        if error is not None:
            width = real_array(error, "error", ModelError)
            if width.shape not in ((), (1,), self.upper_bound.shape) or not np.all(width >= 0.0):
                raise ModelError(f"error: found {error!r:.60}, expected bounds >= 0, one an output")
        return -up(-self.low + width), up(self.high + width)

    @as_verdict
    def verify(self) -> Verification:
        """Compute the claims again from the network and the record."""
        again = equation_error(self.net, self.data)
        with np.errstate(invalid="ignore"):
            return agreed(
                (np.array_equal(again.row, self.row), "the rows are not those of the record"),
                (at_least(again.lower_bound, self.lower_bound), "the lower bound"),
                (at_least(self.upper_bound, again.upper_bound), "the upper bound"),
                (nowhere_above(self.low, again.low), "the band is too high"),
                (nowhere_above(again.high, self.high), "the band is too low"),
                (self.status is again.status, "the status"),
            )

    def __repr__(self) -> str:
        ends = ", ".join(
            f"[{rounded(a, False, 6)}, {rounded(b, True, 6)}]"
            for a, b in zip(self.lower_bound.tolist(), self.upper_bound.tolist(), strict=True)
        )
        return f"<EquationError: least bound in {ends}, {self.row.size} rows, {self.status}>"


def rows_of(net: RegressorNetwork, data: IOData) -> tuple[Reals, NDArray[np.int64]]:
    """Compute regressors of a record for a network fed by them, at least one row."""
    if not isinstance(net, RegressorNetwork):
        raise ModelError(
            f"net: found {type(net).__name__}, expected NNARX or NNOE; a network with a state has "
            "an output error (neural.output_error)"
        )
    check_record(data, net.channels, net.outputs)
    phi, row = regressors(data, net.order)
    if not row.size:
        raise DataError(f"data: found no row with a complete regressor of order {net.order}")
    return phi, row


@quiet_overflow
def equation_error(net: RegressorNetwork, data: IOData) -> EquationError:
    """Enclose the least equation error of a network on a record.

    Parameters
    ----------
    net : NNARX or NNOE
    data : IOData

    Returns
    -------
    EquationError

    Raises
    ------
    ModelError, DataError
        If network and record do not fit.

    Examples
    --------
    >>> import setid
    >>> from setid import neural
    >>> net = neural.NNARX(neural.Network([[[0.5, 1.0, 0.0]]], [[0.0]]), order=1)
    >>> found = neural.equation_error(net, setid.IOData([1, 2, 3], [10, 7.5, 6]))
    >>> found, bool(found.verify())
    (<EquationError: least bound in [0.749999, 0.750001], 2 rows, proved>, True)
    """
    require_ieee()
    phi, row = rows_of(net, data)
    value = net.network.enclose(Interval.point(phi))
    rest = Interval.point(data.y[row]) - value
    most = rest.magnitude().max(axis=0)
    near = np.where(
        (rest.lo <= 0) & (rest.hi >= 0), 0.0, np.minimum(np.abs(rest.lo), np.abs(rest.hi))
    )
    low, high = np.full((2, data.samples, net.outputs), np.nan)
    low[row], high[row] = value.lo, value.hi
    status = Status.PROVED if np.all(np.isfinite(most)) else Status.OPEN
    return EquationError(net, data, status, near.max(axis=0), most, low, high, row)
