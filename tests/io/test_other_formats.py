"""Files of linear and quadratic programs, of AMPL, SCIP and QPLIB.

A problem that was read is evaluated at points, beside the formulas by hand.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.algebra.polynomial import Kind
from sparsepop_py.io.other_software import scip_

SCIP = "SCIP is the optional extra scip"


@pytest.fixture
def scip() -> None:
    pytest.importorskip("pyscipopt", reason=SCIP)


MPS = """NAME test
OBJSENSE
    MAX
ROWS
 N obj
 L c1
 G c2
 E c3
COLUMNS
 x obj 1 c1 1
 x c2 1
 y obj 1 c1 2
 y c2 -1e-10
 y c3 1
 MARKER 'MARKER' 'INTORG'
 k c3 1
 MARKER 'MARKER' 'INTEND'
RHS
 RHS c1 5 c2 1
 RHS obj -7
RANGES
 RNG c2 2
BOUNDS
 FR BND x
 UP BND y 8
 LO BND k 2
 UP BND k 7
QUADOBJ
 x x -2
 x y 1
 y y -4
ENDATA
"""
LP = """Maximize
 obj: x + y + 7 + [ -2 x^2 + 2 x * y - 4 y^2 ] / 2
Subject To
 c1: x + 2 y <= 5
 low: x - 1e-10 y >= 1
 high: x - 1e-10 y <= 3
 c3: y + k = 0
Bounds
 x free
 y <= 8
 2 <= k <= 7
General
 k
End
"""
QPLIB = """! a comment
test
QGL
maximize
3  # variables
4  # constraints
3
1 1 -2
2 1 1
2 2 -4
0.0
2
1 1.0
2 1
7 # constant
8
1 1 1
1 2 2
2 1 1
2 2 -1e-10
3 1 1
3 2 -1e-10
4 2 1
4 3 1
1e20
-1e20
2
2 1
4 0
1e20
3
1 5
3 3
4 0
0
2
1 -1e20
3 2
1e20
2
2 8
3 7
0
1
3 1
0
0
0
0
0
0
3
1 x
2 y
3 k
0
"""


def violations(problem: sp.Problem, x: list[float]) -> list[float]:
    """Least values of rows and bounds, without those of bits."""
    rows = [
        -abs(row.polynomial(x)) if row.kind is Kind.ZERO else row.polynomial(x)
        for row in problem.constraints
    ]
    ends = np.concatenate([x - problem.lower, problem.upper - x])
    return [*rows, *ends[np.isfinite(ends)]]


def with_bits(problem: sp.Problem, point: dict[str, float]) -> list[float]:
    """Complete the values of given variables by the bits of the integer k."""
    steps = int(point["k"] - problem.lower[problem.names.index("k")])
    bits = {f"k_bit{i}": float((steps >> i) & 1) for i in range(8)}
    return [{**bits, **point}[name] for name in problem.names]


@pytest.mark.parametrize(("ending", "text"), [("mps", MPS), ("lp", LP), ("qplib", QPLIB)])
def test_linear_rows_and_a_quadratic_objective(ending: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / f"test.{ending}"
    path.write_text(text)
    problem = sp.read(path)
    assert problem.sense == "max"
    assert problem.names[:3] == ("x", "y", "k")
    for x, y, k in itertools.product((-1.5, 1.0, 2.5), (-2.0, 0.0, 1.0), (2, 3, 6)):
        point = with_bits(problem, {"x": x, "y": y, "k": k})
        value = x + y + 7 + (-2 * x * x + 2 * x * y - 4 * y * y) / 2
        assert -problem.objective(point) == pytest.approx(value, abs=1e-12)
        short = [
            5 - x - 2 * y,
            x - 1e-10 * y - 1,
            3 - x + 1e-10 * y,
            -abs(y + k),
            y,
        ]
        assert min(0, *violations(problem, point)) == min(0, *short)
    assert any((abs(row.polynomial.coefficients) == 1e-10).any() for row in problem.constraints)
    bad = [1.0, 1.0, 2.5, *[0.0] * (problem.dimension - 3)]
    assert problem.violation(bad) >= 0.5  # 2.5 is no integer


def test_what_cannot_be_read(tmp_path: Path) -> None:
    path = tmp_path / "wrong.lp"
    path.write_text("Minimize\n obj: x\nSubject To\n c: x >= 1\nBounds\n x <= 5\nSemi\n x\nEnd\n")
    with pytest.raises(sp.FormatError, match="wrong.lp: found the semi-continuous variable 'x'"):
        sp.read(path)
    for ending in ("lp", "mps", "qplib", "nl"):
        with pytest.raises((sp.FormatError, sp.SolverNotFound)):
            sp.read(tmp_path / f"absent.{ending}")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("QGL", "QGX", "test.qplib:3: found 'QGX', expected three letters"),
        ("maximize", "best", "test.qplib:4: found 'best', expected minimize or maximize"),
        ("2 1 1\n2 2 -4", "2 4 1\n2 2 -4", "test.qplib:9: found '2 4 1', expected indices"),
        ("7 # constant", "seven", "found 'seven', expected the constant"),
        ("1e20\n2\n2 8\n3 7\n0\n1\n3 1", "", "expected"),
    ],
)
def test_malformed_qplib(old: str, new: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "test.qplib"
    assert old in QPLIB
    path.write_text(QPLIB.replace(old, new))
    with pytest.raises(sp.FormatError, match=message):
        sp.read(path)


def test_a_box_constrained_qplib(tmp_path: Path) -> None:
    """min -x1 x2 / 1 + x1 over [0, 1]^2 with binaries: -0 at most; by enumeration 0 and 1."""
    path = tmp_path / "box.qplib"
    path.write_text("b\nQBN\nminimize\n2\n1\n2 1 -3\n1\n1\n2 -2\n0\n1e30\n0\n0\n0\n0\n0\n0\n")
    problem = sp.read(path)
    for x1, x2 in itertools.product((0.0, 1.0), repeat=2):
        assert problem.objective([x1, x2]) == -3 * x1 * x2 + x1 - 2 * x2
        assert problem.violation([x1, x2]) == 0
    assert problem.violation([0.5, 1.0]) == 0.25
    assert sp.solve(problem, sp.Options(order=1)).upper_bound == -4


def test_names_of_a_qplib_file_without_rows(tmp_path: Path) -> None:
    """The format leaves out the rows' multipliers where there are no rows (GALAHAD's note [1])."""
    path = tmp_path / "box.qplib"
    start = "b\nLCB\nminimize\n2\n1\n0\n0\n1e30\n0\n0\n4\n0\n"  # up to the bounds
    for points in ("0\n0\n0\n0\n", "0.5\n1\n2 1\n0\n0\n"):  # of the variables and of bounds
        path.write_text(start + points + "2\n1 flow\n2 heat\n0\n")
        assert sp.read(path).names == ("flow", "heat")


# ---- SCIP -------------------------------------------------------------------------------

PIP = """Minimize
 obj: z
