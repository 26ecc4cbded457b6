"""Training of simulated models by optional libraries: IPOPT through casadi, and jax-sysid.

With IPOPT the problem is the constrained one of the notes (section 7.6): all simulated outputs or
states are unknowns and the network enters as equality constraints, which is multiple shooting with
a node at every sample. No gradient runs through time, so that none vanishes or explodes.

References
----------
H. G. Bock, K. J. Plitt, "A multiple shooting algorithm for direct solution of optimal control
problems", IFAC World Congress 1984.
A. Bemporad, "An L-BFGS-B approach for linear and nonlinear system identification under l1 and
group-Lasso regularization", IEEE Transactions on Automatic Control 70 (2025) (jax-sysid).
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from setid import IOData, ModelError
from setid.neural.models.network import Network
from setid.neural.models.recurrent import NeuralStateSpace
from setid.neural.models.regressor import NNARX, NNOE, check_record
from setid.neural.training.parameters import flatten, unflatten

__all__ = ["by_ipopt", "by_jax_sysid", "optional"]

Reals = NDArray[np.float64]
Model = NNARX | NNOE | NeuralStateSpace
Found = tuple[Any, Reals, float]


def optional(name: str, package: str) -> Any:
    """Import an optional package, or raise ``ImportError`` that says how to get it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ImportError(
            f"{name} is not installed; it is optional: pip install 'sparsepop-py[{package}]'"
        ) from error


def by_ipopt(net: Model, data: IOData, x0: ArrayLike | None, max_steps: int) -> Found:
    """Fit weights, initial state and trajectory of one record with IPOPT.

    Parameters
    ----------
    net : NNOE or NeuralStateSpace
    data : IOData
    x0 : array_like or None
    max_steps : int

    Returns
    -------
    net, x0, mean square
        Of the simulation with the weights found, not of the solver's trajectory.
    """
    ca = optional("casadi", "ipopt")
    check_record(data, net.channels, net.outputs, single=True)
    if np.any(np.isnan(data.y)):
        raise ModelError("data.y: found a missing reading, expected a complete record")
    if isinstance(net, NNOE):
        return _nnoe(ca, net, data, x0, max_steps)
    assert isinstance(net, NeuralStateSpace)
    return _state_space(ca, net, data, x0, max_steps)


def _symbolic(ca: Any, net: Network) -> Any:
    """The network as a casadi function of (weights, input)."""
    theta, x = ca.SX.sym("theta", net.parameters), ca.SX.sym("x", net.inputs)
    value, at = x, 0
    for w, name in zip(net.weights, net.activation, strict=True):
        rows, columns = w.shape
        weight = ca.reshape(theta[at : at + w.size], columns, rows).T
        value = weight @ value + theta[at + w.size : at + w.size + rows]
        value = _activation(ca, name, value, net.leak)
        at += w.size + rows
    return ca.Function("N", [theta, x], [value])


def _activation(ca: Any, name: str, x: Any, leak: float) -> Any:
    if name == "tanh":
        return ca.tanh(x)
    if name == "sigmoid":
        return 1.0 / (1.0 + ca.exp(-x))
    if name == "algebraic":
        return x / ca.sqrt(1.0 + x * x)
    if name == "relu":
        return ca.fmax(x, 0.0)
    return ca.fmax(x, leak * x) if name == "leaky_relu" else x


def _solve(ca: Any, problem: dict[str, Any], guess: Reals, max_steps: int) -> Reals:
    options = {
        "ipopt.print_level": 0,
        "print_time": False,
        "ipopt.sb": "yes",
        "ipopt.max_iter": int(max_steps),
        "ipopt.linear_solver": "mumps",
    }
    solver = ca.nlpsol("train", "ipopt", problem, options)
    return np.asarray(solver(x0=guess, lbg=0.0, ubg=0.0)["x"]).ravel()


def _nnoe(ca: Any, net: NNOE, data: IOData, x0: ArrayLike | None, max_steps: int) -> Found:
    n, ny, count = net.order, net.outputs, data.samples
    theta, y = ca.MX.sym("theta", net.parameters), ca.MX.sym("y", ny, count)
    past = [y[:, n - lag : count - lag] for lag in range(1, n + 1)]
    fed = [data.u[n - lag : count - lag].T for lag in range(n + 1)]
    phi = ca.vertcat(*past, *(ca.DM(part) for part in fed))
    steps = _symbolic(ca, net.network).map(count - n)(ca.repmat(theta, 1, count - n), phi)
    scale = np.std(data.y, axis=0) + 1e-12
    rest = (y - data.y.T) / np.repeat(scale[:, None], count, axis=1)
    problem = {
        "x": ca.vertcat(theta, ca.vec(y)),
        "f": ca.sumsqr(rest) / count,
        "g": ca.vec(y[:, n:] - steps),
    }
    guess = np.array(data.y)
    if x0 is not None:
        guess[:n] = net.start(x0)
    found = _solve(ca, problem, np.concatenate([flatten(net.network), guess.ravel()]), max_steps)
    inner = unflatten(net.network, found[: net.parameters])
    first = found[net.parameters :].reshape(count, ny)[:n]
    trained = NNOE(inner, n, net.channels)
    return trained, first.ravel(), _attained(trained, data, first)


