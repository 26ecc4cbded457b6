"""Certificates: replay the steps that shrink boxes, split them, and bound every part."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any, ClassVar

from ..arithmetic import interval as iv
from ..arithmetic.interval import Interval
from ..arithmetic.polynomial import INF, Polynomial, split, total
from ..files.reading import (
    Malformed,
    Problem,
    alike,
    below,
    branch,
    each,
    fields,
    items,
    one_of,
    perhaps,
    together,
)
from .exact_dual import ExactDual
from .gram import ExactGram
from .identity import Identity, LinearDual, Row
from .left_inverse import contracts
from .propagation import Box, Rows
from .propagation import Row as BoxRow

Holds = Callable[[int, int, int], "Fraction | None"]
MOST_SWEEPS = 200  # the box of fewer sweeps is larger, so that nothing false follows

argument_of = perhaps(one_of(Identity, LinearDual, ExactGram, ExactDual))


class Replay:
    """Rows and numbers that steps ask of a problem and a cutoff of its objective (or None)."""

    def __init__(self, problem: Problem, cutoff: Fraction | None, holds: Holds) -> None:
        self.problem, self.cutoff, self.holds = problem, cutoff, holds
        self.notes: list[str] = []
        self.constant = squares_constant(problem)
        self._rows: dict[bool, Rows] = {}

    def rows(self, uses_cutoff: bool) -> Rows:
        """List the rows of propagation, with the row of the cutoff or without."""
        if uses_cutoff not in self._rows:
            found = [
                BoxRow(c.polynomial, (0, 0 if c.equality else INF))
                for c in self.problem.constraints
            ]
            found += self._of_cutoff() if uses_cutoff else []
            self._rows[uses_cutoff] = self._with_matrices(found)
        return self._rows[uses_cutoff]

    def _of_cutoff(self) -> list[BoxRow]:
        """The row f <= cutoff, and |p| <= sqrt((cutoff - constant) / weight) for squares."""
        assert self.cutoff is not None
        found = [BoxRow(self.problem.objective, (-INF, iv.above(self.cutoff)))]
        if self.constant is not None:
            room = max(self.cutoff - self.constant, Fraction(0))
            for weight, p in self.problem.squares:
                if weight > 0:
                    reach = iv.root_above(iv.above(room / weight), 2)
                    found.append(BoxRow(p, (-reach, reach)))
        return found

    def _with_matrices(self, found: list[BoxRow]) -> Rows:
        """The rows and those of matrices: G_ii >= 0 and G_ij^2 <= G_ii G_jj."""
        minors = set()
        for c in self.problem.constraints:
            first, diagonal = len(found), {c.place(i, i) for i in range(c.side)}
            for k, p in enumerate(c.entries):
                found.append(BoxRow(p, (0 if k in diagonal else -INF, INF)))
            for i in range(c.side):
                for j in range(i):
                    if c.place(i, j) >= 0:
                        a, b, d = c.place(i, j), c.place(i, i), c.place(j, j)
                        minors.add((first + a, first + b, first + d))
        return Rows(found, sorted(minors))

    def system(self, cutoff: Fraction | None) -> list[Row]:
        """List generators 1, 2, ...: the constraints, and cutoff - f >= 0 behind them."""
        found = [Row(c.polynomial, c.equality) for c in self.problem.constraints]
        if cutoff is not None:
            found.append(Row(Polynomial.of([()], [cutoff]).minus(self.problem.objective), False))
        return found

    def fits(self, scaling: Any, box: Box, what: str) -> bool:
        """Check whether a box lies in that of a scaling; remark where it does not."""
        good = scaling.holds([(iv.exact(low), iv.exact(high)) for low, high in box.ends])
        self.notes += [] if good else [f"{what} is about a smaller box"]
        return bool(good)

    def bounds(
        self, argument: Any, box: Box, cutoff: Fraction | None, asked: list[Polynomial], what: str
    ) -> list[Any]:
        """Bound objectives on a box by an argument, -INF where it proves nothing."""
        if isinstance(argument, ExactGram):
            return [argument.prove(objective) for objective in asked]
        rational = isinstance(argument, ExactDual)
        if not self.fits(argument if rational else argument.scaling, box, what):
            return [-INF] * len(asked)
        system = self.system(cutoff)
        if rational:
            return [argument.prove(system, objective) for objective in asked]
        if isinstance(argument, LinearDual):
            return argument.prove(system, asked)
        constraints = self.problem.constraints
        proved = [argument.prove(system, constraints, objective) for objective in asked]
        self.notes += [one.reason for one in proved if one.reason]
        return [one.bound for one in proved]


def squares_constant(problem: Problem) -> Fraction | None:
    """Find the constant beside the objective's sum of weight * p^2, None without one."""
    squares = total(
        p.times(p).times(Polynomial.of([()], [weight])) for weight, p in problem.squares
    )
    rest = problem.objective.minus(squares)
    return None if not problem.squares or rest.open() else rest.coefficient()


