"""Proved training against enumeration of all patterns, planted networks and random search."""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from interrupted_programs import InterruptedPrograms
from scipy.optimize import linprog
from slow_values import slow_after

import setid
import sparsepop_py as sp
from setid import neural
from setid.neural.training import train_proved as searches


def record(rows: int, seed: int = 0, noise: float = 0.1) -> setid.IOData:
    rng = np.random.default_rng(seed)
    u, y = rng.uniform(-1, 1, size=rows + 1), np.zeros(rows + 1)
    for t in range(1, rows + 1):
        inside = 0.5 * y[t - 1] + u[t] - 0.3 * u[t - 1] + 0.2
        y[t] = max(0.0, inside) - 0.1 + noise * rng.uniform(-1, 1)
    return setid.IOData(u, y)


def structure(width: int, activation: str) -> neural.NNARX:
    net = neural.Network(
        [np.ones((width, 3)), np.ones((1, width))], [np.zeros(width), [0.0]], activation, leak=0.2
    )
    return neural.NNARX(net, 1)


def regressors(data: setid.IOData) -> tuple[np.ndarray, np.ndarray]:
    return np.column_stack([data.y[:-1], data.u[1:], data.u[:-1]]), data.y[1:, 0]


def enumerated(data: setid.IOData, width: int, leak: float, reach: float) -> float:
    """Least error over all activation patterns, each a linear program in (w, b, c, D)."""
    phi, y = regressors(data)
    full, best = np.column_stack([phi, np.ones(len(y))]), np.inf
    for signs in {tuple(sorted(s, reverse=True)) for s in product([1.0, -1.0], repeat=width)}:
        for pattern in product([0, 1], repeat=width * len(y)):
            on = np.array(pattern).reshape(len(y), width)
            output = np.hstack(
                [s * np.where(on[:, [j]] == 1, 1.0, leak) * full for j, s in enumerate(signs)]
            )
            sides = [
                np.hstack([np.zeros((len(y), 4 * j)), np.where(on[:, [j]] == 1, -1.0, 1.0) * full,
                           np.zeros((len(y), 4 * (width - j - 1) + 2))]) for j in range(width)
            ]  # fmt: skip
            one = np.ones((len(y), 1))
            rows = np.vstack([np.hstack([output, one, -one]), np.hstack([-output, -one, -one])])
            found = linprog(
                np.append(np.zeros(4 * width + 1), 1.0),
                np.vstack([rows, *sides]),
                np.concatenate([y, -y, np.zeros(width * len(y))]),
                bounds=[(-reach, reach)] * (4 * width) + [(None, None), (0, None)],
            )
            if found.status == 0:
                best = min(best, found.fun)
    return best


@pytest.mark.parametrize("seed", slow_after(1, range(3)))
@pytest.mark.parametrize("activation", ["relu", "leaky_relu"])
def test_one_neuron_against_enumeration(seed: int, activation: str) -> None:
    data = record(6, seed, noise=0.5)
    found = neural.train_proved(structure(1, activation), data, weights=3.0)
    expected = enumerated(data, 1, 0.2 if activation == "leaky_relu" else 0.0, 3.0)
    assert found.status == "proved" and found.verify()
    assert found.lower_bound <= expected * (1 + 1e-7) + 1e-9
    assert found.upper_bound >= expected * (1 - 1e-7) - 1e-9
    assert found.upper_bound == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("activation", ["relu", "leaky_relu"])
def test_the_engine_against_enumeration(activation: str) -> None:
    data = record(5, 1, noise=0.5)
    expected = enumerated(data, 1, 0.2 if activation == "leaky_relu" else 0.0, 3.0)
    found = neural.train_proved(structure(1, activation), data, weights=3.0, method="engine")
    assert found.lower_bound <= expected * (1 + 1e-7) + 1e-9
    assert found.upper_bound == pytest.approx(expected, abs=1e-4)
    assert found.status == "proved" and found.verify()
    assert not replace(found, lower_bound=expected * 1.01).verify()
    assert not replace(found, cap=0.5 * found.cap).verify()


