"""Search for a simpler structure that explains the data and leaves parameters unbounded.

The arguments, and how they are checked, are in :mod:`setid.proofs.uniqueness.unbounded`.
"""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import frozen
from setid.errors import ModelError
from setid.feasible_points.estimators import least_squares, linf
from setid.feasible_points.start import first_point
from setid.feasible_points.witness import consistent
from setid.formulation.formulation import Formulation, formulate
from setid.minimum_noise.factor import search_factor
from setid.models.lti import TransferFunction
from setid.proofs.least_noise.noise_scale import scaled_noise
from setid.proofs.uniqueness.unbounded import Unbounded, moved_parameters, simpler_structures
from sparsepop_py.budget import Deadline

__all__ = ["find_unbounded"]

_MOST = 5.0  # seconds, or units of work, to find a consistent vector of each simpler structure
_WIDE = 2.0  # times the noise bounds: where the engine begins


def find_unbounded(formulation: Formulation, until: float = inf) -> Unbounded | None:
    """Search for a proof that some parameters take consistent values of any size.

    Parameters
    ----------
    formulation : Formulation
    until : float
        Reading of ``time.monotonic`` at which the search ends; it takes no longer than five
        seconds for each simpler structure, or units of work where no moment ends it.

    Returns
    -------
    Unbounded or None
        None where nothing was proved. Only transfer functions of one input and one output
        with free initial conditions, without equation errors, missing samples, noise
        constraints or priors are looked at.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, 0, -1, 1, 0, 1], [2.1, 0, -1.9, 2, 0.1, 2])
    >>> model = setid.TransferFunction(na=1, nb=2)
    >>> find_unbounded(setid.formulate(data, model, setid.Noise(output=0.2))).names
    ('a1', 'b1')
    """
    for lower in simpler_structures(formulation):
        witness = _member(lower, Deadline.before(until, _MOST))
        if witness is not None:
            assert isinstance(lower.model, TransferFunction)
            theta = np.array(witness[: len(lower.parameters)])
            names = moved_parameters(formulation, lower.model, theta)
            return Unbounded(names, lower.model, frozen(theta), frozen(np.array(witness)))
    return None


def _member(formulation: Formulation, deadline: Deadline) -> NDArray[np.float64] | None:
    """Find unknowns (n,) that are proved consistent, from an estimate or by the engine."""
    p = len(formulation.parameters)
    for estimate in (linf, least_squares):
        try:
            theta = estimate(formulation.data, formulation.model).theta
        except ModelError:
            continue
        witness = consistent(formulation, theta)
        if witness is not None:
            return witness
    noise = scaled_noise(formulation.noise.bounds(formulation.data), _WIDE)
    wide = formulate(formulation.data, formulation.model, noise)
    found = search_factor(wide, first_point(wide, wide.problem), deadline)
    return None if found is None else consistent(formulation, found.x[:p])
