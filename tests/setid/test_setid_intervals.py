"""Intervals and progress by themselves, without any solver."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

import setid
from setid.progress import Progress
from setid.reports import rounded

STATUS = setid.IntervalStatus


def interval(outer, inner, status=STATUS.PARTIAL) -> setid.ParameterInterval:  # type: ignore[no-untyped-def]
    return setid.ParameterInterval("a1", outer, inner, status)


def test_width_centre_and_gap() -> None:
    item = interval((-1.0, 3.0), (0.0, 2.0))
    assert (item.width, item.centre, item.gap) == (4.0, 1.0, 0.5)
    assert 3.0 in item and 3.1 not in item
    assert repr(item) == "a1 in [-1, 3], attained [0, 2], partial"
    assert interval((-1.0, 3.0), None).gap == inf
    assert interval((2.0, 2.0), (2.0, 2.0)).gap == 0.0
    assert np.isnan(interval((-inf, 3.0), None).centre)
    empty = interval((inf, -inf), None, STATUS.EMPTY)
    assert (empty.width, empty.gap) == (0.0, 0.0) and np.isnan(empty.centre)


@pytest.mark.parametrize("status", list(STATUS))
def test_each_status_is_text_with_a_message(status: setid.IntervalStatus) -> None:
    assert status == str(status) and status.message.endswith(".")


def test_numbers_are_rounded_in_one_direction() -> None:
    assert float(rounded(1 / 3, False, 4)) < 1 / 3 < float(rounded(1 / 3, True, 4))
    assert rounded(-inf, False) == "-inf"


def test_the_progress_line_counts_settled_ends() -> None:
    progress = Progress(["a1", "b1"], 1e-3, show=False)
    assert progress.settled == 0
    progress.told(0, -1.0, -0.999)
    assert progress.settled == 0
    progress.told(1, -1.0001, -1.0)
    assert progress.settled == 2
    assert progress.line(1) == "[############............] 2/4 ends, a1 high: gap 5e-05"
    progress.close()
