"""The bytes of a problem: they can be read back, so different problems have different ones."""

from __future__ import annotations

import pickle
import struct
from fractions import Fraction
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py.problem.problem import encoding
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.certificate.certificate import Certificate, Node
from sparsepop_py.verified.certificate.steps import BoxProof, Propagation, Replay

INF = float("inf")
many = settings(max_examples=150, deadline=None)


# ---- a reader written from the description of the bytes alone -----------------------------------


def parts_of(data: bytes) -> list[bytes]:
    parts = []
    while data:
        (size,) = struct.unpack_from("<Q", data)
        assert len(data) >= 8 + size
        parts.append(data[8 : 8 + size])
        data = data[8 + size :]
    return parts


def numbers(kind: str, data: bytes) -> tuple[Any, ...]:
    return struct.unpack(f"<{len(data) // struct.calcsize('<' + kind)}{kind}", data)


def read_back(data: bytes) -> tuple[Any, ...]:
    """Dimension, bounds, objective, rows with kinds and entries, and squares."""
    head, counts, kinds, entries, shapes, letters, values, lower, upper, weights = parts_of(data)
    assert head == b"sparsepop-py problem 2"
    n, m, k = numbers("q", counts)
    names = kinds.decode().split(",") if m else []
    sizes = numbers("q", entries)
    assert len(names) == len(sizes) == m
    shape = numbers("q", shapes)
    word, value = list(numbers("i", letters)), list(numbers("d", values))
    polynomials = []
    for terms, width in zip(shape[::2], shape[1::2], strict=True):
        rows = [[word.pop(0) for _ in range(width)] for _ in range(terms)]
        polynomials.append(
            {tuple(x for x in row if x): Fraction(value.pop(0)) for row in rows},
        )
    assert not word and not value
    objective = polynomials.pop(0)
    rows = [
        (name, polynomials.pop(0), [polynomials.pop(0) for _ in range(size)])
        for name, size in zip(names, sizes, strict=True)
    ]
    squares = list(zip(numbers("d", weights), polynomials, strict=True))
    assert len(squares) == k
    return n, numbers("d", lower), numbers("d", upper), objective, rows, squares


def terms(p: sp.Polynomial) -> dict[tuple[int, ...], Fraction]:
    """Monomials as ascending variables, from the exponents and not from the words."""
    table = p.exponents.toarray().tolist()
    return {
        tuple(v + 1 for v, power in enumerate(row) for _ in range(power)): Fraction(value)
        for row, value in zip(table, p.coefficients.tolist(), strict=True)
    }


def content(problem: sp.Problem) -> tuple[Any, ...]:
    rows = [
        (c.kind.name, terms(c.polynomial), [terms(e) for e in c.entries])
        for c in problem.constraints
    ]
    squares = [(w, terms(p)) for w, p in problem.squares]
    low, high = tuple(problem.lower.tolist()), tuple(problem.upper.tolist())
    return problem.dimension, low, high, terms(problem.objective), rows, squares


# ---- problems of all kinds -----------------------------------------------------------------------

# Doubles that look like parts of a description: small integers, and integers read as doubles.
LOOKALIKES = [struct.unpack("<d", struct.pack("<q", k))[0] for k in (1, 2, 1 << 32)]
ODD = [0.0, 1.0, 2.0, -1.0, *LOOKALIKES]
VALUES = st.one_of(st.sampled_from(ODD), st.floats(-1e6, 1e6))


@st.composite
def polynomials(draw: Any, n: int) -> sp.Polynomial:
    count = draw(st.integers(0, 3))
    rows = draw(st.lists(st.lists(st.integers(0, 2), min_size=n, max_size=n), max_size=count))
    values = draw(st.lists(VALUES, min_size=len(rows), max_size=len(rows)))
    return sp.Polynomial.from_terms(np.array(rows, int).reshape(-1, n), values)


