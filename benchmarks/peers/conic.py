"""The same conic program in CSDP and in sdpa-python, as separate programs or packages.

Equality rows become two linear rows for CSDP, which knows none; sdpa-python gets the dual,
where they are free variables. Seconds are CPU seconds of the solve; for CSDP, whose process
reads its file first, of the process.

References
----------
B. Borchers, CSDP, a C library for semidefinite programming, Optim. Methods Softw. 11, 1999.
M. Yamashita et al., Latest developments in the SDPA family, in: Handbook on Semidefinite,
Conic and Polynomial Optimization, 2012.
"""

from __future__ import annotations

import resource
import shutil
import subprocess
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sps

if TYPE_CHECKING:  # adapters use this file where the package is not installed
    from sparsepop_py.conic.program import ConicProgram


__all__ = ["PEERS", "csdp", "sdpa", "sdpa_text"]

_ROOT2 = float(np.sqrt(2.0))
Ended = tuple[str, float, float]  # status, value, CPU seconds


def _entries(program: ConicProgram) -> tuple[np.ndarray, ...]:
    """Block (from 0), row, column and weight of every conic row; linear rows are block -1."""
    cones = program.cones
    linear = cones.nonnegative
    block, i, j = [np.full(linear, -1)], [np.arange(linear)], [np.arange(linear)]
    for number, size in enumerate(cones.psd):
        column, row = np.tril_indices(size)
        block.append(np.full(row.size, number))
        i.append(row)
        j.append(column)
    block, i, j = (np.concatenate(x) for x in (block, i, j))
    return block, i, j, np.where(i == j, 1.0, 1.0 / _ROOT2)


def sdpa_text(program: ConicProgram) -> str:
    """The program in SDPA's sparse format: min q'y, sum of y_a F_a - F_0 semidefinite."""
    cones, zero = program.cones, program.cones.zero
    block, i, j, weight = _entries(program)
    linear = 2 * zero + cones.nonnegative
    sizes = [*cones.psd, *([-linear] if linear else [])]
    number = np.where(block < 0, len(cones.psd), block) + 1
    shift = np.where(block < 0, 2 * zero, 0) + 1
    head = [str(program.q.size), str(len(sizes)), " ".join(map(str, sizes))]
    head.append(" ".join(f"{v:.17g}" for v in program.q))
    lines = []
    everything = sps.hstack([sps.csc_array(program.b[:, None]), program.A], format="csc").tocoo()
    for row, moment, value in zip(everything.row, everything.col, everything.data, strict=True):
        if row < zero:
            for sign, place in ((1.0, 2 * row + 1), (-1.0, 2 * row + 2)):
                entry = -sign * value
                lines.append(f"{moment} {len(sizes)} {place} {place} {entry:.17g}")
        else:
            k = row - zero
            entry = -weight[k] * value
            lines.append(f"{moment} {number[k]} {i[k] + shift[k]} {j[k] + shift[k]} {entry:.17g}")
    return "\n".join(head + lines) + "\n"


def csdp(program: ConicProgram, limit: float) -> Ended | None:
    """CSDP's status, value and CPU seconds; None if it is not installed."""
    if shutil.which("csdp") is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "program.dat-s"
        path.write_text(sdpa_text(program))
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        try:
            done = subprocess.run(
                ["csdp", path.name, "solution"],
                cwd=folder,
                capture_output=True,
                text=True,
                timeout=limit,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return "time limit", float("nan"), limit
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    words = {0: "solved", 1: "infeasible", 2: "unbounded", 3: "almost"}
    value = [line for line in done.stdout.splitlines() if line.startswith("Primal objective")]
    found = float(value[-1].split(":")[1]) if value else float("nan")
    return words.get(done.returncode, "failed"), found + program.offset, seconds


def sdpa(program: ConicProgram, limit: float) -> Ended | None:
    """sdpa-python's status, value and CPU seconds; None if it is not installed."""
    if find_spec("sdpap") is None:
        return None
    import sdpap

    cones, zero = program.cones, program.cones.zero
    block, i, j, weight = _entries(program)
    start = np.concatenate([[0], np.cumsum(np.array(cones.psd, int) ** 2)]).astype(int)
    sizes = np.array([*cones.psd, 0], int)
    linear = block < 0
    base = np.where(linear, 0, cones.nonnegative + start[block])
    place = base + np.where(linear, i, i * sizes[block] + j)
    mirror = base + np.where(linear, i, j * sizes[block] + i)
    twice = np.flatnonzero(place != mirror)
    width = cones.nonnegative + int(start[-1])
    spread = sps.csr_array(
        (
            np.concatenate([weight, weight[twice]]),
            (
                np.concatenate([place, mirror[twice]]),
                np.concatenate([np.arange(place.size), twice]),
            ),
        ),
        shape=(width, place.size),
    )
    full = sps.vstack([program.A[:zero], spread @ program.A[zero:]], format="csc")
    right = np.concatenate([program.b[:zero], spread @ program.b[zero:]])
    K = sdpap.SymCone(f=zero, l=cones.nonnegative, s=tuple(cones.psd))
    J = sdpap.SymCone(f=program.q.size)
    c, b = (sps.csc_matrix(v[:, None]) for v in (right, -program.q))
    begin = time.process_time()
    _, _, info, _, _ = sdpap.solve(
        sps.csc_matrix(full.T), b, c, K, J, {"print": "no", "numThreads": 1}
    )
    seconds = time.process_time() - begin
    words = {"pdOPT": "solved", "pdFEAS": "almost"}
    value = program.offset - float(info["primalObj"])
    return words.get(info["phasevalue"], "failed"), value, seconds


PEERS = {"CSDP": csdp, "sdpa-python": sdpa}
