"""The second checker: it agrees with the package on true claims and refuses false ones."""

from __future__ import annotations

import ast
import json
import math
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import certificate_corpus as corpus
import certificate_damage as damage
import compare_checkers
import pytest
from certificate_corpus import FEW, solved

import sparsepop_py as sp
from checker import command, result
from checker.arithmetic import interval as iv
from checker.certificates import substitution
from checker.certificates.certificate import Box, Replay, Tightening
from checker.files import reading

ROOT = Path(__file__).resolve().parent.parent.parent
INF = math.inf


def loaded(group: str, most: int, name: str) -> dict:
    return json.loads(solved(group, most)[name])["result"]


# ---- agreement ----------------------------------------------------------------------------------


@pytest.mark.parametrize("group", FEW)
def test_both_checkers_agree(group):
    """What the package reads back, which proves it, the second checker proves at least as well."""
    for name, text in solved(group, FEW[group]).items():
        package = compare_checkers.theirs(text)
        own = compare_checkers.ours(json.loads(text)["result"])
        assert own[0] == package[0], (name, package, own)
        assert own[1] >= package[1], (name, package, own)


def test_the_few_are_of_all_kinds():
    seen = set()
    for group in FEW.keys() - {"zoo", "examples"}:
        for text in solved(group, FEW[group]).values():
            seen |= corpus.kinds(json.loads(text)["result"])
    assert seen >= {"Identity", "LinearDual", "ExactGram", "ExactDual"}
    assert seen >= {"Propagation", "Sublevel", "LeftInverse"}
    assert seen >= {"Known", "tree", "floor", "products", "matrix multiplier", "ends of t"}
    assert seen >= {"attained exact", "attained krawczyk", "ray", "no feasible point"}


@pytest.mark.slow
def test_both_checkers_agree_on_the_whole_corpus(tmp_path):
    corpus.write(tmp_path, list(corpus.GROUPS))
    assert len(list(tmp_path.glob("*.json"))) >= 400
    assert compare_checkers.main(tmp_path) == 0


# ---- what the checker rests on ------------------------------------------------------------------


