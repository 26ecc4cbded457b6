"""Least equation errors and last layers against closed forms, rational programs and samples."""

from __future__ import annotations

import time
from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import mpmath
import numpy as np
import pytest

import setid
import sparsepop_py as sp
from setid import neural
from setid.neural.arithmetic import Interval
from setid.neural.last_layers import polytope, select


def ramp() -> tuple[neural.NNARX, setid.IOData]:
    """One feature u_t, so that y_t is w u_t + b."""
    net = neural.Network([[[0.0, 1.0, 0.0]], [[1.0]]], [[0.0], [0.0]], "relu")
    return neural.NNARX(net, 1), setid.IOData([0, 0, 1, 2, 3], [0, 0, 2, 4, 6])


def plant(samples: int, error: float, seed: int = 0) -> tuple[neural.NNARX, setid.IOData]:
    """A network of three tanh with a bounded equation error on its own output."""
    rng = np.random.default_rng(seed)
    w = rng.normal(size=(3, 3))
    net = neural.Network([w, [[0.6, -0.4, 0.5]]], [rng.normal(size=3), [0.2]])
    u, y = rng.uniform(-2, 2, size=samples), np.zeros(samples)
    for t in range(1, samples):
        y[t] = net([y[t - 1], u[t], u[t - 1]])[0] + rng.uniform(-error, error)
    return neural.NNARX(net, 1), setid.IOData(u, y)


TRUTH = np.array([0.6, -0.4, 0.5, 0.2])


def test_equation_error_against_arbitrary_precision() -> None:
    net, data = plant(40, 0.1)
    found = neural.equation_error(net, data)
    w, b = net.network.weights, net.network.biases
    worst = mpmath.mpf(0)
    with mpmath.workdps(40):
        for t in range(1, 40):
            phi = [mpmath.mpf(v) for v in (data.y[t - 1, 0], data.u[t, 0], data.u[t - 1, 0])]
            value = mpmath.mpf(b[1][0])
            for i in range(3):
                argument = sum(mpmath.mpf(w[0][i, j]) * phi[j] for j in range(3))
                value += mpmath.mpf(w[1][0, i]) * mpmath.tanh(argument + mpmath.mpf(b[0][i]))
            assert mpmath.mpf(found.low[t, 0]) <= value <= mpmath.mpf(found.high[t, 0])
            worst = max(worst, abs(mpmath.mpf(data.y[t, 0]) - value))
        assert mpmath.mpf(found.lower_bound[0]) <= worst <= mpmath.mpf(found.upper_bound[0])
    assert found.upper_bound[0] - found.lower_bound[0] < 1e-13
    assert found.upper_bound[0] <= 0.1 + 1e-13
    assert found.verify()


def test_the_band_holds_all_readings_of_its_record() -> None:
    net, data = plant(60, 0.05)
    low, high = neural.equation_error(net, data).band()
    assert np.all((low <= data.y)[1:] & (data.y <= high)[1:])


def test_forged_equation_errors_are_found() -> None:
    net, data = plant(20, 0.1)
    found = neural.equation_error(net, data)
    assert not replace(found, lower_bound=found.lower_bound + 1e-9).verify()
    assert not replace(found, upper_bound=found.upper_bound - 1e-9).verify()
    assert not replace(found, low=found.low + 1e-9).verify()
    assert not replace(found, low=np.zeros(0), high=np.zeros(0)).verify()
    assert not replace(found, lower_bound=np.zeros(0)).verify()
    assert not replace(found, data=setid.IOData(data.u, data.y + 0.1)).verify()


def test_bands_say_nothing_of_samples_without_a_regressor() -> None:
    """Numbers there once passed as proved: the first sample has no past."""
    net, data = ramp()
    errors = neural.equation_error(net, data)
    band = neural.last_layer(net, data, setid.Noise(equation=0.5)).band()
    first = np.eye(5, 1) > 0
    for found, names in (
        (errors, ("low", "high")),
        (band, ("low", "high", "reading_low", "reading_high")),
    ):
        assert found.verify()
        for name in names:
            part = getattr(found, name)
            assert np.isnan(part[0]) and not np.any(np.isnan(part[1:]))
            assert not replace(found, **{name: np.where(first, 7.0, part)}).verify()
    assert len(replace(band, reading_low=np.where(first, 7.0, band.reading_low)).outside) == 1


