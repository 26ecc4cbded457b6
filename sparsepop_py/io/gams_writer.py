"""Writing a problem as a GAMS file in scalar format."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from itertools import groupby

import numpy as np

from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial
from sparsepop_py.algebra.rational import AnyConstraint, Rational
from sparsepop_py.errors import ProblemError, check_kind
from sparsepop_py.files import write_text
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.rational_problem import RationalProblem

__all__ = ["write_gms"]

WIDTH = 78
INFINITE = 1e10  # readers take bounds of this magnitude for none
_RESERVED = {"all", "model", "solve", "using", "sqr", "power", "inf", "eps", "na", "undef"}
_RESERVED |= {"variable", "variables", "equation", "equations", "binaries", "option", "options"}
_RESERVED |= {"positive", "negative", "free", "binary", "integer", "display", "set", "sets"}
_RESERVED |= {"and", "or", "not", "xor", "eq", "ne", "lt", "le", "gt", "ge", "if", "sum", "prod"}


def write_gms(problem: Problem | RationalProblem, path: str | os.PathLike[str]) -> None:
    """Write a problem as a GAMS file, which :func:`read_gms` reads back to an equal problem.

    Parameters
    ----------
    problem : Problem or RationalProblem
        With ``sense="max"`` the file maximises, and holds the objective as it was given.
    path : path-like
        Overwritten if it exists.

    Raises
    ------
    OSError
        If the file cannot be written.
    ProblemError
        If a constraint is a cone or a matrix, which the format has no rows for.

    Notes
    -----
    Numbers keep all digits of their doubles. Names that GAMS does not allow (``eta[7]``)
    are changed to similar ones. Finite bounds of magnitude 1e10 and more, which would be
    read as infinite, are written as equations.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2, ["x", "y"])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "small.gms")
    ...     write_gms(sp.Problem(x - 0.1 * y, [x * y >= 1], upper=[5, 7]), path)
    ...     print(path.read_text().split("Equations")[0])
    *  Solve m using NLP minimizing objvar;
    <BLANKLINE>
    Variables x, y, objvar;
    <BLANKLINE>
    <BLANKLINE>
    """
    write_text(path, "\n".join(_lines(problem)) + "\n", "ascii")


class _Symbols:
    """Legal, distinct names: GAMS has one space of names, in which case is ignored."""

    def __init__(self) -> None:
        self.taken = set(_RESERVED)

    def legal(self, name: str, default: str = "v") -> str:
        base = re.sub(r"[^A-Za-z0-9_]", "_", name) or default
        base = base if base[0].isascii() and base[0].isalpha() else f"{default}{base}"
        base = base[:55]
        choice, number = base, 1
        while choice.lower() in self.taken:
            number += 1
            choice = f"{base}_{number}"
        self.taken.add(choice.lower())
        return choice


def _lines(problem: Problem | RationalProblem) -> Iterator[str]:
    _check(problem)
    symbols = _Symbols()
    names = [symbols.legal(name) for name in problem.names]
    objvar = symbols.legal("objvar")
    objective = -problem.objective if problem.sense == "max" else problem.objective
    word = "maximizing" if problem.sense == "max" else "minimizing"
    rows = [(symbols.legal(c.name, "e"), _side(c), c.kind) for c in problem.constraints]
    large = list(_large_bounds(problem, names, symbols))
    target, model = symbols.legal("objective"), symbols.legal("m")
    solve = f"Solve {model} using NLP {word} {objvar};"

    yield from (f"*  {solve}", "")
    yield from (*_wrap("Variables ", _commas([*names, objvar])), "")
    labels = [target, *(label for label, _, _ in rows), *(line.split("..")[0] for line in large)]
    yield from (*_wrap("Equations ", _commas(labels)), "")
    pieces = [f"- {objvar}", *_terms(objective, names), "=E= 0;"]
    yield from (*_wrap(f"{target}.. ", pieces), "")
    for label, side, kind in rows:
        relation = "=E= 0;" if kind is Kind.ZERO else "=G= 0;"
        terms = list(_terms(side, names)) or ["0"]
        yield from (*_wrap(f"{label}.. ", [*terms, relation]), "")
    yield from (*large, *_bounds(problem, names), "")
    yield from (f"Model {model} / all /;", solve)


def _check(problem: Problem | RationalProblem) -> None:
    """Raise what says that the format has no rows for matrices."""
    check_kind(problem, (Problem, RationalProblem), "problem")
    for number, row in enumerate(problem.constraints):
        if row.kind.is_matrix:
            raise ProblemError(
                f"constraints[{number}]: found {row.kind.name}, expected polynomial rows: "
                ".gms has none for cones and matrices; use to_structs"
            )


def _commas(names: list[str]) -> list[str]:
    return [*(f"{name}," for name in names[:-1]), f"{names[-1]};"]


def _wrap(start: str, pieces: Iterable[str]) -> Iterator[str]:
    """Lines of limited width; no line begins with ``*``, which would be a comment."""
    line = start.rstrip()
    for piece in pieces:
        if len(line) + 1 + len(piece) > WIDTH:
            yield line
            line = "   "
        line += f" {piece}"
    yield line


def _side(row: AnyConstraint) -> Polynomial | Rational:
    return row.polynomial if isinstance(row, Constraint) else row.expression


def _terms(expression: Polynomial | Rational, names: list[str]) -> Iterator[str]:
    if isinstance(expression, Polynomial):
        yield from _sum(expression, names)
        return
    yield from _sum(expression.whole, names)
    for numerator, denominator in expression.ratios:
        yield from ("+ (", *(list(_sum(numerator, names)) or ["0"]), ") / (")
        yield from (*_sum(denominator, names), ")")


def _sum(polynomial: Polynomial, names: list[str]) -> Iterator[str]:
    for word, value in zip(
        polynomial.words.tolist(), polynomial.coefficients.tolist(), strict=True
    ):
        factors = []
        for letter, run in groupby(letter for letter in word if letter):
            power = len(list(run))
            factors.append(names[letter - 1] + (f"^{power}" if power > 1 else ""))
        size = repr(abs(value))
        if size != "1.0" or not factors:
            factors.insert(0, size)
        yield f"{'-' if value < 0 else '+'} {'*'.join(factors)}"


def _large_bounds(
    problem: Problem | RationalProblem, names: list[str], symbols: _Symbols
) -> Iterator[str]:
    for name, low, high in zip(names, problem.lower, problem.upper, strict=True):
        if np.isfinite(low) and abs(low) >= INFINITE:
            yield f"{symbols.legal(f'{name}_lo')}.. {name} =G= {float(low)!r};"
        if np.isfinite(high) and abs(high) >= INFINITE:
            yield f"{symbols.legal(f'{name}_up')}.. {name} =L= {float(high)!r};"


def _bounds(problem: Problem | RationalProblem, names: list[str]) -> Iterator[str]:
    for name, low, high in zip(names, problem.lower, problem.upper, strict=True):
        if low == high and abs(low) < INFINITE:
            yield f"{name}.fx = {float(low)!r};"
            continue
        if abs(low) < INFINITE:
            yield f"{name}.lo = {float(low)!r};"
        if abs(high) < INFINITE:
            yield f"{name}.up = {float(high)!r};"
