"""Cones and matrices as constraints: how they are made, checked, printed and read."""

import pickle
from fractions import Fraction

import numpy as np
import pytest
import scipy.io
import sympy
from hypothesis import example, given, settings
from hypothesis import strategies as st
from random_matrices import matrix_at, random_problem

import sparsepop_py as sp
from sparsepop_py import Kind, ProblemError
from sparsepop_py.algebra.matrix_constraints import cone

SEEDS = st.integers(0, 2**32 - 1)
x, y = sp.variables(2)


def test_entries_and_what_follows_from_them():
    row = sp.second_order(2, x, y, name="disc")
    assert (row.kind, row.name, row.side) == (Kind.SECOND_ORDER, "disc", 3)
    assert str(row) == "disc: second_order(2, x1, x2)"
    assert str(row.polynomial) == "2"
    same = sp.second_order([2, x, y])
    assert list(map(str, same.entries)) == ["2", "x1", "x2"]
    matrix = sp.psd([[1 + x, x * y], [x * y, 3 - y]])
    assert (matrix.kind, matrix.side, matrix.degree) == (Kind.PSD, 2, 2)
    assert str(matrix.polynomial) == "4 + x1 - x2"
    assert str(matrix) == "psd([[1 + x1, x1*x2], [x1*x2, 3 - x2]])"


def test_one_entry_is_an_inequality():
    for row in (sp.second_order(x - 1), sp.psd([[x - 1]])):
        assert (row.kind, row.entries, str(row)) == (Kind.NONNEGATIVE, (), "-1 + x1 >= 0")


def test_arrays_and_generators_of_numbers_count():
    table = np.array([[1, x], [x, np.float64(2)]], object)
    assert str(sp.psd(table)) == "psd([[1, x1], [x1, 2]])"
    assert str(sp.psd(((Fraction(1, 2), x), (x, 1)))) == "psd([[0.5, x1], [x1, 1]])"


def test_a_trace_that_rounds_is_not_used():
    """1 + x and 1e-17 + y: the double nearest to 1 + 1e-17 is 1, which would cut points off."""
    row = sp.psd([[1 + x, 0], [0, 1e-17 + y]])
    assert str(row.polynomial) == "1 + x1"
    exact = sp.psd([[0.5 + x, 0], [0, 0.25 - x]])
    assert str(exact.polynomial) == "0.75"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: sp.psd([[1, x], [y, 1]]), "psd: found x2 and x1 in rows 1 and 0"),
        (lambda: sp.psd([[1, x], [2, 1]]), "expected a symmetric matrix"),
        (lambda: sp.psd([[1, x]]), "psd: found 2 entries in row 0, expected 1"),
        (lambda: sp.psd([]), "psd: found an empty matrix"),
        (lambda: sp.psd(x), "psd: found Polynomial, expected a square matrix"),
        (lambda: sp.psd([x, y]), "psd: found list, expected a square matrix"),
        (lambda: sp.psd([[1, 2], [2, 5]]), "psd: found numbers alone"),
        (lambda: sp.psd([["x", 1], [1, x]]), "psd: found str among the entries"),
        (lambda: sp.psd([[1, 1j * 2], [1j * 2, x]]), "psd: found complex among the entries"),
        (lambda: sp.second_order(), "second_order: found no entries"),
        (lambda: sp.second_order(1, 2), "second_order: found numbers alone"),
        (lambda: sp.second_order(1, x >= 0), "second_order: found Constraint among the entries"),
        (lambda: sp.second_order(np.inf, x), "coefficients: found inf"),
        (lambda: sp.second_order(x, sp.variables(3)[0]), "2 and 3 variables"),
        (lambda: sp.second_order(x, sympy.Symbol("z")), "sympy expressions and Polynomials"),
        (lambda: sp.Constraint(x, Kind.PSD), "entries: found 0, expected those of a matrix"),
        (lambda: sp.Constraint(x, Kind.PSD, "", (x, x)), "entries: found 2, expected"),
        (lambda: sp.Constraint(x, Kind.PSD, "", (x,) * 4), "expected a lower triangle"),
        (lambda: sp.Constraint(x, Kind.ZERO, "", (x,)), "entries: found 1 for ZERO"),
    ],
)
def test_malformed(make, message):
    with pytest.raises(ProblemError) as caught:
        make()
    assert message in str(caught.value)


def test_a_problem_checks_the_variables_of_all_entries():
    z = sp.variables(3)[2]
    row = cone(Kind.SECOND_ORDER, [z, z])
    with pytest.raises(ProblemError, match=r"constraints\[0\]: found 3 variables, expected 2"):
        sp.Problem(x, row)


def test_sympy():
    a, b = sympy.symbols("a b")
    rows = [sp.psd(sympy.Matrix([[1, a], [a, b]])), sp.second_order(2, a, sympy.Rational(1, 2) * b)]
    problem = sp.Problem(a + b, rows)
    u, v = sp.variables(2, ["a", "b"])
    other = sp.Problem(u + v, [sp.psd([[1, u], [u, v]]), sp.second_order(2, u, 0.5 * v)])
    assert problem.names == ("a", "b")
    assert problem.fingerprint == other.fingerprint
    with pytest.raises(ProblemError, match=r"sympy symbols b are not among the names"):
        sp.Problem(a, rows, names=["a"])
    with pytest.raises(ProblemError, match="mixed"):
        sp.Problem(x, rows)
    with pytest.raises(ProblemError, match=r"constraints\[0\]: found .*expected a polynomial"):
        sp.Problem(a, sp.second_order(1, sympy.sin(a)))


