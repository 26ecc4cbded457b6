"""Problems with matrices, and their certificates, as JSON."""

from __future__ import annotations

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
