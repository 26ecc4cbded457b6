"""Cells are examined in portions, and what is left when time or room ends is a cover still."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

import setid
from setid.proofs.cells import output_cells
from setid.proofs.cells.output_cells import CellBox, cell_box
from setid.proofs.parameter_box import start_of

TRUTH = {1: (-0.7, 0.3, 0.3, 0.1), 2: (-1.1, 0.4, 0.2, 0.1, 0.3, 0.1)}


def formulated(order: int, degree: int, initial: str = "zero", seed: int = 0):
    """A record of a Wiener system from rest with 1 % of noise, the first part left out or not."""
    shape = setid.TransferFunction(order, order, 1)
    model = setid.Wiener(shape, degree, "gamma1", initial=initial)
    theta = TRUTH[order][: len(model.parameters)]
    random = np.random.default_rng(seed)
    late = 0 if initial == "zero" else 20
    u = random.uniform(-1, 1, 50 + late)
    at_rest = setid.Wiener(shape, degree, "gamma1", initial="zero")
    y = setid.simulate(at_rest, theta, u)[:, 0]
    bound = 0.01 * float(np.abs(y).max())
    data = setid.IOData(u[late:], (y + random.uniform(-bound, bound, y.size))[late:])
    return setid.formulate(data, model, setid.Noise(output=bound), setid.Stable()), theta


def boxed(known: setid.Formulation, **options) -> CellBox:
    found = cell_box(known, start_of(known), **options)
    assert found is not None
    return found


def holds(found: CellBox, theta: tuple[float, ...]) -> bool:
    return bool(np.all(found.lower <= theta) and np.all(theta <= found.upper))


@pytest.mark.parametrize("initial", ["zero", "free"])
def test_portions_change_nothing(initial: str, monkeypatch: pytest.MonkeyPatch) -> None:
    known, theta = formulated(1, 2, initial)
    whole = boxed(known)
    monkeypatch.setattr(output_cells, "_AT_ONCE", 7)
    monkeypatch.setattr(output_cells, "_AT_ONCE_FREE", 3)
    found = boxed(known)
    assert holds(found, theta) and not found.open
    assert (found.cells, found.rounds) == (whole.cells, whole.rounds)
    for one, two in ((found.lower, whole.lower), (found.upper, whole.upper)):
        assert one == pytest.approx(two, rel=1e-9)


@pytest.mark.parametrize("calls", [1, 2, 3, 5, 8, 13, 21, 34])
def test_what_is_left_when_time_ends_is_a_cover(
    calls: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Time ends at some look at the clock: between rounds, or in the middle of one."""
    known, theta = formulated(1, 2)
    clock = itertools.chain(itertools.repeat(0.0, calls), itertools.repeat(2.0))
    with monkeypatch.context() as patch:
        patch.setattr(output_cells, "_AT_ONCE", 2)
        patch.setattr(output_cells.time, "monotonic", lambda: next(clock))
        found = boxed(known, until=1.0)
    assert holds(found, theta)
    assert found.verify(known, start_of(known))  # replays end where the search did


@pytest.mark.parametrize("rounds", [3, 6, 9])
def test_more_cells_than_are_bounded_keep_the_poles(
    rounds: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    known, theta = formulated(1, 2)
    each = boxed(known, rounds=rounds)
    monkeypatch.setattr(output_cells, "_MOST_LEFT", 0)
    found = boxed(known, rounds=rounds)
    assert holds(found, theta) and found.cells == each.cells
    assert np.all(found.low == -np.inf) and np.all(found.high == np.inf)  # nothing of the signal
    assert found.verify(known, start_of(known))
    assert np.all(found.lower <= each.lower) and np.all(each.upper <= found.upper)
    assert found.lower[0] > -1.0 or rounds < 6  # of the pole something is known


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0])
def test_cubic_maps_behind_order_two_have_a_box(seed: int) -> None:
    known, theta = formulated(2, 3, seed=seed)
    found = boxed(known)
    assert holds(found, theta) and not found.open


def test_a_box_that_says_no_more_than_the_priors_needs_no_replay(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known, _ = formulated(1, 2)
    start = start_of(known)
    bare = replace(boxed(known, rounds=0, samples=False), lower=start[0], upper=start[1])
    none = np.full(bare.low.shape, np.inf)
    claims = [
        replace(bare, low=none, high=-none),  # no sample has a value: the set is empty
        replace(bare, low=np.zeros_like(none)),
        replace(bare, upper=np.minimum(start[1], 0.99)),
        replace(bare, lower=np.maximum(start[0], -0.99)),
        replace(bare, lower=start[0][:1], upper=start[1][:1]),
    ]
    monkeypatch.setattr(output_cells, "cell_box", lambda *_, **__: None)  # nothing is computed
    assert replace(bare, low=-none, high=none).verify(known, start)
    assert not any(claim.verify(known, start) for claim in claims)


def test_a_box_of_the_pole_bounds_cubic_maps_with_an_unknown_past() -> None:
    """The note says so: away from 0 and -1 first samples are coordinates of cells."""
    known, theta = formulated(1, 3, "free")
    data, model, noise = known.data, known.model, known.noise
    short = setid.Options(time_limit=1.0, progress=False)
    bare = setid.identify(data, model, noise, setid.Stable(), short)
    assert "Box for a1 that leaves out -1 and 0" in bare.notes[-1]
    away = setid.Box({"a1": (-0.95, -0.3)})
    found = boxed(setid.formulate(data, model, noise, [setid.Stable(), away]))
    assert holds(found, theta) and not found.open
