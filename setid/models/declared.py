"""Blocks, maps and normalisations as users give them, checked."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from setid.data.checks import entries_of, natural, number
from setid.errors import ModelError
from setid.models.equations import channel_of
from setid.models.lti import TransferFunction
from setid.models.maps import StaticMap
from setid.models.wiring import Block, Maps, Wiring

__all__ = ["read_blocks", "read_maps", "read_normalisation"]

_NAME = re.compile(r"[A-Za-z_]\w*")
_SUM = re.compile(r"\s*([+-]?)\s*([A-Za-z_]\w*)")


def read_blocks(linear: Mapping[tuple[str, str], TransferFunction]) -> tuple[Block, ...]:
    """Blocks of a mapping, checked.

    Raises
    ------
    ModelError
        Naming the entry.
    """
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
    """Maps of a mapping, and the wiring of all, checked.

    Raises
    ------
    ModelError
        Naming the signal.
    """
    inputs = natural(channels[0], "inputs", ModelError, least=1)
    outputs = natural(channels[1], "outputs", ModelError, least=1)
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
    """Fixed parameters with their numbers, and labels of blocks with static gain 1.

    Raises
    ------
    ModelError
        If a name is unknown.
    """
    one = isinstance(given, (str, Mapping))
    items = [given] if one else entries_of(given or (), "normalise", "names or numbers", ModelError)
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
    return tuple(fixed.items()), tuple(dict.fromkeys(gains))


def _touches(block: Block) -> bool:
    names = [block.target, *(name for name, _ in block.source)]
    return any(channel_of(name) is None for name in names)
