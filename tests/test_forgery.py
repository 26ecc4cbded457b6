"""Forged and malformed certificates prove nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_certificates import (
    INF,
    KNOWN,
    chain,
    circle,
    disc,
    empty,
    hill,
    lattice,
    with_multipliers,
)

import sparsepop_py as sp
from sparsepop_py.certificate.box import BoxProof, Sublevel, sublevel_box
from sparsepop_py.certificate.certificate import Certificate, certify
from sparsepop_py.certificate.identity import Identity, Multipliers
from sparsepop_py.feasibility import prove_feasible
from sparsepop_py.presolve.scaling import Scaling
from sparsepop_py.rounding import Interval


@pytest.fixture(scope="module")
def results():
    orders = {hill: 3, lattice: 2}
    found = {}
    for make in KNOWN:
        problem = make()
        found[make] = sp.solve(problem, sp.Options(order=orders.get(make, 2)))
    return found


# ---- forged arguments -------------------------------------------------------------------------


ONE, X = np.zeros((1, 1, 1), np.int32), np.ones((1, 1, 1), np.int32)


def test_a_sublevel_identity_needs_the_monomial_one_for_its_root():
    """4 - x^2 >= 0 gives x^2 <= 4; with the basis {1, x} it would be 1 + x^2 <= 5."""
    (x,) = sp.variables(1)
    problem = sp.Problem(x, [4 - x**2 >= 0])
    point = prove_feasible(problem, np.zeros(1))
    scaling = Scaling.of_box(Interval(problem.lower, problem.upper))
    row = Multipliers(np.array([1]), ONE, np.ones((1, 1, 1)))
    without = Multipliers(np.array([0]), X, np.zeros((1, 1, 1)), 1.0)
    step = Sublevel(Identity(scaling, (row, without)))
    box = sublevel_box(problem, point.value, step, Interval(problem.lower, problem.upper))
    assert box.lo[0] <= -2.0  # -2 is feasible
    forged = certify(problem, BoxProof((step,)), point, None)
    assert forged is None or forged.bound <= -2.0


@pytest.mark.parametrize("scale", [0.0, -1.0])
def test_a_scaling_that_turns_a_variable_around_proves_nothing(scale):
    """min -x, x >= 0 has no lower bound, whatever t stands for."""
    (x,) = sp.variables(1)
    problem = sp.Problem(-x, lower=0)
    scaling = Scaling(
        np.zeros(1), np.full(1, scale), np.zeros(1, bool), np.full(1, 1 if scale else 0)
    )
    floor = Multipliers(np.array([2]), ONE, np.zeros((1, 1, 1)), 1.0)
    for multipliers in ((floor,), ()):
        assert certify(problem, BoxProof(), None, Identity(scaling, multipliers)) is None


def test_emptiness_cannot_be_claimed_of_a_feasible_problem(results):
    for make in (circle, disc, hill, chain, lattice):
        certificate, problem = results[make].certificate, make()
        claim = replace(certificate, bound=INF)
        verdict = claim.verify(problem)
        assert not verdict.ok
        assert verdict.bound <= KNOWN[make]
        farkas = results[empty].certificate.identity
        foreign = replace(claim, identity=farkas)
        if problem.dimension == 2 and len(problem.constraints) == 2:
            assert not foreign.verify(problem).ok


def test_a_proof_of_emptiness_is_no_finite_bound_in_disguise(results):
    certificate, problem = results[empty].certificate, empty()
    assert certificate.bound == INF
    assert certificate.cutoff is None
    finite = replace(certificate, bound=1e6).verify(problem)  # then the objective is x, not 0
    assert not finite.ok


def test_an_empty_certificate_claims_the_range_and_nothing_more():
    x, y = sp.variables(2)
    problem = sp.Problem(x - 3 * y, lower=[0, -1], upper=[2, 1])
    plain = Certificate(problem.fingerprint, -3.0 - 1e-12, BoxProof())
    assert plain.verify(problem).ok
    assert not replace(plain, bound=-3.0 + 1e-12).verify(problem).ok
    endless = sp.Problem(x - 3 * y)
    assert not Certificate(endless.fingerprint, -1e300, BoxProof()).verify(endless).ok
    assert certify(endless, BoxProof(), None, None) is None


@pytest.mark.parametrize(
    "field",
    [
        "scaling",
        "x not a number",
        "x endless",
        "x too short",
        "rows out of range",
        "solved out of range",
        "too many generators",
    ],
)
def test_a_malformed_certificate_is_refused_without_an_exception(results, field):
    certificate, problem = results[circle].certificate, circle()
    point, identity = certificate.cutoff, certificate.identity
    points = {
        "x not a number": {"x": point.x * np.nan},
        "x endless": {"x": point.x * INF},
        "x too short": {"x": point.x[:1]},
        "rows out of range": {"rows": np.array([7])},
        "solved out of range": {"solved": np.array([7])},
    }
    if field in points:
        certificate = replace(certificate, cutoff=replace(point, **points[field]))
    elif field == "too many generators":
        certificate = with_multipliers(
            certificate, lambda g: replace(g, generator=np.repeat(g.generator, 2))
        )
    else:
        small = Scaling(np.zeros(1), np.ones(1), np.ones(1, bool), np.zeros(1, int))
        certificate = replace(certificate, identity=replace(identity, scaling=small))
    assert not certificate.verify(problem).ok


@pytest.mark.parametrize("floor", [np.inf, np.nan, -1.0, 1e308])
def test_a_floor_that_is_no_number_proves_nothing(floor):
    """1000 - x^2 y^2 - x^4 has no lower bound, whatever margin is claimed for x^2 and x y."""
    x, y = sp.variables(2)
    problem = sp.Problem(1000.0 - x**2 * y**2 - x**4)
    none = np.zeros(2, bool)
    scaling = Scaling(np.zeros(2), np.ones(2), none, np.zeros(2, int))
    basis = np.array([[[1, 1], [1, 2]]], np.int32)
    group = Multipliers(np.array([0]), basis, np.zeros((1, 2, 1)), floor=floor)
    identity = Identity(scaling, (group,))
    claim = Certificate(problem.fingerprint, 1000.0, BoxProof(), None, identity)
    assert not claim.verify(problem).ok
