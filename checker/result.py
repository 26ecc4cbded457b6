"""Results of solves: the claims of their files, and whether they are proved."""

from __future__ import annotations

from fractions import Fraction
from hashlib import sha256
from struct import pack
from typing import Any

from .arithmetic.polynomial import INF
from .certificates.certificate import Certificates
from .certificates.point import ProvedPoint, falls_without_limit
from .files.reading import Malformed, Problem, fields, finite, item, items, problem

STATUSES = "OPTIMAL BOUNDED UNPROVED INFEASIBLE UNBOUNDED LIMIT FAILED INTERRUPTED".split()


class NotProved(Exception):
    """A claim that does not follow from the argument given for it."""


def shown(value: Any) -> str:
    """Write a number for people; a claim, a double, keeps all its digits."""
    if value in (INF, -INF):
        return "inf" if value > 0 else "-inf"
    try:
        return repr(float(value))
    except OverflowError:
        return "a number beyond all doubles"


def fingerprint(found: Any) -> str:
    """Compute the name that certificates of version 3 give a problem, from its JSON.

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
    """Pack numbers: 8 bytes (q), 4 bytes (i) or doubles (d), low byte first."""
    return pack(f"<{len(values)}{kind}", *values)


def remarks(found: Any, certificates: Any) -> list[str]:
    """Tell what the name of a problem says of a certificate."""
    name = certificates[-1]["fingerprint"]
    if name == fingerprint(found):
        return []
    return ["remark: by its fingerprint the certificate was made for another problem"]


def proved_bound(proof: Any, claim: Any) -> str:
    """Write the lower bound's sentence; raise where it, or the stated one, is unproved."""
    bound, why = proof.prove()
    most = max(claim, proof.claim)
    if bound < most:
        weak = "" if bound == -INF else f", only {shown(bound)} is proved"
        wanted = "no feasible point" if most == INF else f"objective >= {shown(most)}"
        raise NotProved(f"{wanted}: not proved{weak} ({'; '.join(dict.fromkeys(why))})")
    if claim == INF:
        return "proved: no feasible point"
    return f"proved: objective >= {shown(claim)}"


def check_certificate(given: Problem, found: Any) -> list[str]:
    """Check the claims of a certificate of a problem."""
    certificates = Certificates(found, given)
    return [proved_bound(certificates, certificates.claim)]


def check_result(found: Any, given: Problem | None = None) -> list[str]:
    """Check the claims of a result, of its own or a given problem."""
    about = problem(item(found, "problem", "result"), "result.problem")
    about = about if given is None else given
    proof = item(found, "certificate", "result")
    proof = None if proof is None else Certificates(proof, about, "result.certificate")
    return check_claims(found, "result", proof, about)


def direction(found: Any, about: Problem | None, place: str) -> list[Fraction]:
    """Read a ray: as many finite doubles as there are variables."""
    ray = [Fraction(finite(value, place)) for value in items(found, place)]
    if about is not None and len(ray) != about.dimension:
        raise Malformed(f"{place}: {len(ray)} numbers for {about.dimension} variables")
    return ray


def check_claims(
    found: Any, place: str, proof: Any, about: Problem | None, value_of: Any = None
) -> list[str]:
    """Check the bounds and status of a result by its proof and a point.

    ``value_of`` says what a value of the problem's objective means for that of the result.
    """
    got = fields(found, place, 0, lower_bound="F", upper_bound="F", status="t")
    lowest, claim = got.lower_bound, got.upper_bound
    if got.status not in STATUSES:
        raise Malformed(f"{place}.status: {got.status!r:.20} is not one of {', '.join(STATUSES)}")
    if got.status == "INFEASIBLE" and lowest != INF:
        raise NotProved("the status says that no point is feasible, the bound does not")
    if proof is None and lowest != -INF:
        raise NotProved(f"objective >= {shown(lowest)}: there is no certificate")
    ray = None if found.get("ray") is None else direction(found["ray"], about, f"{place}.ray")
    lines = [] if proof is None else [proved_bound(proof, lowest)]
    lines = [] if lowest == -INF else lines
    endless, point = got.status == "UNBOUNDED" or claim == -INF, item(found, "attained", place)
    if point is None or about is None:
        if claim != INF or endless:
            raise NotProved(f"objective <= {shown(claim)} is attained: there is no point")
        return lines
    attained = ProvedPoint(point, about, f"{place}.attained")
    if endless:
        if value_of is not None or not falls_without_limit(about, attained, ray):
            raise NotProved("the objective is unbounded: no feasible ray is known to prove it")
        return [*lines, "proved: the objective falls without limit along a feasible ray"]
    reason, value = attained.fails(), attained.value
    if not reason and (value if value_of is None else value_of(value)) > claim:
        reason = "the point attains more"
    if reason:
        raise NotProved(f"objective <= {shown(claim)} is attained: {reason}")
    return [*lines, f"proved: objective <= {shown(claim)} is attained"]
