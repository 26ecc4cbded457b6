"""Regions of frequency responses between grid points."""

from __future__ import annotations

import time
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from identification_cases import PLANT
from identified_cases import second_order

import setid
from setid.bands.frequency_arcs import refined_arcs
from setid.feasible_set.proposer import Proposer
from setid.proofs.frequency.arc_regions import ArcRegions, arc_regions, families_of
from setid.proofs.frequency.arcs import first_arcs, taylor
from setid.proofs.supports import Cover
from setid.simulation.responses import frequency_response

MODEL = setid.TransferFunction(na=2, nb=2, nk=1)
THETA = np.array([-1.6, 0.9, 0.5, 0.3])  # a resonance: pole radius .95


def box(width: float, rows: int = 0) -> Cover:
    rng = np.random.default_rng(7)
    matrix = rng.normal(size=(rows, 4))
    right = matrix @ THETA + 0.3 * width * np.abs(matrix).sum(axis=1)
    return Cover(MODEL.parameters, THETA - width, THETA + width, matrix, right, True)


def exact(theta: np.ndarray, w: float) -> mpmath.mpc:
    """B(z) / A(z) at exp(j w) with 40 digits."""
    with mpmath.workdps(40):
        z = mpmath.exp(mpmath.mpc(0, -1) * mpmath.mpf(w))
        a1, a2, b1, b2 = (mpmath.mpf(float(t)) for t in theta)
        return (b1 * z + b2 * z**2) / (1 + a1 * z + a2 * z**2)


def regions(cover: Cover, seconds: float = 20.0) -> ArcRegions:
    families = families_of(MODEL.transfer(1, 1), MODEL.parameters)
    return refined_arcs(cover, THETA, families, time.monotonic() + seconds)


def members(cover: Cover, count: int) -> list[np.ndarray]:
    rng = np.random.default_rng(1)
    found = np.where(
        rng.random((2000, 4)) < 0.5,
        rng.uniform(cover.lower, cover.upper, (2000, 4)),
        np.where(rng.random((2000, 4)) < 0.5, cover.lower, cover.upper),
    )
    return [x for x in found if np.all(cover.matrix @ x <= cover.right)][:count]


@pytest.mark.parametrize("width", [0.0, 1e-12, 2e-3])
def test_responses_lie_in_the_arcs_with_forty_digits(width: float) -> None:
    cover = box(width, rows=4 if width else 0)
    arcs = regions(cover)
    assert arcs.covers
    rng = np.random.default_rng(2)
    points = members(cover, 6) if width else [THETA]
    edges = [arcs.centre + side * arcs.half for side in (-1.0, 0.0, 1.0)]
    some = rng.choice(np.concatenate(edges), 40)
    for theta in points:
        for w in np.clip(np.concatenate([rng.uniform(0, np.pi, 40), some, [0.0]]), 0, np.pi):
            (low, high), (left, right) = arcs.at(float(w))
            g = exact(theta, float(w))
            assert low <= abs(g) <= high
            turned = float(mpmath.arg(g))
            assert any(left <= turned + 2 * np.pi * k <= right for k in (-1, 0, 1))


def test_arcs_are_close_to_the_regions_at_their_centres() -> None:
    cover = box(2e-3, rows=4)
    arcs = regions(cover)
    families = families_of(MODEL.transfer(1, 1), MODEL.parameters)
    centres = [(w, 0.0) for w in arcs.centre.tolist()]
    points = arc_regions(cover, THETA, families, centres, Proposer)
    most = np.maximum(1.1 * points.radius, 2e-3 * points.gain)
    assert np.all(arcs.radius <= most) and len(arcs.centre) < 400


