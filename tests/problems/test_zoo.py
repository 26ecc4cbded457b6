"""Problems with known optima: every bound is below, attained, proved and (mostly) tight.

The optima come from closed forms and the literature (``tests/problems/zoo/*.toml`` names the source
of each); the texts are also evaluated here by Python itself, apart from the package.
"""

from __future__ import annotations

import functools
import re
import tomllib
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from exact_polynomials import value_at
from scipy import optimize

import sparsepop_py as sp

FILES = sorted((Path(__file__).parent / "zoo").glob("*.toml"))
ENTRIES = [
    {**entry, "file": path.stem}
    for path in FILES
    for entry in tomllib.loads(path.read_text())["problem"]
]
ZOO = {entry["name"]: entry for entry in ENTRIES}
FIELDS = {"name", "text", "orders", "optimum", "digits", "minimiser", "source", "verification"}
FLAGS = {"relaxation", "loose", "unproved", "slow"}
TIGHT = 1e-5

CASES = [
    pytest.param(
        name,
        order,
        id=f"{name}-{order}",
        marks=[pytest.mark.slow] if order in entry.get("slow", ()) else [],
    )
    for name, entry in ZOO.items()
    for order in entry["orders"]
]
cases = pytest.mark.parametrize(("name", "order"), CASES)
names = pytest.mark.parametrize("name", ZOO)


@functools.cache
def solved(name, order):
    return sp.solve(sp.parse(ZOO[name]["text"]), sp.Options(order=order))


def scale(entry):
    return max(1.0, abs(entry["optimum"]))


# ---- the texts, read by Python instead of by the package --------------------------------------


def by_python(text):
    """Objective, inequalities and equalities as functions of x, by ``eval``; and the letters."""
    text = " ".join(text.split()).replace("^", "**")
    head, *rows = [row.strip().removeprefix("s.t.") for row in text.split(";")]
    letters = sorted(set(re.findall(r"x\d+", text)), key=lambda name: int(name[1:]))

    def function(expression):
        code = compile(expression.strip(), "zoo", "eval")
        return lambda x: eval(code, {}, dict(zip(letters, x, strict=True)))

    relations = [(re.split(r">=|==", row), "==" in row) for row in rows]
    for (_, right), _ in relations:
        assert float(right) == 0.0
    return (
        function(head.removeprefix("min")),
        [function(left) for (left, _), equal in relations if not equal],
        [function(left) for (left, _), equal in relations if equal],
        letters,
    )


def test_the_zoo_is_complete():
    assert len(ENTRIES) == len(ZOO) >= 45
    for entry in ENTRIES:
        keys = set(entry) - {"file"}
        assert FIELDS <= keys <= FIELDS | FLAGS
        assert entry["source"].strip()
        assert entry["verification"].strip()
        orders = {str(order) for order in entry["orders"]}
        for flag in ("relaxation", "loose", "unproved"):
            assert set(entry.get(flag, {})) <= orders
    flagged = sum(len(entry.get("loose", {})) + len(entry.get("unproved", {})) for entry in ENTRIES)
    assert flagged <= len(CASES) // 4  # the flags are the exception


@names
def test_the_text_is_read_as_python_reads_it(name):
    entry = ZOO[name]
    problem = sp.parse(entry["text"])
    f, inequalities, equalities, letters = by_python(entry["text"])
    assert list(problem.names) == letters
    rng = np.random.default_rng(len(name))
    for _ in range(5):
        x = rng.uniform(-2, 2, problem.dimension)
        assert problem.objective(x) == pytest.approx(f(x), rel=1e-9, abs=1e-9)
        worst = max(
            [0.0, *(-g(x) for g in inequalities), *(abs(h(x)) for h in equalities)], default=0.0
        )
        assert problem.violation(x) == pytest.approx(worst, rel=1e-9, abs=1e-9)


