"""No parameters are consistent with a record of noisy outputs: a proof by cones of denominators.

The rows of a linear structure are, for one output y with noise eta within bounds w,

    sum_i a_i (y(k - i) - eta(k - i))  =  sum_j b_j phi_j(k),          a_0 = 1,

where the columns phi are known: delayed inputs and a constant. Multipliers lambda of the rows with
phi_j' lambda = 0 for each j leave the denominator alone,

    abs(sum_i a_i q_i)  <=  sum_k w(k) abs((a * lambda)(k)),

with q_i = sum_k lambda(k) y(k - i) and (a * lambda)(k) = sum_i a_i lambda(k + i). Where the noise
in parts of w is bounded in another norm, the right side is the dual norm of w (a * lambda): the
Euclidean one, or the largest size where the sum of sizes is bounded. Neither
numerators nor first samples have to be bounded. Both sides are homogeneous in a, so that a may be
any multiple of (1, a_1, ..., a_n). With signed weights of several multipliers,

    g(a)  =  sum_m weight_m q_m a  -  sum_m abs(weight_m) sum_k w(k) abs((a * lambda_m)(k))  <=  0,

and likewise with the dual norm, where g is concave and g(t a) = t g(a) for t > 0. Hence a cone of
denominators has no consistent member if g > 0 at each of the vectors that span it. The cones are
those of ``cones.py``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import frozen
from setid.formulation.formulation import Formulation
from setid.proofs.denominators.cones import Cone, first_cones, split_cone
from setid.proofs.denominators.output_rows import OutputRows, output_rows
from setid.proofs.fields import well_formed
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.verified.arithmetic.rational import solve_matrix

__all__ = [
    "Cell",
    "DenominatorCells",
    "VaryingLeaf",
    "correction_bounds",
    "dual_norm",
    "is_ordinary",
    "is_refuted",
    "multiplied_readings",
]

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]
_UNIT = 2.0**-53  # rounding of one operation, relative to its result
_MORE = 1.0 + 1e-12  # more than the rounding of sums of positive numbers
_LEAST, _MOST = 2.0**-300, 2.0**300  # sizes of numbers: their products are normal
_TINY = 1e-140  # more than the root of squares that underflow


class Cell(NamedTuple):
    """A cone that is split, or a leaf with the multipliers that refute it.

    Parameters
    ----------
    children : tuple of int
        Numbers of its two halves, larger than its own; none for a leaf.
    edge, weights : (int, int)
        As of :func:`split_cone`.
    used : tuple of int
        Numbers of multipliers.
    shares : tuple of float
        Their signed weights.
    """

    children: tuple[int, ...] = ()
    edge: tuple[int, int] = (0, 0)
    weights: tuple[int, int] = (1, 1)
    used: tuple[int, ...] = ()
    shares: tuple[float, ...] = ()


class VaryingLeaf(NamedTuple):
    """A cone refuted by multipliers that vary over it, see ``varying_multipliers.py``.

    Parameters
    ----------
    used : tuple of tuple of int
        Numbers of multipliers, in each family one for each vector of the cone.
    shares : tuple of float
        Signed weights of the families.
    powers : tuple of int
        Each vector of the cone is divided by 2 to this power.
    minors : tuple of float
        Weights >= 0 of the Hurwitz minors; none, or n - 2 of them.
    """

    used: tuple[tuple[int, ...], ...]
    shares: tuple[float, ...]
    powers: tuple[int, ...]
    minors: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class DenominatorCells(ReadOnly):
    """Claim that no parameters are consistent with a record.

    Parameters
    ----------
    output : int
        Channel, from 0.
    free : (c,) int
        Samples whose multipliers make each one orthogonal to the numerator's columns.
    multipliers : (M, N) float
        Orthogonal up to rounding.
    cells : tuple of Cell
        Those of the first cones come first. :class:`VaryingLeaf` is for
        :class:`setid.proofs.denominators.varying_multipliers.VaryingCells` alone.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1.0, 2.0], [0.0, 3.0])  # a gain of 1 needs noise of 1
    >>> model = setid.TransferFunction(na=0, nb=1)
    >>> known = setid.formulate(data, model, setid.Noise(output=0.9))
    >>> only = Cell(used=(0,), shares=(1.0,))
    >>> DenominatorCells(0, [0], [[-2.0, 1.0]], (only,)).verify(known)
    True
    """

    output: int
    free: Integers
    multipliers: Reals
    cells: tuple[Cell | VaryingLeaf, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "free", frozen(np.array(self.free, np.int64)))
        object.__setattr__(self, "multipliers", frozen(np.array(self.multipliers, np.float64)))

    @property
    def empty(self) -> bool:
        """True: that is the claim."""
        return True

    @property
    def leaves(self) -> int:
        """Number of cones that are not split."""
        return sum(isinstance(cell, VaryingLeaf) or not cell.children for cell in self.cells)

    def verify(self, formulation: Formulation) -> bool:
        """Check every leaf from the readings; there is no solver in it.

        Parameters
        ----------
        formulation : Formulation
            Of the record with the noise that is refuted.
        """
        if not 0 <= self.output < formulation.model.outputs:
            return False
        rows = output_rows(formulation, self.output)
        return rows is not None and self.follows(rows)

    def follows(self, rows: OutputRows) -> bool:
        """Check every leaf against the rows of the output.

        Parameters
        ----------
        rows : OutputRows
        """
        unrefuted = self.unrefuted(rows) if well_formed(self) else None
        return unrefuted is not None and next(unrefuted, None) is None

    def unrefuted(self, rows: OutputRows) -> Iterator[int] | None:
        """Number the leaves that are not refuted; None where multipliers or cones are malformed.

        Parameters
        ----------
        rows : OutputRows
        """
        placed = self.placed(rows)
        if placed is None:
            return None
        free, table = placed
        if not all(map(is_ordinary, (table, rows.y, rows.bound, rows.known))):
            return None
        corrections, cones = correction_bounds(rows, free, table), self.cones(rows)
        if corrections is None or cones is None:
            return None
        leaves = (number for number in sorted(cones) if not self.children_of(number))
        cells = self.cells
        return (
            n for n in leaves if not self._refutes(rows, table, corrections, cones[n], cells[n])
        )

    def placed(self, rows: OutputRows) -> tuple[Integers, Reals] | None:
        """Place free samples (c,) and multipliers (M, S) among those of the rows.

        Parameters
        ----------
        rows : OutputRows

        Returns
        -------
        (c,) int and (M, S) float
            None of both where they are malformed.
        """
        table, count = rows.spread(self.multipliers), np.count_nonzero(rows.inside)
        if table is None or np.any(table[:, ~rows.row]):
            return None
        if np.any((self.free < 0) | (self.free >= count)):
            return None
        return rows.places(self.free), table

    def children_of(self, number: int) -> tuple[int, ...]:
        """Number the children of a cone; none for a leaf."""
        cell = self.cells[number]
        return () if isinstance(cell, VaryingLeaf) else cell.children

    def cones(self, rows: OutputRows) -> dict[int, Cone] | None:
        """Find each cone by its number; None where their tree is malformed.

        Parameters
        ----------
        rows : OutputRows
        """
        if not rows.stable and rows.order >= len(self.cells).bit_length():
            return None  # fewer than the first cones, whose number grows as 2^n
        waiting = list(enumerate(first_cones(rows.order, rows.stable)))
        found = dict[int, Cone]()
        while waiting:
            number, cone = waiting.pop()
            if number in found or not 0 <= number < len(self.cells):
                return None
            found[number], cell = cone, self.cells[number]
            if isinstance(cell, VaryingLeaf) or not cell.children:
                continue
            halves = split_cone(cone, cell.edge, cell.weights)
            if halves is None or len(cell.children) != 2 or min(cell.children) <= number:
                return None
            waiting += zip(cell.children, halves, strict=True)
        return found

    def _refutes(
        self,
        rows: OutputRows,
        table: Reals,
        corrections: Reals,
        cone: Cone,
        cell: Cell | VaryingLeaf,
    ) -> bool:
        if isinstance(cell, VaryingLeaf):
            return False
        used = np.array(cell.used, np.int64)
        if len(cell.shares) != used.size or not used.size:
            return False
        if used.min() < 0 or used.max() >= len(table):
            return False
        return is_refuted(
            rows, table[used], corrections[used], cone, np.array(cell.shares, np.float64)
        )


def is_refuted(
    rows: OutputRows, multipliers: Reals, corrections: Reals, cone: Cone, shares: Reals
) -> bool:
    """Check that g > 0 at the vectors that span a cone, rounding included.

    Parameters
    ----------
    rows : OutputRows
    multipliers : (m, N) float
    corrections : (m, N) float
        How far each may be from one that is orthogonal to the columns.
    cone : (K, n + 1) int
    shares : (m,) float
        Signed weights.
    """
    value, most = _sides(rows, multipliers, corrections, cone)
    size = np.abs(shares)
    with np.errstate(over="ignore", invalid="ignore"):
        rounding = (shares.size + 8) * _UNIT
        total, room = shares @ value, (size @ most) * (1.0 + 4.0 * rounding) * _MORE
        loss = rounding * (size @ np.abs(value))
        return bool(np.all(total - room > 2.0 * loss + 1e-280))


def is_ordinary(numbers: Reals) -> bool:
    """Check that all numbers are 0 or of a size whose products neither underflow nor overflow.

    Parameters
    ----------
    numbers : array of float
    """
    size = np.abs(numbers[numbers != 0])
    return bool(np.all((size >= _LEAST) & (size <= _MOST)))


def _sides(
    rows: OutputRows, multipliers: Reals, corrections: Reals, cone: Cone
) -> tuple[Reals, Reals]:
    """Values q a (m, K), and what the noise and rounding can be against them (m, K)."""
    vectors = cone.astype(np.float64)
    q, lost, shifted, rounding = multiplied_readings(rows, multipliers, corrections)
    value = q @ vectors.T
    filtered = np.einsum("kv,mvn->mkn", vectors, shifted)
    noise = dual_norm(rows, filtered)
    return value, (noise + lost @ np.abs(vectors).T) * (1.0 + 4 * rounding) * _MORE


def dual_norm(rows: OutputRows, filtered: Reals) -> Reals:
    """Compute what the noise can be in filtered multipliers (..., N): the dual norm.

    Parameters
    ----------
    rows : OutputRows
    filtered : (..., N) float
        Multipliers filtered by denominators.

    Returns
    -------
    (...) float
        Rounded.

    Examples
    --------
    >>> rows = OutputRows(0, np.ones(2, bool), np.zeros(2), np.ones(2), np.zeros((2, 0)), False)
    >>> given = np.array([3.0, -4.0])
    >>> [float(dual_norm(rows._replace(norm=n), given)) for n in ("linf", "l2", "l1")]
    [7.0, 5.0, 4.0]
    """
    size = np.abs(filtered)
    if rows.norm == "linf":
        return np.asarray(size @ rows.bound, np.float64)
    scaled = size * rows.bound
    if rows.norm == "l2":
        return np.asarray(np.sqrt(np.sum(scaled * scaled, axis=-1)) + _TINY, np.float64)
    return np.asarray(scaled.max(axis=-1, initial=0.0), np.float64)


def multiplied_readings(
    rows: OutputRows, multipliers: Reals, corrections: Reals
) -> tuple[Reals, Reals, Reals, float]:
    """Multiply the readings by each multiplier.

    Parameters
    ----------
    rows : OutputRows
    multipliers : (m, N) float
    corrections : (m, N) float
        How far each may be from one that is orthogonal to the columns.

    Returns
    -------
    q : (m, n + 1) float
    lost : (m, n + 1) float
        What rounding and corrections can be in ``q @ a`` and in the noise, for each abs(a_i).
    shifted : (m, n + 1, N) float
        The multipliers i samples ahead.
    rounding : float
        Of sums over the record, relative to the sum of sizes.
    """
    n, length = rows.order, rows.y.size
    shifted = np.zeros((len(multipliers), n + 1, length))
    slack = np.zeros((len(multipliers), n + 1))
    readings = np.zeros((n + 1, length))
    for i in range(n + 1):
        shifted[:, i, : length - i] = multipliers[:, i:]
        readings[i, i:] = rows.y[: length - i]
        bounds = np.zeros(length)
        bounds[i:] = rows.bound[: length - i]
        slack[:, i] = corrections @ (np.abs(readings[i]) + bounds)
    rounding = (length + n + 32) * _UNIT * _MORE
    size = np.abs(multipliers) @ np.abs(readings).T + np.abs(shifted) @ rows.bound
    return multipliers @ readings.T, size * rounding + slack, shifted, rounding


def correction_bounds(
    rows: OutputRows, free: Integers, multipliers: Reals, aims: Reals | None = None
) -> Reals | None:
    """Bound how far multipliers are from ones with given products with the columns, (M, N).

    The correction c at the samples ``free`` solves known[free]' c = aim - known' lambda.

    Parameters
    ----------
    rows : OutputRows
    free : (c,) int
    multipliers : (M, N) float
    aims : (M, c) float, optional
        The products; zero when left out.

    Returns
    -------
    (M, N) float or None
        None where the samples do not determine a correction.
    """
    count, length = rows.known.shape[1], rows.y.size
    found = np.zeros(multipliers.shape)
    if not count:
        return found
    if free.shape != (count,) or free.min() < 0 or free.max() >= length:
        return None
    if np.unique(free).size < count or not np.all(rows.row[free]):
        return None
    inverse = _inverse(rows.known[free].T)
    if inverse is None:
        return None
    products = multipliers @ rows.known
    rest = np.abs(products if aims is None else products - aims)
    rest += (length + 8) * _UNIT * (np.abs(multipliers) @ np.abs(rows.known)) + 1e-290
    found[:, free] = (rest @ np.abs(inverse).T) * (1.0 + 1e-9)
    return found


def _inverse(matrix: Reals) -> Reals | None:
    """The inverse of a matrix of doubles, each entry rounded once.

    None where there is none, and where an entry is too large or too small.
    """
    size = len(matrix)
    unit = [[Fraction(int(i == k)) for k in range(size)] for i in range(size)]
    found = solve_matrix([[*map(Fraction, line)] for line in matrix.tolist()], unit)
    if found is None:
        return None
    entries = [value for line in found for value in line]
    if any(value and not _LEAST <= abs(value) <= _MOST for value in entries):
        return None
    return np.array([float(value) for value in entries]).reshape(size, size)
