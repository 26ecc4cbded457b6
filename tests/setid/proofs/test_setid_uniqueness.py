"""Freedom of parameters and normalisations, on problems of a few terms."""

from __future__ import annotations

import warnings
from dataclasses import fields, replace
from fractions import Fraction
from itertools import product
from math import inf

import numpy as np
import pytest
from slow_values import slow_after

import setid
import sparsepop_py as sp
from setid.formulation.formulation import Formulation
from setid.priors.base import Prior
from setid.proofs.parameter_box import ParameterBox, start_of
from setid.proofs.uniqueness.free_parameters import _free, free_parameters
from setid.proofs.uniqueness.normalisation import (
    convert_ends,
    loop_shift,
    normalised_by,
    products_with,
    reference_follows,
    scaled_parameters,
    takes_both_signs,
)
from sparsepop_py.uncertain_rows.sign_tree import parameter_box

ONE = setid.TransferFunction(1, 1, 1)
BARE = setid.Hammerstein(ONE, 2)

a, b, x, y = sp.variables(4, ["a", "b", "x", "y"])
OPEN = (-inf, inf)


def free(rows: list[sp.Constraint], at: list[float], ends: tuple[float, float] = OPEN) -> list[int]:
    lower, upper = [ends[0], -inf, -inf, -inf], [ends[1], inf, inf, inf]
    problem = sp.Problem(0.0 * x, rows, lower=lower, upper=upper)
    return _free(problem, np.array(at), 2)


# ---- free parameters --------------------------------------------------------------------


def test_parameters_that_multiply_zeros_are_free() -> None:
    assert free([a * x + b * y >= -1], [5.0, 5.0, 0.0, 0.0]) == [0, 1]
    assert free([a * x + b * y >= -1], [0.0, 5.0, 0.5, 0.0]) == [1]
    assert free([a * x + b * y >= -1], [0.0, 0.0, 0.5, 0.5]) == []
    assert free([a * x >= -1, a * y == 0, b * y == 0], [0.0, 0.0, 0.0, 0.25]) == []


def test_terms_of_one_parameter_cancel_exactly_or_not_at_all() -> None:
    assert free([a * x - a * y == 0], [7.0, 0.0, 0.5, 0.5]) == [0, 1]
    assert free([a * x - a * y == 0], [0.0, 0.0, 0.5, 0.5 + 2.0**-53]) == [1]
    near, square = 1.0 + 2.0**-30, 1.0 + 2.0**-29  # the square, rounded
    assert free([a * x**2 - a * y == 0], [0.0, 0.0, near, square]) == [1]


def test_powers_of_a_parameter_count_one_by_one() -> None:
    """a^2 - a is zero at 1 and at 0, and no other value of a will do."""
    assert free([a**2 - a == 0, b * y == 0], [1.0, 0.0, 0.0, 0.0]) == [1]
    assert free([a**2 * x - a * y == 0], [0.0, 0.0, 0.5, 0.5]) == [1]


def test_nothing_is_free_at_points_that_fail() -> None:
    assert free([a * x + y >= 0], [1.0, 1.0, 0.0, -1e-300]) == []
    assert free([a * x + y >= 0], [1.0, 1.0, 0.0, 1e-300]) == [0, 1]
    assert free([a * x + y == 0], [1.0, 1.0, 0.0, 1e-300]) == []


@pytest.mark.parametrize("ends", [(0.0, inf), (-inf, 0.0)])
def test_bounded_parameters_are_not_free(ends: tuple[float, float]) -> None:
    assert free([a * x >= -1], [0.0, 0.0, 0.0, 0.0], ends) == [1]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_noise_explains_no_reading_beyond_its_bounds(sign: float) -> None:
    u = np.array([1.0, -1.0, 2.0, 0.5])
    first, noise = setid.TransferFunction(1, 1), setid.Noise(output=0.25)
    for reading, names in ((0.25, ("a1",)), (0.2500001, ())):
        data = setid.IOData(u, sign * np.array([0.125, reading, 0.0625, 0.125]))
        assert free_parameters(setid.formulate(data, first, noise))[0] == names


