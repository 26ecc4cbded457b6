"""Problems of known minima, and options of the search."""

from __future__ import annotations

import functools

import numpy as np
from scipy.optimize import linprog
from search_cases import bilinear, least_on_a_grid
from solved import INF

import sparsepop_py as sp
from sparsepop_py import Options, Problem
from sparsepop_py.relaxation.hierarchy import relaxation_specs

ALL_SPECS = relaxation_specs


A = np.array([1.0, -2.0, 1.5, 0.5, -1.0, 2.0])


B = np.array([0.5, 0.25, -1.0, 1.0, 0.75, -0.5])


def star():
    """min c/2 + sum (a_i c + b_i) v_i with three rows, linear for every fixed c."""
    c, *v = sp.variables(7)
    rows = [sp.total(v) >= 1, v[0] - 2.0 * v[2] + v[5] <= 0.5, c * v[0] - v[1] == 0.25]
    terms = [(a * c + b) * w for a, b, w in zip(A.tolist(), B.tolist(), v, strict=True)]
    return Problem(0.5 * c + sp.total(terms), rows, -1.0, 1.0)


@functools.cache
def least_of_star():
    """The least over a grid of c, a linear program each."""
    found = []
    for c in np.linspace(-1, 1, 81):
        above = np.array([-np.ones(6), [1, 0, -2, 0, 0, 1]])
        equal = np.array([[c, -1, 0, 0, 0, 0]])
        program = linprog(A * c + B, above, [-1, 0.5], equal, [0.25], (-1, 1), method="highs")
        found.append(program.fun + 0.5 * c if program.status == 0 else INF)
    return min(found)


def least_of_bilinear():
    return least_on_a_grid(bilinear(), 25)


CASES = {"star": (star, least_of_star), "bilinear": (bilinear, least_of_bilinear)}


def hierarchy_options(**options):
    """Return options under which the shapes are solved one after the other."""
    usual = {"gap": 0.0, "node_limit": 0, "time_limit": 20.0, "skip": ("full",)}
    return Options(effort="auto", **usual | options)
