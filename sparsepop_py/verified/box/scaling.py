"""Affine scaling: boxed variables to [-1, 1], rows and objective to unit size.

x = centre + scale * t. The box of t contains the box of x exactly, because the scale is
rounded up; a box that is symmetric up to rounding keeps its centre at 0, so that sign
symmetry survives. A variable without a finite box starts at its finite bound, if it has
one, and keeps a scale from the data; a fixed variable has scale 0 and disappears.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial import Constraint, Polynomial
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.problem import generators
from sparsepop_py.problem.problem import Problem
from sparsepop_py.verified.arithmetic.array_cache import interned
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.arithmetic.polynomial_range import expand_affine, expand_exactly

__all__ = ["Scaled", "Scaling", "scale_objective"]

_LEAST_WIDTH = 2.0**-300  # half widths below this are rounding; their powers would underflow
_TINY = 2.0**-300  # ends of t below this could underflow when multiplied
_LEAST_SIZE = 2.0**-990  # of a row, times its largest coefficient: the quotients are doubles
_FEW = 5_000  # letters of polynomials up to which rationals take no time
_SLACK = 1.0 + 2.0**-40  # a replayed box may differ in the last digits and must still fit


@dataclass(frozen=True, eq=False)
class Scaling:
    """x = centre + scale * t, with t in [-1, 1] where ``boxed``.

    Parameters
    ----------
    centre, scale : (n,) float
    boxed : (n,) bool
        Fixed variables (scale 0) count as boxed.
    side : (n,) int
        Of a variable without a box: 1 if t >= 0 is known, -1 if t <= 0 is, else 0.
    ends : pair of (n,) float, optional
        Bounds of t where they are not those above; within [-1, 1] where ``boxed``.
    """

    centre: NDArray[np.float64]
    scale: NDArray[np.float64]
    boxed: NDArray[np.bool_]
    side: NDArray[np.int64]
    ends: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None

    @staticmethod
    def of_box(
        box: Interval,
        typical: NDArray[np.float64] | None = None,
        slack: NDArray[np.float64] | float = 0.0,
    ) -> Scaling:
        """Scale a box; ``typical`` (n,) gives the scale of variables without one.

        Where variables are not fixed, larger boxes fit as well, by ``slack`` on all sides.
        """
        boxed = np.isfinite(box.lo) & np.isfinite(box.hi)
        low, high = np.where(boxed, box.lo, 0.0), np.where(boxed, box.hi, 0.0)
        centre = 0.5 * low + 0.5 * high
        half = np.maximum(0.5 * high - 0.5 * low, _LEAST_WIDTH)
        centre = np.where(np.abs(centre) <= 1e-12 * half, 0.0, centre)
        centre = np.where(low < high, centre, low)
        reach = np.maximum(high - centre, centre - low) * _SLACK + slack
        reach = np.maximum(
            reach + 4.0 * np.spacing(np.maximum(np.abs(low), np.abs(high))), _LEAST_WIDTH
        )
        scale = np.where(low < high, np.nextafter(reach, np.inf), 0.0)
        side = np.where(
            boxed, 0, np.where(np.isfinite(box.lo), 1, np.where(np.isfinite(box.hi), -1, 0))
        )
        start = np.where(side > 0, box.lo, np.where(side < 0, box.hi, 0.0))
        guess = np.ones(low.size) if typical is None else np.maximum(np.abs(typical - start), 1.0)
        guess = 2.0 ** np.ceil(np.log2(guess))
        centre, scale = np.where(boxed, centre, start), np.where(boxed, scale, guess)
        return Scaling(centre, scale, interned(boxed), interned(side))

    @staticmethod
    def of_bounds(box: Interval, shifted: bool = True) -> Scaling:
        """Scale as SparsePOP does: boxed variables by their larger bound in size.

        There is no shift but, with ``shifted``, of a variable with one bound to that bound.
        """
        boxed = np.isfinite(box.lo) & np.isfinite(box.hi)
        fixed = box.lo == box.hi
        size = np.where(boxed, np.maximum(np.abs(box.lo), np.abs(box.hi)) * _SLACK, 1.0)
        size = np.maximum(size, _LEAST_WIDTH)
        low, high = box.lo / size, box.hi / size
        grown = 2.0 * (_SLACK - 1.0)  # outwards by more than rounding, and 0 stays
        low = low - np.where(np.isfinite(low), grown * np.abs(low), 0.0)
        high = high + np.where(np.isfinite(high), grown * np.abs(high), 0.0)
        low = np.where(boxed, np.clip(low, -1.0, 1.0), low)
        high = np.where(boxed, np.clip(high, -1.0, 1.0), high)
        low = np.where(np.abs(low) < _TINY, np.where(low < 0, -_TINY, 0.0), low)
        high = np.where(np.abs(high) < _TINY, np.where(high > 0, _TINY, 0.0), high)
        one = shifted & (np.isfinite(box.lo) != np.isfinite(box.hi))
        start = np.where(np.isfinite(box.lo), box.lo, box.hi)
        ends = tuple(np.where(fixed | (one & np.isfinite(e)), 0.0, e) for e in (low, high))
        scale, centre = np.where(fixed, 0.0, size), np.where(fixed | one, start, 0.0)
        return Scaling(centre, scale, boxed, np.zeros(boxed.size, int), (ends[0], ends[1]))

    @staticmethod
    def about(
        x: NDArray[np.float64], scale: NDArray[np.float64], boxed: NDArray[np.bool_]
    ) -> Scaling:
        """Scale variables without bounds about a point x, shape (n,); none is ``boxed``."""
        return Scaling(x, scale, interned(boxed), interned(np.zeros(x.size, int)))

    def fits(self, n: int) -> bool:
        """Check that every array has n entries and t's ends are sensible.

        They lie in [-1, 1] where boxed, and are intervals that hold real numbers: [inf, inf] holds
        none.
        """
        arrays = (self.centre, self.scale, self.boxed, self.side, *(self.ends or ()))
        if not all(array.shape == (n,) for array in arrays) or self.boxed.dtype != bool:
            return False
        if any(
            array.dtype != np.float64 for array in (self.centre, self.scale, *(self.ends or ()))
        ):
            return False
        low, high = self.bounds
        far = np.where(self.boxed, 1.0, np.inf)
        sizes = np.abs(np.concatenate([low, high]))
        ordered = np.all((-far <= low) & (low <= high) & (high <= far))
        ordered &= np.all((low < np.inf) & (high > -np.inf))
        return bool(ordered and np.all((sizes == 0) | (sizes >= _TINY)))

    def contains(self, box: Interval) -> bool:
        """Check that a box lies in the ranges assumed of t.

        These are t in [-1, 1] where boxed, and the sides elsewhere.
        """
        if not self.fits(box.lo.size):
            return False
        start, end = self.bounds
        inside = self._reaches(start, -1.0, box.lo) & self._reaches(end, 1.0, box.hi)
        sound = np.isfinite(self.centre) & np.isfinite(self.scale)
        positive = (self.scale > 0) | (self.boxed & (self.scale == 0))
        return bool(np.all(sound & inside & positive))

    def _reaches(self, t: NDArray[Any], side: float, end: NDArray[Any]) -> NDArray[np.bool_]:
        """Mark ends of t that, in x, lie at or beyond a box's."""
        known = np.isfinite(t)
        step = Interval.point(self.scale) * Interval.point(np.where(known, t, 0.0))
        x = Interval.point(self.centre) + step
        still = (self.scale == 0) | (t == 0)  # without rounding
        inner = np.where(still, self.centre, x.lo if side > 0 else x.hi)
        return ~known | (side * inner >= side * end)

    @property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Bounds of t: [-1, 1] where boxed, [0, 0] where fixed, else half-lines from 0."""
        if self.ends is not None:
            return self.ends
        one = np.where(self.scale == 0, 0.0, 1.0)
        low = np.where(self.boxed, -one, np.where(self.side > 0, 0.0, -np.inf))
        high = np.where(self.boxed, one, np.where(self.side < 0, 0.0, np.inf))
        return low, high

    def point(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Convert t to x."""
        return self.centre + self.scale * t

    @property
    def translated(self) -> bool:
        """True if a variable without any bound has another origin than 0."""
        low, high = self.bounds
        free = np.isinf(low) & np.isinf(high)
        known = np.isfinite(self.centre) & np.isfinite(self.scale)
        return bool(np.any(free & (self.centre != 0)) and np.all(known))

    def expanded(self, system: PolynomialSystem) -> tuple[Words, NDArray[np.int64], Interval]:
        """Enclose the coefficients of polynomials in t: words (T, D), row (T,), (T,).

        They are exact where an origin is moved: a far one lets their powers cancel.
        """
        if (
            self.translated
            and system.words.size <= _FEW
            and np.all(np.isfinite(system.coefficients))
        ):
            return expand_exactly(system, self.centre, self.scale)
        return expand_affine(system, self.centre, self.scale)

    def expand(self, system: PolynomialSystem) -> PolynomialSystem:
        """Expand polynomials in t, rounded; terms that rounding may hide are dropped.

        Polynomials with a coefficient that no double holds become empty: what is made of them
        proposes proofs that say nothing of them.
        """
        words, row, value = self.expanded(system)
        overflows = np.zeros(system.size, bool)
        overflows[row[~np.isfinite(value.hi - value.lo)]] = True
        keep = np.flatnonzero(((value.lo > 0) | (value.hi < 0)) & ~overflows[row])
        return PolynomialSystem(
            words[keep], value.middle()[keep], row[keep], system.size, system.dimension
        )


