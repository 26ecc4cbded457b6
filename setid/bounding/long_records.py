"""Tell long records of noisy outputs, which are simulated first."""

from __future__ import annotations

from setid.formulation.formulation import Formulation, count_equations
from setid.proofs.simulated.outputs import Recursion, recursion_of

__all__ = ["is_long", "long_record"]

_MANY = 200  # equations beyond which records of noisy outputs are simulated first


def is_long(formulation: Formulation) -> bool:
    """Check for more equations than the engine takes at once without a point to begin with.

    Parameters
    ----------
    formulation : Formulation
    """
    return count_equations(formulation) > _MANY


def long_record(formulation: Formulation) -> Recursion | None:
    """State a long record of noisy outputs as a simulation; None for other records.

    Parameters
    ----------
    formulation : Formulation
    """
    return recursion_of(formulation) if is_long(formulation) else None
