"""Model structures by name: one file and one line add one.

A structure is any frozen class with what :class:`setid.models.equations.Structure` asks for;
:func:`setid.formulate` takes it as it is. Registered structures are also known by name to
:func:`setid.select` and to the command line, by what they are at an order and a degree.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from setid.data.checks import FrozenMapping, asked
from setid.errors import ModelError
from setid.models.checked_structures import check_structure
from setid.models.equations import Structure
from setid.models.lti import TransferFunction
from setid.models.narx import PolynomialNARX

__all__ = ["Family", "families", "family_of", "register_structure"]


class Family(Protocol):
    """Structures of one kind, one for each order and degree."""

    def __call__(self, order: int, degree: int, inputs: int, outputs: int) -> Structure:
        """Make the structure of an order and a degree for the channels of a record."""
        ...


_FAMILIES: dict[str, tuple[type, Family]] = {}


def register_structure(kind: type, family: Family) -> None:
    """Make a model structure known by the name of its class.

    Parameters
    ----------
    kind : type
        The class of the structure.
    family : callable (order, degree, inputs, outputs) -> structure
        What the structure is at an order and a degree; raises ``ModelError`` where there is
        none.

    Raises
    ------
    ModelError
        If the name belongs to another class, it is none, or nothing makes structures of it.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import setid
    >>> from setid.models.equations import Equation, Lagged, Structure, Term, Transfer
    >>> @dataclass(frozen=True)
    ... class Average:  # y_k = c (u_k + ... + u_(k-n)) / (n + 1)
    ...     order: int
    ...     inputs = outputs = 1
    ...     initial = "free"
    ...     parameters = ("c",)
    ...
    ...     def equations(self, noisy=()):
    ...         share = -1.0 / (self.order + 1)
    ...         terms = [Term(share, ("c",), (Lagged("u1", i),)) for i in range(self.order + 1)]
    ...         return (Equation("y1", (Term(1.0, (), (Lagged("y1"),)), *terms), error=True),)
    ...
    ...     def regression(self):
    ...         return self.equations()
    ...
    ...     def transfer(self, output, input):
    ...         raise setid.ModelError("model: one coefficient for all lags")
    >>> setid.register_structure(Average, lambda order, degree, inputs, outputs: Average(order))
    >>> data = setid.IOData([1, 3, 2, 4, 2], [0.0, 4.1, 5.0, 6.0, 5.9])
    >>> found = setid.select(data, "Average", setid.Noise(equation=0.2), orders=[0, 1])
    >>> found.chosen.order, found.result.intervals["c"].status == "certified"
    (1, True)
    """
    if not isinstance(kind, type) or not callable(family):
        raise ModelError(
            f"register_structure: found {type(kind).__name__} and {type(family).__name__}, "
            "expected a class and a function (order, degree, inputs, outputs) -> structure"
        )
    known = _FAMILIES.get(kind.__name__)
    if known is not None and known[0] is not kind and known[0].__module__ != kind.__module__:
        raise ModelError(
            f"register_structure: found {kind.__name__!r}, which is {known[0].__module__}."
            f"{kind.__name__} already; expected another name"
        )
    _FAMILIES[kind.__name__] = (kind, _named(kind.__name__, family))


def _named(name: str, family: Family) -> Family:
    """Wrap a family: name it in what it raises, and check what it makes."""

    def made(order: int, degree: int, inputs: int, outputs: int) -> Structure:
        place = f"structure {name!r} of order {order} and degree {degree}"
        found = asked(place, lambda: family(order, degree, inputs, outputs), ModelError)
        check_structure(found)
        return found

    return made


def families() -> Mapping[str, Family]:
    """List the registered structures by name.

    Examples
    --------
    >>> "TransferFunction" in families()
    True
    """
    return FrozenMapping({name: family for name, (_, family) in _FAMILIES.items()})


def family_of(kind: str | type) -> Family | None:
    """Find the family of a structure by its class or name; None for others.

    Parameters
    ----------
    kind : str or type

    Raises
    ------
    ModelError
        If no structure has this name.
    """
    if isinstance(kind, str):
        if kind not in _FAMILIES:
            raise ModelError(f"family: found {kind!r}, expected one of {', '.join(_FAMILIES)}")
        return _FAMILIES[kind][1]
    return next((family for known, family in _FAMILIES.values() if known is kind), None)


def _transfer_functions(order: int, degree: int, inputs: int, outputs: int) -> Structure:
    return TransferFunction(order, order + 1, 0, inputs, outputs)


def _polynomial_regressions(order: int, degree: int, inputs: int, outputs: int) -> Structure:
    return PolynomialNARX.full(degree, order, order, inputs, outputs)


register_structure(TransferFunction, _transfer_functions)
register_structure(PolynomialNARX, _polynomial_regressions)
