"""Single linear programs in any units, and what follows where HiGHS gives up."""

from __future__ import annotations

import subprocess
import sys

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
    assert found.status == "solved" and asked == ["simplex", "ipm"]
    np.testing.assert_allclose(found.x, [1, 1], atol=1e-7)


LONG_RECURSIONS = """
import numpy as np, scipy.sparse as sps
from sparsepop_py.lp.scaled import solve_scaled

source = np.random.default_rng(0)
for _ in range(80):
    n, a = int(source.integers(20, 300)), source.uniform(-0.9, 0.9)
    noise = source.uniform(-0.05, 0.05, n)
    tied = sps.diags_array([np.ones(n - 1), np.full(n - 1, a)], offsets=[1, 0], shape=(n - 1, n))
    size, eye = sps.csr_array(np.full((n, 1), -0.05)), sps.eye_array(n)
    below = sps.vstack([sps.hstack([eye, size]), sps.hstack([-eye, size])]).tocsr()
    equal = sps.hstack([tied, sps.csr_array((n - 1, 1))]).tocsr()
    free = np.full(n, np.inf)
    found = solve_scaled(
        np.append(np.zeros(n), 1.0), (below, np.zeros(2 * n)), (equal, tied @ noise),
        (np.append(-free, 0.0), np.append(free, np.inf)),
    )
    assert found.status == "solved" and found.value <= 20 * abs(noise).max() + 1e-6
    assert np.allclose(equal @ found.x, tied @ noise, atol=1e-8)
"""


def test_long_recursions_do_not_end_the_process() -> None:
    """HiGHS's presolve writes beyond its memory on the 63rd of these (releases 1.11 to 1.15)."""
    call = [sys.executable, "-c", LONG_RECURSIONS]
    done = subprocess.run(call, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr


def test_no_program_is_presolved() -> None:
    model = LinearModel(sps.csr_array(np.eye(1)), (np.zeros(1), np.ones(1)), (np.zeros(1),) * 2)
    assert model._highs.getOptionValue("presolve")[1] == "off"


def test_a_witness_is_not_found_where_the_solver_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    class Lost(LinearModel):
        def solve(self, *given, **named) -> LinearSolution:
            found = super().solve(*given, **named)
            return LinearSolution("failed", found.x, found.dual, np.nan)

    monkeypatch.setattr(scaled, "LinearModel", Lost)
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    known = setid.formulate(data, setid.TransferFunction(1, 1), setid.Noise(output=0.5))
    assert setid.least_noise(known, [-0.5, 2.0]).level == np.inf


def test_prices_are_those_of_the_rows_as_given() -> None:
    """Min 3e-9 x + 5e9 y with 1e-9 x >= 1 and 2e9 y >= 1: prices 3 and 5 / 2, by hand."""
    rows = sps.csr_array(np.array([[-1e-9, 0.0], [0.0, -2e9]]))
    found = solve_scaled(np.array([3e-9, 5e9]), (rows, np.array([-1.0, -1.0])))
    assert found.dual == pytest.approx([-3.0, -2.5])


def test_columns_of_subnormal_numbers_count_as_zero() -> None:
    """Their scales overflowed, and HiGHS found nonsense or did not end."""
    rows = sps.csr_array(np.array([[1.0, 5e-324], [-1.0, 1e-323], [2.0, -5e-324]]))
    found = solve_scaled(np.array([1.0, 0.0]), (rows, np.ones(3)), None, (-np.ones(2), np.ones(2)))
    assert found.status == "solved" and found.value == -1.0
    assert found.x[0] == -1.0 and abs(found.x[1]) <= 1.0
