"""Results made by hand from linear programs, so that what uses results is tested alone."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sps

import setid
from setid.feasible_set.supports import cover_of, supports
from setid.options import Options
from setid.proofs.intervals import IntervalStatus, ParameterInterval
from setid.result.identification import Identification
from sparsepop_py.lp.scaled import solve_scaled


def result_of(
    formulation: setid.Formulation, intervals: dict[str, ParameterInterval]
) -> Identification:
    return Identification(
        formulation, intervals, formulation.problem, Options(), formulation.assumptions
    )


def identified(
    formulation: setid.Formulation, box: list[tuple[float, float]] | None = None
) -> Identification:
    """Exact intervals and witnesses of a formulation with linear rows in theta alone.

    With ``box`` the outer intervals are those, without witnesses, whatever the rows are.
    """
    names = formulation.parameters
    if box is not None:
        partial = IntervalStatus.PARTIAL
        found = {n: ParameterInterval(n, b, None, partial) for n, b in zip(names, box, strict=True)}
        return result_of(formulation, found)
    wide = identified(formulation, [(-1e4, 1e4)] * len(names))
    cover = cover_of(wide)
    assert cover.exact
    intervals = {}
    for i, name in enumerate(names):
        direction = np.eye(len(names))[i]
        low, high = supports(cover, [direction])[0].tolist()
        below = sps.csr_array(cover.matrix), cover.right
        ends = [solve_scaled(sign * direction, below).x for sign in (1.0, -1.0)]
        attained = (float(ends[0][i]), float(ends[1][i]))
        intervals[name] = ParameterInterval(
            name, (low, high), attained, IntervalStatus.CERTIFIED, (ends[0], ends[1])
        )
    return result_of(formulation, intervals)


def empty(formulation: setid.Formulation) -> Identification:
    """A result that says that nothing is consistent."""
    status, inf = IntervalStatus.EMPTY, float("inf")
    found = {n: ParameterInterval(n, (inf, -inf), None, status) for n in formulation.parameters}
    return result_of(formulation, found)


def second_order(bound: float = 0.5, samples: int = 120) -> Identification:
    """The second-order plant of the laboratories with equation errors."""
    from identification_cases import laboratory_two_second

    data = laboratory_two_second(bound, samples)
    model = setid.TransferFunction(na=2, nb=3)
    return identified(setid.formulate(data, model, setid.Noise(equation=bound)))


def first_order() -> Identification:
    """Four samples of a first-order plant; its feasible set is a quadrangle."""
    from identification_cases import laboratory_two_first

    model = setid.TransferFunction(na=1, nb=1)
    return identified(setid.formulate(laboratory_two_first(), model, setid.Noise(equation=0.5)))
