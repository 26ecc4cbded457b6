"""Certificates: replay the steps that shrink boxes, split them, and bound every part."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

from . import interval as iv
from .gram import ExactGram
from .identity import Identity, LinearDual, Row
from .interval import Interval
from .polynomial import INF, Polynomial, Word, dyadic
from .propagation import Box, Rows
from .propagation import Row as BoxRow
from .reading import (
    Malformed,
    Problem,
    array,
    finite,
    flag,
    indices,
    item,
    items,
    number,
    optional,
    reals,
    whole,
)

ARGUMENTS: dict[str, Any] = {"Identity": Identity, "LinearDual": LinearDual, "ExactGram": ExactGram}


def argument_of(found: Any, n: int, place: str) -> Any:
    """Multipliers, by the name of their kind."""
    name = item(found, "is", place)
    if name not in ARGUMENTS:
        raise Malformed(f"{place}.is: {name!r:.40} is not one of {', '.join(ARGUMENTS)}")
    return ARGUMENTS[name](found, n, place)


# ---- what a problem offers --------------------------------------------------------------------


class Replay:
    """One problem, a level of its objective (or None), and what steps ask of them."""

    def __init__(self, problem: Problem, level: Fraction | None, holds: Holds) -> None:
        self.problem, self.level, self.holds = problem, level, holds
        self.notes: list[str] = []
        self._rows: dict[bool, Rows] = {}
        self.constant = squares_constant(problem)

    def rows(self, cutoff: bool) -> Rows:
        """The rows of propagation."""
        if cutoff not in self._rows:
            self._rows[cutoff] = self._made(cutoff)
        return self._rows[cutoff]

    def _made(self, cutoff: bool) -> Rows:
        problem = self.problem
        found = []
        for c in problem.constraints:
            found.append(BoxRow(c.polynomial, (0, 0 if c.equality else INF)))
        if cutoff and self.level is not None:
            found.append(BoxRow(problem.objective, (-INF, iv.above(self.level))))
            if self.constant is not None:
                room = max(self.level - self.constant, Fraction(0))
                for weight, p in problem.squares:
                    if weight > 0:
                        reach = iv.root_above(iv.above(room / weight), 2)
                        found.append(BoxRow(p, (-reach, reach)))
        minors = set()
        for c in problem.constraints:
            first = len(found)
            diagonal = {c.place(i, i) for i in range(c.side)}
            for k, p in enumerate(c.entries):
                found.append(BoxRow(p, (0 if k in diagonal else -INF, INF)))
            for i in range(c.side):
                for j in range(i):
                    places = c.place(i, j), c.place(i, i), c.place(j, j)
                    if min(places) >= 0:
                        minors.add((first + places[0], first + places[1], first + places[2]))
        return Rows(found, sorted(minors))

    def system(self, level: Fraction | None) -> list[Row]:
        """What generators 1, 2, ... are: the constraints, and level - f >= 0 behind them."""
        found = [Row(c.polynomial, c.equality) for c in self.problem.constraints]
        if level is not None:
            above = Polynomial({(): level.numerator}, 1 - level.denominator.bit_length())
            above.add(self.problem.objective, -1)
            found.append(Row(above, False))
        return found


Holds = Callable[[int, int, int], "Fraction | None"]


def squares_constant(problem: Problem) -> Fraction | None:
    """The constant of objective = constant + sum of weight * p^2, None if that does not hold."""
    if not problem.squares:
        return None
    rest = Polynomial()
    rest.add(problem.objective)
    for weight, p in problem.squares:
        factor = Polynomial({(): weight.numerator}, 1 - weight.denominator.bit_length())
        rest.add(p.times(p).times(factor), -1)
    return None if rest.open() else rest.coefficient()


# ---- steps ------------------------------------------------------------------------------------


class Propagation:
    """A number of sweeps."""

    def __init__(self, found: Any, n: int, place: str) -> None:
        self.sweeps = whole(item(found, "sweeps", place), f"{place}.sweeps")
        self.cutoff = flag(item(found, "cutoff", place), f"{place}.cutoff")

    def apply(self, replay: Replay, box: Box) -> Box | None:
        """The box after the sweeps; fewer where nothing changes any more."""
        rows = replay.rows(self.cutoff)
        for _ in range(self.sweeps):
            if not rows.sweep(box, self.cutoff):
                return None
            if not box.stale[self.cutoff]:
                break
        return box


class Sublevel:
    """|t_v| <= (K - 1)^(1 / 2d) where f <= level, from an identity with a floor."""

    cutoff = True

    def __init__(self, found: Any, n: int, place: str) -> None:
        self.identity = Identity(item(found, "identity", place), n, f"{place}.identity")
        self.level = Fraction(finite(item(found, "level", place), f"{place}.level"))

    def apply(self, replay: Replay, box: Box) -> Box | None:
        """The box within these bounds."""
        scaling = self.identity.scaling
        assert replay.level is not None
        if replay.level > self.level or not fits(scaling, box):
            replay.notes.append("a sublevel set is about a lower level or a smaller box")
            return box
        system = replay.system(self.level)
        proved = self.identity.prove(system, replay.problem.constraints, Polynomial())
        if proved.bound == -INF or not proved.floor > 0:
            replay.notes.append(f"a sublevel set gives no box: {proved.reason}")
            return box
        words = {
            letters
            for group in self.identity.groups
            if group.floor > 0 and not group.free
            for k, generator in enumerate(group.generator)
            if generator == 0
            for letters in group.basis[k]
        }
        room = max(Fraction(0), -proved.bound / proved.floor - (() in words))
        most: dict[int, int] = {}
        for letters in words:
            if len(set(letters)) == 1:
                v = letters[0] - 1
                most[v] = max(most.get(v, 0), len(letters))
        for v, power in most.items():
            reach = iv.exact(iv.root_above(iv.above(room), 2 * power)) * Fraction(scaling.scale[v])
            centre = Fraction(scaling.centre[v])
            box.shrink(v, iv.below(centre - reach), iv.above(centre + reach))
        return box


class LeftInverse:
    """|theta - centre| <= radius, from an approximate left inverse of linear equations."""

    cutoff = False

    def __init__(self, found: Any, n: int, place: str) -> None:
        self.rows = indices(item(found, "rows", place), 2**31, f"{place}.rows")
        self.variables = indices(item(found, "variables", place), n, f"{place}.variables")
        self.inverse = reals(item(found, "inverse", place), 2, f"{place}.inverse")
        self.centre = reals(item(found, "centre", place), 1, f"{place}.centre")
        self.radius = reals(item(found, "radius", place), 1, f"{place}.radius")
        p, count = len(self.variables), len(self.rows)
        shapes = len(self.inverse) == len(self.centre) == len(self.radius) == p
        if not shapes or any(len(row) != count for row in self.inverse):
            raise Malformed(f"{place}: its arrays do not belong together")
        if len(set(self.variables)) < p or any(not radius > 0 for radius in self.radius):
            raise Malformed(f"{place}: a variable stands twice, or a radius is not positive")

    def apply(self, replay: Replay, box: Box) -> Box | None:
        """The box within centre +- radius, if the test G radius + d < radius holds on it."""
        table = self._table(replay.problem, box)
        if table is None or not self._holds(table):
            replay.notes.append("a left inverse gives no box")
            return box
        for v, centre, radius in zip(self.variables, self.centre, self.radius, strict=True):
            middle, reach = Fraction(centre), Fraction(radius)
            box.shrink(v, iv.below(middle - reach), iv.above(middle + reach))
        return box

    def _table(self, problem: Problem, box: Box) -> list[list[Interval]] | None:
        """Ranges of the coefficients C and, last in each row, of the rest r; None if no use."""
        place = {v: k for k, v in enumerate(self.variables)}
        found = []
        for row in self.rows:
            if row >= len(problem.constraints) or not problem.constraints[row].equality:
                return None
            polynomial = problem.constraints[row].polynomial
            parts: list[dict[Word, int]] = [{} for _ in range(len(place) + 1)]
            for letters, value in polynomial.terms.items():
                ours = [v - 1 for v in letters if v - 1 in place]
                if len(ours) > 1:
                    return None
                others = tuple(v for v in letters if v - 1 not in place)
                parts[place[ours[0]] if ours else -1][others] = value
            ranges = [iv.range_over(Polynomial(p, polynomial.exp), box.ends) for p in parts]
            if any(end in (INF, -INF) for pair in ranges for end in pair):
                return None
            found.append(ranges)
        return found

    def _holds(self, table: list[list[Interval]]) -> bool:
        """Whether G v + d < v, with G = |I - M C| and d = |M (r + C centre)|, v = radius."""
        centre, below = dyadic(self.centre)
        flat, exp = dyadic([m for row in self.inverse for m in row])
        p, count = len(centre), len(self.rows)
        offset = []  # r + C centre, times 2**-below
        for row in table:
            low = sum(_times(c, pair)[0] for c, pair in zip(centre, row, strict=False))
            high = sum(_times(c, pair)[1] for c, pair in zip(centre, row, strict=False))
            offset.append((low + (row[p][0] << -below), high + (row[p][1] << -below)))
        unit = (1 << -exp) * iv.scaled(1, 0)[0]
        for i in range(p):
            inverse = flat[i * count : (i + 1) * count]
            reached = Fraction(_size(inverse, offset, 0), unit << -below)
            for j in range(p):
                one = unit if i == j else 0
                size = _size(inverse, [row[j] for row in table], one)
                reached += Fraction(size, unit) * Fraction(self.radius[j])
            if not reached < Fraction(self.radius[i]):
                return False
        return True


def _times(c: int, pair: Interval) -> Interval:
    return (c * pair[0], c * pair[1]) if c >= 0 else (c * pair[1], c * pair[0])


def _size(weights: list[int], column: list[Interval], one: int) -> int:
    """The size of one - sum of weights times intervals."""
    ends = [_times(m, pair) for m, pair in zip(weights, column, strict=True)]
    return max(abs(one - sum(e[0] for e in ends)), abs(one - sum(e[1] for e in ends)))


class Tightening:
    """side * x_variable >= value, as a linear dual or an identity proves on the box."""

    def __init__(self, found: Any, n: int, place: str) -> None:
        self.variable = indices(item(found, "variable", place), n, f"{place}.variable")
        self.side: list[int] = array(item(found, "side", place), "i", 1, f"{place}.side")
        self.value: list[float] = array(item(found, "value", place), "f", 1, f"{place}.value")
        self.argument = argument_of(item(found, "argument", place), n, f"{place}.argument")
        self.cutoff = flag(item(found, "cutoff", place), f"{place}.cutoff")
        if isinstance(self.argument, ExactGram) or not set(self.side) <= {1, -1}:
            raise Malformed(f"{place}: a side other than 1 and -1, or another argument")
        if not len(self.variable) == len(self.side) == len(self.value):
            raise Malformed(f"{place}: its arrays do not belong together")

    def apply(self, replay: Replay, box: Box) -> Box | None:
        """The box with those bounds that are proved."""
        if not fits(self.argument.scaling, box):
            replay.notes.append("a tightening is about a smaller box")
            return box
        system = replay.system(replay.level if self.cutoff else None)
        pairs = zip(self.variable, self.side, strict=True)
        asked = [Polynomial({(v + 1,): side}) for v, side in pairs]
        if isinstance(self.argument, LinearDual):
            bounds = self.argument.prove(system, asked)
        elif len(asked) == 1:
            bounds = [self.argument.prove(system, replay.problem.constraints, asked[0]).bound]
        else:
            return box
        for v, side, value, bound in zip(
            self.variable, self.side, self.value, bounds, strict=True
        ):
            if value in (INF, -INF) or bound == -INF or bound < Fraction(value):
                replay.notes.append(f"a bound of variable {v + 1} is not proved")
                continue
            ends = iv.below(Fraction(value)), iv.above(-Fraction(value))
            box.shrink(v, *((ends[0], INF) if side > 0 else (-INF, ends[1])))
        return box


class Known:
    """Bounds of variables that are certificates of their own."""

    cutoff = False

    def __init__(self, found: Any, n: int, place: str) -> None:
        self.bounds: list[tuple[int, int, int]] = []
        for row in items(item(found, "bounds", place), f"{place}.bounds"):
            triple = [whole(v, f"{place}.bounds") for v in items(row, f"{place}.bounds")]
            if len(triple) != 3 or not 0 <= triple[0] < n or triple[1] not in (1, -1):
                raise Malformed(f"{place}.bounds: not a variable, a side and a certificate")
            self.bounds.append((triple[0], triple[1], triple[2]))

    def apply(self, replay: Replay, box: Box) -> Box | None:
        """The box with those bounds whose certificates hold."""
        for v, side, quoted in self.bounds:
            value = replay.holds(quoted, v, side)
            if value is None:
                replay.notes.append(f"quoted certificate {quoted} does not hold")
                continue
            box.shrink(v, *((iv.below(value), INF) if side > 0 else (-INF, iv.above(-value))))
        return box


STEPS: dict[str, Any] = {
    "Propagation": Propagation,
    "Sublevel": Sublevel,
    "LeftInverse": LeftInverse,
    "Tightening": Tightening,
    "Known": Known,
}


def fits(scaling: Any, box: Box) -> bool:
    """Whether a box lies in that of a scaling."""
    return bool(scaling.holds([(iv.exact(low), iv.exact(high)) for low, high in box.ends]))


# ---- trees ------------------------------------------------------------------------------------


class Part:
    """One part of a tree: steps, and then an argument or two children."""

    def __init__(self, found: Any, n: int, place: str, own: int, count: int) -> None:
        self.place = place
        self.steps = []
        for k, step in enumerate(items(item(found, "steps", place), f"{place}.steps")):
            here = f"{place}.steps[{k}]"
            name = item(step, "is", here)
            if name not in STEPS:
                raise Malformed(f"{here}.is: {name!r:.40} is not one of {', '.join(STEPS)}")
            self.steps.append(STEPS[name](step, n, here))
        read = lambda f, p: argument_of(f, n, p)  # noqa: E731
        self.argument = optional(item(found, "argument", place), read, f"{place}.argument")
        self.empty = flag(item(found, "empty", place), f"{place}.empty")
        given = found["branch"] if "branch" in found else item(found, "cut", place)
        self.branch: tuple[int, Fraction] | None = None
        if given is not None:
            pair = items(given, f"{place}.branch")
            if len(pair) != 2 or not 0 <= whole(pair[0], f"{place}.branch") < n:
                raise Malformed(f"{place}.branch: not a variable and a number")
            self.branch = pair[0], Fraction(finite(pair[1], f"{place}.branch"))
        children = items(item(found, "children", place), f"{place}.children")
        self.children = [whole(child, f"{place}.children") for child in children]
        if any(not own < child < count for child in self.children):
            raise Malformed(f"{place}.children: not numbers of later parts")
        if len(self.children) != (0 if self.branch is None else 2):
            raise Malformed(f"{place}.children: two belong to a branch, none to the end of one")


class Certificate:
    """A claim and its argument."""

    def __init__(self, found: Any, n: int, place: str, own: int) -> None:
        self.place = place
        self.claim = number(item(found, "bound", place), f"{place}.bound")
        level = optional(item(found, "cutoff", place), number, f"{place}.cutoff")
        if level in (INF, -INF):
            raise Malformed(f"{place}.cutoff: not finite")
        self.level = None if level is None else Fraction(level)
        parts = items(item(found, "parts", place), f"{place}.parts")
        if not parts:
            raise Malformed(f"{place}.parts: none")
        count = len(parts)
        self.parts = [
            Part(part, n, f"{place}.parts[{k}]", k, count) for k, part in enumerate(parts)
        ]
        self.quotes = {
            bound
            for part in self.parts
            for step in part.steps
            if isinstance(step, Known)
            for bound in step.bounds
        }
        if any(not 0 <= quoted < own for _, _, quoted in self.quotes):
            raise Malformed(f"{place}: it quotes a certificate that does not stand before it")

    def prove(self, problem: Problem, holds: Holds) -> tuple[Any, list[str]]:
        """The lower bound that the argument proves, and what may be wrong where it is weak."""
        replay = Replay(problem, self.level, holds)
        box = Box([(iv.below(a), iv.above(b)) for a, b in _ends(problem)])
        bound: Any = INF
        used = False
        why: list[str] = []
        stack = [(self.parts[0], box)]
        while stack:
            part, box = stack.pop()
            replay.notes = []
            used |= any(step.cutoff for step in part.steps)
            found = self._shrunk(replay, part, box)
            if found is not None and part.branch is not None:
                stack += self._children(part, found)
                continue
            value = self._bound(replay, part, found)
            if value < bound:
                bound, why = value, [part.place, *replay.notes]
        if used and self.level is not None and bound > self.level:
            return self.level, ["nothing is proved above the cut-off"]
        return bound, why

    def _shrunk(self, replay: Replay, part: Part, box: Box) -> Box | None:
        """The box of a part after its steps, None where it holds no point."""
        for step in part.steps:
            if box.empty:
                return None
            if step.cutoff and self.level is None:
                replay.notes.append("a step uses a cut-off that the certificate lacks")
                continue
            found = step.apply(replay, box)
            if found is None:
                return None
            box = found
        return None if box.empty else box

    def _children(self, part: Part, box: Box) -> list[tuple[Part, Box]]:
        """The two children with their boxes, which cover the box."""
        assert part.branch is not None
        v, at = part.branch
        low, high = box, box.copy()
        low.shrink(v, -INF, iv.above(at))
        high.shrink(v, iv.below(at), INF)
        first, second = (self.parts[child] for child in part.children)
        return [(first, low), (second, high)]

    def _bound(self, replay: Replay, part: Part, box: Box | None) -> Any:
        """What is proved on one part."""
        if box is None:
            return INF
        low = iv.exact(iv.range_over(replay.problem.objective, box.ends)[0])
        if replay.constant is not None:
            low = max(low, replay.constant)
        argument = part.argument
        if argument is None:
            return low
        if isinstance(argument, ExactGram):
            return low if part.empty else max(low, argument.prove(replay.problem.objective))
        if not fits(argument.scaling, box):
            replay.notes.append("the multipliers are about a smaller box")
            return low
        objective = Polynomial() if part.empty else replay.problem.objective
        system = replay.system(None)
        if isinstance(argument, LinearDual):
            value = argument.prove(system, [objective])[0]
        else:
            proved = argument.prove(system, replay.problem.constraints, objective)
            value = proved.bound
            replay.notes += [proved.reason] if proved.reason else []
        if part.empty:
            value = INF if value > 0 else -INF
        return max(low, value)


def _ends(problem: Problem) -> list[tuple[Any, Any]]:
    return list(zip(problem.lower, problem.upper, strict=True))


class Certificates:
    """A list of certificates; each may quote those before it."""

    def __init__(self, found: Any, problem: Problem, place: str = "certificate") -> None:
        n = problem.dimension
        given = items(found, place)
        if not given:
            raise Malformed(f"{place}: an empty list")
        self.problem = problem
        self.list = [Certificate(c, n, f"{place}[{k}]", k) for k, c in enumerate(given)]
        self._proved: dict[tuple[int, int, int], Fraction | None] = {}

    def prove(self) -> tuple[Any, list[str]]:
        """The bound that the last one proves for the problem, and why it may be weak."""
        needed = set(self.list[-1].quotes)
        for k in range(len(self.list) - 1, -1, -1):
            if any(quoted == k for _, _, quoted in needed):
                needed |= self.list[k].quotes
        for v, side, k in sorted(needed, key=lambda quote: quote[2]):
            quoted = self.list[k]
            bound, _ = quoted.prove(self.problem.about(v, side), self.holds)
            good = quoted.claim not in (INF, -INF) and bound >= quoted.claim
            self._proved[k, v, side] = Fraction(quoted.claim) if good else None
        return self.list[-1].prove(self.problem, self.holds)

    def holds(self, quoted: int, variable: int, side: int) -> Fraction | None:
        """The claim of a quoted certificate about side * x_variable, None if not proved."""
        return self._proved[quoted, variable, side]

    @property
    def claim(self) -> Any:
        """The claim of the last one."""
        return self.list[-1].claim