def _state_space(
    ca: Any, net: NeuralStateSpace, data: IOData, x0: ArrayLike | None, max_steps: int
) -> Found:
    n, count, split = net.states, data.samples, net.transition.parameters
    theta, x = ca.MX.sym("theta", net.parameters), ca.MX.sym("x", n, count)
    both = ca.vertcat(ca.DM(data.u.T), x)
    steps = _symbolic(ca, net.transition).map(count)(ca.repmat(theta[:split], 1, count), both)
    shown = _symbolic(ca, net.output).map(count)(ca.repmat(theta[split:], 1, count), both)
    scale = np.std(data.y, axis=0) + 1e-12
    rest = (shown - data.y.T) / np.repeat(scale[:, None], count, axis=1)
    problem = {
        "x": ca.vertcat(theta, ca.vec(x)),
        "f": ca.sumsqr(rest) / count,
        "g": ca.vec(x[:, 1:] - steps[:, :-1]),
    }
    state = net.start(np.zeros(n) if x0 is None else x0)
    path = [state]
    for t in range(count - 1):
        state = np.clip(np.nan_to_num(net.step(state, data.u[t])[0]), -1e3, 1e3)
        path.append(state)
    weights = np.concatenate([flatten(net.transition), flatten(net.output)])
    found = _solve(ca, problem, np.concatenate([weights, np.ravel(path)]), max_steps)
    trained = NeuralStateSpace(
        unflatten(net.transition, found[:split]),
        unflatten(net.output, found[split : net.parameters]),
    )
    first = found[net.parameters : net.parameters + n]
    return trained, first, _attained(trained, data, first)


def _attained(net: Any, data: IOData, x0: Reals) -> float:
    with np.errstate(all="ignore"):
        value = float(np.mean((net.simulate(data, x0) - data.y) ** 2))
    return value if np.isfinite(value) else np.inf


def by_jax_sysid(net: Model, data: IOData, x0: ArrayLike | None, max_steps: int) -> Found:
    """Fit a neural state space to one record with jax-sysid (Adam, then L-BFGS).

    Parameters
    ----------
    net : NeuralStateSpace
    data : IOData
    x0 : array_like or None
    max_steps : int
        Of L-BFGS; Adam takes as many.
    """
    jnp = optional("jax.numpy", "jax-sysid")
    models = optional("jax_sysid.models", "jax-sysid")
    optional("jax", "jax-sysid").config.update("jax_enable_x64", True)
    check_record(data, net.channels, net.outputs, single=True)
    assert isinstance(net, NeuralStateSpace)
    parts = [net.transition, net.output]
    sizes = [2 * len(part.weights) for part in parts]

    def evaluate(part: Network, params: Any, x: Any, u: Any) -> Any:
        value = jnp.hstack([u, x])
        for i, name in enumerate(part.activation):
            value = _by_jax(jnp, name, params[2 * i] @ value + params[2 * i + 1], part.leak)
        return value

    model = models.Model(
        net.states,
        net.outputs,
        net.channels,
        state_fcn=lambda x, u, params: evaluate(parts[0], params[: sizes[0]], x, u),
        output_fcn=lambda x, u, params: evaluate(parts[1], params[sizes[0] :], x, u),
    )
    params = [
        np.array(a)
        for part in parts
        for pair in zip(part.weights, part.biases, strict=True)
        for a in pair
    ]
    state = net.start(np.zeros(net.states) if x0 is None else x0)
    model.init(params=params, x0=np.array(state))
    model.loss(rho_x0=1e-6, rho_th=1e-6, train_x0=True)
    model.optimization(adam_epochs=max_steps, lbfgs_epochs=max_steps, iprint=-1)
    model.fit(np.array(data.y), np.array(data.u))
    values = [np.asarray(p, float) for p in model.params]
    trained = NeuralStateSpace(
        *(
            Network(part[0::2], part[1::2], given.activation, given.leak)
            for part, given in zip((values[: sizes[0]], values[sizes[0] :]), parts, strict=True)
        )
    )
    first = np.asarray(model.x0, float).ravel()
    return trained, first, _attained(trained, data, first)


def _by_jax(jnp: Any, name: str, x: Any, leak: float) -> Any:
    if name == "tanh":
        return jnp.tanh(x)
    if name == "sigmoid":
        return 0.5 * (1.0 + jnp.tanh(0.5 * x))
    if name == "algebraic":
        return x / jnp.sqrt(1.0 + x * x)
    if name == "relu":
        return jnp.maximum(x, 0.0)
    return jnp.maximum(x, leak * x) if name == "leaky_relu" else x
