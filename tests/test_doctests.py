"""The examples in docstrings, warnings being errors."""

from __future__ import annotations

import doctest
import importlib
import pkgutil
from pathlib import Path

import pytest

import setid
import sparsepop_py

MODULES = [
    info.name
    for package in (sparsepop_py, setid)
    for info in pkgutil.walk_packages(package.__path__, package.__name__ + ".")
]


@pytest.mark.parametrize("name", ["sparsepop_py", "setid", *MODULES])
def test_doctests(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    failed, _ = doctest.testmod(importlib.import_module(name))
    assert failed == 0


def test_there_are_doctests() -> None:
    finder = doctest.DocTestFinder()
    modules = map(importlib.import_module, ["sparsepop_py", *MODULES])
    assert sum(bool(test.examples) for m in modules for test in finder.find(m)) > 20
