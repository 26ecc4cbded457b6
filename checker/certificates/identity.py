"""Identities: f(x) = sum of multipliers times generators + r(t), and what r costs on a box."""

from __future__ import annotations

from fractions import Fraction
from typing import Any, NamedTuple

from ..arithmetic import interval as iv
from ..arithmetic.polynomial import INF, ONE, Polynomial, Substitution, Word, dyadic, powers, total
from ..files.reading import Constraint, Malformed, alike, array, below, each, fields, perhaps, times

Range = tuple[Any, Any]  # rational ends, INF or -INF


class Row(NamedTuple):
    """A polynomial that is >= 0, or zero, on the feasible set."""

    polynomial: Polynomial
    equality: bool


class Proved(NamedTuple):
    """A lower bound (-INF for none), what is left of the floors, and why there is no bound."""

    bound: Any
    floor: Any = 0
    reason: str = ""


class Scaling:
    """x = centre + scale * t with low <= t <= high."""

    def __init__(self, found: Any, n: int, place: str) -> None:
        kinds = {"centre": "f1", "scale": "f1", "boxed": "b1", "side": "i1", "ends": "F1*?"}
        got = fields(found, place, n, **kinds)
        self.centre, self.scale, self.boxed = got.centre, got.scale, got.boxed
        alike(place, got.centre, got.scale, got.boxed, got.side, *(got.ends or ()), range(n))
        self.low: list[Any] = [0 if s > 0 else -INF for s in got.side]
        self.high: list[Any] = [0 if s < 0 else INF for s in got.side]
        for v in range(n):
            if got.boxed[v]:
                self.high[v] = 0 if got.scale[v] == 0 else 1
                self.low[v] = -self.high[v]
        if got.ends is not None:
            alike(f"{place}.ends", got.ends, range(2))
            self.low, self.high = got.ends
        for v, (low, high, scale) in enumerate(zip(self.low, self.high, self.scale, strict=True)):
            far = 1 if self.boxed[v] else INF
            sensible = -far <= low <= high <= far and low < INF and high > -INF
            if not sensible or scale < 0 or (scale == 0 and not self.boxed[v]):
                raise Malformed(f"{place}: a range of t{v + 1} that makes no sense")
        self.substitution = Substitution(self.centre, self.scale)

    def holds(self, ends: list[Range]) -> bool:
        """Check whether the box of x lies in centre + scale * [low, high]."""
        centre, scale = map(Fraction, self.centre), map(Fraction, self.scale)
        sides = zip(ends, centre, scale, self.low, self.high, strict=True)
        return all(
            c + times(low, s) <= a and b <= c + times(high, s) for (a, b), c, s, low, high in sides
        )


class Generators:
    """Polynomials that multipliers multiply, in t: 1, rows, three families of bounds, products."""

    def __init__(self, rows: list[Row], argument: Any) -> None:
        self.rows, self.scaling, self.products = rows, argument.scaling, argument.products
        self.single = 1 + len(rows) + 3 * len(self.scaling.centre)
        self.count = self.single + len(self.products)
        self._made: dict[int, Polynomial] = {0: ONE}
        for k, pair in enumerate(self.products):
            alike(argument.where, pair, range(2))
            below(pair, self.single + k, f"{argument.where}.products")

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
        above = Polynomial.affine(v + 1, 1.0, -low) if family != 2 else ONE  # t - low
        under = Polynomial.affine(v + 1, -1.0, high) if family != 1 else ONE  # high - t
        return above.times(under)

    def equality(self, k: int) -> bool:
        """Check whether a generator is zero on the feasible set: its multiplier is free."""
        return 1 <= k <= len(self.rows) and self.rows[k - 1].equality

    def sign_of(self, k: int) -> Word | None:
        """Find a generator's word up to its sign: () for 1, (v,) for +-t_v."""
        if k == 0:
            return ()
        family, v = divmod(k - 1 - len(self.rows), len(self.scaling.centre))
        if not len(self.rows) < k < self.single or family == 0:
            return None
        end, other = self.scaling.low[v], self.scaling.high[v]
        end, other = (end, other) if family == 1 else (-other, -end)
        return (v + 1,) if end == 0 and other == INF else None


