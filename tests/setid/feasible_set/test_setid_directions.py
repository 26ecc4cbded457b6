"""Boxes from all rows together, where rows one by one bound nothing."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

import setid
import sparsepop_py as sp
from setid.feasible_set.start import find_box
from setid.formulation.units import coupled_rows
from setid.proofs.parameter_box import box_follows
from sparsepop_py.uncertain_rows import directions
from sparsepop_py.verified.uncertain_rows.directions import cubes

MODEL, NOISE = setid.TransferFunction(2, 1, 1), setid.Noise(output=0.35)
QUICK = setid.Options(time_limit=60.0, progress=False)


def boxed(known: setid.Formulation, first: setid.ParameterBox) -> setid.DirectionBox | None:
    assert known.smoothed is not None
    return directions.direction_box(known.smoothed, coupled_rows(known), first)


def verified(box: setid.DirectionBox, known: setid.Formulation, start: np.ndarray) -> bool:
    assert known.smoothed is not None
    return box.verify(known.smoothed, coupled_rows(known), start)


@cache
def case(seed: int) -> tuple[setid.Simulated, setid.Formulation, setid.ParameterBox]:
    """A short record with strong noise, and what its rows one by one say."""
    source = np.random.default_rng(seed)
    u = source.uniform(-1, 1, 10)
    truth = setid.simulate_record(MODEL, [-0.6, 0.3, 1.0], u, NOISE, source)
    known = setid.formulate(truth.data, MODEL, NOISE)
    first = setid.parameter_box(known.regression)
    assert np.all(np.isinf(first.upper))
    return truth, known, first


@cache
def bounded() -> setid.DirectionBox:
    truth, known, first = case(28)
    found = boxed(known, first)
    assert found is not None
    assert all(
        low <= value <= high
        for low, value, high in zip(found.lower, truth.theta.values(), found.upper, strict=True)
    )
    return found


def explained(data: setid.IOData, theta: np.ndarray, leading: float = 1.0) -> bool:
    """Whether noise within its bounds explains a record, by a linear program in the noise.

    With 0 for ``leading``: whether it does so along the direction theta.
    """
    y, u = data.y.ravel(), data.u.ravel()
    count = y.size
    rows = leading * np.eye(count)[2:] + theta[0] * np.eye(count)[1:-1]
    rows = rows + theta[1] * np.eye(count)[:-2]
    right = rows @ y - theta[2] * u[1:-1]
    bounds = [(-0.35, 0.35)] * count
    return bool(linprog(np.zeros(count), A_eq=rows, b_eq=right, bounds=bounds).status == 0)


def test_nothing_outside_the_box_is_explained() -> None:
    truth, box = case(28)[0], bounded()
    source = np.random.default_rng(0)
    assert explained(truth.data, np.array(list(truth.theta.values())))
    for _ in range(300):
        theta = source.uniform(-1, 1, 3) * 10.0 ** source.uniform(-0.2, 2)
        if np.any(theta < box.lower) or np.any(theta > box.upper):
            assert not explained(truth.data, theta)


def test_the_record_is_identified_and_verified() -> None:
    truth = case(28)[0]
    result = setid.identify(truth.data, MODEL, NOISE, options=QUICK)
    assert isinstance(result.box, setid.DirectionBox) and bool(result.verify(truth.data))
    assert result.status == "certified"
    for name, value in truth.theta.items():
        assert value in result.intervals[name]
        for witness in result.intervals[name].witnesses:
            assert witness is not None and explained(truth.data, witness[:3])
    other = setid.IOData(truth.data.u, truth.data.y * 1.01)
    assert not result.verify(other)


def test_damaged_proofs_are_refused() -> None:
    _, known, _ = case(28)
    box, start = bounded(), np.array([np.full(3, -np.inf), np.full(3, np.inf)])
    assert verified(box, known, start) and box_follows(box, known)
    tighter = replace(box, upper=box.upper - 0.05)
    swapped = replace(box, certificates=box.certificates[::-1])
    fewer = replace(box, certificates=box.certificates[1:])
    shrunk = replace(box, scale=box.scale / 4.0)
    rounded = replace(box, scale=box.scale * 1.1)  # rows in these units are not the exact ones
    short = replace(box, scale=box.scale[:1])
    other = replace(box, rows=(1,) * 6)  # the certificates are about more rows than that
    uncounted = replace(box, rows=(0,) * 6)
    for wrong in (tighter, swapped, fewer, shrunk, rounded, short, other, uncounted):
        assert not verified(wrong, known, start)
        assert not box_follows(wrong, known)


def test_a_prior_does_not_leave_out_what_all_rows_say() -> None:
    """Bounds far away make the box of rows one by one finite, and ten times as wide."""
    truth, free = case(28)[0], bounded()
    prior = setid.Box(dict.fromkeys(MODEL.parameters, (-50.0, 50.0)))
    known = setid.formulate(truth.data, MODEL, NOISE, prior)
    box = find_box(known)
    assert box is not None and box_follows(box, known)
    assert np.all(box.upper - box.lower <= 1.1 * (free.upper - free.lower))
    for low, value, high in zip(box.lower, truth.theta.values(), box.upper, strict=True):
        assert low <= value <= high


def test_a_prior_that_tells_nothing_more_costs_no_proof() -> None:
    truth = case(24)[0]  # unbounded without a prior
    prior = setid.Box(dict.fromkeys(MODEL.parameters, (-5.0, 5.0)))
    box = find_box(setid.formulate(truth.data, MODEL, NOISE, prior))
    assert isinstance(box, setid.ParameterBox) and not box.empty


def test_without_a_limit_no_clock_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine on which an hour passes between two looks at the clock."""
    _, known, first = case(28)
    hours = SimpleNamespace(monotonic=partial(next, itertools.count(0.0, 3600.0)))
    monkeypatch.setattr(directions, "time", hours)
    found, again = boxed(known, first), bounded()
    assert found is not None
    assert np.array_equal(found.lower, again.lower) and np.array_equal(found.upper, again.upper)


