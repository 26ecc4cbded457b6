"""Boxes where rows hold products of parameters, and how they are checked.

With several denominators multiplied out, a row is linear in the monomials of theta (a1, b1,
a1*b1, ...). The rows in these monomials bound them as :mod:`setid.proofs.sign_tree` does, those
of degree one are parameters, and the products of their bounds bound the rest of the next round.
:mod:`setid.feasible_set.lifted_products` finds such boxes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import frozen
from setid.formulation.formulation import Formulation
from setid.formulation.products import Monomial, MonomialRows, merged
from setid.formulation.regression import Regression
from setid.proofs.base import Bounds
from setid.proofs.sign_tree import ParameterBox, linear_rows
from setid.proofs.unbounded_coefficients import CoefficientLimit

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
    sums : tuple of tuple of sp.LinearBound
        For each round, bounds of the sums of monomials that static gains of 1 speak of.
    sharper : tuple of sp.Certificate or None
        Of these sums and their negatives on the last round's box, over all rows at once.
    limit : CoefficientLimit or None
        Bounds of what is then still unbounded.
    """

    rounds: tuple[ParameterBox, ...]
    sums: tuple[tuple[sp.LinearBound, ...], ...]
    sharper: tuple[sp.Certificate | None, ...] = ()
    limit: CoefficientLimit | None = None

    def verify(
        self, rows: MonomialRows, start: Reals, formulation: Formulation | None = None
    ) -> bool:
        """Replay all rounds from the rows of the data, without any solver."""
        box = start
        if len(self.rounds) != len(self.sums):
            return False
        for found, sums in zip(self.rounds, self.sums, strict=True):
            if not found.verify(rows.regression, rows.start(box)):
                return False
            if sums and not _sums_hold(rows, found, sums):
                return False
            box = shrunk(rows, box, found, sums)
        if self.sharper:
            joined = (
                None
                if formulation is None
                else joined_equations(formulation, rows, self.rounds[-1])
            )
            if joined is None or not _sharper_hold(joined, rows, self.sharper):
                return False
            box = shrunk(rows, box, self.rounds[-1], self.sums[-1], self.sharper)
        if self.limit is not None:
            if not isinstance(self.limit, CoefficientLimit) or not self.rounds:
                return False
            ends = np.array([self.rounds[-1].lower, self.rounds[-1].upper])
            if formulation is None or not self.limit.follows(formulation, rows, ends, box):
                return False
            box = shrunk(rows, self.limit.within(box), self.rounds[-1], self.sums[-1], self.sharper)
        return bool(np.all(box[0] >= self.lower) and np.all(box[1] <= self.upper))

    @property
    def cut_short(self) -> bool:
        """Whether time ended before all nodes had been processed."""
        return any(found.cut_short for found in self.rounds)

    def conflicting(self, rows: MonomialRows) -> list[tuple[int, int]]:
        """(record, sample) of the rows whose multipliers prove emptiness."""
        return self.rounds[-1].conflicting(rows.regression)


def shrunk(
    rows: MonomialRows,
    box: Reals,
    found: ParameterBox,
    sums: tuple[sp.LinearBound, ...],
    sharper: tuple[sp.Certificate | None, ...] = (),
) -> Reals:
    empty = np.array([np.full(box.shape[1], np.inf), np.full(box.shape[1], -np.inf)])
    if found.empty or any(b.status is sp.Status.INFEASIBLE for b in sums):
        return empty
    lows = [bound.lower for bound in sums]
    for number, proof in enumerate(sharper):
        lows[number] = lows[number] if proof is None else max(lows[number], proof.bound)
    ends = [(low, -high) for low, high in zip(lows[0::2], lows[1::2], strict=True)]
    box = rows.shrunk(box, found.lower, found.upper, ends)
    return empty if np.any(box[0] > box[1]) else box


