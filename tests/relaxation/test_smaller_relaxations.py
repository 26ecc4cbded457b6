"""Smaller plain relaxations: ``sparseSW`` 2 and 3, ``reduceMomentMatSW`` 2, ``aggressiveSW``."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from relaxed import assert_rows_hold
from slow_values import slow_after

import sparsepop_py as sp
from sparsepop_py.errors import ProblemError
from sparsepop_py.relaxation.sparsepop.relaxation import Switches, plain_relaxation

INF = np.inf


def call(problem: sp.Problem, **param: Any) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return sp.sparsePOP(problem, {"printLevel": 0, "tighten": 0, **param})


def hyperbola() -> sp.Problem:
    """Minimum -3/2 at (1/2, 1) and (1, 1/2): the ends of the convex curve xy = 1/2."""
    x, y = sp.variables(2)
    return sp.Problem(-x - y, [x * y <= 0.5], 0.5, INF)


def region() -> sp.Problem:
    """All kinds of rows over three variables, two of them in one clique each."""
    x, y, z = sp.variables(3)
    rows = [x**2 + y**2 <= 2, y**2 * z == 0.5, z - x * y >= -2, 3 - x**2 >= y]
    return sp.Problem(x * y - z + y**2, rows, [-2, -INF, 0], [2, INF, 3])


# ---- sparseSW 2 and 3 -------------------------------------------------------------------------


@pytest.mark.parametrize("switch", [2, 3])
def test_multipliers_are_made_of_terms_of_their_constraints(switch: int) -> None:
    """1 - x^4 - y^4 at order 6: floor(6/4 - 1/2) = 1, so 1, x^4 and y^4 instead of 15 monomials."""
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, [x**4 + y**4 <= 1])
    param = {"relaxOrder": 6, "SDPsolverSW": 0, "reduceMomentMatSW": 0}
    assert call(problem, sparseSW=switch - 2, **param).SDPinfo.SDPblock == (15, 28)
    output = call(problem, sparseSW=switch, **param)
    assert output.SDPinfo.SDPblock == (3, 28)
    assert output.param.sparseSW == switch


def test_equations_have_products_of_twice_as_many_terms() -> None:
    """x^2 + y^2 - 1 at order 3: products of up to 2 of its terms, 6 instead of 15 monomials."""
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, [x**2 + y**2 == 1])
    free = [
        call(problem, sparseSW=s, relaxOrder=3, SDPsolverSW=0).SDPinfo.noOfFreevar for s in (0, 2)
    ]
    assert free == [15, 6]


@pytest.mark.parametrize("order", [2, 3])
def test_they_prove_less_and_nothing_wrong(order: int) -> None:
    x, y = sp.variables(2)
    rows = [4 * x * y + 2 * x + 2 * y <= 3, y <= 0.9 + x**2]
    problem = sp.Problem(-2 * x * y, rows, 0, 1)  # minimum -1/2 at (1/2, 1/2)
    full, narrow = (call(problem, sparseSW=s, relaxOrder=order) for s in (1, 3))
    assert narrow.SDPinfo.colSizeA < full.SDPinfo.colSizeA
    assert narrow.POP.solverValue <= full.POP.solverValue + 1e-6
    assert -1.1 < narrow.SDPobjValue <= -0.5
    assert narrow.POP.certificate.verify(problem).ok


def test_a_published_example() -> None:
    """Muramatsu, Waki and Tuncel, section 3.1: the program has no solution without rounding errors,
    and its solver's value tends to the minimum -3/2 as the order grows."""
    output = call(hyperbola(), sparseSW=2, relaxOrder=4, boundSW=0)
    assert output.POP.solverValue < -1.4
    assert output.SDPobjValue <= -1.5


def test_tight_relaxations_are_those_of_0_and_1() -> None:
    with pytest.warns(sp.ParameterWarning, match="sparseSW = 3 is treated as 1 with tighten = 1"):
        output = sp.sparsePOP(hyperbola(), {"printLevel": 0, "sparseSW": 3})
    assert -1.6 < output.SDPobjValue <= -1.5


