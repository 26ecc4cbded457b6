"""What the format page forbids is refused by package and checker alike, needed or not."""

from __future__ import annotations

import copy
import json
from typing import Any

import pytest

import sparsepop_py as sp
from checker import command
from checker.files.reading import Malformed
from checker.files.text import of_gms, of_text
from sparsepop_py.cli import main

ROOT = "certificate", -1, "parts", 0
GROUP = (*ROOT, "argument", "multipliers")
SCALING = (*ROOT, "argument", "scaling")


@pytest.fixture(scope="module")
def good() -> Any:
    """The least value of x y on the unit circle with x >= y is -1/2."""
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, [x**2 + y**2 == 1, x - y >= 0], -2, 2)
    found = json.loads(sp.to_json(sp.solve(problem)))
    assert found["result"]["certificate"][-1]["parts"][0]["argument"]["is"] == "Identity"
    return found


def changed(found: Any, path: tuple[Any, ...], value: Any) -> Any:
    found = copy.deepcopy(found)
    holder = found["result"]
    for key in path[:-1]:
        holder = holder[key]
    holder[path[-1]] = value(holder[path[-1]]) if callable(value) else value
    return found


def unneeded(found: Any) -> Any:
    """The same certificate with a claim that needs no argument: f >= -4 holds on the box.

    Interval arithmetic may round that once.
    """
    for path in (("lower_bound",), ("certificate", -1, "bound")):
        found = changed(found, path, -4.5)
    return found


def codes(found: Any, tmp_path: Any) -> tuple[int, int]:
    """Exit codes of the package's command and of the checker."""
    path = tmp_path / "result.json"
    path.write_text(json.dumps(found), encoding="utf-8")
    return main(["verify", str(path)]), command.main([str(path)])


def array(kind: str, shape: list[int], data: list[Any]) -> dict[str, Any]:
    return {"type": kind, "shape": shape, "data": data}


def first(array_: dict[str, Any], value: Any) -> dict[str, Any]:
    return {**array_, "data": [value, *array_["data"][1:]]}


def test_the_good_file_is_accepted(good, tmp_path):
    assert codes(good, tmp_path) == codes(unneeded(good), tmp_path) == (0, 0)


