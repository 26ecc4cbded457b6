"""Functions refuse what is of another type by their names for it, and results fit one line."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import setid
import sparsepop_py as sp

MODEL = setid.TransferFunction(1, 1)


@pytest.mark.parametrize("found", [None, 1, "x", {}, setid.Noise(equation=0.1)])
def test_what_is_of_another_type_is_refused_by_name(found: Any) -> None:
    """Each of these once ended in an AttributeError."""
    with pytest.raises(setid.ModelError, match="model: found"):
        setid.parameters(found)
    with pytest.raises(setid.ModelError, match="model: found .*, expected a block structure"):
        setid.unidentifiable(found)
    with pytest.raises(sp.ProblemError, match="rows: found .*, expected UncertainRows"):
        setid.parameter_box(found)
    if not isinstance(found, str):
        with pytest.raises(setid.PriorError, match="prior: found .*, expected a text"):
            setid.read_prior(found)


def test_bounds_of_a_box_fit_the_rows() -> None:
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    rows = setid.formulate(data, MODEL, setid.Noise(equation=0.5)).regression
    with pytest.raises(sp.ProblemError, match=r"start: found shape \(2, 3\), expected \(2, 2\)"):
        setid.parameter_box(rows, np.zeros((2, 3)))
    with pytest.raises(setid.ModelError, match="found TransferFunction, expected a block"):
        setid.unidentifiable(MODEL)  # type: ignore[arg-type]


def test_simulated_records_and_estimates_are_shown_in_one_line() -> None:
    """A simulated record of 30 samples once filled a screen."""
    truth = setid.simulate_record(MODEL, [-0.5, 1], np.arange(30.0), setid.Noise(output=0.1))
    assert repr(truth) == (
        "<Simulated: a1 = -0.5, b0 = 1, IOData: 30 samples, 1 input, 1 output, Ts = 1>"
    )
    data = setid.IOData([1, 0, 2, 1], [0, 1, 0.5, 2.25])  # y_k = 0.5 y_k-1 + u_k-1, by hand
    found = setid.least_squares(data, setid.TransferFunction(1, 1, 1))
    shown = repr(found)
    assert shown.startswith("<Estimate: a1 = -0.5, b1 = 1, cost ") and "\n" not in shown
