"""Forged trees: parts that are missing, empty by nothing, or beyond a cutoff prove nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.verified.arithmetic import interval
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.certificate.certificate import (
    Certificate,
    Node,
    Proved,
    certify,
    prove,
    split_box,
)
from sparsepop_py.verified.certificate.lp_dual import LinearDual
from sparsepop_py.verified.certificate.sos_identity import Identity, Multipliers
from sparsepop_py.verified.certificate.steps import BoxProof, Known, Propagation, Replay

INF = np.inf
x, y = sp.variables(2)
(z,) = sp.variables(1)


def line(low=0.0, high=1.0):
    """min z over [low, high] is low."""
    return sp.Problem(z, lower=low, upper=high)


def verdict(problem, root, bound=INF, cutoff=None, known=None):
    return Certificate(problem.fingerprint, bound, root, cutoff).verify(problem, known)


def cut(point, low, high, **fields):
    return Node(branch=(0, point), children=(low, high), **fields)


def close(bound, value):
    """At most the value that is attained, and hardly less."""
    return value - 1e-12 <= bound <= value


EMPTY = Node(BoxProof((Propagation(2, True),)))


# ---- claims -----------------------------------------------------------------------------------


@pytest.mark.parametrize("above", [1e-15, 1e-12, 5e-10, 1e-3, INF])
def test_a_claim_is_at_most_what_is_recomputed(above):
    problem = sp.Problem(z + 0.5, lower=0.25, upper=1)
    proved = verdict(problem, Node()).bound
    assert 0.75 - 1e-14 <= proved <= 0.75
    assert verdict(problem, Node(), proved).ok
    assert not verdict(problem, Node(), proved + above).ok


def test_a_certificate_is_about_its_problem():
    """The minimum of z over [0, 1] is not that over [-1, 1]."""
    certificate = Certificate(line().fingerprint, 0.0)
    assert certificate.verify(line()).ok
    for other in (line(-1.0), sp.Problem(z - 1, lower=0, upper=1), sp.Problem(2 * z, (), 0, 1)):
        found = certificate.verify(other)
        assert not found.ok and found.bound == -INF and "another problem" in found.reason


def test_what_is_known_of_one_objective_is_not_known_of_another():
    """One certificate without steps, quoted for x >= 0.2 and for -x >= 0.2."""
    problem = sp.Problem(x + y, [x >= 0.2 + 1e-9], lower=[-1, -1], upper=1)
    proof = Certificate("", 0.2, Node(BoxProof((Propagation(2, False),))))
    known = {}
    for quotes in (((0, 1, proof),), ((0, -1, proof),), ((1, 1, proof),), ((1, -1, proof),)):
        box = BoxProof((Known(quotes),)).replay(Replay(problem, None, known))
        assert box.lo[1] == -1.0 and box.hi.tolist() == [1.0, 1.0]
        assert box.lo[0] == (0.2 if quotes[0][:2] == (0, 1) else -1.0)


def test_a_certificate_that_quotes_itself_has_nothing_to_say():
    """min x over [-1, 1] is -1: 'x >= 1/2 because x >= 1/2'."""
    problem = sp.Problem(x + 0 * y, lower=-1, upper=1)
    claim = Certificate(problem.fingerprint, 0.5, Node())
    object.__setattr__(claim, "root", Node(BoxProof((Known(((0, 1, claim),)),))))
    assert close(claim.verify(problem).bound, -1.0)
    pair = [Certificate(problem.fingerprint, 0.5, Node()) for _ in range(2)]
    for one, other in (pair, pair[::-1]):
        object.__setattr__(one, "root", Node(BoxProof((Known(((0, 1, other),)),))))
    assert not pair[0].verify(problem).ok and pair[0].verify(problem).bound <= -1.0


# ---- parts ------------------------------------------------------------------------------------


@pytest.mark.parametrize("point", [0.5, 0.0, 1.0, -3.0, 7.0, 1e-300])
def test_the_worst_part_counts_wherever_it_stands(point):
    """min z (z - 1/2) over [0, 1] is -1/16; ranges of parts are below."""
    problem = sp.Problem(z * z - 0.5 * z, lower=0, upper=1)
    assert verdict(problem, cut(point, Node(), Node())).bound <= -1 / 16
    for order in ((Node(), cut(0.75, Node(), Node())), (cut(0.25, Node(), Node()), Node())):
        assert verdict(problem, cut(0.5, *order)).bound <= -1 / 16


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_both_parts_are_visited(sign):
    """min z and min -z over [-1, 1]: the worst point lies in the first or the second part."""
    problem = sp.Problem(sign * z, lower=-1, upper=1)
    for inner in (Node(), cut(0.25, Node(), Node()), cut(-0.25, Node(), Node())):
        for pair in ((inner, Node()), (Node(), inner)):
            assert close(verdict(problem, cut(0.0, *pair)).bound, -1.0)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_other_numbers_of_parts_are_no_tree(count):
    """What stands there is ignored, and the box itself proves what it does."""
    problem = line(-1.0)
    node = Node(branch=(0, 0.5), children=(Node(),) * count)
    assert close(verdict(problem, node).bound, -1.0)


@pytest.mark.parametrize("branch", [(0, np.nan), (0, INF), (0, -INF), (1, 0.5), (-1, 0.5)])
def test_malformed_branches_prove_nothing(branch):
    problem = sp.Problem(z, lower=0, upper=1)
    found = verdict(problem, Node(branch=branch, children=(EMPTY, EMPTY)), cutoff=-1.0)
    assert not found.ok and found.bound == -INF and "malformed" in found.reason


def test_parts_meet_at_the_branching_point():
    """The only feasible point is the branching point: both parts hold it, none is empty."""
    problem = sp.Problem(z, [z == 0.5], lower=0, upper=1)
    step = BoxProof((Propagation(3, False),))
    found = verdict(problem, cut(0.5, Node(step), Node(step)))
    assert not found.ok and found.bound <= 0.5
    for point in (0.5, -2.0, 3.0, 0.0, 1.0):
        low, high = split_box(Interval(np.zeros(1), np.ones(1)), (0, point))
        assert high.lo[0] <= max(0.0, point) and low.hi[0] >= min(1.0, point)
        assert low.lo[0] == 0.0 and high.hi[0] == 1.0


def test_parts_keep_what_their_parents_proved():
    """Half of [0, 4] below and half above, each with its own bound: z - z^2 over four parts."""
    problem = sp.Problem(z * z, lower=-2, upper=2)
    fine = cut(0.0, cut(-1.0, Node(), Node()), cut(1.0, Node(), Node()))
    assert verdict(problem, fine).bound == pytest.approx(0.0, abs=1e-12)
    product = sp.Problem(x * y, lower=[0, -1], upper=[1, 1])
    halves = Node(branch=(1, 0.0), children=(Node(), cut(0.5, Node(), Node())))
    assert verdict(product, halves).bound == pytest.approx(-1.0, abs=1e-12)
    assert verdict(product, halves).bound <= -1.0


# ---- cutoffs ----------------------------------------------------------------------------------


@pytest.mark.parametrize("level", [-1.0, -1e-9, -1e9])
def test_every_part_may_rest_on_the_cutoff(level):
    """Both parts are empty below the cutoff, or one of them; whichever is visited last."""
    problem = line()
    bare = Node()
    for pair in ((EMPTY, EMPTY), (EMPTY, bare), (bare, EMPTY)):
        found = verdict(problem, cut(0.5, *pair), cutoff=level)
        assert found.bound == level and not found.ok
        assert verdict(problem, cut(0.5, *pair), bound=level, cutoff=level).ok
    # without its use the cutoff limits nothing
    assert verdict(problem, cut(0.5, bare, bare), cutoff=level).bound == 0.0


@pytest.mark.parametrize("level", [np.nan, INF, -INF])
def test_cutoffs_are_numbers(level):
    found = verdict(line(), EMPTY, cutoff=level)
    assert found.bound == -INF and "not a number" in found.reason


def test_certify_names_the_cutoff_as_soon_as_one_part_uses_it():
    problem = line()
    for root in (cut(0.5, EMPTY, Node()), cut(0.5, Node(), EMPTY), EMPTY):
        made = certify(Replay(problem, -1.0), root, Proved(INF, 0.0, ""))
        assert made.bound == -1.0 and made.cutoff == -1.0 and made.verify(problem).ok
    free = certify(Replay(problem, -1.0), Node(), Proved(0.0, 0.0, ""))
    assert free.bound == 0.0 and free.cutoff is None
    assert certify(Replay(problem, None), Node(), Proved(-INF, 0.0, "")) is None


# ---- emptiness --------------------------------------------------------------------------------


def identity_of(problem, *groups):
    return Identity(Scaling.of_box(Interval(problem.lower, problem.upper)), groups)


def dual_of(problem):
    none = np.zeros(0, np.int64)
    return LinearDual(
        Scaling.of_box(Interval(problem.lower, problem.upper)),
        none,
        np.zeros((0, 1), np.int32),
        np.zeros(0),
        none,
        np.zeros((0, 2), np.int64),
    )


@pytest.mark.parametrize("low", [0.0, 0.5, -1.0])
def test_zero_is_no_proof_of_emptiness(low):
    """Multipliers of nothing prove 0 >= 0; that is no contradiction."""
    problem = line(low)
    for argument in (identity_of(problem), dual_of(problem), None):
        found = verdict(problem, Node(argument=argument, empty=True))
        assert not found.ok and found.bound <= low


def test_a_negative_bound_of_zero_is_no_proof_of_emptiness():
    """0 >= -1 by the square 1 taken off."""
    problem = line()
    one = Multipliers(np.array([0]), np.zeros((1, 1, 1), np.int32), np.ones((1, 1, 1)))
    found = verdict(problem, Node(argument=identity_of(problem, one), empty=True))
    assert not found.ok and found.bound <= 0.0


def test_a_positive_objective_is_no_proof_of_emptiness():
    """min z over [1, 2] is 1 > 0, by any argument."""
    problem = line(1.0, 2.0)
    for argument in (identity_of(problem), dual_of(problem)):
        assert verdict(problem, Node(argument=argument), 0.9).ok
        found = verdict(problem, Node(argument=argument, empty=True))
        assert not found.ok and found.bound <= 1.0


def test_only_empty_boxes_are_empty():
    problem = line()
    for low, high, bound in ((0.0, 1.0, 0.0), (0.5, 0.5, 0.5), (1.0, 0.5, INF)):
        box = Interval(np.array([low]), np.array([high]))
        found = prove(Replay(problem, None), box, None, False).bound
        assert found == bound if bound == INF else close(found, bound)
    pair = sp.Problem(x + y, lower=0, upper=1)
    box = Interval(np.array([0.0, 1.0]), np.array([1.0, 0.5]))  # one coordinate is enough
    assert prove(Replay(pair, None), box, None, False).bound == INF


# ---- arguments --------------------------------------------------------------------------------


def test_arguments_hold_on_the_box_of_their_scaling():
    """Multipliers that know z >= 1/2 say nothing about [0, 1]."""
    problem = line(0.0, 1.0)
    half = line(0.5, 1.0)
    for argument in (identity_of(half), dual_of(half)):
        assert verdict(half, Node(argument=argument), 0.4).ok
        found = verdict(problem, Node(argument=argument), 0.4)
        assert not found.ok and found.bound == 0.0
        stretched = replace(argument, scaling=replace(argument.scaling, boxed=np.zeros(1, bool)))
        assert not verdict(problem, Node(argument=stretched), 0.4).ok


def test_the_range_of_a_box_is_taken_at_its_lower_end():
    problem = sp.Problem(z * z * z, lower=-2, upper=1)
    found = verdict(problem, Node())
    assert -8.0 - 1e-12 <= found.bound <= -8.0


# ---- the process ------------------------------------------------------------------------------


def test_nothing_is_verified_where_subnormal_numbers_are_flushed(monkeypatch):
    problem = line()
    certificate = Certificate(problem.fingerprint, -1.0)
    assert certificate.verify(problem).ok
    monkeypatch.setattr(interval, "_TINY", 0.0)  # what a flushed product looks like
    with pytest.raises(FloatingPointError, match="IEEE"):
        certificate.verify(problem)
