"""Terms that are left out, and what the width of intervals is due to."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from math import inf
from typing import Any

import numpy as np
import pytest

import setid
from setid import options
from setid.analysis import select, terms

BOUND = 0.02


def record(samples: int = 120) -> setid.IOData:
    """y = 0.5 y' + u' - 0.4 u'^2 with equation errors."""
    truth = setid.PolynomialNARX(["y1", "u1", "u1^2"], ny=1, nu=1)
    u = np.random.default_rng(1).uniform(-1, 1, samples)
    noise = setid.Noise(equation=BOUND)
    return setid.simulate_record(truth, [0.5, 1.0, -0.4], u, noise, 1).data


def full(order: int, degree: int) -> setid.PolynomialNARX:
    return setid.PolynomialNARX.full(degree, order, order)


def test_idle_terms_are_removed_and_the_loop_runs_again() -> None:
    found = setid.select(record(), full, setid.Noise(equation=BOUND), [1], [2], remove_idle=True)
    assert found.result is not None and found.steps[0].decision == "kept"
    assert set(found.result.intervals) == {"c[y1]", "c[u1]", "c[u1^2]"}
    assert all(text.startswith("needed") for text in found.coefficients.values())
    assert any("without" in step.reason for step in found.steps[1:])
    assert found.result.verify()


def test_needed_terms_stay_even_if_their_interval_holds_zero() -> None:
    u = np.array([1.0, 1.0, 2.0, 2.0, -1.0, -1.0])
    y = np.array([0.0, 0.1, 0.1, 0.2, 0.2, -0.1])
    model = setid.PolynomialNARX(["u1", "1"], ny=0, nu=1)
    data = setid.IOData(u, y)
    found = setid.select(
        data, lambda order, degree: model, setid.Noise(equation=0.12), [1], remove_idle=True
    )
    assert found.result is not None and not found.result.empty
    for step in found.steps[1:]:
        assert step.decision in ("kept", "refuted")


def test_sparse_terms_of_a_large_dictionary_are_proved_to_suffice() -> None:
    model = full(2, 3)
    assert len(model.parameters) == 56  # monomials up to degree 3 in five variables: C(8, 3)
    noise = setid.Noise(equation=BOUND)
    data = record(200)
    gone = setid.sparse_terms(data, model, noise)
    assert not {"c[y1]", "c[u1]", "c[u1^2]"} & set(gone) and len(gone) >= 45
    found = setid.select(data, lambda o, d: model, noise, [2], [3], l1=True, remove_idle=True)
    assert found.result is not None and found.result.verify()
    assert {"c[y1]", "c[u1]", "c[u1^2]"} <= set(found.result.intervals)
    assert found.coefficients["c[u1^2]"] == "needed: its sign is negative, proved"


def test_wide_intervals_are_put_down_to_noise_or_to_structure() -> None:
    noise = setid.Noise(equation=0.6)
    terms = ["y1", "u1", "u1^2", "u1^3"]

    def family(order: int, degree: int) -> setid.PolynomialNARX:
        return setid.PolynomialNARX(terms[: degree + 1], ny=1, nu=1)

    poor = setid.select(record(), family, noise, [1], [1, 2], width=0.05)
    assert poor.chosen is not None and poor.chosen.degree == 1
    assert "a higher degree or order pays" in poor.advice and poor.advice in poor.log
    rich = setid.select(record(), family, noise, [1], [2], width=0.05)
    assert "a better sensor" in rich.advice
    fine = setid.select(record(), family, setid.Noise(equation=BOUND), [1], [2], width=0.5)
    assert "as narrow as asked" in fine.advice


def test_transfer_functions_keep_idle_coefficients_at_zero() -> None:
    u = np.random.default_rng(3).uniform(-1, 1, 60)
    noise = setid.Noise(equation=0.05)
    truth = setid.simulate_record(setid.TransferFunction(1, 1, 1), [-0.6, 2.0], u, noise, 3)
    found = setid.select(truth.data, setid.TransferFunction, noise, [1], remove_idle=True)
    assert found.result is not None
    assert found.result.intervals["b0"].outer == (0.0, 0.0)
    assert found.coefficients["b1"].startswith("needed")


class Clock:
    """A clock that stands still but for the seconds that patched functions are said to take."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, factor: float) -> None:
        self.now, self.factor, self.limits = 0.0, factor, list[float]()
        monkeypatch.setattr(time, "monotonic", lambda: self.now)
        monkeypatch.setattr(options, "monotonic", lambda: self.now)
        for module, name in ((select, "identify"), (terms, "identify"), (select, "consistency")):
            monkeypatch.setattr(module, name, self.slow(getattr(module, name)))

    def slow(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def asked(*given: Any) -> Any:
            self.limits.append(given[-1].time_limit)
            found = function(*given)
            self.now += self.factor * given[-1].time_limit
            return found

        return asked


MINUTE = setid.Options(time_limit=60.0, progress=False)


def test_all_that_is_asked_shares_one_time_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each identification and least factor takes all the time that it is given."""
    clock, noise = Clock(monkeypatch, 1.0), setid.Noise(equation=0.6)
    asked: dict[str, Any] = {"options": MINUTE, "remove_idle": True, "width": 0.05}
    found = setid.select(record(), full, noise, [1], [2], **asked)
    assert len(found.steps) > 1 and found.advice
    assert clock.limits[0] == pytest.approx(20.0)  # two stages follow
    assert sum(clock.limits[1:-2]) <= 20.0 + 1e-6
    assert sum(clock.limits) == pytest.approx(60.0)