# ---- normalisations ---------------------------------------------------------------------


def hammerstein(noise: float = 0.01) -> setid.Formulation:
    u = np.random.default_rng(3).uniform(-1.0, 1.0, 30)
    theta = [-0.5, 0.8, 1.0, 0.4]
    data = setid.simulate_record(BARE, theta, u, setid.Noise(output=noise), 1).data
    return setid.formulate(data, BARE, setid.Noise(output=noise))


def test_references_need_a_proof_that_what_they_fix_is_not_zero() -> None:
    known = hammerstein()
    rows = known.products
    assert rows is not None
    box = parameter_box(rows.regression, rows.start(start_of(known)))
    assert isinstance(box, ParameterBox)
    sure = products_with(rows, box)
    for place, name in enumerate(BARE.parameters):
        reference = normalised_by(BARE, name)
        assert reference_follows(known, reference, box) == (place in sure and place > 0)
        assert not reference_follows(known, reference, None)
    reference = normalised_by(BARE, "b1")
    assert reference_follows(known, reference, box)
    assert not reference_follows(hammerstein(5.0), reference, box)  # of other data
    loud = hammerstein(5.0)
    assert loud.products is not None
    other = parameter_box(loud.products.regression, loud.products.start(start_of(loud)))
    assert not products_with(loud.products, other)
    assert not reference_follows(loud, reference, other)
    assert not reference_follows(known, normalised_by(BARE, "dcgain"), box)
    assert not reference_follows(known, BARE, box)
    first = [setid.Box({"gamma1": (0.5, 2.0)})]
    bounded = setid.formulate(known.data, BARE, known.noise, first)
    assert not reference_follows(bounded, reference, box)  # the prior fixes a scale of its own


def loop(model: setid.Lure, theta: list[float], priors: list[Prior] | None = None) -> Formulation:
    """A record of a feedback loop without noise."""
    u = np.random.default_rng(3).uniform(-1.0, 1.0, 12)
    data = setid.IOData(u, setid.simulate(model, theta, u))
    return setid.formulate(data, model, setid.Noise(output=1e-3), priors or [])


def without_linear_term(model: setid.BlockStructured) -> setid.BlockStructured:
    return normalised_by(model, {"gamma1": 0.0})


SECOND = setid.TransferFunction(2, 1, 1)


def test_the_linear_term_of_a_loop_belongs_to_its_linear_block() -> None:
    model = setid.Lure(SECOND, 2)
    known = loop(model, [-0.5, 0.3, 1.0, 2.0, 0.1])
    assert reference_follows(known, without_linear_term(model), None)
    assert not reference_follows(known, normalised_by(model, {"gamma1": 0.5}), None)
    assert not reference_follows(known, normalised_by(model, {"gamma2": 0.0}), None)
    fixed = model.normalised({"gamma2": 0.25})
    assert reference_follows(loop(fixed, [-0.5, 0.3, 1.0, 2.0]), without_linear_term(fixed), None)


def test_a_fixed_numerator_leaves_a_loop_its_shift() -> None:
    """y = 0.5 y- + u- - 0.6 y- - 0.3 y-^2, where y- is the output before: a1 + gamma1 counts."""
    model = setid.Lure(ONE, 2, normalise="b1")
    known, reference = loop(model, [-0.5, 0.6, 0.3]), without_linear_term(model)
    assert reference.parameters == ("a1", "gamma2")
    shifted = setid.simulate(reference, [0.1, 0.3], known.data.u)
    assert shifted == pytest.approx(known.data.y, abs=1e-12)
    assert reference_follows(known, reference, None)


