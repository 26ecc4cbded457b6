"""Relaxations that fit: what to do when the one asked for is too large to solve.

An interior-point step costs about sum r^3 / 3 operations and 8 sum r^2 bytes, r being
the number s (s + 1) / 2 of entries of each semidefinite block. Where that is too much,
bounds enter linearly and unmatched monomials leave (``lean``), and where even that does
not fit the order comes down. Each change is noted; every bound stays proved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import comb

import numpy as np

from .options import Options
from .polynomial import Polynomial
from .problem import Problem
from .relaxation import Relaxation, least_order, relax
from .sparsity import Cliques

__all__ = ["fitting_relaxation", "solver_bytes"]

_OPERATIONS = 1e10  # a step; above, the lean form is tried
_BYTES = 5e9
_BASIS = 1500  # monomials of one clique; above, a relaxation is not even built


def solver_bytes(relaxation: Relaxation) -> float:
    """About how much memory an interior-point solver needs for the blocks."""
    return float(sum(12.0 * _entries(s) ** 2 * k for s, k in relaxation.block_sizes.items()))


def _entries(size: int) -> float:
    return size * (size + 1) / 2.0


def _operations(relaxation: Relaxation) -> float:
    return float(sum(_entries(s) ** 3 * k / 3.0 for s, k in relaxation.block_sizes.items()))


def fitting_relaxation(
    problem: Problem, cliques: Cliques, objectives: Sequence[Polynomial], options: Options
) -> tuple[Relaxation | None, tuple[str, ...]]:
    """The relaxation that was asked for, or the nearest one that fits, and what was changed.

    Parameters
    ----------
    problem : Problem
        Scaled.
    cliques : Cliques
    objectives : sequence of Polynomial
    options : Options
        With effort ``"plain"`` nothing is changed: the relaxation fits or there is none.

    Returns
    -------
    relaxation : Relaxation or None
    notes : tuple of str
    """
    least = least_order(problem, objectives)
    asked = options.order or least
    largest = max(len(c) for c in cliques.members)
    for order in range(max(asked, least), least - 1, -1):
        if comb(largest + order, order) > _BASIS:
            continue
        relaxation = relax(problem, order, cliques=cliques, objectives=objectives)
        notes: tuple[str, ...] = ()
        if asked < least:
            notes = (f"order {asked} raised to {least}, the least for these degrees",)
        if options.effort == "plain":
            fits = solver_bytes(relaxation) <= _BYTES and order >= asked
            return (replace(relaxation, notes=notes), ()) if fits else (None, _too_large(asked))
        if _operations(relaxation) > _OPERATIONS:
            lean = relax(problem, order, cliques=cliques, objectives=objectives, lean=True)
            if _operations(lean) < _operations(relaxation):
                large, small = max(relaxation.block_sizes), max(lean.block_sizes)
                relaxation = lean
                notes += (
                    f"bounds enter linearly: blocks of up to {small} instead of {large}",
                )
        if solver_bytes(relaxation) <= _BYTES:
            if order < asked:
                notes += (f"order {asked} lowered to {order}: its blocks would not fit in memory",)
            return replace(relaxation, notes=notes), ()
    return None, _too_large(asked)


def _too_large(order: int) -> tuple[str, ...]:
    return (
        f"the relaxation of order {order} needs more than {_BYTES / 1e9:.0f} GB; "
        "lower the order or exploit more sparsity",
    )
