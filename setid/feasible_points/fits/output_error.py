"""Local output-error fits: parameters and initial values of a simulation with small errors.

Gauss-Newton on the squares, from the least squares of equation errors (L. Ljung, System
Identification, 2nd ed., 1999, section 10.2), then sequential linear programming for the largest
error (K. Madsen, An algorithm for minimax solution of overdetermined systems of non-linear
equations, IMA Journal of Applied Mathematics 16, 1975). Nothing proved rests on either.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from math import inf

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray
from scipy.optimize import least_squares as gauss_newton

from setid.data.record import IOData
from setid.errors import ModelError
from setid.feasible_points.estimators import least_squares
from setid.feasible_points.fits.differences import HUGE, capped, slopes_of_errors
from setid.feasible_points.fits.separate_denominators import has_separate_denominators, separate_fit
from setid.models.checked_structures import coefficients_of
from setid.models.equations import Structure
from setid.simulation.responses import from_readings, run
from sparsepop_py.budget import check
from sparsepop_py.lp.scaled import solve_scaled

__all__ = ["least_error_at", "least_largest_error", "output_error_fit"]

Reals = NDArray[np.float64]
_STEPS = 200  # evaluations of a local search
_PROGRAMS = 12  # linear programs
_REFINED = 3  # linear programs for a given denominator
_ROUNDED = 1e-14  # entries of orthonormal columns that are rounding
_PART = 1e-7  # of an unknown: step of a difference


class _OutOfTime(Exception):
    """Raised inside a search that has no time left."""


class _Simulation:
    """Errors of a simulation as a function of parameters and free initial values."""

    def __init__(self, data: IOData, model: Structure, until: float = inf) -> None:
        self.data, self.model, self.until = data, model, until
        self.free = _free_samples(data, model)
        self.values = np.where(np.isnan(data.y), 0.0, data.y)
        self.known = ~np.isnan(data.y)
        theta, values = _first(data, model), self.values
        self.settled = False  # whether the first vector is a local minimiser already
        if has_separate_denominators(model):
            found = separate_fit(data, model, until)
            if found is not None:
                (theta, values), self.settled = found, True
        self.count = theta.size
        self.first = np.concatenate([theta, values[self.free].ravel()])

    def outputs(self, x: Reals) -> Reals:
        """Simulate outputs (N, ny)."""
        y = self.values.copy()
        y[self.free] = x[self.count :].reshape(-1, self.data.outputs)
        with np.errstate(over="ignore", invalid="ignore"):
            return run(self.model, x[: self.count], self.data.with_outputs(y))

    def errors(self, x: Reals) -> Reals:
        """Compute errors at known readings; huge where the simulation overflows."""
        check()
        try:
            errors = (self.outputs(x) - self.data.y)[self.known]
        except (ModelError, OverflowError):
            return np.full(int(self.known.sum()), HUGE)
        return capped(errors)

    def at(self, denominator: Reals, shares: Callable[[Reals], Reals], norm: str = "linf") -> Reals:
        """Complete a given denominator by the unknowns with the least shares in a norm."""
        places = [
            self.model.parameters.index(n) for n in coefficients_of(self.model, 1, 1).denominator
        ]
        x = self.first.copy()
        x[places] = denominator
        others = np.setdiff1d(np.arange(x.size), places)
        for _ in range(2):  # the errors are affine in them; differences lose digits
            values = shares(x)
            if np.any(np.abs(values) >= HUGE):
                break
            slopes = slopes_of_errors(shares, x, values, 1.0)[:, others]
            x[others] -= np.linalg.lstsq(slopes, values, rcond=None)[0]
        best, least = x.copy(), inf
        for turn in range(_REFINED):  # orthonormal columns: near poles at 1 others lose digits
            values = shares(x)
            size = float(np.abs(values).sum() if norm == "l1" else np.abs(values).max())
            if size < least:
                best = x.copy()
            slopes = slopes_of_errors(shares, x, values, 1.0)[:, others]
            if not (size < (1.0 - 1e-5) * least and np.all(np.isfinite(slopes))):
                break
            least = size
            if norm == "l2" or (turn and time.monotonic() >= self.until):
                break
            columns, triangle = np.linalg.qr(slopes)
            columns[np.abs(columns) < _ROUNDED] = 0.0  # scales of programs would follow these
            far = np.full(columns.shape[1], 2.0 * np.sqrt(values.size) * size)
            step = _linear_step(values, columns, far, norm)
            if step is None:
                break
            x[others] += np.linalg.lstsq(triangle, step, rcond=None)[0]
        return best

    def fitted(self) -> Reals:
        """Fit by least squares: a local minimiser, or the best vector in time."""
        if self.settled or np.any(np.abs(self.errors(self.first)) >= HUGE):
            return self.first
        best, least = self.first, inf

        def errors(x: Reals) -> Reals:
            nonlocal best, least
            found = self.errors(x)
            size = float(np.linalg.norm(found))
            if size < least:
                best, least = x.copy(), size
            if time.monotonic() >= self.until:
                raise _OutOfTime
            return found

        try:
            found = gauss_newton(errors, self.first, x_scale="jac", max_nfev=_STEPS)
        except _OutOfTime:
            return best
        return np.asarray(found.x, np.float64)


def output_error_fit(data: IOData, model: Structure, until: float = inf) -> tuple[Reals, Reals]:
    """Fit the simulation of a structure by least squares, free initial values included.

    Parameters
    ----------
    data : IOData
    model : Structure
    until : float
        The reading of ``time.monotonic`` at which the best vector so far is taken.

    Returns
    -------
    theta : (p,) float
    outputs : (N, ny) float
        Of the model; far away where simulations overflow.
    """
    simulation = _Simulation(data, model, until)
    x = simulation.fitted()
    return np.asarray(x[: simulation.count], np.float64), simulation.outputs(x)


def least_error_at(
    data: IOData, model: Structure, norm: str, denominator: Reals, until: float = inf
) -> tuple[Reals, Reals]:
    """Fit the simulation of one output where the denominator is given.

    Parameters
    ----------
    data : IOData
    model : Structure
    norm : {"linf", "l2", "l1"}
        Of the errors, which are affine in the other unknowns.
    denominator : (n,) float
        Coefficients a_1, ..., a_n.
    until : float
        The reading of ``time.monotonic`` after which the fit is not refined any more.

    Returns
    -------
    theta : (p,) float
    outputs : (N, ny) float
    """
    simulation = _Simulation(data, model, until)
    x = simulation.at(denominator, simulation.errors, norm)
    return np.asarray(x[: simulation.count], np.float64), simulation.outputs(x)


def least_largest_error(
    data: IOData,
    model: Structure,
    bound: Reals,
    denominator: Reals | None = None,
    until: float = inf,
) -> Reals:
    """Fit the simulation of a structure so that its largest error is small.

    Parameters
    ----------
    data : IOData
    model : Structure
    bound : (N, ny) float
        Noise bounds: errors count as parts of them. Readings whose bound is 0 are left out.
    denominator : (n,) float, optional
        Coefficients a_1, ..., a_n of a single output, which are held.
    until : float
        The reading of ``time.monotonic`` at which the best vector so far is taken.

    Returns
    -------
    (p,) float
    """
    simulation = _Simulation(data, model, until)
    sizes = np.broadcast_to(bound, data.y.shape)[simulation.known]
    counted = np.flatnonzero(sizes > 0)

    def shares(at: Reals) -> Reals:
        return np.asarray(simulation.errors(at)[counted] / sizes[counted], np.float64)

    x = simulation.fitted() if denominator is None else simulation.at(denominator, shares)
    if counted.size and denominator is None and np.all(np.abs(shares(x)) < HUGE):
        x = _minimax(shares, x, until)
    return np.asarray(x[: simulation.count], np.float64)


def _minimax(shares: Callable[[Reals], Reals], x: Reals, until: float) -> Reals:
    """Minimise the largest absolute value locally, by linear programs in a trust region."""
    values, radius = shares(x), 0.1
    for _ in range(_PROGRAMS):
        if time.monotonic() >= until:
            break
        slope = slopes_of_errors(shares, x, values, _PART)
        size = np.maximum(np.linalg.norm(slope, axis=0) / np.sqrt(values.size), 1e-12)
        largest = float(np.abs(values).max())
        step = _linear_step(values, slope, radius * largest / size)
        if step is None:
            break
        moved = shares(x + step)
        expected = largest - float(np.abs(values + slope @ step).max())
        gained = largest - float(np.abs(moved).max())
        if gained > 0:
            x, values = x + step, moved
        if expected <= 1e-4 * largest:
            break
        radius *= 2.0 if gained > 0.7 * expected else 1.0 if gained > 0.2 * expected else 0.25
    return x


def _linear_step(values: Reals, slope: Reals, room: Reals, norm: str = "linf") -> Reals | None:
    """Choose abs(d) <= room with the least norm of values + slope d."""
    count, k = slope.shape
    sizes = sps.eye_array(count) if norm == "l1" else sps.csr_array(np.ones((count, 1)))
    eye, dense = sps.eye_array(k), sps.csr_array(slope)
    below = sps.block_array([[dense, -sizes], [-dense, -sizes], [eye, None], [-eye, None]]).tocsr()
    cost = np.append(np.zeros(k), np.ones(sizes.shape[1]))
    found = solve_scaled(cost, (below, np.concatenate([-values, values, room, room])))
    return np.asarray(found.x[:k], np.float64) if found.status == "solved" else None


def _first(data: IOData, model: Structure) -> Reals:
    try:
        return np.asarray(least_squares(data, model).theta, np.float64)
    except ModelError:
        return np.zeros(len(model.parameters))


def _free_samples(data: IOData, model: Structure) -> NDArray[np.bool_]:
    lag = max((equation.lag for equation in from_readings(model)), default=0)
    return np.asarray(np.arange(data.samples) - data.first < lag)