@pytest.mark.parametrize("power", [-900, -330, -60, 0, 60, 330, 1000])
def test_units_of_the_output_do_not_change_what_is_proved(power: int) -> None:
    """Without noise, small readings once gave a bound that no layer obeys, and large ones none."""
    net, data = ramp()
    unit = 2.0**power
    found = neural.last_layer(net, setid.IOData(data.u, unit * np.array([0.0, 0, 2, 4, 7])))
    # (0, 0), (1, 2), (2, 4), (3, 7) around a line of slope 7 / 3: the largest error is 1 / 3
    assert found.noise.equation[0] / unit == pytest.approx(1.05 / 3, rel=1e-8)
    assert found.status is neural.Status.PROVED and found.verify()
    # vertices of abs(y - w u - b) <= .35: w = 2.3 or 2.35, b = -.35 or -.25
    for name, ends in (("w1", (2.3, 2.35)), ("b", (-0.35, -0.25))):
        outer = np.array(found.intervals[name].outer) / unit
        assert outer == pytest.approx(ends, abs=1e-6) and outer[0] < ends[0] + 1e-8
        assert ends[1] - 1e-8 < outer[1]


def test_numbers_beyond_the_doubles_in_stored_objects_are_no_exception() -> None:
    net, data = ramp()
    found = neural.last_layer(net, data, setid.Noise(equation=0.5))
    assert not replace(found, sets=(replace(found.sets[0], widened=10**400),)).verify()


def test_forged_noise_bounds_of_uncertain_sets_are_found() -> None:
    """The least noise bound beside a box once passed unseen: here all of it is not needed."""
    net, data = ramp()
    found = neural.last_layer(net, data, setid.Noise(output=0.5, input=0.01))
    only = found.sets[0]
    assert only.box is not None and only.factor == (0.0, np.inf) and found.verify()
    exact = neural.last_layer(net, data, setid.Noise(equation=0.5))
    assert exact.upper_bound[0] < 0.7  # what explains the record exactly explains it with noise
    for factor in ((0.99, np.inf), (0.0, 0.1), (0.99, 0.995), (np.nan, np.inf), (0.0, np.nan)):
        assert not replace(found, sets=(replace(only, factor=factor),)).verify()
    bent = setid.IOData(data.u, [[0], [0], [2], [4], [0]])
    none = neural.last_layer(net, bent, setid.Noise(output=0.01, input=1e-4))
    assert none.status is neural.Status.EMPTY and none.verify()
    forged = replace(none.sets[0], factor=(9e9, np.inf))
    assert not replace(none, sets=(forged,)).verify()


def test_networks_with_a_state_are_refused() -> None:
    net = neural.Elman([([[1.0]], [[0.5]], [0.0])])
    with pytest.raises(setid.ModelError, match="found Elman, expected NNARX or NNOE"):
        neural.equation_error(net, setid.IOData([1, 2], [1, 2]))


def test_a_number_is_no_noise() -> None:
    with pytest.raises(setid.NoiseError, match="noise: found float, expected Noise"):
        neural.last_layer(*ramp(), 0.1)  # type: ignore[arg-type]


def test_where_a_noise_bound_comes_from_is_not_left_out() -> None:
    net, data = ramp()
    bent = setid.IOData(data.u, [[0], [0], [2], [4], [5]])
    found = neural.last_layer(net, bent)
    assert found.verify() and "times the least" in found.noise.assumptions[0]
    assert found.noise.assumptions[0] in found.assumptions
    bare = tuple(text for text in found.assumptions if "times the least" not in text)
    assert replace(found, assumptions=bare).verify().reason == "an assumption is left out"


