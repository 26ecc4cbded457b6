"""Identifications: the second checker builds the rows itself and notices other records."""

from __future__ import annotations

import copy
import json
import math
import random
from contextlib import nullcontext
from fractions import Fraction
from types import SimpleNamespace
from typing import get_args

import certificate_damage as damage
import numpy as np
import pytest
import record_corpus
from record_corpus import written

import setid
from checker import command
from checker.arithmetic.polynomial import Polynomial
from checker.files import reading
from checker.records.driven import check_question, check_structures
from checker.records.parameter_box import KINDS
from checker.records.record import Identification
from checker.result import NotProved
from setid.proofs.parameter_box import ProvedBox
from setid.result.certificate_files import certificate_files
from setid.result.json_ import certificate_text

INF = math.inf


def loaded(name: str) -> dict:
    return json.loads(written(name))["identification"]


def verdict(found: dict) -> str:
    try:
        Identification(found).check()
    except NotProved:
        return "refused"
    except reading.Malformed:
        return "malformed"
    return "accepted"


FEW = ("e-0", "o-0", "oi-0", "empty-0", "second-e-0", "common", "gap-range")


@pytest.mark.parametrize("name", FEW)
def test_records_are_proved(name):
    lines = Identification(loaded(name)).check()
    assert any(line.startswith("proved") for line in lines)
    assert not any(line.startswith("taken as given") for line in lines)
    if name != "empty-0":
        assert sum("attained from" in line for line in lines) == len(loaded(name)["parameters"])


@pytest.mark.slow
def test_all_records_are_proved(tmp_path):
    """Over sixty; rows of another structure are taken as given."""
    record_corpus.main(tmp_path, 0, 10**6)
    codes = {path.stem: command.main([str(path)]) for path in sorted(tmp_path.glob("*.json"))}
    assert len(codes) > 60
    given = {"narx", "hammerstein", "wiener", "lure", "continuous"}
    assert {name for name, code in codes.items() if code == 3} == given
    assert set(codes.values()) == {0, 3}


def test_four_samples_by_hand():
    """Laboratory two, first record: a linear program in two unknowns, solved by hand elsewhere."""
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    found = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    about = Identification(certificate_files(found)["identification"])
    lines = about.check()
    low, high = Fraction(-45, 86), Fraction(-259, 750)  # of a1, vertices of the quadrangle
    text = next(line for line in lines if line.startswith("proved: a1"))
    ends = text.split("[")[1].split("]")[0].split(", ")
    assert abs(Fraction(float(ends[0])) - low) < Fraction(1, 10**12)
    assert abs(Fraction(float(ends[1])) - high) < Fraction(1, 10**12)


# ---- what is not the record's -------------------------------------------------------------------


def sample(found, value):
    found["record"]["y"][0][4] = value


def bound(found, kind, value):
    found["noise"][kind][0] = [value] * len(found["noise"][kind][0])


CHANGES = {
    "another sample": lambda f: sample(f, f["record"]["y"][0][4] + 1e-12),
    "another input": lambda f: f["record"]["u"][0].reverse(),
    "more noise": lambda f: bound(f, "output", 0.06),
    "noise of another kind": lambda f: bound(f, "equation", 0.01),
    "another order": lambda f: f["structure"].update(nk=[[1]]),
    "another start": lambda f: f["record"].update(starts=[0, 5]),
    "a wider prior": lambda f: f.update(given=[["-inf", "-inf"], ["inf", "inf"]]),
    "a narrow problem": lambda f: f["problem"]["upper"]["data"].__setitem__(0, -10.0),
    "noise unknowns held": lambda f: f["problem"]["upper"]["data"].__setitem__(4, 0.0),
    "a narrow box": lambda f: f["box"]["lower"].__setitem__(0, f["box"]["upper"][0]),
    "a narrow interval": lambda f: f["intervals"][0]["outer"].__setitem__(
        0, f["intervals"][0]["outer"][1]
    ),
    "emptiness": lambda f: f["intervals"][0].update(outer=["inf", "-inf"]),
    "exchanged unknowns": lambda f: f["variables"].reverse(),
    "units that are no powers": lambda f: f["units"].__setitem__(0, 3.0),
    "ends exchanged": lambda f: f["ends"].reverse(),
}


@pytest.mark.parametrize("change", CHANGES)
def test_what_is_not_the_records_is_noticed(change):
    found = loaded("o-0")
    assert verdict(found) == "accepted"
    CHANGES[change](found)
    wanted = {"a wider prior": "accepted"}.get(change)  # the record had none
    assert verdict(found) == wanted if wanted else verdict(found) != "accepted"


def outer_alone(found: dict) -> list[str]:
    """What is proved where no end is attained: the file is refused until it claims none."""
    with pytest.raises(NotProved, match=r"intervals\[0\].inner: no point is shown to explain"):
        Identification(found).check()
    for stated in found["intervals"]:
        stated["inner"] = None
    return Identification(found).check()


@pytest.mark.parametrize("share", [1e-3, 0.5, 1 - 1e-9])
def test_rows_that_allow_more_than_the_equation_errors_attain_nothing(share):
    """Rows of .05 hold for less noise too, but points of theirs may need more than there is."""
    found = loaded("e-0")
    said = "rows of equation errors are rounded outwards, by less than a last bit"
    lines = Identification(found).check()
    assert said in lines and any("attained from" in line for line in lines)
    bound(found, "equation", share * found["noise"]["equation"][0][0])
    lines = outer_alone(found)
    assert any(line.startswith("proved: ") for line in lines) and said not in lines
    assert not any("attained" in line and line.startswith("proved") for line in lines)
    assert "rows of equation errors allow more than the noise: no end is attained" in lines


