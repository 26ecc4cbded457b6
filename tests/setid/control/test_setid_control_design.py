"""Controllers from data: the laboratory, the hard case with input noise, classes, refusals."""

from __future__ import annotations

import copy
import pickle
from fractions import Fraction
from functools import cache
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sps
from scipy.optimize import linprog, minimize
from scipy.signal import cont2discrete

import setid
from setid import control
from setid.control.design import _intervals

TS = 0.01
DRYER = Path(__file__).parents[3] / "examples" / "data" / "hairdryer.csv"
# Zero-order hold of the laboratory plant and reference model, and the ideal controller
# (LRIC laboratories 7 and 8; exact arithmetic)
K_STAR = {
    "b0": 2.0568754, "b1": -4.7255762, "b2": 4.2782032, "b3": -1.4824789,
    "a1": -0.9761862, "a2": -0.8986386, "a3": 0.8748248,
}  # fmt: skip
QUICK = setid.Options(time_limit=1.0, progress=False)


def sampled(top: list[float], below: list[float]) -> control.Transfer:
    b, a, _ = cont2discrete((top, below), TS)
    return control.Transfer(b.ravel(), a, TS)


P = sampled([4500.0], [1.0, 16.0, 4500.0])
M = sampled([51.54, 861.8], [1.0, 56.97, 861.8])


def experiment(bound: float, samples: int = 60, seed: int = 1) -> setid.IOData:
    rng = np.random.default_rng(seed)
    r = rng.uniform(-1, 1, samples)
    return setid.IOData(r, P.simulate(r) + rng.uniform(-bound, bound, samples), TS)


def test_orders_are_raised_with_proofs_until_the_set_collapses_on_the_ideal_controller() -> None:
    options = setid.Options(time_limit=30.0, cpu_limit=1.0, progress=False)  # busy machines, too
    found = control.design(experiment(1e-6), M, control.LTI(), 1e-6, options=options)
    assert [item.order for item in found.refuted] == [1, 2]
    assert all(item.result.empty and item.result.verify() for item in found.refuted)
    assert found.order == 3
    for name, value in K_STAR.items():
        low, high = found.intervals[name].outer
        assert value - 1e-4 < low <= value + 1e-7 and value - 1e-7 <= high < value + 1e-4
    assert found.centre.integrators == 1
    matching = found.matching(P)
    assert matching.stable and matching.fit > 99.9


