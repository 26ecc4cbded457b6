"""The plain relaxation under SparsePOP's switches: sizes, values, and what is proved.

Sizes and values marked "3.03" are those of SparsePOP 3.03 with SeDuMi 1.3.7 under GNU Octave 7.3.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from relaxed import assert_rows_hold
from slow_values import slow_after

import sparsepop_py as sp
from sparsepop_py.errors import ProblemError
from sparsepop_py.relaxation.sparsepop.reduction import reduce_program
from sparsepop_py.relaxation.sparsepop.relaxation import Switches, plain_relaxation
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaled, Scaling
from sparsepop_py.verified.certificate.sos_identity import Identity, Priced

LABORATORY = 52.70660654  # the minimum, by local searches from many starts and by certificates


def call(problem: sp.Problem, **param: Any) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return sp.sparsePOP(problem, {"printLevel": 0, "tighten": 0, **param})


def laboratory(low: float, high: float) -> sp.Problem:
    x, y = sp.variables(2)
    objective = x**2 + y**2 - 4 * x - 6 * y + 13
    return sp.Problem(objective, [x * y - 7 * x * 0 - 7 * y == 10, y + 0.5 * x >= 1], low, high)


def e09() -> sp.Problem:
    """GLOBALLib st_e09: minimum -1/2."""
    x, y = sp.variables(2)
    return sp.Problem(-2 * x * y, [4 * x * y + 2 * x + 2 * y <= 3], 0, 1)


def e23() -> sp.Problem:
    """GLOBALLib st_e23: minimum -13/12."""
    x, y = sp.variables(2)
    return sp.Problem(x * y - x - y, [8 * y - 6 * x <= 3, 3 * x - y <= 3], 0, 5)


def cut(n: int) -> sp.Problem:
    """A largest cut of the complete graph: the minimum of x'x - n over signs of n variables."""
    x = sp.variables(n)
    pairs = sp.total(x[i] * x[j] for i in range(n) for j in range(i))
    return sp.Problem(pairs, [v**2 == 1 for v in x])


def sizes(output: Any) -> tuple[int, ...]:
    info = output.SDPinfo
    blocks = info.SDPblock
    return (
        *(info.rowSizeA, info.colSizeA, info.noOfFreevar, info.noOfLPvariables),
        *(len(blocks), max(blocks, default=0)),
    )


INF = np.inf
# problem, order, (rows, columns, free, linear, blocks, largest), value: 3.03
PUBLISHED = [
    (e09, (), 3, (25, 256, 0, 12, 6, 8), -0.5),
    (e09, (), 1, (5, 17, 0, 8, 1, 3), -1.5),
    (e23, (), 2, (9, 66, 0, 3, 7, 3), -1.083333336),
    (e23, (), 1, (5, 18, 0, 9, 1, 3), -3.0),
    (laboratory, (-INF, INF), 1, (5, 11, 1, 1, 1, 3), 28.55555556),
    (laboratory, (-INF, INF), 2, (12, 31, 6, 0, 2, 4), None),  # its solver failed from here on
    (laboratory, (-INF, INF), 3, (25, 115, 15, 0, 2, 8), None),
    (laboratory, (-INF, INF), 4, (42, 297, 28, 0, 2, 13), None),
    (laboratory, (-INF, INF), 5, (63, 631, 45, 0, 2, 19), None),
    (laboratory, (0, 20), 1, (5, 18, 1, 8, 1, 3), 28.99999958),
    (laboratory, (0, 20), 2, (12, 75, 6, 8, 6, 4), 52.70660419),
    (laboratory, (0, 20), 3, (25, 271, 15, 12, 6, 8), 52.70660454),
]


@pytest.mark.parametrize(("make", "box", "order", "expected", "value"), PUBLISHED)
def test_values_are_those_of_the_original(
    make: Any, box: Any, order: int, expected: tuple[int, ...], value: float | None
) -> None:
    output = call(make(*box), relaxOrder=order, SDPsolverSW=int(value is not None))
    assert sizes(output) == expected
    if value is not None:
        assert output.POP.solverValue == pytest.approx(value, rel=1e-5)
    if value is not None and np.isfinite(output.SDPobjValue):
        assert output.SDPobjValue <= output.POP.solverValue + 1e-7
        assert output.POP.certificate.verify(output.POP.result.problem).ok


