"""The least output noise for one denominator: a convex program in few unknowns.

Its outputs without noise are Z x, with the numerator and the first samples as x. The least noise is
the least norm over x of (y - Z x) / w, with the noise bounds w: the largest, the sum, or the
Euclidean one. The dual solution d gives the multiplier lambda of the rows,

    sum_i a_i lambda(k + i)  =  d(k) / w(k),

which is orthogonal to the columns of the numerator.
"""

from __future__ import annotations

import numpy as np
import scipy
import scipy.sparse as sps
from numpy.typing import NDArray
from scipy.linalg import qr

from setid.feasible_points.fits.exchanges import Approximation, approximated
from setid.proofs.denominators.output_rows import OutputRows
from sparsepop_py.lp.highs import LinearModel

__all__ = [
    "Programs",
    "grows",
    "longest_stretches",
    "programs_for_growth",
    "programs_of",
    "shifted",
]

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]
_STRETCHES = 20  # each has n states of its own
_FLOOR = 1e-9  # of the largest noise bound: bounds of 0 are replaced by it
_GROWTH = 1e3  # of a mode over the record
_DEPENDENT = 1e-10  # of the largest column: what others leave of one that depends on them


def longest_stretches(row: NDArray[np.bool_], order: int) -> Integers:
    """Number the rows of the longest stretches without a gap, which share no reading.

    Parameters
    ----------
    row : (N,) bool
    order : int
        Stretches less than this apart share readings: the longer one counts.

    Examples
    --------
    >>> longest_stretches(np.array([True, False, True, True, True, False, False, True]), 2)
    array([2, 3, 4, 7])
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], row, [False]]).astype(np.int8)))
    found: list[tuple[int, int]] = []
    for begin, end in sorted(edges.reshape(-1, 2).tolist(), key=lambda pair: pair[0] - pair[1]):
        if len(found) == _STRETCHES:
            break
        if all(begin - other[1] >= order or other[0] - end >= order for other in found):
            found.append((begin, end))
    return np.concatenate([np.zeros(0, np.int64), *(np.arange(*pair) for pair in sorted(found))])


class Programs:
    """Least noise for one denominator after the other, on stretches of rows.

    Where there is no noise, as before a record at rest, a very small one takes its place. The
    samples of the stretches follow one another. So n rows between two of them mean nothing: their
    multipliers are zero.

    Parameters
    ----------
    rows : OutputRows
    section : (r,) int
        Rows, in increasing order; at least n lie between two stretches of them.

    Attributes
    ----------
    samples : (S,) int
        Numbers of the samples that these rows read.
    silent : (S - n - r,) int
        Rows among the S - n that mean nothing.
    free : (c,) int or None
        Rows whose multipliers make others orthogonal to the numerator's columns; None where these
        depend on each other, and nothing is claimed.
    basis : (S - n, c) float
        Orthonormal columns of the numerator, zero in silent rows.
    """

    def __init__(self, rows: OutputRows, section: Integers) -> None:
        n = rows.order
        self.order, self.section = n, section
        pieces = np.split(section, np.flatnonzero(np.diff(section) > 1) + 1)
        self.samples = np.concatenate([np.arange(p[0] - n, p[-1] + 1) for p in pieces])
        begins = np.cumsum([0, *(p.size + n for p in pieces[:-1])]).tolist()
        self._stretches = [slice(k, k + p.size) for k, p in zip(begins, pieces, strict=True)]
        self._heard = np.concatenate([np.arange(part.start, part.stop) for part in self._stretches])
        self.y = rows.y[self.samples]
        self.silent = np.setdiff1d(np.arange(self.y.size - n), self._heard)
        bound = rows.bound[self.samples]
        most = float(bound.max())
        self.bound = np.maximum(bound, _FLOOR * most)
        # linear programs of the sum of errors have units of their own where there is no noise
        exact = (bound <= _FLOOR * most) & (rows.norm == "l1")
        self._units = np.where(exact, most, self.bound)
        self.known = _independent(rows.known[section])
        self.length, self.norm = rows.y.size, rows.norm
        complete = self.known.shape[1] == rows.known.shape[1]
        self.free = self._free() if complete else None
        self.basis = np.zeros((self.y.size - n, self.known.shape[1]))
        self.basis[self._heard] = np.linalg.qr(self.known)[0]

    def basis_without(self, gain: int | None) -> Reals:
        """Build orthonormal columns (S - n, c - 1) without a gain's; all for None.

        Parameters
        ----------
        gain : int or None
        """
        if gain is None:
            return self.basis
        others = np.delete(self.known, gain, axis=1)
        found = np.zeros((self.y.size - self.order, others.shape[1]))
        found[self._heard] = np.linalg.qr(others)[0]
        return found

    def column(self, gain: int) -> Reals:
        """Take the known column of a gain at the samples (S,) that rows give.

        Parameters
        ----------
        gain : int
        """
        found = np.zeros(self.y.size)
        found[self.order :][self._heard] = self.known[:, gain]
        return found

    def _free(self) -> Integers:
        order = qr(self.known.T, mode="r", pivoting=True)[1]
        return np.sort(self.section[order[: self.known.shape[1]]])

    def solve(self, a: Reals, reference: Integers | None) -> tuple[float, Reals, Integers] | None:
        """Compute the noise needed, and the multiplier (N,); None where it cannot be computed."""
        basis = self.orthonormal(a)
        if basis is None:
            return None
        target = self.y / self._units
        with np.errstate(all="ignore"):
            found = self._approximated(basis, target, reference)
        if found is None:
            return None
        multiplier = self.multiplier(a, found.reference, found.shares)
        if multiplier is None:
            return None
        return found.level, self.whole(multiplier), found.reference

    def fitted(self, a: Reals) -> Reals | None:
        """Fit outputs (S,) of least error for one denominator; None where there are none.

        Parameters
        ----------
        a : (n + 1,) float
        """
        basis = self.orthonormal(a)
        if basis is None:
            return None
        with np.errstate(all="ignore"):
            found = self._approximated(basis, self.y / self._units, None)
        return None if found is None else self._units * (basis @ found.coefficients)

    def whole(self, multiplier: Reals) -> Reals:
        """Place a multiplier (S - n,) of these rows in those of the record, (N,)."""
        found = np.zeros(self.length)
        found[self.section] = multiplier[self._heard]
        return found

    def part(self, multiplier: Reals) -> Reals:
        """Take a multiplier (N,) of the rows of the record to these, (S - n,)."""
        found = np.zeros(self.y.size - self.order)
        found[self._heard] = multiplier[self.section]
        return found

    def _approximated(
        self, basis: Reals, target: Reals, reference: Integers | None
    ) -> Approximation | None:
        """The least error of a target, and the dual solution at the samples that it uses."""
        if self.norm == "linf":
            return approximated(basis, target, reference)
        every = np.arange(target.size)
        if self.norm == "l2":
            values: Reals = basis.T @ target
            rest = target - basis @ values
            level = float(np.linalg.norm(rest))
            return Approximation(level, rest / level, every, values) if level > 0.0 else None
        most, count = self._units / self.bound, basis.shape[1]
        model = LinearModel(
            sps.csr_array(basis.T), (np.zeros(count), np.zeros(count)), (-most, most)
        )
        found = model.solve(-target)
        if found.status != "solved":
            return None
        inside = np.abs(found.x) < most  # where the errors are zero
        solved = np.linalg.lstsq(basis[inside], target[inside], rcond=None)[0]
        return Approximation(-found.value, found.x, every, np.asarray(solved, np.float64))

    def orthonormal(self, a: Reals) -> Reals | None:
        """Build orthonormal outputs without noise, in noise bounds; None where they overflow."""
        with np.errstate(all="ignore"):
            outputs = self.outputs(a)
            if outputs is None:
                return None
            return np.asarray(np.linalg.qr(outputs / self._units[:, None])[0], np.float64)

    def multiplier(self, a: Reals, reference: Integers, shares: Reals) -> Reals | None:
        """Compute the multiplier (S - n,) of errors at samples; None where it overflows."""
        errors = np.zeros(self.y.size)
        np.add.at(errors, reference, shares)
        with np.errstate(all="ignore"):
            found = self.adjoint(a, errors / self._units)
            for _ in range(2):
                found = found - self.basis @ (self.basis.T @ found)
        return found if np.all(np.isfinite(found)) else None

    def outputs(self, a: Reals) -> Reals | None:
        """Compute noise-free outputs (S, c + n s) of columns and of each stretch's states."""
        n, count = self.order, self.known.shape[1]
        found, begin = np.zeros((self.y.size, count + n * len(self._stretches))), 0
        for number, part in enumerate(self._stretches):
            end = begin + part.stop - part.start
            own = self._stretch_outputs(a, self.known[begin:end])
            place, begin = slice(part.start, part.stop + n), end
            found[place, :count] = own[:, :count]
            found[place, count + number * n : count + (number + 1) * n] = own[:, count:]
        size = np.abs(found).max(axis=0, initial=0.0)
        if not np.all(np.isfinite(size)) or np.any(size == 0.0):
            return None
        return np.asarray(found / size, np.float64)

    def _stretch_outputs(self, a: Reals, known: Reals) -> Reals:
        """Outputs of one stretch, of each column and each first or last sample."""
        n, count = self.order, len(known) + self.order
        inside, outside = _factored(a)
        ahead, back = inside.size - 1, outside.size - 1
        columns = [
            _forward(inside, np.zeros(ahead), _backward(outside, np.zeros(back), column))
            for column in known.T
        ]
        for end in np.eye(back):
            columns.append(
                _forward(inside, np.zeros(ahead), _backward(outside, end, np.zeros(count - n)))
            )
        for start in np.eye(ahead):
            columns.append(_forward(inside, start, np.zeros(count - ahead)))
        return np.array(columns).reshape(len(columns), count).T

    def adjoint(self, a: Reals, errors: Reals) -> Reals:
        """Solve sum_i a_i lambda(k + i) = errors(k), zero in silent rows, (S - n,)."""
        found = np.zeros(self.y.size - self.order)
        for part in self._stretches:
            found[part] = _adjoint(a, errors[part.start : part.stop + self.order])
        return found


