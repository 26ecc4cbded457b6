"""Bounds of the objective on the whole space, without any box.

They hold on every feasible set, and close the gap where nothing is constrained or bounded.
Gram matrices from the interior of the cone are moved onto the objective less a constant, and a
multiple of the identity is split off that pays for rounding. The earlier a solver stops, the
larger that multiple can be, and the lower the bound. Forms whose Gram matrices are all
singular, whatever the constant, get no bound here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.bounding.gram_kernel import grams_with_kernel
from sparsepop_py.bounding.gram_rounding import (
    estimate,
    exact_grams,
    interior_grams,
    restricted_to_terms,
)
from sparsepop_py.bounding.leading_form import (
    LinearCoordinates,
    coordinates_of_leading_form,
)
from sparsepop_py.bounding.moved_origin import about_the_point, cancels
from sparsepop_py.bounding.order_bound import (
    CertifiedBound,
    Model,
    better,
    build_relaxations,
    certified_bound,
    closed_without_relaxation,
    lower_bound,
)
from sparsepop_py.bounding.relaxation_bound import Attempt, BoxBound, stronger
from sparsepop_py.bounding.settings import BOUNDING
from sparsepop_py.context import SolveContext
from sparsepop_py.presolve.size_limits import affordable, largest_basis, worth_building
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.assemble import assemble
from sparsepop_py.relaxation.moment import Relaxation, least_order, relax
from sparsepop_py.relaxation.recover_multipliers import floored
from sparsepop_py.solvers import solve_conic
from sparsepop_py.sparsity.correlative import find_cliques
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaled, Scaling, scale_objective
from sparsepop_py.verified.certificate.certificate import Node, Proved, prove
from sparsepop_py.verified.certificate.rational_gram import ExactGram
from sparsepop_py.verified.certificate.steps import BoxProof

PointSearch = Callable[[float, CertifiedBound | None], SolveContext]

__all__ = ["good_enough", "may_be_squares", "unconstrained_bound"]


def good_enough(context: SolveContext, bound: float) -> bool:
    """Check whether a bound closes the gap, or nearly so with many variables."""
    nearly = BOUNDING.small_gap * max(1.0, abs(context.upper))
    large = context.problem.dimension > BOUNDING.many_variables
    return context.closed(bound) or (large and bound >= context.upper - nearly)


def may_be_squares(objective: Polynomial) -> bool:
    """Check quickly whether the objective less a constant may be a sum of squares.

    In a sum of squares the highest power of each variable is even, and some monomial that has it
    is a square with a positive coefficient.

    Parameters
    ----------
    objective : Polynomial

    Returns
    -------
    bool
        False where it is no sum of squares. True proves nothing.
    """
    powers = objective.exponents.tocoo()
    highest = np.zeros(objective.dimension, np.int64)
    np.maximum.at(highest, powers.col, powers.data)
    square = objective.coefficients > 0
    square[powers.row[powers.data % 2 == 1]] = False
    held = np.zeros(objective.dimension, bool)
    held[powers.col[square[powers.row] & (powers.data == highest[powers.col])]] = True
    return bool(np.all(held | (highest == 0)))


def unconstrained_bound(
    context: SolveContext, search: PointSearch | None = None
) -> CertifiedBound | None:
    """Bound the objective without constraints and bounds, None where that does not apply.

    Parameters
    ----------
    context : SolveContext
    search : callable, optional
        Looks for better points up to a value, from the moments of a relaxation where one is
        given, and returns the context with its incumbent. Called anew where the incumbent tells
        that no exact bound is to be expected, and with the value that a Gram matrix seems to
        prove, where the incumbent is far from it.

    Returns
    -------
    CertifiedBound or None
    """
    problem = Problem(context.problem.objective)
    if problem.degree == 0 or problem.degree % 2 or closed_without_relaxation(context):
        return None
    bare = Model(BoxProof(), Interval(problem.lower, problem.upper))
    outcome = _by_occurring_monomials(context, bare)
    if outcome is not None and good_enough(context, lower_bound(outcome.certificate)):
        return outcome
    fewer, outcome, model = outcome, None, bare
    for typical in (None, context.best.x if context.best is not None else None):
        with context.stages.stage("relax"):
            scaling = Scaling.of_box(bare.box, typical)
            model = build_relaxations(problem, (problem.objective,), bare, context.options, scaling)
        if model.scaled is None or not model.relaxations:
            return outcome or fewer
        inside: CertifiedBound | None = None
        if outcome is None:
            context, inside, enough = _near_the_incumbent(context, model, model.scaled, search)
            if enough:
                return inside
            context, outcome = _exactly(context, model, search)
            if good_enough(context, lower_bound(outcome.certificate)):
                break
        inside = inside or _from_the_interior(context, model, model.scaled)
        outcome = better(outcome, inside)
        known = outcome.certificate is not None or context.deadline.over
        if known or context.best is None or np.all(np.abs(context.best.x) <= 1.0):
            break  # the scale would be the same
    if outcome is not None and outcome.certificate is None and not context.deadline.over:
        outcome = better(outcome, _in_other_coordinates(context, model))
    assert outcome is not None
    return _about_the_incumbent(context, bare, better(fewer, outcome))


def _by_occurring_monomials(context: SolveContext, bare: Model) -> CertifiedBound | None:
    """Solve the blocks of monomials whose squares occur, None where they are not much smaller.

    Cliques of seven variables have 120 monomials of degree 3. Of these, sums of squares of few
    terms each need a third, in blocks of a tenth of the size.
    """
    options, problem = context.options, Problem(context.problem.objective)
    with context.stages.stage("relax"):
        order = least_order(problem)
        cliques = find_cliques(problem, options.sparse, options.chordal)
        if not worth_building(problem, cliques, order, options.memory_limit):
            return None
        if largest_basis(cliques, order) <= BOUNDING.few_monomials:
            return None
        scaled = Scaled.of(problem, Scaling.of_box(bare.box), (problem.objective,))
        objectives = scaled.objectives
        whole = relax(scaled.problem, order, cliques=cliques, objectives=objectives, terms="sign")
        largest = max(whole.block_sizes)
        if largest <= BOUNDING.few_monomials:
            return None
        found = restricted_to_terms(objectives[0], whole, True, True)
    if found is None or max(found.block_sizes) > BOUNDING.smaller_blocks * largest:
        return None
    if not affordable(found, options.memory_limit):
        return None
    return _from_the_interior(context, replace(bare, scaled=scaled, relaxations=(found,)), scaled)


def _about_the_incumbent(
    context: SolveContext, bare: Model, outcome: CertifiedBound
) -> CertifiedBound:
    """Move the origin to the attained point where terms cancel and a gap is left."""
    problem, best = Problem(context.problem.objective), context.best
    if good_enough(context, lower_bound(outcome.certificate)) or context.deadline.over:
        return outcome
    if best is None or not cancels(problem.objective, best.x):
        return outcome
    options = replace(context.options, switches=None)
    with context.stages.stage("relax"):
        scaling = about_the_point(problem.objective, best.x)
        model = build_relaxations(problem, (problem.objective,), bare, options, scaling)
    if model.scaled is None or not model.relaxations:
        return outcome
    return better(outcome, _from_the_interior(context, model, model.scaled, "clarabel"))


def _near_the_incumbent(
    context: SolveContext,
    model: Model,
    scaled: Scaled,
    search: PointSearch | None,
) -> tuple[SolveContext, CertifiedBound | None, bool]:
    """Certify what the incumbent tells of Gram matrices, and whether that is enough.

    An exact one vanishes there. Where none is expected, those of the interior come first. Better
    points are looked for before, as long as they are found: local minimisers say little.
    """
    relaxation, tried, aim = model.relaxations[-1], None, np.inf
    while True:
        exact = _at_the_incumbent(context, model) if context.best is not tried else None
        if exact is not None or search is None or not _tends_to_no_exact_bound(context, relaxation):
            return context, exact, exact is not None
        if context.upper > aim:
            break  # a search that finds nothing as good is the last one
        tried, aim = context.best, context.upper - BOUNDING.far_incumbent * (1 + abs(context.upper))
        context = search(aim, None)
    inside = _from_the_interior(context, model, scaled)
    bound = lower_bound(inside.certificate)
    if bound > -np.inf and not context.closed(bound):
        context = search(bound, inside)
    return context, inside, _suffices(context, inside, relaxation)


def _at_the_incumbent(context: SolveContext, model: Model) -> CertifiedBound | None:
    """Certify a Gram matrix that vanishes at the incumbent, None where none closes the gap."""
    relaxation, best = model.relaxations[-1], context.best
    if best is None:
        return None
    replay, f = context.at_cutoff(), context.problem.objective
    with context.stages.stage("certify"):
        for expected, gram in grams_with_kernel(f, relaxation, best.x):
            if not context.closed(expected):
                continue
            proved = prove(replay, model.box, gram, False)
            if context.closed(proved.bound):
                box_bound = BoxBound(proved, Node(argument=gram))
                return certified_bound(replay, model, box_bound, relaxation)
    return None


def _suffices(context: SolveContext, inside: CertifiedBound, relaxation: Relaxation) -> bool:
    """Check for a bound that closes the gap where no exact one is expected."""
    closed = context.closed(lower_bound(inside.certificate))
    return closed and _tends_to_no_exact_bound(context, relaxation)


def _tends_to_no_exact_bound(context: SolveContext, relaxation: Relaxation) -> bool:
    """Check for many monomials and an incumbent that is neither rational nor a square root.

    A rational Gram matrix that proves a minimum has its minimisers in the kernel, and with them
    their conjugates. Coordinates are compared with fractions of small denominators and with
    their square roots: does that point attain as much, an exact bound is worth its time.
    """
    if context.best is None or relaxation.moments.shape[0] <= BOUNDING.few_monomials:
        return False
    x = context.best.x
    fraction = _near_fraction(x)
    root = np.copysign(np.sqrt(_near_fraction(x**2)), x)
    near = np.where(np.abs(fraction - x) <= np.abs(root - x), fraction, root)
    value = float(context.problem.objective(near))
    return not value <= context.upper + context.allowed


def _near_fraction(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Round each number to the nearest fraction with a small denominator."""
    scales = np.arange(1.0, 1.0 + BOUNDING.denominators)[:, None]
    rounded = np.round(x * scales) / scales
    best = np.abs(rounded - x).argmin(axis=0)
    return rounded[best, np.arange(x.size)]


