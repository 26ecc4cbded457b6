"""Nodes that a semidefinite relaxation bounds and tightens in turns."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from sparsepop_py.branch_and_bound import node
from sparsepop_py.branch_and_bound.node import NodeSettings, ProcessedNode
from sparsepop_py.progress import Stages
from sparsepop_py.tightening.obbt_sdp import TightenedBox
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.certificate import Proved

BOX = Interval(np.zeros(2), np.ones(2))


@pytest.mark.parametrize(
    ("bound", "shares", "rounds"),
    [
        (0.0, (0.79, 0.5, 0.81), 3),  # again while less than 0.8 of the widths is left
        (0.0, (0.81,), 1),
        (0.0, (0.5,) * 9, 6),  # six rounds at most
        (0.74, (0.5, 0.81), 2),
        (0.76, (), 0),  # half of 0.1 is more than a fifth of what is missing
    ],
)
def test_a_node_is_tightened_while_that_gains_and_not_where_its_children_close(
    bound, shares, rounds, monkeypatch
):
    problem = SimpleNamespace(with_objective=lambda _: None)
    context = SimpleNamespace(upper=1.0, deadline=SimpleNamespace(over=False), problem=problem)
    replay = SimpleNamespace(cutoff=0.9)
    left = iter(shares)
    monkeypatch.setattr(node, "_semidefinite", lambda *given: given[-1])
    monkeypatch.setattr(node, "tighten_by_relaxation", lambda *_: TightenedBox(BOX, (), next(left)))
    alone = Proved(-np.inf, 0.0, "")
    monkeypatch.setattr(node, "prove", lambda *_: alone)
    settings = NodeSettings(cast(Any, {}), (0, 1))
    found = ProcessedNode((), BOX, Proved(bound, 0.0, ""), None)
    node._obbt_sdp(cast(Any, context), settings, cast(Any, None), cast(Any, replay), found)
    assert len(shares) - len(list(left)) == rounds


@pytest.mark.parametrize("call", [node._semidefinite, node._obbt_sdp])
def test_relaxations_of_nodes_have_the_room_that_is_given(call, monkeypatch):
    """Linear programs have the slack alone."""
    rooms = []

    def noted(_box, *, slack):
        rooms.append(slack)
        raise StopIteration

    monkeypatch.setattr(node.Scaling, "of_box", noted)
    settings = NodeSettings(cast(Any, {}), (0, 1), slack=1.0, room=2.0)
    found = ProcessedNode((), BOX, Proved(0.5, 0.0, ""), None)
    context = SimpleNamespace(problem=None, stages=Stages())
    replay = SimpleNamespace(cutoff=0.9)
    with pytest.raises(StopIteration):
        call(cast(Any, context), settings, cast(Any, None), cast(Any, replay), found)
    assert rooms == [2.0]
