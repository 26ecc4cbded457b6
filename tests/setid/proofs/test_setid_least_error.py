"""Global fits: bounds against closed forms, linear programs and grids; forgeries are refused."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.optimize import linprog

import setid
import sparsepop_py as sp
from setid.formulation.regression import regression_of_data
from setid.minimum_noise.claims import FoundDenominators
from setid.proofs.least_noise.least_error import (
    Multipliers,
    equation_bound,
    error_problem,
    exact_norm,
    output_bound,
    stated,
    verify_output,
)

MODEL = setid.TransferFunction(na=1, nb=1, nk=1)
QUICK = setid.Options(time_limit=20.0, progress=False)
NORMS = ["linf", "l2", "l1"]


def record(samples: int = 15, bound: float = 0.05) -> setid.IOData:
    u = np.random.default_rng(1).uniform(-1, 1, samples)
    return setid.simulate_record(MODEL, [-0.7, 1.0], u, setid.Noise(output=bound), 2).data


def size(errors: np.ndarray, norm: str) -> float:
    return float(np.linalg.norm(errors, {"linf": np.inf, "l2": 2, "l1": 1}[norm]))


# ---- equation errors --------------------------------------------------------------------


def least_equation_error(data: setid.IOData, norm: str) -> float:
    """From numpy's least squares or scipy's linear programs."""
    rows = regression_of_data(data, MODEL)
    y, a = rows.target, rows.regressors
    if norm == "l2":
        return float(np.linalg.norm(y + a @ np.linalg.lstsq(a, -y, rcond=None)[0]))
    one = np.ones((y.size, 1)) if norm == "linf" else np.eye(y.size)
    found = linprog(
        np.append(np.zeros(a.shape[1]), np.ones(one.shape[1])),
        np.block([[a, -one], [-a, -one]]),
        np.append(-y, y),
        bounds=(None, None),
    )
    return float(found.fun)


@pytest.mark.parametrize("norm", NORMS)
def test_equation_errors_are_settled_as_oracles_say(norm: str) -> None:
    data = record(60)
    found = setid.fit(data, MODEL, norm, errors="equation")  # type: ignore[arg-type]
    wanted = least_equation_error(data, norm)
    assert found.lower_bound <= wanted * (1 + 1e-9) and found.error >= wanted * (1 - 1e-9)
    assert found.gap < 1e-9 and found.attained and found.verify(data)
    assert "gap" in found.summary() and set(found.parameters) == {"a1", "b1"}


@pytest.mark.parametrize("norm", NORMS)
def test_forged_claims_on_equation_errors_are_refused(norm: str) -> None:
    data = record(30)
    found = setid.fit(data, MODEL, norm, errors="equation")  # type: ignore[arg-type]
    assert not replace(found, lower_bound=found.lower_bound * 1.001).verify()
    assert not replace(found, error=found.error * 0.999).verify()
    assert not replace(found, theta=found.theta + 0.1).verify()
    assert not replace(found, certificate=None).verify()
    other = setid.IOData(data.u, data.y * 0.5)
    assert not found.verify(other)


@pytest.mark.parametrize("norm", NORMS)
def test_multipliers_prove_nothing_beyond_weak_duality(norm: str) -> None:
    data = record(12)
    rows = regression_of_data(data, MODEL)
    least = least_equation_error(data, norm)
    source = np.random.default_rng(0)
    null = np.linalg.svd(rows.regressors.T)[2][2:]
    for _ in range(200):
        values = source.normal(size=null.shape[0]) @ null
        free = Multipliers(tuple(Fraction(float(v)) for v in values))  # R'lambda is near zero only
        assert equation_bound(rows, norm, free) == 0.0  # type: ignore[arg-type]
    for column in range(2):  # what cancels one column alone
        one, two = (Fraction(float(v)) for v in rows.regressors[:2, column])
        for sign in (1, -1):
            half = Multipliers((sign * two, -sign * one, *[Fraction(0)] * (rows.target.size - 2)))
            assert equation_bound(rows, norm, half) == 0.0  # type: ignore[arg-type]
    good = setid.fit(data, MODEL, norm, errors="equation").certificate  # type: ignore[arg-type]
    assert isinstance(good, Multipliers)
    for factor in (Fraction(7, 3), Fraction(1, 10**9), Fraction(-1)):
        scaled = Multipliers(tuple(factor * v for v in good.values))
        bound = equation_bound(rows, norm, scaled)  # type: ignore[arg-type]
        assert bound <= least * (1 + 1e-12)
        assert bound == (0.0 if factor < 0 else pytest.approx(least, rel=1e-9))
    assert equation_bound(rows, norm, Multipliers(good.values[1:])) == 0.0  # type: ignore[arg-type]


@pytest.mark.parametrize("norm", NORMS)
def test_norms_of_doubles_are_rounded_up(norm: str) -> None:
    rows = regression_of_data(record(10), MODEL)
    theta = np.array([-0.7, 1.0])
    exact = [
        Fraction(float(y))
        + sum(Fraction(float(r)) * Fraction(float(t)) for r, t in zip(a, theta, strict=True))
        for y, a in zip(rows.target, rows.regressors, strict=True)
    ]
    found = Fraction(exact_norm(rows, theta, norm))  # type: ignore[arg-type]
    if norm == "l2":
        assert sum(e * e for e in exact) <= found * found
    else:
        sizes = [abs(e) for e in exact]
        assert (max(sizes) if norm == "linf" else sum(sizes)) <= found
    assert float(found) == pytest.approx(size(np.array([float(e) for e in exact]), norm), rel=1e-12)


# ---- output errors ----------------------------------------------------------------------


def least_output_error(data: setid.IOData, norm: str) -> float:
    """Of a first-order system from a grid of poles: y(k) is linear in b1 and in y(0)."""
    y, u, best = data.y[:, 0], data.u[:, 0], np.inf
    for pole in np.linspace(0.3, 0.95, 651):
        driven = np.zeros(y.size)
        for k in range(1, y.size):
            driven[k] = pole * driven[k - 1] + u[k - 1]
        a = np.column_stack([driven, pole ** np.arange(y.size)])
        if norm == "l2":
            error = float(np.linalg.norm(y - a @ np.linalg.lstsq(a, y, rcond=None)[0]))
        else:
            one = np.ones((y.size, 1)) if norm == "linf" else np.eye(y.size)
            error = linprog(
                np.append(np.zeros(2), np.ones(one.shape[1])),
                np.block([[a, -one], [-a, -one]]),
                np.append(y, -y),
                bounds=(None, None),
            ).fun
        best = min(best, error)
    return best


@pytest.fixture(scope="module", params=NORMS)
def output_fit(request: pytest.FixtureRequest) -> setid.Fit:
    return setid.fit(record(), MODEL, request.param, options=QUICK)


@pytest.fixture(scope="module", params=NORMS)
def engine_fit(request: pytest.FixtureRequest) -> setid.Fit:
    """A fit whose bound is the engine's: cones of denominators are not asked."""
    with pytest.MonkeyPatch.context() as patch:
        nothing = FoundDenominators(0.0, None, ())
        patch.setattr("setid.analysis.output_fit._refuted", lambda *given: nothing)
        return setid.fit(record(), MODEL, request.param, options=QUICK)


