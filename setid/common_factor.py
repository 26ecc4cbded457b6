"""Sets that are unbounded since fewer poles and zeros explain the data as well.

If (A', B') of one order less is consistent, then so is (A' (1 + c q^-1), B' (1 + c q^-1)) for
every c, with the same noise: row k of the higher order is row k plus c times row k - 1 of the
lower one. Coefficients that change with c take values of any size.
"""

from __future__ import annotations

import time
from math import inf

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp

from .boxed import boxed
from .boxes import parameter_box
from .errors import ModelError
from .estimators import least_squares, linf
from .existence import consistent
from .formulation import Formulation, formulate
from .models.lti import TransferFunction
from .starts import first_point
from .units import in_units

__all__ = ["unbounded_names"]

_SECONDS = 5.0  # for the engine to find a consistent vector of lower order


def unbounded_names(formulation: Formulation, until: float = inf) -> tuple[str, ...]:
    """Parameters that are proved to take consistent values of any size.

    Parameters
    ----------
    formulation : Formulation
    until : float
        Reading of ``time.monotonic`` at which the search for a consistent vector of lower order
        ends; it takes no longer than five seconds.

    Returns
    -------
    tuple of str
        Empty where nothing was proved. Only transfer functions of one input and one output
        with free initial conditions, without equation errors, missing samples, noise
        constraints or priors are looked at.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, 0, -1, 1, 0, 1], [2.1, 0, -1.9, 2, 0.1, 2])
    >>> model = setid.TransferFunction(na=1, nb=2)
    >>> unbounded_names(setid.formulate(data, model, setid.Noise(output=0.2)))
    ('a1', 'b1')
    """
    lower = _one_order_less(formulation)
    theta = None if lower is None else _member(lower, min(until, time.monotonic() + _SECONDS))
    if lower is None or theta is None:
        return ()
    assert isinstance(lower.model, TransferFunction)
    na = lower.model.na[0][0]
    slope = np.concatenate([[1.0], theta[:na], [0.0], theta[na:]])
    return tuple(n for n, c in zip(formulation.parameters, slope, strict=True) if c != 0.0)


def _one_order_less(formulation: Formulation) -> Formulation | None:
    """The same data with a pole and a zero less, where the argument above holds."""
    model, data = formulation.model, formulation.data
    if not isinstance(model, TransferFunction) or (model.inputs, model.outputs) != (1, 1):
        return None
    na, nb = model.na[0][0], model.nb[0][0]
    plain = model.initial == "free" and not model.offset and na >= 1 and nb >= 2
    known = not (np.isnan(data.y).any() or np.isnan(data.u).any())
    exact = not np.any(formulation.noise.bounds(data)[2] > 0)
    free = not formulation.priors and not formulation.noise.constraints
    if not (plain and known and exact and free):
        return None
    less = TransferFunction(na - 1, nb - 1, model.nk)
    return formulate(data, less, formulation.noise)


def _member(formulation: Formulation, until: float) -> NDArray[np.float64] | None:
    """A parameter vector that is proved consistent: an estimate, or what the engine finds."""
    p = len(formulation.parameters)
    for estimate in (linf, least_squares):
        try:
            theta = estimate(formulation.data, formulation.model).theta
        except ModelError:
            continue
        if consistent(formulation, theta) is not None:
            return theta
    assert formulation.regression is not None
    box = parameter_box(formulation.regression, None, until)
    left = until - time.monotonic()
    if box.empty or left <= 0:
        return None
    problem = boxed(formulation, box)
    if not np.all(np.isfinite(problem.lower[:p]) & np.isfinite(problem.upper[:p])):
        return None
    problem = problem.with_objective(0.0 * problem.objective)
    options = sp.Options(effort="auto", time_limit=left)
    scaled, start = in_units(problem, formulation), first_point(formulation, problem)
    begin = None if start is None else start / scaled.units
    found = sp.solve(scaled.problem, options, start=begin).attained
    if found is None or consistent(formulation, (found.x * scaled.units)[:p]) is None:
        return None
    return (found.x * scaled.units)[:p]
