"""Dense systems in rationals, with solutions computed by hand."""

from __future__ import annotations

from fractions import Fraction

from sparsepop_py.verified.arithmetic.rational import solve_matrix


def rationals(*lines: tuple[int, ...]) -> list[list[Fraction]]:
    return [[Fraction(value) for value in line] for line in lines]


def test_a_system_whose_first_pivot_is_zero_is_solved_exactly():
    """2 y + z = 5, x + y = 3 and x + 3 z = 4 hold at x = 1, y = 2, z = 1."""
    matrix = rationals((0, 2, 1), (1, 1, 0), (1, 0, 3))
    assert solve_matrix(matrix, rationals((5,), (3,), (4,))) == rationals((1,), (2,), (1,))


def test_several_right_sides_give_the_inverse():
    found = solve_matrix(rationals((1, 2), (3, 4)), rationals((1, 0), (0, 1)))
    assert found == [[Fraction(-2), Fraction(1)], [Fraction(3, 2), Fraction(-1, 2)]]


def test_singular_systems_have_no_solution():
    assert solve_matrix(rationals((1, 2), (2, 4)), rationals((1,), (2,))) is None
