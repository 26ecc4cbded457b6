"""Affine forms in the parameters of a cell: a value, a slope, and all that is left over.

A form stands for f(theta) = c + g (theta - m) + r' with |r'| <= r for every theta of a region
with middle m. Products of slopes, and every rounding error, go to r. How large g (theta - m)
may be is asked of the region: of its box, and of directions along which it is thinner.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dtbtrs

__all__ = ["Form", "Region", "constant", "filtered", "late", "negated", "plus", "times"]

Reals = NDArray[np.float64]
_UNIT = 2.0**-53
_MORE = 1.0 + 1e-12  # more than the rounding of sums of up to 4000 positive numbers
_TINY = 1e-300  # more than what underflows


class Form(NamedTuple):
    """Values (N,) with slopes (N, d) and the rest (N,)."""

    value: Reals
    slope: Reals
    rest: Reals


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """All theta with lower <= theta <= upper and low <= directions theta <= high.

    Parameters
    ----------
    lower, upper : (d,) float
        Finite.
    directions : (q, d) float
    low, high : (q,) float
    """

    lower: Reals
    upper: Reals
    directions: Reals
    low: Reals
    high: Reals
    middle: Reals = field(init=False)
    """The point about which forms are stated, shape (d,)."""
    _shares: Reals = field(init=False)  # of the directions in each parameter, nearly

    def __post_init__(self) -> None:
        shares = np.asarray(np.linalg.pinv(self.directions), np.float64)
        middle: Reals = np.asarray(self.lower / 2 + self.upper / 2, np.float64)
        wanted = self.low / 2 + self.high / 2 - self.directions @ middle
        moved = np.clip(middle + shares @ wanted, self.lower, self.upper)
        object.__setattr__(self, "middle", moved)
        object.__setattr__(self, "_shares", shares)

    def spread(self, slopes: Reals) -> Reals:
        """Bound sum_i |g_i (theta - m)_i| over the box, for slopes (..., d)."""
        far = np.maximum(self.upper - self.middle, self.middle - self.lower)
        return np.asarray(np.abs(slopes) @ (far * _MORE + _TINY) * _MORE, np.float64)

    def reach(self, slopes: Reals) -> Reals:
        """Bound |g (theta - m)| over the region, for slopes (..., d)."""
        middle, size = self.middle, np.maximum(np.abs(self.lower), np.abs(self.upper))
        found = self.spread(slopes)
        if self.low.size:
            at = self.directions @ middle
            doubt = 8 * (size.size + 4) * _UNIT * (np.abs(self.directions) @ size) + _TINY
            width = np.maximum(self.high - at, at - self.low) + 4 * doubt
            shares = slopes @ self._shares
            left = np.abs(slopes - shares @ self.directions)
            loss = 8 * (shares.shape[-1] + 4) * _UNIT
            left = left + loss * (np.abs(slopes) + np.abs(shares) @ np.abs(self.directions))
            found = np.minimum(found, np.abs(shares) @ np.maximum(width, 0.0) + self.spread(left))
        return np.asarray(found * _MORE + _TINY, np.float64)


def constant(values: Reals, dimension: int) -> Form:
    """Make a form of numbers (N,)."""
    return Form(values, np.zeros((*np.shape(values), dimension)), np.zeros(np.shape(values)))


def late(form: Form, lag: int) -> Form:
    """Delay a form by some samples, at rest before the first."""
    if not lag:
        return form
    found = Form(*(np.zeros_like(part) for part in form))
    for part, whole in zip(found, form, strict=True):
        part[lag:] = whole[:-lag]
    return found


def plus(first: Form, second: Form, region: Region) -> Form:
    """Add two forms."""
    value, slope = first.value + second.value, first.slope + second.slope
    loss = 2 * _UNIT * (np.abs(value) + region.spread(np.abs(first.slope) + np.abs(second.slope)))
    return Form(value, slope, (first.rest + second.rest + loss) * _MORE)


def times(first: Form, second: Form, region: Region) -> Form:
    """Multiply two forms; one of them may be a scalar."""
    a, b = np.abs(first.value), np.abs(second.value)
    one, two = region.reach(first.slope), region.reach(second.slope)
    value = first.value * second.value
    left = first.value[..., None] * second.slope
    right = second.value[..., None] * first.slope
    rest = one * two + (a + one) * second.rest + (b + two + second.rest) * first.rest
    loss = 4 * _UNIT * (a * b + region.spread(np.abs(left) + np.abs(right))) + _TINY
    return Form(value, left + right, (rest + loss) * _MORE)


def filtered(
    poles: list[tuple[int, Form]],
    drive: Form,
    region: Region,
    start: Form | None = None,
    bounded: bool = True,
) -> Form:
    """Solve s(k) + sum_i a_i s(k - i) = drive(k), at rest before the first sample.

    The part c + g (theta - m) is any solution of the recursion to first order. What it leaves in
    the equation is bounded as a form, and reaches s through the response of 1 / (1 + sum a_i),
    which is bounded for all a in the region.

    Parameters
    ----------
    poles : list of (lag, form)
        Lags from 1, with scalar forms a_i.
    drive : Form
    region : Region
    start : Form, optional
        The first samples, which no equation gives; the largest lag is their number at most.
    bounded : bool
        False leaves out the rest, and with it the proof.
    """
    begin = 0 if start is None else start.value.size
    found = _first_order(poles, drive, start, begin)
    if not bounded:
        return found
    left = plus(found, negated(drive), region)
    for lag, a in poles:
        left = plus(left, times(late(found, lag), a, region), region)
    size = (np.abs(left.value) + region.reach(left.slope) + left.rest) * _MORE
    size[:begin] = 0.0  # they are what they are
    rest = _through(_response(poles, drive.value.size, region), size)
    if start is not None:
        rest[:begin] = start.rest
    return found._replace(rest=rest)


def _first_order(
    poles: list[tuple[int, Form]], drive: Form, start: Form | None, begin: int
) -> Form:
    """Solve the recursion to first order, its matrix stored by bands; without a rest.

    Row by row, so that what grows overflows; pivots of an elimination would underflow.
    """
    samples = drive.value.size
    value, slope = drive.value.copy(), drive.slope.copy()
    if start is not None:
        value[:begin], slope[:begin] = start.value, start.slope
    most = max((lag for lag, _ in poles if lag < samples), default=0)
    bands = np.zeros((most + 1, samples))  # of the matrix of the recursion, below its diagonal
    bands[0] = 1.0
    for lag, a in poles:
        if lag < samples:
            bands[lag, max(begin - lag, 0) :] += a.value
    if samples:
        value = dtbtrs(bands, value, uplo="L", diag="U")[0].ravel()
        for lag, a in poles:
            k = max(begin, lag)
            slope[k:] -= a.slope * value[k - lag : max(samples - lag, 0), None]
        slope = dtbtrs(bands, slope, uplo="L", diag="U")[0]
    found = Form(value, slope, np.zeros(samples))
    if start is not None:
        for part, first in zip(found, start, strict=True):
            part[:begin] = first
    return found


def negated(form: Form) -> Form:
    """Change the sign of a form."""
    return Form(-form.value, -form.slope, form.rest)


def _response(poles: list[tuple[int, Form]], samples: int, region: Region) -> Reals:
    """Bounds of the impulse response of 1 / (1 + sum a_i) for all a in the region."""
    h, off = np.zeros(samples), np.zeros(samples)
    h[0] = 1.0
    for k in range(1, samples):
        size = 0.0
        for lag, a in poles:
            if k >= lag:
                part = float(a.value * h[k - lag])
                h[k] -= part
                size += abs(part)
        off[k] = 4 * (len(poles) + 2) * _UNIT * size + _TINY
    for lag, a in poles:
        wide = float((region.reach(a.slope) + a.rest) * _MORE)
        off[lag:] += wide * np.abs(h[: samples - lag])
    off *= _MORE
    found = np.abs(h)
    for k in range(1, samples):
        found[k] = (found[k] + off[1 : k + 1] @ found[k - 1 :: -1][:k]) * _more(samples)
    return found


def _through(response: Reals, size: Reals) -> Reals:
    found = np.zeros_like(size)
    for lag in range(size.size):
        found[lag:] += response[lag] * size[: size.size - lag]
    return found * _more(size.size) + _TINY


def _more(count: int) -> float:
    """More than the rounding of a sum of so many positive numbers, and of their products."""
    return max(_MORE, 1.0 + 2 * (count + 8) * _UNIT)
