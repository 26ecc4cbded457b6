"""The public names: complete, documented, typed."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
import tomllib
from pathlib import Path
from types import ModuleType

import pytest
from docstrings import documented, parameters

import setid
import sparsepop_py as sp

ROOT = Path(__file__).resolve().parent.parent
TEXT = {".py", ".md", ".toml", ".gms", ".cff", ".m", ".yml", ".txt", ".csv", ""}


def all_modules() -> list[ModuleType]:
    names = [
        info.name
        for package in (sp, setid)
        for info in pkgutil.walk_packages(package.__path__, package.__name__ + ".")
    ]
    found = [sp, setid]
    for name in names:
        try:
            found.append(importlib.import_module(name))
        except ImportError as error:  # needs an optional package
            assert not (error.name or "").startswith(("sparsepop_py", "setid")), error
    return found


@pytest.mark.parametrize("name", sp.__all__)
def test_public_names_exist_and_are_documented(name: str) -> None:
    thing = getattr(sp, name)
    text = inspect.getdoc(thing)
    assert text and len(text.splitlines()[0]) > 10, f"{name} has no docstring"
    if inspect.isfunction(thing):
        assert parameters(thing) <= documented(text), f"{name}: {parameters(thing)}"
        assert thing.__annotations__.get("return"), f"{name} does not say what it returns"


@pytest.mark.parametrize("name", [n for n in sp.__all__ if inspect.isclass(getattr(sp, n))])
def test_fields_and_methods_of_public_classes_are_documented(name: str) -> None:
    thing = getattr(sp, name)
    own = {key: value for key, value in vars(thing).items() if not key.startswith("_")}
    if "__init__" in vars(thing):
        missing = parameters(thing) - documented(inspect.getdoc(thing) or "")
        assert not missing, f"{name}: {missing}"
    for key, value in own.items():
        member = value.__func__ if isinstance(value, classmethod | staticmethod) else value
        if inspect.isfunction(member) or isinstance(member, property):
            text = inspect.getdoc(member)
            assert text, f"{name}.{key} has no docstring"
            if inspect.isfunction(member) and "Parameters\n---" in text:
                assert parameters(member) <= documented(text), f"{name}.{key}"


def test_the_list_of_public_names_is_sorted_and_unique() -> None:
    assert sp.__all__ == sorted(set(sp.__all__))


def test_modules_say_what_they_offer() -> None:
    for module in all_modules():
        assert module.__doc__, f"{module.__name__} has no docstring"
        for name in getattr(module, "__all__", ()):
            assert hasattr(module, name), f"{module.__name__}.__all__ names {name}"
            thing = getattr(module, name)
            if inspect.isfunction(thing) or inspect.isclass(thing):
                assert thing.__doc__, f"{module.__name__}.{name} has no docstring"


def test_type_hints_are_shipped() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    data = project["tool"]["setuptools"]["package-data"]
    for package in ("sparsepop_py", "setid"):
        assert (ROOT / package / "py.typed").exists()
        assert "py.typed" in data[package]


def test_files_name_no_path_of_one_machine() -> None:
    absolute = re.compile(r"(?<![\w.:/])/(?:home|root|work|Users|mnt|srv)/\w")
    folders = ("sparsepop_py", "setid", "tests", "examples", "docs", "benchmarks", ".ci")
    files = [p for p in ROOT.iterdir() if p.is_file() and not p.is_symlink() and p.name != ".git"]
    files += [p for folder in folders for p in (ROOT / folder).rglob("*") if p.is_file()]
    for path in files:
        hidden = any(part.startswith(".") for part in path.relative_to(ROOT).parts[1:])  # caches
        if path.suffix in TEXT and not hidden:
            found = absolute.search(path.read_text(encoding="utf-8"))
            assert not found, f"{path.relative_to(ROOT)} names {found}"
