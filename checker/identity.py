"""Identities: f(x) = sum of multipliers times generators + r(t), and what r costs on a box."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from .polynomial import INF, Polynomial, Substitution, Word, dyadic, powers
from .reading import (
    Constraint,
    Malformed,
    array,
    finite,
    indices,
    item,
    items,
    optional,
    reals,
    word,
)

ONE = Polynomial({(): 1})


@dataclass
class Row:
    """A polynomial that is >= 0, or zero, on the feasible set."""

    polynomial: Polynomial
    equality: bool


class Scaling:
    """x = centre + scale * t with low <= t <= high, as a file states it for n variables."""

    def __init__(self, found: Any, n: int, place: str) -> None:
        self.centre, self.scale = (reals(item(found, k, place), 1, place) for k in CENTRE_SCALE)
        self.boxed: list[bool] = array(item(found, "boxed", place), "b", 1, f"{place}.boxed")
        side: list[int] = array(item(found, "side", place), "i", 1, f"{place}.side")
        given = optional(item(found, "ends", place), items, f"{place}.ends")
        arrays = [self.centre, self.scale, self.boxed, side]
        if given is not None:
            if len(given) != 2:
                raise Malformed(f"{place}.ends: not two arrays")
            arrays += [array(end, "f", 1, f"{place}.ends") for end in given]
        if any(len(values) != n for values in arrays):
            raise Malformed(f"{place}: not {n} numbers each")
        self.low: list[Any] = [0.0 if s > 0 else -INF for s in side]
        self.high: list[Any] = [0.0 if s < 0 else INF for s in side]
        for v in range(n):
            if self.boxed[v]:
                reach = 0.0 if self.scale[v] == 0 else 1.0
                self.low[v], self.high[v] = -reach, reach
        if given is not None:
            self.low, self.high = arrays[4], arrays[5]
        for v in range(n):
            far = 1.0 if self.boxed[v] else INF
            low, high = self.low[v], self.high[v]
            fits = -far <= low <= high <= far and low != INF and high != -INF
            if not fits or self.scale[v] < 0 or (self.scale[v] == 0 and not self.boxed[v]):
                raise Malformed(f"{place}: variable {v + 1} has a malformed range")
        self.substitution = Substitution(self.centre, self.scale)

    def holds(self, ends: list[tuple[Any, Any]]) -> bool:
        """Whether the box of x, ends as Fractions, lies in centre + scale * [low, high]."""
        for v, (low, high) in enumerate(ends):
            centre, scale = Fraction(self.centre[v]), Fraction(self.scale[v])
            if self.low[v] != -INF and not centre + scale * Fraction(self.low[v]) <= low:
                return False
            if self.high[v] != INF and not centre + scale * Fraction(self.high[v]) >= high:
                return False
        return True


CENTRE_SCALE = ("centre", "scale")


class Generators:
    """What multipliers multiply, in t: 1, the rows, three families of bounds, products."""

    def __init__(self, rows: list[Row], scaling: Scaling, products: list[list[int]]) -> None:
        self.rows, self.scaling, self.products = rows, scaling, products
        self.single = 1 + len(rows) + 3 * len(scaling.centre)
        self._made: dict[int, Polynomial] = {0: ONE}

    @property
    def count(self) -> int:
        """How many there are."""
        return self.single + len(self.products)

    def __getitem__(self, k: int) -> Polynomial:
        if k not in self._made:
            self._made[k] = self._make(k)
        return self._made[k]

    def _make(self, k: int) -> Polynomial:
        if k <= len(self.rows):
            return self.scaling.substitution.into(self.rows[k - 1].polynomial)
        if k >= self.single:
            first, second = self.products[k - self.single]
            return self[first].times(self[second])
        family, v = divmod(k - 1 - len(self.rows), len(self.scaling.centre))
        low, high = self.scaling.low[v], self.scaling.high[v]
        needed = ((low, high), (low,), (high,))[family]
        if not low < high or INF in needed or -INF in needed:
            return Polynomial()
        above = Polynomial.affine(v + 1, 1, -low) if family != 2 else ONE  # t - low
        below = Polynomial.affine(v + 1, -1, high) if family != 1 else ONE  # high - t
        return above.times(below)

    def equality(self, k: int) -> bool:
        """Whether a generator is zero on the feasible set and may have a free multiplier."""
        return 1 <= k <= len(self.rows) and self.rows[k - 1].equality

    def sign_of(self, k: int) -> Word | None:
        """The word that a generator is up to its sign: () for 1, (v,) for t_v or -t_v."""
        if k == 0:
            return ()
        family, v = divmod(k - 1 - len(self.rows), len(self.scaling.centre))
        if not len(self.rows) < k < self.single or family == 0:
            return None
        end, other = self.scaling.low[v], self.scaling.high[v]
        if family == 2:
            end, other = -other, -end
        return (v + 1,) if end == 0 and other == INF else None


def products_of(found: Any, single: int, place: str) -> list[list[int]]:
    """Pairs of generators, each of them before the pair; ``single`` come before all pairs."""
    pairs: list[list[int]] = array(found, "i", 2, place)
    for k, pair in enumerate(pairs):
        if len(pair) != 2 or not all(0 <= g < single + k for g in pair):
            raise Malformed(f"{place}[{k}]: not two generators before it")
    return pairs


def cost(words: dict[Word, Fraction]) -> Fraction:
    """An upper bound of -(sum of c w) for words in variables of [-1, 1], none of them 1."""
    total = Fraction(0)
    for letters, value in words.items():
        odd = any(n % 2 for _, n in powers(letters))
        total += abs(value) if odd else max(-value, Fraction(0))
    return total


# ---- identities of squares -----------------------------------------------------------------


class Group:
    """Multipliers of one shape: free ones of equalities, or squares L L' + floor * identity."""

    def __init__(self, found: Any, n: int, place: str) -> None:
        self.generator: list[int] = array(item(found, "generator", place), "i", 1, place)
        basis = array(item(found, "basis", place), "i", 3, f"{place}.basis")
        self.basis = [[word(letters, n, f"{place}.basis") for letters in b] for b in basis]
        values = item(found, "values", place)
        self.free = len(items(item(values, "shape", place), place)) == 2
        self.values: list[Any] = reals(values, 2 if self.free else 3, f"{place}.values")
        self.floor = finite(item(found, "floor", place), f"{place}.floor")
        self.place: list[list[int]] | None = optional(
            item(found, "place", place), lambda f, p: array(f, "i", 2, p), f"{place}.place"
        )
        tables: list[list[Any]] = [self.basis, self.values]
        tables += [] if self.place is None else [self.place]
        counts = {len(table) for table in tables} | {len(self.generator)}
        sizes = {len(block) for table in tables for block in table}
        if len(counts) != 1 or len(sizes) != 1 or self.floor < 0:
            raise Malformed(f"{place}: its arrays do not belong together")
        if self.free and self.place is not None:
            raise Malformed(f"{place}: a free multiplier of a matrix")

    def gram(self, k: int) -> Polynomial:
        """L L' of block k without the floor: words (i, j) with i >= j, not of monomials."""
        flat, exp = dyadic([v for row in self.values[k] for v in row])
        width = len(flat) // len(self.values[k])
        rows = [flat[i * width : (i + 1) * width] for i in range(len(self.values[k]))]
        pairs = ((i, j) for i in range(len(rows)) for j in range(i + 1))
        dot = {(i, j): sum(map(int.__mul__, rows[i], rows[j])) for i, j in pairs}
        floor, shift = dyadic([self.floor])
        found = Polynomial(dot, 2 * exp)
        found.add(Polynomial({(i, i): floor[0] for i in range(len(rows))}, shift))
        return found