# ---- steps: each intersects a box, in place -----------------------------------------------------


class Step:
    """A step; ``uses_cutoff`` where it holds for points with f(x) <= the cutoff only."""

    KINDS: ClassVar[dict[str, Any]]
    uses_cutoff = False

    def __init__(self, found: Any, n: int, place: str) -> None:
        self.given = fields(found, place, n, **self.KINDS)
        self.uses_cutoff = getattr(self.given, "uses_cutoff", self.uses_cutoff)
        self.check(n)

    def check(self, n: int) -> None:
        """Refuse what makes no sense for n variables."""

    def apply(self, replay: Replay, box: Box) -> None:
        """Shrink the box by what the step proves; where that is nothing, leave a remark."""
        raise NotImplementedError


class Propagation(Step):
    """A number of sweeps, fewer where nothing changes any more."""

    KINDS: ClassVar = {"sweeps": "i", "uses_cutoff": "b"}

    def apply(self, replay: Replay, box: Box) -> None:
        """See the class."""
        rows = replay.rows(self.uses_cutoff)
        for _ in range(min(self.given.sweeps, MOST_SWEEPS)):
            if box.empty or not box.stale[self.uses_cutoff]:
                break
            rows.sweep(box, self.uses_cutoff)


class Sublevel(Step):
    """|t_v| <= (K - 1)^(1 / 2d) where f <= cutoff, from an identity with a floor."""

    KINDS: ClassVar = {"identity": Identity, "cutoff": "e"}
    uses_cutoff = True

    def apply(self, replay: Replay, box: Box) -> None:
        """See the class."""
        identity, least = self.given.identity, self.given.cutoff
        if replay.cutoff is None or replay.cutoff > least:
            replay.notes.append("a sublevel set is about a lower cutoff")
            return
        if not replay.fits(identity.scaling, box, "a sublevel set"):
            return
        system = replay.system(least)
        proved = identity.prove(system, replay.problem.constraints, Polynomial())
        if proved.bound == -INF or not proved.floor > 0:
            replay.notes.append(f"a sublevel set gives no box: {proved.reason}")
            return
        words = {
            word
            for group in identity.groups
            if group.floor > 0 and not group.free
            for generator, basis in zip(group.generator, group.basis, strict=True)
            if generator == 0
            for word in basis
        }
        room = iv.above(max(Fraction(0), -proved.bound / proved.floor - (() in words)))
        for word in words:
            if len(set(word)) == 1:
                v, power = word[0] - 1, 2 * len(word)
                reach = iv.exact(iv.root_above(room, power)) * Fraction(identity.scaling.scale[v])
                middle = Fraction(identity.scaling.centre[v])
                box.shrink(v, iv.below(middle - reach), iv.above(middle + reach))


