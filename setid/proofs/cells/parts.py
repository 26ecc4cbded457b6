"""Find z = G r and y1 = N(z) or y1 = H N(z) in a structure: what cells of G ask of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from setid.formulation.formulation import Formulation
from setid.models.block import BlockStructured
from setid.models.equations import Equation, Lagged, channel_of

__all__ = ["Column", "Parts", "can_start", "parts_of", "row_noise", "with_impulses"]

Reals = NDArray[np.float64]


class Column(NamedTuple):
    """A sample z(k - lag)^power, and the product of parameters that multiplies it."""

    lag: int
    power: int
    word: tuple[str, ...]


class Parts(NamedTuple):
    """Parts of a structure z = G r, y1 = N(z) or y1 = H N(z) that the method uses."""

    signal: str
    label: str  # of G
    poles: tuple[str, ...]
    words: tuple[tuple[str, ...], ...]  # products of parameters, one a coordinate
    constants: Reals  # and what else multiplies them
    drives: Reals  # (q, N): of the words, then impulses for samples that are coordinates
    drive_noise: Reals  # (q, N)
    past: tuple[str, ...]  # denominator of H
    numerator: tuple[str, ...]  # of H where its static gain is 1, else empty
    columns: tuple[Column, ...]
    initial: int  # unknown first samples of z
    begin: int | None  # the sample of z before which nothing is said of it; None: it is zero there


def parts_of(formulation: Formulation) -> Parts | None:
    """Find the parts of a structure; None for others and for several records."""
    model, data = formulation.model, formulation.data
    if not isinstance(model, BlockStructured) or model.outputs != 1 or data.records != 1:
        return None
    bare = model.changed(fixed=(), unit_gain=())
    behind = _behind(bare)
    if behind is None:
        return None
    signal, past, numerator, columns = behind
    label = [b.label for b in model.blocks if b.target == "y1"]
    numerator = numerator if set(label) & set(model.unit_gain) else ()
    blocks = [b for b in model.blocks if b.target == signal]
    equations = {e.defines: e for e in bare.equations(())}
    if len(blocks) != 1 or channel_of(signal) is not None or signal not in equations:
        return None
    equation = equations[signal]
    poles = bare.wiring.transfer(blocks[0]).denominator
    fixed = {name for name, _ in model.fixed}
    if fixed & {*poles, *past} or any(
        len(t.signals) != 1 for t in equation.terms[: len(poles) + 1]
    ):
        return None
    drives = _drives(equation, len(poles), signal, formulation)
    if drives is None:
        return None
    words, values, spread, constants = drives
    initial = 0 if model.initial == "zero" else equation.lag
    values[:, :initial], spread[:, :initial] = 0.0, 0.0
    return Parts(
        signal,
        blocks[0].label,
        poles,
        words,
        constants,
        values,
        spread,
        past,
        numerator,
        columns,
        initial,
        None if model.initial == "zero" or initial else 0,
    )


def can_start(parts: Parts) -> bool:
    """Check that rows can be freed of unknown first samples of z, if there are any.

    Parameters
    ----------
    parts : Parts
    """
    powers = {column.power for column in parts.columns}
    return not parts.initial or (len(parts.poles) == 1 and max(powers) in (1, 2))


def with_impulses(parts: Parts) -> Parts:
    """Take the last unknown samples of z as coordinates, from which on it follows.

    An impulse at such a sample stands for what came before: z_k + sum_i a_i z_(k-i) may be anything
    there, and afterwards is what the inputs say. Samples before these are left out.

    Parameters
    ----------
    parts : Parts
        With unknown first samples.
    """
    order, samples = len(parts.poles), parts.drives.shape[1]
    begin = parts.initial - order
    return parts._replace(
        drives=np.concatenate([parts.drives, np.eye(order, samples, begin)]),
        drive_noise=np.concatenate([parts.drive_noise, np.zeros((order, samples))]),
        initial=0,
        begin=begin,
    )


def row_noise(formulation: Formulation) -> Reals:
    """Bound what output noise of the newest sample and equation errors change, (N,).

    Parameters
    ----------
    formulation : Formulation
    """
    output, _, equation = formulation.noise.bounds(formulation.data)
    return np.asarray((output[:, 0] + equation[:, 0]) * (1 + 1e-15), np.float64)


Behind = tuple[str, tuple[str, ...], tuple[str, ...], tuple[Column, ...]]


def _behind(bare: BlockStructured) -> Behind | None:
    """The signal z before the map, H, and the columns of rows that the map and H make of z."""
    maps, wiring = dict(bare.maps), bare.wiring
    before = [b for b in bare.blocks if b.target == "y1"]
    name, past, numerator, delay = "y1", tuple[str, ...](), tuple[str, ...](), 0
    if before:
        if len(before) > 1 or len(before[0].source) > 1 or before[0].source[0][1] != 1.0:
            return None
        name, transfer = before[0].source[0][0], wiring.transfer(before[0])
        past, numerator, delay = transfer.denominator, transfer.numerator, transfer.delay
    if name not in maps or not maps[name].polynomial or len(maps[name].arguments) != 1:
        return None
    powers = [p[0] for p in maps[name].basis if not callable(p)]
    own = list(zip(wiring.weights(name), powers, strict=True))
    if not before:
        return maps[name].arguments[0], (), (), tuple(Column(0, p, (w,)) for w, p in own)
    found = [
        Column(delay + j, power, (b, weight))
        for j, b in enumerate(numerator)
        for weight, power in own
    ]
    return maps[name].arguments[0], past, numerator, tuple(found)


def _drives(
    equation: Equation, poles: int, signal: str, formulation: Formulation
) -> tuple[tuple[tuple[str, ...], ...], Reals, Reals, Reals] | None:
    """Samples of what each product of parameters multiplies, and how far noise moves them."""
    data = formulation.data
    bound = formulation.noise.bounds(data).input
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
