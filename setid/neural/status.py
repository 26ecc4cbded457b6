"""Statuses of proved statements about networks, and records with the numbers they rest on."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from setid import ParameterInterval, Verification

__all__ = ["Status", "agreed", "same_intervals"]


class Status(StrEnum):
    """Outcome of a proof; ``message`` says what it means.

    Examples
    --------
    >>> from setid import neural
    >>> neural.Status.OPEN.message
    'The condition fails or nothing finite was proved: this says nothing against the claim.'
    """

    PROVED = "proved"
    PARTIAL = "partial"
    EMPTY = "empty"
    STABLE = "stable"
    OPEN = "open"
    ATTAINED = "attained"

    @property
    def message(self) -> str:
        """One sentence of help."""
        return _MESSAGES[self]


_MESSAGES = {
    Status.PROVED: "Proved and attained ends agree within the tolerance.",
    Status.PARTIAL: "The outer ends are proved, but not attained within the tolerance.",
    Status.EMPTY: "It is proved that nothing explains the record: raise the bound or the width.",
    Status.STABLE: "The network is proved incrementally stable over the inputs that are listed.",
    Status.ATTAINED: "A local solver attained the value; nothing is proved of its optimality.",
    Status.OPEN: (
        "The condition fails or nothing finite was proved: this says nothing against the claim."
    ),
}


def agreed(*claims: tuple[bool, str]) -> Verification:
    """Make a verdict of checks and what each failure means.

    Examples
    --------
    >>> agreed((True, "a"), (False, "b is wrong"))
    Verification(ok=False, reason='b is wrong')
    """
    for holds, reason in claims:
        if not holds:
            return Verification(False, reason)
    return Verification(True)


def same_intervals(
    stated: Mapping[str, ParameterInterval], proved: Mapping[str, ParameterInterval]
) -> bool:
    """Check that intervals have the same names, ends, statuses and witnesses.

    Examples
    --------
    >>> from setid import IntervalStatus
    >>> wide = ParameterInterval("b", (0.0, 2.0), None, IntervalStatus.PARTIAL)
    >>> same_intervals({"b": wide}, {"b": wide}), same_intervals({"b": wide}, {})
    (True, False)
    """
    return stated.keys() == proved.keys() and all(
        (one.name, one.outer, one.inner, one.status, one.witnesses)
        == (name, proved[name].outer, proved[name].inner, proved[name].status, (None, None))
        for name, one in stated.items()
    )