@pytest.mark.parametrize(
    ("model", "theta"),
    [
        (setid.Lure(setid.TransferFunction(1, 2, 1), 2), [-0.3, 0.5, 0.4, 0.8, 0.3]),
        (setid.Lure(ONE, 2, normalise="dcgain"), [-0.5, 0.5, 0.6, 0.3]),
        (setid.Lure(ONE, 2, normalise={"a1": -0.5}), [0.5, 0.6, 0.3]),
        (setid.Lure(ONE, 2, normalise={"gamma1": 0.6}), [-0.5, 0.5, 0.3]),
        (setid.Lure(ONE, [2, 1]), [-0.5, 0.5, 0.6, 0.3]),
        (setid.Lure(ONE, [2, 3]), [-0.5, 0.5, 0.6, 0.3]),
    ],
    ids=[
        "a numerator that reaches further",
        "dcgain",
        "a1",
        "gamma1",
        "squares first",
        "no such term",
    ],
)
def test_loops_without_the_freedom_of_a_shift_have_no_reference(
    model: setid.Lure, theta: list[float]
) -> None:
    """With gamma1 = 0 the record has no parameters, although it was made with some."""
    assert not reference_follows(loop(model, theta), without_linear_term(model), None)


def test_the_name_of_a_structure_makes_no_loop() -> None:
    """A map at the input, and one whose argument is not the output, called a loop."""
    plain = setid.Hammerstein(ONE, 2, normalise="b1")
    called: setid.BlockStructured = object.__new__(setid.Lure)
    for item in fields(setid.BlockStructured):
        object.__setattr__(called, item.name, getattr(plain, item.name))
    assert loop_shift(called) is None
    sum_of = setid.BlockStructured({("y1", "u1 + w"): ONE}, {"w": setid.StaticMap("y1", 2)})
    assert loop_shift(sum_of) is None  # an argument for another sign
    u = np.random.default_rng(3).uniform(-1.0, 1.0, 12)
    data = setid.IOData(u, setid.simulate(plain, [-0.4, 1.0, 0.3], u))
    known = setid.formulate(data, called, setid.Noise(output=1e-3))
    assert not reference_follows(known, without_linear_term(called), None)


def test_priors_on_what_a_shift_changes_refuse_it() -> None:
    """Jury's form of a stable G bounds a2 alone, and its rows hold a1."""
    model = setid.Lure(SECOND, 2)
    prior = setid.Stable(form="jury")
    assert "a1" not in prior.bounds(model)
    known = loop(model, [-0.5, 0.3, 1.0, 2.0, 0.1], [prior])
    assert not reference_follows(known, without_linear_term(model), None)
    options = setid.Options(unidentifiable="report")
    with pytest.raises(setid.ModelError, match="speak of a1, gamma1"):
        setid.identify(known.data, model, known.noise, [prior], options)


def test_products_are_not_zero_on_one_side_of_zero_only() -> None:
    known = hammerstein()
    rows = known.products
    assert rows is not None
    box = parameter_box(rows.regression, rows.start(start_of(known)))
    pairs = {place: m for m, place in rows.place.items() if len(m) == 2}
    for place, m in pairs.items():
        for low, high, good in ((0.5, 1.0, True), (-1.0, -0.5, True), (-1.0, 1.0, False)):
            lower, upper = np.full(box.lower.size, -9.0), np.full(box.lower.size, 9.0)
            lower[place], upper[place] = low, high
            found = products_with(rows, with_ends(box, lower, upper))
            assert (set(m) <= found) == good
    lower = np.full(box.lower.size, 0.0)
    assert products_with(rows, with_ends(box, lower, lower + 1.0)) == set()


def with_ends(box: ParameterBox, lower: np.ndarray, upper: np.ndarray) -> ParameterBox:
    return replace(box, lower=lower, upper=upper)


def test_loops_take_the_linear_part_of_the_map_alone() -> None:
    model = setid.Lure(ONE, 2)
    u = np.random.default_rng(3).uniform(-0.5, 0.5, 12)
    truth = setid.simulate_record(model, [-0.6, 0.8, 0.1, 0.3], u, setid.Noise(output=0.01), 1)
    known = setid.formulate(truth.data, model, setid.Noise(output=0.01))
    assert reference_follows(known, normalised_by(model, {"gamma1": 0.0}), None)
    assert not reference_follows(known, normalised_by(model, {"gamma1": 0.5}), None)
    assert not reference_follows(known, normalised_by(model, "dcgain"), None)


