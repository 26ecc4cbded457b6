"""Ranges and expansions of polynomials against rationals of FLINT, on numbers of all sizes."""

from __future__ import annotations

import numpy as np
import pytest
from flint import fmpq, fmpq_mpoly_ctx
from flint_oracle import between, ends, inside, moderate, rational, real, shares, value_at, wild
from hypothesis import example, given, settings
from hypothesis import strategies as st
from jacobians import dense_jacobian_range

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.arithmetic.polynomial_range import (
    expand_affine,
    monomial_ranges,
    range_over,
)

N = 2
RING = fmpq_mpoly_ctx.get(("s", "t"), "lex")
quick = settings(max_examples=80, deadline=None)
powers = st.tuples(st.integers(0, 4), st.integers(0, 3))
numbers = st.one_of(moderate, wild)


def tables(of):
    return st.dictionaries(powers, of.filter(bool), min_size=1, max_size=5)


def stack(*rows):
    polynomials = [
        Polynomial.from_terms(np.array(list(table)), list(table.values())) for table in rows
    ]
    return PolynomialSystem.stack(polynomials, N)


def box_of(pairs):
    low, high = np.array(pairs, float).T
    return Interval(low, high)


def holds(interval, value, index):
    return inside(real(value), interval.lo[index], interval.hi[index])


boxes = st.one_of(st.tuples(ends(moderate), ends(moderate)), st.tuples(ends(wild), ends(moderate)))


@given(tables(numbers), tables(moderate), boxes, st.tuples(shares, shares))
@quick
def test_ranges_hold_the_values_at_rational_points(first, second, pairs, where):
    x = [between(*pair, share) for pair, share in zip(pairs, where, strict=True)]
    with np.errstate(all="ignore"):
        found = range_over(stack(first, second), box_of(pairs))
    for row, table in enumerate((first, second)):
        assert holds(found, value_at(table, x), row)


@given(moderate, moderate, st.integers(1, 4), shares)
@quick
def test_ranges_hold_what_cancels(centre, factor, steps, share):
    """(x - c)^2 factor, expanded in doubles, near c: the terms are much larger than their sum."""
    table = {(2, 0): factor, (1, 0): -2 * factor * centre, (0, 0): factor * centre * centre}
    table = {key: value for key, value in table.items() if value} or {(0, 0): 1.0}
    pair = (centre, centre + steps * abs(float(np.spacing(centre))))
    found = range_over(stack(table), box_of([pair, (0.0, 0.0)]))
    assert holds(found, value_at(table, [between(*pair, share), fmpq(0)]), 0)


@given(tables(numbers), boxes, st.tuples(shares, shares))
@quick
def test_jacobians_hold_the_derivatives(table, pairs, where):
    x = [between(*pair, share) for pair, share in zip(pairs, where, strict=True)]
    exact = RING.from_dict({key: rational(value) for key, value in table.items()})
    with np.errstate(all="ignore"):
        found = dense_jacobian_range(stack(table, {(0, 0): 1.0}), box_of(pairs))
    for v in range(N):
        slope = exact.derivative(v)
        assert holds(found, slope(*x), (0, v))
        assert found.lo[1, v] == found.hi[1, v] == 0.0


@given(st.lists(powers, min_size=1, max_size=4), boxes, st.tuples(shares, shares))
@quick
def test_ranges_of_monomials_hold_their_values(words, pairs, where):
    x = [between(*pair, share) for pair, share in zip(pairs, where, strict=True)]
    letters = np.array([[0] * (7 - i - j) + [1] * i + [2] * j for i, j in words], np.int32)
    with np.errstate(all="ignore"):
        found = monomial_ranges(letters, box_of(pairs))
    for row, (i, j) in enumerate(words):
        assert holds(found, x[0] ** i * x[1] ** j, row)


places = st.one_of(st.sampled_from([0.0, 1.0, 1e-200, -1e-200, 1e-30, 1e6]), moderate)
sizes = st.one_of(st.sampled_from([0.0, 1.0, 0.5, 1e-200, 3.0]), moderate.map(abs))


@given(tables(numbers), st.tuples(places, places), st.tuples(sizes, sizes))
@example({(2, 0): 1e300, (1, 0): 1.0}, (1e-200, 0.0), (1.0, 1.0))  # 1e-100 is no 0
@example({(2, 0): -1e300, (1, 0): 1.0}, (1e-200, 0.0), (1.0, 1.0))
@example({(3, 2): 0.1, (2, 0): 1.0}, (0.1, -0.3), (1.0, 0.0))
@quick
def test_expansions_hold_every_coefficient(table, centre, scale):
    """What is not listed is exactly zero."""
    s, t = RING.gens()
    exact = RING.from_dict({key: rational(value) for key, value in table.items()})
    moved = [rational(c) + rational(w) * v for c, w, v in zip(centre, scale, (s, t), strict=True)]
    expected = exact.compose(*moved, ctx=RING).to_dict()
    with np.errstate(all="ignore"):
        words, row, value = expand_affine(stack(table), np.array(centre), np.array(scale))
    assert not row.any()
    found = {tuple(np.bincount(w, minlength=N + 1)[1:].tolist()): k for k, w in enumerate(words)}
    assert len(found) == words.shape[0]
    for key in {*expected, *found}:
        coefficient = expected.get(key, fmpq(0))
        if key in found:
            assert holds(value, coefficient, found[key])
        else:
            assert coefficient == 0


@pytest.mark.parametrize("power", [2, 3, 40])
@pytest.mark.parametrize("centre", [1e-200, -3e-170])
def test_centres_whose_powers_underflow_leave_a_constant(power, centre):
    """(c + t)^k has the constant c^k, which no double holds, but it is not zero."""
    table = {(power, 0): 1.0}
    words, _, value = expand_affine(stack(table), np.array([centre, 0.0]), np.ones(2))
    degree = np.count_nonzero(words, axis=1)
    for k in range(power + 1):
        here = np.flatnonzero(degree == k)
        exact = fmpq(1)
        for j in range(k):
            exact = exact * (power - j) / (j + 1)
        assert here.size == 1
        assert holds(value, exact * rational(centre) ** (power - k), int(here[0]))
