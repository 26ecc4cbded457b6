"""Certificates in files: what is read back is proved again, and false claims are refused."""

from __future__ import annotations

import copy
import json
import pickle
import time
from dataclasses import replace
from fractions import Fraction
from itertools import count
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from slow_values import slow_unless

import setid
from setid import control
from setid.control.certificates import stored
from setid.control.certificates.arcs import Ceiling, ratio_on_arcs
from setid.control.certificates.cells import Outcome
from setid.control.certificates.certificate import Question
from setid.control.parameters.parameter_set import identified

UNPROVED = "no proof near 0.1, 3 rad a sample; a failing proof says nothing of the loop"
PLANT = control.Transfer([0, 1], [1, -0.5])
M = control.Transfer([0, 0.4], [1, -0.6])


def certificate(method: str, gain: float = 1.0) -> control.StabilityCertificate:
    r = np.random.default_rng(0).uniform(-1, 1, 60)
    y = PLANT.simulate(r) + np.random.default_rng(1).uniform(-0.01, 0.01, 60)
    K = gain * control.ideal_controller(PLANT, M)
    return control.stability_certificate(
        setid.IOData(r, y), K, M, 1, 0.01, method=method, delay=1, time_limit=5.0
    )


@pytest.mark.parametrize("method", ["small_gain", "characteristic"])
def test_round_trip(method: str) -> None:
    answer = certificate(method)
    assert answer.verdict == "certified" and answer.verify()
    again = control.StabilityCertificate.from_json(answer.to_json())
    assert (again.verdict, again.method, again.arcs) == ("certified", method, answer.arcs)
    assert again.controller.numerator == answer.controller.numerator
    assert again.to_json() == answer.to_json()


def test_bounds_on_other_arcs_than_those_of_a_new_proof_are_proved_again() -> None:
    """A proof under a short time limit ends with other arcs than one without a clock."""
    answer = certificate("small_gain")
    question = stored._question(answer)
    claim = question.claim(question.exact_conditions()[1])
    found = question.known()
    top, below, _ = claim.families()
    fine = [(w, 0.5 * np.pi / 96) for w in (np.arange(96) + 0.5) * np.pi / 96]
    arcs = ratio_on_arcs(found, top, below, found.centre, 0.0, fine)
    stated = tuple((low, high, bound * (1 + 1e-9)) for low, high, bound in arcs)
    outcome = Outcome(True, tuple(arcs), (), answer.cells)
    tight = replace(
        answer,
        arcs=stated,
        bound=max(b for *_, b in stated),
        reason=question.proved_reason(outcome),
        conditions=question._judged(question.exact_conditions()[0], outcome),
    )
    assert tight.verify() and control.StabilityCertificate.from_json(tight.to_json())
    low = tuple((a, b, 0.8 * bound) for a, b, bound in stated)
    assert not replace(tight, arcs=low).verify()
    assert not replace(tight, arcs=stated[1:]).verify()
    assert not replace(tight, arcs=(*stated[1:], (0.0, 1e-12, 1.0))).verify()


def test_a_refutation_goes_round_and_its_plant_is_checked() -> None:
    # loop of .4 g q^-1 / (1 - q^-1): the pole 1 - .4 g is below -1 from g = 5 on
    answer = certificate("characteristic", 6.0)
    assert answer.verdict == "refuted"
    text = answer.to_json()
    again = control.StabilityCertificate.from_json(text)
    assert again.plant.denominator == answer.plant.denominator
    found = json.loads(text)
    found["plant"]["coefficients"][0][1] = "1/2"  # not consistent with the record
    with pytest.raises(setid.SetidError, match="does not hold"):
        control.StabilityCertificate.from_json(json.dumps(found))


def damaged(answer: control.StabilityCertificate, what: str) -> str:
    found = json.loads(answer.to_json())
    if what == "bound":
        found["bound"] = 0.5 * found["bound"]
    elif what == "arc":
        found["arcs"][0][2] *= 0.5
    elif what == "controller":  # loop pole at 1 - .4 * 6
        numerator = found["controller"]["coefficients"][0]
        found["controller"]["coefficients"][0] = [str(6 * Fraction(c)) for c in numerator]
    elif what == "verdict":
        found["verdict"] = "refuted"
    return json.dumps(found)


@pytest.mark.parametrize("what", ["bound", "arc", "controller", "verdict"])
def test_false_claims_are_refused(what: str) -> None:
    with pytest.raises(setid.SetidError, match="does not hold"):
        control.StabilityCertificate.from_json(damaged(certificate("small_gain"), what))


