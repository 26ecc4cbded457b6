"""Proofs that consistent vectors exist near given ones, by noise that is repaired exactly."""

from __future__ import annotations

from graphlib import CycleError, TopologicalSorter
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import sparsepop_py as sp
from setid.formulation.formulation import Formulation
from setid.formulation.lifting import LIFTED
from setid.priors.checked_priors import admits_box

__all__ = ["SolvedRows", "admitted", "proved_point", "rows_say_all", "solved_rows"]

_MANY = 200  # constraints beyond which they are checked in fixed point before rationals


class SolvedRows(NamedTuple):
    """Equations of a problem, and the unknown for which each is solved.

    Parameters
    ----------
    rows, solved : (r,) int
        Numbers of constraints and of variables.
    in_turn : bool
        Whether each row contains variables of rows before it alone, or follows such blocks.
    """

    rows: NDArray[np.int64]
    solved: NDArray[np.int64]
    in_turn: bool


def solved_rows(formulation: Formulation, problem: sp.Problem) -> SolvedRows | None:
    """Find the sample that each equation is solved for; None where one has none of its own.

    Parameters
    ----------
    formulation : Formulation
    problem : sp.Problem
        Its problem, or that on a box of the parameters. The objective does not count.
    """
    rows = np.flatnonzero(problem.equality)
    solved, order = _newest(formulation, rows), None
    if solved is None:
        return None
    if rows.size and len(problem.constraints) > _MANY:
        order = _in_turn(problem, rows, solved)
    if order is None:
        return SolvedRows(rows, solved, False)
    return SolvedRows(rows[order], solved[order], True)


def proved_point(
    formulation: Formulation,
    problem: sp.Problem,
    x: NDArray[np.float64],
    known: SolvedRows | None = None,
) -> sp.ProvedPoint | None:
    """Prove that a feasible point exists near x, solving equations for their newest samples.

    Parameters
    ----------
    formulation : Formulation
    problem : sp.Problem
        Its problem, or that on a box of the parameters.
    x : (n,) float
    known : SolvedRows, optional
        What :func:`solved_rows` says of the problem, where many points are proved.
    """
    known = known or solved_rows(formulation, problem)
    if known is None:
        return None
    rows, solved, in_turn = known
    if in_turn:
        point = sp.ProvedPoint(x, inf, 0.0, "substitution", rows, solved).recheck(problem)
        if point is not None or rows.size > _MANY:
            return point
    for proof in ("exact", "krawczyk") if rows.size else ("exact",):
        point = sp.ProvedPoint(x, inf, 0.0, proof, rows, solved).recheck(problem)
        if point is not None:
            return point
    order = None if in_turn or _is_linear(problem, rows, solved) else _in_turn(problem, *known[:2])
    if order is None:
        return None
    last = sp.ProvedPoint(x, inf, 0.0, "substitution", rows[order], solved[order])
    return last.recheck(problem)


def _is_linear(problem: sp.Problem, rows: NDArray[np.int64], solved: NDArray[np.int64]) -> bool:
    """Check that no row multiplies unknowns that are solved for: then rationals decide."""
    letters = problem.rows.take(rows).words
    return not np.any(np.isin(letters, solved + 1).sum(axis=1) > 1)


def _in_turn(
    problem: sp.Problem, rows: NDArray[np.int64], solved: NDArray[np.int64]
) -> NDArray[np.int64] | None:
    """Order rows so that each contains variables of rows before it; None where that fails.

    Rows that contain each other's variables form blocks. They come first, with what they need.
    """
    place = np.full(problem.dimension, -1)
    place[solved] = np.arange(solved.size)
    system = problem.rows.take(rows)
    ours = np.where(system.words > 0, place[system.words - 1], -1)
    needs: list[set[int]] = [set() for _ in range(rows.size)]
    for row, numbers in zip(system.row.tolist(), ours.tolist(), strict=True):
        needs[row].update(number for number in numbers if number not in (-1, row))
    block = list(range(rows.size))  # the first row of each row's block
    while sum(number < row for row, number in enumerate(block)) <= _MANY:
        graph: dict[int, set[int]] = {number: set() for number in block}
        for row, others in enumerate(needs):
            graph[block[row]].update({block[other] for other in others} - {block[row]})
        try:
            turns = list(TopologicalSorter(graph).static_order())
        except CycleError as cycle:
            joined = set(cycle.args[1])
            block = [min(joined) if number in joined else number for number in block]
        else:
            return _first_the_blocks(block, graph, turns)
    return None


