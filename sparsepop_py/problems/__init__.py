"""Test problems with known optima, most of them of any size.

``chains`` holds unconstrained sums of squares, ``control`` discrete-time optimal control,
``planted`` random problems with a planted minimiser, ``classics`` small ones. The chains
answer to the names of SparsePOP's collection too.

Examples
--------
>>> RosenbrockLS(10).objective([1.0] * 10)
1.0
"""

from __future__ import annotations

from sparsepop_py.problems.chains import (
    broyden_banded,
    broyden_tridiagonal,
    chained_singular,
    chained_wood,
    nondquar,
    rosenbrock,
)
from sparsepop_py.problems.classics import laboratory, motzkin
from sparsepop_py.problems.control import bilinear_control, scalar_control
from sparsepop_py.problems.planted import planted_point, random_quartic

# Names of the same functions in SparsePOP's collection; LS stands for "least squares".
RosenbrockLS = rosenbrock
ChainedWood = chained_wood
BroydenTriLS = broyden_tridiagonal
BroydenBand = broyden_banded
ChainedSingular = chained_singular

__all__ = [
    "BroydenBand",
    "BroydenTriLS",
    "ChainedSingular",
    "ChainedWood",
    "RosenbrockLS",
    "bilinear_control",
    "broyden_banded",
    "broyden_tridiagonal",
    "chained_singular",
    "chained_wood",
    "laboratory",
    "motzkin",
    "nondquar",
    "planted_point",
    "random_quartic",
    "rosenbrock",
    "scalar_control",
]