def test_converted_ends_hold_every_conversion_in_rationals() -> None:
    """gamma1 = 1: scale k = 1 / gamma1, b1 k^-1, gamma2 k; a1 stays."""
    ends = {"a1": (-0.7, -0.5), "b1": (0.3, 0.7), "gamma1": (0.7, 1.1), "gamma2": (-0.3, 0.7)}
    found = convert_ends(BARE, ends, "gamma1")
    assert set(found) == {"a1", "b1", "gamma2"} and found["a1"] == ends["a1"]
    for values in product(*ends.values()):
        _, b1, g1, g2 = (Fraction(v) for v in values)
        for name, value in (("b1", b1 * g1), ("gamma2", g2 / g1)):
            low, high = found[name]
            assert Fraction(low) <= value <= Fraction(high)
    assert found["b1"] == pytest.approx((0.21, 0.77)) and found["gamma2"][1] == pytest.approx(1.0)


def test_shifted_ends_hold_every_shift_in_rationals() -> None:
    """gamma1 = 0: kappa = gamma1, a1 + kappa b1, gamma2 as it is."""
    model = setid.Lure(ONE, 2)
    ends = {"a1": (-0.7, -0.5), "b1": (0.3, 0.7), "gamma1": (-0.1, 0.3), "gamma2": (0.2, 0.3)}
    found = convert_ends(model, ends, {"gamma1": 0.0})
    assert found["b1"] == ends["b1"] and found["gamma2"] == ends["gamma2"]
    low, high = found["a1"]
    for values in product(*ends.values()):
        a1, b1, g1, _ = (Fraction(v) for v in values)
        assert Fraction(low) <= a1 + g1 * b1 <= Fraction(high)
    assert (low, high) == pytest.approx((-0.77, -0.29))


def test_a_scale_that_may_be_zero_settles_nothing() -> None:
    ends = {"a1": (-0.7, -0.5), "b1": (0.3, 0.7), "gamma1": (-0.1, 1.1), "gamma2": (-0.3, 0.7)}
    with pytest.raises(setid.ModelError, match="may be zero"):
        convert_ends(BARE, ends, "gamma1")


def test_scales_of_arguments_divide_as_often_as_they_occur() -> None:
    """Wiener with gamma1 = 1: k = gamma1, b1 k and gamma2 / k^2, exact in doubles."""
    known = {"a1": -0.5, "b1": 0.75, "gamma1": 2.0, "gamma2": 3.0}
    ends = {name: (value, value) for name, value in known.items()}
    found = convert_ends(setid.Wiener(ONE, 2), ends, "gamma1")
    middle = {name: (low + high) / 2 for name, (low, high) in found.items()}
    assert middle == pytest.approx({"a1": -0.5, "b1": 1.5, "gamma2": 0.75}, rel=1e-14)


def test_what_a_shift_gives_to_the_block_is_taken_from_the_map() -> None:
    """Static gain 1: a1' = b1 - 1 = -0.25, kappa = 1/4 / (3/4), gamma1' = gamma1 - 1/3."""
    known = {"a1": -0.5, "b1": 0.75, "gamma1": 0.125, "gamma2": 3.0}
    ends = {name: (value, value) for name, value in known.items()}
    found = convert_ends(setid.Lure(ONE, 2), ends, "dcgain")
    middle = {name: (low + high) / 2 for name, (low, high) in found.items()}
    wanted = {"a1": -0.25, "b1": 0.75, "gamma1": 0.125 - 1 / 3, "gamma2": 3.0}
    assert middle == pytest.approx(wanted, rel=1e-13)
    assert Fraction(found["gamma1"][0]) <= Fraction(1, 8) - Fraction(1, 3)
    assert Fraction(1, 8) - Fraction(1, 3) <= Fraction(found["gamma1"][1])


# ---- scales -------------------------------------------------------------------------------