def test_unknowns_that_reach_further_attain_nothing_where_rows_are_given():
    found = loaded("hammerstein")
    assert any("attained from" in line for line in Identification(found).check())
    bound(found, "output", 0.5 * found["noise"]["output"][0][0])
    lines = outer_alone(found)
    assert any(line.startswith("proved: ") for line in lines)
    assert not any("attained" in line and line.startswith("proved") for line in lines)


def test_infinite_ends_of_what_is_given_are_on_their_side():
    found = loaded("e-0")
    for low, high in (("inf", "-inf"), ("inf", "inf"), ("-inf", "-inf"), ("-inf", "inf")):
        found["given"] = [[low] * 2, [high] * 2]
        assert verdict(found) == ("accepted" if (low, high) == ("-inf", "inf") else "malformed")


def test_less_noise_than_stated_is_fine_and_more_is_not():
    """Unknowns that reach further than the noise make outer intervals true, inner ones unknown."""
    found = loaded("o-0")
    for bounds, sign in ((found["problem"]["lower"], -1), (found["problem"]["upper"], 1)):
        for v in range(2, len(bounds["data"])):
            assert abs(bounds["data"][v] * found["units"][v]) == 0.05
            assert bounds["data"][v] * sign > 0
    bound(found, "output", 0.049)
    lines = outer_alone(found)
    assert any(line.startswith("proved: a1") for line in lines)
    assert not any("attained" in line for line in lines)


def test_a_missing_row_leaves_outer_intervals_only():
    """Without its last row the problem is another, and certificates of the old one may fail."""
    found = loaded("e-0")
    for stated in found["intervals"]:
        stated["inner"] = None
    del found["rows"][-1], found["problem"]["constraints"][-1]
    count = len(found["rows"])
    for entry in found["linear"]:  # rows of bounds move up
        entry["multipliers"] = [[r - (r > count), v] for r, v in entry["multipliers"]]
    try:
        lines = Identification(found).check()
    except NotProved:
        return
    assert not any("attained" in line for line in lines)


def test_what_is_asked_is_shown():
    """A prior that a file adds restricts the set, so that readers must see it."""
    found = loaded("o-0")
    assert not any(line.startswith("given") for line in Identification(found).check())
    found["given"][0][0], found["rows"][0] = -0.9, None
    found["problem"]["names"] = [f"other{k}" for k in range(len(found["units"]))]
    shown = [line for line in outer_alone(found) if line.startswith("given")]
    assert shown[0] == "given: a1 in [-0.9, inf]"
    assert "b0" in shown[1] and "a1*eta1[1]" in shown[1] and shown[1].endswith("== 0")


def test_ends_outside_what_is_given_are_not_attained():
    """A file states a prior, and its problem does not ask for it."""
    found = loaded("o-0")
    assert any("attained from" in line for line in Identification(found).check())
    found["given"][1][0] = found["intervals"][0]["inner"][0]
    lines = outer_alone(found)
    assert any(line.startswith("proved: a1") for line in lines)
    assert not any("attained" in line for line in lines)


def test_bounds_of_other_unknowns_are_shown():
    """Missing samples lie in a range, and reflection coefficients of a prior in [-1, 1]."""
    shown = Identification(loaded("gap-range")).check()
    assert any(line.startswith("given: each missing sample of y1 in [") for line in shown)
    record = setid.IOData(np.r_[1.0, -1.0, 2.0, 0.5, 1.0, -2.0], np.r_[0.0, 1, -1, 2, 1, 1])
    priors = [setid.Stable(), setid.Box({"b0": (-3, 3), "b1": (-3, 3)})]
    model = setid.TransferFunction(3, 2, initial="zero")
    options = setid.Options(time_limit=1.0)
    found = setid.identify(record, model, setid.Noise(equation=5.0), priors, options)
    about = Identification(certificate_files(found)["identification"])
    about.check_rows()
    assert sum(line.startswith("given: slack[") for line in about._asked()) >= 2
    assert len(about.bounds_of("slack")) >= 2
    assert {(-1, 1)} <= {*about.bounds_of("slack").values()}


# ---- parameters that no row of the file speaks of -----------------------------------------------


def without_rows(found, ends):
    """A file that states no rows, and bounds of its own for the parameters."""
    problem, n = found["problem"], len(found["problem"]["lower"]["data"])
    problem["constraints"], found["rows"], found["box"] = [], [], None
    for side in (0, 1):
        problem[("lower", "upper")[side]]["data"][: len(ends)] = [pair[side] for pair in ends]
    found["ends"] = []
    found["linear"] = [
        {"status": "OPTIMAL", "multipliers": [[side * n + v, "1"]], "vertex": None, "ray": None}
        for v in range(len(ends))
        for side in (0, 1)
    ]
    for interval, pair in zip(found["intervals"], ends, strict=True):
        interval.update(outer=pair, inner=None)


def test_a_file_without_rows_bounds_no_parameters():
    found = loaded("e-0")
    without_rows(found, [[5.0, 6.0], [7.0, 8.0]])
    with pytest.raises(NotProved, match=r"a1 in \[5.0, 6.0\]: only \[-inf, inf\] is proved"):
        Identification(found).check()


