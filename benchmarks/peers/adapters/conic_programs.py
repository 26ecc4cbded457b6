"""Conic programs by sdpa-python or CSDP, as ``benchmarks/peers/conic.py`` states them."""

import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import scipy.sparse as sps
from common import Refused, answer, run

sys.path.append(str(Path(__file__).resolve().parents[1]))
import conic  # which needs nothing of the package


def solve(task, number):
    begin = time.process_time()
    p, name = task["programs"][number], sys.argv[3]
    rows, columns, values = p["A"]
    cones = SimpleNamespace(zero=p["zero"], nonnegative=p["nonnegative"], psd=tuple(p["psd"]))
    A = sps.csc_array((values, (rows, columns)), shape=(len(p["b"]), len(p["q"])))
    program = SimpleNamespace(
        A=A, b=np.array(p["b"]), q=np.array(p["q"]), cones=cones, offset=p["offset"]
    )
    middle = time.process_time()
    ended = conic.PEERS[name](program, task["seconds"])
    if ended is None:
        raise Refused(f"{name} is not installed")
    status, value, seconds = ended
    value = value if status in ("solved", "almost") else -np.inf
    # CSDP is a process of its own, whose seconds are not those of this one
    return {**answer(status, value, begin=begin, middle=middle), "solving": seconds}


run(solve)
