"""MPS files: what they say by hand and by HiGHS, and what is refused by line."""

from __future__ import annotations

import random
from pathlib import Path

import highspy
import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.problem.problem import Problem

ROWS = "NAME t\nROWS\n N obj\n G c\nCOLUMNS\n x obj 1 c 1\n y obj 2 c 3\nRHS\n s c 4\n"
FREE = ROWS.replace(" N obj\n", " N obj\n N other\n")


def read(text: str, folder: Path) -> Problem:
    path = folder / "t.mps"
    path.write_bytes(text.encode())
    found = sp.read(path)
    assert isinstance(found, Problem)
    return found


def shown(text: str, folder: Path) -> str:
    return " | ".join(line.strip() for line in str(read(text, folder)).split("\n"))


C, X, Y = "s.t. c: -4 + x + 3*y >= 0", "0 <= x <= inf", "0 <= y <= inf"


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (ROWS, f"min x + 2*y | {C} | {X} | {Y}"),
        (FREE + " s other 8 obj 7\n", f"min -7 + x + 2*y | {C} | {X} | {Y}"),
        ("\ufeff" + ROWS.replace("\n", "\r\n"), f"min x + 2*y | {C} | {X} | {Y}"),
        (ROWS.replace("\n", "\r").replace(" ", "\t"), f"min x + 2*y | {C} | {X} | {Y}"),
        (ROWS.replace(" s c 4", " c 4"), f"min x + 2*y | {C} | {X} | {Y}"),
        (ROWS.replace("c 3", "c 3.0D+00"), f"min x + 2*y | {C} | {X} | {Y}"),
        (ROWS.replace("ROWS", "OBJSENSE\n MAX\nROWS"), f"min -x - 2*y | {C} | {X} | {Y}"),
        (ROWS + "RANGES\n r c -2\n", f"min x + 2*y | {C} | s.t. c: 6 - x - 3*y >= 0 | {X} | {Y}"),
        (
            ROWS.replace(" G ", " L ") + "RANGES\n c 2\n",
            f"min x + 2*y | s.t. c: -2 + x + 3*y >= 0 | s.t. c: 4 - x - 3*y >= 0 | {X} | {Y}",
        ),
        (
            ROWS.replace(" G ", " E ") + "RANGES\n r c -2\n",
            f"min x + 2*y | s.t. c: -2 + x + 3*y >= 0 | s.t. c: 4 - x - 3*y >= 0 | {X} | {Y}",
        ),
        (ROWS.replace("c 4", "c -1e30"), f"min x + 2*y | {X} | {Y}"),
        (ROWS.replace(" G ", " L ").replace("c 4", "c 1e20"), f"min x + 2*y | {X} | {Y}"),
        (ROWS + "BOUNDS\n MI b x\n UP b x -3\n", f"min x + 2*y | {C} | -inf <= x <= -3 | {Y}"),
        (ROWS + "BOUNDS\n UP x 5\n FX y 2\n", f"min x + 2*y | {C} | 0 <= x <= 5 | 2 <= y <= 2"),
        (ROWS + "BOUNDS\n FR b x\n UP b y inf\n", f"min x + 2*y | {C} | {Y}"),
        (
            ROWS + "QUADOBJ\n x x 2\n y x 1\n y y 4\n",
            f"min x + 2*y + x^2 + x*y + 2*y^2 | {C} | {X} | {Y}",
        ),
        (
            ROWS + "QMATRIX\n x x 2\n x y 1\n y x 1\n",
            f"min x + 2*y + x^2 + x*y | {C} | {X} | {Y}",
        ),
        (
            ROWS + "QCMATRIX c\n x x 2\n x y 1\n y x 1\n",
            f"min x + 2*y | {C[:-5]} + 2*x^2 + 2*x*y >= 0 | {X} | {Y}",
        ),
        (ROWS.replace("c 3", "c 1e-13"), f"min x + 2*y | {C.replace('3*', '1e-13*')} | {X} | {Y}"),
    ],
)
def test_what_files_say(text: str, found: str, tmp_path: Path) -> None:
    assert shown(text + ("ENDATA\r" if "\r" in text else "ENDATA\n"), tmp_path) == found


MARKED = " M 'MARKER' 'INTORG'\n x obj 1 c 1\n M 'MARKER' 'INTEND'\n"


