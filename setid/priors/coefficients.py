"""Priors on single coefficients, and constraints of the user's own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from numbers import Real
from typing import Any

import sparsepop_py as sp
from setid.data.checks import FrozenMapping
from setid.errors import PriorError
from setid.models.checked_structures import check_structure
from setid.models.equations import Structure
from setid.priors.base import Facts, Interval, Plain, Symbols, finite, interval_of, items_of, stored

__all__ = ["Box", "Given", "Known", "Sign", "parameters"]


def parameters(model: Structure) -> Mapping[str, sp.Polynomial]:
    """Make polynomials of a model's parameters, for constraints of one's own.

    Parameters
    ----------
    model : Structure

    Returns
    -------
    mapping of str to Polynomial
        Comparisons of them are constraints, which :func:`formulate` takes among its priors.

    Raises
    ------
    ModelError
        If the model is no structure.

    Examples
    --------
    >>> import setid
    >>> p = setid.parameters(setid.TransferFunction(na=1, nb=1))
    >>> print(p["a1"] + p["b0"] <= 2)
    2 - a1 - b0 >= 0
    """
    check_structure(model)
    names = model.parameters
    return FrozenMapping(dict(zip(names, sp.variables(len(names), names), strict=True)))


@dataclass(frozen=True, slots=True)
class Given(Plain):
    """A constraint of the user's own on the parameters."""

    constraint: sp.Constraint

    def describe(self) -> str:
        """Print the constraint."""
        return str(self.constraint)

    def rows(self, model: Structure, x: Symbols, facts: Facts) -> list[sp.Constraint]:
        """State the constraint itself; the caller lifts it."""
        return [self.constraint]


@dataclass(frozen=True, slots=True)
class Box(Plain):
    """Intervals of parameters.

    Parameters
    ----------
    intervals : mapping of str to (low, high)
        From names of parameters to their ends, which belong to the interval. None or an infinity
        for an end that is not known.

    Raises
    ------
    PriorError
        If low > high, or an end is no number. :func:`formulate` refuses unknown names.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> model, noise = setid.TransferFunction(1, 1), setid.Noise(equation=0.5)
    >>> setid.identify(data, model, noise, [setid.Box({"b0": (None, 2)})]).intervals["b0"]
    b0 in [1.91666, 2], attained [1.91667, 2], certified
    """

    intervals: Mapping[str, tuple[float | None, float | None]]

    def __post_init__(self) -> None:
        stored(
            self, "intervals", {k: interval_of(v, k) for k, v in items_of(self.intervals, "Box")}
        )

    def bounds(self, model: Structure) -> Mapping[str, Interval]:
        """Take the intervals.

        Parameters
        ----------
        model : Structure
        """
        return {name: (low, high) for name, (low, high) in self.intervals.items()}  # type: ignore[misc]


@dataclass(frozen=True, slots=True)
class Known(Plain):
    """Parameters with known values.

    Parameters
    ----------
    values : mapping of str to float
        From names of parameters to their values, which are taken as exact.

    Raises
    ------
    PriorError
        If a value is no finite number. :func:`formulate` refuses unknown names.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> model, noise = setid.TransferFunction(1, 1), setid.Noise(equation=0.5)
    >>> setid.identify(data, model, noise, [setid.Known({"b0": 2.0})]).intervals["a1"]
    a1 in [-0.5, -0.371999], attained [-0.499999, -0.372], certified
    """

    values: Mapping[str, float]

    def __post_init__(self) -> None:
        values = {k: finite(v, k) for k, v in items_of(self.values, "Known")}
        stored(self, "values", values)

    def bounds(self, model: Structure) -> Mapping[str, Interval]:
        """Take intervals of no width.

        Parameters
        ----------
        model : Structure
        """
        return {name: (value, value) for name, value in self.values.items()}


@dataclass(frozen=True, slots=True)
class Sign(Plain):
    """Parameters with known signs (closed: zero is allowed).

    Parameters
    ----------
    signs : mapping of str to {"+", "-", 1, -1}
        From names of parameters to their signs.

    Raises
    ------
    PriorError
        If a sign is none of these. :func:`formulate` refuses unknown names.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> model, noise = setid.TransferFunction(1, 1), setid.Noise(equation=0.5)
    >>> setid.identify(data, model, noise, [setid.Sign({"a1": "+"})]).empty  # a1 is negative
    True
    """

    signs: Mapping[str, Any]

    def __post_init__(self) -> None:
        known = {"+": 1, "-": -1, 1: 1, -1: -1}
        items = items_of(self.signs, "Sign")
        for name, sign in items:
            kind = isinstance(sign, (str, Real)) and not isinstance(sign, bool)
            if not kind or sign not in known:
                raise PriorError(f"Sign[{name!r}]: found {sign!r}, expected '+', '-', 1 or -1")
        stored(self, "signs", {name: known[sign] for name, sign in items})

    def bounds(self, model: Structure) -> Mapping[str, Interval]:
        """Take half lines.

        Parameters
        ----------
        model : Structure
        """
        return {name: (0.0, inf) if s > 0 else (-inf, 0.0) for name, s in self.signs.items()}