class LeftInverse(Step):
    """|theta - centre| <= radius, from an approximate left inverse of linear equations."""

    KINDS: ClassVar = {
        "rows": "i1",
        "variables": "i1",
        "inverse": "f2",
        "centre": "f1",
        "radius": "f1",
    }

    def check(self, n: int) -> None:
        """Refuse shapes and numbers that do not belong together."""
        got = self.given
        alike(got.where, got.variables, got.inverse, got.centre, got.radius)
        alike(got.where, got.rows, *got.inverse)
        below(got.variables, n, got.where)
        if len(set(got.variables)) < len(got.variables) or any(not r > 0 for r in got.radius):
            raise Malformed(f"{got.where}: a variable twice, or a radius that is not positive")

    def apply(self, replay: Replay, box: Box) -> None:
        """See the class; nothing where the test G radius + d < radius fails."""
        got = self.given
        below(got.rows, len(replay.problem.constraints), f"{got.where}.rows")
        table = self._table(replay.problem, box)
        if table is None or not contracts(got.inverse, table, got.centre, got.radius):
            replay.notes.append("a left inverse gives no box")
            return
        for v, middle, reach in zip(got.variables, got.centre, got.radius, strict=True):
            ends = Fraction(middle) - Fraction(reach), Fraction(middle) + Fraction(reach)
            box.shrink(v, iv.below(ends[0]), iv.above(ends[1]))

    def _table(self, problem: Problem, box: Box) -> list[list[Interval]] | None:
        """Ranges of the coefficients C and, last in each row, of the rest r; None if no use."""
        heads = [*((v + 1,) for v in self.given.variables), ()]
        inside = {v for head in heads for v in head}
        found = []
        for c in (problem.constraints[k] for k in self.given.rows):
            parts = split(c.polynomial.terms, inside)
            if not c.equality or not parts.keys() <= set(heads):
                return None
            factors = (Polynomial(parts.get(head), c.polynomial.exp) for head in heads)
            ranges = [iv.range_over(p, box.ends) for p in factors]
            if any(end in (INF, -INF) for pair in ranges for end in pair):
                return None
            found.append(ranges)
        return found


class Tightening(Step):
    """side * x_variable >= value, as a linear dual or an identity proves on the box."""

    KINDS: ClassVar = {
        "variable": "i1",
        "side": "i1",
        "value": "F1",
        "argument": argument_of,
        "uses_cutoff": "b",
    }

    def check(self, n: int) -> None:
        """Refuse other sides than 1 and -1, and other arguments."""
        got = self.given
        alike(got.where, got.variable, got.side, got.value)
        below(got.variable, n, got.where)
        single = isinstance(got.argument, (Identity, ExactDual)) and len(got.value) == 1
        if not set(got.side) <= {1, -1} or not (single or isinstance(got.argument, LinearDual)):
            raise Malformed(f"{got.where}: a side other than 1 and -1, or another argument")

    def apply(self, replay: Replay, box: Box) -> None:
        """See the class."""
        got = self.given
        cutoff = replay.cutoff if self.uses_cutoff else None
        asked = [Polynomial({(v + 1,): s}) for v, s in zip(got.variable, got.side, strict=True)]
        bounds = replay.bounds(got.argument, box, cutoff, asked, "a tightening")
        for v, side, value, bound in zip(got.variable, got.side, got.value, bounds, strict=True):
            if value not in (INF, -INF) and bound >= value:
                bounded(box, v, side, Fraction(value))
            else:
                replay.notes.append(f"a bound of variable {v + 1} is not proved")


def bounded(box: Box, v: int, side: int, value: Fraction) -> None:
    """Intersect a box with side * x_v >= value."""
    box.shrink(v, *((iv.below(value), INF) if side > 0 else (-INF, iv.above(-value))))


class Known(Step):
    """Bounds of variables that are certificates of their own."""

    KINDS: ClassVar = {"bounds": each(together("i", "i", "i"))}

    def check(self, n: int) -> None:
        """Refuse what is not a variable, a side and the number of a certificate."""
        for row in self.given.bounds:
            if not 0 <= row[0] < n or row[1] not in (1, -1):
                raise Malformed(f"{self.given.where}: {row!r:.40} is no bound of a variable")

    def apply(self, replay: Replay, box: Box) -> None:
        """See the class."""
        for v, side, quoted in self.given.bounds:
            value = replay.holds(quoted, v, side)
            if value is None:
                replay.notes.append(f"quoted certificate {quoted} does not hold")
            else:
                bounded(box, v, side, value)


step_of = one_of(Propagation, Sublevel, LeftInverse, Tightening, Known)


# ---- trees ------------------------------------------------------------------------------------


