"""The box of the parameters from cones of denominators, for one output with exact inputs.

Its rows are sum_i a_i (y(k - i) - eta(k - i)) = sum_j b_j phi_j(k) with a_0 = 1. Multipliers of
these that are orthogonal to the known columns phi leave the denominator alone. With one multiplier
for each vector of a cone they say, pair by pair, that no noise within its bounds explains a member.
Or, where they are orthogonal to all columns but one, how large the gain of that one may be.

Everything is exact: readings, bounds and multipliers are whole numbers times powers of two. Only
what takes a multiplier to one that is orthogonal is bounded, upwards.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import product
from math import gcd
from typing import Any

from ..certificates.elimination import eliminated, solution
from ..files.reading import Malformed, alike, below, each, fields
from ..result import NotProved
from .box import Ends, dot, hull, move, walk
from .linear_rows import Regression
from .structure import Term

_FINE = 128  # bits of what corrects multipliers

Cone = list[list[int]]  # one vector a row


# Multipliers of the vectors of a cone, powers of two by which these are divided, minors.
LEAF = {"family": "i*", "powers": "i*", "minors": "e*"}


class Rows:
    """The rows of one output, in whole numbers times 2**-bits.

    At rest as many zeros stand before each record as the output has lags; they have the number
    None, and rows begin with the first sample.
    """

    def __init__(self, about: Any, output: int, rest: bool = False, where: str = "box") -> None:
        record, structure, self.where = about.record, about.structure, where
        below([output - 1], len(record.y), f"{where}.output")
        terms, name = structure.equation(f"y{output}"), f"y{output}"
        noisy = [*record.bounds["input"], record.bounds["equation"][output - 1]]
        if any(v for column in noisy for v in column) or any(None in u for u in record.u):
            raise NotProved(f"{where}: denominators of an output with other errors")
        own = [term for term in terms if term.signal == name]
        others = [term for term in terms if term.signal != name]
        lags = [term.lag for term in own]
        if len(set(lags)) < len(lags) or any(t.signal and t.signal[0] != "u" for t in others):
            raise NotProved(f"{where}: denominators of an output with other signals")
        self.order, last = max(lags), max(term.lag for term in terms)
        if rest and not structure.zero:
            raise NotProved(f"{where}.rest: the structure does not begin at rest")
        self.numbers: list[int | None] = []
        for k in range(record.samples):
            begins = rest and record.first(k) == k
            self.numbers += [*([None] * self.order if begins else []), k]
        readings, bounds = record.y[output - 1], record.bounds["output"][output - 1]
        y = [Fraction(0) if k is None else readings[k] for k in self.numbers]
        noise = [Fraction(0) if k is None else bounds[k] for k in self.numbers]
        self.count = len(self.numbers)
        self.asked = [
            k is not None
            and (rest or k - record.first(k) >= last)
            and all(y[place - lag] is not None for lag in lags)
            for place, k in enumerate(self.numbers)
        ]
        self.gains: dict[str, int] = {}  # the columns of single parameters
        columns: list[list[Fraction]] = []
        for term in others:
            column = [self._known(record, term, place) for place in range(self.count)]
            alone = len(term.parameters) == 1 and term.sign == -1
            if column in columns:
                place = columns.index(column)
                self.gains = {key: at for key, at in self.gains.items() if at != place}
            elif any(column):
                columns.append(column)
                self.gains |= {term.parameters[0]: len(columns) - 1} if alone else {}
        single = {t.lag: t.parameters[0] for t in own if len(t.parameters) == 1 and t.sign == 1}
        self.own = [single.get(lag) for lag in range(1, self.order + 1)]
        tables = [[v or Fraction(0) for v in y], noise, *columns]
        self.bits = max(v.denominator.bit_length() for table in tables for v in table)
        self.y, self.noise, *self.columns = [[_whole(v, self.bits) for v in t] for t in tables]

    def _known(self, record: Any, term: Term, place: int) -> Fraction:
        """Find the number that a term multiplies in the row of a sample; zero before a record."""
        k = self.numbers[place]
        if k is None or not self.asked[place]:
            return Fraction(0)
        if not term.signal:
            return Fraction(1)
        inside = k - term.lag >= record.first(k)
        return record.u[int(term.signal[1:]) - 1][k - term.lag] if inside else Fraction(0)


def _whole(value: Fraction, bits: int) -> int:
    """A number as a whole multiple of 2**-bits."""
    found = value * (1 << bits)
    if found.denominator > 1:
        raise Malformed("record: a number that is no double")
    return found.numerator


def _check_powers(powers: list[int], place: str) -> None:
    """Refuse powers of two that no double has."""
    if any(abs(power) > 1100 for power in powers):
        raise Malformed(f"{place}: a power of two that no double has")


class Multipliers:
    """Multipliers of the rows of an output, and how they are made orthogonal to its columns."""

    def __init__(self, rows: Rows, found: list[Any], free: list[int]) -> None:
        self.rows = rows
        self.inside = [place for place, k in enumerate(rows.numbers) if k is not None]
        places = (f"{rows.where}.multipliers[{k}]" for k in range(len(found)))
        self.table = [self._read(one, at) for one, at in zip(found, places, strict=True)]
        place = f"{rows.where}.free"
        below(free, len(self.inside), place)
        self.free = [self.inside[k] for k in free]
        alike(place, self.free, rows.columns)
        if len(set(self.free)) < len(self.free) or not all(rows.asked[k] for k in self.free):
            raise NotProved(f"{place}: samples that have no row")
        given = [[Fraction(c[k], 1 << rows.bits) for k in self.free] for c in rows.columns]
        up = [[abs(v) * (1 << _FINE) for v in line] for line in _inverse(given, place)]
        self.inverse = [[-(-v.numerator // v.denominator) for v in line] for line in up]

    def _read(self, found: Any, place: str) -> tuple[int, list[int]]:
        """A power of two, and whole numbers that it multiplies, one for each sample."""
        got = fields(found, place, 0, power="i", values="i*")
        alike(place, got.values, self.inside)
        _check_powers([got.power], f"{place}.power")
        given = dict(zip(self.inside, got.values, strict=True))
        values = [given.get(place, 0) for place in range(self.rows.count)]
        if any(v and not row for v, row in zip(values, self.rows.asked, strict=True)):
            raise NotProved(f"{place}: a multiplier of a sample without a row")
        return got.power, values

    def family(self, leaf: Any, cone: Cone) -> tuple[list[list[int]], int]:
        """Read multipliers of a leaf as whole numbers times one power of two."""
        below(leaf.family, len(self.table), f"{leaf.where}.family")
        alike(f"{leaf.where}.family", leaf.family, cone)
        chosen = [self.table[m] for m in leaf.family]
        least = min(power for power, _ in chosen)
        return [[v << power - least for v in values] for power, values in chosen], least

    def products(self, multiplier: list[int]) -> list[int]:
        """Multiply with the columns."""
        return [dot(multiplier, column) for column in self.rows.columns]

    def losses(self, rest: list[int]) -> list[int]:
        """Bound what correcting products may change for each abs(a_i), rounded up."""
        rows, found = self.rows, []
        far = [sum(a * abs(r) for a, r in zip(line, rest, strict=True)) for line in self.inverse]
        for i in range(rows.order + 1):
            pairs = zip(far, self.free, strict=True)
            found.append(sum(e * (abs(rows.y[k - i]) + rows.noise[k - i]) for e, k in pairs))
        return [-(-value >> _FINE + rows.bits) for value in found]


def _inverse(matrix: list[list[Fraction]], place: str) -> list[list[Fraction]]:
    """The inverse of a matrix."""
    n = len(matrix)
    rows = [
        {j: v for j, v in enumerate(line) if v} | {~i: Fraction(-1)}
        for i, line in enumerate(matrix)
    ]
    done = eliminated(rows)
    if done is None:
        raise NotProved(f"{place}: samples that determine no correction")
    columns = [solution(done, {~k: Fraction(k == i) for k in range(n)}) for i in range(n)]
    return [[column[j] for column in columns] for j in range(n)]


def first_cones(order: int, stable: bool) -> list[Cone]:
    """Write cones of (1 - q)^j (1 + q)^(n - j), with signs where needed."""
    basis = []
    for j in range(order + 1):
        vector = [1]
        for sign in [-1] * j + [1] * (order - j):
            ahead = zip([*vector, 0], [0, *vector], strict=True)
            vector = [a + sign * b for a, b in ahead]
        basis.append(vector)
    signs = [(1,) * (order + 1)]
    if not stable:
        signs = [(1, *more) for more in product((1, -1), repeat=order)]
    return [[[s * v for v in line] for s, line in zip(some, basis, strict=True)] for some in signs]


def minor(cone: Cone, r: int, j: int, k: int) -> int:
    """Polarise H_r at two vectors of a cone, 2^2n times the Hurwitz products."""
    basis = list(zip(*first_cones(len(cone) - 1, True)[0], strict=True))
    one, two = ([dot(cone[m], column) for column in basis] for m in (j, k))
    inner = one[r] * two[r + 1] + two[r] * one[r + 1]
    return inner - one[r - 1] * two[r + 2] - two[r - 1] * one[r + 2]


Gain = tuple[int, int, Fraction]  # number of its column, sign, the upper end


def holds(table: Multipliers, leaf: Any, cone: Cone, stable: bool, gain: Gain | None) -> bool:
    """Check whether every pair of vectors asks for more than noise, or a gain."""
    rows, size = table.rows, len(cone)
    alike(f"{leaf.where}.powers", leaf.powers, cone)
    _check_powers(leaf.powers, f"{leaf.where}.powers")
    if leaf.minors and not (stable and len(leaf.minors) == rows.order - 2):
        raise NotProved(f"{leaf.where}.minors: of another order, or not of stable denominators")
    shift = max(leaf.powers)
    vectors = [
        [v << shift - power for v in line] for line, power in zip(cone, leaf.powers, strict=True)
    ]
    family, power = ([[0] * rows.count] * size, 0) if not leaf.family else table.family(leaf, cone)
    sides = Sides(table, family, vectors, gain)
    scale = Fraction(2) ** (power - rows.bits)
    return min(leaf.minors, default=0) >= 0 and all(
        sides.left(j, k) * scale > _minors(leaf, vectors, j, k) / Fraction(2) ** shift
        for j in range(size)
        for k in range(j, size)
    )


class Sides:
    """Requirements of rows at pairs of vectors, beyond what noise can give."""

    def __init__(self, table: Multipliers, family: Cone, vectors: Cone, gain: Gain | None) -> None:
        self.rows, self.vectors, self.gain = table.rows, vectors, gain
        self.filtered: list[list[list[int]]] = []
        self.losses: list[list[int]] = []
        self.shares = [0] * len(vectors)
        for k, multiplier in enumerate(family):
            rest = table.products(multiplier)
            if gain is not None:
                self.shares[k] = max(-gain[1] * rest[gain[0]], 0)
                rest[gain[0]] += gain[1] * self.shares[k]
            self.losses.append(table.losses(rest))
            ahead = [multiplier[i:] + [0] * i for i in range(table.rows.order + 1)]
            parts = list(zip(*ahead, strict=True))
            self.filtered.append([[dot(v, part) for part in parts] for v in vectors])

    def left(self, j: int, k: int) -> Fraction:
        """Compute what is left for a pair."""
        both = list(map(int.__add__, self.filtered[k][j], self.filtered[j][k]))
        found = Fraction(dot(both, self.rows.y) - dot(map(abs, both), self.rows.noise))
        for one, two in ((j, k), (k, j)):
            found -= dot(map(abs, self.vectors[one]), self.losses[two])
            if self.gain is not None:
                found += self.gain[2] * self.vectors[one][0] * self.shares[two]
        return found


def _minors(leaf: Any, vectors: Cone, j: int, k: int) -> Fraction:
    weighted = (weight * minor(vectors, r, j, k) for r, weight in enumerate(leaf.minors, 1))
    return sum(weighted, Fraction(0))


def upright(cone: Cone) -> Cone | None:
    """Turn a cone so that its vectors all begin with a positive number."""
    for turned in (cone, [[-v for v in line] for line in cone]):
        if all(line[0] > 0 for line in turned):
            return turned
    return None


def limit_of(found: Any, n: int, place: str) -> Any:
    """Read a limit of a gain on a cone."""
    got = fields(found, place, n, cell="i", parameter="i", sign="i", value="e", **LEAF)
    if got.sign not in (1, -1):
        raise Malformed(f"{place}.sign: {got.sign} is not 1 or -1")
    return got


class Tree:
    """Cones of one output, split, with what multipliers say of them."""

    def __init__(self, step: Any, regression: Regression, place: str = "box") -> None:
        kinds = {"output": "i", "stable": "b", "free": "i*", "multipliers": "l", "nodes": "l"}
        given = {"rest": False, **step}
        self.got = fields(given, place, 0, **kinds, limits=each(limit_of), rest="b")
        self.regression, self.stable = regression, self.got.stable
        self.rows = Rows(regression.about, self.got.output, self.got.rest, place)
        self.table = Multipliers(self.rows, self.got.multipliers, self.got.free)
        self.limits: dict[int, list[Any]] = {}
        for limit in self.got.limits:
            self.limits.setdefault(limit.cell, []).append(limit)

    def leaves(self, ends: Ends) -> list[Ends]:
        """List boxes of the leaves that are left."""
        if not self.stable and self.rows.order >= len(self.got.nodes).bit_length():
            raise Malformed(f"{self.got.where}.nodes: fewer than there are first cones")
        found = []

        def parts(place: int, node: Any, own: tuple[Cone, Ends]) -> list[tuple[Cone, Ends]]:
            cone, inside = own[0], self._limited(place, *own)
            if node.children:
                return [(part, inside) for part in _split(cone, node)]
            if not (node.powers and holds(self.table, node, cone, self.stable, None)):
                found.append(self._monic(cone, inside))
            return []

        firsts = [(cone, ends) for cone in first_cones(self.rows.order, self.stable)]
        place = f"{self.got.where}.nodes"
        walk(self.got.nodes, place, firsts, parts, edge="i*", weights="i*", **LEAF)
        return found

    def _monic(self, cone: Cone, ends: Ends) -> Ends:
        """A box with the least and the largest ratios of a cone."""
        turned, found = upright(cone), [list(side) for side in ends]
        for lag, name in enumerate(self.rows.own, 1):
            if turned is not None and name is not None:
                ratios = [Fraction(line[lag], line[0]) for line in turned]
                v = self.regression.places[name]
                found[0][v] = max(found[0][v], min(ratios))
                found[1][v] = min(found[1][v], max(ratios))
        return found

    def _limited(self, place: int, cone: Cone, ends: Ends) -> Ends:
        """A box with the ends of gains that hold on a cone."""
        found, turned = [list(side) for side in ends], upright(cone)
        for limit in self.limits.get(place, ()):
            below([limit.parameter], self.regression.count, f"{limit.where}.parameter")
            column = self.rows.gains.get(self.regression.about.names[limit.parameter])
            if column is None or turned is None:
                raise NotProved(f"{limit.where}: of no gain, or on no cone of monic denominators")
            if holds(self.table, limit, turned, self.stable, (column, limit.sign, limit.value)):
                move(found, limit.parameter, int(limit.sign > 0), -limit.value)
        return found


def by_denominators(step: Any, rows: Regression, ends: Ends, place: str = "box") -> Ends:
    """Enclose what is left of a tree of cones, with gains bounded on each."""
    tree = Tree(step, rows, place)
    if tree.stable:
        rows.about.stable.add(tree.got.output)
    return hull(tree.leaves(ends), rows.count)


def _split(cone: Cone, node: Any) -> tuple[Cone, Cone]:
    """The parts of a cone on both sides of a vector on an edge."""
    alike(f"{node.where}: an edge has two ends", node.edge, node.weights, "ab")
    i, j, one, two = *node.edge, *node.weights
    below([i, j], len(cone), f"{node.where}.edge")
    if i == j or min(one, two) <= 0:
        raise Malformed(f"{node.where}: an edge that parts nothing")
    made = [one * a + two * b for a, b in zip(cone[i], cone[j], strict=True)]
    divisor = gcd(*made) or 1
    first, second = list(cone), list(cone)
    first[i] = second[j] = [v // divisor for v in made]
    return first, second
