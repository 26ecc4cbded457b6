"""One cone of denominators in the search: what scales its vectors, and what refutes it.

The multiplier of one denominator in the cone, the centre, tells how much noise each vector lets
through. Vectors are divided by that. All of it needs the cone alone, so that several cones are
examined at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from setid.minimum_noise.cones.linear_programs import ConeBound, ConePrograms
from setid.proofs.denominators.cones import Cone
from setid.proofs.denominators.denominator_cells import VaryingLeaf
from setid.proofs.denominators.varying_multipliers import hurwitz_minors, pairs

__all__ = ["OPEN_LEAF", "ConeNode", "Examined", "examined", "first_node"]

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]
OPEN_LEAF = VaryingLeaf((), (), ())  # of a cone that nothing refutes
_LEAST = 1e-200  # size of a vector
_ALMOST_STABLE = 1.0 + 1e-4


class ConeNode(NamedTuple):
    """A cone in the search.

    Parameters
    ----------
    cone : (K, K) int
        One vector a row.
    centred : bool
        The centre is the cone's own, not its whole's.
    reference : (m,) int or None
        Samples at which the noise of the centre's denominator is largest.
    centre : (n + 1, S) float or None
        Multiplier of one denominator, i samples ahead.
    products : (K, K) float
        Weights of pairs that are hard to refute.
    edges : (K, K) float
        Weights of edges: less than 1 where splits left a half as hard to refute.
    """

    cone: Cone
    centred: bool
    reference: Integers | None
    centre: Reals | None
    products: Reals
    edges: Reals

    def sizes(self, bound: Reals) -> Reals:
        """Compute sizes of the vectors (K,), in the noise a cone's multiplier lets through.

        Parameters
        ----------
        bound : (S,) float
        """
        cone = self.cone.astype(np.float64)
        if self.centre is None:
            return np.abs(cone).max(axis=1)
        return np.maximum(np.abs(cone @ self.centre) @ bound, _LEAST)

    def powers(self, bound: Reals) -> tuple[int, ...]:
        """Round the sizes to the nearest powers of two.

        Parameters
        ----------
        bound : (S,) float
        """
        return tuple(int(p) for p in np.round(np.log2(self.sizes(bound))))


class Examined(NamedTuple):
    """Results of the programs of one cone.

    Parameters
    ----------
    node : ConeNode
    unstable : VaryingLeaf or None
        Where all members are unstable.
    powers : tuple of int
        Each vector was divided by 2 to this power.
    bound : ConeBound or None
    tried : (n + 1,) float or None
        The denominator of the centre, where it is new and stable.
    level : float
        Noise that this denominator needs.
    """

    node: ConeNode
    unstable: VaryingLeaf | None
    powers: tuple[int, ...]
    bound: ConeBound | None
    tried: Reals | None
    level: float


def first_node(cone: Cone) -> ConeNode:
    """Return a cone of which nothing is known.

    Parameters
    ----------
    cone : (K, K) int
    """
    every = np.ones((len(cone), len(cone)))
    return ConeNode(cone, False, None, None, every, every)


def examined(task: tuple[ConePrograms, ConeNode, float]) -> Examined:
    """Centre a cone, and refute a target in it as far as that goes, in any process.

    Parameters
    ----------
    task : tuple
        Programs of the record, a cone, and the target: a factor on the noise bounds.
    """
    solver, node, target = task
    tried, level = None, np.inf
    if not node.centred:
        node, tried, level = _centred(solver, node)
    powers = node.powers(solver.programs.bound)
    unstable, bound = _unstable(solver, node.cone, powers), None
    if unstable is None:
        bound = solver.solve(node.cone, powers, target)
        products = np.zeros((len(node.cone), len(node.cone)))
        products[tuple(np.array(pairs(len(node.cone))).T)] = bound.weights
        node = node._replace(products=products + products.T)
    return Examined(node, unstable, powers, bound, tried, level)


def _centred(solver: ConePrograms, node: ConeNode) -> tuple[ConeNode, Reals | None, float]:
    """Solve for the multiplier of one denominator in the cone; its whole's stays if there is none.

    Also the denominator, if it is stable, and the noise that it needs.
    """
    programs = solver.programs
    a = (1.0 / node.sizes(programs.bound)) @ node.cone.astype(np.float64)
    solved = programs.solve(a / np.abs(a).max(), node.reference)
    if solved is None:
        return node._replace(centred=True), None, np.inf
    level, multiplier, reference = solved
    n, length = programs.order, programs.y.size
    padded = np.concatenate([np.zeros(n), programs.part(multiplier), np.zeros(n)])
    centre = sliding_window_view(padded, length)
    node = node._replace(centred=True, reference=reference, centre=centre)
    unstable = solver.stable and np.abs(np.roots(a)).max(initial=0.0) >= _ALMOST_STABLE
    return node, None if unstable else a, level


def _unstable(solver: ConePrograms, cone: Cone, powers: tuple[int, ...]) -> VaryingLeaf | None:
    """The leaf of a cone whose members are all unstable by one minor; None for others."""
    if not solver.stable or len(cone) < 4:
        return None
    minors = hurwitz_minors(cone, powers)
    which = np.flatnonzero(np.all(minors < 0.0, axis=1))
    if not which.size:
        return None
    weights = np.zeros(len(minors))
    weights[which[0]] = 1.0
    return VaryingLeaf((), (), powers, tuple(weights.tolist()))