@pytest.mark.parametrize("rows", [15, 40])
def test_the_engine_proves_what_patterns_prove(rows: int) -> None:
    data = record(rows)
    by_patterns = neural.train_proved(structure(1, "relu"), data, weights=3.0)
    found = neural.train_proved(structure(1, "relu"), data, weights=3.0, method="engine")
    assert found.status == "proved" and found.verify()
    assert found.lower_bound == pytest.approx(by_patterns.lower_bound, abs=2e-6)
    assert (
        found.lower_bound <= by_patterns.upper_bound
        and by_patterns.lower_bound <= found.upper_bound
    )


@pytest.mark.slow
def test_the_engine_proves_two_neurons() -> None:
    by_patterns = neural.train_proved(structure(2, "relu"), record(10), weights=3.0)
    found = neural.train_proved(structure(2, "relu"), record(10), weights=3.0, method="engine")
    assert found.status == by_patterns.status == "proved" and found.verify()
    assert found.lower_bound <= by_patterns.upper_bound
    assert by_patterns.lower_bound <= found.upper_bound


def test_the_engine_is_not_asked_where_a_network_is_exact() -> None:
    """Ten weights fit six rows: the least error is 0."""
    found = neural.train_proved(structure(2, "relu"), record(6), weights=3.0, method="engine")
    assert found.status == "proved" and found.verify() and found.nodes == 0
    assert found.lower_bound == 0.0 <= found.upper_bound < 1e-12


def test_solve_alone_proves_the_global_optimum_of_training() -> None:
    """No limit from simulated weights: the error of the best constant is the largest error."""
    from setid.neural.training.engine import training_problem

    data = record(15)
    phi, y = regressors(data)
    least = neural.train_proved(structure(1, "relu"), data, weights=3.0)
    problem = training_problem(phi, y, [1.0], 0.0, 3.0, 20.0, float(np.ptp(y) / 2)).problem
    result = sp.solve(problem, sp.Options(effort="auto"))
    assert result.status is sp.Status.OPTIMAL and result.certificate.verify(problem)
    assert result.upper_bound == pytest.approx(least.upper_bound, abs=2e-6)


def test_points_of_the_training_problem_come_from_weights() -> None:
    from setid.neural.training.engine import training_problem

    data = record(8, 2, noise=0.5)
    phi, y = regressors(data)
    for leak in (0.0, 0.25):
        item = training_problem(phi, y, [1.0, -1.0], leak, 3.0, 5.0, 10.0)
        w, b = np.array([[1.0, 0.5, -0.5], [0.25, -1.0, 2.0]]), np.array([0.5, -0.25])
        x = item.point(w, b)
        assert item.problem.violation(x) < 1e-12
        z = phi @ w.T + b
        out = np.where(z > 0, z, leak * z) @ [1.0, -1.0]
        assert x[9] == pytest.approx(np.ptp(y - out) / 2, rel=1e-12)
    assert training_problem(phi, y, [1.0], 0.0, 3.0, 5.0, 1e-9).point(w[:1], b[:1]) is None


def test_the_engine_refuses_other_activations() -> None:
    with pytest.raises(setid.ModelError, match="relu"):
        neural.train_proved(structure(1, "tanh"), record(5), method="engine")
    with pytest.raises(setid.ModelError, match="patterns"):
        neural.train_proved(structure(1, "relu"), record(5), method="other")


@pytest.mark.slow
def test_two_neurons_against_enumeration() -> None:
    data = record(5, 1, noise=1.0)
    found = neural.train_proved(structure(2, "relu"), data, weights=3.0, time_limit=1e6)
    expected = enumerated(data, 2, 0.0, 3.0)
    assert found.lower_bound <= expected + 1e-9 <= found.upper_bound + 2e-4
    assert found.status == "proved" and found.verify()


