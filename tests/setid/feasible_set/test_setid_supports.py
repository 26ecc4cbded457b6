"""Proved ranges of linear functions of the parameters."""

from __future__ import annotations

import time
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from identification_cases import PLANT
from identified_cases import empty, first_order, identified, second_order
from scipy.optimize import linprog

import setid
import sparsepop_py as sp
from setid.feasible_points.centre import central
from setid.feasible_points.members import (
    feasible,
    is_member,
    members,
    nominal,
    projection_estimate,
)
from setid.feasible_set.proposer import Proposer
from setid.feasible_set.supports import cover_of, supports
from setid.proofs import supports as proved
from setid.proofs.supports import Cover, safe_maxima

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
    uses = cover_of, members, central, feasible, projection_estimate
    for use in (*uses, lambda result: setid.worst_case_error(result, [0.0, 0.0])):
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
    assert other.member is False and "proved not to be consistent" in str(other)
    assert is_member(second_order(samples=200).formulation, feasible(second_order(samples=200)))


def test_one_limit_is_for_all_that_is_proved_of_a_centre(monkeypatch: pytest.MonkeyPatch) -> None:
    result = second_order(samples=200)
    late, low, high = central(result, time_limit=0.0), *result.outer_box
    assert late.member is None and np.isnan(late.level) and "is not proved" in str(late)
    assert late.theta == pytest.approx((low + high) / 2)
    assert np.all(late.error >= (high - low) / 2)
    limits, solve = list[float | None](), sp.solve

    def noted(problem, options):
        limits.append(options.time_limit)
        return solve(problem, options)

    monkeypatch.setattr(sp, "solve", noted)
    assert central(result, 20.0).member is False
    assert len(limits) == 1 and limits[0] is not None and limits[0] < 20.0
    for wrong in (-1.0, "long"):
        with pytest.raises(setid.SetidError, match="time_limit: found"):
            central(result, wrong)  # type: ignore[arg-type]


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


# ---- weak duality -----------------------------------------------------------------------


@pytest.mark.parametrize("size", [1.0, 1e6, 1e-9])
def test_bounds_of_any_multipliers_hold_in_rationals(size: float) -> None:
    """The direction is the rounded combination of rows: what is left is rounding alone."""
    rng = np.random.default_rng(3)
    matrix, right = rng.normal(size=(6, 3)), rng.normal(size=6)
    cover = Cover(("a", "b", "c"), np.full(3, -size), np.full(3, size), matrix, right, True)
    weights = np.abs(rng.normal(size=(40, 6))) * 10.0 ** rng.integers(-3, 4, size=(40, 6))
    found = safe_maxima(cover, weights @ matrix, np.arange(6), weights)
    for bound, use, direction in zip(found, weights, weights @ matrix, strict=True):
        w = [Fraction(x) for x in use.tolist()]
        value = sum(a * Fraction(b) for a, b in zip(w, right.tolist(), strict=True))
        for column, d in zip(matrix.T.tolist(), direction.tolist(), strict=True):
            rest = Fraction(d) - sum(a * Fraction(b) for a, b in zip(w, column, strict=True))
            value += abs(rest) * Fraction(size)
        assert value <= Fraction(float(bound))
    lies = np.where(rng.random(weights.shape) < 0.5, -weights, np.nan)
    box = safe_maxima(cover, weights @ matrix, np.arange(6), lies)  # as without multipliers
    assert np.all(box >= np.abs(weights @ matrix).sum(axis=1) * size)


def test_negative_multipliers_prove_nothing() -> None:
    cover = Cover(("a",), np.zeros(1), np.ones(1), np.ones((1, 1)), np.array([10.0]), True)
    for weight in (-1.0, -np.inf, np.inf, np.nan):  # -1 would say that 0 is at most -9
        bound = safe_maxima(cover, np.zeros((1, 1)), np.zeros(1, np.int64), np.full((1, 1), weight))
        assert bound[0] >= 0.0


def test_bases_are_shared_by_directions() -> None:
    cover = cover_of(second_order())
    source = Proposer(cover)
    directions = RNG.normal(size=(300, 5)) / (cover.upper - cover.lower)
    served = np.concatenate([found.places for found in source.multipliers(directions)])
    assert sorted(served.tolist()) == list(range(300)) and len(source.bases) < 200
    again = Proposer(cover, source.bases)
    assert len(again.bases) == len(source.bases)
    assert np.all(again.points @ cover.matrix.T <= cover.right + 1e-6 * np.abs(cover.right).max())
    for found in Proposer(cover, source.bases).multipliers(directions):
        bounds = safe_maxima(cover, directions[found.places], found.rows, found.weights)
        reached = (source.points @ directions[found.places].T).max(axis=0)
        assert np.all(bounds >= reached - 1e-9 * np.abs(reached))


def test_few_rows_of_a_long_record_are_in_the_programs() -> None:
    """Tangents of a ball: the support of each direction is that of all rows, by SciPy."""
    rng = np.random.default_rng(5)
    rows = rng.normal(size=(4000, 4))
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    right = 1.0 + 0.3 * rng.random(4000)
    cover = Cover(("a", "b", "c", "d"), np.full(4, -2.0), np.full(4, 2.0), rows, right, True)
    source, directions = Proposer(cover), rng.normal(size=(12, 4))
    found = proved.supports(cover, directions, lambda _: source)[:, 1]
    for direction, most in zip(directions, found, strict=True):
        solved = linprog(-direction, rows, right, bounds=[(-2.0, 2.0)] * 4)
        assert most == pytest.approx(-solved.fun, rel=1e-7)
    assert source.program_rows < 1000


def test_no_program_is_begun_when_time_is_over() -> None:
    cover = cover_of(second_order())
    source = Proposer(cover, until=time.monotonic() - 1.0)
    assert list(source.multipliers(np.eye(5))) == [] and not source.contradictory
    known = Proposer(cover)
    wanted = len(list(known.multipliers(np.eye(5))))
    late = Proposer(cover, known.bases, time.monotonic() - 1.0)
    assert len(list(late.multipliers(np.eye(5)))) == wanted  # what bases serve needs no program


def test_contradictory_rows_are_named() -> None:
    ends, rows = (-np.ones(2), np.ones(2)), np.array([[1.0, 1.0], [-1.0, -1.0]])
    cover = Cover(("a", "b"), *ends, rows, np.array([0.5, -0.6]), True)
    source = Proposer(cover)
    assert list(source.multipliers(np.eye(2))) == [] and source.contradictory
    weights = source.contradiction()
    assert weights is not None
    assert safe_maxima(cover, np.zeros((1, 2)), np.arange(2), weights[None, :])[0] < 0.0


def test_products_that_underflow_prove_nothing() -> None:
    """theta = -1e100 satisfies 1e-180 theta <= -1e-100, though the product of the row is 0."""
    wide, row = np.array([1e200]), np.array([[1e-180]])
    spaces = SimpleNamespace(lower=-wide, upper=wide, matrix=row, right=np.array([-1e-100]))
    found = safe_maxima(spaces, np.zeros((1, 1)), np.zeros(1, np.int64), np.full((1, 1), 1e-150))
    assert found[0] >= 0.0
