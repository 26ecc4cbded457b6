"""Certificates of problems with fewer constraints, restated for the whole problem."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py import Options, Problem
from sparsepop_py.bounding.subproblem import Restatement, Subproblem
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.certificate import Certificate, Node, prove
from sparsepop_py.verified.certificate.exact_dual import ExactDual
from sparsepop_py.verified.certificate.lp_dual import LinearDual
from sparsepop_py.verified.certificate.rational_gram import ExactGram
from sparsepop_py.verified.certificate.sos_identity import Identity
from sparsepop_py.verified.certificate.steps import (
    BoxProof,
    Known,
    Propagation,
    Replay,
    Tightening,
)

SKIPS = {
    "star": Options(effort="auto", skip=["linear", "linear_tree"], gap=1e-4),
    "linear": Options(
        effort="auto", skip=["star", "split", "mixed", "full", "linear_tree"], node_limit=8
    ),
    "tree": Options(effort="auto", skip=["full", "split", "linear_tree"], gap=1e-9, node_limit=8),
    "order 2": Options(effort="presolve", order=2),
}


def chain(samples=9, bound=0.1):
    """(y_k - e_k) = a (y_k-1 - e_k-1) + b u_k, a = .5, b = 1, noise-free."""
    theta = sp.variables(2 + samples)
    a, b, e = theta[0], theta[1], theta[2:]
    u = [1.0 if k % 3 else -0.5 for k in range(samples)]
    y = [0.0]
    for k in range(1, samples):
        y.append(0.5 * y[-1] + u[k])
    rows = [(y[k] - e[k]) - a * (y[k - 1] - e[k - 1]) - b * u[k] == 0 for k in range(1, samples)]
    low = np.r_[0.0, 0.0, np.full(samples, -bound)]
    return Problem(a, rows, low, np.r_[0.9, 2.0, np.full(samples, bound)])


@pytest.mark.parametrize("options", SKIPS.values(), ids=SKIPS)
@pytest.mark.parametrize("rows", [[0, 1, 2, 3, 4, 5, 6, 7], [2, 3, 4, 5], [1, 6]])
def test_a_restated_certificate_proves_its_bound_of_the_whole(options, rows):
    whole = chain()
    small = Subproblem.of(whole, np.array(rows), np.array([0, 1]))
    found = sp.solve(small.problem, options)
    box = Interval(whole.lower, whole.upper)
    again = small.restated(found.certificate, (), box)
    verdict = again.verify(whole)
    assert verdict.ok, verdict.reason
    assert found.lower_bound <= verdict.bound <= 0.5  # the truth is feasible
    assert len(list(again.root)) == len(list(found.certificate.root))


def test_tightenings_and_trees_are_restated():
    """Duals, identities, steps with a cutoff and branches, each numbered as in the whole."""
    whole = chain()
    small = Subproblem.of(whole, np.array([2, 3, 4, 5]), np.array([0, 1]))
    box = Interval(whole.lower, whole.upper)
    dual = sp.solve(small.problem, SKIPS["linear"]).certificate.root.argument
    identity = sp.solve(small.problem, SKIPS["star"]).certificate.root.argument
    assert isinstance(dual, LinearDual) and isinstance(identity, Identity)
    replay = Replay(small.problem, None)
    value = prove(replay, small.box(box), identity, False).bound
    one, side = np.array([0]), np.array([1])  # the objective is the first variable
    step = Tightening(one, side, np.array([value]), identity, False)
    ends = Node(argument=dual), Node(argument=identity)
    root = Node(BoxProof((step,)), branch=(1, 1.0), children=ends)
    found = Certificate(small.problem.fingerprint, value, root)
    assert found.verify(small.problem).ok
    again = small.restated(found, (), box)
    assert again.root.branch == (1, 1.0) and again.verify(whole).ok
    lone = replace(again, root=Node(again.root.box))
    assert lone.verify(whole).ok  # the step alone proves it
    cutoff = replace(step, uses_cutoff=True)  # one more row stands behind the constraints
    below = replace(found, root=Node(BoxProof((cutoff,))), cutoff=0.6)
    assert below.verify(small.problem).bound == small.restated(below, (), box).verify(whole).bound


@given(st.sets(st.integers(0, 7), min_size=1), st.floats(0.01, 0.3))
def test_variables_that_are_left_out_keep_their_ranges(rows, bound):
    whole = chain(bound=bound)
    small = Subproblem.of(whole, np.array(sorted(rows)))
    assert all(
        np.array_equal(
            small.problem.constraints[k].polynomial.coefficients,
            whole.constraints[row].polynomial.coefficients,
        )
        for k, row in enumerate(sorted(rows))
    )
    x = np.linspace(-0.4, 0.7, whole.dimension)
    ours = small.problem.rows.values(x[small.variables])
    assert np.array_equal(ours, whole.rows.values(x)[sorted(rows)])


def test_a_false_claim_is_not_made_true():
    whole = chain()
    small = Subproblem.of(whole, np.array([2, 3, 4, 5]), np.array([0, 1]))
    found = sp.solve(small.problem, SKIPS["star"]).certificate
    raised = replace(found, bound=found.bound + 0.01, cutoff=None)
    again = small.restated(raised, (), Interval(whole.lower, whole.upper))
    assert not again.verify(whole).ok


def test_steps_of_a_smaller_set_are_restated_for_a_larger_one():
    """What a set proves of the box, the set with more constraints and the whole prove, too."""
    whole = chain()
    small = Subproblem.of(whole, np.array([2, 3, 4, 5]), np.array([0, 1]))
    larger = Subproblem.of(whole, np.array([1, 2, 3, 4, 5, 7]), np.array([0, 1]))
    box = Interval(whole.lower, whole.upper)
    found = sp.solve(small.problem, SKIPS["star"])
    root, replay = found.certificate.root, Replay(small.problem, found.certificate.cutoff)
    value = prove(replay, root.box.replay(replay), root.argument, False).bound
    step = Tightening(np.array([0]), np.array([1]), np.array([value]), root.argument, False)
    assert value > 0.4
    inner = small.within(larger)
    assert inner.whole is larger.problem and inner.problem is small.problem
    for problem, way, start in ((larger.problem, inner, larger.box(box)), (whole, small, box)):
        steps = BoxProof(way.restated_steps((*root.box.steps, step), start))
        assert steps.replay(Replay(problem, found.certificate.cutoff), start).lo[0] >= value


def apart():
    """Two rows that share no variable, in the order of the second part's."""
    u, x, v, y = sp.variables(4)
    rows = [u * v >= 1, 3 * x + 3 * y >= 1]
    return Problem(x + y, rows, [0, 0, 0, -np.inf], [4, 9, 4, np.inf])


