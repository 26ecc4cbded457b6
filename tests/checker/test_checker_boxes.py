"""Boxes of parameters from a record: directions, products, and what damage does to their proofs."""

from __future__ import annotations

import copy
import json
import math
import random
from fractions import Fraction

import certificate_damage as damage
import pytest
from record_corpus import written

from checker.arithmetic import interval as iv
from checker.files import reading
from checker.records.box import nothing
from checker.records.parameter_box import cube_side, proved_box, total_by
from checker.records.record import Identification
from checker.result import NotProved

INF = math.inf
PROVED = {"strong-oi": "Directions", "two-poles-o": "Products", "simulated-free-0": "Simulation"}
OFFSETS = {"two-poles-offset-auto": "Products", "two-poles-offset-direct": "Products"}
LONGEST = {"strong-oi", "two-poles-o", *OFFSETS}  # ten seconds and more of exact arithmetic


def loaded(name: str) -> dict:
    return json.loads(written(name))["identification"]


def boxed(found: dict) -> tuple[Identification, list]:
    """The box that a file proves, after a check of its rows."""
    about = Identification(found)
    about.check_rows()
    box, taken = proved_box(about)
    assert not taken
    return about, box


def verdict(found: dict) -> str:
    try:
        boxed(found)
    except NotProved:
        return "refused"
    except reading.Malformed:
        return "malformed"
    return "accepted"


def step_of(found: dict, kind: str) -> dict:
    return next(step for step in found["box"]["steps"] if step["is"] == kind)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] * (name in LONGEST)) for name in PROVED | OFFSETS],
)
def test_boxes_of_strong_noise_and_of_two_denominators_are_proved(name):
    found = loaded(name)
    step_of(found, (PROVED | OFFSETS)[name])
    lines = Identification(found).check()
    assert not any(line.startswith("taken as given") for line in lines)
    assert sum("attained from" in line for line in lines) == len(found["parameters"])


def test_a_tree_with_empty_parts_next_to_unbounded_ones():
    """Parts that linear programs prove empty do not count, however large their boxes are."""
    found = loaded("strong-oi")
    del found["box"]["steps"][1:]
    tree = step_of(found, "SignTree")["nodes"]
    assert any(bound["empty"] for node in tree for bound in node["bounds"])
    assert any(not bound["multipliers"] for node in tree for bound in node["bounds"])
    p = len(found["parameters"])
    found["box"] |= {"lower": ["-inf"] * p, "upper": ["inf"] * p}
    assert verdict(found) == "accepted"
    found["box"]["upper"][0] = 100.0
    assert verdict(found) == "refused"  # these rows one by one leave it unbounded


def test_trees_of_signs_whose_nodes_are_shared_take_no_time():
    """Fifty nodes with both children alike would be 2^50 leaves."""
    found = loaded("strong-oi")
    tree = step_of(found, "SignTree")
    leaf = {"split": -1, "children": [], "rows": [], "bounds": []}
    tree["nodes"] = [leaf | {"split": 0, "children": [k + 1] * 2} for k in range(50)] + [leaf]
    assert verdict(found) == "malformed"


@pytest.mark.parametrize(("name", "kind"), [("strong-oi", "SignTree"), *list(PROVED.items())[2:]])
def test_trees_without_nodes_are_malformed(name, kind):
    found = loaded(name)
    step_of(found, kind)["nodes"] = []
    assert verdict(found) == "malformed"


@pytest.mark.parametrize("change", [lambda v: v / 2, lambda v: -v, lambda v: 0.0])
def test_left_inverses_of_a_record_are_not_believed(change):
    found = loaded("o-0")
    step = step_of(found, "LeftInverse")
    assert verdict(found) == "accepted"
    step["radius"] = [change(v) for v in step["radius"]]
    assert verdict(found) == "refused"


# ---- directions ---------------------------------------------------------------------------------


def halved(values):
    values[:] = [value / 2 for value in values]


def with_claims(step, change):
    for side in step["sides"]:
        last = side["certificate"][-1]
        last["bound"] = change(last["bound"])


