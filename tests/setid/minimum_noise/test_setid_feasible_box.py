"""Boxes from cones of denominators as they are found: near the ends, within limits, interrupted."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from slow_values import slow_after

import setid
from setid.feasible_set.start import find_box
from setid.minimum_noise.cones import feasible_box
from setid.minimum_noise.cones.feasible_box import denominator_box
from setid.proofs.denominators.denominator_box import DenominatorBox
from setid.proofs.parameter_box import box_follows
from sparsepop_py.budget import Deadline

MODEL = setid.TransferFunction(na=2, nb=2, nk=1)
TRUTH = np.array([-1.2, 0.52, 0.8, -0.3])
NEAR = TRUTH - 0.02, TRUTH + 0.02  # as if they were attained
SIZE = 0.05


def planted(samples: int = 60, priors=()) -> setid.Formulation:
    random = np.random.default_rng(0)
    u = random.uniform(-1.0, 1.0, samples)
    y = setid.simulate(MODEL, TRUTH, u) + random.uniform(-SIZE, SIZE, samples)[:, None]
    return setid.formulate(setid.IOData(u, y), MODEL, setid.Noise(output=SIZE), priors)


def found_box(known, tol=0.5, deadline=None, executor=None) -> DenominatorBox:
    deadline = deadline or Deadline(60.0)
    found = denominator_box(known, find_box(known), NEAR, tol, deadline, executor)
    assert isinstance(found, DenominatorBox) and box_follows(found, known)
    assert np.all(found.lower <= TRUTH) and np.all(found.upper >= TRUTH)
    return found


def test_tolerances_are_kept() -> None:
    """Where cones come as near as is asked, no end is farther; less is asked of fewer cones."""
    known = planted()
    ends = [found_box(known, tol) for tol in (2.0, 0.6)]
    for box, tol in zip(ends, (2.0, 0.6), strict=True):
        beyond = np.maximum(NEAR[0] - box.lower, box.upper - NEAR[1]) / 0.04
        assert box.complete and np.all(beyond <= tol + 1e-9)
    assert len(ends[0].trees[0].cells) < len(ends[1].trees[0].cells)


def test_denominators_are_left_to_the_engine_where_it_is_faster(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Gains come as near as is asked, denominators within the distance that is left."""
    known = planted()
    whole = found_box(known, 0.6)
    monkeypatch.setattr(feasible_box, "_is_fast", lambda rows: False)
    monkeypatch.setattr(feasible_box, "_DENOMINATOR_TARGET", 2.0)
    box = found_box(known, 0.6)
    beyond = np.maximum(NEAR[0] - box.lower, box.upper - NEAR[1]) / 0.04
    assert box.complete and np.all(beyond <= [2.0, 2.0, 0.6, 0.6])
    assert len(box.trees[0].cells) < len(whole.trees[0].cells)


def test_targets_spare_what_turns_out_to_be_consistent() -> None:
    """Attained ends of denominators that are too near the truth move on."""
    known, width = planted(), 1e-3
    half = np.array([width, width, 0.2, 0.2]) / 2
    near = TRUTH - half, TRUTH + half
    box = denominator_box(known, find_box(known), near, 5.0, Deadline(60.0))
    assert box is not None and box.complete and box_follows(box, known)
    spared = np.maximum(near[0] - box.lower, box.upper - near[1])[:2]
    assert np.all(spared > 5.0 * width)  # consistent ones lie there


def test_orders_and_priors_say_what_cones_settle() -> None:
    third, stable = setid.TransferFunction(na=3, nb=1), setid.Stable()
    noise, data = setid.Noise(output=SIZE), planted().data
    for model, priors, fast in ((MODEL, (), True), (third, (), False), (third, stable, True)):
        assert feasible_box.settles(setid.formulate(data, model, noise, priors)) is fast
    other = setid.formulate(data, MODEL, setid.Noise(output=SIZE, input=SIZE))
    assert not feasible_box.settles(other)


def test_without_time_the_first_box_is_left() -> None:
    known = planted()
    first, box = find_box(known), found_box(known, deadline=Deadline(1e-3))
    assert first is not None and not box.complete and box.cut_short
    assert np.array_equal(box.lower, first.lower) and np.array_equal(box.upper, first.upper)


def test_an_interrupt_keeps_what_is_proved(monkeypatch: pytest.MonkeyPatch) -> None:
    known, deadline, count = planted(), Deadline(60.0), 0
    examined = feasible_box.examined

    def impatient(task):
        nonlocal count
        count += 1
        if count > 12:
            raise KeyboardInterrupt
        return examined(task)

    monkeypatch.setattr(feasible_box, "examined", impatient)
    box, first = found_box(known, deadline=deadline), find_box(known)
    assert deadline.stopped and not box.complete and first is not None
    assert len(box.trees[0].multipliers) > 0  # some cones are left out for good
    assert np.all(box.lower >= first.lower) and np.all(box.upper <= first.upper)


