"""Find members of the feasible parameter set: attained points and points between them.

Nothing here is a cover of the set: what is drawn from members is labelled *sampled*.
"""

from __future__ import annotations

import time
from math import inf
from weakref import WeakKeyDictionary

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import frozen, natural, seconds_of
from setid.errors import ModelError, SetidError
from setid.feasible_points.witness import Witness, least_noise
from setid.feasible_set.feasible_set import FeasibleSet, check_result
from setid.formulation.formulation import Formulation
from setid.models.general import nonlinear_rows
from setid.proofs.existence import admitted
from sparsepop_py.lp.scaled import solve_scaled

__all__ = [
    "ROUNDING",
    "draws_of",
    "feasible",
    "is_member",
    "members",
    "noise_level",
    "nominal",
    "projection_estimate",
]

Reals = NDArray[np.float64]
_MOST = 10**6  # mixtures that are drawn at once
# of each set and seed, whether mixtures are consistent, by their numbers in the order of drawing
_TRIED: WeakKeyDictionary[FeasibleSet, dict[int, dict[int, bool]]] = WeakKeyDictionary()
ROUNDING = 1e-9  # excess of the noise level that is put down to the linear program


def noise_level(formulation: Formulation, theta: Reals) -> float:
    """Compute the factor on all noise bounds that parameters need, up to rounding.

    Parameters
    ----------
    formulation : Formulation
    theta : (p,) float

    Returns
    -------
    float
        Infinite where no noise suffices, or bounds or priors exclude theta; NaN where no linear
        program can tell.
    """
    try:
        witness: Witness = least_noise(formulation, theta)
    except ModelError:
        return float("nan")
    if not np.isfinite(witness.level):
        return inf
    p = theta.size
    problem = formulation.problem
    ends = np.array([problem.lower[:p], problem.upper[:p]])
    tiny = ROUNDING * (np.abs(theta) + np.abs(np.where(np.isfinite(ends), ends, 0.0)).max(axis=0))
    inside = np.all(theta >= ends[0] - tiny) and np.all(theta <= ends[1] + tiny)
    known = _priors_hold(formulation, witness.x) and admitted(formulation, theta)
    return witness.level if inside and known else inf


def is_member(formulation: Formulation, theta: Reals) -> bool:
    """Check parameters against data, noise bounds and priors, up to rounding; no proof.

    Parameters
    ----------
    formulation : Formulation
    theta : (p,) float
    """
    return noise_level(formulation, theta) <= 1.0 + ROUNDING


def _priors_hold(formulation: Formulation, x: Reals) -> bool:
    """Check rows of priors, which the least-noise program takes for granted or leaves out."""
    for row, origin in zip(formulation.problem.constraints, formulation.rows.origin, strict=True):
        if origin != "model":
            p = row.polynomial
            sizes = sp.Polynomial(p.words, frozen(np.abs(p.coefficients)), p.dimension)
            value, size = p(x), sizes(np.abs(x)) * ROUNDING
            if value < -size or (row.kind.name == "ZERO" and value > size):
                return False
    return True


# ---- members ----------------------------------------------------------------------------


def members(result: FeasibleSet, count: int = 100, seed: int = 0, time_limit: float = inf) -> Reals:
    """List consistent parameter vectors: attained ones, and consistent mixtures of them.

    Parameters
    ----------
    result : FeasibleSet
    count : int
        Mixtures that are tried; those that the data refute are left out.
    seed : int
    time_limit : float
        Seconds after which no further mixture is tried. Those that were tried for the same result
        and seed before are not tried again.

    Returns
    -------
    (M, p) float
        Attained ones first. Samples, not a cover.

    Raises
    ------
    SetidError
        If no member is known, or more than a million mixtures are asked for.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> found = setid.members(result, count=5)
    >>> found.shape[1]
    2
    """
    check_result(result)
    result.require_members()
    tries, start = draws_of(count, seed, "count")
    known = result.attained
    if not len(known):
        known = _consistent_centre(result)
    if not len(known):
        raise SetidError(
            "result: found no consistent parameter vector to draw from; identify with a "
            "larger time limit, or use what is proved instead"
        )
    weights = np.random.default_rng(start).dirichlet(np.full(len(known), 0.5), tries)
    mixed = weights @ known
    until = time.monotonic() + seconds_of(time_limit)
    tried = _TRIED.setdefault(result, {}).setdefault(start, {})
    for number, theta in enumerate(mixed):
        if number not in tried and time.monotonic() < until:
            tried[number] = is_member(result.formulation, theta)
    keep = [theta for number, theta in enumerate(mixed) if tried.get(number)]
    return np.concatenate([known, np.reshape(keep, (-1, known.shape[1]))])


