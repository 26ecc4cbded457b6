"""Physical parameters: closed forms, linear-fractional programs, simulated circuits, refusals."""

from __future__ import annotations

import functools
import json
import time
from dataclasses import replace
from math import inf

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.signal import lfilter

import setid
import sparsepop_py as sp
from setid.analysis import reparametrise
from setid.priors.base import Facts
from setid.proofs.evidence import EndProof
from setid.proofs.physical import verify_physical, with_relations
from sparsepop_py.verified.certificate.certificate import Certificate

U, Y = [4.0, -3.0, 2.0, 1.0], [0.0, -6.25, 1.175, 2.0875]
DATA, MODEL, NOISE = setid.IOData(U, Y), setid.TransferFunction(1, 1), setid.Noise(equation=0.5)


@functools.cache
def small():
    return setid.identify(DATA, MODEL, NOISE)


@functools.cache
def time_constant():
    return setid.reparametrise(small(), setid.Physical({"T": (0.01, 100)}, ["a1 = -T/(1 + T)"]))


def close(interval, low, high, accuracy=1e-4):
    """Proved outside, attained inside, and both close to the exact ends."""
    width = high - low
    assert interval.outer[0] <= low <= interval.inner[0] + 1e-9 * width
    assert interval.outer[1] >= high >= interval.inner[1] - 1e-9 * width
    assert interval.inner[0] - interval.outer[0] <= accuracy * width
    assert interval.outer[1] - interval.inner[1] <= accuracy * width


def test_a_monotone_relation():
    # a1 in [-45/86, -259/750] (data of Cerone, Piga, Regruto 2012); T = -a1 / (1 + a1)
    result = time_constant()
    close(result.intervals["T"], 259 / 491, 45 / 41)
    assert result.intervals["T"].status is setid.IntervalStatus.CERTIFIED
    assert result.verify(DATA) and result.verify()
    assert "T " in result.table() and "certified" in result.table()


def test_a_static_gain_is_a_linear_fractional_program():
    result = setid.reparametrise(small(), setid.Physical({"K": (0, 10)}, ["b0 = K*(1 + a1)"]))
    # Charnes, Cooper 1962: with t = 1 / (1 + a1), A = a1 t, B = b0 t it is linear in (A, B, t)
    rows, ends = [], []
    for k in range(1, 4):
        row = np.array([Y[k - 1], -U[k], Y[k]])
        rows += [row - [0, 0, 0.5], -row - [0, 0, 0.5]]
    for sign in (1.0, -1.0):
        found = linprog(
            [0, sign, 0],
            A_ub=rows,
            b_ub=np.zeros(6),
            A_eq=[[1, 0, 1]],
            b_eq=[1],
            bounds=[(None, None), (None, None), (0, None)],
        )
        ends.append(sign * found.fun)
    close(result.intervals["K"], *ends)
    assert result.verify(DATA)


def test_relations_as_a_prior_of_an_identification():
    prior = setid.Physical({"T": (0.6, 0.7)}, ["a1 = -T/(1 + T)"])
    result = setid.identify(DATA, MODEL, NOISE, prior)
    close(result.intervals["a1"], -0.7 / 1.7, -0.6 / 1.6)
    assert result.verify(DATA)
    assert setid.read_prior(repr(prior)) == prior


def test_inequalities_turn_around_with_negative_denominators():
    # a1 >= T / (T - 5) with T in [1, 2]: a1 (T - 5) <= T
    prior = setid.Physical({"T": (1, 2)}, ["a1 >= T/(T - 5)", "T = 2"])
    (first, _) = prior.rows(MODEL, symbols(prior), Facts({}, frozenset()))
    for a1, T in ((-0.5, 2.0), (-0.7, 2.0), (0.0, 1.0), (-0.3, 1.0)):
        assert (first.polynomial([a1, 1.0, T]) >= 0) == (a1 >= T / (T - 5))
    result = setid.reparametrise(small(), setid.Physical({"T": (1, 2)}, ["a1 <= T/(T - 5)"]))
    # some a1 in [-45/86, -259/750] is at most T / (T - 5) if -45/86 is: T <= 225/131
    close(result.intervals["T"], 1.0, 225 / 131)


def symbols(prior):
    import sparsepop_py as sp

    names = (*MODEL.parameters, *prior.names)
    return dict(zip(names, sp.variables(len(names), names), strict=True))