FORGED = {
    "smaller units": lambda s: halved(s["scale"]),
    "larger claims": lambda s: with_claims(s, lambda v: 3.9 if v == "inf" else v + 3.0),
    "no far point on any side": lambda s: with_claims(s, lambda v: "inf"),
    "claims of nothing": lambda s: with_claims(s, lambda v: -1.0),
    "sides in another order": lambda s: s["sides"].reverse(),
    "a side less": lambda s: s["sides"].pop(),
    "no rows": lambda s: [side.update(rows=[], factors=[]) for side in s["sides"]],
    "rows of nothing": lambda s: s["sides"][0]["rows"].__setitem__(0, 10**6),
    "a negative number of a row": lambda s: s["sides"][0]["rows"].__setitem__(0, -1),
    "a negative factor": lambda s: s["sides"][0]["factors"].__setitem__(0, -1.0),
    "factors of less rows": lambda s: s["sides"][0]["factors"].pop(),
    "a smaller first box": lambda s: s.update(lower=[-1.0] * 3, upper=[1.0] * 3),
    "a unit that is no power": lambda s: s["sides"][0]["units"].__setitem__(0, 3.0),
    "a scale of zero": lambda s: s["scale"].__setitem__(0, 0.0),
    "a negative scale": lambda s: s["scale"].__setitem__(0, -1.0),
    "units of less unknowns": lambda s: s["sides"][0]["units"].pop(),
    "another kind": lambda s: s.update({"is": "Compass"}),
}


@pytest.mark.parametrize("change", FORGED)
def test_forged_directions_are_refused(change):
    found = loaded("strong-oi")
    FORGED[change](step_of(found, "Directions"))
    assert verdict(found) != "accepted"


@pytest.mark.parametrize(("side", "end"), [("lower", -1.0), ("upper", 1.0)])
def test_directions_may_assume_no_more_than_the_box_before_them(side, end):
    found = loaded("strong-oi")
    step_of(found, "Directions")[side][0] = end
    with pytest.raises(NotProved, match="about a smaller box"):
        boxed(found)


def test_rows_of_directions_vanish_where_the_record_was_made():
    """phi = s theta / c: a row of the cube is the row of the record times s, by hand."""
    found = loaded("strong-o")
    about = Identification(found)
    step = step_of(found, "Directions")
    scale = [Fraction(v) for v in step["scale"]]
    assumed = [[-INF, Fraction(-2), -INF], [Fraction(3), INF, INF]]
    side = copy.deepcopy(step["sides"][3])
    side["factors"] = [*([1.0] * len(side["rows"])), 2.0, 4.0]
    made, size = cube_side(about, side, scale, assumed, (1, 1))
    y, u = about.record.y[0], about.record.u[0]
    theta, s = [Fraction(-1, 2), Fraction(1, 4), Fraction(3, 4)], Fraction(1, 8)
    n = about.problem.dimension
    noise = [Fraction(v, 100) for v in range(n - 3)]
    x = [*(s * t / c for t, c in zip(theta, scale, strict=True)), *noise, s]
    z = [value / Fraction(unit) for value, unit in zip(x, side["units"], strict=True)]
    eta = {k: x[about.record.letters["eta", 1, k] - 1] for k in range(len(y))}
    samples = [about.got.rows[row][1] for row in side["rows"]]
    for k, row in zip(samples, made.constraints, strict=False):
        clean = [y[k - lag] - eta[k - lag] for lag in range(3)]
        value = clean[0] + theta[0] * clean[1] + theta[1] * clean[2] - theta[2] * u[k - 1]
        assert row.equality and abs(row.polynomial.at(z)) == abs(s * value)
    low, high = made.constraints[-2:]  # theta_1 <= 3 stands first: rows go by parameter
    assert low.polynomial.at(z) == 2 * s * (3 - theta[0])
    assert high.polynomial.at(z) == 4 * s * (theta[1] + 2)
    used = about.record.letters["eta", 1, samples[0]] - 1
    assert made.upper[used] * Fraction(side["units"][used]) == Fraction(0.35) == -made.lower[used]
    assert (made.lower[1], made.upper[1]) == (-1, -1)
    assert (made.lower[0], made.upper[0]) == (-1, 1)
    assert (made.lower[-1] * size, made.upper[-1] * size) == (0, 4)


