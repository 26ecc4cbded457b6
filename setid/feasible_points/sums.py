"""Ends of long records, also with sums of products in rows: by simulations, in the parameters.

Searches that hold all samples and sums as unknowns take minutes for a thousand rows. A simulation
has a few unknowns: the parameters and the first outputs. What comes back is proved elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.feasible_points.cascades import point_of
from setid.feasible_points.simulations import Fitting, best_fit, reached_ends
from setid.formulation.formulation import Formulation
from setid.formulation.lifting import Sum, lift
from setid.models.checked_structures import equations_of
from setid.models.equations import Term
from setid.proofs.simulated.forms import Form, Region, constant, plus, times
from setid.proofs.simulated.outputs import Recursion, recursion_from, recursion_of
from sparsepop_py.budget import Deadline

__all__ = ["SumsRecursion", "ends_of_long_record", "sums_recursion"]

Reals = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SumsRecursion(Recursion):
    """A recursion whose factors may be sums of products of parameters.

    Parameters
    ----------
    sums : mapping of str to Sum
        In parameters and in sums before them.
    """

    sums: Mapping[str, Sum] = field(default_factory=dict)

    def _factor(self, item: Term, region: Region) -> Form:
        found = constant(np.array(item.coefficient), self.dimension)
        for name in item.parameters:
            found = times(found, self._value(name, region), region)
        return found

    def _value(self, name: str, region: Region) -> Form:
        if name not in self.sums:
            return Recursion._factor(self, Term(1.0, (name,)), region)
        found = constant(np.array(0.0), self.dimension)
        for coefficient, names in self.sums[name]:
            found = plus(found, self._factor(Term(coefficient, names), region), region)
        return found


def sums_recursion(formulation: Formulation) -> SumsRecursion | None:
    """State a formulation with sums of products as a simulation; None where it is none.

    Parameters
    ----------
    formulation : Formulation

    Examples
    --------
    >>> import numpy as np, setid
    >>> model = setid.TransferFunction(1, 1, nk=1, inputs=2, form="lifted")
    >>> data = setid.IOData(np.eye(4, 2), [0.0, 1.0, 0.5, 0.2])
    >>> sums_recursion(setid.formulate(data, model, setid.Noise(output=0.1))).dimension
    6
    """
    model = formulation.model
    lifting = lift(equations_of(model, tuple(f"y{i + 1}" for i in range(model.outputs))))
    if not formulation.sums or lifting.sums != formulation.sums:
        return None
    found = recursion_from(formulation, lifting.equations)
    if found is None:
        return None
    sums = dict(zip(lifting.names, lifting.sums, strict=True))
    return SumsRecursion(
        found.equations, found.known, found.parameters, found.outputs, found.past, sums
    )


def ends_of_long_record(
    formulation: Formulation, problem: sp.Problem, first: Reals, deadline: Deadline
) -> list[Reals]:
    """Search for consistent vectors at the ends of all parameters.

    Parameters
    ----------
    formulation : Formulation
    problem : sp.Problem
        Its problem on a finite box of the parameters.
    first : (n,) float
        A vector whose parameters are tried first.
    deadline : Deadline

    Returns
    -------
    list of (n,) float
        Two a parameter; none where no simulation is within the noise.
    """
    recursion: Recursion | None = sums_recursion(formulation)
    if not formulation.sums:
        recursion = recursion_of(formulation)
    p = len(formulation.parameters)
    if recursion is None or not np.all(np.isfinite([problem.lower[:p], problem.upper[:p]])):
        return []
    lower, upper = recursion.box(problem.lower[:p], problem.upper[:p])
    fitting = Fitting(formulation, recursion, lower, upper)
    begin = np.concatenate([first[:p], (lower[p:] + upper[p:]) / 2])  # outputs as they were read
    best, level = best_fit(fitting, deadline, begin)
    if not level < 1.0:
        return []
    ends = reached_ends(fitting, best, deadline, p)
    return [point_of(formulation, fitting, end) for end in ends]
