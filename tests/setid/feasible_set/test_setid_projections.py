"""Projections of the feasible parameter set on two parameters."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from identification_cases import PLANT, laboratory_two_first
from identified_cases import empty, first_order, identified, second_order

import setid
from setid.feasible_points.members import members
from setid.feasible_set import projections
from setid.feasible_set.projections import Projection, project

# Vertices of the polygon of the first laboratory: exact intersections of its half planes.
VERTICES = [
    [-0.345333, 1.916667],
    [-0.505333, 1.916667],
    [-0.523256, 1.972674],
    [-0.406977, 2.109302],
]


def test_the_polygon_of_the_first_laboratory_is_exact() -> None:
    shadow = project(first_order(), "a1", "b0")
    assert shadow.exact and len(shadow.outline) == 4
    for vertex in VERTICES:
        assert np.abs(shadow.outline - vertex).max(axis=1).min() < 1e-6
    x, y = np.array(VERTICES).T
    shoelace = abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    assert shadow.area == pytest.approx(shoelace, abs=1e-6)


def test_the_truth_on_the_boundary_is_kept() -> None:
    shadow = project(first_order(), "a1", "b0")
    assert np.all(shadow.directions @ [-0.5, 2.0] <= shadow.heights)


def test_a_projection_of_five_parameters_holds_all_members() -> None:
    result = second_order()
    shadow = project(result, "a1", "b1")
    assert shadow.exact
    pairs = np.vstack([PLANT, members(result, 40)])[:, [0, 3]]
    slack = 1e-7 * np.abs(shadow.directions).sum(axis=1)
    assert np.all(pairs @ shadow.directions.T <= shadow.heights + slack)
    assert np.all(outside(shadow, pairs) < 1e-6)
    box = np.prod([result.intervals[n].width for n in ("a1", "b1")])
    assert shadow.area < 0.9 * box


def outside(shadow: Projection, pairs: np.ndarray) -> np.ndarray:
    """How far pairs lie beyond the drawn edges, as a share of the outline's size."""
    corners, size = shadow.outline, np.ptp(shadow.outline, axis=0)
    along = (np.roll(corners, -1, axis=0) - corners) / size
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.hypot(*along.T)[:, None]
    steps = (pairs[:, None, :] - corners[None, :, :]) / size
    return np.einsum("pej,ej->pe", steps, normal).max(axis=1)


@pytest.mark.parametrize("pair", [("a1", "b0"), ("a2", "b2"), ("b0", "b1"), ("b1", "b2")])
def test_the_drawn_outline_holds_all_members(pair: tuple[str, str]) -> None:
    result = second_order()
    shadow = project(result, *pair)
    places = [result.formulation.parameters.index(name) for name in pair]
    assert np.all(outside(shadow, members(result, 20)[:, places]) < 1e-6)
    ends = np.array([result.intervals[name].outer for name in pair])
    assert np.allclose(shadow.outline.min(axis=0), ends[:, 0], atol=1e-5 * np.ptp(ends))
    assert np.allclose(shadow.outline.max(axis=0), ends[:, 1], atol=1e-5 * np.ptp(ends))


def test_the_exact_outline_is_the_limit_of_many_directions() -> None:
    result = second_order()
    shadow = project(result, "a1", "a2")
    angles = np.linspace(0, 2 * np.pi, 50)
    width = np.array([result.intervals[n].width for n in ("a1", "a2")])
    from setid.feasible_set.supports import cover_of, supports

    for angle in angles:
        normal = np.array([np.cos(angle), np.sin(angle)]) / width
        high = supports(cover_of(result), np.append(normal, np.zeros(3)))[0, 1]
        assert (shadow.outline @ normal).max() == pytest.approx(high, abs=1e-5)


def output_errors(bound: float) -> setid.Identification:
    """Outer intervals [-.7, -.2] and [1.7, 2.4] of a record that needs an output noise of .2922."""
    model, noise = setid.TransferFunction(1, 1), setid.Noise(output=bound)
    formulation = setid.formulate(laboratory_two_first(), model, noise)
    return identified(formulation, [(-0.7, -0.2), (1.7, 2.4)])


@pytest.mark.slow
def test_output_errors_are_covered() -> None:
    result = output_errors(0.4)
    shadow = project(result, "a1", "b0", directions=8)
    assert not shadow.exact and len(shadow.directions) == 12
    grid = [(a1, b0) for a1 in np.linspace(-0.7, -0.2, 11) for b0 in np.linspace(1.7, 2.4, 15)]
    formulation = result.formulation
    held = [pair for pair in grid if setid.least_noise(formulation, pair).level <= 1.0]
    assert len(held) > 3
    assert np.all(np.array(held) @ shadow.directions.T <= shadow.heights + 1e-9)


def test_a_set_that_proves_empty_is_not_drawn() -> None:
    with pytest.raises(setid.SetidError, match="now proved empty"):
        project(output_errors(0.2), "a1", "b0", directions=4)


def test_bad_arguments() -> None:
    result = first_order()
    with pytest.raises(setid.SetidError, match="found 'b7', expected 'a1' or 'b0'"):
        project(result, "a1", "b7")
    with pytest.raises(setid.SetidError, match=r"name: found array\(\[1, 2\]\), expected 'a1'"):
        project(result, np.array([1, 2]), "b0")  # type: ignore[arg-type]
    with pytest.raises(setid.SetidError, match="twice"):
        project(result, "a1", "a1")
    with pytest.raises(setid.SetidError, match="directions"):
        project(result, "a1", "b0", directions=2)
    with pytest.raises(setid.SetidError, match="empty"):
        project(empty(result.formulation), "a1", "b0")
    endless = identified(result.formulation, [(-np.inf, 0.0), (1.0, 3.0)])
    with pytest.raises(setid.SetidError, match="finite"):
        project(endless, "a1", "b0")


def test_sets_as_thin_as_rounding_have_an_outline(monkeypatch: pytest.MonkeyPatch) -> None:
    """A linear program that finds no point says nothing of a set that is not empty."""
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    unsolved = SimpleNamespace(status="infeasible", x=None)
    monkeypatch.setattr(projections, "solve_scaled", lambda *_: unsolved)
    found = setid.project(result, "a1", "b0")
    assert not found.exact and len(found.outline) > 3
    x = np.array([-0.45, 2.0])  # satisfies the rows of the record
    assert np.all(found.directions @ x <= found.heights)
