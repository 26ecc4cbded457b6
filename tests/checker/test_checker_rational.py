"""The second checker on problems with ratios: agreement, and false claims."""

from __future__ import annotations

import copy
import functools
import json
import re

import pytest
from test_checker_schema import SCHEMA, valid

import sparsepop_py as sp
from checker import command, rational
from checker.files import reading
from checker.result import NotProved

TEXTS = {
    "level": "min 3 - 2*x/(1 + x^2); s.t. x^2 <= 4",
    "free": "min x/(1 + x^2)",
    "sum": "min x/(2 + x^2) + y/(3 + x*y); s.t. x/(y + 3) >= -1; x^2 + y^2 <= 1",
    "negative": "max x/(y - 5); s.t. x^2 <= 4; y^2 <= 4",
    "rows": "min x + y; s.t. x/(1+y^2) >= 1; 1/(1+x^2) + 1/(1+y^2) >= 0.5; x^2 <= 9; y^2 <= 9",
    "empty base": "min x/(y - 5); s.t. x + y >= 10; x^2 <= 4; y^2 <= 4",
    "empty": "min x; s.t. x/(1 + y^2) >= 3; x^2 <= 4; y^2 <= 4",
}


@functools.cache
def written(name: str) -> str:
    return sp.to_json(sp.solve(sp.parse(TEXTS[name])))


def found(name: str) -> dict:
    return json.loads(written(name))["rational_result"]


@pytest.mark.parametrize("name", TEXTS)
def test_the_checkers_agree(name):
    result = sp.from_json(written(name))
    lines = rational.check_rational_result(found(name))
    if result.status is sp.Status.INFEASIBLE:
        assert lines == ["proved: no feasible point"]
        return
    assert lines == [
        f"proved: objective >= {result.lower_bound!r}",
        f"proved: objective <= {result.upper_bound!r} is attained",
    ]


@pytest.mark.parametrize("name", TEXTS)
def test_results_are_valid(name):
    assert valid(json.loads(written(name)), SCHEMA)
    problem = json.loads(sp.to_json(sp.from_json(written(name)).problem))
    assert valid(problem, SCHEMA)


def test_the_program_takes_problems_and_certificates(tmp_path, capsys):
    result = sp.from_json(written("sum"))
    sp.write_json(result.problem, tmp_path / "problem.json")
    sp.write_json(result.certificate, tmp_path / "certificate.json")
    arguments = [str(tmp_path / "problem.json"), str(tmp_path / "certificate.json")]
    assert command.main(arguments) == 0
    assert capsys.readouterr().out == f"proved: objective >= {result.lower_bound!r}\n"
    other = sp.parse(TEXTS["sum"].replace("2 + x^2", "1 + x^2"))
    sp.write_json(other, tmp_path / "problem.json")
    assert command.main(arguments) == 1
    (tmp_path / "result.json").write_text(written("negative"))
    assert command.main([str(tmp_path / "result.json")]) == 0
    assert "negative of what is maximised" in capsys.readouterr().out
    assert command.main([str(tmp_path / "certificate.json")]) == 2


DAMAGE = {
    "a larger lower bound": ("sum", lambda r: r.update(lower_bound=r["lower_bound"] + 1e-3)),
    "a smaller upper bound": ("sum", lambda r: r.update(upper_bound=r["upper_bound"] - 1e-3)),
    "a level's larger bound": ("level", lambda r: r.update(lower_bound=r["lower_bound"] + 1e-3)),
    "a level's smaller value": ("level", lambda r: r.update(upper_bound=r["upper_bound"] - 1e-3)),
    "a larger level": ("level", lambda r: r["certificate"].update(level=-0.5)),
    "a sign turned around": (
        "negative",
        lambda r: r["certificate"]["ranges"][0].update(sign=1),
    ),
    "denominators claimed larger": (
        "sum",
        lambda r: r["certificate"]["ranges"][0]["below"][-1].update(bound=2.5),
    ),
    "no certificate": ("sum", lambda r: r["certificate"].update(certificate=None)),
    "another numerator": (
        "sum",
        lambda r: r["problem"]["objective"]["ratios"][0][0]["coefficients"]["data"].__setitem__(
            0, 3.0
        ),
    ),
    "another row": (
        "rows",
        lambda r: r["problem"]["rational_constraints"][1]["expression"]["whole"]["coefficients"][
            "data"
        ].__setitem__(0, -1.5),
    ),
    "a row less": ("rows", lambda r: r["problem"]["rational_constraints"].pop(0)),
    "feasible called empty": ("sum", lambda r: r.update(status="INFEASIBLE", lower_bound="inf")),
    "bounded called unbounded": ("sum", lambda r: r.update(status="UNBOUNDED")),
    "no sign for one": ("sum", lambda r: r["certificate"]["ranges"].pop()),
    "a level for a sum": ("sum", lambda r: r["certificate"].update(level=0.0)),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_false_claims_are_refused(name):
    group, change = DAMAGE[name]
    result = copy.deepcopy(found(group))
    rational.check_rational_result(result)
    change(result)
    with pytest.raises(NotProved):
        rational.check_rational_result(result)


MALFORMED = {
    "a constant denominator": lambda r: r["problem"]["objective"]["ratios"][0].__setitem__(
        1, r["problem"]["objective"]["whole"]
    ),
    "a denominator twice": lambda r: r["problem"]["objective"]["ratios"].append(
        r["problem"]["objective"]["ratios"][0]
    ),
    "a cone": lambda r: r["problem"]["rational_constraints"][0].update(kind="PSD"),
    "a third part": lambda r: r["problem"]["objective"]["ratios"][0].append(1),
    "another sign": lambda r: r["certificate"]["ranges"][0].update(sign=0),
    "another status": lambda r: r.update(status="FINE"),
}


@pytest.mark.parametrize("name", MALFORMED)
def test_malformed_files_are_refused(name):
    result = copy.deepcopy(found("sum"))
    MALFORMED[name](result)
    with pytest.raises(reading.Malformed):
        rational.check_rational_result(result)


def test_versions_belong_to_kinds(tmp_path):
    path = tmp_path / "result.json"
    path.write_text(re.sub('"version":[4-7]', '"version":3', written("sum")))
    assert command.main([str(path)]) == 2
    path.write_text(re.sub('"version":7', '"version":4', sp.to_json(sp.parse("min x"))))
    assert command.main([str(path)]) == 2