def test_workers_find_such_a_box_too() -> None:
    with ThreadPoolExecutor(2) as executor:
        box = found_box(planted(), executor=executor)
    assert box.complete
    closed = ThreadPoolExecutor(1)
    closed.shutdown()
    assert found_box(planted(), executor=closed).complete


def test_each_output_has_a_tree_of_its_own() -> None:
    model = setid.TransferFunction([[1], [1]], 1, inputs=1, outputs=2)
    theta, noise = np.array([-0.7, 0.4, 1.0, 2.0]), setid.Noise(output=0.1)
    random = np.random.default_rng(0)
    made = setid.simulate_record(model, theta, random.uniform(-1, 1, 50), noise, random)
    known = setid.formulate(made.data, model, noise)
    near = theta - 0.02, theta + 0.02
    box = denominator_box(known, find_box(known), near, 2.0, Deadline(60.0))
    assert box is not None and len(box.trees) == 2 and box.complete and box_follows(box, known)
    assert np.all(box.lower <= theta) and np.all(box.upper >= theta)


@pytest.mark.parametrize("noise", [{"output": 0.1, "input": 0.1}, {"output": 0.1, "equation": 0.1}])
def test_other_errors_have_no_cones(noise) -> None:
    known = planted()
    other = setid.formulate(known.data, MODEL, setid.Noise(**noise))
    assert denominator_box(other, None, NEAR, 0.5, Deadline(60.0)) is None


def test_few_samples_have_no_cones() -> None:
    assert denominator_box(planted(6), None, NEAR, 0.5, Deadline(60.0)) is None


def test_a_long_record_with_strong_noise_is_certified() -> None:
    """All of it: points, verification, JSON, and no second identification without the prior."""
    random, model = np.random.default_rng(3), setid.TransferFunction(na=1, nb=2, nk=1)
    theta, noise = np.array([-0.8, 0.6, 1.0]), setid.Noise(output=0.3)
    made = setid.simulate_record(model, theta, random.uniform(-1, 1, 260), noise, random)
    found = setid.identify(made.data, model, noise, setid.Stable(), setid.Options(tol=1e-2))
    assert isinstance(found.evidence.box, DenominatorBox) and found.fewer_priors is None
    assert all(item.status is setid.IntervalStatus.CERTIFIED for item in found.intervals.values())
    assert all(
        value in found.intervals[name] for name, value in zip(model.parameters, theta, strict=True)
    )
    assert found.verify(made.data)
    again = setid.Identification.from_json(found.to_json())
    assert again.verify(made.data) and again.intervals["a1"].outer == found.intervals["a1"].outer


@pytest.mark.parametrize("taps", slow_after(1, [2, 1]))
def test_a_response_without_denominator_is_not_split(taps: int) -> None:
    """Noise near its bound at all samples leaves a set that no limit reaches within its width."""
    rng = np.random.default_rng(0)
    u = np.round(rng.uniform(-2, 2, 228) * 64) / 64
    y = 0.75 * u + 0.2 * (1 - 1e-6) * rng.choice([-1, 1], 228)
    options = setid.Options(progress=False, time_limit=1)
    model = setid.TransferFunction(0, taps)
    result = setid.identify(setid.IOData(u, y), model, setid.Noise(output=0.2), (), options)
    assert result.verify()
    (low, high), *others = (interval.outer for interval in result.intervals.values())
    assert low <= 0.75 <= high
    assert all(below <= 0.0 <= above for below, above in others)


@pytest.mark.slow
def test_a_cone_as_thin_as_one_denominator_is_left() -> None:
    """A set so small that noise bounds a little larger explain what lies a tolerance beyond it."""
    random = np.random.RandomState(701)
    u, y = random.uniform(-1.0, 1.0, 700), np.zeros(700)
    for k in range(1, 700):
        y[k] = 0.8 * y[k - 1] + 0.5 * u[k - 1]
    size = 0.05 * np.abs(y).max()
    data = setid.IOData(u, y + random.uniform(-size, size, 700))
    known = setid.formulate(data, setid.TransferFunction(1, 1, 1), setid.Noise(output=size))
    attained = np.array([-0.80008045, 0.49964894]), np.array([-0.79995435, 0.50013869])
    box = denominator_box(known, find_box(known), attained, 7e-4, Deadline(60.0))
    assert box is not None and not box.complete and box_follows(box, known)
    assert len(box.trees[0].cells) < 600  # without an end, 100 more each second
    assert np.all(box.lower <= [-0.8, 0.5]) and np.all(box.upper >= [-0.8, 0.5])
