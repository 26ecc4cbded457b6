"""What verifying loads: a fresh interpreter that is given stored evidence, and nothing else."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import setid

VERIFYING = """
import pickle, sys
from pathlib import Path
import setid

evidence, data = pickle.loads(Path(sys.argv[1]).read_bytes())
verdict = setid.verify(evidence, data)
assert verdict, verdict.reason
packages = {"clarabel", "highspy", "cvxpy", "networkx", "sympy", "matplotlib", "control"}
engine = ("solvers", "lp", "conic", "relaxation", "presolve", "local_search", "bounding")
engine += ("tightening", "branch_and_bound", "strategy", "pipeline")
front = ("identify", "consistency", "select", "feasible_set", "feasible_points", "minimum_noise")
front += ("identifiability", "bands", "export", "plots", "result")
rooms = [f"sparsepop_py.{room}" for room in engine] + [f"setid.{room}" for room in front]
print(
    *(
        name
        for name in sys.modules
        if name.split(".")[0] in packages
        or name.startswith(("scipy.optimize", "scipy.signal", "scipy.io"))
        or name.startswith(tuple(rooms))
    )
)
"""
ROOT = Path(setid.__file__).resolve().parent.parent
SMALL = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])


def loaded(tmp_path: Path, code: str, *arguments: str) -> list[str]:
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def identified(kind: str) -> setid.Identification:
    first = setid.TransferFunction(1, 1)
    if kind == "linear":
        return setid.identify(SMALL, first, setid.Noise(equation=0.5))
    if kind == "empty":
        return setid.identify(SMALL, first, setid.Noise(equation=0.1))
    if kind == "bilinear":
        return setid.identify(SMALL, first, setid.Noise(output=0.5))
    if kind == "unbounded":
        data = setid.IOData([1, 0, -1, 1, 0, 1], [2.1, 0, -1.9, 2, 0.1, 2])
        return setid.identify(data, setid.TransferFunction(1, 2), setid.Noise(output=0.2))
    u = np.linspace(-1.0, 1.0, 9)
    model = setid.Hammerstein(setid.TransferFunction(0, 1), 2)
    report = setid.Options(unidentifiable="report")
    return setid.identify(setid.IOData(u, u + 0.5 * u**2), model, setid.Noise(0.01), (), report)


@pytest.mark.parametrize("kind", ["linear", "empty", "bilinear", "unbounded", "reported"])
def test_verifying_stored_evidence_loads_no_solver(kind: str, tmp_path: Path) -> None:
    result = identified(kind)
    status = {"empty": "empty", "unbounded": "unbounded", "reported": "unidentifiable"}
    assert result.status == status.get(kind, "certified")
    stored = tmp_path / "evidence.pickle"
    stored.write_bytes(pickle.dumps((result.evidence, result.formulation.data)))
    assert loaded(tmp_path, VERIFYING, str(stored)) == []


def test_results_pickle(tmp_path: Path) -> None:
    result = identified("bilinear")
    again = pickle.loads(pickle.dumps(result))
    assert again.table() == result.table() and bool(again.verify(SMALL))
    assert repr(again) == repr(result) and dict(again.active) == dict(result.active)


def test_importing_the_package_loads_no_room(tmp_path: Path) -> None:
    code = """
import sys
import setid
print(*(n for n in sys.modules if n.split(".")[0] in ("scipy", "numpy", "matplotlib", "control")))
print(*(n for n in sys.modules if n.startswith(("setid.", "sparsepop_py"))))
assert set(setid.__all__) <= set(dir(setid))
"""
    assert loaded(tmp_path, code) == []


def test_functions_keep_their_names_beside_modules_of_the_same_name(tmp_path: Path) -> None:
    code = """
import setid.identify, setid.consistency
from setid.analysis.select import Selection
import setid
print(*(callable(getattr(setid, n)) for n in ("identify", "consistency", "select", "verify")))
"""
    assert loaded(tmp_path, code) == ["True"] * 4
