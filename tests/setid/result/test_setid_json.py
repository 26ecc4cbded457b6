"""Identifications as JSON, pickles, copies and frames come back as they went out, verified."""

from __future__ import annotations

import copy
import json
import pickle
import random
from collections.abc import Iterator
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np
import pytest

import setid
from setid.analysis.reparametrise import Reparametrisation
from setid.control.certificates import stored
from setid.proofs.denominators.denominator_box import DenominatorBox, Limit
from setid.proofs.denominators.denominator_cells import Cell, VaryingLeaf
from setid.proofs.denominators.varying_multipliers import VaryingCells
from setid.proofs.parameter_box import problem_on_box
from sparsepop_py.io.json_files.certificates import CERTIFICATES

FAST = setid.Options(time_limit=5.0, progress=False)
FIRST = setid.TransferFunction(na=1, nb=1, nk=1)


def record(noise: setid.Noise, model: object = FIRST, theta: object = (-0.6, 1.0)) -> setid.IOData:
    u = np.random.default_rng(0).uniform(-1, 1, 25)
    return setid.simulate_record(model, theta, u, noise, 1).data  # type: ignore[arg-type]


def equation() -> setid.Identification:
    noise = setid.Noise(equation=0.05)
    named = setid.parameters(FIRST)
    priors = [setid.Stable(), setid.Box({"b1": (None, 9.0)}), named["a1"] + named["b1"] >= -3]
    return setid.identify(record(noise), FIRST, noise, priors, FAST)


def sensors() -> setid.Identification:
    noise = setid.Noise(output=0.05, input=0.02)
    return setid.identify(record(noise), FIRST, noise, (), FAST)


def block() -> setid.Identification:
    noise = setid.Noise(output=0.01)
    model = setid.Hammerstein(FIRST, 2)
    data = record(noise, model, (-0.6, 1.0, 1.0, 0.3))
    options = setid.Options(time_limit=5.0, progress=False, unidentifiable="report")
    return setid.identify(data, model, noise, (), options)


def polynomial() -> setid.Identification:
    noise = setid.Noise(equation=0.05, constraints=[setid.EnergyBound("equation", 5.0)])
    model = setid.PolynomialNARX(["y1", "u1", "y1*u1"], ny=1, nu=1)
    data = record(setid.Noise(equation=0.05), model, (0.5, 1.0, 0.2))
    return setid.identify(data, model, noise, (), FAST)


def refuted() -> setid.Identification:
    noise = setid.Noise(output=0.001)
    return setid.identify(record(setid.Noise(output=0.5)), FIRST, noise, (), FAST)


def cones() -> setid.Identification:
    """The last sample alone says 4 b = 2 + a + noise, at most .1 (1 + abs(a)) in size."""
    data = setid.IOData([1.0, 2.0, 4.0], [0.5, 1.0, 2.0])
    model = setid.TransferFunction(na=1, nb=1)
    priors = [setid.Stable(), setid.Box({"b0": (-9, 9)})]
    known = setid.formulate(data, model, setid.Noise(output=0.1), priors)
    leaf = VaryingLeaf((), (), ())
    cells = (Cell((1, 2), (0, 1), (1, 1)), leaf, leaf)
    tree = VaryingCells(0, np.array([2]), np.array([[0.0, 0.0, -1.0]]), cells)
    limits = Limit(0, 0, 1, 0.81, (0, 0), (0, 0)), Limit(1, 0, 1, 0.53, (0, 0), (0, 0))
    low, high = np.array([-1.0, -9.0]), np.array([1.0, 0.81])
    box = DenominatorBox(known.parameters, low, high, None, (tree,), (limits,))
    ends = zip(known.parameters, low.tolist(), high.tolist(), strict=True)
    partial = setid.IntervalStatus.PARTIAL
    items = {n: setid.ParameterInterval(n, (a, b), None, partial) for n, a, b in ends}
    problem = problem_on_box(known, box)
    return setid.Identification(
        known, items, problem, setid.Options(), known.assumptions, box, (), ()
    )


