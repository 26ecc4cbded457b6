"""Results say which parameters a record does not tell apart, and do not ask for more time."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import setid
from setid.identifiability.dependent_signals import dependent_parameters

QUICK = setid.Options(time_limit=5.0, progress=False)
OFFSET = setid.TransferFunction(2, 1, 1, offset=True)


def record(u: np.ndarray) -> setid.IOData:
    y = np.zeros(len(u))
    for k in range(2, len(u)):
        y[k] = 1.2 * y[k - 1] - 0.4 * y[k - 2] + 0.5 * np.sum(u[k - 1]) + 2.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", setid.SetidWarning)
        return setid.IOData(u, y + 3.0 * np.random.default_rng(0).uniform(-1, 1, len(u)))


DRIVEN = np.random.default_rng(1).uniform(-1.0, 1.0, 40)


def test_a_constant_input_and_an_offset_are_one_signal() -> None:
    data = record(np.full(150, 9.0))
    result = setid.identify(data, OFFSET, setid.Noise(output=3.0), (), QUICK)
    text = result.summary()
    assert result.intervals["b1"].outer == result.intervals["c"].outer == (-np.inf, np.inf)
    assert "does not tell b1, c apart" in text and "speaks of 9 b1 + c alone" in text
    assert "the noise is strong" not in text
    named = [line for line in text.splitlines() if line.startswith("wide")]
    assert all("b1" not in line for line in named)


@pytest.mark.parametrize(
    ("u", "model", "expected"),
    [
        (np.full(40, 9.0), OFFSET, {"b1": 1.0, "c": -9.0}),
        (np.full(40, 9.0), setid.TransferFunction(1, 2, 1), {"b1": 1.0, "b2": -1.0}),
        (
            np.column_stack([DRIVEN, 4.0 * DRIVEN]),
            setid.TransferFunction(1, 1, 1, inputs=2, common_denominator=True),
            {"b[1,1]1": 1.0, "b[1,2]1": -0.25},
        ),
        (DRIVEN, OFFSET, {}),
        (np.full(40, 9.0), setid.TransferFunction(1, 1, 1, offset=True, initial="zero"), {}),
    ],
)
def test_the_change_that_no_equation_sees(
    u: np.ndarray, model: setid.TransferFunction, expected: dict[str, float]
) -> None:
    found = dependent_parameters(setid.formulate(record(u), model, setid.Noise(output=3.0)))
    assert found == pytest.approx(expected)


def test_bounded_parameters_and_noisy_inputs_are_left_alone() -> None:
    data = record(np.full(40, 9.0))
    for noise, prior in (
        (setid.Noise(output=3.0), [setid.Box({"c": (0.0, 4.0)})]),
        (setid.Noise(output=3.0, input=0.1), []),
    ):
        assert dependent_parameters(setid.formulate(data, OFFSET, noise, prior)) == {}
