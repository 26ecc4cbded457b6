"""Search for boxes where rows hold products of parameters.

Rows in the monomials of theta bound them round by round, as :mod:`setid.proofs.lifted_products`
checks it. These rows forget that neighbouring ones share noise samples. Where static gains of 1
then leave parameters without bounds, since 1 + a1 + ... may be zero, the engine bounds the sums
over all rows with the samples that they share.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import frozen
from setid.feasible_set.sign_tree import parameter_box
from setid.feasible_set.unbounded_coefficients import limit_coefficients
from setid.formulation.formulation import Formulation
from setid.formulation.products import MonomialRows
from setid.proofs.base import gained
from setid.proofs.lifted_products import LiftedBox, joined_equations, shrunk, sum_objectives
from setid.proofs.sign_tree import ParameterBox, linear_rows

__all__ = ["completed", "lifted_box"]

Reals = NDArray[np.float64]
_ROUNDS = 3
_ROUGH = 0.02  # of the width of a sum: a box needs no more
_SECONDS = 60.0  # of wall time for all sums


def _sum_bounds(rows: MonomialRows, found: ParameterBox) -> tuple[sp.LinearBound, ...]:
    """Linear programs for the sums, on the rows and the box that was found."""
    objectives = rows.objectives()
    if found.empty or not objectives:
        return ()
    problem = linear_rows(rows.regression, (found.lower, found.upper))
    return tuple(sp.linear_bounds(problem, objectives))


def completed(
    box: LiftedBox, formulation: Formulation, rows: MonomialRows, until: float = math.inf
) -> LiftedBox:
    """The box with bounds by the engine where rows one by one leave parameters unbounded.

    Parameters
    ----------
    box : LiftedBox
    formulation : Formulation
    rows : MonomialRows
        Its rows.
    until : float
        Reading of ``time.monotonic`` at which all work ends.
    """
    for step in (_sharpened, _limited):
        if np.any(np.isinf([box.lower, box.upper])) and not box.empty:
            box = step(box, formulation, rows, until)
    return box


def _sharpened(
    box: LiftedBox, formulation: Formulation, rows: MonomialRows, until: float
) -> LiftedBox:
    """With bounds of sums of monomials over all rows at once."""
    left = min(_SECONDS, 0.5 * (until - time.monotonic()))
    if not rows.gains or not rows.sums or left <= 0:
        return box
    joined = joined_equations(formulation, rows, box.rounds[-1])
    if joined is None:
        return box
    options = sp.Options(effort="auto", gap_kind="width", gap=_ROUGH, time_limit=left)
    found = sp.solve_each(joined, sum_objectives(joined, rows), options)
    given = (result.certificate for result in found)  # emptiness is for the engine to report
    proofs = tuple(c if c is not None and np.isfinite(c.bound) else None for c in given)
    ends = np.array([box.lower, box.upper])
    ends = shrunk(rows, ends, box.rounds[-1], box.sums[-1], proofs)
    return replace(box, lower=frozen(ends[0]), upper=frozen(ends[1]), sharper=proofs)


def _limited(
    box: LiftedBox, formulation: Formulation, rows: MonomialRows, until: float
) -> LiftedBox:
    """With bounds of coefficients of maps: no consistent ones are far away."""
    ends, last = np.array([box.lower, box.upper]), box.rounds[-1]
    limit = limit_coefficients(formulation, rows, np.array([last.lower, last.upper]), ends, until)
    if limit is None:
        return box
    ends = shrunk(rows, limit.within(ends), last, box.sums[-1], box.sharper)
    return replace(box, lower=frozen(ends[0]), upper=frozen(ends[1]), limit=limit)


def lifted_box(rows: MonomialRows, start: Reals, until: float = math.inf) -> LiftedBox:
    """Bound all parameters from rows in their monomials.

    Parameters
    ----------
    rows : MonomialRows
    start : (2, p) float
        Bounds from priors.
    until : float
        Reading of ``time.monotonic`` from which on no further node is processed.
    """
    box, rounds, sums = start, list[ParameterBox](), list[tuple[sp.LinearBound, ...]]()
    for _ in range(_ROUNDS):
        found = parameter_box(rows.regression, rows.start(box), until)
        rounds.append(found)
        sums.append(_sum_bounds(rows, found))
        before, box = box, shrunk(rows, box, found, sums[-1])
        if found.empty or not gained(before, box) or time.monotonic() >= until:
            break
    ends = frozen(box[0].copy()), frozen(box[1].copy())
    return LiftedBox(rows.parameters, *ends, tuple(rounds), tuple(sums))
