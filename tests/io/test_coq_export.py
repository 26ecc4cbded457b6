"""``certificate.to_coq``: what Coq accepts, and what is refused with a reason."""

from __future__ import annotations

import copy
import pickle
import shutil
import subprocess
from pathlib import Path

import pytest

import sparsepop_py as sp


def quartic() -> sp.Problem:
    """(x^2 - 1)^2 on [-2, 2], whose least value is 0."""
    (x,) = sp.variables(1)
    return sp.Problem(x**4 - 2 * x**2 + 1, lower=-2, upper=2)


def test_a_result_knows_the_problem_of_its_certificate(tmp_path: Path) -> None:
    result = sp.solve(quartic())
    for number, again in enumerate(
        (
            result,
            pickle.loads(pickle.dumps(result)),
            copy.deepcopy(result),
            sp.from_json(sp.to_json(result)),
        )
    ):
        path = tmp_path / f"proof{number}.v"
        again.certificate.to_coq(path)
        assert "Theorem proved" in path.read_text()


def test_a_certificate_alone_asks_for_its_problem(tmp_path: Path) -> None:
    certificate = sp.from_json(sp.to_json(sp.solve(quartic()).certificate))
    with pytest.raises(sp.ProblemError, match="to_coq: found no problem"):
        certificate.to_coq(tmp_path / "proof.v")
    certificate.to_coq(tmp_path / "proof.v", quartic())
    (x,) = sp.variables(1)
    with pytest.raises(sp.ProblemError, match="does not hold for this problem"):
        certificate.to_coq(tmp_path / "other.v", sp.Problem(x, lower=0, upper=1))
    assert not (tmp_path / "other.v").exists()


def test_what_is_not_covered_is_named(tmp_path: Path) -> None:
    """Without bounds the proof uses a sublevel set."""
    (x,) = sp.variables(1)
    result = sp.solve(sp.Problem(x**4 - 3 * x))
    assert result.certificate is not None
    with pytest.raises(sp.ProblemError, match="to_coq: NotCovered"):
        result.certificate.to_coq(tmp_path / "proof.v")


@pytest.mark.slow
def test_coq_accepts_the_file(tmp_path: Path) -> None:
    coqc = shutil.which("coqc")
    if coqc is None:
        pytest.skip("coqc is not installed")
    sp.solve(quartic()).certificate.to_coq(tmp_path / "proof.v")
    done = subprocess.run([coqc, "proof.v"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
