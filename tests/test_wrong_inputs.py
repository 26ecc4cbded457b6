"""Arguments of wrong kinds are refused by name, before any work starts."""

from __future__ import annotations

import dataclasses
from functools import reduce

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py import problems

X, Y = sp.variables(2)
F = X * Y
P = sp.Problem(F, [X**2 + Y**2 <= 1], -1, 1)
OBJECTIVE, ROWS, LOW, HIGH = sp.to_structs(P)
R = sp.RationalProblem(X / (1 + Y**2), lower=-1, upper=1)
HUGE, FLAT, PAIR, RAGGED = 10**400, np.array(3), np.array([1, 2]), [[1, 2], [3]]
NESTED = reduce(lambda inner, _: [inner], range(3000), [])  # which repr() cannot print
PROGRAM = sp.assemble(sp.relax(P), F)
RESULT, PROOF = sp.solve(P, sp.Options(order=1)), sp.solve(R).certificate
BOUND = sp.linear_bounds(sp.Problem(X, lower=0, upper=1), [X])[0]
CHECKS = [
    RESULT.certificate.recompute,
    RESULT.certificate.settled,
    RESULT.attained.recheck,
    PROOF.recompute,
    PROOF.proved_ranges,
]
SWITCHES = ("reduce", "lean", "products", "partial")
FIELDS = [field.name for field in dataclasses.fields(sp.Switches) if field.name != "order"]
LIMITS = ("time_limit", "accuracy", "target", "max_iterations", "solves")


def struct(lower=LOW, param=None):
    return sp.sparsePOP(OBJECTIVE, ROWS, lower, HIGH, param)


