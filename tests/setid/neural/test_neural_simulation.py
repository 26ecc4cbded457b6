"""Simulation bands and output errors against closed forms, sampled states and grids."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from interrupted_programs import InterruptedPrograms
from slow_values import slow_after, slow_unless

import setid
from setid import neural
from setid.neural.arithmetic import Interval, enclose
from setid.neural.simulations.forms import Form, activation

RNG = np.random.default_rng


def gates(rng, n: int, size: float, count: int) -> list[tuple]:
    shapes = ((size, (n, 1)), (size, (n, n)), (0.3, n))
    return [tuple(s * rng.normal(size=shape) for s, shape in shapes) for _ in range(count)]


def dense(rng, size: float, *sizes: int) -> neural.Network:
    pairs = zip(sizes[1:], sizes[:-1], strict=True)
    return neural.Network(
        [size * rng.normal(size=p) for p in pairs], [0.2 * rng.normal(size=s) for s in sizes[1:]]
    )


def network(kind: str, seed: int = 0):
    rng = RNG(seed)
    last = (rng.normal(size=(1, 3)), [0.1])
    if kind == "elman":
        shapes = (((3, 1), 0.4), ((3, 3), 0.3))
        layers = [
            (rng.normal(size=shape), size * rng.normal(size=(3, 3)), rng.normal(size=3))
            for shape, size in shapes
        ]
        return neural.Elman(layers, last)
    if kind == "lstm":
        return neural.LSTM(*gates(rng, 3, 0.4, 4), last)
    if kind in ("before", "after"):
        parts = gates(rng, 3, 0.5, 3)
        if kind == "after":
            parts[2] = (*parts[2], rng.normal(size=3))
        return neural.GRU(*parts, last, reset=kind)
    if kind == "nss":
        return neural.NeuralStateSpace(dense(rng, 0.4, 3, 6, 2), dense(rng, 0.7, 3, 4, 1))
    return neural.NNOE(dense(rng, 0.45, 5, 6, 1), 2)


KINDS = ["elman", "lstm", "before", "after", "nss", "nnoe"]


@pytest.mark.parametrize(
    ("kind", "width"),
    slow_unless(
        lambda kind, width: width == (0.0 if kind == "nss" else 0.9 if kind == "before" else 0.1),
        [(kind, width) for kind in KINDS for width in (0.0, 0.1, 0.9)],
    ),
)
def test_sampled_states_stay_inside(kind: str, width: float) -> None:
    net, rng = network(kind), RNG(1)
    data = setid.IOData(rng.uniform(-1, 1, size=60), np.zeros(60))
    found = neural.simulate_band(net, data, np.tile([-width, width], (net.states, 1)))
    assert found.status == "proved" and found.blown_up is None and found.verify()
    corners = [width * rng.choice([-1.0, 1.0], size=net.states) for _ in range(20)]
    for x0 in [*corners, *(rng.uniform(-width, width, size=net.states) for _ in range(20))]:
        y = net.simulate(data, x0)
        assert np.all(y >= found.low - 1e-12) and np.all(y <= found.high + 1e-12)
    if width == 0.0:
        assert np.max(found.width) < 1e-11


def test_a_band_of_width_zero_holds_the_truth_of_arbitrary_precision() -> None:
    net = network("elman")
    data = setid.IOData(RNG(1).uniform(-1, 1, size=25), np.zeros(25))
    found = neural.simulate_band(net, data)
    with mpmath.workdps(40):
        h = [mpmath.matrix([0] * 3), mpmath.matrix([0] * 3)]
        for t in range(25):
            x = mpmath.matrix([mpmath.mpf(data.u[t, 0])])
            for i, (w, v, b) in enumerate(net.layers):
                s = mpmath.matrix(w.tolist()) * x + mpmath.matrix(v.tolist()) * h[i]
                h[i] = x = mpmath.matrix([mpmath.tanh(s[k] + mpmath.mpf(b[k])) for k in range(3)])
            y = (mpmath.matrix(net.output.weights[0].tolist()) * x)[0] + mpmath.mpf(
                net.output.biases[0][0]
            )
            assert mpmath.mpf(found.low[t, 0]) <= y <= mpmath.mpf(found.high[t, 0])


def test_linear_networks_are_enclosed_exactly() -> None:
    """x+ = [[0, 1], [-0.9, 0.5]] x turns: intervals would grow by 1.4 a step, the truth shrinks."""
    a = np.array([[0.0, 1.0], [-0.9, 0.5]])
    net = neural.NeuralStateSpace(
        neural.Network([np.hstack([np.zeros((2, 1)), a])], [[0.0, 0.0]]),
        neural.Network([[[0.0, 1.0, 0.0]]], [[0.0]]),
    )
    data = setid.IOData(np.zeros(80), np.zeros(80))
    found = neural.simulate_band(net, data, [[-1.0, 1.0], [-1.0, 1.0]])
    for t in range(80):
        row = np.linalg.matrix_power(a, t)[0]
        assert found.high[t, 0] == pytest.approx(np.abs(row).sum(), rel=1e-9)
        assert found.high[t, 0] >= np.abs(row).sum() * (1 - 1e-13)


def test_growth_is_reported() -> None:
    net = neural.Elman([([[0.0]], [[2.0]], [0.0])], ([[1.0]], [0.0]), "identity")
    data = setid.IOData(np.zeros(60), np.zeros(60))
    found = neural.simulate_band(net, data, [[-1.0, 1.0]])
    assert found.status == "open" and found.verify()
    # the state is followed to a width of 1e8 < 2^27
    assert found.blown_up == 27
    assert found.high[26, 0] == pytest.approx(2.0**27, rel=1e-12)


def test_contractive_networks_forget_their_initial_state() -> None:
    net = network("elman")
    assert neural.stability(net).status == "stable"
    data = setid.IOData(RNG(3).uniform(-1, 1, size=200), np.zeros(200))
    found = neural.simulate_band(net, data, np.tile([-1.0, 1.0], (6, 1)))
    assert found.width[0] > 1.0 and np.all(found.width[150:] < 1e-9)


def test_regressor_networks_start_from_readings() -> None:
    net = network("nnoe")
    data = setid.IOData(RNG(4).uniform(-1, 1, size=20), RNG(5).uniform(-1, 1, size=20))
    found = neural.simulate_band(net, data)
    np.testing.assert_allclose(found.low, net.simulate(data), atol=1e-12)


def test_forged_bands_are_found() -> None:
    net = network("nss")
    data = setid.IOData(RNG(4).uniform(-1, 1, size=20), np.zeros(20))
    found = neural.simulate_band(net, data, [[-0.1, 0.1]] * 2)
    assert not replace(found, low=found.low + 1e-9).verify()
    assert not replace(found, high=found.high - 1e-9).verify()
    assert not replace(found, net=network("nss", 1)).verify()


def test_wrong_states_are_refused() -> None:
    net, data = network("nss"), setid.IOData([1.0, 2.0], [0.0, 0.0])
    with pytest.raises(setid.ModelError, match=r"x0: found shape \(3,\), expected \(2,\)"):
        neural.simulate_band(net, data, [1.0, 2.0, 3.0])
    with pytest.raises(setid.ModelError, match="lower end above"):
        neural.simulate_band(net, data, [[1.0, 0.0], [0.0, 0.0]])
    with pytest.raises(setid.ModelError, match="x0.*found nan"):
        neural.simulate_band(net, data, [np.nan, 0.0])
    with pytest.raises(setid.DataError, match="found 2 records, expected one"):
        neural.simulate_band(net, setid.IOData.concat([data, data]))
    with pytest.raises(setid.ModelError, match="found 6 open entries, expected at most 4"):
        neural.output_error(network("elman"), data, [[-1.0, 1.0]] * 6)


# ---- least output errors --------------------------------------------------------------------


def test_linear_output_error_in_closed_form() -> None:
    """y = x0 / 2, x0 / 4, x0 / 8 against 1.5, 0.5, 0.5: by hand x0 = 8 / 3 and D = 1 / 6."""
    net = neural.Elman([([[1.0]], [[0.5]], [0.0])], ([[1.0]], [0.0]), "identity")
    found = neural.output_error(net, setid.IOData(np.zeros(3), [1.5, 0.5, 0.5]), [[-9.0, 9.0]])
    assert found.status == "proved" and found.verify()
    assert found.lower_bound <= 1 / 6 <= found.upper_bound
    assert found.upper_bound - found.lower_bound < 1e-3
    assert found.x0[0] == pytest.approx(8 / 3, rel=1e-2)


@pytest.mark.parametrize("kind", slow_after(1, ["nnoe", "nss"]))
def test_output_error_against_a_grid(kind: str) -> None:
    """Two open entries: a grid of 101 x 101 states never falls below the proved bound."""
    net, rng = network(kind), RNG(6)
    data = setid.IOData(rng.uniform(-1, 1, size=15), np.zeros(15))
    y = net.simulate(data, [0.3, -0.4]) + rng.uniform(-0.02, 0.02, size=(15, 1))
    data = setid.IOData(data.u, y)
    found = neural.output_error(net, data, [[-1.0, 1.0]] * 2, tolerance=0.02, nodes=150)
    assert found.status == "proved" and found.verify()
    grid = np.linspace(-1, 1, 41)
    least = min(np.max(np.abs(net.simulate(data, [a, b]) - y)) for a in grid for b in grid)
    assert found.lower_bound <= least * (1 + 1e-12)
    assert found.upper_bound <= min(least, 0.02) * 1.03
    assert np.max(np.abs(net.simulate(data, found.x0) - y)) <= found.upper_bound


def test_a_known_state_leaves_nothing_to_search() -> None:
    net = network("lstm")
    data = setid.IOData(RNG(7).uniform(-1, 1, size=10), np.zeros(10))
    found = neural.output_error(net, data, np.zeros(6))
    truth = np.max(np.abs(net.simulate(data)))
    assert found.lower_bound == pytest.approx(truth, abs=1e-12)
    assert found.upper_bound == pytest.approx(truth, abs=1e-12)
    assert found.verify()


def test_missing_readings_are_skipped() -> None:
    net = neural.Elman([([[1.0]], [[0.5]], [0.0])], ([[1.0]], [0.0]), "identity")
    data = setid.IOData(np.zeros(4), [1.5, np.nan, 0.5, 0.5])  # x0 / 2, x0 / 8, x0 / 16
    found = neural.output_error(net, data, [[-9.0, 9.0]])
    # 1.5 - x / 2 = D = x / 8 - 0.5 asks for x = 3.2 and D < 0; 1.5 - x/2 = -(0.5 - x/16): x = 32/9
    assert found.lower_bound <= 2.5 / 9 <= found.upper_bound + 1e-12 and found.verify()
    assert found.status == "proved"


def test_forged_output_errors_are_found() -> None:
    net = network("nss")
    data = setid.IOData(RNG(6).uniform(-1, 1, size=12), RNG(8).uniform(-1, 1, size=12))
    found = neural.output_error(net, data, [[-1.0, 1.0]] * 2)
    assert found.verify()
    assert not replace(found, lower_bound=found.lower_bound * 1.01).verify()
    assert not replace(found, upper_bound=found.upper_bound * 0.99).verify()
    assert not replace(found, box=type(found.box)(found.box.lo * 2, found.box.hi * 2)).verify()
    assert not replace(found, x0=np.array([5.0, 0.0])).verify()


def test_forms_beside_saturated_entries_hold_their_ranges() -> None:
    """The middle of a narrow range may be one of its ends, and the other one a whole unit away."""
    for start in RNG(4).uniform(-2.0, 2.0, 40):
        low, high = np.array([start, -np.inf]), np.array([np.nextafter(start, 9.0), np.inf])
        unknown = Form(np.zeros(2), np.zeros((2, 0)), np.full(2, np.inf))
        found = activation("sigmoid", unknown, 0.0, Interval(low, high))
        exact = enclose("sigmoid", Interval(low, high))
        for k in (0, 1):
            centre, radius = Fraction(found.centre[k]), Fraction(found.radius[k])
            assert centre - radius <= Fraction(exact.lo[k])
            assert Fraction(exact.hi[k]) <= centre + radius


def test_infinite_errors_are_not_called_proved() -> None:
    """A state that grows beyond all limits attains nothing, although inf <= 1e-3 inf."""
    net = neural.Elman([([[1.0]], [[3.0]], [0.0])], ([[1.0]], [0.0]), "identity")
    data = setid.IOData(np.cos(np.arange(60.0)), np.zeros(60))
    found = neural.output_error(net, data, [[-1.0, 1.0]], nodes=3)
    assert found.upper_bound == np.inf and found.status == "partial" and found.verify()
    for status in neural.Status:
        assert bool(replace(found, status=status).verify()) == (status == "partial")


def test_interrupted_output_errors_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    net = network("nss")
    data = setid.IOData(RNG(6).uniform(-1, 1, size=6), RNG(8).uniform(-1, 1, size=6))
    whole = neural.output_error(net, data, [[-1.0, 1.0]] * 2, nodes=9)
    programs = InterruptedPrograms(monkeypatch)
    for last in (2, 3, 4):  # the first half of a box, the second, and one of another box
        programs.interrupt(last)
        found = neural.output_error(net, data, [[-1.0, 1.0]] * 2, tolerance=0.0)
        assert programs.count == last and found.verify()
        assert found.nodes == 1 + 2 * ((last - 2) // 2)
        assert found.lower_bound <= whole.upper_bound
    programs.interrupt(1)
    with pytest.raises(KeyboardInterrupt):
        neural.output_error(net, data, [[-1.0, 1.0]] * 2)


@pytest.mark.parametrize("name", ["tanh", "sigmoid", "algebraic"])
@pytest.mark.parametrize("weight", [1e8, 1e17, 1e300])
def test_bands_of_saturated_networks_stay_finite(name: str, weight: float) -> None:
    """The two lines around a step of height 2 are 2 apart, whatever its slope."""
    net = neural.Elman([([[1.0]], [[weight]], [0.3])], None, name)
    data = setid.IOData(np.sin(np.arange(5.0)), np.zeros(5))
    found = neural.simulate_band(net, data, [[-1.0, 1.0]])
    assert found.status == "proved" and np.all(found.high <= 2.01) and np.all(found.low >= -2.01)
    for start in (-1.0, 0.0, 1e-9, 1.0):
        inside = net.simulate(data, [start])
        assert np.all(found.low <= inside) and np.all(inside <= found.high)


def test_a_radius_that_is_no_number_bounds_nothing() -> None:
    found = Form(np.zeros(1), np.ones((1, 1)), np.array([np.nan])).promoted().range()
    assert found.lo[0] == -np.inf and found.hi[0] == np.inf
