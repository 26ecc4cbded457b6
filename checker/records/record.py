"""Identifications: the rows are those of the record, and the intervals follow from the proofs."""

from __future__ import annotations

from fractions import Fraction
from types import SimpleNamespace
from typing import Any

from ..arithmetic import interval as iv
from ..arithmetic.interval import Interval
from ..arithmetic.polynomial import INF, Terms, add_terms
from ..certificates.certificate import Certificates
from ..certificates.point import ProvedPoint, at_point, falls, infeasible
from ..files.reading import (
    Constraint,
    Malformed,
    alike,
    below,
    each,
    fields,
    item,
    perhaps,
    problem,
    times,
    together,
)
from ..result import NotProved, shown
from .box import Ends, move, nothing
from .driven import bounded_by
from .fewer_priors import bounded_with_fewer
from .linear_rows import MULTIPLIERS, bound_rows, combined
from .parameter_box import proved_box
from .stability import in_disc
from .structure import ZERO, Record, Structure

LIFTED = "lifted"  # the group of unknowns that stand for polynomials in the parameters
GROUPS = {"eta": "output", "xi": "input", "e": "equation"}


def interval_of(found: Any, n: int, place: str) -> Any:
    """Read what is claimed of a parameter."""
    pair = together("F", "F")
    return fields(found, place, n, name="t", outer=pair, inner=perhaps(pair))


def linear_of(found: Any, n: int, place: str) -> Any:
    """Read the solution of a linear program."""
    kinds = {"status": "t", "multipliers": MULTIPLIERS, "vertex": "q*?", "ray": "q*?"}
    return fields(found, place, n, **kinds)


KINDS = {
    "parameters": "t*",
    "variables": each(together("t", "i", "i")),
    "units": "u*",
    "rows": each(perhaps(together("t", "i"))),
    "given": together("F*", "F*"),
    "linear": each(linear_of),
    "assumptions": "t*",
    "ends": "l",
    "intervals": each(interval_of),
}


