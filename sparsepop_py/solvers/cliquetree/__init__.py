"""An interior-point method on the clique tree of a relaxation.

The input is any :class:`ConicProgram`; cliques are found from the pattern of A and the
cones. The method is made for programs in which every moment lies in [-1, 1], and says
``failed`` where it cannot go on. ``docs/cliquetree.md`` derives it.

Examples
--------
>>> import sparsepop_py as sp
>>> from sparsepop_py.solvers import cliquetree
>>> x1, x2, x3 = sp.variables(3)
>>> problem = sp.Problem(x1 * x2 + x2 * x3, lower=-1, upper=1)
>>> program = sp.assemble(sp.relax(problem, 2), problem.objective)
>>> symbolic = cliquetree.analyse(program)
>>> found = cliquetree.solve(program, symbolic)
>>> print(found.status, round(found.dual, 5))
solved -2.0

References
----------
M. Fukuda, M. Kojima, K. Murota, K. Nakata, Exploiting sparsity in semidefinite programming
via matrix completion I, SIAM J. Optim. 11, 2001.
"""

from __future__ import annotations

import sys
import time
from collections import OrderedDict
from dataclasses import dataclass, replace

from sparsepop_py.budget import importing
from sparsepop_py.conic.program import ConicProgram, ConicSolution, solution
from sparsepop_py.errors import SolverNotFound
from sparsepop_py.solvers.cliquetree.iterations.interior import minimise
from sparsepop_py.solvers.cliquetree.iterations.numbers import Numbers
from sparsepop_py.solvers.cliquetree.iterations.progress import (
    Iterate,
    Iteration,
    Outcome,
    Settings,
    better,
)
from sparsepop_py.solvers.cliquetree.iterations.second_order import (
    second_order_multipliers,
    with_second_order,
)
from sparsepop_py.solvers.cliquetree.kernels.batched import Workers, compiled_kernels
from sparsepop_py.solvers.cliquetree.symbolic.analysis import (
    Symbolic,
    analyse,
    numpy_seconds,
    pattern_key,
)
from sparsepop_py.solvers.interface import SolverSettings

__all__ = ["Iterate", "Iteration", "Run", "Settings", "Symbolic", "analyse", "clique_tree", "run"]
__all__ += ["second_order_multipliers", "solve", "with_second_order"]

