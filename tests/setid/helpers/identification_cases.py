"""Laboratory records of the course on robust identification, and linear programs over rows.

The numbers that tests compare with come from V. Cerone's course notes (Laboratory of Robust
Identification and Control, Politecnico di Torino, 2024/25, chapters 8 and 9) and from
independent linear programs on the same records. numpy's ``RandomState(5489)`` gives the
numbers of MATLAB's ``rng('default'); rand``.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

import setid
import sparsepop_py as sp

PLANT = np.array([-0.7647, 0.3012, 0.0, 32.24, 21.41])
NAMES = ("a1", "a2", "b0", "b1", "b2")


def laboratory_two_first() -> setid.IOData:
    """Theta = (-0.5, 2), e = (0.05, -0.25, 0.3, -0.5), y(1) = 0."""
    return setid.IOData([4.0, -3.0, 2.0, 1.0], [0.0, -6.25, 1.175, 2.0875])


def laboratory_two_second(bound: float, samples: int = 1000) -> setid.IOData:
    """A second-order plant with uniform equation errors, at rest for two samples."""
    r = np.random.RandomState(5489)
    u = r.random_sample(samples)
    y = np.zeros(samples)
    a1, a2, b0, b1, b2 = PLANT
    for t in range(2, samples):
        e = 2 * bound * r.random_sample() - bound
        y[t] = -a1 * y[t - 1] - a2 * y[t - 2] + b0 * u[t] + b1 * u[t - 1] + b2 * u[t - 2] + e
    return setid.IOData(u, y)


def linear_intervals(formulation: setid.Formulation) -> np.ndarray:
    """Exact intervals (p, 2) of a formulation whose rows are all linear."""
    problem, p = formulation.problem, len(formulation.parameters)
    assert problem.degree == 1 and problem.dimension == p
    matrix, right = [], []
    for row in problem.constraints:
        assert row.kind is sp.Kind.NONNEGATIVE
        slope = np.zeros(p)
        constant = 0.0
        words, values = row.polynomial.words[:, -1], row.polynomial.coefficients
        for word, value in zip(words, values, strict=True):
            if word:
                slope[word - 1] = value
            else:
                constant = value
        matrix.append(-slope)
        right.append(constant)
    box = np.stack([problem.lower, problem.upper], axis=1)
    ends = np.empty((p, 2))
    for i in range(p):
        for j, sign in enumerate((1.0, -1.0)):
            cost = np.zeros(p)
            cost[i] = sign
            found = linprog(cost, A_ub=np.array(matrix), b_ub=right, bounds=box, method="highs")
            ends[i, j] = sign * found.fun if found.status == 0 else np.nan
    return ends
