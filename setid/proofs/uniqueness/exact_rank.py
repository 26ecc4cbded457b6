"""Parameters that sensitivities settle, in arithmetic modulo a prime.

High powers of one signal are nearly dependent in doubles: the powers up to x^30 look like 14. In a
finite field nothing is near: a random simulation there has the sensitivities of a random one, whose
rank can only be too small, and is that with a probability of about 1e-7.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from setid.models.checked_structures import equations_of
from setid.models.equations import Equation, Term
from setid.models.general import BlockStructured
from setid.simulation.simulate import in_order

__all__ = ["moved_parameters"]

_PRIME = 2**31 - 1  # products of two residues fit into 64 bits
_MOST = 100  # parameters
Residues = NDArray[np.int64]
Dual = tuple[int, Residues]  # a value, and its derivatives by the parameters


def moved_parameters(model: BlockStructured, seed: int = 1) -> frozenset[str] | None:
    """Find parameters that a change without first-order change of outputs moves.

    Parameters
    ----------
    model : BlockStructured
    seed : int

    Returns
    -------
    frozenset of str or None
        None for maps that are no polynomials, and for many parameters.

    Examples
    --------
    >>> import setid
    >>> model = setid.Hammerstein(setid.TransferFunction(1, 1, 1), 30, normalise="gamma1")
    >>> moved_parameters(model)
    frozenset()
    """
    names = model.parameters
    if len(names) > _MOST or not all(item.polynomial for _, item in model.maps):
        return None
    rest = model.changed(initial="zero")
    generator = np.random.default_rng(seed)
    place = {name: i for i, name in enumerate(names)}
    theta = {name: int(generator.integers(1, _PRIME)) for name in names}
    gains = []
    for label in model.unit_gain:  # sum b - sum a = 1, with one coefficient that settles it
        block, row = model.linear_blocks[label], np.zeros(len(names), np.int64)
        free = [name for name in block.numerator if name in place]
        if len(free) < len(block.numerator) or not set(block.denominator) <= set(place):
            return None
        total = 1 + sum(theta[name] for name in block.denominator)
        theta[free[-1]] = (total - sum(theta[name] for name in free[:-1])) % _PRIME
        row[[place[name] for name in free]] = 1
        row[[place[name] for name in block.denominator]] = _PRIME - 1
        gains.append(row)
    outputs = _sensitivities(rest, theta, generator)
    if outputs is None:
        return None
    null = _null_space(np.array([*outputs, *gains]))
    return frozenset(name for name, i in place.items() if np.any(null[:, i]))


def _sensitivities(
    model: BlockStructured, theta: Mapping[str, int], generator: np.random.Generator
) -> list[Residues] | None:
    """Derivatives of all samples of outputs from rest; None where a leading factor is zero."""
    size = len(theta)
    inputs = {f"u{i + 1}" for i in range(model.inputs)}
    equations = in_order(equations_of(model), inputs)
    units = np.eye(size, dtype=np.int64)
    duals: dict[str, Dual] = {n: (v, units[i]) for i, (n, v) in enumerate(theta.items())}
    zero: Dual = (0, np.zeros(size, np.int64))
    signals: dict[str, list[Dual]] = {name: [] for name in inputs}
    signals |= {equation.defines: [] for equation in equations}
    found = []
    for _ in range(2 * size + max(e.lag for e in equations) + 5):
        for name in sorted(inputs):
            signals[name].append((int(generator.integers(_PRIME)), zero[1]))
        for equation in equations:
            sample = _sample(equation, duals, signals, zero)
            if sample is None:
                return None
            signals[equation.defines].append(sample)
            if equation.output is not None:
                found.append(sample[1])
    return found


def _sample(
    equation: Equation, duals: Mapping[str, Dual], signals: Mapping[str, list[Dual]], zero: Dual
) -> Dual | None:
    """The next sample of a signal and its derivatives."""
    now = len(signals["u1"]) - 1
    top, lead = zero, (1, zero[1])
    for terms, sign in ((equation.explicit, -1), (equation.implicit, 1)):
        for item in terms:
            past = [s for s in item.signals if sign == -1]
            if any(s.lag > now for s in past):
                continue
            factors = [duals[name] for name in item.parameters]
            factors += [signals[s.signal][now - s.lag] for s in past]
            part = _product(item, factors, zero)
            if sign == -1:
                top = (top[0] - part[0]) % _PRIME, (top[1] - part[1]) % _PRIME
            else:
                lead = (lead[0] + part[0]) % _PRIME, (lead[1] + part[1]) % _PRIME
    if not lead[0]:
        return None
    inverse = pow(lead[0], -1, _PRIME)
    value = top[0] * inverse % _PRIME
    return value, (top[1] - value * lead[1]) % _PRIME * inverse % _PRIME


def _product(item: Term, factors: Sequence[Dual], zero: Dual) -> Dual:
    number = Fraction(float(item.coefficient))
    value = number.numerator * pow(number.denominator, -1, _PRIME) % _PRIME
    slope = zero[1]
    for other, own in factors:
        slope = (slope * other + own * value) % _PRIME
        value = value * other % _PRIME
    return value, slope


def _null_space(matrix: Any) -> Residues:
    """A basis of the vectors that a matrix of residues maps to zero, one a row."""
    rows, columns = matrix.copy(), matrix.shape[1]
    pivots: list[int] = []
    for column in range(columns):
        rank = len(pivots)
        below = np.flatnonzero(rows[rank:, column])
        if not below.size:
            continue
        rows[[rank, rank + below[0]]] = rows[[rank + below[0], rank]]
        rows[rank] = rows[rank] * pow(int(rows[rank, column]), -1, _PRIME) % _PRIME
        others = np.arange(len(rows)) != rank
        rows[others] = (rows[others] - rows[others, column, None] * rows[rank]) % _PRIME
        pivots.append(column)
    free = [column for column in range(columns) if column not in pivots]
    null = np.zeros((len(free), columns), np.int64)
    for number, column in enumerate(free):
        null[number, column] = 1
        null[number, pivots] = -rows[: len(pivots), column] % _PRIME
    return null
