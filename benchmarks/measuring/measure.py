"""Measure a case: our own solver by phases, building alone, and peers."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

import sparsepop_py as sp
from sparsepop_py.budget import cpu_seconds
from sparsepop_py.verified.arithmetic.interval import exact_values

from ..errors import DEFECTS
from ..peers import environments
from ..peers import scip as peers
from ..peers.elsewhere import Stops, ask
from .probes import Watch, watched
from .records import PHASES, Row
from .registry import Case, Family, Task
from .settings import options_from

__all__ = [
    "Key",
    "Method",
    "Setting",
    "build_row",
    "key_of",
    "method",
    "own_rows",
    "peer_rows",
    "peers_of",
    "settings_of",
]

Key = tuple[str, str, int | None, int]
Method = Callable[[Task], list[sp.Result]]

_STAGES = {"search": "refine", "extract": "refine"}  # stages of the engine under other names
_DONE = (sp.Status.INFEASIBLE, sp.Status.UNBOUNDED)
_ROUND_OFF = 1.0 + 1e-9
_VIOLATED = 1e-9
_KNOWN = 1e-6  # to which optima are known, relative to max(1, |optimum|)


@dataclass(frozen=True, eq=False)
class Setting:
    """How to measure.

    Parameters
    ----------
    solvers : tuple of str
        ``"sparsepop_py"`` and peers.
    repeats : int
    options : mapping
        Fields of Options that the command line sets.
    peer_limit : float, optional
        CPU seconds of a peer for one objective; the family's when left out.
    known : mapping
        Rows of our own by :func:`key_of`, from an earlier run; peers get their gaps.
    workers : tuple of int
        Numbers of worker processes to measure beside none.
    """

    solvers: tuple[str, ...] = ("sparsepop_py", "scip")
    repeats: int = 3
    options: Mapping[str, Any] = field(default_factory=dict)
    peer_limit: float | None = None
    known: Mapping[Key, Row] = field(default_factory=dict)
    workers: tuple[int, ...] = ()


def settings_of(family: Family, case: Case, setting: Setting) -> dict[str, Any]:
    """Fields of Options: of the family, of the case, and above both of the command line."""
    return {**family.options, **case.options, **setting.options}


def key_of(family: Family, case: Case) -> Key:
    """What rows of one case have in common."""
    return family.name, case.name, case.size, case.seed


def method(settings: Mapping[str, Any]) -> Method:
    """What solves a task with options of these fields, objectives together."""

    def solve(task: Task) -> list[sp.Result]:
        options = _options(task, settings)
        if task.pairs:
            return sp.solve_each(task.problem, task.objectives, options)
        return [sp.solve(task.problem, options)]

    return solve


def _options(task: Task, settings: Mapping[str, Any]) -> sp.Options:
    """Gaps of pairs are relative to the width, or to that of the start box where need be."""
    if not task.pairs:
        return options_from(settings)
    try:
        return options_from({"gap_kind": "width", **settings})
    except sp.ProblemError:  # an engine that knows no widths
        gap = settings.get("gap", 1e-3) * min(task.start_widths)
        return options_from({**settings, "gap_kind": "absolute", "gap": gap})


# ---- our own solver ---------------------------------------------------------------------


def own_rows(
    family: Family, case: Case, variant: str, solve: Method, tolerance: float, repeats: int
) -> Iterator[Row]:
    """One row for each repetition of one way to solve a case."""
    for repeat in range(repeats):
        start = cpu_seconds()
        task = case.make()
        parse = cpu_seconds() - start
        failure, results = "", []
        with watched() as watch:
            try:
                results = solve(task)
            except DEFECTS as error:  # a crash is a row, and the other cases go on
                failure = f"{type(error).__name__}: {error}"
        common = _head(family, case, task, repeat, tolerance) | {
            "solver": "sparsepop_py",
            "variant": variant,
            "cpu_seconds": watch.seconds,
            "wall_seconds": watch.wall,
            "peak_mb": watch.peak_mb,
        }
        if failure:
            yield Row(**common, status=f"error: {failure}", phases={"parse": parse})
        elif not results:  # what was solved is no problem of the engine
            yield Row(**common, status="no finite box", proved=True, phases={"parse": parse})
        else:
            yield _own_row(common, task, results, watch, parse, tolerance)


def _head(family: Family, case: Case, task: Task, repeat: int, tolerance: float) -> dict[str, Any]:
    problem = task.problem
    return {
        "family": family.name,
        "problem": case.name,
        "size": case.size,
        "seed": case.seed,
        "repeat": repeat,
        "gap_kind": "width" if task.pairs else "relative",
        "objectives": len(task.objectives),
        "tolerance": tolerance,
        "variables": problem.dimension,
        "constraints": len(problem.constraints),
        "degree": problem.degree,
        "optimum": task.optimum,
    }


def _own_row(
    common: dict[str, Any],
    task: Task,
    results: list[sp.Result],
    watch: Watch,
    parse: float,
    tolerance: float,
) -> Row:
    lows = [r.lower_bound for r in results]
    highs = [r.upper_bound for r in results]
    words = [str(r.status) for r in results]
    done = [r.status in _DONE and not task.pairs for r in results]
    violations = [math.nan if r.x is None else _violation(r.problem, r.x) for r in results]
    relaxations = [r.relaxation for r in results if r.relaxation is not None]
    certificates = [(r.certificate, r.problem) for r in results if r.certificate is not None]
    start = cpu_seconds()
    known: dict[Any, Any] = {}  # the results share one feasible set
    verdicts = [certificate.verify(problem, known).ok for certificate, problem in certificates]
    proofs = {id(p): p for c, _ in certificates for p in (*c.quoted, c)}
    judged = _bounds(
        task, words, lows, highs, done, violations, _units(task, lows, highs), tolerance
    )
    judged["details"] = tuple(
        {**detail, "trace": _trace(result)}
        for detail, result in zip(judged["details"], results, strict=True)
    )
    return Row(
        **common,
        **judged,
        proved=True,
        phases=_phases(results, watch.seconds, parse),
        order=max((r.order for r in relaxations), default=0),
        largest_block=max((max(r.block_sizes, default=0) for r in relaxations), default=0),
        moments=max((r.moments.shape[0] for r in relaxations), default=0),
        verified=all(verdicts) if verdicts else None,
        verify_seconds=cpu_seconds() - start,
        certificate_bytes=len(pickle.dumps([c for c, _ in certificates])),
        certificate_parts=sum(proof.leaves for proof in proofs.values()),
        problem_bytes=len(pickle.dumps(task.problem.constraints + task.objectives)),
        notes=tuple(dict.fromkeys(note for r in results for note in r.notes)),
    )


def _trace(result: sp.Result) -> list[tuple[float, float, float]]:
    """CPU seconds so far and both bounds after each step of a history."""
    seconds = np.cumsum([entry.seconds for entry in result.history]).tolist()
    pairs = zip(seconds, result.history, strict=True)
    return [(spent, entry.lower_bound, entry.upper_bound) for spent, entry in pairs]


def _phases(results: list[sp.Result], seconds: float, parse: float) -> dict[str, float]:
    """CPU seconds by phase; what no phase claims is "other"."""
    phases = dict.fromkeys(PHASES, 0.0)
    for result in results:
        for stage, spent in result.timings.items():
            name = _STAGES.get(stage, stage)
            phases[name if name in phases else "other"] += spent
    if not phases["cliques"]:
        phases["cliques"] = min(_clique_seconds(results), phases["relax"])
        phases["relax"] -= phases["cliques"]
    phases["other"] += max(0.0, seconds - sum(phases.values()))
    phases["parse"] = parse
    return phases


def _clique_seconds(results: list[sp.Result]) -> float:
    """What finding the cliques of the final relaxations takes, once more, each once."""
    distinct = {id(r.relaxation): r for r in results if r.relaxation is not None}
    start = cpu_seconds()
    for result in distinct.values():
        assert result.relaxation is not None
        options = result.options
        sp.find_cliques(result.relaxation.problem, options.sparse, options.chordal)
    return cpu_seconds() - start


# ---- peers ------------------------------------------------------------------------------


def peer_rows(
    family: Family,
    case: Case,
    own: Row | None,
    tolerance: float,
    setting: Setting,
    name: str = "scip",
) -> Iterator[Row]:
    """A peer on the same problem and box; once only where it runs out of its budget."""
    limit = family.peer_limit if setting.peer_limit is None else setting.peer_limit
    peer = environments.peer(name)
    python = environments.interpreter(peer)
    for repeat in range(setting.repeats):
        task = case.make()
        common = _head(family, case, task, repeat, tolerance) | {"solver": peer.title}
        if python is None and not (name == "scip" and peers.scip_is_installed()):
            yield Row(**common, status="missing", notes=(_missing(peer),))
            return
        order = settings_of(family, case, setting).get("order")
        asked = _Asked(peer, python, limit, 1 if order is None else int(order))
        row = _peer_row(common, asked, task, own, tolerance)
        yield row
        if row.status.startswith(("budget", "error", "refused")):
            return


def _missing(peer: environments.Peer) -> str:
    here = " or pip install pyscipopt" if peer.name == "scip" else ""
    return f"not installed; try python -m benchmarks environments {peer.name}{here}"


def peers_of(setting: Setting) -> tuple[str, ...]:
    """The peers among the solvers of a setting."""
    return tuple(name for name in setting.solvers if name != "sparsepop_py")


def _gaps(task: Task, own: Row | None, tolerance: float) -> list[float]:
    """Absolute gaps at which a peer may stop: for pairs, a share of our proved width."""
    if not task.pairs:
        return [tolerance]
    widths = [w for w in task.start_widths for _ in range(2)]
    if own is not None and len(own.details) == len(widths):
        proved = [
            -own.details[i + 1]["lower"] - own.details[i]["lower"] for i in range(0, len(widths), 2)
        ]
        ours = [w for w in proved for _ in range(2)]
        widths = [b if math.isfinite(b) and b > 0 else a for a, b in zip(widths, ours, strict=True)]
    return [tolerance * w for w in widths]


@dataclass(frozen=True)
class _Asked:
    """A peer, its interpreter if it has one, CPU seconds an objective, relaxation order."""

    peer: environments.Peer
    python: Path | None
    limit: float
    order: int


def _peer_row(
    common: dict[str, Any], asked: _Asked, task: Task, own: Row | None, tolerance: float
) -> Row:
    """Ask a peer, in its own interpreter where it has one, and judge its answers."""
    gaps, relative = _gaps(task, own, tolerance), 0.0 if task.pairs else tolerance
    with watched() as watch:
        try:
            answers = _answers(asked, task, gaps, relative)
        except (*DEFECTS, OSError) as error:  # what a peer cannot read or solve is a row
            return Row(**common, status=f"error: {type(error).__name__}: {error}")
    words = [a.status for a in answers]
    if len(answers) < len(task.objectives) and words[-1].startswith(("error", "refused")):
        return Row(**common, status=words[-1])
    nothing = peers.Answer(words[-1], -math.inf, math.inf, None, 0.0, 0.0)
    answers += [nothing] * (len(task.objectives) - len(answers))
    words = [a.status for a in answers]
    done = [a.status in ("infeasible", "unbounded") for a in answers]
    violations = [math.nan if a.x is None else _violation(task.problem, a.x) for a in answers]
    modelling, solving = (sum(getattr(a, f) for a in answers) for f in ("modelling", "solving"))
    return Row(
        **common,
        **_bounds(
            task,
            words,
            [a.lower for a in answers],
            [a.upper for a in answers],
            done,
            violations,
            [gap / tolerance for gap in gaps] if task.pairs and tolerance else None,
            tolerance,
        ),
        cpu_seconds=solving,
        phases={"parse": modelling, "solve": solving},
        peak_mb=watch.peak_mb if asked.python is None else math.nan,
        notes=tuple(_contradictions(task, answers, own)),
    )


def _answers(asked: _Asked, task: Task, gaps: list[float], relative: float) -> list[peers.Answer]:
    if asked.python is not None:
        stops = Stops(tuple(gaps), relative, asked.limit, asked.order)
        return ask(asked.peer, asked.python, task.problem, task.objectives, stops)
    budgets = [peers.Budget(asked.limit, gap, relative) for gap in gaps]
    pairs = zip(task.objectives, budgets, strict=True)
    return [peers.scip(task.problem, objective, budget) for objective, budget in pairs]


def _contradictions(task: Task, answers: list[peers.Answer], own: Row | None) -> Iterator[str]:
    """Say where a peer's bound or point contradicts what is proved, exactly."""
    proved = own.details if own is not None and len(own.details) == len(answers) else ()
    for answer, known, objective in zip(answers, proved, task.objectives, strict=False):
        label = known["label"]
        if answer.lower > known["upper"]:
            excess = answer.lower - known["upper"]
            yield f"{label}: its bound lies {excess:.1e} above an attained value"
        if answer.x is not None:
            below = known["lower"] - float(_exactly(objective, answer.x))
            if below > 0:
                yield f"{label}: its point lies {below:.1e} below a proved bound"


