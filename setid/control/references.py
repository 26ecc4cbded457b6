"""Reference models, the target signal of a controller, and ideal controllers."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import cos, exp, log, pi, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from setid.control.engine import (
    ModelError,
    SetidError,
    entries_of,
    frozen,
    natural,
    number,
)
from setid.control.transfer import (
    Transfer,
    as_transfer,
    is_schur,
    samples_of,
    simulate_exactly,
    times,
)
from sparsepop_py.algebra.read_only import ReadOnly

__all__ = ["Matching", "check_matching", "ideal_controller", "reference_model", "target_signal"]

Reals = NDArray[np.float64]
_RISE = log(9.0)  # 10 % to 90 % of a first-order response, in time constants
_SETTLED = 0.02  # of the final value
_NEARLY_ONE = 1e-9  # of a static gain
_MOST = 10**6  # samples of a response or a delay
_SHORTEST = 1e-200  # time, in units of time
_SLOWEST = 2.0**-40  # sum of a denominator, to which its rounding of 2^-53 is compared
_HORIZON = 60.0  # of normalised time within which damped responses are looked at


# ---- target signal ----------------------------------------------------------------------


def target_signal(M: Any, r: ArrayLike) -> Reals:
    """Compute s = M / (1 - M) r, what the controller is to give for the plant's output.

    M / (1 - M) is formed as one fraction; a static gain of M within 1e-9 of 1 is taken as
    exactly 1, so that the fraction has its integrator. The recursion runs in 240-bit fixed
    point, and each sample is rounded once.

    Parameters
    ----------
    M : Transfer, (numerator, denominator) or python-control model
        The reference model, in powers of q^-1.
    r : array_like (N,)
        The input of the experiment.

    Returns
    -------
    (N,) float

    Raises
    ------
    ModelError
        If 1 - M vanishes at lag 0: then s would need the future of r.

    References
    ----------
    V. Cerone, D. Regruto, M. Abuabiah, "Direct data-driven control design through
    set-membership errors-in-variables identification techniques", American Control
    Conference 2017, 388-393.

    Examples
    --------
    >>> from setid import control
    >>> control.target_signal(([0, 0.5], [1, -0.5]), [1, 0, 0, 0]).tolist()
    [0.0, 0.5, 0.5, 0.5]
    """
    reference = as_transfer(M, None, "M")
    signal = samples_of(r, "r", SetidError)
    if np.isnan(signal).any():
        raise SetidError("r: found missing samples, expected all of them")
    return frozen(simulate_exactly(loop_function(reference), signal.tolist()))


def with_unit_gain(M: Transfer, tolerance: float = _NEARLY_ONE) -> tuple[Transfer, float]:
    """Correct M to a static gain of exactly 1 where nearly so; return what 1 - M was there.

    Parameters
    ----------
    M : Transfer
    tolerance : float
        Largest abs(1 - M) at z = 1 that is made zero, in the last numerator coefficient.
    """
    below = sum(M.denominator, Fraction(0))
    rest = below - sum(M.numerator, Fraction(0))
    if not rest or abs(rest) > Fraction(tolerance) * abs(below):
        return M, 0.0
    moved = Transfer([*M.numerator[:-1], M.numerator[-1] + rest], M.denominator, M.Ts)
    return moved, float(rest / below)


def gain_of_one(missed: float) -> str:
    """Say that a static gain was taken as exactly 1."""
    return f"the reference model's static gain is exactly 1 (1 - M was {missed:.3g} there)"


def loop_function(M: Transfer) -> Transfer:
    """Compute M / (1 - M), a static gain of nearly 1 taken as 1: within 1e-9."""
    M = with_unit_gain(M)[0]
    if M.numerator[0] == 1:
        raise ModelError(
            "M: found the coefficient 1 at lag 0, expected another: 1 - M vanishes there, and "
            "M / (1 - M) would need the future; give M a delay of at least one sample"
        )
    return M / (1 - M)


def ideal_controller(P: Any, M: Any) -> Transfer:
    """Compute K* = M / (P (1 - M)), with which the closed loop is M.

    Parameters
    ----------
    P, M : Transfer, (numerator, denominator) or python-control model
        Plant and reference model.

    Returns
    -------
    Transfer
        Reduced: factors that are exactly common are cancelled.

    Raises
    ------
    ModelError
        If K* would need the future: M needs at least the delay of P.

    Examples
    --------
    >>> from setid import control
    >>> control.ideal_controller(([0, 1], [1, -0.5]), ([0, 0.5], [1, -0.5]))
    <Transfer: (0.5 - 0.25 q^-1) / (1 - q^-1), Ts = 1>
    """
    plant = as_transfer(P, None, "P")
    reference = as_transfer(M, plant.Ts, "M")
    return loop_function(reference) / plant


@dataclass(frozen=True, slots=True, eq=False)
class Matching(ReadOnly):
    """Distance of a closed loop from its reference model, and its stability.

    Parameters
    ----------
    stable : bool
        Internal stability, decided in rationals on D_K A + N_K B.
    gain_error : float
        Largest abs(M - K P / (1 + K P)) on a grid of frequencies (computed).
    fit : float
        Of the step responses, 100 (1 - norm of the difference / norm of the response about its
        mean) per cent.
    closed_loop : Transfer
    time, response, wanted : (N,) float
        Step responses.
    """

    stable: bool
    gain_error: float
    fit: float
    closed_loop: Transfer
    time: Reals
    response: Reals
    wanted: Reals


def check_matching(P: Any, K: Any, M: Any, samples: int = 100) -> Matching:
    """Compare the closed loop of a known plant with the reference model.

    Parameters
    ----------
    P, K, M : Transfer, (numerator, denominator) or python-control model
    samples : int
        Length of the step responses.

    Returns
    -------
    Matching

    Examples
    --------
    >>> from setid import control
    >>> P, M = ([0, 1], [1, -0.5]), ([0, 0.5], [1, -0.5])
    >>> found = control.check_matching(P, control.ideal_controller(P, M), M)
    >>> found.stable, round(found.gain_error, 9), round(found.fit, 6)
    (True, 0.0, 100.0)
    """
    natural(samples, "samples", SetidError, 1, _MOST)
    plant = as_transfer(P, None, "P")
    controller, reference = as_transfer(K, plant.Ts, "K"), as_transfer(M, plant.Ts, "M")
    loop = closed_loop(controller, plant)
    omega = np.linspace(1e-4, pi, 2000) / plant.Ts
    error = np.abs(reference.response(omega) - loop.response(omega))
    step = np.ones(samples)
    response, wanted = loop.simulate(step), reference.simulate(step)
    spread = float(np.linalg.norm(wanted - wanted.mean())) or 1.0
    with np.errstate(over="ignore", invalid="ignore"):
        fit = 100.0 * (1.0 - float(np.linalg.norm(response - wanted)) / spread)
    return Matching(
        stabilises(controller, plant),
        float(np.nan_to_num(error, nan=np.inf).max()),
        fit,
        loop,
        frozen(np.arange(samples) * plant.Ts),
        frozen(response),
        frozen(wanted),
    )


def closed_loop(controller: Transfer, plant: Transfer) -> Transfer:
    """Compute K P / (1 + K P) without any cancellation."""
    below = characteristic(controller, plant)
    if below[0] == 0:
        raise ModelError("K, P: 1 + K P vanishes at lag 0: the loop is not well posed")
    return Transfer(times(controller.numerator, plant.numerator), below, plant.Ts)


def characteristic(controller: Transfer, plant: Transfer) -> tuple[Fraction, ...]:
    """Compute D_K A + N_K B in powers of q^-1."""
    one = times(controller.denominator, plant.denominator)
    other = times(controller.numerator, plant.numerator)
    size = max(len(one), len(other))
    blank = (Fraction(0),)
    pairs = zip(one + blank * (size - len(one)), other + blank * (size - len(other)), strict=True)
    return tuple(a + b for a, b in pairs)


def stabilises(controller: Transfer, plant: Transfer) -> bool:
    """Decide in rationals that a loop is well posed and internally stable."""
    polynomial = characteristic(controller, plant)
    return polynomial[0] != 0 and is_schur(polynomial)


# ---- reference models -------------------------------------------------------------------


def reference_model(
    rise: float | None = None,
    settling: float | None = None,
    overshoot: float = 0.0,
    *,
    Ts: float = 1.0,
    delay: int = 0,
    zeros: ArrayLike = (),
) -> Transfer:
    """Make a reference model of first or second order from its step response.

    Without overshoot it is 1 / (1 + s / p), else wn^2 / (s^2 + 2 z wn s + wn^2), sampled with
    zero-order hold. It is the slowest one that keeps every limit that is given. Limits are those of
    the response before ``delay`` and ``zeros`` are put in: a delay adds as much to the settling
    time, and zeros outside the unit circle add undershoot, and may add overshoot.

    Parameters
    ----------
    rise : float, optional
        Largest time from 10 % to 90 % of the final value, in units of time.
    settling : float, optional
        Largest time after which the response stays within 2 % of the final value.
    overshoot : float
        Fraction of the final value, in [0, 1); 0 means first order.
    Ts : float
        Sampling time.
    delay : int
        Further samples of delay, such as the plant has beyond the first one.
    zeros : array_like of complex
        Zeros z outside the unit circle that the plant has and M must therefore have; with
        their conjugates. The static gain stays 1.

    Returns
    -------
    Transfer
        With static gain exactly 1.

    Raises
    ------
    ModelError
        If neither rise nor settling time is given, or a value is out of range.

    References
    ----------
    G. F. Franklin, J. D. Powell, A. Emami-Naeini, Feedback Control of Dynamic Systems,
    section 3.4 (specifications of second-order responses).

    Examples
    --------
    >>> from setid import control
    >>> M = control.reference_model(rise=2.0, overshoot=0.05, Ts=0.1)
    >>> response = M.simulate([1.0] * 200)
    >>> round(float(response.max()), 2), M.static_gain == 1
    (1.05, True)
    """
    if rise is None and settling is None:
        raise ModelError("rise, settling: found neither, expected at least one of them")
    rise, settling = _time(rise, "rise"), _time(settling, "settling")
    Ts = number(Ts, "Ts", ModelError)
    if not 0.0 < Ts < float("inf"):
        raise ModelError(f"Ts: found {Ts!r}, expected a positive number")
    share = number(overshoot, "overshoot", ModelError)
    if not 0.0 <= share < 1.0:
        raise ModelError(f"overshoot: found {overshoot!r}, expected a fraction in [0, 1)")
    if share == 0.0:
        speeds = [_RISE / rise if rise else 0.0, -log(_SETTLED) / settling if settling else 0.0]
        found = first_order(max(speeds), Ts)
    else:
        damping = -log(share) / sqrt(pi**2 + log(share) ** 2)
        times = _normalised_times(damping)
        speeds = [times[0] / rise if rise else 0.0, times[1] / settling if settling else 0.0]
        found = second_order(max(speeds), damping, Ts)
    if sum(found.denominator) < _SLOWEST:
        raise ModelError(
            f"rise, settling: found times too long beside Ts = {Ts:g}, expected shorter ones: the "
            "coefficients are doubles, and their rounding is no longer small beside the model's "
            "speed"
        )
    return with_zeros(found, delay, zeros)


def _time(given: float | None, field: str) -> float | None:
    """A positive time whose reciprocal is a double, None where none is given."""
    if given is None:
        return None
    value = number(given, field, ModelError)
    if not _SHORTEST <= value < float("inf"):
        raise ModelError(f"{field}: found {given!r}, expected a positive time")
    return value


def first_order(pole: float, Ts: float) -> Transfer:
    """Discretise 1 / (1 + s / pole) with zero-order hold, static gain exactly 1."""
    a = Fraction(exp(-pole * Ts))
    return Transfer([0, 1 - a], [1, -a], Ts)


def second_order(frequency: float, damping: float, Ts: float) -> Transfer:
    """Discretise wn^2 / (s^2 + 2 z wn s + wn^2), static gain exactly 1.

    The damping z is below 1, and the input is held between samples (zero-order hold).
    """
    decay = exp(-damping * frequency * Ts)
    turn = frequency * sqrt(1.0 - damping**2)
    c, s = cos(turn * Ts), sin(turn * Ts)
    a1, a2 = Fraction(-2.0 * decay * c), Fraction(decay**2)
    b1 = Fraction(1.0 - decay * (c + damping * frequency / turn * s))
    return Transfer([0, b1, 1 + a1 + a2 - b1], [1, a1, a2], Ts)


def _normalised_times(damping: float) -> tuple[float, float]:
    """Rise and settling time for wn = 1."""
    turn = sqrt(1.0 - damping**2)

    def response(t: float) -> float:
        return 1.0 - exp(-damping * t) * (cos(turn * t) + damping / turn * sin(turn * t))

    top = pi / turn  # the first maximum
    ends = [brentq(lambda t, y=y: response(t) - y, 0.0, top) for y in (0.1, 0.9)]
    grid = np.linspace(0.0, _HORIZON / damping, 200001)
    values = 1.0 - np.exp(-damping * grid) * (
        np.cos(turn * grid) + damping / turn * np.sin(turn * grid)
    )
    outside = np.flatnonzero(np.abs(values - 1.0) > _SETTLED)
    return ends[1] - ends[0], float(grid[outside[-1] + 1])


def complex_numbers(given: Any) -> list[complex]:
    """Check finite complex numbers, or one of them, and list them; others raise."""
    single = isinstance(given, (complex, float, int, np.number)) and not isinstance(given, bool)
    values = [given] if single else entries_of(given, "zeros", "complex numbers", ModelError)
    found = []
    for place, value in enumerate(values):
        known = isinstance(value, (complex, float, int, np.number)) and not isinstance(value, bool)
        try:
            number_ = complex(value) if known else complex("nan")
        except OverflowError:
            number_ = complex("nan")
        if not np.isfinite(number_):
            raise ModelError(
                f"zeros[{place}]: found {value!r:.60}, expected a finite complex number"
            )
        found.append(number_)
    return found


def with_zeros(M: Transfer, delay: int, zeros: ArrayLike) -> Transfer:
    """Add delay and given zeros to M, static gain kept."""
    given = np.array(complex_numbers(zeros))
    polynomial = np.poly(given) if given.size else np.ones(1)
    if np.abs(np.imag(polynomial)).max() > 1e-9 * np.abs(polynomial).max():
        raise ModelError(f"zeros: found {given.tolist()}, expected complex ones in pairs")
    factor = [Fraction(float(c)) for c in np.real(polynomial)]
    gain = sum(factor)
    if gain == 0:
        raise ModelError("zeros: found z = 1, expected others: the static gain would be 0")
    shift = [Fraction(0)] * natural(delay, "delay", ModelError, 0, _MOST)
    return M * Transfer([*shift, *(c / gain for c in factor)], [1], M.Ts)
