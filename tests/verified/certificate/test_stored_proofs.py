"""What certificates take: equal arrays are one object, what follows from the rest is not stored."""

from __future__ import annotations

import gc
import pickle
import weakref
from dataclasses import replace

import numpy as np
import pytest

import sparsepop_py as sp
from benchmarks.problems.identification import task as identification_context
from sparsepop_py.budget import Deadline
from sparsepop_py.context import SolveContext
from sparsepop_py.progress import Stages
from sparsepop_py.relaxation.recover_multipliers import identity_of, shortened
from sparsepop_py.verified.arithmetic.array_cache import indices, interned
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaled, Scaling
from sparsepop_py.verified.certificate.lp_dual import LinearDual
from sparsepop_py.verified.certificate.sos_identity import Multipliers
from sparsepop_py.verified.points.feasible_point import ProvedPoint


def test_equal_arrays_are_one_and_unequal_ones_are_not():
    given = np.arange(6)
    one = interned(given)
    assert interned(np.arange(6)) is one and one is not given
    for other in (np.arange(6.0), np.arange(6).reshape(2, 3), np.arange(6, dtype=np.int32)):
        assert interned(other) is not one
        assert interned(other).dtype == other.dtype and np.array_equal(interned(other), other)
    assert interned(np.arange(12)[::2]).tolist() == [0, 2, 4, 6, 8, 10]


def test_they_cannot_be_changed_and_what_was_given_can():
    given = np.arange(6)
    one = interned(given)
    given[0] = 7
    assert one[0] == 0
    with pytest.raises(ValueError, match="read-only"):
        one[0] = 7


def test_nothing_is_kept_that_nobody_holds():
    one = interned(np.arange(1234))
    gone = weakref.ref(one)
    del one
    gc.collect()
    assert gone() is None


def test_indices_are_short():
    found = indices(np.array([3, 1]))
    assert found.dtype == np.int32 and found.tolist() == [3, 1]


@pytest.mark.parametrize("kind, times", [("oe", 2), ("eiv", 4)])
def test_a_proof_is_at_most_a_few_times_the_data(kind, times):
    """All ten bounds of a record: what the proof of one takes, in multiples of the problem."""
    given = identification_context(kind, 20)
    options = sp.Options(effort="auto", gap_kind="width", gap=1e-3)
    results = sp.solve_each(given.problem, given.objectives, options)
    assert all(result.status is sp.Status.OPTIMAL for result in results)
    proofs = [result.certificate for result in results]
    together = len(pickle.dumps(proofs))
    assert together < sum(len(pickle.dumps(proof)) for proof in proofs)
    data = len(pickle.dumps(given.problem.constraints + given.objectives))
    assert together <= times * data * len(proofs)


@pytest.mark.parametrize("kind", ["full", "lower", "wide", "free", "flat"])
def test_multipliers_keep_every_number(kind):
    rng = np.random.default_rng(4)
    shape = {"full": (2, 3, 3), "lower": (2, 3, 2), "wide": (2, 2, 4), "free": (2, 3), "flat": (2,)}
    values = rng.normal(size=shape[kind]).astype(np.float32)
    values = np.tril(values) if kind in ("lower", "wide") else values
    basis = rng.integers(0, 3, (2, 3, 2)).astype(np.int32)
    given = Multipliers(np.arange(2), basis, values, 0.5, rng.integers(0, 2, (2, 3)))
    again = pickle.loads(pickle.dumps(given))
    for name in ("generator", "basis", "values", "place"):
        old, new = getattr(given, name), getattr(again, name)
        assert new.dtype == old.dtype and np.array_equal(new, old), name
    assert again.floor == 0.5


def test_the_zeros_above_a_diagonal_are_not_stored():
    values = np.random.default_rng(0).normal(size=(50, 10, 10))
    basis = np.zeros((50, 10, 1), np.int32)
    full, lower = (
        len(pickle.dumps(Multipliers(np.arange(50), basis, v))) for v in (values, np.tril(values))
    )
    assert 0 <= 50 * 45 * 8 - (full - lower) < 100  # but for the shape


