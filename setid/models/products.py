"""Products of unknown samples as internal signals, so that rows stay bilinear."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Final

from setid.models.equations import Equation, Lagged, term

__all__ = ["PRODUCT", "cut_products"]

PRODUCT: Final = "p["  # how names of such signals begin
Monomial = tuple[Lagged, ...]


def cut_products(
    monomial: Monomial,
    unknown: Collection[str],
    products: dict[str, Equation],
    text: Callable[[Monomial], str],
) -> Monomial:
    """Replace the unknown part of a monomial by one internal signal.

    Parameters
    ----------
    monomial : tuple of Lagged
    unknown : collection of str
        Signals that are not known exactly.
    products : dict of str to Equation
        Definitions so far; those that are needed are added. Signals shifted in time share
        one definition.
    text : callable
        Names a monomial.
    """
    exact = [f for f in monomial if f.signal not in unknown]
    rest = [f for f in monomial if f.signal in unknown]
    if len(rest) < 2:
        return monomial
    prefix: Lagged = rest[0]
    spelled = [rest[0]]
    for factor in rest[1:]:
        spelled.append(factor)
        shift = min(f.lag for f in spelled)
        shifted = tuple(Lagged(f.signal, f.lag - shift) for f in spelled)
        name = f"{PRODUCT}{text(shifted)}]"
        left = Lagged(prefix.signal, prefix.lag - shift)
        right = Lagged(factor.signal, factor.lag - shift)
        if name not in products:
            terms = (term(1.0, "", Lagged(name)), term(-1.0, "", left, right))
            products[name] = Equation(name, terms)
        prefix = Lagged(name, shift)
    return (*exact, prefix)
