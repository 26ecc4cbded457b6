"""Sparse real polynomials and the constraints that comparisons of them make.

A :class:`Polynomial` is a frozen pair of arrays: words (see
:mod:`sparsepop_py.algebra.monomials`) and coefficients. Arithmetic merges equal
monomials with one sort, so 10^5 terms in 10^4 variables take milliseconds;
many terms are added in one pass by :func:`total`. Where doubles cannot hold a sum or a
product, a polynomial remembers its exact terms (:mod:`sparsepop_py.algebra.exact_terms`), and
further arithmetic goes on from those. The file is long, as constraints are what comparisons of
polynomials return: neither class is whole without the other.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from fractions import Fraction
from functools import cached_property
from math import isqrt
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import ArrayLike, NDArray

from sparsepop_py.algebra import exact_terms, monomials
from sparsepop_py.algebra.exact_terms import ExactTerms, Grid, exact_fraction
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.errors import ProblemError, check_kind, check_whole, doubles, entries_of, shown

__all__ = ["Constraint", "Kind", "Polynomial", "polynomials_of", "total", "variables"]


class Kind(Enum):
    """Kinds of constraints on a polynomial p or a matrix G.

    ``NONNEGATIVE`` is p >= 0 and ``ZERO`` is p == 0. ``SECOND_ORDER`` is p >= |(f2, ..., fk)|,
    the Euclidean norm, as :func:`second_order` makes it. ``PSD`` is a matrix G of polynomials that
    has to be positive semidefinite, as :func:`psd` makes it.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, = sp.variables(1)
    >>> (x == 1).kind, (x >= 1).kind.is_matrix
    (<Kind.ZERO: 'p == 0'>, False)
    """

    NONNEGATIVE = "p >= 0"
    ZERO = "p == 0"
    SECOND_ORDER = "p >= |(f2, ..., fk)|"
    PSD = "G positive semidefinite"

    @property
    def is_matrix(self) -> bool:
        """True if a matrix of polynomials has to be positive semidefinite."""
        return self in (Kind.SECOND_ORDER, Kind.PSD)


@dataclass(frozen=True, eq=False)
class Constraint:
    """Constraint: a polynomial non-negative or zero, or a semidefinite matrix.

    Comparisons of polynomials make constraints; ``bool()`` of one raises, so that
    ``0 <= x <= 1`` cannot silently lose half of itself. Matrices are made by
    :func:`sparsepop_py.second_order` and :func:`sparsepop_py.psd`.

    Parameters
    ----------
    polynomial : Polynomial
        With a matrix: a polynomial that follows from it and is asked for as well, ``p >= 0``.
    kind : Kind
    name : str
        Used in messages; empty when not given.
    entries : tuple of Polynomial
        Of a matrix: the axis f1 and the rest f2, ..., fk of a second-order cone, or the
        lower triangle of G row by row. Else empty.

    Raises
    ------
    ProblemError
        If a field has another type, or kind and entries do not belong together.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> constraint = x**2 + y**2 <= 1
    >>> print(constraint)
    1 - x1^2 - x2^2 >= 0
    >>> constraint.degree, constraint.side
    (2, 0)
    """

    polynomial: Polynomial
    kind: Kind
    name: str = ""
    entries: tuple[Polynomial, ...] = ()

    def __post_init__(self) -> None:
        self._check_types()
        count = len(self.entries)
        if not self.kind.is_matrix:
            if count:
                raise ProblemError(f"entries: found {count} for {self.kind.name}, expected none")
        elif self.side < 2:
            raise ProblemError(f"entries: found {count}, expected those of a matrix: use psd()")
        elif self.kind is Kind.PSD and count != self.side * (self.side + 1) // 2:
            raise ProblemError(f"entries: found {count}, expected a lower triangle")

    def _check_types(self) -> None:
        if not isinstance(self.kind, Kind):
            raise ProblemError(f"kind: found {shown(self.kind)}, expected a Kind")
        if not isinstance(self.name, str):
            raise ProblemError(f"name: found {shown(self.name)}, expected a string")
        if not isinstance(self.entries, tuple):
            if not isinstance(self.entries, Iterable):
                raise ProblemError(f"entries: found {shown(self.entries)}, expected Polynomials")
            self.__dict__["entries"] = tuple(self.entries)
        for p in (self.polynomial, *self.entries):
            if not isinstance(p, Polynomial):
                raise ProblemError(
                    f"polynomial, entries: found {type(p).__name__}, expected a Polynomial"
                )
            if p.dimension != self.polynomial.dimension:
                raise ProblemError(
                    f"entries: found {p.dimension} variables, expected {self.polynomial.dimension}"
                )

    @property
    def side(self) -> int:
        """Number of rows of the matrix, 0 without one."""
        if self.kind is Kind.PSD:
            return (isqrt(8 * len(self.entries) + 1) - 1) // 2
        return len(self.entries)

    @property
    def degree(self) -> int:
        """Largest degree of the polynomial and of all entries."""
        return max(p.degree for p in (self.polynomial, *self.entries))

    def position(self, i: int, j: int) -> int | None:
        """Locate row i and column j of the matrix in ``entries``.

        A second-order cone is the matrix with f1 on its diagonal and f2, ..., fk beside it
        in the first row and column: its least eigenvalue is f1 - |(f2, ..., fk)|.

        Parameters
        ----------
        i, j : int
            From 0 to ``side - 1``. The matrix is symmetric: i and j may be exchanged.

        Returns
        -------
        int or None
            The place in ``entries``, from 0; None for an entry that is zero.

        Raises
        ------
        ProblemError
            If i or j is no row of the matrix.

        Examples
        --------
        >>> import sparsepop_py as sp
        >>> x, y = sp.variables(2)
        >>> cone = sp.second_order(2, x, y)  # [[2, x1, x2], [x1, 2, 0], [x2, 0, 2]]
        >>> [[cone.position(i, j) for j in range(3)] for i in range(3)]
        [[0, 1, 2], [1, 0, None], [2, None, 0]]
        """
        last = self.side - 1
        i, j = check_whole(i, "i", 0, last), check_whole(j, "j", 0, last)
        i, j = max(i, j), min(i, j)
        if self.kind is Kind.PSD:
            return i * (i + 1) // 2 + j
        if i == j:
            return 0
        return i if j == 0 else None

    def __bool__(self) -> bool:
        raise ProblemError("a constraint has no truth value: write 0 <= x <= 1 as two constraints")

    def __str__(self) -> str:
        label = f"{self.name}: " if self.name else ""
        if self.kind is Kind.SECOND_ORDER:
            return f"{label}second_order({', '.join(map(str, self.entries))})"
        if self.kind is Kind.PSD:
            rows = [
                ", ".join(str(self.entries[self.position(i, j) or 0]) for j in range(self.side))
                for i in range(self.side)
            ]
            return f"{label}psd([{', '.join(f'[{row}]' for row in rows)}])"
        relation = "==" if self.kind is Kind.ZERO else ">="
        return f"{label}{self.polynomial} {relation} 0"


def _frozen(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array


@dataclass(frozen=True, eq=False, repr=False, slots=False)
class Polynomial(ReadOnly):
    """Real polynomial in ``dimension`` variables, sparse and immutable.

    Build one with :func:`variables` and arithmetic, :meth:`from_terms`, or
    :func:`sparsepop_py.parse`. Arithmetic is exact, and each coefficient is the double next to
    what was written, see :attr:`exact`.

    Parameters
    ----------
    words : (T, D) int32
        Distinct monomials in graded order, each a row of its variables in ascending order after
        zeros (see :mod:`sparsepop_py.algebra.monomials`). Copied.
    coefficients : (T,) float
        Their coefficients, finite and not zero. Copied.
    dimension : int
        Number of variables n.
    names : tuple of str, optional
        Names of the variables, used for printing.

    Raises
    ------
    ProblemError
        If an array is anything else; :meth:`from_words` sorts and merges monomials.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x1, x2 = sp.variables(2)
    >>> p = (x1 - 2) ** 2 + x1 * x2
    >>> print(p)
    4 - 4*x1 + x1^2 + x1*x2
    >>> p([1.0, 3.0])
    4.0
    """

    words: Words
    coefficients: NDArray[np.float64]
    dimension: int
    names: tuple[str, ...] | None = field(default=None)

    __array_ufunc__ = None  # numpy scalars and arrays leave the arithmetic to us
    __hash__ = object.__hash__

    # ---- construction -------------------------------------------------------------------

    def __post_init__(self) -> None:
        words, values = _checked_terms(self.words, self.coefficients, self.dimension)
        words = monomials.trim(words).copy()
        if words.size:
            keys = monomials.pack(words, self.dimension)
            if not np.all(keys[1:] > keys[:-1]):
                raise ProblemError(
                    "words: found equal monomials or none in graded order, expected distinct "
                    "ones in that order (Polynomial.from_words sorts and merges)"
                )
        if not np.all(values):
            raise ProblemError("coefficients: found 0.0, expected none (from_words drops them)")
        values = values.copy()
        names = _checked_labels(self.names, int(self.dimension))
        fields = {"words": _frozen(words), "coefficients": _frozen(values)}
        self.__dict__.update(fields, dimension=int(self.dimension), names=names)

    @staticmethod
    def _of_sorted(
        words: Words,
        coefficients: NDArray[np.float64],
        dimension: int,
        names: tuple[str, ...] | None = None,
    ) -> Polynomial:
        """Make a polynomial of arrays that are what the class asks for, without a copy."""
        made = object.__new__(Polynomial)
        words.flags.writeable = coefficients.flags.writeable = False
        made.__dict__.update(
            words=words, coefficients=coefficients, dimension=dimension, names=names
        )
        return made

    @staticmethod
    def from_words(
        words: Words,
        coefficients: NDArray[np.float64],
        dimension: int,
        names: Sequence[str] | None = None,
    ) -> Polynomial:
        """Merge equal monomials and drop those with coefficient zero.

        Parameters
        ----------
        words : (T, D) int
            Monomials, each a row of its variables (from 1) in ascending order after zeros.
        coefficients : (T,) float
        dimension : int
            Number of variables n.
        names : sequence of str, optional

        Returns
        -------
        Polynomial
            Without zero coefficients, with read-only arrays.

        Raises
        ------
        ProblemError
            If an array is anything else, or a coefficient is not finite.

        Examples
        --------
        >>> import sparsepop_py as sp
        >>> words = np.array([[1, 2], [0, 0], [1, 2]])
        >>> print(sp.Polynomial.from_words(words, np.array([1.0, 4.0, 2.0]), 2))
        4 + 3*x1*x2
        """
        words, values = _checked_terms(words, coefficients, dimension)
        labels = _checked_labels(names, int(dimension))
        return Polynomial._merged(words, values, int(dimension), labels)

    @staticmethod
    def _merged(
        words: Words,
        coefficients: NDArray[np.float64],
        dimension: int,
        names: tuple[str, ...] | None = None,
    ) -> Polynomial:
        """As :meth:`from_words`, without a check of the words; sums are rounded once."""
        if not np.all(np.isfinite(coefficients)):
            bad = coefficients[~np.isfinite(coefficients)][0]
            raise ProblemError(f"coefficients: found {bad}, expected finite numbers")
        words = monomials.trim(words)
        unique, where = monomials.collect(words, dimension)
        if unique.shape[0] < words.shape[0]:
            if not exact_terms.held(*exact_terms.grid_of(coefficients)):
                terms = ExactTerms.of_doubles(words, coefficients)
                return Polynomial._of_exact(ExactTerms.added([terms], dimension), dimension, names)
        return Polynomial._added(unique, where, coefficients, dimension, names)

    @staticmethod
    def _added(
        unique: Words,
        where: NDArray[np.int64],
        coefficients: NDArray[np.float64],
        dimension: int,
        names: tuple[str, ...] | None,
    ) -> Polynomial:
        """Add up the coefficients of equal monomials where doubles hold all sums."""
        sums = np.bincount(where, weights=coefficients, minlength=unique.shape[0]).astype(float)
        if np.count_nonzero(sums) < sums.size:
            keep = sums != 0.0
            unique, sums = monomials.trim(unique[keep]), sums[keep]
        return Polynomial._of_sorted(unique, sums, dimension, names)

    @staticmethod
    def _on_grid_merged(
        words: Words,
        coefficients: NDArray[np.float64],
        dimension: int,
        names: tuple[str, ...] | None,
        grid: Grid,
    ) -> Polynomial:
        """As :meth:`_merged`, of finite numbers on a grid whose sums doubles hold."""
        unique, where = monomials.collect(monomials.trim(words), dimension)
        return Polynomial._added(unique, where, coefficients, dimension, names)._on(grid)

    @staticmethod
    def _of_exact(
        terms: ExactTerms, dimension: int, names: tuple[str, ...] | None = None
    ) -> Polynomial:
        """Round each coefficient once, and remember the terms if that changed one."""
        values = terms.rounded()
        keep = values != 0.0
        words = terms.words if np.all(keep) else monomials.trim(terms.words[keep])
        made = Polynomial._of_sorted(words, values[keep], dimension, names)
        if not terms.are_doubles(values):
            made.__dict__["_exact"] = terms
        return made

    @property
    def exact(self) -> ExactTerms | None:
        """Terms before their coefficients were rounded, None where doubles hold them all.

        A :class:`sparsepop_py.Problem` is about ``coefficients``, and says in ``rounding``
        what was rounded.
        """
        found: ExactTerms | None = self.__dict__.get("_exact")
        return found

    @property
    def fractions(self) -> list[Fraction]:
        """Exact coefficients, in the order of the words of :attr:`exact`, else of ``words``."""
        return self._terms().fractions

    def _terms(self) -> ExactTerms:
        """The exact terms."""
        return self.exact or ExactTerms.of_doubles(self.words, self.coefficients)

    def as_rounded(self) -> Polynomial:
        """Return the polynomial whose coefficients are these doubles, without memory.

        Returns
        -------
        Polynomial
            The same object where nothing was rounded.
        """
        if self.exact is None:
            return self
        return self._with(self.coefficients)

    def _with(self, values: NDArray[np.float64]) -> Polynomial:
        """The same monomials with other coefficients."""
        return Polynomial._of_sorted(self.words, values, self.dimension, self.names)

    @property
    def _grid(self) -> Grid:
        """A grid that holds the coefficients, perhaps coarser than needed."""
        found: Grid | None = self.__dict__.get("_on_grid")
        return self._tight_grid() if found is None else found

    def _tight_grid(self) -> Grid:
        found = exact_terms.grid_of(self.coefficients)
        self.__dict__["_on_grid"] = found
        return found

    def _on(self, grid: Grid) -> Polynomial:
        """Remember a grid that holds the coefficients."""
        self.__dict__["_on_grid"] = grid
        return self

    def within(self, dimension: int, names: Sequence[str] | None = None) -> Polynomial:
        """Restate the polynomial in another number of variables.

        Parameters
        ----------
        dimension : int
            Number of variables n, at least the largest one that occurs.
        names : sequence of str, optional
            Names of all n variables.

        Returns
        -------
        Polynomial
            With the same terms.

        Raises
        ------
        ProblemError
            If a variable that occurs is beyond n, or the names are not n distinct ones.

        Examples
        --------
        >>> import sparsepop_py as sp
        >>> x, y = sp.variables(2)
        >>> (x * y).within(5).dimension
        5
        """
        least = int(self.words.max(initial=0))
        whole = isinstance(dimension, numbers.Integral) and not isinstance(dimension, bool)
        if not whole or not max(least, 1) <= dimension < 2**31 - 1:
            raise ProblemError(
                f"dimension: found {shown(dimension)}, expected a number of variables, "
                f"{max(least, 1)} or more"
            )
        labels = _checked_labels(names, int(dimension))
        made = Polynomial._of_sorted(self.words, self.coefficients, int(dimension), labels)
        if self.exact is not None:
            made.__dict__["_exact"] = self.exact
        return made

    @staticmethod
    def from_terms(
        exponents: ArrayLike | sps.sparray | sps.spmatrix,
        coefficients: ArrayLike,
        names: Sequence[str] | None = None,
    ) -> Polynomial:
        """Build a polynomial from a matrix of exponents and coefficients.

        Parameters
        ----------
        exponents : (T, n) array_like or sparse
            Non-negative integers, one row a term and one column a variable.
        coefficients : (T,) array_like
            One number a term. Terms with equal exponents are added.
        names : sequence of str, optional
            n distinct names; ``x1`` ... ``xn`` when left out.

        Returns
        -------
        Polynomial

        Raises
        ------
        ProblemError
            If exponents are negative or fractional, or the lengths differ.

        Examples
        --------
        >>> import sparsepop_py as sp
        >>> print(sp.Polynomial.from_terms([[2, 0], [0, 1]], [1, -3]))
        -3*x2 + x1^2
        """
        values = np.atleast_1d(doubles(coefficients, "coefficients").copy()).ravel()
        exact_terms.require_doubles(coefficients, "coefficients")
        matrix = _exponent_table(exponents)
        if matrix.shape[0] != values.size:
            raise ProblemError(
                f"coefficients: found {values.size}, expected {matrix.shape[0]}, one a row"
            )
        bad = ~monomials.are_exponents(matrix.data)
        if np.any(bad):
            raise ProblemError(
                f"exponents: found {matrix.data[bad][0]:g}, expected non-negative integers "
                f"up to {monomials.LARGEST_POWER}"
            )
        names = _checked_labels(names, int(matrix.shape[1]))
        words = monomials.from_exponents(matrix)
        return Polynomial._merged(
            words, values, int(matrix.shape[1]), tuple(names) if names is not None else None
        )

    def _constant(self, value: float) -> Polynomial:
        word = np.zeros((1, 1), np.int32)
        made = Polynomial._merged(word, np.array([value], float), self.dimension, self.names)
        return made._on(exact_terms.grid_of_number(value))

    def _rational(self, value: Fraction) -> Polynomial:
        word = np.zeros((1, 1), np.int32)
        terms = ExactTerms.of_fractions(word, [value], self.dimension)
        return Polynomial._of_exact(terms, self.dimension, self.names)

    def _operand(self, other: Any) -> Polynomial | None:
        if isinstance(other, Polynomial):
            if other.dimension != self.dimension:
                raise ProblemError(
                    f"polynomials of {self.dimension} and {other.dimension} variables "
                    "do not combine: make both from the same variables()"
                )
            return other
        if isinstance(other, numbers.Real):
            exact = exact_fraction(other)
            return self._constant(float(other)) if exact is None else self._rational(exact)
        return None

    # ---- views --------------------------------------------------------------------------

    @cached_property
    def exponents(self) -> sps.csr_array:
        """Exponents as a sparse integer matrix (T, n), rows in graded order."""
        return monomials.to_exponents(self.words, self.dimension)

    @property
    def degree(self) -> int:
        """Total degree; 0 for constants and for the zero polynomial."""
        if self.words.shape[1] == 1:  # a fast answer for linear rows, of which there are many
            return int(self.words.any())
        return int(monomials.degrees(self.words).max(initial=0))

    @property
    def terms(self) -> int:
        """Number of terms T."""
        return self.coefficients.size

    @cached_property
    def support(self) -> NDArray[np.int64]:
        """Sorted indices (from 0) of the variables that occur."""
        letters = monomials.distinct(self.words)
        return letters[letters > 0].astype(np.int64) - 1

    @property
    def constant_term(self) -> float:
        """Coefficient of the constant monomial."""
        if self.terms and not self.words[0].any():
            return float(self.coefficients[0])
        return 0.0

    def __call__(self, x: ArrayLike) -> Any:
        """Evaluate at ``x``: (n,) gives a float, (N, n) an array (N,)."""
        points = doubles(x, "x")
        if points.ndim not in (1, 2) or points.shape[-1] != self.dimension:
            raise ProblemError(
                f"x: found shape {points.shape}, expected ({self.dimension},) "
                f"or (N, {self.dimension})"
            )
        with np.errstate(over="ignore", invalid="ignore"):  # inf or NaN where doubles end
            values = monomials.evaluate(self.words, points) @ self.coefficients
        return float(values) if points.ndim == 1 else values

    # ---- arithmetic ---------------------------------------------------------------------

    def __add__(self, other: Any) -> Polynomial:
        right = self._operand(other)
        return NotImplemented if right is None else total([self, right])

    __radd__ = __add__

    def __neg__(self) -> Polynomial:
        return self._scaled(-1.0)

    def __sub__(self, other: Any) -> Polynomial:
        right = self._operand(other)
        return NotImplemented if right is None else total([self, -right])

    def __rsub__(self, other: Any) -> Polynomial:
        left = self._operand(other)
        return NotImplemented if left is None else total([left, -self])

    def _scaled(self, factor: float) -> Polynomial:
        if not math.isfinite(factor) or factor == 0.0:
            return self._scaled_doubles(factor)
        if self.exact is None:
            number = exact_terms.grid_of_number(factor)
            grid = _held_product(self._grid, number) or _held_product(self._tight_grid(), number)
            if grid is not None:
                values = self.coefficients * factor
                return self._with(values)._on(grid)
            if abs(factor) == 1.0:
                return self._scaled_doubles(factor)
        return self._times_fraction(Fraction(factor))

    def _times_fraction(self, factor: Fraction) -> Polynomial:
        if not factor:
            return self._scaled_doubles(0.0)
        return Polynomial._of_exact(self._terms().scaled(factor), self.dimension, self.names)

    def _scaled_doubles(self, factor: float) -> Polynomial:
        with np.errstate(over="ignore", under="ignore"):
            values = self.coefficients * factor
        if factor == 0.0 or not np.all(np.isfinite(values)) or not np.all(values):
            return Polynomial._merged(self.words, values, self.dimension, self.names)
        return Polynomial._of_sorted(self.words, values, self.dimension, self.names)

    def __mul__(self, other: Any) -> Polynomial:
        if isinstance(other, numbers.Real):
            exact = exact_fraction(other)
            return self._scaled(float(other)) if exact is None else self._times_fraction(exact)
        right = self._operand(other)
        if right is None:
            return NotImplemented
        self._check_product(right)
        grid = self._product_grid(right)
        if grid is None:
            terms = self._terms().times(right._terms(), self.dimension)
            return Polynomial._of_exact(terms, self.dimension, self.names or right.names)
        words = monomials.multiply(self.words[:, None, :], right.words[None, :, :])
        values = self.coefficients[:, None] * right.coefficients[None, :]
        words = words.reshape(values.size, words.shape[-1])
        names = self.names or right.names
        return Polynomial._on_grid_merged(words, values.ravel(), self.dimension, names, grid)

    def _check_product(self, right: Polynomial) -> None:
        """Check before multiplying that a product has not too many or too long terms."""
        (left_terms, left_width), (right_terms, right_width) = self.words.shape, right.words.shape
        if left_width + right_width > monomials.LARGEST_POWER:
            raise ProblemError(
                f"product: found degree {left_width + right_width}, expected at most "
                f"{monomials.LARGEST_POWER}"
            )
        letters = left_terms * right_terms * (left_width + right_width)
        if letters > monomials.LARGEST_PRODUCT:
            raise ProblemError(
                f"product: found {left_terms} terms of degree {self.degree} times {right_terms} "
                f"of degree {right.degree}, which take {4e-9 * letters:.2g} GB, expected at most "
                f"{4e-9 * monomials.LARGEST_PRODUCT:g} GB"
            )

    def _product_grid(self, right: Polynomial) -> Grid | None:
        """Find a grid on which doubles hold the product, None if there is none."""
        if self.exact is not None or right.exact is not None:
            return None
        grid = _held_product(self._grid, right._grid)
        return grid or _held_product(self._tight_grid(), right._tight_grid())

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        """Divide by a number (a Polynomial) or by a Polynomial (a Rational)."""
        if not isinstance(other, numbers.Real):
            return self._over(self, other) if isinstance(other, Polynomial) else NotImplemented
        if other == 0:
            raise ProblemError("division of a polynomial by zero")
        exact, divisor = exact_fraction(other), float(other)
        if not math.isfinite(divisor):
            raise ProblemError(f"division of a polynomial by {other}")
        if exact is None and abs(math.frexp(divisor)[0]) == 0.5 and abs(divisor) >= 1:
            return self._scaled(1.0 / divisor)  # a power of two
        return self._times_fraction(1 / (exact or Fraction(divisor)))

    def __rtruediv__(self, other: Any) -> Any:
        return self._over(other, self) if isinstance(other, numbers.Real) else NotImplemented

    @staticmethod
    def _over(numerator: Any, denominator: Polynomial) -> Any:
        from sparsepop_py.algebra.rational import ratio  # ratios are made of polynomials

        if denominator.degree == 0 and denominator.terms:
            return numerator / denominator.constant_term
        return ratio(numerator, denominator)

    def __pow__(self, power: Any) -> Polynomial:
        try:
            whole = isinstance(power, numbers.Real) and not power < 0 and float(power) % 1 == 0
        except OverflowError:
            whole = False
        if not whole:
            raise ProblemError(f"exponent: found {shown(power)}, expected a non-negative integer")
        result, base, left = self._constant(1.0), self, int(float(power))
        while left:
            if left & 1:
                result = result * base
            left >>= 1
            if left:
                base = base * base
        return result

    def derivative(self, variable: int) -> Polynomial:
        """Differentiate with respect to one variable.

        Parameters
        ----------
        variable : int
            Its index, from 0: 0 for ``x1``.

        Returns
        -------
        Polynomial
            In the same n variables.

        Raises
        ------
        ProblemError
            If there is no such variable.

        Examples
        --------
        >>> import sparsepop_py as sp
        >>> x, y = sp.variables(2)
        >>> print((x**2 * y).derivative(0))
        2*x1*x2
        """
        letter = check_whole(variable, "variable", 0, self.dimension - 1) + 1
        terms = self.exact
        words = self.words if terms is None else terms.words
        power = np.count_nonzero(words == letter, axis=1)
        rows = np.flatnonzero(power)
        power, words = power[rows], words[rows].copy()
        words[np.arange(rows.size), np.argmax(words == letter, axis=1)] = 0
        words.sort(axis=1)
        if terms is None:
            grid = _held_product(self._grid, (0, float(power.max(initial=0))))
            if grid is not None:
                values = self.coefficients[rows] * power
                n, names = self.dimension, self.names
                return Polynomial._on_grid_merged(words, values, n, names, grid)
            terms = self._terms()
        found = terms.differentiated(rows, power, words, self.dimension)
        return Polynomial._of_exact(found, self.dimension, self.names)

    # ---- comparisons make constraints ---------------------------------------------------

    def _compare(self, other: Any, kind: Kind, sign: float) -> Any:
        right = self._operand(other)
        if right is None:
            return NotImplemented
        return Constraint((self - right)._scaled(sign), kind)

    def __ge__(self, other: Any) -> Constraint:
        return self._compare(other, Kind.NONNEGATIVE, 1.0)

    def __le__(self, other: Any) -> Constraint:
        return self._compare(other, Kind.NONNEGATIVE, -1.0)

    # The type system asks for a bool here; models are written with ==, so it makes an equation,
    # whose bool() raises.
    def __eq__(self, other: Any) -> Constraint:  # type: ignore[override]
        return self._compare(other, Kind.ZERO, 1.0)

    def __gt__(self, other: Any) -> Constraint:
        raise ProblemError("strict inequalities are not closed sets: use >= and <=")

    __lt__ = __gt__

    def __ne__(self, other: Any) -> bool:
        raise ProblemError("polynomials are not compared by !=; == makes an equality constraint")

    # ---- printing -----------------------------------------------------------------------

    def __str__(self) -> str:
        if not self.terms:
            return "0"
        pieces = []
        for row, value in zip(self.exponents, self.coefficients, strict=True):
            factors = [
                self.name(v) + (f"^{p}" if p > 1 else "")
                for v, p in zip(row.indices, row.data, strict=True)
            ]
            size = repr(float(abs(value))).removesuffix(".0")
            if size != "1" or not factors:
                factors.insert(0, size)
            pieces.append(("-" if value < 0 else "+", "*".join(factors)))
        text = " ".join(f"{sign} {term}" for sign, term in pieces)
        return text.removeprefix("+ ") if text[0] == "+" else "-" + text[2:]

    def __repr__(self) -> str:
        if self.terms <= 12:
            return f"<Polynomial {self}>"
        return f"<Polynomial of {self.terms} terms, degree {self.degree}>"

    def name(self, variable: int) -> str:
        """Return the name of a variable.

        Parameters
        ----------
        variable : int
            Its index, from 0.

        Returns
        -------
        str

        Raises
        ------
        ProblemError
            If there is no such variable.
        """
        place = check_whole(variable, "variable", 0, self.dimension - 1)
        return self.names[place] if self.names else f"x{place + 1}"


def _held_product(left: Grid, right: Grid) -> Grid | None:
    """Multiply grids; None where doubles may not hold sums of numbers on the product."""
    step, size = left[0] + right[0], left[1] * right[1]
    return (step, size) if exact_terms.held(step, size) else None


def _checked_terms(
    words: Any, coefficients: Any, dimension: Any
) -> tuple[Words, NDArray[np.float64]]:
    """Words as int32 and coefficients as doubles, if they are monomials in that many variables."""
    whole = isinstance(dimension, numbers.Integral) and not isinstance(dimension, bool)
    if not whole or not 1 <= dimension < 2**31 - 1:
        raise ProblemError(f"dimension: found {shown(dimension)}, expected a positive integer")
    letters, values = np.asarray(words), np.asarray(coefficients)
    if letters.ndim != 2 or letters.dtype.kind not in "iu":
        raise ProblemError(
            f"words: found {letters.dtype} of shape {letters.shape}, expected integers (T, D)"
        )
    if values.dtype.kind not in "iuf" or values.shape != letters.shape[:1]:
        raise ProblemError(
            f"coefficients: found {values.dtype} of shape {values.shape}, "
            f"expected ({letters.shape[0]},) numbers, one a word"
        )
    if letters.shape[1] == 0:
        letters = np.zeros((letters.shape[0], 1), np.int32)
    if letters.size and not (letters.min() >= 0 and letters.max() <= dimension):
        raise ProblemError(f"words: found a variable outside 1..{dimension}")
    if np.any(letters[:, 1:] < letters[:, :-1]):
        raise ProblemError("words: found a row that descends, expected variables in order")
    exact_terms.require_doubles(coefficients, "coefficients")
    values = values.astype(float)
    if not np.all(np.isfinite(values)):
        bad = values[~np.isfinite(values)][0]
        raise ProblemError(f"coefficients: found {bad}, expected finite numbers")
    return letters.astype(np.int32), values


def _exponent_table(given: Any) -> sps.csr_array:
    """Exponents as a sparse array with a row for each term."""
    if sps.issparse(given):
        return sps.csr_array(given)
    table = np.atleast_2d(doubles(given, "exponents"))
    if table.ndim > 2:
        raise ProblemError(f"exponents: found shape {table.shape}, expected (terms, variables)")
    return sps.csr_array(table)


def polynomials_of(given: Any, field: str, n: int) -> list[Polynomial]:
    """Return the entries of a list of polynomials in n variables.

    Raises
    ------
    ProblemError
        If it is none; the message names the place.
    """
    found = entries_of(given, field, "a list of Polynomials")
    for number, polynomial in enumerate(found):
        check_kind(polynomial, Polynomial, f"{field}[{number}]")
        if polynomial.dimension != n:
            raise ProblemError(
                f"{field}[{number}]: found {polynomial.dimension} variables, expected {n}"
            )
    return found


_MOST_VARIABLES = 10**6  # each takes 400 bytes
_CHECKED: list[tuple[str, ...]] = [()]  # the names that were checked last


def _checked_labels(names: Sequence[str] | None, n: int) -> tuple[str, ...] | None:
    if names is None:
        return None
    if names is _CHECKED[0] and len(names) == n:  # many polynomials have the same names
        return _CHECKED[0]
    if isinstance(names, str) or not isinstance(names, Iterable):
        raise ProblemError(f"names: found {shown(names)}, expected {n} of them")
    labels = tuple(str(name) for name in entries_of(names, "names", f"{n} of them"))
    _check_names(labels, n)
    if type(names) is tuple and all(type(name) is str for name in names):
        labels = _CHECKED[0] = names
    return labels


def _check_names(names: Sequence[str], n: int) -> None:
    if len(names) != n or len(set(names)) != n:
        raise ProblemError(f"names: found {len(names)} names, expected {n} distinct ones")


def variables(n: int, names: Sequence[str] | None = None) -> tuple[Polynomial, ...]:
    """Create the variables x1, ..., xn as polynomials.

    Parameters
    ----------
    n : int
        Number of variables, at least 1.
    names : sequence of str, optional
        n distinct names; ``x1`` ... ``xn`` when left out.

    Returns
    -------
    tuple of Polynomial
        Of length n.

    Raises
    ------
    ProblemError
        If ``n`` is not a positive integer or the names do not fit.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> a, b = sp.variables(2, ["a", "b"])
    >>> print(a * b >= 1)
    -1 + a*b >= 0
    """
    if not isinstance(n, numbers.Integral) or not 1 <= n <= _MOST_VARIABLES:
        raise ProblemError(
            f"n: found {shown(n)}, expected a positive integer up to {_MOST_VARIABLES}"
        )
    labels = None
    if names is not None:
        labels = tuple(str(name) for name in entries_of(names, "names", f"{n} of them"))
        _check_names(labels, int(n))
    one = np.ones(1)
    return tuple(
        Polynomial._of_sorted(np.array([[v]], np.int32), one, int(n), labels)._on((0, 1.0))
        for v in range(1, n + 1)
    )


def total(terms: Iterable[Polynomial | float]) -> Polynomial:
    """Add polynomials (and numbers) in one pass.

    Parameters
    ----------
    terms : iterable of Polynomial or float
        At least one of them a Polynomial.

    Returns
    -------
    Polynomial

    Raises
    ------
    ProblemError
        If none is a Polynomial, or their variables differ.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x = sp.variables(3)
    >>> print(sp.total(v**2 for v in x))
    x1^2 + x2^2 + x3^2
    """
    items = entries_of(terms, "total", "polynomials and numbers")
    first = next((item for item in items if isinstance(item, Polynomial)), None)
    if first is None:
        raise ProblemError("total: found no polynomial among the terms, expected at least one")
    parts = []
    for item in items:
        part = first._operand(item)
        if part is None:
            raise ProblemError(f"total: found {type(item).__name__}, expected polynomials")
        parts.append(part)
    names = next((part.names for part in parts if part.names), None)
    return _sum_of(parts, first.dimension, names)


def _sum_of(parts: list[Polynomial], dimension: int, names: tuple[str, ...] | None) -> Polynomial:
    known = [part for part in parts if part.exact is None]
    words, values = _joined(known) if known else (np.zeros((0, 1), np.int32), np.zeros(0))
    if len(known) == len(parts):
        grids = [part._grid for part in parts]
        grid = min(step for step, _ in grids), sum(size for _, size in grids)
        if exact_terms.held(*grid):
            return Polynomial._on_grid_merged(words, values, dimension, names, grid)
        return Polynomial._merged(words, values, dimension, names)
    exact = [part.exact for part in parts if part.exact is not None]
    terms = ExactTerms.added([ExactTerms.of_doubles(words, values), *exact], dimension)
    return Polynomial._of_exact(terms, dimension, names)


def _joined(parts: list[Polynomial]) -> tuple[Words, NDArray[np.float64]]:
    words = monomials.stack(part.words for part in parts)
    return words, np.concatenate([part.coefficients for part in parts])
