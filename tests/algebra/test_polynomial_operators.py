"""Comparisons, printing and size of polynomials."""

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sps
from polynomial_tables import read2

import sparsepop_py as sp
from sparsepop_py import Constraint, Kind, Polynomial, ProblemError

# ---- operators that are not ring operations ----------------------------------------------


def test_comparisons_make_constraints():
    x, y = sp.variables(2)
    cases = [
        (x + y >= 1, Kind.NONNEGATIVE, {(0, 0): -1, (1, 0): 1, (0, 1): 1}),
        (x <= y, Kind.NONNEGATIVE, {(1, 0): -1, (0, 1): 1}),
        (x * y == 2, Kind.ZERO, {(0, 0): -2, (1, 1): 1}),
        (3 >= x, Kind.NONNEGATIVE, {(0, 0): 3, (1, 0): -1}),
        (3 <= x, Kind.NONNEGATIVE, {(0, 0): -3, (1, 0): 1}),
        (3 == x, Kind.ZERO, {(0, 0): -3, (1, 0): 1}),
        (np.float64(3.0) <= x, Kind.NONNEGATIVE, {(0, 0): -3, (1, 0): 1}),
        (np.int64(3) == x, Kind.ZERO, {(0, 0): -3, (1, 0): 1}),
    ]
    for constraint, kind, table in cases:
        assert isinstance(constraint, Constraint)
        assert constraint.kind is kind
        assert read2(constraint.polynomial) == table


def test_a_constraint_has_no_truth_value():
    x, y = sp.variables(2)
    for constraint in (x >= 0, x == y, x <= 1):
        with pytest.raises(ProblemError, match="no truth value"):
            bool(constraint)


def test_chained_comparisons_raise_instead_of_losing_half():
    x, _ = sp.variables(2)
    with pytest.raises(ProblemError, match="0 <= x <= 1"):
        0 <= x <= 1  # noqa: B015


def test_strict_comparisons_and_inequality_raise():
    x, y = sp.variables(2)
    for compare in (
        lambda: x > 0,
        lambda: x < y,
        lambda: 0 < x,
        lambda: 0 > x,
        lambda: np.float64(1.0) < x,
    ):
        with pytest.raises(ProblemError, match="strict"):
            compare()
    with pytest.raises(ProblemError, match="!="):
        _ = x != y


@pytest.mark.parametrize(
    "number",
    [
        np.int64(2**53 + 1),
        np.int64(-(2**63)),
        np.uint64(2**64 - 1),
        Fraction(np.int64(2**62 + 1), np.int64(3)),
        Fraction(np.int8(100), np.int8(3)),
    ],
)
def test_numbers_of_numpy_do_not_overflow(number):
    x, _ = sp.variables(2)
    value = Fraction(int(number.numerator), int(number.denominator))
    assert (7 * (x * number)).fractions == [7 * value]
    assert (x + number).fractions == [value, 1]
    assert ((x + number) * (x - number)).fractions == [-(value**2), 1]
    assert (x / number).fractions == [1 / value]
    assert (x >= number).polynomial.fractions == [-value, 1]


@pytest.mark.parametrize(
    "number", [np.float64(1.5), np.float32(1.5), np.int32(2), np.uint8(3), Fraction(3, 2), True]
)
def test_numbers_of_other_types_work_on_the_left(number):
    x, _ = sp.variables(2)
    value = float(number)
    assert read2(number * x) == {(1, 0): value}
    assert read2(number + x) == {(0, 0): value, (1, 0): 1.0}
    assert read2(number - x) == {(0, 0): value, (1, 0): -1.0}
    assert isinstance(number * x, Polynomial)


def test_arrays_do_not_swallow_polynomials():
    x, _ = sp.variables(2)
    for act in (
        lambda: np.ones(2) * x,
        lambda: x + np.ones(2),
        lambda: np.ones(2) >= x,
        lambda: np.ones(2) / x,
        lambda: x / "2",
        lambda: x * "2",
        lambda: x >= "a",
    ):
        with pytest.raises(TypeError):
            act()


@pytest.mark.parametrize("power", [-1, 0.5, np.nan, np.inf, "2"])
def test_powers_other_than_natural_numbers_raise(power):
    x, _ = sp.variables(2)
    with pytest.raises(ProblemError, match="exponent: found"):
        x**power


def test_division_by_zero_raises():
    x, _ = sp.variables(2)
    for zero in (0, 0.0, np.float64(0.0)):
        with pytest.raises(ProblemError, match="by zero"):
            x / zero


