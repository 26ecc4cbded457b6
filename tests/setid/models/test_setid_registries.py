"""Structures and priors by name, from outside the package as well."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path

import pytest

import setid
from setid import cli
from setid.models.registry import families, family_of
from setid.priors.base import Plain


def test_the_structures_of_the_package_are_known() -> None:
    assert set(families()) >= {"TransferFunction", "PolynomialNARX"}
    family = family_of("TransferFunction")
    assert family is not None and family is family_of(setid.TransferFunction)
    assert family(2, 1, 1, 1) == setid.TransferFunction(2, 3)
    assert family_of(int) is None
    with pytest.raises(setid.ModelError, match="family: found 'ARX', expected one of Transfer"):
        family_of("ARX")


def test_select_takes_names() -> None:
    u = [1, -1, 2, 0, 1, -2, 1, 3]
    y = setid.simulate(setid.TransferFunction(na=1, nb=2), [-0.5, 0, 1], u)
    data, noise = setid.IOData(u, y), setid.Noise(equation=1e-3)
    by_name = setid.select(data, "TransferFunction", noise, [0, 1])
    by_class = setid.select(data, setid.TransferFunction, noise, [0, 1])
    assert by_name.log == by_class.log and by_name.chosen is not None


def test_every_public_prior_can_be_read() -> None:
    texts = {
        "Box": "Box({'a1': (-1, 1)})",
        "DCGain": "DCGain(0.9, 1.1)",
        "Known": "Known({'b0': 0.0})",
        "MinimumPhase": "MinimumPhase",
        "PoleIn": "PoleIn(0, 1)",
        "Sign": "Sign({'b1': '+'})",
        "Stable": "Stable(0.1, form='jury')",
        "ZeroIn": "ZeroIn(low=0, high=1)",
    }
    for name, text in texts.items():
        assert type(setid.read_prior(text)) is getattr(setid, name)
    assert setid.read_prior(texts["Stable"]) == setid.Stable(0.1, form="jury")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("Stable(", "expected a call"),
        ("1 + 1", "expected a call"),
        ("os.remove('x')", "expected a call"),
        ("Stabel()", "found 'Stabel', expected one of Box"),
        ("Stable(margin=open('x'))", "cannot be read: expected numbers, texts in quotes"),
        ("Stable(edge=1)", "cannot be read: expected Stable(margin=0.0, form='step-up')"),
        ("DCGain()", "cannot be read: expected DCGain(low, high=None, output=1, input=1)"),
        ("PoleIn(1, 2, 3, 4, 5)", "cannot be read: expected PoleIn(low, high, output=1, input=1)"),
        ("Stable(2.0, form=3)", "form: found 3"),
    ],
)
def test_other_texts_are_refused(text: str, message: str) -> None:
    with pytest.raises(setid.PriorError, match=re.escape(message)):
        setid.read_prior(text)


@dataclass(frozen=True)
class Nothing(Plain):
    """A prior of a user's own."""

    note: str = ""


def test_a_prior_of_ones_own_is_read_by_name() -> None:
    setid.register_prior(Nothing)
    assert setid.read_prior("Nothing('of use')") == Nothing("of use")
    setid.register_prior(Nothing)  # once more, as notebooks do


def test_names_are_given_once_and_to_classes() -> None:
    with pytest.raises(setid.PriorError, match="'Stable', which is setid"):
        setid.register_prior(type("Stable", (Plain,), {"__module__": "elsewhere"}))
    with pytest.raises(
        setid.PriorError, match="found int, expected a class with the methods of Prior"
    ):
        setid.register_prior(int)
    other = type("TransferFunction", (), {"__module__": "elsewhere"})
    with pytest.raises(setid.ModelError, match="'TransferFunction', which is setid"):
        setid.register_structure(other, lambda *given: setid.TransferFunction(1, 1))


def test_the_command_line_takes_names(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    record = tmp_path / "record.csv"
    record.write_text("u,y\n4,0\n-3,-6.25\n2,1.175\n1,2.0875\n")
    common = ["identify", str(record), "--equation-noise", "0.5", "--json", "-"]
    named = [*common, "--structure", "PolynomialNARX", "--order", "1", "--degree", "1"]
    assert cli.main([*common, "--na", "1", "--nb", "1", "--prior", "Sign({'b0': '+'})"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert any("Sign" in text for text in found["assumptions"])
    assert cli.main([*named, "--na", "1"]) == 2
    assert "--na: found a value, expected it without --structure" in capsys.readouterr().err
    assert cli.main([*common, "--structure", "PolynomialNARX"]) == 2
    assert "--order" in capsys.readouterr().err
    assert cli.main(named) == 1  # four parameters, three rows
    model = setid.PolynomialNARX.full(1, 1, 1, 1, 1)
    assert json.loads(capsys.readouterr().out)["model"] == repr(model)


@pytest.mark.parametrize(
    "given",
    [
        "--structure TransferFunction --order 1 --offset",
        "--structure TransferFunction --order 1 --common-denominator",
        "--structure TransferFunction --order 1 --from-rest",
        "--structure TransferFunction --order 1 --continuous 1 0",
        "--na 1 --nb 1 --order 2",
        "--na 1 --nb 1 --degree 2",
    ],
)
def test_the_command_line_ignores_no_part_of_a_structure(
    given: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    record = tmp_path / "record.csv"
    record.write_text("u,y\n4,0\n-3,-6.25\n2,1.175\n1,2.0875\n")
    assert cli.main(["identify", str(record), "--equation-noise", "0.5", *given.split()]) == 2
    assert "--structure" in capsys.readouterr().err
