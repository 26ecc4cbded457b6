"""Values that MATLAB users have and Python users do not: sparse ones, lists in lists, odd names."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.sparse as sps

import sparsepop_py as sp
from sparsepop_py.budget import Deadline, LimitReached
from sparsepop_py.compat.param import read_parameters
from sparsepop_py.files import as_path
from sparsepop_py.problem import generators
from sparsepop_py.relaxation.blocks import block_groups
from sparsepop_py.sparsity.correlative import find_cliques

SQUARE = {"typeCone": 1, "dimVar": 1, "noTerms": 2, "supports": [[1], [2]], "coef": [-2.0, 1.0]}
BOX = ([], [-5.0], [5.0])


def nested(depth: int) -> list[Any]:
    found: list[Any] = []
    for _ in range(depth):
        found = [found]
    return found


def test_sparse_values_are_those_that_they_hold() -> None:
    one = read_parameters({"relaxOrder": sps.csr_matrix([[2.0]]), "printLevel": 0})
    assert one.relaxOrder == 2
    named = read_parameters({"errorBdIdx": sps.csr_matrix([[1.0, 2.0]]), "printLevel": 0})
    assert named.errorBdIdx == [1.0, 2.0]
    with pytest.raises(sp.ProblemError, match="param.relaxOrder: found"):
        read_parameters({"relaxOrder": sps.csr_matrix([[1.0, 2.0]])})


@pytest.mark.parametrize("field", ["errorBdIdx", "relaxOrder", "printLevel", "reduceEqualitiesSW"])
def test_lists_in_lists_in_lists_are_refused(field: str) -> None:
    circle: list[Any] = []
    circle.append(circle)
    for value in (circle, nested(3000)):
        with pytest.raises(sp.ProblemError, match=rf"param\.{field}: found lists more than"):
            sp.sparsePOP(SQUARE, *BOX, {field: value, "printLevel": 0} | {field: value})


@pytest.mark.parametrize("field", ["degree", "sizeCone"])
@pytest.mark.parametrize("value", [[[1, 2], [3]], nested(3000)])
def test_ragged_fields_of_structs_are_named(field: str, value: Any) -> None:
    with pytest.raises(sp.ProblemError, match=rf"objPoly.*\.{field}: found"):
        sp.sparsePOP({**SQUARE, field: value}, *BOX, {"printLevel": 0})


def test_ragged_bounds_of_intervals_are_named() -> None:
    with pytest.raises(sp.ProblemError, match="lbd: found lists of several lengths"):
        sp.sparsePOPintervals([SQUARE], [[1], [1, 2]], [5])


@pytest.mark.parametrize("text", ["..:f", ".:f", ".json:loads"])
def test_names_of_no_module_are_refused(text: str) -> None:
    with pytest.raises(sp.ProblemError, match="objPoly: found the string"):
        sp.sparsePOP(text)


@pytest.mark.parametrize("field", ["SDPsolverOutFile", "detailedInfFile", "printFileName"])
@pytest.mark.parametrize("name", ["a\0b", "a\ud800b", "x" * 300])
def test_names_of_no_file_are_refused_before_the_work(field: str, name: str) -> None:
    with pytest.raises(sp.ProblemError, match=rf"param\.{field}: found"):
        sp.sparsePOP(SQUARE, *BOX, {"printLevel": [0, 2], field: name})


@pytest.mark.parametrize("name", ["", "a\0b", "a\ud800b"])
def test_paths_that_no_file_has_are_refused(name: str) -> None:
    with pytest.raises(sp.FormatError, match="path: found"):
        as_path(name)


def test_iterations_are_as_many_as_are_asked() -> None:
    options = sp.Options(max_iterations=2**40, solver="clarabel")
    x, y = sp.variables(2)
    problem = sp.Problem(x**4 - 3 * x * y + y**2, [x**2 + y**2 <= 2])
    assert sp.solve(problem, options).status is not sp.Status.LIMIT


def test_blocks_of_high_orders_keep_limits() -> None:
    x, y = sp.variables(2)
    problem = sp.Problem(x**4 - 3 * x * y + y**2, [x**2 + y**2 <= 2])
    system = generators.stacked(problem, np.zeros((0, 2), np.int64))
    cliques, asked = find_cliques(problem), [problem.objective]
    groups = block_groups(problem, cliques, 2, system, asked, reduce=True, lean=False)
    assert groups
    for group in groups:
        if not group.free:
            with pytest.raises(LimitReached), Deadline(1e-9).kept():
                group.products()
        with pytest.raises(LimitReached), Deadline(1e-9).kept():
            group.terms(system)
    assert np.size(groups[0].products())