def test_nothing_but_the_standard_library_is_imported():
    for path in sorted((ROOT / "checker").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names = [node.module or ""]
            for name in names:
                first = name.partition(".")[0]
                assert first in sys.stdlib_module_names or first == "checker", (path.name, name)


def test_the_program_prints_what_is_proved(tmp_path):
    """min x y on the unit disc is -1/2; a claim of -0.4 is false; a text states it as well."""
    found = loaded("known", 6, "disc")
    own = {"format": "sparsepop-py", "version": 7}
    problem = tmp_path / "problem.json"
    problem.write_text(json.dumps(own | {"is": "problem", "problem": found["problem"]}))
    words = tmp_path / "problem.txt"
    words.write_text("min x1*x2; s.t. x1^2 + x2^2 <= 1")
    certificate = tmp_path / "certificate.json"
    for bound, code in ((found["lower_bound"], 0), (-0.4, 1), ("no number", 2)):
        found["certificate"][-1]["bound"] = bound
        filled = own | {"is": "certificate", "certificate": found["certificate"]}
        certificate.write_text(json.dumps(filled))
        for stated in (problem, words):
            line = [sys.executable, ROOT / "checker" / "check.py", stated, certificate]
            done = subprocess.run(line, capture_output=True, text=True, timeout=60)
            assert done.returncode == code, done.stdout + done.stderr
    assert "MALFORMED" in done.stdout


@pytest.mark.parametrize("version", [2, 8, "7", 7.0])
def test_other_versions_are_refused(tmp_path, capsys, version):
    text = solved("trees", FEW["trees"]).popitem()[1]
    path = tmp_path / "other.json"
    for given, code in ((5, 0), (version, 2)):
        path.write_text(json.dumps(json.loads(text) | {"version": given}))
        assert command.main([str(path)]) == code
    assert "version" in capsys.readouterr().out


def test_fingerprints_are_those_of_the_package(tmp_path, capsys):
    for group in ("known", "matrices", "chains"):
        for text in solved(group, FEW[group]).values():
            problem = sp.from_json(text).problem
            found = json.loads(sp.to_json(problem))["problem"]
            assert result.fingerprint(found) == problem.fingerprint
            found["upper"]["data"][0] = 1e6
            assert result.fingerprint(found) != problem.fingerprint
    file = json.loads(solved("known", 6)["disc"])
    file["result"]["certificate"][-1]["fingerprint"] = "v2:" + 64 * "0"
    path = tmp_path / "result.json"
    path.write_text(json.dumps(file))
    assert command.main([str(path)]) == 0
    assert "remark: by its fingerprint" in capsys.readouterr().out


@pytest.mark.parametrize("change", ["version", "format", "twice", "nan", "large"])
def test_files_of_another_kind_are_refused(tmp_path, change):
    text = solved("known", 6)["disc"]
    edits = {
        "version": ('"version":7', '"version":8'),
        "format": ('"sparsepop-py"', '"sparsepop"'),
        "twice": ('"version":7', '"version":7,"version":7'),
        "nan": ('"lower_bound":', '"lower_bound":NaN,"other":'),
        "large": ('"lower_bound":', '"lower_bound":1e999,"other":'),
    }
    path = tmp_path / "result.json"
    path.write_text(text.replace(*edits[change], 1))
    assert path.read_text() != text
    assert command.main([str(path)]) == 2


@pytest.mark.parametrize("path", sorted((ROOT / "examples" / "problems").glob("*.gms")), ids=str)
def test_problems_as_text_are_those_of_the_package(path):
    wanted = reading.problem(json.loads(sp.to_json(sp.read_gms(path)))["problem"])
    found = command.problem_of(str(path))[0]
    assert found.names == wanted.names
    assert (found.lower, found.upper) == (wanted.lower, wanted.upper)
    rows = [found.objective, *(c.polynomial for c in found.constraints)]
    others = [wanted.objective, *(c.polynomial for c in wanted.constraints)]
    for one, other in zip(rows, others, strict=True):
        assert one.open() == other.open() and one.coefficient() == other.coefficient()
    assert [c.kind for c in found.constraints] == [c.kind for c in wanted.constraints]


# ---- damaged files ------------------------------------------------------------------------------


def attacked(folder, count, groups):
    for group, most in groups.items():
        for name, text in solved(group, most).items():
            (folder / f"{group}-{name}.json").write_text(text)
    return damage.attack(sorted(folder.glob("*.json")), count)


def test_damaged_files_prove_nothing_false(tmp_path):
    said, wrong = attacked(tmp_path, 250, {k: min(v, 4) for k, v in FEW.items()})
    assert not wrong
    assert sum(said.values()) == 250
    assert said["refused"] > 30 and said["malformed"] > 30 and said["accepted"] > 10


@pytest.mark.slow
def test_thousands_of_damaged_files_prove_nothing_false(tmp_path):
    groups = {"known": 6, "random": 60, "trees": 40, "matrices": 40, "examples": 12, "chains": 40}
    groups |= {"coercive": 16, "inverses": 16, "families": 24, "empty": 16, "deep": 10}
    said, wrong = attacked(tmp_path, 6000, groups)
    assert not wrong
    assert said["refused"] > 1000


# ---- planted false claims -----------------------------------------------------------------------


def verdict(found: dict) -> str:
    return damage.verdict(reading.problem(found["problem"]), found)


def argument(found: dict) -> dict:
    return found["certificate"][-1]["parts"][0]["argument"]


def claim(found: dict, bound: float | str) -> dict:
    found["lower_bound"] = found["certificate"][-1]["bound"] = bound
    return found


OPTIMA = {"circle": -math.sqrt(5), "disc": -0.5, "hill": -0.125, "chain": 0.0, "lattice": 0.25}


@pytest.mark.parametrize("name", OPTIMA)
def test_bounds_above_the_optimum_are_refused(name):
    found = loaded("known", 6, name)
    assert verdict(found) == "accepted"
    for bound in (OPTIMA[name] + 1e-9, OPTIMA[name] + 1.0, 1e300, "inf"):
        assert verdict(claim(found, bound)) == "refused"


@pytest.mark.parametrize("name", OPTIMA)
def test_feasible_problems_are_not_called_infeasible(name):
    found = claim(loaded("known", 6, name), "inf")
    found["certificate"][-1]["parts"][0]["empty"] = True
    found["status"] = "INFEASIBLE"
    assert verdict(found) == "refused"
    found["certificate"][-1]["cutoff"] = -1e6  # f <= -1e6 holds nowhere, and proves f >= -1e6 only
    assert verdict(found) == "refused"


def test_infeasible_problems_are():
    found = loaded("known", 6, "empty")
    assert verdict(found) == "accepted"
    argument(found)["multipliers"] = argument(found)["multipliers"][:1]
    assert verdict(found) == "refused"


@pytest.mark.parametrize(
    "row", [lambda x: 0 * x >= 1, lambda x: 0 * x == 1, lambda x: 0 * x >= 1e-9]
)
def test_constants_that_no_point_satisfies_prove_that_there_is_none(row):
    (x,) = sp.variables(1)
    text = sp.to_json(sp.solve(sp.Problem(x, [row(x)], 0, 1)))
    found = json.loads(text)["result"]
    assert (found["status"], verdict(found)) == ("INFEASIBLE", "accepted")


@pytest.mark.parametrize("factor", [0.5, 0.999])
def test_a_scaling_has_to_hold_the_box(factor):
    """With half the scale the remainder costs less, and the box is not that of the problem."""
    found = loaded("known", 6, "circle")
    scale = argument(found)["scaling"]["scale"]
    scale["data"] = [factor * s for s in scale["data"]]
    assert verdict(found) == "refused"


def test_a_scaling_that_turns_a_variable_around_is_refused():
    found = loaded("known", 6, "circle")
    argument(found)["scaling"]["scale"]["data"][0] *= -1
    assert verdict(found) == "malformed"


def test_free_multipliers_belong_to_equalities():
    """x y >= -1/4 read as x y == -1/4 would allow a multiplier of the other sign."""
    found = loaded("known", 6, "circle")
    groups = [g for g in argument(found)["multipliers"] if len(g["values"]["shape"]) == 2]
    assert groups and groups[0]["generator"]["data"] == [1]
    groups[0]["generator"]["data"] = [2]
    assert verdict(found) == "malformed"


@pytest.mark.parametrize("floor", [-1.0, "inf", 1e308])
def test_a_floor_is_a_number_that_is_paid_for(floor):
    """The floor is part of the multiplier, so that a large one makes the remainder large."""
    found = loaded("known", 6, "hill")
    for group in argument(found)["multipliers"]:
        if len(group["values"]["shape"]) == 3:
            group["floor"] = floor
    assert verdict(found) != "accepted"


ONE_VARIABLE = {
    "objective": {
        "words": {"type": "i4", "shape": [1, 1], "data": [1]},
        "coefficients": {"type": "f8", "shape": [1], "data": [1.0]},
        "dimension": 1,
    },
    "constraints": [
        {
            "polynomial": {
                "words": {"type": "i4", "shape": [2, 2], "data": [0, 0, 1, 1]},
                "coefficients": {"type": "f8", "shape": [2], "data": [4.0, -1.0]},
                "dimension": 1,
            },
            "kind": "NONNEGATIVE",
            "name": "",
            "entries": [],
        }
    ],
    "lower": {"type": "f8", "shape": [1], "data": ["-inf"]},
    "upper": {"type": "f8", "shape": [1], "data": ["inf"]},
    "names": ["x"],
    "squares": [],
    "sense": "min",
}


def numbers(kind: str, shape: list[int], *data: object) -> dict:
    return {"type": kind, "shape": shape, "data": list(data)}


def free_scaling(**ends: object) -> dict:
    found = {"centre": numbers("f8", [1], 0.0), "scale": numbers("f8", [1], 1.0)}
    found |= {"boxed": numbers("b1", [1], False), "side": numbers("i8", [1], 0)}
    return found | {"ends": None} | ends


def group_of(generator: int, basis: list[int], floor: float, *values: float) -> dict:
    return {
        "generator": numbers("i4", [1], generator),
        "basis": numbers("i4", [1, len(basis), 1], *basis),
        "values": numbers("f8", [1, len(basis), 1], *values),
        "floor": floor,
        "place": None,
    }


def one_part(bound: float | str, **part: object) -> list:
    made = {"steps": [], "argument": None, "empty": False, "branch": None, "children": []} | part
    rest = {"fingerprint": "", "cutoff": None, "correction": 0.0, "assumptions": []}
    return [{"bound": bound, "parts": [made]} | rest]


def least(certificates: list, problem: dict = ONE_VARIABLE) -> float:
    """What a list of certificates proves."""
    about = reading.problem(problem)
    return float(result.Certificates(certificates, about).prove()[0])


@pytest.mark.parametrize("basis, reach", [([0, 1], 2.0), ([1], math.sqrt(5))])
def test_a_sublevel_set_takes_off_the_one_only_where_it_is(basis, reach):
    """4 - x^2 >= 0 gives x^2 <= 4; with the basis {1, x} it says 1 + x^2 <= 5, without 1 less."""
    identity = {
        "scaling": free_scaling(),
        "multipliers": [group_of(1, [0], 0.0, 1.0), group_of(0, basis, 1.0, *[0.0] * len(basis))],
        "products": numbers("i8", [0, 2]),
        "priced": None,
    }
    step = {"is": "Sublevel", "identity": identity, "cutoff": 0.0}
    made = one_part(-2.0, steps=[step])
    made[0]["cutoff"] = 0.0
    assert -reach - 1e-9 <= least(made) <= -2.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_ends_of_t_that_hold_no_number_are_refused(side):
    """x^2 + x has the minimum -1/4; with t in [inf, inf] the multiple t would cost 1e308."""
    end = numbers("f8", [1], "inf" if side > 0 else "-inf")
    priced = {"words": numbers("i4", [1, 1], 1), "values": numbers("f8", [1], side)}
    identity = {
        "is": "Identity",
        "scaling": free_scaling(ends=[end, end]),
        "multipliers": [group_of(0, [0, 1], 1.0, 0.0, 0.0)],
        "products": numbers("i8", [0, 2]),
        "priced": priced,
    }
    with pytest.raises(reading.Malformed, match="makes no sense"):
        least(one_part(1e300, argument=identity))


def test_a_certificate_cannot_quote_itself_or_claim_more_than_it_proves():
    """x >= -2 follows from x^2 <= 4; the quoted claim x >= 1 does not."""
    quoted = one_part(-2.0, steps=[{"is": "Propagation", "sweeps": 3, "uses_cutoff": False}])
    known = {"is": "Known", "bounds": [[0, 1, 0]]}
    made = [*quoted, *one_part(-2.0, steps=[known])]
    assert least(made) == -2.0
    made[0]["bound"] = 1.0
    assert least(made) == -INF
    own = one_part(-2.0, steps=[known])
    with pytest.raises(reading.Malformed, match="quoted"):
        least(own)


def test_a_certificate_proves_nothing_above_its_cutoff():
    steps = [{"is": "Propagation", "sweeps": 5, "uses_cutoff": True}]
    made = one_part(0.0, steps=steps)
    for cutoff, bound in ((-3.0, -3.0), (-1.0, -2.0)):
        made[0]["cutoff"] = cutoff
        assert least(made) == bound


def test_halves_of_a_box_cover_it():
    """Wherever the branch is, one of the children holds x = -2."""
    child = {"steps": [], "argument": None, "empty": False, "branch": None, "children": []}
    sweep = {"is": "Propagation", "sweeps": 3, "uses_cutoff": False}
    for place in (-5.0, -2.0, 0.5, 2.0, 7.0):
        made = one_part(-2.0, steps=[sweep], branch=[0, place], children=[1, 2])
        made[0]["parts"] += [child, child]
        assert least(made) == -2.0
    made[0]["parts"][0]["children"] = [1]
    with pytest.raises(reading.Malformed, match="children"):
        least(made)


def test_linear_duals_multiply_inequalities_by_positive_numbers_only():
    """-x >= 0 from the multiplier -1 of x >= 0 would be a bound of -x."""
    dual = {
        "is": "LinearDual",
        "scaling": free_scaling(side=numbers("i8", [1], 1)),
        "generator": numbers("i4", [1], 3),
        "word": numbers("i4", [1, 1], 0),
        "value": numbers("f8", [1], 1.0),
        "owner": numbers("i4", [1], 0),
        "products": numbers("i8", [0, 2]),
    }
    bounded = ONE_VARIABLE | {"lower": numbers("f8", [1], 0.0), "constraints": []}
    assert least(one_part(0.0, argument=dual), bounded) == 0.0
    falling = json.loads(json.dumps(bounded))
    falling["objective"]["coefficients"]["data"] = [-1.0]
    dual["value"]["data"] = [-1.0]
    assert least(one_part(0.0, argument=dual), falling) == -INF


def test_exact_grams_have_to_be_semidefinite():
    """x^2 - 2 x + 1 = (x - 1)^2 is at least 0 and no more; x^2 - 2 x has the minimum -1."""
    gram = {
        "is": "ExactGram",
        "basis": numbers("i4", [2, 1], 0, 1),
        "first": numbers("i8", [2], 0, 1),
        "second": numbers("i8", [2], 1, 1),
        "value": numbers("f8", [2], 0.0, 0.0),
    }
    square = ONE_VARIABLE | {"constraints": []}
    square["objective"] = {
        "words": numbers("i4", [2, 2], 0, 1, 1, 1),
        "coefficients": numbers("f8", [2], -2.0, 1.0),
        "dimension": 1,
    }
    assert least(one_part(-1.0, argument=gram), square) == -1.0
    square["objective"]["coefficients"] = numbers("f8", [2], -2.0, -1.0)
    assert least(one_part(-1.0, argument=gram), square) == -INF
    gram["basis"]["data"] = [0, 0]
    with pytest.raises(reading.Malformed, match="constant"):
        least(one_part(-1.0, argument=gram), square)


def exact_dual(**changes):
    """min x with 3 x >= 1 is 1/3."""
    dual = {
        "is": "ExactDual",
        "lower": numbers("f8", [1], "-inf"),
        "upper": numbers("f8", [1], "inf"),
        "row": numbers("i8", [1], 0),
        "word": numbers("i4", [1, 1], 0),
        "value": ["1/3"],
        "gram": None,
    }
    return one_part(1 / 3, argument=dual | changes)


def thrice(kind="NONNEGATIVE", slope=1.0, lower="-inf"):
    row = {"words": numbers("i4", [2, 1], 0, 1), "dimension": 1}
    row |= {"coefficients": numbers("f8", [2], -1.0, 3.0)}
    rows = [{"polynomial": row, "kind": kind, "name": "", "entries": []}]
    objective = {"words": numbers("i4", [1, 1], 1), "dimension": 1}
    objective |= {"coefficients": numbers("f8", [1], slope)}
    given = {"objective": objective, "constraints": rows, "lower": numbers("f8", [1], lower)}
    return ONE_VARIABLE | given | {"upper": numbers("f8", [1], "inf")}


def test_exact_multipliers_have_to_cancel_and_have_signs():
    assert least(exact_dual(), thrice()) == 1 / 3
    assert least(exact_dual(value=["1/4"]), thrice()) == -INF
    assert least(exact_dual(value=["-1/3"]), thrice("ZERO", -1.0)) == -1 / 3
    low = {"row": numbers("i8", [1], 1), "value": ["1"], "lower": numbers("f8", [1], 0.5)}
    assert least(exact_dual(**low), thrice(lower=0.5)) == 0.5
    assert least(exact_dual(**low), thrice(lower=0.25)) == 0.25  # by the bound alone


def test_exact_multipliers_of_the_cutoff_bound_variables():
    """min x with 3 x >= 1 where x <= 2: from 2 - x >= 0 follows -x >= -2, and no more."""
    dual = exact_dual(row=numbers("i8", [1], 1), value=["1"])[0]["parts"][0]["argument"]
    step = {"is": "Tightening", "variable": numbers("i8", [1], 0), "side": numbers("i8", [1], -1)}
    step |= {"value": numbers("f8", [1], -2.0), "argument": dual, "uses_cutoff": True}
    falling = thrice(slope=1.0)
    for claimed, row, end in ((-2.0, 1, 2.0), (-1.5, 1, INF), (-2.0, 0, INF)):
        step["value"], dual["row"] = numbers("f8", [1], claimed), numbers("i8", [1], row)
        replay = Replay(reading.problem(falling), Fraction(2), lambda *_: None)
        box = Box([(iv.below(-INF), iv.above(INF))])
        Tightening(step, 1, "step").apply(replay, box)
        assert iv.exact(box.ends[0][1]) == end


@pytest.mark.parametrize(
    "changes",
    [
        {"value": ["-1/3"]},
        {"value": ["1/0"]},
        {"value": [0.5]},
        {"value": []},
        {"word": numbers("i4", [1, 1], 1)},
        {"row": numbers("i8", [1], 3)},
        {"row": numbers("i8", [1], 1)},
        {"row": numbers("i8", [1], 2)},
        {"lower": numbers("f8", [2], "-inf", "-inf")},
    ],
    ids=str,
)
def test_exact_multipliers_that_make_no_sense_are_refused(changes):
    with pytest.raises(reading.Malformed):
        least(exact_dual(**changes), thrice())


def test_attained_points_have_to_be_feasible():
    """The least x with x^2 <= 4 is -2; -2.5 is not feasible, and x = -2 has no smaller value."""
    point = {"value": -2.0, "radius": 0.0, "proof": "exact"}
    point |= {"rows": numbers("i8", [0]), "solved": numbers("i8", [0])}
    found = {"problem": ONE_VARIABLE, "certificate": None, "lower_bound": "-inf"}
    found |= {"status": "BOUNDED", "upper_bound": -2.0, "attained": point}
    for x, value, word in (
        (-2.0, -2.0, "accepted"),
        (-2.0, -2.1, "refused"),
        (-2.5, -2.5, "refused"),
    ):
        point |= {"x": numbers("f8", [1], x), "value": value}
        found["upper_bound"] = value
        assert verdict(found) == word
    found |= {"status": "UNBOUNDED", "upper_bound": "-inf"}
    point |= {"x": numbers("f8", [1], -2.0), "value": -2.0}
    assert verdict(found) == "refused"


@pytest.mark.parametrize("rows, solved, word", [([0], [0], "accepted"), ([0], [1], "refused")])
def test_zeros_are_proved_by_krawczyk(rows, solved, word):
    """x^2 + y^2 = 1 solved for x near (0.6, 0.8), and for y; y is given as 0.8 and is kept."""
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, [x**2 + y**2 == 1, y >= 0.8], lower=-2, upper=2)
    point = {
        "x": numbers("f8", [2], 0.6, 0.8),
        "value": 1.4 + 1e-9,
        "radius": 1e-9,
        "proof": "krawczyk",
        "rows": numbers("i8", [len(rows)], *rows),
        "solved": numbers("i8", [len(solved)], *solved),
    }
    found = {"problem": json.loads(sp.to_json(problem))["problem"], "certificate": None}
    found |= {"lower_bound": "-inf", "upper_bound": 1.4 + 1e-9, "status": "BOUNDED"}
    assert verdict(found | {"attained": point}) == word


