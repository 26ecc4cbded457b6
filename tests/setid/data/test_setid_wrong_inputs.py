"""Arguments of the wrong kind raise an exception of the package that names them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import setid

DATA = setid.IOData([1.0, 2.0, -1.0, 0.5], [0.0, 0.9, 1.7, -0.6])
MODEL = setid.TransferFunction(1, 1)
NOISE = setid.Noise(output=0.5)

WRONG: dict[str, tuple[Callable[[], Any], str]] = {
    "one record": (lambda: setid.IOData.concat(DATA), "records: found IOData"),
    "text": (lambda: setid.IOData(["1", "2"], ["3", "4"]), "u: found list"),
    "a word": (lambda: setid.TransferFunction(1, 1, offset="no"), "offset: found 'no'"),
    "a number": (
        lambda: setid.TransferFunction(1, 1, common_denominator=3),
        "common_denominator: found 3",
    ),
    "a truth value": (lambda: setid.Noise(output=True), "output: found True"),
    "a huge bound": (lambda: setid.Noise(output=10**400), "output: found int 1000"),
    "a huge sample": (lambda: setid.IOData([1, 10**400], [0, 1]), "u: found list"),
    "a huge end": (
        lambda: setid.Box({"a1": (0, 10**400)}),
        "a1: high: found a number beyond all doubles",
    ),
    "no list of sets": (lambda: setid.Noise(constraints=3), "constraints: found int"),
    "a class": (
        lambda: setid.identify(DATA, setid.TransferFunction, NOISE),
        "model: found type",
    ),
    "no list of priors": (
        lambda: setid.identify(DATA, MODEL, NOISE, priors=3),
        "priors: found int",
    ),
    "no name": (lambda: setid.Hammerstein(MODEL, 2, normalise=3), "normalise: found int"),
    "no names": (lambda: setid.Hammerstein(MODEL, 2, normalise=[3]), "normalise: found 3"),
    "no list of orders": (
        lambda: setid.select(DATA, setid.TransferFunction, NOISE, orders=2),
        "orders: found int",
    ),
    "a bound for the noise": (
        lambda: setid.simulate_record(MODEL, {"a1": 0.5, "b0": 1.0}, [1.0, 2.0], 0.1),
        "noise: found float",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_kinds_are_named(name: str) -> None:
    call, message = WRONG[name]
    with pytest.raises(setid.SetidError, match=f"^{message}"):
        call()


@pytest.mark.parametrize("read", [setid.IOData.from_csv, setid.IOData.from_mat])
def test_missing_files_are_named(read: Callable[..., Any], tmp_path: Path) -> None:
    with pytest.raises(setid.DataError, match="nowhere: No such file"):
        read(tmp_path / "nowhere", "u", "y")
