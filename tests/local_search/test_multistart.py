"""Local searches from starts: what ends them, and what they must still find."""

from __future__ import annotations

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.local_search.multistart import Aim, best_attained

# min -x y on x + 2 y <= 4, x y <= 1.5 in [0, 4]^2: the second row holds it at -1.5
X, Y = sp.variables(2)
PROBLEM = sp.Problem(-X * Y, [X + 2 * Y <= 4, X * Y <= 1.5], 0, 4)
START = np.array([1.0, 1.0])


@pytest.mark.parametrize(("known", "fewer"), [(np.inf, False), (-1.0, False), (-1.5, True)])
def test_searches_that_come_back_to_the_incumbent_end(known, fewer):
    """Slower methods follow only where the first one did not end at the incumbent's value."""
    _, every = best_attained(PROBLEM, [START], Aim(1e-6))
    point, vectors = best_attained(PROBLEM, [START], Aim(1e-6, known=known))
    assert (len(vectors) < len(every)) is fewer
    assert min(PROBLEM.objective(x) for x in vectors) == pytest.approx(-1.5, abs=1e-6)
    if not fewer:
        assert point.value == pytest.approx(-1.5, abs=1e-6)
    else:
        assert point is None  # nothing better than what is known


def test_equations_leave_the_later_methods():
    """Linear programs come first there, and need not be accurate in x."""
    problem = sp.Problem(-X * Y, [X + 2 * Y == 4], 0, 4)  # -2 at (2, 1)
    _, vectors = best_attained(problem, [START], Aim(1e-6, known=-2.0))
    assert min(np.abs(x - [2.0, 1.0]).max() for x in vectors) <= 1e-6
    assert len(vectors) > 1
