"""Large matrices are factorized in parts, between which the clock is looked at."""

from __future__ import annotations

import time

import numpy as np
import pytest

from sparsepop_py.solvers.cliquetree.kernels import batched
from sparsepop_py.solvers.cliquetree.symbolic import assembly


def definite(size: int, seed: int = 0) -> np.ndarray:
    a = np.random.default_rng(seed).normal(size=(size, size))
    return (a @ a.T + size * np.eye(size))[None]


@pytest.mark.parametrize("halved", [40, 75, 10_000])
def test_parts_give_the_factor_of_the_whole(halved, monkeypatch):
    monkeypatch.setattr(batched, "_HALVED", halved)
    matrix = definite(150)
    expected = np.linalg.cholesky(matrix)
    assert np.allclose(batched.cholesky(matrix), expected, rtol=1e-12, atol=1e-12)
    inverse = np.empty_like(matrix)
    batched.lower_inverse(expected, inverse)
    assert np.allclose(inverse[0] @ expected[0], np.eye(150), atol=1e-12)


def test_an_indefinite_matrix_is_noticed_in_either_half(monkeypatch):
    monkeypatch.setattr(batched, "_HALVED", 40)
    for place in (3, 140):
        matrix = definite(150)
        matrix[0, place, place] = -1.0
        with pytest.raises(np.linalg.LinAlgError):
            batched.cholesky(matrix)


def test_a_deadline_ends_a_factorization():
    with pytest.raises(batched.OutOfTime):
        batched.cholesky(definite(150), time.monotonic() - 1.0)
    with pytest.raises(batched.OutOfTime):
        batched.lower_inverse(definite(150), np.empty((1, 150, 150)), time.monotonic() - 1.0)


def test_ranges_of_columns_assemble_the_same_matrix(monkeypatch):
    import sparsepop_py as sp

    x = sp.variables(4)
    f = sp.total(x[i] * x[j] ** 3 - x[i] ** 2 for i in range(4) for j in range(4))
    problem = sp.Problem(f, [sp.total(v**2 for v in x) <= 2], -1, 1)
    program = sp.assemble(sp.relax(problem, 2), f)
    whole = sp.solve_conic(program, "cliquetree")
    monkeypatch.setattr(assembly, "_TEMPORARY", 1)  # a column at a time
    parts = sp.solve_conic(program, "cliquetree")
    assert whole.status == parts.status == "solved"
    assert parts.dual == pytest.approx(sp.solve_conic(program, "clarabel").dual, abs=1e-6)