@pytest.mark.parametrize(
    ("make", "n", "expected"),
    [
        (sp.problems.rosenbrock, 40, (388, 1384, 0, 0, 39, 6)),
        (sp.problems.chained_singular, 200, (3974, 19800, 0, 0, 198, 10)),
        (sp.problems.chained_wood, 200, (899, 2491, 0, 0, 199, 4)),
    ],
)
def test_sizes_of_chains(make: Any, n: int, expected: tuple[int, ...]) -> None:
    """3.03, Rosenbrock(40, 0), ChainedSingular(200) and ChainedWood(200) at order 2."""
    assert sizes(call(make(n), relaxOrder=2, SDPsolverSW=0)) == expected


def test_signs_are_substituted() -> None:
    """3.03, genMAXCUT(8, 1), order 2: 162 x 1369, one block of 37; -4 is the least here."""
    output = call(cut(8), relaxOrder=2)
    assert sizes(output) == (162, 1369, 0, 0, 1, 37)
    assert output.POP.solverValue == pytest.approx(-4, abs=1e-5)


@pytest.mark.parametrize(
    "order", [3, *(pytest.param(d, marks=pytest.mark.slow) for d in (1, 2, 4, 5))]
)
def test_values_of_the_laboratory_problem(order: int) -> None:
    """3.03 without bounds: 87.4 at order 3, infeasible from order 4 on."""
    output = call(laboratory(-INF, INF), relaxOrder=order)
    assert output.SDPobjValue <= LABORATORY
    assert output.POP.status is not sp.Status.INFEASIBLE


def test_a_solution_with_large_errors_is_called_one() -> None:
    """The objective has a range of 1e6 on the box: digits of the solver are missing."""
    output = call(laboratory(-1e3, 1e3), relaxOrder=4)
    assert output.SDPsolverInfo.r0 > 1e-7 and output.SDPsolverInfo.numerr == 1
    assert output.SDPobjValue <= LABORATORY


def test_a_fraction_is_kept_and_lies_between_orders() -> None:
    x, y, z = sp.variables(3)
    problem = sp.Problem(x * y - z, [x * z == 0.5, x + y + z <= 2], -1, 1)
    low, middle, high = (call(problem, relaxOrder=d) for d in (1, 1.5, 2))
    assert middle.param.relaxOrder == 1.5
    assert middle.SDPinfo.noOfFreevar == 4  # the equation times polynomials of degree 2 * 0.5
    assert low.SDPinfo.noOfFreevar < 4 < high.SDPinfo.noOfFreevar
    values = [output.POP.solverValue for output in (low, middle, high)]
    assert values[0] <= values[1] + 1e-6
    assert values[1] <= values[2] + 1e-6


def test_merged_cliques_grow_the_blocks() -> None:
    """Two cliques of three share a variable; its bounds may have multipliers in all five."""
    x = sp.variables(5)
    problem = sp.Problem(x[0] * x[1] * x[2] + x[2] * x[3] * x[4], (), -1, 1)
    single = call(problem, relaxOrder=2)
    merged = call(problem, relaxOrder=2, multiCliquesFactor="any")
    assert max(merged.SDPinfo.SDPblock) >= max(single.SDPinfo.SDPblock)
    assert sum(merged.SDPinfo.SDPblock) == sum(single.SDPinfo.SDPblock) + 2 * 2
    assert merged.POP.solverValue >= single.POP.solverValue - 1e-7
    assert single.POP.solverValue == pytest.approx(-2, abs=1e-5)
    with pytest.raises(ProblemError, match=r"multiCliquesFactor: found 6, expected .* dimVar \(5"):
        call(problem, multiCliquesFactor=6)


