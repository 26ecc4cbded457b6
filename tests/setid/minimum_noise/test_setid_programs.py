"""The least noise for one denominator, against a dense linear program."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.signal import lfilter

import setid
from setid.minimum_noise.programs import Programs, longest_stretches
from setid.proofs.denominators.output_rows import OutputRows, output_rows

Reals = NDArray[np.float64]
MODEL = setid.TransferFunction(3, 2, 1, offset=True)


def slow_rows(gaps: tuple[int, ...]) -> OutputRows:
    """200 samples of a system that is sampled fast, with readings that are missing."""
    random = np.random.default_rng(3)
    u = np.repeat(random.uniform(-1.0, 1.0, 20), 10)
    y = lfilter([0.0, 0.01], np.poly([0.97, 0.9, 0.6]), u) + random.uniform(-0.05, 0.05, 200)
    y[list(gaps)] = np.nan
    formulation = setid.formulate(setid.IOData(u, y), MODEL, setid.Noise(output=0.1))
    found = output_rows(formulation, 0)
    assert found is not None
    return found


def least(rows: OutputRows, section: NDArray[np.int64], a: Reals) -> float:
    """The largest error that is left, in noise bounds: outputs are filtered and unknown pulses.

    Pulses at the n samples before a stretch of rows make all of its states.
    """
    n, c = rows.order, rows.known.shape[1]
    parts = np.split(section, np.flatnonzero(np.diff(section) > 1) + 1)
    outputs, known = np.zeros((0, c + n * len(parts))), np.zeros(0)
    for place, part in enumerate(parts):
        samples = np.arange(part[0] - n, part[-1] + 1)
        drive = np.zeros((samples.size, c + n * len(parts)))
        drive[n:, :c] = rows.known[part]
        drive[:n, c + n * place : c + n * (place + 1)] = np.eye(n)
        found = lfilter([1.0], a, drive, axis=0) / rows.bound[samples, None]
        outputs = np.vstack([outputs, found])
        known = np.append(known, rows.y[samples] / rows.bound[samples])
    columns = np.linalg.qr(outputs)[0]
    one = np.ones((known.size, 1))
    solved = linprog(
        np.append(np.zeros(columns.shape[1]), 1.0),
        A_ub=np.vstack([np.hstack([columns, -one]), np.hstack([-columns, -one])]),
        b_ub=np.append(known, -known),
        bounds=[(None, None)] * (columns.shape[1] + 1),
        method="highs",
    )
    assert solved.status == 0
    return float(solved.fun)


@pytest.mark.parametrize("gaps", [(), (50, 51, 120), tuple(range(12, 200, 17))])
def test_exchanges_end_at_the_least_noise_of_any_denominator(gaps: tuple[int, ...]) -> None:
    """Of slow and fast poles: some columns decay at once, and few samples tell of them."""
    rows, random = slow_rows(gaps), np.random.default_rng(0)
    section = longest_stretches(rows.row, rows.order)
    programs = Programs(rows, section)
    for _ in range(25):
        a = np.poly(1.0 - np.exp(random.uniform(np.log(3e-3), 0.0, 3)))
        columns = programs.orthonormal(a)
        assert columns is not None
        last = np.arange(len(columns) - columns.shape[1] - 1, len(columns))  # where columns are 0
        found = programs.solve(a, None if random.random() < 0.7 else last)
        assert found is not None
        level, multiplier, _ = found
        assert level == pytest.approx(least(rows, section, a), rel=2e-3)
        assert not np.any(multiplier[~rows.row])
        filtered = np.convolve(a[::-1], np.append(multiplier, np.zeros(3)))[3 : 3 + rows.y.size]
        needed = filtered @ rows.y / (np.abs(filtered) @ rows.bound)
        assert needed == pytest.approx(level, rel=2e-3)
        np.testing.assert_allclose(multiplier @ rows.known, 0.0, atol=1e-9 * abs(multiplier).max())


def test_stretches_that_share_readings_do_not_both_count() -> None:
    row = np.array([True] * 5 + [False] + [True] * 4 + [False, False, True])
    assert longest_stretches(row, 2).tolist() == [0, 1, 2, 3, 4, 12]
    assert longest_stretches(row, 1).tolist() == [*range(5), *range(6, 10), 12]
    assert longest_stretches(np.zeros(3, bool), 1).size == 0


def test_records_that_one_model_does_not_explain_need_noise_together() -> None:
    """Gains 2 and 3: one gain leaves at least half of their difference at the largest input.

    A numerator b of y(k) = b u(k-1) is off by 0.5 in one record at least, and inputs reach 1.
    """
    random = np.random.default_rng(1)
    u = random.uniform(-1.0, 1.0, (2, 80))
    u[:, 40] = 1.0
    parts = [
        setid.IOData(v, gain * np.append(0.0, v[:-1]))
        for v, gain in zip(u, (2.0, 3.0), strict=True)
    ]
    noise, options = setid.Noise(output=1.0), setid.Options(tol=0.05, time_limit=30)
    model = setid.TransferFunction(na=0, nb=1, nk=1)
    found = setid.consistency(setid.IOData.concat(parts), model, noise, options=options)
    assert 0.475 <= found.scale[0] <= 0.5 <= found.scale[1] <= 0.501
    assert found.verify()
