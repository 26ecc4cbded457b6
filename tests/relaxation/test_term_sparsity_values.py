"""Values of relaxations with term sparsity: published ones, and test problems."""

import pytest
from relaxed import LOSSLESS, METHODS, dense, solved, value

import sparsepop_py as sp
from sparsepop_py import Problem, problems

# ---- published values --------------------------------------------------------------------


def literature():
    """Problems with the values in the test suite of the Julia package TSSOS (Wang, Magron)."""
    x, y, z, u = sp.variables(4)
    a, b, c = sp.variables(3)
    f = 1 + a**4 + b**4 + c**4 + a * b * c + b
    yield "no constraints", Problem(f), 2, 0.4752748
    ball = [0.5 - a**2 - 2 * b**2 >= 0, a**2 + b**2 + c**2 == 1]
    yield "a sphere", Problem(f, ball), 2, 0.9555474
    motzkin = a**2 * b**2 * (a**2 + b**2 - 3 * c**2) + c**6
    yield "Motzkin on the ball", Problem(motzkin, [a**2 + b**2 + c**2 <= 1]), 3, -0.0045964
    g = 3 - x**2 - z**2 + x * y**2 + 2 * y * z * u - x * u**2
    rows = [y >= 0, x**2 + 3 * z**2 == 2, u == 0, x**2 + y**2 + z**2 + u**2 == 3]
    yield "three equations", Problem(g, rows), 2, -0.4142135
    v = sp.variables(6)
    h = 1 + v[0] * v[1] * v[2] + v[2] * v[3] * v[4] + v[2] * v[3] * v[5]
    h = h + v[2] * v[4] * v[5] + v[3] * v[4] * v[5] + sp.total([t**4 for t in v])
    first, second = (1 - sp.total([t**2 for t in part]) for part in (v[:3], v[2:]))
    yield "two balls", Problem(h, [first >= 0, second == 0]), 2, 0.71742533


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("case", list(literature()), ids=lambda case: case[0])
def test_published_values(case, method):
    _, problem, order, expected = case
    assert value(problem, order, terms=method) == pytest.approx(expected, abs=2e-6)


@pytest.mark.parametrize("method", METHODS)
def test_a_concave_quadratic_of_floudas_and_pardalos(method):
    """The value -310 (Floudas, Pardalos 1990, problem 3.3) at order 2, also as in TSSOS."""
    x = sp.variables(6)
    f = -25 * (x[0] - 2) ** 2 - (x[1] - 2) ** 2 - (x[2] - 1) ** 2 - (x[3] - 4) ** 2
    f = f - (x[4] - 1) ** 2 - (x[5] - 4) ** 2
    rows = [(x[2] - 3) ** 2 + x[3] >= 4, (x[4] - 3) ** 2 + x[5] >= 4, x[0] - 3 * x[1] <= 2]
    rows += [x[1] - x[0] <= 2, x[0] + x[1] <= 6, x[0] + x[1] >= 2]
    problem = Problem(f, rows, [0, 0, 1, 0, 1, 0], [6, 6, 5, 6, 5, 10])
    found = value(problem, 2, terms=method, cliques=dense(problem))
    assert found == pytest.approx(-310, abs=1e-2 if method != "chordal" else 1.0)
    assert found <= -310 + 1e-2


@pytest.mark.parametrize("method", METHODS)
def test_an_example_of_chordal_term_sparsity(method):
    """Example 3.5 of Wang, Magron, Lasserre (Chordal-TSSOS, 2021): the minimum is 0 at 0.

    By the documentation of SumOfSquares.jl chordal blocks prove -0.00355 with matrices of
    size 3, and nothing is smaller with connected components.
    """
    x, y, z = sp.variables(3)
    f = x**2 - 2 * x * y + 3 * y**2 - 2 * x**2 * y + 2 * x**2 * y**2 - 2 * y * z + 6 * z**2
    f = f + 18 * y**2 * z - 54 * y * z**2 + 142 * y**2 * z**2
    problem = Problem(f)
    relaxation, solution = solved(problem, 2, terms=method, cliques=dense(problem))
    chordal = method == "chordal"
    assert solution.dual == pytest.approx(-0.00355 if chordal else 0, abs=1e-5)
    assert max(relaxation.block_sizes) == (3 if chordal else 6)


def test_motzkin_on_the_box_needs_blocks_of_three():
    """Parities (0, 0), (1, 0), (0, 1) hold three monomials each of degree up to 3, (1, 1) one.

    The minimum of Motzkin's polynomial is 0, at (1, 1).
    """
    x, y = sp.variables(2)
    f = x**4 * y**2 + x**2 * y**4 - 3 * x**2 * y**2 + 1
    problem = Problem(f, lower=-1, upper=1)
    for method in LOSSLESS:
        relaxation, solution = solved(problem, 3, terms=method)
        assert solution.dual == pytest.approx(value(problem, 3), abs=1e-6)
        assert solution.dual <= 1e-6
        assert max(relaxation.block_sizes) == 3


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "problem",
    [problems.broyden_tridiagonal(6), problems.chained_singular(8)],
    ids=["broyden", "singular"],
)
def test_chains_of_squares_keep_their_minimum_of_zero(problem, method):
    assert value(problem, 2, terms=method) == pytest.approx(0, abs=2e-3)


def test_the_chordal_blocks_of_the_rosenbrock_function_are_small():
    """Its terms join 1, x_k, x_k^2 and x_(k+1) only, and its minimum is 1."""
    relaxation, solution = solved(problems.rosenbrock(8), 2, terms="chordal")
    assert solution.dual == pytest.approx(1.0, abs=1e-4)
    assert max(relaxation.block_sizes) <= 3
