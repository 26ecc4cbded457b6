"""Arcs on which regions of a frequency response are narrow: halved until they are."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from setid.feasible_set.proposer import Proposer
from setid.proofs.frequency.arc_regions import ArcRegions, arc_regions
from setid.proofs.frequency.arcs import Arc, Family, first_arcs, halves
from setid.proofs.supports import Cover

__all__ = ["refined_arcs"]

Reals = NDArray[np.float64]
_EXCESS = 1.1  # of the radius at the centre of an arc that the arc may have
_FLOOR = 2e-3  # of the nominal gain: smaller radii need not be told apart
_LEAST = 2e-5  # half width below which an arc is not halved, rad a sample
_HOPELESS = 1e-2  # the same where nothing is proved at the centre
_MOST = 3000  # arcs


def refined_arcs(
    cover: Cover, theta: Reals, families: tuple[Family, Family], until: float
) -> ArcRegions:
    """Regions on arcs that cover all frequencies.

    Parameters
    ----------
    cover : Cover
        A finite one.
    theta : (p,) float
        Nominal.
    families : (numerator, denominator)
    until : float
        Reading of ``time.monotonic`` after which no arc is halved.
    """
    source = Proposer(cover)

    def regions(arcs: Sequence[Arc]) -> ArcRegions:
        return arc_regions(cover, theta, families, arcs, lambda _: source)

    todo, done = first_arcs(), []
    count = 0
    while todo:
        found, points = regions(todo), regions([(centre, 0.0) for centre, _ in todo])
        count += len(todo)
        most = np.maximum(_EXCESS * points.radius, _FLOOR * np.abs(points.gain))
        hopeless = np.isinf(points.radius) & (found.half < _HOPELESS)
        kept = (found.radius <= most) & np.isfinite(found.radius) | hopeless
        kept |= found.half < _LEAST
        if time.monotonic() > until or count > _MOST:
            kept[:] = True
        done.append(_chosen(found, kept))
        todo = [half for arc, ok in zip(todo, kept, strict=True) if not ok for half in halves(arc)]
    names = [field.name for field in fields(ArcRegions)]
    joined = [np.concatenate([getattr(part, name) for part in done]) for name in names]
    order = np.argsort(joined[0])
    return ArcRegions(*(column[order] for column in joined))


def _chosen(found: ArcRegions, kept: NDArray[np.bool_]) -> ArcRegions:
    return ArcRegions(*(getattr(found, field.name)[kept] for field in fields(ArcRegions)))
