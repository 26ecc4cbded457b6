"""Test problems with known optima, of any size.

Objective and ``squares`` come from the same numbers, whose products and sums are exact in
double precision: the stated optimum is that of the very doubles in the problem.

References
----------
J. J. More, B. S. Garbow, K. E. Hillstrom, ACM Trans. Math. Softw. 7 (1981) 17-41.
A. R. Conn, N. I. M. Gould, Ph. L. Toint, Math. Comp. 50 (1988) 399-430.
H. Waki, S. Kim, M. Kojima, M. Muramatsu, SIAM J. Optim. 17 (2006) 218-242, section 6.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import monomials
from .errors import ProblemError
from .monomials import Words
from .polynomial import Polynomial, variables
from .problem import Problem

__all__ = [
    "broyden_banded",
    "broyden_tridiagonal",
    "chained_singular",
    "chained_wood",
    "laboratory",
    "motzkin",
    "planted_point",
    "random_quartic",
    "rosenbrock",
]

Term = tuple[float, Sequence[int]]

_TENTH = round(0.1 * 2**40) / 2**40  # 0.1 to 40 bits: sums with integers stay exact


def rosenbrock(n: int) -> Problem:
    """Generalised Rosenbrock function.

    ``1 + sum_{i=2}^n [100 (x_i - x_{i-1}^2)^2 + (1 - x_i)^2]``, without bounds. The
    optimum is 1, at (1, ..., 1) and, with the sign of x_1 changed, at (-1, 1, ..., 1).

    Parameters
    ----------
    n : int
        Number of variables, at least 2.

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
    _check(n, 2)
    i = np.arange(1, n)
    curved = _Squares.build(100.0, i, [(1.0, [1]), (-1.0, [0, 0])], n)
    return _least_squares(n, 1.0, curved, _Squares.build(1.0, i, [(1.0, []), (-1.0, [1])], n))


def broyden_tridiagonal(n: int) -> Problem:
    """Broyden's tridiagonal function.

    ``sum_{i=1}^n ((3 - 2 x_i) x_i - x_{i-1} - 2 x_{i+1} + 1)^2`` with x_0 = x_{n+1} = 0,
    without bounds. The optimum is 0, at the zero of the residuals that Newton's method
    finds from (-1, ..., -1).

    Parameters
    ----------
    n : int
        Number of variables, at least 2.

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
    _check(n, 2)
    terms = [(3.0, [0]), (-2.0, [0, 0]), (-1.0, [-1]), (-2.0, [1]), (1.0, [])]
    return _least_squares(n, 0.0, _Squares.build(1.0, np.arange(1, n + 1), terms, n))


def broyden_banded(n: int) -> Problem:
    """Broyden's banded function.

    ``sum_{i=1}^n (x_i (2 + 5 x_i^2) + 1 - sum_{j in J_i} (1 + x_j) x_j)^2`` with
    J_i = {j : max(1, i-5) <= j <= min(n, i+1), j != i}, without bounds. The optimum is 0,
    at the zero of the residuals that Newton's method finds from (-1, ..., -1).

    Parameters
    ----------
    n : int
        Number of variables, at least 2.

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
    _check(n, 2)
    terms: list[Term] = [(2.0, [0]), (5.0, [0, 0, 0]), (1.0, [])]
    for j in (-5, -4, -3, -2, -1, 1):
        terms += [(-1.0, [j]), (-1.0, [j, j])]
    return _least_squares(n, 0.0, _Squares.build(1.0, np.arange(1, n + 1), terms, n))


