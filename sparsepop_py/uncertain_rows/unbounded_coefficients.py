"""Search for limits of coefficients that quotients leave without bounds.

The faces of :mod:`sparsepop_py.verified.uncertain_rows.unbounded_coefficients` are given to the
engine. Large limits are proved fast, since s is nearly zero there; smaller ones follow as long as
that is cheap.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.budget import Deadline
from sparsepop_py.options import Options
from sparsepop_py.pipeline import solve
from sparsepop_py.verified.certificate.certificate import Certificate
from sparsepop_py.verified.uncertain_rows.coupled import CoupledRows
from sparsepop_py.verified.uncertain_rows.products import ProductRows
from sparsepop_py.verified.uncertain_rows.unbounded_coefficients import CoefficientLimit, Faces

__all__ = ["limit_coefficients"]

Reals = NDArray[np.float64]
_REACHES = (2.0**10, 2.0**7, 2.0**4)  # one after the other, in units
_MOST = 20.0  # seconds for all faces of one reach, or units of work


def limit_coefficients(
    coupled: CoupledRows, rows: ProductRows, ends: Reals, box: Reals, until: float
) -> CoefficientLimit | None:
    """Bound the parameters that have no bounds, as tightly as a short time allows.

    Parameters
    ----------
    coupled : CoupledRows
    rows : ProductRows
        Its rows in products of parameters.
    ends : (2, q) float
        Proved bounds of the columns of the rows.
    box : (2, p) float
        Proved bounds of the parameters.
    until : float
        Reading of ``time.monotonic`` at which all work ends; at most half of it is for this.

    Returns
    -------
    CoefficientLimit or None
        None where rows are no products as above, or where nothing was proved.
    """
    faces, found = Faces.of(coupled, rows, ends, box), None
    if faces is None:
        return None
    whole = Deadline.before(until, np.inf, 0.5)
    try:
        for size in _REACHES:
            deadline = Deadline.before(whole.end, _MOST)
            proofs = _prove_faces(faces, size * faces.unit, deadline)
            if proofs is None:
                return found
            found = CoefficientLimit(faces.far, size * faces.unit, proofs)
    except KeyboardInterrupt:  # what is proved so far holds
        return found
    return found


def _prove_faces(
    faces: Faces, reach: float, deadline: Deadline
) -> tuple[Certificate | None, ...] | None:
    """Prove that no face holds a consistent point; None if not proved."""
    found = list[Certificate | None]()
    for face in faces.far:
        box = faces.unknowns(face, reach)
        if np.any(box[0] > box[1]):
            found.append(None)
            continue
        if deadline.over or not np.all(np.isfinite(box)):
            return None
        options = replace(Options(effort="auto"), **deadline.limits)
        proof = solve(faces.problem(face, box), options).certificate
        if proof is None or proof.bound != np.inf:
            return None
        found.append(proof)
    return tuple(found)