def test_integers_between_markers_are_binary_without_bounds(tmp_path: Path) -> None:
    text = ROWS.replace(" x obj 1 c 1\n", MARKED)
    assert "binary x: -x + x^2 == 0" in shown(text + "ENDATA\n", tmp_path)
    found = read(text + "BOUNDS\n UP b x 2\nENDATA\n", tmp_path)
    assert found.names == ("x", "y", "x_bit0", "x_bit1")
    assert "binary y" in shown(ROWS + "BOUNDS\n BV b y\nENDATA\n", tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("c 3", "c 3,5", ":7: found '3,5', expected a number"),
        ("c 3", "c 3x", "found '3x', expected a number"),
        ("c 3", "c 1_0", "found '1_0', expected a number"),
        ("c 3", "c nan", "found 'nan', expected a number"),
        ("c 3", "c 1e999", "found '1e999', expected a number"),
        ("c 3", "c", "found 'y obj 2 c', expected a column"),
        ("c 3", "c 3 c 4", "found 'y obj 2 c 3 c 4', expected a column"),
        ("c 3", "d 3", "found the row 'd', expected one of ROWS"),
        (" y obj", " x d 1\n y obj", ":7: found the row 'd'"),
        ("c 3\n", "c 3\n x obj 1\n", "found the column 'x' again"),
        ("c 3\n", "c 3\n y c 1\n", "found a second entry of 'y' in 'c'"),
        (" G c\n", " G c\n L c\n", "found the row 'c' twice"),
        (" G c\n", " G c one\n", "found 'G c one', expected N, E, L or G"),
        (" G c\n", " X c\n", "found 'X c', expected N, E, L or G"),
        ("ROWS", "OBJNAME\n c\nROWS", "found the section 'OBJNAME'"),
        ("ROWS", "OBJSENSE\n BEST\nROWS", "found 'BEST', expected MAX or MIN"),
        (" G c\n", "LAZYCONS\n G c\n", "found the section 'LAZYCONS'"),
        ("s c 4\n", "s c 4\n s c 5\n", "found a second entry of 'c' in RHS"),
        ("s c 4\n", "s c 4\n t obj 5\n", "found a second set 't' in RHS, expected 's' alone"),
        ("s c 4\n", "s c 1e30\n", "found 1e\\+30 of 'c', expected a finite number"),
        ("s c 4\n", "s c 4\nRANGES\n r obj 1\n", "found a range of the free row 'obj'"),
        ("s c 4\n", "s c 4\nBOUNDS\n UP b x -3\n", "no lower one"),
        ("s c 4\n", "s c 4\nBOUNDS\n UP b z 3\n", "found 'z 3', expected a column"),
        ("s c 4\n", "s c 4\nBOUNDS\n UP b x\n", "found 'b x', expected a column"),
        ("s c 4\n", "s c 4\nBOUNDS\n UP b x 3\n FX b x 4\n", "found a second upper bound of 'x'"),
        ("s c 4\n", "s c 4\nBOUNDS\n UP b x 3\n UP d y 4\n", "found a second set 'd'"),
        ("s c 4\n", "s c 4\nBOUNDS\n SC b x 3\n", "found the bound 'SC'"),
        ("s c 4\n", "s c 4\nBOUNDS\n LO b x inf\n", "found the bound 'inf', expected a finite"),
        ("s c 4\n", "s c 4\nRHS\n s obj 4\n", "found a second section RHS"),
        ("s c 4\n", "s c 4\nQUADOBJ\n x y 1\n y x 1\n", "found a second entry of 'y' and 'x'"),
        ("s c 4\n", "s c 4\nQMATRIX\n x y 1\n", "without its mirror image"),
        ("s c 4\n", "s c 4\nQCMATRIX c\n x y 1\n", "without its mirror image"),
        ("s c 4\n", "s c 4\nQCMATRIX obj\n x x 1\n", "expected a row that is not free"),
        ("s c 4\n", "s c 4\nQSECTION c\n x x 1\n", "expected the objective"),
        ("s c 4\n", "s c 4\nQUADOBJ\n x x 1\nQMATRIX\n y y 1\n", "several sections with products"),
        ("s c 4\n", "s c 4\nQUADOBJ\n x z 1\n", "found 'x z 1', expected two columns"),
        ("s c 4\n", "s c 4\n RANGES\n", "found 'RANGES', expected one or two rows"),
        ("s c 4\n", "s c 4\nENDATA\nBOUNDS\n", "found 'BOUNDS' after ENDATA"),
        (" N obj\n", "", "found the row 'obj', expected one of ROWS"),
        (" x obj 1 c 1\n", MARKED.rpartition(" M")[0] + " M 'MARKER' 'SOSORG'\n", "'SOSORG'"),
        (
            "s c 4\n",
            "s c 4\nBOUNDS\n LI b x 0\n",
            "x: found an integer variable with bounds 0, inf",
        ),
    ],
)
def test_what_is_refused(old: str, new: str, message: str, tmp_path: Path) -> None:
    assert old in ROWS
    with pytest.raises(sp.SparsePOPError, match=r"t\.mps.*" + message):
        read(ROWS.replace(old, new) + "ENDATA\n", tmp_path)


