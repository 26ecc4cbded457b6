"""What the files claim, and whether it is proved."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from .certificate import Certificates
from .point import ProvedPoint, falls_without_limit
from .polynomial import INF
from .reading import Malformed, Problem, fields, finite, item, problem

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
    certificates = Certificates(found, given)
    return [proved_bound(certificates, certificates.claim)]


def check_result(found: Any, given: Problem | None = None) -> list[str]:
    """The claims of a result; of its own problem, or of one that is given."""
    kinds = {"lower_bound": "F", "upper_bound": "F", "status": "t"}
    got = fields(found, "result", 0, **kinds)
    about = problem(item(found, "problem", "result"), "result.problem")
    about = about if given is None else given
    if got.status not in STATUSES:
        raise Malformed(f"result.status: {got.status!r:.20} is not one of {', '.join(STATUSES)}")
    return _lower(found, got, about) + _upper(found, got, about)


def _lower(found: Any, got: Any, about: Problem) -> list[str]:
    """What is proved of the lower bound, and of the status that no point is feasible."""
    if got.status == "INFEASIBLE" and got.lower_bound != INF:
        raise NotProved("the status says that no point is feasible, the bound does not")
    given = item(found, "certificate", "result")
    if given is None and got.lower_bound != -INF:
        raise NotProved(f"objective >= {shown(got.lower_bound)}: there is no certificate")
    if given is None:
        return []
    return [proved_bound(Certificates(given, about, "result.certificate"), got.lower_bound)]


def _upper(found: Any, got: Any, about: Problem) -> list[str]:
    """What is proved of the upper bound, and of the status that there is no lower one."""
    endless = got.status == "UNBOUNDED" or got.upper_bound == -INF
    point = item(found, "attained", "result")
    if point is None:
        if got.upper_bound != INF or endless:
            raise NotProved(f"objective <= {shown(got.upper_bound)} is attained: there is no point")
        return []
    attained = ProvedPoint(point, about, "result.attained")
    if endless:
        ray = [Fraction(finite(v, "result.ray")) for v in found.get("ray") or ()]
        if not falls_without_limit(about, attained, ray or None):
            raise NotProved("the objective is unbounded: no feasible ray is known to prove it")
        return ["proved: the objective falls without limit along a feasible ray"]
    reason = attained.fails()
    if not reason and attained.value > got.upper_bound:
        reason = "the point attains more"
    if reason:
        raise NotProved(f"objective <= {shown(got.upper_bound)} is attained: {reason}")
    return [f"proved: objective <= {shown(got.upper_bound)} is attained"]
