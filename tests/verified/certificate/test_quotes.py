"""Bounds quoted from other certificates: what they prove, the shared memo, and storing them."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.sparsity.correlative import find_cliques
from sparsepop_py.tightening.mccormick import LinearRelaxation
from sparsepop_py.tightening.obbt_lp import tighten_bounds
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.certificate import Certificate, Node
from sparsepop_py.verified.certificate.steps import BoxProof, Known, Propagation, Replay

INF = np.inf


def known_set(least=0.5, dimension=2):
    """min x + y over x >= least in [-1, 1]^2 is least - 1; and a certificate of x >= least."""
    x, y = sp.variables(dimension)
    problem = sp.Problem(x + y, [x >= least], lower=-1, upper=1)
    about = problem.with_objective(x)
    root = Node(BoxProof((Propagation(3, False),)))
    return problem, Certificate(about.fingerprint, least - 1e-9, root)


def quoting(problem, *bounds):
    return Certificate(problem.fingerprint, -2.0, Node(BoxProof((Known(bounds),))))


def test_a_quoted_bound_shrinks_the_box():
    problem, proof = known_set()
    assert quoting(problem, (0, 1, proof)).verify(problem).bound == pytest.approx(-0.5, abs=1e-8)
    assert "1 bounds of other objectives" in str(quoting(problem, (0, 1, proof)))


@pytest.mark.parametrize("bound", [0.5 + 1e-9, 0.9, 2.0, 1e300, INF, np.nan, -INF])
def test_a_quoted_bound_that_is_false_or_no_number_is_ignored(bound):
    problem, proof = known_set()
    verdict = quoting(problem, (0, 1, replace(proof, bound=bound))).verify(problem)
    assert verdict.bound == pytest.approx(-2.0, abs=1e-12)
    cutoff = replace(proof, bound=bound, cutoff=0.25)  # its steps do not use the cutoff
    assert quoting(problem, (0, 1, cutoff)).verify(problem).bound <= -0.5


def test_a_quoted_bound_cannot_exceed_its_own_cutoff():
    problem, proof = known_set()
    root = Node(BoxProof((Propagation(3, True),)))
    for cutoff in (0.25, 0.0, -2.0):
        quoted = replace(proof, root=root, cutoff=cutoff)
        assert quoting(problem, (0, 1, quoted)).verify(problem).bound == pytest.approx(-2.0)
        low = replace(quoted, bound=cutoff)
        expected = max(cutoff, -1.0) - 1.0
        assert quoting(problem, (0, 1, low)).verify(problem).bound == pytest.approx(expected)


@pytest.mark.parametrize("variable", [-1, 2, 0.0, 0.5, True, None, np.array([0])])
def test_a_quoted_bound_of_no_variable_is_ignored(variable):
    problem, proof = known_set()
    assert quoting(problem, (variable, 1, proof)).verify(problem).bound <= -2.0


def test_one_proof_does_not_speak_for_other_variables_or_sides():
    """x >= 1/2 is proved; y >= 1/2, -x >= 1/2 and -y >= 1/2 are false."""
    problem, proof = known_set()
    everything = [(v, side, proof) for v in (0, 1) for side in (1, -1)]
    verdict = quoting(problem, *everything).verify(problem)
    assert verdict.bound == pytest.approx(-0.5, abs=1e-8)
    assert verdict.bound <= -0.5


def test_the_memo_of_one_feasible_set_says_nothing_about_another():
    problem, proof = known_set()
    wider, _ = known_set(0.0)
    for first, second in ((problem, wider), (wider, problem)):
        memo = {}
        for each, expected in ((first, None), (second, None), (first, None)):
            expected = -0.5 if each is problem else -2.0
            verdict = quoting(each, (0, 1, proof)).verify(each, memo)
            assert verdict.bound == pytest.approx(expected, abs=1e-8)
            assert verdict.bound <= expected
    # objectives over the same set do share it
    memo = {}
    quoting(problem, (0, 1, proof)).verify(problem, memo)
    filled = dict(memo)
    x, y = sp.variables(2)
    other = problem.with_objective(x - y)
    assert quoting(other, (0, 1, proof)).verify(other, memo).bound == pytest.approx(-0.5, abs=1e-8)
    about = [key for key in memo if id(proof) in key]
    assert about == [key for key in filled if id(proof) in key] and about


def test_what_was_checked_as_a_quote_is_not_checked_again(monkeypatch):
    problem, proof = known_set()
    about, memo = problem.with_objective(sp.variables(2)[0]), {}
    alone = proof.verify(about)
    quoting(problem, (0, 1, proof)).verify(problem, memo)
    forged = replace(proof, bound=0.75)  # another object: it is checked, and fails
    assert not forged.verify(about, memo).ok
    monkeypatch.setattr(BoxProof, "replay", None)  # a second replay would raise
    assert proof.verify(about, memo) == alone and alone.ok


def test_a_certificate_that_quotes_itself_proves_nothing_by_it():
    problem, _ = known_set()
    about = problem.with_objective(sp.variables(2)[0])
    claim = Certificate(about.fingerprint, 0.9, Node())
    object.__setattr__(claim, "root", Node(BoxProof((Known(((0, 1, claim),)),))))
    verdict = claim.verify(about)
    assert not verdict.ok and verdict.bound <= 0.5


def test_the_memo_of_tightened_boxes_belongs_to_their_feasible_set():
    x, y = sp.variables(2)
    rows = ([x + y >= 1.5, x * y <= 0.75], [x + y >= 0.5, x * y <= 0.75])
    box_problem, wide = (sp.Problem(x + 0 * y, row, lower=0, upper=1) for row in rows)
    box = Interval(box_problem.lower, box_problem.upper)
    mccormick = LinearRelaxation.of(box_problem, box, find_cliques(box_problem))
    _, step, _ = tighten_bounds(Replay(box_problem, None), mccormick, box, [0, 1])
    root, memo = Node(BoxProof((step,))), {}
    for problem, true in ((box_problem, 0.5), (wide, 0.0), (box_problem, 0.5)):
        found = Certificate(problem.fingerprint, 0.0, root).verify(problem, memo).bound
        assert found <= true
        assert found == pytest.approx(true, abs=1e-6)


def test_a_memo_keeps_its_arguments_alive():
    """Otherwise a later proof could be found at the place in memory of an earlier one."""
    problem, _ = known_set()
    memo = {}
    for k in range(200):
        true = k % 2 == 0
        _, proof = known_set()
        proof = proof if true else replace(proof, root=Node())
        verdict = quoting(problem, (0, 1, proof)).verify(problem, memo)
        expected = -0.5 if true else -2.0
        assert verdict.bound == pytest.approx(expected, abs=1e-8)
        del proof
    about = [key for key in memo if isinstance(key[-1], tuple)]
    assert len(about) == 200


@pytest.mark.slow
def test_deep_trees_and_long_chains_can_be_stored_and_printed():
    (x,) = sp.variables(1)
    problem = sp.Problem(x, lower=0, upper=1)
    node = Node(BoxProof((Propagation(1, False),)))
    for k in range(3000):
        node = Node(branch=(0, (k + 1) / 3002), children=(node, Node()))
    certificate = Certificate(problem.fingerprint, 0.0, node)
    for _ in range(300):  # each quotes the one before
        root = Node(BoxProof((Known(((0, 1, certificate),)),)))
        certificate = Certificate(problem.fingerprint, 0.0, root)
    for again in (pickle.loads(pickle.dumps(certificate)), copy.deepcopy(certificate)):
        assert again.verify(problem) == certificate.verify(problem) == (True, 0.0, "")
        for _ in range(300):
            ((variable, side, again),) = again.quotes
            assert (variable, side) == (0, 1)
        branches = [(node.branch, len(node.children), node.box.steps) for node in again.root]
        assert branches == [(n.branch, len(n.children), n.box.steps) for n in node]
    assert "1 bounds of other objectives" in repr(certificate)


def test_stored_results_share_what_they_quote():
    (x,) = sp.variables(1)
    problem = sp.Problem(x, lower=0, upper=1)
    quoted = Certificate(problem.fingerprint, 0.0)
    pair = [quoting(problem, (0, 1, quoted)) for _ in range(2)]
    one, other = pickle.loads(pickle.dumps(pair))
    assert one is not other
    assert one.quotes[0][2] is other.quotes[0][2]
