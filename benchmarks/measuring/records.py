"""One measurement as one JSON line, with the versions and the commit it belongs to."""

from __future__ import annotations

import dataclasses
import json
import math
import platform
import subprocess
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, get_type_hints

from ..errors import BenchmarkError

__all__ = ["PHASES", "Row", "commit", "read_rows", "versions", "write_row"]

ROOT = Path(__file__).resolve().parents[2]
PHASES = (
    "parse",
    "presolve",
    "cliques",
    "relax",
    "assemble",
    "solve",
    "certify",
    "refine",
    "branch",
    "other",
)
_PACKAGES = ("numpy", "scipy", "clarabel", "highspy", "pyscipopt")
_WORDS = {"inf": math.inf, "-inf": -math.inf, "nan": math.nan}


@cache
def versions() -> dict[str, str]:
    """Versions of Python and of the packages that a time depends on.

    Examples
    --------
    >>> sorted(versions())[:3]
    ['clarabel', 'highspy', 'numpy']
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    found = {"python": platform.python_version(), "sparsepop_py": project["project"]["version"]}
    for name in _PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "missing"
    return found


@cache
def commit() -> str:
    """The git commit of this tree, with "-dirty" where files differ from it."""
    command = ["git", "-C", str(ROOT), "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=20)
    except (OSError, subprocess.TimeoutExpired):
        return "unknown"
    return done.stdout.strip() or "unknown"


@dataclass(frozen=True)
class Row:
    """What one program did with one case, once.

    Parameters
    ----------
    family, problem : str
    size : int or None
        What grows in the family: variables, samples.
    seed, repeat : int
    solver : str
        ``"sparsepop_py"`` or a peer.
    variant : str
        Which options, ``"default"`` where nothing was switched off.
    status : str
        As the program says it; ``missing``, ``budget: ...`` and ``error: ...`` are ours.
    proved : bool
        Whether ``lower`` is proved and ``upper`` attained, or both are only claimed.
    lower, upper : float
        Of the only objective; nan where there are several.
    gap : float
        The largest, as ``gap_kind`` says.
    gap_kind : {"relative", "width"}
        Divided by max(1, abs(upper)), or by the width of the interval of a pair.
    objectives, closed : int
        How many objectives there are, and how many have a gap within ``tolerance``.
    tolerance : float
        The gap that was asked for.
    cpu_seconds : float
        Without the phase "parse", in which the problem is put into the program's own form.
    wall_seconds : float
        Of the same; of our own runs.
    phases : dict
        CPU seconds by phase, see PHASES.
    peak_mb : float
        Largest resident memory of the process during the measurement, in MB.
    variables, constraints, degree, order, largest_block, moments : int
        Sizes of the problem and of the last relaxation; order 0 is none.
    verified : bool or None
        Whether all certificates verify; None where there are none.
    verify_seconds : float
    certificate_bytes, certificate_parts, problem_bytes : int
        Of all certificates together, those included that they quote; parts are what trees of
        boxes end in.
    optimum : float or None
        Known beforehand.
    valid : bool or None
        Whether lower <= optimum <= upper within 1e-6; None without a known optimum.
    violation : float
        The largest violation of a row at a point that the program returned.
    violated : float
        The share of the points that violate a row by more than 1e-9.
    details : tuple of dict
        One for each objective: label, status, lower, upper, gap, violation; of our own runs
        also trace, with CPU seconds of the objective so far and both bounds after each step.
    notes : tuple of str
    versions, commit : dict, str
    """

    family: str
    problem: str
    size: int | None
    seed: int
    repeat: int
    solver: str
    status: str
    variant: str = "default"
    proved: bool = False
    lower: float = math.nan
    upper: float = math.nan
    gap: float = math.inf
    gap_kind: str = "relative"
    objectives: int = 1
    closed: int = 0
    tolerance: float = math.nan
    cpu_seconds: float = math.nan
    wall_seconds: float = math.nan
    phases: dict[str, float] = field(default_factory=dict)
    peak_mb: float = math.nan
    variables: int = 0
    constraints: int = 0
    degree: int = 0
    order: int = 0
    largest_block: int = 0
    moments: int = 0
    verified: bool | None = None
    verify_seconds: float = math.nan
    certificate_bytes: int = 0
    certificate_parts: int = 0
    problem_bytes: int = 0
    optimum: float | None = None
    valid: bool | None = None
    violation: float = math.nan
    violated: float = math.nan
    details: tuple[dict[str, Any], ...] = ()
    notes: tuple[str, ...] = ()
    versions: dict[str, str] = field(default_factory=versions)
    commit: str = field(default_factory=commit)

    def to_json(self) -> str:
        """One line; numbers that JSON does not know become words.

        Examples
        --------
        >>> row = Row("zoo", "p", None, 0, 0, "SCIP", "missing")
        >>> Row.from_json(row.to_json()).gap
        inf
        """
        return json.dumps(_worded(dataclasses.asdict(self)), allow_nan=False)

    @staticmethod
    def from_json(line: str, place: str = "line 1") -> Row:
        """The row of a line.

        Raises
        ------
        BenchmarkError
            If it is no row; the message names place and field.
        """
        try:
            values = json.loads(line)
        except json.JSONDecodeError as error:
            raise BenchmarkError(f"{place}: found no JSON ({error.msg})") from None
        if not isinstance(values, dict):
            raise BenchmarkError(f"{place}: found {type(values).__name__}, expected an object")
        known = {f.name: f for f in dataclasses.fields(Row)}
        for name, f in known.items():
            without = f.default is dataclasses.MISSING
            if name not in values and without and f.default_factory is dataclasses.MISSING:
                raise BenchmarkError(f"{place}: the field {name!r} is missing")
        for name in values:
            if name not in known:
                raise BenchmarkError(f"{place}: found the field {name!r}, which no row has")
        return Row(**{name: _read(name, value, place) for name, value in values.items()})


_FLOATS = {name for name, hint in get_type_hints(Row).items() if "float" in str(hint)} - {"phases"}
_WHOLE = {"seed", "repeat", "objectives", "closed", "variables", "constraints", "order"}


def _read(name: str, value: Any, place: str) -> Any:
    """The value of a field, checked where tables and pictures compute with it."""
    value = _unworded(value)
    if name in _FLOATS:
        if value is None and name == "optimum":
            return None
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise BenchmarkError(f"{place}: {name}: found {value!r}, expected a number")
        return float(value)
    if name in _WHOLE and (isinstance(value, bool) or not isinstance(value, int)):
        raise BenchmarkError(f"{place}: {name}: found {value!r}, expected an integer")
    if name in ("phases", "versions") and not isinstance(value, dict):
        raise BenchmarkError(f"{place}: {name}: found {value!r}, expected an object")
    return tuple(value) if isinstance(value, list) else value


def _worded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _worded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_worded(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return "nan" if math.isnan(value) else "inf" if value > 0 else "-inf"
    return value


def _unworded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _unworded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_unworded(item) for item in value]
    return _WORDS.get(value, value) if isinstance(value, str) else value


def write_row(row: Row, path: Path) -> None:
    """Append a row to a file of JSON lines."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", encoding="utf-8") as file:
        file.write(row.to_json() + "\n")


def read_rows(paths: Iterable[Path]) -> Iterator[Row]:
    """All rows of some files.

    Raises
    ------
    BenchmarkError
        If a file cannot be read or a line is no row.
    """
    for path in paths:
        try:
            lines = path.read_text(encoding="utf-8").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise BenchmarkError(f"{path}: cannot be read ({error})") from None
        for number, line in enumerate(lines, 1):
            if line.strip():
                yield Row.from_json(line, f"{path}, line {number}")