@names
def test_the_listed_minimiser_attains_the_listed_optimum(name):
    entry = ZOO[name]
    f, inequalities, equalities, _ = by_python(entry["text"])
    x = entry["minimiser"]
    assert f(x) == pytest.approx(entry["optimum"], rel=1e-4, abs=1e-4)
    step = 1e-5 * (1.0 + np.abs(x))  # the points are given to about six digits
    for g, equal in [(g, False) for g in inequalities] + [(h, True) for h in equalities]:
        slopes = [abs(g(np.add(x, step * unit)) - g(x)) for unit in np.eye(len(x))]
        value = g(x)
        assert (abs(value) if equal else -value) <= sum(slopes) + 1e-9


# ---- the bounds --------------------------------------------------------------------------------


# 0.1 is no double: the squares do not add up exactly, and a sublevel box has to serve.


@cases
def test_the_bound_is_below_the_optimum_and_close(name, order):
    entry, result = ZOO[name], solved(name, order)
    known = 10.0 ** -entry["digits"] * scale(entry)
    assert result.lower_bound <= entry["optimum"] + known
    if str(order) in entry.get("unproved", {}):
        return
    assert np.isfinite(result.lower_bound)
    slack = TIGHT * scale(entry)
    if str(order) in entry.get("loose", {}):
        weaker = entry.get("relaxation", {}).get(str(order), -np.inf)
        assert result.lower_bound >= weaker - slack
    else:
        assert result.lower_bound >= entry["optimum"] - slack


@cases
def test_the_attained_value_is_attained(name, order):
    entry, result = ZOO[name], solved(name, order)
    known = max(10.0 ** -entry["digits"], 1e-9) * scale(entry)
    assert result.upper_bound >= max(result.lower_bound, entry["optimum"] - known)
    assert result.upper_bound <= entry["optimum"] + TIGHT * scale(entry)
    assert result.gap == result.upper_bound - result.lower_bound or not np.isfinite(result.gap)
    problem = sp.parse(entry["text"])
    rows = [c.polynomial.coefficients for c in problem.constraints]
    size = max([1.0, *(float(np.abs(row).max(initial=0.0)) for row in rows)])
    assert problem.violation(result.x) <= 1e-9 * size
    attained = result.attained
    if attained.proof == "exact" and attained.radius == 0.0:
        point = [Fraction(v) for v in attained.x.tolist()]
        for constraint in problem.constraints:
            value = value_at(constraint.polynomial, point)
            assert value == 0 if constraint.kind is sp.Kind.ZERO else value >= 0
        assert value_at(problem.objective, point) <= Fraction(attained.value)


@cases
def test_the_certificate_verifies_on_the_text_read_again(name, order):
    entry, result = ZOO[name], solved(name, order)
    if str(order) in entry.get("unproved", {}) and result.certificate is None:
        assert result.lower_bound == -np.inf
        return
    verdict = result.certificate.verify(sp.parse(entry["text"]))
    assert verdict.ok, verdict.reason
    assert verdict.bound >= result.lower_bound == result.certificate.bound


@pytest.mark.slow
@names
def test_no_local_search_finds_less(name):
    """The listed optimum against SLSQP from 40 points, with functions read by Python."""
    entry = ZOO[name]
    f, inequalities, equalities, letters = by_python(entry["text"])
    constraints = [{"type": "ineq", "fun": g} for g in inequalities]
    constraints += [{"type": "eq", "fun": h} for h in equalities]
    rng = np.random.default_rng(7)
    reach = 1.0 + np.abs(entry["minimiser"])
    size = max([1.0, *(abs(g(np.zeros(len(letters)))) for g in inequalities + equalities)])
    best = f(entry["minimiser"])
    for _ in range(40):
        with np.errstate(all="ignore"):
            found = optimize.minimize(
                f,
                entry["minimiser"] + reach * rng.normal(size=len(letters)),
                method="SLSQP",
                constraints=constraints,
                options={"maxiter": 300, "ftol": 1e-12},
            )
        with np.errstate(all="ignore"):
            worst = max([0.0, *(-g(found.x) for g in inequalities)])
            worst = max([worst, *(abs(h(found.x)) for h in equalities)])
        if np.isfinite(found.fun) and worst <= 1e-9 * size:
            best = min(best, found.fun)
    assert best >= entry["optimum"] - 1e-5 * scale(entry)
