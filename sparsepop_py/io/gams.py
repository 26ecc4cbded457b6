"""Problem files in the GAMS scalar format, as SparsePOP and GAMS Convert write them.

``read_gms`` collects declarations, equations and bounds statement by statement, then
makes the problem: the equation that holds the objective variable gives the objective.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from math import isfinite
from typing import Literal, TypeVar

import numpy as np

from sparsepop_py.algebra.monomials import degrees
from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial
from sparsepop_py.algebra.rational import AnyConstraint, Rational, constraint
from sparsepop_py.errors import FormatError
from sparsepop_py.files import read_bytes
from sparsepop_py.io.expressions import (
    ExpressionError,
    Vocabulary,
    excerpt,
    parse_exact_number,
)
from sparsepop_py.io.gams_writer import write_gms
from sparsepop_py.io.other_software.integers import problem_with_integers
from sparsepop_py.io.rational_expressions import parse_rational
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.rational_problem import RationalProblem

__all__ = ["Statement", "read_gms", "read_statements", "write_gms"]

_SOLVE_COMMENT = re.compile(
    r"\*\s*(solve\b.*\busing\b.*\b(?:mini|maxi)mi[sz]ing\s+[a-z]\w*)", re.IGNORECASE
)
_SOLVE = re.compile(r"solve\b", re.IGNORECASE)
_SOLVES = re.compile(r"(?:^|;)\s*solve\b", re.IGNORECASE)
_BLOCK = {word: re.compile(rf"\${word}\b", re.IGNORECASE) for word in ("ontext", "offtext")}
_SWITCHES = "digit|dollar|include|listing|symlist|symxref|uellist|uelxref|upper|warning"
_HARMLESS = re.compile(
    rf"""\$(?:
    (?:s?title|hidden)\b.*
    | (?:\$?(?:eject|single|double|lines\s+\d+|o(?:n|ff)(?:{_SWITCHES}))(?:\s+|$))+
    | if\s+not\s+'%gams\.u1%'\s*==\s*''\s*\$include\s+'%gams\.u1%'\s*  # of GAMS Convert
    | if\s+not\s+set\s+(\w+)\s+\$set\s+\1\s+\1\s*  # the solver's class, as of MINLPLib
    )""",
    re.IGNORECASE | re.VERBOSE,
)


@dataclass(frozen=True, slots=True)
class Statement:
    """One statement without its semicolon.

    Parameters
    ----------
    path : str
        The file, used in messages.
    text : str
    line : int
        Line of the first character, from 1.
    """

    path: str
    text: str
    line: int

    def error(self, found: str, expected: str, position: int = 0) -> FormatError:
        """Make an exception that names file, line and statement, to be raised."""
        line = self.line + self.text.count("\n", 0, position)
        shown = excerpt(self.text, position)
        return FormatError(
            f"{self.path}:{line}: statement {shown}: found {found}, expected {expected}"
        )


def read_statements(path: str | os.PathLike[str]) -> tuple[list[Statement], list[Statement]]:
    """Read a file.

    Returns
    -------
    statements : list of Statement
        In the order of the file; at least one.
    directions : list of Statement
        Comments such as ``Solve m using NLP maximizing objvar``: files made for
        SparsePOP may say only there whether they minimise.

    Raises
    ------
    FormatError
        If there is no such file, if it is empty, or if its last statement does not end.
    """
    text = _read(path)
    lines, comments = _without_comments(str(path), text)
    directions = [
        Statement(str(path), match.group(1), number)
        for number, comment in comments
        if (match := _SOLVE_COMMENT.match(comment))
    ]
    statements = list(_split(str(path), "\n".join(lines)))
    if not statements:
        raise Statement(str(path), "", 1).error("no statement", "'Variables ...;'")
    return statements, directions


def _read(path: str | os.PathLike[str]) -> str:
    data = read_bytes(path)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # accents in old comments
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _without_comments(path: str, text: str) -> tuple[list[str], list[tuple[int, str]]]:
    """Lines with comments blanked, and the comments with their line numbers."""
    lines: list[str] = []
    comments: list[tuple[int, str]] = []
    block, solved = 0, False  # line of the $ontext that is open; behind the first Solve
    for number, line in enumerate(text.split("\n"), 1):
        lines.append("" if block or line.startswith(("*", "$")) else line)
        if block or _BLOCK["ontext"].match(line):
            block = 0 if _BLOCK["offtext"].match(line) else block or number
        elif line.startswith("*"):
            comments.append((number, line))
        elif line.startswith("$") and not solved and not _HARMLESS.fullmatch(line):
            raise Statement(path, line, number).error(
                repr(line.split()[0]),
                "one file that holds the whole problem; of lines with $ only $ontext, titles and "
                "switches of the listing",
            )
        solved |= not block and _SOLVES.search(lines[-1]) is not None
    if block:
        raise Statement(path, "$ontext", block).error("no $offtext", "one after $ontext")
    return lines, comments


def _split(path: str, text: str) -> Iterator[Statement]:
    line, start, solved = 1, 0, False
    for end in [*(match.start() for match in re.finditer(";", text)), len(text)]:
        piece = text[start:end]
        stripped = piece.lstrip()
        begin = line + piece[: len(piece) - len(stripped)].count("\n")
        if stripped:
            statement = Statement(path, stripped.rstrip(), begin)
            if end == len(text) and not solved:
                raise statement.error("the end of the file", "';' after the last statement")
            yield statement
            solved = solved or _SOLVE.match(stripped) is not None  # the rest says nothing new
        line += piece.count("\n")
        start = end + 1


Bound = float | Fraction
INFINITE = 1e10  # bounds of this magnitude stand for none
Row = tuple[Polynomial | Rational, Kind]
Expression = TypeVar("Expression", Polynomial, Rational, Polynomial | Rational)

_NAME = r"[A-Za-z]\w*"
_NAMED = re.compile(rf"\s*({_NAME})\s*(?:'[^']*'|\"[^\"]*\")?\s*")
_PIECE = re.compile(r"""(?:'[^'\n]*'|"[^"\n]*"|[^,\n])+""")  # commas may stand in quotes
_RELATION = re.compile(r"=\s*([A-Za-z])\s*=")
_DIRECTION = re.compile(rf"\b(mini|maxi)mi[sz]ing\s+({_NAME})", re.IGNORECASE)
_KINDS = ("free", "positive", "negative", "binary", "integer")
_BOUNDS = {"lo": ("lower",), "up": ("upper",), "fx": ("lower", "upper")}
_NO_BOUNDS = {("lo", "-inf"): -np.inf, ("up", "inf"): np.inf, ("up", "+inf"): np.inf}
_EMPTIES = re.compile(r"\b(?:clear|kill)\s*=\s*\w+", re.IGNORECASE)
_IGNORED = ("l", "m", "scale", "prior", "stage")


