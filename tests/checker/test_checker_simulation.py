"""Simulated outputs in the second checker: forms and rows against exact replays, trees forged."""

from __future__ import annotations

import copy
import itertools
import json
import random
from fractions import Fraction

import pytest
from record_corpus import written

from checker.files import reading
from checker.records import simulation
from checker.records.linear_rows import Regression
from checker.records.record import Identification
from checker.records.simulation import ONE, Form, Region, Simulation, by_simulation, down
from checker.result import NotProved

PLAIN = {"common_denominator": False, "offset": False, "form": "auto"}
NEAR = Fraction(1, 2**200)  # what rounding may cost at most


def about(table, u, y, bound, priors=()) -> Identification:
    """A file that asks about a record, without rows of the engine; priors are given rows."""
    inputs = len(u)
    shape = {k: [v] if isinstance(v, list) else [[v] * inputs] for k, v in table.items()}
    kept = {k: table[k] for k in table if k not in ("na", "nb", "nk")}
    structure = {"is": "TransferFunction"} | PLAIN | shape | kept
    names = reading_names(structure, inputs)
    p, n = len(names), len(y)
    empty = {"type": "f8", "shape": [p], "data": [0.0] * p}
    word = {"type": "i4", "shape": [0, 1], "data": []}
    nothing = {"words": word, "coefficients": empty | {"shape": [0], "data": []}, "dimension": p}
    wide = ({**empty, "data": [end] * p} for end in ("-inf", "inf"))
    low, high = wide
    problem = {"objective": nothing, "constraints": list(priors), "lower": low, "upper": high}
    found = {
        "record": {"u": u, "y": [y], "starts": [0], "ranges": {"u": None, "y": None}},
        "structure": structure,
        "noise": {"output": [[bound] * n], "input": [[0.0] * n] * inputs, "equation": [[0.0] * n]},
        "parameters": names,
        "variables": [["theta", 0, v] for v in range(p)],
        "units": [1.0] * p,
        "problem": problem | {"names": names, "squares": [], "sense": "min"},
        "rows": [None for _ in priors],
        "given": [["-inf"] * p, ["inf"] * p],
        "box": None,
        "linear": [],
        "ends": [],
        "assumptions": [],
        "intervals": [],
    }
    return Identification(found)


def reading_names(structure, inputs):
    from checker.records.structure import Structure

    return Structure(structure, inputs, 1).parameters


def simulated(known: Identification) -> Simulation:
    rows = Regression(known, [[(v,)] for v in range(1, len(known.names) + 1)])
    return Simulation(known, rows)


INPUT = [1.0, -0.5, 0.75, 1.25, -1.0, 0.5, -0.25, 1.0, 0.3, -0.7]


def one_pole(x, u):
    """y(k) = -a y(k-1) + b u(k) from an unknown y(0): x = a, b, y(0)."""
    a, b, y = x
    found = [y]
    for value in u[0][1:]:
        found.append(-a * found[-1] + b * Fraction(value))
    return found


def two_poles(x, u):
    """y(k) = -a1 y(k-1) - a2 y(k-2) + b u(k-1) + c from rest: x = a1, a2, b, c."""
    a1, a2, b, c = x
    found = [Fraction(0), Fraction(0)]
    for k in range(len(u[0])):
        late = Fraction(u[0][k - 1]) if k else Fraction(0)
        found.append(-a1 * found[-1] - a2 * found[-2] + b * late + c)
    return found[2:]


def two_inputs(x, u):
    """y = z1 + z2 with z_j(k) = -a_j z_j(k-1) + b_j u_j(k) from rest: x = a1, a2, b1, b2."""
    found = []
    z = [Fraction(0), Fraction(0)]
    for one, two in zip(*u, strict=True):
        z = [-x[0] * z[0] + x[2] * Fraction(one), -x[1] * z[1] + x[3] * Fraction(two)]
        found.append(z[0] + z[1])
    return found


def multiplied_out(x, u):
    """The same with a1 + a2 and a1 a2: products of parameters are poles."""
    return two_inputs(x, u)


