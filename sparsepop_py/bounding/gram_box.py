"""A box of the set f <= cutoff, from an exact Gram matrix of f.

With f = c + b' P b, semidefinite, and lambda > 0, side * x_v + lambda (f - cutoff) is a quadratic
form in b with one linear term more. Where x_v lies in the range of P it has a minimum, which is a
lower bound of side * x_v on the set. Propagation then uses all constraints.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

import numpy as np

from sparsepop_py.bounding.settings import BOUNDING
from sparsepop_py.context import SolveContext
from sparsepop_py.presolve.initial_box import propagated
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.exact_dual import ExactDual
from sparsepop_py.verified.certificate.rational_gram import ExactGram
from sparsepop_py.verified.certificate.steps import BoxProof, Replay, Step, Tightening

__all__ = ["gram_box"]


def gram_box(context: SolveContext, gram: ExactGram) -> tuple[BoxProof, Interval] | None:
    """Bound variables where the objective is at most the attained value.

    Parameters
    ----------
    context : SolveContext
        With an incumbent.
    gram : ExactGram
        Of the objective.

    Returns
    -------
    proof : BoxProof
    box : Interval
        None in place of both where there is no cutoff, or the Gram matrix bounds no variable.
    """
    problem, replay = context.problem, context.at_cutoff()
    large = max(problem.dimension, gram.basis.shape[0] // 4) > BOUNDING.exact_variables
    if replay.cutoff is None or large:
        return None
    box, steps = propagated(replay, Interval(problem.lower, problem.upper))
    found = [step for step in _bounds(replay, box, gram) if not context.deadline.over]
    for step in found:
        box = replay.step(step, box)
    if not found:
        return None
    box, more = propagated(replay, box)
    return BoxProof((*steps, *found, *more)), box


def _bounds(replay: Replay, box: Interval, gram: ExactGram) -> Iterator[Step]:
    """Yield a bound for each missing end that the Gram matrix proves."""
    for end, side in ((box.lo, 1), (box.hi, -1)):
        for v in np.flatnonzero(np.isinf(end)).tolist():
            step = _bound(replay, gram, v, side)
            if step is not None:
                yield step


def _bound(replay: Replay, gram: ExactGram, v: int, side: int) -> Step | None:
    """Choose the multiplier of the cutoff."""
    pair, none = (np.array([v]), np.array([side])), np.zeros(1)

    def proved(multiplier: float) -> Tightening:
        step = Tightening(*pair, none, _dual(replay, gram, multiplier), True)
        return replace(step, value=step.reached(*replay.system(True), replay.problem.matrices))

    one = proved(1.0)
    if replay.cutoff is None or not np.isfinite(one.value[0]):
        return None
    two = proved(2.0)
    room = max(replay.cutoff - gram.bound(replay.problem.objective), 2.0**-60)
    part = max(2.0 * float(two.value[0] - one.value[0] + room), 2.0**-60)
    best = proved(float(np.exp2(np.round(0.5 * np.log2(part / room)))))
    return best if best.value[0] >= one.value[0] else one


def _dual(replay: Replay, gram: ExactGram, multiplier: float) -> ExactDual:
    """Multiply the cutoff row and the Gram matrix by a power of two."""
    n = replay.problem.dimension
    nowhere = np.full(n, np.inf)
    linear = np.flatnonzero(np.count_nonzero(gram.basis, axis=1) == 1)
    held = {(int(i), int(j)) for i, j in zip(gram.first, gram.second, strict=True)}
    missing = np.array([k for k in linear.tolist() if not held & {(0, k), (k, 0)}], np.int64)
    larger = replace(
        gram,
        first=np.append(gram.first, np.zeros(missing.size, np.int64)),
        second=np.append(gram.second, missing),
        value=np.append(gram.value * multiplier, np.zeros(missing.size)),
    )
    return ExactDual(
        -nowhere,
        nowhere,
        np.array([len(replay.problem.constraints)], np.int64),
        np.zeros((1, 1), np.int32),
        (Fraction(multiplier),),
        larger,
    )
