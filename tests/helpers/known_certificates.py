"""Problems with known optima, and ways to change their certificates."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np

import sparsepop_py as sp

INF = np.inf


def circle():
    """min x + 2 y on the unit circle without its lower right: -sqrt(5) at -(1, 2) / sqrt(5)."""
    x, y = sp.variables(2)
    return sp.Problem(x + 2 * y, [x**2 + y**2 == 1, x * y >= -0.25], lower=-2, upper=2)


def disc():
    """min x y on the unit disc: -1/2."""
    x, y = sp.variables(2)
    return sp.Problem(x * y, [x**2 + y**2 <= 1])


def hill():
    """No bounds, so that a sublevel box is needed: -1/8 at x = y = 1/2 and x = y = -1/2."""
    x, y = sp.variables(2)
    return sp.Problem(x**4 + y**4 - x * y, [x * y >= -4])


def chain():
    """Three cliques, a cutoff, products: min -> 0 at (1, 1, 1, 1) of squares, expanded."""
    x = sp.variables(4)
    f = sp.total((x[i + 1] - x[i] ** 2) ** 2 + (1 - x[i]) ** 2 for i in range(3))
    return sp.Problem(f, [x[0] * x[1] >= 0.5], lower=-2, upper=2)


def lattice():
    """Binary: min (x + y + z - 1.5)^2 over {-1, 1}^3 is 1/4."""
    x = sp.variables(3)
    return sp.Problem((x[0] + x[1] + x[2] - 1.5) ** 2, [v**2 == 1 for v in x])


def empty():
    """No point of the disc has x y >= 0.51 (Farkas, no propagation)."""
    x, y = sp.variables(2)
    return sp.Problem(x, [x**2 + y**2 <= 1, x * y >= 0.51], lower=-2, upper=2)


KNOWN = {
    circle: -np.sqrt(5.0),
    disc: -0.5,
    hill: -0.125,
    chain: 0.0,
    lattice: 0.25,
    empty: INF,
}


def check(certificate, problem, optimum):
    """ok exactly when the recomputed bound reaches the claim; never a bound above the truth."""
    verdict = certificate.verify(problem)
    assert verdict.ok == (verdict.bound >= certificate.bound)
    assert verdict.ok or verdict.reason
    if verdict.ok:
        assert certificate.bound <= verdict.bound
    assert verdict.bound <= optimum
    return verdict


def last_bit(problem, where):
    """The problem with one coefficient or bound changed in its last bit."""
    f, rows = problem.objective, list(problem.constraints)
    low, high = problem.lower.copy(), problem.upper.copy()

    def nudged(p):
        values = p.coefficients.copy()
        values[-1] = np.nextafter(values[-1], INF)
        return sp.Polynomial.from_words(p.words, values, p.dimension, p.names)

    if where == "objective":
        f = nudged(f)
    elif where == "constraint":
        rows[0] = sp.Constraint(nudged(rows[0].polynomial), rows[0].kind)
    elif where == "kind":
        other = {sp.Kind.ZERO: sp.Kind.NONNEGATIVE, sp.Kind.NONNEGATIVE: sp.Kind.ZERO}
        rows[0] = sp.Constraint(rows[0].polynomial, other[rows[0].kind])
    elif where == "lower":
        low[0] = np.nextafter(low[0], INF) if np.isfinite(low[0]) else -1e300
    elif where == "upper":
        high[-1] = np.nextafter(high[-1], INF) if np.isfinite(high[-1]) else 1e300
    elif where == "row added":
        rows.append(sp.variables(problem.dimension)[0] <= 100)
    elif where == "row dropped":
        rows = rows[1:]
    return sp.Problem(f, rows, low, high, problem.names)


def with_root(certificate, **parts):
    """The certificate with some parts of its root replaced."""
    return replace(certificate, root=replace(certificate.root, **parts))


def with_multipliers(certificate, change):
    identity = certificate.identity
    changed = tuple(change(group) for group in identity.multipliers)
    return with_root(certificate, argument=replace(identity, multipliers=changed))


@functools.cache
def known_results():
    """The result of each known problem, at an order that is enough."""
    orders = {hill: 3, lattice: 2}
    return {make: sp.solve(make(), sp.Options(order=orders.get(make, 2))) for make in KNOWN}
