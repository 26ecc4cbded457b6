"""The safe bound: a polynomial identity whose remainder is paid for.

With x = centre + scale * t, any multipliers at all give the identity

    f(x) = sum_k sigma_k(t) g_k(x) + sum_j lambda_j(t) h_j(x) + r(t),
    sigma_k = |L_k' b_k(t)|^2 + floor_k |b_k(t)|^2 >= 0,

where r is whatever remains. Matrices G_k >= 0 add products <S_k(t), G_k(x)> with squares S_k of
matrices (see :mod:`~sparsepop_py.verified.certificate.multipliers`). On the feasible set
g_k >= 0 and h_j = 0, so f(x) >= r(t). Where the variables are boxed, |t^a| <= 1 (and t^a in
[0, 1] for even a), hence f(x) >= r_0 - sum_a |r_a|. A monomial of r that involves an unboxed
variable is instead moved into the Gram matrix of a block of the constant 1 (or of t_v >= 0): a
symmetric change E keeps floor * I + E positive semidefinite as long as the row sums of |E| stay
below the floor (Gershgorin). Squares are stored by their factors, so no eigenvalue has to be
verified: the bound holds for every L, every lambda and every rounding of them. Good multipliers
make it good, none can make it wrong.

References
----------
C. Jansson, D. Chaykin, C. Keil, Rigorous error bounds for the optimal value in
semidefinite programming, SIAM J. Numer. Anal. 46, 2007 (bounded variables).
H. Peyrl, P. Parrilo, Computing sum of squares decompositions with rational coefficients,
Theoret. Comput. Sci. 409, 2008 (absorbing the residual).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.matrix_constraints import Matrices
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.problem import generators
from sparsepop_py.verified.arithmetic.array_checks import are_indices, are_numbers
from sparsepop_py.verified.arithmetic.interval import Interval, sum_by, up
from sparsepop_py.verified.arithmetic.polynomial_range import monomial_ranges
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.certificate.multipliers import Multipliers, ScaledGenerators

__all__ = ["Evaluated", "Identity", "Multipliers", "Priced", "losses"]


@dataclass(frozen=True, eq=False)
class Priced:
    """Multiples of monomials that are replaced by their least values over the box.

    What multipliers of bounds on moments (l <= y_a <= u) amount to.

    Parameters
    ----------
    words : (L, D) int32
    values : (L,) float
    """

    words: Words
    values: NDArray[Any]

    def consistent(self, n: int) -> bool:
        """Check for L monomials in n variables and L finite numbers."""
        shapes = self.words.ndim == 2 and self.values.shape == (self.words.shape[0],)
        wide = shapes and self.words.shape[1] > 0
        return bool(wide and are_indices(self.words, n + 1) and are_numbers(self.values))

    def least(self, scaling: Scaling) -> float:
        """Add the least values over the box of t, rounded down."""
        value = monomial_ranges(self.words, Interval(*scaling.bounds))
        least = (value * Interval.point(self.values.astype(float))).lo
        least = np.where(self.values == 0, 0.0, least)
        if not np.all(np.isfinite(least)):
            return -np.inf
        return float(sum_by(np.zeros(least.size, int), Interval.point(least), 1).lo[0])


@dataclass(frozen=True)
class Evaluated:
    """Bound that an identity proves.

    Parameters
    ----------
    bound : float
        Proved lower bound of the objective, -inf when the identity does not close.
    correction : float
        Cost of the remainder: the sum of |r_a| over the box.
    floor : float
        The rest of the floor: sum_k floor |b_k|^2 is contained in the squares.
    reason : str
        Sentence on why the bound is -inf, else empty.
    """

    bound: float
    correction: float
    floor: float
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Identity:
    """Multipliers in scaled variables.

    Parameters
    ----------
    scaling : Scaling
        Its box is an assumption here; whoever uses the bound has to prove it.
    multipliers : tuple of Multipliers
    products : (P, 2) int
        Further generators: products of two earlier ones. Each factor is non-negative (or
        zero) on the feasible set, so the product is too.
    priced : Priced or None
        Multiples of monomials that are bounded by interval arithmetic.
    """

    scaling: Scaling
    multipliers: tuple[Multipliers, ...]
    products: NDArray[np.integer] = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    priced: Priced | None = None

    @property
    def short(self) -> bool:
        """True if all multipliers are 32-bit numbers."""
        return all(group.values.dtype == np.float32 for group in self.multipliers)

    def evaluate(
        self,
        constraints: PolynomialSystem,
        equality: NDArray[np.bool_],
        objective: PolynomialSystem,
        matrices: Matrices | None = None,
    ) -> Evaluated:
        """Compute the bound that this identity proves on the box of its scaling.

        Parameters
        ----------
        constraints : PolynomialSystem
            The constraints that generators 1..m refer to.
        equality : (m,) bool
            Equalities among them; only these may have free multipliers.
        objective : PolynomialSystem
            One row, the objective.
        matrices : Matrices, optional
            Those of the constraints; without it no multiplier may have places.

        Returns
        -------
        Evaluated
        """
        matrices = matrices or Matrices.of((), constraints.dimension)
        reason = self._malformed(constraints.size, equality, constraints.dimension)
        if not reason and not all(group.of_matrices(matrices.side) for group in self.multipliers):
            reason = "a multiplier refers to a matrix that does not exist"
        if reason:
            return Evaluated(-np.inf, np.inf, 0.0, reason)
        words, value = self._remainder(constraints, objective, matrices)
        constant = ~words.any(axis=1)
        covered = np.append(True, self.scaling.boxed)[words].all(axis=1)
        paid = covered & ~constant
        loss = float(losses(words[paid], value[paid], np.zeros(np.count_nonzero(paid), int), 1)[0])
        rest = ~covered & ((value.lo != 0) | (value.hi != 0))
        floor, reason = self._absorb(words[rest], value[rest].magnitude(), constraints.size)
        if reason:
            return Evaluated(-np.inf, loss, 0.0, reason)
        base = float(value.lo[constant][0]) if constant.any() else 0.0
        if self.priced is not None:
            base = float(np.nextafter(base + self.priced.least(self.scaling), -np.inf))
        bound = float(np.nextafter(base - loss, -np.inf)) if loss else base
        if not np.isfinite(bound):
            return Evaluated(-np.inf, loss, 0.0, "the multipliers overflow")
        return Evaluated(bound, loss, floor)

    def _malformed(self, size: int, equality: NDArray[np.bool_], n: int) -> str:
        """Describe why the multipliers do not fit these constraints, empty if they do."""
        single = generators.count(size, n)
        known = generators.are_products(self.products, single)
        if not known or not are_indices(self.products, single + self.products.shape[0]):
            return "a product refers to a constraint that does not exist"
        equal = np.zeros(single + self.products.shape[0], bool)
        equal[1 : size + 1] = equality
        if not self.scaling.fits(n):
            return "the scaling is malformed"
        if self.priced is not None and not self.priced.consistent(n):
            return "a multiple of a monomial is malformed"
        return self._malformed_multipliers(equal, n)

    def _malformed_multipliers(self, equal: NDArray[np.bool_], n: int) -> str:
        for group in self.multipliers:
            if not group.consistent:
                return "the shapes of a multiplier do not fit"
            if not are_indices(group.generator, equal.size):
                return "a multiplier refers to a constraint that does not exist"
            if group.free and not np.all(equal[group.generator]):
                return "a multiplier without sign refers to an inequality"
            if not are_indices(group.basis, n + 1) or not 0 <= group.floor < np.inf:
                return "a multiplier has a malformed basis or floor"
            if not are_numbers(group.values):
                return "a multiplier is not finite"
        return ""

    def _remainder(
        self, constraints: PolynomialSystem, objective: PolynomialSystem, matrices: Matrices
    ) -> tuple[Words, Interval]:
        """Words and coefficients of r."""
        n, scaling = constraints.dimension, self.scaling
        made = ScaledGenerators.of(constraints, scaling, self.products)
        entries = ScaledGenerators.entries(matrices, scaling)
        words, _, value = scaling.expanded(objective)
        all_words, all_values = [words], [value]
        if self.priced is not None:
            all_words.append(monomials.trim(np.sort(self.priced.words, axis=1)))
            all_values.append(-Interval.point(self.priced.values.astype(float)))
        for group in self.multipliers:
            words, value = group.times(made, entries)
            all_words.append(words)
            all_values.append(-value)
        distinct, number = monomials.collect(monomials.stack(all_words), n)
        terms = Interval(
            np.concatenate([v.lo for v in all_values]), np.concatenate([v.hi for v in all_values])
        )
        return distinct, sum_by(number, terms, distinct.shape[0])

    def _absorb(self, words: Words, size: NDArray[Any], rows: int) -> tuple[float, str]:
        """Move monomials into the floors; what the moment blocks keep of theirs, or a reason."""
        n = self.scaling.centre.size
        groups = [g for g in self.multipliers if not g.free and g.floor > 0]
        letters = [
            generators.single_letters(*self.scaling.bounds, rows, g.generator) for g in groups
        ]
        usable = [(g, v) for g, v in zip(groups, letters, strict=True) if np.all(v >= 0)]
        open_ = np.ones(words.shape[0], bool)
        # what other groups hold of the moment blocks stays untouched
        kept = [
            g.floor
            for g, v in zip(groups, letters, strict=True)
            if np.any(v < 0) and np.any(g.generator == 0)
        ]
        for group, letter in usable:
            spent, hit = _spend(group, letter, words, size * open_, n)
            open_ &= ~hit
            left = float(np.nextafter(group.floor - spent, -np.inf)) if spent else group.floor
            if not left >= 0:
                return 0.0, "the remainder is larger than the margin of the blocks"
            if not letter.all():
                kept.append(left)
        if open_.any():
            return 0.0, (
                "the remainder has monomials of variables without finite bounds"
                if not usable
                else "the remainder has monomials outside every block with a margin"
            )
        return min(kept, default=0.0), ""


def _spend(
    group: Multipliers, letter: NDArray[Any], words: Words, size: NDArray[Any], n: int
) -> tuple[float, NDArray[np.bool_]]:
    """Assign each monomial of a size to one Gram entry; return the largest row sum.

    Marks the monomials that went.
    """
    j, i = np.tril_indices(group.basis.shape[1])
    product = monomials.multiply(group.basis[:, i], group.basis[:, j])
    product = monomials.multiply(product, letter[:, None, None])
    width = max(words.shape[1], product.shape[2])
    flat = monomials.widen(product.reshape(-1, product.shape[2]), width)
    available, first = np.unique(monomials.pack(flat, n), return_index=True)
    keys = monomials.pack(monomials.widen(words, width), n)
    place = np.minimum(np.searchsorted(available, keys), available.size - 1)
    hit = (available[place] == keys) & (size > 0)
    block, pair = np.divmod(first[place[hit]], product.shape[1])
    off = i[pair] != j[pair]
    share = np.where(off, 0.5, 1.0) * size[hit]
    row = block * group.basis.shape[1]
    index = np.concatenate([row + i[pair], (row + j[pair])[off]])
    shares = Interval.point(np.concatenate([share, share[off]]))
    sums = sum_by(index, shares, group.basis.shape[0] * group.basis.shape[1])
    return float(sums.hi.max(initial=0.0)), hit


def losses(
    words: Words, value: Interval, owner: NDArray[np.int64], size: int
) -> NDArray[np.float64]:
    """Bound -min r over the box from above for each owner, shape (size,).

    Monomials are bounded one by one.
    """
    if words.shape[0] == 0:
        return np.zeros(size)
    row, _, power = monomials.runs(words)
    odd = np.bincount(row, weights=power % 2, minlength=words.shape[0]) > 0
    cost = np.where(odd, value.magnitude(), np.maximum(0.0, -value.lo))
    total = sum_by(owner, Interval.point(cost), size).hi
    return np.where(total == 0, 0.0, up(total))