Subject To
 cost: z - x^4 + 3 x^2 * y - 0.25 y >= 2
 cubic: x^3 + 1.5 x * y^2 - k >= -4
 disc: x^2 + y^2 <= 4
 low: x - y >= -1
 high: x - y <= 1
 eq: x * y + k = 3
Bounds
 -2 <= x <= 2
 -2 <= y <= 2
 z free
 -1 <= k <= 6
Generals
 k
End
"""


def check_pip(problem: sp.Problem) -> None:
    assert set(problem.names[:3]) == {"x", "y", "k"}
    for x, y, k in itertools.product((-1.0, 0.5, 1.75), (-1.5, 0.0, 1.0), (-1, 2, 6)):
        point = with_bits(problem, {"x": x, "y": y, "k": k})
        value = 2 + x**4 - 3 * x * x * y + 0.25 * y
        assert problem.objective(point) == pytest.approx(value, abs=1e-12)
        short = [
            x**3 + 1.5 * x * y * y - k + 4,
            4 - x * x - y * y,
            1 - abs(x - y),
            -abs(x * y + k - 3),
        ]
        assert min(0, *violations(problem, point)) == pytest.approx(min(0, *short), abs=1e-12)


@pytest.mark.usefixtures("scip")
def test_polynomial_rows_of_a_pip_file(tmp_path: Path) -> None:
    path = tmp_path / "rows.pip"
    path.write_text(PIP)
    check_pip(sp.read(path))


@pytest.mark.usefixtures("scip")
def test_quadratic_rows_of_lp_and_mps_files(tmp_path: Path) -> None:
    rows = "Minimize\n obj: x + y\nSubject To\n c: x + y >= -3\n q: [ x^2 + y^2 ] <= 1\n"
    path = tmp_path / "disc.lp"
    path.write_text(rows + "Bounds\n x free\n y free\nEnd\n")
    result = sp.solve(sp.read(path), sp.Options(order=1))
    assert result.lower_bound == pytest.approx(-(2**0.5), abs=1e-6)


@pytest.fixture
def written(scip: None, tmp_path: Path) -> Iterator[Callable[[Any], sp.Problem]]:
    def through(model: Any) -> sp.Problem:
        path = tmp_path / "model.nl"
        model.write(str(path), io_options={"symbolic_solver_labels": True})
        return sp.read(path)

    yield through


def test_files_of_ampl_that_pyomo_writes(written: Callable[[Any], sp.Problem]) -> None:
    pyo = pytest.importorskip("pyomo.environ", reason="Pyomo is the optional extra pyomo")
    model = pyo.ConcreteModel()
    model.x, model.y = pyo.Var(bounds=(-2, 2)), pyo.Var(bounds=(-2, 2))
    model.k = pyo.Var(bounds=(-1, 6), domain=pyo.Integers)
    x, y, k = model.x, model.y, model.k
    model.cost = pyo.Objective(expr=2 + x**4 - 3 * x**2 * y + 0.25 * y)
    model.cubic = pyo.Constraint(expr=x**3 + 1.5 * x * y**2 - k >= -4)
    model.disc = pyo.Constraint(expr=x**2 + y**2 <= 4)
    model.band = pyo.Constraint(expr=pyo.inequality(-1, x - y, 1))
    model.eq = pyo.Constraint(expr=x * y + k == 3)
    check_pip(written(model))
    model.wave = pyo.Constraint(expr=pyo.exp(x) <= 3)
    with pytest.raises(sp.FormatError, match="expected polynomial rows"):
        written(model)


def test_constants_inside_products_of_files_of_ampl_are_kept(
    written: Callable[[Any], sp.Problem],
) -> None:
    """SCIP moves them to the other side where it writes a quadratic row."""
    pyo = pytest.importorskip("pyomo.environ", reason="Pyomo is the optional extra pyomo")
    model = pyo.ConcreteModel()
    model.x, model.y = pyo.Var(bounds=(0, 2)), pyo.Var(bounds=(-3, 1))
    model.cost = pyo.Objective(expr=(model.x - 1) ** 2 + (model.y + 2) ** 2 + 0.5)
    assert str(written(model).objective) == "5.5 - 2*x + 4*y + x^2 + y^2"
    model.cost.sense = pyo.maximize
    assert str(written(model).objective) == "-5.5 + 2*x - 4*y - x^2 - y^2"


def test_cubic_rows_keep_all_digits_and_rows_without_terms_stay(
    written: Callable[[Any], sp.Problem],
) -> None:
    """SCIP writes 15 digits; the end 1/3 has 16 and more."""
    pyo = pytest.importorskip("pyomo.environ", reason="Pyomo is the optional extra pyomo")
    model = pyo.ConcreteModel()
    model.x, model.y = pyo.Var(bounds=(-1, 2)), pyo.Var(bounds=(0, 2))
    model.cost = pyo.Objective(expr=model.x * model.y)
    model.empty = pyo.Constraint(expr=model.y - model.y <= 4.5)
    model.cubic = pyo.Constraint(expr=model.x**2 * model.y <= 1 / 3)
    cubic, empty = sorted((row.polynomial for row in written(model).constraints), key=str)
    assert cubic([0.0, 0.0]) == 1 / 3 and cubic([1.0, 2.0]) == 1 / 3 - 2
    assert str(empty) == "4.5"


@pytest.mark.parametrize("power", [2.5, 0.5, 3.0000001])
def test_fractional_powers_of_files_of_ampl_are_refused(
    written: Callable[[Any], sp.Problem], power: float
) -> None:
    """SCIP writes x^2.5, which is not x^2 + 0.5."""
    pyo = pytest.importorskip("pyomo.environ", reason="Pyomo is the optional extra pyomo")
    model = pyo.ConcreteModel()
    model.x, model.y = pyo.Var(bounds=(0, 3)), pyo.Var(bounds=(0, 3))
    model.cost = pyo.Objective(expr=-model.x)
    model.row = pyo.Constraint(expr=model.y * model.x**power <= 1)
    with pytest.raises(sp.FormatError, match=re.escape(f"found '^{power}'")):
        written(model)


@pytest.mark.usefixtures("scip")
def test_constants_inside_quadratic_rows_are_kept(tmp_path: Path) -> None:
    """3 - x y / 2 lies between -1 and 1, and is the objective."""
    path = tmp_path / "rows.nl"
    path.write_text(NL)
    problem = sp.read(path)
    assert str(problem.objective) == "3 - 0.5*x0*x1"
    assert [str(row.polynomial) for row in problem.constraints] == [
        "4 - 0.5*x0*x1",
        "-2 + 0.5*x0*x1",
    ]


NL = """g3 1 1 0
 2 1 1 1 0
 1 1
 0 0
 2 2 2
 0 0 0 1
 0 0 0 0 0
 2 2
 0 0
 0 0 0 0 0