def test_several_ratios_in_one_relation():
    prior = setid.Physical({"p": (1, 2), "q": (-3, -1)}, ["a1 = 1/p + b0/q - 2", "p = 1"])
    (row, _) = prior.rows(MODEL, symbols(prior), Facts({}, frozenset()))
    for a1, b0, p, q in ((0.3, 0.7, 1.5, -2.0), (-1.0, 2.0, 1.25, -1.5)):
        value = (a1 - 1 / p - b0 / q + 2) * p * -q
        assert row.polynomial([a1, b0, p, q]) == pytest.approx(value, rel=1e-12)


def test_relations_that_contradict_the_record():
    physical = setid.Physical({"K": (0, 1)}, ["b0 = K*(1 + a1)"])  # the gain is at least 2.9
    result = setid.reparametrise(small(), physical)
    assert result.empty and result.verify(DATA) and "empty" in result.table()
    assert not verify_physical(small().evidence, physical, result.intervals, [], DATA)
    weak = [EndProof(None, None)] * len(result.ends)
    verdict = verify_physical(small().evidence, physical, result.intervals, weak, DATA)
    assert verdict.reason == "emptiness does not follow"


def test_an_empty_identification_leaves_nothing():
    empty = setid.identify(DATA, MODEL, setid.Noise(equation=0.001))
    result = setid.reparametrise(empty, setid.Physical({"T": (0.01, 100)}, ["a1 = -T/(1 + T)"]))
    assert result.empty and result.verify(DATA)
    full = time_constant().intervals
    assert not verify_physical(empty.evidence, result.physical, full, [], DATA)


# ---- damage -------------------------------------------------------------------------------------


def claims(result, **changes):
    item = replace(result.intervals["T"], **changes)
    return verify_physical(
        result.identification.evidence, result.physical, {"T": item}, result.ends, DATA
    ).reason


def test_false_claims_are_refused():
    result = time_constant()
    low, high = result.intervals["T"].outer
    assert claims(result) == ""
    assert "outer" in claims(result, outer=(low + 1e-4, high))
    assert "outer" in claims(result, outer=(low, high - 1e-4))
    first, last = result.intervals["T"].inner
    assert "inner" in claims(result, inner=(low - 1e-4, last))
    assert "inner" in claims(result, inner=(first, high + 1e-4))


def test_false_evidence_is_refused():
    result = time_constant()
    given = list(result.ends)
    known = result.identification.evidence, result.physical

    def said(ends, intervals=result.intervals, data=DATA):
        return verify_physical(*known, intervals, ends, data).reason

    assert said(given[:1]) == "the intervals are not those of the physical parameters"
    assert said(given, {"S": result.intervals["T"]}) == said(given[:1])
    assert said(given[::-1]) != ""
    assert "outer" in said([EndProof(None, given[0].attained), given[1]])
    assert "inner" in said([EndProof(given[0].certificate, None), given[1]])
    claim = Certificate(given[0].certificate.fingerprint, 50.0)
    assert said([EndProof(claim, given[0].attained), given[1]]) != ""
    moved = replace(given[0].attained, x=given[0].attained.x * 0.5)
    assert said([EndProof(given[0].certificate, moved), given[1]]) != ""
    assert said(given, data=setid.IOData(U, [*Y[:3], 2.0])) == "the result belongs to other data"


def test_words_claim_no_more_than_ends():
    """A status, a name or NaN once passed: EMPTY beside finite ends read as proved emptiness."""
    result = time_constant()
    known = result.identification.evidence, result.physical
    item = result.intervals["T"]
    kinds = setid.IntervalStatus
    wrong = [replace(item, status=s) for s in (kinds.EMPTY, kinds.UNBOUNDED, kinds.UNIDENTIFIABLE)]
    wrong += [replace(item, name="S"), replace(item, outer=(float("nan"), item.outer[1]))]
    for forged in wrong:
        assert not verify_physical(*known, {"T": forged}, result.ends, DATA).ok
    found = json.loads(result.to_json())
    found["reparametrisation"]["intervals"][0]["status"] = "EMPTY"
    with pytest.raises(setid.SetidError):
        setid.Reparametrisation.from_json(json.dumps(found))
    found["reparametrisation"]["intervals"] = "x"
    with pytest.raises(setid.SetidError, match="intervals: found 'x', expected a list"):
        setid.Reparametrisation.from_json(json.dumps(found))