def test_identity_is_a_linear_fit() -> None:
    """|y - phi w - c| <= D: for y = t^2 at t = 0, 1, 2 and one regressor t, D = 1/4 by hand."""
    u = np.array([0.0, 0.0, 1.0, 2.0])
    data = setid.IOData(u, [0.0, 0.0, 1.0, 4.0])
    net = neural.Network([[[0.0, 1.0, 0.0]], [[1.0]]], [[0.0], [0.0]], "identity")
    found = neural.train_proved(neural.NNARX(net, 1), data)
    # with all three regressors and a constant the three rows are met exactly
    assert found.upper_bound < 1e-9 and found.lower_bound == 0.0 and found.verify()


def test_identity_against_a_linear_program() -> None:
    data = record(30, noise=0.3)
    phi, y = regressors(data)
    found = neural.train_proved(structure(1, "identity"), data)
    one = np.ones((len(y), 1))
    expected = linprog(
        [0.0] * 4 + [1.0],
        np.block([[phi, one, -one], [-phi, -one, -one]]),
        np.append(y, -y),
        bounds=[(None, None)] * 4 + [(0, None)],
    ).fun
    assert found.status == "proved" and found.verify()
    assert found.lower_bound <= expected + 1e-9 and found.upper_bound >= expected - 1e-9


def test_fifteen_and_a_hundred_samples_end() -> None:
    for rows in (15, 100):
        found = neural.train_proved(structure(1, "relu"), record(rows))
        assert found.status == "proved" and found.verify()
        # the plant itself is a member with errors of at most 0.1
        assert found.lower_bound <= 0.1


@pytest.mark.parametrize("activation", slow_after(1, ["tanh", "sigmoid", "algebraic"]))
def test_smooth_networks_against_random_search(activation: str) -> None:
    data = record(6, noise=0.5)
    phi, y = regressors(data)
    found = neural.train_proved(
        structure(1, activation), data, weights=2.0, nodes=200, time_limit=1e6
    )
    assert found.verify() and found.lower_bound <= found.upper_bound
    rng, function = np.random.default_rng(0), {
        "tanh": np.tanh, "sigmoid": lambda a: 1 / (1 + np.exp(-a)),
        "algebraic": lambda a: a / np.sqrt(1 + a * a)}[activation]  # fmt: skip
    w = rng.uniform(-2, 2, size=(4, 20000))
    z = function(phi @ w[:3] + w[3])
    rest = y[:, None] - z * rng.uniform(0, 2, size=20000)
    assert found.lower_bound <= 0.5 * np.min(rest.max(axis=0) - rest.min(axis=0)) + 1e-12


@pytest.mark.slow
def test_smooth_bounds_are_not_vacuous() -> None:
    found = neural.train_proved(
        structure(1, "tanh"), record(12), weights=3.0, nodes=1500, time_limit=1e6
    )
    assert found.lower_bound > 0.0 and found.verify()


def test_bounds_hold_when_the_search_is_cut_short() -> None:
    found = neural.train_proved(structure(3, "relu"), record(12), nodes=60)
    assert found.status == "partial" and found.verify()
    assert 0.0 <= found.lower_bound < found.upper_bound


def test_forged_optima_are_found() -> None:
    found = neural.train_proved(structure(1, "relu"), record(10, noise=0.3))
    assert not replace(found, lower_bound=found.lower_bound * 1.01 + 1e-3).verify()
    assert not replace(found, upper_bound=found.upper_bound * 0.9).verify()
    assert not replace(found, weights=100.0).verify() or found.lower_bound == 0.0
    assert not replace(found, trees={}).verify()
    assert not replace(found, weights=0.01).verify()
    assert not replace(found, data=record(10, 5, noise=0.01)).verify()


