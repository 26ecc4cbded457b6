"""Where no box of the parameters is finite, consistent parameters are attained all the same."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog
from slow_values import slow_after

import setid
import sparsepop_py as sp
from setid.proofs.existence import proved_point
from setid.proofs.parameter_box import ParameterBox
from setid.result.assembling import unbounded_text
from sparsepop_py.budget import LimitReached

SAMPLES, NOISE = 22, 0.1


def record() -> tuple[setid.TransferFunction, setid.IOData]:
    """Two inputs of order 2, each with a denominator of its own."""
    model = setid.TransferFunction(2, 2, 1, inputs=2)
    truth = (-1.2, 0.5, -0.8, 0.2, 0.3, -0.5, -0.9, 0.6)
    source = np.random.default_rng(1)
    u = source.uniform(-1.0, 1.0, (SAMPLES, 2))
    clean = setid.simulate(model, truth, u)
    return model, setid.IOData(u, clean + source.uniform(-NOISE, NOISE, clean.shape))


def least_error(data: setid.IOData, theta: NDArray[np.float64]) -> float:
    """The largest output error with the best first samples, by a linear program of its own.

    Each input's output starts from two numbers of its own: it is a sum of their responses.
    """
    columns, forced, inputs = [], np.zeros(data.samples), data.inputs
    pairs = theta.reshape(2 * inputs, 2)  # all denominators, then all numerators
    for channel, (a, b) in enumerate(zip(pairs[:inputs], pairs[inputs:], strict=True)):
        for start in np.vstack([np.eye(2), np.zeros((1, 2))]):
            x = list(start)
            for k in range(2, data.samples):
                drive = b[0] * data.u[k - 1, channel] + b[1] * data.u[k - 2, channel]
                x.append(-a[0] * x[-1] - a[1] * x[-2] + (0.0 if np.any(start) else drive))
            if np.any(start):
                columns.append(x)
            else:
                forced += x
    free, ones = np.array(columns).T, np.ones((data.samples, 1))
    target = data.y[:, 0] - forced
    rows = np.vstack([np.hstack([free, -ones]), np.hstack([-free, -ones])])
    goal = np.append(np.zeros(free.shape[1]), 1.0)
    found = linprog(goal, rows, np.concatenate([target, -target]), bounds=(None, None))
    return float(found.fun)


@pytest.fixture(scope="module")
def result() -> setid.Identification:
    model, data = record()
    return setid.identify(data, model, setid.Noise(output=NOISE))


def test_parameters_at_inner_ends_are_consistent(result: setid.Identification) -> None:
    """They need no more than the noise bound, and nearly all of it: they are at an end."""
    data = record()[1]
    assert result.status is setid.IntervalStatus.PARTIAL
    assert "no finite bounds of" in " ".join(result.notes)
    for place, item in enumerate(result.intervals.values()):
        assert item.outer == (-np.inf, np.inf)
        assert item.inner is not None and item.inner[0] < item.inner[1]
        for end, witness in zip(item.inner, item.witnesses, strict=True):
            assert witness is not None and witness[place] == pytest.approx(end)
            assert 0.9 * NOISE < least_error(data, witness[:8]) < (1.0 + 1e-6) * NOISE


def test_attained_ends_are_verified_and_stored(result: setid.Identification) -> None:
    assert result.verify() and setid.verify(result, record()[1])
    again = setid.Identification.from_json(result.to_json())
    assert [i.inner for i in again.intervals.values()] == [
        i.inner for i in result.intervals.values()
    ]


@pytest.mark.parametrize("limit", [None, 60.0])
def test_an_interrupted_search_leaves_what_is_proved(
    limit: float | None, result: setid.Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Under a limit that is one vector: it is known before the search for a box begins."""

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("setid.bounding.methods.find_box", lambda *_: result.evidence.box)
    monkeypatch.setattr("setid.bounding.without_box.points_at_ends", interrupted)
    model, data = record()
    options = setid.Options(time_limit=limit)
    found = setid.identify(data, model, setid.Noise(output=NOISE), options=options)
    assert found.verify()
    for item in found.intervals.values():
        if limit is None:
            assert item.inner is None
        else:
            assert item.inner is not None and item.inner[1] - item.inner[0] <= 1e-9


