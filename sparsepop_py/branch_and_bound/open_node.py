"""Nodes of a growing search tree, where they are branched, and the certificate's nodes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from sparsepop_py.verified.certificate.certificate import Argument, Node
from sparsepop_py.verified.certificate.steps import BoxProof, Step

__all__ = ["OpenNode", "branching_point", "certificate_node"]


@dataclass(eq=False, kw_only=True)
class OpenNode:
    """A node of a growing tree, with what is proved of it so far. Mutable.

    Parameters
    ----------
    depth : int
        0 at the root.
    steps : list of Step
        From the node's box to a smaller one.
    argument : Identity, LinearDual, ExactGram, ExactDual or None
        That its bound follows from.
    empty : bool
        Whether its box holds no feasible point.
    branch : (int, float) or None
        Variable and branching point.
    children : tuple of OpenNode
        Two for a branch, none for a leaf.
    """

    depth: int = 0
    steps: list[Step] = field(default_factory=list)
    argument: Argument | None = None
    empty: bool = False
    branch: tuple[int, float] | None = None
    children: tuple[Self, ...] = ()


def certificate_node(root: OpenNode) -> Node:
    """Convert a tree to nodes of a certificate, children first; only leaves keep arguments.

    Parameters
    ----------
    root : OpenNode
    """
    order, stack = [], [root]
    while stack:
        node = stack.pop()
        order.append(node)
        stack.extend(node.children)
    made: dict[int, Node] = {}
    for node in reversed(order):
        steps, children = BoxProof(tuple(node.steps)), tuple(made[id(c)] for c in node.children)
        if children:
            made[id(node)] = Node(steps, branch=node.branch, children=children)
        else:  # without an argument, it is the steps that leave an empty box
            empty = node.empty and node.argument is not None
            made[id(node)] = Node(steps, node.argument, empty)
    return made[id(root)]


def branching_point(
    ends: tuple[float, float], value: float | None, middle: float, edge: float
) -> float:
    """Choose a branching point between the middle of an interval and a value in it.

    Parameters
    ----------
    ends : (float, float)
        Of the interval.
    value : float or None
        That of the variable in a relaxation; the middle where there is none.
    middle : float
        Weight of the middle, up to 1.
    edge : float
        Share of the width that the point keeps from both ends.

    Returns
    -------
    float

    Examples
    --------
    >>> branching_point((0.0, 1.0), 0.75, middle=0.5, edge=0.25)
    0.625
    >>> branching_point((0.0, 1.0), 1.0, middle=0.25, edge=0.25)
    0.75
    """
    low, high = ends
    point = centre = 0.5 * low + 0.5 * high
    if value is not None:
        point = middle * centre + (1.0 - middle) * value
    away = edge * (high - low)
    return float(np.clip(point, low + away, high - away))
