"""Unconstrained sums of squares of any size, with known optima.

References
----------
J. J. More, B. S. Garbow, K. E. Hillstrom, ACM Trans. Math. Softw. 7 (1981) 17-41.
A. R. Conn, N. I. M. Gould, Ph. L. Toint, Math. Comp. 50 (1988) 399-430.
H. Waki, S. Kim, M. Kojima, M. Muramatsu, SIAM J. Optim. 17 (2006) 218-242, section 6.
"""

from __future__ import annotations

import numpy as np

from sparsepop_py.problem.problem import Problem
from sparsepop_py.problems.least_squares import Squares, Term, check_size, least_squares

__all__ = [
    "broyden_banded",
    "broyden_tridiagonal",
    "chained_singular",
    "chained_wood",
    "nondquar",
    "rosenbrock",
]

_TENTH = round(0.1 * 2**40) / 2**40  # 0.1 to 40 bits: sums with integers stay exact


def rosenbrock(n: int) -> Problem:
    """Build the generalised Rosenbrock function.

    ``1 + sum_{i=2}^n [100 (x_i - x_{i-1}^2)^2 + (1 - x_i)^2]``, without bounds. The
    optimum is 1, at (1, ..., 1) and, with the sign of x_1 changed, at (-1, 1, ..., 1).

    Parameters
    ----------
    n : int
        Number of variables, at least 2.

    Returns
    -------
    Problem

    Raises
    ------
    ProblemError
        If ``n`` is too small.

    References
    ----------
    S. G. Nash, SIAM J. Numer. Anal. 21 (1984) 770-788; Waki et al. (2006), section 6.1.

    Examples
    --------
    >>> problem = rosenbrock(10)
    >>> problem.objective(np.ones(10))
    1.0
    """
    check_size(n, 2)
    i = np.arange(1, n)
    curved = Squares.build(100.0, i, [(1.0, [1]), (-1.0, [0, 0])], n)
    return least_squares(n, 1.0, curved, Squares.build(1.0, i, [(1.0, []), (-1.0, [1])], n))


def broyden_tridiagonal(n: int) -> Problem:
    """Build Broyden's tridiagonal function.

    ``sum_{i=1}^n ((3 - 2 x_i) x_i - x_{i-1} - 2 x_{i+1} + 1)^2`` with x_0 = x_{n+1} = 0,
    without bounds. The optimum is 0, at the zero of the residuals that Newton's method
    finds from (-1, ..., -1).

    Parameters
    ----------
    n : int
        Number of variables, at least 2.

    Returns
    -------
    Problem

    Raises
    ------
    ProblemError
        If ``n`` is too small.

    References
    ----------
    More, Garbow, Hillstrom (1981), problem 30; Waki et al. (2006), section 6.1.

    Examples
    --------
    >>> broyden_tridiagonal(5).objective(np.zeros(5))
    5.0
    """
    check_size(n, 2)
    terms = [(3.0, [0]), (-2.0, [0, 0]), (-1.0, [-1]), (-2.0, [1]), (1.0, [])]
    return least_squares(n, 0.0, Squares.build(1.0, np.arange(1, n + 1), terms, n))


def broyden_banded(n: int) -> Problem:
    """Build Broyden's banded function.

    ``sum_{i=1}^n (x_i (2 + 5 x_i^2) + 1 - sum_{j in J_i} (1 + x_j) x_j)^2`` with
    J_i = {j : max(1, i-5) <= j <= min(n, i+1), j != i}, without bounds. The optimum is 0,
    at the zero of the residuals that Newton's method finds from (-1, ..., -1).

    Parameters
    ----------
    n : int
        Number of variables, at least 2.

    Returns
    -------
    Problem

    Raises
    ------
    ProblemError
        If ``n`` is too small.

    References
    ----------
    More, Garbow, Hillstrom (1981), problem 31; Waki et al. (2006), section 6.1.

    Examples
    --------
    >>> broyden_banded(8).degree
    6
    """
    check_size(n, 2)
    terms: list[Term] = [(2.0, [0]), (5.0, [0, 0, 0]), (1.0, [])]
    for j in (-5, -4, -3, -2, -1, 1):
        terms += [(-1.0, [j]), (-1.0, [j, j])]
    return least_squares(n, 0.0, Squares.build(1.0, np.arange(1, n + 1), terms, n))


