"""The least factor on noise bounds: its problem by hand, and forged claims."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from math import inf
from types import SimpleNamespace

import numpy as np
import pytest
from identification_cases import laboratory_two_first

import setid
import sparsepop_py as sp
from setid.proofs.least_noise.noise_scale import (
    last_variable,
    linear_problem,
    problem_with_factor,
    proved_factor,
    rows_of_exact_readings,
    scaled_noise,
)

FIRST = setid.TransferFunction(1, 1)
QUICK = setid.Options(time_limit=60.0, progress=False)


def with_limit(found: setid.Consistency, limit: float, rows: float = 1.0) -> setid.Consistency:
    """The optimum of the linear problem at another limit, or of other rows, as a claim."""
    bounds = found.noise.bounds(found.formulation.data)
    given, known = found.formulation, found.formulation.regression
    assert known is not None
    noise = scaled_noise(bounds, limit)
    other = setid.formulate(given.data, given.model, noise, given.priors)
    regression = replace(known, target=rows * known.target)
    other = other if rows == 1.0 else replace(other, regression=regression)
    problem = linear_problem(other)
    (bound,) = sp.linear_bounds(problem, [last_variable(problem)])
    assert bound.x is not None
    return replace(
        found,
        scale=(bound.lower, bound.upper),
        theta=bound.x[:2],
        formulation=other,
        limit=limit,
        problem=problem,
        bound=bound,
    )


def test_a_call_that_a_check_does_not_take_is_no_verdict() -> None:
    data = laboratory_two_first()
    found = setid.consistency(data, FIRST, setid.Noise(equation=1.0))
    assert found.verify().ok
    with pytest.raises(TypeError, match="argument"):
        found.verify(data)  # type: ignore[call-arg]


def test_noise_with_constraints_over_the_record_has_no_factor() -> None:
    """What is attained within bounds need not have little energy."""
    found = setid.consistency(laboratory_two_first(), FIRST, setid.Noise(equation=1.0))
    small = setid.EnergyBound("equation", 1e-6)
    forged = replace(found, noise=setid.Noise(equation=1.0, constraints=[small]))
    assert "constraints over the record" in forged.verify().reason


@pytest.mark.parametrize("scale", [(0.0, np.nan), (np.nan, inf)])
def test_ends_that_are_no_numbers_are_not_attained(scale: tuple[float, float]) -> None:
    """NaN is not below infinity, so that nothing had to attain it."""
    found = setid.consistency(laboratory_two_first(), FIRST, setid.Noise(equation=1.0))
    nothing = replace(found, bound=None, result=None, refuted=None, theta=None)
    assert replace(nothing, scale=(0.0, inf)).verify().ok
    assert not replace(nothing, scale=scale).verify().ok


def test_exact_factors_are_those_of_the_noise_and_rows_as_given() -> None:
    """Half the noise needs twice the factor, and rows three times as large need three times."""
    found = setid.consistency(laboratory_two_first(), FIRST, setid.Noise(equation=1.0))
    assert with_limit(found, 1.0).verify().ok
    for limit, rows, factor in ((0.5, 1.0, 2.0), (2.0, 1.0, 0.5), (1.0, 3.0, 3.0)):
        claim = with_limit(found, limit, rows)
        assert claim.scale[0] == pytest.approx(factor * 0.3390283401, rel=1e-9)
        assert not claim.verify().ok
    low, high = found.scale
    assert not replace(found, scale=(high, high)).verify().ok
    assert not replace(found, scale=(low, low / 2)).verify().ok
    assert found.theta is not None
    for theta in (None, found.theta + 1.0):
        assert not replace(found, theta=theta).verify().ok
    assert found.bound is not None and found.bound.x is not None
    for x in (None, found.bound.x + 1.0):  # parameters of a point that is not that of the proof
        forged = replace(found, theta=found.theta + 1.0, bound=replace(found.bound, x=x))
        assert not forged.verify().ok
    assert found.bound is not None and found.bound.value is not None
    forged = replace(found.bound, lower=2 * low, upper=2 * low, value=2 * found.bound.value)
    assert not replace(found, scale=(2 * low, 2 * low), bound=forged).verify().ok


def test_what_is_proved_of_a_share_is_rounded_down() -> None:
    for share, limit in np.random.default_rng(0).uniform(0.1, 1.0, (200, 2)):
        proof = SimpleNamespace(certificate=SimpleNamespace(bound=float(share)))
        exact = Fraction(float(share)) * Fraction(float(limit))
        assert Fraction(proved_factor(proof, float(limit))) <= exact  # type: ignore[arg-type]
    beyond = SimpleNamespace(certificate=SimpleNamespace(bound=7.0))
    assert proved_factor(beyond, 0.5) <= 0.5  # type: ignore[arg-type]
    assert proved_factor(SimpleNamespace(certificate=None), 0.5) == 0.0  # type: ignore[arg-type]


def test_scaled_bounds_are_no_smaller_than_their_products() -> None:
    bounds = tuple(np.random.default_rng(k).uniform(0.0, 1.0, (50, 1)) for k in range(3))
    factor = 0.7
    found = scaled_noise(bounds, factor)
    for given, scaled in zip(bounds, (found.output, found.input, found.equation), strict=True):
        for one, other in zip(given.ravel(), np.ravel(scaled), strict=True):
            assert Fraction(float(other)) >= Fraction(float(one)) * Fraction(factor)


@pytest.fixture(scope="module")
def bracket() -> setid.Consistency:
    """A factor that the engine has enclosed, of a short record with output noise."""
    data = setid.IOData([4, -3, 2, 1, 2, -1.5], [0, -6.25, 1.175, 2.0875, 1.0, 4.0])
    box = setid.Box({"a1": (-0.5, -0.499), "b0": (2.0, 2.001)})
    return setid.consistency(data, FIRST, setid.Noise(output=0.5), [box], options=QUICK)


def test_lies_about_enclosed_factors_are_refused(bracket: setid.Consistency) -> None:
    low, high = bracket.scale
    assert bracket.verify().ok and bracket.result is not None and bracket.theta is not None
    assert not replace(bracket, scale=(1.001 * high, 2 * high)).verify().ok
    assert not replace(bracket, scale=(low, 0.999 * low)).verify().ok
    assert not replace(bracket, theta=bracket.theta + 1e-6, witness=None).verify().ok
    proof = bracket.result.certificate
    assert proof is not None
    share = proof.bound * bracket.limit  # of the limit, which is not 1
    alone = replace(bracket, refuted=None, scale=((1.0 - 1e-15) * share, high))
    assert alone.verify().ok and not replace(alone, scale=(1.001 * share, high)).verify().ok
    better = replace(bracket.result, certificate=replace(proof, bound=1.0))
    assert not replace(bracket, result=better, scale=(bracket.limit * 0.99, inf)).verify().ok
    bare = replace(bracket, result=None, refuted=None, witness=None)
    assert replace(bare, scale=(0.0, inf)).verify().ok
    assert not replace(bare, scale=(low, inf)).verify().ok
    assert not replace(bare, scale=(0.0, high)).verify().ok
    nothing = SimpleNamespace(empty=True, verify=lambda *_: False)
    claim = replace(bare, scale=(2 * high, inf), refuted=(2 * high, nothing))  # type: ignore[arg-type]
    assert not claim.verify().ok
    claim = replace(bracket, scale=(low, inf), box=nothing)  # type: ignore[arg-type]
    assert not claim.verify().ok


def test_the_factor_multiplies_every_bound() -> None:
    """Noise of 1 and errors of a half: at s = 1/4 unknowns and rows have a quarter of it."""
    data = setid.IOData([4.0, -3.0, 2.0], [1.0, -6.25, 1.175])
    noise = setid.Noise(output=1.0, equation=0.5)
    known = setid.formulate(data, FIRST, noise)
    problem, layout = problem_with_factor(known, None), known.layout
    assert problem.lower[-1] == 0.0 and problem.upper[-1] == 1.0
    assert problem.objective(np.append(np.zeros(known.problem.dimension), 0.25)) == 0.25
    eta = layout.group("eta")
    eta = eta[eta >= 0]
    count = known.problem.dimension
    base = np.zeros(count + 1)
    base[:2] = -0.5, 2.0
    rows = {i for i, origin in enumerate(known.rows.origin) if origin == "model"}
    for number in eta:
        for sign in (1.0, -1.0):
            for size, good in ((0.25, True), (0.2500001, False)):
                x = base.copy()
                x[-1], x[number] = 0.25, sign * size
                values = problem.rows.values(x)[len(known.problem.constraints) :]
                assert (values.min() >= 0.0) == good
    x = base.copy()
    one, quarter = base.copy(), base.copy()
    one[-1], quarter[-1] = 1.0, 0.25
    for row in rows:
        full = problem.constraints[row].polynomial
        assert full(one) - full(quarter) == pytest.approx(0.375, rel=1e-12)
        assert full(one) == pytest.approx(known.problem.constraints[row].polynomial(x[:-1]))


def test_rows_with_the_factor_are_those_of_exact_arithmetic() -> None:
    """Rows without a constant, of two shapes, with bounds that differ from sample to sample."""
    data = setid.IOData([0.0, 1.0, 0.0, 0.0], [0.0, 1.0, 2.0, 0.5])
    noise = setid.Noise(output=[0.0, 0.1, 0.0, 0.1], equation=[0.1, 0.2, 0.3, 0.7])
    known = setid.formulate(data, FIRST, noise)
    problem, count = problem_with_factor(known, None), known.problem.dimension
    model = [i for i, origin in enumerate(known.rows.origin) if origin == "model"]
    assert len({known.problem.constraints[i].polynomial.words.shape for i in model}) > 1
    for i in model:
        own = known.problem.constraints[i].polynomial
        size = Fraction([0.1, 0.2, 0.3, 0.7][known.rows.sample[i] - 1])
        expected = {
            tuple(word[word > 0]): Fraction(value)
            for word, value in zip(own.words, own.coefficients.tolist(), strict=True)
        }
        expected[()] = expected.get((), Fraction(0)) - size
        expected[(count + 1,)] = size
        made = problem.constraints[i].polynomial
        found = {
            tuple(word[word > 0]): Fraction(value)
            for word, value in zip(made.words, made.coefficients.tolist(), strict=True)
        }
        spare = found.pop((), Fraction(0)) - expected.pop(())
        assert found == expected
        assert 0 < spare <= Fraction(1, 10**14)  # rounding of the reading's row


def test_lies_about_points_and_empty_boxes_are_refused(bracket: setid.Consistency) -> None:
    low, high = bracket.scale
    assert bracket.result is not None and bracket.result.attained is not None
    assert bracket.theta is not None and bracket.witness is not None and bracket.box is not None
    point = bracket.result.attained
    less = replace(point, value=0.5 * low / bracket.limit)
    result = replace(bracket.result, attained=less)
    assert not replace(bracket, scale=(0.0, 0.6 * low), result=result).verify().ok
    seen = replace(bracket, scale=(0.0, 1.5 * high), result=None, refuted=None)
    assert seen.verify().ok  # by its witness alone
    assert not replace(seen, theta=bracket.theta + 1e-9).verify().ok
    assert not replace(seen, witness=bracket.witness + 30.0).verify().ok
    assert not replace(seen, scale=(0.0, 0.5 * low)).verify().ok
    full = (bracket.limit, bracket.box)
    claim = replace(seen, scale=(bracket.limit, inf), refuted=full)  # type: ignore[arg-type]
    assert not bracket.box.empty and not claim.verify().ok


def test_parameters_that_a_proof_solves_for_are_known_up_to_its_radius() -> None:
    """A proof begins at the rounded point of the last one, and may end a unit beside it."""
    u = [1.0, 0.0, 0.3, 0.4, 0.8, -0.2, -0.8]
    y = [-0.01, 1.26, 0.23, 0.54, 0.64, 1.23, 0.05]
    noise, model = setid.Noise(output=0.05, input=0.05), setid.TransferFunction(1, 2, 1)
    found = setid.consistency(setid.IOData(u, y), model, noise, options=QUICK)
    assert found.result is not None and found.result.attained is not None
    assert found.result.attained.radius > 0.0 and found.theta is not None
    assert found.verify()
    for end in (-inf, inf):
        assert replace(found, theta=np.nextafter(found.theta, end)).verify()
    assert not replace(found, theta=found.theta + 1e-9).verify()
    assert not replace(found, theta=found.theta[:1]).verify()


def test_linear_problems_keep_the_rows_of_priors() -> None:
    a, b = sp.variables(2)
    noise = setid.Noise(equation=1.0)
    free = setid.formulate(laboratory_two_first(), FIRST, noise)
    tied = setid.formulate(laboratory_two_first(), FIRST, noise, [a + b >= 3.0])
    problem, other = linear_problem(free), linear_problem(tied)
    assert len(other.constraints) == len(problem.constraints) + 1
    x = np.array([1.0, 1.5, 1e3])  # much noise, and a sum of 2.5
    assert problem.violation(x) == 0.0 and other.violation(x) == 0.5


def test_what_is_not_scaled_of_a_noise_bound_stays() -> None:
    """Of a bound of 1/2 a quarter is scaled: noise of 1/4 + s / 4 on both sides."""
    data = setid.IOData([1.0, 2.0, 1.0], [0.0, 1.0, 2.0])
    known = setid.formulate(data, setid.TransferFunction(1, 1), setid.Noise(output=0.5))
    problem = problem_with_factor(known, None, 0.25)
    place = int(known.layout.group("eta")[1, 0])
    sides = [
        row.polynomial
        for row in problem.constraints
        if set(row.polynomial.support.tolist()) == {place, problem.dimension - 1}
    ]
    assert len(sides) == 2
    for s, noise in ((0.0, 0.25), (1.0, 0.5)):
        for sign in (-1.0, 1.0):
            x = np.zeros(problem.dimension)
            x[place], x[-1] = sign * noise, s
            assert min(side(x) for side in sides) >= 0.0
            x[place] = sign * (noise + 1e-9)
            assert min(side(x) for side in sides) < 0.0


def test_only_rows_that_no_noise_enters_hold_with_every_factor() -> None:
    """Rows of y(k) + a1 y(k-1) = b0 u(k): the third reading is in those of k = 3 and 4."""
    data = setid.IOData([1.0, 2.0, 1.0, 3.0, 1.0, 2.0], [1.0, 2.0, 1.5, 2.0, 1.0, 0.5])
    reading, error = np.zeros((6, 1)), np.zeros((6, 1))
    reading[2], error[4] = 0.1, 0.1
    noise = setid.Noise(output=reading, equation=error)
    exact = rows_of_exact_readings(setid.formulate(data, FIRST, noise), noise)
    assert exact is not None and exact.smoothed is not None
    assert exact.smoothed.sample.tolist() == [2, 6] and not np.any(exact.smoothed.radius)
    every = setid.Noise(output=1.0)
    assert rows_of_exact_readings(setid.formulate(data, FIRST, every), every) is None


def test_noise_that_is_lost_in_rounding_is_noise() -> None:
    """A thirty-second of the least double is rounded to zero; a large factor makes it count."""
    data, noise = setid.IOData([1.0, 2.0], [1.0, 2.0], Ts=0.0625), setid.Noise(input=5e-324)
    known = setid.formulate(data, setid.ContinuousTransferFunction(1, 0), noise)
    assert rows_of_exact_readings(known, noise) is None


def test_lies_about_every_factor_are_refused() -> None:
    """b u = y: exact readings say b = 1 and b = 2, noisy ones only with too little noise."""
    data, model = setid.IOData([1, 1, 2, 3], [1, 2, 2, 3]), setid.TransferFunction(0, 1)
    noise = setid.Noise(output=[0.0, 0.0, 0.1, 0.1])
    true = setid.consistency(data, model, noise, options=QUICK)
    assert true.scale == (inf, inf) and true.verify().ok
    assert not replace(true, scale=(inf, 1.0)).verify().ok
    noise = setid.Noise(output=[0.1, 0.1, 0.1, 0.0])
    held = setid.consistency(data, model, noise, options=QUICK)
    assert held.refuted is not None and held.scale[1] < inf
    for box in (held.refuted[1], SimpleNamespace(empty=True, verify=lambda *_: True)):
        lie = replace(held, scale=(inf, inf), refuted=(inf, box), theta=None)  # type: ignore[arg-type]
        assert not lie.verify().ok