@pytest.mark.parametrize("kind", [np.int32, np.int64])
@pytest.mark.parametrize(
    "owner, word",
    [
        ([0, 0, 2], [[0], [0], [0]]),  # in order, one owner without any, all constant
        ([2, 0, 0], [[0], [0], [0]]),
        ([0, 1, 1], [[0], [1], [0]]),
        ([0, 1, 2**31 - 1], [[0], [0], [0]]),  # nobody counts that far
        ([-1, 0, 1], [[0, 1], [0, 0], [0, 0]]),
        ([[0], [0], [1]], [[0]]),  # malformed
    ],
)
def test_linear_duals_keep_every_number(kind, owner, word):
    problem = sp.Problem(sp.variables(2)[0], lower=0, upper=1)
    owner, word = np.array(owner).astype(kind), np.array(word).astype(kind)
    scaling = Scaling.of_box(Interval(problem.lower, problem.upper))
    values, products = np.array([0.5, 1.0, 2.0]), np.zeros((0, 2), np.int64)
    given = LinearDual(scaling, np.array([1, 2, 3]), word, values, owner, products)
    again = pickle.loads(pickle.dumps(given))
    for name in ("generator", "word", "value", "owner", "products"):
        old, new = getattr(given, name), getattr(again, name)
        assert new.dtype == old.dtype and np.array_equal(new, old), name


@pytest.mark.parametrize("seed", range(4))
def test_short_factors_are_triangular_and_have_the_same_squares(seed):
    rng = np.random.default_rng(seed)
    x, y = sp.variables(2)
    problem = sp.Problem(x * y - y, [x**2 + y**2 <= 1, x**2 * y == 0.25], lower=-1, upper=1)
    scaled = Scaled.of(
        problem, Scaling.of_box(Interval(problem.lower, problem.upper)), (problem.objective,)
    )
    relaxation = sp.relax(scaled.problem, 2)
    z = rng.normal(size=relaxation.rows)
    long = identity_of(relaxation, scaled, z, 1.0)
    short = shortened(long, 1e-30)
    of_blocks = {m.generator.tobytes(): m for m in short.multipliers if not m.free}
    pairs = [
        (m, of_blocks[m.generator.tobytes()])
        for m in long.multipliers
        if not m.free and m.generator.tobytes() in of_blocks
    ]
    assert pairs
    for a, b in pairs:
        assert not np.any(b.values[:, ~np.tri(*b.values.shape[1:], dtype=bool)])
        size = np.abs(a.values).max() ** 2 * a.values.shape[2]
        whole, small = (v @ np.swapaxes(v, 1, 2) for v in (a.values, b.values.astype(float)))
        assert np.abs(whole - small).max() <= 1e-6 * size


@pytest.mark.parametrize("effort", ["presolve", "auto"])
def test_malformed_products_and_empty_multipliers_are_refused(effort):
    """Arrays of no dimension, and tables that no memory holds, end in a verdict."""
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, [x**2 + y**2 <= 1], lower=-1, upper=1)
    options = sp.Options(effort=effort, skip=("linear_tree",))  # one node, with squares
    given = sp.solve(problem, options).certificate
    identity = given.identity
    assert identity is not None and given.verify(problem).ok
    unbounded = Multipliers(
        np.zeros(0, int), np.zeros((0, 10**9, 1), np.int32), np.zeros((0, 10**9, 1))
    )
    for wrong in (
        replace(identity, products=np.array(3)),
        replace(identity, multipliers=(*identity.multipliers, unbounded)),
    ):
        forged = replace(given, root=replace(given.root, argument=wrong))
        again = pickle.loads(pickle.dumps(forged))
        assert not forged.verify(problem).ok and not again.verify(problem).ok


def test_later_points_do_not_spoil_what_shorter_multipliers_keep():
    """A far first point makes the allowed gap large; what a bound may lose does not follow it."""
    x = sp.variables(1)[0]
    problem = sp.Problem(x**2, lower=-100, upper=100)
    options, none = sp.Options(effort="auto", gap=1e-3), np.zeros(0, int)
    context = SolveContext(problem, options, Stages(False), Deadline(None))
    assert context.enough(-5.0) == -5.0  # nothing is known of the gap
    context = replace(context, best=ProvedPoint(np.array([100.0]), 1e4, 0.0, "exact", none, none))
    assert context.allowed == 10.0 and context.enough(-5.0) == -5.0 - 1e-5
    assert context.enough(9999.0) == context.target and context.enough(np.inf) == np.inf
    assert replace(context, unit=0.5).enough(-5.0) == -5.0 - 0.5e-5
