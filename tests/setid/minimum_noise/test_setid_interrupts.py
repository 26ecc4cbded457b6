"""An interrupt of a search over denominators keeps what was refuted before."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Literal

import numpy as np
import pytest
from slow_values import slow_after, slow_unless

import setid
import sparsepop_py as sp
from setid.minimum_noise import denominators as all_norms
from setid.minimum_noise.cones import search as varying
from setid.minimum_noise.programs import Programs
from setid.proofs.least_noise.least_error import error_rows, stated
from sparsepop_py.budget import Deadline, LimitReached

MODEL = setid.TransferFunction(2, 2, 1)
TOL = 1e-3


def record() -> setid.IOData:
    source = np.random.default_rng(4)
    u = source.uniform(-1.0, 1.0, 60)
    clean = setid.simulate(MODEL, (-1.2, 0.5, 1.0, 0.3), u).ravel()
    return setid.IOData(u, clean + source.uniform(-0.2, 0.2, 60))


def interrupted(
    work: Callable[..., Any], at: int, cause: type[BaseException] = KeyboardInterrupt
) -> Callable[..., Any]:
    """The same work, which the user interrupts, or a limit ends, at a call and all later ones."""
    calls = iter(range(at))

    def counted(*given: Any, **named: Any) -> Any:
        if next(calls, None) is None:
            raise cause
        return work(*given, **named)

    return counted


@pytest.mark.parametrize(
    ("norm", "early", "late"),
    slow_unless(lambda norm, *_: norm != "l1", [("l1", 80, 160), ("l2", 15, 25), ("linf", 40, 80)]),
)
def test_cones_that_were_refuted_are_kept(
    norm: Literal["l1", "l2", "linf"], early: int, late: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More is refuted the later the interrupt is, and never more than without one."""
    formulation = stated(record(), MODEL, (setid.Stable(),), 1.0)
    rows = error_rows(formulation, norm, 1.0)
    assert rows is not None
    search = partial(all_norms.least_output_noise, rows, 0, TOL)
    most, factors = search(Deadline(60.0)).factor, []
    for calls in (early, late):
        with monkeypatch.context() as patch:
            patch.setattr(Programs, "solve", interrupted(Programs.solve, calls))
            deadline = Deadline(60.0)
            found = search(deadline)
        assert deadline.stopped
        factors.append(found.factor)
    assert 0.0 < factors[0] <= factors[1] <= most


