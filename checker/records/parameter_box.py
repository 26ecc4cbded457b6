"""The box of the parameters from a record: steps, each of which keeps every consistent theta.

Rows one by one bound parameters (``LeftInverse``, ``SignTree``) or products of them, which bound
the parameters in turn (``Products``); with the noise that rows share, the engine's certificates
bound them where rows one by one do not (``Directions``).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import chain
from math import comb
from typing import Any

from ..arithmetic import interval as iv
from ..arithmetic.polynomial import INF, Polynomial, Word
from ..certificates.certificate import Certificates
from ..files.reading import (
    Constraint,
    Malformed,
    Problem,
    alike,
    below,
    each,
    fields,
    item,
    kind_of,
    read,
    times,
)
from ..result import NotProved
from .box import ZERO, Ends, intervals, met, no_point, nothing, outside, rationals
from .denominators import by_denominators
from .linear_rows import Regression, by_inverse, by_tree
from .simulation import by_simulation

Factors = list[list[int]]  # denominators, by the letters of their coefficients from lag 1 on
Pairs = Sequence[tuple[list[Word], iv.Interval]]  # columns and what they lie in
LARGEST = Fraction(4)  # s above this needs no proof
SWEEPS = 3  # over the columns of products
# Boxes whose proofs a file may leave out: setid verify checks them, this program does not.
KINDS = {
    "ParameterBox": "from rows of a structure that is not a transfer function",
    "DirectionBox": "from bounds on the directions of the parameters",
    "LiftedBox": "from linear programs in products of parameters",
    "CellBox": "from cells of the noise-free outputs",
    "DenominatorBox": "from cones of denominators, on a box that is no step",
    "SimulatedBox": "from simulations of another structure, or from cells of the outputs",
}


def proved_box(about: Any) -> tuple[Ends, list[str]]:
    """Prove the box of an identification; list what is taken as given."""
    if about.box is None:
        return [list(side) for side in about.given], []
    place = f"{about.where}.box"
    stated = stated_ends(about.box, len(about.names), place)
    got = fields(about.box, place, 0, steps="l?", kind="t")
    steps, kind = got.steps, got.kind
    if steps is None or about.structure is None:
        if kind not in KINDS:
            raise Malformed(f"{place}.kind: {kind!r:.40} is not known")
        return stated, [f"the box of the parameters, a {kind} ({KINDS[kind]})"]
    ends = [list(side) for side in about.given]
    rows = Regression(about, [[(v,)] for v in range(1, len(about.names) + 1)])
    for k, step in enumerate(steps):
        at = f"{place}.steps[{k}]"
        ends = kind_of(step, STEPS, at)(step, rows, ends, at)
    for v in outside(ends, stated):
        raise NotProved(f"{place}: that of {about.names[v]} does not follow")
    return stated, []


def stated_ends(found: Any, count: int, place: str) -> Ends:
    """Read the fields ``lower`` and ``upper`` of a box."""
    got = fields(found, place, 0, lower="F*", upper="F*")
    alike(f"{place}.lower, upper", got.lower, got.upper, range(count))
    return [got.lower, got.upper]


def by_products(step: Any, rows: Regression, ends: Ends, place: str = "box") -> Ends:
    """Bound sums of products, and each factor by them."""
    p, kinds = rows.count, {"columns": each(each(word_of)), "steps": "l"}
    got = fields(step, place, p, **kinds)
    columns = got.columns
    every = [monomial for column in columns for monomial in column]
    if len(set(every)) < len(every) or not all(columns):
        raise Malformed(f"{place}.columns: a product that stands twice, or a column of none")
    box = intervals(ends)
    found = rationals([total(column, box) for column in columns])
    lifted = Regression(rows.about, columns)
    for k, inner in enumerate(got.steps):
        at = f"{place}.steps[{k}]"
        found = kind_of(inner, ONE_BY_ONE, at)(inner, lifted, found, at)
    if nothing(found):
        return no_point(p)
    pairs = list(zip(columns, intervals(found), strict=True))
    outputs = [letters_of(rows.about, i) for i in rows.about.structure.outputs]
    every_factor = [found for found in outputs if len(found) > 1]
    for factors in every_factor:
        settle_denominators(factors, pairs, box)
    for _ in range(SWEEPS):
        for column, pair in pairs:
            settle(column, pair, box, pairs, every_factor)
            if any(a > b for a, b in box):
                return no_point(p)
    return rationals(box)


def word_of(found: Any, p: int, place: str) -> Word:
    """Read a product of p parameters, which a file numbers from 0."""
    below(factors := read(found, "i*", place), p, place)
    if not factors:
        raise Malformed(f"{place}: a product of nothing")
    return tuple(sorted(v + 1 for v in factors))


def total(column: list[Word], box: list[iv.Interval]) -> iv.Interval:
    """Enclose a sum of products."""
    return iv.total(iv.monomial_range(monomial, box) for monomial in column)


def without(monomial: Word, place: int) -> Word:
    """Drop one of the factors of a product."""
    return monomial[:place] + monomial[place + 1 :]


def letters_of(about: Any, output: int) -> Factors:
    """List the denominators of an output, by the letters of their coefficients."""
    letter = {name: v for v, name in enumerate(about.names, 1)}
    return [[letter[name] for name in d] for d in about.structure.denominators(output)]


def product_of(factors: Factors) -> dict[int, list[Word]]:
    """Multiply 1 + a_1 q^-1 + ... to the products of parameters at each lag."""
    found: dict[int, list[Word]] = {0: [()]}
    for letters in factors:
        longer: dict[int, list[Word]] = {}
        for lag, words in found.items():
            for k, v in enumerate([0, *letters]):
                more = [tuple(sorted((*word, v) if v else word)) for word in words]
                longer.setdefault(lag + k, []).extend(more)
        found = longer
    return found


def settle_denominators(factors: Factors, pairs: Pairs, box: list[iv.Interval]) -> None:
    """Bound monic polynomials by their product: |a_i| <= C(n, i) M, M at most its length."""
    square = iv.ONE
    for lag, words in product_of(factors).items():
        if lag:
            low, high = total_by(words, pairs, box)
            far = max(-low, high)
            square = iv.plus(square, iv.power((-far, far), 2))
    size = iv.root_above(square[1], 2)
    for letters in factors:
        for i, v in enumerate(letters, 1):
            count = comb(len(letters), i)
            far = size if size == INF else count * size
            box[v - 1] = iv.met(box[v - 1], (-far, far))


def total_by(terms: list[Word], pairs: Pairs, box: list[iv.Interval]) -> iv.Interval:
    """Enclose a sum of products, each as often as it stands there, by columns that are part."""
    left, found = Counter(terms), iv.ZERO
    for column, known in pairs:
        if Counter(column) <= left:
            found = iv.plus(found, iv.met(total(column, box), known))
            left.subtract(column)
    return iv.plus(found, total(list(left.elements()), box))


def at_one(factors: Factors, box: list[iv.Interval]) -> iv.Interval:
    """Enclose the product of denominators at q = 1, factor by factor."""
    found = iv.ONE
    for letters in factors:
        found = iv.times(found, iv.plus(iv.ONE, total([(v,) for v in letters], box)))
    return found


def settle(
    column: list[Word],
    known: iv.Interval,
    box: list[iv.Interval],
    pairs: Pairs = (),
    every_factor: Sequence[Factors] = (),
) -> None:
    """Solve a sum of products in ``known`` for every factor, in place; first for shared ones."""
    for v in column[0]:
        if all(monomial.count(v) == 1 for monomial in column):
            others = [without(m, m.index(v)) for m in column]
            slope = total_by(others, pairs, box)
            for factors in every_factor:
                if sorted(others) == sorted(chain(*product_of(factors).values())):
                    slope = iv.met(slope, at_one(factors, box))
            if slope[0] <= slope[1]:
                box[v - 1] = iv.met(box[v - 1], iv.quotient(known, slope))
    for monomial in column:
        rest = total([other for other in column if other != monomial], box)
        own = iv.minus(known, rest)
        for place, v in enumerate(monomial):
            others = iv.monomial_range(without(monomial, place), box)
            box[v - 1] = iv.met(box[v - 1], iv.quotient(own, others))


def by_directions(step: Any, rows: Regression, ends: Ends, place: str = "box") -> Ends:
    """Prove |theta_i| <= c_i / least by the bounds of s on all sides.

    1 / s is the largest of |theta_i| / c_i, so that with phi = s theta / c every consistent theta
    lies on a side phi_i = 1 or -1 of a cube. Each row is multiplied by s.
    """
    got, p = fields(step, place, 0, scale="e*", sides="l"), rows.count
    assumed, scale = stated_ends(step, p, place), got.scale
    alike(f"{place}.scale", scale, range(p))
    alike(f"{place}.sides", got.sides, range(2 * p))
    if any(not c > 0 for c in scale):
        raise Malformed(f"{place}.scale: not positive")
    if outside(ends, assumed):
        raise NotProved(f"{place}: bounds of directions are about a smaller box")
    least: Any = LARGEST
    for k, side in enumerate(got.sides):
        at = f"{place}.sides[{k}]"
        problem, size = cube_side(rows.about, side, scale, assumed, divmod(k, 2), at)
        certificates = Certificates(item(side, "certificate", at), problem, f"{at}.certificate")
        proved, why = certificates.prove()
        if proved < certificates.claim:
            raise NotProved(f"{at}: {'; '.join(dict.fromkeys(why))}")
        least = min(least, times(certificates.claim, size))
    if not least > 0:
        raise NotProved(f"{place}: directions without a bound")
    return met(ends, [-c / least for c in scale], [c / least for c in scale])


def cube_side(
    about: Any,
    side: Any,
    scale: list[Fraction],
    assumed: Ends,
    which: tuple[int, int],
    place: str = "box",
) -> tuple[Problem, Fraction]:
    """Minimise s where phi_i is 1 (which = i, 0) or -1, in the units of the file; that of s.

    The unknowns are phi, those of the problem that are no parameters, and s.
    """
    got = fields(side, place, 0, rows="i*", units="u*", factors="e*")
    given, p, n = about.problem, len(scale), about.problem.dimension
    units, factors, rows = got.units, got.factors, []
    alike(f"{place}.units", units, range(n + 1))
    below(got.rows, len(given.constraints), f"{place}.rows")
    for c in (given.constraints[place] for place in got.rows):
        terms = {}
        for word, value in about.unscaled(c).items():
            heads = [v for v in word if v <= p]
            if len(heads) > 1 or c.side:
                raise Malformed(f"{place}.rows: one is not linear in the parameters")
            terms[word if heads else (*word, n + 1)] = value * (scale[heads[0] - 1] if heads else 1)
        rows.append((c.kind, terms))
    for v in range(p):
        for end, sign in ((assumed[0][v], 1), (assumed[1][v], -1)):
            if end not in (INF, -INF):  # sign * (theta_v - end) >= 0, times s
                rows.append(("NONNEGATIVE", {(v + 1,): sign * scale[v], (n + 1,): -sign * end}))
    alike(f"{place}.factors", factors, rows)
    if any(not v > 0 for v in factors):
        raise Malformed(f"{place}.factors: not positive")
    constraints = [
        Constraint(kind, in_units(terms, units, factor))
        for (kind, terms), factor in zip(rows, factors, strict=True)
    ]
    used = {v for _, terms in rows for word in terms for v in word}
    ranges = [(Fraction(-1), Fraction(1))] * p
    ranges[which[0]] = (Fraction(1 - 2 * which[1]),) * 2
    for v in range(p, n):
        ranges.append(about.bounds(v) if v + 1 in used else (ZERO, ZERO))
    ranges.append((ZERO, LARGEST) if n + 1 in used else (ZERO, ZERO))
    lower, upper = (
        [times(pair[k], 1 / size) for pair, size in zip(ranges, units, strict=True)] for k in (0, 1)
    )
    names = [f"x{v + 1}" for v in range(n + 1)]
    return Problem(n + 1, Polynomial({(n + 1,): 1}), constraints, lower, upper, names), units[-1]


def in_units(terms: dict[Word, Fraction], units: list[Fraction], factor: Fraction) -> Polynomial:
    """Divide the unknowns of a polynomial by their units, times a factor."""
    values = []
    for word, value in terms.items():
        value *= factor
        for v in word:
            value *= units[v - 1]
        values.append(value)
    return Polynomial.of(list(terms), values)


Step = Callable[[Any, Regression, Ends, str], Ends]
ONE_BY_ONE: dict[str, Step] = {"LeftInverse": by_inverse, "SignTree": by_tree}
STEPS = ONE_BY_ONE | {
    "Products": by_products,
    "Denominators": by_denominators,
    "Directions": by_directions,
    "Simulation": by_simulation,
}
