"""A measured record, one input and one output: the hair dryer of DaISy.

How much noise must be assumed, what is then certain about the model, and what the other
part of the record says of it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import setid
import sparsepop_py as sp

RECORD = Path(__file__).resolve().parent / "data" / "hairdryer.csv"
MODEL = setid.TransferFunction(na=2, nb=2, nk=3, offset=True)


def main() -> None:
    """Consistency, intervals, bands, validation."""
    plt.switch_backend("Agg")  # pictures go to files
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("demo_output"), help="for pictures")
    output = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)
    result, validation = identified()
    print(result.table())

    comparison = setid.compare(result, validation, mode="prediction")
    print("\none step ahead, on samples that were not used:")
    print(comparison.summary())
    simulation = setid.compare(result, validation, kind="sampled")
    print(f"simulated over {validation.samples} samples: fit {simulation.fit[0]:.1f} %")

    band = setid.frequency_band(result)
    low, high = band.decibel[0]
    ends = f"{sp.rounded(low, False, 4)} to {sp.rounded(high, True, 4)}"
    print(f"gain at {band.omega[0]:.2f} rad/s: {ends} dB, proved")
    pictures = {
        "hairdryer_intervals": result.plot(),
        "hairdryer_bode": band.plot("bode"),
        "hairdryer_prediction": comparison.plot(),
        "hairdryer_parameters": result.fps("a1", "b3").plot(),
    }
    for name, axes in pictures.items():
        np.ravel(axes)[0].figure.savefig(output / f"{name}.png", dpi=120)
    plt.close("all")
    width = result.intervals["c"].width
    print(
        f"""
What an engineer learns: errors of a tenth of a volt, 3.5 % of the range, must be assumed
for an order of two to explain the record; below that it is proved that no such model exists.
The intervals of a1 and a2 are narrow enough to place the poles, while the constant c, known
to {width:.2g} only, says that this record hardly shows the working point: a longer step would.
The band of the gain is what a robust design may rely on at low frequency."""
    )


def identified() -> tuple[setid.Identification, setid.IOData]:
    """Intervals from 200 samples with 5 % more noise than the least; the rest validates."""
    data = setid.IOData.from_csv(RECORD, inputs="u", outputs="y", Ts=0.08)
    estimation, validation = data.split(200)
    level = setid.consistency(estimation, MODEL, setid.Noise(equation=0.1))
    least = 0.1 * level.scale[0]
    proved = sp.rounded(least, False, 5)
    print(f"least bound of the equation error that explains the record: {proved} V (proved)")
    bound = 1.05 * 0.1 * level.scale[1]
    too_small = setid.identify(estimation, MODEL, setid.Noise(equation=0.95 * least))
    print(f"with {sp.rounded(0.95 * least, False, 4)} V the result is: {too_small.status}")
    noise = setid.Noise(equation=bound)
    return setid.identify(estimation, MODEL, noise, [setid.Stable()]), validation


if __name__ == "__main__":
    main()
