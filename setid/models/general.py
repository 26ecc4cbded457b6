"""Block-structured systems: linear blocks and static maps, connected by signals.

The general form (L, N) of Cerone, Razza, Regruto: [y; z] = L [u; w] with a matrix L of
transfer functions, w = N(z) with polynomial maps N. Signals that are neither measured nor
given are internal; every equation is one of :mod:`setid.models.equations`.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import MOST_TERMS, channel_pair, entries_of, natural, number, word
from setid.data.digits import all_digits
from setid.errors import ModelError
from setid.models.equations import Equation, Initial, Structure, Transfer, channel_of
from setid.models.html import InNotebook
from setid.models.lti import Form, TransferFunction
from setid.models.maps import StaticMap
from setid.models.wiring import Block, Maps, Wiring

__all__ = [
    "BlockStructured",
    "Normalise",
    "from_unknown_start",
    "nonlinear_rows",
    "read_blocks",
    "read_maps",
    "read_normalisation",
]

_NAME = re.compile(r"[A-Za-z_]\w*")
_SUM = re.compile(r"\s*([+-]?)\s*([A-Za-z_]\w*)")
_LEAST = 1e-50  # size of a coefficient that normalises, and of its reciprocal


def read_blocks(linear: Mapping[tuple[str, str], TransferFunction]) -> tuple[Block, ...]:
    """Read and check the blocks of a mapping.

    Raises
    ------
    ModelError
        Naming the entry.
    """
    if not isinstance(linear, Mapping):
        raise ModelError(f"linear: found {type(linear).__name__}, expected a mapping of pairs")
    found = []
    for key, item in linear.items():
        field = f"linear[{key!r}]"
        if not isinstance(key, tuple) or len(key) != 2 or not all(isinstance(k, str) for k in key):
            raise ModelError(f"{field}: expected a pair (target, source) of signal names")
        if not isinstance(item, TransferFunction) or item.inputs * item.outputs != 1:
            raise ModelError(
                f"{field}: found {item!r:.80}, expected a TransferFunction of one input"
            )
        if item.offset or item.initial != "free" or item.form != "auto":
            raise ModelError(
                f"{field}: found options of {item!r}, expected orders alone; initial and form "
                "belong to the whole structure"
            )
        pieces: list[tuple[str, float]] = []
        place = 0
        text = key[1].rstrip()
        while place < len(text):
            match = _SUM.match(text, place)
            if match is None or (pieces and not match.group(1)):
                raise ModelError(
                    f"{field}: found the source {key[1]!r}, expected a signal or a sum such as "
                    "'u1 - w'"
                )
            pieces.append((match.group(2), -1.0 if match.group(1) == "-" else 1.0))
            place = match.end()
        if not pieces or not _NAME.fullmatch(key[0]):
            raise ModelError(f"{field}: found {key}, expected names of a target and of sources")
        orders = (item.na[0][0], item.nb[0][0], item.nk[0][0])
        found.append(Block(key[0], tuple(pieces), *orders))
    if len({b.label for b in found}) != len(found):
        raise ModelError("linear: found one entry twice, expected distinct pairs")
    return tuple(found)


def read_maps(
    nonlinear: Mapping[str, StaticMap],
    blocks: Sequence[Block],
    channels: tuple[int, int],
    initial: str,
) -> Maps:
    """Read and check the maps of a mapping, and the wiring of all.

    Raises
    ------
    ModelError
        Naming the signal.
    """
    inputs = natural(channels[0], "inputs", ModelError, least=1, most=MOST_TERMS)
    outputs = natural(channels[1], "outputs", ModelError, least=1, most=MOST_TERMS)
    if not isinstance(nonlinear, Mapping):
        raise ModelError(f"nonlinear: found {type(nonlinear).__name__}, expected a mapping")
    for name, item in nonlinear.items():
        _check_map(name, item)
        if initial == "zero":
            _check_rest(name, item)
    defined = [b.target for b in blocks]
    maps = tuple(nonlinear.items())
    for name in sorted(set(defined) & set(nonlinear)):
        raise ModelError(
            f"nonlinear: found {name!r}, which linear defines too; expected one definition a signal"
        )
    targets = set(defined) | set(nonlinear)
    given = {f"u{i + 1}" for i in range(inputs)} | targets
    used = {s for b in blocks for s, _ in b.source} | {a for _, m in maps for a in m.arguments}
    wanted = {f"y{i + 1}" for i in range(outputs)}
    for name in sorted(used - given):
        raise ModelError(f"signals: found {name!r}, which no entry defines")
    for name in sorted(wanted - given):
        raise ModelError(f"signals: found no entry that defines the output {name!r}")
    for name in sorted(n for n in targets - wanted if channel_of(n) is not None):
        raise ModelError(f"signals: found {name!r} as a target, expected outputs {sorted(wanted)}")
    return maps


def _check_map(name: str, item: StaticMap) -> None:
    if not isinstance(item, StaticMap):
        raise ModelError(f"nonlinear[{name!r}]: found {item!r:.60}, expected a StaticMap")
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise ModelError(f"nonlinear: found the name {name!r}, expected one such as 'w1'")
    kinds = [channel_of(a) for a in item.arguments]
    if not item.polynomial and not all(kind is not None and kind[0] == "u" for kind in kinds):
        raise ModelError(
            f"nonlinear[{name!r}]: found a basis function that is no power of "
            f"{', '.join(item.arguments)}, expected powers: only samples of an exactly "
            "known input can be put into other functions"
        )


def _check_rest(name: str, item: StaticMap) -> None:
    """Signals before the record are zero: maps must keep them so."""
    zero = [np.zeros(1)] * len(item.arguments)
    for m in range(len(item.basis)):
        if float(item.value(m, *zero)[0]) != 0.0:
            raise ModelError(
                f"nonlinear[{name!r}]: found {item.text(m)}, which is not 0 at rest; expected "
                "functions with phi(0) = 0 for initial='zero'"
            )


def read_normalisation(
    given: Any, wiring: Wiring
) -> tuple[tuple[tuple[str, float], ...], tuple[str, ...]]:
    """Read fixed parameters with their numbers, and blocks with static gain 1.

    Raises
    ------
    ModelError
        If a name is unknown.
    """
    one = isinstance(given, (str, Mapping))
    several = () if given is None else given
    items = [given] if one else entries_of(several, "normalise", "names or numbers", ModelError)
    fixed: dict[str, float] = {}
    gains: list[str] = []
    labels = [block.label for block in wiring.blocks]
    for item in items:
        if isinstance(item, Mapping):
            for name, value in item.items():
                fixed[name] = number(value, f"normalise[{name!r}]", ModelError)
        elif not isinstance(item, str):
            raise ModelError(f"normalise: found {item!r:.60}, expected a name or {{name: number}}")
        elif item == "dcgain":
            gains += [b.label for b in wiring.blocks if _touches(b)]
        elif item.removeprefix("dcgain[").removesuffix("]") in labels:
            gains.append(item.removeprefix("dcgain[").removesuffix("]"))
        else:
            fixed[item] = 1.0
    for name, value in fixed.items():
        if name not in wiring.names or not np.isfinite(value):
            raise ModelError(
                f"normalise: found {name!r} = {value!r}, expected 'dcgain', 'dcgain[target,source]'"
                f" or one of {', '.join(wiring.names)}"
            )
        if value and not _LEAST <= abs(value) <= 1.0 / _LEAST:
            raise ModelError(
                f"normalise: found {name!r} = {value!r}, expected a size from {_LEAST:g} to "
                f"{1.0 / _LEAST:g}, whose powers are doubles"
            )
    return tuple(fixed.items()), tuple(dict.fromkeys(gains))


def _touches(block: Block) -> bool:
    names = [block.target, *(name for name, _ in block.source)]
    return any(channel_of(name) is None for name in names)


Normalise = str | Mapping[str, float] | Collection[str] | None
_PARTS = ("blocks", "maps", "inputs", "outputs", "fixed", "unit_gain", "initial", "form")


@dataclass(frozen=True, slots=True, init=False, repr=False)
class BlockStructured(InNotebook):
    """Linear blocks s = sum of G r and static maps w = N(z), wired by names.

    Parameters
    ----------
    linear : mapping of (target, source) to TransferFunction
        The matrix of transfer functions, entries that are zero left out: single-input ones
        whose names of coefficients are made from target and source. A source may be a sum
        such as ``"u1 - w"``: one transfer function acts on it. Several sources of one target
        add up.
    nonlinear : mapping of target to StaticMap
        Maps define internal signals or outputs.
    inputs, outputs : int
        Measured channels ``u1``, ``y1``, ...; all other names are internal signals.
    normalise : str, mapping or collection of these, optional
        What makes the parameters unique. ``"dcgain"``: all linear blocks at an internal
        signal have static gain 1; ``"dcgain[y1,w]"``: this one. The name of a parameter fixes it to
        1, a mapping such as ``{"gamma1": 2.0}`` to a number; fixed parameters are not in
        ``parameters``.
    initial : {"free", "zero"}
        As for :class:`TransferFunction`.
    form : {"auto", "direct", "partial", "lifted"}
        ``"partial"``: every static map, and every entry of a target with several
        denominators, is an unknown signal, and rows are bilinear. ``"direct"``: maps of
        exact signals are inserted and denominators multiplied out. ``"auto"``: direct
        where possible. ``"lifted"``: the same, with sums of products of coefficients as
        unknowns of their own.

    Raises
    ------
    ModelError
        Naming the entry that does not fit.

    Notes
    -----
    Coefficients are named ``a[y1,w]1``, ``b[y1,w]0``, by lag, without brackets where there
    is one linear block; those of maps ``gamma[w]1``, by place in the basis, without brackets
    where there is one map.

    References
    ----------
    V. Cerone, V. Razza, D. Regruto, "A unified framework for the identification of a
    general class of multivariable nonlinear block-structured systems", Int. J. Robust and
    Nonlinear Control 31 (2021).

    Examples
    --------
    >>> from setid import TransferFunction
    >>> from setid.models.block import BlockStructured, StaticMap
    >>> model = BlockStructured(
    ...     {("y1", "w"): TransferFunction(1, 1, 1), ("y1", "u2"): TransferFunction(1, 1, 1)},
    ...     {"w": StaticMap("u1", 2)},
    ...     inputs=2,
    ...     normalise="gamma1",
    ... )
    >>> model.parameters
    ('a[y1,w]1', 'a[y1,u2]1', 'b[y1,w]1', 'b[y1,u2]1', 'gamma2')
    """

    blocks: tuple[Block, ...]
    maps: tuple[tuple[str, StaticMap], ...]
    inputs: int
    outputs: int
    fixed: tuple[tuple[str, float], ...]
    unit_gain: tuple[str, ...]
    initial: Initial
    form: Form

    def __init__(
        self,
        linear: Mapping[tuple[str, str], TransferFunction],
        nonlinear: Mapping[str, StaticMap],
        inputs: int = 1,
        outputs: int = 1,
        normalise: Normalise = None,
        initial: Initial = "free",
        form: Form = "auto",
    ) -> None:
        word(initial, "initial", ("free", "zero"), ModelError)
        word(form, "form", ("auto", "direct", "partial", "lifted"), ModelError)
        blocks = read_blocks(linear)
        maps = read_maps(nonlinear, blocks, (inputs, outputs), initial)
        wiring = Wiring(blocks, maps, {})
        fixed, gains = read_normalisation(normalise, wiring)
        values = (blocks, maps, int(inputs), int(outputs), fixed, gains, initial, form)
        for key, value in zip(_PARTS, values, strict=True):
            object.__setattr__(self, key, value)

    def normalised(self, normalise: Normalise) -> BlockStructured:
        """Change the normalisation of the structure (None for none).

        Parameters
        ----------
        normalise : str, mapping, list of these or None
            As in the constructor.

        Examples
        --------
        >>> import setid
        >>> model = setid.Hammerstein(setid.TransferFunction(1, 1, 1), 2)
        >>> model.normalised("gamma1").parameters
        ('a1', 'b1', 'gamma2')
        """
        fixed, gains = read_normalisation(normalise, Wiring(self.blocks, self.maps, {}))
        return self.changed(fixed=fixed, unit_gain=gains)

    def changed(self, **parts: Any) -> BlockStructured:
        """Replace some fields of the structure.

        Parameters
        ----------
        **parts
            Fields of the structure with their new values.
        """
        new: BlockStructured = object.__new__(type(self))
        for key in _PARTS:
            object.__setattr__(new, key, parts.get(key, getattr(self, key)))
        return new

    # ---- names --------------------------------------------------------------------------

    @property
    def wiring(self) -> Wiring:
        """Blocks, maps and fixed numbers, as equations are made from them."""
        return Wiring(self.blocks, self.maps, dict(self.fixed))

    @property
    def every_parameter(self) -> tuple[str, ...]:
        """Names of all coefficients, fixed ones included."""
        return self.wiring.names

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the unknown coefficients: denominators, numerators, maps."""
        known = {name for name, _ in self.fixed}
        return tuple(name for name in self.every_parameter if name not in known)

    @property
    def internal(self) -> tuple[str, ...]:
        """Names of the internal signals."""
        found = [b.target for b in self.blocks] + [name for name, _ in self.maps]
        return tuple(dict.fromkeys(n for n in found if channel_of(n) is None))

    @property
    def linear_blocks(self) -> dict[str, Transfer]:
        """Coefficient names of each linear block, by its label such as ``"y1,w"``."""
        return {b.label: self.wiring.transfer(b) for b in self.blocks}

    def transfer(self, output: int = 1, input: int = 1) -> Transfer:
        """Name coefficients of the linear block between two channels, or of the only one.

        Parameters
        ----------
        output, input : int
            Channels, from 1.
        """
        output, input = channel_pair(output, input, self.outputs, self.inputs)
        target, source = f"y{output}", f"u{input}"
        return self.wiring.transfer(self._block_from(source, target))

    def _block_from(self, source: str, target: str) -> Block:
        """Choose the block from one signal to another, or the only one."""
        direct = [b for b in self.blocks if b.target == target and source in dict(b.source)]
        found = self.blocks if len(self.blocks) == 1 else direct
        if len(found) != 1:
            self._check_joined(target, source)
            raise ModelError(
                f"model: found {len(found)} linear blocks from {source} to {target}, expected "
                "one; linear_blocks names them all"
            )
        return found[0]

    def check_between(self, output: int, input: int) -> None:
        """Check that the block of :meth:`transfer` joins these channels and adds the input.

        A block that joins no channels passes as that of output 1 and input 1.

        Parameters
        ----------
        output, input : int
            Channels, from 1.

        Raises
        ------
        ModelError
            If it acts between other channels, or subtracts the input, or is not all that is linear
            between them: in ``y1 = G(u1 - y1)`` the response of y1 is that of the loop.
        """
        output, input = channel_pair(output, input, self.outputs, self.inputs)
        target, source = f"y{output}", f"u{input}"
        block = self._block_from(source, target)
        signs = dict(block.source)
        inputs = [name for name in signs if name != source and (channel_of(name) or "y")[0] == "u"]
        apart = block.target != target and (channel_of(block.target) is not None or output > 1)
        apart |= source not in signs and (bool(inputs) or input > 1)
        if apart:
            self._check_joined(target, source)
        if apart or signs.get(source, 1.0) < 0.0:
            raise ModelError(
                f"model: found {block.target} = G({block.source_text}), expected a linear block "
                f"to {target} that adds {source}"
            )
        driven = self.wiring.driven_by((block.target, source))
        entries = [b for b in self.blocks if b.target == block.target]
        active = [b for b in entries for name, _ in b.source if name in driven]
        if len(active) > int(source in signs):
            other = next((b for b in active if b is not block), block)
            raise ModelError(
                f"model: found {other.target} = G({other.source_text}), by which {source} acts on "
                f"{target} in another way too, expected one linear block between them and no loop; "
                "step_band gives the whole response"
            )

    def _check_joined(self, target: str, source: str) -> None:
        """Refuse a pair of channels between which nothing acts."""
        if target not in self.wiring.driven_by((source,), maps=True):
            raise ModelError(
                f"model: found nothing from {source} to {target}, a response that is exactly 0; "
                f"expected a linear block to {target} that adds {source}"
            )

    # ---- equations ----------------------------------------------------------------------

    def equations(self, noisy: Collection[str] = ()) -> tuple[Equation, ...]:
        """State equations of all signals; maps of exact signals are inserted where form allows.

        Parameters
        ----------
        noisy : collection of str
            Measured signals that are not known exactly.

        Raises
        ------
        ModelError
            If a basis function that is no power has an argument with noise.
        """
        form: Form = "auto" if self.form == "lifted" else self.form
        return self.wiring.equations(frozenset(noisy), form)

    def direct(self, noisy: Collection[str] = ()) -> tuple[Equation, ...]:
        """State one equation an output in measured signals alone, with products of parameters.

        Empty where internal signals cannot be eliminated.

        Parameters
        ----------
        noisy : collection of str
            Measured signals that are not known exactly.
        """
        return self.wiring.direct(frozenset(noisy))

    def regression(self) -> tuple[Equation, ...]:
        """State the direct equations where they are linear in the parameters, else none."""
        found = self.direct()
        return found if all(e.linear_in_parameters for e in found) else ()

    def driven(self, inputs: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        """Evaluate basis functions that are not powers, for inputs (N, nu) without noise.

        Parameters
        ----------
        inputs : (N, nu) float
        """
        return self.wiring.driven(inputs)

    def __repr__(self) -> str:
        parts = [f"{b.target} = G({b.source_text})" for b in self.blocks]
        for name, item in self.maps:
            texts = ", ".join(item.text(m) for m in range(len(item.basis)))
            parts.append(f"{name} = N({texts})")
        norms = [f"{name} = {all_digits(value)}" for name, value in self.fixed]
        norms += [f"static gain of {label} = 1" for label in self.unit_gain]
        orders = "; ".join(f"{b.na},{b.nb},{b.nk}" for b in self.blocks)
        norm = ", ".join(norms) or "none"
        return (
            f"<{type(self).__name__}: {'; '.join(parts)}; na,nb,nk = {orders}; "
            f"normalisation: {norm}; initial: {self.initial}>"
        )


def from_unknown_start(model: Structure) -> Structure:
    """Change a structure to one with unknown signals before each record.

    Parameters
    ----------
    model : Structure

    Raises
    ------
    ModelError
        If a structure of another kind begins at rest.

    Examples
    --------
    >>> import setid
    >>> from_unknown_start(setid.TransferFunction(1, 1, 1, initial="zero")).initial
    'free'
    """
    if model.initial == "free":
        return model
    if isinstance(model, BlockStructured):
        return model.changed(initial="free")
    if not is_dataclass(model):
        raise ModelError(
            f"model: found {type(model).__name__} with initial 'zero', expected initial 'free'"
        )
    found = copy(model)
    object.__setattr__(found, "initial", "free")  # the same numbers, whatever the constructor takes
    return found


def nonlinear_rows(model: Structure) -> str:
    """Name what keeps the equations of a structure from being linear in its parameters.

    Parameters
    ----------
    model : Structure
        Without a regression form.

    Examples
    --------
    >>> import setid
    >>> linear = setid.TransferFunction(1, 1, 1)
    >>> nonlinear_rows(setid.Hammerstein(linear, 2, "gamma1"))
    'rows with products of parameters'
    >>> nonlinear_rows(setid.Wiener(linear, 2, "gamma1"))
    'rows with internal signals (z)'
    """
    if not isinstance(model, BlockStructured):
        return "separate denominators"
    if model.direct():
        return "rows with products of parameters"
    return f"rows with internal signals ({', '.join(model.internal)})"
