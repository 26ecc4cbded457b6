"""Warnings come once in a call, however often a problem is stated in it."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import setid

QUICK = setid.Options(time_limit=0.5, progress=False)
MODEL = setid.TransferFunction(1, 1, 1, offset=True)


def record(value: float) -> setid.IOData:
    y = 1.0 - 0.8 ** np.arange(30) + 0.05 * np.cos(np.arange(30.0) ** 2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", setid.SetidWarning)
        return setid.IOData(np.full(30, value), y)


CALLS: dict[str, Callable[[setid.IOData], Any]] = {
    "least squares": lambda data: setid.fit(data, MODEL, "l2", options=QUICK),
    "least sum": lambda data: setid.fit(data, MODEL, "l1", options=QUICK),
    "least error": lambda data: setid.fit(data, MODEL, "linf", options=QUICK),
    "least noise": lambda data: setid.consistency(
        data, MODEL, setid.Noise(output=0.1), options=QUICK
    ),
    "held out": lambda data: setid.identify(
        data, MODEL, setid.Noise(equation=0.1), options=QUICK, holdout=0.5
    ),
    "orders": lambda data: setid.select(
        data, lambda n, _: setid.TransferFunction(n, n, 1), setid.Noise(output=0.1), [1]
    ),
}


@pytest.mark.parametrize("name", CALLS)
def test_a_zero_input_is_warned_of_once(name: str) -> None:
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        CALLS[name](record(0.0))
    assert [str(item.message)[:26] for item in found] == ["u: input 1 is zero through"]


@pytest.mark.parametrize("name", [name for name in CALLS if name != "held out"])
def test_records_that_are_made_on_the_way_do_not_warn_of_constant_inputs(name: str) -> None:
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        CALLS[name](record(2.0))
    assert [str(item.message) for item in found] == []


def test_the_next_call_warns_again() -> None:
    for _ in range(2):
        with pytest.warns(setid.SetidWarning, match="zero throughout"):
            CALLS["held out"](record(0.0))


def test_huge_noise_bounds_do_not_warn_of_overflows() -> None:
    """With |e| <= 1e300 each a1 of [-1e299, 1e299] explains samples of size 1."""
    u, y = np.arange(12.0) % 3, np.arange(12) * 7 % 5 / 5
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        noise = setid.Noise(equation=1e300)
        model = setid.TransferFunction(1, 1, 1)
        found = setid.identify(setid.IOData(u, y), model, noise, options=QUICK)
    low, high = found.intervals["a1"].outer
    assert low <= -1e299 and high >= 1e299
