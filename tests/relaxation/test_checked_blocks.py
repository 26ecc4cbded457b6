"""Blocks and relaxations from outside are checked before they are used."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.budget import LimitReached
from sparsepop_py.relaxation.blocks import BlockGroup
from sparsepop_py.relaxation.hierarchy import SPECS, Families, RelaxationSpec, relaxation_specs
from sparsepop_py.relaxation.shapes import SHAPES

X = sp.variables(2)
DISC = sp.Problem(X[0] * X[1], [X[0] ** 2 + X[1] ** 2 <= 1, X[0] + X[1] == 0.5], lower=-1, upper=1)
ONE = np.zeros((1, 1, 1), np.int32)
ALL = np.array([[[0], [1], [2]]], np.int32)


def block(
    free: Any = False,
    generator: Any = (0,),
    clique: Any = (0,),
    basis: Any = ALL,
    place: Any = None,
) -> BlockGroup:
    return BlockGroup(free, np.array(generator), np.array(clique), basis, place)


@pytest.fixture
def shape() -> Iterator[Callable[[Any], None]]:
    def register(made: Any) -> None:
        SHAPES.register("mine", made if callable(made) else lambda *given: made)

    yield register
    SHAPES.unregister("mine")


@pytest.fixture
def source() -> Iterator[Callable[[Any], None]]:
    def register(made: Any) -> None:
        SPECS.register("mine", made if callable(made) else lambda *given: made)

    yield register
    SPECS.unregister("mine")


def raising(error: BaseException) -> Callable[..., Any]:
    def plugged(*given: Any) -> Any:
        raise error

    return plugged


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (None, "found NoneType, expected a list of BlockGroup"),
        ("blocks", "found str, expected a list"),
        ([3], "block 0: found int, expected a BlockGroup"),
        ([block(), block(generator=[99])], "block 1, generator: found 99, expected 0 to 8"),
        ([block(generator=[-1])], "generator: found -1, expected 0 to 8"),
        ([block(generator=[0.0])], "generator: found float64 in 1 axes, expected an array of int"),
        ([block(generator=[0, 1])], "found 2 generators and 1 cliques, expected 1"),
        ([block(clique=[1])], "clique: found 1, expected -1 to 0"),
        ([block(basis=ALL[0])], "basis: found int32 in 2 axes, expected .* in 3 axes"),
        ([block(basis=ALL * 1.0)], "basis: found float64 in 3 axes"),
        ([block(basis=None)], "basis: found NoneType"),
        ([block(basis=2 * ALL)], "basis: found 4, expected 0 to 2"),
        ([block(basis=ALL[:, :0])], r"found a basis of shape \(1, 0, 1\)"),
        ([block(basis=np.zeros((1, 2, 1), np.int32))], "found a monomial twice"),
        ([block(free=1)], "found free=1, expected True or False"),
        ([block(free=True, basis=ONE)], "found free multipliers of generator 0"),
        ([block(free=True, generator=[1], basis=ONE)], "free multipliers of generator 1"),
        ([block(free=True, generator=[3], basis=ONE)], "free multipliers of generator 3"),
        ([block(place=np.zeros((1, 3), int))], "place: found rows up to 0 in shape"),
    ],
)
def test_wrong_blocks_are_named(shape: Callable[[Any], None], made: Any, message: str) -> None:
    shape(made)
    with pytest.raises(sp.ProblemError, match=f"shape 'mine'.*{message}"):
        sp.relax(DISC, shape="mine")


def test_letters_may_come_in_any_order(shape: Callable[[Any], None]) -> None:
    words = np.array([[[0, 0], [1, 0], [2, 1]]])
    shape([block(basis=words), block(free=True, generator=[2], basis=ONE)])
    [free, group] = sp.relax(DISC, shape="mine").groups
    assert free.free and group.basis.tolist() == [[[0, 0], [0, 1], [1, 2]]]


@pytest.mark.parametrize("error", [IndexError("why"), sp.ProblemError("why"), StopIteration("why")])
def test_what_a_shape_raises_is_its_own(shape: Callable[[Any], None], error: Exception) -> None:
    shape(raising(error))
    with pytest.raises(sp.ProblemError, match="shape 'mine': .*why") as caught:
        sp.relax(DISC, shape="mine")
    assert caught.value.__cause__ is error


def test_the_end_of_the_time_passes(shape: Callable[[Any], None]) -> None:
    shape(raising(LimitReached()))
    with pytest.raises(LimitReached):
        sp.relax(DISC, shape="mine")


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (raising(KeyError("why")), "raised KeyError: 'why'"),
        (None, "found NoneType, expected a list of RelaxationSpec"),
        ([3], "found int, expected a RelaxationSpec"),
        ([RelaxationSpec("m", 0.5)], "found order=None, expected an integer > 0"),
        ([RelaxationSpec("m", 0.5, "zig")], "found shape='zig', expected one of full, linear"),
        ([RelaxationSpec("m", float("nan"), "linear")], "found share=nan"),
        ([RelaxationSpec("", 0.5, "linear")], "found name='', expected a text"),
        ([RelaxationSpec("m", 0.5, "linear", terms="x")], "terms='x', expected one of"),  # type: ignore[arg-type]
        ([RelaxationSpec("m", 0.5, "linear", joined="x")], "joined='x', expected one of"),  # type: ignore[arg-type]
        ([RelaxationSpec("m", 0.5, "linear", memory=0.0)], "found memory=0.0"),
        ([RelaxationSpec("m", 0.5, "linear", plain=3)], "found plain=3"),  # type: ignore[arg-type]
    ],
)
def test_wrong_offers_are_named(source: Callable[[Any], None], made: Any, message: str) -> None:
    source(made)
    with pytest.raises(sp.ProblemError, match=f"relaxations 'mine'.*{message}"):
        relaxation_specs(DISC, Families(DISC, (), True, "auto"), (), None)
