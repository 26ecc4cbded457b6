"""Certificates: figures of the notes' example, assumptions, and never one of an unstable loop."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from slow_values import slow_after

import setid
from setid import control
from setid.control.certificates import certificate
from setid.control.certificates.cells import Outcome
from setid.control.parameters import sums
from setid.control.references import stabilises
from sparsepop_py import SparsePOPError, budget

# Printed in the course notes, section 6.3.4
P = control.Transfer([0, 0.09516, 0.02, 0.05, -0.04], [1, -0.9048, 0.2, -0.5, 0.4])
M = control.Transfer([0, 0.4], [1, -0.6])
K = control.Transfer([4.176, -3.68, 0.7055, -2.006, 1.644], [1, -0.7755, 0.314, -0.9413, 0.4028])
# max abs(Delta) on a fine grid, at w = 1.931, and abs(Delta(0)); max abs(pole) of the loop (oracle)
TRUE_MAX, TRUE_ZERO, TRUE_POLE = 0.020046, 0.010664, 0.92847


def experiment(
    snr: float, samples: int = 100, seed: int = 0, plant: control.Transfer = P
) -> tuple[setid.IOData, float]:
    rng = np.random.default_rng(seed)
    r = rng.uniform(-1, 1, samples)
    y = plant.simulate(r)
    bound = float(np.sqrt(3.0 * np.mean(y**2) / 10.0 ** (snr / 10.0)))
    return setid.IOData(r, y + rng.uniform(-bound, bound, samples)), bound


def certified(snr: float, method: str, **more: object) -> control.StabilityCertificate:
    data, bound = experiment(snr)
    return control.stability_certificate(
        data, K, M, 4, setid.Noise(output=bound), method=method, delay=1, **more
    )


def test_the_printed_example_is_what_the_notes_say() -> None:
    omega = np.linspace(1e-5, np.pi, 20001)
    delta = np.abs(
        M.response(omega) - K.response(omega) * P.response(omega) * (1 - M.response(omega))
    )
    assert delta.max() == pytest.approx(TRUE_MAX, abs=1e-6)
    assert delta[0] == pytest.approx(TRUE_ZERO, abs=1e-5)
    poles = np.roots([float(c) for c in control.references.characteristic(K, P)])
    assert np.abs(poles).max() == pytest.approx(TRUE_POLE, abs=1.1e-5)  # .928460, printed .92847
    assert stabilises(K, P)


def test_small_gain_at_60_decibel() -> None:
    found = certified(60.0, "small_gain")
    assert found.verdict == "certified"
    assert TRUE_MAX <= found.bound < 0.06
    assert [c.holds for c in found.conditions] == [None, True, True]
    assert found.arcs[0][0] == 0.0 and found.arcs[-1][1] == pytest.approx(np.pi)
    assert found.arcs[0][2] >= TRUE_ZERO  # where K and 1 - M have a pole and a zero
    # the bound holds on the whole circle: compare with the true Delta between grid points
    for low, high, bound in found.arcs:
        omega = np.linspace(max(low, 1e-6), high, 7)
        delta = M.response(omega) - K.response(omega) * P.response(omega) * (1 - M.response(omega))
        assert np.all(np.abs(delta) <= bound)


@pytest.mark.slow
def test_small_gain_at_40_decibel() -> None:
    found = certified(40.0, "small_gain")
    assert found.verdict == "certified" and TRUE_MAX <= found.bound < 0.82


@pytest.mark.parametrize("snr", [60.0, 40.0])
def test_characteristic_polynomial(snr: float) -> None:
    found = certified(snr, "characteristic")
    assert found.verdict == "certified" and np.isnan(found.bound)


def test_without_a_margin_strong_noise_is_open_and_says_why() -> None:
    found = certified(15.0, "small_gain", time_limit=2.0)
    assert found.verdict == "open" and "unbounded without a margin" in found.reason
    assert any("margin" in text for text in found.help)


def test_a_resonance_in_the_noise_makes_delta_unbounded() -> None:
    """c / (1 - 2 rho cos w0 q^-1 + rho^2 q^-2) within half the noise bound (order slack two)."""
    _, bound = experiment(40.0)
    rng = np.random.default_rng(0)
    r = rng.uniform(-1, 1, 100)
    F = K * (1 - M)
    sizes = []
    for gap in (1e-1, 1e-2, 1e-4, 1e-6):
        rho, w0 = 1.0 - gap, 1.0
        shape = control.Transfer([0, 1.0], [1, -2 * rho * np.cos(w0), rho**2])
        c = 0.5 * bound / np.abs(shape.simulate(r)).max()
        sizes.append(float(np.abs(c * shape.response([w0]) * F.response([w0]))[0]))
    assert sizes[0] < sizes[1] < sizes[2] < sizes[3] and sizes[3] > 100.0


def test_order_slack_of_two_is_open_without_a_margin() -> None:
    plant = control.Transfer([0, 1.0], [1, -0.5])
    data, bound = experiment(30.0, 60, plant=plant)
    ideal = control.ideal_controller(plant, M)
    found = control.stability_certificate(data, ideal, M, 3, bound, delay=1, time_limit=3.0)
    assert found.verdict != "certified"
    assert found.verdict == "refuted" or "unbounded without a margin" in found.reason


def test_margin_is_listed_among_the_assumptions() -> None:
    found = certified(60.0, "small_gain", margin=0.01)
    assert found.verdict == "certified"
    assert any("margin" in text for text in found.assumptions)


def test_a_moved_pole_is_listed_among_the_assumptions() -> None:
    data, bound = experiment(60.0)
    near = control.Transfer(K.numerator, [*K.denominator[:-1], K.denominator[-1] + 1e-8])
    found = control.stability_certificate(data, near, M, 4, bound, delay=1)
    assert found.verdict == "certified" and found.controller.integrators == 1
    assert any("z = 1" in text for text in found.assumptions)


def test_a_controller_with_another_unstable_pole_fails_condition_two() -> None:
    data, bound = experiment(60.0)
    unstable = control.Transfer([0.1], np.convolve([1, -1], [1, -1.1]))
    found = control.stability_certificate(data, unstable, M, 4, bound, delay=1)
    assert found.verdict == "open"
    assert found.conditions[1].holds is False


@pytest.mark.parametrize(
    "method", [pytest.param("small_gain", marks=pytest.mark.slow), "characteristic"]
)
def test_an_unstable_loop_is_refuted_with_a_consistent_plant(method: str) -> None:
    data, bound = experiment(60.0)
    strong = control.Transfer([20 * c for c in K.numerator], K.denominator)
    assert not stabilises(strong, P)
    found = control.stability_certificate(
        data, strong, M, 4, bound, method=method, delay=1, time_limit=15.0
    )
    assert found.verdict == "refuted"
    assert found.plant is not None and not stabilises(strong, found.plant)
    formulation = setid.formulate(data, found.model, setid.Noise(output=bound))
    theta = [*found.plant.den[1:], *found.plant.num[1:]]
    assert setid.least_noise(formulation, theta).level <= 1.0 + 1e-9


def test_a_search_for_unstable_plants_ends_with_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each linear program takes ten times the limit: one is begun, and the verdict is open."""
    clock, passed, asked, limit = time.monotonic, [0.0], [0], 1000.0

    def slow(*arguments: object) -> object:
        asked[0] += 1
        passed[0] += 10.0 * limit
        budget.check()  # as programs do that are stopped
        return solve(*arguments)

    solve = sums.solve_scaled
    monkeypatch.setattr(sums, "solve_scaled", slow)
    unproved = Outcome(False, (), (), 0)
    monkeypatch.setattr(certificate, "prove_over_cells", lambda *arguments: unproved)
    monkeypatch.setattr(budget.time, "monotonic", lambda: clock() + passed[0])
    data, bound = experiment(60.0)
    strong = control.Transfer([20 * c for c in K.numerator], K.denominator)
    found = control.stability_certificate(
        data, strong, M, 4, bound, method="characteristic", delay=1, time_limit=limit
    )
    assert asked[0] == 1 and found.verdict == "open" and found.plant is None


