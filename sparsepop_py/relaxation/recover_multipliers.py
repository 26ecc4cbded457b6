"""Recovery of multipliers from a solver's dual: an identity in the original units.

The solver's z holds, group by group, Gram matrices Z and equality multipliers of the
scaled problem. Each Z is replaced by the factor of its nearest positive semidefinite
matrix; scaled rows g = size * g_scaled divide their multipliers by ``size``. Nothing here
needs to be exact: losses show in the remainder of the identity.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.polynomial import Polynomial, total
from sparsepop_py.conic.program import ConicProgram
from sparsepop_py.problem.generators import single_letters
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.assemble import split_dual
from sparsepop_py.relaxation.blocks import BlockGroup
from sparsepop_py.relaxation.moment import Relaxation
from sparsepop_py.verified.arithmetic.array_cache import indices, interned
from sparsepop_py.verified.box.scaling import Scaled
from sparsepop_py.verified.certificate.multipliers import Multipliers
from sparsepop_py.verified.certificate.sos_identity import Identity, Priced

__all__ = [
    "finite",
    "floored",
    "identity_of",
    "in_32_bits",
    "margin",
    "repaired",
    "shortened",
]

_FLOOR = 4e-13  # in scaled units; rounding leaves about a tenth of that in each row
_FIRM = 1e-14  # relative, added to normal equations, whose unknowns may be dependent


def identity_of(
    relaxation: Relaxation,
    scaled: Scaled,
    z: NDArray[np.float64],
    objective_size: float,
    floor: float = 0.0,
) -> Identity:
    """Convert a dual solution to an identity.

    Parameters
    ----------
    relaxation : Relaxation
        The relaxation that was solved.
    scaled : Scaled
        The scaled problem it is of.
    z : (R,) float
        Dual in the convention of :mod:`sparsepop_py.conic.program`.
    objective_size : float
        original objective = size * scaled objective.
    floor : float
        Multiple of :func:`margin` that was subtracted from the scaled objective.

    Returns
    -------
    Identity
    """
    sizes = scaled.generator_sizes(relaxation.products)
    multipliers = []
    priced = None
    for group, part in zip(relaxation.groups, split_dual(relaxation, z), strict=True):
        if group.generator[0] >= sizes.size:
            values = _weighted(part.ravel(), np.full(part.size, objective_size))
            priced = _priced(relaxation, group, values, sizes.size)
            continue
        weight = objective_size / sizes[group.generator]
        if group.free:
            values = _weighted(part, weight[:, None])
            generator, basis = indices(group.generator), interned(group.basis)
            multipliers.append(Multipliers(generator, basis, values))
            continue
        holds = (_letters(relaxation.problem, group.generator) >= 0) & (floor > 0)
        for with_floor in (False, True):
            chosen = np.flatnonzero(holds == with_floor)
            if chosen.size:
                factor = _factor(_weighted(part[chosen], weight[chosen, None, None]))
                own = floor * objective_size if with_floor else 0.0
                place = None if group.place is None else indices(group.place[chosen])
                generator, basis = indices(group.generator[chosen]), interned(group.basis[chosen])
                multipliers.append(Multipliers(generator, basis, factor, own, place))
    return Identity(scaled.scaling, tuple(multipliers), indices(relaxation.products), priced)


def _priced(
    relaxation: Relaxation, group: BlockGroup, values: NDArray[np.float64], first: int
) -> Priced:
    """Collect the multipliers of monomials whose bounds are the rows of a group."""
    rows = relaxation.moment_bounds
    assert rows is not None
    block, term = rows.terms_of(group.generator - first)
    moving = rows.words[term].any(axis=1)
    block, term = block[moving], term[moving]
    return Priced(rows.words[term], _weighted(values[block], rows.coefficients[term]))


def _weighted(part: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert multipliers to the original units; those that overflow become zero."""
    with np.errstate(over="ignore", invalid="ignore"):
        return finite(part * weight)


