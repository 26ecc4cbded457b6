"""Quadratic forms over the unit box and over signs: box-constrained programs and maximum cuts.

Box-constrained programs are min x'Qx / 2 + c'x over [0, 1]^n. Entries of Q and c are integers in
[-50, 50], and an entry of Q is zero with probability 1 - density. A maximum cut of a graph with
weights w is (total - minimum) / 2 of

    min sum over edges of w_ij x_i x_j,  x_i^2 = 1.

References
----------
D. Vandenbussche, G. L. Nemhauser, A branch-and-cut algorithm for nonconvex quadratic programs with
box constraints, Math. Programming 102 (2005) 559-575: how the coefficients are drawn.
M. X. Goemans, D. P. Williamson, J. ACM 42 (1995) 1115-1145: the relaxation of maximum cuts.
"""

from __future__ import annotations

import networkx as nx
import numpy as np

import sparsepop_py as sp

from ..measuring.registry import Task

__all__ = ["box_program", "maximum_cut"]


def box_program(n: int, density: float, seed: int) -> Task:
    """Draw a quadratic program over the unit box.

    Parameters
    ----------
    n : int
        Number of variables.
    density : float
        Share of pairs whose product has a coefficient.
    seed : int
    """
    rng = np.random.default_rng([n, round(100 * density), seed])
    x = sp.variables(n)
    drawn = np.triu(rng.integers(-50, 51, (n, n)) * (rng.random((n, n)) < density))
    linear = rng.integers(-50, 51, n)
    terms = [float(linear[i]) * x[i] for i in range(n)]
    terms += [float(drawn[i, i]) / 2.0 * x[i] ** 2 for i in range(n)]
    terms += [float(drawn[i, j]) * x[i] * x[j] for i in range(n) for j in range(i + 1, n)]
    return Task.of(sp.Problem(sp.total(terms), lower=0.0, upper=1.0))


def maximum_cut(n: int, degree: int, seed: int) -> Task:
    """Draw a random regular graph and ask for its maximum cut.

    Parameters
    ----------
    n : int
        Number of nodes.
    degree : int
        Edges at each node; n times it is even.
    seed : int
    """
    graph = nx.random_regular_graph(degree, n, seed=seed)
    x = sp.variables(n)
    objective = sp.total([x[i] * x[j] for i, j in sorted(graph.edges)])
    signs = [x[i] ** 2 == 1.0 for i in range(n)]
    return Task.of(sp.Problem(objective, signs, lower=-1.0, upper=1.0))
