"""For all tests: no display, no clock that makes a test fail, and results that are verified."""

from __future__ import annotations

import gc
import zlib
from typing import Any

import matplotlib
import pytest
from hypothesis import HealthCheck, Phase, settings
from journeys import Batch, through_json
from loop_cases import ALL_SPECS

from sparsepop_py.pipeline import final_result
from sparsepop_py.result import Result

matplotlib.use("Agg")
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow])
# Deliberate faults (tests/mutants): the same examples each time, and the first failure is enough.
settings.register_profile(
    "mutants",
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
    phases=(Phase.explicit, Phase.generate),
)
settings.load_profile("patient")


def confirmed(result: Result, batch: Batch | None = None) -> Result:
    """The result, if verification reaches its bound, also after a journey through JSON."""
    if result.certificate is None:
        assert result.lower_bound == float("-inf")
        return result
    assert result.lower_bound == result.certificate.bound
    again = through_json(result, batch)  # refuses bounds above what verification recomputes
    assert again.lower_bound == again.certificate.bound == result.lower_bound
    assert again.status is result.status
    return result


def made(state: Any, known: Any) -> Result:
    """What ``solve`` and ``solve_each`` return, whoever calls them in a test or a fixture."""
    global latest
    if latest.owner is not known:
        latest = Batch(known)
    result = make(state, known)
    alone = zlib.crc32(result.problem.fingerprint.encode()) % 8 == 0  # some share nothing
    return confirmed(result, None if alone else latest)


latest = Batch()
make, final_result._made = final_result._made, made


def pytest_collection_finish() -> None:
    """Collect garbage less often, and none of the modules: a twentieth of the time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)


@pytest.fixture
def only_branch(monkeypatch):
    """Leave only the linear relaxation and branch and bound."""
    monkeypatch.setattr(
        "sparsepop_py.strategy.shared_state.relaxation_specs",
        lambda *args: tuple(r for r in ALL_SPECS(*args) if r.shape == "linear"),
    )