FORBIDDEN = {
    "a letter outside 1..n": ((*GROUP, 0, "basis"), lambda a: first(a, 3)),
    "a generator out of range": ((*GROUP, 0, "generator"), lambda a: first(a, 99)),
    "a negative generator": ((*GROUP, 0, "generator"), lambda a: first(a, -2)),
    "generators of type f8": ((*GROUP, 0, "generator"), lambda a: {**a, "type": "f8"}),
    "generators with two axes": (
        (*GROUP, 0, "generator"),
        lambda a: {**a, "shape": [1, *a["shape"]]},
    ),
    "an infinite value": ((*GROUP, 0, "values"), lambda a: first(a, "inf")),
    "a floor of -inf": ((*GROUP, 0, "floor"), "-inf"),
    "a negative floor": ((*GROUP, 0, "floor"), -5e-324),
    "a huge shape": ((*ROOT, "argument", "products"), array("i4", [0, 2147483648], [])),
    "triples as products": ((*ROOT, "argument", "products"), array("i4", [0, 3], [])),
    "a product of later ones": ((*ROOT, "argument", "products"), array("i4", [1, 2], [1, 9])),
    "an infinite centre": ((*SCALING, "centre"), lambda a: first(a, "inf")),
    "a negative scale": ((*SCALING, "scale"), lambda a: first(a, -1.0)),
    "one scale of two": ((*SCALING, "scale"), array("f8", [1], [1.0])),
    "a free variable of scale 0": ((*SCALING, "boxed"), lambda a: first(a, False)),
    "ends that are swapped": (
        (*SCALING, "ends"),
        [array("f8", [2], [1.0, 1.0]), array("f8", [2], [-1.0, 1.0])],
    ),
    "ends that hold no real number": (
        (*SCALING, "ends"),
        [array("f8", [2], ["inf", -1.0]), array("f8", [2], ["inf", 1.0])],
    ),
    "a single end": ((*SCALING, "ends"), [array("f8", [2], [-1.0, -1.0])]),
    "a branch without children": ((*ROOT, "branch"), [0, 0.0]),
    "children without a branch": ((*ROOT, "children"), [1, 1]),
    "a part that is a child twice": (
        (*ROOT[:-1],),
        lambda parts: [
            {**parts[0], "branch": [0, 0.5], "children": [1, 1]},
            {**parts[0], "steps": []},
        ],
    ),
    "one bound for all variables": (("problem", "lower"), array("f8", [], [-2.0])),
    "a short float of more digits": (("problem", "lower"), array("f4", [2], [-2.0, -2.1])),
    "a short float beyond all": (("problem", "lower"), array("f4", [2], [-2.0, -1e39])),
    "an entry of an equality": (
        ("problem", "constraints", 0),
        lambda row: {**row, "entries": [row["polynomial"]]},
    ),
    "an entry of an inequality": (
        ("problem", "constraints", 1),
        lambda row: {**row, "entries": [row["polynomial"]]},
    ),
    "a matrix of one entry": (
        ("problem", "constraints", 1),
        lambda row: {**row, "kind": "PSD", "entries": [row["polynomial"]]},
    ),
    "a word that stands twice": (
        ("problem", "objective"),
        {
            "dimension": 2,
            "words": array("i4", [2, 2], [1, 2, 2, 1]),
            "coefficients": array("f8", [2], [0.5, 0.5]),
        },
    ),
    "a variable outside 1..n": (
        ("problem", "objective"),
        {
            "dimension": 2,
            "words": array("i4", [1, 2], [1, 3]),
            "coefficients": array("f8", [1], [1.0]),
        },
    ),
    "an infinite cutoff": (("certificate", -1, "cutoff"), "inf"),
    "a bound that is no number": (("certificate", -1, "bound"), "nan"),
    "a ray that is a number": (("ray",), 3.0),
    "a ray of one entry": (("ray",), [1.0]),
    "an infinite ray": (("ray",), [1.0, "inf"]),
}
STEPS = {
    "a tightening by an infinite multiplier": lambda linear: changed_in(linear, "value", "inf"),
    "a tightening by a generator out of range": lambda linear: changed_in(linear, "generator", 99),
    "a tightening of another objective": lambda linear: changed_in(linear, "owner", 1),
    "a monomial at an inequality": lambda linear: changed_in(linear, "word", 1),
}


def changed_in(argument: dict[str, Any], name: str, value: Any) -> dict[str, Any]:
    return {**argument, name: first(argument[name], value)}


@pytest.mark.parametrize("name", FORBIDDEN)
def test_what_the_page_forbids_is_malformed(good, tmp_path, name):
    path, value = FORBIDDEN[name]
    found = changed(unneeded(good), path, value)
    if name == "a free variable of scale 0":
        found = changed(found, (*SCALING, "scale"), lambda a: first(a, 0.0))
    assert codes(found, tmp_path) == (2, 2)


def test_trees_whose_parts_are_shared_take_no_time(good, tmp_path):
    """Fifty parts with both children alike would be 2^50 leaves."""
    part = {"steps": [], "argument": None, "empty": False}
    parts = [{**part, "branch": [0, 0.5], "children": [k + 1, k + 1]} for k in range(50)]
    parts.append({**part, "branch": None, "children": []})
    assert codes(changed(unneeded(good), ROOT[:-1], parts), tmp_path) == (2, 2)


def test_words_of_no_rows_are_not_as_wide_as_a_file_says(tmp_path):
    """A few letters of text, and a thousand monomials of forty megabytes each."""
    n = 45
    x = sp.variables(n)
    problem = sp.Problem(sp.total(x[i] * x[j] for i in range(n) for j in range(i)), [], -1, 1)
    (tmp_path / "problem.json").write_text(sp.to_json(problem), encoding="utf-8")
    ends = {"centre": array("f8", [n], [0.0] * n), "scale": array("f8", [n], [2.0] * n)}
    ends |= {"boxed": array("b1", [n], [True] * n), "side": array("i8", [n], [0] * n)}
    none, nothing = array("i8", [0], []), array("f8", [0], [])
    word = array("i4", [0, 9_999_999], [])
    both = {"scaling": {**ends, "ends": None}, "products": array("i8", [0, 2], [])}
    dual = {"generator": none, "word": word, "value": nothing, "owner": none}
    priced = {"multipliers": [], "priced": {"words": word, "values": nothing}}
    for argument in ({"is": "LinearDual", **both, **dual}, {"is": "Identity", **both, **priced}):
        part = {"steps": [], "argument": argument, "empty": False, "branch": None, "children": []}
        proof = {"fingerprint": problem.fingerprint, "bound": -1e6, "cutoff": None}
        proof |= {"correction": 0.0, "assumptions": [], "parts": [part]}
        found = {
            "format": "sparsepop-py",
            "version": 6,
            "is": "certificate",
            "certificate": [proof],
        }
        (tmp_path / "proof.json").write_text(json.dumps(found), encoding="utf-8")
        files = [str(tmp_path / "problem.json"), str(tmp_path / "proof.json")]
        assert (main(["verify", *files]), command.main(files)) == (0, 0)


