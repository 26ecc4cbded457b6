"""Moments of points, and the generators of a problem by definition."""

import numpy as np
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py import Problem
from sparsepop_py.algebra import monomials

INF = np.inf
N = 4
edges = st.lists(st.sampled_from([(0, 1), (1, 2), (2, 3), (0, 3)]), max_size=3, unique=True)
kinds = st.sampled_from(["boxed", "half", "free", "fixed"])


def generator_values(problem, products, x):
    """1, the constraints, box, lower and upper of each variable, products: by definition."""
    low, high = problem.lower, problem.upper
    open_ = low < high
    both = open_ & np.isfinite(low) & np.isfinite(high)
    rows = [c.polynomial(x) for c in problem.constraints]
    with np.errstate(invalid="ignore"):
        families = [
            np.where(both, (high - x) * (x - low), 0.0),
            np.where(open_ & np.isfinite(low), x - low, 0.0),
            np.where(open_ & np.isfinite(high), high - x, 0.0),
        ]
    single = np.concatenate([[1.0], rows, *families])
    return np.concatenate([single, single[products[:, 0]] * single[products[:, 1]]])


def monomial_values(words, x):
    """Values of words by numpy powers, leading shape kept."""
    flat = words.reshape(-1, words.shape[-1])
    exponents = monomials.to_exponents(flat, x.size).toarray()
    return np.prod(x[None, :] ** exponents, axis=1).reshape(words.shape[:-1])


@st.composite
def planted(draw):
    """A random problem with a feasible point of quarters; rows touch one or two variables."""
    x = sp.variables(N)
    point = np.array([draw(st.integers(-4, 4)) / 4 for _ in range(N)])
    small = st.integers(-3, 3)
    f = sp.total(
        [x[0] * 0.0, *(draw(small) * v**2 + draw(small) * v for v in x)]
        + [draw(small) * x[i] * x[j] for i, j in draw(edges)]
    )
    rows = []
    for i, j in draw(edges):
        degree = draw(st.integers(1, 3))
        p = draw(small) * x[i] ** degree + x[j] + draw(small) * x[i] * x[j] + draw(small) * x[j]
        p = p - p(point)
        if p.degree:
            rows.append(p == 0 if draw(st.booleans()) else p + draw(st.integers(0, 2)) >= 0)
    lower, upper = np.full(N, -INF), np.full(N, INF)
    for v in range(N):
        kind = draw(kinds)
        if kind in ("boxed", "half"):
            lower[v] = -1.0
        if kind == "boxed":
            upper[v] = 1.0
        if kind == "fixed":
            lower[v] = upper[v] = point[v]
    return Problem(f, rows, lower, upper), point