def programs_of(rows: OutputRows) -> Programs | None:
    """State the programs of the longest stretches; None where these have too few rows or no noise.

    Parameters
    ----------
    rows : OutputRows
    """
    section = longest_stretches(rows.row, rows.order)
    if section.size <= rows.order + rows.known.shape[1] + 1 or not np.any(rows.bound > 0):
        return None
    return Programs(rows, section)


def programs_for_growth(rows: OutputRows, programs: Programs) -> Programs:
    """State the programs of denominators with a growing mode: without the first rows at rest.

    What such a mode does depends on the first samples, so that the least noise is not continuous
    in the denominator.

    Parameters
    ----------
    rows : OutputRows
    programs : Programs
        Of these rows; returned where none of them rests on zeros before a record.
    """
    begun = rows.begun
    if np.array_equal(begun, rows.row):
        return programs
    return programs_of(rows._replace(row=begun)) or programs


def grows(a: Reals, samples: int) -> bool:
    """Check that a mode of a denominator (n + 1,) grows much over a record.

    Parameters
    ----------
    a : (n + 1,) float
    samples : int

    Examples
    --------
    >>> grows(np.array([1.0, -1.1]), 100), grows(np.array([1.0, -1.001]), 100)
    (True, False)
    """
    largest = np.abs(np.roots(a)).max(initial=0.0)
    return bool(a[0] == 0.0 or largest > _GROWTH ** (1.0 / samples))