def _in_other_coordinates(context: SolveContext, model: Model) -> CertifiedBound:
    """Certify a Gram matrix of coordinates in which the leading form is a monomial."""
    f, replay = context.problem.objective, context.at_cutoff()
    box_bound = BoxBound(Proved(-np.inf, 0.0, ""), Node())
    with context.stages.stage("certify"):
        coordinates = coordinates_of_leading_form(f)
        if coordinates is not None:
            other = Problem(coordinates.polynomial)
            objectives = (other.objective,)
            whole = Model(BoxProof(), Interval(other.lower, other.upper))
            options = replace(context.options, switches=None)
            made = build_relaxations(other, objectives, whole, options).relaxations[-1:]
            for gram in _grams(coordinates, made, context.deadline.left):
                proved = prove(replay, model.box, gram, False)
                if proved.bound > -np.inf:
                    box_bound = BoxBound(proved, Node(argument=gram))
                    break
    return certified_bound(replay, model, box_bound, model.relaxations[-1])


def _grams(
    coordinates: LinearCoordinates, relaxations: tuple[Relaxation, ...], left: float | None
) -> Iterator[ExactGram]:
    for relaxation in relaxations:
        for gram in interior_grams(coordinates.polynomial, relaxation, left):
            if gram.bound(coordinates.polynomial) > -np.inf:
                yield coordinates.transformed(gram)