def test_certified_ends_are_near_those_that_are_attained():
    """Wide ends, or none that is attained, once passed as certified."""
    result = time_constant()
    item = result.intervals["T"]
    wide = replace(item, outer=(0.1, 50.0))
    for forged in (wide, replace(wide, inner=None), replace(item, inner=None)):
        assert not replace(result, intervals={"T": forged}).verify()
    assert replace(result, intervals={"T": wide}, tol=1e3).verify()
    assert item.agrees(1e-3) and not replace(item, inner=None).agrees(1e3)
    for outer in ((-inf, inf), (0.1, inf), (-inf, 50.0)):
        assert not replace(item, outer=outer).agrees(1e3)
    open_ = replace(wide, inner=None, status=setid.IntervalStatus.PARTIAL)
    assert replace(result, intervals={"T": open_}).verify()
    found = json.loads(result.to_json())
    assert found["reparametrisation"]["tol"] == 1e-3
    found["reparametrisation"]["intervals"][0].update(outer=[0.1, 50.0], inner=None)
    with pytest.raises(setid.SetidError, match="of T is not what is proved"):
        setid.Reparametrisation.from_json(json.dumps(found))
    found["reparametrisation"]["intervals"][0].update(inner=list(item.inner))
    with pytest.raises(setid.SetidError, match="the ends of T are too far"):
        setid.Reparametrisation.from_json(json.dumps(found))


def test_files_say_how_near_certified_ends_are():
    result = replace(time_constant(), tol=0.25)
    assert setid.Reparametrisation.from_json(result.to_json()).tol == 0.25
    found = json.loads(result.to_json())
    del found["reparametrisation"]["tol"]  # as files of version 1 were before
    assert setid.Reparametrisation.from_json(json.dumps(found)).tol == 1e-3
    found["reparametrisation"]["tol"] = "wide"
    with pytest.raises(setid.SetidError, match="tol"):
        setid.Reparametrisation.from_json(json.dumps(found))


def test_intervals_of_coefficients_are_checked_too():
    result = time_constant()
    evidence = result.identification.evidence
    item = replace(evidence.intervals["a1"], outer=(-0.4, -0.35), inner=None)
    tighter = replace(evidence, intervals={**evidence.intervals, "a1": item})
    assert not verify_physical(tighter, result.physical, result.intervals, result.ends, DATA)


def test_files_keep_all_claims():
    result = time_constant()
    again = setid.Reparametrisation.from_json(result.to_json())
    assert again.intervals["T"].outer == result.intervals["T"].outer
    assert again.intervals["T"].inner == result.intervals["T"].inner
    assert again.physical == result.physical and again.verify(DATA)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: r["intervals"][0].update(outer=[0.6, 1.1]), "outer interval of T"),
        (lambda r: r["intervals"][0].update(inner=[0.1, 1.1]), "inner interval of T"),
        (
            lambda r: r["intervals"][0].update(inner=[9.0, -9.0], status="PARTIAL"),
            "9.0 attained by T",
        ),
        (lambda r: r["attained"].pop(), "expected a stored result"),
        (lambda r: r.update(physical=r["identification"]), "found|expected"),
        (lambda r: r.pop("notes"), "reparametrisation.notes: found nothing"),
        (lambda r: r.update(notes="one"), "notes: found 'one', expected a list of texts"),
        (lambda r: r["intervals"][0].update(status=1), r"intervals\[0\].status: found 1, expected"),
        (lambda r: r["intervals"][0].pop("outer"), r"intervals\[0\].outer: found nothing"),
        (lambda r: r["identification"].update(version=9), "expected"),
    ],
)
def test_damaged_files_are_refused(change, message):
    found = json.loads(time_constant().to_json())
    change(found["reparametrisation"])
    with pytest.raises(setid.SetidError, match=message):
        setid.Reparametrisation.from_json(json.dumps(found))


def test_other_texts_are_refused():
    for text in ("", "3", "{}", small().to_json()):
        with pytest.raises(setid.SetidError, match="from_json"):
            setid.Reparametrisation.from_json(text)


# ---- continuous time ----------------------------------------------------------------------------


