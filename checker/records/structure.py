"""Rows of a transfer function on a record, built from its numbers: exactly, in rationals.

With the noise-free samples y = y~ - eta and u = u~ - xi, output i of a structure with the
denominators A_j and numerators B_j of its inputs has at every sample k the row

    A_1 ... A_q y(k) - sum_j B_j (the other denominators) u_j(k) - c = e(k),

denominators that are equal taken once. In the form "partial" it has instead the rows
A_j z_j(k) - B_j u_j(k) = 0 for each input and y(k) - sum_j z_j(k) - c = 0. The form "multiplied"
eliminates the z_j: c has the factor A_1 ... A_q at q = 1. The form "lifted" has the same rows, in
which unknowns may stand for polynomials in the parameters; so has "driven", with c alone.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any, NamedTuple

from ..arithmetic.polynomial import Terms, add_terms
from ..files.reading import Malformed, fields, item, perhaps, together
from ..result import NotProved

ZERO = Fraction(0)
ELIMINATED = ("multiplied", "lifted")  # forms without partial outputs


class Term(NamedTuple):
    """A number times parameters times a signal some samples ago ("" for none)."""

    sign: int
    parameters: tuple[str, ...]
    signal: str
    lag: int


class Sample(NamedTuple):
    """A noise-free sample, known + sign * unknown; letter 0 where it has no unknown."""

    known: Fraction
    letter: int
    sign: int


class Structure:
    """A transfer function between several inputs and outputs."""

    def __init__(
        self, found: Any, inputs: int, outputs: int, most: int = 10**4, place: str = "structure"
    ) -> None:
        kinds = {"na": "i**", "nb": "i**", "nk": "i**", "initial": "t", "form": "t"}
        flags = {"common_denominator": "b", "offset": "b"}
        got = fields(found, place, 0, **kinds, **flags)
        for name, table in (("na", got.na), ("nb", got.nb), ("nk", got.nk)):
            if len(table) != outputs or any(len(r) != inputs or min(r) < 0 for r in table):
                raise Malformed(f"{place}.{name}: orders that do not fit the channels")
            if name != "nk" and max(map(max, table)) > most:
                raise Malformed(f"{place}.{name}: more coefficients than parameters")
        forms = ("auto", "direct", "partial", "driven", *ELIMINATED)
        if got.common_denominator and len({n for row in got.na for n in row}) > 1:
            raise Malformed(f"{place}: a common denominator of several orders")
        if got.initial not in ("free", "zero") or got.form not in forms:
            raise Malformed(f"{place}: initial or form of an unknown kind")
        if got.form in ELIMINATED and got.offset and got.initial == "zero":
            raise Malformed(f"{place}: an eliminated offset that begins at zero")
        self.given, self.inputs, self.outputs = got, range(inputs), range(outputs)
        self.many, self.zero = inputs * outputs > 1, got.initial == "zero"
        self.shown = {name: getattr(got, name) for name in (*kinds, *flags)}

    def _pair(self, i: int, j: int) -> str:
        return f"[{i + 1},{j + 1}]" if self.many else ""

    def denominator(self, i: int, j: int) -> tuple[str, ...]:
        """Name the coefficients of a denominator, from lag 1 on."""
        pair = "" if self.given.common_denominator else self._pair(i, j)
        return tuple(f"a{pair}{lag}" for lag in range(1, self.given.na[i][j] + 1))

    def denominators(self, i: int) -> list[tuple[str, ...]]:
        """List the distinct denominators of an output other than 1."""
        return [d for d in dict.fromkeys(self.denominator(i, j) for j in self.inputs) if d]

    def numerator(self, i: int, j: int) -> list[tuple[int, str]]:
        """List lags and names of the coefficients of a numerator."""
        first = self.given.nk[i][j]
        return [(k, f"b{self._pair(i, j)}{k}") for k in range(first, first + self.given.nb[i][j])]

    def offset(self, i: int) -> list[Term]:
        """Write the term -c of an output."""
        name = "c" if len(self.outputs) == 1 else f"c[{i + 1}]"
        return [Term(-1, (name,), "", 0)] if self.given.offset else []

    @property
    def parameters(self) -> list[str]:
        """The names of all parameters: denominators, numerators, offsets."""
        pairs = [(i, j) for i in self.outputs for j in self.inputs]
        names = [name for pair in pairs for name in self.denominator(*pair)]
        names += [name for pair in pairs for _, name in self.numerator(*pair)]
        names += [term.parameters[0] for i in self.outputs for term in self.offset(i)]
        return list(dict.fromkeys(names))

    @property
    def equations(self) -> list[str]:
        """The names of all equations."""
        partial = [(i, j) for i in self.outputs for j in self.inputs if self.splits(i)]
        names = [f"z[{i + 1},{j + 1}]" for i, j in partial]
        return names + [f"y{i + 1}" for i in self.outputs]

    def equation(self, name: str) -> list[Term]:
        """Write the terms of an equation, by the signal that it defines."""
        for i in self.outputs:
            if name == f"y{i + 1}":
                return self.direct(i) if not self.splits(i) else self._sum(i)
            for j in self.inputs:
                if name == f"z[{i + 1},{j + 1}]" and self.splits(i):
                    found = [Term(1, (), name, 0)]
                    found += [
                        Term(1, (a,), name, k) for k, a in enumerate(self.denominator(i, j), 1)
                    ]
                    return found + [Term(-1, (b,), f"u{j + 1}", k) for k, b in self.numerator(i, j)]
        raise Malformed(f"rows: the structure has no equation {name!r:.20}")

    def splits(self, i: int) -> bool:
        """Check whether an output is a sum of partial outputs, signals of their own."""
        own = [self.denominator(i, j) for j in self.inputs]
        several = len(set(own)) > 1
        return bool(self.given.form == "partial" or (self.given.form == "auto" and several))

    def adds_offset(self, i: int) -> bool:
        """Check whether an offset is added to an output itself, not to its equation."""
        return self.splits(i) or self.given.form in ELIMINATED

    def _sum(self, i: int) -> list[Term]:
        parts = [Term(-1, (), f"z[{i + 1},{j + 1}]", 0) for j in self.inputs]
        return [Term(1, (), f"y{i + 1}", 0), *parts, *self.offset(i)]

    def direct(self, i: int) -> list[Term]:
        """Write the equation of an output with all denominators multiplied out."""
        own, distinct = [self.denominator(i, j) for j in self.inputs], self.denominators(i)
        found = [Term(1, names, f"y{i + 1}", lag) for lag, names in multiplied(distinct)]
        for j in self.inputs:
            others = multiplied([d for d in distinct if d != own[j]])
            for shift, b in self.numerator(i, j):
                found += [Term(-1, (*names, b), f"u{j + 1}", lag + shift) for lag, names in others]
        added = self.adds_offset(i)
        if added and self.given.offset and self.zero:
            raise NotProved("an offset of an output at rest, with its denominators multiplied out")
        distinct = distinct if added else []
        factors = [names for _, names in multiplied(distinct)]
        return found + [
            term._replace(parameters=(*names, *term.parameters))
            for term in self.offset(i)
            for names in factors
        ]


def multiplied(denominators: list[tuple[str, ...]]) -> list[tuple[int, tuple[str, ...]]]:
    """Multiply polynomials 1 + sum of a_k q^-k to lags and names of parameters."""
    found: list[tuple[int, tuple[str, ...]]] = [(0, ())]
    for names in denominators:
        factors = [(0, ()), *((k, (name,)) for k, name in enumerate(names, 1))]
        found = [(p + q, (*a, *b)) for p, a in found for q, b in factors]
    return found


class Record:
    """Samples, bounds of their noise, and the unknowns that stand for both."""

    def __init__(self, found: Any) -> None:
        kinds = {"u": "e?**", "y": "e?**", "starts": "i*"}  # a missing sample is null
        got = fields(item(found, "record", "file"), "record", 0, **kinds)
        self.u, self.y, self.starts = got.u, got.y, got.starts
        self.samples = len(self.y[0]) if self.y else 0
        groups = "output", "input", "equation"
        noise = fields(item(found, "noise", "file"), "noise", 0, **dict.fromkeys(groups, "e**"))
        self.bounds: dict[str, Any] = {name: getattr(noise, name) for name in groups}
        self._check_sizes()
        ordered = all(a < b for a, b in zip(self.starts, self.starts[1:], strict=False))
        if self.starts[:1] != [0] or not ordered or self.starts[-1] >= self.samples:
            raise Malformed("record.starts: not 0 and then later samples")
        channels = {"u": self.u, "y": self.y}
        pairs = {k: perhaps(together(*[together("e", "e")] * len(channels[k]))) for k in channels}
        ranges = fields(item(found["record"], "ranges", "record"), "record.ranges", 0, **pairs)
        self.ranges: dict[str, Any] = {name: getattr(ranges, name) for name in channels}
        self.letters: dict[tuple[str, int, int], int] = {}

    def _check_sizes(self) -> None:
        """Refuse channels of several lengths, and bounds that are not one for each sample."""
        wanted = {"record.u": self.u, "record.y": self.y}
        wanted |= {f"noise.{name}": table for name, table in self.bounds.items()}
        for place, table in wanted.items():
            channels = self.u if place in ("record.u", "noise.input") else self.y
            if not table or len(table) != len(channels):
                raise Malformed(f"{place}: {len(table)} channels, not one or more as in the record")
            for k, column in enumerate(table):
                if len(column) != self.samples:
                    raise Malformed(f"{place}[{k}]: {len(column)} samples, not {self.samples}")
                if place.startswith("noise") and min(column, default=0) < 0:
                    raise Malformed(f"{place}[{k}]: a negative bound")

    def first(self, k: int) -> int:
        """Find the sample at which the record of sample k begins."""
        return max(start for start in self.starts if start <= k)

    def sample(self, signal: str, k: int) -> Sample:
        """Take a noise-free sample of a signal."""
        if signal[0] == "z":
            return Sample(ZERO, self.letters.get((signal, 0, k), 0), 1)
        output, channel = signal[0] == "y", int(signal[1:]) - 1
        value = (self.y if output else self.u)[channel][k]
        if value is None:
            return Sample(ZERO, self.letters.get((signal[0], channel + 1, k), 0), 1)
        bound = self.bounds["output" if output else "input"][channel][k]
        if not bound:
            return Sample(value, 0, 0)
        group = "eta" if output else "xi"
        return Sample(value, self.letters.get((group, channel + 1, k), 0), -1)

    def ranged(self, signal: str) -> bool:
        """Check whether a range is given for all samples of a measured signal."""
        return self.range(signal[0], int(signal[1:]) - 1) is not None

    def range(self, signal: str, channel: int) -> tuple[Fraction, Fraction] | None:
        """Take the range of all samples of a channel, where one is given."""
        given = self.ranges[signal]
        return None if given is None else tuple(given[channel])

    def given_ranges(self) -> dict[str, tuple[Fraction, Fraction]]:
        """List the ranges of channels with missing samples, by what they are about."""
        found = {}
        for letter, channels in (("u", self.u), ("y", self.y)):
            for number, channel in enumerate(channels, 1):
                ends = self.range(letter, number - 1) if None in channel else None
                if ends is not None:
                    found[f"each missing sample of {letter}{number}"] = ends
        return found

    def row(self, terms: list[Term], parameters: dict[str, int], k: int, zero: bool) -> Terms:
        """Write the polynomial of an equation at sample k, in all unknowns."""
        found: Terms = {}
        for term, sample in self._used(terms, k, zero):
            heads = tuple(parameters[name] + 1 for name in term.parameters)
            add_terms(found, {heads: sample.known}, (), term.sign)
            if sample.letter:
                add_terms(found, {heads: Fraction(sample.sign)}, (sample.letter,), term.sign)
            elif sample.sign:
                signal = f"{term.signal} at sample {k - term.lag + 1}"
                raise Malformed(f"variables: {signal} is not known and has no unknown")
        return found

    def within(self, terms: list[Term], k: int, zero: bool) -> bool:
        """Check whether a row reaches no further back than the record, or begins at rest."""
        return zero or all(k - t.lag >= self.first(k) for t in terms if t.signal)

    def possible(self, terms: list[Term], k: int) -> bool:
        """Check whether no sample of a row is missing without an unknown and a range."""
        for term in terms:
            place = k - term.lag
            if not term.signal or term.signal[0] == "z" or place < self.first(k):
                continue
            sample = self.sample(term.signal, place)
            if sample.sign == 1 and not sample.letter and not self.ranged(term.signal):
                return False
        return True

    def _used(self, terms: list[Term], k: int, zero: bool) -> list[tuple[Term, Sample]]:
        found = []
        for term in terms:
            place = k - term.lag
            if not term.signal:
                found.append((term, Sample(Fraction(1), 0, 0)))
            elif place >= self.first(k):
                found.append((term, self.sample(term.signal, place)))
            elif not zero:
                raise Malformed(f"rows: that of sample {k + 1} reaches before its record")
        return found


def columns_of(record: Record, path: str, names: list[str], table: list[Any]) -> list[str]:
    """Find which column of a table holds which channel; raise where one holds none."""
    found = []
    for letter, channels in (("u", record.u), ("y", record.y)):
        for number, channel in enumerate(channels, 1):
            places = [k for k, column in enumerate(table) if column == channel]
            if not places:
                raise NotProved(
                    f"{path}: no column of {len(table[0])} samples holds the {len(channel)} of "
                    f"{letter}{number}; if it is the record, say how it is written, as --decimal "
                    ", for decimal commas, --header 2 for names and a line of units, and which "
                    "part of it was used, as --rows 0:500"
                )
            name = repr(names[places[0]]) if names else str(places[0])
            found.append(f"{letter}{number} is column {name} of {path}")
    return found
