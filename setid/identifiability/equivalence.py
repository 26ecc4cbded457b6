"""Parameter vectors of block structures with the same outputs, and which of them is meant.

How scales and shifts change parameters is in :mod:`setid.proofs.uniqueness.normalisation`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import combinations
from itertools import product as cartesian
from typing import cast

from numpy.typing import ArrayLike

from setid.data.checks import number, parameters_of
from setid.errors import ModelError, SetidError
from setid.feasible_set.feasible_set import FeasibleSet, check_result
from setid.models.block import BlockStructured, Lure, Normalise
from setid.proofs.intervals import IntervalStatus
from setid.proofs.uniqueness.normalisation import (
    check_restrictions,
    convert_ends,
    loop_shift,
    scaled_signals,
)
from sparsepop_py.verified.arithmetic.scalar_interval import (
    Ends,
)

__all__ = ["convert", "convert_intervals", "equivalent"]


def convert(
    model: BlockStructured, theta: ArrayLike | Mapping[str, float], normalise: Normalise
) -> dict[str, float]:
    """Convert a parameter vector to the equivalent one in another normalisation.

    Parameters
    ----------
    model : BlockStructured
        The structure that ``theta`` belongs to, with its own normalisation.
    theta : array_like (p,) or mapping of names to numbers
    normalise
        The other normalisation, as :class:`BlockStructured` takes it.

    Returns
    -------
    dict of str to float
        Parameters of ``model.normalised(normalise)``.

    Raises
    ------
    ModelError
        If there is no such vector (a quantity that is to be fixed is zero, or has another value
        that no scale changes), or the normalisation leaves a scale open.

    Examples
    --------
    >>> import setid
    >>> model = setid.Hammerstein(setid.TransferFunction(1, 1, 1), 2, normalise="gamma1")
    >>> other = setid.convert(model, {"a1": -0.5, "b1": 2.0, "gamma2": 0.25}, "dcgain")
    >>> {name: round(value, 9) for name, value in other.items()}
    {'a1': -0.5, 'b1': 0.5, 'gamma1': 4.0, 'gamma2': 1.0}
    """
    _check(model)
    values = parameters_of(theta, model.parameters).tolist()
    ends = {name: (value, value) for name, value in zip(model.parameters, values, strict=True)}
    found = convert_ends(model, ends, normalise)
    return {name: 0.5 * low + 0.5 * high for name, (low, high) in found.items()}


def _check(model: BlockStructured) -> None:
    if not isinstance(model, BlockStructured):
        raise ModelError(f"model: found {type(model).__name__}, expected a block structure")


def convert_intervals(result: FeasibleSet, normalise: Normalise) -> dict[str, Ends]:
    """Convert proved intervals to another normalisation, by interval arithmetic on outer ones.

    Parameters
    ----------
    result : FeasibleSet
        Of a block structure with a normalisation.
    normalise
        The other one.

    Returns
    -------
    dict of str to (low, high)
        Every consistent parameter vector in that normalisation lies inside, but for those in
        which a quantity that the result fixes is zero. Wider than identification in that
        normalisation, since dependencies are lost.

    Raises
    ------
    ModelError
        If a quantity that is to be fixed may be zero, or if a fixed value of the result is more
        than a normalisation (the signal is summed with an input, say) and would not stay.
    SetidError
        If the set of the result is empty: systems in which what it fixes is zero may be
        consistent.

    Examples
    --------
    >>> import numpy as np, setid
    >>> model = setid.Hammerstein(setid.TransferFunction(0, 1), 2, normalise="b0")
    >>> u = np.linspace(-1, 1, 9)
    >>> result = setid.identify(setid.IOData(u, u + 0.5 * u**2), model, setid.Noise(output=0.01))
    >>> ends = setid.convert_intervals(result, "gamma1")
    >>> sorted(ends), bool(ends["b0"][0] <= 1.0 <= ends["b0"][1])
    (['b0', 'gamma2'], True)
    """
    check_result(result)
    model = result.formulation.model
    if not isinstance(model, BlockStructured):
        raise ModelError(f"result: found a {type(model).__name__}, expected a block structure")
    check_restrictions(model, model.normalised(normalise))
    if any(item.status is IntervalStatus.EMPTY for item in result.intervals.values()):
        raise SetidError("result: found an empty set, expected intervals that can be converted")
    ends = {name: item.outer for name, item in result.intervals.items()}
    return convert_ends(model, ends, normalise)


def equivalent(
    model: BlockStructured,
    theta: ArrayLike | Mapping[str, float],
    other: ArrayLike | Mapping[str, float],
    tolerance: float = 1e-9,
) -> bool:
    """Check that two parameter vectors have the same outputs for all inputs.

    Gains may be moved between the blocks of a structure without any change of its outputs. Both
    vectors are brought to one normalisation, in which they must agree. Vectors of different
    normalisations are to be given in full, for ``model.normalised(None)``.

    Parameters
    ----------
    model : BlockStructured
    theta, other : array_like (p,) or mapping of names to numbers
    tolerance : float
        Largest relative difference of their coefficients that counts as none.

    Returns
    -------
    bool

    Raises
    ------
    ModelError
        If the model is no block structure.
    SetidError
        If names or shapes of a vector do not fit.

    Examples
    --------
    >>> import setid
    >>> model = setid.Lure(setid.TransferFunction(1, 1, 1), 2)
    >>> setid.equivalent(model, [-0.5, 2.0, 0.0, 0.3], [-0.1, 2.0, -0.2, 0.3])
    True
    """
    _check(model)
    vectors = [parameters_of(vector, model.parameters) for vector in (theta, other)]
    if number(tolerance, "tolerance", SetidError) < 0.0:
        raise SetidError(f"tolerance: found {tolerance!r}, expected a number >= 0")
    for choice in _choices(model):
        try:
            one, two = (convert(model, vector, choice) for vector in vectors)
        except ModelError:
            continue
        return all(
            abs(one[name] - two[name]) <= tolerance * max(1.0, abs(one[name])) for name in one
        )
    raise ModelError(
        "theta: found no normalisation that both vectors have, expected blocks and maps that "
        "are not zero"
    )


def _choices(model: BlockStructured) -> Iterable[Normalise]:
    if isinstance(model, Lure):
        shift = loop_shift(model.normalised(None))
        return [None if shift is None else dict(shift.reference.fixed)]
    wiring = model.wiring
    maps = [[{name: 1.0} for name in wiring.weights(target)] for target, _ in model.maps]
    tops = [[{n: 1.0} for n in wiring.transfer(b).numerator] for b in model.blocks]
    pools = [*maps, *tops]
    scales = len(scaled_signals(model))
    found: list[Normalise] = []
    for chosen in combinations(pools, scales):
        found += [cast(Normalise, parts) for parts in cartesian(*chosen)]
    return found or [None]


# ---- conversion ---------------------------------------------------------------------------