@dataclass(slots=True)
class _Variable:
    name: str
    statement: Statement
    kind: str = "free"
    listed: bool = False  # in a plain list, not only in one such as Positive Variables
    lower: Bound | None = None  # given by .lo or .fx
    upper: Bound | None = None

    @property
    def bounds(self) -> tuple[Bound, Bound]:
        """Bounds given, or else those that the kind implies."""
        least = 0.0 if self.kind in ("positive", "binary", "integer") else -np.inf
        most = {"negative": 0.0, "binary": 1.0}.get(self.kind, np.inf)
        low = least if self.lower is None else self.lower
        high = most if self.upper is None else self.upper
        return (-np.inf if low <= -INFINITE else low, np.inf if high >= INFINITE else high)

    @property
    def is_integer(self) -> bool:
        """Check for an integer that is no binary."""
        return self.kind == "integer" and self.bounds != (0.0, 1.0)


@dataclass(slots=True)
class _Definition:
    statement: Statement
    left: tuple[int, int]  # where in the statement the two sides stand
    relation: str
    right: tuple[int, int]


def read_gms(path: str | os.PathLike[str]) -> Problem | RationalProblem:
    """Read a problem from a GAMS file in scalar format.

    Parameters
    ----------
    path : path-like
        A file with ``Variables`` lists (plain, ``Positive``, ``Negative``, ``Binary``,
        ``Free``), an ``Equations`` list, equations ``name.. left =E= right;`` (also
        ``=G=``, ``=L=``), bounds ``.lo .up .fx`` and possibly ``Model`` and ``Solve``.
        Case does not matter; a line with ``*`` in column one is a comment everywhere, and so
        is what stands between ``$ontext`` and ``$offtext``. Other lines with ``$`` are read
        over if they concern the listing only, and refused otherwise.

    Returns
    -------
    Problem or RationalProblem
        The second where something is divided by variables. Without the objective variable:
        the one that Solve names, or ``objvar``. Where there is a Solve statement, its equation
        may be an inequality only if the optimum is the same; elsewhere the relation is ignored,
        as in SparsePOP. Its bounds become constraints. Bounds of magnitude 1e10 or more are
        infinite. A binary variable b adds ``b^2 - b == 0``, an integer its lower bound plus a
        sum of bits, further variables. A maximisation is stored negated, with ``sense="max"``;
        without a Solve statement a comment such as ``* Solve m using NLP maximizing objvar;``
        counts.

    Raises
    ------
    FormatError
        ``FILE:LINE: statement '...': found ..., expected ...``, whenever the file says
        something that would otherwise be lost or guessed.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> text = "Variables x,objvar; Equations e; e.. x^2 - objvar =E= 1; x.lo = 2;"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "small.gms")
    ...     _ = path.write_text(text)
    ...     print(read_gms(path))
    min -1 + x^2
      2 <= x <= inf
    """
    statements, directions = read_statements(path)
    reader = _Reader(statements[-1])
    for statement in statements:
        if reader.solve is None:  # what follows Solve does not change the problem solved
            reader.read(statement)
    reader.check()
    return reader.problem(directions)