@pytest.mark.parametrize(("side", "end"), [("upper", -10.0), ("lower", 10.0)])
def test_a_problem_that_leaves_out_values_proves_nothing_of_other_parameters(side, end):
    found = loaded("e-0")
    found["problem"][side]["data"][0] = end
    found["intervals"][0].update(outer=["-inf", "inf"], inner=None)
    with pytest.raises(NotProved, match="leaves out values of a1"):
        Identification(found).check()


def test_boxes_that_round_beyond_given_bounds_leave_no_values_out(monkeypatch):
    """What is given is taken for granted: a box that ends 1e-12 beyond it says no more."""
    found = loaded("o-0")
    names, problem = [item["name"] for item in found["intervals"]], found["problem"]
    low, high = (problem[side]["data"][0] for side in ("lower", "upper"))
    found["given"][0][0], found["given"][1][0] = low, high
    checked = Identification(found)
    beyond = Fraction(1, 10**12)
    box = [Fraction(low) - beyond], [Fraction(high) + beyond]
    rest = [checked.bounds(v) for v in range(1, len(names))]
    whole = tuple([*end, *(pair[side] for pair in rest)] for side, end in enumerate(box))
    monkeypatch.setattr("checker.records.record.proved_box", lambda _: (whole, []))
    assert any(text.startswith(f"proved: {names[0]} in") for text in checked.check())


def test_certificates_about_parameters_in_no_row_prove_nothing_of_them():
    found = loaded("o-0")
    ends = [[5.0, 6.0], [7.0, 8.0]]
    without_rows(found, ends)
    part = {"steps": [], "argument": None, "empty": False, "branch": None, "children": []}
    found["linear"], found["units"] = [], [1.0] * len(found["units"])
    found["ends"] = [
        {
            "attained": None,
            "certificate": [{"fingerprint": "", "bound": b, "cutoff": None, "parts": [part]}],
        }
        for low, high in ends
        for b in (low, -high)
    ]
    with pytest.raises(NotProved, match="only"):
        Identification(found).check()


@pytest.mark.filterwarnings("ignore:u. input 1 is zero:setid.SetidWarning")
def test_parameters_in_no_row_attain_all_that_is_given():
    data = setid.IOData(np.zeros(3), [1.0, 0.5, 0.25])
    priors = [setid.Box({"b1": (-1.0, 2.0)}), setid.Stable()]
    model, noise = setid.TransferFunction(1, 1, 1), setid.Noise(output=0.02)
    options = setid.Options(tol=1.0, progress=False)
    found = setid.identify(data, model, noise, priors, options)
    text = json.loads(certificate_text(found))["identification"]
    lines = Identification(text).check()
    assert "proved: b1 in [-1.0, 2.0], attained from -1.0 to 2.0" in lines
    text["intervals"][1].update(outer=[-1.0, 3.0], inner=[-1.0, 2.5])
    with pytest.raises(NotProved, match="only \\[-1.0, 2.0\\] is"):
        Identification(text).check()


@pytest.mark.parametrize(("silent", "stable"), [({0}, {1}), (set(), set())])
def test_parameters_of_tested_poles_or_rows_attain_what_points_attain(silent, stable):
    about = Identification(loaded("o-0"))
    about.silent, about.stable = silent, stable
    about.problem.lower[0], about.problem.upper[0] = Fraction(-9), Fraction(9)
    points = [SimpleNamespace(x=[Fraction(1, 4)], radius=0)]
    assert about._reach(0, points) == (about.units[0] / 4,) * 2


def test_texts_cannot_pretend_to_be_lines_of_the_checker():
    found = loaded("e-0")
    found["assumptions"].append("nothing\nproved: a1 in [0, 0]")
    assert verdict(found) == "malformed"


def test_tables_are_compared_with_the_record(tmp_path):
    found = loaded("o-0")
    path, table = tmp_path / "identification.json", tmp_path / "record.csv"
    path.write_text(written("o-0"))
    pairs = list(zip(found["record"]["u"][0], found["record"]["y"][0], strict=True))
    rows = ["time,valve,level", *(f"{k},{u!r},{y!r}" for k, (u, y) in enumerate(pairs))]
    table.write_text("# a comment\n" + "\n".join(rows) + "\n")
    assert command.main(["--record", str(table), str(path)]) == 0
    changes = {
        1: (rows[:-1], [*rows[:-1], "9,1,2"]),
        2: ([*rows[:3], "", *rows[3:]], [*rows[:3], "#N/A", *rows[3:]], []),
    }
    for code, tables in changes.items():
        for change in tables:
            table.write_text("\n".join(change) + "\n")
            assert command.main(["--record", str(table), str(path)]) == code


