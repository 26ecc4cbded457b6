"""Identification for MATLAB and Octave: ``setidIdentify`` asked and answered in structs.

``sparsepop_py.compat.matlab_server`` calls :func:`identify_structs` by its name; the file
``setidIdentify.m`` beside ``sparsePOP.m`` hands the arguments over.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.noise import Noise
from setid.data.record import IOData
from setid.errors import ModelError, SetidError
from setid.export.matlab_files import ureal_script
from setid.identify import identify
from setid.models.equations import Initial
from setid.models.lti import TransferFunction
from setid.options import Options
from setid.priors import DCGain, Stable
from setid.result.identification import Identification
from sparsepop_py.compat.output import cell

__all__ = ["identify_structs"]

_NOISE = ("output", "input", "equation")
_KNOWN = (
    "stable",
    "dcGain",
    "offset",
    "initial",
    "commonDenominator",
    "timeLimit",
    "tol",
    "inputNames",
    "outputNames",
)


def identify_structs(
    u: Any, y: Any, Ts: Any, na: Any, nb: Any, nk: Any, noise: Any, options: Any = None
) -> list[dict[str, Any]]:
    """Prove intervals of a transfer function; arguments and answer are those of MATLAB.

    Parameters
    ----------
    u, y : (N, nu), (N, ny) array_like
        Samples are rows; a row or column of one channel is taken as it is meant.
    Ts : float
    na, nb, nk : number or (ny, nu) array_like
    noise : number or struct
        Bound of the output noise, or fields ``output``, ``input``, ``equation``.
    options : struct, optional
        Fields ``stable``, ``dcGain``, ``offset``, ``initial``, ``commonDenominator``,
        ``timeLimit``, ``tol``, ``inputNames``, ``outputNames``.

    Returns
    -------
    list of one dict
        A struct with ``names``, ``outer`` (proved), ``inner`` (attained, NaN where none is),
        ``status``, ``centre``, ``best``, ``verified``, ``samples`` (from 1), ``table``,
        ``summary``, ``ureal`` (the script of :func:`setid.to_ureal`, empty where there is none)
        and ``assumptions``.

    Raises
    ------
    ProblemError
        If the input is wrong.

    Examples
    --------
    >>> from setid.matlab import identify_structs
    >>> found, = identify_structs([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875], 1, 1, 1, 0,
    ...                           {"equation": 0.5})
    >>> found["outer"].round(4).tolist(), found["verified"]
    ([[-0.5233, -0.3453], [1.9167, 2.1093]], True)
    """
    try:
        return [_answer(_identified(u, y, Ts, (na, nb, nk), noise, _struct(options, "options")))]
    except SetidError as error:
        raise sp.ProblemError(f"setidIdentify: {error}") from error


def _identified(
    u: Any, y: Any, Ts: Any, orders: tuple[Any, ...], noise: Any, options: dict[str, Any]
) -> Identification:
    unknown = sorted(set(options) - set(_KNOWN))
    if unknown:
        raise SetidError(f"options.{unknown[0]}: found it, expected one of {', '.join(_KNOWN)}")
    data = IOData(
        _columns(u, "u"),
        _columns(y, "y"),
        _number(Ts, "Ts"),
        input_names=_texts(options.get("inputNames")),
        output_names=_texts(options.get("outputNames")),
    )
    na, nb, nk = (_orders(o, name) for o, name in zip(orders, ("na", "nb", "nk"), strict=True))
    model = TransferFunction(
        na,
        nb,
        nk,
        inputs=data.inputs,
        outputs=data.outputs,
        common_denominator=_flag(options, "commonDenominator"),
        offset=_flag(options, "offset"),
        initial=_initial(_text(options.get("initial")) or "free"),
    )
    priors: list[Any] = [Stable()] if _flag(options, "stable") else []
    if np.size(options.get("dcGain", [])):
        ends = _reals(options["dcGain"], "options.dcGain").ravel().tolist()
        if len(ends) > 2:
            raise SetidError(f"options.dcGain: found {len(ends)} numbers, expected [low high]")
        priors.append(DCGain(ends[0], ends[-1]))
    tol, limit = _optional(options, "tol"), _optional(options, "timeLimit")
    settings = Options(
        tol=1e-3 if tol is None else tol,
        time_limit=limit,
        progress=False,
    )
    return identify(data, model, _noise(noise), priors, settings)


def _answer(result: Identification) -> dict[str, Any]:
    intervals = result.intervals.values()
    none = (np.nan, np.nan)
    try:
        best = np.asarray(result.best("simulation").theta, float)
    except SetidError:
        best = np.full(len(result.intervals), np.nan)
    samples = np.array([[r, k + 1] for r, k in result.samples], float).reshape(-1, 2)
    return {
        "names": cell(result.intervals),
        "outer": np.array([item.outer for item in intervals], float),
        "inner": np.array([item.inner or none for item in intervals], float),
        "status": cell(str(item.status) for item in intervals),
        "centre": np.array([[item.centre] for item in intervals], float),
        "best": best[:, None],
        "verified": bool(result.verify()),
        "samples": samples,
        "table": result.table(),
        "summary": f"{result.summary()}\n(this text counts samples from 0)",
        "ureal": _script(result),
        "assumptions": cell(result.assumptions),
    }


def _script(result: Identification) -> str:
    try:
        return ureal_script(result)
    except SetidError:  # no finite intervals, or no members
        return ""


# ---- what MATLAB hands over -------------------------------------------------------------


def _struct(value: Any, name: str) -> dict[str, Any]:
    """The fields of a struct; none for [], for nothing and for a struct without fields."""
    if value is None or (isinstance(value, np.ndarray) and value.size == 0):
        return {}
    if isinstance(value, np.ndarray) and value.dtype == object and value.ravel()[0] is None:
        return {}  # struct()
    if isinstance(value, dict):
        return dict(value)
    if isinstance(value, np.ndarray) and value.dtype.names is not None:
        if value.size > 1:
            raise SetidError(f"{name}: found {value.size} structs, expected one")
        first = value.ravel()[0]
        return {field: first[field] for field in value.dtype.names}
    raise SetidError(f"{name}: found {_kind(value)}, expected a struct")


def _kind(value: Any) -> str:
    """The word of MATLAB's users for a value."""
    if isinstance(value, str) or (isinstance(value, np.ndarray) and value.dtype.kind == "U"):
        return "text"
    if isinstance(value, np.ndarray) and value.dtype == object:
        return "a cell array"
    if np.iscomplexobj(value):
        return "complex numbers"
    return "numbers" if np.size(value) != 1 else "a number"


