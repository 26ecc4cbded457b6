"""The benchmark of time limits: its arithmetic, its names, one run."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.errors import BenchmarkError
from benchmarks.tables.limits import CASES, LimitedRun, dense, limits_table, measure_limits


def test_a_limit_is_kept_up_to_half_as_long() -> None:
    runs = [
        LimitedRun("good", 5.0, 7.5, 2.0, "LIMIT", "[0, 1]"),
        LimitedRun("late", 5.0, 7.51, 2.0, "LIMIT", "[0, 1]"),
        LimitedRun("lost", 5.0, math.inf, math.inf, "given up", ""),
    ]
    assert [run.ratio for run in runs] == [1.5, pytest.approx(1.502), math.inf]
    assert limits_table(runs).endswith("at most 1.5: 1 of 3 runs")


def test_wrong_names_are_refused() -> None:
    with pytest.raises(BenchmarkError, match="--names: found"):
        list(measure_limits(["no such case"], [1.0]))


def test_dense_polynomials_have_every_monomial() -> None:
    problem = dense(4, 3)
    assert problem.objective.terms == math.comb(7, 3)
    assert np.all(problem.lower == -1.0)


def test_each_kind_of_problem_is_there() -> None:
    names = " ".join(CASES)
    assert all(kind in names for kind in ("dense", "tridiagonal", "errors in variables"))


@pytest.mark.slow
def test_a_run_in_a_process_of_its_own() -> None:
    (run,) = measure_limits(["chained Wood"], [30.0], busy=1)
    assert run.status == "OPTIMAL"
    assert 0.0 < run.cpu
