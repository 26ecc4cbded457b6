"""Settings of the search over relaxations."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["STRATEGY", "StrategySettings"]


@dataclass(frozen=True)
class StrategySettings:
    """Settings of the search over relaxations: numbers of experience.

    They decide what is tried first and how long, never whether a bound is valid. Numbers without
    another source are rules of thumb, chosen on the benchmark families (pooling, bilinear,
    polynomial and identification problems).

    Parameters
    ----------
    nodes_per_effort : float
        Nodes that branch and bound is expected to need, over ``SharedState.effort``.
    least_slice, slice_seconds : float
        Least and most seconds that a tree grows before relaxations are considered again.
    tree_before : float
        Share of a long relaxation's expected seconds that a tree has before it.
    over_time : float
        Times the time left: relaxations expected to take longer are left out.
    stopped_program : float
        The same for the first linear program, whose prices prove something at any time.
    patience_nodes : int
        Nodes after which linear programs alone are not trusted to close the gap.
    idle_nodes : int
        Nodes without gain, at least, that end a tree which neither a limit nor a closed gap can.
    sweeps : int
        Sweeps of propagation after a step that tightened the box.
    obbt_rounds : int
        Rounds of OBBT by linear programs for one objective.
    poor_cutoff : float
        Share of the gap: an attained value that falls by more was a poor cutoff.
    smaller_box : float
        Share of a width: in a smaller box relaxations are worth solving again.
    shared_obbt_rounds : int
        Rounds of OBBT by linear programs for the box that all objectives share.
    most_shared_variables : int
        Variables whose bounds linear programs tighten for all objectives, at most.
    window : int
        Constraints that linear programs start with where few variables complicate many.
    gained : float
        Share of a width: another round of OBBT follows where one fell below it.
    before_squares : int
        Steps of an objective before it is bounded on the whole space.
    long_first : float
        Expected seconds of the first step beyond which that bound comes before it.
    turn : int
        Steps of an objective before it is the next one's turn.
    worth_turn : float
        Share of a gap: a step that leaves more of it ends the turn of its objective, and a tree on
        a working set that does gains little.
    rounding : float
        Gaps this small, of values near 1, are closed: a few units of rounding.
    room : float
        Gaps that count as closed: an objective that is a variable within no more of them has so
        much room beyond its bounds in semidefinite relaxations.
    order_rounds : int
        Rounds of one order while the attained value improves.
    many_variables : int
        Variables from which a closed gap ends the work at once.
    more_orders : int
        Orders above the first that are tried at most without a finite box.
    most_tightened : int
        Variables whose bounds linear programs tighten at the root, at most.
    obbt_too_slow : float
        OBBT that takes this many times as long as the next relaxation is left out.
    branching_gain : float
        Share of a gap, on a logarithmic scale, that a node closes in the time of an LP.
    cheap : float
        Expected seconds up to which the next relaxation order comes before local searches from
        more starts, before branching and before higher orders.
    sure : float
        Share of the time left: what is expected to take more may not end in time.
    weak_share : float
        Expected progress up to which a relaxation counts as weak.
    few_variables : int
        Branching variables up to which semidefinite relaxations tighten bounds: two
        solves each.
    long_problem : int
        Constraints beyond which linear programs take longer than star relaxations do.
    telling : float
        Seconds, measured or expected, from which a relaxation tells how fast solvers are.
    weak_tree : float
        Share of the gap of a tree: where a relaxation of the root leaves less, another tree is
        grown.
    working_set : int
        Constraints from which an objective is bounded on a working set of them.
    most_working, most_of_few : float
        Share of the constraints in a working set, at most: where the star of all takes long, and
        where it does not.
    binding, missing : float
        Share of the largest price: constraints with less are left out of a working set at first,
        and later of those that join it.
    tight : float
        Gap, in gaps that count as closed, from which down the point of a relaxation on a working
        set tells which constraints are missing, and its turn goes on; and that does not yet ask for
        a tighter box of all objectives.
    wider : float
        Multiple of its size to which a working set grows where its tree gains little.
    working_rounds : int
        Local searches after which constraints are added to a working set, at most.
    working_slice : float
        Seconds that a tree on a working set grows before relaxations are considered again.
    medium_star, long_star : float
        Expected seconds of a star relaxation from which working sets are worth their local
        searches: where constraints are costly, and in any case.
    costly_row : float
        Expected seconds of a star relaxation for each of its constraints, where these are costly.
    worth_set : float
        Progress that sets of other objectives have made at once, in the mean, where an objective
        begins with a set though the star of all is not long.
    whole_star : float
        Seconds of a working set, in those of the star on all constraints, after which that star
        comes first.
    """

    nodes_per_effort: float = 4.0
    least_slice: float = 0.1
    slice_seconds: float = 3.0
    tree_before: float = 0.1
    over_time: float = 2.0
    stopped_program: float = 20.0
    patience_nodes: int = 300
    idle_nodes: int = 500
    sweeps: int = 3
    obbt_rounds: int = 3
    poor_cutoff: float = 0.5
    smaller_box: float = 0.7
    shared_obbt_rounds: int = 4
    most_shared_variables: int = 24
    window: int = 40
    gained: float = 0.8
    before_squares: int = 1
    long_first: float = 0.5
    turn: int = 5
    worth_turn: float = 0.5
    rounding: float = 1e-12
    room: float = 5.0
    order_rounds: int = 3
    many_variables: int = 300
    more_orders: int = 6
    most_tightened: int = 12
    obbt_too_slow: float = 3.0
    branching_gain: float = 0.1
    cheap: float = 0.1
    sure: float = 0.5
    weak_share: float = 0.3
    few_variables: int = 12
    long_problem: int = 300
    telling: float = 0.05
    weak_tree: float = 0.1
    working_set: int = 40
    most_working: float = 0.6
    most_of_few: float = 0.8
    binding: float = 1e-3
    missing: float = 0.1
    tight: float = 10.0
    wider: float = 1.5
    working_rounds: int = 8
    working_slice: float = 1.5
    medium_star: float = 0.6
    long_star: float = 2.5
    costly_row: float = 0.01
    worth_set: float = 0.7
    whole_star: float = 3.0


STRATEGY = StrategySettings()