def draws_of(samples: int, seed: int, field: str = "samples") -> tuple[int, int]:
    """Check the number of mixtures and the seed, also where neither is needed.

    Parameters
    ----------
    samples, seed : int
    field : str
        What the message calls the number.

    Raises
    ------
    SetidError
        If they are no integers >= 0, or memory would not hold the mixtures.
    """
    count = natural(samples, field, SetidError)
    if count > _MOST:
        raise SetidError(f"{field}: found {count}, expected at most {_MOST}")
    return count, natural(seed, "seed", SetidError)


def _consistent_centre(result: FeasibleSet) -> Reals:
    """Return the centre where it is a member, (1, p), else none, (0, p)."""
    theta = result.middle
    if theta is None or not is_member(result.formulation, theta):
        return np.zeros((0, len(result.formulation.parameters)))
    return theta[None, :]


def feasible(result: FeasibleSet) -> Reals:
    """Find a consistent parameter vector, well inside where the set is convex.

    Parameters
    ----------
    result : FeasibleSet

    Returns
    -------
    (p,) float
        The mean of the attained vectors, where that is consistent. Otherwise the attained vector
        that needs the least noise. Where that cannot be computed by a linear program, the one
        that is nearest to the mean.

    Raises
    ------
    SetidError
        If the set is proved empty, or no consistent vector is known.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> theta = setid.feasible(result)
    >>> bool(abs(theta[0] - result.intervals["a1"].centre) < 0.1)
    True
    """
    check_result(result)
    known = members(result, count=0)
    middle = known.mean(axis=0)
    if is_member(result.formulation, middle):
        return np.asarray(middle, np.float64)
    levels = np.array([noise_level(result.formulation, theta) for theta in known])
    if np.all(np.isnan(levels)):  # no linear program can tell: those that attain are proved
        levels = np.linalg.norm(known - middle, axis=1)
    return np.asarray(known[int(np.nanargmin(levels))], np.float64)


def projection_estimate(result: FeasibleSet) -> Reals:
    """Fit the parameter vector whose equations suit the readings best in the worst row.

    Minimises the largest abs(Y_k + R_k theta) over the outer box, by a linear program; for
    equation errors this is the least noise bound that explains the data.

    Parameters
    ----------
    result : FeasibleSet

    Returns
    -------
    (p,) float

    Raises
    ------
    ModelError
        If the structure is not linear in its parameters.

    References
    ----------
    M. Milanese, A. Vicino, Automatica 27 (1991) 997-1009, section 4 (projection estimates).

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> setid.projection_estimate(result).round(4)
    array([-0.3883,  1.9703])
    """
    check_result(result)
    result.require_members()
    rows = result.formulation.regression
    if rows is None:
        what = nonlinear_rows(result.formulation.model)
        raise ModelError(f"model: {what} have no regression form to project on")
    one = np.ones((rows.target.size, 1))
    matrix = np.block([[rows.regressors, -one], [-rows.regressors, -one]])
    right = np.concatenate([-rows.target, rows.target])
    low, high = result.outer_box
    cost = np.append(np.zeros(low.size), 1.0)
    bounds = np.append(low, 0.0), np.append(high, inf)
    found = solve_scaled(cost, (sps.csr_array(matrix), right), None, bounds)
    if found.status != "solved":
        raise SetidError("result: the linear program has no solution; are numbers near overflow?")
    return found.x[:-1]


def nominal(result: FeasibleSet) -> Reals:
    """Choose the centre where consistent, else a consistent vector, else the centre anyway.

    Parameters
    ----------
    result : FeasibleSet

    Returns
    -------
    (p,) float

    Raises
    ------
    SetidError
        If the set is proved empty, or there is neither a finite box nor a consistent vector.
    """
    result.require_members()
    centre = result.middle
    if centre is None:
        return feasible(result)
    level = noise_level(result.formulation, centre)
    if level <= 1.0 + ROUNDING or (np.isnan(level) and not len(result.attained)):
        return np.asarray(centre, np.float64)
    try:
        return feasible(result)
    except SetidError:
        return np.asarray(centre, np.float64)
