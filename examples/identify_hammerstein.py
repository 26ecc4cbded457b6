"""A measured record as a Hammerstein model: pump voltage to level of a tank (Uppsala).

The level follows the pump slowly, and what the pump delivers bends over its voltage. Static
map and time constant are found together; the curve comes with a guaranteed band.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import setid
import sparsepop_py as sp
from setid.plots.blocks import plot_diagram

RECORD = Path(__file__).resolve().parent / "data" / "tank.csv"
NOISE = 0.36  # V, an assumption: about the largest residual of a least-squares fit
SECONDS = 40.0  # at most; all intervals close earlier on a machine without other work
PER_BAND = 3.0


def main() -> None:
    """Refusal, intervals, another normalisation, validation, pictures."""
    plt.switch_backend("Agg")  # pictures go to files
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("demo_output"), help="for pictures")
    output = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)
    data = setid.IOData.from_csv(RECORD, inputs="u", outputs="y1", Ts=5.0)
    estimation, validation = data.split(200)
    noise = setid.Noise(output=NOISE)

    linear = setid.TransferFunction(na=1, nb=1, nk=1)
    bare = setid.Hammerstein(linear, [0, 1, 2])  # levels and voltages have an offset
    try:
        setid.identify(estimation, bare, noise)
    except setid.ModelError as error:
        print(f"refused: {error}\n")

    # the pole is so near 1 that static gain 1 would leave the curve without bounds
    model = bare.normalised("b1")
    options = setid.Options(time_limit=SECONDS, tol=1e-2, progress=False)
    result = setid.identify(estimation, model, noise, options=options)
    print(result.table())
    low, high = result.intervals["a1"].outer
    times = [-data.Ts / np.log(-a) for a in (high, low)]
    shortest, longest = sp.rounded(times[0], False, 3), sp.rounded(times[1], True, 3)
    print(f"time constant {shortest} .. {longest} s, proved")
    for name, ends in setid.convert_intervals(result, "dcgain").items():
        low, high = sp.rounded(ends[0], False, 3), sp.rounded(ends[1], True, 3)
        print(f"  with static gain 1: {name} in [{low}, {high}], proved")

    comparison = setid.compare(result, validation, kind="sampled")
    print(f"simulated over {validation.samples} samples: fit {comparison.fit[0]:.1f} %")

    figure, axes = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    volts = np.linspace(data.u.min(), data.u.max(), 5)
    setid.static_band(result, x=volts, time_limit=PER_BAND).plot(axes[0])
    setid.signal_band(result, "w").plot(axes[1])
    figure.savefig(output / "hammerstein_band.png", dpi=120)
    plot_diagram(model, result).figure.savefig(output / "hammerstein_diagram.png", dpi=120)
    np.ravel(comparison.plot())[0].figure.savefig(output / "hammerstein_fit.png", dpi=120)
    plt.close("all")


if __name__ == "__main__":
    main()
