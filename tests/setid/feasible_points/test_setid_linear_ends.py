"""Ends of linear rows of data, which a prior leaves as they are."""

from __future__ import annotations

import numpy as np
import pytest

import setid
from setid.feasible_points.linear_ends import linear_ends

THETA = [*np.poly([0.9, 0.6, 0.3])[1:].tolist(), 1.0]
MODEL = setid.TransferFunction(3, 1)
NOISE = setid.Noise(equation=0.05)


def record(samples: int) -> setid.IOData:
    u = np.random.default_rng(0).uniform(-1.0, 1.0, samples)
    return setid.simulate_record(MODEL, THETA, u, NOISE, seed=0).data


def test_ends_are_those_of_exact_linear_programs() -> None:
    data = record(40)
    formulation = setid.formulate(data, MODEL, NOISE, setid.Stable())
    exact = setid.identify(data, MODEL, NOISE)
    for number, x in enumerate(linear_ends(formulation)):
        low, high = list(exact.intervals.values())[number // 2].outer
        end = high if number % 2 else low
        assert abs(x[number // 2] - end) <= 2e-6 * (high - low)
        assert formulation.problem.violation(x) < 1e-12
    assert number == 2 * len(THETA) - 1


def test_long_records_are_certified_with_a_prior_that_adds_unknowns() -> None:
    """The intervals are those without the prior: all poles of all ends are inside the disc."""
    data = record(1200)
    known = setid.identify(data, MODEL, NOISE)
    result = setid.identify(data, MODEL, NOISE, setid.Stable())
    assert all(str(item.status) == "certified" for item in result.intervals.values())
    assert result.verify(data) and result.evidence.fewer_priors is None
    for name, item in result.intervals.items():
        low, high = known.intervals[name].outer
        assert max(low - item.outer[0], item.outer[1] - high) <= 1e-6 * (high - low)
        assert max(item.inner[0] - low, high - item.inner[1]) <= 1e-5 * (high - low)


def test_ends_that_a_prior_cuts_are_left_to_the_engine() -> None:
    """With slow poles and a bound of five times the noise some ends are unstable."""
    theta = [*np.poly([0.97, 0.9, 0.5])[1:].tolist(), 1.0]
    u = np.random.default_rng(0).uniform(-1.0, 1.0, 100)
    data = setid.simulate_record(MODEL, theta, u, setid.Noise(equation=0.3), seed=0).data
    noise = setid.Noise(equation=1.5)
    wide = setid.identify(data, MODEL, noise)
    ends = linear_ends(setid.formulate(data, MODEL, noise, setid.Stable()))
    assert max(np.abs(np.roots([1.0, *x[:3]])).max() for x in ends) > 1.0
    result = setid.identify(data, MODEL, noise, setid.Stable())
    assert all(str(item.status) == "certified" for item in result.intervals.values())
    assert result.verify(data)
    assert all(
        value in result.intervals[name] for name, value in zip(wide.intervals, theta, strict=True)
    )
    widths = [(result.intervals[name].width, wide.intervals[name].width) for name in wide.intervals]
    assert any(less < 0.99 * more for less, more in widths)


@pytest.mark.parametrize(
    ("noise", "priors"),
    [
        (setid.Noise(output=0.1), setid.Stable()),  # rows are not linear
        (NOISE, ()),  # linear programs settle it
        (NOISE, setid.Stable(margin=0.05)),
    ],
)
def test_other_records_have_no_linear_ends(noise: setid.Noise, priors: object) -> None:
    found = linear_ends(setid.formulate(record(40), MODEL, noise, priors))
    assert len(found) == (8 if noise is NOISE and priors else 0)


def test_parameters_that_nothing_bounds_have_no_ends() -> None:
    data = setid.IOData([0.0] * 8, np.sin(np.arange(8.0)))
    with pytest.warns(setid.SetidWarning, match="zero throughout"):
        formulation = setid.formulate(data, MODEL, NOISE, setid.Stable())
    assert linear_ends(formulation) == []
