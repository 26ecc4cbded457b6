"""The lists of deliberate faults fit the source: each snippet stands in its file exactly once."""

from __future__ import annotations

from pathlib import Path

import pytest
from mutants.run import ROOT, read_list, source

HERE = Path(__file__).parent
LISTS = sorted(HERE.glob("*.toml"))
ROOM = "sparsepop_py/verified/uncertain_rows"
# Types without a check of their own, and checks that rest on certificates alone.
PROPOSED = {f"{ROOM}/{name}.py" for name in ("box", "coupled", "rows")}


@pytest.mark.parametrize("path", LISTS, ids=lambda path: path.stem)
def test_every_fault_can_be_tried(path):
    faults = read_list(path)
    assert [f"{f.file}: {f.says}: {f.wrong()}" for f in faults if f.wrong()] == []
    names = [(f.file, f.says) for f in faults]
    assert len(set(names)) == len(names)
    changes = [(f.file, f.changed(source(f.file))) for f in faults]
    assert len(set(changes)) == len(changes)


def test_every_file_of_the_trusted_kernel_has_faults():
    faults = read_list(HERE / "verified.toml")
    assert len(faults) >= 150
    tried = {fault.file for fault in faults}
    kernel = (ROOT / "sparsepop_py" / "verified").rglob("*.py")
    wanted = {str(path.relative_to(ROOT)) for path in kernel if path.name != "__init__.py"}
    assert wanted - tried <= PROPOSED
