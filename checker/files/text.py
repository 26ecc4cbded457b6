"""Read problems as people write them: ``min x1*x2; s.t. x1^2 + x2^2 <= 1``, and .gms files.

A number is the double nearest to it, and a quotient of two numbers the double nearest to that.
Everything else is multiplied out exactly, where the package rounds coefficients: a certificate
made for rounded coefficients may fail here by that much. Problems in JSON have no such doubt.
"""

from __future__ import annotations

import re
from fractions import Fraction
from pathlib import Path
from typing import Any, ClassVar

from ..arithmetic.polynomial import INF, Polynomial
from .reading import Constraint, Malformed, Problem

TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
    r"|(?P<name>[A-Za-z_]\w*(?:\[[^\]]*\])?)|(?P<mark>\*\*|[-+*/^()]))",
    re.A,  # a superscript is no letter of a name
)
RELATION = re.compile(r"(>=|<=|==|=[gleGLE]=|=)")
BREAK = re.compile(r";|(?=\bs\.\s*t\.)|(?=\bsubject\s+to\b)", re.I)
SUCH_THAT = re.compile(r"^(s\.\s*t\.|subject\s+to\b|st\b)\s*:?", re.I)
AIM = re.compile(r"^(min|max)(imi[sz]e)?\b\s*:?", re.I)
NO_NAMES = ("inf", "infinity", "nan")
SIDES, ZERO, ONE = ("lo", "up"), Fraction(0), Fraction(1)
ENDS: dict[str, tuple[Any, Any]] = {
    "free": (-INF, INF),
    "positive": (ZERO, INF),
    "negative": (-INF, ZERO),
    "binary": (ZERO, ONE),
}
INFINITE = 10**10  # bounds of this size in .gms files stand for none


class Expression:
    """An expression, read from left to right."""

    def __init__(self, source: str, letters: dict[str, int]) -> None:
        self.letters, self.tokens, at = letters, list[tuple[str, str]](), 0
        source = source.strip()
        while at < len(source):
            match = TOKEN.match(source, at)
            if not match or match.lastgroup is None:
                raise Malformed(f"{source!r:.60}: no expression")
            self.tokens.append((match.lastgroup, match.group(match.lastgroup)))
            at = match.end()
        self.source, self.place = source, 0

    def polynomial(self) -> Polynomial:
        """Read the polynomial of the whole text."""
        found = self.sum()
        if self.place < len(self.tokens):
            raise Malformed(f"{self.source!r:.60}: no end after {self.tokens[self.place][1]!r}")
        return found

    def take(self, *marks: str) -> str:
        """Take the next token if it is one of these marks, else an empty text."""
        if self.place < len(self.tokens) and self.tokens[self.place] in [
            ("mark", m) for m in marks
        ]:
            self.place += 1
            return self.tokens[self.place - 1][1]
        return ""

    def sum(self) -> Polynomial:
        """Read products with + and - between them."""
        found, sign = Polynomial(), -1 if self.take("+", "-") == "-" else 1
        while True:
            found.add(self.product(), sign)
            mark = self.take("+", "-")
            if not mark:
                return found
            sign = -1 if mark == "-" else 1

    def product(self) -> Polynomial:
        """Read powers with * and / between them."""
        found = self.power()
        while mark := self.take("*", "/"):
            other = self.power()
            found = found.times(other) if mark == "*" else self.quotient(found, other)
        return found

    def quotient(self, found: Polynomial, other: Polynomial) -> Polynomial:
        """Divide by a number."""
        below = other.coefficient()
        if other.open() or not below:
            raise Malformed(f"{self.source!r:.60}: a quotient by more than a number")
        if not found.open():
            return Polynomial.of([()], [float(found.coefficient() / below)])
        inverse = float(1 / below)
        if Fraction(inverse) * below != 1:
            raise Malformed(f"{self.source!r:.60}: a quotient by a number other than 2, 4, ...")
        return found.times(Polynomial.of([()], [inverse]))

    def power(self) -> Polynomial:
        """Read a number, a name or a parenthesis, perhaps with an exponent."""
        if mark := self.take("+", "-"):
            return self.power().signed(-1 if mark == "-" else 1)
        base = self.atom()
        if not self.take("^", "**"):
            return base
        exponent = self.atom()
        count = exponent.coefficient()
        if exponent.open() or not 0 <= count <= 100 or count.denominator > 1:
            raise Malformed(f"{self.source!r:.60}: an exponent that is no number 0, 1, ...")
        found = Polynomial({(): 1})
        for _ in range(int(count)):
            found = found.times(base)
        return found

    def atom(self) -> Polynomial:
        """Read a number, a name or a parenthesis."""
        if self.take("("):
            found = self.sum()
            if not self.take(")"):
                raise Malformed(f"{self.source!r:.60}: a parenthesis is open")
            return found
        kind, token = self.tokens[self.place] if self.place < len(self.tokens) else ("", "")
        self.place += 1
        if kind == "number" and abs(float(token)) < INF:
            return Polynomial.of([()], [float(token)])
        if kind == "name" and token.lower() == "sqr" and self.tokens[self.place :]:
            base = self.atom()
            return base.times(base)
        if kind == "name" and token.lower() in self.letters:
            return Polynomial({(self.letters[token.lower()],): 1})
        raise Malformed(f"{self.source!r:.60}: {token!r} where a number or variable belongs")


