"""Certificates with matrices: the identity in rationals, any multipliers, tampered ones."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from exact_polynomials import exact_bound
from hypothesis import given, settings
from hypothesis import strategies as st
from known_certificates import with_multipliers, with_root
from random_matrices import feasible_grid, random_problem

import sparsepop_py as sp
from sparsepop_py.relaxation.recover_multipliers import identity_of, shortened
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaled, Scaling
from sparsepop_py.verified.certificate.certificate import Node, certify, prove
from sparsepop_py.verified.certificate.multipliers import Multipliers
from sparsepop_py.verified.certificate.sos_identity import Identity
from sparsepop_py.verified.certificate.steps import Replay

SEEDS = st.integers(0, 2**32 - 1)
INF = np.inf
ONE = np.zeros((1, 2, 1), np.int32)  # the basis (1, 1), for the two rows of a matrix
BOTH = np.array([[0, 1]])
x, y = sp.variables(2)


def evaluate(identity, problem):
    rows, equality, target = problem.rows, problem.equality, problem.objective_row
    return identity.evaluate(rows, equality, target, problem.matrices)


def scaling_of(problem):
    return Scaling.of_box(Interval(problem.lower, problem.upper))


def made(problem, order=2):
    """The identity that a solver's dual stands for."""
    scaled = Scaled.of(problem, scaling_of(problem), (problem.objective,))
    relaxation = sp.relax(scaled.problem, order)
    solution = sp.solve_conic(sp.assemble(relaxation, scaled.problem.objective))
    return identity_of(relaxation, scaled, solution.z, scaled.objective_sizes[0])


@settings(max_examples=8, deadline=None)
@given(SEEDS)
def test_the_bound_is_that_of_rational_arithmetic(seed):
    """Rounded down, and by no more than 1e-10."""
    problem = random_problem(seed)
    identity = made(problem)
    for changed in (identity, shortened(identity)):
        found, exact = evaluate(changed, problem), exact_bound(changed, problem)
        assert Fraction(found.bound) <= exact
        assert float(exact) - found.bound <= 1e-10 * (1 + abs(found.bound))


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.integers(1, 4), st.sampled_from([0.0, 0.3]))
def test_any_factor_proves_a_bound_that_holds(seed, size, floor):
    """Whatever L, the monomials and their rows are, no feasible point lies below the bound."""
    problem = random_problem(seed)
    rng = np.random.default_rng(seed)
    side = problem.constraints[0].side
    group = Multipliers(
        np.array([1, 1]),
        np.sort(rng.integers(0, 3, (2, size, 2)).astype(np.int32), axis=2),
        rng.normal(size=(2, size, 2)),
        floor,
        rng.integers(0, side, (2, size)),
    )
    identity = Identity(scaling_of(problem), (group,))
    bound = evaluate(identity, problem).bound
    assert bound == pytest.approx(float(exact_bound(identity, problem)), rel=1e-12)
    _, values = feasible_grid(problem, 4)
    assert np.all(values >= bound)


def test_a_certificate_written_by_hand():
    """x + 1 = <(1/2) [1 1; 1 1], [1 x; x 1]>, so x >= -1 wherever the matrix is semidefinite."""
    problem = sp.Problem(x, [sp.psd([[1, x], [x, 1]])])
    factor = np.full((1, 2, 1), 2.0**-0.5)
    group = Multipliers(np.array([1]), ONE, factor, place=BOTH)
    identity = Identity(Scaling.of_box(Interval(np.full(2, -2.0), np.full(2, 2.0))), (group,))
    assert -1 - 1e-13 <= evaluate(identity, problem).bound <= -1


# ---- malformed and forged -----------------------------------------------------------------------


def solved(problem):
    """The certificate, and a value that provably is attained."""
    result = sp.solve(problem, sp.Options(effort="plain"))
    assert result.certificate is not None
    assert result.certificate.verify(problem).ok
    return result.certificate, result.upper_bound


ROWS = [[1, x, 0.3], [x, 1, y], [0.3, y, 1]]


@pytest.fixture(scope="module")
def elliptope():
    """Correlations of three variables: no bound of x + y follows from single entries."""
    problem = sp.Problem(x + y, [sp.psd(ROWS), sp.second_order(1.5, x, y)], lower=-1, upper=1)
    return problem, *solved(problem)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"generator": np.array([3])}, "refers to a matrix that does not exist"),
        ({"generator": np.array([0])}, "refers to a matrix that does not exist"),
        ({"generator": np.array([-1])}, "refers to a constraint that does not exist"),
        ({"generator": np.array([10**6])}, "refers to a constraint that does not exist"),
        ({"place": np.array([[0, 2]])}, "refers to a matrix that does not exist"),
        ({"place": np.array([[-1, 0]])}, "refers to a matrix that does not exist"),
        ({"place": np.array([[0.0, 1.0]])}, "refers to a matrix that does not exist"),
        ({"place": np.array([[0, 1]], np.int8)}, "refers to a matrix that does not exist"),
        ({"place": np.array([0, 1])}, "shapes"),
        ({"place": np.array([[0, 1, 1]])}, "shapes"),
        ({"values": np.full((1, 2, 1), np.nan)}, "not finite"),
        ({"values": np.ones((1, 2))}, "shapes"),
        ({"floor": -1.0}, "malformed basis or floor"),
    ],
)
def test_malformed_multipliers_prove_nothing(change, reason):
    problem = sp.Problem(x, [sp.psd([[1, x], [x, 1]])], lower=-5, upper=5)
    group = Multipliers(np.array([1]), ONE, np.full((1, 2, 1), 0.7), place=BOTH)
    scaling = scaling_of(problem)
    assert evaluate(Identity(scaling, (group,)), problem).bound > -INF
    found = evaluate(Identity(scaling, (replace(group, **change),)), problem)
    assert found.bound == -INF
    assert reason in found.reason


