"""Conversions between normalisations, where a condition is more than one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import setid
from setid.proofs.uniqueness.normalisation import check_restrictions


def _summed(normalise: Any) -> setid.BlockStructured:
    """y = b0 (w - u2), w = gamma1 u1 + gamma2 u1^3: the input u2 leaves w no scale."""
    return setid.BlockStructured(
        {("y1", "w - u2"): setid.TransferFunction(0, 1, 0)},
        {"w": setid.StaticMap("u1", [1, 3])},
        inputs=2,
        normalise=normalise,
    )


def test_a_value_that_no_scale_changes_is_not_converted() -> None:
    """At u = (1, 0) the outputs would be 7 with gamma1 = 0.5 and 8 with gamma1 = 1."""
    model, theta = _summed({"gamma1": 0.5}), {"b0": 2.0, "gamma2": 3.0}
    for other in ({"gamma1": 1.0}, {"gamma1": 0.0}, {"gamma2": 1.0}):
        with pytest.raises(setid.ModelError, match="no scale"):
            setid.convert(model, theta, other)
    assert setid.convert(model, theta, None) == theta | {"gamma1": 0.5}
    assert setid.convert(model, theta, {"gamma2": 3.0})["gamma1"] == 0.5
    free = _summed(None)
    assert setid.convert(free, {"b0": 2.0, "gamma1": 0.0, "gamma2": 3.0}, {"gamma1": 0.0})


@pytest.mark.parametrize("kept", [{"gamma1": 0.5}, {"gamma1": 0.0}])
def test_a_fixed_value_that_no_scale_changes_has_to_stay(kept: dict[str, float]) -> None:
    """Systems with other values of gamma1 are consistent, too, and have no equivalent here."""
    check_restrictions(_summed(kept), _summed(kept))
    for other in (None, {"gamma2": 1.0}, {"gamma1": 1.0}):
        with pytest.raises(setid.ModelError, match="gamma1, whose value is more than"):
            check_restrictions(_summed(kept), _summed(other))


def test_a_static_gain_that_no_scale_changes_has_to_stay() -> None:
    shape = setid.TransferFunction(0, 2, 0)
    blocks = {("z", "u1"): shape, ("y1", "z - u2"): shape}
    model = setid.BlockStructured(blocks, {}, inputs=2, normalise="dcgain[z,u1]")
    check_restrictions(model, model)
    with pytest.raises(setid.ModelError, match="static gain of z,u1, whose value"):
        check_restrictions(model, model.normalised(None))


def test_of_two_conditions_for_one_scale_both_have_to_stay() -> None:
    model = setid.Hammerstein(setid.TransferFunction(0, 1), 2, normalise=["b0", "gamma1"])
    check_restrictions(model, model)
    with pytest.raises(setid.ModelError, match="b0, whose value"):
        check_restrictions(model, model.normalised("gamma1"))
    check_restrictions(model.normalised("gamma1"), model.normalised("b0"))


LOOP = setid.TransferFunction(1, 1, 1)  # y = (1 - w) b / (1 + a), w = gamma1 y + gamma2 y^2


@pytest.mark.parametrize("beside", [{"b1": 1.0}, {"gamma2": 0.3}, "dcgain"])
def test_a_loop_has_one_shift_and_other_conditions_have_to_stay(beside: Any) -> None:
    """Loops with another b1 are consistent, too, and no shift makes it 1."""
    model = setid.Lure(LOOP, 2, normalise=[{"gamma1": 0.0}, beside])
    check_restrictions(model, model)
    with pytest.raises(setid.ModelError, match="whose value is more than a normalisation"):
        check_restrictions(model, model.normalised({"gamma1": 1.0}))


def test_a_loop_without_a_shift_has_no_normalisation() -> None:
    longer = setid.Lure(setid.TransferFunction(1, 2, 1), 2, normalise="nolinear")
    with pytest.raises(setid.ModelError, match="gamma1, whose value"):
        check_restrictions(longer, longer.normalised("dcgain"))
    loop = setid.Lure(LOOP, 2, normalise={"a1": -0.5})  # a shift brings it about
    check_restrictions(loop, loop.normalised({"gamma1": 0.0}))


def test_loops_are_compared_with_their_shift_and_without_one() -> None:
    """kappa = -0.2 takes a = -0.5, b = 2 to a = -0.9; without a linear term there is none."""
    swapped = setid.Lure(LOOP, [2, 1])
    assert setid.equivalent(swapped, [-0.5, 2.0, 0.3, 0.0], [-0.9, 2.0, 0.3, 0.2])
    assert not setid.equivalent(swapped, [-0.5, 2.0, 0.3, 0.0], [-0.9, 2.0, 0.3, 0.1])
    bent, longer = setid.Lure(LOOP, [2, 3]), setid.Lure(setid.TransferFunction(1, 2, 1), 2)
    for model, theta in ((bent, [-0.5, 2.0, 0.3, 0.1]), (longer, [-0.5, 2.0, 1.0, 0.2, 0.3])):
        assert setid.equivalent(model, theta, theta)
        assert not setid.equivalent(model, theta, [*theta[:-1], 0.4])


def test_the_linear_term_of_a_loop_is_found_in_its_basis() -> None:
    """In w = gamma1 y^2 + gamma2 y it is gamma2."""
    assert setid.Lure(LOOP, [2, 1], "nolinear").fixed == (("gamma2", 0.0),)
    with pytest.raises(setid.ModelError, match="without a linear term"):
        setid.Lure(LOOP, [2, 3], "nolinear")


def test_a_shift_brings_about_one_condition() -> None:
    """a + kappa b and gamma1 - kappa: kappa = -0.5 takes a = -0.5, b = 1 to a = -1."""
    model, theta = setid.Lure(LOOP, 2, "nolinear"), {"a1": -0.5, "b1": 1.0, "gamma2": 0.3}
    for other in ({"b1": 2.0}, {"gamma2": 7.0}, {"gamma2": 0.0}, "dcgain"):
        with pytest.raises(setid.ModelError, match="no shift of a loop"):
            setid.convert(model, theta, [{"gamma1": 0.5}, other])
    found = setid.convert(model, theta, [{"gamma1": 0.5}, {"b1": 1.0}])
    assert found == {"a1": -1.0, "gamma2": 0.3}


def test_an_even_power_of_a_scale_excludes_the_other_sign() -> None:
    """gamma2 = 1 in y = gamma2 z^2 + gamma1 z excludes parabolas that open downwards."""
    model = setid.Wiener(setid.TransferFunction(0, 1, 1), 2, normalise={"gamma2": 1.0})
    with pytest.raises(setid.ModelError, match="gamma2, whose value"):
        check_restrictions(model, model.normalised("b1"))


def test_two_conditions_for_one_scale_restrict_beside_an_open_scale() -> None:
    """Both ask for the scale of w; that of z is open."""
    linear = setid.TransferFunction(0, 1, 1)
    both = [{"gamma[w]1": 1.0}, {"gamma[w]2": 0.5}]
    model = setid.HammersteinWiener(linear, 2, 1, normalise=both)
    with pytest.raises(setid.ModelError, match=r"gamma\[w\]2, whose value"):
        check_restrictions(model, model.normalised(["gamma[w]1", "gamma[y1]1"]))
    apart = setid.HammersteinWiener(linear, 2, 1, normalise=["gamma[w]1", "b1"])
    check_restrictions(apart, apart.normalised(["gamma[w]2", "gamma[y1]1"]))


def test_an_empty_set_is_not_converted() -> None:
    """What gamma1 = 1 leaves out may be consistent, and is not refuted with the others."""
    model = setid.Hammerstein(setid.TransferFunction(0, 1), 2, normalise="gamma1")
    data = setid.IOData([1.0, -1.0, 1.0], [0.0, 0.0, 1.0])  # one input, two outputs
    found = setid.identify(data, model, setid.Noise(output=0.1))
    assert found.status == "empty"
    with pytest.raises(setid.SetidError, match="empty"):
        setid.convert_intervals(found, "b0")


def test_a_coefficient_of_zero_has_to_stay() -> None:
    model = setid.Hammerstein(setid.TransferFunction(0, 1), 2, normalise={"gamma2": 0.0})
    with pytest.raises(setid.ModelError, match="gamma2, whose value"):
        check_restrictions(model, model.normalised("gamma1"))


def test_intervals_of_a_restricted_set_are_not_converted() -> None:
    u = np.array([[1.0, 0.0], [0.0, 1.0], [2.0, 1.0], [-1.0, 2.0]])
    data = setid.IOData(u, 0.5 * u[:, 0] - u[:, 1])
    model, noise = _summed({"gamma1": 0.5}), setid.Noise(output=0.01)
    found = setid.identify(data, model, noise, options=setid.Options(tol=1.0, progress=False))
    with pytest.raises(setid.ModelError, match="more than a normalisation"):
        setid.convert_intervals(found, None)
    assert set(setid.convert_intervals(found, {"gamma1": 0.5})) == {"b0", "gamma2"}
