"""Limits, interrupts and progress of identification: what is proved stays, whatever ends early."""

from __future__ import annotations

import copy
import logging
import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import setid
import sparsepop_py as sp
from setid.bounding import engine, methods
from sparsepop_py.budget import Deadline, LimitReached
from sparsepop_py.local_search.feasibility import prove_feasible

THETA = {"a1": -0.6, "b0": 1.5}


def record(samples: int = 12, noise: float = 0.05, seed: int = 0) -> setid.IOData:
    """y(k) = 0.6 y(k-1) + 1.5 u(k), measured with errors."""
    rng = np.random.default_rng(seed)
    u, y = rng.uniform(-1, 1, samples), np.zeros(samples)
    y[0] = 1.5 * u[0]
    for k in range(1, samples):
        y[k] = 0.6 * y[k - 1] + 1.5 * u[k]
    return setid.IOData(u, y + noise * rng.uniform(-1, 1, samples))


MODEL = setid.TransferFunction(na=1, nb=1, nk=0)
NOISE = setid.Noise(output=0.05)
OPTIONS = setid.Options(tol=1e-2, progress=False)


def holds_the_truth(result: setid.Identification) -> bool:
    inside = (low <= THETA[name] <= high for name, (low, high) in outer(result).items())
    return all(inside) and bool(result.verify())


def outer(result: setid.Identification) -> dict[str, tuple[float, float]]:
    return {name: interval.outer for name, interval in result.intervals.items()}


def test_progress_names_parameters_in_their_units() -> None:
    seen: list[tuple[str, tuple[float, float], tuple[float, float]]] = []
    result = setid.identify(
        record(), MODEL, NOISE, options=OPTIONS, on_progress=lambda *state: seen.append(state)
    )
    assert {name for name, _, _ in seen} == {"a1", "b0"}
    for name, proved, attained in seen:
        assert proved[0] <= THETA[name] <= proved[1]
        assert proved[0] <= attained[0] and attained[1] <= proved[1]
    last = {name: proved for name, proved, _ in seen}
    for name, (low, high) in outer(result).items():
        assert low == pytest.approx(last[name][0], abs=1e-6)
        assert high == pytest.approx(last[name][1], abs=1e-6)


def test_an_interrupt_in_a_callback_keeps_what_is_proved() -> None:
    def stop(*state: object) -> None:
        raise KeyboardInterrupt

    result = setid.identify(record(), MODEL, NOISE, options=OPTIONS, on_progress=stop)
    assert holds_the_truth(result)
    assert any("interrupted" in note for note in result.notes)


class Late:
    """Has no time at all."""

    def __call__(self, *given: object, **named: object) -> object:
        raise LimitReached


def test_exact_linear_programs_that_take_too_long_give_way(monkeypatch) -> None:
    data, noise = record(noise=0.02), setid.Noise(equation=0.05)
    exact = setid.identify(data, MODEL, noise, options=OPTIONS)
    monkeypatch.setattr(sp, "linear_bounds", Late())
    other = setid.identify(data, MODEL, noise, options=OPTIONS)
    assert not other.bounds and other.results
    assert bool(other.verify())
    for name, (low, high) in outer(exact).items():
        assert outer(other)[name][0] <= low + 1e-9 and high - 1e-9 <= outer(other)[name][1]
        assert outer(other)[name][1] - outer(other)[name][0] <= 1.1 * (high - low)


@pytest.mark.parametrize(("module", "stage"), [(methods, "find_box"), (engine, "starts_of_engine")])
def test_a_stage_without_time_loses_nothing_else(module, stage, monkeypatch) -> None:
    monkeypatch.setattr(module, stage, Late())
    result = setid.identify(record(), MODEL, NOISE, options=OPTIONS)
    assert holds_the_truth(result)
    assert stage != "find_box" or any("search for a box" in note for note in result.notes)


def test_points_known_when_time_ends_are_claimed_at_each_end_without_a_proof(monkeypatch) -> None:
    """Of points that are in (0, 1), (1, 0) and (1, 1) each end claims the best."""
    x, y = sp.variables(2)
    box = sp.Problem(x, [x + y >= 1], lower=0.0, upper=1.0)
    points = [prove_feasible(box, np.array(p, float)) for p in ((0, 1), (1, 0), (1, 1))]
    ends = [sp.solve(box.with_objective(p), sp.Options(refine="none")) for p in (x, -x, y, -y)]
    ends = [replace(end, attained=None, upper_bound=np.inf) for end in ends]
    proofs: list[int] = []
    monkeypatch.setattr(sp.ProvedPoint, "recheck", lambda self, about: proofs.append(1))
    values = [end.upper_bound for end in engine._attained(ends, points)]
    assert all(v >= exact for v, exact in zip(values, [0.0, -1.0, 0.0, -1.0], strict=True))
    assert values == pytest.approx([0.0, -1.0, 0.0, -1.0], abs=1e-15)  # rounded upwards
    assert not proofs


def test_a_search_for_simpler_structures_without_time_loses_nothing_else(monkeypatch) -> None:
    """y = 2 u has no pole, so that with one more and one zero more nothing is bounded."""
    data = setid.IOData([1, 0, -1, 1, 0, 1], [2.1, 0, -1.9, 2, 0.1, 2])
    model, noise = setid.TransferFunction(na=1, nb=2), setid.Noise(output=0.2)
    assert setid.identify(data, model, noise, options=OPTIONS).unbounded is not None
    monkeypatch.setattr("setid.bounding.without_box.find_unbounded", Late())
    result = setid.identify(data, model, noise, options=OPTIONS)
    assert result.unbounded is None and bool(result.verify())


def test_rows_are_compiled_with_looks_at_the_clock() -> None:
    with Deadline(1e-9).kept(), pytest.raises(LimitReached):
        setid.formulate(record(), MODEL, NOISE)


def test_a_cpu_limit_leaves_honest_gaps() -> None:
    options = setid.Options(tol=1e-9, cpu_limit=1e-6, progress=False)
    result = setid.identify(record(40), MODEL, NOISE, options=options)
    assert holds_the_truth(result)
    with pytest.raises(setid.SetidError, match="Options.cpu_limit: found 0, expected seconds"):
        setid.Options(cpu_limit=0)


def test_results_with_an_executor_pickle_and_copy() -> None:
    with ThreadPoolExecutor(1) as executor:
        engine = sp.Options(effort="auto", executor=executor)
        options = setid.Options(tol=1e-2, progress=False, engine=engine)
        result = setid.identify(record(), MODEL, NOISE, options=options)
        again, copied = pickle.loads(pickle.dumps(result)), copy.deepcopy(result)
    for other in (again, copied):
        assert outer(other) == outer(result)
        assert bool(other.verify())


def test_the_log_has_the_names_of_the_packages(caplog) -> None:
    with caplog.at_level(logging.DEBUG):
        setid.identify(record(), MODEL, NOISE, options=OPTIONS)
    names = {r.name.split(".")[0] for r in caplog.records}
    assert {"setid", "sparsepop_py"} <= names
    assert any("proved [" in r.getMessage() for r in caplog.records if r.name.startswith("setid"))