def _sums_hold(rows: MonomialRows, found: ParameterBox, sums: tuple[sp.LinearBound, ...]) -> bool:
    problem = linear_rows(rows.regression, (found.lower, found.upper))
    asked = rows.objectives()
    return len(asked) == len(sums) and all(
        bound.verify(problem, objective).ok for bound, objective in zip(sums, asked, strict=True)
    )


def joined_equations(
    formulation: Formulation, rows: MonomialRows, found: ParameterBox
) -> sp.Problem | None:
    """The equations with sums of monomials of theta as unknowns of their own, ahead of the others.

    None where an equation holds other monomials, or multiplies those of a sum by different things.
    """
    problem, p, q = formulation.problem, len(formulation.parameters), len(rows.columns)
    x = sp.variables(q + problem.dimension - p)
    equations = []
    for row, origin in zip(problem.constraints, formulation.rows.origin, strict=True):
        if origin != "model" or row.kind is not sp.Kind.ZERO:
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
        equations.append(sp.total(terms) == 0)
    lower = np.concatenate([found.lower, problem.lower[p:]])
    upper = np.concatenate([found.upper, problem.upper[p:]])
    if not equations or not np.all(np.isfinite(lower) & np.isfinite(upper)):
        return None
    return sp.Problem(x[0], equations, lower=lower, upper=upper)


def sum_objectives(joined: sp.Problem, rows: MonomialRows) -> list[sp.Polynomial]:
    """The sums and their negatives in the unknowns of the joined equations."""
    x = sp.variables(joined.dimension)
    return [
        sp.total(
            [value * x[v] for v, value in zip(p.words[:, -1] - 1, p.coefficients, strict=True)]
        )
        for p in rows.objectives()
    ]


def _sharper_hold(
    joined: sp.Problem, rows: MonomialRows, sharper: tuple[sp.Certificate | None, ...]
) -> bool:
    asked, known = sum_objectives(joined, rows), dict[int, Any]()
    return len(asked) == len(sharper) and all(
        proof is None or proof.verify(joined.with_objective(objective), known).ok
        for proof, objective in zip(sharper, asked, strict=True)
    )


def lifted_rows(formulation: Formulation) -> MonomialRows | None:
    """The equations of a formulation as rows in monomials of theta.

    Parameters
    ----------
    formulation : Formulation

    Returns
    -------
    MonomialRows or None
        None where an unknown other than theta has no finite bounds, or no row is left.
    """
    if formulation.products is not None:
        return formulation.products
    problem, p = formulation.problem, len(formulation.parameters)
    kept = [
        row
        for row, origin in enumerate(formulation.rows.origin)
        if origin == "model" and problem.constraints[row].kind is sp.Kind.ZERO
    ]
    reach = np.maximum(np.abs(problem.lower), np.abs(problem.upper))
    factors = _factors([problem.constraints[row].polynomial for row in kept], p)
    constant = factors.pop((), [])
    if not factors:
        return None
    monomials = sorted(factors, key=lambda m: (len(m), m))
    measured = [_known([factors[m] for m in monomials], len(kept), reach)]
    measured += [_known([constant], len(kept), reach)]
    (regressors, radii), (target, radius) = measured
    if not np.all(np.isfinite(radii)) or not np.all(np.isfinite(radius)):
        return None
    names = tuple("*".join(formulation.parameters[i] for i in m) for m in monomials)
    rows = formulation.rows
    channel = np.array([int(rows.equation[row].strip("y") or 1) for row in kept], np.int64)
    record, sample = rows.record[kept], rows.sample[kept]
    where = formulation.data.starts[record - 1] + sample - 1
    arrays = (target[:, 0], regressors, radius[:, 0], radii, where, record, sample, channel)
    regression = Regression(names, *(frozen(np.array(array)) for array in arrays))
    found = MonomialRows(regression, tuple((m,) for m in monomials), formulation.parameters)
    return merged(found, [tuple(factors[m]) for m in monomials])


def _factors(rows: list[sp.Polynomial], p: int) -> dict[Monomial, list[Factor]]:
    """What each monomial of theta multiplies: row, noise samples and value of each term."""
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
