"""Cones of denominators in the second checker: by hand, from definitions, trees forged."""

from __future__ import annotations

import copy
import json
import random
from fractions import Fraction
from operator import mul
from types import SimpleNamespace

import pytest
from record_corpus import written
from slow_values import slow_after
from test_checker_simulation import about

from checker.files import reading
from checker.records.denominators import (
    Multipliers,
    Rows,
    by_denominators,
    first_cones,
    holds,
    minor,
    upright,
)
from checker.records.linear_rows import Regression
from checker.records.parameter_box import proved_box
from checker.records.record import Identification
from checker.result import NotProved

STATIC = {"na": 0, "nb": 1, "nk": 0, "initial": "free"}
FIRST = {"na": 1, "nb": 1, "nk": 0, "initial": "free"}
CONES = ("cones-first", "cones-second", "cones-outputs", "cones-rest", "cones-third")


def leaf_of(family: list[int], powers: list[int], minors: list[Fraction]) -> SimpleNamespace:
    """The fields of a leaf that a test needs."""
    return SimpleNamespace(family=family, powers=powers, minors=minors, where="box.nodes[0]")


def regression(known: Identification) -> Regression:
    return Regression(known, [[(v,)] for v in range(1, len(known.names) + 1)])


def node(**changes):
    names = ("children", "edge", "weights", "family", "powers", "minors")
    return {name: [] for name in names} | changes


def step(multipliers, free, nodes=None, limits=(), stable=False):
    return {
        "is": "Denominators",
        "output": 1,
        "stable": stable,
        "free": free,
        "multipliers": [{"power": power, "values": values} for power, values in multipliers],
        "nodes": [node()] if nodes is None else nodes,
        "limits": list(limits),
    }


def limit(cell, parameter, sign, value, family, powers, minors=()):
    found = {"cell": cell, "parameter": parameter, "sign": sign, "value": value}
    return found | {"family": family, "powers": powers, "minors": list(minors)}


# ---- by hand ------------------------------------------------------------------------------------


def test_zeros_stand_before_each_record_at_rest():
    shape = FIRST | {"na": 2, "nb": 2, "nk": 1, "initial": "zero"}
    known = about(shape, [[1.0, 2.0, 3.0, 4.0, 5.0]], [1.0] * 5, 0.5)
    known.record.starts = [0, 3]
    rows = Rows(known, 1, True)
    assert rows.numbers == [None, None, 0, 1, 2, None, None, 3, 4]
    assert rows.asked == [k is not None for k in rows.numbers]
    columns = [[Fraction(v, 1 << rows.bits) for v in column] for column in rows.columns]
    assert columns == [[0, 0, 0, 1, 2, 0, 0, 0, 4], [0, 0, 0, 0, 1, 0, 0, 0, 0]]
    table = Multipliers(rows, [{"power": 0, "values": [1, 2, 3, 4, 5]}], [1, 2])
    assert table.table == [(0, [0, 0, 1, 2, 3, 0, 0, 4, 5])] and table.free == [3, 4]
    assert Rows(known, 1).asked == [False, False, True, False, False]


def test_rows_at_rest_need_a_structure_that_begins_there():
    """y(k) + a y(k-1) = b u(k-1) + e: at rest the first reading is noise alone, 0 up to 0.125."""
    for initial, rest in (("zero", True), ("zero", False), ("free", False), ("free", True)):
        about_it = about(FIRST | {"nk": 1, "initial": initial}, [[1.0, 2.0]], [0.5, 1.0], 0.125)
        made = step([(0, [1, 0])], [1], nodes=[node(family=[0, 0], powers=[0, 0])] * 2)
        rows, ends = regression(about_it), [[Fraction(-9)] * 2, [Fraction(9)] * 2]
        if (initial, rest) == ("zero", True):  # one row refutes all cones whose a_0 is not zero
            found = Rows(about_it, 1, True)
            assert found.numbers == [None, 0, 1] and found.asked == [False, True, True]
            assert found.columns == [[0, 0, found.y[2]]] and found.noise[0] == 0
            table = Multipliers(found, [{"power": 0, "values": [1, 0]}], [1])
            assert table.table == [(0, [0, 1, 0])] and table.free == [2]
            assert holds(table, leaf_of([0], [0], []), [[1, 0]], False, None)
            assert not holds(table, leaf_of([0], [0], []), [[0, 1]], False, None)
            continue
        with pytest.raises(NotProved):
            by_denominators(made | {"rest": rest}, rows, ends)


