"""The door to linear programs."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sps
from scipy.optimize import linprog

import setid
from setid.feasible_set.linear_programs import minimise


def test_solutions_infeasible_and_unbounded_programs() -> None:
    rows = sps.csr_array(np.array([[-1.0, 0.0], [0.0, -1.0], [1.0, 1.0]]))
    found = minimise(np.array([-1.0, -2.0]), (rows, np.array([0.0, 0.0, 1.0])))
    assert found is not None
    np.testing.assert_allclose(found, [0, 1], atol=1e-9)
    assert minimise(np.ones(2), (rows, np.array([-1.0, -1.0, 1.0]))) is None
    with pytest.raises(setid.SetidError, match="linear program: "):
        minimise(-np.ones(2), (rows[:2], np.zeros(2)))


def test_numerical_difficulties_are_met_by_another_method(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def difficult(*given: object, method: str, **named: object) -> object:
        asked.append(method)
        found = linprog(*given, method=method, **named)
        if len(asked) == 1:
            found.status, found.message = 4, "model_status is Unknown"
        return found

    monkeypatch.setattr("setid.feasible_set.linear_programs.linprog", difficult)
    rows = sps.csr_array(-np.eye(2))
    found = minimise(np.ones(2), (rows, -np.ones(2)))
    assert found is not None and asked == ["highs", "highs-ipm"]
    np.testing.assert_allclose(found, [1, 1], atol=1e-7)


def test_a_witness_is_not_found_where_the_solver_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    def lost(*given: object, **named: object) -> object:
        found = linprog(*given, **named)
        found.status = 4
        return found

    monkeypatch.setattr("setid.feasible_set.linear_programs.linprog", lost)
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    known = setid.formulate(data, setid.TransferFunction(1, 1), setid.Noise(output=0.5))
    assert setid.least_noise(known, [-0.5, 2.0]).level == np.inf
