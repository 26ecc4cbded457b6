"""The SDP behind a call of ``sparsePOP``: its data, sizes, solution and solver's report."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.compat.output import SDPInfo, SolverInfo
from sparsepop_py.conic.program import Cones, ConicProgram, ConicSolution
from sparsepop_py.relaxation.assemble import assemble
from sparsepop_py.relaxation.moment import Relaxation
from sparsepop_py.relaxation.sparsepop.reduction import ReducedProgram, reduce_program
from sparsepop_py.result import Result, Status
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaled, Scaling

__all__ = ["BuiltSDP", "SeDuMi", "dimacs_errors", "full_columns", "sizes_of", "solver_info"]

_ROOT2 = float(np.sqrt(2.0))


@dataclass(frozen=True, eq=False)
class SeDuMi:
    """SeDuMi's form of a program: A (M, N), b (M,), c (N,) and K.

    Parameters
    ----------
    A : csc (M, N)
    b : (M,) float
    c : (N,) float
    K : dict
        ``f`` free and ``l`` linear variables, ``s`` sizes of semidefinite blocks.
    """

    A: sps.csc_array
    b: NDArray[np.float64]
    c: NDArray[np.float64]
    K: dict[str, object]

    @staticmethod
    def of(program: ConicProgram) -> SeDuMi:
        """Convert a program to SeDuMi's form."""
        spread = full_columns(program.cones)
        cones = program.cones
        K = {"f": cones.zero, "l": cones.nonnegative, "s": np.array(cones.psd, float)}
        A = sps.csc_array((spread @ program.A).T)
        return SeDuMi(A, -program.q, spread @ program.b, K)


def full_columns(cones: Cones) -> sps.csr_array:
    """Build the matrix (N, R) that writes triangles of blocks as full matrices."""
    free = cones.zero + cones.nonnegative
    columns, values, offset = [np.arange(free)], [np.ones(free)], free
    for size, count in _runs(cones):
        j, i = np.tril_indices(size)
        place = np.empty((size, size), int)
        place[i, j] = place[j, i] = np.arange(i.size)
        starts = offset + i.size * np.arange(count)
        columns.append((starts[:, None] + place.ravel()).ravel())
        weight = np.where(np.eye(size, dtype=bool), 1.0, 1.0 / _ROOT2).ravel()
        values.append(np.tile(weight, count))
        offset += i.size * count
    column = np.concatenate(columns)
    entries = (np.concatenate(values), (np.arange(column.size), column))
    return sps.csr_array(entries, shape=(column.size, cones.rows))


def dimacs_errors(program: ConicProgram, solution: ConicSolution) -> NDArray[np.float64]:
    """Compute the six error measures of the seventh DIMACS challenge, shape (6,).

    References
    ----------
    H. D. Mittelmann, An independent benchmarking of SDP and SOCP solvers, Math. Program. 95
    (2003) 407-430.
    """
    q, b, y, z = program.q, program.b, solution.y, solution.z
    s = b - program.A @ y
    zero = program.cones.zero
    size_q, size_b = 1.0 + np.abs(q).max(initial=0.0), 1.0 + np.abs(b).max(initial=0.0)
    value = 1.0 + abs(float(b @ z)) + abs(float(q @ y))
    return np.array(
        [
            float(np.linalg.norm(q + program.A.T @ z)) / size_q,
            max(0.0, -_least(program.cones, z)) / size_q,
            float(np.linalg.norm(s[:zero])) / size_b,
            max(0.0, -_least(program.cones, s)) / size_b,
            float(b @ z + q @ y) / value,
            float(s[zero:] @ z[zero:]) / value,
        ]
    )


def _least(cones: Cones, vector: NDArray[np.float64]) -> float:
    """Compute the least eigenvalue of all blocks and linear entries."""
    least = float(vector[cones.zero : cones.zero + cones.nonnegative].min(initial=np.inf))
    offset = cones.zero + cones.nonnegative
    for size, count in _runs(cones):
        j, i = np.tril_indices(size)
        matrix = np.zeros((count, size, size))
        part = vector[offset : offset + i.size * count].reshape(count, i.size)
        matrix[:, i, j] = matrix[:, j, i] = part * np.where(i == j, 1.0, 1.0 / _ROOT2)
        least = min(least, float(np.linalg.eigvalsh(matrix).min()))
        offset += i.size * count
    return least if np.isfinite(least) else 0.0