@pytest.mark.parametrize(
    ("rows", "word"),
    [
        ("c >= 0; -c >= 0; 2 - x1^2 - x2^2 >= 0", "accepted"),
        ("c == 0; c == 0", "accepted"),
        ("c >= 0; 1.999999 - x1^2 - x2^2 >= 0", "refused"),  # the same words
        ("c >= 0; 2 - x1^2 + x2^2 >= 0; x1^2 + x2^2 + 2 <= 0", "refused"),  # some signs
        ("c >= 0; -c + x1*x2 >= 2", "refused"),
    ],
)
def test_constraints_alike_a_row_are_zero_with_it(rows, word):
    """(1, 1) lies on the circle x1^2 + x2^2 = 2, where c = x1^2 + x2^2 - 2 and -c are zero."""
    rows = rows.replace("-c", "2 - x1^2 - x2^2").replace("c", "x1^2 + x2^2 - 2")
    problem = sp.parse(f"min x1 + x2; s.t. {rows}; -3 <= x1 <= 3; -3 <= x2 <= 3")
    point = {"value": 2.0 + 1e-9, "radius": 1e-9, "proof": "krawczyk"}
    point |= {"x": numbers("f8", [2], 1.0, 1.0)}
    point |= {"rows": numbers("i8", [1], 0), "solved": numbers("i8", [1], 1)}
    found = {"problem": json.loads(sp.to_json(problem))["problem"], "certificate": None}
    found |= {"lower_bound": "-inf", "upper_bound": 2.0 + 1e-9, "status": "BOUNDED"}
    assert verdict(found | {"attained": point}) == word


