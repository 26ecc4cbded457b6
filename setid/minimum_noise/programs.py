"""The least output noise for one denominator: a convex program in few unknowns."""

from __future__ import annotations

import numpy as np
import scipy
import scipy.sparse as sps
from numpy.typing import NDArray
from scipy.linalg import qr

from setid.proofs.least_noise.denominator_cells import OutputRows
from sparsepop_py.lp.highs import LinearModel

__all__ = ["Programs", "longest_stretch", "shifted"]

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]
_EXCHANGES = 120
_ALMOST = 1e-3  # of a level: where an exchange ends


def longest_stretch(row: NDArray[np.bool_]) -> Integers:
    """The longest stretch of rows without a gap."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], row, [False]]).astype(np.int8)))
    if not edges.size:
        return np.zeros(0, np.int64)
    begins, ends = edges[::2], edges[1::2]
    place = int(np.argmax(ends - begins))
    return np.arange(begins[place], ends[place])


class Programs:
    """Least noise for one denominator after the other, on a stretch of rows."""

    def __init__(self, rows: OutputRows, section: Integers) -> None:
        self.order, self.section = rows.order, section
        self.samples = slice(int(section[0]) - rows.order, int(section[-1]) + 1)
        self.y = rows.y[self.samples]
        bound = rows.bound[self.samples]
        self.bound = np.maximum(bound, 1e-9 * float(bound.max()))
        self.known = rows.known[section]
        self.length, self.norm = rows.y.size, rows.norm
        self.free = self._free()
        self.basis = np.linalg.qr(self.known)[0]

    def _free(self) -> Integers | None:
        count = self.known.shape[1]
        _, triangle, order = qr(self.known.T, mode="economic", pivoting=True)
        size = np.abs(np.diag(triangle))
        if count and (size.size < count or size[-1] <= 1e-10 * size[0]):
            return None
        return np.sort(self.section[order[:count]])

    def solve(self, a: Reals, reference: Integers | None) -> tuple[float, Reals, Integers] | None:
        """Noise that is needed, and the multiplier (N,); None where it cannot be computed."""
        basis = self.orthonormal(a)
        if basis is None:
            return None
        target = self.y / self.bound
        if reference is None:
            reference = np.linspace(0, target.size - 1, basis.shape[1] + 1).astype(np.int64)
        with np.errstate(all="ignore"):
            found = self._approximated(basis, target, reference)
        if found is None:
            return None
        level, shares, reference = found
        multiplier = self.multiplier(a, reference, shares)
        if multiplier is None:
            return None
        whole = np.zeros(self.length)
        whole[self.section] = multiplier
        return level, whole, reference

    def _approximated(
        self, basis: Reals, target: Reals, reference: Integers
    ) -> tuple[float, Reals, Integers] | None:
        """The least error of a target, and the dual solution at the samples that it uses."""
        if self.norm == "linf":
            return _exchanged(basis, target, reference)
        every = np.arange(target.size)
        if self.norm == "l2":
            rest = target - basis @ (basis.T @ target)
            level = float(np.linalg.norm(rest))
            return (level, rest / level, every) if level > 0.0 else None
        signs, count = np.ones(target.size), basis.shape[1]
        model = LinearModel(
            sps.csr_array(basis.T), (np.zeros(count), np.zeros(count)), (-signs, signs)
        )
        found = model.solve(-target)
        return (-found.value, found.x, every) if found.status == "solved" else None

    def orthonormal(self, a: Reals) -> Reals | None:
        """Orthonormal outputs without noise, in noise bounds; None where they overflow."""
        with np.errstate(all="ignore"):
            outputs = self.outputs(a)
            if outputs is None:
                return None
            return np.asarray(np.linalg.qr(outputs / self.bound[:, None])[0], np.float64)

    def multiplier(self, a: Reals, reference: Integers, shares: Reals) -> Reals | None:
        """The multiplier (S - n,) that lets errors in at samples; None where it overflows."""
        errors = np.zeros(self.y.size)
        np.add.at(errors, reference, shares)
        with np.errstate(all="ignore"):
            found = self.adjoint(a, errors / self.bound)
            for _ in range(2):
                found = found - self.basis @ (self.basis.T @ found)
        return found if np.all(np.isfinite(found)) else None

    def outputs(self, a: Reals) -> Reals | None:
        """Outputs without noise, (S, n + c): of each column and each first or last sample."""
        n, count = self.order, self.y.size
        inside, outside = _factored(a)
        ahead, back = inside.size - 1, outside.size - 1
        columns = [
            _forward(inside, np.zeros(ahead), _backward(outside, np.zeros(back), column))
            for column in self.known.T
        ]
        for end in np.eye(back):
            columns.append(
                _forward(inside, np.zeros(ahead), _backward(outside, end, np.zeros(count - n)))
            )
        for start in np.eye(ahead):
            columns.append(_forward(inside, start, np.zeros(count - ahead)))
        found = np.array(columns).reshape(len(columns), count).T
        size = np.abs(found).max(axis=0, initial=0.0)
        if not np.all(np.isfinite(size)) or np.any(size == 0.0):
            return None
        return np.asarray(found / size, np.float64)

    def adjoint(self, a: Reals, errors: Reals) -> Reals:
        """Multipliers (S - n,) with sum_i a_i lambda(k + i) = errors(k)."""
        inside, outside = _factored(a)
        ahead, back = inside.size - 1, outside.size - 1
        inner = _response(inside, errors[::-1])[::-1][ahead:]
        if not back:
            return np.asarray(inner / outside[0], np.float64)
        turned = outside[::-1] / outside[-1]
        return np.asarray(
            _response(turned, inner / outside[-1])[: self.y.size - self.order], np.float64
        )


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


def _exchanged(
    basis: Reals, target: Reals, reference: Integers
) -> tuple[float, Reals, Integers] | None:
    """Approximate a target in the largest error by single exchanges (E. Stiefel, 1960).

    Returns
    -------
    level : float
        The largest error that is left.
    shares : (c + 1,) float
        Dual solution at the reference, sizes of which sum up to 1.
    reference : (c + 1,) int
    """
    count, reference = basis.shape[1], reference.copy()
    weights = np.linalg.svd(basis[reference].T)[2][-1]
    signs = np.where(weights * np.sign(weights @ target[reference] or 1.0) >= 0, 1.0, -1.0)
    try:
        inverse = np.linalg.inv(_columns(basis, reference, signs))
        level = np.inf
        for step in range(_EXCHANGES):
            solved = (signs * target[reference]) @ inverse
            errors = target - basis @ solved[:count]
            worst = int(np.argmax(np.abs(errors)))
            level = abs(float(errors[worst]))
            if level <= solved[count] * (1.0 + _ALMOST) + 1e-14:
                break
            sign = 1.0 if errors[worst] > 0 else -1.0
            along = inverse @ np.append(sign * basis[worst], 1.0)
            usable = along > 1e-11
            if not np.any(usable):
                break
            ratios = np.where(usable, inverse[:, -1] / np.where(usable, along, 1.0), np.inf)
            place = int(np.argmin(ratios))
            reference[place], signs[place] = worst, sign
            row = inverse[place] / along[place]
            inverse = inverse - np.outer(along, row)
            inverse[place] = row
            if step % 30 == 29:
                inverse = np.linalg.inv(_columns(basis, reference, signs))
    except np.linalg.LinAlgError:
        return None
    return level, np.asarray(inverse[:, -1] * signs, np.float64), reference


def _columns(basis: Reals, reference: Integers, signs: Reals) -> Reals:
    return np.vstack([(basis[reference] * signs[:, None]).T, np.ones(reference.size)])


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