@pytest.mark.parametrize("place", [0, 1])
def test_points_beyond_all_doubles_are_refused(good, tmp_path, place):
    """Squares overflow: no linear algebra can say more."""
    data = good["result"]["attained"]["x"]["data"]
    values = [1e308 if k == place else v for k, v in enumerate(data)]
    assert codes(changed(good, ("attained", "x", "data"), values), tmp_path) == (1, 1)


def test_free_multipliers_of_inequalities_are_malformed(good, tmp_path):
    groups = good["result"]["certificate"][-1]["parts"][0]["argument"]["multipliers"]
    free = next(k for k, group in enumerate(groups) if len(group["values"]["shape"]) == 2)
    assert groups[free]["generator"]["data"] == [1]
    path = (*GROUP, free, "generator")
    assert codes(changed(unneeded(good), path, array("i4", [1], [2])), tmp_path) == (2, 2)


@pytest.mark.parametrize("name", [None, *STEPS])
def test_steps_that_the_page_forbids_are_malformed(good, tmp_path, name):
    wide = {"centre": array("f8", [2], [0.0, 0.0]), "scale": array("f8", [2], [3.0, 3.0])}
    boxed = {"boxed": array("b1", [2], [True, True]), "side": array("i4", [2], [0, 0])}
    linear = {
        "is": "LinearDual",
        "scaling": {**wide, **boxed, "ends": None},
        "generator": array("i4", [1], [2]),
        "word": array("i4", [1, 1], [0]),
        "value": array("f8", [1], [1.0]),
        "owner": array("i4", [1], [0]),
        "products": array("i4", [0, 2], []),
    }
    step = {
        "is": "Tightening",
        "variable": array("i4", [1], [0]),
        "side": array("i4", [1], [1]),
        "value": array("f8", [1], ["-inf"]),
        "argument": linear if name is None else STEPS[name](linear),
        "uses_cutoff": False,
    }
    found = changed(unneeded(good), (*ROOT, "steps"), [step])
    assert codes(found, tmp_path) == ((0, 0) if name is None else (2, 2))


@pytest.mark.parametrize("lower", [-0.6, "-inf"])
def test_the_bound_of_a_certificate_has_to_be_proved(good, tmp_path, lower, capsys):
    """The result claims what is true, its certificate -0.4, which is too much."""
    found = changed(good, ("lower_bound",), lower)
    assert codes(found, tmp_path) == (0, 0)
    found = changed(found, ("certificate", -1, "bound"), -0.4)
    capsys.readouterr()
    assert codes(found, tmp_path) == (1, 1)
    assert capsys.readouterr().out.count("NOT PROVED") == 2
    with pytest.raises(sp.ProblemError, match=r"result.certificate: found the bound -0.4"):
        sp.read_json(tmp_path / "result.json")


@pytest.mark.parametrize(
    "text",
    [
        "min SQR(x - 1) + Sqr(y); s.t. x >= 2",
        "MIN sqr(x - 1) + y^2; S.T. x >= 2",
        "Minimize sqr(x - 1) + SQR(y) Subject To x >= 2",
    ],
)
def test_capitals_of_keywords_and_functions_change_nothing(tmp_path, text):
    """The least value of (x - 1)^2 + y^2 for x >= 2 is 1; a variable named SQR would give less."""
    problem, certificate = tmp_path / "problem.txt", tmp_path / "certificate.json"
    problem.write_text(text, encoding="utf-8")
    given = sp.parse(text)
    assert of_text(text).names == list(given.names) == ["x", "y"]
    sp.write_json(sp.solve(given).certificate, certificate)
    assert command.main([str(problem), str(certificate)]) == 0


