"""Settings of the search over relaxations: numbers of experience.

They decide what is tried first and how long, never whether a bound is valid. Numbers without
another source are rules of thumb, chosen on the benchmark families (pooling, bilinear,
polynomial and identification problems).
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = [
    "BOUND_TIGHTENING",
    "STRATEGY",
    "TREE",
    "WORKING_SET",
    "BoundTighteningSettings",
    "StrategySettings",
    "TreeSettings",
    "WorkingSetSettings",
]


@dataclass(frozen=True)
class StrategySettings:
    """Settings of the order of relaxations and of turns of objectives.

    Parameters
    ----------
    most_overtime : float
        Times the time left: relaxations expected to take longer are left out.
    program_overtime : float
        The same as ``most_overtime`` for the first linear program, whose prices prove something at
        any time.
    propagation_sweeps : int
        Sweeps of propagation after a step that tightened the box.
    poor_cutoff_share : float
        Share of the gap: an attained value that falls by more was a poor cutoff.
    smaller_box_share : float
        Share of a width: in a smaller box relaxations are worth solving again.
    steps_before_squares : int
        Steps of an objective before it is bounded on the whole space.
    share_before_squares : float
        Share of the time for relaxations without a finite box, where such a bound may follow.
    long_first_seconds : float
        Expected seconds of the first step beyond which that bound comes before it.
    turn_steps : int
        Steps of an objective before it is the next one's turn.
    little_gain_share : float
        Share of a gap: a step that leaves more of it ends the turn of its objective, and a tree on
        a working set that does gains little.
    rounding_gap : float
        Gaps this small, of values near 1, are closed: a few units of rounding.
    objective_room : float
        Gaps that count as closed: an objective that is a variable within no more of them has so
        much room beyond its bounds in semidefinite relaxations.
    order_rounds : int
        Rounds of one order while the attained value improves.
    many_variables : int
        Variables from which a closed gap ends the work at once.
    more_orders : int
        Orders above the first that are tried at most without a finite box.
    cheap_seconds : float
        Expected seconds up to which the next relaxation order comes before local searches from
        more starts, before branching and before higher orders.
    sure_time_share : float
        Share of the time left: what is expected to take more may not end in time.
    weak_progress : float
        Expected progress up to which a relaxation counts as weak.
    few_variables : int
        Branching variables up to which semidefinite relaxations tighten bounds: two
        solves each.
    long_problem_constraints : int
        Constraints beyond which linear programs take longer than star relaxations do.
    telling_seconds : float
        Seconds, measured or expected, from which a relaxation tells how fast solvers are.
    small_gap_ratio : float
        Gap, in gaps that count as closed, from which down the point of a relaxation on a working
        set tells which constraints are missing, and its turn goes on; and that does not yet ask for
        a tighter box of all objectives.
    """

    most_overtime: float = 2.0
    program_overtime: float = 20.0
    propagation_sweeps: int = 3
    poor_cutoff_share: float = 0.5
    smaller_box_share: float = 0.7
    steps_before_squares: int = 1
    share_before_squares: float = 0.5
    long_first_seconds: float = 0.5
    turn_steps: int = 5
    little_gain_share: float = 0.5
    rounding_gap: float = 1e-12
    objective_room: float = 5.0
    order_rounds: int = 3
    many_variables: int = 300
    more_orders: int = 6
    cheap_seconds: float = 0.1
    sure_time_share: float = 0.5
    weak_progress: float = 0.3
    few_variables: int = 12
    long_problem_constraints: int = 300
    telling_seconds: float = 0.05
    small_gap_ratio: float = 10.0


@dataclass(frozen=True)
class TreeSettings:
    """Settings of the branch-and-bound tree beside relaxations of the root.

    Parameters
    ----------
    nodes_per_effort : float
        Nodes that branch and bound is expected to need, over ``SharedState.effort``.
    shortest_slice : float
        Least seconds that a tree grows before relaxations are considered again.
    longest_slice : float
        Most seconds that a tree grows before relaxations are considered again.
    share_before_relaxation : float
        Share of a long relaxation's expected seconds that a tree has before it.
    patience_nodes : int
        Nodes after which linear programs alone are not trusted to close the gap.
    idle_nodes : int
        Nodes without gain, at least, that end a tree which neither a limit nor a closed gap can.
    node_gain : float
        Share of a gap, on a logarithmic scale, that a node closes in the time of an LP.
    weak_gap_share : float
        Share of the gap of a tree: where a relaxation of the root leaves less, another tree is
        grown.
    """

    nodes_per_effort: float = 4.0
    shortest_slice: float = 0.1
    longest_slice: float = 3.0
    share_before_relaxation: float = 0.1
    patience_nodes: int = 300
    idle_nodes: int = 500
    node_gain: float = 0.1
    weak_gap_share: float = 0.1


@dataclass(frozen=True)
class BoundTighteningSettings:
    """Settings of bound tightening by linear programs (OBBT).

    Parameters
    ----------
    rounds : int
        Rounds of OBBT by linear programs for one objective.
    shared_rounds : int
        Rounds of OBBT by linear programs for the box that all objectives share.
    most_shared_variables : int
        Variables whose bounds linear programs tighten for all objectives, at most.
    first_constraints : int
        Constraints that linear programs start with where few variables complicate many.
    repeat_below : float
        Share of a width: another round of OBBT follows where one fell below it.
    most_variables : int
        Variables whose bounds linear programs tighten at the root, at most.
    too_slow : float
        OBBT that takes this many times as long as the next relaxation is left out.
    """

    rounds: int = 3
    shared_rounds: int = 4
    most_shared_variables: int = 24
    first_constraints: int = 40
    repeat_below: float = 0.8
    most_variables: int = 12
    too_slow: float = 3.0


@dataclass(frozen=True)
class WorkingSetSettings:
    """Settings of searches on working sets of constraints.

    Parameters
    ----------
    least_constraints : int
        Constraints from which an objective is bounded on a working set of them.
    largest_share : float
        Share of the constraints in a set, at most, where the star of all takes long.
    largest_share_short : float
        The same where the star of all does not take long.
    binding_price : float
        Share of the largest price: constraints with less are left out of a set at first.
    joining_price : float
        Share of the largest price: constraints with less do not join a set later.
    growth : float
        Multiple of its size to which a working set grows where its tree gains little.
    most_searches : int
        Local searches after which constraints are added to a working set, at most.
    longest_slice : float
        Seconds that a tree on a working set grows before relaxations are considered again.
    medium_star_seconds : float
        Expected seconds of a star relaxation from which sets are worth their local searches where
        constraints are costly.
    long_star_seconds : float
        Expected seconds of a star relaxation from which sets are worth them in any case.
    costly_constraint_seconds : float
        Expected seconds of a star relaxation for each of its constraints, where these are costly.
    least_progress : float
        Progress that sets of other objectives have made at once, in the mean, where an objective
        begins with a set though the star of all is not long.
    star_seconds_before_whole : float
        Seconds of a working set, in those of the star on all constraints, after which that star
        comes first.
    """

    least_constraints: int = 40
    largest_share: float = 0.6
    largest_share_short: float = 0.8
    binding_price: float = 1e-3
    joining_price: float = 0.1
    growth: float = 1.5
    most_searches: int = 8
    longest_slice: float = 1.5
    medium_star_seconds: float = 0.6
    long_star_seconds: float = 2.5
    costly_constraint_seconds: float = 0.01
    least_progress: float = 0.7
    star_seconds_before_whole: float = 3.0


STRATEGY = StrategySettings()
TREE = TreeSettings()
BOUND_TIGHTENING = BoundTighteningSettings()
WORKING_SET = WorkingSetSettings()
