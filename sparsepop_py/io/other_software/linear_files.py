"""LP files: linear rows, an objective that may be quadratic, integers.

HiGHS reads them. Files with quadratic rows, which it refuses, are read by SCIP where PySCIPOpt is
installed (:mod:`sparsepop_py.io.other_software.scip_`).
"""

from __future__ import annotations

import os
from collections.abc import Iterator

import numpy as np
import scipy.sparse as sps

from sparsepop_py.algebra.polynomial import Constraint, Polynomial
from sparsepop_py.errors import FormatError, SolverNotFound
from sparsepop_py.files import read_text
from sparsepop_py.io.other_software.integers import between, problem_with_integers
from sparsepop_py.io.other_software.scip_ import RESERVED, read_by_scip
from sparsepop_py.lp.files import ReadModel, read_model
from sparsepop_py.problem.problem import Problem

__all__ = ["read_linear"]

_HEADINGS = frozenset(
    "bin binary binaries bound bounds gen general generals int integer integers semi "
    "semi-continuous sos end".split()
)
_FOR_SCIP = ("quadratic", "appears more than once")  # what HiGHS says where SCIP reads on


def read_linear(path: str | os.PathLike[str]) -> Problem:
    r"""Read an LP file.

    Parameters
    ----------
    path : path-like
        Integers have two bounds each. A row with two different ends gives two constraints.

    Returns
    -------
    Problem
        A maximisation is stored negated, with ``sense="max"``.

    Raises
    ------
    FormatError
        With the words of HiGHS.

    Examples
    --------
    >>> import pathlib
    >>> text = "Minimize obj: x + [ x^2 ] / 2 \n Subject To c: x + y >= 1 \n Bounds x >= -3 \n End"
    >>> _ = pathlib.Path("small.lp").write_text(text)
    >>> print(read_linear("small.lp"))
    min x + 0.5*x^2
      s.t. c: -1 + x + y >= 0
      -3 <= x <= inf
      0 <= y <= inf
    """
    try:
        model = read_model(path)
    except FormatError as error:
        if not any(word in str(error).lower() for word in _FOR_SCIP):
            raise
        try:
            return read_by_scip(path)
        except SolverNotFound as missing:
            raise FormatError(f"{error} (quadratic rows: {missing})") from None
        except FormatError:
            raise error from None
    _check(path, model)
    if not model.names:
        raise FormatError(f"{path}: found no variables, expected a problem in this format")
    for name, kind in zip(model.names, model.kinds, strict=True):
        if kind not in ("continuous", "integer"):
            raise FormatError(
                f"{path}: found the {kind} variable {name!r}, expected continuous or integer ones"
            )
    objective = _objective(model)
    return problem_with_integers(
        -objective if model.maximise else objective,
        list(_rows(model)),
        (model.lower.tolist(), model.upper.tolist()),
        model.names,
        [v for v, kind in enumerate(model.kinds) if kind == "integer"],
        "max" if model.maximise else "min",
    )


def _check(path: str | os.PathLike[str], model: ReadModel) -> None:
    """Refuse operators and sections that HiGHS reads as names, and binaries with other bounds."""
    for name in model.names:
        if name.startswith("(") or name.count("(") != name.count(")") or "/" in name:
            raise FormatError(
                f"{path}: found the variable {name!r}, expected polynomials without brackets and "
                "quotients"
            )
        if name.lower() in RESERVED:
            raise FormatError(
                f"{path}: found the variable {name!r}, expected another name: in some places HiGHS "
                "reads it as the beginning of a section"
            )
    binary = _binaries(read_text(path, "replace"))
    for name, low, high in zip(model.names, model.lower, model.upper, strict=True):
        if name in binary and not 0 <= low <= high <= 1:
            raise FormatError(
                f"{path}: found the binary variable {name!r} with bounds [{low:g}, {high:g}], "
                "expected bounds within [0, 1]"
            )


def _binaries(text: str) -> set[str]:
    """Find the names in sections of binaries."""
    found: set[str] = set()
    inside = False
    for line in text.splitlines():
        words = line.partition("\\")[0].split()
        if words and words[0].lower() in _HEADINGS:
            inside = words.pop(0).lower().startswith("bin")
        if inside:
            found.update(words)
    return found


def _objective(model: ReadModel) -> Polynomial:
    n = len(model.names)
    squares = sps.coo_array(model.hessian)
    i, j, value = squares.row + 1, squares.col + 1, squares.data
    value = np.where(i == j, 0.5 * value, value)  # off the diagonal, both halves of x'Qx / 2
    words = [np.zeros((1, 2)), *(np.stack([np.zeros(n), np.arange(1, n + 1)], 1),)]
    words += [np.stack([np.minimum(i, j), np.maximum(i, j)], 1)]
    values = np.concatenate([[model.offset], model.cost, value])
    return Polynomial.from_words(np.concatenate(words).astype(np.int32), values, n, model.names)


def _rows(model: ReadModel) -> Iterator[Constraint]:
    n, matrix = len(model.names), sps.csr_array(model.matrix)
    for k, name in enumerate(model.row_names):
        part = slice(matrix.indptr[k], matrix.indptr[k + 1])
        letters = (matrix.indices[part] + 1).astype(np.int32)[:, None]
        values, low, high = matrix.data[part], model.row_lower[k], model.row_upper[k]
        yield from between(Polynomial.from_words(letters, values, n, model.names), low, high, name)
