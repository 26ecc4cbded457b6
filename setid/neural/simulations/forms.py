"""Affine forms: enclosures of vectors that keep how their entries depend on each other.

A form is the set of all centre + generators e + s with |e_j| <= 1 and |s_i| <= radius_i. Linear
maps act on centre and generators, so that a contractive map shrinks the form although intervals
would grow; the radius collects what linearisation and rounding add. Every result is widened by
rounding errors bounded a priori: a sum of k products computed in any order is within
k 2^-52 sum |terms| of the truth (twice the constant of Higham, section 3.1, which also covers that
the bound itself is computed in floating point).

References
----------
J. Stolfi, L. H. de Figueiredo, Self-validated numerical methods and applications, IMPA 1997.
A. Girard, "Reachability of uncertain linear systems using zonotopes", HSCC 2005.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from setid.neural.arithmetic import Interval, down, enclose, linearise, up
from setid.neural.models.network import Network

__all__ = [
    "Form",
    "activation",
    "affine_map",
    "clip",
    "join",
    "network_output",
    "product",
    "reduce",
]

Reals = NDArray[np.float64]
_UNIT = 2.0**-52
_TINY = 1e-300


@dataclass(frozen=True, slots=True, eq=False)
class Form:
    """Set of vectors centre + generators e + s.

    Parameters
    ----------
    centre : (n,) float
    generators : (n, g) float
    radius : (n,) float
        Not negative.
    """

    centre: Reals
    generators: Reals
    radius: Reals

    @staticmethod
    def of_box(low: Reals, high: Reals) -> Form:
        """Make the form of a box; each entry of some width gets a generator."""
        centre = 0.5 * low + 0.5 * high
        reach = up(np.maximum(up(high - centre), up(centre - low)))
        open_ = high > low
        generators = np.diag(reach)[:, open_]
        centre = np.where(open_, centre, low)
        return Form(centre, generators, np.zeros(low.size))

    @staticmethod
    def of_point(values: Reals, generators: int) -> Form:
        """Make the form of one vector."""
        return Form(values, np.zeros((values.size, generators)), np.zeros(values.size))

    def range(self) -> Interval:
        """Compute the interval hull."""
        size = np.abs(self.generators).sum(axis=1)
        reach = (size + self.radius) * (1.0 + (self.generators.shape[1] + 4.0) * _UNIT) + _TINY
        with np.errstate(invalid="ignore", over="ignore"):
            low, high = down(self.centre - up(reach)), up(self.centre + up(reach))
        bad = ~(np.isfinite(low) & np.isfinite(high))
        return Interval(np.where(bad, -np.inf, low), np.where(bad, np.inf, high))

    def rows(self, part: slice) -> Form:
        """Take some entries."""
        return Form(self.centre[part], self.generators[part], self.radius[part])

    def promoted(self) -> Form:
        """Promote the radius to generators, so that linear maps keep it; same set."""
        own = np.flatnonzero(self.radius != 0)  # also a radius that is no number
        extra = np.zeros((self.radius.size, own.size))
        extra[own, np.arange(own.size)] = self.radius[own]
        return Form(self.centre, np.hstack([self.generators, extra]), np.zeros(self.radius.size))


def join(*parts: Form) -> Form:
    """Stack forms that share their generators; missing ones at the end are zero."""
    most = max(p.generators.shape[1] for p in parts)
    padded = [np.pad(p.generators, ((0, 0), (0, most - p.generators.shape[1]))) for p in parts]
    return Form(
        np.concatenate([p.centre for p in parts]),
        np.vstack(padded),
        np.concatenate([p.radius for p in parts]),
    )


def affine_map(weight: Reals, bias: Reals, x: Form) -> Form:
    """Compute W x + b; the radius of ``x`` is taken entry by entry.

    Promote the form first to keep the radius.
    """
    size = np.abs(weight)
    centre = weight @ x.centre + bias
    generators = weight @ x.generators
    terms = x.centre.size + x.generators.shape[1] + 8.0
    total = np.abs(x.centre) + np.abs(x.generators).sum(axis=1) + x.radius
    lost = terms * _UNIT * (size @ total + np.abs(bias)) + terms * _TINY
    radius = up(size @ x.radius * (1.0 + terms * _UNIT) + lost)
    return Form(centre, generators, radius)


def activation(name: str, x: Form, leak: float = 0.0, known: Interval | None = None) -> Form:
    """Apply an activation entry by entry between two parallel lines.

    Parameters
    ----------
    name : str
    x : Form
    leak : float
    known : Interval, optional
        Another enclosure of ``x``.
    """
    if name == "identity":
        return x
    reach = x.range() if known is None else x.range().intersect(known)
    if not np.all(np.isfinite(reach.lo) & np.isfinite(reach.hi)):
        found = enclose(name, reach, leak)
        wide = Form.of_box(found.lo, found.hi) if np.all(np.isfinite(found.hi)) else None
        radius = np.full(x.centre.size, np.inf) if wide is None else wide.generators.sum(axis=1)
        centre = np.zeros(x.centre.size) if wide is None else wide.centre
        return Form(centre, np.zeros_like(x.generators), radius)
    slope, offset, error = linearise(name, reach, leak)
    centre = slope * x.centre + offset
    size = np.abs(slope)
    spread = np.abs(x.generators).sum(axis=1)
    terms = x.generators.shape[1] + 8.0
    lost = terms * _UNIT * (size * (np.abs(x.centre) + spread + x.radius) + np.abs(offset)) + _TINY
    radius = up(up(size * x.radius + error) * (1.0 + 4 * _UNIT) + lost)
    return Form(centre, slope[:, None] * x.generators, radius)


def product(x: Form, y: Form) -> Form:
    """Multiply, entry by entry, forms that share their generators."""
    most = max(x.generators.shape[1], y.generators.shape[1])
    gx = np.pad(x.generators, ((0, 0), (0, most - x.generators.shape[1])))
    gy = np.pad(y.generators, ((0, 0), (0, most - y.generators.shape[1])))
    cx, cy = np.abs(x.centre), np.abs(y.centre)
    sx, sy = np.abs(gx).sum(axis=1) + x.radius, np.abs(gy).sum(axis=1) + y.radius
    terms = most + 8.0
    lost = 2.0 * terms * _UNIT * ((cx + sx) * (cy + sy)) + _TINY
    radius = (sx * sy + cx * y.radius + cy * x.radius) * (1.0 + terms * _UNIT)
    generators = x.centre[:, None] * gy + y.centre[:, None] * gx
    return Form(x.centre * y.centre, generators, up(radius + lost))


def clip(x: Form, known: Interval) -> Form:
    """Use another enclosure for the entries where it is clearly narrower.

    Parameters
    ----------
    x : Form
    known : Interval (n,)
    """
    own = x.range()
    both = own.intersect(known)
    wide = both.hi - both.lo < 0.9 * (own.hi - own.lo)
    if not np.any(wide):
        return x
    boxes = Form.of_box(both.lo, both.hi)
    reach = np.abs(boxes.generators).sum(axis=1)
    return Form(
        np.where(wide, boxes.centre, x.centre),
        np.where(wide[:, None], 0.0, x.generators),
        np.where(wide, reach, x.radius),
    )


def reduce(x: Form, kept: int, most: int) -> Form:
    """Merge small generators until at most ``most`` are left.

    They become edges of a parallelepiped along their principal axes, which follows the dynamics
    where a box along the coordinates would wrap.

    Parameters
    ----------
    x : Form
    kept : int
        Leading generators that are never merged.
    most : int
        More than the dimension and ``kept`` together.

    References
    ----------
    A.-K. Kopetzki, B. Schuermann, M. Althoff, "Methods for order reduction of zonotopes",
    CDC 2017, section III (principal component analysis).
    """
    count, n = x.generators.shape[1], x.centre.size
    if count <= most:
        return x
    size = np.abs(x.generators[:, kept:]).sum(axis=0)
    order = np.argsort(-size, kind="stable")
    room = max(most - kept - n, 0)
    stay, gone = np.sort(order[:room]) + kept, order[room:] + kept
    small = x.generators[:, gone]
    axes = np.linalg.svd(small, full_matrices=True)[0] if np.all(np.isfinite(small)) else np.eye(n)
    inner = axes.T @ small
    terms = (gone.size + n + 8.0) * _UNIT
    rest = np.abs(small - axes @ inner) + terms * (np.abs(axes) @ np.abs(inner) + np.abs(small))
    edges = axes * (np.abs(inner).sum(axis=1) * (1.0 + terms))
    lost = rest.sum(axis=1) * (1.0 + terms) + terms * np.abs(edges).sum(axis=1)
    generators = np.hstack([x.generators[:, :kept], x.generators[:, stay], edges])
    return Form(x.centre, generators, up(up(x.radius + lost) + _TINY))


def network_output(net: Network, x: Form) -> Form:
    """Compute a feed-forward network of a form."""
    value = x
    for w, b, name in zip(net.weights, net.biases, net.activation, strict=True):
        value = activation(name, affine_map(w, b, value.promoted()), net.leak)
    return value
