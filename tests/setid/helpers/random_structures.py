"""Random block structures and records of them, by a simulator that owes nothing to the package."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import setid
from setid.models.equations import Initial
from setid.models.lti import Form

Reals = NDArray[np.float64]
Terms = list[tuple[float, str]]  # of a source: signs and signals
_BURN = 15  # samples before the record, where systems do not start at rest
_GREATEST = 50.0  # of outputs: systems with greater ones are left out

# linear entries (target, source) with "~" where a loop needs a delay, maps, inputs, outputs
WIRINGS: tuple[tuple[tuple[tuple[str, str], ...], Mapping[str, tuple[str, ...]], int, int], ...] = (
    ((("y1", "u1"), ("y1", "w")), {"w": ("u2",)}, 2, 1),
    ((("y1", "w - u2"),), {"w": ("u1",)}, 2, 1),
    ((("z", "u1 - u2"),), {"y1": ("z",)}, 2, 1),
    ((("z", "u1"), ("z", "u2")), {"y1": ("z",)}, 2, 1),
    ((("y1", "~u1 - w"),), {"w": ("y1",)}, 1, 1),
    ((("z", "u1"), ("y1", "w")), {"w": ("z",)}, 1, 1),
    ((("z", "u1 + u2"), ("y1", "w")), {"w": ("z",)}, 2, 1),
    ((("z", "w"),), {"w": ("u1",), "y1": ("z",)}, 1, 1),
    ((("z", "w"), ("y1", "v")), {"w": ("u1",), "v": ("z",)}, 1, 1),
    ((("y1", "w"), ("y2", "w + u2")), {"w": ("u1",)}, 2, 2),
    ((("y1", "~u1 - v"), ("v", "y1")), {}, 1, 1),
    ((("z", "u1"), ("y1", "w - u1")), {"w": ("z",)}, 1, 1),
    ((("y1", "w"),), {"w": ("u1", "u2")}, 2, 1),
    ((("z", "u1"), ("v", "u2")), {"y1": ("z", "v")}, 2, 1),
    ((("z", "~u1 - w"), ("y1", "z")), {"w": ("z",)}, 1, 1),
    ((("z", "u1"),), {"y1": ("z", "u2")}, 2, 1),
    ((("z", "u1"), ("y1", "w"), ("y2", "z")), {"w": ("z",)}, 1, 2),
)
_STARTS: tuple[Initial, ...] = ("zero", "free")
_FORMS: tuple[Form, ...] = ("auto", "partial", "lifted")
_POWERS = (((1,), (2,)), ((1,), (2,), (3,)), ((1,), (3,)), ((2,),), ((2,), (3,)))
_PAIRS = (((1, 0), (1, 1)), ((0, 1), (2, 0)), ((1, 1), (1, 0), (0, 2)))


@dataclass(frozen=True)
class Block:
    """A linear block: sum of drives less its past."""

    target: str
    source: str
    poles: tuple[str, ...]
    zeros: tuple[str, ...]
    delay: int

    @property
    def terms(self) -> Terms:
        """Signs and signals of the source."""
        words = self.source.replace("-", "+ -").split("+")
        return [(-1.0 if "-" in word else 1.0, word.strip(" -")) for word in words if word.strip()]


@dataclass(frozen=True)
class Record:
    """A record with its structure, its bounds and what made it."""

    data: setid.IOData
    model: setid.BlockStructured
    noise: setid.Noise
    priors: list[Any]
    truth: Reals
    description: str


def random_record(seed: int) -> Record:
    """Make a record whose truth keeps all bounds; systems that grow are drawn again."""
    rng = np.random.default_rng(seed)
    while (found := _drawn(rng)) is None:
        pass
    return found


def _drawn(rng: np.random.Generator) -> Record | None:
    entries, arguments, inputs, outputs = WIRINGS[int(rng.integers(len(WIRINGS)))]
    blocks = [_block(rng, target, source, len(entries) > 1) for target, source in entries]
    bases = {
        name: (_POWERS if len(given) == 1 else _PAIRS)[
            int(rng.integers(len(_POWERS if len(given) == 1 else _PAIRS)))
        ]
        for name, given in arguments.items()
    }
    weights = {
        name: [f"gamma{f'[{name}]' if len(bases) > 1 else ''}{m + 1}" for m in range(len(basis))]
        for name, basis in bases.items()
    }
    values = {name: _coefficient(rng) for names in weights.values() for name in names}
    for block in blocks:
        poles = np.atleast_1d(np.poly(rng.uniform(-0.8, 0.8, len(block.poles))))[1:]
        values |= dict(zip(block.poles, poles.tolist(), strict=True))
        values |= {name: _coefficient(rng) for name in block.zeros}
    fixed = _normalised(rng, blocks, weights, values)
    initial, form = _STARTS[int(rng.integers(2))], _FORMS[int(rng.integers(3))]
    model = setid.BlockStructured(
        {
            (b.target, b.source): setid.TransferFunction(len(b.poles), len(b.zeros), b.delay)
            for b in blocks
        },
        {name: setid.StaticMap(given, bases[name]) for name, given in arguments.items()},
        inputs=inputs,
        outputs=outputs,
        initial=initial,
        form=form,
        normalise=fixed or None,
    )
    begin = _BURN if initial == "free" else 0
    u = rng.uniform(-1, 1, (begin + int(rng.integers(12, 36)), inputs))
    maps = {name: (arguments[name], bases[name], weights[name]) for name in bases}
    with np.errstate(all="ignore"):  # loops may be unstable
        y = _simulated(blocks, maps, values, u, outputs)
    if not np.all(np.abs(y) < _GREATEST):
        return None
    bound = float(rng.choice([0.001, 0.01, 0.05])) * np.abs(y).max(axis=0) + 1e-6
    reach = 0.01 * float(rng.integers(2)) * float(rng.integers(2))
    readings = y + rng.uniform(-bound, bound, y.shape), u + rng.uniform(-reach, reach, u.shape)
    return Record(
        setid.IOData(readings[1][begin:], readings[0][begin:]),
        model,
        setid.Noise(output=1.0001 * bound, input=1.0001 * reach),
        [setid.Stable()] * int(rng.integers(2)),
        np.array([values[name] for name in model.parameters]),
        f"{entries}, {bases}, {initial}, {form}, {fixed}",
    )


def _block(rng: np.random.Generator, target: str, source: str, several: bool) -> Block:
    """A block of at most two poles; with half of them it has none."""
    delay = 1 if source.startswith("~") else int(rng.integers(2))
    source = source.removeprefix("~")
    place = f"[{target},{source.replace(' ', '')}]" if several else ""
    na, nb = int(rng.choice([0, 0, 1, 1, 2])), int(rng.integers(1, 3))
    return Block(
        target,
        source,
        tuple(f"a{place}{i + 1}" for i in range(na)),
        tuple(f"b{place}{delay + j}" for j in range(nb)),
        delay,
    )


def _coefficient(rng: np.random.Generator) -> float:
    return float(rng.uniform(0.2, 1.2) * rng.choice([1.0, 1.0, -1.0]))


def _normalised(
    rng: np.random.Generator,
    blocks: list[Block],
    weights: Mapping[str, list[str]],
    values: dict[str, float],
) -> list[Any]:
    """Fix a gain or a coefficient for each internal signal, and change the values so."""
    found: list[Any] = []
    for signal in dict.fromkeys([*(b.target for b in blocks), *weights]):
        if signal.startswith("y"):
            continue
        mine = [block for block in blocks if block.target == signal]
        names = list(weights[signal]) if signal in weights else list(mine[0].zeros)
        if mine and rng.random() < 0.5:
            block = mine[0]
            gain = sum(values[name] for name in block.zeros)
            factor = (1.0 + sum(values[name] for name in block.poles)) / gain
            values |= {name: factor * values[name] for name in block.zeros}
            only = f"[{block.target},{block.source.replace(' ', '')}]"
            found.append(f"dcgain{only if len(blocks) > 1 else ''}")
        else:
            name = names[int(rng.integers(len(names)))]
            values[name] = float(rng.choice([1.0, -2.0, 0.5]))
            found.append({name: values[name]})
    return found


def _simulated(
    blocks: list[Block],
    maps: Mapping[str, tuple[tuple[str, ...], tuple[tuple[int, ...], ...], list[str]]],
    values: Mapping[str, float],
    u: Reals,
    outputs: int,
) -> Reals:
    """Outputs from rest, sample by sample."""
    signals = {f"u{i + 1}": u[:, i] for i in range(u.shape[1])}
    own = {block: np.zeros(len(u)) for block in blocks}
    targets = {block.target for block in blocks} | set(maps)
    signals |= {name: np.zeros(len(u)) for name in targets}

    def drive(block: Block, k: int) -> float:
        return sum(sign * signals[name][k] for sign, name in block.terms) if k >= 0 else 0.0

    for k in range(len(u)):
        waiting = set(targets)
        while waiting:
            name = next(
                name
                for name in sorted(waiting)
                if not waiting
                & (
                    set(maps[name][0])
                    if name in maps
                    else {s for b in blocks if b.target == name and not b.delay for _, s in b.terms}
                )
            )
            if name in maps:
                arguments, basis, weights = maps[name]
                factors = [
                    np.prod([signals[a][k] ** power for a, power in zip(arguments, e, strict=True)])
                    for e in basis
                ]
                signals[name][k] = sum(values[w] * f for w, f in zip(weights, factors, strict=True))
            for block in (b for b in blocks if b.target == name):
                own[block][k] = sum(
                    values[b] * drive(block, k - block.delay - j) for j, b in enumerate(block.zeros)
                ) - sum(
                    values[a] * own[block][k - i] for i, a in enumerate(block.poles, 1) if k >= i
                )
                signals[name][k] += own[block][k]
            waiting.remove(name)
    return np.stack([signals[f"y{i + 1}"] for i in range(outputs)], axis=1)
