"""Settings of branch and bound."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["BRANCHING", "BranchSettings"]


@dataclass(frozen=True)
class BranchSettings:
    """Settings of branch and bound: numbers of experience.

    They decide the shape of the tree and the cost of a node, never whether a bound is valid.
    Numbers without another source are rules of thumb, chosen on bilinear problems and on
    identification records.

    Parameters
    ----------
    sweeps : int
        Sweeps of propagation over a node.
    node_work : float
        Units of work of a node beside its programs, see :mod:`sparsepop_py.budget`.
    obbt_rounds : int
        Rounds of OBBT by a semidefinite relaxation on one node.
    again : float
        Share of the widths: another round of OBBT follows where one left less.
    error_share : float
        Share of the error that a bound may have, aimed at; the rest is a margin.
    middle : float
        Weight of the middle of the interval in the branching point.
    prior_left : float
        Share of the widths that OBBT is expected to leave, before any was measured.
    useless_lp : float
        OBBT by linear programs that leaves this share on average is given up.
    useless_sdp : float
        The same for semidefinite relaxations, which take longer.
    edge : float
        Share of the width that a branching point keeps from both ends.
    """

    sweeps: int = 6
    node_work: float = 5e-3
    obbt_rounds: int = 6
    again: float = 0.7
    error_share: float = 0.5
    middle: float = 0.4
    prior_left: float = 0.8
    useless_lp: float = 0.93
    useless_sdp: float = 0.85
    edge: float = 0.2


BRANCHING = BranchSettings()