C0
o0
o2
n-0.5
o2
v0
v1
n3
O0 0
o0
o2
n-0.5
o2
v0
v1
n3
r
0 -1 1
b
0 -4 4
0 -4 4
k1
1
J0 2
0 0
1 0
G0 2
0 0
1 0
"""


@pytest.mark.usefixtures("scip")
def test_a_file_of_osil(tmp_path: Path) -> None:
    path = tmp_path / "disc.osil"
    path.write_text(OSIL)
    problem = sp.read(path)
    for x, y in itertools.product((-1.0, 0.25, 3.0), repeat=2):
        assert problem.objective([x, y]) == x + 2 * y
        assert violations(problem, [x, y]) == [4 - x * x - 3 * x * y, x + 5, y + 5, 5 - x, 5 - y]


OSIL_CONE = """<cones numberOfCones="1">
<quadraticCone idx="0"><firstIdx>0</firstIdx></quadraticCone></cones>"""
OSIL_EXPRESSION = """<nl idx="0"><square><variable idx="0"/></square></nl>"""
OSIL_EXPRESSIONS = f"""<nonlinearExpressions numberOfNonlinearExpressions="2">
{OSIL_EXPRESSION}{OSIL_EXPRESSION}</nonlinearExpressions>"""
OSIL_QUADRATIC = """<quadraticCoefficients numberOfQuadraticTerms="1">
<qTerm idx="0" idxOne="1" idxTwo="1" coef="1"/></quadraticCoefficients>"""


@pytest.mark.usefixtures("scip")
@pytest.mark.parametrize(
    ("part", "found"),
    [
        (OSIL_CONE, "found <cones>"),
        (OSIL_EXPRESSIONS, "found <nl idx='0'> twice"),
        (OSIL_QUADRATIC, "found <quadraticCoefficients> twice"),
        ("</variables>", "found no XML"),
    ],
)
def test_what_scip_passes_over_in_files_of_osil_is_refused(
    tmp_path: Path, part: str, found: str
) -> None:
    path = tmp_path / "disc.osil"
    path.write_text(OSIL.replace("</instanceData>", f"{part}</instanceData>"))
    with pytest.raises(sp.FormatError, match=re.escape(found)):
        sp.read(path)


OSIL = """<?xml version="1.0" encoding="UTF-8"?>
<osil xmlns="os.optimizationservices.org"><instanceHeader><name>disc</name></instanceHeader>
<instanceData>
<variables numberOfVariables="2">
<var name="x" lb="-5" ub="5"/><var name="y" lb="-5" ub="5"/>
</variables>
<objectives numberOfObjectives="1">
<obj maxOrMin="min" numberOfObjCoef="2"><coef idx="0">1</coef><coef idx="1">2</coef></obj>
</objectives>
<constraints numberOfConstraints="1"><con name="q" ub="4"/></constraints>
<quadraticCoefficients numberOfQuadraticTerms="2">
<qTerm idx="0" idxOne="0" idxTwo="0" coef="1"/><qTerm idx="0" idxOne="0" idxTwo="1" coef="3"/>
</quadraticCoefficients>
</instanceData></osil>
"""


@pytest.mark.usefixtures("scip")
@pytest.mark.parametrize(("weight", "kept"), [(1.0, ("x0",)), (0.5, ("x0",)), (0.1, ("z", "x0"))])
def test_an_objective_row_is_put_in_only_without_rounding(
    weight: float, kept: tuple[str, ...], tmp_path: Path
) -> None:
    """0.1 * 1.5 is no double: min 0.1 z, z >= 1.5 x0 stays a problem in z."""
    text = f"min\n obj: {weight} z\nst\n r: z - 1.5 x0 >= 0\nbounds\n z free\n 1 <= x0 <= 2\nend\n"
    path = tmp_path / "row.pip"
    path.write_text(text)
    problem = sp.read(path)
    assert set(problem.names) == set(kept)
    exact = {
        str(problem.names[word[-1] - 1]): Fraction(value)
        for word, value in zip(
            problem.objective.words.tolist(), problem.objective.coefficients.tolist(), strict=True
        )
    }
    wanted = {"z": Fraction(weight)} if "z" in kept else {"x0": Fraction(weight) * Fraction(1.5)}
    assert exact == wanted


def pip_row(row: str, folder: Path) -> Path:
    """A file of one row in x and y."""
    path = folder / "row.pip"
    path.write_text(
        f"minimize\n obj: x + y\nsubject to\n c: {row}\nbounds\n 0 <= x <= 3\n 0 <= y <= 3\nend\n"
    )
    return path


@pytest.mark.usefixtures("scip")
@pytest.mark.parametrize(
    ("row", "value"),
    [
        ("x^2 + 0.5 >= 1", -0.5),
        ("0.1 + x^2 >= 0.3", 0.1 - 0.3),
        ("x^2 + .5 + y^2 + .25 <= 2", 1.25),
        ("x y - 3 + x = 1", -4.0),
        ("x^2 + 0.1 >= 0", 0.1),
        ("x^3 + 0.5 >= 1", -0.5),
        ("x + 0.5 >= 1", -0.5),
    ],
)
def test_constants_beside_products_are_kept(row: str, value: float, tmp_path: Path) -> None:
    """PySCIPOpt lists the products and linear terms of a quadratic row, and no constant."""
    (found,) = sp.read(pip_row(row, tmp_path)).constraints
    assert found.polynomial([0.0, 0.0]) == pytest.approx(value, abs=1e-15)


@pytest.mark.usefixtures("scip")
def test_the_least_value_over_a_quadratic_row_with_a_constant(tmp_path: Path) -> None:
    """With x^2 + 3 >= 1 in mind x = 0 is feasible, and no bound is above 0."""
    assert sp.solve(sp.read(pip_row("x^2 + 3 >= 1", tmp_path))).lower_bound <= 0.0


@pytest.mark.usefixtures("scip")
@pytest.mark.parametrize(
    "power",
    ["2.5", ".5", "2.", "2.0", "2e1", "3e-1", "-1", " 2.5", "\n 2.5", "2^3", "2 ^3", "12345678901"],
)
def test_powers_that_scip_reads_as_other_ones_are_refused(power: str, tmp_path: Path) -> None:
    """SCIP reads x^2.5 as x^2 + 0.5, x^2e1 as x^20, x^2^3 as x^3."""
    path = pip_row(f"x^{power} + y >= 1", tmp_path)
    with pytest.raises(sp.FormatError, match=r"row\.pip, line 4: found the power '\^"):
        sp.read(path)


@pytest.mark.usefixtures("scip")
def test_comments_hold_no_powers(tmp_path: Path) -> None:
    problem = sp.read(pip_row("x^2 \\ not x^2.5\n + y^3 >= 1", tmp_path))
    assert problem.constraints[0].polynomial([2.0, 3.0]) == 4 + 27 - 1


@pytest.mark.usefixtures("scip")
@pytest.mark.parametrize("row", ["(x + y)^2 >= 1", "2 (x + y) >= 1", "exp(x) >= 1", "(x) >= 1"])
def test_brackets_and_functions_are_no_names(row: str, tmp_path: Path) -> None:
    """SCIP makes new variables of them, such as '(x' and 'y)'."""
    with pytest.raises(sp.FormatError, match="found the variable .*without brackets and functions"):
        sp.read(pip_row(row, tmp_path))


@pytest.mark.usefixtures("scip")
def test_names_may_hold_indices_in_brackets(tmp_path: Path) -> None:
    assert "z(1)" in sp.read(pip_row("x^2 + z(1) >= 1", tmp_path)).names


@pytest.mark.usefixtures("scip")
@pytest.mark.parametrize(
    "row",
    [
        "1 <= x^2",
        "1 >= x\n d: x + y^2 >= 0.5",
        "-3 = - 2 x^2\n x + y >= 2",
        "x >= 0.5 + 1\n d: y^2 >= 1",
        "x^2 + y >= y",
        "1 <= x + y^2 <= 3",
        "1 <= 2",
    ],
)
def test_rows_with_more_than_a_number_on_the_right_are_refused(row: str, tmp_path: Path) -> None:
    """SCIP reads ``1 >= x`` and ``d: x >= 0`` as 1 >= 1 and a row with a variable ``:``."""
    with pytest.raises(sp.FormatError, match=r"row\.pip, line 4: found the row"):
        sp.read(pip_row(row, tmp_path))


@pytest.mark.usefixtures("scip")
@pytest.mark.parametrize("label", ["end", "Bounds", "int", "semi", "sos1", "c"])
def test_words_that_begin_sections_may_be_labels_of_rows(label: str, tmp_path: Path) -> None:
    """SCIP reads the second row as x^3 + y >= 2, and goes on behind such a label."""
    path = pip_row(f"x + y >= 1\n {label}: -3 = - 2 x^2\n x + y >= 2", tmp_path)
    with pytest.raises(sp.FormatError, match=rf"row\.pip, line 5: found the row '{label}: -3"):
        sp.read(path)
    assert len(sp.read(pip_row(f"x >= 1\n {label}: x + y >= 2", tmp_path)).constraints) == 2


@pytest.mark.usefixtures("scip")
@pytest.mark.parametrize("head", ["st:", "s.t", "subjectto", ""])
def test_rows_without_a_section_are_refused(head: str, tmp_path: Path) -> None:
    """SCIP read the objective of such a file for ever."""
    path = tmp_path / "rows.pip"
    path.write_text(f"minimize\n obj: x + y\n{head}\n c: x^2 + y >= 1\nbounds\n x <= 5\nend\n")
    with pytest.raises(sp.FormatError, match="expected 'Subject to'"):
        sp.read(path)
    path.write_text("minimize\n obj: x + y\nbounds\n 1 <= x <= 5\n 2 <= y <= 3\nend\n")
    assert sp.read(path).lower.tolist() == [1.0, 2.0]


@pytest.mark.parametrize("last", ["x1 >= y", "x1 >= 1"])
def test_long_rows_and_many_are_looked_at_in_one_pass(last: str, tmp_path: Path) -> None:
    """Refusing a sum of 5 000 terms took minutes; 10 000 rows copied the file as often."""
    rows = " c: x + y >= 1\n" * 10_000 + " d: " + "2 x1 + 3 y\n + " * 2_500 + last
    text = f"minimize\n obj: x\nsubject to\n{rows}\nend\n"
    if last == "x1 >= 1":
        scip_._check_rows(tmp_path, text)
    else:
        with pytest.raises(sp.FormatError, match="line 10004: found the row 'd: 2 x1"):
            scip_._check_rows(tmp_path, text)


@pytest.mark.usefixtures("scip")
def test_rows_may_follow_each_other_and_go_over_lines(tmp_path: Path) -> None:
    rows = "x^2\n + y >= - 1e0 d: x y^2 =< .5\n 2 x + y\n = 3"
    found = [row.polynomial([2.0, 3.0]) for row in sp.read(pip_row(rows, tmp_path)).constraints]
    assert found == [8.0, -17.5, 4.0]


@pytest.mark.usefixtures("scip")
@pytest.mark.parametrize("part", ["x^2 + 3 x^2", "x^2 + x + 2 x", "x y + y + 2 y", "2 x^2 - 2 x^2"])
@pytest.mark.parametrize("place", ["objective", "row"])
def test_terms_that_come_twice_in_quadratic_rows_are_refused(
    part: str, place: str, tmp_path: Path
) -> None:
    """SCIP tells of 3 x^2 where x^2 + 3 x^2 stands, and of 2 x for x + 2 x beside a square."""
    path = pip_row(f"{part} >= 1" if place == "row" else "x + y >= 1", tmp_path)
    if place == "objective":
        path.write_text(path.read_text().replace("obj: x + y", f"obj: {part}"))
    with pytest.raises(sp.FormatError, match="found several terms of one row in '[xy]' alone"):
        sp.read(path)


@pytest.mark.usefixtures("scip")
@pytest.mark.parametrize(
    ("row", "counts"),
    [
        ("0.12345678901234567 x^3 + 0.98765432109876543 x y^2 + 2 y >= 1", [2]),
        ("0.30000000000000004 x^3 + y >= 1", [1]),  # SCIP writes 0.3
        ("0.123456789012345 x^3 + 0.1 y >= 0.33333333333333331", []),  # no digit is lost
        ("0.12345678901234567 x^2 + 0.98765432109876543 x y >= 0.33333333333333331", []),
        ("0.12345678901234567 x + 3 y >= 0.33333333333333331", []),
    ],
)
def test_rows_that_scip_writes_say_where_digits_are_lost(
    row: str, counts: list[int], tmp_path: Path
) -> None:
    """Numbers of higher degree come with 15 digits, which once was not said."""
    problem = sp.read(pip_row(row, tmp_path))
    assert [record.coefficients for record in problem.rounding] == counts
    assert all(record.place == "constraint 0 (c)" for record in problem.rounding)
    assert ("by an unknown amount" in str(problem)) is bool(counts)


@pytest.mark.usefixtures("scip")
def test_an_objective_that_scip_writes_says_where_digits_are_lost(tmp_path: Path) -> None:
    path = tmp_path / "objective.pip"
    path.write_text(
        "minimize\n obj: 0.12345678901234567 x^3 + y\nsubject to\n c: x + y >= 1\nbounds\n"
        " x <= 5\n y <= 5\nend\n"
    )
    assert [record.place for record in sp.read(path).rounding] == ["objective"]


@pytest.mark.usefixtures("scip")
def test_another_layout_of_what_scip_writes_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Squares that come twice were passed over where no row of SCIP's text was found."""
    text = scip_._text
    monkeypatch.setattr(
        scip_, "_text", lambda model, ending: text(model, ending).replace("[nonlinear]", "[expr]")
    )
    with pytest.raises(sp.FormatError, match="found no row c0 in the .cip text that SCIP"):
        sp.read(pip_row("x^2 + 3 x^2 + y >= 1", tmp_path))


