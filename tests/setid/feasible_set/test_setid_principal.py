"""Proved ranges along principal axes of the members."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identified_cases import identified, second_order

import setid
from setid.feasible_points.members import members
from setid.feasible_set.principal import principal_cover
from setid.feasible_set.supports import cover_of, supports

TRUTH = np.array([-1.5, 0.7, 0.5, 0.25])


@pytest.fixture(scope="module")
def result() -> setid.Identification:
    """Output noise of 5 % of the static gain, 30 samples."""
    model, noise = setid.TransferFunction(na=2, nb=2, nk=1), setid.Noise(output=0.05)
    u = np.repeat(np.sign(np.random.default_rng(0).standard_normal(10)), 3)
    truth = setid.simulate_record(model, TRUTH, u, noise, 1)
    return setid.identify(truth.data, model, noise, options=setid.Options(time_limit=20.0))


def test_principal_ranges_hold_and_are_narrow(result: setid.Identification) -> None:
    cover, points = principal_cover(result, 60.0)
    plain = cover_of(result)
    own = len(plain.right)
    assert len(cover.right) == own + 8 + 24  # four axes, six pairs with two diagonals each
    known = np.concatenate([TRUTH[None, :], members(result, 20), points])
    slack = 1e-9 * (np.abs(known) @ np.abs(cover.matrix.T) + np.abs(cover.right))
    assert np.all(known @ cover.matrix.T <= cover.right + slack)
    assert np.all(cover.matrix @ TRUTH <= cover.right)
    axes = cover.matrix[own : own + 4]
    ratio = np.ptp(supports(cover, axes), axis=1) / np.ptp(supports(plain, axes), axis=1)
    assert ratio.min() < 0.3  # members fill a thin part of the plain cover
    assert principal_cover(result, 60.0)[0] is cover  # several bands ask once


def test_diagonals_of_pairs_of_axes_cut_corners_off(result: setid.Identification) -> None:
    """The set is no box in its axes: along some diagonals less is proved than axes alone allow."""
    cover, _ = principal_cover(result, 60.0)
    axes = replace(cover, matrix=cover.matrix[:-24], right=cover.right[:-24])
    across = cover.matrix[-24:-12]
    ratio = np.ptp(supports(cover, across), axis=1) / np.ptp(supports(axes, across), axis=1)
    assert ratio.min() < 0.9 and ratio.max() <= 1.0 + 1e-9


def test_bands_of_output_errors_are_narrow(result: setid.Identification) -> None:
    band = setid.step_band(result, 40)
    assert band.report is not None and band.report.ratio < 2.5
    true = setid.simulate(result.formulation.model, TRUTH, np.ones(40)).ravel()
    assert np.all((true >= band.low) & (true <= band.high))


def test_an_exact_cover_and_sets_without_points_stay_as_they_are() -> None:
    exact = second_order(samples=40)
    cover, points = principal_cover(exact, 10.0)
    assert cover.exact and len(cover.right) == len(cover_of(exact).right) and not len(points)
    model, noise = setid.TransferFunction(1, 1, nk=1), setid.Noise(output=0.1)
    truth = setid.simulate_record(model, [-0.5, 1.0], np.cos(np.arange(20.0)), noise)
    bare = identified(setid.formulate(truth.data, model, noise), [(-0.6, -0.4), (0.9, 1.1)])
    assert len(principal_cover(bare, 10.0)[0].right) == len(cover_of(bare).right)


def test_parameters_with_one_value_have_no_part_in_directions() -> None:
    """The width of a known parameter is zero, and bands asked the engine in units of 1e-300."""
    model, noise = setid.TransferFunction(na=1, nb=2, nk=1), setid.Noise(output=0.1)
    u = np.random.default_rng(0).integers(-2, 3, 12).astype(float)
    truth = setid.simulate_record(model, [-0.5, 1.0, 0.25], u, noise, 1)
    options = setid.Options(time_limit=2.0, progress=False)
    found = setid.identify(truth.data, model, noise, setid.Known({"b2": 0.25}), options)
    cover, _ = principal_cover(found, 10.0)
    new = cover.matrix[len(cover_of(found).right) :]
    assert len(new) and not new[:, 2].any() and np.all(np.abs(new).max(axis=1) < 1e6)
    assert np.all(cover.matrix @ [-0.5, 1.0, 0.25] <= cover.right)
    true = setid.simulate(model, [-0.5, 1.0, 0.25], np.ones(10)).ravel()
    band = setid.step_band(found, 10, time_limit=2.0)
    assert np.all((band.low <= true) & (true <= band.high)) and np.all(np.isfinite(band.high))
