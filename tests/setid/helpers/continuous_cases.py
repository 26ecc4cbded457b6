"""A plant in continuous time, its exact samples, and rows written down without the project.

The plant is the one of the sampling-rate example; exact samples come from scipy's
``cont2discrete`` (zero-order and first-order hold), an implementation of its own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

import setid

Reals = NDArray[np.float64]

PLANT = {"a1": 1.2, "a0": 2.0, "b1": 0.5, "b0": 2.0}  # (0.5 s + 2) / (s^2 + 1.2 s + 2)
THETA = np.array(list(PLANT.values()))
QUICK = setid.Options(time_limit=90.0, progress=False)
SCIPY = {"constant": "zoh", "linear": "foh"}


def levels(Ts: float, count: int, interval: float = 0.4, seed: int = 7) -> Reals:
    """A staircase that changes every ``interval``, the same at all rates."""
    steps = np.random.default_rng(seed).uniform(-1, 1, count)
    return np.repeat(steps, round(interval / Ts))


def exact_samples(u: Reals, Ts: float, hold: str = "constant", theta: Reals = THETA) -> Reals:
    """Response of an order-2 plant from rest, sampled without approximation."""
    n = theta.size // 2
    system = theta[n:], np.append(1.0, theta[:n])
    numerator, denominator, _ = cont2discrete(system, Ts, method=SCIPY[hold])
    return np.asarray(lfilter(numerator.ravel(), denominator, u))


def noisy(values: Reals, bound: float, seed: int = 1) -> Reals:
    """Bounded noise added."""
    return values + np.random.default_rng(seed).uniform(-bound, bound, values.shape)
