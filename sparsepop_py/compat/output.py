"""Outputs of ``sparsePOP``: the six outputs of SparsePOP 3.03 as frozen classes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.compat.param import Parameters
from sparsepop_py.compat.param_table import FIELDS
from sparsepop_py.result import Result, Status
from sparsepop_py.verified.certificate.certificate import Certificate

if TYPE_CHECKING:
    from sparsepop_py.compat.intervals import IntervalsDetail

__all__ = [
    "CpuTime",
    "POPOutput",
    "SDPInfo",
    "SolverInfo",
    "SparsePOPOutput",
    "cell",
    "intervals_struct",
    "matlab_structs",
]


@dataclass(frozen=True, eq=False)
class POPOutput:
    """``POP``: bounds and points, in the sense (min or max) and units of the input.

    Parameters
    ----------
    xVect : (n,) float
        With ``tighten = 1`` the attained point, else the best nearly feasible one, else the
        moments of degree one. With ``tighten = 0`` those moments, as in the original: mostly not
        feasible. Where there are none, the point of the bounds nearest to 0. Always filled, except
        with ``SDPsolverSW = 0``; ``violation`` says how far from feasible it is.
    objValue : float or None
        Objective at ``xVect``.
    absError : float or None
        Smallest of min(g, 0), -|h| over constraints and bounds at ``xVect``: 0 or negative.
    scaledError : float or None
        The same with each row divided by max(1, its largest term at ``xVect``).
    xVectL, objValueL, absErrorL, scaledErrorL
        The same for the locally refined point, which provably exists: empty and None
        unless ``param.POPsolver`` is set and such a point was found. Bounds count in the
        errors, which the original leaves out here, besides swapping the two.
    lowerBound, upperBound : float
        Both rigorous: the optimal value lies between them. One is proved by the
        certificate (``SDPobjValue``), the other attained by a point that provably exists.
    status : Status
    certificate : Certificate or None
        Of ``SDPobjValue``; ``certificate.verify(POP.result.problem)`` re-checks it.
    solverValue : float or None
        The optimal value of the SDP as the solver returned it: NOT a bound. As in the original
        infinite where it reports pinf or dinf. None when no SDP was solved.
    result : Result
        Everything else; always about the minimisation, and with ``eqTolerance`` about the
        problem with the larger set.
    objValueScaled : float or None
        The same number as ``objValue``, as in the original.
    xCenter, zeta : list of (n,) float, list of float, or None
        For each set of ``errorBdIdx``: |x_I - xCenter_I|^2 <= zeta is proved for every
        feasible x with f(x) <= fValueUbd.
    violation : float or None
        Largest violation of a constraint or bound at ``xVect``, 0 or positive, in the units of
        the problem: - ``absError``.
    """

    xVect: NDArray[np.float64]
    objValue: float | None
    absError: float | None
    scaledError: float | None
    xVectL: NDArray[np.float64]
    objValueL: float | None
    absErrorL: float | None
    scaledErrorL: float | None
    lowerBound: float
    upperBound: float
    status: Status
    certificate: Certificate | None
    solverValue: float | None
    result: Result
    objValueScaled: float | None = None
    xCenter: list[NDArray[np.float64]] | None = None
    zeta: list[float] | None = None
    violation: float | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what was done and what a proof lacks, those of ``result``."""
        return self.result.notes


@dataclass(frozen=True)
class CpuTime:
    """CPU seconds of the stages.

    Parameters
    ----------
    conversion : float
        Presolve, relaxation and assembly.
    SDPsolver : float
    certification : float
        Evaluation of the safe bound.
    readData : float
        From structs or file to the problem.
    localMethod : float
        Local search and its proofs.
    total : float
        As in the original without ``readData`` and ``localMethod``.
    singleObj : float or None
        From residuals to their sum of squares (part of ``readData``); None for one objective.
    """

    conversion: float
    SDPsolver: float
    certification: float
    readData: float
    localMethod: float
    total: float
    singleObj: float | None = None


