"""Clocks change no result where the engine counts work and no limit in time is given."""

import itertools
import time

import numpy as np
import pytest

import setid
import sparsepop_py as sp
from setid.minimum_noise.conflicting_samples import conflicting_samples
from setid.minimum_noise.factor import search_factor
from sparsepop_py.budget import Deadline, spend

OPTIONS = setid.Options(tol=0.5, progress=False, engine=sp.Options(effort="auto", work_limit=0.02))
FIRST_ORDER = setid.TransferFunction(1, 1)


def record(samples: int = 8, error: float = 0.05) -> setid.IOData:
    """A system of first order with errors of its outputs within 0.05."""
    random, y = np.random.default_rng(3), np.zeros(samples)
    u = random.uniform(-1, 1, samples)
    for k in range(1, samples):
        y[k] = 0.5 * y[k - 1] + u[k]
    return setid.IOData(u, y + random.uniform(-error, error, samples))


@pytest.fixture
def leaping(monkeypatch: pytest.MonkeyPatch):
    """Let each reading of a clock be half a minute after the one before, once called."""

    def leap() -> None:
        clock = itertools.count(time.monotonic(), 30.0)
        for name in ("monotonic", "process_time"):
            monkeypatch.setattr(time, name, lambda: next(clock))
        monkeypatch.setattr("setid.options.monotonic", lambda: next(clock))

    return leap


def test_the_part_held_out_is_judged_whatever_clocks_say(leaping) -> None:
    # errors were drawn within 0.05: the true parameters need no more than the noise bounds
    leaping()
    found = setid.identify(
        record(), FIRST_ORDER, setid.Noise(output=0.05), options=OPTIONS, holdout=0.5
    )
    low, high = found.holdout.level.scale
    assert 0.05 < low <= high <= 1.0


def test_samples_that_contradict_each_other_are_found_whatever_clocks_say(leaping) -> None:
    y = record().y[:, 0].copy()
    y[5] += 3.0  # its neighbours refute it
    broken = setid.IOData(record().u, y)
    formulation = setid.formulate(broken, FIRST_ORDER, setid.Noise(output=0.05))
    deadline = Deadline.before(np.inf, 1.0)
    leaping()
    named = conflicting_samples(formulation, None, deadline)
    assert len(named) < 7 and {(1, 6), (1, 7)} & set(named)


def test_a_search_of_the_least_factor_counts_work(leaping) -> None:
    formulation = setid.formulate(record(), FIRST_ORDER, setid.Noise(output=0.2))
    first = search_factor(formulation, None, Deadline.before(np.inf, 0.1))
    leaping()
    again = search_factor(formulation, None, Deadline.before(np.inf, 0.1))
    assert first is not None and again is not None
    assert first.share == again.share < 1.0
    ended = Deadline.before(np.inf, 0.1)
    spend(0.2)
    assert search_factor(formulation, None, ended) is None


@pytest.mark.slow
def test_bands_without_a_time_limit_are_alike(leaping) -> None:
    def band() -> np.ndarray:  # of a new result: an earlier band leaves a smaller set of parameters
        result = setid.identify(record(), FIRST_ORDER, setid.Noise(output=0.05), options=OPTIONS)
        return setid.simulate_band(result, record(6), time_limit=np.inf).low

    first = band()
    leaping()
    np.testing.assert_array_equal(band(), first)
