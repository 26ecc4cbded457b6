"""Generators: one numbering of the polynomials that multipliers multiply.

With m constraints and n variables, generator 0 is the constant 1, 1..m are the
constraints, and three families of n follow for the bounds of each variable:

    box    (u - x)(x - l)    where both bounds are finite,
    lower  x - l             where l is finite,
    upper  u - x             where u is finite;

the zero polynomial stands where a bound is missing or the variable is fixed. Products of
two generators (reformulation-linearization, Sherali and Adams 1990) may follow as further
ones, each given by the numbers of its factors, which may be products themselves. The
generator of a constraint with a matrix is the polynomial that follows from it; the matrix goes
by the same number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.matrix_constraints import Matrices
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.problem.problem import Problem

__all__ = [
    "Generators",
    "are_products",
    "bound_family",
    "bound_products",
    "bound_terms",
    "count",
    "count_chains",
    "layers",
    "partners",
    "product_terms",
    "single_letters",
    "stack_words",
    "stacked",
    "useful_products",
]


@dataclass(frozen=True, eq=False)
class Generators(PolynomialSystem):
    """All generators stacked, and beside them the matrices of the constraints."""

    matrices: Matrices


def count(rows: int, dimension: int) -> int:
    """Count the generators of a problem with so many constraints and variables."""
    return 1 + rows + 3 * dimension


def bound_family(rows: int, dimension: int) -> tuple[slice, slice, slice]:
    """Locate the families box, lower and upper."""
    starts = 1 + rows + dimension * np.arange(4)
    box, lower, upper = (slice(int(a), int(b)) for a, b in zip(starts, starts[1:], strict=False))
    return box, lower, upper


def bound_terms(
    lower: NDArray[np.float64], upper: NDArray[np.float64], rows: int
) -> tuple[Words, NDArray[np.float64], NDArray[np.int64]]:
    """List words, coefficients and generator numbers of the bounds' polynomials.

    For bounds 0 and +-1, as scaled variables have them, every coefficient is exact.
    """
    n = lower.size
    open_ = lower < upper
    low, high = np.isfinite(lower) & open_, np.isfinite(upper) & open_
    both = low & high
    start, end = np.where(low, lower, 0.0), np.where(high, upper, 0.0)
    letter = np.arange(1, n + 1, dtype=np.int32)
    zero = np.zeros(n, np.int32)
    one, linear, square = (
        np.stack(pair, axis=1) for pair in ((zero, zero), (zero, letter), (letter, letter))
    )
    box, first, second = (np.arange(f.start, f.stop) for f in bound_family(rows, n))
    parts = [
        (one, np.where(both, -start * end, 0.0), box),
        (linear, np.where(both, start + end, 0.0), box),
        (square, np.where(both, -1.0, 0.0), box),
        (one, -start, first),
        (linear, low * 1.0, first),
        (one, end, second),
        (linear, high * -1.0, second),
    ]
    words = np.concatenate([w for w, _, _ in parts])
    values = np.concatenate([v for _, v, _ in parts])
    index = np.concatenate([i for _, _, i in parts])
    keep = np.flatnonzero(values)
    keep = keep[np.argsort(index[keep], kind="stable")]
    return words[keep], values[keep], index[keep]


def stack_words(constraints: Words, bounds: Words) -> Words:
    """Stack the words of all generators: the constant 1, constraints, bounds."""
    return monomials.stack((np.zeros((1, 1), np.int32), constraints, bounds))


def single_letters(
    lower: NDArray[np.float64], upper: NDArray[np.float64], rows: int, generator: NDArray[Any]
) -> NDArray[np.int32]:
    """Find the variable v of generators +-x_v, 0 for 1, -1 for others."""
    n = lower.size
    letter = np.full(count(rows, n), -1, np.int32)
    letter[0] = 0
    _, low, high = bound_family(rows, n)
    names = np.arange(1, n + 1)
    letter[low] = np.where((lower == 0) & np.isinf(upper), names, -1)
    letter[high] = np.where((upper == 0) & np.isinf(lower), names, -1)
    known = generator < letter.size
    return np.where(known, letter[np.where(known, generator, 0)], -1).astype(np.int32)


def product_terms(
    system: PolynomialSystem, products: NDArray[np.integer]
) -> tuple[Words, NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """List terms of products of generators: word, product number, and the terms of both factors."""
    number, first = system.terms_of(products[:, 0])
    position, second = system.terms_of(products[number, 1])
    words = monomials.trim(monomials.multiply(system.words[first[position]], system.words[second]))
    return words, number[position], first[position], second


_MOST_LINEAR = 40  # inequalities of a clique, which are multiplied with each other


def useful_products(
    problem: Problem,
    members: Sequence[tuple[int, ...]],
    home: NDArray[np.int64],
    objectives: Sequence[Polynomial],
) -> NDArray[np.int64]:
    """Choose pairs of generators whose products tighten bilinear terms.

    The bounds of two variables that multiply each other somewhere, and each linear
    inequality with the bounds of such partners of its variables and with the other
    linear inequalities of its clique, unless these are many. Shape (P, 2).
    """
    n, rows = problem.dimension, problem.rows
    boxed = np.isfinite(problem.lower) & np.isfinite(problem.upper)
    boxed &= problem.lower < problem.upper
    words = [rows.words, problem.objective.words, *(f.words for f in objectives)]
    pairs = partners(words, n)
    pairs = pairs[boxed[pairs].all(axis=1)]
    _, low, high = bound_family(rows.size, n)
    sides = np.array([low.start, high.start])
    bounds = [np.stack([pairs[:, 0] + a, pairs[:, 1] + b], axis=1) for a in sides for b in sides]
    partner: dict[int, set[int]] = {}
    for i, j in pairs.tolist():
        partner.setdefault(i, set()).add(j)
        partner.setdefault(j, set()).add(i)
    mixed = []
    linear: dict[int, list[tuple[int, bool]]] = {}  # with: some partner meets it
    for number, constraint in enumerate(problem.constraints):
        if problem.equality[number] or constraint.polynomial.degree != 1:
            continue
        clique = int(home[number])
        if clique < 0:  # no clique holds it: its multiplier stays a constant
            continue
        met = set().union(*(partner.get(v, ()) for v in constraint.polynomial.support.tolist()))
        for v in sorted(met & set(members[clique])):
            mixed += [(number + 1, v + int(side)) for side in sides]
        linear.setdefault(clique, []).append((number + 1, bool(met)))
    for family in linear.values():
        if len(family) <= _MOST_LINEAR:
            mixed += [(one, two) for (one, _), (two, met) in combinations(family, 2) if met]
    return np.concatenate([*bounds, np.array(mixed, int).reshape(-1, 2)])


_LONGEST = 4  # factors of one monomial whose products of bounds are all formed


def bound_products(
    problem: Problem,
    members: Sequence[tuple[int, ...]],
    home: NDArray[np.int64],
    objectives: Sequence[Polynomial],
) -> NDArray[np.int64]:
    """Choose products for linear relaxations, (P, 2): McCormick's and those of longer monomials.

    Beside :func:`useful_products`, the bounds of each squared variable with themselves, and
    for a monomial of degree 3 or 4 all products of as many bounds, built as a chain.
    """
    n, rows = problem.dimension, problem.rows
    boxed = np.isfinite(problem.lower) & np.isfinite(problem.upper)
    boxed &= problem.lower < problem.upper
    words = [rows.words, problem.objective.words, *(f.words for f in objectives)]
    _, low, high = bound_family(rows.size, n)
    single = count(rows.size, n)
    squared = monomials.distinct(
        np.concatenate([v[p > 1] for _, v, p in map(monomials.runs, words)])
    )
    squared = squared[boxed[squared]]
    made = [
        *map(tuple, useful_products(problem, members, home, objectives).tolist()),
        *((int(v) + side, int(v) + side) for v in squared for side in (low.start, high.start)),
    ]
    number = {pair: single + k for k, pair in enumerate(made)}

    def product(first: int, second: int) -> int:
        pair = (first, second)
        if pair not in number:
            number[pair] = single + len(made)
            made.append(pair)
        return number[pair]

    every, _ = monomials.collect(monomials.stack(words), n)
    for letters in every[monomials.degrees(every) > 2].tolist():
        factors = [letter - 1 for letter in letters if letter]
        if len(factors) > _LONGEST or not all(boxed[factors]):
            continue
        chains = [factors[0] + side for side in (low.start, high.start)]
        for v in factors[1:]:
            chains = [product(c, v + side) for c in chains for side in (low.start, high.start)]
    return _shallow_first(np.array(made, np.int64).reshape(-1, 2), single)


def count_chains(words: Words) -> int:
    """Count the products of bounds for monomials of degree 3 or 4, at most.

    They are not formed.

    Parameters
    ----------
    words : (T, d) int32
    """
    degree = monomials.degrees(words)
    return int(np.sum(2 ** degree[(degree > 2) & (degree <= _LONGEST)]))


def _shallow_first(products: NDArray[np.int64], single: int) -> NDArray[np.int64]:
    """Sort products by depth, those without products as factors first."""
    depth = np.zeros(products.shape[0], int)
    for layer in layers(products, single):
        inner = products[layer] - single
        below = np.where(inner >= 0, depth[np.maximum(inner, 0)] + 1, 0)
        depth[layer] = below.max(axis=1)
    order = np.argsort(depth, kind="stable")
    number = np.empty(order.size, np.int64)
    number[order] = single + np.arange(order.size)
    renamed = np.where(products >= single, number[np.maximum(products - single, 0)], products)
    return renamed[order]


def partners(words: Sequence[Words], n: int) -> NDArray[np.int64]:
    """List pairs i < j of variables that share a monomial, shape (P, 2)."""
    keys = []
    for table in words:
        row, variable, _ = monomials.runs(table)
        for distance in range(1, table.shape[1]):
            same = np.flatnonzero(row[distance:] == row[:-distance])
            keys.append(variable[same] * n + variable[same + distance])
    unique = monomials.distinct(np.concatenate([*keys, np.zeros(0, int)])).astype(np.int64)
    return np.stack(np.divmod(unique, n), axis=1)


def stacked(problem: Problem, products: NDArray[np.int64]) -> Generators:
    """Stack every generator of the problem in its numbering.

    Parameters
    ----------
    problem : Problem
    products : (P, 2) int

    Returns
    -------
    Generators
    """
    rows, n = problem.rows, problem.dimension
    words, values, index = bound_terms(problem.lower, problem.upper, rows.size)
    single = PolynomialSystem(
        stack_words(rows.words, words),
        np.concatenate([np.ones(1), rows.coefficients, values]),
        np.concatenate([np.zeros(1, int), rows.row + 1, index]),
        count(rows.size, n),
        n,
    )
    for layer in layers(products, single.size):
        words, number, first, second = product_terms(single, products[layer])
        values = single.coefficients[first] * single.coefficients[second]
        single = PolynomialSystem(
            monomials.stack((single.words, words)),
            np.concatenate([single.coefficients, values]),
            np.concatenate([single.row, number + single.size]),
            single.size + len(layer),
            n,
        )
    return Generators(**vars(single), matrices=problem.matrices)


def layers(products: NDArray[np.integer], single: int) -> list[range]:
    """Split products into runs whose factors all come before the run."""
    runs, start = list[range](), 0
    for place, last in enumerate(products.max(axis=1, initial=0).tolist()):
        if last >= single + start and place > start:
            runs.append(range(start, place))
            start = place
    return [*runs, range(start, len(products))] if len(products) else runs


def are_products(products: NDArray[np.integer], single: int) -> bool:
    """Check that every product refers to generators before it."""
    if products.ndim != 2 or products.shape[1] != 2:
        return False
    known = single + np.arange(products.shape[0])
    return bool(np.all(products >= 0) and np.all(products < known[:, None]))
