"""Searches for the ends of intervals where unknown samples are multiplied with each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import setid
import sparsepop_py as sp
from benchmarks.peers import scip as peers
from benchmarks.problems.block_structured import KINDS, record
from setid.bounding.engine import recheck_results
from setid.bounding.starts import starts_of_engine
from setid.feasible_points import start as start_points
from setid.feasible_points.search import coupled, search_ends
from setid.feasible_points.start import first_point
from setid.feasible_set.start import find_box
from setid.formulation.formulation import Formulation
from setid.formulation.units import in_fine_units, in_units
from setid.proofs.cells.output_cells import CellBox
from setid.proofs.parameter_box import box_follows, objectives, problem_on_box
from sparsepop_py.budget import Deadline

LURE = setid.Lure(setid.TransferFunction(1, 1, 1), 2, "nolinear")
THETA = [-0.6, 0.8, 0.3]


def stated(
    share: float, samples: int, seed: int, model: setid.Lure = LURE, theta: list[float] = THETA
) -> tuple[Formulation, sp.Problem]:
    """A record of the loop with noise of a share of the largest output, on its box."""
    u = np.random.default_rng(seed).uniform(-1.0, 1.0, samples)
    noise = setid.Noise(output=share * np.abs(setid.simulate(model, theta, u)).max())
    truth = setid.simulate_record(model, theta, u, noise, seed=seed + 1)
    formulation = setid.formulate(truth.data, model, noise)
    return formulation, problem_on_box(formulation, find_box(formulation))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_outputs_that_change_sign_stop_no_search(seed: int) -> None:
    """The squares of outputs near zero are at their least value; the oracle is SCIP."""
    formulation, problem = stated(0.01, 20, seed)
    start = first_point(formulation, problem)
    assert start is not None
    found = search_ends(formulation, problem, start)
    for number, objective in enumerate(objectives(formulation)):
        least = min(float(objective(point)) for point in found)
        width = problem.upper[number // 2] - problem.lower[number // 2]
        answer = peers.scip(problem, objective, peers.Budget(20.0, 1e-4 * width))
        assert least <= answer.lower + 3e-4 * width


@pytest.mark.parametrize("size", [1e-5, 1e-3, 1e4])
def test_ends_do_not_depend_on_the_unit_of_outputs(size: float) -> None:
    """With outputs times s the gains are b1 s and gamma2 / s^2, and so are their ends."""
    u = np.random.default_rng(0).uniform(-1.0, 1.0, 12)
    noise = 0.01 * np.abs(setid.simulate(LURE, THETA, u)).max()
    y = setid.simulate_record(LURE, THETA, u, setid.Noise(output=noise), seed=1).data.y
    found = []
    for unit in (1.0, size):
        data = setid.IOData(u, unit * y)
        formulation = setid.formulate(data, LURE, setid.Noise(output=unit * noise))
        problem = problem_on_box(formulation, find_box(formulation))
        start = first_point(formulation, problem)
        assert start is not None
        ends = search_ends(formulation, problem, start)
        assert len(ends) == 7  # both ends of three parameters, and where they begin
        values = np.array([end[:3] for end in ends]) / [1.0, unit, unit**-2.0]
        found.append([values.min(axis=0), values.max(axis=0)])
    first, again = np.array(found)
    assert np.all(np.abs(again - first) <= 1e-4 * (first[1] - first[0]))


def test_samples_of_a_signal_without_bounds_have_one_unit() -> None:
    """A square that begins near zero has to grow: the largest of them says how large they are."""
    u = np.random.default_rng(0).uniform(-1.0, 1.0, 12)
    model = setid.Wiener(setid.TransferFunction(1, 1, 1), 2, "gamma1")
    data = setid.IOData(u, np.asarray(setid.simulate(model, [-0.6, 0.8, 0.3], u)))
    formulation = setid.formulate(data, model, setid.Noise(output=0.01))
    squares = formulation.layout.group("p[z^2]")
    near = np.zeros(formulation.layout.dimension)
    near[squares.ravel()] = 1e-9 * np.arange(1, squares.size + 1)
    units = in_fine_units(formulation.problem, formulation, near).units[squares.ravel()]
    assert np.all(units == units[0]) and 0.5 <= units[0] / near.max() <= 2.0


def test_searches_pass_noise_that_curves_the_rows() -> None:
    """At 5 % squares of noise count: steps without correction end far inside; oracle SCIP."""
    formulation, problem = stated(0.05, 20, 0, LURE, [-0.6, 0.5, 0.15])
    start = first_point(formulation, problem)
    assert start is not None
    largest = max(float(point[2]) for point in search_ends(formulation, problem, start))
    answer = peers.scip(problem, objectives(formulation)[5], peers.Budget(20.0, 1e-5))
    assert largest >= -answer.upper - 1e-4


def test_estimates_that_need_too_much_noise_are_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without an output-error fit, which would be consistent here."""
    monkeypatch.setattr(start_points, "_simulated", lambda *_: iter(()))
    formulation, problem = stated(0.01, 50, 0)
    start = first_point(formulation, problem)
    assert start is not None
    assert setid.least_noise(formulation, start[:3]).level > 1.0
    assert len(search_ends(formulation, problem, start)) == 7


