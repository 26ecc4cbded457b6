"""Boxes from cones of denominators as steps of a file."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from setid.formulation.formulation import Formulation
from setid.proofs.denominators.denominator_box import DenominatorBox, Limit
from setid.proofs.denominators.denominator_cells import Cell, VaryingLeaf
from setid.proofs.denominators.output_rows import OutputRows, output_rows

__all__ = ["denominator_steps"]


def denominator_steps(box: DenominatorBox, formulation: Formulation) -> list[dict[str, Any]]:
    """Write the trees of a box.

    Parameters
    ----------
    box : DenominatorBox
        Of a transfer function.
    formulation : Formulation

    Returns
    -------
    list of dict
        Steps ``Denominators`` of ``docs/certificate_format.md``, one for each tree.
    """
    found = []
    for tree, limits in zip(box.trees, box.limits, strict=True):
        rows = output_rows(formulation, tree.output)
        assert rows is not None
        found.append(
            {
                "is": "Denominators",
                "output": tree.output + 1,
                "stable": rows.stable,
                "rest": rows.sample is not None,
                "free": tree.free.tolist(),
                "multipliers": [_multiplier(line) for line in tree.multipliers],
                "nodes": [_node(cell) for cell in tree.cells],
                "limits": [_limit(limit, rows, formulation) for limit in limits],
            }
        )
    return found


def _multiplier(values: NDArray[np.float64]) -> dict[str, Any]:
    """Whole numbers times a power of two."""
    pairs = [value.as_integer_ratio() for value in values.tolist()]
    bits = max(below.bit_length() for _, below in pairs) - 1
    whole = [above << bits - below.bit_length() + 1 for above, below in pairs]
    return {"power": -bits, "values": whole}


def _node(cell: Cell | VaryingLeaf) -> dict[str, Any]:
    if isinstance(cell, Cell):
        assert cell.children
        split = {"children": cell.children, "edge": cell.edge, "weights": cell.weights}
        return {name: list(value) for name, value in split.items()} | _family((), (), ())
    assert cell.shares in ((), (1.0,))
    family = cell.used[0] if cell.used else ()
    nothing: dict[str, Any] = {"children": [], "edge": [], "weights": []}
    return nothing | _family(family, cell.powers, cell.minors)


def _limit(limit: Limit, rows: OutputRows, formulation: Formulation) -> dict[str, Any]:
    name, sign = rows.gains[limit.column]
    found = {
        "cell": limit.cell,
        "parameter": formulation.parameters.index(name),
        "sign": sign * limit.sign,
        "value": limit.value,
    }
    return found | _family(limit.used, limit.powers, limit.minors)


def _family(
    used: tuple[int, ...], powers: tuple[int, ...], minors: tuple[float, ...]
) -> dict[str, Any]:
    return {"family": list(used), "powers": list(powers), "minors": list(minors)}
