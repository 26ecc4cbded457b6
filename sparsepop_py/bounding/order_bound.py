"""Lower bound from one order of the hierarchy, with a certificate.

box -> scale -> cliques -> relax; then each relaxation as in ``relaxation_bound.py``
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.bounding.relaxation_bound import BoxBound, bound_box, stronger
from sparsepop_py.bounding.settings import BOUNDING
from sparsepop_py.budget import EARLY
from sparsepop_py.conic.program import ConicSolution
from sparsepop_py.context import SolveContext
from sparsepop_py.options import Options
from sparsepop_py.presolve.initial_box import find_box
from sparsepop_py.presolve.size_limits import fitting_relaxations
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.assemble import assemble
from sparsepop_py.relaxation.moment import Relaxation
from sparsepop_py.relaxation.reboxed import reboxed
from sparsepop_py.relaxation.recover_multipliers import identity_of, repaired
from sparsepop_py.sparsity.correlative import Joined, find_cliques
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.box.scaling import Scaled, Scaling, scale_objective
from sparsepop_py.verified.certificate.certificate import (
    Certificate,
    Node,
    Proved,
    certify,
    prove,
)
from sparsepop_py.verified.certificate.steps import BoxProof, Propagation, Replay

__all__ = [
    "CertifiedBound",
    "Model",
    "better",
    "bound_order",
    "build_relaxations",
    "certified_bound",
    "closed_without_relaxation",
    "lower_bound",
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