def test_one_time_limit_is_for_all_orders(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each order is given what those before it and the sums of rows have left."""
    design = import_module("setid.control.design")  # the package has a function of this name
    limits, identify = list[float](), design.identified

    def noted(data, model, noise, known, integrators, options, **rest):
        limits.append(options.time_limit)
        return identify(data, model, noise, known, integrators, options, **rest)

    monkeypatch.setattr(design, "identified", noted)
    options = setid.Options(time_limit=20.0, progress=False)
    found = control.design(experiment(1e-6, 20), M, control.LTI(most=2), 1e-6, options=options)
    assert found.empty and found.order == 2 and [item.order for item in found.refuted] == [1]
    assert len(limits) == 2 and 20.0 > limits[0] > limits[1] > 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("Ts", "num", "den"),
    [
        pytest.param(
            0.005,
            [4.2978183, -11.757854, 11.1460309, -3.6490603],
            [-0.9930685, -0.9480591, 0.9411276],
            marks=pytest.mark.slow,
        ),
        (0.02, [1.0013186, -1.1187457, 1.0153414, -0.5193439], [-0.927183, -0.8048727, 0.7320557]),
    ],
)
def test_dddc_lab_ideal_at_other_sampling_times(
    Ts: float, num: list[float], den: list[float]
) -> None:
    plant, reference = (
        control.Transfer(b.ravel(), a, Ts)
        for b, a, _ in (
            cont2discrete(([4500.0], [1.0, 16.0, 4500.0]), Ts),
            cont2discrete(([51.54, 861.8], [1.0, 56.97, 861.8]), Ts),
        )
    )
    rng = np.random.default_rng(1)
    r = rng.uniform(-1, 1, 100)
    data = setid.IOData(r, plant.simulate(r) + rng.uniform(-1e-6, 1e-6, 100), Ts)
    found = control.design(data, reference, control.LTI(3), 1e-6, options=QUICK)
    for name, value in zip(["b0", "b1", "b2", "b3", "a1", "a2", "a3"], [*num, *den], strict=True):
        low, high = found.intervals[name].outer
        assert value - 1e-4 < low <= value + 1e-7 and value - 1e-7 <= high < value + 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("integrator", [pytest.param(True, marks=pytest.mark.slow), False])
def test_noise_on_the_controllers_input(integrator: bool) -> None:
    """Noise .005 on 60 samples: row by row, outer ends were 10 to 100 times too wide."""
    found = control.design(experiment(0.005), M, control.LTI(3, integrator), 0.005, options=QUICK)
    for name, value in K_STAR.items():
        item = found.intervals[name]
        assert value in item
        assert item.width < (0.11 if integrator else 0.2)
    assert found.matching(P).stable
    assert not any("Box" in text for text in found.assumptions)


@pytest.mark.slow
def test_the_integrator_is_exact() -> None:
    found = control.design(experiment(0.005), M, control.LTI(3), 0.005, options=QUICK)
    for controller in (found.centre, found.feasible, found.estimate):
        assert controller.integrators == 1
    assert sum(found.centre.denominator) == 0


@pytest.mark.slow
def test_parallel_pid_is_recovered() -> None:
    # A plant for which a PID controller is ideal: P = M / ((1 - M) K)
    module = control.reference_model(rise=0.2, Ts=TS)
    known = {"Kp": 2.0, "Ki": 5.0, "Kd": 0.01}
    kp, ki, kd = known.values()
    K = control.Transfer([kp + ki * TS + kd / TS, -kp - 2 * kd / TS, kd / TS], [1, -1], TS)
    plant = module / (1 - module) / K
    r = np.random.default_rng(3).uniform(-1, 1, 80)
    data = setid.IOData(r, plant.simulate(r), TS)
    patient = setid.Options(time_limit=60.0, progress=False)  # ends when the gap is closed
    found = control.design(data, module, control.PID(), 1e-6, options=patient)
    for name, value in known.items():
        item = found.intervals[name]
        assert value in item and item.width < 0.01 * value
        assert item.inner is not None and item.inner[0] <= item.inner[1]
    assert found.centre.integrators == 1
    ideal = found.ideal_form()
    assert ideal["Ti"][0] <= kp / ki <= ideal["Ti"][1] < 1.01 * kp / ki
    assert ideal["Td"][0] <= kd / kp <= ideal["Td"][1] < 1.01 * kd / kp
    series = found.series_form()  # roots of x^2 - Ti x + Ti Td
    roots = sorted(np.roots([1.0, -kp / ki, kd / ki]))
    assert series["Td"][0] <= roots[0] <= series["Td"][1]
    assert series["Ti"][0] <= roots[1] <= series["Ti"][1]


def test_a_consistent_controller_is_found_without_the_engine() -> None:
    at_once = setid.Options(time_limit=1e-3, progress=False)
    found = control.design(experiment(0.005), M, control.LTI(3, False), 0.005, options=at_once)
    K = found.feasible
    y, s = found.data.y.ravel(), found.target
    # the least noise that explains s = K (y - noise), by the linear program of setid
    theta = [*K.den[1:], *K.num]
    record = setid.IOData(y, s, TS)
    formulation = setid.formulate(record, found.fixed.model, setid.Noise(input=0.005))
    assert setid.least_noise(formulation, theta).level <= 1.0 + 1e-9


def test_a_pi_controller_cannot_do_it() -> None:
    found = control.design(experiment(1e-6), M, control.PID(derivative=False), 1e-6, options=QUICK)
    assert found.empty
    with pytest.raises(setid.SetidError, match="empty"):
        _ = found.centre


def test_given_numerators() -> None:
    plant, reference = ([0, 1.0], [1, -0.5]), ([0, 0.4], [1, -0.6])
    r = np.random.default_rng(0).uniform(-1, 1, 40)
    data = setid.IOData(r, control.Transfer(*plant).simulate(r))
    given = control.Polynomials([[1.0, -1.0], [0.0, 1.0]], [1.0, -1.0])
    found = control.design(data, reference, given, 1e-6, options=QUICK)
    # K* = .4 (1 - .5 q^-1) / (1 - q^-1) = (.4 (1 - q^-1) + .2 q^-1) / (1 - q^-1)
    assert 0.4 in found.intervals["k1"] and 0.2 in found.intervals["k2"]
    assert found.intervals["k2"].width < 1e-4


def test_powers_of_the_delay_as_numerators_keep_their_names() -> None:
    """K* = .4 (1 - .5 q^-1) / (1 - q^-1): k1 = .4 and k2 = -.2 of the basis 1, q^-1."""
    plant, reference = ([0, 1.0], [1, -0.5]), ([0, 0.4], [1, -0.6])
    r = np.random.default_rng(0).uniform(-1, 1, 8)
    data = setid.IOData(r, control.Transfer(*plant).simulate(r))
    given = control.Polynomials([[1.0, 0.0], [0.0, 1.0]], [1.0, -1.0])
    at_once = setid.Options(time_limit=1e-3, progress=False)
    found = control.design(data, reference, given, 1e-4, options=at_once)
    assert list(found.intervals) == ["k1", "k2"]
    assert 0.4 in found.intervals["k1"] and -0.2 in found.intervals["k2"]


@pytest.mark.slow
def test_very_strong_noise_says_nothing_and_says_so() -> None:
    found = control.design(experiment(1.0), M, control.LTI(3), 1.0, options=QUICK)
    assert not found.empty
    with pytest.raises(setid.SetidError, match="infinite"):
        _ = found.centre
    assert found.estimate.integrators == 1


def test_wrong_input_is_refused() -> None:
    data = experiment(0.01)
    with pytest.raises(setid.ModelError, match="controller"):
        control.design(data, M, control.LTI, 0.01)  # type: ignore[arg-type]
    with pytest.raises(setid.NoiseError, match="input"):
        control.design(data, M, control.LTI(1), setid.Noise(output=0.01, input=0.1))
    with pytest.raises(setid.ModelError, match="Ts"):
        control.design(data, control.Transfer([0, 1], [1, -0.5], 1.0), control.LTI(1), 0.01)
    with pytest.raises(setid.ModelError, match="lag 0"):
        control.design(data, ([1.0], [1.0, -0.5]), control.LTI(1), 0.01)
    with pytest.raises(setid.ModelError, match="polynomials"):
        control.Polynomials([[1.0, 0.0, 1.0]])


@cache
def excited(order: int, bound: float) -> control.Design:
    """Design for a plant of order 2, whose ideal controller has order 2."""
    plant, rng = control.Transfer([0, 0.5, 0.2], [1, -1.2, 0.4]), np.random.default_rng(0)
    r = rng.uniform(-1, 1, 80)
    data = setid.IOData(r, plant.simulate(r) + bound * rng.uniform(-1, 1, 80))
    M = control.reference_model(rise=4.0)
    return control.design(data, M, control.LTI(order), bound, options=QUICK)


def test_what_keeps_intervals_open_is_said() -> None:
    high = excited(3, 0.002)
    (why,) = high.help
    assert why.startswith("a controller of order 2 is consistent, too")
    assert f"help: {why}" in high.summary()
    (why,) = excited(2, 0.5).help
    assert "the noise is strong for this class" in why
    (why,) = excited(1, 1e-4).help
    assert why.startswith("no controller of this class is consistent")


def test_more_time_is_advised_only_where_it_helps() -> None:
    """Ki = (b0 + b1) / Ts has its own ends, and none is sought at them."""
    plant, reference = ([0, 1.0], [1, -0.5]), ([0, 0.4], [1, -0.6])
    r = np.random.default_rng(0).uniform(-1, 1, 8)
    data = setid.IOData(r, control.Transfer(*plant).simulate(r))
    found = control.design(data, reference, control.PID(derivative=False), 1e-4)
    assert found.result.status == "certified" and found.intervals["Ki"].status == "partial"
    (why,) = found.help
    assert why.startswith("the outer ends of Ki are proved") and "give more time" not in why


def test_the_pole_of_an_integrator_of_order_one_is_known() -> None:
    plant, reference = ([0, 1.0], [1, -0.5]), ([0, 0.4], [1, -0.6])
    r = np.random.default_rng(0).uniform(-1, 1, 8)
    data = setid.IOData(r, control.Transfer(*plant).simulate(r))
    found = control.design(data, reference, control.LTI(1), 1e-4)
    pole = found.intervals["a1"]
    assert pole.outer == pole.inner == (-1.0, -1.0) and pole.status == "certified"
    assert found.help == ()


@pytest.mark.slow
def test_a_design_is_pickled_and_copied() -> None:
    found = excited(2, 0.002)
    for again in (copy.deepcopy(found), pickle.loads(pickle.dumps(found))):
        assert again.summary() == found.summary()
        assert again.parameters is not None
        ends = again.parameters.ranges(np.zeros(1), np.eye(5)[:1])
        assert ends[0][0] >= found.intervals["a1"].outer[0] - 1e-12


def test_an_empty_set_has_no_other_forms() -> None:
    rng = np.random.default_rng(0)
    data = setid.IOData(rng.uniform(-1, 1, 40), rng.uniform(-1, 1, 40))
    found = control.design(data, control.reference_model(rise=4.0), control.PID(), 1e-3)
    assert found.empty
    with pytest.raises(setid.SetidError, match="found an empty set"):
        found.ideal_form()


def test_models_of_python_control() -> None:
    module = pytest.importorskip("control")
    data = setid.IOData(*[np.random.default_rng(0).uniform(-1, 1, 30)] * 2)
    P1 = control.Transfer([0, 1], [1, -0.5])
    data = setid.IOData(data.u, P1.simulate(data.u))
    reference = module.TransferFunction([0.4], [1.0, -0.6], 1.0)
    found = control.design(data, reference, control.LTI(1), 1e-4, options=QUICK)
    poles = module.poles(found.to_control())
    assert np.abs(poles - 1.0).min() < 1e-9


def least_noise(record: setid.IOData, theta: list[float]) -> float:
    """Least bound of the noise on the input of s = B(q) (u - e), by a linear program in e."""
    u, s = record.u.ravel(), record.y.ravel()
    taps, count = len(theta), len(s)
    known = np.convolve(u, theta)[:count]
    matrix = sum(
        sps.diags_array(np.full(count - j, b), offsets=-j, shape=(count, count))
        for j, b in enumerate(theta)
    )
    rows = sps.csr_array(matrix)[taps - 1 :]
    below = sps.hstack([sps.eye_array(count), -np.ones((count, 1))])
    above = sps.hstack([-sps.eye_array(count), -np.ones((count, 1))])
    answer = linprog(
        np.append(np.zeros(count), 1.0),
        A_ub=sps.vstack([below, above]),
        b_ub=np.zeros(2 * count),
        A_eq=sps.hstack([rows, np.zeros((count - taps + 1, 1))]),
        b_eq=(known - s)[taps - 1 :],
        bounds=[(None, None)] * count + [(0.0, None)],
    )
    return float(answer.fun) if answer.success else np.inf


@pytest.mark.slow
def test_a_measured_record_where_the_noise_decides_whether_there_are_controllers() -> None:
    """The least noise of PID controllers of this record lies between two bounds, by scipy."""
    record = setid.IOData.from_csv(DRYER, inputs="u", outputs="y", Ts=0.08).detrend()
    experiment = record.split(200)[0]
    reference = control.reference_model(rise=2.0, Ts=0.08, delay=2)
    limit = setid.Options(cpu_limit=5.0, progress=False)
    found = control.design(experiment, reference, control.PID(filter=0.08), 0.33, options=limit)
    assert not found.empty
    theta = found.result.feasible
    data = found.result.formulation.data
    assert least_noise(data, list(theta)) <= 0.33
    smallest = minimize(
        lambda gains: least_noise(data, list(gains)),
        theta,
        method="Nelder-Mead",
        options={"maxiter": 60},
    )
    assert 0.277 < smallest.fun <= 0.33


@pytest.mark.parametrize(("input_", "output"), [(900, 900), (0, 300), (600, 0), (-900, 0)])
def test_far_units_of_a_record_keep_the_ideal_controller(input_: int, output: int) -> None:
    """Powers of two: y = P r and s = K y stay exact; squares of the signals overflow or vanish."""
    r = np.random.default_rng(0).choice([-1.0, 1.0], 20)
    P, M = control.Transfer([0, 1], [1, -0.5]), control.Transfer([0, 0.5], [1, -0.5])
    data = setid.IOData(r * 2.0**input_, P.simulate(r) * 2.0**output)
    options = setid.Options(time_limit=0.2, progress=False)
    found = control.design(data, M, control.LTI(1), 2.0 ** (output - 8), options=options)
    for name, value in {"a1": -1.0, "b0": 0.5, "b1": -0.25}.items():
        size = 1.0 if name == "a1" else 2.0 ** (input_ - output)
        assert found.intervals[name].outer[0] <= value * size <= found.intervals[name].outer[1]
    assert found.result.verify()


def test_a_noise_bound_beyond_all_sense_bounds_no_controller() -> None:
    r = np.random.default_rng(0).uniform(-1, 1, 20)
    P, M = control.Transfer([0, 1], [1, -0.5]), control.Transfer([0, 0.4], [1, -0.6])
    data = setid.IOData(r, P.simulate(r))
    options = setid.Options(time_limit=0.2, progress=False)
    found = control.design(data, M, control.LTI(1), 1e308, options=options)
    assert not found.empty and found.help


def test_attained_ends_of_user_parameters_are_rounded_inwards() -> None:
    """Of theta = 3 K, the member theta = 1 attains K = 1/3, which is no double."""
    fixed: Any = SimpleNamespace(
        basis=np.array([[3.0]]), names=("K",), integrators=0, model=SimpleNamespace(na=((0,),))
    )
    result: Any = SimpleNamespace(empty=False, intervals={}, attained=np.array([[1.0]]))
    inner = _intervals(fixed, result, None, 1e-3)["K"].inner
    assert inner is not None
    assert Fraction(inner[1]) <= Fraction(1, 3) <= Fraction(inner[0])
