"""Problems in units: nothing may be rounded, or the units are ones. The oracle is `Fraction`."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py.problem.units import InUnits, in_units, with_units

x, y = sp.variables(2)
NUMBERS = st.floats(1e-280, 1e280) | st.sampled_from([1.0, 3.0, 2.0**-1000, 5e-324, 1.5e300])


def same_rows(given: sp.Problem, scaled: InUnits) -> bool:
    """Check that rows and objective in z are those in x, times one power of two each."""
    units = [Fraction(1), *map(Fraction, scaled.units.tolist())]
    pairs = [(given.objective, scaled.problem.objective)]
    rows = zip(given.constraints, scaled.problem.constraints, strict=True)
    pairs += [(a.polynomial, b.polynomial) for a, b in rows]
    for before, after in pairs:
        assert np.array_equal(before.words, after.words)
        ratios = set()
        for word, old, new in zip(
            before.words, before.coefficients, after.coefficients, strict=True
        ):
            size = Fraction(1)
            for letter in word.tolist():
                size *= units[letter]
            ratios.add(Fraction(new) / (Fraction(old) * size))
        if len(ratios) != 1 or Fraction(np.frexp(float(*ratios))[0]) != Fraction(1, 2):
            return False
    return True


def same_bounds(given: sp.Problem, scaled: InUnits) -> bool:
    ends = zip(
        [*given.lower.tolist(), *given.upper.tolist()],
        [*scaled.problem.lower.tolist(), *scaled.problem.upper.tolist()],
        [*scaled.units.tolist(), *scaled.units.tolist()],
        strict=True,
    )
    return all(Fraction(end) == Fraction(z) * Fraction(unit) for end, z, unit in ends)


@given(st.lists(NUMBERS, min_size=6, max_size=6), st.sampled_from([1, 16]))
def test_nothing_is_rounded(numbers: list[float], coarse: int) -> None:
    a, b, c, d, upper, far = numbers
    rows = [a * x * y - b * y >= 0, c * x**2 - d * y == 0]
    given_ = sp.Problem(a * x - d * y, rows, [-upper, 0.0], [upper, far])
    scaled = in_units(given_, coarse=coarse)
    assert same_bounds(given_, scaled)
    assert same_rows(given_, scaled)


@pytest.mark.parametrize(
    ("rows", "lower", "upper", "units"),
    [
        ([x + y >= 0], [0.0, 0.0], [5e-324, 1.0], [2.0**16, 1.0]),  # an upper end is lost
        ([x + y >= 0], [-5e-324, 0.0], [1.0, 1.0], [2.0**16, 1.0]),  # a lower end is lost
        ([x + 2.0**-1000 * y >= 0], [0.0, 0.0], [1.0, 1.0], [1.0, 2.0**-60]),  # a coefficient
        ([2.0**1000 * x + y >= 0], [0.0, 0.0], [1.0, 1.0], [2.0**60, 1.0]),  # ends as infinity
        ([x + y >= 0], [0.0, 0.0], [1.0, 1.0], [2.0**-980, 1.0]),  # a unit that is too small
        ([x + y >= 0], [0.0, 0.0], [1.0, 1.0], [2.0**980, 1.0]),  # or too large
        ([2.0**-900 * x * y + y >= 0], [0.0, 0.0], [1.0, 1.0], [2.0**-90, 2.0**-90]),  # a product
        ([1.3 * 2.0**-900 * x * y >= 0], [0.0, 0.0], [1.0, 1.0], [2.0**-80, 2.0**-80]),  # subnormal
    ],
)
def test_units_that_would_round_are_ones(
    rows: list[sp.Constraint], lower: list[float], upper: list[float], units: list[float]
) -> None:
    given_ = sp.Problem(x, rows, lower, upper)
    scaled = with_units(given_, np.array(units))
    assert scaled.problem is given_
    assert scaled.units.tolist() == [1.0, 1.0] and scaled.factor == 1.0


def test_an_objective_is_restated_with_its_factor() -> None:
    """In z = x / 2^16 and w = y the objective 3 x y is 3 * 2^16 z w."""
    large = sp.Problem(x, [x + 65536.0 * y <= 65536.0], lower=0, upper=[65536.0, 1.0])
    scaled = in_units(large)
    objective, factor = scaled.asked(3.0 * x * y)
    value = Fraction(objective(np.array([1.0, 1.0]))) * Fraction(factor)
    assert scaled.units.tolist() == [65536.0, 1.0] and value == 3 * 65536
    with pytest.raises(sp.ProblemError, match="neither tiny nor huge"):
        scaled.asked(2.0**1000 * x)
