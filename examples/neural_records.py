"""Two measured records: what is proved of trained networks, prediction against simulation.

Cascaded tanks with overflow and a DC-DC buck converter. A network is trained one step ahead with
SciPy; then come the least equation error, all last layers that explain the record, the proved band
on the validation record, and the verdict on stability. Figures of jax-sysid, sysidentpy and IPOPT
on the same records are in docs/setid_neural.md.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import setid
from setid import neural

FOLDER = Path(__file__).resolve().parent / "data"


def records(name: str) -> tuple[setid.IOData, setid.IOData]:
    """Estimation and validation record."""
    if name == "cascaded tanks":
        path = FOLDER / "cascaded_tanks.csv"
        return tuple(
            setid.IOData.from_csv(path, f"u_{part}", f"y_{part}", 4.0) for part in ("est", "val")
        )  # type: ignore[return-value]
    return tuple(
        setid.IOData.from_csv(FOLDER / f"buck_{part}.csv", "u", "y", 1e-5)
        for part in ("id", "valid")
    )  # type: ignore[return-value]


def fit(measured: np.ndarray, modelled: np.ndarray) -> float:
    """100 (1 - |e| / |y - mean y|) over samples where both are there."""
    known = ~np.isnan(modelled[:, 0])
    error = np.linalg.norm((measured - modelled)[known])
    return 100.0 * (1.0 - error / np.linalg.norm((measured - measured.mean(axis=0))[known]))


def study(name: str, order: int, width: int, samples: int) -> None:
    """Train, predict, simulate, prove."""
    estimation, validation = records(name)
    validation = validation.split(samples)[0]
    trained = neural.train(neural.initial(estimation, order, [width]), estimation, starts=3)
    net = trained.net
    print(f"\n{name}: {trained}")
    for label, data in (("estimation", estimation), ("validation", validation)):
        one, many = fit(data.y, net.one_step(data)), fit(data.y, net.simulate(data))
        print(f"  {label}: fit {one:.1f} % one step ahead, {many:.1f} % simulated")
    error = neural.equation_error(net, estimation)
    print(f"  least equation error in [{error.lower_bound[0]:.6g}, {error.upper_bound[0]:.6g}]")

    layer = neural.last_layer(net, estimation, factor=1.5)
    print(f"  last layer, {layer.status}, verified: {bool(layer.verify())}")
    for item in layer.intervals.values():
        print(f"    {item}")
    band = layer.band(validation)
    held = int(np.sum(~np.isnan(band.low))) - len(band.outside)
    print(f"  proved band of readings {band.width:.3f} wide, holds {held} validation readings")

    verdict = neural.stability(net)
    print(f"  simulation {verdict.status}: " + ", ".join(repr(c) for c in verdict.conditions))
    start = neural.simulate_band(net, validation)
    print(f"  verified simulation from the first readings: {start}, last width "
          f"{start.width[-1]:.2g}")  # fmt: skip


def main() -> None:
    """Both records."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=300, help="of the validation record")
    samples = parser.parse_args().samples
    study("cascaded tanks", order=3, width=2, samples=samples)
    study("buck converter", order=2, width=1, samples=samples)

    data = records("cascaded tanks")[0].split(101)[0]
    best = neural.train_proved(neural.initial(data, 1, [1], "relu"), data)
    print(f"\none ReLU neuron on 100 rows, trained to a proved optimum: {best}")


if __name__ == "__main__":
    main()
