"""Linear relaxations on a box: McCormick envelopes and their products, solved by HiGHS.

Every monomial of the scaled problem becomes a column in [-1, 1] (in [0, 1] where all its
powers are even). The rows are those of the linear shape of
:mod:`sparsepop_py.relaxation.moment`: constraints, equalities times their partners, products of
bounds. Many objectives are minimised on one model from the last simplex basis. Every dual,
optimal or of an infeasible program, becomes a :class:`LinearDual` and counts only for what
that proves.

References
----------
G. P. McCormick, Computability of global solutions to factorable nonconvex programs,
Math. Programming 10, 1976.
H. D. Sherali, C. H. Tuncbilek, A global optimization algorithm for polynomial programming
problems using a reformulation-linearization technique, J. Global Optim. 2, 1992.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.conic.program import ConicProgram
from sparsepop_py.lp.highs import LinearModel, LinearSolution
from sparsepop_py.problem import generators
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.assemble import assemble
from sparsepop_py.relaxation.moment import Relaxation, relax
from sparsepop_py.relaxation.recover_multipliers import finite, in_32_bits
from sparsepop_py.sparsity.correlative import Cliques
from sparsepop_py.tightening.settings import OBBT
from sparsepop_py.verified.arithmetic.array_cache import indices, interned
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaled, Scaling
from sparsepop_py.verified.certificate.lp_dual import LinearDual

__all__ = ["LinearRelaxation", "coordinate_of", "first_moments", "products_error"]


@dataclass(frozen=True, eq=False)
class LinearRelaxation:
    """The linear relaxation of a problem on one box.

    Parameters
    ----------
    scaled : Scaled
    relaxation : Relaxation
    program : ConicProgram
        With the objective of the problem.
    model : LinearModel
    """

    scaled: Scaled
    relaxation: Relaxation
    program: ConicProgram
    model: LinearModel

    @staticmethod
    def of(
        problem: Problem,
        box: Interval,
        cliques: Cliques,
        warm: LinearRelaxation | None = None,
        active: NDArray[np.bool_] | None = None,
        slack: NDArray[np.float64] | float = 0.0,
    ) -> LinearRelaxation:
        """Build the linear relaxation of a problem on a box.

        Parameters
        ----------
        problem : Problem
        box : Interval
        cliques : Cliques
        warm : LinearRelaxation, optional
            One of another box: its model is loaded anew and keeps its basis.
        active : (m,) bool, optional
            Constraints that take part; all when left out. Fewer make a weaker, smaller program.
        slack : (n,) float
            Its duals hold on boxes larger by this.
        """
        scaling = Scaling.of_box(box, slack=slack)
        scaled = Scaled.of(problem, scaling, (problem.objective,), active)
        relaxation = relax(scaled.problem, cliques=cliques, shape="linear")
        program = assemble(relaxation, scaled.objectives[0])
        matrix = sps.csr_array(program.A)
        low = np.full(program.b.size, -np.inf)
        low[: program.cones.zero] = program.b[: program.cones.zero]
        row, _, power = monomials.runs(relaxation.moments)
        odd = np.bincount(row, weights=power % 2, minlength=program.q.size) > 0
        columns = np.where(odd, -1.0, 0.0), np.ones(program.q.size)
        if warm is not None:
            warm.model.load(matrix, (low, program.b), columns)
        model = warm.model if warm else LinearModel(matrix, (low, program.b), columns)
        return LinearRelaxation(scaled, relaxation, program, model)

    @property
    def size(self) -> float:
        """Factor from the scaled objective to the original one."""
        return self.scaled.objective_sizes[0]

    def minimise(self, time_limit: float | None = None) -> LinearSolution:
        """Minimise the objective of the problem."""
        return self.model.solve(self.program.q, time_limit)

    def holds(self, variable: int) -> bool:
        """Check whether a variable occurs in the relaxation."""
        return bool(self.relaxation.variable_numbers[variable] > 0)

    def reach(self, variable: int, side: int, time_limit: float | None = None) -> LinearSolution:
        """Minimise side * x_v."""
        cost = np.zeros(self.program.q.size)
        cost[self.relaxation.variable_numbers[variable] - 1] = side
        return self.model.solve(cost, time_limit)

    @cached_property
    def _rows(self) -> tuple[NDArray[np.int64], Words, NDArray[np.bool_], NDArray[np.float64]]:
        """Generator, monomial, sign freedom and size of each row."""
        groups = self.relaxation.groups
        width = max(g.basis.shape[2] for g in groups)
        generator = np.concatenate([np.repeat(g.generator, g.rows_each) for g in groups])
        word = [monomials.widen(g.basis.reshape(-1, g.basis.shape[2]), width) for g in groups]
        free = np.concatenate([np.full(g.count * g.rows_each, g.free) for g in groups])
        sizes = self.scaled.generator_sizes(self.relaxation.products)
        return generator, np.concatenate(word), free, sizes[generator]

    def dual(
        self,
        prices: Sequence[NDArray[np.float64]],
        sizes: Sequence[float],
        short: bool = False,
    ) -> LinearDual:
        """Convert row prices to multipliers of the original constraints.

        Parameters
        ----------
        prices : sequence of (m,) float
            Row duals, one vector for each objective.
        sizes : sequence of float
            Sizes of the scaled objectives.
        short : bool
            Leave small multipliers out and store the rest in 32 bits. That costs about a millionth
            of the bound.

        Returns
        -------
        LinearDual
        """
        generator, word, free, size = self._rows
        rows, values, owners = [], [], []
        for owner, (price, weight) in enumerate(zip(prices, sizes, strict=True)):
            z = np.where(free, -price, np.maximum(-price, 0.0))
            small = 1e-7 if short else OBBT.small_multiplier
            row = np.flatnonzero(np.abs(z) > small * np.abs(z).max(initial=0.0))
            rows.append(row)
            with np.errstate(over="ignore", invalid="ignore"):
                values.append(finite(z[row] * weight / size[row]))
            owners.append(np.full(row.size, owner))
        row, value = np.concatenate(rows), np.concatenate(values)
        used, products = _used_products(
            generator[row], self.relaxation.products, self.scaled.problem
        )
        return LinearDual(
            self.scaled.scaling,
            indices(used),
            interned(monomials.trim(word[row]) if row.size else np.zeros((0, 1), np.int32)),
            in_32_bits(value) if short else value,
            indices(np.concatenate(owners)),
            indices(products),
        )

    def objective_dual(self, solution: LinearSolution) -> LinearDual:
        """Convert a solution's duals, or a ray of infeasibility of either sign, to multipliers."""
        size = 1.0 if solution.status == "infeasible" else self.size
        price = solution.dual
        if solution.status == "infeasible" and self._farkas(-price) > self._farkas(price):
            price = -price
        return self.dual([price], [size])

    def _farkas(self, price: NDArray[np.float64]) -> float:
        """Estimate the bound that a ray proves of the constant 0."""
        z = np.where(self._rows[2], -price, np.maximum(-price, 0.0))
        return float(-self.program.b @ z - np.abs(self.program.A.T @ z).sum())

    def point(self, solution: LinearSolution) -> NDArray[np.float64]:
        """Return the point x of a solution's first moments, shape (n,)."""
        return first_moments(self.scaled, self.relaxation, solution.x)

    def products_error(self, solution: LinearSolution) -> NDArray[np.float64]:
        """Sum the violations of products at a solution by variable, shape (n,)."""
        return products_error(self.relaxation, solution.x)


