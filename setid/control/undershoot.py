"""Zeros outside the unit circle from a step response, without a model, proved.

For a plant at rest with the step response y_0, y_1, ... to a step of height h at sample 0,
G(z) = (1 - 1/z) sum_k y_k z^-k / h for real z > 1. Readings within a noise bound enclose the
sum, so that a change of its sign between two numbers z proves a zero of G between them.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from setid.control.engine import (
    DataError,
    IOData,
    Noise,
    NoiseError,
    SetidError,
    Verification,
    as_verdict,
    frozen,
    real_array,
)
from setid.control.transfer import samples_of
from setid.data.digits import all_digits
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.verified.arithmetic.display import rounded

__all__ = ["Undershoot", "undershoot"]

Reals = NDArray[np.float64]
Verdict = Literal["present", "absent", "open"]
_EPS = 2.0**-52
_GRID = 1.0 + np.geomspace(1e-3, 99.0, 400)  # numbers z > 1 at which the sign is looked at


@dataclass(frozen=True, slots=True, eq=False)
class Undershoot(ReadOnly):
    """Proof of undershoot and of real zeros outside the unit circle.

    Parameters
    ----------
    verdict : {"present", "absent", "open"}
        Present: the noise-free response is proved to be below its start at some sample while
        it ends above it (or the reverse). Absent: proved not to be, at any sample of the
        record. Open: the noise hides it.
    depth : (float, float)
        Proved range of the largest distance on the wrong side, in units of y; (0, 0) where absent.
    sample : int or None
        A sample at which it is proved, counted from 1 at the step.
    zeros : tuple of (low, high)
        Real numbers z > 1 between which a zero of the plant is proved to lie.
    free : tuple of (low, high)
        Ranges of z at whose grid points no zero is possible (proved at those points alone).
    assumptions : tuple of str
    record : IOData or (N,) float
        The step record.
    noise : Noise or float
        Bound of the output's noise.
    tail : (low, high)
        Range of the noise-free output after the record.
    """

    verdict: Verdict
    depth: tuple[float, float]
    sample: int | None
    zeros: tuple[tuple[float, float], ...]
    free: tuple[tuple[float, float], ...]
    assumptions: tuple[str, ...]
    record: IOData | Reals
    noise: Noise | float
    tail: tuple[float, float]

    @as_verdict
    def verify(self) -> Verification:
        """Draw every conclusion again from the record.

        Claims that are weaker than what follows are accepted, stronger ones are not.
        """
        low, high, texts = _noise_free(self.record, self.noise)
        ends = _ends(self.tail)
        verdict, depth, sample = _conclude(low, high)
        deep = self.depth[0] <= depth[0] and depth[1] <= self.depth[1]
        zeros, free = _zeros(low, high, _upward(self.record, ends))
        at = 0 if self.sample is None else self.sample
        wrong = -high if low[-1] > 0.0 else low  # above 0 where a sample is on the wrong side
        shown = sample is not None and 1 <= at <= low.size and bool(wrong[at - 1] > 0.0)
        stated = set(_assumptions(texts, ends)) <= set(self.assumptions)
        claims = (
            (self.verdict in (verdict, "open"), f"verdict: found {self.verdict}, proved {verdict}"),
            (deep, f"depth: found {self.depth}, proved {depth}"),
            (self.sample is None or shown, f"sample: found {self.sample}, proved {sample}"),
            (
                all(any(_within(c, z) for c in zeros) for z in self.zeros),
                "zeros: a change of sign is not proved",
            ),
            (
                all(any(_within(f, c) for c in free) for f in self.free),
                "free: a sign is not proved",
            ),
            (stated, "assumptions: one is left out"),
        )
        wrong_claim = next((text for holds, text in claims if not holds), None)
        return Verification(wrong_claim is None, wrong_claim or "")

    def __repr__(self) -> str:
        ends = [(rounded(a, False, 4), rounded(b, True, 4)) for a, b in self.zeros]
        zeros = ", ".join(f"[{a}, {b}]" for a, b in ends) or "none proved"
        return f"<Undershoot: {self.verdict}, zeros z > 1: {zeros}>"


def undershoot(
    step_record: IOData | ArrayLike, noise: Noise | float, tail: tuple[float, float] | None = None
) -> Undershoot:
    """Test a step response for undershoot, and locate real zeros outside the unit circle.

    Parameters
    ----------
    step_record : IOData or array_like (N,)
        Output of a plant at rest, measured from the sample at which its input steps; with
        IOData the input is 0 up to the step and constant from it on.
    noise : Noise or float
        Bound of the output's noise.
    tail : (low, high), optional
        Assumption: the noise-free output stays within these after the record. The range of
        the readings and their noise when left out. Listed in the result.

    Returns
    -------
    Undershoot

    Raises
    ------
    SetidError
        If the input is no step or a reading is missing.

    References
    ----------
    J. Leon de la Barra, "On undershoot in SISO systems", IEEE Trans. Automatic Control 39
    (1994) 578-581.

    Examples
    --------
    >>> from setid import control
    >>> P = control.Transfer([0, -0.5, 0.75], [1, -0.75])  # zero at z = 1.5
    >>> found = control.undershoot(P.simulate([1.0] * 40), 0.01)
    >>> found.verdict, len(found.zeros), found.zeros[0][0] < 1.5 < found.zeros[0][1]
    ('present', 1, True)
    >>> bool(found.verify())
    True
    """
    record = step_record if isinstance(step_record, IOData) else _signal(step_record)
    low, high, texts = _noise_free(record, noise)
    seen = _upward(record, (float(low.min()), float(high.max())))
    ends = seen if tail is None else _ends(tail)
    verdict, depth, sample = _conclude(low, high)
    zeros, free = _zeros(low, high, _upward(record, ends))
    assumed = _assumptions(texts, ends)
    return Undershoot(verdict, depth, sample, zeros, free, assumed, record, noise, ends)


def _assumptions(texts: tuple[str, ...], ends: tuple[float, float]) -> tuple[str, ...]:
    """Name what the conclusions rest on, after what was done to the data."""
    return (
        *texts,
        "the plant is linear, stable and at rest before the step",
        "each noise sample lies within its bound",
        "after the record the noise-free output stays within "
        f"[{all_digits(ends[0])}, {all_digits(ends[1])}]",
    )


def _within(inner: tuple[float, float], outer: tuple[float, float]) -> bool:
    return outer[0] <= inner[0] <= inner[1] <= outer[1]


def _ends(tail: tuple[float, float]) -> tuple[float, float]:
    ends = real_array(tail, "tail", SetidError).ravel()
    if ends.size != 2 or not ends[0] <= ends[1]:
        raise SetidError(f"tail: found {tail}, expected (low, high) with low <= high")
    return float(ends[0]), float(ends[1])


def _upward(record: IOData | Reals, ends: tuple[float, float]) -> tuple[float, float]:
    """Turn a range of the output round where the step is downward, as readings are; and back."""
    downward = isinstance(record, IOData) and bool(record.u[record.u != 0.0][0] < 0.0)
    return (-ends[1], -ends[0]) if downward else ends


def _signal(values: ArrayLike) -> Reals:
    return frozen(samples_of(values, "step_record", DataError))


def _noise_free(
    record: IOData | Reals, noise: Noise | float
) -> tuple[Reals, Reals, tuple[str, ...]]:
    """Ranges of the noise-free response from its step on, and what was done to the data."""
    y, texts = _response(record)
    bound = _bounds(record, noise, y)
    with np.errstate(over="ignore"):
        return np.nextafter(y - bound, -inf), np.nextafter(y + bound, inf), texts


def _conclude(low: Reals, high: Reals) -> tuple[Verdict, tuple[float, float], int | None]:
    """Verdict, range of the depth and a sample that shows it."""
    if low[-1] <= 0.0 <= high[-1]:
        return "open", (0.0, inf), None
    below, above = (low, high) if low[-1] > 0.0 else (-high, -low)
    depth = max(0.0, float((-above).max())), max(0.0, float((-below).max()))
    if depth[0] > 0.0:
        return "present", depth, int(np.argmin(above)) + 1
    return ("absent" if depth[1] == 0.0 else "open"), depth, None


def _response(record: IOData | ArrayLike) -> tuple[Reals, tuple[str, ...]]:
    """Response to an upward step, and what was done to the data before."""
    if not isinstance(record, IOData):
        y = samples_of(record, "step_record", DataError)
        height: float = 1.0
        texts: tuple[str, ...] = ()
    else:
        if record.inputs != 1 or record.outputs != 1 or record.records != 1:
            raise DataError("step_record: expected one record with one input and one output")
        u, y = record.u.ravel(), record.y.ravel()
        begin = int(np.argmax(u != 0.0))
        if np.isnan(u).any() or u[begin] == 0.0 or np.ptp(u[begin:]) != 0.0:
            raise DataError("step_record.u: expected zeros and then one constant value, a step")
        height, y, texts = float(u[begin]), y[begin:], record.assumptions
    if y.size < 2 or np.isnan(y).any():
        raise DataError("step_record: expected at least two readings, none missing")
    return frozen(y if height > 0 else -y), texts


def _bounds(record: IOData | ArrayLike, noise: Noise | float, y: Reals) -> Reals:
    given = noise if isinstance(noise, Noise) else Noise(output=noise)
    if np.any(np.asarray(given.input) > 0) or np.any(np.asarray(given.equation) > 0):
        raise NoiseError("noise: expected the output's noise alone")
    data = record if isinstance(record, IOData) else IOData(np.zeros(y.size), y)
    return given.bounds(data)[0].ravel()[-y.size :]


def _zeros(
    low: Reals, high: Reals, ends: tuple[float, float]
) -> tuple[tuple[tuple[float, float], ...], tuple[tuple[float, float], ...]]:
    """Find where the sign of sum_k y_k z^-k is proved to change; nowhere where it overflows."""
    count = low.size
    powers = _GRID[:, None] ** -np.arange(float(count))
    rest = _GRID ** -float(count - 1) / (_GRID - 1.0)
    with np.errstate(over="ignore", invalid="ignore"):  # then least and most are NaN or infinite
        size = powers @ np.maximum(np.abs(low), np.abs(high)) + rest * max(map(abs, ends))
        slack = 8.0 * (count + 8) * count * _EPS * size
        least = powers @ low + rest * ends[0] - slack
        most = powers @ high + rest * ends[1] + slack
    sign = np.where(least > 0.0, 1, np.where(most < 0.0, -1, 0))
    known = np.flatnonzero(sign)
    changes = [
        (float(_GRID[a]), float(_GRID[b]))
        for a, b in zip(known[:-1], known[1:], strict=True)
        if sign[a] != sign[b]
    ]
    runs = np.split(known, np.flatnonzero(np.diff(known) > 1) + 1) if known.size else []
    return tuple(changes), tuple((float(_GRID[r[0]]), float(_GRID[r[-1]])) for r in runs)