def test_tables_with_decimal_commas_and_units_are_read(tmp_path, capsys):
    found = loaded("o-0")
    path, table = tmp_path / "identification.json", tmp_path / "record.csv"
    path.write_text(written("o-0"))
    pairs = list(zip(found["record"]["u"][0], found["record"]["y"][0], strict=True))
    rows = [f"{k};{u!r};{y!r}".replace(".", ",") for k, (u, y) in enumerate(pairs)]
    table.write_text("\n".join(["t;valve;level", "s;V;mm", *rows]) + "\n")
    call = ["--record", str(table), str(path)]
    assert command.main([*call, "--decimal", ",", "--header", "2"]) == 0
    assert "u1 is column 'valve'" in capsys.readouterr().out
    for missing in ([], ["--decimal", ","], ["--header", "2"]):
        assert command.main([*call, *missing]) == 1
        assert "--decimal , for decimal commas" in capsys.readouterr().out
    for wrong in (["--decimal", ";"], ["--header", "x"], ["--headers", "2"], ["--header"]):
        assert command.main([*call, *wrong]) == 2
        assert "usage" in capsys.readouterr().out
    table.write_text("\n".join(["t;valve;level", "s;V;mm", *rows[:3], "3;1,0;1.5"]) + "\n")
    assert command.main([*call, "--decimal", ",", "--header", "2"]) == 1


def test_separators_within_quotes_separate_nothing(tmp_path, capsys):
    """As `setid verify` reads them."""
    found = loaded("o-0")
    path, table = tmp_path / "identification.json", tmp_path / "record.csv"
    path.write_text(written("o-0"))
    pairs = list(zip(found["record"]["u"][0], found["record"]["y"][0], strict=True))
    rows = [f'{k},"{u!r}",{y!r}' for k, (u, y) in enumerate(pairs)]
    table.write_text("\n".join(['t,"valve, a",level', *rows]) + "\n")
    assert setid.IOData.from_csv(table, "valve, a", "level").samples == len(rows)
    assert command.main(["--record", str(table), str(path)]) == 0
    assert "u1 is column 'valve, a'" in capsys.readouterr().out
    table.write_text(f"\t{table.read_text()}\n \t\n")  # blanks before, and lines of them behind
    assert setid.IOData.from_csv(table, "valve, a", "level").samples == len(rows)
    assert command.main(["--record", str(table), str(path)]) == 0
    table.write_text("\n".join(['t,"valve, a,level', *rows]) + "\n")
    assert command.main(["--record", str(table), str(path)]) == 2


@pytest.mark.parametrize(("name", "field"), [("o-0", "ends"), ("e-0", "linear")])
def test_more_ends_than_those_of_the_parameters_are_malformed(name, field):
    found = loaded(name)
    whole = found[field] or [{"certificate": None, "attained": None}]
    found[field] = whole * (2 * len(found["parameters"]) + 1)
    with pytest.raises(reading.Malformed, match="more than two for each parameter"):
        Identification(found)


def gapped(ranges, error=0.0):
    """y(k) + a1 y(k-1) = b0 u(k), sample 4 missing: y(4) = -a1 y(3) + b0 u(4)."""
    u, y = [1.0, 0.5, 1.0, -1.0, 1.0, 0.5], [1.0, 1.0, 1.5, None, 0.875, 0.9375]
    data = setid.IOData(u, [math.nan if v is None else v for v in y], y_range=ranges)
    priors = [setid.Box({"a1": (-0.75, -0.25), "b0": (0.5, 1.5)})]
    options = setid.Options(time_limit=5.0, progress=False)
    noise = setid.Noise(output=0.125, equation=error)
    result = setid.identify(data, setid.TransferFunction(1, 1), noise, priors, options)
    return json.loads(certificate_text(result))["identification"]


@pytest.mark.parametrize("ranges", [None, [(-9.0, 9.0)], [(-9.0, 0.5)]])
def test_the_range_that_its_equation_implies_bounds_a_missing_output(ranges):
    """-a1 y(3) in [.25 1.375, .75 1.625], and b0 u(4) in [-1.5, -.5]."""
    found = gapped(ranges)
    about = Identification(found)
    lines = about.check()
    assert sum("attained from" in line for line in lines) == 2
    (place,) = (v for v, key in enumerate(about.keys) if key == ("y", 1, 3))
    low, high = 0.25 * 1.375 - 1.5, 0.75 * 1.625 - 0.5
    assert about.bounds(place)[0] == pytest.approx(low, abs=1e-12)
    assert about.bounds(place)[1] == pytest.approx(0.5 if ranges and high > ranges[0][1] else high)
    found["problem"]["lower"]["data"][place] += 1e-9 / found["units"][place]
    assert verdict(found) == "refused"


def test_the_error_of_an_equation_widens_what_it_implies_of_a_missing_output():
    """As above, and an error of 1/16 in the equation."""
    found = gapped(None, 0.0625)
    about = Identification(found)
    about.check()
    (place,) = (v for v, key in enumerate(about.keys) if key == ("y", 1, 3))
    low = 0.25 * 1.375 - 1.5 - 0.0625
    assert about.bounds(place)[0] == pytest.approx(low, abs=1e-12)
    found["problem"]["lower"]["data"][place] += 0.03125 / found["units"][place]
    with pytest.raises(NotProved, match=r"those of y1\[4\] do not follow"):
        Identification(found).check()


LISTS = {
    "variables[1]": lambda f: f["variables"][1],
    "rows[4]": lambda f: f["rows"][4],
    "intervals[0].outer": lambda f: f["intervals"][0]["outer"],
    "intervals[1].inner": lambda f: f["intervals"][1]["inner"],
    "linear[2].multipliers[0]": lambda f: f["linear"][2]["multipliers"][0],
    "given": lambda f: f["given"],
    "box.steps[0].rows[0]": lambda f: f["box"]["steps"][0]["rows"][0],
    "box.steps[0].nodes[0].rows[0]": lambda f: f["box"]["steps"][0]["nodes"][0]["rows"][0],
    "box.steps[0].nodes[0].bounds[0].multipliers[0]": lambda f: f["box"]["steps"][0]["nodes"][0][
        "bounds"
    ][0]["multipliers"][0],
}


