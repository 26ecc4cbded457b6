"""Static maps: known functions of some signals, in a sum with unknown coefficients."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import MOST_TERMS, asked, entries_of, natural, real_array
from setid.errors import ModelError

__all__ = ["Function", "StaticMap"]

Reals = NDArray[np.float64]
Powers = tuple[int, ...]  # one exponent an argument
Function = Callable[..., Any]


@dataclass(frozen=True, slots=True, init=False)
class StaticMap:
    """w(k) = sum_m gamma_m phi_m(x(k)), with the basis functions phi_m known.

    Parameters
    ----------
    arguments : str or sequence of str
        The signals x: measured (``"u1"``, ``"y1"``) or internal.
    basis : int or sequence
        A number M stands for the powers x, x^2, ..., x^M of a single argument. Otherwise one
        entry a function: a power, exponents of all arguments such as ``(1, 2)`` for
        x1 x2^2, or a function of arrays (N,), one an argument. Functions that are not
        powers need inputs that are known exactly.

    Raises
    ------
    ModelError
        Naming the entry.

    Examples
    --------
    >>> from setid.models.block import StaticMap
    >>> StaticMap("u1", 3).basis
    ((1,), (2,), (3,))
    >>> StaticMap(["u1", "u2"], [(1, 0), (1, 1)]).text(1)
    'u1*u2'
    """

    arguments: tuple[str, ...]
    basis: tuple[Powers | Function, ...]

    def __init__(self, arguments: str | Sequence[str], basis: int | Sequence[Any]) -> None:
        given = [arguments] if isinstance(arguments, str) else arguments
        names = tuple(entries_of(given, "StaticMap.arguments", "names of signals", ModelError))
        texts = all(isinstance(n, str) for n in names)
        if not names or not texts or len(set(names)) != len(names):
            raise ModelError(
                f"StaticMap.arguments: found {arguments!r}, expected distinct signal names"
            )
        object.__setattr__(self, "arguments", names)
        entries: Any = basis
        if isinstance(basis, (int, np.integer)) and not isinstance(basis, bool):
            if len(names) > 1:
                raise ModelError(
                    f"StaticMap.basis: found {basis} for {len(names)} arguments, expected "
                    "exponents such as [(1, 0), (1, 1)]"
                )
            entries = range(
                1, natural(basis, "StaticMap.basis", ModelError, least=1, most=MOST_TERMS) + 1
            )
        if isinstance(entries, (str, bytes)):
            raise ModelError(
                f"StaticMap.basis: found {basis!r}, expected a number of powers or a list"
            )
        entries = entries_of(entries, "StaticMap.basis", "a number or a list", ModelError)
        read = tuple(self._entry(item, place) for place, item in enumerate(entries))
        if not read or len(set(read)) != len(read):
            raise ModelError(
                f"StaticMap.basis: found {len(read)} functions, {len(set(read))} of them "
                "distinct, expected at least one and no repetition"
            )
        object.__setattr__(self, "basis", read)

    def _entry(self, item: Any, place: int) -> Powers | Function:
        if callable(item):
            return item
        field = f"StaticMap.basis[{place}]"
        powers = tuple(item) if isinstance(item, (tuple, list)) else (item,)
        if len(powers) != len(self.arguments):
            raise ModelError(
                f"{field}: found {item!r}, expected {len(self.arguments)} exponents or a function"
            )
        found = tuple(natural(power, field, ModelError, most=MOST_TERMS) for power in powers)
        return found

    @property
    def polynomial(self) -> bool:
        """True if all basis functions are powers and products."""
        return not any(callable(item) for item in self.basis)

    def text(self, place: int) -> str:
        """Write a basis function for people.

        Parameters
        ----------
        place : int
            Number of the basis function, from 0.
        """
        item = self.basis[natural(place, "place", ModelError, most=len(self.basis) - 1)]
        if callable(item):
            name = getattr(item, "__name__", "phi")
            label = name if name.isidentifier() else f"phi{place + 1}"
            return f"{label}({', '.join(self.arguments)})"
        factors = [
            name if power == 1 else f"{name}^{power}"
            for name, power in zip(self.arguments, item, strict=True)
            if power
        ]
        return "*".join(factors) or "1"

    def value(self, place: int, *arguments: Reals) -> Reals:
        """Evaluate a basis function at samples of its arguments.

        Parameters
        ----------
        place : int
            Number of the function, from 0.
        *arguments : (N,) float

        Raises
        ------
        ModelError
            If a given function does not return one finite number a sample.
        """
        item, shape = self.basis[place], np.shape(arguments[0])
        if not callable(item):
            found = np.ones(shape)
            for values, power in zip(arguments, item, strict=True):
                for _ in range(power):
                    found = found * values
            return found
        known = ~np.any(np.isnan(arguments), axis=0)
        found = np.full(shape, np.nan)
        field, samples = f"StaticMap.basis[{place}]", [np.asarray(a)[known] for a in arguments]
        returned = asked(field, lambda: item(*samples), ModelError)
        values = real_array(returned, f"{field}: value", ModelError)
        if values.shape != found[known].shape or not np.all(np.isfinite(values)):
            raise ModelError(
                f"{field}: found values of shape {values.shape}, finite: "
                f"{bool(np.all(np.isfinite(values)))}; expected one finite number a sample"
            )
        found[known] = values
        return found
