"""Compiled kernels keep the arrays that they reach by address: numba frees what is not named."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

pytest.importorskip("numba")

# Freed memory is overwritten (PYTHONMALLOC=debug), and where the C library can do so, large
# pieces of it leave the process at once. One front: four pivots, three rows of updates. Eight
# equal blocks B of 48: the longest step from B in the direction -B is 1.
SCRIPT = """
import ctypes
import numpy as np
from sparsepop_py.solvers.cliquetree.kernels import compiled

matrix = 9.0 * np.eye(7) + 1.0
values, stack, none = matrix[:, :4].ravel(), np.zeros(9), np.zeros(0, np.int64)
zero, no = np.zeros(1, np.int64), np.zeros(2, np.int64)
sizes = np.array([4]), np.array([3])
rest = (zero, no, none, no, none, zero, stack)
assert compiled.factorize(values, 0.0, 0.0, 0, 1, *sizes, *rest) == -1
expected = np.linalg.cholesky(matrix)[:, :4]
lower = np.arange(7)[:, None] >= np.arange(4)
assert np.allclose(values.reshape(7, 4)[lower], expected[lower], rtol=1e-12, atol=0.0)

if hasattr(ctypes.CDLL(None), "mallopt"):
    assert ctypes.CDLL(None).mallopt(-3, 65536) == 1  # M_MMAP_THRESHOLD
blocks = np.repeat((5.0 * np.eye(48) + 1.0).ravel(), 8)
start, size, inverse, result = zero, np.array([48]), np.zeros_like(blocks), np.zeros_like(blocks)
assert compiled.lanes.inverse_factors(blocks, start, size, 0, 1, inverse) == -1
assert 0.999 <= compiled.lanes.largest_step(inverse, -blocks, start, size, 0, 1, 2.0) <= 1.0
compiled.lanes.sandwich(blocks, blocks, blocks, start, size, 0, 1, result)
cube = np.linalg.matrix_power(5.0 * np.eye(48) + 1.0, 3)
assert np.allclose(result.reshape(48, 48, 8), cube[:, :, None], rtol=1e-12, atol=0.0)
"""


def test_no_kernel_uses_memory_that_was_freed() -> None:
    environment = {**os.environ, "PYTHONMALLOC": "debug"}
    words = [sys.executable, "-c", SCRIPT]
    run = subprocess.run(words, env=environment, capture_output=True, text=True)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")
