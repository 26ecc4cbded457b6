"""Rows that are eliminated together leave what single rows leave, fraction by fraction."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py import problems
from sparsepop_py.bounding.gram_kernel import grams_with_kernel
from sparsepop_py.verified.certificate import independent_rows, rational_gram
from sparsepop_py.verified.certificate.independent_rows import Entries, whole_numbers

SEEDS = st.integers(0, 2**32 - 1)


def chain(seed, size, digits):
    """A matrix L L' or nearly so of a chain with a row of linear terms, times a whole number."""
    rng = np.random.default_rng(seed)
    factor = np.zeros((size, size), np.int64)
    for offset in (0, 1, 2):
        part = rng.integers(-digits, digits + 1, size - offset)
        factor += np.diag(part, -offset)
    matrix = factor @ factor.T
    row = factor @ rng.integers(-digits, digits + 1, size)
    whole = np.zeros((size + 1, size + 1), np.int64)
    whole[1:, 1:] = matrix
    whole[0, 1:] = whole[1:, 0] = row
    kind = rng.integers(3)
    if kind == 1:
        i = rng.integers(1, size + 1)
        whole[i, i] -= rng.integers(1, 3)
    if kind == 2:
        whole[0, rng.integers(1, size + 1)] += 1
        whole[1:, 0] = whole[0, 1:]
    return whole


def slowly(whole):
    rows = {i: {j: Fraction(int(v)) for j, v in enumerate(row) if v} for i, row in enumerate(whole)}
    return rational_gram._eliminated(rows)


def quickly(whole):
    low, high = np.nonzero(np.triu(whole))
    entries = Entries(low, high, whole[low, high], np.ones(low.size, np.int64))
    found = independent_rows.eliminate_independent(entries, whole.shape[0])
    if found is None:
        return None
    rest = rational_gram._eliminated(rational_gram._rows(found[0]))
    if rest is None:
        return None
    pairs = zip(found[1].top.tolist(), found[1].under.tolist(), strict=True)
    return rest + sum((Fraction(*pair) for pair in pairs), Fraction(0))


@pytest.mark.parametrize("digits", [1, 3, 1000, 10**8])
@given(seed=SEEDS)
def test_any_order_leaves_the_same(digits, seed):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(independent_rows, "_FEW", 1)
        whole = chain(seed, 24, digits)
        assert quickly(whole) == slowly(whole)


def test_rows_are_eliminated_together():
    """A definite chain with small numbers: most rows go in rounds."""
    size = 400
    whole = np.zeros((size + 1, size + 1), np.int64)
    whole[1:, 1:] = 2 * np.eye(size, dtype=int) - np.eye(size, k=1, dtype=int)
    whole[1:, 1:] -= np.eye(size, k=-1, dtype=int)
    whole[0, 1] = whole[1, 0] = 1
    low, high = np.nonzero(np.triu(whole))
    entries = Entries(low, high, whole[low, high], np.ones(low.size, np.int64))
    left, _ = independent_rows.eliminate_independent(entries, size + 1)
    assert not np.any((left.low == 0) & (left.high == 0))  # what the constant loses is apart
    assert np.count_nonzero(left.low == left.high) < size // 4
    assert quickly(whole) == Fraction(size, size + 1)  # an entry of the inverse, by hand


@given(st.lists(st.floats(-1e12, 1e12), max_size=9))
def test_whole_numbers_are_the_doubles(values):
    found = whole_numbers(np.array(values, float))
    if found is not None:
        numbers = [Fraction(top, 2 ** found[1]) for top in found[0].tolist()]
        assert numbers == [Fraction(v) for v in values]


@pytest.mark.parametrize("values", [[1e18], [1e-30, 1.0], [2.0**58] * 8, [5e-324]])
def test_numbers_that_may_not_fit_are_left_alone(values):
    assert whole_numbers(np.array(values)) is None


def test_sums_that_may_not_fit_are_noticed():
    """Denominators near 2**31 without a common factor, and numerators of 2**40."""
    top = np.array([2**40])
    with pytest.raises(independent_rows._TooLong):
        independent_rows._sum(top, np.array([2**31 - 1]), top, np.array([2**31 - 3]))
    found = independent_rows._sum(top, np.array([6]), -3 * top, np.array([9]))
    assert [int(x[0]) for x in found] == [-(2**39), 3]


@pytest.mark.parametrize(
    "make", [problems.rosenbrock, problems.chained_wood, problems.chained_singular]
)
@pytest.mark.parametrize("change", [0.0, 0.25, -0.25])
def test_bounds_are_those_of_single_rows(monkeypatch, make, change):
    f = make(24).objective
    gram = next(
        (g for _, g in grams_with_kernel(f, sp.relax(sp.Problem(f), 2, terms="sign"), np.ones(24))),
        None,
    )
    if gram is None:  # what squares take alone is no sum of squares there
        gram = sp.solve(sp.Problem(f)).certificate.root.argument
    x = sp.variables(24)
    for changed in (f, f + change * x[3] ** 2, f + change * x[5], f + change * x[2] * x[3] ** 2):
        with monkeypatch.context() as patch:
            patch.setattr(rational_gram, "_MANY", 10**9)
            single = gram.bound(changed)
        with monkeypatch.context() as patch:
            patch.setattr(rational_gram, "_MANY", 0)
            patch.setattr(independent_rows, "_FEW", 1)
            assert gram.bound(changed) == single


def test_monomials_that_no_entry_has_are_noticed(monkeypatch):
    monkeypatch.setattr(rational_gram, "_MANY", 0)
    x, y = sp.variables(2)
    gram = rational_gram.ExactGram(
        np.array([[0], [1]], np.int32), np.array([1]), np.array([1]), np.zeros(1)
    )
    assert gram.bound(x**2 + 3) == 3.0
    assert gram.bound(x**2 + y**2 + 3) == -np.inf
    assert gram.bound(x + x**2) == -np.inf  # of 1, x, x^2 the first has no entry, and is not 1
