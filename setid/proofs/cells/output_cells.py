"""Boxes for systems with a map behind a linear block, by cells of that block.

No row in measured signals bounds these parameters. But in a small cell of the coefficients
of G the signal z is known up to a small radius, so that y~_k = sum_m gamma_m z_k^m + eta_k
are rows in gamma alone: cells in which they contradict each other are cut off, in the
others they bound gamma. With a linear block behind the map the rows are linear in its
denominator and in products of its numerator with gamma, and hold noise of several samples:

    y~_k - eta_k = -sum_i a_i (y~_(k-i) - eta_(k-i)) + sum_jm b_j gamma_m z_(k-j)^m.

The numerator is only known up to a factor that gamma takes up. All ratios are covered by the
faces of a cube: one coordinate is 1, the others lie in [-1, 1]. The normalisation that was asked
for gives each cell its factor at the end.

Where the first samples of z are unknown, rows are combined that do not hold them
(``unknown_start.py``), and z is bounded at last by the square that a row holds of it. Then, in the
box that this leaves, the last of these samples become coordinates of cells as well: an impulse at
such a sample is one more input, and its coefficient is covered by the same cube.

Nothing here rests on a solver: every enclosure is computed with its rounding errors.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from math import inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import frozen
from setid.formulation.formulation import Formulation
from setid.proofs.cells.arithmetic import CellRows, Enclosed, Fitted, enclosed, fitted, rows_of
from setid.proofs.cells.cell_normalisation import converted, divided
from setid.proofs.cells.cell_signals import signal_bounds
from setid.proofs.cells.parts import (
    Column,
    Parts,
    can_start,
    parts_of,
    row_noise,
    with_impulses,
)
from setid.proofs.cells.unknown_start import depth, free_rows
from setid.proofs.fields import well_formed
from sparsepop_py.verified.arithmetic.array_checks import at_least
from sparsepop_py.verified.arithmetic.interval import Interval, down, up
from sparsepop_py.verified.uncertain_rows.box import Bounds

__all__ = ["CellBox", "cell_box", "drive_of"]

Reals = NDArray[np.float64]


_MOST = 200_000  # cells
_MOST_FREE = 40_000  # where rows share their noise, which takes more time
_AT_ONCE = 4000  # cells in memory
_AT_ONCE_FREE = 1000  # where rows share their noise
_MOST_LEFT = 20_000  # cells in which parameters behind the map are bounded
_ROUNDS = 60
_PRUNING = (12, 24, 40)  # samples that decide about cells, at first and once cells are fine
_FINE = 0.25  # of the noise bound: the effect of a cell that is not cut further


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CellBox(Bounds):
    """A box of theta and of the samples of an internal signal, by cells.

    Parameters
    ----------
    names, lower, upper
        As of :class:`sparsepop_py.verified.uncertain_rows.box.Bounds`.
    unknowns : (K,) int
        Numbers of the samples of the internal signal.
    low, high : (K,) float
        Their bounds.
    cells : int
        How many were left.
    rounds : int
        How often cells were halved.
    """

    unknowns: NDArray[np.int64]
    low: Reals
    high: Reals
    cells: int
    rounds: int

    @property
    def open(self) -> tuple[str, ...]:
        """Names of parameters that are not bounded on both sides."""
        found = np.isinf(self.lower) | np.isinf(self.upper)
        return tuple(np.array(self.names)[found & (self.lower <= self.upper)].tolist())

    def verify(self, formulation: Formulation, start: Reals) -> bool:
        """Compute it again from the data; there is no solver in it."""
        if not well_formed(self):
            return False
        claimed = bool(np.any(np.isfinite([self.low, self.high])))
        nothing = bool(np.all(self.low == -inf) and np.all(self.high == inf))
        if nothing and at_least(start[0], self.lower) and at_least(self.upper, start[1]):
            return True  # no more than what is given
        again = cell_box(formulation, start, rounds=max(self.rounds, 0), samples=claimed)
        return (
            again is not None
            and np.array_equal(again.unknowns, self.unknowns)
            and self.follow(again.lower, again.upper)
            and at_least(again.low, self.low)
            and at_least(self.high, again.high)
        )

    def _text(self) -> str:
        return f"{self.cells} cells, {Bounds._text(self)}"


def cell_box(
    formulation: Formulation,
    start: Reals,
    until: float = inf,
    rounds: int = _ROUNDS,
    samples: bool = True,
) -> CellBox | None:
    """Bound parameters by cells; None where the structure is no G and N in a row.

    Parameters
    ----------
    formulation : Formulation
    start : (2, p) float
        Bounds of priors; finite for the denominator (:class:`Stable` or :class:`Box`).
    until : float
        Reading of ``time.monotonic`` from which on no cell is halved, and samples of the internal
        signal are left without bounds.
    rounds : int
        Most halvings.
    samples : bool
        Whether samples of the internal signal are bounded.
    """
    parts = parts_of(formulation)
    if parts is None or parts.signal not in formulation.layout.groups:  # or the signal is known
        return None
    found = _covered(parts, formulation, start, until, rounds) if can_start(parts) else None
    if parts.initial:
        hull, used = (start, 0) if found is None else (found.hull, found.rounds)
        if np.all(hull[0] <= hull[1]) and _poles_apart(parts, formulation, hull):
            found = (
                _covered(with_impulses(parts), formulation, hull, until, rounds - used, used)
                or found
            )
    if found is None:
        return None
    numbers = formulation.layout.group(parts.signal)
    present = np.flatnonzero(numbers >= 0)
    signal = found.signal(formulation, until if samples else -inf)[:, present]
    return CellBox(
        formulation.parameters,
        frozen(found.hull[0]),
        frozen(found.hull[1]),
        numbers[present],
        frozen(signal[0]),
        frozen(signal[1]),
        len(found.cells),
        found.rounds,
    )


def _poles_apart(parts: Parts, formulation: Formulation, hull: Reals) -> bool:
    """Check that no pole may be at 0 or at 1.

    With a pole at 0 one row alone holds the first sample, and at 1 it is like an offset of the map.
    Near these no cell of first samples is ever refuted.
    """
    number = {name: i for i, name in enumerate(formulation.parameters)}
    ends = hull[:, [number[name] for name in parts.poles]]
    if not ends.size:
        return True
    apart = np.stack([ends[:, -1], 1.0 + ends.sum(axis=1)], axis=1)
    return bool(np.all((apart[0] > 0.0) | (apart[1] < 0.0)))


class _Covering(NamedTuple):
    """Cells that are left, and the box of theta in all of them."""

    parts: Parts
    cells: Reals
    fit: Fitted | None  # none where there are too many cells
    kept: NDArray[np.int64]  # of the cells, those that are not empty
    hull: Reals
    rounds: int

    def signal(self, formulation: Formulation, until: float) -> Reals:
        """Bounds (2, N) of the internal signal."""
        samples = formulation.data.samples
        if not self.kept.size:
            return np.array([np.full(samples, np.inf), np.full(samples, -np.inf)])
        if self.fit is None:
            return np.array([np.full(samples, -np.inf), np.full(samples, np.inf)])
        return signal_bounds(self.parts, formulation, self.cells, self.fit, self.kept, until)


def _covered(
    parts: Parts,
    formulation: Formulation,
    start: Reals,
    until: float,
    rounds: int,
    spent: int = 0,
) -> _Covering | None:
    """Cover the set by cells; None where the denominator has no box, or readings say nothing."""
    number = {name: i for i, name in enumerate(formulation.parameters)}
    poles = start[:, [number[name] for name in parts.poles]]
    if not np.all(np.isfinite(poles)):
        return None
    data = formulation.data
    noise = row_noise(formulation)
    known = ~np.isnan(data.y[:, 0])
    for lag in range(1, len(parts.past) + 1):
        known[lag:] &= ~np.isnan(data.y[:-lag, 0])
    known = _usable_rows(parts, known)
    if not np.any(np.abs(data.y[known, 0]) > noise[known]):
        return None  # nothing but noise: z may be zero
    cells = _first_cells(parts, poles)
    left, fit, used = _pruned(parts, formulation, cells, np.flatnonzero(known), until, rounds)
    hull, kept = converted(parts, formulation, start, left, fit)
    return _Covering(parts, left, fit, kept, hull, spent + used)


def _usable_rows(parts: Parts, known: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mark rows that hold known samples of z, or can be combined with those before them."""
    lags = [column.lag for column in parts.columns]
    if parts.begin is not None:
        known = known.copy()
        known[: max(parts.begin + max(lags), len(parts.past))] = False
    if not parts.initial:
        return known
    back = depth(lags)
    first = parts.initial - 1 + max(lags)  # rows before it hold samples of z that are not asked
    usable = np.zeros_like(known)
    usable[max(first, len(parts.past)) :] = known[max(first, len(parts.past)) :]
    found = usable.copy()
    for lag in range(1, back + 1):
        found[:lag] = False
        found[lag:] &= usable[:-lag]
    return found


