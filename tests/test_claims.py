"""What a result claims is what its own verification reaches, to the last digit."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.result import INTERRUPTED
from sparsepop_py.verified.certificate.certificate import Certificate

INF = np.inf


def far_corner(slope: float, height: float) -> tuple[sp.Problem, Fraction]:
    """min -x2 x3^2 over 13.5 + slope x1 >= height x2 in a box of 1e6, and its minimum."""
    x1, x2, x3 = sp.variables(3)
    row = 13.5 + slope * x1 - height * x2 >= 0
    least = -(Fraction(13.5) + Fraction(slope) * 10**6) / Fraction(height) * 10**12
    return sp.Problem(-1 * x2 * x3**2, [row], -1e6, 1e6), least


@pytest.mark.parametrize(("slope", "height"), [(3.75, 5.75), (4.5, 4.75), (2.25, 3.25)])
def test_a_cutoff_that_fell_on_the_way_costs_no_verdict(slope: float, height: float) -> None:
    """The box shrank under several cutoffs and is replayed with the last: other roundings."""
    problem, least = far_corner(slope, height)
    result = sp.solve(problem, sp.Options(effort="auto", node_limit=0))
    verdict = result.certificate.verify(problem)
    assert verdict.ok
    assert result.lower_bound == result.certificate.bound == verdict.bound
    assert Fraction(result.lower_bound) <= least
    assert float(least) - result.lower_bound <= 1e-12 * abs(float(least))
    assert all(entry.lower_bound <= result.lower_bound for entry in result.history)


def over_the_disc() -> tuple[sp.Problem, Certificate]:
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, [x**2 + y**2 <= 1])
    return problem, sp.solve(problem).certificate


@pytest.mark.parametrize("excess", [1e-15, 1e-6, 10.0, INF])
def test_a_claim_is_lowered_to_what_verification_reaches(excess: float) -> None:
    """The minimum is -1/2; whatever is claimed, what is settled holds and is nearly as good."""
    problem, certificate = over_the_disc()
    reached = certificate.verify(problem).bound
    bold = Certificate(
        certificate.fingerprint, reached + excess, certificate.root, certificate.cutoff
    )
    assert not bold.verify(problem).ok
    settled = bold.settled(problem)
    assert settled is not None and settled.verify(problem).ok
    assert reached - 1e-6 <= settled.bound <= reached <= -0.5
    assert certificate.settled(problem) is certificate


def test_a_lowered_claim_is_recomputed_once_within_one_verification(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A check without what is known computes all of it again."""
    problem, certificate = over_the_disc()
    bold = Certificate(certificate.fingerprint, 10.0, certificate.root, certificate.cutoff)
    counts, compute = list[int](), Certificate._recomputed

    def counted(*given: Any) -> tuple[float, float, str]:
        counts.append(1)
        return compute(*given)

    monkeypatch.setattr(Certificate, "_recomputed", counted)
    known: dict[Any, Any] = {}
    settled = bold.settled(problem, known)
    assert settled is not None
    assert settled.settled(problem, known) is settled
    assert len(counts) == 1
    known_bound = settled.verify(problem, known).bound
    assert len(counts) == 1
    found = settled.verify(problem)
    assert found.ok and found.bound == known_bound < 10.0
    assert len(counts) == 2


def test_a_claim_without_any_argument_is_dropped() -> None:
    x, y = sp.variables(2)
    problem = sp.Problem(x + y)
    assert Certificate(problem.fingerprint, 0.0).settled(problem) is None


def test_an_interrupt_of_the_last_check_keeps_the_result(monkeypatch: pytest.MonkeyPatch) -> None:
    recompute, calls = Certificate.recompute, []

    def interrupted(self, *arguments):
        calls.append(1)
        if len(calls) == 1:
            raise KeyboardInterrupt
        return recompute(self, *arguments)

    monkeypatch.setattr(Certificate, "recompute", interrupted)
    x, y = sp.variables(2)
    result = sp.solve(sp.Problem(x * y, [x**2 + y**2 <= 1]))
    assert -0.5 - 1e-6 <= result.lower_bound <= -0.5
    assert INTERRUPTED in result.notes


def test_gaps_that_are_shown_are_no_less_than_those_proved() -> None:
    x, y = sp.variables(2)
    for side in (1.0, 1.7, 2.9, 3.3, 4.7, 5.1):
        problem = sp.Problem(x * y - x**3, [x**2 + side * y**2 <= 3], -2, 2)
        result = sp.solve(problem, sp.Options(order=2))
        shown = dict(line.split()[:2] for line in result.summary().splitlines() if "  " in line)
        assert Fraction(shown["gap"]) >= Fraction(result.gap) > 0
        assert result.certificate is not None
        assert Fraction(shown["correction"]) >= Fraction(result.certificate.correction)
