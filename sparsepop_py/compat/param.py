"""From the ``param`` struct of SparsePOP to :class:`~sparsepop_py.options.Options`.

The table in :mod:`sparsepop_py.compat.param_table` says what every field does.
"""

from __future__ import annotations

import difflib
import math
import numbers
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from types import SimpleNamespace
from typing import Any, NoReturn

import numpy as np

from sparsepop_py.compat.param_table import FIELDS
from sparsepop_py.compat.structs import written_out
from sparsepop_py.errors import ParameterWarning, ProblemError, shown
from sparsepop_py.files import can_name_a_file
from sparsepop_py.options import Options
from sparsepop_py.relaxation.sparsepop.relaxation import Switches
from sparsepop_py.solvers import SOLVERS, solver_names

__all__ = [
    "CHECKS",
    "Parameters",
    "check_error_bounds",
    "check_level",
    "check_one_of",
    "check_order",
    "read_parameters",
    "stated_fields",
    "wrong",
]

_DEEPEST = 4  # lists in lists, of which indices have two
_LEAST = 0.9e-10  # smaller tolerances and perturbations are errors in the original too


def wrong(name: str, found: Any, expected: str) -> NoReturn:
    """Raise the error for a value."""
    raise ProblemError(f"param.{name}: found {shown(found)}, expected {expected}")


def check_one_of(name: str, value: Any, legal: tuple[Any, ...]) -> Any:
    """Check that a switch has one of its legal values."""
    if isinstance(value, (list, str, complex)) or value not in legal:
        wrong(name, value, "one of " + ", ".join(map(str, legal)))
    return value


def check_order(value: Any) -> float:
    """Check the relaxation order; return an integer where it is whole."""
    number = _number("relaxOrder", value, "a number >= 0")
    if number < 0:
        wrong("relaxOrder", value, "a number >= 0")
    return max(1, int(number)) if number.is_integer() else number


def check_level(value: Any) -> tuple[int, int]:
    """Print levels of screen and file."""
    expected = "0, 1 or 2, or two of these (screen, file)"
    pair = list(value) if isinstance(value, (list, tuple)) else [value, 0]
    if len(pair) > 2 or any(not isinstance(v, numbers.Real) or v not in (0, 1, 2) for v in pair):
        wrong("printLevel", value, expected)
    return int(pair[0]), int(pair[1]) if len(pair) == 2 else 0


def _number(name: str, value: Any, expected: str) -> float:
    try:
        if isinstance(value, numbers.Real) and math.isfinite(value):
            return float(value)
    except OverflowError:
        pass
    wrong(name, value, expected)


def _small(name: str, value: Any) -> float:
    """Check for 0, or a size that is large enough to be meant."""
    number = _number(name, value, "0 or a number of at least 1e-10")
    if 0 < abs(number) < _LEAST or (name == "eqTolerance" and value < 0):
        wrong(name, value, "0 or a number of at least 1e-10")
    return number


def _factor(name: str, value: Any) -> float:
    """Read the factor by which cliques may grow; any text stands for no limit."""
    if isinstance(value, str):
        return math.inf
    if value == math.inf:
        return math.inf
    number = _number(name, value, "a number from 0 to dimVar, or a string")
    if number < 0:
        wrong(name, value, "a number from 0 to dimVar, or a string")
    return number


def _positive(name: str, value: Any) -> float:
    number = _number(name, value, "a number > 0")
    if number <= 0:
        wrong(name, value, "a number > 0")
    return number


def _count(name: str, value: Any) -> int:
    number = _number(name, value, "a positive integer")
    if number < 1 or not number.is_integer():
        wrong(name, value, "a positive integer")
    return int(number)


def _log(name: str, value: Any) -> Any:
    if isinstance(value, str) and value:
        return _file(name, value)
    if not isinstance(value, numbers.Real) or value not in (0, 1):
        wrong(name, value, "0, 1 or the name of a file")
    return int(float(value))