@pytest.mark.parametrize(
    ("net", "text"),
    [
        (neural.NNARX(neural.Network([[[1.0, 0, 0]]], [[0.0]]), 1), "expected one hidden layer"),
        (
            neural.NNARX(neural.Network([np.ones((1, 4)), np.ones((2, 1))], [[0], [0, 0]]), 1, 1),
            "one output",
        ),
    ],
)
def test_other_structures_are_refused(net, text: str) -> None:
    data = setid.IOData(np.arange(5.0), np.arange(5.0 * net.outputs).reshape(5, -1))
    with pytest.raises(setid.ModelError, match=text):
        neural.train_proved(net, data)
    with pytest.raises(setid.ModelError, match="weights: found 0"):
        neural.train_proved(structure(1, "relu"), record(4), weights=0)


# ---- envelopes ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["tanh", "sigmoid", "algebraic"])
@pytest.mark.parametrize(("pieces", "degree"), [(1, 7), (4, 5), (20, 3)])
def test_envelopes_are_never_crossed(name: str, pieces: int, degree: int) -> None:
    found = neural.envelope(name, -6.0, 6.0, pieces, degree)
    assert found.verify()
    x = np.linspace(-6, 6, 1_000_001)
    truth = {"tanh": np.tanh, "sigmoid": lambda a: 1 / (1 + np.exp(-a)),
             "algebraic": lambda a: a / np.sqrt(1 + a * a)}[name](x)  # fmt: skip
    gap = np.max(np.abs(found(x) - truth))
    assert gap <= found.eps + 1e-14
    assert found.eps <= 1.2 * gap + 2e-5  # and not loose
    assert not replace(found, eps=0.9 * gap).verify()


def test_envelopes_of_fewer_pieces_than_breaks_are_found() -> None:
    """The first polynomial alone is far from tanh on the pieces without one."""
    found = neural.envelope("tanh", -2.0, 2.0, 4)
    first = replace(found, coefficients=found.coefficients[:1], centres=found.centres[:1])
    assert abs(first(2.0) - np.tanh(2.0)) > 1.0 > found.eps
    gone = found.coefficients.copy()
    gone[2] = np.nan
    forged = [
        first,
        replace(found, coefficients=gone),
        replace(found, centres=found.centres[:3]),
        replace(found, breaks=found.breaks[::-1].copy()),
        replace(found, breaks=found.breaks[:1], centres=np.zeros(0), coefficients=gone[:0]),
        replace(found, cells=0),
        replace(found, cells=1_000_001),  # a billion once took all memory of the machine
        replace(found, name="relu"),
    ]
    assert found.verify() and not any(item.verify() for item in forged)


def test_wrong_envelopes_are_refused() -> None:
    with pytest.raises(setid.ModelError, match="name: found 'relu'"):
        neural.envelope("relu", -1, 1)
    with pytest.raises(setid.ModelError, match="expected finite low < high"):
        neural.envelope("tanh", 1, 1)


def long_record(samples: int) -> setid.IOData:
    rng = np.random.default_rng(0)
    u, y = rng.uniform(-1, 1, samples), np.zeros(samples)
    for t in range(1, samples):
        y[t] = 0.5 * y[t - 1] + 0.8 * np.tanh(u[t - 1])
    return setid.IOData(u, y + rng.uniform(-0.02, 0.02, samples))


@pytest.mark.parametrize(
    ("activation", "method"),
    [("relu", "patterns"), ("relu", "engine"), ("relu", "hidden"), ("tanh", "hidden")],
)
def test_long_records_keep_the_time_limit(activation: str, method: str) -> None:
    """Programs of 2 000 samples and 2 neurons, of which one alone takes longer than the limit."""
    data = long_record(2000)
    net = neural.initial(data, order=1, widths=[2], activation=activation)
    begin = time.process_time()
    if method == "hidden":
        found = neural.hidden_weights(net, data, 0.3, weights=3.0, time_limit=0.5)
    else:
        found = neural.train_proved(net, data, weights=3.0, time_limit=0.5, method=method)
    assert time.process_time() - begin < 2.0
    assert found.verify()


