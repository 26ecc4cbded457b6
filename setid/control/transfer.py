"""Discrete-time transfer functions with exact rational coefficients."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import frexp, inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import lfilter

from setid.control.engine import (
    ModelError,
    SetidError,
    entries_of,
    frozen,
    number,
    python_control,
    real_array,
)

__all__ = [
    "Exact",
    "Transfer",
    "as_transfer",
    "is_schur",
    "samples_of",
    "simulate_exactly",
    "times",
]

Exact = tuple[Fraction, ...]
_BITS = 240  # of the fixed-point numbers that simulations are carried out in
_PRIME = 2**61 - 1
_LARGEST = Fraction(np.finfo(float).max)


@dataclass(frozen=True, slots=True, eq=False, init=False, repr=False)
class Transfer:
    """A transfer function in powers of the delay q^-1, with rational coefficients.

    Sums, products, quotients and cancellations are exact, so that a factor that belongs to
    two polynomials cancels and no other does.

    Parameters
    ----------
    numerator, denominator : sequence of float or Fraction
        Coefficients of q^0, q^-1, ...; the first of the denominator is not zero and is divided
        out.
    Ts : float
        Sampling time, positive.

    Raises
    ------
    ModelError
        If a coefficient is not finite or the denominator begins with zero.

    Examples
    --------
    >>> from setid import control
    >>> M = control.Transfer([0, 0.5], [1, -0.5])
    >>> M
    <Transfer: (0.5 q^-1) / (1 - 0.5 q^-1), Ts = 1>
    >>> M / (1 - M)
    <Transfer: (0.5 q^-1) / (1 - q^-1), Ts = 1>
    """

    numerator: Exact
    denominator: Exact
    Ts: float

    def __init__(
        self,
        numerator: Iterable[float | Fraction],
        denominator: Iterable[float | Fraction] = (1,),
        Ts: float = 1.0,
    ) -> None:
        top, below = _exact(numerator, "numerator"), _exact(denominator, "denominator")
        if not below or below[0] == 0:
            raise ModelError(
                "denominator: found a leading coefficient 0, expected another number "
                "(coefficients of q^0, q^-1, ...): the future is no part of a transfer function"
            )
        step = number(Ts, "Ts", ModelError)
        if not 0 < step < float("inf"):
            raise ModelError(f"Ts: found {Ts!r}, expected a positive number")
        lead = below[0]
        for name, polynomial in (("numerator", top), ("denominator", below)):
            found = _trimmed(tuple(c / lead for c in polynomial))
            if max(map(abs, found)) > _LARGEST:
                raise ModelError(f"{name}: found a coefficient beyond all doubles, expected less")
            object.__setattr__(self, name, found)
        object.__setattr__(self, "Ts", step)

    # ---- numbers ------------------------------------------------------------------------

    @property
    def num(self) -> NDArray[np.float64]:
        """Numerator in doubles, powers of q^-1, read-only."""
        return frozen(np.array([float(c) for c in self.numerator]))

    @property
    def den(self) -> NDArray[np.float64]:
        """Denominator in doubles, powers of q^-1, read-only."""
        return frozen(np.array([float(c) for c in self.denominator]))

    @property
    def order(self) -> int:
        """Number of poles, those at z = 0 included."""
        return max(len(self.numerator), len(self.denominator)) - 1

    @property
    def delay(self) -> int:
        """Lag of the first numerator coefficient that is not zero."""
        return next((lag for lag, c in enumerate(self.numerator) if c), 0)

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Poles z (computed, not proved)."""
        return np.asarray(np.roots(self._padded(self.denominator)), np.complex128)

    @property
    def zeros(self) -> NDArray[np.complex128]:
        """Zeros z (computed, not proved)."""
        return np.asarray(np.roots(self._padded(self.numerator)), np.complex128)

    @property
    def integrators(self) -> int:
        """Number of poles at exactly z = 1 that the numerator does not cancel."""
        return _ones(self.denominator) - min(_ones(self.denominator), _ones(self.numerator))

    @property
    def static_gain(self) -> Fraction | None:
        """Gain at z = 1, exact; None where that is a pole."""
        reduced = self.reduced()
        below = sum(reduced.denominator)
        return None if below == 0 else sum(reduced.numerator, Fraction(0)) / below

    def _padded(self, polynomial: Exact) -> list[float]:
        size = self.order + 1
        return [float(c) for c in polynomial] + [0.0] * (size - len(polynomial))

    def is_stable(self) -> bool:
        """Decide in rationals that all poles lie in the open unit disc."""
        return is_schur(self.reduced().denominator)

    def response(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """Compute the frequency response (F,) at ``omega`` (F,), rad per unit of time."""
        step = np.exp(-1j * real_array(omega, "omega", SetidError) * self.Ts)
        top, gain = _scaled(self.numerator)
        below, size = _scaled(self.denominator)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            ratio = np.polynomial.polynomial.polyval(step, top) / np.polynomial.polynomial.polyval(
                step, below
            )
            return np.asarray(ratio * _nearest(gain / size), np.complex128)

    def simulate(self, u: ArrayLike) -> NDArray[np.float64]:
        """Simulate the output (N,) from rest for an input (N,), in double precision."""
        signal = samples_of(u, "u", SetidError)
        if not signal.size:
            return signal
        return np.asarray(lfilter(self.num, self.den, signal), np.float64)

    # ---- arithmetic ---------------------------------------------------------------------

    def reduced(self) -> Transfer:
        """Cancel common factors of numerator and denominator, found in rationals."""
        common = _gcd(self.numerator, self.denominator)
        if len(common) <= 1:
            return self
        top, below = (_divided(p, common)[0] for p in (self.numerator, self.denominator))
        return Transfer(top, below, self.Ts)

    def __add__(self, other: Any) -> Transfer:
        right = as_transfer(other, self.Ts)
        top = _plus(
            times(self.numerator, right.denominator), times(right.numerator, self.denominator)
        )
        return Transfer(top, times(self.denominator, right.denominator), self.Ts).reduced()

    __radd__ = __add__

    def __neg__(self) -> Transfer:
        return Transfer([-c for c in self.numerator], self.denominator, self.Ts)

    def __sub__(self, other: Any) -> Transfer:
        return self + (-as_transfer(other, self.Ts))

    def __rsub__(self, other: Any) -> Transfer:
        return as_transfer(other, self.Ts) - self

    def __mul__(self, other: Any) -> Transfer:
        right = as_transfer(other, self.Ts)
        top = times(self.numerator, right.numerator)
        return Transfer(top, times(self.denominator, right.denominator), self.Ts).reduced()

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Transfer:
        right = as_transfer(other, self.Ts)
        top, below = times(self.numerator, right.denominator), right.numerator
        below = times(self.denominator, below)
        shift = min(_leading_zeros(top), _leading_zeros(below))
        if not any(below):
            raise ModelError("divisor: found the transfer function 0, expected another")
        if _leading_zeros(below) > shift:
            raise ModelError(
                f"quotient: found a divisor with {_leading_zeros(below) - shift} samples more "
                "delay, expected at most the delay of the dividend: the quotient would need the "
                "future"
            )
        return Transfer(top[shift:], below[shift:], self.Ts).reduced()

    def __rtruediv__(self, other: Any) -> Transfer:
        return as_transfer(other, self.Ts) / self

    def feedback(self) -> Transfer:
        """Close the loop: L / (1 + L) of this loop function L."""
        return Transfer(self.numerator, _plus(self.denominator, self.numerator), self.Ts).reduced()

    # ---- integrators --------------------------------------------------------------------

    def snapped(self, tolerance: float = 1e-9) -> tuple[Transfer, float]:
        """Move a pole that is nearly at z = 1 to exactly 1.

        Parameters
        ----------
        tolerance : float
            Largest distance from 1: of abs(D(1) / Q(1)), which it is up to second order.

        Returns
        -------
        Transfer
            With D = (1 - q^-1) Q, Q being the quotient of the division without its remainder;
            the same object where there is nothing to move.
        float
            The remainder D(1) that was dropped; 0 where nothing was.
        """
        if not 0.0 <= number(tolerance, "tolerance", ModelError) < 1.0:
            raise ModelError(f"tolerance: found {tolerance!r}, expected a fraction in [0, 1)")
        quotient, rest = [], Fraction(0)
        for c in self.denominator:
            rest += c
            quotient.append(rest)
        quotient.pop()
        if rest == 0 or abs(rest) > Fraction(tolerance) * abs(sum(quotient, Fraction(0))):
            return self, 0.0
        below = times(tuple(quotient), (Fraction(1), Fraction(-1)))
        return Transfer(self.numerator, below, self.Ts), float(rest)

    # ---- exchange -----------------------------------------------------------------------

    def to_control(self) -> Any:
        """Convert to a discrete ``control.TransferFunction``.

        Raises
        ------
        sparsepop_py.SolverNotFound
            If python-control is missing.
        """
        module = python_control("to_control")
        pair = self._padded(self.numerator), self._padded(self.denominator)
        return module.TransferFunction(*pair, self.Ts)

    def __repr__(self) -> str:
        text = f"({_text(self.numerator)})"
        if len(self.denominator) > 1:
            text += f" / ({_text(self.denominator)})"
        return f"<Transfer: {text}, Ts = {self.Ts:g}>"


def as_transfer(given: Any, Ts: float | None = None, field: str = "system") -> Transfer:
    """Take a number, a pair of coefficient lists or a python-control model as a Transfer.

    Parameters
    ----------
    given : Transfer, number, (numerator, denominator) in powers of q^-1, or control model
    Ts : float, optional
        The sampling time that is expected; 1 for plain numbers when left out.
    field : str
        What messages call it.

    Raises
    ------
    ModelError
        If it is none of these, continuous, or sampled at another rate.
    """
    found = _converted(given, Ts, field)
    if Ts is not None and found.Ts != Ts:
        raise ModelError(f"{field}.Ts: found {found.Ts:g}, expected {Ts:g} as of the other parts")
    return found


def _converted(given: Any, Ts: float | None, field: str) -> Transfer:
    step = 1.0 if Ts is None else Ts
    if isinstance(given, Transfer):
        return given
    if isinstance(getattr(given, "model", None), Transfer):  # a SpecifiedModel
        return given.model
    if hasattr(given, "num_list") or (hasattr(given, "num") and hasattr(given, "dt")):
        return _of_control(given, step, field)
    if isinstance(given, (tuple, list)) and len(given) == 2:
        return Transfer(given[0], given[1], step)
    if isinstance(given, (int, float, Fraction, np.number)) and not isinstance(given, bool):
        return Transfer([given if isinstance(given, (int, Fraction)) else float(given)], [1], step)
    raise ModelError(
        f"{field}: found {type(given).__name__}, expected a Transfer, (numerator, denominator) in "
        "powers of q^-1, or a discrete model of python-control"
    )


def _of_control(given: Any, step: float, field: str) -> Transfer:
    if given.dt == 0 or given.dt is None:
        raise ModelError(f"{field}: found a continuous-time model, expected one in discrete time")
    shape = len(given.num), len(given.num[0])
    if shape != (1, 1):
        raise ModelError(
            f"{field}: found {shape[0]} outputs and {shape[1]} inputs, expected one of each"
        )
    top, below = (np.atleast_1d(np.squeeze(p)) for p in (given.num[0][0], given.den[0][0]))
    pad = len(below) - len(top)
    if pad < 0:
        raise ModelError(f"{field}: found more zeros than poles, expected a causal model")
    Ts = step if given.dt is True else float(given.dt)
    return Transfer([0.0] * pad + top.tolist(), below.tolist(), Ts)


# ---- simulation without rounding --------------------------------------------------------


def samples_of(given: Any, field: str, error: type[SetidError]) -> NDArray[np.float64]:
    """Copy the samples of one signal, (N,) or one row or column; other shapes raise."""
    found = real_array(given, field, error)
    if not found.ndim or max(found.shape) != found.size:
        raise error(f"{field}: found shape {found.shape}, expected (N,)")
    return found.ravel()


def simulate_exactly(system: Transfer, u: Sequence[float]) -> NDArray[np.float64]:
    """Simulate from rest in fixed point; each output is rounded once, at the end.

    The point is 240 bits below the largest input.

    Parameters
    ----------
    system : Transfer
    u : (N,) float

    Returns
    -------
    (N,) float
        Within one unit in the last place, or 2^-180 of the largest input, as long as no output
        exceeds 2^60 times that.
    """
    one = 1 << _BITS
    unit = Fraction(2) ** frexp(max(map(abs, u), default=0.0))[1]
    top = [round(c * one) for c in system.numerator]
    below = [round(c * one) for c in system.denominator]
    inputs = [round(Fraction(float(value)) / unit * one) for value in u]
    found: list[int] = []
    for k in range(len(inputs)):
        total = sum(c * inputs[k - i] for i, c in enumerate(top) if i <= k)
        total -= sum(c * found[k - i] for i, c in enumerate(below) if 0 < i <= k)
        found.append(total >> _BITS)
    values = [_nearest(Fraction(value, one) * unit) for value in found]
    if not np.all(np.isfinite(values)):
        raise SetidError("u: found inputs whose response is beyond all doubles, expected smaller")
    return np.array(values)


# ---- polynomials ------------------------------------------------------------------------


def _exact(given: Iterable[float | Fraction], field: str) -> Exact:
    found = []
    listed = entries_of(given, field, "coefficients", ModelError)
    table = np.array(listed, dtype=object)
    if table.size == 0 or table.size != max(table.shape):
        raise ModelError(f"{field}: found shape {table.shape}, expected a list of coefficients")
    for place, value in enumerate(table.ravel()):
        if isinstance(value, (Fraction, int)) and not isinstance(value, bool):
            found.append(Fraction(value))
            continue
        real = number(value, f"{field}[{place}]", ModelError)
        if not np.isfinite(real):
            raise ModelError(f"{field}[{place}]: found {value!r}, expected a finite number")
        found.append(Fraction(real))
    return tuple(found)


def _nearest(value: Fraction) -> float:
    """The nearest double, infinite beyond them all."""
    try:
        return float(value)
    except OverflowError:
        return inf if value > 0 else -inf


def _scaled(polynomial: Exact) -> tuple[NDArray[np.float64], Fraction]:
    """Coefficients as fractions of the power of two next to the largest, and that power."""
    largest = max(map(abs, polynomial))
    if not largest:
        return np.zeros(len(polynomial)), Fraction(1)
    shift = largest.numerator.bit_length() - largest.denominator.bit_length()
    size = Fraction(2) ** shift
    return np.array([float(c / size) for c in polynomial]), size


def _trimmed(polynomial: Exact) -> Exact:
    size = len(polynomial)
    while size > 1 and polynomial[size - 1] == 0:
        size -= 1
    return polynomial[:size] or (Fraction(0),)


def times(one: Sequence[Fraction], other: Sequence[Fraction]) -> Exact:
    """Multiply two polynomials in q^-1."""
    found = [Fraction(0)] * (len(one) + len(other) - 1)
    for i, a in enumerate(one):
        for j, b in enumerate(other):
            found[i + j] += a * b
    return _trimmed(tuple(found))


def _plus(one: Exact, other: Exact) -> Exact:
    size = max(len(one), len(other))
    blank = Fraction(0)
    pairs = zip(
        one + (blank,) * (size - len(one)), other + (blank,) * (size - len(other)), strict=True
    )
    return _trimmed(tuple(a + b for a, b in pairs))


def _leading_zeros(polynomial: Exact) -> int:
    return next((i for i, c in enumerate(polynomial) if c), len(polynomial))


def _ones(polynomial: Exact) -> int:
    """Multiplicity of the root q^-1 = 1."""
    count, factor = 0, (Fraction(1), Fraction(-1))
    while any(polynomial) and sum(polynomial) == 0:
        polynomial, count = _divided(polynomial, factor)[0], count + 1
    return count


def _divided(top: Exact, below: Exact) -> tuple[Exact, Exact]:
    """Quotient and remainder, highest power of q^-1 first."""
    rest, lead = list(top), below[-1]
    quotient = [Fraction(0)] * max(len(top) - len(below) + 1, 1)
    for place in range(len(top) - len(below), -1, -1):
        factor = rest[place + len(below) - 1] / lead
        quotient[place] = factor
        for i, c in enumerate(below):
            rest[place + i] -= factor * c
    return _trimmed(tuple(quotient)), _trimmed(tuple(rest[: max(len(below) - 1, 1)]))


def _gcd(one: Exact, other: Exact) -> Exact:
    """Greatest common divisor by Euclid's algorithm, its last coefficient 1."""
    one, other = _trimmed(one), _trimmed(other)
    if _coprime_modulo(one, other):
        return (Fraction(1),)
    while any(other):
        other = tuple(c / other[-1] for c in other)
        one, other = other, _divided(one, other)[1]
    return tuple(c / one[-1] for c in one) if any(one) else (Fraction(1),)


def _coprime_modulo(one: Exact, other: Exact) -> bool:
    """Tell that polynomials have no common factor, by Euclid's algorithm modulo a prime.

    A common factor stays one modulo a prime that divides no denominator and no last coefficient.
    So none there is none at all; False says nothing.
    """
    p = _PRIME
    if any(c.denominator % p == 0 for c in (*one, *other)):
        return False
    a, b = ([c.numerator * pow(c.denominator, -1, p) % p for c in f] for f in (one, other))
    if not a[-1] or not b[-1]:
        return False
    while len(b) > 1:
        inverse = pow(b[-1], -1, p)
        while len(a) >= len(b):
            factor, shift = a[-1] * inverse % p, len(a) - len(b)
            a = [c if k < shift else (c - factor * b[k - shift]) % p for k, c in enumerate(a[:-1])]
            while a and not a[-1]:
                a.pop()
        a, b = b, a
    return bool(b)


def is_schur(polynomial: Sequence[Fraction], radius: Fraction = Fraction(1)) -> bool:
    """Decide in rationals that all roots z lie in the open disc of a radius.

    Parameters
    ----------
    polynomial : sequence of Fraction
        c_0 + c_1 q^-1 + ...; roots are those of c_0 z^n + c_1 z^(n-1) + ...
    radius : Fraction

    References
    ----------
    E. I. Jury, Theory and Application of the z-Transform Method, 1964, section 3 (the
    step-down recursion: all reflection coefficients below 1).

    Examples
    --------
    >>> from fractions import Fraction
    >>> from setid.control.transfer import is_schur
    >>> is_schur([Fraction(1), Fraction(-1, 2)]), is_schur([Fraction(1), Fraction(-1)])
    (True, False)
    """
    rest = [Fraction(c) / radius**i for i, c in enumerate(polynomial)]
    while rest and rest[-1] == 0:
        rest.pop()
    for bits in (128 + 4 * len(rest), 1024 + 16 * len(rest)):
        known = _is_schur_with(rest, bits)
        if known is not None:
            return known
    while len(rest) > 1:
        if not abs(rest[-1]) < abs(rest[0]):
            return False
        k = rest[-1] / rest[0]
        rest = [a - k * b for a, b in zip(rest[:-1], rest[:0:-1], strict=True)]
    return bool(rest)


def _is_schur_with(polynomial: Sequence[Fraction], bits: int) -> bool | None:
    """Do the step-down recursion in fixed point with an error bound; None where it is too rough.

    Fractions grow with each step, and a polynomial of order 120 takes seconds.
    """
    one, size = 1 << bits, max(map(abs, polynomial), default=Fraction(0))
    rest = [int(c / size * one) for c in polynomial] if size else []
    error = 1  # of each coefficient, in units of 2^-bits
    while len(rest) > 1:
        first, last = abs(rest[0]), abs(rest[-1])
        if last - error >= first + error:
            return False
        if last + error >= first - error:
            return None
        rest, error = _stepped(rest, error, bits)
    return bool(rest)


def _stepped(rest: list[int], error: int, bits: int) -> tuple[list[int], int]:
    """Take one step of the recursion, of coefficients within an error of those given.

    With k = last / first below 1 in size, k moves by at most 2 error / (first - error), and each
    coefficient a - k b by the error of a, that of b, and as much as k moves times b.
    """
    first = abs(rest[0])
    k = (rest[-1] << bits) // rest[0]
    slack = (2 * error << bits) // (first - error) + 2
    most = max(map(abs, rest)) + error
    new = [a - (k * b >> bits) for a, b in zip(rest[:-1], rest[:0:-1], strict=True)]
    return new, 2 * error + (most * slack >> bits) + 2


def _text(polynomial: Exact) -> str:
    parts = list[str]()
    for lag, c in enumerate(polynomial):
        if c == 0 and len(polynomial) > 1:
            continue
        size = f"{abs(float(c)):.6g}"
        power = f"q^-{lag}" if lag else ""
        body = power if power and size == "1" else " ".join(filter(None, (size, power)))
        sign = "- " if c < 0 else "+ "
        parts.append(("-" if c < 0 else "") + body if not parts else sign + body)
    return " ".join(parts) or "0"
