"""Generators: known optima are attained, and nothing found lies below them."""

from fractions import Fraction

import numpy as np
import pytest
from exact_polynomials import value_at
from scipy import optimize

from sparsepop_py import problems
from sparsepop_py.algebra.polynomial import total
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.errors import ProblemError

CHAINS = [
    (problems.rosenbrock, 1.0),
    (problems.broyden_tridiagonal, 0.0),
    (problems.broyden_banded, 0.0),
    (problems.chained_singular, 0.0),
    (problems.chained_wood, 1.0),
    (lambda n: problems.random_quartic(n, clique=3, seed=4, optimum=1.0), 1.0),
]
IDS = ["rosenbrock", "tridiagonal", "banded", "singular", "wood", "random"]
chains = pytest.mark.parametrize(("generator", "optimum"), CHAINS, ids=IDS)


def gradient(problem):
    system = PolynomialSystem.stack([problem.objective], problem.dimension)
    return lambda x: system.jacobian(x).toarray()[0]


# the formulas of the literature, written out once more


def rosenbrock(x):
    return 1 + sum(100 * (x[i] - x[i - 1] ** 2) ** 2 + (1 - x[i]) ** 2 for i in range(1, len(x)))


def tridiagonal_residuals(x):
    z = np.concatenate([[0.0], x, [0.0]])
    return np.array(
        [(3 - 2 * z[i]) * z[i] - z[i - 1] - 2 * z[i + 1] + 1 for i in range(1, len(x) + 1)]
    )


def banded_residuals(x):
    n = len(x)
    rows = []
    for i in range(n):
        band = [j for j in range(max(0, i - 5), min(n, i + 2)) if j != i]
        rows.append(x[i] * (2 + 5 * x[i] ** 2) + 1 - sum((1 + x[j]) * x[j] for j in band))
    return np.array(rows)


def singular(x):
    return sum(
        (x[i] + 10 * x[i + 1]) ** 2
        + 5 * (x[i + 2] - x[i + 3]) ** 2
        + (x[i + 1] - 2 * x[i + 2]) ** 4
        + 10 * (x[i] - 10 * x[i + 3]) ** 4
        for i in range(0, len(x) - 3, 2)
    )


def wood(x):
    return 1 + sum(
        100 * (x[i + 1] - x[i] ** 2) ** 2
        + (1 - x[i]) ** 2
        + 90 * (x[i + 3] - x[i + 2] ** 2) ** 2
        + (1 - x[i + 2]) ** 2
        + 10 * (x[i + 1] + x[i + 3] - 2) ** 2
        + 0.1 * (x[i + 1] - x[i + 3]) ** 2
        for i in range(0, len(x) - 3, 2)
    )


@pytest.mark.parametrize(
    ("generator", "formula"),
    [
        (problems.rosenbrock, rosenbrock),
        (problems.broyden_tridiagonal, lambda x: np.sum(tridiagonal_residuals(x) ** 2)),
        (problems.broyden_banded, lambda x: np.sum(banded_residuals(x) ** 2)),
        (problems.chained_singular, singular),
        (problems.chained_wood, wood),
    ],
    ids=IDS[:5],
)
@pytest.mark.parametrize("n", [4, 12])
def test_values_are_those_of_the_formula(generator, formula, n):
    problem = generator(n)
    for x in np.random.default_rng(0).normal(size=(5, n)):
        assert problem.objective(x) == pytest.approx(formula(x), rel=1e-11)


def test_known_minimisers_are_exact():
    ones = np.ones(12)
    assert value_at(problems.rosenbrock(12).objective, ones) == 1
    ones[0] = -1
    assert value_at(problems.rosenbrock(12).objective, ones) == 1
    assert value_at(problems.chained_wood(12).objective, np.ones(12)) == 1
    assert value_at(problems.chained_singular(12).objective, np.zeros(12)) == 0
    assert value_at(problems.motzkin().objective, [1, -1]) == 0


