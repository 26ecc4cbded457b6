"""Undershoot, zeros outside the circle, and reference models from specifications."""

from __future__ import annotations

import builtins
from dataclasses import replace

import numpy as np
import pytest

import setid
import sparsepop_py as sp
from setid import control


def step(zeros: list[float], poles: list[float], length: int = 60) -> np.ndarray:
    top, below = np.poly(zeros), np.poly(poles)
    plant = control.Transfer([0.0, *(top * below.sum() / top.sum())], below)
    return plant.simulate(np.ones(length))


@pytest.mark.parametrize("zero", [1.2, 1.5, 2.0])
@pytest.mark.parametrize("seed", range(5))
def test_a_zero_outside_is_located(zero: float, seed: int) -> None:
    y = step([zero, 0.3], [0.7, 0.5, 0.2])
    noise = np.random.default_rng(seed).uniform(-0.01, 0.01, y.size)
    found = control.undershoot(y + noise, 0.01)
    assert found.verdict == "present"
    assert found.depth[0] <= -y.min() <= found.depth[1]
    assert len(found.zeros) == 1
    low, high = found.zeros[0]
    assert low < zero < high and high - low < 0.5 * zero


@pytest.mark.parametrize("seed", range(10))
def test_minimum_phase_is_never_called_otherwise(seed: int) -> None:
    rng = np.random.default_rng(seed)
    y = step([rng.uniform(-0.8, 0.8)], rng.uniform(0.2, 0.8, 2).tolist())
    found = control.undershoot(y + rng.uniform(-0.05, 0.05, y.size), 0.05)
    assert found.verdict != "present" and found.zeros == ()


def test_without_noise_absence_is_proved_up_to_rounding() -> None:
    found = control.undershoot(step([0.2], [0.5, 0.6])[1:], 1e-9)
    assert found.verdict == "absent" and found.depth == (0.0, 0.0)


def test_strong_noise_leaves_it_open() -> None:
    y = step([1.5], [0.7, 0.5])
    assert control.undershoot(y, 2.0).verdict == "open"


def test_a_downward_step_and_assumptions() -> None:
    y = -2.0 * step([1.5], [0.7, 0.5])
    u = np.concatenate([np.zeros(3), np.full(y.size, -2.0)])
    found = control.undershoot(setid.IOData(u, np.concatenate([np.zeros(3), y])), 0.01)
    assert found.verdict == "present" and found.zeros
    assert any("after the record" in text for text in found.assumptions)


def test_the_tail_of_a_downward_step_is_that_of_the_output() -> None:
    plant = control.Transfer([0, 0.2], [1, -0.8])  # no zero at all
    u = np.concatenate([np.zeros(3), -np.ones(10)])
    data = setid.IOData(u, plant.simulate(u))
    found = control.undershoot(data, 0.001, (-1.01, -0.85))
    assert found.zeros == () and found.tail == (-1.01, -0.85) and found.verify()
    assert found.free == control.undershoot(-data.y[3:, 0], 0.001, (0.85, 1.01)).free
    low, high = control.undershoot(data, 0.001).tail
    assert low < data.y.min() and data.y.max() < high


def test_an_input_that_is_no_step_is_refused() -> None:
    with pytest.raises(setid.DataError, match="step"):
        control.undershoot(setid.IOData([0, 1, 2], [0, 0, 1]), 0.1)


def test_tests_are_repeated() -> None:
    y = step([1.5, 0.3], [0.7, 0.5, 0.2])
    readings = y + np.random.default_rng(3).uniform(-0.01, 0.01, y.size)
    u = np.concatenate([np.zeros(2), np.ones(y.size)])
    for record in (readings, setid.IOData(u, np.concatenate([np.zeros(2), readings]))):
        found = control.undershoot(record, setid.Noise(output=0.01))
        assert found.verdict == "present" and found.verify()
        assert replace(found, verdict="open").verify()  # weaker than what is proved
    assert control.undershoot(step([0.2], [0.5, 0.6])[1:], 1e-9).verify()
    assert control.undershoot(y, 2.0).verify()


@pytest.mark.parametrize(
    ("forged", "place"),
    [
        ({"verdict": "absent"}, "verdict"),
        ({"depth": (0.5, 0.6)}, "depth"),
        ({"depth": (0.0, 0.001)}, "depth"),
        ({"sample": 60}, "sample"),
        ({"sample": 0}, "sample"),
        ({"zeros": ((1.1, 1.2),)}, "zeros"),
        ({"free": ((1.01, 90.0),)}, "free"),
        ({"noise": 1.0}, "verdict"),
        ({"tail": (-100.0, 100.0)}, "zeros"),
        ({"tail": (1.5, 0.5)}, "tail"),
        ({"tail": (0.6, 1.4)}, "assumptions"),
        ({"assumptions": ()}, "assumptions"),
    ],
)
def test_forged_tests_are_found(forged: dict, place: str) -> None:
    y = step([1.5, 0.3], [0.7, 0.5, 0.2], 12)
    found = control.undershoot(y, 0.01, tail=(0.5, 1.5))
    assert found.verify()
    verdict = replace(found, **forged).verify()
    assert not verdict and verdict.reason.startswith(place)


