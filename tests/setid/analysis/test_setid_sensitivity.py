"""Noise factors: where signs are lost, bounds read off a record, and samples held out."""

from __future__ import annotations

import time
from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np
import pytest

import setid
import sparsepop_py as sp
from setid.analysis import sensitivity as sensitivity_module
from setid.analysis.sensitivity import _drawn as read
from setid.minimum_noise.consistency_result import READ_OFF
from setid.result.identification import INTERRUPTED

identify_module = import_module("setid.identify")

DATA = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
FIRST = setid.TransferFunction(na=1, nb=1)
QUIET = setid.Options(progress=False, time_limit=20.0)


def quadrangle() -> setid.Identification:
    return setid.identify(DATA, FIRST, setid.Noise(equation=0.5), (), QUIET)


def plant(bound: float, samples: int = 60, seed: int = 1) -> setid.IOData:
    model = setid.TransferFunction(1, 1, 1)
    u = np.random.default_rng(seed).uniform(-1, 1, samples)
    return setid.simulate_record(model, [-0.7, 1.0], u, setid.Noise(equation=bound), seed).data


def test_a_sign_is_lost_where_hand_computation_says() -> None:
    # a1 = 0: abs(-6.25 + 3 b0) <= e and abs(1.175 - 2 b0) <= e meet at e = 8.975 / 5
    found = quadrangle().sensitivity(factors=[1.0, 3.58, 3.6])
    low, high = found.lost["a1"]
    assert low <= 1.795 / 0.5 <= high and high - low < 1e-12
    assert found.signs[:, 0].tolist() == [-1, -1, 0]
    assert found.verify()
    assert "sign of a1: proved up to factor 3.58" in found.summary()


def test_what_is_said_is_that_of_the_results() -> None:
    found = quadrangle().sensitivity(factors=[1.0, 2.0])
    assert found.verify()
    wide = setid.sensitivity(quadrangle(), [1.0, 3.0], QUIET)
    forgeries = {
        "outer": found.outer + 1.0,
        "signs": -found.signs,
        "lost": {name: (1e6, 1e6) for name in found.lost},
        "factors": np.array([1.0, 50.0]),
        "names": ("b0", "a1"),
        "results": wide.results,
        "base": wide.results[1],
        "least": found.levels["b0"],
        "levels": {"a1": found.levels["b0"], "b0": found.levels["b0"]},
    }
    for name, value in forgeries.items():
        assert not replace(found, **{name: value}).verify(), name
    never = {name: (np.inf, np.inf) for name in found.lost}
    assert not replace(found, levels={}, lost=never).verify()  # as if priors gave the signs


def forged(found: setid.Sensitivity, **changes: Any) -> setid.Sensitivity:
    """Put other results into an answer, and say of them what follows."""
    made = replace(found, **changes)
    drawn = read(made.base, made.factors.tolist(), made.results, made.levels)
    return replace(made, **drawn)


def narrowed(result: setid.Identification) -> setid.Identification:
    """Claim less of a parameter than is proved."""
    item = replace(result.intervals["b0"], outer=result.intervals["b0"].inner)
    outer = (item.outer[0], np.nextafter(item.outer[1], -np.inf))
    return replace(result, intervals={**result.intervals, "b0": replace(item, outer=outer)})


def test_every_result_behind_it_is_verified_and_belongs_to_its_factor() -> None:
    found = quadrangle().sensitivity(factors=[2.0, 3.0])
    assert forged(found).verify()
    level = found.levels["a1"]
    high = replace(level, scale=(level.scale[1] * 1.01, level.scale[1] * 1.02))
    forgeries = {
        "of other factors": {"results": found.results[::-1]},
        "the base at another factor": {"results": (found.base, found.results[1])},
        "a base that does not follow": {"base": narrowed(found.base)},
        "a result that does not follow": {
            "results": (narrowed(found.results[0]), found.results[1])
        },
        "a level that does not follow": {"levels": {**found.levels, "a1": high}},
        "a least factor that does not follow": {"least": replace(found.least, scale=(2.0, 3.0))},
        "a level of other noise": {"least": replace(found.least, noise=setid.Noise(equation=0.25))},
    }
    for what, changes in forgeries.items():
        assert not forged(found, **changes).verify(), what


