"""Records of block-structured systems and the parameters that explain them.

Systems at rest before the record, with uniform output noise of a share of the largest
output: static nonlinearities at the input (Hammerstein), at the output (Wiener), in the
feedback (Lur'e), and two inputs of which one passes a nonlinearity. The boxes are those that
setid proves from the data; solvers that cannot prove boxes are given the same.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import partial

import numpy as np

import setid
from setid.boxed import boxed, objectives
from setid.identify import start_box

from .errors import BenchmarkError
from .registry import Case, Selection, Task

__all__ = ["KINDS", "cases", "record", "task"]

SIZES = (20, 50, 100)
NOISES = (0.5, 1.0, 5.0)  # per cent of the largest output
_ONE, _TWO = setid.TransferFunction(1, 1, 1), setid.TransferFunction(2, 2, 1)
_STABLE = (setid.Stable(),)
_TWO_INPUTS = setid.BlockStructured(
    {("y1", "w"): _ONE, ("y1", "u2"): _ONE},
    {"w": setid.StaticMap("u1", 2)},
    inputs=2,
    normalise="gamma1",
)

# structure, true parameters, priors
KINDS = {
    "hammerstein 1": (setid.Hammerstein(_ONE, 3, "gamma1"), (-0.7, 0.8, 0.4, -0.3), ()),
    "hammerstein 2": (
        setid.Hammerstein(_TWO, 3, "dcgain"),
        (-1.1, 0.4, 0.2, 0.1, 1.0, 0.4, -0.3),
        (),
    ),
    "wiener 1": (setid.Wiener(_ONE, 2, "gamma1", initial="zero"), (-0.7, 0.3, 0.3), _STABLE),
    "wiener 2": (
        setid.Wiener(_TWO, 2, "gamma1", initial="zero"),
        (-1.1, 0.4, 0.2, 0.1, 0.3),
        _STABLE,
    ),
    "lure 1": (setid.Lure(_ONE, 2, "nolinear"), (-0.6, 0.8, 0.3), ()),
    "lure 2": (setid.Lure(_TWO, 2, "nolinear"), (-1.1, 0.4, 0.3, 0.1, 0.2), ()),
    "two inputs 1": (_TWO_INPUTS, (-0.5, 0.3, 0.8, 0.6, 0.4), _STABLE),
}


def record(kind: str, samples: int, noise: float = 1.0, seed: int = 0) -> tuple:
    """Simulated data and the noise bound.

    Parameters
    ----------
    kind : str
        One of ``KINDS``.
    samples : int
    noise : float
        Per cent of the largest output.
    seed : int

    Examples
    --------
    >>> data, bound = record("hammerstein 1", 20)
    >>> data.samples
    20
    """
    if kind not in KINDS:
        raise BenchmarkError(f"kind: found {kind!r}, expected one of {', '.join(KINDS)}")
    model, theta, _ = KINDS[kind]
    u = np.random.default_rng(seed).uniform(-1.0, 1.0, (samples, model.inputs))
    size = noise / 100.0 * float(np.abs(setid.simulate(model, theta, u)).max())
    bound = setid.Noise(output=size)
    return setid.simulate_record(model, theta, u, bound, seed=seed + 1).data, bound


def task(kind: str, samples: int, noise: float = 1.0, seed: int = 0) -> Task:
    """All ends of all parameters, on the box that the data prove."""
    data, bound = record(kind, samples, noise, seed)
    model, _, priors = KINDS[kind]
    formulation = setid.formulate(data, model, bound, priors)
    box = start_box(formulation)
    problem = boxed(formulation, box)
    p = len(model.parameters)
    if box is None or not np.all(np.isfinite(problem.upper[:p] - problem.lower[:p])):
        raise BenchmarkError(f"record: the data of {kind!r} do not bound all parameters")
    labels = tuple(f"{sense} {name}" for name in model.parameters for sense in ("min", "max"))
    widths = tuple((problem.upper[:p] - problem.lower[:p]).tolist())
    return Task(problem, tuple(objectives(formulation)), labels, True, widths)


def cases(selection: Selection) -> Iterator[Case]:
    """All structures, sizes, noise levels and seeds that are wanted."""
    wanted = itertools.product(
        KINDS, selection.noises or NOISES, selection.sizes or SIZES, selection.seeds
    )
    for kind, noise, samples, seed in wanted:
        make = partial(task, kind, samples, noise, seed)
        yield Case(f"{kind} N={samples} noise {noise:g} %", make, samples, seed)
