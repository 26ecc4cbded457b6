"""Fits and their evidence belong together."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog

import setid
from setid.proofs.least_noise.least_error import Norm

RECORD = Path(__file__).parents[3] / "examples" / "data" / "hairdryer.csv"
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
    large = setid.fit(data, setid.TransferFunction(2, 1, 1), "linf")
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
    output = setid.fit(data, model, "linf")
    assert output.attained
    bare = replace(output, evidence=None, attained=False)
    assert replace(bare, lower_bound=0.0).verify(data).ok
    assert not replace(bare, lower_bound=1e-3).verify(data).ok
    assert not replace(output, evidence=None, lower_bound=0.0).verify(data).ok
    wrong = "the evidence is of another structure, norm or kind of error"
    rest = setid.TransferFunction(1, 1, 1, initial="zero")  # has the same names of parameters
    assert replace(output, model=rest).verify(data).reason == wrong
    assert replace(output, errors="equation").verify(data).reason == wrong
