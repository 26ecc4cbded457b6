"""Atoms of known measures are recovered from their moments."""

from itertools import pairwise

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.algebra import monomials
from sparsepop_py.local_search.extraction import candidates, combine, extract, means

ATOMS = {
    (1, 1): [[0.3]],
    (1, 2): [[-0.5], [0.75]],
    (1, 3): [[-0.8], [0.1], [0.9]],
    (2, 1): [[0.2, -0.7]],
    (2, 2): [[1.0, -1.0], [-1.0, -1.0]],
    (2, 3): [[0.5, 0.5], [-0.5, 0.5], [0.1, -0.9]],
    (3, 1): [[0.0, 0.0, 0.0]],
    (3, 2): [[0.0, 0.4, 1.0], [0.0, 0.4, -1.0]],
    (3, 3): [[0.5, -0.3, 0.1], [0.2, 0.9, -0.6], [-0.9, -0.2, 0.7]],
}


def moments(atoms, weights, basis):
    """Moment matrix of an atomic measure, in local variables."""
    rows = monomials.evaluate(basis, np.array(atoms, float))
    return rows.T @ (np.array(weights)[:, None] * rows)


def atoms_of(matrix, basis):
    return extract(matrix[None], basis)[0]


def order_needed(k, count):
    return 3 if k == 1 and count == 3 else 2


def matched(found, atoms, tolerance):
    assert len(found) == len(atoms)
    return all(min(np.abs(np.array(found) - a).max(axis=1)) < tolerance for a in np.array(atoms))


@pytest.mark.parametrize(("k", "count"), list(ATOMS))
@pytest.mark.parametrize("noise", [0.0, 1e-7])
def test_atoms_are_recovered(k, count, noise):
    atoms = ATOMS[k, count]
    basis = monomials.full_basis(k, order_needed(k, count))
    weights = np.arange(count, 0, -1) / (count * (count + 1) / 2)
    matrix = moments(atoms, weights, basis)
    matrix += noise * np.random.default_rng(0).uniform(-1, 1, matrix.shape)
    found = atoms_of(matrix, basis)
    assert matched(found, atoms, 1e-9 if noise == 0 else 1e-4)
    assert np.allclose(found, atoms, atol=1e-4)  # by falling weight


def test_scale_of_the_measure_does_not_matter():
    basis = monomials.full_basis(2, 2)
    matrix = 7 * moments(ATOMS[2, 3], [0.3, 0.3, 0.4], basis)
    assert matched(atoms_of(matrix, basis), ATOMS[2, 3], 1e-8)


def test_order_one_is_flat_only_for_one_atom():
    basis = monomials.full_basis(2, 1)
    assert matched(atoms_of(moments([[0.2, 0.3]], [1], basis), basis), [[0.2, 0.3]], 1e-9)
    spread = atoms_of(moments([[1, 0], [-1, 0.5]], [0.5, 0.5], basis), basis)
    assert matched(spread, [[0.0, 0.25]], 1e-12)


def test_not_flat_falls_back_to_first_moments():
    basis = monomials.full_basis(1, 1)
    found = atoms_of(np.array([[1.0, 0.25], [0.25, 1.0]]), basis)
    assert np.allclose(found, [[0.25]])
    uniform = np.array([[1, 0, 1 / 3], [0, 1 / 3, 0], [1 / 3, 0, 1 / 5]])
    assert np.allclose(atoms_of(uniform, monomials.full_basis(1, 2)), [[0.0]])


def test_reduced_basis_still_gives_atoms_when_enough_is_left():
    # x1 x2 is dropped: 1 and x1 keep x1^2, but their products with x2 are gone
    full = monomials.full_basis(2, 2)
    basis = full[[0, 1, 2, 3, 5]]
    atoms = [[0.5, 0.2], [-0.5, 0.1]]
    found = atoms_of(moments(atoms, [0.5, 0.5], basis), basis)
    assert matched(found, [[0.0, 0.15]], 1e-12)  # rank 2, only "1" can be multiplied
    one = atoms_of(moments(atoms[:1], [1.0], basis), basis)
    assert matched(one, atoms[:1], 1e-9)


def test_useless_matrices_give_unknown_points():
    basis = monomials.full_basis(1, 1)
    for matrix in (np.full((2, 2), np.nan), np.zeros((2, 2))):
        (point,) = atoms_of(matrix, basis)
        assert np.all(np.isnan(point))


def test_combine_follows_the_overlap():
    first = [np.array([1.0, 2.0]), np.array([5.0, 6.0])]
    second = [np.array([6.0, 7.0]), np.array([2.0, 3.0])]
    third = [np.array([3.0, 0.0]), np.array([7.0, 1.0]), np.array([7.0, 2.0])]
    found = combine([first, second, third], [(0, 1), (1, 2), (2, 3)], 4)
    assert sorted(p.tolist() for p in found) == [[1, 2, 3, 0], [5, 6, 7, 1], [5, 6, 7, 2]]