def test_a_variable_with_one_bound_is_counted_from_there() -> None:
    """Then y == x + 10 has no constant, and its multipliers need fewer moments."""
    x, y, z = sp.variables(3)
    low, high = [-10, 0, 0], [INF, 20, 1]
    rows = [y - x == 10, z * y <= 5]
    given = sp.Problem(x * z - y, rows, low, high)
    moved = sp.Problem((x - 10) * z - y, [y - x == 0, z * y <= 5], [0, 0, 0], high)
    shifted, by_hand = (call(problem, relaxOrder=2) for problem in (given, moved))
    assert sizes(shifted) == sizes(by_hand)
    assert shifted.POP.solverValue == pytest.approx(by_hand.POP.solverValue, abs=1e-6)
    assert shifted.SDPinfo.bVect.tolist() == [-10, 0, 0]
    bare = call(given, relaxOrder=2, scalingSW=0)
    assert bare.SDPinfo.bVect.tolist() == [0, 0, 0]
    above = sp.Problem(-x * z - y, [y + x == 10, z * y <= 5], [-INF, 0, 0], [10, 20, 1])
    assert call(above, relaxOrder=2).SDPinfo.rowSizeA == shifted.SDPinfo.rowSizeA


def test_fixed_variables_leave_no_column() -> None:
    """The program is that of the problem without them."""
    x, y, z = sp.variables(3)
    with_it = sp.Problem(x * y - x + z, [x + y + z <= 1.25], [0, 0, 0.25], [1, 1, 0.25])
    x, y = sp.variables(2)
    without = sp.Problem(x * y - x + 0.25, [x + y <= 1], 0, 1)
    for order in (1, 2):
        one, other = (call(problem, relaxOrder=order) for problem in (with_it, without))
        assert sizes(one) == sizes(other)
        assert one.POP.solverValue == pytest.approx(other.POP.solverValue, abs=1e-6)


@pytest.mark.parametrize("make", [e09, e23, lambda: laboratory(0, 20)])
def test_the_unscaled_program_has_the_same_value(make: Any) -> None:
    problem = make()
    scaled, bare = (call(problem, relaxOrder=2, scalingSW=s) for s in (1, 0))
    assert sizes(scaled) == sizes(bare)
    assert bare.POP.solverValue == pytest.approx(scaled.POP.solverValue, abs=1e-4)
    assert bare.SDPobjValue == pytest.approx(scaled.SDPobjValue, abs=1e-3)
    assert bare.POP.certificate.verify(problem).ok
    assert bare.SDPinfo.objValScale == 1.0
    # the data are the coefficients of the objective as given
    table = bare.SDPinfo.xIdxVec.toarray()
    for row, value in zip(
        problem.objective.exponents.toarray(), problem.objective.coefficients, strict=True
    ):
        if row.any():
            place = int(np.flatnonzero((table == row).all(axis=1))[0])
            assert -bare.SDPinfo.SeDuMib[place] == pytest.approx(value, rel=1e-9)


def test_bounds_of_moments() -> None:
    none, every, some = (call(e23(), relaxOrder=1, boundSW=s) for s in (0, 1, 2))
    linear = [output.SDPinfo.noOfLPvariables for output in (none, every, some)]
    assert linear == [6, 12, 9]  # three moments of degree two
    assert none.POP.solverValue <= some.POP.solverValue + 1e-6
    assert some.POP.solverValue == pytest.approx(every.POP.solverValue, abs=1e-6)
    for output in (none, every, some):
        assert output.SDPobjValue <= -13 / 12


def test_reduced_moment_matrices() -> None:
    whole, reduced = (call(e23(), relaxOrder=2, reduceMomentMatSW=s) for s in (0, 1))
    assert max(whole.SDPinfo.SDPblock) == 6
    assert max(reduced.SDPinfo.SDPblock) == 3
    assert whole.POP.solverValue == pytest.approx(reduced.POP.solverValue, abs=1e-6)


@pytest.mark.parametrize("size", slow_after(1, [1e-2, 1e-6]))
def test_a_perturbed_objective_proves_the_given_one(size: float) -> None:
    """All of the circle is optimal without the perturbation: first moments tell nothing."""
    x, y = sp.variables(2)
    problem = sp.Problem(x**2 + y**2, [x**2 + y**2 == 1], -1, 1)
    output = call(problem, relaxOrder=2, perturbation=size)
    assert output.param.perturbation == size
    assert 1 - 3 * size - 1e-6 < output.SDPobjValue <= 1
    assert output.POP.certificate.verify(problem).ok
    again = call(problem, relaxOrder=2, perturbation=size)
    assert again.POP.solverValue == output.POP.solverValue
    if size == 1e-2:
        assert np.linalg.norm(output.POP.xVect) == pytest.approx(1, abs=1e-2)
        assert np.linalg.norm(call(problem, relaxOrder=2).POP.xVect) < 0.9


