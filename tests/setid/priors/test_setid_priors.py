"""Priors: what they admit is the closure of what they mean."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from prior_cases import admits, reflections_to_coefficients

import setid
import sparsepop_py as sp
from setid.priors.base import Plain
from setid.priors.stability import step_down

NOISE = setid.Noise(output=1e3)


def prepared(
    na: int, nb: int, priors: list, nk: int = 0
) -> tuple[setid.Formulation, setid.TransferFunction]:
    """A formulation whose data say nothing, so that the priors alone decide."""
    model = setid.TransferFunction(na, nb, nk)
    samples = max(na, nb + nk) + 2
    u = np.linspace(-1, 1, samples)
    return setid.formulate(setid.IOData(u, np.zeros(samples)), model, NOISE, priors), model


# ---- stability --------------------------------------------------------------------------


@pytest.mark.parametrize("margin", [0.051, 0.053, 0.062])
def test_the_edge_of_a_smaller_disc_is_not_rounded_away(margin: float) -> None:
    """Poles +-i sqrt(a2) lie in the disc of 1 - margin exactly where a2 is at most its square."""
    square = (1 - Fraction(margin)) ** 2
    a2 = float(square)
    if a2 > square:
        a2 = np.nextafter(a2, 0.0)
    data = setid.IOData([1.0, 2.0, -1.0, 3.0, 1.0, -2.0], np.zeros(6))
    priors = [setid.Stable(margin), setid.Known({"a1": 0.0})]
    options = setid.Options(progress=False)
    model, noise = setid.TransferFunction(2, 1, 1), setid.Noise(equation=1.0)
    assert a2 in setid.identify(data, model, noise, priors, options).intervals["a2"]


@pytest.mark.parametrize("margin", [0.051, 0.25 + 2.0**-30])
def test_rows_of_a_smaller_disc_hold_on_its_edge(margin: float) -> None:
    """For a1 = 0 each real a2 up to r^2 is allowed, which is no double in general."""
    rows = prepared(2, 1, [setid.Stable(margin)])[0].problem.constraints
    edge = [row.polynomial for row in rows if row.name == "stable"][-1]  # c - a2 >= 0
    pairs = zip(edge.words.tolist(), edge.coefficients.tolist(), strict=True)
    assert Fraction(next(c for word, c in pairs if not any(word))) >= (1 - Fraction(margin)) ** 2


@pytest.mark.parametrize("margin", [0.0, 0.2])
@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5, 6])
def test_stable_admits_what_the_roots_say(degree: int, margin: float) -> None:
    formulation, _ = prepared(degree, 1, [setid.Stable(margin)])
    rng = np.random.default_rng(degree)
    seen = set()
    for _ in range(150):
        if rng.random() < 0.5:
            theta = reflections_to_coefficients(rng.uniform(-1.05, 1.05, degree))
        else:
            theta = rng.uniform(-1, 1, degree) * 1.3
        theta = theta * (1 - margin) ** np.arange(1, degree + 1)
        largest = np.abs(np.roots([1.0, *theta])).max()
        if abs(largest - (1 - margin)) < 1e-4:
            continue
        stable = bool(largest < 1 - margin)
        seen.add(stable)
        assert admits(formulation, [*theta, 1.0]) == stable, (theta, largest)
    assert seen == {True, False}


def test_step_up_rows_reject_what_closed_jury_rows_admit() -> None:
    """Roots 1, 2, 0.5: the closed Jury inequalities hold, the polynomial is unstable."""
    a1, a2, a3 = np.poly([1.0, 2.0, 0.5])[1:]
    assert 1 + a1 + a2 + a3 >= -1e-12 and 1 - a1 + a2 - a3 >= 0 and abs(a3) <= 1
    assert abs(a3 * a1 - a2) <= abs(a3**2 - 1) + 1e-12
    formulation, _ = prepared(3, 1, [setid.Stable()])
    assert not admits(formulation, [a1, a2, a3, 1.0])


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(-0.99, 0.99), min_size=1, max_size=6))
def test_step_down_inverts_step_up(reflections: list[float]) -> None:
    top = reflections_to_coefficients(reflections)
    levels = step_down(top)
    assert [level.size for level in levels] == list(range(1, len(reflections) + 1))
    np.testing.assert_allclose([level[-1] for level in levels], reflections, atol=1e-6)
    assert np.abs(np.roots([1.0, *top])).max(initial=0.0) < 1.0


@pytest.mark.parametrize("roots", [[1, 1, 1], [-1, 1, 0.5], [1, 0.3, 0.2, -0.7]])
def test_the_boundary_belongs_to_the_closure(roots: list[float]) -> None:
    theta = np.poly(roots)[1:]
    formulation, _ = prepared(len(theta), 1, [setid.Stable()])
    assert admits(formulation, [*theta, 1.0], tolerance=1e-5)


def test_stability_boxes_every_unknown() -> None:
    formulation, _ = prepared(5, 1, [setid.Stable()])
    numbers = [*formulation.layout.group("theta")[:5], *formulation.layout.group("slack")]
    assert np.isfinite(formulation.problem.lower[numbers]).all()
    assert formulation.problem.upper[:5].tolist() == [5, 10, 10, 5, 1]
    assert formulation.problem.degree == 2
    assert len(formulation.rows.of_prior(0)) == 2 + 2 + 2 + 3 + 4


def test_every_denominator_is_made_stable() -> None:
    model = setid.TransferFunction(1, 1, 1, inputs=2)
    data = setid.IOData([[1, 2], [2, 1], [0, 1]], [1, 2, 3])
    problem = setid.formulate(data, model, setid.Noise(0.1), setid.Stable(0.25)).problem
    assert problem.lower[:2].tolist() == pytest.approx([-0.75, -0.75])


# ---- zeros, gain, roots -----------------------------------------------------------------


@pytest.mark.parametrize("sign", ["+", "-"])
@pytest.mark.parametrize("zeros", [1, 2, 3, 4])
def test_minimum_phase_admits_what_the_zeros_say(zeros: int, sign: str) -> None:
    priors = [setid.MinimumPhase(), setid.Sign({"b1": sign})]
    formulation, _ = prepared(0, zeros + 1, priors, nk=1)
    rng = np.random.default_rng(zeros)
    seen = set()
    for _ in range(120):
        lead = rng.uniform(0.2, 3) * (1 if sign == "+" else -1)
        theta = lead * np.append(1, reflections_to_coefficients(rng.uniform(-1.2, 1.2, zeros)))
        largest = np.abs(np.roots(theta)).max()
        if abs(largest - 1) > 1e-4:
            seen.add(bool(largest < 1))
            assert admits(formulation, theta) == bool(largest < 1)
    assert seen == {True, False}


def test_minimum_phase_refuses_without_a_sign() -> None:
    for priors in ([setid.MinimumPhase()], [setid.MinimumPhase(), setid.Known({"b0": 0})]):
        with pytest.raises(setid.PriorError, match="found b0 in .* expected its sign"):
            prepared(1, 2, priors)


@pytest.mark.parametrize("stable", [False, True])
@pytest.mark.parametrize("ends", [(1, 3), (2, None), (-np.inf, 3), (1, np.inf), (-2, 1)])
def test_static_gain(ends: tuple, stable: bool) -> None:
    priors = [setid.DCGain(*ends), *([setid.Stable()] if stable else [])]
    formulation, _ = prepared(2, 2, priors)
    low, high = ends[0], ends[0] if ends[1] is None else ends[1]
    rng = np.random.default_rng(3)
    seen = set()
    for _ in range(200):
        a = reflections_to_coefficients(rng.uniform(-0.9, 0.9, 2))
        b = rng.uniform(-2, 2, 2)
        if ends[1] is None and rng.random() < 0.5:
            b[1] = 2 * (1 + a.sum()) - b[0]
        gain = b.sum() / (1 + a.sum())
        inside = low - 1e-9 <= gain <= high + 1e-9
        if min(abs(gain - low), abs(gain - high)) > 1e-6 or inside:
            seen.add(bool(inside))
            assert admits(formulation, [*a, *b]) == inside
    assert seen == {True, False}
    rows = formulation.rows.of_prior(0)
    degree = max(formulation.problem.constraints[r].polynomial.degree for r in rows)
    assert degree == (1 if stable or ends[1] is None else 2)


def test_static_gain_holds_for_negative_denominators_too() -> None:
    formulation, _ = prepared(1, 1, [setid.DCGain(1, 3)])
    assert admits(formulation, [-3.0, -4.0])  # gain 2, unstable
    assert not admits(formulation, [-3.0, 4.0])


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_real_pole_and_zero_in_an_interval(order: int) -> None:
    pole, _ = prepared(order, 1, [setid.PoleIn(0.2, 0.6)])
    zero, _ = prepared(0, order + 1, [setid.ZeroIn(0.2, 0.6)])
    assert pole.problem.degree == 2 and zero.problem.degree == 2
    rng = np.random.default_rng(order)
    for inside in (True, False):
        for _ in range(20):
            root = rng.uniform(0.2, 0.6) if inside else rng.uniform(0.7, 2)
            roots = np.append(root, rng.uniform(-2, 0, order - 1))
            assert admits(pole, [*np.poly(roots)[1:], 1.0], 1e-8) == inside
            assert admits(zero, rng.uniform(1, 3) * np.poly(roots), 1e-8) == inside


def test_a_known_root_is_one_linear_row() -> None:
    formulation, _ = prepared(3, 2, [setid.PoleIn(0.5, 0.5), setid.ZeroIn(-1, -1)])
    places = [row for i in (0, 1) for row in formulation.rows.of_prior(i)]
    assert [str(formulation.problem.constraints[row]) for row in places] == [
        "pole[1,1]@0.5..0.5: 0.125 + 0.25*a1 + 0.5*a2 + a3 == 0",
        "zero[1,1]@-1..-1: -b0 + b1 == 0",
    ]


# ---- single coefficients and own constraints --------------------------------------------


def test_bounds_are_intersected() -> None:
    priors = [
        setid.Box({"a1": (-3, 1), "b0": (None, 5)}),
        setid.Sign({"a1": "-", "b0": np.sign(2.0)}),
        setid.Known({"b1": 0.25}),
    ]
    formulation, _ = prepared(1, 2, priors)
    assert formulation.problem.lower[:3].tolist() == [-3, 0, 0.25]
    assert formulation.problem.upper[:3].tolist() == [0, 5, 0.25]


def test_own_constraints_are_lifted() -> None:
    model = setid.TransferFunction(1, 2)
    p = setid.parameters(model)
    data = setid.IOData([1, 2, 3], [0, 1, 1])
    own = p["b0"] * p["b1"] >= 1
    formulation = setid.formulate(data, model, setid.Noise(0.1), own)
    assert str(formulation.problem.constraints[-1]) == "-1 + b0*b1 >= 0"
    assert formulation.rows.origin[-1] == "prior"
    assert "prior: -1 + b0*b1 >= 0" in formulation.assumptions


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: setid.Box({"a9": (0, 1)}), "found 'a9', expected one of a1, b0"),
        (lambda: setid.Box({"a1": (2, 1)}), r"a1: found \[2, 1\], expected low <= high"),
        (lambda: setid.Box({}), "Box: found {}, expected a mapping"),
        (lambda: setid.Box({"a1": 3}), r"a1: found 3, expected \(low, high\)"),
        (lambda: setid.Known({"a1": np.inf}), "a1: found inf, expected a finite number"),
        (lambda: setid.Sign({"a1": "?"}), r"Sign\['a1'\]: found '\?'"),
        (lambda: setid.Sign({"a1": 2.0}), r"Sign\['a1'\]: found 2.0"),
        (lambda: setid.Sign({"a1": True}), r"Sign\['a1'\]: found True"),
        (lambda: setid.Stable(1.0), "margin: found 1.0, expected 0 <= margin < 1"),
        (lambda: setid.PoleIn(None, 0.5), "PoleIn: found an infinite end, expected numbers"),
        (lambda: setid.DCGain(2, 1), r"DCGain: found \[2, 1\]"),
        (lambda: setid.PoleIn(0, np.inf), "PoleIn: found an infinite end"),
        (lambda: setid.ZeroIn(0, 1), "ZeroIn: found no zero, expected at least one"),
        (lambda: "stable", r"priors\[0\]: found str"),
        (lambda: sp.variables(7)[0] >= 0, "found a constraint in 7 variables, expected 2"),
        (lambda: sp.second_order(*sp.variables(2)), "found a SECOND_ORDER constraint"),
    ],
)
def test_wrong_priors(make, message: str) -> None:
    data = setid.IOData([1, 2, 3], [0, 1, 1])
    with pytest.raises(setid.PriorError, match=message):
        setid.formulate(data, setid.TransferFunction(1, 1), setid.Noise(0.1), [make()])


def test_contradicting_priors_are_named() -> None:
    with pytest.raises(setid.PriorError, match=r"Sign.* found \[0, inf\] for a1.* \[-2, -1\]"):
        prepared(1, 1, [setid.Box({"a1": (-2, -1)}), setid.Sign({"a1": "+"})])


def test_several_poles_and_priors_given_twice() -> None:
    two, _ = prepared(3, 1, [setid.PoleIn(0.1, 0.3), setid.PoleIn(0.6, 0.9)])
    assert admits(two, [*np.poly([0.2, 0.7, -0.5])[1:], 1.0], 1e-8)
    assert not admits(two, [*np.poly([0.2, 0.4, -0.5])[1:], 1.0], 1e-8)
    near, _ = prepared(2, 1, [setid.PoleIn(0.1, 0.3), setid.PoleIn(0.10000001, 0.3)])
    assert admits(near, [*np.poly([0.2, 0.7])[1:], 1.0], 1e-8)
    with pytest.raises(setid.SetidError, match="is one given twice"):
        prepared(3, 1, [setid.PoleIn(0.1, 0.3)] * 2)


def test_a_pole_at_the_origin_needs_zero_margin_rows() -> None:
    """Margin close to 1: the coefficients are forced towards zero."""
    formulation, _ = prepared(3, 1, [setid.Stable(0.999)])
    assert admits(formulation, [0.0, 0.0, 0.0, 1.0])
    assert not admits(formulation, [0.01, 0.0, 0.0, 1.0])


def test_nonlinear_structures_have_no_poles() -> None:
    data = setid.IOData([1, 2, 3], [0, 1, 1])
    model = setid.PolynomialNARX(["y1", "u0"], 1, 0)
    with pytest.raises(setid.ModelError, match="found a PolynomialNARX, which has no transfer"):
        setid.formulate(data, model, setid.Noise(0.1), [setid.Stable()])


def test_the_class_of_a_prior_is_no_prior() -> None:
    data, model = setid.IOData([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]), setid.TransferFunction(1, 1)
    with pytest.raises(setid.PriorError, match=r"priors\[0\]: found .*expected a prior"):
        setid.formulate(data, model, setid.Noise(output=1.0), [setid.Stable])


@pytest.mark.parametrize("lead", [1.0, -2.0])
def test_the_sign_of_a_numerator_that_normalise_fixes_is_known(lead: float) -> None:
    """The zero of b1 + b2 q^-1 is -b2 / b1: in the disc for a half of b1, outside for twice b1."""
    u = np.random.default_rng(0).uniform(-1, 1, 12)
    w = (2 * u + 0.6 * u**2) / lead
    model = setid.Hammerstein(setid.TransferFunction(0, 2, 1), 2, normalise={"b1": lead})
    options = setid.Options(time_limit=5.0, progress=False)
    for share, feasible in ((0.5, True), (2.0, False)):
        y = lead * np.array([0.0, 0.0, *(w[1:-1] + share * w[:-2])])
        data, noise = setid.IOData(u, y), setid.Noise(output=0.01)
        found = setid.identify(data, model, noise, setid.MinimumPhase(), options)
        assert found.empty != feasible and found.verify()
        if feasible:
            low, high = found.intervals["b2"].outer
            assert low <= share * lead <= high <= low + 0.1


@pytest.mark.parametrize("prior", [setid.PoleIn(0.3, 0.3), setid.DCGain(0.9, 1.1)])
def test_the_assumptions_say_what_was_rounded(prior: setid.PoleIn | setid.DCGain) -> None:
    formulation, _ = prepared(2, 1, [prior])
    said = [text for text in formulation.assumptions if "rounded" in text]
    assert len(said) == 1 and said[0].startswith(f"prior {prior.describe()}: ")
    exact, _ = prepared(2, 1, [setid.PoleIn(0.25, 0.25), setid.Stable(0.25)])
    assert not any("rounded" in text for text in exact.assumptions)


@pytest.mark.parametrize("ends", [(float("nan"), 0.3), (0.1, float("nan"))])
def test_bounds_of_a_prior_are_numbers(ends: tuple[float, float]) -> None:
    """max(-inf, nan) is -inf in Python: such an end would be no bound."""

    class Own(Plain):
        def bounds(self, model: Any) -> dict[str, tuple[float, float]]:
            return {"b0": ends}

    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    model = setid.TransferFunction(1, 1)
    with pytest.raises(setid.PriorError, match="nan.* for 'b0', expected a name and"):
        setid.identify(data, model, setid.Noise(equation=0.5), [Own()])
