"""Proofs whose fields are of other types than their classes state, and processes that round so."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import setid
from setid import neural
from setid.data.checks import FrozenMapping
from setid.proofs.cells.output_cells import CellBox
from setid.proofs.denominators.denominator_box import DenominatorBox
from setid.proofs.denominators.denominator_cells import Cell, DenominatorCells
from setid.proofs.denominators.varying_multipliers import VaryingCells, VaryingLeaf
from setid.proofs.fields import well_formed
from setid.proofs.least_noise.least_error import Multipliers, equation_bound
from setid.proofs.parameter_box import ParameterBox, box_follows, start_of
from setid.proofs.simulated.tree import SimulatedBox, TreeNode
from setid.proofs.uniqueness.unbounded import Unbounded, moved_parameters, simpler_structures
from sparsepop_py.verified.arithmetic import interval

QUIET = setid.Options(progress=False)


def gain(noise: float) -> setid.Formulation:
    """y = b u: readings 0 and 3 at inputs 1 and 2; a gain of 1 needs noise of 1."""
    data = setid.IOData([1.0, 2.0], [0.0, 3.0])
    return setid.formulate(data, setid.TransferFunction(0, 1), setid.Noise(output=noise))


def bounded() -> tuple[setid.Formulation, np.ndarray]:
    data = setid.IOData([1.0, 2.0], [0.5, 1.0])
    prior = setid.Box({"b0": (-9.0, 9.0)})
    known = setid.formulate(data, setid.TransferFunction(0, 1), setid.Noise(output=0.1), prior)
    return known, start_of(known)


@pytest.mark.parametrize("share", [np.int8(-128), np.float64(1.0), 1.0])
def test_short_numbers_refute_no_consistent_record(share: Any) -> None:
    """The size of -128 in eight bits is -128: the noise would count as less than nothing."""
    only = VaryingLeaf(used=((0,),), shares=(share,), powers=(0,))
    tree = VaryingCells(0, [0], [[-2.0, 1.0]], (only,))
    assert not tree.verify(gain(1.1))
    assert tree.verify(gain(0.9)) == isinstance(share, float)


CELL = Cell((1, 2), (0, 1), (1, 1))
LEAF = VaryingLeaf(((0,),), (1.0,), (0,))


@pytest.mark.parametrize(
    "cells",
    [
        (CELL._replace(weights=(np.int64(2**62), np.int64(2**62))),),
        (CELL._replace(children=(True, 2)),),
        (LEAF._replace(powers=(np.uint8(1),)),),
        (LEAF._replace(minors=(np.uint8(1),)),),
        (LEAF._replace(used=((np.int8(0),),)),),
        [LEAF],
    ],
    ids=["weights", "children", "powers", "minors", "numbers", "list"],
)
def test_cells_hold_numbers_of_python(cells: Any) -> None:
    assert well_formed(DenominatorCells(0, [0], [[1.0]], (CELL, LEAF)))
    assert not well_formed(DenominatorCells(0, [0], [[1.0]], cells))


def whole(known: setid.Formulation, start: np.ndarray) -> dict[str, Any]:
    """Boxes of all kinds that claim no more than what is given."""
    names = known.parameters
    first = ParameterBox(names, start[0], start[1], start, ())
    none = np.zeros(0, np.int64), np.zeros(0), np.zeros(0), 0, 0
    return {
        "rows": first,
        "cells": CellBox(names, start[0], start[1], *none),
        "cones": DenominatorBox(names, start[0], start[1], first, (), ()),
        "simulated": SimulatedBox(
            names, start[0], start[1], first, np.ones((1, len(names))), (TreeNode(),)
        ),
    }


@pytest.mark.parametrize("kind", ["rows", "cells", "cones", "simulated"])
def test_boxes_are_arrays_of_doubles(kind: str) -> None:
    known, start = bounded()
    box = whole(known, start)[kind]
    assert box_follows(box, known)
    for other in (
        box.lower.astype(np.float32),
        box.lower.astype(np.int8),
        box.lower.astype(complex),
        np.ma.masked_array(box.lower, False),
        box.lower.tolist(),
    ):
        assert not box_follows(replace(box, lower=other), known)
    assert not box_follows(replace(box, names=("gain",)), known)


def test_multipliers_of_networks_have_sizes() -> None:
    """The size of -128 in eight bits is -128, and what a state explains would count against it."""
    net = neural.Elman([([[0.5]], [[0.5]], [0.0])], ([[1.0]], [0.0]))
    u = np.linspace(-1.0, 1.0, 8)
    y = net.simulate(setid.IOData(u, np.zeros(8)), np.array([0.3]))[:, 0]
    found = neural.output_error(net, setid.IOData(u, y + 0.1), [[-1.0, 1.0]])
    assert found.verify() and found.upper_bound < 0.2
    dual = np.zeros(found.horizon, np.int8)
    dual[0] = -128
    tree = replace(found.tree, split=-1, children=(), dual=dual)
    forged = replace(found, tree=tree, lower_bound=0.5, upper_bound=0.5, tolerance=1.0)
    for status in neural.Status.PROVED, neural.Status.PARTIAL:
        assert "another type" in replace(forged, status=status).verify().reason
    assert well_formed(FrozenMapping({(): found.tree}))
    assert not well_formed(FrozenMapping({(): tree}))


def test_directions_have_signs() -> None:
    """The negative of 1 in eight bits without a sign is 255."""
    known, start = bounded()
    box = whole(known, start)["simulated"]
    assert box.verify(known, start)
    assert not replace(box, directions=box.directions.astype(np.uint8)).verify(known, start)


def test_multipliers_are_fractions() -> None:
    """In 64 bits 2^62 (2 + 2) is 0, and would be orthogonal to regressors of 2."""
    rows = setid.formulate(
        setid.IOData([2.0, -2.0], [1.0, 0.0]), setid.TransferFunction(0, 1), setid.Noise(equation=1)
    ).regression
    assert rows is not None
    wrapped = Multipliers((np.int64(2**62), np.int64(-(2**62))))
    assert equation_bound(rows, "linf", wrapped) == equation_bound(rows, "l1", wrapped) == 0.0


@pytest.mark.parametrize("status", ["certified", "empty"])
def test_words_of_intervals_are_statuses(status: str) -> None:
    """A text compares equal to a status, and is none."""
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    given = data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5)
    found = setid.identify(*given, options=QUIET)
    items = {
        name: replace(item, status=status, inner=None) for name, item in found.intervals.items()
    }
    verdict = replace(found, intervals=FrozenMapping(items)).verify()
    assert verdict.reason == "a field is of another type than its class states"
    physical = setid.Physical({"K": (0, 10)}, ["b0 = K"])
    shown = setid.reparametrise(found, physical, QUIET)
    assert shown.verify()
    own = {"K": replace(shown.intervals["K"], status=status, inner=None)}
    assert "status" in replace(shown, intervals=own).verify().reason


def common_factor() -> tuple[setid.Formulation, Unbounded]:
    """A gain explains the record, and so does each structure with a common factor beside it."""
    data = setid.IOData([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])
    known = setid.formulate(data, setid.TransferFunction(1, 2), setid.Noise(output=0.1))
    lower = next(f for f in simpler_structures(known) if f.parameters == ("b0",))
    gain = setid.TransferFunction(0, 1)
    assert lower.model == gain
    names = moved_parameters(known, gain, np.ones(1))
    witness = lower.point([1.0], output=np.zeros((3, 1)))
    return known, Unbounded(names, gain, np.ones(1), witness)


def test_simpler_structures_have_doubles() -> None:
    known, claim = common_factor()
    assert claim.verify(known)
    assert not replace(claim, theta=np.ones(1, np.int8)).verify(known)


PROOFS = ["rows", "cells", "cones", "simulated", "refuted", "unbounded"]


@pytest.mark.parametrize("kind", PROOFS)
def test_subnormal_numbers_are_needed(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    known, start = bounded()
    monkeypatch.setattr(interval, "_TINY", 0.0)  # what a flushed product looks like
    with pytest.raises(FloatingPointError, match="IEEE"):
        if kind == "refuted":
            VaryingCells(0, [0], [[-2.0, 1.0]], (LEAF,)).verify(gain(0.9))
        elif kind == "unbounded":
            Unbounded((), setid.TransferFunction(0, 1), np.ones(1), np.ones(1)).verify(known)
        else:
            whole(known, start)[kind].verify(known, start)
