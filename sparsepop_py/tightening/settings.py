"""Settings of bound tightening by linear and by semidefinite programs (OBBT)."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["OBBT", "ObbtSettings"]


@dataclass(frozen=True)
class ObbtSettings:
    """Settings of bound tightening (OBBT): numbers of experience.

    They decide which bounds are worth a solve, never whether a bound is valid. Numbers without
    another source are rules of thumb, chosen on identification records.

    Parameters
    ----------
    small_multiplier : float
        Multipliers this small against the largest are left out.
    lp_sweeps : int
        Sweeps of propagation after linear programs moved bounds.
    lp_worth : float
        Share of a width that the solution of a linear program must gain to be kept.
    lp_gained : float
        Share of a width: another round by linear programs follows where one fell below
        it.
    accuracy : float
        Accuracy of a solver, in scaled units: bounds of boxes need no more.
    rough_accuracy : float
        The same for a solver whose gap is that of its safe value.
    iterations : int
        Iterations: a solve that has not ended by then has a bound that is good enough.
    beyond : float
        Share of a width beyond the other end at which a bound proves enough.
    touched : float
        Share of a width: a side that a point comes this near is left out.
    worth : float
        Share of a width that a semidefinite relaxation must gain to be kept.
    short : float
        Share of its gain that shorter multipliers may lose.
    sdp_sweeps : int
        Sweeps of propagation after a semidefinite relaxation moved a bound.
    """

    small_multiplier: float = 1e-9
    lp_sweeps: int = 3
    lp_worth: float = 1e-3
    lp_gained: float = 0.8
    accuracy: float = 1e-5
    rough_accuracy: float = 5e-3
    iterations: int = 30
    beyond: float = 0.1
    touched: float = 0.1
    worth: float = 0.01
    short: float = 0.01
    sdp_sweeps: int = 2


OBBT = ObbtSettings()