@pytest.mark.parametrize(
    "model, theta",
    [
        (LURE, [-0.6, 0.5, 0.15]),
        (setid.Lure(setid.TransferFunction(2, 2, 1), 2, "nolinear"), [-1.1, 0.4, 0.3, 0.1, 0.1]),
    ],
)
def test_long_records_have_witnesses_and_attained_ends(model: setid.Lure, theta: list) -> None:
    """The true noise is within its bounds, so that the truth needs a level of at most 1."""
    formulation, problem = stated(0.01, 100, 0, model, theta)
    witness = setid.least_noise(formulation, theta)
    assert 0.9 < witness.level <= 1.0  # of 100 uniform samples some are near the bound
    assert formulation.problem.violation(witness.x) < 1e-9
    start = first_point(formulation, problem)
    assert start is not None
    assert len(search_ends(formulation, problem, start)) == 2 * len(theta) + 1


def test_noise_that_jumps_between_vertices_is_settled_by_newton() -> None:
    """Input noise in powers and a static gain of 1: programs alone do not come to rest."""
    model = setid.Hammerstein(setid.TransferFunction(1, 1, 1), 2, "dcgain")
    theta = [-0.7, 0.3, 1.0, 0.4]
    u = np.random.default_rng(0).uniform(-1.0, 1.0, 20)
    size = 0.01 * float(np.abs(setid.simulate(model, theta, u)).max())
    noise = setid.Noise(output=size, input=0.003)
    truth = setid.simulate_record(model, theta, u, noise, seed=1)
    formulation = setid.formulate(truth.data, model, noise)
    problem = problem_on_box(formulation, find_box(formulation))
    start = first_point(formulation, problem)
    assert start is not None
    found = search_ends(formulation, problem, start)
    assert len(found) >= 7  # of an inner point and eight ends
    assert all(problem.violation(point) < 1e-9 for point in found)


def test_rows_of_zeros_alone_hold() -> None:
    """At rest the first row of an exact output says 0 = 0."""
    model = setid.PolynomialNARX(["y1", "u1", "u1^3"], ny=1, nu=1, initial="zero")
    u = np.random.default_rng(0).uniform(-1.0, 1.0, 20)
    noise = setid.Noise(input=0.05)
    truth = setid.simulate_record(model, [0.3, 0.8, -0.2], u, noise, seed=1)
    formulation = setid.formulate(truth.data, model, noise)
    assert any(not row.polynomial.coefficients.size for row in formulation.problem.constraints)
    found = setid.least_noise(formulation, np.array([0.3, 0.8, -0.2]))
    assert found.level <= 1.0 + 1e-9


def test_boxes_that_differ_by_rounding_keep_their_proofs() -> None:
    """Samples known to 1e-7 leave boxes of which a few units in the last place are much."""
    truth, noise = record("wiener 1", 20)
    model, _, priors = KINDS["wiener 1"]
    result = setid.identify(truth.data, model, noise, priors, setid.Options(time_limit=40))
    assert all(str(item.status) == "certified" for item in result.intervals.values())
    assert all(truth.theta[name] in item for name, item in result.intervals.items())
    assert result.verify(truth.data)


