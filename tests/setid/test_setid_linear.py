"""The door to linear programs."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sps

import setid
from setid.linear import minimise


def test_solutions_infeasible_and_unbounded_programs() -> None:
    rows = sps.csr_array(np.array([[-1.0, 0.0], [0.0, -1.0], [1.0, 1.0]]))
    found = minimise(np.array([-1.0, -2.0]), (rows, np.array([0.0, 0.0, 1.0])))
    assert found is not None
    np.testing.assert_allclose(found, [0, 1], atol=1e-9)
    assert minimise(np.ones(2), (rows, np.array([-1.0, -1.0, 1.0]))) is None
    with pytest.raises(setid.SetidError, match="linear program: "):
        minimise(-np.ones(2), (rows[:2], np.zeros(2)))
