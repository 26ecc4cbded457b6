"""Without cvxpy and sympy: everything but their own features works, and messages say what to do."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

BLOCKED = """
import sys
for name in ("cvxpy", "sympy", "matplotlib", "flask", "ray", "distributed"):
    sys.modules[name] = None  # importing it raises ImportError
"""


def run(code: str, tmp_path: Path) -> str:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run(
        [sys.executable, "-c", BLOCKED + code],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=environment,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_problems_are_solved(tmp_path: Path) -> None:
    """The minimum of x1 x2 on the unit disc is -1/2."""
    code = """
import sparsepop_py as sp
x1, x2 = sp.variables(2)
result = sp.solve(sp.Problem(x1 * x2, [x1**2 + x2**2 <= 1]), sp.Options(effort="auto"))
print(result.status, result.lower_bound <= -0.5 <= result.upper_bound)
print(sp.parse("min x^2 - x; s.t. x >= 0").dimension)
"""
    assert run(code, tmp_path) == "OPTIMAL True\n1\n"


def test_records_are_identified(tmp_path: Path) -> None:
    code = """
import setid
data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
print(result.status, bool(result.verify(data)))
"""
    assert run(code, tmp_path) == "certified True\n"


def test_solvers_of_cvxpy_say_what_to_install(tmp_path: Path) -> None:
    code = """
import sparsepop_py as sp
try:
    sp.Options(solver="cvxpy:SCS")
except sp.SolverNotFound as error:
    print(error)
"""
    assert "pip install 'sparsepop-py[cvxpy]'" in run(code, tmp_path)


def test_networks_keep_their_other_conditions(tmp_path: Path) -> None:
    """h_t = tanh(0.5 h_{t-1} + u_t) contracts, for tanh has slopes in [0, 1]."""
    code = """
from setid import neural
net = neural.Elman([([[1.0]], [[0.5]], [0.0])])
found = neural.stability(net)
print(found.status)
print([c.name for c in found.conditions if "cvxpy" in c.name])
"""
    printed = run(code, tmp_path)
    assert "pip install 'sparsepop-py[cvxpy]'" in printed


def test_the_page_says_what_to_install(tmp_path: Path) -> None:
    code = """
from setid.cli import main
sys.stderr = sys.stdout
print(main(["serve", "--port", "0", "--no-browser"]))
"""
    printed = run(code, tmp_path)
    assert "pip install 'sparsepop-py[serve]'" in printed and printed.endswith("3\n")
