"""Conic programs in one convention, always in moment form.

    minimise  q'y + offset   subject to   A y + s = b,   s in K,

y being the moments without the constant, K a product of zero cones, non-negative rows
and positive semidefinite cones (upper triangle column by column, off-diagonal entries
times sqrt 2). A solution carries (y, s, z) with z in K* (free on zero rows),
stationarity q + A'z = 0 and dual value offset - b'z. Solvers may be fed another form;
what comes back is translated into this one.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.errors import FormatError, SparsePOPError
from sparsepop_py.files import read_bytes, write_file

__all__ = ["STATUSES", "Cones", "ConicProgram", "ConicSolution", "solution"]


_LARGEST = 2**33  # bytes of the arrays of a stored program


@dataclass(frozen=True)
class Cones:
    """The cone K, in the order of the rows.

    Parameters
    ----------
    zero : int
        Rows that must vanish.
    nonnegative : int
        Rows that must not be negative.
    psd : tuple of int
        Sizes of the semidefinite blocks, each with s (s + 1) / 2 rows.
    """

    zero: int
    nonnegative: int
    psd: tuple[int, ...]

    @property
    def rows(self) -> int:
        """Number of rows R."""
        return self.zero + self.nonnegative + sum(s * (s + 1) // 2 for s in self.psd)


# What a damaged archive raises; a RuntimeError where its flags ask for a password or a patch.
_DAMAGED = (EOFError, KeyError, RuntimeError, TypeError, ValueError, BadZipFile, zlib.error)


@dataclass(frozen=True, eq=False)
class ConicProgram:
    """Conic program: minimise q'y + offset subject to s in K.

    The slacks are s = b - A y. The cone K is a product: first rows that have to be zero, then rows
    that must not be negative, then matrices that have to be positive semidefinite. A matrix takes
    the rows of its upper triangle, column by column, off-diagonal entries times the root of 2.

    Parameters
    ----------
    q : (M,) float
        Objective of the M moments y.
    A : csc (R, M)
        One row for each of the R entries of s.
    b : (R,) float
    cones : Cones
        The cone K, by the number of its rows of each kind.
    offset : float
        Constant of the objective; 0 when left out.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> problem = sp.Problem(x * y, [x**2 + y**2 <= 1])
    >>> print(sp.assemble(sp.relax(problem), problem.objective))
    conic program: 5 moments, 7 rows (0 zero, 1 linear, 1 semidefinite blocks up to 3)
    """

    q: NDArray[np.float64]
    A: sps.csc_array
    b: NDArray[np.float64]
    cones: Cones
    offset: float = 0.0

    def save(self, path: str | Path) -> None:
        """Write the program as a NumPy ``npz`` archive, for :meth:`load`.

        Parameters
        ----------
        path : str or Path
            Used as it is; no suffix is added.

        Raises
        ------
        OutputError
            If the file cannot be written.
        """
        parts: dict[str, Any] = {
            "q": self.q,
            "b": self.b,
            "offset": self.offset,
            "data": self.A.data,
            "indices": self.A.indices,
            "indptr": self.A.indptr,
            "zero": self.cones.zero,
            "nonnegative": self.cones.nonnegative,
            "psd": np.array(self.cones.psd, int),
        }
        write_file(path, lambda file: np.savez_compressed(file, **parts))

    @staticmethod
    def load(path: str | Path) -> ConicProgram:
        """Read a program that :meth:`save` wrote.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        ConicProgram

        Raises
        ------
        FormatError
            If the file is missing or is no such archive.
        """
        try:
            data = read_bytes(path)
            _check_archive(data)
            with np.load(BytesIO(data)) as file:
                shape = (file["b"].size, file["q"].size)
                matrix = sps.csc_array((file["data"], file["indices"], file["indptr"]), shape=shape)
                sizes = tuple(int(s) for s in file["psd"])
                cones = Cones(int(file["zero"]), int(file["nonnegative"]), sizes)
                return ConicProgram(file["q"], matrix, file["b"], cones, float(file["offset"]))
        except _DAMAGED as error:
            raise FormatError(f"{path}: expected a saved conic program: {error}") from error

    def __str__(self) -> str:
        return (
            f"conic program: {self.q.size} moments, {self.b.size} rows "
            f"({self.cones.zero} zero, {self.cones.nonnegative} linear, "
            f"{len(self.cones.psd)} semidefinite blocks up to {max(self.cones.psd, default=0)})"
        )


STATUSES = ("solved", "almost", "infeasible", "unbounded", "failed")  # that solvers may return


@dataclass(frozen=True, eq=False)
class ConicSolution:
    """Output of a conic solver. No value in it is a bound.

    Parameters
    ----------
    status : {"solved", "almost", "infeasible", "unbounded", "failed"}
        Of the moment form; ``detail`` holds the solver's own words.
    y, s, z : arrays (M,), (R,), (R,)
        In the convention of this module.
    primal, dual : float
        q'y + offset and offset - b'z, recomputed here.
    residual : float
        Largest entry of |q + A'z|, recomputed here.
    iterations : int
    seconds : float
        CPU seconds spent in the solver.
    solver : str
    detail : str
    wall : float
        Seconds of wall time spent in the solver.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> problem = sp.Problem(x * y, [x**2 + y**2 <= 1])
    >>> solution = sp.solve_conic(sp.assemble(sp.relax(problem), problem.objective))
    >>> solution.status, round(solution.primal, 6)
    ('solved', -0.5)
    """

    status: str
    y: NDArray[np.float64]
    s: NDArray[np.float64]
    z: NDArray[np.float64]
    primal: float
    dual: float
    residual: float
    iterations: int
    seconds: float
    solver: str
    detail: str = ""
    wall: float = 0.0


def solution(
    program: ConicProgram,
    status: str,
    y: NDArray[np.float64],
    z: NDArray[np.float64],
    iterations: int,
    seconds: float,
    solver: str,
    detail: str,
) -> ConicSolution:
    """Recompute slack, values and residual of a solver's solution from the program.

    Parameters
    ----------
    program : ConicProgram
    status : str
        One of :data:`STATUSES`.
    y : (M,) float
    z : (R,) float
    iterations : int
    seconds : float
    solver : str
    detail : str

    Returns
    -------
    ConicSolution

    Raises
    ------
    SparsePOPError
        If the status is none of :data:`STATUSES`, or y or z has another shape.
    """
    if status not in STATUSES:
        raise SparsePOPError(
            f"solver {solver!r}: found status {status!r}, expected one of {', '.join(STATUSES)}"
        )
    for name, found, size in (("y", y, program.q.size), ("z", z, program.b.size)):
        if np.shape(found) != (size,):
            raise SparsePOPError(
                f"solver {solver!r}: found {name} of shape {np.shape(found)}, expected ({size},)"
            )
    y = np.where(np.isfinite(y), y, 0.0)
    z = np.where(np.isfinite(z), z, 0.0)
    residual = program.q + program.A.T @ z
    return ConicSolution(
        status=status,
        y=y,
        s=program.b - program.A @ y,
        z=z,
        primal=float(program.q @ y + program.offset),
        dual=float(program.offset - program.b @ z),
        residual=float(np.abs(residual).max(initial=0.0)),
        iterations=iterations,
        seconds=seconds,
        solver=solver,
        detail=detail,
    )


def _check_archive(data: bytes) -> None:
    """Refuse an archive whose arrays would fill the memory."""
    with ZipFile(BytesIO(data)) as archive:
        size = sum(part.file_size for part in archive.infolist())
    if size > _LARGEST:
        raise ValueError(f"found {size} bytes of arrays, expected at most {_LARGEST}")