@dataclass(slots=True)
class _Reader:
    """Content of the statements read so far; keys are names in lower case. Mutable."""

    last: Statement
    variables: dict[str, _Variable] = field(default_factory=dict)
    equations: dict[str, tuple[str, Statement]] = field(default_factory=dict)
    definitions: dict[str, _Definition] = field(default_factory=dict)
    models: dict[str, Statement] = field(default_factory=dict)
    solve: Statement | None = None

    # ---- statements ---------------------------------------------------------------------

    def read(self, statement: Statement) -> None:
        for pattern, action in _ACTIONS:
            match = pattern.match(statement.text)
            if match:
                action(self, statement, match)
                return
        raise statement.error(
            "an unknown statement",
            "Variables, Equations, 'name.. left =E= right', a bound such as 'x.lo = 0', "
            "Model or Solve",
        )

    def declare(self, statement: Statement, match: re.Match[str]) -> None:
        binaries = match.group("binaries") is not None
        kind = "binary" if binaries else (match.group("kind") or "").lower()
        if kind and kind not in _KINDS:
            raise statement.error(
                f"{match.group('kind')!r} variables", f"one of {', '.join(_KINDS)}"
            )
        for name, position in _names(statement, match.end()):
            known = self.variables.get(name.lower())
            variable = known or _Variable(name, statement)
            self.variables[name.lower()] = variable
            if kind:
                if variable.kind not in ("free", kind):
                    raise statement.error(
                        f"{name!r}, which is {variable.kind} already", "one kind", position
                    )
                variable.kind = kind
            elif variable.listed:
                raise statement.error(f"{name!r} twice", "distinct names", position)
            variable.listed |= not kind

    def declare_equations(self, statement: Statement, match: re.Match[str]) -> None:
        for name, position in _names(statement, match.end()):
            if name.lower() in self.equations:
                raise statement.error(f"{name!r} twice", "distinct names", position)
            self.equations[name.lower()] = (name, statement)

    def define(self, statement: Statement, match: re.Match[str]) -> None:
        name = match.group(1)
        if name.lower() not in self.equations:
            raise statement.error(f"the undeclared equation {name!r}", "a name from Equations")
        if name.lower() in self.definitions:
            raise statement.error(f"a second definition of {name!r}", "only one")
        relations = list(_RELATION.finditer(statement.text, match.end()))
        if len(relations) != 1:
            raise statement.error(
                f"{len(relations)} relations", "one of =E=, =G=, =L=", match.end()
            )
        middle = relations[0]
        if middle.group(1).lower() not in "egl":
            raise statement.error(f"{middle.group()!r}", "one of =E=, =G=, =L=", middle.start())
        self.definitions[name.lower()] = _Definition(
            statement,
            (match.end(), middle.start()),
            middle.group(1).lower(),
            (middle.end(), len(statement.text)),
        )

    def assign(self, statement: Statement, match: re.Match[str]) -> None:
        name, suffix = match.group(1), match.group(2).lower()
        variable = self.variables.get(name.lower())
        if variable is None:
            if name.lower() in self.models or (
                name.lower() in self.equations and suffix in _IGNORED
            ):
                return
            raise statement.error(f"the undeclared variable {name!r}", "a declared one")
        given = statement.text[match.end() :].strip().lower()
        if suffix == "prior" and given.lstrip("+ ") == "inf":
            raise statement.error(
                "a priority that makes an integer variable continuous", "a finite one", match.end()
            )
        if suffix in _IGNORED:
            return
        if suffix not in _BOUNDS:
            raise statement.error(f"'.{suffix}'", ".lo, .up, .fx (or .l, .m, which are ignored)")
        none = _NO_BOUNDS.get((suffix, given))
        if none is not None:
            setattr(variable, _BOUNDS[suffix][0], none)
            return
        try:
            value = parse_exact_number(statement.text[match.end() :])
        except ExpressionError as error:
            raise statement.error(
                error.found, "a finite number (1e10 for no bound)", match.end() + error.position
            ) from None
        for side in _BOUNDS[suffix]:
            setattr(variable, side, value)

    def declare_model(self, statement: Statement, match: re.Match[str]) -> None:
        self.models[match.group(1).lower()] = statement

    def record_solve(self, statement: Statement, _: re.Match[str]) -> None:
        if not _DIRECTION.search(statement.text):
            raise statement.error("no direction", "minimizing or maximizing and a variable")
        self.solve = statement

    def ignore(self, statement: Statement, match: re.Match[str]) -> None:
        """Pass over displays and options, except those that take bounds back."""
        emptied = _EMPTIES.search(statement.text)
        if emptied and statement.text[0] in "oO":
            raise statement.error(
                repr(emptied[0]), "only options that leave bounds as they are", emptied.start()
            )

    # ---- checks -------------------------------------------------------------------------

    def check(self) -> None:
        """Check conditions that need the whole file."""
        for key, (name, statement) in self.equations.items():
            if key not in self.definitions:
                raise statement.error(
                    f"the equation {name!r} without a definition", f"'{name}.. ...;'"
                )
        for statement in self.models.values():
            chosen = re.search(r"/(.*)/", statement.text, re.DOTALL)
            listed = set(re.findall(r"\w+", chosen.group(1).lower())) if chosen else {"all"}
            if listed not in ({"all"}, set(self.equations)):
                raise statement.error("a part of the equations", "'/ all /'")
        relaxed = self.solve and re.search(r"\busing\s+(rmi\w*)", self.solve.text, re.IGNORECASE)
        for variable in self.variables.values():
            low, high = variable.bounds
            if relaxed and self.solve and variable.kind in ("binary", "integer"):
                raise self.solve.error(
                    f"the class {relaxed[1]!r} and the {variable.kind} variable {variable.name!r}",
                    "a class that keeps integers, or variables that are none",
                )
            if variable.kind == "integer" and not (isfinite(low) and isfinite(high)):
                raise variable.statement.error(
                    f"the integer variable {variable.name!r}",
                    "two bounds of each integer variable, smaller than 1e10 in size: it becomes "
                    "a sum of binaries",
                )
            if low > high or low >= INFINITE or high <= -INFINITE:
                raise variable.statement.error(
                    f"bounds [{float(low):g}, {float(high):g}] of {variable.name!r}",
                    "lower <= upper",
                )

    def direction(self, comments: list[Statement]) -> tuple[str, str, Statement]:
        """Read direction and objective variable; return them with the statement that says so."""
        sources = [self.solve] if self.solve else comments
        found: set[tuple[str, str]] = set()
        for statement in sources:
            for word, name in _DIRECTION.findall(statement.text):
                found.add((word.lower(), name.lower()))
            if len(found) > 1:
                raise statement.error("a second direction", "only one")
        word, name = found.pop() if found else ("mini", "objvar")
        return word, name, sources[0] if sources else self.last

    # ---- the problem --------------------------------------------------------------------

    def problem(self, comments: list[Statement]) -> Problem | RationalProblem:
        word, target, source = self.direction(comments)
        if target not in self.variables:
            raise source.error(f"no variable {target!r}", "the objective variable in Variables")
        objvar = self.variables[target]
        others = [v for key, v in self.variables.items() if key != target]
        if not others:
            raise objvar.statement.error("no variable but the objective", "at least one")
        names = tuple(variable.name for variable in others)
        rows = self.rows(Vocabulary([*names, objvar.name], ignore_case=True))
        self.check_typed(others, rows)
        key = self.objective_row(rows, objvar)
        row = rows.pop(key)
        objective = self.solved(row, key, objvar, names)
        self.check_binds(row, key, objvar, word)
        constraints = [
            constraint(_shrunk(row, names), kind, self.equations[key][0])
            for key, (row, kind) in rows.items()
        ]
        constraints += _objective_bounds(objective, objvar)
        constraints += _binaries(others, names)
        sense: Literal["min", "max"] = "max" if word == "maxi" else "min"
        stated = -objective if sense == "max" else objective
        low, high = map(list, zip(*(variable.bounds for variable in others), strict=True))
        integer = [v for v, each in enumerate(others) if each.is_integer]
        polynomial = [row for row in constraints if isinstance(row, Constraint)]
        if isinstance(stated, Polynomial) and len(polynomial) == len(constraints):
            return problem_with_integers(stated, polynomial, (low, high), names, integer, sense)
        if integer:
            found = f"{names[integer[0]]!r} in a model with ratios"
            raise others[integer[0]].statement.error(found, "no integer variable beside ratios")
        return RationalProblem(stated, constraints, low, high, names, sense=sense)

    def rows(self, vocabulary: Vocabulary) -> dict[str, Row]:
        rows: dict[str, Row] = {}
        for key, definition in self.definitions.items():
            left = _side(definition.statement, definition.left, vocabulary)
            right = _side(definition.statement, definition.right, vocabulary)
            row = right - left if definition.relation == "l" else left - right
            rows[key] = (row, Kind.ZERO if definition.relation == "e" else Kind.NONNEGATIVE)
        return rows

    def check_typed(self, variables: list[_Variable], rows: dict[str, Row]) -> None:
        """Refuse names in, say, Positive Variables that no equation uses: likely misspelled."""
        used = {int(v) for row, _ in rows.values() for part in _parts(row) for v in part.support}
        texts = " ".join(each.statement.text for each in self.definitions.values())
        written = set(re.findall(r"\w+", texts.lower()))  # where its terms cancel as well
        for index, variable in enumerate(variables):
            held = index in used or variable.name.lower() in written
            if not variable.listed and not held:
                raise variable.statement.error(
                    f"{variable.name!r}, which no Variables list and no equation holds",
                    "a declared variable",
                )

    def objective_row(self, rows: dict[str, Row], objvar: _Variable) -> str:
        holding = [
            key
            for key, (row, _) in rows.items()
            if any((part.words == part.dimension).any() for part in _parts(row))
        ]
        if not holding:
            raise objvar.statement.error(f"{objvar.name!r} in no equation", "it in one")
        if len(holding) > 1:
            raise self.definitions[holding[1]].statement.error(
                f"{objvar.name!r} in a second equation", "it in one"
            )
        if objvar.kind in ("binary", "integer"):
            raise objvar.statement.error(
                f"the {objvar.kind} variable {objvar.name!r} as objective", "a continuous one"
            )
        return holding[0]

    def check_binds(self, row: Row, key: str, objvar: _Variable, word: str) -> None:
        """Refuse an inequality at whose optimum the objective variable may differ from its row."""
        if self.solve is None or row[1] is Kind.ZERO:
            return
        whole = _parts(row[0])[0]
        (slope,) = whole.derivative(whole.dimension - 1).fractions
        above = slope > 0  # the objective variable is at least what the row says
        near = objvar.bounds[0 if above else 1]
        if (word == "mini") is not above or isfinite(near):
            raise self.definitions[key].statement.error(
                f"an inequality that leaves {objvar.name!r} free to differ from it at the optimum",
                "=E=",
            )

    def solved(
        self, row: Row, key: str, objvar: _Variable, names: tuple[str, ...]
    ) -> Polynomial | Rational:
        """Solve the row for the objective variable."""
        whole, *others = _parts(row[0])
        last, holds = whole.dimension, (whole.words == whole.dimension).any(axis=1)
        inside = any((part.words == part.dimension).any() for part in others)
        if inside or np.any(degrees(whole.words)[holds] > 1):
            raise self.definitions[key].statement.error(
                f"{objvar.name!r} in a product or a power", "it times a number"
            )
        (factor,) = whole.derivative(last - 1).fractions
        target = Polynomial(np.array([[last]], np.int32), np.ones(1), last)
        rest = (whole - factor * target).within(len(names), names)
        if isinstance(row[0], Rational):
            pairs = tuple((_shrunk(p, names), _shrunk(q, names)) for p, q in row[0].ratios)
            return Rational(rest, pairs) / -factor
        return rest / -factor


