"""Continuous-time structures: physical coefficients in rows of sampled signals.

With z = q^-1 the integral of a signal over time is approximated by

    1/s  ->  (g0 + g1 z) / (1 - z),      g0 + g1 = Ts,

and the equation D(s) y = N(s) u, multiplied by s^-n (1 - z)^n, becomes the row

    sum_i a_i (1 - z)^i (g0 + g1 z)^(n-i) y == sum_i b_i (1 - z)^i (g0 + g1 z)^(n-i) u,

a_n = 1: affine in the coefficients a_i and b_i, so that rows are bilinear in coefficients and
noise. A row divided by (2 / Ts)^n would be that of textbooks; in this scale the leading
difference (1 - z)^n y has coefficients of size 1 whatever Ts is.

Tustin: g0 = g1 = Ts / 2, the trapezoidal rule.

Lambda: for lam = 1 / (1 + tau s) the equation multiplied by (tau lam)^n is static in the
filtered signals lam^j y and lam^j u, because s = (1 - lam) / (tau lam). A signal that is
linear between samples is filtered exactly by ``lam = (c0 + c1 z) / (1 - exp(-Ts/tau) z)``
with e = (1 - exp(-Ts/tau)) tau / Ts, c0 = 1 - e, c1 = e - exp(-Ts/tau). The
denominators of the filters cancel, which leaves the row above with g0 = tau c0 / e and
g1 = Ts - g0. For tau -> infinity it is Tustin's.

Inputs that are held constant between samples are integrated exactly by Ts z / (1 - z):
one factor g0 + g1 z of each numerator term is then Ts z.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from math import expm1, log2
from typing import Any, Literal, get_args

import numpy as np
from numpy.polynomial import polynomial as lags
from numpy.typing import ArrayLike, NDArray

from setid.data.checks import MOST_TERMS, channel_pair, natural, number, parameters_of, switch, word
from setid.data.digits import all_digits
from setid.errors import ModelError
from setid.models.equations import Equation, Initial, Lagged, Structure, Term, Transfer
from setid.models.html import InNotebook
from setid.models.lti import TransferFunction

__all__ = [
    "INDIRECT_WARNING",
    "ContinuousTransferFunction",
    "Hold",
    "Method",
    "at_rate",
    "interval_of",
    "without_delta",
]

_MOST_POWER = 960  # of two: smaller and larger doubles round otherwise
INDIRECT_WARNING = (
    "intervals of discrete coefficients do not map to intervals of physical ones, and inverse "
    "discretisation need not preserve stability or the degree of the numerator; it is right "
    "where the discrete coefficients are accurate and inputs are constant between samples"
)

Method = Literal["tustin", "lambda", "indirect"]
Hold = Literal["linear", "constant"]
Reals = NDArray[np.float64]


@dataclass(frozen=True, slots=True, init=False)
class ContinuousTransferFunction(InNotebook):
    """G(s) = (b_m s^m + ... + b_0) / (s^n + a_(n-1) s^(n-1) + ... + a_0), sampled.

    The parameters are the physical coefficients, named by their power of s, in falling
    order: ``a1``, ``a0``, ``b1``, ``b0``.

    Parameters
    ----------
    n : int
        Order, at least 1.
    m : int
        Degree of the numerator, at most n.
    method : {"tustin", "lambda", "indirect"}
        How the derivatives are replaced; see the notes.
    delta : float or "estimate"
        Bound on the discretisation error: the recursion's output differs from the sampled
        output by at most this, in units of the output. It widens the bound of the output
        noise. With ``"estimate"`` :func:`setid.identify` takes the least one that is
        consistent with the data (:func:`setid.estimate_delta`). Either way it is an
        assumption, and results list it; 0 assumes that there is no such error.
    tau : float, optional
        Time constant of the filter of the lambda method, in the unit of Ts.
    hold : {"linear", "constant"}
        Inputs between samples. ``"constant"`` (digital outputs with a hold) asks for m < n.
    Ts : float, optional
        Sampling interval; that of the data when left out.
    initial : {"free", "zero"}
        As for :class:`TransferFunction`.
    offset : bool
        A constant parameter ``c``: D(s) y = N(s) u + c, so that c / a0 is what the output
        settles at without an input (and an unknown offset of the sensor, or c / b0 of the
        actuator). Not together with ``initial="zero"``.

    Raises
    ------
    ModelError
        If a value does not fit.

    Notes
    -----
    One input and one output: a system with several of them is one structure for each pair,
    identified from records in which the other inputs rest, or a discrete
    :class:`TransferFunction`.
    ``"tustin"`` is exact where all signals inside the chain of integrators are linear
    between samples; its error falls with Ts^2 for inputs that ``hold`` describes.
    ``"lambda"`` is exact where input and output are linear (the input: as ``hold`` says)
    between samples, and for an exponential response of time constant tau.
    ``"indirect"`` states the discrete model instead: parameters are then ``a1``, ``b1``
    of a :class:`TransferFunction`, and :func:`setid.to_continuous` converts members.

    References
    ----------
    H. Unbehauen, G. P. Rao, "Continuous-time approaches to system identification - a
    survey", Automatica 26 (1990) 23-35.
    R. Johansson, "Identification of continuous-time models", IEEE Trans. Signal Processing
    42 (1994) 887-897 (the operator lambda).

    Examples
    --------
    >>> import setid
    >>> model = setid.ContinuousTransferFunction(2, 1, Ts=0.1)
    >>> model.parameters
    ('a1', 'a0', 'b1', 'b0')
    >>> numerator, denominator = model.discrete([3, 2, 1, 4])  # (s + 4) / (s^2 + 3 s + 2)
    >>> numerator.round(6), denominator.round(6)
    (array([ 0.051948,  0.017316, -0.034632]), array([ 1.      , -1.722944,  0.74026 ]))
    """

    n: int
    m: int
    method: Method
    delta: float | Literal["estimate"]
    tau: float | None
    hold: Hold
    Ts: float | None
    initial: Initial
    offset: bool

    def __init__(
        self,
        n: int,
        m: int,
        method: Method = "tustin",
        delta: float | Literal["estimate"] = 0.0,
        tau: float | None = None,
        hold: Hold = "linear",
        Ts: float | None = None,
        initial: Initial = "free",
        offset: bool = False,
    ) -> None:
        order = natural(n, "n", ModelError, least=1, most=MOST_TERMS)
        degree = natural(m, "m", ModelError, most=MOST_TERMS)
        for field, value, known in (
            ("method", method, get_args(Method)),
            ("hold", hold, get_args(Hold)),
            ("initial", initial, get_args(Initial)),
        ):
            word(value, field, known, ModelError)
        estimated = isinstance(delta, str) and delta == "estimate"
        deviation = delta if estimated else _size(delta, "delta", least=0.0)
        if degree > order - (hold == "constant" and method != "indirect"):
            raise ModelError(
                f"m: found {degree}, expected at most n = {order}, and less with hold='constant': "
                "an input that jumps at samples then acts on the output at once"
            )
        if (tau is not None) != (method == "lambda"):
            raise ModelError(
                f"tau: found {tau!r}, expected the time constant of the filter with "
                "method='lambda', and none otherwise"
            )
        if method == "indirect" and deviation != 0.0:
            raise ModelError(
                f"delta: found {delta!r}, expected 0 with method='indirect': the discrete model "
                "has no discretisation error"
            )
        if switch(offset, "offset", ModelError) and initial == "zero":
            raise ModelError(
                "offset: found True with initial='zero', expected one of them: with an offset the "
                "output does not rest at zero"
            )
        fields: dict[str, Any] = {
            "n": order,
            "m": degree,
            "method": method,
            "delta": deviation,
            "tau": None if tau is None else _size(tau, "tau"),
            "hold": hold,
            "Ts": None if Ts is None else _size(Ts, "Ts"),
            "initial": initial,
            "offset": switch(offset, "offset", ModelError),
        }
        for key, value in fields.items():
            object.__setattr__(self, key, value)

    @property
    def inputs(self) -> int:
        """One input channel."""
        return 1

    @property
    def outputs(self) -> int:
        """One output channel."""
        return 1

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the coefficients in falling order, denominator first, then the offset."""
        if self.method == "indirect":
            return self.counterpart.parameters
        constant = ("c",) if self.offset else ()
        return (*self._falling("a", self.n - 1), *self._falling("b", self.m), *constant)

    def transfer(self, output: int = 1, input: int = 1) -> Transfer:
        """Name the coefficients of the transfer function.

        Parameters
        ----------
        output, input : int
            Channels, from 1.
        """
        channel_pair(output, input, 1, 1)
        if self.method == "indirect":
            return self.counterpart.transfer(output, input)
        names = self.parameters
        top = names[self.n : self.n + self.m + 1]
        return Transfer(top, names[: self.n], self.n - self.m, continuous=True)

    @property
    def counterpart(self) -> TransferFunction:
        """The discrete structure of the sampled system, with coefficients of its own.

        Of order n, with n + 1 numerator coefficients, and without the first of them where a
        held input cannot act at once (m < n).
        """
        delay = int(self.hold == "constant" and self.m < self.n)
        shape = (self.n, self.n + 1 - delay, delay)
        return TransferFunction(*shape, initial=self.initial, offset=self.offset)

    def between_samples(self, delta: float) -> str:
        """State the assumption on signals between samples, with the bound in use.

        Parameters
        ----------
        delta : float
            Bound of the discretisation error.
        """
        held = "held constant" if self.hold == "constant" else "linear"
        if self.method == "indirect":
            return f"the sampled system is a {self.counterpart!r}"
        how = "Tustin's rule"
        if self.method != "tustin" and self.tau is not None:
            how = f"lambda filters, tau = {all_digits(self.tau)}"
        return (
            f"between samples inputs are {held}; the recursion of {how} differs from the sampled "
            f"output by at most delta = {all_digits(delta)}"
        )

    # ---- rows ---------------------------------------------------------------------------

    def operator(self, power: int, signal: Literal["y", "u"] = "y") -> Reals:
        """Compute lag coefficients of s^power's stand-in in a row, (n + 1,) from lag 0.

        Parameters
        ----------
        power : int
            0..n.
        signal : {"y", "u"}

        Examples
        --------
        >>> import setid
        >>> model = setid.ContinuousTransferFunction(2, 1, Ts=2.0)
        >>> model.operator(1).tolist(), model.operator(0).tolist()
        ([1.0, 0.0, -1.0], [1.0, 2.0, 1.0])
        """
        power = natural(power, "power", ModelError, most=self.n)
        word(signal, "signal", ("y", "u"), ModelError)
        step = self._interval()
        first = step / 2 if self.tau is None else _first_weight(step, self.tau)
        integrals = [np.array([first, step - first])] * (self.n - power)
        if signal == "u" and self.hold == "constant":
            integrals[:1] = [np.array([0.0, step])]
        found = np.ones(1)
        for factor in [np.array([1.0, -1.0])] * power + integrals:
            found = lags.polymul(found, factor)
        return np.pad(found, (0, self.n + 1 - found.size))

    def discrete(self, theta: ArrayLike | Mapping[str, float]) -> tuple[Reals, Reals]:
        """Compute numerator and denominator of the recursion in powers of q^-1, (n + 1,) each.

        Parameters
        ----------
        theta : (p,) array_like or mapping of names to numbers
        """
        values = parameters_of(theta, self.parameters)
        if self.method == "indirect":  # they are its parameters
            first = self.counterpart.nk[0][0]
            top, rest = np.zeros(self.n + 1), values[self.n :]
            top[first:] = rest[: self.n + 1 - first]
            return top, np.append(1.0, values[: self.n])
        bottom, top = self.operator(self.n), np.zeros(self.n + 1)
        for power, a in zip(range(self.n - 1, -1, -1), values[: self.n], strict=True):
            bottom = bottom + a * self.operator(power)
        for power, b in zip(self._powers, values[self.n : self.n + self.m + 1], strict=True):
            top = top + b * self.operator(power, "u")
        return np.asarray(top / bottom[0]), np.asarray(bottom / bottom[0])

    def equations(self, noisy: Collection[str] = ()) -> tuple[Equation, ...]:
        """State one row a sample, affine in the coefficients; noise keeps its form.

        Parameters
        ----------
        noisy : collection of str
            Not used here.
        """
        if self.method == "indirect":
            return self.counterpart.equations(noisy)
        terms = _terms("", 1.0, self.operator(self.n), "y1")
        for name, i in zip(self._falling("a", self.n - 1), range(self.n - 1, -1, -1), strict=True):
            terms += _terms(name, 1.0, self.operator(i), "y1")
        for name, i in zip(self._falling("b", self.m), self._powers, strict=True):
            terms += _terms(name, -1.0, self.operator(i, "u"), "u1")
        if self.offset:  # all n integrals of a constant
            terms.append(Term(-(float(self._interval()) ** self.n), ("c",), ()))
        return (Equation("y1", tuple(terms), error=True, differences=self.n),)

    def regression(self) -> tuple[Equation, ...]:
        """State the same rows, which are linear in theta."""
        return self.equations()

    @property
    def _powers(self) -> range:
        """Powers of s in the numerator."""
        return range(self.m, -1, -1)

    def _falling(self, letter: str, top: int) -> tuple[str, ...]:
        return tuple(f"{letter}{i}" for i in range(top, -1, -1))

    def _interval(self) -> float:
        if self.Ts is None:
            raise ModelError(
                "Ts: found None, expected the sampling interval (data bring it along; to simulate, "
                "give ContinuousTransferFunction(..., Ts=...))"
            )
        if self.n * (abs(log2(self.Ts)) + 1) > _MOST_POWER:
            raise ModelError(
                f"Ts: found {self.Ts!r}, whose powers up to {self.n} leave the range of doubles, "
                "expected another unit of time"
            )
        return self.Ts


