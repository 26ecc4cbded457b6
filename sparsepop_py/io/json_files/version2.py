"""Convert JSON of version 2 to version 3: field names and fingerprints."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from sparsepop_py.problem.problem import Problem, fingerprint_v1
from sparsepop_py.verified.certificate.steps import Replay

__all__ = ["refingerprint", "rename", "rename_skipped"]

# The class of a step, and the name of one of its fields in version 2 and now.
_FIELDS = {
    "Propagation": ("cutoff", "uses_cutoff"),
    "Tightening": ("cutoff", "uses_cutoff"),
    "Sublevel": ("level", "cutoff"),
}
_STEPS = {"narrow": "obbt_lp", "squeeze": "obbt_sdp"}


def rename(certificates: Any) -> None:
    """Give the fields of certificates of version 2 the names of version 3, in place.

    What is no such list stays as it is: its reader refuses it.

    Parameters
    ----------
    certificates : object
        As the JSON parser returned it.
    """
    for certificate in _objects(certificates):
        for part in _objects(certificate.get("parts")):
            _rename(part, "cut", "branch")
            for step in _objects(part.get("steps")):
                kind = step.get("is")
                if isinstance(kind, str) and kind in _FIELDS:
                    _rename(step, *_FIELDS[kind])


def rename_skipped(options: Any) -> None:
    """Give the steps that options leave out the names of version 3, in place.

    Parameters
    ----------
    options : object
        As the JSON parser returned it.
    """
    for one in _objects([options]):
        skip = one.get("skip")
        if isinstance(skip, list):
            one["skip"] = [_STEPS.get(s, s) if isinstance(s, str) else s for s in skip]


def refingerprint(certificates: Any, problem: Problem) -> None:
    """Replace the fingerprints of version 2 by today's, in place, quoted ones included.

    A fingerprint that does not fit its problem stays, so that the certificate proves nothing.

    Parameters
    ----------
    certificates : object
        As the JSON parser returned it: the last is about ``problem``, and each quotes others
        by variable, side and number.
    problem : Problem
    """
    replay = Replay(problem, None)
    found = list(_objects(certificates))
    abouts = {len(found) - 1: problem}
    for certificate in found:
        for part in _objects(certificate.get("parts")):
            for step in _objects(part.get("steps")):
                for variable, side, number in _quotes(step, problem.dimension):
                    if number not in abouts:
                        abouts[number] = replay.about(variable, side)
    for number, about in abouts.items():
        if 0 <= number < len(found):
            one = found[number]
            if one.get("fingerprint") == fingerprint_v1(about):
                one["fingerprint"] = about.fingerprint


def _objects(found: Any) -> Iterator[dict[str, Any]]:
    return (
        (item for item in found if isinstance(item, dict)) if isinstance(found, list) else iter(())
    )


def _rename(found: dict[str, Any], old: str, new: str) -> None:
    if old in found and new not in found:
        found[new] = found.pop(old)


def _quotes(step: dict[str, Any], dimension: int) -> Iterator[tuple[int, int, int]]:
    """Variable, side and number of what a step quotes, as far as they make sense."""
    bounds = step.get("bounds") if step.get("is") == "Known" else None
    for row in bounds if isinstance(bounds, list) else []:
        if isinstance(row, list) and len(row) == 3 and all(type(k) is int for k in row):
            if 0 <= row[0] < dimension and row[1] in (1, -1):
                yield row[0], row[1], row[2]