@pytest.mark.parametrize(
    "rows, solved, x, value, word",
    [
        ([0, 1], [1, 2], 0.75, 13 / 28 + 1e-12, "accepted"),
        ([0, 1], [1, 2], 0.75, 13 / 28 - 1e-12, "refused"),
        ([0, 1], [1, 2], 0.5, 2.5 / 7 + 1e-12, "refused"),  # x >= 3/4 does not hold
        ([0, 1], [1, 2], 1.75, 6.25 / 7 + 1e-12, "refused"),  # nor w <= 1/2
        ([1, 0], [2, 1], 0.75, 13 / 28 + 1e-12, "refused"),  # w before v
        ([0, 1], [2, 1], 0.75, 13 / 28 + 1e-12, "refused"),
        ([0], [1], 0.75, 13 / 28 + 1e-12, "refused"),
        ([0, 2], [1, 2], 0.75, 13 / 28 + 1e-12, "refused"),  # the second equation fails
    ],
)
def test_rows_are_solved_one_after_the_other(rows, solved, x, value, word):
    """3 v = 1 and (v + 2) w = v + x give w = (1 + 3 x) / 7, which is 13/28 at x = 3/4."""
    a, v, w = sp.variables(3)
    rest = [w <= 0.5, a >= 0.75, a**3 >= 0.421875]
    problem = sp.Problem(w, [3 * v == 1, (v + 2) * w == v + a, *rest], -9, 9)
    point = {
        "x": numbers("f8", [3], x, 1 / 3, (1 + 3 * x) / 7),
        "value": value,
        "radius": 1e-12,
        "proof": "substitution",
        "rows": numbers("i8", [len(rows)], *rows),
        "solved": numbers("i8", [len(solved)], *solved),
    }
    found = {"problem": json.loads(sp.to_json(problem))["problem"], "certificate": None}
    found |= {"lower_bound": "-inf", "upper_bound": value, "status": "BOUNDED"}
    assert verdict(found | {"attained": point}) == word
    assert verdict(found | {"attained": point | {"radius": 0.0}}) == "refused"