def _file(name: str, value: Any) -> str:
    if not isinstance(value, str) or (value and not can_name_a_file(value)):
        wrong(name, value, "the name of a file")
    return value


def _sdpa(name: str, value: Any) -> str:
    if _file(name, value) and not (value.endswith(".dat-s")):
        wrong(name, value, "the name of a file that ends in .dat-s")
    return value


def _upper(name: str, value: Any) -> Any:
    return value if value == "" else _number(name, value, "a number")


def _indices(name: str, value: Any) -> Any:
    """'', 'a', indices from 1, or a list of these."""
    expected = "'a', indices of variables from 1, or a list of these"
    if isinstance(value, str):
        if value not in ("", "a"):
            wrong(name, value, expected)
        return value
    for item in value if isinstance(value, (list, tuple)) else [value]:
        inner = item if isinstance(item, (list, tuple)) else [item]
        if item != "a" and not all(map(_is_index, inner)):
            wrong(name, value, expected)
    return value


def _is_index(item: Any) -> bool:
    return isinstance(item, numbers.Real) and not item < 1 and item % 1 == 0


def _effort(name: str, value: Any) -> str:
    """Check an effort by name; empty for what ``tighten`` says."""
    if not isinstance(value, str) or value not in ("", *_EFFORTS):
        wrong(name, value, "one of " + ", ".join(map(repr, _EFFORTS)))
    return value


def _limit(name: str, value: Any) -> Any:
    """Check seconds; empty or infinite for no limit."""
    if value == "" or value == math.inf:
        return ""
    number = _number(name, value, "seconds > 0")
    return number if number > 0 else wrong(name, value, "seconds > 0")


def _gap(name: str, value: Any) -> float:
    number = _number(name, value, "a number >= 0")
    return number if number >= 0 else wrong(name, value, "a number >= 0")


def _local_search(name: str, value: Any) -> Any:
    """Check a switch or the name of a local search."""
    if isinstance(value, str) and value in _LOCAL_SEARCH:
        return value
    return check_one_of(name, value, tuple(_LOCAL_SEARCH)[1:])


_EFFORTS = ("plain", "presolve", "auto")
_LOCAL_SEARCH = {
    "": "scipy",
    0: "none",
    1: "scipy",
    "scipy": "scipy",
    "ipopt": "ipopt",
    "none": "none",
}

CHECKS: dict[str, Callable[[str, Any], Any]] = {
    "multiCliquesFactor": _factor,
    "eqTolerance": _small,
    "perturbation": _small,
    "SDPsolverEpsilon": _positive,
    "SDPsolverMaxIter": _count,
    "SDPsolverOutFile": _log,
    "printFileName": _log,
    "sdpaDataFile": _sdpa,
    "detailedInfFile": _file,
    "errorBdIdx": _indices,
    "fValueUbd": _upper,
    "effort": _effort,
    "timeLimit": _limit,
    "gap": _gap,
    "localSearch": _local_search,
}


def check_error_bounds(values: Mapping[str, Any]) -> None:
    """Check that an upper bound of the objective comes with error bounds."""
    asked = values.get("errorBdIdx", "")
    if values.get("fValueUbd", "") != "" and isinstance(asked, str) and not asked:
        wrong("fValueUbd", values["fValueUbd"], "nothing, since errorBdIdx is empty")


_SOLVERS = ("sedumi", "sdpa", "sdpt3", "sdpnal", "sdpnalplus", "csdp")
_SEARCH = 1.0  # CPU seconds without POPsolver, for points whose values tighten boxes
_LOCAL = ("active-set", "interior-point", "trust-region-reflective", "lsqnonlin", "ipopt")
_BY_NAME = {entry.name: entry for entry in FIELDS}
# The original's default depends on the installation, so that neither value asks for anything.
_EITHER = ("symbolicMath", "mex")
_OLD_NAMES = {
    "SeDuMiSW": "SDPsolverSW",
    "SeDuMiEpsilon": "SDPsolverEpsilon",
    "SeDuMiOutFile": "SDPsolverOutFile",
}
_SUBSTITUTED = {
    "SquareOneSW": "square",
    "binarySW": "binary",
    "reduceAMatSW": "fixed",
    "complementaritySW": "zero",
}


