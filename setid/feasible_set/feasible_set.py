"""The feasible parameter set as later questions need it: a formulation, intervals, a problem."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.errors import SetidError
from setid.formulation.formulation import Formulation
from setid.options import Options
from setid.proofs.intervals import IntervalStatus, ParameterInterval

__all__ = ["FeasibleSet", "check_result"]

Reals = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class FeasibleSet:
    """All parameter vectors that are consistent with a record, with proved intervals of them.

    Bands, members, projections and exports of an identified system ask for nothing else;
    :class:`Identification` is a feasible set with the evidence for it.

    Parameters
    ----------
    formulation : Formulation
        Data, structure, noise, priors, and the problem that they make.
    intervals : mapping of str to ParameterInterval
        One a parameter, in the order of ``formulation.parameters``.
    problem : sparsepop_py.Problem
        The problem that the intervals are about: that of the formulation, on a box.
    options : Options
        As of the identification; later questions to the engine take its settings.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> feasible = setid.FeasibleSet(
    ...     result.formulation, result.intervals, result.problem, result.options
    ... )
    >>> feasible.middle.round(4)
    array([-0.4343,  2.013 ])
    """

    formulation: Formulation
    intervals: Mapping[str, ParameterInterval]
    problem: sp.Problem
    options: Options

    @property
    def empty(self) -> bool:
        """True if it is proved that no parameter is consistent."""
        return any(item.status is IntervalStatus.EMPTY for item in self.intervals.values())

    @property
    def outer_box(self) -> tuple[Reals, Reals]:
        """Lower and upper ends of the outer intervals, each (p,)."""
        ends = np.array([self.intervals[name].outer for name in self.formulation.parameters])
        return ends[:, 0], ends[:, 1]

    @property
    def middle(self) -> Reals | None:
        """Centre of the outer box (p,), None where the box is not finite."""
        low, high = self.outer_box
        return low / 2 + high / 2 if np.all(np.isfinite([low, high])) else None

    @property
    def witnesses(self) -> list[Reals]:
        """Vectors (n,) of all unknowns that attain ends of intervals."""
        items = self.intervals.values()
        return [w for item in items for w in item.witnesses if w is not None]

    @property
    def attained(self) -> Reals:
        """Distinct parameter vectors that attain inner ends, shape (M, p)."""
        theta = self.formulation.layout.group("theta")
        found = [np.asarray(witness, float)[theta] for witness in self.witnesses]
        return np.unique(np.array(found), axis=0) if found else np.zeros((0, theta.size))

    def require_members(self) -> None:
        """Refuse a set that is proved empty.

        Raises
        ------
        SetidError
            Saying so.
        """
        if self.empty:
            raise SetidError(
                "result: found an empty feasible set, expected consistent parameters; "
                "see setid.consistency for the least noise bound that explains the data"
            )


def check_result(result: FeasibleSet) -> None:
    """Refuse what is no feasible set.

    Parameters
    ----------
    result : FeasibleSet

    Raises
    ------
    SetidError
        If it is another object.
    """
    if not isinstance(result, FeasibleSet):
        raise SetidError(f"result: found {type(result).__name__}, expected Identification")
