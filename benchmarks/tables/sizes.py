"""Sizes and values of the plain relaxation beside those of SparsePOP, file by file."""

from __future__ import annotations

import csv
import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import sparsepop_py as sp
from sparsepop_py.budget import cpu_seconds
from sparsepop_py.verified.arithmetic.display import rounded

from ..errors import BenchmarkError
from .text import table

__all__ = ["Compared", "compare_sizes", "read_reference", "sizes_table"]

_SIZES = ("rowsA", "colsA", "nFree", "nLP", "nSDPblocks", "maxSDP")
_SETTINGS = ("relaxOrder", "sparseSW", "complementaritySW")


@dataclass(frozen=True)
class Reference:
    """What SparsePOP returned for one file at one setting.

    Parameters
    ----------
    param : dict
        Fields of ``param`` it was called with.
    sizes : tuple of int
        Rows and columns of A, free and linear variables, blocks and the largest of them.
    value : float
        Its SDPobjValue.
    """

    param: dict[str, float]
    sizes: tuple[int, ...]
    value: float


@dataclass(frozen=True)
class Compared:
    """One file at one setting, solved here, and there if that is known."""

    name: str
    param: dict[str, float]
    sizes: tuple[int, ...]
    solver_value: float
    proved: float
    seconds: float
    reference: Reference | None


def read_reference(path: Path) -> dict[str, list[Reference]]:
    """Rows of a table by file name.

    Its columns are ``problem``, ``relaxOrder``, ``sparseSW``, ``complementaritySW``,
    ``rowsA``, ``colsA``, ``nFree``, ``nLP``, ``nSDPblocks``, ``maxSDP`` and ``SDPobjValue``.
    Rows without sizes are left out, and those of its MATLAB path where a column ``mex`` tells.

    Raises
    ------
    BenchmarkError
        If a column is missing.
    """
    found: dict[str, list[Reference]] = {}
    with path.open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        missing = {"problem", "SDPobjValue", *_SETTINGS, *_SIZES} - set(reader.fieldnames or ())
        if missing:
            raise BenchmarkError(f"{path.name}: found no column {min(missing)!r}, expected it")
        for row in reader:
            if not row["rowsA"] or row.get("mex", "1") != "1":
                continue
            param = {name: float(row[name]) for name in _SETTINGS}
            one = Reference(param, tuple(int(row[s]) for s in _SIZES), float(row["SDPobjValue"]))
            if all(other.param != param for other in found.setdefault(row["problem"], [])):
                found[row["problem"]].append(one)
    return found


def compare_sizes(
    files: Sequence[Path], reference: dict[str, list[Reference]], solve: bool = True
) -> Iterator[Compared]:
    """Every file at the settings of the reference, or at the least order."""
    for path in files:
        problem = sp.read_gms(path)
        for known in reference.get(path.name, [None]):  # type: ignore[list-item]
            param = known.param if known is not None else {"relaxOrder": 1.0}
            yield _compared(path.name, problem, param, known, solve)


def _compared(
    name: str, problem: sp.Problem, param: dict[str, float], known: Reference | None, solve: bool
) -> Compared:
    start = cpu_seconds()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sp.ParameterWarning)
        given = {"printLevel": 0, "tighten": 0, "SDPsolverSW": int(solve), **param}
        output = sp.sparsePOP(problem, given)
    info = output.SDPinfo
    blocks = info.SDPblock
    sizes = (
        *(info.rowSizeA, info.colSizeA, info.noOfFreevar, info.noOfLPvariables),
        *(len(blocks), max(blocks, default=0)),
    )
    value, proved = output.POP.solverValue, output.SDPobjValue
    return Compared(
        name,
        param,
        sizes,
        math.nan if value is None else value,
        math.nan if proved is None else proved,
        cpu_seconds() - start,
        known,
    )


def sizes_table(rows: Sequence[Compared]) -> str:
    """A Markdown table: where both agree, sizes stand once."""
    head = ["file", "order", "cliques", "A, free, linear, blocks", "SparsePOP", "SDP value"]
    head += ["SparsePOP's", "proved", "CPU s"]
    lines = []
    for row in rows:
        known = row.reference
        there = "" if known is None else "same" if known.sizes == row.sizes else _shown(known.sizes)
        cliques = "yes" if row.param.get("sparseSW", 1) else "one"
        if row.param.get("complementaritySW"):
            cliques += ", complementarity"
        cells = [row.name, f"{row.param['relaxOrder']:g}", cliques, _shown(row.sizes), there]
        cells += [f"{row.solver_value:.9g}", "" if known is None else f"{known.value:.9g}"]
        lines.append([*cells, rounded(row.proved, False, 10), f"{row.seconds:.1f}"])
    return table(head, lines)


def _shown(sizes: tuple[int, ...]) -> str:
    rows, columns, free, linear, blocks, largest = sizes
    return f"{rows} x {columns}, {free}, {linear}, {blocks} up to {largest}"