def chained_singular(n: int) -> Problem:
    """Chained singular function.

    ``sum_{i in J} [(x_i + 10 x_{i+1})^2 + 5 (x_{i+2} - x_{i+3})^2 + (x_{i+1} - 2 x_{i+2})^4
    + 10 (x_i - 10 x_{i+3})^4]`` with J = {1, 3, 5, ..., n-3}, without bounds. The optimum
    is 0, at the origin, where the Hessian is singular.

    Parameters
    ----------
    n : int
        Number of variables, a multiple of 4.

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
    _check(n, 4, 4)
    i = np.arange(1, n - 2, 2)
    return _least_squares(
        n,
        0.0,
        _Squares.build(1.0, i, [(1.0, [0]), (10.0, [1])], n),
        _Squares.build(5.0, i, [(1.0, [2]), (-1.0, [3])], n),
        _Squares.build(1.0, i, [(1.0, [1, 1]), (-4.0, [1, 2]), (4.0, [2, 2])], n),
        _Squares.build(10.0, i, [(1.0, [0, 0]), (-20.0, [0, 3]), (100.0, [3, 3])], n),
    )


def chained_wood(n: int) -> Problem:
    """Chained Wood function.

    ``1 + sum_{i in J} [100 (x_{i+1} - x_i^2)^2 + (1 - x_i)^2 + 90 (x_{i+3} - x_{i+2}^2)^2
    + (1 - x_{i+2})^2 + 10 (x_{i+1} + x_{i+3} - 2)^2 + 0.1 (x_{i+1} - x_{i+3})^2]`` with
    J = {1, 3, 5, ..., n-3}, without bounds. The optimum is 1, at (1, ..., 1). The weight
    0.1 is rounded to 40 bits (a change of 4e-13), which keeps all coefficients exact.

    Parameters
    ----------
    n : int
        Number of variables, a multiple of 4.

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
    _check(n, 4, 4)
    i = np.arange(1, n - 2, 2)
    return _least_squares(
        n,
        1.0,
        _Squares.build(100.0, i, [(1.0, [1]), (-1.0, [0, 0])], n),
        _Squares.build(1.0, i, [(1.0, []), (-1.0, [0])], n),
        _Squares.build(90.0, i, [(1.0, [3]), (-1.0, [2, 2])], n),
        _Squares.build(1.0, i, [(1.0, []), (-1.0, [2])], n),
        _Squares.build(10.0, i, [(1.0, [1]), (1.0, [3]), (-2.0, [])], n),
        _Squares.build(_TENTH, i, [(1.0, [1]), (-1.0, [3])], n),
    )


def random_quartic(
    n: int,
    clique: int | None = None,
    seed: int = 0,
    density: float = 0.5,
    optimum: float = 1.0,
) -> Problem:
    """Random quartic on [-1, 1]^n with a planted minimiser.

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

    Raises
    ------
    ProblemError
        If ``n``, ``clique`` or ``density`` is out of range.

    Examples
    --------
    >>> problem = random_quartic(6, clique=3, seed=1)
    >>> problem.objective(planted_point(6, seed=1))
    1.0
    """
    _check(n, 1)
    width = n if clique is None else clique
    if not 1 <= width <= n:
        raise ProblemError(f"clique: found {clique}, expected 1 <= clique <= {n}")
    if not 0 < density <= 1:
        raise ProblemError(f"density: found {density}, expected 0 < density <= 1")
    rng = np.random.default_rng([seed, 1])
    basis = monomials.full_basis(width, 2)
    windows = np.arange(n - width + 1)
    words = basis + (basis > 0) * windows[:, None, None].astype(np.int32)
    shape = (windows.size, width + 1, basis.shape[0])
    coefficients = rng.integers(-8, 9, shape) / 8 * (rng.random(shape) < density)
    values = monomials.evaluate(words.reshape(-1, 2), planted_point(n, seed))
    values = values.reshape(windows.size, 1, -1)
    coefficients[..., 0] = -(coefficients[..., 1:] * values[..., 1:]).sum(axis=-1)
    family = _Squares(1.0, words, coefficients)
    return _least_squares(n, optimum, family, lower=-1.0, upper=1.0)


def planted_point(n: int, seed: int = 0) -> NDArray[np.float64]:
    """Minimiser of :func:`random_quartic` for the same ``n`` and ``seed``, shape (n,).

    Examples
    --------
    >>> bool(np.all(np.abs(planted_point(5)) <= 0.75))
    True
    """
    return np.random.default_rng([seed, 0]).integers(-3, 4, n) / 4


def laboratory() -> Problem:
    """A small nonconvex problem with an equality and no bounds.

    ``min x1^2 + x2^2 - 4 x1 - 6 x2 + 13`` subject to ``x1 x2 - 7 x2 == 10`` and
    ``x2 + 0.5 x1 >= 1``. The optimum is 52.7066065447 at (8.8605284, 5.3748171), on the
    branch x1 > 7 of x2 = 10 / (x1 - 7), the only one that the inequality leaves.

    Examples
    --------
    >>> laboratory()
    <Problem: 2 variables, 1 inequalities, 1 equalities, degree 2>
    """
    x1, x2 = variables(2)
    objective = x1**2 + x2**2 - 4 * x1 - 6 * x2 + 13
    return Problem(objective, [x1 * x2 - 7 * x2 == 10, x2 + 0.5 * x1 >= 1])