@pytest.mark.parametrize("width", [1, 2, 3])
def test_neurons_of_identity_add_up(width: int) -> None:
    """Together they have weights up to ``width`` times the bound: a linear program with those."""
    data = record(12)
    data = setid.IOData(data.u, 2.5 * data.u[:, 0] + data.y[:, 0])
    phi, y = regressors(data)
    found = neural.train_proved(structure(width, "identity"), data, weights=1.0)
    one = np.ones((len(y), 1))
    expected = linprog(
        [0.0] * 5 + [1.0],
        np.block([[phi, one, one, -one], [-phi, -one, -one, -one]]),
        np.append(y, -y),
        bounds=[(-width, width)] * 4 + [(None, None), (0, None)],
    ).fun
    assert found.status == "proved" and found.verify()
    assert found.lower_bound <= expected + 1e-9 and found.upper_bound >= expected - 1e-9
    assert not replace(found, lower_bound=expected * 1.01 + 1e-3).verify()


def test_sigmoid_networks_stay_inside_when_signs_are_moved() -> None:
    """-s(a) is s(-a) - 1: two neurons move an output bias of .54 to -1.46, beyond 1 + max |y|."""
    u = np.linspace(-0.4, 0.4, 5)
    inner = np.array([[0.0, 0.5, 0.0]] * 2)
    given = neural.Network([inner, [[-1.0, -1.0]]], [[-1.0, -1.0], [0.54]], "sigmoid")
    moved = neural.Network([-inner, [[1.0, 1.0]]], [[1.0, 1.0], [-1.46]], "sigmoid")
    phi = np.column_stack([np.zeros(5), u, u])
    data = setid.IOData(u, given(phi)[:, 0])
    assert np.allclose(moved(phi), given(phi), atol=1e-12) and np.max(np.abs(data.y)) < 0.4
    net = neural.NNARX(moved, 1)
    found = neural.train_proved(net, data, weights=1.0, nodes=1)
    error = float(neural.equation_error(net, data).upper_bound[0])
    own = replace(found, net=net, upper_bound=error)
    assert error < 1e-12 and found.lower_bound <= error
    assert "outside" not in own.verify().reason
    program = searches._boxes(moved, phi[1:], data.y[1:, 0], 1.0, found.cap)
    assert program.columns(program.root())[0][-2] <= -1.46  # of the output bias


def test_proofs_are_about_their_structure_alone() -> None:
    data = record(6, noise=0.5)
    found = neural.train_proved(structure(1, "relu"), data, weights=3.0)
    given = found.net.network
    layers = [*given.weights, [[1.0]]], [*given.biases, [0.0]]
    others = [
        neural.Network(*layers, "relu"),
        neural.Network(given.weights, given.biases, ["relu", "tanh"]),
    ]
    for other in others:
        net = neural.NNARX(other, 1)
        upper = float(neural.equation_error(net, data).upper_bound[0])
        for status in neural.Status.PROVED, neural.Status.PARTIAL:
            forged = replace(found, net=net, upper_bound=upper, status=status)
            assert "one hidden layer" in forged.verify().reason
    assert "followed" in replace(found, cap=np.nan).verify().reason


@pytest.mark.parametrize(("activation", "method"), [
    ("relu", "patterns"), ("tanh", "patterns"), ("relu", "engine"),
])  # fmt: skip
def test_interrupts_keep_what_is_proved(
    activation: str, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = record(6, noise=0.5)
    given = structure(1, activation), data, 3.0
    whole = neural.train_proved(*given, nodes=40, method=method)
    programs = InterruptedPrograms(monkeypatch)
    for last in (3, 4, 7, 8):
        programs.interrupt(last)
        found = neural.train_proved(*given, nodes=40, method=method)
        assert found.verify() and found.lower_bound <= whole.upper_bound
        assert programs.count <= last or method == "engine"


def test_envelopes_of_constants_are_refused() -> None:
    found = neural.envelope("tanh", -1.0, 1.0)
    assert not replace(found, coefficients=found.coefficients[:, :1]).verify()
