"""Stability certificates as JSON text, and the check that draws each conclusion again."""

from __future__ import annotations

import json
from fractions import Fraction
from math import inf, isnan
from typing import Any

import numpy as np

from setid.control.certificates.arcs import Ceiling
from setid.control.certificates.cells import prove_over_cells
from setid.control.certificates.certificate import Condition, Question, StabilityCertificate
from setid.control.certificates.refutation import proves_instability
from setid.control.engine import (
    Box,
    Identification,
    IOData,
    Noise,
    SetidError,
    TransferFunction,
    Verification,
    formulate,
    parsed,
    read,
    write,
)
from setid.control.engine import from_json as read_identification
from setid.control.engine import to_json as write_identification
from setid.control.parameters.parameter_set import ParameterSet, priors_of
from setid.control.transfer import Transfer

__all__ = ["from_json", "plants_of", "to_json", "verify"]

_HEAD = {"format": "setid", "version": 1, "is": "stability certificate"}
_PARTS: tuple[str, ...] = (
    "data",
    "model",
    "noise",
    "arcs",
    "bound",
    "margin",
    "integrators",
    "method",
    "verdict",
)
_PARTS += ("reason", "assumptions", "help", "cells", "seconds")
_SYSTEMS = ("controller", "reference", "plant")
_NARROW = 1e-9  # rad: no arc of a proof is as narrow
_MORE_CELLS = 4  # times the cells of the first proof, and a few, before a check gives up


def verify(answer: StabilityCertificate) -> Verification:
    """Draw the verdict of a certificate again from its record, without a clock.

    Parameters
    ----------
    answer : StabilityCertificate

    Returns
    -------
    Verification
        True where the verdict and all bounds follow; an open verdict claims nothing.
    """
    if answer.verdict == "open":
        claims_bound = answer.method == "small_gain" and answer.bound < 1.0
        if claims_bound or answer.plant is not None:
            return Verification(False, "an open verdict claims a bound below 1 or a plant")
        return Verification(True)
    question = _question(answer)
    if answer.verdict == "refuted":
        return _refuted(answer)
    return _certified(answer, question)


def _question(answer: StabilityCertificate) -> Question:
    return Question(
        answer.data,
        answer.noise,
        answer.model,
        answer.controller,
        answer.reference,
        answer.margin,
        answer.integrators,
        answer.method,
    )


def plants_of(answer: StabilityCertificate) -> ParameterSet:
    """Enclose all consistent plants of a certificate again from its record, without a clock.

    Parameters
    ----------
    answer : StabilityCertificate
        Certified.

    Raises
    ------
    SetidError
        If the record gives no finite set of plants.
    """
    question = _question(answer)
    found = question.known()
    if found is None or found.empty:
        raise SetidError("certificate: found no finite set of plants, expected one")
    if answer.identification is None:
        return found
    return question.narrowed(found, answer.identification)


def _refuted(answer: StabilityCertificate) -> Verification:
    """Check that the plant is consistent and its loop unstable."""
    if answer.plant is None:
        return Verification(False, "refuted without a plant")
    na, model = answer.model.na[0][0], answer.model
    below, top = answer.plant.denominator, answer.plant.numerator
    lags = [model.nk[0][0] + j for j in range(model.nb[0][0])]
    if below[0] != 1 or len(below) > na + 1 or len(top) > max(lags) + 1:
        return Verification(False, "the plant is not of the certificate's structure")
    values = [_at(below, i) for i in range(1, na + 1)] + [_at(top, lag) for lag in lags]
    theta = np.array([float(v) for v in values])
    others = [v for lag, v in enumerate(top) if lag not in lags]
    if any(others) or any(Fraction(t) != v for t, v in zip(theta, values, strict=True)):
        return Verification(False, "the plant is not of the certificate's structure")
    formulation = formulate(answer.data, model, answer.noise)
    found = proves_instability(
        formulation, answer.controller, model, theta, answer.integrators, answer.margin
    )
    return Verification(found, "" if found else "that the plant's loop is unstable is not proved")


def _at(polynomial: tuple[Fraction, ...], lag: int) -> Fraction:
    return polynomial[lag] if lag < len(polynomial) else Fraction(0)


def _certified(answer: StabilityCertificate, question: Question) -> Verification:
    """Prove the claim again, on what the record and a verified identification leave."""
    conditions, factor = question.exact_conditions()
    if any(c.holds is False for c in conditions):
        return Verification(False, "a condition of the small-gain theorem fails")
    found = question.known()
    if found is None or found.empty:
        return Verification(False, "the record gives no finite set of plants")
    if answer.identification is not None:
        verdict = _belongs(answer.identification, question, found)
        if not verdict:
            return verdict
        found = question.narrowed(found, answer.identification)
    most = _MORE_CELLS * answer.cells + 16
    ceiling = Ceiling.of(answer.arcs)
    whole = all(low + _NARROW < high for low, high, _ in answer.arcs)
    if answer.method == "small_gain" and not (whole and np.min(ceiling.values) > -inf):
        return Verification(False, "the stored bounds of abs(Delta) do not cover all frequencies")
    outcome = prove_over_cells(found, question.claim(factor, ceiling), inf, most)
    if not outcome.proved:
        return Verification(False, "the proof over all consistent plants fails")
    return _below(answer, outcome.arcs)


