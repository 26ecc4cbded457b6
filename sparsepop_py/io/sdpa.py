"""SDPA sparse files (``.dat-s``): conic programs out and in.

The format states  minimise c'y  subject to  F_1 y_1 + ... + F_M y_M - F_0 >= 0  with blocks of
symmetric matrices, a negative size standing for a diagonal block. Rows of the zero cone have
no place in it: each is written as two linear rows of opposite sign, as SparsePOP does, and
reading pairs of such rows at the head of the first block makes them equations again.

References
----------
K. Fujisawa, M. Fukuda, K. Kobayashi, M. Kojima, K. Nakata, M. Nakata, M. Yamashita, SDPA
(SemiDefinite Programming Algorithm) User's Manual, Tokyo Institute of Technology, 2008.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.conic.program import Cones, ConicProgram
from sparsepop_py.errors import FormatError, ProblemError, check_kind
from sparsepop_py.files import read_text, write_text

__all__ = ["read_sdpa", "write_info", "write_sdpa"]

_MOST_ROWS = 10**8  # of a program: its dense right-hand side then has 0.8 GB
_ROOT2 = float(np.sqrt(2.0))
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?")
_PUNCTUATION = re.compile(r"[,(){}\[\]]")  # the format allows it around and between numbers


def write_sdpa(program: ConicProgram, path: str | Path, title: str = "") -> None:
    """Write a program as an SDPA sparse file.

    Parameters
    ----------
    program : ConicProgram
        Of :func:`sparsepop_py.assemble` or :func:`read_sdpa`.
    path : str or Path
    title : str
        The first line, a comment. The constant of the objective, for which the format has no
        place, is added to it, and :func:`read_sdpa` finds it there.

    Raises
    ------
    ProblemError
        If the first argument is no conic program.
    OutputError
        If the file cannot be written; what was there before is unchanged.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> problem = sp.Problem(x * y, [x**2 + y**2 == 1], lower=-1, upper=1)
    >>> program = sp.assemble(sp.relax(problem), problem.objective)
    >>> path = pathlib.Path(tempfile.mkdtemp(), "disc.dat-s")
    >>> sp.write_sdpa(program, path)
    >>> sp.read_sdpa(path).cones == program.cones
    True
    """
    if not isinstance(program, ConicProgram):
        raise ProblemError(
            f"write_sdpa: found {type(program).__name__}, expected a ConicProgram, "
            "such as assemble(relax(problem), problem.objective)"
        )
    check_kind(title, str, "title")
    cones = program.cones
    first = 2 * cones.zero + cones.nonnegative
    sizes = ([-first] if first else []) + list(cones.psd)
    constant = f"offset {program.offset!r}"
    lines = ['"' + " ".join([*title.split(), constant]) + '"']
    lines += [f"{program.q.size} = mDIM", f"{len(sizes)} = nBLOCK"]
    lines += [" ".join(map(str, sizes)) + " = bLOCKsTRUCT"]
    lines += [" ".join(repr(float(v)) for v in program.q)]
    block, i, j, weight = _places(cones)
    whole = sps.csc_array(sps.hstack([sps.csc_array(program.b[:, None]), program.A]))
    rows, values = whole.indices, -whole.data
    matrix = np.repeat(np.arange(whole.shape[1]), np.diff(whole.indptr))
    entries = [(matrix, block[rows], i[rows], j[rows], values * weight[rows])]
    twice = np.flatnonzero(rows < cones.zero)  # the second of each pair, with the other sign
    second = i[rows[twice]] + 1
    entries.append((matrix[twice], block[rows[twice]], second, second, -values[twice]))
    columns = [np.concatenate(parts) for parts in zip(*entries, strict=True)]
    order = np.lexsort((columns[3], columns[2], columns[1], columns[0]))
    for k in order.tolist():
        m, b, p, q, v = (column[k] for column in columns)
        if v:
            lines.append(f"{m} {b} {p} {q} {float(v)!r}")
    write_text(path, "\n".join(lines) + "\n")


def _places(
    cones: Cones,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Block, row, column (from 1) and weight of each conic row."""
    linear = np.concatenate(
        [2 * np.arange(cones.zero), 2 * cones.zero + np.arange(cones.nonnegative)]
    )
    block, i, j = [np.ones(linear.size, int)], [linear + 1], [linear + 1]
    weight = [np.ones(linear.size)]
    for number, size in enumerate(cones.psd):
        column, row = np.tril_indices(size)
        block.append(np.full(row.size, number + (2 if linear.size else 1)))
        i.append(row + 1)
        j.append(column + 1)
        weight.append(np.where(row == column, 1.0, 1.0 / _ROOT2))
    return np.concatenate(block), np.concatenate(i), np.concatenate(j), np.concatenate(weight)


