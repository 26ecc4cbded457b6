"""Priors on transfer functions: stability, zeros, static gain, real poles and zeros."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from math import comb, inf
from typing import Literal, NamedTuple

import numpy as np

import sparsepop_py as sp
from setid.data.checks import natural, number, word
from setid.data.digits import all_digits
from setid.errors import PriorError
from setid.models.block import BlockStructured
from setid.models.checked_structures import coefficients_of
from setid.models.equations import Structure, Transfer
from setid.priors.base import Facts, Interval, Plain, Symbols, denominators, interval_of, named
from setid.priors.hurwitz import half_plane_rows, half_plane_unknowns, half_plane_values
from setid.priors.jury import is_stable, jury_rows, jury_unknowns, jury_values
from setid.priors.stability import disc_rows, disc_unknowns, rounded_up, unknown_values

__all__ = ["DCGain", "MinimumPhase", "PoleIn", "Stable", "ZeroIn"]

_MOST = 1e300  # of (2 margin)^n, which no coefficient of a row with n poles exceeds


@dataclass(frozen=True, slots=True)
class Stable(Plain):
    """All poles in the closed disc of radius 1 - margin, or left of -margin.

    With margin 0 this is the closure of stability. See :mod:`setid.priors.stability` for the
    rows, and :mod:`setid.priors.hurwitz` for those of continuous time.

    Parameters
    ----------
    margin : float
        In [0, 1); in continuous time any number >= 0, in rad per unit of time.
    form : {"step-up", "jury"}
        Rows of the step-up recursion, whose image is the closure of the stable set; or those of
        Jury's array with its entries as unknowns (discrete time alone), for comparison with the
        literature. Closed, Jury's rows also admit unstable polynomials such as that of the
        roots 1, 2 and 0.5 (see :mod:`setid.priors.jury`): outer intervals hold, and are wider;
        a point counts as attained only where the step-up test proves that it is stable.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, 2, 3, 2], [0, 1, 1, 2])
    >>> model = setid.TransferFunction(na=2, nb=1)
    >>> problem = setid.formulate(data, model, setid.Noise(0.1), [setid.Stable()]).problem
    >>> print(problem.constraints[-1])
    stable: 1 - a2 >= 0
    >>> problem.lower[:2], problem.upper[:2]
    (array([-2., -1.]), array([2., 1.]))
    """

    margin: float = 0.0
    form: Literal["step-up", "jury"] = "step-up"

    def __post_init__(self) -> None:
        if not 0.0 <= number(self.margin, "Stable.margin", PriorError) < inf:
            raise PriorError(
                f"Stable.margin: found {self.margin!r}, expected a number >= 0, and below 1 in "
                "discrete time"
            )
        word(self.form, "Stable.form", ("step-up", "jury"), PriorError)

    def __repr__(self) -> str:
        form = "" if self.form == "step-up" else f", form={self.form!r}"
        return f"Stable(margin={self.margin!r}{form})"

    @property
    def radius(self) -> float:
        """Largest absolute value of a pole, in discrete time, rounded upwards."""
        if self.margin >= 1.0:
            raise PriorError(
                f"Stable.margin: found {self.margin!r}, expected 0 <= margin < 1 in discrete time"
            )
        return rounded_up(1 - Fraction(self.margin))

    def bounds(self, model: Structure) -> Mapping[str, Interval]:
        """Bound abs(a_i) <= binomial(n, i) radius^i, or a_(n-i) >= binomial(n, i) margin^i.

        Of Jury's form abs(a_n) <= radius^n alone.

        Parameters
        ----------
        model : Structure
        """
        self._check_form(model)
        found: dict[str, Interval] = {}
        for names in self.stable(model):
            if _continuous(model) and (2 * Fraction(self.margin)) ** len(names) > _MOST:
                raise PriorError(
                    f"Stable.margin: found {self.margin!r}, expected one whose power "
                    f"{len(names)}, the number of poles, is far below the largest double"
                )
            for i, name in enumerate(names, 1):
                if self.form == "jury" and i < len(names):
                    continue  # the array bounds the last coefficient alone
                if _continuous(model):
                    least = comb(len(names), i) * self.margin**i
                    found[name] = (least * (1.0 - 1e-15), inf)  # below what rounding may add
                    continue
                size = rounded_up(comb(len(names), i) * Fraction(self.radius) ** i)
                found[name] = (-size, size)
        return found

    def stable(self, model: Structure) -> frozenset[tuple[str, ...]]:
        """Name all denominators.

        Parameters
        ----------
        model : Structure
        """
        return frozenset(names for names in denominators(model) if names)

    def _labelled(self, model: Structure) -> list[tuple[str, tuple[str, ...]]]:
        found = sorted(self.stable(model))
        return [("stable" if len(found) == 1 else f"stable{i}", d) for i, d in enumerate(found, 1)]

    def unknowns(self, model: Structure) -> Mapping[str, Interval]:
        """Name reflection coefficients and coefficients of lower degrees, or entries of the array.

        Parameters
        ----------
        model : Structure
        """
        found: dict[str, Interval] = {}
        for label, names in self._labelled(model):
            if self.form == "jury":
                found |= jury_unknowns(len(names), label)
                continue
            found |= _region(model).unknowns(len(names), True, label)
        return found

    def rows(self, model: Structure, x: Symbols, facts: Facts) -> list[sp.Constraint]:
        """State rows of the closed disc, or of the closed half plane.

        Parameters
        ----------
        model : Structure
        x : mapping of str to Polynomial
            Parameters and own unknowns by name.
        facts : Facts
            Bounds and stability from all priors.
        """
        rows = []
        for label, names in self._labelled(model):
            if len(names) > 1:  # for one pole the bounds say it all
                coefficients = [x[name] for name in names]
                if self.form == "jury":
                    rows += named(jury_rows(coefficients, self.radius, x, label), label)
                    continue
                found = _region(model).rows(None, coefficients, self._size(model), x, label)
                rows += named(found, label)
        return rows

    def complete(self, model: Structure, theta: Mapping[str, float]) -> Mapping[str, float]:
        """Compute reflection coefficients of theta, or entries of the array.

        Parameters
        ----------
        model : Structure
        theta : mapping of str to float
        """
        found: dict[str, float] = {}
        for label, names in self._labelled(model):
            values = [theta[name] for name in names]
            if self.form == "jury":
                found |= jury_values(values, self.radius, label)
                continue
            found |= _region(model).values(1.0, values, self._size(model), True, label)
        return found

    def admits(self, model: Structure, box: Mapping[str, Interval]) -> bool:
        """Prove that all parameters in a box are stable, where rows do not.

        Parameters
        ----------
        model : Structure
        box : mapping of str to (low, high)
            Of the parameters.
        """
        if self.form != "jury":
            return True
        for _, names in self._labelled(model):
            if len(names) <= 2:  # rows are the closed interval or triangle of the closed disc
                continue
            low, high = zip(*(box[name] for name in names), strict=True)
            if not is_stable(low, high, self.radius):
                return False
        return True

    def _check_form(self, model: Structure) -> None:
        if self.form == "jury" and _continuous(model):
            raise PriorError(
                "Stable.form: found 'jury' for a continuous-time structure, expected 'step-up'"
            )

    def _size(self, model: Structure) -> float:
        return self.margin if _continuous(model) else self.radius


def _check_channels(prior: MinimumPhase | DCGain | _RootIn) -> None:
    """Check that output and input are numbers of channels."""
    for name in ("output", "input"):
        natural(getattr(prior, name), f"{type(prior).__name__}.{name}", PriorError, 1)


@dataclass(frozen=True, slots=True)
class MinimumPhase(Plain):
    """All zeros of one transfer function in the closed unit disc (the delay ``nk`` aside).

    A delay beyond ``nk``, where the leading coefficient is zero, is a zero outside the disc. In
    continuous time zeros are in the closed left half plane.

    Parameters
    ----------
    output, input : int
        Channels, from 1.

    Raises
    ------
    PriorError
        If a channel is no integer >= 1.
        From :func:`formulate`, where no other prior gives the sign of the leading numerator
        coefficient: without it the set falls into two parts that only meet in zero.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, 2, 3, 2], [0, 1, 1, 2])
    >>> priors = [setid.Sign({"b0": "+"}), setid.MinimumPhase()]
    >>> known = setid.formulate(data, setid.TransferFunction(1, 2), setid.Noise(0.1), priors)
    >>> [str(row) for row in known.problem.constraints[-2:]]
    ['minphase[1,1]: b0 - b1 >= 0', 'minphase[1,1]: b0 + b1 >= 0']
    """

    output: int = 1
    input: int = 1

    def __post_init__(self) -> None:
        _check_channels(self)

    def _label(self) -> str:
        return f"minphase[{self.output},{self.input}]"

    def _names(self, model: Structure) -> tuple[str, ...]:
        return coefficients_of(model, self.output, self.input).numerator

    def unknowns(self, model: Structure) -> Mapping[str, Interval]:
        """Name ratios to the leading coefficient and their recursion, for three zeros and more.

        Parameters
        ----------
        model : Structure
        """
        return _region(model).unknowns(len(self._names(model)) - 1, False, self._label())

    def rows(self, model: Structure, x: Symbols, facts: Facts) -> list[sp.Constraint]:
        """State rows of the closed disc, or of the closed half plane.

        Parameters
        ----------
        model : Structure
        x : mapping of str to Polynomial
            Parameters and own unknowns by name.
        facts : Facts
            Bounds and stability from all priors.
        """
        lead, *rest = self._names(model)
        fixed = dict(getattr(model, "fixed", ()))  # numbers that normalise gives
        low, high = (fixed[lead], fixed[lead]) if lead in fixed else facts.of(lead)
        if _continuous(model) and len(rest) > 3 and low <= 0.0 <= high:
            raise PriorError(
                f"MinimumPhase: found {lead} in [{low:g}, {high:g}], expected an interval without "
                "zero for more than three zeros in continuous time: Box or Known give it"
            )
        if low < 0.0 < high or low == high == 0.0:
            raise PriorError(
                f"MinimumPhase: found {lead} in [{low:g}, {high:g}], expected its sign to be known "
                f"from Sign, Box or Known; the zeros are roots of a polynomial that {lead} leads, "
                "and the closure of the set for both signs is not described by its rows"
            )
        sign = 1.0 if low >= 0.0 else -1.0
        size = 0.0 if _continuous(model) else 1.0
        others = [x[name] * sign for name in rest]
        found = _region(model).rows(x[lead] * sign, others, size, x, self._label())
        return named(found, self._label())

    def complete(self, model: Structure, theta: Mapping[str, float]) -> Mapping[str, float]:
        """Compute reflection coefficients of the numerator.

        Parameters
        ----------
        model : Structure
        theta : mapping of str to float
        """
        lead, *rest = (theta[name] for name in self._names(model))
        size = 0.0 if _continuous(model) else 1.0
        return _region(model).values(lead, rest, size, False, self._label())


@dataclass(frozen=True, slots=True)
class DCGain(Plain):
    """Static gain of one transfer function, N(1) / D(1) or b_0 / a_0.

    In a block structure it is that of the linear block between the channels, or the only one,
    without static maps and feedback.

    Parameters
    ----------
    low : float
    high : float, optional
        Left out: the gain is exactly ``low``. Either end may be infinite.
    output, input : int
        Channels, from 1.

    Notes
    -----
    With N = sum b and D = 1 + sum a (or N = b_0 and D = a_0):
    ``(N - low D)(high D - N) >= 0``, and the linear rows ``low D <= N <= high D`` where
    :class:`Stable` makes D >= 0.

    Examples
    --------
    >>> import setid
    >>> prior = setid.DCGain(95, 105)
    """

    low: float
    high: float | None = None
    output: int = 1
    input: int = 1

    def __post_init__(self) -> None:
        _check_channels(self)
        low = number(self.low, "DCGain.low", PriorError)
        high = low if self.high is None else number(self.high, "DCGain.high", PriorError)
        if low > high or (low == high and np.isinf(low)):
            raise PriorError(f"DCGain: found [{low:g}, {high:g}], expected low <= high")

    def rows(self, model: Structure, x: Symbols, facts: Facts) -> list[sp.Constraint]:
        """State one equality, one product or two linear rows.

        Parameters
        ----------
        model : Structure
        x : mapping of str to Polynomial
            Parameters and own unknowns by name.
        facts : Facts
            Bounds and stability from all priors.
        """
        transfer = coefficients_of(model, self.output, self.input)
        if isinstance(model, BlockStructured):
            model.check_between(self.output, self.input)
        gain, one = _sums(transfer, x)
        label = f"dcgain[{self.output},{self.input}]"
        low, high = self.low, self.low if self.high is None else self.high
        if low == high:
            return named([gain - low * one == 0], label)
        ends = [gain - low * one] if np.isfinite(low) else []
        ends += [high * one - gain] if np.isfinite(high) else []
        if not transfer.denominator or transfer.denominator in facts.stable:
            return named([end >= 0 for end in ends], label)
        if len(ends) == 1:
            ends.append(one)
        return named([ends[0] * ends[1] >= 0] if ends else [], label)


@dataclass(frozen=True, slots=True)
class _RootIn(Plain, ABC):
    """A real root in an interval, by synthetic division with the root as an unknown."""

    low: float
    high: float
    output: int = 1
    input: int = 1

    _word: str = field(default="root", init=False, repr=False)

    def __post_init__(self) -> None:
        _check_channels(self)
        ends = interval_of((self.low, self.high), type(self).__name__)
        if not np.isfinite(ends).all():
            raise PriorError(f"{type(self).__name__}: found an infinite end, expected numbers")

    def _label(self) -> str:
        ends = f"{all_digits(self.low)}..{all_digits(self.high)}"
        return f"{self._word}[{self.output},{self.input}]@{ends}"

    @abstractmethod
    def _names(self, model: Structure) -> tuple[str | None, ...]:
        """Coefficients from the leading one on; None for the number one."""

    def unknowns(self, model: Structure) -> Mapping[str, Interval]:
        """Name the root, and the inner coefficients of the quotient."""
        degree = len(self._names(model)) - 1
        if degree < 1:
            raise PriorError(f"{type(self).__name__}: found no {self._word}, expected at least one")
        if self.low == self.high:
            return {}
        first = 2 if self._names(model)[0] is None else 1
        inner = {f"{self._label()}.d{i}": (-inf, inf) for i in range(first, degree)}
        return {self._label(): (float(self.low), float(self.high)), **inner}

    def rows(self, model: Structure, x: Symbols, facts: Facts) -> list[sp.Constraint]:
        """State c_0 r^n + ... + c_n == 0 by Horner's rule, in bilinear rows."""
        one = next(iter(x.values())) * 0.0 + 1.0
        value, *others = [one if name is None else x[name] for name in self._names(model)]
        root = float(self.low) if self.low == self.high else x[self._label()]
        rows = []
        for i, coefficient in enumerate(others, 1):
            value = value * root + coefficient
            inner = x.get(f"{self._label()}.d{i}")
            if inner is not None:
                rows.append(value - inner == 0)
                value = inner
        return named([*rows, value == 0], self._label())

    def complete(self, model: Structure, theta: Mapping[str, float]) -> Mapping[str, float]:
        """Find the real root nearest to the interval, and the quotient."""
        if self.low == self.high:
            return {}
        c = [1.0 if name is None else theta[name] for name in self._names(model)]
        roots = np.roots(c) if any(c) else np.zeros(1)
        off = np.abs(roots - np.clip(roots.real, self.low, self.high))
        root = float(roots[np.argmin(off)].real) if roots.size else float(self.low)
        quotient = [c[0]]
        for coefficient in c[1:]:
            quotient.append(quotient[-1] * root + coefficient)
        inner = {f"{self._label()}.d{i}": value for i, value in enumerate(quotient)}
        wanted = self.unknowns(model)
        return {self._label(): root} | {n: v for n, v in inner.items() if n in wanted}


