"""Problems with ratios: signs of denominators, and the polynomial problem that they make."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import inf, nextafter
from typing import Any

from .arithmetic.polynomial import INF, ONE, Polynomial, total
from .certificates.certificate import Certificates
from .files.reading import (
    Constraint,
    Malformed,
    Problem,
    each,
    fields,
    item,
    polynomial,
    problem,
    together,
)
from .result import NotProved, check_claims, proved_bound

Ratio = tuple[Polynomial, Polynomial]


@dataclass
class Rational:
    """A polynomial and ratios, added."""

    whole: Polynomial
    ratios: list[Ratio]

    @property
    def is_fraction(self) -> bool:
        """True if it is one ratio and nothing beside it."""
        return len(self.ratios) == 1 and not any(self.whole.terms.values())


@dataclass
class Range:
    """The sign of a denominator, and bounds of its size as doubles: 0 < least <= |q| <= most."""

    sign: int
    least: Any
    most: Any

    def reciprocal(self) -> tuple[Any, Any]:
        """Bound 1 / q by doubles outside of 1 / most and 1 / least."""
        low = Fraction(0) if self.most == INF else inverse(self.most, -inf)
        high = INF if self.least == INF else inverse(self.least, inf)
        return (low, high) if self.sign > 0 else (-high, -low)


def inverse(value: float, towards: float) -> Any:
    """Find the double next to 1 / value on one side, infinite beyond all doubles."""
    exact = 1 / Fraction(value)
    try:
        near = float(exact)
    except OverflowError:
        return INF if towards > 0 else Fraction(nextafter(inf, 0))
    short = Fraction(near) < exact if towards > 0 else Fraction(near) > exact
    near = nextafter(near, towards) if short else near
    return INF if near == inf else Fraction(near)


def key(p: Polynomial) -> Any:
    """Make a key that equal polynomials share."""
    return p.coefficient(), tuple(sorted(p.open().items()))


# ---- reading ---------------------------------------------------------------------------------


def ratio(found: Any, n: int, place: str) -> Ratio:
    """Read a numerator and a denominator."""
    above, under = together(polynomial, polynomial)(found, n, place)
    return above, under


def rational(found: Any, n: int, place: str) -> Rational:
    """Read a sum of ratios; denominators have variables and differ."""
    got = fields(found, place, n, whole=polynomial, ratios=each(ratio))
    below = [q for _, q in got.ratios]
    if any(not q.open() for q in below) or len({key(q) for q in below}) < len(below):
        raise Malformed(f"{place}: a denominator that is constant, or occurs twice")
    return Rational(got.whole, got.ratios)


def row(found: Any, n: int, place: str) -> tuple[str, Rational]:
    """Read a constraint of a sum of ratios."""
    got = fields(found, place, n, expression=rational, kind="t")
    if got.kind not in ("NONNEGATIVE", "ZERO"):
        raise Malformed(f"{place}: kind {got.kind!r:.20}")
    return got.kind, got.expression


class RationalProblem:
    """Minimise a sum of ratios subject to polynomial constraints, bounds and such sums."""

    def __init__(self, found: Any, place: str = "rational_problem") -> None:
        aim = item(item(found, "objective", place), "whole", place)
        n = fields(aim, place, 0, dimension="i").dimension
        kinds = {"objective": rational, "rational_constraints": each(row), "sense": "t"}
        got = fields(found, place, n, **kinds)
        nothing = {"type": "i4", "shape": [0, 1], "data": []}
        zero = {"words": nothing, "coefficients": {"type": "f8", "shape": [0], "data": []}}
        base = {name: item(found, name, place) for name in ("constraints", "lower", "upper")}
        base |= {"names": item(found, "names", place), "sense": got.sense, "squares": []}
        base["objective"] = zero | {"dimension": n}
        self.base, self.objective = problem(base, place), got.objective
        self.rows: list[tuple[str, Rational]] = got.rational_constraints
        everything = [self.objective, *(expression for _, expression in self.rows)]
        self.denominators = list({key(q): q for f in everything for _, q in f.ratios}.values())
        self._places = {key(q): k for k, q in enumerate(self.denominators)}

    def place(self, q: Polynomial) -> int:
        """Find which of the denominators it is."""
        return self._places[key(q)]

    @property
    def constant(self) -> Fraction:
        """Constant that an objective with a level has beside its ratio."""
        return self.objective.whole.coefficient()

    def fits(self, level: Any) -> bool:
        """Check whether the objective compares with a level: one ratio beside a constant."""
        one = len(self.objective.ratios) == 1 and not self.objective.whole.open()
        return level is None or one

    def lifted(self, ranges: list[Range], level: float | None) -> Problem:
        """Lift to the polynomial problem in x, reciprocals of denominators, and the level."""
        several = [f for _, f in self.rows if not f.is_fraction]
        several += [self.objective] if level is None else []
        places = sorted({self.place(q) for f in several for _, q in f.ratios})
        n = self.base.dimension
        letters = {k: Polynomial({(n + 1 + j,): 1}) for j, k in enumerate(places)}

        def linear(f: Rational) -> Polynomial:
            return total([f.whole, *(p.times(letters[self.place(q)]) for p, q in f.ratios)])

        rows = list(self.base.constraints)
        for k in places:
            rows.append(Constraint("ZERO", self.denominators[k].times(letters[k]).minus(ONE)))
        for kind, f in self.rows:
            if f.is_fraction:
                ((p, q),) = f.ratios
                rows.append(Constraint(kind, p.signed(ranges[self.place(q)].sign)))
            else:
                rows.append(Constraint(kind, linear(f)))
        ends = [ranges[k].reciprocal() for k in places]
        if level is None:
            objective = linear(self.objective)
        else:
            ((p, q),) = self.objective.ratios
            last = Polynomial({(n + len(places) + 1,): 1})
            objective = p.minus(q.times(last)).signed(ranges[self.place(q)].sign)
            ends.append((Fraction(level), Fraction(level)))
        lower = [*self.base.lower, *(low for low, _ in ends)]
        upper = [*self.base.upper, *(high for _, high in ends)]
        names = [*self.base.names, *(f"new{k}" for k in range(len(ends)))]
        return Problem(len(names), objective, rows, lower, upper, names)


# ---- what is proved --------------------------------------------------------------------------


class RationalCertificate:
    """Signs of all denominators, and a certificate of the polynomial problem."""

    def __init__(self, found: Any, about: RationalProblem, place: str) -> None:
        got = fields(found, place, 0, fingerprint="t", bound="F", ranges="l", level="f?")
        self.about, self.claim, self.level, self.place = about, got.bound, got.level, place
        self.found = item(found, "certificate", place)
        if len(got.ranges) != len(about.denominators) or not about.fits(self.level):
            raise NotProved(
                "a sign for each denominator, or an objective for the level, is missing"
            )
        self.ranges = [
            self.range_of(one, q, f"{place}.ranges[{k}]")
            for k, (one, q) in enumerate(zip(got.ranges, about.denominators, strict=True))
        ]
        self.empty = any(size.least == INF for size in self.ranges)
        self.problem = None if self.empty else about.lifted(self.ranges, self.level)

    def range_of(self, found: Any, q: Polynomial, place: str) -> Range:
        """Prove the sign of a denominator and bound its size; raise without a sign."""
        sign = fields(found, place, 0, sign="i").sign
        if sign not in (1, -1):
            raise Malformed(f"{place}.sign: {sign}")
        least = self.claimed(item(found, "below", place), q.signed(sign), f"{place}.below")
        if not least > 0:
            raise NotProved(f"{place}: the sign of the denominator is not proved")
        above, most = item(found, "above", place), INF
        if above is not None:
            most = -self.claimed(above, q.signed(-sign), f"{place}.above")
        return Range(sign, least, max(least, most))

    def claimed(self, found: Any, objective: Polynomial, place: str) -> Any:
        """Verify a certificate's claim about the base, -INF where it is not proved."""
        proof = Certificates(found, self.about.base.minimising(objective), place)
        return proof.claim if proof.prove()[0] >= proof.claim else -INF

    def prove(self) -> tuple[Any, list[str]]:
        """Prove the bound of the objective; say what makes it weak."""
        if self.empty:
            return INF, []
        if self.found is None or self.problem is None:
            return -INF, ["there is no certificate"]
        proof = Certificates(self.found, self.problem, f"{self.place}.certificate")
        least, why = proof.prove()
        return (self.translated(least, 1) if least >= proof.claim else -INF), why

    def translated(self, value: Any, side: int) -> Any:
        """Translate the polynomial objective's bound to the ratio's: below (1), above (-1)."""
        if self.level is None or value in (INF, -INF):
            return value
        ((_, q),) = self.about.objective.ratios
        size = self.ranges[self.about.place(q)]
        part = Fraction(0)
        if side * value < 0:
            part = Fraction(value) / Fraction(size.least)
        elif size.most != INF:
            part = Fraction(value) / Fraction(size.most)
        return self.about.constant + Fraction(self.level) + part


def check_rational_certificate(about: RationalProblem, found: Any) -> list[str]:
    """Check the claim of a certificate of a problem with ratios."""
    proof = RationalCertificate(found, about, "rational_certificate")
    return [proved_bound(proof, proof.claim)]


def check_rational_result(found: Any, given: RationalProblem | None = None) -> list[str]:
    """Check the claims of a result about ratios, of its own or a given problem."""
    place = "rational_result"
    about = RationalProblem(item(found, "problem", place), f"{place}.problem")
    about = about if given is None else given
    proof = RationalCertificate(item(found, "certificate", place), about, f"{place}.certificate")
    value_of = None if proof.level is None else lambda value: proof.translated(value, -1)
    return check_claims(found, place, proof, proof.problem, value_of)
