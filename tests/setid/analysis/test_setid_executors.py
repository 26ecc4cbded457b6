"""Questions beyond one identification give the same answers with worker processes."""

from __future__ import annotations

import numpy as np
import pytest

import setid
from setid import neural
from sparsepop_py.executors.processes import Processes

DATA = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
MODEL = setid.TransferFunction(1, 1)


@pytest.fixture(scope="module")
def pool():
    with Processes(1) as found:
        yield found


def test_sensitivity(pool: Processes) -> None:
    result = setid.identify(DATA, MODEL, setid.Noise(equation=0.5))
    alone, shared = (setid.sensitivity(result, [1.0, 1.5], executor=e) for e in (None, pool))
    np.testing.assert_array_equal(alone.outer, shared.outer)
    assert dict(alone.lost) == dict(shared.lost)
    # by hand: the sample y(3) = 2.0875 bounds a1 and b0, so that a larger factor only widens
    assert np.all(shared.outer[1, :, 0] < shared.outer[0, :, 0])
    assert result.sensitivity([1.0], pool).factors.tolist() == [1.0]


def test_consistency(pool: Processes) -> None:
    # y = u exactly: any factor explains it, also the least one
    data = setid.IOData([4, -3, 2, 1], [4, -3, 2, 1])
    found = setid.consistency(
        data, MODEL, setid.Noise(output=0.5), options=setid.Options(time_limit=5.0), executor=pool
    )
    assert found.verify() and found.scale[0] <= 1e-3


def test_recursive(pool: Processes) -> None:
    ends = []
    for executor in (None, pool):
        online = setid.Recursive(MODEL, setid.Noise(equation=0.5), executor=executor)
        for u, y in zip([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875], strict=True):
            assert online.update(u, y)
        assert online.verify()
        ends.append([item.outer for item in online.intervals.values()])
        assert not online.update(2, 9.0) and online.inconsistent_at == 4
    assert ends[0] == ends[1]


def test_selection_of_networks(pool: Processes) -> None:
    u = np.sin(np.arange(60.0) ** 1.3)
    data = setid.IOData(u, np.append(0.0, np.tanh(u[:-1])) + 1e-3 * np.cos(7.0 * u))
    found = [
        neural.select(*data.split(40), orders=[1], widths=[1, 2], starts=1, executor=e)
        for e in (None, pool)
    ]
    assert [[c.width for c in f.log] for f in found] == [[1, 2], [1, 2]]
    assert found[0].chosen.band_width == pytest.approx(found[1].chosen.band_width, rel=1e-9)