def test_levels_are_about_the_noise_as_given() -> None:
    """Factors on other bounds are other factors, whatever problem they lead to."""
    known, about = quadrangle().formulation, sensitivity_module._is_about
    assert about(known, known, known.noise, 1.0, ())
    assert not about(known, known, setid.Noise(equation=0.25), 1.0, ())


@pytest.mark.parametrize("factors", [[1.0, 3.0], [3.0], [0.5]])
def test_no_sign_is_proved_less_far_than_an_identification_proves_it(factors: list) -> None:
    """By hand a1 keeps its sign up to the factor 3.59; no time is left to prove a level."""
    known = quadrangle()
    found = setid.sensitivity(known, factors, setid.Options(progress=False, time_limit=1e-6))
    level = found.levels["a1"].scale[0]
    signs = [f for f, s in zip(factors, found.signs[:, 0], strict=True) if s]
    assert found.lost["a1"][0] == max(1.0, level, *signs) <= 3.59
    assert found.base is known and found.verify()


def test_a_level_that_proves_less_than_the_result_is_not_shown(monkeypatch) -> None:
    from setid.analysis import sensitivity

    def loose(*given: object) -> setid.Consistency:
        found = setid.consistency(*given)
        return sensitivity.replace(found, scale=(0.9997, found.scale[1]))

    monkeypatch.setattr(sensitivity, "consistency", loose)
    found = quadrangle().sensitivity(factors=[1.0])
    assert found.lost["a1"][0] == 1.0 and "of a1: proved up to factor 1," in found.summary()


@pytest.mark.parametrize("prior", [setid.Box({"b0": (1, 3)}), setid.Known({"b0": 2})])
def test_no_factor_takes_a_sign_that_priors_give(prior: setid.Box | setid.Known) -> None:
    """With b0 = 2 and a1 = 0 the rows leave .25 and abs(1.175 - 4): e >= 2.825 = 5.65 * .5."""
    result = setid.identify(DATA, FIRST, setid.Noise(equation=0.5), [prior], QUIET)
    found = result.sensitivity(factors=[1.0, 40.0])
    assert found.signs[:, 1].tolist() == [1, 1] and found.lost["b0"] == (np.inf, np.inf)
    assert found.verify() and "sign of b0: given by priors" in found.summary()
    expected = 3.59 if isinstance(prior, setid.Box) else 5.65
    assert found.lost["a1"] == pytest.approx((expected, expected), rel=1e-12)


def test_intervals_grow_with_the_factor_and_contain_those_of_less_noise() -> None:
    found = quadrangle().sensitivity(factors=[0.5, 0.7, 1.0, 1.3, 2.0])
    assert found.results[0].empty and np.all(found.signs[0] == 0)  # least factor: 0.678
    assert found.least.scale[0] == pytest.approx(2 * 0.339028, abs=1e-5)
    assert np.all(np.diff(found.outer[1:, :, 0], axis=0) <= 0)
    assert np.all(np.diff(found.outer[1:, :, 1], axis=0) >= 0)
    exact = setid.identify(DATA, FIRST, setid.Noise(equation=1.0), (), QUIET)
    assert found.outer[-1, 0] == pytest.approx(exact.intervals["a1"].outer, rel=1e-12)
    assert "empty" in found.table() and "factor" in found._repr_html_()


@pytest.mark.slow
def test_output_errors_lose_signs_in_a_proved_bracket() -> None:
    model = setid.TransferFunction(1, 1, 1)
    u = np.random.default_rng(0).uniform(-1, 1, 20)
    truth = setid.simulate_record(model, [-0.5, 1.0], u, setid.Noise(output=0.05), 2)
    result = setid.identify(truth.data, model, setid.Noise(output=0.05), (), QUIET)
    found = setid.sensitivity(result, [1.0])
    low, high = found.lost["b1"]
    assert 1.0 < low <= high
    sure = setid.Noise(output=0.05 * low * 0.98)
    assert setid.identify(truth.data, model, sure, (), QUIET).intervals["b1"].outer[0] > 0
    if np.isfinite(high):
        wide = setid.identify(truth.data, model, setid.Noise(output=0.05 * high * 1.02), (), QUIET)
        inner = wide.intervals["b1"].inner
        assert inner is None or inner[0] <= 0.05


