"""What the files claim, and whether it is proved."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from . import interval as iv
from .certificate import Certificates
from .point import ProvedPoint, falls_without_limit
from .polynomial import INF
from .reading import Malformed, Problem, finite, item, items, number, optional, problem, text

STATUSES = ("OPTIMAL", "BOUNDED", "UNPROVED", "INFEASIBLE", "UNBOUNDED", "LIMIT", "FAILED")


class NotProved(Exception):
    """A claim that does not follow from the argument given for it."""


def shown(value: Any) -> str:
    """A number for people; a claim is a double and is shown with all its digits."""
    if value in (INF, -INF):
        return "inf" if value > 0 else "-inf"
    try:
        return repr(float(value))
    except OverflowError:
        return "a number beyond all doubles"


def fingerprint(given: Problem) -> str | None:
    """The name of a problem that certificates carry.

    Nothing rests on it here: every claim is proved for the problem at hand. This function is the
    place to compute "v2:" and the SHA-256 of the problem's bytes, and to compare.
    """
    return None


def prepare(given: Problem) -> Problem:
    """The problem, with the precision of intervals set so that its numbers are exact."""
    iv.set_precision(1152)
    return given


def proved_bound(certificates: Certificates, claim: Any) -> str:
    """The sentence about a lower bound; raises where it is not proved."""
    bound, why = certificates.prove()
    if bound < claim:
        weak = "" if bound == -INF else f", only {shown(bound)} is proved"
        wanted = "no feasible point" if claim == INF else f"objective >= {shown(claim)}"
        raise NotProved(f"{wanted}: not proved{weak} ({'; '.join(dict.fromkeys(why))})")
    if claim == INF:
        return "proved: no feasible point"
    return f"proved: objective >= {shown(claim)}"


def check_certificate(given: Problem, found: Any) -> list[str]:
    """The claims of a certificate of a problem."""
    certificates = Certificates(found, prepare(given))
    return [proved_bound(certificates, certificates.claim)]


def check_result(found: Any, given: Problem | None = None) -> list[str]:
    """The claims of a result; of its own problem, or of one that is given."""
    about = prepare(problem(item(found, "problem", "result"), "result.problem"))
    about = about if given is None else prepare(given)
    lines = []
    lower = number(item(found, "lower_bound", "result"), "result.lower_bound")
    upper = number(item(found, "upper_bound", "result"), "result.upper_bound")
    status = text(item(found, "status", "result"), "result.status")
    if status not in STATUSES:
        raise Malformed(f"result.status: {status!r:.20} is not one of {', '.join(STATUSES)}")
    given_list = item(found, "certificate", "result")
    if given_list is not None:
        certificates = Certificates(given_list, about, "result.certificate")
        lines.append(proved_bound(certificates, lower))
    elif lower != -INF:
        raise NotProved(f"objective >= {shown(lower)}: there is no certificate")
    if status == "INFEASIBLE" and lower != INF:
        raise NotProved("the status says that no point is feasible, the bound does not")
    point = item(found, "attained", "result")
    if point is None:
        if upper != INF or status == "UNBOUNDED":
            raise NotProved(f"objective <= {shown(upper)} is attained: there is no point")
        return lines
    attained = ProvedPoint(point, about, "result.attained")
    if status == "UNBOUNDED" or upper == -INF:
        ray = optional(found.get("ray"), _ray, "result.ray")
        if not falls_without_limit(about, attained, ray):
            raise NotProved("the objective is unbounded: no feasible ray is known to prove it")
        return [*lines, "proved: the objective falls without limit along a feasible ray"]
    reason = attained.fails()
    if reason:
        raise NotProved(f"objective <= {shown(attained.value)} is attained: {reason}")
    if attained.value > upper:
        raise NotProved(f"objective <= {shown(upper)} is attained: the point attains more")
    return [*lines, f"proved: objective <= {shown(upper)} is attained"]


def _ray(found: Any, place: str) -> list[Fraction]:
    return [Fraction(finite(value, place)) for value in items(found, place)]
