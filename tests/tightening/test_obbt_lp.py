"""OBBT by linear programs: the tightened boxes hold all feasible points."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from random_cases import SEEDS, random_case

import sparsepop_py as sp
from sparsepop_py import Problem
from sparsepop_py.sparsity.correlative import find_cliques
from sparsepop_py.tightening.mccormick import LinearRelaxation
from sparsepop_py.tightening.obbt_lp import tighten_bounds
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.steps import BoxProof, Replay


def relaxation_of(problem):
    box = Interval(problem.lower, problem.upper)
    return LinearRelaxation.of(problem, box, find_cliques(problem)), box


@given(SEEDS)
@settings(max_examples=20, deadline=None)
def test_tightened_boxes_hold_all_feasible_points(seed):
    case = random_case(seed)
    mccormick, box = relaxation_of(case.problem)
    replay = Replay(case.problem, None)
    variables = range(case.problem.dimension)
    smaller, step, _ = tighten_bounds(replay, mccormick, box, variables)
    assert np.all(case.points >= smaller.lo)
    assert np.all(case.points <= smaller.hi)
    assert np.all((smaller.lo >= box.lo) & (smaller.hi <= box.hi))
    if step is not None:
        again = BoxProof((step,)).replay(Replay(case.problem, None))
        assert np.array_equal(again.lo, smaller.lo)
        assert np.array_equal(again.hi, smaller.hi)


def test_tightening_finds_what_no_row_shows_alone():
    # x + y >= 3, x - y >= -1 and x <= 4: x >= 1 needs both rows
    x, y = sp.variables(2)
    problem = Problem(x, [x + y >= 3, x - y >= -1, x * y <= 100], [-9.0, -9.0], [4.0, 9.0])
    mccormick, box = relaxation_of(problem)
    smaller, step, _ = tighten_bounds(Replay(problem, None), mccormick, box, (0, 1))
    assert step is not None
    assert smaller.lo == pytest.approx([1.0, -1.0], abs=1e-6)
    assert smaller.hi == pytest.approx([4.0, 5.0], abs=1e-6)


def test_variables_that_occur_nowhere_are_left_alone():
    x, y, _ = sp.variables(3)
    problem = Problem(x, [x + y >= 1, x - y >= 0], -1.0, 1.0)
    mccormick, box = relaxation_of(problem)
    smaller, _, _ = tighten_bounds(Replay(problem, None), mccormick, box, (0, 1, 2))
    assert smaller.lo[2] == -1.0
    assert smaller.hi[2] == 1.0
    assert smaller.lo[0] == pytest.approx(0.5, abs=1e-6)