def test_cells_narrow_a_resonance() -> None:
    cover = box(0.04)  # pole radii from .927 to .97
    families = families_of(MODEL.transfer(1, 1), MODEL.parameters)
    whole = arc_regions(cover, THETA, families, [(0.57, 0.0)], Proposer)
    arcs = regions(cover)
    assert arcs.at(0.57)[0][1] < 0.5 * (whole.gain[0] + whole.radius[0])
    assert arcs.covers and np.isfinite(arcs.largest_gain)
    grid = np.concatenate([np.linspace(0.3, 1.0, 60), np.linspace(0, np.pi, 40)])
    top = 0.0
    for theta in members(cover, 12):
        for w in grid.tolist():
            gain = abs(exact(theta, w))
            low, high = arcs.at(w)[0]
            assert low <= gain <= high
            top = max(top, float(gain))
    assert arcs.least_peak <= top <= arcs.largest_gain < 6.0 * top


def test_regions_are_joined_about_the_points_of_the_first() -> None:
    """Two boxes of parameters apart from each other, each with a centre of its own."""
    families = families_of(MODEL.transfer(1, 1), MODEL.parameters)
    arcs, found, thetas = first_arcs(60), [], []
    for shift in (-0.05, 0.05):
        theta = THETA + shift
        ends = theta - 1e-3, theta + 1e-3
        cover = Cover(MODEL.parameters, *ends, np.zeros((0, 4)), np.zeros(0), True)
        found.append(arc_regions(cover, theta, families, arcs, Proposer))
        thetas += [ends[0], theta, ends[1]]
    for joined in (found[0].joined(found[1]), found[1].joined(found[0])):
        for theta in thetas:
            for w in np.linspace(0.0, np.pi, 120).tolist():
                assert joined.at(w)[0][0] <= abs(exact(theta, w)) <= joined.at(w)[0][1]
                assert inside(joined, theta, w)


def test_the_peak_and_the_distance_bound_every_member() -> None:
    cover = box(2e-3, rows=4)
    arcs = regions(cover)
    grid = np.linspace(0, np.pi, 3001)
    peaks, nearest = [], []
    for theta in members(cover, 30):
        g = frequency_response(MODEL, theta, grid, 1.0)
        peaks.append(np.abs(g).max())
        nearest.append(np.abs(g + 1.0).min())
    assert max(peaks) <= arcs.largest_gain < 1.3 * max(peaks)
    far = [np.abs(frequency_response(MODEL, THETA, grid, 1.0) - 30.0).min()]
    assert arcs.distance(-1.0) <= min(nearest)
    assert 0.7 * far[0] < arcs.distance(30.0) <= far[0]


def test_nothing_is_claimed_where_no_arc_is() -> None:
    arcs = regions(box(1e-3))
    kept = np.arange(len(arcs.centre)) != 5
    names = ("centre", "half", "turn", "gain", "slope", "rectangles")
    torn = replace(arcs, **{name: getattr(arcs, name)[kept] for name in names})
    assert arcs.covers and not torn.covers
    assert torn.largest_gain == np.inf and torn.distance(100.0) == 0.0
    gains, _ = torn.at(float(arcs.centre[5]))
    assert gains == (0.0, np.inf)


def test_a_pole_on_the_circle_leaves_the_arcs_about_it_open() -> None:
    theta = np.array([-2.0 * np.cos(1.0), 1.0, 0.5, 0.3])
    cover = Cover(MODEL.parameters, theta - 1e-3, theta + 1e-3, np.zeros((0, 4)), np.zeros(0), True)
    families = families_of(MODEL.transfer(1, 1), MODEL.parameters)
    arcs = refined_arcs(cover, theta, families, time.monotonic() + 20.0)
    assert arcs.at(1.0)[0] == (0.0, np.inf) and arcs.largest_gain == np.inf
    assert np.isfinite(arcs.at(2.0)[0]).all() and np.isfinite(arcs.at(0.3)[0]).all()


def inside(arcs: ArcRegions, theta: np.ndarray, w: float) -> bool:
    """Whether the rectangle at a frequency holds a response, real and imaginary part."""
    corners = arcs.corners(w)
    if not np.all(np.isfinite(corners)):
        return True
    off = complex(exact(theta, w)) - corners[0]
    sides = corners[1] - corners[0], corners[3] - corners[0]
    shares = [(off * np.conj(side)).real / abs(side) ** 2 for side in sides]
    return all(0.0 <= share <= 1.0 for share in shares)