def _adjoint(a: Reals, errors: Reals) -> Reals:
    """Multipliers (S - n,) of one stretch with sum_i a_i lambda(k + i) = errors(k)."""
    inside, outside = _factored(a)
    ahead, back = inside.size - 1, outside.size - 1
    inner = _response(inside, errors[::-1])[::-1][ahead:]
    if not back:
        return np.asarray(inner / outside[0], np.float64)
    turned = outside[::-1] / outside[-1]
    return np.asarray(
        _response(turned, inner / outside[-1])[: errors.size - (a.size - 1)], np.float64
    )


def _independent(columns: Reals) -> Reals:
    """Columns without those that depend on others."""
    triangle, order = qr(columns, mode="r", pivoting=True)
    size = np.abs(np.diag(triangle))
    rank = int(np.sum(size > _DEPENDENT * size.max(initial=0.0)))
    return columns if rank == columns.shape[1] else columns[:, np.sort(order[:rank])]


def _factored(a: Reals) -> tuple[Reals, Reals]:
    """Factors of a polynomial with the zeros in the unit disc, monic, and with the others."""
    begin = int(np.flatnonzero(a)[0])
    roots = np.roots(a)
    within = np.abs(roots) <= 1.0
    inside = np.real(np.poly(roots[within])) if np.any(within) else np.ones(1)
    outside = np.real(np.poly(roots[~within])) if np.any(~within) else np.ones(1)
    outside = np.concatenate([np.zeros(begin), np.atleast_1d(outside)]) * a[begin]
    return np.atleast_1d(inside), outside


def _response(factor: Reals, drive: Reals) -> Reals:
    """Filter a signal by one over a polynomial; ``scipy.signal`` is loaded here, when asked."""
    return np.asarray(scipy.signal.lfilter([1.0], factor, drive), np.float64)


def _forward(factor: Reals, start: Reals, drive: Reals) -> Reals:
    return _response(factor, np.concatenate([start, drive]))


def _backward(factor: Reals, end: Reals, drive: Reals) -> Reals:
    """Solve for a signal backwards in time, from its last samples."""
    if factor.size == 1:
        return drive / factor[0]
    turned = factor[::-1] / factor[-1]
    return np.asarray(
        _response(turned, np.concatenate([end, drive[::-1] / factor[-1]]))[::-1], np.float64
    )


def shifted(multiplier: Reals, order: int) -> Reals:
    """Move a multiplier (N,) ahead by 0, ..., n samples, (n + 1, N).

    Times a denominator (n + 1,) from the left it is filtered; times the outputs (N,) it gives what
    it makes of the readings, for each coefficient.

    Parameters
    ----------
    multiplier : (N,) float
    order : int

    Examples
    --------
    >>> shifted(np.array([1.0, 2.0, 3.0]), 1)
    array([[1., 2., 3.],
           [2., 3., 0.]])
    """
    found = np.zeros((order + 1, multiplier.size))
    for i in range(order + 1):
        found[i, : multiplier.size - i] = multiplier[i:]
    return found
