"""The table of plain relaxations beside SparsePOP's."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.__main__ import main

GMS = """Variables x1,x2,objvar; Equations e1,e2;
e1.. objvar + 2*x1*x2 =E= 0; e2.. 4*x1*x2 + 2*x1 + 2*x2 =L= 3;
x1.lo = 0; x1.up = 1; x2.lo = 0; x2.up = 1;
Solve m using NLP minimizing objvar;
"""
HEAD = "problem,mex,relaxOrder,sparseSW,complementaritySW,rowsA,colsA,nFree,nLP,nSDPblocks,maxSDP,"
TABLE = """SDPobjValue
e.gms,1,3,1,0,25,256,0,12,6,8,-0.5000000002
e.gms,1,3,1,0,25,256,0,12,6,8,-0.5000000002
e.gms,0,2,1,0,25,256,0,12,6,8,-0.5
e.gms,1,1,0,0,6,17,0,8,1,3,-1.500000002
e.gms,1,2,1,1,,,,,,,
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "e.gms").write_text(GMS)
    (tmp_path / "reference.csv").write_text(HEAD + TABLE)
    return tmp_path


def test_sizes_stand_side_by_side(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The sizes of order 3 are SparsePOP 3.03's, those of order 1 have a wrong number."""
    table = folder / "reference.csv"
    assert main(["sparsepop_sizes", str(folder), "--reference", str(table)]) == 0
    lines = [row for row in capsys.readouterr().out.splitlines() if row.startswith("| e.gms")]
    assert len(lines) == 2
    assert "| 3 | yes | 25 x 256, 0, 12, 6 up to 8 | same | -0.5" in lines[0]
    assert "| 1 | one | 5 x 17, 0, 8, 1 up to 3 | 6 x 17, 0, 8, 1 up to 3 | -1.5" in lines[1]


def test_sizes_alone(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sparsepop_sizes", str(folder / "e.gms"), "--no-solve"]) == 0
    assert "| 1 | yes | 5 x 17, 0, 8, 1 up to 3 |  | nan |" in capsys.readouterr().out


def test_wrong_input(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "empty").mkdir()
    assert main(["sparsepop_sizes", str(folder / "empty")]) == 2
    assert "found no .gms files" in capsys.readouterr().err
    (folder / "reference.csv").write_text("problem,relaxOrder\n")
    table = str(folder / "reference.csv")
    assert main(["sparsepop_sizes", str(folder), "--reference", table]) == 2
    assert "reference.csv: found no column 'SDPobjValue'" in capsys.readouterr().err