def recorded(model, numerator, denominator, noise, samples):
    generator = np.random.default_rng(3)
    u = np.repeat(generator.choice([-1.0, 1.0], samples // 4 + 1), 4)[:samples]
    top, bottom = model.discrete([*denominator[1:], *numerator])
    y = lfilter(top, bottom, u) + generator.uniform(-noise, noise, samples)
    return setid.IOData(u, y, Ts=model.Ts)


CIRCUITS = {
    # (s + 1 / (R C)) y = 1 / (R C) u, R known to 5 %
    "RC": (
        {"R": 2.0, "C": 0.25},
        ([2.0], [1.0, 2.0]),
        setid.Physical({"R": (1.9, 2.1), "C": (0.01, 10)}, ["a0 = 1/(R*C)", "b0 = a0"]),
    ),
    # m y'' + c y' + k y = u
    "mass, damper, spring": (
        {"m": 2.0, "c": 1.5, "k": 4.0},
        ([0.5], [1.0, 0.75, 2.0]),
        setid.Physical(
            {"m": (0.1, 20), "c": (0, 20), "k": (0, 50)}, ["a1 = c/m", "a0 = k/m", "b0 = 1/m"]
        ),
    ),
    # voltage of the capacitor in a series circuit, R known to 10 %
    "RLC": (
        {"R": 1.0, "L": 0.5, "C": 0.4},
        ([5.0], [1.0, 2.0, 5.0]),
        setid.Physical(
            {"R": (0.9, 1.1), "L": (0.01, 10), "C": (0.01, 10)},
            ["a1 = R/L", "a0 = 1/(L*C)", "b0 = 1/(L*C)"],
        ),
    ),
}


@pytest.mark.parametrize("name", CIRCUITS)
def test_simulated_circuits(name):
    truth, (numerator, denominator), physical = CIRCUITS[name]
    n = len(denominator) - 1
    model = setid.ContinuousTransferFunction(n, 0, hold="constant", Ts=0.1 if n == 1 else 0.2)
    data = recorded(model, numerator, denominator, 0.005, 24)
    options = setid.Options(time_limit=60)
    found = setid.identify(data, model, setid.Noise(output=0.005), setid.Stable(), options)
    result = setid.reparametrise(found, physical, options)
    assert result.verify(data)
    for key, value in truth.items():
        interval = result.intervals[key]
        assert interval.outer[0] <= value <= interval.outer[1]
        assert interval.status is setid.IntervalStatus.CERTIFIED
        low, high = physical.intervals[key]
        assert interval.width < 0.5 * (high - low) or key == "R"  # the record says something


# ---- refusals -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("intervals", "relations", "message"),
    [
        ({}, ["a1 = 1"], "expected a mapping"),
        ({"T": (2, 1)}, ["a1 = T"], "expected low <= high"),
        ({"T 1": (1, 2)}, ["a1 = T"], "found the name 'T 1'"),
        ({"T": (1, 2)}, [], "found none"),
        ({"T": (1, 2)}, ["a1"], "expected an equation or inequality"),
        ({"T": (1, 2)}, ["a1 = T = 2"], "expected an equation or inequality"),
        ({"T": (1, 2)}, [3], "expected an equation or inequality"),
    ],
)
def test_malformed_relations_are_refused(intervals, relations, message):
    with pytest.raises(setid.PriorError, match=message):
        setid.Physical(intervals, relations)


@pytest.mark.parametrize(
    ("intervals", "relations", "message"),
    [
        ({"T": (-1, 2)}, ["a1 = 1/T"], r"sign of the denominator T is not proved, only -1 <= T <="),
        ({"T": (0, 2)}, ["a1 = 1/T"], "sign of the denominator T is not proved"),
        ({"T": (1, 2)}, ["a1 = T + S"], "unknown name 'S'"),
        ({"T": (1, 2)}, ["a1 = exp(T)"], "function 'exp'"),
        ({"T": (1, 2)}, ["a1 = "], "found"),
        ({"a1": (1, 2)}, ["a1 = b0"], "which is a parameter of the structure"),
        ({"T": (1, 2)}, ["a1 = 1/(b0 - 2)"], "sign of the denominator .* b0 is not proved"),
    ],
)
def test_relations_that_do_not_fit_are_refused(intervals, relations, message):
    with pytest.raises(setid.PriorError, match=message):
        setid.reparametrise(small(), setid.Physical(intervals, relations))


def test_wrong_arguments():
    physical = setid.Physical({"T": (1, 2)}, ["a1 = T"])
    with pytest.raises(setid.SetidError, match="result: found int"):
        setid.reparametrise(1, physical)
    with pytest.raises(setid.SetidError, match="physical: found dict"):
        setid.reparametrise(small(), {})


def test_the_limit_counts_how_the_problem_is_stated(monkeypatch: pytest.MonkeyPatch) -> None:
    left = []
    state, solve = reparametrise.with_relations, sp.solve_each

    def slowly(*given):
        time.sleep(0.02)
        return state(*given)

    def noted(problem, objectives, options, start):
        left.append(options.time_limit)
        return solve(problem, objectives, options, start=start)

    monkeypatch.setattr(reparametrise, "with_relations", slowly)
    monkeypatch.setattr(reparametrise.sp, "solve_each", noted)
    physical = setid.Physical({"K": (0, 10)}, ["b0 = K"])
    setid.reparametrise(small(), physical, setid.Options(time_limit=5.0, progress=False))
    assert len(left) == 1 and 0 < left[0] <= 4.98


@pytest.mark.parametrize("status", ["CERTIFIED", "PARTIAL", "UNBOUNDED", "UNIDENTIFIABLE"])
def test_an_empty_set_has_empty_intervals_with_their_names(status):
    contradicts = setid.Physical({"K": (0, 1)}, ["b0 = K*(1 + a1)"])
    nothing = setid.identify(DATA, MODEL, setid.Noise(equation=0.001))
    empty = setid.Physical({"T": (0.01, 100)}, ["a1 = -T/(1 + T)"])
    for identified, physical, name in ((small(), contradicts, "K"), (nothing, empty, "T")):
        result = setid.reparametrise(identified, physical)
        known = result.identification.evidence, physical
        item = result.intervals[name]
        assert verify_physical(*known, {name: item}, result.ends, DATA).ok
        for forged in (
            replace(item, status=setid.IntervalStatus[status]),
            replace(item, name="S"),
        ):
            assert not verify_physical(*known, {name: forged}, result.ends, DATA).ok


def test_divisors_have_the_sign_that_the_record_proves() -> None:
    u = np.random.default_rng(0).uniform(-1, 1, 60)
    model, noise = setid.TransferFunction(1, 1, 1), setid.Noise(output=0.01)
    data = setid.simulate_record(model, [-0.6, 0.8], u, noise, seed=1).data
    known = setid.identify(data, model, noise)
    divided, multiplied = (
        setid.reparametrise(known, setid.Physical({"K": (0, 10)}, [relation]))
        for relation in ("K = b1/(1 + a1)", "b1 = K*(1 + a1)")
    )
    assert divided.intervals["K"].outer == pytest.approx(multiplied.intervals["K"].outer, rel=1e-3)
    assert divided.verify(data) and setid.Reparametrisation.from_json(divided.to_json()).verify()
    with pytest.raises(setid.PriorError, match=r"the sign of the denominator 0.6 \+ a1 is not"):
        setid.reparametrise(known, setid.Physical({"K": (0, 10)}, ["K = b1/(0.6 + a1)"]))


def test_a_box_about_intervals_leaves_out_nothing_that_is_proved() -> None:
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    known = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    ratio = setid.Physical({"K": (-9, 9)}, ["K = a1/(b0 - 1)"])
    problem = with_relations(known.formulation, ratio, known.intervals).problem
    for k, item in enumerate(known.intervals.values()):
        assert problem.lower[k] < item.outer[0] and item.outer[1] < problem.upper[k]
    least = float(known.intervals["b0"].outer[0])
    near = setid.Physical({"K": (-9, 9)}, [f"K = a1/(b0 - {least!r})"])  # zero at a proved end
    with pytest.raises(setid.PriorError, match="the sign of the denominator"):
        with_relations(known.formulation, near, known.intervals)


def test_a_summary_has_status_and_assumptions() -> None:
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    known = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    found = setid.reparametrise(known, setid.Physical({"K": (0, 10)}, ["b0 = K*(1 + a1)"]))
    assert str(found.status) == "certified"
    for text in (found.table(), "certified: Proved", "b0 = K*(1 + a1)", *known.assumptions):
        assert text in found.summary()


def test_a_parameter_that_is_known_exactly_is_certified() -> None:
    """Its bounds are equal: all consistent parameters have this value, however points round."""
    result = setid.reparametrise(small(), setid.Physical({"K": (2, 2), "G": (0, 9)}, ["b0 = K*G"]))
    known = result.intervals["K"]
    assert known.outer == known.inner == (2.0, 2.0) and str(known.status) == "certified"
    assert result.verify(DATA)
    back = setid.Reparametrisation.from_json(result.to_json())
    assert back.intervals["K"].inner == (2.0, 2.0)
