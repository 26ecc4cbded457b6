"""Forged and malformed certificates prove nothing."""

from __future__ import annotations

import json
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
    known_results,
    lattice,
    with_multipliers,
    with_root,
)

import sparsepop_py as sp
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.certificate.certificate import Certificate, Node, certify, prove
from sparsepop_py.verified.certificate.rational_gram import ExactGram
from sparsepop_py.verified.certificate.sos_identity import Identity, Multipliers, Priced, losses
from sparsepop_py.verified.certificate.steps import (
    BoxProof,
    Replay,
    Sublevel,
    sublevel_box,
    with_cutoff,
)


@pytest.fixture
def results():
    return known_results()


# ---- forged arguments -------------------------------------------------------------------------


def certified(problem, root, cutoff=None):
    """Certify a root without children."""
    replay = Replay(problem, cutoff)
    return certify(replay, root, prove(replay, root.box.replay(replay), root.argument, root.empty))


ONE, X = np.zeros((1, 1, 1), np.int32), np.ones((1, 1, 1), np.int32)


def test_a_sublevel_identity_needs_the_monomial_one_for_its_root():
    """4 - x^2 >= 0 gives x^2 <= 4; with the basis {1, x} it would be 1 + x^2 <= 5."""
    (x,) = sp.variables(1)
    problem = sp.Problem(x, [4 - x**2 >= 0])
    scaling = Scaling.of_box(Interval(problem.lower, problem.upper))
    row = Multipliers(np.array([1]), ONE, np.ones((1, 1, 1)))
    without = Multipliers(np.array([0]), X, np.zeros((1, 1, 1)), 1.0)
    step = Sublevel(Identity(scaling, (row, without)), 0.0)
    box = sublevel_box(problem, 0.0, step, Interval(problem.lower, problem.upper))
    assert box.lo[0] <= -2.0  # -2 is feasible
    forged = certified(problem, Node(BoxProof((step,))), 0.0)
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
        assert certified(problem, Node(argument=Identity(scaling, multipliers))) is None


def test_emptiness_cannot_be_claimed_of_a_feasible_problem(results):
    for make in (circle, disc, hill, chain, lattice):
        certificate, problem = results[make].certificate, make()
        claim = replace(certificate, bound=INF)
        verdict = claim.verify(problem)
        assert not verdict.ok
        assert verdict.bound <= KNOWN[make]
        foreign = replace(claim, root=results[empty].certificate.root, cutoff=None)
        if problem.dimension == 2 and len(problem.constraints) == 2:
            assert not foreign.verify(problem).ok
        assert not with_root(replace(claim, cutoff=None), empty=True).verify(problem).ok


def test_a_proof_of_emptiness_is_no_finite_bound_in_disguise(results):
    certificate, problem = results[empty].certificate, empty()
    assert certificate.bound == INF
    assert certificate.cutoff is None
    assert certificate.root.empty
    assert certificate.verify(problem).bound == INF
    finite = with_root(certificate, empty=False)  # then the objective is x, not 0
    assert not replace(finite, bound=1e6).verify(problem).ok
    assert not finite.verify(problem).ok


def test_an_empty_certificate_claims_the_range_and_nothing_more():
    x, y = sp.variables(2)
    problem = sp.Problem(x - 3 * y, lower=[0, -1], upper=[2, 1])
    plain = Certificate(problem.fingerprint, -3.0 - 1e-12)
    assert plain.verify(problem).ok
    assert not replace(plain, bound=-3.0 + 1e-12).verify(problem).ok
    unbounded = sp.Problem(x - 3 * y)
    assert not Certificate(unbounded.fingerprint, -1e300).verify(unbounded).ok
    assert certified(unbounded, Node()) is None


@pytest.mark.parametrize("field", ["scaling", "too many generators", "bits", "bytes", "parts"])
def test_a_malformed_certificate_is_refused_without_an_exception(results, field):
    certificate, problem = results[circle].certificate, circle()
    identity = certificate.identity
    kinds = {"bits": bool, "bytes": np.int8, "parts": float}
    if field == "scaling":
        small = Scaling(np.zeros(1), np.ones(1), np.ones(1, bool), np.zeros(1, int))
        certificate = with_root(certificate, argument=replace(identity, scaling=small))
    elif field == "too many generators":
        certificate = with_multipliers(
            certificate, lambda g: replace(g, generator=np.repeat(g.generator, 2))
        )
    else:
        certificate = with_multipliers(
            certificate, lambda g: replace(g, generator=g.generator.astype(kinds[field]))
        )
    assert not certificate.verify(problem).ok


