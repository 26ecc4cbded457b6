"""Vanishing and exploding gradients in closed form, and what a proved decay rate says of them.

For y_t = alpha y_{t-1} + beta u_{t-1} the gradient of y_t with respect to alpha, from y_0 = 1 and
u = 0, is t alpha^(t-1): it vanishes for abs(alpha) < 1 and explodes for abs(alpha) > 1. For a
network, a proved rate r below 1 bounds the influence of the past by r^t for all t.
"""

from __future__ import annotations

import numpy as np

import setid
from setid import neural


def first_order(alpha: float) -> neural.NNOE:
    """y_t = alpha y_{t-1} + u_{t-1} as a network without a hidden layer."""
    return neural.NNOE(neural.Network([[[alpha, 0.0, 1.0]]], [[0.0]]), order=1)


def main() -> None:
    """Compare differences of simulations with the closed form; print decay rates."""
    data = setid.IOData(np.zeros(61), np.zeros(61))
    step = 2.0**-20
    print("alpha   t    t alpha^(t-1)   by differences   verdict")
    for alpha in (0.5, 0.9, 1.0, 1.1):
        runs = [
            first_order(alpha + s).simulate(data, [1.0]).ravel() for s in (step, -step)
        ]  # fmt: skip
        slope = (runs[0] - runs[1]) / (2.0 * step)
        found = neural.stability(first_order(alpha))
        verdict = f"stable, rate {found.rate:.4f}" if found.status == "stable" else "open"
        for t in (1, 10, 60):
            exact = t * alpha ** (t - 1)
            print(f"{alpha:5.2f} {t:3d} {exact:16.6g} {slope[t]:16.6g}   {verdict}")

    rng = np.random.default_rng(0)
    state = rng.normal(size=(8, 8))
    state *= 0.8 / np.linalg.norm(state, 2)
    net = neural.Elman([(rng.normal(size=(8, 1)), state, np.zeros(8))], (np.ones((1, 8)), [0.0]))
    found = neural.stability(net, lmi=False)
    print(f"\nElman network of 8 neurons: {found.status}, rate {found.rate:.4f}")
    for t in (10, 50, 100):
        bound = found.distance(t, initial=1.0)[t]
        print(f"distance of two runs after {t} steps at most {bound:.3g} of the initial one")


if __name__ == "__main__":
    main()