@pytest.mark.usefixtures("scip")
def test_products_that_come_twice_are_added(tmp_path: Path) -> None:
    (row,) = sp.read(pip_row("x y + 2 y x + x^2 + x + y >= 1", tmp_path)).constraints
    assert row.polynomial([2.0, 3.0]) == 3 * 6 + 4 + 5 - 1


@pytest.mark.usefixtures("scip")
@pytest.mark.parametrize("first", ["Minimise", "Maximise", "obj:", "a problem\nminimize"])
@pytest.mark.parametrize(("ending", "row"), [(".pip", "x^3"), (".lp", "x + [ x * y ]")])
def test_words_that_scip_does_not_know_lose_no_objective(
    first: str, ending: str, row: str, tmp_path: Path
) -> None:
    """SCIP passes over everything before a word that it knows: the objective was 0."""
    path = tmp_path / f"sense{ending}"
    path.write_text(f"{first}\n obj: x + y\nsubject to\n c: {row} >= 1\nbounds\n x <= 5\nend\n")
    with pytest.raises(sp.FormatError, match=r"expected Minimize or Maximize|Parser error"):
        sp.read(path)


@pytest.mark.usefixtures("scip")
@pytest.mark.parametrize("ending", [".lp", ".pip"])
def test_a_variable_that_comes_twice_in_a_row_counts_twice(ending: str, tmp_path: Path) -> None:
    """1 x + y + 3 x is 4 x + y, and the least x with y = 0 is a quarter."""
    path = tmp_path / f"twice{ending}"
    path.write_text(
        "minimize\n obj: x + 2 y + 2 x\nsubject to\n c: x + y + 3 x >= 1\n d: x + x <= 6\n"
        "bounds\n x <= 3\n y <= 3\nend\n"
    )
    problem = sp.read(path)
    for x, y in itertools.product((0.0, 1.0, 2.5), repeat=2):
        assert problem.objective([x, y]) == 3 * x + 2 * y
        assert [row.polynomial([x, y]) for row in problem.constraints] == [4 * x + y - 1, 6 - 2 * x]
    assert sp.solve(problem).lower_bound == pytest.approx(0.75, abs=1e-6)


