"""Many linear certificates on one box: bounds of several polynomials from LP duals.

A linear relaxation has constant multipliers lambda >= 0 on its inequalities (products of
bounds and constraints among them) and free ones w on its equalities, which may be
multiplied by monomials. Any of them give, for each polynomial p on the box,

    p(x) = sum_k lambda_k g_k(x) + sum_j w_j t^a_j h_j(x) + r(t)  >=  r_0 - sum_a |r_a|,

the safe bound of Neumaier and Shcherbina with all columns in [-1, 1]. Bounds of many
polynomials on the same box are checked in one pass; only constraints that are used are
expanded. Multipliers may be short floats: what their rounding costs shows in r.

References
----------
A. Neumaier, O. Shcherbina, Safe bounds in linear and mixed-integer linear programming,
Math. Programming 99, 2004.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.problem import generators
from sparsepop_py.verified.arithmetic.array_cache import indices
from sparsepop_py.verified.arithmetic.array_checks import are_indices, are_numbers
from sparsepop_py.verified.arithmetic.interval import Interval, sum_by
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.certificate.multipliers import ScaledGenerators
from sparsepop_py.verified.certificate.sos_identity import losses

__all__ = ["LinearDual"]


@dataclass(frozen=True, eq=False)
class LinearDual:
    """Multipliers of K linear certificates, stacked.

    Parameters
    ----------
    scaling : Scaling
        Its box is an assumption here; whoever uses the bounds has to prove it.
    generator : (L,) int
        What each multiplier multiplies, numbered as in :mod:`sparsepop_py.problem.generators`.
    word : (L, D) int32
        The monomial in t that goes with it: the constant unless it multiplies an equality.
    value : (L,) float
        The multiplier; negative ones of inequalities count as zero.
    owner : (L,) int
        Which of the K bounds it belongs to.
    products : (P, 2) int
        Generators that are products of two earlier ones.
    """

    scaling: Scaling
    generator: NDArray[np.integer]
    word: Words
    value: NDArray[Any]
    owner: NDArray[np.integer]
    products: NDArray[np.integer]

    @property
    def numbers(self) -> int:
        """Number of stored multipliers."""
        return self.value.size

    def __reduce__(self) -> tuple[Any, ...]:
        """Owners in order go as how many multipliers each has, constant words as none."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        if self.owner.shape == (self.owner.size,) and are_indices(self.owner, self.owner.size):
            count = np.bincount(self.owner)
            if _same(self.owner, np.repeat(np.arange(count.size), count)):
                values["owner"] = (indices(count),)
            if _same(self.word, np.zeros((self.owner.size, 1))):
                values["word"] = None
        return _restored, tuple(values.values())

    def evaluate(
        self,
        constraints: PolynomialSystem,
        equality: NDArray[np.bool_],
        objectives: PolynomialSystem,
    ) -> NDArray[np.float64]:
        """Compute the proved lower bounds of K objectives, -inf where nothing is proved.

        Parameters
        ----------
        constraints : PolynomialSystem
        equality : (m,) bool
        objectives : PolynomialSystem
            K rows.

        Returns
        -------
        (K,) float
        """
        count, n = objectives.size, constraints.dimension
        nothing = np.full(count, -np.inf)
        free = self._free(constraints.size, equality, n, count)
        if free is None:
            return nothing
        value = self.value.astype(float)
        keep = np.flatnonzero((value != 0) & (free | (value > 0)))
        generator, owner = self.generator[keep], self.owner[keep]
        unused = np.ones(constraints.size, bool)
        unused[self._constraints_of(generator, constraints.size, n)] = False
        made = ScaledGenerators.of(
            constraints.without(np.flatnonzero(unused)), self.scaling, self.products
        )
        place, term = made.system.terms_of(generator)
        words = monomials.multiply(self.word[keep][place], made.system.words[term])
        words = monomials.trim(words)  # as wide as a file says, if it has no row
        part = -(Interval.point(value[keep][place]) * made.value[term])
        asked, row, constant = self.scaling.expanded(objectives)
        distinct, number = monomials.collect(monomials.stack((words, asked)), n)
        key, inverse = np.unique(
            np.append(owner[place], row) * distinct.shape[0] + number, return_inverse=True
        )
        terms = Interval(np.append(part.lo, constant.lo), np.append(part.hi, constant.hi))
        rest = sum_by(inverse.ravel(), terms, key.size)
        owners, which = np.divmod(key, distinct.shape[0])
        return self._bounds(distinct[which], rest, owners, count)

    def _bounds(
        self, words: Words, rest: Interval, owner: NDArray[np.int64], count: int
    ) -> NDArray[np.float64]:
        """Compute r_0 - sum |r_a| of the remainder of each owner."""
        fixed = ~words.any(axis=1)
        base = np.zeros(count)
        base[owner[fixed]] = rest.lo[fixed]
        paid = ~fixed
        loss = losses(words[paid], rest[paid], owner[paid], count)
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite proves nothing
            bound = np.where(loss == 0, base, np.nextafter(base - loss, -np.inf))
        covered = np.append(True, self.scaling.boxed)[words].all(axis=1)
        open_ = ~covered & ((rest.lo != 0) | (rest.hi != 0))
        bound[owner[open_]] = -np.inf
        return np.where(np.isfinite(bound), bound, -np.inf)

    def _free(
        self, size: int, equality: NDArray[np.bool_], n: int, count: int
    ) -> NDArray[np.bool_] | None:
        """Mark the free multipliers; None if shapes or numbers make no sense."""
        single = generators.count(size, n)
        length = self.value.shape[0] if self.value.ndim == 1 else -1
        fits = (
            self.scaling.fits(n)
            and self.generator.shape == self.owner.shape == (length,)
            and self.word.ndim == 2
            and self.word.shape[0] == length
            and self.word.shape[1] > 0
            and generators.are_products(self.products, single)
            and are_indices(self.products, single + self.products.shape[0])
        )
        if not fits or not are_numbers(self.value):
            return None
        known = are_indices(self.generator, single + self.products.shape[0])
        if not known or not are_indices(self.owner, count) or not are_indices(self.word, n + 1):
            return None
        equal = np.zeros(single + self.products.shape[0], bool)
        equal[1 : size + 1] = equality
        free = equal[self.generator]
        return free if not np.any(self.word.any(axis=1) & ~free) else None

    def _constraints_of(self, generator: NDArray[Any], size: int, n: int) -> NDArray[np.int64]:
        """Constraints that the given generators contain, factors of products included."""
        single = generators.count(size, n)
        needed = np.zeros(single + self.products.shape[0], bool)
        needed[generator] = True
        for number in range(self.products.shape[0] - 1, -1, -1) if self.products.size else ():
            if needed[single + number]:
                needed[self.products[number]] = True
        return np.flatnonzero(needed[1 : size + 1])


def _same(given: NDArray[Any], wanted: NDArray[Any]) -> bool:
    """Check that an array holds these numbers, as 32-bit integers."""
    return given.dtype == np.int32 and np.array_equal(given, wanted)


def _restored(
    scaling: Scaling,
    generator: NDArray[Any],
    word: Words | None,
    value: NDArray[Any],
    owner: NDArray[Any] | tuple[NDArray[Any]],
    products: NDArray[Any],
) -> LinearDual:
    """Rebuild a certificate from the arrays that :meth:`LinearDual.__reduce__` wrote."""
    if isinstance(owner, tuple):
        owner = np.repeat(np.arange(owner[0].size, dtype=np.int32), owner[0])
    if word is None:
        word = np.zeros((owner.size, 1), np.int32)
    return LinearDual(scaling, generator, word, value, owner, products)
