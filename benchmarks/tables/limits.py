"""Wall time over the time limit, on a busy machine.

Each run is a process of its own, as long as four others keep the processors busy. Its clock starts
with the packages loaded and the problem built, and stops with the result in hand. A limit counts as
kept where the wall time is at most one and a half times as long.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import combinations_with_replacement
from multiprocessing import get_context
from typing import Any

import numpy as np

import setid
import sparsepop_py as sp
from sparsepop_py.budget import cpu_seconds

from ..errors import BenchmarkError
from .text import table

__all__ = ["CASES", "KEPT", "LimitedRun", "limits_table", "measure_limits"]

KEPT = 1.5  # largest allowed ratio of wall time to limit
BUSY = 4  # processes that do nothing but count
_LOST = 20.0  # times the limit after which a run is given up


@dataclass(frozen=True)
class LimitedRun:
    """One run under a limit.

    Parameters
    ----------
    case : str
    limit : float
        Seconds.
    wall, cpu : float
        Seconds; inf for a run that was given up.
    status : str
    bounds : str
        Proved and attained, or the number of intervals that are certified.
    """

    case: str
    limit: float
    wall: float
    cpu: float
    status: str
    bounds: str

    @property
    def ratio(self) -> float:
        """Wall time over the limit."""
        return self.wall / self.limit


# ---- problems ---------------------------------------------------------------------------


def dense(n: int, degree: int, seed: int = 0) -> sp.Problem:
    """Build a dense polynomial in n variables on [-1, 1]^n with normal coefficients."""
    words = np.array(list(combinations_with_replacement(range(n + 1), degree)), np.int32)
    numbers = np.random.default_rng(seed).normal(size=words.shape[0])
    return sp.Problem(sp.Polynomial(words, numbers, n), lower=-1.0, upper=1.0)


def _expanded(problem: sp.Problem, bound: float) -> sp.Problem:
    """Drop the squares and bound the variables."""
    return sp.Problem(problem.objective, problem.constraints, -bound, bound)


def _solved(problem: sp.Problem, **options: Any) -> Callable[[float], tuple[str, str]]:
    def run(limit: float) -> tuple[str, str]:
        result = sp.solve(problem, sp.Options(time_limit=limit, **options))
        return str(result.status), f"[{result.lower_bound:.6g}, {result.upper_bound:.6g}]"

    return run


def _identified(model: Any, noise: Any, data: Any) -> Callable[[float], tuple[str, str]]:
    def run(limit: float) -> tuple[str, str]:
        options = setid.Options(time_limit=limit, progress=False)
        result = setid.identify(data, model, noise, (), options)
        done = [i.status is setid.IntervalStatus.CERTIFIED for i in result.intervals.values()]
        return str(result.status), f"{sum(done)} of {len(done)} certified"

    return run


def _linear_record(samples: int, seed: int, input_noise: float) -> setid.IOData:
    rng = np.random.default_rng(seed)
    u, y = rng.uniform(-1, 1, samples), np.zeros(samples)
    for k in range(2, samples):
        y[k] = 0.7647 * y[k - 1] - 0.3012 * y[k - 2] + 0.3224 * u[k - 1] + 0.2141 * u[k - 2]
    wrong = rng.uniform(-1.0, 1.0, (2, samples))
    return setid.IOData(u + input_noise * wrong[0], y + 0.05 * wrong[1])


def _hammerstein_record() -> setid.IOData:
    rng = np.random.default_rng(2)
    u, y = rng.uniform(-1, 1, 60), np.zeros(60)
    x = u + 0.4 * u**2
    for k in range(2, 60):
        y[k] = 0.6 * y[k - 1] - 0.2 * y[k - 2] + x[k] + 0.3 * x[k - 1]
    return setid.IOData(u, y + rng.uniform(-0.05, 0.05, 60))


def _dense_cubic() -> Callable[[float], tuple[str, str]]:
    return _solved(dense(40, 3), effort="auto")


def _dense_quartic() -> Callable[[float], tuple[str, str]]:
    return _solved(dense(13, 4), order=2)


def _dense_quartic_auto() -> Callable[[float], tuple[str, str]]:
    return _solved(dense(16, 4, 1), effort="auto")


def _dense_order_three() -> Callable[[float], tuple[str, str]]:
    return _solved(dense(9, 4, 2), order=3)


def _sphere() -> Callable[[float], tuple[str, str]]:
    x = sp.variables(12)
    problem = sp.Problem(dense(12, 4, 3).objective, [sp.total(v**2 for v in x) == 1])
    return _solved(problem, effort="auto")


def _broyden() -> Callable[[float], tuple[str, str]]:
    return _solved(_expanded(sp.problems.broyden_tridiagonal(1000), 1.0), order=2)


def _broyden_auto() -> Callable[[float], tuple[str, str]]:
    return _solved(_expanded(sp.problems.broyden_tridiagonal(300), 1.0), effort="auto")


def _banded() -> Callable[[float], tuple[str, str]]:
    return _solved(_expanded(sp.problems.broyden_banded(30), 1.0), effort="auto")


def _wood_free() -> Callable[[float], tuple[str, str]]:
    problem = sp.problems.chained_wood(400)
    return _solved(sp.Problem(problem.objective), effort="auto")


def _control() -> Callable[[float], tuple[str, str]]:
    return _solved(sp.problems.scalar_control(60), effort="auto")


def _errors_in_variables() -> Callable[[float], tuple[str, str]]:
    model = setid.TransferFunction(na=2, nb=2, nk=1)
    data = _linear_record(200, 0, 0.05)
    return _identified(model, setid.Noise(output=0.05, input=0.05), data)


def _output_error() -> Callable[[float], tuple[str, str]]:
    model = setid.TransferFunction(na=2, nb=2, nk=1)
    return _identified(model, setid.Noise(output=0.05), _linear_record(500, 1, 0.0))


def _hammerstein() -> Callable[[float], tuple[str, str]]:
    model = setid.Hammerstein(setid.TransferFunction(na=2, nb=2, nk=0), 2, normalise="gamma1")
    return _identified(model, setid.Noise(output=0.05), _hammerstein_record())


CASES: dict[str, Callable[[], Callable[[float], tuple[str, str]]]] = {
    "dense cubic, 40 variables": _dense_cubic,
    "dense quartic, 13 variables, order 2": _dense_quartic,
    "dense quartic, 16 variables": _dense_quartic_auto,
    "dense quartic, 9 variables, order 3": _dense_order_three,
    "dense quartic on a sphere, 12 variables": _sphere,
    "Broyden tridiagonal, 1000 variables, order 2": _broyden,
    "Broyden tridiagonal, 300 variables": _broyden_auto,
    "Broyden banded, 30 variables": _banded,
    "chained Wood without bounds, 400 variables": _wood_free,
    "scalar control, 60 steps": _control,
    "errors in variables, 200 samples": _errors_in_variables,
    "output error, 500 samples": _output_error,
    "Hammerstein, 60 samples": _hammerstein,
}


# ---- measurement ------------------------------------------------------------------------


def _count() -> None:
    """Keep a processor busy until the parent is gone or ends this process."""
    parent = os.getppid()
    while os.getppid() == parent:
        sum(range(100_000))


@contextmanager
def busy_machine(processes: int = BUSY) -> Iterator[None]:
    """Keep processors busy within the body of a with statement."""
    context = get_context("spawn")
    started = [context.Process(target=_count, daemon=True) for _ in range(processes)]
    for process in started:
        process.start()
    try:
        yield
    finally:
        for process in started:
            process.terminate()
            process.join()


def _timed(name: str, limit: float) -> LimitedRun:
    """Run one case in this process."""
    x, y = sp.variables(2)
    small = sp.Problem(x**2 * y - y**3, [x * y >= 0.1], -1, 1)
    sp.solve(small, sp.Options(effort="auto", gap=0.0, time_limit=2.0))  # imports what is needed
    for each in (setid.identify, setid.consistency):  # loaded when they are first named
        assert callable(each)
    run = CASES[name]()
    begin, cpu = time.monotonic(), cpu_seconds()
    status, bounds = run(limit)
    wall, spent = time.monotonic() - begin, cpu_seconds() - cpu
    return LimitedRun(name, limit, wall, spent, status, bounds)


def _measured(name: str, limit: float) -> LimitedRun:
    """Run one case in a process of its own, which ends in any case."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        job = pool.submit(_timed, name, limit)
        try:
            return job.result(_LOST * limit)
        except TimeoutError:
            for process in (pool._processes or {}).values():
                process.kill()
            return LimitedRun(name, limit, float("inf"), float("inf"), "given up", "")