def test_a_perturbation_passes_fixed_variables_by() -> None:
    """x^2 + 2x has its minimum -1 at x = -1; y = 2 is no unknown."""
    x, y = sp.variables(2)
    output = call(sp.Problem(x * y + x**2, [], [-3, 2], [3, 2]), relaxOrder=2, perturbation=1e-3)
    assert -1.01 < output.SDPobjValue <= -1


def test_substitutions() -> None:
    """Equations leave the program, and its value stays what it was with them."""
    x, y, z = sp.variables(3)
    rows = [x * y == 0, z == 0.5, x + y + z <= 1.25]
    problem = sp.Problem(-x - 2 * y + x * z - 0.25 * y**2, rows, 0, 1)
    on = call(problem, relaxOrder=2, complementaritySW=1)
    off = call(problem, relaxOrder=2, reduceAMatSW=0)
    assert on.SDPinfo.noOfFreevar == 0
    assert off.SDPinfo.noOfFreevar == 2 * 10
    assert on.SDPinfo.rowSizeA < off.SDPinfo.rowSizeA
    assert (on.SDPinfo.reduceAMatSW, off.SDPinfo.reduceAMatSW) == (1, 0)
    minimum = -2 * 0.75 - 0.25 * 0.75**2  # y = 3/4, by the two branches
    for output in (on, off):
        assert output.POP.solverValue == pytest.approx(minimum, abs=1e-5)
        assert minimum - 1e-4 < output.SDPobjValue <= minimum
        assert output.POP.certificate.verify(problem).ok


@pytest.mark.parametrize(
    ("objective", "row", "box", "minimum"),
    [
        (lambda x: x**3, lambda x: x**2 == 4, 5, -8),
        (lambda x: x**3, lambda x: x**2 == 4, INF, -8),
        (lambda x: -(x**2), lambda x: x**2 == 3 * x, 10, -9),
        (lambda x: x - x**3, lambda x: x**2 == 3 * x, INF, -24),
    ],
)
def test_squares_with_any_coefficient(objective: Any, row: Any, box: float, minimum: float) -> None:
    """3.03 on its MATLAB path: -50, -2, -30 for the first three."""
    (x,) = sp.variables(1)
    problem = sp.Problem(objective(x), [row(x)], -box, box)
    output = call(problem, relaxOrder=2)
    assert output.SDPinfo.noOfFreevar == 0
    assert output.POP.solverValue == pytest.approx(minimum, abs=1e-4)
    assert output.SDPobjValue <= minimum
    kept = call(problem, relaxOrder=2, SquareOneSW=0, binarySW=0)
    assert kept.SDPinfo.noOfFreevar > 0
    assert kept.POP.solverValue == pytest.approx(minimum, abs=1e-4)


# ---- properties -----------------------------------------------------------------------------


def mixed() -> sp.Problem:
    """Boxes, a binary, a sign, a complementarity, an equation, one-sided and free variables."""
    x = sp.variables(6)
    rows = [
        x[0] ** 2 == x[0],
        x[1] ** 2 == 1,
        x[2] * x[3] == 0,
        x[2] + x[3] + x[4] >= 0.5,
        x[4] - x[5] == 0.25,
        4 - x[4] ** 2 - x[1] * x[2] >= 0,
    ]
    objective = x[0] * x[1] + x[2] ** 2 * x[4] - x[3] + x[5] ** 2
    lower = [0, -1, 0, 0, -INF, -INF]
    return sp.Problem(objective, rows, lower, [1, 1, 3, 2, INF, INF])


POINTS = [[1, -1, 0, 1.5, 0.25, 0], [0, 1, 2, 0, 1.25, 1], [1, 1, 0, 0, 0.5, 0.25]]


