"""SparsePOP's structs, as dicts and as scipy.io.loadmat gives them."""

from __future__ import annotations

import copy
import io
from dataclasses import make_dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sps
from hypothesis import given, settings
from hypothesis import strategies as st
from struct_cases import struct

import sparsepop_py as sp
from sparsepop_py.compat.structs import from_structs, to_structs
from sparsepop_py.errors import ProblemError


def example() -> tuple[Any, Any, Any, Any]:
    """Min x1^2*x2 - 3 subject to x1*x2 == 1, x1 + x2 <= 4 and 0 <= x1."""
    return (
        struct([[2, 1], [0, 0]], [1, -3]),
        [struct([[1, 1], [0, 0]], [1, -1], -1), struct([[1, 0], [0, 1], [0, 0]], [-1, -1, 4])],
        np.array([0, -1e10]),
        np.array([1e10, 2e10]),
    )


def reference() -> sp.Problem:
    x, y = sp.variables(2)
    return sp.Problem(x**2 * y - 3, [x * y == 1, 4 - x - y >= 0], lower=[0, -np.inf])


def as_cell(items: list[Any], shape: tuple[int, int]) -> np.ndarray:
    cell = np.empty(shape, object)
    cell.ravel()[:] = items
    return cell


def test_example() -> None:
    problem = from_structs(*example())
    assert problem.fingerprint == reference().fingerprint
    assert [row.kind for row in problem.constraints] == [sp.Kind.ZERO, sp.Kind.NONNEGATIVE]


def as_dataclass(fields: dict[str, Any]) -> Any:
    return make_dataclass("Poly", fields)(**fields)


@pytest.mark.parametrize("make", [dict, lambda d: SimpleNamespace(**d), as_dataclass])
@pytest.mark.parametrize(
    "collect",
    [list, tuple, lambda rows: as_cell(rows, (1, 2)), lambda rows: as_cell(rows, (2, 1))],
)
def test_containers(make: Any, collect: Any) -> None:
    objective, rows, lbd, ubd = example()
    rows = collect([make(row) for row in rows])
    assert from_structs(make(objective), rows, lbd, ubd).fingerprint == reference().fingerprint


@pytest.mark.parametrize(
    "empty", [None, [], (), {}, np.zeros((0, 0)), np.empty((0, 0), object), np.empty(0)]
)
def test_unconstrained(empty: Any) -> None:
    objective, _, lbd, ubd = example()
    assert from_structs(objective, empty, lbd, ubd).constraints == ()


def test_single_struct_as_constraint() -> None:
    objective, rows, lbd, ubd = example()
    problem = from_structs(objective, rows[0], lbd, ubd)
    assert [str(row) for row in problem.constraints] == ["-1 + x1*x2 == 0"]


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"squeeze_me": True},
        {"squeeze_me": True, "struct_as_record": False},
        {"struct_as_record": False},
    ],
)
@pytest.mark.parametrize("shape", [(1, 2), (2, 1)])
@pytest.mark.parametrize("sparse", [False, True])
def test_loadmat(options: dict[str, bool], shape: tuple[int, int], sparse: bool) -> None:
    objective, rows, lbd, ubd = example()
    if sparse:
        for item in (objective, *rows):
            item["supports"] = sps.csc_array(item["supports"])
            item["coef"] = sps.csc_array(item["coef"])
        lbd, ubd = sps.csc_array(lbd.reshape(1, -1)), sps.csc_array(ubd.reshape(-1, 1))
    stream = io.BytesIO()
    cell = as_cell(rows, shape)
    scipy.io.savemat(stream, {"objPoly": objective, "ineqPolySys": cell, "lbd": lbd, "ubd": ubd})
    loaded = scipy.io.loadmat(io.BytesIO(stream.getvalue()), **options)
    arguments = [loaded[name] for name in ("objPoly", "ineqPolySys", "lbd", "ubd")]
    assert from_structs(*arguments).fingerprint == reference().fingerprint