def _names(statement: Statement, start: int) -> Iterator[tuple[str, int]]:
    """Names of a list, between commas or ends of lines, with their positions."""
    found = False
    for piece in _PIECE.finditer(statement.text[start:]):
        if not piece.group().strip():
            continue
        position = start + piece.start()
        match = _NAMED.fullmatch(piece.group())
        if not match:
            raise statement.error(f"{piece.group().strip()!r}", "a name", position)
        found = True
        yield match.group(1), position
    if not found:
        raise statement.error("an empty list", "names")


def _side(
    statement: Statement, span: tuple[int, int], vocabulary: Vocabulary
) -> Polynomial | Rational:
    try:
        return parse_rational(statement.text[span[0] : span[1]], vocabulary)
    except ExpressionError as error:
        raise statement.error(error.found, error.expected, span[0] + error.position) from None


def _parts(row: Polynomial | Rational) -> tuple[Polynomial, ...]:
    return row.parts if isinstance(row, Rational) else (row,)


def _shrunk(row: Expression, names: tuple[str, ...]) -> Expression:
    """Drop the last variable from a row that does not hold it."""
    if isinstance(row, Rational):
        pairs = tuple((_shrunk(p, names), _shrunk(q, names)) for p, q in row.ratios)
        return Rational(_shrunk(row.whole, names), pairs)
    return row.within(len(names), names)


