"""Conditions of the small-gain theorem, decided in exact rationals as far as that is possible.

With Delta = M - F P and F = K (1 - M), 1 - Delta = (1 - M) (1 + K P) holds for every plant P. The
controller K then stabilises P if

1. the ideal controller stabilises P, for which M has to be stable,
2. Delta is stable: zeros of 1 - M cancel the poles of K outside the unit disc and those that P
   has at z = 1, and the rest of P is stable,
3. max abs(Delta) < 1 on the unit circle.

K, M and the number of the plant's integrators decide the first, the second but for the rest of P,
and whether the third fails at z = 1 for every plant. For the rest see :mod:`.small_gain`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from setid.control.transfer import Transfer, is_schur

__all__ = ["Condition", "exact_conditions"]


@dataclass(frozen=True, slots=True)
class Condition:
    """One condition of a stability theorem, checked.

    Parameters
    ----------
    name : str
    holds : bool or None
        None where it is neither proved nor refuted.
    text : str
        Why.
    """

    name: str
    holds: bool | None
    text: str

    def __str__(self) -> str:
        word = {True: "holds", False: "fails", None: "open"}[self.holds]
        return f"{self.name}: {word}; {self.text}"


def exact_conditions(
    controller: Transfer, reference: Transfer, integrators: int
) -> tuple[tuple[Condition, Condition, Condition], Transfer]:
    """Decide the conditions in rationals; F = K (1 - M) takes the plant's integrators.

    Parameters
    ----------
    controller, reference : Transfer
        K and M.
    integrators : int
        Plant poles at exactly z = 1.

    Returns
    -------
    conditions : (Condition, Condition, Condition)
        Each fails or is open; that it holds is not decided here.
    factor : Transfer
        F, over (1 - q^-1) for each integrator.
    """
    factor = (controller * (1 - reference)).reduced()
    for _ in range(integrators):
        factor = Transfer(
            factor.numerator, _over_integrator(factor.denominator), factor.Ts
        ).reduced()
    first = _ideal(reference)
    second = _stable_delta(controller, reference, integrators, factor)
    bounded = first.holds is None and second.holds is None
    return (first, second, _below_one(reference, bounded and not sum(factor.numerator))), factor


def _ideal(reference: Transfer) -> Condition:
    stable = reference.is_stable()
    return Condition(
        "1 (the ideal controller stabilises the plant)",
        None if stable else False,
        "M is stable; that M contains the zeros of the plant outside the circle is not asked "
        "for: 1 - Delta = (1 - M) (1 + K P) holds for every P"
        if stable
        else "M is not stable",
    )


def _stable_delta(
    controller: Transfer, reference: Transfer, integrators: int, factor: Transfer
) -> Condition:
    count = _zeros_at_one((1 - reference).reduced())
    cancelled = _poles_cancel(controller, reference, integrators) and is_schur(factor.denominator)
    how = "is stable" if cancelled else "is not stable after exact cancellation"
    return Condition(
        "2 (Delta is stable)",
        None if cancelled else False,
        f"at z = 1: {controller.integrators} poles of K, {integrators} of P, {count} zeros of "
        f"1 - M; F = K (1 - M) {how}",
    )


def _below_one(reference: Transfer, zero: bool) -> Condition:
    """Refute the third condition where F is zero at z = 1 and abs(M) is 1 or more there."""
    rejected = zero and abs(_at_one(reference)) >= 1
    return Condition(
        "3 (max abs(Delta) < 1)",
        False if rejected else None,
        "at z = 1 F is zero, so that Delta = M there for every plant, and abs(M) >= 1; one "
        "more integrator of K changes that"
        if rejected
        else "not proved",
    )


def _poles_cancel(controller: Transfer, reference: Transfer, integrators: int) -> bool:
    """Check that zeros of 1 - M cancel all unstable poles of K.

    A zero of K at z = 1 must not stand in for one of 1 - M: it would hide the plant's
    integrator from Delta, but not from the loop.
    """
    open_loop = (1 - reference).reduced().numerator
    poles = list(controller.denominator)
    for _ in range(integrators):
        poles = _over_integrator(poles)
    return is_schur(Transfer(open_loop, poles).reduced().denominator)


def _over_integrator(denominator: Sequence[Fraction]) -> list[Fraction]:
    found = [*denominator, Fraction(0)]
    return [a - b for a, b in zip(found, [Fraction(0), *denominator], strict=True)]


def _at_one(system: Transfer) -> Fraction:
    """Gain at z = 1 of a stable system."""
    return sum(system.numerator, Fraction(0)) / sum(system.denominator, Fraction(0))


def _zeros_at_one(system: Transfer) -> int:
    """Number of zeros at exactly z = 1."""
    if not any(system.numerator):
        return 0
    return Transfer(system.denominator, _shifted(system.numerator), system.Ts).integrators


def _shifted(polynomial: Sequence[Fraction]) -> list[Fraction]:
    first = next(i for i, c in enumerate(polynomial) if c)
    return list(polynomial[first:])
