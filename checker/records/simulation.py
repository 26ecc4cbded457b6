"""The box of the parameters from simulated outputs: a tree of regions that multipliers tighten.

With exact inputs and noise in the outputs alone, the equations give each output from the unknowns
x: the parameters, and the first samples that no equation gives. Over a region every sample s(k) is
value + slope (x - middle), up to a rest. Readings make rows of it, and rows bound the region.

Whole numbers z stand for z * 2**-K here, and everything is rounded towards what claims less.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any, NamedTuple

from ..arithmetic.polynomial import INF
from ..files.reading import Malformed, alike, below, each, fields, together
from ..result import NotProved
from .box import Ends, dot, hull, walk
from .linear_rows import Regression
from .structure import Term

_K = 320
ONE = 1 << _K


def down(value: Any) -> int:
    """Round a number down to whole multiples of 2**-K."""
    found: int = (Fraction(value) * ONE).__floor__()
    return found


def up(value: int, times: int = 1) -> int:
    """Divide by 2**K a number of times, rounded up."""
    return -(-value >> _K * times)


class Form(NamedTuple):
    """All x -> value + slope (x - middle) + what is at most rest; reach bounds the second part."""

    value: int
    slope: list[int]
    rest: int
    reach: int


class Region:
    """All x with low <= x <= high and least <= W x <= most; any numbers may be the shares."""

    def __init__(self, x: list[list[int]], w: list[list[int]], rows: Any, shares: Any) -> None:
        (self.low, self.high), (self.least, self.most) = x, w
        self.rows, self.shares = rows, shares
        centre = [a + b >> 1 for a, b in zip(*x, strict=True)]
        off = [(a + b >> 1) - up(dot(r, centre)) for a, b, r in zip(*w, rows, strict=True)]
        moved = (c + up(dot(s, off)) for c, s in zip(centre, shares, strict=True))
        self.middle = [min(max(m, a), b) for m, a, b in zip(moved, *x, strict=True)]
        self.far = [max(b - m, m - a) for m, a, b in zip(self.middle, *x, strict=True)]
        at = [dot(row, self.middle) for row in rows]
        sides = zip(at, *w, strict=True)
        self.width = [max((b << _K) - c, c - (a << _K)) for c, a, b in sides]
        self.lost = up(sum(self.far)) + 1  # by rounding a value and each slope down

    @property
    def empty(self) -> bool:
        """True if an end is above another one."""
        pairs = zip(self.low + self.least, self.high + self.most, strict=True)
        return any(a > b for a, b in pairs)

    def reach(self, slope: list[int]) -> int:
        """Bound slope (x - middle), over the box or by shares of directions."""
        if not any(slope):
            return 0
        found = up(dot(map(abs, slope), self.far))
        if not self.rows:
            return found
        share = [dot(slope, column) >> _K for column in zip(*self.shares, strict=True)]
        left = [
            (g << _K) - dot(share, column)
            for g, column in zip(slope, zip(*self.rows, strict=True), strict=True)
        ]
        return min(found, up(dot(map(abs, share), self.width) + dot(map(abs, left), self.far), 2))

    def times(self, a: Form, b: Form) -> Form:
        """Multiply two forms."""
        slope = [a.value * g + b.value * h >> _K for g, h in zip(b.slope, a.slope, strict=True)]
        rest = a.reach * b.reach + (abs(a.value) + a.reach) * b.rest
        rest += (abs(b.value) + b.reach + b.rest) * a.rest
        return Form(a.value * b.value >> _K, slope, up(rest) + self.lost, self.reach(slope))

    def number(self, value: Any) -> Form:
        """Make a form of a number, rounded."""
        return Form(down(value), [0] * len(self.low), 1, 0)

    def unknown(self, place: int) -> Form:
        """Make a form of one entry of x."""
        slope = [ONE * (v == place) for v in range(len(self.low))]
        return Form(self.middle[place], slope, 0, self.reach(slope))


class Simulation:
    """The equations of a record in the order in which they give its signals."""

    def __init__(self, about: Any, rows: Regression, where: str = "box") -> None:
        self.about, self.regression, self.where = about, rows, where
        record, structure = about.record, about.structure
        quiet = not any(v for name in ("input", "equation") for c in record.bounds[name] for v in c)
        gaps = record.u if structure.zero else [*record.u, *record.y]
        if not quiet or len(record.starts) > 1 or any(None in column for column in gaps):
            raise NotProved(f"{where}: a simulation of a record that is none")
        self.equations = {name: structure.equation(name) for name in structure.equations}
        self.places = {name: place for place, name in enumerate(about.names)}
        self.past: dict[str, range] = {}  # samples of outputs that are unknowns
        for name, terms in self.equations.items():
            own = [term.lag for term in terms if term.signal == name]
            begin = 0 if structure.zero else max(term.lag for term in terms)
            if name[0] == "z" and not structure.zero:
                raise NotProved(f"{where}: partial outputs that do not begin at rest")
            self.past[name] = range(begin - max(own) if begin else 0, begin)
        self.unknowns = [(name, k) for name, samples in self.past.items() for k in samples]

    def root(self, ends: Ends) -> list[list[int]]:
        """Read the box of x: parameters, then first samples as they were read."""
        box = [list(zip(*ends, strict=True)), []]
        for name, k in self.unknowns:
            y, bound = self.reading(int(name[1:]) - 1, k, self.where)
            box[1].append((y - bound, y + bound))
        pairs = box[0] + box[1]
        if any(end in (INF, -INF) for pair in pairs for end in pair):
            raise NotProved(f"{self.where}: a simulation over parameters that are not bounded")
        return [[down(a) for a, _ in pairs], [-down(-b) for _, b in pairs]]

    def reading(self, channel: int, k: int, place: str) -> tuple[Fraction, Fraction]:
        """Take a sample of an output as read, with the bound of its noise."""
        record = self.about.record
        below([channel], len(record.y), f"{place}: output")
        below([k], record.samples, f"{place}: sample")
        if record.y[channel][k] is None:
            raise NotProved(f"{place}: a sample that was not read")
        return record.y[channel][k], record.bounds["output"][channel][k]

    def run(self, region: Region, last: int) -> dict[str, dict[int, Form]]:
        """Compute all signals until some sample, as forms over a region."""
        record = self.about.record
        known = {f"u{j}": column for j, column in enumerate(record.u, 1)}
        below([last], record.samples, f"{self.where}: sample")
        signals = {
            name: {k: region.number(v) for k, v in enumerate(column[: last + 1])}
            for name, column in known.items()
        }
        for name in self.equations:
            signals[name] = self._solved(name, signals, region, last)
        return signals

    def _solved(self, name: str, signals: Any, region: Region, last: int) -> dict[int, Form]:
        """A signal from its equation: an approximate solution, and how far it may be off."""
        terms = [(term, self._factor(term, region)) for term in self.equations[name]]
        poles = [(term.lag, factor) for term, factor in terms if term.signal == name and term.lag]
        begin, first = self.past[name].stop, len(self.places)
        found = {k: region.unknown(first + self.unknowns.index((name, k))) for k in self.past[name]}
        left = []  # what the solution leaves in the equation
        for k in range(begin, last + 1):
            value, slope, rest = 0, [0] * len(region.low), 0
            for term, factor in terms:
                part: Form | None = factor
                if term.signal:
                    source = found if term.signal == name else signals[term.signal]
                    other = source.get(k - term.lag)  # at rest before the record
                    part = region.times(factor, other) if other else None
                if part:
                    value -= part.value
                    slope = [g - h for g, h in zip(slope, part.slope, strict=True)]
                    rest += part.rest
            found[k] = Form(value, slope, 0, region.reach(slope))
            left.append(rest)
        effect = _response(poles, len(left))
        for j in range(len(left)):
            off = up(dot(left[: j + 1], reversed(effect[: j + 1])))
            found[begin + j] = found[begin + j]._replace(rest=off)
        return found

    def _factor(self, term: Term, region: Region) -> Form:
        """The sign and the parameters of a term."""
        found = Form(term.sign * ONE, [0] * len(region.low), 0, 0)
        for name in term.parameters:
            found = region.times(found, region.unknown(self.places[name]))
        return found

    def row(
        self, given: Any, region: Region, signals: Any, place: str = "box.rows"
    ) -> tuple[list[int], int]:
        """Write a row slopes x <= right for every consistent x in the region."""
        kind, number, k, sign = given
        if kind == "output":
            return self._read(number, k, sign, region, signals, place)
        if kind == "direction":
            below([number], len(region.rows), place)
            right = region.most[number] if sign > 0 else -region.least[number]
            return [sign * g for g in region.rows[number]], right
        if kind == "given":
            slopes, constant = self._given(number, sign, place)
        elif kind == "record":
            slopes, constant = self._chords(number, k, sign, region, place)
        else:
            raise Malformed(f"{place}: of an unknown kind")
        slopes += [Fraction(0)] * len(self.unknowns)
        size = sum(max(abs(a), abs(b)) for a, b in zip(region.low, region.high, strict=True))
        return [down(g) for g in slopes], -down(-constant) + up(size)

    def _read(
        self, number: int, k: int, sign: int, region: Region, signals: Any, place: str
    ) -> tuple[list[int], int]:
        """A reading from above (1) or below (-1)."""
        y, bound = self.reading(number - 1, k, place)
        form = signals[f"y{number}"].get(k)
        if form is None:
            raise Malformed(f"{place}: a sample that no equation speaks of")
        slope = [sign * g for g in form.slope]
        right = -down(-(sign * y + bound)) - sign * form.value + form.rest
        return slope, right + up(dot(slope, region.middle))

    def _given(self, number: int, sign: int, place: str) -> tuple[list[Fraction], Fraction]:
        """A constraint of the problem that is linear in the parameters alone."""
        constraints, units = self.about.problem.constraints, self.about.units
        below([number], len(constraints), place)
        c = constraints[number]
        row = c.polynomial.linear(len(self.places))
        if c.side or row is None or (sign < 0 and not c.equality):
            raise NotProved(f"{place}: a row that is not linear in the parameters alone")
        *slopes, constant = row
        slopes = [-sign * slope / unit for slope, unit in zip(slopes, units, strict=False)]
        return slopes, sign * constant

    def _chords(
        self, output: int, k: int, sign: int, region: Region, place: str
    ) -> tuple[list[Fraction], Fraction]:
        """|Y + R theta| <= w0 + W |theta|, |theta| replaced by its chord over the region."""
        centre, radius = self.regression.row(output, k, place)
        slopes, right = [], radius[-1] - sign * centre[-1]
        for v in range(len(self.places)):
            a, b = region.low[v], region.high[v]
            mixed = a < 0 < b
            chord = Fraction(a + b, b - a) if mixed else Fraction(1 if a >= 0 else -1)
            right += radius[v] * Fraction(-2 * a * b, (b - a) * ONE) if mixed else 0
            slopes.append(sign * centre[v] - radius[v] * chord)
        return slopes, right


def _response(poles: list[tuple[int, Form]], samples: int) -> list[int]:
    """Bounds of the impulse response of 1 / (1 + sum of poles) for all poles in the region."""
    near: list[int] = []  # the response in the middle
    found: list[int] = []
    off: list[int] = []  # what the first leaves in its equation
    for k in range(samples):
        use = [(pole, near[k - lag]) for lag, pole in poles if lag <= k]
        near.append(-sum(pole.value * h for pole, h in use) >> _K if k else ONE)
        off.append(1 + up(sum((p.reach + p.rest) * abs(h) for p, h in use)) if k else 0)
        found.append(abs(near[k]) + up(dot(off[1:], reversed(found))))
    return found


def by_simulation(step: Any, rows: Regression, ends: Ends, place: str = "box") -> Ends:
    """Enclose what multipliers leave of the regions of a tree."""
    about, p = Simulation(rows.about, rows, place), rows.count
    got = fields(step, place, 0, directions="f**", shares="f**", nodes="l")
    tables = [[list(map(down, line)) for line in table] for table in (got.directions, got.shares)]
    box = about.root(ends)
    alike(f"{place}.shares", tables[1], box[0])
    alike(f"{place}.directions", *tables[0], box[0])
    alike(f"{place}.shares", *tables[1], tables[0])
    reach: list[list[int]] = [[], []]
    for row in tables[0]:
        pairs = [sorted((g * a, g * b)) for g, a, b in zip(row, *box, strict=True)]
        reach[0].append(sum(low for low, _ in pairs) >> _K)
        reach[1].append(up(sum(high for _, high in pairs)))
    found: list[Ends] = []

    def parts(_: int, node: Any, region: Region) -> list[Region]:
        for k, inner in enumerate(node.steps):
            at = f"{node.where}.steps[{k}]"
            region = region if region.empty else tightened(inner, about, region, at)
        if region.empty:
            return []
        if not node.children:
            sides = region.low[:p], region.high[:p]
            found.append([[Fraction(v, ONE) for v in side] for side in sides])
            return []
        low, high, cut = region.low + region.least, region.high + region.most, down(node.at)
        below([v := node.split], len(low), f"{node.where}.split")
        first, second = list(high), list(low)
        first[v], second[v] = min(cut, first[v]), max(cut, low[v])
        return [moved(region, low, first), moved(region, second, high)]

    firsts, kinds = [Region(box, reach, *tables)], {"steps": "l", "split": "i", "at": "f"}
    walk(got.nodes, f"{place}.nodes", firsts, parts, **kinds)
    return hull(found, p)


def moved(region: Region, low: list[int], high: list[int]) -> Region:
    """Replace the ends of x and of W x in a region."""
    d = len(region.low)
    return Region([low[:d], high[:d]], [low[d:], high[d:]], region.rows, region.shares)


def named(found: Any, n: int, place: str) -> list[Any]:
    """Read the kind of a row, two numbers, and a sign."""
    kind, number, k, sign = together("t", "i", "i", "i")(found, n, place)
    if min(number, k) < 0:
        raise Malformed(f"{place}: no such row")
    if sign not in (1, -1):
        raise Malformed(f"{place}: a sign other than 1 and -1")
    return [kind, number, k, sign]


def tightened(step: Any, about: Simulation, region: Region, place: str) -> Region:
    """Tighten a region by multipliers of rows, by weak duality over its box."""
    got, d = fields(step, place, 0, rows=each(named), weights="f**"), len(region.low)
    last = max((k for kind, _, k, _ in got.rows if kind == "output"), default=0)
    signals = about.run(region, last)
    places = (f"{place}.rows[{k}]" for k in range(len(got.rows)))
    rows = [about.row(row, region, signals, at) for row, at in zip(got.rows, places, strict=True)]
    goals = [[ONE * (v == j) for v in range(d)] for j in range(d)] + region.rows
    goals += [[-g for g in goal] for goal in goals] + [[0] * d]
    alike(f"{place}.weights", got.weights, goals)
    most = []
    for goal, line in zip(goals, got.weights, strict=True):
        weights = [max(down(v), 0) for v in line]
        alike(f"{place}.weights", weights, rows)
        left = [g << _K for g in goal]
        for weight, (slope, _) in zip(weights, rows, strict=True):
            if weight:
                left = [a - weight * g for a, g in zip(left, slope, strict=True)]
        ends = zip(left, region.low, region.high, strict=True)
        right = dot(weights, (right for _, right in rows)) << _K
        most.append(up(right + sum(max(g * a, g * b) for g, a, b in ends), 2))
    count, low, high = len(goals) // 2, region.low + region.least, region.high + region.most
    low = [max(a, -b) for a, b in zip(low, most[count:-1], strict=True)]
    high = [min(a, b) for a, b in zip(high, most[:count], strict=True)]
    return moved(region, [high[0] + 1, *low[1:]] if most[-1] < 0 else low, high)
