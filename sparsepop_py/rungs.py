"""One rung: a box, the relaxations on it, and the best bound that they prove.

box -> scale -> cliques -> relax -> assemble -> solve -> certify
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .boxes import find_box
from .certificate.box import BoxProof, Propagation
from .certificate.certificate import Certificate, certify
from .certificate.dual import identity_of, margin, repaired
from .conic import ConicProgram, ConicSolution, assemble
from .feasibility import ProvedPoint
from .options import Options
from .polynomial import Polynomial
from .presolve.propagation import is_empty
from .presolve.scaling import Scaled, Scaling, scale_objective
from .problem import Problem
from .progress import Stages
from .relaxation import Relaxation
from .rounding import Interval
from .sizing import fitting_relaxations
from .solvers import solve_conic
from .sparsity import find_cliques

__all__ = ["Bound", "Clock", "Model", "Task", "better", "closed", "level", "one_round", "relaxed"]

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
    """What one round proved and saw."""

    model: Model
    certificate: Certificate | None
    relaxation: Relaxation | None = None
    solution: ConicSolution | None = None
    value: float = np.nan


class Clock:
    """Remaining wall time."""

    def __init__(self, limit: float | None) -> None:
        self._end = None if limit is None else time.monotonic() + limit

    @property
    def left(self) -> float | None:
        """Seconds left, None without a limit."""
        return None if self._end is None else max(1e-3, self._end - time.monotonic())

    @property
    def over(self) -> bool:
        """Whether the limit has passed."""
        return self._end is not None and time.monotonic() >= self._end


@dataclass(frozen=True, eq=False)
class Task:
    """What every stage needs: the problem, the options, and the best attained point so far."""

    problem: Problem
    options: Options
    stages: Stages
    clock: Clock
    best: ProvedPoint | None = None


def one_round(task: Task, shared: Model | None) -> Bound:
    """Box, relaxations, solver and certificate, once."""
    problem, options, best = task.problem, task.options, task.best
    model = shared
    if model is None:
        with task.stages.stage("presolve"):
            model = Model(*find_box(problem, best, options, done=_trivially(task)))
        empty = _emptiness(problem, model)
        if empty is not None:
            return Bound(model, empty)
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
    value = level(bound.certificate)
    return value > task.best.value - 1e3 * (1.0 + abs(task.best.value))


def _emptiness(problem: Problem, model: Model) -> Certificate | None:
    """The proof that no point is feasible, if propagation finds one."""
    proof = model.proof
    if not proof.steps:  # plain effort keeps the box but must not miss this
        proof = BoxProof((Propagation(1, False),))
        if not is_empty(proof.replay(problem, None)):
            return None
    elif not is_empty(model.box):
        return None
    return certify(problem, proof, None, None, empty=True)


def _trivially(task: Task) -> bool:
    """Whether the given bounds or squares close the gap without any relaxation."""
    if task.best is None or task.options.effort == "plain":
        return False
    start = Model(BoxProof(), Interval(task.problem.lower, task.problem.upper))
    return closed(task, Bound(start, certify(task.problem, start.proof, None, None)))


def relaxed(
    problem: Problem,
    objectives: tuple[Polynomial, ...],
    model: Model,
    options: Options,
    typical: NDArray | None = None,
) -> Model:
    """Scale the problem to the box of the model and build the relaxations on it."""
    scaled = Scaled.of(problem, Scaling.of_box(model.box, typical), objectives)
    cliques = find_cliques(
        scaled.problem, sparse=options.sparse, method=options.chordal, objectives=scaled.objectives
    )
    given = np.isfinite(problem.lower) | np.isfinite(problem.upper)
    relaxations, notes = fitting_relaxations(
        scaled.problem,
        cliques,
        scaled.objectives,
        options,
        constrained=bool(problem.constraints) or bool(given.any()),
    )
    return replace(model, scaled=scaled, relaxations=relaxations, notes=notes)


def _prove(task: Task, model: Model) -> Bound:
    """Solve the relaxations and certify, until the gap to the attained value is closed."""
    outcome = Bound(model, certify(task.problem, model.proof, task.best, None))
    if not model.relaxations or model.scaled is None:
        return outcome
    if task.options.effort != "plain" and closed(task, outcome):
        # the box or the squares prove it already
        return replace(outcome, relaxation=model.relaxations[-1])
    objective = scale_objective(task.problem.objective, model.scaled.scaling)
    for relaxation in model.relaxations:
        outcome = _solve_relaxation(task, model, relaxation, objective, outcome)
        if closed(task, outcome) or task.clock.over:
            break
    return outcome


def _solve_relaxation(
    task: Task,
    model: Model,
    relaxation: Relaxation,
    objective: tuple[Polynomial, float],
    outcome: Bound,
) -> Bound:
    """One relaxation; where variables have no box, with growing margins until it closes."""
    assert model.scaled is not None
    boxed = bool(np.all(model.scaled.scaling.boxed))
    scaled_objective, size = objective
    for share in (0.0,) if boxed else _MARGINS:
        with task.stages.stage("assemble"):
            minimised = scaled_objective
            if share:
                minimised = minimised - margin(relaxation) * share
            program = assemble(relaxation, minimised)
        for solver in _solvers(task.options):
            with task.stages.stage("solve"):
                solution = solve_conic(program, solver, task.clock.left)
            with task.stages.stage("certify"):
                attempt = _Attempt(model, relaxation, program, solution, size, share)
                outcome = _certified(task, attempt, outcome)
            if solution.status != "almost" or closed(task, outcome) or task.clock.over:
                break
        if level(outcome.certificate) > -np.inf or task.clock.over:
            break
    return outcome


@dataclass(frozen=True, eq=False)
class _Attempt:
    """One solution of one program, to be certified."""

    model: Model
    relaxation: Relaxation
    program: ConicProgram
    solution: ConicSolution
    size: float
    share: float

    def bound(self, task: Task, z: NDArray[np.float64]) -> Bound:
        """What the multipliers z prove."""
        assert self.model.scaled is not None
        empty = self.solution.status == "infeasible"
        identity = identity_of(
            self.relaxation, self.model.scaled, z, 1.0 if empty else self.size, floor=self.share
        )
        certificate = certify(task.problem, self.model.proof, task.best, identity, empty=empty)
        value = self.size * self.solution.primal
        return Bound(self.model, certificate, self.relaxation, self.solution, value)


def _certified(task: Task, attempt: _Attempt, outcome: Bound) -> Bound:
    """The best of: the old bound, the solver's multipliers, these repaired if they lose much."""
    new = attempt.bound(task, attempt.solution.z)
    outcome = better(outcome, new)
    if attempt.solution.status == "infeasible" or task.options.effort == "plain":
        return outcome
    loss = np.inf if new.certificate is None else new.certificate.correction
    scale = max(1.0, abs(attempt.size * attempt.solution.primal))
    if loss > 1e-9 * scale:
        outcome = better(
            outcome, attempt.bound(task, repaired(attempt.program, attempt.solution.z))
        )
    return outcome


def _solvers(options: Options) -> tuple[str, ...]:
    """The chosen solver; the default is followed by its other form where it only almost solves."""
    if options.solver == "clarabel" and options.effort != "plain":
        return ("clarabel", "clarabel-moment")
    return (options.solver,)


def level(certificate: Certificate | None) -> float:
    """The bound of a certificate, -inf without one."""
    return -np.inf if certificate is None else certificate.bound


def better(old: Bound | None, new: Bound) -> Bound:
    """The larger proved bound, with the newest solver output."""
    if old is None or level(new.certificate) >= level(old.certificate):
        return new
    return replace(new, certificate=old.certificate)


def closed(task: Task, bound: Bound) -> bool:
    """Whether the gap to the attained value is within the options, or nothing is feasible."""
    value, best, options = level(bound.certificate), task.best, task.options
    if value == np.inf:
        return True
    if best is None or value == -np.inf:
        return False
    scale = max(1.0, abs(best.value)) if options.gap_kind == "relative" else 1.0
    return best.value - value <= options.gap * scale