@pytest.mark.parametrize(
    ("second", "value", "word"),
    [
        (lambda v, w, a: w + a * v == 2, 1e-12, "accepted"),
        (lambda v, w, a: w + a * v == 2, -1e-9, "refused"),
        (lambda v, w, a: w + a * v**2 == 2, 1e-12, "refused"),  # not linear together
        (lambda v, w, a: v + a * w == 2, 1e-12, "refused"),  # no solution
        (lambda v, w, a: 2 * v + w == 2, 1e-12, "refused"),  # more than one
        (lambda v, w, a: w + a * v == 2.001, 1e-12, "refused"),  # v is negative
    ],
)
def test_first_rows_are_solved_together(second, value, word):
    """v + w / 2 = 1 and w + v / 2 = 2 have v = 0 and w = 2; then 3 z = w + 1 has z = 1."""
    a, v, w, z = sp.variables(4)
    rows = [v + a * w == 1, second(v, w, a), 3 * z == w + 1]
    problem = sp.Problem(v, [*rows, v >= -1e-12, z <= 1.001], -9, 9)
    point = {
        "x": numbers("f8", [4], 0.5, 0.0, 2.0, 1.0),
        "value": value,
        "radius": 1e-12,
        "proof": "substitution",
        "rows": numbers("i8", [3], 0, 1, 2),
        "solved": numbers("i8", [3], 1, 2, 3),
    }
    found = {"problem": json.loads(sp.to_json(problem))["problem"], "certificate": None}
    found |= {"lower_bound": "-inf", "upper_bound": value, "status": "BOUNDED"}
    assert verdict(found | {"attained": point}) == word


