"""The language in which a structure states its equations, whatever the noise is.

An equation is a sum of terms, each a number times parameters times samples of noise-free
signals at fixed lags. Measured signals are called ``y1``, ``u2``, ...; a structure may
have internal signals of its own, which nobody measures. Block structures need nothing
more: a static nonlinearity is an equation that defines an internal signal.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

from setid.errors import ModelError

__all__ = [
    "Equation",
    "Initial",
    "Lagged",
    "Structure",
    "Term",
    "Transfer",
    "channel_of",
    "term",
]

Initial = Literal["free", "zero"]


@dataclass(frozen=True, slots=True, order=True)
class Lagged:
    """A signal some samples ago: ``Lagged("u1", 2)`` is u1(k-2)."""

    signal: str
    lag: int = 0


@dataclass(frozen=True, slots=True)
class Term:
    """coefficient * parameters * signals."""

    coefficient: float
    parameters: tuple[str, ...] = ()
    signals: tuple[Lagged, ...] = ()


def channel_of(signal: str) -> tuple[str, int] | None:
    """Find kind and channel (from 0) of a measured signal, None for an internal one.

    Examples
    --------
    >>> channel_of("u2"), channel_of("z[1,2]")
    (('u', 1), None)
    """
    if signal[:1] in ("y", "u") and signal[1:].isdigit():
        return signal[0], int(signal[1:]) - 1
    return None


def term(coefficient: float, parameter: str = "", *signals: Lagged) -> Term:
    """Make a term with at most one parameter.

    Examples
    --------
    >>> term(-1.0, "b1", Lagged("u1", 1))
    Term(coefficient=-1.0, parameters=('b1',), signals=(Lagged(signal='u1', lag=1),))
    """
    return Term(coefficient, (parameter,) if parameter else (), signals)


@dataclass(frozen=True, slots=True)
class Equation:
    """Sum of terms == 0 at every sample, or == the equation error where there is one.

    Parameters
    ----------
    defines : str
        The signal that the equation gives; it occurs at lag 0 in the first term, with
        coefficient 1 and no parameter. At lag 0 it may occur again only with parameters
        alone (``implicit``): then the equation is solved for it.
    terms : tuple of Term
    error : bool
        Whether an equation error belongs to it (difference equations of an output).
    differences : int
        How many differences over time its rows take of the defined signal. They magnify
        noise, so that the rows are also looked at through low-pass filters of this order
        (see :mod:`setid.formulation.smoothing`); 0 for none.
    """

    defines: str
    terms: tuple[Term, ...]
    error: bool = False
    differences: int = 0

    def __post_init__(self) -> None:
        if self.terms[:1] != (Term(1.0, (), (Lagged(self.defines),)),):
            raise ModelError(
                f"Equation.terms: found {self.terms[:1]}, expected {self.defines} at lag 0 first"
            )

    @property
    def output(self) -> int | None:
        """Channel (from 0) of the measured output that it defines, None for internal signals."""
        found = channel_of(self.defines)
        return found[1] if found else None

    @property
    def lag(self) -> int:
        """Largest lag: how many samples must precede a row."""
        return max((s.lag for t in self.terms for s in t.signals), default=0)

    @property
    def implicit(self) -> tuple[Term, ...]:
        """Terms beyond the first that multiply the defined sample by parameters alone."""
        return tuple(t for t in self.terms[1:] if t.signals == (Lagged(self.defines),))

    @property
    def explicit(self) -> tuple[Term, ...]:
        """Terms that are known before the defined sample is."""
        now = (Lagged(self.defines),)
        return tuple(t for t in self.terms if t.signals != now)

    @property
    def signals(self) -> tuple[str, ...]:
        """Signals that occur, in order of appearance."""
        return tuple(dict.fromkeys(s.signal for t in self.terms for s in t.signals))

    @property
    def parametric(self) -> bool:
        """True if any parameter occurs."""
        return any(t.parameters for t in self.terms)

    @property
    def linear_in_parameters(self) -> bool:
        """True if no term has more than one parameter."""
        return all(len(t.parameters) <= 1 for t in self.terms)


@dataclass(frozen=True, slots=True)
class Transfer:
    """Names of the coefficients of one transfer function.

    ``(sum_j numerator[j] w^(delay + j)) / (1 + sum_i denominator[i] w^(i + 1))`` with
    w = q^-1, or w = 1/s in continuous time: there the coefficients fall from b_m to b_0 and
    from a_(n-1) to a_0, and the delay is n - m.
    """

    numerator: tuple[str, ...]
    denominator: tuple[str, ...]
    delay: int
    continuous: bool = False


@runtime_checkable
class Structure(Protocol):
    """Difference equations with named parameters: the interface of all model structures."""

    @property
    def inputs(self) -> int:
        """Number of input channels."""

    @property
    def outputs(self) -> int:
        """Number of output channels."""

    @property
    def initial(self) -> Initial:
        """``"free"`` if signals before the record are unknown, ``"zero"`` if they are zero."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of theta."""

    def equations(self, noisy: Collection[str] = ()) -> tuple[Equation, ...]:
        """State equations to compile, internal signals defined before they are used.

        ``noisy`` names the measured signals that are not known exactly; a structure may
        introduce internal signals to keep the degree down.
        """

    def regression(self) -> tuple[Equation, ...]:
        """State one equation an output in measured signals, linear in theta; () if none."""

    def transfer(self, output: int, input: int) -> Transfer:
        """Name coefficients of the transfer function between two channels (from 1)."""
