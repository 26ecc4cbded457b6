"""Results that make their journey through JSON together prove what each proves alone."""

from __future__ import annotations

from dataclasses import replace

import pytest
from journeys import Batch, through_json

import sparsepop_py as sp
from sparsepop_py.errors import SparsePOPError

PROBLEM = sp.parse("min x1*x2; s.t. 1 - x1^2 - x2^2 >= 0; x1 - x2^2 >= 0; x1 + x2 >= -1/2")


def results() -> list[sp.Result]:
    """Both ends of both variables; those that come later quote those before."""
    ends = [sign * x for x in sp.variables(2) for sign in (1.0, -1.0)]
    return sp.solve_each(PROBLEM, ends, sp.Options(effort="presolve"))


def test_equal_parts_are_read_once_and_bounds_stay() -> None:
    batch, found = Batch(), results()
    again = [through_json(result, batch) for result in found]
    alone = [through_json(result, None) for result in found]
    assert [r.lower_bound for r in again] == [r.lower_bound for r in alone]
    first = [result.certificate.box.steps[0] for result in again]
    assert all(step is first[0] for step in first)
    assert len({id(result.certificate.box.steps[0]) for result in alone}) == len(alone)


def test_what_is_not_proved_is_refused_beside_what_is() -> None:
    """The certificate of a bound too high is another text, whatever was proved before."""
    batch, found = Batch(), results()
    for result in found:
        through_json(result, batch)
    bound = found[-1].lower_bound + 0.1
    forged = replace(
        found[-1],
        lower_bound=bound,
        certificate=replace(found[-1].certificate, bound=bound),
    )
    for shared in (batch, None):
        with pytest.raises((AssertionError, SparsePOPError)):
            through_json(forged, shared)
