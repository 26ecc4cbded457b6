"""Parameters bounded with some of the priors alone.

A prior only leaves out parameters: what is proved without it holds with it. So an identification of
the same record and structure, in which nothing is given beside what is given here, bounds these
parameters too.
"""

from __future__ import annotations

from typing import Any

from ..arithmetic.polynomial import INF
from ..result import NotProved
from .box import Ends, met, no_point


def bounded_with_fewer(inner: Any, about: Any, box: Ends) -> Ends:
    """Shrink a box by an identification in which less is given."""
    shown = [found.structure and found.structure.shown for found in (about, inner)]
    if shown[0] != shown[1] or (inner.told, inner.names) != (about.told, about.names):
        raise NotProved("fewer_priors: rows of another structure")
    inner.check()
    about.taken += inner.taken
    about.stable |= inner.stable
    check_given(about, inner, "fewer_priors")
    return no_point(len(about.names)) if inner.empty else met(box, *outer_ends(inner))


def outer_ends(inner: Any) -> Ends:
    """Read the intervals that an identification proves."""
    pairs = [stated.outer for stated in inner.got.intervals]
    return [[low for low, _ in pairs], [high for _, high in pairs]]


def check_given(about: Any, inner: Any, field: str, free: list[str] | None = None) -> None:
    """Check that what is given inside is given around it, and nothing of free parameters."""
    for v, name in enumerate(about.names):
        low, high = (-INF, INF) if name in (free or ()) else (side[v] for side in about.given)
        if inner.given[0][v] > low or inner.given[1][v] < high:
            raise NotProved(f"{field}: {name} is bounded more than is given")
    rows, groups = (about.asked, inner.asked), {"slack"}
    if inner.structure is None:  # no row is built here, and no bound of an unknown is looked at
        rows = about.every_row(), inner.every_row()
        groups = {group for group, _, _ in inner.record.letters} - {"theta"}
    if not rows[1] <= rows[0]:
        raise NotProved(f"{field}: a row that is not given")
    known = about.bounds_of(*groups)
    for name, (low, high) in inner.bounds_of(*groups).items():
        a, b = known.get(name, (-INF, INF))
        if low > a or high < b:
            raise NotProved(f"{field}: {name} is bounded more than is given")
