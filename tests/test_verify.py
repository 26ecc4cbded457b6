"""Claims of results, computed again: what is stated falsely is refused by name."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import sparsepop_py as sp

x, y = sp.variables(2)
DISC = sp.Problem(x + y, [x**2 + y**2 <= 1])
RATIO = sp.RationalProblem(1 / (1 + x**2) + y, [], lower=-1, upper=1)
EMPTY = sp.Problem(x, [x + y >= 3], lower=0, upper=1)
FALLING = sp.Problem(x, [x <= y], lower=[-np.inf, 0], upper=[np.inf, 1])


@pytest.fixture(scope="module", params=[DISC, RATIO, EMPTY, FALLING], ids=str)
def result(request: pytest.FixtureRequest) -> Any:
    return sp.solve(request.param)


def test_what_is_returned_verifies(result: Any) -> None:
    again = result.verify()
    assert again.ok and not again.reason
    assert again.bound >= result.lower_bound
    assert result.verify(result.problem).ok


def test_results_of_other_problems_are_refused(result: Any) -> None:
    own = type(result.problem)
    other = own(x - y, [], lower=0, upper=1)
    assert result.verify(other) == (False, -np.inf, "the result belongs to another problem")
    for wrong in ("x - y", 3, result):
        said = f"found {type(wrong).__name__}, expected a {own.__name__}"
        assert result.verify(wrong) == (False, -np.inf, said)


@pytest.mark.parametrize(
    ("claim", "named"),
    [
        ({"lower_bound": -1.0}, "result.lower_bound"),
        ({"upper_bound": -1.5}, "result.upper_bound"),
        ({"status": sp.Status.INFEASIBLE}, "result.status"),
        ({"status": sp.Status.UNBOUNDED}, "result.status"),
        ({"certificate": None}, "result.lower_bound"),
        ({"attained": None}, "result.upper_bound"),
    ],
)
def test_false_claims_are_named(claim: dict[str, Any], named: str) -> None:
    """The minimum is -sqrt(2)."""
    verdict = replace(sp.solve(DISC), **claim).verify()
    assert not verdict.ok and verdict.reason.startswith(named)


def test_optimal_needs_a_bound_and_a_point() -> None:
    found = sp.solve(DISC)
    for missing in (
        {"certificate": None, "lower_bound": -np.inf},
        {"attained": None, "upper_bound": np.inf},
    ):
        assert replace(found, **missing).verify().reason.startswith("result.status")
        assert replace(found, **missing, status=sp.Status.BOUNDED).verify().ok


def test_points_and_certificates_are_computed_again() -> None:
    found = sp.solve(DISC)
    assert found.attained is not None and found.certificate is not None
    outside = replace(found.attained, x=np.array([-1.0, -1.0]), value=-2.0)
    assert "upper_bound" in replace(found, attained=outside, upper_bound=-2.0).verify().reason
    better = replace(found.certificate, bound=-1.0)
    verdict = replace(found, certificate=better, lower_bound=-1.0).verify()
    assert verdict.reason.startswith("result.certificate")


@pytest.mark.parametrize("problem", [DISC, RATIO])
def test_the_point_is_the_attained_one(problem: sp.Problem | sp.RationalProblem) -> None:
    found = sp.solve(problem)
    assert found.x is not None
    for other in (found.x + 1.0, found.x[:1], None):
        assert replace(found, x=other).verify().reason.startswith("result.x: found ")
    with pytest.raises(sp.ProblemError, match=r"result\.x: found"):
        sp.from_json(sp.to_json(replace(found, x=found.x + 1.0)))


def test_false_claims_about_ratios_are_named() -> None:
    """The minimum is -1/2, at x = 1 or -1 and y = -1."""
    found = sp.solve(RATIO)
    assert abs(found.lower_bound + 0.5) < 1e-5
    for claim, named in (
        ({"lower_bound": -0.25}, "result.lower_bound"),
        ({"upper_bound": -0.75}, "result.upper_bound"),
        ({"status": sp.Status.UNBOUNDED}, "result.status"),
    ):
        assert replace(found, **claim).verify().reason.startswith(named)


@pytest.mark.parametrize("least", [1e-13, 0.3, 1e6])
def test_attained_values_are_compared_to_the_last_digit(least: float) -> None:
    """No point of x >= least has an objective below least."""
    (only,) = sp.variables(1)
    found = sp.solve(sp.Problem(only, lower=least, upper=2 * least))
    for lower in (0.0, np.nextafter(least, 0.0)):
        verdict = replace(found, lower_bound=-1.0, upper_bound=lower).verify()
        assert verdict.reason.startswith("result.upper_bound")
    assert found.verify().ok


def test_rounding_of_another_machine_raises_the_stored_value() -> None:
    """Readers take what is attained here; what no rounding explains stays refused."""
    (only,) = sp.variables(1)
    found = sp.solve(sp.Problem(only, lower=0.3, upper=1))
    stored = replace(found, lower_bound=-1.0, upper_bound=np.nextafter(0.3, 0.0))
    assert not stored.verify().ok
    again = sp.from_json(sp.to_json(stored))
    assert again.verify().ok and again.upper_bound == found.upper_bound >= 0.3
    with pytest.raises(sp.SparsePOPError, match="upper_bound"):
        sp.from_json(sp.to_json(replace(stored, upper_bound=0.3 - 1e-9)))
