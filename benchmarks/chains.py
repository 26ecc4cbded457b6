"""Large problems: proved gap, CPU seconds and peak memory, each in a process of its own.

``python -m benchmarks.chains`` prints the tables of docs/benchmarks/large_problems.md.
"""

from __future__ import annotations

import argparse
import math
import resource
import subprocess
import sys
from collections.abc import Callable, Iterable

import sparsepop_py as sp
from sparsepop_py.budget import cpu_seconds

from .errors import BenchmarkError
from .tables.text import table

__all__ = ["PROBLEMS", "main"]

# optimum: Waki et al. (2006), section 6; those of optimal control are not published at this size
PROBLEMS: dict[str, tuple[Callable[[int], sp.Problem], float | None]] = {
    "rosenbrock": (sp.problems.rosenbrock, 1.0),
    "chained_wood": (sp.problems.chained_wood, 1.0),
    "broyden_tridiagonal": (sp.problems.broyden_tridiagonal, 0.0),
    "chained_singular": (sp.problems.chained_singular, 0.0),
    "nondquar": (sp.problems.nondquar, 0.0),
    "broyden_banded": (sp.problems.broyden_banded, 0.0),
    "linear control": (lambda n: sp.problems.bilinear_control(1 + n // 6), None),
    "bilinear control": (lambda n: sp.problems.bilinear_control(1 + n // 3, 1, 2, 0.5), None),
    "scalar control": (lambda n: sp.problems.scalar_control(1 + n // 2), None),
}
CHAINS = tuple(PROBLEMS)[:4]


def _measure(name: str, n: int, form: str) -> list[str]:
    """One row, measured in this process."""
    make, optimum = PROBLEMS[name]
    problem = make(n)
    if form == "expanded":
        problem = sp.Problem(problem.objective, problem.constraints)
    options = sp.Options(time_limit=600)
    if problem.constraints:
        options = sp.Options(effort="auto", gap=1e-5, time_limit=600)
    sp.solve(sp.problems.rosenbrock(4), options)  # imports and compiled kernels count apart
    start = cpu_seconds()
    result = sp.solve(problem, options)
    seconds = cpu_seconds() - start
    start = cpu_seconds()
    verdict = result.certificate.verify(problem) if result.certificate is not None else None
    checking = cpu_seconds() - start
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    below = "" if optimum is None else f"{optimum - result.lower_bound:.1e}"
    gap = f"{result.upper_bound - result.lower_bound:.1e}"
    holds = "yes" if verdict is not None and verdict.ok else "no"
    numbers = [f"{seconds:.2f}", f"{checking:.2f}", f"{memory:.0f}"]
    return [name, str(problem.dimension), form, result.status.name, below, gap, *numbers, holds]


def _apart(name: str, n: int, form: str) -> list[str]:
    """The same in a child process, whose peak memory is its own."""
    command = [sys.executable, "-m", "benchmarks.chains", "--one", name, str(n), form]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise BenchmarkError(f"{name}, n = {n}: {done.stderr.strip().splitlines()[-1]}")
    return done.stdout.strip().split("|")


def _slopes(rows: Iterable[list[str]]) -> list[list[str]]:
    """Exponents of n between the smallest and the largest size, for seconds and memory."""
    series: dict[tuple[str, str], list[list[str]]] = {}
    for row in rows:
        series.setdefault((row[0], row[2]), []).append(row)
    result = []
    for (name, form), each in series.items():
        first, last = each[0], each[-1]
        if first[1] == last[1]:
            continue
        grown = math.log(int(last[1]) / int(first[1]))
        slopes = [math.log(float(last[k]) / float(first[k])) / grown for k in (6, 8)]
        result.append([name, form, *(f"{slope:.2f}" for slope in slopes)])
    return result


def main() -> None:
    """Print a table of problems and sizes, and how seconds and memory grow."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.chains", description=__doc__)
    add = parser.add_argument
    add("--names", nargs="+", default=list(CHAINS), choices=list(PROBLEMS), help="which problems")
    add("--sizes", nargs="+", type=int, default=[1000, 2000, 5000, 10000], help="variables")
    add("--forms", nargs="+", default=["squares", "expanded"], choices=["squares", "expanded"])
    add("--one", nargs=3, metavar=("NAME", "N", "FORM"), help="one row, in this process")
    chosen = parser.parse_args()
    if chosen.one:
        name, n, form = chosen.one
        print("|".join(_measure(name, int(n), form)))
        return
    head = "problem n form status optimum-bound gap CPU verify MB holds".split()
    print(table(head, []).rstrip(), flush=True)
    rows = []
    for name in chosen.names:
        for form in chosen.forms:
            for n in chosen.sizes:
                rows.append(_apart(name, n, form))
                print(table(rows[-1], []).splitlines()[0], flush=True)
    slopes = _slopes(rows)
    if slopes:
        print(table(["problem", "form", "exponent of CPU", "of memory"], slopes))


if __name__ == "__main__":
    main()