def long_record() -> tuple[setid.Simulated, setid.Formulation, setid.ParameterBox]:
    """118 rows with errors of 40 %, which leave no bounds row by row."""
    source = np.random.default_rng(2)
    u, model = source.uniform(-1, 1, 120), setid.TransferFunction(2, 2, 1)
    theta = (-1.2, 0.5, 1.0, 0.5)
    noise = setid.Noise(output=0.4 * float(np.abs(setid.simulate(model, theta, u)).max()))
    truth = setid.simulate_record(model, theta, u, noise, source)
    known = setid.formulate(truth.data, model, noise)
    first = setid.parameter_box(known.smoothed, np.array([np.full(4, -np.inf), np.full(4, np.inf)]))
    assert np.any(np.isinf([first.lower, first.upper]))
    return truth, known, first


@pytest.mark.slow
def test_the_first_rows_of_a_long_record_are_enough() -> None:
    truth, known, first = long_record()
    box = boxed(known, first)
    assert box is not None and set(box.rows) == {80}
    start = np.array([np.full(4, -np.inf), np.full(4, np.inf)])
    assert np.all(np.isfinite([box.lower, box.upper])) and verified(box, known, start)
    theta = np.array(list(truth.theta.values()))
    assert np.all((box.lower <= theta) & (theta <= box.upper))


def test_negative_units_do_not_turn_a_box_into_an_empty_one() -> None:
    _, known, _ = case(28)
    box, start = bounded(), np.array([np.full(3, -np.inf), np.full(3, np.inf)])
    scale, empty = -box.scale, (np.full(3, 1e-3), np.full(3, -1e-3))
    cube = cubes(coupled_rows(known), box.first, scale)(box.rows[0])
    sides = [directions._least(cube.side(number), np.inf) for number in range(6)]
    proofs = tuple(proof for proof in sides if proof is not None)
    assert len(proofs) == 6  # all that a box asks for
    last = setid.ParameterBox(box.names, *empty, start, ())
    forged = setid.DirectionBox(box.names, *empty, box.first, scale, proofs, box.rows, last)
    assert forged.empty and not verified(forged, known, start)


@pytest.mark.parametrize("seed", [24, 33])
def test_no_box_is_claimed_where_a_direction_is_explained(seed: int) -> None:
    truth, known, first = case(seed)
    assert boxed(known, first) is None
    source = np.random.default_rng(0)
    assert any(explained(truth.data, source.uniform(-1, 1, 3), 0.0) for _ in range(3000))


def test_an_interrupt_claims_no_box(monkeypatch: pytest.MonkeyPatch) -> None:
    _, known, first = case(28)

    def stopped(*given: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("sparsepop_py.uncertain_rows.directions._least", stopped)
    assert boxed(known, first) is None


@pytest.mark.parametrize("record", [lambda: case(28), long_record])
def test_an_interrupted_side_is_not_begun_again(
    monkeypatch: pytest.MonkeyPatch, record: Callable[[], Any]
) -> None:
    _, known, first = record()
    solve, calls = sp.solve, []

    def interrupted(problem: sp.Problem, options: sp.Options) -> sp.Result:
        calls.append(problem)
        stopped = solve(problem, replace(options, time_limit=1e-3))
        notes = ("interrupted: what is proved so far is kept",)
        return replace(stopped, status=sp.Status.LIMIT, certificate=None, notes=notes)

    monkeypatch.setattr(directions, "solve", interrupted)
    assert boxed(known, first) is None and len(calls) == 1
