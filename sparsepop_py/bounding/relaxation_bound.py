"""One rung: a relaxation of one box, and the best bound that it proves.

box -> scale -> cliques -> relax -> assemble -> solve -> certify
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.conic.program import ConicProgram, ConicSolution
from sparsepop_py.context import Task
from sparsepop_py.options import Options
from sparsepop_py.presolve.initial_box import find_box
from sparsepop_py.presolve.size_limits import fitting_relaxations
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.assemble import assemble
from sparsepop_py.relaxation.moment import Relaxation
from sparsepop_py.relaxation.recover_multipliers import identity_of, margin, repaired, shortened
from sparsepop_py.relaxation.sparsepop.reduction import Condensed, condensed
from sparsepop_py.relaxation.sparsepop.relaxation import Switches
from sparsepop_py.solvers import preferred, solve_conic
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
    "Argued",
    "Attempt",
    "Bound",
    "Model",
    "argue",
    "better",
    "bound_of",
    "level",
    "one_round",
    "relaxed",
    "short_if",
    "solvers_for",
    "stronger",
    "trivially",
]

_SHARES = (1e-5, 1e-7, 1e-9)  # of the largest multiplier; parts below may be left out
_ROUGH = 1e-4  # accuracy that is enough of a solver whose gap is that of its safe value
_MOMENTS = 100  # from which residuals add up to more than the gap that a solver leaves
_WHOLE: tuple[Joined, ...] = ("constraints",)
_SMALLER: tuple[Joined, ...] = (*_WHOLE, "monomials")  # cliques tried, till a relaxation fits
_MARGINS = (1e-8, 1e-6, 1e-4)  # margins tried, relative to the scaled objective, without a box


@dataclass(frozen=True, eq=False)
class Model:
    """What all objectives over one box share: the proof of the box and the relaxations on it."""

    proof: BoxProof
    box: Interval
    scaled: Scaled | None = None
    relaxations: tuple[Relaxation, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Bound:
    """What one rung proved and saw."""

    model: Model
    certificate: Certificate | None
    relaxation: Relaxation | None = None
    solution: ConicSolution | None = None
    value: float = np.nan


@dataclass(frozen=True, eq=False)
class Argued:
    """The best argument for a bound on one box, and the last solution behind such arguments.

    Parameters
    ----------
    proved : Proved
    node : Node
        The argument; its steps, those that led to the box, are not part of it.
    solution : ConicSolution or None
    value : float
        The solver's value in units of the objective: no bound.
    """

    proved: Proved
    node: Node
    solution: ConicSolution | None = None
    value: float = np.nan


def argue(
    task: Task,
    box: Interval,
    scaled: Scaled,
    relaxation: Relaxation,
    start: Argued | None = None,
) -> Argued:
    """Solve one relaxation on a box; where variables have no box, with growing margins."""
    replay = task.replay()
    outcome = start or Argued(prove(replay, box, None, False), Node())
    boxed = bool(np.all(scaled.scaling.boxed))
    scaled_objective, size = scale_objective(task.problem.objective, scaled.scaling)
    switches = task.options.switches
    shares = (0.0,) if boxed else _MARGINS if switches is None else (0.0, *_MARGINS)
    first: Argued | None = None
    for share in shares:
        with task.stages.stage("assemble"):
            minimised = scaled_objective
            if share:
                minimised = minimised - margin(relaxation) * share
            program, small = _programs(relaxation, scaled, minimised, switches)
        for solver in solvers_for(task.options, relaxation, boxed):
            with task.stages.stage("solve"):
                solution = _solution(task, program, small, solver, size)
            with task.stages.stage("certify"):
                attempt = Attempt(replay, box, scaled, relaxation, program, solution, size, share)
                outcome = _certified(task, attempt, outcome)
            first = first or outcome
            if task.closed(outcome.proved.bound) or task.clock.over:
                break
            if solution.status not in ("almost", "failed") or not _loses(task, outcome):
                break
        if outcome.proved.bound > -np.inf or task.clock.over:
            break
    if switches is not None and first is not None:  # later margins and solvers are for the proof
        return replace(outcome, solution=first.solution, value=first.value)
    if task.options.effort != "auto":
        return outcome
    with task.stages.stage("certify"):
        return short_if(task.enough(outcome.proved.bound), replay, box, outcome)


def _programs(
    relaxation: Relaxation, scaled: Scaled, minimised: Polynomial, switches: Switches | None
) -> tuple[ConicProgram, Condensed | None]:
    """The program of a relaxation, and under switches the smaller one to be solved."""
    if switches is None:
        return assemble(relaxation, minimised), None
    small = condensed(relaxation, scaled, switches.perturbed(minimised, relaxation), switches)
    return small.whole, small


def _solution(
    task: Task, program: ConicProgram, small: Condensed | None, solver: str, size: float
) -> ConicSolution:
    solution = solve_conic(
        program if small is None else small.program,
        solver,
        task.clock.left,
        _accuracy(task, size, solver, program.q.size),
        None if task.goal is None else task.goal / size,
        task.options.max_iterations,
        task.objectives,
    )
    return solution if small is None else small.restored(solution)


def short_if(needed: float, replay: Replay, box: Interval, argued: Argued) -> Argued:
    """The argument in short floats, if it still proves what is needed."""
    long = argued.node.argument
    if not isinstance(long, Identity) or long.short:
        return argued
    if not -np.inf < needed <= claim(argued.proved):
        return argued
    for share in _SHARES:
        short = shortened(long, share)
        proved = prove(replay, box, short, argued.node.empty)
        if claim(proved) >= needed:
            return replace(argued, proved=proved, node=replace(argued.node, argument=short))
    return argued


def _accuracy(task: Task, size: float, solver: str, moments: int) -> float:
    """How far a solver should go: a hundredth of the gap that counts as closed is enough.

    Where it knows no safe value, the proof pays for residuals of either sign of all moments.
    """
    if task.options.accuracy is not None:
        return task.options.accuracy
    if task.best is None or task.options.effort != "auto":
        return 1e-9
    if solver == "cliquetree":
        return float(np.clip(1e-2 * task.allowed / size, 1e-9, _ROUGH))
    many = max(1.0, moments / _MOMENTS) ** 0.5
    return float(np.clip(1e-2 * task.allowed / (size * many), 1e-9, 1e-6))


def _loses(task: Task, outcome: Argued) -> bool:
    """Whether what the proof cost is a good part of what is missing."""
    bound, correction = outcome.proved.bound, outcome.proved.correction
    if bound == -np.inf:
        return True
    if task.best is None:
        return correction > 1e-6 * (1.0 + abs(bound))
    return correction > 0.1 * (task.target - bound)


@dataclass(frozen=True, eq=False)
class Attempt:
    """One solution of one program, to be certified."""

    replay: Replay
    box: Interval
    scaled: Scaled
    relaxation: Relaxation
    program: ConicProgram
    solution: ConicSolution
    size: float
    share: float

    def argued(self, z: NDArray[np.float64]) -> Argued:
        """What the multipliers z prove."""
        empty = self.solution.status == "infeasible"
        identity: Identity = identity_of(
            self.relaxation, self.scaled, z, 1.0 if empty else self.size, floor=self.share
        )
        proved = prove(self.replay, self.box, identity, empty)
        value = self.size * self.solution.primal
        node = Node(argument=identity, empty=empty)
        return Argued(proved, node, self.solution, value)


def _certified(task: Task, attempt: Attempt, outcome: Argued) -> Argued:
    """The best of: the old bound, the solver's multipliers, these repaired if they lose much."""
    new = attempt.argued(attempt.solution.z)
    outcome = stronger(outcome, new)
    if attempt.solution.status == "infeasible" or task.options.effort == "plain":
        return outcome
    loss = np.inf if new.proved.bound == -np.inf else new.proved.correction
    scale = max(1.0, abs(attempt.size * attempt.solution.primal))
    if loss > 1e-9 * scale and not task.closed(outcome.proved.bound):
        outcome = stronger(outcome, attempt.argued(repaired(attempt.program, attempt.solution.z)))
    return outcome