def _exactly(
    context: SolveContext, model: Model, search: PointSearch | None
) -> tuple[SolveContext, CertifiedBound]:
    """Certify the first exact Gram matrix that is found, however singular."""
    relaxation = model.relaxations[-1]
    replay, f = context.at_cutoff(), context.problem.objective
    box_bound = BoxBound(prove(replay, model.box, None, False), Node())
    with context.stages.stage("certify"):
        for gram in exact_grams(f, relaxation, context.deadline.left):
            slow = gram.basis.shape[0] > BOUNDING.few_monomials and context.best is not None
            if slow:
                expected = estimate(gram, f)
                far = BOUNDING.far_incumbent * (1.0 + abs(context.upper))
                if search is not None and far < context.upper - expected < np.inf:
                    context, search = search(expected, None), None
                if not good_enough(context, expected):
                    continue  # rationals would take long to prove little
            proved = prove(replay, model.box, gram, False)
            if proved.bound > box_bound.proved.bound:
                box_bound = BoxBound(proved, Node(argument=gram))
                break
    return context, certified_bound(replay, model, box_bound, relaxation)


def _from_the_interior(
    context: SolveContext, model: Model, scaled: Scaled, usual: str = "cliquetree"
) -> CertifiedBound:
    """Solve the relaxation without a box and certify Gram matrices of its interior."""
    relaxation = model.relaxations[-1]
    replay, box_bound = context.at_cutoff(), BoxBound(Proved(-np.inf, 0.0, ""), Node())
    minimised, size = scale_objective(context.problem.objective, scaled.scaling)
    solver = usual if context.options.solver == "auto" else context.options.solver
    with context.stages.stage("assemble"):
        program = assemble(relaxation, minimised)
    sharp: NDArray[np.float64] | None = None
    for accuracy in BOUNDING.accuracies:
        with context.stages.stage("solve"):
            solution = solve_conic(program, solver, context.deadline.left, accuracy)
        if solution.status not in ("solved", "almost") or context.deadline.over:
            break
        sharp = solution.z if sharp is None else sharp
        with context.stages.stage("certify"):
            for share in BOUNDING.interior_steps:
                z, floor = floored(relaxation, program, sharp + share * (solution.z - sharp))
                if floor:
                    break
            attempt = Attempt(replay, model.box, scaled, relaxation, program, solution, size, floor)
            box_bound = stronger(box_bound, attempt.box_bound(z))
        if box_bound.proved.bound > -np.inf:
            break
    return certified_bound(replay, model, box_bound, relaxation)