def _present(y: NDArray[np.float64], column: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the moments in some columns, 0 for the column -1 of none."""
    found = np.zeros(column.shape)
    found[column >= 0] = y[column[column >= 0]]
    return found


def first_moments(
    scaled: Scaled, relaxation: Relaxation, y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the point x whose scaled form has the moments of degree one, shape (n,)."""
    t = _present(y, relaxation.variable_numbers - 1)
    return scaled.scaling.point(np.clip(t, -1.0, 1.0))


def products_error(relaxation: Relaxation, y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum |y_a - t^a| over the monomials of each variable, shape (n,)."""
    n = relaxation.problem.dimension
    t = _present(y, relaxation.variable_numbers - 1)
    words = relaxation.moments
    longer = np.flatnonzero(monomials.degrees(words) > 1)
    miss = np.abs(y[longer] - monomials.evaluate(words[longer], t))
    row, variable, _ = monomials.runs(words[longer])
    return np.bincount(variable, weights=miss[row], minlength=n).astype(float)


def _used_products(
    generator: NDArray[np.int64], products: NDArray[np.int64], problem: Problem
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Remove products of constraints that no multiplier uses, and renumber."""
    single = generators.count(len(problem.constraints), problem.dimension)
    needed = np.zeros(single + products.shape[0], bool)
    needed[generator] = True
    for layer in reversed(generators.layers(products, single)):
        inside = np.array(layer)[needed[single + np.array(layer)]]
        needed[products[inside].ravel()] = True
    kept = np.flatnonzero(needed[single:])
    number = np.arange(needed.size)
    number[single + kept] = single + np.arange(kept.size)
    return number[generator], number[products[kept]]


def coordinate_of(objective: Polynomial) -> tuple[int, int] | None:
    """Return variable and side of an objective side * x_v, None for any other."""
    if objective.terms != 1 or objective.degree != 1 or abs(objective.coefficients[0]) != 1.0:
        return None
    return int(objective.support[0]), int(objective.coefficients[0])
