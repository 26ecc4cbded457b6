"""Structures: names, orders, terms, and what is refused."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

import setid
from setid.models.equations import Structure


def test_coefficients_are_named_by_their_lag() -> None:
    names = setid.TransferFunction
    assert names(2, 3).parameters == ("a1", "a2", "b0", "b1", "b2")
    assert names(1, 2, nk=1, offset=True).parameters == ("a1", "b1", "b2", "c")
    assert names(0, 1).parameters == ("b0",)
    common = names(1, 1, 2, inputs=2, common_denominator=True)
    assert common.parameters == ("a1", "b[1,1]2", "b[1,2]2")
    mimo = names([[1, 0], [2, 1]], [[1, 2], [1, 1]], [[0, 1], [1, 0]], 2, 2, offset=True)
    assert mimo.parameters == (
        "a[1,1]1", "a[2,1]1", "a[2,1]2", "a[2,2]1",
        "b[1,1]0", "b[1,2]1", "b[1,2]2", "b[2,1]1", "b[2,2]0", "c[1]", "c[2]",
    )  # fmt: skip
    assert mimo.transfer(2, 1) == mimo.transfer(output=2, input=1)
    assert mimo.transfer(1, 2).delay == 1 and mimo.transfer(1, 2).denominator == ()


@pytest.mark.parametrize(
    ("model", "first"),
    [
        (setid.TransferFunction(2, 3), 3),
        (setid.TransferFunction(1, 2, nk=3), 5),
        (setid.TransferFunction(3, 1), 4),
        (setid.TransferFunction(0, 1), 1),
        (setid.TransferFunction(2, 3, initial="zero"), 1),
        (setid.PolynomialNARX(["y2", "u0"], 2, 0), 3),
        (setid.PolynomialNARX(["y1*u2"], 1, 2), 3),
    ],
)
@pytest.mark.parametrize("noise", [setid.Noise(equation=1.0), setid.Noise(0.1, 0.1)])
def test_rows_start_where_all_lags_lie_in_the_record(model, first: int, noise) -> None:
    data = setid.IOData(np.arange(8.0), np.arange(8.0) ** 2)
    formulation = setid.formulate(data, model, noise)
    rows = formulation.rows
    samples = rows.sample[[name == "y1" for name in rows.equation]]
    assert sorted(set(samples.tolist())) == list(range(first, 9))
    assert formulation.dropped == 0


def test_which_forms_introduce_partial_outputs() -> None:
    def internal(model: setid.TransferFunction) -> list[str]:
        return [e.defines for e in model.equations() if e.defines[0] == "z"]

    assert internal(setid.TransferFunction(1, 1)) == []
    assert internal(setid.TransferFunction(1, 1, inputs=2)) == ["z[1,1]", "z[1,2]"]
    assert internal(setid.TransferFunction(1, 1, outputs=2)) == []
    assert internal(setid.TransferFunction(0, 2, inputs=2)) == []
    assert internal(setid.TransferFunction([[1, 0]], 1, inputs=2)) == ["z[1,1]", "z[1,2]"]
    assert internal(setid.TransferFunction(1, 1, inputs=2, form="direct")) == []
    assert internal(setid.TransferFunction(1, 1, inputs=2, common_denominator=True)) == []
    assert internal(setid.TransferFunction(1, 1, form="partial")) == ["z[1,1]"]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: setid.TransferFunction(-1, 1), "na: found -1, expected an integer >= 0"),
        (lambda: setid.TransferFunction(1, 0), "nb: found 0, expected an integer >= 1"),
        (lambda: setid.TransferFunction(1.5, 1), "na: found 1.5"),
        (lambda: setid.TransferFunction(True, 1), "na: found True"),
        (lambda: setid.TransferFunction([[1, 2]], 1), r"na: found shape \(1, 2\), expected"),
        (lambda: setid.TransferFunction(1, (1, 1)), r"nb: found shape \(2,\), .* and inputs=1"),
        (lambda: setid.TransferFunction(1, 1, inputs=0), "inputs: found 0"),
        (lambda: setid.TransferFunction(1, 1, initial="rest"), "initial: found 'rest'"),
        (lambda: setid.TransferFunction(1, 1, form="sum"), "form: found 'sum'"),
        (
            lambda: setid.TransferFunction([[1, 2]], 1, inputs=2, common_denominator=True),
            "na: found several orders",
        ),
        (lambda: setid.TransferFunction(1, 1).transfer(2, 1), "output, input: found 2, 1"),
        (lambda: setid.TransferFunction(1, 1).transfer(None, 1), "output: found None"),
        (lambda: setid.PolynomialNARX(2, 1, 1), "terms: found"),
        (lambda: setid.PolynomialNARX(["y1"], 1, 1, degree_cut="no"), "degree_cut: found 'no'"),
        (lambda: setid.StaticMap([[]], 2), "StaticMap.arguments: found"),
        (lambda: setid.TransferFunction(1, 1).transfer(1, "u1"), "input: found 'u1'"),
        (lambda: setid.PolynomialNARX([], 1, 1), "terms: found none"),
        (lambda: setid.PolynomialNARX("y1", 1, 1), "terms: found the text 'y1'"),
        (lambda: setid.PolynomialNARX(["y1+u0"], 1, 1), r"terms\[0\]: found 'y1\+u0'"),
        (lambda: setid.PolynomialNARX(["y0"], 1, 1), "expected lags 1..1 and channels 1..1 of y"),
        (lambda: setid.PolynomialNARX(["u2"], 1, 1), "expected lags 0..1"),
        (lambda: setid.PolynomialNARX(["u[2]0"], 1, 1), "channels 1..1 of u"),
        (lambda: setid.PolynomialNARX(["y1*u0", "u0*y1"], 1, 1), r"terms\[1\]: found 'u0\*y1' aga"),
        (lambda: setid.PolynomialNARX([[1, 0]], 1, 1), r"found shape \(2,\), expected text or 3"),
        (lambda: setid.PolynomialNARX([[1, 0, -1]], 1, 1), r"terms\[0\]: found -1"),
        (lambda: setid.PolynomialNARX([["y1"]], 1, 1, outputs=2), "terms: found 1 lists"),
    ],
)
def test_wrong_structures(make, message: str) -> None:
    with pytest.raises(setid.ModelError, match=message):
        make()


def test_terms_as_text_and_as_exponents() -> None:
    text = setid.PolynomialNARX(["1", "y1**2 * u0", "u1"], ny=1, nu=1)
    assert text.regressors == ("y1", "u0", "u1")
    numbers = setid.PolynomialNARX([[0, 0, 0], [2, 1, 0], [0, 0, 1]], ny=1, nu=1)
    assert text == numbers
    assert text.parameters == ("c[1]", "c[y1^2*u0]", "c[u1]")
    two = setid.PolynomialNARX([["y[2]1"], ["u[2]0", "y[1]1"]], 1, 0, inputs=2, outputs=2)
    assert two.parameters == ("c1[y[2]1]", "c2[u[2]0]", "c2[y[1]1]")
    assert len(setid.PolynomialNARX.full(3, 1, 1, constant=False).parameters) == 19  # C(6,3) - 1


def test_products_are_shared_over_lags() -> None:
    model = setid.PolynomialNARX(["y1*u1", "y2*u2", "y1*u1*u2"], 2, 2)
    names = [e.defines for e in model.equations({"y1", "u1"})]
    assert names == ["p[y0*u0]", "p[y0*u0*u1]", "y1"]
    assert [e.defines for e in model.equations({"y1"})] == ["y1"]


def test_structures_keep_the_protocol() -> None:
    for model in (setid.TransferFunction(1, 1), setid.PolynomialNARX(["y1"], 1, 0)):
        assert isinstance(model, Structure)
        assert hash(model) == hash(model)


@pytest.mark.parametrize(
    ("model", "theta"),
    [
        (setid.TransferFunction(2, 3), [-0.9, 0.2, 1.0, 2.0, 3.0]),
        (setid.TransferFunction(2, 1, 1, inputs=2), [-0.9, 0.2, 0.5, 0.1, 2.0, 3.0]),
        (setid.TransferFunction(2, 1, 1, inputs=2, form="direct"), [-0.9, 0.2, 0.5, 0.1, 2.0, 3.0]),
    ],
)
def test_simulation_agrees_with_filters(model, theta) -> None:
    from scipy.signal import lfilter

    u = np.random.default_rng(9).uniform(-1, 1, (30, model.inputs))
    if model.inputs == 1:
        expected = lfilter(theta[2:], [1, *theta[:2]], u[:, 0])
    else:
        expected = lfilter([0, 2.0], [1, -0.9, 0.2], u[:, 0])
        expected = expected + lfilter([0, 3.0], [1, 0.5, 0.1], u[:, 1])
    np.testing.assert_allclose(setid.simulate(model, theta, u).ravel(), expected, atol=1e-12)


def test_simulation_of_a_polynomial_model_by_hand() -> None:
    model = setid.PolynomialNARX(["y1", "y1*u0"], 1, 0)
    found = setid.simulate(model, [0.5, 2.0], [0, 1, 1], equation=[1.0, 0.0, 0.25]).ravel()
    assert found.tolist() == [1.0, 2.5, 6.5]


@pytest.mark.parametrize(
    ("theta", "u", "message"),
    [
        ([1.0], [1, 2], r"theta: found shape \(1,\), expected 2 numbers"),
        ({"a1": 1}, [1, 2], r"theta: found names \['a1'\], expected \['a1', 'b0'\]"),
        ([1.0, 1.0], [[1, 2]], r"u: found shape \(1, 2\), expected \(N, 1\)"),
        ([1.0, 1.0], [1, np.nan], "no NaN"),
    ],
)
def test_wrong_simulations(theta, u, message: str) -> None:
    with pytest.raises(setid.SetidError, match=message):
        setid.simulate(setid.TransferFunction(1, 1), theta, u)


def test_transfer_functions_print_as_they_are_made() -> None:
    TransferFunction = setid.TransferFunction
    assert repr(TransferFunction(2, 3)) == "TransferFunction(na=2, nb=3)"
    for model in (
        TransferFunction(2, 2, 3, offset=True, initial="zero"),
        TransferFunction([[1, 2]], 1, [[0, 1]], inputs=2, form="direct"),
        TransferFunction(2, 1, 1, 2, 2, common_denominator=True),
    ):
        assert eval(repr(model), {"TransferFunction": TransferFunction}) == model


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: setid.TransferFunction(10**400, 1), "na"),
        (lambda: setid.TransferFunction(1, 1, 10**9), "nk"),
        (lambda: setid.TransferFunction(1, 1, inputs=2000, outputs=2000), "inputs, outputs"),
        (lambda: setid.Hammerstein(setid.TransferFunction(1, 1), 10**400), "StaticMap.basis"),
        (lambda: setid.StaticMap("u1", [10**9]), "StaticMap.basis[0]"),
        (lambda: setid.PolynomialNARX.full(5, ny=50, nu=50), "degree"),
        (lambda: setid.PolynomialNARX(["1"], ny=10**9, nu=0), "ny"),
        (lambda: setid.ContinuousTransferFunction(10**9, 0), "n"),
    ],
)
def test_structures_that_no_machine_holds_are_refused(
    make: Callable[[], object], field: str
) -> None:
    with pytest.raises(setid.ModelError, match=f"{re.escape(field)}: found "):
        make()


def test_an_offset_is_added_to_the_output_where_denominators_are_multiplied() -> None:
    """At rest, by hand: y = b1 / (1 + a1) u1 + b2 / (1 + a2) u2 + c."""
    model = setid.TransferFunction(1, 1, 1, inputs=2, offset=True, form="multiplied")
    values = dict(zip(model.parameters, (-0.5, 0.25, 2.0, 3.0, 7.0), strict=True))
    signals = {"u1": 1.5, "u2": -2.0, "y1": 2.0 / 0.5 * 1.5 + 3.0 / 1.25 * -2.0 + 7.0}
    (equation,) = model.equations()
    left = sum(
        term.coefficient
        * np.prod([values[name] for name in term.parameters])
        * np.prod([signals[lagged.signal] for lagged in term.signals])
        for term in equation.terms
    )
    assert abs(left) < 1e-12


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda u: 1 / 0, ": raised ZeroDivisionError"),
        (lambda u, v: u, ": raised TypeError"),
        (lambda u: None, ": "),
        (lambda u: 1.0, ": found values of shape"),
        (lambda u: u[:-1], ": found values of shape"),
        (lambda u: np.full(u.shape, np.inf), ": value: found an infinite"),
    ],
)
def test_functions_of_maps_that_raise_or_return_nonsense_are_named(
    function: Callable[..., object], message: str
) -> None:
    linear = setid.TransferFunction(1, 1, 1)
    model = setid.Hammerstein(linear, [1, function], normalise="gamma1")
    data = setid.IOData([1.0, 2.0, 3.0, 4.0], [0.0, 1.0, 2.0, 3.0])
    with pytest.raises(setid.ModelError, match=rf"^StaticMap.basis\[1\]{message}"):
        setid.formulate(data, model, setid.Noise(output=0.1))