def chained_singular(n: int) -> Problem:
    """Build the chained singular function.

    ``sum_{i in J} [(x_i + 10 x_{i+1})^2 + 5 (x_{i+2} - x_{i+3})^2 + (x_{i+1} - 2 x_{i+2})^4
    + 10 (x_i - 10 x_{i+3})^4]`` with J = {1, 3, 5, ..., n-3}, without bounds. The optimum
    is 0, at the origin, where the Hessian is singular.

    Parameters
    ----------
    n : int
        Number of variables, a multiple of 4.

    Returns
    -------
    Problem

    Raises
    ------
    ProblemError
        If ``n`` is not a positive multiple of 4.

    References
    ----------
    Conn, Gould, Toint (1988); Waki et al. (2006), section 6.1.

    Examples
    --------
    >>> chained_singular(8).objective(np.zeros(8))
    0.0
    """
    check_size(n, 4, 4)
    i = np.arange(1, n - 2, 2)
    return least_squares(
        n,
        0.0,
        Squares.build(1.0, i, [(1.0, [0]), (10.0, [1])], n),
        Squares.build(5.0, i, [(1.0, [2]), (-1.0, [3])], n),
        Squares.build(1.0, i, [(1.0, [1, 1]), (-4.0, [1, 2]), (4.0, [2, 2])], n),
        Squares.build(10.0, i, [(1.0, [0, 0]), (-20.0, [0, 3]), (100.0, [3, 3])], n),
    )


def chained_wood(n: int) -> Problem:
    """Build the chained Wood function.

    ``1 + sum_{i in J} [100 (x_{i+1} - x_i^2)^2 + (1 - x_i)^2 + 90 (x_{i+3} - x_{i+2}^2)^2
    + (1 - x_{i+2})^2 + 10 (x_{i+1} + x_{i+3} - 2)^2 + 0.1 (x_{i+1} - x_{i+3})^2]`` with
    J = {1, 3, 5, ..., n-3}, without bounds. The optimum is 1, at (1, ..., 1). The weight
    0.1 is rounded to 40 bits (a change of 4e-13), which keeps all coefficients exact.

    Parameters
    ----------
    n : int
        Number of variables, a multiple of 4.

    Returns
    -------
    Problem

    Raises
    ------
    ProblemError
        If ``n`` is not a positive multiple of 4.

    References
    ----------
    Conn, Gould, Toint (1988); Waki et al. (2006), section 6.1.

    Examples
    --------
    >>> chained_wood(8).objective(np.ones(8))
    1.0
    """
    check_size(n, 4, 4)
    i = np.arange(1, n - 2, 2)
    return least_squares(
        n,
        1.0,
        Squares.build(100.0, i, [(1.0, [1]), (-1.0, [0, 0])], n),
        Squares.build(1.0, i, [(1.0, []), (-1.0, [0])], n),
        Squares.build(90.0, i, [(1.0, [3]), (-1.0, [2, 2])], n),
        Squares.build(1.0, i, [(1.0, []), (-1.0, [2])], n),
        Squares.build(10.0, i, [(1.0, [1]), (1.0, [3]), (-2.0, [])], n),
        Squares.build(_TENTH, i, [(1.0, [1]), (-1.0, [3])], n),
    )


def nondquar(n: int) -> Problem:
    """Build the nondiagonal quartic function.

    ``(x_1 - x_2)^2 + (x_{n-1} + x_n)^2 + sum_{i=1}^{n-2} (x_i + x_{i+1} + x_n)^4``, without
    bounds. The optimum is 0, at the origin, where the Hessian is singular; x_n meets all
    other variables.

    Parameters
    ----------
    n : int
        Number of variables, at least 3.

    Returns
    -------
    Problem

    Raises
    ------
    ProblemError
        If ``n`` is too small.

    References
    ----------
    A. R. Conn, N. I. M. Gould, M. Lescrenier, Ph. L. Toint, Performance of a multifrontal
    scheme for partially separable optimization, Report 88/4, FUNDP Namur (1988), problem 57
    (NONDQUAR in CUTE).

    Examples
    --------
    >>> nondquar(6).objective(np.ones(6))
    328.0
    """
    check_size(n, 3)
    i = np.arange(1, n - 1)
    last = n - i  # the shift that leads from x_i to x_n
    return least_squares(
        n,
        0.0,
        Squares.build(1.0, np.array([1]), [(1.0, [0]), (-1.0, [1])], n),
        Squares.build(1.0, np.array([n]), [(1.0, [-1]), (1.0, [0])], n),
        Squares.build(
            1.0,
            i,
            [
                (1.0, [0, 0]),
                (1.0, [1, 1]),
                (1.0, [last, last]),
                (2.0, [0, 1]),
                (2.0, [0, last]),
                (2.0, [1, last]),
            ],
            n,
        ),
    )
