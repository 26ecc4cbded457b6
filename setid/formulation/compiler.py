"""From equations between signals to rows of polynomials, all samples at once.

plan      which samples get a row, which are left out because samples are missing
assemble  coefficients and variables of every term of every row
rows      engine constraints, equation errors eliminated where they can be
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.record import IOData
from setid.formulation.signals import Integers, Reals, Signal
from setid.models.equations import Equation, Initial, Term
from sparsepop_py.algebra.polynomial_rows import polynomial_rows

__all__ = ["Assembled", "Planned", "assemble", "bands", "equalities", "plan", "used_samples"]

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """The rows of one equation: sample numbers from 0, and how many were left out."""

    equation: Equation
    rows: Integers
    dropped: int


def plan(
    equations: Sequence[Equation], data: IOData, usable: Mapping[str, Mask], initial: Initial
) -> tuple[Planned, ...]:
    """Choose the rows of each equation.

    Parameters
    ----------
    equations : sequence of Equation
        Internal signals defined before they are used, but for their past in loops.
    data : IOData
    usable : mapping of signal to (N,) bool
        Measured samples that are known or have a range.
    initial : {"free", "zero"}
        Whether rows may reach before the record, where signals are zero.

    Returns
    -------
    tuple of Planned
        One an equation. Definitions without parameters (products of signals) get rows
        only where some other row uses them.
    """
    everywhere, first = np.ones(data.samples, bool), data.first
    known = {e.defines: everywhere for e in equations} | dict(usable)
    exists = dict.fromkeys(known, everywhere)
    plans = []
    for equation in equations:
        defined = equation.defines
        possible, whole = everywhere, everywhere
        for factor in {s for t in equation.terms for s in t.signals}:
            possible = possible & _before(exists[factor.signal], factor.lag, first, initial)
            whole = whole & _before(known[factor.signal], factor.lag, first, "zero")
        rows = np.flatnonzero(possible & whole)
        if defined not in usable and _static(equation):
            exists[defined], known[defined] = possible, possible & whole
        plans.append(Planned(equation, rows, int(np.count_nonzero(possible & ~whole))))
    return _pruned(plans, data, usable)


def _before(mask: Mask, lag: int, first: Integers, initial: Initial) -> Mask:
    """The mask ``lag`` samples earlier in the same record; before it: whether zero is legal."""
    place = np.arange(mask.size) - lag
    inside = place >= first
    return np.where(inside, mask[np.where(inside, place, 0)], initial == "zero")


def _pruned(
    plans: Sequence[Planned], data: IOData, measured: Mapping[str, Mask]
) -> tuple[Planned, ...]:
    """Leave out definitions of internal samples that no row uses."""
    used: dict[str, Mask] = {}
    kept = []
    for item in reversed(plans):
        if item.equation.defines not in measured and not _recursive(item.equation):
            wanted = used.get(item.equation.defines, np.zeros(data.samples, bool))
            item = Planned(item.equation, item.rows[wanted[item.rows]], 0)
        _mark(item, data, used)
        kept.append(item)
    return tuple(reversed(kept))


def _static(equation: Equation) -> bool:
    """Check for a signal that is defined without parameters and without its own past."""
    return not equation.parametric and not _recursive(equation)


def _recursive(equation: Equation) -> bool:
    """Check for a signal that is defined by its own past."""
    return any(s.signal == equation.defines for t in equation.terms[1:] for s in t.signals)


def _mark(item: Planned, data: IOData, used: dict[str, Mask]) -> None:
    first = data.first[item.rows]
    for factor in {s for t in item.equation.terms for s in t.signals}:
        mask = used.setdefault(factor.signal, np.zeros(data.samples, bool))
        place = item.rows - factor.lag
        mask[place[place >= first]] = True


def used_samples(plans: Sequence[Planned], data: IOData) -> dict[str, Mask]:
    """Find the samples of each signal that occur in some row."""
    used: dict[str, Mask] = {}
    for item in plans:
        _mark(item, data, used)
    return used


@dataclass(frozen=True, slots=True, eq=False)
class Assembled:
    """All terms of the rows of one equation.

    Parameters
    ----------
    constant : (R,) float
        What stands in the rows without any variable.
    coefficients : (R, T) float
        Zero where a term is not there.
    letters : (R, T, D) int
        Variables of each term, counted from 1, 0 where there are fewer than D.
    """

    constant: Reals
    coefficients: Reals
    letters: Integers

    def take(self, rows: Integers) -> Assembled:
        """Take some of the rows."""
        return Assembled(self.constant[rows], self.coefficients[rows], self.letters[rows])

    def minus(self, variable: Integers) -> Assembled:
        """Subtract one variable from each row; -1 for none."""
        present = variable >= 0
        if not np.any(present):
            return self
        letters = np.zeros((variable.size, 1, self.letters.shape[2]), np.int64)
        letters[:, 0, 0] = variable + 1
        return Assembled(
            self.constant,
            np.concatenate([self.coefficients, -present[:, None].astype(float)], axis=1),
            np.concatenate([self.letters, letters], axis=1),
        )


def assemble(
    item: Planned,
    signals: Mapping[str, Signal],
    parameters: Mapping[str, int],
    first: Integers,
) -> Assembled:
    """Multiply out the rows of one equation.

    Known samples that multiply the same parameters are added up in the order of terms, as
    in :mod:`setid.formulation.regression`: both speak of the same doubles.

    Parameters
    ----------
    item : Planned
    signals : mapping of name to Signal
    parameters : mapping of name to int
        Variable numbers.
    first : (N,) int
        Row at which the record of each sample begins.
    """
    known: dict[tuple[str, ...], tuple[Reals, list[Integers]]] = {}
    columns = []
    for term in item.equation.terms:
        for coefficient, letters in _expanded(term, item.rows, signals, parameters, first):
            if len(letters) > len(term.parameters):
                columns.append((coefficient, letters))
                continue
            before = known.get(term.parameters, (np.zeros(item.rows.size), letters))[0]
            known[term.parameters] = before + coefficient, letters
    columns += known.values()
    degree = max([1, *(len(letters) for _, letters in columns)])
    constant = np.zeros(item.rows.size)
    values, words = [], []
    for coefficient, letters in columns:
        if not letters:
            constant = coefficient
            continue
        word = np.zeros((item.rows.size, degree), np.int64)
        for place, letter in enumerate(letters):
            word[:, place] = letter
        values.append(coefficient)
        words.append(word)
    if not words:
        return Assembled(
            constant, np.zeros((item.rows.size, 0)), np.zeros((item.rows.size, 0, 1), np.int64)
        )
    return Assembled(constant, np.stack(values, axis=1), np.stack(words, axis=1))


def _expanded(
    term: Term,
    rows: Integers,
    signals: Mapping[str, Signal],
    parameters: Mapping[str, int],
    first: Integers,
) -> list[tuple[Reals, list[Integers]]]:
    """A product of sums, multiplied out: columns of coefficients with their letters."""
    heads = [np.full(rows.size, parameters[name] + 1) for name in term.parameters]
    columns: list[tuple[Reals, list[Integers]]] = [(np.full(rows.size, term.coefficient), heads)]
    for factor in term.signals:
        known, slope, variable = signals[factor.signal].at(rows, factor.lag, first)
        letter = variable + 1
        longer = [(c * slope, [*letters, letter]) for c, letters in columns] if slope.any() else []
        columns = [(c * known, letters) for c, letters in columns] if known.any() else []
        columns += longer
    return columns


def _polynomials(
    constant: Reals, assembled: Assembled, sign: float, names: tuple[str, ...]
) -> list[sp.Polynomial]:
    """Row by row constant + sign * (the rest)."""
    rows, _, degree = assembled.letters.shape
    values = np.concatenate([constant[:, None], sign * assembled.coefficients], axis=1)
    blank = np.zeros((rows, 1, degree), np.int64)
    words = np.concatenate([blank, assembled.letters], axis=1).astype(np.int32)
    words[values == 0.0] = 0
    words.sort(axis=2)
    return polynomial_rows(words, values, len(names), names)


def equalities(
    assembled: Assembled, names: tuple[str, ...], labels: Sequence[str]
) -> list[sp.Constraint]:
    """State rows == 0."""
    rows = _polynomials(assembled.constant, assembled, 1.0, names)
    return [sp.Constraint(p, sp.Kind.ZERO, label) for p, label in zip(rows, labels, strict=True)]


def bands(
    assembled: Assembled, width: Reals, names: tuple[str, ...], labels: Sequence[str]
) -> list[sp.Constraint]:
    """State -width <= row <= width, two inequalities each, constants rounded outwards."""
    below = _polynomials(_sum_above(width, assembled.constant), assembled, 1.0, names)
    above = _polynomials(_sum_above(width, -assembled.constant), assembled, -1.0, names)
    kind = sp.Kind.NONNEGATIVE
    return [
        sp.Constraint(polynomial, kind, f"{label}{side}")
        for low, high, label in zip(below, above, labels, strict=True)
        for polynomial, side in ((low, ".low"), (high, ".high"))
    ]


def _sum_above(left: Reals, right: Reals) -> Reals:
    """Sum rounded up: the next double above unless the sum is exact or already above (TwoSum)."""
    total = left + right
    part = total - left
    error = (left - (total - part)) + (right - part)
    return np.where(error > 0, np.nextafter(total, np.inf), total)
