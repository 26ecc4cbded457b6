"""Discrete-time optimal control: states y follow from controls x by polynomial steps.

References
----------
T. F. Coleman, A. Liao, An efficient trust region method for unconstrained discrete-time
optimal control problems, Comput. Optim. Appl. 4 (1995) 47-66.
H. Waki, S. Kim, M. Kojima, M. Muramatsu, SIAM J. Optim. 17 (2006) 218-242, section 6.2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial
from sparsepop_py.errors import ProblemError, check_number
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problems.least_squares import Squares, check_size, least_squares

__all__ = ["bilinear_control", "scalar_control"]


def bilinear_control(
    steps: int, controls: int = 2, states: int = 4, mu: float = 0.0, rest: float = 0.5
) -> Problem:
    """Build a control problem: quartic cost, bilinear dynamics.

    ``sum_{i=1}^{M-1} [sum_j (y_{i,j} + 1/4)^4 + sum_j (x_{i,j} + r)^4] + sum_j (y_{M,j} +
    1/4)^4`` subject to ``y_{i+1} = A y_i + B x_i + (y_i' C x_i) e`` and ``y_1 = 0``, with A_jj
    = 1/2, A_{j,j+1} = 1/4, A_{j,j-1} = -1/4, all others 0, B_jk = (j - k) / (N_x + N_y), C_jk =
    mu (j + k) / (N_x + N_y), and e = (1, ..., 1). Variables are x_1, y_2, x_2, y_3, ..., y_M.

    Parameters
    ----------
    steps : int
        M, at least 2.
    controls, states : int
        N_x and N_y, the lengths of each x_i and y_i.
    mu : float
        Size of the bilinear part, >= 0.
    rest : float
        r, minus the control that costs nothing; a multiple of 1/4 keeps all data exact.

    Returns
    -------
    Problem

    Raises
    ------
    ProblemError
        If a number is out of range.

    Notes
    -----
    Optimum 0.0580887 for (6, 2, 4, 0), as SparsePOP 3.03 solves its example optControl. With
    r = 1/4 the test suite of PolynomialOptimization.jl has 0.0282973 for (6, 1, 2, 1) and
    0.0440061 for (12, 2, 4, 0).

    References
    ----------
    Coleman, Liao (1995), problem 1; Waki et al. (2006), (6.1).

    Examples
    --------
    >>> bilinear_control(6, 2, 4)
    <Problem: 30 variables, 0 inequalities, 20 equalities, degree 4>
    """
    check_size(steps, 2, field="steps")
    check_size(controls, 1, field="controls")
    check_size(states, 1, field="states")
    numbers = steps * states * (states + controls)
    check_size(numbers, 4, field="steps * states * (states + controls)")
    mu, rest = check_number(mu, "mu", 0.0), check_number(rest, "rest")
    if not np.isfinite([mu, rest]).all():
        raise ProblemError(f"mu, rest: found {mu} and {rest}, expected finite numbers")
    j, k = np.arange(1, states + 1)[:, None], np.arange(1, controls + 1)
    drift = 0.5 * np.eye(states) + 0.25 * (np.eye(states, k=1) - np.eye(states, k=-1))
    gain, coupling = (j - k) / (controls + states), mu * (j + k) / (controls + states)
    each = controls + states
    n = (steps - 1) * each
    rows = []
    for step in range(steps - 1):
        x = step * each + np.arange(1, controls + 1)
        old, new = x[0] - states + np.arange(states), x[-1] + np.arange(1, states + 1)
        pairs = np.column_stack([np.repeat(old, controls), np.tile(x, states)])
        for line in range(states):
            letters = [np.append(old, x), new[[line]]]
            values = [drift[line], gain[line], [-1.0]]
            if step == 0:  # y_1 = 0
                letters[0], values[0] = x, np.zeros(0)
            rows.append(_equation(letters, values, pairs, coupling * (step > 0), n))
    place = np.arange(1, n + 1).reshape(-1, each)
    cost = least_squares(
        n,
        states / 256.0,  # what y_1 costs
        _fourth_powers(place[:, controls:].ravel(), 0.25, n),
        _fourth_powers(place[:, :controls].ravel(), rest, n),
    )
    names = [
        f"{letter}{step + shift}_{number}"
        for step in range(1, steps)
        for letter, shift, size in (("x", 0, controls), ("y", 1, states))
        for number in range(1, size + 1)
    ]
    return Problem(cost.objective, rows, names=names, squares=cost.squares)


def _fourth_powers(number: NDArray[Any], shift: float, n: int) -> Squares:
    """Squares of (x_v + shift)^2."""
    terms = [(1.0, [0, 0]), (2.0 * shift, [0]), (shift * shift, [])]
    return Squares.build(1.0, number, [term for term in terms if term[0]], n)


def _equation(
    linear: list[NDArray[Any]],
    values: list[NDArray[Any]],
    pairs: NDArray[Any],
    coupling: NDArray[Any],
    n: int,
) -> Constraint:
    """Build the constraint: values times linear plus coupling times pairs is zero."""
    letters, size = np.concatenate(linear), np.concatenate(values)
    words = np.column_stack([np.zeros_like(letters), letters]).astype(np.int32)
    if coupling.any():
        words = np.concatenate([words, np.sort(pairs, axis=1).astype(np.int32)])
        size = np.append(size, coupling.ravel())
    return Constraint(Polynomial.from_words(words, size, n), Kind.ZERO)


def scalar_control(steps: int) -> Problem:
    """Build a control problem: quadratic cost, one state, quadratic dynamics.

    ``(1 / M) sum_{i=1}^{M-1} (y_{i+1}^2 + x_i^2)`` subject to ``y_{i+1} = y_i + (y_i^2 - x_i) /
    M`` and ``y_1 = 1``. Variables are x_1, y_2, x_2, y_3, ..., y_M. 1 / M is rounded to a double.

    Parameters
    ----------
    steps : int
        M, at least 2.

    Returns
    -------
    Problem

    Raises
    ------
    ProblemError
        If ``steps`` is too small.

    Notes
    -----
    Published optimum: 1.514110 for M = 20 (38 variables).

    References
    ----------
    Coleman, Liao (1995); Waki et al. (2006), (6.2).

    Examples
    --------
    >>> scalar_control(20)
    <Problem: 38 variables, 0 inequalities, 19 equalities, degree 2>
    """
    check_size(steps, 2, field="steps")
    n, share = 2 * (steps - 1), 1.0 / steps
    rows = []
    for step in range(steps - 1):
        x = 2 * step + 1
        if step == 0:
            words, values = [[0, 0], [0, x], [0, x + 1]], [1.0 + share, -share, -1.0]
        else:
            words = [[0, x - 1], [x - 1, x - 1], [0, x], [0, x + 1]]
            values = [1.0, share, -share, -1.0]
        row = Polynomial.from_words(np.array(words, np.int32), np.array(values), n)
        rows.append(Constraint(row, Kind.ZERO))
    cost = least_squares(n, 0.0, Squares.build(share, np.arange(1, n + 1), [(1.0, [0])], n))
    names = [f"{letter}{step + (letter == 'y')}" for step in range(1, steps) for letter in "xy"]
    return Problem(cost.objective, rows, names=names, squares=cost.squares)