def test_last_layer_in_closed_form() -> None:
    """|2 - w - b|, |4 - 2w - b|, |6 - 3w - b|, |b| <= 1/2: a hexagon computed by hand."""
    net, data = ramp()
    found = neural.last_layer(net, data, setid.Noise(equation=0.5))
    assert repr(found.band()).startswith("<LayerBand: 4 readings, ")
    w, b = found.intervals["w1"], found.intervals["b"]
    assert w.outer == pytest.approx((5 / 3, 7 / 3), abs=1e-12)
    assert b.outer == pytest.approx((-0.5, 0.5), abs=1e-12)
    assert w.outer[0] <= 5 / 3 and w.outer[1] >= 7 / 3 and b.outer[0] <= -0.5
    assert w.status == b.status == "certified" and found.status == "proved"
    assert found.lower_bound[0] == 0.0


def test_last_layer_against_rational_programs() -> None:
    net, data = plant(60, 0.05, seed=3)
    found = neural.last_layer(net, data, setid.Noise(equation=0.05))
    features = net.network.features(
        np.column_stack([data.y[:-1], data.u[1:], data.u[:-1]])
    )  # rounded: the truth differs by about 1e-16
    theta = sp.variables(4)
    rows = []
    for f, y in zip(features, data.y[1:, 0], strict=True):
        value = sp.total([float(c) * v for c, v in zip(f, theta, strict=False)]) + theta[3]
        rows += [value <= y + 0.05, value >= y - 0.05]
    bounds = sp.linear_bounds(
        sp.Problem(theta[0], rows), [s * v for v in theta for s in (1.0, -1.0)]
    )
    for k, item in enumerate(found.intervals.values()):
        expected = bounds[2 * k].lower, -bounds[2 * k + 1].lower
        assert item.outer == pytest.approx(expected, rel=1e-10)
        assert TRUTH[k] in item
    assert found.status == "proved"


def test_empty_sets_are_proved_empty() -> None:
    """Features u = (0, 1, 2, 3) and y = (0, 2, 2, 6): the least error is 1 by hand.

    The rows at u = 1, 2, 3 read w + b = 2 + e1, 2 w + b = 2 + e2, 3 w + b = 6 + e3, whose second
    difference is 4 = 2 e2 - e1 - e3, so that the largest error is at least 1; w = 2, b = -1
    reaches it at all rows.
    """
    net, _ = ramp()
    data = setid.IOData([0, 0, 1, 2, 3], [0, 0, 2, 2, 6])
    found = neural.last_layer(net, data, setid.Noise(equation=0.75))
    assert found.status == "empty" and found.verify()
    assert found.lower_bound[0] == pytest.approx(1 / 0.75, rel=1e-10)
    assert found.lower_bound[0] <= 1 / 0.75 <= found.upper_bound[0]
    assert neural.last_layer(net, data, setid.Noise(equation=1.001)).status == "proved"


def test_intervals_that_are_left_out_or_changed_are_noticed() -> None:
    net, data = ramp()
    found = neural.last_layer(net, data, setid.Noise(equation=0.5))
    assert found.verify()
    fewer = {name: found.intervals[name] for name in list(found.intervals)[1:]}
    assert not replace(found, intervals=fewer).verify()
    for change in ({"outer": (0.0, 1.0)}, {"inner": None}, {"status": "open"}):
        other = {name: replace(item, **change) for name, item in found.intervals.items()}
        assert not replace(found, intervals=other).verify()


def test_unbounded_sets_prove_nothing() -> None:
    net, _ = ramp()
    found = neural.last_layer(net, setid.IOData([0, 1], [0, 2]), setid.Noise(equation=0.5))
    assert found.status == "open"
    assert all(item.outer == (-np.inf, np.inf) for item in found.intervals.values())
    assert found.verify()


def test_bands_hold_all_members() -> None:
    net, data = plant(120, 0.05, seed=5)
    _, other = plant(80, 0.05, seed=5)
    found = neural.last_layer(net, data, setid.Noise(equation=0.05))
    band = found.band(other)
    assert band.verify() and not band.outside.size
    phi = np.column_stack([other.y[:-1], other.u[1:], other.u[:-1]])
    features = np.column_stack([net.network.features(phi), np.ones(79)])
    values = found.members(1000, seed=1)[:, 0] @ features.T
    assert np.all(values >= band.low[1:, 0] - 1e-12) and np.all(values <= band.high[1:, 0] + 1e-12)
    reached = (values.max(axis=0) - values.min(axis=0)) / (band.high - band.low)[1:, 0]
    assert np.median(reached) > 0.5  # not merely a wide box
    truth = features @ TRUTH
    assert np.all(truth >= band.low[1:, 0]) and np.all(truth <= band.high[1:, 0])