def test_first_rows_are_enclosed_by_few_bits(monkeypatch):
    monkeypatch.setattr(substitution, "BITS", (4,))
    third = Fraction(1, 3)
    for value in (third, -third, 2 * third):
        ((low, high),) = substitution.substituted([None], [0], [Fraction(0)], [value])
        assert low < value < high


@pytest.mark.parametrize("bits", [6, 9])
def test_products_and_quotients_are_enclosed_by_few_bits(bits, monkeypatch):
    """w = u v, v z = u and 3 t = 1, for rational u and v, hold what so few bits lose."""
    monkeypatch.setattr(substitution, "BITS", (bits,))
    monkeypatch.setattr(substitution, "SMALL", 0)
    u, v, w, z, t = sp.variables(5)
    problem = sp.Problem(u, [u == 1, v == 1, w == u * v, v * z == u, 3 * t == 1])
    stated = reading.problem(json.loads(sp.to_json(problem))["problem"])
    rows = [c.polynomial for c in stated.constraints]
    for a, b in ((1, 3), (-1, 3), (2, 7), (-5, 11), (1, 4)):
        first = [Fraction(a, 3), Fraction(b, 5)]
        found = substitution.substituted(rows, [0, 1, 2, 3, 4], [Fraction(0)] * 5, first)
        truth = [*first, first[0] * first[1], first[0] / first[1], Fraction(1, 3)]
        assert all(low <= t <= high for (low, high), t in zip(found, truth, strict=True))