@pytest.mark.parametrize("kind", [np.int8, np.uint8, np.int64])
def test_generators_in_bytes_do_not_wrap_around(kind):
    """127 + 1 is -128 in bytes: the equation y = 0 would be read on to the row after it.

    The multiplier -1 of y + (1 - x) would prove x >= 1 + y, but the minimum of x is -1.
    """
    x, y = sp.variables(2)
    rows = [sp.Constraint(0.0 * x, sp.Kind.NONNEGATIVE)] * 249
    rows[126], rows[127] = y == 0, 1 - x >= 0
    problem = sp.Problem(x, rows, -1, 1)
    scaling = Scaling.of_box(Interval(problem.lower, problem.upper))
    group = Multipliers(np.array([127], kind), ONE, np.full((1, 1), -1.0))
    node = Node(argument=Identity(scaling, (group,)))
    assert not Certificate(problem.fingerprint, -0.9, node).verify(problem).ok


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
    claim = Certificate(problem.fingerprint, 1000.0, Node(argument=identity))
    assert not claim.verify(problem).ok


def test_a_remainder_that_is_no_number_is_not_free():
    """Of 1 - NaN t^2 nothing can be said, by squares or by prices."""
    (x,) = sp.variables(1)
    problem = sp.Problem(0 * x + 1, lower=-1, upper=1)
    system, equality = with_cutoff(problem, np.nan)
    scaling = Scaling.of_box(Interval(problem.lower, problem.upper))
    squares = Multipliers(np.array([1]), X, np.ones((1, 1, 1)))
    found = Identity(scaling, (squares,)).evaluate(system, equality, problem.objective_row)
    assert found.bound == -INF
    remainder = Interval(np.array([np.nan, 0.0]), np.array([np.nan, 0.0]))
    owner, words = np.array([0, 1]), np.ones((2, 1), np.int32)
    cost = losses(words, remainder, owner, 2)
    assert not cost[0] <= 1e300
    assert cost[1] == 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_ends_of_t_that_hold_no_number_prove_nothing(side):
    """x^2 + x has the minimum -1/4; with t in [inf, inf] the multiple t would cost 1e308."""
    (x,) = sp.variables(1)
    problem = sp.Problem(x**2 + side * x)
    end = np.array([side * INF])
    scaling = Scaling(np.zeros(1), np.ones(1), np.zeros(1, bool), np.zeros(1, int), (end, end))
    basis = np.array([[[0], [1]]], np.int32)
    group = Multipliers(np.array([0]), basis, np.zeros((1, 2, 1)), floor=1.0)
    priced = Priced(np.array([[1]], np.int32), np.array([side]))
    node = Node(argument=Identity(scaling, (group,), priced=priced))
    verdict = Certificate(problem.fingerprint, 1e300, node).verify(problem)
    assert not verdict.ok
    assert verdict.bound <= -0.25


@pytest.mark.parametrize("kind", [np.longdouble, complex, object])
def test_numbers_that_are_rounded_when_read_prove_nothing(results, kind):
    """What is finite here may be infinite as a double, and other checks see another number."""
    certificate, problem = results[disc].certificate, disc()
    assert certificate.verify(problem).ok
    changed = with_multipliers(certificate, lambda g: replace(g, values=g.values.astype(kind)))
    assert not changed.verify(problem).ok
    scaling = replace(certificate.identity.scaling)
    moved = replace(scaling, centre=scaling.centre.astype(kind))
    forged = with_root(certificate, argument=replace(certificate.identity, scaling=moved))
    assert not forged.verify(problem).ok


def test_a_gram_matrix_without_entries_proves_the_constant_and_nothing_more():
    (x,) = sp.variables(1)
    none = np.zeros(0, np.int64)
    gram = ExactGram(np.zeros((1, 1), np.int32), none, none, np.zeros(0))
    assert gram.bound(0 * x) == 0.0
    assert gram.bound(0 * x - 3) == -3.0
    assert gram.bound(x) == -INF
    huge = ExactGram(np.array([[0], [1]], np.int32), none, none, np.zeros(0, np.longdouble))
    assert huge.bound(0 * x) == -INF


def test_a_result_states_no_more_than_its_certificate_proves() -> None:
    (x,) = sp.variables(1)
    text = json.loads(sp.to_json(sp.solve(sp.Problem(x**4 - x, (), -1, 1), sp.Options(order=2))))
    text["result"]["lower_bound"] = 5.0
    with pytest.raises(sp.ProblemError, match=r"result\.lower_bound: found 5\.0, expected at most"):
        sp.from_json(json.dumps(text))
    text["result"].update(certificate=None, lower_bound=-5.0)
    with pytest.raises(sp.ProblemError, match="expected at most -inf"):
        sp.from_json(json.dumps(text))
