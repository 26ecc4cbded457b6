"""A measured record of a nonlinear system: the upper of two cascaded tanks (Uppsala).

The outflow grows with the root of the level, so that a linear model needs more noise than
one with a bend. Is the bend certain? The interval of the quadratic coefficient tells. The second
half asks for a model that simulates: output errors, on every fifth sample.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import setid
import sparsepop_py as sp

RECORD = Path(__file__).resolve().parent / "data" / "tank.csv"
LINEAR = ["1", "y1", "u1"]
MODELS = {
    "linear": setid.PolynomialNARX(LINEAR, ny=1, nu=1),
    "quadratic": setid.PolynomialNARX([*LINEAR, "y1^2"], ny=1, nu=1),
}


def main() -> None:
    """Consistency levels, intervals, validation."""
    plt.switch_backend("Agg")  # pictures go to files
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("demo_output"), help="for pictures")
    output = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)
    data = setid.IOData.from_csv(RECORD, inputs="u", outputs="y1", Ts=5.0)
    estimation, validation = data.split(200)

    least = {}
    for name, model in MODELS.items():
        found = setid.consistency(estimation, model, setid.Noise(equation=0.05))
        least[name] = 0.05 * found.scale[1]
        proved = sp.rounded(0.05 * found.scale[0], False, 5)
        print(f"{name:<10} least bound of the equation error {proved} V, proved")

    model = MODELS["quadratic"]
    result = setid.identify(estimation, model, setid.Noise(equation=1.02 * least["quadratic"]))
    print(result.table())
    comparison = setid.compare(result, validation, mode="prediction")
    print("\none step ahead, on samples that were not used:")
    print(comparison.summary())
    simulated = setid.compare(result, validation)
    print(f"simulated over {validation.samples} samples: fit {simulated.fit[0]:.1f} %")
    for name, axes in {"prediction": comparison.plot(), "simulation": simulated.plot()}.items():
        np.ravel(axes)[0].figure.savefig(output / f"tank_{name}.png", dpi=120)
    plt.close("all")

    whole = setid.consistency(data, model, setid.Noise(equation=0.05))
    careful = setid.identify(estimation, model, setid.Noise(equation=1.02 * 0.05 * whole.scale[1]))
    bends = [r.intervals["c[y1^2]"] for r in (result, careful)]
    print(
        "\nthe quadratic coefficient with that bound, and with one that explains all 300 samples:"
    )
    for bend in bends:
        low, high = sp.rounded(bend.outer[0], False, 5), sp.rounded(bend.outer[1], True, 5)
        print(f"  {low} .. {high}  {certainty(bend)}")
    gain = least["linear"] - least["quadratic"]
    print(
        f"""
What an engineer learns: a noise bound read off 200 samples is an assumption, and samples that
were not used can falsify it; the bound to work with is the one that explains all of them.
With the first bound the bend of the outflow {certainty(bends[0])}, with the second it
{certainty(bends[1])}. All that the bend explains here is the gap between both
noise levels, {gain:.4f} V: larger steps of the level would tell more."""
    )
    simulating(data, output, least["linear"])


def simulating(data: setid.IOData, output: Path, one_step: float) -> None:
    """Output errors: intervals, time constant, gain and validation by simulation."""
    slow = data.decimate(5)  # the pump changes at multiples of ten samples: nothing is lost
    estimation, validation = slow.split(40)
    model = setid.TransferFunction(na=1, nb=1, nk=1, offset=True)
    part, whole = (
        setid.consistency(record, model, setid.Noise(output=0.1)) for record in (estimation, slow)
    )
    print("\noutput errors, every fifth sample:")
    for found, samples in ((part, "40 samples"), (whole, "all 60")):
        proved = sp.rounded(0.1 * found.scale[0], False, 5)
        print(f"least bound of the output error {proved} V on {samples}, proved")
    noise = setid.Noise(output=1.05 * 0.1 * whole.scale[1])
    result = setid.identify(estimation, model, noise)
    print(result.summary())
    print(f"verified again from the data: {'yes' if result.verify(estimation) else 'no'}")
    comparison = setid.compare(result, validation)
    print("\nsimulated, on samples that were not used:")
    print(comparison.summary())
    np.ravel(comparison.plot())[0].figure.savefig(output / "tank_output_error.png", dpi=120)
    plt.close("all")
    low, high = result.intervals["a1"].outer
    slowest, fastest = -slow.Ts / math.log(-low), -slow.Ts / math.log(-high)
    band = setid.frequency_band(result, omega=[1e-5])
    weakest, strongest = 10.0 ** (band.decibel[0] / 20.0)
    times = f"{sp.rounded(fastest, False, 3)} and {sp.rounded(slowest, True, 3)}"
    gains = f"{sp.rounded(weakest, False, 3)} and {sp.rounded(strongest, True, 3)}"
    print(
        f"""
What an engineer learns: one step ahead a line explains the level to {one_step:.2f} V; a simulation
carries no readings along, and one line for all working points then needs {noise.output:.2f} V.
Even so, the time constant is proved to lie between {times} s, and the
gain of slow changes between {gains}: a controller must suit them all.
The bound that explains 40 samples does not explain all 60: the working point has moved."""
    )


def certainty(interval: setid.ParameterInterval) -> str:
    """Whether the sign of a coefficient is proved."""
    return "may be absent" if 0.0 in interval else "is certain"


if __name__ == "__main__":
    main()
