"""High powers look dependent in doubles; modulo a prime they do not."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest

import setid
from setid.proofs.uniqueness.exact_rank import _PRIME, _null_space, moved_parameters
from sparsepop_py.budget import LimitReached

SHAPE = setid.TransferFunction(1, 1, 1)
TWO_SCALES = {"b1", "gamma[w]1", "gamma[w]2", "gamma[y1]1", "gamma[y1]2"}  # b1 has both


@pytest.mark.parametrize(
    ("model", "moved"),
    [
        (setid.Hammerstein(SHAPE, 2), {"b1", "gamma1", "gamma2"}),
        (setid.Hammerstein(SHAPE, 30, normalise="gamma1"), set()),
        (setid.Hammerstein(SHAPE, 2, normalise="dcgain"), set()),
        (setid.Wiener(SHAPE, 3), {"b1", "gamma1", "gamma2", "gamma3"}),
        (setid.Wiener(SHAPE, 3, normalise="b1"), set()),
        (setid.Lure(SHAPE, 2), {"a1", "gamma1"}),  # a shift, which no scale is
        (setid.Lure(SHAPE, 2, normalise={"gamma1": 0.0}), set()),
        (setid.Lure(SHAPE, 2, normalise="dcgain"), set()),  # a shift changes the static gain
        (setid.HammersteinWiener(SHAPE, 2, 2), TWO_SCALES),
    ],
)
def test_freedom_that_is_known_by_hand(model: Any, moved: set[str]) -> None:
    assert moved_parameters(model) == moved
    assert set(setid.unidentifiable(model)) == moved


def test_functions_that_are_no_powers_are_left_to_doubles() -> None:
    assert moved_parameters(setid.Hammerstein(SHAPE, [1, np.sin], normalise="gamma1")) is None


def test_null_spaces_are_exact() -> None:
    x, y, z = 7, 11, _PRIME - 5
    rows = np.array([[x, y, 0, z], [2 * x % _PRIME, 2 * y, 0, 2 * z % _PRIME], [0, 1, 0, 3]])
    null = _null_space(rows)
    assert null.shape == (2, 4)
    for vector in null.tolist():
        assert not any(
            sum(a * b for a, b in zip(r, vector, strict=True)) % _PRIME for r in rows.tolist()
        )


def test_a_map_of_twenty_terms_is_identified() -> None:
    generator = np.random.default_rng(1)
    model = setid.Hammerstein(SHAPE, 20, normalise="gamma1")
    theta = {name: 0.6 if name == "b1" else 0.2 for name in model.parameters} | {"a1": -0.5}
    noise = setid.Noise(equation=1e-3)
    truth = setid.simulate_record(model, theta, generator.uniform(-1, 1, 30), noise)
    found = setid.identify(truth.data, model, noise, options=setid.Options(time_limit=0.2))
    for name, item in found.intervals.items():
        assert item.outer[0] <= theta[name] <= item.outer[1]


def test_the_search_for_a_normalisation_ends_with_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    def late(*given: Any) -> Any:
        raise LimitReached

    monkeypatch.setattr(sys.modules["setid.identify"], "reference_model", late)
    data = setid.IOData([1, 2, 0, 1, 3], [0, 1, 2, 1, 0])
    options = setid.Options(time_limit=5, unidentifiable="report")
    with pytest.raises(setid.ModelError, match="b1, gamma1 are not unique, and no proof in the t"):
        setid.identify(data, setid.Hammerstein(SHAPE, 1), setid.Noise(0.1), options=options)
