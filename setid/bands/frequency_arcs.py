"""Arcs on which regions of a frequency response are narrow: halved, and split into cells.

Everything here only guides: regions are proved by :mod:`setid.proofs.frequency.arc_regions`, cells
by :mod:`setid.proofs.cells.cells`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from math import inf

import numpy as np
from numpy.typing import NDArray

from setid.bands.branching import principal_frame, surveyed
from setid.data.checks import frozen
from setid.feasible_set.proposer import Proposer
from setid.proofs.cells.cells import Cells
from setid.proofs.frequency.arc_regions import ArcRegions, arc_regions
from setid.proofs.frequency.arcs import Arc, Family, first_arcs, halves
from setid.proofs.supports import Cover
from setid.proofs.time_bands.enclosures import Frame

__all__ = ["refined_arcs"]

Reals = NDArray[np.float64]
_EXCESS = 1.1  # of the radius at the centre of an arc that the arc may have
_FLOOR = 2e-3  # of the nominal gain: smaller radii need no further cells
_LEAST = 2e-5  # half width below which an arc is not halved, rad a sample
_HOPELESS = 1e-2  # the same where the region at the centre is wide itself
_MOST = 3000  # arcs
_WIDE = 2.0  # of the attained radius: wider regions are tried on cells
_LEVELS = 6  # of halving all cells


def refined_arcs(
    cover: Cover,
    theta: Reals,
    families: tuple[Family, Family],
    until: float,
    late: float = inf,
) -> ArcRegions:
    """Enclose responses on arcs that cover all frequencies.

    Parameters
    ----------
    cover : Cover
        A finite one.
    theta : (p,) float
        Nominal.
    families : (numerator, denominator)
    until : float
        Reading of ``time.monotonic`` after which no arc is halved and no cell is cut.
    late : float
        Reading after which first arcs are enclosed with the box alone.
    """
    columns = np.flatnonzero(np.any(families[1].weights != 0.0, axis=0))
    source = surveyed(cover, columns, late)
    search = _Search(cover, theta, families, until, source)
    whole = search.halved(first_arcs(), [(cover, source, theta)])
    if not columns.size:
        return whole
    open_ = search.wide(whole)
    done = [_chosen(whole, ~open_)]
    left = _chosen(whole, open_)
    width = np.maximum(cover.upper - cover.lower, 1e-300)
    frame = principal_frame(source.points, columns, width[columns])
    cells = Cells(cover, frame.directions(cover.lower.size), source)
    seeds = {0: _shifted(source, len(cover.right), columns.size)}
    for level in range(1, _LEVELS + 1):
        if not len(left.centre) or time.monotonic() > until:
            break
        seeds = _cut_all(cells, seeds)
        parts = search.parts(cells, frame, seeds)
        if not parts:
            break
        arcs = list(zip(left.centre.tolist(), left.half.tolist(), strict=True))
        left = search.halved(arcs, parts, last=level == _LEVELS)
        wide = search.wide(left)
        done.append(_chosen(left, ~wide))
        left = _chosen(left, wide)
    return _sorted([*done, left])


def _always(source: Proposer) -> Callable[[Cover], Proposer]:
    """Return a proposer for one cell, whose source of multipliers is known."""
    return lambda _: source


_Part = tuple[Cover, Proposer, Reals]  # a cell, its source of multipliers, and its centre


@dataclass(slots=True, eq=False)
class _Search:
    cover: Cover
    theta: Reals
    families: tuple[Family, Family]
    until: float
    source: Proposer
    points: list[Reals] = field(default_factory=list)

    def regions(self, arcs: Sequence[Arc], parts: Sequence[_Part]) -> ArcRegions:
        """Enclose responses on arcs, joined over cells."""
        found = [
            arc_regions(cover, theta, self.families, arcs, _always(source))
            for cover, source, theta in parts
        ]
        joined = found[0]
        for other in found[1:]:
            joined = joined.joined(other)
        return joined

    def halved(self, arcs: Sequence[Arc], parts: Sequence[_Part], last: bool = False) -> ArcRegions:
        """Halve arcs until their regions are near the regions at their centres.

        Arcs on which these are wide wait for smaller cells, except at the ``last`` level.
        """
        wide, done, count = list(arcs), list[ArcRegions](), 0
        while wide:
            found = self.regions(wide, parts)
            points = self.regions([(centre, 0.0) for centre, _ in wide], parts)
            count += len(wide)
            most = np.maximum(_EXCESS * points.radius, _FLOOR * np.abs(points.gain))
            poor = np.isinf(points.radius) if last else self.wide(points)
            hopeless = poor & (found.half < _HOPELESS)
            kept = ((found.radius <= most) & np.isfinite(found.radius)) | hopeless
            kept |= found.half < _LEAST
            if time.monotonic() > self.until or count > _MOST:
                kept[:] = True
            done.append(_chosen(found, kept))
            left = [arc for arc, ok in zip(wide, kept, strict=True) if not ok]
            wide = [half for arc in left for half in halves(arc)]
        return _sorted(done)

    def wide(self, found: ArcRegions) -> NDArray[np.bool_]:
        """Find regions much wider than what vertices attain at arc centres."""
        points = np.concatenate([self.source.points, *self.points])
        lags = np.arange(self.families[0].constants.size)
        turns = np.exp(-1j * found.centre[:, None] * lags)
        above, under = (
            turns @ (f.constants[:, None] + f.weights @ points.T) for f in self.families
        )
        with np.errstate(all="ignore"):
            spread = np.abs(above / under - (found.turn * found.gain)[:, None])
        attained = np.where(np.isfinite(spread), spread, 0.0).max(axis=1, initial=0.0)
        return ~(found.radius <= np.maximum(_WIDE * attained, _FLOOR * found.gain))

    def parts(
        self, cells: Cells, frame: Frame, seeds: dict[int, list[NDArray[np.int64]]]
    ) -> list[_Part]:
        """List cells not proved empty; they are tightened, their vertices remembered."""
        found = list[_Part]()
        for number in cells.numbers:
            source = Proposer(cells.polytope(number), seeds[number])
            if not cells.tighten(number, source):
                continue
            if source.contradictory:
                weights = source.contradiction()
                if weights is not None and cells.drop(number, weights):
                    continue
            low, high = cells.cell(number).box
            points = source.points
            theta = points.mean(axis=0) if len(points) else self.theta.copy()
            theta[frame.columns] = frame.back @ ((low + high) / 2)
            self.points.append(points)
            seeds[number] = list(source.bases)
            found.append((cells.polytope(number), source, theta))
        return found


def _cut_all(
    cells: Cells, seeds: dict[int, list[NDArray[np.int64]]]
) -> dict[int, list[NDArray[np.int64]]]:
    """Halve every cell along its widest coordinate; seeds of the parts are those of the cell."""
    found = {}
    for number in cells.numbers:
        low, high = cells.cell(number).box
        axis = int(np.argmax(high - low))
        for part in cells.cut(number, axis, float((low[axis] + high[axis]) / 2)):
            found[part] = seeds[number]
    return found


def _shifted(source: Proposer, m: int, q: int) -> list[NDArray[np.int64]]:
    """Renumber bases of a cover for its cells, which have 2 q rows more."""
    return [np.where(rows < m, rows, rows + 2 * q) for rows in source.bases]


def _chosen(found: ArcRegions, kept: NDArray[np.bool_]) -> ArcRegions:
    return ArcRegions(*(getattr(found, field.name)[kept] for field in fields(ArcRegions)))


def _sorted(parts: list[ArcRegions]) -> ArcRegions:
    names = [field.name for field in fields(ArcRegions)]
    joined = [np.concatenate([getattr(part, name) for part in parts]) for name in names]
    order = np.argsort(joined[0])
    return ArcRegions(*(frozen(column[order]) for column in joined))
