"""Checks of arrays from files: one wrong entry, or a type that wraps or rounds, is refused."""

from __future__ import annotations

import numpy as np
import pytest

from sparsepop_py.verified.arithmetic.array_cache import interned
from sparsepop_py.verified.arithmetic.array_checks import (
    are_indices,
    are_numbers,
    at_least,
    is_index,
)


@pytest.mark.parametrize("kind", [np.int32, np.int64])
@pytest.mark.parametrize(
    "values, sound",
    [([], True), ([0, 4], True), ([4, 5], False), ([-1, 4], False), ([0, 5, -1], False)],
)
def test_indices_run_from_zero_to_below_the_stop(kind, values, sound):
    assert are_indices(np.array(values, kind), 5) == sound


@pytest.mark.parametrize(
    "kind", [bool, np.int8, np.uint8, np.int16, np.uint32, np.uint64, float, object, complex]
)
def test_indices_of_types_that_wrap_or_are_no_integers_are_refused(kind):
    assert not are_indices(np.array([0, 1]).astype(kind), 5)


def test_arrays_are_compared_entry_by_entry_with_those_of_their_shape():
    one = np.array([1.0, -2.0])
    assert at_least(one, one) and at_least(one, np.array([1.0, -np.inf]))
    for other in ([1.0, -1.9], [1.1, -2.0], [np.nan, -2.0]):
        assert not at_least(one, np.array(other))
    for other in (np.zeros(0), np.zeros((0, 2)), np.full(1, -9.0), np.full((2, 1), -9.0)):
        assert not at_least(one, other) and not at_least(other, one + 99.0)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_numbers_are_finite(kind):
    assert are_numbers(np.array([], kind)) and are_numbers(np.array([-1e30, 0.0, 3.5], kind))
    for wrong in (np.nan, np.inf, -np.inf):
        assert not are_numbers(np.array([1.0, wrong, 2.0], kind))


@pytest.mark.parametrize("kind", [int, bool, np.float16, np.longdouble, complex, object])
def test_numbers_of_other_types_are_refused(kind):
    assert not are_numbers(np.array([0, 1]).astype(kind))


@pytest.mark.parametrize("number", [0, 4, np.int8(3), np.uint64(4)])
def test_a_whole_number_below_the_stop_is_an_index(number):
    assert is_index(number, 5)


@pytest.mark.parametrize(
    "number", [5, -1, True, False, np.True_, 1.0, "1", None, np.array(1), np.int64(5)]
)
def test_anything_else_is_no_index(number):
    assert not is_index(number, 5)


def test_equal_bytes_of_other_types_are_other_arrays():
    """Eight bytes of zeros are 0, 0.0 or two short zeros."""
    kinds = (np.int64, np.float64, np.uint64)
    kept = [interned(np.zeros(3, kind)) for kind in kinds]
    assert [array.dtype.type for array in kept] == list(kinds)
    assert interned(np.zeros(6, np.int32)).shape == (6,)
