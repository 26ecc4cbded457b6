"""No parameters are consistent with a record: cones whose multipliers vary with the denominator.

The notation is that of ``denominator_cells.py``. A cone is spanned by v_1, ..., v_K, so that its
denominators are a = sum_j t_j v_j with t >= 0. The noise is bounded sample by sample here; in
another norm its dual takes the place of sum_i w(i) abs(). A family has one multiplier lambda_k for
each vector, orthogonal to the columns, and stands for the multiplier sum_k t_k lambda_k of the rows
of a. Its combination of the rows reads, in pairs j <= k,

    sum_jk t_j t_k v_j q_k  =  the noise  <=  sum_i w(i) abs(sum_jk t_j t_k (v_j * lambda_k)(i)),

where q_k is the vector q of lambda_k. Gathered by pairs and with c_m the signed weight of family
m, no noise within w explains a if, for each pair j <= k,

    sum_m c_m (v_j q_mk + v_k q_mj)  -  sum_m abs(c_m) sum_i w(i) abs(v_j * lambda_mk
        + v_k * lambda_mj)(i)  -  sum_r sigma_r H_r(j, k)  >  0.

For t_j t_k >= 0 are not all zero, and the sum over j <= k of t_j t_k times these (half of it for
j = k) bounds from below what the rows need more than noise can give, minus sum_r sigma_r H_r(a)
with sigma >= 0. There H_r(a) = b_r b_(r+1) - b_(r-1) b_(r+2), r = 1, ..., n - 2, are minors of the
Hurwitz matrix in the coefficients b of the bilinear transform, and H_r(j, k) is what they have at
t_j t_k. They are >= 0 where all zeros lie in the closed unit disc (B. A. Asner, *SIAM J. Applied
Mathematics* 18 (1970) 407-414). So they help only there, and only where a prior says so.
With equal multipliers in all vectors and no minors these are sums of what is asked of the vectors
in ``denominator_cells.py``. Multipliers that follow the denominator leave a gap of second order in
the width of the cone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from setid.proofs.denominators.cones import Cone, first_cones
from setid.proofs.denominators.denominator_cells import (
    Cell,
    DenominatorCells,
    VaryingLeaf,
    dual_norm,
    is_ordinary,
    multiplied_readings,
)
from setid.proofs.denominators.output_rows import OutputRows

__all__ = ["VaryingCells", "hurwitz_minors", "pairs"]

Reals = NDArray[np.float64]
_UNIT = 2.0**-53
_MORE = 1.0 + 1e-12  # more than the rounding of sums of positive numbers
_POWER = 400  # largest of two: quotients of integers and powers are normal


@dataclass(frozen=True, slots=True, eq=False)
class VaryingCells(DenominatorCells):
    """Claim that no parameters are consistent with a record, by multipliers that vary.

    Parameters
    ----------
    output : int
        Channel, from 0.
    free : (c,) int
        As of :class:`DenominatorCells`.
    multipliers : (M, N) float
    cells : tuple of Cell or VaryingLeaf

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1.0, 2.0], [0.0, 3.0])  # a gain of 1 needs noise of 1
    >>> model = setid.TransferFunction(na=0, nb=1)
    >>> known = setid.formulate(data, model, setid.Noise(output=0.9))
    >>> only = VaryingLeaf(used=((0,),), shares=(1.0,), powers=(0,))
    >>> VaryingCells(0, [0], [[-2.0, 1.0]], (only,)).verify(known)
    True
    """

    def _refutes(
        self,
        rows: OutputRows,
        table: Reals,
        corrections: Reals,
        cone: Cone,
        cell: Cell | VaryingLeaf,
    ) -> bool:
        if not isinstance(cell, VaryingLeaf):
            return DenominatorCells._refutes(self, rows, table, corrections, cone, cell)
        return family_refutes(rows, table, corrections, cone, cell)


def family_refutes(
    rows: OutputRows, multipliers: Reals, corrections: Reals, cone: Cone, leaf: VaryingLeaf
) -> bool:
    """Check that families of multipliers leave no denominator of a cone.

    Parameters
    ----------
    rows : OutputRows
    multipliers : (M, N) float
    corrections : (M, N) float
        How far each may be from one that is orthogonal to the columns.
    cone : (K, n + 1) int
    leaf : VaryingLeaf
    """
    if not is_well_formed(leaf, len(cone), len(multipliers), rows):
        return False
    vectors = np.ldexp(cone.astype(np.float64), -np.array(leaf.powers)[:, None])
    if not is_ordinary(vectors):
        return False
    families = np.array(leaf.used, np.int64).reshape(-1, len(cone))
    needed, noise = sides(rows, multipliers, corrections, vectors, families)
    minors = np.zeros((0, needed.shape[1]))
    if leaf.minors:
        minors = hurwitz_minors(cone, leaf.powers)
    weights = np.concatenate([leaf.shares, -np.array(leaf.minors)])
    return exceeds(weights, np.vstack([needed, minors]), np.abs(leaf.shares) @ noise)


def is_well_formed(leaf: VaryingLeaf, vectors: int, multipliers: int, rows: OutputRows) -> bool:
    """Check numbers, weights and powers of a leaf."""
    numbers = [number for family in leaf.used for number in family]
    if len(leaf.shares) != len(leaf.used) or len(leaf.powers) != vectors:
        return False
    if any(len(family) != vectors for family in leaf.used):
        return False
    if not all(0 <= number < multipliers for number in numbers):
        return False
    if not all(abs(power) <= _POWER for power in leaf.powers):
        return False
    if not leaf.minors:
        return True
    if not (rows.stable and len(leaf.minors) == rows.order - 2):
        return False
    return min(leaf.minors) >= 0.0 and is_ordinary(np.array(leaf.minors))


def pairs(count: int) -> list[tuple[int, int]]:
    """List the pairs j <= k of vectors.

    Parameters
    ----------
    count : int

    Examples
    --------
    >>> pairs(2)
    [(0, 0), (0, 1), (1, 1)]
    """
    return [(j, k) for j in range(count) for k in range(j, count)]


def hurwitz_minors(cone: Cone, powers: tuple[int, ...]) -> Reals:
    """Polarise the minors of the Hurwitz matrix at pairs of vectors, (n - 2, pairs).

    Parameters
    ----------
    cone : (n + 1, n + 1) int
    powers : (n + 1,) int
        Each vector is divided by 2 to this power.

    Returns
    -------
    minors : (n - 2, pairs) float
        Rounded once; twice the minor itself where both vectors are the same.
    """
    n = len(cone) - 1
    b = cone @ first_cones(n, True)[0]  # 2^n times the coefficients in s = (z - 1) / (z + 1)

    def at(r: int, j: int, k: int) -> float:
        two = b[j, r] * b[k, r + 1] + b[k, r] * b[j, r + 1]
        other = b[j, r - 1] * b[k, r + 2] + b[k, r - 1] * b[j, r + 2]
        return float(np.ldexp(float(two - other), -powers[j] - powers[k]))

    return np.array([[at(r, j, k) for j, k in pairs(n + 1)] for r in range(1, n - 1)])


def sides(
    rows: OutputRows,
    multipliers: Reals,
    corrections: Reals,
    vectors: Reals,
    families: NDArray[np.int64],
) -> tuple[Reals, Reals]:
    """Compute what rows need, and what noise and rounding can give, (m, pairs) each."""
    one, two = np.array(pairs(len(vectors))).T
    needed, noise = np.zeros((len(families), one.size)), np.zeros((len(families), one.size))
    for m, family in enumerate(families):
        q, lost, shifted, rounding = multiplied_readings(
            rows, multipliers[family], corrections[family]
        )
        value, loss = vectors @ q.T, np.abs(vectors) @ lost.T
        filtered = np.einsum("jv,kvn->jkn", vectors, shifted)
        let = dual_norm(rows, filtered[one, two] + filtered[two, one])
        needed[m] = value[one, two] + value[two, one]
        noise[m] = (let + loss[one, two] + loss[two, one]) * (1.0 + 4.0 * rounding) * _MORE
    return needed, noise


def exceeds(weights: Reals, needed: Reals, noise: Reals) -> bool:
    """Check that a weighted sum (pairs,) exceeds noise at each pair, rounding included."""
    rounding = (weights.size + 8) * _UNIT
    with np.errstate(over="ignore", invalid="ignore"):
        loss = rounding * (np.abs(weights) @ np.abs(needed))
        room = noise * (1.0 + 4.0 * rounding) * _MORE
        return bool(np.all(weights @ needed - room > 2.0 * loss + 1e-280))
