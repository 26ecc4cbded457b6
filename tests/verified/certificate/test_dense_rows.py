"""Dense Gram matrices: against solutions that FLINT gives in rationals, and limits by hand."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from flint import fmpq_mat
from flint_oracle import fraction, rational

from sparsepop_py.verified.certificate import rational_gram
from sparsepop_py.verified.certificate.dense_rows import hidden_by_definite, hidden_by_minors


def rows_of(matrix, q):
    """Rows of a matrix under row 0, which is q."""
    table = [[Fraction(0), *q], *([b, *row] for b, row in zip(q, matrix, strict=True))]
    return {i: {j: v for j, v in enumerate(row) if v} for i, row in enumerate(table)}


def fractions(array, under=1):
    return [[Fraction(int(v), under) for v in row] for row in array]


def by_flint(matrix, q):
    """q' Q^-1 q."""
    vector = fmpq_mat([[rational(v)] for v in q])
    whole = fmpq_mat([[rational(v) for v in row] for row in matrix])
    return fraction((vector.transpose() * whole.solve(vector))[0, 0])


@pytest.mark.parametrize("seed", range(12))
def test_definite_matrices_hide_what_flint_says(seed):
    """Of sizes that differ by 2^40 from row to row, and with thirds."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 9))
    root = rng.integers(-3, 4, (n, n))
    size = [Fraction(2) ** int(e) for e in rng.integers(-20, 21, n)]
    plain = fractions(root @ root.T + np.eye(n, dtype=int), 3)
    matrix = [
        [v * a * b for v, b in zip(row, size, strict=True)]
        for row, a in zip(plain, size, strict=True)
    ]
    q = [Fraction(int(v), 7) for v in rng.integers(-9, 10, n)]
    exact, rows = by_flint(matrix, q), rows_of(matrix, q)
    assert hidden_by_minors(rows) == exact
    assert exact <= hidden_by_definite(rows) <= exact * (1 + Fraction(1, 2**100))


def test_short_minimisers_are_met_exactly():
    """u = (1, -2, 3, ...) solves Q u = -q, so that q' Q^-1 q is a whole number."""
    rng = np.random.default_rng(5)
    root = rng.integers(-3, 4, (50, 50))
    matrix = root @ root.T + np.eye(50, dtype=int)
    u = np.array([(-1) ** k * (k + 1) for k in range(50)])
    q = [Fraction(int(v)) for v in -matrix @ u]
    assert hidden_by_definite(rows_of(fractions(matrix), q)) == int(u @ matrix @ u)


@pytest.mark.parametrize("seed", range(12))
def test_singular_matrices_are_left_to_minors(seed):
    """Q = M M' with q = M y hides the square of y's part in the range of M'."""
    rng = np.random.default_rng(seed)
    root = np.concatenate([np.eye(2, dtype=int), rng.integers(-3, 4, (4, 2))])[rng.permutation(6)]
    y = rng.integers(-5, 6, 2)
    q = [Fraction(int(v)) for v in root @ y]
    rows = rows_of(fractions(root @ root.T), q)
    assert hidden_by_definite(rows) is None
    assert hidden_by_minors(rows) == int(y @ y)
    outside = rows_of(fractions(root @ root.T), [q[0] + 1, *q[1:]])
    assert hidden_by_minors(outside) is None or np.linalg.matrix_rank(root[1:]) == 1


@pytest.mark.parametrize("last", [-1, Fraction(-1, 2**80), 0])
def test_matrices_that_are_not_semidefinite_hide_nothing(last):
    """The last row has a negative diagonal entry, or none beside an entry of q."""
    matrix = [[Fraction(2), Fraction(0)], [Fraction(0), Fraction(last)]]
    rows = rows_of(matrix, [Fraction(1), Fraction(1)])
    assert hidden_by_definite(rows) is hidden_by_minors(rows) is None
    sheared = [[Fraction(1), Fraction(2)], [Fraction(2), 4 + Fraction(last)]]
    rows = rows_of(sheared, [Fraction(1), Fraction(3)])
    assert hidden_by_definite(rows) is hidden_by_minors(rows) is None


def test_nearly_singular_matrices_are_not_taken_for_definite():
    """The least eigenvalue is about 2^-81: far below what doubles tell from zero."""
    one, tiny = Fraction(1), Fraction(1, 2**80)
    rows = rows_of([[one, one], [one, one + tiny]], [one, Fraction(2)])
    assert hidden_by_definite(rows) is None
    assert hidden_by_minors(rows) == 1 + 2**80


def test_eigenvalues_in_floating_point_are_only_a_guess(monkeypatch):
    monkeypatch.setattr(np.linalg, "eigvalsh", lambda matrix: np.ones(len(matrix)))
    one, two = Fraction(1), Fraction(2)
    assert hidden_by_definite(rows_of([[one, two], [two, one]], [one, one])) is None


def test_large_dense_matrices_are_not_eliminated_in_fractions(monkeypatch):
    """One of full rank, and one of half the rank."""
    monkeypatch.setattr(rational_gram, "_eliminated", lambda rows: pytest.fail("eliminated"))
    rng = np.random.default_rng(1)
    root = rng.integers(-3, 4, (48, 24))
    q = [Fraction(int(v)) for v in root @ rng.integers(-3, 4, 24)]
    for more in (0, 1):
        matrix = fractions(root @ root.T + more * np.eye(48, dtype=int))
        assert rational_gram._taken(rows_of(matrix, q)) > 0


def test_zeros_hide_nothing():
    rows = {0: {}, 1: {}, 2: {}}
    assert hidden_by_definite(rows) == hidden_by_minors(rows) == 0
