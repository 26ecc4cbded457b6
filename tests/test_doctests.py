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
# modules whose examples need an optional package
OPTIONAL = {"sparsepop_py.pyomo": "pyomo", "sparsepop_py.io.other_software.pyomo_": "pyomo"}


@pytest.mark.parametrize("name", ["sparsepop_py", "setid", *MODULES])
def test_doctests(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if name in OPTIONAL:
        pytest.importorskip(OPTIONAL[name])
    monkeypatch.chdir(tmp_path)
    failed, _ = doctest.testmod(importlib.import_module(name))
    assert failed == 0


def test_there_are_doctests() -> None:
    finder = doctest.DocTestFinder()
    modules = map(
        importlib.import_module,
        ["sparsepop_py", *(name for name in MODULES if name not in OPTIONAL)],
    )
    assert sum(bool(test.examples) for m in modules for test in finder.find(m)) > 20