def test_warnings_of_highs_are_errors(tmp_path: Path) -> None:
    """HiGHS ignores the number of a row that has none elsewhere, and says so in a warning."""
    path = tmp_path / "constant.lp"
    path.write_text("minimize\n obj: x\nsubject to\n c: x + 2 >= 1\nend\n")
    with pytest.raises(sp.FormatError, match="a constant on the left-hand side"):
        sp.read(path)


@pytest.mark.parametrize("row", ["x/2 + y >= 1", "2 (x + y) >= 1"])
def test_operators_are_no_names_of_lp_files(row: str, tmp_path: Path) -> None:
    """HiGHS reads ``x/2`` and ``(x`` as names of further variables."""
    path = tmp_path / "names.lp"
    path.write_text(f"minimize\n obj: x + y\nsubject to\n c: {row}\nend\n")
    with pytest.raises(sp.FormatError, match="names.lp: found the variable '.*', expected poly"):
        sp.read(path)


@pytest.mark.parametrize("ending", [".lp", ".pip"])
@pytest.mark.parametrize("name", ["st", "S.T.", "End", "max", "gen", "bound", "bin"])
def test_words_that_begin_sections_are_no_names(name: str, ending: str, tmp_path: Path) -> None:
    """HiGHS dropped the rows before ``st <= 4``, SCIP what follows ``x + end``."""
    if ending == ".pip":
        pytest.importorskip("pyscipopt", reason=SCIP)
    path = tmp_path / f"words{ending}"
    path.write_text(
        f"minimize\n obj: x + {name} + y\nsubject to\n c: x + y >= 1\nbounds\n {name} <= 4\nend\n"
    )
    with pytest.raises(sp.FormatError, match=r"found the variable|inside a line|Parser error"):
        sp.read(path)


