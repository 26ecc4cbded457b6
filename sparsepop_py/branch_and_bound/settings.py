"""Settings of branch and bound."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["BRANCHING", "LINEAR_TREE", "BranchSettings", "LinearTreeSettings"]


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
        OBBT aims at widths with which the bound errs by this share of what would fathom the node.
    nearly : float
        A node is branched and not tightened where larger shares of the widths would fathom it.
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
    again: float = 0.8
    error_share: float = 0.5
    nearly: float = 0.2
    middle: float = 0.4
    prior_left: float = 0.8
    useless_lp: float = 0.93
    useless_sdp: float = 0.85
    edge: float = 0.2


BRANCHING = BranchSettings()


@dataclass(frozen=True)
class LinearTreeSettings:
    """Settings of trees of linear programs: numbers of experience.

    They decide how long such a tree is tried, never whether a bound is valid. Chosen on small
    problems of GLOBALLib.

    Parameters
    ----------
    most_variables, most_constraints : int
        Sizes up to which such a tree is tried.
    most_nodes, most_columns : int
        Nodes after which it is given up, and columns of all their programs.
    larger : int
        Multiple of these sizes up to which a problem may be where branches decide all that is
        not convex.
    most_decisions : int
        Nodes after which the tree of such a problem is given up.
    time_share : float
        Share of the time left that such a tree may take; its proof needs the rest.
    patience : int
        Number of nodes from which on a tree that progresses too slowly is given up.
    pace : float
        Least share of the gap closed, or of leaves fathomed, in units of nodes / most_nodes.
    margin : float
        Share of the allowed gap by which leaves exceed the cutoff: rounding of their proofs.
    node_work : float
        Units of work of a node beside its programs, see :mod:`sparsepop_py.budget`.
    root_rounds, rounds : int
        Rounds of propagation, program and tightening of the root, and of other nodes.
    first_sweeps : int
        Sweeps of propagation before the tree, where bounds are infinite.
    start_sweeps : int
        Sweeps in plain doubles for a box of starts.
    root_sweeps, sweeps : int
        Sweeps of propagation a round, of the root and of other nodes.
    worth : float
        Share of a width: propagation that leaves more of every width is not kept.
    infeasible : float
        Least value that a ray of infeasibility proves of 0, with multipliers up to 1.
    search_share : float
        Share of the work that local searches may have taken before another one.
    searched : tuple of int
        Numbers of the nodes with a local search, from 1.
    search_round : int
        Round of tightening at the root that a local search comes before.
    worth_a_search : float
        Share of the allowed gap that a nearly feasible solution must gain for a local search.
    feasible : float
        Violation up to which a solution is nearly feasible.
    cut_rounds, most_cuts : int
        Rounds of cuts of convex rows at the root, and cuts in all.
    quadratic_work : float
        Units of work of a convex quadratic program.
    gained, again : float
        Share of a width: reduced costs that leave less are kept, or ask for another round.
    most_tightened : int
        Variables up to which linear programs tighten the bounds of the root.
    obbt_rounds : int
        Rounds of these.
    touched, least_gain : float
        Shares of half a width: a bound this near to a solution is left out, and so is a gain
        below.
    obbt_again : float
        Share of a width: another round follows where one left less.
    slack : float
        Share of half a width that claims leave for the rounding of their proofs.
    others : float
        Preference of variables that are not needed to cover all products, in branching.
    undecided : float
        Share of its width by which a variable of two values misses both, to be branched first.
    apart : float
        Share of its range by which each of two factors with product zero is positive, to be
        branched before all others.
    positive : float
        Branching point of such a variable, where the other factor is a variable: less counts as
        zero.
    step, zero : float
        Branching point as a share of the upper end, where the other factor is a row; share of
        the first width below which such a variable counts as zero.
    middle : float
        Weight of the middle of the interval in the branching point.
    edge : float
        Share of the width that a branching point keeps from both ends.
    """

    most_variables: int = 60
    most_constraints: int = 120
    most_nodes: int = 60
    most_columns: int = 3000
    larger: int = 6
    most_decisions: int = 5_000
    time_share: float = 0.8
    patience: int = 12
    pace: float = 0.9
    margin: float = 0.03
    node_work: float = 1e-3
    root_rounds: int = 16
    rounds: int = 2
    first_sweeps: int = 4
    start_sweeps: int = 20
    root_sweeps: int = 3
    sweeps: int = 2
    worth: float = 0.9
    infeasible: float = 1e-7
    search_share: float = 0.4
    searched: tuple[int, ...] = (1, 4, 16, 64)
    search_round: int = 2
    worth_a_search: float = 0.5
    feasible: float = 1e-5
    cut_rounds: int = 8
    most_cuts: int = 30
    quadratic_work: float = 5e-3
    gained: float = 0.9
    again: float = 0.6
    most_tightened: int = 24
    obbt_rounds: int = 8
    touched: float = 0.1
    least_gain: float = 0.02
    obbt_again: float = 0.8
    slack: float = 1e-6
    others: float = 0.3
    undecided: float = 0.1
    apart: float = 1e-7
    positive: float = 2.0**-200
    step: float = 2.0**-16
    zero: float = 2.0**-30
    middle: float = 0.4
    edge: float = 0.2


LINEAR_TREE = LinearTreeSettings()