@dataclass(frozen=True)
class Parameters:
    """Parameters as :func:`read_parameters` understood them.

    Every other field of the original is readable too, with the value given or the
    original's default: ``parameters.eqTolerance``.

    Parameters
    ----------
    relaxOrder : int or float
        :func:`~sparsepop_py.compat.sparsepop.sparsePOP` returns it raised to the least legal one.
    sparseSW : {0, 1, 2, 3}
    POPsolver : str
        Empty: no refined point in the output.
    printLevel : (int, int)
        Screen and file, each 0, 1 or 2.
    tighten : {0, 1}
    SDPsolver : str
        As given.
    options : Options
        The options of the solve.
    given : mapping of str to object
        The other fields that were given, known or not.
    """

    relaxOrder: float = 1
    sparseSW: int = 1
    POPsolver: str = ""
    printLevel: tuple[int, int] = (2, 0)
    tighten: int = 1
    SDPsolver: str = "sedumi"
    options: Options = field(default_factory=Options)
    given: Mapping[str, Any] = field(default_factory=dict)

    def __getattr__(self, name: str) -> Any:
        given = self.__dict__.get("given", {})
        if name in given:
            return given[name]
        if name in _OLD_NAMES:
            return getattr(self, _OLD_NAMES[name])
        if name in _BY_NAME:
            return _BY_NAME[name].default
        raise AttributeError(f"param has no field {name!r}")


def read_parameters(param: Any = None, strict: bool = False, *, stacklevel: int = 2) -> Parameters:
    """Read a ``param`` struct.

    Parameters
    ----------
    param : struct, mapping or None
        None, a dict, an object with attributes, a dataclass, what ``scipy.io.loadmat``
        makes of a struct, or the ``param`` that an earlier call returned.
    strict : bool
        Unknown fields and names are errors instead of warnings.
    stacklevel : int
        Whose line the warnings show, as in :func:`warnings.warn`.

    Returns
    -------
    parameters : Parameters
        With ``options``, what the solve is called with.

    Raises
    ------
    ProblemError
        If a value is illegal, naming the field, what was found and what was expected.

    Warns
    -----
    ParameterWarning
        For unknown fields (with the nearest known name), and for known ones whose value
        asks for something that has no effect.

    Examples
    --------
    >>> parameters = read_parameters({"relaxOrder": 3, "sparseSW": 0, "printLevel": 0})
    >>> parameters.options.order, parameters.options.sparse, parameters.printLevel
    (3, False, (0, 0))
    """
    values = {name: _plain(value, name) for name, value in _items(param).items()}
    values = {name: value for name, value in values.items() if value is not None}
    for name, value in values.items():
        _check_nesting(name, value)
    for old, new in _OLD_NAMES.items():
        if old in values:
            values.setdefault(new, values[old])
    says: list[str] = []
    effort, tighten = _effort_and_tighten(values, says)
    for name, value in values.items():
        _check(name, value, strict, tighten, says)
    order = check_order(values.get("relaxOrder", 1))
    sparse = _sparse(values.get("sparseSW", 1), tighten, says)
    local = _local(values.get("POPsolver", ""), strict, says)
    named = isinstance(values.get("printFileName", 1), str)
    level = check_level(values.get("printLevel", (2, 2 if named else 0)))
    name, solver = _solver(values.get("SDPsolver", "sedumi"), says)
    for key, check in CHECKS.items():
        if key in values:
            values[key] = check(key, values[key])
    check_error_bounds(values)
    for message in says:
        warnings.warn(message, ParameterWarning, stacklevel=stacklevel)
    options = Options(
        order=max(1, math.ceil(order)) if tighten else max(1, math.floor(order)),
        sparse=bool(sparse % 2),
        # as the original, whose sizes are published
        chordal="auto" if effort == "auto" else "min-degree",
        effort=effort,
        gap=values.get("gap", 1e-6),
        time_limit=values.get("timeLimit", "") or None,
        refine=_refine(values, local),
        search_limit=_search_limit(values, local, effort),
        solver=solver,
        progress=level[0] > 0,
        accuracy=values.get("SDPsolverEpsilon"),
        max_iterations=values.get("SDPsolverMaxIter"),
        switches=None if tighten else _switches(order, values),
    )
    own = {f.name for f in fields(Parameters)}
    given = {key: item for key, item in values.items() if key not in own}
    return Parameters(order, sparse, local, level, tighten, name, options, given)


