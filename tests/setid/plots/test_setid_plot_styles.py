"""One convention of pictures: on given axes, legible on light and on dark pages."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.colors import to_rgb

import setid
from sparsepop_py.verified.arithmetic.display import rounded

FIRST = setid.TransferFunction(na=1, nb=1, nk=1)
STYLES = ["default", "dark_background"]


def selection() -> setid.Selection:
    u = [1, -1, 2, 0, 1, -2, 1, 3]
    y = setid.simulate(setid.TransferFunction(1, 2), [-0.5, 0, 1], u)
    data, noise = setid.IOData(u, y), setid.Noise(equation=1e-3)
    return setid.select(data, setid.TransferFunction, noise, [0, 1])


def first_order() -> setid.Identification:
    y = [0.0, 1.0, 0.5, 2.25, 2.125, 1.0625]
    data = setid.IOData([1, 0, 2, 1, 0, 1], y, Ts=0.5)
    return setid.identify(data, FIRST, setid.Noise(equation=0.05))


def physical() -> setid.Reparametrisation:
    gain = setid.Physical({"K": (0.1, 10.0)}, ["b1 = K*(1 + a1)"])
    return setid.reparametrise(first_order(), gain)


def noise_level() -> setid.Consistency:
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    return setid.consistency(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))


@pytest.fixture(scope="module")
def things(result: setid.Identification) -> dict[str, tuple[Any, int]]:
    """Objects with a picture, and how many axes it needs."""
    return {
        "record": (result.formulation.data, 2),
        "intervals": (result, 1),
        "prediction": (result.predict(), 1),
        "comparison": (result.compare(mode="prediction"), 1),
        "residuals": (setid.residuals(result), 1),
        "set": (result.fps("a1", "a2", 8), 1),
        "selection": (selection(), 1),
        "noise": (noise_level(), 1),
        "physical": (physical(), 1),
        "continuous": (setid.to_continuous(first_order()), 1),
        "control": (first_order().to_control(), 1),
        "simulated": (setid.simulate_record(FIRST, [-0.5, 1], [1, 0, 2], setid.Noise(0.1)), 2),
        "frequencies": (setid.frequency_band(result, [0.1, 1.0]), 2),
        "step": (setid.step_band(result, 8), 1),
    }


NAMES = [
    "record",
    "intervals",
    "prediction",
    "comparison",
    "residuals",
    "set",
    "selection",
    "noise",
    "physical",
    "continuous",
    "control",
    "simulated",
]


def luminance(colour: Any) -> float:
    """Relative luminance of WCAG 2.1."""
    parts = np.array(to_rgb(colour))
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(one: Any, other: Any) -> float:
    high, low = sorted((luminance(one), luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("name", NAMES)
def test_lines_and_texts_stand_out(
    things: dict[str, tuple[Any, int]], name: str, style: str
) -> None:
    with plt.style.context(style):
        axes = np.ravel(np.asarray(things[name][0].plot(), object))
        figure = axes[0].figure
        figure.canvas.draw()
        back = axes[0].get_facecolor()
        for axis in axes:
            for line in axis.get_lines():
                assert contrast(line.get_color(), back) >= 3.0, line.get_label()
            for text in [*axis.texts, axis.xaxis.label, axis.yaxis.label, axis.title]:
                assert not text.get_text() or contrast(text.get_color(), back) >= 4.5
            for text in [axis.xaxis.label, axis.yaxis.label]:
                box = text.get_window_extent()
                inside = figure.bbox.contains(box.x0, box.y0) and figure.bbox.contains(
                    box.x1, box.y1
                )
                assert not text.get_text() or inside


@pytest.mark.parametrize("name", NAMES)
def test_pictures_go_on_given_axes(things: dict[str, tuple[Any, int]], name: str) -> None:
    thing, count = things[name]
    _, given = plt.subplots(count, 1)
    before = plt.get_fignums()
    drawn = thing.plot(given) if count > 1 else thing.plot(ax=given)
    assert plt.get_fignums() == before
    assert list(np.ravel(drawn)) == list(np.ravel(given))
    assert all(axis.has_data() for axis in np.ravel(given))


def test_other_kinds_of_frequency_plots_go_on_given_axes(
    things: dict[str, tuple[Any, int]],
) -> None:
    band, _ = things["frequencies"]
    for kind in ("nyquist", "nichols"):
        _, given = plt.subplots()
        assert band.plot(given, kind=kind) is given and given.has_data()
        assert band.plot(kind).get_xlabel() == given.get_xlabel()


def test_names_of_channels_stand_on_bands() -> None:
    data = setid.IOData(
        [4, -3, 2, 1], [0, -6.25, 1.175, 2.0875], input_names="valve", output_units="m"
    )
    result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    assert setid.step_band(result, 5).plot().get_ylabel() == "y1 [m] for a step in valve"
    title = setid.frequency_band(result, [0.5, 1.0]).plot()[0].get_title()
    assert title.startswith("y1 [m] from valve")


def test_too_few_axes_are_refused(result: setid.Identification) -> None:
    _, given = plt.subplots()
    with pytest.raises(setid.SetidError, match="found 1 axes, expected 2"):
        result.formulation.data.plot(given)


def test_samples_are_counted_from_zero(result: setid.Identification) -> None:
    found = setid.residuals(result)
    ax = found.plot()
    assert np.array_equal(ax.get_lines()[0].get_xdata(), found.row)
    assert found.row[0] == 2  # the third sample is the first with two before it


def test_physical_parameters_are_drawn_as_the_others() -> None:
    found = physical()
    labels = [text.get_text() for text in found.plot().get_yticklabels()]
    low, high = found.intervals["K"].outer
    assert low <= 2.0 <= high  # the static gain 1/(1 - 1/2) of the record without noise
    assert labels == [f"K in [{rounded(low, False, 5)}, {rounded(high, True, 5)}]"]
    page = found._repr_html_()
    assert "outer (proved)" in page and rounded(low, False, 8) in page


def test_sampled_ranges_are_drawn_about_the_nominal_value() -> None:
    found = setid.ContinuousEstimate(
        "sampled", "zoh", ("a0", "b0"), np.array([2.0, 0.0]), np.array([[1.9, -1], [2.2, 3]]), 0, ""
    )
    lines = found.plot().get_lines()
    assert lines[0].get_xdata() == pytest.approx([-5.0, 10.0])  # per cent of 2
    assert lines[2].get_xdata() == pytest.approx([-50.0, 150.0])  # of half the range 4


def test_radius_and_weight_are_drawn_over_the_frequency() -> None:
    models = first_order().to_control()
    radius, weight = models.plot().get_lines()
    assert np.array_equal(radius.get_xdata(), models.omega)
    assert np.array_equal(radius.get_ydata(), models.radius)
    assert np.all(np.asarray(weight.get_ydata()) >= models.radius * (1 - 1e-9))