CASES = {
    "one pole": ({"na": 1, "nb": 1, "nk": 0, "initial": "free"}, one_pole, (-0.7, 1.0, 0.2), 1),
    "two poles": (
        {"na": 2, "nb": 1, "nk": 1, "initial": "zero", "offset": True},
        two_poles,
        (-1.1, 0.4, 1.0, 0.1),
        1,
    ),
    "two inputs": (
        {"na": 1, "nb": 1, "nk": 0, "initial": "zero"},
        two_inputs,
        (-0.6, 0.5, 1.0, -2.0),
        2,
    ),
    "multiplied out": (
        {"na": 1, "nb": 1, "nk": 0, "initial": "zero", "form": "direct"},
        multiplied_out,
        (-0.6, 0.5, 1.0, -2.0),
        2,
    ),
}


def case(name, noise=0.125):
    """The file, the exact outputs as a function of x, and an x that explains the record."""
    table, replay, truth, inputs = CASES[name]
    u = [INPUT, list(reversed(INPUT))][:inputs]
    x = [Fraction(v) for v in truth]
    chance = random.Random(name)
    y = [float(v + Fraction(chance.uniform(-noise, noise))) for v in replay(x, u)]
    bound = max(abs(Fraction(a) - b) for a, b in zip(y, replay(x, u), strict=True))
    return about(table, u, y, float(bound) * (1 + 1e-12)), lambda v: replay(v, u), x


