"""The public names of setid: complete, documented, typed."""

from __future__ import annotations

import inspect
from enum import Enum

import pytest
from docstrings import documented, parameters

import setid


def test_the_list_of_public_names_is_sorted_and_unique() -> None:
    assert setid.__all__ == sorted(set(setid.__all__))


@pytest.mark.parametrize("name", setid.__all__)
def test_public_names_are_documented(name: str) -> None:
    thing = getattr(setid, name)
    text = inspect.getdoc(thing)
    assert text and len(text.splitlines()[0]) > 10
    if inspect.isfunction(thing):
        assert parameters(thing) <= documented(text), f"{parameters(thing) - documented(text)}"
        assert thing.__annotations__.get("return"), f"{name} does not say what it returns"


CLASSES = [
    name
    for name in setid.__all__
    if inspect.isclass(getattr(setid, name))
    and not issubclass(getattr(setid, name), (Exception, Enum))
]


@pytest.mark.parametrize("name", CLASSES)
def test_fields_and_methods_of_public_classes_are_documented(name: str) -> None:
    thing = getattr(setid, name)
    words = documented(inspect.getdoc(thing) or "")
    assert parameters(thing) - words <= {"assumptions"}, parameters(thing) - words
    for key, value in vars(thing).items():
        member = value.__func__ if isinstance(value, classmethod | staticmethod) else value
        if key.startswith("_") or not (inspect.isfunction(member) or isinstance(member, property)):
            continue
        text = inspect.getdoc(member)
        assert text, f"{name}.{key} has no docstring"
        if inspect.isfunction(member) and "Parameters\n---" in text:
            assert parameters(member) <= documented(text), f"{name}.{key}"


def test_values_of_public_classes_cannot_be_changed() -> None:
    data = setid.IOData([1, 2, 3], [1, 2, 1])
    model = setid.TransferFunction(1, 1)
    formulation = setid.formulate(data, model, setid.Noise(0.1))
    frozen = [data, model, setid.Noise(), formulation, setid.Stable(), formulation.layout]
    for thing in [*frozen, setid.least_squares(data, model)]:
        with pytest.raises((AttributeError, TypeError)):
            thing.something = 1
