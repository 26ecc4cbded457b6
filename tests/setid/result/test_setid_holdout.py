"""What held-out samples say of noise bounds is stored with its evidence, and checked with it."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from functools import cache
from math import inf
from typing import Any

import numpy as np
import pytest

import setid

FAST = setid.Options(time_limit=2.0, progress=False)
MODEL = setid.TransferFunction(na=1, nb=1, nk=1)


def record(noise: setid.Noise, samples: int = 40, seed: int = 0) -> setid.IOData:
    u = np.random.default_rng(seed).uniform(-1, 1, samples)
    return setid.simulate_record(MODEL, [-0.6, 1.0], u, noise, seed).data


@cache
def linear() -> setid.Identification:
    noise = setid.Noise(equation=0.05)
    return setid.identify(record(noise), MODEL, noise, setid.Stable(), FAST, holdout=0.5)


@cache
def refuted() -> setid.Identification:
    loud = record(setid.Noise(output=0.5), 20, 1)
    noise = setid.Noise(output=0.05)
    return setid.identify(record(noise, 20), MODEL, noise, setid.Stable(), FAST, holdout=loud)


@cache
def long() -> setid.Identification:
    """The held-out part has more than 100 equations, which cones of denominators refute."""
    loud = record(setid.Noise(output=0.5), 130, 1)
    noise = setid.Noise(output=0.05)
    return setid.identify(record(noise, 20), MODEL, noise, setid.Stable(), FAST, holdout=loud)


STRUCTURES = {
    "transfer function": (setid.TransferFunction(1, 1, 1, initial="zero"), [-0.9, 0.8]),
    "polynomial": (setid.PolynomialNARX(["y1", "u1"], 1, 1, initial="zero"), [0.9, 0.8]),
    "Hammerstein": (setid.Hammerstein(MODEL, 2, "gamma1", initial="zero"), [-0.9, 0.8, 0.3]),
}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (n == "Hammerstein")) for n in STRUCTURES]
)
def test_parts_that_are_held_out_do_not_begin_at_rest(name: str) -> None:
    model, theta = STRUCTURES[name]
    noise, u = setid.Noise(output=0.01), np.random.default_rng(0).uniform(-1.0, 1.0, 40)
    data = setid.simulate_record(model, theta, u, noise, seed=1).data
    found = setid.identify(data, model, noise, (), FAST, holdout=0.5)
    assert found.holdout is not None and found.holdout.scale[0] <= 1.0
    assert found.holdout.holds is not False and found.verify(), found.holdout.text
    back = setid.Identification.from_json(found.to_json()).holdout
    assert back is not None and back.scale == found.holdout.scale
    if name == "polynomial":
        assert setid.Recursive(model, noise).model.initial == "free"


def one_a_sample() -> setid.Identification:
    bounds = setid.Noise(equation=np.where(np.arange(40) < 20, 0.05, 0.1))
    return setid.identify(record(setid.Noise(equation=0.05)), MODEL, bounds, (), FAST, holdout=0.5)


def continuous() -> setid.Identification:
    t = np.arange(40) * 0.1
    u = np.where(np.sin(1.7 * t) > 0, 1.0, -1.0)
    y = np.zeros(40)
    for k in range(1, 40):
        y[k] = 0.8 * y[k - 1] + 0.2 * u[k - 1]
    model = setid.ContinuousTransferFunction(1, 0, hold="constant", delta=0.01)
    noise = setid.Noise(output=0.05)
    return setid.identify(setid.IOData(u, y, 0.1), model, noise, (), FAST, holdout=0.5)


@pytest.mark.parametrize("case", [linear, refuted, long, one_a_sample, continuous])
def test_json_keeps_what_held_out_samples_say(case: Any) -> None:
    result: setid.Identification = case()
    assert result.holdout is not None and result.verify(result.formulation.data)
    text = result.to_json()
    for other in (setid.Identification.from_json(text), pickle.loads(pickle.dumps(result))):
        assert other.holdout is not None and other.holdout.scale == result.holdout.scale
        assert np.array_equal(other.holdout.data.y, result.holdout.data.y)
        assert other.summary() == result.summary() and setid.verify(other)
    assert setid.Identification.from_json(text).to_json() == text


def test_verdicts_are_those_of_the_records() -> None:
    kept, loud, long_and_loud = linear().holdout, refuted().holdout, long().holdout
    assert kept is not None and kept.holds is True  # the noise of both parts is within the bound
    assert loud is not None and loud.holds is False
    assert long_and_loud is not None and long_and_loud.holds is False
    assert long_and_loud.level.refuted is not None


def changed(result: setid.Identification, key: str, value: Any) -> str:
    found = json.loads(result.to_json())
    found["result"]["holdout"][key] = value
    return json.dumps(found)


@pytest.mark.parametrize("case", [linear, refuted, long])
def test_stored_verdicts_that_do_not_follow_are_refused(case: Any) -> None:
    result: setid.Identification = case()
    assert result.holdout is not None
    low, high = result.holdout.scale
    quiet = json.loads(changed(result, "theta", None))["result"]["holdout"]["noise"]
    quiet["fields"].update(output=1e-3, equation=1e-3)
    for key, value in (
        ("scale", [low * 1.5, high * 1.5]),
        ("scale", [low, high * 0.5]),
        ("scale", [0.0]),
        ("noise", quiet),
    ):
        with pytest.raises(setid.SetidError):
            setid.Identification.from_json(changed(result, key, value))
    with pytest.raises(setid.SetidError):
        moved = json.loads(result.to_json())["result"]["holdout"]["data"]
        moved["fields"]["y"]["data"] = [0.1 * v for v in moved["fields"]["y"]["data"]]
        setid.Identification.from_json(changed(result, "data", moved))


def test_verdicts_are_about_the_noise_of_the_result() -> None:
    result = refuted()
    other = linear()
    assert result.holdout is not None and other.holdout is not None
    level = replace(result.holdout.level, scale=(30.0, inf))
    forged = replace(result, holdout=replace(result.holdout, level=level))
    assert "held-out samples" in forged.verify().reason and not setid.verify(forged)
    # the noise of another identification
    swapped = replace(result, holdout=other.holdout)
    assert swapped.verify().reason == "held-out samples: the noise is not that of the result"


def test_results_without_held_out_samples_are_read_as_before() -> None:
    noise = setid.Noise(equation=0.05)
    result = setid.identify(record(noise), MODEL, noise, (), FAST)
    found = json.loads(result.to_json())
    assert found["result"].pop("holdout") is None
    assert setid.Identification.from_json(json.dumps(found)).holdout is None


def test_held_out_samples_are_refused_before_the_work_where_nothing_can_be_said() -> None:
    data, noise = record(setid.Noise(equation=0.05)), setid.Noise(equation=0.05)
    fast = setid.IOData(data.u, data.y, Ts=0.5)
    with pytest.raises(setid.DataError, match="holdout: found Ts = 0.5, expected 1 as in data"):
        setid.identify(data, MODEL, noise, (), FAST, holdout=fast)
    together = setid.Noise(equation=0.05, constraints=[setid.EnergyBound("equation", 1.0)])
    with pytest.raises(setid.NoiseError, match="bounds alone for holdout"):
        setid.identify(data, MODEL, together, (), FAST, holdout=0.5)
    held = linear().holdout
    assert held is not None
    level = replace(held.level, formulation=setid.formulate(fast, MODEL, noise))
    verdict = replace(linear(), holdout=replace(held, level=level)).verify()
    assert verdict.reason == "held-out samples: the sampling time is another one"


def test_texts_say_that_each_part_may_be_explained_where_both_together_are_not() -> None:
    """By hand, y = b u + c with |e| <= 1 and u = 10, 11.

    From y = 10, 11 follow b in [-1, 3] and c in [-21, 21], but also 9 <= 10 b + c <= 11. The
    part y = 15, 16 is explained by (1, 5): in the box, not in the set, whose readings at u = 10
    lie in [8, 12].
    """
    line = setid.TransferFunction(na=0, nb=1, nk=0, offset=True)
    first, second = setid.IOData([10, 11], [10, 11]), setid.IOData([10, 11], [15, 16])
    result = setid.identify(first, line, setid.Noise(equation=1), (), FAST, holdout=second)
    assert result.holdout is not None and result.holdout.holds is True
    assert "perhaps none that explains the samples identified from" in result.holdout.text
    compared = setid.compare(result, second, "prediction")
    low, high = compared.band.reading_low[0, 0], compared.band.reading_high[0, 0]
    assert (low, high) == pytest.approx((8.0, 12.0), abs=1e-9)
    said = compared.summary()
    assert "together with the one identified from, first by y1 at sample 0" in said
    assert "no parameter vector explains both within the noise bounds" in said
    both = setid.consistency(setid.IOData.concat([first, second]), line, setid.Noise(equation=1))
    assert both.scale == pytest.approx((2.5, 2.5))  # 10 b + c is 5 from 10 and from 15 at best


def test_bounds_read_off_the_held_out_part_too_are_said_to_be_untested_by_it() -> None:
    data = record(setid.Noise(equation=0.05))
    bound = setid.consistency(data, MODEL, setid.Noise(equation=1.0), options=FAST)
    whole = setid.identify(data, MODEL, bound.noise_bound(1.05), options=FAST, holdout=0.5)
    assert whole.holdout is not None and "a test only where the bounds were not" in whole.summary()
    assert whole.holdout.scale[1] <= 1 / 1.05 + 1e-6  # the factor 1.05 of the whole record
    assert "a test only" not in linear().summary()
