"""Jury's rows with slack variables: what they hold, what they let through, what is attained."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from prior_cases import reflections_to_coefficients

import setid
import sparsepop_py as sp
from setid.formulation.units import InUnits, in_units
from setid.priors.jury import is_stable, jury_values
from setid.proofs.evidence import EndProof
from setid.proofs.existence import proved_point
from setid.proofs.verification import _is_admitted

JURY = setid.Stable(form="jury")


def stated(degree: int, prior: setid.Stable = JURY, noise: float = 50.0) -> setid.Formulation:
    data = setid.IOData(np.sin(np.arange(12.0)), np.cos(np.arange(12.0)))
    return setid.formulate(data, setid.TransferFunction(degree, 1), setid.Noise(noise), [prior])


def violation(formulation: setid.Formulation, theta: list[float]) -> float:
    """Of the rows and bounds of the prior alone."""
    x, problem = formulation.point([*theta, 1.0]), formulation.problem
    rows = [problem.constraints[row] for row in formulation.rows.of_prior(0)]
    worst = 0.0
    for row in rows:
        value = row.polynomial(x)
        worst = max(worst, abs(value) if row.kind.name == "ZERO" else -value)
    chosen = np.r_[formulation.layout.group("theta"), formulation.layout.group("slack")]
    low, high = problem.lower[chosen], problem.upper[chosen]
    return max(worst, float(np.max([low - x[chosen], x[chosen] - high])))


def test_rows_of_degree_three_are_those_of_the_array() -> None:
    """c_2 = a3 a1 - a2 and c_0 = a3^2 - 1, with the sign of D(-1) = 1 - a1 + a2 - a3 put right."""
    formulation = stated(3)
    a1, a2, a3 = 0.4, -0.3, 0.2
    x = formulation.point([a1, a2, a3, 1.0])
    slack = dict(zip(["c0", "c2"], x[formulation.layout.group("slack")], strict=True))
    assert slack["c0"] == pytest.approx(a3**2 - 1, abs=1e-15)
    assert slack["c2"] == pytest.approx(a3 * a1 - a2, abs=1e-15)
    rows = [formulation.problem.constraints[r].polynomial(x) for r in formulation.rows.of_prior(0)]
    wanted = [
        1 + a1 + a2 + a3,
        1 - a1 + a2 - a3,
        0.0,
        0.0,
        -slack["c0"] - slack["c2"],
        slack["c2"] - slack["c0"],
    ]
    assert rows == pytest.approx(wanted, abs=1e-14)


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5, 6])
def test_rows_hold_for_stable_polynomials_and_refuse_others(degree: int) -> None:
    """Roots are the judge; polynomials near the boundary are left out."""
    formulation, generator, seen = stated(degree), np.random.default_rng(degree), set()
    for _ in range(300):
        size = 1.0 if generator.random() < 0.5 else 1.6
        c = size * reflections_to_coefficients(generator.uniform(-1, 1, degree))
        largest = np.abs(np.roots([1.0, *c])).max()
        if abs(largest - 1.0) < 1e-3:
            continue
        assert (violation(formulation, c.tolist()) <= 1e-9) == (largest < 1.0)
        assert is_stable(c, c) == (largest < 1.0)
        seen.add(largest < 1.0)
    assert seen == {True, False}


def test_closed_rows_admit_the_roots_one_two_and_a_half() -> None:
    unstable = [-3.5, 3.5, -1.0]  # (z - 1) (z - 2) (z - 1/2)
    assert sorted(np.roots([1.0, *unstable]).round(9)) == [0.5, 1.0, 2.0]
    assert violation(stated(3), unstable) <= 0.0
    assert violation(stated(3, setid.Stable()), unstable) > 0.1
    assert not is_stable(unstable, unstable)


def test_boxes_of_slack_variables_hold_the_array_of_every_stable_polynomial() -> None:
    formulation = stated(5)
    names = [formulation.layout.names[i] for i in formulation.layout.group("slack")]
    lower, upper = formulation.problem.lower, formulation.problem.upper
    place = dict(zip(names, formulation.layout.group("slack"), strict=True))
    generator = np.random.default_rng(5)
    for _ in range(500):
        reflections = generator.choice([-1, 1], 5) * (1 - 0.3 * generator.random(5) ** 3)
        for name, value in jury_values(
            reflections_to_coefficients(reflections), 1.0, "stable"
        ).items():
            assert lower[place[name]] - 1e-12 <= value <= upper[place[name]] + 1e-12


def test_a_margin_is_a_smaller_disc() -> None:
    formulation = stated(3, setid.Stable(0.2, form="jury"))
    for radius, inside in ((0.79, True), (0.81, False)):
        c = np.poly([radius, -0.3, 0.1])[1:]
        assert (violation(formulation, c.tolist()) <= 1e-12) == inside
        assert is_stable(c, c, 1.0 - 0.2) == inside


def test_a_box_is_stable_only_if_its_corners_are() -> None:
    """Degree 2: the triangle |c2| <= 1, |c1| <= 1 + c2; a box that leaves it is refused."""
    assert is_stable([-0.5, 0.1], [0.5, 0.4])
    assert not is_stable([-0.5, 0.1], [1.2, 0.4])  # 1.2 > 1 + 0.1
    assert not is_stable([-0.1, 0.9], [0.1, 1.1])
    assert not is_stable([-np.inf], [0.0])


def test_attained_points_are_stable_where_rows_would_let_others_pass() -> None:
    """Few samples and strong noise: the feasible set of the rows reaches unstable systems."""
    u = np.array([1.0, -2.0, 1.5, 0.5, -1.0, 2.0, 1.0])
    model = setid.TransferFunction(3, 1)
    truth = setid.simulate_record(model, [-2.2, 1.7, -0.45, 1.0], u, setid.Noise(equation=0.2))
    result = setid.identify(
        truth.data, model, setid.Noise(equation=0.2), JURY, setid.Options(time_limit=20.0)
    )
    better = setid.identify(
        truth.data, model, setid.Noise(equation=0.2), setid.Stable(), setid.Options(time_limit=20.0)
    )
    assert len(result.attained) and bool(result.verify()) and bool(better.verify())
    for theta in result.attained:
        assert np.abs(np.roots([1.0, *theta[:3]])).max() <= 1.0 + 1e-9
    for name, value in truth.theta.items():
        assert value in result.intervals[name] and value in better.intervals[name]
    for name in ("a1", "a2", "a3"):
        outer, inner = better.intervals[name].outer, result.intervals[name].inner
        assert inner is not None and outer[0] <= inner[0] <= inner[1] <= outer[1]


@pytest.mark.parametrize("theta", [[-3.0, 3.0, -1.0, 1.0], [-3.4, 3.4, -1.0, 1.0]])
@pytest.mark.slow
def test_unstable_points_of_the_rows_are_not_attained(theta: list[float]) -> None:
    """Without the step-up test the ends of these records are taken at roots of 1.6 to 1.9."""
    u = np.array([1.0, -2.0, 1.5, 0.5, -1.0, 2.0])
    model = setid.TransferFunction(3, 1)
    truth = setid.simulate_record(model, theta, u, setid.Noise(equation=0.5))
    result = setid.identify(
        truth.data, model, setid.Noise(equation=0.5), JURY, setid.Options(time_limit=20.0)
    )
    for found in result.attained:
        assert np.abs(np.roots([1.0, *found[:3]])).max() <= 1.0
    assert result.status != "certified" and bool(result.verify())
    wide = max(result.intervals.values(), key=lambda item: item.width)
    forged = replace(wide, inner=wide.outer)
    claim = replace(result, intervals={**result.intervals, wide.name: forged})
    assert not claim.verify()


def test_an_unstable_vector_is_neither_consistent_nor_a_member() -> None:
    known = stated(3)
    theta = [-3.5, 3.5, -1.0, 0.0]
    assert setid.least_noise(known, theta).level <= 1.0
    result = setid.FeasibleSet(known, {}, known.problem, setid.Options())
    assert result.formulation is known
    from setid.feasible_points.members import is_member
    from setid.feasible_points.witness import consistent

    assert consistent(known, theta) is None and not is_member(known, np.array(theta))
    assert consistent(known, [-0.5, 0.3, 0.1, 0.0]) is not None


def test_forms_are_checked_and_printed() -> None:
    assert repr(setid.Stable()) == "Stable(margin=0.0)"
    assert repr(JURY) == "Stable(margin=0.0, form='jury')"
    with pytest.raises(setid.PriorError, match="form: found 'Jury'"):
        setid.Stable(form="Jury")
    data = setid.IOData([1, 2, 3, 2, 1, 0], [0, 1, 1, 2, 1, 1])
    model = setid.ContinuousTransferFunction(2, 0)
    with pytest.raises(setid.PriorError, match="continuous-time"):
        setid.formulate(data, model, setid.Noise(0.1), JURY)


def test_slack_variables_of_the_last_row_are_its_two_ends() -> None:
    three, four = (
        [name for name in stated(n).layout.names if name.startswith("stable.")] for n in (3, 4)
    )
    assert three == ["stable.q2_0", "stable.q2_2"]
    assert four == [f"stable.q3_{k}" for k in range(4)] + three


def with_a_point(
    theta: list[float],
) -> tuple[setid.Formulation, InUnits, sp.ProvedPoint]:
    """State a problem with Jury's rows, and prove that a point satisfies them."""
    data = setid.IOData(np.sin(np.arange(12.0)), np.cos(np.arange(12.0)))
    noise = setid.Noise(equation=50.0)
    box = setid.Box({name: (-4.0, 4.0) for name in ("a1", "a2", "a3", "b0")})
    formulation = setid.formulate(data, setid.TransferFunction(3, 1), noise, [JURY, box])
    scaled = in_units(formulation.problem, formulation)
    z = formulation.point([*theta, 1.0]) / scaled.units
    point = proved_point(formulation, scaled.problem, z)
    assert point is not None
    return formulation, scaled, point