def region(x, radius, thin=True):
    """A box around x, and two directions along which it is narrow; shares are hints."""
    middle, wide = [down(v) for v in x], down(radius)
    box = [[m - wide for m in middle], [m + 2 * wide for m in middle]]
    if not thin:
        return Region(box, [[], []], [], [[] for _ in x])
    rows = [[ONE, ONE, *[0] * (len(x) - 2)], [ONE, -ONE, *[0] * (len(x) - 2)]]
    at = [sum(g * m for g, m in zip(row, middle, strict=True)) // ONE for row in rows]
    ends = [[v - wide // 8 for v in at], [v + 1 + wide // 4 for v in at]]
    shares = [[ONE // 2, ONE // 2], [ONE // 2, -ONE // 2], *([0, 0] for _ in x[2:])]
    return Region(box, ends, rows, shares)


def points(about, count=40, also=()):
    """Points of a region: ends, and others at random; those along thin directions too."""
    box = list(zip(about.low, about.high, strict=True))
    chance = random.Random(1)
    every = [[down(v) for v in x] for x in also]
    every += [list(x) for x in itertools.product(*box)]
    for _ in range(count):
        every.append([chance.randint(a, b) for a, b in box])
    shares = zip(about.least, about.most, strict=True)
    for w in itertools.product(*shares) if about.rows else ():
        x = [chance.randint(a, b) for a, b in box]
        x[0], x[1] = (w[0] + w[1]) // 2, (w[0] - w[1]) // 2
        every.append(x)
    for x in every:
        if all(a <= v <= b for v, (a, b) in zip(x, box, strict=True)) and all(
            a * ONE <= simulation.dot(row, x) <= b * ONE
            for row, a, b in zip(about.rows, about.least, about.most, strict=True)
        ):
            yield [Fraction(v, ONE) for v in x]


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("radius", [0.0, 1e-6, 0.02])
@pytest.mark.parametrize("thin", [False, True])
def test_exact_outputs_lie_within_the_forms(name, radius, thin):
    known, replay, x = case(name)
    own = region(x, radius, thin)
    forms = simulated(known).run(own, 9)["y1"]
    middle = [Fraction(v, ONE) for v in own.middle]
    count, most = 0, Fraction(0)
    for point in points(own):
        count += 1
        for k, exact in enumerate(replay(point)):
            if k not in forms:
                continue
            away = [v - m for v, m in zip(point, middle, strict=True)]
            slopes = [Fraction(g, ONE) for g in forms[k].slope]
            moved = sum(g * v for g, v in zip(slopes, away, strict=True))
            rest = Fraction(forms[k].rest, ONE)
            assert abs(moved) <= Fraction(forms[k].reach, ONE)
            assert abs(exact - Fraction(forms[k].value, ONE) - moved) <= rest
            most = max(most, rest)
    assert count >= (1 if radius == 0 else 3)
    assert most < 300 * Fraction(radius) ** 2 + NEAR


def test_rests_are_not_much_more_than_they_have_to_be():
    """In the middle of y = b u / (1 + a q^-1) the rest is the product of widths."""
    known, _, x = case("one pole")
    forms = simulated(known).run(region(x, 0.0, False), 9)["y1"]
    assert max(form.rest for form in forms.values()) < 2**30
    assert sorted(forms) == list(range(10))


@pytest.mark.parametrize("shares", [[0.5, 0.5], [1, 0], [0, 1], [0, 0], [-1, 3], [0.25, 0.5]])
@pytest.mark.parametrize("slope", [(1, 1), (1, -1), (2, 0), (-1, 3), (0, 0)])
def test_the_reach_is_at_least_that_of_the_vertices(shares, slope):
    """x and y in [0, 4] with x + y <= 1: the vertices are (0, 0), (1, 0) and (0, 1)."""
    box, hints = [[0, 0], [4 * ONE, 4 * ONE]], [[down(v)] for v in shares]
    own = Region(box, [[0], [ONE]], [[ONE, ONE]], hints)
    middle = [Fraction(m, ONE) for m in own.middle]
    assert all(0 <= m <= 4 for m in middle)
    found = Fraction(own.reach([v * ONE for v in slope]), ONE)
    for x in ((0, 0), (1, 0), (0, 1)):
        away = sum(g * (v - m) for g, v, m in zip(slope, x, middle, strict=True))
        assert abs(away) <= found
    assert found <= 4 * sum(abs(g) for g in slope)


@pytest.mark.parametrize(("reach", "rest"), [(ONE // 4, 0), (0, ONE // 4), (ONE // 8, ONE // 8)])
def test_the_response_is_that_of_all_poles(reach, rest):
    """1 / (1 + p q^-1 + q^-2 / 8) for p within 1/4 of -1/2, by replay of both ends."""
    pole = Form(-ONE // 2, [0], rest, reach)
    found = simulation._response([(1, pole), (2, Form(ONE // 8, [0], 0, 0))], 8)
    for p in (Fraction(-3, 4), Fraction(-1, 2), Fraction(-1, 4)):
        h = [Fraction(1)]
        for k in range(1, 8):
            h.append(-p * h[k - 1] - (h[k - 2] / 8 if k > 1 else 0))
        assert all(abs(v) <= Fraction(most, ONE) for v, most in zip(h, found, strict=True))


def test_products_of_forms_hold_their_factors():
    own = region([Fraction(0), Fraction(0)], 1.0, False)
    chance = random.Random(3)
    for _ in range(50):
        values = [chance.randint(-3 * ONE, 3 * ONE) for _ in range(8)]
        forms = []
        for value, one, two, rest in (values[:4], values[4:]):
            slope = [one, two]
            forms.append(Form(value, slope, abs(rest), own.reach(slope)))
        found = own.times(*forms)
        for x in points(own, 5):
            away = [v - Fraction(m, ONE) for v, m in zip(x, own.middle, strict=True)]
            ends = []
            for form in (*forms, found):
                line = Fraction(form.value, ONE) + sum(
                    Fraction(g, ONE) * v for g, v in zip(form.slope, away, strict=True)
                )
                rest = Fraction(form.rest, ONE)
                ends.append((line - rest, line + rest))
            products = [a * b for a in ends[0] for b in ends[1]]
            assert ends[2][0] <= min(products) and max(products) <= ends[2][1]


def every_row(known, own, samples):
    signals = simulated(known).run(own, samples - 1)
    for k, sign in itertools.product(signals["y1"], (1, -1)):
        yield ("output", 1, k, sign), signals
    for j, sign in itertools.product(range(len(own.rows)), (1, -1)):
        yield ("direction", j, 0, sign), signals


@pytest.mark.parametrize("name", CASES)
def test_rows_hold_for_whatever_explains_the_record(name):
    known, replay, x = case(name)
    low, high = known.record.y[0], known.record.bounds["output"][0]
    for own in (region(x, 0.01), region(x, 0.1, False), region(x, 0.0)):
        sim = simulated(known)
        rows = [sim.row(row, own, signals) for row, signals in every_row(known, own, 10)]
        good = 0
        for point in points(own, also=[x]):
            pairs = zip(replay(point), low, high, strict=True)
            if not all(abs(v - y) <= bound for v, y, bound in pairs):
                continue
            good += 1
            for slopes, right in rows:
                total = sum(Fraction(g, ONE) * v for g, v in zip(slopes, point, strict=True))
                assert total <= Fraction(right, ONE)
        assert good


@pytest.mark.parametrize("upwards", [True, False])
def test_an_extreme_parameter_stays_in_the_box(upwards):
    """Noise at its bound at each sample, against every change of the gain: the gain is an end.

    y(k) = b u(k), so that |y~ - b u| <= D with y~ = b u -+ D sign(u) leaves b as the extreme.
    """
    sign = 1 if upwards else -1
    y = [0.5 * v - sign * 0.25 * (1 if v > 0 else -1) for v in INPUT]
    known = about({"na": 0, "nb": 1, "nk": 0, "initial": "free"}, [INPUT], y, 0.25)
    rows = [["output", 1, 3, sign]]
    weights = [[0.0], [0.0], [0.0]]
    weights[0 if upwards else 1] = [0.8]  # 1 / u(3)
    step = tree([{"steps": [{"rows": rows, "weights": weights}]}], 1)
    found = by_simulation(step, simulated(known).regression, [[Fraction(-3)], [Fraction(3)]])
    end = found[1][0] if upwards else found[0][0]
    assert (end >= Fraction(1, 2)) if upwards else (end <= Fraction(1, 2))
    assert abs(end - Fraction(1, 2)) < 1e-12


def tree(nodes, d, directions=(), shares=None):
    plain = {"steps": [], "split": -1, "at": 0.0, "children": []}
    return {
        "is": "Simulation",
        "directions": [list(row) for row in directions],
        "shares": [[] for _ in range(d)] if shares is None else shares,
        "nodes": [plain | node for node in nodes],
    }


def started(known, x, radius):
    """Bounds of the parameters about the truth."""
    p = len(known.names)
    return [[v - Fraction(radius) for v in x[:p]], [v + Fraction(radius) for v in x[:p]]]


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("seed", range(3))
def test_no_multipliers_and_no_parts_lose_the_truth(name, seed):
    """Whatever numbers a tree holds, what explains the record is in the hull of its leaves."""
    known, _, x = case(name)
    chance, d = random.Random(seed), len(x)
    directions = [[chance.choice([-1.0, 0.0, 1.0, 0.3]) for _ in range(d)] for _ in range(2)]
    shares = [[chance.uniform(-0.6, 0.6) for _ in range(2)] for _ in range(d)]
    count, sim = 2 * (d + 2) + 1, simulated(known)
    samples = [k for k in range(10) if k >= sim.past["y1"].start]
    nodes = []
    for place in range(3):
        steps = []
        for _ in range(2):
            rows = [["output", 1, chance.choice(samples), chance.choice([1, -1])] for _ in range(4)]
            rows += [["direction", chance.randrange(2), 0, chance.choice([1, -1])]]
            scale = chance.choice([0.01, 0.3, 2.0])
            weights = [[scale * chance.uniform(-0.5, 1) for _ in rows] for _ in range(count)]
            steps.append({"rows": rows, "weights": weights})
        split = chance.randrange(d + 2) if place == 0 else -1
        at = float(chance.choice(x)) + chance.uniform(-0.01, 0.01)
        children = [1, 2] if place == 0 else []
        nodes.append({"steps": steps, "split": split, "at": at, "children": children})
    step = tree(nodes, d, directions, shares)
    found = by_simulation(step, sim.regression, started(known, x, chance.choice([0.01, 0.2])))
    for low, high, value in zip(*found, x, strict=False):
        assert low <= value <= high


def test_parts_cover_a_region_and_are_numbered_upwards():
    known, _, x = case("one pole")
    ends, rows = started(known, x, 0.25), simulated(known).regression
    halves = [{"split": 0, "at": -0.7, "children": [1, 2]}, {}, {}]
    assert by_simulation(tree(halves, 3), rows, ends) == by_simulation(tree([{}], 3), rows, ends)
    gone = {"steps": [{"rows": [], "weights": [[]] * 7}]}
    assert by_simulation(tree([*halves[:2], gone], 3), rows, ends) == by_simulation(
        tree([{}], 3), rows, ends
    )
    for spoiled in ([0, 2], [1], [1, 3], [2, 1, 2], [-1, 2], [1, 1]):
        with pytest.raises((reading.Malformed, LookupError)):
            by_simulation(tree([halves[0] | {"children": spoiled}, {}, {}], 3), rows, ends)
    for split in (3, -1):
        with pytest.raises(reading.Malformed):
            by_simulation(tree([halves[0] | {"split": split}, {}, {}], 3), rows, ends)


def test_a_region_without_points_is_proved_empty_by_its_rows_only():
    """y(k) = b u(k) with y(0) = 1 and y(1) = 1 for u = 1, -0.5: no b within 0.25."""
    y = [1.0, 1.0, *[0.0] * 8]
    known = about({"na": 0, "nb": 1, "nk": 0, "initial": "free"}, [INPUT], y, 0.25)
    rows = [["output", 1, 0, -1], ["output", 1, 1, -1]]  # -b <= -0.75, 0.5 b <= -0.75
    ends = [[Fraction(-3)], [Fraction(3)]]
    for weights, empty in (([1.0, 2.0], True), ([1.0, 0.0], False), ([-1.0, -2.0], False)):
        lines = [[0.0, 0.0], [0.0, 0.0], weights]
        step = tree([{"steps": [{"rows": rows, "weights": lines}]}], 1)
        low, high = by_simulation(step, simulated(known).regression, ends)
        assert (low[0] > high[0]) is empty


def linear_prior(slopes, constant, kind):
    p = len(slopes)
    words = {"type": "i4", "shape": [p + 1, 1], "data": [*range(1, p + 1), 0]}
    values = {"type": "f8", "shape": [p + 1], "data": [*slopes, constant]}
    polynomial = {"words": words, "coefficients": values, "dimension": p}
    return {"polynomial": polynomial, "kind": kind, "name": "", "entries": []}


def test_given_rows_hold_with_their_signs_and_in_their_units():
    """0.5 a + 0.25 b - 1 >= 0 for z = theta / 4 is a / 8 + b / 16 - 1 >= 0."""
    table, _, truth, _ = CASES["one pole"]
    y = [float(v) for v in one_pole([Fraction(v) for v in truth], [INPUT])]
    rows = [linear_prior([0.5, 0.25], -1.0, kind) for kind in ("NONNEGATIVE", "ZERO")]
    known = about(table, [INPUT], y, 0.1, rows)
    known.units = [Fraction(4)] * 2
    own, sim = region([Fraction(v) for v in truth], 1.0, False), simulated(known)
    for number, sign in ((0, 1), (1, 1), (1, -1)):
        slopes, right = sim.row(("given", number, 0, sign), own, {})
        assert slopes == [-sign * ONE // 8, -sign * ONE // 16, 0]
        assert 0 <= right + sign * ONE < 100
    with pytest.raises(NotProved):
        sim.row(("given", 0, 0, -1), own, {})  # an inequality has one side
    known.problem.constraints[0].polynomial.terms[1, 2] = 1
    with pytest.raises(NotProved):
        sim.row(("given", 0, 0, 1), own, {})


@pytest.mark.parametrize("name", ["simulated-free-0", "simulated-zero-0"])
def test_rows_of_the_record_hold_with_chords(name):
    """Chords of |theta| lie above it within the region, whatever the signs."""
    found = Identification(json.loads(written(name))["identification"])
    found.check_rows()
    sim = simulated(found)
    d = 2 + len(sim.unknowns)
    for low, high in (((-1, -1), (1, 2)), ((0, -2), (1, -1)), ((-3, 1), (-1, 2))):
        box = [
            [v * ONE for v in (*low, *[0] * (d - 2))],
            [v * ONE for v in (*high, *[1] * (d - 2))],
        ]
        own = Region(box, [[], []], [], [[]] * d)
        for k, sign in itertools.product((1, 5, 9), (1, -1)):
            centre, radius = sim.regression.row(1, k)
            slopes, right = sim.row(("record", 1, k, sign), own, {})
            for theta in itertools.product(*zip(low, high, strict=True)):
                pairs = list(zip((*theta, 1), centre, radius, strict=True))
                most = sum(w * abs(t) for t, _, w in pairs) - sign * sum(t * r for t, r, _ in pairs)
                line = right - sum(g * t for g, t in zip(slopes, theta, strict=False))
                assert most * ONE <= line <= most * ONE + 100  # exact at the corners


# ---- whole files --------------------------------------------------------------------------------


SIMULATED = ("simulated-free-0", "simulated-zero-1")


@pytest.mark.parametrize("name", SIMULATED)
def test_boxes_of_simulations_are_proved(name):
    found = json.loads(written(name))["identification"]
    assert found["box"]["steps"][-1]["is"] == "Simulation"
    lines = Identification(found).check()
    assert sum("attained from" in line for line in lines) == len(found["parameters"])
    assert not any(line.startswith("taken as given") for line in lines)


def forget_noise(found):
    found["noise"]["equation"][0][3] = 0.1


def lose_reading(found):
    found["record"]["y"][0][7] = None


def join_records(found):
    found["record"]["starts"] = [0, 8]


@pytest.mark.parametrize("change", [forget_noise, lose_reading, join_records])
def test_what_is_no_simulation_is_refused(change):
    found = json.loads(written("simulated-free-0"))["identification"]
    change(found)
    with pytest.raises(NotProved, match="a simulation of a record that is none"):
        simulated(Identification(found))


def test_partial_outputs_have_to_begin_at_rest():
    table, _, _, _ = CASES["two inputs"]
    known = about(table | {"initial": "free"}, [INPUT, INPUT], [0.0] * 10, 0.1)
    with pytest.raises(NotProved, match="do not begin at rest"):
        simulated(known)


def test_first_samples_lie_within_their_noise():
    """Two poles, rows from sample 3 on: they rest on samples 1 and 2, not on 0."""
    table = {"na": 2, "nb": 2, "nk": 2, "initial": "free"}
    y = [5.0, 0.3, -0.7, *INPUT[3:]]
    known = about(table, [INPUT], y, 0.1)
    low, high = simulated(known).root([[Fraction(1)] * 4, [Fraction(2)] * 4])
    assert simulated(known).unknowns == [("y1", 1), ("y1", 2)]
    assert (low[:4], high[:4]) == ([ONE] * 4, [2 * ONE] * 4)
    for place, reading_ in ((4, 0.3), (5, -0.7)):
        ends = Fraction(reading_) - Fraction(0.1), Fraction(reading_) + Fraction(0.1)
        found = Fraction(low[place], ONE), Fraction(high[place], ONE)
        assert found[0] <= ends[0] < found[0] + NEAR
        assert found[1] - NEAR < ends[1] <= found[1]


def test_parameters_have_to_be_bounded():
    known, _, _ = case("one pole")
    rows = simulated(known).regression
    with pytest.raises(NotProved, match="not bounded"):
        by_simulation(tree([{}], 3), rows, [[Fraction(0), Fraction(0)], [Fraction(1), INF]])


INF = float("inf")
SPOILED = {
    "a sign that is no whole number": lambda rows: rows[0].__setitem__(3, 1.0),
    "a sign of another size": lambda rows: rows[0].__setitem__(3, 2),
    "a sample before the record": lambda rows: rows[0].__setitem__(2, -1),
    "a sample after the record": lambda rows: rows[0].__setitem__(2, 16),
    "an output that is none": lambda rows: rows[0].__setitem__(1, 2),
    "no output": lambda rows: rows[0].__setitem__(1, 0),
    "another kind": lambda rows: rows[0].__setitem__(0, "wish"),
    "a direction that is none": lambda rows: rows.__setitem__(0, ["direction", 9, 0, 1]),
    "a row less": lambda rows: rows.pop(),
    "a row that is too long": lambda rows: rows[0].append(1),
}


@pytest.mark.parametrize("change", SPOILED)
def test_rows_that_make_no_sense_are_refused(change):
    found = json.loads(written("simulated-free-0"))["identification"]
    other = copy.deepcopy(found)
    SPOILED[change](other["box"]["steps"][-1]["nodes"][0]["steps"][-1]["rows"])
    with pytest.raises((reading.Malformed, NotProved, ValueError)):
        Identification(other).check()
