"""Classes of controllers: linear ones of an order, PID, and given numerators."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from setid.control.engine import (
    ModelError,
    TransferFunction,
    entries_of,
    natural,
    number,
    switch,
)
from setid.control.transfer import Exact, Transfer, times

__all__ = ["LTI", "PID", "Controller", "Fixed", "Polynomials"]

Reals = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Fixed:
    """A class with all its orders known, ready for identification.

    The controller is K = N(theta) / (D(theta) known), where N has the coefficients b0, b1, ...
    and D the coefficients a1, a2, ... of ``model``. The target signal is filtered with ``known``
    first.

    Parameters
    ----------
    model : TransferFunction
    known : polynomial in q^-1
    integrators : int
        1 where 1 + sum a = 0 is forced by a linear row.
    names : tuple of str
        The user's parameters.
    basis : (p, m) float
        theta = basis (user's parameters); p = m = number of ``model.parameters``, invertible.
    """

    model: TransferFunction
    known: Exact
    integrators: int
    names: tuple[str, ...]
    basis: Reals

    def controller(self, theta: Sequence[Fraction], Ts: float) -> Transfer:
        """Build the controller of parameters (p,) of ``model``; an integrator stays exact."""
        na = self.model.na[0][0]
        below = [Fraction(1), *theta[:na]]
        if self.integrators:
            below[na] = -sum(below[:na], Fraction(0))
        return Transfer(theta[na:], times(below, self.known), Ts)


class Controller(ABC):
    """Interface of all classes of controllers."""

    @abstractmethod
    def fixed(self, Ts: float, order: int | None = None) -> Fixed:
        """Fix the class at a sampling time; ``order`` where the class leaves it open."""

    @property
    def orders(self) -> tuple[int, ...] | None:
        """Orders to try one after the other; None where there is no choice."""
        return None


@dataclass(frozen=True, slots=True)
class LTI(Controller):
    """Linear controllers (b0 + b1 q^-1 + ... + bn q^-n) / (1 + a1 q^-1 + ... + an q^-n).

    Parameters
    ----------
    order : int, optional
        n; when left out, orders are raised from 1 until a controller is consistent.
    integrator : bool
        Force one pole at exactly z = 1 by the linear row 1 + a1 + ... + an = 0.
    most : int
        Largest order that is tried without ``order``.

    Examples
    --------
    >>> from setid import control
    >>> control.LTI(2, integrator=True).fixed(1.0).model.parameters
    ('a1', 'a2', 'b0', 'b1', 'b2')
    """

    order: int | None = None
    integrator: bool = True
    most: int = 8

    def __post_init__(self) -> None:
        switch(self.integrator, "LTI.integrator", ModelError)
        if self.order is not None:
            natural(self.order, "LTI.order", ModelError, 1 if self.integrator else 0)
        natural(self.most, "LTI.most", ModelError, 1)

    @property
    def orders(self) -> tuple[int, ...] | None:
        """From 1 to the largest one."""
        return tuple(range(1, self.most + 1)) if self.order is None else None

    def fixed(self, Ts: float, order: int | None = None) -> Fixed:
        """Fix the class with one order."""
        n = self.order if order is None else order
        if n is None:
            raise ModelError("LTI.order: found None, expected an integer here")
        natural(n, "order", ModelError, 1 if self.integrator else 0)
        model = TransferFunction(n, n + 1)
        names = model.parameters
        return Fixed(model, (Fraction(1),), int(self.integrator), names, np.eye(len(names)))


@dataclass(frozen=True, slots=True)
class PID(Controller):
    """PID controllers in parallel form, linear in Kp, Ki and Kd.

    K = Kp + Ki Ts / (1 - q^-1) + Kd (1 - q^-1) / (Ts + Tf - Tf q^-1). Integral by the backward
    rule, derivative through a
    first-order filter of time constant ``filter`` (none when 0).

    Parameters
    ----------
    derivative : bool
        False for PI controllers.
    filter : float
        Time constant of the derivative's filter, in units of time.

    Examples
    --------
    >>> from setid import control
    >>> control.PID().fixed(0.1).names
    ('Kp', 'Ki', 'Kd')
    """

    derivative: bool = True
    filter: float = 0.0

    def __post_init__(self) -> None:
        switch(self.derivative, "PID.derivative", ModelError)
        if not 0.0 <= number(self.filter, "PID.filter", ModelError) < inf:
            raise ModelError(f"PID.filter: found {self.filter!r}, expected a time >= 0")

    def fixed(self, Ts: float, order: int | None = None) -> Fixed:
        """Write numerators over the common denominator (1 - q^-1) (1 - f q^-1)."""
        if not 0.0 < number(Ts, "Ts", ModelError) < inf:
            raise ModelError(f"Ts: found {Ts!r}, expected a positive number")
        delta = (Fraction(1), Fraction(-1))
        one = (Fraction(1),)
        if not self.derivative:
            return _over(delta, [delta, (Fraction(Ts),)], ("Kp", "Ki"))
        lag = Fraction(self.filter / (self.filter + Ts))
        smooth = (Fraction(1), -lag) if self.filter else one
        top = [
            times(delta, smooth),
            times((Fraction(Ts),), smooth),
            times(times(delta, delta), (1 / Fraction(Ts + self.filter),)),
        ]
        return _over(times(delta, smooth), top, ("Kp", "Ki", "Kd"))


@dataclass(frozen=True, slots=True, eq=False)
class Polynomials(Controller):
    """Controllers sum_i k_i N_i / D with given polynomials in q^-1, linear in k.

    Parameters
    ----------
    numerators : sequence of sequences of float
        N_1, ..., N_m; as many as the longest has coefficients, and independent.
    denominator : sequence of float
        D; a pole at z = 1 is an integrator.

    Raises
    ------
    ModelError
        If the polynomials do not determine k.

    Examples
    --------
    >>> from setid import control
    >>> control.Polynomials([[1.0, 0.0], [0.0, 1.0]], [1.0, -1.0]).fixed(1.0).names
    ('k1', 'k2')
    """

    numerators: Sequence[Sequence[float]]
    denominator: Sequence[float] = (1.0,)

    def __post_init__(self) -> None:
        rows = entries_of(self.numerators, "numerators", "polynomials", ModelError)
        if not rows:
            raise ModelError("numerators: found none, expected at least one polynomial")
        parts = [entries_of(row, "numerators", "lists of coefficients", ModelError) for row in rows]
        below = entries_of(self.denominator, "denominator", "coefficients", ModelError)
        object.__setattr__(self, "numerators", tuple(tuple(row) for row in parts))
        Transfer([1], below)  # names a leading 0, and what is no number
        object.__setattr__(self, "denominator", tuple(below))
        self.fixed(1.0)

    def fixed(self, Ts: float, order: int | None = None) -> Fixed:
        """Take the basis that the numerators make."""
        rows = [_fractions(row) for row in self.numerators]
        names = tuple(f"k{i}" for i in range(1, len(rows) + 1))
        return _over(_fractions(self.denominator), rows, names)


def _fractions(given: Sequence[float]) -> Exact:
    return Transfer(given, [1]).numerator


def _over(known: Exact, rows: Sequence[Exact], names: tuple[str, ...]) -> Fixed:
    size = max(len(row) for row in rows)
    if len(rows) != size:
        raise ModelError(
            f"numerators: found {len(rows)} polynomials with up to {size} coefficients, expected "
            "as many polynomials as coefficients: otherwise take LTI, and read what you need "
            "off its intervals"
        )
    basis = np.array([[float(c) for c in row] + [0.0] * (size - len(row)) for row in rows]).T
    if np.linalg.matrix_rank(basis) < size:
        raise ModelError("numerators: found dependent polynomials, expected independent ones")
    return Fixed(TransferFunction(0, size), known, 0, names, basis)


def is_class(given: Any) -> bool:
    """Check for an object of a class of controllers."""
    return isinstance(given, Controller)