@pytest.mark.parametrize("bound", ["Inf", "-infinity", "NaN"])
def test_infinite_numbers_are_no_variables(bound):
    with pytest.raises(Malformed, match="an infinite number"):
        of_text(f"min x; s.t. x >= {bound}")


@pytest.mark.parametrize("text", ["min x² - 2*x; s.t. x >= 0", "min x³; s.t. x >= 1"])
def test_superscripts_are_part_of_no_name(text):
    with pytest.raises(Malformed):
        of_text(text)


GAMS = """Variables x1,x2,objvar;
Equations e1,e2,e3;
e1.. x1*x1 + x2 - objvar =E= 0;
e2.. x2 =G= 1;
e3.. x1 =G= 2;
x1.lo = -5; x1.up = 5; x2.lo = -5; x2.up = 5;
Model m / all /;
Solve m using NLP minimizing objvar;
"""


@pytest.mark.parametrize(
    ("old", "new", "good"),
    [
        ("/ all /", "/ e3, e1, e2 /", True),
        ("Model m / all /;", "", True),
        ("/ all /", "/ e1, e2 /", False),  # the least value is 1, not 5
        ("/ all /", "/ e1, e2 /, n / all /", False),
        ("objvar;\n", "objvar;\nDisplay x1.l;\n", True),
        ("objvar;\n", "objvar;\nx1.lo = 3;\n", False),
        ("e3.. x1", "e2.. x1", False),
        ("Model m", "x1.l = 3; e1.m = 0; Model m", True),
        ("Solve", "m.limrow = 0; m.reslim = 9; Solve", True),
        ("Solve", "x1.l0 = 3; Solve", False),
        ("objvar =E= 0", "objvar =L= 0", True),
        ("objvar =E= 0", "objvar =G= 0", False),  # objvar would fall without end
        ("x1.lo", "objvar.lo = -9; x1.lo", False),
        ("Variables", "Positive variables objvar; Variables", False),
        ("Equations", "Integer variables x1; Equations", False),
    ],
)
def test_models_hold_all_equations(old, new, good):
    assert len(of_gms(GAMS).constraints) == 2
    text = new.join(GAMS.rsplit(old, 1))
    assert text != GAMS
    if good:
        assert len(of_gms(text).constraints) == 2
        return
    with pytest.raises(Malformed):
        of_gms(text)


@pytest.mark.parametrize("row", ["x1 + 2*x2 - objvar =E= 3", "objvar - x1 - 2*x2 =E= -3"])
@pytest.mark.parametrize(
    ("kind", "word", "sign"),
    [("Binary variables", "minimizing", 1), ("Binaries", "maximizing", -1)],
)
def test_the_objective_of_a_model_is_solved_for_its_variable(row, kind, word, sign):
    """Objectives of maximisations are negated; binaries are 0 or 1."""
    text = f"Variables x1,x2,objvar; {kind} x2;\nEquations e1;\ne1.. {row};\n"
    found = of_gms(f"{text}Model m / all /;\nSolve m using NLP {word} objvar;\n")
    values = {word: int(found.objective.coefficient(word)) for word in ((), (1,), (2,))}
    assert values == {(): -3 * sign, (1,): sign, (2,): 2 * sign}
    assert (found.lower[1], found.upper[1]) == (0, 1)
    (binary,) = found.constraints
    assert binary.equality and set(binary.polynomial.open()) == {(2,), (2, 2)}


def test_names_that_stand_twice_are_malformed(good, tmp_path, capsys):
    path = tmp_path / "result.json"
    text = json.dumps(good)
    path.write_text(text.replace('"ray"', '"ray": null, "ray"', 1), encoding="utf-8")
    assert (main(["verify", str(path)]), command.main([str(path)])) == (2, 2)
    assert "found the name 'ray' twice in one object" in capsys.readouterr().err
    with pytest.raises(sp.ProblemError, match="found NaN, expected a number"):
        sp.from_json(text.replace('"ray": null', '"ray": NaN', 1))
