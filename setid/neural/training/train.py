"""Training by existing solvers; what comes back is attained and never called a bound."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from setid import DataError, IOData, ModelError
from setid.data.checks import entries_of, natural, word
from setid.neural.arithmetic import ACTIVATIONS, activate, quiet_overflow, slope_at
from setid.neural.last_layers.equation_error import rows_of
from setid.neural.models.network import Network
from setid.neural.models.recurrent import NeuralStateSpace
from setid.neural.models.regressor import NNARX, NNOE, RegressorNetwork, regressors
from setid.neural.status import Status
from setid.neural.training.parameters import flatten, unflatten
from setid.neural.training.shooting import by_ipopt, by_jax_sysid
from sparsepop_py.algebra.read_only import ReadOnly

__all__ = ["Trained", "initial", "train"]

Reals = NDArray[np.float64]
Model = NNARX | NNOE | NeuralStateSpace
_WIDEST = 10**5  # neurons of a layer
_MOST = 10**9  # starts, and steps of each


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Trained(ReadOnly):
    """A trained network with what was attained.

    Parameters
    ----------
    net : NNARX, NNOE or NeuralStateSpace
    status : Status
        ``"attained"``: the value of a local solver, no bound of the optimum.
    attained : float
        Mean square of the errors that were minimised, in squared units of the outputs.
    method : str
    starts : int
        Number of initial guesses; the best is kept.
    x0 : (states,) float or None
        Initial state found with the weights, for models that are simulated.
    """

    net: Model
    status: Status
    attained: float
    method: str
    starts: int
    x0: Reals | None = None

    def __repr__(self) -> str:
        return (
            f"<Trained: {type(self.net).__name__} with {self.net.parameters} parameters, mean "
            f"square error {self.attained:.4g} {self.status} by {self.method}>"
        )


@quiet_overflow
def initial(
    data: IOData,
    order: int,
    widths: Sequence[int] = (8,),
    activation: str = "tanh",
    seed: int = 0,
    kind: type[RegressorNetwork] = NNARX,
) -> RegressorNetwork:
    """Draw a network of random weights, scaled to the signals of a record.

    Parameters
    ----------
    data : IOData
    order : int
    widths : sequence of int
        Neurons of each hidden layer.
    activation : str
    seed : int
    kind : type
        :class:`NNARX` or :class:`NNOE`.

    Returns
    -------
    NNARX or NNOE

    Examples
    --------
    >>> import numpy as np, setid
    >>> from setid import neural
    >>> rng = np.random.default_rng(0)
    >>> data = setid.IOData(rng.normal(size=50), rng.normal(size=50))
    >>> neural.initial(data, order=4).parameters
    89
    """
    word(activation, "activation", ACTIVATIONS, ModelError)
    natural(order, "order", ModelError, least=1)
    listed = entries_of(widths, "widths", "one size a hidden layer", ModelError)
    hidden = [natural(size, "widths", ModelError, 1, _WIDEST) for size in listed]
    if not isinstance(data, IOData):
        raise DataError(f"data: found {type(data).__name__}, expected IOData")
    if not any(kind is known for known in (NNARX, NNOE)):
        raise ModelError(f"kind: found {kind!r:.60}, expected neural.NNARX or neural.NNOE")
    phi, row = regressors(data, min(order, data.samples))
    if not row.size:
        raise DataError(f"data: found no row with a complete regressor of order {order}")
    rng = np.random.default_rng(natural(seed, "seed", ModelError))
    mean, spread = phi.mean(axis=0), np.maximum(phi.std(axis=0), 1e-12)
    level, size = data.y[row].mean(axis=0), np.maximum(data.y[row].std(axis=0), 1e-12)
    sizes = [phi.shape[1], *hidden, data.outputs]
    weights = [
        rng.normal(size=(after, before)) / np.sqrt(before)
        for before, after in zip(sizes[:-1], sizes[1:], strict=True)
    ]
    biases = [0.5 * rng.normal(size=after) for after in sizes[1:]]
    weights[-1], biases[-1] = weights[-1] * size[:, None], biases[-1] * size + level
    weights[0] = weights[0] / spread
    biases[0] = biases[0] - weights[0] @ mean
    return kind(Network(weights, biases, activation), order, data.inputs)


@quiet_overflow
def train(
    net: Model,
    data: IOData,
    method: str | None = None,
    starts: int = 1,
    seed: int = 0,
    x0: ArrayLike | None = None,
    max_steps: int = 300,
) -> Trained:
    """Minimise the sum of squared errors by an existing solver, from the weights given.

    Parameters
    ----------
    net : NNARX, NNOE or NeuralStateSpace
        Its weights are the first initial guess.
    data : IOData
    method : str, optional
        ``"scipy"`` for NNARX (Levenberg-Marquardt or trust region, its default);
        ``"ipopt"`` for NNOE and state space (outputs as unknowns, the network as constraints,
        needs casadi; their default); ``"jax-sysid"`` for state space (needs jax_sysid).
    starts : int
        Further guesses perturb the weights.
    seed : int
    x0 : array_like, optional
        First guess of the initial state of models that are simulated.
    max_steps : int
        Most iterations of the solver for each start.

    Returns
    -------
    Trained

    Raises
    ------
    ModelError
        If the method does not train this model.
    ImportError
        Naming the optional package that is missing.

    References
    ----------
    D. W. Marquardt, SIAM Journal on Applied Mathematics 11 (1963) 431-441.
    H. G. Bock, K. J. Plitt, "A multiple shooting algorithm for direct solution of optimal
    control problems", IFAC World Congress 1984.

    Examples
    --------
    >>> import numpy as np, setid
    >>> from setid import neural
    >>> u = np.sin(np.arange(60.0))
    >>> data = setid.IOData(u, np.append(0.0, 2.0 * np.tanh(u[:-1])))
    >>> found = neural.train(neural.initial(data, order=1, widths=[2]), data)
    >>> found.status, found.attained < 1e-3
    (<Status.ATTAINED: 'attained'>, True)
    """
    for field, count, least in (
        ("starts", starts, 1),
        ("seed", seed, 0),
        ("max_steps", max_steps, 1),
    ):
        natural(count, field, ModelError, least, None if field == "seed" else _MOST)
    usual = "scipy" if isinstance(net, NNARX) else "ipopt"
    kinds: dict[str, tuple[type, ...]] = {
        "scipy": (NNARX,),
        "ipopt": (NNOE, NeuralStateSpace),
        "jax-sysid": (NeuralStateSpace,),
    }
    chosen = usual if method is None else word(method, "method", kinds, ModelError)
    if not isinstance(net, kinds[chosen]):
        names = " or ".join(kind.__name__ for kind in kinds[chosen]) + f" for {chosen!r}"
        asked = "NNARX, NNOE or NeuralStateSpace" if method is None else names
        raise ModelError(f"net: found {type(net).__name__}, expected {asked}")
    if chosen == "scipy":
        assert isinstance(net, NNARX)
        return _by_scipy(net, data, starts, seed, max_steps)
    run = by_ipopt if chosen == "ipopt" else by_jax_sysid
    found, state, value = run(net, data, x0, max_steps)
    return Trained(found, Status.ATTAINED, value, chosen, 1, state)


def _jacobian(network: Network, phi: Reals) -> Reals:
    """Derivatives of all outputs (T, ny) with respect to all weights, (T, ny, p)."""
    values, slopes = [phi], []
    for w, b, name in zip(network.weights, network.biases, network.activation, strict=True):
        argument = values[-1] @ w.T + b
        slopes.append(slope_at(name, argument, network.leak).hi)
        values.append(activate(name, argument, network.leak))
    count, outputs = values[-1].shape
    back = np.broadcast_to(np.eye(outputs), (count, outputs, outputs))
    parts: list[Reals] = []
    for w, slope, below in zip(
        network.weights[::-1], slopes[::-1], values[-2::-1], strict=True
    ):  # from the last layer to the first
        back = back * slope[:, None, :]
        grown = back[:, :, :, None] * below[:, None, None, :]
        parts[:0] = [grown.reshape(count, outputs, -1), back]
        back = back @ w
    return np.concatenate(parts, axis=2)


def _by_scipy(net: NNARX, data: IOData, starts: int, seed: int, steps: int) -> Trained:
    phi, row = rows_of(net, data)
    target, rng = data.y[row], np.random.default_rng(seed)
    first = flatten(net.network)

    def residual(theta: Reals) -> Reals:
        return (unflatten(net.network, theta)(phi) - target).ravel()

    def slope(theta: Reals) -> Reals:
        found = _jacobian(unflatten(net.network, theta), phi)
        return found.reshape(-1, theta.size)

    best, value = first, float(np.mean(residual(first) ** 2))
    for number in range(max(1, starts)):
        guess = first if number == 0 else first + rng.normal(size=first.size) * np.abs(first)
        found = _fit(residual, slope, guess, target.size >= first.size, steps)
        reached = float(np.mean(residual(found) ** 2))
        if reached < value:
            best, value = found, reached
    trained = NNARX(unflatten(net.network, best), net.order, net.channels)
    return Trained(trained, Status.ATTAINED, value, "scipy", max(1, starts))


def _fit(
    residual: Callable[[Reals], Reals],
    slope: Callable[[Reals], Reals],
    guess: Reals,
    tall: bool,
    steps: int,
) -> Reals:
    method = "lm" if tall else "trf"
    return np.asarray(
        least_squares(
            residual, guess, slope, method=method, x_scale="jac", max_nfev=max(1, steps)
        ).x
    )