@st.composite
def problems(draw: Any) -> sp.Problem:
    n = draw(st.integers(1, 3))
    rows = []
    for kind in draw(st.lists(st.sampled_from(list(sp.Kind)), max_size=3)):
        if kind.is_matrix:
            entries = draw(st.lists(polynomials(n), min_size=3, max_size=3))
            rows.append(sp.Constraint(entries[0], kind, "", tuple(entries)))
        else:
            rows.append(sp.Constraint(draw(polynomials(n)), kind))
    ends = st.lists(st.one_of(VALUES, st.just(INF)), min_size=n, max_size=n)
    low, gap = draw(ends), draw(ends)
    lower = [-v if np.isinf(v) else v for v in low]
    upper = [INF if np.isinf(g) else max(v, g) for v, g in zip(lower, gap, strict=True)]
    squares = draw(st.lists(polynomials(n), max_size=2)) or None
    objective = draw(polynomials(n))
    if squares:
        objective = sp.total([1.0 + objective * 0.0, *(p * p for p in squares)])
    return sp.Problem(objective, rows, lower, upper, squares=squares)


@given(problems())
@many
def test_a_problem_can_be_read_back_from_its_bytes(problem: sp.Problem) -> None:
    assert read_back(encoding(problem)) == content(problem)


@given(problems(), problems())
@many
def test_bytes_are_equal_only_for_equal_problems(one: sp.Problem, other: sp.Problem) -> None:
    assert (encoding(one) == encoding(other)) == (content(one) == content(other))
    assert (one.fingerprint == other.fingerprint) == (content(one) == content(other))


# ---- what the first version confused -------------------------------------------------------------


def twins() -> tuple[sp.Problem, sp.Problem]:
    """An infeasible problem in 2 variables and a feasible one in 4; the row reads as bounds."""
    word = sp.Polynomial.from_terms(np.array([[1, 0]]), [1.0])
    empty = sp.Problem(word, [2 * word == 0], [1, 1], [2, 3])
    row = b"ZERO" + np.array([1, 1], "<i8").tobytes()
    row += np.array([1], "<i4").tobytes() + np.array([2.0]).tobytes()
    lower = np.frombuffer(row, "<f8")
    wide = sp.Polynomial.from_terms(np.array([[1, 0, 0, 0]]), [1.0])
    full = sp.Problem(wide, (), lower, [1, 1, 2, 3])
    return empty, full


def test_a_row_that_reads_as_bounds_has_another_fingerprint() -> None:
    empty, full = twins()
    assert full.violation(full.upper) == 0.0  # so that it is feasible, and the other is not
    assert encoding(empty) != encoding(full)
    assert empty.fingerprint != full.fingerprint


def test_a_shared_dictionary_does_not_carry_a_claim_to_the_twin() -> None:
    """0 == 2 x1 with x1 >= 1 is infeasible; of the problem in 4 variables the claim is false."""
    empty, full = twins()
    proof = BoxProof((Propagation(1, False),))
    assert is_empty(proof.replay(Replay(empty, None)))
    certificate = Certificate(empty.fingerprint, INF, Node(proof))
    known: dict[Any, Any] = {}
    assert certificate.verify(empty, known).ok
    verdict = certificate.verify(full, known)
    assert not verdict.ok
    assert certificate.recompute(full, known)[0] < INF


@given(problems(), st.booleans())
@many
def test_problems_of_one_set_share_bytes_of_rows(problem: sp.Problem, first: bool) -> None:
    """Whichever of them is asked first, each has its own objective and bounds in its bytes."""
    if first:
        assert read_back(encoding(problem)) == content(problem)
    for objective in (-1 * problem.objective, 0.0 * problem.objective):
        changed = problem.with_objective(objective)
        assert read_back(encoding(changed)) == content(changed)
        again = pickle.loads(pickle.dumps(changed)).with_objective(problem.objective)
        assert read_back(encoding(again)) == content(again)
    assert read_back(encoding(problem)) == content(problem)
    other = sp.Problem(problem.objective, problem.constraints[1:], problem.lower, problem.upper)
    assert read_back(encoding(other)) == content(other)