@pytest.mark.parametrize("place", LISTS)
@pytest.mark.parametrize("longer", [False, True])
def test_lists_of_another_length_are_refused_by_their_place(place, longer, tmp_path, capsys):
    found = loaded("e-0")
    row, bounds = [1, 1, 1, [0.0] * 3], [{"multipliers": [[0, "1"]], "empty": False}]
    nodes = [{"children": [], "split": -1, "rows": [row], "bounds": bounds}]
    inverse = {"rows": [[1, 1]], "inverse": [], "centre": [], "radius": []}
    step = inverse | {"is": "LeftInverse"} if ".steps[0].rows" in place else {"is": "SignTree"}
    ends = {"lower": ["-inf"] * 2, "upper": ["inf"] * 2, "kind": "ParameterBox"}
    if place.startswith("box"):
        found["box"] = ends | {"steps": [step | {"nodes": nodes}]}
    damaged = LISTS[place](found)
    if longer:
        damaged.append(damaged[-1])
    else:
        del damaged[-1]
    path = tmp_path / "identification.json"
    text = {"format": "setid", "version": 10, "is": "identification", "identification": found}
    path.write_text(json.dumps(text))
    assert command.main([str(path)]) == 2
    assert f"MALFORMED  identification.{place}: " in capsys.readouterr().out


def test_orders_beyond_the_parameters_take_no_time():
    for name in ("na", "nb"):
        found = loaded("e-0")
        found["structure"][name] = [[10**30]]
        with pytest.raises(reading.Malformed, match=rf"structure.{name}: more coefficients"):
            Identification(found)


def test_ends_that_are_not_attained_are_refused():
    """What is attained is rounded by less than 1e-12, and the file says 1e-9 more."""
    for side, more in ((0, -1e-9), (1, 1e-9)):
        found = loaded("o-0")
        found["intervals"][1]["inner"][side] += more
        with pytest.raises(NotProved, match=r"intervals\[1\].inner: attained from .* but only"):
            Identification(found).check()


def endless(noise) -> dict:
    """y(k) + a1 y(k-1) = b0 u(k) + e with y(0) = 0 alone: nothing is said of a1."""
    data = setid.IOData([1.0, -1.0], [0.0, 1.0])
    options = setid.Options(time_limit=2.0, progress=False)
    result = setid.identify(data, setid.TransferFunction(1, 1), noise, options=options)
    return certificate_files(result)["identification"]


def test_rays_prove_ends_that_are_infinite():
    found = endless(setid.Noise(equation=0.5))
    lines = Identification(found).check()
    assert "proved: a1 in [-inf, inf], attained from -inf to inf" in lines
    for number, change in ((0, ["0", "0"]), (0, ["0", "1"]), (1, found["linear"][0]["ray"])):
        other = copy.deepcopy(found)
        other["linear"][number]["ray"] = change
        with pytest.raises(NotProved, match=rf"linear\[{number}\].ray"):
            Identification(other).check()


def test_infinite_ends_without_a_ray_are_taken_as_given():
    """Files hold no proof that a parameter is unbounded; b0 is bounded, so it cannot be."""
    found = endless(setid.Noise(equation=0.5))
    for entry in found["linear"]:
        entry["ray"] = None
    lines = Identification(found).check()
    assert "taken as given: that the record does not bound a1" in lines
    found["intervals"][1]["inner"][0] = "-inf"
    with pytest.raises(NotProved, match=r"intervals\[1\].inner"):
        Identification(found).check()


def test_help_is_given(capsys):
    assert command.main(["--help"]) == command.main(["-h"]) == 0
    assert capsys.readouterr().out.count("--decimal ") == 4


# ---- damaged files ------------------------------------------------------------------------------


def attack(names, count, seed=0):
    """Damage files; what was said, and accepted ones that claim what the record does not say.

    The record and the noise are part of the question, so only the proofs are damaged: a claim is
    false if it leaves out values that are attained.
    """
    said, wrong = {"accepted": 0, "refused": 0, "malformed": 0}, []
    for number in range(count):
        name = names[number % len(names)]
        found, chance = loaded(name), random.Random(f"{seed} {name} {number}")
        other = copy.deepcopy(found)
        fields = ["problem", "rows", "box", "ends", "linear", "intervals", "units", "variables"]
        place = chance.choice([key for key in (*fields, "driven") if other[key]])
        inner = {"certificate": other[place]}
        inner["certificate"] = damage.damaged(inner, chance)[0].get("certificate")
        other[place] = inner["certificate"]
        try:
            word = verdict(other)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
            word = "malformed"  # the command says so
        said[word] += 1
        if word == "accepted" and not still_true(found, other):
            wrong.append((name, number, place))
    return said, wrong


def still_true(found, other):
    for old, new in zip(found["intervals"], other["intervals"], strict=True):
        if old["inner"] is None or new["name"] != old["name"]:
            continue
        low, high = (float(v) for v in new["outer"])
        if low > old["inner"][0] or high < old["inner"][1]:
            return False
    return True


def test_damaged_records_prove_nothing_false():
    said, wrong = attack(("e-0", "o-0", "second-e-0"), 60)
    assert not wrong
    assert said["refused"] + said["malformed"] > 30