def cost(terms: dict[Word, Fraction]) -> Fraction:
    """Bound -(sum of c w) from above, words w in variables of [-1, 1]."""
    odd = {word: any(n % 2 for _, n in powers(word)) for word in terms}
    sizes = (abs(c) if odd[word] else max(-c, Fraction(0)) for word, c in terms.items())
    return sum(sizes, Fraction(0))


class Group:
    """Multipliers of one shape: free ones of equalities, or squares L L' + floor * identity."""

    def __init__(self, found: Any, n: int, place: str) -> None:
        kinds = {"generator": "i1", "basis": "w3", "floor": "f", "place": "i2?"}
        got = fields(found, place, n, values=_values, **kinds)
        self.generator, self.basis, self.floor = got.generator, got.basis, got.floor
        self.values, self.place, self.free = got.values, got.place, _rank(found["values"]) == 2
        tables = [got.basis, got.values] + ([] if got.place is None else [got.place])
        alike(place, got.generator, *tables)
        for blocks in zip(*tables, strict=True):
            alike(place, *blocks)
        if got.floor < 0 or not all(got.basis) or (self.free and got.place is not None):
            raise Malformed(f"{place}: floor {got.floor}, an empty block, or a free matrix")

    def gram(self, k: int) -> Polynomial:
        """Compute L L' + floor * identity of block k, by places (i, j)."""
        flat, exp = dyadic([v for row in self.values[k] for v in row])
        size = len(self.values[k])
        width = len(flat) // size
        rows = [flat[i * width : (i + 1) * width] for i in range(size)]
        found = Polynomial({}, 2 * exp)
        for i in range(size):
            for j in range(i + 1):
                found.terms[i, j] = sum(map(int.__mul__, rows[i], rows[j]))
        (floor,), exp = dyadic([self.floor])
        found.add(Polynomial({(i, i): floor for i in range(size)}, exp))
        return found


def _rank(found: Any) -> int:
    shape = found.get("shape") if isinstance(found, dict) else None
    return len(shape) if isinstance(shape, list) else 0


def _values(found: Any, n: int, place: str) -> list[Any]:
    return array(found, "f", 2 if _rank(found) == 2 else 3, place)


def _priced(found: Any, n: int, place: str) -> Polynomial:
    got = fields(found, place, n, words="w2", values="f1")
    alike(place, got.words, got.values)
    return total(Polynomial.of([w], [v]) for w, v in zip(got.words, got.values, strict=True))


