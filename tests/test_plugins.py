"""What is plugged in is checked when it is registered, or else when it is used."""

from __future__ import annotations

from typing import Any

import pytest

import sparsepop_py as sp
from sparsepop_py.errors import FormatError, ProblemError, SolverNotFound
from sparsepop_py.formats import FORMATS, Format
from sparsepop_py.relaxation.shapes import SHAPES
from sparsepop_py.solvers import SOLVERS


def program() -> Any:
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, lower=-1, upper=2)
    return sp.assemble(sp.relax(problem, 1), problem.objective)


@pytest.mark.parametrize(
    ("registry", "name", "entry", "message"),
    [
        (SOLVERS, 3, print, "solver: found 3, expected a name"),
        (SOLVERS, "", print, "solver: found '', expected a name"),
        (SOLVERS, "mine", 3, "solver 'mine': found int, expected a function"),
        (SOLVERS, "mine", "no_colon", "found 'no_colon', expected 'module:attribute'"),
        (SHAPES, "mine", None, "shape 'mine': found NoneType, expected a function"),
        (FORMATS, ".zzz", print, "file ending '.zzz': found .*, expected a Format"),
        (FORMATS, "zzz", Format(print), "expected a name that begins with '.'"),
    ],
)
def test_what_cannot_be_used_is_not_registered(
    registry: Any, name: Any, entry: Any, message: str
) -> None:
    before = list(registry)
    with pytest.raises((SolverNotFound, FormatError, ProblemError), match=message):
        registry.register(name, entry)
    assert list(registry) == before


@pytest.mark.parametrize("place", ["no_such_module:solver", "math:no_such_function", "math:pi"])
def test_places_without_a_solver_are_named(place: str) -> None:
    SOLVERS.register("mine", place)
    try:
        with pytest.raises(SolverNotFound, match="solver 'mine': found"):
            sp.solve_conic(program(), "mine")
    finally:
        SOLVERS.unregister("mine")


def test_solvers_return_solutions() -> None:
    SOLVERS.register("mine", lambda program, settings: None)
    try:
        with pytest.raises(ProblemError, match="'mine' returned: found NoneType"):
            sp.solve_conic(program(), "mine")
    finally:
        SOLVERS.unregister("mine")
