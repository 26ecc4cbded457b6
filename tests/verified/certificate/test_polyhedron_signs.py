"""Signs of rows at points whose doubles underflow: those of the exact values."""

from __future__ import annotations

import numpy as np

from sparsepop_py.verified.certificate.polyhedron import Polyhedron, doubles


def polyhedron(row, constant):
    return Polyhedron(np.array([row], float), np.array([constant], float), np.zeros(1, bool))


def test_products_that_underflow_have_the_sign_of_the_exact_sum():
    """10.6 - 5.4 - 5.4 < 0 in units of 2^-1074, in which doubles know 11 - 5 - 5 > 0 only."""
    row = np.array([10.6, -5.4, -5.4])
    for order in ([0, 1, 2], [1, 0, 2], [1, 2, 0]):
        rows = polyhedron(row[order] * 2.0**-114, 0.0)
        assert rows.signs([1, 1, 1], 2**960, 2**960).tolist() == [-1]
        assert rows.signs([-1, -1, -1], 2**960, 2**960).tolist() == [1]


def test_points_that_underflow_have_the_sign_of_the_exact_value():
    """1e308 x > 0.999995e-12 at x = 1e-320, which is 0.99999e-320 in doubles."""
    rows = polyhedron([1e308], -0.999995e-12)
    assert rows.signs([1], 10**320, 10**320).tolist() == [1]


def test_doubles_of_a_point_are_safe_only_if_none_underflows():
    for total, safe in ((1, True), (10**289, True), (10**291, False), (10**400, False)):
        assert doubles([1, 0], total)[1] == safe
    assert not doubles([10**400], 1)[1]
