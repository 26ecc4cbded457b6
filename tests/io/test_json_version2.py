"""Files that version 2 wrote are read, verified and written as version 3; optima are known."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import sparsepop_py as sp
from sparsepop_py.verified.certificate.steps import Known, Sublevel

FOLDER = Path(__file__).parent / "data" / "version2"

# min -x1x2 + x1^4 + x2^4 is -1/8 at x1 = x2 = 1/2; Haverly's pooling problem has optimum -400
# (Haverly 1978); the disc reaches x1 = 1 at x2 = 0; the generalised Rosenbrock function is 1.
RESULTS = {
    "hill.result.json": -0.125,
    "haverly1.result.json": -400.0,
    "each_region1.result.json": -1.0,
    "gram_rosenbrock.result.json": 1.0,
    "infeasible_farkas.result.json": math.inf,
}


def content(name: str) -> Any:
    return json.loads((FOLDER / name).read_text(encoding="utf-8"))


@pytest.mark.parametrize(("name", "optimum"), RESULTS.items())
def test_results_of_version_2_hold_and_are_written_anew(name: str, optimum: float) -> None:
    result = sp.read_json(FOLDER / name)
    assert result.lower_bound <= optimum <= result.upper_bound
    assert math.isinf(optimum) or result.upper_bound - result.lower_bound <= 4e-4
    for certificate in (result.certificate, *result.certificate.quoted):
        assert certificate.fingerprint.startswith("v2:")
    verdict = result.certificate.verify(result.problem)
    assert verdict.ok and verdict.reason == ""
    text = sp.to_json(result)
    assert json.loads(text)["version"] == 6
    again = sp.from_json(text)
    assert again.lower_bound == result.lower_bound
    assert again.certificate.verify(result.problem).bound == verdict.bound


def test_what_is_quoted_is_about_the_set_with_another_objective() -> None:
    result = sp.read_json(FOLDER / "each_region1.result.json")
    steps = [step for node in result.certificate.root for step in node.box.steps]
    (known,) = [step for step in steps if isinstance(step, Known)]
    x = sp.variables(result.problem.dimension)
    for variable, side, proof in known.bounds:
        about = result.problem.with_objective(side * x[variable])
        assert proof.fingerprint == about.fingerprint
        assert proof.verify(about).ok


def test_a_cutoff_that_was_called_a_level_is_the_same_number() -> None:
    old = content("hill.result.json")["result"]["certificate"][0]
    (level,) = [s["level"] for p in old["parts"] for s in p["steps"] if s["is"] == "Sublevel"]
    root = sp.read_json(FOLDER / "hill.result.json").certificate.root
    (step,) = [s for node in root for s in node.box.steps if isinstance(s, Sublevel)]
    assert step.cutoff == level


def test_a_certificate_alone_is_recognised_by_its_old_fingerprint() -> None:
    problem = sp.read_json(FOLDER / "circle.problem.json")
    certificate = sp.read_json(FOLDER / "circle.certificate.json")
    assert (
        certificate.fingerprint
        == content("circle.certificate.json")["certificate"][0]["fingerprint"]
    )
    verdict = certificate.verify(problem)
    assert verdict.ok
    assert "written by an older version" in verdict.reason
    assert certificate.bound <= verdict.bound <= -math.sqrt(5)  # the minimum of x1 + 2 x2
    today = replace(certificate, fingerprint=problem.fingerprint)
    assert today.verify(problem) == (True, verdict.bound, "")
    again = sp.from_json(sp.to_json(certificate))
    assert again.verify(problem) == verdict


def test_an_old_fingerprint_of_another_problem_is_refused_and_says_its_age() -> None:
    problem = sp.read_json(FOLDER / "circle.problem.json")
    certificate = sp.read_json(FOLDER / "circle.certificate.json")
    other = sp.Problem(problem.objective, problem.constraints, -2, [2, 2.5])
    verdict = certificate.verify(other)
    assert not verdict.ok and verdict.bound == -math.inf
    assert "another problem" in verdict.reason and "older version" in verdict.reason


@pytest.mark.parametrize("number", [0, 1])
def test_an_old_result_whose_fingerprint_fits_no_problem_is_refused(number: int) -> None:
    found = content("each_region1.result.json")
    found["result"]["certificate"][number]["fingerprint"] = "0" * 64
    if number:  # the last is about the problem itself
        with pytest.raises(sp.ProblemError, match=r"result.certificate: .*another problem"):
            sp.from_json(json.dumps(found))
    else:  # what is quoted is proved again, whatever it is called
        result = sp.from_json(json.dumps(found))
        assert result.certificate.quoted[0].fingerprint == "0" * 64
        assert result.certificate.verify(result.problem).ok


def test_steps_that_were_left_out_have_new_names() -> None:
    assert sp.read_json(FOLDER / "haverly1.result.json").options.skip[-1] == "obbt_sdp"
    found = content("hill.result.json")
    found["result"]["options"]["skip"] = ["narrow", "cutoff"]
    assert sp.from_json(json.dumps(found)).options.skip == ("obbt_lp", "cutoff")


@pytest.mark.parametrize("version", [0, 1, 7, 2.0, 4.0, "4", True, None, [4]])
def test_other_versions_are_refused(version: Any) -> None:
    found = content("circle.problem.json") | {"version": version}
    with pytest.raises(
        sp.ProblemError, match=r"JSON.version: found .*, expected one of the integers 2, 3, 4, 5, 6"
    ):
        sp.from_json(json.dumps(found))


def test_old_names_are_no_names_of_version_3() -> None:
    for name in ("hill.result.json", "each_region1.result.json"):
        found = content(name) | {"version": 3}
        with pytest.raises(sp.ProblemError, match=r"found nothing, expected a value"):
            sp.from_json(json.dumps(found))