@pytest.mark.slow
def test_hundreds_of_damaged_records_prove_nothing_false():
    said, wrong = attack(("e-0", "o-0", "oi-0", "eoi-0", "stable-0", "box-0", "gap-range"), 700)
    assert not wrong
    assert said["refused"] + said["malformed"] > 300
    said, wrong = attack(("two-poles-driven",), 60)
    assert not wrong
    assert said["refused"] + said["malformed"] > 30


# ---- unknowns that stand for sums of products ---------------------------------------------------


def lifted_places(found: dict) -> tuple[int, int]:
    """The first row that defines such an unknown, and the place of the unknown."""
    row = next(k for k, origin in enumerate(found["rows"]) if origin and origin[0] == "lifted")
    return row, found["variables"].index(["lifted", 0, found["rows"][row][1]])


def lifted_damage() -> dict:
    """What may not pass: each change of the file, by what it would believe."""

    def changed(found: dict, row: int) -> None:
        found["problem"]["constraints"][row]["polynomial"]["coefficients"]["data"][0] *= 2

    def inequality(found: dict, row: int) -> None:
        found["problem"]["constraints"][row]["kind"] = "NONNEGATIVE"

    def twice(found: dict, row: int) -> None:
        found["rows"][row + 1] = found["rows"][row]

    def bounded(found: dict, _: int) -> None:
        found["problem"]["upper"]["data"][lifted_places(found)[1]] = 10.0

    def given(found: dict, row: int) -> None:
        found["problem"]["constraints"].append(found["problem"]["constraints"][row])
        found["rows"].append(None)

    def of_samples(found: dict, row: int) -> None:
        sample = next(k for k, origin in enumerate(found["rows"]) if origin and origin[0] == "y1")
        found["rows"][sample] = ["lifted", 0]

    def constant(found: dict, _: int) -> None:
        rows = zip(found["rows"], found["problem"]["constraints"], strict=True)
        polynomial = next(c for origin, c in rows if origin and origin[0] == "y1")["polynomial"]
        width = polynomial["words"]["shape"][1]
        words = np.reshape(polynomial["words"]["data"], (-1, width))
        (place,) = np.flatnonzero(~words.any(axis=1))
        polynomial["coefficients"]["data"][place] += 0.25

    every = (changed, inequality, twice, bounded, given, of_samples, constant)
    return {f.__name__: f for f in every}


def test_rows_in_sums_of_products_are_those_of_the_record():
    found = loaded("two-poles-o")
    assert found["structure"]["form"] == "lifted" and lifted_places(found)[0] == 0
    lines = Identification(found).check()
    assert not any(line.startswith("taken as given") for line in lines)
    assert sum("attained from" in line for line in lines) == len(found["parameters"])


@pytest.mark.parametrize("name", lifted_damage())
def test_sums_of_products_are_nothing_else(name):
    found = loaded("two-poles-o")
    lifted_damage()[name](found, lifted_places(found)[0])
    with pytest.raises((NotProved, reading.Malformed)):
        Identification(found).check_rows()


def test_definitions_do_not_speak_of_what_they_define():
    """x = x^2 + 1 has no solution, and would prove anything."""
    found = Identification(loaded("two-poles-o"))
    letter = lifted_places(loaded("two-poles-o"))[1] + 1
    found.problem.constraints[0].polynomial = Polynomial(
        {(letter,): 1, (letter, letter): -1, (): -1}
    )
    with pytest.raises(NotProved, match="does not define"):
        found.check_rows()


@pytest.mark.parametrize("form", ["auto", "partial"])
def test_rows_beside_partial_outputs_multiply_the_offset(form):
    """A box of the direct form, where c is added to the equation, says nothing of the output's c.

    The record was made with c = 1; without the factors 0.604 to 0.691 would be proved.
    """
    found = loaded("two-poles-offset-direct")
    found["structure"]["form"] = form
    found["rows"], found["problem"]["constraints"] = [], []
    found["ends"] = [{**end, "certificate": None, "attained": None} for end in found["ends"]]
    for v, stated in enumerate(found["intervals"]):
        stated["outer"] = [found["box"][side][v] for side in ("lower", "upper")]
        stated["inner"] = None
    assert verdict(found) in ("refused", "malformed")


# ---- rows by hand -------------------------------------------------------------------------------


def test_rows_of_two_denominators_are_multiplied_out():
    """(1 + a1 q^-1)(1 + a2 q^-1) y - b1 (1 + a2 q^-1) u1 - b2 (1 + a1 q^-1) u2 = 0."""
    from checker.records.structure import Structure

    table = {"na": [[1, 1]], "nb": [[1, 1]], "nk": [[0, 0]], "form": "direct", "initial": "free"}
    made = Structure(table | {"common_denominator": False, "offset": False}, 2, 1)
    one, two, b1, b2 = made.parameters
    assert (one, two, b1, b2) == ("a[1,1]1", "a[1,2]1", "b[1,1]0", "b[1,2]0")
    found = sorted((t.sign, *sorted(t.parameters), t.signal, t.lag) for t in made.equation("y1"))
    wanted = [
        (1, "y1", 0),
        (1, one, "y1", 1),
        (1, two, "y1", 1),
        (1, one, two, "y1", 2),
        (-1, b1, "u1", 0),
        (-1, two, b1, "u1", 1),
        (-1, b2, "u2", 0),
        (-1, one, b2, "u2", 1),
    ]
    assert found == sorted(wanted)