def _objective_bounds(
    objective: Polynomial | Rational, objvar: _Variable
) -> Iterator[AnyConstraint]:
    low, high = objvar.bounds
    if low == high:
        yield constraint(objective - low, Kind.ZERO, f"{objvar.name}_fx")
        return
    if isfinite(low):
        yield constraint(objective - low, Kind.NONNEGATIVE, f"{objvar.name}_lo")
    if isfinite(high):
        yield constraint(high - objective, Kind.NONNEGATIVE, f"{objvar.name}_up")


def _binaries(variables: list[_Variable], names: tuple[str, ...]) -> Iterator[Constraint]:
    for letter, variable in enumerate(variables, 1):
        if variable.kind in ("binary", "integer") and not variable.is_integer:
            words = np.array([[0, letter], [letter, letter]], np.int32)
            row = Polynomial.from_words(words, np.array([-1.0, 1.0]), len(names), names)
            yield Constraint(row, Kind.ZERO, f"binary {variable.name}")


_ACTIONS = [
    (re.compile(pattern, re.IGNORECASE | re.DOTALL), action)
    for pattern, action in (
        (rf"({_NAME})\s*\.\.", _Reader.define),
        (rf"({_NAME})\s*\.\s*({_NAME})\s*=", _Reader.assign),
        (r"(?:(?P<kind>[a-z]\w*)\s+)?variables?\b|(?P<binaries>binaries\b)", _Reader.declare),
        (r"equations?\b", _Reader.declare_equations),
        (rf"model\s+({_NAME})", _Reader.declare_model),
        (r"solve\b", _Reader.record_solve),
        (r"(?:options?|display)\b", _Reader.ignore),
    )
]