def test_sparse_terms_share_the_time_limit_of_a_structure(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a needed term the record is refuted, and the whole structure is tried."""
    clock = Clock(monkeypatch, 1.0)
    monkeypatch.setattr(select, "sparse_terms", lambda *given: ("c[u1]",))
    found = setid.select(
        record(), full, setid.Noise(equation=BOUND), [1], [2], options=MINUTE, l1=True
    )
    assert found.chosen is not None and clock.limits == pytest.approx([30.0, 30.0])


def test_the_log_says_what_there_was_no_time_for(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, noise = Clock(monkeypatch, 4.0), setid.Noise(equation=0.6)
    asked: dict[str, Any] = {"options": MINUTE, "remove_idle": True, "width": 0.05}
    found = setid.select(record(), full, noise, [1], [2], **asked)
    assert clock.limits == pytest.approx([20.0]) and len(found.steps) == 1
    late = [text for text in found.coefficients.values() if "no time to leave it out" in text]
    assert late and all(text.startswith("idle") for text in late)
    assert found.log.count("there was no time") == len(late) + 1
    assert "no time to find out whether noise or structure" in found.advice


@pytest.mark.parametrize(
    ("own", "other", "texts"),
    [
        ((0.5, 0.6), (0.1, 0.3), ["needs 0.5 to 0.6 times", "a higher degree or order pays"]),
        ((0.5, 0.6), (0.45, 0.5), ["needs 0.45 to 0.5 times", "a better sensor"]),
        ((0.5, 0.6), (0.1, inf), ["needs at least 0.1 times", "stayed open"]),
        ((0.5, 0.6), (0.1, 0.5), ["stayed open"]),
        ((0.5, inf), (0.4, 0.45), ["needs at least 0.5 times", "stayed open"]),
        ((0.5, inf), (0.1, 0.3), ["needs at least 0.5 times", "a higher degree or order pays"]),
    ],
)
def test_advice_follows_from_least_factors(monkeypatch, own, other, texts) -> None:
    class Found:
        def __init__(self, scale: tuple[float, float]) -> None:
            self.scale = scale

    scales = iter((own, other))
    monkeypatch.setattr(select, "consistency", lambda *given: Found(next(scales)))
    found = setid.select(record(), full, setid.Noise(equation=0.6), [1], [1], width=0.05)
    assert all(text in found.advice for text in texts)


def needed(advice: str) -> tuple[float, float]:
    """Ends of the factor that a structure is said to need."""
    found = re.search(r"this structure needs ([0-9.]+) to ([0-9.]+) times", advice)
    assert found is not None
    return float(found[1]), float(found[2])


def test_the_noise_of_a_reduced_structure_is_its_own() -> None:
    """y = b u has the readings 1.1 and 0.9 of u = 1, so that b = 1 needs 0.1 of the noise 0.2."""
    data = setid.IOData([1, 1, 1, -1, -1], [1.0, 1.1, 0.9, -1.0, -1.0])
    asked = {"remove_idle": True, "width": 1e-3}
    noise = setid.Noise(equation=0.2)
    found = setid.select(data, setid.TransferFunction, noise, [1], **asked)
    assert [n for n, text in found.coefficients.items() if "needed" in text] == ["b0"]
    low, high = needed(found.advice)
    assert low <= 0.5 <= high <= 0.51


def test_a_structure_is_compared_with_another_one() -> None:
    """Transfer functions have no degree: the next one is of more order."""
    data = setid.IOData([1, 1, 2, -1, -1], [1.0, 1.1, 1.9, -1.0, -1.0])
    noise = setid.Noise(equation=0.2)
    for degrees in ([1], [1, 2]):
        found = setid.select(data, setid.TransferFunction, noise, [0], degrees, width=1e-3)
        assert "order 1, degree 1 needs" in found.advice


def test_a_family_without_larger_structures_has_none_to_compare_with() -> None:
    data = setid.IOData([1, 1, 2, -1, -1], [1.0, 1.1, 1.9, -1.0, -1.0])
    noise = setid.Noise(equation=0.2)

    def family(order: int, degree: int) -> setid.TransferFunction:
        return {(0, 1): setid.TransferFunction(0, 1)}[order, degree]

    found = setid.select(data, family, noise, [0], width=1e-3)
    assert found.chosen is not None and "no other structure was found" in found.advice


def test_intervals_without_ends_are_not_said_to_have_a_width() -> None:
    data = setid.IOData([1, -1, 2], [1.0, -1.0, 2.0])  # two rows, three parameters
    noise = setid.Noise(equation=0.2)
    found = setid.select(data, setid.TransferFunction, noise, [1], width=0.1)
    assert found.advice.startswith("some intervals are not finite, 10 % asked")
