"""Terms that are left out, and what the width of intervals is due to."""

from __future__ import annotations

import numpy as np

import setid

BOUND = 0.02


def record(samples: int = 120) -> setid.IOData:
    """y = 0.5 y' + u' - 0.4 u'^2 with equation errors."""
    truth = setid.PolynomialNARX(["y1", "u1", "u1^2"], ny=1, nu=1)
    u = np.random.default_rng(1).uniform(-1, 1, samples)
    noise = setid.Noise(equation=BOUND)
    return setid.simulate_record(truth, [0.5, 1.0, -0.4], u, noise, 1).data


def full(order: int, degree: int) -> setid.PolynomialNARX:
    return setid.PolynomialNARX.full(degree, order, order)


def test_idle_terms_are_removed_and_the_loop_runs_again() -> None:
    found = setid.select(record(), full, setid.Noise(equation=BOUND), [1], [2], remove_idle=True)
    assert found.result is not None and found.steps[0].decision == "kept"
    assert set(found.result.intervals) == {"c[y1]", "c[u1]", "c[u1^2]"}
    assert all(text.startswith("needed") for text in found.coefficients.values())
    assert any("without" in step.reason for step in found.steps[1:])
    assert found.result.verify()


def test_needed_terms_stay_even_if_their_interval_holds_zero() -> None:
    u = np.array([1.0, 1.0, 2.0, 2.0, -1.0, -1.0])
    y = np.array([0.0, 0.1, 0.1, 0.2, 0.2, -0.1])
    model = setid.PolynomialNARX(["u1", "1"], ny=0, nu=1)
    data = setid.IOData(u, y)
    found = setid.select(
        data, lambda order, degree: model, setid.Noise(equation=0.12), [1], remove_idle=True
    )
    assert found.result is not None and not found.result.empty
    for step in found.steps[1:]:
        assert step.decision in ("kept", "refuted")


def test_sparse_terms_of_a_large_dictionary_are_proved_to_suffice() -> None:
    model = full(2, 3)
    assert len(model.parameters) == 56  # monomials up to degree 3 in five variables: C(8, 3)
    noise = setid.Noise(equation=BOUND)
    data = record(200)
    gone = setid.sparse_terms(data, model, noise)
    assert not {"c[y1]", "c[u1]", "c[u1^2]"} & set(gone) and len(gone) >= 45
    found = setid.select(data, lambda o, d: model, noise, [2], [3], l1=True, remove_idle=True)
    assert found.result is not None and found.result.verify()
    assert {"c[y1]", "c[u1]", "c[u1^2]"} <= set(found.result.intervals)
    assert found.coefficients["c[u1^2]"] == "needed: its sign is negative, proved"


def test_wide_intervals_are_put_down_to_noise_or_to_structure() -> None:
    noise = setid.Noise(equation=0.6)
    model = {1: ["y1", "u1"], 2: ["y1", "u1", "u1^2"]}

    def family(order: int, degree: int) -> setid.PolynomialNARX:
        return setid.PolynomialNARX(model[min(degree, 2)], ny=1, nu=1)

    poor = setid.select(record(), family, noise, [1], [1, 2], width=0.05)
    assert poor.chosen is not None and poor.chosen.degree == 1
    assert "a higher degree or order pays" in poor.advice and poor.advice in poor.log
    rich = setid.select(record(), family, noise, [1], [2], width=0.05)
    assert "a better sensor" in rich.advice
    fine = setid.select(record(), family, setid.Noise(equation=BOUND), [1], [2], width=0.5)
    assert "as narrow as asked" in fine.advice


def test_transfer_functions_keep_idle_coefficients_at_zero() -> None:
    u = np.random.default_rng(3).uniform(-1, 1, 60)
    noise = setid.Noise(equation=0.05)
    truth = setid.simulate_record(setid.TransferFunction(1, 1, 1), [-0.6, 2.0], u, noise, 3)
    found = setid.select(truth.data, setid.TransferFunction, noise, [1], remove_idle=True)
    assert found.result is not None
    assert found.result.intervals["b0"].outer == (0.0, 0.0)
    assert found.coefficients["b1"].startswith("needed")