@pytest.mark.parametrize("text", ["{", "[]", '{"format":"setid"}', "1"])
def test_other_text_is_refused(text: str) -> None:
    with pytest.raises(setid.SetidError, match="expected"):
        control.StabilityCertificate.from_json(text)


def test_a_proof_that_rests_on_an_identification_brings_it_along() -> None:
    answer = certificate("characteristic")
    question = Question(
        answer.data, answer.noise, answer.model, answer.controller, answer.reference,
        None, 0, "characteristic",
    )  # fmt: skip
    known = question.known()
    options = setid.Options(time_limit=5.0, progress=False)
    result = identified(answer.data, answer.model, answer.noise, known, 0, options)
    assert control.StabilityCertificate.from_json(
        replace(answer, identification=result).to_json()
    ).identification
    # one whose box is only assumed proves nothing here
    other = setid.identify(
        answer.data, answer.model, answer.noise,
        [setid.Box({"a1": (-0.5005, -0.4995), "b1": (0.9995, 1.0005)})], options,
    )  # fmt: skip
    assert not replace(answer, identification=other).verify()


def test_an_identification_with_a_declared_integrator_belongs_to_its_certificate() -> None:
    """The equation of the pole at z = 1 was once compared with itself in another class."""
    r = np.random.default_rng(0).uniform(-1, 1, 30)
    y = np.cumsum(np.append(0.0, r[:-1]))  # of q^-1 / (1 - q^-1)
    answer = control.stability_certificate(
        setid.IOData(r, y), control.Transfer([0.4]), M, 1, 0.01, method="characteristic", delay=1,
        integrators=1,
    )  # fmt: skip
    options = setid.Options(time_limit=0.5, progress=False)
    result = identified(answer.data, answer.model, answer.noise, answer.parameters, 1, options)
    resting = replace(answer, identification=result)
    assert answer.verdict == "certified" and resting.verify().reason == ""
    assert control.StabilityCertificate.from_json(resting.to_json()).identification


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("margin",), "x"), (("margin",), True), (("margin",), 1.5),
        (("integrators",), 10**400), (("integrators",), 2), (("integrators",), None),
        (("cells",), "x"), (("seconds",), "x"), (("bound",), 10**400), (("reason",), 1),
        (("arcs",), [[1.0, 2.0]]), (("arcs", 0), []), (("arcs", 0, 1), 10**400),
        (("arcs", 0, 2), "x"), (("assumptions",), "x"), (("help",), [1]),
        (("conditions", 0, 1), "x"), (("conditions",), [[1]]),
        (("controller", "Ts"), 10**400), (("controller", "Ts"), 2.0),
        (("controller", "coefficients", 0, 0), 10**400),
        (("noise", "fields", "model_error"), "x"), (("noise", "fields", "model_error"), -0.005),
        (("model", "fields", "na"), 10**400), (("data", "fields", "Ts"), 2.0),
    ],
)  # fmt: skip
def test_damaged_numbers_are_refused_by_name(place: tuple, value: object) -> None:
    found = json.loads(certificate("small_gain").to_json())
    part = found
    for key in place[:-1]:
        part = part[key]
    part[place[-1]] = value
    with pytest.raises(setid.SetidError, match=r"found|expected"):
        control.StabilityCertificate.from_json(json.dumps(found))


@pytest.mark.parametrize("method", ["small_gain", "characteristic"])
def test_words_that_say_other_than_the_numbers_are_refused(method: str) -> None:
    text = certificate(method).to_json()
    for key, value in {
        "reason": "max abs(Delta) <= 1e-09 for every consistent plant",
        "assumptions": [],
        "conditions": [],
    }.items():
        found = json.loads(text) | {key: value}
        with pytest.raises(setid.SetidError, match="does not hold"):
            control.StabilityCertificate.from_json(json.dumps(found))
    assumed = json.loads(text) | {"margin": 0.01}  # which is then an assumption, but not listed
    with pytest.raises(setid.SetidError, match="does not hold"):
        control.StabilityCertificate.from_json(json.dumps(assumed))


@pytest.mark.parametrize("method", ["small_gain", "characteristic"])
def test_words_beside_those_of_the_claim_are_refused(method: str) -> None:
    found = json.loads(certificate(method).to_json())
    for key, value in {
        "reason": found["reason"] + "; so is the loop with twice the gain",
        "plant": found["controller"],
        "help": ["proved: the loop is stable with twice the gain"],
    }.items():
        with pytest.raises(setid.SetidError, match="does not hold"):
            control.StabilityCertificate.from_json(json.dumps(found | {key: value}))


