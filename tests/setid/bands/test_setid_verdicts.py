"""What reports of bands say, and what bands that say nothing look like."""

from __future__ import annotations

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from identified_cases import identified, second_order

import setid
from setid.bands.comparison import Comparison
from setid.bands.outputs import OutputBand, simulate_band
from setid.bands.verdicts import BandReport, ratio_of
from setid.plots.axes import clip


def report(verdict: str, **other: float) -> BandReport:
    base = BandReport("tight", 9, 5, 0, 1.25, 0.9, 0.25)
    return replace(base, verdict=verdict, **other)  # type: ignore[arg-type]


def test_reports_say_why_a_band_is_wide_or_infinite() -> None:
    assert "at most 1.25 times the attained one (5 of 9 cells" in report("tight").text
    assert "at most 1.13 times" in report("tight", ratio=1.12001).text
    assert "more time for identify" not in report("tight").text
    assert "more time for identify" in report("tight", ratio=28.0).text
    assert "time is over" in report("wide", ratio=4.0).text
    assert "pole of radius 1.02" in report("wide", pole_radius=1.02).text
    assert "a member is unstable" in report("unstable", pole_radius=1.02).text
    text = report("unproved", growing=3).text
    assert "the stability of 3 cells is not proved" in text
    assert "time_limit" in text
    for verdict in ("wide", "unstable", "unproved"):
        assert "time_limit" not in report(verdict, spent=True).text


def test_merged_reports_advise_more_time_where_it_narrows_one_of_the_worst() -> None:
    ended, late = report("wide", spent=True), report("wide")
    assert BandReport.merged([ended, report("tight")]).spent
    assert not BandReport.merged([ended, late]).spent


def test_merged_reports_are_as_bad_as_the_worst() -> None:
    found = BandReport.merged([report("tight"), report("wide", ratio=3.0), report("tight")])
    assert (found.verdict, found.cells, found.left, found.ratio) == ("wide", 27, 15, 3.0)
    nothing = float("nan")
    found = BandReport.merged([report("tight", ratio=nothing), report("unproved", ratio=nothing)])
    assert found.verdict == "unproved" and np.isnan(found.ratio)


def test_ratios_leave_out_samples_at_which_nothing_varies() -> None:
    attained = np.array([0.0, 0.0, 0.0]), np.array([1.0, 1e-3, 0.5])
    proved = np.array([0.0, -1.0, -0.25]), np.array([1.2, 1.0, 0.5])
    assert ratio_of(proved, attained) == pytest.approx(1.5)
    none = np.full(3, np.nan)
    assert np.isnan(ratio_of(proved, (none, none)))


def wide_band() -> OutputBand:
    """A proved band that is widened by hand: ends of three kinds."""
    band = simulate_band(second_order())
    low, high = band.reading_low.copy(), band.reading_high.copy()
    low[10:20] = -np.inf
    low[20:50], high[20:50] = -1e9, 1e9
    return replace(band, reading_low=low, reading_high=high)


def test_a_band_that_says_nothing_is_counted() -> None:
    band = simulate_band(second_order())
    assert not band.silent.any()
    wide = wide_band()
    assert np.array_equal(np.flatnonzero(wide.silent), np.arange(10, 50))
    lines = Comparison((), np.zeros(0), np.zeros(1), wide).summary()
    assert f"the band says nothing at 40 of {wide.data.samples} samples" in lines
    assert "says nothing" not in Comparison((), np.zeros(0), np.zeros(1), band).summary()
    everywhere = np.full_like(band.low, 1e9)
    none = replace(wide, reading_low=-everywhere, reading_high=everywhere)
    shown = Comparison((), np.zeros(0), np.zeros(1), none).summary().splitlines()
    assert shown[1] == "the proved band of models is no test of any reading"


def test_pictures_follow_the_readings_and_say_what_is_clipped() -> None:
    (ax,) = wide_band().plot()
    low, high = ax.get_ylim()
    y = wide_band().data.y
    assert low < y.min() and y.max() < high and high - low <= 2.0 * np.ptp(y) * (1 + 1e-9)
    samples = len(y)
    (text,) = [t.get_text() for t in ax.texts]
    assert text == f"band clipped at 40 of {samples} samples, fills the picture at 30"
    ax.figure.canvas.draw()
    plt.close("all")


def test_titles_stand_above_what_is_said_of_clipping() -> None:
    (ax,) = Comparison((), np.zeros(0), np.zeros(1), wide_band()).plot()
    ax.figure.canvas.draw()
    renderer = ax.figure.canvas.get_renderer()
    (caption,), title = ax.texts, ax.title
    assert title.get_window_extent(renderer).y0 >= caption.get_window_extent(renderer).y1
    plt.close("all")