@pytest.mark.parametrize("factors", [[], [0.0], [-1.0], [np.inf], 3])
def test_wrong_factors_are_refused(factors: object) -> None:
    with pytest.raises(setid.SetidError, match="factors"):
        quadrangle().sensitivity(factors)  # type: ignore[arg-type]


def test_a_bound_read_off_the_record_is_named_as_such() -> None:
    data = plant(0.1)
    model = setid.TransferFunction(1, 1, 1)
    level = setid.consistency(data, model, setid.Noise(equation=1.0))
    noise = level.noise_bound(1.05)
    assert noise.bounds(data)[2].max() == pytest.approx(1.05 * level.scale[1], rel=1e-12)
    result = setid.identify(data, model, noise, (), QUIET)
    assert any(READ_OFF in text for text in result.assumptions)
    found = result.sensitivity([1.0, 2.0])
    assert "check it on another" in found.summary() and bool(found.verify())
    (said,) = [text for text in found.results[1].assumptions if READ_OFF in text]
    assert said.startswith("equation noise: read off") and said.endswith(", times 2")
    assert setid.Identification.from_json(found.results[1].to_json()).assumptions[0] == said
    assert found.least.scale[1] == pytest.approx(1 / 1.05, rel=1e-6)
    with pytest.raises(setid.NoiseError, match="margin"):
        level.noise_bound(0.9)


def test_a_bound_read_off_stays_one_a_channel_where_readings_are_missing() -> None:
    """y = b u: the readings 0.9 and 1.1 of u = 1 need 0.1 = 2 x 0.05, and a missing one nothing."""
    model, noise = setid.TransferFunction(0, 1), setid.Noise(output=0.05)
    data = setid.IOData([1, 1, 2], [0.9, 1.1, np.nan])  # b = 1
    found = setid.consistency(data, model, noise, (), QUIET).noise_bound(1.5)
    other = setid.IOData([1, 1, 2, 3], [1.0, 1.0, 2.1, 3.0])
    assert found.bounds(other)[0].ravel() == pytest.approx([0.15] * 4)


def test_a_bound_read_off_shares_of_readings_is_one_of_them() -> None:
    """The readings 1.1 and 0.9 of u = 1 need shares x with 1.1 (1 - x) = 0.9 (1 + x)."""
    model, noise = setid.TransferFunction(0, 1), setid.Noise(output=0.05, relative=True)
    data = setid.IOData([1, 1, 2], [1.1, 0.9, 2.0])
    level = setid.consistency(data, model, noise, (), QUIET)
    found = level.noise_bound()
    assert found.relative and found.output == pytest.approx([0.1])
    assert np.all(found.bounds(data)[0] >= noise.bounds(data)[0] * level.scale[1])
    assert found.bounds(setid.IOData([1, 2], [4.0, 1.0]))[0].ravel() == pytest.approx([0.4, 0.1])


def test_a_bound_read_off_is_named_as_such_where_samples_are_held_out() -> None:
    data, model = plant(0.1), setid.TransferFunction(1, 1, 1)
    each = setid.Noise(equation=np.where(np.arange(60) < 30, 1.0, 2.0))
    noise = setid.consistency(data, model, each).noise_bound(3)
    found = setid.identify(data, model, noise, (), QUIET, holdout=0.5)
    assert any(READ_OFF in text for text in found.assumptions)
    assert found.holdout is not None and found.verify()
    assert setid.Identification.from_json(found.to_json()).holdout is not None


