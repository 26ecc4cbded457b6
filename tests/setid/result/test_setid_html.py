"""What notebooks show: well-formed HTML with the numbers of the texts, escaped."""

from __future__ import annotations

import numpy as np
import pytest
from html_cells import Cells
from identified_cases import empty, first_order

import setid
from setid.models.html import equation_text

DATA = setid.IOData(
    [4, -3, 2, 1], [0, -6.25, np.nan, 2.0875], input_names="valve <1>", output_units="m"
)


def test_a_record_shows_its_channels() -> None:
    cells = Cells(DATA._repr_html_()).cells
    assert cells[6:12] == ["valve <1>", "", "0", "-3", "1", "4"]
    assert cells[12:15] == ["y1", "m", "1"]


@pytest.mark.parametrize(
    ("model", "text"),
    [
        (setid.TransferFunction(1, 2, 1), "y1(k) = -a1 y1(k-1) + b1 u1(k-1) + b2 u1(k-2) + e1(k)"),
        (
            setid.Hammerstein(setid.TransferFunction(1, 1, 1), 2, "gamma1"),
            "y1(k) = -a1 y1(k-1) + b1 u1(k-1) + b1 gamma2 u1(k-1) u1(k-1) + e1(k)",
        ),
        (setid.PolynomialNARX(["y1", "1"], 1, 0), "y1(k) = c[y1] y1(k-1) + c[1] + e1(k)"),
        (
            # trapezoidal rule at Ts = 0.2: (y - y') / Ts + a0 (y + y') / 2 = b0 (u + u') / 2
            setid.ContinuousTransferFunction(1, 0, Ts=0.2),
            "y1(k) + 0.1 a0 y1(k) = y1(k-1) - 0.1 a0 y1(k-1) + 0.1 b0 u1(k) + 0.1 b0 u1(k-1) "
            "+ e1(k)",
        ),
    ],
)
def test_a_structure_shows_its_equations(model: setid.TransferFunction, text: str) -> None:
    assert equation_text(model.equations()[-1]) == text
    assert text in Cells(model._repr_html_()).cells


def test_a_structure_without_sampling_time_shows_its_parameters() -> None:
    assert "a0, b0" in Cells(setid.ContinuousTransferFunction(1, 0)._repr_html_()).cells


def test_results_show_outer_and_inner_ends() -> None:
    result = first_order()
    cells = Cells(result._repr_html_()).cells
    row = result.table().splitlines()[2].split()
    place = cells.index("a1")
    assert cells[place : place + 5] == row[:5] and "certified" in cells
    assert "empty" in Cells(empty(result.formulation)._repr_html_()).cells


def test_selections_and_noise_levels_show_their_decisions() -> None:
    u = [1, -1, 2, 0, 1, -2, 1, 3]
    y = setid.simulate(setid.TransferFunction(1, 2), [-0.5, 0, 1], u)
    data, noise = setid.IOData(u, y), setid.Noise(equation=1e-3)
    found = setid.select(data, setid.TransferFunction, noise, [0, 1])
    assert Cells(found._repr_html_()).cells.count("refuted") == 1
    least = setid.consistency(data, setid.TransferFunction(1, 2), noise)
    assert "attained" in Cells(least._repr_html_()).cells