def _noise(value: Any) -> Noise:
    if np.asarray(value).dtype.kind in "biuf":
        return Noise(output=_bound(value, "noise"))
    parts = _struct(value, "noise")
    unknown = sorted(set(parts) - set(_NOISE))
    if unknown:
        raise SetidError(f"noise.{unknown[0]}: found it, expected {', '.join(_NOISE)}")
    if not parts:
        raise SetidError(f"noise: found no bound, expected a number or {', '.join(_NOISE)}")
    return Noise(**{kind: _bound(bound, f"noise.{kind}") for kind, bound in parts.items()})


def _bound(value: Any, name: str) -> Any:
    """One number, one a channel, or one a sample."""
    bound = _reals(value, name)
    if not bound.size:
        raise SetidError(f"{name}: found [], expected a bound")
    return float(bound.ravel()[0]) if bound.size == 1 else np.squeeze(bound)


def _reals(value: Any, name: str) -> NDArray[np.float64]:
    """An array of numbers; texts, cells and structs are none."""
    try:
        kind = np.asarray(value).dtype.kind
        if kind in "biuf":
            return np.asarray(value, float)
    except ValueError:
        pass
    real = "real " if np.iscomplexobj(value) else ""
    raise SetidError(f"{name}: found {_kind(value)}, expected {real}numbers")


def _columns(value: Any, name: str) -> NDArray[np.float64]:
    values = _reals(value, name)
    return values.ravel() if values.ndim == 2 and 1 in values.shape else values


def _number(value: Any, name: str) -> float:
    values = _reals(value, name).ravel()
    if values.size != 1:
        raise SetidError(f"{name}: found {values.size} numbers, expected one")
    return float(values[0])


def _optional(options: dict[str, Any], name: str) -> float | None:
    value = options.get(name)
    return None if value is None or not np.size(value) else _number(value, f"options.{name}")


def _orders(value: Any, name: str) -> Any:
    values = _reals(value, name)
    if not np.all(np.isfinite(values)) or not np.all(values == np.round(values)):
        raise SetidError(f"{name}: found {values.tolist()}, expected integers")
    whole = values.astype(int)
    return int(whole.ravel()[0]) if whole.size == 1 else whole.tolist()


def _flag(options: dict[str, Any], name: str) -> bool:
    value = options.get(name)
    if value is None or np.size(value) == 0:
        return False
    return bool(np.all(_reals(value, f"options.{name}")))


def _initial(text: str) -> Initial:
    known: dict[str, Initial] = {"free": "free", "zero": "zero"}
    if text in known:
        return known[text]
    raise ModelError(f"options.initial: found {text!r}, expected 'free' or 'zero'")


def _text(value: Any) -> str:
    if value is None or np.size(value) == 0:
        return ""
    return str(value) if isinstance(value, str) else "".join(np.ravel(value).astype(str).tolist())


def _texts(value: Any) -> list[str] | None:
    """A cell array of texts, or one text."""
    if value is None or np.size(value) == 0:
        return None
    if isinstance(value, str) or (isinstance(value, np.ndarray) and value.dtype.kind == "U"):
        return [_text(value)]
    return [_text(item) for item in (np.ravel(value) if isinstance(value, np.ndarray) else value)]
