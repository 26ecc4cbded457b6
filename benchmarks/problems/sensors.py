"""Sensors that know distances to their neighbours: a sparse quartic whose minimum is zero.

Sensors lie in the unit square, anchors in four places of it. Where two sensors, or a sensor and an
anchor, are closer than the radio range, their distance d_ij is known:

    min sum over known pairs of (|x_i - x_j|^2 - d_ij^2)^2.

References
----------
S. Kim, M. Kojima, H. Waki, Exploiting sparsity in SDP relaxation for sensor network localization,
SIAM J. Optim. 20 (2009) 192-215.
"""

from __future__ import annotations

import numpy as np

import sparsepop_py as sp

from ..measuring.registry import Task

__all__ = ["localisation"]

_ANCHORS = ((0.25, 0.25), (0.25, 0.75), (0.75, 0.25), (0.75, 0.75))
_NEIGHBOURS = 5  # distances that a sensor keeps, as in the reference's sparse variants


def localisation(count: int, radio_range: float, seed: int) -> Task:
    """Draw sensors in the unit square and ask where they are.

    Parameters
    ----------
    count : int
        Number of sensors; two variables each.
    radio_range : float
        Largest distance that is measured.
    seed : int
    """
    rng = np.random.default_rng([count, seed])
    places = np.vstack([rng.random((count, 2)).round(6), _ANCHORS])
    x = sp.variables(2 * count)
    known = [(x[2 * i], x[2 * i + 1]) for i in range(count)] + list(_ANCHORS)
    squared = np.sum((places[:, None] - places[None]) ** 2, axis=2)
    pairs = set()
    for i in range(count):
        near = [j for j in np.argsort(squared[i]) if j != i and squared[i, j] <= radio_range**2]
        pairs |= {(min(i, int(j)), max(i, int(j))) for j in near[:_NEIGHBOURS]}
    terms = []
    for i, j in sorted(pairs):
        (left, low), (right, high) = known[i], known[j]
        terms.append(((left - right) ** 2 + (low - high) ** 2 - float(squared[i, j])) ** 2)
    return Task.of(sp.Problem(sp.total(terms), lower=0.0, upper=1.0), 0.0)