@pytest.mark.parametrize("bounds", [False, True])
def test_rational_multipliers_are_restated(bounds):
    """x + y is a third of its row; with x <= 9 also (x + y) >= 1/3 + (x - 9) - (x - 9)."""
    whole = apart()
    small = Subproblem.of(whole, np.array([1]))
    own, word = small.problem, np.zeros((1, 1), np.int32)
    row, value = np.array([0]), (Fraction(1, 3),)
    if bounds:  # a lower and an upper bound of x cancel each other, and cost 9
        row, word, value = np.array([0, 1, 3]), np.zeros((3, 1), np.int32), (*value, 1, 1)
    dual = ExactDual(own.lower, own.upper, row, word, value)
    proved = dual.bound(own.rows, own.equality, own.objective)
    assert proved == pytest.approx(1 / 3 - 9 * bounds)
    found = Certificate(own.fingerprint, proved, Node(argument=dual))
    again = small.restated(found, (), Interval(whole.lower, whole.upper))
    assert again.verify(whole).ok and again.verify(whole).bound == proved


def test_rational_multipliers_of_a_cutoff_are_restated():
    """x + y <= 1 and y >= -1 give x <= 2; the cutoff's row stands behind all constraints."""
    u, x, v, y = sp.variables(4)
    rows = [u * v >= 1, 3 * x + 3 * y >= 1]
    whole = Problem(x + y, rows, [0, 0, 0, -1], [4, 9, 4, 9])
    small = Subproblem.of(whole, np.array([1]))
    own = small.problem
    row, word = np.array([1, 3]), np.zeros((2, 1), np.int32)  # the cutoff, and y's lower bound
    dual = ExactDual(own.lower, own.upper, row, word, (1, 1))
    step = Tightening(np.array([0]), np.array([-1]), np.array([-2.0]), dual, True)
    inside = Replay(own, 1.0).step(step, Interval(own.lower, own.upper))
    assert inside.hi.tolist() == [2.0, 9.0]
    (again,) = Restatement(small, (), Interval(whole.lower, whole.upper)).steps((step,))
    found = Replay(whole, 1.0).step(again, Interval(whole.lower, whole.upper))
    assert found.hi.tolist() == [4.0, 2.0, 4.0, 9.0]


def test_exact_gram_matrices_are_restated():
    x, u, y = sp.variables(3)
    whole = Problem(5 + (x - 2 * y) ** 2, [u**2 <= 4])
    small = Subproblem.of(whole, np.zeros(0, np.int64))
    basis = np.array([[0], [1], [2]], np.int32)
    gram = ExactGram(basis, np.array([1, 1, 2]), np.array([1, 2, 2]), np.zeros(3))
    found = Certificate(small.problem.fingerprint, 5.0, Node(argument=gram))
    assert small.variables.tolist() == [0, 2] and found.verify(small.problem).ok
    again = small.restated(found, (), Interval(whole.lower, whole.upper))
    assert again.verify(whole).ok


def test_quoted_bounds_are_restated_once():
    """Two certificates quote the same one: its restatement is the same object."""
    whole = chain()
    small = Subproblem.of(whole, np.array([2, 3, 4, 5]), np.array([0, 1]))
    quoted = sp.solve(small.problem, SKIPS["star"]).certificate
    step = Known(((0, 1, quoted),))
    restatement = Restatement(small, (), Interval(whole.lower, whole.upper))
    one, other = restatement.steps((step,)), restatement.steps((step, Propagation(1, False)))
    assert one[0] is other[0] and isinstance(other[1], Propagation)
    ((variable, side, proof),) = one[0].bounds
    assert (variable, side) == (0, 1)
    replay = Replay(whole, None)
    box = replay.step(one[0], Interval(whole.lower, whole.upper))
    assert box.lo[0] == quoted.bound and proof.verify(replay.about(0, 1)).ok
