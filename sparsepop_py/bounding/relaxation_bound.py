"""Lower bound on a box from one relaxation: assemble, solve, certify."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.bounding.settings import BOUNDING
from sparsepop_py.conic.program import ConicProgram, ConicSolution
from sparsepop_py.context import SolveContext
from sparsepop_py.presolve.size_limits import solved_by_moments_alone
from sparsepop_py.relaxation.assemble import assemble
from sparsepop_py.relaxation.moment import Relaxation
from sparsepop_py.relaxation.recover_multipliers import identity_of, margin, repaired, shortened
from sparsepop_py.relaxation.sparsepop.reduction import ReducedProgram, reduce_program
from sparsepop_py.relaxation.sparsepop.relaxation import Switches
from sparsepop_py.solvers import NOT_BEGUN, WITHOUT_WORK, preferred, solve_conic
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaled, scale_objective
from sparsepop_py.verified.certificate.certificate import (
    Node,
    Proved,
    claim,
    prove,
)
from sparsepop_py.verified.certificate.sos_identity import Identity
from sparsepop_py.verified.certificate.steps import Replay

__all__ = [
    "Attempt",
    "BoxBound",
    "bound_box",
    "shorten_if_enough",
    "solvers_for",
    "stronger",
]


@dataclass(frozen=True, eq=False)
class BoxBound:
    """Best argument for a bound on one box, with the solver's last output.

    Parameters
    ----------
    proved : Proved
    node : Node
        The argument, without the steps that prove the box.
    solution : ConicSolution or None
    value : float
        The solver's value in units of the objective: no bound.
    """

    proved: Proved
    node: Node
    solution: ConicSolution | None = None
    value: float = np.nan


def bound_box(
    context: SolveContext,
    box: Interval,
    scaled: Scaled,
    relaxation: Relaxation,
    start: BoxBound | None = None,
) -> BoxBound:
    """Solve one relaxation on a box and certify its bound.

    Where variables have no finite box, growing margins are tried: a part of the objective that the
    solver leaves to pay for residuals.

    Parameters
    ----------
    context : SolveContext
    box : Interval
    scaled : Scaled
        The problem scaled to the box.
    relaxation : Relaxation
        Of the scaled problem.
    start : BoxBound, optional
        A bound known before; the better one is kept.

    Returns
    -------
    BoxBound
    """
    replay = context.at_cutoff()
    outcome = start or BoxBound(prove(replay, box, None, False), Node())
    boxed = bool(np.all(scaled.scaling.boxed))
    scaled_objective, size = scale_objective(context.problem.objective, scaled.scaling)
    switches = context.options.switches
    shares = (0.0,) if boxed else BOUNDING.margins if switches is None else (0.0, *BOUNDING.margins)
    first: BoxBound | None = None
    for share in shares:
        if context.deadline.late:
            break
        with context.stages.stage("assemble"):
            minimised = scaled_objective
            if share:
                minimised = minimised - margin(relaxation) * share
            program, small = _programs(relaxation, scaled, minimised, switches)
        for solver in solvers_for(context, relaxation, boxed):
            with context.stages.stage("solve"):
                solution = _solution(context, program, small, solver, size)
            if not _begun(context, relaxation, solution):
                continue
            with context.stages.stage("certify"):
                attempt = Attempt(replay, box, scaled, relaxation, program, solution, size, share)
                outcome = _certified(context, attempt, outcome)
            first = first or outcome
            if _settles(context, solution, outcome):
                break
        if outcome.proved.bound > -np.inf or context.deadline.over:
            break
    nothing = outcome.proved.bound == -np.inf
    if first is not None and (switches is not None or nothing):  # the others are for the proof
        return replace(outcome, solution=first.solution, value=first.value)
    if context.options.effort != "auto" or context.deadline.late:
        return outcome
    with context.stages.stage("certify"):
        return shorten_if_enough(context.enough(outcome.proved.bound), replay, box, outcome)


def _begun(context: SolveContext, relaxation: Relaxation, solution: ConicSolution) -> bool:
    """Check that a solver was begun; say so where a limit did not allow it."""
    if solution.detail not in (NOT_BEGUN, WITHOUT_WORK):
        return True
    context.deadline.cut = True
    solver = "" if solution.detail == WITHOUT_WORK else f", {solution.solver}"  # none is begun
    context.stages.note(f"order {relaxation.order}{solver}: {solution.detail}")
    return False


def _settles(context: SolveContext, solution: ConicSolution, outcome: BoxBound) -> bool:
    """Check that no other solver is worth trying."""
    if context.closed(outcome.proved.bound) or context.deadline.over:
        return True
    return solution.status not in ("almost", "failed") or not _loses(context, outcome)


def _programs(
    relaxation: Relaxation, scaled: Scaled, minimised: Polynomial, switches: Switches | None
) -> tuple[ConicProgram, ReducedProgram | None]:
    """Assemble the program, and under switches the reduced one that is solved instead."""
    if switches is None:
        return assemble(relaxation, minimised), None
    small = reduce_program(relaxation, scaled, switches.perturbed(minimised, relaxation), switches)
    return small.whole, small


def _solution(
    context: SolveContext,
    program: ConicProgram,
    small: ReducedProgram | None,
    solver: str,
    size: float,
) -> ConicSolution:
    solution = solve_conic(
        program if small is None else small.program,
        solver,
        context.deadline.left,
        _accuracy(context, size, solver, program.q.size),
        None if context.goal is None else context.goal / size,
        context.options.max_iterations,
        context.objectives,
    )
    return solution if small is None else small.restored(solution)


def shorten_if_enough(
    needed: float, replay: Replay, box: Interval, box_bound: BoxBound
) -> BoxBound:
    """Store an argument in 32 bits if it still proves what is needed.

    Parameters
    ----------
    needed : float
        The bound that the shortened argument has to prove.
    replay : Replay
    box : Interval
    box_bound : BoxBound

    Returns
    -------
    BoxBound
        The shortened one, or ``box_bound`` itself.
    """
    long = box_bound.node.argument
    if not isinstance(long, Identity) or long.short:
        return box_bound
    if not -np.inf < needed <= claim(box_bound.proved):
        return box_bound
    for share in BOUNDING.short_shares:
        short = shortened(long, share)
        proved = prove(replay, box, short, box_bound.node.empty)
        if claim(proved) >= needed:
            return replace(box_bound, proved=proved, node=replace(box_bound.node, argument=short))
    return box_bound


def _accuracy(context: SolveContext, size: float, solver: str, moments: int) -> float:
    """Choose a solver's accuracy: a hundredth of the gap that counts as closed.

    Where the solver knows no safe value, the proof pays for residuals of either sign of all
    moments.
    """
    if context.options.accuracy is not None:
        return context.options.accuracy
    if context.best is None or context.options.effort != "auto":
        return 1e-9
    if solver == "cliquetree":
        return float(np.clip(1e-2 * context.allowed / size, 1e-9, BOUNDING.rough_accuracy))
    many = max(1.0, moments / BOUNDING.moments) ** 0.5
    return float(np.clip(1e-2 * context.allowed / (size * many), 1e-9, 1e-6))


def _loses(context: SolveContext, outcome: BoxBound) -> bool:
    """Check whether the proof's correction is a good part of the missing gap."""
    bound, correction = outcome.proved.bound, outcome.proved.correction
    if bound == -np.inf:
        return True
    if context.best is None:
        return correction > 1e-6 * (1.0 + abs(bound))
    return correction > 0.1 * (context.target - bound)