# ---- reduceMomentMatSW = 2 --------------------------------------------------------------------


def test_eliminated_monomials_change_no_value() -> None:
    """-2 x y on a set with 4 x y in its row, order 2: x^3 y has no other source than x^2 there."""
    x, y = sp.variables(2)
    problem = sp.Problem(-2 * x * y, [4 * x * y + 2 * x + 2 * y <= 3], 0, 1)
    param = {"relaxOrder": 2, "boundSW": 0}
    whole, once, twice = (call(problem, reduceMomentMatSW=s, **param) for s in (0, 1, 2))
    assert twice.SDPinfo.rowSizeA < once.SDPinfo.rowSizeA < whole.SDPinfo.rowSizeA
    for output in (once, twice):
        assert output.POP.solverValue == pytest.approx(whole.POP.solverValue, abs=1e-5)
        assert output.SDPobjValue <= -0.5


@pytest.mark.parametrize("seed", slow_after(2, range(6)))
def test_values_of_random_problems_stay(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = sp.variables(3)
    terms = [x[0] * x[1], x[1] ** 2 * x[2], x[2], x[0] ** 3 * x[2], x[0] ** 2, x[1]]

    def some(count: int) -> Any:
        chosen = rng.choice(len(terms), count, replace=False)
        return sp.total(float(rng.normal()) * terms[k] for k in chosen)

    ball = x[0] ** 4 + x[1] ** 4 + x[2] ** 4 <= 1
    problem = sp.Problem(some(3), [some(2) >= -0.5, ball, some(2) == 0])
    values = [call(problem, relaxOrder=3, reduceMomentMatSW=s).POP.solverValue for s in (0, 2)]
    assert values[1] == pytest.approx(values[0], abs=1e-4)


def test_an_aggressive_reduction_may_lose_the_first_moments() -> None:
    """(x y)^4 - 2 (x y)^2 needs 1, x y and (x y)^2 only."""
    x, y = sp.variables(2)
    problem = sp.Problem(x**4 * y**4 - 2 * x**2 * y**2)
    kept, lost = (call(problem, aggressiveSW=s) for s in (0, 1))
    assert (kept.SDPinfo.SDPblock, lost.SDPinfo.SDPblock) == ((5,), (3,))
    # by symmetry the first moments are 0; without them the best known point is shown
    assert kept.POP.xVect == pytest.approx([0.0, 0.0], abs=1e-6)
    assert np.prod(lost.POP.xVect) ** 2 == pytest.approx(1.0, abs=1e-6)
    for output in (kept, lost):
        assert output.POP.solverValue == pytest.approx(-1, abs=1e-5)


# ---- both -------------------------------------------------------------------------------------


@pytest.mark.parametrize("narrow", [False, True])
@pytest.mark.parametrize("consistent", [0, 2])
@pytest.mark.parametrize("order", [2.0, 3.5])
def test_point_masses_satisfy_every_row(order: float, consistent: int, narrow: bool) -> None:
    problem = region()
    switches = Switches(order=order, consistent=consistent, narrow=narrow, aggressive=True)
    relaxation = plain_relaxation(problem, sp.find_cliques(problem), (), switches)
    program = sp.assemble(relaxation, problem.objective)
    for point in ([0.5, 1.0, 0.5], [1.0, -0.5, 2.0], [0.0, 1.25, 0.32]):
        x = np.array(point)
        assert problem.violation(x) < 1e-12
        y = np.array([np.prod(x[word[word > 0] - 1]) for word in relaxation.moments])
        assert program.q @ y + program.offset == pytest.approx(problem.objective(x))
        assert_rows_hold(program, y)


def test_switches_are_checked() -> None:
    with pytest.raises(ProblemError, match=r"Switches.consistent: found 3, expected an integer"):
        Switches(consistent=3)
