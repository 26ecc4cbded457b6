"""What is plugged in is checked when it is registered, or else when it is used."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.conic.program import ConicSolution
from sparsepop_py.errors import FormatError, ProblemError, SolverNotFound, SparsePOPError
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


def claimed(given: Any, **other: Any) -> ConicSolution:
    """Give a solution that claims a dual value of 99."""
    y, z = np.zeros(given.q.size), np.zeros(given.b.size)
    told: dict[str, Any] = {"status": "solved", "y": y, "s": z, "z": z, "primal": 0.0, "dual": 99.0}
    told |= {"residual": 0.0, "iterations": 1, "seconds": 0.0, "solver": "another"}
    return ConicSolution(**(told | other))


def test_values_of_solvers_are_computed_again() -> None:
    SOLVERS.register("mine", lambda given, settings: claimed(given, iterations=-5))
    try:
        found = sp.solve_conic(program(), "mine")
    finally:
        SOLVERS.unregister("mine")
    assert found.dual == program().offset and found.iterations == 0  # of z = 0
    assert found.residual == np.abs(program().q).max() > 0


def raises(*given: Any) -> Any:
    raise NotImplementedError("why")


@pytest.mark.parametrize(
    ("solver", "message"),
    [
        (raises, "raised NotImplementedError: why"),
        (lambda given, settings: claimed(given, status="great"), "found status 'great'"),
        (lambda given, settings: claimed(given, y=np.zeros(1)), r"found y of shape \(1,\)"),
        (lambda given, settings: claimed(given, z="z"), "raised ValueError"),
        (lambda given, settings: claimed(given, y=given.q * 1j), "raised TypeError: found complex"),
        (lambda given, settings: claimed(given, iterations=None), "raised TypeError"),
    ],
)
def test_wrong_solvers_are_named(solver: Any, message: str) -> None:
    SOLVERS.register("mine", solver)
    try:
        with pytest.raises(SparsePOPError, match=f"^solver 'mine': {message}"):
            sp.solve_conic(program(), "mine")
    finally:
        SOLVERS.unregister("mine")


def test_formats_that_raise_are_named(tmp_path: Path) -> None:
    path = tmp_path / "file.zzz"
    path.touch()
    FORMATS.register(".zzz", Format(raises, raises))
    problem = sp.Problem(sp.variables(1)[0] ** 2)
    try:
        with pytest.raises(FormatError, match=r"file\.zzz: file ending '\.zzz': raised NotImpl"):
            sp.read(path)
        with pytest.raises(FormatError, match=r"file ending '\.zzz': raised NotImpl") as caught:
            sp.write(problem, path)
    finally:
        FORMATS.unregister(".zzz")
    assert isinstance(caught.value.__cause__, NotImplementedError)
