"""Docstrings of the engine: complete where public, and in the field's words everywhere."""

from __future__ import annotations

import ast
import enum
import functools
import inspect
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from numpydoc.validate import validate

import sparsepop_py as sp

ROOT = Path(sp.__file__).resolve().parent
SETTINGS = tomllib.loads((ROOT.parent / "pyproject.toml").read_text(encoding="utf-8"))
CHECKS = set(SETTINGS["tool"]["numpydoc_validation"]["checks"])
MOST_WORDS = 15
QUESTION = re.compile(r"(What|How|Where|Whether|Which|When|Why|The rest|Those)\b")
PRIVATE = re.compile(
    r"\b(rungs?|climb(s|ed|ing)?|ladders?|squeez(es|ed|ing)|agenda|cut in two|idle)\b",
    re.IGNORECASE,
)


def public_names() -> Iterator[str]:
    """Name every public object, with the functions of public modules."""
    for name in sorted(sp.__all__):
        found = getattr(sp, name)
        if inspect.ismodule(found):
            yield from (f"{name}.{inner}" for inner in found.__all__)
        else:
            yield name


def public_members() -> Iterator[str]:
    """Name the public methods and properties of every public class."""
    kinds = (property, staticmethod, classmethod, functools.cached_property)
    for name in public_names():
        found = _found(name)
        if inspect.isclass(found) and not issubclass(found, BaseException):
            for member, value in vars(found).items():
                public = inspect.isroutine(value) or isinstance(value, kinds)
                if public and not member.startswith("_"):
                    yield f"{name}.{member}"


def _found(name: str) -> Any:
    return functools.reduce(getattr, name.split("."), sp)


def _excused(name: str) -> set[str]:
    found = _found(name)
    if inspect.isclass(found) and issubclass(found, enum.Enum):
        return {"PR01"}  # the parameters of its metaclass
    if inspect.isclass(found) and issubclass(found, BaseException):
        return {"PR01", "EX01"}
    return set()


def _faults(name: str, excused: set[str]) -> list[tuple[str, str]]:
    errors = validate(f"sparsepop_py.{name}")["errors"]
    return [(code, text) for code, text in errors if code in CHECKS - excused]


@pytest.mark.parametrize("name", list(public_names()))
def test_public_names_have_complete_docstrings_with_an_example(name: str) -> None:
    assert _faults(name, _excused(name)) == []


@pytest.mark.parametrize("name", list(public_members()))
def test_public_members_have_complete_docstrings(name: str) -> None:
    assert _faults(name, {"EX01"}) == []


def modules() -> list[Path]:
    return sorted(path for path in ROOT.rglob("*.py"))


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(ROOT)))
def test_first_lines_are_short_statements(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef)
    for node in ast.walk(tree):
        text = ast.get_docstring(node) if isinstance(node, kinds) else None
        if text is not None:
            first = text.splitlines()[0]
            assert not QUESTION.match(first), first
            assert len(first.split()) <= MOST_WORDS, first


def modules_of(*rooms: str) -> list[Path]:
    return sorted(path for room in rooms for path in (ROOT.parent / room).rglob("*.py"))


@pytest.mark.parametrize("path", modules_of("setid", "checker"), ids=str)
def test_first_lines_of_setid_and_checker_say_what_a_thing_is(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef)
    texts = [ast.get_docstring(node) for node in ast.walk(tree) if isinstance(node, kinds)]
    assert [text for text in texts if text is not None and QUESTION.match(text)] == []


@pytest.mark.parametrize("path", modules_of("sparsepop_py", "checker"), ids=str)
def test_no_word_of_the_old_private_language_is_left(path: Path) -> None:
    lines = path.read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if PRIVATE.search(line)] == []