@pytest.mark.parametrize("options", [{}, {"squeeze_me": True}])
def test_loadmat_of_one_term_and_one_variable(options: dict[str, bool]) -> None:
    stream = io.BytesIO()
    rows = as_cell([struct([[0], [3]], [-8, 1], -1)], (1, 1))
    objective = struct([[2]], [5])
    scipy.io.savemat(stream, {"objPoly": objective, "rows": rows, "lbd": 0.0, "ubd": 9.0})
    loaded = scipy.io.loadmat(io.BytesIO(stream.getvalue()), **options)
    problem = from_structs(loaded["objPoly"], loaded["rows"], loaded["lbd"], loaded["ubd"])
    assert str(problem) == "min 5*x1^2\n  s.t. -8 + x1^3 == 0\n  0 <= x1 <= 9"


def test_rows_without_a_dimension_and_shapes_of_coefficients() -> None:
    one = struct([[1, 2]], [3]) | {"supports": np.array([1, 2]), "coef": 3.0}
    assert str(from_structs(one, [], [0, 0], [1, 1]).objective) == "3*x1*x2^2"
    row = struct([[1, 0], [0, 1]], [3, 4]) | {"coef": np.array([[3.0, 4.0]])}
    assert str(from_structs(row, [], [[0], [0]], [[1, 1]]).objective) == "3*x1 + 4*x2"


def test_degree_and_size_may_be_absent_and_type_zero_is_an_objective() -> None:
    objective = struct([[1, 0], [0, 1]], [3, 4], 0, degree=None, sizeCone=None)
    assert from_structs(objective, None, [0, 0], [1, 1]).objective.degree == 1
    objective["degree"] = np.zeros((0, 0))
    assert from_structs(objective, None, [0, 0], [1, 1]).objective.degree == 1


def test_polynomial_without_terms_is_zero() -> None:
    nothing = struct([[0, 0]], [1]) | {"noTerms": 0, "supports": np.zeros((0, 0)), "coef": []}
    assert from_structs(nothing, [], [0, 0], [1, 1]).objective.terms == 0
    objective = to_structs(sp.Problem(sp.variables(2)[0] * 0.0))[0]
    assert objective["noTerms"] == 1 and objective["coef"].tolist() == [[0.0]]


def test_least_squares() -> None:
    residuals = [struct([[2, 0], [0, 1]], [-1, 1]), struct([[0, 0], [1, 0]], [1, -1])]
    problem = from_structs(residuals, [], [-5, -5], [5, 5])
    x, y = sp.variables(2)
    parts = [y - x**2, 1 - x]
    objective = sp.total(part**2 for part in parts)
    assert problem.fingerprint == sp.Problem(objective, (), -5, 5, squares=parts).fingerprint
    assert [(w, str(p)) for w, p in problem.squares] == [(1, "x2 - x1^2"), (1, "1 - x1")]


def test_list_of_one_is_the_objective_itself() -> None:
    objective, rows, lbd, ubd = example()
    assert from_structs([objective], rows, lbd, ubd).fingerprint == reference().fingerprint


def test_tiny_coefficients_are_kept() -> None:
    problem = from_structs(struct([[1], [2]], [1e-10, 1e-300]), [], [-1], [1])
    assert problem.objective.coefficients.tolist() == [1e-10, 1e-300]


def test_inputs_are_not_modified() -> None:
    objective, rows, lbd, ubd = example()
    unsorted = sps.csr_array((np.array([1.0, 2.0]), np.array([1, 0]), np.array([0, 2, 2])), (2, 2))
    objective["supports"] = unsorted
    objective["coef"].flags.writeable = False
    before = copy.deepcopy((objective, rows, lbd, ubd))
    from_structs(objective, rows, lbd, ubd)
    assert unsorted.indices.tolist() == [1, 0] and unsorted.data.tolist() == [1, 2]
    assert np.array_equal(lbd, before[2]) and np.array_equal(ubd, before[3])
    for now, then in zip(rows, before[1], strict=True):
        assert all(np.array_equal(now[key], then[key]) for key in then)


def change(**fields: Any) -> tuple[Any, Any, Any, Any]:
    """The example with fields of its second constraint changed (None: left out)."""
    objective, rows, lbd, ubd = example()
    rows[1] = {k: v for k, v in (rows[1] | fields).items() if v is not None}
    return objective, rows, lbd, ubd


def objective_with(**fields: Any) -> tuple[Any, Any, Any, Any]:
    objective, rows, lbd, ubd = example()
    return {k: v for k, v in (objective | fields).items() if v is not None}, rows, lbd, ubd


