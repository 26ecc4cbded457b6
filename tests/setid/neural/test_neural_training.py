"""Training is a thin call: planted networks are found, labels say attained, Jacobians are right."""

from __future__ import annotations

import numpy as np
import pytest

import setid
from setid import neural
from setid.neural.training.parameters import flatten, unflatten
from setid.neural.training.train import _jacobian

PEER = "optional: casadi or jax-sysid"


def planted(samples: int = 120, noise: float = 0.0) -> setid.IOData:
    rng = np.random.default_rng(0)
    u, y = rng.uniform(-2, 2, size=samples), np.zeros(samples)
    for t in range(1, samples):
        y[t] = 0.5 * y[t - 1] + np.tanh(u[t - 1] - 0.3 * y[t - 1])
    return setid.IOData(u, y + noise * rng.uniform(-1, 1, size=samples))


@pytest.mark.parametrize("activation", ["tanh", "sigmoid", "algebraic", "leaky_relu", "relu"])
def test_jacobian_against_differences(activation: str) -> None:
    rng = np.random.default_rng(1)
    net = neural.Network(
        [rng.normal(size=s) for s in ((4, 3), (3, 4), (2, 3))],
        [rng.normal(size=s) for s in (4, 3, 2)],
        activation,
    )
    phi, theta = rng.normal(size=(7, 3)), flatten(net)
    found = _jacobian(net, phi)
    for k in range(theta.size):
        step = np.zeros(theta.size)
        step[k] = 1e-6
        slope = (unflatten(net, theta + step)(phi) - unflatten(net, theta - step)(phi)) / 2e-6
        np.testing.assert_allclose(found[:, :, k], slope, atol=1e-7)


def test_weights_survive_flattening() -> None:
    rng = np.random.default_rng(1)
    net = neural.Network([rng.normal(size=(4, 3)), rng.normal(size=(1, 4))], [np.ones(4), [2.0]])
    np.testing.assert_array_equal(unflatten(net, flatten(net))(np.ones(3)), net(np.ones(3)))


def test_least_squares_finds_a_planted_network() -> None:
    data = planted()
    found = neural.train(neural.initial(data, 1, [3]), data, starts=3)
    assert found.status == "attained" and found.method == "scipy"
    assert found.attained < 1e-6
    again = np.mean((found.net.one_step(data) - data.y)[1:] ** 2)
    assert found.attained == pytest.approx(again, rel=1e-9)


def test_training_is_repeatable() -> None:
    data = planted(60)
    first = neural.train(neural.initial(data, 1, [2]), data, starts=2, seed=3)
    second = neural.train(neural.initial(data, 1, [2]), data, starts=2, seed=3)
    assert first.attained == second.attained


def test_wrong_methods_are_refused() -> None:
    data = planted(30)
    net = neural.initial(data, 1, [2])
    with pytest.raises(setid.ModelError, match="method: found 'adam'"):
        neural.train(net, data, method="adam")
    with pytest.raises(setid.ModelError, match="expected NNOE or NeuralStateSpace for 'ipopt'"):
        neural.train(net, data, method="ipopt")
    with pytest.raises(setid.ModelError, match="activation: found 'swish'"):
        neural.initial(data, 1, [2], activation="swish")


@pytest.mark.slow
def test_ipopt_fits_simulations() -> None:
    pytest.importorskip("casadi", reason=PEER)
    data = planted(120, noise=0.01)
    net = neural.initial(data, 1, [3], kind=neural.NNOE)
    first = neural.train(neural.initial(data, 1, [3]), data).net.network
    found = neural.train(neural.NNOE(first, 1), data)
    assert found.method == "ipopt" and found.attained < 1e-4
    assert found.net.parameters == net.parameters


def small_state_space() -> neural.NeuralStateSpace:
    rng = np.random.default_rng(2)
    return neural.NeuralStateSpace(
        neural.Network([0.5 * rng.normal(size=(4, 2)), 0.5 * rng.normal(size=(1, 4))],
                       [np.zeros(4), [0.0]]),
        neural.Network([[[0.0, 1.0]]], [[0.0]]),
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("method", "package"), [("ipopt", "casadi"), ("jax-sysid", "jax_sysid")])
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # those of jax-sysid
def test_state_spaces_are_fitted(method: str, package: str) -> None:
    pytest.importorskip(package, reason=PEER)
    data, net = planted(120, noise=0.01), small_state_space()
    before = np.mean((net.simulate(data) - data.y) ** 2)
    found = neural.train(net, data, method=method)
    assert found.status == "attained" and found.attained < 0.05 * before
    again = np.mean((found.net.simulate(data, found.x0) - data.y) ** 2)
    assert found.attained == pytest.approx(again, rel=1e-9)