CASES = [equation, sensors, block, polynomial, refuted, cones]


@pytest.mark.parametrize("case", CASES)
def test_json_pickle_and_copies_keep_every_claim(case: object) -> None:
    result: setid.Identification = case()  # type: ignore[operator]
    text = result.to_json()
    json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    back = setid.Identification.from_json(text)
    for other in (back, pickle.loads(pickle.dumps(result)), copy.deepcopy(result)):
        assert repr(other) == repr(result) and other.summary() == result.summary()
        assert other.verify(result.formulation.data)
        assert len(other.witnesses) == len(result.witnesses)
        for mine, theirs in zip(other.witnesses, result.witnesses, strict=True):
            assert np.array_equal(mine, theirs)
    assert back.to_json() == text


def test_a_result_that_was_read_serves_as_before() -> None:
    result = sensors()
    back = setid.Identification.from_json(result.to_json())
    bands = [setid.step_band(found, 10, tolerance=100.0) for found in (back, result)]  # no clock
    assert np.array_equal(bands[0].high, bands[1].high)
    assert back.best().theta == pytest.approx(result.best().theta)
    assert back.options == result.options


def changed(result: setid.Identification, *path: object, value: object) -> str:
    found = json.loads(result.to_json())
    place = found["result"]
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return json.dumps(found)


def test_claims_that_do_not_follow_are_refused() -> None:
    linear, general = equation(), sensors()
    for result in (linear, general):
        low, high = result.intervals["a1"].outer
        narrower = [low + 0.4 * (high - low), high]
        with pytest.raises(setid.SetidError, match="outer interval of a1 does not follow"):
            text = changed(result, "intervals", 0, "outer", value=narrower)
            setid.Identification.from_json(text)
        with pytest.raises(setid.SetidError, match="inner interval of a1 is not attained"):
            text = changed(result, "intervals", 0, "inner", value=[low - 1.0, high + 1.0])
            setid.Identification.from_json(text)
        # both ends say too little to be wrong, as values at most 5 and at least -5 are attained
        for inner in ([5.0, -5.0], [high + 1e-3, low - 1e-3], [high, low - 1e-3]):
            open_ = json.loads(changed(result, "intervals", 0, "inner", value=inner))
            open_["result"]["intervals"][0]["status"] = "PARTIAL"
            with pytest.raises(setid.SetidError, match="attained by a1, expected it in"):
                setid.Identification.from_json(json.dumps(open_))
        with pytest.raises(setid.SetidError, match="outer|fingerprint|not that of|does not follow"):
            y = json.loads(result.to_json())["result"]["data"]["fields"]["y"]
            y["data"][3] += 1e-3
            setid.Identification.from_json(changed(result, "data", "fields", "y", value=y))


def test_attained_points_are_read_as_their_proofs_give_them() -> None:
    """y(1) + a y(0) = 0 with y = 1, 1 and noise of 0.1: a is at least -1.1 / 0.9."""
    data, model = setid.IOData([1.0, 0.0], [1.0, 1.0]), setid.TransferFunction(1, 1)
    priors = setid.Box({"a1": (-9, 9), "b0": (1, 2)})
    result = setid.identify(data, model, setid.Noise(output=0.1), [priors], FAST)
    found = json.loads(result.to_json())
    ends = found["result"]["ends"]
    radius, ends["attained"][0]["radius"] = ends["attained"][0]["radius"], 0.0
    again = setid.Identification.from_json(json.dumps(found)).results[0]
    assert again.attained.radius == radius > 0.0
    ends["results"][0]["upper_bound"] = ends["attained"][0]["value"] = -8.0
    again = setid.Identification.from_json(json.dumps(found)).results[0]
    assert again.upper_bound >= again.attained.value >= -1.1 / 0.9 - 1e-12
    ends["attained"][0]["x"]["data"][0] -= 0.25
    again = setid.Identification.from_json(json.dumps(found)).results[0]
    assert again.upper_bound >= again.attained.value >= -1.1 / 0.9 - 1e-12
    assert abs(again.attained.x[0] - again.attained.value) <= 1e-12
    ends["attained"][0]["rows"], ends["attained"][0]["solved"] = [
        dict(ends["attained"][0][name], shape=[0], data=[]) for name in ("rows", "solved")
    ]
    with pytest.raises(setid.SetidError, match="attained: found a point that could not be proved"):
        setid.Identification.from_json(json.dumps(found))


