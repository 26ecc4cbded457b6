"""The table of plain relaxations beside SparsePOP's."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.__main__ import main
from benchmarks.tables.published import published

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


# ---- published times --------------------------------------------------------------------------


def test_published_times_stand_beside_ours(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """ex3_1_2 is listed at order 2 with 0.1 s; the file here is another problem, minimum -1/2."""
    (folder / "Bex3_1_2.gms").write_text(GMS)
    assert main(["sparsepop_times", str(folder), "--names", "ex3_1_2", "--repeat", "1"]) == 0
    out = capsys.readouterr().out
    [line] = [row for row in out.splitlines() if row.startswith("| ex3_1_2")]
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells[:6] == ["ex3_1_2", "5", "2", "yes", "0.1", "7.0e-11"]
    proved, attained = float(cells[7]), float(cells[8])
    assert -0.5 - 1e-5 < proved <= -0.5 <= attained < -0.5 + 1e-5
    assert "geometric mean" in out


def test_published_rows_are_those_of_the_guide() -> None:
    """Some rows of tables 2 and 3 of the user guide, SeDuMi and fmincon together."""
    rows = {(row.name, row.n, row.order): row for row in published()}
    assert len(rows) == 41
    assert rows["ex5_2_5", 32, 2].seconds == pytest.approx(10551.2)
    assert rows["ex5_3_2", 22, 3].seconds == pytest.approx(35536.0)
    assert rows["RosenbrockLS", 10000, 2].seconds == 48.8
    assert rows["ex9_2_1", 10, 2].dense
    assert rows["ex9_2_1", 10, 2].param == {"relaxOrder": 2, "sparseSW": 0, "complementaritySW": 1}


def test_published_problems_that_are_missing(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sparsepop_times", str(folder), "--names", "ex9_2_8"]) == 2
    assert "found no problem of these names" in capsys.readouterr().err
    assert main(["sparsepop_times", str(folder / "nowhere")]) == 2
    assert "expected one of .gms files" in capsys.readouterr().err
