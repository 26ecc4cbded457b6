"""Intervals of variables over one feasible set, in place of 2p calls of sparsePOP.

A script that minimises and maximises each parameter calls ``sparsePOP`` twice for each. Here all
objectives share one box and one relaxation, and bounds of one serve the others.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import variables
from sparsepop_py.budget import Deadline
from sparsepop_py.compat.param import Parameters, read_parameters, stated_fields
from sparsepop_py.compat.sparsepop import in_the_given_problem, with_tolerance
from sparsepop_py.compat.structs import from_structs
from sparsepop_py.errors import ProblemError
from sparsepop_py.options import Options
from sparsepop_py.pipeline import solve_each
from sparsepop_py.problem.problem import Problem
from sparsepop_py.result import Result, Status

__all__ = ["IntervalsDetail", "interval_details", "sparsePOPintervals"]

_SECONDS = 60.0  # limit of the adaptive search where none was given


class Ends(NamedTuple):
    """Proved ends of intervals, ``lo`` and ``hi``, each of shape (k,)."""

    lo: NDArray[np.float64]
    hi: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class IntervalsDetail:
    """Intervals with what stands behind them; row i belongs to the i-th index.

    Parameters
    ----------
    indices : (k,) int
        Variables, from 1.
    lo, hi : (k,) float
        Proved: no feasible point lies outside. lo = inf and hi = -inf where no point is feasible.
    innerLo, innerHi : (k,) float
        Attained: feasible points with values at most ``innerLo``, at least ``innerHi``, provably
        exist; inf and -inf without one.
    status : (k, 2) list of str
        Status of the minimisation and of the maximisation.
    results : tuple of (Result, Result)
        Minimisation of x_i and of -x_i, with their certificates; with ``eqTolerance`` over the
        larger set, where more points are attained.
    """

    indices: NDArray[np.int64]
    lo: NDArray[np.float64]
    hi: NDArray[np.float64]
    innerLo: NDArray[np.float64]
    innerHi: NDArray[np.float64]
    status: list[list[str]]
    results: tuple[tuple[Result, Result], ...]


def sparsePOPintervals(
    ineqPolySys: Any,
    lbd: Any,
    ubd: Any,
    indices: Any = None,
    param: Any = None,
    *,
    strict: bool = False,
) -> Ends:
    """Prove intervals of chosen variables over a feasible set given by structs.

    Parameters
    ----------
    ineqPolySys : list of structs
        The constraints, as for :func:`~sparsepop_py.sparsePOP`.
    lbd, ubd : array_like (n,)
        Bounds; magnitudes of 1e10 or more stand for no bound.
    indices : int or sequence of int, optional
        Variables, counted from 1 as in MATLAB; None, ``[]`` and ``'a'`` stand for all.
    param : struct, optional
        As for :func:`~sparsepop_py.sparsePOP`, but without ``effort`` and ``tighten`` the effort
        is ``'auto'``, which closes what one relaxation leaves open. ``timeLimit`` is for all
        intervals together, then 60 seconds by default.
    strict : bool
        Unknown fields of ``param`` are errors instead of warnings.

    Returns
    -------
    Ends
        ``lo, hi``, each (k,) float in the order of ``indices``: proved, -inf and inf where
        nothing is. Where no point is feasible lo = inf and hi = -inf.

    Raises
    ------
    ProblemError
        If a struct, an index or a parameter is malformed.
    SolverNotFound
        If the chosen solver is not installed.

    Warns
    -----
    ParameterWarning
        For parameters that are unknown or have no effect.

    Examples
    --------
    >>> disc = {"typeCone": 1, "dimVar": 2, "noTerms": 3,
    ...         "supports": [[0, 0], [2, 0], [0, 2]], "coef": [4.0, -1.0, -1.0]}
    >>> lo, hi = sparsePOPintervals([disc], [-1e10, 0], [1e10, 1e10], [1, 2])
    >>> lo.round(4), hi.round(4)
    (array([-2.,  0.]), array([2., 2.]))
    """
    found = interval_details(ineqPolySys, lbd, ubd, indices, param, strict=strict, stacklevel=4)
    return Ends(found.lo, found.hi)


def interval_details(
    ineqPolySys: Any,
    lbd: Any,
    ubd: Any,
    indices: Any = None,
    param: Any = None,
    *,
    strict: bool = False,
    stacklevel: int = 3,
) -> IntervalsDetail:
    """Prove intervals as :func:`sparsePOPintervals`, with what stands behind them."""
    parameters = read_parameters(param, strict, stacklevel=stacklevel)
    options = _chosen_effort(parameters, {"effort", "tighten"} & set(stated_fields(param)))
    n = _dimension(lbd)
    anything = {"typeCone": 1, "dimVar": n, "noTerms": 1, "supports": [[0] * n], "coef": [0.0]}
    given = from_structs(anything, ineqPolySys, lbd, ubd)
    problem = with_tolerance(given, parameters.eqTolerance, bool(parameters.scalingSW))
    deadline = Deadline(options.time_limit, None, options.cpu_limit)
    chosen = _chosen(indices, n)
    x = variables(n)
    distinct = sorted(set(chosen))
    solved = solve_each(problem, [p for v in distinct for p in (x[v], -x[v])], options)
    pair = {v: (solved[2 * k], solved[2 * k + 1]) for k, v in enumerate(distinct)}
    results = tuple(pair[v] for v in chosen)
    if problem is given:
        attained = {v: [(r.upper_bound, r.status) for r in both] for v, both in pair.items()}
    else:
        attained = {v: [_attained(given, r, deadline) for r in both] for v, both in pair.items()}
    return IntervalsDetail(
        np.array(chosen, int) + 1,
        np.array([low.lower_bound for low, _ in results]),
        np.array([0.0 - high.lower_bound for _, high in results]),
        np.array([attained[v][0][0] for v in chosen]),
        np.array([0.0 - attained[v][1][0] for v in chosen]),
        [[str(status) for _, status in attained[v]] for v in chosen],
        results,
    )


def _attained(given: Problem, result: Result, deadline: Deadline) -> tuple[float, Status]:
    """Find what is attained in the problem before its equations were relaxed."""
    objective = result.problem.objective
    problem = Problem(objective, given.constraints, given.lower, given.upper, given.names)
    point, status = in_the_given_problem(problem, result, deadline)
    return math.inf if point is None else point.value, status


def _chosen_effort(parameters: Parameters, stated: set[str]) -> Options:
    """Take the adaptive search where the parameters ask for no other effort."""
    options = parameters.options
    if stated:
        return options
    limit = options.time_limit or _SECONDS
    return replace(options, effort="auto", time_limit=limit, chordal="auto", search_limit=None)


def _dimension(lbd: Any) -> int:
    try:
        shape = lbd.shape if hasattr(lbd, "shape") else np.shape(lbd)
    except (ValueError, RecursionError):
        raise ProblemError("lbd: found lists of several lengths, expected one vector") from None
    n = int(np.prod(shape))
    if not n:
        raise ProblemError(
            "lbd: found nothing, expected a bound for each variable (-1e10 for none)"
        )
    return n


def _chosen(indices: Any, n: int) -> list[int]:
    """List the variables, from 0."""
    if indices is None or (isinstance(indices, str) and indices == "a"):
        return list(range(n))
    flat: Sequence[Any] = np.asarray(indices, dtype=object).ravel().tolist()
    for index in flat:
        whole = isinstance(index, numbers.Real) and not isinstance(index, (bool, np.bool_))
        if not whole or index % 1 != 0 or not 1 <= index <= n:
            raise ProblemError(
                f"indices: found {index!r}, expected variables from 1 to {n}, or 'a' for all"
            )
    return [int(index) - 1 for index in flat] or list(range(n))
