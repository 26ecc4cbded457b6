r"""Files with nonlinear rows, as SCIP reads them: ``.nl``, ``.pip``, ``.osil``, ``.cip``.

Linear rows, and quadratic ones of files that list their products, are taken number by number.
SCIP offers no way to take constants beside products, rows of higher degree and expressions, as in
``.nl``, so; they come by the text in which SCIP writes them, with numbers of 15 digits. Where that
may have lost some, ``Problem.rounding`` says so.
"""

from __future__ import annotations

import math
import os
import re
import tempfile
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial
from sparsepop_py.errors import FormatError, SolverNotFound
from sparsepop_py.files import as_path
from sparsepop_py.io.other_software.integers import between, problem_with_integers
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.rounding import OBJECTIVE, Rounding, place_of

__all__ = ["RESERVED", "read_by_scip"]

_Bounds = tuple[list[float], list[float]]
_INFINITE = 1e20  # what SCIP takes for infinite
_TEXTS = (".pip", ".lp")  # as people write them
_WHOLE = ("BINARY", "INTEGER", "IMPLINT")
_TERM = re.compile(
    r"([+-]?)\s*((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)?((?:\s*\*?\s*x\d+(?:\^\d+(?![\d.eE]))?)*)"
)
_OSIL = (  # parts of an .osil file that SCIP reads; it passes over others without a word
    "variables",
    "objectives",
    "constraints",
    "linearConstraintCoefficients",
    "quadraticCoefficients",
    "nonlinearExpressions",
    "specialOrderedSets",
)
_NO_POWER = re.compile(r"\^(?!\s*\d{1,4}(?![\d.eE_]|\s*\^))")  # in files, comments left out
_SENSES = ("min", "minimize", "minimum", "max", "maximize", "maximum")
RESERVED = frozenset(  # words that begin a section wherever they stand in .lp and .pip files
    (
        *_SENSES,
        *"st st. s.t. bound bounds general generals gen integer integers int".split(),
        *"binary binaries bin semi semis semi-continuous sos sos1 sos2 end free".split(),
    )
)
_TO_ROWS = re.compile(r"(?:^|\s)(?:subject\s+to|such\s+that|st\.?|s\.t\.)(?=\s)", re.IGNORECASE)
_FROM_ROWS = re.compile(
    r"^\s*(?:bounds?|gen(?:erals?)?|int(?:egers?)?|bin(?:ary|aries)?|semi[^\s:]*+|sos\d?|end)\b"
    r"(?![ \t]*:)",  # else it is the label of a row
    re.IGNORECASE | re.MULTILINE,
)
_LABEL = r"[^\s:<>=]+[ \t]*:"
_ONE_ROW = re.compile(  # a label, something with a variable, a relation, a number alone
    rf"(?:{_LABEL})?(?:\d|[^\w<>=:])*+[^\W\d][^<>=:]*+(?:[<>]=?|=[<>]?)\s*[+-]?\s*"
    rf"(?:(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|inf(?:inity)?)(?=[ \t]*(?:\n|$|{_LABEL}))",
    re.IGNORECASE,
)
_ANYTHING = re.compile(r"\S")
_EXPRESSION = re.compile(r"\[nonlinear\] <c(\d+)>:(.*)")  # in files of SCIP's own format
_FACTOR = r"(?:\(<x\d+>\)\^[\d.]+|<x\d+>)"
_PRODUCT = re.compile(rf"{_FACTOR}(?:\*{_FACTOR})+")
_SQUARE, _ALONE = re.compile(r"\(<x(\d+)>\)\^2(?![\d.])"), re.compile(r"(?<!\()<x(\d+)>")
_NUMBER = re.compile(rb"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_DIGITS = 15  # of numbers that SCIP writes
_ROW = re.compile(r"^\s*c(\d+)(?:_lhs|_rhs)?:(.*?)(>=|<=|=)\s*(\S+)", re.S | re.M)


def read_by_scip(path: str | os.PathLike[str]) -> Problem:
    """Read a file by SCIP.

    Parameters
    ----------
    path : path-like
        ``.nl``, ``.pip``, ``.osil``, ``.cip``, or ``.lp`` with quadratic rows. Rows
        are polynomial, integers have two bounds. Where the objective is a variable that occurs
        in one row only, as readers write nonlinear objectives, the row is the objective.

    Returns
    -------
    Problem
        A maximisation is stored negated, with ``sense="max"``.

    Raises
    ------
    FormatError
        If SCIP cannot read the file, or would read something else in it, or a row is not
        polynomial.
    SolverNotFound
        If PySCIPOpt is not installed.
    """
    file = as_path(path)
    if not file.is_file():
        raise FormatError(f"{path}: found no such file")
    model = _loaded(file, _require_scip())
    variables = model.getVars()
    if file.suffix.lower() in _TEXTS:
        _check_names(file, [variable.name for variable in variables])
    if not variables:
        raise FormatError(f"{path}: found no variables, expected a problem in this format")
    number = {variable.name: v for v, variable in enumerate(variables)}
    for variable in variables:
        if variable.vtype() not in (*_WHOLE, "CONTINUOUS"):
            raise FormatError(f"{path}: found the {variable.vtype()} variable {variable.name!r}")
    names = tuple(number)
    found = list(_rows(model, names, number, file))
    sign = -1.0 if model.getObjectiveSense() == "maximize" else 1.0
    cost = [sign * variable.getObj() for variable in variables]
    constant = sign * model.getObjoffset()
    objective = _linear([*cost, constant], [*range(1, len(names) + 1), 0], names)
    bounds = (
        [_end(v.getLbOriginal()) for v in variables],
        [_end(v.getUbOriginal()) for v in variables],
    )
    objective, found, bounds, kept, shortened = _objective_row(objective, found, bounds)
    problem = problem_with_integers(
        objective,
        [row for row, _ in found],
        bounds,
        [names[v] for v in kept],
        [k for k, v in enumerate(kept) if variables[v].vtype() in _WHOLE],
        "max" if sign < 0 else "min",
    )
    places = [(OBJECTIVE, shortened)]
    places += [(place_of(k, row), count) for k, (row, count) in enumerate(found)]
    records = [Rounding(place, count, math.inf, math.inf) for place, count in places if count]
    object.__setattr__(problem, "rounding", (*problem.rounding, *records))
    return problem


def _require_scip() -> ModuleType:
    try:
        import pyscipopt
    except ImportError as error:
        raise SolverNotFound(
            "PySCIPOpt is not installed; pip install 'sparsepop-py[scip]'"
        ) from error
    return pyscipopt


def _check_text(file: Path) -> None:
    """Refuse texts that SCIP reads as something else.

    It takes ``x^2.5`` for x^2 + 0.5, ``x^2e1`` for x^20 and ``x^2^3`` for x^3, an objective under
    a word that it does not know, such as Minimise, for none, and what follows the number on the
    right of a row for the next one, as in ``1 <= x``.
    """
    lines = file.read_bytes().decode("latin-1").replace("\r\n", "\n").split("\n")
    text = "\n".join(line.partition("\\")[0] for line in lines)
    if found := _NO_POWER.search(text):
        power = text[found.start() :][:20].partition("\n")[0]
        raise FormatError(
            f"{_line_of(file, text, found.start())}: found the power {power!r}, expected a whole "
            "number of at most four digits"
        )
    word = next(iter(text.split()), "")
    if word.lower() not in _SENSES:
        raise FormatError(f"{file}: found {word!r} first, expected Minimize or Maximize")
    for line in text.split("\n"):
        inside = [each for each in line.split()[1:] if each.lower() in RESERVED - {"free"}]
        if inside:
            raise FormatError(
                f"{file}: found {inside[0]!r} inside a line, expected it to begin one"
            )
    _check_rows(file, text)


def _check_rows(file: Path, text: str) -> None:
    """Refuse rows without variables on the left, or more than a number right."""
    begin = _TO_ROWS.search(text)
    end = _FROM_ROWS.search(text, begin.end() if begin else 0)
    place, stop = begin.end() if begin else 0, end.start() if end else len(text)
    if begin is None:
        if re.search("[<>=]", text[:stop]):  # SCIP may look for the end of the objective for ever
            raise FormatError(f"{file}: found rows, expected 'Subject to' before them")
        return
    while found := _ANYTHING.search(text, place, stop):
        place = found.start()
        row = _ONE_ROW.match(text, place, stop)
        if row is None:
            shown = text[place : min(place + 40, stop)].partition("\n")[0]
            raise FormatError(
                f"{_line_of(file, text, place)}: found the row {shown!r}, expected one such as "
                "'c: x + 2 y >= 1', with a number alone on the right"
            )
        place = row.end()


def _line_of(file: Path, text: str, place: int) -> str:
    line = text.count("\n", 0, place) + 1
    return f"{file}, line {line}"


def _check_parts(file: Path) -> None:
    """Refuse parts of an .osil file that SCIP passes over.

    These are cones, matrices and others that it does not know, and what comes a second time.
    """
    try:
        root = ET.parse(file).getroot()
    except (ET.ParseError, LookupError, ValueError) as error:  # the last two: encodings
        raise FormatError(f"{file}: found no XML, expected a problem in OSiL: {error}") from None
    parts = [part for data in root if _tag(data) == "instanceData" for part in data]
    seen: set[str] = set()
    for part in parts:
        name = _tag(part)
        if name not in _OSIL and len(part):
            raise FormatError(f"{file}: found <{name}>, expected one of {', '.join(_OSIL)}")
        _check_once(seen, name, file)
    rows: set[str] = set()
    for part in parts:
        for row in part if _tag(part) == "nonlinearExpressions" else ():
            _check_once(rows, f"nl idx={row.get('idx', '')!r}", file)


def _tag(element: ET.Element) -> str:
    """Return the name of an element without its namespace."""
    return element.tag.rpartition("}")[2]


def _check_once(seen: set[str], name: str, file: Path) -> None:
    if name in seen:
        raise FormatError(f"{file}: found <{name}> twice, expected it once: SCIP reads one")
    seen.add(name)


def _check_names(file: Path, names: list[str]) -> None:
    """Refuse brackets and functions, which SCIP reads as parts of names."""
    known = set(names)
    for name in names:
        inner = name.partition("(")[2].removesuffix(")")
        bracket = name.startswith("(") or name.count("(") != name.count(")") or inner in known
        if bracket or ":" in name or name.lower() in RESERVED:  # the colon is of a second label
            raise FormatError(
                f"{file}: found the variable {name!r}, expected polynomials without brackets and "
                "functions, and no names that begin a section"
            )


def _loaded(file: Path, scip: ModuleType) -> Any:
    if file.suffix.lower() in _TEXTS:
        _check_text(file)
    if file.suffix.lower() == ".osil":
        _check_parts(file)
    model = scip.Model()
    model.hideOutput()
    for name in ("numerics/epsilon", "numerics/sumepsilon"):
        model.setParam(name, 1e-17)  # smaller coefficients would count as 0
    try:
        model.readProblem(str(file))
    except Exception as error:  # PySCIPOpt raises Exception itself
        raise FormatError(f"{file}: SCIP cannot read this file: {error}") from None
    return model


def _end(value: float) -> float:
    return value if abs(value) < _INFINITE else float(np.copysign(np.inf, value))


def _linear(values: list[float], letters: list[int], names: tuple[str, ...]) -> Polynomial:
    words = np.array(letters, np.int32)[:, None]
    return Polynomial.from_words(words, np.array(values, float), len(names), names)


# ---- rows -------------------------------------------------------------------------------


def _rows(
    model: Any, names: tuple[str, ...], number: dict[str, int], file: Path
) -> Iterator[tuple[Constraint, int]]:
    """Yield constraints, and how many numbers of each may have lost digits."""
    text: dict[int, _Written] | None = None
    for k, row in enumerate(model.getConss()):
        kind = row.getConshdlrName()
        if kind not in ("linear", "nonlinear") and not row.isLinearType():
            raise FormatError(
                f"{file}: found the row {row.name!r} of kind {kind}, expected polynomial rows"
            )
        low, high = _end(model.getLhs(row)), _end(model.getRhs(row))
        shortened = 0
        if row.isLinearType() or kind == "linear":
            letters = [number[variable.name] + 1 for variable in model.getConsVars(row)]
            body = _linear(model.getConsVals(row), letters, names)  # a variable may come twice
        else:
            text = _written(model, names, file) if text is None else text
            if k not in text:
                raise FormatError(f"{file}: found the row {row.name!r}, expected polynomial rows")
            if model.checkQuadraticNonlinear(row):
                body = _quadratic(model.getTermsQuadratic(row), number, names)
                body = body + text[k].constant(low, high)
                shortened = text[k].shortened(low, high, constant=True)
            else:
                body = text[k].between(low, high)
                shortened = text[k].shortened(low, high)
        for made in between(body, low, high, row.name):
            yield made, shortened


def _quadratic(
    terms: tuple[list[Any], list[Any], list[Any]], number: dict[str, int], names: tuple[str, ...]
) -> Polynomial:
    products, squares, linear = terms
    words, values = [], []
    for x, y, value in products:
        words.append(sorted((number[x.name] + 1, number[y.name] + 1)))
        values.append(value)
    for x, square, single in squares:
        words += [[number[x.name] + 1] * 2, [0, number[x.name] + 1]]
        values += [square, single]
    for x, value in linear:
        words.append([0, number[x.name] + 1])
        values.append(value)
    array = np.array(words, np.int32).reshape(-1, 2)
    return Polynomial.from_words(array, np.array(values, float), len(names), names)


@dataclass(frozen=True, slots=True)
class _Written:
    """A row as SCIP writes it.

    Constants may stand on the other side than in the model.
    """

    body: Polynomial
    relation: str
    side: float
    stated: _Stated

    def between(self, low: float, high: float) -> Polynomial:
        """Return what lies between the ends of the row, with the constant."""
        return self.body + self._moved(low, high)

    def constant(self, low: float, high: float) -> Fraction:
        """Return the constant of what lies between the ends of the row."""
        alone = (value for word, value in _terms(self.body) if not word)
        return sum(map(Fraction, alone), self._moved(low, high))

    def shortened(self, low: float, high: float, constant: bool = False) -> int:
        """Count the numbers, or constants alone, that may have lost digits."""
        read = [value for word, value in _terms(self.body) if not (constant and word)]
        if self._moved(low, high):
            read.append(self.side)
        return sum(self.stated.may_be_shortened(value) for value in read)

    def _moved(self, low: float, high: float) -> Fraction:
        end = low if self.relation == ">=" else high
        same = float(f"{end:.15g}") == self.side
        return Fraction(0) if same else Fraction(end) - Fraction(self.side)


@dataclass(frozen=True, slots=True)
class _Stated:
    """Numbers of a file: all, and as SCIP writes those that it shortens."""

    all: frozenset[float]
    shortened: frozenset[float]

    @staticmethod
    def of(file: Path) -> _Stated:
        found = frozenset(float(text) for text in _NUMBER.findall(file.read_bytes()))
        written = {value: float(f"{value:.{_DIGITS}g}") for value in found}
        return _Stated(found, frozenset(s for value, s in written.items() if s != value))

    def may_be_shortened(self, value: float) -> bool:
        """Check a number that SCIP wrote: from a longer one, or all digits from arithmetic."""
        whole = f"{value:.{_DIGITS - 1}e}".partition("e")[0]
        long = not whole.endswith("0") and abs(value) not in self.all
        return long or abs(value) in self.shortened


def _written(model: Any, names: tuple[str, ...], file: Path) -> dict[int, _Written]:
    """Read the rows that SCIP writes in its format of polynomials, by number."""
    try:
        written = dict(_EXPRESSION.findall(_text(model, ".cip")))
        kinds = enumerate(row.getConshdlrName() for row in model.getConss())
        if missing := {str(k) for k, kind in kinds if kind == "nonlinear"} - set(written):
            raise FormatError(
                f"{file}: found no row c{min(missing)} in the .cip text that SCIP "
                f"{model.version()} writes, expected '[nonlinear] <c{min(missing)}>: ...'"
            )
        for row in written.values():
            _check_distinct(row, names, file)  # before SCIP collects terms
        text = _text(model, ".pip")
    except FormatError:
        raise
    except Exception as error:  # PySCIPOpt raises Exception itself
        raise FormatError(f"{file}: found rows that are not polynomial ({error})") from None
    stated = _Stated.of(file)
    text = text.partition("Subject to")[2].partition("\nBounds")[0]
    return {
        int(found[1]): _Written(
            _polynomial(found[2], names, file), found[3], float(found[4]), stated
        )
        for found in _ROW.finditer(text)
    }


def _text(model: Any, ending: str) -> str:
    """Return what SCIP writes, variables and rows by their numbers."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"rows{ending}")
        model.writeProblem(str(path), genericnames=True, verbose=False)
        return path.read_text()


def _check_distinct(row: str, names: tuple[str, ...], file: Path) -> None:
    """Refuse squares, or variables alone, that come twice in a row.

    SCIP tells of the last one only, and may end the process with a segmentation fault.
    """
    sums = _PRODUCT.sub("", row)
    for term in (_SQUARE, _ALONE):
        for number, count in Counter(term.findall(sums)).items():
            if count > 1:
                raise FormatError(
                    f"{file}: found several terms of one row in {names[int(number)]!r} alone, or "
                    "in its square, expected one: SCIP tells of the last one only"
                )


def _polynomial(text: str, names: tuple[str, ...], file: Path) -> Polynomial:
    words, values, rest = [], [], text.strip()
    while rest:
        found = _TERM.match(rest)
        if found is None or not found.group(2) and not found.group(3):
            raise FormatError(f"{file}: found {rest[:40]!r} in what SCIP writes, expected a term")
        rest = rest[found.end() :].lstrip()
        word: list[int] = []
        for variable, power in re.findall(r"x(\d+)(?:\^(\d+))?", found.group(3)):
            word += [int(variable) + 1] * int(power or 1)
        words.append(sorted(word))
        values.append(float((found.group(1) or "") + (found.group(2) or "1")))
    width = max(map(len, words), default=1) or 1
    padded = np.array([[0] * (width - len(word)) + word for word in words], np.int32)
    table = padded.reshape(-1, width)  # of rows without terms too
    return Polynomial.from_words(table, np.array(values, float), len(names), names)


# ---- the objective ----------------------------------------------------------------------


def _objective_row(
    objective: Polynomial, rows: list[tuple[Constraint, int]], bounds: _Bounds
) -> tuple[Polynomial, list[tuple[Constraint, int]], _Bounds, list[int], int]:
    """Replace a free variable of a linear objective by the one row that bounds it.

    Returns objective, rows, bounds, the variables that are left, and how many numbers of the
    objective may have lost digits.
    """
    n = objective.dimension
    for z in objective.support.tolist() if objective.degree == 1 and n > 1 else []:
        holding = [k for k, (row, _) in enumerate(rows) if z in row.polynomial.support]
        free = bounds[0][z] == -np.inf and bounds[1][z] == np.inf
        value = _solved(rows[holding[0]][0], objective, z) if free and len(holding) == 1 else None
        if value is None:
            continue
        kept = [v for v in range(n) if v != z]
        _, shortened = rows.pop(holding[0])
        shrunk = [
            (Constraint(_without(row.polynomial, z), row.kind, row.name), count)
            for row, count in rows
        ]
        sides = ([bounds[0][v] for v in kept], [bounds[1][v] for v in kept])
        return _without(value, z), shrunk, sides, kept, shortened
    return objective, rows, bounds, list(range(n)), 0


def _solved(row: Constraint, objective: Polynomial, z: int) -> Polynomial | None:
    """Solve the row, factor z + p, for z, and put that into the objective.

    None where the row does not say the least value of z, or where that would be rounded.
    """
    weight, linear = _coefficient(objective, z)
    factor, alone = _coefficient(row.polynomial, z)
    if not (linear and alone) or abs(factor) != 1.0:  # a quotient would be rounded
        return None
    if row.kind is Kind.NONNEGATIVE and factor * weight < 0:
        return None  # the row bounds z from the other side
    rest, body = _dropped(objective, z), _dropped(row.polynomial, z)
    exact: dict[tuple[int, ...], Fraction] = {}
    for multiple, part in ((1.0, rest), (-weight * factor, body)):
        for word, number in _terms(part):
            exact[word] = exact.get(word, Fraction(0)) + Fraction(multiple) * Fraction(number)
    value = rest - (weight * factor) * body
    found = {word: Fraction(number) for word, number in _terms(value)}
    return value if found == {word: number for word, number in exact.items() if number} else None


def _terms(polynomial: Polynomial) -> Iterator[tuple[tuple[int, ...], float]]:
    """List letters without padding, and the coefficient, of each monomial."""
    for word, value in zip(
        polynomial.words.tolist(), polynomial.coefficients.tolist(), strict=True
    ):
        yield tuple(letter for letter in word if letter), value


def _coefficient(polynomial: Polynomial, z: int) -> tuple[float, bool]:
    """Return the coefficient of z, and whether z occurs in no other term."""
    holds = (polynomial.words == z + 1).any(axis=1)
    single = holds.sum() == 1 and monomials.degrees(polynomial.words[holds])[0] == 1
    return float(polynomial.coefficients[holds][0]), bool(single)


def _dropped(polynomial: Polynomial, z: int) -> Polynomial:
    """Drop the terms that hold z."""
    rest = ~(polynomial.words == z + 1).any(axis=1)
    return Polynomial.from_words(
        polynomial.words[rest],
        polynomial.coefficients[rest],
        polynomial.dimension,
        polynomial.names,
    )


def _without(polynomial: Polynomial, z: int) -> Polynomial:
    words = polynomial.words - (polynomial.words > z + 1)
    names = [name for v, name in enumerate(polynomial.names or ()) if v != z] or None
    return Polynomial.from_words(
        words.astype(np.int32), polynomial.coefficients, polynomial.dimension - 1, names
    )
