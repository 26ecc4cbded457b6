"""Records of block-structured systems, identified by :func:`setid.identify`.

Systems at rest before the record, with uniform output noise of a share of the largest
output: static nonlinearities at the input (Hammerstein), at the output (Wiener), in the
feedback (Lur'e), and two inputs of which one passes a nonlinearity. The peer gets the problem
of the formulation on the box that identification proves from the data.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial

import numpy as np

import setid
from setid.feasible_set.start import find_box
from setid.models.equations import Structure

from ..errors import BenchmarkError
from ..measuring.registry import Case, Selection
from .intervals import RecordTask

__all__ = ["KINDS", "cases", "cases_of", "record", "simulated", "task"]

SIZES = (20, 50, 100)
NOISES = (0.5, 1.0, 5.0)  # per cent of the largest output
_ONE, _TWO = setid.TransferFunction(1, 1, 1), setid.TransferFunction(2, 2, 1)
_STABLE = (setid.Stable(),)


def _two_inputs(linear: setid.TransferFunction) -> setid.BlockStructured:
    """The first input passes a square, the second does not; both outputs are added."""
    return setid.BlockStructured(
        {("y1", "w"): linear, ("y1", "u2"): linear},
        {"w": setid.StaticMap("u1", 2)},
        inputs=2,
        normalise="gamma1",
    )


# structure, true parameters, priors; outputs stay bounded for all inputs in [-1, 1]
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
    "lure 1": (setid.Lure(_ONE, 2, "nolinear"), (-0.6, 0.5, 0.15), ()),
    "lure 2": (setid.Lure(_TWO, 2, "nolinear"), (-1.1, 0.4, 0.3, 0.1, 0.1), ()),
    "two inputs 1": (_two_inputs(_ONE), (-0.5, 0.3, 0.8, 0.6, 0.4), _STABLE),
    "two inputs 2": (
        _two_inputs(_TWO),
        (-1.1, 0.4, -0.5, 0.3, 0.8, 0.2, 0.6, 0.3, 0.4),
        _STABLE,
    ),
}


def record(
    kind: str, samples: int, noise: float = 1.0, seed: int = 0
) -> tuple[setid.Simulated, setid.Noise]:
    """The simulated record with the truth behind it, and the noise bound.

    Parameters
    ----------
    kind : str
        One of ``KINDS``.
    samples : int
    noise : float
        Per cent of the largest output.
    seed : int

    Raises
    ------
    BenchmarkError
        If the kind is unknown.

    Examples
    --------
    >>> truth, bound = record("hammerstein 1", 20)
    >>> truth.data.samples
    20
    """
    if kind not in KINDS:
        raise BenchmarkError(f"kind: found {kind!r}, expected one of {', '.join(KINDS)}")
    model, theta, _ = KINDS[kind]
    return simulated(model, theta, samples, noise, seed)


def simulated(
    model: Structure, theta: Sequence[float], samples: int, noise: float, seed: int
) -> tuple[setid.Simulated, setid.Noise]:
    """A record of a structure with inputs in [-1, 1], and the bound of its output noise."""
    u = np.random.default_rng(seed).uniform(-1.0, 1.0, (samples, model.inputs))
    size = noise / 100.0 * float(np.abs(setid.simulate(model, theta, u)).max())
    bound = setid.Noise(output=size)
    return setid.simulate_record(model, theta, u, bound, seed=seed + 1), bound


def task(kind: str, samples: int, noise: float = 1.0, seed: int = 0) -> RecordTask:
    """All ends of all parameters, on the box that the data prove."""
    truth, bound = record(kind, samples, noise, seed)
    model, _, priors = KINDS[kind]
    known = setid.formulate(truth.data, model, bound, priors)
    return RecordTask.on_box(known, truth, find_box(known))


def cases(selection: Selection) -> Iterator[Case]:
    """All structures, sizes, noise levels and seeds that are wanted."""
    return cases_of(task, (KINDS, NOISES, SIZES), selection)


def cases_of(
    make: Callable[[str, int, float, int], RecordTask],
    usual: tuple[Iterable[str], Sequence[float], Sequence[int]],
    selection: Selection,
) -> Iterator[Case]:
    """All records of some kinds, at the usual noise levels and sizes or those that are wanted."""
    kinds, noises, sizes = usual
    wanted = itertools.product(
        kinds, selection.noises or noises, selection.sizes or sizes, selection.seeds
    )
    for kind, noise, samples, seed in wanted:
        name = f"{kind} N={samples} noise {noise:g} %"
        yield Case(name, partial(make, kind, samples, noise, seed), samples, seed)
