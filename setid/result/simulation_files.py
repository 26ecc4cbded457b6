"""Trees of simulated regions as steps of a file, each row named by what it comes from."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from setid.formulation.formulation import Formulation
from setid.proofs.simulated.forms import Region
from setid.proofs.simulated.outputs import Recursion, half_spaces, recursion_of
from setid.proofs.simulated.tree import SimulatedBox, first_region, split_region, tightened
from setid.proofs.supports import sources

__all__ = ["simulation_step"]

Reals = NDArray[np.float64]
Row = list[Any]  # kind, two numbers, sign


def simulation_step(
    box: SimulatedBox, formulation: Formulation, inside: tuple[Reals, Reals]
) -> dict[str, Any]:
    """Write the tree of a box.

    Parameters
    ----------
    box : SimulatedBox
        Of a transfer function.
    formulation : Formulation
    inside : (lower, upper), each (p,) float
        The box that the tree begins with.

    Returns
    -------
    dict
        The step ``Simulation`` of ``docs/certificate_format.md``.
    """
    parts = recursion_of(formulation, box.first)
    assert parts is not None
    root = first_region(formulation, *parts.box(*inside), box.directions)
    steps: list[list[dict[str, Any]]] = [[] for _ in box.nodes]
    waiting = [(root, 0)]
    while waiting:
        region, number = waiting.pop()
        node = box.nodes[number]
        for step in node.steps:
            if region is None:
                break
            spaces = half_spaces(formulation, parts, region)
            every = _rows(formulation, parts, region)
            assert len(every) == spaces.right.size
            rows = [every[row] for row in step.rows.tolist()]
            steps[number].append({"rows": rows, "weights": step.weights.tolist()})
            region = tightened(region, spaces, step)
        if region is not None and node.children:
            waiting += zip(split_region(region, node.split, node.at), node.children, strict=True)
    return {
        "is": "Simulation",
        "directions": box.directions.tolist(),
        "shares": np.linalg.pinv(box.directions).tolist(),
        "nodes": [
            {"steps": own, "split": node.split, "at": node.at, "children": list(node.children)}
            for own, node in zip(steps, box.nodes, strict=True)
        ],
    }


def _rows(formulation: Formulation, parts: Recursion, region: Region) -> list[Row]:
    """Name the origin of each half space of a region, in their order."""
    signals, found = parts.run(region), list[Row]()
    for channel, name in enumerate(parts.outputs):
        form = signals[name]
        usable = ~np.isnan(formulation.data.y[:, channel])
        usable &= np.isfinite(form.rest) & np.isfinite(form.value)
        usable &= np.all(np.isfinite(form.slope), axis=1)
        samples = np.flatnonzero(usable).tolist()
        found += [["output", channel + 1, k, sign] for sign in (1, -1) for k in samples]
    p = len(formulation.parameters)
    known = formulation.smoothed
    for kind, number, sign in sources(formulation, region.lower[:p], region.upper[:p]).tolist():
        if kind == 0 or known is None:
            found.append(["given", number, 0, sign])
        else:
            found.append(["record", int(known.output[number]), int(known.row[number]), sign])
    count = region.low.size
    return found + [["direction", j, 0, sign] for sign in (1, -1) for j in range(count)]