@pytest.mark.parametrize("order", [1.0, 2.0, 2.5])
@pytest.mark.parametrize("scaled", [True, False])
@pytest.mark.parametrize("kinds", [(), ("square", "binary", "fixed", "zero")])
def test_point_masses_satisfy_every_row(order: float, scaled: bool, kinds: tuple[str, ...]) -> None:
    problem = mixed()
    scaling = Scaling.of_bounds(Interval(problem.lower, problem.upper), scaled)
    assert scaling.contains(Interval(problem.lower, problem.upper))
    whole = Scaled.of(problem, scaling, (problem.objective,), whole=True)
    switches = Switches(order=order, scaled=scaled, substituted=kinds, moment_bounds=1)
    cliques = sp.find_cliques(whole.problem)
    relaxation = plain_relaxation(whole.problem, cliques, (), switches)
    small = reduce_program(relaxation, whole, whole.problem.objective, switches)
    for point in POINTS:
        assert problem.violation(point) == 0
        t = (np.array(point) - scaling.centre) / scaling.scale
        y = np.array([np.prod(t[row[row > 0] - 1]) for row in relaxation.moments])
        for program, moments in (
            (small.whole, y),
            (small.program, y[small.moments] * small.moment_scale),
        ):
            value = problem.objective(point)
            size = whole.objective_sizes[0] / (1.0 if program is small.whole else small_unit(small))
            assert (program.q @ moments + program.offset) * size == pytest.approx(value)
            assert_rows_hold(program, moments)


def small_unit(small: Any) -> float:
    return small.objective_scale


@given(st.integers(0, 10**6))
@settings(max_examples=60, deadline=None)
def test_prices_of_monomials_are_below_their_values(seed: int) -> None:
    """Whatever multiples of monomials are priced, f stays above what is claimed."""
    rng = np.random.default_rng(seed)
    low = rng.choice([-2.0, -0.5, 0.0, 0.25], 2)
    high = low + rng.choice([0.5, 1.0, 3.0], 2)
    scaling = Scaling.of_bounds(Interval(low, high))
    words = np.sort(rng.integers(0, 3, (4, 3)).astype(np.int32), axis=1)
    priced = Priced(words, rng.normal(size=4))
    x, y = sp.variables(2)
    problem = sp.Problem(x * y + x, (), low, high)
    found = Identity(scaling, (), priced=priced).evaluate(
        problem.rows, problem.equality, problem.objective_row
    )
    points = low + (high - low) * rng.random((200, 2))
    t = points / scaling.scale
    values = np.array([[np.prod(p[w[w > 0] - 1]) for w in words] for p in t]) @ priced.values
    assert priced.least(scaling) <= values.min()
    assert found.bound <= problem.objective(points).min()


def test_malformed_prices_and_ends_prove_nothing() -> None:
    (x,) = sp.variables(1)
    problem = sp.Problem(x, (), 1, 2)
    box = Interval(problem.lower, problem.upper)
    good = Scaling.of_bounds(box)
    one = np.array([[1]], np.int32)

    def bound(scaling: Scaling, priced: Priced) -> float:
        identity = Identity(scaling, (), priced=priced)
        if not scaling.contains(box):
            return -INF
        return identity.evaluate(problem.rows, problem.equality, problem.objective_row).bound

    size = float(good.scale[0])
    assert 1 - 1e-9 < bound(good, Priced(one, np.array([size]))) <= 1
    assert bound(good, Priced(one, np.array([np.nan]))) == -INF
    assert bound(good, Priced(one * 2, np.ones(1))) == -INF
    assert bound(good, Priced(one, np.ones(2))) == -INF
    for low, high in ((0.9, 1.0), (0.0, 0.9), (-2.0, 1.0), (0.0, 2.0), (np.nan, 1.0), (1.0, 0.0)):
        ends = np.array([low]), np.array([high])
        wrong = Scaling(good.centre, good.scale, good.boxed, good.side, ends)
        assert not wrong.contains(box)


def test_switches_are_checked() -> None:
    with pytest.raises(ProblemError, match=r"Switches.substituted: found 'cube', expected"):
        Switches(substituted=("cube",))
    with pytest.raises(ProblemError, match=r"Switches.moment_bounds: found 3, expected an integer"):
        Switches(moment_bounds=3)
    with pytest.raises(ProblemError, match=r"Switches.merge: found -1, expected a number >= 0"):
        Switches(merge=-1)
    with pytest.raises(ProblemError, match=r"Options.switches: found them with effort 'presolve'"):
        sp.Options(switches=Switches())