def gain(*limits, multipliers=((0, [0, -1]), (-1, [0, 2]))):
    """b of y = b u with u = 1, 2 and y = 0.5, 1 up to 0.125: within [0.4375, 0.5625]."""
    known = about(STATIC, [[1.0, 2.0]], [0.5, 1.0], 0.125)
    rows, ends = regression(known), [[Fraction(-9)], [Fraction(9)]]
    return by_denominators(step(multipliers, [1], limits=limits), rows, ends)


def test_a_gain_by_hand_is_exact():
    just = 2.0**-40
    assert gain() == [[-9], [9]]
    assert gain(limit(0, 0, 1, 0.5625 + just, [0], [0]))[1] == [Fraction(0.5625 + just)]
    assert gain(limit(0, 0, -1, -0.4375 + just, [1], [3]))[0] == [Fraction(0.4375 - just)]
    for wrong in (
        limit(0, 0, 1, 0.5625, [0], [0]),  # only above it nothing is left
        limit(0, 0, -1, -0.4375, [1], [0]),
        limit(0, 0, 1, 0.75, [1], [0]),
        limit(0, 0, 1, -100.0, [1], [0]),
        limit(1, 0, 1, 0.75, [0], [0]),
        limit(0, 0, 1, 0.75, [], [0]),
    ):
        assert gain(wrong) == [[-9], [9]]
    for broken in (
        limit(0, 0, 2, 0.75, [0], [0]),
        limit(0, 1, 1, 0.75, [0], [0]),
        limit(0, 0, 1, 0.75, [2], [0]),
        limit(0, 0, 1, 0.75, [-1], [0]),
        limit(0, 0, 1, 0.75, [0, 0], [0]),
        limit(0, 0, 1, 0.75, [0], []),
        limit(0, 0, 1, 0.75, [0], [1101]),
        limit(0, 0, 1, float("inf"), [0], [0]),
    ):
        with pytest.raises(reading.Malformed):
            gain(broken)
    with pytest.raises(NotProved):
        gain(limit(0, 0, 1, 0.75, [0], [0], [1.0]))


def test_nothing_is_left_where_readings_contradict_each_other():
    """y = b u with u = 1, 2 and y = 0, 3 needs noise of 1: (-2, 1) gives 3 against 3 w."""
    for bound, left in ((0.875, False), (1.0, True)):
        known = about(STATIC, [[1.0, 2.0]], [0.0, 3.0], bound)
        refuted = node(family=[0], powers=[0])
        made = step([(0, [-2, 1])], [0], [refuted])
        low, high = by_denominators(made, regression(known), [[Fraction(-9)], [Fraction(9)]])
        assert (low[0] <= high[0]) is left
    off = step([(-40, [-(2**41), 2**40 - 2**20])], [0], [refuted])  # not orthogonal
    known = about(STATIC, [[1.0, 2.0]], [0.0, 3.0], 0.875)
    assert by_denominators(off, regression(known), [[-9], [9]])[0][0] > 0
    known = about(STATIC, [[1.0, 2.0]], [0.0, 3.0], 1.0 - 2.0**-21)
    assert by_denominators(off, regression(known), [[-9], [9]])[0][0] == -9


