"""Identifications as files that the second checker reads: record, structure, rows, proofs.

The format is described in ``docs/certificate_format.md``, section "Records".
"""

from __future__ import annotations

import json
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.record import IOData
from setid.errors import SetidError
from setid.formulation.formulation import Formulation
from setid.formulation.layout import Layout
from setid.formulation.lifting import LIFTED
from setid.formulation.regression import Regression
from setid.formulation.units import InUnits, coupled_rows, in_units
from setid.models.lti import TransferFunction
from setid.proofs.denominators.denominator_box import DenominatorBox
from setid.proofs.evidence import Claimed, EndProof, Evidence
from setid.proofs.parameter_box import product_rows, start_of
from setid.proofs.simulated.tree import SimulatedBox
from setid.result.denominator_files import denominator_steps
from setid.result.simulation_files import simulation_step
from sparsepop_py.io.json_files import codecs
from sparsepop_py.io.json_files.certificates import CERTIFICATE
from sparsepop_py.io.json_files.values import PROVED_POINT
from sparsepop_py.verified.uncertain_rows.directions import LARGEST, DirectionBox, cubes, within
from sparsepop_py.verified.uncertain_rows.lifted_products import LiftedBox
from sparsepop_py.verified.uncertain_rows.sign_tree import (
    LeftInverse,
    ParameterBox,
    SignTree,
    halves,
    hull,
    linear_rows,
)

__all__ = ["certificate_files"]

Box = tuple[NDArray[np.float64], NDArray[np.float64]]

_FORMAT, _VERSION = "setid", 10


def certificate_files(result: Claimed) -> dict[str, Any]:
    """Write an identification as an object of JSON that a stranger can check.

    Parameters
    ----------
    result : Identification
        Of a structure with its own normalisation.

    Returns
    -------
    dict
        To be written by ``json.dump`` and checked by ``checker/check.py``.

    Raises
    ------
    SetidError
        If the result rests on another one, with a normalisation (``unidentifiable="report"``):
        write that.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> model = setid.TransferFunction(na=1, nb=1)
    >>> found = certificate_files(setid.identify(data, model, setid.Noise(equation=0.5)))
    >>> low, high = found["identification"]["intervals"][1]["outer"]
    >>> found["identification"]["parameters"], round(low, 9), round(high, 9)
    (['a1', 'b0'], 1.916666667, 2.109302326)
    """
    claims = result.evidence
    if claims.reference is not None:
        raise SetidError("result: found one that rests on its reference, expected result.reference")
    return {
        "format": _FORMAT,
        "version": _VERSION,
        "is": "identification",
        "identification": _shared(claims) | _own(claims),
    }


def _shared(claims: Evidence) -> dict[str, Any]:
    """State what is asked of all rows of a record."""
    formulation = claims.formulation
    return {"record": _record(formulation.data), "noise": _noise(formulation)}


def _own(claims: Evidence) -> dict[str, Any]:
    """State structure, problem and proofs."""
    formulation = claims.formulation
    problem, layout = formulation.problem, formulation.layout
    scaled = in_units(claims.problem, formulation)
    about = scaled.problem if claims.ends or not claims.bounds else problem
    units = scaled.units if about is scaled.problem else np.ones(layout.dimension)
    start = start_of(formulation)
    return {
        "structure": _structure(formulation.model),
        "assumptions": list(formulation.assumptions),
        "parameters": list(formulation.parameters),
        "variables": _variables(layout, formulation.data.samples),
        "units": units.tolist(),
        "problem": json.loads(sp.to_json(about))["problem"],
        "rows": _origins(formulation),
        "given": [[codecs.number.write(v) for v in ends] for ends in start],
        "box": None if claims.box is None else _box(claims.box, formulation, start),
        "driven": None if claims.driven is None else _own(claims.driven),
        "fewer_priors": None if claims.fewer_priors is None else _own(claims.fewer_priors),
        "linear": [_linear_bound(bound) for bound in claims.bounds],
        "ends": [_end(item) for item in claims.ends],
        "intervals": [
            {
                "name": item.name,
                "outer": [codecs.number.write(v) for v in item.outer],
                "inner": None
                if item.inner is None
                else [codecs.number.write(v) for v in item.inner],
                "status": str(item.status),
            }
            for item in claims.intervals.values()
        ],
    }


def _columns(values: NDArray[np.float64]) -> list[list[float | None]]:
    return [[None if np.isnan(v) else float(v) for v in column] for column in values.T]


def _record(data: IOData) -> dict[str, Any]:
    ranges = {"u": data.u_range, "y": data.y_range}
    return {
        "u": _columns(data.u),
        "y": _columns(data.y),
        "starts": data.starts.tolist(),
        "ranges": {k: None if v is None else v.tolist() for k, v in ranges.items()},
    }


