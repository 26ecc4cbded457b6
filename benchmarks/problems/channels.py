"""Records of several inputs and outputs, each pair of them with a denominator of its own.

Inputs are uniform on [-1, 1] and known, systems are at rest before the record, and the output noise
is uniform, its bound a share of the largest output. There is no prior. The peer gets the problem of
the formulation in which denominators are multiplied out, with sums of products as unknowns, on the
box that identification proves from the data: the same that ours solves.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType

import setid
from setid.feasible_set.start import find_box

from ..measuring.registry import Case, Selection
from .block_structured import cases_of, simulated
from .intervals import RecordTask

__all__ = ["PLANTS", "cases", "task"]

SIZES = (50, 100, 200)
NOISES = (0.5, 2.0)  # per cent of the largest output

PLANTS: Mapping[str, tuple[setid.TransferFunction, tuple[float, ...]]] = MappingProxyType(
    {
        "two inputs of order 1": (
            setid.TransferFunction(1, 1, 1, 2, form="lifted"),
            (-0.7, -0.4, 1.0, 0.6),
        ),
        "inputs of order 2 and 1": (
            setid.TransferFunction([[2, 1]], [[2, 1]], 1, 2, form="lifted"),
            (-1.5, 0.7, -0.4, 1.0, 0.5, 1.8),
        ),
        "two inputs of order 2": (
            setid.TransferFunction(2, 2, 1, 2, form="lifted"),
            (-1.5, 0.7, 0.5, 0.3, 1.0, 0.5, 1.0, 2.0),
        ),
        "three inputs of order 1": (
            setid.TransferFunction(1, 1, 1, 3, form="lifted"),
            (-0.7, -0.4, 0.3, 1.0, 0.6, 0.8),
        ),
        "two inputs, two outputs": (
            setid.TransferFunction(1, 1, 1, 2, 2, form="lifted"),
            (-0.7, -0.4, -0.6, -0.5, 1.0, 0.6, 0.8, -0.6),
        ),
    }
)


def task(kind: str, samples: int, noise: float = 1.0, seed: int = 0) -> RecordTask:
    """All ends of all parameters, on the box that the data prove.

    Parameters
    ----------
    kind : str
        One of ``PLANTS``.
    samples : int
    noise : float
        Per cent of the largest output.
    seed : int

    Examples
    --------
    >>> asked = task("two inputs of order 1", 20)
    >>> len(asked.objectives), asked.problem.degree
    (8, 2)
    """
    model, theta = PLANTS[kind]
    truth, bound = simulated(model, theta, samples, noise, seed)
    known = setid.formulate(truth.data, model, bound)
    return RecordTask.on_box(known, truth, find_box(known))


def cases(selection: Selection) -> Iterator[Case]:
    """All plants, noise levels, sizes and seeds that are wanted."""
    return cases_of(task, (PLANTS, NOISES, SIZES), selection)
