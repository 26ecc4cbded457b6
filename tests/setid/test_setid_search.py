"""Searches for the ends of intervals where unknown samples are multiplied with each other."""

from __future__ import annotations

import numpy as np
import pytest

import setid
import sparsepop_py as sp
from setid.boxed import boxed, objectives
from setid.formulation import Formulation
from setid.identify import start_box
from setid.search import attained_ends
from setid.starts import first_point

LURE = setid.Lure(setid.TransferFunction(1, 1, 1), 2, "nolinear")
THETA = [-0.6, 0.8, 0.3]


def stated(share: float, samples: int, seed: int) -> tuple[Formulation, sp.Problem]:
    """A record of the loop with noise of a share of the largest output, on its box."""
    u = np.random.default_rng(seed).uniform(-1.0, 1.0, samples)
    noise = setid.Noise(output=share * np.abs(setid.simulate(LURE, THETA, u)).max())
    truth = setid.simulate_record(LURE, THETA, u, noise, seed=seed + 1)
    formulation = setid.formulate(truth.data, LURE, noise)
    return formulation, boxed(formulation, start_box(formulation))


@pytest.mark.parametrize("seed", [0, 1])
def test_outputs_that_change_sign_stop_no_search(seed: int) -> None:
    """The squares of outputs near zero are at their least value; the oracle is SCIP."""
    peers = pytest.importorskip("benchmarks.peers")
    if not peers.scip_is_installed():
        pytest.skip("pyscipopt is missing")
    formulation, problem = stated(0.01, 20, seed)
    start = first_point(formulation, problem)
    assert start is not None
    found = attained_ends(formulation, problem, start)
    for number, objective in enumerate(objectives(formulation)):
        least = min(float(objective(point.x)) for point in found)
        width = problem.upper[number // 2] - problem.lower[number // 2]
        answer = peers.scip(problem, objective, peers.Budget(20.0, 1e-4 * width))
        assert least <= answer.lower + 3e-4 * width


def test_estimates_that_need_too_much_noise_are_starts() -> None:
    formulation, problem = stated(0.01, 50, 0)
    start = first_point(formulation, problem)
    assert start is not None
    assert formulation.witness(start[:3]).level > 1.0
    assert len(attained_ends(formulation, problem, start)) == 7
