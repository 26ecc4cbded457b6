"""Copies of public objects: their arrays are read-only, as those of the objects are."""

import copy
import dataclasses
import inspect
import pickle
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import setid
import sparsepop_py as sp
from setid import control, neural
from setid.data.checks import FrozenMapping
from setid.neural.last_layers.last_layer import LayerBand, OutputSet
from setid.proofs.denominators.denominator_cells import DenominatorCells
from setid.proofs.least_noise.noise_scale import NoiseScale
from sparsepop_py.verified.uncertain_rows.box import Bounds
from sparsepop_py.verified.uncertain_rows.rows import UncertainRows

INNER = [Bounds, DenominatorCells, LayerBand, NoiseScale, OutputSet, UncertainRows]
SOLVERS = {sp.ConicProgram, sp.ConicSolution}  # whose arrays are not read-only
COPIES: list[Callable[[Any], Any]] = [
    copy.copy,
    copy.deepcopy,
    lambda value: pickle.loads(pickle.dumps(value, 4)),
    lambda value: pickle.loads(pickle.dumps(value, 5)),
]


def has_arrays(kind: Any) -> bool:
    if not inspect.isclass(kind) or not dataclasses.is_dataclass(kind) or kind in SOLVERS:
        return False
    types = " ".join(str(field.type) for field in dataclasses.fields(kind))
    return kind is setid.Noise or bool(re.search("NDArray|Reals", types))


def public() -> list[type]:
    found = {getattr(room, name) for room in (setid, control, neural, sp) for name in room.__all__}
    return sorted(filter(has_arrays, found), key=lambda kind: (kind.__module__, kind.__name__))


def arrays_in(value: Any) -> list[np.ndarray]:
    if isinstance(value, np.ndarray):
        return [value]
    parts = value if isinstance(value, tuple) else value.values()
    return [array for part in parts for array in arrays_in(part)]


@pytest.mark.parametrize("kind", [*public(), *INNER])
def test_arrays_of_copies_are_read_only(kind: type) -> None:
    array = np.array([0.5, 2.0])
    array.flags.writeable = False
    value = array, FrozenMapping({"a1": array})
    names = [field.name for field in dataclasses.fields(kind)]  # type: ignore[arg-type]
    made = object.__new__(kind)  # whatever its fields mean
    for name in names:
        object.__setattr__(made, name, value)
    for copied in COPIES:
        again = copied(made)
        assert type(again) is kind
        found = [each for name in names for each in arrays_in(getattr(again, name))]
        assert len(found) == 2 * len(names)
        for each in found:
            assert np.array_equal(each, array) and not each.flags.writeable


def test_what_makes_parameters_consistent_is_read_only() -> None:
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    model, noise = setid.TransferFunction(1, 1), setid.Noise(output=0.5)
    known = setid.formulate(data, model, noise)
    assert not setid.least_noise(known, [-0.5, 2.0]).x.flags.writeable
    found = setid.consistency(data, model, noise, (), setid.Options(tol=0.9))
    for other in (found, copy.deepcopy(found), pickle.loads(pickle.dumps(found))):
        assert not other.theta.flags.writeable and not other.witness.flags.writeable
        assert other.scale == found.scale and other.verify()