def attained_at(theta: list[float]) -> setid.Verification:
    """Verdict on evidence whose only attained point has these parameters."""
    formulation, scaled, point = with_a_point(theta)
    problem, items = formulation.problem, {}
    for place, name in enumerate(formulation.parameters):
        outer = (float(problem.lower[place]), float(problem.upper[place]))
        value = float(point.x[place] * scaled.units[place])
        inner = (value + 1e-6, value - 1e-6)
        items[name] = setid.ParameterInterval(name, outer, inner, setid.IntervalStatus.PARTIAL)
    ends = (EndProof(None, point),) * 8
    return setid.verify(setid.Evidence(formulation, items, problem, ends=ends))


def test_verify_takes_no_point_that_is_not_proved_stable() -> None:
    """The roots are 1, 2 and 0.5 in the second case: the rows hold, stability does not."""
    assert attained_at([0.4, -0.3, 0.2]).ok
    assert not attained_at([-3.5, 3.5, -1.0]).ok


def test_all_that_a_point_may_be_is_to_be_stable() -> None:
    """Within 1 of the parameters is 1.4 for a1, 0.7 for a2, 1.2 for a3, whose root is outside."""
    formulation, scaled, point = with_a_point([0.4, -0.3, 0.2])
    assert _is_admitted(formulation, scaled, point)
    assert not _is_admitted(formulation, scaled, replace(point, radius=1.0))


@pytest.mark.parametrize("margin", [1.0, 2.0])
def test_a_disc_without_radius_is_refused_in_discrete_time(margin: float) -> None:
    data = setid.IOData([1, 2, 3, 2], [0, 1, 1, 2])
    model = setid.TransferFunction(na=1, nb=1)
    with pytest.raises(setid.PriorError, match=r"Stable.margin: found .* < 1 in discrete time"):
        setid.formulate(data, model, setid.Noise(0.1), [setid.Stable(margin)])