def test_polynomials_of_different_variables_do_not_mix():
    x, a = sp.variables(2)[0], sp.variables(3)[0]
    for act in (lambda: x + a, lambda: x * a, lambda: x >= a, lambda: sp.total([x, a])):
        with pytest.raises(ProblemError, match="2 and 3 variables"):
            act()


def test_total_needs_a_polynomial_and_nothing_strange():
    x, _ = sp.variables(2)
    with pytest.raises(ProblemError, match="no polynomial"):
        sp.total([1.0, 2.0])
    with pytest.raises(ProblemError, match="found str"):
        sp.total([x, "1"])


@pytest.mark.parametrize("shape", [(3,), (1,), (4, 3), (2, 2, 2), ()])
def test_points_of_the_wrong_shape_are_refused(shape):
    x, _ = sp.variables(2)
    with pytest.raises(ProblemError, match="x: found shape"):
        x(np.zeros(shape))


# ---- the zero polynomial, printing, size -------------------------------------------------


def test_the_zero_polynomial_is_neutral():
    x, y = sp.variables(2)
    zero = x - x
    assert zero.terms == 0
    assert zero.degree == 0
    assert zero.support.size == 0
    assert zero.constant_term == 0.0
    assert str(zero) == "0"
    assert zero([3.0, 4.0]) == 0.0
    assert zero(np.ones((5, 2))).tolist() == [0.0] * 5
    assert read2(zero + x * y) == {(1, 1): 1.0}
    for nothing in (zero * (x + 1), zero**3, zero.derivative(0), 0 * x, -zero):
        assert nothing.terms == 0
    assert read2(zero**0) == {(0, 0): 1.0}
    assert zero.exponents.shape == (0, 2)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda x, y: x, "x1"),
        (lambda x, y: -x, "-x1"),
        (lambda x, y: x * 0 + 3, "3"),
        (lambda x, y: x * 0 - 0.5, "-0.5"),
        (lambda x, y: (x - y) ** 2, "x1^2 - 2*x1*x2 + x2^2"),
        (lambda x, y: 1.5 * x**3 * y - 1, "-1 + 1.5*x1^3*x2"),
        (lambda x, y: 1e-7 * y - x, "-x1 + 1e-07*x2"),
        (lambda x, y: 0.1 * x, "0.1*x1"),
    ],
)
def test_printing(make, text):
    assert str(make(*sp.variables(2))) == text


def test_printed_polynomials_are_read_back_to_the_last_bit():
    x, y = sp.variables(2)
    p = (x / 3 + y * 1e-17) ** 2 - 0.1 * x
    back = sp.parse(f"min {p}").objective
    assert np.array_equal(back.words, p.words)
    assert np.array_equal(back.coefficients, p.coefficients)


def test_names_are_printed_and_survive_arithmetic():
    a, b = sp.variables(2, ["alpha", "b2"])
    assert str((a + b) * a - 1) == "-1 + alpha^2 + alpha*b2"
    assert str(a * b == 1) == "-1 + alpha*b2 == 0"
    assert str(Constraint(a, Kind.NONNEGATIVE, "row")) == "row: alpha >= 0"
    assert repr(a + 1) == "<Polynomial 1 + alpha>"
    assert repr(sp.total((a + k) ** k for k in range(20))).startswith("<Polynomial of 20 terms")


def test_a_hundred_thousand_terms_in_ten_thousand_variables():
    n, terms = 10_000, 100_000
    rng = np.random.default_rng(0)
    column = rng.integers(0, n, size=(terms, 2))
    row = np.repeat(np.arange(terms), 2)
    table = sps.coo_array((np.ones(2 * terms, int), (row, column.ravel())), shape=(terms, n))
    values = rng.integers(1, 9, terms).astype(float)
    p = Polynomial.from_terms(table, values)
    x = rng.integers(-3, 4, n).astype(float)
    expected = float(values @ (x[column[:, 0]] * x[column[:, 1]]))  # integers: exact
    assert p(x) == expected
    assert (p + p)(x) == 2 * expected
    assert (0.5 * p - p)(x) == -0.5 * expected
    assert (p - p).terms == 0
    assert p.degree == 2
    gradient = values @ sps.csr_array(
        (
            np.concatenate([x[column[:, 1]], x[column[:, 0]]]),
            (np.tile(np.arange(terms), 2), column.T.ravel()),
        ),
        shape=(terms, n),
    )
    v = int(column[0, 0])
    assert p.derivative(v)(x) == gradient[v]
