"""Normalisations of block structures: what they leave open, and intervals from one to another.

**Scales.** With w' = K_w w and z' = K_z z for diagonal invertible K_w, K_z, blocks and maps
change as follows and no output does: the numerator of a block from s to t is multiplied by
k_t / k_s, the coefficient of x_1^p_1 x_2^p_2 ... in the map of t by k_t / (k_1^p_1 k_2^p_2 ...),
where k = 1 for measured signals, and signals that are summed have one k. Functions that are no
powers take measured signals alone. A normalisation asks for the value of some monomial of the
parameters. With d the logarithms of all k > 0 it asks for e'd = 0, where e are the exponents of k
in that monomial. So a parameter changes if its exponents are no combination of those.

**Shifts.** In a feedback loop y = G (u - N(y)), any part kappa y of N may belong to G:
a'_i = a_i + kappa b_i, gamma'_1 = gamma_1 - kappa. The scale is settled by u.

Both are exact for numbers and hold end by end for intervals, which are rounded outwards.

References
----------
V. Cerone, V. Razza, D. Regruto, "A unified framework for the identification of a general
class of multivariable nonlinear block-structured systems", Int. J. Robust and Nonlinear
Control 31 (2021), section on identifiability.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from setid.errors import ModelError
from setid.formulation.formulation import Formulation, formulate
from setid.formulation.lifting import LIFTED
from setid.models.block import BlockStructured, Lure, Normalise
from setid.priors.checked_priors import bounds_of
from setid.proofs.cells.output_cells import CellBox
from setid.proofs.fields import well_formed
from setid.proofs.parameter_box import start_of
from setid.proofs.uniqueness.exact_rank import moved_parameters
from setid.simulation.simulate import simulate
from sparsepop_py.verified.arithmetic.scalar_interval import (
    Ends,
    odd_root,
    plus,
    power,
    quotient,
    sum_of,
    times,
)
from sparsepop_py.verified.uncertain_rows.products import ProductRows
from sparsepop_py.verified.uncertain_rows.sign_tree import ParameterBox

__all__ = [
    "LoopShift",
    "Nonzero",
    "check_restrictions",
    "convert_ends",
    "loop_shift",
    "normalised_by",
    "priors_speak_of",
    "products_with",
    "reference_follows",
    "scaled_parameters",
    "takes_both_signs",
    "scaled_signals",
    "unidentifiable",
]

Nonzero = ParameterBox | CellBox  # proves that what a reference sets to 1 is not zero

_RANK = 1e-7  # of the largest singular value
_SAMPLES = 60
_KEPT = 1e-9  # share by which a fixed quantity may differ from the value that it has


def unidentifiable(model: BlockStructured) -> tuple[str, ...]:
    """Find parameters that may change without any change of the outputs.

    Those that scales of internal signals change are found exactly, and others by the rank of the
    sensitivities of a simulation, at random stable parameters and inputs (not proved, and used to
    refuse work alone, never for a bound).

    Parameters
    ----------
    model : BlockStructured

    Returns
    -------
    tuple of str
        In the order of ``model.parameters``; empty where they are unique (locally).

    Raises
    ------
    ModelError
        If the model is no block structure.

    Examples
    --------
    >>> import setid
    >>> setid.unidentifiable(setid.Hammerstein(setid.TransferFunction(1, 1, 1), 2))
    ('b1', 'gamma1', 'gamma2')
    >>> setid.unidentifiable(setid.Lure(setid.TransferFunction(1, 1, 1), 2))
    ('a1', 'gamma1')
    """
    if not isinstance(model, BlockStructured):
        raise ModelError(f"model: found {type(model).__name__}, expected a block structure")
    names = model.parameters
    generator = np.random.default_rng(1)
    rest = model.changed(initial="zero")
    affected: set[str] | None = None
    for _ in range(2):
        matrix = _sensitivities(rest, names, generator)
        if not np.all(np.isfinite(matrix)):
            continue  # a loop that diverges
        seen = np.linalg.norm(matrix, axis=0)  # zero where a coefficient of zero hides a parameter
        _, sizes, right = np.linalg.svd(matrix / np.where(seen > 0, seen, 1.0))
        null = right[sizes <= _RANK * sizes[0]]
        moved = {n for n, column in zip(names, null.T, strict=True) if np.any(abs(column) > 1e-4)}
        affected = moved if affected is None else affected & moved
    scaled = set(scaled_parameters(model))
    if affected and affected - scaled:  # high powers are nearly dependent in doubles alone
        exact = moved_parameters(model)
        affected = affected if exact is None else affected & exact
    found = {*(affected or ()), *scaled}
    return tuple(name for name in names if name in found)


def scaled_parameters(model: BlockStructured) -> tuple[str, ...]:
    """List parameters that scales change which the normalisation leaves open, exactly.

    Parameters
    ----------
    model : BlockStructured

    Examples
    --------
    >>> import setid
    >>> scaled_parameters(setid.Wiener(setid.TransferFunction(0, 1, 1), 3))
    ('b1', 'gamma1', 'gamma2', 'gamma3')
    >>> scaled_parameters(setid.Wiener(setid.TransferFunction(0, 1, 1), 3, "b1"))
    ()
    """
    exponents, held = _scale_group(model)
    rank = _rank(held)
    return tuple(
        name for name in model.parameters if _rank([*held, exponents.get(name, [])]) > rank
    )


def _scale_group(model: BlockStructured) -> tuple[dict[str, list[int]], list[list[int]]]:
    """Exponents of each coefficient in the scales of all internal signals, and what holds them."""
    signals = model.internal
    place = {signal: i for i, signal in enumerate(signals)}

    def row(powers: Mapping[str, int]) -> list[int]:
        found = [0] * len(signals)
        for signal, power_ in powers.items():
            if signal in place:
                found[place[signal]] += power_
        return found

    held, exponents = list[list[int]](), dict[str, list[int]]()
    for block in model.blocks:
        first, *others = (signal for signal, _ in block.source)
        held += [row(_sum_of_powers((first, 1), (other, -1))) for other in others]
        powers = row(_sum_of_powers((block.target, 1), (first, -1)))
        exponents |= dict.fromkeys(model.wiring.transfer(block).numerator, powers)
        if block.label in model.unit_gain:
            held.append(powers)
    for target, item in model.maps:
        for name, entry in zip(model.wiring.weights(target), item.basis, strict=True):
            inner = () if callable(entry) else zip(item.arguments, entry, strict=True)
            exponents[name] = row(_sum_of_powers((target, 1), *((a, -n) for a, n in inner)))
    held += [exponents[name] for name, value in model.fixed if value and name in exponents]
    return exponents, held


def _sum_of_powers(*pairs: tuple[str, int]) -> dict[str, int]:
    found = dict[str, int]()
    for signal, number in pairs:
        found[signal] = found.get(signal, 0) + number
    return found


def _rank(rows: Sequence[Sequence[int]]) -> int:
    """The rank of a matrix of integers."""
    left = [[Fraction(value) for value in row] for row in rows if any(row)]
    rank = 0
    while left:
        pivot = left.pop()
        place = next((i for i, value in enumerate(pivot) if value), None)
        if place is None:
            continue
        rank += 1
        for row in left:
            factor = row[place] / pivot[place]
            row[:] = [value - factor * other for value, other in zip(row, pivot, strict=True)]
    return rank


def _sensitivities(
    model: BlockStructured, names: tuple[str, ...], generator: np.random.Generator
) -> NDArray[np.float64]:
    theta = np.empty(len(names))
    pools = [t.denominator for t in model.linear_blocks.values()]
    for i, name in enumerate(names):
        pool = next((d for d in pools if name in d), ())
        theta[i] = generator.uniform(0.1, 0.5) / max(1, len(pool))
    for gain in model.unit_gain:  # one coefficient settles it
        block = model.linear_blocks[gain]
        place = {name: i for i, name in enumerate(names)}
        free = [n for n in block.numerator if n in place]
        if free:
            total = 1.0 + sum(theta[place[n]] for n in block.denominator if n in place)
            others = sum(theta[place[n]] for n in free[:-1])
            theta[place[free[-1]]] = total - others
    u = generator.uniform(-0.5, 0.5, (_SAMPLES, model.inputs))
    step, tangent = 1e-5, np.reshape(_tangent(model, names), (-1, len(names))).T
    for amplitude in (1.0, 0.3, 0.1, 0.01):  # feedback loops may diverge
        with np.errstate(all="ignore"):
            ends = [
                [simulate(model, theta + s * step * d, amplitude * u).ravel() for d in tangent.T]
                for s in (1.0, -1.0)
            ]
        if np.all(np.abs(ends) < 1e3):
            break
    rest = np.eye(len(names)) - tangent @ tangent.T  # excluded by static gains: as if seen
    if not tangent.size:  # all parameters are
        return rest
    with np.errstate(all="ignore"):
        columns = (np.array(ends[0]) - np.array(ends[1])).T / (2 * step)
        return np.asarray(np.concatenate([columns @ tangent.T, rest]), np.float64)


def _tangent(model: BlockStructured, names: tuple[str, ...]) -> list[NDArray[np.float64]]:
    """Directions that keep the static gains of 1."""
    place = {name: i for i, name in enumerate(names)}
    rows = np.zeros((max(1, len(model.unit_gain)), len(names)))
    for row, label in zip(rows, model.unit_gain, strict=False):
        block = model.linear_blocks[label]
        row[[place[n] for n in block.numerator if n in place]] = 1.0
        row[[place[n] for n in block.denominator if n in place]] = -1.0
    rank = int(np.linalg.matrix_rank(rows))
    return list(np.linalg.svd(rows)[2][rank:])


def convert_ends(
    model: BlockStructured, ends: Mapping[str, Ends], normalise: Normalise
) -> dict[str, Ends]:
    """Convert ranges of parameters to another normalisation, rounded outwards.

    Parameters
    ----------
    model : BlockStructured
    ends : mapping of str to (low, high)
        Of its parameters.
    normalise
        The other normalisation.
    """
    goal = model.normalised(normalise)
    full = dict(ends) | {name: (value, value) for name, value in model.fixed}
    if isinstance(model, Lure):
        return _shifted(model, goal, full)
    scales = _scales(goal, full)
    exponents = _exponents(model)
    found = {}
    for name in goal.parameters:
        factor = (1.0, 1.0)
        for signal, exponent in exponents.get(name, {}).items():
            factor = times(factor, power(scales[signal], exponent))
        found[name] = full[name] if not exponents.get(name) else times(full[name], factor)
    return found


def _exponents(model: BlockStructured) -> dict[str, dict[str, int]]:
    """For each coefficient the powers of the scales of internal signals that multiply it."""
    found: dict[str, dict[str, int]] = {}
    scaled = scaled_signals(model)
    for block in model.blocks:
        powers: dict[str, int] = {}
        for signal, change in ((block.target, 1), (block.source[0][0], -1)):
            if signal in scaled:
                powers[signal] = powers.get(signal, 0) + change
        for name in model.wiring.transfer(block).numerator:
            found[name] = powers
    for target, item in model.maps:
        for name, entry in zip(model.wiring.weights(target), item.basis, strict=True):
            powers = {target: 1} if target in scaled else {}
            if not callable(entry):
                for argument, exponent in zip(item.arguments, entry, strict=True):
                    if argument in scaled and exponent:
                        powers[argument] = powers.get(argument, 0) - exponent
            found[name] = {signal: e for signal, e in powers.items() if e}
    return found


def scaled_signals(model: BlockStructured) -> tuple[str, ...]:
    """List internal signals with a scale of their own, not summed with others."""
    tied = {s for b in model.blocks if len(b.source) > 1 for s, _ in b.source}
    return tuple(name for name in model.internal if name not in tied)


def _scales(goal: BlockStructured, full: Mapping[str, Ends]) -> dict[str, Ends]:
    """The factor of each internal signal that the normalisation asks for."""
    exponents, found = _exponents(goal), dict[str, Ends]()
    asked: list[tuple[str, Ends, dict[str, int]]] = [
        (name, quotient((value, value), full[name]), exponents.get(name, {}))
        for name, value in goal.fixed
        if value
    ]
    for name in (name for name, value in goal.fixed if not value):
        _check_value(name, 0.0, full[name])
    for label in goal.unit_gain:
        powers = exponents[goal.linear_blocks[label].numerator[0]]
        asked.append((f"static gain of {label}", _inverse_gain(goal, label, full), powers))
    open_ = list(asked)
    while open_:
        ready = [a for a in open_ if len(set(a[2]) - set(found)) <= 1]
        if not ready:
            break
        text, ratio, powers = ready[0]
        open_.remove(ready[0])
        unknown = [s for s in powers if s not in found]
        if unknown and not np.all(np.isfinite(ratio)):
            raise ModelError(
                f"normalise: found {text} that may be zero, expected a quantity that is not, so "
                "that it can be fixed"
            )
        for signal in set(powers) - set(unknown):
            ratio = quotient(ratio, power(found[signal], powers[signal]))
        if not unknown:
            _check_kept(text, ratio)
        else:
            exponent = powers[unknown[0]]
            if exponent % 2 == 0:
                raise ModelError(
                    f"normalise: found {text}, an even power of the scale of {unknown[0]}, whose "
                    "sign stays open; expected an odd coefficient, a numerator or 'dcgain'"
                )
            root = odd_root(ratio, abs(exponent))
            found[unknown[0]] = root if exponent > 0 else quotient((1.0, 1.0), root)
    missing = [name for name in scaled_signals(goal) if name not in found]
    if missing:
        raise ModelError(
            f"normalise: found nothing that settles the scale of {', '.join(missing)}, expected "
            "'dcgain', a numerator coefficient or one of a map"
        )
    return found


def _check_kept(text: str, ratio: Ends) -> None:
    """Refuse a condition that no scale can bring about, and that does not hold already."""
    if not (ratio[0] <= 1.0 + _KEPT and ratio[1] >= 1.0 - _KEPT):
        raise ModelError(
            f"normalise: found {text}, which no scale of an internal signal and no shift of a loop "
            "brings about, expected a quantity that these change, or the value that it has"
        )


def _check_value(name: str, value: float, ends: Ends) -> None:
    """Refuse the value of a coefficient that does not lie within its ends."""
    ratio = quotient((value, value), ends) if value else plus((1.0, 1.0), ends)
    _check_kept(f"{name} = {value:g}", ratio)


def _inverse_gain(model: BlockStructured, label: str, ends: Mapping[str, Ends]) -> Ends:
    """Bound one over the static gain of a block."""
    block = model.linear_blocks[label]
    top = plus((1.0, 1.0), sum_of([ends[n] for n in block.denominator]))
    return quotient(top, sum_of([ends[n] for n in block.numerator]))


def check_restrictions(model: BlockStructured, goal: BlockStructured) -> None:
    """Refuse a goal without a condition of a model that is more than a normalisation.

    Such a condition leaves systems out, and nothing is proved of these.

    Parameters
    ----------
    model : BlockStructured
    goal : BlockStructured
        The same structure with another normalisation.

    Raises
    ------
    ModelError
        That names the condition.
    """
    settling = _settling(model)
    several = not _bring_all_about(list(settling.values()))
    left = [
        name
        for name, value in model.fixed
        if (several or name not in settling) and (name, value) not in goal.fixed
    ]
    left += [
        f"static gain of {label}"
        for label in model.unit_gain
        if (several or label not in settling) and label not in goal.unit_gain
    ]
    if left:
        raise ModelError(
            f"normalise: found none of {left[0]}, whose value is more than a normalisation of "
            "this result, expected the same value"
        )


def _settling(model: BlockStructured) -> dict[str, tuple[int, ...]]:
    """Conditions that scales or a shift of a loop change, with the exponents of these."""
    if isinstance(model, Lure):
        moved = _moved_by_shift(model)
        names = [name for name, _ in model.fixed if name in moved]
        return dict.fromkeys([*names, *(model.unit_gain if moved else ())], (1,))
    exponents, signals = _exponents(model), scaled_signals(model)
    asked = [(name, name) for name, value in model.fixed if value]
    asked += [(label, model.linear_blocks[label].numerator[0]) for label in model.unit_gain]
    return {
        text: tuple(exponents[name].get(signal, 0) for signal in signals)
        for text, name in asked
        if exponents.get(name)
    }


def _bring_all_about(rows: Sequence[tuple[int, ...]]) -> bool:
    """Check that scales bring about any values, of each sign: no sum of rows is even."""
    if not rows or len(rows) > len(rows[0]):
        return not rows
    sums = (some for count in range(1, len(rows) + 1) for some in combinations(rows, count))
    return all(any(sum(column) % 2 for column in zip(*some, strict=True)) for some in sums)


def _moved_by_shift(model: BlockStructured) -> frozenset[str]:
    """Parameters of a loop y = G (u - N(y)) that a shift changes; none where it has no shift."""
    transfer, (_, item) = model.wiring.transfer(model.blocks[0]), model.maps[0]
    lags = range(transfer.delay, transfer.delay + len(transfer.numerator))
    longer = lags.stop - 1 > len(transfer.denominator)
    if (1,) not in item.basis or lags.start < 1 or longer:
        return frozenset()
    return frozenset([_linear_term(model), *(transfer.denominator[lag - 1] for lag in lags)])


def _shifted(model: Lure, goal: BlockStructured, full: Mapping[str, Ends]) -> dict[str, Ends]:
    """A + kappa b, gamma1 - kappa; a loop without a shift stays as it is."""
    found = dict(full)
    if _moved_by_shift(model):
        block, first = model.wiring.transfer(model.blocks[0]), _linear_term(model)
        kappa = _shift(goal, first, full)
        for lag, name in enumerate(block.numerator, block.delay):
            pole = block.denominator[lag - 1]
            found[pole] = plus(full[pole], times(kappa, full[name]))
        found[first] = plus(full[first], (-kappa[1], -kappa[0]))
    for name, value in goal.fixed:  # one of these conditions settles the shift, no more
        _check_value(name, value, found[name])
    for label in goal.unit_gain:
        _check_kept(f"static gain of {label}", _inverse_gain(goal, label, found))
    return {name: found[name] for name in goal.parameters}


def _shift(goal: BlockStructured, first: str, full: Mapping[str, Ends]) -> Ends:
    """The kappa that a normalisation of a loop asks for, with the linear term of its map."""
    fixed = dict(goal.fixed)
    if first in fixed:
        return plus(full[first], (-fixed[first], -fixed[first]))
    if not goal.unit_gain:
        raise ModelError(
            f"normalise: found nothing that settles the loop, expected 'dcgain' or {first}"
        )
    inverse = _inverse_gain(goal, goal.unit_gain[0], full)
    if not np.all(np.isfinite(inverse)):
        raise ModelError(
            "normalise: found a static gain of G that may be zero, expected one that is not"
        )
    return plus((1.0, 1.0), times((-1.0, -1.0), inverse))


def _linear_term(model: BlockStructured) -> str:
    target, item = model.maps[0]
    for name, entry in zip(model.wiring.weights(target), item.basis, strict=True):
        if entry == (1,):
            return name
    raise ModelError(
        "basis: found no linear term, expected one that a shift of the loop can change"
    )


# ---- references ---------------------------------------------------------------------------


def normalised_by(model: BlockStructured, choice: Normalise) -> BlockStructured:
    """Add one normalisation to those of a structure.

    Parameters
    ----------
    model : BlockStructured
    choice
        As :class:`BlockStructured` takes it.
    """
    parts: list[Normalise] = [dict(model.fixed), *(f"dcgain[{g}]" for g in model.unit_gain)]
    return model.normalised([*parts, choice])  # type: ignore[list-item]


def products_with(rows: ProductRows, box: ParameterBox) -> set[int]:
    """Find parameters in products that a box proves not to be zero.

    Parameters
    ----------
    rows : ProductRows
    box : ParameterBox
        Of its columns.
    """
    sure = (box.lower > 0) | (box.upper < 0)
    return {i for m, place in rows.place.items() if sure[place] and len(m) == 2 for i in m}


class LoopShift(NamedTuple):
    """A shift of a feedback loop that takes the linear term of its map to zero.

    Parameters
    ----------
    reference : BlockStructured
        The structure without that term.
    changed : frozenset of str
        The parameters that the shift changes.
    """

    reference: BlockStructured
    changed: frozenset[str]


def loop_shift(model: BlockStructured) -> LoopShift | None:
    """Find the shift y = G (u - N(y)) of a loop; None where none excludes no system.

    The shifted denominator is of the same order where the numerator reaches no further back, and
    only numbers that the shift does not change may be fixed. Static gains are rows of priors.

    Parameters
    ----------
    model : BlockStructured

    Examples
    --------
    >>> import setid
    >>> shift = loop_shift(setid.Lure(setid.TransferFunction(2, 1, 1), 2))
    >>> shift.reference.parameters, sorted(shift.changed)
    (('a1', 'a2', 'b1', 'gamma2'), ['a1', 'gamma1'])
    >>> loop_shift(setid.Lure(setid.TransferFunction(1, 2, 1), 2)) is None  # no lag 2 in A
    True
    """
    if len(model.blocks) != 1 or len(model.maps) != 1 or (model.inputs, model.outputs) != (1, 1):
        return None
    (target, item), block = model.maps[0], model.blocks[0]
    if block.target != "y1" or block.source != (("u1", 1.0), (target, -1.0)):
        return None
    if item.arguments != ("y1",):
        return None
    changed = _moved_by_shift(model)
    if not changed or changed & {name for name, _ in model.fixed}:
        return None
    return LoopShift(normalised_by(model, {_linear_term(model): 0.0}), changed)


def priors_speak_of(formulation: Formulation, names: Collection[str]) -> bool:
    """Check whether bounds or rows of priors hold some of these parameters.

    Parameters
    ----------
    formulation : Formulation
    names : collection of str
    """
    wanted = {i for i, name in enumerate(formulation.parameters) if name in names}
    pairs = zip(formulation.problem.constraints, formulation.rows.origin, strict=True)
    rows = [row for row, origin in pairs if origin == "prior"]
    if any(wanted & set(row.polynomial.support.tolist()) for row in rows):
        return True
    return any(
        set(names) & set(bounds_of(prior, formulation.model)) for prior in formulation.priors
    )


def takes_both_signs(model: BlockStructured, name: str) -> bool:
    """Check that scales of -1 and 1 turn the sign of a coefficient, and of none that is not open.

    Then each vector in which it is not zero has an equivalent one in which it is 1.

    Parameters
    ----------
    model : BlockStructured
    name : str

    Examples
    --------
    >>> import setid
    >>> model = setid.Wiener(setid.TransferFunction(0, 1, 1), 2)
    >>> [takes_both_signs(model, name) for name in model.parameters]
    [True, True, False]
    """
    exponents, held = _scale_group(model)
    open_ = {*scaled_parameters(model)}
    kept = [exponents[n] for n in model.parameters if n in exponents and n not in open_]
    own = exponents.get(name)
    if own is None:
        return False

    def turns(row: Sequence[int], signs: Sequence[int]) -> bool:
        return sum(value * sign for value, sign in zip(row, signs, strict=True)) % 2 == 1

    return any(
        turns(own, signs) and not any(turns(row, signs) for row in [*held, *kept])
        for signs in product((0, 1), repeat=len(model.internal))
    )


def reference_follows(
    formulation: Formulation, reference: BlockStructured, nonzero: Nonzero | None
) -> bool:
    """Check that a normalisation excludes no consistent system, without any solver.

    Parameters
    ----------
    formulation : Formulation
        Of a structure without that normalisation.
    reference : BlockStructured
        The structure with it.
    nonzero : ParameterBox, CellBox or None
        Proof that what is set to 1 is not zero; None for loops, which a shift normalises.
    """
    model = formulation.model
    if not isinstance(model, BlockStructured):
        return False
    affected = unidentifiable(model)
    if priors_speak_of(formulation, affected):
        return False
    stated = reference
    if (model.form, reference.form) == ("auto", LIFTED):  # sums of products as unknowns, no more
        reference = reference.changed(form="auto")
    if isinstance(model, Lure):
        shift = loop_shift(model)
        if shift is None or priors_speak_of(formulation, shift.changed):
            return False
        return reference == shift.reference
    chosen = [name for name in affected if normalised_by(model, name) == reference]
    if not chosen or scaled_parameters(reference) or not takes_both_signs(model, chosen[0]):
        return False
    return _proves_nonzero(formulation, stated, chosen[0], nonzero)


def _proves_nonzero(
    formulation: Formulation, stated: BlockStructured, name: str, nonzero: Nonzero | None
) -> bool:
    """Check the proof that a parameter is zero in no consistent system."""
    if not well_formed(nonzero):
        return False
    rows = formulation.products
    if isinstance(nonzero, ParameterBox):
        if rows is None or not nonzero.verify(rows.regression, rows.start(start_of(formulation))):
            return False
        return formulation.parameters.index(name) in products_with(rows, nonzero)
    if not isinstance(nonzero, CellBox) or nonzero.open:
        return False
    other = formulate(formulation.data, stated, formulation.noise, formulation.priors)
    return nonzero.verify(other, start_of(other))