@dataclass(frozen=True, eq=False)
class Scaled:
    """A problem in scaled variables, and how its sizes relate to the original's.

    Parameters
    ----------
    problem : Problem
        Objective and constraints divided by their largest coefficient.
    scaling : Scaling
    objectives : tuple of Polynomial
        Every objective asked for, scaled; the first is ``problem.objective``.
    objective_sizes : tuple of float
    row_sizes : (m,) float
        original objective = size * scaled objective, and likewise for each constraint with
        its matrix.
    """

    problem: Problem
    scaling: Scaling
    objectives: tuple[Polynomial, ...]
    objective_sizes: tuple[float, ...]
    row_sizes: NDArray[np.float64]

    def generator_sizes(self, products: NDArray[np.int64]) -> NDArray[np.float64]:
        """List sizes: original generator = size * scaled generator, products (P, 2) last."""
        n = self.problem.dimension
        sizes = np.concatenate([[1.0], self.row_sizes, np.ones(3 * n)])
        for layer in generators.layers(products, sizes.size):
            pairs = products[layer]
            sizes = np.append(sizes, sizes[pairs[:, 0]] * sizes[pairs[:, 1]])
        return sizes

    @staticmethod
    def of(
        problem: Problem,
        scaling: Scaling,
        objectives: tuple[Polynomial, ...],
        active: NDArray[np.bool_] | None = None,
        whole: bool = False,
    ) -> Scaled:
        """Scale constraints, bounds and objectives; rows that are not active become empty.

        Rows that repeat bounds become empty too, unless all are wanted (``whole``); constants
        of constraints then count in their size. Matrices are always active.
        """
        n, m = problem.dimension, len(problem.constraints)
        owner = problem.matrices.owner
        polynomials = [c.polynomial for c in problem.constraints] + list(objectives)
        entries = range(len(polynomials), len(polynomials) + owner.size)
        polynomials += [p for c in problem.constraints for p in c.entries]
        original = PolynomialSystem.stack(polynomials, n)
        system = scaling.expand(original)
        reach = np.abs(scaling.centre) + scaling.scale
        magnitude = np.zeros(original.size)
        with np.errstate(over="ignore"):
            terms = np.abs(original.coefficients) * monomials.evaluate(original.words, reach)
        np.maximum.at(magnitude, original.row, terms)
        largest = np.zeros(system.size)
        varies = system.words.any(axis=1)
        if whole:
            varies |= system.row < m
        np.maximum.at(largest, system.row[varies], np.abs(system.coefficients[varies]))
        shared = largest.copy()
        np.maximum.at(shared, owner, largest[entries.start :])
        shared[entries] = shared[owner]
        room = _room(system)
        np.maximum.at(room, owner, room[entries.start :])
        room[entries] = room[owner]
        size = np.maximum(np.where(shared > 0, shared, 1.0), room)
        useless = largest <= 1e-11 * magnitude
        if not whole:
            useless |= _repeats_bounds(system, problem, scaling)
        if active is not None:
            useless[:m] |= ~active
        useless[m:] = False  # objectives and entries
        rows = _split(system.without(np.flatnonzero(useless)), size)
        part = iter(rows[entries.start :])
        constraints = [
            Constraint(row, c.kind, c.name, tuple(next(part) for _ in c.entries))
            for row, c in zip(rows, problem.constraints, strict=False)
        ]
        low, high = scaling.bounds
        scaled = Problem(rows[m], constraints, low, high, problem.names)
        asked = slice(m, entries.start)
        return Scaled(scaled, scaling, tuple(rows[asked]), tuple(size[asked].tolist()), size[:m])


