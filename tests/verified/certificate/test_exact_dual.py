"""Rational multipliers: bounds by hand, forgeries, and optima of an exact simplex method."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.certificate import Certificate, Node, prove
from sparsepop_py.verified.certificate.exact_dual import ExactDual
from sparsepop_py.verified.certificate.rational_gram import ExactGram
from sparsepop_py.verified.certificate.steps import BoxProof, Propagation, Replay, Tightening

INF = np.inf
x, y = sp.variables(2)
GRAM = ExactGram(
    np.array([[0], [1], [2]], np.int32), *np.array([[1, 1, 2], [1, 2, 2]]), np.zeros(3)
)


def dual(problem, *terms, gram=None):
    """Terms are (row, letters, value)."""
    words = np.zeros((len(terms), 2), np.int32)
    for k, (_, letters, _) in enumerate(terms):
        words[k, : len(letters)] = letters
    rows = np.array([row for row, _, _ in terms], np.int64)
    values = tuple(value for _, _, value in terms)
    return ExactDual(problem.lower, problem.upper, rows, words, values, gram)


def bound(problem, *terms, gram=None):
    found = dual(problem, *terms, gram=gram)
    return found.bound(problem.rows, problem.equality, problem.objective)


def test_the_sum_of_free_variables_under_an_equation():
    """min x + y with 3 x + 3 y = 1 is 1/3, rounded down; any other multiplier leaves x."""
    problem = sp.Problem(x + y, [3 * x + 3 * y == 1])
    found = bound(problem, (0, (), Fraction(1, 3)))
    assert Fraction(found) < Fraction(1, 3) < Fraction(np.nextafter(found, INF))
    assert bound(problem, (0, (), 0.3333333333333333)) == -INF
    assert bound(problem) == -INF


def test_several_multipliers_of_one_row_add_up():
    problem = sp.Problem(x + y, [x + y == 1])
    assert bound(problem, (0, (), 2), (0, (), -1)) == 1.0


def test_multipliers_of_inequalities_are_not_negative():
    """min -x with x >= 1 has no bound."""
    problem = sp.Problem(-1.0 * x, [x >= 1])
    assert bound(problem, (0, (), -1)) == -INF
    assert bound(sp.Problem(-1.0 * x, [x == 1]), (0, (), -1)) == -1.0
    assert bound(sp.Problem(1.0 * x, [x >= 1]), (0, (), 1)) == 1.0


def test_bounds_are_rows_behind_the_constraints():
    """min x - y with x >= 2, y <= 5: x - 2 is row 1 + 0, 5 - y is row 1 + 2 + 1."""
    problem = sp.Problem(x - y, [x + y >= 0], lower=[2, -INF], upper=[INF, 5])
    assert bound(problem, (1, (), 1), (4, (), 1)) == -3.0
    assert bound(problem, (1, (), -1), (4, (), 1)) == -INF
    assert bound(problem, (2, (), 1), (4, (), 1)) == -INF  # y has no lower bound
    assert bound(problem, (3, (), 1), (4, (), 1)) == -INF  # x has no upper bound


def test_negative_multipliers_of_bounds_prove_nothing():
    """min -x with x >= 2 falls without limit."""
    problem = sp.Problem(-1.0 * x + 0 * y, lower=[2, -INF])
    assert bound(problem, (0, (), -1)) == -INF
    assert bound(sp.Problem(x + 0 * y, upper=[2, INF]), (2, (), -1)) == -INF


def test_monomials_multiply_equalities_alone():
    """min x^2 y with x y = 3, x = 2 is 6: x (x y - 3) + 3 (x - 2)."""
    rows = [x * y == 3, x == 2]
    problem = sp.Problem(x**2 * y, rows)
    assert bound(problem, (0, (1,), 1), (1, (), 3)) == 6.0
    loose = sp.Problem(x**2 * y, [x * y >= 3, x == 2])
    assert bound(loose, (0, (1,), 1), (1, (), 3)) == -INF


def test_letters_of_words_need_no_order():
    problem = sp.Problem(x * x * y, [x == 2, y == 3])
    assert bound(problem, (0, (2, 1), 1), (0, (2,), 2), (1, (), 4)) == 12.0


def test_the_rest_may_be_a_sum_of_squares():
    """min (x - y)^2 + x with x >= 1/3 is 1/3; no other multiplier leaves squares."""
    problem = sp.Problem((x - y) ** 2 + x, [3 * x >= 1])
    found = bound(problem, (0, (), Fraction(1, 3)), gram=GRAM)
    assert Fraction(found) < Fraction(1, 3) < Fraction(np.nextafter(found, INF))
    linear = replace(
        GRAM, first=np.append(GRAM.first, [0, 0]), second=np.append(GRAM.second, [1, 2])
    )
    linear = replace(linear, value=np.zeros(5))
    assert bound(problem, (0, (), Fraction(1, 4)), gram=linear) == -INF
    saddle = sp.Problem(x**2 - y**2, [x >= 0])
    assert bound(saddle, gram=GRAM) == -INF


def test_bounds_that_are_assumed_have_to_hold():
    """min y with y >= x, 2 x >= 1: one sweep proves x >= 0.4, from which y >= 0.4 follows."""
    problem = sp.Problem(y, [y >= x, 2 * x >= 1], lower=[0, -INF])
    assumed = dual(problem, (0, (), 1), (2, (), 1))
    assumed = replace(assumed, lower=np.array([0.4, -INF]), upper=np.array([9.0, INF]))
    replay, box = Replay(problem, None), Interval(problem.lower, problem.upper)
    assert prove(replay, box, assumed, False).bound == -INF
    swept = BoxProof((Propagation(1, False),)).replay(replay)
    assert prove(replay, swept, assumed, False).bound <= 0.0  # x may be larger than 9
    high = Interval(swept.lo, np.array([9.0, INF]))
    assert prove(replay, high, assumed, False).bound == 0.4
    low = Interval(np.array([0.0, -INF]), high.hi)
    assert prove(replay, low, assumed, False).bound == -INF
    assert not replace(assumed, lower=np.array([np.nan, -INF])).covers(high)
    assert not replace(assumed, upper=np.array([np.nan, INF])).covers(high)
    assert not replace(assumed, lower=np.zeros(3) - INF).covers(high)
    assert not replace(assumed, upper=np.zeros(3) + INF).covers(high)


def test_nothing_is_feasible_where_a_positive_constant_bounds_zero():
    """x + y >= 1 and x + y <= 0: their sum is 0 >= 1."""
    problem = sp.Problem(x, [x + y >= 1, x + y <= 0])
    farkas = dual(problem, (0, (), 1), (1, (), 1))
    replay, box = Replay(problem, None), Interval(problem.lower, problem.upper)
    assert prove(replay, box, farkas, True).bound == INF
    assert prove(replay, box, dual(problem), True).bound == -INF  # 0 >= 0 contradicts nothing
    touching = sp.Problem(x, [x + y >= 1, x + y <= 1])
    assert prove(Replay(touching, None), box, farkas, True).bound == -INF


@pytest.mark.parametrize(
    "change",
    [
        {"row": np.array([-1])},
        {"row": np.array([5])},
        {"row": np.array([0.0])},
        {"row": np.array([0, 0])},
        {"word": np.array([[3, 0]], np.int32)},
        {"word": np.array([[-1, 0]], np.int32)},
        {"word": np.zeros((2, 2), np.int32)},
        {"word": np.zeros(2, np.int32)},
        {"value": ()},
        {"lower": np.zeros(3)},
        {"upper": np.zeros(1)},
    ],
    ids=str,
)
def test_what_makes_no_sense_proves_nothing(change):
    problem = sp.Problem(x + y, [x + y == 1])
    good = dual(problem, (0, (), 1))
    assert good.bound(problem.rows, problem.equality, problem.objective) == 1.0
    forged = replace(good, **change)
    assert forged.bound(problem.rows, problem.equality, problem.objective) == -INF


def test_values_have_to_be_numbers():
    problem = sp.Problem(x + y, [x + y == 1])
    for value in (np.nan, INF):
        with pytest.raises((ValueError, OverflowError)):
            dual(problem, (0, (), value))


def cut(problem, variable, side, value, multiplier, cutoff=1.0, **changes):
    """The box after side * x_variable >= value is claimed where (x - y)^2 + y^2 <= cutoff."""
    linear = replace(
        GRAM, first=np.append(GRAM.first, [0, 0]), second=np.append(GRAM.second, [1, 2])
    )
    argument = replace(dual(problem, (0, (), multiplier)), gram=replace(linear, value=np.zeros(5)))
    argument = replace(argument, **changes)
    step = Tightening(np.array([variable]), np.array([side]), np.array([value]), argument, True)
    return Replay(problem, cutoff).step(step, Interval(problem.lower, problem.upper))


def test_the_cutoff_row_bounds_variables():
    """Where (x - y)^2 + y^2 <= 1 the least y is -1: y + (f - 1) / 2 >= -1 and no more."""
    problem = sp.Problem((x - y) ** 2 + y**2)
    assert cut(problem, 1, 1, -1.0, Fraction(1, 2)).lo[1] == -1.0
    assert cut(problem, 1, -1, -1.0, Fraction(1, 2)).hi[1] == 1.0
    assert cut(problem, 1, 1, -1.0 + 2.0**-53, Fraction(1, 2)).lo[1] == -INF
    assert cut(problem, 1, 1, -1.0, Fraction(1, 4)).lo[1] == -INF
    assert cut(problem, 1, 1, -1.0, Fraction(1, 2), cutoff=2.0).lo[1] == -INF
    assert cut(problem, 1, 1, -1.0, Fraction(-1, 2)).lo[1] == -INF
    assert cut(problem, 0, 1, -1.25, Fraction(1, 2)).lo[0] == -INF  # -sqrt(2) is the least x
    assert cut(problem, 0, 1, -1.5, Fraction(1, 2)).lo[0] == -1.5
    assert cut(problem, 1, 1, -1.0, Fraction(1, 2), lower=np.zeros(2)).lo[1] == -INF
    none = Replay(problem, None)
    box = Interval(problem.lower, problem.upper)
    argument = dual(problem, (0, (), Fraction(1, 2)))
    step = Tightening(np.array([1]), np.array([1]), np.array([-1.0]), argument, True)
    assert none.step(step, box) is box
    both = replace(step, variable=np.array([0, 1]), side=np.ones(2, int), value=-np.ones(2))
    assert np.all(Replay(problem, 1.0).step(both, box).lo == -INF)


def test_a_false_claim_is_not_verified():
    problem = sp.Problem(x + y, [x + y == 1])
    node = Node(argument=dual(problem, (0, (), 1)))
    assert Certificate(problem.fingerprint, 1.0, node).verify(problem).ok
    assert not Certificate(problem.fingerprint, 1.0 + 2.0**-52, node).verify(problem).ok


def test_files_keep_every_digit():
    problem = sp.Problem(x + y, [3 * x + 3 * y == 1])
    long = Fraction(1, 3) + Fraction(1, 7**200) - Fraction(1, 7**200)
    node = Node(argument=dual(problem, (0, (), long), gram=None))
    claimed = node.argument.bound(problem.rows, problem.equality, problem.objective)
    text = sp.to_json(Certificate(problem.fingerprint, claimed, node))
    again = sp.from_json(text)
    assert again.root.argument.value == (Fraction(1, 3),)
    assert again.verify(problem).ok
    for other in ('"1/0"', '"0.5"', '"1/-3"', '" 1/3"', "0.5", f'"{"7" * 5000}"'):
        with pytest.raises(sp.ProblemError, match="a rational number"):
            sp.from_json(text.replace('"1/3"', other))
