"""Threads of the compiled kernels, the vectors they work on, and the branches they share."""

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py import Problem
from sparsepop_py.solvers import cliquetree
from sparsepop_py.solvers.cliquetree import assembly
from sparsepop_py.solvers.cliquetree.cone import Cone
from sparsepop_py.solvers.cliquetree.kernels import Workers, compiled_kernels
from sparsepop_py.solvers.cliquetree.numbers import Numbers


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


def inside(cone, seed):
    """A point of the cone, and a direction."""
    rng = np.random.default_rng(seed)
    point, direction = cone.identity(), cone.identity()
    for s in cone.stacks:
        half = rng.normal(size=s.shape)
        point[s.span] = (half @ half.swapaxes(1, 2) + np.eye(s.size)).ravel()
        direction[s.span] = (half + half.swapaxes(1, 2)).ravel()
    return point, direction


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


def test_compiled_operations_on_blocks_are_those_of_numpy(blocks):
    compiled = Numbers.of(blocks, cliquetree.analyse(blocks, True)).cone
    plain = Cone(compiled.stacks, compiled.entries, compiled.linear)
    assert {6, 21} <= {s.size for s in plain.stacks}
    p, d = inside(plain, 0)
    z, _ = inside(plain, 1)
    factor = plain.inverse_factor(p)
    np.testing.assert_allclose(compiled.inverse_factor(p), factor, atol=1e-12)
    np.testing.assert_allclose(compiled.inverse(factor), plain.inverse(factor), atol=1e-12)
    np.testing.assert_allclose(compiled.sandwich(p, d, z), plain.sandwich(p, d, z), atol=1e-9)
    step, longest = (cone.largest_step(factor, d, 5.0, False) for cone in (compiled, plain))
    assert 0.998 * longest <= step <= longest
    plain.inverse_factor(p + step * d)  # raises outside the cone


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
