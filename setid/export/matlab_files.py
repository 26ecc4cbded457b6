"""The uncertain model for MATLAB: a MAT file, and a script for the Robust Control Toolbox."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from setid.errors import ModelError
from setid.feasible_points.best import best
from setid.feasible_points.members import nominal
from setid.feasible_set.feasible_set import FeasibleSet, check_result
from setid.models.equations import Transfer
from setid.models.general import BlockStructured
from setid.simulation.responses import transfer_of
from sparsepop_py.compat.mat import save
from sparsepop_py.compat.output import cell
from sparsepop_py.errors import check_writable
from sparsepop_py.files import as_path, write_text

__all__ = ["to_mat", "to_ureal", "ureal_script"]


def to_mat(result: FeasibleSet, path: str | os.PathLike[str]) -> Path:
    """Write intervals, members and orders of a set to a MAT file (version 6).

    Parameters
    ----------
    result : FeasibleSet
    path : path-like

    Returns
    -------
    pathlib.Path
        Of a file with ``names``, ``outer`` (p, 2), ``inner`` (p, 2), ``status``, ``nominal``
        (p, 1), ``members`` (M, p), ``Ts``, ``structure`` and ``assumptions``.

    Raises
    ------
    FormatError
        If ``path`` is no path.
    ProblemError
        If its folder does not exist.

    Examples
    --------
    >>> import scipy.io, setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> path = setid.to_mat(result, "model.mat")
    >>> scipy.io.loadmat(path)["outer"].round(4).tolist()
    [[-0.5233, -0.3453], [1.9167, 2.1093]]
    """
    check_result(result)
    check_writable(str(as_path(path)), "path")
    result.require_members()
    formulation, items = result.formulation, result.intervals.values()
    none = (np.nan, np.nan)
    content: dict[str, Any] = {
        "names": cell(formulation.parameters),
        "outer": np.array([item.outer for item in items], float),
        "inner": np.array([item.inner or none for item in items], float),
        "status": cell(str(item.status) for item in items),
        "nominal": _nominal(result)[:, None],
        "members": np.asarray(result.attained, float),
        "Ts": float(formulation.data.Ts),
        "structure": repr(formulation.model),
        "assumptions": cell(formulation.assumptions),
    }
    save(as_path(path), content)
    return Path(path)


def to_ureal(result: FeasibleSet, path: str | os.PathLike[str]) -> Path:
    """Write a MATLAB script that makes an uncertain model of real parameters.

    The ranges are the proved intervals, so that the model contains every consistent one; that
    parameters depend on each other is lost. An offset is left out, and so are static maps and
    feedback about a linear block: the script says so.

    Parameters
    ----------
    result : FeasibleSet
        Of a structure with linear blocks between all channels, whose intervals are finite.
    path : path-like
        Such as ``"model.m"``; the script leaves the variable ``G``.

    Returns
    -------
    pathlib.Path

    Raises
    ------
    ModelError
        If channels have no linear block between them, or more, or an interval is not finite.
    ProblemError
        If the folder of the script does not exist.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> print(setid.to_ureal(result, "model.m").read_text().splitlines()[-1])
    G = tf([b0 0], [1 a1], 1);
    """
    check_writable(str(as_path(path)), "path")
    write_text(path, ureal_script(result))
    return Path(path)


def ureal_script(result: FeasibleSet) -> str:
    """Write the script of :func:`to_ureal`.

    Parameters
    ----------
    result : FeasibleSet

    Raises
    ------
    ModelError
        As there.
    """
    check_result(result)
    result.require_members()
    formulation = result.formulation
    model = formulation.model
    pairs = [
        [transfer_of(model, i + 1, j + 1) for j in range(model.inputs)]
        for i in range(model.outputs)
    ]
    used = [name for row in pairs for t in row for name in (*t.denominator, *t.numerator)]
    for name in used:
        if not np.all(np.isfinite(result.intervals[name].outer)):
            raise ModelError(f"result: found no finite interval of {name}, expected finite ones")
    values = dict(zip(formulation.parameters, _nominal(result).tolist(), strict=True))
    block = isinstance(model, BlockStructured)
    what = "linear block" if block else "model"
    lines = [
        f"% {formulation.model!r}",
        f"% Ranges are proved: every consistent {what} is in G. Their dependence is lost.",
        "% Needs the Robust Control Toolbox.",
    ]
    if block:
        lines.insert(2, "% G is the linear block: static maps and feedback are left out.")
    elif left_out := [name for name in formulation.parameters if name not in used]:
        lines.insert(2, f"% Left out of G: {', '.join(left_out)}.")
    for name in dict.fromkeys(used):
        low, high = result.intervals[name].outer
        own = _identifier(name)
        if low == high:
            lines.append(f"{own} = {low!r};")
            continue
        at = min(max(values[name], low), high)
        lines.append(f"{own} = ureal('{own}', {at!r}, 'Range', [{low!r} {high!r}]);")
    step = 0.0 if pairs[0][0].continuous else formulation.data.Ts
    rows = [", ".join(_transfer(t, step) for t in row) for row in pairs]
    single = model.inputs == model.outputs == 1
    lines.append(f"G = {rows[0]};" if single else f"G = [{'; '.join(rows)}];")
    return "\n".join(lines) + "\n"


def _nominal(result: FeasibleSet) -> Any:
    try:
        return np.asarray(best(result, "simulation").theta, float)
    except ValueError:  # readings to start from are missing, or no member is known
        return np.asarray(nominal(result), float)


def _identifier(name: str) -> str:
    """A name of MATLAB: ``b[1,2]0`` becomes ``b_1_2_0``."""
    return "".join(c if c.isalnum() else "_" for c in name.replace("]", "_")).replace("__", "_")


def _transfer(transfer: Transfer, step: float) -> str:
    """Polynomials in falling powers of z or s, of equal length."""
    size = max(transfer.delay + len(transfer.numerator) - 1, len(transfer.denominator)) + 1
    top: list[str] = ["0"] * size
    below = ["1"] + ["0"] * (size - 1)
    for lag, name in enumerate(transfer.numerator, transfer.delay):
        top[lag] = _identifier(name)
    for lag, name in enumerate(transfer.denominator, 1):
        below[lag] = _identifier(name)
    ending = f", {step:.17g}" if step else ""
    return f"tf({_row(top)}, {_row(below)}{ending})"


def _row(entries: Sequence[str]) -> str:
    return f"[{' '.join(entries)}]"