def bounds(lbd: Any, ubd: Any) -> tuple[Any, Any, Any, Any]:
    return (*example()[:2], lbd, ubd)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (change(degree=2), "ineqPolySys[1].degree: found 2, expected 1"),
        (change(degree=1.5), "ineqPolySys[1].degree: found 1.5, expected an integer"),
        (change(noTerms=2), "ineqPolySys[1].noTerms: found 2, expected 3"),
        (change(coef=[1, 2]), "ineqPolySys[1].coef: found 2 values, expected 3"),
        (change(coef=np.ones((3, 2))), "ineqPolySys[1].coef: found 3 x 2 values, expected 3"),
        (change(coef=[1, np.nan, 2]), "ineqPolySys[1].coef: found nan, expected finite"),
        (change(coef=[1, np.inf, 2]), "ineqPolySys[1].coef: found inf, expected finite"),
        (change(coef=[1, 2j, 2]), "ineqPolySys[1].coef: found complex numbers, expected"),
        (change(coef="abc"), "ineqPolySys[1].coef: found str, expected real numbers"),
        (
            change(supports=np.array([[1, 0], [0, 1], [1, 0]])),
            "ineqPolySys[1].supports: found equal rows 1 and 3, expected distinct",
        ),
        (
            change(supports=np.array([[1, 0], [0, -1], [0, 0]])),
            "ineqPolySys[1].supports: found the exponent -1",
        ),
        (
            change(supports=sps.csr_array([[1, 0], [0, 0.5], [0, 0]])),
            "ineqPolySys[1].supports: found the exponent 0.5",
        ),
        (
            change(supports=sps.csr_array([[1, 0], [0, 1j], [0, 0]])),
            "ineqPolySys[1].supports: found a matrix of complex128",
        ),
        (
            change(supports=np.array([[1, 0], [0, np.nan], [0, 0]])),
            "ineqPolySys[1].supports: found the exponent nan",
        ),
        (change(supports=np.eye(3)), "ineqPolySys[1].supports: found 3 columns, expected 2"),
        (change(supports=np.ones((1, 1, 2))), "ineqPolySys[1].supports: found 3 dimensions"),
        (change(dimVar=3), "ineqPolySys[1].supports: found 2 columns, expected 3"),
        (change(dimVar=3, supports=np.eye(3)), "ineqPolySys[1].dimVar: found 3, expected 2"),
        (change(dimVar=0), "ineqPolySys[1].dimVar: found 0, expected a positive"),
        (change(dimVar=[1, 2]), "ineqPolySys[1].dimVar: found 2 values, expected one integer"),
        (change(typeCone=2), "ineqPolySys[1].sizeCone: found 1, expected at least 2"),
        (change(typeCone=3), "ineqPolySys[1].sizeCone: found 1, expected at least 2"),
        (change(typeCone=2, sizeCone=2), "ineqPolySys[1].coef: found 3 x 1 values, expected 3 x 2"),
        (change(typeCone=3, sizeCone=2), "ineqPolySys[1].coef: found 3 x 1 values, expected 3 x 4"),
        (
            change(typeCone=3, sizeCone=2, coef=[[1, 2, 2, 1], [0, 1, 0, 0], [0, 0, 0, 1]]),
            "ineqPolySys[1].coef: found row 2, which is not symmetric",
        ),
        (
            change(typeCone=2, sizeCone=2, coef=[[1, 2], [0, np.inf], [0, 0]]),
            "ineqPolySys[1].coef: found inf, expected finite numbers",
        ),
        (change(typeCone=4), "ineqPolySys[1].typeCone: found 4, expected 1, -1, 2 or 3"),
        (change(typeCone=0), "ineqPolySys[1].typeCone: found 0, expected 1, -1, 2 or 3"),
        (change(sizeCone=2), "ineqPolySys[1].sizeCone: found 2, expected 1"),
        (change(typeCone=None), "ineqPolySys[1].typeCone: found nothing"),
        (change(dimVar=None), "ineqPolySys[1].dimVar: found nothing"),
        (change(noTerms=None), "ineqPolySys[1].noTerms: found nothing"),
        (change(supports=None), "ineqPolySys[1].supports: found nothing"),
        (change(coef=None), "ineqPolySys[1].coef: found nothing"),
        (objective_with(degree=2), "objPoly.degree: found 2, expected 3"),
        (objective_with(typeCone=3), "objPoly.typeCone: found 3, expected 1"),
        (([], *example()[1:]), "objPoly: found no polynomial"),
        ((None, *example()[1:]), "objPoly: found no polynomial"),
        (("poly", *example()[1:]), "objPoly: found str, expected a struct"),
        ((np.ones(3), *example()[1:]), "objPoly: found an array of float64, expected a struct"),
        (([1, 2], *example()[1:]), "objPoly[0]: found int, expected a polynomial struct"),
        (
            ([example()[0], struct([[1]], [1])], *example()[1:]),
            "objPoly[1].dimVar: found 1, expected 2",
        ),
        ((example()[0], [None], [0, 0], [1, 1]), "ineqPolySys[0]: found NoneType"),
        ((example()[0], 7, [0, 0], [1, 1]), "ineqPolySys: found int, expected a struct"),
        (bounds([0], [1, 1]), "lbd: found 1 values, expected 2"),
        (bounds([0, 0], [1, 1, 1]), "ubd: found 3 values, expected 2"),
        (bounds(None, [1, 1]), "lbd: found NoneType, expected real numbers"),
        (bounds([0, np.nan], [1, 1]), "lbd: found NaN for variable 2"),
        (bounds([0, 2], [1, 1]), "lbd, ubd: found [2, 1] for variable 2, expected lbd <= ubd"),
        (
            objective_with(coef=np.array([2**62 + 255] * 3)),
            "objPoly.coef: found 4611686018427388159",
        ),
        (bounds([0, 2**62 + 255], [1, 2**63]), "lbd: found 4611686018427388159, which no double"),
        (bounds(np.array([-(2**53) - 1, 0]), [1, 1]), "lbd: found -9007199254740993, which no"),
        (bounds([0, 1e10], [1, 1e11]), "lbd, ubd: found [1e+10, 1e+11] for variable 2"),
    ],
)
def test_malformed_structs(arguments: tuple[Any, Any, Any, Any], message: str) -> None:
    with pytest.raises(ProblemError) as caught:
        from_structs(*arguments)
    assert message in str(caught.value)


