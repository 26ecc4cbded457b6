"""Multipliers of an identity, and the generators they multiply, in scaled variables.

A multiplier of a matrix G is a positive semidefinite matrix S of polynomials. It contributes
the product <S, G> = sum_pq S_pq G_pq, non-negative where both are semidefinite. S is
stored as other squares are, by a factor: with monomials b_e that go with rows p_e of G,

    S_pq(t) = sum over e, f with p_e = p, p_f = q of (L L')_ef b_e(t) b_f(t).

References
----------
C. W. J. Hol, C. W. Scherer, Sum of squares relaxations for polynomial semidefinite
programming, MTNS 2004.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.matrix_constraints import Matrices
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.problem import generators
from sparsepop_py.verified.arithmetic.array_cache import interned
from sparsepop_py.verified.arithmetic.array_checks import are_indices
from sparsepop_py.verified.arithmetic.interval import Interval, gram
from sparsepop_py.verified.box.scaling import Scaling

__all__ = ["Multipliers", "ScaledGenerators"]


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Multipliers of one shape.

    Parameters
    ----------
    generator : (K,) int
        What they multiply, numbered as in :mod:`sparsepop_py.problem.generators`.
    basis : (K, s, D) int32
        Monomials in t, as words.
    values : (K, s) or (K, s, r) float
        Coefficients of the free multiplier of an equality, or the factor L of squares.
    floor : float
        The floor of these squares, >= 0.
    place : (K, s) int, optional
        With matrices of constraints: the row that goes with each monomial.
    """

    generator: NDArray[np.integer]
    basis: Words
    values: NDArray[Any]
    floor: float = 0.0
    place: NDArray[np.integer] | None = None

    @property
    def free(self) -> bool:
        """True if these multiply equalities."""
        return self.values.ndim == 2

    @property
    def consistent(self) -> bool:
        """Check that generator, basis, values and places belong together."""
        blocks = self.generator.shape[0] if self.generator.ndim == 1 else -1
        return (
            self.basis.ndim == 3
            and self.values.ndim in (2, 3)
            and self.basis.shape[0] == self.values.shape[0] == blocks > 0
            and self.basis.shape[1] == self.values.shape[1] > 0
            and self.basis.shape[2] > 0
            and (self.place is None or self.place.shape == self.values.shape[:2])
            and (self.place is None or not self.free)
        )

    def of_matrices(self, side: NDArray[np.int64]) -> bool:
        """Check that every place is a row of its constraint's matrix of sides (m,)."""
        if self.place is None:
            return True
        if not are_indices(self.generator - 1, side.size):
            return False
        rows = side[self.generator - 1][:, None]
        return are_indices(self.place, int(side.max(initial=0))) and bool(np.all(self.place < rows))

    def terms(self) -> tuple[Words, Interval]:
        """List monomials and coefficients of each multiplier, shapes (K, R, D') and (K, R)."""
        if self.free:
            return self.basis, Interval.point(self.values.astype(float))
        j, i = np.tril_indices(self.basis.shape[1])
        matrix = gram(self.values.astype(float))
        shift = np.where(i == j, self.floor, 0.0)
        entry = Interval(matrix.lo[:, i, j], matrix.hi[:, i, j]) + Interval.point(shift)
        weight = Interval.point(np.where(i == j, 1.0, 2.0))
        return monomials.multiply(self.basis[:, i], self.basis[:, j]), entry * weight

    @property
    def numbers(self) -> int:
        """Number of stored numbers."""
        return self.values.size

    def times(self, made: ScaledGenerators, entries: ScaledGenerators) -> tuple[Words, Interval]:
        """Multiply by the generators or by matrices; return monomials and coefficients."""
        product, weight = self.terms()
        number, source = self.generator, made
        if self.place is not None and entries.matrices is not None:
            j, i = np.tril_indices(self.basis.shape[1])
            owner, source = self.generator[:, None] - 1, entries
            number = entries.matrices.entry(owner, self.place[:, i], self.place[:, j]).ravel()
            product = product.reshape(number.size, 1, product.shape[2])
            weight = Interval(weight.lo.reshape(-1, 1), weight.hi.reshape(-1, 1))
        block, term = source.system.terms_of(number)
        joined = monomials.multiply(product[block], source.system.words[term][:, None, :])
        value = source.value[term]
        part = weight[block] * Interval(value.lo[:, None], value.hi[:, None])
        words = monomials.trim(joined.reshape(-1, joined.shape[-1]))
        return words, Interval(part.lo.ravel(), part.hi.ravel())

    def __reduce__(self) -> tuple[Any, ...]:
        """Factors that are lower triangular go without the zeros above."""
        values, shape = self.values, None
        if values.ndim == 3 and values.size:
            lower = _lower(values.shape)
            if not np.any(values[:, ~lower]):
                values, shape = values[:, lower], values.shape
        return _filled, (self.generator, self.basis, values, shape, self.floor, self.place)

    def chosen(self, used: NDArray[Any], values: NDArray[Any]) -> Multipliers:
        """Select the used blocks, with new values."""
        place = None if self.place is None else interned(self.place[used])
        generator, basis = interned(self.generator[used]), interned(self.basis[used])
        return replace(self, generator=generator, basis=basis, values=values, place=place)


