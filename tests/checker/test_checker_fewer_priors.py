"""What is proved with some of the priors is checked as such, and nothing else passes for it."""

from __future__ import annotations

import copy
import functools
import json
import subprocess
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_checker_schema import SCHEMA, valid

import setid
import sparsepop_py as sp
from checker.arithmetic.polynomial import INF
from checker.files import reading
from checker.records.fewer_priors import check_given
from checker.records.record import Identification
from checker.result import NotProved
from setid.result.certificate_files import certificate_files

ROOT = Path(__file__).parents[2]
MODEL = setid.TransferFunction(3, 1, 1)
NOISE = setid.Noise(equation=0.5)  # so wide that some ends are unstable
# Stable of order 3 brings unknowns, and one relaxation leaves the problem open
OPTIONS = setid.Options(engine=sp.Options(effort="plain", refine="none"), progress=False)


@functools.cache
def result(kind: str = "record") -> setid.Identification:
    u = np.random.default_rng(5).uniform(-1.0, 1.0, 25)
    theta = [-1.5, 0.85, -0.2, 0.7]
    data = setid.simulate_record(MODEL, theta, u, setid.Noise(equation=0.02), 5).data
    names = setid.parameters(MODEL)
    priors: list[Any] = [setid.Stable(), setid.Box({"b1": (-3, 3)})]
    if kind == "with a gain":  # linear rows beside stability, a product without
        priors.append(setid.DCGain(-100.0, 100.0))
    if kind == "with a row":
        priors.append(names["a1"] + names["b1"] <= -0.79)
    found = setid.identify(data, MODEL, NOISE, priors, OPTIONS)
    assert found.fewer_priors is not None and found.verify(data)
    return found


def loaded(kind: str = "record") -> dict[str, Any]:
    return copy.deepcopy(certificate_files(result(kind))["identification"])


@pytest.mark.parametrize("kind", ["record", "with a row", "with a gain"])
def test_ends_with_fewer_priors_are_proved_again(kind: str) -> None:
    file = certificate_files(result(kind))
    assert valid(json.loads(json.dumps(file)), SCHEMA)
    lines = Identification(json.loads(json.dumps(file))["identification"]).check()
    assert not any(line.startswith("taken as given") for line in lines)
    proved = [line for line in lines if line.startswith("proved: ")]
    assert len(proved) == len(MODEL.parameters)
    alone = loaded(kind) | {"fewer_priors": None}
    with pytest.raises(NotProved, match="only .* is proved"):  # they are not proved without
        Identification(alone).check()


def test_the_program_checks_the_whole_file(tmp_path: Path) -> None:
    path = tmp_path / "fewer.json"
    path.write_text(json.dumps(certificate_files(result())))
    line = [sys.executable, ROOT / "checker" / "check.py", str(path)]
    done = subprocess.run(line, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"proved: {MODEL.parameters[0]} in [" in done.stdout


def narrower(found: dict[str, Any]) -> None:
    outer = found["fewer_priors"]["intervals"][3]["outer"]
    outer[1] = 0.5 * (outer[0] + outer[1])


def given(found: dict[str, Any]) -> None:
    found["fewer_priors"]["given"][0][3] = -2.0


def more_given(found: dict[str, Any]) -> None:
    found["given"][0][3] = -4.0  # inside is more than that


def a_row(found: dict[str, Any]) -> None:
    """A row that leaves out half of the set, which nobody gave."""
    inner = found["fewer_priors"]
    inner["rows"].append(None)
    row = copy.deepcopy(inner["problem"]["constraints"][-1])
    row["polynomial"]["coefficients"]["data"][0] = 0.125
    inner["problem"]["constraints"].append(row)


def a_bound(found: dict[str, Any]) -> None:
    found["fewer_priors"]["variables"][-1] = ["slack", 0, 0]


def another_structure(found: dict[str, Any]) -> None:
    found["fewer_priors"]["structure"]["nk"] = [[0]]


def rows_of_any(found: dict[str, Any]) -> None:
    found["fewer_priors"]["structure"] = {"is": "rows", "text": "some"}


def no_object(found: dict[str, Any]) -> None:
    found["fewer_priors"] = [1]


def itself(found: dict[str, Any]) -> None:
    inner = found["fewer_priors"]
    inner["fewer_priors"] = copy.deepcopy(inner)
    narrower(inner)


@pytest.mark.parametrize(
    "damage",
    [
        narrower,
        given,
        more_given,
        a_row,
        a_bound,
        another_structure,
        rows_of_any,
        no_object,
        itself,
    ],
)
def test_nothing_else_passes(damage: Callable[[dict[str, Any]], None]) -> None:
    found = loaded("with a row")
    damage(found)
    with pytest.raises((NotProved, reading.Malformed)):
        Identification(found).check()


def test_rows_that_are_given_inside_are_given_around_it() -> None:
    """The same constraint counts inside where it is given outside, and only there."""
    found = loaded("with a row")
    last = [k for k, origin in enumerate(found["rows"]) if origin is None][-1]
    inner = found["fewer_priors"]
    assert inner["rows"].count(None) == 1
    for key in ("rows", "problem"):
        table = found[key] if key == "rows" else found[key]["constraints"]
        del table[last]
    with pytest.raises(NotProved, match=r"a row that is not given|is proved"):
        Identification(found).check()


@pytest.mark.parametrize("told", ["some", "others"])
def test_rows_that_are_not_built_here_are_compared_one_by_one(told: str) -> None:
    found = loaded()
    for part in (found, found["fewer_priors"]):
        part["structure"] = {"is": "rows", "text": "some"}
    found["fewer_priors"]["structure"]["text"] = told
    checked = Identification(found)
    if told == "some":
        assert any(line.startswith("taken as given: the rows") for line in checked.check())
        found["fewer_priors"]["problem"]["constraints"][0]["polynomial"]["coefficients"]["data"][
            0
        ] += 1.0
        checked = Identification(found)
    with pytest.raises(NotProved):
        checked.check()


ASKED = {"row"}


@pytest.mark.parametrize(
    ("inner", "free", "why"),
    [
        ({}, [], ""),
        ({"given": [[-2, -9], [3, 9]]}, [], ""),  # less is given
        ({"given": [[0, -9], [2, 9]]}, [], "a is bounded more"),
        ({"given": [[-1, -9], [1, 9]]}, [], "a is bounded more"),
        ({}, ["b"], "b is bounded more"),  # of which nothing may be given
        ({"given": [[-1, -INF], [2, INF]]}, ["b"], ""),
        ({"asked": set()}, [], ""),
        ({"asked": {"another"}}, [], "a row that is not given"),
        ({"slack": (-1, 5)}, [], ""),
        ({"slack": (1, 4)}, [], "s is bounded more"),
        ({"slack": (0, 3)}, [], "s is bounded more"),
        ({"slack": None}, [], ""),
    ],
)
def test_no_more_is_given_inside(inner: dict[str, Any], free: list[str], why: str) -> None:
    def made(given: Any = None, asked: Any = None, slack: Any = (0, 4)) -> Any:
        return SimpleNamespace(
            names=["a", "b"],
            given=given or [[-1, -9], [2, 9]],
            asked=ASKED if asked is None else asked,
            structure=True,
            bounds_of=lambda *_: {} if slack is None else {"s": slack},
        )

    with pytest.raises(NotProved, match=why) if why else nullcontext():
        check_given(made(), made(**inner), "field", free)
