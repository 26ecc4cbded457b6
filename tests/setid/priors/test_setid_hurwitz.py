"""Priors in continuous time: roots decide, and s = 0 is the static gain."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from prior_cases import admits

import setid
from setid.priors.hurwitz import schwarz_parameters

NOISE = setid.Noise(output=1e6)


def prepared(n: int, m: int, priors: list) -> setid.Formulation:
    """A formulation whose data say nothing, so that the priors alone decide."""
    u = np.linspace(-1, 1, n + 4)
    model = setid.ContinuousTransferFunction(n, m)
    return setid.formulate(setid.IOData(u, np.zeros(n + 4)), model, NOISE, priors)


def random_roots(rng: np.random.Generator, count: int, shift: float) -> np.ndarray:
    """Real and conjugate roots, mostly to the left of -shift."""
    found: list[complex] = []
    while len(found) < count:
        real = -shift + rng.normal(-0.8, 0.7)
        if len(found) <= count - 2 and rng.random() < 0.5:
            imaginary = rng.normal()
            found += [real + 1j * imaginary, real - 1j * imaginary]
        else:
            found.append(real)
    return np.array(found)


@pytest.mark.parametrize("margin", [0.0, 0.5, 2.0])
@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6])
def test_stable_admits_what_the_roots_say(n: int, margin: float) -> None:
    formulation = prepared(n, 0, [setid.Stable(margin)])
    rng = np.random.default_rng(n)
    seen = set()
    for _ in range(100):
        roots = random_roots(rng, n, margin)
        largest = roots.real.max() + margin
        if abs(largest) < 1e-3:
            continue
        seen.add(bool(largest < 0))
        theta = [*np.real(np.poly(roots))[1:], 1.0]
        assert admits(formulation, np.array(theta)) == (largest < 0), roots
    assert seen == {True, False}


@pytest.mark.parametrize("margin", [0.1, 0.7])
def test_the_edge_of_a_smaller_half_plane_is_not_rounded_away(margin: float) -> None:
    """(s + margin)^2 has its double pole on the edge, and satisfies the rows in rationals."""
    rows = prepared(2, 0, [setid.Stable(margin)]).problem.constraints[-2:]
    a1 = Fraction(2.0 * margin)
    theta = [a1, Fraction(margin) ** 2]
    for row in rows:
        terms = zip(
            row.polynomial.exponents.toarray().tolist(), row.polynomial.coefficients, strict=True
        )
        value = sum(
            Fraction(float(c)) * np.prod([t**k for t, k in zip(theta, e, strict=False)])
            for e, c in terms
        )
        assert value >= 0


def test_every_coefficient_that_a_margin_has_rounded_is_said() -> None:
    """With 31 digits 3 m^2, m^2, m^3, and 8 m^2 and 8 m^3 of Routh's product are no doubles."""
    (said,) = (t for t in prepared(3, 0, [setid.Stable(1.0 + 2.0**-30)]).assumptions if ": 5 " in t)
    assert "): 5 coefficients were rounded" in said


@pytest.mark.parametrize(("n", "margin"), [(2, 1e155), (3, 1e103), (4, 1e200)])
def test_margins_whose_powers_are_no_doubles_are_refused(n: int, margin: float) -> None:
    with pytest.raises(setid.PriorError, match=r"Stable\.margin"):
        prepared(n, 0, [setid.Stable(margin)])


def test_the_boundary_is_admitted() -> None:
    """s (s^2 + 1), (s^2 + 1)^2 and s^4 are limits of Hurwitz polynomials."""
    assert admits(prepared(3, 0, [setid.Stable()]), np.array([0.0, 1.0, 0.0, 1.0]))
    fourth = prepared(4, 0, [setid.Stable()])
    assert admits(fourth, np.array([0.0, 0.0, 0.0, 0.0, 1.0]))
    assert admits(fourth, np.array([2.0, 1.0, 0.0, 0.0, 1.0]))  # s^2 (s + 1)^2


def test_schwarz_parameters_are_quotients_of_rouths_column() -> None:
    """s^3 + 6 s^2 + 11 s + 6: Routh's column is 1, 6, 10, 6."""
    np.testing.assert_allclose(schwarz_parameters([6.0, 11.0, 6.0]), [6.0, 10.0, 1.0])
    values = schwarz_parameters([4.0, 6.0, 4.0, 1.0])  # (s + 1)^4: column 1, 4, 5, 16/5, 1
    np.testing.assert_allclose(values, [4.0, 5.0, 0.8, 0.2])


def test_static_gain_is_b0_over_a0() -> None:
    stable = prepared(2, 1, [setid.Stable(), setid.DCGain(0.9, 1.1)])
    free = prepared(2, 1, [setid.DCGain(0.9, 1.1)])
    exact = prepared(2, 1, [setid.DCGain(2.0)])
    for formulation in (stable, free):
        assert admits(formulation, np.array([1.0, 2.0, 5.0, 2.1]))
        assert not admits(formulation, np.array([1.0, 2.0, 5.0, 2.3]))
    assert admits(free, np.array([1.0, -2.0, 5.0, -2.1]))
    assert admits(exact, np.array([1.0, 2.0, 5.0, 4.0]))
    assert not admits(exact, np.array([1.0, 2.0, 5.0, 4.1]))


def test_poles_and_zeros_are_roots_in_s() -> None:
    poles = prepared(2, 1, [setid.PoleIn(-3.5, -2.5)])
    assert admits(poles, np.array([4.0, 3.0, 1.0, 1.0]), 1e-8)  # -1 and -3
    assert not admits(poles, np.array([3.0, 2.0, 1.0, 1.0]), 1e-8)  # -1 and -2
    zeros = prepared(2, 1, [setid.ZeroIn(-5.0, -3.0)])
    assert admits(zeros, np.array([1.0, 1.0, 0.5, 2.0]), 1e-8)  # 0.5 s + 2
    assert not admits(zeros, np.array([1.0, 1.0, 0.5, 3.0]), 1e-8)


@pytest.mark.parametrize("m", [1, 2, 3, 4])
def test_minimum_phase_is_the_left_half_plane(m: int) -> None:
    sign = setid.Box({f"b{m}": (-9.0, -0.1)})
    formulation = prepared(m + 1, m, [sign, setid.MinimumPhase()])
    rng = np.random.default_rng(m)
    for _ in range(60):
        zeros = random_roots(rng, m, 0.0)
        if abs(zeros.real.max()) < 1e-3:
            continue
        theta = [*np.ones(m + 1), *(-2.0 * np.real(np.poly(zeros)))]
        assert admits(formulation, np.array(theta)) == (zeros.real.max() < 0), zeros


def test_minimum_phase_needs_a_leading_coefficient_that_is_not_zero() -> None:
    with pytest.raises(setid.PriorError, match="MinimumPhase: found b4 in .* without zero"):
        prepared(5, 4, [setid.Sign({"b4": "+"}), setid.MinimumPhase()])
    with pytest.raises(setid.PriorError, match="MinimumPhase: found b1 in .* its sign"):
        prepared(2, 1, [setid.MinimumPhase()])


def test_single_coefficients_are_named() -> None:
    formulation = prepared(2, 1, [setid.Known({"b1": 0.0}), setid.Sign({"a1": "+"})])
    assert not admits(formulation, np.array([1.0, 1.0, 0.1, 1.0]))
    with pytest.raises(setid.PriorError, match="found 'a2', expected one of a1, a0, b1, b0"):
        prepared(2, 1, [setid.Box({"a2": (0, 1)})])
