"""Intervals, what they delegate, and progress by themselves, without the engine."""

from __future__ import annotations

import inspect
import re
from decimal import Decimal
from math import inf

import numpy as np
import pytest
from identified_cases import first_order, result_of

import setid
from setid.feasible_points.members import nominal
from setid.result.progress import Progress
from sparsepop_py.verified.arithmetic.display import rounded

STATUS = setid.IntervalStatus


def interval(outer, inner, status=STATUS.PARTIAL) -> setid.ParameterInterval:
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


@pytest.mark.parametrize("ends", [(1 / 3, 2 / 3), (-2 / 3, -1 / 3), (1.0000001, 1.0000002)])
def test_what_is_shown_of_an_interval_is_proved_and_attained(ends: tuple[float, float]) -> None:
    """Outer ends are rounded outwards, attained ones inwards; to nearest both would claim more."""
    item = setid.ParameterInterval("a1", ends, ends, setid.IntervalStatus.CERTIFIED)
    shown = [Decimal(number) for number in re.findall(r"-?\d+\.?\d*(?:e-\d+)?", repr(item)[2:])]
    assert shown[0] <= Decimal(ends[0]) <= shown[2] <= shown[3] <= Decimal(ends[1]) <= shown[1]
    assert shown[1] - shown[0] < Decimal("1.00001") * Decimal(ends[1] - ends[0]) + Decimal("2e-5")


def test_ends_of_one_vector_that_cross_by_rounding_are_shown_as_one_number() -> None:
    item = interval((-2.0, 0.0), (-1.999999999997914, -2.000000000004171))
    assert repr(item) == "a1 in [-2, 0], attained near -2, partial"
    result = result_of(first_order().formulation, {"a1": item})
    (line,) = (line for line in result.table().splitlines() if line.startswith("a1"))
    assert line.split() == ["a1", "-2", "0", "near", "-2", "2", "partial"]


@pytest.mark.parametrize("status", list(STATUS))
def test_each_status_is_text_with_a_message(status: setid.IntervalStatus) -> None:
    assert status == str(status) and status.message.endswith(".")


def test_numbers_are_rounded_in_one_direction() -> None:
    assert float(rounded(1 / 3, False, 4)) < 1 / 3 < float(rounded(1 / 3, True, 4))
    assert rounded(-inf, False) == "-inf"


def test_the_progress_line_counts_settled_ends() -> None:
    progress = Progress(["a1", "b1"], 1e-3, show=False)
    assert progress.settled == 0
    progress.report(0, -1.0, -0.999)
    assert progress.settled == 0
    progress.report(1, -1.0001, -1.0)
    assert progress.settled == 2
    assert (
        progress.line(1)
        == "[############............] 2/4 ends, a1 in [-1, 1.0001], high: gap 5e-05"
    )
    progress.close()


DELEGATED = {
    "bode": setid.frequency_band,
    "nyquist": setid.frequency_band,
    "nichols": setid.frequency_band,
    "step": setid.step_band,
    "fps": setid.project,
    "simulate": setid.simulate_band,
    "predict": setid.predict,
    "compare": setid.compare,
    "to_control": setid.to_control,
}


@pytest.mark.parametrize("name", DELEGATED)
def test_methods_take_what_their_functions_take(name: str) -> None:
    method = inspect.signature(getattr(setid.Identification, name)).parameters
    function = inspect.signature(DELEGATED[name]).parameters
    later = {key: p.default for key, p in method.items() if p.kind is p.KEYWORD_ONLY}
    given = [(k, p.default, p.kind) for k, p in method.items() if k not in later][1:]
    taken = [(k, p.default, p.kind) for k, p in function.items()][1:]
    assert given == taken[: len(given)]
    assert later == {key: function[key].default for key in later}
    settings = {"samples", "seed", "options", "tolerance", "time_limit", "all_time", "executor"}
    assert set(function) - set(method) - {"result"} <= settings


def test_methods_pass_on_what_they_are_given() -> None:
    result = first_order()
    assert result.compare(mode="prediction").band.mode == "prediction"
    assert result.compare(kind="sampled").band.kind == "sampled"
    assert result.simulate(kind="sampled").kind == "sampled"
    large = setid.Noise(equation=5.0)
    for band, wider in ((result.predict(), result.predict(noise=large)),
                        (result.simulate(), result.simulate(noise=large))):  # fmt: skip
        assert np.nanmax(wider.reading_high - band.reading_high) > 1.0
    for draw in (result.bode, result.nyquist, result.nichols, result.step):
        with pytest.raises(setid.SetidError, match="input"):
            draw(input=2)
        with pytest.raises(setid.SetidError, match="output"):
            draw(output=2)


def test_where_no_linear_program_can_tell_attained_vectors_or_found_noise_do() -> None:
    model = setid.PolynomialNARX(["y1^2"], 1, 0)  # products of noisy samples
    data = setid.IOData([0.0] * 4 + [1.0], [0.5, 0.4, 0.3, 0.2, 0.1])
    formulation = setid.formulate(data, model, setid.Noise(output=0.5))
    ends = tuple(np.full(formulation.problem.dimension, end) for end in (0.1, 0.3))
    name, open_ = model.parameters[0], setid.IntervalStatus.PARTIAL
    for outer in ((0.0, 0.5), (0.0, np.inf)):
        interval = setid.ParameterInterval(name, outer, (0.1, 0.3), open_, ends)
        result = result_of(formulation, {name: interval})
        for theta in (result.feasible, nominal(result)):
            attained = theta.tolist() in ([0.1], [0.3])
            assert attained or result.consistent(theta) is not None
