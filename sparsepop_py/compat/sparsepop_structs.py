"""The outputs of ``sparsePOP`` as MATLAB holds them: structs, matrices and cell arrays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields
from enum import Enum
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.compat.output import POPOutput, SparsePOPOutput
from sparsepop_py.compat.param import Parameters
from sparsepop_py.compat.param_table import FIELDS
from sparsepop_py.verified.certificate.certificate import Certificate

__all__ = ["cell", "matlab_structs"]

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
    """The six outputs with the original's names first, in its order."""
    given = {name: _matlab(value) for name, value in output._asdict().items()}
    for name, known in _ORIGINAL.items():
        given[name] = dict.fromkeys(known.split(), _EMPTY) | given[name]
    return given


def _matlab(value: Any) -> Any:
    """A value as MATLAB holds it: doubles, columns, rows of sizes, ``[]`` for None."""
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
    """The fields of a struct in MATLAB."""
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
        found["notes"] = cell(value.result.notes)
    return found


def cell(items: Iterable[Any], row: bool = False) -> NDArray[np.object_]:
    """A cell array, column or row."""
    listed = list(items)
    cell = np.empty((len(listed), 1), dtype=object)
    for place, item in enumerate(listed):
        cell[place, 0] = item
    return cell.T if row else cell