def test_points_are_known_up_to_rounding_beside_ends_at_zero() -> None:
    """The engine proves a0 = 0 of an integrator, and points are attained near 0."""
    model = setid.ContinuousTransferFunction(1, 0, hold="constant", Ts=1e-3)
    u = np.array([1.0, -2, 2, 3, -1, -3, 0, 1, 2, -2, 1, 0])
    y = np.append(0.0, np.cumsum(750.0 * 1e-3 * u[:-1])) + 0.1 * np.cos(np.arange(12))
    priors = [setid.Stable(), setid.PoleIn(0.0, 0.0)]
    options = setid.Options(time_limit=1.5, progress=False)
    data = setid.IOData(u, y, 1e-3)
    result = setid.identify(data, model, setid.Noise(output=0.15), priors, options)
    low, high = result.intervals["a0"].outer
    assert low == high == 0.0
    text = result.to_json()
    assert setid.Identification.from_json(text).to_json() == text


def test_witnesses_that_are_no_members_are_refused() -> None:
    result = sensors()
    found = json.loads(result.to_json())["result"]["intervals"][0]["witnesses"][0]
    found["data"][0] += 1.0
    with pytest.raises(setid.SetidError, match="violates the rows"):
        setid.Identification.from_json(changed(result, "intervals", 0, "witnesses", 0, value=found))
    # a1, b1, 25 samples of the output noise, 24 of the input noise: the last input enters no row
    with pytest.raises(setid.SetidError, match="expected \\(51,\\), finite"):
        found |= {"shape": [2], "data": [0.0, 0.0]}
        setid.Identification.from_json(changed(result, "intervals", 0, "witnesses", 0, value=found))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "JSON"),
        ("[]", "expected an object of JSON"),
        ('{"format":"setid","version":1,"is":"identification"}', "format"),
        ('{"format":"setid","version":1,"is":"result","result":{}}', "result.data: found nothing"),
    ],
)
def test_other_texts_are_refused(text: str, why: str) -> None:
    with pytest.raises(setid.SetidError, match=why):
        setid.Identification.from_json(text)


def test_only_classes_of_setid_are_made() -> None:
    text = changed(equation(), "model", value={"is": "Popen", "fields": {"args": "true"}})
    with pytest.raises(setid.SetidError, match="found a 'Popen', expected a class of setid"):
        setid.Identification.from_json(text)


def test_functions_have_no_text() -> None:
    noise = setid.Noise(output=0.01)
    model = setid.Hammerstein(FIRST, [np.tanh], "gamma1")
    data = record(noise, model, (-0.6, 1.0))
    result = setid.identify(data, model, noise, (), FAST)
    with pytest.raises(setid.SetidError, match=r"model\.maps.*of which there is no text"):
        result.to_json()


def test_frame_of_intervals() -> None:
    pytest.importorskip("pandas")
    result = equation()
    frame = result.to_frame()
    assert list(frame.index) == ["a1", "b1"]
    assert tuple(frame.loc["b1", ["outer_low", "outer_high"]]) == result.intervals["b1"].outer
    assert frame.loc["a1", "status"] == "certified"
    assert np.isnan(refuted().to_frame().loc["a1", "inner_low"])


@pytest.mark.parametrize(
    "read", [setid.Identification.from_json, stored.from_json, Reparametrisation.from_json]
)
def test_names_that_stand_twice_are_refused(read):
    with pytest.raises(setid.SetidError, match="found the name 'format' twice in one object"):
        read('{"format": "setid", "format": "setid", "version": 1}')


