"""The compiler: hand-built rows, exact linear programs, symbolic expansion, properties."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st
from identification_cases import (
    PLANT,
    laboratory_two_first,
    laboratory_two_second,
    linear_intervals,
)

import setid
import sparsepop_py as sp
from setid.formulation.formulation import lifted, multiplied_out
from sparsepop_py.relaxation.shapes import Products

FIRST = setid.TransferFunction(na=1, nb=1)
SECOND = setid.TransferFunction(na=2, nb=3)


def as_sympy(polynomial: sp.Polynomial, names: tuple[str, ...]) -> sympy.Expr:
    symbols = [sympy.Symbol(name) for name in names]
    total: sympy.Expr = sympy.Integer(0)
    for word, value in zip(polynomial.words, polynomial.coefficients, strict=True):
        total += sympy.Float(value, 20) * sympy.prod([symbols[i - 1] for i in word if i])
    return sympy.expand(total)


def same(left: sympy.Expr, right: sympy.Expr) -> bool:
    rest = sympy.expand(left - right)
    return all(abs(float(c)) < 1e-12 for c in rest.as_coefficients_dict().values())


# ---- the problem of the notes -----------------------------------------------------------


def by_hand(data: setid.IOData, output: float, input: float) -> sp.Problem:
    """Errors in variables, n = 2, as a user of SparsePOP types it: 12 terms a row."""
    n, y, u = data.samples, data.y.ravel(), data.u.ravel()
    size = 5 + 2 * n
    rows = []
    for k in range(2, n):
        supports, coef = np.zeros((12, size)), np.zeros((12, 1))
        terms = [
            (y[k], []), (-1, [5 + k]),
            (y[k - 1], [0]), (-1, [0, 5 + k - 1]),
            (y[k - 2], [1]), (-1, [1, 5 + k - 2]),
            (-u[k], [2]), (1, [2, 5 + n + k]),
            (-u[k - 1], [3]), (1, [3, 5 + n + k - 1]),
            (-u[k - 2], [4]), (1, [4, 5 + n + k - 2]),
        ]  # fmt: skip
        for t, (value, places) in enumerate(terms):
            coef[t] = value
            supports[t, places] = 1
        rows.append({"typeCone": -1, "sizeCone": 1, "dimVar": size, "degree": 2,
                     "noTerms": 12, "supports": supports, "coef": coef})  # fmt: skip
    first = np.zeros((1, size))
    first[0, 0] = 1
    objective = {"typeCone": 1, "dimVar": size, "noTerms": 1, "supports": first, "coef": [1.0]}
    bound = np.concatenate([np.full(5, 1e10), np.full(n, output), np.full(n, input)])
    return sp.from_structs(objective, rows, -bound, bound)


def test_errors_in_variables_equal_the_hand_built_problem() -> None:
    truth = setid.simulate_record(
        SECOND, PLANT, np.random.default_rng(0).uniform(size=9), setid.Noise(1.0, 0.01), seed=1
    )
    formulation = setid.formulate(truth.data, SECOND, setid.Noise(output=1.0, input=0.01))
    assert formulation.problem.fingerprint == by_hand(truth.data, 1.0, 0.01).fingerprint
    assert {c.polynomial.terms for c in formulation.problem.constraints} == {12}
    assert formulation.problem.names[:8] == (*SECOND.parameters, "eta[1]", "eta[2]", "eta[3]")
    assert formulation.rows.sample.tolist() == list(range(3, 10))


def test_structs_and_files_hold_the_same_problem(tmp_path) -> None:
    formulation = setid.formulate(laboratory_two_first(), FIRST, setid.Noise(output=0.5))
    assert sp.from_structs(*formulation.structs()).fingerprint == formulation.problem.fingerprint
    formulation.to_gms(tmp_path / "first.gms")
    assert sp.read_gms(tmp_path / "first.gms").fingerprint == formulation.problem.fingerprint


# ---- exact intervals of the laboratories ------------------------------------------------


def test_first_problem_of_laboratory_two() -> None:
    data = laboratory_two_first()
    half = linear_intervals(setid.formulate(data, FIRST, setid.Noise(equation=0.5)))
    expected = [[-0.5232558, -0.3453333], [1.9166667, 2.1093023]]
    np.testing.assert_allclose(half, expected, atol=5e-8)
    small = linear_intervals(setid.formulate(data, FIRST, setid.Noise(equation=0.4)))
    np.testing.assert_allclose(small, [[-0.4574468, -0.372], [1.95, 2.0229651]], atol=5e-8)
    assert small[0, 0] > -0.5, "the largest error is 0.5: the truth is cut off"
    none = linear_intervals(setid.formulate(data, FIRST, setid.Noise(equation=0.33)))
    assert np.isnan(none).all()
    enough = linear_intervals(setid.formulate(data, FIRST, setid.Noise(equation=0.33903)))
    np.testing.assert_allclose(enough.mean(axis=1), [-0.3882591, 1.9703239], atol=1e-5)


def test_the_truth_on_the_boundary_is_not_lost_to_rounding() -> None:
    formulation = setid.formulate(laboratory_two_first(), FIRST, setid.Noise(equation=0.5))
    assert formulation.problem.violation(formulation.point([-0.5, 2.0])) == 0.0


LABORATORY_TWO = {
    0.1: "-.76480516 -.7646618 .30118614 .30128134 -.00210344 .00116923 "
    "32.23870459 32.24161953 21.40741038 21.41239205",
    0.5: "-.76522816 -.76451111 .30113097 .30160648 -.0105348 .00587278 "
    "32.23344296 32.24813495 21.39691935 21.42202582",
    1.0: "-.76576269 -.76432727 .30106268 .30201263 -.02112854 .01181338 "
    "32.22668031 32.25638247 21.38349631 21.43427387",
    10.0: "-.7770409 -.76176647 .29985651 .30939932 -.22607366 .16163805 "
    "32.05432197 32.40861515 20.94847675 21.64532556",
    100.0: "-.78188034 -.76050426 .29331035 .32051921 -1.79069372 3.01264336 "
    "30.89057355 33.52252942 19.41983511 22.41571723",
}


@pytest.mark.parametrize("bound", LABORATORY_TWO)
def test_second_problem_of_laboratory_two(bound: float) -> None:
    data = laboratory_two_second(bound)
    if bound == 0.5:
        assert data.u[:4].ravel() == pytest.approx(
            [0.81472369, 0.90579194, 0.12698682, 0.91337586], abs=5e-9
        )
        assert data.y[2, 0] == pytest.approx(46.77715491, abs=5e-9)
    found = linear_intervals(setid.formulate(data, SECOND, setid.Noise(equation=bound)))
    expected = np.array(LABORATORY_TWO[bound].split(), float).reshape(5, 2)
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-7)


# ---- symbolic expansion -----------------------------------------------------------------


def test_separate_denominators_are_multiplied_out() -> None:
    model = setid.TransferFunction(1, 1, nk=1, inputs=2, form="direct")
    rng = np.random.default_rng(5)
    data = setid.IOData(rng.uniform(size=(4, 2)), rng.uniform(size=4))
    formulation = setid.formulate(data, model, setid.Noise(output=0.1, input=[0.0, 0.2]))
    q = sympy.Symbol("q")
    a, c, b, d = (sympy.Symbol(f"{n}[1,{j}]1") for n in "ab" for j in (1, 2))
    k = 2  # from 0

    def shifted(operator: sympy.Expr, values: list[sympy.Expr]) -> sympy.Expr:
        powers = sympy.Poly(operator, q)
        return sum(powers.coeff_monomial(q**i) * values[i] for i in range(powers.degree() + 1))

    y = [sympy.Float(data.y[k - i, 0], 20) - sympy.Symbol(f"eta[{k - i + 1}]") for i in range(3)]
    u = [sympy.Float(data.u[k - i, 0], 20) for i in range(3)]
    v = [sympy.Float(data.u[k - i, 1], 20) - sympy.Symbol(f"xi2[{k - i + 1}]") for i in range(3)]
    one, two = 1 + a * q, 1 + c * q
    row = shifted(one * two, y) - shifted(b * q * two, u) - shifted(d * q * one, v)
    found = as_sympy(formulation.problem.constraints[0].polynomial, formulation.layout.names)
    assert same(found, row)
    assert formulation.regression is None


@pytest.mark.parametrize("offset", [False, True])
def test_lifted_rows_are_those_of_the_multiplied_form(offset: bool) -> None:
    """Each sum of products stands for its definition; put in, rows are the same polynomials."""
    rng = np.random.default_rng(6)
    data = setid.IOData(rng.uniform(size=(20, 3)), rng.uniform(size=20))
    noise = setid.Noise(output=0.1, input=[0.0, 0.2, 0.0])
    model = setid.TransferFunction([[2, 1, 0]], [[1, 2, 1]], 1, 3, offset=offset, form="multiplied")
    plain = setid.formulate(data, model, noise)
    found = setid.formulate(data, replace(model, form="lifted"), noise)
    names = found.layout.names
    assert names[: len(plain.layout.names)] == plain.layout.names
    places = found.layout.group("lifted").tolist()
    rows = [as_sympy(c.polynomial, names) for c in found.problem.constraints]
    own = [sympy.Symbol(names[number]) for number in places]
    sums: dict[sympy.Symbol, sympy.Expr] = {}
    for x, row in zip(own, rows, strict=False):
        assert degree_of(row) <= 2
        sums[x] = sympy.expand((x - row).subs(sums))
    assert all(not set(own) & value.free_symbols for value in sums.values())
    wanted = [as_sympy(c.polynomial, plain.layout.names) for c in plain.problem.constraints]
    assert len(rows) == len(own) + len(wanted)
    assert all(same(a.subs(sums), b) for a, b in zip(rows[len(own) :], wanted, strict=True))
    assert (plain.problem.degree, max(map(degree_of, rows[len(own) :]))) == (3, 2)
    assert Products.of(found.problem).has_star
    assert np.isinf(found.problem.lower[places]).all()
    assert np.isinf(found.problem.upper[places]).all()


ONE, TWO = setid.TransferFunction(1, 1, 1), setid.TransferFunction(2, 1, 1)


def parallel(normalise: object) -> setid.BlockStructured:
    """Two inputs, one of them through a square."""
    wires = {("y1", "w"): ONE, ("y1", "u2"): TWO}
    return setid.BlockStructured(wires, {"w": setid.StaticMap("u1", 2)}, 2, 1, normalise)


def block_record(model: setid.BlockStructured) -> setid.Formulation:
    rng = np.random.default_rng(7)
    data = setid.IOData(rng.uniform(size=(20, model.inputs)), rng.uniform(size=20))
    return setid.formulate(data, model, setid.Noise(output=0.1))


@pytest.mark.parametrize(
    ("model", "degree"), [(parallel("gamma1"), 3), (setid.Lure(ONE, 2, "nolinear"), 3)]
)
def test_lifted_block_structures_have_the_same_rows(
    model: setid.BlockStructured, degree: int
) -> None:
    plain = block_record(model)
    found = lifted(plain)
    assert (plain.problem.degree, found.problem.degree) == (degree, 2)
    names, sums = found.layout.names, {}
    rows = [as_sympy(c.polynomial, names) for c in found.problem.constraints]
    for number, row in zip(found.layout.group("lifted").tolist(), rows, strict=False):
        x = sympy.Symbol(names[number])
        sums[x] = sympy.expand((x - row).subs(sums))
    wanted = [as_sympy(c.polynomial, plain.layout.names) for c in plain.problem.constraints]
    pairs = zip(rows[len(sums) :], wanted, strict=True)
    assert sums and all(same(a.subs(sums), b) for a, b in pairs)
    again = multiplied_out(found)
    assert again.problem.fingerprint == plain.problem.fingerprint


@pytest.mark.parametrize(
    "model",
    [
        setid.Hammerstein(ONE, 2, "gamma1"),  # products multiply known samples alone
        setid.Wiener(ONE, 2, "gamma1", initial="zero"),  # no products
        parallel({"gamma1": 0.3, "gamma2": 0.7}),  # b1 multiplies u1 and u1^2: readings add up
    ],
)
def test_nothing_is_lifted_in_vain(model: setid.BlockStructured) -> None:
    plain = block_record(model)
    assert lifted(plain) is plain


def degree_of(row: sympy.Expr) -> int:
    return int(sympy.Poly(row).total_degree())


@pytest.mark.parametrize("cut", [False, True])
def test_polynomial_rows(cut: bool) -> None:
    model = setid.PolynomialNARX(["1", "y1", "u0^2", "y1*u1^2"], ny=1, nu=1, degree_cut=cut)
    rng = np.random.default_rng(6)
    data = setid.IOData(rng.uniform(size=3), rng.uniform(size=3))
    formulation = setid.formulate(data, model, setid.Noise(output=0.1, input=0.2))
    names = formulation.layout.names
    y = [sympy.Float(v, 20) - sympy.Symbol(f"eta[{i}]") for i, v in enumerate(data.y[:, 0], 1)]
    u = [sympy.Float(v, 20) - sympy.Symbol(f"xi[{i}]") for i, v in enumerate(data.u[:, 0], 1)]
    c = [sympy.Symbol(name) for name in model.parameters]
    expected = y[2] - c[0] - c[1] * y[1] - c[2] * u[2] ** 2 - c[3] * y[1] * u[1] ** 2
    rows = {row.name: as_sympy(row.polynomial, names) for row in formulation.problem.constraints}
    found = rows["y1[3]"]
    if cut:
        assert formulation.problem.degree == 2
        products = {"p[u0^2][3]": u[2] ** 2, "p[y0*u0][2]": y[1] * u[1]}
        found = found.subs(sympy.Symbol("p[y0*u0^2][2]"), sympy.Symbol("p[y0*u0][2]") * u[1])
        found = found.subs({sympy.Symbol(k): v for k, v in products.items()})
    else:
        assert formulation.problem.degree == 4
    assert same(sympy.expand(found), expected)


def test_products_of_noisy_samples_get_ranges_from_the_data() -> None:
    model = setid.PolynomialNARX(["u0^2", "y1*u0"], ny=1, nu=0)
    data = setid.IOData([0.5, -2.0], [1.0, 3.0])
    problem = setid.formulate(data, model, setid.Noise(output=0.5, input=1.0)).problem
    box = dict(zip(problem.names, zip(problem.lower, problem.upper, strict=True), strict=True))
    assert box["p[u0^2][2]"] == pytest.approx((1.0, 9.0), abs=1e-12)  # (-2 +- 1)^2
    low, high = box["p[y0*u0][2]"] if "p[y0*u0][2]" in box else box["p[y1*u0][2]"]
    assert low <= -4.5 and high >= -0.5  # (1 +- 0.5) (-2 +- 1)
    assert "p[u0^2][1]" not in box, "unused products have no variable"


def test_exact_factors_need_no_products() -> None:
    model = setid.PolynomialNARX(["u0^2", "y1*u0"], ny=1, nu=0)
    data = setid.IOData([0.5, -2.0, 1.0], [1.0, 3.0, 2.0])
    problem = setid.formulate(data, model, setid.Noise(output=0.5)).problem
    assert problem.names == (*model.parameters, "eta[1]", "eta[2]", "eta[3]")


# ---- properties -------------------------------------------------------------------------

MODELS = {
    "first": (setid.TransferFunction(1, 1, 1), [-0.7, 2.0]),
    "third": (setid.TransferFunction(3, 2, 1), [-1.2, 0.5, -0.06, 1.0, 0.4]),
    "zero": (setid.TransferFunction(2, 3, initial="zero"), PLANT.tolist()),
    "offset": (setid.TransferFunction(1, 2, offset=True), [-0.5, 1.0, 0.3, 0.7]),
    "fir": (setid.TransferFunction(0, 3), [1.0, 0.5, 0.25]),
    "static": (setid.TransferFunction(0, 1), [2.5]),
    "miso": (setid.TransferFunction(1, 1, 1, inputs=2), [-0.6, -0.3, 1.0, 2.0]),
    "miso zero": (setid.TransferFunction(1, 1, 1, 2, initial="zero"), [-0.6, -0.3, 1.0, 2.0]),
    "multiplied": (setid.TransferFunction(1, 1, 1, 2, form="direct"), [-0.6, -0.3, 1.0, 2.0]),
    "lifted": (
        setid.TransferFunction(1, 1, 1, 3, offset=True, form="lifted"),
        [-0.6, -0.3, 0.2, 1.0, 2.0, -1.0, 0.4],
    ),
    "common": (
        setid.TransferFunction(2, 1, 1, 2, 2, common_denominator=True),
        [-0.9, 0.2, 1.0, 2.0, 3.0, 4.0],
    ),
    "mimo": (
        setid.TransferFunction([[1, 2], [0, 1]], 1, [[0, 1], [1, 1]], 2, 2),
        [-0.5, -0.9, 0.2, 0.3, 1.0, 2.0, 3.0, 4.0],
    ),
    "narx": (setid.PolynomialNARX(["y1", "u1", "y1*u1", "u0^3"], 1, 1), [0.5, 1.0, -0.1, 0.2]),
    "narx uncut": (
        setid.PolynomialNARX(["y1", "u1", "y2*u1^2"], 2, 1, degree_cut=False),
        [0.5, 1.0, -0.1],
    ),
}


APART = ("multiplied", "lifted")  # several denominators, without partial outputs


def truth_of(name: str, noise: setid.Noise, samples: int = 15, seed: int = 0) -> setid.Simulated:
    model, theta = MODELS[name]
    u = np.random.default_rng(seed).uniform(-1, 1, (samples, model.inputs))
    return setid.simulate_record(model, theta, u, noise, seed)


def true_point(formulation: setid.Formulation, truth: setid.Simulated) -> np.ndarray:
    groups = formulation.layout.groups
    signals = {name: values for name, values in truth.signals.items() if name in groups}
    return formulation.point(truth.theta, truth.output, truth.input, truth.equation, signals)


@pytest.mark.parametrize("kind", ["output", "input", "both", "equation"])
@pytest.mark.parametrize("name", MODELS)
def test_the_truth_satisfies_every_row_and_bound(name: str, kind: str) -> None:
    model, _ = MODELS[name]
    noise = {
        "output": setid.Noise(output=0.3),
        "input": setid.Noise(input=0.1),
        "both": setid.Noise(output=0.3, input=0.1),
        "equation": setid.Noise(equation=0.2),
    }[kind]
    partial = name in ("miso", "miso zero", "mimo")
    if kind == "equation" and partial:
        with pytest.raises(setid.ModelError, match="partial outputs"):
            setid.formulate(truth_of(name, setid.Noise()).data, model, noise)
        return
    truth = truth_of(name, noise)
    formulation = setid.formulate(truth.data, model, noise)
    assert formulation.problem.violation(true_point(formulation, truth)) < 1e-12
    found = formulation.regression
    if found is not None:
        theta = np.array(list(truth.theta.values()))
        assert found.margin(theta).min() > -1e-12
        assert np.all(found.radius >= 0) and np.all(found.radii >= 0)
    else:
        assert partial or name in APART


@pytest.mark.parametrize("name", [n for n in MODELS if n not in (*APART, "miso", "mimo")])
@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10**6))
def test_regression_rows_follow_from_the_problem(name: str, seed: int) -> None:
    """Any parameters, with noise that fits them, are inside every regression row."""
    model, theta = MODELS[name]
    noise = setid.Noise(output=0.3, input=0.1)
    rng = np.random.default_rng(seed)
    other = np.array(theta) * rng.uniform(0.7, 1.3, len(theta))
    u = rng.uniform(-1, 1, (10, model.inputs))
    truth = setid.simulate_record(model, other, u, noise, rng)
    formulation = setid.formulate(truth.data, model, noise)
    if formulation.regression is not None:
        assert formulation.regression.margin(other).min() > -1e-12


def test_internal_signals_are_found_when_not_given() -> None:
    noise = setid.Noise(output=0.3, input=0.1)
    for name in ("miso", "miso zero", "narx"):
        truth = truth_of(name, noise)
        formulation = setid.formulate(truth.data, MODELS[name][0], noise)
        x = formulation.point(truth.theta, truth.output, truth.input)
        assert formulation.problem.violation(x) < 1e-9


def test_direct_and_partial_formulations_agree() -> None:
    """A common denominator can be stated both ways: the least noise for theta is the same."""
    direct = setid.TransferFunction(3, 3, 1, inputs=2, common_denominator=True)
    partial = setid.TransferFunction(3, 3, 1, 2, common_denominator=True, form="partial")
    theta = np.array([1.4, 0.76, 0.184, 2.0, 1.8, 0.68, 3.0, 3.4, 1.28])
    r = np.random.RandomState(5489)
    u = np.stack([9 * r.random_sample(50) - 4, 9 * r.random_sample(50) - 4], axis=1)
    eta = 0.02 * r.random_sample((50, 1)) - 0.01
    data = setid.IOData(u, setid.simulate(direct, theta, u) + eta)
    noise = setid.Noise(output=0.01)
    one, two = (setid.formulate(data, model, noise) for model in (direct, partial))
    rng = np.random.default_rng(7)
    for scale in (0.0, 1e-4, 1e-3):
        other = theta * (1 + scale * rng.uniform(-1, 1, 9))
        a, b = setid.least_noise(one, other), setid.least_noise(two, other)
        assert a.level == pytest.approx(b.level, rel=1e-6)
        assert (a.level <= 1) == (scale == 0.0) or scale == 1e-4
    assert one.problem.violation(one.point(theta, eta)) < 1e-12
    assert one.regression is not None and two.regression is not None


def test_witness_level_is_the_least_noise() -> None:
    """For equation errors: the largest residual over the bound."""
    data = laboratory_two_first()
    found = setid.least_noise(setid.formulate(data, FIRST, setid.Noise(equation=0.25)), [-0.5, 2.0])
    assert found.level == pytest.approx(0.5 / 0.25)
    exact = setid.formulate(data, FIRST, setid.Noise(output=0.5))
    assert exact.problem.violation(setid.least_noise(exact, [-0.4, 1.97]).x) < 1e-9
    products = setid.PolynomialNARX(["y1^2"], 1, 0)
    squares = setid.IOData([1, 0, 0], [1.0, 0.6, 0.2])  # 0.5 y^2 would be 0.5, 0.125
    powers = setid.formulate(squares, products, setid.Noise(output=0.5))
    found = setid.least_noise(powers, [0.5])  # by linearising again and again
    assert 0 < found.level < 1
    rows = powers.problem.rows.values(found.x)[powers.problem.equality]
    assert np.abs(rows).max() < 1e-9


@pytest.mark.parametrize("name", MODELS)
def test_more_noise_never_shrinks(name: str) -> None:
    model, _ = MODELS[name]
    small, large = setid.Noise(output=0.1, input=0.05), setid.Noise(output=0.2, input=0.07)
    truth = truth_of(name, small)
    one, two = setid.formulate(truth.data, model, small), setid.formulate(truth.data, model, large)
    assert np.all(two.problem.lower <= one.problem.lower)
    assert np.all(two.problem.upper >= one.problem.upper)
    assert two.problem.violation(true_point(one, truth)) < 1e-12
    if one.regression is not None and two.regression is not None:
        assert np.all(two.regression.radius >= one.regression.radius)
        assert np.all(two.regression.radii >= one.regression.radii - 1e-12)


def test_intervals_grow_with_the_equation_error() -> None:
    data = laboratory_two_second(0.5, 60)
    before = None
    for bound in (0.5, 0.6, 1.0, 3.0):
        now = linear_intervals(setid.formulate(data, SECOND, setid.Noise(equation=bound)))
        if before is not None:
            assert np.all(now[:, 0] <= before[:, 0] + 1e-9)
            assert np.all(now[:, 1] >= before[:, 1] - 1e-9)
        before = now


def test_swapping_inputs_swaps_names() -> None:
    noise = setid.Noise(output=0.3, input=0.1)
    model = setid.TransferFunction(1, 1, 1, inputs=2)
    truth = truth_of("miso", noise)
    swapped = setid.IOData(truth.data.u[:, ::-1], truth.data.y)
    formulation = setid.formulate(swapped, model, noise)
    order = ["a[1,2]1", "a[1,1]1", "b[1,2]1", "b[1,1]1"]
    theta = dict(zip(order, truth.theta.values(), strict=True))
    signals = {"z[1,1]": truth.signals["z[1,2]"], "z[1,2]": truth.signals["z[1,1]"]}
    x = formulation.point(theta, truth.output, truth.input[:, ::-1], signals=signals)
    assert formulation.problem.violation(x) < 1e-12


# ---- large and odd ----------------------------------------------------------------------


def test_five_hundred_samples_are_fast() -> None:
    from time import perf_counter

    noise = setid.Noise(output=1.0, input=0.01)
    truth = setid.simulate_record(SECOND, PLANT, np.random.default_rng(0).uniform(size=500), noise)
    started = perf_counter()
    formulation = setid.formulate(truth.data, SECOND, noise)
    assert perf_counter() - started < 1.0
    assert formulation.layout.dimension == 5 + 1000