@pytest.mark.parametrize("theta", [[-0.5, 0.3, 1.0, 0.2], [0.4, 0.1, -0.3, 1.0], THETA.tolist()])
def test_wide_arcs_hold_up_to_their_ends(theta: list[float]) -> None:
    point = np.array(theta)
    cover = Cover(MODEL.parameters, point, point, np.zeros((0, 4)), np.zeros(0), True)
    families = families_of(MODEL.transfer(1, 1), MODEL.parameters)
    for count in (5, 8, 13, 40):
        arcs = arc_regions(cover, point, families, first_arcs(count), Proposer)
        for centre, half in zip(arcs.centre.tolist(), arcs.half.tolist(), strict=True):
            for t in (-0.9999, -0.5, 0.3, 0.9999):
                assert inside(arcs, point, centre + t * half)


@pytest.mark.parametrize("half", [0.0, 1e-3, 0.1, 0.5])
def test_taylor_polynomials_are_off_by_their_remainders_at_most(half: float) -> None:
    """exp(-j (k - s) w) with 40 digits, beside its polynomial in t."""
    size, shift, centre = 6, 2.5, 1.2
    powers, rest, rounding = taylor(size, shift, [(centre, half)])
    for t in (-1.0, -0.3, 0.0, 0.7, 1.0):
        for k in range(size):
            with mpmath.workdps(40):
                w = mpmath.mpf(centre) + mpmath.mpf(half) * t
                value = mpmath.exp(mpmath.mpc(0, -1) * (k - mpmath.mpf(shift)) * w)
                terms = [mpmath.mpmathify(complex(c)) * mpmath.mpf(t) ** m
                         for m, c in enumerate(powers[0, :, k])]  # fmt: skip
                off = abs(value - sum(terms))
            assert off <= rest[0, k] + rounding[0, k]


def test_without_time_arcs_are_coarse_and_hold() -> None:
    cover = box(2e-3)
    arcs = regions(cover, -1.0)
    assert len(arcs.centre) == len(first_arcs()) and arcs.covers
    for w in np.linspace(0, np.pi, 50).tolist():
        assert arcs.at(w)[0][0] <= abs(exact(THETA, w)) <= arcs.at(w)[0][1]


def test_bands_are_proved_between_their_frequencies() -> None:
    result = second_order()
    band = setid.frequency_band(result, np.geomspace(0.05, 3.0, 8))
    omega = np.linspace(0.05, 3.0, 97)
    gains, phases = band.between(omega)
    g = frequency_response(result.formulation.model, PLANT, omega, 1.0)
    assert np.all((gains[:, 0] <= np.abs(g)) & (np.abs(g) <= gains[:, 1]))
    turned = np.angle(g * np.exp(-1j * phases.mean(axis=1)))
    assert np.all(np.abs(turned) <= np.ptp(phases, axis=1) / 2 + 1e-12)
    assert np.median(gains[:, 1] / gains[:, 0]) < 1.1
    grid = np.linspace(0.0, np.pi, 2001)
    top = np.abs(frequency_response(result.formulation.model, PLANT, grid, 1.0)).max()
    assert band.peak[0] <= top <= band.peak[1] < 1.1 * top
    assert band.distance(-1.0) <= np.abs(g + 1).min()


def test_sampled_bands_say_nothing_between() -> None:
    result = second_order()
    band = setid.frequency_band(result, [0.5, 1.0], kind="sampled", samples=5)
    with pytest.raises(setid.SetidError, match="between"):
        band.between([0.7])


@pytest.mark.parametrize("size", [1e-160, 1e-100, 1.0, 1e100, 1e160])
def test_distances_hold_whatever_the_unit_of_the_output(size: float) -> None:
    """On the arc the response is size (1 + t): 0 at its end, and size / 2 from -size / 2."""
    one, nothing = np.ones(1), np.zeros((1, 4))
    ends = 0.5 * np.pi * one, 0.5 * np.pi * one * (1 + 1e-9)
    found = ArcRegions(*ends, one + 0j, size * one, one + 0j, nothing)
    assert found.covers and found.distance(0j) == 0.0
    assert 0.499 * size <= found.distance(-0.5 * size) <= 0.5 * size