class Part:
    """Node of a tree (of ``parts`` in files): steps, and then an argument or two children."""

    def __init__(self, found: Any, n: int, place: str, own: int, count: int) -> None:
        kinds = {"steps": each(step_of), "empty": "b", "children": "i*"}
        got = fields(found, place, n, argument=argument_of, branch=perhaps(branch), **kinds)
        self.place, self.argument, self.empty = place, got.argument, got.empty
        self.steps, self.children, self.branch = got.steps, got.children, got.branch
        below([count - 1 - child for child in self.children], count - 1 - own, f"{place}.children")
        if len(self.children) != (0 if self.branch is None else 2):
            raise Malformed(f"{place}: {len(self.children)} children")


class Certificate:
    """A claim and its argument."""

    def __init__(self, found: Any, n: int, place: str, own: int) -> None:
        got = fields(found, place, n, fingerprint="t", bound="F", cutoff="e?", parts="l")
        self.claim, self.cutoff = got.bound, got.cutoff
        count = len(got.parts)
        if not count:
            raise Malformed(f"{place}: no parts")
        self.parts = [Part(p, n, f"{place}.parts[{k}]", k, count) for k, p in enumerate(got.parts)]
        children = [child for part in self.parts for child in part.children]
        if len(set(children)) < len(children):
            raise Malformed(f"{place}: a part that is a child twice")
        known = (s for part in self.parts for s in part.steps if isinstance(s, Known))
        self.quotes = {tuple(bound) for step in known for bound in step.given.bounds}
        below([quoted for _, _, quoted in self.quotes], own, f"{place}: a quoted certificate")

    def prove(self, problem: Problem, holds: Holds) -> tuple[Any, list[str]]:
        """Prove the lower bound of the argument; say what makes it weak."""
        replay = Replay(problem, self.cutoff, holds)
        ends = zip(problem.lower, problem.upper, strict=True)
        stack = [(self.parts[0], Box([(iv.below(a), iv.above(b)) for a, b in ends]))]
        bound, why, used = INF, list[str](), False
        while stack:
            part, box = stack.pop()
            replay.notes = []
            for step in part.steps:
                if step.uses_cutoff and self.cutoff is None:
                    replay.notes.append("a step needs a cutoff, which the certificate lacks")
                elif not box.empty:
                    used |= step.uses_cutoff
                    step.apply(replay, box)
            if part.branch is not None and not box.empty:
                v, at = part.branch
                low, high = box, box.copy()
                low.shrink(v, -INF, iv.above(at))  # the two halves cover the box
                high.shrink(v, iv.below(at), INF)
                pair = (self.parts[child] for child in part.children)
                stack += zip(pair, (low, high), strict=True)
                continue
            value = INF if box.empty else self._bound(replay, part, box)
            if value < bound:
                bound, why = value, [part.place, *replay.notes]
        if used and self.cutoff is not None and bound > self.cutoff:
            return self.cutoff, ["nothing is proved above the cutoff"]
        return bound, why

    def _bound(self, replay: Replay, part: Part, box: Box) -> Any:
        """Bound the objective on one node: by its box, and by its argument."""
        problem, argument = replay.problem, part.argument
        least = iv.exact(iv.range_over(problem.objective, box.ends)[0])
        if replay.constant is not None:
            least = max(least, replay.constant)
        if argument is None:
            return least
        objective = Polynomial() if part.empty else problem.objective
        (value,) = replay.bounds(argument, box, None, [objective], "the argument")
        if part.empty:
            value = INF if value > 0 else -INF
        return max(least, value)


class Certificates:
    """A list of certificates; each may quote those before it, and the last one is the claim."""

    def __init__(self, found: Any, problem: Problem, place: str = "certificate") -> None:
        self.problem, n = problem, problem.dimension
        given = items(found, place)
        if not given:
            raise Malformed(f"{place}: an empty list")
        self.list = [Certificate(c, n, f"{place}[{k}]", k) for k, c in enumerate(given)]
        self.claim = self.list[-1].claim
        self._proved: dict[tuple[int, int, int], Fraction | None] = {}

    def prove(self) -> tuple[Any, list[str]]:
        """Prove the last one's bound of the problem; say what makes it weak."""
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
        """Take a quoted certificate's proved claim about side * x_variable, None without one."""
        return self._proved[quoted, variable, side]
