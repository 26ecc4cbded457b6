"""Problems with ratios: closed forms, literature, refusals."""

import math
from dataclasses import replace

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.budget import Deadline, charge
from sparsepop_py.rational.denominators import prove_ranges
from sparsepop_py.rational.descent import descended, sampled
from sparsepop_py.rational.solve import solve_rational


def closed(problem, value, options=None, accuracy=3e-6):
    result = sp.solve(problem, options)
    assert result.status is sp.Status.OPTIMAL
    assert result.lower_bound <= value <= result.upper_bound
    assert result.upper_bound - result.lower_bound <= accuracy
    assert result.certificate.verify(problem).ok
    assert result.problem.violation(result.x) <= 1e-6
    return result


def test_one_ratio_without_bounds():
    (x,) = sp.variables(1)
    result = closed(sp.RationalProblem(x / (1 + x**2)), -0.5)  # (x + 1)^2 >= 0
    assert result.x[0] == pytest.approx(-1, abs=1e-2)
    assert result.certificate.level is not None


def test_one_ratio_beside_a_constant():
    (x,) = sp.variables(1)
    closed(sp.RationalProblem(3 - 2 * x / (1 + x**2)), 2.0)


def test_a_negative_denominator():
    x, y = sp.variables(2)
    result = closed(sp.RationalProblem(x / (y - 5), lower=-2, upper=2), -2 / 3)
    assert result.certificate.ranges[0].sign == -1


def test_linear_fractional_on_a_disc():
    # y / (x + 2) on the unit disc: the tangent from (-2, 0) has slope 1 / sqrt(3)
    x, y = sp.variables(2)
    closed(sp.RationalProblem(y / (x + 2), [x**2 + y**2 <= 1]), -1 / math.sqrt(3))


def test_a_sum_of_ratios_in_different_variables():
    x, y = sp.variables(2)
    objective = x / (1 + x**2) + (y**2 - y) / (2 + y**2)
    # second: (y^2 - y) / (2 + y^2) has its minimum where y^2 + 4 y - 2 = 0
    root = math.sqrt(6) - 2
    value = -0.5 + (root**2 - root) / (2 + root**2)
    result = closed(sp.RationalProblem(objective, lower=-4, upper=4), value)
    assert result.certificate.level is None and len(result.certificate.ranges) == 2


def test_bugarin_henrion_lasserre_rosenbrock():
    # Math. Prog. Comp. 8 (2016), section 3: max sum 1 / (100 (x_{i+1} - x_i^2)^2 + (x_i - 1)^2 + 1)
    # is n - 1, attained at (1, ..., 1).
    n = 4
    x = sp.variables(n)
    terms = [
        1 / (100 * (x[i + 1] - x[i] ** 2) ** 2 + (x[i] - 1) ** 2 + 1) for i in range(n - 1)
    ]  # fmt: skip
    problem = sp.RationalProblem(-sum(terms[1:], terms[0]), lower=-16, upper=16)
    closed(problem, -(n - 1.0), sp.Options(effort="auto", time_limit=30))


def test_constraints_of_one_ratio_and_of_several():
    # x / (1 + y^2) >= 1 and 1 / (1 + x^2) + 1 / (1 + y^2) >= 1/2: x >= 1 + y^2; minimise x + y:
    # on x = 1 + y^2 the sum has its minimum 3/4 at y = -1/2, where the second row holds.
    x, y = sp.variables(2)
    rows = [x / (1 + y**2) >= 1, 1 / (1 + x**2) + 1 / (1 + y**2) >= 0.5]
    result = closed(sp.RationalProblem(x + y, rows, lower=-3, upper=3), 0.75)
    np.testing.assert_allclose(result.x, [1.25, -0.5], atol=1e-3)


def test_an_equation_with_a_negative_denominator():
    # (x + 1) / (x - 4) == -1 on [-2, 2] means x = 3/2
    (x,) = sp.variables(1)
    closed(sp.RationalProblem(x, [(x + 1) / (x - 4) == -1], lower=-2, upper=2), 1.5)


def test_maximising_row_with_a_negative_denominator():
    # x / (x - 4) >= 1/3 on [-2, 2] means 3 x <= x - 4, x <= -2: one point
    (x,) = sp.variables(1)
    closed(sp.RationalProblem(x, [x / (x - 4) >= 0.25], lower=-2, upper=2), -2.0)
    problem = sp.RationalProblem(-x, [x / (x - 4) >= 0.25], lower=-2, upper=2)
    closed(problem, 4 / 3)  # 4 x <= x - 4


def test_an_empty_base_and_an_empty_row():
    x, y = sp.variables(2)
    empty = sp.RationalProblem(x / (y - 5), [x + y >= 10], lower=-2, upper=2)
    result = sp.solve(empty)
    assert result.status is sp.Status.INFEASIBLE and result.certificate.verify(empty).ok
    row = sp.RationalProblem(x, [x / (1 + y**2) >= 3], lower=-2, upper=2)
    result = sp.solve(row)
    assert result.status is sp.Status.INFEASIBLE and result.certificate.verify(row).ok


