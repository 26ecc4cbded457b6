"""Conic programs by sdpa-python, in the form that ``benchmarks/peers/conic.py`` gives them."""

import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import scipy.sparse as sps
from common import answer, run

sys.path.append(str(Path(__file__).resolve().parents[1]))
import conic  # which needs nothing of the package


def solve(task, number):
    begin = time.process_time()
    p = task["programs"][number]
    rows, columns, values = p["A"]
    cones = SimpleNamespace(zero=p["zero"], nonnegative=p["nonnegative"], psd=tuple(p["psd"]))
    A = sps.csc_array((values, (rows, columns)), shape=(len(p["b"]), len(p["q"])))
    program = SimpleNamespace(
        A=A, b=np.array(p["b"]), q=np.array(p["q"]), cones=cones, offset=p["offset"]
    )
    middle = time.process_time()
    status, value, _ = conic.sdpa(program, task["seconds"])
    value = value if status in ("solved", "almost") else -np.inf
    return answer(status, value, begin=begin, middle=middle)


run(solve)