def agrees_with_a_grid(output_fit: setid.Fit) -> bool:
    wanted = least_output_error(record(), output_fit.norm)
    assert output_fit.lower_bound <= wanted
    assert output_fit.lower_bound >= wanted * (1 - 5e-3)
    assert output_fit.error <= wanted * (1 + 1e-3)
    errors = (record().y - output_fit.outputs)[:, 0]
    assert size(errors, output_fit.norm) == pytest.approx(output_fit.error, rel=1e-6)
    return output_fit.attained and bool(output_fit.verify(record()))


def test_output_errors_agree_with_a_grid(output_fit: setid.Fit) -> None:
    assert agrees_with_a_grid(output_fit)


def test_output_errors_of_the_engine_agree_with_a_grid(engine_fit: setid.Fit) -> None:
    assert agrees_with_a_grid(engine_fit)


def test_forged_claims_on_output_errors_are_refused(engine_fit: setid.Fit) -> None:
    output_fit = engine_fit
    known = output_fit.evidence
    assert known is not None and known.certificate is not None
    assert not replace(output_fit, lower_bound=output_fit.error * 1.01).verify()
    assert not replace(output_fit, error=output_fit.lower_bound * 0.98).verify()
    assert not output_fit.verify(setid.IOData(record().u, record().y * 0.5))
    assert not replace(output_fit, evidence=replace(known, attained=None)).verify()
    for forged in (replace(known, radius=2.0 * known.radius), replace(known, certificate=None)):
        assert not verify_output(forged, output_fit.lower_bound, np.inf)
    assert known.box is not None
    low, high = known.box.lower.copy(), known.box.upper.copy()
    low[0] = 0.5 * (low[0] + high[0])
    smaller = replace(known, box=replace(known.box, lower=low))
    assert not verify_output(smaller, 0.0, np.inf)
    bare = replace(known, certificate=None, attained=None)
    assert verify_output(bare, 0.0, np.inf)
    nothing = replace(bare, box=None)
    other = setid.IOData(record().u, record().y * 0.5)
    assert verify_output(nothing, 0.0, np.inf, other).reason == "the result belongs to other data"
    empty = replace(known.box, lower=np.full(2, np.inf), upper=np.full(2, -np.inf), steps=())
    assert empty.empty
    assert not verify_output(replace(bare, box=empty), 0.99 * output_fit.error, np.inf)


