"""Functions refuse what is of another type by their names for it, and results fit one line."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import setid
import sparsepop_py as sp

MODEL = setid.TransferFunction(1, 1)


@pytest.mark.parametrize("found", [None, 1, "x", {}, setid.Noise(equation=0.1)])
def test_what_is_of_another_type_is_refused_by_name(found: Any) -> None:
    """Each of these once ended in an AttributeError."""
    with pytest.raises(setid.ModelError, match="model: found"):
        setid.parameters(found)
    with pytest.raises(setid.ModelError, match="model: found .*, expected a block structure"):
        setid.unidentifiable(found)
    with pytest.raises(sp.ProblemError, match="rows: found .*, expected UncertainRows"):
        setid.parameter_box(found)
    if not isinstance(found, str):
        with pytest.raises(setid.PriorError, match="prior: found .*, expected a text"):
            setid.read_prior(found)


def test_bounds_of_a_box_fit_the_rows() -> None:
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    rows = setid.formulate(data, MODEL, setid.Noise(equation=0.5)).regression
    with pytest.raises(sp.ProblemError, match=r"start: found shape \(2, 3\), expected \(2, 2\)"):
        setid.parameter_box(rows, np.zeros((2, 3)))
    with pytest.raises(setid.ModelError, match="found TransferFunction, expected a block"):
        setid.unidentifiable(MODEL)  # type: ignore[arg-type]


def test_simulated_records_and_estimates_are_shown_in_one_line() -> None:
    """A simulated record of 30 samples once filled a screen."""
    truth = setid.simulate_record(MODEL, [-0.5, 1], np.arange(30.0), setid.Noise(output=0.1))
    assert repr(truth) == (
        "<Simulated: a1 = -0.5, b0 = 1, IOData: 30 samples, 1 input, 1 output, Ts = 1>"
    )
    data = setid.IOData([1, 0, 2, 1], [0, 1, 0.5, 2.25])  # y_k = 0.5 y_k-1 + u_k-1, by hand
    found = setid.least_squares(data, setid.TransferFunction(1, 1, 1))
    shown = repr(found)
    assert shown.startswith("<Estimate: a1 = -0.5, b1 = 1, cost ") and "\n" not in shown


DATA = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
NOISE = setid.Noise(equation=0.5)
FORMULATION = setid.formulate(DATA, MODEL, NOISE)
HALF = setid.control.Transfer([0, 0.5], [1, -0.5])
TANK = setid.ContinuousTransferFunction(1, 0, Ts=1.0)
LURE = setid.Lure(setid.TransferFunction(1, 1, 1), 2)
THETA = [-0.5, 1.0]
RAGGED, PAIR = [[1, 2], [3]], np.array([1, 2])
NARX = setid.PolynomialNARX
WRONG = [
    ("starts", lambda: setid.IOData([1, 2, 3], [1, 2, 4], starts=RAGGED)),
    *(("assumptions", lambda v=v: setid.IOData([1, 2], [1, 3], assumptions=v)) for v in (3, "ab")),
    *(("texts", lambda v=v: NOISE.assuming(v)) for v in (None, "ab", 3)),
    *(("data", lambda v=v: NOISE.bounds(v)) for v in (None, PAIR)),
    *(("path", lambda v=v: setid.IOData.from_mat(v)) for v in (None, 3, "", "a\0b", "\ud800", [])),
    *((f"{n}", lambda n=n: MODEL.transfer(**{n: 1.0})) for n in ("output", "input")),
    *((f"{n}", lambda n=n: LURE.transfer(**{n: None})) for n in ("output", "input")),
    *((f"{n}", lambda n=n: LURE.check_between(**{"output": 1, "input": 1, n: 0}))
      for n in ("output", "input")),
    *(("input", lambda v=v: TANK.transfer(1, v)) for v in (None, True, 0)),
    *((f"{p.__name__}.{n}", lambda p=p, n=n: p(-0.5, 0.5, **{n: "x"}))
      for p in (setid.DCGain, setid.PoleIn, setid.ZeroIn) for n in ("output", "input")),
    *(("MinimumPhase.output", lambda v=v: setid.MinimumPhase(v)) for v in (0, 1.5, None, True)),
    *(("power", lambda v=v: TANK.operator(v)) for v in (None, -1, 2, 0.5, 10**9)),
    *(("signal", lambda v=v: TANK.operator(1, v)) for v in (None, "x", PAIR)),
    ("offset", lambda: setid.ContinuousTransferFunction(1, 0, offset=PAIR)),
    *(("place", lambda v=v: setid.StaticMap("u", 2).text(v)) for v in (None, -1, 2, "x")),
    ("StaticMap.basis", lambda: setid.StaticMap("u", np.array(3.0))),
    ("StaticMap.basis", lambda: setid.StaticMap("u", b"ab")),
    *(("constant", lambda v=v: NARX.full(2, 1, 1, constant=v)) for v in (None, "no", PAIR)),
    *(("offset", lambda v=v: setid.estimate_noise_bound([1, -1], offset=v)) for v in (None, "no")),
    *((n, lambda n=n: FORMULATION.point(THETA, **{n: "x"})) for n in ("output", "equation")),
    *(("signals", lambda v=v: FORMULATION.point(THETA, signals=v)) for v in (3, "x", [])),
    *(("name", lambda v=v: FORMULATION.layout.index(v)) for v in (None, [], PAIR)),
    *(("group", lambda v=v: FORMULATION.layout.group(v)) for v in (None, [], PAIR)),
    *(("number", lambda v=v: FORMULATION.layout.polynomial(v)) for v in (None, -1, 10**9, 0.5)),
    *(("k", lambda v=v: FORMULATION.rows.of_sample(v)) for v in (None, 0, "x", PAIR)),
    *(("place", lambda v=v: FORMULATION.rows.of_prior(v)) for v in (None, -1, "x", PAIR)),
    *(("tolerance", lambda v=v: setid.equivalent(LURE, THETA + [0, 1], THETA + [0, 1], v))
      for v in (None, -1, np.nan)),
    *(("seed", lambda v=v: setid.simulate_record(MODEL, THETA, [1, 2], NOISE, v))
      for v in (None, -1, 0.5, "x")),
    ("initial", lambda: setid.recursive_least_squares(DATA, MODEL, initial=[np.nan, 0])),
    *(("initial", lambda v=v: setid.recursive_least_squares(DATA, MODEL, covariance=v))
      for v in (None, np.nan)),
    *(("numerator", lambda v=v: setid.control.Transfer(v)) for v in ([], [[]], np.zeros((2, 2)))),
]  # fmt: skip


@pytest.mark.filterwarnings("ignore::setid.SetidWarning")
@pytest.mark.parametrize(("place", "call"), WRONG, ids=[f"{k} {w[0]}" for k, w in enumerate(WRONG)])
def test_wrong_arguments_are_named(place: str, call: Any) -> None:
    with pytest.raises(setid.SetidError, match=f"{place}.*: found"):
        call()


def test_time_limits_are_checked_for_sampled_bands_too() -> None:
    result = setid.identify(DATA, MODEL, NOISE)
    for limit in (None, -1.0, np.nan, "x"):
        with pytest.raises(setid.SetidError, match="time_limit: found"):
            result.bode(kind="sampled", time_limit=limit)
