"""Stability certificates as JSON text, and the check that draws each conclusion again."""

from __future__ import annotations

import json
from collections.abc import Callable
from fractions import Fraction
from math import inf, isnan, pi
from typing import Any

import numpy as np

from setid.control.certificates.arcs import Ceiling
from setid.control.certificates.cells import prove_over_cells
from setid.control.certificates.certificate import NOTHING, Question, StabilityCertificate
from setid.control.certificates.conditions import Condition
from setid.control.certificates.refutation import proves_instability
from setid.control.engine import (
    Box,
    Identification,
    IOData,
    Noise,
    SetidError,
    TransferFunction,
    Verification,
    entries_of,
    formulate,
    natural,
    number,
    parsed,
    read,
    refused,
    word,
    write,
)
from setid.control.engine import from_json as read_identification
from setid.control.engine import to_json as write_identification
from setid.control.parameters.parameter_set import ParameterSet, priors_of
from setid.control.transfer import Transfer
from sparsepop_py.io.json_files.codecs import rational

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
_TEXTS = ("assumptions", "help")
_KINDS = {"data": IOData, "noise": Noise, "model": TransferFunction}
_KINDS |= {"controller": Transfer, "reference": Transfer}
_WORDS = {
    "verdict": ("certified", "refuted", "open"),
    "method": ("small_gain", "characteristic"),
}
_NARROW = 1e-9  # rad: no arc of a proof is as narrow
_GAP = "the stored bounds of abs(Delta) do not cover all frequencies"
_NOT_EMPTY = "that no plant is consistent is not proved"
_NO_BOUNDS = "bounds of abs(Delta) over all consistent plants do not follow"
_MORE_CELLS = 4  # times the cells of the first proof, and a few, before a check gives up


def verify(answer: StabilityCertificate) -> Verification:
    """Draw the verdict of a certificate again from its record, without a clock.

    Parameters
    ----------
    answer : StabilityCertificate

    Returns
    -------
    Verification
        True where the verdict, all bounds and what is said of them follow; an open verdict claims
        nothing but its bounds of abs(Delta), and that no plant is consistent, where it says so.

    Raises
    ------
    SetidError
        If a field is none that a certificate has.
    """
    _check(answer)
    question = _question(answer)
    if not question.fits(answer):
        return Verification(False, "reason, conditions or assumptions are not those of the claim")
    if answer.verdict != "certified" and not (bounds := _bounded(answer, question)):
        return bounds
    if answer.verdict == "open":
        claims_bound = answer.method == "small_gain" and answer.bound < 1.0
        if claims_bound or answer.plant is not None:
            return Verification(False, "an open verdict claims a bound below 1 or a plant")
        return Verification(True) if answer.reason != NOTHING else _empty(answer, question)
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


def _empty(answer: StabilityCertificate, question: Question) -> Verification:
    """Prove again that no plant is consistent with the record."""

    def check(found: ParameterSet) -> Verification:
        return Verification(found.empty, "" if found.empty else _NOT_EMPTY)

    return _over_plants(answer, question, check)


def _over_plants(
    answer: StabilityCertificate, question: Question, check: Callable[[ParameterSet], Verification]
) -> Verification:
    """Check a claim on what the record and a verified identification leave.

    Where time was short the proof was on the brief set, which is taken where the other fails: a
    proof on either holds. With an identification it was on the other.
    """
    verdict = Verification(False, "the record gives no finite set of plants")
    for brief in (False, True) if answer.identification is None else (False,):
        found = question.known(brief=brief)
        if found is None:
            continue
        if answer.identification is not None:
            verdict = _belongs(answer.identification, question, found)
            if not verdict:
                return verdict
            found = question.narrowed(found, answer.identification)
        verdict = check(found)
        if verdict:
            break
    return verdict


def _refuted(answer: StabilityCertificate) -> Verification:
    """Check that the plant is consistent and its loop unstable.

    Common factors of the controller's numerator and denominator are removed first. A pole outside
    the unit circle that a zero cancels proves nothing about the loop.
    """
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
    controller = answer.controller.reduced()
    found = proves_instability(
        formulation, controller, model, theta, answer.integrators, answer.margin
    )
    return Verification(found, "" if found else "that the plant's loop is unstable is not proved")


def _at(polynomial: tuple[Fraction, ...], lag: int) -> Fraction:
    return polynomial[lag] if lag < len(polynomial) else Fraction(0)


def _certified(answer: StabilityCertificate, question: Question) -> Verification:
    """Prove the claim again, on what the record and a verified identification leave."""
    conditions, factor = question.exact_conditions()
    if any(c.holds is False for c in conditions):
        return Verification(False, "a condition of the small-gain theorem fails")
    most = _MORE_CELLS * answer.cells + 16
    ceiling = Ceiling.of(answer.arcs)
    if answer.method == "small_gain" and not _is_whole(answer, ceiling):
        return Verification(False, _GAP)

    def check(found: ParameterSet) -> Verification:
        if found.empty:
            return Verification(False, "the record gives no finite set of plants")
        outcome = prove_over_cells(found, question.claim(factor, ceiling), inf, most)
        if not outcome.proved:
            return Verification(False, "the proof over all consistent plants fails")
        return _below(answer, outcome.arcs)

    return _over_plants(answer, question, check)


