"""Threads of the compiled kernels, the vectors they work on, and the branches they share."""

import numpy as np
import pytest
from scipy.linalg import eigh

import sparsepop_py as sp
from sparsepop_py import Problem
from sparsepop_py.solvers import cliquetree
from sparsepop_py.solvers.cliquetree.iterations.numbers import Numbers
from sparsepop_py.solvers.cliquetree.kernels.batched import Workers, compiled_kernels
from sparsepop_py.solvers.cliquetree.symbolic import assembly


@pytest.fixture(scope="module")
def blocks():
    """Quartics on two cliques of five that share a variable: blocks of 6 and 21."""
    compiled_kernels()
    x = sp.variables(9)
    parts = [
        (sp.total([0.2 * (k + 1) * v for k, v in enumerate(x[i : i + 5])]) ** 2 - 1) ** 2
        for i in (0, 4)
    ]
    f = sp.total([*parts, *(0.1 * v for v in x)])
    return sp.assemble(sp.relax(Problem(f, [x[0] + x[1] <= 1.5], -1, 1), 2), f)


@pytest.fixture(scope="module")
def equal_blocks():
    """Rosenbrock's function in 20 variables: 19 blocks of 6 and 19 of 3 in each of two patterns."""
    f = sp.problems.rosenbrock(20).objective
    return sp.assemble(sp.relax(Problem(f, lower=-1, upper=1), 2), f)


def inside(stack, seed):
    """Points of the cone, and directions."""
    half = np.random.default_rng(seed).normal(size=stack.shape)
    return half @ half.swapaxes(1, 2) + np.eye(stack.size), half + half.swapaxes(1, 2)


@pytest.mark.parametrize("threads", [2, 3])
def test_threads_change_no_bit(blocks, threads, monkeypatch):
    monkeypatch.setattr(assembly, "_PART", 100.0)  # many parts, however small
    monkeypatch.setattr(assembly, "_HELD", 300)
    one, several = (
        cliquetree.run(blocks, settings=cliquetree.Settings(kernels="numba", threads=k)).solution
        for k in (1, threads)
    )
    assert one.status == several.status == "solved"
    np.testing.assert_array_equal(one.z, several.z)
    np.testing.assert_array_equal(one.y, several.y)


@pytest.mark.parametrize(
    "program, kinds",
    [("blocks", {(6, 1), (21, 1)}), ("equal_blocks", {(3, 1), (6, 1), (3, 8), (6, 8)})],
)
def test_compiled_operations_on_blocks_are_those_of_numpy(program, kinds, request):
    program = request.getfixturevalue(program)
    cone = Numbers.of(program, cliquetree.analyse(program, True)).cone
    assert {(s.size, s.lanes) for s in cone.stacks} == kinds
    p, d, z = (np.empty(cone.entries + cone.linear) for _ in range(3))
    p[:], d[:], z[:] = 1.0, 0.0, 1.0  # linear rows
    longest = 5.0
    for k, s in enumerate(cone.stacks):
        (point, change), other = inside(s, k), inside(s, k + 100)[0]
        p[s.span], d[s.span], z[s.span] = map(s.entries, (point, change, other))
        np.testing.assert_array_equal(s.matrices(p), point)
        least = eigvalsh_pairs(change, point)
        longest = min(longest, -1.0 / least) if least < 0 else longest
    factor = cone.inverse_factor(p)
    inverse, product = cone.inverse(factor), cone.sandwich(p, d, z)
    for s in cone.stacks:
        P, D, Z, F = (s.matrices(x) for x in (p, d, z, factor))
        np.testing.assert_allclose(F, np.linalg.inv(np.linalg.cholesky(P)), atol=1e-12)
        np.testing.assert_allclose(s.matrices(inverse), np.linalg.inv(P), atol=1e-12)
        expected = (P @ D @ Z + Z @ D @ P) / 2
        np.testing.assert_allclose(s.matrices(product), expected, atol=1e-9)
    step = cone.largest_step(factor, d, 5.0, False)
    assert 0.998 * longest <= step <= longest
    cone.inverse_factor(p + step * d)  # raises outside the cone


def eigvalsh_pairs(directions, points):
    """The least generalized eigenvalue of all pairs."""
    return min(eigh(d, p, eigvals_only=True)[0] for d, p in zip(directions, points, strict=True))


def test_branches_and_trunk_are_all_fronts_once(blocks):
    tree = cliquetree.analyse(blocks, True).tree
    parts = sorted([*tree.branches, *tree.trunk])
    assert [k for low, high in parts for k in range(low, high)] == list(range(tree.pivots.size))
    for low, high in tree.branches:  # a subtree: nothing but its root has a parent outside
        assert all(low < above < high for above in tree.parent[low : high - 1])


def test_an_error_in_one_part_is_raised_after_all_have_ended():
    workers, done = Workers(2), []

    def work(part):
        done.append(part)
        if part == 0:
            raise np.linalg.LinAlgError("not definite")

    with pytest.raises(np.linalg.LinAlgError, match="not definite"):
        workers.each(work, range(5))
    workers.close()
    assert sorted(done) == list(range(5))


def test_threads_are_at_least_one(blocks):
    with pytest.raises(ValueError, match="threads: found 0"):
        cliquetree.run(blocks, settings=cliquetree.Settings(threads=0))