def _structure(model: Any) -> dict[str, Any]:
    """Orders of a transfer function; of another structure its text only."""
    if type(model) is not TransferFunction:
        return {"is": "rows", "text": repr(model)}
    names = ("na", "nb", "nk", "common_denominator", "offset", "initial", "form")
    return {"is": "TransferFunction"} | {
        name: [list(row) for row in value] if isinstance(value, tuple) else value
        for name in names
        for value in (getattr(model, name),)
    }


def _noise(formulation: Formulation) -> dict[str, Any]:
    bounds = formulation.noise.bounds(formulation.data)._asdict()
    return {name: values.T.tolist() for name, values in bounds.items()}


def _variables(layout: Layout, samples: int) -> list[Any]:
    """For each unknown its group, its channel (from 1, 0 for none) and its sample or place."""
    found: list[Any] = [None] * layout.dimension
    for group, numbers in layout.groups.items():
        if group in ("theta", "slack", LIFTED):
            for place, number in enumerate(numbers.tolist()):
                found[number] = [group, 0, place]
            continue
        columns = numbers.reshape(samples, -1)
        for k, channel in np.argwhere(columns >= 0).tolist():
            own = channel + 1 if numbers.ndim == 2 else 0
            found[int(columns[k, channel])] = [group, own, k]
    return found


def _origins(formulation: Formulation) -> list[Any]:
    """For each row its equation and its sample from 0; null for priors and noise sets.

    Rows that define sums of products have the number of the sum, from 0.
    """
    rows, starts = formulation.rows, formulation.data.starts
    found: list[Any] = []
    for origin, name, record, sample in zip(
        rows.origin, rows.equation, rows.record.tolist(), rows.sample.tolist(), strict=True
    ):
        place = len(found) if name == LIFTED else int(starts[record - 1]) + sample - 1
        found.append([name, place] if origin == "model" else None)
    return found


def _end(end: EndProof) -> dict[str, Any]:
    """Certificate and attained point of one end, as they are written in results."""
    point, proof = end.attained, end.certificate
    return {
        "certificate": None if proof is None else CERTIFICATE.write(proof),
        "attained": None if point is None else PROVED_POINT.write(point),
    }


# ---- rationals --------------------------------------------------------------------------------


def _linear_bound(bound: sp.LinearBound) -> dict[str, Any]:
    return {
        "status": str(bound.status),
        "multipliers": [[int(row), str(value)] for row, value in bound.multipliers],
        "vertex": _rationals(bound.vertex),
        "ray": _rationals(bound.ray),
    }


def _rationals(values: tuple[Fraction, ...] | None) -> list[str] | None:
    return None if values is None else [str(value) for value in values]


# ---- boxes ------------------------------------------------------------------------------------


def _box(box: Any, formulation: Formulation, start: NDArray[np.float64]) -> dict[str, Any]:
    """Write the ends of a box and the steps that prove it, null where files hold none."""
    ends = {
        "lower": [codecs.number.write(v) for v in box.lower],
        "upper": [codecs.number.write(v) for v in box.upper],
    }
    steps = None
    if type(formulation.model) is TransferFunction:
        steps = _proved(box, formulation, start)
    return ends | {"steps": steps, "kind": type(box).__name__}


def _by_rows(
    box: Any, formulation: Formulation, start: NDArray[np.float64]
) -> list[dict[str, Any]] | None:
    """Steps of boxes from rows that are linear in the parameters or in their products."""
    if isinstance(box, LiftedBox):
        return _lifted(box, formulation, start)
    rows = formulation.regression
    if rows is None or not isinstance(box, ParameterBox | DirectionBox):
        return None
    if formulation.smoothed is not rows:
        return None
    if isinstance(box, ParameterBox):
        return _steps(box, rows, (start[0], start[1]))
    step, inside = _directions(box, formulation)
    first = _steps(box.first, rows, (start[0], start[1]))
    return [*first, step, *_steps(box.last, rows, (inside[0], inside[1]))]


def _proved(
    box: Any, formulation: Formulation, start: NDArray[np.float64]
) -> list[dict[str, Any]] | None:
    """All steps of a box; None where the file does not hold those of the box before."""
    if not isinstance(box, SimulatedBox | DenominatorBox):
        return _by_rows(box, formulation, start)
    inside, first = (start[0], start[1]), list[dict[str, Any]]()
    if box.first is not None:
        found = _proved(box.first, formulation, start)
        if found is None:
            return None
        first = found
        inside = np.maximum(start[0], box.first.lower), np.minimum(start[1], box.first.upper)
    if isinstance(box, DenominatorBox):
        return [*first, *denominator_steps(box, formulation)]
    return [*first, simulation_step(box, formulation, inside)]