def _bounded(answer: StabilityCertificate, question: Question) -> Verification:
    """Prove the bounds of abs(Delta) of a verdict that is not certified again.

    They hold for all consistent plants at once; there may be none. Those of a certified verdict
    are proved cell by cell.
    """
    if answer.method == "characteristic":
        return _below(answer, ())
    if not answer.arcs:
        none = answer.bound == inf
        return Verification(none, "" if none else "a bound of abs(Delta) is on no arc")
    (_, factor), ceiling = question.exact_conditions(), Ceiling.of(answer.arcs)
    if factor is None or not _is_whole(answer, ceiling):
        return Verification(False, _GAP)
    claim = question.claim(factor, ceiling)

    def check(found: ParameterSet) -> Verification:
        arcs = () if found.empty else tuple(claim.attempt(found).arcs)
        if not arcs and not found.empty:
            return Verification(False, _NO_BOUNDS)
        return _below(answer, arcs)

    return _over_plants(answer, question, check)


def _is_whole(answer: StabilityCertificate, ceiling: Ceiling) -> bool:
    """Check that arcs, none of them narrow, cover all frequencies."""
    wide = all(low + _NARROW < high for low, high, _ in answer.arcs)
    return wide and bool(np.min(ceiling.values) > -inf)


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
    below = all(b <= answer.bound and b <= stored.over(low, high) for low, high, b in arcs)
    if not (below and answer.bound >= 0.0):  # nor where a new bound is NaN
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
    rests = answer.verdict == "certified" or answer.reason == NOTHING or bool(answer.arcs)
    known = answer.identification if rests else None
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
    except ValueError as error:
        raise SetidError(f"from_json: {error}") from None
    if head != _HEAD:
        raise SetidError(f"from_json: found {head}, expected {_HEAD}")
    with refused("from_json", "a stored certificate"):
        answer = _answer(found)
    with refused("from_json: verification", "claims that can be checked"):
        verdict = verify(answer)
    if not verdict:
        raise SetidError(f"from_json: found a claim that does not hold: {verdict.reason}")
    return answer


def _answer(found: dict[str, Any]) -> StabilityCertificate:
    parts: dict[str, Any] = {name: read(found[name], name) for name in _PARTS}
    systems: dict[str, Any] = {name: _read_system(found[name]) for name in _SYSTEMS}
    arcs = entries_of(parts["arcs"], "arcs", "a list of arcs", SetidError)
    parts["arcs"] = tuple(_arc(arc, f"arcs[{k}]") for k, arc in enumerate(arcs))
    texts = {name: _texts(parts[name], name) for name in _TEXTS}
    known = found["identification"]
    return StabilityCertificate(
        conditions=tuple(_condition(item) for item in found["conditions"]),
        parameters=None,
        identification=None if known is None else read_identification(json.dumps(known)),
        **(parts | systems | texts),
    )


def _check(answer: StabilityCertificate) -> None:
    """Refuse fields that no certificate has, wherever it comes from."""
    for name, kind in _KINDS.items():
        part = getattr(answer, name)
        if not isinstance(part, kind):
            raise SetidError(f"{name}: found {type(part).__name__}, expected {kind.__name__}")
    for name, words in _WORDS.items():
        word(getattr(answer, name), name, words, SetidError)
    for k, arc in enumerate(entries_of(answer.arcs, "arcs", "a list of arcs", SetidError)):
        _arc(arc, f"arcs[{k}]")
    for name in _TEXTS:
        _texts(getattr(answer, name), name)
    _check_numbers(answer)


def _arc(found: Any, place: str) -> tuple[float, float, float]:
    """An arc of the upper half circle with its bound."""
    parts = entries_of(found, place, "(from, to, bound)", SetidError)
    ends = [number(value, f"{place}[{k}]", SetidError) for k, value in enumerate(parts)]
    if len(ends) != 3 or not 0.0 <= ends[0] < ends[1] <= pi:
        raise SetidError(f"{place}: found {found!r:.60}, expected (from, to, bound) in [0, pi]")
    return ends[0], ends[1], ends[2]


def _texts(found: Any, place: str) -> tuple[str, ...]:
    texts = entries_of(found, place, "a list of texts", SetidError)
    if isinstance(found, str) or not all(isinstance(text, str) for text in texts):
        raise SetidError(f"{place}: found {found!r:.60}, expected a list of texts")
    return tuple(texts)


def _condition(found: Any) -> Condition:
    name, holds, text = found
    if not isinstance(name, str) or not isinstance(text, str) or holds not in (True, False, None):
        raise SetidError(f"conditions: found {found!r:.60}, expected (name, true or false, text)")
    return Condition(name, None if holds is None else bool(holds), text)


def _check_numbers(answer: StabilityCertificate) -> None:
    """Refuse numbers and texts that no certificate has."""
    natural(answer.cells, "cells", SetidError)
    number(answer.seconds, "seconds", SetidError)
    if answer.margin is not None and not 0.0 < number(answer.margin, "margin", SetidError) < 1.0:
        raise SetidError(f"margin: found {answer.margin!r}, expected a number between 0 and 1")
    poles, most = natural(answer.integrators, "integrators", SetidError), answer.model.na[0][0]
    if poles > min(most, 1):
        raise SetidError(f"integrators: found {poles}, expected 0 or 1, at most the plant's order")
    if answer.method == "small_gain" or not isinstance(answer.bound, float):
        number(answer.bound, "bound", SetidError)
    for name in _SYSTEMS:
        system = getattr(answer, name)
        if system is not None and system.Ts != answer.data.Ts:
            raise SetidError(
                f"{name}.Ts: found {system.Ts:g}, expected {answer.data.Ts:g} as of data"
            )
    if not isinstance(answer.reason, str):
        raise SetidError(f"reason: found {answer.reason!r:.60}, expected a text")


def _read_system(found: Any) -> Transfer | None:
    if found is None:
        return None
    numerator, denominator = (
        [rational.read(c, "coefficients") for c in part] for part in found["coefficients"]
    )
    return Transfer(numerator, denominator, float(found["Ts"]))