def _belongs(result: Identification, question: Question, known: ParameterSet) -> Verification:
    """Check that an identification is about this record and assumes nothing else."""
    verdict = result.verify()
    if not verdict:
        return verdict
    stated = result.formulation
    same = write([stated.data, stated.model, stated.noise]) == write(
        [question.data, question.model, question.noise]
    )
    if not same:
        return Verification(False, "the identification belongs to another record")
    asked = priors_of(question.model, known, question.integrators, question.margin)
    given = list(stated.priors)
    if len(given) != len(asked) or write(given[1:]) != write(asked[1:]):
        return Verification(False, "the identification has other priors")
    if not isinstance(given[0], Box):
        return Verification(False, "the identification has other priors")
    limits, (low, high) = given[0].bounds(question.model), known.box
    for name, a, b in zip(known.names, low, high, strict=True):
        ends = limits.get(name, (-inf, inf))
        if not (ends[0] <= a and b <= ends[1]):
            return Verification(False, "the identification starts from a box that is not proved")
    return Verification(True)


def _below(
    answer: StabilityCertificate, arcs: tuple[tuple[float, float, float], ...]
) -> Verification:
    """Check that new bounds are nowhere above the stored ones."""
    if answer.method == "characteristic":
        ok = isnan(answer.bound) and not answer.arcs
        return Verification(ok, "" if ok else "the method proves no bound of abs(Delta)")
    stored = Ceiling.of(answer.arcs)
    above = any(b > stored.over(low, high) for low, high, b in arcs)
    if above or not max((b for *_, b in arcs), default=0.0) <= answer.bound:
        return Verification(False, "a stored bound of abs(Delta) is below what is proved")
    return Verification(True)


# ---- text -------------------------------------------------------------------------------


def to_json(answer: StabilityCertificate) -> str:
    """Write a certificate with its record as JSON text.

    Parameters
    ----------
    answer : StabilityCertificate
    """
    found: dict[str, Any] = dict(_HEAD)
    found |= {name: write(getattr(answer, name), name) for name in _PARTS}
    found |= {name: _system(getattr(answer, name)) for name in _SYSTEMS}
    found["conditions"] = [[c.name, c.holds, c.text] for c in answer.conditions]
    known = answer.identification if answer.verdict == "certified" else None
    found["identification"] = None if known is None else json.loads(write_identification(known))
    return json.dumps(found, allow_nan=False, separators=(",", ":"))


def _system(system: Transfer | None) -> Any:
    if system is None:
        return None
    parts = (system.numerator, system.denominator)
    return {"coefficients": [[str(c) for c in part] for part in parts], "Ts": system.Ts}


def from_json(text: str) -> StabilityCertificate:
    """Read a certificate and verify it.

    Parameters
    ----------
    text : str
        As :func:`to_json` makes it.

    Raises
    ------
    SetidError
        If the text is no certificate, or a claim in it does not follow from its record.
    """
    try:
        found = parsed(text)
        head = {key: found.get(key) for key in _HEAD} if type(found) is dict else {}
    except (ValueError, TypeError, RecursionError) as error:
        raise SetidError(f"from_json: {error}, expected JSON text") from None
    if head != _HEAD:
        raise SetidError(f"from_json: found {head}, expected {_HEAD}")
    try:
        answer = _answer(found)
    except SetidError:
        raise
    except (TypeError, ValueError, KeyError, AttributeError, ZeroDivisionError) as error:
        raise SetidError(f"from_json: {error!r:.200}, expected a stored certificate") from error
    verdict = verify(answer)
    if not verdict:
        raise SetidError(f"from_json: found a claim that does not hold: {verdict.reason}")
    return answer


def _answer(found: dict[str, Any]) -> StabilityCertificate:
    parts: dict[str, Any] = {name: read(found[name], name) for name in _PARTS}
    for name, kind in (("data", IOData), ("noise", Noise), ("model", TransferFunction)):
        if not isinstance(parts[name], kind):
            raise SetidError(
                f"{name}: found {type(parts[name]).__name__}, expected {kind.__name__}"
            )
    for name, words in (
        ("verdict", ("certified", "refuted", "open")),
        ("method", ("small_gain", "characteristic")),
    ):
        if parts[name] not in words:
            raise SetidError(f"{name}: found {parts[name]!r:.40}, expected one of {words}")
    systems: dict[str, Any] = {name: _read_system(found[name]) for name in _SYSTEMS}
    if systems["controller"] is None or systems["reference"] is None:
        raise SetidError("from_json: found no controller or reference model, expected both")
    parts["arcs"] = tuple(tuple(float(v) for v in arc) for arc in parts["arcs"])
    parts["bound"] = float(parts["bound"])
    texts = {name: tuple(parts[name]) for name in ("assumptions", "help")}
    known = found["identification"]
    return StabilityCertificate(
        conditions=tuple(Condition(*item) for item in found["conditions"]),
        parameters=None,
        identification=None if known is None else read_identification(json.dumps(known)),
        **(parts | systems | texts),
    )


def _read_system(found: Any) -> Transfer | None:
    if found is None:
        return None
    numerator, denominator = ([Fraction(c) for c in part] for part in found["coefficients"])
    return Transfer(numerator, denominator, float(found["Ts"]))
