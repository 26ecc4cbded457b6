"""Degrees and orders beyond physical sense are refused, with their size, before any work."""

from __future__ import annotations

from math import comb
from typing import Any

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.bounding import relaxation_bound
from sparsepop_py.budget import Deadline, LimitReached
from sparsepop_py.presolve import size_limits
from sparsepop_py.relaxation.basis import building_bytes
from sparsepop_py.relaxation.sparsepop.relaxation import Switches, plain_relaxation

X = sp.variables(10)
BALL = sp.Problem(X[0] * X[1] * X[2], [sp.total(x**2 for x in X) <= 1])


@pytest.mark.parametrize("effort", ["plain", "presolve", "auto"])
def test_large_degrees_are_refused_by_name(effort: str) -> None:
    (x,) = sp.variables(1)
    options = sp.Options(effort=effort, time_limit=1)
    with pytest.raises(sp.ProblemError, match="objective: found degree 100000, expected at most"):
        sp.solve(sp.Problem(x**100_000 - x, lower=-1, upper=1), options)
    power = sp.Problem(x, [x >= 0, x**5000 <= 1])
    with pytest.raises(sp.ProblemError, match=r"constraints\[1\]: found degree 5000"):
        sp.solve(power, options)
    with pytest.raises(sp.ProblemError, match=r"objectives\[1\]: found degree 3000"):
        sp.solve_each(sp.Problem(x, lower=0, upper=1), [x, x**3000], options)


def test_large_degrees_of_structs_are_refused() -> None:
    poly = {"typeCone": 1, "dimVar": 1, "noTerms": 2, "supports": [[100_000], [1]], "coef": [1, -1]}
    for param in ({"SDPsolverSW": 0}, {"tighten": 0}, {}):
        with pytest.raises(sp.ProblemError, match="objective: found degree 100000"):
            sp.sparsePOP(poly, [], [-1], [1], {"printLevel": 0, **param})


def test_powers_and_products_are_refused_before_they_are_made() -> None:
    (x,) = sp.variables(1)
    with pytest.raises(sp.ProblemError, match="product: found degree .*, expected at most 1000000"):
        x ** (2**40)
    with pytest.raises(sp.ProblemError, match="product: found .* GB, expected at most 2 GB"):
        sp.total(X) ** 100


def test_relaxations_are_refused_before_they_are_built() -> None:
    with pytest.raises(sp.ProblemError, match="order: found 50, whose relaxation takes about"):
        sp.relax(BALL, 50)


def test_forms_that_outlast_the_limit_are_not_built() -> None:
    """Fifteen million products of pairs take seconds; most of it is inside a few calls."""
    x = sp.variables(30)
    problem = sp.Problem(sp.total(x), [sp.total(v**2 for v in x) <= 1], -1, 1)
    cliques = sp.find_cliques(problem)
    with Deadline(1.0).kept(), pytest.raises(LimitReached):
        plain_relaxation(problem, cliques, (), Switches(order=3))


@pytest.mark.parametrize("param", [{"tighten": 0}, {"tighten": 0, "SDPsolverSW": 0}, {}])
def test_large_orders_of_sparsepop_are_noted(param: dict[str, Any]) -> None:
    unit = np.eye(10, dtype=int)
    ball = np.vstack([np.zeros((1, 10), int), 2 * unit])
    objective = {"typeCone": 1, "dimVar": 10, "noTerms": 1, "supports": unit[:1], "coef": [1.0]}
    row = {"typeCone": 1, "dimVar": 10, "noTerms": 11, "supports": ball, "coef": [1] + 10 * [-1]}
    given = {"printLevel": 0, "relaxOrder": 50, "sparseSW": 0, **param}
    answer = sp.sparsePOP(objective, [row], 10 * [-1], 10 * [1], given)
    notes = " ".join(answer.POP.notes)
    assert answer.POP.lowerBound <= -1  # the least value on the ball
    assert "order 50" in notes or answer.POP.status is sp.Status.OPTIMAL


def test_the_estimate_counts_letters_of_free_variables() -> None:
    lower = np.where(np.arange(10) < 7, 0.0, -1.0)
    fixed = sp.Problem(BALL.objective, lower=lower, upper=0.0)
    (clique,) = sp.find_cliques(fixed, sparse=False).members
    assert len(clique) == 10
    products = comb(3 + 4, 4) * (comb(3 + 4, 4) + 1) / 2  # of monomials in three variables
    found = building_bytes(fixed, sp.find_cliques(fixed, sparse=False), 4)
    assert found == pytest.approx(35 * 8 * products)


# one dense quartic whose least value 1 is planted; limits are lowered until order 2 is too large
def dense() -> sp.Problem:
    given = sp.problems.random_quartic(6, seed=1)
    return sp.Problem(given.objective, [], given.lower, given.upper)


def test_the_clique_tree_method_solves_what_takes_others_too_long(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[str] = []
    own = relaxation_bound.solve_conic
    monkeypatch.setattr(
        relaxation_bound,
        "solve_conic",
        lambda p, name, *more: asked.append(name) or own(p, name, *more),
    )
    monkeypatch.setattr(size_limits, "_OPERATIONS", 1e6)  # a block of 28 rows takes 2e7
    result = sp.solve(dense())
    assert set(asked) == {"cliquetree"} and not result.notes
    assert 1.0 - 1e-5 <= result.lower_bound <= 1.0
    assert result.certificate.verify(dense()).ok


@pytest.mark.parametrize(
    ("name", "value", "options", "missing"),
    [
        ("_OPERATIONS", 1e6, {"solver": "clarabel"}, "1e+06 operations a step"),
        ("_ALONE", 1e5, {}, "1e+05 operations a step"),
        ("_A_SECOND", 1.0, {"time_limit": 60}, "the time left"),
        ("_OPERATIONS", 1e6, {"memory_limit": 2e5}, "0.0002 GB"),  # 12 * 406^2 bytes are 2e6
    ],
    ids=["solver", "operations", "time", "memory"],
)
def test_notes_say_what_is_missing(
    monkeypatch: pytest.MonkeyPatch, name: str, value: float, options: dict[str, Any], missing: str
) -> None:
    monkeypatch.setattr(size_limits, "_OPERATIONS", 1e6)
    monkeypatch.setattr(size_limits, name, value)
    result = sp.solve(dense(), sp.Options(**options))
    (note,) = result.notes
    assert f"the relaxation of order 2 needs more than {missing};" in note
    assert result.lower_bound <= 1.0 and result.certificate.verify(dense()).ok
