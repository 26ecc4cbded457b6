"""Dense linear algebra on stacks (K, s, s) of equal matrices, in numpy and LAPACK.

Matrix products of stacks run at the speed of BLAS from size four on, so everything is
brought into that form; triangular inverses, for which numpy has no stacked routine, are
built from products by halving.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from importlib import import_module
from types import ModuleType
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack, solve_triangular

from sparsepop_py.budget import importing

__all__ = [
    "OutOfTime",
    "Workers",
    "check",
    "cholesky",
    "compiled_kernels",
    "largest_step",
    "lower_inverse",
    "symmetric",
    "transposed",
]

Reals = NDArray[np.float64]
Part = TypeVar("Part")
Result = TypeVar("Result")
_SLIGHTLY_LESS = 1.0 - 1e-9  # of a step length, against rounding
_COMPILED = f"{__package__}.compiled"
_LARGE = 64  # size from which LAPACK runs matrix by matrix
_HALVED = 1024  # size from which the clock is looked at in the middle of a matrix


class OutOfTime(Exception):
    """The time of a solve ended inside an iteration."""


class Workers:
    """Threads that share one piece of work; results do not depend on their number.

    Parameters
    ----------
    threads : int
        One does everything in the thread that asks.
    """

    def __init__(self, threads: int = 1) -> None:
        self.threads = threads
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None

    def each(self, work: Callable[[Part], Result], parts: Sequence[Part]) -> list[Result]:
        """List the results of all parts; an error is raised after all have ended."""
        if self._pool is None or len(parts) < 2:
            return [work(part) for part in parts]
        asked = [self._pool.submit(work, part) for part in parts]
        wait(asked)
        return [part.result() for part in asked]

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()


def check(deadline: float | None) -> None:
    """Look at the clock between two pieces of work.

    Raises
    ------
    OutOfTime
        If the moment ``deadline`` on the monotonic clock is past.
    """
    if deadline is not None and time.monotonic() > deadline:
        raise OutOfTime("time limit")


def compiled_kernels() -> ModuleType:
    """Import the kernels that numba compiles.

    Returns
    -------
    module

    Raises
    ------
    ImportError
        If numba is missing or cannot keep its machine code.
    """
    found = sys.modules.get(_COMPILED)  # each kernel of each iteration asks for it
    if found is not None:
        return found
    try:
        with importing():
            return import_module(_COMPILED)
    except RuntimeError as error:  # numba finds no place for its cache
        raise ImportError(str(error)) from error


def transposed(matrices: Reals) -> Reals:
    """View each matrix transposed."""
    return matrices.swapaxes(1, 2)


def symmetric(matrices: Reals) -> Reals:
    """Compute the symmetric part of each matrix."""
    return 0.5 * (matrices + transposed(matrices))


def cholesky(matrices: Reals, deadline: float | None = None) -> Reals:
    """Compute lower Cholesky factors; only lower triangles are read.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a matrix is not positive definite.
    OutOfTime
        If ``deadline`` passes between parts of a large matrix.
    """
    count, size, _ = matrices.shape
    if size < _LARGE:
        return np.linalg.cholesky(matrices).astype(np.float64, copy=False)
    result = np.array(matrices)  # a lower triangle by rows is an upper one by columns
    for k in range(count):
        _factorize(result[k], deadline)
    return result


def _factorize(matrix: Reals, deadline: float | None) -> None:
    """Factorize one matrix in place, halves first where it is large."""
    check(deadline)
    size = matrix.shape[0]
    if size < _HALVED:
        factor, failed = lapack.dpotrf(matrix.T, lower=0, clean=1, overwrite_a=1)
        if failed:
            raise np.linalg.LinAlgError("a matrix is not positive definite")
        matrix[:] = factor.T  # factorized in place already where the matrix is contiguous
        return
    h = size // 2
    _factorize(matrix[:h, :h], deadline)
    below = solve_triangular(matrix[:h, :h], matrix[h:, :h].T, lower=True, check_finite=False).T
    matrix[h:, :h], matrix[:h, h:] = below, 0.0
    for part in range(0, size - h, _HALVED):
        check(deadline)
        rows = slice(h + part, h + part + _HALVED)
        matrix[rows, h:] -= below[part : part + _HALVED] @ below.T
    _factorize(matrix[h:, h:], deadline)


def lower_inverse(factors: Reals, result: Reals, deadline: float | None = None) -> None:
    """Invert lower triangular matrices (K, s, s) into ``result``, upper parts zero.

    Raises
    ------
    OutOfTime
        If ``deadline`` passes between parts of large matrices.
    """
    result.fill(0.0)
    _invert(factors, result, deadline)


def _invert(factors: Reals, result: Reals, deadline: float | None) -> None:
    check(deadline)
    count, size, _ = factors.shape
    if size == 1:
        np.divide(1.0, factors, out=result)
    if size <= 1:
        return
    if count <= size // 2 and 8 <= size < _LARGE:
        for k in range(count):
            np.copyto(result[k], lapack.dtrtri(factors[k].T, lower=0)[0].T)
        return
    h = size // 2
    _invert(factors[:, :h, :h], result[:, :h, :h], deadline)
    _invert(factors[:, h:, h:], result[:, h:, h:], deadline)
    below = factors[:, h:, :h] @ result[:, :h, :h]
    np.negative(result[:, h:, h:] @ below, out=result[:, h:, :h])


def largest_step(inverse: Reals, direction: Reals, limit: float, roughly: bool = False) -> float:
    """Compute the largest a <= limit that keeps every L L' + a D semidefinite.

    Parameters
    ----------
    inverse : (K, s, s) float
        Inverse Cholesky factors L^-1.
    direction : (K, s, s) float
        Symmetric D.
    limit : float
    roughly : bool
        Whether to look at the suspects only (see below) and perhaps return too much.

    Returns
    -------
    float

    Notes
    -----
    With T = L^-1 D L^-T the answer is -1 / lambda_min(T). Eigenvalues are computed for a few
    suspects first, chosen by lambda_min >= c - (trace (c I - T)^8)^(1/8), and one Cholesky
    factorization of all I + a T tells whether they were the right ones.
    """
    scaled = inverse @ direction @ transposed(inverse)
    count = scaled.shape[0]
    least = _least_eigenvalue_bounds(scaled)
    order = np.argsort(least, kind="stable")
    begin, chunk = 0, max(8, count // 64)
    while begin < count:
        some = order[begin : begin + chunk]
        some = some[least[some] * limit < -1.0]
        if some.size == 0:
            break
        found = float(np.linalg.eigvalsh(scaled[some])[:, 0].min())
        if found * limit < -1.0:
            limit = -1.0 / found
        begin, chunk = begin + chunk, 8 * chunk
        if roughly:
            break
        if begin < count and _inside(scaled, limit * _SLIGHTLY_LESS):
            return limit * _SLIGHTLY_LESS
    return limit


def _least_eigenvalue_bounds(matrices: Reals) -> Reals:
    size = matrices.shape[1]
    diagonal = np.arange(size)
    mean = np.einsum("kii->k", matrices) / size
    square = np.einsum("kij,kij->k", matrices, matrices) / size
    centre = mean + np.sqrt(np.maximum(square - mean * mean, 0.0))
    shifted = -matrices
    shifted[:, diagonal, diagonal] += centre[:, None]
    fourth = shifted @ shifted
    fourth = fourth @ fourth
    return centre - np.einsum("kij,kij->k", fourth, fourth) ** 0.125


def _inside(scaled: Reals, step: float) -> bool:
    """Check that every I + step T is positive definite."""
    diagonal = np.arange(scaled.shape[1])
    moved = step * scaled
    moved[:, diagonal, diagonal] += 1.0
    try:
        np.linalg.cholesky(moved)
    except np.linalg.LinAlgError:
        return False
    return True