@pytest.mark.parametrize("cause", slow_after(1, [LimitReached, KeyboardInterrupt]))
def test_cones_whose_multipliers_vary_are_kept(
    cause: type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A limit may be that of work around the search, whose own deadline is not over then."""
    for name in ("_FIRST", "_MOST"):  # multipliers that vary come at once
        monkeypatch.setattr(all_norms, name, 1e-9)
    rows = error_rows(stated(record(), MODEL, (setid.Stable(),), 1.0), "linf", 1.0)
    assert rows is not None
    search = partial(all_norms.least_output_noise, rows, 0, TOL)
    factors = []
    for calls in (5, 10):
        with monkeypatch.context() as patch:
            patch.setattr(varying, "examined", interrupted(varying.examined, calls, cause))
            deadline = Deadline(60.0)
            factors.append(search(deadline).factor)
        assert deadline.stopped == (cause is KeyboardInterrupt)
    assert 0.0 < factors[0] < factors[1]


@pytest.mark.parametrize(("limit", "least", "most"), [(4.0, 0.5, 1), (20.0, 1, 5), (200.0, 4, 50)])
def test_multipliers_that_do_not_vary_have_two_cpu_seconds(
    limit: float, least: float, most: float
) -> None:
    """Of at most a quarter of the time, and more where a CPU second lasts longer.

    A share alone would be .12, .6 and 6 seconds. Without a limit work is counted.
    """
    left = all_norms._alone(Deadline(limit)).left
    assert left is not None and least < left <= most
    assert all_norms._alone(Deadline()).counts_work


def test_a_fit_ends_with_its_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """It does not go on to the engine, and its bound is proved."""
    data = record()
    monkeypatch.setattr(Programs, "solve", interrupted(Programs.solve, 160))
    monkeypatch.setattr("setid.analysis.output_fit._by_engine", lambda *_: pytest.fail("went on"))
    fit = setid.fit(data, MODEL, norm="l1", priors=[setid.Stable()])
    monkeypatch.undo()
    assert 0.0 < fit.lower_bound < fit.error
    assert fit.verify(data)


@pytest.mark.parametrize(
    "work", ["fit_of_denominator", "proved_point", "find_box", "verify_output", "_by_less"]
)
def test_a_fit_that_is_interrupted_anywhere_keeps_what_is_proved(
    work: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only the local fit, which is the first thing, is needed for a result."""
    data = record().part(0, 20)
    stopped = interrupted(len, 0)
    monkeypatch.setattr(f"setid.analysis.output_fit.{work}", stopped)
    fit = setid.fit(data, MODEL, norm="linf", priors=[setid.Stable()])
    monkeypatch.undo()
    assert 0.0 < fit.lower_bound <= fit.error < 1.0
    assert fit.attained == (work in ("fit_of_denominator", "find_box", "_by_less"))
    assert fit.verify(data)


def test_an_interrupt_of_the_engine_ends_a_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """A prior leaves nothing within the error of the local fit; within more it attains a point."""

    def solved(problem: sp.Problem, options: sp.Options, start: Any) -> sp.Result:
        solves.append(problem)
        ends = None if len(solves) == 1 else interrupted(len, 0)
        return solve(problem, options, start=start, on_progress=ends)

    solve, solves = sp.solve, list[sp.Problem]()
    monkeypatch.setattr(sp, "solve", solved)
    priors = [setid.Stable(), setid.Box({"b1": (1.2, 1.5)})]
    fit = setid.fit(record().part(0, 30), MODEL, norm="linf", priors=priors)
    assert len(solves) == 2 and fit.verify()


@pytest.mark.parametrize("cause", [KeyboardInterrupt, LimitReached])
def test_an_exact_program_that_ends_early_leaves_the_factor_open(
    cause: type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is proved then, and that is said in the same kind of result."""
    monkeypatch.setattr("sparsepop_py.linear_bounds", interrupted(len, 0, cause))
    found = setid.consistency(record(), MODEL, setid.Noise(equation=0.1))
    assert found.scale == (0.0, np.inf) and found.explains is None and found.theta is None
    monkeypatch.undo()
    assert found.verify()
    assert "open" in found.summary()


def test_an_exact_program_keeps_the_limit() -> None:
    options = setid.Options(time_limit=1e-9)
    found = setid.consistency(record(), MODEL, setid.Noise(equation=0.1), options=options)
    assert found.scale == (0.0, np.inf)


@pytest.mark.parametrize("norm", ["l1", "l2"])
def test_first_cones_end_with_the_time_and_with_interrupts(
    norm: Literal["l1", "l2"], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Order 6 without a prior has 64 first cones: the second is not begun when time is over."""
    formulation = stated(record(), setid.TransferFunction(6, 1, 1), (), 1.0)
    rows = error_rows(formulation, norm, 1.0)
    assert rows is not None
    calls, solve = [0], Programs.solve

    def counted(*given: Any) -> Any:
        calls[0] += 1
        return solve(*given)

    monkeypatch.setattr(Programs, "solve", counted)
    assert all_norms.least_output_noise(rows, 0, TOL, Deadline(0.0)).cells is None
    assert 0 < calls[0] < 20
    monkeypatch.setattr(Programs, "solve", interrupted(solve, 3))
    deadline = Deadline(60.0)
    assert all_norms.least_output_noise(rows, 0, TOL, deadline).factor == 0.0
    assert deadline.stopped
