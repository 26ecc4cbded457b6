"""One plant sampled at three rates: what fast sampling gives, and what it cannot give.

A second-order plant is driven by held inputs and sampled without approximation. Tustin's
recursion is off by an error that falls with Ts^2; its bound ``delta`` adds to the noise.
With a bound that covers it, the true coefficients lie in every proved interval, and the
intervals narrow until the noise of the sensor is what is left. With delta = 0 they are
narrower and may lose the truth; the result says that its delta is too small.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import cont2discrete, lfilter

import setid

plt.switch_backend("Agg")

TRUTH = {"a1": 1.2, "a0": 2.0, "b1": 0.5, "b0": 2.0}  # (0.5 s + 2) / (s^2 + 1.2 s + 2)
NOISE = 0.005
INTERVAL = 0.4  # the input changes this often, whatever the sampling interval is
LEVELS = 24


def record(Ts: float) -> setid.IOData:
    """Exact samples of the plant with bounded noise on the output."""
    generator = np.random.default_rng(7)
    u = np.repeat(generator.uniform(-1, 1, LEVELS), round(INTERVAL / Ts))
    a1, a0, b1, b0 = TRUTH.values()
    numerator, denominator, _ = cont2discrete(([b1, b0], [1, a1, a0]), Ts, method="zoh")
    y = lfilter(numerator.ravel(), denominator, u)
    return setid.IOData(u, y + generator.uniform(-NOISE, NOISE, u.size), Ts=Ts)


def main() -> None:
    """Intervals at three sampling rates, with and without the discretisation error."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("demo_output"), help="for pictures")
    output = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)
    noise = setid.Noise(output=NOISE)
    options = setid.Options(time_limit=60.0, progress=False)

    rates = (0.4, 0.2, 0.1)
    found = {}
    print(f"{'Ts':>5} {'N':>4} {'delta':>9}   proved intervals")
    for Ts in rates:
        data = record(Ts)
        exact = setid.ContinuousTransferFunction(2, 1, hold="constant", Ts=Ts)
        error = setid.discretisation_error(exact, list(TRUTH.values()), data.u)
        for delta in (1.1 * float(np.abs(error).max()), 0.0):
            model = setid.ContinuousTransferFunction(2, 1, hold="constant", delta=delta)
            result = found[Ts, delta > 0] = setid.identify(data, model, noise, options=options)
            inside = all(value in result.intervals[name] for name, value in TRUTH.items())
            text = "  ".join(
                f"{name} [{i.outer[0]:.3f}, {i.outer[1]:.3f}]"
                for name, i in result.intervals.items()
            )
            print(f"{Ts:5.2f} {data.samples:4d} {delta:9.5f}   {text}")
            print(" " * 22 + ("the truth is inside" if inside else "the truth is lost"))
            for note in result.notes:
                print(" " * 22 + note)

    draw(found, rates, output / "sampling_rates.png")


def draw(
    found: dict[tuple[float, bool], setid.Identification], rates: tuple[float, ...], path: Path
) -> None:
    """Intervals against the sampling interval, one axis a coefficient."""
    figure, axes = plt.subplots(1, 4, figsize=(12, 3.4), layout="constrained")
    for ax, (name, value) in zip(axes, TRUTH.items(), strict=True):
        for covered, colour, shift, label in (
            (True, "tab:blue", 0.97, "delta covers the error"),
            (False, "tab:orange", 1.03, "delta = 0"),
        ):
            ends = np.array([found[Ts, covered].intervals[name].outer for Ts in rates])
            ax.vlines(np.array(rates) * shift, ends[:, 0], ends[:, 1], colour, lw=4, label=label)
        ax.axhline(value, color="black", lw=0.8, label="truth")
        ax.set_xscale("log")
        ax.set_xticks(rates, [f"{Ts:g}" for Ts in rates])
        ax.minorticks_off()
        ax.set_title(name)
        ax.set_xlabel("sampling interval Ts")
    axes[0].legend(fontsize=8)
    figure.savefig(path, dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    main()
