"""Boxes of parameters with rational ends, and trees of parts that are bounded one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fractions import Fraction
from operator import mul
from typing import Any, TypeVar

from ..arithmetic import interval as iv
from ..arithmetic.interval import Interval
from ..arithmetic.polynomial import INF
from ..files.reading import Malformed, alike, below, fields, items

ZERO = Fraction(0)
T = TypeVar("T")
Ends = list[list[Any]]  # lower ends, upper ends: Fractions, INF or -INF


def intervals(ends: Ends) -> list[Interval]:
    """Convert a box to intervals in fixed point."""
    return [iv.around(*pair) for pair in zip(*ends, strict=True)]


def rationals(box: list[Interval]) -> Ends:
    """Convert a box back."""
    return [[iv.exact(pair[side]) for pair in box] for side in (0, 1)]


def outside(ends: Ends, other: Ends) -> list[int]:
    """List the variables whose ends leave another box."""
    sides = enumerate(zip(*ends, *other, strict=True))
    return [v for v, (a, b, low, high) in sides if a < low or high < b]


def nothing(ends: Ends) -> bool:
    """Check whether a box is empty."""
    return any(a > b for a, b in zip(*ends, strict=True))


def met(ends: Ends, low: list[Any], high: list[Any]) -> Ends:
    """Intersect with another box."""
    lows = [max(pair) for pair in zip(ends[0], low, strict=True)]
    return [lows, [min(pair) for pair in zip(ends[1], high, strict=True)]]


def no_point(count: int) -> Ends:
    """Make an empty box."""
    return [[INF] * count, [-INF] * count]


def hull(boxes: list[Ends], count: int) -> Ends:
    """Enclose boxes, some of which may be empty."""
    left = [no_point(count), *(ends for ends in boxes if not nothing(ends))]
    lows, highs = zip(*left, strict=True)
    return [list(map(min, *lows)), list(map(max, *highs))] if len(left) > 1 else left[0]


def dot(a: Iterable[int], b: Iterable[int]) -> int:
    """Sum products."""
    return sum(map(mul, a, b))


def move(box: Ends, v: int, side: int, least: Any) -> None:
    """Shrink a box by x_v >= least (side 0) or -x_v >= least (side 1)."""
    if side == 0:
        box[0][v] = max(box[0][v], least)
    else:
        box[1][v] = min(box[1][v], -least)


def walk(
    found: Any, place: str, firsts: list[T], parts: Callable[[int, Any, T], list[T]], **kinds: Any
) -> None:
    """Go through trees of nodes, the roots first, whose children come later and only once.

    ``parts`` tells of a node's number, its fields and its own part what the parts of its children
    are: two, or none for a leaf.
    """
    nodes, seen, waiting = items(found, place), set[int](), list(enumerate(firsts))
    while waiting:
        number, own = waiting.pop()
        below([number], len(nodes), place)
        node = fields(nodes[number], f"{place}[{number}]", 0, children="i*", **kinds)
        if number in seen or any(child <= number for child in node.children):
            raise Malformed(f"{node.where}: a node twice, or before what it is part of")
        seen.add(number)
        if halves := parts(number, node, own):
            alike(f"{node.where}.children", node.children, halves)
            waiting += zip(node.children, halves, strict=True)
