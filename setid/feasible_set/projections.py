"""The feasible parameter set seen on two of its parameters.

The outline is an intersection of half planes c1 a1 + c2 a2 <= h with proved h, one for each
support direction. For equation errors the directions are those of the edges, and the
outline is the exact polygon.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

import sparsepop_py as sp
from setid.data.checks import frozen, natural, word
from setid.errors import SetidError
from setid.feasible_set.feasible_set import FeasibleSet, check_result
from setid.feasible_set.narrowing import solved_heights
from setid.feasible_set.supports import cover_of, supports
from setid.proofs.supports import Cover
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.lp.scaled import solve_scaled

if TYPE_CHECKING:
    from matplotlib.axes import Axes


__all__ = ["Projection", "project"]

Reals = NDArray[np.float64]
_MOST_VERTICES = 200
_FLAT = 1e-7  # share of the box by which a vertex must stand out


@dataclass(frozen=True, slots=True, eq=False)
class Projection(ReadOnly):
    """Outline of the feasible parameter set on two parameters.

    Parameters
    ----------
    names : (str, str)
    directions, heights : (K, 2), (K,) float
        Proved: every consistent pair x has ``directions @ x <= heights``.
    outline : (V, 2) float
        Corners of the polygon that these half planes bound, anticlockwise (rounded).
    attained : (M, 2) float
        Pairs of parameters of consistent vectors.
    exact : bool
        Whether the polygon is the projection itself, up to rounding; otherwise it is a
        cover of it.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> round(setid.project(result, "a1", "b0").area, 4)
    0.0199
    """

    names: tuple[str, str]
    directions: Reals
    heights: Reals
    outline: Reals
    attained: Reals
    exact: bool

    def __repr__(self) -> str:
        return f"<Projection: {' and '.join(self.names)}, {len(self.outline)} corners>"

    @property
    def area(self) -> float:
        """Area of the outline."""
        x, y = self.outline.T
        return float(0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw outline and attained points; returns the axes.

        Parameters
        ----------
        ax : matplotlib Axes, optional
        """
        from setid.plots.projections import plot_projection

        return plot_projection(self, ax)


def project(
    result: FeasibleSet,
    first: str,
    second: str,
    directions: int = 16,
    options: sp.Options | None = None,
) -> Projection:
    """Project the feasible parameter set on two parameters.

    Parameters
    ----------
    result : FeasibleSet
    first, second : str
        Names of parameters.
    directions : int
        Support directions, at least 4; for equation errors as many as there are edges.
    options : sparsepop_py.Options, optional
        For :func:`sparsepop_py.solve_each`, which is asked for all directions at once
        where the set is no polytope; order 1 and the time limit of ``result`` when left out.

    Returns
    -------
    Projection

    Raises
    ------
    SetidError
        If names are unknown or equal, the set is empty, or an interval is not finite.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> shadow = setid.project(result, "a1", "b0")
    >>> shadow.exact, len(shadow.outline)
    (True, 4)
    """
    check_result(result)
    names = result.formulation.parameters
    for name in (first, second):
        word(name, "name", names, SetidError)
    if first == second:
        raise SetidError(f"first, second: found {first!r} twice, expected two parameters")
    count = natural(directions, "directions", SetidError, least=4)
    cover = cover_of(result)
    pair = [names.index(first), names.index(second)]
    low, high = cover.lower[pair], cover.upper[pair]
    if not np.all(np.isfinite(low) & np.isfinite(high)):
        raise SetidError(
            f"result: found no finite interval of {first} or {second}, expected finite ones"
        )
    width = np.where(high > low, high - low, 1.0)
    points = result.attained[:, pair]
    exact = cover.exact and bool(np.all(np.isfinite(cover.lower) & np.isfinite(cover.upper)))
    corners = _corners(cover, pair, width) if exact else None
    if corners is not None:
        normals = _edge_normals(corners, width)
        heights = _heights(cover, pair, normals)
    else:
        angles = 2 * np.pi * np.arange(count) / count
        normals, exact = np.stack([np.cos(angles), np.sin(angles)], axis=1) / width, False
        heights = _heights(cover, pair, normals)
        better, more = _solved(result, pair, normals, options)
        heights, points = np.minimum(heights, better), np.concatenate([points, more])
    normals = np.concatenate([np.array([[1.0, 0], [-1, 0], [0, 1], [0, -1]]), normals])
    heights = np.concatenate([[high[0], -low[0], high[1], -low[1]], heights])
    outline = _outline(normals, heights, low, high)
    return Projection(
        (first, second), frozen(normals), frozen(heights), frozen(outline), frozen(points), exact
    )


