"""Rational solutions near an approximation: they solve the equations, and keep what is open."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from sparsepop_py.lp import rational_projection
from sparsepop_py.lp.rational_projection import near_fraction, projected


@pytest.mark.parametrize("seed", range(20))
def test_solutions_solve_the_equations_exactly(seed):
    """Rows that a planted solution satisfies, some of them combinations of others."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(2, 9)), int(rng.integers(1, 7))
    table = rng.integers(-3, 4, (m, n))
    table = np.concatenate([table, table[:1] - 2 * table[-1:]])
    planted = [Fraction(int(a), int(b)) for a, b in rng.integers(1, 9, (n, 2))]
    rows = [{j: Fraction(int(a)) for j, a in enumerate(row) if a} for row in table]
    right = [sum((v * planted[j] for j, v in row.items()), Fraction(0)) for row in rows]
    order = rng.permutation(n).tolist()
    near = [near_fraction(float(v) + 1e-8 * rng.normal()) for v in planted]
    found = projected([dict(row) for row in rows], right, order, near)
    for row, value in zip(rows, right, strict=True):
        assert sum((v * found[j] for j, v in row.items()), Fraction(0)) == value
    kept = sum(a == b for a, b in zip(found, near, strict=True))
    assert kept >= n - np.linalg.matrix_rank(table)
    assert max(abs(float(a - b)) for a, b in zip(found, planted, strict=True)) < 1e-4


def test_contradictions_have_no_solution():
    one = Fraction(1)
    assert projected([{0: one}, {0: 2 * one}], [one, one], [0], [one]) is None


def test_columns_that_come_first_absorb_the_change():
    one = Fraction(1)
    start = [one, one]
    assert projected([{0: one, 1: one}], [Fraction(5)], [1, 0], start) == [1, 4]
    assert projected([{0: one, 1: one}], [Fraction(5)], [0, 1], start) == [4, 1]


def test_simple_fractions_stand_for_doubles_near_them():
    assert near_fraction(1 / 3) == Fraction(1, 3)
    assert near_fraction(0.1 + 1e-12) == Fraction(1, 10)
    assert near_fraction(0.1 + 1e-6) == Fraction(0.1 + 1e-6)


def test_dense_systems_that_take_too_long_are_left_alone(monkeypatch):
    size, rng = 12, np.random.default_rng(0)
    table = rng.integers(1, 9, (size, size))

    def solution():
        rows = [{j: Fraction(int(a)) for j, a in enumerate(row)} for row in table]
        return projected(rows, [Fraction(1)] * size, range(size), [Fraction(0)] * size)

    assert solution() is not None
    monkeypatch.setattr(rational_projection, "_WORK", 100)
    assert solution() is None
