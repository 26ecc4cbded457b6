"""Whole problems as one line of text: ``"min x1^2*x2; s.t. 1-x1^2>=0; x1*x2==1"``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial, total
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
from sparsepop_py.problem.problem import Problem

__all__ = ["parse", "sum_of_squares"]

_BREAK = re.compile(r";|(?=\bs\.\s*t\.)|(?=\bsubject\s+to\b)", re.IGNORECASE)
_SUCH_THAT = re.compile(r"\s*(?:s\.\s*t\.|subject\s+to\b|st\b)\s*:?", re.IGNORECASE)
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

    def polynomial(self, tokens: Sequence[Token], vocabulary: Vocabulary) -> Polynomial:
        if not tokens:
            raise self.error("nothing on one side", "an expression")
        try:
            return parse_expression(tokens, vocabulary)
        except ExpressionError as error:
            raise self.error(error.found, error.expected, error.position) from None


def parse(text: str) -> Problem:
    """Problem that a text states.

    Parameters
    ----------
    text : str
        Statements with ``;`` between them: ``min`` or ``max`` (also ``minimize``,
        ``maximize``) and the objective, then ``s.t.`` (``st``, ``subject to``, or
        nothing) and constraints with ``>=``, ``<=``, ``==`` or ``=``. Both sides are
        expressions as in :func:`~sparsepop_py.io.expressions.parse_expression`;
        ``0 <= x1 <= 2`` makes two constraints.

    Returns
    -------
    Problem
        Its variables are the names that occur, in natural order (x2 before x10). A
        maximisation is stored negated, with ``sense="max"``. An objective that is written
        as a sum of squares keeps this form in ``squares``.

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
    statements = list(_statements(text))
    aims = [statement for statement in statements if statement.keyword]
    if not aims:
        raise FormatError(
            f"line 1: statement {excerpt(text)}: found no objective, "
            "expected 'min' or 'max' and a polynomial"
        )
    if len(aims) > 1:
        raise aims[1].error("a second objective", "only one")
    names = _natural_order(set().union(*(names_in(item.tokens) for item in statements)))
    if not names:
        raise aims[0].error("no variable", "at least one")
    vocabulary = Vocabulary(names)
    objective = aims[0].polynomial(aims[0].tokens, vocabulary)
    constraints = [
        row for item in statements if not item.keyword for row in _constraints(item, vocabulary)
    ]
    sense: Literal["min", "max"] = "max" if aims[0].keyword == "max" else "min"
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
    for start, end in zip(starts, ends, strict=True):
        piece = text[start:end]
        if not piece.strip():
            continue
        start += len(piece) - len(piece.lstrip())
        piece = piece.strip()
        such_that = _SUCH_THAT.match(piece)
        begin = such_that.end() if such_that else 0
        aim = _OBJECTIVE.match(piece, begin)
        begin = aim.end() if aim else begin
        statement = _Statement(
            piece,
            start,
            text.count("\n", 0, start) + 1,
            aim.group(1).lower() if aim else "",
            tuple(tokenize(piece, begin)),
        )
        if not statement.tokens:
            raise statement.error("nothing after the keyword", "an expression", begin)
        yield statement


def _constraints(statement: _Statement, vocabulary: Vocabulary) -> Iterator[Constraint]:
    sides: list[list[Token]] = [[]]
    relations: list[Token] = []
    for token in statement.tokens:
        if token[0] == "relation":
            relations.append(token)
            sides.append([])
        else:
            sides[-1].append(token)
    _check_relations(statement, relations)
    polynomials = [statement.polynomial(side, vocabulary) for side in sides]
    for (_, relation, _), left, right in zip(
        relations, polynomials[:-1], polynomials[1:], strict=True
    ):
        if relation == "<=":
            left, right = right, left
        kind = Kind.ZERO if relation in ("=", "==") else Kind.NONNEGATIVE
        yield Constraint(total([left, -right]), kind)


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
            "the same relation twice",
            relations[1][2],
        )


def _natural_order(names: Iterable[str]) -> tuple[str, ...]:
    """Names sorted with their numbers as numbers: x2 before x10."""
    return tuple(
        sorted(
            names,
            key=lambda name: [
                (int(part), "") if part.isdecimal() else (-1, part)
                for part in re.split(r"(\d+)", name)
                if part
            ],
        )
    )


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
    for term in _split(tokens, "sign"):
        squares = _term_squares(term, vocabulary)
        if squares is None:
            return None
        pairs += squares
    return pairs


def _split(tokens: Sequence[Token], kind: str) -> list[list[Token]]:
    """Split before tokens of a kind that stand outside parentheses, between two operands."""
    pieces: list[list[Token]] = [[]]
    depth = 0
    for token in tokens:
        if token[0] == kind and depth == 0 and pieces[-1]:
            if pieces[-1][-1][0] in ("number", "name", "close"):
                pieces.append([])
        depth += {"open": 1, "close": -1}.get(token[0], 0)
        pieces[-1].append(token)
    return pieces


def _term_squares(
    term: list[Token], vocabulary: Vocabulary
) -> list[tuple[float, Polynomial]] | None:
    weight = 1.0
    bases: list[tuple[list[Token], int]] = []
    for factor in _split(term, "times"):
        divide = factor[0][1] == "/"
        factor = factor[1:] if factor[0][0] == "times" else factor
        while factor[0][0] == "sign":
            weight = -weight if factor[0][1] == "-" else weight
            factor = factor[1:]
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
    pieces = _split(factor, "power")
    base = pieces[0]
    exponent = int(parse_number(pieces[1][1:])) if len(pieces) > 1 else 1
    if base[0][0] == "name" and base[0][1].lower() == "sqr" and len(base) > 1:
        return base[1:], 2 * exponent
    return base, exponent