class Identity:
    """Multipliers of one objective."""

    def __init__(self, found: Any, n: int, place: str) -> None:
        kinds = {"multipliers": each(Group), "priced": perhaps(_priced)}
        got = fields(found, place, n, scaling=Scaling, products="i2", **kinds)
        self.scaling, self.products, self.where = got.scaling, got.products, place
        self.groups: list[Group] = got.multipliers
        self.priced: Polynomial = got.priced or Polynomial()

    def prove(
        self, rows: list[Row], constraints: list[Constraint], objective: Polynomial
    ) -> Proved:
        """Prove the bound of the objective on the box of the scaling.

        ``rows`` are what generators 1, 2, ... are; ``constraints`` hold the matrices.
        """
        made = Generators(rows, self)
        rest = self.scaling.substitution.into(objective)
        rest.add(self.priced, -1)
        for group in self.groups:
            for k in range(len(group.generator)):
                rest.add(self._product(group, k, made, constraints), -1)
        terms = rest.open()
        open_ = {w: c for w, c in terms.items() if not all(self.scaling.boxed[v - 1] for v in w)}
        floor, reason = self._absorb(dict(open_), made)
        least = self._least()
        if reason or least == -INF:
            return Proved(-INF, 0, reason or "a priced monomial has no least value")
        paid = cost({word: c for word, c in terms.items() if word not in open_})
        return Proved(rest.coefficient() + least - paid, floor)

    def _product(
        self, group: Group, k: int, made: Generators, constraints: list[Constraint]
    ) -> Polynomial:
        """Multiplier k of a group times its generator, or its matrix."""
        number, basis = group.generator[k], group.basis[k]
        below([number], made.count, f"{self.where}: generator")
        if group.free:
            if not made.equality(number):
                raise Malformed(f"{self.where}: a free multiplier of an inequality")
            multiplier = Polynomial()
            for word, value in zip(basis, group.values[k], strict=True):
                multiplier.add(Polynomial.of([word], [value]))
            return multiplier.times(made[number])
        gram = group.gram(k)
        factors: dict[int, Polynomial] = {}  # of an entry of the matrix; of the generator: -1
        for (i, j), value in gram.terms.items():
            entry = -1
            if group.place is not None:
                rows = group.place[k]
                below([number - 1], len(constraints), f"{self.where}: matrix")
                below(rows, constraints[number - 1].side, f"{self.where}: row of a matrix")
                entry = constraints[number - 1].place(rows[i], rows[j])
                if entry < 0:
                    continue
            terms = factors.setdefault(entry, Polynomial({}, gram.exp)).terms
            word = tuple(sorted(basis[i] + basis[j]))
            terms[word] = terms.get(word, 0) + value * (1 if i == j else 2)
        found = Polynomial()
        for entry, multiplier in factors.items():
            into = self.scaling.substitution.into
            other = made[number] if entry < 0 else into(constraints[number - 1].entries[entry])
            found.add(multiplier.times(other))
        return found

    def _least(self) -> Any:
        """The least value of the priced monomials over the box of t, as intervals enclose it."""
        ends = zip(self.scaling.low, self.scaling.high, strict=True)
        box = [(iv.below(low), iv.above(high)) for low, high in ends]
        return iv.exact(iv.range_over(self.priced, box)[0])

    def _absorb(self, left: dict[Word, Fraction], made: Generators) -> tuple[Any, str]:
        """Move monomials without a range into the floors; what moment blocks keep, or a reason."""
        kept = []
        for group in self.groups:
            if group.free or not group.floor:
                continue
            signs = [made.sign_of(number) for number in group.generator]
            usable = group.place is None and None not in signs
            for basis, sign in zip(group.basis, signs, strict=True):
                spent = _taken(left, basis, sign) if usable and sign is not None else Fraction(0)
                if spent > group.floor:
                    return 0, "the remainder is larger than the floor of a block"
                if sign == ():
                    kept.append(Fraction(group.floor) - spent)
        reason = f"the remainder has a monomial without a range: {min(left)}" if left else ""
        return min(kept, default=Fraction(0)), reason


def _taken(left: dict[Word, Fraction], basis: list[Word], sign: Word) -> Fraction:
    """Take monomials into a Gram matrix; the largest row sum of what was added to it."""
    sums = [Fraction(0)] * len(basis)
    for i in range(len(basis) if left else 0):
        for j in range(i + 1):
            size = abs(left.pop(tuple(sorted(basis[i] + basis[j] + sign)), Fraction(0)))
            for row in {i, j}:
                sums[row] += size if i == j else size / 2
    return max(sums)


class LinearDual:
    """Constant multipliers, and monomials for equalities, of K objectives at a time."""

    def __init__(self, found: Any, n: int, place: str) -> None:
        kinds: dict[str, Any] = {"generator": "i1", "word": "w2", "value": "f1", "owner": "i1"}
        self.given = fields(found, place, n, scaling=Scaling, products="i2", **kinds)
        alike(place, self.given.generator, self.given.word, self.given.value, self.given.owner)
        self.scaling: Scaling = self.given.scaling

    def prove(self, rows: list[Row], objectives: list[Polynomial]) -> list[Any]:
        """Prove each objective's bound on the box of the scaling, -INF for none."""
        got = self.given
        made = Generators(rows, got)
        below(got.generator, made.count, f"{got.where}.generator")
        below(got.owner, len(objectives), f"{got.where}.owner")
        rests = [self.scaling.substitution.into(objective) for objective in objectives]
        for k, word, value, owner in zip(
            got.generator, got.word, got.value, got.owner, strict=True
        ):
            if word and not made.equality(k):
                raise Malformed(f"{got.where}: a monomial multiplies an inequality")
            if value > 0 or made.equality(k):
                rests[owner].add(Polynomial.of([word], [value]).times(made[k]), -1)
        return [self._bound(rest) for rest in rests]

    def _bound(self, rest: Polynomial) -> Any:
        terms = rest.open()
        covered = all(self.scaling.boxed[v - 1] for word in terms for v in word)
        return rest.coefficient() - cost(terms) if covered else -INF
