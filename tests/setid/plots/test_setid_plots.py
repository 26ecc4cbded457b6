"""Pictures: that they are drawn, and that labels say what is proved."""

from __future__ import annotations

import builtins
import io
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from identified_cases import empty, first_order, identified

import setid
import sparsepop_py as sp
from setid.bands.comparison import compare
from setid.bands.outputs import simulate_band
from setid.bands.residuals import residuals
from setid.bands.responses import frequency_band
from setid.bands.steps import step_band
from setid.feasible_set.projections import project
from setid.plots.axes import require_matplotlib
from setid.plots.intervals import plot_intervals
from setid.plots.responses import plot_frequency_band


def legend(ax) -> set[str]:
    return {text.get_text() for text in ax.get_legend().get_texts()}


def test_intervals(result: setid.Identification) -> None:
    ax = plot_intervals(result)
    assert legend(ax) == {"outer (proved)", "inner (attained)"}
    assert [text.get_text().split()[0] for text in ax.get_yticklabels()] == list(result.intervals)
    ax.figure.canvas.draw()


def test_infinite_and_empty_intervals_are_written_out() -> None:
    base = first_order().formulation
    endless = identified(base, [(-np.inf, 1.0), (0.0, 1.0)])
    assert "partial" in {text.get_text() for text in plot_intervals(endless).texts}
    assert "empty" in {text.get_text() for text in plot_intervals(empty(base)).texts}


@pytest.mark.parametrize("sort", ["proved", "sampled"])
def test_frequency_plots_say_what_they_are(result: setid.Identification, sort: str) -> None:
    band = frequency_band(result, [0.1, 1.0], kind=sort, samples=5)
    magnitude, phase = band.plot()
    assert sort in legend(magnitude) and phase.get_ylabel() == "phase, degrees"
    for kind in ("nyquist", "nichols"):
        ax = band.plot(kind)
        assert any(text.startswith(sort) for text in legend(ax))
        ax.figure.canvas.draw()
    with pytest.raises(setid.SetidError, match="bode, nyquist, nichols"):
        plot_frequency_band(band, "bodie")


def shown(axes) -> str:
    """The texts of a picture as they are seen."""
    buffer = io.StringIO()
    with plt.rc_context({"svg.fonttype": "none"}):
        np.ravel(axes)[0].figure.savefig(buffer, format="svg")
    return buffer.getvalue()


@pytest.mark.slow
def test_names_and_units_are_no_mathematics() -> None:
    data = setid.IOData(
        [4, -3, 2, 1, 2, -1],
        [0, -6.25, 1.175, 2.0875, 3, 1],
        input_names=r"\$u",
        output_names=r"$\foo$",
        input_units="$",
        output_units="$/$",
        time_unit="$s$",
    )
    result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=5.0))
    output, input_, times = r"$\foo$ [$/$]", r"\$u [$]", "time [$s$]"
    text = shown(data.plot())
    assert all(f">{label}<" in text for label in (output, input_, times))
    assert f">{output}<" in shown(setid.predict(result).plot())
    assert f">{output} from {input_}, proved" in shown(frequency_band(result, [0.1, 1.0]).plot())
    step = shown(step_band(result, 5).plot())
    assert f">{output} for a step in {input_}<" in step and f">{times}<" in step
    assert ">frequency, rad per $s$<" in shown(frequency_band(result, [0.1, 1.0]).plot())
    assert f">{output}<" in shown(setid.fit(data, setid.TransferFunction(1, 1)).plot())


@pytest.mark.slow
def test_a_report_holds_pictures_of_channels_with_dollars(tmp_path) -> None:
    names = {"output_names": r"$\foo$", "input_names": "$$"}
    data = setid.IOData([4, -3, 2, 1, 2, -1], [0, -6.25, 1.175, 2.0875, 3, 1], **names)
    result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=5.0))
    result.report(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text(encoding="utf-8").count("data:image/svg") > 1


@pytest.mark.slow
def test_infinite_bands_can_be_drawn() -> None:
    base = first_order().formulation
    loose = setid.formulate(base.data, base.model, setid.Noise(output=5.0))
    band = frequency_band(identified(loose, [(-3.0, 3.0), (-3.0, 5.0)]), [0.5, 1.0])
    for kind in ("bode", "nyquist", "nichols"):
        ax = np.ravel(band.plot(kind))[0]
        ax.figure.canvas.draw()


def test_steps_records_and_residuals(result: setid.Identification) -> None:
    band = step_band(result, 20)
    ax = band.plot()
    assert "proved" in legend(ax)
    drawn = ax.collections[0].get_paths()[0].vertices
    for ends in (band.low, band.high):  # stairs, as the nominal response is drawn
        held = np.column_stack([band.time[1:], ends[:-1]])
        assert np.all(np.abs(drawn[:, None] - held).max(axis=2).min(axis=0) <= 1e-9)
    (axes,) = simulate_band(result).plot()
    assert {"readings (proved)", "models (proved)", "reading"} <= legend(axes)
    (axes,) = compare(result).plot()
    assert "fit" in axes.get_title()
    axes.figure.canvas.draw()
    assert residuals(result).plot().get_ylabel() == "residual / bound"


def test_what_is_no_axes_is_refused(result: setid.Identification) -> None:
    for draw in (result.plot, step_band(result, 20).plot, simulate_band(result).plot):
        with pytest.raises(setid.SetidError, match="ax: found str, expected Axes of matplotlib"):
            draw("bode")


def test_projections(result: setid.Identification) -> None:
    ax = project(result, "a1", "b1").plot()
    assert legend(ax) == {"exact", "attained"}
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("a1", "b1")


def test_a_missing_matplotlib_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *rest: object) -> object:
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(sp.SolverNotFound, match=r"sparsepop-py\[plot\]"):
        require_matplotlib()