def _exactly(polynomial: sp.Polynomial, x: np.ndarray) -> Fraction:
    """The value at a vector of doubles."""
    rows = np.zeros(polynomial.coefficients.size, np.int64)
    exact = [Fraction(v) for v in x.tolist()]
    return exact_values(polynomial.words, polynomial.coefficients, rows, 1, exact)[0]


# ---- what bounds say --------------------------------------------------------------------


def _bounds(
    task: Task,
    words: list[str],
    lows: list[float],
    highs: list[float],
    done: list[bool],
    violations: list[float],
    units: list[float] | None,
    tolerance: float,
) -> dict[str, Any]:
    """The fields of a row that judge bounds and points, for a solver or a peer.

    Gaps are divided by ``units``: for pairs a peer is judged by the widths it was given.
    """
    units = units or _units(task, lows, highs)
    with np.errstate(invalid="ignore"):
        gaps = [_gap(low, high) / unit for low, high, unit in zip(lows, highs, units, strict=True)]
    gaps = [0.0 if finished else gap for finished, gap in zip(done, gaps, strict=True)]
    names = ("label", "status", "lower", "upper", "gap", "violation")
    columns = zip(task.labels, words, lows, highs, gaps, violations, strict=True)
    single = len(lows) == 1
    seen = [v for v in violations if not math.isnan(v)]
    return {
        "status": _joined(words),
        "lower": lows[0] if single else math.nan,
        "upper": highs[0] if single else math.nan,
        "gap": max(gaps),
        "closed": sum(gap <= tolerance * _ROUND_OFF for gap in gaps),
        "details": tuple(dict(zip(names, entry, strict=True)) for entry in columns),
        "valid": _valid(task.optimum, lows[0], highs[0]) if single else None,
        "violation": max(seen, default=math.nan),
        "violated": sum(v > _VIOLATED for v in seen) / len(seen) if seen else math.nan,
    }