@pytest.mark.parametrize("section", ["Binary\n x", "binaries x", "General\n y\nBIN\n y\n x"])
def test_binaries_with_wider_bounds_are_refused(section: str, tmp_path: Path) -> None:
    """HiGHS keeps the bounds and reads an integer from 0 to 5."""
    path = tmp_path / "binary.lp"
    text = "minimize\n obj: x + y\nsubject to\n c: x + y >= 1\nbounds\n x <= 5\n y <= 1\n"
    path.write_text(f"{text}{section}\nend\n")
    with pytest.raises(sp.FormatError, match=r"binary variable 'x' with bounds \[0, 5\]"):
        sp.read(path)
    path.write_text(f"{text.replace(' x <= 5', ' x <= 1')}{section}\nend\n")
    assert "x_bit0" not in sp.read(path).names


@pytest.mark.parametrize(
    ("kind", "infinity", "message"),
    [
        ("0", "1e20", None),
        ("3", "1e20", "found '3', expected kinds 0"),
        ("0", "-1", "found '-1', expected a value of infinity above 0"),
    ],
)
def test_kinds_and_infinity_of_qplib(
    kind: str, infinity: str, message: str | None, tmp_path: Path
) -> None:
    """An unknown kind was continuous, and an infinity of -1 left no end finite."""
    lines = (
        "tiny, QML, minimize, 2, 1, 1, 1 1 2, 0, 1, 2 -3, 5, 2, 1 1 1, 1 2 1, 1e20, 1, 0, 1e20, 0"
    )
    words = lines.split(", ")
    words[14] = infinity
    words += ["0", "0", "4", "0", kind, "0", "0", "0", "0", "0", "0", "0", "0", "0"]
    path = tmp_path / "tiny.qplib"
    path.write_text("\n".join(words))
    if message is None:
        assert sp.read(path).dimension == 2
        return
    with pytest.raises(sp.FormatError, match=message):
        sp.read(path)


