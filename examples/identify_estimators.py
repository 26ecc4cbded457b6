"""Two laboratories of a course on robust identification: estimates against intervals.

The plant is 100 / (s^2 + 1.2 s + 1), sampled with Ts = 1. Least squares is right on average
when errors enter the equation, and wrong for ever when they enter the measured output. The
intervals hold in every case, as long as the noise bound does.
"""

from __future__ import annotations

import numpy as np

import setid

PLANT = np.array([-0.7647, 0.3012, 0.0, 32.24, 21.41])
MODEL = setid.TransferFunction(na=2, nb=3)
LINE = "{:<22}" + "{:>11}" * 5


def main() -> None:
    """Print the tables of both laboratories."""
    print(LINE.format("estimate", *MODEL.parameters))
    print(LINE.format("true", *PLANT))
    estimates("equation error 5", setid.Noise(equation=5.0))
    estimates("output error 5", setid.Noise(output=5.0))
    polygon()
    intervals()
    print()
    print("Least squares needs errors in the equation; with errors in the output a1 and a2 stay")
    print("biased, however long the record is. Bounded errors give intervals instead: a tenth of")
    print("the bound gives about a tenth of the width, and the truth is always inside.")


def estimates(title: str, noise: setid.Noise) -> None:
    """First laboratory: four estimators on one record of 1000 samples."""
    u = np.random.RandomState(5489).random_sample(1000)
    data = setid.simulate_record(MODEL, PLANT, u, noise, seed=1).data
    print(f"\n{title}, N = {data.samples}")
    for name, estimator in (
        ("least squares", setid.least_squares),
        ("recursive", setid.recursive_least_squares),
        ("l1", setid.l1),
        ("l-infinity", setid.linf),
    ):
        print(LINE.format(name, *(f"{v:.4f}" for v in estimator(data, MODEL).theta)))


def polygon() -> None:
    """Second laboratory, first part: four samples, a polygon of parameters."""
    data = setid.IOData([4.0, -3.0, 2.0, 1.0], [0.0, -6.25, 1.175, 2.0875])
    result = setid.identify(data, setid.TransferFunction(na=1, nb=1), setid.Noise(equation=0.5))
    print("\nfour samples, |e| <= 0.5, true parameters -0.5 and 2 on the boundary")
    print(result.table())
    corners = ", ".join(f"({a:.6f}, {b:.6f})" for a, b in result.fps("a1", "b0").outline)
    print(f"corners of the feasible set: {corners}")


def intervals() -> None:
    """Second laboratory, second part: intervals for growing noise bounds."""
    print("\nintervals of the second-order plant, N = 1000, by exact linear programs")
    for bound in (0.1, 1.0, 10.0):
        result = setid.identify(record(bound), MODEL, setid.Noise(equation=bound))
        cells = [f"{v.outer[0]:.5f} .. {v.outer[1]:.5f}" for v in result.intervals.values()]
        print(f"|e| <= {bound:<5g} " + "  ".join(cells))


def record(bound: float) -> setid.IOData:
    """The record of the laboratory: inputs first, then an error for each sample."""
    r = np.random.RandomState(5489)  # the numbers of MATLAB's rng('default'); rand
    u, y = r.random_sample(1000), np.zeros(1000)
    a1, a2, b0, b1, b2 = PLANT
    for t in range(2, 1000):
        e = 2 * bound * r.random_sample() - bound
        y[t] = -a1 * y[t - 1] - a2 * y[t - 2] + b0 * u[t] + b1 * u[t - 1] + b2 * u[t - 2] + e
    return setid.IOData(u, y)


if __name__ == "__main__":
    main()