def relations(source: str, letters: dict[str, int]) -> list[Constraint]:
    """Read a relation, or a chain of two, as constraints."""
    pieces = RELATION.split(source)
    sides = [Expression(piece, letters).polynomial() for piece in pieces[0::2]]
    found = []
    for left, mark, right in zip(sides, pieces[1::2], sides[1:], strict=False):
        first, second = (right, left) if mark in ("<=", "=l=", "=L=") else (left, right)
        kind = "NONNEGATIVE" if mark.lower() in (">=", "<=", "=l=", "=g=") else "ZERO"
        found.append(Constraint(kind, first.minus(second)))
    if not found:
        raise Malformed(f"{source!r:.60}: no relation")
    return found


def natural(name: str) -> list[Any]:
    """Make a key that sorts x2 before x10."""
    parts = re.split(r"(\d+)", name)
    return [(int(p), "") if p.isdecimal() else (-1, p) for p in parts if p]


def problem_of(path: str) -> Problem:
    """Read the problem that a text or a .gms file states."""
    try:
        source = Path(path).read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise Malformed(f"{path}: {error}") from None
    return of_gms(source) if path.endswith(".gms") else of_text(source)


def made(
    objective: Polynomial, rows: list[Constraint], bounds: list[Any], names: list[str], sense: str
) -> Problem:
    """Make a problem; the objective of a maximisation is negated."""
    least = objective.signed(-1 if sense == "max" else 1)
    lower, upper = [list(ends) for ends in zip(*bounds, strict=True)]
    return Problem(len(names), least, rows, lower, upper, names, [], sense)


def of_text(source: str) -> Problem:
    """Read a problem like ``min x1*x2; s.t. x1^2 + x2^2 <= 1; x1 >= 0``."""
    pieces = [p.strip() for p in BREAK.split(source)]
    pieces = [SUCH_THAT.sub("", p).strip() for p in pieces]
    aims = [p for p in pieces if AIM.match(p)]
    if len(aims) != 1:
        raise Malformed("the text has no objective, or more than one")
    goal = AIM.sub("", aims[0])
    rows = [p for p in pieces if p and p is not aims[0]]
    found = (match for p in (goal, *rows) for match in TOKEN.finditer(RELATION.sub(" ", p)))
    used = {m["name"] for m in found if m["name"] and m["name"].lower() != "sqr"}
    if any(name.lower() in NO_NAMES for name in used):
        raise Malformed("the text has an infinite number")
    names = sorted(used, key=natural)
    letters = {name.lower(): k for k, name in enumerate(names, 1)}
    if len(letters) < len(names) or not names:
        raise Malformed("the text has no variables, or names that differ in case only")
    constraints = [c for p in rows for c in relations(p, letters)]
    objective = Expression(goal, letters).polynomial()
    return made(objective, constraints, [(-INF, INF)] * len(names), names, aims[0][:3].lower())


