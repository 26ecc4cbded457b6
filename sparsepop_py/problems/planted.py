"""Random polynomials with a planted minimiser."""

from __future__ import annotations

from math import comb

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.errors import ProblemError, check_number, check_whole
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problems.least_squares import MOST, Squares, check_size, least_squares

__all__ = ["planted_point", "random_quartic"]


def random_quartic(
    n: int,
    clique: int | None = None,
    seed: int = 0,
    density: float = 0.5,
    optimum: float = 1.0,
) -> Problem:
    """Build a random quartic on [-1, 1]^n with a planted minimiser.

    A constant plus, for each window of ``clique`` consecutive variables, ``clique + 1``
    squares of random quadratics that vanish at :func:`planted_point`. The optimum is
    ``optimum``, attained there. Coefficients are multiples of 1/8 and the point has
    multiples of 1/4, so that all of this is exact in double precision.

    Parameters
    ----------
    n : int
        Number of variables.
    clique : int, optional
        Width of the windows; all n variables when left out.
    seed : int
    density : float
        Expected share of the quadratic's coefficients that are not zero, in (0, 1].
    optimum : float
        The planted optimum.

    Returns
    -------
    Problem

    Raises
    ------
    ProblemError
        If a number is out of range.

    Examples
    --------
    >>> problem = random_quartic(6, clique=3, seed=1)
    >>> problem.objective(planted_point(6, seed=1))
    1.0
    """
    check_size(n, 1)
    width = n if clique is None else check_whole(clique, "clique", 1, n)
    terms = (n - width + 1) * comb(width + 2, 2)
    if terms > MOST:
        raise ProblemError(f"clique: found {width}, with {terms} terms, expected at most {MOST}")
    if not 0 < check_number(density, "density") <= 1:
        raise ProblemError(f"density: found {density}, expected 0 < density <= 1")
    seed = check_whole(seed, "seed", 0)
    if not np.isfinite(check_number(optimum, "optimum")):
        raise ProblemError(f"optimum: found {optimum}, expected a finite number")
    rng = np.random.default_rng([seed, 1])
    basis = monomials.full_basis(width, 2)
    windows = np.arange(n - width + 1)
    words = basis + (basis > 0) * windows[:, None, None].astype(np.int32)
    shape = (windows.size, width + 1, basis.shape[0])
    coefficients = rng.integers(-8, 9, shape) / 8 * (rng.random(shape) < density)
    values = monomials.evaluate(words.reshape(-1, 2), planted_point(n, seed))
    values = values.reshape(windows.size, 1, -1)
    coefficients[..., 0] = -(coefficients[..., 1:] * values[..., 1:]).sum(axis=-1)
    family = Squares(1.0, words, coefficients)
    return least_squares(n, optimum, family, lower=-1.0, upper=1.0)


def planted_point(n: int, seed: int = 0) -> NDArray[np.float64]:
    """Return the minimiser of :func:`random_quartic`.

    Parameters
    ----------
    n : int
        Number of variables.
    seed : int

    Returns
    -------
    (n,) float
        For the same ``n`` and ``seed``.

    Raises
    ------
    ProblemError
        If a number is out of range.

    Examples
    --------
    >>> bool(np.all(np.abs(planted_point(5)) <= 0.75))
    True
    """
    check_size(n, 1)
    return np.random.default_rng([check_whole(seed, "seed", 0), 0]).integers(-3, 4, n) / 4
