"""Networks and controllers name the argument that is no number, no list or no record."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import setid
from setid import control, neural

DATA = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
HALF = control.Transfer([0, 0.5], [1, -0.5])
GATE = ([[1.0]], [[0.1]], [0.0])


def net() -> neural.NNARX:
    return neural.initial(DATA, 1, [1], "relu")


def stable() -> neural.Stability:
    return neural.stability(neural.GRU(GATE, GATE, GATE))


CALLS: dict[str, Callable[[Any], object]] = {
    "time_limit": lambda v: neural.hidden_weights(net(), DATA, 5.0, time_limit=v),
    "time_limit of train_proved": lambda v: neural.train_proved(net(), DATA, time_limit=v),
    "weights": lambda v: neural.train_proved(net(), DATA, v),
    "weights of hidden_weights": lambda v: neural.hidden_weights(net(), DATA, 5.0, v),
    "nodes": lambda v: neural.train_proved(net(), DATA, nodes=v),
    "tolerance": lambda v: neural.train_proved(net(), DATA, tolerance=v),
    "low": lambda v: neural.envelope("tanh", v, 1.0),
    "pieces": lambda v: neural.envelope("tanh", -1.0, 1.0, v),
    "order": lambda v: neural.initial(DATA, v),
    "widths": lambda v: neural.initial(DATA, 1, v),
    "steps": lambda v: stable().distance(v, 1.0),
    "initial": lambda v: stable().distance(3, v),
    "errors": lambda v: stable().limit(errors=v),
    "result": lambda v: setid.to_ureal(v, Path("none.m")),
    "data": lambda v: control.stability_certificate(v, HALF, HALF, 1, 0.1),
    "delay": lambda v: control.reference_model(rise=3.0, delay=v),
    "numerator": lambda v: control.Transfer(v),
    "numerators": lambda v: control.Polynomials(v),
}


@pytest.mark.parametrize("given", [None, object(), float("nan")])
@pytest.mark.parametrize("name", CALLS)
def test_what_is_no_number_or_list_is_named(name: str, given: object) -> None:
    with pytest.raises(setid.SetidError, match=f"{name.split()[0]}.*: found"):
        CALLS[name](given)


@pytest.mark.parametrize("name", ["initial", "errors", "order", "pieces", "weights", "delay"])
def test_negative_sizes_are_named(name: str) -> None:
    with pytest.raises(setid.SetidError, match=f"{name}.*: found"):
        CALLS[name](-1)


def test_arrays_and_nothing_are_named_too() -> None:
    for name in ("weights", "time_limit", "pieces", "initial", "low"):
        with pytest.raises(setid.SetidError, match=f"{name}.*: found"):
            CALLS[name](np.eye(2))
    with pytest.raises(setid.ModelError, match="numerators: found none"):
        control.Polynomials([])


@pytest.mark.parametrize(
    "make",
    [
        lambda n: setid.IOData([n, 1, 2], [0, 1, 2.5]),
        lambda n: setid.IOData(np.array([1, 2, 4]), np.array([n, 1, 2])),
        lambda n: setid.Noise(output=n),
        lambda n: setid.Noise(output=np.array([n, n])),
        lambda n: setid.Box({"a1": (0, n)}),
    ],
)
def test_integers_that_no_double_holds_are_refused(make: Callable[[int], object]) -> None:
    """Rounded they would be other readings and lower bounds."""
    with pytest.raises(setid.SetidError, match="4611686018427388159, which no double holds"):
        make(2**62 + 255)