def motzkin() -> Problem:
    """Motzkin's polynomial, non-negative but no sum of squares.

    ``x1^4 x2^2 + x1^2 x2^4 - 3 x1^2 x2^2 + 1``, without bounds. The optimum is 0, at the
    four points (+-1, +-1).

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


# ---- many squares of one shape, as arrays -----------------------------------------------


@dataclass(frozen=True, eq=False)
class _Squares:
    """``weight * sum_{m, g} (sum_t coefficients[m, g, t] * words[m, t])^2``.

    ``words`` is (M, T, D) with sorted letters and distinct words in each m.
    """

    weight: float
    words: Words
    coefficients: NDArray[np.float64]

    @staticmethod
    def build(weight: float, centres: NDArray, terms: Sequence[Term], n: int) -> _Squares:
        """One square for each i in ``centres``; a term (c, [a, b]) stands for c x_{i+a} x_{i+b}.

        Variables outside 1..n are zero, and so are the terms that contain them.
        """
        width = max(len(shifts) for _, shifts in terms)
        words = np.zeros((centres.size, len(terms), width), np.int32)
        coefficients = np.zeros((centres.size, 1, len(terms)))
        for t, (coefficient, shifts) in enumerate(terms):
            letters = centres[:, None] + np.array(shifts, np.int64)
            inside = np.all((letters >= 1) & (letters <= n), axis=1)
            words[inside, t, width - len(shifts) :] = letters[inside]
            coefficients[inside, 0, t] = coefficient
        words.sort(axis=-1)
        return _Squares(weight, words, coefficients)

    def expanded(self) -> tuple[Words, NDArray[np.float64]]:
        """Words (N, 2 D) and coefficients (N,) of the sum, equal words not yet merged."""
        gram = self.weight * np.einsum("mgs,mgt->mst", self.coefficients, self.coefficients)
        s, t = np.triu_indices(self.words.shape[1])
        values = gram[:, s, t] * np.where(s == t, 1.0, 2.0)
        kept = values != 0.0
        words = monomials.multiply(self.words[:, s], self.words[:, t])
        return words[kept], values[kept]

    def polynomials(self, n: int) -> Iterator[Polynomial]:
        """Yield the squared polynomials, each in its normal form, without zeros."""
        count, terms, width = self.words.shape
        keys = monomials.pack(self.words.reshape(-1, width), n).reshape(count, terms)
        order = np.argsort(keys, axis=1)
        words = np.take_along_axis(self.words, order[:, :, None], axis=1)
        coefficients = np.take_along_axis(self.coefficients, order[:, None, :], axis=2)
        present = coefficients != 0.0
        degree = np.where(present, monomials.degrees(words)[:, None, :], 0).max(axis=-1)
        for m, g in np.argwhere(present.any(axis=-1)).tolist():
            kept = present[m, g]
            letters = words[m, kept, width - max(1, int(degree[m, g])) :]
            values = coefficients[m, g, kept]
            letters.flags.writeable = values.flags.writeable = False
            yield Polynomial(letters, values, n)


def _least_squares(
    n: int,
    constant: float,
    *families: _Squares,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
) -> Problem:
    parts = [(np.zeros((1, 1), np.int32), np.array([constant]))]
    parts += [family.expanded() for family in families]
    width = max(words.shape[1] for words, _ in parts)
    words = np.concatenate([monomials.widen(words, width) for words, _ in parts])
    values = np.concatenate([values for _, values in parts])
    objective = Polynomial.from_words(words, values, n)
    squares = [(f.weight, p) for f in families for p in f.polynomials(n)]
    return Problem(objective, lower=lower, upper=upper, squares=squares)


def _check(n: int, least: int, multiple: int = 1) -> None:
    if n < least or n % multiple:
        raise ProblemError(f"n: found {n}, expected a multiple of {multiple}, at least {least}")
