"""Proved ranges of linear functions of the parameters."""

from __future__ import annotations

import numpy as np
import pytest
from identification_cases import PLANT
from identified_cases import empty, first_order, identified, second_order

import setid
from setid.feasible_points.centre import central
from setid.feasible_points.members import (
    feasible,
    is_member,
    members,
    nominal,
    projection_estimate,
)
from setid.feasible_set.supports import cover_of, supports

RNG = np.random.default_rng(1)


def test_intervals_of_the_first_laboratory() -> None:
    result = first_order()
    ends = np.array([v.outer for v in result.intervals.values()])
    expected = [[-0.5232558, -0.3453333], [1.9166667, 2.1093023]]  # exact, by hand
    assert np.allclose(ends, expected, atol=1e-6)


def test_supports_contain_the_truth_and_every_member() -> None:
    result = second_order()
    directions = RNG.normal(size=(20, 5))
    ranges = supports(cover_of(result), directions)
    points = np.vstack([PLANT, members(result, 20)])
    values = points @ directions.T
    assert np.all(values >= ranges[:, 0] - 1e-7) and np.all(values <= ranges[:, 1] + 1e-7)
    truth = directions @ PLANT
    assert np.all((truth >= ranges[:, 0]) & (truth <= ranges[:, 1]))


def test_supports_are_attained_for_equation_errors() -> None:
    result = second_order()
    cover = cover_of(result)
    assert cover.exact
    directions = np.eye(5)
    ranges = supports(cover, directions)
    inner = np.array([v.inner for v in result.intervals.values()])
    assert np.allclose(ranges, inner, rtol=1e-6, atol=1e-7)
    assert np.all(ranges[:, 0] <= inner[:, 0] + 1e-8) and np.all(ranges[:, 1] >= inner[:, 1] - 1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_chords_keep_the_truth_with_output_and_input_noise(seed: int) -> None:
    model = setid.TransferFunction(na=1, nb=2)
    theta, noise = np.array([-0.4, 0.3, -0.2]), setid.Noise(output=0.05, input=0.02)
    u = np.random.default_rng(seed).uniform(-1, 1, 40)
    truth = setid.simulate_record(model, theta, u, noise, seed)
    box = [(-1.0, 0.5), (-0.2, 1.0), (-1.0, 0.1)]
    result = identified(setid.formulate(truth.data, model, noise), box)
    cover = cover_of(result)
    assert not cover.exact and cover.right.size
    assert np.all(cover.matrix @ theta <= cover.right)
    directions = RNG.normal(size=(10, 3))
    ranges = supports(cover, directions)
    assert np.all((directions @ theta >= ranges[:, 0]) & (directions @ theta <= ranges[:, 1]))


def test_an_infinite_box_gives_infinite_ranges() -> None:
    result = identified(first_order().formulation, [(-1.0, np.inf), (0.0, 3.0)])
    ranges = supports(cover_of(result), [[1.0, 0.0], [0.0, 1.0]])
    assert np.allclose(ranges, [[-1, np.inf], [0, 3]])


def test_an_empty_set_is_refused() -> None:
    nothing = empty(first_order().formulation)
    for use in (cover_of, members, central, feasible, projection_estimate):
        with pytest.raises(setid.SetidError, match="empty feasible set"):
            use(nothing)


# ---- members ----------------------------------------------------------------------------


def test_members_are_consistent() -> None:
    result = first_order()
    found = members(result, 20)
    assert len(found) > len(result.attained) >= 3
    rows = result.formulation.regression
    assert rows is not None and all(rows.margin(theta).min() >= -1e-7 for theta in found)


def test_centre_error_and_membership() -> None:
    centre = central(first_order())
    assert centre.member is True and "consistent" in str(centre)
    other = central(second_order(samples=200))
    assert other.member is False and "feasible()" in str(other)
    assert is_member(second_order(samples=200).formulation, feasible(second_order(samples=200)))


def test_nominal_is_consistent_where_the_centre_is_not() -> None:
    result = second_order(samples=200)
    assert is_member(result.formulation, nominal(result))


def test_projection_estimate_is_the_least_maximum() -> None:
    result = second_order()
    best = setid.linf(result.formulation.data, result.formulation.model)
    rows = result.formulation.regression
    assert rows is not None
    theta = projection_estimate(result)
    assert np.abs(rows.target + rows.regressors @ theta).max() == pytest.approx(best.cost)


def test_no_members_without_witnesses_far_from_the_data() -> None:
    result = identified(first_order().formulation, [(5.0, 6.0), (1.0, 2.0)])
    with pytest.raises(setid.SetidError, match="no consistent"):
        members(result)
    infinite = identified(first_order().formulation, [(-np.inf, 6.0), (1.0, 2.0)])
    with pytest.raises(setid.SetidError, match="a1"):
        central(infinite)