def test_every_entry_counts_in_the_fingerprint():
    base = sp.Problem(x, [sp.psd([[1, x], [x, 1]])])
    others = [
        sp.Problem(x, [sp.psd([[1, y], [y, 1]])]),
        sp.Problem(x, [sp.psd([[1, x], [x, np.nextafter(1, 2)]])]),
        sp.Problem(x, [sp.second_order(1, x, 1)]),
        sp.Problem(x, [sp.Constraint(base.constraints[0].polynomial, Kind.NONNEGATIVE)]),
    ]
    assert len({p.fingerprint for p in (base, *others)}) == 5
    assert pickle.loads(pickle.dumps(base)).fingerprint == base.fingerprint
    assert sp.Problem(x, [sp.psd([[1, x], [x, 1]])]).fingerprint == base.fingerprint


def test_what_a_problem_says_of_itself():
    problem = sp.Problem(x, [sp.psd([[1, x**3], [x**3, 1]]), x >= y])
    assert problem.degree == 3
    assert "psd([[1, x1^3], [x1^3, 1]])" in str(problem)
    assert repr(problem) == (
        "<Problem: 2 variables, 1 inequalities, 0 equalities, 1 matrices, degree 3>"
    )
    with pytest.raises(ProblemError, match="no truth value"):
        bool(problem.constraints[0])


@example(129269)  # a trace more negative than the least eigenvalue
@settings(max_examples=40, deadline=None)
@given(SEEDS)
def test_violation_is_the_least_eigenvalue(seed):
    problem = random_problem(seed)
    rng = np.random.default_rng(seed)
    for point in rng.uniform(-1, 1, (4, 2)):
        values = [p(point) for p in problem.constraints[0].entries]
        least = np.linalg.eigvalsh(np.array(matrix_at(problem.constraints[0], values), float))[0]
        assert problem.violation(point) == pytest.approx(max(0.0, -least), abs=1e-12)
    outside = np.array([3.0, 0.0])
    assert problem.violation(outside) >= 2.0


def test_the_variables_of_a_matrix_share_a_clique():
    v = sp.variables(5)
    rows = [sp.psd([[1, v[0]], [v[0], v[3]]]), sp.second_order(v[1], v[2], 1)]
    cliques = sp.find_cliques(sp.Problem(v[4], rows))
    assert sorted(cliques.members) == [(0, 3), (1, 2), (4,)]
    assert [cliques.members[k] for k in cliques.home] == [(0, 3), (1, 2)]


# ---- structs and files -------------------------------------------------------------------------


def struct(cone_, size, supports, coef):
    table = np.array(supports, float)
    return {
        "typeCone": cone_,
        "sizeCone": size,
        "dimVar": table.shape[1],
        "degree": int(table.sum(axis=1).max()),
        "noTerms": len(supports),
        "supports": table,
        "coef": np.array(coef, float),
    }


def test_structs_of_cones_and_matrices():
    """SparsePOP 3.03 user guide, section on the SparsePOP format: coef row by row of supports."""
    line = struct(1, 1, [[1, 0], [0, 1]], [[1], [1]])
    ball = struct(2, 3, [[0, 0], [1, 0], [0, 1]], [[2, 0, 0], [0, 1, 0], [0, 0, 1]])
    free = [1e10, 1e10]
    problem = sp.from_structs(line, [ball], [-1e10, -1e10], free)
    assert problem.fingerprint == sp.Problem(x + y, [sp.second_order(2, x, y)]).fingerprint
    matrix = struct(3, 2, [[0, 0], [1, 1], [2, 0]], [[1, 0, 0, 3], [0, 5, 5, 0], [0, 0, 0, 1]])
    problem = sp.from_structs(line, [matrix], [-1e10, -1e10], free)
    expected = sp.psd([[1, 5 * x * y], [5 * x * y, 3 + x**2]])
    assert problem.fingerprint == sp.Problem(x + y, [expected]).fingerprint
    back = sp.to_structs(problem)[1][0]
    for key in ("typeCone", "sizeCone", "dimVar", "degree", "noTerms"):
        assert back[key] == matrix[key]
    order = [back["supports"].tolist().index(row) for row in matrix["supports"].tolist()]
    assert back["coef"][order].tolist() == matrix["coef"].tolist()


def test_structs_through_a_mat_file(tmp_path):
    """One term with several columns becomes a vector by loadmat(squeeze_me=True)."""
    rows = [sp.psd([[x, 2 * x], [2 * x, 5 * x]]), sp.second_order(3 * y, 2 * y)]
    problem = sp.Problem(x + y, rows)
    objective, structs, lbd, ubd = sp.to_structs(problem)
    cell = np.empty((1, 2), object)
    cell[0, :] = structs
    path = tmp_path / "cones.mat"
    scipy.io.savemat(path, {"f": objective, "g": cell, "l": lbd, "u": ubd})
    for squeeze in (False, True):
        found = scipy.io.loadmat(path, squeeze_me=squeeze)
        read = sp.from_structs(found["f"], found["g"], found["l"], found["u"])
        assert read.fingerprint == problem.fingerprint


def test_gms_has_no_rows_for_matrices(tmp_path):
    path = tmp_path / "cone.gms"
    with pytest.raises(ProblemError, match=r"constraints\[1\]: found SECOND_ORDER.*\.gms"):
        sp.write_gms(sp.Problem(x, [x >= 0, sp.second_order(1, x)]), path)
    assert not path.exists()


def test_exact_linear_bounds_refuse_matrices():
    with pytest.raises(ProblemError, match=r"constraints\[0\]: found psd.*expected a linear one"):
        sp.linear_bounds(sp.Problem(x, [sp.psd([[1, x], [x, 1]])]), [x])
