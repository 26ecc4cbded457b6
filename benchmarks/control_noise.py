"""Noise that a certificate of stability bears: a plant of order 4, by samples and margin.

    python -m benchmarks.control_noise --snr 30 25 --samples 100 400 --margin 0 0.1

One row a case: the verdict by the characteristic polynomial for one controller, the widest
interval of the plant's polytope, and the factor rho by which a box of parameters returns from the
rows of the record. Where rho is 1 or more, sums of rows give no finite box.
"""

from __future__ import annotations

import argparse

import numpy as np

import setid
from setid import control
from setid.control.certificates.certificate import plant_model
from setid.control.parameters.rows import noisy_rows
from setid.control.parameters.sums import best_fit, return_factor

PLANT = control.Transfer([0, 0.09516, 0.02, 0.05, -0.04], [1, -0.9048, 0.2, -0.5, 0.4])
REFERENCE = control.Transfer([0, 0.4], [1, -0.6])
CONTROLLER = control.Transfer(
    [4.176, -3.68, 0.7055, -2.006, 1.644], [1, -0.7755, 0.314, -0.9413, 0.4028]
)


def record(snr: float, samples: int, seed: int) -> tuple[setid.IOData, float]:
    """A record of the plant with uniform noise, and the bound of the noise."""
    rng = np.random.default_rng(seed)
    r = rng.uniform(-1, 1, samples)
    y = PLANT.simulate(r)
    bound = float(np.sqrt(3.0 * np.mean(y**2) / 10.0 ** (snr / 10.0)))
    return setid.IOData(r, y + rng.uniform(-bound, bound, samples)), bound


def case(snr: float, samples: int, margin: float, limit: float, seed: int) -> str:
    """One row of the table."""
    data, bound = record(snr, samples, seed)
    rows = noisy_rows(data, plant_model(4, 1), setid.Noise(output=bound))
    rho = return_factor(rows, best_fit(rows))
    answer = control.stability_certificate(
        data, CONTROLLER, REFERENCE, 4, bound, margin or None, "characteristic", delay=1,
        time_limit=limit,
    )  # fmt: skip
    known = answer.parameters
    width = np.inf if known is None else float(np.max(known.box[1] - known.box[0]))
    return (
        f"{snr:g},{samples},{margin:g},{seed},{answer.verdict},{rho:.3g},{width:.3g},"
        f"{answer.cells},{answer.seconds:.1f}"
    )


def main() -> None:
    """Run all cases."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--snr", type=float, nargs="+", default=[35.0, 30.0, 25.0, 20.0, 15.0])
    parser.add_argument("--samples", type=int, nargs="+", default=[100, 400, 1600])
    parser.add_argument("--margin", type=float, nargs="+", default=[0.0, 0.1])
    parser.add_argument("--seed", type=int, nargs="+", default=[0])
    parser.add_argument("--limit", type=float, default=20.0, help="seconds each")
    given = parser.parse_args()
    print("snr,samples,margin,seed,verdict,rho,width,cells,seconds", flush=True)
    for snr in given.snr:
        for samples in given.samples:
            for margin in given.margin:
                for seed in given.seed:
                    print(case(snr, samples, margin, given.limit, seed), flush=True)


if __name__ == "__main__":
    main()
