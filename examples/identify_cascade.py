"""A sensor behind a plant: linear, static, linear (Wiener-Hammerstein), all ends proved.

The plant z(k) = 0.4 z(k-1) + u(k-1) bends, w = z + 0.3 z^2, and the sensor is slow:
y(k) = 0.5 y(k-1) + 0.8 w(k-1). Neither z nor w is measured. Stability, a start from rest and two
numbers that fix the scales of z and w are all that is assumed.

Usage: python examples/identify_cascade.py [--samples 50] [--noise 0.01]
"""

from __future__ import annotations

import argparse

import numpy as np

import setid

TRUTH = {"a[z,u1]1": -0.4, "a[y1,w]1": -0.5, "b[y1,w]1": 0.8, "gamma2": 0.3}


def record(samples: int, noise: float) -> setid.IOData:
    """A simulated record with output noise within its bound."""
    random = np.random.default_rng(1)
    u = random.uniform(-1.0, 1.0, samples)
    z, y = np.zeros(samples), np.zeros(samples)
    for k in range(1, samples):
        z[k] = 0.4 * z[k - 1] + u[k - 1]
        y[k] = 0.5 * y[k - 1] + 0.8 * (z[k - 1] + 0.3 * z[k - 1] ** 2)
    return setid.IOData(u, y + noise * random.uniform(-1.0, 1.0, samples))


def main() -> None:
    """Identify, verify, store and verify again."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--samples", type=int, default=50)
    parser.add_argument("--noise", type=float, default=0.01)
    given = parser.parse_args()
    shape = setid.TransferFunction(na=1, nb=1, nk=1)
    model = setid.BlockStructured(
        {("z", "u1"): shape, ("y1", "w"): shape},
        {"w": setid.StaticMap("z", 2)},
        normalise=["b[z,u1]1", "gamma1"],
        initial="zero",
    )
    data = record(given.samples, given.noise)
    limits = setid.Options(time_limit=120.0, progress=False)
    result = setid.identify(data, model, setid.Noise(output=given.noise), setid.Stable(), limits)
    print(result.table())
    print(result.box)
    print(f"verified: {bool(result.verify(data))}")
    again = setid.Identification.from_json(result.to_json())
    print(f"verified after storing: {bool(again.verify(data))}")
    inside = all(TRUTH[name] in item for name, item in result.intervals.items())
    print(f"the true values are inside: {inside}")


if __name__ == "__main__":
    main()