def stronger(old: Argued, new: Argued) -> Argued:
    """The argument with the larger bound, with the newest solver output."""
    if new.proved.bound >= old.proved.bound:
        return new
    return replace(new, proved=old.proved, node=old.node)


def solvers_for(options: Options, relaxation: Relaxation, boxed: bool) -> tuple[str, ...]:
    """The chosen solver; by default those that suit the relaxation, one after the other."""
    if options.solver != "auto":
        return (options.solver,)
    if options.effort == "plain":
        return ("clarabel",)
    largest = max(relaxation.block_sizes, default=0)
    return preferred(largest, relaxation.moments.shape[0], boxed)


# ---- one round on one order -----------------------------------------------------------------


def one_round(task: Task, shared: Model | None) -> Bound:
    """Box, relaxations, solver and certificate, once."""
    problem, options, best = task.problem, task.options, task.best
    model = shared
    if model is None:
        with task.stages.stage("presolve"):
            model = Model(*find_box(problem, best, options, done=trivially(task)))
        empty = _emptiness(problem, model)
        if empty is not None:
            return Bound(model, empty)
        if trivially(task):
            return _prove(task, model)
        with task.stages.stage("relax"):
            typical = best.x if best is not None else None
            scaled = relaxed(problem, (problem.objective,), model, options, typical)
        outcome = _prove(task, scaled)
        if _sensible(task, outcome) or options.effort == "plain":
            return outcome
        # a far attained point spoils the scale, a huge box the proof: try without either
        with task.stages.stage("relax"):
            bare = Model(*find_box(problem, best, options, done=True))
            bare = relaxed(problem, (problem.objective,), bare, options)
        return better(outcome, _prove(task, bare))
    return _prove(task, model)


