"""Margins and step responses of the loops with every consistent plant, proved."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from math import asin, inf, pi

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from setid.control.certificates.arcs import Family, ratio_on_arcs
from setid.control.certificates.certificate import StabilityCertificate
from setid.control.certificates.small_gain import lags_of
from setid.control.certificates.stored import plants_of
from setid.control.engine import SetidError, Verification, as_verdict, frozen, natural
from setid.control.parameters.parameter_set import ParameterSet
from sparsepop_py.algebra.read_only import ReadOnly

__all__ = ["LoopMargins", "LoopStep", "loop_margins", "loop_step"]

Reals = NDArray[np.float64]
_EPS = 2.0**-52
_MOST = 5000  # samples of a step response: matrices grow with their square
_ROOM = 1.0 + 1e-9  # so that bounds that are proved again elsewhere stay within


@dataclass(frozen=True, slots=True)
class LoopMargins:
    """Margins that every consistent plant keeps, proved.

    Parameters
    ----------
    sensitivity : float
        Upper bound of max abs(1 / (1 + K P)).
    gain : (float, float)
        The loop stays stable when its gain is multiplied by any factor between these.
    phase : float
        And when its phase is turned by less than this, in rad.
    certificate : StabilityCertificate
        What they are about.
    """

    sensitivity: float
    gain: tuple[float, float]
    phase: float
    certificate: StabilityCertificate = field(repr=False, compare=False)

    @as_verdict
    def verify(self) -> Verification:
        """Verify the certificate, and prove the margins again from its record."""
        verdict = _certified(self.certificate)
        if not verdict:
            return verdict
        again = loop_margins(self.certificate)
        (low, high), (least, most) = again.gain, self.gain
        inside = low <= least <= 1.0 <= most <= high and self.phase <= again.phase
        if not (inside and self.sensitivity >= again.sensitivity):
            return Verification(False, "a margin is larger than what is proved")
        return Verification(True)


@dataclass(frozen=True, slots=True, eq=False)
class LoopStep(ReadOnly):
    """Step responses of the closed loops with every consistent plant.

    Parameters
    ----------
    time, nominal, low, high : (N,) float
        ``low`` and ``high`` are proved; infinite where nothing is. ``nominal`` is the response
        with the plant in the middle of all consistent ones.
    certificate : StabilityCertificate
        What they are about.
    """

    time: Reals
    nominal: Reals
    low: Reals
    high: Reals
    certificate: StabilityCertificate

    @as_verdict
    def verify(self) -> Verification:
        """Verify the certificate, and prove the band again from its record."""
        verdict = _certified(self.certificate)
        if not verdict:
            return verdict
        again = loop_step(self.certificate, max(self.low.size, 1))
        same = self.low.shape == self.high.shape == self.nominal.shape == again.low.shape
        if not (same and np.array_equal(self.time, again.time)):
            return Verification(False, "the samples are not those of the response")
        if not (np.all(self.low <= again.low) and np.all(self.high >= again.high)):
            return Verification(False, "the band is narrower than what is proved")
        near = (_ROOM - 1.0) * (again.high - again.low)
        if not np.all(np.abs(self.nominal - again.nominal) <= near):
            return Verification(False, "the nominal response is not that of the central plant")
        return Verification(True)


def _certified(certificate: StabilityCertificate) -> Verification:
    if certificate.verdict != "certified":
        return Verification(False, "the certificate is not certified")
    return certificate.verify()


def _families(certificate: StabilityCertificate) -> tuple[ParameterSet, Family, Family, Family]:
    """The set of plants, and D_K A, N_K B and their sum."""
    if not isinstance(certificate, StabilityCertificate) or certificate.verdict != "certified":
        raise SetidError("certificate: expected one with the verdict 'certified'")
    found = plants_of(certificate)
    na, lags, k = certificate.model.na[0][0], lags_of(certificate.model), certificate.controller
    none = [Fraction(0)]
    whole = Family.of_products(k.denominator, k.numerator, na, lags)
    size = whole.constants.size
    first = Family.of_products(k.denominator, none, na, lags).padded(size)
    second = Family.of_products(none, k.numerator, na, lags).padded(size)
    return found, first, second, whole


def loop_margins(certificate: StabilityCertificate) -> LoopMargins:
    """Prove gain and phase margins of every consistent plant's loop.

    With max abs(S) <= m they are at least [m / (m + 1), m / (m - 1)] and 2 asin(1 / (2 m)).

    Parameters
    ----------
    certificate : StabilityCertificate
        Certified.

    References
    ----------
    S. Skogestad, I. Postlethwaite, Multivariable Feedback Control, 2nd ed. 2005, eq. (2.48).

    Examples
    --------
    >>> import numpy as np, setid
    >>> from setid import control
    >>> P, M = control.Transfer([0, 1], [1, -0.5]), control.Transfer([0, 0.4], [1, -0.6])
    >>> r = np.random.default_rng(0).uniform(-1, 1, 60)
    >>> data, K = setid.IOData(r, P.simulate(r)), control.ideal_controller(P, M)
    >>> found = control.stability_certificate(data, K, M, 1, 0.01, delay=1)
    >>> control.loop_margins(found).sensitivity < 1.4  # of 1 - M it is 1.25
    True
    """
    found, first, _, whole = _families(certificate)
    theta = found.centre
    step = np.exp(-1j * np.linspace(0.0, pi, 2001))
    values = [np.polynomial.polynomial.polyval(step, f.at(theta)) for f in (first, whole)]
    nominal = float(np.abs(values[0] / values[1]).max())
    arcs = ratio_on_arcs(found, first, whole, theta, 1.05 * nominal)
    top = max(bound for *_, bound in arcs)
    if not top < inf:
        return LoopMargins(inf, (1.0, 1.0), 0.0, certificate)
    top = max(top * _ROOM, _ROOM)
    gain = (top / (top + 1.0) * (1 + 1e-12), top / (top - 1.0) * (1 - 1e-9))
    return LoopMargins(top, gain, 2.0 * asin(0.5 / top) * (1.0 - 1e-12), certificate)


def loop_step(certificate: StabilityCertificate, samples: int = 50) -> LoopStep:
    """Bound the closed loop's step response for every consistent plant.

    d = y - v with a nominal v obeys C d = N_K B r - C v, affine in theta; filtering with the
    nominal 1 / C leaves the identity and a small rest, so that each sample is bounded by one
    linear program and the samples before.

    Parameters
    ----------
    certificate : StabilityCertificate
        Certified.
    samples : int
        From the step on, at least 1.

    Returns
    -------
    LoopStep

    Raises
    ------
    SetidError
        If the certificate is not certified.

    Examples
    --------
    >>> import numpy as np, setid
    >>> from setid import control
    >>> P, M = control.Transfer([0, 1], [1, -0.5]), control.Transfer([0, 0.4], [1, -0.6])
    >>> r = np.random.default_rng(0).uniform(-1, 1, 60)
    >>> data, K = setid.IOData(r, P.simulate(r)), control.ideal_controller(P, M)
    >>> found = control.stability_certificate(data, K, M, 1, 0.01, delay=1)
    >>> step = control.loop_step(found, 30)
    >>> bool(step.low[1] < 0.4 < step.high[1])  # M begins with 0.4
    True
    """
    found, _, second, whole = _families(certificate)
    count = natural(samples, "samples", SetidError, 1, _MOST)
    theta = found.centre
    c0, n0 = whole.at(theta), second.at(theta)
    r = np.ones(count)
    nominal = lfilter(n0, c0, r)
    unit = np.zeros(count)
    unit[0] = 1.0
    h = lfilter([1.0], c0, unit)
    size = whole.constants.size
    # rho = N_K B r - C v as constants + weights theta, then filtered by h
    rows = np.zeros((count, size))
    for k in range(min(size, count)):
        rows[k:, k] = 1.0
    steps, delayed = rows, np.zeros((count, size))
    for k in range(min(size, count)):
        delayed[k:, k] = nominal[: count - k]
    toeplitz = np.zeros((count, count))
    for k in range(count):
        toeplitz[k:, k] = h[: count - k]
    constants = steps @ second.constants - delayed @ whole.constants
    weights = steps @ second.weights - delayed @ whole.weights
    low, high = found.ranges(toeplitz @ constants, toeplitz @ weights)
    reach = np.maximum(np.abs(found.box[0]), np.abs(found.box[1]))
    parts = [np.abs(f.constants) + np.abs(f.weights) @ reach for f in (second, whole)]
    gross = np.abs(toeplitz) @ (np.abs(steps) @ parts[0] + np.abs(delayed) @ parts[1])
    slack = 16.0 * (count + size + reach.size) * _EPS * gross
    low, high = low - slack, high + slack
    # (h C) = 1 + E: E_m <= sum_k abs(h_(m-k)) abs(C_k - C0_k), by its own range
    shifts = toeplitz[:, :1] * 0.0
    lagged = np.zeros((count, size))
    for k in range(min(size, count)):
        lagged[k:, k] = h[: count - k]
    ends = found.ranges(lagged @ whole.constants - unit, lagged @ whole.weights)
    loss = 16.0 * (count + size + reach.size) * _EPS * (np.abs(lagged) @ parts[1] + 1.0)
    leak = np.maximum(np.abs(ends[0]), np.abs(ends[1])) + loss + shifts[:, 0]
    away = np.full(count, inf)
    if leak[0] < 1.0:
        for k in range(count):
            before = float(leak[1 : k + 1] @ away[:k][::-1]) if k else 0.0
            own = max(abs(low[k]), abs(high[k]))
            away[k] = (own + before) / (1.0 - leak[0]) * (1.0 + 1e-12)
    rest = np.array([float(leak[: k + 1] @ away[: k + 1][::-1]) for k in range(count)])
    rest = rest * (1.0 + 1e-12)
    time = np.arange(count) * certificate.controller.Ts
    below, above = nominal + low - rest, nominal + high + rest
    edge = 8 * _EPS * (np.abs(nominal) + np.abs(below) + np.abs(above))
    edge += (_ROOM - 1.0) * (above - below)
    ends = frozen(below - edge), frozen(above + edge)
    return LoopStep(frozen(time), frozen(nominal), *ends, certificate)
