"""What is proved stays proved, wherever a limit or the user ends the work."""

from __future__ import annotations

import itertools
import sys
from typing import Any

import numpy as np
import pytest
from slow_values import slow_unless

import sparsepop_py as sp
from sparsepop_py import budget
from sparsepop_py.budget import LimitReached
from sparsepop_py.pipeline import final_result

X, Y, Z = sp.variables(3)
MOTZKIN = X**4 * Y**2 + X**2 * Y**4 - 3 * X**2 * Y**2 + 1
PROBLEMS = {
    "box": sp.Problem(X * Y * Z - X**2 + Y * Z**2, [X + Y <= 1, X**2 + Z**2 >= 0.5], -1, 1),
    "disc": sp.Problem(X**4 - 3 * X * Y + Y**2 - Z, [X**2 + Y**2 + Z**2 <= 2]),
    "free": sp.Problem(X**4 + Y**4 + Z**4 - 3 * X * Y * Z - X),
    "squares with a row": sp.Problem(X**4 + Y**4 - X * Y + Z**2, [X + Y >= 0.5]),
    "half-space": sp.Problem(MOTZKIN + Z**4 - Z, [Z >= 0]),
    "convex": sp.Problem(X**2 + Y**2 - X * Y + Z**2 - Z, [X + Y + Z >= 1]),
}
OPTIONS = {
    "presolve": sp.Options(effort="presolve"),
    "auto": sp.Options(effort="auto", gap=1e-9),
    "relaxations": sp.Options(effort="auto", gap=1e-9, skip=["linear_tree"]),
    "plain": sp.Options(effort="plain", order=3),
}


LONG = {("half-space", "auto"), ("half-space", "relaxations"), ("free", "relaxations")}
CASES = [pair for pair in itertools.product(PROBLEMS, OPTIONS) if pair not in LONG]
ROWS = {"half-space", "squares with a row"}


def quick(name: str, effort: str, cause: type[BaseException]) -> bool:
    """Whether a case takes well under a second, or is the only one of its kind."""
    return (name, effort) != ("free", "auto") and (cause is LimitReached or name not in ROWS)


class Ends:
    """Count looks at the clock; the one with a number raises."""

    def __init__(self, last: float, cause: type[BaseException]) -> None:
        self.looks, self.last, self.cause, self.over = 0, last, cause, False

    def __call__(self) -> None:
        self.looks += not self.over
        if self.looks == self.last and not self.over:
            raise self.cause


def solved(
    problem: sp.Problem, options: sp.Options, ends: Ends, patch: pytest.MonkeyPatch
) -> tuple[sp.Result, float]:
    """The result, and the largest bound that was reported before the end."""
    own, reported = budget.check, [-np.inf]
    for name, module in list(sys.modules.items()):
        if name.startswith("sparsepop_py") and getattr(module, "check", None) is own:
            patch.setattr(module, "check", ends)

    make = final_result._made

    def made(*given: Any) -> sp.Result:
        ends.over = True  # what follows are the checks of all tests
        return make(*given)

    patch.setattr(final_result, "_made", made)

    def report(number: int, lower: float, upper: float) -> None:
        if ends.looks < ends.last and not ends.over:
            reported.append(lower)

    result = sp.solve(problem, options, on_progress=report)
    patch.undo()
    return result, max(reported)


@pytest.mark.parametrize(
    ("name", "effort", "cause"),
    slow_unless(
        quick, [(*case, cause) for case in CASES for cause in (LimitReached, KeyboardInterrupt)]
    ),
)
def test_reported_bounds_are_returned(
    name: str, effort: str, cause: type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, options = PROBLEMS[name], OPTIONS[effort]
    looks = Ends(np.inf, cause)
    whole, _ = solved(problem, options, looks, monkeypatch)
    for last in np.unique(np.geomspace(1, max(looks.looks, 1), 6).astype(int)).tolist():
        result, reported = solved(problem, options, Ends(last, cause), monkeypatch)
        assert result.lower_bound >= reported - 1e-12 * abs(reported)
        assert result.lower_bound <= whole.upper_bound
        assert result.certificate is None or result.certificate.verify(problem).ok