@dataclass
class Proved:
    """What an argument proves: a bound (-INF for none), the floor that is left, why not."""

    bound: Any
    floor: Any = 0
    reason: str = ""


class Identity:
    """Multipliers of an objective."""

    def __init__(self, found: Any, n: int, place: str) -> None:
        self.scaling = Scaling(item(found, "scaling", place), n, f"{place}.scaling")
        given = items(item(found, "multipliers", place), f"{place}.multipliers")
        self.groups = [Group(g, n, f"{place}.multipliers[{k}]") for k, g in enumerate(given)]
        self.products = item(found, "products", place)
        self.priced: list[tuple[Word, float]] = []
        self.place = place
        if (priced := item(found, "priced", place)) is not None:
            here = f"{place}.priced"
            words = array(item(priced, "words", here), "i", 2, here)
            values = reals(item(priced, "values", here), 1, here)
            if len(words) != len(values):
                raise Malformed(f"{here}: not one word a value")
            pairs = zip(words, values, strict=True)
            self.priced = [(word(letters, n, here), value) for letters, value in pairs]

    def prove(
        self, rows: list[Row], constraints: list[Constraint], objective: Polynomial
    ) -> Proved:
        """The bound of the objective on the box of the scaling.

        ``rows`` are what generators 1, 2, ... are; ``constraints`` hold the matrices.
        """
        n = len(self.scaling.centre)
        pairs = products_of(self.products, 1 + len(rows) + 3 * n, f"{self.place}.products")
        made = Generators(rows, self.scaling, pairs)
        rest = Polynomial()
        rest.add(self.scaling.substitution.into(objective))
        for letters, value in self.priced:
            rest.add(Polynomial.of([letters], [value]), -1)
        for group in self.groups:
            for k in range(len(group.generator)):
                rest.add(self._times(group, k, made, constraints), -1)
        boxed = self.scaling.boxed
        covered, left = {}, {}
        for letters, coefficient in rest.open().items():
            inside = all(boxed[v - 1] for v in letters)
            (covered if inside else left)[letters] = coefficient
        floor, reason = self._absorb(left, made)
        if reason:
            return Proved(-INF, 0, reason)
        least = self._least()
        if least == -INF:
            return Proved(-INF, 0, "a priced monomial has no least value")
        return Proved(rest.coefficient() + least - cost(covered), floor)

    def _times(
        self, group: Group, k: int, made: Generators, constraints: list[Constraint]
    ) -> Polynomial:
        """Multiplier k of a group times its generator, or its matrix."""
        number, basis = group.generator[k], group.basis[k]
        if not 0 <= number < made.count:
            raise Malformed(f"{self.place}: generator {number} of {made.count}")
        if group.free:
            if not made.equality(number):
                raise Malformed(f"{self.place}: a free multiplier of an inequality")
            multiplier = Polynomial()
            for letters, value in zip(basis, group.values[k], strict=True):
                multiplier.add(Polynomial.of([letters], [value]))
            return multiplier.times(made[number])
        gram = group.gram(k)
        factors: dict[int, Polynomial] = {}  # of an entry of the matrix, or of the generator (-1)
        for (i, j), value in gram.terms.items():
            entry = -1
            if group.place is not None:
                entry = self._entry(number, group.place[k][i], group.place[k][j], constraints)
                if entry < 0:
                    continue
            terms = factors.setdefault(entry, Polynomial({}, gram.exp)).terms
            letters = tuple(sorted(basis[i] + basis[j]))
            terms[letters] = terms.get(letters, 0) + value * (1 if i == j else 2)
        found = Polynomial()
        for entry, multiplier in factors.items():
            if entry < 0:
                found.add(multiplier.times(made[number]))
            else:
                given = constraints[number - 1].entries[entry]
                found.add(multiplier.times(self.scaling.substitution.into(given)))
        return found

    def _entry(self, number: int, i: int, j: int, constraints: list[Constraint]) -> int:
        """Which entry of a matrix stands in row i and column j, -1 for a zero."""
        if not 1 <= number <= len(constraints) or not (
            0 <= i < constraints[number - 1].side and 0 <= j < constraints[number - 1].side
        ):
            raise Malformed(f"{self.place}: no row {i}, {j} of a matrix of generator {number}")
        return constraints[number - 1].place(i, j)

    def _least(self) -> Any:
        """The sum of the least values of the priced monomials over the box of t."""
        total = Fraction(0)
        for letters, value in self.priced:
            low, high = self._range(letters)
            least = low if value > 0 else high
            if value and least in (INF, -INF):
                return -INF
            total += Fraction(value) * Fraction(least) if value else 0
        return total

    def _range(self, letters: Word) -> tuple[Any, Any]:
        """The range of a monomial over the box of t, exactly."""
        found: tuple[Any, Any] = Fraction(1), Fraction(1)
        for v, n in powers(letters):
            ends = [self.scaling.low[v], self.scaling.high[v]]
            first, second = (_power(end, n) for end in ends)
            low, high = min(first, second), max(first, second)
            if n % 2 == 0 and ends[0] <= 0 <= ends[1]:
                low = Fraction(0)
            four = [_product(a, b) for a in found for b in (low, high)]
            found = min(four), max(four)
        return found

    def _absorb(self, left: dict[Word, Fraction], made: Generators) -> tuple[Any, str]:
        """Move monomials without a range into the floors; what moment blocks keep, or a reason."""
        blocks = []  # those that may take something: group, block, what its generator is
        kept = []
        for group in self.groups:
            if group.free or not group.floor:
                continue
            signs = [made.sign_of(number) for number in group.generator]
            if group.place is not None or None in signs:
                if 0 in group.generator:
                    kept.append(Fraction(group.floor))
                continue
            blocks += [(group, k, sign) for k, sign in enumerate(signs) if sign is not None]
        sums: list[dict[int, Fraction]] = [{} for _ in blocks]
        for place, (group, k, sign) in enumerate(blocks):
            if not left:
                break
            basis = group.basis[k]
            for i in range(len(basis)):
                for j in range(i + 1):
                    letters = tuple(sorted(basis[i] + basis[j] + sign))
                    if letters not in left:
                        continue
                    share = abs(left.pop(letters)) * (1 if i == j else Fraction(1, 2))
                    for row in {i, j}:
                        sums[place][row] = sums[place].get(row, Fraction(0)) + share
        if left:
            return 0, f"the remainder holds a monomial without a range: {min(left)}"
        for (group, _, sign), rows in zip(blocks, sums, strict=True):
            room = Fraction(group.floor) - max(rows.values(), default=Fraction(0))
            if room < 0:
                return 0, "the remainder is larger than the floor of a block"
            if not sign:
                kept.append(room)
        return min(kept, default=Fraction(0)), ""