# ---- damaged texts --------------------------------------------------------------------------

FIELDS = ("box", "fields")
TREE, LIMIT = (*FIELDS, "trees", 0, "fields"), (*FIELDS, "limits", 0, 0)


@pytest.mark.parametrize(
    ("path", "value", "why"),
    [
        ((*FIELDS, "first"), 7, r"box\.first: found 7, expected ParameterBox \| .*None"),
        ((*FIELDS, "trees"), 5, r"box\.trees: found 5, expected tuple\[VaryingCells, \.\.\.\]"),
        (LIMIT, None, r"box\.limits: found .*expected tuple\[tuple\[Limit"),
        ((*LIMIT, "fields", "value"), 10**400, r"limits\[0\]\[0\]\.value: .*expected float"),
        ((*LIMIT, "fields", "value"), 1e308, "the box does not follow from the data"),
        ((*LIMIT, "fields", "powers"), [0.5, 0], r"powers: found \(0\.5, 0\), expected tuple\[int"),
        ((*LIMIT, "fields", "used"), None, r"limits\[0\]\[0\]\.used: found None, expected tuple"),
        ((*LIMIT, "fields", "sign"), True, r"limits\[0\]\[0\]\.sign: found True, expected int"),
        ((*TREE, "output"), 0.5, r"trees\[0\]\.output: found 0\.5, expected int"),
        ((*TREE, "free"), [1e308, 1], r"box\.trees\[0\]: OverflowError"),
        ((*TREE, "multipliers"), 10**400, r"box\.trees\[0\]: OverflowError"),
        ((*TREE, "cells", 2), 7, r"trees\[0\]\.cells: found .*expected tuple\[Cell \| VaryingLeaf"),
        (
            (*TREE, "cells", 0, "fields", "edge"),
            ["x", 1],
            r"edge: found .*expected tuple\[int, int\]",
        ),
        (
            (*TREE, "cells", 0, "fields", "weights"),
            [0.5, 1.5],
            r"weights: .*expected tuple\[int, int\]",
        ),
        ((*TREE, "cells", 0, "fields", "children"), [[]], "children: found .*expected tuple"),
        ((*FIELDS, "lower", "shape"), [2, 1], "box: ValueError"),
        (("unbounded",), "u", r"result\.unbounded: found 'u', expected Unbounded \| None"),
        (("bounds",), [3], r"result\.bounds: found \(3,\), expected tuple\[LinearBound"),
        (("options", "tol"), 10**400, "tol"),
        (("timings",), {"box": 10**400}, "timings.box: found 1000.*expected a float"),
        (("intervals", 0, "name"), 7, r"intervals\[0\]\.name: found 7, expected str"),
        (("notes",), 3, "notes: found 3, expected a list of texts"),
        (("notes",), "text", "notes: found 'text', expected a list of texts"),
        (("timings",), [], r"timings: found \[\], expected an object"),
        (("active",), True, "active: found True, expected an object"),
        (("active",), {"Stable": 1}, "active.Stable: found 1, expected a bool"),
        (("samples",), [[1]], r"samples: found \(\(1,\),\), expected tuple"),
        (("ends",), None, "ends: found None, expected an object"),
        (("ends",), {}, "ends.attained: found nothing"),
        (("ends", "attained"), 3, "ends.attained: found 3, expected a list"),
        (("ends", "results"), True, "ends.results: found True, expected a list"),
        (("options",), [], r"options: found \[\], expected an object"),
        (("intervals",), "x", "intervals: found 'x', expected a list"),
        (("intervals", 0), [], r"intervals\[0\]: found \[\], expected an object"),
        (("intervals", 0, "status"), [], r"intervals\[0\]\.status: found \[\], expected one of"),
        (
            ("intervals", 0, "witnesses"),
            [None],
            r"\[0\]\.witnesses: found 1, expected two",
        ),
        (("intervals", 1, "outer"), {}, r"intervals\[1\]\.outer: found {}"),
        (("priors",), None, "priors: found None, expected a list"),
        (("driven",), {}, "result.data: found nothing"),
        (("box",), [], "box: AttributeError"),
        (("fingerprint",), "x", "fingerprint: found 'x', expected that of the problem"),
    ],
)
def test_damaged_fields_are_named(path: tuple[str | int, ...], value: object, why: str) -> None:
    with pytest.raises(setid.SetidError, match=why):
        setid.Identification.from_json(changed(cones(), *path, value=value))