# ---- cells --------------------------------------------------------------------------------


def _first_cells(parts: Parts, poles: Reals) -> Reals:
    """The faces of the cube times the box of the denominator, shape (C, 2, d)."""
    count = len(parts.drives)
    faces = []
    for face in range(count):
        ends = np.tile([[-1.0], [1.0]], count)
        ends[:, face] = 1.0
        faces.append(np.concatenate([poles, ends], axis=1))
    return np.array(faces)


def _measured(
    parts: Parts, formulation: Formulation, cells: Reals, rows: NDArray[Any]
) -> tuple[Enclosed, CellRows, Fitted]:
    """Enclose the signal in each cell, state its rows and fit them."""
    upto = int(rows[-1]) + 1
    drives, spread = parts.drives[:, :upto], parts.drive_noise[:, :upto]
    found = enclosed(cells, len(parts.poles), drives, spread)
    y, noise = formulation.data.y[:, 0], formulation.noise.bounds(formulation.data).output[:, 0]
    columns = tuple((column.lag, column.power) for column in parts.columns)
    if parts.initial:
        pole = Interval(cells[:, 0, :1], cells[:, 1, :1])
        signal = Interval(down(found.centre - found.radius), up(found.centre + found.radius))
        known = y[:upto], noise[:upto], row_noise(formulation)[:upto]
        drive = drive_of(cells[:, :, 1:], drives, spread)
        given = free_rows(pole, drive, signal, rows, columns, len(parts.past), *known)
        return found, given, fitted(given)
    lags = np.arange(1, len(parts.past) + 1)
    before = rows[:, None] - lags
    past = -np.where(before < 0, 0.0, y[before]), np.where(before < 0, 0.0, noise[before])
    given = rows_of(found, rows, columns, past, y[rows], row_noise(formulation)[rows])
    return found, given, fitted(given)