def read_sdpa(path: str | Path) -> ConicProgram:
    r"""Read an SDPA sparse file.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    ConicProgram
        For :func:`sparsepop_py.solve_conic`; its ``q'y + offset`` is the objective that the
        file minimises. Pairs of opposite rows at the head of the first diagonal block become
        equations.

    Raises
    ------
    FormatError
        If the file is missing or malformed; the message names the line.

    Examples
    --------
    Minimise y subject to y >= 2, as a linear block of one row:

    >>> import sparsepop_py as sp, pathlib, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "least.dat-s"
    ...     _ = path.write_text("1\n1\n-1\n1.0\n0 1 1 1 2.0\n1 1 1 1 1.0\n")
    ...     program = sp.read_sdpa(path)
    >>> round(sp.solve_conic(program).primal, 6)
    2.0
    """
    lines = read_text(path, "replace").splitlines()
    reader = _Lines(str(path), lines)
    m, blocks = reader.whole("mDIM", 0), reader.whole("nBLOCK", 1)
    sizes = [int(v) for v in reader.numbers(blocks, "bLOCKsTRUCT", whole=True)]
    if any(size == 0 for size in sizes):
        reader.fail("found a block of size 0, expected other sizes")
    if sum(size * (size + 1) // 2 if size > 0 else -size for size in sizes) > _MOST_ROWS:
        reader.fail(f"found blocks of more than {_MOST_ROWS} entries, expected fewer")
    q = np.array(reader.numbers(m, "the objective"))
    table = reader.entries()
    matrix, block, i, j, value = _checked(table, m, sizes, reader)
    row, weight, cones = _rows(sizes, block, i, j)
    whole = sps.csc_array((-value * weight, (row, matrix)), shape=(cones.rows, m + 1))
    program = ConicProgram(
        q, sps.csc_array(whole[:, 1:]), whole[:, [0]].toarray().ravel(), cones, reader.offset
    )
    return _with_equations(program)


def _value(text: str) -> float:
    """Read a number, whose exponent may be written with d as in Fortran."""
    return float(text.lower().replace("d", "e"))


class _Lines:
    """The lines of a file, comments left out, and where we are."""

    def __init__(self, path: str, lines: list[str]) -> None:
        self.path, self.lines, self.number = path, lines, 0
        self.offset = 0.0
        while self.number < len(lines) and lines[self.number].lstrip()[:1] in ('"', "*"):
            found = re.search(r'offset (\S+?)"', lines[self.number])
            if found and _NUMBER.fullmatch(found.group(1)):
                self.offset = _value(found.group(1))
            self.number += 1

    def fail(self, message: str) -> None:
        raise FormatError(f"{self.path}:{self.number}: {message}")

    def next(self, what: str) -> str:
        while self.number < len(self.lines):
            self.number += 1
            line = self.lines[self.number - 1]
            if line.strip() and line.lstrip()[0] not in '"*':
                return line
        raise FormatError(f"{self.path}: the file ends where {what} was expected")

    def whole(self, what: str, least: int) -> int:
        found = _NUMBER.search(self.next(what))
        value = _value(found.group()) if found else -1.0
        if not value.is_integer() or value < least:
            self.fail(f"expected {what}, an integer of at least {least}")
        return int(value)

    def numbers(self, count: int, what: str, whole: bool = False) -> list[float]:
        found: list[float] = []
        while len(found) < count:
            fields = _PUNCTUATION.sub(" ", self.next(what)).split()
            for field in fields[: count - len(found)]:  # what follows is a comment
                if not _NUMBER.fullmatch(field):
                    self.fail(f"found {field!r}, expected {what}, {count} numbers")
                found.append(_value(field))
            if not np.all(np.isfinite(found)):
                self.fail(f"expected {what}, finite numbers")
            if whole and any(not value.is_integer() for value in found):
                self.fail(f"expected {what}, integers")
        return found[:count]

    def entries(self) -> NDArray[np.float64]:
        """Read the rest of the file: matrix, block, row, column, value, shape (E, 5)."""
        rows = []
        while self.number < len(self.lines):
            self.number += 1
            text = self.lines[self.number - 1]
            found = _NUMBER.findall(text)
            if not found:
                continue
            if len(found) != 5:
                self.fail(f"found {len(found)} numbers, expected matrix, block, row, column, value")
            rows.append([_value(text) for text in found])
        return np.array(rows, float).reshape(-1, 5)


def _checked(
    table: NDArray[np.float64], m: int, sizes: list[int], reader: _Lines
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
    index, value = table[:, :4], table[:, 4]
    limit = np.abs(np.array(sizes))
    fits = np.all(index == np.floor(index), axis=1) & (index[:, 0] >= 0) & (index[:, 0] <= m)
    fits &= (index[:, 1] >= 1) & (index[:, 1] <= len(sizes)) & np.isfinite(value)
    block = np.where(fits, index[:, 1], 1).astype(int)
    most = limit[block - 1]
    fits &= np.all((index[:, 2:] >= 1) & (index[:, 2:] <= most[:, None]), axis=1)
    diagonal = np.array(sizes)[block - 1] < 0
    fits &= ~diagonal | (index[:, 2] == index[:, 3])
    if not np.all(fits):
        wrong = table[np.flatnonzero(~fits)[0]]
        shown = " ".join(f"{v:g}" for v in wrong)
        reader.fail(f"found the entry {shown}, expected one of {m} matrices in its block")
    whole = index.astype(int)
    low, high = whole[:, 2:].min(axis=1), whole[:, 2:].max(axis=1)
    return whole[:, 0], block, low, high, value


def _rows(
    sizes: list[int], block: NDArray[Any], i: NDArray[Any], j: NDArray[Any]
) -> tuple[NDArray[np.int64], NDArray[np.float64], Cones]:
    """Conic row and weight of each entry: diagonal blocks and blocks of size 1 first."""
    size = np.array(sizes)
    linear = (size < 0) | (size == 1)
    count = np.where(linear, np.abs(size), size * (size + 1) // 2)
    order = np.concatenate([np.flatnonzero(linear), np.flatnonzero(~linear)])
    start = np.zeros(size.size, int)
    start[order] = np.concatenate([[0], np.cumsum(count[order])[:-1]])
    number = block - 1
    inside = np.where(linear[number], i - 1, j * (j - 1) // 2 + i - 1)
    weight = np.where(i == j, 1.0, _ROOT2)
    cones = Cones(0, int(count[linear].sum()), tuple(size[~linear].tolist()))
    return start[number] + inside, weight, cones


def _with_equations(program: ConicProgram) -> ConicProgram:
    """Pairs of opposite linear rows at the head, as one equation each."""
    rows = sps.csr_array(sps.hstack([sps.csc_array(program.b[:, None]), program.A]))
    half = program.cones.nonnegative // 2
    sums = sps.csr_array(rows[0 : 2 * half : 2] + rows[1 : 2 * half : 2])
    size = sps.csr_array(abs(rows[0 : 2 * half : 2]))
    paired = (abs(sums).sum(axis=1) == 0) & (size.sum(axis=1) > 0) if half else np.zeros(0, bool)
    zero = int(np.argmin(np.append(paired, False)))
    if not zero:
        return program
    keep = np.concatenate([2 * np.arange(zero), np.arange(2 * zero, program.b.size)])
    cones = Cones(zero, program.cones.nonnegative - 2 * zero, program.cones.psd)
    A = sps.csc_array(sps.csr_array(program.A)[keep])
    return ConicProgram(program.q, A, program.b[keep], cones, program.offset)


def write_info(
    path: str | Path,
    moment: NDArray[np.int64],
    scale: NDArray[np.float64],
    shift: NDArray[np.float64],
) -> None:
    """Write the ``.info`` map of variables, x = scale * y[index] + shift.

    Parameters
    ----------
    path : str or Path
    moment : (n,) int
        Number of the y (from 1) of each variable, -1 where it is fixed.
    scale, shift : (n,) float

    Raises
    ------
    ProblemError
        If the lengths differ.
    """
    if not moment.shape == scale.shape == shift.shape:
        raise ProblemError(
            f"scale, shift: found {scale.size} and {shift.size} values, expected {moment.size}"
        )
    rows = zip(moment.tolist(), scale.tolist(), shift.tolist(), strict=True)
    text = "".join(f"{index} {a!r} {b!r}\n" for index, a, b in rows)
    write_text(path, text)
