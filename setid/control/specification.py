"""Reference models from full specifications: a fictitious plant and H-infinity mixed sensitivity.

The closed loop's behaviour depends on T and S = 1 - T alone, so that T is designed for a
fictitious plant that holds only what no controller can remove: the delay and the zeros outside
the unit circle of the real one. All work is done in the plane of the bilinear transformation,
where a delay of one
sample is a zero at 2 / Ts, and goes back exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import inf, log, pi, sqrt
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.control.engine import (
    ModelError,
    SetidError,
    entries_of,
    natural,
    number,
    python_control,
)
from setid.control.references import complex_numbers
from setid.control.transfer import Transfer
from sparsepop_py.executors.threads import silent

__all__ = ["Specification", "SpecifiedModel", "reference_model_from"]

_FASTEST = 20.0  # poles and zeros beyond this many times 2 / Ts are replaced by their gain
_SPARE_PEAK = 1.1  # times the peak of T that the overshoot allows
_ROLL_OFF = 3.0  # times the bandwidth: where T may fall without a limit for sensor noise
_FLAT = 1e-3  # abs(S) of the weight at frequency 0, before the static gain is made exact


@dataclass(frozen=True, slots=True)
class Specification:
    """Specification of a closed loop.

    Parameters
    ----------
    Ts : float
        Sampling time.
    type : int
        Number of poles at z = 1 of the loop: 1 for steps, 2 for ramps of the reference or of an
        output disturbance without error in the end.
    rise, settling : float, optional
        Largest times of the step response (10 % to 90 %; 2 %).
    overshoot : float
        Largest overshoot, a fraction of the final value.
    disturbance : (omega, gain), optional
        abs(S) <= gain for all frequencies up to omega (rad per unit of time).
    sensor_noise : (omega, gain), optional
        abs(T) <= gain for all frequencies from omega on.
    zeros : sequence of complex
        The plant's zeros z outside the unit circle, with their conjugates.
    delay : int
        The plant's delay in samples, at least 1.

    Raises
    ------
    ModelError
        If a value is out of range, or neither rise, settling nor disturbance is given.
    """

    Ts: float
    type: int = 1
    rise: float | None = None
    settling: float | None = None
    overshoot: float = 0.1
    disturbance: tuple[float, float] | None = None
    sensor_noise: tuple[float, float] | None = None
    zeros: Sequence[complex] = ()
    delay: int = 1

    def __post_init__(self) -> None:
        if not 0.0 < number(self.Ts, "Ts", ModelError) < inf:
            raise ModelError(f"Ts: found {self.Ts!r}, expected a positive number")
        if natural(self.type, "type", ModelError, 1) > 2:
            raise ModelError(f"type: found {self.type}, expected 1 or 2")
        natural(self.delay, "delay", ModelError, 1)
        if not 0.0 < number(self.overshoot, "overshoot", ModelError) < 1.0:
            raise ModelError(f"overshoot: found {self.overshoot!r}, expected a fraction in (0, 1)")
        if self.rise is None and self.settling is None and self.disturbance is None:
            raise ModelError("rise, settling, disturbance: found none, expected one of them")
        for field in ("rise", "settling"):
            value = getattr(self, field)
            if value is not None and not 0.0 < number(value, field, ModelError) < inf:
                raise ModelError(f"{field}: found {value!r}, expected a positive time")
        for field in ("disturbance", "sensor_noise"):
            _check_limit(getattr(self, field), field)
        object.__setattr__(self, "zeros", tuple(complex_numbers(self.zeros)))
        if any(abs(z) <= 1.0 for z in self.zeros):
            raise ModelError(f"zeros: found {list(self.zeros)}, expected abs(z) > 1 for all")

    @property
    def bandwidth(self) -> float:
        """Frequency that rise time, settling time and disturbance ask for."""
        damping = self.damping
        asked = [0.0]
        if self.rise is not None:
            asked.append(2.2 / self.rise)
        if self.settling is not None:
            asked.append(4.0 / (damping * self.settling))
        if self.disturbance is not None:
            asked.append(self.disturbance[0] / self.disturbance[1])
        return max(asked)

    @property
    def damping(self) -> float:
        """Damping ratio of a second-order response with the overshoot."""
        size = -log(self.overshoot)
        return size / sqrt(pi**2 + size**2)


def _check_limit(given: Any, field: str) -> None:
    """Refuse what is no limit (omega, gain) of a gain."""
    if given is None:
        return
    parts = entries_of(given, field, "(omega, gain)", ModelError)
    if len(parts) != 2 or not all(0.0 < number(v, field, ModelError) < inf for v in parts):
        raise ModelError(f"{field}: found {given!r:.60}, expected (omega, gain), both positive")


@dataclass(frozen=True, slots=True, eq=False)
class SpecifiedModel:
    """A reference model, and what it keeps of its specification.

    Parameters
    ----------
    model : Transfer
    gamma : float
        What the mixed sensitivity attained; at most 1 where the weights are kept everywhere.
    checks : dict of str to (asked, measured)
        Each limit that was asked for beside what the model does (computed).
    """

    model: Transfer
    gamma: float
    checks: dict[str, tuple[float, float]]

    @property
    def kept(self) -> bool:
        """True if every limit is kept."""
        return all(measured <= asked for asked, measured in self.checks.values())


def reference_model_from(spec: Specification) -> SpecifiedModel:
    """Design a reference model for a full specification by H-infinity mixed sensitivity.

    Parameters
    ----------
    spec : Specification

    Returns
    -------
    SpecifiedModel
        ``model`` has the delay and the zeros of the plant, and 1 - M has ``type`` zeros at exactly
        z = 1. Where ``kept`` is False the limits contradict each other, or the zeros and the
        delay: relax one.

    Raises
    ------
    SolverNotFound
        If python-control or slycot is missing; the message says how to install it.

    References
    ----------
    V. Cerone, D. Regruto, M. Abuabiah, "A set-membership approach to direct data-driven
    control design for SISO non-minimum phase plants", CDC 2017, 1284-1290.
    S. Skogestad, I. Postlethwaite, Multivariable Feedback Control, 2nd ed. 2005, section 2.8.3.
    """
    if not isinstance(spec, Specification):
        raise SetidError(f"spec: found {type(spec).__name__}, expected control.Specification")
    module = _synthesis()
    zeros, gain, poles, gamma = _mixed_sensitivity(module, spec)
    model = _exact_type(_bilinear(zeros, poles, gain, spec), spec)
    if not model.is_stable():
        raise SetidError(
            "spec: the synthesis gave an unstable model; relax the bandwidth or the gains"
        )
    return SpecifiedModel(model, gamma, _checks(model, spec))


def _synthesis() -> ModuleType:
    module = python_control("reference_model_from")
    try:
        from slycot import sb10ad  # noqa: F401
    except ImportError as error:
        raise sp.SolverNotFound(
            "reference_model_from: slycot is missing, which python-control needs for H-infinity "
            "synthesis; install it with: pip install 'sparsepop-py[slycot]'"
        ) from error
    return module


def _mixed_sensitivity(
    module: ModuleType, spec: Specification
) -> tuple[NDArray[Any], float, NDArray[Any], float]:
    """Zeros, static gain and poles of T in the bilinear plane, and gamma."""
    unit = 2.0 / spec.Ts
    far = [unit] * spec.delay + [unit * (z - 1.0) / (z + 1.0) for z in spec.zeros]
    signs = np.array([w if np.real(w) > 0 else -w for w in far], complex)
    plant = module.zpk(np.array(far, complex), -signs, 1.0)
    plant = plant / float(np.real(module.evalfr(plant, 0.0)))
    speed = _warped(spec.bandwidth, spec.Ts)
    weight_s, weight_t = _weights(module, spec, speed)
    with silent(FutureWarning):
        found = module.mixsyn(module.ss(plant), weight_s, None, weight_t)
        controller, gamma = found[0], float(found[2][0])
        closed = module.feedback(module.ss(plant) * controller, 1)
    zeros, poles = module.zeros(closed), module.poles(closed)
    limit = _FASTEST * unit
    kept = (z[np.abs(z) < limit] for z in (np.asarray(zeros), np.asarray(poles)))
    zeros, poles = _without_pairs(*kept)
    return zeros, float(np.real(module.dcgain(closed))), poles, gamma


def _warped(omega: float, Ts: float) -> float:
    """A frequency in the bilinear plane; at most a quarter of the sampling frequency counts."""
    return 2.0 / Ts * float(np.tan(min(0.5 * omega * Ts, 0.25 * pi)))


def _weights(module: ModuleType, spec: Specification, speed: float) -> tuple[Any, Any]:
    """W_S for errors and disturbances, W_T for sensor noise, peaks after the damping ratio."""
    z = spec.damping
    root = sqrt(1.0 + 8.0 * z**2)
    peak_s = 2.0 * z * sqrt(2.0 + 4.0 * z**2 + 2.0 * root) / (root + 4.0 * z**2 - 1.0)
    peak_t = 1.0 / (2.0 * z * sqrt(1.0 - z**2)) if z < sqrt(0.5) else 1.0
    peak_t *= _SPARE_PEAK
    k = spec.type
    part = module.tf([peak_s ** (-1 / k), speed], [1.0, speed * _FLAT ** (1 / k)])
    weight_s = part if k == 1 else part * part
    if spec.sensor_noise is None:
        top = _ROLL_OFF * speed
        return weight_s, module.tf([1.0, top / peak_t], [0.05, top])
    omega, gain = spec.sensor_noise
    corner = _warped(omega, spec.Ts)
    return weight_s, module.tf([1.0, corner * gain / peak_t], [0.01, corner * gain])


def _without_pairs(zeros: NDArray[Any], poles: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Zeros and poles without those that agree to six digits."""
    left, right = list(zeros), list(poles)
    for z in zeros:
        near = [p for p in right if abs(p - z) < 1e-6 * max(abs(z), 1e-12)]
        if near:
            left.remove(z)
            right.remove(near[0])
    return np.array(left), np.array(right)


