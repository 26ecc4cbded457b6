"""Peers beside sparsepop_py: today SCIP, by spatial branch and bound.

SCIP works in floating point with feasibility tolerances: its bounds and points are claims,
and a row of results says so.
"""

from __future__ import annotations

import importlib.util
import math
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import reduce
from operator import mul
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp

__all__ = ["Answer", "Budget", "scip", "scip_is_installed"]

_ENDLESS = 1e19  # SCIP's infinity is 1e20; what comes near it says nothing
_OUT_OF_BUDGET = {"timelimit", "memlimit", "nodelimit", "totalnodelimit", "stallnodelimit"}


@dataclass(frozen=True)
class Budget:
    """What a peer may use for one objective.

    Parameters
    ----------
    seconds : float
        Of CPU time.
    absolute_gap, relative_gap : float
        It may stop at either; 0 switches one off.
    megabytes : float
    """

    seconds: float
    absolute_gap: float
    relative_gap: float = 0.0
    megabytes: float = 4000.0


@dataclass(frozen=True, eq=False)
class Answer:
    """What a peer claims about one objective.

    Parameters
    ----------
    status : str
        Its own word, after "budget: " where it ran out of it.
    lower, upper : float
        Claimed bound and value of its best point.
    x : (n,) float or None
    modelling, solving : float
        CPU seconds to put the problem into its form, and to solve it.
    """

    status: str
    lower: float
    upper: float
    x: NDArray[np.float64] | None
    modelling: float
    solving: float


def scip_is_installed() -> bool:
    """Whether pyscipopt can be imported."""
    return importlib.util.find_spec("pyscipopt") is not None


def scip(problem: sp.Problem, objective: sp.Polynomial, budget: Budget) -> Answer:
    """Minimise an objective over the feasible set of a problem with SCIP.

    An objective that is not linear becomes a variable that bounds it from above.

    Raises
    ------
    RuntimeError
        If SCIP breaks off.
    """
    start = time.process_time()
    model, x = _model(problem, objective, budget)
    middle = time.process_time()
    try:
        with _silence():
            model.optimize()
    except Exception as error:  # pyscipopt knows no other class
        if type(error) is not Exception:
            raise
        raise RuntimeError(str(error)) from error
    seconds = time.process_time() - middle
    status = model.getStatus()
    point = np.array([model.getVal(v) for v in x]) if model.getNSols() else None
    return Answer(
        f"budget: {status}" if status in _OUT_OF_BUDGET else status,
        _number(model.getDualbound()),
        _number(model.getPrimalbound()) if point is not None else math.inf,
        point,
        middle - start,
        seconds,
    )


@contextmanager
def _silence() -> Iterator[None]:
    """Keep what libraries below SCIP print past Python off the screen."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [os.dup(1), os.dup(2)]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        yield
    finally:
        for copy, descriptor in zip(kept, (1, 2), strict=True):
            os.dup2(copy, descriptor)
            os.close(copy)
        os.close(nowhere)


def _model(problem: sp.Problem, objective: sp.Polynomial, budget: Budget) -> tuple[Any, list[Any]]:
    from pyscipopt import Model

    model = Model()
    model.hideOutput()
    settings = {
        "timing/clocktype": 1,  # CPU seconds
        "limits/time": budget.seconds,
        "limits/memory": budget.megabytes,
        "limits/absgap": budget.absolute_gap,
        "limits/gap": budget.relative_gap,
    }
    for name, value in settings.items():
        model.setParam(name, value)
    ends = zip(problem.lower.tolist(), problem.upper.tolist(), strict=True)
    x = [model.addVar(lb=_bound(low), ub=_bound(high)) for low, high in ends]
    for row in problem.constraints:
        if row.polynomial.degree == 0:
            continue  # a number, which SCIP refuses as a row
        body = _expression(row.polynomial, x)
        model.addCons(body == 0 if row.kind is sp.Kind.ZERO else body >= 0)
    if objective.degree <= 1:
        model.setObjective(_expression(objective, x))
    else:
        least = model.addVar(lb=None, ub=None)
        model.addCons(_expression(objective, x) - least <= 0)
        model.setObjective(least)
    return model, x


def _bound(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _expression(polynomial: sp.Polynomial, x: list[Any]) -> Any:
    """The polynomial in SCIP's variables."""
    from pyscipopt import quicksum

    terms = zip(polynomial.words.tolist(), polynomial.coefficients.tolist(), strict=True)
    return quicksum(
        reduce(mul, (x[letter - 1] for letter in word if letter), value) for word, value in terms
    )


def _number(value: float) -> float:
    return value if abs(value) < _ENDLESS else math.copysign(math.inf, value)
