"""Covers that are narrowed by proved ranges of chosen functions, in parameters and in sums."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from identified_cases import identified, second_order

import setid
import sparsepop_py as sp
from setid.feasible_points.members import members
from setid.feasible_set import narrowing
from setid.feasible_set.coordinates import (
    Coordinates,
    asked_of,
    coordinates_of,
    parameter_coordinates,
)
from setid.feasible_set.narrowing import Narrowing, narrowing_of, solved_heights
from setid.feasible_set.supports import cover_of
from setid.formulation.units import in_units

TRUTH = np.array([-1.5, 0.7, 0.5, 0.25])
AXES = np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0], [1.0, -1.0, 0.0, 0.0]])
TWO = np.array([-0.7, -0.4, 0.5, 0.3])


@pytest.fixture(scope="module")
def result() -> setid.Identification:
    """Output noise of 5 % of the static gain, 30 samples."""
    model, noise = setid.TransferFunction(na=2, nb=2, nk=1), setid.Noise(output=0.05)
    u = np.repeat(np.sign(np.random.default_rng(0).standard_normal(10)), 3)
    truth = setid.simulate_record(model, TRUTH, u, noise, 1)
    return setid.identify(truth.data, model, noise, options=setid.Options(time_limit=20.0))


def two_inputs(form: Any = "auto") -> setid.Identification:
    """A sum of two systems of order 1, on a box about the truth."""
    model = setid.TransferFunction(1, 1, nk=1, inputs=2, form=form)
    u, noise = np.random.default_rng(0).uniform(-1, 1, (30, 2)), setid.Noise(output=0.02)
    truth = setid.simulate_record(model, TWO, u, noise)
    ends = [(t - 0.02, t + 0.02) for t in TWO.tolist()]
    return on_its_box(identified(setid.formulate(truth.data, model, noise), ends))


def on_its_box(found: setid.Identification) -> setid.Identification:
    """State the problem on the box of the intervals, as results do."""
    p, problem = len(found.intervals), found.problem
    lower, upper = problem.lower.copy(), problem.upper.copy()
    lower[:p], upper[:p] = found.outer_box
    rows = problem.constraints
    return replace(found, problem=sp.Problem(problem.objective, rows, lower, upper))


def fresh(result: setid.FeasibleSet, coordinates: Coordinates | None = None) -> Narrowing:
    coordinates = coordinates or parameter_coordinates(result)
    none = np.zeros((0, len(result.formulation.parameters)))
    return Narrowing(result, coordinates, coordinates.cover(result), none)


def test_narrowed_covers_hold_the_truth_and_all_members(result: setid.Identification) -> None:
    asked, plain = fresh(result), len(cover_of(result).right)
    wide = asked.excess(AXES, 0.1)
    assert asked.narrow(AXES, np.ones(3), time.monotonic() + 60.0)
    cover = asked.cover
    assert len(cover.right) == plain + 6 and np.all(asked.excess(AXES, 0.1) <= wide)
    assert asked.excess(AXES, 0.1)[0] < 0.5 * wide[0]
    assert np.all(cover.matrix @ TRUTH <= cover.right)
    known = np.concatenate([members(result, 20), asked.points])
    slack = 1e-9 * (np.abs(known) @ np.abs(cover.matrix.T) + np.abs(cover.right))
    assert np.all(known @ cover.matrix.T <= cover.right + slack)


def test_time_that_ends_after_it_was_looked_at_is_no_limit_of_zero_seconds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The limit is one second when the clock is read first, and has passed at each later look."""
    limits = []

    def solved(_: Any, directions: Any, options: sp.Options, *__: Any) -> Any:
        limits.append(options.time_limit)
        return np.zeros(len(directions)), np.zeros((0, 4))

    readings = iter([5.0])
    monkeypatch.setattr(narrowing, "solved_heights", solved)
    monkeypatch.setattr(narrowing.time, "monotonic", lambda: next(readings, 7.0))
    asked = fresh(two_inputs())
    readings = iter([5.0])
    assert asked.narrow(AXES[:1], np.ones(1), 6.0) and limits == [1.0]
    assert not asked.narrow(AXES[:1], np.ones(1), 6.0)


