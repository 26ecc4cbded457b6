"""The largest value of a gain on one cone of denominators, by a linear program.

The notation is that of ``proofs/denominators/denominator_box.py``. For a value beta of the gain the
program of ``linear_programs.py`` refutes b = beta on the cone: the readings are those without the
outputs that beta makes, and multipliers are orthogonal to all other columns. Whatever target it
reaches, its multipliers bound b from above by the least beta with which all pairs hold.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from setid.minimum_noise.cones.linear_programs import ConePrograms
from setid.minimum_noise.cones.nodes import ConeNode
from setid.minimum_noise.cones.plain_steps import filtered_pairs
from setid.proofs.denominators.varying_multipliers import hurwitz_minors, pairs

__all__ = ["FoundLimit", "LimitTask", "limited", "orthogonal"]

Reals = NDArray[np.float64]


class LimitTask(NamedTuple):
    """A gain that is to be bounded on a cone.

    Parameters
    ----------
    solver : ConePrograms
        Of the gain.
    node : ConeNode
        With vectors that begin with positive numbers.
    sign : int
        1 for the gain, -1 for its negative.
    value : float
        The upper end that is wanted.
    target : float
        The factor on the noise bounds that is to be refuted above it.
    """

    solver: ConePrograms
    node: ConeNode
    sign: int
    value: float
    target: float


class FoundLimit(NamedTuple):
    """Multipliers that bound a gain.

    Parameters
    ----------
    value : float
        The upper end; infinite where they tell nothing.
    multipliers : (K, R) float
    powers : tuple of int
    minors : tuple of float
    """

    value: float
    multipliers: Reals
    powers: tuple[int, ...]
    minors: tuple[float, ...]


def limited(task: LimitTask) -> FoundLimit:
    """Bound a gain on a cone, in any process.

    Parameters
    ----------
    task : LimitTask
    """
    solver, programs, cone = task.solver, task.solver.programs, task.node.cone
    assert solver.gain is not None
    powers = task.node.powers(programs.bound)
    found = solver.solve(cone, powers, task.target, task.sign * task.value)
    multipliers = orthogonal(found.multipliers, solver.basis)
    vectors = np.ldexp(cone.astype(np.float64), -np.array(powers)[:, None])
    one, two = np.array(pairs(len(cone))).T
    both = filtered_pairs(multipliers, vectors, programs.y.size)
    needed = both @ programs.y - np.abs(both) @ programs.bound
    if found.minors.size:
        needed -= found.minors @ hurwitz_minors(cone, powers)
    column = programs.column(solver.gain)[programs.order :]
    shares = -task.sign * (multipliers @ column)
    gained = vectors[one, 0] * shares[two] + vectors[two, 0] * shares[one]
    value = inf
    if np.all(shares >= 0.0) and np.all(gained > 0.0):
        value = float(np.max(-needed / gained))
    return FoundLimit(value, multipliers, powers, tuple(found.minors.tolist()))


def orthogonal(multipliers: Reals, basis: Reals) -> Reals:
    """Take rounding out of the products of multipliers (K, R) with orthonormal columns (R, c)."""
    for _ in range(2):
        multipliers = multipliers - (multipliers @ basis) @ basis.T
    return multipliers