def _power(end: Any, n: int) -> Any:
    if end in (INF, -INF):
        return INF if end > 0 or n % 2 == 0 else -INF
    return Fraction(end) ** n


def _product(a: Any, b: Any) -> Any:
    if not a or not b:
        return Fraction(0)
    if a in (INF, -INF) or b in (INF, -INF):
        return INF if (a > 0) == (b > 0) else -INF
    return a * b


# ---- linear duals --------------------------------------------------------------------------


class LinearDual:
    """Constant multipliers, and monomials for equalities, of K objectives at a time."""

    def __init__(self, found: Any, n: int, place: str) -> None:
        self.scaling = Scaling(item(found, "scaling", place), n, f"{place}.scaling")
        self.products = item(found, "products", place)
        self.generator: list[int] = array(item(found, "generator", place), "i", 1, place)
        words = array(item(found, "word", place), "i", 2, f"{place}.word")
        self.words = [word(letters, n, f"{place}.word") for letters in words]
        self.value: list[float] = reals(item(found, "value", place), 1, f"{place}.value")
        self.owner = indices(item(found, "owner", place), 2**31, f"{place}.owner")
        self.place = place
        if len({len(a) for a in (self.generator, self.words, self.value, self.owner)}) > 1:
            raise Malformed(f"{place}: its arrays do not belong together")

    def prove(self, rows: list[Row], objectives: list[Polynomial]) -> list[Any]:
        """The bound of each objective on the box of the scaling, -INF for none."""
        n = len(self.scaling.centre)
        pairs = products_of(self.products, 1 + len(rows) + 3 * n, f"{self.place}.products")
        made = Generators(rows, self.scaling, pairs)
        rests = []
        for objective in objectives:
            rests.append(Polynomial())
            rests[-1].add(self.scaling.substitution.into(objective))
        given = zip(self.generator, self.words, self.value, self.owner, strict=True)
        for number, letters, value, owner in given:
            if not 0 <= number < made.count or owner >= len(rests):
                raise Malformed(f"{self.place}: generator {number} or owner {owner}")
            free = made.equality(number)
            if letters and not free:
                raise Malformed(f"{self.place}: a monomial multiplies an inequality")
            if value > 0 or free:
                part = Polynomial.of([letters], [value]).times(made[number])
                rests[owner].add(part, -1)
        return [self._bound(rest) for rest in rests]

    def _bound(self, rest: Polynomial) -> Any:
        words = rest.open()
        if not all(self.scaling.boxed[v - 1] for letters in words for v in letters):
            return -INF
        return rest.coefficient() - cost(words)
