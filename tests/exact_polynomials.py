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
