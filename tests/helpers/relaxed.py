"""Relaxations, solved."""

from __future__ import annotations

import numpy as np

from sparsepop_py import assemble, relax, solve_conic
from sparsepop_py.sparsity.correlative import find_cliques

METHODS = ("components", "chordal", "sign")
LOSSLESS = ("components", "sign")


def solved(problem, order, **options):
    relaxation = relax(problem, order, **options)
    solution = solve_conic(assemble(relaxation, problem.objective))
    assert solution.status in ("solved", "almost")  # how near, the values say
    return relaxation, solution


def value(problem, order, **options):
    return solved(problem, order, **options)[1].dual


def dense(problem):
    return find_cliques(problem, sparse=False)


def assert_rows_hold(program, y):
    """Moments of a point mass satisfy every row of a program, up to rounding."""
    slack, cones = program.b - program.A @ y, program.cones
    offset = cones.zero + cones.nonnegative
    assert np.abs(slack[: cones.zero]).max(initial=0.0) < 1e-9
    assert slack[cones.zero : offset].min(initial=0.0) > -1e-9
    for size in cones.psd:
        j, i = np.tril_indices(size)
        matrix = np.zeros((size, size))
        entries = slack[offset : offset + i.size] / np.where(i == j, 1.0, np.sqrt(2.0))
        matrix[i, j] = matrix[j, i] = entries
        assert np.linalg.eigvalsh(matrix)[0] > -1e-8 * max(1.0, np.abs(matrix).max())
        offset += i.size


def safe_value(p, z):
    """The bound that z in K* proves, with moments in [-1, 1]."""
    return p.offset - p.b @ z - np.abs(p.q + p.A.T @ z).sum()