def summed(basis: list[object]) -> setid.BlockStructured:
    """Two linear blocks in a sum, and a map of the sum."""
    blocks = {("p", "u1"): ONE, ("q", "u2"): ONE, ("s", "p+q"): ONE, ("y1", "w"): ONE}
    return setid.BlockStructured(blocks, {"w": setid.StaticMap(("s",), basis)}, inputs=2)


def test_scales_change_what_they_reach() -> None:
    wiener = setid.Wiener(setid.TransferFunction(1, 1, 1), 9)
    maps = [f"gamma{m}" for m in range(1, 10)]
    assert scaled_parameters(wiener) == ("b1", *maps)
    assert scaled_parameters(wiener.normalised("b1")) == ()
    assert scaled_parameters(wiener.normalised({"gamma2": 3.0})) == ()  # up to a sign
    assert scaled_parameters(wiener.normalised({"gamma2": 0.0})) == ("b1", "gamma1", *maps[2:])
    both = setid.HammersteinWiener(ONE, 2, 3)
    assert set(scaled_parameters(both)) == set(both.parameters) - {"a1"}
    for fixed, left in (
        ("gamma[w]1", {"b1", "gamma[y1]1", "gamma[y1]2", "gamma[y1]3"}),
        ("b1", set(both.parameters) - {"a1", "b1"}),
        ("dcgain", set(both.parameters) - {"a1", "b1"}),
    ):
        assert set(scaled_parameters(both.normalised(fixed))) == left
    assert scaled_parameters(setid.Lure(ONE, 2)) == ()  # its map is subtracted from the input


def test_signals_that_are_summed_have_one_scale() -> None:
    both = summed([(1,), (2,)])
    names = set(both.parameters)
    fixed = both.normalised(["gamma1", "b[s,p+q]1"])
    assert {n for n in names if n.startswith("a")} == names - set(scaled_parameters(both))
    assert set(scaled_parameters(fixed)) == {
        "b[p,u1]1",
        "b[q,u2]1",
        "gamma2",
        "b[y1,w]1",
    }  # s and p, q together, and w with them
    measured = setid.BlockStructured({("p", "u1"): ONE, ("y1", "p+u2"): ONE}, {}, inputs=2)
    assert scaled_parameters(measured) == ()


@pytest.mark.parametrize("degree", slow_after(1, [5, 7]))
def test_high_degrees_of_a_map_are_not_unique(degree: int) -> None:
    """b1 -> 2 b1 and gamma_m -> gamma_m / 2^m leave all outputs as they are."""
    rng = np.random.default_rng(0)
    model = setid.Wiener(setid.TransferFunction(0, 1, 1), degree, initial="zero")
    u = rng.uniform(-1, 1, 40)
    theta = np.array([1.0, *rng.uniform(0.3, 0.6, degree)])
    data = setid.simulate_record(model, theta, u, setid.Noise(output=1e-3), rng).data
    other = theta * np.array([2.0, *(0.5**m for m in range(1, degree + 1))])
    assert np.abs(setid.simulate(model, other, u) - setid.simulate(model, theta, u)).max() < 1e-12
    assert setid.unidentifiable(model) == model.parameters
    options = setid.Options(unidentifiable="report", time_limit=0.5, progress=False)
    found = setid.identify(data, model, setid.Noise(output=1e-3), (), options)
    assert all(item.outer == (-inf, inf) for item in found.intervals.values())
    assert found.verify()


def feedback() -> tuple[setid.IOData, setid.Lure]:
    """A record without noise and its structure, whose loop has no normalisation."""
    u, y = np.random.default_rng(0).uniform(-1, 1, 20), np.zeros(20)
    for k in range(1, 20):
        y[k] = 0.5 * y[k - 1] + 0.8 * (u[k - 1] - 0.2 * y[k - 1] ** 2 - 0.1 * y[k - 1])
    return setid.IOData(u, y), setid.Lure(setid.TransferFunction(1, 1, 1), 2)


def test_references_of_other_forms_do_not_follow() -> None:
    data, model = feedback()
    formulation, shift = setid.formulate(data, model, setid.Noise(0.005)), loop_shift(model)
    assert shift is not None
    for form in ("auto", "lifted"):
        assert reference_follows(formulation, shift.reference.changed(form=form), None)
    for other in (shift.reference.changed(form="direct"), model.changed(form="lifted")):
        assert not reference_follows(formulation, other, None)


