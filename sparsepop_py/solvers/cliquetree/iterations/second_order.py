"""Second-order cones as arrow matrices.

The engine emits none, but programs from elsewhere may hold them. The point (t, x) lies in the
cone t >= |x| if and only if the arrow matrix [[t, x'], [x, t I]] is positive semidefinite, so
the conversion loses nothing; and a multiplier Z of the matrix gives (tr Z, 2 Z_01, 2 Z_02, ...)
of the cone, which lies in it again. It costs where cones are long: a cone of n rows becomes a
block of n.

References
----------
F. Alizadeh, D. Goldfarb, Second-order cone programming, Math. Program. 95, 2003, section 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.conic.program import ConicProgram
from sparsepop_py.errors import ProblemError

__all__ = ["second_order_multipliers", "with_second_order"]

Reals = NDArray[np.float64]
_ROOT2 = float(np.sqrt(2.0))


def with_second_order(
    program: ConicProgram, G: sps.csc_array, h: Reals, sizes: Sequence[int]
) -> ConicProgram:
    """Add rows h - G y in a product of second-order cones to a program.

    Parameters
    ----------
    program : ConicProgram
    G : (sum of sizes, M) sparse
    h : (sum of sizes,) float
    sizes : sequence of int
        Rows of each cone, the bound t first.

    Returns
    -------
    ConicProgram

    Raises
    ------
    ProblemError
        If the shapes do not fit.

    Examples
    --------
    The point of the disc of radius one with the least sum of coordinates:

    >>> import numpy as np, scipy.sparse as sps
    >>> from sparsepop_py.conic.program import Cones, ConicProgram
    >>> from sparsepop_py.solvers import cliquetree
    >>> free = ConicProgram(np.ones(2), sps.csc_array((0, 2)), np.zeros(0), Cones(0, 0, ()))
    >>> G, h = sps.csc_array(np.array([[0, 0], [-1, 0], [0, -1.0]])), np.array([1.0, 0, 0])
    >>> program = cliquetree.with_second_order(free, G, h, (3,))
    >>> print(round(cliquetree.solve(program).dual, 5))
    -1.41421
    """
    _check(program, G, h, sizes)
    rows, column, value = [], [], []
    begin = 0
    for size in sizes:  # arrow entries in the upper triangle, column by column
        j = np.arange(size)
        corner, diagonal = j * (j + 1) // 2, j * (j + 3) // 2
        rows += [begin + corner[1:], begin + diagonal]
        value += [np.full(size - 1, _ROOT2), np.ones(size)]
        begin += size * (size + 1) // 2
    first = np.concatenate([[0], np.cumsum(np.array(sizes, np.int64))]).astype(np.int64)
    for start, size in zip(first, sizes, strict=False):
        column += [start + np.arange(1, size), np.full(size, start)]
    empty = [np.zeros(0, np.int64)]
    spread = sps.csc_array(
        (
            np.concatenate([np.zeros(0), *value]),
            (np.concatenate(empty + rows), np.concatenate(empty + column)),
        ),
        shape=(begin, h.size),
    )
    return replace(
        program,
        A=sps.vstack([program.A, spread @ G], format="csc"),
        b=np.concatenate([program.b, spread @ h]),
        cones=replace(program.cones, psd=(*program.cones.psd, *(int(s) for s in sizes))),
    )


def second_order_multipliers(z: Reals, sizes: Sequence[int]) -> Reals:
    """Recover the multipliers of second-order cones, shape (sum of sizes,).

    Parameters
    ----------
    z : (R,) float
        All multipliers of a program of :func:`with_second_order`.
    sizes : sequence of int
        As given there.

    Returns
    -------
    (sum of sizes,) float
    """
    found = []
    begin = z.size - sum(s * (s + 1) // 2 for s in sizes)
    for size in sizes:
        j = np.arange(size)
        corner, diagonal = begin + j * (j + 1) // 2, begin + j * (j + 3) // 2
        found += [z[diagonal].sum(keepdims=True), _ROOT2 * z[corner[1:]]]
        begin += size * (size + 1) // 2
    return np.concatenate([np.zeros(0), *found])


def _check(program: ConicProgram, G: sps.csc_array, h: Reals, sizes: Sequence[int]) -> None:
    if any(size < 1 for size in sizes):
        raise ProblemError(f"sizes: found {tuple(sizes)}, expected at least one row a cone")
    if h.shape != (sum(sizes),):
        raise ProblemError(f"h: found shape {h.shape}, expected ({sum(sizes)},) from sizes")
    if G.shape != (h.size, program.q.size):
        raise ProblemError(f"G: found shape {G.shape}, expected {(h.size, program.q.size)}")
