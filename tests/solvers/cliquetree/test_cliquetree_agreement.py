"""A sample of the relaxations of ``benchmarks.agreement``: Clarabel is the judge."""

import shutil

import pytest

from benchmarks.agreement import compare
from benchmarks.peers.conic import csdp
from benchmarks.problems.relaxations import NAMED, ORIGINS, cases
from sparsepop_py.solvers import cliquetree

SLOW = ("dense quartic in", "cut of 7", "cut of 6", "cliques of 7")
SAMPLE = [
    case
    for origin in ORIGINS
    for case in [c for c in cases([origin]) if not c.name.startswith(SLOW)][1::12]
    if not case.name.startswith(("eiv", "oe 40"))
    and "160" not in case.name
    and "order 3" not in case.name
]


def test_the_set_is_as_large_and_mixed_as_it_says():
    every = cases()
    assert len(every) >= 500 and len({(c.origin, c.name) for c in every}) == len(every)
    assert set(NAMED) <= {c.origin for c in every} == set(ORIGINS)


@pytest.mark.parametrize(
    "case",
    [pytest.param(c, marks=[pytest.mark.slow] * (k % 2)) for k, c in enumerate(SAMPLE)],
    ids=lambda c: f"{c.origin}: {c.name}",
)
def test_what_is_called_solved_agrees_with_clarabel(case):
    found = compare(case, "numpy")
    assert found.falls_back or found.agrees, (found.own.status, found.loss)
    if case.origin == "empty":
        assert found.own.status == "infeasible"
    elif case.origin in NAMED:
        assert not found.falls_back


def test_the_sdpa_file_is_the_same_program():
    if shutil.which("csdp") is None:
        pytest.skip("csdp is not installed")
    case = next(c for c in cases(["random sparse"]) if c.name == "2, order 2")  # equalities too
    program = case.build()
    status, value, _ = csdp(program, 60.0)
    own = cliquetree.solve(program)
    assert program.cones.zero and status in ("solved", "almost")
    assert value == pytest.approx(own.dual, abs=1e-4 * max(1.0, abs(own.dual)))