def test_poles_lie_between_the_ratios_of_the_cones_that_are_left():
    """1 + a with a in [-1, 1] and [1, inf), or the part of the first one below or above 0."""
    known = about(FIRST, [[1.0, 2.0, 4.0]], [0.5, 1.0, 2.0], 0.1)
    rows, ends = regression(known), [[Fraction(-5), Fraction(-9)], [Fraction(5), Fraction(9)]]
    table = [(0, [0, 0, 0])]
    found = by_denominators(step(table, [2], [node(), node()]), rows, ends)
    assert found == ends  # the second cone has a vector (-1, 1)
    found = by_denominators(step(table, [2], [node()], stable=True), rows, ends)
    assert found == [[-1, -9], [1, 9]]
    assert known.stable == {1}
    whole = node(children=[1, 2], edge=[0, 1], weights=[1, 3])
    found = by_denominators(step(table, [2], [whole, node(), node()], stable=True), rows, ends)
    assert found == [[-1, -9], [1, 9]]
    near = limit(2, 1, 1, 8.0, [0, 0], [0, 0])  # of a multiplier 0: says nothing
    made = step(table, [2], [whole, node(), node()], [near], True)
    assert by_denominators(made, rows, ends) == [[-1, -9], [1, 9]]


def test_limits_hold_on_parts_and_no_further():
    """4 b = 2 + a up to 0.1 (1 + |a|): below 0.55 for a <= 0, below 0.81 for a <= 1."""
    known = about(FIRST, [[1.0, 2.0, 4.0]], [0.5, 1.0, 2.0], 0.1)
    rows, ends = regression(known), [[Fraction(-5), Fraction(-9)], [Fraction(5), Fraction(9)]]
    whole = node(children=[1, 2], edge=[0, 1], weights=[1, 1])
    table = [(0, [0, 0, -1])]

    def upper(*limits):
        made = step(table, [2], [whole, node(), node()], limits, True)
        return by_denominators(made, rows, ends)[1][1]

    both, near = (limit(0, 1, 1, 0.81, [0, 0], [0, 0]), limit(1, 1, 1, 0.55, [0, 0], [0, 0]))
    assert upper() == 9 and upper(both) == Fraction(0.81) and upper(near) == 9
    assert upper(both, near) == Fraction(0.81)
    assert upper(near | {"cell": 0}) == 9 and upper(near | {"cell": 2}) == 9


# ---- from definitions ---------------------------------------------------------------------------


def test_there_are_as_many_nodes_as_first_cones():
    """Of thirty poles there would be a billion."""
    u = [float(k % 7) for k in range(80)]
    known = about({"na": 30, "nb": 1, "nk": 0, "initial": "free"}, [u], u, 0.125)
    with pytest.raises(reading.Malformed, match="first cones"):
        by_denominators(step([], [40]), regression(known), [[-1] * 31, [1] * 31])


def test_minors_of_a_cubic():
    """(z - 1)^j (z + 1)^(3 - j) has b = e_j: b1 b2 - b0 b3, times 64."""
    cone = first_cones(3, True)[0]
    found = {(j, k): minor(cone, 1, j, k) for j in range(4) for k in range(j, 4)}
    assert {pair: value for pair, value in found.items() if value} == {(1, 2): 64, (0, 3): -64}


