"""Linear coordinates in which a polynomial of two variables has a smaller Newton polytope.

Where the leading form has real zeros, squares of degree half its own vanish along them, and each
Gram matrix in the given coordinates is singular: no margin pays for rounding. With the linear forms
of two such lines as coordinates u and v, the monomials that squares can hold are fewer, and Gram
matrices of these may be definite. Multiplied out with integers, they are exact in x and y as well.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.polynomial import Polynomial, total, variables
from sparsepop_py.verified.certificate.rational_gram import ExactGram

__all__ = ["LinearCoordinates", "coordinates_of_leading_form"]

Row = tuple[int, int]
_LARGEST = 10_000  # denominator of the slope of a line that is recognised


@dataclass(frozen=True, eq=False)
class LinearCoordinates:
    """A polynomial of two variables x in coordinates u = L x.

    Parameters
    ----------
    forms : ((int, int), (int, int))
        The rows of L.
    polynomial : Polynomial
        In u, rounded once where doubles do not hold its coefficients.
    """

    forms: tuple[Row, Row]
    polynomial: Polynomial

    def transformed(self, gram: ExactGram) -> ExactGram:
        """Multiply a Gram matrix in u out to one in x.

        Parameters
        ----------
        gram : ExactGram
            Of ``polynomial``.

        Returns
        -------
        ExactGram
            Its entries are rounded to doubles.
        """
        u = [a * x + b * y for x, y in [variables(2)] for a, b in self.forms]
        lines = []
        for i, j in monomials.to_exponents(gram.basis, 2).toarray().tolist():
            product = u[0] ** i * u[1] ** j
            lines.append(dict(zip(map(_exponents, product.words), product.fractions, strict=True)))
        names = sorted({name for line in lines for name in line}, key=lambda e: (sum(e), e))
        number = {name: k for k, name in enumerate(names)}
        sums: dict[tuple[int, int], Fraction] = {}
        for i, j, value in _filled(gram, self.polynomial):
            for a, b in {(i, j), (j, i)}:
                for (m, left), (k, right) in itertools.product(lines[a].items(), lines[b].items()):
                    place = number[m], number[k]
                    if place[0] <= place[1]:
                        sums[place] = sums.get(place, Fraction(0)) + value * left * right
        pairs = sorted(sums, key=lambda pair: pair[0] != pair[1])
        width = max(1, max(map(sum, names)))
        basis = [[0] * (width - i - j) + [1] * i + [2] * j for i, j in names]
        return ExactGram(
            np.array(basis, np.int32),
            np.array([i for i, _ in pairs], np.int64),
            np.array([j for _, j in pairs], np.int64),
            np.array([float(sums[pair]) for pair in pairs]),
        )


def coordinates_of_leading_form(objective: Polynomial) -> LinearCoordinates | None:
    """Take lines on which the leading form vanishes twice as coordinates.

    Parameters
    ----------
    objective : Polynomial

    Returns
    -------
    LinearCoordinates or None
        None for other than two variables, and where no such line has a short rational slope or
        all of them are axes.
    """
    if objective.dimension != 2 or objective.degree < 4:
        return None
    forms = list(itertools.islice(_double_lines(objective), 2))
    if all(0 in form for form in forms):
        return None
    forms = forms if len(forms) == 2 else [forms[0], _complement(forms[0])]
    (a, b), (c, d) = forms
    u, v = variables(2)
    determinant = a * d - b * c
    x, y = (d * u - b * v) / determinant, (a * v - c * u) / determinant
    powers = monomials.to_exponents(objective.words, 2).toarray().tolist()
    parts = [
        value * x**i * y**j
        for (i, j), value in zip(powers, objective.coefficients.tolist(), strict=True)
    ]
    return LinearCoordinates((forms[0], forms[1]), total(parts).as_rounded())


def _exponents(word: np.ndarray) -> tuple[int, int]:
    return int(np.count_nonzero(word == 1)), int(np.count_nonzero(word == 2))


def _filled(gram: ExactGram, objective: Polynomial) -> Iterator[tuple[int, int, Fraction]]:
    """Yield the entries with what the first of each monomial takes."""
    rest = dict(zip(map(_exponents, objective.words), objective.coefficients.tolist(), strict=True))
    left = {name: Fraction(value) for name, value in rest.items()}
    powers = monomials.to_exponents(gram.basis, 2).toarray()
    products = [(int(i), int(j)) for i, j in (powers[gram.first] + powers[gram.second]).tolist()]
    taken: dict[tuple[int, int], tuple[int, int]] = {}
    entries = zip(gram.first.tolist(), gram.second.tolist(), gram.value.tolist(), strict=True)
    for name, (i, j, value) in zip(products, entries, strict=True):
        if name not in taken:
            taken[name] = i, j
            continue
        left[name] = left.get(name, Fraction(0)) - Fraction(value) * (1 if i == j else 2)
        yield i, j, Fraction(value)
    for name, (i, j) in taken.items():
        yield i, j, left.get(name, Fraction(0)) / (1 if i == j else 2)


def _double_lines(objective: Polynomial) -> Iterator[Row]:
    """Yield primitive integer forms whose squares divide the leading form."""
    degree = objective.degree
    slopes = [Fraction(0)] * (degree + 1)  # of x^(degree - k) y^k
    for word, value in zip(objective.words, objective.coefficients.tolist(), strict=True):
        i, j = _exponents(word)
        if i + j == degree:
            slopes[j] = Fraction(value)
    if not slopes[-1] and not slopes[-2]:
        yield 1, 0  # x^2 divides it
    common = _gcd(slopes, _derivative(slopes))
    simple = _quotient(common, _gcd(common, _derivative(common)))
    if len(simple) < 2:
        return
    for root in np.roots([float(c) for c in reversed(simple)]).tolist():
        slope = Fraction(complex(root).real).limit_denominator(_LARGEST)
        if not sum(c * slope**k for k, c in enumerate(simple)):
            yield slope.numerator, -slope.denominator


def _complement(form: Row) -> Row:
    """Complete a primitive form to integer coordinates of determinant 1."""
    a, b = form
    d = pow(a, -1, abs(b)) if abs(b) > 1 else int(b == 0) * a
    c = (a * d - 1) // b if b else 0
    return c, d


def _derivative(p: list[Fraction]) -> list[Fraction]:
    return [k * c for k, c in enumerate(p)][1:]


def _trimmed(p: list[Fraction]) -> list[Fraction]:
    while p and not p[-1]:
        p = p[:-1]
    return [c / p[-1] for c in p]


def _divided(p: list[Fraction], q: list[Fraction]) -> tuple[list[Fraction], list[Fraction]]:
    """Quotient and remainder, lowest powers first; q is monic."""
    rest, quotient = list(p), [Fraction(0)] * max(1, len(p) - len(q) + 1)
    for shift in range(len(p) - len(q), -1, -1):
        quotient[shift] = rest[shift + len(q) - 1]
        for k, c in enumerate(q):
            rest[shift + k] -= quotient[shift] * c
    return quotient, rest


def _quotient(p: list[Fraction], q: list[Fraction]) -> list[Fraction]:
    return _trimmed(_divided(p, q)[0])


def _gcd(p: list[Fraction], q: list[Fraction]) -> list[Fraction]:
    p, q = _trimmed(p), _trimmed(q)
    while q:
        p, q = q, _trimmed(_divided(p, q)[1])
    return p
