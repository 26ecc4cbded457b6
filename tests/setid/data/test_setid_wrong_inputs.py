"""Arguments of the wrong kind raise an exception of the package that names them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import setid
import sparsepop_py as sp

DATA = setid.IOData([1.0, 2.0, -1.0, 0.5], [0.0, 0.9, 1.7, -0.6])
MODEL = setid.TransferFunction(1, 1)
NOISE = setid.Noise(output=0.5)
NOISE_OF_EQUATIONS = setid.Noise(equation=0.5)


def select(**settings: Any) -> Any:
    return setid.select(DATA, setid.TransferFunction, NOISE, [1], **settings)


def advice() -> setid.Advice:
    u = np.append(np.zeros(20), np.ones(180))
    y = setid.simulate(setid.TransferFunction(1, 1, 1), [-0.9, 0.1], u)
    return setid.advise(setid.IOData(u, y))


def result() -> setid.Identification:
    data = setid.IOData([4.0, -3.0, 2.0, 1.0], [0.0, -6.25, 1.175, 2.0875])  # a published one
    return setid.identify(data, MODEL, NOISE_OF_EQUATIONS)


WRONG: dict[str, tuple[Callable[[], Any], str]] = {
    "one record": (lambda: setid.IOData.concat(DATA), "records: found IOData"),
    "text": (lambda: setid.IOData(["1", "2"], ["3", "4"]), "u: found list"),
    "text among objects": (
        lambda: setid.IOData(np.array(["1", "2"], object), [3, 4]),
        "u: found ndarray",
    ),
    "dates among objects": (
        lambda: setid.IOData(np.array([np.datetime64("1971"), 2], object), [3, 4]),
        "u: found ndarray",
    ),
    "dates": (
        lambda: setid.IOData([3, 4], np.array(["2026-03-01", "2026-03-02"], "M8[D]")),
        "y: found ndarray",
    ),
    "a word": (lambda: setid.TransferFunction(1, 1, offset="no"), "offset: found 'no'"),
    "a number": (
        lambda: setid.TransferFunction(1, 1, common_denominator=3),
        "common_denominator: found 3",
    ),
    "a truth value": (lambda: setid.Noise(output=True), "output: found True"),
    "a huge bound": (lambda: setid.Noise(output=10**400), "output: found int 1000"),
    "a huge sample": (lambda: setid.IOData([1, 10**400], [0, 1]), "u: found list"),
    "a huge end": (
        lambda: setid.Box({"a1": (0, 10**400)}),
        "a1: high: found a number beyond all doubles",
    ),
    "an order beyond any record": (
        lambda: setid.TransferFunction(10**6, 1),
        "na: found a number above 100000, expected at most that",
    ),
    "no list of sets": (lambda: setid.Noise(constraints=3), "constraints: found int"),
    "a class": (
        lambda: setid.identify(DATA, setid.TransferFunction, NOISE),
        "model: found the class TransferFunction",
    ),
    "no list of priors": (
        lambda: setid.identify(DATA, MODEL, NOISE, priors=3),
        "priors: found int",
    ),
    "no name": (lambda: setid.Hammerstein(MODEL, 2, normalise=3), "normalise: found int"),
    "no names": (lambda: setid.Hammerstein(MODEL, 2, normalise=[3]), "normalise: found 3"),
    "no list of orders": (
        lambda: setid.select(DATA, setid.TransferFunction, NOISE, orders=2),
        "orders: found int",
    ),
    "no record to select for": (
        lambda: setid.select([1, 2], setid.TransferFunction, NOISE, orders=[1]),
        "data: found list, expected IOData",
    ),
    "no formulation": (lambda: setid.least_noise(3, [1]), "formulation: found int, expected"),
    "no result": (
        lambda: setid.convert_intervals(None, "gamma1"),
        "result: found NoneType, expected",
    ),
    "a tolerance that is a word": (
        lambda: setid.consistency(DATA, MODEL, NOISE).is_within("x"),
        "tol: found 'x', expected a number",
    ),
    "more samples than memory": (
        lambda: advice().square_wave(10**400),
        "samples: found a number above 100000000, expected at most that",
    ),
    "a width that is a word": (lambda: select(width="x"), "width: found 'x'"),
    "a negative width": (lambda: select(width=-1), "width: found -1, expected a number > 0"),
    "no truth value": (lambda: select(remove_idle="x"), "remove_idle: found 'x'"),
    "no truth value either": (lambda: select(l1=1), "l1: found 1"),
    "parameters that are a word": (
        lambda: setid.simulate(MODEL, "ab", [1.0, 2.0]),
        "theta: found str 'ab'",
    ),
    "a missing parameter": (
        lambda: setid.simulate(MODEL, [float("nan"), 1], [1.0, 2.0]),
        "theta: found NaN for a1",
    ),
    "a missing parameter by name": (
        lambda: setid.simulate(MODEL, {"a1": 1, "b0": float("nan")}, [1.0, 2.0]),
        "theta: found NaN for b0",
    ),
    "nothing to call": (
        lambda: setid.identify(DATA, MODEL, NOISE, on_progress=3),
        "on_progress: found 3, expected a callable",
    ),
    "no executor": (lambda: setid.identify(DATA, MODEL, NOISE, executor=3), "executor: found 3"),
    "no name of a solver": (lambda: setid.Options(solver=3), "Options.solver: found 3"),
    "a bound for the noise": (
        lambda: setid.simulate_record(MODEL, {"a1": 0.5, "b0": 1.0}, [1.0, 2.0], 0.1),
        "noise: found float",
    ),
    "no structure": (lambda: setid.simulate(None, [1.0], [1.0]), "model: found NoneType"),
    "a class to simulate": (
        lambda: setid.simulate_record(setid.TransferFunction, [1.0], [1.0], NOISE),
        "model: found the class TransferFunction",
    ),
    "an input without samples": (
        lambda: setid.excitation(MODEL, [0.5, 1.0], [], NOISE_OF_EQUATIONS),
        r"u: found shape \(0, 1\)",
    ),
    "no time": (lambda: setid.Recursive(MODEL, NOISE, Ts="s"), "Ts: found 's'"),
    "a negative time": (lambda: setid.Recursive(MODEL, NOISE, Ts=-1.0), "Ts: found -1.0"),
    "an infinite part": (lambda: DATA.split(float("inf")), "at: found inf, expected a row in 1..3"),
    "no relations": (lambda: setid.Physical({"K": (0, 1)}, 3), "relations: found int"),
}


ASKED: dict[str, tuple[Callable[[setid.Identification], Any], str]] = {
    "no frequency": (lambda found: found.bode([]), r"omega: found \[\], expected finite"),
    "a word": (lambda found: found.bode("x"), "omega: found str 'x'"),
    "a negative one": (lambda found: found.bode([-1.0]), r"omega: found \[-1.0\]"),
    "beyond": (lambda found: found.bode([1.0, 10.0]), r"omega: found 10, expected .*\(0, 3.14"),
    "none between": (lambda found: found.bode().between([]), r"omega: found \[\]"),
    "a missing parameter": (lambda found: found.consistent([float("nan"), 1]), "theta: found NaN"),
    "of a residual": (lambda found: setid.residuals(found, [1, float("nan")]), "theta: found NaN"),
    "too few": (lambda found: setid.residuals(found, [1.0]), r"theta: found shape \(1,\)"),
    "a word for a channel": (lambda found: found.bode(output="y"), "output: found 'y'"),
    "a number for noise": (lambda found: setid.predict(found, noise=0.1), "noise: found float"),
    "none of it": (lambda found: setid.compare(found, noise=[]), "noise: found list"),
    "a word for a seed": (
        lambda found: setid.frequency_band(found, kind="sampled", seed="x"),
        "seed: found 'x'",
    ),
}

SAMPLED: dict[str, Callable[..., Any]] = {
    "step_band": setid.step_band,
    "simulate_band": setid.simulate_band,
    "frequency_band": lambda found, **given: setid.frequency_band(found, [1.0], **given),
    "to_control": setid.to_control,
}


@pytest.mark.parametrize("kind", ["proved", "sampled"])
@pytest.mark.parametrize("name", SAMPLED)
def test_numbers_of_samples_are_checked_whether_or_not_they_are_used(name: str, kind: str) -> None:
    for samples in ("x", float("nan"), -1, 1.5):
        with pytest.raises(setid.SetidError, match=f"samples: found {samples!r}, expected an int"):
            SAMPLED[name](result(), kind=kind, samples=samples)
    with pytest.raises(setid.SetidError, match="samples: found 1180591620717411303424, expected"):
        SAMPLED[name](result(), kind=kind, samples=2**70)
    with pytest.raises(setid.SetidError, match="seed: found -1"):
        SAMPLED[name](result(), kind=kind, seed=-1)


def test_more_mixtures_than_memory_holds_are_refused() -> None:
    with pytest.raises(setid.SetidError, match="count: found 1000001, expected at most 1000000"):
        setid.members(result(), 10**6 + 1)
    with pytest.raises(setid.SetidError, match="samples: found 1000001, expected at most"):
        setid.to_continuous(result(), samples=10**6 + 1)


OF_RESULTS: dict[str, Callable[[Any], Any]] = {
    "frequency_band": setid.frequency_band,
    "step_band": setid.step_band,
    "simulate_band": setid.simulate_band,
    "predict": setid.predict,
    "compare": setid.compare,
    "static_band": lambda found: setid.static_band(found, x=[0.0]),
    "signal_band": lambda found: setid.signal_band(found, "w"),
    "residuals": setid.residuals,
    "best": setid.best,
    "central": setid.central,
    "feasible": setid.feasible,
    "members": setid.members,
    "projection_estimate": setid.projection_estimate,
    "worst_case_error": lambda found: setid.worst_case_error(found, [1.0]),
    "project": lambda found: setid.project(found, "a1", "b0"),
    "to_control": setid.to_control,
    "to_continuous": setid.to_continuous,
    "to_mat": lambda found: setid.to_mat(found, "nowhere.mat"),
    "verify": setid.verify,
}


@pytest.mark.parametrize("name", OF_RESULTS)
def test_what_is_no_result_is_named(name: str) -> None:
    with pytest.raises(setid.SetidError, match="^result: found NoneType, expected Identification"):
        OF_RESULTS[name](None)


@pytest.mark.parametrize("name", ASKED)
def test_wrong_questions_are_named(name: str) -> None:
    call, message = ASKED[name]
    found = result()
    with pytest.raises(setid.SetidError, match=f"^{message}"):
        call(found)


@pytest.mark.parametrize("path", ["nowhere/page.html", ".", 3, ""])
def test_reports_name_wrong_paths_before_any_work(
    path: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = result()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("setid.result.page._sections", lambda *_: pytest.fail("work was done"))
    with pytest.raises(sp.SparsePOPError, match="path: found"):
        found.report(path)


@pytest.mark.parametrize("name", WRONG)
def test_wrong_kinds_are_named(name: str) -> None:
    call, message = WRONG[name]
    with pytest.raises(setid.SetidError, match=f"^{message}"):
        call()


@pytest.mark.parametrize("read", [setid.IOData.from_csv, setid.IOData.from_mat])
def test_missing_files_are_named(read: Callable[..., Any], tmp_path: Path) -> None:
    with pytest.raises(setid.DataError, match="nowhere: No such file"):
        read(tmp_path / "nowhere", "u", "y")
