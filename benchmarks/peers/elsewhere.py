"""Ask a peer in an interpreter of its own: a task as JSON to its adapter, answers back.

Whatever becomes of the peer is an answer: one that breaks off, refuses or takes far longer than
its budget leaves the answers that it gave by then, and one more that says why there are no others.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import sparsepop_py as sp

from .environments import Peer
from .scip import Answer

__all__ = ["Stops", "ask", "task_of"]

_ADAPTERS = Path(__file__).resolve().parent / "adapters"
_PATIENCE, _START = 2.0, 30.0  # times the budget, and seconds on top, until it is ended


@dataclass(frozen=True)
class Stops:
    """When a peer may stop.

    Parameters
    ----------
    gaps : tuple of float
        Absolute gaps, one for each objective.
    relative : float
        Relative gap; 0 for none.
    seconds : float
        CPU seconds for one objective.
    order : int
        Relaxation order of peers that have one; raised to the least legal one.
    """

    gaps: tuple[float, ...]
    relative: float
    seconds: float
    order: int = 1


def ask(
    peer: Peer,
    python: Path,
    problem: sp.Problem,
    objectives: Sequence[sp.Polynomial],
    stops: Stops,
) -> list[Answer]:
    """Minimise objectives over the feasible set of a problem with a peer.

    Parameters
    ----------
    peer : Peer
    python : Path
        The interpreter of its environment.
    problem : Problem
    objectives : sequence of Polynomial
    stops : Stops

    Returns
    -------
    list of Answer
        As many as there are objectives, or fewer, of which the last says why.
    """
    task = task_of(peer, problem, objectives, stops.order)
    task |= {"gaps": list(stops.gaps), "relative": stops.relative, "seconds": stops.seconds}
    with tempfile.TemporaryDirectory() as folder:
        asked, answers = Path(folder) / "task.json", Path(folder) / "answers.jsonl"
        asked.write_text(json.dumps(task), encoding="utf-8")
        command = [str(python), str(_ADAPTERS / peer.adapter), str(asked), str(answers)]
        ended = _ended([*command, *peer.arguments], folder, len(objectives) * stops.seconds)
        lines = answers.read_text(encoding="utf-8").splitlines() if answers.exists() else []
    found = [_answer(json.loads(line), problem.dimension) for line in lines if line.endswith("}")]
    stopped = bool(found) and found[-1].status.startswith(("refused", "error"))
    if len(found) < len(objectives) and not stopped:
        found.append(Answer(ended, -math.inf, math.inf, None, 0.0, 0.0))
    return found


def task_of(
    peer: Peer, problem: sp.Problem, objectives: Sequence[sp.Polynomial], order: int = 1
) -> dict[str, Any]:
    """The task of an adapter, see ``adapters/common.py``; without gaps and seconds."""
    task: dict[str, Any] = {
        "n": problem.dimension,
        "lower": problem.lower.tolist(),
        "upper": problem.upper.tolist(),
        "rows": [
            {"equal": row.kind is sp.Kind.ZERO, "terms": _terms(row.polynomial)}
            for row in problem.constraints
        ],
        "objectives": [_terms(objective) for objective in objectives],
        "order": max([order, *((p.degree + 1) // 2 for p in (*objectives, problem))]),
    }
    if peer.conic:
        relaxation = sp.relax(problem, task["order"], objectives=tuple(objectives))
        programs = [sp.assemble(relaxation, objective) for objective in objectives]
        task["programs"] = [_program(program) for program in programs]
    return task


def _terms(polynomial: sp.Polynomial) -> list[tuple[float, list[int]]]:
    pairs = zip(polynomial.coefficients.tolist(), polynomial.words.tolist(), strict=True)
    return [(value, [letter - 1 for letter in word if letter]) for value, word in pairs]


def _program(program: sp.ConicProgram) -> dict[str, Any]:
    A = program.A.tocoo()
    return {
        "q": program.q.tolist(),
        "b": program.b.tolist(),
        "A": [A.row.tolist(), A.col.tolist(), A.data.tolist()],
        "zero": program.cones.zero,
        "nonnegative": program.cones.nonnegative,
        "psd": list(program.cones.psd),
        "offset": float(program.offset),
    }


def _ended(command: list[str], folder: str, seconds: float) -> str:
    """Run an adapter; say how it ended, for objectives that it left."""
    single = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env=kept | single,
            capture_output=True,
            text=True,
            timeout=_PATIENCE * seconds + _START,
        )
    except subprocess.TimeoutExpired:
        return "budget: ended after twice its time"
    except OSError as error:
        return f"error: {error}"
    last = done.stderr.strip().splitlines()[-1:]
    return f"error: {' '.join(last)[:200] or f'exit code {done.returncode}'}"


def _answer(found: dict[str, Any], dimension: int) -> Answer:
    x = None if found["x"] is None else np.array(found["x"], float)
    if x is not None and (x.shape != (dimension,) or not np.all(np.isfinite(x))):
        x = None
    low, high = (float(found[name]) for name in ("lower", "upper"))
    low = -math.inf if math.isnan(low) else low
    high = math.inf if x is None or math.isnan(high) else high
    return Answer(found["status"], low, high, x, found["modelling"], found["solving"])