@pytest.mark.parametrize("seed", range(3))
def test_rows_hold_at_what_made_the_record(seed):
    """The polynomial of every row is zero, up to rounding, at the true parameters and noise."""
    rng = np.random.default_rng(seed)
    u, eta = rng.normal(size=8), rng.uniform(-0.1, 0.1, 8)
    y = record_corpus.response(u, [-0.5, 0.2], [1.0, 0.3], np.zeros(8))
    found = setid.formulate(
        setid.IOData(u, y + eta), setid.TransferFunction(2, 2), setid.Noise(output=0.1)
    )
    from checker.records.structure import Record, Structure

    table = {"na": [[2]], "nb": [[2]], "nk": [[0]], "form": "auto", "initial": "free"}
    made = Structure(table | {"common_denominator": False, "offset": False}, 1, 1)
    bounds = {"output": [[0.1] * 8], "input": [[0.0] * 8], "equation": [[0.0] * 8]}
    stated = {"u": [u.tolist()], "y": [(y + eta).tolist()], "starts": [0]}
    record = Record({"record": stated | {"ranges": {"u": None, "y": None}}, "noise": bounds})
    record.letters = {("eta", 1, k): 5 + k for k in range(8)}
    places = {name: v for v, name in enumerate(found.parameters)}
    x = [-0.5, 0.2, 1.0, 0.3, *eta.tolist()]
    for k in range(2, 8):
        row = record.row(made.equation("y1"), places, k, False)
        value = sum(float(c) * math.prod(x[v - 1] for v in word) for word, c in row.items())
        assert abs(value) < 1e-12


@pytest.mark.parametrize("name", ["narx", "hammerstein", "wiener", "lure", "continuous"])
def test_rows_of_other_structures_are_taken_as_given(tmp_path, capsys, name):
    """Both checkers agree (`written` asserts that setid verifies), but for rows and box."""
    path = tmp_path / f"{name}.json"
    path.write_text(written(name))
    assert command.main([str(path)]) == 3
    lines = capsys.readouterr().out.splitlines()
    given = [line for line in lines if line.startswith("taken as given")]
    assert given[0].startswith("taken as given: the rows, which are said to be those of ")
    assert all(line.startswith("taken as given: the box") for line in given[1:])
    count = len(loaded(name)["parameters"])
    assert sum(line.startswith("proved") for line in lines) == count


@pytest.mark.parametrize("kind", ["DirectionBox", "LiftedBox", "CellBox", "SimulatedBox"])
def test_boxes_without_steps_are_named_and_not_believed(tmp_path, kind, capsys):
    file = json.loads(written("o-0"))
    file["identification"]["box"] |= {"steps": None, "kind": kind}
    path = tmp_path / "record.json"
    path.write_text(json.dumps(file))
    assert command.main([str(path)]) == 3
    assert f"taken as given: the box of the parameters, a {kind} (" in capsys.readouterr().out


def test_boxes_of_unknown_kinds_are_refused():
    found = loaded("o-0")
    found["box"] |= {"steps": None, "kind": "MagicBox"}
    assert verdict(found) == "malformed"


def test_the_checker_names_every_kind_of_box_that_is_written():
    assert set(KINDS) == {kind.__name__ for kind in get_args(ProvedBox)}


# ---- rows with an offset of the equation --------------------------------------------------------


def test_rows_with_an_offset_of_the_equation_bound_the_others():
    found = loaded("two-poles-driven")
    assert found["driven"]["structure"]["form"] == "driven"
    lines = Identification(found).check()
    assert not any(line.startswith("taken as given") for line in lines)
    assert sum("attained from" in line for line in lines) == len(found["parameters"])


def test_what_the_rows_inside_take_as_given_is_said():
    """A box without steps inside is no proof around it."""
    found = loaded("two-poles-driven")
    found["driven"]["box"]["steps"] = None
    lines = Identification(found).check()
    (said,) = (line for line in lines if line.startswith("taken as given"))
    assert "LiftedBox" in said


def driven_damage() -> dict:
    """What may not pass: each change of the file, by what it would believe."""

    def narrow(found: dict) -> None:
        outer = found["driven"]["intervals"][2]["outer"]
        outer[1] = 0.5 * (outer[0] + outer[1])

    def given(found: dict) -> None:
        found["driven"]["given"][0][0] = -0.9

    def offset_given(found: dict) -> None:
        found["given"][1][4], found["driven"]["given"][1][4] = 5.0, 5.0

    def a_row(found: dict) -> None:
        inner = found["driven"]
        inner["problem"]["constraints"].append(inner["problem"]["constraints"][-1])
        inner["rows"].append(None)

    def errors(found: dict) -> None:
        found["noise"]["equation"][0][3] = 0.1

    def no_object(found: dict) -> None:
        found["driven"] = [1]

    def left_out(found: dict) -> None:
        found["driven"] = None

    every = (narrow, given, offset_given, a_row, errors, no_object, left_out)
    return {f.__name__: f for f in every}


DRIVEN_STRUCTURES = {
    "another order": ("outside", {"nk": [[0, 1]]}),
    "the same offset": ("outside", {"form": "direct"}),
    "offsets of outputs": ("inside", {"form": "lifted"}),
    "at rest": ("inside", {"initial": "zero"}),
    "no offset": ("inside", {"offset": False}),
    "another structure": ("inside", {"is": "rows", "text": "some"}),
}


