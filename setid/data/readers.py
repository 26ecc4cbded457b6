"""Read columns of numbers from MATLAB files; put columns side by side."""

from __future__ import annotations

import os
import zlib
from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import path_of, real_array
from setid.data.tables import Column, check_distinct
from setid.errors import DataError
from sparsepop_py.compat.mat_structure import check_structure
from sparsepop_py.errors import shown

_DAMAGED: tuple[type[Exception], ...] = (ArithmeticError, LookupError, MemoryError)
_DAMAGED += (NotImplementedError, TypeError, ValueError, zlib.error)  # FormatError is a ValueError

__all__ = ["listed", "read_mat_columns", "stacked", "vector"]


def read_mat_columns(
    path: str | os.PathLike[str], names: Sequence[str]
) -> list[NDArray[np.float64]]:
    """Read variables of a MATLAB file (up to version 7), each as columns (N, c).

    Length decides between rows and columns: the longer side holds the samples. The structure of
    the file is checked first, since SciPy's reader ends the process where a file is damaged.

    Raises
    ------
    DataError
        If a variable is missing or not a real matrix.
    """
    import scipy.io  # loaded by those who read such files

    named = path_of(path)
    short = named.with_name(named.name + ".mat")  # as in MATLAB, the suffix may be left out
    try:
        data = (named if named.exists() or not short.exists() else short).read_bytes()
    except OSError as error:
        raise DataError(f"{path}: {error.strerror}, expected a MATLAB file") from None
    try:
        version = scipy.io.matlab.matfile_version(BytesIO(data))
        check_structure(data)
        found = {} if version[0] > 1 else scipy.io.loadmat(BytesIO(data))
    except (*_DAMAGED, scipy.io.matlab.MatReadError) as cause:
        raise DataError(f"{path}: {cause}, expected a MATLAB file of version 7 or older") from None
    if version[0] > 1:
        raise DataError(
            f"{path}: found a MATLAB 7.3 file, expected version 7 or older (save with '-v7')"
        )
    for name in names:
        if not isinstance(name, str):
            raise DataError(f"u, y: found {shown(name)}, expected names of variables")
    check_distinct(path, names, list(names))
    arrays = []
    for name in names:
        if name not in found or name.startswith("__"):
            known = sorted(key for key in found if not key.startswith("__"))
            raise DataError(f"{path}: found no variable {name!r}, expected one of {known}")
        values = np.atleast_2d(real_array(found[name], f"{path}: {name}", DataError))
        if values.ndim != 2:
            raise DataError(f"{path}: {name}: found shape {values.shape}, expected a matrix")
        arrays.append(values.T.copy() if values.shape[0] < values.shape[1] else values)
    return arrays


def listed(given: Column | Sequence[Column]) -> list[Any]:
    """List one column or several."""
    if isinstance(given, (str, int)):
        return [given]
    if not isinstance(given, Sequence):
        raise DataError(f"columns: found {given!r:.60}, expected names or numbers of columns")
    return list(given)


def stacked(columns: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Stack columns side by side, shape (N, channels)."""
    if not columns:
        raise DataError("inputs, outputs: found no column, expected at least one each")
    if len({column.shape[0] for column in columns}) > 1:
        lengths = [column.shape[0] for column in columns]
        raise DataError(f"channels: found {lengths} samples, expected equal numbers")
    return np.column_stack(columns)


def vector(columns: NDArray[np.float64], path: object, name: str) -> NDArray[np.float64]:
    """Take the only column (N,) of a variable; more than one is an error."""
    if columns.shape[1] != 1:
        raise DataError(
            f"{path}: {name}: found {columns.shape[1]} columns, expected one time for each sample"
        )
    return columns[:, 0]