def _units(task: Task, lows: list[float], highs: list[float]) -> list[float]:
    """What gaps are divided by: the width of the outer interval, or max(1, |upper|)."""
    if not task.pairs:
        return [max(1.0, abs(high)) if math.isfinite(high) else 1.0 for high in highs]
    widths = [-lows[i + 1] - lows[i] for i in range(0, len(lows), 2)]
    return [max(width, 1e-300) for width in widths for _ in range(2)]


def _gap(low: float, high: float) -> float:
    gap = high - low
    return max(0.0, gap) if math.isfinite(gap) else math.inf


def _joined(words: list[str]) -> str:
    """One word for all, or how many of each; a budget that ended stays in front."""
    if len(set(words)) == 1:
        return words[0]
    counts = {word: words.count(word) for word in sorted(set(words), reverse=True)}
    text = ", ".join(f"{count} {word.removeprefix('budget: ')}" for word, count in counts.items())
    return f"budget: {text}" if any(w.startswith("budget") for w in words) else text


def _valid(optimum: float | None, low: float, high: float) -> bool | None:
    if optimum is None:
        return None
    slack = _KNOWN * max(1.0, abs(optimum))
    return low <= optimum + slack and high >= optimum - slack


def _violation(problem: sp.Problem, x: np.ndarray) -> float:
    """Largest violation of a row or a bound in the user's units, by exact values."""
    exact, rows = [Fraction(v) for v in x.tolist()], problem.rows
    values = exact_values(rows.words, rows.coefficients, rows.row, rows.size, exact)
    found = [
        abs(value) if equal else -value
        for value, equal in zip(values, problem.equality.tolist(), strict=True)
    ]
    outside = np.maximum(problem.lower - x, x - problem.upper).max(initial=0.0)
    return float(max([Fraction(0), *found, Fraction(float(outside))]))


# ---- building without a solver ----------------------------------------------------------


def build_row(family: Family, case: Case, settings: Mapping[str, Any], repeat: int) -> Row:
    """CPU seconds of cliques, relaxation and assembly."""
    start = cpu_seconds()
    task = case.make()
    phases = {"parse": cpu_seconds() - start}
    options = options_from(settings)
    with watched() as watch:
        ticks = [cpu_seconds()]
        cliques = sp.find_cliques(task.problem, options.sparse, options.chordal)
        ticks.append(cpu_seconds())
        relaxation = sp.relax(task.problem, options.order, cliques=cliques)
        ticks.append(cpu_seconds())
        sp.assemble(relaxation, task.problem.objective)
        ticks.append(cpu_seconds())
    for name, spent in zip(("cliques", "relax", "assemble"), np.diff(ticks), strict=True):
        phases[name] = float(spent)
    return Row(
        **_head(family, case, task, repeat, math.nan),
        solver="sparsepop_py",
        status="built",
        cpu_seconds=watch.seconds,
        peak_mb=watch.peak_mb,
        phases=phases,
        order=relaxation.order,
        largest_block=max(relaxation.block_sizes),
        moments=relaxation.moments.shape[0],
        notes=(f"{relaxation.rows} conic rows",),
    )
