"""A box of the parameters from the cones of denominators that multipliers leave.

The notation is that of ``varying_multipliers.py``. A cone that is not refuted holds denominators
a = sum_j t_j v_j with t >= 0. Where all v_j0 > 0, each coefficient a_i / a_0 lies between the least
and the largest v_ji / v_j0. These ends bound the denominator.

A gain b of the numerator, with the known column phi, is bounded on a cone by a family of
multipliers lambda_k that are orthogonal to all other columns, with m_k = -phi' lambda_k >= 0. The
multiplier sum_k t_k lambda_k of the rows reads

    sum_jk t_j t_k v_j q_k  +  b (sum_j t_j v_j0) (sum_k t_k m_k)  =  the noise.

So b < beta on the whole cone if, for each pair j <= k,

    v_j q_k + v_k q_j  +  beta (v_j0 m_k + v_k0 m_j)  -  sum_i w(i) abs(v_j * lambda_k
        + v_k * lambda_j)(i)  -  sum_r sigma_r H_r(j, k)  >  0:

were b >= beta, the left side of the rows would exceed what noise can give. Lower ends are upper
ones of -b. What holds on a cone holds on its halves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite, nextafter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from setid.formulation.formulation import Formulation
from setid.proofs.denominators.cones import Cone
from setid.proofs.denominators.denominator_cells import VaryingLeaf, correction_bounds, is_ordinary
from setid.proofs.denominators.output_rows import OutputRows, output_rows
from setid.proofs.denominators.varying_multipliers import (
    VaryingCells,
    exceeds,
    hurwitz_minors,
    is_well_formed,
    pairs,
    sides,
)
from setid.proofs.fields import well_formed
from setid.proofs.row_boxes import RowBox, rows_prove
from sparsepop_py.verified.uncertain_rows.box import Bounds
from sparsepop_py.verified.uncertain_rows.sign_tree import intersect

__all__ = ["DenominatorBox", "Limit", "limit_holds", "ratio_ends", "upright"]

Reals = NDArray[np.float64]


class Limit(NamedTuple):
    """An upper end of a gain, or of its negative, on a cone.

    Parameters
    ----------
    cell : int
        Number of the cone.
    column : int
        Number of the known column of the gain.
    sign : int
        1 for the gain, -1 for its negative.
    value : float
        The end.
    used : tuple of int
        Numbers of multipliers, one for each vector of the cone.
    powers : tuple of int
        Each vector of the cone is divided by 2 to this power.
    minors : tuple of float
        Weights >= 0 of the Hurwitz minors; none, or n - 2 of them.
    """

    cell: int
    column: int
    sign: int
    value: float
    used: tuple[int, ...]
    powers: tuple[int, ...]
    minors: tuple[float, ...] = ()


def upright(cone: Cone) -> Cone | None:
    """Turn a cone so that all vectors begin with a positive number; None where it has no such side.

    Parameters
    ----------
    cone : (n + 1, n + 1) int

    Examples
    --------
    >>> upright(np.array([[-1, 2], [-3, 4]], object)).tolist()
    [[1, -2], [3, -4]]
    """
    for turned in (cone, -cone):
        if min(turned[:, 0]) > 0:
            return turned
    return None


def ratio_ends(cone: Cone) -> tuple[Reals, Reals]:
    """Bound the coefficients a_1, ..., a_n of denominators 1 + a_1 / q + ... in a cone.

    Parameters
    ----------
    cone : (n + 1, n + 1) int

    Returns
    -------
    lower, upper : (n,) float
        Rounded outwards; infinite where a vector does not begin as the others do.

    Examples
    --------
    >>> [ends.tolist() for ends in ratio_ends(np.array([[2, 1], [1, -1]], object))]
    [[-1.0], [0.5]]
    """
    turned, n = upright(cone), len(cone) - 1
    low, high = np.full(n, -inf), np.full(n, inf)
    if turned is None:
        return low, high
    for i in range(n):
        quotients = [(v[i + 1] / v[0], v) for v in turned.tolist()]  # rounded once
        low[i] = min(_beside(value, v[i + 1], v[0], -inf) for value, v in quotients)
        high[i] = max(_beside(value, v[i + 1], v[0], inf) for value, v in quotients)
    return low, high


def _beside(quotient: float, above: int, below: int, towards: float) -> float:
    """The double on one side of a quotient of integers."""
    top, bottom = quotient.as_integer_ratio()
    return quotient if top * below == bottom * above else nextafter(quotient, towards)


def limit_holds(
    rows: OutputRows, free: NDArray[np.int64], multipliers: Reals, cone: Cone, limit: Limit
) -> bool:
    """Check that a gain stays below its end on a cone, rounding included.

    Parameters
    ----------
    rows : OutputRows
    free : (c,) int
        Samples whose multipliers give each one its products with the columns.
    multipliers : (M, N) float
    cone : (n + 1, n + 1) int
    limit : Limit
    """
    leaf = VaryingLeaf((limit.used,), (1.0,), limit.powers, limit.minors)
    turned = upright(cone)
    if turned is None or not is_well_formed(leaf, len(cone), len(multipliers), rows):
        return False
    if not 0 <= limit.column < rows.known.shape[1] or limit.sign not in (1, -1):
        return False
    vectors = np.ldexp(turned.astype(np.float64), -np.array(limit.powers)[:, None])
    family = multipliers[list(limit.used)]
    shares = np.maximum(-limit.sign * (family @ rows.known[:, limit.column]), 0.0)
    if not (isfinite(limit.value) and is_ordinary(vectors) and is_ordinary(shares)):
        return False
    aims = np.zeros((len(family), rows.known.shape[1]))
    aims[:, limit.column] = -limit.sign * shares
    corrections = correction_bounds(rows, free, family, aims)
    if corrections is None:
        return False
    needed, noise = sides(rows, family, corrections, vectors, np.arange(len(cone))[None])
    one, two = np.array(pairs(len(cone))).T
    gained = limit.value * (vectors[one, 0] * shares[two] + vectors[two, 0] * shares[one])
    minors = np.zeros((0, one.size))
    if limit.minors:
        minors = hurwitz_minors(turned, limit.powers)
    weights = np.concatenate([[1.0, 1.0], -np.array(limit.minors)])
    return exceeds(weights, np.vstack([needed, gained, minors]), noise[0])


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class DenominatorBox(Bounds):
    """A box of theta from cones of denominators.

    Parameters
    ----------
    names, lower, upper
        As of :class:`sparsepop_py.verified.uncertain_rows.box.Bounds`.
    first : ParameterBox, DirectionBox, LiftedBox or None
        A box that is known before.
    trees : tuple of VaryingCells
        Of some outputs. Leaves that are not refuted stay.
    limits : tuple of tuple of Limit
        For each tree.
    complete : bool
        Whether time sufficed; says nothing that is trusted.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1.0, 2.0], [0.5, 1.0])  # a gain of .5, noise up to .1
    >>> model = setid.TransferFunction(na=0, nb=1)
    >>> known = setid.formulate(data, model, setid.Noise(output=0.1))
    >>> tree = VaryingCells(0, [1], [[0.0, -1.0]], (VaryingLeaf((), (), ()),))
    >>> above = Limit(0, 0, 1, 0.551, (0,), (0,))
    >>> ends = np.array([-9.0]), np.array([0.551])
    >>> box = DenominatorBox(("b0",), *ends, None, (tree,), ((above,),))
    >>> box.verify(known, np.array([[-9.0], [9.0]]))
    True
    """

    first: RowBox | None
    trees: tuple[VaryingCells, ...]
    limits: tuple[tuple[Limit, ...], ...]
    complete: bool = True

    @property
    def cut_short(self) -> bool:
        """True if time ended before all cones were small."""
        return not self.complete

    def verify(self, formulation: Formulation, start: Reals) -> bool:
        """Check every leaf and every limit from the readings; there is no solver in it.

        Parameters
        ----------
        formulation : Formulation
        start : (2, p) float
            The bounds of the parameters that priors give.
        """
        if not well_formed(self):
            return False
        if self.first is not None and not rows_prove(self.first, formulation, start):
            return False
        hull = self.hull(formulation, start)
        if hull is None:
            return False
        if np.any(hull[0] > hull[1]):
            return True  # nothing is consistent: whatever is claimed holds
        return self.follow(*hull)

    def hull(self, formulation: Formulation, start: Reals) -> tuple[Reals, Reals] | None:
        """Compute what the cones leave of the first box; None where they are malformed.

        Parameters
        ----------
        formulation : Formulation
        start : (2, p) float
            As of :meth:`verify`.
        """
        low, high = start
        if self.first is not None:
            low, high = np.maximum(low, self.first.lower), np.minimum(high, self.first.upper)
        if len(self.limits) != len(self.trees):
            return None
        for tree, limits in zip(self.trees, self.limits, strict=True):
            found = _hull(formulation, tree, limits, (low, high))
            if found is None:
                return None
            low, high = found
        return low, high


def _hull(
    formulation: Formulation,
    tree: VaryingCells,
    limits: Sequence[Limit],
    inside: tuple[Reals, Reals],
) -> tuple[Reals, Reals] | None:
    """Compute what a tree leaves of a box; None where it is malformed."""
    if not 0 <= tree.output < formulation.model.outputs:
        return None
    rows = output_rows(formulation, tree.output)
    unrefuted = None if rows is None else tree.unrefuted(rows)
    if rows is None or unrefuted is None:
        return None
    cones, placed = tree.cones(rows), tree.placed(rows)
    assert cones is not None and placed is not None
    at = {name: place for place, name in enumerate(formulation.parameters)}
    known = dict.fromkeys(cones, inside)
    for limit in limits:
        if limit.cell in cones and limit_holds(rows, *placed, cones[limit.cell], limit):
            known[limit.cell] = _limited(known[limit.cell], limit, rows, at)
    for number in sorted(cones):  # children come after their parents
        for child in tree.children_of(number):
            known[child] = intersect(known[child], known[number])
    own = [(lag, at[name]) for lag, name in enumerate(rows.own) if name in at]
    hull = np.full_like(inside[0], inf), np.full_like(inside[1], -inf)
    for number in unrefuted:
        ends, (low, high) = ratio_ends(cones[number]), known[number]
        low, high = low.copy(), high.copy()
        for lag, place in own:
            low[place] = max(low[place], ends[0][lag])
            high[place] = min(high[place], ends[1][lag])
        if np.all(low <= high):
            hull = np.minimum(hull[0], low), np.maximum(hull[1], high)
    return hull


def _limited(
    box: tuple[Reals, Reals], limit: Limit, rows: OutputRows, at: dict[str, int]
) -> tuple[Reals, Reals]:
    """A box with the end of a gain, where that is a parameter."""
    name, sign = rows.gains[limit.column]
    if name not in at:
        return box
    low, high = box[0].copy(), box[1].copy()
    if sign * limit.sign > 0:
        high[at[name]] = min(high[at[name]], limit.value)
    else:
        low[at[name]] = max(low[at[name]], -limit.value)
    return low, high
