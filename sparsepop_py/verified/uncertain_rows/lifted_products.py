"""Boxes where rows hold products of parameters, and how they are checked.

With several denominators multiplied out, a row is linear in the monomials of theta (a1, b1,
a1*b1, ...). The rows in these monomials bound them as
:mod:`sparsepop_py.verified.uncertain_rows.sign_tree` does, those of degree one are parameters,
and the products of their bounds bound the rest of the next round.
:mod:`sparsepop_py.uncertain_rows.lifted_products` finds such boxes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Kind, Polynomial, total, variables
from sparsepop_py.problem.problem import Problem
from sparsepop_py.verified.certificate.certificate import Certificate
from sparsepop_py.verified.certificate.linear_bound import LinearBound
from sparsepop_py.verified.uncertain_rows.box import Bounds
from sparsepop_py.verified.uncertain_rows.coupled import CoupledRows
from sparsepop_py.verified.uncertain_rows.products import Monomial, ProductRows, merged
from sparsepop_py.verified.uncertain_rows.rows import UncertainRows
from sparsepop_py.verified.uncertain_rows.sign_tree import ParameterBox, linear_rows
from sparsepop_py.verified.uncertain_rows.unbounded_coefficients import CoefficientLimit

__all__ = ["Factor", "LiftedBox", "lifted_rows"]

Reals = NDArray[np.float64]

Factor = tuple[int, Monomial, float]  # row, noise samples, value


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LiftedBox(Bounds):
    """A box of theta by rounds of boxes of its monomials; as :class:`ParameterBox` otherwise.

    Parameters
    ----------
    names : tuple of str
    lower, upper : (p,) float
    rounds : tuple of ParameterBox
    sums : tuple of tuple of LinearBound
        For each round, bounds of the sums of monomials that static gains of 1 speak of.
    sharper : tuple of Certificate or None
        Of these sums and their negatives on the last round's box, over all rows at once.
    limit : CoefficientLimit or None
        Bounds of what is then still unbounded.
    """

    rounds: tuple[ParameterBox, ...]
    sums: tuple[tuple[LinearBound, ...], ...]
    sharper: tuple[Certificate | None, ...] = ()
    limit: CoefficientLimit | None = None

    def verify(self, rows: ProductRows, start: Reals, coupled: CoupledRows | None = None) -> bool:
        """Replay all rounds from the rows, without any solver.

        Parameters
        ----------
        rows : ProductRows
        start : (2, p) float
            Bounds that are known already.
        coupled : CoupledRows, optional
            Equations with the numbers that they share; needed where the proof uses them.
        """
        box = self._replayed(rows, start)
        if box is not None and (self.sharper or self.limit is not None):
            box = None if coupled is None else self._sharpened(rows, box, coupled)
        if box is None:
            return False
        return self.follow(*box)

    def _replayed(self, rows: ProductRows, start: Reals) -> Reals | None:
        """Replay all rounds; None where one of them does not hold."""
        if len(self.rounds) != len(self.sums):
            return None
        box = start
        for found, sums in zip(self.rounds, self.sums, strict=True):
            if not found.verify(rows.regression, rows.start(box)):
                return None
            if sums and not _sums_hold(rows, found, sums):
                return None
            box = shrunk(rows, box, found, sums)
        return box

    def _sharpened(self, rows: ProductRows, box: Reals, coupled: CoupledRows) -> Reals | None:
        """Apply bounds over all rows at once; None where they do not hold."""
        if not self.rounds:
            return None
        last, sums = self.rounds[-1], self.sums[-1]
        if self.sharper:
            joined = joined_equations(coupled, rows, last)
            if joined is None or not _sharper_hold(joined, rows, self.sharper):
                return None
            box = shrunk(rows, box, last, sums, self.sharper)
        if self.limit is not None:
            ends = np.array([last.lower, last.upper])
            if not isinstance(self.limit, CoefficientLimit):
                return None
            if not self.limit.follows(coupled, rows, ends, box):
                return None
            box = shrunk(rows, self.limit.within(box), last, sums, self.sharper)
        return box

    @property
    def cut_short(self) -> bool:
        """True if time ended before all nodes had been processed."""
        return any(found.cut_short for found in self.rounds)

    def used_rows(self, rows: UncertainRows) -> dict[int, int]:
        """Count how often rows are used in a proof of emptiness, as of :class:`ParameterBox`.

        Parameters
        ----------
        rows : UncertainRows
            Those of the products.
        """
        return self.rounds[-1].used_rows(rows)


def shrunk(
    rows: ProductRows,
    box: Reals,
    found: ParameterBox,
    sums: tuple[LinearBound, ...],
    sharper: tuple[Certificate | None, ...] = (),
) -> Reals:
    empty = np.array([np.full(box.shape[1], np.inf), np.full(box.shape[1], -np.inf)])
    if found.empty or any(b.status == "INFEASIBLE" for b in sums):
        return empty
    lows = [bound.lower for bound in sums]
    for number, proof in enumerate(sharper):
        lows[number] = lows[number] if proof is None else max(lows[number], proof.bound)
    ends = [(low, -high) for low, high in zip(lows[0::2], lows[1::2], strict=True)]
    box = rows.shrunk(box, found.lower, found.upper, ends)
    return empty if np.any(box[0] > box[1]) else box


def _sums_hold(rows: ProductRows, found: ParameterBox, sums: tuple[LinearBound, ...]) -> bool:
    problem = linear_rows(rows.regression, (found.lower, found.upper))
    asked = rows.objectives()
    return len(asked) == len(sums) and all(
        bound.verify(problem, objective).ok for bound, objective in zip(sums, asked, strict=True)
    )


def joined_equations(
    coupled: CoupledRows, rows: ProductRows, found: ParameterBox
) -> Problem | None:
    """Join equations, with sums of monomials of theta as first unknowns.

    None where an equation holds other monomials, or multiplies those of a sum by different things.
    """
    problem, p, q = coupled.problem, coupled.parameters, len(rows.columns)
    x = variables(q + problem.dimension - p)
    equations = []
    for row in coupled.constraints:
        if row.kind is not Kind.ZERO:
            continue
        factors = _factors([row.polynomial], p)
        summands = [(0.0 * x[0] + 1.0, factor) for factor in factors.pop((), [])]
        for number, column in enumerate(rows.columns):
            shared = factors.pop(column[0], [])
            if any(factors.pop(monomial, []) != shared for monomial in column[1:]):
                return None
            summands += [(x[number], factor) for factor in shared]
        if factors:
            return None
        terms = [
            math.prod([x[q + v - p] for v in noise], start=value * unknown)
            for unknown, (_, noise, value) in summands
        ]
        equations.append(total(terms) == 0)
    lower = np.concatenate([found.lower, problem.lower[p:]])
    upper = np.concatenate([found.upper, problem.upper[p:]])
    if not equations or not np.all(np.isfinite(lower) & np.isfinite(upper)):
        return None
    return Problem(x[0], equations, lower=lower, upper=upper)


def sum_objectives(joined: Problem, rows: ProductRows) -> list[Polynomial]:
    """List the sums and their negatives in the unknowns of the joined equations."""
    x = variables(joined.dimension)
    return [
        total([value * x[v] for v, value in zip(p.words[:, -1] - 1, p.coefficients, strict=True)])
        for p in rows.objectives()
    ]


def _sharper_hold(
    joined: Problem, rows: ProductRows, sharper: tuple[Certificate | None, ...]
) -> bool:
    asked, known = sum_objectives(joined, rows), dict[int, Any]()
    return len(asked) == len(sharper) and all(
        proof is None or proof.verify(joined.with_objective(objective), known).ok
        for proof, objective in zip(sharper, asked, strict=True)
    )


def lifted_rows(coupled: CoupledRows, names: tuple[str, ...]) -> ProductRows | None:
    """State equations as rows in monomials of theta, row by row, shared numbers forgotten.

    Parameters
    ----------
    coupled : CoupledRows
        Of which the equations are taken.
    names : tuple of str
        Of the parameters.

    Returns
    -------
    ProductRows or None
        One row an equation, in their order. None where an unknown other than theta has no
        finite bounds, or no row is left.
    """
    problem, p = coupled.problem, coupled.parameters
    kept = [row.polynomial for row in coupled.constraints if row.kind is Kind.ZERO]
    reach = np.maximum(np.abs(problem.lower), np.abs(problem.upper))
    factors = _factors(kept, p)
    constant = factors.pop((), [])
    if not factors:
        return None
    monomials = sorted(factors, key=lambda m: (len(m), m))
    measured = [_known([factors[m] for m in monomials], len(kept), reach)]
    measured += [_known([constant], len(kept), reach)]
    (regressors, radii), (target, radius) = measured
    if not np.all(np.isfinite(radii)) or not np.all(np.isfinite(radius)):
        return None
    columns = tuple("*".join(names[i] for i in m) for m in monomials)
    rows = UncertainRows(columns, target[:, 0], regressors, radius[:, 0], radii)
    found = ProductRows(rows, tuple((m,) for m in monomials), names)
    return merged(found, [tuple(factors[m]) for m in monomials])


def _factors(rows: list[Polynomial], p: int) -> dict[Monomial, list[Factor]]:
    """List the factors of each monomial of theta: row, noise samples, value."""
    found: dict[Monomial, list[Factor]] = {}
    for number, row in enumerate(rows):
        terms = zip(row.words.tolist(), row.coefficients.tolist(), strict=True)
        for word, value in terms:
            used = [letter - 1 for letter in word if letter]
            monomial = tuple(v for v in used if v < p)
            noise = tuple(v for v in used if v >= p)
            found.setdefault(monomial, []).append((number, noise, value))
    return {monomial: sorted(terms) for monomial, terms in found.items()}


def _known(columns: list[list[Factor]], count: int, reach: Reals) -> tuple[Reals, Reals]:
    """Values of these factors and widths of the noise in them, (count, columns) each."""
    values, widths = np.zeros((count, len(columns))), np.zeros((count, len(columns)))
    for place, factors in enumerate(columns):
        for row, noise, value in factors:
            if not noise:
                values[row, place] = value  # monomials of a polynomial are distinct
                continue
            width = abs(value)
            for v in noise:
                width = float(np.nextafter(width * reach[v], np.inf))
            before = widths[row, place]
            widths[row, place] = np.nextafter(before + width, np.inf) if before else width
    return values, widths
