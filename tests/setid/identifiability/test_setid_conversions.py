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