def _bilinear(
    zeros: NDArray[Any], poles: NDArray[Any], gain: float, spec: Specification
) -> Transfer:
    """Back to z by s = 2 / Ts (z - 1) / (z + 1), the static gain kept."""
    unit = 2.0 / spec.Ts
    rest, below = (list(v) for v in (zeros, poles))
    for _ in range(spec.delay):  # (unit - s) / (unit + s) is one sample of delay
        rest.pop(int(np.argmin(np.abs(np.array(rest) - unit))))
        below.pop(int(np.argmin(np.abs(np.array(below) + unit))))
    outer = [(unit + w) / (unit - w) for w in rest] + [-1.0] * (len(below) - len(rest))
    inner = [(unit + p) / (unit - p) for p in below]
    top, bottom = (np.poly(np.array(v)).real if v else np.ones(1) for v in (outer, inner))
    scale = gain * bottom.sum() / top.sum()
    shift = [0.0] * (spec.delay + len(bottom) - len(top))
    return Transfer(shift + (scale * top).tolist(), bottom.tolist(), spec.Ts)


def _exact_type(model: Transfer, spec: Specification) -> Transfer:
    """M times a factor of order type - 1, so that 1 - M has ``type`` zeros at exactly z = 1."""
    top, below = model.numerator, model.denominator
    n0, d0 = sum(top, Fraction(0)), sum(below, Fraction(0))
    if spec.type == 1:
        return Transfer([c * d0 / n0 for c in top], below, model.Ts)
    n1 = sum((i * c for i, c in enumerate(top)), Fraction(0))
    d1 = sum((i * c for i, c in enumerate(below)), Fraction(0))
    # (n0 + n1 e)(c0 + c1 (1 + e)) agrees with d0 + d1 e to first order in e
    total = d0 / n0
    c1 = (d1 - n1 * total) / n0
    factor = (total - c1, c1)
    found = [Fraction(0)] * (len(top) + 1)
    for lag, c in enumerate(top):
        found[lag] += c * factor[0]
        found[lag + 1] += c * factor[1]
    return Transfer(found, below, model.Ts)


