"""MATLAB's ``.mat`` files: problems as SparsePOP's structs, and the six outputs of a call.

Problems keep every double. Of the outputs, what MATLAB has no type for is written as text:
the status by its name, the certificate as JSON, which :func:`read_mat` turns back.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from zipfile import BadZipFile

import numpy as np
import scipy.io
import scipy.sparse as sps
from scipy.io.matlab import MatReadError

from ..certificate.certificate import Certificate
from ..errors import FormatError, ProblemError
from ..problem import Problem
from ..result import Result, Status
from ..structs import INFINITE, from_structs, to_structs
from .json_ import from_json, to_json

__all__ = ["read_mat", "write_mat"]


def write_mat(value: Any, path: str | Path) -> None:
    """Write a problem, or what ``sparsePOP`` returned, to a ``.mat`` file.

    Parameters
    ----------
    value : Problem or SparsePOPOutput
        A problem becomes ``objPoly``, ``ineqPolySys``, ``lbd`` and ``ubd`` (least squares as a
        cell of residuals), with ``names`` and ``sense`` beside them. Of the outputs each is a
        variable; the problem is not among them.
    path : str or Path
        Written to this very path.

    Raises
    ------
    ProblemError
        If the value is something else, or a finite bound is 1e10 or more in size, which stands
        for none in structs.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> problem = sp.Problem(x * y, [x + y >= 0.1], lower=0)
    >>> path = pathlib.Path(tempfile.mkdtemp(), "problem.mat")
    >>> sp.write_mat(problem, path)
    >>> sp.read_mat(path).fingerprint == problem.fingerprint
    True
    """
    if isinstance(value, Problem):
        variables = _of_problem(value)
    elif hasattr(value, "_asdict") and "SDPobjValue" in value._fields:
        variables = {name: _plain(part) for name, part in value._asdict().items()}
    else:
        raise ProblemError(
            f"write_mat: found {type(value).__name__}, expected a Problem or what sparsePOP returns"
        )
    with open(path, "wb") as file:
        scipy.io.savemat(file, variables, long_field_names=True, oned_as="column")


def read_mat(path: str | Path) -> Any:
    """Read a ``.mat`` file.

    Parameters
    ----------
    path : str or Path
        Written by :func:`write_mat`, or by MATLAB or Octave (up to version 7) with the same
        variables.

    Returns
    -------
    Problem or SimpleNamespace
        The problem where there is an ``objPoly``; otherwise the variables of the file as
        attributes, structs as namespaces and a certificate as a :class:`Certificate`.

    Raises
    ------
    FormatError
        If the file is missing or is no such file.
    ProblemError
        If a struct in it is malformed.
    """
    try:
        with open(path, "rb") as file:
            found = scipy.io.loadmat(file, struct_as_record=False, squeeze_me=False)
    except (OSError, ValueError, NotImplementedError, BadZipFile, MatReadError, TypeError) as error:
        raise FormatError(f"{path}: expected a .mat file up to version 7: {error}") from error
    variables = {name: value for name, value in found.items() if not name.startswith("__")}
    if "objPoly" in variables:
        return _problem(variables, path)
    return SimpleNamespace(**{name: _python(value) for name, value in variables.items()})


def _of_problem(problem: Problem) -> dict[str, Any]:
    far = np.abs(np.concatenate([problem.lower, problem.upper]))
    if np.any((far >= INFINITE) & np.isfinite(far)):
        raise ProblemError(
            f"write_mat: found the bound {far[(far >= INFINITE) & np.isfinite(far)][0]:g}, "
            "expected less than 1e10 in size or none"
        )
    objective, rows, lower, upper = to_structs(problem)
    cell = np.empty((1, len(rows)), object)
    cell[0, :] = rows
    residuals = _residuals(problem)
    return {
        "objPoly": objective if residuals is None else residuals,
        "ineqPolySys": cell,
        "lbd": lower.reshape(1, -1),
        "ubd": upper.reshape(1, -1),
        "names": np.array(problem.names, object).reshape(1, -1),
        "sense": problem.sense,
    }


def _residuals(problem: Problem) -> Any:
    """The residuals as a cell, where they make the very same objective again."""
    if len(problem.squares) < 2 or any(weight != 1.0 for weight, _ in problem.squares):
        return None
    cell = np.empty((1, len(problem.squares)), object)
    for k, (_, residual) in enumerate(problem.squares):
        cell[0, k] = to_structs(Problem(residual))[0]
    lower, upper = to_structs(problem)[2:]
    again = from_structs(list(cell[0]), [], lower, upper)
    same = again.fingerprint == Problem(problem.objective, (), again.lower, again.upper).fingerprint
    return cell if same else None


def _problem(variables: dict[str, Any], path: str | Path) -> Problem:
    missing = [name for name in ("lbd", "ubd") if name not in variables]
    if missing:
        raise ProblemError(f"{path}: found objPoly without {missing[0]}, expected both bounds")
    problem = from_structs(
        variables["objPoly"], variables.get("ineqPolySys"), variables["lbd"], variables["ubd"]
    )
    names = [str(_python(name)) for name in np.ravel(variables.get("names", []))]
    sense = str(_python(variables.get("sense", "min")))
    return Problem(
        problem.objective,
        problem.constraints,
        problem.lower,
        problem.upper,
        names or None,
        problem.squares or None,
        "max" if sense == "max" else "min",
    )


def _plain(value: Any) -> Any:
    """A value as MATLAB has it: structs, matrices, text; None is []."""
    if value is None or isinstance(value, Result):
        return np.zeros((0, 0))
    if isinstance(value, Certificate):
        return to_json(value)
    if isinstance(value, Status):
        return value.name
    if sps.issparse(value):
        return sps.csc_matrix(value, dtype=float)
    if is_dataclass(value):
        given = {f.name: getattr(value, f.name) for f in fields(value)}
        more = given.pop("given", {})
        given.pop("options", None)
        return {name: _plain(part) for name, part in {**given, **more}.items()}
    if isinstance(value, Mapping):
        return {str(name): _plain(part) for name, part in value.items()}
    if isinstance(value, (tuple, list)):
        return np.array(value, float).reshape(1, -1) if _numeric(value) else _cell(value)
    return value


def _numeric(values: Any) -> bool:
    return all(isinstance(v, (bool, int, float, np.number)) for v in values)


def _cell(values: Any) -> Any:
    cell = np.empty((1, len(values)), object)
    cell[0, :] = [_plain(value) for value in values]
    return cell


def _python(value: Any) -> Any:
    """A value of MATLAB as a Python one."""
    if hasattr(value, "_fieldnames"):
        made = {name: _python(getattr(value, name)) for name in value._fieldnames}
        if isinstance(made.get("certificate"), str) and made["certificate"]:
            made["certificate"] = from_json(made["certificate"])
        return SimpleNamespace(**made)
    if isinstance(value, np.ndarray):
        if value.dtype.kind in "US":
            return str(value.ravel()[0]) if value.size else ""
        if value.dtype == object:
            parts = [_python(part) for part in value.ravel()]
            return parts[0] if len(parts) == 1 else parts
        if value.size == 1:
            return value.ravel()[0].item()
        return value.ravel() if value.ndim == 2 and value.shape[1] == 1 else value
    return value