def least(rows, family, leaf, cone, sign):
    """The least end of the first gain that multipliers prove, in rationals."""
    n, count, w = rows.order, rows.count, Fraction(1, 2**rows.bits)
    scaled = [
        [v / Fraction(2) ** p for v in line] for line, p in zip(cone, leaf.powers, strict=True)
    ]
    share = [-sign * sum(map(mul, m, rows.columns[0])) * w for m in family]
    found = []
    for j in range(n + 1):
        for k in range(j, n + 1):
            need = give = Fraction(0)
            for s in range(count):
                both = Fraction(0)
                for one, two in ((j, k), (k, j)):
                    late = [family[two][s + i] if s + i < count else 0 for i in range(n + 1)]
                    both += sum(map(mul, scaled[one], late))
                need += both * rows.y[s] * w
                give += abs(both) * rows.noise[s] * w
            if leaf.minors:
                need -= leaf.minors[0] * minor(scaled, 1, j, k)
            slope = scaled[j][0] * share[k] + scaled[k][0] * share[j]
            if min(share) < 0 or slope <= 0:
                return None
            found.append((give - need) / slope)
    return max(found)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_limits_hold_where_definitions_say(order):
    chance, seen = random.Random(order), 0
    for _ in range(150):
        u = [float(chance.randint(-3, 3)) for _ in range(9)]
        y = [chance.randint(-64, 64) / 16 for _ in u]
        known = about({"na": order, "nb": 1, "nk": 0, "initial": "free"}, [u], y, 0.125)
        rows = Rows(known, 1)
        if not rows.columns:
            continue
        family = [[chance.randint(-9, 9) * ask for ask in rows.asked] for _ in range(order + 1)]
        cone = [
            [chance.randint(1, 5)] + [chance.randint(-5, 5) for _ in range(order)] for _ in family
        ]
        powers = [chance.randint(-1, 2) for _ in family]
        minors = [Fraction(chance.randint(0, 2), 1024)] if order == 3 else []
        sign = chance.choice([1, -1])
        for m in family:
            way = -sign * sum(map(mul, m, rows.columns[0]))
            m[:] = [v if way > 0 else -v for v in m]
        leaf = leaf_of(list(range(order + 1)), powers, minors)
        end = least(rows, family, leaf, cone, sign)
        if end is None:
            continue
        seen += 1
        place = next(k for k, v in enumerate(rows.columns[0]) if v)
        table = Multipliers(rows, [{"power": 0, "values": m} for m in family], [place])
        for value, good in ((end, False), (end + Fraction(1, 2**60), True)):
            assert holds(table, leaf, cone, True, (0, sign, value)) is good
    assert seen > 40


# ---- whole files --------------------------------------------------------------------------------


def loaded(name):
    return json.loads(written(name))["identification"]


@pytest.mark.parametrize("name", slow_after(4, CONES))
def test_boxes_of_denominators_are_proved(name):
    found = loaded(name)
    assert any(one["is"] == "Denominators" for one in found["box"]["steps"])
    lines = Identification(found).check()
    assert not any(line.startswith("taken as given") for line in lines)
    assert sum("attained from" in line for line in lines) == len(found["parameters"])


def verdict(found):
    known = Identification(found)
    known.check_rows()
    try:
        proved_box(known)
    except NotProved:
        return "refused"
    except reading.Malformed:
        return "malformed"
    return "accepted"


@pytest.mark.parametrize("name", slow_after(4, CONES))
def test_nearer_ends_are_refused(name):
    found = loaded(name)
    for v in range(len(found["parameters"])):
        for side, way in (("lower", 1), ("upper", -1)):
            changed = copy.deepcopy(found)
            changed["box"][side][v] += way * 1e-6 * (1.0 + abs(changed["box"][side][v]))
            assert verdict(changed) == "refused"


def change(found, chance):
    """Damage one number of a step in place; whether what is claimed cannot follow any more."""
    made = next(one for one in found["box"]["steps"] if one["is"] == "Denominators")
    kind = chance.choice(["value", "multipliers", "family", "free", "children", "output", "edge"])
    if kind == "value":
        chance.choice(made["limits"])["value"] -= 0.25
    elif kind == "multipliers":
        values = chance.choice(made["multipliers"])["values"]
        values[:] = [-v for v in values]
    elif kind == "family":
        chance.choice([one for one in made["nodes"] if one["family"]])["family"].reverse()
    elif kind == "free":
        made["free"] = made["free"][1:]
    elif kind == "children":
        chance.choice([one for one in made["nodes"] if one["children"]])["children"].reverse()
    elif kind == "output":
        made["output"] = 7
    else:
        chance.choice([one for one in made["nodes"] if one["children"]])["weights"] = [0, 1]
    return kind in ("free", "output", "edge")


