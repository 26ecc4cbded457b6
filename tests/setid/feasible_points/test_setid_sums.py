"""Ends of records whose rows hold sums of products, by simulations in the parameters alone."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

import setid
import sparsepop_py as sp
from setid.bounding.starts import starts_of_engine
from setid.feasible_points.members import noise_level
from setid.feasible_points.simulations import Fitting
from setid.feasible_points.start import first_point
from setid.feasible_points.sums import ends_of_long_record, sums_recursion
from setid.formulation.units import in_units
from setid.models.lti import Form
from setid.simulation.responses import run
from sparsepop_py.budget import Deadline

THETA = np.array([-0.7, -0.4, 0.5, 0.3])
QUICK = setid.Options(time_limit=30.0, progress=False)


def record(
    samples: int, noise: float, offset: bool = False, form: Form = "lifted"
) -> setid.Formulation:
    model = setid.TransferFunction(1, 1, nk=1, inputs=2, offset=offset, form=form)
    theta = np.append(THETA, 0.7) if offset else THETA
    u = np.random.default_rng(1).uniform(-1, 1, (samples, 2))
    bound = setid.Noise(output=noise)
    plain = setid.TransferFunction(1, 1, nk=1, inputs=2, offset=offset)
    truth = setid.simulate_record(plain, theta, u, bound, 1)
    return setid.formulate(truth.data, model, bound, [setid.Stable()])


def on_box(formulation: setid.Formulation, width: float) -> sp.Problem:
    problem, p = formulation.problem, len(formulation.parameters)
    centre = np.append(THETA, 0.7)[:p]
    lower, upper = problem.lower.copy(), problem.upper.copy()
    lower[:p], upper[:p] = centre - width, centre + width
    return sp.Problem(problem.objective, problem.constraints, lower, upper)


@pytest.mark.parametrize("form", ["lifted", "driven"])
def test_simulations_are_those_of_the_structure(form: Form) -> None:
    """From the first readings on, with slopes that differences confirm."""
    formulation = record(40, 0.05, True, form)
    parts = sums_recursion(formulation)
    assert parts is not None and parts.dimension == 5 + 2
    x = np.concatenate([THETA, [0.7], formulation.data.y[:2, 0]])
    lower, upper = parts.box(x[:5] - 1.0, x[:5] + 1.0)
    fitting = Fitting(formulation, parts, lower, upper)
    y = fitting.simulated(x)["y1"]
    assert y == pytest.approx(run(formulation.model, x[:5], formulation.data).ravel())
    slopes = fitting.errors(x)[1]
    for place, step in enumerate(1e-6 * np.eye(7)):
        change = (fitting.errors(x + step)[0] - fitting.errors(x - step)[0]) / 2e-6
        assert slopes[:, place] == pytest.approx(change, abs=1e-5 * max(1.0, abs(change).max()))


@pytest.mark.slow
def test_ends_are_those_that_are_proved() -> None:
    """Outer intervals of the engine, which searches in all unknowns, are the oracle."""
    formulation = record(60, 0.05)
    found = setid.identify(
        formulation.data,
        setid.TransferFunction(1, 1, nk=1, inputs=2),
        formulation.noise,
        setid.Stable(),
        QUICK,
    )
    problem = on_box(formulation, 0.2)
    first = np.append(THETA + 0.05, np.zeros(problem.dimension - 4))
    ends = np.array(ends_of_long_record(formulation, problem, first, Deadline(None)))
    assert ends.shape == (8, problem.dimension)
    assert all(noise_level(formulation, end[:4]) <= 1.0 + 1e-9 for end in ends)
    low, high = found.outer_box
    for place in range(4):
        width = high[place] - low[place]
        assert low[place] <= ends[2 * place, place] <= low[place] + 2e-3 * width
        assert high[place] - 2e-3 * width <= ends[2 * place + 1, place] <= high[place]
    rows = np.abs(problem.rows.values(ends[0])[problem.equality])
    assert rows.max() < 1e-12 and abs(ends[0][problem.upper < inf]).max() < 2.0


def test_other_records_have_none() -> None:
    known = record(40, 0.05)
    problem = on_box(known, 0.2)
    first = np.append(THETA, np.zeros(problem.dimension - 4))
    tiny = setid.Noise(output=1e-4)  # no simulation is within it
    less = setid.formulate(known.data, known.model, tiny)
    assert ends_of_long_record(less, on_box(less, 0.2), first, Deadline(None)) == []
    assert ends_of_long_record(known, known.problem, first, Deadline(None)) == []  # no box
    noisy = setid.Noise(output=0.05, input=0.01)
    assert sums_recursion(setid.formulate(known.data, known.model, noisy)) is None
    one = setid.TransferFunction(1, 1, nk=1)
    data = setid.IOData(known.data.u[:, 0], known.data.y)
    assert sums_recursion(setid.formulate(data, one, setid.Noise(output=0.05))) is None


def test_long_records_begin_with_their_ends() -> None:
    """Beyond 200 rows the points that the engine is given are at all ends."""
    formulation = record(230, 0.05)
    problem = on_box(formulation, 0.1)
    scaled, start = in_units(problem, formulation), first_point(formulation, problem)
    assert start is not None
    points, at_ends = starts_of_engine(formulation, problem, scaled, start, Deadline(None))
    assert at_ends and len(points) == 8
    ends = np.array([(point.x * scaled.units)[:4] for point in points])
    assert np.all(ends.min(axis=0) < THETA) and np.all(THETA < ends.max(axis=0))
    for place in range(4):  # each is reached by the points that are meant for it
        low, high = ends[2 * place, place], ends[2 * place + 1, place]
        assert low == ends[:, place].min() and high == ends[:, place].max()


@pytest.mark.slow
def test_a_thousand_rows_of_two_inputs_close() -> None:
    """No end was attained: searches that hold all samples and sums are left out there."""
    formulation = record(1020, 0.05)
    model = setid.TransferFunction(1, 1, nk=1, inputs=2)
    options = setid.Options(time_limit=120.0, progress=False)
    found = setid.identify(formulation.data, model, formulation.noise, setid.Stable(), options)
    assert found.status == "certified" and found.verify()
    for name, value in zip(model.parameters, THETA.tolist(), strict=True):
        low, high = found.intervals[name].outer
        assert low <= value <= high
