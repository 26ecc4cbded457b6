"""Time limits of bands, on a clock that only enclosures move."""

from __future__ import annotations

import numpy as np
import pytest

import setid
from setid.bands import branching
from setid.feasible_set import proposer
from setid.proofs.time_bands.partition import Partition


@pytest.fixture(scope="module")
def unstable() -> setid.Identification:
    """Equation errors so large that most cells hold unstable members."""
    u = np.random.default_rng(0).uniform(-1.0, 1.0, 40)
    model, errors = setid.TransferFunction(3, 1), setid.Noise(equation=0.375)
    theta = [*np.poly([0.9, 0.7, 0.5])[1:].tolist(), 0.5]
    data = setid.simulate_record(model, theta, u, errors, seed=0).data
    return setid.identify(data, model, setid.Noise(equation=1.5))


def slow_programs(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Let each linear program take ten seconds, and nothing else any; return the clock."""
    clock, solved = [0.0], proposer.Proposer._solved

    def slow(self, goal):
        clock[0] += 10.0
        return solved(self, goal)

    monkeypatch.setattr(proposer.Proposer, "_solved", slow)
    monkeypatch.setattr(branching.time, "monotonic", lambda: clock[0])
    return clock


def test_cells_that_wait_are_enclosed_in_the_time_that_is_left(
    unstable: setid.Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cell whose gain is too large takes little, and a second once it is enclosed at the end."""
    clock, enclose = [0.0], Partition.enclose

    def timed(self, *arguments):
        known, found = enclose(self, *arguments)
        clock[0] += 0.01 if found is None else 1.0
        return known, found

    monkeypatch.setattr(Partition, "enclose", timed)
    monkeypatch.setattr(branching.time, "monotonic", lambda: clock[0])
    band = unstable.step(30, tolerance=0.01, time_limit=10.0)
    assert band.report.cells > 3 and 5.0 < clock[0] < 14.0


def test_no_cell_is_halved_whose_halves_would_take_too_long(
    unstable: setid.Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Enclosures of four seconds each: after the first one both halves end beyond ten seconds."""
    clock, enclose = [0.0], Partition.enclose

    def timed(self, *arguments):
        clock[0] += 4.0
        return enclose(self, *arguments[:-1], np.inf)

    monkeypatch.setattr(Partition, "enclose", timed)
    monkeypatch.setattr(branching.time, "monotonic", lambda: clock[0])
    unstable.step(30, tolerance=0.01, time_limit=10.0)
    assert clock[0] <= 10.0


def test_bands_end_where_programs_take_long(
    unstable: setid.Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a machine on which each program takes ten seconds, a limit of one second is kept."""
    clock = slow_programs(monkeypatch)
    unstable.step(30, time_limit=1.0)
    assert 0.0 < clock[0] <= 30.0
    clock[0] = 0.0
    unstable.bode([0.1, 1.0, 2.0], time_limit=1.0)
    assert 0.0 < clock[0] <= 30.0


@pytest.mark.parametrize("name", ["bode", "nyquist", "nichols"])
def test_frequency_bands_have_a_time_limit(unstable: setid.Identification, name: str) -> None:
    ask = getattr(unstable, name)
    assert ask([0.1, 1.0], time_limit=0.0).magnitude.shape == (2, 2)
    with pytest.raises(setid.SetidError, match="time_limit: found 'long'"):
        ask([0.1, 1.0], time_limit="long")
    with pytest.raises(setid.SetidError, match="time_limit: found -1, expected seconds >= 0"):
        ask([0.1, 1.0], time_limit=-1)


def test_predictions_have_a_time_limit(
    unstable: setid.Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is left when time is over keeps its range over the outer box, which holds the other."""
    whole = unstable.predict()
    clock = slow_programs(monkeypatch)
    for ask in (
        unstable.predict,
        lambda **limit: unstable.compare(mode="prediction", **limit).band,
    ):
        clock[0] = 0.0
        band = ask(time_limit=1.0)
        assert 0.0 < clock[0] <= 30.0
        known = ~np.isnan(whole.low)
        assert np.all(band.low[known] <= whole.low[known] + 1e-9)
        assert np.all(band.high[known] >= whole.high[known] - 1e-9)
        assert np.all(np.isfinite(band.high[known] - band.low[known]))
        assert whole.late == 0 < band.late <= 2 * np.count_nonzero(known)
    clock[0] = 0.0
    said = unstable.compare(mode="prediction", time_limit=1.0).summary()
    assert "a larger time_limit narrows them" in said
    with pytest.raises(setid.SetidError, match="time_limit: found -1"):
        unstable.predict(time_limit=-1)


def test_bands_need_no_time_limit() -> None:
    data = setid.IOData([1, 0, 2, 1, 0, 1, 2, 0, 1], [0, 1, 0.5, 2.25, 2.1, 1.0, 0.9, 2.2, 1.1])
    model, options = setid.TransferFunction(1, 1, 1), setid.Options(tol=1e-2, progress=False)
    result = setid.identify(data, model, setid.Noise(output=0.4), options=options)
    band = setid.step_band(result, 10, time_limit=float("inf"))
    assert band.report is not None and band.report.verdict == "tight"


@pytest.fixture(scope="module")
def first_order() -> setid.Identification:
    data = setid.IOData([1, 0, 2, 1, 0, 1, 2, 0, 1], [0, 1, 0.5, 2.25, 2.1, 1.0, 0.9, 2.2, 1.1])
    return setid.identify(data, setid.TransferFunction(1, 1, 1), setid.Noise(equation=0.4))


def test_bands_without_a_time_limit_end_where_halving_does_not_reach_the_tolerance(
    first_order: setid.Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A tolerance below rounding errors: no number of cells reaches it."""
    monkeypatch.setattr(branching, "_FIRST_SURVEY", 10)
    report = first_order.step(3, tolerance=1e-16, time_limit=float("inf")).report
    assert report is not None and report.verdict == "wide" and report.spent
    assert 40 <= report.cells < 400
    assert "no further cells are tried" in report.text and "time_limit" not in report.text


def test_cells_as_narrow_as_rounding_are_not_halved(first_order: setid.Identification) -> None:
    """The pole is known exactly, so that halves of its cell are the cell."""
    known = setid.Box({"a1": (-0.5, -0.5)})
    formulation = first_order.formulation
    found = setid.identify(formulation.data, formulation.model, formulation.noise, known)
    report = found.step(3, tolerance=1e-12).report
    assert report is not None and report.verdict == "wide" and report.spent
    assert report.cells <= 9
