"""Models of MPS and LP files, as HiGHS reads them."""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import highspy
import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.errors import FormatError
from sparsepop_py.lp.highs import QuietHighs

__all__ = ["ReadModel", "read_model"]

_LEAST = 1e-12  # smaller coefficients HiGHS drops, whatever is asked for
_KINDS = {
    highspy.HighsVarType.kContinuous: "continuous",
    highspy.HighsVarType.kInteger: "integer",
    highspy.HighsVarType.kSemiContinuous: "semi-continuous",
    highspy.HighsVarType.kSemiInteger: "semi-integer",
}


@dataclass(frozen=True, eq=False)
class ReadModel:
    """Linear rows and a quadratic objective, offset + cost x + x'Qx / 2.

    Parameters
    ----------
    maximise : bool
    offset : float
    cost : (n,) float
    hessian : csc (n, n)
        Lower triangle of the symmetric Q.
    matrix : csc (m, n)
    row_lower, row_upper : (m,) float
    lower, upper : (n,) float
    kinds : list of str
        ``continuous``, ``integer`` or another word.
    names, row_names : list of str
    """

    maximise: bool
    offset: float
    cost: NDArray[np.float64]
    hessian: sps.csc_array
    matrix: sps.csc_array
    row_lower: NDArray[np.float64]
    row_upper: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    kinds: list[str]
    names: list[str]
    row_names: list[str]


def read_model(path: str | os.PathLike[str]) -> ReadModel:
    """Read an MPS or LP file by HiGHS.

    Raises
    ------
    FormatError
        With the words of HiGHS: where it fails, or warns that it reads something else.
    """
    reader = QuietHighs()
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder, "log")
        reader.setOptionValue("log_to_console", False)
        reader.setOptionValue("log_file", str(log))
        reader.setOptionValue("output_flag", True)
        reader.setOptionValue("small_matrix_value", _LEAST)
        status = reader.readModel(os.fspath(path))
        reader.setOptionValue("log_file", "")
        said = log.read_text(errors="replace") if log.exists() else ""
    words = [line.partition(":")[2].strip() for line in said.splitlines() if _complains(line)]
    if status != highspy.HighsStatus.kOk or words:  # some warnings leave the status at kOk
        raise FormatError(f"{path}: {'; '.join(words) or 'HiGHS cannot read this file'}")
    model = reader.getModel()
    lp, quadratic = model.lp_, model.hessian_
    n, m = lp.num_col_, lp.num_row_
    whole = list(lp.integrality_) or [highspy.HighsVarType.kContinuous] * n
    return ReadModel(
        maximise=lp.sense_ == highspy.ObjSense.kMaximize,
        offset=float(lp.offset_),
        cost=np.array(lp.col_cost_, float),
        hessian=_columns(
            quadratic.value_, quadratic.index_, quadratic.start_, (n, n), quadratic.dim_
        ),
        matrix=_columns(lp.a_matrix_.value_, lp.a_matrix_.index_, lp.a_matrix_.start_, (m, n), n),
        row_lower=np.array(lp.row_lower_, float),
        row_upper=np.array(lp.row_upper_, float),
        lower=np.array(lp.col_lower_, float),
        upper=np.array(lp.col_upper_, float),
        kinds=[_KINDS.get(kind, str(kind)) for kind in whole],
        names=[name or f"x{v + 1}" for v, name in enumerate(_labels(lp.col_names_, n))],
        row_names=[name or f"row{i + 1}" for i, name in enumerate(_labels(lp.row_names_, m))],
    )


def _complains(line: str) -> bool:
    return line.startswith(("ERROR", "WARNING"))


def _labels(names: list[str], count: int) -> list[str]:
    return list(names) if len(names) == count else [""] * count


def _columns(
    values: list[float], rows: list[int], starts: list[int], shape: tuple[int, int], used: int
) -> sps.csc_array:
    if not used:
        return sps.csc_array(shape)
    return sps.csc_array((np.array(values, float), np.array(rows), np.array(starts)), shape=shape)