@dataclass(frozen=True, slots=True)
class PoleIn(_RootIn):
    """A real pole lies in [low, high].

    Several of these may speak of the same pole where their intervals overlap.

    Parameters
    ----------
    low, high : float
        Equal for a known pole, which gives one linear row; otherwise the pole is an
        unknown, and so are the inner coefficients of the denominator without it.
    output, input : int
        Channels, from 1.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, 2, 3, 2], [0, 1, 1, 2])
    >>> model = setid.TransferFunction(na=2, nb=1)
    >>> problem = setid.formulate(data, model, setid.Noise(0.1), [setid.PoleIn(0, 1)]).problem
    >>> print(problem.constraints[-1])
    pole[1,1]@0..1: a2 + a1*pole[1,1]@0..1 + pole[1,1]@0..1^2 == 0
    """

    _word: str = field(default="pole", init=False, repr=False)

    def _names(self, model: Structure) -> tuple[str | None, ...]:
        return (None, *coefficients_of(model, self.output, self.input).denominator)


@dataclass(frozen=True, slots=True)
class ZeroIn(_RootIn):
    """A real zero lies in [low, high] (or the numerator vanishes, its closure).

    Parameters
    ----------
    low, high : float
        As for :class:`PoleIn`.
    output, input : int
        Channels, from 1.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, 2, 3, 2], [0, 1, 1, 2])
    >>> model = setid.TransferFunction(na=1, nb=2)
    >>> problem = setid.formulate(data, model, setid.Noise(0.1), [setid.ZeroIn(0, 0)]).problem
    >>> print(problem.constraints[-1])
    zero[1,1]@0..0: b1 == 0
    """

    _word: str = field(default="zero", init=False, repr=False)

    def _names(self, model: Structure) -> tuple[str | None, ...]:
        return coefficients_of(model, self.output, self.input).numerator


class _Region(NamedTuple):
    """A region for roots: rows, further unknowns and their values."""

    rows: Callable[..., list[sp.Constraint]]
    unknowns: Callable[[int, bool, str], dict[str, Interval]]
    values: Callable[..., dict[str, float]]


_DISC = _Region(disc_rows, disc_unknowns, unknown_values)
_HALF_PLANE = _Region(half_plane_rows, half_plane_unknowns, half_plane_values)


def _continuous(model: Structure) -> bool:
    if isinstance(model, BlockStructured):
        return False  # its blocks are discrete, and there may be none from input 1 to output 1
    return coefficients_of(model, 1, 1).continuous


def _region(model: Structure) -> _Region:
    return _HALF_PLANE if _continuous(model) else _DISC


def _sums(transfer: Transfer, x: Symbols) -> tuple[sp.Polynomial, sp.Polynomial]:
    """Numerator and denominator at q = 1, or at s = 0."""
    if transfer.continuous:
        return x[transfer.numerator[-1]], x[transfer.denominator[-1]]
    numerator = sp.total(x[name] for name in transfer.numerator)
    return numerator, sp.total([numerator * 0.0, 1.0, *(x[n] for n in transfer.denominator)])
