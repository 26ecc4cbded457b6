"""Certificates as Coq files: ``coqc`` accepts them, and refuses them where something is changed."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from certificate_corpus import FEW, solved
from record_corpus import written

import sparsepop_py as sp
from checker import coq
from checker.certificates.certificate import Certificates
from checker.files import reading

COQC = shutil.which("coqc")
NO_COQ = "Coq is no Python package (Debian: apt-get install coq)"
EXAMPLES = Path(__file__).resolve().parent.parent.parent / "examples" / "problems"


def text_of(found: dict) -> str:
    problem = reading.problem(found["problem"])
    return coq.coq(problem, Certificates(found["certificate"], problem))


def result_of(text: str) -> dict:
    return json.loads(text)["result"]


def accepted(text: str, path: Path) -> bool:
    path.write_text(text)
    done = subprocess.run(
        [COQC, path], capture_output=True, text=True, timeout=900, cwd=path.parent
    )
    return done.returncode == 0 and "Axioms" in done.stdout


def example(name: str) -> dict:
    problem = sp.read_gms(EXAMPLES / f"{name}.gms")
    options = sp.Options(effort="auto", time_limit=60, skip=["linear_tree"])
    return result_of(sp.to_json(sp.solve(problem, options)))


def record() -> dict:
    """The least a1 of a record, as a result of the problem in its units."""
    found = json.loads(written("o-0"))["identification"]
    problem = found["problem"]
    word = {"type": "i4", "shape": [1, 1], "data": [1]}
    one = {"type": "f8", "shape": [1], "data": [1.0]}
    problem["objective"] |= {"words": word, "coefficients": one}
    return {"problem": problem, "certificate": found["ends"][0]["certificate"]}


CASES = {
    "laboratory": lambda: example("laboratory"),
    "quartic": lambda: example("quartic"),
    "pooling": lambda: example("pooling"),
    "record": record,
    "circle": lambda: result_of(solved("known", 6)["circle"]),
    "empty": lambda: result_of(solved("known", 6)["empty"]),
}


@pytest.mark.parametrize("name", CASES)
def test_the_text_states_the_problem_and_the_claim(name):
    """The last theorem names every variable once, and the bound with all its digits."""
    found = CASES[name]()
    text = text_of(found)
    theorem = text[text.index("Theorem proved") : text.index("  intros x1")]
    n = found["problem"]["objective"]["dimension"]
    assert f"forall {' '.join(f'x{v + 1}' for v in range(n))} : R," in theorem
    claim = found["certificate"][-1]["bound"]
    goal = theorem.rsplit("->", 1)[1]
    if claim == "inf":
        assert "False" in goal
    else:
        above, below = claim.as_integer_ratio()
        assert str(abs(above)) in goal and (below == 1 or str(below) in goal)
    assert "Admitted" not in text and "Axiom " not in text


@pytest.mark.parametrize("name", CASES)
@pytest.mark.slow
@pytest.mark.skipif(COQC is None, reason=NO_COQ)
def test_coq_accepts_the_proof(tmp_path, name):
    assert accepted(text_of(CASES[name]()), tmp_path / "proof.v")


@pytest.mark.parametrize("group", ["random", "trees", "switches"])
@pytest.mark.slow
@pytest.mark.skipif(COQC is None, reason=NO_COQ)
def test_coq_accepts_what_is_covered(tmp_path, group):
    covered = 0
    for place, text in enumerate(solved(group, FEW[group]).values()):
        found = result_of(text)
        if found["certificate"] is None:
            continue
        try:
            proof = text_of(found)
        except coq.NotCovered:
            continue
        assert accepted(proof, tmp_path / f"proof{place}.v")
        covered += 1
    assert covered


@pytest.mark.slow
@pytest.mark.skipif(COQC is None, reason=NO_COQ)
def test_coq_refuses_larger_claims_and_other_problems(tmp_path):
    """min x + 2 y on a piece of the circle is -sqrt(5); more is no bound."""
    found = result_of(solved("known", 6)["circle"])
    text = text_of(found)
    assert accepted(text, tmp_path / "true.v")
    found["certificate"][-1]["bound"] = -2.23606797  # the minimum is -2.2360679775
    assert not accepted(text_of(found), tmp_path / "false.v")
    goal = re.search(r"\n  (\S.* <= x1 \+ 2 \* x2)\.\n", text)
    assert goal is not None
    stronger = text.replace(goal.group(1), "-2 <= x1 + 2 * x2")
    assert not accepted(stronger, tmp_path / "stronger.v")


def test_a_call_without_all_files_says_what_is_expected(capsys):
    assert coq.main(["problem.json"]) == 2
    assert "problem.json certificate.json proof.v" in capsys.readouterr().err


def test_the_text_says_which_variable_is_which_and_no_name_ends_a_comment():
    """The x2 of the theorem is another variable than that of the problem."""
    problem = sp.parse("max x3 - x2^2; s.t. x2*x3 >= 0.1; 0 <= x2 <= 1; 0 <= x3 <= 1")
    found = result_of(sp.to_json(sp.solve(problem)))
    assert found["problem"]["names"] == ["x2", "x3"]
    text = text_of(found)
    remarks = text[: text.index("Theorem proved")].splitlines()[-3:]  # beside the theorem
    assert remarks[:2] == ["(* x1 is x2 of the problem *)", "(* x2 is x3 of the problem *)"]
    assert "negative of what is maximised" in remarks[2]
    found["problem"]["names"] = ["*) Axiom bad : False. (*", 'a"']
    assert " bad " not in text_of(found) and 'a"' not in text_of(found)


def test_bad_files_and_folders_are_no_traceback(tmp_path, capsys):
    found = result_of(solved("known", 6)["circle"])
    path = tmp_path / "result.json"
    file = {"format": "sparsepop-py", "version": 6, "is": "result", "result": found}
    path.write_text(json.dumps(file))
    assert coq.main([str(path), str(path), str(tmp_path / "none" / "proof.v")]) == 2
    assert "none" in capsys.readouterr().err
    group = found["certificate"][-1]["parts"][0]["argument"]["multipliers"][0]
    group["generator"]["data"][0] = 99
    path.write_text(json.dumps(file))
    assert coq.main([str(path), str(path), str(tmp_path / "proof.v")]) == 1
    assert capsys.readouterr().out.startswith("Malformed: a generator")


def test_what_is_not_covered_is_said():
    for group, name in (("chains", "chained_singular-8-expanded"), ("matrices", "1")):
        text = solved(group, FEW[group]).get(name)
        text = text or next(iter(solved(group, FEW[group]).values()))
        with pytest.raises(coq.NotCovered):
            text_of(result_of(text))