TINY = (
    "tiny, QCL, minimize, 2, 1, 1, 1 1 2, 0, 1, 2 -3, 5, 2, 1 1 1, 1 2 1, 1e20, 1, 0, 1e20, 0, 0, "
    "0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0"
)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("-3, 5, 2", "-3, 1_0, 2", "tiny.qplib:11: found '1_0', expected the constant"),
        ("2 -3", "0_2 -3", "found '0_2 -3', expected an index"),
        ("1, 1 1 2", "2, 1 1 2, 1 1 2", "found '1 1 2', expected each product once"),
        ("1, 1 1 2", "2, 2 1 2, 1 2 2", "found '1 2 2', expected each product once"),
        ("1, 2 -3", "2, 2 -3, 2 -4", "found '2 -4', expected one value of objective"),
        ("2, 1 1 1, 1 2 1", "3, 1 1 1, 1 2 1, 1 2 5", "found '1 2 5', expected each entry once"),
        ("minimize, 2", "minimize, 99999999999", "expected the number of variables, from 1 to"),
        ("minimize, 2", "minimize, " + "9" * 5000, "expected the number of variables, from 1 to"),
    ],
)
def test_nothing_of_a_qplib_file_is_passed_over(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    path = tmp_path / "tiny.qplib"
    path.write_text("\n".join(TINY.split(", ")))
    assert sp.read(path).objective([1.0, 2.0]) == 1 - 6 + 5
    assert old in TINY
    path.write_text("\n".join(TINY.replace(old, new, 1).split(", ")))
    with pytest.raises(sp.FormatError, match=message):
        sp.read(path)


def test_lines_behind_a_qplib_file_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "tiny.qplib"
    path.write_text("\n".join([*TINY.split(", "), "7 7"]))
    with pytest.raises(sp.FormatError, match="found '7 7', expected the end of the file"):
        sp.read(path)
