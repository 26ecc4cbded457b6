"""Quadratic problems as arrays over variables and products, for many linear programs.

A column stands for each variable and for each product of two variables in the problem, and the
rows are linear in these columns. On a box, x = centre + scale * t, the relaxation is

    minimise q'z,   z = (t, w),   A z >= b or A z == b,   t in [-1, 1],

with McCormick's envelopes of w = t_i t_j behind the rows. The pattern of A never changes; on
another box only its numbers do. Prices of the rows become multipliers of the problem's own
constraints, so that the trusted kernel computes what they prove.

All numbers here are rounded: they guide a search and prove nothing.

References
----------
G. P. McCormick, Computability of global solutions to factorable nonconvex programs: Part I,
Math. Programming 10, 1976.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
import scipy.sparse as sps
from numpy.typing import ArrayLike, NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.branch_and_bound.complements import Complements, Terms
from sparsepop_py.lp.highs import SparseRows
from sparsepop_py.problem import generators
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.recover_multipliers import finite
from sparsepop_py.verified.arithmetic.array_cache import indices, interned
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.certificate.lp_dual import LinearDual
from sparsepop_py.verified.certificate.multipliers import Multipliers
from sparsepop_py.verified.certificate.sos_identity import Identity

__all__ = ["LinearData", "ProductModel", "SquareCut"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_LEAST_SIZE = 1e-7  # of the largest term: where variables are nearly fixed the rest is rounding
_NOISE = 0.5  # largest coefficient of rows that this floor has made smaller than one

# Envelopes of w = t_i t_j: coefficients of w, t_i, t_j, and the bound families of both factors,
# 1 for t - (-1) and 2 for 1 - t. Each row is the product of two such factors, >= -1 without its
# constant. A square has the first two, where t_j is t_i.
_ENVELOPES = ((1, 1, 1, 1, 1), (1, -1, -1, 2, 2), (-1, 1, -1, 1, 2), (-1, -1, 1, 2, 1))


@dataclass(frozen=True, eq=False)
class LinearData:
    """Numbers of the linear relaxation on one box.

    Parameters
    ----------
    scaling : Scaling
    values : (K,) float
        Nonzeros of A, in the order of :attr:`ProductModel.pattern`.
    low : (R,) float
        Right sides b; -inf for rows that vary by rounding alone, which are left out.
    cost : (N,) float
        The objective over its size, without its constant.
    constant, size : float
        Objective = size * (constant + cost'z).
    sizes : (m + 1,) float
        Row of the problem = size * row of A; the objective comes last.
    free : (R,) bool
        Rows of A that are equations, on this box.
    """

    scaling: Scaling
    values: Floats
    low: Floats
    cost: Floats
    constant: float
    size: float
    sizes: Floats
    free: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class SquareCut:
    """The row |V (x - point)|^2 >= 0, linear in variables and products.

    Parameters
    ----------
    variables : (k,) int
    factor : (r, k) float
        V, whose columns belong to the variables.
    point : (k,) float
    pairs : (2, p) int
        Positions i <= j among the variables of the products that occur; others cancel in V'V.
    columns : (p,) int
        Columns of these products.
    """

    variables: Ints
    factor: Floats
    point: Floats
    pairs: Ints
    columns: Ints

    def scaled(self, scaling: Scaling) -> tuple[Floats, Floats]:
        """Write V (x - point) as u + M t, shapes (r,) and (r, k)."""
        v = self.variables
        shift = self.factor @ (scaling.centre[v] - self.point)
        return shift, self.factor * scaling.scale[v]

    def row(self, scaling: Scaling) -> tuple[Floats, float]:
        """Compute the coefficients of products and variables, and the right side."""
        shift, slope = self.scaled(scaling)
        matrix = slope.T @ slope
        i, j = self.pairs
        products = np.where(i == j, 1.0, 2.0) * matrix[i, j]
        return np.append(products, 2.0 * shift @ slope), -float(shift @ shift)


@dataclass(frozen=True, eq=False)
class ProductModel:
    """A problem of degree 2 over variables and products.

    Rows are the problem's constraints that are not constant, and the objective last.

    Parameters
    ----------
    dimension : int
        Number of variables n.
    first, second : (P,) int
        The factors of each product, first <= second.
    number : (m,) int
        The constraint behind each row.
    constraints : int
        Number of constraints of the problem.
    equality : (m,) bool
    constant : (m + 1,) float
        Constants of the rows.
    row, column : (T,) int
        Row and column of each term; columns of products follow the variables.
    coefficient : (T,) float
    cuts : tuple of SquareCut
        Rows that follow the envelopes.
    """

    dimension: int
    first: Ints
    second: Ints
    number: Ints
    constraints: int
    equality: NDArray[np.bool_]
    constant: Floats
    row: Ints
    column: Ints
    coefficient: Floats
    cuts: tuple[SquareCut, ...] = ()

    @staticmethod
    @lru_cache(maxsize=2)  # of the same problem: the first start and the tree ask for it
    def of(problem: Problem) -> ProductModel:
        """Write a problem of degree at most 2 over variables and products."""
        n = problem.dimension
        kept = np.array(
            [k for k, c in enumerate(problem.constraints) if c.polynomial.degree > 0], np.int64
        )
        polynomials = [problem.constraints[k].polynomial for k in kept] + [problem.objective]
        system = PolynomialSystem.stack(polynomials, n)
        words = system.words.astype(np.int64)
        last = words[:, -1]
        before = words[:, -2] if words.shape[1] > 1 else np.zeros_like(last)
        key, place = np.unique(before * (n + 1) + last, return_inverse=True)
        first, second = np.divmod(key, n + 1)
        double = first > 0
        column = np.where(double, n + np.cumsum(double) - 1, second - 1)[place.ravel()]
        free = last == 0
        constant = np.bincount(
            system.row[free], system.coefficients[free], minlength=kept.size + 1
        ).astype(float)
        return ProductModel(
            dimension=n,
            first=first[double] - 1,
            second=second[double] - 1,
            number=kept,
            constraints=len(problem.constraints),
            equality=problem.equality[kept],
            constant=constant,
            row=system.row[~free],
            column=column[~free],
            coefficient=system.coefficients[~free],
        )

    @property
    def rows(self) -> int:
        """Number of rows m of the problem, without the objective."""
        return self.number.size

    @property
    def columns(self) -> int:
        """Number of columns n + P."""
        return self.dimension + self.first.size

    @cached_property
    def square(self) -> NDArray[np.bool_]:
        """Products of a variable with itself, shape (P,)."""
        return self.first == self.second

    @cached_property
    def factors(self) -> Ints:
        """Variables that occur in products."""
        return monomials.distinct(np.concatenate([self.first, self.second]))

    @cached_property
    def two_valued(self) -> Ints:
        """Variables with two values at most, by an equation in one variable."""
        terms = np.bincount(self.row, minlength=self.rows + 1)
        squares = np.flatnonzero(self.column >= self.dimension)
        squares = squares[self.square[self.column[squares] - self.dimension]]
        v, row = self.first[self.column[squares] - self.dimension], self.row[squares]
        linear = np.flatnonzero(self.column < self.dimension)
        width = self.dimension
        both = np.isin(row * width + v, self.row[linear] * width + self.column[linear])
        equal = np.append(self.equality, False)
        alone = (terms[row] == 1) & (self.constant[row] != 0)  # x^2 = c
        return monomials.distinct(v[(both & (terms[row] == 2) | alone) & equal[row]])

    @cached_property
    def complementary(self) -> Ints:
        """Pairs of different variables whose product a row makes zero, shape (K, 2).

        It may say "at most zero", which is the same where both are at least zero.
        """
        columns = self.column[self._alone & (self.column >= self.dimension)]
        product = monomials.distinct(columns) - self.dimension
        product = product[~self.square[product]]
        return np.stack([self.first[product], self.second[product]], axis=1)

    @cached_property
    def complements(self) -> Complements:
        """Rows whose factors are a variable and another row."""
        products = (self.column >= self.dimension) & ~self._alone & (self.row < self.rows)
        if not np.any(self.constant[self.row[products]] == 0):
            return Complements.of([], self.equality)
        rows: list[Terms] = [{(): float(c)} if c else {} for c in self.constant[:-1]]
        n, first, second = self.dimension, self.first.tolist(), self.second.tolist()
        entries = zip(self.row, self.column, self.coefficient, strict=True)
        for row, column, value in ((int(r), int(c), float(a)) for r, c, a in entries):
            if row < self.rows:
                term = (column,) if column < n else (first[column - n], second[column - n])
                rows[row][term] = value
        return Complements.of(rows, self.equality)

    @cached_property
    def disjunctive(self) -> bool:
        """True if there are products, and all are in equations that branches of signs decide."""
        decided = np.zeros(self.first.size, bool)
        pairs = set(map(tuple, self.complementary.tolist()))
        both = zip(self.first.tolist(), self.second.tolist(), strict=True)
        decided[[pair in pairs for pair in both]] = True
        products = self.column >= self.dimension
        inside = np.isin(self.row, self.complements.equation)
        part = self.column[products & inside] - self.dimension
        decided[part] = True
        decided[self.column[products & ~inside & ~self._alone] - self.dimension] = False
        return bool(decided.size and np.all(decided))

    @cached_property
    def convex_but_values(self) -> bool:
        """True if all is convex once variables of two values have one of them.

        Rows are linear but for squares of such variables in equations.
        """
        products = (self.column >= self.dimension) & (self.row < self.rows)
        part = self.column[products] - self.dimension
        simple = self.square[part] & np.isin(self.first[part], self.two_valued)
        equal = np.append(self.equality, False)[self.row[products]]
        curved = np.any((self.column >= self.dimension) & (self.row == self.rows))
        decided = bool(self.two_valued.size and np.all(simple & equal))
        return decided and (not curved or self.rows in self.convex)

    @cached_property
    def _alone(self) -> NDArray[np.bool_]:
        """Terms that a row makes zero, or at most zero, alone, shape (T,)."""
        terms = np.bincount(self.row, minlength=self.rows + 1)
        alone = ((terms == 1) & (self.constant == 0))[self.row] & (self.row < self.rows)
        return alone & (np.append(self.equality, False)[self.row] | (self.coefficient < 0))

    @cached_property
    def least(self) -> Floats:
        """Least values of the columns over the box of t: 0 for squares, else -1."""
        return np.concatenate([-np.ones(self.dimension), np.where(self.square, 0.0, -1.0)])

    @cached_property
    def _parts(self) -> tuple[Ints, Ints, Ints, Ints, Floats]:
        """Terms after x = c + s t: row, column, two of (1, c, s)."""
        n, linear = self.dimension, self.column < self.dimension
        centre, scale = 1, 1 + n
        row, v, a = self.row[linear], self.column[linear], self.coefficient[linear]
        one, fixed = np.zeros_like(v), np.full_like(v, -1)
        made = [(row, v, scale + v, one, a), (row, fixed, centre + v, one, a)]
        row, w, a = self.row[~linear], self.column[~linear], self.coefficient[~linear]
        i, j, fixed = self.first[w - n], self.second[w - n], np.full_like(w, -1)
        made += [
            (row, w, scale + i, scale + j, a),
            (row, i, scale + i, centre + j, a),
            (row, j, centre + i, scale + j, a),
            (row, fixed, centre + i, centre + j, a),
        ]
        joined = [np.concatenate([part[k] for part in made]) for k in range(5)]
        return joined[0], joined[1], joined[2], joined[3], joined[4]

    @cached_property
    def _places(self) -> tuple[Ints, Ints, Ints, Ints]:
        """Parts that are no constants, their places among the nonzeros, and these in rows."""
        row, column, *_ = self._parts
        varies = np.flatnonzero(column >= 0)
        key, place = np.unique(row[varies] * self.columns + column[varies], return_inverse=True)
        rows, columns = np.divmod(key, self.columns)
        return varies, place.ravel(), rows, columns

    @cached_property
    def _envelopes(self) -> tuple[Ints, Ints, Floats, Ints]:
        """Row, column and value of the nonzeros of the envelopes, and generator pairs."""
        n, base = self.dimension, 1 + self.constraints
        rows, columns, values, pairs = [], [], [], []
        count = 0
        for k, (i, j) in enumerate(zip(self.first.tolist(), self.second.tolist(), strict=True)):
            for w, a, b, left, right in _ENVELOPES[: 2 if i == j else 4]:
                entries = ((n + k, w), (i, a + b)) if i == j else ((n + k, w), (i, a), (j, b))
                rows += [count] * len(entries)
                columns += [entry[0] for entry in entries]
                values += [float(entry[1]) for entry in entries]
                pairs.append((base + left * n + i, base + right * n + j))
                count += 1
        made = np.array(pairs, np.int64).reshape(-1, 2)
        return np.array(rows, np.int64), np.array(columns, np.int64), np.array(values), made

    @cached_property
    def pattern(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Columns of the nonzeros of A by rows, and where each row starts.

        Rows are those of the problem, the objective, and the envelopes.
        """
        _, _, rows, columns = self._places
        more, right, _, pairs = self._envelopes
        height = self.rows + 1 + pairs.shape[0]
        count = np.bincount(np.append(rows, self.rows + 1 + more), minlength=height)
        last = [np.append(cut.columns, cut.variables) for cut in self.cuts]
        count = np.append(count, [part.size for part in last])
        start = np.append(0, np.cumsum(count)).astype(np.int32)
        return np.concatenate([columns, right, *last]).astype(np.int32), start

    @property
    def envelopes(self) -> int:
        """Number of rows that are envelopes of products."""
        return int(self._envelopes[3].shape[0])

    def sparse_rows(self, values: Floats) -> SparseRows:
        """Put numbers in the pattern, for HiGHS."""
        columns, start = self.pattern
        return SparseRows(values, columns, start, (start.size - 1, self.columns))

    def matrix(self, values: Floats) -> sps.csr_array:
        """Put numbers in the pattern, shape (R, N)."""
        columns, start = self.pattern
        return sps.csr_array((values, columns, start), shape=(start.size - 1, self.columns))

    @cached_property
    def _row_of(self) -> Ints:
        """Row of each nonzero of A."""
        start = self.pattern[1]
        return np.repeat(np.arange(start.size - 1), np.diff(start))

    def with_cuts(self, cuts: tuple[SquareCut, ...]) -> ProductModel:
        """Take other cuts; what does not depend on them is kept.

        Parameters
        ----------
        cuts : tuple of SquareCut

        Returns
        -------
        ProductModel
        """
        made = replace(self, cuts=cuts)
        for name in (
            "square",
            "two_valued",
            "convex_but_values",
            "complementary",
            "least",
            "_parts",
            "_places",
            "_envelopes",
            "_convex",
        ):
            if name in self.__dict__:
                made.__dict__[name] = self.__dict__[name]
        return made

    def on_box(self, scaling: Scaling) -> LinearData:
        """Compute the numbers of the relaxation on the box of a scaling."""
        row, column, left, right, value = self._parts
        varies, place, rows, _ = self._places
        known = np.concatenate([np.ones(1), scaling.centre, scaling.scale])
        with np.errstate(over="ignore", invalid="ignore"):  # such a program has no solution
            part = value * known[left] * known[right]
        values: Floats = np.bincount(place, part[varies], minlength=rows.size).astype(float)
        fixed = np.flatnonzero(column < 0)
        constant = self.constant + np.bincount(
            row[fixed], part[fixed], minlength=self.constant.size
        )
        sizes = np.zeros(self.rows + 1)
        np.maximum.at(sizes, row, _LEAST_SIZE * np.abs(part))  # below it is rounding
        np.maximum.at(sizes, rows, np.abs(values))
        sizes = np.where(sizes > 0, sizes, 1.0)
        with np.errstate(invalid="ignore"):
            values /= sizes[rows]
            constant = constant / sizes
        largest = np.zeros(sizes.size)
        np.maximum.at(largest, rows, np.abs(values))
        noise = np.flatnonzero((largest[:-1] > 0) & (largest[:-1] < _NOISE))
        envelopes = self._envelopes
        cuts = [cut.row(scaling) for cut in self.cuts]
        last = [np.array([right for _, right in cuts])]
        low = np.concatenate([-constant[:-1], [-np.inf], -np.ones(envelopes[3].shape[0]), *last])
        cost = np.zeros(self.columns)
        own = rows == self.rows
        cost[self._places[3][own]] = values[own]
        size = float(sizes[-1])
        everything = np.concatenate([values, envelopes[2], *(part for part, _ in cuts)])
        free = self._equations(scaling)
        low[noise], free[noise] = -np.inf, False
        return LinearData(scaling, everything, low, cost, float(constant[-1]), size, sizes, free)

    def _equations(self, scaling: Scaling) -> NDArray[np.bool_]:
        """Mark rows of A that are equations on a box: beside all others, complements."""
        free = self.free.copy()
        found = self.complements
        free[found.inequality[found.positive(scaling)]] = True
        return free

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """Rows of A that are equations, shape (R,)."""
        others = 1 + self._envelopes[3].shape[0] + len(self.cuts)
        return np.concatenate([self.equality, np.zeros(others, bool)])

    def high(self, data: LinearData) -> Floats:
        """Compute upper sides of the rows of A."""
        return np.where(data.free, data.low, np.inf)

    def signed(self, data: LinearData, price: Floats) -> Floats:
        """Set prices of inequalities with the wrong sign to zero, and that of the objective."""
        kept = np.where(data.free, price, np.maximum(price, 0.0))
        kept[self.rows] = 0.0
        return kept

    def rest(self, data: LinearData, cost: Floats, price: Floats) -> Floats:
        """Compute the reduced costs of the columns."""
        return cost - self.combined(data.values, price)

    def combined(self, values: Floats, price: Floats) -> Floats:
        """Add the rows of A, with these numbers, times their prices."""
        products = values * price[self._row_of]
        return np.bincount(self.pattern[0], products, minlength=self.columns).astype(float)

    def bound(self, data: LinearData, rest: Floats, price: Floats) -> float:
        """Estimate what prices prove of a cost with these reduced costs."""
        used = price != 0
        base = float(price[used] @ data.low[used])
        return base + float(np.minimum(rest * self.least, rest).sum())

    def uses_cuts(self, price: Floats) -> bool:
        """Check for prices of cuts, which need an identity with squares."""
        return bool(self.cuts) and bool(np.any(price[-len(self.cuts) :] > 0))

    def identity(self, data: LinearData, price: Floats, size: float) -> Identity:
        """Convert row prices, those of cuts among them, to an identity with squares.

        Parameters
        ----------
        data : LinearData
        price : (R,) float
        size : float
            Size of the cost that the prices belong to.

        Returns
        -------
        Identity
        """
        dual = self.dual(data, [price], [size])
        equal = np.zeros(1 + self.constraints, bool)
        equal[1 + self.number[self.equality]] = True
        free = np.append(equal, np.zeros(int(dual.generator.max(initial=0)) + 1, bool))[
            dual.generator
        ]
        groups = []
        for chosen, is_free in ((free, True), (~free & (dual.value > 0), False)):
            number = dual.generator[chosen]
            if number.size:
                basis = np.zeros((number.size, 1, 1), np.int32)
                value = dual.value[chosen][:, None]
                value = value if is_free else np.sqrt(value)[:, :, None]
                groups.append(Multipliers(number, basis, value))
        for cut, weight in zip(self.cuts, price[-len(self.cuts) :], strict=True):
            if weight > 0:
                shift, slope = cut.scaled(data.scaling)
                letters = np.append(0, cut.variables + 1).astype(np.int32)
                with np.errstate(over="ignore", invalid="ignore"):
                    factor = np.sqrt(weight * size) * np.concatenate([shift[None], slope.T])
                one = np.zeros(1, np.int32)
                groups.append(Multipliers(one, letters[None, :, None], finite(factor[None])))
        return Identity(data.scaling, tuple(groups), dual.products)

    def cut(self, row: int, point: Floats) -> SquareCut | None:
        """Build the cut of a row at a point, None where it is not convex.

        Parameters
        ----------
        row : int
            A row of the problem, whose negative counts, or the objective.
        point : (n,) float
        """
        found = self._convex.get(row)
        if found is None:
            return None
        variables, factor, pairs, columns = found
        return SquareCut(variables, factor, point[variables], pairs, columns)

    @cached_property
    def convex(self) -> tuple[int, ...]:
        """Rows with squares that are convex where they bound from below."""
        return tuple(self._convex)

    @cached_property
    def _convex(self) -> dict[int, tuple[Ints, Floats, Ints, Ints]]:
        """Variables, factor, pairs and product columns of the convex quadratic rows."""
        found = {}
        for row in monomials.distinct(self.row[self.column >= self.dimension]).tolist():
            if row < self.rows and self.equality[row]:
                continue
            made = self._factor(row)
            if made is not None:
                found[row] = made
        return found

    def _factor(self, row: int) -> tuple[Ints, Floats, Ints, Ints] | None:
        """Factor the quadratic form of a row as V'V, None where it is not convex."""
        n = self.dimension
        terms = np.flatnonzero((self.row == row) & (self.column >= n))
        columns, value = self.column[terms], self.coefficient[terms]
        value = value if row == self.rows else -value
        i, j = self.first[columns - n], self.second[columns - n]
        variables = monomials.distinct(np.append(i, j))
        left, right = np.searchsorted(variables, i), np.searchsorted(variables, j)
        matrix = np.zeros((variables.size, variables.size))
        np.add.at(matrix, (left, right), 0.5 * value)
        np.add.at(matrix, (right, left), 0.5 * value)
        size, vectors = np.linalg.eigh(matrix)
        if size[0] < -1e-10 * size[-1] or not size[-1] > 0:
            return None
        kept = size > 1e-10 * size[-1]
        factor = (np.sqrt(size[kept]) * vectors[:, kept]).T
        return variables, factor, np.stack([left, right]), columns

    def dual(
        self,
        data: LinearData,
        prices: Sequence[Floats],
        sizes: ArrayLike,
        cutoff: ArrayLike | None = None,
    ) -> LinearDual:
        """Convert row prices to multipliers of the constraints of the problem.

        Parameters
        ----------
        data : LinearData
        prices : K vectors (R,) float
        sizes : (K,) float
            Sizes of the costs that the prices belong to.
        cutoff : (K,) float, optional
            Multipliers of the row cutoff - f(x) >= 0, which then stands behind the constraints;
            in units of the sizes.

        Returns
        -------
        LinearDual
        """
        count = self.constraints + (cutoff is not None)
        found, later = self.complements, int(cutoff is not None)
        lower = 1 + self.constraints + self.dimension + found.variable
        own = np.stack([1 + self.number[found.inequality], lower + later], axis=1)
        pairs = np.concatenate([self._envelopes[3] + later, own])
        single = generators.count(count, self.dimension)
        above = self.rows + 1
        table = np.array(prices)[:, : above + self.envelopes]
        table = found.replaced(table, data.scaling, data.sizes, self.free)
        used = np.flatnonzero(np.any(table[:, above:] != 0, axis=0))
        place = np.full(pairs.shape[0], -1)
        place[used] = np.arange(used.size)
        generator, value, owner = [], [], []
        for k, (price, size) in enumerate(zip(table, np.atleast_1d(sizes), strict=True)):
            rows = np.flatnonzero(price[: self.rows])
            more = np.flatnonzero(price[above:])
            each = [1 + self.number[rows], single + place[more]]
            with np.errstate(over="ignore", invalid="ignore"):
                values = [price[rows] * size / data.sizes[rows], price[above + more] * size]
                if cutoff is not None:
                    each.append(np.array([count]))
                    values.append(np.atleast_1d(cutoff)[k : k + 1] * size)
            generator += each
            value += values
            owner.append(np.full(sum(part.size for part in each), k))
        numbers = finite(np.concatenate(value).astype(float))
        return LinearDual(
            data.scaling,
            indices(np.concatenate(generator)),
            interned(np.zeros((numbers.size, 1), np.int32)),
            numbers,
            indices(np.concatenate(owner)),
            indices(pairs[used]),
        )
