"""The measurements of ``python -m benchmarks walks`` on a package small enough to count by hand."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import networkx as nx
import pytest

from benchmarks.tables import walks

FILES = {
    "__init__.py": "from .top import ask",
    "top.py": "from .deep import middle\ndef ask():\n    return middle.half() + middle.half()",
    "deep/__init__.py": '"""A folder."""',
    "deep/middle.py": "def half():\n    from ..low import one\n    return one() / sum([2])",
    "low.py": "if TYPE_CHECKING:\n    import little.deep.middle\ndef one():\n    return 1",
}


@pytest.fixture
def little(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in FILES.items():
        path = tmp_path / "little" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("from typing import TYPE_CHECKING\n" + text + "\n")
    monkeypatch.setattr(walks, "ROOT", tmp_path)
    monkeypatch.setattr(walks, "PACKAGES", ("little",))
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path / "little"


def test_arrows_are_imports_of_any_kind(little: Path) -> None:
    arrows = {
        ("little", "little.top"),
        ("little.top", "little.deep.middle"),
        ("little.deep.middle", "little.low"),  # inside a function
        ("little.low", "little.deep.middle"),  # for type checkers
    }
    assert set(walks.import_graph(little).edges) == arrows


def test_members_of_a_circle_share_a_floor(little: Path) -> None:
    # little -> top -> {deep.middle, low}, and deep/__init__.py alone
    assert walks.floors(walks.import_graph(little)) == (2, 4, 2)
    chain = nx.DiGraph([("a", "b"), ("b", "c"), ("a", "c")])
    assert walks.floors(chain) == (2, 3, 1)
    assert walks.floors(nx.DiGraph([("a", "b"), ("a", "c")])) == (1, 2, 1)


def _named(name: str) -> Callable[[FrameType], bool]:
    return lambda frame: frame.f_code.co_name == name


def test_a_walk_counts_files_and_changes_of_file(little: Path) -> None:
    top = importlib.import_module("little.top")
    top.ask()
    whole = walks.trace(top.ask)  # ask, half, one, half, one
    assert whole.files == ["little/top.py", "little/deep/middle.py", "little/low.py"]
    assert whole.changes == 4
    short = walks.trace(top.ask, end=_named("one"))  # ask, half
    assert (short.files, short.changes) == (["little/top.py", "little/deep/middle.py"], 1)
    late = walks.trace(top.ask, begin=_named("half"))  # the second half, one
    assert (late.files, late.changes) == (["little/deep/middle.py", "little/low.py"], 1)


def test_a_walk_lets_errors_through(little: Path) -> None:
    with pytest.raises(ZeroDivisionError):
        walks.trace(lambda: 1 / 0)


def test_lines_and_folders_are_counted(little: Path) -> None:
    (top, files, lines) = (found for _, found in walks._folders())
    assert top == "3"
    assert files == "little 3, little/deep 2 (2 folders)"
    assert lines == "17 in 5 files"  # the first line of each is an import
