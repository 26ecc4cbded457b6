"""Widths of rows of a record, against sums in rationals."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

import setid
from setid.data.noise import NoiseBounds
from setid.formulation.regression import rows_of_readings
from setid.models.equations import Equation, Lagged, Term

SAMPLES = 30
U = np.random.default_rng(0).uniform(-1, 1, (SAMPLES, 2))
Y = np.random.default_rng(1).uniform(-1, 1, (SAMPLES, 2))
MODEL = setid.TransferFunction(1, 1, 1, inputs=2, outputs=2, common_denominator=True)
# y2(k) + p (y2(k-1) - u2(k-1)) + q y1(k-1) == e(k): one parameter multiplies two signals
SHARED = Equation(
    "y2",
    (
        Term(1.0, (), (Lagged("y2"),)),
        Term(1.0, ("p",), (Lagged("y2", 1),)),
        Term(-1.0, ("p",), (Lagged("u2", 1),)),
        Term(1.0, ("q",), (Lagged("y1", 1),)),
    ),
    error=True,
)


def widths() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(2)
    shapes = (SAMPLES, 2), (SAMPLES, 2), (SAMPLES, 2)
    eta, xi, e = (rng.uniform(0.01, 1, shape) for shape in shapes)
    return eta, xi, e


def test_noise_of_each_channel_widens_the_rows() -> None:
    eta, xi, e = widths()
    rows = rows_of_readings(
        setid.IOData(U, Y), MODEL, [SHARED], ("p", "q"), NoiseBounds(eta, xi, e)
    )
    assert rows.row.tolist() == list(range(1, SAMPLES)) and set(rows.output) == {2}
    for k, radius, radii in zip(rows.row, rows.radius, rows.radii, strict=True):
        own = Fraction(eta[k, 1]) + Fraction(e[k, 1])
        p, q = Fraction(eta[k - 1, 1]) + Fraction(xi[k - 1, 1]), Fraction(eta[k - 1, 0])
        exact = own, p, q
        assert all(Fraction(a) >= b for a, b in zip((radius, *radii), exact, strict=True))
        assert np.allclose([radius, *radii], [float(x) for x in exact], rtol=1e-14)


def test_readings_count_as_exact_without_bounds() -> None:
    y = Y.copy()
    y[10, 1] = np.nan
    rows = rows_of_readings(setid.IOData(U, y), MODEL, [SHARED], ("p", "q"))
    assert not rows.radius.any() and not rows.radii.any()
    assert rows.row.tolist() == [k for k in range(1, SAMPLES) if k not in (10, 11)]
    kept = rows.row
    assert np.array_equal(rows.target, y[kept, 1])
    expected = np.column_stack([y[kept - 1, 1] - U[kept - 1, 1], y[kept - 1, 0]])
    assert np.array_equal(rows.regressors, expected)
