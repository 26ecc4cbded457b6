"""Dense systems in rationals, with solutions computed by hand."""

from __future__ import annotations

from fractions import Fraction

import pytest

import sparsepop_py as sp
from sparsepop_py.verified.arithmetic.rational import solve_matrix, solve_rationally


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


ROWS = {
    "one after the other": (lambda x, y, z: [2 * x * z == 1, x + 3 * y == z], True),
    "together": (lambda x, y, z: [x + y == 2 * z, x - y == 1 - z + z**2], True),
    "a product": (lambda x, y, z: [x * y == z, x == 2], False),
    "a square": (lambda x, y, z: [x * x == z, x + y == 2], False),
    "the same twice": (lambda x, y, z: [x + y == 1, 2 * x + 2 * y == 2], False),
    "a contradiction": (lambda x, y, z: [x == 1, x == 2], False),
}


@pytest.mark.parametrize("name", ROWS)
def test_rows_are_solved_for_two_unknowns_where_they_are_linear_and_regular(name):
    """At z = 1/2; the solutions satisfy the rows, term by term."""
    rows, solvable = ROWS[name]
    x = sp.variables(3)
    problem = sp.Problem(x[0], rows(*x))
    system = problem.rows.take(range(2))
    found = solve_rationally(system, [Fraction(7), Fraction(9), Fraction(1, 2)], [0, 1])
    assert (found is not None) == solvable
    if found is None:
        return
    values = [*(found[v] for v in (0, 1)), Fraction(1, 2)]
    for row in problem.constraints:
        terms = zip(row.polynomial.words.tolist(), row.polynomial.coefficients, strict=True)
        total = Fraction(0)
        for word, c in terms:
            term = Fraction(c)
            for letter in word:
                term *= values[letter - 1] if letter else 1
            total += term
        assert total == 0
