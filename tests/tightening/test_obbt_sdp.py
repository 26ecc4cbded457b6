"""OBBT by semidefinite relaxations: no point below the cutoff is lost, and boxes replay."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from loop_cases import star
from search_cases import processes, search_of, threads
from solved import check
from star_record import ENDS, feasible_points, least, record

import sparsepop_py as sp
from sparsepop_py import Options, Problem, Status
from sparsepop_py.branch_and_bound import node
from sparsepop_py.branch_and_bound.node import NodeSettings, process_node
from sparsepop_py.branch_and_bound.tree import SearchTree
from sparsepop_py.budget import Deadline
from sparsepop_py.context import SolveContext
from sparsepop_py.local_search.feasibility import prove_feasible
from sparsepop_py.presolve.initial_box import rounding_slack
from sparsepop_py.progress import Stages
from sparsepop_py.strategy.shared_state import SharedState
from sparsepop_py.tightening import obbt_sdp
from sparsepop_py.tightening.obbt_sdp import TightenedBox, tighten_by_relaxation
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.certificate.certificate import Certificate, Node, certify
from sparsepop_py.verified.certificate.sos_identity import Identity, Multipliers
from sparsepop_py.verified.certificate.steps import BoxProof, Known, Replay, Tightening, tighten


def shared_state_of(problem: Problem, **options) -> SharedState:
    return SharedState.of(problem, (problem.objective,), Options(effort="auto", **options))


def whole(problem: Problem) -> Interval:
    return Interval(problem.lower, problem.upper)


def below(problem: Problem, cutoff: float) -> Interval:
    """Propagate the cutoff over the whole box."""
    return tighten(Replay(problem, cutoff), whole(problem), 1)[0]


def one_round(problem: Problem, cutoff: float, stages: Stages | None = None, **how) -> TightenedBox:
    shared_state = shared_state_of(problem)
    assert shared_state.obbt_sdp is not None
    context = SolveContext(problem, Options(effort="auto"), stages or Stages(), Deadline(None))
    weights = dict.fromkeys(shared_state.variables, 1.0)
    spec = (shared_state.obbt_sdp, shared_state.cliques)
    return tighten_by_relaxation(
        context, Replay(problem, cutoff), below(problem, cutoff), spec, weights, **how
    )


def replayed(problem: Problem, cutoff: float, *steps, slack: float = 0.0) -> Interval:
    box = below(problem, cutoff)
    larger = Interval(box.lo - slack, box.hi + slack)
    return BoxProof(steps).replay(Replay(problem, cutoff), larger)


def planted(local: bool = False) -> tuple[Problem, SearchTree]:
    """A tree for the least b, before it grows."""
    problem = record()
    shared_state, points = shared_state_of(problem), feasible_points()
    best = points[np.argmin([problem.objective(x) for x in points])]
    search = search_of(
        problem,
        shared_state.variables,
        options=Options(gap=1e-6),
        local=local,
        obbt_sdp=shared_state.obbt_sdp,
    )
    search.settings = replace(search.settings, cliques=shared_state.cliques)
    search.context = replace(search.context, best=prove_feasible(problem, best))
    return problem, search


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("above", [0.01, 0.1])
@pytest.mark.slow
def test_no_point_below_the_cutoff_is_lost_and_the_box_replays(end, above: float) -> None:
    problem = record(*end)
    points = feasible_points()
    value = np.array([problem.objective(x) for x in points])
    cutoff = least(problem) + above
    made = one_round(problem, cutoff)
    good = points[value <= cutoff]
    assert good.shape[0] > 3
    assert np.all(good >= made.box.lo - 1e-9) and np.all(good <= made.box.hi + 1e-9)
    assert made.node is None and made.left < 0.9
    again = replayed(problem, cutoff, *made.steps)
    assert np.array_equal(again.lo, made.box.lo) and np.array_equal(again.hi, made.box.hi)
    old, new = below(problem, cutoff), made.box
    assert made.left == pytest.approx((new.hi - new.lo)[0] / (old.hi - old.lo)[0])


@pytest.mark.slow
@pytest.mark.parametrize("end", ENDS)
def test_below_the_least_value_nothing_is_left(end) -> None:
    """The grid is 1/500 wide: the least value on it is nearly that of the set."""
    problem = record(*end)
    context = SolveContext(problem, Options(effort="auto"), Stages(), Deadline(None))
    shared_state = shared_state_of(problem)
    settings = NodeSettings(
        shared_state.cliques, shared_state.variables, obbt_sdp=shared_state.obbt_sdp
    )
    found = process_node(context, settings, whole(problem), least(problem) - 0.02)
    assert found.proved.bound >= least(problem) - 0.02
    nearly = process_node(context, settings, whole(problem), least(problem) + 0.02)
    assert nearly.proved.bound <= least(problem) + 1e-9


def test_a_round_ends_where_widths_are_small_enough() -> None:
    problem = record()
    cutoff = least(problem) + 0.02
    full, brief = one_round(problem, cutoff), one_round(problem, cutoff, enough=0.999)
    counts = [sum(isinstance(s, Tightening) for s in made.steps) for made in (brief, full)]
    assert counts == [1, 2]
    assert full.left < brief.left < 0.999


def test_sides_that_a_point_touches_are_left_alone() -> None:
    problem = record()
    cutoff = least(problem) + 0.02
    box = below(problem, cutoff)
    made = one_round(problem, cutoff, points=[box.lo, box.hi])
    assert made.steps == () and made.left == 1.0
    one_side = one_round(problem, cutoff, points=[box.lo]).box
    assert one_side.hi[0] < box.hi[0] - 0.01


def test_time_that_is_over_ends_a_round() -> None:
    problem, deadline = record(), Deadline(None)
    shared_state = shared_state_of(problem)
    deadline.stop()
    context = SolveContext(problem, Options(effort="auto"), Stages(), deadline)
    spec = (shared_state.obbt_sdp, shared_state.cliques)
    made = tighten_by_relaxation(context, Replay(problem, 1.0), whole(problem), spec, {0: 1.0})
    assert made.steps == () and not is_empty(made.box)


class Counting(ThreadPoolExecutor):
    """Two threads; counts the tasks that are waiting together."""

    def __init__(self, workers: int = 2) -> None:
        super().__init__(workers)
        self.tasks = 0

    def submit(self, function, /, *given, **named):
        self.tasks += 1
        return super().submit(function, *given, **named)


@pytest.mark.parametrize("end", [(0, 1.0), (1, -1.0)])
def test_workers_tighten_both_sides_of_a_variable_on_one_box(end) -> None:
    """Each step holds on its own, so that all replay in their order, and no point is lost."""
    problem = record(*end)
    cutoff = least(problem) + 0.05
    with Counting() as executor:
        made = one_round(problem, cutoff, executor=executor)
    assert executor.tasks == 2
    good = np.array([x for x in feasible_points() if problem.objective(x) <= cutoff])
    assert np.all(good >= made.box.lo - 1e-9) and np.all(good <= made.box.hi + 1e-9)
    assert made.left < 0.9
    again = replayed(problem, cutoff, *made.steps)
    assert np.array_equal(again.lo, made.box.lo) and np.array_equal(again.hi, made.box.hi)


@pytest.mark.parametrize("below", [0.02, -0.02])
def test_workers_refute_what_lies_below_the_least_value_alone(below: float) -> None:
    problem, shared_state = record(), shared_state_of(record())
    context = SolveContext(problem, Options(effort="auto"), Stages(), Deadline(None))
    settings = NodeSettings(
        shared_state.cliques, shared_state.variables, obbt_sdp=shared_state.obbt_sdp
    )
    cutoff = least(problem) - below
    with Counting() as executor:
        found = process_node(context, settings, whole(problem), cutoff, executor)
    assert (found.proved.bound >= cutoff) == (below > 0)
    certificate = certify(
        Replay(problem, cutoff),
        Node(BoxProof(found.steps), found.argument, empty=found.empty),
        found.proved,
    )
    assert certificate is not None and certificate.verify(problem).ok
    assert certificate.bound <= least(problem) + 1e-9


@pytest.mark.parametrize("limit", [None, 50.0])
def test_the_box_of_a_node_is_divided_unless_runs_have_to_repeat(limit) -> None:
    """The path would depend on the number of workers."""
    _, search = planted()
    search.context = replace(search.context, deadline=Deadline(None, work_limit=limit))
    with Counting() as executor:
        search.grow(1, lambda: False, executor)
    assert (executor.tasks > 0) == (limit is None)


def test_a_broken_executor_costs_no_bound() -> None:
    problem = record()
    cutoff = least(problem) + 0.05
    executor, stages = Counting(), Stages()
    executor.shutdown()
    with_it = one_round(problem, cutoff, stages, executor=executor)
    assert executor.tasks == 1
    assert with_it.left == pytest.approx(one_round(problem, cutoff).left, abs=0.05)
    assert any("the executor failed (RuntimeError" in note for note in stages.notes)


def test_arguments_leave_slack_for_the_rounding_of_a_replay() -> None:
    problem = record()
    cutoff = least(problem) + 0.02
    made = one_round(problem, cutoff, slack=rounding_slack(whole(problem), whole(problem)))
    again = replayed(problem, cutoff, *made.steps, slack=1e-12)
    assert again.lo[0] == pytest.approx(made.box.lo[0], abs=1e-10)
    assert again.hi[0] == pytest.approx(made.box.hi[0], abs=1e-10)
    without = one_round(problem, cutoff)
    assert replayed(problem, cutoff, *without.steps, slack=1e-12).lo[0] < without.box.lo[0] - 0.01


CUTOFF = 0.95  # of b, which the record bounds from below by about 0.87


def step_of() -> tuple[Problem, Tightening]:
    problem = record()
    step = one_round(problem, CUTOFF).steps[0]
    assert isinstance(step, Tightening) and isinstance(step.argument, Identity)
    return problem, step


def test_forged_steps_shrink_nothing() -> None:
    problem, step = step_of()
    twice = [np.repeat(getattr(step, name), 2) for name in ("variable", "side", "value")]
    start, honest = below(problem, CUTOFF), replayed(problem, CUTOFF, step)
    assert np.any(honest.lo > start.lo) or np.any(honest.hi < start.hi)
    for wrong in (
        replace(step, value=step.value + 1e-3 * abs(step.value)),
        replace(step, value=np.array([np.nan])),
        replace(step, side=-step.side),
        replace(step, variable=np.array([1])),
        Tightening(*twice, step.argument, False),  # an identity speaks of one polynomial
    ):
        box = replayed(problem, CUTOFF, wrong)
        assert np.array_equal(box.lo, start.lo) and np.array_equal(box.hi, start.hi)


@pytest.mark.parametrize("kind", [np.int8, np.int16, np.int32, np.int64, np.bool_, np.complex128])
def test_values_that_overflow_when_negated_shrink_nothing(kind) -> None:
    """-x >= -128 holds, but the negative of an 8-bit -128 is -128: the box would be empty."""
    problem, step = step_of()
    least = np.iinfo(kind).min if np.issubdtype(kind, np.integer) else 0
    forged = replace(step, side=np.array([-1]), value=np.array([least], kind))
    start, box = below(problem, CUTOFF), replayed(problem, CUTOFF, forged)
    assert np.array_equal(box.lo, start.lo) and np.array_equal(box.hi, start.hi)
    assert replayed(problem, CUTOFF, replace(forged, value=np.array([-128.0]))).hi[0] == start.hi[0]


def test_quoted_bounds_that_overflow_when_negated_empty_no_box() -> None:
    """A bound of -2**63 of -x as an integer, whose negative is itself."""
    problem = record()
    about = record(0, -1.0)
    proof = Certificate(about.fingerprint, -(2**63))
    assert proof.verify(about).ok
    for bound in (-(2**63), np.int64(-(2**63))):
        known = Known(((0, -1, replace(proof, bound=bound)),))
        box = replayed(problem, CUTOFF, known)
        assert np.array_equal(box.hi, below(problem, CUTOFF).hi)


def test_blocks_without_monomials_prove_nothing() -> None:
    problem, step = step_of()
    group = Multipliers(
        np.zeros(1, int), np.zeros((1, 0, 1), np.int32), np.zeros((1, 0, 0)), floor=1.0
    )
    forged = replace(step, argument=replace(step.argument, multipliers=(group,)))
    start, box = below(problem, CUTOFF), replayed(problem, CUTOFF, forged)
    assert np.array_equal(box.lo, start.lo) and np.array_equal(box.hi, start.hi)


def test_an_argument_for_a_smaller_box_proves_nothing() -> None:
    problem, step = step_of()
    box = replayed(problem, CUTOFF, step, slack=0.01)
    assert box.lo[0] == -1.51 and box.hi[0] == 0.01


@pytest.mark.parametrize("skip", [(), ("obbt_sdp",)])
def test_trees_with_and_without_prove_the_same(skip: tuple[str, ...], monkeypatch) -> None:
    calls, written = [], []
    real = node.tighten_by_relaxation
    monkeypatch.setattr(
        node, "tighten_by_relaxation", lambda *a, **k: calls.append(1) or real(*a, **k)
    )
    skipped = ("linear", "split", "mixed", "full", "obbt_lp", *skip)
    for end in ENDS:
        problem = record(*end)
        result = check(problem, sp.solve(problem, Options(effort="auto", skip=skipped, gap=1e-6)))
        assert result.status is Status.OPTIMAL
        assert least(problem) - 0.01 <= result.lower_bound <= least(problem) + 1e-9
        again = sp.from_json(sp.to_json(result)).certificate
        assert again.verify(problem).ok
        steps = [step for node in again.root for step in node.box.steps]
        written += [isinstance(getattr(step, "argument", None), Identity) for step in steps]
    assert bool(calls) == any(written) == (not skip)


def test_long_problems_are_tightened_by_relaxations_only() -> None:
    def chain(rows: int) -> Problem:
        c, *v = sp.variables(rows + 2)
        return Problem(c, [c * a + b == 0.1 for a, b in zip(v, v[1:], strict=False)], -1.0, 1.0)

    short, long = shared_state_of(chain(100)), shared_state_of(chain(301))
    assert short.obbt_lp and not long.obbt_lp
    assert shared_state_of(chain(301), skip=("obbt_sdp",)).obbt_lp
    assert not shared_state_of(chain(100), skip=("obbt_lp",)).obbt_lp


def test_objectives_that_are_no_variable_keep_their_box() -> None:
    """Their cutoff is no bound of the box: nothing would be gained."""
    assert shared_state_of(star()).obbt_sdp is None
    assert shared_state_of(record()).obbt_sdp is not None


def test_obbt_sdp_stops_where_it_leaves_most_of_the_widths(monkeypatch) -> None:
    """Rounds that gain nothing: after some nodes the settings are those without them."""
    monkeypatch.setattr(
        node, "tighten_by_relaxation", lambda context, replay, box, *rest: TightenedBox(box)
    )
    _, search = planted()
    search.grow(6, lambda: False)
    assert search.settings.obbt_sdp is None


@pytest.mark.parametrize("pool", [threads, pytest.param(processes, marks=pytest.mark.slow)])
def test_an_executor_tightens_to_the_same_bound(pool) -> None:
    (problem, alone), (_, shared) = planted(local=True), planted(local=True)
    alone.grow(200, lambda: False)
    with pool() as executor:
        shared.grow(200, lambda: False, executor)
    for search in (alone, shared):
        assert search.done
        assert search.certificate().verify(problem).ok
        assert search.certificate().bound == pytest.approx(least(problem), abs=2e-3)


@pytest.mark.parametrize("solves", [0, 1])
def test_an_interrupted_round_loses_no_node(solves: int, monkeypatch) -> None:
    count, real = [], obbt_sdp.bound_box

    def interrupted(*args):
        if len(count) == solves:
            raise KeyboardInterrupt
        count.append(1)
        return real(*args)

    problem, search = planted()
    with monkeypatch.context() as patch:
        patch.setattr(obbt_sdp, "bound_box", interrupted)
        with pytest.raises(KeyboardInterrupt):
            search.grow(200, lambda: False)
    assert len(count) == solves and search.seen == 0 and not search.done
    assert search.grow(3, lambda: False) == 3
    certificate = search.certificate()
    assert certificate.verify(problem).ok
    assert least(problem) - 0.01 <= certificate.bound <= least(problem)


def test_the_error_that_a_bound_may_have_says_when_widths_are_small_enough() -> None:
    """A tenth of the error may stay, and half of that is spared."""
    _, search = planted()
    context, upper = search.context, search.context.upper
    assert node._enough(context, upper - 0.1, upper - 1.0) == pytest.approx(0.05)
    for cutoff, bound in ((None, 0.0), (upper, upper), (upper, -np.inf), (upper, np.nan)):
        assert node._enough(context, cutoff, bound) == 0.0
    assert node._enough(replace(context, best=None), 0.5, 0.0) == 0.0
