"""Single linear programs in any units, and what follows where HiGHS gives up."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sps
from scipy.optimize import linprog

import setid
from sparsepop_py.lp import scaled
from sparsepop_py.lp.highs import LinearModel, LinearSolution
from sparsepop_py.lp.scaled import solve_scaled


def test_solutions_infeasible_and_unbounded_programs() -> None:
    rows = sps.csr_array(np.array([[-1.0, 0.0], [0.0, -1.0], [1.0, 1.0]]))
    found = solve_scaled(np.array([-1.0, -2.0]), (rows, np.array([0.0, 0.0, 1.0])))
    assert found.status == "solved" and found.value == pytest.approx(-2.0)
    np.testing.assert_allclose(found.x, [0, 1], atol=1e-9)
    assert solve_scaled(np.ones(2), (rows, np.array([-1.0, -1.0, 1.0]))).status == "infeasible"
    assert solve_scaled(-np.ones(2), (rows[:2], np.zeros(2))).status in ("unbounded", "failed")


@pytest.mark.parametrize("seed", range(8))
def test_units_do_not_matter(seed: int) -> None:
    """The program of linprog with rows and columns multiplied by up to 1e9 either way."""
    source = np.random.default_rng(seed)
    matrix, cost = source.integers(-3, 4, (6, 4)).astype(float), source.integers(-3, 4, 4) * 1.0
    right = matrix @ source.integers(-2, 3, 4) + source.integers(0, 3, 6)
    plain = linprog(cost, matrix, right, bounds=[(-5, 5)] * 4)
    rows, columns = 10.0 ** source.integers(-9, 10, 6), 10.0 ** source.integers(-9, 10, 4)
    given = sps.csr_array(matrix * rows[:, None] * columns)
    box = -5.0 / columns, 5.0 / columns
    found = solve_scaled(cost * columns, (given, right * rows), None, box)
    assert found.status == "solved" and found.value == pytest.approx(plain.fun, abs=1e-7)
    assert np.all(matrix @ (found.x * columns) <= right + 1e-7)


def test_numerical_difficulties_are_met_by_another_method(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    class Difficult(LinearModel):
        def __init__(self, *given, **named) -> None:
            asked.append(given[3]["solver"])
            super().__init__(*given, **named)

        def solve(self, *given, **named) -> LinearSolution:
            found = super().solve(*given, **named)
            return (
                LinearSolution("failed", found.x, found.dual, np.nan) if len(asked) < 2 else found
            )

    monkeypatch.setattr(scaled, "LinearModel", Difficult)
    found = solve_scaled(np.ones(2), (sps.csr_array(-np.eye(2)), -np.ones(2)))
    assert found.status == "solved" and asked == ["choose", "ipm"]
    np.testing.assert_allclose(found.x, [1, 1], atol=1e-7)


def test_a_witness_is_not_found_where_the_solver_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    class Lost(LinearModel):
        def solve(self, *given, **named) -> LinearSolution:
            found = super().solve(*given, **named)
            return LinearSolution("failed", found.x, found.dual, np.nan)

    monkeypatch.setattr(scaled, "LinearModel", Lost)
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    known = setid.formulate(data, setid.TransferFunction(1, 1), setid.Noise(output=0.5))
    assert setid.least_noise(known, [-0.5, 2.0]).level == np.inf