def _heights(cover: Cover, pair: list[int], normals: Reals) -> Reals:
    full = np.zeros((len(normals), cover.lower.size))
    full[:, pair] = normals
    return supports(cover, full)[:, 1]


def _solved(
    result: FeasibleSet, pair: list[int], normals: Reals, options: sp.Options | None
) -> tuple[Reals, Reals]:
    """Prove heights by relaxations that all directions share; return attained pairs, too."""
    full = np.zeros((len(normals), len(result.formulation.parameters)))
    full[:, pair] = normals
    settings = options or sp.Options(order=1, time_limit=result.options.time_limit)
    heights, points = solved_heights(result, full, settings)
    return heights, points[:, pair]


# ---- polygons ---------------------------------------------------------------------------


def _corners(cover: Cover, pair: list[int], width: Reals) -> Reals | None:
    """Find the corners of a polytope's projection, anticlockwise, by looking past each edge.

    None where the polytope is as thin as rounding, so that a linear program finds no point of it.
    """
    sides = np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1]])
    found = [_farthest(cover, pair, side / width) for side in sides]
    corners = _distinct([corner for corner in found if corner is not None], width)
    if any(corner is None for corner in found):
        return None
    place = 0
    while place < len(corners) and len(corners) < _MOST_VERTICES:
        here, there = corners[place], corners[(place + 1) % len(corners)]
        along = (there - here) / width
        outward = np.array([along[1], -along[0]])
        size = float(np.hypot(*outward))
        if size <= _FLAT:
            place += 1
            continue
        normal = outward / size / width
        beyond = _farthest(cover, pair, normal)
        if beyond is None:
            return None
        if normal @ (beyond - here) > _FLAT:
            corners.insert(place + 1, beyond)
        else:
            place += 1
    return np.array(corners)


def _farthest(cover: Cover, pair: list[int], normal: Reals) -> Reals | None:
    """Find the point of a polytope that is farthest in a direction, on two parameters."""
    cost = np.zeros(cover.lower.size)
    cost[pair] = -normal * cover.spread[pair]
    below = sps.csr_array(cover.matrix * cover.spread), cover.right - cover.matrix @ cover.centre
    ones = np.ones(cover.lower.size)
    found = solve_scaled(cost, below, None, (-ones, ones))
    if found.status != "solved":
        return None
    return (cover.centre + cover.spread * found.x)[pair]


def _distinct(corners: list[Reals], width: Reals) -> list[Reals]:
    kept: list[Reals] = []
    for corner in corners:
        if all(np.abs((corner - other) / width).max() > _FLAT for other in kept):
            kept.append(corner)
    return kept


def _edge_normals(corners: Reals, width: Reals) -> Reals:
    """Compute outward normals of the edges of a polygon, scaled to the box."""
    if len(corners) < 2:
        return np.array([[1.0, 0.0]]) / width
    along = (np.roll(corners, -1, axis=0) - corners) / width
    return np.stack([along[:, 1], -along[:, 0]], axis=1) / width


def _outline(normals: Reals, heights: Reals, low: Reals, high: Reals) -> Reals:
    """Cut the box by half planes; return corners anticlockwise."""
    x = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    for normal, height in zip(normals, heights, strict=True):
        if not np.isfinite(height):
            continue
        over = x @ normal - height
        over[np.abs(over) <= 1e-12 * (np.abs(x) @ np.abs(normal) + abs(height))] = 0.0
        pieces = []
        for k in range(len(x)):
            a, b = over[k - 1], over[k]
            if a * b < 0:
                pieces.append(x[k - 1] + (x[k] - x[k - 1]) * (a / (a - b)))
            if b <= 0:
                pieces.append(x[k])
        if not pieces:
            return x[:1]
        x = np.array(pieces)
    return _tidy(x, np.where(high > low, high - low, 1.0))


def _tidy(x: Reals, width: Reals) -> Reals:
    """Keep the corners that stand out, anticlockwise."""
    try:
        hull = ConvexHull((x - x.mean(axis=0)) / width)
    except (QhullError, ValueError):
        return np.unique(x, axis=0)
    corners = np.array(_distinct(list(x[hull.vertices]), width))
    ahead = (np.roll(corners, -1, axis=0) - corners) / width
    behind = np.roll(ahead, 1, axis=0)
    turn = behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0]
    kept = turn > 1e-6 * np.hypot(*ahead.T) * np.hypot(*behind.T)
    return corners[kept] if kept.sum() >= 3 else corners
