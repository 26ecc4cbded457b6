"""HiGHS says nothing on standard output, whatever its version prints by itself."""

from __future__ import annotations

import subprocess
import sys

import pytest

SOLVED = """
import numpy as np, scipy.sparse as sps
from sparsepop_py.lp.highs import LinearModel
rows = sps.csr_array(np.array([[1.0, 1.0]]))
ends = np.array([1.0]), np.array([np.inf])
found = LinearModel(rows, ends, (np.zeros(2), np.full(2, 5.0))).solve(np.array([1.0, 2.0]))
assert found.status == "solved" and abs(found.value - 1.0) < 1e-9
"""
READ = """
import pathlib, sys
from sparsepop_py.lp.files import read_model
path = pathlib.Path(sys.argv[1], "p.lp")
path.write_text("min\\n x + y\\nst\\n c: x + y >= 1\\nend\\n")
read_model(path)
"""


@pytest.mark.parametrize("code", [SOLVED, READ], ids=["solve", "read"])
def test_nothing_is_printed(code, tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
