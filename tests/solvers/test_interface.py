"""What a solver is offered and may return: the page says it, and the package holds to it."""

from __future__ import annotations

import ast
import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.conic.program import STATUSES, solution
from sparsepop_py.solvers.interface import SolverSettings

PAGE = Path(__file__).resolve().parents[2] / "docs" / "extend.md"


def program():
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, lower=[-1, 0], upper=[2, 3])
    return sp.assemble(sp.relax(problem, shape="linear"), problem.objective)


def rows(heading: str) -> dict[str, str]:
    """First and second column of the table under a heading."""
    text = PAGE.read_text(encoding="utf-8")
    table = text[text.index(f"| {heading} |") :].split("\n\n")[0]
    return dict(re.findall(r"^\| `(\w+)` \| ([^|]+?) \|", table, re.MULTILINE))


def test_the_page_lists_every_status_and_setting():
    assert tuple(rows("status")) == STATUSES
    written = {name: ast.literal_eval(default) for name, default in rows("setting").items()}
    assert written == {f.name: f.default for f in fields(SolverSettings)}


def test_other_statuses_are_refused_by_name():
    p = program()
    y, z = np.zeros(p.q.size), np.zeros(p.b.size)
    for status in STATUSES:
        assert solution(p, status, y, z, 0, 0.0, "mine", "").status == status
    with pytest.raises(sp.SparsePOPError, match="solver 'mine': found status 'optimal'"):
        solution(p, "optimal", y, z, 0, 0.0, "mine", "")


@pytest.mark.parametrize("which", ["y", "z"])
def test_other_shapes_are_refused_by_name(which):
    p = program()
    y, z = np.zeros(p.q.size + (which == "y")), np.zeros(p.b.size + (which == "z"))
    with pytest.raises(sp.SparsePOPError, match=f"solver 'mine': found {which} of shape"):
        solution(p, "solved", y, z, 0, 0.0, "mine", "")
