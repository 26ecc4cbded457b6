"""Certificates with trees: bounds that a tree proves, and damaged trees that prove none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_cases import SEEDS, random_case

import sparsepop_py as sp
from sparsepop_py.problem import generators
from sparsepop_py.sparsity.correlative import find_cliques
from sparsepop_py.tightening.mccormick import LinearRelaxation
from sparsepop_py.tightening.obbt_lp import tighten_bounds
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.certificate.certificate import Certificate, Node, split_box
from sparsepop_py.verified.certificate.lp_dual import LinearDual
from sparsepop_py.verified.certificate.steps import BoxProof, Propagation, Replay, Tightening

INF = np.inf
POOLING = Path(__file__).resolve().parents[3] / "examples" / "problems" / "pooling.gms"
quick = settings(max_examples=10, deadline=None)


def branched(node, branch, low, high):
    return replace(node, argument=None, empty=False, branch=branch, children=(low, high))


def linear_node(problem, box, cutoff, deep, rng):
    """Make a random subtree: propagation, bound tightening, multipliers, and branching."""
    replay = Replay(problem, cutoff)
    steps = [Propagation(int(rng.integers(0, 3)), bool(rng.integers(2)))]
    box = replay.step(steps[0], box)
    node = Node(BoxProof(tuple(steps)))
    if is_empty(box):
        return node
    mccormick = LinearRelaxation.of(problem, box, find_cliques(problem))
    if rng.integers(2):
        box, step, _ = tighten_bounds(replay, mccormick, box, range(problem.dimension))
        node = replace(node, box=BoxProof((*steps, *([step] if step else []))))
    if deep and not is_empty(box):
        v = int(rng.integers(problem.dimension))
        place = float(rng.uniform(box.lo[v], box.hi[v]))
        low, high = (
            linear_node(problem, h, cutoff, deep - 1, rng) for h in split_box(box, (v, place))
        )
        return branched(node, (v, place), low, high)
    solution = mccormick.minimise()
    dual = mccormick.objective_dual(solution)
    return replace(node, argument=dual, empty=solution.status == "infeasible")


def random_tree(problem, cutoff, rng, deep=2):
    root = linear_node(problem, Interval(problem.lower, problem.upper), cutoff, deep, rng)
    return Certificate(problem.fingerprint, -INF, root, cutoff)


def changed(node, number, change):
    """The tree with one node, counted from the root, replaced by ``change`` of it."""
    count = -1

    def visit(node):
        nonlocal count
        count += 1
        if count == number:
            return change(node)
        return replace(node, children=tuple(visit(child) for child in node.children))

    return visit(node)


# ---- what a tree proves -----------------------------------------------------------------------


PLACES = st.floats(-10, 10) | st.sampled_from([-1e308, 1e308, 5e-324, -0.0])


@given(SEEDS, PLACES)
@quick
def test_the_halves_cover_the_box_wherever_the_branching_point_is(seed, place):
    rng = np.random.default_rng(seed)
    low = rng.integers(-3, 1, 2).astype(float)
    box = Interval(low, low + rng.integers(0, 4, 2))
    v = int(rng.integers(2))
    halves = split_box(box, (v, place))
    axes = [
        np.unique(np.append(np.linspace(a, b, 9), place))
        for a, b in zip(box.lo, box.hi, strict=True)
    ]
    points = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    inside = [np.all((points >= p.lo) & (points <= p.hi), axis=1) for p in (box, *halves)]
    assert np.array_equal(inside[0], inside[1] | inside[2])
    for half in halves:
        assert is_empty(half) or np.all((half.lo >= box.lo) & (half.hi <= box.hi))
    if not is_empty(halves[0]):
        assert halves[0].hi[v] <= max(place, box.lo[v])
    assert halves[1].lo[v] >= min(place, box.hi[v])


@pytest.mark.parametrize("deep", [0, 1, 3, 6])
def test_bisection_proves_the_least_range_of_its_leaves(deep):
    """x^2 - x over [a, b] in [0, 1] has the interval range [a^2 - b, b^2 - a]."""
    (x,) = sp.variables(1)
    problem = sp.Problem(x**2 - x, lower=0, upper=1)

    def bisected(a, b, left):
        middle = (a + b) / 2
        if not left:
            return Node()
        low, high = bisected(a, middle, left - 1), bisected(middle, b, left - 1)
        return Node(branch=(0, middle), children=(low, high))

    certificate = Certificate(problem.fingerprint, -2.0, bisected(0.0, 1.0, deep))
    edges = np.arange(2**deep + 1) / 2**deep
    verdict = certificate.verify(problem)
    assert verdict.ok
    assert certificate.leaves == 2**deep
    expected = (edges[:-1] ** 2 - edges[1:]).min()
    assert verdict.bound <= expected
    assert verdict.bound == pytest.approx(expected, abs=1e-14)


@given(SEEDS)
@quick
def test_trees_of_linear_relaxations_stay_below_the_truth(seed):
    case, rng = random_case(seed), np.random.default_rng([seed, 5])
    cutoffs = [None, case.least, case.least - 0.25, float(np.median(case.values))]
    cutoff = cutoffs[int(rng.integers(4))]
    tree = random_tree(case.problem, cutoff, rng)
    verdict = tree.verify(case.problem)
    assert verdict.ok
    assert verdict.bound <= case.least
    assert cutoff is None or not tree.uses_cutoff or verdict.bound <= cutoff
    assert tree.verify(case.problem) == verdict


def test_a_tree_reaches_what_one_node_does_not():
    """min x y over x + y >= 1/2 in [-1, 1]^2: -1/2 at (1, -1/2), on the edge x = 1."""
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, [x + y >= 0.5], lower=-1, upper=1)
    rng = np.random.default_rng(0)
    one = random_tree(problem, None, rng, 0).verify(problem).bound
    many = random_tree(problem, -0.5, rng, 7).verify(problem).bound
    assert one < many <= -0.5
    assert many > -0.51


@pytest.mark.parametrize("cutoff", [0.5, 2.0, -1.0, None])
def test_a_tightened_box_may_rest_on_the_cutoff(cutoff):
    """On the unit box x + y <= w gives x <= w: -x = (w - x - y) + y - w."""
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, lower=0, upper=1)
    box = Interval(problem.lower, problem.upper)
    _, low, _ = generators.bound_family(1, 2)  # the cutoff is row 1; 1 + t is 2 y
    dual = LinearDual(
        Scaling.of_box(box),
        np.array([1, low.start + 1]),
        np.zeros((2, 1), np.int32),
        np.array([1.0, 0.5]),
        np.zeros(2, int),
        np.zeros((0, 2), int),
    )
    claim = np.array([-(cutoff or 0.0) - 1e-9])
    step = Tightening(np.array([0]), np.array([-1]), claim, dual, True)
    root = Node(BoxProof((step,)))
    found = root.box.replay(Replay(problem, cutoff))
    assert found.hi[0] == (1.0 if cutoff is None else min(1.0, -claim[0]))
    verdict = Certificate(problem.fingerprint, INF, root, cutoff).verify(problem)
    assert not verdict.ok
    assert verdict.bound == (-1.0 if cutoff == -1.0 else pytest.approx(0.0, abs=1e-12))
    assert verdict.bound <= 0.0
    # half a unit more than that is not proved, and without the cutoff nothing is
    greedy = replace(step, value=claim + 0.5)
    assert BoxProof((greedy,)).replay(Replay(problem, cutoff)).hi[0] == 1.0
    bare = replace(step, uses_cutoff=False)
    assert BoxProof((bare,)).replay(Replay(problem, cutoff)).hi[0] == 1.0


# ---- damage -----------------------------------------------------------------------------------


def damages(tree, rng):
    """Damaged roots: each changes one node of the tree."""
    nodes = list(tree)
    number = int(rng.integers(len(nodes)))
    other = nodes[int(rng.integers(len(nodes)))]
    nonsense = [np.nan, INF, -INF, 1e300, -1e300, 3.5]
    yield changed(tree, number, lambda n: replace(n, children=n.children[::-1]))
    yield changed(tree, number, lambda n: replace(n, children=n.children[:1]))
    yield changed(tree, number, lambda n: replace(n, children=()))
    yield changed(tree, number, lambda n: replace(n, children=(*n.children, Node())))
    yield changed(tree, number, lambda n: replace(n, branch=None))
    yield changed(tree, number, lambda n: replace(n, box=BoxProof()))
    yield changed(tree, number, lambda n: replace(n, box=other.box))
    yield changed(tree, number, lambda n: replace(n, empty=not n.empty))
    yield changed(tree, number, lambda n: replace(n, argument=other.argument, empty=other.empty))
    yield changed(tree, number, lambda n: other)
    for place in nonsense:
        yield changed(tree, 0, lambda n, p=place: branched(n, (0, p), Node(), other))
        yield changed(
            tree, number, lambda n, p=place: n.branch and replace(n, branch=(n.branch[0], p)) or n
        )
    for variable in (-1, 17, 0.0, 0.5, True, None):
        yield changed(tree, 0, lambda n, v=variable: branched(n, (v, 0.0), other, Node()))


@given(SEEDS)
@quick
def test_damaged_trees_stay_below_the_truth_and_raise_nothing(seed):
    case, rng = random_case(seed), np.random.default_rng([seed, 6])
    cutoff = None if rng.integers(2) else float(rng.choice(case.values))
    tree = random_tree(case.problem, cutoff, rng)
    for root in damages(tree.root, rng):
        damaged = replace(tree, root=root, bound=INF)
        verdict = damaged.verify(case.problem)
        assert not verdict.ok
        assert verdict.reason
        assert verdict.bound <= case.least


def test_a_malformed_branch_proves_nothing_even_if_the_leaves_would():
    (x,) = sp.variables(1)
    problem = sp.Problem(x, lower=0, upper=1)
    for branch in ((0, np.nan), (0, INF), (-1, 0.5), (1, 0.5), (True, 0.5), (0.0, 0.5)):
        root = Node(branch=branch, children=(Node(), Node()))
        verdict = Certificate(problem.fingerprint, -1.0, root).verify(problem)
        assert verdict == (False, -INF, "a branch is malformed")


@pytest.mark.parametrize("side", [0, 1])
def test_a_tree_of_five_thousand_levels_needs_no_recursion(side):
    (x,) = sp.variables(1)
    problem = sp.Problem(x, lower=0, upper=1)
    node = Node(BoxProof((Propagation(1, True),)))
    for k in range(5000):
        place = (k + 1) / 5002
        children = (node, Node()) if side == 0 else (Node(), node)
        node = Node(branch=(0, place if side == 0 else 1 - place), children=children)
    certificate = Certificate(problem.fingerprint, 0.0, node, 2.0)
    verdict = certificate.verify(problem)
    assert verdict.ok
    assert verdict.bound == 0.0
    assert certificate.leaves == 5001
    assert certificate.uses_cutoff
    assert "5001 leaves" in str(certificate)


# ---- trees of the solver ----------------------------------------------------------------------


@pytest.fixture(scope="module")
def pooled():
    """A pooling problem whose maximum is 700 by hand, as a minimum -700.

    Work is counted in place of time, so that a loaded machine takes the same path to a tree.
    """
    problem = sp.read_gms(POOLING)
    options = sp.Options(effort="auto", order=1, node_limit=200, work_limit=np.inf)
    return problem, sp.solve(problem, options)


def test_the_tree_of_a_pooling_problem_verifies(pooled):
    problem, result = pooled
    assert result.lower_bound <= -700.0 <= result.upper_bound
    assert result.lower_bound == pytest.approx(-700.0, abs=1e-2)
    certificate = result.certificate
    assert certificate.leaves > 1
    verdict = certificate.verify(problem)
    assert verdict.ok
    assert verdict.bound <= min(-700.0, certificate.cutoff)


def test_damage_to_the_tree_of_a_pooling_problem_is_harmless(pooled):
    problem, result = pooled
    certificate = result.certificate
    for seed in range(2):
        for root in damages(certificate.root, np.random.default_rng(seed)):
            verdict = replace(certificate, root=root).verify(problem)
            assert verdict.bound <= min(-700.0, certificate.cutoff)
    for cutoff in (-701.0, -699.0, 0.0):
        assert replace(certificate, cutoff=cutoff).verify(problem).bound <= min(-700.0, cutoff)
    assert not replace(certificate, cutoff=None).verify(problem).ok