def scale_objective(objective: Polynomial, scaling: Scaling) -> tuple[Polynomial, float]:
    """Scale an objective and divide it by its largest coefficient; return that size too."""
    system = scaling.expand(PolynomialSystem.stack([objective], objective.dimension))
    varies = system.words.any(axis=1)
    size = float(np.abs(system.coefficients[varies]).max(initial=0.0)) or 1.0
    size = max(size, float(_room(system)[0]))
    return _split(system, np.array([size]))[0], size


def _room(system: PolynomialSystem) -> NDArray[np.float64]:
    """Compute the least size of each row by which its constant can be divided, too."""
    room = np.zeros(system.size)
    np.maximum.at(room, system.row, _LEAST_SIZE * np.abs(system.coefficients))
    return room


def _repeats_bounds(
    system: PolynomialSystem, problem: Problem, scaling: Scaling
) -> NDArray[np.bool_]:
    """Rows that only repeat the bounds of one variable, which the box holds already."""
    linear = monomials.degrees(system.words) == 1
    boxed = np.append(False, scaling.boxed)[system.words[:, -1]]
    slope = np.bincount(
        system.row[linear], np.abs(system.coefficients[linear]) * boxed[linear], system.size
    )
    constant = np.bincount(system.row[~linear], system.coefficients[~linear], system.size)
    implied = (slope > 0) & (constant >= (1.0 - 1e-9) * slope)
    implied[: problem.equality.size] &= problem.bound_rows & ~problem.equality
    return implied


def _split(system: PolynomialSystem, size: NDArray[Any]) -> list[Polynomial]:
    """Divide rows by their sizes; the expanded system's words are distinct and graded."""
    first = np.searchsorted(system.row, np.arange(system.size + 1))
    values, words, n = system.coefficients / size[system.row], system.words, system.dimension
    values.flags.writeable = words.flags.writeable = False
    parts = [(words[a:b], values[a:b], n) for a, b in zip(first[:-1], first[1:], strict=True)]
    if not np.all(np.isfinite(values) & (values != 0.0)):
        return [Polynomial._merged(*part) for part in parts]
    return [Polynomial._of_sorted(monomials.trim(w), v, n) for w, v, n in parts]