def at_rate(model: Structure, Ts: float) -> Structure:
    """Fix the structure at the sampling interval of a record.

    Raises
    ------
    ModelError
        If a continuous-time structure was given another one.
    """
    if not isinstance(model, ContinuousTransferFunction) or model.Ts == Ts:
        return model
    if model.Ts is not None:
        raise ModelError(f"Ts: found {model.Ts:g} in the model, expected {Ts:g} as in the data")
    return replace(model, Ts=Ts)


def interval_of(model: Structure, Ts: float | None) -> float:
    """Return the sampling interval: as given, that of a continuous-time structure, or 1."""
    own = model.Ts if isinstance(model, ContinuousTransferFunction) else None
    return (own or 1.0) if Ts is None else Ts


def without_delta(model: Structure) -> Structure:
    """Drop the bound of the discretisation error from a structure."""
    return replace(model, delta=0.0) if isinstance(model, ContinuousTransferFunction) else model


def _first_weight(step: float, tau: float) -> float:
    """g0 of the lambda method: tau (1 - e) / e with e = (1 - exp(-x)) / x, x = step / tau."""
    x = step / tau
    if x < 1e-3:  # the difference below loses digits: its series
        return step * (0.5 + x / 12.0 - x**3 / 720.0)
    return step * (-1.0 / expm1(-x) - 1.0 / x)


def _terms(name: str, sign: float, coefficients: Reals, signal: str) -> list[Term]:
    """A parameter (or none) times a combination of lagged samples."""
    return [
        Term(sign * float(c), (name,) if name else (), (Lagged(signal, lag),))
        for lag, c in enumerate(coefficients)
        if c
    ]


def _size(given: Any, field: str, least: float | None = None) -> float:
    value = number(given, field, ModelError)
    if not np.isfinite(value) or value < 0 or (least is None and value == 0):
        wanted = "> 0" if least is None else ">= 0"
        raise ModelError(f"{field}: found {given!r}, expected a finite number {wanted}")
    return value