def test_noise_read_off_the_record_is_an_assumption() -> None:
    net, data = plant(60, 0.05)
    found = neural.last_layer(net, data)
    assert any("1.05 times the least" in text for text in found.assumptions)
    assert found.lower_bound[0] == pytest.approx(1 / 1.05, rel=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_output_and_input_noise(seed: int) -> None:
    """True last layers lie in the proved box; readings in the proved band."""
    net, exact = plant(200, 0.0, seed)
    rng = np.random.default_rng(seed + 100)
    size = 0.01
    data = setid.IOData(
        exact.u + rng.uniform(-size, size, size=exact.u.shape),
        exact.y + rng.uniform(-size, size, size=exact.y.shape),
    )
    found = neural.last_layer(net, data, setid.Noise(output=size, input=size))
    assert found.status == "partial" and found.verify()
    for k, item in enumerate(found.intervals.values()):
        assert TRUTH[k] in item and item.width < 10.0
    band = found.band()
    assert band.verify() and not band.outside.size
    assert np.all(exact.y[1:] >= band.low[1:]) and np.all(exact.y[1:] <= band.high[1:])


def test_contradicting_noisy_records_are_empty() -> None:
    net, exact = plant(100, 0.0)
    data = setid.IOData(exact.u, exact.y + np.where(np.arange(100) % 2, 0.5, -0.5)[:, None])
    found = neural.last_layer(net, data, setid.Noise(output=0.01))
    assert found.status == "empty" and found.verify()


def test_forged_last_layers_are_found() -> None:
    net, data = plant(60, 0.05)
    found = neural.last_layer(net, data, setid.Noise(equation=0.05))
    (item,) = found.sets
    narrow = Interval(item.outer.lo + 1e-9, item.outer.hi)
    assert not replace(found, sets=(replace(item, outer=narrow),)).verify()
    assert not replace(found, sets=(replace(item, dual=1.01 * item.dual),)).verify()
    assert not replace(found, sets=(replace(item, inner=item.inner * 1.1),)).verify()
    assert not replace(found, sets=(replace(item, inside=item.inside + 0.1),)).verify()
    assert not replace(found, sets=(replace(item, factor=(0.999, 1.0)),)).verify()
    assert not replace(found, sets=(replace(item, factor=(0.0, item.factor[0] / 2)),)).verify()
    smaller = neural.last_layer(net, data, setid.Noise(equation=0.049)).sets[0]
    assert not replace(found, sets=(replace(smaller, widened=0.049 / 0.05),)).verify()
    assert not replace(found, noise=setid.Noise(equation=0.06)).verify()
    other = neural.last_layer(net, data, setid.Noise(equation=0.06))
    assert not replace(found, intervals=other.intervals).verify()
    band = found.band()
    assert not replace(band, low=band.low + 1e-6).verify()


def test_several_outputs() -> None:
    net = neural.Network([np.eye(4)[2:3], [[2.0], [-1.0]]], [[0.0], [0.0, 1.0]], "relu")
    u = np.array([0.0, 1.0, 2.0, 3.0])
    data = setid.IOData(u, np.column_stack([2 * u, 1 - u]))
    found = neural.last_layer(neural.NNARX(net, 1), data, setid.Noise(equation=[0.5, 0.25]))
    assert list(found.intervals) == ["w[1]1", "b[1]", "w[2]1", "b[2]"]
    # u = 1, 2, 3 are the rows: the slope is within 2 De / 2 of the truth
    assert found.intervals["w[1]1"].outer == pytest.approx((1.5, 2.5), abs=1e-12)
    assert found.intervals["w[2]1"].outer == pytest.approx((-1.25, -0.75), abs=1e-12)


def test_members_are_drawn_where_one_is_known_and_where_the_known_ones_agree() -> None:
    net = neural.NNARX(
        neural.Network([[[0.0, 1.0, 0.0]], [[1.0]]], [[0.0], [0.0]], "relu"), order=1
    )
    data = setid.IOData([0, 0, 1, 2, 3], [0, 0, 2, 4, 6])
    found = neural.last_layer(net, data, setid.Noise(equation=0.5))
    (item,) = found.sets
    assert np.all(np.abs(found.members(7)[:, 0, 0] - 2.0) <= 1.0 / 3.0 + 1e-9)
    for places in ([0], [0, 0], [0, 1]):  # without spread, and with spread along a line
        few = replace(found, sets=(replace(item, inside=item.inside[places]),))
        drawn = few.members(3)[:, 0]
        assert drawn.shape == (3, 2)
        if places != [0, 1]:
            np.testing.assert_array_equal(drawn, item.inside[[0, 0, 0]])
    for count in (0, 1.5, None):
        with pytest.raises(setid.ModelError, match="count: found"):
            found.members(count)


@pytest.mark.parametrize("bad", [None, "x", 1j, float("nan"), [1.0, 2.0, 3.0], -1])
def test_wrong_numbers_of_fits_and_bands_are_named(bad: object) -> None:
    u = np.sin(np.arange(20.0))
    data = setid.IOData(u, u**2)
    net = neural.initial(data, order=1, widths=[1])
    elman = neural.Elman([([[1.0]], [[0.5]], [0.0])], ([[1.0]], [0.0]))
    calls = {
        "factor": lambda: neural.last_layer(net, data, factor=bad),
        "tolerance": lambda: neural.output_error(elman, data, [[0.0, 1.0]], bad),
        "nodes": lambda: neural.output_error(elman, data, [[0.0, 1.0]], nodes=bad),
        "starts": lambda: neural.train(net, data, starts=bad),
        "seed": lambda: neural.initial(data, 1, seed=bad),
        "max_steps": lambda: neural.train(net, data, max_steps=bad),
    }
    if bad is not None:  # which is left out
        calls["error"] = lambda: neural.equation_error(net, data).band(bad)
    if not isinstance(bad, list):
        calls["orders"] = lambda: neural.select(data, data, orders=bad, widths=[1], starts=1)
    for field, call in calls.items():
        if field == "orders" and bad == "x":
            continue
        with pytest.raises(setid.SetidError, match=f"{field}: found"):
            call()


HUGE = 10**40


@pytest.mark.parametrize("bad", ["x", b"x", 1j, {}, {1, 2}, [1.0, [2.0]], 10**400, Ellipsis])
def test_wrong_inputs_of_networks_are_named(bad: object) -> None:
    gate = ([[1.0]], [[0.0]], [0.0])
    gru, net = neural.GRU(gate, gate, gate), neural.Network([[[1.0]]], [[0.0]])
    calls = {"x": lambda: net(bad), "inputs": lambda: neural.stability(gru, bad)}
    for field, call in calls.items():
        with pytest.raises(setid.ModelError, match=f"{field}: found"):
            call()


@pytest.mark.parametrize("bad", [None, "x", float("nan"), -1.0, float("inf"), [0.0, 1.0]])
def test_wrong_noise_of_a_band_is_named(bad: object) -> None:
    net = neural.Elman([([[1.0]], [[0.5]], [0.0])], ([[1.0]], [0.0]))
    band = neural.simulate_band(net, setid.IOData(np.zeros(2), [0.0, 0.1]))
    assert band.outside(0.05).tolist() == [[1, 0]] and band.outside(0.2).size == 0
    with pytest.raises(setid.NoiseError, match="noise: found"):
        band.outside(bad)


@pytest.mark.parametrize("bad", [None, "x", [1.0, 2.0], Interval.point(np.ones(2))])
def test_boxes_of_inputs_that_are_none_are_named(bad: object) -> None:
    net = neural.Network([[[1.0, 1.0, 1.0]], [[1.0]]], [[0.0], [0.0]])
    for call in (net.enclose, net.enclose_features):
        with pytest.raises(setid.ModelError, match="x: found .*, expected an Interval of shape"):
            call(bad)


def test_what_is_trained_by_default_is_named() -> None:
    _, data = ramp()
    with pytest.raises(setid.ModelError, match="expected NNARX, NNOE or NeuralStateSpace$"):
        neural.train(None, data)
    with pytest.raises(setid.ModelError, match="expected NNARX for 'scipy'$"):
        neural.train(None, data, "scipy")


def test_wrong_switches_kinds_and_sizes_are_named() -> None:
    net, data = ramp()
    array = np.ones(3)
    calls = {
        "validation": lambda: neural.select(data, None, [1], [1], starts=1),
        "lmi": lambda: neural.stability(net, lmi=array),
        "normalised": lambda: neural.hidden_weights(net, data, 0.1, normalised=array),
        "kind": lambda: neural.initial(data, 1, kind="NNOE"),
        "data": lambda: neural.initial(None, 1),
        "data: found no row": lambda: neural.initial(data, HUGE),
        "widths": lambda: neural.initial(data, 1, [HUGE]),
        "max_steps": lambda: neural.train(net, data, max_steps=HUGE),
        "starts": lambda: neural.train(net, data, starts=HUGE),
        "pieces": lambda: neural.envelope("tanh", -1.0, 1.0, HUGE),
        "degree": lambda: neural.envelope("tanh", -1.0, 1.0, degree=0),
        "cells": lambda: neural.envelope("tanh", -1.0, 1.0, cells=HUGE),
    }
    for field, call in calls.items():
        with pytest.raises(setid.SetidError, match=field if ":" in field else f"{field}: found"):
            call()


def test_numbers_of_other_types_are_numbers() -> None:
    net, data = ramp()
    assert neural.hidden_weights(net, data, 0.5, Fraction(5, 2), 0.5).weights == 2.5
    assert neural.envelope("tanh", -(10**2), Fraction(1, 3), 4, cells=50).verify()


def test_a_condition_that_fails_bounds_no_distance() -> None:
    """With the rate 1.5 the limit drive / (1 - rate) was below zero."""
    net = neural.Elman([([[1.0]], [[1.5]], [0.0])], ([[1.0]], [0.0]))
    found = neural.stability(net, lmi=False)
    for condition in (found.conditions[0], "best", 1.0):
        with pytest.raises(setid.ModelError, match="condition: found"):
            found.limit(inputs=0.1, condition=condition)
        with pytest.raises(setid.ModelError, match="condition: found"):
            found.distance(3, 1.0, condition=condition)


def test_orders_of_numpy_are_taken() -> None:
    net = neural.Network([[[0.5, 1.0, 0.0]]], [[0.0]])
    made = neural.NNARX(net, order=np.int64(1), channels=np.int64(1))
    assert type(made.order) is int and type(made.channels) is int
    for wrong in (0, True, 1.5, "1"):
        with pytest.raises(setid.ModelError, match="order"):
            neural.NNARX(net, order=wrong)


def test_last_layers_are_linear_and_say_their_assumptions() -> None:
    net, data = plant(60, 0.05)
    noise = setid.Noise(equation=0.05)
    found = neural.last_layer(net, data, noise)
    given = net.network
    bent = neural.Network(given.weights, given.biases, ["tanh", "tanh"])
    forged = replace(found, net=neural.NNARX(bent, 1))
    assert "linear" in forged.verify().reason and not forged.band().verify()
    assert found.assumptions
    for number in range(len(found.assumptions)):
        fewer = found.assumptions[:number] + found.assumptions[number + 1 :]
        assert "assumption" in replace(found, assumptions=fewer).verify().reason


def test_interrupts_of_a_selection_keep_what_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    _, data = plant(40, 0.05)
    whole = neural.select(*data.split(25), orders=[1, 2], widths=[1, 2], starts=1)
    usual, count = select.train, [0]

    def train(*arguments: Any, **options: Any) -> neural.Trained:
        count[0] += 1
        if count[0] == last:
            raise KeyboardInterrupt
        return usual(*arguments, **options)

    monkeypatch.setattr(select, "train", train)
    for last in (2, 4):
        count[0] = 0
        found = neural.select(*data.split(25), orders=[1, 2], widths=[1, 2], starts=1)
        assert [repr(item) for item in found.log] == [repr(item) for item in whole.log[: last - 1]]
        assert found.chosen in found.log and found.chosen.result.verify()
    last, count[0] = 1, 0
    with pytest.raises(KeyboardInterrupt):
        neural.select(*data.split(25), orders=[1], widths=[1], starts=1)


def test_intervals_have_their_own_names_and_sets_their_sizes() -> None:
    net, data = plant(40, 0.05)
    found = neural.last_layer(net, data, setid.Noise(equation=0.2, output=0.02))
    assert found.verify()
    other = {**found.intervals, "w1": replace(found.intervals["w1"], name="b")}
    assert not replace(found, intervals=other).verify()
    (item,) = found.sets
    assert item.box is not None
    assert not replace(found, sets=(replace(item, reach=0.5 * item.reach),)).verify()


def test_statuses_follow_and_fields_that_do_not_fit_are_no_error() -> None:
    """Every other status is a forgery, also of what is only partly proved."""
    net, data = plant(9, 0.05)
    elman = neural.Elman([([[1.0]], [[0.5]], [0.1])], ([[1.0]], [0.0]))
    results = [
        neural.last_layer(net, data),
        neural.equation_error(net, data),
        neural.train_proved(net, data, weights=1.0, nodes=1),
        neural.output_error(elman, data, [[-1.0, 1.0]], nodes=1),
        neural.output_error(elman, data, [[-1.0, 1.0]]),
        neural.simulate_band(elman, data, [[-1.0, 1.0]]),
        neural.stability(elman, lmi=False),
        neural.stability(neural.Elman([([[1.0]], [[2.0]], [0.1])]), lmi=False),
    ]
    for found in results:
        assert found.verify()
        for status in neural.Status:
            assert bool(replace(found, status=status).verify()) == (status is found.status)
    layer, error, trained, output, _, band, stable, _ = results
    short = replace(layer.sets[0], centre=np.zeros(1))
    narrow = Interval(np.zeros((2, 1)), np.zeros(1))
    for forged in (
        replace(layer, sets=(short,)),
        replace(layer, sets=(replace(layer.sets[0], factor=()),)),
        replace(layer.band(), dual=()),
        replace(error, data=setid.IOData([[0.0, 1.0], [1.0, 0.0], [1.0, 1.0]], [0, 0, 1])),
        replace(trained, data=None),
        replace(output, x0=np.zeros(3)),
        replace(output, horizon=-10),
        replace(band, x0=narrow),
        replace(stable, net=None),
    ):
        verdict = forged.verify()
        assert not verdict and verdict.reason, forged


def test_last_layers_and_their_bands_prove_less_where_time_is_over() -> None:
    net, data = plant(30, 0.05)
    noise = setid.Noise(equation=0.05)
    found = neural.last_layer(net, data, noise)
    late = neural.last_layer(net, data, noise, time_limit=0.0)
    assert late.status is neural.Status.OPEN and late.verify()
    assert all(i.outer == (-np.inf, np.inf) for i in late.intervals.values())
    whole, brief = found.band(), found.band(time_limit=0)
    assert brief.verify() and np.all(np.isfinite(brief.low[1:]))
    assert np.all(brief.low[1:] <= whole.low[1:]) and np.all(brief.high[1:] >= whole.high[1:])
    assert brief.width > whole.width
    uncertain = setid.Noise(output=0.01)
    assert neural.last_layer(net, data, uncertain, time_limit=0).verify()
    for ask in (lambda t: neural.last_layer(net, data, noise, time_limit=t), found.band):
        with pytest.raises(setid.SetidError):
            ask(-1)


def test_no_program_of_a_last_layer_is_begun_when_time_is_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each linear program takes ten seconds on this clock: one more is begun at most."""
    net, data = plant(30, 0.05)
    clock, solve = [0.0], polytope.LinearModel.solve

    def slow(self, cost, time_limit=None):
        clock[0] += 10.0
        return solve(self, cost)

    monkeypatch.setattr(polytope.LinearModel, "solve", slow)
    monkeypatch.setattr(polytope.time, "monotonic", lambda: clock[0])
    found = neural.last_layer(net, data, setid.Noise(equation=0.05), time_limit=25.0)
    assert clock[0] == 30.0 and found.verify()

    unknown = SimpleNamespace(status="stopped")
    monkeypatch.setattr(polytope.LinearModel, "solve", lambda *_: unknown)
    with pytest.raises(setid.NoiseError, match="the time limit was over before the least"):
        neural.last_layer(net, data, time_limit=0.0)


def test_no_more_members_are_drawn_than_memory_holds() -> None:
    net, data = ramp()
    found = neural.last_layer(net, data, setid.Noise(equation=0.5))
    for count in (10**30, 0):
        with pytest.raises(setid.ModelError, match="count: found"):
            found.members(count)


def test_selections_end_with_their_time_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that advances an hour with each structure that is trained."""
    _, data = plant(40, 0.05)
    usual, clock = select.train, SimpleNamespace(now=0.0, monotonic=time.monotonic)
    clock.time = lambda: clock.now

    def train(*arguments: Any, **options: Any) -> neural.Trained:
        clock.now += 3600.0
        return usual(*arguments, **options)

    monkeypatch.setattr(select, "time", clock)
    monkeypatch.setattr(select, "train", train)
    parts = {"orders": [1], "widths": [1, 2, 3], "starts": 1}
    found = neural.select(*data.split(25), **parts, time_limit=5400.0)
    assert [item.width for item in found.log] == [1]
    assert found.chosen.result.verify()
    for limit in (0.0, 1800.0):
        with pytest.raises(setid.SetidError, match="time_limit: found no structure that is done"):
            neural.select(*data.split(25), **parts, time_limit=limit)
    with pytest.raises(setid.SetidError, match="time_limit: found -1, expected seconds >= 0"):
        neural.select(*data.split(25), **parts, time_limit=-1)


def test_negative_tolerances_and_limits_of_trainings_are_refused() -> None:
    net, data = ramp()
    with pytest.raises(setid.ModelError, match="tolerance: found -0.1, expected a number >= 0"):
        neural.train_proved(net, data, tolerance=-0.1)
    for call in (neural.train_proved, lambda *a, **b: neural.hidden_weights(*a, 1.0, **b)):
        with pytest.raises(setid.SetidError, match="time_limit: found -1, expected seconds >= 0"):
            call(net, data, time_limit=-1)


@pytest.mark.parametrize("power", [1020, 520, -520, -1040])
def test_far_units_give_bounds_that_hold_and_no_warnings(power: int) -> None:
    """y = 2 max(u, 0) + error: powers of two are units in which nothing is rounded."""
    size, u = 2.0**power, np.array([3.0, -2.0, 1.0, -1.0, 2.0, 0.0])
    error = np.array([0.5, -0.5, 0.25, 0.5, -0.5, 0.0])
    data = setid.IOData(u * size, (2.0 * np.maximum(u, 0.0) + error) * size)
    net, noise = ramp()[0], setid.Noise(equation=0.5 * size)
    layer = neural.last_layer(net, data, noise)
    weights = neural.hidden_weights(net, data, noise, time_limit=0.1)
    for interval, value in [
        (layer.intervals["w1"], 2.0),
        (layer.intervals["b"], 0.0),
        (weights.intervals["w1_2"], 2.0),
        (weights.intervals["c"], 0.0),
    ]:
        assert interval.outer[0] <= value <= interval.outer[1]
    trained = neural.train_proved(net, data, time_limit=0.1)
    assert trained.lower_bound <= 0.5 * size
    for found in (layer, layer.band(), weights, trained):
        assert found.verify()
    assert not len(layer.band().outside)


@pytest.mark.parametrize("size", [1e155, 1e308])
def test_weights_whose_squares_overflow_leave_stability_open(size: float) -> None:
    gate = ([[size]], [[size]], [0.0])
    for net in (
        neural.Elman([([[size]], [[size]], [0.0])]),
        neural.LSTM(gate, gate, gate, gate),
        neural.GRU(gate, gate, gate),
    ):
        found = neural.stability(net, lmi=False)
        assert found.status is neural.Status.OPEN and found.verify()


def test_factors_beyond_all_doubles_are_refused() -> None:
    net, data = ramp()
    with pytest.raises(setid.NoiseError, match="factor: found 1e\\+308, whose bound is beyond"):
        neural.last_layer(net, setid.IOData(data.u, 3.0 * data.y**2), factor=1e308)
