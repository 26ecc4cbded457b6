"""The box of the parameters from rows |Y + R theta| <= w0 + W |theta| of a record."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from .polynomial import INF
from .reading import Malformed, fields, finite, item, items, number, rational, whole
from .result import NotProved

ZERO = Fraction(0)
# Boxes whose proofs these files do not hold: setid verify checks them, this program does not.
KINDS = {
    "ParameterBox": "from rows of a structure that is not a transfer function",
    "DirectionBox": "from bounds on the directions of the parameters",
    "LiftedBox": "from linear programs in products of parameters",
    "CellBox": "from cells of the noise-free outputs",
    "SimulatedBox": "from cells of the parameters and simulated outputs",
}

Ends = list[list[Any]]  # lower ends, upper ends: Fractions, INF or -INF


def proved_box(about: Any) -> tuple[Ends, list[str]]:
    """The box of an identification, and what of it is taken as given."""
    ends = [list(side) for side in about.given]
    if about.box is None:
        return ends, []
    stated = [
        [v if v in (INF, -INF) else Fraction(v) for v in (number(x, "box") for x in side)]
        for side in (items(item(about.box, name, "box"), "box") for name in ("lower", "upper"))
    ]
    if any(len(side) != len(about.names) for side in stated):
        raise Malformed("box: not two ends for each parameter")
    steps = item(about.box, "steps", "box")
    if steps is None or about.structure is None:
        kind = item(about.box, "kind", "box")
        if kind not in KINDS:
            raise Malformed(f"box.kind: {kind!r:.40} is not known")
        return stated, [f"the box of the parameters, a {kind} ({KINDS[kind]})"]
    rows = Regression(about)
    for step in items(steps, "box.steps"):
        kind = item(step, "is", "box.steps")
        if kind not in ("LeftInverse", "SignTree"):
            raise Malformed(f"box.steps: {kind!r:.40} is not known")
        ends = by_inverse(step, rows, ends) if kind == "LeftInverse" else by_tree(step, rows, ends)
    for v, name in enumerate(about.names):
        if stated[0][v] > ends[0][v] or stated[1][v] < ends[1][v]:
            raise NotProved(f"the box of {name} does not follow")
    return stated, []


class Regression:
    """The rows of a record, by output (from 1) and sample (from 0)."""

    def __init__(self, about: Any) -> None:
        self.about, self.count = about, len(about.names)
        self.places = {name: v for v, name in enumerate(about.names)}
        self._known: dict[tuple[int, int], tuple[list[Fraction], list[Fraction]]] = {}

    def row(self, output: Any, k: Any) -> tuple[list[Fraction], list[Fraction]]:
        """R and W, with Y and w0 behind them."""
        record, structure = self.about.record, self.about.structure
        key = whole(output, "box"), whole(k, "box")
        if not 1 <= key[0] <= len(record.y) or not 0 <= key[1] < record.samples:
            raise Malformed("box: a row of no output or sample")
        if key not in self._known:
            terms = structure.direct(output - 1)
            centre, radius = record.regression(terms, self.places, k, structure.zero)
            radius[-1] += record.bounds["equation"][output - 1][k]
            self._known[key] = centre, radius
        return self._known[key]


def by_inverse(step: Any, rows: Regression, ends: Ends) -> Ends:
    """|theta - c| <= v, since |theta - c| <= d + G |theta - c| and d + G v < v.

    G = |I - M R| + |M| W and d = |M| (|Y + R c| + w0 + W |c|).
    """
    got = fields(step, "box", 0, rows="l", inverse="l", centre="l", radius="l")
    table = [[Fraction(finite(v, "box")) for v in items(row, "box")] for row in got.inverse]
    c, v = ([Fraction(finite(x, "box")) for x in side] for side in (got.centre, got.radius))
    pairs = [rows.row(*items(row, "box")) for row in got.rows]
    p = rows.count
    if not len(table) == len(c) == len(v) == p or any(len(row) != len(pairs) for row in table):
        raise Malformed("box: arrays that do not belong together")
    reach = []
    for y, w in pairs:
        drive = y[p] + sum((y[j] * c[j] for j in range(p)), ZERO)
        reach.append(abs(drive) + w[p] + sum((w[j] * abs(c[j]) for j in range(p)), ZERO))
    for i, inverse in enumerate(table):
        total = sum((abs(m) * r for m, r in zip(inverse, reach, strict=True)), ZERO)
        for j in range(p):
            rest, spread = Fraction(i == j), ZERO
            for m, (y, w) in zip(inverse, pairs, strict=True):
                rest -= m * y[j]
                spread += abs(m) * w[j]
            total += (abs(rest) + spread) * v[j]
        if not total < v[i]:
            raise NotProved("the left inverse of the rows does not give its box")
    low = [max(a, m - r) for a, m, r in zip(ends[0], c, v, strict=True)]
    return [low, [min(b, m + r) for b, m, r in zip(ends[1], c, v, strict=True)]]


def by_tree(step: Any, rows: Regression, ends: Ends) -> Ends:
    """The hull of what linear programs prove on the parts that signs of parameters make."""
    nodes, p = items(item(step, "nodes", "box"), "box.nodes"), rows.count
    hull: Ends = [[INF] * p, [-INF] * p]
    stack = [(0, ends)]
    while stack:
        place, part = stack.pop()
        node = fields(nodes[place], "box", 0, split="i", children="l", rows="l", bounds="l")
        if node.split < 0:
            found = leaf(node, rows, part)
            if all(a <= b for a, b in zip(*found, strict=True)):
                hull[0] = [min(a, b) for a, b in zip(hull[0], found[0], strict=True)]
                hull[1] = [max(a, b) for a, b in zip(hull[1], found[1], strict=True)]
            continue
        if len(node.children) != 2 or node.split >= p:
            raise Malformed("box: a split of no parameter, or not in two")
        if any(not place < whole(child, "box") < len(nodes) for child in node.children):
            raise Malformed("box: children that do not come later")
        left, right = ([list(side) for side in part] for _ in range(2))
        left[1][node.split] = min(left[1][node.split], ZERO)
        right[0][node.split] = max(right[0][node.split], ZERO)
        stack += [(node.children[0], left), (node.children[1], right)]
    return hull


def leaf(node: Any, rows: Regression, part: Ends) -> Ends:
    """What linear programs leave of a part; lower ends above upper ones where it is empty."""
    p = rows.count
    known = [given_row(row, rows, part) for row in node.rows]
    for sign, ends in ((1, part[0]), (-1, part[1])):  # sign * theta_i >= its end
        for i in range(p):
            known.append([*(Fraction(sign * (i == j)) for j in range(p)), -sign * ends[i]])
    found = [list(side) for side in part]
    if len(node.bounds) not in (0, 1, 2 * p):
        raise Malformed("box: not one bound for each end")
    for place, bound in enumerate(node.bounds):
        i, side = divmod(place, 2)
        goal = None if item(bound, "empty", "box") is True else (i, side)
        least = combined(known, items(item(bound, "multipliers", "box"), "box"), goal)
        if side == 0:
            found[0][i] = max(found[0][i], least)
        else:
            found[1][i] = min(found[1][i], -least)
    return found


def given_row(row: Any, rows: Regression, part: Ends) -> list[Fraction]:
    """A linear row a theta + b >= 0 that follows from a row of the record on a part.

    What it exceeds w0 + W |theta| - s (Y + R theta) by is concave in each parameter, so that its
    least value over the part is at ends. Towards an infinite end it must not fall.
    """
    output, k, sign, slope = items(row, "box")
    centre, radius = rows.row(output, k)
    a = [Fraction(finite(v, "box")) for v in items(slope, "box")]
    if len(a) != len(centre) or sign not in (1, -1):
        raise Malformed("box: a row of another length")
    least: Any = a[-1] - radius[-1] + sign * centre[-1]
    for j in range(rows.count):
        rest = a[j] + sign * centre[j]
        values = []
        for end in (part[0][j], part[1][j]):
            if end in (INF, -INF):
                falls = (rest if end > 0 else -rest) < radius[j]
                values.append(-INF if falls else ZERO)
            else:
                values.append(rest * end - radius[j] * abs(end))
        least = -INF if -INF in values or least == -INF else least + min(values)
    if not least >= 0:
        raise NotProved("a linear row does not follow from the record")
    return a


def combined(
    rows: list[list[Any]],
    pairs: list[Any],
    goal: tuple[int, int] | None,
    equal: set[int] | None = None,
) -> Any:
    """What multipliers of rows a x + b >= 0 prove of x_v (goal v, 0) or -x_v (goal v, 1).

    Without a goal they prove that nothing satisfies the rows, and the bound is INF.
    """
    total = [ZERO] * len(rows[0])
    for pair in pairs:
        place, value = (
            whole(items(pair, "multipliers")[0], "multipliers"),
            rational(pair[1], "multipliers"),
        )
        if not 0 <= place < len(rows) or rows[place][-1] in (INF, -INF):
            raise Malformed("multipliers: of a row that does not exist")
        if value < 0 and place not in (equal or ()):
            raise NotProved("a multiplier of an inequality is negative")
        total = [a + value * b if b else a for a, b in zip(total, rows[place], strict=True)]
    wanted = [ZERO] * (len(total) - 1)
    if goal is not None:
        wanted[goal[0]] = Fraction(1 - 2 * goal[1])
    if total[:-1] != wanted or (goal is None and not total[-1] < 0):
        raise NotProved("the multipliers of a linear program do not add up")
    return INF if goal is None else -total[-1]
