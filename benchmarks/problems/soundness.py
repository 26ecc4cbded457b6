"""What must hold of a result whatever the problem: no claim above an attained value."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np

import sparsepop_py as sp

from ..errors import DEFECTS
from ..peers.scip import Answer
from .random_problems import RandomProblem, samples

__all__ = ["damaged", "disagreements", "findings"]

_DAMAGES = 8  # damaged copies of each certificate
_PEER_SLACK = 1e-5  # of max(1, |value|): a peer's points are feasible to 1e-6 only
_FACTORS = (0.0, -1.0, 0.5, 1.0 + 1e-9, 1.001, 2.0, 1e3, 1e12, np.nan, np.inf)


def findings(made: RandomProblem, result: sp.Result, seed: int) -> Iterator[str]:
    """Every claim of a result that a sample or a verification refutes; none is expected."""
    least = float(samples(made, seed)[1].min())
    if result.status is sp.Status.INFEASIBLE:
        yield "INFEASIBLE, but a point is feasible"
    if result.lower_bound > least:
        yield f"the bound {result.lower_bound!r} is above the attained {least!r}"
    if result.lower_bound > result.upper_bound:
        yield f"the bound {result.lower_bound!r} is above its own {result.upper_bound!r}"
    if result.certificate is None:
        if np.isfinite(result.lower_bound):
            yield "a finite bound has no certificate"
        return
    verdict = result.certificate.verify(made.problem)
    if not verdict.ok:
        yield f"its certificate does not verify: {verdict.reason}"
    yield from _damage_findings(made, result, min(least, result.upper_bound), seed)


def _damage_findings(
    made: RandomProblem, result: sp.Result, least: float, seed: int
) -> Iterator[str]:
    rng = np.random.default_rng([seed, 29])
    for _ in range(_DAMAGES):
        forged, place = damaged(result.certificate, rng)
        try:
            verdict = forged.verify(made.problem)
        except DEFECTS as error:
            yield f"damaged at {place}, verify raises {type(error).__name__}: {error}"
            continue
        if verdict.bound > least:
            yield f"damaged at {place}, it proves {verdict.bound!r} above {least!r}"
        if verdict.ok and forged.bound > least:
            yield f"damaged at {place}, the claim {forged.bound!r} above {least!r} is accepted"


def disagreements(result: sp.Result, answer: Answer) -> Iterator[str]:
    """Where a peer's claims and proved ones exclude each other by more than its tolerance."""
    if result.lower_bound > answer.upper + _PEER_SLACK * max(1.0, abs(answer.upper)):
        yield f"proved {result.lower_bound!r}, SCIP claims a point of {answer.upper!r}"
    if answer.lower > result.upper_bound + _PEER_SLACK * max(1.0, abs(result.upper_bound)):
        yield f"attained {result.upper_bound!r}, SCIP claims a bound of {answer.lower!r}"


def damaged(thing: Any, rng: np.random.Generator) -> tuple[Any, str]:
    """A copy with one number changed, and where; works on any tree of dataclasses and arrays.

    Examples
    --------
    >>> damaged((1.0,), np.random.default_rng(0))[1]
    '[0]'
    """
    places = list(_places(thing, ()))
    place = places[int(rng.integers(len(places)))]
    text = "".join(f".{key}" if isinstance(key, str) else f"[{key}]" for key in place)
    return _changed(thing, place, rng), text


def _places(thing: Any, path: tuple) -> Iterator[tuple]:
    """Paths to all float numbers and arrays that hold something."""
    if isinstance(thing, float):
        yield path
    elif isinstance(thing, np.ndarray):
        if thing.size and thing.dtype.kind in "fiu":
            yield path
    elif isinstance(thing, tuple | list):
        for number, item in enumerate(thing):
            yield from _places(item, (*path, number))
    elif dataclasses.is_dataclass(thing) and not isinstance(thing, type):
        for field in dataclasses.fields(thing):
            if field.name == "problem":  # of a certificate: what it is about, no part of the proof
                continue
            yield from _places(getattr(thing, field.name), (*path, field.name))


def _changed(thing: Any, place: tuple, rng: np.random.Generator) -> Any:
    if not place:
        return _wrong(thing, rng)
    key, rest = place[0], place[1:]
    if isinstance(key, str):
        return dataclasses.replace(thing, **{key: _changed(getattr(thing, key), rest, rng)})
    items = list(thing)
    items[key] = _changed(items[key], rest, rng)
    return type(thing)(items)


def _wrong(value: Any, rng: np.random.Generator) -> Any:
    """Another number; in an array, another entry."""
    if isinstance(value, float):
        return _other(value, rng)
    copy = value.copy()
    where = int(rng.integers(copy.size))
    old = copy.flat[where]
    if copy.dtype.kind == "f":
        copy.flat[where] = _other(float(old), rng)
    else:
        copy.flat[where] = old + int(rng.integers(1, 4)) * (1 if old <= 0 else -1)
    copy.flags.writeable = False
    return copy


def _other(value: float, rng: np.random.Generator) -> float:
    factor = _FACTORS[int(rng.integers(len(_FACTORS)))]
    shift = 0.0 if value else float(rng.normal())
    with np.errstate(all="ignore"):
        return float(np.multiply(value, factor) + shift)