@pytest.mark.parametrize("name", DRIVEN_STRUCTURES)
def test_rows_of_other_structures_bound_nothing(name):
    found = loaded("two-poles-driven-box")
    where, fields = DRIVEN_STRUCTURES[name]
    (found if where == "outside" else found["driven"])["structure"] |= fields
    with pytest.raises((NotProved, reading.Malformed)):
        Identification(found).check()


@pytest.mark.parametrize("name", driven_damage())
def test_rows_with_an_offset_of_the_equation_are_nothing_else(name):
    found = loaded("two-poles-driven-box")
    driven_damage()[name](found)
    with pytest.raises((NotProved, reading.Malformed)):
        Identification(found).check()


@pytest.mark.parametrize(
    ("factor", "kind", "same"),
    [(2, "NONNEGATIVE", True), (-1, "NONNEGATIVE", False), (1, "ZERO", False)],
)
def test_given_rows_are_compared_up_to_a_positive_factor(factor, kind, same):
    def asked(factor, kind):
        found = loaded("two-poles-driven")
        row = copy.deepcopy(found["problem"]["constraints"][-1]) | {"kind": kind}
        words, values = row["polynomial"]["words"], row["polynomial"]["coefficients"]
        words["data"], words["shape"] = [0, 1], [2, 1]
        values["data"], values["shape"] = [3.0 * factor, 1.0 * factor], [2]
        found["problem"]["constraints"].append(row)
        found["rows"].append(None)
        about = Identification(found)
        about.check_rows()
        return about.asked

    assert (asked(factor, kind) == asked(1, "NONNEGATIVE")) is same


def test_a_given_row_about_an_offset_is_not_one_about_the_other():
    """Both are called c; a row that is given of the output's is none of the equation's."""
    found = loaded("two-poles-driven")
    for part in (found, found["driven"]):
        place = part["parameters"].index("c") + 1
        row = copy.deepcopy(part["problem"]["constraints"][-1]) | {"kind": "NONNEGATIVE"}
        words, values = row["polynomial"]["words"], row["polynomial"]["coefficients"]
        words["data"], words["shape"] = [0, place], [2, 1]
        values["data"], values["shape"] = [100.0, -part["units"][place - 1]], [2]
        part["problem"]["constraints"].append(row)
        part["rows"].append(None)
    about = Identification(found)
    assert about.driven is not None
    for part in (about, about.driven):
        part.check_rows()
    assert about.asked == about.driven.asked and len(about.asked) == 1
    with pytest.raises(NotProved, match="speaks of an offset"):
        check_question(about, about.driven, ["c"])


SHOWN = {
    "na": [[1, 1]],
    "nb": [[1, 1]],
    "nk": [[1, 1]],
    "common_denominator": False,
    "offset": True,
}


@pytest.mark.parametrize(
    ("form", "two", "error", "why"),
    [
        ("auto", {}, 0.0, None),
        ("lifted", {}, 0.0, None),
        ("auto", {"nk": [[1, 2]]}, 0.0, "another structure"),
        ("auto", {"form": "lifted"}, 0.0, "does not drive"),
        ("direct", {}, 0.0, "the same offset"),
        ("driven", {}, 0.0, "the same offset"),
        ("auto", {}, 0.1, "equation errors"),
    ],
)
def test_structures_differ_in_their_offset_alone(form, two, error, why):
    adds = form not in ("direct", "driven")
    one = SimpleNamespace(
        shown=SHOWN | {"form": form}, zero=True, outputs=range(1), adds_offset=lambda i: adds
    )
    other = SimpleNamespace(shown=SHOWN | {"form": "driven"} | two, zero=False)
    bounds = SimpleNamespace(bounds={"equation": [[0.0, error]]})
    about, inner = (SimpleNamespace(structure=s, record=bounds) for s in (one, other))
    with nullcontext() if why is None else pytest.raises(NotProved, match=why):
        check_structures(about, inner)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({}, None),
        ({"asked": set(), "slack": {}}, None),
        ({"given": [[-INF, -INF], [INF, INF]]}, None),
        ({"given": [[-0.5, -INF], [1, INF]]}, "a is bounded more"),
        ({"given": [[-1, -INF], [1, 5]]}, "c is bounded more"),
        ({"asked": {("ZERO", frozenset({(("a",), 1)}))}}, "not given"),
        ({"slack": {"slack[1]": (0, 2)}}, r"slack\[1\] is bounded more"),
        ({"slack": {"slack[2]": (0, 2)}}, r"slack\[2\] is bounded more"),
    ],
)
def test_no_more_is_given_of_the_rows_inside(changes, why):
    row = ("NONNEGATIVE", frozenset({(("a",), 1)}))
    fields = {"asked": {row}, "slack": {"slack[1]": (0, 3)}, "structure": True}
    about = SimpleNamespace(names=["a", "c"], given=[[-1, 0], [1, 5]], **fields)
    inner = SimpleNamespace(**({"given": [[-1, -INF], [1, INF]]} | fields | changes))
    for one in (about, inner):
        one.bounds_of = lambda group, one=one: getattr(one, group)
    with nullcontext() if why is None else pytest.raises(NotProved, match=why):
        check_question(about, inner, ["c"])
