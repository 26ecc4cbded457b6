"""Parameters that no row speaks of: a band holds all values that priors leave them."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

import setid
from setid.proofs.parameter_box import problem_on_box

pytestmark = pytest.mark.filterwarnings("ignore:u. input 1 is zero:setid.SetidWarning")
QUIET = setid.Options(tol=1.0, progress=False, unidentifiable="report")
AT_REST = setid.IOData(np.zeros(3), [1.0, 0.5, 0.25])  # a1 = -0.5, any b1


def identified(ends: tuple[float | None, float | None]) -> setid.Identification:
    priors = [setid.Box({"b1": ends}), setid.Stable()]
    model = setid.TransferFunction(1, 1, 1)
    return setid.identify(AT_REST, model, setid.Noise(output=0.02), priors, QUIET)


@pytest.fixture(scope="module")
def result() -> setid.Identification:
    return identified((-1.0, 2.0))


def test_steps_hold_both_given_ends(result: setid.Identification) -> None:
    """Sample 1 of the step is b1."""
    band = setid.step_band(result, 2, time_limit=0.1)
    assert band.kind == "proved"
    assert band.low[1] <= -1.0 and band.high[1] >= 2.0


def test_gains_hold_the_largest_one(result: setid.Identification) -> None:
    """At the frequency pi the largest gain is 2 / 1.5."""
    assert setid.frequency_band(result, [np.pi], time_limit=0.1).magnitude[0, 1] >= 2.0 / 1.5


def test_outlines_hold_both_given_ends(result: setid.Identification) -> None:
    outline = result.fps("a1", "b1", directions=4)
    for corner in ([-0.5, -1.0], [-0.5, 2.0]):
        assert np.all(outline.directions @ corner <= outline.heights + 1e-9)


def test_maps_hold_all_values_of_their_coefficients() -> None:
    """The map gamma1 u + u^2 lies between -1 + 1 and 2 + 1 at u = 1."""
    model = setid.Hammerstein(
        setid.TransferFunction(1, 1, 0), 2, normalise="gamma2", initial="zero", form="partial"
    )
    data = setid.IOData(np.zeros(5), np.zeros(5))
    priors = [setid.Box({"b0": (-1.0, 3.0), "gamma1": (-1.0, 2.0)}), setid.Stable()]
    found = setid.identify(data, model, setid.Noise(output=0.01), priors, QUIET)
    band = setid.static_band(found, x=[1.0], time_limit=0.1)
    assert band.low[0] <= 0.0 and band.high[0] >= 3.0


@pytest.mark.parametrize(
    ("ends", "kept"),
    [
        ((None, None), (0.0, 0.0)),
        ((0.0, None), (0.0, 0.0)),
        ((1.0, None), (1.0, 1.0)),
        ((None, -1.0), (-1.0, -1.0)),
        ((-1.0, 2.0), (-1.0, 2.0)),
        ((1.0, 2.0), (1.0, 2.0)),
    ],
)
def test_only_infinite_bounds_are_replaced(
    ends: tuple[float | None, float | None], kept: tuple[float, float]
) -> None:
    """By one number, the nearest to zero: the engine needs finite bounds."""
    priors = [setid.Box({"a1": (-1.0, None), "b1": ends})]
    model = setid.TransferFunction(1, 1, 1)
    stated = setid.formulate(AT_REST, model, setid.Noise(output=0.02), priors)
    problem = problem_on_box(stated, None)
    assert (problem.lower[1], problem.upper[1]) == kept
    assert (problem.lower[0], problem.upper[0]) == (-1.0, inf)  # rows speak of a1