@pytest.mark.parametrize("seed", slow_after(4, range(12)))
def test_no_certificate_of_an_unstable_loop(seed: int) -> None:
    """The true plant is consistent by construction; gains go through the limit of stability."""
    rng = np.random.default_rng(seed)
    plant = control.Transfer(
        [0, *rng.uniform(0.2, 1.0, 2)], np.poly(rng.uniform(0.3, 0.9, 2)).tolist()
    )
    data, bound = experiment(45.0, 80, seed, plant)
    ideal = control.ideal_controller(plant, M)
    for gain in (1.0, 2.0, 5.0):
        scaled = control.Transfer([gain * float(c) for c in ideal.numerator], ideal.denominator)
        for method in ("small_gain", "characteristic"):
            found = control.stability_certificate(
                data, scaled, M, 2, bound, method=method, delay=1, time_limit=0.1
            )
            assert stabilises(found.controller, plant) or found.verdict != "certified"


def test_a_declared_integrator_of_the_plant() -> None:
    plant = control.Transfer([0, 0.5, 0.2], [1, -1.5, 0.5])
    data, bound = experiment(45.0, 80, 1, plant)
    ideal = control.ideal_controller(plant, M)
    for method in ("small_gain", "characteristic"):
        found = control.stability_certificate(
            data, ideal, M, 2, bound, 0.05, method, delay=1, integrators=1
        )
        assert found.verdict == "certified", method
        assert any("declared" in text for text in found.assumptions)


