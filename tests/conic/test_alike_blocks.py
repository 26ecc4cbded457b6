"""Merged programs: what they say of the whole one, and chains that need no more than them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py import problems
from sparsepop_py.bounding import gram_rounding
from sparsepop_py.bounding.gram_rounding import exact_grams
from sparsepop_py.conic.alike_blocks import merge_alike_blocks


def program_of(objective, order):
    return sp.assemble(sp.relax(sp.Problem(objective), order), objective)


def copies(window, count, shared):
    """Sum a function of two variables over pairs that overlap in `shared` of them."""
    step = 2 - shared
    x = sp.variables(step * count + shared)
    return sum((window(*x[step * k : step * k + 2]) for k in range(count)), start=0 * x[0])


@given(
    st.lists(st.integers(-3, 3), min_size=6, max_size=6),
    st.integers(8, 20),
    st.sampled_from([0, 1]),
    st.integers(1, 3),
)
@settings(max_examples=20, deadline=None)
def test_multipliers_of_merged_blocks_hold_in_the_whole_program(values, count, shared, rounds):
    """Squares of integers have merged multipliers: each window's own Gram matrix."""
    a, b, c, d, e, f = values

    def window(x, y):
        return (a * x + b * y + c) ** 2 + (d * x * y + e * x**2 + f) ** 2 + x**4 + y**4

    program = program_of(copies(window, count, shared), 2)
    merged = merge_alike_blocks(program, 1.0, rounds)
    assert merged.program.cones.rows == merged.program.b.size <= program.b.size
    np.testing.assert_array_equal(merged.program.b[merged.row], program.b)
    found = sp.solve_conic(merged.program)
    assert found.status == "solved"
    z = found.z[merged.row]
    left = np.abs(program.q + program.A.T @ z).max()
    assert left <= found.residual + 1e-9 * (1.0 + np.abs(z).max())


@pytest.mark.parametrize("rounds", [1, 2])
def test_the_length_of_a_chain_does_not_count(rounds):
    sizes = set()
    for count in (30, 60, 120):
        program = program_of(problems.chained_singular(2 * count).objective, 2)
        small = merge_alike_blocks(program, 1.0, rounds).program
        sizes.add((small.q.size, small.b.size))
    assert len(sizes) == 1


def test_a_block_of_its_own_stays_one():
    """A chain of 40 alike windows, one of which has another coefficient."""
    chain = copies(lambda x, y: x**4 + (x - y) ** 2, 40, 1)
    other = chain + sp.variables(41)[20] ** 4
    kinds = [
        len(merge_alike_blocks(program_of(f, 2), 1.0).program.cones.psd) for f in (chain, other)
    ]
    assert kinds[0] < kinds[1] <= kinds[0] + 3  # it and its two neighbours


def test_too_many_rows_are_not_merged():
    program = program_of(problems.chained_singular(40).objective, 2)
    left = merge_alike_blocks(program, 1.0).program.b.size / program.b.size
    assert merge_alike_blocks(program, 1.01 * left) is not None
    assert merge_alike_blocks(program, 0.99 * left) is None


def test_programs_with_linear_rows_are_not_merged():
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, [x >= 0, y >= 0, x + y <= 1])
    program = sp.assemble(sp.relax(problem), problem.objective)
    assert program.cones.nonnegative
    assert merge_alike_blocks(program, 1.0) is None


def solved_sizes(monkeypatch):
    """Collect how many equations each conic program has that is solved from here on."""
    found, solve = [], gram_rounding.solve_conic

    def counting(program, *args):
        found.append(program.q.size)
        return solve(program, *args)

    monkeypatch.setattr(gram_rounding, "solve_conic", counting)
    return found


@pytest.mark.parametrize("make", [problems.chained_singular, problems.nondquar])
def test_long_chains_are_proved_by_small_programs(make, monkeypatch):
    """Optimum 0: Conn et al. (1988)."""
    problem, sizes = sp.Problem(make(400).objective), solved_sizes(monkeypatch)
    result = sp.solve(problem)
    assert result.lower_bound == 0.0
    assert result.certificate.verify(problem).ok
    assert len(sizes) == 1
    assert sizes[0] < 100


def test_what_merged_blocks_cannot_prove_is_proved_by_the_whole_program(monkeypatch):
    """Alike blocks of a x_i^2 + 2 x_i x_(i+1) need a >= 2, the matrix of n of them less.

    Its least eigenvalue is a - 2 cos(pi / (n + 1)).
    """
    n = 60
    x, sizes = sp.variables(n), solved_sizes(monkeypatch)
    a = 2.0 - 2.0**-10
    assert 2.0 > a > 2.0 * np.cos(np.pi / (n + 1))
    f = sum((a * v**2 for v in x), start=0 * x[0])
    f = f + sum((2.0 * v * w for v, w in zip(x, x[1:], strict=False)), start=0 * x[0])
    grams = list(exact_grams(f, sp.relax(sp.Problem(f), 1)))
    assert max(gram.bound(f) for gram in grams) == 0.0
    assert sizes[0] < 20 < n <= sizes[1]