@pytest.mark.parametrize("name", ["cones-first", "cones-second", "cones-outputs"])
def test_damage_never_makes_a_wider_claim_pass(name):
    """What is damaged is refused, or leaves the box as it was: it holds without that part."""
    found, chance = loaded(name), random.Random(3)
    refused = 0
    for _ in range(25):
        changed = copy.deepcopy(found)
        sure = change(changed, chance)
        said = verdict(changed)
        refused += said != "accepted"
        assert not (sure and said == "accepted")
    assert refused > 5


def noisy_inputs(found):
    found["noise"]["input"][0][3] = 0.1


def noisy_equations(found):
    found["noise"]["equation"][0][3] = 0.1


def lost_input(found):
    found["record"]["u"][0][3] = None


@pytest.mark.parametrize("change", [noisy_inputs, noisy_equations, lost_input])
def test_other_errors_are_refused(change):
    found = loaded("cones-first")
    change(found)
    with pytest.raises(NotProved, match="other errors"):
        Rows(Identification(found), 1)


def test_rows_ask_for_what_the_record_has():
    late = {"na": 1, "nb": 1, "nk": 2, "initial": "free"}
    known = about(late, [[1.0, 2.0, 3.0, 4.0, 5.0]], [0.5] * 5, 0.1)
    known.record.y[0][3] = None
    rows = Rows(known, 1)
    assert rows.asked == [False, False, True, False, False]
    Multipliers(rows, [{"power": 0, "values": [0, 0, 1, 0, 0]}], [2])
    for values in ([0, 1, 0, 0, 0], [0, 0, 0, 1, 0]):
        with pytest.raises(NotProved, match="without a row"):
            Multipliers(rows, [{"power": 0, "values": values}], [2])
    with pytest.raises(NotProved, match="have no row"):
        Multipliers(rows, [], [3])


@pytest.mark.parametrize("weights", [[-1, 3], [1, -3], [0, 1], [1]])
def test_cones_are_split_between_two_vectors(weights):
    known = about(FIRST, [[1.0, 2.0, 4.0]], [0.5, 1.0, 2.0], 0.1)
    whole = node(children=[1, 2], edge=[0, 1], weights=weights)
    made = step([], [2], [whole, node(), node()], stable=True)
    with pytest.raises(reading.Malformed):
        by_denominators(made, regression(known), [[-5, -9], [5, 9]])


def test_minors_need_denominators_that_are_stable():
    """All members of a cone around z^3 + 8 are unstable: one minor says so where that matters."""
    third = {"na": 3, "nb": 1, "nk": 0, "initial": "free"}
    known = about(third, [[1.0] * 6], [0.5] * 6, 0.1)
    leaf = node(powers=[0] * 4, minors=[1.0])
    cones = [[[4 * v + (i == j) for j, v in enumerate([1, 0, 0, 8])] for i in range(4)]]
    rows = Rows(known, 1)
    table = Multipliers(rows, [], [3])
    minors = leaf_of([], [0] * 4, [Fraction(1)])
    assert holds(table, minors, cones[0], True, None)
    with pytest.raises(NotProved, match="not of stable denominators"):
        holds(table, minors, cones[0], False, None)
    with pytest.raises(NotProved, match="not of stable denominators"):
        made = step([], [3], [leaf] * 8)
        by_denominators(made, regression(known), [[-5] * 4, [5] * 4])


def test_cones_turn_upright():
    assert upright([[-1, 2], [-3, 4]]) == [[1, -2], [3, -4]]
    assert upright([[1, 2], [-3, 4]]) is None and upright([[0, 2], [3, 4]]) is None
    assert len(first_cones(2, False)) == 4 and all(c[0] == [1, 2, 1] for c in first_cones(2, False))