@dataclass(frozen=True, eq=False)
class Attempt:
    """Solution of one program, to be certified.

    Parameters
    ----------
    replay : Replay
    box : Interval
    scaled : Scaled
        The problem scaled to the box.
    relaxation : Relaxation
    program : ConicProgram
    solution : ConicSolution
    size : float
        Factor from the scaled objective to the original one.
    share : float
        Floor of its Gram matrices: the part of the objective that pays for residuals.
    """

    replay: Replay
    box: Interval
    scaled: Scaled
    relaxation: Relaxation
    program: ConicProgram
    solution: ConicSolution
    size: float
    share: float

    def box_bound(self, z: NDArray[np.float64], needed: float | None = None) -> BoxBound:
        """Certify the bound that multipliers z prove.

        Parameters
        ----------
        z : (m,) float
        needed : float, optional
            A bound that is enough: shortened multipliers are tried first where they may reach it.
        """
        empty = self.solution.status == "infeasible"
        identity: Identity = identity_of(
            self.relaxation, self.scaled, z, 1.0 if empty else self.size, floor=self.share
        )
        if needed is not None and not empty:
            for share in BOUNDING.short_shares[:2]:  # with the last one little is left out
                short = self._proved(shortened(identity, share), empty)
                if claim(short.proved) >= needed:
                    return short
        return self._proved(identity, empty)

    def _proved(self, identity: Identity, empty: bool) -> BoxBound:
        proved = prove(self.replay, self.box, identity, empty)
        value = self.size * self.solution.primal
        return BoxBound(proved, Node(argument=identity, empty=empty), self.solution, value)


