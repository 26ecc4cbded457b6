"""Search for boxes where rows hold products of parameters.

Rows in the monomials of theta bound them round by round, as
:mod:`sparsepop_py.verified.uncertain_rows.lifted_products` checks it. These rows forget which
uncertain numbers they share. Where gains of 1 then leave parameters without bounds, since 1 + a1
+ ... may be zero, the engine bounds the sums over all rows with the numbers that they share.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.bounding.exact_linear import linear_bounds
from sparsepop_py.budget import Deadline
from sparsepop_py.options import Options
from sparsepop_py.pipeline import solve_each
from sparsepop_py.uncertain_rows.sign_tree import parameter_box
from sparsepop_py.uncertain_rows.unbounded_coefficients import limit_coefficients
from sparsepop_py.verified.arithmetic.array_checks import frozen
from sparsepop_py.verified.certificate.linear_bound import LinearBound
from sparsepop_py.verified.uncertain_rows.box import gained
from sparsepop_py.verified.uncertain_rows.coupled import CoupledRows
from sparsepop_py.verified.uncertain_rows.lifted_products import (
    LiftedBox,
    joined_equations,
    shrunk,
    sum_objectives,
)
from sparsepop_py.verified.uncertain_rows.products import ProductRows
from sparsepop_py.verified.uncertain_rows.sign_tree import ParameterBox, linear_rows

__all__ = ["complete_box", "lifted_box"]

Reals = NDArray[np.float64]
_ROUNDS = 3
_ROUGH = 0.02  # of the width of a sum: a box needs no more
_MOST = 60.0  # seconds for all sums, or units of work


def _sum_bounds(rows: ProductRows, found: ParameterBox) -> tuple[LinearBound, ...]:
    """Linear programs for the sums, on the rows and the box that was found."""
    objectives = rows.objectives()
    if found.empty or not objectives:
        return ()
    problem = linear_rows(rows.regression, (found.lower, found.upper))
    return tuple(linear_bounds(problem, objectives))


def complete_box(
    box: LiftedBox, coupled: CoupledRows, rows: ProductRows, until: float = math.inf
) -> LiftedBox:
    """Bound by the engine parameters that rows one by one leave unbounded.

    Parameters
    ----------
    box : LiftedBox
    coupled : CoupledRows
    rows : ProductRows
        Its rows.
    until : float
        Reading of ``time.monotonic`` at which all work ends.

    Returns
    -------
    LiftedBox
    """
    for step in (_sharpened, _limited):
        if np.any(np.isinf([box.lower, box.upper])) and not box.empty:
            box = step(box, coupled, rows, until)
    return box


def _sharpened(box: LiftedBox, coupled: CoupledRows, rows: ProductRows, until: float) -> LiftedBox:
    """Add bounds of sums of monomials over all rows at once."""
    deadline = Deadline.before(until, _MOST, 0.5)
    if not rows.gains or not rows.sums or deadline.over:
        return box
    joined = joined_equations(coupled, rows, box.rounds[-1])
    if joined is None:
        return box
    options = replace(Options(effort="auto", gap_kind="width", gap=_ROUGH), **deadline.limits)
    found = solve_each(joined, sum_objectives(joined, rows), options)
    given = (result.certificate for result in found)  # emptiness is for the engine to report
    proofs = tuple(c if c is not None and np.isfinite(c.bound) else None for c in given)
    ends = np.array([box.lower, box.upper])
    ends = shrunk(rows, ends, box.rounds[-1], box.sums[-1], proofs)
    return replace(box, lower=frozen(ends[0]), upper=frozen(ends[1]), sharper=proofs)


def _limited(box: LiftedBox, coupled: CoupledRows, rows: ProductRows, until: float) -> LiftedBox:
    """Add bounds of coefficients of maps: no consistent ones are far away."""
    ends, last = np.array([box.lower, box.upper]), box.rounds[-1]
    limit = limit_coefficients(coupled, rows, np.array([last.lower, last.upper]), ends, until)
    if limit is None:
        return box
    ends = shrunk(rows, limit.within(ends), last, box.sums[-1], box.sharper)
    return replace(box, lower=frozen(ends[0]), upper=frozen(ends[1]), limit=limit)


def lifted_box(rows: ProductRows, start: Reals, until: float = math.inf) -> LiftedBox:
    """Bound all parameters from rows in their monomials.

    Parameters
    ----------
    rows : ProductRows
    start : (2, p) float
        Bounds from priors.
    until : float
        Reading of ``time.monotonic`` from which on no further node is processed.
    """
    box, rounds, sums = start, list[ParameterBox](), list[tuple[LinearBound, ...]]()
    for _ in range(_ROUNDS):
        found = parameter_box(rows.regression, rows.start(box), until)
        rounds.append(found)
        sums.append(_sum_bounds(rows, found))
        before, box = box, shrunk(rows, box, found, sums[-1])
        if found.empty or not gained(before, box) or time.monotonic() >= until:
            break
    ends = frozen(box[0].copy()), frozen(box[1].copy())
    return LiftedBox(rows.parameters, *ends, tuple(rounds), tuple(sums))