# The analysis of this many patterns is kept, and of more up to a number of entries of A: objectives
# that take turns come back to theirs. An entry takes about 300 bytes.
_KEPT, _ENTRIES = 4, 400_000
# Seconds of solves by numpy from which on compiled kernels pay. What is loaded already does not
_PRICE = 0.3  # count: the same program is solved by the same kernels, whatever was solved before
_COMPILATION = 10.0  # seconds of a time limit that leave room for it on a new machine
_ROWS = 0.1  # part of the accuracy that rows may miss
# Accuracy from which a solve is rough: those are on small boxes, where multipliers are large.
_ROUGH = 1e-3
_LOOSE = 1e-4  # gap and residual at which the point of a rough solve that stalls is still used
_HEIGHT = 5.0  # multiple of the usual height of the start of such a solve
_analysed: OrderedDict[tuple[bytes, bool], tuple[Symbolic, int]] = OrderedDict()  # and entries


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A solution and how it came about, for inspection and for the next solve.

    Parameters
    ----------
    solution : ConicSolution
    outcome : Outcome
        Iterations, CPU seconds of each phase, the last point.
    symbolic : Symbolic
        ``symbolic.tree.sizes`` has the pivots and updates of each front.
    """

    solution: ConicSolution
    outcome: Outcome
    symbolic: Symbolic

    def __str__(self) -> str:
        tree, log = self.symbolic.tree, self.outcome.log
        sizes = tree.sizes.sum(axis=1)
        lines = [
            f"{self.solution.status} ({self.solution.detail}) after {len(log) - 1} iterations",
            f"  {sizes.size} fronts up to {sizes.max(initial=0)} on {tree.levels} levels, "
            f"{tree.operations / 1e6:.1f} million operations a factorization",
            "  CPU seconds: "
            + ", ".join(f"{phase} {cpu:.3f}" for phase, cpu in self.outcome.seconds.items()),
            "  it      mu  primal    dual      safe value  centring  steps",
        ]
        for number, line in enumerate(log):
            lines.append(
                f"  {number:2d} {line.mu:7.1e} {line.primal_residual:7.1e} "
                f"{line.dual_residual:7.1e} {line.safe:15.8e}  {line.centring:8.1e}  "
                f"{line.primal_step:.2f} {line.dual_step:.2f}"
            )
        return "\n".join(lines)


def run(
    program: ConicProgram,
    symbolic: Symbolic | None = None,
    *,
    target: float | None = None,
    time_limit: float | None = None,
    start: Iterate | None = None,
    settings: Settings | None = None,
) -> Run:
    """Solve a program and keep the log; the arguments are those of :func:`solve`.

    Parameters
    ----------
    program : ConicProgram
    symbolic : Symbolic, optional
        From :func:`analyse` of a program of the same pattern.
    target : float, optional
        Stop once the dual value, less the largest possible effect of the dual residual on
        moments in [-1, 1], reaches this value.
    time_limit : float, optional
        Seconds of wall time.
    start : Iterate, optional
        ``outcome.early`` of a run on a nearby program of the same pattern. Where that leads
        nowhere, the solve starts again without it.
    settings : Settings, optional

    Raises
    ------
    ValueError
        If ``symbolic`` is of another pattern, or ``settings.threads`` is less than one.
    SolverNotFound
        If ``settings.kernels`` is "numba" and numba is missing.
    """
    begin, opened = time.process_time(), time.monotonic()
    key = pattern_key(program)
    settings = settings or Settings()
    if settings.threads < 1:
        raise ValueError(f"threads: found {settings.threads}, expected at least one")
    if symbolic is None:
        symbolic = _remembered(program, key, _compiled(program, settings, time_limit))
    elif symbolic.key != key:
        raise ValueError("symbolic: found the analysis of another pattern of A and cones")
    workers = Workers(settings.threads)
    try:
        numbers = Numbers.of(program, symbolic, workers)
        deadline = None if time_limit is None else opened + time_limit
        if symbolic.compiled and not compiled_kernels().factorize.signatures:
            with importing():  # the first call of each kernel loads or makes its machine code
                minimise(numbers, replace(settings, iterations=1), deadline=deadline)
        scaled = None if target is None else (target - program.offset) / numbers.unit
        outcome = _attempts(numbers, settings, start, scaled, deadline)
    finally:
        workers.close()
    last = outcome.iterate
    found = solution(
        program,
        outcome.status,
        last.y,
        numbers.multipliers(last.z, last.w),
        len(outcome.log) - 1,
        time.process_time() - begin,
        "cliquetree",
        outcome.detail,
    )
    return Run(found, outcome, symbolic)


def _attempts(
    numbers: Numbers,
    settings: Settings,
    start: Iterate | None,
    target: float | None,
    deadline: float | None,
) -> Outcome:
    """Again without a start, or with another penalty, where that may lead further."""

    def attempt(settings: Settings, start: Iterate | None = None) -> Outcome:
        return minimise(numbers, settings, start=start, target=target, deadline=deadline)

    outcome = attempt(settings, start)
    if outcome.status in ("almost", "failed") and start is not None:
        outcome = attempt(settings)
    if outcome.status == "almost" and numbers.e.size:
        again = attempt(replace(settings, penalty=settings.second_penalty))
        outcome = better(outcome, again)
    return outcome


def solve(
    program: ConicProgram,
    symbolic: Symbolic | None = None,
    *,
    target: float | None = None,
    time_limit: float | None = None,
    start: Iterate | None = None,
) -> ConicSolution:
    """Solve a program; the analysis of the last few patterns is remembered.

    Parameters
    ----------
    program : ConicProgram
    symbolic : Symbolic, optional
    target, time_limit : float, optional
    start : Iterate, optional
        See :func:`run`.
    """
    return run(program, symbolic, target=target, time_limit=time_limit, start=start).solution


def clique_tree(program: ConicProgram, settings: SolverSettings) -> ConicSolution:
    """Solve a program, as :class:`~sparsepop_py.solvers.interface.ConicSolver` asks.

    Parameters
    ----------
    program : ConicProgram
        Its moments should lie in [-1, 1].
    settings : SolverSettings
    """
    rows = max(1e-8, _ROWS * settings.accuracy)  # what rows miss costs no proof
    gap = max(1e-7, settings.accuracy / max(1.0, abs(program.offset)))  # of the objective's range
    height = _HEIGHT if settings.accuracy >= _ROUGH else 1.0
    loose = max(1e-5, min(_LOOSE, settings.accuracy))
    own = Settings(gap=gap, loose=loose, feasibility=rows, height=height, solves=settings.solves)
    if settings.max_iterations is not None:
        own = replace(own, iterations=settings.max_iterations)
    target, limit = settings.target, settings.time_limit
    return run(program, target=target, time_limit=limit, settings=own).solution


def _compiled(program: ConicProgram, settings: Settings, time_limit: float | None) -> bool:
    """Check whether to use compiled kernels: asked for, or available and worth it."""
    if settings.kernels == "numba":
        try:
            compiled_kernels()
        except ImportError as error:
            raise SolverNotFound(
                "kernels: 'numba' needs the package numba (pip install sparsepop-py[fast])"
            ) from error
        return True
    loaded = f"{__name__}.kernels.compiled" in sys.modules
    if settings.kernels == "numpy" or settings.solves * numpy_seconds(program) < _PRICE:
        return False
    if not loaded and time_limit is not None and time_limit < _COMPILATION:
        return False
    try:
        compiled_kernels()
    except ImportError:
        return False
    return True


def _remembered(program: ConicProgram, key: bytes, compiled: bool) -> Symbolic:
    known = _analysed.pop((key, compiled), None)
    symbolic = analyse(program, compiled) if known is None else known[0]
    _analysed[key, compiled] = symbolic, program.A.nnz
    # list: other threads that solve add theirs meanwhile
    entries = sum(count for _, count in list(_analysed.values()))
    while len(_analysed) > _KEPT and entries > _ENTRIES:
        entries -= _analysed.popitem(last=False)[1][1]
    return symbolic
