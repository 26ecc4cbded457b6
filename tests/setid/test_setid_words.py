"""Arguments that take one of some words name whatever else they are given."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

import setid
from setid import control, neural
from setid.plots.responses import plot_frequency_band

QUIET = setid.Options(progress=False)
DATA = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
FIRST = setid.TransferFunction(1, 1)
GATE = ([[1.0]], [[0.1]], [0.0])


@cache
def result() -> setid.Identification:
    return setid.identify(DATA, FIRST, setid.Noise(equation=0.5), (), QUIET)


@cache
def map_result() -> setid.Identification:
    u = np.linspace(-1, 1, 9)
    model = setid.Hammerstein(setid.TransferFunction(0, 1), 2, normalise="b0")
    return setid.identify(setid.IOData(u, u + 0.5 * u**2), model, setid.Noise(output=0.01))


def certificate(word: Any) -> object:
    half = control.Transfer([0, 0.5], [1, -0.5])
    return control.stability_certificate(DATA, half, half, 1, 0.1, method=word)


def csv(word: Any) -> object:
    return setid.IOData.from_csv("none.csv", "u", "y", Ts=1.0, decimal=word)


CALLS: dict[str, Callable[[Any], object]] = {
    "norm": lambda w: setid.fit(DATA, FIRST, norm=w),
    "errors": lambda w: setid.fit(DATA, FIRST, errors=w),
    "kind of simulate_band": lambda w: setid.simulate_band(result(), kind=w),
    "kind of frequency_band": lambda w: setid.frequency_band(result(), [0.1], kind=w),
    "kind of step_band": lambda w: setid.step_band(result(), 5, kind=w),
    "kind of static_band": lambda w: setid.static_band(map_result(), kind=w),
    "kind of to_control": lambda w: setid.to_control(result(), kind=w),
    "kind of plot_frequency_band": lambda w: plot_frequency_band(
        setid.frequency_band(result(), [0.1]), w
    ),
    "kind of RateLimit": lambda w: setid.RateLimit(w, 1.0),
    "kind of detrend": lambda w: DATA.detrend(w),
    "name of static_band": lambda w: setid.static_band(map_result(), w),
    "name of signal_band": lambda w: setid.signal_band(map_result(), w),
    "mode": lambda w: setid.compare(result(), mode=w),
    "goal": lambda w: setid.best(result(), w),
    "target": lambda w: setid.to_structs(DATA, FIRST, setid.Noise(), target=w),
    "method of to_continuous": lambda w: setid.to_continuous(result(), w),
    "method of stability_certificate": certificate,
    "initial": lambda w: setid.TransferFunction(1, 1, initial=w),
    "form": lambda w: setid.TransferFunction(1, 1, form=w),
    "form of Stable": lambda w: setid.Stable(form=w),
    "initial of PolynomialNARX": lambda w: setid.PolynomialNARX(["u1"], 1, 1, initial=w),
    "initial of Hammerstein": lambda w: setid.Hammerstein(FIRST, 2, initial=w),
    "form of Hammerstein": lambda w: setid.Hammerstein(FIRST, 2, form=w),
    "normalise": lambda w: setid.Hammerstein(FIRST, 2, normalise=w),
    "hold": lambda w: setid.ContinuousTransferFunction(1, 0, hold=w),
    "method of ContinuousTransferFunction": lambda w: setid.ContinuousTransferFunction(1, 0, w),
    "delta": lambda w: setid.ContinuousTransferFunction(1, 0, delta=w),
    "decimal": csv,
    "unidentifiable": lambda w: setid.Options(unidentifiable=w),
    "reset": lambda w: neural.GRU(GATE, GATE, GATE, None, w),
    "activation of Elman": lambda w: neural.Elman([GATE], None, w),
    "activation of Network": lambda w: neural.Network([[[1]], [[1]]], [[0], [0]], w),
    "activation of initial": lambda w: neural.initial(DATA, 1, [1], w),
    "name of envelope": lambda w: neural.envelope(w, -1.0, 1.0),
    "method of train": lambda w: neural.train(neural.initial(DATA, 1, [1]), DATA, w),
    "method of train_proved": lambda w: neural.train_proved(
        neural.initial(DATA, 1, [1], "relu"), DATA, method=w
    ),
}


@pytest.mark.parametrize("given", [np.eye(2), ["word"], {"a": 1}, object(), "no such word"])
@pytest.mark.parametrize("name", CALLS)
def test_what_is_no_word_is_named(name: str, given: object) -> None:
    with pytest.raises(setid.SetidError, match=f"{name.split()[0]}.*: found"):
        CALLS[name](given)
