"""MATLAB's ``.mat`` files: problems as SparsePOP's structs, and the six outputs of a call.

Problems keep every double. The outputs are the structs that MATLAB gets, and beside them the
certificate as JSON, which :func:`read_mat` turns back.
"""

from __future__ import annotations

import zlib
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import scipy.io
from scipy.io.matlab import MatReadError

from sparsepop_py.compat.mat_structure import check_structure
from sparsepop_py.compat.output import SparsePOPOutput, cell, matlab_structs
from sparsepop_py.compat.structs import INFINITE, from_structs, to_structs
from sparsepop_py.errors import FormatError, ProblemError
from sparsepop_py.files import read_bytes, write_file
from sparsepop_py.io.json_files.files import from_json, to_json
from sparsepop_py.problem.problem import Problem

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
    OutputError
        If the file cannot be written.

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
    elif isinstance(value, SparsePOPOutput):
        certificate = value.POP.certificate
        text = "" if certificate is None else to_json(certificate)
        variables = {**matlab_structs(value), "certificate": text}
    else:
        raise ProblemError(
            f"write_mat: found {type(value).__name__}, expected a Problem or what sparsePOP returns"
        )
    save(path, variables)


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

    Examples
    --------
    >>> import sparsepop_py as sp, pathlib, tempfile
    >>> x, = sp.variables(1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     sp.write_mat(sp.Problem(x**2, lower=-1), pathlib.Path(folder) / "square.mat")
    ...     sp.read_mat(pathlib.Path(folder) / "square.mat")
    <Problem: 1 variables, 0 inequalities, 0 equalities, degree 2>
    """
    found = load(path, struct_as_record=False, squeeze_me=False)
    variables = {name: value for name, value in found.items() if not name.startswith("__")}
    if "objPoly" in variables:
        return _problem(variables, path)
    made = {name: _python(value) for name, value in variables.items()}
    text = made.pop("certificate", "")
    if isinstance(text, str) and text and "POP" in made:
        made["POP"].certificate = from_json(text)
    return SimpleNamespace(**made)


def save(path: str | Path, variables: dict[str, Any]) -> None:
    """Save variables to a file, whole or not at all.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    how: dict[str, Any] = {"long_field_names": True, "oned_as": "column"}
    write_file(path, lambda file: scipy.io.savemat(file, variables, **how))


def load(path: str | Path, **how: Any) -> dict[str, Any]:
    """Load the variables of a file that SciPy can read without harm.

    Parameters
    ----------
    path : str or Path
    **how
        Options of :func:`scipy.io.loadmat`.

    Raises
    ------
    FormatError
        If the file is missing or is no such file.
    """
    try:
        data = read_bytes(path)
        check_structure(data)
        return scipy.io.loadmat(BytesIO(data), **how)
    # NotImplementedError is what SciPy raises for version 7.3, which is HDF5
    except (ArithmeticError, LookupError, MemoryError, NotImplementedError, ValueError) as error:
        raise FormatError(f"{path}: expected a .mat file up to version 7: {error}") from error
    except (MatReadError, TypeError, zlib.error) as error:
        raise FormatError(f"{path}: expected a .mat file up to version 7: {error}") from error


def _of_problem(problem: Problem) -> dict[str, Any]:
    far = np.abs(np.concatenate([problem.lower, problem.upper]))
    if np.any((far >= INFINITE) & np.isfinite(far)):
        raise ProblemError(
            f"write_mat: found the bound {far[(far >= INFINITE) & np.isfinite(far)][0]:g}, "
            "expected less than 1e10 in size or none"
        )
    objective, rows, lower, upper = to_structs(problem)
    residuals = _residuals(problem)
    return {
        "objPoly": objective if residuals is None else residuals,
        "ineqPolySys": cell(rows, row=True),
        "lbd": lower.reshape(1, -1),
        "ubd": upper.reshape(1, -1),
        "names": np.array(problem.names, object).reshape(1, -1),
        "sense": problem.sense,
    }


def _residuals(problem: Problem) -> Any:
    """Put the residuals into a cell, if they make the very same objective again."""
    if len(problem.squares) < 2 or any(weight != 1.0 for weight, _ in problem.squares):
        return None
    residuals = [to_structs(Problem(residual))[0] for _, residual in problem.squares]
    lower, upper = to_structs(problem)[2:]
    again = from_structs(residuals, [], lower, upper)
    here = Problem(problem.objective, (), again.lower, again.upper, squares=problem.squares)
    return cell(residuals, row=True) if again.fingerprint == here.fingerprint else None


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


def _python(value: Any) -> Any:
    """Convert a value of MATLAB to a Python one."""
    if hasattr(value, "_fieldnames"):
        made = {name: _python(getattr(value, name)) for name in value._fieldnames}
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