def test_copies_and_pickles_are_certificates() -> None:
    answer = certificate("small_gain")
    for again in (copy.deepcopy(answer), pickle.loads(pickle.dumps(answer))):
        assert again.verify() and again.to_json() == answer.to_json()


def test_an_open_verdict_claims_nothing_in_words() -> None:
    answer = certificate("characteristic")
    blank = {"verdict": "open", "reason": UNPROVED, "identification": None}
    name = answer.conditions[0].name
    text = "not proved for every plant"
    found = json.loads(answer.to_json()) | blank | {"conditions": [[name, None, text]]}
    assert control.StabilityCertificate.from_json(json.dumps(found)).verdict == "open"
    for key, value in (
        ("reason", "no plant of this structure is consistent with the record, proved"),
        ("reason", UNPROVED + ", which is stable"),
        ("conditions", [[name, True, "for every consistent plant"]]),
        ("plant", found["controller"]),
    ):
        with pytest.raises(setid.SetidError, match="does not hold"):
            control.StabilityCertificate.from_json(json.dumps(found | {key: value}))


def test_a_proof_that_no_plant_is_consistent_goes_round() -> None:
    r = np.random.default_rng(0).uniform(-1, 1, 40)
    data, K = setid.IOData(r, r**3), control.ideal_controller(PLANT, M)
    answer = control.stability_certificate(data, K, M, 1, 0.01, delay=1, time_limit=5.0)
    assert answer.verdict == "open" and answer.reason.endswith("record, proved")
    again = control.StabilityCertificate.from_json(answer.to_json())
    assert again.reason == answer.reason


@pytest.mark.parametrize("new", [(np.nan, 0.3), (0.3, np.nan), (0.6, 0.3), (0.3, 0.6)])
def test_bounds_that_are_no_numbers_are_below_nothing(new: tuple[float, float]) -> None:
    """Numbers that overflow make them, and 0.6 is above the bound 0.5 that is stored."""
    answer: Any = SimpleNamespace(method="small_gain", bound=0.5, arcs=((0.0, np.pi, 0.5),))
    ends = (0.0, 1.0), (1.0, np.pi)
    assert stored._below(answer, tuple((*end, 0.3) for end in ends))
    assert not stored._below(answer, tuple((*end, b) for end, b in zip(ends, new, strict=True)))


@pytest.mark.parametrize(
    ("K", "verdict"),
    slow_unless(
        lambda _, verdict: verdict == "refuted",
        [([1.2, -0.4], "open"), ([2.2, -0.8], "refuted")],
    ),
)
def test_bounds_beside_an_open_or_refuted_verdict_are_proved_again(K: list, verdict: str) -> None:
    """They once passed unseen: abs(Delta) <= 1 where the true plant alone has more."""
    r = np.random.default_rng(0).uniform(-1, 1, 60)
    data, K = setid.IOData(r, PLANT.simulate(r)), control.Transfer(K, [1, -1])
    answer = control.stability_certificate(data, K, M, 1, 0.01, delay=1, time_limit=5.0)
    z = np.exp(1j * np.linspace(0.01, np.pi, 200))  # Delta = M - K (1 - M) P of the true plant
    gain = (float(K.numerator[0]) + float(K.numerator[1]) / z) / (1 - 1 / z)
    least = np.max(np.abs(0.4 / (z - 0.6) - gain * (1 - 0.4 / (z - 0.6)) / (z - 0.5)))
    assert answer.verdict == verdict and 1.1 < least < answer.bound < np.inf
    assert answer.verify() and control.StabilityCertificate.from_json(answer.to_json()).verify()
    found = json.loads(answer.to_json())
    for bound, arcs in (
        (1.0, [[0.0, np.pi, 1.0]]),
        (answer.bound, [[a, b, 0.5 * c] for a, b, c in found["arcs"]]),
        (answer.bound, found["arcs"][1:]),
        (answer.bound, []),
        (1.0, found["arcs"]),
    ):
        with pytest.raises(setid.SetidError, match="bound"):
            control.StabilityCertificate.from_json(
                json.dumps(found | {"bound": bound, "arcs": arcs})
            )


def test_factors_that_cancel_in_a_controller_refute_nothing() -> None:
    """(z - 2) / (z - 2) in a good controller once passed as a proof of an unstable loop."""
    good, bad = certificate("characteristic"), certificate("characteristic", 6.0)
    assert (good.verdict, bad.verdict) == ("certified", "refuted")
    found = json.loads(bad.to_json())
    parts = json.loads(good.to_json())["controller"]["coefficients"]
    twice = [
        np.convolve([Fraction(c) for c in part], [Fraction(1), Fraction(-2)]) for part in parts
    ]
    found["controller"]["coefficients"] = [[str(c) for c in part] for part in twice]
    with pytest.raises(setid.SetidError, match="that the plant's loop is unstable is not proved"):
        control.StabilityCertificate.from_json(json.dumps(found))


