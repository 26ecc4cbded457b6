"""Public constructors copy, freeze and check: what was certified cannot change afterwards."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py import Constraint, Kind, Polynomial, ProblemError
from sparsepop_py.algebra import monomials
from sparsepop_py.verified.certificate.certificate import Certificate, Node
from sparsepop_py.verified.certificate.rational_gram import ExactGram


def test_arrays_that_change_later_do_not_change_the_polynomial() -> None:
    words, values = np.array([[0, 1], [1, 2]], np.int32), np.array([2.0, 3.0])
    p = Polynomial(words, values, 2)
    problem = sp.Problem(p, lower=0, upper=1)
    result = sp.solve(problem)
    words[0, 1], values[:] = 2, -1e6
    assert str(p) == "2*x1 + 3*x1*x2"
    assert result.certificate.verify(sp.Problem(p, lower=0, upper=1)).ok
    other = Polynomial(words, values, 2)
    assert not result.certificate.verify(sp.Problem(other, lower=0, upper=1)).ok


@pytest.mark.parametrize("field", ["words", "coefficients"])
def test_arrays_of_a_polynomial_are_read_only(field: str) -> None:
    x, y = sp.variables(2)
    words, values = np.array([[0, 1]]), np.array([1.0])
    made = [x, x * y, x + 1, Polynomial(words, values, 2), Polynomial.from_words(words, values, 2)]
    for p in (*made, replace(x, names=("a", "b")), -x, x.derivative(0), 0.5 * y):
        with pytest.raises(ValueError, match="read-only"):
            getattr(p, field)[...] = 7


def test_bounds_and_entries_are_copied() -> None:
    x, y = sp.variables(2)
    lower, entries = np.array([0.0, 0.0]), [2 + 0 * x, x, y]
    cone = Constraint(entries[0], Kind.SECOND_ORDER, "", entries)  # type: ignore[arg-type]
    problem = sp.Problem(x + y, [cone], lower)
    before = problem.fingerprint
    lower[0], entries[1] = -5.0, x**2
    assert problem.lower.tolist() == [0.0, 0.0] and cone.entries[1] is x
    assert sp.Problem(x + y, [cone], 0).fingerprint == before
    with pytest.raises(ValueError, match="read-only"):
        problem.lower[0] = -5.0


MALFORMED = [
    ({"words": [[2, 1]]}, "words: found a row that descends"),
    ({"words": [[0, 3]]}, r"words: found a variable outside 1\.\.2"),
    ({"words": [[-1, 1]]}, r"words: found a variable outside 1\.\.2"),
    ({"words": [[0.0, 1.0]]}, "words: found float64 of shape"),
    ({"words": [1]}, r"words: found int64 of shape \(1,\)"),
    ({"coefficients": [1.0, 2.0]}, r"coefficients: found float64 of shape \(2,\)"),
    ({"coefficients": ["1"]}, "coefficients: found <U1"),
    ({"coefficients": [1j]}, "coefficients: found complex128"),
    ({"coefficients": [True]}, "coefficients: found bool"),
    ({"coefficients": [np.nan]}, "coefficients: found nan"),
    ({"coefficients": [-np.inf]}, "coefficients: found -inf"),
    ({"dimension": 0}, "dimension: found 0"),
    ({"dimension": 2.0}, "dimension: found 2.0"),
    ({"dimension": True}, "dimension: found True"),
    ({"names": ["a"]}, "names: found 1 names"),
    ({"names": "ab"}, "names: found 'ab'"),
    ({"names": 3}, "names: found 3"),
]


@pytest.mark.parametrize("make", [Polynomial, Polynomial.from_words])
@pytest.mark.parametrize(("change", "message"), MALFORMED)
def test_malformed_terms_are_refused(make: Any, change: dict[str, Any], message: str) -> None:
    fields = {"words": [[0, 1]], "coefficients": [1.0], "dimension": 2, **change}
    for name in ("words", "coefficients"):
        fields[name] = np.array(fields[name])
    with pytest.raises(ProblemError, match=message):
        make(**fields)


@pytest.mark.parametrize(
    ("words", "values"),
    [([[1], [1]], [1.0, 1.0]), ([[2], [1]], [1.0, 1.0]), ([[0, 1], [0, 0]], [1.0, 1.0])],
)
def test_equal_or_unsorted_monomials_are_refused_or_merged(words: Any, values: Any) -> None:
    with pytest.raises(ProblemError, match="equal monomials or none in graded order"):
        Polynomial(np.array(words), np.array(values), 2)
    merged = Polynomial.from_words(np.array(words), np.array(values), 2)
    point = np.array([3.0, 5.0])
    letters = np.append(1.0, point)
    assert merged(point) == sum(v * np.prod(letters[w]) for w, v in zip(words, values, strict=True))


def test_a_monomial_written_twice_made_a_false_bound() -> None:
    """x^2 - 4 x^2 + 1 falls without limit; with the first term alone, 1 would be a bound."""
    words, values = np.array([[0, 0], [1, 1], [1, 1]], np.int32), np.array([1.0, -4.0, 1.0])
    gram = ExactGram(np.array([[0], [1]], np.int32), np.array([1]), np.array([1]), np.zeros(1))
    with pytest.raises(ProblemError, match="equal monomials"):
        Polynomial(words, values, 1)
    problem = sp.Problem(Polynomial.from_words(words, values, 1))
    certificate = Certificate(problem.fingerprint, 1.0, Node(argument=gram))
    assert not certificate.verify(problem).ok


def test_a_zero_coefficient_is_refused_and_merging_drops_it() -> None:
    words, values = np.array([[0], [1]]), np.array([1.0, 0.0])
    with pytest.raises(ProblemError, match="coefficients: found 0.0"):
        Polynomial(words, values, 1)
    assert Polynomial.from_words(words, values, 1).terms == 1


def test_columns_without_letters_do_not_count() -> None:
    x, _ = sp.variables(2)
    wide = Polynomial(np.array([[0, 0, 1]]), np.array([1]), 2)
    assert wide.words.tolist() == x.words.tolist()
    assert sp.Problem(wide).fingerprint == sp.Problem(x).fingerprint
    for shape in ((0, 0), (0, 3)):
        nothing = Polynomial(np.zeros(shape, int), np.zeros(0), 2)
        assert str(nothing) == "0"
        assert sp.Problem(nothing).fingerprint == sp.Problem(0 * x).fingerprint


@given(st.data())
@settings(max_examples=80)
def test_what_merging_makes_passes_the_constructor(data: Any) -> None:
    n = data.draw(st.integers(1, 300))
    rows = data.draw(st.lists(st.lists(st.integers(0, n), min_size=3, max_size=3), max_size=8))
    words = np.sort(np.array(rows, int).reshape(-1, 3), axis=1)
    values = np.array(data.draw(st.lists(st.floats(-9, 9), min_size=len(rows), max_size=len(rows))))
    p = Polynomial.from_words(words, values, n)
    again = Polynomial(p.words, p.coefficients, n)
    assert np.array_equal(again.words, p.words) and again.words is not p.words
    assert monomials.trim(p.words).shape == p.words.shape
    x = data.draw(st.integers(0, 10**6))
    point = np.random.default_rng(x).integers(-3, 4, n).astype(float)
    letters = np.append(1.0, point)
    expected = sum(v * np.prod(letters[w]) for w, v in zip(words, values, strict=True))
    assert np.isclose(again(point), expected, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize(
    "fields",
    [
        {"polynomial": 3.0},
        {"polynomial": None},
        {"name": 7},
        {"kind": "p >= 0"},
        {"kind": Kind.SECOND_ORDER, "entries": 5},
        {"kind": Kind.SECOND_ORDER, "entries": [1.0, 2.0]},
    ],
)
def test_constraints_of_other_types_are_refused(fields: dict[str, Any]) -> None:
    x, _ = sp.variables(2)
    with pytest.raises(ProblemError, match=r"found .*, expected"):
        Constraint(**{"polynomial": x, "kind": Kind.NONNEGATIVE, **fields})


def test_entries_in_other_variables_are_refused() -> None:
    x, _ = sp.variables(2)
    u, _, _ = sp.variables(3)
    with pytest.raises(ProblemError, match="entries: found 3 variables, expected 2"):
        Constraint(x, Kind.SECOND_ORDER, "", (x, u))


@pytest.mark.parametrize("variable", [1.5, 1.0, True, "0", None, -1, 2, np.float64(0)])
def test_derivatives_are_by_variables(variable: Any) -> None:
    x, y = sp.variables(2)
    with pytest.raises(ProblemError, match=r"variable: found .*, expected an integer from 0 to 1"):
        (x**2 + y).derivative(variable)


def test_derivatives_take_integers_of_numpy() -> None:
    x, y = sp.variables(2)
    assert str((x**2 + y).derivative(np.int8(0))) == "2*x1"


# ---- what solving makes --------------------------------------------------------------------------


def test_proved_points_copy_and_freeze() -> None:
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, [x + y == 1], 0, 1)
    given_, rows, solved = np.array([0.25, 0.0]), np.array([0]), np.array([1])
    point = sp.ProvedPoint(given_, np.inf, 0.0, "exact", rows, solved).recheck(problem)
    assert point is not None and point.value == 0.1875  # x2 = 3/4
    copied = sp.ProvedPoint(given_, np.inf, 0.0, "exact", rows, solved)
    given_[0], rows[0], solved[0] = 7.0, 5, 9
    assert copied.recheck(problem).value == 0.1875
    with pytest.raises(ValueError, match="read-only"):
        copied.x[0] = 1.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": np.zeros((1, 2))}, r"x: found float64 of shape \(1, 2\), expected 1 dimension"),
        ({"x": ["a", "b"]}, "x: found <U1"),
        ({"x": [[0.0], 1.0]}, "x: found object"),
        ({"rows": np.array([0.5])}, "rows: found float64"),
        ({"solved": np.array([True])}, "solved: found bool"),
        ({"proof": "hope"}, "proof: found 'hope'"),
        ({"proof": None}, "proof: found None"),
    ],
)
def test_proved_points_of_other_types_are_refused(change: dict[str, Any], message: str) -> None:
    none = np.zeros(0, int)
    fields = {"x": [0.0, 1.0], "rows": none, "solved": none, "proof": "exact", **change}
    with pytest.raises(ProblemError, match=message):
        sp.ProvedPoint(value=0.0, radius=0.0, **fields)


def test_cliques_and_points_keep_arrays_of_their_own() -> None:
    x = sp.variables(3)
    cliques = sp.find_cliques(sp.Problem(x[0] * x[1], [x[1] + x[2] <= 1]))
    home = cliques.home.copy()
    again = replace(cliques, home=home, members=list(cliques.members))
    home[0] = 0
    assert again.home.tolist() == cliques.home.tolist() == [1]
    assert isinstance(again.members, tuple)
    with pytest.raises(ProblemError, match="home: found float64"):
        replace(cliques, home=np.array([0.5]))
    with pytest.raises(ProblemError, match="tree: found 1 parents, expected one of 2 cliques"):
        replace(cliques, tree=np.array([-1]))
    place = np.zeros(2)
    point = sp.Point(place, 0.0, 0.0)
    place[0] = 5.0
    assert point.x.tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("change", "message"),
    [({"fingerprint": 7}, "fingerprint: found int"), ({"root": None}, "root: found NoneType")],
)
def test_certificates_of_other_types_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        Certificate(**{"fingerprint": "v2:0", "bound": 0.0, **change})


def test_parts_of_trees_are_tuples_of_nodes() -> None:
    low, high = Node(), Node()
    children = [low, high]
    node = Node(branch=(0, 0.5), children=children)  # type: ignore[arg-type]
    children.clear()
    assert node.children == (low, high)
    with pytest.raises(ProblemError, match="children: found NoneType, expected a Node"):
        Node(branch=(0, 0.5), children=(None, low))  # type: ignore[arg-type]
    with pytest.raises(ProblemError, match="box: found tuple, expected a BoxProof"):
        Node(())  # type: ignore[arg-type]