def test_to_structs() -> None:
    objective, rows, lbd, ubd = to_structs(reference())
    assert objective["supports"].tolist() == [[0, 0], [2, 1]]
    assert objective["coef"].tolist() == [[-3], [1]]
    assert (objective["degree"], objective["noTerms"], objective["dimVar"]) == (3, 2, 2)
    assert [row["typeCone"] for row in rows] == [-1, 1]
    assert lbd.tolist() == [0, -1e10] and ubd.tolist() == [1e10, 1e10]


def test_structs_are_copies() -> None:
    problem = reference()
    objective, _, lbd, _ = to_structs(problem)
    objective["coef"][:] = 7
    lbd[:] = 5
    assert problem.fingerprint == reference().fingerprint


doubles = st.floats(-1e6, 1e6).filter(bool)
polynomials = st.dictionaries(st.tuples(*[st.integers(0, 3)] * 2), doubles, max_size=5).map(
    lambda table: sp.Polynomial.from_terms(
        np.array(list(table), int).reshape(-1, 2), list(table.values())
    )
)
constraints = (
    st.builds(sp.Constraint, polynomials, st.sampled_from([sp.Kind.NONNEGATIVE, sp.Kind.ZERO]))
    | st.lists(polynomials, min_size=2, max_size=4).map(lambda f: sp.second_order(*f))
    | st.tuples(*[polynomials] * 3).map(lambda f: sp.psd([f[:2], f[1:]]))
)
limits = st.none() | st.floats(0, 1e9)