def _certified(context: SolveContext, attempt: Attempt, outcome: BoxBound) -> BoxBound:
    """Keep the best of the old bound, the solver's multipliers and repaired ones."""
    new = attempt.box_bound(attempt.solution.z, _enough_at_once(context, attempt, outcome))
    gained = new.proved.bound - outcome.proved.bound
    outcome = stronger(outcome, new)
    if attempt.solution.status == "infeasible" or context.options.effort == "plain":
        return outcome
    loss = np.inf if new.proved.bound == -np.inf else new.proved.correction
    scale = max(1.0, abs(attempt.size * attempt.solution.primal))
    if context.deadline.late or (context.aim is not None and loss <= BOUNDING.short_loss * gained):
        return outcome
    if loss > 1e-9 * scale and not context.closed(outcome.proved.bound):
        outcome = stronger(
            outcome, attempt.box_bound(repaired(attempt.program, attempt.solution.z))
        )
    return outcome


def _enough_at_once(context: SolveContext, attempt: Attempt, outcome: BoxBound) -> float | None:
    """Return a bound that is enough and that shortened multipliers are expected to prove.

    One proof is saved where they do. None where the solver's value promises no such bound.
    """
    if attempt.solution.status == "infeasible" or context.deadline.late:
        return None
    expected = attempt.size * attempt.solution.dual
    if context.options.effort == "auto" and context.best is not None:
        likely = expected >= context.target + BOUNDING.likely * context.allowed
        return context.target if likely else None
    least = outcome.proved.bound
    if context.aim is None or not -np.inf < least < expected < context.aim:
        return None
    return float(expected - BOUNDING.short_loss * (expected - least))


def stronger(old: BoxBound, new: BoxBound) -> BoxBound:
    """Return the argument with the larger bound, with the newest solver output."""
    if new.proved.bound >= old.proved.bound:
        return new
    return replace(new, proved=old.proved, node=old.node)


def solvers_for(context: SolveContext, relaxation: Relaxation, boxed: bool) -> tuple[str, ...]:
    """Select solvers: the chosen one, by default those that suit the relaxation, in order."""
    options = context.options
    if options.solver != "auto":
        return (options.solver,)
    if options.effort == "plain":
        return ("clarabel",)
    if boxed and solved_by_moments_alone(relaxation):
        return ("cliquetree",)
    largest = max(relaxation.block_sizes, default=0)
    return preferred(largest, relaxation.moments.shape[0], boxed, context.objectives)