@pytest.mark.parametrize(("clique", "density"), [(None, 0.5), (None, 1.0), (3, 0.3), (1, 1.0)])
def test_random_quartic_is_exact_at_its_planted_point(clique, density):
    for seed in range(5):
        problem = problems.random_quartic(6, clique, seed, density, optimum=-2.5)
        point = problems.planted_point(6, seed)
        assert problem.violation(point) == 0
        assert problem.degree <= 4
        assert value_at(problem.objective, point) == Fraction(-5, 2)


@pytest.mark.parametrize(
    ("generator", "residuals"),
    [
        (problems.broyden_tridiagonal, tridiagonal_residuals),
        (problems.broyden_banded, banded_residuals),
    ],
    ids=IDS[1:3],
)
def test_broyden_systems_have_a_zero(generator, residuals):
    found = optimize.root(residuals, -np.ones(30), tol=1e-13)
    assert found.success
    assert generator(30).objective(found.x) == pytest.approx(0.0, abs=1e-12)


@chains
def test_squares_are_the_objective(generator, optimum):
    problem = generator(12)
    rest = total([problem.objective, *(p * p * -w for w, p in problem.squares)])
    rest = rest - optimum
    assert rest.terms == 0  # not one rounding error


@chains
def test_squares_are_in_normal_form(generator, optimum):
    for _, p in generator(8).squares:
        again = type(p).from_words(p.words, p.coefficients, p.dimension)
        assert np.array_equal(again.words, p.words)
        assert np.array_equal(again.coefficients, p.coefficients)
        assert not p.words.flags.writeable


@chains
def test_nothing_lies_below_the_optimum(generator, optimum):
    problem = generator(8)
    rng = np.random.default_rng(1)
    values = problem.objective(rng.normal(size=(200, 8)))
    assert np.all(values >= optimum)
    slope = gradient(problem)
    best = min(
        optimize.minimize(problem.objective, start, jac=slope, method="BFGS").fun
        for start in [-np.ones(8), *rng.uniform(-1, 1, (3, 8))]
    )
    assert best >= optimum - 1e-12


@pytest.mark.parametrize("index", [0, 1, 3, 4])
def test_local_search_reaches_the_optimum(index):
    generator, optimum = CHAINS[index]
    problem = generator(8)
    start = -np.ones(8) if index == 1 else np.full(8, 0.9)
    found = optimize.minimize(problem.objective, start, jac=gradient(problem), method="BFGS")
    assert found.fun == pytest.approx(optimum, abs=1e-5)


def test_laboratory():
    problem = problems.laboratory()
    x = np.array([8.8605284, 5.3748171])
    assert problem.objective(x) == pytest.approx(52.7066065447, abs=1e-5)
    assert problem.violation(x) < 1e-5
    # on the equality x2 = 10 / (x1 - 7); x1 < 7 violates the inequality

    def along(t):
        return problem.objective([t, 10 / (t - 7)])

    found = optimize.minimize_scalar(along, bounds=(7.5, 12), options={"xatol": 1e-10})
    assert found.fun == pytest.approx(52.7066065447, abs=1e-9)
    left = np.linspace(-50, 6.99, 2000)
    assert np.all(10 / (left - 7) + 0.5 * left < 1)
    grid = np.linspace(7.01, 60, 2000)
    assert min(along(t) for t in grid) >= found.fun


def test_motzkin_is_nonnegative():
    problem = problems.motzkin()
    assert problem.squares == ()
    assert np.all(problem.objective(np.random.default_rng(2).normal(size=(500, 2))) >= -1e-12)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: problems.rosenbrock(1), "n: found 1"),
        (lambda: problems.chained_wood(6), "multiple of 4"),
        (lambda: problems.chained_singular(0), "multiple of 4"),
        (lambda: problems.random_quartic(3, clique=4), "clique: found 4"),
        (lambda: problems.random_quartic(3, density=0), "density: found 0"),
    ],
)
def test_wrong_sizes_are_named(call, message):
    with pytest.raises(ProblemError, match=message):
        call()