@settings(max_examples=100, deadline=None)
@given(
    polynomials,
    st.lists(constraints, max_size=3),
    st.lists(limits, min_size=2, max_size=2),
    st.lists(limits, min_size=2, max_size=2),
    st.booleans(),
)
def test_round_trips(
    objective: sp.Polynomial,
    rows: list[sp.Constraint],
    lower: list[float | None],
    upper: list[float | None],
    through_file: bool,
) -> None:
    problem = sp.Problem(
        objective,
        rows,
        [-np.inf if value is None else -value for value in lower],
        [np.inf if value is None else value for value in upper],
    )
    arguments: Any = to_structs(problem)
    if through_file:
        stream = io.BytesIO()
        cell = as_cell(arguments[1], (1, len(rows)))
        names = ("objPoly", "ineqPolySys", "lbd", "ubd")
        values = (arguments[0], cell, *arguments[2:])
        scipy.io.savemat(stream, dict(zip(names, values, strict=True)))
        loaded = scipy.io.loadmat(io.BytesIO(stream.getvalue()))
        arguments = [loaded[name] for name in names]
    assert from_structs(*arguments).fingerprint == problem.fingerprint


def test_exponents_have_a_limit() -> None:
    huge = {"supports": [[1e20], [0]], "coef": [1, 1], "dimVar": 1, "noTerms": 2, "typeCone": 1}
    with pytest.raises(sp.ProblemError, match="found the exponent 1e.20, expected non-negative"):
        sp.sparsePOP(huge, [], [0], [1], {"printLevel": 0})
    with pytest.raises(sp.ProblemError, match="exponents: found .*up to 1000000"):
        sp.Polynomial.from_terms([[2**40]], [1.0])


def test_bounds_beyond_what_structs_hold_become_rows():
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, [], lower=[-1e12, 2e10], upper=[-1e10, 3e10])
    read = sp.from_structs(*sp.to_structs(problem))
    assert [str(row) for row in read.constraints] == [
        "1000000000000 + x1 >= 0",
        "-20000000000 + x2 >= 0",
        "-10000000000 - x1 >= 0",
        "30000000000 - x2 >= 0",
    ]
    assert np.isinf(read.lower).all() and np.isinf(read.upper).all()


HUGE_SPARSE = sps.csr_array((10**6, 10**6))  # 7 TB with its zeros


class Refuses:
    """An array of another package that gives its numbers to nobody."""

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise RuntimeError("it requires a gradient")


@pytest.mark.parametrize(
    ("field", "value", "found"),
    [
        ("coef", HUGE_SPARSE, "a sparse matrix of 1000000 x 1000000, expected at most"),
        ("dimVar", HUGE_SPARSE, "a sparse matrix of 1000000 x 1000000, expected at most"),
        ("supports", sps.coo_array(np.array([1, 2, 3])), "3 columns, expected 2"),
        ("coef", Refuses(), "Refuses, expected real numbers"),
        ("coef", np.ma.array([1.0, 2.0], mask=[0, 1]), "masked elements"),
    ],
)
def test_wrong_arrays_are_named(field: str, value: Any, found: str) -> None:
    objective, rows, lbd, ubd = example()
    with pytest.raises(ProblemError, match=rf"ineqPolySys\[1\].{field}: found {found}"):
        from_structs(objective, [rows[0], {**rows[1], field: value}], lbd, ubd)


def test_a_sparse_matrix_is_no_struct() -> None:
    objective, rows, lbd, ubd = example()
    matrix = sps.dok_array((3, 2))
    named = "found a sparse matrix of 3 x 2, expected a"
    with pytest.raises(ProblemError, match=f"objPoly: {named}"):
        from_structs(matrix, rows, lbd, ubd)
    with pytest.raises(ProblemError, match=f"ineqPolySys: {named}"):
        from_structs(objective, matrix, lbd, ubd)
    with pytest.raises(ProblemError, match=rf"ineqPolySys\[1\]: {named}"):
        from_structs(objective, [rows[0], matrix], lbd, ubd)


def test_masked_and_huge_bounds_are_refused() -> None:
    objective, rows, lbd, ubd = example()
    masked = np.ma.array(np.zeros(2), mask=[0, 1])
    with pytest.raises(ProblemError, match="ubd: found masked elements"):
        from_structs(objective, rows, lbd, masked)
    with pytest.raises(ProblemError, match="lbd: found a sparse matrix"):
        from_structs(objective, rows, HUGE_SPARSE, ubd)
    with pytest.raises(ProblemError, match="lower: found masked elements"):
        sp.Problem(sp.variables(2)[0], lower=masked)
