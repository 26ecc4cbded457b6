"""Boxes of theta from rows in its monomials, with sums that the engine bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import setid
from benchmarks.block_structured import KINDS, record
from setid.boxed import box_follows, proved_box
from setid.lifted import LiftedBox


def test_sums_over_shared_samples_bound_slow_poles() -> None:
    """Row by row 1 + a1 + a2 may be zero, and static gain 1 leaves all else without bounds."""
    truth, noise = record("hammerstein 2", 20, 5.0)
    model, theta, _ = KINDS["hammerstein 2"]
    formulation = setid.formulate(truth.data, model, noise)
    box = proved_box(formulation)
    assert isinstance(box, LiftedBox) and box.sharper
    assert np.all(np.isfinite([box.lower, box.upper]))
    assert np.all((box.lower <= theta) & (box.upper >= theta))
    assert box_follows(box, formulation)
    without = replace(box, sharper=())
    assert not box_follows(without, formulation)  # it does not follow from the rows alone
    first = box.sharper[0]
    assert first is not None
    forged = (replace(first, bound=first.bound + 0.1), *box.sharper[1:])
    assert not box_follows(replace(box, sharper=forged), formulation)
    narrower = replace(box, lower=box.lower + 1e-3 * (box.upper - box.lower))
    assert not box_follows(narrower, formulation)
