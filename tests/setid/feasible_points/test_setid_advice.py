"""What a result says of its centre, and what it says to do about wide intervals."""

from __future__ import annotations

import numpy as np
import pytest
from identification_cases import PLANT

import setid
from setid.feasible_points.centre import is_consistent

QUICK = setid.Options(time_limit=60.0, progress=False)
MODEL = setid.TransferFunction(1, 1, 1)
THETA = [-0.6, 2.0]
OUTPUT, BOTH = setid.Noise(output=0.3), setid.Noise(output=0.3, input=0.05)


def identified(noise: setid.Noise, samples: int = 14, seed: int = 0) -> setid.Identification:
    u = np.random.default_rng(seed).uniform(-1, 1, samples)
    truth = setid.simulate_record(MODEL, THETA, u, noise, seed)
    return setid.identify(truth.data, MODEL, noise, options=QUICK)


def line(text: str, start: str) -> str:
    (found,) = [line for line in text.splitlines() if line.startswith(start)]
    return found


@pytest.mark.parametrize("noise", [setid.Noise(output=0.6), setid.Noise(output=0.6, input=0.05)])
def test_wide_intervals_come_with_what_to_do(noise: setid.Noise) -> None:
    result = identified(noise, 6)
    text = result.summary()
    wide = line(text, "wide (more than 30 %")
    assert "A longer record, or an input with more power" in wide and "a lower noise bound" in wide
    named = wide.split(": ")[1].split(".")[0].split(", ")
    assert named == [
        n for n, v in result.intervals.items() if 0.0 in v or v.width > 0.6 * abs(v.centre)
    ]
    first = line(text, "samples that bind at the ends").split(": ")[1].split(", ")[0]
    assert int(first) == result.binding()[0][1] and "check these readings first" in text
    x = next(w for w in result.intervals["a1"].witnesses if w is not None)
    at_bound = np.abs(x[2:]) >= (1 - 1e-6) * result.formulation.problem.upper[2:]
    assert np.any(at_bound)  # what the advice speaks of


def test_shares_of_sensors_are_those_of_the_equations() -> None:
    """Row by row the noise moves De (1 + |a1|) and Dx |b1|, Cerone 1993, eq. (9)."""
    result = identified(BOTH)
    theta = result.formulation.layout.group("theta")
    ends = [w[theta] for v in result.intervals.values() for w in v.witnesses if w is not None]
    a, b = np.mean(ends, axis=0)
    output, below = 0.3 * (1 + abs(a)), 0.05 * abs(b)
    share = 100 * output / (output + below)
    told = line(result.summary(), "shares of the uncertainty")
    assert f"output noise {share:.0f} %, input noise {100 - share:.0f} %" in told
    assert "pays most for output noise" in told and "costs least for input noise" in told
    assert "all uncertainty of the equations is output noise" in identified(OUTPUT).summary()


def test_half_the_output_noise_gives_about_half_the_width() -> None:
    """What the summary of output errors says, on the same record of readings."""
    u = np.random.default_rng(0).uniform(-1, 1, 14)
    truth = setid.simulate_record(MODEL, THETA, u, setid.Noise(output=0.05), 0)
    wide, narrow = (
        setid.identify(truth.data, MODEL, setid.Noise(output=bound), options=QUICK)
        for bound in (0.2, 0.1)
    )
    for name in wide.intervals:
        assert narrow.intervals[name].width < 0.6 * wide.intervals[name].width


# ---- the centre ---------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [OUTPUT, BOTH, setid.Noise(equation=0.5)])
def test_the_error_of_the_centre_holds_for_the_truth(noise: setid.Noise) -> None:
    result = identified(noise)
    centre = result.centre
    assert np.all(np.abs(centre.theta - THETA) <= centre.error)
    widths = [v.width for v in result.intervals.values()]
    np.testing.assert_allclose(centre.error, np.array(widths) / 2, rtol=1e-12)
    for estimate in (centre.theta, result.feasible, result.projection):
        error = result.error(estimate)
        assert np.all(np.abs(estimate - THETA) <= error) and np.all(error >= centre.error)
    assert str(centre) in line(result.summary(), "centre: ")
    with pytest.raises(setid.SetidError, match=r"theta: found shape \(3,\)"):
        result.error([1, 2, 3])
    empty = setid.identify(
        result.formulation.data, result.formulation.model, setid.Noise(equation=1e-9)
    )
    with pytest.raises(setid.SetidError, match="found an empty feasible set"):
        empty.error(estimate)


