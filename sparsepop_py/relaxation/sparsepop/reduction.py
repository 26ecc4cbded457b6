"""Reduction of conic programs before they are solved, and recovery of their solutions.

Rows of the zero cone that express one moment in terms of smaller ones are solved for it,
which takes the row and the moment out of the program. Their multipliers follow from the
stationarity q + A'z = 0 of the moments that left. Rows and moments may also be rescaled, so
that the program is that of the unscaled problem; semidefinite blocks keep their cones, since
their rows are scaled by D Z D with a diagonal D.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve_triangular

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.conic.program import Cones, ConicProgram, ConicSolution
from sparsepop_py.conic.program import solution as recomputed
from sparsepop_py.relaxation.assemble import assemble
from sparsepop_py.relaxation.moment import Relaxation
from sparsepop_py.relaxation.sparsepop.relaxation import Switches
from sparsepop_py.relaxation.sparsepop.substitution import Rules
from sparsepop_py.verified.box.scaling import Scaled

__all__ = ["ReducedProgram", "reduce_program"]


@dataclass(frozen=True, eq=False)
class ReducedProgram:
    """Reduced program with the data to recover solutions of the whole one.

    Parameters
    ----------
    program : ConicProgram
        The reduced program, for the solver.
    whole : ConicProgram
        The program of the relaxation.
    moments, rows : (M',) int, (R',) int
        Moments and rows of the whole program that are left.
    moment_scale, row_scale : (M',) float, (R',) float
        moment = scale * scaled moment, and likewise for rows.
    objective_scale : float
    solved, leaving : (K,) int
        Rows that were solved for moments that left, by ascending moments.
    """

    program: ConicProgram
    whole: ConicProgram
    moments: NDArray[np.int64]
    rows: NDArray[np.int64]
    moment_scale: NDArray[np.float64]
    row_scale: NDArray[np.float64]
    objective_scale: float
    solved: NDArray[np.int64]
    leaving: NDArray[np.int64]

    def reduced(self, solution: ConicSolution) -> ConicSolution:
        """Restrict a solution of the whole program to the reduced one."""
        y = solution.y[self.moments] * self.moment_scale
        z = solution.z[self.rows] * self.objective_scale / self.row_scale
        return _again(self.program, solution, y, z)

    def restored(self, solution: ConicSolution) -> ConicSolution:
        """Recover the solution of the whole program from one of the reduced program."""
        whole = self.whole
        y, z = np.zeros(whole.q.size), np.zeros(whole.b.size)
        y[self.moments] = solution.y / self.moment_scale
        z[self.rows] = solution.z * self.row_scale / self.objective_scale
        if self.solved.size:
            pivots = _triangle(whole, self.solved, self.leaving)
            known = whole.b[self.solved] - (whole.A @ y)[self.solved]
            y[self.leaving] = spsolve_triangular(pivots, known, lower=True)
            right = -(whole.q + whole.A.T @ z)[self.leaving]
            z[self.solved] = spsolve_triangular(pivots.T.tocsr(), right, lower=False)
        return _again(whole, solution, y, z)


def _again(
    program: ConicProgram, of: ConicSolution, y: NDArray[Any], z: NDArray[Any]
) -> ConicSolution:
    words = of.iterations, of.seconds, of.solver, of.detail
    return replace(recomputed(program, of.status, y, z, *words), wall=of.wall)


def reduce_program(
    relaxation: Relaxation, scaled: Scaled, objective: Polynomial, switches: Switches
) -> ReducedProgram:
    """Reduce the program of a relaxation with a scaled objective."""
    whole = assemble(relaxation, objective)
    solved, leaving = _pivots(relaxation, whole, switches)
    rows = np.setdiff1d(np.arange(whole.b.size), solved)
    moments = np.setdiff1d(np.arange(whole.q.size), leaving)
    q, A, b, offset = whole.q[moments], whole.A, whole.b, whole.offset
    A = sps.csc_array(sps.csr_array(whole.A)[rows])[:, moments]
    b = whole.b[rows]
    if solved.size:
        pivots = _triangle(whole, solved, leaving).tocsc()
        equations = sps.csr_array(whole.A)[solved]
        inverse = _solved(pivots, sps.csc_array(equations)[:, moments])
        constant = spsolve_triangular(pivots.tocsr(), whole.b[solved], lower=True)
        held = sps.csc_array(sps.csr_array(whole.A)[rows])[:, leaving]
        A = sps.csc_array(A - held @ inverse)
        b = b - held @ constant
        q = q - inverse.T @ whole.q[leaving]
        offset += float(whole.q[leaving] @ constant)
    A.eliminate_zeros()
    zero = int(np.count_nonzero(rows < whole.cones.zero))
    if switches.independent:
        size = np.bincount(A.indices, np.abs(A.data), A.shape[0])[:zero]
        keep = np.append(size > 1e-12, np.ones(A.shape[0] - zero, bool))
        keep[:zero] |= np.abs(b[:zero]) > 1e-9
        A, b, rows = sps.csc_array(sps.csr_array(A)[np.flatnonzero(keep)]), b[keep], rows[keep]
        zero = int(np.count_nonzero(keep[:zero]))
    cones = Cones(zero, whole.cones.nonnegative, whole.cones.psd)
    moment_scale, row_scale, unit = np.ones(moments.size), np.ones(rows.size), 1.0
    if not switches.scaled:
        moment_scale, row_scale, unit = _original(relaxation, scaled, moments, rows)
        A = sps.csc_array(sps.diags_array(row_scale) @ A @ sps.diags_array(1.0 / moment_scale))
        q, b, offset = unit * q / moment_scale, row_scale * b, unit * offset
    program = ConicProgram(q, A, b, cones, offset)
    return ReducedProgram(
        program, whole, moments, rows, moment_scale, row_scale, unit, solved, leaving
    )


def _solved(pivots: sps.csc_array, right: sps.csc_array) -> sps.csc_array:
    """Compute pivots^-1 right, both sparse; substituted equations mostly have one term."""
    unit = sps.eye_array(pivots.shape[0], format="csc")
    diagonal = pivots.diagonal()
    scaled = sps.csc_array(sps.diags_array(1.0 / diagonal) @ pivots)
    rest = sps.csc_array(unit - scaled)  # strictly lower, hence nilpotent
    rest.eliminate_zeros()
    result = term = sps.csc_array(sps.diags_array(1.0 / diagonal) @ right)
    while rest.nnz and term.nnz:
        term = sps.csc_array(rest @ term)
        term.eliminate_zeros()
        result = result + term
    return sps.csc_array(result)


def _pivots(
    relaxation: Relaxation, program: ConicProgram, switches: Switches
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """List rows of substituted equations and the moment that each is solved for."""
    rules = Rules.of(relaxation.problem, switches.substituted)
    if not rules.generator.size:
        return np.zeros(0, int), np.zeros(0, int)
    generator = _of_rows(relaxation)[0][: program.cones.zero]
    rows = np.flatnonzero(np.isin(generator, rules.generator))
    matrix = sps.csr_array(program.A)[rows]
    matrix.sort_indices()
    leading = matrix.indices[matrix.indptr[1:] - 1].astype(np.int64)
    order = np.argsort(leading, kind="stable")
    return rows[order], leading[order]


def _triangle(program: ConicProgram, rows: NDArray[Any], moments: NDArray[Any]) -> sps.csr_array:
    return sps.csr_array(sps.csc_array(sps.csr_array(program.A)[rows])[:, moments])


def _of_rows(relaxation: Relaxation) -> tuple[NDArray[np.int64], Words]:
    """List the generator of each row and the monomial that multiplies it."""
    numbers, words = [], []
    for group in relaxation.groups:
        numbers.append(np.repeat(group.generator, group.rows_each))
        product = group.products()
        words.append(product.reshape(-1, product.shape[-1]))
    return np.concatenate(numbers), monomials.stack(words)


def _original(
    relaxation: Relaxation, scaled: Scaled, moments: NDArray[Any], rows: NDArray[Any]
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Compute sizes of moments, rows and objective in the units of the given problem."""
    scale = np.where(scaled.scaling.scale > 0, scaled.scaling.scale, 1.0)
    generator, words = _of_rows(relaxation)
    sizes = scaled.generator_sizes(relaxation.products)
    _, low, high = (slice(s, s + scale.size) for s in sizes.size - scale.size * np.arange(3, 0, -1))
    sizes[low], sizes[high] = scale, scale
    if relaxation.moment_bounds is not None:
        bounds = relaxation.moment_bounds
        first = np.searchsorted(bounds.row, np.arange(bounds.size))
        sizes = np.append(sizes, monomials.evaluate(bounds.words[first], scale))
    row = sizes[generator] * monomials.evaluate(words, scale)
    y = monomials.evaluate(relaxation.moments, scale)
    return y[moments], row[rows], scaled.objective_sizes[0]
