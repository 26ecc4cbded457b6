"""What a session shows of a result is a line: arrays are asked for by name."""

from __future__ import annotations

import numpy as np

import setid


def test_bands_points_and_projections_show_as_a_line() -> None:
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    grid = np.geomspace(0.1, 3.0, 7)
    assert repr(result.bode(grid)) == "<FrequencyBand: proved, y1 from u1, 7 frequencies>"
    assert repr(result.step(9)) == "<StepBand: proved, y1 from u1, 9 samples>"
    assert repr(result.fps("a1", "b0")) == "<Projection: a1 and b0, 4 corners>"  # by hand
    # by hand: the residuals of a1 = 0, b0 = 2 are -0.25, -2.825 and 0.0875
    shown = repr(setid.residuals(result, [0.0, 2.0]))
    assert shown == "<Residuals: 3 values, 1 outside their bounds>"
    formulation = setid.formulate(data, setid.TransferFunction(1, 1), setid.Noise(output=1.0))
    witness = setid.least_noise(formulation, [0.0, 2.0])
    assert repr(witness).startswith("<Witness: 6 unknowns, level ")


def test_maps_and_continuous_models_show_as_a_line() -> None:
    model = setid.Hammerstein(setid.TransferFunction(0, 1), 2, normalise="b0")
    u = np.linspace(-1, 1, 9)
    result = setid.identify(setid.IOData(u, u + 0.5 * u**2), model, setid.Noise(output=0.01))
    assert repr(setid.static_band(result, x=[0.5, 1.0])) == "<StaticBand: proved, w, 2 points>"
    assert repr(setid.signal_band(result, "w")) == "<SignalBand: w, 9 samples>"
    linear = setid.TransferFunction(na=1, nb=1, nk=1)
    truth = setid.simulate_record(linear, [-0.5, 1], [1, 3, -2, 1, 2], setid.Noise(0.01))
    found = setid.to_continuous(setid.identify(truth.data, linear, setid.Noise(0.01)))
    expected = f"<ContinuousEstimate: sampled, a0, b0 of {len(found.members)} members>"
    assert repr(found) == expected
