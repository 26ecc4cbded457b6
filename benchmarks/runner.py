"""Run families: every case, every variant, every repetition, and then the peers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any

import sparsepop_py as sp

from .errors import BenchmarkError
from .measuring.isolation import Crash, isolated
from .measuring.measure import (
    Key,
    Method,
    Setting,
    build_row,
    key_of,
    method,
    own_rows,
    peer_rows,
    peers_of,
    settings_of,
)
from .measuring.records import Row
from .measuring.registry import Case, Family, Selection
from .measuring.settings import options_from, variants
from .peers import environments
from .peers import scip as peers
from .problems import intervals, soundness
from .problems.random_problems import random_problem

__all__ = ["SOLVERS", "ablation", "measure", "rows_of_methods", "run"]

SOLVERS = ("sparsepop_py", "scip")  # those that run unless others are named


def run(
    families: Iterable[Family], selection: Selection, setting: Setting, stored: Iterable[Row] = ()
) -> Iterator[Row]:
    """Rows of all cases of some families, as soon as they are measured.

    Parameters
    ----------
    families : iterable of Family
    selection : Selection
    setting : Setting
    stored : iterable of Row
        Of an earlier run: what they hold is not measured again.

    Raises
    ------
    BenchmarkError
        If a setting is wrong.
    """
    _check(setting)
    chosen = list(families)
    for family in chosen:
        options_from({**family.options, **setting.options})
    done, known = _stored(stored)
    _warm_up()
    for family in chosen:
        for case in family.chosen(selection):
            key = key_of(family, case)
            left = tuple(name for name in setting.solvers if (key, _title(name)) not in done)
            if left:
                own = replace(setting, solvers=left, known=known)
                yield from _apart(family, case, partial(measure, family, case, own))


def _title(name: str) -> str:
    return environments.PEERS[name].title if name in environments.PEERS else name


def _stored(rows: Iterable[Row]) -> tuple[set[tuple[Key, str]], dict[Key, Row]]:
    """What is measured already, by case and program, and our own rows by case."""
    done: set[tuple[Key, str]] = set()
    known: dict[Key, Row] = {}
    for row in rows:
        key = row.family, row.problem, row.size, row.seed
        if row.status != "missing":
            done.add((key, row.solver))
        if row.solver == "sparsepop_py" and row.variant == "default":
            known[key] = row
    return done, known


def _check(setting: Setting) -> None:
    known = ("sparsepop_py", *environments.PEERS)
    for name in setting.solvers:
        if name not in known:
            raise BenchmarkError(f"--solvers: found {name!r}, expected one of {', '.join(known)}")
    if setting.repeats < 1:
        raise BenchmarkError(f"--repeat: found {setting.repeats}, expected at least 1")
    if setting.peer_limit is not None and not setting.peer_limit > 0:
        raise BenchmarkError(f"--peer-limit: found {setting.peer_limit}, expected seconds > 0")


def _warm_up() -> None:
    """Load what is loaded once, so that no case pays for it."""
    (x,) = sp.variables(1)
    problem = sp.Problem(x**4 - x, lower=-1, upper=1)
    sp.solve(problem, sp.Options(order=2))
    if peers.scip_is_installed():
        peers.scip(problem, problem.objective, peers.Budget(1.0, 1e-3))


def measure(family: Family, case: Case, setting: Setting) -> Iterator[Row]:
    """All rows of one case."""
    if family.kind == "identify":
        yield from intervals.rows(family, case, setting)
        return
    settings = settings_of(family, case, setting)
    if family.kind == "build":
        yield from (build_row(family, case, settings, k) for k in range(setting.repeats))
    elif family.kind == "random":
        yield from _checked(family, case, setting, settings)
    else:
        tolerance, own = _tolerance(settings), None
        if "sparsepop_py" in setting.solvers:
            solve = method(settings)
            for own in own_rows(family, case, "default", solve, tolerance, setting.repeats):
                yield own
            yield from _by_workers(family, case, settings, setting)
        own = own or setting.known.get(key_of(family, case))
        for name in peers_of(setting):
            yield from peer_rows(family, case, own, tolerance, setting, name)


def _by_workers(
    family: Family, case: Case, settings: Mapping[str, Any], setting: Setting
) -> Iterator[Row]:
    """The same with worker processes for nodes, which start before it is timed."""
    for count in setting.workers:
        with ProcessPoolExecutor(count) as executor:
            list(executor.map(abs, range(count)))
            solve = method({**settings, "executor": executor})
            name = f"{count} workers"
            yield from own_rows(family, case, name, solve, _tolerance(settings), setting.repeats)


def _tolerance(settings: Mapping[str, Any]) -> float:
    return float(settings.get("gap", sp.Options().gap))


def _checked(
    family: Family, case: Case, setting: Setting, settings: Mapping[str, Any]
) -> Iterator[Row]:
    """A random problem: what samples, damaged certificates and SCIP say about the result."""
    made = random_problem(case.seed)
    results: list[sp.Result] = []

    def solve(task: Any) -> list[sp.Result]:
        results[:] = [sp.solve(task.problem, options_from(settings))]
        return list(results)

    once, tolerance = replace(setting, repeats=1), _tolerance(settings)
    (own,) = own_rows(family, case, "default", solve, tolerance, 1)
    found = [] if not results else list(soundness.findings(made, results[0], case.seed))
    valid = bool(results) and not found
    yield replace(own, valid=valid, notes=tuple(f"finding: {text}" for text in found))
    if "scip" not in setting.solvers:
        return
    for row in peer_rows(family, case, own, tolerance, once):
        claims: list[str] = []
        if results and row.details:
            answer = peers.Answer(row.status, row.lower, row.upper, None, 0.0, 0.0)
            claims = list(soundness.disagreements(results[0], answer))
        notes = row.notes + tuple(f"disagreement: {text}" for text in claims)
        yield replace(row, valid=not claims if row.details else None, notes=notes)


def ablation(
    families: Iterable[Family],
    selection: Selection,
    setting: Setting,
    names: Iterable[str],
    more: Iterable[str] = (),
) -> Iterator[Row]:
    """Rows of all cases with everything on, and with each switch off in turn.

    Parameters
    ----------
    names : iterable of str
        Switches, see :func:`benchmarks.measuring.settings.switches`.
    more : iterable of str
        Further variants as texts, see :func:`benchmarks.measuring.settings.variants`.

    Raises
    ------
    BenchmarkError
        If a family has no bounds to compare or a name is unknown.
    """
    _check(setting)
    chosen, names, more = list(families), list(names), list(more)
    for family in chosen:
        if family.kind != "solve":
            raise BenchmarkError(f"family: {family.name!r} solves nothing, expected one that does")
        variants({**family.options, **setting.options}, names, more)
    _warm_up()
    for family in chosen:
        for case in family.chosen(selection):
            settings = variants(settings_of(family, case, setting), names, more)
            methods = {name: method(each) for name, each in settings.items()}
            tolerance = _tolerance(settings["default"])
            rows = partial(rows_of_methods, family, case, methods, tolerance, setting.repeats)
            yield from _apart(family, case, rows)


def _apart(family: Family, case: Case, rows: Callable[[], Iterable[Row]]) -> Iterator[Row]:
    """The rows of a case, made in a process of its own; its death is one more row."""
    try:
        yield from isolated(rows)
    except Crash as crash:
        yield Row(family.name, case.name, case.size, case.seed, 0, "process", f"error: {crash}")


def rows_of_methods(
    family: Family, case: Case, methods: Mapping[str, Method], tolerance: float, repeats: int
) -> Iterator[Row]:
    """Rows of one case for each of several ways to solve it, by name."""
    for name, solve in methods.items():
        yield from own_rows(family, case, name, solve, tolerance, repeats)
