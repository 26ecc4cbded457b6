"""Parameters that a record does not tell apart, since their signals depend on each other.

An input that never changes, for one, and an offset: b1 u + c is all that the record speaks of.
"""

from __future__ import annotations

import numpy as np

from setid.formulation.formulation import Formulation

__all__ = ["dependent_parameters", "dependent_text"]

_RANK = 1e-10  # of the largest singular value of columns of norm 1


def dependent_parameters(formulation: Formulation) -> dict[str, float]:
    """Find a change of parameters along which no equation of the record changes.

    Parameters
    ----------
    formulation : Formulation

    Returns
    -------
    dict
        Names of parameters and what is added to each; empty where there is none. It is computed
        in floating-point arithmetic, and explains results; it proves nothing.

    Examples
    --------
    >>> import setid, warnings
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore")  # that the input is constant
    ...     data = setid.IOData([2.0] * 5, [0.0, 0.9, 1.6, 1.8, 2.1])
    >>> model = setid.TransferFunction(na=1, nb=1, offset=True)
    >>> dependent_parameters(setid.formulate(data, model, setid.Noise(output=0.2)))
    {'b0': 1.0, 'c': -2.0}
    """
    rows, problem = formulation.regression, formulation.problem
    if rows is None or not len(rows.target):
        return {}
    p = len(formulation.parameters)
    exact = np.all(rows.radii == 0.0, axis=0)  # signals without noise
    exact &= np.isneginf(problem.lower[:p]) & np.isposinf(problem.upper[:p])
    places = np.flatnonzero(exact)
    columns = rows.regressors[:, places]
    norms = np.linalg.norm(columns, axis=0)
    places, columns, norms = places[norms > 0.0], columns[:, norms > 0.0], norms[norms > 0.0]
    if places.size < 2:
        return {}
    _, sizes, right = np.linalg.svd(columns / norms)
    if np.count_nonzero(sizes > _RANK * sizes[0]) == places.size:
        return {}
    change = right[-1] / norms
    kept = np.abs(right[-1]) > _RANK
    change = np.round(change[kept] / change[kept][0], 12)
    names = [rows.names[place] for place in places[kept]]
    return dict(zip(names, change.tolist(), strict=True))


def dependent_text(formulation: Formulation) -> str:
    """Say which parameters the record does not tell apart; empty where there are none.

    Parameters
    ----------
    formulation : Formulation
    """
    found = dependent_parameters(formulation)
    if not found:
        return ""
    names = ", ".join(found)
    only = ""
    if len(found) == 2:
        (first, one), (second, other) = found.items()
        only = f"; it speaks of {-other / one:.6g} {first} + {second} alone"
    return (
        f"the record does not tell {names} apart: adding multiples of "
        f"({', '.join(f'{step:.6g}' for step in found.values())}) changes no equation, as where an "
        f"input never changes{only}. No time and no longer record of this kind bounds them: fix "
        "one by Box, or excite the input"
    )
