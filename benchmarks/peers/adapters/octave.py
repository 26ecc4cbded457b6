"""SparsePOP with SeDuMi under GNU Octave, from the folder that ``SPARSEPOP`` names.

The folder holds ``sparsePOP.m``, and SeDuMi somewhere below. The problem goes there as structs;
what comes back is the value of the relaxation and SparsePOP's point.
"""

import json
import os
import resource
import shutil
import subprocess
import tempfile
from pathlib import Path

from common import INF, Refused, answer, by_powers, run, value

_NO_BOUND = 1e10  # from which on SparsePOP takes a bound for none
_ANSWER = "benchmark: "  # begins the line that is read
_END = """
[param, SDPobjValue, POP] = sparsePOP(objPoly, ineqPolySys, lbd, ubd, param);
x = [];
if isfield(POP, 'xVect') && all(isfinite(POP.xVect)), x = POP.xVect(:)'; end
printf('%s%.17g [%s]\\n', 'benchmark: ', SDPobjValue, strjoin(arrayfun(@(v) ...
    sprintf('%.17g', v), x, 'UniformOutput', false), ','));
"""


def solve(task, number):
    home = os.environ.get("SPARSEPOP")
    if not home:
        raise Refused("SPARSEPOP names no folder that has SparsePOP and SeDuMi")
    if shutil.which("octave-cli") is None:
        raise Refused("octave-cli is not installed")
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / "task.m"
        script.write_text(_script(task, number, Path(home).resolve()), encoding="utf-8")
        command = ["octave-cli", "--norc", "--quiet", str(script)]
        try:
            done = subprocess.run(
                command, cwd=folder, capture_output=True, text=True, timeout=task["seconds"]
            )
        except subprocess.TimeoutExpired:
            return {**answer("budget: ended"), "solving": task["seconds"]}
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    lines = [line for line in done.stdout.splitlines() if line.startswith(_ANSWER)]
    if not lines:
        raise RuntimeError(done.stderr.strip()[-160:] or "no answer")
    lower, point = lines[-1].removeprefix(_ANSWER).split(" ")
    x = json.loads(point) or None
    upper = INF if x is None else value(task["objectives"][number], x)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {**answer("solved", float(lower), upper, x), "solving": seconds}


def _script(task, number, home):
    lines = [f"addpath(genpath({_text(home)}));", "ineqPolySys = {};"]
    lines += _struct("objPoly", task["objectives"][number], 1, task["n"])
    for k, row in enumerate(task["rows"], 1):
        lines += _struct(f"ineqPolySys{{{k}}}", row["terms"], -1 if row["equal"] else 1, task["n"])
    lower = [max(v, -_NO_BOUND) for v in task["lower"]]
    upper = [min(v, _NO_BOUND) for v in task["upper"]]
    lines += [f"lbd = {_row(lower)};", f"ubd = {_row(upper)};"]
    lines += [f"param.relaxOrder = {task['order']};", "param.printLevel = [0, 0];"]
    return "\n".join(lines) + _END


def _struct(name, terms, cone, n):
    powers = by_powers(terms, n) or {(0,) * n: 0.0}
    supports = "; ".join(" ".join(map(str, key)) for key in powers)
    return [
        f"{name}.typeCone = {cone}; {name}.sizeCone = 1; {name}.dimVar = {n};",
        f"{name}.degree = {max(map(sum, powers))}; {name}.noTerms = {len(powers)};",
        f"{name}.supports = [{supports}];",
        f"{name}.coef = {_row(powers.values())}';",
    ]


def _row(values):
    return "[" + ", ".join(f"{v:.17g}" for v in values) + "]"


def _text(path):
    return "'" + str(path).replace("'", "''") + "'"


run(solve)