def _checks(model: Transfer, spec: Specification) -> dict[str, tuple[float, float]]:
    """Each limit beside what the model does, in simulation and on a grid of frequencies."""
    length = int(min(max(50.0 / (spec.bandwidth * spec.Ts), 200.0), 20000.0))
    y = model.simulate(np.ones(length))
    found = {"overshoot": (spec.overshoot, max(float(y.max()) - 1.0, 0.0))}
    if spec.rise is not None:
        first, last = (int(np.argmax(y >= level)) for level in (0.1, 0.9))
        found["rise"] = (spec.rise, (last - first) * spec.Ts)
    if spec.settling is not None:
        outside = np.flatnonzero(np.abs(y - 1.0) > 0.02)
        found["settling"] = (spec.settling, (int(outside[-1]) + 1) * spec.Ts)
    nyquist = pi / spec.Ts
    if spec.disturbance is not None:
        omega, gain = spec.disturbance
        grid = np.linspace(1e-3 * omega, min(omega, nyquist), 500)
        found["disturbance"] = (gain, float(np.abs(1.0 - model.response(grid)).max()))
    if spec.sensor_noise is not None and spec.sensor_noise[0] < nyquist:
        omega, gain = spec.sensor_noise
        found["sensor noise"] = (
            gain,
            float(np.abs(model.response(np.linspace(omega, nyquist, 500))).max()),
        )
    return found