@dataclass(frozen=True, eq=False)
class SolverInfo:
    """``SDPsolverInfo``: the last call of the conic solver. Nothing proved rests on it.

    Parameters
    ----------
    solver : str
        Empty when no solver was needed.
    iter : int
    numerr : int
        0 when no entry of ``err`` is beyond the tolerance that was asked for,
        ``param.SDPsolverEpsilon``, else 1. Without one the tolerance is 1e-7, and numerr is 0 too
        where the gap is proved to be closed.
    pinf, dinf : int
        pinf is 1 when it reports that there is no sum of squares (a higher order or bounds
        may give one), dinf when it reports that the moment relaxation has no point.
        Both are NaN when no SDP was solved on request.
    cpusec : float
    feasratio : float or None
        What SeDuMi's indicator tends to: 1 when both programs were solved, -1 when one is
        reported to have no point; None where the solver stopped between.
    residual : float or None
        Largest entry of the stationarity residual.
    detail : str
        The solver's own words.
    timing : (float, float, float)
        CPU seconds before, in and after the solver's iterations; only the second is known.
    err : (6,) float or None
        The DIMACS error measures, recomputed from the program.
    r0 : float or None
        The largest of ``err`` in size.
    wallsec : float or None
        Wall seconds of the solver.
    """

    solver: str
    iter: int
    numerr: int
    pinf: float
    dinf: float
    cpusec: float
    feasratio: float | None
    residual: float | None
    detail: str
    timing: tuple[float, float, float] = (0.0, 0.0, 0.0)
    err: NDArray[np.float64] | None = None
    r0: float | None = None
    wallsec: float | None = None


@dataclass(frozen=True, eq=False)
class SDPInfo:
    """``SDPinfo``: the size of the last SDP built in SeDuMi's form (the sum-of-squares side).

    One row of A a moment; one column a free variable, a linear one, or an entry of a
    semidefinite block of size s, which takes s * s columns.

    Parameters
    ----------
    rowSizeA, colSizeA, nonzerosInA : int
    noOfFreevar, noOfLPvariables : int
    SOCPblock, SDPblock : tuple of int
        Sizes of the blocks; there are never second-order cones.
    infeasibleSW : float
        0: the SDP was solved, or was not needed; 0.5: the solver reports pinf or dinf; 1:
        infeasible by presolve, no SDP; 2: all variables fixed at an infeasible point; -2:
        all variables fixed at a feasible one.
    objConstant : float
        Constant term of the objective as given.
    dimVar0, dimVar : int
        Number of variables, and of those that are not fixed by their bounds.
    fixedVar : (k, 2) float
        Index (from 1) and value of the fixed variables.
    reduceAMatSW : int
        0: nothing was reduced; 1: equations or moments left the program; 2: all variables are
        fixed.
    objValScale : float
        Objective = ``objValScale`` times the objective of the SDP.
    y : (M,) float or None
        The moments, scaled as ``Amat`` says; the SDP's dual variables in SeDuMi's form.
    x : (N,) float or None
        The multipliers, in SeDuMi's form.
    xIdxVec : csr (M, n)
        Exponents of the moments.
    Amat, bVect : csc (n, k), (n,) float
        x = Amat y1 + bVect, y1 being the moments of degree one of the k variables that are
        not fixed. With ``tighten = 0`` only, as the next.
    SeDuMiA, SeDuMib, SeDuMic, SeDuMiK
        The SDP: minimise c'x subject to A x = b, x in K.
    """

    rowSizeA: int
    colSizeA: int
    nonzerosInA: int
    noOfFreevar: int
    noOfLPvariables: int
    SOCPblock: tuple[int, ...]
    SDPblock: tuple[int, ...]
    infeasibleSW: float
    objConstant: float
    dimVar0: int
    dimVar: int
    fixedVar: NDArray[np.float64]
    reduceAMatSW: int = 0
    objValScale: float = 1.0
    y: NDArray[np.float64] | None = None
    x: NDArray[np.float64] | None = None
    xIdxVec: sps.csr_array | None = None
    Amat: sps.csc_array | None = None
    bVect: NDArray[np.float64] | None = None
    SeDuMiA: sps.csc_array | None = None
    SeDuMib: NDArray[np.float64] | None = None
    SeDuMic: NDArray[np.float64] | None = None
    SeDuMiK: dict[str, object] | None = None