def test_what_verification_ends_in_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    text = cones().to_json()
    monkeypatch.setattr(setid.Identification, "verify", lambda self: [0.5][1])
    with pytest.raises(setid.SetidError, match="from_json: verification: IndexError"):
        setid.Identification.from_json(text)


def places(found: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Each place in a text, of long lists some."""
    if path:
        yield path
    items: Any = found.items() if isinstance(found, dict) else ()
    if isinstance(found, list):
        items = list(enumerate(found))[:: max(1, len(found) // 6)]
    for key, value in items:
        yield from places(value, (*path, key))


DAMAGE = [10**400, None, 0.5, -1, 7, True, "x", [], {}, [[]], [0.5, 0], 1e308, 5e-324, -(2**63)]


@pytest.mark.parametrize(("case", "count"), [(cones, 150), (equation, 40), (refuted, 40)])
def test_damage_ends_in_a_message_or_in_claims_that_hold(case: Any, count: int) -> None:
    result, chance = case(), random.Random(case.__name__)
    all_places = list(places(json.loads(result.to_json())["result"]))
    refused = 0
    damage = (chance.choices(items, k=count) for items in (all_places, DAMAGE))
    for path, value in zip(*damage, strict=True):
        try:
            assert setid.Identification.from_json(changed(result, *path, value=value)).verify()
        except setid.SetidError:
            refused += 1
    assert refused > count / 2


def test_certified_ends_are_near_those_that_are_attained() -> None:
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    found = json.loads(result.to_json())
    assert found["result"]["intervals"][0]["status"] == "CERTIFIED"
    found["result"]["intervals"][0]["outer"] = [-100.0, 100.0]
    with pytest.raises(setid.SetidError, match="the ends of a1 are too far"):
        setid.Identification.from_json(json.dumps(found))
    for outer in ((-100.0, 100.0), (-inf, inf)):
        wide = replace(result.intervals["a1"], outer=outer)
        forged = replace(result, intervals={**result.intervals, "a1": wide})
        assert not forged.verify() and not setid.verify(forged)
    found["result"]["intervals"][0]["status"] = "PARTIAL"
    assert setid.Identification.from_json(json.dumps(found)).intervals["a1"].outer[1] == 100.0


@pytest.mark.parametrize(
    ("key", "value", "why"),
    [
        ("lower_bound", "x", "lower_bound: found 'x', expected a number"),
        ("solver_value", {}, "solver_value: found {}"),
        ("status", 3, "status: found 3, expected one of OPTIMAL"),
        ("notes", None, "notes: found None, expected a list of texts"),
    ],
)
def test_damaged_ends_are_named(key: str, value: object, why: str) -> None:
    """Four ends without proof, the last of which is damaged."""
    end: dict[str, object] = {"lower_bound": 0, "upper_bound": 0, "solver_value": 0, "notes": []}
    end |= {"status": "LIMIT", "x": None}
    ends = {"attained": [None] * 4, "certificates": CERTIFICATES.write([None] * 4)}
    ends["results"] = [end] * 4
    assert setid.Identification.from_json(changed(cones(), "ends", value=ends)).results
    ends["results"] = [end] * 3 + [{**end, key: value}]
    with pytest.raises(setid.SetidError, match=rf"ends\.results\[3\]\.{why}"):
        setid.Identification.from_json(changed(cones(), "ends", value=ends))
