"""Priors from outside are checked where they come in, and wrong ones are named."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import setid
import sparsepop_py as sp
from setid.priors.base import Plain
from setid.proofs.existence import admitted
from sparsepop_py.budget import LimitReached

DATA = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
MODEL = setid.TransferFunction(1, 1)
SLACK = {"unknowns": lambda self, model: {"s": (0.0, 1.0)}}


def plugged(**methods: Any) -> Any:
    """Make a prior with methods, or with constants for answers."""
    made = {n: m if callable(m) else (lambda *given, m=m: m) for n, m in methods.items()}
    return type("Own", (Plain,), made)()


def raising(error: Exception) -> Callable[..., Any]:
    def answer(*given: Any) -> Any:
        raise error

    return answer


@pytest.mark.parametrize(
    ("method", "answer", "message"),
    [
        ("describe", 3, "found int 3, expected a text"),
        ("bounds", None, "found NoneType None, expected a mapping"),
        ("bounds", {"a1": 3}, "found 3 for 'a1', expected a name and .low, high."),
        ("bounds", {"a1": (0, 1, 2)}, "found .0, 1, 2."),
        ("bounds", {"a1": ("0", "1")}, "found"),
        ("bounds", {"a1": (None, 1)}, "found"),
        ("bounds", {"a1": (1, 0)}, "found .1, 0."),
        ("bounds", {"a1": (np.inf, np.inf)}, "found .inf, inf."),
        ("bounds", {"a1": (np.nan, 1)}, "found .nan, 1."),
        ("bounds", {"a1": (-(2**53) - 1, 0)}, "found .-9007199254740993, 0."),  # no double
        ("stable", None, "found NoneType None, expected a set of tuples"),
        ("stable", {"a1"}, "found set"),
        ("stable", {("q",)}, "found set"),
        ("unknowns", None, "found NoneType None, expected a mapping"),
        ("unknowns", {"s": (1, 0)}, "found .1, 0."),
        ("rows", None, "found NoneType None, expected a list of constraints"),
        ("rows", [True], "found bool True, expected polynomial inequalities"),
        ("rows", [sp.variables(3)[0] >= 0], "found a constraint in 3 variables, expected the 2"),
        ("rows", raising(ZeroDivisionError("why")), "raised ZeroDivisionError: why"),
        ("rows", raising(sp.ProblemError("why")), "raised ProblemError: why"),
    ],
)
def test_wrong_answers_are_named(method: str, answer: Any, message: str) -> None:
    with pytest.raises(setid.PriorError, match=f"Own.{method}: {message}"):
        setid.formulate(DATA, MODEL, setid.Noise(output=0.1), plugged(**{method: answer}))


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (None, "found NoneType"),
        ({"s": np.nan}, "expected a mapping of names to finite doubles"),
        ({"s": "1"}, "expected a mapping of names to finite doubles"),
        ({"a1": 7.0}, "expected values of its own unknowns alone"),
    ],
)
def test_wrong_completions_are_named(answer: Any, message: str) -> None:
    prior = plugged(complete=answer, **SLACK)
    formulation = setid.formulate(DATA, MODEL, setid.Noise(output=0.1), prior)
    with pytest.raises(setid.PriorError, match=f"Own.complete: .*{message}"):
        formulation.point([0.0, 0.0])


def test_generators_and_arrays_are_read() -> None:
    given = plugged(
        bounds={"a1": np.array([-1.0, 2.0])},
        rows=lambda self, model, x, facts: (row for row in [x["a1"] >= 0.25]),
    )
    found = setid.formulate(DATA, MODEL, setid.Noise(output=0.1), [given])
    assert (found.problem.lower[0], found.problem.upper[0]) == (-1.0, 2.0)
    assert str(found.problem.constraints[-1]) == "-0.25 + a1 >= 0"


def test_a_generator_that_raises_is_named() -> None:
    given = plugged(rows=lambda self, model, x, facts: (x[name] >= 0 for name in ("a1", "q")))
    with pytest.raises(setid.PriorError, match="Own.rows: raised KeyError: 'q'"):
        setid.formulate(DATA, MODEL, setid.Noise(output=0.1), [given])


def test_the_end_of_the_time_passes() -> None:
    given = plugged(bounds=raising(LimitReached()))
    with pytest.raises(LimitReached):
        setid.formulate(DATA, MODEL, setid.Noise(output=0.1), [given])


def test_answers_of_admits_are_true_or_false() -> None:
    for answer in (True, False, np.True_):
        known = setid.formulate(DATA, MODEL, setid.Noise(output=0.1), plugged(admits=answer))
        assert admitted(known, [0.0, 0.0], 0.0) is bool(answer)
    known = setid.formulate(DATA, MODEL, setid.Noise(output=0.1), plugged(admits="no"))
    with pytest.raises(setid.PriorError, match="Own.admits: found str 'no', expected True"):
        admitted(known, [0.0, 0.0], 0.0)
