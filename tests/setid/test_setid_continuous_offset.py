"""Continuous time with an unknown constant, in Python and on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from continuous_cases import QUICK, exact_samples, levels, noisy
from slow_values import slow_after

import setid
from setid.cli import EXIT_INPUT, EXIT_PROVED, main

C = setid.ContinuousTransferFunction
FIRST = np.array([1.5, 2.0])  # 2 / (s + 1.5)
TS, SENSOR = 0.1, 0.7


def record(bound: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Exact samples of a first-order plant behind a sensor that reads 0.7 too much.

    D(s) (y - 0.7) = N(s) u is D(s) y = N(s) u + 0.7 a0: the constant is c = 0.7 a0.
    """
    u = levels(TS, 12)
    exact = exact_samples(u, TS, theta=FIRST)
    error = setid.discretisation_error(C(1, 0, hold="constant", Ts=TS), FIRST, u)
    return u, noisy(exact, bound) + SENSOR, float(np.abs(error).max())


@pytest.mark.parametrize(
    ("n", "m", "method", "tau"), [(1, 0, "tustin", None), (3, 1, "lambda", 2.0)]
)
@pytest.mark.parametrize("hold", ["linear", "constant"])
def test_the_settled_output_is_the_static_gain_of_the_constant(
    n: int, m: int, method: str, tau: float | None, hold: str
) -> None:
    """At rest all derivatives vanish: a0 y = b0 u + c, whatever the rule."""
    model = C(n, m, method, tau=tau, hold=hold, Ts=TS, offset=True)
    assert model.parameters[-1] == "c" and "c" not in model.transfer().numerator
    theta = {name: 2.0 + 0.25 * place for place, name in enumerate(model.parameters)}
    y = (theta["b0"] * 1.5 + theta["c"]) / theta["a0"]
    with pytest.warns(setid.SetidWarning, match="constant"):
        data = setid.IOData(np.full(2 * n + 2, 1.5), np.full(2 * n + 2, y), Ts=TS)
    rows = setid.formulate(data, model, setid.Noise(output=0.1)).problem.rows
    x = np.zeros(rows.dimension)
    x[: len(theta)] = list(theta.values())
    assert np.abs(rows.values(x)).max() < 1e-12


@pytest.mark.parametrize("bound", slow_after(1, [1e-6, 1e-2]))
def test_an_offset_of_the_sensor_is_found(bound: float) -> None:
    u, y, error = record(bound)
    data, noise = setid.IOData(u, y, Ts=TS), setid.Noise(output=bound)
    model = C(1, 0, hold="constant", delta=1.01 * error, offset=True)
    result = setid.identify(data, model, noise, options=QUICK)
    truth = dict(zip(model.parameters, [*FIRST, SENSOR * FIRST[0]], strict=True))
    for name, interval in result.intervals.items():
        assert truth[name] in interval and interval.status == "certified"
    assert result.verify(data).ok
    without = setid.identify(data, C(1, 0, hold="constant", delta=1.01 * error), noise)
    assert without.empty


@pytest.mark.slow
def test_intervals_collapse_on_the_truth() -> None:
    """Tustin of a linear input and the recursion's own output: nothing but noise of 1e-8."""
    model = C(1, 0, Ts=TS, offset=True)
    u, theta = levels(TS, 8), [1.5, 2.0, 0.3]
    noise = setid.Noise(output=1e-8)
    truth = setid.simulate_record(model, theta, u, noise, seed=1)
    data = setid.IOData(u, truth.data.y, Ts=TS)
    result = setid.identify(data, model, noise, options=QUICK)
    for value, interval in zip(theta, result.intervals.values(), strict=True):
        assert value in interval and interval.width < 1e-4


def test_the_command_line_knows_continuous_time(tmp_path: Path) -> None:
    """The same intervals as in Python, and the estimate of delta in the assumptions."""
    bound = 1e-2
    u, y, error = record(bound)
    path, out = tmp_path / "record.csv", tmp_path / "out.json"
    lines = [f"{a!r},{b!r}\n" for a, b in zip(u.tolist(), y.tolist(), strict=True)]
    path.write_text("u,y\n" + "".join(lines))
    common = [str(path), "--Ts", str(TS), "--output-noise", str(bound), "--json", str(out)]
    asked = ["--continuous", "1", "0", "--hold", "constant", "--offset"]
    assert main(["identify", *common, *asked, "--delta", str(error)]) == EXIT_PROVED
    found = json.loads(out.read_text())["intervals"]
    model = C(1, 0, hold="constant", delta=error, offset=True)
    data = setid.IOData.from_csv(path, ["u"], ["y"], Ts=TS)
    mine = setid.identify(data, model, setid.Noise(output=bound))
    assert {k: v["outer"] for k, v in found.items()} == {
        name: list(interval.outer) for name, interval in mine.intervals.items()
    }
    main(["identify", *common, *asked, "--delta", "estimate", "--time-limit", "20"])
    text = " ".join(json.loads(out.read_text())["assumptions"])
    assert "discretisation error" in text and "the true error may be larger" in text
    two = [*common, *asked, "--input", "u", "--input", "y", "--output", "y"]
    assert main(["identify", *two]) == EXIT_INPUT
