"""Files in the repository are read, verified and written anew; optima are known."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.verified.certificate.steps import Known

FOLDER = Path(__file__).parent / "data" / "stored"

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
def test_stored_results_hold_and_are_written_anew(name: str, optimum: float) -> None:
    result = sp.read_json(FOLDER / name)
    assert result.lower_bound <= optimum <= result.upper_bound
    assert math.isinf(optimum) or result.upper_bound - result.lower_bound <= 4e-4
    verdict = result.certificate.verify(result.problem)
    assert verdict.ok and verdict.reason == ""
    text = sp.to_json(result)
    assert json.loads(text)["version"] == 7
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


def test_a_certificate_alone_holds_for_its_problem_only() -> None:
    problem = sp.read_json(FOLDER / "circle.problem.json")
    certificate = sp.read_json(FOLDER / "circle.certificate.json")
    verdict = certificate.verify(problem)
    assert verdict.ok and certificate.bound <= verdict.bound <= -math.sqrt(5)  # of x1 + 2 x2
    other = sp.Problem(problem.objective, problem.constraints, -2, [2, 2.5])
    verdict = certificate.verify(other)
    assert not verdict.ok and verdict.bound == -math.inf and "another problem" in verdict.reason


@pytest.mark.parametrize("number", [0, 1])
def test_a_result_whose_fingerprint_fits_no_problem_is_refused(number: int) -> None:
    found = content("each_region1.result.json")
    found["result"]["certificate"][number]["fingerprint"] = "0" * 64
    if number:  # the last is about the problem itself
        with pytest.raises(sp.ProblemError, match=r"result.certificate: .*another problem"):
            sp.from_json(json.dumps(found))
    else:  # what is quoted is proved again, whatever it is called
        result = sp.from_json(json.dumps(found))
        assert result.certificate.quoted[0].fingerprint == "0" * 64
        assert result.certificate.verify(result.problem).ok


@pytest.mark.parametrize("version", [0, 1, 2, 8, 4.0, "4", True, None, [4]])
def test_other_versions_are_refused(version: Any) -> None:
    found = content("circle.problem.json") | {"version": version}
    with pytest.raises(
        sp.ProblemError, match=r"JSON.version: found .*, expected one of the integers 3, 4, 5, 6, 7"
    ):
        sp.from_json(json.dumps(found))


def test_points_that_were_polished_are_kept_to_the_last_digit() -> None:
    """min x over x^2 == 2: a point by Krawczyk's test is proved again as it is."""
    x = sp.variables(1)[0]
    for square in (2, 3, 5, 7, 10):
        result = sp.solve(sp.Problem(x, [x**2 == square], -10, 10))
        assert result.attained is not None and result.attained.proof == "krawczyk"
        text = sp.to_json(result)
        assert sp.to_json(sp.from_json(text)) == text
        again = result.attained.recheck(result.problem)
        assert again is not None and again.value == result.attained.value
        assert np.array_equal(again.x, result.attained.x)


@pytest.mark.parametrize("field", ["lower_bound", "upper_bound"])
def test_bounds_are_numbers(field: str) -> None:
    x = sp.variables(1)[0]
    found = json.loads(sp.to_json(sp.solve(sp.Problem(x**2 - x, lower=-1, upper=1))))
    found["result"][field] = "nan"
    with pytest.raises(sp.SparsePOPError, match=f"result.{field}: found 'nan'"):
        sp.from_json(json.dumps(found))


def test_words_may_be_longer_integers() -> None:
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, [x**2 + y**2 <= 1])
    text = sp.to_json(problem).replace('"i4"', '"i8"')
    assert '"i8"' in text and sp.from_json(text).fingerprint == problem.fingerprint