@pytest.mark.parametrize("cause", slow_after(1, [LimitReached, KeyboardInterrupt]))
def test_points_that_were_proved_in_time_are_kept(
    cause: type[BaseException], result: setid.Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    proofs = []

    def proved(*given: Any) -> sp.ProvedPoint | None:
        if len(proofs) == 3:
            raise cause
        proofs.append(proved_point(*given))
        return proofs[-1]

    monkeypatch.setattr("setid.bounding.methods.find_box", lambda *_: result.evidence.box)
    monkeypatch.setattr("setid.bounding.starts.proved_point", proved)
    model, data = record()
    found = setid.identify(data, model, setid.Noise(output=NOISE))
    assert len(proofs) == 3 and found.verify()
    low, high = found.intervals["a[1,1]1"].inner or (0.0, 0.0)
    assert low < high  # of three points, which are at the ends of the first parameters


def test_long_records_are_simulated_without_a_box(monkeypatch: pytest.MonkeyPatch) -> None:
    """Noise as large as the output: what is attained is consistent, and beside the truth."""
    model, truth = setid.TransferFunction(2, 2, 1), (-1.2, 0.5, 0.3, 0.2)
    source = np.random.default_rng(3)
    u = source.uniform(-1.0, 1.0, 210)
    clean = setid.simulate(model, truth, u)
    noise = float(np.max(np.abs(clean)))
    data = setid.IOData(u, clean + source.uniform(-noise, noise, clean.shape))
    ends = np.full(4, -np.inf), np.full(4, np.inf)
    nothing = ParameterBox(model.parameters, *ends, np.array(ends), ())
    monkeypatch.setattr("setid.bounding.methods.find_box", lambda *_: nothing)
    monkeypatch.setattr("setid.bounding.without_box.find_unbounded", lambda *_: None)
    found = setid.identify(data, model, setid.Noise(output=noise))
    for item in found.intervals.values():
        assert item.outer == (-np.inf, np.inf) and item.inner is not None
        for witness in item.witnesses:
            assert witness is not None
            assert least_error(data, witness[:4]) < (1.0 + 1e-6) * noise
    assert found.verify()


@pytest.mark.parametrize(
    ("nb", "priors", "shares", "helps"),
    [
        (1, [], False, "Stable or Box"),
        (2, [], True, "Stable or Box"),
        (2, [setid.Stable()], True, "Box"),  # what is given already is not named again
    ],
)
def test_what_leaves_several_denominators_open_is_said(
    nb: int, priors: list[setid.Stable], shares: bool, helps: str
) -> None:
    """A numerator of one coefficient has no zero, and so no factor to share."""
    model = setid.TransferFunction([[1, 1]], [[nb, nb]], [[1, 1]], inputs=2)
    data = setid.IOData(np.arange(24.0).reshape(12, 2) % 5, np.arange(12.0) % 3)
    known = setid.formulate(data, model, setid.Noise(output=0.1), priors)
    text = unbounded_text(known, np.array([0, 1]))
    assert "no finite bounds of a[1,1]1, a[1,2]1 were found" in text
    assert "denominators multiplied out" in text and "noise is strong" not in text
    assert ("shares with its denominator" in text) == shares
    assert f"a prior such as {helps}, a longer record" in text


def test_strong_noise_is_named_for_one_denominator() -> None:
    data = setid.IOData(np.arange(12.0) % 5, np.arange(12.0) % 3)
    known = setid.formulate(data, setid.TransferFunction(1, 2), setid.Noise(output=2.0))
    text = unbounded_text(known, np.array([0]))
    assert "the noise is strong" in text and "Stable or Box" in text