def test_no_bound_exceeds_the_radius(engine_fit: setid.Fit) -> None:
    known = engine_fit.evidence
    assert known is not None and known.certificate is not None
    beyond = replace(known, certificate=replace(known.certificate, bound=1e9))
    assert output_bound(beyond) <= known.radius
    assert output_bound(replace(known, certificate=replace(known.certificate, bound=-1.0))) == 0.0


@pytest.mark.parametrize("norm", NORMS)
def test_the_problem_states_the_norm(norm: str) -> None:
    data = record(6)
    formulation = setid.formulate(data, MODEL, setid.Noise(output=1.0))
    problem = error_problem(formulation, None, norm, 1.0)  # type: ignore[arg-type]
    truth = setid.simulate(MODEL, [-0.7, 1.0], data.u)
    errors = (data.y - truth)[:, 0]
    x = formulation.point({"a1": -0.7, "b1": 1.0}, output=data.y - truth)
    extra = {"linf": [size(errors, "linf")], "l2": [], "l1": np.abs(errors)}[norm]
    x = np.append(x, extra)
    wanted = size(errors, norm) ** (2 if norm == "l2" else 1)
    assert problem.objective(x) == pytest.approx(wanted) and problem.violation(x) < 1e-12
    if norm != "l2":
        x[-1] = 0.5 * np.abs(errors).max() if norm == "linf" else 0.5 * abs(errors[-1])
        assert problem.violation(x) > 0


def test_finite_impulse_responses_are_least_squares() -> None:
    model = setid.TransferFunction(na=0, nb=2, initial="zero")
    u, y = np.array([1.0, 0.0, 2.0, -1.0, 0.5]), np.array([1.0, 0.4, 2.2, 0.1, 0.3])
    found = setid.fit(setid.IOData(u, y), model, "l2", options=QUICK)
    a = np.column_stack([u, np.append(0.0, u[:-1])])
    wanted = float(np.linalg.norm(y - a @ np.linalg.lstsq(a, y, rcond=None)[0]))
    assert found.lower_bound <= wanted <= found.error * (1 + 1e-9)
    assert found.lower_bound == pytest.approx(wanted, rel=2e-3)


@pytest.mark.parametrize(
    ("given", "why"),
    [({"norm": "l3"}, "norm"), ({"errors": "input"}, "errors")],
)
def test_wrong_input_is_refused(given: dict[str, str], why: str) -> None:
    with pytest.raises(setid.SetidError, match=f"{why}: found"):
        setid.fit(record(), MODEL, **given)  # type: ignore[arg-type]


@pytest.mark.parametrize("size", [1e-150, 1e-60, 1.0, 1e150, 1e300])
def test_norms_keep_their_digits_whatever_the_unit_of_the_output(size: float) -> None:
    """Errors 3, 4 and 12 have the norm 13."""
    rows = regression_of_data(setid.IOData([1, 2, 0, 1], size * np.array([0, 3, 4, 12.0])), MODEL)
    rows = replace(rows, regressors=np.zeros_like(rows.regressors))
    norm = exact_norm(rows, np.zeros(2), "l2")
    assert 13 * size * (1 - 1e-15) <= norm <= 13 * size * (1 + 1e-15)
    proof = Multipliers(tuple(Fraction(float(v)) for v in rows.target / size))
    bound = equation_bound(rows, "l2", proof)
    assert 13 * size * (1 - 1e-15) <= bound <= norm


def test_norms_beyond_all_doubles_are_infinite() -> None:
    rows = regression_of_data(setid.IOData([1, 2, 0, 1], [0, 1e308, 1e308, 1e308]), MODEL)
    theta = np.array([1.0, 0.0])
    assert exact_norm(rows, theta, "l1") == exact_norm(rows, theta, "l2") == np.inf
    rows = replace(rows, regressors=np.zeros_like(rows.regressors))
    signs = Multipliers((Fraction(1),) * 3)
    assert equation_bound(rows, "l1", signs) == np.finfo(float).max  # the norm is 3e308


def test_sums_of_squares_are_stated_without_products_of_polynomials(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two outputs, whose noise samples are numbered by output, and no work in Python each."""
    source = np.random.default_rng(0)
    data = setid.IOData(source.normal(size=20), source.normal(size=(20, 2)))
    formulation = stated(data, setid.TransferFunction(1, 1, 1, outputs=2), (), 1.0)
    with monkeypatch.context() as patch:
        patch.setattr(sp.Polynomial, "__mul__", None)
        patch.setattr(sp.Polynomial, "__pow__", None)
        problem = error_problem(formulation, None, "l2", 1.0)
    numbers = formulation.layout.group("eta")
    x = source.normal(size=problem.dimension)
    squares = float(np.sum(x[numbers[numbers >= 0]] ** 2))
    assert problem.objective(x) == pytest.approx(squares, rel=1e-12)
