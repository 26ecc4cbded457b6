"""Stable poles, from which searches for denominators begin."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["monic", "random_denominator", "random_poles"]

Reals = NDArray[np.float64]
_INSIDE = 1.0 - 1e-5  # largest modulus of a pole to begin from
_SLOW = 3e-3  # least distance of a pole from the unit circle


def random_poles(random: np.random.Generator, n: int) -> list[complex]:
    """Draw stable poles, as often slow as fast, in pairs or real.

    Parameters
    ----------
    random : numpy.random.Generator
    n : int

    Examples
    --------
    >>> import numpy as np
    >>> found = random_poles(np.random.default_rng(1), 3)
    >>> len(found), bool(max(map(abs, found)) < 1.0)
    (3, True)
    """
    found: list[complex] = []
    while len(found) < n:
        size = 1.0 - np.exp(random.uniform(np.log(_SLOW), 0.0))
        if n - len(found) > 1 and random.random() < 0.5:
            pole = size * np.exp(1j * np.pi * np.exp(random.uniform(np.log(_SLOW), 0.0)))
            found += [pole, pole.conjugate()]
        else:
            found.append(size if random.random() < 0.9 else -size)
    return found


def random_denominator(random: np.random.Generator, n: int) -> Reals:
    """Draw coefficients (n + 1,) of a stable denominator, the first of which is 1.

    Parameters
    ----------
    random : numpy.random.Generator
    n : int
    """
    return np.asarray(np.atleast_1d(np.real(np.poly(random_poles(random, n)))), np.float64)


def monic(a: Reals, stable: bool) -> Reals | None:
    """Divide a denominator by its first coefficient, poles drawn into the unit disc if asked.

    Parameters
    ----------
    a : (n + 1,) float
    stable : bool

    Returns
    -------
    (n + 1,) float or None
        None where the first coefficient is as good as zero.
    """
    if not abs(a[0]) > 1e-6 * np.abs(a).max():
        return None
    found = np.asarray(a / a[0], np.float64)
    if stable:
        largest = float(np.abs(np.roots(found)).max(initial=0.0))
        found = found * min(1.0, _INSIDE / max(largest, 1e-300)) ** np.arange(found.size)
    return found