def _runs(cones: Cones) -> list[tuple[int, int]]:
    """Sizes of semidefinite blocks, and how many of each follow one another."""
    return [(size, len(list(run))) for size, run in groupby(cones.psd)]


_SURE = 1e-7  # DIMACS errors that count as none where no tolerance was asked for
_FEASIBILITY = {"solved": 1.0, "infeasible": -1.0, "unbounded": -1.0}


@dataclass(frozen=True, eq=False)
class BuiltSDP:
    """The program that was solved, in the form in which the solver had it.

    Parameters
    ----------
    relaxation : Relaxation
    program : ConicProgram
    solution : ConicSolution or None
        Of that program.
    moments : (M,) int
        Which moments of the relaxation are left.
    scaled : Scaled or None
        With the plain relaxation.
    scale : (M,) float
        Moment of the program = scale * moment of the relaxation.
    """

    relaxation: Relaxation
    program: ConicProgram
    solution: ConicSolution | None
    moments: NDArray[np.int64]
    scaled: Scaled | None
    scale: NDArray[np.float64]

    @staticmethod
    def of(result: Result) -> BuiltSDP | None:
        """Rebuild the last SDP behind a result, None without one."""
        relaxation, solution = result.relaxation, result.solution
        if relaxation is None:
            return None
        switches, objective = result.options.switches, relaxation.problem.objective
        if switches is None:
            program = assemble(relaxation, objective)
            count = program.q.size
            return BuiltSDP(relaxation, program, solution, np.arange(count), None, np.ones(count))
        problem = result.problem
        box = Interval(problem.lower, problem.upper)
        scaling = Scaling.of_bounds(box, switches.scaled)
        scaled = Scaled.of(problem, scaling, (problem.objective,), whole=True)
        perturbed = switches.perturbed(objective, relaxation)
        small = reduce_program(relaxation, scaled, perturbed, switches)
        return BuiltSDP(
            relaxation,
            small.program,
            _reduced(small, solution),
            small.moments,
            scaled,
            small.moment_scale,
        )

    @property
    def words(self) -> Words:
        """The monomials of the moments."""
        return self.relaxation.moments[self.moments]

    def first_moments(self) -> NDArray[np.float64] | None:
        """Return the point of the moments of degree one; None without a solution."""
        known = self.solution is not None and self.solution.status in ("solved", "almost")
        if self.scaled is None or self.solution is None or not known:
            return None
        n = self.relaxation.problem.dimension
        letters = np.arange(1, n + 1, dtype=np.int32)[:, None]
        place = monomials.lookup(letters, self.words, n)
        fixed = self.scaled.scaling.scale == 0
        if np.any((place < 0) & ~fixed):
            return None
        y = np.append(self.solution.y / self.scale, 0.0)  # the last for those that are fixed
        return self.scaled.scaling.point(np.where(fixed, 0.0, y[place]))

    def map(self) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Map each variable to its moment: number (from 1, -1 for none), scale, shift."""
        n = self.relaxation.problem.dimension
        letters = np.arange(1, n + 1, dtype=np.int32)[:, None]
        place = monomials.lookup(letters, self.words, n)
        if self.scaled is None:
            return np.where(place < 0, -1, place + 1), np.ones(n), np.zeros(n)
        scaling = self.scaled.scaling
        unit = np.append(self.scale, 1.0)[place]
        moment = np.where(place < 0, -1, place + 1)
        return moment, scaling.scale / unit, scaling.centre


def _reduced(small: ReducedProgram, solution: ConicSolution | None) -> ConicSolution | None:
    return None if solution is None else small.reduced(solution)


def sizes_of(result: Result, built: BuiltSDP | None) -> SDPInfo:
    """Fill ``SDPinfo``: sizes, data and solution of the SDP."""
    problem = result.problem
    fixed = np.flatnonzero(problem.lower == problem.upper)
    all_fixed = fixed.size == problem.dimension
    sign = -1.0 if problem.sense == "max" else 1.0
    info = SDPInfo(
        *(0, 0, 0, 0, 0, (), ()),
        _infeasible_switch(result, all_fixed),
        sign * problem.objective.constant_term,
        problem.dimension,
        problem.dimension - fixed.size,
        np.stack([fixed + 1.0, problem.lower[fixed]], axis=1),
        2 if all_fixed else 0,
    )
    if built is None:
        return info
    program, cones = built.program, built.program.cones
    spread = full_columns(cones)
    weight = np.bincount(spread.indices, minlength=cones.rows)  # columns of each row
    smaller = cones.rows < built.relaxation.rows
    info = replace(
        info,
        rowSizeA=program.q.size,
        colSizeA=spread.shape[0],
        nonzerosInA=int(weight[program.A.indices].sum()),
        noOfFreevar=cones.zero,
        noOfLPvariables=cones.nonnegative,
        SDPblock=tuple(cones.psd),
        reduceAMatSW=2 if all_fixed else int(smaller),
        xIdxVec=monomials.to_exponents(built.words, problem.dimension),
    )
    if built.solution is not None:
        weighted = spread @ built.solution.z
        info = replace(info, y=built.solution.y, x=weighted)
    switches = result.options.switches
    if built.scaled is None or switches is None:
        return info
    size = built.scaled.objective_sizes[0] if switches.scaled else 1.0
    return replace(_with_data(info, built, fixed), objValScale=size)


def _with_data(info: SDPInfo, built: BuiltSDP, fixed: NDArray[np.int64]) -> SDPInfo:
    """Data of the plain relaxation, and the map from its moments to the variables."""
    assert built.scaled is not None
    _, scale, shift = built.map()
    open_ = np.setdiff1d(np.arange(scale.size), fixed)
    entries = (scale[open_], (open_, np.arange(open_.size)))
    whole = SeDuMi.of(built.program)
    return replace(
        info,
        Amat=sps.csc_array(entries, shape=(scale.size, open_.size)),
        bVect=shift,
        SeDuMiA=whole.A,
        SeDuMib=whole.b,
        SeDuMic=whole.c,
        SeDuMiK=whole.K,
    )


def _infeasible_switch(result: Result, all_fixed: bool) -> float:
    if all_fixed and result.status is Status.INFEASIBLE:
        return 2.0
    if all_fixed and result.attained is not None:
        return -2.0
    if result.solution is None:
        return 1.0 if result.status is Status.INFEASIBLE else 0.0
    return 0.5 if result.solution.status in ("infeasible", "unbounded") else 0.0


def solver_info(
    built: BuiltSDP | None, asked: bool, tolerance: float | None = None, optimal: bool = False
) -> SolverInfo:
    """Fill ``SDPsolverInfo``: what the solver reported; NaN where it was not asked to solve.

    Parameters
    ----------
    built : BuiltSDP or None
    asked : bool
    tolerance : float, optional
        What ``numerr`` compares the DIMACS errors with, ``param.SDPsolverEpsilon``. Without one
        errors up to 1e-7 count as none.
    optimal : bool
        The gap is proved to be closed: without a ``tolerance``, ``numerr`` is 0 then.
    """
    if not asked:
        nothing = float("nan")
        return SolverInfo(
            solver="",
            iter=0,
            numerr=0,
            pinf=nothing,
            dinf=nothing,
            cpusec=0.0,
            feasratio=None,
            residual=None,
            detail="no SDP was to be solved",
        )
    if built is None or built.solution is None:
        return SolverInfo(
            solver="",
            iter=0,
            numerr=0,
            pinf=0,
            dinf=0,
            cpusec=0.0,
            feasratio=None,
            residual=None,
            detail="no SDP was solved",
        )
    solution = built.solution
    errors = dimacs_errors(built.program, solution)
    largest = float(np.abs(errors).max())
    sure = solution.status in ("infeasible", "unbounded")
    if tolerance is not None:
        sure |= largest <= tolerance
    else:
        sure |= optimal or (solution.status == "solved" and largest <= _SURE)
    return SolverInfo(
        solver=solution.solver,
        iter=solution.iterations,
        numerr=0 if sure else 1,
        pinf=int(solution.status == "unbounded"),
        dinf=int(solution.status == "infeasible"),
        cpusec=solution.seconds,
        feasratio=_FEASIBILITY.get(solution.status),
        residual=solution.residual,
        detail=solution.detail,
        timing=(0.0, solution.seconds, 0.0),
        err=errors,
        r0=largest,
        wallsec=solution.wall,
    )