def test_a_chain_of_near_ends_hides_no_bound() -> None:
    starts = 1.0 + 0.9e-12 * np.arange(3_000)
    arcs = [(0.0, 1.0, 0.9), *((w, w + 2e-9, 1e-6) for w in starts), (starts[-1], np.pi, 0.9)]
    ceiling = Ceiling.of(arcs)
    assert ceiling.over(1.0 + 1e-9, 1.0 + 2e-9) == 1e-6
    assert ceiling.over(0.5, 0.6) == ceiling.over(2.0, 3.0) == 0.9


@pytest.mark.parametrize("text", ["1e99999999999", "0.5", "1/0", 1, True, "1_0"])
def test_coefficients_are_rationals_of_digits_alone(text: object) -> None:
    """A power of ten in a few letters once took memory and time without end."""
    found = json.loads(certificate("characteristic").to_json())
    found["controller"]["coefficients"][0][0] = text
    with pytest.raises(setid.SetidError, match="from_json"):
        control.StabilityCertificate.from_json(json.dumps(found))


@pytest.mark.parametrize(
    ("field", "values"),
    [
        ("method", ("", "x", None, 1, ("small_gain",), np.zeros(2))),
        ("verdict", ("x", None, [], {}, np.zeros(0))),
        ("controller", (None, (), "x", np.zeros((2, 2)), 10**400)),
        ("reference", (None, 1.0, "x")),
        ("data", (None, (), "x")),
        ("noise", (None, 0.01)),
        ("model", (None, 1)),
        ("arcs", (None, ((),), ((0.0, 3.2, 1.0),), "x")),
        ("bound", (None, (), "x", float("nan"))),
        ("integrators", (None, -1, 0.5, 10**400, ())),
        ("cells", (None, -1, 0.5, float("nan"))),
        ("seconds", (None, "x")),
        ("margin", (float("nan"), (), "x")),
        ("help", (None, (1,))),
        ("identification", ((), "x")),
        ("plant", ((), "x")),
    ],
)
def test_fields_of_another_kind_are_refused_without_an_exception(field: str, values: Any) -> None:
    """Objects that were made or changed in memory are asked what texts are."""
    answer = certificate("small_gain")
    for value in values:
        found = replace(answer, **{field: value}).verify()
        assert not found and found.reason, value


def test_sampling_times_that_are_no_numbers_are_refused() -> None:
    answer = certificate("characteristic")
    for name in ("controller", "reference"):
        other = copy.copy(getattr(answer, name))
        object.__setattr__(other, "Ts", float("nan"))
        assert name in replace(answer, **{name: other}).verify().reason


@pytest.mark.parametrize("last", [17, 27])
def test_a_certificate_that_a_clock_cut_short_verifies(
    monkeypatch: pytest.MonkeyPatch, last: int
) -> None:
    """Its set of plants once was one that only that clock made, with a lower bound elsewhere."""
    rng = np.random.default_rng(1)
    plant, u = control.Transfer([0, 0.8], [1, -0.2, -0.3]), rng.uniform(-1, 1, 12)
    data = setid.IOData(u, plant.simulate(u) + rng.uniform(-0.005, 0.005, 12))
    K, model = control.ideal_controller(plant, M), setid.TransferFunction(2, 1, 1)
    clock = (0.0 if reading < last else 1e3 for reading in count())
    with monkeypatch.context() as patch:
        patch.setattr(time, "monotonic", clock.__next__)
        answer = control.stability_certificate(data, K, M, model, 0.005, time_limit=1.0)
    assert answer.verdict == "certified" and answer.verify()


def test_a_proof_on_the_brief_set_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    answer, known = certificate("small_gain"), Question.known
    monkeypatch.setattr(Question, "known", lambda self, brief=False: None)
    assert not answer.verify()
    monkeypatch.setattr(
        Question, "known", lambda self, brief=False: known(self, brief=True) if brief else None
    )
    wider = tuple((low, high, 2.0 * bound) for low, high, bound in answer.arcs)
    outcome = Outcome(True, tuple((a, b, c / (1.0 + 1e-9)) for a, b, c in wider), (), answer.cells)
    question = stored._question(answer)
    loose = replace(
        answer,
        arcs=wider,
        bound=max(b for *_, b in wider),
        reason=question.proved_reason(outcome),
        conditions=question._judged(question.exact_conditions()[0], outcome),
    )
    assert loose.verify()
