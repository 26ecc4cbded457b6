"""The same multipliers on a box that was derived after the relaxation was solved.

A relaxation may know no bounds of a variable that the constraints bound nevertheless. Its
multipliers prove more on a derived box: with t = reach t', |t'| <= 1, whatever remains of the
identity is paid for by that box. Multipliers of monomials and of bounds are rescaled; powers of
two keep every digit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.monomials import Words
from sparsepop_py.problem.generators import bound_family, count
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.certificate.multipliers import Multipliers
from sparsepop_py.verified.certificate.sos_identity import Identity

__all__ = ["reboxed"]

_LARGEST = 2.0**60  # boxes beyond this pay for no rounding


def reboxed(identity: Identity, box: Interval, rows: int) -> Identity | None:
    """Rewrite an identity so that it makes use of a box.

    Parameters
    ----------
    identity : Identity
    box : Interval
        In the variables x, with finite ends where it says more than the scaling.
    rows : int
        Number of constraints.

    Returns
    -------
    Identity or None
        None where the box says nothing new, or the identity has floors.
    """
    scaling = identity.scaling
    reach = _reach(scaling, box)
    gains = ~scaling.boxed & (reach <= _LARGEST)
    if not gains.any() or any(group.floor > 0 for group in identity.multipliers):
        return None
    reach = np.where(gains, reach, 1.0)
    scaled = _scaling(scaling, reach, gains)
    sizes = _generator_sizes(reach, rows, identity.products)
    multipliers = tuple(_rescaled(group, reach, sizes) for group in identity.multipliers)
    priced = identity.priced
    if priced is not None:
        priced = replace(priced, values=priced.values * _powers(priced.words, reach))
    return replace(identity, scaling=scaled, multipliers=multipliers, priced=priced)


def _reach(scaling: Scaling, box: Interval) -> NDArray[np.float64]:
    """Powers of two that |t| stays below, (n,)."""
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        ends = np.maximum(np.abs(box.lo - scaling.centre), np.abs(box.hi - scaling.centre))
        reach = np.exp2(np.ceil(np.log2(np.maximum(1.001 * ends / scaling.scale, 2.0**-60))))
    return np.where(np.isfinite(reach), reach, np.inf)


def _scaling(scaling: Scaling, reach: NDArray[np.float64], gains: NDArray[np.bool_]) -> Scaling:
    low, high = (end / reach for end in scaling.bounds)
    ends = (
        np.where(gains, np.clip(low, -1.0, 1.0), low),
        np.where(gains, np.clip(high, -1, 1), high),
    )
    return replace(scaling, scale=scaling.scale * reach, boxed=scaling.boxed | gains, ends=ends)


def _powers(words: Words, reach: NDArray[np.float64]) -> NDArray[np.float64]:
    """Factors reach^a of monomials t^a = reach^a t'^a, for words (..., D)."""
    return np.prod(np.append(1.0, reach)[words], axis=-1)


def _generator_sizes(
    reach: NDArray[np.float64], rows: int, products: NDArray[np.integer]
) -> NDArray[np.float64]:
    """Compute old generators as multiples of the new ones."""
    n = reach.size
    sizes = np.ones(count(rows, n) + products.shape[0])
    square, low, high = bound_family(rows, n)
    sizes[square], sizes[low], sizes[high] = reach**2, reach, reach
    for k, (first, second) in enumerate(products.tolist()):
        sizes[count(rows, n) + k] = sizes[first] * sizes[second]
    return sizes


def _rescaled(
    group: Multipliers, reach: NDArray[np.float64], sizes: NDArray[np.float64]
) -> Multipliers:
    factor, own = _powers(group.basis, reach), sizes[group.generator]
    if group.free:
        return replace(group, values=group.values * factor * own[:, None])
    return replace(group, values=group.values * (factor * np.sqrt(own)[:, None])[:, :, None])
