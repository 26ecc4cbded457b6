"""SparsePOP's published times beside ours: another machine, reported and not counted.

The published figures are those of tables 2 and 3 of the user guide of SparsePOP (H. Waki, S. Kim,
M. Kojima, M. Muramatsu, H. Sugimoto, M. Yamashita, User Manual for SparsePOP), on a 3.0 GHz Intel
Xeon X5365 with SeDuMi, and fmincon for the problems with constraints.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import sparsepop_py as sp
from sparsepop_py.budget import cpu_seconds
from sparsepop_py.verified.arithmetic.display import rounded

from ..errors import BenchmarkError
from ..problems import networks
from .text import number, table

__all__ = ["Published", "Timed", "find_problem", "published", "published_tables", "time_problem"]

# problem, variables, order, one clique of all variables, seconds of SeDuMi and of fmincon,
# |attained - value of the SDP| / max(1, |attained|); complementaritySW = 1 for ex9_*
_FILES = """
ex2_1_1 5 3 0 1.0 0.5 7.1e-08
ex2_1_2 6 2 0 0.1 0.2 6.8e-11
ex2_1_3 13 2 0 0.1 0.0 2.6e-09
ex2_1_4 6 2 0 0.1 0.0 2.1e-09
ex2_1_5 10 2 0 0.6 0.0 3.5e-10
ex2_1_8 24 2 0 15.4 0.1 5.0e-09
ex3_1_1 8 3 0 0.5 0.0 1.1e-09
ex3_1_2 5 2 0 0.1 0.0 7.0e-11
ex3_1_4 9 4 0 1.0 0.0 1.2e-06
ex5_2_2_case1 9 2 1 0.7 0.0 3.8e-08
ex5_2_2_case2 9 2 1 0.6 0.0 2.9e-07
ex5_2_2_case3 9 2 1 0.5 0.0 1.4e-09
ex5_2_5 32 1 0 0.1 43.1 1.8e+00
ex5_2_5 32 2 0 10550.4 0.8 1.1e-03
ex5_3_2 22 2 0 47.1 5.3 1.5e-01
ex5_3_2 22 3 0 35535.1 0.9 1.7e-03
ex5_4_2 8 3 0 0.5 0.0 8.2e-09
ex9_1_1 13 2 0 0.6 0.6 1.4e-09
ex9_1_2 10 3 0 2.6 0.0 2.9e-05
ex9_1_4 10 2 0 0.5 0.0 2.4e-05
ex9_1_5 13 2 0 0.3 0.0 7.1e-05
ex9_1_8 14 2 0 0.2 0.2 4.0e-10
ex9_2_1 10 2 1 0.8 0.0 9.4e-10
ex9_2_2 10 2 0 0.4 0.0 3.2e-05
ex9_2_3 16 2 0 0.5 0.0 8.3e-07
ex9_2_4 8 2 1 0.3 0.0 3.2e-08
ex9_2_5 8 2 0 0.1 0.0 -1.1e-08
ex9_2_6 16 2 1 1.8 0.0 4.2e-07
ex9_2_7 10 2 0 0.7 0.0 2.8e-09
ex9_2_8 6 2 1 0.1 0.0 7.4e-11
alkyl 14 3 0 2.9 0.2 1.8e-09
"""
_CHAINS = """
ChainedWood 1000 2 0 1.3 0 -2.8e-05
ChainedWood 5000 2 0 6.2 0 -1.4e-03
ChainedWood 10000 2 0 15.6 0 -1.2e-03
RosenbrockLS 1000 2 0 3.9 0 -8.4e-05
RosenbrockLS 5000 2 0 23.2 0 -4.6e-04
RosenbrockLS 10000 2 0 48.8 0 -9.3e-04
BroydenTriLS 1000 2 0 21.5 0 -1.1e-05
BroydenTriLS 5000 2 0 57.8 0 -1.4e-05
ChainedSingular 1000 2 0 27.4 0 5.4e-08
ChainedSingular 5000 2 0 86.2 0 5.0e-08
"""
_MAKERS: dict[str, Callable[[int], sp.Problem]] = {
    "ChainedWood": sp.problems.chained_wood,
    "RosenbrockLS": sp.problems.rosenbrock,
    "BroydenTriLS": sp.problems.broyden_tridiagonal,
    "ChainedSingular": sp.problems.chained_singular,
}
HARD: dict[str, Callable[[], sp.Problem]] = {
    "ex5_2_5": lambda: networks.pooling().problem,
    "ex5_3_2": lambda: networks.separation().problem,
}


_HEAD = "problem n order cliques".split() + ["published s", "published error"]
_HEAD += ["CPU s", "proved", "attained", "gap"]


@dataclass(frozen=True)
class Published:
    """One row of the published tables."""

    name: str
    n: int
    order: int
    dense: bool
    seconds: float
    error: float

    @property
    def param(self) -> dict[str, float]:
        """The fields of ``param`` at which it was measured."""
        return {
            "relaxOrder": self.order,
            "sparseSW": 1 - int(self.dense),
            "complementaritySW": int(self.name.startswith("ex9")),
        }


@dataclass(frozen=True)
class Timed:
    """One call: what is proved, what is attained, the value of the SDP, CPU seconds."""

    proved: float
    attained: float
    solver_value: float
    seconds: float


def published() -> tuple[Published, ...]:
    """The rows of both tables."""
    rows = [line.split() for line in (_FILES + _CHAINS).strip().splitlines() if line.strip()]
    return tuple(
        Published(
            *(name, int(n), int(order), dense == "1", float(first) + float(second), float(error))
        )
        for name, n, order, dense, first, second, error in rows
    )


def find_problem(row: Published, folder: Path | None) -> Callable[[], sp.Problem] | None:
    """How to make the problem of a row; None where there is no file of its name."""
    if row.name in _MAKERS:
        return lambda: _MAKERS[row.name](row.n)
    if folder is not None:
        for name in (f"{row.name}.gms", f"B{row.name}.gms"):
            path = folder / name
            if path.exists():
                return lambda: sp.read_gms(path)
    return HARD.get(row.name)


def time_problem(make: Callable[[], sp.Problem], param: dict[str, float], repeat: int) -> Timed:
    """The call with the least CPU seconds of several, the making of the problem included."""
    found = []
    for _ in range(repeat):
        start = cpu_seconds()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sp.ParameterWarning)
            output = sp.sparsePOP(make(), {"printLevel": 0, "POPsolver": "active-set", **param})
        seconds = cpu_seconds() - start
        POP = output.POP
        value = math.nan if POP.solverValue is None else POP.solverValue
        found.append(Timed(POP.lowerBound, POP.upperBound, value, seconds))
    return min(found, key=lambda one: one.seconds)


def published_tables(folder: Path | None, names: Sequence[str], repeat: int) -> Iterator[str]:
    """Lines of two Markdown tables, as they come.

    The second holds the problems that took SparsePOP hours, without their plain relaxations.
    """
    chosen = [(row, find_problem(row, folder)) for row in published()]
    rows = [(row, make) for row, make in chosen if make and (not names or row.name in names)]
    hard = [(row, make) for row, make in rows if row.name in HARD]
    if not rows:
        raise BenchmarkError("--names: found no problem of these names, expected one of the tables")
    if len(hard) < len(rows):
        yield from _usual([pair for pair in rows if pair not in hard], repeat)
    if hard:
        yield from _apart(hard, repeat)


_Rows = Sequence[tuple[Published, Callable[[], sp.Problem]]]


def _usual(rows: _Rows, repeat: int) -> Iterator[str]:
    """With ``tighten`` 1, and as plain relaxations."""
    yield table([*_HEAD, "plain: CPU s", "SDP value"], [])
    ratios = []
    for row, make in rows:
        tight = time_problem(make, row.param, repeat)
        plain = time_problem(make, {**row.param, "tighten": 0}, repeat)
        value = "" if math.isnan(plain.solver_value) else f"{plain.solver_value:.9g}"
        yield _line(row, str(row.order), [*_cells(tight), f"{plain.seconds:.2f}", value])
        ratios.append(math.log(row.seconds / tight.seconds))
    mean = math.exp(sum(ratios) / len(ratios))
    yield f"\ngeometric mean of published s / CPU s: {mean:.1f}\n"


def _apart(rows: _Rows, repeat: int) -> Iterator[str]:
    """With ``tighten`` 1, then with effort "auto" once for each problem."""
    yield table(_HEAD, [])
    for row, make in rows:
        yield _line(row, str(row.order), _cells(time_problem(make, row.param, repeat)))
    for row, make in {row.name: (row, make) for row, make in rows}.values():
        yield _line(replace(row, seconds=math.nan), "auto", _cells(_climbed(make, repeat)))


def _climbed(make: Callable[[], sp.Problem], repeat: int) -> Timed:
    """With effort "auto"."""
    found = []
    for _ in range(repeat):
        start = cpu_seconds()
        result = sp.solve(make(), sp.Options(effort="auto", time_limit=120))
        seconds = cpu_seconds() - start
        found.append(Timed(result.lower_bound, result.upper_bound, math.nan, seconds))
    return min(found, key=lambda one: one.seconds)


def _line(row: Published, order: str, cells: Sequence[str]) -> str:
    known = "" if math.isnan(row.seconds) else f"{row.seconds:.1f}"
    error = f"{row.error:.1e}" if known else ""
    head = [row.name, str(row.n), order, "one" if row.dense else "yes", known, error]
    return table([*head, *cells], []).splitlines()[0]


def _cells(found: Timed) -> list[str]:
    gap = (found.attained - found.proved) / max(1.0, abs(found.attained))
    ends = (
        rounded(value, upwards, 11)
        for value, upwards in ((found.proved, False), (found.attained, True))
    )
    return [f"{found.seconds:.2f}", *ends, number(gap)]
