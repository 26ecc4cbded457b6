"""Lower bound from one relaxation of one box.

box -> scale -> cliques -> relax -> assemble -> solve -> certify
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.bounding.settings import BOUNDING
from sparsepop_py.budget import EARLY
from sparsepop_py.conic.program import ConicProgram, ConicSolution
from sparsepop_py.context import SolveContext
from sparsepop_py.options import Options
from sparsepop_py.presolve.initial_box import find_box
from sparsepop_py.presolve.size_limits import fitting_relaxations, solved_by_moments_alone
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.assemble import assemble
from sparsepop_py.relaxation.moment import Relaxation
from sparsepop_py.relaxation.reboxed import reboxed
from sparsepop_py.relaxation.recover_multipliers import identity_of, margin, repaired, shortened
from sparsepop_py.relaxation.sparsepop.reduction import ReducedProgram, reduce_program
from sparsepop_py.relaxation.sparsepop.relaxation import Switches
from sparsepop_py.solvers import NOT_BEGUN, WITHOUT_WORK, preferred, solve_conic
from sparsepop_py.sparsity.correlative import Joined, find_cliques
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.box.scaling import Scaled, Scaling, scale_objective
from sparsepop_py.verified.certificate.certificate import (
    Certificate,
    Node,
    Proved,
    certify,
    claim,
    prove,
)
from sparsepop_py.verified.certificate.sos_identity import Identity
from sparsepop_py.verified.certificate.steps import BoxProof, Propagation, Replay

__all__ = [
    "Attempt",
    "BoxBound",
    "CertifiedBound",
    "Model",
    "better",
    "bound_box",
    "certified_bound",
    "lower_bound",
    "bound_order",
    "build_relaxations",
    "shorten_if_enough",
    "solvers_for",
    "stronger",
    "closed_without_relaxation",
]

_WHOLE: tuple[Joined, ...] = ("constraints",)
_SMALLER: tuple[Joined, ...] = (*_WHOLE, "monomials")  # cliques tried, till a relaxation fits


@dataclass(frozen=True, eq=False)
class Model:
    """Box of a problem with its proof, and the relaxations built on it.

    All objectives over the box share it.

    Parameters
    ----------
    proof : BoxProof
        The steps that prove the box.
    box : Interval
    scaled : Scaled or None
        The problem scaled to the box; None before relaxations are built.
    relaxations : tuple of Relaxation
        Relaxations to solve, one after the other.
    notes : tuple of str
        Sentences for the user.
    """

    proof: BoxProof
    box: Interval
    scaled: Scaled | None = None
    relaxations: tuple[Relaxation, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class CertifiedBound:
    """Certified bound from one relaxation, with the solver's output.

    Parameters
    ----------
    model : Model
    certificate : Certificate or None
        None where nothing is proved.
    relaxation : Relaxation or None
    solution : ConicSolution or None
    value : float
        The solver's value in units of the objective: no bound.
    simpler : Certificate or None
        Of a weaker bound that is verified in less time, where the certificate is a tree.
    """

    model: Model
    certificate: Certificate | None
    relaxation: Relaxation | None = None
    solution: ConicSolution | None = None
    value: float = np.nan
    simpler: Certificate | None = None


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


# ---- one round on one order -----------------------------------------------------------------


def bound_order(
    context: SolveContext, shared: Model | None, last: CertifiedBound | None = None
) -> CertifiedBound:
    """Bound one objective by one relaxation order: box, relaxations, solver, certificate.

    Parameters
    ----------
    context : SolveContext
    shared : Model or None
        Box and relaxations that several objectives share; None: made here.
    last : CertifiedBound, optional
        Of the same order with another incumbent; returned where that changes nothing.

    Returns
    -------
    CertifiedBound
    """
    problem, options, best = context.problem, context.options, context.best
    model = shared
    if model is None:
        with context.stages.stage("presolve"):
            model = Model(
                *find_box(problem, best, options, done=closed_without_relaxation(context))
            )
        empty = _emptiness(problem, model)
        if empty is not None:
            return CertifiedBound(model, empty)
        if closed_without_relaxation(context):
            return _prove(context, model)
        if last is not None and _is_finite_and_same(model.box, last.model.box):
            return last
        with context.stages.stage("relax"):
            scaling = Scaling.of_box(model.box, best.x if best is not None else None)
            scaled = build_relaxations(problem, (problem.objective,), model, options, scaling)
        outcome = _prove(context, scaled)
        if options.effort == "plain":
            return _on_derived_box(context, outcome)
        if _sensible(context, outcome):
            return outcome
        # a far attained point spoils the scale, a huge box the proof: try without either
        with context.stages.stage("relax"):
            bare = Model(*find_box(problem, best, options, done=True))
            bare = build_relaxations(problem, (problem.objective,), bare, options)
        return better(outcome, _prove(context, bare))
    outcome = _prove(context, model)
    return _on_derived_box(context, outcome) if options.effort == "plain" else outcome


def _is_finite_and_same(box: Interval, other: Interval) -> bool:
    """Check for one finite box: only unbounded variables are scaled by the incumbent."""
    ends = np.concatenate([box.lo, box.hi])
    return bool(np.all(np.isfinite(ends)) and np.all(ends == np.concatenate([other.lo, other.hi])))


def _sensible(context: SolveContext, bound: CertifiedBound) -> bool:
    """Check that the bound has the size of the attained value, if there is one."""
    if context.best is None:
        return True
    return lower_bound(bound.certificate) > context.upper - 1e3 * (1.0 + abs(context.upper))


def _on_derived_box(context: SolveContext, outcome: CertifiedBound) -> CertifiedBound:
    """Prove the multipliers of a plain relaxation anew on a box that the rows imply.

    That is done where the proof lost what the relaxation had: steps that bound variables become
    part of the certificate, the relaxation stays as it was asked for.
    """
    model, solution, relaxation = outcome.model, outcome.solution, outcome.relaxation
    if solution is None or relaxation is None or model.scaled is None:
        return outcome
    bound = lower_bound(outcome.certificate)
    good = outcome.value - bound <= BOUNDING.lost * (1.0 + abs(outcome.value))
    if good or bool(np.all(model.scaled.scaling.boxed)) or solution.status == "infeasible":
        return outcome
    if bound == np.inf or context.deadline.over:
        return outcome
    options = replace(context.options, effort="presolve", switches=None)
    with context.stages.stage("presolve"):
        proof, box = find_box(context.problem, context.best, options)
    with context.stages.stage("certify"):
        replay, best = context.at_cutoff(), BoxBound(Proved(-np.inf, 0.0, ""), Node())
        objective, size = scale_objective(context.problem.objective, model.scaled.scaling)
        program = assemble(relaxation, objective)
        for z in (solution.z, repaired(program, solution.z)):
            identity = identity_of(relaxation, model.scaled, z, size)
            smaller = reboxed(identity, box, len(context.problem.constraints))
            if smaller is not None:
                proved = prove(replay, box, smaller, False)
                best = stronger(best, BoxBound(proved, Node(argument=smaller)))
    derived = replace(model, proof=proof, box=box)
    found = certified_bound(replay, derived, best)
    outcome = replace(outcome, model=derived)
    return outcome if found.certificate is None else better(found, outcome)


def _emptiness(problem: Problem, model: Model) -> Certificate | None:
    """Certify that no point is feasible, if propagation shows it."""
    proof, box = model.proof, model.box
    replay = Replay(problem, None)
    if proof.uses_cutoff:
        return None
    if not proof.steps:  # plain effort keeps the box but must not miss this
        proof = BoxProof((Propagation(1, False),))
        box = proof.replay(replay)
    if not is_empty(box):
        return None
    return certify(replay, Node(proof), prove(replay, box, None, False))


def closed_without_relaxation(context: SolveContext) -> bool:
    """Check whether given bounds or squares close the gap without any relaxation."""
    if context.best is None or context.options.effort == "plain":
        return False
    start = Interval(context.problem.lower, context.problem.upper)
    return context.closed(prove(context.at_cutoff(), start, None, False).bound)


def build_relaxations(
    problem: Problem,
    objectives: tuple[Polynomial, ...],
    model: Model,
    options: Options,
    scaling: Scaling | None = None,
) -> Model:
    """Scale the problem to the box of a model and build the relaxations on it.

    Parameters
    ----------
    problem : Problem
    objectives : tuple of Polynomial
    model : Model
    options : Options
    scaling : Scaling, optional
        That of the box when left out; switches have their own.

    Returns
    -------
    Model
        With ``scaled``, ``relaxations`` and ``notes``.
    """
    switches = options.switches
    if switches is None:
        scaled = Scaled.of(problem, scaling or Scaling.of_box(model.box), objectives)
    else:
        scaling = Scaling.of_bounds(model.box, switches.scaled)
        scaled = Scaled.of(problem, scaling, objectives, whole=True)
    given = np.isfinite(problem.lower) | np.isfinite(problem.upper)
    method, objectives = options.chordal, scaled.objectives
    whole = options.effort == "plain" or not problem.constraints
    relaxations: tuple[Relaxation, ...] = ()
    for joined in _WHOLE if whole else _SMALLER:
        cliques = find_cliques(scaled.problem, options.sparse, method, objectives, joined)
        relaxations, notes = fitting_relaxations(
            scaled.problem,
            cliques,
            objectives,
            options,
            constrained=bool(problem.constraints) or bool(given.any()),
        )
        if relaxations:
            break
    return replace(model, scaled=scaled, relaxations=relaxations, notes=notes)


def _prove(context: SolveContext, model: Model) -> CertifiedBound:
    """Solve the relaxations one by one and certify, until the gap is closed."""
    replay = context.at_cutoff()
    box_bound = BoxBound(prove(replay, model.box, None, False), Node())
    used: Relaxation | None = None
    if model.relaxations and model.scaled is not None:
        used = model.relaxations[-1]
        # the box or the squares may prove it already
        if context.options.effort == "plain" or not context.closed(box_bound.proved.bound):
            for relaxation in model.relaxations:
                before = box_bound.solution
                try:
                    box_bound = bound_box(context, model.box, model.scaled, relaxation, box_bound)
                except EARLY as cause:
                    if box_bound.solution is None:
                        raise
                    context.deadline.ended(cause)  # what is proved so far is kept
                    break
                if box_bound.solution is not before:  # late, a relaxation is not solved
                    used = relaxation
                if context.closed(box_bound.proved.bound) or context.deadline.over:
                    break
    return certified_bound(replay, model, box_bound, used)


def certified_bound(
    replay: Replay, model: Model, box_bound: BoxBound, relaxation: Relaxation | None = None
) -> CertifiedBound:
    """Certify a bound of the problem from an argument on its box."""
    node = replace(box_bound.node, box=model.proof)
    certificate = certify(replay, node, box_bound.proved)
    return CertifiedBound(model, certificate, relaxation, box_bound.solution, box_bound.value)


def lower_bound(certificate: Certificate | None) -> float:
    """Return the bound of a certificate, -inf without one."""
    return -np.inf if certificate is None else certificate.bound


def better(old: CertifiedBound | None, new: CertifiedBound) -> CertifiedBound:
    """Return the larger certified bound, with the newest solver output."""
    if old is None or lower_bound(new.certificate) >= lower_bound(old.certificate):
        return new
    return replace(new, certificate=old.certificate, simpler=old.simpler)