class Identification:
    """An identification as a file states it, with what was found of it on the way."""

    def __init__(self, found: Any, where: str = "identification") -> None:
        self.got, self.where = fields(found, where, 0, **KINDS), where
        self.record = Record(found)
        self.problem = problem(item(found, "problem", where), f"{where}.problem")
        self.names, self.units, self.given = self.got.parameters, self.got.units, self.got.given
        self.box = item(found, "box", where)
        self._check_sizes()
        self._number()
        self.structure = self._stated(item(found, "structure", where))
        self.driven = _inside(found, where, "driven", ("driven", "fewer_priors"))
        self.fewer = _inside(found, where, "fewer_priors", ("fewer_priors",))
        self.taken: list[str] = []  # what is not checked
        self.weak: list[str] = []  # certificates that prove less than they claim
        self.endless: set[tuple[int, int]] = set()  # parameters and sides of rays
        self.stated: list[str] = []  # rows that are part of the question
        self.stable: set[int] = set()  # outputs whose poles are said to lie in the closed unit disc
        self.chosen: set[int] = set()  # parameters in no row, whose values a file may choose
        self.silent: set[int] = set()  # all parameters in no row
        self.whole = True  # whether every feasible point of the problem explains the record
        self.rounded = False  # whether rows of equation errors are rounded outwards
        self.loose = False  # whether they allow more than that
        self.left_out = 0  # equations without a row, as a sample is missing
        self.empty = False  # whether no parameters explain the record
        self.ranges: dict[tuple[str, int, int], Interval] = {}  # of missing samples
        self.asked: set[Any] = set()  # rows that are part of the question, in units of the record

    def _check_sizes(self) -> None:
        """Refuse lists that are not one for each unknown, parameter or constraint."""
        got, n, p = self.got, self.problem.dimension, len(self.names)
        sizes = {"units": n, "variables": n, "rows": len(self.problem.constraints)}
        for name, size in sizes.items():
            if len(getattr(got, name)) != size:
                count = len(getattr(got, name))
                raise Malformed(f"{self.where}.{name}: {count} entries, not {size}")
        if len(set(self.names)) < p:
            raise Malformed(f"{self.where}.parameters: a name twice")
        for side, (ends, other) in enumerate(zip(self.given, (INF, -INF), strict=True)):
            if len(ends) != p or other in ends:
                place = f"{self.where}.given[{side}]"
                raise Malformed(f"{place}: not an end for each parameter, on its side")
        for name in ("ends", "linear"):
            if len(getattr(got, name)) > 2 * p:
                raise Malformed(f"{self.where}.{name}: more than two for each parameter")

    def _number(self) -> None:
        """Number the unknowns: parameters first, then samples."""
        self.labels: list[str] = []
        self.keys: list[tuple[str, int, int]] = []  # group, channel and sample
        for k, (group, channel, place) in enumerate(self.got.variables):
            key, first, at = (group, channel, place), k < len(self.names), self.where
            if (group == "theta") != first or (first and place != k) or key in self.record.letters:
                why = "parameters come first, and each unknown stands once"
                raise Malformed(f"{at}.variables[{k}]: {why}")
            if group in GROUPS or group in ("y", "u"):  # y and u from 1, samples from 0
                tables = {"y": self.record.y, "u": self.record.u} | {
                    name: self.record.bounds[kind] for name, kind in GROUPS.items()
                }
                below([channel - 1], len(tables[group]), f"{at}.variables[{k}]: channel")
                below([place], self.record.samples, f"{at}.variables[{k}]: sample")
            self.record.letters[key] = k + 1
            self.keys.append(key)
            label = f"{group}{channel or ''}[{place + 1}]"
            self.labels.append(self.names[k] if first else label)
        if len(set(self.labels)) < len(self.labels):
            raise Malformed(f"{self.where}.variables: two unknowns of one name")

    def _stated(self, stated: Any) -> Structure | None:
        """The structure, if it is one whose rows are built here."""
        place = f"{self.where}.structure"
        self.told = fields(stated, place, 0, **{"is": "t"}).__dict__["is"]
        if self.told != "TransferFunction":
            self.told = fields(stated, place, 0, text="t").text
            return None
        channels = len(self.record.u), len(self.record.y)
        found = Structure(stated, *channels, len(self.names), place)
        if found.parameters != self.names:
            raise Malformed(f"{self.where}.parameters: not those of the structure")
        return found

    # ---- rows -----------------------------------------------------------------------------

    def check_rows(self) -> None:
        """Check that every row follows from the record, the structure and the noise."""
        if self.structure is None:
            self.taken.append(f"the rows, which are said to be those of {self.told}")
            self._check_noise()
            return
        self.sides: dict[tuple[str, int], set[bool]] = {}  # signs with which rows are there
        pairs = list(zip(self.got.rows, self.problem.constraints, strict=True))
        self._define(pairs)
        for place, (origin, c) in enumerate(pairs):
            if origin is None or origin[0] == LIFTED:
                continue
            name, k = origin
            if not 0 <= k < self.record.samples:
                raise Malformed(f"{self.where}.rows[{place}]: no such sample")
            why = self._differs(name, k, c)
            if why:
                row = f"{self.where}.rows[{place}], {name} at sample {k + 1}"
                raise NotProved(f"{row}: {why}")
        given = [c for origin, c in pairs if origin is None]
        if any(v in self.lifted for c in given for word in c.polynomial.terms for v in word):
            why = "a row that is given speaks of an unknown that another one defines"
            raise NotProved(f"{self.where}.rows: {why}")
        self.stated = [f"given: {self._shown(c)}" for c in given]
        self.asked = {self._named(c) for c in given}
        both = all(len(self.sides.get(row, ())) == 2 for row in self._wanted())
        self.whole = both and not self.loose
        for v in range(len(self.names), self.problem.dimension):
            self._check_bounds(v)

    def _define(self, pairs: list[tuple[Any, Constraint]]) -> None:
        """Collect unknowns that rows define as polynomials in the parameters, by their letters.

        They have no bounds (see _check_bounds): these rows leave all parameters as they are.
        """
        self.lifted: dict[int, Terms] = {}
        for place, (origin, c) in enumerate(pairs):
            if origin is None or origin[0] != LIFTED:
                continue
            letter = self.record.letters.get((LIFTED, 0, origin[1]), 0)
            stated = self._in_parameters(self.unscaled(c))
            own = stated.pop((letter,), ZERO)
            others = any(v > len(self.names) for word in stated for v in word)
            if not own or others or not c.equality or c.side:
                why = "the row does not define an unknown by the parameters"
                raise NotProved(f"{self.where}.rows[{place}]: {why}")
            self.lifted[letter] = {word: -value / own for word, value in stated.items()}

    def _in_parameters(self, stated: Terms) -> Terms:
        """Replace unknowns that are defined by what defines them."""
        found: Terms = {}
        for word, value in stated.items():
            products = {tuple(v for v in word if v not in self.lifted): value}
            for v in (v for v in word if v in self.lifted):
                shorter, products = products, {}
                for factor, coefficient in self.lifted[v].items():
                    add_terms(products, shorter, factor, coefficient)
            add_terms(found, products)
        return {word: value for word, value in found.items() if value or not word}

    def unscaled(self, c: Constraint) -> Terms:
        """Write the polynomial of a row in the units of the record, times some number."""
        found = c.polynomial.coefficients()
        for word in found:
            for v in word:
                found[word] /= self.units[v - 1]
        return found

    def _named(self, c: Constraint) -> tuple[str, frozenset[Any]]:
        """A row in names of unknowns, up to a positive factor."""
        terms = {
            tuple(sorted(self.labels[v - 1] for v in word)): value
            for word, value in self.unscaled(c).items()
            if value
        }
        size = sum(map(abs, terms.values())) or Fraction(1)
        return c.kind, frozenset((word, value / size) for word, value in terms.items())

    def every_row(self) -> set[Any]:
        """All rows in names of unknowns, for structures whose rows are not built here."""
        return {self._named(c) for c in self.problem.constraints}

    def _shown(self, c: Constraint) -> str:
        """A row of a prior or a set of noise, in the units of the record."""
        if c.side:
            raise Malformed(f"{self.where}.problem: a prior that is a matrix")
        parts = []
        for word, value in sorted(self.unscaled(c).items(), key=lambda t: (len(t[0]), t[0])):
            names = [self.labels[v - 1] for v in word]
            parts += ["*".join([shown(value), *names])] if value else []
        return f"{' + '.join(parts) or '0'} {'==' if c.equality else '>='} 0"

    def _wanted(self) -> list[tuple[str, int]]:
        """All equations and samples that a row is possible for; count those with missing samples.

        What is attained need not satisfy an equation that has no row.
        """
        assert self.structure is not None
        zero, found = self.structure.zero, list[tuple[str, int]]()
        for name in self.structure.equations:
            terms = self.structure.equation(name)
            inside = [k for k in range(self.record.samples) if self.record.within(terms, k, zero)]
            possible = [(name, k) for k in inside if self.record.possible(terms, k)]
            self.left_out += len(inside) - len(possible)
            found += possible
        return found

    def _row(self, name: str, k: int) -> tuple[Terms, Fraction]:
        """The polynomial of an equation at a sample, and how large it may be in size."""
        assert self.structure is not None
        places = {parameter: v for v, parameter in enumerate(self.names)}
        row = self.record.row(self.structure.equation(name), places, k, self.structure.zero)
        if name[0] != "y":
            return row, ZERO
        channel = int(name[1:])
        letter = self.record.letters.get(("e", channel, k), 0)
        if letter:
            row[(letter,)] = Fraction(-1)
        width: Fraction = self.record.bounds["equation"][channel - 1][k]
        if width and self.structure.splits(channel - 1):
            raise NotProved("a sum of partial outputs has no equation error")
        return row, ZERO if letter else width

    def _differs(self, name: str, k: int, c: Constraint) -> str:
        """Tell why a constraint in units is not what the row says; empty where it is."""
        row, width = self._row(name, k)
        stated = self._in_parameters(self.unscaled(c))
        own, constant = row.pop((), ZERO), stated.pop((), ZERO)
        wanted = {word: value for word, value in row.items() if value}
        if set(stated) != set(wanted) or c.side:
            return "other unknowns than in the record"
        if not wanted:  # a row of numbers alone, as in a record at rest
            false = abs(own) > width
            self.sides.setdefault((name, k), set()).update(() if false else (False, True))
            fine = constant == 0 or (constant > 0 and not c.equality)
            return "" if fine or false else "another constant"
        ratios = {value / wanted[word] for word, value in stated.items()}
        if len(ratios) > 1:
            return "other coefficients than in the record"
        (factor,) = ratios
        self.sides.setdefault((name, k), set()).update(
            (False, True) if c.equality else {factor > 0}
        )
        own *= factor
        if c.equality:
            good = not width and constant == own
            return "" if good else "another constant, or an equation error is left out"
        slack = constant - own - width * abs(factor)
        self.rounded |= slack > 0
        self.loose |= slack > abs(constant) / 2**52
        return "" if slack >= 0 and width else "tighter than the bound of the equation error"

    def _check_noise(self) -> None:
        """Check that unknowns of noise are bounded no more than is stated."""
        for v in range(len(self.names), self.problem.dimension):
            if self.keys[v][0] in GROUPS:
                self._check_bounds(v)

    def bounds(self, v: int) -> tuple[Any, Any]:
        """Convert the bounds of an unknown to units of the record."""
        low, high = (times(e[v], self.units[v]) for e in (self.problem.lower, self.problem.upper))
        return low, high

    def _check_bounds(self, v: int) -> None:
        """The bounds of an unknown sample are no tighter than what is known of it."""
        group, channel, k = self.keys[v]
        low, high = self.bounds(v)
        known: tuple[Any, Any] = (-INF, INF)
        if group == "slack":
            known = (low, high)  # part of a prior, whose rows are taken as given
        elif group in GROUPS:
            size = self.record.bounds[GROUPS[group]][channel - 1][k]
            known = (-size, size)
        elif group in ("y", "u"):
            known = iv.exactly(self._known(group, channel, k))
        if low > known[0] or high < known[1]:
            place = f"{self.where}.problem.lower, upper"
            raise NotProved(f"{place}: those of {group}{channel}[{k + 1}] do not follow")
        if group in ("y", "u"):  # what an equation implies holds with its row
            known = self.record.range(group, channel - 1) or (low, high)
            self.whole &= low >= known[0] and high <= known[1]
        self.whole &= group in ("y", "u") or (low, high) == known

    def _known(self, letter: str, channel: int, k: int) -> Interval:
        """The range of a missing sample: what is given, and of an output what is implied."""
        if (letter, channel, k) not in self.ranges:
            given = iv.around(*(self.record.range(letter, channel - 1) or (-INF, INF)))
            implied = self._implied(channel, k) if letter == "y" else iv.WHOLE
            self.ranges[letter, channel, k] = iv.met(given, implied)
        return self.ranges[letter, channel, k]

    def _implied(self, channel: int, k: int) -> Interval:
        """The range of an output by its own equation, over the given ranges of parameters."""
        if self.structure is None or self.structure.splits(channel - 1):
            return iv.WHOLE
        terms, first = self.structure.equation(f"y{channel}"), self.record.first(k)
        if not self.structure.zero and k - max(term.lag for term in terms) < first:
            return iv.WHOLE
        error = self.record.bounds["equation"][channel - 1][k]
        found = iv.around(-error, error)
        for term in terms[1:]:
            if term.signal and k - term.lag < first:
                continue  # at rest before the record
            part = iv.scaled(-term.sign, 0)
            for v in map(self.names.index, term.parameters):
                part = iv.times(part, iv.around(self.given[0][v], self.given[1][v]))
            if term.signal:
                part = iv.times(part, self._sample(term.signal, k - term.lag))
            found = iv.plus(found, part)
        return found

    def _sample(self, signal: str, k: int) -> Interval:
        """The range of a sample of a measured signal: its reading with noise, or as missing."""
        letter, channel = signal[0], int(signal[1:])
        value = (self.record.y if letter == "y" else self.record.u)[channel - 1][k]
        if value is None:
            return self._known(letter, channel, k)
        size = self.record.bounds["output" if letter == "y" else "input"][channel - 1][k]
        return iv.around(value - size, value + size)

    # ---- intervals ------------------------------------------------------------------------

    def check(self) -> list[str]:
        """List what is proved, a line an interval, after what it rests on."""
        self.check_rows()
        box, why = proved_box(self)
        self.taken += why
        if self.driven is not None:
            box = bounded_by(self.driven, self, box)
        if self.fewer is not None:
            box = bounded_with_fewer(self.fewer, self, box)
        empty = nothing(box)
        self.silent = self._silent()
        for v in range(len(self.names)):
            low, high = self.bounds(v)
            least, most = max(box[0][v], self.given[0][v]), min(box[1][v], self.given[1][v])
            if not empty and not (low <= least and most <= high):
                if v not in self.silent:
                    what = f"the problem leaves out values of {self.names[v]} that may be"
                    raise NotProved(f"{self.where}.problem.lower, upper: {what}")
                self.chosen.add(v)
            self.whole &= low >= self.given[0][v] and high <= self.given[1][v]
        points = self._ends(box) + self._linear(box)
        self.empty = empty = empty or nothing(box)
        lines = self._asked()
        if len(self.got.intervals) != len(self.names):
            raise Malformed(f"{self.where}.intervals: not one for each parameter")
        for v, stated in enumerate(self.got.intervals):
            lines += self._interval(v, stated, box, points, empty)
        return [*lines, "proved: no parameters explain the record"] if empty else lines

    def _silent(self) -> set[int]:
        """Find the parameters that no row speaks of."""
        used = {v for c in self.problem.constraints for w in c.words() for v in w}
        return {v for v in range(len(self.names)) if v + 1 not in used}

    def _move(self, box: Ends, v: int, side: int, least: Any) -> None:
        """Shrink the box by what the problem proves of a parameter.

        Where no row speaks of it and the problem leaves out values, that is no more than whether
        anything is feasible.
        """
        if v not in self.chosen or least == INF:
            move(box, v, side, least)

    def _ends(self, box: Ends) -> list[Any]:
        """Shrink the box by the certificates of its ends; the attained points."""
        points = []
        for place, end in enumerate(self.got.ends):
            v, side = divmod(place, 2)
            about = self.problem.about(v, 1 - 2 * side)
            at = f"{self.where}.ends[{place}]"
            given = item(end, "certificate", at)
            if given is not None:
                certificates = Certificates(given, about, f"{at}.certificate")
                least, why = certificates.prove()
                if least < certificates.claim:
                    self.weak += [f"{at}.certificate: {'; '.join(dict.fromkeys(why))}"]
                least = min(certificates.claim, least)
                self._move(box, v, side, times(least, self.units[v]))
            if item(end, "attained", at) is not None:
                point = ProvedPoint(end["attained"], about, f"{at}.attained")
                if reason := point.fails():
                    raise NotProved(f"{at}.attained, a point of {self.names[v]}: {reason}")
                points.append(point)
        return points

    def _linear(self, box: Ends) -> list[Any]:
        """Shrink the box by exact linear programs over the rows; the vertices they attain."""
        n, points, rows = self.problem.dimension, [], []
        for c in self.problem.constraints if self.got.linear else ():
            if (row := c.polynomial.linear(n)) is None:
                raise Malformed(f"{self.where}.linear: of a row that is not linear")
            rows.append(row)
        equal = {k for k, c in enumerate(self.problem.constraints) if c.equality}
        rows += bound_rows(self.problem.lower, self.problem.upper)
        for place, got in enumerate(self.got.linear):
            (v, side), at = divmod(place, 2), got.where
            if got.status != "UNBOUNDED":
                goal = None if got.status == "INFEASIBLE" else (v, side)
                self._move(box, v, side, combined(rows, got.multipliers, goal, at, equal))
            if got.vertex is not None:
                alike(f"{at}.vertex", got.vertex, range(n))
                if reason := infeasible(self.problem, *at_point(got.vertex)):
                    raise NotProved(f"{at}.vertex: it is not feasible ({reason})")
                points.append(SimpleNamespace(x=got.vertex, radius=ZERO))
            if got.ray is not None:
                self._follow(got, v, side, at)
        return points

    def _follow(self, got: Any, v: int, side: int, place: str) -> None:
        """Check a ray from a vertex, along which a parameter passes every number."""
        alike(f"{place}.ray", got.ray, range(self.problem.dimension))
        about = self.problem.about(v, 1 - 2 * side)
        if got.vertex is None or not falls(about, got.vertex, got.ray):
            raise NotProved(f"{place}.ray: {self.names[v]} does not pass every number along it")
        self.endless.add((v, side))

    def _asked(self) -> list[str]:
        """List what the intervals rest on, for people."""
        record, lines = self.record, [f"structure: {self.told} of {', '.join(self.names)}"]
        if self.structure is not None:
            lines[0] += f" ({', '.join(f'{k} {v}' for k, v in self.structure.shown.items())})"
        lines.append(f"record: {record.samples} samples, {len(record.starts)} records")
        for name, table in record.bounds.items():
            for channel, column in enumerate(table, 1):
                if any(column):
                    ends = shown(min(column)), shown(max(column))
                    lines.append(f"noise: |{name} {channel}| <= {' .. '.join(dict.fromkeys(ends))}")
        for name, low, high in zip(self.names, *self.given, strict=True):
            if (low, high) != (-INF, INF):
                lines.append(f"given: {name} in [{shown(low)}, {shown(high)}]")
        lines += self._others_given() + self.stated
        for output in sorted(self.stable):
            lines.append(f"given: the poles of output {output} lie in the closed unit disc")
        lines += [f"assumed: {line}" for line in self.got.assumptions]
        lines += self._of_rows()
        return lines + [f"taken as given: {what}" for what in self.taken]

    def _of_rows(self) -> list[str]:
        """List where rows say less than the record does, for people."""
        lines = []
        if self.left_out:
            count = f"{self.left_out} equation{'s' * (self.left_out > 1)} with missing samples"
            lines.append(f"left out: {count}, which ends that are attained need not satisfy")
        if self.loose:
            lines.append("rows of equation errors allow more than the noise: no end is attained")
        elif self.rounded:
            lines.append("rows of equation errors are rounded outwards, by less than a last bit")
        return lines

    def _others_given(self) -> list[str]:
        """Bounds that a file gives of unknown samples, and of unknowns that priors bring."""
        groups = ("slack",) if self.structure is not None else ("y", "u", "slack")
        found = self.record.given_ranges() | self.bounds_of(*groups)
        return [f"given: {name} in [{shown(a)}, {shown(b)}]" for name, (a, b) in found.items()]

    def bounds_of(self, *groups: str) -> dict[str, tuple[Any, Any]]:
        """Bounds of the unknowns of some groups, in units of the record, where there are any."""
        found = {}
        for v, (group, _, _) in enumerate(self.keys):
            low, high = self.bounds(v)
            if group in groups and (low, high) != (-INF, INF):
                found[self.labels[v]] = low, high
        return found

    def _is_stable(self, point: Any) -> bool:
        """Check that the poles of an attained point are as they are said to be."""
        if not self.stable:
            return True
        triples = zip(self.names, point.x, self.units, strict=False)
        ends = {
            name: iv.around((x - point.radius) * unit, (x + point.radius) * unit)
            for name, x, unit in triples
        }
        return all(
            in_disc([ends[name] for name in names])
            for output in self.stable
            for names in self.structure.denominators(output - 1)
        )

    def _interval(
        self, v: int, stated: Any, box: Ends, points: list[Any], empty: bool
    ) -> list[str]:
        """Write what is proved of one parameter."""
        name, (low, high) = self.names[v], stated.outer
        if stated.name != name:
            raise Malformed(f"{stated.where}.name: not in the order of the parameters")
        if low > high and not empty:
            raise NotProved(f"{stated.where}.outer: parameters may be consistent{self._why()}")
        if empty:
            return []
        if low > box[0][v] or high < box[1][v]:
            best = f"[{shown(box[0][v])}, {shown(box[1][v])}]"
            claim = f"{name} in [{shown(low)}, {shown(high)}]: only {best} is proved"
            raise NotProved(f"{stated.where}.outer: {claim}{self._why()}")
        line = f"proved: {name} in [{shown(low)}, {shown(high)}]"
        return [line] if stated.inner is None else self._attained(v, stated, points, line)

    def _why(self) -> str:
        """Say which certificates prove less than they claim."""
        return f" ({'; '.join(self.weak)})" if self.weak else ""

    def _attained(self, v: int, stated: Any, points: list[Any], line: str) -> list[str]:
        """Write what is attained of one parameter; raise where the file says more."""
        (a, b), place = stated.inner, f"{stated.where}.inner"
        open_ends = [a == -INF == stated.outer[0], b == INF == stated.outer[1]]
        open_ends = [is_ and (v, k) not in self.endless for k, is_ in enumerate(open_ends)]
        if all(open_ends):
            return [line, self._unbounded(v)]
        if not points or not self.whole:
            raise NotProved(f"{place}: no point is shown to explain the record")
        if not all(self._is_stable(point) for point in points):
            raise NotProved(f"{place}: it is not shown that the poles are as given")
        least, most = self._reach(v, points)
        least = -INF if (v, 0) in self.endless else least
        most = INF if (v, 1) in self.endless else most
        if (a < least and not open_ends[0]) or (b > most and not open_ends[1]):
            best = f"[{shown(least)}, {shown(most)}]"
            claim = f"attained from {shown(a)} to {shown(b)}"
            raise NotProved(f"{place}: {claim}, but only {best} is")
        line = f"{line}, attained from {shown(a)} to {shown(b)}"
        return [line, self._unbounded(v)] if any(open_ends) else [line]

    def _reach(self, v: int, points: list[Any]) -> tuple[Any, Any]:
        """Find least and largest value of a parameter that points attain.

        Where no row and no test of poles speaks of it, a point stays one with each value given.
        """
        poles = (self.structure.denominators(output - 1) for output in self.stable)
        tested = {name for names in poles for part in names for name in part}
        if v in self.silent and self.names[v] not in tested:
            return self.given[0][v], self.given[1][v]
        if self.problem.lower[v] == self.problem.upper[v]:
            return (self.problem.lower[v] * self.units[v],) * 2
        least = min(p.x[v] + p.radius for p in points) * self.units[v]
        return least, max(p.x[v] - p.radius for p in points) * self.units[v]

    def _unbounded(self, v: int) -> str:
        """Say what files hold no proof of."""
        return f"taken as given: that the record does not bound {self.names[v]}"


def _inside(found: Any, where: str, field: str, without: tuple[str, ...]) -> Identification | None:
    """Read an identification of the same record inside of another one; None where there is none."""
    given, place = found.get(field), f"{where}.{field}"
    if given is None:
        return None
    if not isinstance(given, dict):
        raise Malformed(f"{place}: no object")
    if any(given.get(name) is not None for name in without):
        raise Malformed(f"{place}: an identification inside of it")
    shared = {name: item(found, name, where) for name in ("record", "noise")}
    return Identification({**given, **shared}, place)
