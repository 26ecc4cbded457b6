"""Structures z = G r, y1 = N(z) with a single internal signal z, as cells need them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from setid.formulation.formulation import Formulation
from setid.models.block import BlockStructured
from setid.models.equations import Equation, Lagged, channel_of

__all__ = ["Parts", "parts_of"]

Reals = NDArray[np.float64]


class Parts(NamedTuple):
    """What the method needs of a structure z = G r, y1 = N(z)."""

    signal: str
    poles: tuple[str, ...]
    words: tuple[tuple[str, ...], ...]  # products of parameters, one a coordinate
    constants: Reals  # and what else multiplies them
    drives: Reals  # (q, N)
    drive_noise: Reals  # (q, N)
    weights: tuple[str, ...]
    powers: tuple[int, ...]
    initial: int  # unknown first samples of z


def parts_of(formulation: Formulation) -> Parts | None:
    """The parts, None where the structure is another one or more than one record is given."""
    model, data = formulation.model, formulation.data
    if not isinstance(model, BlockStructured) or model.outputs != 1 or data.records != 1:
        return None
    maps = dict(model.maps)
    if "y1" not in maps or not maps["y1"].polynomial or len(maps["y1"].arguments) != 1:
        return None
    signal = maps["y1"].arguments[0]
    blocks = [b for b in model.blocks if b.target == signal]
    bare = model.changed(fixed=(), unit_gain=())
    equations = {e.defines: e for e in bare.equations(())}
    if len(blocks) != 1 or channel_of(signal) is not None or signal not in equations:
        return None
    equation = equations[signal]
    poles = bare.wiring.transfer(blocks[0]).denominator
    fixed = {name for name, _ in model.fixed}
    if fixed & set(poles) or any(len(t.signals) != 1 for t in equation.terms[: len(poles) + 1]):
        return None
    drives = _drives(equation, len(poles), signal, formulation)
    if drives is None:
        return None
    words, values, spread, constants = drives
    powers = tuple(p[0] for p in maps["y1"].basis if not callable(p))
    initial = 0 if model.initial == "zero" else equation.lag
    return Parts(
        signal, poles, words, constants, values, spread, bare.wiring.weights("y1"), powers, initial
    )


def _drives(
    equation: Equation, poles: int, signal: str, formulation: Formulation
) -> tuple[tuple[tuple[str, ...], ...], Reals, Reals, Reals] | None:
    """Samples of what each product of parameters multiplies, and how far noise moves them."""
    data = formulation.data
    bound = formulation.noise.bounds(data)[1]
    model = formulation.model
    assert isinstance(model, BlockStructured)
    driven = model.driven(data.u)
    words, values, spread = [], [], []
    for item in equation.terms[1 + poles :]:
        if any(s.signal == signal for s in item.signals):
            return None
        value, noisy = np.full(data.samples, -item.coefficient), np.zeros(data.samples)
        for factor in item.signals:
            column, width = _samples(factor, data.u, bound, driven)
            if column is None:
                return None
            noisy = np.abs(value) * width + noisy * (np.abs(column) + width)
            value = value * column
        words.append(item.parameters)
        values.append(value)
        spread.append(noisy * (1 + 1e-12) + 1e-14 * np.abs(value))
    if not words or np.any(np.isnan(values)):
        return None
    size = np.maximum(np.abs(values).max(axis=1), 1e-300)
    scaled = np.array(values) / size[:, None]
    wide = np.array(spread) / size[:, None] * (1 + 1e-12) + 1e-15
    return tuple(words), scaled, wide, 1.0 / size


def _samples(
    factor: Lagged, u: Reals, bound: Reals, driven: Mapping[str, Reals]
) -> tuple[Reals | None, Reals]:
    found = channel_of(factor.signal)
    if found is None:
        column, width = driven.get(factor.signal), np.zeros(u.shape[0])
    elif found[0] == "u":
        column, width = u[:, found[1]], bound[:, found[1]]
    else:
        return None, np.zeros(u.shape[0])
    if column is None:
        return None, width
    late, wide = np.zeros(u.shape[0]), np.zeros(u.shape[0])
    late[factor.lag :], wide[factor.lag :] = (
        column[: u.shape[0] - factor.lag],
        width[: u.shape[0] - factor.lag],
    )
    return late, wide