def test_inequalities_have_no_places():
    """A place 1 of the inequality x >= 0 would be an entry of something else."""
    problem = sp.Problem(x, [x >= 0, sp.psd([[1, x], [x, 1]])], lower=-5, upper=5)
    group = Multipliers(np.array([1]), ONE, np.full((1, 2, 1), 0.7), place=BOTH)
    scaling = scaling_of(problem)
    assert evaluate(Identity(scaling, (group,)), problem).bound == -INF
    rows = problem.rows, problem.equality, problem.objective_row
    right = Identity(scaling, (replace(group, generator=np.array([2])),))
    assert right.evaluate(*rows, problem.matrices).bound > -INF
    assert right.evaluate(*rows).bound == -INF  # nobody vouches for a matrix


@pytest.mark.parametrize("factor", [0.0, 0.9, 1.1, -3.0])
def test_tampered_factors_do_not_keep_the_claim(elliptope, factor):
    problem, certificate, attained = elliptope
    assert any(group.place is not None for group in certificate.identity.multipliers)

    def changed(group):
        return group if group.place is None else replace(group, values=group.values * factor)

    verdict = with_multipliers(certificate, changed).verify(problem)
    assert not verdict.ok
    assert verdict.bound <= attained - 1e-4


def test_rows_of_the_matrix_may_not_be_exchanged(elliptope):
    """All monomials in one row, or multipliers of one matrix put on another."""
    problem, certificate, attained = elliptope
    other = [[1, -x, 0.3], [-x, 1, y], [0.3, y, 1]]
    turned = sp.Problem(
        x + y, [sp.psd(other), sp.second_order(1.5, x, y)], problem.lower, problem.upper
    )
    assert not certificate.verify(turned).ok
    assert replace(certificate, fingerprint=turned.fingerprint).verify(turned).bound <= attained

    def moved(group):
        return group if group.place is None else replace(group, place=0 * group.place)

    verdict = with_multipliers(certificate, moved).verify(problem)
    assert not verdict.ok
    assert verdict.bound <= attained


def test_a_certificate_does_not_pass_for_scalar_rows(elliptope):
    problem, certificate, _ = elliptope
    rows = [sp.Constraint(c.polynomial, sp.Kind.NONNEGATIVE) for c in problem.constraints]
    scalar = sp.Problem(x + y, rows, problem.lower, problem.upper)
    assert not certificate.verify(scalar).ok
    stolen = replace(certificate, fingerprint=scalar.fingerprint)
    assert stolen.verify(scalar).bound <= -2  # which is attained there


def test_emptiness_needs_an_empty_set(elliptope):
    problem, certificate, _ = elliptope
    forged = with_root(replace(certificate, bound=INF, cutoff=None), empty=True)
    assert not forged.verify(problem).ok
    nothing = sp.Problem(
        x + y, [sp.psd(ROWS), sp.second_order(0.5, x + 3, y)], problem.lower, problem.upper
    )
    proof, _ = solved(nothing)
    assert proof.bound == INF
    assert not replace(proof, fingerprint=problem.fingerprint).verify(problem).ok


def test_emptiness_by_multipliers():
    """x + y <= (2 + 0.4)^(1/2) where x and y correlate with 1 and 0.2 with each other."""
    problem = sp.Problem(
        y, [sp.psd([[1, x, y], [x, 1, 0.2], [y, 0.2, 1]]), x + y >= 1.6], lower=-1, upper=1
    )
    scaled = Scaled.of(problem, scaling_of(problem), (problem.objective,))
    relaxation = sp.relax(scaled.problem, 1)
    solution = sp.solve_conic(sp.assemble(relaxation, scaled.problem.objective))
    assert solution.status == "infeasible"
    identity = identity_of(relaxation, scaled, solution.z, 1.0)
    replay = Replay(problem, None)
    box = Interval(problem.lower, problem.upper)
    proved = prove(replay, box, identity, True)
    assert proved.bound == INF
    certificate = certify(replay, Node(argument=identity, empty=True), proved)
    assert certificate is not None
    assert certificate.verify(problem).ok