def test_files_without_an_end_are_refused(tmp_path: Path) -> None:
    with pytest.raises(sp.FormatError, match="found the end of the file, expected ENDATA"):
        read(ROWS, tmp_path)


def test_ends_of_ranges_are_rounded_once_and_said_so(tmp_path: Path) -> None:
    """0.1 + 0.2 is no double: the end is rounded in the problem, and the problem says so."""
    text = ROWS.replace("s c 4", "s c 0.1") + "RANGES\n r c 0.2\nENDATA\n"
    found = read(text, tmp_path)
    assert found.constraints[1].polynomial.coefficients[0] == 0.1 + 0.2
    assert found.rounding


def random_file(seed: int) -> str:
    """Write a file that HiGHS reads without a warning."""
    draw = random.Random(seed)
    n, m = draw.randint(1, 6), draw.randint(1, 8)
    kinds = [draw.choice("ELG") for _ in range(m)]
    lines = ["NAME t", "ROWS", " N obj", *(f" {kind} r{i}" for i, kind in enumerate(kinds))]
    lines += ["COLUMNS"]
    for v in range(n):
        lines.append(f"\tx{v}  obj {draw.gauss(0, 9)!r}")
        lines += [f" x{v} r{i} {draw.gauss(0, 9)!r}" for i in range(m) if draw.random() < 0.6]
    lines += ["RHS", f" s obj {draw.gauss(0, 9)!r}"]
    lines += [f" s r{i} {draw.gauss(0, 9)!r}" for i in range(m) if draw.random() < 0.8]
    lines += ["RANGES"]
    lines += [f" r r{i} {draw.gauss(0, 9)!r}" for i in range(m) if draw.random() < 0.4]
    lines += ["BOUNDS"]
    for v in range(n):
        low, width = draw.gauss(0, 9), draw.random()
        both = (f" LO b x{v} {low!r}", f" UP b x{v} {low + width!r}")
        lines += draw.choice([(), both, (f" FR b x{v}",), (f" FX b x{v} {low!r}",), both[:1]])
    pairs = [(i, j) for i in range(n) for j in range(i, n) if draw.random() < 0.3]
    lines += ["QUADOBJ", *(f" x{i} x{j} {draw.gauss(0, 9)!r}" for i, j in pairs)] if pairs else []
    return "\n".join([*lines, "ENDATA", ""])


@pytest.mark.parametrize("seed", range(12))
def test_random_files_hold_what_highs_reads(seed: int, tmp_path: Path) -> None:
    """Objective, rows and bounds at random points, by HiGHS's own numbers."""
    found = read(random_file(seed), tmp_path)
    oracle = highspy.Highs()
    oracle.setOptionValue("output_flag", False)
    assert oracle.readModel(str(tmp_path / "t.mps")) == highspy.HighsStatus.kOk
    model = oracle.getModel()
    lp, products = model.lp_, model.hessian_
    assert (found.lower == np.array(lp.col_lower_)).all()
    assert (found.upper == np.array(lp.col_upper_)).all()
    a = np.zeros((lp.num_row_, lp.num_col_))
    q = np.zeros((lp.num_col_, lp.num_col_))
    for matrix, target in ((lp.a_matrix_, a), (products, q)):
        for v in range(lp.num_col_ if len(matrix.start_) > 1 else 0):
            for k in range(matrix.start_[v], matrix.start_[v + 1]):
                target[matrix.index_[k], v] = matrix.value_[k]
    q = q + np.tril(q, -1).T
    for x in np.random.default_rng(seed).normal(size=(5, lp.num_col_)):
        value = lp.offset_ + np.dot(lp.col_cost_, x) + x @ q @ x / 2
        assert found.objective(x) == pytest.approx(value, rel=1e-12, abs=1e-11)
        short = []
        for body, low, high in zip(a @ x, lp.row_lower_, lp.row_upper_, strict=True):
            ends = [body - low] if np.isfinite(low) else []
            short += ends if low == high else [*ends, *([high - body] if high < np.inf else [])]
        rows = [row.polynomial(x) for row in found.constraints]
        assert rows == pytest.approx(short, rel=1e-12, abs=1e-11)