def test_directions_need_rows_that_are_linear_in_the_parameters():
    about = Identification(loaded("two-poles-o"))
    n, p = about.problem.dimension, len(about.names)
    side = {"rows": [1], "units": [1.0] * (n + 1), "factors": [1.0]}
    free = [[-INF] * p, [INF] * p]
    with pytest.raises(reading.Malformed, match="not linear"):
        cube_side(about, side, [Fraction(1)] * p, free, (0, 0))


# ---- products -----------------------------------------------------------------------------------


def swap(columns):
    columns[0], columns[1] = columns[1], columns[0]


SPOILED = {
    "columns exchanged": lambda s: swap(s["columns"]),
    "a column less": lambda s: s["columns"].pop(),
    "two columns in one": lambda s: s["columns"].__setitem__(0, s["columns"][0] + s["columns"][2]),
    "a product less": lambda s: s["columns"][0].pop(),
    "a product of others": lambda s: s["columns"][-1].__setitem__(0, [0, 0]),
    "no rows": lambda s: s.update(steps=[]),
    "directions inside": lambda s: s["steps"].append({"is": "Directions"}),
    "products inside": lambda s: s["steps"].append(copy.deepcopy(s)),
}


@pytest.mark.parametrize("change", SPOILED)
def test_spoiled_products_are_refused(change):
    found = loaded("two-poles-o")
    assert any(len(column) > 1 for column in step_of(found, "Products")["columns"])
    SPOILED[change](step_of(found, "Products"))
    assert verdict(found) != "accepted"


# ---- both ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PROVED)
def test_narrower_boxes_do_not_follow(name):
    found = loaded(name)
    about, _ = boxed(found)
    for v in range(len(about.names)):
        other = copy.deepcopy(found)
        low, high = (other["box"][side][v] for side in ("lower", "upper"))
        other["box"]["lower"][v] = low + 1e-6 * (high - low)
        assert verdict(other) == "refused"


@pytest.mark.parametrize("name", PROVED)
@pytest.mark.parametrize("change", ["sample", "noise"])
def test_boxes_belong_to_their_record(name, change):
    found = loaded(name)
    if change == "sample":
        found["record"]["y"][0][4] += 0.01
    else:
        column = found["noise"]["output"][0]
        column[:] = [value * 1.01 for value in column]
    assert verdict(found) == "refused"


def attack(name, count, seed=0):
    """Damage fields of the steps; accepted boxes have to hold what is attained."""
    found, said = loaded(name), {"accepted": 0, "refused": 0, "malformed": 0}
    for number in range(count):
        chance, other = random.Random(f"{seed} {name} {number}"), copy.deepcopy(found)
        inside = {"certificate": other["box"]}
        other["box"] = damage.damaged(inside, chance)[0].get("certificate")
        try:
            _, box = boxed(other)
        except NotProved:
            said["refused"] += 1
            continue
        except (reading.Malformed, ArithmeticError, AttributeError, LookupError, TypeError,
                ValueError, AssertionError):  # fmt: skip
            said["malformed"] += 1
            continue
        said["accepted"] += 1
        assert not nothing(box), number
        for interval, low, high in zip(found["intervals"], *box, strict=True):
            assert low <= interval["inner"][0] and high >= interval["inner"][1], number
    return said


@pytest.mark.parametrize("name", PROVED)
def test_damaged_steps_prove_nothing_false(name):
    said = attack(name, 5)
    assert said["refused"] + said["malformed"] > 2


@pytest.mark.slow
@pytest.mark.parametrize("name", PROVED)
def test_hundreds_of_damaged_steps_prove_nothing_false(name):
    said = attack(name, 300, 1)
    assert said["refused"] + said["malformed"] > 100


def test_products_of_a_sum_count_as_often_as_they_stand_there() -> None:
    """(1 + a / q)^2 has the coefficient a + a: with a in [1, 2], one of them known."""
    box, twice = [iv.around(-9, 9)], [(1,), (1,)]
    known = [([(1,)], iv.around(1, 2))]
    assert iv.exactly(total_by(twice, known, box)) == (-8, 11)
    assert iv.exactly(total_by(twice, [(twice, iv.around(2, 4))], box)) == (2, 4)
    assert iv.exactly(total_by([(1,)], [(twice, iv.around(2, 4))], box)) == (-9, 9)