def test_certificates_that_claim_too_much_keep_what_they_prove() -> None:
    """The least product on the unit disc is -1/2."""
    x = sp.variables(2)
    problem = sp.Problem(x[0] * x[1], [x[0] ** 2 + x[1] ** 2 <= 1], lower=-1, upper=1)
    honest = sp.solve(problem)
    assert honest.certificate is not None
    assert recheck_results(problem, [honest])[0] is honest
    too_much = replace(honest.certificate, bound=-0.25)
    found = recheck_results(problem, [replace(honest, certificate=too_much, lower_bound=-0.25)])[0]
    assert -0.5 - 1e-6 <= found.lower_bound <= -0.5
    assert found.status is sp.Status.BOUNDED
    assert found.certificate is not None and found.certificate.verify(problem).ok
    elsewhere = sp.Problem(x[0] * x[1], [x[0] ** 2 + x[1] ** 2 <= 2], lower=-1, upper=1)
    assert recheck_results(elsewhere, [honest])[0].lower_bound == -np.inf


@pytest.mark.slow
def test_long_records_with_strong_noise_have_cells() -> None:
    """Coarse cells say nothing of late samples: the first decide, then more of them."""
    truth, noise = record("wiener 2", 50, 5.0)
    model, theta, priors = KINDS["wiener 2"]
    known = setid.formulate(truth.data, model, noise, priors)
    box = find_box(known)
    assert isinstance(box, CellBox) and not box.open
    assert np.all((box.lower <= theta) & (box.upper >= theta))
    assert box_follows(box, known)


@pytest.mark.slow
def test_ends_with_products_of_parameters_are_searched_for() -> None:
    """Nine parameters, two denominators: terms such as a1 a'1 eta(k-2).

    The ends are those that sequential linear programs on the simulated output find, in the
    parameters and four initial values instead of rows and noise.
    """
    truth, noise = record("two inputs 2", 50)
    model, _, priors = KINDS["two inputs 2"]
    formulation = setid.formulate(truth.data, model, noise, priors)
    problem = problem_on_box(formulation, find_box(formulation))
    start = first_point(formulation, problem)
    assert coupled(formulation) and start is not None
    found = search_ends(formulation, problem, start)
    reached = np.array([point[: len(model.parameters)] for point in found])
    ends = {
        "a[y1,w]1": (-1.1160, -1.0761),
        "b[y1,u2]2": (0.2786, 0.3403),
        "gamma2": (0.3897, 0.4129),
    }
    for name, (low, high) in ends.items():
        values = reached[:, model.parameters.index(name)]
        assert values.min() <= low + 5e-4 and values.max() >= high - 5e-4


def test_ends_of_problems_with_many_sums_are_found_without_them():
    """Two denominators of order 2: points at ends, whose sums of products are what theta gives."""
    rng = np.random.default_rng(2)
    model = setid.TransferFunction(2, 1, 1, inputs=2, form="lifted")
    theta = [-1.1, 0.4, 0.5, 0.3, 1.0, 2.0]
    noise, u = setid.Noise(output=0.02), rng.uniform(-1, 1, (30, 2))
    data = setid.simulate_record(model, theta, u, noise, rng).data
    formulation = setid.formulate(data, model, noise)
    problem = problem_on_box(formulation, find_box(formulation))
    scaled, start = in_units(problem, formulation), first_point(formulation, problem)
    assert start is not None
    points, at_ends = starts_of_engine(formulation, problem, scaled, start, Deadline(None))
    assert len(points) >= 10 and not at_ends
    about = in_units(problem, formulation)
    for point in points:
        assert about.problem.violation(point.x) < 1e-9
    ends = np.array([(point.x * about.units)[:6] for point in points])
    assert np.all(ends.min(axis=0) < theta) and np.all(theta < ends.max(axis=0))


@pytest.mark.parametrize("unit", [1.0, 1e-4])
def test_ends_without_a_box_are_attained_in_any_unit(unit: float) -> None:
    """With free states nothing bounds this gain; the truth is consistent at each unit."""
    model, theta = setid.Wiener(setid.TransferFunction(2, 1, 1), 2, "gamma1"), [-0.9, 0.3, 0.5, 0.2]
    u = np.random.default_rng(0).uniform(-1.0, 1.0, 12)
    y = np.asarray(setid.simulate(model, theta, u))
    noise = setid.Noise(output=0.02 * unit * float(np.abs(y).max()))
    found = setid.identify(setid.IOData(u, unit * y), model, noise, setid.Stable())
    inner = found.intervals["b1"].inner
    assert inner is not None
    assert inner[0] <= 0.5 * unit <= inner[1]
