"""Bounds of the variables that matter, tightened by linear programs with the cut-off.

On a box that propagation of f(x) <= level has shrunk, the least and the largest value of a
variable over the linear relaxation bound it for every point that is worth finding. What the
box loses makes the next relaxation tighter: products are enveloped on smaller intervals.

References
----------
A. M. Gleixner, T. Berthold, B. Mueller, S. Weltge, Three enhancements for
optimization-based bound tightening, J. Global Optim. 67, 2017.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sparsepop_py.bounding.relaxation_bound import Model
from sparsepop_py.context import SolveContext
from sparsepop_py.presolve.initial_box import shrinks
from sparsepop_py.tightening.mccormick import LinearRelaxation, tightened
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.certificate.steps import BoxProof, Replay, Step, tighten

__all__ = ["TightenedModel", "apply_steps", "tighten_by_lp"]

_SWEEPS = 3  # of propagation after bounds have moved
_GAINED = 0.8  # another round follows where a width fell below this share


@dataclass(frozen=True, eq=False)
class TightenedModel:
    """What one round of tightening made of a box.

    Parameters
    ----------
    model : Model
        On a smaller box, which may be empty.
    gains : bool
        Whether another round may gain.
    empty : bool
        Whether a linear program had no solution, so that no point of the box is worth finding.
    """

    model: Model
    gains: bool = False
    empty: bool = False


def tighten_by_lp(
    context: SolveContext, model: Model, mccormick: LinearRelaxation, variables: Sequence[int]
) -> TightenedModel:
    """One round over some variables.

    Parameters
    ----------
    task : Task
        Its attained value is the cut-off.
    model : Model
        The box and its proof.
    lifted : LinearRelaxation
        The linear relaxation on that box.
    variables : sequence of int
    """
    box = model.box
    open_ = [v for v in variables if box.hi[v] > box.lo[v]]
    replay = context.replay()
    smaller, step, empty = tightened(replay, mccormick, box, open_, context.deadline.left)
    if step is None:
        return TightenedModel(model, empty=empty)
    steps: list[Step] = [*model.proof.steps, step]
    if not is_empty(smaller):
        again, more = tighten(replay, smaller, _SWEEPS)
        if shrinks(smaller, again):
            smaller = again
            steps.append(more)
    made = replace(model, proof=BoxProof(tuple(steps)), box=smaller)
    old, new = (box.hi - box.lo)[open_], (smaller.hi - smaller.lo)[open_]
    return TightenedModel(made, not is_empty(smaller) and bool(np.any(new < _GAINED * old)))


def apply_steps(replay: Replay, steps: Sequence[Step], box: Interval) -> Interval:
    """What steps that shrank one box make of another."""
    for step in steps:
        if is_empty(box):
            break
        box = replay.step(step, box)
    return box