def _fitted(parts: Parts, formulation: Formulation, cells: Reals, rows: NDArray[Any]) -> Fitted:
    """Bound coefficients of the map and of a block behind it, in each cell."""
    found = [
        _own(parts, part, _measured(parts, formulation, part, rows)[2])
        for _, part in _portions(parts, cells)
    ]
    return Fitted(*(np.concatenate(each) for each in zip(*found, strict=True)))


def _own(parts: Parts, cells: Reals, fit: Fitted) -> Fitted:
    """Coefficients of the map, where columns of rows that are combined have 1 + a times theirs."""
    if not parts.initial:
        return fit
    below = np.stack([down(1.0 + cells[:, 0, 0]), up(1.0 + cells[:, 1, 0])], axis=1)
    gamma, radius = fit.gamma.copy(), fit.radius.copy()
    for m, column in enumerate(parts.columns, len(parts.past)):
        if column.power == 1:
            ends = np.stack([gamma[:, m] - radius[:, m], gamma[:, m] + radius[:, m]], axis=1)
            low, high = divided(ends, below).T
            some = np.isfinite(low) & np.isfinite(high)
            low, high = np.where(some, low, 0.0), np.where(some, high, 0.0)
            gamma[:, m] = np.where(some, 0.5 * low + 0.5 * high, gamma[:, m])
            reach = np.maximum(high - gamma[:, m], gamma[:, m] - low) * (1 + 1e-15)
            radius[:, m] = np.where(some, reach, np.inf)
    return Fitted(gamma, radius, fit.bounded, fit.empty)