def test_combine_limits_the_number_and_keeps_variety():
    both = [np.array([-1.0]), np.array([1.0])]
    found = combine([both] * 50, [(k,) for k in range(50)], 50)
    assert len(found) == 16
    table = np.array(found)
    assert np.all(np.abs(table) == 1)
    assert np.all(np.abs(table[:, 10:].mean(axis=1)) < 1)  # not the first candidate everywhere
    assert len(np.unique(table, axis=0)) == 16


def test_combine_averages_what_disagrees():
    (found,) = combine([[np.array([0.0, 1.0])], [np.array([3.0, 2.0])]], [(0, 1), (1, 2)], 3)
    assert np.allclose(found, [0.0, 2.0, 2.0])


def test_combine_fills_what_is_unknown():
    unknown = [np.array([np.nan, 4.0])]
    (found,) = combine([unknown, [np.array([2.0])], []], [(0, 1), (0,), (2,)], 4)
    assert found.tolist() == [2.0, 4.0, 0.0, 0.0]


def test_combine_of_consistent_cliques_of_a_long_chain():
    n = 2000
    x = np.random.default_rng(3).normal(size=n)
    members = [(k, k + 1) for k in range(n - 1)]
    (found,) = combine([[x[list(m)]] for m in members], members, n)
    assert np.allclose(found, x)


# (x^2 - 4)^2 + (x y + 2)^2 + (y z - 3)^2 + (w - 1)^4 + (v^2 - 1)^2 is least at x = 2 s, y = -s,
# z = -3 s, w = 1, v = t with signs s and t; moments of all four minimisers say nothing of either
MINIMISER = np.array([2.0, -1.0, -3.0, 1.0, 1.0])


@pytest.mark.parametrize("read", [means, lambda *given: candidates(*given)[0]])
def test_variables_of_both_signs_are_roots_whose_products_agree(read):
    x, y, z, w, v = sp.variables(5)
    f = (x**2 - 4) ** 2 + (x * y + 2) ** 2 + (y * z - 3) ** 2 + (w - 1) ** 4 + (v**2 - 1) ** 2
    relaxation = sp.relax(sp.Problem(f), 2, terms="sign")
    signs = np.array([[s, s, s, 1.0, t] for s in (1.0, -1.0) for t in (1.0, -1.0)])
    moments = monomials.evaluate(relaxation.moments, signs * MINIMISER).mean(axis=0)
    found = read(relaxation, moments)
    assert np.allclose(np.abs(found), np.abs(MINIMISER), atol=1e-6)
    assert f(found) == pytest.approx(0.0, abs=1e-9)


def test_roots_that_are_both_known_take_signs_from_their_product():
    """(x^2 - 1)^2 + (y^2 - 4)^2 + (x y + 2)^2 is least at (1, -2) and (-1, 2)."""
    x, y = sp.variables(2)
    f = (x**2 - 1) ** 2 + (y**2 - 4) ** 2 + (x * y + 2) ** 2
    relaxation = sp.relax(sp.Problem(f), 2, terms="sign")
    atoms = np.array([[1.0, -2.0], [-1.0, 2.0]])
    moments = monomials.evaluate(relaxation.moments, atoms).mean(axis=0)
    for found in (means(relaxation, moments), candidates(relaxation, moments)[0]):
        assert f(found) == pytest.approx(0.0, abs=1e-9)


def test_first_moments_that_vanish_hide_no_minimiser():
    """x y is least on the unit disc at (1, -1) / sqrt(2) and at its negative, in the mean 0."""
    x, y, z = sp.variables(3)
    relaxation = sp.relax(sp.Problem(x * y + z**2, [x**2 + y**2 <= 1]), 1)
    atoms = np.sqrt(0.5) * np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0]])
    moments = monomials.evaluate(relaxation.moments, atoms).mean(axis=0)
    *_, last = candidates(relaxation, moments)
    assert np.allclose(last * np.sign(last[0]), atoms[0])


def test_products_of_neighbours_on_discs_are_attained_at_once():
    """x_i x_{i+1} >= -(x_i^2 + x_{i+1}^2) / 2 >= -1/2, and signs that alternate attain it."""
    pairs = list(pairwise(sp.variables(41)))
    problem = sp.Problem(sp.total(a * b for a, b in pairs), [a**2 + b**2 <= 1 for a, b in pairs])
    result = sp.solve(problem)
    assert result.status is sp.Status.OPTIMAL
    assert result.lower_bound <= -20.0 <= result.upper_bound


def test_a_start_on_an_axis_of_symmetry_does_not_hide_the_minimiser():
    """x1 = 1 and x1 = -1 are as good: the mean of both, with which searches ended, is a saddle."""
    problem = sp.Problem(sp.problems.rosenbrock(200).objective)
    result = sp.solve(problem)
    assert result.status is sp.Status.OPTIMAL
    assert result.upper_bound == pytest.approx(1.0, abs=1e-6)
