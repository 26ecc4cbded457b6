"""Fits and their evidence belong together."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.signal import lfilter
from slow_values import slow_unless

import setid
import sparsepop_py as sp
from setid.analysis import equation_fit, output_fit
from setid.feasible_set.start import find_box
from setid.proofs.cells.output_cells import CellBox, cell_box
from setid.proofs.least_noise.least_error import Norm, OutputErrors, stated, verify_output
from setid.proofs.parameter_box import start_of
from sparsepop_py import budget
from sparsepop_py.budget import LimitReached, check

RECORD = Path(__file__).parents[3] / "examples" / "data" / "hairdryer.csv"
QUICK = setid.Options(time_limit=10.0, progress=False)
HAIRDRYER = setid.IOData.from_csv(RECORD, "u", "y", Ts=0.08).split(200)[0]


def least_error(data: setid.IOData, a: float, norm: str) -> float:
    """The least error with a pole at -a, nk = 3 and an offset: convex, solved by SciPy."""
    u, y = data.u[:, 0], data.y[:, 0]
    columns = np.zeros((data.samples, 5))  # b3, c, and three first outputs
    columns[:3, 2:] = np.eye(3)
    for k in range(3, data.samples):
        columns[k] = -a * columns[k - 1]
        columns[k, :2] += u[k - 3], 1.0
    if norm == "l2":
        return float(np.linalg.norm(y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]))
    sizes = np.eye(y.size) if norm == "l1" else np.ones((y.size, 1))
    found = linprog(
        np.append(np.zeros(5), np.ones(sizes.shape[1])),
        A_ub=np.block([[columns, -sizes], [-columns, -sizes]]),
        b_ub=np.concatenate([y, -y]),
        bounds=[(None, None)] * (5 + sizes.shape[1]),
    )
    return float(found.fun)


@pytest.mark.parametrize("norm", ["l2", "l1"])
def test_a_measured_record_closes_without_priors(norm: Norm) -> None:
    model = setid.TransferFunction(1, 1, 3, offset=True)
    found = setid.fit(HAIRDRYER, model, norm=norm)
    assert found.attained and found.gap < 2e-3 and bool(found.verify())
    levels = [least_error(HAIRDRYER, a, norm) for a in np.linspace(-0.95, -0.75, 41)]
    assert found.lower_bound <= min(levels) and found.error <= min(levels) * 1.001
    claim = found.lower_bound * 1.002
    assert not replace(found, lower_bound=claim).verify().ok
    known = found.evidence
    assert known is not None
    for other in (replace(known, level=claim), replace(known, cells=None)):
        assert not replace(found, evidence=other).verify().ok


def test_cells_are_about_one_output() -> None:
    u = np.random.default_rng(1).uniform(-1.0, 1.0, 12)
    two = setid.TransferFunction([[1], [1]], [[1], [1]], 1, outputs=2)
    data = setid.simulate_record(two, [-0.5, 0.3, 1.0, 2.0], u, setid.Noise(output=0.1), 1).data
    options = setid.Options(time_limit=2.0, progress=False)
    found = setid.fit(data, two, "l2", options=options)
    assert found.evidence is not None and found.evidence.cells is None
    assert found.lower_bound <= found.error and bool(found.verify())


def test_a_fit_and_its_evidence_belong_together() -> None:
    """Each forgery once verified: another structure, other parameters, NaN, another layout."""
    u = np.random.default_rng(0).uniform(-1.0, 1.0, 15)
    y = setid.simulate(setid.TransferFunction(2, 1, 1), [-1.2, 0.5, 1.0], u)
    data = setid.IOData(u, y)
    small = setid.fit(data, setid.TransferFunction(1, 1, 1), "linf")
    assert small.verify(data).ok and small.evidence is not None and small.attained
    large = setid.fit(data, setid.TransferFunction(2, 1, 1), "linf", options=QUICK)
    forged = [
        replace(large, lower_bound=small.lower_bound, error=small.error, evidence=small.evidence),
        replace(small, theta=small.theta + 1.0),
        replace(small, norm="l1"),
        replace(small, lower_bound=float("nan")),
        replace(small, error=float("nan")),
    ]
    assert not any(found.verify(data).ok for found in forged)
    known = small.evidence
    layout = known.formulation.layout
    groups = {**layout.groups, "eta": np.append(layout.groups["eta"].ravel(), 0)[:, None]}
    other = replace(known.formulation, layout=replace(layout, groups=groups))
    assert replace(small, evidence=replace(known, formulation=other)).verify(data).ok


def test_what_a_fit_claims_is_checked_word_by_word() -> None:
    u = np.random.default_rng(0).uniform(-1.0, 1.0, 15)
    data = setid.IOData(u, setid.simulate(setid.TransferFunction(2, 1, 1), [-1.2, 0.5, 1.0], u))
    model = setid.TransferFunction(1, 1, 1)
    equation = setid.fit(data, model, "linf", errors="equation")
    assert equation.verify(data).ok
    assert not replace(equation, error=float("nan")).verify(data).ok
    for other in (equation.names[::-1], ("a1", "b7"), equation.names[:1]):
        assert "names" in replace(equation, names=other).verify(data).reason
    for twisted in (
        replace(equation, norm="max"),
        replace(equation, errors="one-step"),
        replace(equation, theta=np.tile(equation.theta, 2)),
    ):
        assert not twisted.verify(data).ok
    output = setid.fit(data, model, "linf")
    assert output.attained and not replace(output, theta=output.theta[:1]).verify(data).ok
    bare = replace(output, evidence=None, attained=False)
    assert replace(bare, lower_bound=0.0).verify(data).ok
    assert not replace(bare, lower_bound=1e-3).verify(data).ok
    assert not replace(output, evidence=None, lower_bound=0.0).verify(data).ok
    wrong = "the evidence is of another structure, norm or kind of error"
    rest = setid.TransferFunction(1, 1, 1, initial="zero")  # has the same names of parameters
    assert replace(output, model=rest).verify(data).reason == wrong
    assert replace(output, errors="equation").verify(data).reason == wrong


@pytest.mark.parametrize("norm", ["linf", "l1"])
def test_a_fit_is_no_worse_than_the_least_error_for_the_denominator_of_least_squares(
    norm: Norm,
) -> None:
    """A pole at 0.97 and readings with outliers: both norms differ from least squares."""
    random = np.random.default_rng(7)
    u = random.choice([-1.0, 1.0], 80)
    y = lfilter([0.0, 1.0], [1.0, -0.97], u) + 0.1 * random.standard_t(2, 80)
    data, model = setid.IOData(u, y), setid.TransferFunction(1, 1, 1)
    pole = setid.fit(data, model, "l2", options=QUICK).parameters["a1"]
    states = np.column_stack([(-pole) ** np.arange(80), lfilter([0.0, 1.0], [1.0, pole], u)])
    count = 1 if norm == "linf" else 80
    sizes = np.ones((80, 1)) if norm == "linf" else np.eye(80)
    solved = linprog(
        np.append(np.zeros(2), np.ones(count)),
        A_ub=np.vstack([np.hstack([states, -sizes]), np.hstack([-states, -sizes])]),
        b_ub=np.append(y, -y),
        bounds=[(None, None)] * (2 + count),
    )
    found = setid.fit(data, model, norm, options=QUICK)
    assert found.attained and found.error <= solved.fun * (1 + 2e-3)
    assert found.lower_bound <= found.error and bool(found.verify())


def test_a_constant_input_beside_an_offset_is_fitted() -> None:
    """Readings alternate by 1 about 3: no fit of a slow pole has a smaller largest error."""
    with pytest.warns(setid.SetidWarning, match="constant"):
        data = setid.IOData(np.full(40, 9.0), 3.0 + (-1.0) ** np.arange(40))
    model = setid.TransferFunction(1, 1, 1, offset=True)
    found = setid.fit(data, model, "linf", options=QUICK)
    assert found.attained and found.error <= 1.0 + 2e-3


def test_boxes_that_are_not_finite_are_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    def few(formulation: setid.Formulation, until: float = np.inf) -> CellBox | None:
        return cell_box(formulation, start_of(formulation), until, rounds=0)

    monkeypatch.setattr("setid.analysis.output_fit.find_box", few)
    u = np.random.default_rng(1).uniform(-1.0, 1.0, 30)
    model = setid.Wiener(setid.TransferFunction(1, 1, 1), 2, "gamma1", initial="zero")
    noise = setid.Noise(output=0.01)
    truth = setid.simulate_record(model, [-0.5, 0.8, 0.3], u, noise, seed=2)
    found = setid.fit(truth.data, model, "l2", priors=setid.Stable())
    assert found.error <= 0.011 * np.sqrt(30) and found.lower_bound == 0.0 and found.verify()
    assert found.evidence is not None and found.evidence.box is None


def test_no_engine_is_asked_when_the_time_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    def asked(*arguments: object) -> None:
        raise AssertionError

    monkeypatch.setattr("setid.analysis.output_fit._by_engine", asked)
    u, y = np.random.default_rng(8).uniform(-1.0, 1.0, (2, 60))
    options = setid.Options(time_limit=1e-3, progress=False)
    found = setid.fit(setid.IOData(u, y), setid.TransferFunction(2, 2, 1), "l1", options=options)
    assert 0.0 <= found.lower_bound <= found.error and bool(found.verify())


@pytest.mark.parametrize("norm", ["linf", "l2", "l1"])
@pytest.mark.parametrize("units", [(1.0, 1e9), (1e9, 1.0), (1e-9, 1e9)])
def test_units_leave_the_gap_of_equation_errors_alone(
    norm: Norm, units: tuple[float, float]
) -> None:
    """Rows of all units have the same multipliers, up to those of the rows."""
    rng = np.random.default_rng(1)
    u, y = rng.uniform(-1, 1, 14), rng.uniform(-1, 1, 14)
    model = setid.TransferFunction(na=2, nb=2)
    plain = setid.fit(setid.IOData(u, y), model, norm, "equation")
    found = setid.fit(setid.IOData(units[0] * u, units[1] * y), model, norm, "equation")
    assert plain.gap < 1e-9 and found.gap < 1e-9 and found.verify()
    assert found.lower_bound == pytest.approx(units[1] * plain.error, rel=1e-9)


@pytest.mark.parametrize(("norm", "least"), [("linf", 0.5), ("l2", 0.5**0.5), ("l1", 1.0)])
def test_equation_errors_of_a_constant_input_are_bounded(norm: Norm, least: float) -> None:
    """With u = 1 the rows say 1 - s and 2 - s, s = b0 + b1: no other sum leaves less."""
    with pytest.warns(setid.SetidWarning, match="constant"):
        data = setid.IOData([1.0, 1.0, 1.0], [0.0, 1.0, 2.0])
    found = setid.fit(data, setid.TransferFunction(na=0, nb=2), norm, "equation")
    assert found.lower_bound == pytest.approx(least) and found.error == pytest.approx(least)
    assert found.verify()


@pytest.mark.parametrize("norm", ["linf", "l1"])
def test_least_squares_prove_something_when_the_time_is_over(
    norm: Norm, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(6)
    data = setid.IOData(rng.uniform(-1, 1, 40), rng.uniform(-1, 1, 40))
    model = setid.TransferFunction(na=1, nb=1)
    whole = setid.fit(data, model, norm, "equation")

    def ended(*given: object) -> None:
        raise LimitReached

    monkeypatch.setattr(equation_fit, "solve_scaled", ended)
    found = setid.fit(data, model, norm, "equation")
    assert 0.0 < found.lower_bound <= whole.error <= found.error and found.verify()


@pytest.mark.parametrize(("norm", "least"), [("linf", 1.8), ("l1", 2.8), ("l2", np.hypot(1, 1.8))])
def test_priors_that_exclude_the_best_parameters_of_all_are_kept(norm: Norm, least: float) -> None:
    """y = b0 u with b0 = 2 for u = 1, 2 and y = 1, 2.2; without the prior b0 is near 1."""
    data, model = setid.IOData([1.0, 2.0], [1.0, 2.2]), setid.TransferFunction(0, 1)
    found = setid.fit(data, model, norm, priors=setid.Known({"b0": 2.0}), options=QUICK)
    assert found.attained and found.theta[0] == pytest.approx(2.0, abs=1e-9)
    assert found.lower_bound <= least * (1 + 1e-12) and found.error >= least * (1 - 1e-12)
    assert found.gap < 2e-3 and found.verify().ok


def test_an_empty_box_proves_its_radius_alone() -> None:
    data, model = setid.IOData([1.0, 2.0], [1.0, 2.2]), setid.TransferFunction(0, 1)
    stated_at = stated(data, model, [setid.Known({"b0": 2.0})], 0.5)
    known = OutputErrors("linf", 0.5, stated_at, find_box(stated_at), None, None)
    assert known.box is not None and known.box.empty
    assert verify_output(known, 0.5, np.inf).ok
    for low, error in ((0.6, np.inf), (0.5, 0.5)):
        assert not verify_output(known, low, error).ok


@pytest.mark.parametrize("norm", ["linf", "l2", "l1"])
def test_no_simulation_begins_anew_behind_a_missing_reading(norm: Norm) -> None:
    """y jumps by 3 at a missing reading: a point of the equations that are left follows it."""
    u = np.round(np.random.default_rng(1).uniform(-2.0, 2.0, 12), 1)
    y = lfilter([1.0], [1.0, -0.9], u)
    y[6:] += 3.0
    y[5] = np.nan
    found = setid.fit(setid.IOData(u, y), setid.TransferFunction(1, 1), norm, options=QUICK)
    a, b = found.theta
    forced, free = lfilter([b], [1.0, a], np.append(0.0, u[1:])), (-a) ** np.arange(12.0)
    levels = [
        float(np.linalg.norm((y - forced - start * free)[~np.isnan(y)], order))
        for start in np.linspace(-10.0, 10.0, 4001)
        for order in [{"linf": np.inf, "l2": 2, "l1": 1}[norm]]
    ]
    assert found.lower_bound <= min(levels) * 1.01
    assert found.error >= min(levels) * 0.99 and not found.attained and bool(found.verify())
    assert ("y_range" in found.summary()) == (found.evidence is not None)
    claim = replace(found, attained=True)
    assert found.evidence is None or found.evidence.attained is None or not claim.verify().ok


@pytest.mark.parametrize(
    ("pole", "norm"),
    slow_unless(lambda pole, _: pole == 0.9, [(0.9, "l2"), (0.2, "l2"), (0.9, "linf")]),
)
def test_priors_that_exclude_the_local_fit_leave_a_proved_least_error(
    pole: float, norm: Norm
) -> None:
    """With a known pole outputs are linear in the gain and the first sample."""
    rng = np.random.default_rng(0)
    u = rng.uniform(-1, 1, 60)
    y = lfilter([0, 0.7, 0.2], [1, -1.2, 0.5], u) + rng.uniform(-0.1, 0.1, 60)
    model, known = setid.TransferFunction(1, 1, 1), setid.Known({"a1": -pole})
    options = setid.Options(time_limit=20.0, progress=False)
    found = setid.fit(setid.IOData(u, y), model, norm, priors=known, options=options)
    columns = np.column_stack([lfilter([0, 1], [1, -pole], u), pole ** np.arange(60.0)])
    if norm == "l2":
        least = float(np.linalg.norm(y - columns @ np.linalg.lstsq(columns, y)[0]))
    else:
        sides = np.vstack([np.c_[columns, -np.ones(60)], np.c_[-columns, -np.ones(60)]])
        least = linprog([0, 0, 1], sides, np.r_[y, -y], bounds=(None, None)).fun
    assert found.lower_bound <= least * (1 + 1e-9) and found.error >= least * (1 - 1e-9)
    assert found.gap < 2e-3 and found.attained and found.verify()


def test_an_open_gap_has_a_cause() -> None:
    u = np.random.default_rng(0).uniform(-1, 1, 30)
    y = np.column_stack([lfilter([0, 0.7], [1, -0.5], u), lfilter([0, 0.2], [1, -0.8], u)])
    y += np.random.default_rng(1).uniform(-0.1, 0.1, y.shape)
    model = setid.TransferFunction(1, 1, 1, outputs=2)
    options = setid.Options(time_limit=0.01, progress=False)
    found = setid.fit(setid.IOData(u, y), model, options=options)
    assert found.lower_bound == 0.0 and "no finite box" in found.summary()
    loose = setid.Options(tol=0.5, time_limit=20, progress=False)  # closed, as far as was asked
    one = setid.fit(setid.IOData(u, y[:, :1]), setid.TransferFunction(1, 1, 1), options=loose)
    assert 0.01 < one.gap < 0.5 and "was searched" in one.summary() and "tol" in one.summary()
    closed = setid.fit(HAIRDRYER, setid.TransferFunction(1, 1, 3, offset=True), "l2", options=QUICK)
    assert "gap is open" not in closed.summary()


@pytest.mark.parametrize("norm", [pytest.param("linf", marks=pytest.mark.slow), "l2", "l1"])
def test_fits_from_rest_close(norm: Norm) -> None:
    """The first rows bound the error too: with nk = 1 the first reading is error alone."""
    rng = np.random.default_rng(3)
    u, model = rng.uniform(-1, 1, 30), setid.TransferFunction(2, 1, 1, initial="zero")
    truth = setid.simulate_record(model, [-1.1, 0.4, 1.0], u, setid.Noise(output=0.1), rng)
    y = truth.data.y.copy()
    y[0] = 0.3  # far more than all others
    data = setid.IOData(u, y)
    found = setid.fit(data, model, norm, options=setid.Options(time_limit=20, progress=False))
    assert found.gap <= 2e-3 and found.verify()
    free = setid.fit(data, setid.TransferFunction(2, 1, 1), norm, options=QUICK)
    assert found.lower_bound > free.error
    if norm == "linf":
        assert found.lower_bound >= 0.299 and found.error <= 0.3 * (1 + 1e-8)


@pytest.mark.parametrize("norm", ["linf", "l2", "l1"])
@pytest.mark.parametrize("initial", ["free", "zero"])
def test_exact_records_are_fitted_exactly(norm: Norm, initial: str) -> None:
    u, y = np.random.default_rng(5).choice([-1.0, 1.0, 2.0], 24), np.zeros(24)
    for k in range(1, 24):
        y[k] = 0.5 * y[k - 1] + u[k - 1]
    model = setid.TransferFunction(1, 1, 1, initial=initial)
    found = setid.fit(setid.IOData(u, y), model, norm, options=QUICK)
    assert found.attained and found.error < 1e-10 and found.verify()
    assert abs(found.parameters["a1"] + 0.5) < 1e-9


def test_a_measured_record_from_rest_closes_without_priors() -> None:
    """The hair dryer from its first sample on: poles near 1, and growing modes beside them."""
    shifted = setid.IOData(HAIRDRYER.u - HAIRDRYER.u[0], HAIRDRYER.y - HAIRDRYER.y[0], Ts=0.08)
    model = setid.TransferFunction(2, 2, 3, initial="zero")
    found = setid.fit(shifted, model, "l2", options=setid.Options(time_limit=60, progress=False))
    assert found.attained and found.gap < 1e-3 and found.verify()
    poles = np.roots([1.0, found.parameters["a1"], found.parameters["a2"]])
    assert np.abs(poles).max() < 1.0


def test_settings_of_the_engine_reach_it(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[sp.Options] = []

    def seen(problem: sp.Problem, options: sp.Options, start: object) -> sp.Result:
        asked.append(options)
        return solve(problem, options, start=start)

    solve = sp.solve
    monkeypatch.setattr("sparsepop_py.solve", seen)
    u, y = np.random.default_rng(3).uniform(-1.0, 1.0, (2, 12))
    engine = sp.Options(effort="auto", seed=7, skip=("quote",))
    options = setid.Options(time_limit=5.0, cpu_limit=9.0, progress=False, engine=engine)
    setid.fit(setid.IOData(u, y), setid.TransferFunction(0, 2), "linf", options=options)
    assert asked and {(each.seed, each.skip) for each in asked} == {(7, ("quote",))}
    assert all(each.time_limit <= 5.0 and each.cpu_limit == 9.0 for each in asked)


@pytest.mark.parametrize("proof", ["proved_point", "verify_output"])
def test_proofs_of_attained_errors_end_with_the_time(
    monkeypatch: pytest.MonkeyPatch, proof: str
) -> None:
    """Where a proof takes twice the limit, the error is what a simulation has, and no more."""
    passed, asked = [0.0], [0]
    clock, prove = time.monotonic, getattr(output_fit, proof)

    def slow(*arguments: object) -> object:
        asked[0] += 1
        passed[0] += 2.0 * limit
        check()  # as proofs do on their way
        return prove(*arguments)

    limit = 1000.0
    monkeypatch.setattr(output_fit, proof, slow)
    monkeypatch.setattr(budget.time, "monotonic", lambda: clock() + passed[0])
    u, y = np.random.default_rng(8).uniform(-1.0, 1.0, (2, 12))
    data, model = setid.IOData(u, y), setid.TransferFunction(1, 1, 1)
    options = setid.Options(time_limit=limit, progress=False)
    found = setid.fit(data, model, "l2", options=options)
    assert asked[0] >= 1 and not found.attained
    assert found.lower_bound <= np.linalg.norm(y - found.outputs[:, 0]) <= found.error * (1 + 1e-9)
    assert bool(found.verify())


@pytest.mark.parametrize("size", [1e-300, 1e-160, 1e153, 1e170])
def test_euclidean_errors_have_no_range(size: float) -> None:
    """Squares of these errors are zero or infinite, the error is neither."""
    u, y = [1, 0, 2, 1, 0, 1, 2, 0, 1], np.array([0, 1, 0.5, 2.25, 2.1, 1, 0.9, 2.2, 1.1])
    model, plain = setid.TransferFunction(0, 1, 1), setid.Options(time_limit=5, progress=False)
    # y = b u(k-1): the least squares by hand, the first sample has no row
    before, after = np.array(u[:-1], float), y[1:]
    rest = after - before * (before @ after) / (before @ before)
    with np.errstate(over="ignore"):
        found = setid.fit(setid.IOData(u, y * size), model, options=plain)
    assert found.error / size == pytest.approx(float(np.linalg.norm(rest)), rel=1e-3)
    assert found.gap >= 0.0 and found.verify()


@pytest.mark.parametrize(
    ("u", "y", "offset", "least"),
    [
        # b = -1/2 is a weighted median of y / u, with the errors 3/2, 0, 0 and 1/2
        ([-1, 2, 2, -2], [-1, -1, -1, 0.5], False, 2.0),
        # two inputs, and two readings of each: no less than their distances 3/2 and 2
        ([-1, -2, -1, -2], [1, -1, -0.5, 1], True, 3.5),
    ],
)
def test_the_least_sum_of_equation_errors_is_proved_where_rows_repeat(
    u: list[float], y: list[float], offset: bool, least: float
) -> None:
    model = setid.TransferFunction(na=0, nb=1, offset=offset)
    found = setid.fit(setid.IOData(u, y), model, "l1", "equation")
    assert found.lower_bound == pytest.approx(least, rel=1e-12)
    assert found.error == pytest.approx(least, rel=1e-12)
    assert found.lower_bound <= least <= found.error and found.verify()


@pytest.mark.parametrize("errors", ["equation", "output"])
def test_malformed_fields_of_a_fit_are_verdicts(errors: Any) -> None:
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    found = setid.fit(data, setid.TransferFunction(1, 1), norm="linf", errors=errors)
    assert found.verify()
    changes = ({"names": None}, {"theta": None}, {"error": "x"}, {"data": 3}, {"model": None})
    for damage in changes:
        verdict = replace(found, **damage).verify()
        assert verdict.reason and (not verdict or damage == {"data": 3})
