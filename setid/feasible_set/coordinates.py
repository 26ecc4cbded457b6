"""Coordinates in which the equations of all outputs are affine: parameters, and sums of products.

One equation an output, in measured signals, has products of parameters where denominators are
multiplied out or static maps are inserted. With these sums as further coordinates it is affine
(:mod:`setid.formulation.lifting`), and bands and predictions are those of a linear regression.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.record import IOData
from setid.errors import ModelError
from setid.feasible_set.feasible_set import FeasibleSet
from setid.feasible_set.supports import cover_of
from setid.formulation.formulation import Formulation, formulate
from setid.formulation.lifting import LIFTED, Sum, lift
from setid.formulation.regression import Regression, rows_of_readings
from setid.models.checked_structures import regression_of
from setid.models.equations import Equation, Structure
from setid.models.general import BlockStructured, nonlinear_rows
from setid.models.lti import TransferFunction
from setid.proofs.supports import Cover
from setid.proofs.time_bands.sums import with_sums

__all__ = ["Coordinates", "asked_of", "coordinates_of", "parameter_coordinates"]

Reals = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Coordinates:
    """Names and equations in coordinates in which these are affine.

    Parameters
    ----------
    names : tuple of str
        Of the parameters, then of the sums.
    equations : tuple of Equation
        One an output.
    sums : tuple of Sum
        What each of the last coordinates is, in those before it.
    """

    names: tuple[str, ...]
    equations: tuple[Equation, ...]
    sums: tuple[Sum, ...] = ()

    def values(self, thetas: Reals) -> Reals:
        """Evaluate all coordinates for parameter vectors (..., p), up to rounding; (..., n)."""
        p = len(self.names) - len(self.sums)
        place = {name: column for column, name in enumerate(self.names)}
        found = np.concatenate([thetas, np.zeros((*thetas.shape[:-1], len(self.sums)))], axis=-1)
        for column, own in enumerate(self.sums, p):
            for coefficient, word in own:
                factors = found[..., [place[name] for name in word]]
                found[..., column] += coefficient * factors.prod(axis=-1)
        return found

    def cover(self, result: FeasibleSet) -> Cover:
        """Cover a feasible set in these coordinates; infinite intervals have no sums."""
        cover = cover_of(result)
        if not self.sums or not np.all(np.isfinite([cover.lower, cover.upper])):
            return cover
        names = self.names[len(self.names) - len(self.sums) :]
        return with_sums(cover, names, self.sums)

    def rows(self, formulation: Formulation) -> Regression:
        """State the equations for a record and its noise, one row an output and sample.

        Parameters
        ----------
        formulation : Formulation
            Of the same structure: what it refuses has no such rows.
        """
        if formulation.regression is not None:
            return formulation.regression
        data, bounds = formulation.data, formulation.noise.bounds(formulation.data)
        return rows_of_readings(data, formulation.model, self.equations, self.names, bounds)

    def rows_of_readings(self, data: IOData, model: Structure) -> Regression:
        """State the equations for readings as if exact; rows with gaps are left out.

        Parameters and errors are those of
        :func:`setid.formulation.regression.rows_of_readings`.
        """
        return rows_of_readings(data, model, self.equations, self.names)


def coordinates_of(
    model: Structure, lacks: str = "no proved bands; use kind='sampled'"
) -> Coordinates:
    """State the equations of all outputs in coordinates in which they are affine.

    Parameters
    ----------
    model : Structure
    lacks : str
        What there is for structures without such coordinates, for the message.

    Raises
    ------
    ModelError
        If internal signals cannot be eliminated, a product of parameters multiplies several
        signals, or multiplied denominators would forget what the first samples say.

    Examples
    --------
    >>> import setid
    >>> model = setid.TransferFunction(na=1, nb=1, nk=1, inputs=2)
    >>> coordinates_of(model).names[4:]
    ('lifted[1]', 'lifted[2]', 'lifted[3]', 'lifted[4]')
    """
    equations: Sequence[Equation] = regression_of(model)
    if not equations and isinstance(model, TransferFunction):
        if model.offset and model.initial == "zero":
            raise ModelError(
                "model: separate denominators whose outputs begin at an offset, and not at rest, "
                f"have {lacks}, or identify with initial='free'"
            )
        equations = model.multiplied()
    elif not equations and isinstance(model, BlockStructured):
        equations = model.direct()
    if not equations:
        raise ModelError(f"model: {nonlinear_rows(model)} have {lacks}")
    lifting = lift(equations)
    if not all(equation.linear_in_parameters for equation in lifting.equations):
        raise ModelError(
            f"model: rows in which a product of parameters multiplies several signals have {lacks}"
        )
    return Coordinates((*model.parameters, *lifting.names), lifting.equations, lifting.sums)


def parameter_coordinates(result: FeasibleSet) -> Coordinates:
    """Take the parameters of a set themselves as coordinates.

    Parameters
    ----------
    result : FeasibleSet
    """
    return Coordinates(result.formulation.parameters, ())


def asked_of(
    result: FeasibleSet, coordinates: Coordinates
) -> tuple[FeasibleSet, tuple[sp.Polynomial, ...]]:
    """State coordinates as unknowns of a problem that the engine can be asked about.

    Parameters
    ----------
    result : FeasibleSet
    coordinates : Coordinates

    Returns
    -------
    result : FeasibleSet
        The given one, or the same set with sums as unknowns of its problem.
    unknowns : tuple of Polynomial
        One a coordinate, in turn; the parameters alone where the problem has no such sums.
    """
    if coordinates.sums:
        result = _with_unknown_sums(result, coordinates)
    layout = result.formulation.layout
    numbers = layout.group("theta").tolist()
    if result.formulation.sums == coordinates.sums:
        numbers += layout.group(LIFTED).tolist()
    return result, tuple(layout.polynomial(number) for number in numbers)


@lru_cache(maxsize=4)
def _with_unknown_sums(result: FeasibleSet, coordinates: Coordinates) -> FeasibleSet:
    """State the same set on a problem with these sums, where its structure allows it."""
    formulation = result.formulation
    model = formulation.model
    if formulation.sums == coordinates.sums:
        return result
    changed: Structure
    if isinstance(model, TransferFunction):
        changed = replace(model, form=LIFTED)
    elif isinstance(model, BlockStructured):
        changed = model.changed(form=LIFTED)
    else:
        return result
    found = formulate(formulation.data, changed, formulation.noise, formulation.priors)
    if found.sums != coordinates.sums:
        return result
    lower, upper = found.problem.lower.copy(), found.problem.upper.copy()
    p = len(found.parameters)
    lower[:p], upper[:p] = result.outer_box
    rows, names = found.problem.constraints, found.layout.names
    problem = sp.Problem(found.problem.objective, rows, lower, upper, names)
    return FeasibleSet(found, result.intervals, problem, result.options)
