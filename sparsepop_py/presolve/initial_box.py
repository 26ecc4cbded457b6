"""Initial box: propagation, left inverses, the cutoff, and sublevel identities.

Each step is the same object that the certificate replays later.
"""

from __future__ import annotations

from dataclasses import replace
from math import comb

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Constraint, Kind
from sparsepop_py.budget import Deadline
from sparsepop_py.options import Options
from sparsepop_py.presolve.size_limits import affordable, worth_building
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.assemble import assemble
from sparsepop_py.relaxation.moment import least_order, relax
from sparsepop_py.relaxation.recover_multipliers import identity_of, margin
from sparsepop_py.solvers import solve_conic
from sparsepop_py.sparsity.correlative import Cliques, find_cliques
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.left_inverse import left_inverse
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.box.scaling import Scaled, Scaling
from sparsepop_py.verified.certificate.steps import (
    BoxProof,
    Replay,
    Step,
    Sublevel,
    sublevel_box,
    tighten,
)
from sparsepop_py.verified.points.feasible_point import ProvedPoint

__all__ = ["find_box", "finite", "propagated", "rounding_slack", "shrinks"]

_WORTH = 0.999  # a step that leaves more of every width is not worth its proof
_USEFUL = 1e4  # boxes that reach further beyond the attained point than this do not help
_SCALES = (1.0, 2.0, 16.0, 128.0, 1024.0)  # of unbounded variables, for sublevel identities
_FEW = 8  # unbounded variables up to which several scales are tried
_SWEEPS = 60  # of one step of propagation
_CHAINED = 50  # such steps, one after the other
_LARGEST_BLOCK = 60  # of a sublevel identity at a raised order, which must stay cheap
_SLACK_OF_START = 2.0**-36  # of the first widths, which tell the size of numbers in the rows
_SHARE = 2.0**-20  # of the widths now: more would weaken bounds


def finite(box: Interval) -> bool:
    """Check that every variable has two finite bounds."""
    return bool(np.all(np.isfinite(box.lo) & np.isfinite(box.hi)))


def rounding_slack(box: Interval, start: Interval) -> NDArray[np.float64]:
    """Compute the slack by which replays with another cutoff may enlarge boxes by rounding.

    Parameters
    ----------
    box : Interval
        The box now.
    start : Interval
        The box at the start, whose widths tell the size of the numbers in the rows.

    Returns
    -------
    (n,) float
    """
    first, now = (np.maximum(w.width(), 0.0) for w in (start, box))
    slack = np.minimum(_SLACK_OF_START * np.where(np.isfinite(first), first, now), _SHARE * now)
    return np.where(np.isfinite(slack), slack, 0.0)


def shrinks(old: Interval, new: Interval) -> bool:
    """Check whether a box became smaller by enough for a step of a proof."""
    if is_empty(new) or np.any(np.isinf(old.width()) & np.isfinite(new.width())):
        return True
    width = old.width()
    moved = np.isfinite(width) & (width > 0)
    return bool(np.any(new.width()[moved] < _WORTH * width[moved]))


def find_box(
    problem: Problem,
    incumbent: ProvedPoint | None,
    options: Options,
    *,
    done: bool = False,
    cutoff: float | None = None,
) -> tuple[BoxProof, Interval]:
    """Tighten the box of a problem by presolve, with its proof.

    Parameters
    ----------
    problem : Problem
    incumbent : ProvedPoint or None
        With it, f(x) <= incumbent.value joins the constraints (scope: this objective).
    options : Options
        With effort ``"plain"`` the box is that of the problem's bounds.
    done : bool
        Skip the expensive step, since the bound needs no finite box.
    cutoff : float, optional
        The cutoff where it is not the value of the incumbent.

    Returns
    -------
    proof : BoxProof
        The steps that prove the box.
    box : Interval
    """
    box = Interval(problem.lower, problem.upper)
    if options.effort == "plain":
        return BoxProof(), box
    if "cutoff" in options.skip:
        incumbent = cutoff = None
    if cutoff is None and incumbent is not None:
        cutoff = incumbent.value
    replay = Replay(problem, cutoff)
    box, steps = propagated(replay, box)
    if "inverse" not in options.skip and not finite(box) and not is_empty(box):
        inverse = left_inverse(problem, box)
        if inverse is not None:
            box, more = propagated(replay, inverse.shrink(problem, box))
            steps += [inverse, *more]
    if incumbent is not None and not done and not finite(box) and not is_empty(box):
        found = _sublevel(problem, incumbent, box, options)
        if found is not None:
            steps.append(found)
            box, more = propagated(replay, sublevel_box(problem, cutoff, found, box))
            steps += more
    return BoxProof(tuple(steps)), box