@pytest.mark.parametrize("noise", [OUTPUT, BOTH])
def test_membership_is_proved_either_way(noise: setid.Noise) -> None:
    result = identified(noise)
    formulation = result.formulation
    assert is_consistent(formulation, np.array(THETA)) is True
    inside = [item.outer for item in result.intervals.values()]
    corners = [np.array([a, b]) for a in inside[0] for b in inside[1]]
    verdicts = [is_consistent(formulation, corner) for corner in corners]
    levels = [setid.least_noise(formulation, corner).level for corner in corners]
    assert False in verdicts  # the set is no box
    for verdict, level in zip(verdicts, levels, strict=True):
        assert verdict is None or verdict == (level <= 1.0)
    assert is_consistent(formulation, np.array([5.0, 0.0])) is False
    boxed = setid.formulate(formulation.data, MODEL, noise, [setid.Box({"a1": (-0.5, 0.0)})])
    assert is_consistent(boxed, np.array(THETA)) is False


def test_a_centre_that_is_not_consistent_says_so() -> None:
    """A record of laboratory 2 with output errors whose centre an oracle refutes."""
    model, noise = setid.TransferFunction(2, 3), setid.Noise(output=1.0)
    u = np.random.default_rng(3).uniform(0.0, 1.0, 20)
    truth = setid.simulate_record(model, PLANT, u, noise, 3)
    result = setid.identify(truth.data, model, noise, options=QUICK)
    centre = result.centre
    assert centre.member is (centre.level <= 1.0)
    assert ("proved not to be consistent" in str(centre)) is not centre.member


def small_beside_its_readings() -> setid.Identification:
    """Readings about 1000 and noise of 1e-4: a millionth of the one is a hundredth of the other."""
    draw, y = np.random.default_rng(0), [1000.0]
    u = draw.uniform(-1, 1, 20)
    for value in u[1:]:
        y.append(1000 + 0.5 * (y[-1] - 1000) + value + draw.uniform(-1e-4, 1e-4))
    model = setid.TransferFunction(na=1, nb=1, offset=True)
    return setid.identify(setid.IOData(u, y), model, setid.Noise(equation=1e-4), options=QUICK)


def test_samples_that_bind_are_at_their_bound_however_large_readings_are() -> None:
    result = small_beside_its_readings()
    u, y = result.formulation.data.u.ravel(), result.formulation.data.y.ravel()
    found: dict[int, int] = {}
    for x in result.witnesses:
        error = np.abs(y[1:] + x[0] * y[:-1] - x[1] * u[1:] - x[2])
        for sample in np.flatnonzero(error > 1e-4 * (1 - 1e-5)).tolist():
            found[sample + 1] = found.get(sample + 1, 0) + 1
    assert {sample: count for _, sample, count in result.binding()} == found
    assert max(found.values()) <= len(result.witnesses) and len(found) < 19
    assert f"equation error {sum(found.values())} times" in result.summary()


@pytest.mark.parametrize(
    ("unit", "prior", "active"),
    [
        (1.0, setid.Box({"b0": (0, 1e7)}), False),
        (1.0, setid.Box({"b0": (0.999, 1e7)}), True),
        (1e-7, setid.Box({"b0": (0, 1e-6)}), False),
        (1e-7, setid.DCGain(0, 1e-6), False),
        (1e-7, setid.DCGain(1.99e-7, 2e-7), True),
    ],
)
def test_a_prior_is_active_in_the_units_of_its_parameters(
    unit: float, prior: setid.Box | setid.DCGain, active: bool
) -> None:
    draw, y = np.random.default_rng(0), [0.0]
    u = draw.uniform(-1, 1, 20)
    for value in u[1:]:
        y.append(0.5 * y[-1] + unit * (value + draw.uniform(-0.01, 0.01)))
    model, noise = setid.TransferFunction(na=1, nb=1), setid.Noise(equation=0.01 * unit)
    result = setid.identify(setid.IOData(u, y), model, noise, [prior], options=QUICK)
    assert list(result.active.values()) == [active]


def test_help_for_open_intervals_is_about_this_run() -> None:
    data = setid.IOData([1, -1, 1, 1, -1, 1, -1, -1], np.linspace(0.0, 1.0, 8))
    model = setid.TransferFunction(2, 1, 1)
    short = setid.Options(time_limit=0.01, progress=False)
    bare, stable = (
        setid.identify(data, model, setid.Noise(output=0.1), priors, short)
        for priors in ((), setid.Stable())
    )
    assert str(bare.status) == str(stable.status) == "partial"
    assert "give a prior such as Stable, or Box for" in bare.summary()
    assert "such as Stable" not in stable.summary()
