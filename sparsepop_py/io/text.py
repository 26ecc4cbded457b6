"""Whole problems as one line of text: ``"min x1^2*x2; s.t. 1-x1^2>=0; x1*x2==1"``."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial
from sparsepop_py.algebra.rational import AnyConstraint, Rational, constraint
from sparsepop_py.algebra.sympy_ import natural_key
from sparsepop_py.errors import FormatError
from sparsepop_py.io.expressions import (
    ExpressionError,
    Token,
    Vocabulary,
    excerpt,
    names_in,
    parse_expression,
    parse_number,
    tokenize,
)
from sparsepop_py.io.rational_expressions import parse_rational, split_outside
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.rational_problem import RationalProblem

__all__ = ["parse", "sum_of_squares"]

_BREAK = re.compile(r";|(?=\bs\.\s*t\.)|(?=\bsubject\s+to\b)", re.IGNORECASE)
_SUCH_THAT = re.compile(r"\s*(?:s\.\s*t\.|subject\s+to\b|st\b)\s*:?", re.IGNORECASE)
_NO_NUMBERS = ("inf", "infinity", "nan")  # words that name no variable
_OBJECTIVE = re.compile(r"\s*(min|max)(?:imi[sz]e)?\b\s*:?", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class _Statement:
    """A piece of the text between semicolons, its keyword taken off."""

    text: str
    start: int
    line: int
    keyword: str  # "min", "max" or "" for a constraint
    tokens: tuple[Token, ...]  # positions count from the start of this piece

    def error(self, found: str, expected: str, position: int = 0) -> FormatError:
        line = self.line + self.text.count("\n", 0, position)
        shown = excerpt(self.text, position)
        return FormatError(f"line {line}: statement {shown}: found {found}, expected {expected}")

    def expression(self, tokens: Sequence[Token], vocabulary: Vocabulary) -> Polynomial | Rational:
        if not tokens:
            raise self.error("nothing on one side", "an expression")
        for kind, text, position in tokens:
            if kind == "name" and text.lower() in _NO_NUMBERS:
                raise self.error(repr(text), "a finite number, or no bound at all", position)
        try:
            return parse_rational(tokens, vocabulary)
        except ExpressionError as error:
            raise self.error(error.found, error.expected, error.position) from None


def parse(text: str) -> Problem | RationalProblem:
    """Read the problem that a text states.

    Parameters
    ----------
    text : str
        Statements with ``;`` between them: ``min`` or ``max`` (also ``minimize``,
        ``maximize``) and the objective, then ``s.t.`` (``st``, ``subject to``, or
        nothing) and constraints with ``>=``, ``<=``, ``==`` or ``=``. Both sides are
        expressions as in :func:`~sparsepop_py.io.expressions.parse_expression`;
        ``0 <= x1 <= 2`` makes two constraints, and ``0 <= x1 <= inf`` one.

    Returns
    -------
    Problem or RationalProblem
        The second where something is divided by variables. Its variables are the names that
        occur, in natural order (x2 before x10). A maximisation is stored negated, with
        ``sense="max"``. An objective that is written as a sum of squares keeps this form in
        ``squares``.

    Raises
    ------
    FormatError
        Naming line, statement, what was found and what was expected.

    Examples
    --------
    >>> problem = parse("min (x2 - x1^2)^2 + (1 - x1)^2; s.t. 0 <= x2 <= 2; x1*x2 == 1")
    >>> problem
    <Problem: 2 variables, 2 inequalities, 1 equalities, degree 4>
    >>> len(problem.squares)
    2
    """
    if not isinstance(text, str):
        raise FormatError(f"text: found {type(text).__name__}, expected a string")
    statements = list(_statements(text))
    aims = [statement for statement in statements if statement.keyword]
    if not aims:
        raise FormatError(
            f"line 1: statement {excerpt(text)}: found no objective, "
            "expected 'min' or 'max' and a polynomial"
        )
    if len(aims) > 1:
        raise aims[1].error("a second objective", "only one")
    used = set().union(*(names_in(item.tokens) for item in statements))
    names = _natural_order(name for name in used if name.lower() not in _NO_NUMBERS)
    if not names:
        raise aims[0].error("no variable", "at least one")
    vocabulary = Vocabulary(names)
    objective = aims[0].expression(aims[0].tokens, vocabulary)
    constraints = [
        row for item in statements if not item.keyword for row in _constraints(item, vocabulary)
    ]
    sense: Literal["min", "max"] = "max" if aims[0].keyword == "max" else "min"
    if not all(isinstance(part, Polynomial | Constraint) for part in (objective, *constraints)):
        goal = -objective if sense == "max" else objective
        return RationalProblem(goal, constraints, names=names, sense=sense)
    squares = sum_of_squares(aims[0].tokens, vocabulary) if sense == "min" else None
    return Problem(
        -objective if sense == "max" else objective,
        constraints,
        names=names,
        squares=squares,
        sense=sense,
    )


def _statements(text: str) -> Iterator[_Statement]:
    breaks = [(match.start(), match.end()) for match in _BREAK.finditer(text)]
    starts = [0, *(end for _, end in breaks)]
    ends = [*(start for start, _ in breaks), len(text)]
    line, counted = 1, 0  # the line of the place up to which line ends were counted
    for start, end in zip(starts, ends, strict=True):
        piece = text[start:end]
        if not piece.strip():
            continue
        start += len(piece) - len(piece.lstrip())
        piece = piece.strip()
        line, counted = line + text.count("\n", counted, start), start
        such_that = _SUCH_THAT.match(piece)
        begin = such_that.end() if such_that else 0
        aim = _OBJECTIVE.match(piece, begin)
        begin = aim.end() if aim else begin
        statement = _Statement(piece, start, line, aim.group(1).lower() if aim else "", ())
        try:
            statement = replace(statement, tokens=tuple(tokenize(piece, begin)))
        except ExpressionError as error:
            raise statement.error(error.found, error.expected, error.position) from None
        if not statement.tokens:
            raise statement.error("nothing after the keyword", "an expression", begin)
        yield statement


def _constraints(statement: _Statement, vocabulary: Vocabulary) -> Iterator[AnyConstraint]:
    sides: list[list[Token]] = [[]]
    relations: list[Token] = []
    for token in statement.tokens:
        if token[0] == "relation":
            relations.append(token)
            sides.append([])
        else:
            sides[-1].append(token)
    _check_relations(statement, relations)
    infinite = [_infinity(side) for side in sides]
    expressions = [
        None if sign else statement.expression(side, vocabulary)
        for side, sign in zip(sides, infinite, strict=True)
    ]
    for k, (_, relation, position) in enumerate(relations):
        greater, less = (k + 1, k) if relation == "<=" else (k, k + 1)
        left, right = expressions[greater], expressions[less]
        equal = relation in ("=", "==")
        if left is not None and right is not None:
            yield constraint(left - right, Kind.ZERO if equal else Kind.NONNEGATIVE)
        elif equal or infinite[greater] < 0 or infinite[less] > 0:
            raise statement.error("an infinite bound", "a finite number", position)


def _infinity(side: list[Token]) -> float:
    """Return an infinity that stands alone on a side, with its sign, else 0."""
    if not side or side[-1][1].lower() not in _NO_NUMBERS[:2]:
        return 0.0
    signs = [text for kind, text, _ in side[:-1] if kind == "sign"]
    if len(signs) < len(side) - 1:
        return 0.0
    return -math.inf if signs.count("-") % 2 else math.inf


def _check_relations(statement: _Statement, relations: list[Token]) -> None:
    if not relations:
        raise statement.error("no relation", "one of >=, <=, ==")
    for _, relation, position in relations:
        if relation not in (">=", "<=", "==", "="):
            raise statement.error(f"{relation!r}", "one of >=, <=, ==", position)
    if len(relations) > 2:
        raise statement.error(f"{len(relations)} relations", "at most two", relations[2][2])
    if len({relation.replace("==", "=") for _, relation, _ in relations}) > 1:
        raise statement.error(
            f"{relations[0][1]!r} and {relations[1][1]!r} in one chain",
            "the same relation twice, or ';' between two constraints",
            relations[1][2],
        )


def _natural_order(names: Iterable[str]) -> tuple[str, ...]:
    """Names sorted with their numbers as numbers: x2 before x10."""
    return tuple(sorted(names, key=natural_key))


# ---- sums of squares, seen in the text --------------------------------------------------


def sum_of_squares(
    tokens: Sequence[Token], vocabulary: Vocabulary
) -> list[tuple[float, Polynomial]] | None:
    """Find the squares of a constant plus weighted even powers.

    Parameters
    ----------
    tokens : sequence of Token
        Tokens of an expression that parses.
    vocabulary : Vocabulary

    Returns
    -------
    list of (weight, Polynomial) or None
        An even power 2k of p gives the square of p^k. None if some term is not seen to be
        a square with a weight that is not negative.

    Examples
    --------
    >>> names = Vocabulary(["x1", "x2"])
    >>> [(w, str(p)) for w, p in sum_of_squares(tokenize("10*(x2-x1)^4/2 + x1^2 - 3"), names)]
    [(5.0, 'x1^2 - 2*x1*x2 + x2^2'), (1.0, 'x1')]
    >>> sum_of_squares(tokenize("x1^2 + x1*x2 + x2^2"), names)
    """
    pairs: list[tuple[float, Polynomial]] = []
    for term in split_outside(tokens, "sign"):
        squares = _term_squares(term, vocabulary)
        if squares is None:
            return None
        pairs += squares
    return pairs


def _term_squares(
    term: list[Token], vocabulary: Vocabulary
) -> list[tuple[float, Polynomial]] | None:
    weight = 1.0
    bases: list[tuple[list[Token], int]] = []
    for factor in split_outside(term, "times"):
        divide = factor[0][1] == "/"
        factor = factor[1:] if factor[0][0] == "times" else factor
        signs = next(k for k, token in enumerate(factor) if token[0] != "sign")
        weight = -weight if [t[1] for t in factor[:signs]].count("-") % 2 else weight
        factor = factor[signs:]
        if names_in(factor):
            bases.append(_base_and_exponent(factor))
        else:
            number = parse_number(factor)
            weight = weight / number if divide else weight * number
    if not bases or weight == 0:
        return []
    if weight < 0:
        return None
    return _product_squares(weight, bases, vocabulary)


def _product_squares(
    weight: float, bases: list[tuple[list[Token], int]], vocabulary: Vocabulary
) -> list[tuple[float, Polynomial]] | None:
    if all(exponent % 2 == 0 for _, exponent in bases):
        product: list[Token] = []
        for base, exponent in bases:
            product += [*base, ("power", "^", 0), ("number", str(exponent // 2), 0)]
            product.append(("times", "*", 0))
        root = parse_expression(product[:-1], vocabulary)
        return [(weight, root)] if root.degree else []
    base, exponent = bases[0]
    if len(bases) > 1 or exponent != 1 or base[0][0] != "open":
        return None
    inner = sum_of_squares(base[1:-1], vocabulary)
    return None if inner is None else [(weight * w, p) for w, p in inner]


def _base_and_exponent(factor: list[Token]) -> tuple[list[Token], int]:
    pieces = split_outside(factor, "power")
    base = pieces[0]
    exponent = int(parse_number(pieces[1][1:])) if len(pieces) > 1 else 1
    if base[0][0] == "name" and base[0][1].lower() == "sqr" and len(base) > 1:
        return base[1:], 2 * exponent
    return base, exponent