def measure_limits(
    names: Sequence[str], limits: Sequence[float], busy: int = BUSY
) -> Iterator[LimitedRun]:
    """Run cases under limits while other processes keep the machine busy.

    Parameters
    ----------
    names : sequence of str
        Parts of names of cases; all cases when empty.
    limits : sequence of float
        Seconds.
    busy : int
        Number of busy processes.
    """
    chosen = [c for c in CASES if not names or any(part in c for part in names)]
    if not chosen:
        raise BenchmarkError(f"--names: found {list(names)}, expected parts of {list(CASES)}")
    with busy_machine(busy):
        for limit in limits:
            for name in chosen:
                yield _measured(name, limit)


def limits_table(runs: Sequence[LimitedRun]) -> str:
    """Format runs as a table, with the number of limits that were kept."""
    head = ["case", "limit", "wall s", "wall / limit", "CPU s", "status", "found"]
    rows = [
        [
            run.case,
            f"{run.limit:g}",
            f"{run.wall:.1f}",
            f"{run.ratio:.2f}",
            f"{run.cpu:.1f}",
            run.status,
            run.bounds,
        ]
        for run in runs
    ]
    kept = sum(run.ratio <= KEPT for run in runs)
    return f"{table(head, rows)}\n\nat most {KEPT}: {kept} of {len(runs)} runs"