def _effort_and_tighten(values: dict[str, Any], says: list[str]) -> tuple[Any, int]:
    """Settle the effort, which overrules ``tighten``, and what ``tighten`` it stands for."""
    tighten = int(check_one_of("tighten", values.get("tighten", 1), (0, 1)))
    effort = _effort("effort", values.get("effort", ""))
    if not effort:
        return ("presolve" if tighten else "plain"), tighten
    meant = int(effort != "plain")
    if values.get("tighten", meant) != meant:
        says.append(f"param.tighten = {tighten} is overruled by param.effort = {effort!r}")
    values["tighten"] = meant
    return effort, meant


def _refine(values: Mapping[str, Any], local: str) -> Any:
    """Choose the local search: ``localSearch`` where it was given, else as ``POPsolver`` says."""
    chosen = _LOCAL_SEARCH[values.get("localSearch", "")]
    return "ipopt" if local == "ipopt" and chosen == "scipy" else chosen


def _search_limit(values: Mapping[str, Any], local: str, effort: str) -> float | None:
    """Limit a local search that was not asked for: its points serve the proof alone."""
    asked = local or values.get("localSearch", "") != ""
    return None if asked or effort == "auto" else _SEARCH


def _switches(order: float, values: Mapping[str, Any]) -> Switches:
    """Collect the switches of the plain relaxation."""

    def on(name: str) -> bool:
        return bool(values.get(name, _BY_NAME[name].default))

    return Switches(
        order=order,
        merge=values.get("multiCliquesFactor", 1.0),
        scaled=on("scalingSW"),
        moment_bounds=int(values.get("boundSW", 2)),
        consistent=int(values.get("reduceMomentMatSW", 1)),
        aggressive=on("aggressiveSW"),
        substituted=tuple(kind for name, kind in _SUBSTITUTED.items() if on(name)),
        independent=on("reduceAMatSW"),
        narrow=values.get("sparseSW", 1) > 1,
        perturbation=abs(values.get("perturbation", 0.0)),
    )


def stated_fields(param: Any) -> list[str]:
    """List the fields of a ``param`` struct that hold a value."""
    return [name for name, value in _items(param).items() if _plain(value, name) is not None]


# ---- containers -------------------------------------------------------------------------


def _is_empty(param: Any) -> bool:
    """Check for MATLAB's [], also in brackets of its own."""
    try:
        return isinstance(param, (list, tuple, np.ndarray)) and np.size(param) == 0
    except ValueError:  # rows of several lengths
        return False


def _items(param: Any) -> dict[str, Any]:
    """List the fields of a struct of any kind."""
    while isinstance(param, np.ndarray) and param.size == 1:
        param = param.ravel()[0]
    if param is None or _is_empty(param):
        return {}
    if isinstance(param, np.void) and param.dtype.names is not None:
        return {name: param[name] for name in param.dtype.names}
    if isinstance(param, Parameters):
        echo = {f.name: getattr(param, f.name) for f in fields(param)}
        del echo["options"], echo["given"]
        return {**echo, **param.given}
    if isinstance(param, Mapping):
        wrong = [key for key in param if not isinstance(key, str)]
        if wrong:
            raise ProblemError(f"param: found the key {shown(wrong[0])}, expected names of fields")
        return dict(param)
    if is_dataclass(param) and not isinstance(param, type):
        return {f.name: getattr(param, f.name) for f in fields(param)}
    if hasattr(param, "_fieldnames"):  # scipy.io.matlab.mat_struct
        return {name: getattr(param, name) for name in param._fieldnames}
    if isinstance(param, SimpleNamespace) or (
        hasattr(param, "__dict__") and not callable(param) and not isinstance(param, np.ndarray)
    ):
        return {name: v for name, v in vars(param).items() if not name.startswith("_")}
    raise ProblemError(
        f"param: found {type(param).__name__}, expected a dict or a struct of parameters"
    )