@pytest.mark.parametrize("method", ["small_gain", "characteristic"])
def test_a_zero_of_the_controller_does_not_hide_the_plants_integrator(method: str) -> None:
    """K has the zero z = 1 and the plant the pole: the loop keeps a pole at exactly z = 1."""
    plant = control.Transfer([0, 0.5, 0.2], [1, -1.5, 0.5])
    data, bound = experiment(50.0, 80, 1, plant)
    derivative = control.Transfer([0.2, -0.2], [1.0])
    reference = control.Transfer([0, 0.1], [1, -0.5])
    assert not stabilises(derivative, plant)
    found = control.stability_certificate(
        data, derivative, reference, 2, bound, 0.05, method, delay=1, integrators=1, time_limit=1.0
    )
    assert found.verdict != "certified"


def test_margins_and_steps_hold_for_the_true_plant() -> None:
    data, bound = experiment(50.0)
    found = control.stability_certificate(data, K, M, 4, bound, method="characteristic", delay=1)
    margins = control.loop_margins(found)
    omega = np.linspace(1e-4, np.pi, 5000)
    sensitivity = np.abs(1 / (1 + K.response(omega) * P.response(omega))).max()
    assert sensitivity <= margins.sensitivity < 1.3 * sensitivity
    for gain in margins.gain:
        edge = gain * (1.001 if gain < 1 else 0.999)
        assert stabilises(
            control.Transfer([edge * float(c) for c in K.numerator], K.denominator), P
        )
    step = control.loop_step(found, 40)
    response = control.references.closed_loop(K, P).simulate(np.ones(40))
    assert np.all(step.low <= response) and np.all(response <= step.high)
    assert np.all(step.high - step.low < 0.2)


def test_wrong_input_is_refused() -> None:
    data, bound = experiment(60.0)
    for wrong in ({"margin": 1.5}, {"method": "lyapunov"}, {"integrators": 2}):
        with pytest.raises(setid.SetidError, match="found"):
            control.stability_certificate(data, K, M, 4, bound, delay=1, **wrong)
    with pytest.raises(setid.NoiseError, match="input"):
        control.stability_certificate(data, K, M, 4, setid.Noise(output=bound, input=0.1))
    with pytest.raises(setid.ModelError, match="Ts"):
        control.stability_certificate(data, control.Transfer([1], [1], 0.5), M, 4, bound)