class Gams:
    """Statements of GAMS's scalar format: variables, equations, bounds, a solve statement."""

    FORMS: ClassVar = {
        "variables": re.compile(r"(?:(\w+)\s+)?variables?\b(.*)", re.I | re.S),
        "row": re.compile(r"(\w+)\s*\.\.(.*)", re.S),
        "bound": re.compile(r"(\w+)\s*\.\s*(lo|up|fx)\s*=(.*)", re.I | re.S),
        "solve": re.compile(r"solve\b.*?\b(mini|maxi)mi[sz]ing\s+(\w+)", re.I | re.S),
        "model": re.compile(r"model\b(?:[^/]*/(.*)/)?", re.I | re.S),
        "binaries": re.compile(r"binaries\b(.*)", re.I | re.S),
        "equations": re.compile(r"equations?\b", re.I),
        "hint": re.compile(r"\w+\s*\.\s*(?:l|m|scale|prior|stage|limrow|limcol|\w+lim)\s*=", re.I),
    }

    def __init__(self) -> None:
        self.names: list[str] = []
        self.kinds: dict[str, str] = {}
        self.rows: dict[str, str] = {}
        self.models: list[set[str]] = []
        self.bounds: dict[tuple[str, str], Fraction] = {}
        self.goal: tuple[str, str] | None = None

    def read(self, statement: str) -> None:
        """Take in one statement."""
        if not statement or re.match(r"(options?|display)\b", statement, re.I):
            return
        if self.goal is not None:
            raise Malformed(f"{statement!r:.60}: a statement after the problem is solved")
        for kind, form in self.FORMS.items():
            if found := form.match(statement):
                getattr(self, f"_{kind}")(*found.groups())
                return
        raise Malformed(f"{statement!r:.60}: a statement that is not known")

    def _variables(self, kind: str | None, listed: str) -> None:
        names = re.findall(r"[A-Za-z]\w*", listed)
        self.names += [name for name in names if name not in self.names]
        self.kinds |= {name.lower(): kind.lower() for name in names if kind}

    def _row(self, name: str, body: str) -> None:
        if name.lower() in self.rows:
            raise Malformed(f"{name}: an equation that stands twice")
        self.rows[name.lower()] = body

    def _bound(self, name: str, which: str, value: str) -> None:
        number = Expression(value, {}).polynomial().coefficient()
        for side in {"lo": ("lo",), "up": ("up",), "fx": ("lo", "up")}[which.lower()]:
            self.bounds[name.lower(), side] = number

    def _solve(self, direction: str, name: str) -> None:
        self.goal = direction.lower(), name

    def _model(self, chosen: str | None) -> None:
        self.models.append({"all"} if chosen is None else set(re.findall(r"\w+", chosen.lower())))

    def _binaries(self, listed: str) -> None:
        self.kinds |= {name.lower(): "binary" for name in re.findall(r"[A-Za-z]\w*", listed)}

    def _equations(self) -> None:
        """Names of equations, each of which is defined by a row."""

    def _hint(self) -> None:
        """A start or a setting, which says nothing of the problem."""


def of_gms(source: str) -> Problem:
    """Read GAMS's scalar format: variables, equations, bounds, a solve statement."""
    found = Gams()
    lines = [line for line in source.splitlines() if not line.startswith("*")]
    for statement in "\n".join(lines).split(";"):
        found.read(statement.strip())
    if any(listed not in ({"all"}, set(found.rows)) for listed in found.models):
        raise Malformed("a model of a part of the equations")
    direction, target = found.goal or ("mini", "objvar")
    others = [name for name in found.names if name.lower() != target.lower()]
    letters = {name.lower(): k for k, name in enumerate([*others, target], 1)}
    rows = list(found.rows.values())
    return _assembled(direction, others, letters, rows, (found.kinds, found.bounds))


def _assembled(
    direction: str, names: list[str], letters: dict[str, int], rows: list[str], known: Any
) -> Problem:
    kinds, given = known
    last, target = len(names) + 1, list(letters)[-1]
    constraints = [c for row in rows for c in relations(row, letters)]
    holding = [c for c in constraints if any(last in word for word in c.polynomial.terms)]
    free = not any(key[0] == target for key in given) and target not in kinds
    if len(holding) != 1 or abs(slope := holding[0].polynomial.coefficient((last,))) != 1:
        raise Malformed("the objective is not given by one equation with the slope 1 or -1")
    if not holding[0].equality and (slope > 0) != (direction == "mini"):
        raise Malformed("the objective variable may differ from its inequality at the optimum")
    if not free or any(last in w and len(w) > 1 for w in holding[0].polynomial.terms):
        raise Malformed("the objective variable has bounds of its own, or powers")
    if not set(kinds.values()) <= set(ENDS):
        raise Malformed("variables that are neither free, positive, negative nor binary")
    objective = holding[0].polynomial.signed(-1 if slope > 0 else 1)
    objective.terms.pop((last,))
    ends = []
    for name in names:
        usual = ENDS[kinds.get(name.lower(), "free")]
        low, high = (given.get((name.lower(), e), u) for e, u in zip(SIDES, usual, strict=True))
        ends.append((-INF if low <= -INFINITE else low, INF if high >= INFINITE else high))
    kept = [c for c in constraints if c is not holding[0]]
    for v in (letters[name.lower()] for name in names if kinds.get(name.lower()) == "binary"):
        kept.append(Constraint("ZERO", Polynomial({(v,): -1, (v, v): 1})))
    return made(objective, kept, ends, names, "max" if direction == "maxi" else "min")
