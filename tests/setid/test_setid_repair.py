"""Repair of vectors in worker processes: it pickles, and gives what it gives here."""

from __future__ import annotations

import pickle

import numpy as np

import setid
import sparsepop_py as sp
from setid.feasible_points.start import Repair

DATA = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])


def test_the_repair_of_an_identification_goes_to_workers(monkeypatch) -> None:
    seen = []
    solve_each = sp.solve_each

    def watched(problem, objectives, *args, **given):
        seen.append((given["start"], given["repair"]))
        return solve_each(problem, objectives, *args, **given)

    monkeypatch.setattr(sp, "solve_each", watched)
    options = setid.Options(time_limit=2.0, progress=False)
    noise = setid.Noise(output=0.5, input=0.1)
    setid.identify(DATA, setid.TransferFunction(1, 1), noise, options=options)
    start, repair = seen[0]
    assert isinstance(repair, Repair)
    disturbed = start.copy()
    disturbed[2:] += 1.0  # all noise is too large
    repaired = pickle.loads(pickle.dumps(repair))(disturbed)
    np.testing.assert_array_equal(repaired, repair(disturbed))
    assert not np.array_equal(repaired, disturbed)
