"""Members of a feasible set: attained vectors and consistent mixtures of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from identified_cases import first_order
from numpy.typing import NDArray

import setid
from setid.feasible_points import members as room
from setid.feasible_points.members import is_member, members
from setid.formulation.formulation import Formulation


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """What was asked of mixtures."""
    asked: list[bool] = []

    def ask(formulation: Formulation, theta: NDArray[np.float64]) -> bool:
        asked.append(is_member(formulation, theta))
        return asked[-1]

    monkeypatch.setattr(room, "is_member", ask)
    return asked


def test_no_mixture_is_tried_twice(tried: list[bool]) -> None:
    result = replace(first_order())
    more = members(result, 12, seed=3)
    assert len(tried) == 12
    fewer = members(result, 5, seed=3)
    assert len(tried) == 12
    np.testing.assert_array_equal(fewer, more[: len(fewer)])
    assert len(fewer) == len(result.attained) + sum(tried[:5])
    np.testing.assert_array_equal(members(result, 12, seed=3, time_limit=0.0), more)
    members(result, 14, seed=3)
    assert len(tried) == 14


@pytest.mark.parametrize(
    "other", [lambda result: members(result, 4, seed=2), lambda result: members(replace(result), 4)]
)
def test_other_seeds_and_results_have_mixtures_of_their_own(
    other: Callable[[object], object], tried: list[bool]
) -> None:
    result = replace(first_order())
    members(result, 4)
    other(result)
    assert len(tried) == 8


def test_none_is_tried_once_time_is_over(tried: list[bool]) -> None:
    result = replace(first_order())
    np.testing.assert_array_equal(members(result, 9, time_limit=0.0), result.attained)
    assert not tried


@pytest.mark.parametrize("band", [setid.step_band, setid.simulate_band, setid.frequency_band])
def test_sampled_bands_try_none_either(band: Callable[..., object], tried: list[bool]) -> None:
    result = replace(first_order())
    band(result, kind="sampled", time_limit=0.0)
    without = len(tried)  # the nominal model may need a look
    band(replace(result), kind="sampled", time_limit=60.0)
    assert without <= 1 and len(tried) > 20