def test_denominators_whose_sign_is_not_proved_are_refused_by_name():
    x, y = sp.variables(2)
    with pytest.raises(sp.DenominatorError, match=r"denominator x1 - x2: .*-4\S* <= q <= 4"):
        sp.solve(sp.RationalProblem(1 / (x - y), lower=-2, upper=2))
    with pytest.raises(sp.DenominatorError, match="denominator x1"):
        sp.solve(sp.RationalProblem(y / x, lower=0, upper=2))  # zero at the edge


@pytest.mark.parametrize(
    ("limits", "helps"),
    [({"work_limit": 10}, True), ({"time_limit": 100}, False), ({"work_limit": math.inf}, False)],
)
def test_larger_limits_are_advised_where_they_help(limits, helps):
    # a denominator takes at most 20 seconds or units of work, and half of a limit
    x, y = sp.variables(2)
    motzkin = 1.5 + x**2 * y**2 * (x**2 + y**2 - 3)  # no sum of squares, at least 1/2

    def plain(problem, options):
        return sp.solve(problem, replace(options, effort="plain", refine="none"))

    with pytest.raises(sp.DenominatorError, match="its sign is not proved") as caught:
        prove_ranges(sp.RationalProblem(1 / motzkin), sp.Options(**limits), plain)
    assert ("or a larger limit" in str(caught.value)) == helps


def test_a_sign_that_intervals_do_not_see():
    # 1.1 - x y > 0 on the disc of radius 1.4, where x y <= 0.98
    x, y = sp.variables(2)
    problem = sp.RationalProblem(x / (1.1 - x * y), [x**2 + y**2 <= 1.96])
    result = sp.solve(problem)
    assert result.status is sp.Status.OPTIMAL and result.certificate.verify(problem).ok
    assert result.certificate.ranges[0].below.bound == pytest.approx(0.12, abs=1e-4)


def test_unlike_problems_are_refused():
    (x,) = sp.variables(1)
    problem = sp.RationalProblem(x / (1 + x**2), lower=-3, upper=3)
    other = sp.RationalProblem(x / (1 + 2 * x**2), lower=-3, upper=3)
    certificate = sp.solve(problem).certificate
    assert certificate.verify(other).reason == "the certificate belongs to another problem"


def test_no_bound_lies_above_sampled_points():
    generator = np.random.default_rng(5)
    for _ in range(6):
        x, y = sp.variables(2)
        a, b, c, d = (float(v) for v in generator.integers(-3, 4, 4))
        objective = (a * x * y + b * x - 1) / (2 + x**2 + 0.3 * y) + (c * y + d) / (4 - x * y)
        rows = [(x + 2) / (3 - y) >= 0.5]
        problem = sp.RationalProblem(objective, rows, lower=-1, upper=1)
        result = sp.solve(problem)
        points = generator.uniform(-1, 1, (4000, 2))
        feasible = rows[0].expression(points) >= 0
        assert feasible.any()
        assert result.lower_bound <= objective(points)[feasible].min()
        assert result.certificate.verify(problem).ok


def test_wrong_arguments():
    x, y = sp.variables(2)
    with pytest.raises(sp.ProblemError, match=r"sp\.RationalProblem|RationalProblem"):
        sp.Problem(x / (1 + y**2))
    with pytest.raises(sp.ProblemError, match="objective: found str"):
        sp.RationalProblem("x")
    with pytest.raises(sp.ProblemError, match="width"):
        sp.solve(sp.RationalProblem(1 / (1 + x**2)), sp.Options(gap_kind="width"))
    with pytest.raises(sp.ProblemError, match="start: found shape"):
        sp.solve(sp.RationalProblem(1 / (1 + x**2)), start=[1.0])


def test_descent_ends_at_a_minimum_of_the_ratios():
    # 1 - 1 / (1 + (x - 3)^2 + (y + 1)^2) has its only minimum, 0, at (3, -1)
    x, y = sp.variables(2)
    problem = sp.RationalProblem(1 - 1 / (1 + (x - 3) ** 2 + (y + 1) ** 2), lower=-5, upper=5)
    found = descended(problem, np.array([1.0, 1.0]), Deadline(None))
    np.testing.assert_allclose(found, [3, -1], atol=1e-4)
    np.testing.assert_array_equal(descended(problem, found, Deadline(0.0)), found)


def test_samples_are_feasible():
    x, y = sp.variables(2)
    rows = [x / (3 - y) >= 0.1, x + y <= 1]
    problem = sp.RationalProblem(x / (4 + y), rows, lower=-3, upper=[2, 2])
    found = sampled(problem, 0)
    assert found is not None and problem.violation(found) <= 0
    assert sampled(sp.RationalProblem(x / (4 + y), [x + y == 0.123], lower=-3), 0) is None


