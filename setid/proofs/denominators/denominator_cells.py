"""No parameters are consistent with a record of noisy outputs: a proof by cells of denominators.

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
denominators has no consistent member if g > 0 at each of the vectors that span it. Cones are parted
at an edge. The first ones are spanned by the coefficients of (1 - q)^j (1 + q)^(n - j) with all
signs, a basis. A polynomial whose zeros lie in the closed unit disc is, up to its sign, a
combination of these with coefficients >= 0: the bilinear transformation makes them the coefficients
of a Hurwitz polynomial (A. T. Fam, J. S. Meditch, *IEEE Trans. Automatic Control* 23 (1978)
454-458).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from math import gcd
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import frozen
from setid.formulation.formulation import Formulation
from setid.formulation.lifting import lift
from setid.models.equations import Equation, Structure, Term, channel_of
from setid.models.lti import TransferFunction

__all__ = [
    "Cell",
    "Cone",
    "DenominatorCells",
    "OutputRows",
    "VaryingLeaf",
    "doubts",
    "first_cones",
    "is_ordinary",
    "is_refuted",
    "let_through",
    "moments",
    "output_rows",
    "parted_cone",
]

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]
Cone = NDArray[np.object_]  # rows of Python's integers
_UNIT = 2.0**-53
_MORE = 1.0 + 1e-12  # more than the rounding of sums of positive numbers
_LARGEST = 2**400  # of vectors: their doubles are finite
_LEAST, _MOST = 2.0**-300, 2.0**300  # of other numbers: their products are normal
_TINY = 1e-140  # more than the root of squares that underflow


class OutputRows(NamedTuple):
    """Rows of one output of a record.

    Parameters
    ----------
    order : int
        The largest lag n of the output.
    row : (N,) bool
        Samples k with a row: all it asks for is in the record.
    y, bound : (N,) float
        Readings, 0 where there is none, and their noise bounds.
    known : (N, c) float
        Columns of the numerator, distinct and not zero; zero where there is no row.
    stable : bool
        Whether a prior has the zeros of the denominator in the closed unit disc.
    norm : {"linf", "l2", "l1"}
        In which the noise, each sample in parts of its bound, is at most 1.
    own : tuple of str
        The parameter that is the coefficient of each lag 1, ..., n; "" where it is none alone.
    gains : tuple of (str, int)
        For each known column the parameter that is its coefficient, times 1 or -1; "" as above.
    """

    order: int
    row: NDArray[np.bool_]
    y: Reals
    bound: Reals
    known: Reals
    stable: bool
    norm: Literal["linf", "l2", "l1"] = "linf"
    own: tuple[str, ...] = ()
    gains: tuple[tuple[str, int], ...] = ()


def output_rows(formulation: Formulation, output: int) -> OutputRows | None:
    """State the rows of an output; None where inputs or equations have errors.

    Parameters
    ----------
    formulation : Formulation
        Of a linear structure in discrete time with one denominator an output.
    output : int
        Channel, from 0.
    """
    model, data = formulation.model, formulation.data
    eta, xi, e = formulation.noise.bounds(data)
    equations = _equations(model)
    if not equations or np.any(xi > 0) or np.any(e[:, output] > 0) or np.any(np.isnan(data.u)):
        return None
    equation = equations[output]
    lags = _own_lags(equation)
    if lags is None:
        return None
    y = data.y[:, output]
    row = _complete(np.asarray(data.first), y, equation.lag, sorted(lags))
    names = tuple(name for lag in sorted(lags) for name in lags[lag])
    stable = _denominators(model, output) <= frozenset[tuple[str, ...]]().union(
        *(prior.stable(model) for prior in formulation.priors)
    )
    columns = dict[bytes, tuple[Reals, tuple[str, int]]]()
    for item in _others(equation):
        column = _column(data.u, item, row)
        shared = column.tobytes() in columns
        if np.any(column):
            columns[column.tobytes()] = column, ("", 1) if shared else _gain(item)
    known = np.array([column for column, _ in columns.values()]).reshape(len(columns), y.size).T
    order = max(lags, default=0)
    return OutputRows(
        order,
        row,
        np.where(np.isnan(y), 0.0, y),
        eta[:, output],
        known,
        stable and len(names) == order > 0,
        own=tuple(_alone(lags.get(lag, ())) for lag in range(1, order + 1)),
        gains=tuple(gain for _, gain in columns.values()),
    )


def _equations(model: Structure) -> tuple[Equation, ...]:
    """Equations of all outputs that are linear in parameters, or in sums of their products.

    Several denominators are multiplied out, which follows from every form of the structure once
    all delayed samples are in the record.
    """
    if not isinstance(model, TransferFunction):
        return ()
    return tuple(model.regression()) or lift(model.multiplied()).equations


def _denominators(model: Structure, output: int) -> frozenset[tuple[str, ...]]:
    """Denominators whose product is that of the rows."""
    assert isinstance(model, TransferFunction)
    return frozenset(model.denominators(output))


def _alone(parameters: tuple[str, ...]) -> str:
    return parameters[0] if len(parameters) == 1 else ""


def _gain(item: Term) -> tuple[str, int]:
    """The parameter of a term on the right of the rows, and its sign there."""
    alone = len(item.parameters) == 1 and abs(item.coefficient) == 1.0
    return (item.parameters[0], -int(item.coefficient)) if alone else ("", 1)


def _own_lags(equation: Equation) -> dict[int, tuple[str, ...]] | None:
    """Parameters of the output by its lag; None where a term is of another kind."""
    found: dict[int, tuple[str, ...]] = {0: ()}
    for item in equation.terms[1:]:
        channels = [channel_of(lagged.signal) for lagged in item.signals]
        if [c for c in channels if c is None] or len(channels) > 1:
            return None
        if item.signals and item.signals[0].signal == equation.defines:
            lag = item.signals[0].lag
            if lag in found:
                return None
            found[lag] = item.parameters if item.coefficient == 1.0 else ("", *item.parameters)
        elif any(channel is not None and channel[0] == "y" for channel in channels):
            return None
    return found


def _others(equation: Equation) -> list[Term]:
    """Terms of the numerator, and of a constant."""
    own = equation.defines
    return [t for t in equation.terms[1:] if not t.signals or t.signals[0].signal != own]


def _complete(first: Integers, y: Reals, lag: int, lags: list[int]) -> NDArray[np.bool_]:
    """Samples with a row whose readings are all there."""
    at = np.arange(y.size)
    row = at - first >= lag
    for back in lags:
        row &= ~np.isnan(y[np.maximum(at - back, 0)])
    return row


def _column(u: Reals, item: Term, row: NDArray[np.bool_]) -> Reals:
    """The known factor of a term in each row."""
    if not item.signals:
        return np.where(row, 1.0, 0.0)
    lagged = item.signals[0]
    channel = channel_of(lagged.signal)
    assert channel is not None
    at = np.arange(u.shape[0])
    return np.where(row, u[np.maximum(at - lagged.lag, 0), channel[1]], 0.0)


# ---- cones --------------------------------------------------------------------------------


def first_cones(order: int, stable: bool) -> list[Cone]:
    """List vectors (n + 1, n + 1) that span the first cones, one a row.

    Parameters
    ----------
    order : int
    stable : bool
        The zeros lie in the closed unit disc; otherwise the cones and their negatives are all
        of space.

    Examples
    --------
    >>> first_cones(1, True)[0].tolist()
    [[1, 1], [1, -1]]
    """
    basis = []
    for j in range(order + 1):
        factors = [np.array([1, -1])] * j + [np.array([1, 1])] * (order - j)
        vector = np.ones(1, np.int64)
        for factor in factors:
            vector = np.convolve(vector, factor)
        basis.append(vector.tolist())
    signs = [(1,) * order] if stable else list(product((1, -1), repeat=order))
    return [
        np.array([[1], *([s] for s in more)], object) * np.array(basis, object) for more in signs
    ]


def parted_cone(
    cone: Cone, edge: tuple[int, int], weights: tuple[int, int]
) -> tuple[Cone, Cone] | None:
    """Part a cone at a vector on an edge; None where it is no such vector.

    Parameters
    ----------
    cone : (n + 1, n + 1) int
    edge : (int, int)
        Numbers of two of its vectors.
    weights : (int, int)
        Positive: the new vector is a multiple of their sum with these weights.
    """
    (i, j), (one, two) = edge, weights
    if not (0 <= i < len(cone) and 0 <= j < len(cone) and i != j and min(weights) > 0):
        return None
    made = [one * a + two * b for a, b in zip(cone[i], cone[j], strict=True)]
    divisor = gcd(*made) or 1
    made = [value // divisor for value in made]
    if max(map(abs, made)) > _LARGEST:
        return None
    below, above = cone.copy(), cone.copy()
    below[i] = above[j] = made
    return below, above


# ---- the claim ----------------------------------------------------------------------------


class Cell(NamedTuple):
    """A cone that is parted, or a leaf with the multipliers that refute it.

    Parameters
    ----------
    children : tuple of int
        Numbers of its parts, larger than its own; none for a leaf.
    edge, weights : (int, int)
        As of :func:`parted_cone`.
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
class DenominatorCells:
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
        """Number of cells that are not parted."""
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
        left = self.left(rows)
        return left is not None and next(left, None) is None

    def left(self, rows: OutputRows) -> Iterator[int] | None:
        """Number the leaves that are not refuted; None where multipliers or cells are malformed.

        Parameters
        ----------
        rows : OutputRows
        """
        table, n = self.multipliers, rows.y.size
        if table.ndim != 2 or table.shape[1] != n or np.any(table[:, ~rows.row]):
            return None
        if not all(map(is_ordinary, (table, rows.y, rows.bound, rows.known))):
            return None
        doubt, cones = doubts(rows, self.free, table), self.cones(rows)
        if doubt is None or cones is None:
            return None
        leaves = (number for number in sorted(cones) if not self.parts(number))
        return (n for n in leaves if not self._refutes(rows, doubt, cones[n], self.cells[n]))

    def parts(self, number: int) -> tuple[int, ...]:
        """Number the parts of a cell; none for a leaf."""
        cell = self.cells[number]
        return () if isinstance(cell, VaryingLeaf) else cell.children

    def cones(self, rows: OutputRows) -> dict[int, Cone] | None:
        """Find the cone of each cell by its number; None where cells are malformed.

        Parameters
        ----------
        rows : OutputRows
        """
        if not rows.stable and rows.order >= len(self.cells).bit_length():
            return None  # fewer cells than first cones, whose number grows as 2^n
        waiting = list(enumerate(first_cones(rows.order, rows.stable)))
        found = dict[int, Cone]()
        while waiting:
            number, cone = waiting.pop()
            if number in found or not 0 <= number < len(self.cells):
                return None
            found[number], cell = cone, self.cells[number]
            if isinstance(cell, VaryingLeaf) or not cell.children:
                continue
            parts = parted_cone(cone, cell.edge, cell.weights)
            if parts is None or len(cell.children) != 2 or min(cell.children) <= number:
                return None
            waiting += zip(cell.children, parts, strict=True)
        return found

    def _refutes(
        self, rows: OutputRows, doubt: Reals, cone: Cone, cell: Cell | VaryingLeaf
    ) -> bool:
        if isinstance(cell, VaryingLeaf):
            return False
        used = np.array(cell.used, np.int64)
        if len(cell.shares) != used.size or not used.size:
            return False
        if used.min() < 0 or used.max() >= len(self.multipliers):
            return False
        return is_refuted(
            rows, self.multipliers[used], doubt[used], cone, np.array(cell.shares, np.float64)
        )