def _plain(value: Any, name: str) -> Any:
    """Convert a MATLAB value: scalars, lists for vectors, None for [] and ''."""
    value = written_out(value, f"param.{name}")
    for _ in range(_DEEPEST):  # a scalar of MATLAB is a matrix of 1 x 1, by whatever name
        if isinstance(value, np.ndarray) and value.size == 1:
            value = value.ravel()[0]
        elif isinstance(value, (list, tuple)) and len(value) == 1:
            value = value[0]
    if isinstance(value, np.ndarray):
        cells = value.dtype == object
        value = [_plain(v, name) for v in value.ravel()] if cells else value.ravel().tolist()
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, (list, tuple, str)) and len(value) == 0 else value


def _check_nesting(name: str, value: Any, depth: int = 0) -> None:
    """Refuse lists in lists that no field has."""
    if not isinstance(value, (list, tuple)):
        return
    if depth > _DEEPEST:
        raise ProblemError(
            f"param.{name}: found lists more than {_DEEPEST} deep in each other, expected a value"
        )
    for item in value:
        _check_nesting(name, item, depth + 1)


# ---- values -----------------------------------------------------------------------------


def _same(value: Any, default: Any) -> bool:
    """Check whether a value asks for the original's default."""
    return default is not None and type(value) is not list and bool(value == default)


def _check(name: str, value: Any, strict: bool, tighten: int, says: list[str]) -> None:
    """Unknown names, illegal switches, and values without effect."""
    entry = _BY_NAME.get(name)
    if entry is None:
        near = difflib.get_close_matches(name, _BY_NAME, 1, 0.5)
        found = f"param.{name}: unknown field" + (f", did you mean {near[0]}?" if near else "")
        if strict:
            raise ProblemError(found)
        says.append(found)
        return
    if entry.legal:
        check_one_of(name, value, entry.legal)
    if name in _EITHER or _same(value, entry.default):
        return
    if entry.effect == "none":
        says.append(f"param.{name} = {shown(value)} has no effect here")
    elif entry.plain and tighten:
        says.append(f"param.{name} = {shown(value)} has an effect with tighten = 0 only")


def _sparse(value: Any, tighten: int, says: list[str]) -> int:
    switch = int(value)
    if switch > 1 and tighten:
        says.append(f"param.sparseSW = {switch} is treated as {switch - 2} with tighten = 1")
    return switch


def _local(value: Any, strict: bool, says: list[str]) -> str:
    if not isinstance(value, str):
        wrong("POPsolver", value, "the name of a local solver")
    if value and value not in _LOCAL:
        if strict:
            wrong("POPsolver", value, "one of " + ", ".join(map(repr, _LOCAL)))
        says.append(f"param.POPsolver = {shown(value)} is unknown and treated as {_LOCAL[0]!r}")
    return value


def _solver(value: Any, says: list[str]) -> tuple[str, str]:
    """Return the name of the solver as given, and the solver it stands for."""
    expected = "one of " + ", ".join(map(repr, (*_SOLVERS, *solver_names())))
    if not isinstance(value, str):
        wrong("SDPsolver", value, expected)
    if value in ("auto", *SOLVERS) or value.startswith("cvxpy:"):
        return value, value
    if value not in _SOLVERS:
        wrong("SDPsolver", value, expected)
    if value != _SOLVERS[0]:
        says.append(f"param.SDPsolver = {value!r} is replaced by 'auto'")
    return value, "auto"
