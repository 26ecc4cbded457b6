"""The structure loop: refuted structures are left, signs are trusted only where settled."""

from __future__ import annotations

import numpy as np
import pytest
from identification_cases import laboratory_two_second

import setid
from setid.analysis.select import _sign_test
from setid.bounding import methods

QUICK = setid.Options(time_limit=60.0, progress=False)


def test_the_right_order_is_found_and_every_step_is_logged() -> None:
    data = laboratory_two_second(0.5, 60)
    found = setid.select(data, setid.TransferFunction, setid.Noise(equation=0.5), [0, 1, 2, 3])
    assert [step.decision for step in found.steps] == ["refuted", "refuted", "kept"]
    assert found.chosen.order == 2 and found.result is found.chosen.result
    assert found.coefficients["a1"] == "needed: its sign is negative, proved"
    assert found.coefficients["b0"].startswith("idle")
    lines = found.log.splitlines()
    assert len(lines) == 3 + 5 and "proved empty by samples" in lines[0]


def test_degrees_are_raised_before_orders() -> None:
    model = setid.PolynomialNARX(["y1", "u1", "u1^2"], ny=1, nu=1)
    u = np.random.default_rng(1).uniform(-1, 1, 40)
    truth = setid.simulate_record(model, [0.5, 1.0, -0.4], u, setid.Noise(equation=0.02), 1)

    def family(order: int, degree: int) -> setid.PolynomialNARX:
        terms = [f"u1^{d}" if d > 1 else "u1" for d in range(1, degree + 1)]
        return setid.PolynomialNARX(["y1", *terms], ny=order, nu=order)

    found = setid.select(truth.data, family, setid.Noise(equation=0.02), [1, 2], [1, 2, 3])
    assert [(s.order, s.degree, s.decision) for s in found.steps] == [
        (1, 1, "refuted"),
        (1, 2, "kept"),
    ]
    assert all(text.startswith("needed") for text in found.coefficients.values())


def test_output_errors() -> None:
    model, noise = setid.TransferFunction(1, 2), setid.Noise(output=0.05)
    u = np.random.default_rng(3).uniform(-1, 1, 20)
    truth = setid.simulate_record(model, [-0.6, 0.0, 2.0], u, noise, 3)
    found = setid.select(truth.data, setid.TransferFunction, noise, orders=[0, 1], options=QUICK)
    assert found.chosen.order == 1 and found.steps[0].decision == "refuted"


def test_nothing_is_chosen_where_all_is_refuted() -> None:
    found = setid.select(
        laboratory_two_second(0.5, 60), setid.TransferFunction, setid.Noise(equation=0.1), [0, 1]
    )
    assert found.chosen is None and found.result is None and not found.coefficients
    assert found.log.endswith("no structure with consistent parameters was found")


@pytest.mark.parametrize(
    "outer, inner, text",
    [
        ((0.1, 2.0), None, "needed"),
        ((-2.0, -0.1), (-1.0, -0.5), "needed"),
        ((-1.0, 1.0), (-0.5, 0.5), "idle: both signs"),
        ((-1e-9, 1.0), (0.0, 0.9), "idle: zero is attained"),
        ((-1.0, 0.0), (-0.9, 0.0), "idle: zero is attained"),
        ((0.0, 0.0), (0.0, 0.0), "idle: zero is attained"),
        ((-1.0, 1.0), (0.4, 0.6), "open: the gap is 7"),
        ((-0.01, 1.0), (0.1, 0.9), "open: zero"),
        ((-1.0, 1.0), None, "open: no value"),
    ],
)
def test_signs_are_trusted_only_where_settled(outer, inner, text) -> None:
    status = setid.IntervalStatus.PARTIAL
    assert _sign_test(setid.ParameterInterval("a1", outer, inner, status)).startswith(text)


def test_a_coefficient_of_one_sign_is_not_said_to_attain_both() -> None:
    """A prior leaves b1 no negative value."""
    random = np.random.default_rng(0)
    u = random.uniform(-1, 1, 20)
    data = setid.IOData(u, u + random.uniform(-0.1, 0.1, 20))
    found = setid.select(
        data,
        lambda order, degree: setid.TransferFunction(0, 2, 0),
        setid.Noise(equation=0.15),
        [1],
        priors=setid.Box({"b1": (0, 1)}),  # one prior alone
    )
    assert found.result is not None and found.result.intervals["b1"].inner[0] == 0.0
    assert found.coefficients["b1"].startswith("idle: zero is attained")


@pytest.mark.parametrize("priors", [None, -1, 1.5])
def test_priors_that_are_none_are_refused(priors) -> None:
    data, noise = laboratory_two_second(0.5, 20), setid.Noise(equation=0.5)
    model = setid.ContinuousTransferFunction(1, 0, delta="estimate")
    for ask in (
        lambda: setid.select(data, setid.TransferFunction, noise, [1], priors=priors),
        lambda: setid.consistency(data, setid.TransferFunction(1, 1), noise, priors),
        lambda: setid.estimate_delta(data, model, noise, priors),
    ):
        with pytest.raises(setid.PriorError, match="priors: found .*, expected a list of priors"):
            ask()


def test_wrong_input_is_refused() -> None:
    data, noise = laboratory_two_second(0.5, 20), setid.Noise(equation=0.5)
    with pytest.raises(setid.SetidError, match="expected at least one"):
        setid.select(data, setid.TransferFunction, noise, [])
    with pytest.raises(setid.ModelError, match="family: found int"):
        setid.select(data, 3, noise, [1])
    with pytest.raises(setid.ModelError, match="family: found a callable of other arguments"):
        setid.select(data, lambda order: setid.TransferFunction(order, 1), noise, [1])
    with pytest.raises(setid.ModelError, match="family: raised ZeroDivisionError"):
        setid.select(data, lambda order, degree: 1 / 0, noise, [1])


def test_an_interrupt_ends_the_selection(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[object] = []

    def interrupt(*given: object) -> None:
        calls.append(given)
        raise KeyboardInterrupt

    monkeypatch.setattr(methods, "find_box", interrupt)
    u = np.random.default_rng(4).uniform(-1, 1, 12)
    data = setid.IOData(u, np.append(0.0, u[:-1]))
    found = setid.select(data, setid.TransferFunction, setid.Noise(output=0.1), [1, 2, 3])
    assert len(calls) == len(found.steps) == 1 and found.steps[0].result.interrupted
    assert found.chosen is None


def test_an_executor_is_one() -> None:
    data = setid.IOData([1, 0, 2, 1], [0, 1, 0.5, 2])
    with pytest.raises(setid.SetidError, match="expected a concurrent.futures.Executor"):
        setid.select(data, setid.TransferFunction, setid.Noise(output=1), [0], executor="thread")
