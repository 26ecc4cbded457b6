"""Small problems known for their difficulties."""

from __future__ import annotations

from sparsepop_py.algebra.polynomial import variables
from sparsepop_py.problem.problem import Problem

__all__ = ["laboratory", "motzkin"]


def laboratory() -> Problem:
    """Build a small nonconvex problem with an equality and no bounds.

    ``min x1^2 + x2^2 - 4 x1 - 6 x2 + 13`` subject to ``x1 x2 - 7 x2 == 10`` and
    ``x2 + 0.5 x1 >= 1``. The optimum is 52.7066065447 at (8.8605284, 5.3748171), on the
    branch x1 > 7 of x2 = 10 / (x1 - 7), the only one that the inequality leaves.

    Returns
    -------
    Problem

    Examples
    --------
    >>> laboratory()
    <Problem: 2 variables, 1 inequalities, 1 equalities, degree 2>
    """
    x1, x2 = variables(2)
    objective = x1**2 + x2**2 - 4 * x1 - 6 * x2 + 13
    return Problem(objective, [x1 * x2 - 7 * x2 == 10, x2 + 0.5 * x1 >= 1])


def motzkin() -> Problem:
    """Build Motzkin's polynomial, non-negative but no sum of squares.

    ``x1^4 x2^2 + x1^2 x2^4 - 3 x1^2 x2^2 + 1``, without bounds. The optimum is 0, at the
    four points (+-1, +-1).

    Returns
    -------
    Problem

    References
    ----------
    T. S. Motzkin, The arithmetic-geometric inequality, in: Inequalities, Academic Press
    (1967) 205-224.

    Examples
    --------
    >>> motzkin().objective([1.0, -1.0])
    0.0
    """
    x1, x2 = variables(2)
    return Problem(x1**4 * x2**2 + x1**2 * x2**4 - 3 * x1**2 * x2**2 + 1)
