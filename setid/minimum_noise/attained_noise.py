"""The least noise that denominators attain: random ones, and descents from the best of them.

A denominator a = (1, a_1, ..., a_n) leaves a linear program, the least largest error of an output.
Its value is an upper end of the least noise. Lower ends are searched below it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from setid.feasible_points.fits.stable_poles import monic, random_denominator
from setid.minimum_noise.claims import with_better
from setid.minimum_noise.programs import Programs
from setid.proofs.denominators.cones import first_cones
from sparsepop_py.budget import Deadline

__all__ = ["AttainedNoise"]

Reals = NDArray[np.float64]
_SEED = 5
_RANDOM, _STARTS, _AGAIN = 200, 5, 5  # denominators and descents for each unknown; repetitions
_DESCENT, _STEP = 150, 0.3  # evaluations of a descent for each unknown, and its first step
_FAR = 1e100
_DRAWING, _EXPLORING = 0.06, 0.12  # of the time: for random denominators, and with descents
_TINY, _ALMOST = 1e-7, 1e-4
_LOWER = 0.01  # of a level: where a descent is worth it


class AttainedNoise:
    """The best denominators so far. Mutable.

    Parameters
    ----------
    programs : Programs
    stable : bool
        All poles have to lie in the closed unit disc.

    Attributes
    ----------
    level : float
        Factor on the noise bounds; infinite before the first denominator.
    best : list of (n,) float
        Coefficients a_1, ..., a_n, the best one first.
    """

    def __init__(self, programs: Programs, stable: bool) -> None:
        self._programs, self._stable, self._order = programs, stable, programs.order
        self.level, self.best = np.inf, list[Reals]()
        self._explored = np.inf  # the level from which there was a descent

    def try_denominator(self, a: Reals) -> float:
        """Return the noise that a denominator needs, made stable; remember it if it is the best.

        Parameters
        ----------
        a : (n + 1,) float
        """
        tried = monic(a, self._stable)
        if tried is None:
            return np.inf
        solved = self._programs.solve(tried / np.abs(tried).max(), None)
        if solved is None:
            return np.inf
        if solved[0] < self.level:
            self.level, self.best = solved[0], with_better(self.best, tried)
        return solved[0]

    def explore(self, deadline: Deadline) -> None:
        """Descend from the best of random stable denominators, and again from what was found.

        A part of the time is for it, lest lower ends get none where a record is long.

        Parameters
        ----------
        deadline : Deadline
            Of the whole search.
        """
        drawing, descending = deadline.part(_DRAWING), deadline.part(_EXPLORING)
        random, n = np.random.default_rng(_SEED), self._order
        tried = []
        for _ in range(_RANDOM * n):
            if drawing.over:
                break
            a = random_denominator(random, n)
            tried.append((self.try_denominator(a), a))
        tried.sort(key=lambda pair: pair[0])
        starts = (self._descended(a, descending) for _, a in tried[: _STARTS * n])
        found = sorted(starts, key=lambda x: x[0])
        for level, a in found[:n]:
            for _ in range(_AGAIN):
                before = level
                level, a = self._descended(a, descending)
                if level > (1.0 - _ALMOST) * before:
                    break
        self._explored = self.level

    def descend(self, deadline: Deadline) -> None:
        """Descend from the best denominator, where it is better than after the last descent."""
        if self.level < (1.0 - _LOWER) * self._explored:
            self._descended(np.append(1.0, self.best[0]), deadline)
            self._explored = self.level

    def _descended(self, a: Reals, deadline: Deadline) -> tuple[float, Reals]:
        """Descend from a denominator (J. A. Nelder, R. Mead, 1965).

        The unknowns are logarithms of the coefficients in (z - 1) / (z + 1), positive for stable
        denominators; these are as fine near poles at 1 and -1 as elsewhere.
        """
        n = self._order
        basis = first_cones(n, True)[0].astype(np.float64)
        start = a @ basis / 2.0**n
        sign, size = np.where(start < 0.0, -1.0, 1.0), np.abs(start)
        begin = np.log(np.maximum(size, _TINY * size.max()))

        def noise(x: Reals) -> float:
            if deadline.over:
                return _FAR
            return min(self.try_denominator((sign * np.exp(x)) @ basis), _FAR)

        found = minimize(
            noise,
            begin,
            method="Nelder-Mead",
            options={
                "maxfev": _DESCENT * n,
                "fatol": _ALMOST * min(self.level, _FAR),
                "initial_simplex": begin + _STEP * np.vstack([np.zeros(n + 1), np.eye(n + 1)]),
            },
        )
        return float(found.fun), np.asarray((sign * np.exp(found.x)) @ basis, np.float64)
