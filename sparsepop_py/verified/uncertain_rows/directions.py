"""A finite box where rows one by one give none, and how it is checked.

With t = max_i |theta_i| / c_i, s = 1 / t and phi = s theta / c, each row that is linear in
theta becomes, multiplied by s, a row in (phi, s) and the noise, with max_i |phi_i| = 1:

    s (y~_k - eta_k) + sum_i c_i phi_i (y~_{k-i} - eta_{k-i}) - ... = 0.

Everything in it is bounded, so that a certificate of s > 0 on each side phi_i = +-1 of the cube
of directions bounds theta. :mod:`sparsepop_py.uncertain_rows.directions`
searches for the certificates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Constraint, Polynomial, variables
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.units import InUnits
from sparsepop_py.verified.arithmetic.array_checks import frozen
from sparsepop_py.verified.certificate.certificate import Certificate
from sparsepop_py.verified.uncertain_rows.box import Bounds
from sparsepop_py.verified.uncertain_rows.coupled import CoupledRows
from sparsepop_py.verified.uncertain_rows.rows import UncertainRows
from sparsepop_py.verified.uncertain_rows.sign_tree import ParameterBox

__all__ = ["DirectionBox"]

Reals = NDArray[np.float64]

_TINY = 1e-250


POWERS = 60  # of two, in units


LARGEST = 4.0  # s above this needs no proof: theta is small then


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class DirectionBox(Bounds):
    """A box that holds every consistent parameter vector, with its proof.

    Parameters
    ----------
    names, lower, upper
        As of :class:`sparsepop_py.verified.uncertain_rows.box.Bounds`.
    first : ParameterBox
        What rows one by one give, infinite somewhere.
    scale : (p,) float
        The units c of the parameters, powers of two.
    certificates : tuple of Certificate
        Of the least s on each side of the cube, phi_1 = 1, phi_1 = -1, phi_2 = 1, ...
    rows : tuple of int
        From how many rows of samples, the first ones, each of them follows.
    last : ParameterBox
        What rows one by one give within the bounds that follow.
    """

    first: ParameterBox
    scale: Reals
    certificates: tuple[Certificate, ...]
    rows: tuple[int, ...]
    last: ParameterBox

    def verify(self, rows: UncertainRows, coupled: CoupledRows, start: Reals) -> bool:
        """Replay both boxes and check all certificates, without any solver.

        Parameters
        ----------
        rows : UncertainRows
        coupled : CoupledRows
        start : (2, p) float
            Bounds that are known already.
        """
        if not suits(coupled) or not exact_units(self.scale, start.shape[1]):
            return False
        if not self.first.verify(rows, start):
            return False
        if not len(self.rows) == len(self.certificates) == 2 * start.shape[1]:
            return False
        if not all(type(count) is int and count > 0 for count in self.rows):
            return False
        cube, least = cubes(coupled, self.first, self.scale), LARGEST
        for number, (count, certificate) in enumerate(
            zip(self.rows, self.certificates, strict=True)
        ):
            side = cube(count).side(number)
            if not certificate.verify(side.problem).ok:
                return False
            least = min(least, certificate.bound * side.factor)
        if not least > 0 or not self.last.verify(rows, within(self.first, self.scale, least)):
            return False
        return self.follow(self.last.lower, self.last.upper)

    @property
    def cut_short(self) -> bool:
        """True if time ended before all nodes had been processed."""
        return self.last.cut_short

    def used_rows(self, rows: UncertainRows) -> dict[int, int]:
        """Count how often rows are used in a proof of emptiness, as of :class:`ParameterBox`.

        Parameters
        ----------
        rows : UncertainRows
        """
        return self.last.used_rows(rows)


def suits(coupled: CoupledRows) -> bool:
    """Check that rows are linear in the parameters, and all other variables bounded."""
    problem, p = coupled.problem, coupled.parameters
    size = np.abs(problem.rows.coefficients)
    if not (size.min(initial=1.0) > _TINY and size.max(initial=1.0) < 1.0 / _TINY):
        return False  # units would not be exact
    for row in coupled.constraints:
        words = row.polynomial.words
        if np.any(np.count_nonzero((words > 0) & (words <= p), axis=1) > 1):
            return False
        others = np.unique(words[words > p]) - 1
        if not np.all(np.isfinite(problem.lower[others]) & np.isfinite(problem.upper[others])):
            return False
    return True


def exact_units(scale: Reals, count: int) -> bool:
    """Check for positive powers of two, neither tiny nor huge: exact rows."""
    if scale.shape != (count,) or not np.all((scale > 0) & np.isfinite(scale)):
        return False
    half, power = np.frexp(scale)
    return bool(np.all((half == 0.5) & (np.abs(power) <= POWERS + 1)))


def within(first: ParameterBox, scale: Reals, least: float) -> Reals:
    """Intersect the first box with the bounds c / s, rounded outwards."""
    reach = np.nextafter(scale / least, inf)
    return frozen(np.array([np.maximum(first.lower, -reach), np.minimum(first.upper, reach)]))


class Cube(NamedTuple):
    """The rows of some samples in (phi, noise, s), with the bounds of these."""

    coupled: CoupledRows
    rows: list[Constraint]
    lower: Reals
    upper: Reals
    names: tuple[str, ...]

    def side(self, number: int) -> InUnits:
        """Minimise s over the side phi_i = 1 or -1.

        Number 2 i, from 0, means phi_i = 1; 2 i + 1 means -1.
        """
        low, high = self.lower.copy(), self.upper.copy()
        low[number // 2] = high[number // 2] = -1.0 if number % 2 else 1.0
        s = variables(len(self.names), list(self.names))[-1]
        return self.coupled.in_units(Problem(s, self.rows, low, high, self.names))


def cubes(coupled: CoupledRows, first: ParameterBox, scale: Reals) -> Callable[[int], Cube]:
    """Build the cube of so many rows of samples, within the first signs."""
    known = coupled.problem
    p, n = scale.size, known.dimension
    names = (*known.names, "s")
    scaled = [_homogeneous(row, scale, n, names) for row in coupled.constraints]
    x = variables(n + 1, list(names))
    signs = []
    for i in range(p):
        for end, sign in ((first.lower[i], 1.0), (first.upper[i], -1.0)):
            if np.isfinite(end):
                signs.append(sign * (float(scale[i]) * x[i] - float(end) * x[n]) >= 0)

    @cache
    def of_rows(count: int) -> Cube:
        rows = scaled[:count] + signs
        seen = np.unique(np.concatenate([row.polynomial.words.ravel() for row in rows]))
        used = np.isin(np.arange(1, n + 2), seen)
        lower = np.where(used, np.append(known.lower, 0.0), 0.0)
        upper = np.where(used, np.append(known.upper, LARGEST), 0.0)
        lower[:p], upper[:p] = -1.0, 1.0
        return Cube(coupled, rows, lower, upper, names)

    return of_rows


def _homogeneous(row: Constraint, scale: Reals, n: int, names: tuple[str, ...]) -> Constraint:
    """Rewrite a row in (phi, noise, s): terms without a parameter times s."""
    words, p = row.polynomial.words, scale.size
    ours = (words > 0) & (words <= p)
    plain = ~ours.any(axis=1)
    longer = np.zeros((len(words), words.shape[1] + 1), np.int32)
    longer[:, :-1] = words
    longer[plain, -1] = n + 1
    longer.sort(axis=1)
    factor = np.append(1.0, scale)[np.max(np.where(ours, words, 0), axis=1)]
    values = row.polynomial.coefficients * factor
    return Constraint(Polynomial.from_words(longer, values, n + 1, names), row.kind)
