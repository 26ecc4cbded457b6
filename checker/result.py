"""What the files claim, and whether it is proved."""

from __future__ import annotations

from fractions import Fraction
from hashlib import sha256
from struct import pack
from typing import Any

from .certificate import Certificates
from .point import ProvedPoint, falls_without_limit
from .polynomial import INF
from .reading import Malformed, Problem, fields, finite, item, problem

STATUSES = (
    "OPTIMAL",
    "BOUNDED",
    "UNPROVED",
    "INFEASIBLE",
    "UNBOUNDED",
    "LIMIT",
    "FAILED",
    "INTERRUPTED",
)


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


def fingerprint(found: Any) -> str:
    """The name that certificates of version 3 give a problem, from its JSON.

    Nothing rests on it: every claim is proved for the problem at hand. It tells files that were
    mixed up.
    """
    rows, squares = found["constraints"], found["squares"]
    polynomials = [found["objective"]]
    for row in rows:
        polynomials += [row["polynomial"], *row["entries"]]
    polynomials += [polynomial for _, polynomial in squares]
    bounds = [[float(v) + 0.0 for v in found[name]["data"]] for name in ("lower", "upper")]
    parts = [
        b"sparsepop-py problem 2",
        packed("q", [found["objective"]["dimension"], len(rows), len(squares)]),
        ",".join(row["kind"] for row in rows).encode(),
        packed("q", [len(row["entries"]) for row in rows]),
        packed("q", [length for p in polynomials for length in p["words"]["shape"]]),
        packed("i", [letter for p in polynomials for letter in p["words"]["data"]]),
        packed("d", [value for p in polynomials for value in p["coefficients"]["data"]]),
        *(packed("d", side) for side in bounds),
        packed("d", [weight + 0.0 for weight, _ in squares]),
    ]
    whole = b"".join(len(part).to_bytes(8, "little") + part for part in parts)
    return "v2:" + sha256(whole).hexdigest()


def packed(kind: str, values: list[Any]) -> bytes:
    """Numbers one after another: 8 bytes (q), 4 bytes (i) or doubles (d), the low byte first."""
    return pack(f"<{len(values)}{kind}", *values)


def remarks(found: Any, certificates: Any) -> list[str]:
    """What the name of a problem says of a certificate."""
    name = certificates[-1]["fingerprint"]
    if not name.startswith("v2:") or name == fingerprint(found):
        return []
    return ["remark: by its fingerprint the certificate was made for another problem"]


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