def _first_the_blocks(
    block: list[int], graph: dict[int, set[int]], turns: list[int]
) -> NDArray[np.int64] | None:
    """Put blocks of several rows, and what they need, before others; None where they are many."""
    members: dict[int, list[int]] = {number: [] for number in turns}
    for row, number in enumerate(block):
        members[number].append(row)
    first: set[int] = set()
    for number in reversed(turns):
        if len(members[number]) > 1 or number in first:
            first |= {number} | graph[number]
    if sum(len(members[number]) for number in first) > _MANY:
        return None
    order = sorted(turns, key=lambda number: number not in first)
    return np.array([row for number in order for row in members[number]], np.int64)


def admitted(formulation: Formulation, theta: ArrayLike, radius: ArrayLike = 0.0) -> bool:
    """Prove that parameters are what the priors mean, where their rows say less.

    Parameters
    ----------
    formulation : Formulation
    theta : array_like (p,)
        That satisfy the rows of all priors.
    radius : array_like, scalar or (p,)
        How far the parameters may lie from theta.

    Returns
    -------
    bool
        False where some prior, such as ``Stable(form="jury")``, proves nothing.
    """
    centre, reach = np.broadcast_arrays(np.asarray(theta, float), np.asarray(radius, float))
    low = np.where(reach > 0, np.nextafter(centre - reach, -inf), centre)
    high = np.where(reach > 0, np.nextafter(centre + reach, inf), centre)
    pairs = zip(formulation.parameters, low.tolist(), high.tolist(), strict=True)
    box = {name: (a, b) for name, a, b in pairs}
    return all(admits_box(prior, formulation.model, box) for prior in formulation.priors)


def rows_say_all(formulation: Formulation) -> bool:
    """Check that rows say all that the priors mean, of whatever parameters.

    Parameters
    ----------
    formulation : Formulation
    """
    return admitted(formulation, np.zeros(len(formulation.parameters)), inf)


def _newest(formulation: Formulation, rows: NDArray[np.int64]) -> NDArray[np.int64] | None:
    """For each equality an unknown of its own that it gives: the newest noise sample."""
    problem, taken = formulation.problem, set(range(len(formulation.parameters)))
    layout = formulation.layout
    age = np.full(problem.dimension, -1)
    for group, numbers in formulation.layout.groups.items():
        if group != "theta":
            places = np.nonzero(numbers >= 0)
            age[numbers[places]] = places[0] if group not in ("slack", LIFTED) else 0
    order = {"eta": 1, "e": 2, "xi": 0}
    rank = np.zeros(problem.dimension, int)
    for group, value in order.items():
        numbers = formulation.layout.group(group)
        rank[numbers[numbers >= 0]] = value
    solved = []
    for row in rows.tolist():
        support = problem.constraints[row].polynomial.support.tolist()
        own = layout.groups.get(formulation.rows.equation[row])
        mine = set() if own is None else set(own[own >= 0].tolist())
        free = [v for v in support if v in mine and v not in taken] or [
            v for v in support if v not in taken
        ]
        if not free and formulation.rows.origin[row] == "prior":
            free = support[-1:]  # the normalisation gives a parameter
        if not free:
            return None
        best = max(free, key=lambda v: (age[v], rank[v]))
        taken.add(best)
        solved.append(best)
    return np.array(solved, np.int64)
