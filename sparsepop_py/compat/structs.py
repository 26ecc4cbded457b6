"""Problems in SparsePOP's own data format: structs of MATLAB, dicts of numpy arrays.

A polynomial struct has the fields ``typeCone`` (1: p >= 0, -1: p == 0, 2: second-order cone
f1 >= |(f2, ..., fk)|, 3: positive semidefinite matrix), ``sizeCone``, ``dimVar``, ``degree``,
``noTerms``, ``supports`` (noTerms x dimVar exponents) and ``coef``: one column, one for each of
f1, ..., fk, or one for each entry of the matrix, column by column. What scipy.io.loadmat makes
of such structs is read too, in all its shapes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isqrt, prod
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.exact_terms import require_doubles
from sparsepop_py.algebra.matrix_constraints import cone
from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial, total
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.errors import ProblemError, check_kind, refuse_masked
from sparsepop_py.problem.problem import Problem

__all__ = ["from_structs", "to_structs", "written_out"]

INFINITE = 1e10  # bounds of this magnitude stand for none
_MOST_DENSE = 10**8  # entries of sparse matrices that are written out
_CONES = {2: Kind.SECOND_ORDER, 3: Kind.PSD}


def from_structs(objPoly: Any, ineqPolySys: Any, lbd: Any, ubd: Any) -> Problem:
    """Build the problem of SparsePOP's four structs.

    Parameters
    ----------
    objPoly : struct, or list of at least two structs
        The objective; several polynomials are residuals, whose squares are added. A
        struct is a dict, an object with attributes, or what ``scipy.io.loadmat`` makes
        of a MATLAB struct.
    ineqPolySys : list of structs, one struct, ``[]`` or None
        The constraints; lists may be tuples, object arrays and cell arrays.
    lbd, ubd : array_like (n,)
        Bounds, row or column, dense or sparse; magnitudes of 1e10 or more are infinite.

    Returns
    -------
    Problem
        For residuals with ``squares`` given. All coefficients are kept, however small.

    Raises
    ------
    ProblemError
        Naming the field, such as ``ineqPolySys[2].degree: found 3, expected 2``
        (counted from 0). ``degree`` may be left out, ``sizeCone`` too for typeCone 1, -1.

    Examples
    --------
    >>> square = {"typeCone": 1, "dimVar": 1, "noTerms": 2, "supports": [[0], [2]],
    ...           "coef": [-2.0, 1.0]}
    >>> print(from_structs(square, [], [0], [1e10]))
    min -2 + x1^2
      0 <= x1 <= inf
    >>> line = {"typeCone": 1, "dimVar": 1, "noTerms": 1, "supports": [[1]], "coef": [1.0]}
    >>> matrix = {"typeCone": 3, "sizeCone": 2, "dimVar": 1, "degree": 1, "noTerms": 2,
    ...           "supports": [[0], [1]], "coef": [[1, 0, 0, 1], [0, 1, 1, 0]]}
    >>> print(from_structs(line, [matrix], [-1e10], [1e10]))
    min x1
      s.t. psd([[1, x1], [x1, 1]])
    """
    items = _elements(objPoly, "objPoly")
    if not items:
        raise ProblemError("objPoly: found no polynomial, expected a struct or a list of structs")
    single = len(items) == 1
    labels = ["objPoly"] if single else [f"objPoly[{i}]" for i in range(len(items))]
    parts = [_read(item, label, (1, 0, -1)) for item, label in zip(items, labels, strict=True)]
    residuals = [columns[0] for columns, _ in parts]
    n = residuals[0].dimension
    for residual, label in zip(residuals, labels, strict=True):
        _check_dimension(residual, n, label)
    objective = residuals[0] if single else total([p * p for p in residuals])
    rows = _elements(ineqPolySys, "ineqPolySys")
    constraints = [_constraint(row, f"ineqPolySys[{i}]", n) for i, row in enumerate(rows)]
    lower, upper = _bounds(lbd, "lbd", n), _bounds(ubd, "ubd", n)
    _check_bounds(lower, upper)
    lower[lower <= -INFINITE], upper[upper >= INFINITE] = -np.inf, np.inf
    squares = None if single else [(1.0, residual) for residual in residuals]
    return Problem(objective, constraints, lower, upper, squares=squares)


def to_structs(
    problem: Problem,
) -> tuple[dict[str, Any], list[dict[str, Any]], NDArray[np.float64], NDArray[np.float64]]:
    """Convert a problem to SparsePOP's four structs.

    Parameters
    ----------
    problem : Problem
        Always written as the minimisation it is stored as; names are not part of structs.

    Returns
    -------
    objPoly : dict
    ineqPolySys : list of dict
        With supports (noTerms, dimVar) and coef (noTerms, 1) as doubles, like MATLAB's; for
        cones and matrices coef is (noTerms, sizeCone) and (noTerms, sizeCone^2).
    lbd, ubd : (n,) float
        With -1e10 and 1e10 where there is no bound. A finite bound of 1e10 or more in size,
        which stands for none there, is a row instead.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> objective, rows, lbd, ubd = to_structs(sp.Problem(x * y, [x + y == 1], lower=0))
    >>> objective["supports"], rows[0]["typeCone"], lbd, ubd
    (array([[1., 1.]]), -1, array([0., 0.]), array([1.e+10, 1.e+10]))
    """
    check_kind(problem, Problem, "problem")
    rows = [_constraint_struct(row) for row in problem.constraints]
    rows += [_struct(row, 1) for row in _large_bounds(problem)]
    lower = np.where(abs(problem.lower) >= INFINITE, -INFINITE, problem.lower)
    upper = np.where(abs(problem.upper) >= INFINITE, INFINITE, problem.upper)
    return _struct(problem.objective, 1), rows, lower, upper


def _large_bounds(problem: Problem) -> Iterator[Polynomial]:
    """Write finite bounds that ``lbd`` and ``ubd`` cannot hold as polynomials >= 0."""
    n = problem.dimension
    for sign, ends in ((1.0, problem.lower), (-1.0, problem.upper)):
        for v in np.flatnonzero(np.isfinite(ends) & (abs(ends) >= INFINITE)).tolist():
            words, values = np.array([[0], [v + 1]], np.int32), np.array([-sign * ends[v], sign])
            yield Polynomial.from_words(words, values, n)


def _constraint_struct(row: Constraint) -> dict[str, Any]:
    if not row.kind.is_matrix:
        return _struct(row.polynomial, -1 if row.kind is Kind.ZERO else 1)
    if row.kind is Kind.SECOND_ORDER:
        return _struct_of(row.entries, 2, row.side)
    square = range(row.side)
    entries = [row.entries[row.position(i, j) or 0] for j in square for i in square]
    return _struct_of(entries, 3, row.side)


def _struct(polynomial: Polynomial, cone: int) -> dict[str, Any]:
    return _struct_of([polynomial], cone, 1)


def _struct_of(columns: Sequence[Polynomial], cone: int, size: int) -> dict[str, Any]:
    """Build the struct whose ``coef`` has one column for each polynomial."""
    n = columns[0].dimension
    system = PolynomialSystem.stack(columns, n)
    words, number = monomials.collect(system.words, n)
    if not words.shape[0]:  # SparsePOP has no empty polynomial: zero is one term
        words = np.zeros((1, 1), np.int32)
    values = np.zeros((words.shape[0], len(columns)))
    values[number, system.row] = system.coefficients
    return {
        "typeCone": cone,
        "sizeCone": size,
        "dimVar": n,
        "degree": int(monomials.degrees(words).max()),
        "noTerms": words.shape[0],
        "supports": monomials.to_exponents(words, n).toarray().astype(float),
        "coef": values,
    }


# ---- containers -------------------------------------------------------------------------


def _elements(given: Any, label: str) -> list[Any]:
    """List the structs of a list, cell array, struct array or single struct."""
    if _is_sparse(given):  # some of them are mappings too
        raise ProblemError(f"{label}: found {_kind(given)}, expected a struct or a list of structs")
    if given is None or (isinstance(given, Mapping) and not given):
        return []
    if isinstance(given, (list, tuple)):
        return list(given)
    if isinstance(given, np.ndarray):
        if given.dtype.names is not None or given.dtype == object:
            return list(given.ravel())
        if given.size == 0:
            return []
    if isinstance(given, (str, bytes, float, int, np.ndarray, np.number)):
        raise ProblemError(f"{label}: found {_kind(given)}, expected a struct or a list of structs")
    return [given]


def _kind(item: Any) -> str:
    if _is_sparse(item):
        return f"a sparse matrix of {' x '.join(map(str, item.shape))}"
    return f"an array of {item.dtype}" if isinstance(item, np.ndarray) else type(item).__name__


@dataclass(frozen=True, slots=True)
class _Struct:
    """One struct, whatever it is made of."""

    item: Any
    label: str

    def error(self, field: str, found: Any, expected: str) -> ProblemError:
        return ProblemError(f"{self.label}.{field}: found {found}, expected {expected}")

    def get(self, field: str) -> Any:
        """Read the value of a field, None if it is absent or empty."""
        if isinstance(self.item, Mapping):
            value = self.item.get(field)
        elif isinstance(self.item, np.void):
            value = self.item[field] if field in (self.item.dtype.names or ()) else None
        else:
            value = getattr(self.item, field, None)
        while isinstance(value, np.ndarray) and value.dtype == object and value.size == 1:
            value = value.ravel()[0]
        return value

    def required(self, field: str) -> Any:
        value = self.get(field)
        if value is None:
            raise self.error(field, "nothing", "a value: the field is missing")
        return value

    def integer(self, field: str) -> int:
        value = _array(self.required(field), f"{self.label}.{field}")
        if value.size != 1:
            raise self.error(field, f"{value.size} values", "one integer")
        number = float(value.ravel()[0])
        if not number.is_integer():
            raise self.error(field, number, "an integer")
        return int(number)

    def optional(self, field: str, default: int) -> int:
        value = self.get(field)
        if value is None or _array(value, f"{self.label}.{field}").size == 0:
            return default
        return self.integer(field)


def _is_sparse(value: Any) -> bool:
    return sps.issparse(value)


def _is_complex(value: Any) -> bool:
    try:
        return bool(np.iscomplexobj(value))
    except (ValueError, RuntimeError):  # rows of several lengths, lists in lists in lists
        return False


def written_out(value: Any, label: str) -> Any:
    """Return a sparse matrix as an array with its zeros, anything else as it is.

    Raises
    ------
    ProblemError
        If it has too many entries.
    """
    if not _is_sparse(value):
        return value
    if prod(value.shape) > _MOST_DENSE:
        raise ProblemError(f"{label}: found {_kind(value)}, expected at most {_MOST_DENSE} entries")
    return value.toarray()


def _array(value: Any, label: str) -> NDArray[np.float64]:
    """Dense copy as doubles; numbers that are none are refused."""
    dense = written_out(value, label)
    refuse_masked(dense, label)
    try:
        array = np.asarray(dense)
        if array.dtype.kind not in "biuf":
            raise TypeError
        doubles = array.astype(float)
    except (TypeError, ValueError, OverflowError, RuntimeError):  # RecursionError too
        found = "complex numbers" if _is_complex(dense) else _kind(value)
        raise ProblemError(f"{label}: found {found}, expected real numbers") from None
    require_doubles(dense, label)
    return doubles


# ---- polynomials ------------------------------------------------------------------------


def _read(item: Any, label: str, legal: tuple[int, ...]) -> tuple[list[Polynomial], int]:
    """Read the polynomial of each column of ``coef``, and typeCone; check every field."""
    while isinstance(item, np.ndarray) and item.size == 1:  # a struct in a cell
        item = item.ravel()[0]
    wrong = (list, tuple, str, float, int, np.ndarray, np.number)
    if item is None or isinstance(item, wrong) or _is_sparse(item):
        raise ProblemError(f"{label}: found {_kind(item)}, expected a polynomial struct")
    struct = _Struct(item, label)
    typed = struct.integer("typeCone")
    if typed not in legal:
        raise struct.error("typeCone", typed, "1" if 0 in legal else "1, -1, 2 or 3")
    size = struct.optional("sizeCone", 1)
    if typed in _CONES and size < 2:
        raise struct.error("sizeCone", size, f"at least 2 for typeCone {typed}")
    if typed not in _CONES and size != 1:
        raise struct.error("sizeCone", size, f"1 for typeCone {typed}")
    n, terms = struct.integer("dimVar"), struct.integer("noTerms")
    if n < 1:
        raise struct.error("dimVar", n, "a positive integer")
    supports = _supports(struct, n, terms)
    if typed in _CONES:
        coefficients = _columns(struct, terms, size, typed)
    else:
        coefficients = _coefficients(struct, terms)[:, None]
    degree = int(supports.sum(axis=1).max(initial=0))
    stated = struct.optional("degree", degree)
    if stated != degree:
        raise struct.error("degree", stated, f"{degree}, the largest row sum of supports")
    words = monomials.from_exponents(supports)
    _check_distinct(struct, words, n)
    return [Polynomial._merged(words, column, n) for column in coefficients.T], typed


def _supports(struct: _Struct, n: int, terms: int) -> sps.csr_array:
    """Exponents (noTerms, dimVar); a copy, so that sorting leaves the input as it is."""
    given = struct.required("supports")
    if _is_sparse(given) and given.ndim == 2:
        if given.dtype.kind not in "biuf":
            raise struct.error("supports", f"a matrix of {given.dtype}", "real numbers")
        matrix = sps.csr_array(given, copy=True).astype(float)
        matrix.sum_duplicates()
    else:
        array = _array(given, f"{struct.label}.supports")
        if array.ndim < 2:  # one dimension was dropped: a column of powers, or one row
            array = array.reshape((-1, 1) if n == 1 else (1, -1) if array.size else (0, n))
        if array.ndim > 2:
            raise struct.error("supports", f"{array.ndim} dimensions", "a matrix")
        _check_exponents(struct, array.ravel())
        matrix = sps.csr_array(array)
    _check_exponents(struct, matrix.data)
    if matrix.shape[1] != n and not (terms == 0 and matrix.shape[0] == 0):
        raise struct.error("supports", f"{matrix.shape[1]} columns", f"{n}, which is dimVar")
    if matrix.shape[0] != terms:
        raise struct.error("noTerms", terms, f"{matrix.shape[0]}, the rows of supports")
    return sps.csr_array(matrix.astype(np.int64).reshape((terms, n)))


def _check_exponents(struct: _Struct, values: NDArray[Any]) -> None:
    wrong = values[~monomials.are_exponents(values)]
    if wrong.size:
        expected = f"non-negative integers up to {monomials.LARGEST_POWER}"
        raise struct.error("supports", f"the exponent {wrong[0]:g}", expected)


def _coefficients(struct: _Struct, terms: int) -> NDArray[np.float64]:
    values = _array(struct.required("coef"), f"{struct.label}.coef")
    if values.size != terms or sum(length > 1 for length in values.shape) > 1:
        shape = " x ".join(map(str, values.shape)) or "1"
        raise struct.error("coef", f"{shape} values", f"{terms}, which is noTerms")
    values = values.ravel()
    if not np.all(np.isfinite(values)):
        raise struct.error("coef", values[~np.isfinite(values)][0], "finite numbers")
    return values


def _columns(struct: _Struct, terms: int, size: int, cone: int) -> NDArray[np.float64]:
    """Coefficients (noTerms, sizeCone or sizeCone^2) of a cone or a symmetric matrix."""
    values = _array(struct.required("coef"), f"{struct.label}.coef")
    count = size if cone == 2 else size**2
    if values.ndim == 1 and terms == 1:  # one dimension was dropped
        values = values[None]
    if values.shape != (terms, count) and not values.size == terms == 0:
        found = " x ".join(map(str, values.shape))
        expected = f"noTerms x {'sizeCone' if cone == 2 else 'sizeCone^2'}"
        raise struct.error("coef", f"{found} values", f"{terms} x {count}, which is {expected}")
    values = values.reshape(terms, count)
    if not np.all(np.isfinite(values)):
        raise struct.error("coef", values[~np.isfinite(values)][0], "finite numbers")
    if cone == 3:
        square = values.reshape(terms, size, size)
        wrong = np.flatnonzero((square != square.transpose(0, 2, 1)).any(axis=(1, 2)))
        if wrong.size:
            raise struct.error(
                "coef", f"row {wrong[0] + 1}, which is not symmetric", "symmetric matrices"
            )
    return values


def _check_distinct(struct: _Struct, words: monomials.Words, n: int) -> None:
    unique, where = monomials.collect(words, n)
    if unique.shape[0] < words.shape[0]:
        number = int(np.flatnonzero(np.bincount(where) > 1)[0])
        first, second = (int(row) + 1 for row in np.flatnonzero(where == number)[:2])
        raise struct.error("supports", f"equal rows {first} and {second}", "distinct rows")


def _constraint(item: Any, label: str, n: int) -> Constraint:
    columns, typed = _read(item, label, (1, -1, *_CONES))
    _check_dimension(columns[0], n, label)
    if typed == 2:
        return cone(Kind.SECOND_ORDER, columns)
    if typed == 3:
        size = isqrt(len(columns))
        return cone(Kind.PSD, [columns[i * size + j] for i in range(size) for j in range(i + 1)])
    return Constraint(columns[0], Kind.ZERO if typed == -1 else Kind.NONNEGATIVE)


def _check_dimension(polynomial: Polynomial, n: int, label: str) -> None:
    if polynomial.dimension != n:
        raise ProblemError(f"{label}.dimVar: found {polynomial.dimension}, expected {n}")


# ---- bounds -----------------------------------------------------------------------------


def _bounds(given: Any, label: str, n: int) -> NDArray[np.float64]:
    values = _array(given, label)
    if values.size != n or sum(length > 1 for length in values.shape) > 1:
        raise ProblemError(f"{label}: found {values.size} values, expected {n}, one a variable")
    values = values.ravel()
    if np.any(np.isnan(values)):
        where = int(np.flatnonzero(np.isnan(values))[0]) + 1
        raise ProblemError(f"{label}: found NaN for variable {where}, expected a number")
    return values


def _check_bounds(lower: NDArray[np.float64], upper: NDArray[np.float64]) -> None:
    wrong = np.flatnonzero((lower > upper) | (lower >= INFINITE) | (upper <= -INFINITE))
    if wrong.size:
        v = int(wrong[0])
        raise ProblemError(
            f"lbd, ubd: found [{lower[v]:g}, {upper[v]:g}] for variable {v + 1}, "
            "expected lbd <= ubd, lbd < 1e10 and ubd > -1e10"
        )
