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
from .conic import ConicSolution, assemble
from .feasibility import ProvedPoint
from .options import Options
from .polynomial import Polynomial
from .presolve.propagation import is_empty
from .presolve.scaling import Scaled, Scaling
from .problem import Problem
from .progress import Stages
from .relaxation import Relaxation
from .rounding import Interval
from .sizing import fitting_relaxations
from .solvers import solve_conic
from .sparsity import find_cliques

__all__ = ["Bound", "Clock", "Model", "better", "closed", "level", "one_round", "relaxed"]

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


def one_round(
    problem: Problem,
    best: ProvedPoint | None,
    options: Options,
    shared: Model | None,
    stages: Stages,
    clock: Clock,
) -> Bound:
    """Box, relaxation, solver and certificate, once."""
    model = shared
    if model is None:
        with stages.stage("presolve"):
            model = Model(
                *find_box(problem, best, options, done=_trivially(problem, best, options))
            )
        empty = _emptiness(problem, model)
        if empty is not None:
            return Bound(model, empty)
        with stages.stage("relax"):
            typical = best.x if best is not None else None
            model = relaxed(problem, (problem.objective,), model, options, typical)
    return _prove(problem, best, model, options, stages, clock)


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


def _trivially(problem: Problem, best: ProvedPoint | None, options: Options) -> bool:
    """Whether the given bounds or squares close the gap without any relaxation."""
    if best is None or options.effort == "plain":
        return False
    start = Model(BoxProof(), Interval(problem.lower, problem.upper))
    return closed(Bound(start, certify(problem, start.proof, None, None)), best, options)


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


def _prove(
    problem: Problem,
    best: ProvedPoint | None,
    model: Model,
    options: Options,
    stages: Stages,
    clock: Clock,
) -> Bound:
    """Solve the relaxations and certify, until the gap to the attained value is closed."""
    outcome = Bound(model, certify(problem, model.proof, best, None))
    if not model.relaxations:
        return outcome
    if options.effort != "plain" and closed(outcome, best, options):
        # the box or the squares prove it already
        return replace(outcome, relaxation=model.relaxations[-1])
    for relaxation in model.relaxations:
        outcome = _solve_relaxation(
            problem, best, model, relaxation, outcome, options, stages, clock
        )
        if closed(outcome, best, options) or clock.over:
            break
    return outcome


def _solve_relaxation(
    problem: Problem,
    best: ProvedPoint | None,
    model: Model,
    relaxation: Relaxation,
    outcome: Bound,
    options: Options,
    stages: Stages,
    clock: Clock,
) -> Bound:
    """One relaxation; where variables have no box, with growing margins until it closes."""
    assert model.scaled is not None
    own = Scaled.of(problem, model.scaled.scaling, (problem.objective,))
    objective, size = own.objectives[0], own.objective_sizes[0]
    boxed = bool(np.all(model.scaled.scaling.boxed))
    for share in (0.0,) if boxed else _MARGINS:
        with stages.stage("assemble"):
            weighted = objective - margin(relaxation) * share if share else objective
            program = assemble(relaxation, weighted)
        for solver in _solvers(options):
            with stages.stage("solve"):
                solution = solve_conic(program, solver, clock.left)
            with stages.stage("certify"):
                empty = solution.status == "infeasible"
                for z in (solution.z, None):
                    if z is None:
                        if closed(outcome, best, options) or empty:
                            break
                        z = repaired(program, solution.z)
                    identity = identity_of(
                        relaxation, model.scaled, z, 1.0 if empty else size, floor=share
                    )
                    certificate = certify(problem, model.proof, best, identity, empty=empty)
                    new = Bound(model, certificate, relaxation, solution, size * solution.primal)
                    outcome = better(outcome, new)
            if solution.status != "almost" or closed(outcome, best, options) or clock.over:
                break
        if level(outcome.certificate) > -np.inf or clock.over:
            break
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


def closed(bound: Bound, best: ProvedPoint | None, options: Options) -> bool:
    """Whether the gap to the attained value is within the options, or nothing is feasible."""
    value = level(bound.certificate)
    if value == np.inf:
        return True
    if best is None or value == -np.inf:
        return False
    scale = max(1.0, abs(best.value)) if options.gap_kind == "relative" else 1.0
    return best.value - value <= options.gap * scale