class SparsePOPOutput(NamedTuple):
    """Six outputs of the original, in its order.

    Parameters
    ----------
    param : Parameters
        The parameters as they were understood.
    SDPobjValue : float or None
        Proved: a lower bound of the minimum, +inf when it is proved that no point is feasible,
        -inf when nothing is proved. For a maximisation it is an upper bound of the maximum, and
        the two infinities change places. None with ``SDPsolverSW = 0``.
    POP : POPOutput
        Bounds and points.
    cpuTime : CpuTime
    SDPsolverInfo : SolverInfo
    SDPinfo : SDPInfo
        Sizes of the SDP.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, = sp.variables(1)
    >>> output = sp.sparsePOP(sp.Problem(x, lower=2, upper=3), {"printLevel": 0})
    >>> param, SDPobjValue, POP, cpuTime, SDPsolverInfo, SDPinfo = output
    >>> SDPobjValue <= 2.0 <= POP.upperBound
    True
    """

    param: Parameters
    SDPobjValue: float | None
    POP: POPOutput
    cpuTime: CpuTime
    SDPsolverInfo: SolverInfo
    SDPinfo: SDPInfo


_EMPTY = np.zeros((0, 0))

# Fields that scripts may read of the original's structs: empty where there is no value here.
_ORIGINAL = {
    "POP": """xVect objValue objValueScaled absError scaledError xVectL objValueL absErrorL
        scaledErrorL""",
    "cpuTime": "conversion SDPsolver total readData localMethod",
    "SDPsolverInfo": "iter feasratio pinf dinf numerr r0 timing wallsec cpusec err",
    "SDPinfo": """rowSizeA colSizeA nonzerosInA noOfFreevar noOfLPvariables SOCPblock SDPblock
        reduceAMatSW infeasibleSW objConstant objValScale SeDuMiA SeDuMib SeDuMic SeDuMiK Amat
        bVect dimVar0 dimVar fixedVar x y xIdxVec""",
}


def matlab_structs(output: SparsePOPOutput) -> dict[str, Any]:
    """List the six outputs with the original's names first, in its order."""
    given = {name: _matlab(value) for name, value in output._asdict().items()}
    for name, known in _ORIGINAL.items():
        given[name] = dict.fromkeys(known.split(), _EMPTY) | given[name]
    return given


def intervals_struct(detail: IntervalsDetail) -> dict[str, Any]:
    """List the ends of intervals as columns of MATLAB, with the status of each end."""
    names = ("indices", "lo", "hi", "innerLo", "innerHi")
    columns = {name: np.array(getattr(detail, name), float)[:, None] for name in names}
    status = np.array(detail.status, dtype=object).reshape(-1, 2)
    return columns | {"status": status}


def _matlab(value: Any) -> Any:
    """Convert a value for MATLAB: doubles, columns, rows of sizes, ``[]`` for None."""
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, (str, bool, np.bool_)):
        return value
    if isinstance(value, (int, float, np.number)):
        return float(value)
    if isinstance(value, np.ndarray) and value.dtype == object:
        return value  # a cell array already
    if isinstance(value, (list, tuple)) and value:  # of unequal lengths perhaps
        numeric = all(isinstance(item, (int, float, np.number)) for item in value)
        return np.array([value], float) if numeric else cell(map(_matlab, value), row=True)
    if value is None or np.size(value) == 0:
        return _EMPTY
    if sps.issparse(value):
        return sps.csc_matrix(value, dtype=float)
    if isinstance(value, np.ndarray):
        return value
    return {name: _matlab(item) for name, item in _fields(value).items()}


def _fields(value: Any) -> dict[str, Any]:
    """List the fields of a struct in MATLAB."""
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, Parameters):
        every = {entry.name: getattr(value, entry.name) for entry in FIELDS} | dict(value.given)
        return {name: item for name, item in every.items() if item is not None}
    if isinstance(value, Certificate):
        names = ("bound", "cutoff", "leaves", "numbers", "fingerprint")
        return {"claim": str(value)} | {name: getattr(value, name) for name in names}
    found = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, POPOutput):
        del found["result"]
        found["notes"] = cell(value.notes)
    return found


def cell(items: Iterable[Any], row: bool = False) -> NDArray[np.object_]:
    """Build a cell array, column or row."""
    listed = list(items)
    cell = np.empty((len(listed), 1), dtype=object)
    for place, item in enumerate(listed):
        cell[place, 0] = item
    return cell.T if row else cell