@pytest.mark.parametrize(
    ("holdout", "noise", "text"),
    [
        (setid.IOData([[1, 2], [2, 1], [1, 1]], [1, 2, 3]), 0.5, "held out, data: found 2 inputs"),
        (setid.IOData([1, 2, 3], [1, 2, 3]), np.full(4, 0.5), "held out, equation: found shape"),
        (1, 0.5, "to identify from, data: found 1 samples"),
        (3, 0.5, "held out, data: found 1 samples"),
    ],
)
def test_samples_that_cannot_be_held_out_are_refused_before_the_work(
    monkeypatch: pytest.MonkeyPatch, holdout: Any, noise: Any, text: str
) -> None:
    monkeypatch.setattr(identify_module, "bound_parameters", lambda *given: pytest.fail("work"))
    with pytest.raises(setid.SetidError, match=f"holdout: of the samples {text}"):
        setid.identify(DATA, FIRST, setid.Noise(equation=noise), (), QUIET, holdout=holdout)


def test_held_out_samples_check_the_bound() -> None:
    data, model = plant(0.1), setid.TransferFunction(1, 1, 1)
    kept = setid.identify(data, model, setid.Noise(equation=0.1), (), QUIET, holdout=0.5)
    assert kept.holdout is not None and kept.holdout.holds is True
    assert kept.formulation.data.samples == 30 and kept.holdout.data.samples == 30
    assert "hold on the part that was held out" in kept.summary()
    quiet, loud = plant(0.01), plant(0.3, seed=2)
    refuted = setid.identify(quiet, model, setid.Noise(equation=0.01), (), QUIET, holdout=loud)
    assert refuted.holdout is not None and refuted.holdout.holds is False
    # the largest residual of the best one-step model of the other record needs at least this
    assert refuted.holdout.scale[1] >= setid.linf(loud, model).cost / 0.01 * (1 - 1e-9)
    assert "refuted by the part that was held out" in refuted.summary()


def test_bounds_of_samples_are_split_with_the_record() -> None:
    data, model = plant(0.1), setid.TransferFunction(1, 1, 1)
    bound = np.where(np.arange(60) < 30, 0.1, 0.2)
    found = setid.identify(data, model, setid.Noise(equation=bound), (), QUIET, holdout=0.5)
    assert found.formulation.noise.bounds(found.formulation.data)[2].max() == 0.1
    assert found.holdout is not None and found.holdout.scale[1] <= 0.5 * (1 + 1e-9)


def test_skipped_stages_leave_the_effort_auto_and_presolve_is_warned_of() -> None:
    skipped = setid.Options(engine=sp.Options(skip=("obbt_sdp",)))
    assert skipped.for_engine().effort == "auto" and skipped.for_engine().skip == ("obbt_sdp",)
    weak = setid.Options(engine=sp.Options(), progress=False)
    with pytest.warns(setid.SetidWarning, match="effort 'presolve'"):
        setid.identify(DATA, FIRST, setid.Noise(equation=0.5), (), weak)


def test_signs_that_a_prior_asks_for_are_lost_like_others() -> None:
    """MinimumPhase reads the sign of b0 off the bounds, which the level of b0 must leave alone."""
    model, noise = setid.TransferFunction(1, 2), setid.Noise(equation=0.01)
    u = [1, 2, -1, 0, 2, -2, 1, -1, 1, 2]
    data = setid.simulate_record(model, [0.5, 1, 0.5], u, noise).data
    priors = [setid.Sign({"b0": "+"}), setid.MinimumPhase()]
    found = setid.identify(data, model, noise, priors, QUIET).sensitivity([1.0])
    # b0 = 0 leaves no numerator: then y(k) + a1 y(k-1) has to be noise
    y = data.y.ravel()
    worst = min(np.abs(y[1:] + a * y[:-1]).max() for a in np.linspace(-2, 2, 4001)) / 0.01
    low, high = found.lost["b0"]
    assert low <= worst and high == pytest.approx(worst, rel=1e-3) and found.verify()


def test_an_interrupt_leaves_the_least_time_for_what_is_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each factor once began with its share of the time, so that each took an interrupt."""
    base = quadrangle()
    work = sensitivity_module._Work(base, QUIET, time.monotonic() + 600.0, left=4)
    limits: list[float] = []

    def identified(*given: Any) -> setid.Identification:
        limits.append(given[-1].time_limit)
        return replace(base, notes=(INTERRUPTED,))

    monkeypatch.setattr(sensitivity_module, "identify", identified)
    for factor in (1.1, 1.2):
        work.identified(factor)
    assert limits[0] > 100.0 and limits[1] == sensitivity_module._LEAST
