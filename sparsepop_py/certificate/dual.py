"""From a solver's dual to an identity: multipliers in the original problem's units.

The solver's z holds, group by group, Gram matrices Z and equality multipliers of the
scaled problem. Each Z is replaced by the factor of its nearest positive semidefinite
matrix; scaled rows g = size * g_scaled divide their multipliers by ``size``. Nothing here
needs to be exact: what is lost shows in the remainder of the identity.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..conic import split_dual
from ..polynomial import Polynomial
from ..presolve.scaling import Scaled
from ..relaxation import Relaxation
from .identity import Identity, Multipliers

__all__ = ["identity_of", "margin"]


def identity_of(
    relaxation: Relaxation,
    scaled: Scaled,
    z: NDArray[np.float64],
    objective_size: float,
    floor: float = 0.0,
) -> Identity:
    """The identity that a dual solution stands for.

    Parameters
    ----------
    relaxation, scaled
        The relaxation that was solved, and the scaled problem it is of.
    z : (R,) float
        Dual in the convention of :mod:`sparsepop_py.conic`.
    objective_size : float
        original objective = size * scaled objective.
    floor : float
        Multiple of :func:`margin` that was subtracted from the scaled objective.
    """
    n = relaxation.problem.dimension
    sizes = np.concatenate([[1.0], scaled.row_sizes, np.ones(n)])
    multipliers = []
    for group, part in zip(relaxation.groups, split_dual(relaxation, z), strict=True):
        weight = objective_size / sizes[group.generator]
        if group.free:
            multipliers.append(
                Multipliers(group.generator, group.basis, part * weight[:, None])
            )
            continue
        for chosen in _homogeneous(group.generator, floor):
            factor = _factor(part[chosen] * weight[chosen, None, None])
            on_moments = bool(np.all(group.generator[chosen] == 0))
            multipliers.append(
                Multipliers(
                    group.generator[chosen],
                    group.basis[chosen],
                    factor,
                    floor * objective_size if on_moments else 0.0,
                )
            )
    return Identity(scaled.scaling, tuple(multipliers))


def _homogeneous(generator: NDArray, floor: float) -> list[NDArray[np.int64]]:
    """Positions to keep together: all, or moment blocks apart when they carry a floor."""
    if floor == 0.0:
        return [np.arange(generator.size)]
    parts = [np.flatnonzero(generator == 0), np.flatnonzero(generator != 0)]
    return [part for part in parts if part.size]


def _factor(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """L with L L' near each symmetric matrix, negative eigenvalues set to zero."""
    values, vectors = np.linalg.eigh(matrices)
    return vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]


def margin(relaxation: Relaxation) -> Polynomial:
    """Sum of the squares of all monomials of all moment blocks (scaled variables)."""
    n = relaxation.problem.dimension
    words = [
        np.concatenate([group.basis[group.generator == 0]] * 2, axis=-1).reshape(
            -1, 2 * group.basis.shape[2]
        )
        for group in relaxation.groups
        if not group.free and np.any(group.generator == 0)
    ]
    total: Polynomial | None = None
    for squares in words:
        squares = np.sort(squares, axis=1)
        part = Polynomial.from_words(squares, np.ones(squares.shape[0]), n)
        total = part if total is None else total + part
    assert total is not None
    return total