def drive_of(numerator: Reals, drives: Reals, spread: Reals) -> Interval:
    """Enclose the drive of the block in each cell, (C, N).

    Parameters
    ----------
    numerator : (C, 2, q) float
        Ends of its coefficients.
    drives, spread : (q, N) float
        Samples, and how far noise may move them.
    """
    total = Interval.point(np.zeros((1, 1)))
    for i in range(drives.shape[0]):
        weight = Interval(numerator[:, 0, i, None], numerator[:, 1, i, None])
        sample = Interval(down(drives[i] - spread[i]), up(drives[i] + spread[i]))
        total = total + weight * Interval(sample.lo[None], sample.hi[None])
    return total


def _pruned(
    parts: Parts,
    formulation: Formulation,
    cells: Reals,
    known: NDArray[Any],
    until: float,
    rounds: int,
) -> tuple[Reals, Fitted | None, int]:
    """Prune cells; return those left, gamma in them, and the rounds used.

    Coarse cells say nothing of late samples, which would ask for finer ones: few come first.
    """
    fit, spent = None, 0
    for count in _PRUNING:
        rows = known[:count]
        left, used, whole = _halved(parts, formulation, cells, rows, until, rounds - spent)
        if fit is not None and not whole:
            break  # what fewer samples say is whole
        cells, spent = left, spent + used
        fit = None
        if 0 < len(left) <= _MOST_LEFT:
            fit = _fitted(parts, formulation, left, rows)
        if not len(left) or not whole or known.size <= count or spent == rounds:
            break
    return cells, fit, spent


def _halved(
    parts: Parts,
    formulation: Formulation,
    cells: Reals,
    rows: NDArray[Any],
    until: float,
    rounds: int,
) -> tuple[Reals, int, bool]:
    """Halve cells until they are fine; return those left and the rounds used."""
    done: list[Reals] = []
    for used in range(rounds + 1):
        cells = cells[_allowed(parts, formulation, cells)]
        if used == rounds or not len(cells) or time.monotonic() >= until:
            done.append(cells)
            whole = used == rounds or not len(cells)
            break
        judged = _judged(parts, formulation, cells, rows, until)
        if judged is None:  # time ended in this round, which is left out
            done.append(cells)
            whole = False
            break
        fine, rest, place = judged
        done.append(cells[fine])
        if 2 * rest.size + sum(map(len, done)) > (_MOST_FREE if parts.initial else _MOST):
            done.append(cells[rest])
            used, whole = used + 1, False  # this round is repeated when it is computed again
            break
        cells = _halves(cells[rest], place) if rest.size else cells[:0]
    return np.concatenate(done), used, whole


def _judged(
    parts: Parts, formulation: Formulation, cells: Reals, rows: NDArray[Any], until: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]] | None:
    """Find cells that are fine, and those to halve with the coordinate of each.

    The others are empty. None where time ends before all are judged.
    """
    fine, rest, place = [], [], []
    for begin, part in _portions(parts, cells):
        if time.monotonic() >= until:
            return None
        found, given, fit = _measured(parts, formulation, part, rows)
        noise, own = row_noise(formulation)[rows], slice(len(parts.past), None)
        size, radius = np.abs(fit.gamma[:, own]), fit.radius[:, own]
        effect = _effects(found, size, parts.columns, rows, noise)
        if parts.initial:
            worst = _looseness(given, size + radius)
        else:
            worst = _effects(found, size + radius, parts.columns, rows, noise).max(axis=1)
        good = ~fit.empty & fit.bounded & (worst <= _FINE)
        left = np.flatnonzero(~fit.empty & ~good)
        fine.append(begin + np.flatnonzero(good))
        rest.append(begin + left)
        place.append(effect[left].argmax(axis=1))
    return np.concatenate(fine), np.concatenate(rest), np.concatenate(place)


