"""The indirect route: inverses undo scipy's discretisation, and nothing is called proved."""

from __future__ import annotations

import numpy as np
import pytest
from continuous_cases import QUICK, THETA, exact_samples, levels, noisy
from identified_cases import result_of
from scipy.signal import cont2discrete

import setid
from setid.export.continuous import _inverse_matched, _inverse_zoh
from setid.proofs.intervals import IntervalStatus, ParameterInterval


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_inverse_zoh_undoes_the_hold(n: int, seed: int) -> None:
    rng = np.random.default_rng(100 * n + seed)
    poles = -rng.uniform(0.2, 3.0, n).astype(complex)
    if n >= 2:
        poles[:2] = -0.7 + 1.1j, -0.7 - 1.1j
    bottom = np.real(np.poly(poles))
    top = rng.normal(size=n + 1 if seed % 2 else n)
    numerator, denominator, _ = cont2discrete((top, bottom), 0.3, method="zoh")
    found = _inverse_zoh(numerator.ravel().tolist(), denominator.tolist(), 0.3)
    assert found is not None
    np.testing.assert_allclose(found[1], bottom, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(found[0], top, rtol=1e-5, atol=1e-6)


def test_matched_keeps_poles_zeros_and_the_static_gain() -> None:
    poles, zero, Ts = np.array([-1.0, -2.0]), -0.5, 0.2
    denominator = np.poly(np.exp(poles * Ts))
    numerator = 3.0 * np.poly([np.exp(zero * Ts), -0.9])  # -0.9 comes from sampling
    found = _inverse_matched(numerator.tolist(), denominator.tolist(), Ts)
    assert found is not None
    np.testing.assert_allclose(found[1], np.poly(poles), rtol=1e-9)
    np.testing.assert_allclose(np.roots(found[0]), [zero], rtol=1e-9)
    gain = numerator.sum() / denominator.sum()
    assert found[0][-1] / found[1][-1] == pytest.approx(gain)


@pytest.mark.parametrize("convert", [_inverse_zoh, _inverse_matched])
def test_a_negative_pole_has_no_image(convert) -> None:
    assert convert([0.0, 1.0], [1.0, 0.5], 1.0) is None
    assert convert([0.0, 1.0], [1.0, 0.0], 1.0) is None


def test_the_route_from_a_record() -> None:
    u = levels(0.4, 25)
    data = setid.IOData(u, noisy(exact_samples(u, 0.4), 0.002), Ts=0.4)
    model = setid.ContinuousTransferFunction(2, 1, method="indirect", hold="constant")
    result = setid.identify(data, model, setid.Noise(output=0.002), options=QUICK)
    assert list(result.intervals) == ["a1", "a2", "b1", "b2"] and result.verify()
    assert any("do not map to intervals" in note for note in result.notes)
    found = setid.to_continuous(result, samples=20)
    assert found.kind == "sampled" and found.names == ("a1", "a0", "b1", "b0") and not found.failed
    np.testing.assert_allclose(found.nominal, THETA, rtol=0.05)
    assert np.all(found.ranges[:, 0] <= found.nominal) and "not proved" in found.table()
    assert found.ranges.shape == (4, 2) and len(found.members) >= 1
    matched = setid.to_continuous(result, "matched", samples=5)
    np.testing.assert_allclose(matched.nominal[:2], found.nominal[:2], rtol=1e-6)


@pytest.mark.parametrize("method", ["zoh", "matched"])
def test_a_static_gain_is_its_own_image(method) -> None:
    """y_k = 2 u_k with abs(e) <= .1: b0 is in [1.975, 2.025], by u = 4."""
    model, noise = setid.TransferFunction(0, 1, 0), setid.Noise(equation=0.1)
    result = setid.identify(setid.IOData([1, 2, 3, 4], [2, 4, 6, 8]), model, noise)
    found = setid.to_continuous(result, method)
    assert found.names == ("b0",) and not found.failed
    assert found.nominal == pytest.approx(2.0)
    assert found.ranges == pytest.approx(np.array([[1.975, 2.025]]), abs=1e-5)


def test_what_has_no_image_is_refused() -> None:
    data = setid.IOData([1, 2, 3, 1], [0, 1, 1, 2])

    def result(model: setid.TransferFunction, theta: list[float]) -> setid.Identification:
        formulation = setid.formulate(data, model, setid.Noise(output=5.0))
        pairs = zip(formulation.parameters, theta, strict=True)
        partial = IntervalStatus.PARTIAL
        intervals = {n: ParameterInterval(n, (t, t), None, partial) for n, t in pairs}
        return result_of(formulation, intervals)

    negative = result(setid.TransferFunction(1, 1, nk=1), [0.5, 1.0])
    with pytest.raises(setid.SetidError, match="pole at zero or on the negative real axis"):
        setid.to_continuous(negative)
    good = result(setid.TransferFunction(1, 1, nk=1), [-0.5, 1.0])
    with pytest.raises(setid.SetidError, match="method: found 'tustin'"):
        setid.to_continuous(good, "tustin")
    physical = result(setid.ContinuousTransferFunction(1, 0), [1.0, 1.0])
    with pytest.raises(setid.ModelError, match="expected a discrete transfer function"):
        setid.to_continuous(physical)
    wide = setid.TransferFunction(1, 1, inputs=2, common_denominator=True)
    formulation = setid.formulate(
        setid.IOData([[1, 2], [2, 1], [0, 1]], [0.0, 1, 2]), wide, setid.Noise(equation=9.0)
    )
    intervals = {
        n: ParameterInterval(n, (0.0, 0.0), None, IntervalStatus.PARTIAL)
        for n in formulation.parameters
    }
    with pytest.raises(setid.ModelError, match=r"found \(inputs, outputs\) = \(2, 1\), expected"):
        setid.to_continuous(result_of(formulation, intervals))
