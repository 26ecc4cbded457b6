"""Numbers in sentences that call them proved: rounded outwards, assumptions not at all."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import setid
import sparsepop_py as sp
from setid import control, neural
from setid.control.certificates.cells import Outcome
from setid.control.certificates.certificate import _largest
from setid.control.report import margins_text
from setid.data.digits import all_digits
from setid.feasible_points.centre import Central
from setid.minimum_noise.discretisation import _sentence, remark
from setid.neural.contraction.stability import Condition
from setid.plots.blocks import _value as block_value
from setid.plots.intervals import plot_intervals
from setid.result.progress import Progress
from sparsepop_py.progress import Stages

NUMBER = r"-?[0-9.]+(?:e[+-]?[0-9]+)?"


def repr_of(kind: type) -> Callable[[Any], str]:
    """The text of a class, to be asked of a stand-in that has the fields it shows."""
    return kind.__repr__


@pytest.fixture(scope="module")
def results() -> list[setid.Identification]:
    found = []
    for seed in range(6):
        draw = np.random.default_rng(seed)
        u = draw.uniform(-1, 1, 14)
        model, bound = setid.TransferFunction(na=1, nb=1), 10.0 ** -draw.integers(1, 9)
        truth = [draw.uniform(-0.9, 0.9), draw.uniform(0.5, 900)]
        y = setid.simulate(model, truth, u).ravel() + bound * draw.uniform(-0.4, 0.4, 14)
        found.append(setid.identify(setid.IOData(u, y), model, setid.Noise(equation=bound)))
    return found


def test_the_error_of_the_centre_holds_of_the_digits_shown(
    results: list[setid.Identification],
) -> None:
    for result in results:
        shown = re.findall(rf"({NUMBER}) \+- ({NUMBER})", str(result.centre))
        for (value, error), item in zip(shown, result.intervals.values(), strict=True):
            low, high = Fraction(value) - Fraction(error), Fraction(value) + Fraction(error)
            assert low <= Fraction(item.outer[0]) and Fraction(item.outer[1]) <= high


def test_an_infinite_error_is_shown_as_it_is() -> None:
    centre = Central(("a1",), np.array([1.0]), np.array([np.inf]), 1.0, None)
    assert str(centre).startswith("a1 = 1 +- inf")


def test_labels_of_pictures_hold_the_intervals(results: list[setid.Identification]) -> None:
    for result in results:
        labels = [text.get_text() for text in plot_intervals(result).get_yticklabels()]
        for label, item in zip(labels, result.intervals.values(), strict=True):
            low, high = re.findall(NUMBER, label.split(" in ")[1])
            assert Fraction(low) <= Fraction(item.outer[0])
            assert Fraction(item.outer[1]) <= Fraction(high)


@pytest.mark.parametrize("bound", [0.12344, 0.76041, 0.999949, 0.0, 1e-9])
def test_the_largest_gain_is_rounded_upwards(bound: float) -> None:
    text = _largest(Outcome(True, ((0.0, 1.0, bound), (1.0, 2.0, 0.5 * bound)), (), 1))
    assert float(text.removeprefix("max abs(Delta) <= ")) >= bound


@pytest.mark.parametrize("bound", [0.123456789, 1 / 3, 0.1, 12.0, 1e-300])
def test_assumed_bounds_keep_all_their_digits(bound: float) -> None:
    assert float(all_digits(bound)) == bound
    text = setid.estimate_noise_bound([bound, -bound]).assumption
    assert float(text.split()[1]) == bound


def test_the_share_of_samples_within_a_range_is_rounded_down() -> None:
    u, y = np.append(np.zeros(20), np.ones(180)), np.append(np.zeros(21), np.ones(179))
    rest = np.random.default_rng(0).uniform(-1, 1, 200_000)
    found = setid.advise(setid.IOData(u, y, Ts=0.01), rest)
    share = float(re.findall(rf"at least ({NUMBER}) %", found.text)[0])
    assert share <= 100 * found.coverage < 100


LOW, HIGH = np.array([1 / 3, -2 / 3]), np.array([2 / 3, -1 / 3])  # no digits end any of them
ENDS: dict[str, tuple[Callable[[Any], str], dict[str, Any]]] = {
    "step band": (
        setid.StepBand.summary,
        {"kind": "proved", "output": 1, "input": 1, "report": None, "later": (1 / 3, 2 / 3)}
        | {"recursion": ""},
    ),
    "zeros": (repr_of(control.Undershoot), {"verdict": "none", "zeros": ((1 / 3, 2 / 3),)}),
    "zeros below zero": (
        repr_of(control.Undershoot),
        {"verdict": "none", "zeros": ((-2 / 3, -1 / 3),)},
    ),
    "equation error": (
        repr_of(neural.EquationError),
        {"lower_bound": LOW, "upper_bound": HIGH, "row": np.arange(3), "status": "open"},
    ),
    "output error": (
        repr_of(neural.OutputError),
        {"lower_bound": 1 / 3, "upper_bound": 2 / 3, "nodes": 1, "status": "open"},
    ),
    "training": (
        repr_of(neural.ProvedTraining),
        {"lower_bound": 1 / 3, "upper_bound": 2 / 3, "nodes": 1, "status": "open"},
    ),
}


@pytest.mark.parametrize("name", ENDS)
def test_ends_in_names_of_results_hold_those_of_the_results(name: str) -> None:
    text, fields = ENDS[name]
    shown = re.findall(rf"\[({NUMBER}), ({NUMBER})\]", text(SimpleNamespace(**fields)))
    exact = [(1 / 3, 2 / 3), (-2 / 3, -1 / 3)]
    assert shown
    for low, high in shown:
        least, most = exact[low.startswith("-")]
        assert Fraction(low) <= Fraction(least) and Fraction(most) <= Fraction(high)


@pytest.mark.parametrize("eps", [0.0123449, 1 / 3])
def test_distances_from_lines_are_rounded_upwards(eps: float) -> None:
    net = SimpleNamespace(network=SimpleNamespace(activation=("tanh",)))
    kinds: dict[Callable[[Any], str], dict[str, Any]] = {
        repr_of(neural.Envelope): {"name": "tanh", "centres": [0], "coefficients": np.ones((1, 2))},
        repr_of(neural.SmoothHiddenWeights): {"net": net, "intervals": {}, "status": "open"},
    }
    for text, fields in kinds.items():
        shown = re.findall(rf"within ({NUMBER})", text(SimpleNamespace(eps=eps, **fields)))
        assert Fraction(shown[0]) >= Fraction(eps)


def test_blocks_of_pictures_hold_their_intervals(results: list[setid.Identification]) -> None:
    model: Any = SimpleNamespace(fixed=())
    for result in results:
        for name, item in result.intervals.items():
            low, high = re.findall(NUMBER, block_value(model, result, name).split(" in ")[1])
            assert Fraction(low) <= Fraction(item.outer[0])
            assert Fraction(item.outer[1]) <= Fraction(high)


def test_claims_of_certificates_are_rounded_downwards() -> None:
    x = sp.variables(1)[0]
    for value in (1 / 3, -2 / 3):
        found = sp.solve(sp.Problem(x, [], [value], [9.0]))
        ratio = sp.solve(sp.RationalProblem(sp.ratio(x, 2.0 + x**2), [], [value], [9.0]))
        for certificate in (found.certificate, ratio.certificate):
            shown = re.findall(rf"objective >= ({NUMBER})", str(certificate))
            assert Fraction(shown[0]) <= Fraction(certificate.bound)


def test_margins_are_rounded_to_what_is_proved() -> None:
    margins: Any = SimpleNamespace(sensitivity=4 / 3, gain=(4 / 7, 11 / 3), phase=2 / 3)
    top, least, most, phase = map(Fraction, re.findall(NUMBER, margins_text(margins)))
    assert top >= Fraction(4 / 3) and phase <= Fraction(2 / 3)
    assert Fraction(4 / 7) <= least and most <= Fraction(11 / 3)


@pytest.mark.parametrize("low", [0.123456789, 2 / 3, 0.0])
def test_below_a_delta_no_more_is_excluded_than_proved(low: float) -> None:
    text = _sentence(0.7, low, 1.0, True)
    assert Fraction(re.findall(rf"none below ({NUMBER}) is", text)[0]) <= Fraction(low)


def test_ratios_and_denominators_are_shown_within_their_bounds() -> None:
    ends = SimpleNamespace(status="open", lower_bound=1 / 3, upper_bound=2 / 3)
    low, high = re.findall(NUMBER, repr_of(sp.RationalResult)(ends))
    assert Fraction(low) <= Fraction(1 / 3) and Fraction(2 / 3) <= Fraction(high)
    x = sp.variables(1)[0]
    with pytest.raises(sp.DenominatorError) as caught:
        sp.solve(sp.RationalProblem(sp.ratio(x, (1 / 3) * x), [], [-1.0], [2.0]))
    shown = re.findall(rf"only ({NUMBER}) <= q <= ({NUMBER})", str(caught.value))
    low, high = shown[0]
    assert Fraction(low) <= Fraction(-1 / 3) and Fraction(2 / 3) <= Fraction(high)


LONG = 0.1234564321  # more digits than %g writes


def test_assumptions_keep_all_digits_of_what_they_assume() -> None:
    u = np.random.default_rng(0).uniform(-1, 1, 20)
    y = setid.simulate(setid.TransferFunction(1, 1, 1), [-0.5, 1.0], u).ravel()
    data, bound = setid.IOData(u, y), setid.Noise(output=0.01)
    gain = setid.Hammerstein(setid.TransferFunction(0, 1), 2, normalise={"b0": LONG})
    slow = setid.ContinuousTransferFunction(1, 0, method="lambda", tau=LONG)
    plant, M = control.Transfer([0, 1], [1, -0.5]), control.Transfer([0, 0.4], [1, -0.6])
    K, gate = control.ideal_controller(plant, M), ([[0.5]], [[0.1]], [0.0])
    texts = [
        setid.formulate(data, gain, bound).assumptions,
        setid.formulate(data, slow, bound).assumptions[1:],
        control.stability_certificate(data, K, M, 1, 0.01, margin=LONG, delay=1).assumptions,
        (setid.estimate_noise_bound(y, margin=1 + LONG).assumption,),
        neural.stability(neural.GRU(gate, gate, gate), [0, LONG]).assumptions,
    ]
    for found in texts:
        assert re.search(f"[01]{str(LONG)[1:]}", " ".join(found)), found


def test_rates_are_rounded_upwards() -> None:
    rate = 0.1234561
    text = repr_of(Condition)(SimpleNamespace(name="norm", holds=True, rate=rate))
    assert float(text.split()[-1]) >= rate


def test_what_the_log_calls_proved_is(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO):
        progress = Progress(["a1"], 1e-3, False)
        for k, (lower, upper) in enumerate([(-1 / 3, -2 / 9), (-1 / 3, -2 / 9)]):
            progress.report(k, lower, upper)
        Stages(show=False).bounds(-1 / 3, -2 / 9)
    texts = [record.getMessage().split("proved")[1] for record in caplog.records[1:]]
    ends, alone = (re.findall(NUMBER, text) for text in texts)
    low, high, least, most = map(Fraction, ends)
    assert low <= Fraction(-1 / 3) and Fraction(1 / 3) <= high
    assert Fraction(-2 / 9) <= least and most <= Fraction(2 / 9)
    assert Fraction(alone[0]) <= Fraction(-1 / 3) and Fraction(-2 / 9) <= Fraction(alone[1])


def test_a_delta_that_is_advised_covers_the_error_found() -> None:
    u = np.repeat([1.0, -1.0, 2.0, 0.0, 1.0], 3)
    for a0 in np.linspace(0.6, 2.0, 8):
        model, theta = setid.ContinuousTransferFunction(1, 0, Ts=0.5), np.array([a0, 1.0])
        data = setid.IOData(u, np.zeros(u.size), Ts=0.5)
        known = setid.formulate(data, model, setid.Noise(output=0.01))
        advised = re.findall(rf"give delta >= ({NUMBER})", remark(known, theta))[0]
        assert float(advised) >= np.abs(setid.discretisation_error(model, theta, u)).max()


def test_widths_of_tables_are_no_less_than_those_proved() -> None:
    """By hand b0 lies in [23/12, 2.10930233], whose width is 0.19263566."""
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    for bound in (0.5, 0.51, 0.52, 0.53, 0.54):
        result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=bound))
        rows = re.findall(r"<tr>.*?</tr>", result._repr_html_(), re.DOTALL)
        for name, item in result.intervals.items():
            low, high = map(Fraction, item.outer)
            (line,) = (row for row in result.table().splitlines() if row.startswith(name))
            assert high - low <= Fraction(line.split()[5]) <= (high - low) * Fraction(101, 100)
            assert any(name in row and f">{line.split()[5]}<" in row for row in rows)