def test_functions_are_asked_again_more_closely_and_then_no_more(
    result: setid.Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    gaps = list[float]()

    def loose(result: Any, directions: Any, options: sp.Options, coordinates: Any) -> Any:
        gaps.append(options.gap)
        return np.full(len(directions), np.inf), np.zeros((0, 4))

    monkeypatch.setattr(narrowing, "solved_heights", loose)
    asked, later = fresh(result), time.monotonic() + 60.0
    while asked.narrow(AXES[:1], np.ones(1), later):
        pass
    assert gaps == [0.5, 0.125, 0.03125]
    assert not asked.narrow(AXES, np.array([1.0, -1.0, 0.0]), later)  # the others are narrow
    assert not asked.narrow(AXES, np.ones(3), time.monotonic() - 1.0)  # no time is left
    assert asked.narrow(AXES, np.ones(3), later) and gaps[-1] == 0.5
    assert not asked.narrow(0.0 * AXES, np.ones(3), later)


def test_gaps_that_time_ended_are_asked_again(
    result: setid.Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    gaps = list[float]()

    def slow(result: Any, directions: Any, options: sp.Options, coordinates: Any) -> Any:
        gaps.append(options.gap)
        time.sleep(0.05)
        return np.full(len(directions), np.inf), np.zeros((0, 4))

    monkeypatch.setattr(narrowing, "solved_heights", slow)
    asked = fresh(result)
    for _ in range(3):
        assert asked.narrow(AXES[:1], np.ones(1), time.monotonic() + 0.01)
    assert gaps == [0.5, 0.5, 0.5]


def test_functions_that_are_chosen_together_differ() -> None:
    """Of two that are nearly the same one is asked about, and the third one instead."""
    functions = np.array([[1.0, 0.0], [1.0, 1e-9], [0.0, 1.0]])
    asked = fresh(second_order(samples=40))
    asked.cover = replace(asked.cover, lower=np.zeros(2), upper=np.ones(2))
    assert asked._chosen(functions, np.array([3.0, 2.9, 0.1])) == [0, 2]


def test_what_was_asked_is_kept_for_the_next_question(result: setid.Identification) -> None:
    asked = narrowing_of(result, parameter_coordinates(result))
    asked.narrow(AXES, np.ones(3), time.monotonic() + 60.0)
    rows = len(asked.cover.right)
    assert len(narrowing_of(result, parameter_coordinates(result)).cover.right) == rows


@pytest.mark.slow
def test_bands_of_output_errors_are_narrow(result: setid.Identification) -> None:
    band = setid.step_band(result, 40)
    assert band.report is not None and band.report.ratio < 1.5
    true = setid.simulate(result.formulation.model, TRUTH, np.ones(40)).ravel()
    assert np.all((true >= band.low) & (true <= band.high))


def test_a_set_that_is_proved_empty_meanwhile_is_named() -> None:
    """The box excludes the truth, and the result does not know that."""
    model, noise = setid.TransferFunction(1, 1, nk=1), setid.Noise(output=0.01)
    truth = setid.simulate_record(model, [-0.5, 1.0], np.cos(np.arange(20.0)), noise)
    formulation = setid.formulate(truth.data, model, noise)
    found = on_its_box(identified(formulation, [(0.3, 0.4), (0.9, 1.1)]))
    with pytest.raises(setid.SetidError, match="identify the record again"):
        solved_heights(found, np.eye(2), sp.Options(time_limit=10.0))
    for kind in (None, "proved"):  # no band of a set without members
        with pytest.raises(setid.SetidError, match="identify the record again|proved empty"):
            setid.simulate_band(found, kind=kind)


# ---- sums -------------------------------------------------------------------------------


def test_coordinates_are_those_of_the_equations() -> None:
    """(1 + a)(1 + a') y = (1 + a') b u + (1 + a) b' u': sums a + a', a a', a' b, a b'."""
    coordinates = coordinates_of(two_inputs().formulation.model)
    a, c, b, d = TWO
    assert coordinates.values(TWO)[4:] == pytest.approx([a + c, a * c, c * b, a * d])
    assert coordinates.values(np.stack([TWO, 2 * TWO]))[1, 5] == pytest.approx(4 * a * c)
    assert coordinates_of(setid.TransferFunction(1, 1)).sums == ()


def test_sums_that_are_no_unknowns_are_not_asked() -> None:
    """An offset of the equation is another parameter than one of the output."""
    model = setid.TransferFunction(1, 1, nk=1, inputs=2, form="direct", offset=True)
    u, noise = np.random.default_rng(0).uniform(-1, 1, (30, 2)), setid.Noise(output=0.02)
    truth = setid.simulate_record(model, [*TWO, 0.1], u, noise)
    ends = [(t - 0.02, t + 0.02) for t in [*TWO.tolist(), 0.1]]
    found = on_its_box(identified(setid.formulate(truth.data, model, noise), ends))
    coordinates = coordinates_of(model)
    asked, later = fresh(found, coordinates), time.monotonic() + 60.0
    functions = np.eye(len(coordinates.names))[[6]]
    assert not asked.narrow(functions, np.ones(1), later)
    assert asked_of(found, coordinates)[0] is found  # not the set of the other offset
    heights, _ = solved_heights(found, functions, sp.Options(time_limit=5.0), coordinates)
    assert heights.tolist() == [np.inf]


@pytest.mark.parametrize("form", ["auto", "partial", "lifted", "multiplied", "direct"])
def test_heights_of_sums_hold_whatever_the_form(form: Any) -> None:
    found = two_inputs(form)
    coordinates = coordinates_of(found.formulation.model)
    directions = np.concatenate([np.eye(8)[[0, 5]], -np.eye(8)[[0, 5]]])
    options = replace(found.options.for_engine(), gap=0.3, gap_kind="width", time_limit=20.0)
    heights, points = solved_heights(found, directions, options, coordinates)
    assert points.shape[1] == 4
    assert np.all(directions @ coordinates.values(TWO) <= heights)
    assert heights[1] + heights[3] < np.ptp([0.72 * 0.42, 0.68 * 0.38])


def test_drawing_members_ends_with_its_time(result: setid.Identification) -> None:
    """Attained vectors need no time; no mixture is tried after it."""
    result = replace(result)  # of which no mixture was tried before
    known = members(result, 0)
    assert np.array_equal(members(result, 10**5, time_limit=0.0), known)
    assert len(members(result, 50, time_limit=60.0)) > len(known)
    with pytest.raises(setid.SetidError, match="time_limit"):
        members(result, 5, time_limit=float("nan"))


def test_heights_are_lower_bounds_in_the_units_of_the_parameters(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The engine's problem has other units; b is large where inputs are tiny."""
    model, noise = setid.TransferFunction(1, 1, nk=1), setid.Noise(output=0.1)
    u = 2.0**-20 * np.cos(np.arange(20.0))
    truth = setid.simulate_record(model, [-0.5, 2.0**20], u, noise)
    ends = [(-0.6, -0.4), (0.9 * 2.0**20, 1.1 * 2.0**20)]
    found = on_its_box(identified(setid.formulate(truth.data, model, noise), ends))
    scaled = in_units(found.problem, found.formulation)
    factor = scaled.asked(-1.0 * found.formulation.layout.polynomial(1))[1]

    class Bounded:
        lower_bound, upper_bound, attained = -3.0, -1.0, None

    monkeypatch.setattr(sp, "solve_each", lambda problem, asked, options: [Bounded()] * len(asked))
    heights, _ = solved_heights(found, np.array([[0.0, 1.0]]), sp.Options())
    assert factor != 1.0 and heights[0] >= 3.0 * factor
    assert heights[0] == pytest.approx(3.0 * factor)
