"""Polynomials as dictionaries of rationals, and what multipliers multiply, without rounding."""

from __future__ import annotations

from fractions import Fraction
from itertools import product


def value_at(polynomial, point, number=Fraction):
    """Value at a point, in rationals or numbers of another kind; coefficients are exact doubles."""
    result = number(0)
    for word, coefficient in zip(polynomial.words, polynomial.coefficients, strict=True):
        term = number(float(coefficient))
        for letter in word.tolist():
            if letter:
                term *= number(point[letter - 1])
        result += term
    return result


def times(p, q):
    result = {}
    for (a, u), (b, v) in product(p.items(), q.items()):
        key = tuple(sorted(a + b))
        result[key] = result.get(key, Fraction(0)) + u * v
    return result


def plus(p, q, weight=Fraction(1)):
    result = dict(p)
    for key, value in q.items():
        result[key] = result.get(key, Fraction(0)) + weight * value
    return result


def in_t(polynomial, scaling):
    """The polynomial after x = centre + scale * t, exactly."""
    result = {}
    for word, coefficient in zip(polynomial.words, polynomial.coefficients, strict=True):
        term = {(): Fraction(float(coefficient))}
        for letter in word.tolist():
            if letter:
                centre = Fraction(float(scaling.centre[letter - 1]))
                size = Fraction(float(scaling.scale[letter - 1]))
                term = times(term, {(): centre, (letter,): size})
        result = plus(result, term)
    return result


def exact_generators(problem, identity):
    """Generators by number for a problem whose variables are all boxed and not fixed."""
    n, scaling = problem.dimension, identity.scaling
    one, minus = Fraction(1), Fraction(-1)
    found = [{(): one}] + [in_t(c.polynomial, scaling) for c in problem.constraints]
    found += [{(): one, (v, v): minus} for v in range(1, n + 1)]
    found += [{(): one, (v,): one} for v in range(1, n + 1)]
    found += [{(): one, (v,): minus} for v in range(1, n + 1)]
    for a, b in identity.products.tolist():
        found.append(times(found[a], found[b]))
    return found


def least(rest):
    """r_0 - sum |r_a| (max(0, -r_a) for even a) of a remainder."""
    rest = dict(rest)
    bound = rest.pop((), Fraction(0))
    for word, value in rest.items():
        even = all(word.count(letter) % 2 == 0 for letter in word)
        bound -= max(Fraction(0), -value) if even else abs(value)
    return bound


def exact_matrix(constraint, scaling):
    """The matrix of a constraint in t, from its lower triangle or, of a cone, as an arrow."""
    f, side = [in_t(p, scaling) for p in constraint.entries], range(constraint.side)
    if constraint.kind.name == "PSD":
        return [[f[max(i, j) * (max(i, j) + 1) // 2 + min(i, j)] for j in side] for i in side]
    return [[f[0] if i == j else f[i + j] if 0 in (i, j) else {} for j in side] for i in side]


def exact_bound(identity, problem):
    """What an identity proves on the box of its scaling, with no rounding anywhere."""
    generators = exact_generators(problem, identity)
    rest = in_t(problem.objective, identity.scaling)
    for group in identity.multipliers:
        for k, generator in enumerate(group.generator.tolist()):
            basis = [tuple(v for v in word if v) for word in group.basis[k].tolist()]
            values = group.values[k].astype(float).reshape(len(basis), -1).tolist()
            rows = [[Fraction(v) for v in row] for row in values]
            if group.free:
                for b, (value,) in zip(basis, rows, strict=True):
                    rest = plus(rest, times({b: value}, generators[generator]), Fraction(-1))
                continue
            matrix, place = [[generators[generator]]], [0] * len(basis)
            if group.place is not None:
                row = problem.constraints[generator - 1]
                matrix, place = exact_matrix(row, identity.scaling), group.place[k].tolist()
            for (i, a), (j, b) in product(enumerate(basis), enumerate(basis)):
                gram = sum((u * v for u, v in zip(rows[i], rows[j], strict=True)), Fraction(0))
                gram += Fraction(group.floor) if i == j else 0
                part = times({tuple(sorted(a + b)): gram}, matrix[place[i]][place[j]])
                rest = plus(rest, part, Fraction(-1))
    return least(rest)
