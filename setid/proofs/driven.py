"""Parameters of several denominators bounded by rows with an offset of the equation.

An output that is a sum over several denominators, with a constant c added,

    y = sum_j (B_j / A_j) u_j + c,

has a constant that no data bound where a pole may be at 1: rows hold its product with
A_1 ... A_p at q = 1 alone, which is zero there. That product is the parameter d of

    A_1 ... A_p y = sum_j B_j (the other denominators) u_j + d,

and all others are the same. So intervals of this structure, for which all samples before the
record are unknown, hold for the first one too, and c = d / (A_1 ... A_p)(1) lies in the quotient.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.formulation.formulation import Formulation, formulate
from setid.formulation.lifting import DRIVEN
from setid.models.checked_structures import regression_of
from setid.models.lti import TransferFunction
from setid.priors.base import Prior
from setid.priors.checked_priors import bounds_of
from setid.proofs.intervals import ParameterInterval
from sparsepop_py.verified.arithmetic.interval import Interval

__all__ = ["driven", "within_driven"]

Reals = NDArray[np.float64]


def driven(formulation: Formulation) -> Formulation | None:
    """State the rows with an offset of the equation; None where they say nothing new.

    Priors that speak of an offset are left out.

    Parameters
    ----------
    formulation : Formulation
    """
    model = formulation.model
    if not isinstance(model, TransferFunction) or not model.offset or regression_of(model):
        return None
    if model.form in ("direct", DRIVEN):
        return None
    if np.any(formulation.noise.bounds(formulation.data).equation > 0):
        return None  # an error of a sum of partial outputs is not one of the equation
    other = replace(model, form=DRIVEN, initial="free")
    return formulate(formulation.data, other, formulation.noise, _others(formulation, model))


def _others(formulation: Formulation, model: TransferFunction) -> list[Prior]:
    """Priors in which no offset occurs."""
    names, rows = set(model.offsets()), formulation.rows
    letters = [formulation.parameters.index(name) + 1 for name in names]
    speaks = {
        int(rows.item[row])
        for row, (origin, c) in enumerate(
            zip(rows.origin, formulation.problem.constraints, strict=True)
        )
        if origin == "prior" and np.any(np.isin(c.polynomial.words, letters))
    }
    every = enumerate(formulation.priors)
    return [p for k, p in every if k not in speaks and not names & set(bounds_of(p, model))]


def within_driven(
    problem: sp.Problem,
    formulation: Formulation,
    intervals: Mapping[str, ParameterInterval],
) -> sp.Problem:
    """State a problem with the parameters in intervals of the rows of :func:`driven`.

    Where nothing would be left of a parameter its bounds stay.

    Parameters
    ----------
    problem : sparsepop_py.Problem
        Of the formulation.
    formulation : Formulation
    intervals : mapping of str to ParameterInterval
    """
    model, lower, upper = formulation.model, problem.lower.copy(), problem.upper.copy()
    assert isinstance(model, TransferFunction)
    outer = {name: item.outer for name, item in intervals.items()}
    outer |= {name: _offset(model, i, outer) for i, name in enumerate(model.offsets())}
    for place, name in enumerate(formulation.parameters):
        low, high = max(lower[place], outer[name][0]), min(upper[place], outer[name][1])
        if low <= high:
            lower[place], upper[place] = low, high
    return sp.Problem(problem.objective, problem.constraints, lower, upper, problem.names)


def _offset(
    model: TransferFunction, output: int, outer: Mapping[str, tuple[float, float]]
) -> tuple[float, float]:
    """Bound what is added to an output, by d and the denominators at q = 1."""
    whole = _interval((1.0, 1.0))
    for names in model.denominators(output):
        factor = _interval((1.0, 1.0))
        for name in names:
            factor = factor + _interval(outer[name])
        whole = whole * factor
    found = _interval(outer[model.offsets()[output]]) / whole
    return float(found.lo[0]), float(found.hi[0])


def _interval(ends: tuple[float, float]) -> Interval:
    return Interval(np.array(ends[:1]), np.array(ends[1:]))
