"""The page of the second trusted room counts its lines."""

from __future__ import annotations

import re
from pathlib import Path

import setid

ROOT = Path(setid.__file__).resolve().parent
PAGE = ROOT / "proofs" / "README.md"


def lines(folder: Path) -> int:
    return sum(len(path.read_text().splitlines()) for path in folder.rglob("*.py"))


def test_the_page_counts_the_lines_of_every_trusted_room() -> None:
    stated = dict(re.findall(r"\| `(\w+)` \| (\d+) \|", PAGE.read_text()))
    counted = {room: lines(ROOT / room) for room in stated}
    assert counted == {room: int(count) for room, count in stated.items()}
    assert {"data", "models", "priors", "formulation", "proofs"} <= set(stated)
    whole = re.search(r"That is (\d+) lines", PAGE.read_text())
    assert whole and int(whole[1]) == sum(counted.values())


def test_the_page_names_files_that_are_there() -> None:
    named = re.findall(r"`([\w/]+\.py)`", PAGE.read_text())
    assert len(named) >= 6 and all(
        any((p / name).exists() for p in (ROOT / "proofs", ROOT.parent)) for name in named
    )
