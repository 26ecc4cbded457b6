"""Parameters bounded by rows with an offset of the equation.

Where an offset c is added to an output, rows hold c times the denominators at q = 1. That product d
is the offset of the form "driven", whose other parameters are the same: what is proved of these
holds for both, and c lies in the quotient. No sample before the record is known there, so that the
rows hold for systems at rest as well.
"""

from __future__ import annotations

from typing import Any

from ..arithmetic import interval as iv
from ..result import NotProved
from .box import Ends, intervals, met, no_point, rationals
from .fewer_priors import check_given, outer_ends
from .parameter_box import at_one, letters_of

ORDERS = ("na", "nb", "nk", "common_denominator", "offset")


def bounded_by(inner: Any, about: Any, box: Ends) -> Ends:
    """Shrink a box by an identification whose offsets drive the equations."""
    check_structures(about, inner)
    inner.check()
    about.taken += inner.taken
    about.stable |= inner.stable
    one = about.structure
    offsets = [name for i in one.outputs for term in one.offset(i) for name in term.parameters]
    check_question(about, inner, offsets)
    if inner.empty:
        return no_point(len(about.names))
    known = intervals(outer_ends(inner))
    for i, name in enumerate(offsets):
        if one.adds_offset(i):  # another one is the same
            v = about.names.index(name)
            known[v] = iv.quotient(known[v], at_one(letters_of(about, i), known))
    return met(box, *rationals(known))


def check_structures(about: Any, inner: Any) -> None:
    """Check that one structure is the other with offsets that drive the equations."""
    one, two = about.structure, inner.structure
    if one is None or two is None or any(one.shown[k] != two.shown[k] for k in ORDERS):
        raise NotProved("driven: rows of another structure")
    if (two.shown["form"], two.zero) != ("driven", False) or not one.shown["offset"]:
        raise NotProved("driven: rows whose offset does not drive the equation")
    if not any(map(one.adds_offset, one.outputs)):
        raise NotProved("driven: rows about the same offset")
    if any(any(column) for column in about.record.bounds["equation"]):
        raise NotProved("driven: equation errors, which are not those of sums")


def check_question(about: Any, inner: Any, offsets: list[str]) -> None:
    """Check that nothing is given beside what is given of the other, and nothing of offsets."""
    check_given(about, inner, "driven", offsets)
    for kind, row in inner.asked:
        if any(name in offsets for word, _ in row for name in word):
            raise NotProved(f"driven: a row of kind {kind} that speaks of an offset")