@pytest.mark.slow
def test_report_is_one_page_with_pictures(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib.pyplot").switch_backend("Agg")
    data, bound = experiment(60.0)
    options = setid.Options(time_limit=1.0, progress=False)
    found = control.design(data, M, control.LTI(4), bound, options=options)
    answer = certified(60.0, "small_gain")
    page = tmp_path / "page.html"
    control.report(page, found, [answer])
    text = page.read_text(encoding="utf-8")
    assert "certified" in text and text.count("<img") == 2 and "<pre>" in text
    limits = {"rise": (4.0, 3.25)}
    control.report(page, found, [], control.SpecifiedModel(M, 1.0, limits))
    text = page.read_text(encoding="utf-8")
    assert "rise: asked for at most 4, the reference model has 3.25" in text
    with pytest.raises(setid.SetidError, match="design"):
        control.report(page, answer, [])  # type: ignore[arg-type]
    with pytest.raises(setid.SetidError, match="specified"):
        control.report(page, found, [], M)  # type: ignore[arg-type]


def test_pages_are_refused_before_the_work(tmp_path: Path) -> None:
    plant, reference = control.Transfer([0, 1], [1, -0.5]), control.Transfer([0, 0.4], [1, -0.6])
    r = np.random.default_rng(0).uniform(-1, 1, 8)
    data, page = setid.IOData(r, plant.simulate(r)), tmp_path / "page.html"
    at_once = setid.Options(time_limit=1e-3, progress=False)
    found = control.design(data, reference, control.LTI(1), 1e-3, options=at_once)
    for bad in (None, found, 3):
        with pytest.raises(setid.SetidError, match="certificates: found"):
            control.report(page, found, bad)  # type: ignore[arg-type]
    with pytest.raises(setid.SetidError, match=r"certificates\[0\]: found str"):
        control.report(page, found, ["x"])  # type: ignore[list-item]
    for path in (None, tmp_path / "none" / "page.html", tmp_path):
        with pytest.raises(SparsePOPError):
            control.report(path, found, [])  # type: ignore[arg-type]
    assert not any(tmp_path.iterdir())


def test_pictures() -> None:
    plt = pytest.importorskip("matplotlib.pyplot")
    plt.switch_backend("Agg")
    found = certified(60.0, "small_gain")
    axes = found.plot()
    assert "certified" in axes.get_title()
    control.plots.plot_loop_step(control.loop_step(found, 10))
    control.plots.plot_matching(control.check_matching(P, K, M))
    plt.close("all")


@pytest.mark.parametrize("bound", [0.0, 1e-300, 1e-160, 1e-12])
def test_records_without_noise_have_certificates_and_controllers(bound: float) -> None:
    # y_k = .5 y_{k-1} + r_{k-1} with halves: doubles without rounding for 20 samples
    r = np.random.default_rng(0).choice([-1.0, 1.0], 20)
    plant, M = control.Transfer([0, 1], [1, -0.5]), control.Transfer([0, 0.5], [1, -0.5])
    data = setid.IOData(r, plant.simulate(r))
    K = control.ideal_controller(plant, M)
    for method in ("small_gain", "characteristic"):
        answer = control.stability_certificate(
            data, K, M, 1, bound, method=method, delay=1, time_limit=3.0
        )
        assert answer.verdict == "certified" and answer.verify()
    low, high = answer.parameters.box
    assert np.all(low <= [-0.5, 1.0]) and np.all([-0.5, 1.0] <= high)
    options = setid.Options(time_limit=2.0, progress=False)
    found = control.design(data, M, control.LTI(1), bound, options=options)
    for name, value in {"a1": -1.0, "b0": 0.5, "b1": -0.25}.items():  # K of s = K y
        assert found.intervals[name].outer[0] <= value <= found.intervals[name].outer[1]


def test_noise_beyond_all_sense_leaves_the_verdict_open() -> None:
    r = np.random.default_rng(0).uniform(-1, 1, 20)
    plant, M = control.Transfer([0, 1], [1, -0.5]), control.Transfer([0, 0.5], [1, -0.5])
    data = setid.IOData(r, plant.simulate(r))
    K = control.ideal_controller(plant, M)
    answer = control.stability_certificate(data, K, M, 1, 1e300, delay=1, time_limit=1.0)
    assert answer.verdict == "open" and "the noise is strong" in answer.reason


@pytest.mark.parametrize("gain", [0.0, 0.1])
def test_small_gain_without_an_integrator_is_decided_in_rationals(gain: float) -> None:
    """M(1) = 1 and F(1) = K(1) (1 - M(1)) = 0, so that Delta(1) = M(1) - F(1) P(1) = 1."""
    plant, M = control.Transfer([0, 0.5, 0.2], [1, -1.2, 0.4]), control.reference_model(rise=4.0)
    r = np.random.default_rng(0).uniform(-1, 1, 60)
    data, K = setid.IOData(r, plant.simulate(r)), control.Transfer([gain], [1])
    found = control.stability_certificate(data, K, M, 2, 0.002, delay=1)
    assert found.verdict == "open" and found.conditions[2].holds is False
    assert found.reason.startswith("3 (max abs(Delta) < 1) fails: at z = 1 F is zero")
    assert found.help == ("method='characteristic': it asks for less than small gain",)
    assert found.verify() and found.cells == 0
    Delta = M - K * (1 - M) * plant
    assert sum(Delta.numerator) == sum(Delta.denominator)
    other = control.stability_certificate(data, K, M, 2, 0.002, None, "characteristic", delay=1)
    assert other.verdict == "certified"


def test_small_gain_with_a_reference_model_that_integrates_is_refused() -> None:
    """M has no gain at z = 1; that it is not stable is said first."""
    rng = np.random.default_rng(0)
    data = setid.IOData(rng.uniform(-1, 1, 40), rng.uniform(-1, 1, 40))
    found = control.stability_certificate(data, ([0.0], [1.0]), ([0, 1.0], [1, -1.0]), 1, 0.5)
    assert found.verdict == "open" and found.reason.endswith("M is not stable")


def test_wrong_orders_and_tolerances_are_named() -> None:
    data = setid.IOData(np.arange(20.0) % 3, np.arange(20.0) % 5)
    K, M = control.Transfer([0.1], [1, -1]), control.reference_model(rise=4.0)
    with pytest.raises(setid.ModelError, match="plant_order: found str, .* a TransferFunction"):
        control.stability_certificate(data, K, M, "two", 0.1)
    with pytest.raises(setid.ModelError, match="snap: found 2"):
        control.stability_certificate(data, K, M, 2, 0.1, snap=2)


@pytest.mark.parametrize(
    ("scale", "noise", "order"),
    [(1e-300, setid.Noise(0.0, equation=0.01), 1), (1e-150, setid.Noise(1e300), 0)],
)
def test_signals_far_below_their_noise_certify_nothing(
    scale: float, noise: setid.Noise, order: int
) -> None:
    """Squares that vanish or overflow were once errors and warnings of numpy."""
    u = scale * np.random.default_rng(0).uniform(-1, 1, 12)
    K = control.Transfer([1], [1, -1, 1, -1])  # poles on the circle: P = 0 is consistent
    answer = control.stability_certificate(
        setid.IOData(u, 0 * u), K, ([0, 0.4], [1, -0.6]), order, noise, method="characteristic",
        time_limit=0.3,
    )  # fmt: skip
    assert answer.verdict != "certified" and answer.verify()
