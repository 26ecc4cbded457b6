"""Trusted parts of problems with ratios, against numbers by hand and exact fractions."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.problem.rational_problem import Range
from sparsepop_py.rational.result import attained_value
from sparsepop_py.verified.certificate.certificate import Certificate
from sparsepop_py.verified.certificate.rational_bound import (
    RangeProof,
    RationalCertificate,
    level_bound,
)

INF = np.inf


def by_intervals(problem, objective, bound):
    """Certificate of a bound that interval arithmetic over the given bounds proves."""
    return Certificate(problem.with_objective(objective).fingerprint, bound)


# ---- ranges ---------------------------------------------------------------------------------


@pytest.mark.parametrize("sign", [1, -1])
def test_reciprocals_are_rounded_outwards(sign):
    for least, most in ((3.0, 7.0), (0.1, 0.3), (1e-3, 1e300), (5e-324, 3.0)):
        low, high = Range(sign, least, most).reciprocal
        ends = sorted((sign / Fraction(least), sign / Fraction(most)))
        assert low == -INF or Fraction(low) <= ends[0]
        assert high == INF or Fraction(high) >= ends[1]
    assert Range(1, 2.0, INF).reciprocal == (0.0, 0.5)
    assert Range(-1, 2.0, INF).reciprocal == (-0.5, 0.0)


def test_thirds_are_not_rounded_inwards():
    low, high = Range(1, 3.0, 3.0).reciprocal
    assert Fraction(low) < Fraction(1, 3) < Fraction(high) and high - low < 1e-16


@pytest.mark.parametrize("numbers", [(0, 1.0, 2.0), (1, 0.0, 2.0), (1, -1.0, 2.0), (1, 3.0, 2.0)])
def test_what_is_no_range_is_refused(numbers):
    with pytest.raises(sp.ProblemError, match="range: found"):
        Range(*numbers)


def test_ranges_follow_from_certificates_of_the_base():
    (x,) = sp.variables(1)
    base, q = sp.Problem(0 * x, lower=1, upper=2), 3 * x - 8  # -5 <= q <= -2
    below, above = by_intervals(base, -q, 1.5), by_intervals(base, q, -6.0)
    assert RangeProof(-1, below, above).prove(base, q) == Range(-1, 1.5, 6.0)
    assert RangeProof(-1, below).prove(base, q) == Range(-1, 1.5, INF)
    # claims that are too large, of another objective, of the other sign, or that say nothing
    assert RangeProof(-1, by_intervals(base, -q, 2.5)).prove(base, q) is None
    assert RangeProof(-1, by_intervals(base, q, -6.0)).prove(base, q) is None
    assert RangeProof(1, by_intervals(base, q, -6.0)).prove(base, q) is None
    assert RangeProof(-1, by_intervals(base, -q, 0.0)).prove(base, q) is None
    assert RangeProof(-1, by_intervals(base, -q, -1.0)).prove(base, q) is None
    # an upper end that is not proved is none
    wrong = by_intervals(base, q, -4.0)
    assert RangeProof(-1, below, wrong).prove(base, q) == Range(-1, 1.5, INF)
    wide = sp.Problem(0 * x, lower=1, upper=3)
    assert RangeProof(-1, below).prove(wide, q) is None


@pytest.mark.parametrize("sign", [0, 2, True, 1.0])
def test_signs_are_one_or_minus_one(sign):
    with pytest.raises(sp.ProblemError, match="sign: found"):
        RangeProof(sign, Certificate("", 1.0))


# ---- levels ---------------------------------------------------------------------------------


def test_level_bounds_by_hand():
    (x,) = sp.variables(1)
    problem = sp.RationalProblem(10 + x / (1 + x**2))
    size = Range(1, 2.0, 4.0)
    assert level_bound(problem, 1.0, 0.0, size) == 11.0
    assert level_bound(problem, 1.0, -1.0, size) == 10.5  # -1 / 2
    assert level_bound(problem, 1.0, 1.0, size) == 11.25  # 1 / 4
    assert level_bound(problem, 1.0, 1.0, Range(1, 2.0, INF)) == 11.0
    assert level_bound(problem, 1.0, INF, size) == INF
    assert level_bound(problem, 1.0, -INF, size) == -INF
    third = level_bound(problem, 0.0, -1.0, Range(1, 3.0, 4.0))
    assert Fraction(third) < 10 - Fraction(1, 3) and third == pytest.approx(10 - 1 / 3, rel=1e-15)


def test_attained_values_by_hand():
    (x,) = sp.variables(1)
    problem = sp.RationalProblem(10 + x / (1 + x**2))
    ranges = [Range(1, 2.0, 4.0)]
    assert attained_value(problem, ranges, 1.0, 1.0) == 11.5
    assert attained_value(problem, ranges, 1.0, -1.0) == 10.75
    assert attained_value(problem, [Range(1, 2.0, INF)], 1.0, -1.0) == 11.0
    assert attained_value(problem, ranges, None, -1.0) == -1.0
    third = attained_value(problem, [Range(1, 3.0, 4.0)], 0.0, 1.0)
    assert Fraction(third) > 10 + Fraction(1, 3)


# ---- the polynomial problem -----------------------------------------------------------------


def mixed():
    x, y = sp.variables(2)
    rows = [
        x + y <= 3,
        x / (y - 5) >= 0.25,
        1 / (1 + x**2) + y / (y - 5) == 0.5,
        sp.second_order(2, x, y),
    ]
    return sp.RationalProblem(x * y + 0.1 * x / (1 + x**2) + 1 / (2 + y), rows, -1, 2)


def test_denominators_are_counted_once():
    problem = mixed()
    assert list(map(str, problem.denominators)) == ["1 + x1^2", "2 + x2", "-5 + x2"]
    assert problem.lifted_places() == (0, 1, 2) and problem.lifted_places(0.0) == (0, 2)
    x, y = sp.variables(2)
    rows = [x / (1 + y**2) >= 0, x / (2 + y**2) >= 0]
    assert len(sp.RationalProblem(x, rows).denominators) == 2


def exact(polynomial, point):
    """Value in rationals, term by term."""
    value = Fraction(0)
    for word, c in zip(polynomial.words.tolist(), polynomial.coefficients.tolist(), strict=True):
        term = Fraction(c)
        for letter in word:
            term *= point[letter - 1] if letter else 1
        value += term
    return value


def test_the_polynomial_problem_says_the_same():
    problem = mixed()
    ranges = [Range(1, 1.0, 5.0), Range(1, 1.0, 4.0), Range(-1, 3.0, 6.0)]
    lifted = problem.lifted(ranges)
    assert lifted.dimension == 5 and lifted.names == ("x1", "x2", "s1", "s2", "s3")
    np.testing.assert_allclose(lifted.lower, [-1, -1, 0.2, 0.25, -1 / 3], atol=1e-15)
    np.testing.assert_allclose(lifted.upper, [2, 2, 1, 1, -1 / 6], atol=1e-15)
    kinds = [row.kind.name for row in lifted.constraints]
    assert kinds == ["NONNEGATIVE", "SECOND_ORDER", *["ZERO"] * 3, "NONNEGATIVE", "ZERO"]
    x, y = Fraction(3, 7), Fraction(-2, 5)
    q = 1 + x * x, 2 + y, y - 5
    point = [x, y, *(1 / v for v in q)]
    tenth = Fraction(0.1)
    assert exact(lifted.objective, point) == x * y + tenth * x / q[0] + 1 / q[1]
    values = [exact(row.polynomial, point) for row in lifted.constraints]
    assert [exact(entry, point) for entry in lifted.constraints[1].entries] == [2, x, y]
    # the single fraction is sign times its numerator, x / (y - 5) - 1/4 = (x - y/4 + 5/4) / (y - 5)
    numerator = x - y / 4 + Fraction(5, 4)
    assert values == [3 - x - y, 2, 0, 0, 0, -numerator, 1 / q[0] + y / q[2] - Fraction(1, 2)]


def test_the_problem_of_a_level():
    x, y = sp.variables(2)
    problem = sp.RationalProblem(2 + x / (y - 5), [y / (1 + x**2) >= 0.5], lower=-1, upper=1)
    lifted = problem.lifted([Range(-1, 4.0, 6.0), Range(1, 1.0, 2.0)], 0.25)
    assert lifted.names[-1] == "level" and lifted.dimension == 3
    assert (lifted.lower[2], lifted.upper[2]) == (0.25, 0.25)
    a, b, c = Fraction(1, 3), Fraction(1, 7), Fraction(1, 4)
    assert exact(lifted.objective, [a, b, c]) == -(a - c * (b - 5))


def test_levels_that_do_not_fit_are_refused():
    x, y = sp.variables(2)
    for objective in (x + 1 / (1 + y**2), 1 / (1 + x**2) + 1 / (1 + y**2)):
        problem = sp.RationalProblem(objective)
        ranges = [Range(1, 1.0, INF)] * len(problem.denominators)
        with pytest.raises(sp.ProblemError, match="level: found"):
            problem.lifted(ranges, 0.0)
    with pytest.raises(sp.ProblemError, match="ranges: found 0, expected 1"):
        sp.RationalProblem(1 / (1 + x**2)).lifted([])


def test_fingerprints_tell_problems_apart():
    x, y = sp.variables(2)
    f = x / (1 + y**2)
    others = [
        sp.RationalProblem(f),
        sp.RationalProblem(f + 1),
        sp.RationalProblem(f * 2),
        sp.RationalProblem(x / (2 + y**2)),
        sp.RationalProblem(f, [f >= 0]),
        sp.RationalProblem(f, [f == 0]),
        sp.RationalProblem(f, [f <= 0]),
        sp.RationalProblem(f, [x >= 0]),
        sp.RationalProblem(f, lower=0),
        sp.RationalProblem(f + f * f),
    ]
    assert len({problem.fingerprint for problem in others}) == len(others)
    assert sp.RationalProblem(f, names=["a", "b"]).fingerprint == others[0].fingerprint


# ---- certificates ---------------------------------------------------------------------------


def by_hand():
    """x / (y - 5) over [1, 2] x [1, 2], at least -2/3 by interval arithmetic at the level -2/3."""
    x, y = sp.variables(2)
    problem = sp.RationalProblem(x / (y - 5), lower=1, upper=2)
    q = y - 5
    proof = RangeProof(-1, by_intervals(problem.base, -q, 2.5), by_intervals(problem.base, q, -4.5))
    level = -0.75
    lifted = problem.lifted([Range(-1, 2.5, 4.5)], level)
    # -(x + 0.75 (y - 5)) = 3.75 - x - 0.75 y >= 0.25 on the box
    inner = Certificate(lifted.fingerprint, 0.125)
    bound = level + 0.125 / 4.5 - 1e-9
    return problem, RationalCertificate(problem.fingerprint, bound, (proof,), level, inner)


def test_a_certificate_by_hand():
    problem, proof = by_hand()
    assert proof.verify(problem).ok
    recomputed = proof.verify(problem).bound
    assert Fraction(recomputed) <= Fraction(-3, 4) + Fraction(1, 4) / Fraction(9, 2)
    assert recomputed == pytest.approx(-0.75 + 0.25 / 4.5, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda p: replace(p, bound=-0.69), "proves less"),
        (lambda p: replace(p, ranges=()), "not as many ranges"),
        (lambda p: replace(p, ranges=p.ranges * 2), "not as many ranges"),
        (lambda p: replace(p, ranges=(replace(p.ranges[0], sign=1),)), "sign of the denominator"),
        (lambda p: replace(p, certificate=None), "no certificate"),
        (lambda p: replace(p, level=None), "another problem"),
        (lambda p: replace(p, level=-0.7), "another problem"),
        (lambda p: replace(p, level=INF), "level does not fit"),
        (lambda p: replace(p, certificate=replace(p.certificate, bound=1.0)), "less than"),
        (lambda p: replace(p, fingerprint="r1:other"), "another problem"),
    ],
)
def test_false_certificates_are_refused(change, reason):
    problem, proof = by_hand()
    verdict = change(proof).verify(problem)
    assert not verdict.ok and reason in verdict.reason


def test_each_denominator_has_a_range_of_its_own():
    """3 <= x + 2 <= 4 and 1/4 <= y - 7/4 <= 1/2 on [1, 2] x [2, 9/4]."""
    x, y = sp.variables(2)
    problem = sp.RationalProblem(1 / (x + 2) + 1 / (y - 1.75), lower=[1, 2], upper=[2, 2.25])
    wide, narrow = (
        RangeProof(1, by_intervals(problem.base, q, low))
        for q, low in ((x + 2, 2.5), (y - 1.75, 0.125))
    )
    found = RationalCertificate(problem.fingerprint, -INF, (wide, narrow))
    assert [size.least for size in found.proved_ranges(problem)] == [2.5, 0.125]
    for ranges in ((wide, wide), (narrow, narrow), (narrow, wide)):
        assert isinstance(replace(found, ranges=ranges).proved_ranges(problem), str)
    level = replace(found, bound=0.0, level=0.0, certificate=wide.below)
    assert "level does not fit" in level.verify(problem).reason


def test_a_polynomial_problem_has_another_kind_of_certificate():
    problem, proof = by_hand()
    assert not proof.verify(problem.base).ok


def test_an_empty_base_proves_that_nothing_is_feasible():
    x, y = sp.variables(2)
    problem = sp.RationalProblem(x / (y - 5), [x + y >= 10], lower=-2, upper=2)
    found = sp.solve(problem).certificate
    assert found.certificate is None and found.verify(problem) == (True, INF, "")
    full = sp.RationalProblem(x / (y - 5), [x + y >= 1], lower=-2, upper=2)
    assert not found.verify(full).ok
    assert not replace(found, fingerprint=full.fingerprint).verify(full).ok


def test_wrong_parts_are_refused():
    _, proof = by_hand()
    for change in ({"ranges": (1,)}, {"fingerprint": 1}, {"certificate": 1}):
        with pytest.raises(sp.ProblemError, match=next(iter(change))):
            replace(proof, **change)
    with pytest.raises(sp.ProblemError, match="below: found"):
        RangeProof(1, 2)
    with pytest.raises(sp.ProblemError, match="above: found"):
        RangeProof(1, Certificate("", 1.0), 2)
