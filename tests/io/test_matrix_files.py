"""What JSON may say of results, and problems with matrices and their certificates as JSON."""

from __future__ import annotations

import json

import pytest

import sparsepop_py as sp


def test_matrices_and_their_certificates_travel() -> None:
    """min x with [1 x; x 1] semidefinite is -1 (its determinant is 1 - x^2)."""
    (x,) = sp.variables(1)
    problem = sp.Problem(x, [sp.psd([[1, x], [x, 1]]), sp.second_order(2 + 0 * x, x)])
    for options in (sp.Options(order=1), sp.Options(effort="plain", switches=sp.Switches(order=1))):
        result = sp.solve(problem, options)
        assert result.lower_bound == pytest.approx(-1, abs=1e-4) or options.effort == "plain"
        again = sp.from_json(sp.to_json(problem))
        assert again.fingerprint == problem.fingerprint
        if result.certificate is not None:
            certificate = sp.from_json(sp.to_json(result.certificate))
            assert certificate.verify(again).ok
            assert certificate.bound == result.lower_bound


def test_a_result_states_no_point_and_no_status_that_is_not_proved() -> None:
    (x,) = sp.variables(1)
    honest = sp.solve(sp.Problem(x**4 - x, (), -1, 1), sp.Options(order=2))
    for change, match in (
        ({"upper_bound": -50.0}, r"result\.upper_bound: found -50"),
        ({"attained": None}, r"result\.upper_bound"),
        ({"status": "INFEASIBLE"}, r"result\.status"),
        ({"status": "UNBOUNDED"}, r"result\.status"),
    ):
        text = json.loads(sp.to_json(honest))
        text["result"].update(change)
        with pytest.raises(sp.ProblemError, match=match):
            sp.from_json(json.dumps(text))
    falling = sp.solve(sp.Problem(x), sp.Options(order=1))
    assert sp.from_json(sp.to_json(falling)).status is falling.status is sp.Status.UNBOUNDED