QUADRANGLE = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])


def test_a_factor_that_nothing_attains_is_drawn_and_said_as_such() -> None:
    """The readings 1 and 2 of u = 1 are exact, so that no factor on 0.1 explains them."""
    noise = setid.Noise(equation=[0.0, 0.0, 0.1])
    found = setid.consistency(
        setid.IOData([1, 1, 2], [1, 2, 3]), setid.TransferFunction(0, 1), noise
    )
    assert found.scale == (np.inf, np.inf) and found.verify()
    assert "bounds: none, however large (proved)" in found.summary()
    assert "none, however large" in repr(found) and ">none<" in found._repr_html_()
    ax = found.plot()
    assert legend(ax) == {"inconsistent (proved)", "the bounds as given"}
    ax.figure.canvas.draw()


def test_the_sign_of_a_sensitivity_is_lost_only_where_that_is_attained() -> None:
    model, noise = setid.TransferFunction(1, 1), setid.Noise(equation=0.5)
    found = setid.identify(QUADRANGLE, model, noise).sensitivity([1.0, 4.0])
    assert "sign of a1 lost" in legend(found.plot())
    low, _ = found.lost["a1"]
    unknown = replace(found, lost={"a1": (low, np.inf), "b0": (np.inf, np.inf)})
    labels = legend(unknown.plot())
    assert "sign of a1 proved up to here" in labels and "sign of a1 lost" not in labels


def test_widths_are_shares_of_the_largest_finite_ends() -> None:

    model, noise = setid.TransferFunction(1, 1), setid.Noise(equation=0.5)
    found = setid.identify(QUADRANGLE, model, noise).sensitivity([1.0, 4.0])
    outer = found.outer.copy()
    outer[1, 0] = -np.inf, np.inf
    lines = replace(found, outer=outer).plot().get_lines()
    (widths,) = [line.get_ydata() for line in lines if line.get_label() == "a1"]
    low, high = found.outer[0, 0]
    assert widths[0] == pytest.approx((high - low) / abs(low)) and np.isnan(widths[1])


def test_a_transient_begins_at_the_step_beside_missing_inputs() -> None:
    u = np.append(np.zeros(20), np.ones(180))
    y = setid.simulate(setid.TransferFunction(1, 1, 1), [-0.9, 0.1], u)
    u[3] = np.nan
    (span,) = setid.advise(setid.IOData(u, y, 0.01)).plot().patches
    assert span.get_xy()[0] == pytest.approx(20 * 0.01)


def test_the_width_about_a_parameter_of_zero_is_written_out() -> None:
    """Rows |b0 + u' b1| <= 0.1 of u = u' = 1 and u = 1, u' = -1 leave |b1| <= 0.1."""
    u, noise = [1, 1, -1, -1, 1], setid.Noise(equation=0.1)
    ax = setid.excitation(setid.TransferFunction(0, 2), [1.0, 0.0], u, noise).plot()
    assert [text.get_text() for text in ax.texts] == ["± 0.1, of zero"]


def drawn_band(gains: list[list[float]], phases: list[list[float]]) -> setid.FrequencyBand:
    """A proved band at three frequencies with a nominal response of gain 1, 0.001 and 1."""
    regions = np.where(np.isfinite(gains)[:, :1] & np.isfinite(gains)[:, 1:], 1.0 + 0j, np.inf)
    return setid.FrequencyBand(
        kind="proved",
        output=1,
        input=1,
        omega=np.array([0.1, 1.0, 2.0]),
        nominal=np.array([1.0, 0.001, 1.0], complex),
        magnitude=np.array(gains),
        phase=np.array(phases),
        regions=np.repeat(regions, 4, axis=1),
    )


def test_pictures_of_responses_say_what_they_clip() -> None:
    band = drawn_band(
        [[0.5, 2.0], [0.0, 2.0], [0.0, np.inf]], [[-0.1, 0.1], [-np.pi, np.pi], [0.0, 2 * np.pi]]
    )
    magnitude, phase = band.plot()
    gains = "gain clipped at 2 of 3 frequencies, may be 0 at 1, no largest proved at 1"
    angles = "any phase (full circle) at 2 of 3 frequencies"
    assert [text.get_text() for text in magnitude.texts] == [gains]
    assert [text.get_text() for text in phase.texts] == [angles]
    assert [text.get_text() for text in band.plot("nichols").texts] == [f"{gains}\n{angles}"]
    left = "nothing proved, nothing drawn at 1 of 3 frequencies"
    assert [text.get_text() for text in band.plot("nyquist").texts] == [left]
    drawn = magnitude.collections[0].get_paths()[0].vertices[:, 1]
    assert drawn.min() == -80.0  # 20 dB below the nominal gain of -60 dB, the least that is finite


def test_pictures_of_narrow_responses_have_no_remark() -> None:
    band = drawn_band([[0.5, 2.0], [0.0005, 2.0], [0.5, 2.0]], [[-0.1, 0.1]] * 3)
    for kind in ("bode", "nyquist", "nichols"):
        assert not any(ax.texts for ax in np.ravel(band.plot(kind)))