def _portions(parts: Parts, cells: Reals) -> Iterator[tuple[int, Reals]]:
    """Cells in portions that fit into memory, each with the number of its first."""
    size = _AT_ONCE_FREE if parts.initial else _AT_ONCE
    for begin in range(0, len(cells), size):
        yield begin, cells[begin : begin + size]


def _effects(
    found: Enclosed, gamma: Reals, columns: tuple[Column, ...], rows: NDArray[Any], noise: Reals
) -> Reals:
    """Effect of each coordinate of a cell on outputs, in noise bounds, shape (C, d)."""
    z = np.abs(found.centre[:, rows]) + 1e-300
    with np.errstate(over="ignore", invalid="ignore"):
        slope = sum(
            gamma[:, m, None] * column.power * z ** max(column.power - 1, 0)
            for m, column in enumerate(columns)
        )
        scale = slope / np.maximum(noise, max(1e-8 * noise.max(), 1e-300))  # some may be exact
        effect = np.einsum("cdk,ck->cd", found.slopes[:, :, rows], scale) / rows.size
    width = found.radii > 0
    return np.where(width, np.maximum(np.nan_to_num(effect, nan=1e300, posinf=1e300), 1e-300), -1.0)


def _looseness(given: CellRows, gamma: Reals) -> Reals:
    """Share of the noise of rows that is due to the width of a cell, (C,)."""
    own = slice(given.wide.shape[2] - gamma.shape[1], None)
    assert given.shape is not None and given.shared is not None
    usable = np.isfinite(given.noise)
    with np.errstate(over="ignore", invalid="ignore"):
        share = given.noise + np.einsum("ckm,cm->ck", given.wide[:, :, own], gamma)
        share = share / (np.abs(given.shape) @ given.shared[:, -1])
        share = np.nan_to_num(share, nan=1e300, posinf=1e300)
    total = np.where(usable, share, 0.0).sum(axis=1)
    return np.asarray(total / np.maximum(usable.sum(axis=1), 1), np.float64)


def _halves(cells: Reals, place: NDArray[Any]) -> Reals:
    every = np.arange(len(cells))
    middle = cells[every, :, place].mean(axis=1)
    left, right = cells.copy(), cells.copy()
    left[every, 1, place], right[every, 0, place] = middle, middle
    return np.concatenate([left, right])


def _allowed(parts: Parts, formulation: Formulation, cells: Reals) -> NDArray[np.bool_]:
    """Cells in which the linear rows of priors on the denominator can hold."""
    number = {name: i for i, name in enumerate(formulation.parameters)}
    place = {number[name]: i for i, name in enumerate(parts.poles)}
    good = np.ones(len(cells), bool)
    for row, origin in zip(formulation.problem.constraints, formulation.rows.origin, strict=True):
        p = row.polynomial
        if origin != "prior" or p.degree > 1 or not set(p.support.tolist()) <= set(place):
            continue
        most, size = np.zeros(len(cells)), np.zeros(len(cells))
        for letter, value in zip(p.words.max(axis=1).tolist(), p.coefficients, strict=True):
            ends = np.ones((len(cells), 2)) if not letter else cells[:, :, place[letter - 1]]
            most = most + np.maximum(value * ends[:, 0], value * ends[:, 1])
            size = size + np.abs(value * ends).max(axis=1)
        good &= most >= -1e-9 - 1e-14 * size
    return good