def _lower(shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Mark entries of factors (K, s, r) on or below the diagonal, (s, r)."""
    return np.tri(*shape[1:], dtype=np.bool_)


def _filled(
    generator: NDArray[Any],
    basis: Words,
    values: NDArray[Any],
    shape: tuple[int, ...] | None,
    floor: float,
    place: NDArray[Any] | None,
) -> Multipliers:
    """Multipliers, with zeros above the diagonals where a shape (K, s, r) is given."""
    if shape is not None:
        packed, values = values, np.zeros(shape, values.dtype)
        values[:, _lower(shape)] = packed
    return Multipliers(generator, basis, values, floor, place)


@dataclass(frozen=True, eq=False)
class ScaledGenerators:
    """Generators in t: 1, the constraints, and the bounds of each variable.

    The coefficients of the terms of ``system`` are enclosed by ``value``. Where the rows are
    the entries of matrices, ``matrices`` locates these.
    """

    system: PolynomialSystem
    value: Interval
    matrices: Matrices | None = None

    @staticmethod
    def entries(matrices: Matrices, scaling: Scaling) -> ScaledGenerators:
        """Scale the entries of matrices to t."""
        given = matrices.system
        words, row, value = scaling.expanded(given)
        system = PolynomialSystem(words, value.lo, row, given.size, given.dimension)
        return ScaledGenerators(system, value, matrices)

    @staticmethod
    def of(
        constraints: PolynomialSystem, scaling: Scaling, products: NDArray[np.integer]
    ) -> ScaledGenerators:
        """Expand them around the centre of the scaling; products (P, 2) follow at the end."""
        n, m = constraints.dimension, constraints.size
        words, row, value = scaling.expanded(constraints)
        lower, upper = scaling.bounds
        bound_words, bound_values, bound_rows = generators.bound_terms(lower, upper, m)
        low, high = bound_values, bound_values
        if scaling.ends is not None:  # products and sums of the ends of t are rounded
            low, high = np.nextafter(low, -np.inf), np.nextafter(high, np.inf)
        lo = np.concatenate([np.ones(1), value.lo, low])
        hi = np.concatenate([np.ones(1), value.hi, high])
        system = PolynomialSystem(
            generators.stack_words(words, bound_words),
            lo,
            np.concatenate([np.zeros(1, int), row + 1, bound_rows]),
            generators.count(m, n),
            n,
        )
        value = Interval(lo, hi)
        for layer in generators.layers(products, system.size):
            words, number, first, second = generators.product_terms(system, products[layer])
            made = value[first] * value[second]
            value = Interval(np.append(value.lo, made.lo), np.append(value.hi, made.hi))
            system = PolynomialSystem(
                monomials.stack((system.words, words)),
                value.lo,
                np.append(system.row, number + system.size),
                system.size + len(layer),
                n,
            )
        return ScaledGenerators(system, value)