def test_solutions_that_are_doubles_may_lie_on_bounds():
    """2 v = a, w = v^2 and (1 + v) z = 1 + v at a = 3/4 have v = 3/8, w = 9/64 and z = 1."""
    a, v, w, z = sp.variables(4)
    rows = [2 * v == a, w == v**2, (1 + v) * z == 1 + v]
    found = {"certificate": None, "lower_bound": "-inf", "status": "BOUNDED"}
    point = {"x": numbers("f8", [4], 0.75, 0.375, 0.140625, 1.0), "radius": 0.0}
    point |= {"rows": numbers("i8", [3], 0, 1, 2), "solved": numbers("i8", [3], 1, 2, 3)}
    point |= {"proof": "substitution", "value": 0.140625}
    for upper, word in ((0.140625, "accepted"), (0.1406249, "refused")):
        problem = sp.Problem(w, rows, 0, [1, 0.375, upper, 1])
        found |= {"problem": json.loads(sp.to_json(problem))["problem"], "upper_bound": 0.140625}
        assert verdict(found | {"attained": point}) == word


def test_long_recursions_take_more_bits():
    """x_k = x_{k-1} - x_{k-2} has period 6; intervals widen by the golden ratio at each step."""
    count = 700
    x = sp.variables(count)
    rows = [3 * x[0] == 1, 3 * x[1] == 1]
    rows += [x[k] - x[k - 1] + x[k - 2] == 0 for k in range(2, count)]
    periods = [1 / 3, 1 / 3, 0.0, -1 / 3, -1 / 3, 0.0]
    values = [periods[k % 6] for k in range(count)]
    point = {
        "x": numbers("f8", [count], *values),
        "value": values[-1] + 1e-15,
        "radius": 1e-15,
        "proof": "substitution",
        "rows": numbers("i8", [count], *range(count)),
        "solved": numbers("i8", [count], *range(count)),
    }
    for high, word in ((0.5, "accepted"), (0.25, "refused")):
        problem = sp.Problem(x[-1], rows, -high, high)
        found = {"problem": json.loads(sp.to_json(problem))["problem"], "certificate": None}
        found |= {"lower_bound": "-inf", "upper_bound": point["value"], "status": "BOUNDED"}
        assert verdict(found | {"attained": point}) == word
