"""Coefficients of maps that quotients leave endless: their bounds, and what refuses false ones."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import setid
import sparsepop_py as sp
from benchmarks.problems.block_structured import KINDS, record
from setid.feasible_set.start import find_box
from setid.formulation.formulation import Formulation
from setid.formulation.units import coupled_rows
from setid.proofs.parameter_box import box_follows
from sparsepop_py.uncertain_rows.unbounded_coefficients import limit_coefficients
from sparsepop_py.verified.uncertain_rows.lifted_products import LiftedBox
from sparsepop_py.verified.uncertain_rows.unbounded_coefficients import Faces

MODEL, THETA, PRIORS = KINDS["two inputs 2"]


@cache
def known(samples: int = 20, noise: float = 0.5) -> tuple[Formulation, LiftedBox]:
    truth, bound = record("two inputs 2", samples, noise)
    formulation = setid.formulate(truth.data, MODEL, bound, PRIORS)
    box = find_box(formulation, np.inf)
    assert isinstance(box, LiftedBox)
    return formulation, box


@pytest.mark.slow
def test_nine_parameters_have_a_box_from_twenty_samples() -> None:
    formulation, box = known()
    assert box.limit is not None and box.limit.reach <= 16.0
    assert np.all(np.isfinite([box.lower, box.upper]))
    assert np.all((box.lower <= THETA) & (THETA <= box.upper))
    assert box_follows(box, formulation)


@pytest.mark.slow
def test_no_consistent_parameters_are_as_far_as_that() -> None:
    """Least noise levels of parameters with |gamma2| beyond the reach, by linear programs."""
    formulation, box = known()
    assert box.limit is not None
    source, names = np.random.default_rng(0), list(formulation.parameters)
    place, numerator = names.index("gamma2"), [names.index(f"b[y1,w]{lag}") for lag in (1, 2)]
    for _ in range(20):
        theta = np.array(THETA) + source.normal(size=9) * 0.2
        gamma = box.limit.reach * source.choice([-1.0, 1.0]) * 10.0 ** source.uniform(0.0, 3.0)
        theta[numerator] = np.array(THETA)[numerator] * source.normal(0.4, 0.3) / gamma
        theta[place] = gamma
        assert setid.least_noise(formulation, theta).level > 1.0


@pytest.mark.slow
def test_damaged_proofs_are_refused() -> None:
    formulation, box = known()
    limit, rows, last = box.limit, formulation.products, box.rounds[-1]
    assert limit is not None and rows is not None
    ends = np.array([last.lower, last.upper])
    before = np.array([box.lower, box.upper])
    before[:, 8] = -np.inf, np.inf  # all that its bounds change here is gamma2
    assert limit.follows(coupled_rows(formulation), rows, ends, before)
    silent = tuple(replace(p, root=replace(p.root, argument=None)) for p in limit.proofs)
    for wrong in (
        limit._replace(reach=limit.reach / 64.0),
        limit._replace(reach=np.nan),
        limit._replace(reach=-limit.reach),
        limit._replace(proofs=()),
        limit._replace(parameters=(0,)),
        limit._replace(proofs=silent),
        limit._replace(proofs=(None,)),
        limit._replace(reach="16"),
        limit._replace(parameters=(8.0,)),
    ):
        assert not wrong.follows(coupled_rows(formulation), rows, ends, before)
    truth, bound = record("two inputs 2", 20, 0.5, seed=7)
    other = setid.formulate(truth.data, MODEL, bound, PRIORS)
    assert not limit.follows(coupled_rows(other), rows, ends, before)
    assert not box_follows(replace(box, limit=tuple(limit)), formulation)
    tighter = replace(box, upper=np.where(np.arange(9) == 8, 1.0, box.upper))
    assert not box_follows(tighter, formulation)


@pytest.mark.parametrize("fixed", [None, "gamma1"])
def test_nothing_is_claimed_where_far_parameters_explain_the_record(fixed: str | None) -> None:
    """The first input passes a square and nothing else: every large gamma2 is consistent."""
    blind = setid.BlockStructured(
        {
            ("y1", "w"): setid.TransferFunction(1, 1, 1),
            ("y1", "u2"): setid.TransferFunction(1, 1, 1),
        },
        {"w": setid.StaticMap("u1", 2)},
        inputs=2,
        normalise={"gamma1": 0.0, "gamma2": 1.0} if fixed is None else fixed,
    )
    theta = (-0.5, 0.3, 0.8, 0.6) if fixed is None else (-0.5, 0.3, 0.8e-9, 0.6, 1e9)
    u = np.random.default_rng(1).uniform(-1, 1, (30, 2))
    noise = setid.Noise(output=0.01)
    truth = setid.simulate_record(blind, theta, u, noise, seed=2)
    model = blind.normalised("gamma1")
    formulation = setid.formulate(truth.data, model, noise, (setid.Stable(),))
    box = find_box(formulation, np.inf)
    assert isinstance(box, LiftedBox) and box.limit is None
    assert np.isinf(box.upper[-1]) and np.isinf(box.lower[-1])


def hammerstein(theta: tuple[float, ...], size: float) -> tuple[Formulation, LiftedBox]:
    """Forty samples from which b1 may be zero, so that both coefficients are endless."""
    model = setid.Hammerstein(setid.TransferFunction(1, 1, 1), 3, normalise="gamma1")
    u, noise = np.random.default_rng(1).uniform(-1, 1, 40), setid.Noise(output=size)
    truth = setid.simulate_record(model, theta, u, noise, seed=2)
    formulation = setid.formulate(truth.data, model, noise, (setid.Stable(),))
    box = find_box(formulation, np.inf)
    assert isinstance(box, LiftedBox) and box_follows(box, formulation)
    assert np.all((box.lower <= theta) & (theta <= box.upper))
    return formulation, box


def test_two_coefficients_are_bounded_at_once() -> None:
    _, box = hammerstein((-0.5, 0.3, 1.0, 3.0), 0.3)
    assert box.lower[1] < 0 < box.upper[1]
    assert box.limit is not None and len(box.limit.proofs) == 2
    assert np.all(np.isfinite([box.lower, box.upper]))


def test_bounds_of_products_alone_may_show_that_a_face_is_empty() -> None:
    """B gamma3 is larger than b gamma2 wherever the record holds, so gamma2 is not the largest."""
    formulation, box = hammerstein((-0.5, 0.005, 100.0, 300.0), 0.05)
    rows, last = formulation.products, box.rounds[-1]
    assert rows is not None and box.limit is None  # b1 = 0 explains the record
    before = np.array([box.lower, box.upper])
    faces = Faces.of(coupled_rows(formulation), rows, np.array([last.lower, last.upper]), before)
    assert faces is not None
    low, high = faces.unknowns(2, 100.0)
    assert np.any(low > high) and faces.holds(2, 100.0, None)
    assert not faces.holds(3, 100.0, None)


@pytest.mark.slow
def test_an_interrupt_keeps_what_is_proved(monkeypatch: pytest.MonkeyPatch) -> None:
    formulation, box = known()
    rows, last = formulation.products, box.rounds[-1]
    assert rows is not None
    before = np.array([box.lower, box.upper])
    before[:, 8] = -np.inf, np.inf
    solve, calls = sp.solve, list[float]()

    def stopped(problem: sp.Problem, options: sp.Options) -> sp.Result:
        calls.append(float(problem.upper[8]))
        if len(calls) > 1:
            raise KeyboardInterrupt
        return solve(problem, options)

    monkeypatch.setattr("sparsepop_py.uncertain_rows.unbounded_coefficients.solve", stopped)
    ends = np.array([last.lower, last.upper])
    coupled = coupled_rows(formulation)
    limit = limit_coefficients(coupled, rows, ends, before, np.inf)
    assert len(calls) == 2 and limit is not None and limit.reach >= 1.0 / calls[0]
    assert limit.follows(coupled_rows(formulation), rows, ends, before)
