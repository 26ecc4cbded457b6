"""Networks fed by regressors: NNARX predicts from readings, NNOE from its own outputs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from setid import DataError, IOData, ModelError
from setid.data.checks import natural
from setid.neural.models.network import Network, finite_array

__all__ = ["NNARX", "NNOE", "RegressorNetwork", "check_record", "regressors"]

Reals = NDArray[np.float64]


def regressors(data: IOData, order: int) -> tuple[Reals, NDArray[np.int64]]:
    """Stack phi_t = [y_{t-1}, ..., y_{t-n}, u_t, ..., u_{t-n}] for all rows that have one.

    Parameters
    ----------
    data : IOData
    order : int
        The order n.

    Returns
    -------
    phi : (T, ny n + nu (n + 1)) float
    row : (T,) int
        Rows of the data, from 0. Rows near the beginning of a record and rows that need a
        missing sample are left out.

    Examples
    --------
    >>> import setid
    >>> from setid.neural.models.regressor import regressors
    >>> phi, row = regressors(setid.IOData([1, 2, 3], [10, 20, 30]), 1)
    >>> phi, row
    (array([[10.,  2.,  1.],
           [20.,  3.,  2.]]), array([1, 2]))
    """
    row = np.flatnonzero(np.arange(data.samples) - data.first >= order)
    parts = [data.y[row - lag] for lag in range(1, order + 1)]
    parts += [data.u[row - lag] for lag in range(order + 1)]
    phi = np.concatenate(parts, axis=1)
    known = ~np.any(np.isnan(phi), axis=1) & ~np.any(np.isnan(data.y[row]), axis=1)
    return phi[known], row[known]


def check_record(data: Any, inputs: int, outputs: int, single: bool = False) -> None:
    """Raise ``DataError`` unless a record has the channels of a model."""
    if not isinstance(data, IOData):
        raise DataError(f"data: found {type(data).__name__}, expected IOData")
    if (data.inputs, data.outputs) != (inputs, outputs):
        raise DataError(
            f"data: found {data.inputs} inputs and {data.outputs} outputs, expected {inputs} and "
            f"{outputs} as of the network"
        )
    if single and data.records != 1:
        raise DataError(f"data: found {data.records} records, expected one")
    if single and np.any(np.isnan(data.u)):
        raise DataError("data.u: found a missing input, expected a complete record")


@dataclass(frozen=True, slots=True, eq=False, init=False)
class RegressorNetwork:
    """y_t = N([y_{t-1}, ..., y_{t-n}, u_t, ..., u_{t-n}]).

    Parameters
    ----------
    network : Network
        With n ny + (n + 1) nu inputs and ny outputs.
    order : int
        The order n, at least 1.
    channels : int
        Number nu of inputs of the plant.

    Raises
    ------
    ModelError
        If the network does not fit.
    """

    network: Network
    order: int
    channels: int

    def __init__(self, network: Network, order: int, channels: int = 1) -> None:
        if not isinstance(network, Network):
            raise ModelError(f"network: found {type(network).__name__}, expected neural.Network")
        order = natural(order, "order", ModelError, least=1)
        channels = natural(channels, "channels", ModelError, least=1)
        wanted = order * network.outputs + (order + 1) * channels
        if network.inputs != wanted:
            raise ModelError(
                f"network: found {network.inputs} inputs, expected {wanted}: {order} lags of "
                f"{network.outputs} outputs and {order + 1} of {channels} inputs"
            )
        for key, item in (("network", network), ("order", order), ("channels", channels)):
            object.__setattr__(self, key, item)

    @property
    def outputs(self) -> int:
        """Number of outputs."""
        return self.network.outputs

    @property
    def states(self) -> int:
        """Number of past outputs that a simulation starts from."""
        return self.order * self.outputs

    @property
    def parameters(self) -> int:
        """Number of weights and biases."""
        return self.network.parameters

    def one_step(self, data: IOData) -> Reals:
        """Predict each output from readings before it.

        Parameters
        ----------
        data : IOData

        Returns
        -------
        (N, ny) float
            NaN where a row has no regressor.

        Examples
        --------
        >>> import setid
        >>> from setid import neural
        >>> net = neural.NNARX(neural.Network([[[0.5, 1.0, 0.0]]], [[0.0]]), order=1)
        >>> net.one_step(setid.IOData([1, 2, 3], [10, 20, 30])).ravel()
        array([nan,  7., 13.])
        """
        check_record(data, self.channels, self.outputs)
        phi, row = regressors(data, self.order)
        found = np.full((data.samples, self.outputs), np.nan)
        found[row] = self.network(phi)
        return found

    def simulate(self, data: IOData, x0: ArrayLike | None = None) -> Reals:
        """Run on its own outputs from the first n outputs on.

        Parameters
        ----------
        data : IOData
            Its inputs are used; each record is simulated by itself.
        x0 : (n, ny) float, optional
            Outputs of the first n samples; the readings where left out.

        Returns
        -------
        (N, ny) float
            The first n rows of each record are ``x0``.

        Examples
        --------
        >>> import setid
        >>> from setid import neural
        >>> net = neural.NNOE(neural.Network([[[0.5, 1.0, 0.0]]], [[0.0]]), order=1)
        >>> net.simulate(setid.IOData([1, 2, 3], [10, 20, 30])).ravel()
        array([10. ,  7. ,  6.5])
        """
        check_record(data, self.channels, self.outputs)
        found = np.full((data.samples, self.outputs), np.nan)
        ends = [*data.starts[1:].tolist(), data.samples]
        for begin, end in zip(data.starts.tolist(), ends, strict=True):
            first = data.y[begin : begin + self.order] if x0 is None else self.start(x0)
            found[begin : min(end, begin + self.order)] = first[: end - begin]
            for t in range(begin + self.order, end):
                past = found[t - self.order : t][::-1].ravel()
                phi = np.concatenate([past, data.u[t - self.order : t + 1][::-1].ravel()])
                found[t] = self.network(phi)
        return found

    def start(self, x0: ArrayLike) -> Reals:
        """Check first outputs (n, ny); a flat list of n ny numbers is taken as well."""
        values = finite_array(x0, "x0")
        if values.size != self.states:
            raise ModelError(
                f"x0: found shape {values.shape}, expected ({self.order}, {self.outputs})"
            )
        return values.reshape(self.order, self.outputs)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: order {self.order}, {self.network!r}>"


class NNARX(RegressorNetwork):
    """y_t = N([y~_{t-1}, ..., y~_{t-n}, u_t, ..., u_{t-n}]) + e_t, with readings y~.

    Parameters
    ----------
    network : Network
        With n ny + (n + 1) nu inputs and ny outputs.
    order : int
        The order n, at least 1.
    channels : int
        Number nu of inputs of the plant.

    Raises
    ------
    ModelError
        If the network does not fit.

    References
    ----------
    J. Sjoeberg et al., "Nonlinear black-box modeling in system identification: a unified
    overview", Automatica 31 (1995) 1691-1724.

    Examples
    --------
    >>> import numpy as np
    >>> from setid import neural
    >>> net = neural.Network([np.zeros((8, 9)), np.zeros((1, 8))], [np.zeros(8), np.zeros(1)])
    >>> neural.NNARX(net, order=4).parameters
    89
    """

    __slots__ = ()


class NNOE(RegressorNetwork):
    """y_t = N([y_{t-1}, ..., y_{t-n}, u_t, ..., u_{t-n}]), measured with output noise.

    Parameters
    ----------
    network : Network
        With n ny + (n + 1) nu inputs and ny outputs.
    order : int
        The order n, at least 1.
    channels : int
        Number nu of inputs of the plant.

    Raises
    ------
    ModelError
        If the network does not fit.

    Notes
    -----
    :meth:`one_step` feeds readings all the same: what equation error and last layer are about.

    Examples
    --------
    >>> from setid import neural
    >>> net = neural.NNOE(neural.Network([[[0.5, 1.0, 0.0]]], [[0.0]]), order=1)
    >>> net.parameters, net.states
    (4, 1)
    """

    __slots__ = ()