WRONG = [
    ("names", lambda: sp.Problem(F, names=3)),
    ("lower", lambda: sp.Problem(F, lower=np.array(["1971"], "M8[Y]"))),
    ("lower", lambda: sp.Problem(F, lower=np.array(["0", "1"]))),
    ("lower", lambda: sp.Problem(F, lower=np.array(["0", "1"], object))),
    ("lower", lambda: sp.Problem(F, lower=np.array([np.timedelta64(3, "s"), 0], object))),
    ("upper", lambda: sp.Problem(F, upper=[1 + 2j, 3])),
    ("coefficients", lambda: sp.Polynomial.from_terms([[1, 0]], np.array([1 + 2j]))),
    ("squares", lambda: sp.Problem(F, squares=3)),
    ("squares", lambda: sp.Problem(F, squares=[("a", X)])),
    ("squares", lambda: sp.Problem(F, squares=[(None, X)])),
    ("squares", lambda: sp.Problem(F, squares=[(HUGE, X)])),
    ("squares", lambda: sp.Problem(F, squares=[(1.0, X, Y)])),
    ("constraints", lambda: sp.Problem(F, FLAT)),
    ("sense", lambda: sp.Problem(F, sense=PAIR)),
    ("constraints", lambda: sp.RationalProblem(X / (1 + Y**2), 3)),
    ("Options.branch_on", lambda: sp.Options(branch_on=FLAT)),
    ("Options.skip", lambda: sp.Options(skip=FLAT)),
    ("Options.order", lambda: sp.Options(order=10**5000)),
    ("options", lambda: sp.solve(P, PAIR)),
    ("options", lambda: sp.solve_each(P, [X], PAIR)),
    ("on_progress", lambda: sp.solve(P, on_progress=3)),
    ("on_progress", lambda: sp.solve_each(P, [X], on_progress=3)),
    ("objectives", lambda: sp.solve_each(P, None)),
    ("Options.branch_on", lambda: sp.solve_each(P, [X], branch_on=3)),
    ("points", lambda: sp.solve_each(P, [X], points=None)),
    ("points", lambda: sp.solve_each(P, [X], points="a")),
    (r"points\[0\]", lambda: sp.solve_each(P, [X], points=["a"])),
    ("repair", lambda: sp.solve_each(P, [X], repair=3)),
    ("repair", lambda: sp.solve_each(P, [F], repair=lambda v: "a")),
    ("repair", lambda: sp.solve_each(P, [F], repair=lambda v: v[:1])),
    ("problem", lambda: sp.to_structs(None)),
    ("problem", lambda: sp.relax(None)),
    ("problem", lambda: sp.find_cliques(None)),
    ("program", lambda: sp.solve_conic(None)),
    ("problem", lambda: sp.compare_orders(None, [1])),
    *(
        ("order", lambda v=v: sp.relax(P, v))
        for v in ("a", 1.5, np.inf, HUGE, 10**5000, True, 0, -3)
    ),
    ("orders", lambda: sp.compare_orders(P, 3)),
    ("orders", lambda: sp.compare_orders(P, b"x")),
    ("orders", lambda: sp.compare_orders(P, [])),
    ("total", lambda: sp.total(3)),
    ("names", lambda: sp.variables(2, 3)),
    ("n", lambda: sp.variables(HUGE)),
    ("n", lambda: sp.variables(10**5000)),
    ("n", lambda: sp.variables(10**9)),  # 400 GB
    ("second_order", lambda: sp.second_order(FLAT)),
    ("second_order", lambda: sp.second_order(X, HUGE)),
    ("exponent", lambda: X**HUGE),
    ("exponent", lambda: X ** (10**5000)),
    ("x", lambda: P.violation([HUGE, 1])),
    ("x", lambda: P.violation("a")),
    ("x", lambda: P.violation({})),
    ("x", lambda: X("a")),
    ("sparsePOP", lambda: sp.sparsePOP(X)),
    ("lbd", lambda: struct(RAGGED)),
    ("param", lambda: struct(param=RAGGED)),
    ("param.tighten", lambda: struct(param={"tighten": 1 + 0j})),
    ("param.sparseSW", lambda: struct(param={"sparseSW": 1 + 0j})),
    ("param.printFileName", lambda: struct(param={"printFileName": 1 + 0j})),
    ("param.relaxOrder", lambda: struct(param={"relaxOrder": HUGE})),
    ("Options.branch_on", lambda: sp.solve(R, sp.Options(branch_on=[2]))),  # of x1 and x2 alone
    *(("start", lambda v=v: sp.solve(R, start=v)) for v in ("a", ["1", "2"], [1j, 0], RAGGED)),
    *(("start", lambda v=v: sp.solve(P, start=v)) for v in (["1", "2"], [HUGE, 0], [np.nan, 0])),
    ("x", lambda: R.violation("a")),
    ("level", lambda: R.single_ratio("a")),
    ("level", lambda: R.single_ratio([1.0])),
    ("denominator", lambda: R.place(3)),
    ("denominator", lambda: R.place(X)),
    ("ranges", lambda: R.lifted(None)),
    (r"ranges\[0\]", lambda: R.lifted([3])),
    ("ranges", lambda: sp.RationalCertificate("r1:", 0.0, None)),
    ("ratios", lambda: sp.Rational(X, None)),
    (r"ratios\[0\]", lambda: sp.Rational(X, (X,))),
    (r"ratios\[0\]", lambda: sp.Rational(X, ((X, Y, X),))),
    ("problem", lambda: sp.linear_bounds(R, [X])),
    ("objectives", lambda: sp.linear_bounds(sp.Problem(X), X)),
    ("objectives", lambda: sp.linear_bounds(sp.Problem(X), None)),
    ("relaxation", lambda: sp.assemble(P, X)),
    ("objective", lambda: sp.assemble(sp.relax(P), 3)),
    ("objective", lambda: sp.assemble(sp.relax(P), sp.variables(1)[0])),
    *(("exponents", lambda v=v: sp.Polynomial.from_terms(v, [1.0])) for v in (None, "x", RAGGED)),
    ("exponents", lambda: sp.Polynomial.from_terms(np.zeros((2, 2, 2)), [1.0, 1.0])),
    ("exponents", lambda: sp.Polynomial.from_terms([[1j, 0]], [1.0])),
    *(("names", lambda v=v: sp.Polynomial.from_terms([[1, 0]], [1.0], v)) for v in (3, FLAT)),
    *(("variable", lambda v=v: X.name(v)) for v in (None, "x", -1, 2, 0.5, True, np.nan)),
    *(("i", lambda v=v: sp.psd([[1, X], [X, 1]]).position(v, 0)) for v in (None, 2, -1, 0.5)),
    ("objective", lambda: sp.Problem(HUGE, [X <= 1])),
    *(("lower", lambda v=v: sp.Problem(F, lower=v)) for v in (NESTED, [NESTED])),
    *(("sense", lambda v=v: sp.Problem(F, sense=v)) for v in (NESTED, -(10**5000))),
    *((name, lambda n=name: sp.relax(P, **{n: "no"})) for name in SWITCHES),
    *((name, lambda n=name: sp.relax(P, **{n: PAIR})) for name in (*SWITCHES, "shape", "terms")),
    *(("cliques", lambda v=v: sp.relax(P, cliques=v)) for v in (0, [], "x", PAIR)),
    *(("objectives", lambda v=v: sp.relax(P, objectives=v)) for v in (None, 3, "x")),
    (r"objectives\[0\]", lambda: sp.relax(P, objectives=[3])),
    (r"objectives\[0\]", lambda: sp.find_cliques(P, objectives=[sp.variables(1)[0]])),
    *(("objectives", lambda v=v: sp.find_cliques(P, objectives=v)) for v in (None, 3, "x")),
    *((name, lambda n=name: sp.find_cliques(P, **{n: []})) for name in ("sparse", "method")),
    *(("joined", lambda v=v: sp.find_cliques(P, joined=v)) for v in (None, "x", PAIR)),
    *((f"Switches.{n}", lambda n=n: sp.Switches(**{n: None})) for n in FIELDS),
    *((f"Switches.{n}", lambda n=n: sp.Switches(**{n: PAIR})) for n in FIELDS),
    *(("Switches.order", lambda v=v: sp.Switches(order=v)) for v in ("x", np.nan, np.inf, -1)),
    *((n, lambda n=n: sp.compare_orders(P, [1], **{n: 3})) for n in ("efforts", "cliques")),
    *((n, lambda n=n: sp.compare_orders(P, [1], **{n: PAIR})) for n in ("efforts", "cliques")),
    *(("title", lambda v=v: sp.write_sdpa(PROGRAM, "none", v)) for v in (None, b"x")),
    ("solver", lambda: sp.solve_conic(PROGRAM, None)),
    *((n, lambda n=n: sp.solve_conic(PROGRAM, **{n: np.nan})) for n in LIMITS),
    *((n, lambda n=n: sp.solve_conic(PROGRAM, **{n: "x"})) for n in LIMITS),
    *((n, lambda n=n: sp.solve_conic(PROGRAM, **{n: True})) for n in LIMITS),
    *((n, lambda n=n: sp.solve_conic(PROGRAM, **{n: -1})) for n in LIMITS if n != "target"),
    *(("problem", lambda call=call: call(None)) for call in CHECKS),
    ("problem", lambda: BOUND.verify(None, X)),
    *(("known", lambda v=v: RESULT.certificate.verify(P, v)) for v in (3, [], PAIR)),
    ("base", lambda: PROOF.ranges[0].prove(None, 1 + Y**2)),
    ("denominator", lambda: PROOF.ranges[0].prove(R.base, 3)),
    *(("digits", lambda v=v: sp.rounded(1.0, True, v)) for v in (True, 0, 16, "x")),
    *(("upwards", lambda v=v: sp.rounded(1.0, v)) for v in (None, "no", PAIR)),
    ("scientific", lambda: sp.rounded(1.0, True, scientific=PAIR)),
    *(("n", lambda f=f: f(4 * 10**8)) for f in (problems.rosenbrock, problems.planted_point)),
    *(("n", lambda v=v: problems.chained_wood(v)) for v in (NESTED, None, 8.0)),
    *(("clique", lambda v=v: problems.random_quartic(8, v)) for v in (1.5, "x", PAIR)),
    ("clique", lambda: problems.random_quartic(10**6)),  # 5e11 terms
    *(("seed", lambda v=v: problems.random_quartic(3, seed=v)) for v in (None, 1.5, -1, "x")),
    *(("seed", lambda v=v: problems.planted_point(3, v)) for v in (None, 1.5, -1, "x")),
    *((n, lambda n=n: problems.random_quartic(3, **{n: "x"})) for n in ("density", "optimum")),
    *((n, lambda n=n: problems.bilinear_control(3, **{n: "x"})) for n in ("mu", "rest")),
    (r"steps \* states .*", lambda: problems.bilinear_control(3, states=10**5)),
]


@pytest.mark.parametrize(("place", "call"), WRONG, ids=[f"{k} {w[0]}" for k, w in enumerate(WRONG)])
def test_wrong_arguments_are_named(place, call):
    with pytest.raises(sp.ProblemError, match=rf"^{place}: found .*"):
        call()


def test_what_is_no_problem_is_not_written(tmp_path):
    with pytest.raises(sp.ProblemError, match="problem: found NoneType, expected a Problem"):
        sp.write_gms(None, tmp_path / "out.gms")
    assert not list(tmp_path.iterdir())


def test_arrays_serve_as_lists():
    assert sp.Options(branch_on=np.array([0, 1])).branch_on == (0, 1)


def test_integers_of_numpy_serve_as_digits():
    assert sp.rounded(0.25, True, np.int64(1)) == "0.3"
