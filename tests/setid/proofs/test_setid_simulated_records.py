"""Long records of noisy outputs as simulations from unknown first samples."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest
from slow_values import slow_after

import setid
from setid.bounding import engine, long_records, simulations
from setid.feasible_points.cascades import box_near_ends, simulated_ends
from setid.feasible_set.start import find_box
from setid.proofs.parameter_box import box_follows, start_of
from setid.proofs.simulated.forms import Region
from setid.proofs.simulated.outputs import half_spaces, recursion_of
from setid.proofs.simulated.tree import Step, TreeNode
from setid.result.json_parts import read, write
from sparsepop_py.budget import Deadline

MODEL = setid.TransferFunction(2, 2, nk=2)  # rows from sample 3 on; they rest on samples 1 and 2
TRUTH = (-1.2, 0.5, 0.8, -0.3)
BOUND = 0.005


def exact_outputs(theta, first, u) -> list[Fraction]:
    """y of y(k) = -a1 y(k-1) - a2 y(k-2) + b2 u(k-2) + b3 u(k-3) in rationals."""
    a1, a2, b2, b3 = (Fraction(float(v)) for v in theta)
    y = [Fraction(0), *(Fraction(float(v)) for v in first)]
    v = [Fraction(float(value)) for value in u]
    for k in range(3, len(v)):
        y.append(-a1 * y[k - 1] - a2 * y[k - 2] + b2 * v[k - 2] + b3 * v[k - 3])
    return y


def record(samples: int = 40, seed: int = 0) -> setid.IOData:
    random = np.random.default_rng(seed)
    u = random.uniform(-1.0, 1.0, samples)
    y = np.array([float(v) for v in exact_outputs(TRUTH, (0.1, -0.2), u)])
    return setid.IOData(u, y + BOUND * random.uniform(-1.0, 1.0, samples))


def formulated(data: setid.IOData, model=MODEL, **noise):
    return setid.formulate(data, model, setid.Noise(**(noise or {"output": BOUND})))


def test_first_samples_are_unknowns_within_their_readings() -> None:
    data = record()
    parts = recursion_of(formulated(data))
    lower, upper = parts.box(np.zeros(4), np.ones(4))
    assert parts.dimension == 6
    assert lower[4:] == pytest.approx(data.y[1:3, 0] - BOUND)
    assert upper[4:] == pytest.approx(data.y[1:3, 0] + BOUND)
    assert np.all(lower[4:] < data.y[1:3, 0] - BOUND)  # rounded outwards
    assert np.all(upper[4:] > data.y[1:3, 0] + BOUND)


@pytest.mark.parametrize("radius", [0.0, 1e-6, 0.01])
def test_exact_outputs_lie_within_the_forms(radius: float) -> None:
    data = record(25)
    parts, middle = recursion_of(formulated(data)), np.array([*TRUTH, 0.1, -0.2])
    nothing = np.zeros((0, 6))
    region = Region(middle - radius, middle + radius, nothing, np.zeros(0), np.zeros(0))
    form, random = parts.run(region)["y1"], np.random.default_rng(0)
    assert np.isinf(form.rest[0])  # no equation asks for the first sample
    assert np.all(form.rest[1:3] == 0.0)
    for x in [region.lower, region.upper, *random.uniform(region.lower, region.upper, (8, 6))]:
        for k, exact in enumerate(exact_outputs(x[:4], x[4:], data.u[:, 0])):
            linear = Fraction(float(form.value[k]))
            for slope, t, m in zip(form.slope[k], x, region.middle, strict=True):
                linear += Fraction(float(slope)) * (Fraction(float(t)) - Fraction(float(m)))
            assert k == 0 or abs(exact - linear) <= Fraction(float(form.rest[k]))
    assert np.max(form.rest[1:]) < 120 * radius**2 + 1e-13


def test_rows_keep_every_consistent_vector_and_none_speaks_of_sample_zero() -> None:
    data = record()
    known = formulated(data)
    parts, middle = recursion_of(known), np.array([*TRUTH, 0.1, -0.2])
    nothing = np.zeros((0, 6))
    region = Region(middle - 0.01, middle + 0.02, nothing, np.zeros(0), np.zeros(0))
    rows = half_spaces(known, parts, region)
    assert np.all(rows.matrix @ middle <= rows.right)
    other = data.y.copy()
    other[0] += 1.0
    again = half_spaces(formulated(setid.IOData(data.u, other)), parts, region)
    assert np.array_equal(again.right[: 2 * 39], rows.right[: 2 * 39])


def test_what_is_no_simulation_from_readings() -> None:
    data = record()
    assert recursion_of(formulated(data, output=BOUND, input=0.01)) is None
    assert recursion_of(formulated(data, output=BOUND, equation=0.01)) is None
    y = data.y.copy()
    y[7] = np.nan
    assert recursion_of(formulated(setid.IOData(data.u, y))) is None
    rest = setid.TransferFunction(2, 2, nk=2, initial="zero")
    assert recursion_of(formulated(setid.IOData(data.u, y), rest)).dimension == 4


@pytest.mark.parametrize(
    ("model", "priors", "wide", "samples", "fast"),
    [
        (MODEL, (), 100, 260, True),
        (MODEL, (), 200, 260, False),
        (MODEL, (setid.Stable(),), 100, 260, False),
        (setid.TransferFunction(3, 2, 1), (), 100, 260, False),
        (MODEL, (), 100, 1100, False),
    ],
    ids=["short", "wide box", "stable", "order 3", "long"],
)
def test_cones_are_for_what_takes_the_engine_longer(model, priors, wide, samples, fast) -> None:
    """A box that is so many times as wide as what is attained; one bound alone is enough."""
    known = setid.formulate(record(samples), model, setid.Noise(output=BOUND), priors)
    count = len(known.parameters)
    reached = SimpleNamespace(ends=np.array([np.zeros(count), np.ones(count)]))
    upper = np.full(count, 100.0)
    upper[-1] = wide
    box = SimpleNamespace(lower=np.zeros(count), upper=upper)
    assert simulations._engine_is_faster(known, reached, box) is fast
    assert not simulations._engine_is_faster(known, reached, None)


@pytest.fixture(scope="module")
def found() -> setid.Identification:
    """By simulations and the engine alone."""
    options = setid.Options(tol=0.05, time_limit=60.0, progress=False)
    with mock.patch("setid.bounding.simulations.denominator_box", return_value=None):
        return setid.identify(record(260), MODEL, setid.Noise(output=BOUND), options=options)


def test_a_record_is_closed_and_keeps_the_truth(found: setid.Identification) -> None:
    for value, item in zip(TRUTH, found.intervals.values(), strict=True):
        assert item.outer[0] <= value <= item.outer[1]
        assert str(item.status) == "certified"
    assert found.verify().ok


def noisy(samples: int = 130, bound: float = 0.05) -> setid.IOData:
    """Ten times the noise: rows over the first region alone close no end."""
    random = np.random.default_rng(5)
    u = random.uniform(-1.0, 1.0, samples)
    y = np.array([float(v) for v in exact_outputs(TRUTH, (0.1, -0.2), u)])
    return setid.IOData(u, y + bound * random.uniform(-1.0, 1.0, samples))


def test_regions_are_split_only_where_the_first_one_reaches_near_the_attained_ends() -> None:
    known = formulated(noisy(), output=0.05)
    box, parts = find_box(known), recursion_of(known)
    reached = simulated_ends(known, parts, box, Deadline(60.0))
    leaves = [
        box_near_ends(reached, box, 1e-3, Deadline(60.0), 3, near).leaves for near in (0.0, np.inf)
    ]
    assert leaves[0] == 1 < leaves[1]


@pytest.mark.parametrize("split", slow_after(1, [True, False]))
def test_the_engine_closes_what_regions_leave_open(monkeypatch, split: bool) -> None:
    """Records count as long here, and as the longest, from 60 equations on."""
    monkeypatch.setattr(long_records, "_MANY", 60)
    monkeypatch.setattr(engine, "_LONG", 60)
    monkeypatch.setattr(simulations, "_MOST_REGIONS", 3)
    monkeypatch.setattr(simulations, "_NEAR_ENDS", np.inf)
    monkeypatch.setattr(simulations, "_MANY_EQUATIONS", 60 if split else 1000)
    monkeypatch.setattr(simulations, "denominator_box", lambda *given: None)
    options = setid.Options(tol=0.05, time_limit=60.0, progress=False)
    found = setid.identify(noisy(80), MODEL, setid.Noise(output=0.05), options=options)
    assert (found.box.leaves > 1) == split
    for value, item in zip(TRUTH, found.intervals.values(), strict=True):
        assert item.outer[0] <= value <= item.outer[1]
        assert str(item.status) == "certified"
    assert found.verify().ok


def test_ends_are_attained_by_simulations(found: setid.Identification) -> None:
    """Each attained parameter vector, with some first samples, stays within the bounds."""
    data = record(260)
    for item in found.intervals.values():
        for place, theta in enumerate(item.witnesses):
            assert theta is not None
            theta = theta[:4]
            number = list(found.intervals).index(item.name)
            assert theta[number] == pytest.approx(item.inner[place], abs=1e-9)
            u = data.u[:, 0]
            zero = np.array([float(v) for v in exact_outputs(theta, (0, 0), u)])
            one = np.array([float(v) for v in exact_outputs(theta, (1, 0), u)]) - zero
            two = np.array([float(v) for v in exact_outputs(theta, (0, 1), u)]) - zero
            table = np.column_stack([one, two])[1:]
            error = data.y[1:, 0] - zero[1:]
            first = chebyshev(table, error)
            assert np.max(np.abs(error - table @ first)) <= BOUND * (1 + 1e-9)


def chebyshev(table: np.ndarray, target: np.ndarray) -> np.ndarray:
    """The x with the least largest abs(target - table x), by a linear program of scipy."""
    from scipy.optimize import linprog

    ones = np.ones((target.size, 1))
    rows = np.block([[table, -ones], [-table, -ones]])
    sides = np.concatenate([target, -target])
    cost = np.append(np.zeros(table.shape[1]), 1.0)
    bounds = [(None, None)] * table.shape[1] + [(0, None)]
    return linprog(cost, rows, sides, bounds=bounds).x[:-1]


def test_boxes_go_through_files_and_forged_ones_do_not_follow(found) -> None:
    known, box = found.formulation, found.box
    assert box_follows(box, known)
    again = read(write(box))
    assert box_follows(again, known)
    width, wide = box.upper - box.lower, box.first.upper - box.first.lower
    for forged in (
        replace(box, lower=box.lower + 0.3 * width),
        replace(box, upper=box.upper - 0.3 * width),
        replace(box, nodes=(TreeNode(),)),
        replace(box, first=None),
        replace(box, first=replace(box.first, upper=box.first.upper - 0.9 * wide)),
        replace(box, directions=box.directions[:, :4]),
    ):
        assert not box_follows(forged, known)
    heavy = tuple(Step(s.rows, 3.0 * s.weights) for s in box.nodes[0].steps)
    assert not box_follows(replace(box, nodes=(replace(box.nodes[0], steps=heavy),)), known)
    low, high = start_of(known)
    assert np.all(low < box.lower) and np.all(box.upper < high)
