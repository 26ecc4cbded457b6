"""The centre of the outer box, its proved worst-case error, and its consistency.

It is (low + high) / 2, and no consistent parameter is further away than (high - low) / 2.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from math import inf

import numpy as np
from numpy.typing import ArrayLike, NDArray

import sparsepop_py as sp
from setid.data.checks import frozen, real_array, seconds_of
from setid.errors import SetidError
from setid.feasible_points.members import ROUNDING, noise_level
from setid.feasible_points.witness import consistent
from setid.feasible_set.feasible_set import FeasibleSet, check_result
from setid.formulation.formulation import Formulation
from setid.formulation.units import in_units
from setid.proofs.existence import admitted
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.budget import Deadline, LimitReached, check
from sparsepop_py.verified.arithmetic.display import rounded

__all__ = ["Central", "central", "is_consistent", "worst_case_error"]

Reals = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Central(ReadOnly):
    """The centre of the outer box: least worst-case error of each parameter by itself.

    Parameters
    ----------
    names : tuple of str
    theta : (p,) float
    error : (p,) float
        No consistent parameter is further away than this (proved): half the widths.
    level : float
        Factor on the noise bounds with which ``theta`` explains the data (computed, not
        proved); infinite where none does, NaN where no linear program can tell or time was over.
    member : bool or None
        Whether the centre is consistent, proved either way; None where neither was proved in the
        time given.

    Notes
    -----
    The centre need not be consistent: the feasible set is not convex in general, and even
    a polytope may miss the centre of its box.

    References
    ----------
    M. Milanese, A. Vicino, "Optimal estimation theory for dynamic systems with set
    membership uncertainty: an overview", Automatica 27 (1991) 997-1009, section 3.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> result.centre.member, result.centre.error.round(3)
    (True, array([0.089, 0.096]))
    """

    names: tuple[str, ...]
    theta: Reals
    error: Reals
    level: float
    member: bool | None

    def __str__(self) -> str:
        pairs = zip(self.names, self.theta.tolist(), self.error.tolist(), strict=True)
        text = ", ".join(f"{name} = {_about(t, e)}" for name, t, e in pairs)
        return f"{text} (errors proved; {_MEMBERSHIP[self.member]})"


def _about(value: float, error: float) -> str:
    """Write a value and its error, which holds of the digits shown."""
    if not error < inf:
        return f"{value:.6g} +- inf"
    for digits in range(6, 18):
        text = f"{value:.{digits}g}"
        moved = abs(Fraction(text) - Fraction(value))
        if moved <= Fraction(error) / 100:
            break
    shown = float(np.nextafter(float(Fraction(error) + moved), inf))
    return f"{text} +- {rounded(shown, True, 3)}"


_MEMBERSHIP = {
    True: "consistent with the data, proved",
    False: "proved not to be consistent with the data itself: result.feasible is, where a member "
    "is known",
    None: "whether it is consistent with the data is not proved",
}


def central(result: FeasibleSet, time_limit: float = 10.0) -> Central:
    """Find the centre of the outer intervals, its worst-case error, and its consistency.

    Parameters
    ----------
    result : FeasibleSet
    time_limit : float
        Seconds for the two questions that need a search: with which factor on the noise bounds
        the centre explains the record (``level``), and whether it is consistent (``member``).
        Both stay open where time is over; a proof under way may take a fifth longer. Centre and
        error follow from the intervals at once.

    Returns
    -------
    Central
        With ``theta`` (p,), ``error`` (p,), ``level`` and ``member``.

    Raises
    ------
    SetidError
        If the feasible set is empty or an outer interval is not finite, or the limit is no number
        of at least 0.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> centre = setid.central(result)
    >>> centre.theta.round(4), centre.error.round(3), centre.member
    (array([-0.4343,  2.013 ]), array([0.089, 0.096]), True)
    """
    check_result(result)
    deadline = Deadline(seconds_of(time_limit))
    result.require_members()
    theta = result.middle
    if theta is None:
        wide = [n for n, v in result.intervals.items() if not np.isfinite(v.width)]
        raise SetidError(
            f"result: found no finite interval of {', '.join(wide)}, expected all finite; "
            "give priors such as Box, or a record with more excitation"
        )
    formulation, error = result.formulation, worst_case_error(result, theta)
    level, member = float("nan"), None
    with suppress(LimitReached), deadline.kept():
        check()
        level = noise_level(formulation, theta)
        member = is_consistent(formulation, theta, deadline.left)
    return Central(formulation.parameters, frozen(theta), frozen(error), level, member)


def worst_case_error(result: FeasibleSet, theta: ArrayLike) -> Reals:
    """Bound the distance of each consistent parameter from an estimate.

    Parameters
    ----------
    result : FeasibleSet
    theta : array_like (p,)
        Any estimate, consistent or not.

    Returns
    -------
    (p,) float
        Infinite where an outer interval is.

    Raises
    ------
    SetidError
        If the feasible set is empty.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> setid.worst_case_error(result, [-0.5, 2.0]).round(4)
    array([0.1547, 0.1093])
    """
    check_result(result)
    result.require_members()
    low, high = result.outer_box
    values = real_array(theta, "theta", SetidError)
    if values.shape != low.shape:
        raise SetidError(f"theta: found shape {values.shape}, expected {low.shape}")
    with np.errstate(invalid="ignore"):
        error = np.nextafter(np.maximum(high - values, values - low), inf)
    return np.where(np.isnan(error), inf, error)


def is_consistent(
    formulation: Formulation, theta: Reals, seconds: float | None = None
) -> bool | None:
    """Prove that a parameter vector is consistent, or that it is not; None without a proof.

    A witness whose noise is repaired exactly proves that it is. That it is not is what the
    engine proves of the problem with these parameters fixed.

    Parameters
    ----------
    formulation : Formulation
    theta : (p,) float
    seconds : float, optional
        Of the engine; no limit when left out.
    """
    if consistent(formulation, theta) is not None:
        return True
    level = noise_level(formulation, theta)
    if level <= 1.0 + ROUNDING:
        return None  # on the edge, within rounding
    problem, p = formulation.problem, len(formulation.parameters)
    if np.any(theta < problem.lower[:p]) or np.any(theta > problem.upper[:p]):
        return False
    lower, upper = problem.lower.copy(), problem.upper.copy()
    lower[:p] = upper[:p] = theta
    nothing = 0.0 * problem.objective
    fixed = sp.Problem(nothing, problem.constraints, lower, upper, problem.names)
    options = sp.Options(effort="auto", time_limit=seconds)
    found = sp.solve(in_units(fixed, formulation).problem, options)
    if found.attained is not None:
        return True if admitted(formulation, theta) else None
    return False if found.status is sp.Status.INFEASIBLE else None