def test_many_ratios_in_a_chain():
    # max of sum 1 / q_i over q_i >= 1 with equality at (1, ..., 1): n - 1
    n = 8
    x = sp.variables(n)
    pairs = [
        (0 * x[0] - 1, 100 * (x[i + 1] - x[i] ** 2) ** 2 + (x[i] - 1) ** 2 + 1)
        for i in range(n - 1)
    ]
    problem = sp.RationalProblem(sp.Rational.of(0 * x[0], pairs), lower=-16, upper=16)
    result = closed(problem, -(n - 1.0), sp.Options(effort="auto"))
    # each denominator is 1 plus squares: an exact sum of squares proves it without any box
    assert all(proof.below.bound == 1.0 for proof in result.certificate.ranges)


def test_falling_ratios_are_unbounded():
    x, y = sp.variables(2)
    problem = sp.RationalProblem(x + 1 / (1 + y**2), [y <= 1, y >= -1])  # x is free
    result = sp.solve(problem)
    assert result.status is sp.Status.UNBOUNDED and result.upper_bound == -math.inf
    assert sp.from_json(sp.to_json(result)).status is sp.Status.UNBOUNDED


def test_a_short_limit_keeps_what_is_proved():
    x = sp.variables(6)
    terms = [(x[i] * x[i - 1] - x[i], 2 + x[i] ** 2 + x[i - 1] ** 2) for i in range(6)]
    problem = sp.RationalProblem(sp.Rational.of(0 * x[0], terms), lower=-2, upper=2)
    result = sp.solve(problem, sp.Options(effort="auto", time_limit=0.2))
    assert result.lower_bound <= result.upper_bound
    assert result.certificate.verify(problem).ok or result.lower_bound == -math.inf


def test_no_range_is_sharpened_after_the_end():
    """With 60 ratios a limit of 0.05 CPU seconds was exceeded by 4."""
    asked = []

    def solved(problem, options, **named):
        asked.append(options.cpu_limit)
        charge(1.0)
        return sp.solve(problem, options, **named)

    x = sp.variables(6)
    objective = sum(x[i] / (1 + x[i] ** 2 + x[i - 1] ** 2) for i in range(6))
    problem = sp.RationalProblem(objective, lower=-2, upper=2)
    solve_rational(problem, sp.Options(effort="auto", cpu_limit=0.8), None, solved)
    assert len(asked) == 2  # one range, and the problem of all reciprocals


def test_ranges_that_are_sharpened_count_as_work():
    """Of boxes alone their bounds follow without a solver, whose iterations would count."""
    x = sp.variables(6)
    objective = sum(x[i] / (1 + x[i] ** 2 + x[i - 1] ** 2) for i in range(6))
    problem = sp.RationalProblem(objective, lower=-2, upper=2)
    asked = []

    def solved(problem, options, **named):
        asked.append(options.work_limit)
        return sp.solve(problem, options, **named)

    solve_rational(problem, sp.Options(effort="auto", work_limit=0.1), None, solved)
    assert len(asked) < 4


def test_a_level_is_a_double():
    """An integer that is no double once moved the bound above the minimum."""
    result = sp.solve(sp.parse("min x/(2 + x^2); s.t. x^2 <= 1"))
    with pytest.raises(sp.ProblemError, match="level: found"):
        replace(result.certificate, level=2**60 + 127)


def test_cpu_seconds_that_solvers_spend_elsewhere_count():
    """Large programs are solved in a process of their own; what it spends is of the limit."""
    asked = []

    def solved(problem, options, **named):
        asked.append(options.cpu_limit)
        charge(3.0)
        return sp.solve(problem, options, **named)

    x, y = sp.variables(2)
    problem = sp.RationalProblem(y / (x + 2), [x**2 + y**2 <= 1])  # two levels at least
    solve_rational(problem, sp.Options(cpu_limit=100.0), None, solved)
    assert len(asked) > 1
    assert all(later <= earlier - 3.0 for earlier, later in zip(asked, asked[1:], strict=False))


@pytest.mark.slow
@pytest.mark.parametrize(
    "objective",
    [
        lambda x, y: sp.ratio(-(x**2), x**2 + 1),
        pytest.param(
            lambda x, y: sp.ratio(-(x**2) - y**2, x**2 + 2 * y**2 + 1), marks=pytest.mark.slow
        ),
        lambda x, y: 3 - sp.ratio(x**2, x**2 + y**2 + 1),
    ],
)
def test_infima_that_are_reached_far_away_are_bounded(objective):
    """Along x the ratio falls to -1 and never reaches it: levels above it have no bound."""
    ratio = objective(*sp.variables(2))
    found = sp.solve(sp.RationalProblem(ratio), sp.Options(time_limit=30))
    infimum = -1.0 if ratio.whole.constant_term == 0 else 2.0
    assert infimum - 0.1 <= found.lower_bound <= infimum
    assert found.certificate.verify(found.problem).ok
