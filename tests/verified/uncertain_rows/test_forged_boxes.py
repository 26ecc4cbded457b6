"""Forged boxes of parameters from uncertain rows: each would lose a consistent parameter.

Closed forms: one row (r +- W) m = -Y +- w, whose solutions are an interval by hand.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from sparsepop_py.uncertain_rows import UncertainRows
from sparsepop_py.verified.certificate.linear_bound import LinearBound
from sparsepop_py.verified.uncertain_rows.sign_tree import ParameterBox, SignTree

INF = np.inf
F = Fraction
ANY = np.array([[-INF], [INF]])


def test_numbers_beside_an_unbounded_program_are_no_bounds():
    """0 m = 0 within 1 says nothing of m, whatever is written beside the ray."""
    rows = UncertainRows(("m",), [0.0], [[0.0]], [1.0], [[0.0]])
    for low, high in ((5.0, 5.0), (-1.0, 1.0), (-INF, 3.0), (2.0, INF)):
        bounds = tuple(
            LinearBound("UNBOUNDED", lower, -INF, None, (), None, (F(0),), (F(-side),))
            for lower, side in ((low, 1), (-high, -1))
        )
        tree = SignTree(-1, (), bounds)
        box = ParameterBox(("m",), np.array([low]), np.array([high]), ANY, (tree,))
        assert not box.verify(rows, ANY)
