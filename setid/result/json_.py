"""Identifications as JSON text; what is read back is verified before it is returned."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from math import inf
from typing import Any

import numpy as np

import sparsepop_py as sp
from setid.data.checks import FrozenMapping
from setid.data.record import IOData
from setid.errors import SetidError
from setid.formulation.formulation import Formulation, formulate
from setid.formulation.units import InUnits, in_units
from setid.options import Options
from setid.proofs.driven import within_driven
from setid.proofs.fields import check_fields
from setid.proofs.intervals import IntervalStatus, ParameterInterval
from setid.proofs.least_noise.noise_scale import NoiseScale, problem_with_factor
from setid.proofs.parameter_box import objectives, problem_on_box
from setid.result.certificate_files import certificate_files
from setid.result.damaged_texts import (
    list_of,
    member_of,
    object_of,
    refused,
    table_of,
    texts_of,
)
from setid.result.holdout import Holdout, stated
from setid.result.identification import Identification
from setid.result.json_parts import check_attained, read, write
from sparsepop_py.io.json_files.certificates import CERTIFICATES
from sparsepop_py.io.json_files.codecs import array, optional, parsed
from sparsepop_py.io.json_files.values import PROVED_POINT

__all__ = ["certificate_text", "from_json", "to_json"]

_FORMAT, _VERSION = "setid", 1
_KIND = "result"
_NEAR = 1e-6  # violation of rows by stored witnesses, relative to the sizes of their terms
_POINT = optional(PROVED_POINT)
_SCALE = ("scale", "theta", "witness", "limit", "bound", "box", "refuted")  # of a least factor
_KEYS = ("data", "model", "noise", "priors", "fingerprint", "options", "intervals", "box", "bounds")
_LATER = ("ends", "unbounded", "nonzero", "active", "samples", "timings", "notes")
_ENDS = ("attained", "results", "certificates")  # a list each, and certificates as one object
_END = ("lower_bound", "upper_bound", "solver_value", "status", "x", "notes")
_INTERVAL = ("name", "outer", "inner", "status", "witnesses")
_PLAIN = ("tol", "time_limit", "solver", "progress", "unidentifiable")  # fields of options


def to_json(result: Identification) -> str:
    """Write an identification with its evidence as JSON text.

    Parameters
    ----------
    result : Identification

    Returns
    -------
    str

    Raises
    ------
    SetidError
        If structure, noise or priors hold functions, which have no text.
    """
    found = {"format": _FORMAT, "version": _VERSION, "is": _KIND, _KIND: _written(result)}
    return json.dumps(found, allow_nan=False, separators=(",", ":"))


def certificate_text(result: Identification) -> str:
    """Write an identification for both checkers, the one of the package and that of ``checker/``.

    Parameters
    ----------
    result : Identification

    Returns
    -------
    str
        JSON: what :func:`setid.certificate_files` gives, with the text of ``to_json`` as
        ``result``.
    """
    found = certificate_files(result)
    return json.dumps({**found, "result": json.loads(to_json(result))["result"]}, allow_nan=False)


def from_json(text: str) -> Identification:
    """Read an identification and verify each claim of it.

    Parameters
    ----------
    text : str
        As :func:`to_json` makes it.

    Returns
    -------
    Identification

    Raises
    ------
    SetidError
        If the text is no identification, or a claim in it does not follow from its record.
    """
    try:
        found = parsed(text)
    except ValueError as error:
        raise SetidError(f"from_json: {error}") from None
    if type(found) is not dict:
        raise SetidError(f"from_json: found {text[:40]!r}, expected an object of JSON")
    head = [found.get(key) for key in ("format", "is", "version")]
    if head != [_FORMAT, _KIND, _VERSION]:
        raise SetidError(
            f"from_json: found {head}, expected {[_FORMAT, _KIND, _VERSION]} as format, kind and "
            "version"
        )
    with refused("from_json", "a stored identification"):
        result = _result(object_of(found.get(_KIND), _KIND))
    with refused("from_json: verification", "claims that can be checked"):
        verdict = result.verify()
    if not verdict:
        raise SetidError(f"from_json: found a claim that does not hold: {verdict.reason}")
    units = in_units(result.problem, result.formulation).units
    check_attained(result.intervals, units[: len(result.intervals)].tolist())
    return result


# ---- writing ----------------------------------------------------------------------------


def _written(result: Identification) -> dict[str, Any]:
    formulation = result.formulation
    return {
        "data": write(formulation.data, "data"),
        "model": write(formulation.model, "model"),
        "noise": write(formulation.noise, "noise"),
        "priors": [write(p, f"priors[{k}]") for k, p in enumerate(formulation.priors)],
        "fingerprint": result.problem.fingerprint,
        "options": {name: getattr(result.options, name) for name in _PLAIN},
        "intervals": [
            {
                "name": item.name,
                "outer": write(item.outer),
                "inner": write(item.inner),
                "status": item.status.name,
                "witnesses": [optional(array).write(w) for w in item.witnesses],
            }
            for item in result.intervals.values()
        ],
        "box": write(result.box, "box"),
        "bounds": write(result.bounds, "bounds"),
        "ends": _ends(result.results),
        "unbounded": write(result.unbounded, "unbounded"),
        "reference": None if result.reference is None else _written(result.reference),
        "nonzero": write(result.nonzero, "nonzero"),
        "fewer_priors": None if result.fewer_priors is None else _written(result.fewer_priors),
        "driven": None if result.driven is None else _written(result.driven),
        "holdout": None if result.holdout is None else _held_out(result.holdout.level),
        "active": dict(result.active),
        "samples": [list(pair) for pair in result.samples],
        "timings": dict(result.timings),
        "notes": list(result.notes),
    }


def _held_out(level: NoiseScale) -> dict[str, Any]:
    """Evidence from held-out samples; their problem follows from that of the result."""
    return {
        "data": write(level.formulation.data, "data"),
        "noise": write(level.noise, "noise"),
        "ends": _ends(() if level.result is None else (level.result,)),
        **{key: write(getattr(level, key), key) for key in _SCALE},
    }


def _ends(found: Sequence[sp.Result]) -> dict[str, Any]:
    return {
        "attained": [_POINT.write(r.attained) for r in found],
        "results": [_end(r) for r in found],
        "certificates": CERTIFICATES.write([r.certificate for r in found]),
    }


def _end(found: sp.Result) -> dict[str, Any]:
    numbers = {"lower_bound": found.lower_bound, "upper_bound": found.upper_bound}
    numbers["solver_value"] = float(found.solver_value)
    return {key: write(value) for key, value in numbers.items()} | {
        "status": found.status.name,
        "x": optional(array).write(found.x),
        "notes": list(found.notes),
    }


# ---- reading ----------------------------------------------------------------------------


def _result(found: dict[str, Any], known: Mapping[str, Any] | None = None) -> Identification:
    """Read a result; priors that are known by their texts are the same objects again.

    Verification tells which priors the evidence with fewer of them rests on, and constraints are
    equal only to themselves.
    """
    object_of(found, _KIND, (*_KEYS, *_LATER))
    data = read(found["data"], "data")
    if not isinstance(data, IOData):
        raise SetidError(f"data: found {type(data).__name__}, expected IOData")
    model, noise = read(found["model"], "model"), read(found["noise"], "noise")
    shared = dict(known or {})
    priors = list_of(found["priors"], "priors")
    texts = [json.dumps(prior, sort_keys=True) for prior in priors]
    for text, prior in zip(texts, priors, strict=True):
        shared[text] = shared[text] if text in shared else read(prior, "priors")
    formulation = formulate(data, model, noise, [shared[text] for text in texts])
    box, bounds = read(found["box"], "box"), read(found["bounds"], "bounds")
    reference, fewer, driven = (
        None if found.get(key) is None else _result(object_of(found[key], key), shared)
        for key in ("reference", "fewer_priors", "driven")
    )
    with refused("box", "a box of these parameters"):
        problem = _stated(formulation, box, driven, found["fingerprint"])
    plain = object_of(found["options"], "options", _PLAIN)
    options = Options(**{name: plain[name] for name in _PLAIN})
    items = list_of(found["intervals"], "intervals")
    made_items = [_interval(item, formulation, f"intervals[{k}]") for k, item in enumerate(items)]
    intervals = FrozenMapping({item.name: item for item in made_items})
    ends = object_of(found["ends"], "ends", _ENDS)
    asked = objectives(formulation) if ends["results"] else []
    made = Identification(
        formulation=formulation,
        intervals=intervals,
        problem=problem,
        options=options,
        assumptions=formulation.assumptions,
        box=box,
        bounds=bounds,
        results=_results(ends, in_units(problem, formulation), asked, options),
        active=FrozenMapping(table_of(found["active"], "active", bool)),
        samples=read(found["samples"], "samples"),
        timings=FrozenMapping(table_of(found["timings"], "timings", float)),
        notes=texts_of(found["notes"], "notes"),
        unbounded=read(found["unbounded"], "unbounded"),
        reference=reference,
        nonzero=read(found["nonzero"], "nonzero"),
        fewer_priors=fewer,
        driven=driven,
        holdout=_holdout(found.get("holdout"), formulation, intervals, options),
    )
    check_fields(made, "result")
    return made


def _stated(
    formulation: Formulation, box: Any, driven: Identification | None, fingerprint: str
) -> sp.Problem:
    """State the problem that was solved, of the record alone or on its box."""
    problem = formulation.problem
    if problem.fingerprint != fingerprint:
        problem = problem_on_box(formulation, box)
        if driven is not None and not driven.empty:
            problem = within_driven(problem, formulation, driven.intervals)
    if problem.fingerprint != fingerprint:
        raise SetidError(
            f"fingerprint: found {fingerprint!r:.60}, expected that of the problem of this record, "
            "with its structure, noise, priors and box"
        )
    return problem


def _holdout(
    found: dict[str, Any] | None,
    known: Formulation,
    intervals: Mapping[str, ParameterInterval],
    options: Options,
) -> Holdout | None:
    if found is None:
        return None
    object_of(found, "holdout", ("data", "noise", "ends", *_SCALE))
    ends = object_of(found["ends"], "ends", _ENDS)
    noise = read(found["noise"], "noise")
    data, parts = read(found["data"], "data"), {key: read(found[key], key) for key in _SCALE}
    formulation = stated(known, intervals, data, noise, parts["limit"])
    problem = problem_with_factor(formulation, parts["box"])
    asked = [problem.objective] if ends["results"] else []
    results = _results(ends, in_units(problem, formulation), asked, options)
    result = results[0] if results else None
    level = NoiseScale(
        **parts, formulation=formulation, problem=problem, result=result, noise=noise
    )
    check_fields(level, "holdout")
    return Holdout(level)


def _interval(found: Any, formulation: Formulation, place: str) -> ParameterInterval:
    object_of(found, place, _INTERVAL)
    witnesses = list_of(found["witnesses"], f"{place}.witnesses")
    if len(witnesses) != 2:
        raise SetidError(f"{place}.witnesses: found {len(witnesses)}, expected two")
    low, high = (optional(array).read(w, f"{place}.witnesses") for w in witnesses)
    for point in (low, high):
        _check_witness(point, formulation)
    made = ParameterInterval(
        name=found["name"],
        outer=read(found["outer"], f"{place}.outer"),
        inner=read(found["inner"], f"{place}.inner"),
        status=member_of(IntervalStatus, found["status"], f"{place}.status"),
        witnesses=(low, high),
    )
    check_fields(made, place)
    return made


def _check_witness(point: Any, formulation: Formulation) -> None:
    """Refuse a stored point that is plainly no member; verification proves the ends themselves."""
    if point is None:
        return
    problem = formulation.problem
    if point.shape != (problem.dimension,) or not np.all(np.isfinite(point)):
        raise SetidError(
            f"witnesses: found shape {point.shape}, expected ({problem.dimension},), finite"
        )
    sizes = [np.abs(c.polynomial.coefficients).max(initial=0.0) for c in problem.constraints]
    scale = max(1.0, *sizes, float(np.abs(point).max())) if sizes else 1.0
    if problem.violation(point) > _NEAR * scale:
        raise SetidError("witnesses: found a point that violates the rows of the record")


def _proved_again(point: sp.ProvedPoint, problem: sp.Problem) -> sp.ProvedPoint:
    """Return a point if its proof gives no less than it says, else what the proof gives."""
    found = point.recheck(problem)
    if found is None:
        raise SetidError("attained: found a point that could not be proved again")
    near = np.array_equal(found.x, point.x) and found.radius <= point.radius
    return point if near and found.value <= point.value else found


def _results(
    found: dict[str, Any], scaled: InUnits, asked: Sequence[Any], options: Options
) -> tuple[sp.Result, ...]:
    items = list_of(found["results"], "ends.results")
    proofs = CERTIFICATES.read(found["certificates"], "certificates")
    attained = list_of(found["attained"], "ends.attained")
    points = [_POINT.read(p, "attained") for p in attained]
    if not len(items) == len(proofs) == len(points) == len(asked):
        raise SetidError("ends: found numbers of proofs that differ, expected two a parameter")
    made = []
    for k, (item, proof, point) in enumerate(zip(items, proofs, points, strict=True)):
        made.append(_solved(item, proof, point, asked[k], scaled, options, f"ends.results[{k}]"))
    return tuple(made)


def _solved(
    item: Any,
    proof: sp.Certificate | None,
    point: sp.ProvedPoint | None,
    objective: Any,
    scaled: InUnits,
    options: Options,
    place: str,
) -> sp.Result:
    """Read one end: what verification proves, whatever the text states beside it."""
    object_of(item, place, _END)
    problem = scaled.problem.with_objective(scaled.asked(objective)[0])
    if point is not None:
        point = _proved_again(point, problem)
    low, high, solver = (_number(item, key, place) for key in _END[:3])
    return sp.Result(
        problem=problem,
        options=options.for_engine(),
        status=member_of(sp.Status, item["status"], f"{place}.status"),
        lower_bound=-inf if proof is None else min(low, proof.bound),
        upper_bound=inf if point is None else max(high, point.value),
        x=optional(array).read(item["x"], f"{place}.x"),
        certificate=proof,
        attained=point,
        points=(),
        relaxation=None,
        solution=None,
        solver_value=solver,
        notes=texts_of(item["notes"], f"{place}.notes"),
    )


def _number(item: dict[str, Any], key: str, place: str) -> float:
    value = read(item[key], f"{place}.{key}")
    if type(value) not in (int, float):
        raise SetidError(f"{place}.{key}: found {value!r:.60}, expected a number")
    return float(value)
