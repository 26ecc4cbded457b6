"""Test problems with known optima, most of them of any size.

``chains`` holds unconstrained sums of squares, ``control`` discrete-time optimal control,
``planted`` random problems with a planted minimiser, ``classics`` small ones.
"""

from __future__ import annotations

from .chains import (
    broyden_banded,
    broyden_tridiagonal,
    chained_singular,
    chained_wood,
    nondquar,
    rosenbrock,
)
from .classics import laboratory, motzkin
from .control import bilinear_control, scalar_control
from .planted import planted_point, random_quartic

__all__ = [
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
