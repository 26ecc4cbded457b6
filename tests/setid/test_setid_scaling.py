"""Outputs of 3000, gains of 200 and noise that leaves widths of 30 %: nothing may fail."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

import setid

QUICK = setid.Options(time_limit=60.0, progress=False)
FIRST, SECOND = setid.TransferFunction(1, 1), setid.TransferFunction(2, 2, 1)
TRUTH = {FIRST: (-0.9, 200.0), SECOND: (-1.5, 0.7, 200.0, -90.0)}


def record(model: setid.TransferFunction, noise: setid.Noise, samples: int) -> setid.Simulated:
    """Steps of a slow input, so that outputs reach the static gain."""
    u = np.repeat(np.random.default_rng(4).uniform(-2.0, 2.0, samples), 4)[:samples]
    return setid.simulate_record(model, TRUTH[model], u, noise, 4)


def explained(data: setid.IOData, bound: float, a: float, b: float) -> bool:
    """Whether some |eta| <= bound explains a record of order one, by a linear program."""
    y, u = data.y.ravel(), data.u.ravel()
    count = y.size
    step = np.eye(count)[1:] + a * np.eye(count)[:-1]
    found = linprog(
        np.zeros(count), A_eq=step, b_eq=step @ y - b * u[1:], bounds=[(-bound, bound)] * count
    )
    return found.status == 0


def test_wide_intervals_of_large_numbers_agree_with_linear_programs_on_a_grid() -> None:
    bound = 700.0
    truth = record(FIRST, setid.Noise(output=bound), 24)
    assert np.abs(truth.y).max() > 1500 and np.abs(truth.data.y).max() > 2000
    result = setid.identify(truth.data, FIRST, setid.Noise(output=bound), options=QUICK)
    assert result.status == "certified" and bool(result.verify(truth.data))
    assert all(v in result.intervals[n] for n, v in truth.theta.items())
    (low_a, high_a), (low_b, high_b) = (result.intervals[n].outer for n in ("a1", "b0"))
    assert high_b - low_b > 0.3 * 200.0  # strong noise
    wide = 0.25 * (high_a - low_a), 0.25 * (high_b - low_b)
    inside = 0
    for a in np.linspace(low_a - wide[0], high_a + wide[0], 13):
        for b in np.linspace(low_b - wide[1], high_b + wide[1], 13):
            if explained(truth.data, bound, float(a), float(b)):
                inside += 1
                assert low_a <= a <= high_a and low_b <= b <= high_b
    assert inside > 5
    for name, place in (("a1", 0), ("b0", 1)):  # what is attained is explained
        for witness in result.intervals[name].witnesses:
            assert witness is not None
            theta = witness[:2]
            assert explained(truth.data, bound * (1 + 1e-7), *theta.tolist())
            assert (
                min(abs(theta[place] - e) for e in result.intervals[name].outer)
                < 1e-2 * wide[place] * 4
            )


def test_errors_in_variables_of_order_two_scale_with_their_units() -> None:
    """Intervals in other units, 4096 times smaller, contain what is attained in these."""
    noise = setid.Noise(output=30.0, input=0.01)
    truth = record(SECOND, noise, 14)
    assert np.abs(truth.y).max() > 1000
    small = setid.IOData(truth.data.u, truth.data.y / 4096.0)
    less = setid.Noise(output=30.0 / 4096.0, input=0.01)
    pair = [
        setid.identify(data, SECOND, bounds, options=QUICK)
        for data, bounds in ((truth.data, noise), (small, less))
    ]
    for result in pair:
        assert bool(result.verify())
    for name, value in truth.theta.items():
        large, other = (result.intervals[name] for result in pair)
        factor = 1.0 if name[0] == "a" else 4096.0
        assert value in large and large.inner is not None and other.inner is not None
        for mine, theirs in ((large, other.inner), (other, large.inner)):
            unit = factor if mine is large else 1.0 / factor
            assert mine.outer[0] <= theirs[0] * unit and theirs[1] * unit <= mine.outer[1]
        assert large.status == other.status == "certified"
