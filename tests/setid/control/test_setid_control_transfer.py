"""Transfer functions in rationals, target signals, reference models, ideal controllers."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

import setid
from setid import control
from setid.control.transfer import (
    _PRIME,
    _is_schur_with,
    _stepped,
    is_schur,
    simulate_exactly,
    times,
)

# Laboratory plant 4500/(s^2+16s+4500) and reference (51.54s+861.8)/(s^2+56.97s+861.8), zero-order
# hold; ideal controllers by exact arithmetic (LRIC laboratories 7 and 8).
LABORATORY = {
    0.01: ([2.0568754, -4.7255762, 4.2782032, -1.4824789], [1, -0.9761862, -0.8986386, 0.8748248]),
    0.005: (
        [4.2978183, -11.757854, 11.1460309, -3.6490603],
        [1, -0.9930685, -0.9480591, 0.9411276],
    ),
    0.02: ([1.0013186, -1.1187457, 1.0153414, -0.5193439], [1, -0.927183, -0.8048727, 0.7320557]),
}
# Fourth-order example printed in the course notes, section 6.3.4
NOTES_P = ([0, 0.09516, 0.02, 0.05, -0.04], [1, -0.9048, 0.2, -0.5, 0.4])
NOTES_M = ([0, 0.4], [1, -0.6])
NOTES_IDEAL = (
    [4.20344683, -3.80327869, 0.84068937, -2.10172341, 1.68137873],
    [1, -0.78982766, 0.31525851, -0.94577554, 0.42034468],
)


def sampled(top: list[float], below: list[float], Ts: float) -> control.Transfer:
    b, a, _ = cont2discrete((top, below), Ts)
    return control.Transfer(b.ravel(), a, Ts)


@pytest.mark.parametrize("Ts", LABORATORY)
def test_dddc_lab_ideal(Ts: float) -> None:
    plant = sampled([4500.0], [1.0, 16.0, 4500.0], Ts)
    reference = sampled([51.54, 861.8], [1.0, 56.97, 861.8], Ts)
    found = control.ideal_controller(plant, reference)
    top, below = LABORATORY[Ts]
    np.testing.assert_allclose(found.num, top, rtol=2e-6)
    np.testing.assert_allclose(found.den, below, rtol=2e-6)
    assert found.integrators == 1


def test_dddc_seed_example() -> None:
    found = control.ideal_controller(NOTES_P, NOTES_M)
    np.testing.assert_allclose(found.num, NOTES_IDEAL[0], atol=1e-8)
    np.testing.assert_allclose(found.den, NOTES_IDEAL[1], atol=1e-8)
    matching = control.check_matching(NOTES_P, found, NOTES_M)
    assert matching.stable and matching.gain_error < 1e-9


def test_target_signal_is_what_the_ideal_controller_gives() -> None:
    r = np.random.default_rng(0).uniform(-1, 1, 80)
    y = lfilter(*NOTES_P, r)
    s = control.target_signal(NOTES_M, r)
    np.testing.assert_allclose(lfilter(*NOTES_IDEAL, y), s, atol=1e-6)


def test_target_signal_refuses_a_reference_without_delay() -> None:
    with pytest.raises(setid.ModelError, match="lag 0"):
        control.target_signal(([1.0, 0.2], [1.0, -0.5]), [1.0, 2.0])


def test_ideal_controller_refuses_to_look_ahead() -> None:
    with pytest.raises(setid.ModelError, match="future"):
        control.ideal_controller(([0, 0, 1.0], [1.0, -0.5]), ([0, 0.5], [1.0, -0.5]))


def test_the_integrator_cancels_exactly() -> None:
    K, M = control.Transfer([2.0, -1.0], [1.0, -1.0]), control.Transfer([0, 0.4], [1, -0.6])
    product = K * (1 - M)
    assert product.integrators == 0 and product.is_stable()
    assert product.order == 1


def test_a_pole_near_one_moves_to_one_and_the_remainder_is_told() -> None:
    K = control.Transfer([1.0], np.poly([1.0 - 1e-7, 0.9]))
    moved, rest = K.snapped(1e-6)
    assert moved.integrators == 1 and rest == pytest.approx(1e-8)
    assert max(abs(np.roots([float(c) for c in moved.denominator]) - [1.0, 0.9])) < 1e-5
    assert K.snapped(1e-8) == (K, 0.0)


@pytest.mark.parametrize(("pole", "times"), [(0.95, 5), (0.97, 4), (0.99, 3), (0.9985, 2)])
def test_several_poles_on_the_way_to_one_stay(pole: float, times: int) -> None:
    """D(1) is the product of their distances from 1: small, with no pole near 1."""
    K = control.Transfer([1.0], np.poly([pole] * times))
    assert abs(float(sum(K.denominator))) < 1e-6 * float(sum(map(abs, K.denominator)))
    assert K.snapped(1e-6) == (K, 0.0)


def test_a_gain_of_a_half_is_not_one() -> None:
    """Four slow poles: D(1) is small, and N(1) half of it."""
    lags = np.poly([0.995] * 4)
    M = control.Transfer([0, 0, 0, 0.5 * float(sum(map(Fraction, lags)))], lags)
    assert float(M.static_gain) == pytest.approx(0.5)
    K = control.ideal_controller(([0, 1.0], [1.0]), M)
    assert K.integrators == 0
    r = np.ones(200)
    loop = [float(v) for v in (M / (1 - M)).simulate(r)]
    np.testing.assert_allclose(control.target_signal(M, r), loop, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_schur_agrees_with_the_roots(seed: int) -> None:
    rng = np.random.default_rng(seed)
    roots = rng.uniform(-1.3, 1.3, 4)
    polynomial = [Fraction(float(c)) for c in np.poly(roots)]
    assert is_schur(polynomial) == bool(np.abs(roots).max() < 1.0)
    radius = Fraction(float(np.abs(roots).max())) * Fraction(11, 10)
    assert is_schur(polynomial, radius)


@pytest.mark.parametrize("seed", range(20))
def test_fixed_point_decides_as_rationals_do_or_not_at_all(seed: int) -> None:
    """Roots on the circle, or nearer to it than the bits tell, are left to rationals."""
    rng, polynomial = np.random.default_rng(seed), (Fraction(1),)
    near = [Fraction(1) - Fraction(1, 10 ** int(rng.integers(3, 60))) for _ in range(2)]
    for root in rng.choice(
        [Fraction(1, 2), Fraction(-3, 4), Fraction(9, 8), Fraction(-1), *near], 5
    ):
        polynomial = times(polynomial, (Fraction(1), -root))
        for bits in (30, 60, 250):
            known = _is_schur_with(polynomial, bits)
            assert known is None or known == stepped_down(polynomial)
        assert is_schur(polynomial) == stepped_down(polynomial)


def test_few_bits_decide_nothing_that_rationals_do_not() -> None:
    """The last reflection coefficient is next to 1 on either side, the others are near 1."""
    rng, decided = np.random.default_rng(0), 0
    for _ in range(4000):
        last = 1 + Fraction(int(rng.choice([-1, 1])), 2 ** int(rng.integers(2, 12)))
        others = [
            int(rng.choice([-1, 1])) * (1 - Fraction(1, 2 ** int(rng.integers(0, 7))))
            for _ in range(int(rng.integers(1, 5)))
        ]
        polynomial = (Fraction(1),)
        for k in (last, *others):  # the recursion, backwards
            longer = (*polynomial, Fraction(0))
            polynomial = tuple(a + k * b for a, b in zip(longer, longer[::-1], strict=True))
        for bits in range(5, 24):
            known = _is_schur_with(polynomial, bits)
            decided += known is not None
            assert known is None or known == (abs(last) < 1), (polynomial, bits)
    assert decided > 1000


def test_a_step_encloses_all_that_is_within_the_error() -> None:
    """At the ends of the errors, which rounding alone does not reach together."""
    rng, bits = np.random.default_rng(1), 12
    for _ in range(3000):
        error, size = int(rng.integers(1, 20)), int(rng.integers(2, 7))
        rest = [int(v) for v in rng.integers(-4000, 4001, size)]
        rest[0] = int(rng.choice([-1, 1])) * (abs(rest[-1]) + 2 * error + int(rng.integers(1, 40)))
        new, wider = _stepped(rest, error, bits)
        for signs in rng.choice([-1, 1], (8, size)):
            true = [Fraction(v + error * int(s)) for v, s in zip(rest, signs, strict=True)]
            k = true[-1] / true[0]
            exact = [a - k * b for a, b in zip(true[:-1], true[:0:-1], strict=True)]
            assert all(abs(a - b) <= wider for a, b in zip(exact, new, strict=True))


def stepped_down(polynomial: tuple[Fraction, ...]) -> bool:
    """The recursion in rationals."""
    rest = list(polynomial)
    while len(rest) > 1:
        if abs(rest[-1]) >= abs(rest[0]):
            return False
        k = rest[-1] / rest[0]
        rest = [a - k * b for a, b in zip(rest[:-1], rest[:0:-1], strict=True)]
    return True


def test_stability_of_long_polynomials_takes_no_time() -> None:
    """In rationals order 300 would take minutes."""
    rng = np.random.default_rng(0)
    tail = [Fraction(float(v)) for v in rng.uniform(-3e-3, 3e-3, 300)]
    assert is_schur([Fraction(1), *tail])  # the sum of sizes is below 1
    assert not is_schur([Fraction(1), *tail[:-1], Fraction(9, 8)])


def test_exact_simulation_agrees_with_doubles() -> None:
    r = np.random.default_rng(1).uniform(-1, 1, 50)
    M = control.Transfer(*NOTES_P)
    np.testing.assert_allclose(simulate_exactly(M, r.tolist()), M.simulate(r), atol=1e-13)


@pytest.mark.parametrize("size", [1e-300, 1e-72, 1.0, 1e200])
def test_exact_simulation_keeps_the_units_of_its_input(size: float) -> None:
    """Halves: each output is a double."""
    found = simulate_exactly(control.Transfer([0, 0.5], [1, -0.5]), [size, 0.0, size, 0.0])
    assert found.tolist() == [0.0, 0.5 * size, 0.25 * size, 0.625 * size]


def test_exact_simulation_keeps_an_integrator() -> None:
    r = np.full(2000, 0.1)
    found = simulate_exactly(control.Transfer([1], [1, -1]), r.tolist())
    assert found[-1] == float(Fraction(0.1) * 2000)


@pytest.mark.parametrize(("rise", "overshoot"), [(1.0, 0.0), (1.0, 0.05), (2.5, 0.2), (0.8, 0.5)])
def test_reference_model_rises_as_asked(rise: float, overshoot: float) -> None:
    Ts = 0.002
    M = control.reference_model(rise=rise, overshoot=overshoot, Ts=Ts)
    y = M.simulate(np.ones(20000))
    measured = (np.argmax(y >= 0.9) - np.argmax(y >= 0.1)) * Ts
    assert measured == pytest.approx(rise, abs=2 * Ts)
    assert max(y.max() - 1.0, 0.0) == pytest.approx(overshoot, abs=1e-3)
    assert M.static_gain == 1


@pytest.mark.parametrize("overshoot", [0.0, 0.1])
def test_reference_model_settles_as_asked(overshoot: float) -> None:
    Ts = 0.002
    M = control.reference_model(settling=4.0, overshoot=overshoot, Ts=Ts)
    y = M.simulate(np.ones(20000))
    last = np.flatnonzero(np.abs(y - 1.0) > 0.02)[-1] * Ts
    assert last == pytest.approx(4.0, abs=3 * Ts)


def test_reference_model_takes_zeros_and_delay() -> None:
    M = control.reference_model(rise=3.0, delay=2, zeros=[1.5])
    assert M.delay == 3 and M.static_gain == 1
    assert np.any(np.abs(M.zeros - 1.5) < 1e-12)


@pytest.mark.parametrize(
    "wrong", [{}, {"rise": -1.0}, {"rise": 1.0, "overshoot": 1.0}, {"rise": 1.0, "zeros": [1j]}]
)
def test_reference_model_refuses(wrong: dict) -> None:
    with pytest.raises(setid.ModelError, match="found"):
        control.reference_model(**wrong)


@pytest.mark.parametrize("overshoot", [0.0, 0.1, 0.9])
@pytest.mark.parametrize("rise", [1e7, 1e10, 1e16, 1e17, 1e300])
def test_reference_models_keep_their_gain_or_are_refused(rise: float, overshoot: float) -> None:
    """From 1e7 samples on, 1 + a1 + a2 of about 1e-14 is no longer held by doubles near 1."""
    if overshoot == 0.0 and rise <= 1e10:  # 1 + a1 = 2.2 / rise
        M = control.reference_model(rise)
        assert M.static_gain == 1 and M.is_stable()
        return
    with pytest.raises(setid.ModelError, match="rise, settling: found times too long beside Ts"):
        control.reference_model(rise, overshoot=overshoot)


@pytest.mark.parametrize("bad", [np.ones((3, 2)), np.ones((1, 2, 2)), 1.0, None])
def test_signals_of_other_shapes_are_named(bad: object) -> None:
    M = control.reference_model(rise=3.0)
    calls = {
        "u": lambda: M.simulate(bad),
        "r": lambda: control.target_signal(M, bad),
        "step_record": lambda: control.undershoot(bad, 0.1),
    }
    for field, call in calls.items():
        with pytest.raises(setid.SetidError, match=f"{field}: found shape .*, expected .N,."):
            call()
    column = M.simulate(np.ones((3, 1)))
    assert column.shape == (3,) and M.simulate([]).size == 0
    assert control.Transfer([0, 1]).simulate([]).size == 0


def test_classes_are_fixed_at_positive_times_and_whole_orders() -> None:
    for Ts in (0, -1.0, float("nan"), "x", None):
        with pytest.raises(setid.ModelError, match="Ts: found"):
            control.PID().fixed(Ts)
    for order in (0, 1.5, "2", True):
        with pytest.raises(setid.ModelError, match="order: found"):
            control.LTI().fixed(1.0, order)


def test_transfer_from_and_to_python_control() -> None:
    module = pytest.importorskip("control")
    given = module.TransferFunction([0.4], [1.0, -0.6], 0.5)
    found = control.ideal_controller(given, given)
    assert found.Ts == 0.5
    back = control.Transfer([0, 0.4], [1, -0.6], 0.5).to_control()
    omega = [0.1, 1.0]
    np.testing.assert_allclose(
        back(np.exp(1j * np.array(omega) * 0.5)), given(np.exp(1j * np.array(omega) * 0.5))
    )
    with pytest.raises(setid.ModelError, match="continuous"):
        control.ideal_controller(module.TransferFunction([1.0], [1.0, 1.0]), given)
    two = module.TransferFunction([[[0.4], [0.1]]], [[[1.0, -0.6], [1.0, -0.2]]], 0.5)
    with pytest.raises(setid.ModelError, match="1 outputs and 2 inputs"):
        control.ideal_controller(given, two)


@pytest.mark.parametrize("bad", [None, "x", float("nan"), [1.0], 1j, {"a": 1}])
def test_wrong_times_numbers_and_lists_are_named(bad: object) -> None:
    M = control.reference_model(rise=3.0)
    calls = {
        "Ts": lambda: control.reference_model(rise=3.0, Ts=bad),
        "zeros": lambda: control.reference_model(rise=3.0, zeros=[bad]),
        "samples": lambda: control.check_matching(([0, 1], [1, -0.5]), M, M, bad),
        "tolerance": lambda: M.snapped(bad),
        "LTI.integrator": lambda: control.LTI(1, integrator=bad),
        "PID.derivative": lambda: control.PID(derivative=bad),
        "PID.filter": lambda: control.PID(filter=bad),
        "disturbance": lambda: control.Specification(1.0, disturbance=(0.1, bad)),
        "sensor_noise": lambda: control.Specification(1.0, rise=3.0, sensor_noise=bad),
    }
    if bad is not None:
        calls["rise"] = lambda: control.Specification(1.0, rise=bad)
    if not isinstance(bad, complex):
        calls |= {"zeros ": lambda: control.Specification(1.0, rise=3.0, zeros=[bad])}
    for field, call in calls.items():
        if field == "sensor_noise" and bad is None:
            continue  # which is left out
        with pytest.raises(setid.SetidError, match=f"{field.strip()}.*(found|expected)"):
            call()


@pytest.mark.parametrize("bad", ["x", 1j, [[1, 2], [3]], {"a": 1}, float("inf")])
def test_frequencies_that_are_no_numbers_are_named(bad: object) -> None:
    with pytest.raises(setid.SetidError, match="omega: found"):
        control.reference_model(rise=3.0).response(bad)


def test_systems_beyond_all_doubles_are_named() -> None:
    for call in (
        lambda: control.Transfer([10**400]),
        lambda: control.Transfer([1], [1e-300, 1e300]),
        lambda: control.reference_model(rise=3.0) + 10**400,
    ):
        with pytest.raises(setid.ModelError, match="beyond all doubles"):
            call()
    with pytest.raises(setid.ModelError, match="leading coefficient 0"):
        control.Polynomials([[1.0]], [0.0, 1.0])


def test_priors_and_options_of_a_design_are_named() -> None:
    r = np.random.default_rng(0).uniform(-1, 1, 20)
    data, M = setid.IOData(r, r), control.reference_model(rise=3.0)
    with pytest.raises(setid.SetidError, match="priors: found int"):
        control.design(data, M, control.LTI(1), 0.1, priors=3)
    for bad in (0, 5.0, np.ones(2)):
        with pytest.raises(setid.SetidError, match="options: found"):
            control.design(data, M, control.LTI(1), 0.1, options=bad)


@pytest.mark.parametrize("seed", range(8))
def test_common_factors_are_found_and_no_others(seed: int) -> None:
    """Products of random polynomials with and without a common one, and of degree 80."""
    random = np.random.default_rng(seed)
    one, other, common = (
        tuple(Fraction(int(v)) for v in [1, *random.integers(-9, 9, size), 7]) for size in (3, 2, 1)
    )
    whole = control.Transfer(times(one, common), times(other, common)).reduced()
    assert whole.order <= max(len(one), len(other)) - 1
    x = Fraction(1, 3)  # the same function
    values = [sum(c * x**k for k, c in enumerate(p)) for p in (one, other)]
    made = [sum(c * x**k for k, c in enumerate(p)) for p in (whole.numerator, whole.denominator)]
    assert values[0] * made[1] == values[1] * made[0]
    long = [Fraction(float(v)) for v in [1.0, *random.uniform(-0.1, 0.1, 80)]]
    kept = control.Transfer(long[::-1], long).reduced()
    assert len(kept.denominator) == 81


def test_factors_that_are_none_modulo_the_prime_are_found() -> None:
    """1 + p q^-1 is 1 modulo p; and 1/p has no value there."""
    p = _PRIME
    common = (Fraction(1), Fraction(p))
    one, other = (Fraction(1), Fraction(2)), (Fraction(1), Fraction(3))
    whole = control.Transfer(times(one, common), times(other, common)).reduced()
    assert whole.order == 1 and whole.denominator[1] / whole.denominator[0] == 3
    small = (Fraction(1), Fraction(1, p))
    for top, below in ((small, other), (other, small)):
        kept = control.Transfer(times(top, one), times(below, one)).reduced()
        assert kept.order == 1


def test_responses_of_far_coefficients_do_not_overflow() -> None:
    """K P / (1 + K P) is 1 up to 1e-300 where K is that large; 1e308 / (1 + 1e308 q^-1) is q."""
    P = control.Transfer([0, 1], [1, -0.5])
    loop = control.references.closed_loop(control.Transfer([1e308, -5e307], [1, -1]), P)
    omega = np.array([0.1, 1.0, 3.0])
    np.testing.assert_allclose(loop.response(omega), 1.0, rtol=1e-12)
    steep = control.Transfer([1e308], [1, 1e308])
    np.testing.assert_allclose(steep.response(omega), np.exp(1j * omega), rtol=1e-12)


def test_exact_simulations_beyond_all_doubles_are_refused() -> None:
    with pytest.raises(setid.SetidError, match="u: found inputs whose response is beyond"):
        simulate_exactly(control.Transfer([1], [1, -1]), [1.7e308, 1.7e308])