def is_refuted(
    rows: OutputRows, multipliers: Reals, doubts: Reals, cone: Cone, shares: Reals
) -> bool:
    """Check that g > 0 at the vectors that span a cone, rounding included.

    Parameters
    ----------
    rows : OutputRows
    multipliers : (m, N) float
    doubts : (m, N) float
        How far each may be from one that is orthogonal to the columns.
    cone : (K, n + 1) int
    shares : (m,) float
        Signed weights.
    """
    value, most = _sides(rows, multipliers, doubts, cone)
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


def _sides(rows: OutputRows, multipliers: Reals, doubts: Reals, cone: Cone) -> tuple[Reals, Reals]:
    """Values q a (m, K), and what the noise and rounding can be against them (m, K)."""
    vectors = cone.astype(np.float64)
    q, lost, shifted, rounding = moments(rows, multipliers, doubts)
    value = q @ vectors.T
    filtered = np.einsum("kv,mvn->mkn", vectors, shifted)
    noise = let_through(rows, filtered)
    return value, (noise + lost @ np.abs(vectors).T) * (1.0 + 4 * rounding) * _MORE


def let_through(rows: OutputRows, filtered: Reals) -> Reals:
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
    >>> [float(let_through(rows._replace(norm=n), given)) for n in ("linf", "l2", "l1")]
    [7.0, 5.0, 4.0]
    """
    size = np.abs(filtered)
    if rows.norm == "linf":
        return np.asarray(size @ rows.bound, np.float64)
    scaled = size * rows.bound
    if rows.norm == "l2":
        return np.asarray(np.sqrt(np.sum(scaled * scaled, axis=-1)) + _TINY, np.float64)
    return np.asarray(scaled.max(axis=-1, initial=0.0), np.float64)


def moments(
    rows: OutputRows, multipliers: Reals, doubts: Reals
) -> tuple[Reals, Reals, Reals, float]:
    """Multiply the readings by each multiplier.

    Parameters
    ----------
    rows : OutputRows
    multipliers : (m, N) float
    doubts : (m, N) float
        How far each may be from one that is orthogonal to the columns.

    Returns
    -------
    q : (m, n + 1) float
    lost : (m, n + 1) float
        What rounding and doubts can be in ``q @ a`` and in the noise, for each abs(a_i).
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
        slack[:, i] = doubts @ (np.abs(readings[i]) + bounds)
    rounding = (length + n + 32) * _UNIT * _MORE
    size = np.abs(multipliers) @ np.abs(readings).T + np.abs(shifted) @ rows.bound
    return multipliers @ readings.T, size * rounding + slack, shifted, rounding


def doubts(
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
    table = [
        [*map(Fraction, line), *(Fraction(int(i == k)) for k in range(size))]
        for i, line in enumerate(matrix.tolist())
    ]
    for column in range(size):
        pivot = next((i for i in range(column, size) if table[i][column]), None)
        if pivot is None:
            return None
        table[column], table[pivot] = table[pivot], table[column]
        first = table[column][column]
        table[column] = [value / first for value in table[column]]
        for i in range(size):
            factor = table[i][column]
            if i != column and factor:
                pairs = zip(table[i], table[column], strict=True)
                table[i] = [a - factor * b for a, b in pairs]
    entries = [value for line in table for value in line[size:]]
    if any(value and not _LEAST <= abs(value) <= _MOST for value in entries):
        return None
    return np.array([float(value) for value in entries]).reshape(size, size)