def _steps(box: ParameterBox, rows: Regression, inside: Box) -> list[dict[str, Any]]:
    steps: list[dict[str, Any]] = []
    for step in box.steps:
        if isinstance(step, LeftInverse):
            steps.append(_left_inverse(step, rows))
            low, high = step.box()
            inside = np.maximum(inside[0], low), np.minimum(inside[1], high)
        else:
            nodes: list[dict[str, Any]] = []
            inside = _sign_tree(step, rows, inside, nodes)
            steps.append({"is": "SignTree", "nodes": nodes})
    return steps


def _lifted(
    box: LiftedBox, formulation: Formulation, start: NDArray[np.float64]
) -> list[dict[str, Any]] | None:
    """Steps in products of parameters; None where sums or limits are proved as well."""
    products = product_rows(formulation)
    if products is None or any(box.sums) or box.sharper or box.limit is not None:
        return None
    rows = products.regression
    assert isinstance(rows, Regression)
    columns = [[list(monomial) for monomial in column] for column in products.columns]
    steps, inside = [], start
    for found in box.rounds:
        begin = products.start(inside)
        inner = _steps(found, rows, (begin[0], begin[1]))
        steps.append({"is": "Products", "columns": columns, "steps": inner})
        if not found.empty:
            inside = products.shrunk(inside, found.lower, found.upper)
    return steps


def _directions(
    box: DirectionBox, formulation: Formulation
) -> tuple[dict[str, Any], NDArray[np.float64]]:
    """Certificates of all sides of the cube of directions, and the box that they prove."""
    coupled = coupled_rows(formulation)
    cube, least = cubes(coupled, box.first, box.scale), LARGEST
    numbers, sides = np.flatnonzero(coupled.rows).tolist(), []
    for place, (count, proof) in enumerate(zip(box.rows, box.certificates, strict=True)):
        scaled = cube(count).side(place)
        least = min(least, proof.bound * scaled.factor)
        sides.append(
            {
                "rows": numbers[:count],
                "units": scaled.units.tolist(),
                "factors": _factors(cube(count).rows, scaled),
                "certificate": CERTIFICATE.write(proof),
            }
        )
    found = {
        "is": "Directions",
        "scale": box.scale.tolist(),
        "lower": [codecs.number.write(v) for v in box.first.lower],
        "upper": [codecs.number.write(v) for v in box.first.upper],
        "sides": sides,
    }
    return found, within(box.first, box.scale, least)


def _factors(rows: list[sp.Constraint], scaled: InUnits) -> list[float]:
    """Powers of two by which rows in units were multiplied."""
    units, found = np.append(1.0, scaled.units), list[float]()
    for row, made in zip(rows, scaled.problem.constraints, strict=True):
        plain = row.polynomial.coefficients[:1] * np.prod(units[row.polynomial.words[:1]], axis=1)
        found += (made.polynomial.coefficients[:1] / plain).tolist() or [1.0]
    return found


def _left_inverse(step: LeftInverse, rows: Regression) -> dict[str, Any]:
    return {
        "is": "LeftInverse",
        "rows": [[int(i), int(k)] for i, k in zip(rows.output, rows.row, strict=True)],
        "inverse": step.inverse.tolist(),
        "centre": step.centre.tolist(),
        "radius": step.radius.tolist(),
    }


def _sign_tree(tree: SignTree, rows: Regression, box: Box, nodes: list[dict[str, Any]]) -> Box:
    """Append the nodes of a tree, children after their parents; the box that it proves."""
    node: dict[str, Any] = {"split": tree.split, "children": [], "rows": [], "bounds": []}
    nodes.append(node)
    if tree.split >= 0:
        found = []
        for child, half in zip(tree.children, halves(box, tree.split), strict=True):
            node["children"].append(len(nodes))
            found.append(_sign_tree(child, rows, half, nodes))
        return hull(found)
    if not tree.bounds:
        return box
    problem = linear_rows(rows, box)
    used = sorted(
        {n for b in tree.bounds for n, _ in b.multipliers if n < len(problem.constraints)}
    )
    count = len(problem.constraints)
    for number in used:
        slope = [0.0] * (len(rows.names) + 1)  # the constant last
        polynomial = problem.constraints[number].polynomial
        for word, value in zip(polynomial.words, polynomial.coefficients, strict=True):
            slope[int(word[-1]) - 1] = float(value)
        k, side = divmod(number, 2)
        node["rows"].append([int(rows.output[k]), int(rows.row[k]), 1 - 2 * side, slope])
    order = {number: own for own, number in enumerate(used)}
    for bound in tree.bounds:
        pairs = [
            [order.get(int(n), int(n) - count + len(used)), str(value)]
            for n, value in bound.multipliers
        ]
        node["bounds"].append({"empty": bound.status is sp.Status.INFEASIBLE, "multipliers": pairs})
    if tree.bounds[0].status is sp.Status.INFEASIBLE:
        return np.full(box[0].size, np.inf), np.full(box[0].size, -np.inf)
    ends = np.array([bound.lower for bound in tree.bounds])
    return np.maximum(box[0], ends[0::2]), np.minimum(box[1], -ends[1::2])