def _sensible(task: Task, bound: Bound) -> bool:
    """Whether the bound has the size of the attained value, or there is nothing to compare."""
    if task.best is None:
        return True
    return level(bound.certificate) > task.upper - 1e3 * (1.0 + abs(task.upper))


def _emptiness(problem: Problem, model: Model) -> Certificate | None:
    """The proof that no point is feasible, if propagation finds one."""
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


def trivially(task: Task) -> bool:
    """Whether the given bounds or squares close the gap without any relaxation."""
    if task.best is None or task.options.effort == "plain":
        return False
    start = Interval(task.problem.lower, task.problem.upper)
    return task.closed(prove(task.replay(), start, None, False).bound)


def relaxed(
    problem: Problem,
    objectives: tuple[Polynomial, ...],
    model: Model,
    options: Options,
    typical: NDArray | None = None,
) -> Model:
    """Scale the problem to the box of the model and build the relaxations on it."""
    switches = options.switches
    if switches is None:
        scaled = Scaled.of(problem, Scaling.of_box(model.box, typical), objectives)
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


def _prove(task: Task, model: Model) -> Bound:
    """Solve the relaxations and certify, until the gap to the attained value is closed."""
    replay = task.replay()
    argued = Argued(prove(replay, model.box, None, False), Node())
    used: Relaxation | None = None
    if model.relaxations and model.scaled is not None:
        used = model.relaxations[-1]
        # the box or the squares may prove it already
        if task.options.effort == "plain" or not task.closed(argued.proved.bound):
            for relaxation in model.relaxations:
                try:
                    argued = argue(task, model.box, model.scaled, relaxation, argued)
                except KeyboardInterrupt:
                    if argued.solution is None:
                        raise
                    task.clock.stop()  # what is proved so far is kept
                    break
                used = relaxation
                if task.closed(argued.proved.bound) or task.clock.over:
                    break
    return bound_of(replay, model, argued, used)


def bound_of(
    replay: Replay, model: Model, argued: Argued, relaxation: Relaxation | None = None
) -> Bound:
    """The bound of the whole problem that an argument on the box of a model makes."""
    node = replace(argued.node, box=model.proof)
    certificate = certify(replay, node, argued.proved)
    return Bound(model, certificate, relaxation, argued.solution, argued.value)


def level(certificate: Certificate | None) -> float:
    """The bound of a certificate, -inf without one."""
    return -np.inf if certificate is None else certificate.bound


def better(old: Bound | None, new: Bound) -> Bound:
    """The larger proved bound, with the newest solver output."""
    if old is None or level(new.certificate) >= level(old.certificate):
        return new
    return replace(new, certificate=old.certificate)
