"""What an identification rests on is compared or printed: forged files, by hand."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import setid
from checker.arithmetic import interval as iv
from checker.arithmetic.polynomial import INF
from checker.command import main
from checker.records import driven
from checker.records.record import Identification
from checker.records.stability import in_disc
from checker.result import NotProved
from setid.result.json_ import certificate_text


def array(data: list[Any], kind: str = "f8") -> dict[str, Any]:
    return {"type": kind, "shape": list(np.shape(data)), "data": np.ravel(data).tolist()}


def polynomial(n: int, words: list[list[int]], values: list[float]) -> dict[str, Any]:
    word = {"type": "i4", "shape": [len(words), len(words[0]) if words else 1]}
    flat = [letter for letters in words for letter in letters]
    return {"words": word | {"data": flat}, "coefficients": array(values), "dimension": n}


def row(n: int, words: list[list[int]], values: list[float], kind: str = "ZERO") -> dict[str, Any]:
    found = {"polynomial": polynomial(n, words, values), "kind": kind, "name": "", "entries": []}
    return found


def problem(n: int, rows: list[Any], low: list[Any], high: list[Any]) -> dict[str, Any]:
    ends = {"lower": array([0.0] * n) | {"data": low}, "upper": array([0.0] * n) | {"data": high}}
    objective = polynomial(n, [[1]], [1.0])
    more = {"names": ["x"] * n, "squares": [], "sense": "min"}
    return {"objective": objective, "constraints": rows} | ends | more


def proof(bound: Any) -> list[dict[str, Any]]:
    step = {"is": "Propagation", "sweeps": 9, "uses_cutoff": False}
    part = {"steps": [step], "argument": None, "empty": False, "branch": None, "children": []}
    head = {"fingerprint": "v2:x", "bound": bound, "cutoff": None, "correction": 0.0}
    return [head | {"assumptions": [], "parts": [part]}]


def first_order(**changes: Any) -> dict[str, Any]:
    shape = {"na": [[1]], "nb": [[1]], "nk": [[1]], "common_denominator": False}
    rest = {"is": "TransferFunction", "offset": False, "initial": "free", "form": "direct"}
    return shape | rest | changes


def stated(structure: Any, names: list[str], about: dict[str, Any], **more: Any) -> dict[str, Any]:
    n, p = about["lower"]["shape"][0], len(names)
    known = {
        "structure": structure,
        "assumptions": [],
        "parameters": names,
        "variables": [["theta", 0, k] for k in range(p)],
        "units": [1.0] * n,
        "problem": about,
        "rows": [None] * len(about["constraints"]),
        "given": [["-inf"] * p, ["inf"] * p],
        "box": None,
        "driven": None,
        "fewer_priors": None,
        "ends": [],
        "linear": [],
        "intervals": [interval(name, "-inf", "inf") for name in names],
    }
    return known | more


def interval(name: str, low: Any, high: Any, inner: Any = None) -> dict[str, Any]:
    return {"name": name, "outer": [low, high], "inner": inner, "status": "x"}


def record(u: list[Any], y: list[Any], output: float, ranges: Any = None) -> dict[str, Any]:
    zeros = [[0.0] * len(y)]
    noise = {"output": [[output] * len(y)], "input": zeros, "equation": zeros}
    found = {"u": [u], "y": [y], "starts": [0], "ranges": {"u": None, "y": ranges}}
    return {"record": found, "noise": noise}


def checked(tmp_path: Path, body: dict[str, Any], capsys: Any) -> tuple[int, str]:
    path = tmp_path / "claim.json"
    file = {"format": "setid", "version": 10, "is": "identification", "identification": body}
    path.write_text(json.dumps(file))
    code = main([str(path)])
    return code, capsys.readouterr().out


# ---- stability -----------------------------------------------------------------------------

GROWING = record([1.0, 0, 0, 0, 0, 0], [0, 1.0, 2.0, 4.0, 8.0, 16.0], 1e-3)  # a1 is -2
GIVEN = "given: the poles of output 1 lie in the closed unit disc"


def denominators(stable: bool = True) -> dict[str, Any]:
    empty = ("children", "edge", "weights", "family", "powers", "minors")
    step = {"is": "Denominators", "output": 1, "stable": stable, "free": [1], "multipliers": []}
    step |= {"nodes": [dict.fromkeys(empty, [])], "limits": []}
    return {"lower": [-1.0, "-inf"], "upper": [1.0, "inf"], "kind": "x", "steps": [step]}


@pytest.mark.parametrize("inside", [False, True])
def test_stability_is_printed_wherever_it_is_used(inside, tmp_path, capsys) -> None:
    about = problem(2, [], ["-inf"] * 2, ["inf"] * 2)
    ends = [interval("a1", -1.0, 1.0), interval("b1", "-inf", "inf")]
    body = stated(first_order(), ["a1", "b1"], about, intervals=ends)
    own = body | {"box": denominators()}
    code, text = checked(
        tmp_path, GROWING | (body | {"fewer_priors": own} if inside else own), capsys
    )
    assert code == 0 and GIVEN in text and "proved: a1 in [-1.0, 1.0]" in text


def test_points_with_other_poles_attain_nothing(tmp_path, capsys) -> None:
    n, y = 8, GROWING["record"]["y"][0]
    rows, origins = [], []
    for k in range(1, 6):  # y - eta + a1 (y - eta) - b1 u == 0
        words = [[0, 0], [0, 3 + k], [0, 1], [1, 2 + k], [0, 2]]
        values = [y[k], -1.0, y[k - 1], -1.0, -GROWING["record"]["u"][0][k - 1]]
        kept = [i for i in range(5) if values[i]]
        rows.append(row(n, [words[i] for i in kept], [values[i] for i in kept]))
        origins.append(["y1", k])
    about = problem(n, rows, ["-inf"] * 2 + [-1e-3] * 6, ["inf"] * 2 + [1e-3] * 6)
    none = array([], "i8")
    point = {"x": array([-2.0, 1.0] + [0.0] * 6), "value": "inf", "radius": 0.0, "proof": "exact"}
    ends = [{"certificate": None, "attained": point | {"rows": none, "solved": none}}]
    names = ["a1", "b1"]
    claims = [interval("a1", -1.0, 1.0, [-2.0, -2.0]), interval("b1", "-inf", "inf", [1.0, 1.0])]
    body = stated(first_order(), names, about, rows=origins, ends=ends, intervals=claims)
    body["variables"] += [["eta", 1, k] for k in range(6)]
    code, text = checked(tmp_path, GROWING | body | {"box": denominators()}, capsys)
    assert code == 1 and "intervals[0].inner: it is not shown that the poles" in text
    claims[0]["outer"] = ["-inf", "inf"]
    code, text = checked(tmp_path, GROWING | body, capsys)
    assert code == 0 and GIVEN not in text and "attained from -2.0 to -2.0" in text


def test_zeros_in_the_disc_are_found_as_numpy_finds_them() -> None:
    rng = np.random.default_rng(1)
    seen = {True: 0, False: 0}
    for _ in range(400):
        n = int(rng.integers(1, 5))
        a = np.round(rng.uniform(-1, 1, n) * [2.0, 1.5, 1.0, 0.8][:n], 3)
        size = np.abs(np.roots([1.0, *a])).max()
        exact = [iv.around(v, v) for v in a.tolist()]
        wide = [iv.around(v - 2**-13, v + 2**-13) for v in a.tolist()]
        if abs(size - 1) > 1e-9:
            assert in_disc(exact) == (size < 1)
        seen[in_disc(exact)] += 1
        assert not in_disc(wide) or size < 1
    assert min(seen.values()) > 50
    assert in_disc([]) and in_disc([iv.around(-1, -1)])
    assert not in_disc([iv.around(-1, 1.125)])
    assert not in_disc([iv.around(0.5, 0.5), iv.around(-0.6, -0.1)])  # at -0.6 one is beyond -1
    integrator = np.poly([1.0, 0.5, 0.25, 0.75])[1:].tolist()  # whole multiples of 1/64
    assert in_disc([iv.around(v, v) for v in integrator])
    assert not in_disc([iv.ONE, iv.around(-0.5, 0.25)])  # at -1/2 a zero is beyond -1


def test_stability_of_rows_with_driving_offsets_is_said(monkeypatch) -> None:
    for name in ("check_structures", "check_question"):
        monkeypatch.setattr(driven, name, lambda *_: None)
    inner = SimpleNamespace(check=lambda: None, taken=["rows"], stable={1}, empty=True)
    structure = SimpleNamespace(outputs=range(0))
    about = SimpleNamespace(structure=structure, taken=[], stable=set(), names=["a"])
    assert driven.bounded_by(inner, about, [[0], [1]]) == [[INF], [-INF]]
    assert about.stable == {1} and about.taken == ["rows"]


@pytest.mark.parametrize(("adds", "c"), [(True, [2, 4]), (False, [1, 1])])
def test_an_offset_of_an_output_is_that_of_the_equation_divided(monkeypatch, adds, c) -> None:
    """d = 1 and (1 + a)(1 + b) between 1/4 and 1/2; an offset that drives already is d itself."""
    for name in ("check_structures", "check_question"):
        monkeypatch.setattr(driven, name, lambda *_: None)
    ends = [[-0.5, 0.0], [-0.5, -0.5], [1.0, 1.0]]
    inner = SimpleNamespace(
        check=lambda: None,
        taken=[],
        stable=set(),
        empty=False,
        got=SimpleNamespace(intervals=[SimpleNamespace(outer=pair) for pair in ends]),
    )
    structure = SimpleNamespace(
        outputs=(1,),
        offset=lambda _: [SimpleNamespace(parameters=("c",))],
        adds_offset=lambda _: adds,
        denominators=lambda _: [["a"], ["b"]],
    )
    about = SimpleNamespace(structure=structure, taken=[], stable=set(), names=["a", "b", "c"])
    low, high = driven.bounded_by(inner, about, [[-9] * 3, [9] * 3])
    assert (low[:2], high[:2]) == ([-0.5, -0.5], [0, -0.5])
    near = Fraction(1, 10**9)
    assert c[0] - near <= low[2] <= c[0] and c[1] <= high[2] <= c[1] + near


# ---- names, ranges, noise --------------------------------------------------------------------


def test_two_unknowns_of_one_name_are_malformed(tmp_path, capsys) -> None:
    about = problem(2, [], ["-inf"] * 2, ["inf"] * 2)
    shape = first_order(na=[[0]], nb=[[0]], nk=[[0]], offset=True, form="auto")
    body = stated(shape, ["c"], about)
    for group, code in (("c", 0), ("other", 0)):
        names = [["theta", 0, 0], [group, 0, 0]]
        assert (
            checked(tmp_path, record([0.0], [1.5], 9.0) | body | {"variables": names}, capsys)[0]
            == code
        )
    two = first_order(na=[[0], [0]], nb=[[0], [0]], nk=[[0], [0]], offset=True, form="auto")
    both = record([0.0], [1.5], 9.0)
    both["record"]["y"] *= 2
    both["noise"]["output"], both["noise"]["equation"] = [[9.0]] * 2, [[0.0]] * 2
    wide = problem(3, [], ["-inf"] * 3, ["inf"] * 3)
    body = stated(two, ["c[1]", "c[2]"], wide)
    names = [["theta", 0, 0], ["theta", 0, 1], ["c", 0, 0]]
    code, text = checked(tmp_path, both | body | {"variables": names}, capsys)
    assert code == 2 and "two unknowns of one name" in text


@pytest.mark.parametrize("missing", [True, False])
def test_equations_without_rows_are_counted(missing, tmp_path, capsys) -> None:
    """y = 1, ?, 1 at rest in the input is a1 = 1 or -1; the file attains 0 without these rows."""
    about = problem(2, [], [-2.0, "-inf"], [2.0, "inf"])
    none = array([], "i8")
    point = {"x": array([0.0, 1.0]), "value": "inf", "radius": 0.0, "proof": "exact"}
    ends = [{"certificate": None, "attained": point | {"rows": none, "solved": none}}]
    claims = [interval("a1", -2.0, 2.0, [0.0, 0.0]), interval("b1", "-inf", "inf", [1.0, 1.0])]
    given = [[-2.0, "-inf"], [2.0, "inf"]]
    body = stated(first_order(), ["a1", "b1"], about, ends=ends, intervals=claims, given=given)
    known = record([0.0] * 3, [1.0, None if missing else -1.0, 1.0], 0.0)
    code, text = checked(tmp_path, known | body, capsys)
    line = "left out: 2 equations with missing samples, which ends that are attained need not"
    assert (code == 0) == (line in text) == ("attained from 0.0" in text) == missing
    assert missing or (code == 1 and "intervals[0].inner: no point is shown to explain" in text)


def test_ranges_of_many_missing_samples_are_rounded_outwards_and_short() -> None:
    """y(k + 1) = -a1 y(k) + b1 u(k): with a1 in [-0.9, -0.3], b1 in [0.1, 2] and u = 1/3 > 0."""
    samples, u = 400, Fraction(1 / 3)
    known = record([1 / 3] * samples, [1.0] + [None] * (samples - 1), 0.0)
    given = [[-0.9, 0.1], [-0.3, 2.0]]
    body = stated(first_order(), ["a1", "b1"], problem(2, [], *given), given=given)
    about = Identification(known | body)
    low = high = Fraction(1)
    for k in range(1, samples):
        low, high = Fraction(0.3) * low + Fraction(0.1) * u, Fraction(0.9) * high + 2 * u
        ends = iv.exactly(about._known("y", 1, k))
        assert ends[0] <= low and high <= ends[1]
        assert max(low - ends[0], ends[1] - high) < Fraction(1, 2**1000)
        assert max(end.denominator.bit_length() for end in ends) < 1200


@pytest.mark.parametrize("missing", [True, False])
def test_ranges_of_missing_samples_are_printed(missing, tmp_path, capsys) -> None:
    about = problem(1, [], ["-inf"], ["inf"])
    shape = first_order(na=[[0]], nk=[[0]], form="auto")
    body = stated(shape, ["b0"], about)
    known = record([1.0, 1.0], [None if missing else 0.25, 5.0], 100.0, [[0.0, 0.5]])
    code, text = checked(tmp_path, known | body, capsys)
    line = "given: each missing sample of y1 in [0.0, 0.5]"
    assert code == 0 and (line in text) == missing


def test_rows_of_other_structures_leave_noise_its_bounds(tmp_path, capsys) -> None:
    """1 - eta - p == 0 with noise of 0.1, of which the problem leaves nothing."""
    known = record([0.0], [1.0], 0.1)
    shape = {"is": "rows", "text": "Mine(order=1)"}
    for size, low, high in ((0.0, 1.0, 1.0), (0.1, 0.75, 1.25)):
        about = problem(
            2, [row(2, [[0], [2], [1]], [1.0, -1.0, -1.0])], ["-inf", -size], ["inf", size]
        )
        ends = [{"certificate": proof(v), "attained": None} for v in (low, -high)]
        body = stated(shape, ["p"], about, ends=ends, intervals=[interval("p", low, high)])
        body |= {"variables": [["theta", 0, 0], ["eta", 1, 0]], "rows": [["y1", 0]]}
        code, text = checked(tmp_path, known | body, capsys)
        assert code == (3 if size else 1)  # 3: rows are taken as given
    assert "proved: p in [0.75, 1.25]" in text


def test_parameters_in_matrices_occur_in_rows(tmp_path, capsys) -> None:
    """|p| <= 1 as a cone; bounds of the problem hold p at 5."""
    cone = row(1, [[0]], [1.0], "SECOND_ORDER")
    cone["entries"] = [polynomial(1, [[0]], [1.0]), polynomial(1, [[1]], [1.0])]
    about = problem(1, [cone], [5.0], [5.0])
    ends = [{"certificate": proof("inf"), "attained": None}] * 2
    body = stated({"is": "rows", "text": "Mine"}, ["p"], about, ends=ends)
    body |= {"intervals": [interval("p", "inf", "-inf")], "rows": [["y1", 0]]}
    code, text = checked(tmp_path, record([0.0], [1.0], 0.0) | body, capsys)
    assert code == 1 and "leaves out values of p" in text


# ---- offsets that drive ----------------------------------------------------------------------


def test_offsets_of_equations_are_not_divided(tmp_path, capsys) -> None:
    """Of one denominator the form "auto" has the offset of the equation, as "driven" has."""
    u = [1.0, -1.0, 2.0, 0.0, 1.0, -2.0, 1.0, 0.5]
    y = [0.0]
    for k in range(1, 8):
        y.append(0.5 * y[-1] + u[k - 1] + 1.0)
    regressors = np.c_[y[:-1], -np.array(u[:-1]), -np.ones(7)]
    inverse = np.linalg.pinv(regressors)
    centre = -inverse @ y[1:]
    step = {"is": "LeftInverse", "rows": [[1, k] for k in range(1, 8)], "inverse": inverse.tolist()}
    step |= {"centre": centre.tolist(), "radius": [0.2] * 3}
    low, high = (centre - 0.21).tolist(), (centre + 0.21).tolist()
    n = 11
    about = problem(n, [], ["-inf"] * 3 + [-1e-3] * 8, ["inf"] * 3 + [1e-3] * 8)
    names = ["a1", "b1", "c"]
    shape = first_order(offset=True)
    claims = [interval(*one) for one in zip(names, low, high, strict=True)]
    box = {"lower": low, "upper": high, "kind": "ParameterBox", "steps": [step]}
    inner = stated(shape | {"form": "driven"}, names, about, box=box, intervals=claims)
    variables = inner["variables"] + [["eta", 1, k] for k in range(8)]
    inner["variables"] = variables
    wrong = [*claims[:2], interval("c", 1.1, 6.0)]
    outer = stated(shape | {"form": "auto"}, names, about, driven=inner, intervals=wrong)
    code, text = checked(tmp_path, record(u, y, 1e-3) | outer | {"variables": variables}, capsys)
    assert code == 1 and "the same offset" in text


# ---- rest ------------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [{"equation": 0.01}, {"output": 0.01, "relative": True}, {}])
def test_records_that_begin_at_rest_have_rows_of_numbers(noise, tmp_path, capsys) -> None:
    u = np.array([0.0, 0, 0, 0, 1, -1, 2, 0.5, 1, 0])
    y = np.zeros(10)
    for k in range(1, 10):
        y[k] = 0.5 * y[k - 1] + u[k - 1]
    model = setid.TransferFunction(1, 1, 1)
    options = setid.Options(time_limit=10, progress=False)
    found = setid.identify(setid.IOData(u, y), model, setid.Noise(**noise), (), options)
    path = tmp_path / "rest.json"
    path.write_text(certificate_text(found))
    assert main([str(path)]) == 0
    assert "proved: a1 in" in capsys.readouterr().out
    file = json.loads(path.read_text())
    body = file["identification"]
    place = next(
        i
        for i, c in enumerate(body["problem"]["constraints"])
        if set(c["polynomial"]["words"]["data"]) <= {0}
    )
    n = body["problem"]["objective"]["dimension"]
    body["problem"]["constraints"][place]["polynomial"] = polynomial(n, [[0]], [-1.0])
    with pytest.raises(NotProved, match="another constant"):
        Identification(body).check_rows()
