"""A record whose problem has a star, with its ends from linear programs.

The problem is a record y_k - e_k + a (y_{k-1} - e_{k-1}) = b u_k with |e_k| <= 0.1 and the least a
or b that explains it. With a fixed it is a linear program: a grid of a, 1/500 wide, is the oracle.
"""

from __future__ import annotations

import functools

import numpy as np
from scipy.optimize import linprog

import sparsepop_py as sp
from sparsepop_py import Problem

U = np.array([1.0, -1.0, 0.5, 1.0, -0.5, -1.0, 1.0, 0.3])
Y = np.array([0.05, -1.02, -0.25, 0.87, 0.06, -0.98, 0.37, 0.5])  # a = -0.7, b = 1, and errors
NOISE = 0.1
GRID = np.linspace(-1.5, 0.0, 751)


def record(objective: int = 1, sign: float = 1.0) -> Problem:
    """Unknowns a, b, e_0, ..., e_7; objective sign * x_objective."""
    x = sp.variables(2 + Y.size)
    a, b, e = x[0], x[1], x[2:]
    rows = [
        (Y[k] - e[k]) + a * (Y[k - 1] - e[k - 1]) - b * float(U[k]) == 0 for k in range(1, Y.size)
    ]
    bound = [NOISE] * Y.size
    lower, upper = [-1.5, -3.0, *(-v for v in bound)], [0.0, 3.0, *bound]
    return Problem(sign * x[objective], rows, lower, upper)


def program(a: float, cost: np.ndarray) -> np.ndarray | None:
    """The (b, e) of least cost with that a, None if no errors explain it."""
    k = np.arange(1, Y.size)
    rows = np.zeros((k.size, 1 + Y.size))
    rows[:, 0] = U[k]
    rows[k - 1, 1 + k] += 1.0
    rows[k - 1, k] += a
    right = Y[k] + a * Y[k - 1]
    found = linprog(cost, A_eq=rows, b_eq=right, bounds=[(-3, 3)] + [(-NOISE, NOISE)] * Y.size)
    return found.x if found.status == 0 else None


@functools.cache
def feasible_points() -> np.ndarray:
    """Corners of the set for every a of the grid: the least and the largest b, and others."""
    source, found = np.random.default_rng(3), []
    for a in GRID.tolist():
        for cost in (*np.eye(1, 1 + Y.size), *-np.eye(1, 1 + Y.size), source.normal(size=9)):
            x = program(a, cost)
            if x is not None:
                found.append([a, *x])
    return np.array(found)


def least(problem: Problem) -> float:
    """Of the objective on the grid: a little above the least value."""
    return float(min(problem.objective(x) for x in feasible_points()))


ENDS = [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)]