def finite(multipliers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Replace multipliers that have overflowed by zero: certificates hold finite numbers only."""
    return np.where(np.isfinite(multipliers), multipliers, 0.0)


def in_32_bits(multipliers: NDArray[np.float64]) -> NDArray[Any]:
    """Round multipliers to 32 bits unless the largest one overflows there."""
    small = np.abs(multipliers).max(initial=0.0) < np.finfo(np.float32).max
    return multipliers.astype(np.float32) if small else multipliers


def repaired(program: ConicProgram, z: NDArray[np.float64]) -> NDArray[np.float64]:
    """Project z on q + A'z = 0 by least squares; signs are not kept.

    Rows of equalities are free and take most of the change; the semidefinite parts usually lose
    far less than the residual was when they are made positive again.
    """
    weight = np.ones(z.size)
    weight[: program.cones.zero] = 1e6
    weighted = sps.diags_array(weight) @ program.A
    normal = program.A.T @ weighted
    own = normal.diagonal()
    normal = sps.csc_array(normal + sps.diags_array(np.where(own > 0, _FIRM * own, 1.0)))
    how = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    try:
        factors = splu(normal, "MMD_AT_PLUS_A", **how)
    except RuntimeError:  # products that under- or overflow leave it singular
        return z
    for _ in range(3):
        residual = program.q + program.A.T @ z
        if not np.any(residual):
            break
        z = z - weighted @ factors.solve(residual)
    return z


def floored(
    relaxation: Relaxation, program: ConicProgram, z: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Split a multiple of the identity off the Gram matrices of the objective.

    For relaxations that have moment matrices only. Each entry stands for one monomial, so the
    nearest z with q + A'z = 0 is found monomial by monomial, up to rounding. Where the least
    eigenvalue is too small, the entry of the constant is raised as far as needed, which
    lowers the bound by as much.

    Returns
    -------
    z : (R,) float
        Without the floor.
    floor : float
        In scaled units; 0 where some matrix does not become positive definite.

    References
    ----------
    H. Peyrl, P. A. Parrilo, Theoret. Comput. Sci. 409 (2008) 269-281 (projection on the
    affine space of Gram matrices).
    """
    matrix = program.A
    weight = np.asarray(matrix.multiply(matrix).sum(axis=0)).ravel()
    for _ in range(2):
        residual = program.q + matrix.T @ z
        z = z - matrix @ np.divide(residual, weight, out=np.zeros_like(residual), where=weight > 0)
    least, shift, offset = np.inf, np.zeros(z.size), 0
    for group, part in zip(relaxation.groups, split_dual(relaxation, z), strict=True):
        i, j = group.pairs
        lift = _lift(part, np.all(group.basis[:, 0] == 0, axis=1))
        part[:, 0, 0] += lift
        least = min(least, float(np.linalg.eigvalsh(part).min(initial=np.inf)))
        rows = np.where(i == j, -_FLOOR, 0.0)[None, :].repeat(group.count, axis=0)
        rows[:, 0] += lift
        shift[offset : offset + rows.size] = rows.ravel()
        offset += rows.size
    return z + shift, _FLOOR if least > 1.01 * _FLOOR else 0.0


def _lift(matrices: NDArray[np.float64], constant: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Compute increments of first diagonal entries by Schur complements, 0 where useless."""
    need = 2.0 * _FLOOR
    low = np.linalg.eigvalsh(matrices)[:, 0] < need
    lift = np.zeros(low.size)
    rest = matrices[:, 1:, 1:] - need * np.eye(matrices.shape[1] - 1)
    regular = np.linalg.eigvalsh(rest)[:, 0] > 0 if rest.size else np.ones(low.size, bool)
    chosen = np.flatnonzero(low & constant & regular)
    side = matrices[chosen, 1:, :1]
    hidden = np.linalg.solve(rest[chosen], side)[:, :, 0]
    complement = np.sum(hidden * side[:, :, 0], axis=1)
    lift[chosen] = np.maximum(0.0, complement + need - matrices[chosen, 0, 0])
    return lift


def shortened(identity: Identity, share: float = 1e-8) -> Identity:
    """Shorten an identity: 32-bit numbers, small parts left out.

    Columns of factors that are small in all blocks of a group go, and blocks that are small
    altogether; the factors L become triangular. Evaluation shows whether the bound is still good
    enough.

    Parameters
    ----------
    identity : Identity
    share : float
        Parts below this share of the largest one are left out.
    """
    sizes = [np.sum(np.square(m.values), axis=1) for m in identity.multipliers if not m.free]
    largest = max((float(s.max(initial=0.0)) for s in sizes), default=0.0)
    kept = []
    for group in identity.multipliers:
        values = group.values
        if group.free:
            used = np.any(values != 0, axis=1)
        else:
            weight = np.sum(np.square(values), axis=1)
            values = values[:, :, np.any(weight > share * largest, axis=0)]
            used = np.any(weight > share * largest, axis=1) | (group.floor > 0)
            values = _triangular(values)
        if used.any():
            kept.append(group.chosen(used, in_32_bits(values[used].astype(float))))
    return replace(identity, multipliers=tuple(kept))


def _letters(problem: Problem, generator: NDArray[Any]) -> NDArray[np.int32]:
    return single_letters(problem.lower, problem.upper, len(problem.constraints), generator)


def _factor(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Factor symmetric matrices as L L', negative eigenvalues set to zero."""
    values, vectors = np.linalg.eigh(matrices)
    return finite(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])


def _triangular(factors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Make factors (K, s, r) lower triangular with about the same L L'.

    L' = Q R gives R'.
    """
    return np.tril(np.swapaxes(np.linalg.qr(np.swapaxes(factors, 1, 2), mode="r"), 1, 2))


def margin(relaxation: Relaxation) -> Polynomial:
    """Add g b^2 over the monomials b of blocks that can absorb a remainder.

    Subtracting a multiple of it from the objective leaves every such block with that
    multiple of the identity as its floor.
    """
    problem = relaxation.problem
    sign = np.append(1.0, np.where(np.isfinite(problem.lower), 1.0, -1.0))
    parts = []
    for group in relaxation.groups:
        letter = _letters(problem, group.generator)
        chosen = np.flatnonzero(letter >= 0)
        if group.free or not chosen.size:
            continue
        words = monomials.multiply(group.basis[chosen], group.basis[chosen])
        words = monomials.multiply(words, letter[chosen, None, None])
        value = np.repeat(sign[letter[chosen]], group.size)
        flat = words.reshape(value.size, words.shape[2])
        parts.append(Polynomial._merged(flat, value, problem.dimension))
    return total(parts)
