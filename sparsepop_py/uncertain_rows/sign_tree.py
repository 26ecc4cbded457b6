"""Search for boxes of the parameters by linear programs over a pruned sign tree.

The steps and how they are checked are in :mod:`sparsepop_py.verified.uncertain_rows.sign_tree`.
"""

from __future__ import annotations

import math
import time

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.bounding.exact_linear import linear_bounds
from sparsepop_py.errors import ProblemError
from sparsepop_py.result import Status
from sparsepop_py.verified.arithmetic.array_checks import frozen
from sparsepop_py.verified.uncertain_rows.box import Box, gained
from sparsepop_py.verified.uncertain_rows.rows import UncertainRows
from sparsepop_py.verified.uncertain_rows.sign_tree import (
    LeftInverse,
    ParameterBox,
    SignTree,
    drive_and_coupling,
    halves,
    hull,
    intersect,
    linear_rows,
    nothing,
    shrunk,
    signed_variables,
)

__all__ = ["left_inverse", "parameter_box"]

Reals = NDArray[np.float64]
_MOST_LEAVES = 1024  # leaves of a sign tree at most
_MOST_ROUNDS = 4  # sign trees one after the other at most


def _left_inverse(rows: UncertainRows) -> LeftInverse | None:
    """Compute the box of least squares, if noise is small for the excitation."""
    count, p = rows.regressors.shape
    if count < p:
        return None
    with np.errstate(over="ignore"):
        weight = 1.0 / np.maximum(rows.radius + rows.radii @ np.ones(p), 1e-300)
    for power in (0.0, 0.5, 1.0):
        scale = weight**power
        with np.errstate(all="ignore"):
            inverse = left_inverse(rows.regressors * scale[:, None]) * scale
            centre = -inverse @ rows.target
            drive, coupling = drive_and_coupling(rows, inverse, centre)
        if not np.all(np.isfinite(coupling)) or np.max(np.abs(np.linalg.eigvals(coupling))) > 0.999:
            continue
        radius = np.linalg.solve(np.eye(p) - coupling, drive)
        found = LeftInverse(inverse, centre, np.asarray(radius * 1.01 + 1e-300, np.float64))
        if found.holds(rows):
            return found
    return None


def parameter_box(
    rows: UncertainRows, start: Reals | None = None, until: float = math.inf
) -> ParameterBox:
    """Bound all parameters from the data.

    Parameters
    ----------
    rows : UncertainRows
    start : (2, p) float, optional
        Bounds from priors; infinite when left out.
    until : float
        Reading of ``time.monotonic`` from which on no further node is processed. A linear
        program that has begun is ended.

    Returns
    -------
    ParameterBox

    Raises
    ------
    ProblemError
        If the rows are none, or bounds do not fit them.

    References
    ----------
    V. Cerone, "Parameter bounds for ARMAX models from records with bounded errors in
    variables", International Journal of Control 57 (1993) 225-235: orthant by orthant the
    set is a polytope.

    Examples
    --------
    Two masses on a balance whose arms are known within 2 %: m1 + m2 = 5 and m1 - m2 = 1, both
    within 0.05. The argument is checked without any linear program:

    >>> import numpy as np
    >>> from sparsepop_py.uncertain_rows import UncertainRows
    >>> arms = np.array([[1.0, 1.0], [1.0, -1.0]])
    >>> rows = UncertainRows(("m1", "m2"), [-5.0, -1.0], arms, [0.05, 0.05], 0.02 * abs(arms))
    >>> box = parameter_box(rows)
    >>> box
    <ParameterBox: m1 in [2.85294, 3.15307], m2 in [1.85294, 2.15307]>
    >>> box.verify(rows, np.array([[-np.inf, -np.inf], [np.inf, np.inf]]))
    True
    """
    if not isinstance(rows, UncertainRows):
        raise ProblemError(f"rows: found {type(rows).__name__}, expected UncertainRows")
    p = len(rows.names)
    first = np.array([np.full(p, -np.inf), np.full(p, np.inf)]) if start is None else start
    if np.shape(first) != (2, p):
        raise ProblemError(f"start: found shape {np.shape(first)}, expected {(2, p)}")
    box, steps = (first[0], first[1]), list[LeftInverse | SignTree]()
    if np.any(np.isinf(first)):
        found = _left_inverse(rows)
        if found is not None:
            steps.append(found)
            box = intersect(box, found.box())
    for _ in range(_MOST_ROUNDS):
        if np.any(box[0] > box[1]):
            break
        before, whole = box, len(steps) < 2 and bool(np.all(np.isfinite(box)))
        tree, box = _process_node(rows, box, [0 if whole else _MOST_LEAVES], until)
        steps.append(tree)
        if not whole and not gained(before, box):
            break
    lower, upper = frozen(box[0].copy()), frozen(box[1].copy())
    return ParameterBox(rows.names, lower, upper, frozen(first.copy()), tuple(steps))


def _process_node(
    rows: UncertainRows, box: Box, left: list[int], until: float
) -> tuple[SignTree, Box]:
    """Process one node: bound it, or branch at zero of an open sign."""
    if time.monotonic() >= until:
        return SignTree(-1, (), ()), box
    place = _undecided(rows, box)
    leaf = place is None or left[0] < 2
    objectives = signed_variables(len(rows.names))
    bounds = tuple(linear_bounds(linear_rows(rows, box), objectives[: None if leaf else 1]))
    if bounds[0].status is Status.INFEASIBLE:
        return SignTree(-1, (), bounds[:1]), nothing(box)
    if place is None or leaf:
        return SignTree(-1, (), bounds), shrunk(box, bounds)
    left[0] -= 1
    grown = [_process_node(rows, half, left, until) for half in halves(box, place)]
    return SignTree(place, tuple(tree for tree, _ in grown), ()), hull([b for _, b in grown])


def _undecided(rows: UncertainRows, box: Box) -> int | None:
    """Select the parameter whose open sign costs most, None if all are settled."""
    low, high = box
    open_ = (low < 0) & (high > 0) & (rows.radii.max(axis=0, initial=0.0) > 0)
    if not np.any(open_):
        return None
    reach = np.where(open_, np.minimum(-low, high), 0.0)
    cost = np.where(open_, np.where(np.isinf(reach), 1e300, reach), -1.0)
    weight = rows.radii.max(axis=0)
    return int(np.argmax(cost * np.maximum(weight / weight.max(), 1e-300)))


# ---- rows on a box ----------------------------------------------------------------------


def left_inverse(matrix: Reals) -> Reals:
    """Compute the pseudoinverse (p, R) with columns of one size.

    So no column counts as zero.

    Parameters
    ----------
    matrix : (R, p) float

    Returns
    -------
    (p, R) float
    """
    size = np.abs(matrix).max(axis=0, initial=0.0)
    units = np.ldexp(1.0, np.frexp(np.where(size > 0, size, 1.0))[1])
    with np.errstate(over="ignore"):
        found = np.linalg.pinv(matrix / units) / units[:, None]
    return np.nan_to_num(found, posinf=0.0, neginf=0.0)  # for columns whose inverse is no double
