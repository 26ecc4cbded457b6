"""The trusted kernel: what it loads, and what its page says of it."""

import re
import subprocess
import sys
from pathlib import Path

import sparsepop_py as sp

ROOT = Path(sp.__file__).resolve().parent
PAGE = ROOT / "verified" / "README.md"

UNTRUSTED = """
import sys
import sparsepop_py as sp

result = sp.read_json(sys.argv[1])
assert result.certificate.verify(result.problem).ok
assert result.attained.recheck(result.problem) is not None
packages = {"clarabel", "highspy", "cvxpy", "networkx", "sympy", "matplotlib", "numba", "casadi"}
rooms = ("solvers", "lp", "conic", "relaxation", "presolve", "local_search", "bounding")
rooms += ("tightening", "branch_and_bound", "strategy", "pipeline")
loaded = [
    name
    for name in sys.modules
    if name.split(".")[0] in packages
    or name.startswith("scipy.optimize")
    or name.startswith(tuple("sparsepop_py." + room for room in rooms))
]
print(*loaded)
"""


def test_verifying_a_stored_result_loads_no_solver_and_no_relaxation(tmp_path: Path) -> None:
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, [x**2 + y**2 <= 1])
    sp.write_json(sp.solve(problem), tmp_path / "result.json")
    words = [sys.executable, "-c", UNTRUSTED, str(tmp_path / "result.json")]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def lines(folder: Path) -> int:
    return sum(len(path.read_text().splitlines()) for path in folder.rglob("*.py"))


def test_the_page_counts_the_lines_of_every_trusted_room() -> None:
    stated = dict(re.findall(r"\| `([\w/]+)` \| (\d+) \|", PAGE.read_text()))
    counted = {room: lines(ROOT / room) for room in stated}
    assert counted == {room: int(count) for room, count in stated.items()}
    inside = {path.name for path in (ROOT / "verified").iterdir() if path.is_dir()}
    assert {f"verified/{name}" for name in inside - {"__pycache__"}} <= set(stated)
    whole = re.search(r"That is (\d+) lines", PAGE.read_text())
    assert whole and int(whole[1]) == sum(counted.values())