@pytest.mark.slow
def test_references_with_sums_of_products_as_unknowns_follow() -> None:
    """Noisy outputs make products of parameters: the reference is stated with them as unknowns."""
    data, model = feedback()
    options = setid.Options(unidentifiable="report", time_limit=2, progress=False)
    found = setid.identify(data, model, setid.Noise(0.005), (), options)
    assert found.reference is not None and found.reference.formulation.model.form == "lifted"
    assert found.verify(data) and setid.Identification.from_json(found.to_json()).verify(data)


@pytest.mark.parametrize("size", [1e-300, 1e200, -1e60])
def test_coefficients_that_normalise_have_powers(size: float) -> None:
    linear = setid.TransferFunction(1, 2, 1)
    with pytest.raises(setid.ModelError, match="normalise: found 'b1' = .*expected a size from"):
        setid.Wiener(linear, 2, {"b1": size})


def test_a_coefficient_of_zero_hides_others() -> None:
    hidden = setid.Hammerstein(setid.TransferFunction(1, 1, 1), 2, {"b1": 0.0})
    assert setid.unidentifiable(hidden) == ("a1", "gamma1", "gamma2")


def test_even_coefficients_are_no_reference() -> None:
    """A map with gamma2 < 0 has no equivalent one with gamma2 = 1."""
    wiener = setid.Wiener(setid.TransferFunction(0, 1, 1), 3, initial="zero")
    assert [takes_both_signs(wiener, n) for n in wiener.parameters] == [True, True, False, True]
    both = setid.HammersteinWiener(ONE, 1, 2, normalise="b1")
    assert takes_both_signs(both, "gamma[w]1") and not takes_both_signs(both, "gamma[y1]2")
    assert not takes_both_signs(wiener, "a1")
    square = setid.HammersteinWiener(ONE, 1, 2, normalise={"gamma[y1]2": 1.0})
    assert scaled_parameters(square) == ("b1", "gamma[w]1")  # z may change its sign alone
    assert takes_both_signs(square, "b1") and not takes_both_signs(square, "gamma[y1]1")


def test_loops_that_diverge_are_looked_at_by_their_scales() -> None:
    """All static gains of two blocks are 1, and a cubic map closes the loop."""
    model = setid.BlockStructured(
        {("y1", "u1"): ONE, ("z", "y1"): ONE, ("y1", "v"): ONE},
        {"v": setid.StaticMap("z", 3)},
        normalise=["dcgain[z,y1]", "dcgain[y1,v]"],
        initial="zero",
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert "gamma2" not in setid.unidentifiable(model)
    assert scaled_parameters(model) == ()


def test_a_reference_settles_all_scales() -> None:
    """Two branches have a scale each: with one of them the other stays open."""
    gain = setid.TransferFunction(0, 1)
    maps = {"w": setid.StaticMap("u1", 2), "v": setid.StaticMap("u2", 2)}
    model = setid.BlockStructured({("y1", "w"): gain, ("y1", "v"): gain}, maps, inputs=2)
    u = np.random.default_rng(4).uniform(-1, 1, (20, 2))
    y = u @ [1.0, 2.0] + u**2 @ [0.5, 0.25]
    known = setid.formulate(setid.IOData(u, y), model, setid.Noise(output=0.01))
    rows = known.products
    assert rows is not None
    box = parameter_box(rows.regression, rows.start(start_of(known)))
    assert known.parameters.index("gamma[w]1") in products_with(rows, box)
    reference = normalised_by(model, "gamma[w]1")
    assert scaled_parameters(reference) and not reference_follows(known, reference, box)
    half = setid.formulate(known.data, reference, known.noise)
    assert half.products is not None
    other = parameter_box(half.products.regression, half.products.start(start_of(half)))
    assert reference_follows(half, normalised_by(reference, "gamma[v]1"), other)
