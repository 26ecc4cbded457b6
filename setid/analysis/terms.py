"""Terms that a record does not ask for: found by signs or by least sums of sizes, then left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from setid.data.noise import Noise
from setid.data.record import IOData
from setid.errors import ModelError
from setid.formulation.formulation import formulate
from setid.identify import identify
from setid.models.equations import Structure
from setid.models.narx import PolynomialNARX
from setid.options import Options
from setid.priors import Known
from setid.result.identification import Identification
from sparsepop_py.budget import Deadline
from sparsepop_py.lp.scaled import solve_scaled

__all__ = ["Reduced", "idle", "sparse_terms", "without", "without_idle"]

_REWEIGHTED = 4  # linear programs, each with weights from the one before
_ZERO = 1e-7  # relative size of a coefficient that counts as zero in a linear program


@dataclass(frozen=True, slots=True, eq=False)
class Reduced:
    """An attempt to leave terms out, and what it proves.

    Parameters
    ----------
    left_out : tuple of str
    result : Identification
        Of the structure without them: empty where they are needed.
    """

    left_out: tuple[str, ...]
    result: Identification


def idle(result: Identification) -> tuple[str, ...]:
    """List coefficients of which both signs, or zero, are attained.

    Parameters
    ----------
    result : Identification
    """
    found = []
    for name, item in result.intervals.items():
        if item.inner is not None and item.inner[0] <= 0.0 <= item.inner[1]:
            found.append(name)
    return tuple(found)


def without(model: Structure, names: Sequence[str]) -> tuple[Structure, list[Any]]:
    """Drop coefficients: return the structure, and priors that set what it keeps to zero.

    Parameters
    ----------
    model : Structure
    names : sequence of str

    Returns
    -------
    Structure, list of priors
        Polynomial regressions of one output lose the terms; other structures keep them at zero.
    """
    if isinstance(model, PolynomialNARX) and model.outputs == 1:
        pairs = zip(model.parameters, model.terms[0], strict=True)
        kept = [term for name, term in pairs if name not in names]
        if kept:
            changed = PolynomialNARX(
                kept, model.ny, model.nu, model.inputs, 1, model.initial, model.degree_cut
            )
            return changed, []
    return model, [Known(dict.fromkeys(names, 0.0))]


def without_idle(
    result: Identification, given: tuple[IOData, Noise, list[Any], Options], deadline: Deadline
) -> tuple[list[Reduced], tuple[str, ...]]:
    """Leave idle terms out and identify again, until none is left or all are needed.

    All idle terms go together if that explains the record, else one after the other, the one
    whose interval is nearest to zero first. A term that was once proved needed stays.

    Parameters
    ----------
    result : Identification
    given : tuple
        Record, noise, priors and options.
    deadline : Deadline
        For all identifications together.

    Returns
    -------
    list of Reduced
        In order; the last one that is not empty is the smallest structure.
    tuple of str
        Idle terms that time did not suffice for.
    """
    data, noise, priors, options = given
    steps: list[Reduced] = []
    gone: tuple[str, ...] = ()
    needed: set[str] = set()
    current = result
    while True:
        candidates = [n for n in idle(current) if n not in gone and n not in needed]
        if not candidates:
            return steps, ()
        order = sorted(candidates, key=lambda n: abs(current.intervals[n].centre))
        tries = [tuple(candidates)] if len(candidates) > 1 else []
        tries += [(name,) for name in order]
        for place, names in enumerate(tries):
            if deadline.late:
                return steps, tuple(n for n in candidates if n not in needed)
            timed = options.within(deadline, 1.0 / (len(tries) - place))
            step = _tried(result, (*gone, *names), (data, noise, priors, timed))
            steps.append(step)
            if step.result.interrupted:
                deadline.stop()
            if not step.result.empty and any(
                item.inner is not None for item in step.result.intervals.values()
            ):
                gone, current = step.left_out, step.result
                break
            if len(names) == 1:
                needed.add(names[0])
        else:
            return steps, ()


def _tried(
    result: Identification, names: tuple[str, ...], given: tuple[IOData, Noise, list[Any], Options]
) -> Reduced:
    data, noise, priors, options = given
    model, fixed = without(result.formulation.model, names)
    return Reduced(names, identify(data, model, noise, [*priors, *fixed], options))


def sparse_terms(data: IOData, model: Structure, noise: Noise) -> tuple[str, ...]:
    """Find coefficients that are zero where the sum of sizes is least, reweighted.

    Parameters
    ----------
    data : IOData
    model : Structure
        Linear in its parameters, for instance a polynomial regression with many terms.
    noise : Noise

    Returns
    -------
    tuple of str
        A proposal: leaving them out is proved possible or not by an identification.

    Raises
    ------
    ModelError
        If the structure is not linear in its parameters.

    References
    ----------
    E. J. Candes, M. B. Wakin, S. P. Boyd, J. Fourier Anal. Appl. 14 (2008) 877-905.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, 2, -1, 3, 0, 2], [0, 1.0, 2.0, -1.0, 3.0, 0.0])
    >>> model = setid.PolynomialNARX(["u1", "u1^2", "y1"], ny=1, nu=1)
    >>> setid.sparse_terms(data, model, setid.Noise(equation=0.01))
    ('c[u1^2]', 'c[y1]')
    """
    rows = formulate(data, model, noise).regression
    if rows is None:
        raise ModelError("model: found no regression form, expected one linear in its parameters")
    p = rows.regressors.shape[1]
    size = np.maximum(np.abs(rows.regressors).max(axis=0), np.finfo(float).tiny)
    a = rows.regressors / size  # coefficients by what their terms contribute
    right = np.concatenate([rows.radius - rows.target, rows.radius + rows.target])
    split = np.hstack([a, -a])
    below = sps.csr_array(np.vstack([split, -split]))
    weight, found = np.ones(p), np.zeros(p)
    for _ in range(_REWEIGHTED):
        bounds = np.zeros(2 * p), np.full(2 * p, inf)
        solved = solve_scaled(np.concatenate([weight, weight]), (below, right), None, bounds)
        if solved.status != "solved":
            return ()
        found = np.abs(solved.x[:p] - solved.x[p:])
        scale = max(float(found.max()), np.finfo(float).tiny)
        weight = 1.0 / (found / scale + 1e-2)
    return tuple(_names(rows.names, found))


def _names(names: Sequence[str], found: NDArray[np.float64]) -> list[str]:
    least = _ZERO * max(float(found.max()), np.finfo(float).tiny)
    return [name for name, value in zip(names, found, strict=True) if value <= least]
