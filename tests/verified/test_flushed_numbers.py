"""No proof is accepted in a process that takes subnormal numbers for zero."""

from __future__ import annotations

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.verified.arithmetic import interval
from sparsepop_py.verified.certificate.linear_bound import LinearBound
from sparsepop_py.verified.points.feasible_point import ProvedPoint, prove_point
from sparsepop_py.verified.points.unbounded_ray import falling_ray
from sparsepop_py.verified.uncertain_rows.rows import UncertainRows
from sparsepop_py.verified.uncertain_rows.sign_tree import ParameterBox

x, y = sp.variables(2)
LINE = sp.Problem(x, [x + y == 1])
ROW, NONE = np.zeros(1, np.int64), np.zeros(0, np.int64)
HALF = np.array([0.5, 0.5])
START = np.array([[-1.0], [1.0]])


def ray():
    start = ProvedPoint(HALF, -0.5, 0.0, "exact", NONE, NONE)
    return falling_ray(sp.Problem(-x), start, np.array([1.0, 0.0]))


def linear_bound():
    found = LinearBound("UNBOUNDED", -np.inf, -np.inf, None, (), None, (0, 1), (-1, 1))
    return bool(found.verify(LINE, x))


def parameter_box():
    rows = UncertainRows(("m",), [0.0], [[1.0]], [1.0], [[0.0]])
    return ParameterBox(("m",), START[0], START[1], START, ()).verify(rows, START)


PROOFS = {
    "exact point": lambda: prove_point(LINE, HALF, ROW, ROW, "exact"),
    "Krawczyk's test": lambda: prove_point(LINE, HALF, ROW, ROW, "krawczyk"),
    "substitution": lambda: prove_point(LINE, HALF, ROW, ROW, "substitution"),
    "ray": lambda: ray() is not None,
    "linear bound": linear_bound,
    "box of parameters": parameter_box,
}


@pytest.mark.parametrize("what", PROOFS)
def test_subnormal_numbers_are_needed(what, monkeypatch):
    assert PROOFS[what]() not in (None, False)
    monkeypatch.setattr(interval, "_TINY", 0.0)  # what a flushed product looks like
    with pytest.raises(FloatingPointError, match="IEEE"):
        PROOFS[what]()
