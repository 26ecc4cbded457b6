"""Search for samples that contradict each other, where no parameters are consistent.

Samples are left out as long as the rows of the others are still proved to have no common point,
box included: halves of the record first, single samples last. Whenever the time ends, what is
left is proved. Where the box alone is empty, those that its last programs used are tried first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from math import inf

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import frozen
from setid.formulation.formulation import Formulation
from setid.formulation.regression import Regression
from setid.formulation.units import in_units
from setid.proofs.cells.output_cells import CellBox
from setid.proofs.denominators.denominator_box import DenominatorBox
from setid.proofs.parameter_box import ProvedBox, problem_on_box, product_rows, start_of
from setid.proofs.simulated.tree import SimulatedBox
from sparsepop_py.budget import Deadline
from sparsepop_py.uncertain_rows.lifted_products import lifted_box
from sparsepop_py.uncertain_rows.sign_tree import parameter_box
from sparsepop_py.verified.uncertain_rows.lifted_products import LiftedBox
from sparsepop_py.verified.uncertain_rows.products import ProductRows
from sparsepop_py.verified.uncertain_rows.sign_tree import ParameterBox

__all__ = ["conflicting_rows", "conflicting_samples", "samples_listed"]

Keys = tuple[tuple[int, int], ...]
Known = Regression | ProductRows
_MOST = 12  # samples that a sentence lists
_ARRAYS = tuple(item.name for item in fields(Regression) if item.name != "names")


def samples_listed(samples: Keys, records: int) -> str:
    """List samples for a sentence, with the record where there are several; many are counted.

    Parameters
    ----------
    samples : tuple of (record, sample)
    records : int
        Of the data.

    Examples
    --------
    >>> samples_listed(((1, 4), (1, 5)), 1), samples_listed(((1, 4), (2, 0)), 2)
    ('4, 5', '1:4, 2:0')
    """
    named = [f"{record}:{k}" if records > 1 else str(k) for record, k in samples]
    shown, more = ", ".join(named[:_MOST]), len(named) - _MOST
    return shown + (f" and {more} more" if more > 0 else "")


def conflicting_rows(formulation: Formulation, box: ProvedBox) -> Keys:
    """Find samples whose rows alone give an empty box, as the whole record does.

    Parameters
    ----------
    formulation : Formulation
    box : ParameterBox, DirectionBox, LiftedBox, CellBox, DenominatorBox or SimulatedBox
        Proved empty. Its last programs say which rows they use, but the box on which they stand
        may rest on others.

    Returns
    -------
    tuple of (record, sample)
        From 1; none where the rows of these programs are not enough.
    """
    known, smoothed = _known(formulation), formulation.smoothed
    if isinstance(box, CellBox | DenominatorBox | SimulatedBox) or known is None:
        return ()
    if isinstance(box, LiftedBox):
        found = _keys(box, known) if isinstance(known, ProductRows) else []
    else:
        found = [] if smoothed is None else _keys(box, smoothed)
    empty = bool(found) and _box(known, set(found), start_of(formulation)).empty
    return tuple(found) if empty else ()


def _keys(box: ProvedBox, rows: Known) -> list[tuple[int, int]]:
    """(record, sample) of the rows that prove emptiness, most frequent first."""
    assert not isinstance(box, CellBox | DenominatorBox | SimulatedBox)
    known = rows.regression if isinstance(rows, ProductRows) else rows
    assert isinstance(known, Regression)
    count: dict[tuple[int, int], int] = {}
    for row, times in box.used_rows(known).items():
        key = int(known.record[row]), int(known.sample[row])
        count[key] = count.get(key, 0) + times
    return sorted(count, key=lambda key: (-count[key], key))


def conflicting_samples(
    formulation: Formulation, options: sp.Options | None, deadline: Deadline
) -> Keys:
    """Find samples whose rows alone are proved to contradict each other.

    Parameters
    ----------
    formulation : Formulation
        Whose feasible set is proved empty.
    options : sparsepop_py.Options or None
        Of the engine; None: the box from the data alone is to be empty.
    deadline : Deadline

    Returns
    -------
    tuple of (record, sample)
        From 1; all samples with a row where no part of them could be left out.
    """
    keys = tuple(sorted(formulation.rows.samples))
    known = _known(formulation)
    if formulation.products is not None and options is not None:
        known = None  # the engine's rows hold internal signals
    if known is None:  # no rows in theta alone that belong to single samples
        return keys
    size = len(keys) // 2
    try:
        while size and not deadline.over:
            for part in _parts(keys, size):
                rest = tuple(key for key in keys if key not in part)
                if deadline.over or not rest:
                    continue
                if _proved_empty(formulation, known, rest, options, deadline):
                    keys = rest
            size //= 2
    except KeyboardInterrupt:
        pass  # what remains is proved already
    return keys


def _known(formulation: Formulation) -> Known | None:
    """Rows in theta, or in its monomials, that belong to single samples."""
    return formulation.regression or product_rows(formulation)


def _parts(keys: Keys, size: int) -> Iterator[frozenset[tuple[int, int]]]:
    """Neighbours in groups, the last samples first."""
    for begin in range(0, len(keys), size)[::-1]:
        yield frozenset(keys[begin : begin + size])


def _proved_empty(
    formulation: Formulation,
    known: Known,
    kept: Keys,
    options: sp.Options | None,
    deadline: Deadline,
) -> bool:
    """Prove that the rows of some samples have no common point."""
    problem, box = formulation.problem, _box(known, set(kept), start_of(formulation), deadline.end)
    if box.empty or options is None:
        return box.empty
    if not np.all(np.isfinite(box.lower) & np.isfinite(box.upper)):
        return False
    stays = {(0, 0), *kept}
    keys = zip(formulation.rows.record.tolist(), formulation.rows.sample.tolist(), strict=True)
    rows = [row for row, key in zip(problem.constraints, keys, strict=True) if key in stays]
    part = sp.Problem(0.0 * problem.objective, rows, problem.lower, problem.upper, problem.names)
    about = in_units(problem_on_box(replace(formulation, problem=part), box), formulation).problem
    return sp.solve(about, replace(options, **deadline.limits)).status is sp.Status.INFEASIBLE


def _box(
    known: Known, kept: set[tuple[int, int]], start: NDArray[np.float64], until: float = inf
) -> ParameterBox | LiftedBox:
    """The box that the rows of some samples give."""
    if isinstance(known, ProductRows):
        assert isinstance(known.regression, Regression)
        return lifted_box(replace(known, regression=_part(known.regression, kept)), start, until)
    return parameter_box(_part(known, kept), start, until)


def _part(rows: Regression, kept: set[tuple[int, int]]) -> Regression:
    """The rows of some samples."""
    keys = zip(rows.record.tolist(), rows.sample.tolist(), strict=True)
    mine = np.array([key in kept for key in keys], bool)
    return Regression(rows.names, *(frozen(getattr(rows, name)[mine]) for name in _ARRAYS))