@pytest.mark.parametrize("junk", [(), None, "x", 10**400, np.zeros((2, 2)), {}, (1.0,)])
def test_fields_of_another_kind_are_refused_without_an_exception(junk: object) -> None:
    found = control.undershoot(step([1.5, 0.3], [0.7, 0.5, 0.2], 12), 0.01, tail=(0.5, 1.5))
    for name in ("verdict", "depth", "record", "noise", "tail"):
        assert not replace(found, **{name: junk}).verify(), name


def test_two_readings_allow_for_rounding() -> None:
    """sum_k y_k z^-k = -1 / z + t / (z (z - 1)) is 0 at z = 1 + t exactly: no sign is proved."""
    z = 1.0 + np.geomspace(1e-3, 99.0, 400)
    for t in (z - 1.0)[:200:10]:
        found = control.undershoot([0.0, -1.0], 1e-300, tail=(t, t))
        assert not any(low <= 1.0 + t <= high for low, high in found.free)


@pytest.mark.parametrize("tail", [(1.0, 0.0), (1.0,), "late"])
def test_wrong_tails_are_refused(tail: object) -> None:
    with pytest.raises(setid.SetidError, match="tail"):
        control.undershoot([0.0, -1.0, 1.0], 0.1, tail=tail)  # type: ignore[arg-type]


# ---- specifications ---------------------------------------------------------------------


def test_a_missing_synthesis_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    original = builtins.__import__

    def absent(name: str, *rest: object, **more: object) -> object:
        if name.startswith("slycot"):
            raise ImportError(name)
        return original(name, *rest, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(builtins, "__import__", absent)
    with pytest.raises(sp.SolverNotFound, match="slycot"):
        control.reference_model_from(control.Specification(Ts=0.1, rise=1.0))


@pytest.mark.parametrize(
    "wrong",
    [{"Ts": 0.0, "rise": 1.0}, {"Ts": 1.0}, {"Ts": 1.0, "rise": 1.0, "zeros": (0.5,)},
     {"Ts": 1.0, "rise": 1.0, "type": 3}, {"Ts": 1.0, "rise": 1.0, "overshoot": 0.0}],
)  # fmt: skip
def test_a_wrong_specification_is_refused(wrong: dict) -> None:
    with pytest.raises(setid.ModelError, match="found"):
        control.Specification(**wrong)


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"sensor_noise": (20.0, 0.2), "disturbance": (0.2, 0.2)},
        {"zeros": (1.5,), "delay": 2, "rise": 3.0, "overshoot": 0.15},
        {"type": 2, "rise": 2.0, "overshoot": 0.4},
    ],
)
def test_specifications_are_kept(more: dict) -> None:
    pytest.importorskip("slycot")
    spec = control.Specification(**({"Ts": 0.1, "rise": 1.0, "overshoot": 0.1} | more))
    found = control.reference_model_from(spec)
    assert found.kept, found.checks
    assert found.model.is_stable() and found.model.delay == spec.delay
    rest = (1 - found.model).reduced().numerator
    value = np.polynomial.polynomial.polyfromroots([1.0] * spec.type)
    quotient = np.polynomial.polynomial.polydiv([float(c) for c in rest], value)
    assert np.abs(quotient[1]).max() < 1e-12  # type zeros at z = 1
    for zero in spec.zeros:
        assert np.abs(found.model.zeros - zero).min() < 1e-5


@pytest.mark.parametrize("size", [2.0**1020, 2.0**-1000])
def test_units_of_the_output_do_not_change_what_is_proved(size: float) -> None:
    """Zero at z = 1.5; a noise bound beside which the response is nothing proves nothing."""
    y = control.Transfer([0, -0.5, 0.75], [1, -0.75]).simulate([1.0] * 40)
    found, plain = control.undershoot(y * size, 0.01 * size), control.undershoot(y, 0.01)
    assert found.verdict == plain.verdict == "present" and found.verify()
    assert found.depth[0] <= 0.5 * size <= found.depth[1]
    for low, high in found.zeros:
        assert low < 1.5 < high
    strong = control.undershoot(y, 1e308, tail=(-1e308, 1e308))
    assert strong.verdict == "open" and not strong.zeros and strong.verify()