def test_mean_widths_are_those_of_samples_at_which_the_band_is_a_test() -> None:
    """Bands of two outputs are not averaged together, and infinite ones not with others."""
    wide = wide_band()
    said = ~wide.silent[:, 0]
    mean = f"{np.mean((wide.high - wide.low)[said, 0]):.4g}"
    text = Comparison((), np.zeros(0), np.zeros(1), wide).summary()
    assert f"band of models where it says something  {mean}" in text
    names, units = ("T", "p"), ("K", "bar")
    data = setid.IOData([1, 2, 3], np.ones((3, 2)), output_names=names, output_units=units)
    ends = np.zeros((3, 2)), np.array([[0.5, 4.0], [1.5, 6.0], [1.0, 5.0]])
    apart = np.full((3, 2), 2.0)
    two = replace(wide, data=data, low=ends[0], high=ends[1], reading_low=apart, reading_high=apart)
    text = Comparison((), np.zeros(0), np.zeros(2), two).summary()
    assert "mean width of the proved band of models  T: 1 K, p: 5 bar" in text


def test_nothing_is_clipped_where_the_band_is_near() -> None:
    _, ax = plt.subplots()
    ends = np.zeros(3), np.ones(3)
    assert not clip(ax, np.array([0.0, 1.0]), ends) and not ax.texts
    assert not clip(ax, np.array([np.nan]), ends)
    plt.close("all")


def test_unstable_members_and_cells_without_a_proof_are_told_apart() -> None:
    model, noise = setid.TransferFunction(1, 1, nk=1), setid.Noise(equation=1e-3)
    u = np.random.default_rng(0).uniform(-1, 1, 40)
    truth = setid.simulate_record(model, [-1.5, 1.0], u, noise)
    rows = setid.formulate(truth.data, model, noise)
    known = identified(rows)
    steep = setid.step_band(known, 2500, time_limit=1.0)  # 1.5^2500 is no double
    assert steep.report is not None and steep.report.verdict == "unstable"
    assert steep.report.pole_radius == pytest.approx(1.5, abs=1e-2)
    # abs(a1) < 1 + a2 < 2 on the whole box: every member is stable, but one cell does not show it
    second = setid.TransferFunction(2, 1, nk=1)
    loose = setid.formulate(truth.data, second, setid.Noise(equation=1e9))
    box = identified(loose, [(-0.9, 0.9), (-0.05, 0.5), (0.9, 1.1)])
    found = setid.step_band(box, 2500, time_limit=0.0).report
    assert found is not None and found.verdict == "unproved" and found.growing == 1
    assert found.pole_radius < 1.0


def test_steps_leave_the_offset_out() -> None:
    model = setid.TransferFunction(na=1, nb=1, nk=1, offset=True)
    u = np.random.default_rng(0).uniform(-1, 1, 60)
    noise = setid.Noise(equation=0.01)
    truth = setid.simulate_record(model, [-0.5, 1.0, 5.0], u, noise)
    result = identified(setid.formulate(truth.data, model, noise))
    plant = setid.simulate(setid.TransferFunction(na=1, nb=1, nk=1), [-0.5, 1.0], np.ones(20))
    for kind in ("proved", "sampled"):
        band = setid.step_band(result, 20, kind=kind)
        assert abs(band.nominal[0]) == 0.0 and np.abs(band.high).max() < 2.5
        assert np.all(band.low <= plant.ravel() + 0.1) and np.all(plant.ravel() - 0.1 <= band.high)
    proved = setid.step_band(result, 20)
    assert np.all((proved.low <= plant.ravel()) & (plant.ravel() <= proved.high))


def test_bad_accuracies_are_refused() -> None:
    result = second_order(samples=40)
    with pytest.raises(setid.SetidError, match="tolerance"):
        setid.step_band(result, 5, tolerance=0.0)
    with pytest.raises(setid.SetidError, match="time_limit"):
        setid.step_band(result, 5, time_limit=-1.0)
    with pytest.raises(setid.SetidError, match="all_time"):
        setid.step_band(result, 5, all_time="yes")


def test_a_band_without_width_takes_no_time() -> None:
    """All parameters known, and an input that does not act: nothing can be narrowed."""
    model, u = setid.TransferFunction(1, 1, 1), np.random.default_rng(0).uniform(-1, 1, (20, 2))
    noise = setid.Noise(equation=0.01)
    one = setid.simulate_record(model, [-0.5, 1.0], u[:, :1], noise).data
    known = setid.identify(one, model, noise, setid.Known({"a1": -0.5, "b1": 1.0}))
    apart = setid.BlockStructured({("y1", "u1"): model, ("y2", "u2"): model}, {}, 2, 2)
    two = setid.simulate_record(apart, [-0.5, 0.4, 1.0, 2.0], u, noise).data
    still = setid.identify(two, apart, noise, setid.Stable())
    exact = 2.0 * (1.0 - 0.5 ** np.arange(20))
    for result, input, wanted in ((known, 1, exact), (still, 2, np.zeros(20))):
        band = setid.step_band(result, 20, input=input)
        assert band.report is not None and band.report.verdict == "tight"
        assert band.report.cells == 1 and "no attained width" in band.report.text
        assert np.all((band.low <= wanted) & (wanted <= band.high))
        assert np.all(band.high - band.low < 1e-11)