def propagated(replay: Replay, box: Interval) -> tuple[Interval, list[Step]]:
    """Propagate; as long as sweeps bound further variables, as along a chain, go on."""
    steps: list[Step] = []
    for _ in range(_CHAINED):
        missing = np.count_nonzero(np.isinf(box.lo)) + np.count_nonzero(np.isinf(box.hi))
        box, step = tighten(replay, box, _SWEEPS)
        steps.append(step)
        left = np.count_nonzero(np.isinf(box.lo)) + np.count_nonzero(np.isinf(box.hi))
        if step.sweeps < _SWEEPS or left in (0, missing) or is_empty(box):
            break
    return box, steps


def _cliques(scaled: Scaled, options: Options) -> Cliques:
    """Find cliques of the rows without the cutoff row, which has a constant multiplier."""
    rows = scaled.problem
    least = least_order(rows)
    if comb(rows.dimension + least, least) <= _LARGEST_BLOCK:
        return find_cliques(rows, sparse=False)  # dense is tighter and still cheap
    rest = Problem(rows.objective, rows.constraints[:-1], rows.lower, rows.upper)
    cliques = find_cliques(rest, sparse=options.sparse, method=options.chordal)
    used = set(rows.constraints[-1].polynomial.support.tolist())
    inside = [k for k, members in enumerate(cliques.members) if used <= set(members)]
    return replace(cliques, home=np.append(cliques.home, inside[0] if inside else -1))


def _sublevel(
    problem: Problem, incumbent: ProvedPoint, box: Interval, options: Options
) -> Sublevel | None:
    """Solve relaxations for an identity that bounds all variables where f <= cutoff.

    The objective alone comes first where there are constraints: the multipliers of these bring
    monomials into the moment bases that f does not dominate, though it grows in all directions.
    """
    unbounded = np.isinf(box.lo) | np.isinf(box.hi)
    loose = Interval(np.where(unbounded, -np.inf, box.lo), np.where(unbounded, np.inf, box.hi))
    rows = np.append(np.zeros(len(problem.constraints), bool), True)  # the cutoff row is the last
    tries = [(box, np.ones_like(rows))]
    if problem.constraints or np.any(unbounded & (np.isfinite(box.lo) | np.isfinite(box.hi))):
        tries.insert(0, (loose, rows))
    scales = _SCALES if np.count_nonzero(unbounded) <= _FEW else _SCALES[:1]
    deadline = Deadline(options.time_limit)  # of all of them
    for scale in scales:
        for around, active in tries:
            if deadline.over:
                return None
            options = replace(options, time_limit=deadline.left)
            step = _sublevel_on(problem, incumbent, (box, around), active, options, scale)
            if step is not None:
                return step
    return None


def _sublevel_on(
    problem: Problem,
    incumbent: ProvedPoint,
    boxes: tuple[Interval, Interval],
    active: NDArray[np.bool_],
    options: Options,
    scale: float,
) -> Sublevel | None:
    """Solve relaxations with some of the constraints, on a box around the box.

    They minimise -sum_b b(t)^2 over the sublevel set, b running over the moment bases. Far out the
    leading form of an objective outweighs its other terms, however large their coefficients are:
    a larger ``scale`` makes an ill-conditioned program regular, and the box larger.
    """
    f, (box, around) = problem.objective, boxes
    inside = Problem(
        f,
        [*problem.constraints, Constraint(incumbent.value - f, Kind.NONNEGATIVE)],
        around.lo,
        around.hi,
        problem.names,
    )
    scaling = Scaling.of_box(around, typical=incumbent.x)
    if scale != 1.0:
        free = ~scaling.boxed & (scaling.side == 0)
        centre = np.where(free, incumbent.x, scaling.centre)
        size = np.where(scaling.boxed, 1.0, scale) * scaling.scale
        scaling = replace(scaling, centre=centre, scale=np.where(free, scale, size))
    scaled = Scaled.of(inside, scaling, (f,), active)
    cliques = _cliques(scaled, options)
    least = least_order(scaled.problem)
    solver = "clarabel" if options.solver == "auto" else options.solver  # unbounded moments
    for order in (least, least + 1) if scale == 1.0 else (least,):
        if not worth_building(scaled.problem, cliques, order, options.memory_limit):
            break
        relaxation = relax(scaled.problem, order, cliques=cliques)
        if not affordable(relaxation, options.memory_limit):
            break
        if order > least and max(relaxation.block_sizes) > _LARGEST_BLOCK:
            break
        program = assemble(relaxation, margin(relaxation) * -1.0)
        solution = solve_conic(program, solver, options.time_limit)
        if not np.all(np.isfinite(solution.z)):
            continue
        step = Sublevel(
            identity_of(relaxation, scaled, solution.z, 1.0, floor=1.0), incumbent.value
        )
        tighter = sublevel_box(problem, incumbent.value, step, box)
        gained = (np.isinf(box.lo) | np.isinf(box.hi)) & np.isfinite(tighter.width())
        reach = np.maximum(np.abs(tighter.lo), np.abs(tighter.hi))
        if np.any(gained) and np.all(
            reach[gained] <= _USEFUL * (1.0 + np.abs(incumbent.x[gained]))
        ):
            return step
    return None
