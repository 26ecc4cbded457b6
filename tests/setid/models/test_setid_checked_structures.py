"""Structures from outside are checked where they come in, and wrong ones are named."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
import pytest

import setid
from setid.errors import EmptySetError
from setid.models.checked_structures import (
    check_structure,
    coefficients_of,
    equations_of,
    regression_of,
)
from setid.models.equations import Equation, Lagged, Term, Transfer, term
from setid.models.registry import family_of

Y, U = Lagged("y1"), Lagged("u1", 1)
FIRST, OLD, DRIVE = term(1.0, "", Y), term(0.5, "a", Lagged("y1", 1)), term(-1.0, "b", U)
LINEAR = (Equation("y1", (FIRST, OLD, DRIVE), error=True),)
DATA = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])


def plugged(equations: Any = LINEAR, regression: Any = (), **fields: Any) -> Any:
    """Make a structure that answers what is given, or asks it where it is a function."""

    class Own:
        inputs = outputs = 1
        initial = "free"
        parameters = ("a", "b")

        def equations(self, noisy: Any = ()) -> Any:
            return equations(noisy) if callable(equations) else equations

        def regression(self) -> Any:
            return regression() if callable(regression) else regression

        def transfer(self, output: int, input: int) -> Any:
            return fields["answer"]

    for name, value in fields.items():
        setattr(Own, name, value)
    return Own()


def of(*terms: Any, **fields: Any) -> tuple[Equation, ...]:
    return (Equation("y1", (FIRST, *terms), **({"error": True} | fields)),)


def raising(error: BaseException) -> Callable[..., Any]:
    def answer(*given: Any) -> Any:
        raise error

    return answer


@pytest.mark.parametrize(
    ("equations", "message"),
    [
        (None, "found NoneType, expected a tuple of Equation"),
        (LINEAR[0], "found Equation"),
        (("y1",), "found tuple with str"),
        ((), "found 0 equations of y1, expected one"),
        (LINEAR + LINEAR, "found 2 equations of y1, expected one"),
        ((*LINEAR, Equation("y2", (term(1.0, "", Lagged("y2")),))), "found an equation of 'y2'"),
        ((Equation("u1", (term(1.0, "", Lagged("u1")),)), *LINEAR), "found an equation of 'u1'"),
        ((Equation("eta", (term(1.0, "", Lagged("eta")),)), *LINEAR), "equation of 'eta'"),
        ((Equation("a", (term(1.0, "", Lagged("a")),)), *LINEAR), "equation of 'a'"),
        (2 * (Equation("z", (term(1.0, "", Lagged("z")),)),) + LINEAR, "equation of 'z'.* once"),
        ((Equation("z", (term(1.0, "", Lagged("z")),), error=True), *LINEAR), "found error=True"),
        (of(DRIVE, error=1), "found error=1"),
        (of(DRIVE, differences=-1), "found differences=-1"),
        (of("b u"), "term 2: found str, expected a Term"),
        (of(term(float("nan"), "b", U)), "term 2: found the coefficient nan"),
        (of(term(float("inf"), "b", U)), "found the coefficient inf"),
        (of(term(2**53 + 1, "b", U)), "found the coefficient 9007199254740993"),
        (of(term(10**400, "b", U)), "found the coefficient 1000"),
        (of(term("1", "b", U)), "found the coefficient '1'"),  # type: ignore[arg-type]
        (of(term(1j, "b", U)), "found the coefficient 1j"),  # type: ignore[arg-type]
        (of(term(1.0, "c", U)), "found the parameters .'c',., expected a tuple from a, b"),
        (of(Term(1.0, "ab", (U,))), "found the parameters 'ab'"),  # type: ignore[arg-type]
        (of(Term(1.0, ("b",), ("u1",))), "found the signals .'u1',."),  # type: ignore[arg-type]
        (of(term(1.0, "b", Lagged("u2"))), "found the signal 'u2'"),
        (of(term(1.0, "b", Lagged("y0"))), "found the signal 'y0'"),
        (of(term(1.0, "b", Lagged("w"))), "found the signal 'w'"),
        (of(term(1.0, "b", Lagged("u1", -1))), "found the lag -1 of u1"),
        (of(term(1.0, "b", Lagged("u1", 0.5))), "found the lag 0.5"),  # type: ignore[arg-type]
        (of(term(1.0, "b", Lagged("u1", 10**5 + 1))), "found the lag 100001"),
        (of(term(1.0, "b", Lagged(["u1"], 1))), "found the signal .'u1'."),  # type: ignore[arg-type]
        (of(term(1.0, "", Y)), "found y1 at lag 0 without a parameter"),
        (of(term(1.0, "b", Y, Y)), "found a product with y1 at lag 0"),
        (lambda noisy: of(term(1.0, "c", U)) if noisy else LINEAR, "found the parameters"),
    ],
)
def test_wrong_equations_are_named(equations: Any, message: str) -> None:
    with pytest.raises(setid.ModelError, match=f"Own.equations.*{message}"):
        setid.formulate(DATA, plugged(equations), setid.Noise(output=0.1))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"initial": "frei"}, "Own.initial: found 'frei', expected 'free' or 'zero'"),
        ({"parameters": ["a", "b"]}, "Own.parameters: found .'a', 'b'., expected a tuple"),
        ({"parameters": "ab"}, "Own.parameters: found 'ab'"),
        ({"parameters": ()}, "Own.parameters"),
        ({"parameters": ("a", "b", "a")}, "Own.parameters"),
        ({"parameters": property(raising(KeyError("why")))}, "raised KeyError"),
        ({"inputs": 1.0}, "Own.inputs: found 1.0, expected an integer >= 1"),
        ({"outputs": 0}, "Own.outputs: found 0"),
        ({"inputs": 10**9}, "Own.inputs: found 1000000000"),
    ],
)
def test_wrong_fields_are_named(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(setid.ModelError, match=message):
        check_structure(plugged(**fields))


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (IndexError("why"), "Own.equations: raised IndexError: why"),
        (EmptySetError("why"), "Own.equations: raised EmptySetError: why"),
        (setid.ModelError("why"), "^why$"),
    ],
)
@pytest.mark.parametrize(
    "call",
    [
        lambda model: setid.identify(DATA, model, setid.Noise(equation=0.1)),
        lambda model: setid.simulate(model, [0.1, 0.2], [1.0, 2.0]),
        lambda model: setid.fit(DATA, model),
    ],
)
def test_what_a_structure_raises_is_its_own(
    call: Callable[[Any], Any], error: Exception, message: str
) -> None:
    with pytest.raises(setid.ModelError, match=message) as caught:
        call(plugged(raising(error)))
    assert type(caught.value) is setid.ModelError
    assert error in (caught.value, caught.value.__cause__)


# ---- rows of one system must not bound the parameters of another ------------------------

PRODUCT = Equation("z", (term(1.0, "", Lagged("z")), term(-2.0, "", U, Lagged("y1", 1))))
BY_SIGNAL = (PRODUCT, *of(OLD, term(-1.0, "b", Lagged("z", 1))))
PUT_IN = of(OLD, term(-2.0, "b", Lagged("u1", 2), Lagged("y1", 2)))


@pytest.mark.parametrize(
    ("equations", "regression"),
    [
        (LINEAR, LINEAR),
        (LINEAR, ()),
        (BY_SIGNAL, PUT_IN),
        (lambda noisy: BY_SIGNAL if noisy else PUT_IN, PUT_IN),
    ],
)
def test_regression_follows_from_equations(equations: Any, regression: Any) -> None:
    model = plugged(equations, regression)
    check_structure(model)
    assert regression_of(model) == regression


@pytest.mark.parametrize(
    ("equations", "regression", "message"),
    [
        (LINEAR, of(OLD, term(-2.0, "b", U)), "is not the one"),
        (LINEAR, of(OLD), "is not the one"),
        (LINEAR, of(DRIVE, OLD), "is not the one"),  # another order adds readings up otherwise
        (LINEAR, of(OLD, DRIVE, error=False), "is not the one"),
        (BY_SIGNAL, of(OLD, term(-1.0, "b", Lagged("u1", 2), Lagged("y1", 2))), "is not the one"),
        (lambda noisy: LINEAR if noisy else PUT_IN, PUT_IN, "is not the one"),
        (of(Term(1.0, ("a", "b"), (U,))), of(Term(1.0, ("a", "b"), (U,))), "product of parameters"),
        (LINEAR, LINEAR * 2, "found 2 equations of y1"),
        (LINEAR, (PRODUCT, *LINEAR), "found an equation of 'z'"),
        (LINEAR, None, "found NoneType"),
        (LINEAR, raising(ZeroDivisionError("why")), "raised ZeroDivisionError: why"),
    ],
)
def test_other_regressions_are_refused(equations: Any, regression: Any, message: str) -> None:
    model = plugged(equations, regression)
    with pytest.raises(setid.ModelError, match=f"Own.regression.*{message}"):
        setid.formulate(DATA, model, setid.Noise(output=0.1))


@pytest.mark.parametrize(
    ("own", "put_in"),
    [
        (term(-1.0, "b", U), term(-1.0, "", U)),
        (term(-1.0, "", Lagged("z", 1)), term(-1.0, "", U)),
        (term(-1.0), term(-1.0)),  # before the record it is zero, not one
    ],
)
def test_a_signal_with_parameters_or_a_constant_is_not_put_in(own: Term, put_in: Term) -> None:
    inner = Equation("z", (term(1.0, "", Lagged("z")), own))
    stated = (inner, *of(term(-1.0, "", Lagged("z"))))
    with pytest.raises(setid.ModelError, match="is not the one"):
        regression_of(plugged(stated, of(put_in)))


def test_regressions_with_too_many_terms_to_compare_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("setid.models.checked_structures._MOST", 2)
    other = of(OLD, term(-2.0, "b", U))
    with pytest.raises(setid.ModelError, match="is not the one"):
        regression_of(plugged(LINEAR, other))


def test_structures_of_the_package_with_other_methods_are_refused() -> None:
    class Other(setid.TransferFunction):
        def equations(self, noisy: Any = ()) -> Any:
            return LINEAR

    class Renamed(setid.TransferFunction):
        parameters = ("p", "q")  # type: ignore[assignment]

    class Kept(setid.TransferFunction):
        parameters = cached_property(lambda self: ("p", "q"))  # type: ignore[assignment]

    class Inputs(setid.TransferFunction):
        inputs = cached_property(lambda self: 2)  # type: ignore[assignment]

    class Named(setid.TransferFunction):
        initial = "zero"  # a default that is not used: the fields are those of the instance

        def note(self) -> str:
            return "of use"

    with pytest.raises(setid.ModelError, match="Other, a TransferFunction with its own equations"):
        setid.formulate(DATA, Other(1, 1), setid.Noise(output=0.1))
    for wrong in (Renamed, Kept, Inputs):
        with pytest.raises(setid.ModelError, match=f"found {wrong.__name__}, a TransferFunction"):
            check_structure(wrong(1, 1))
    check_structure(Named(1, 1))


def test_equations_that_change_are_checked_again() -> None:
    given = iter([LINEAR] * 2 + [of(term(1.0, "c", U))])
    model = plugged(lambda noisy: next(given))
    check_structure(model)
    with pytest.raises(setid.ModelError, match="found the parameters"):
        equations_of(model)


# ---- transfer functions and families ----------------------------------------------------

GOOD = of(term(1.0, "a", Lagged("y1", 1)), DRIVE)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (Transfer(("b",), ("a",), 1), None),
        (Transfer(("b",), ("a",), 2), "found no coefficient"),
        (Transfer(("a",), ("b",), 1), "found no coefficient"),
        (Transfer(("b",), (), 1), "found no coefficient"),
        (Transfer(("b", "b"), ("a",), 1), "found no term"),
        (Transfer(("b",), ("c",), 1), "found the denominator .'c',."),
        (Transfer(["b"], ("a",), 1), "found the numerator"),  # type: ignore[arg-type]
        (Transfer((["b"],), ("a",), 1), "found the numerator"),  # type: ignore[arg-type]
        (Transfer(("b",), ("a",), -1), "found the delay -1"),
        (("b",), "found tuple, expected a Transfer"),
    ],
)
def test_transfers_are_those_of_the_equation(answer: Any, message: str | None) -> None:
    model = plugged(GOOD, GOOD, answer=answer)
    if message is None:
        assert coefficients_of(model, 1, 1) == answer
        return
    with pytest.raises(setid.ModelError, match=f"Own.transfer: {message}"):
        setid.formulate(DATA, model, setid.Noise(output=0.1), setid.Stable())


@pytest.mark.parametrize("pair", [(2, 1), (1, 2), (0, 1), (1, -1), (1.0, 1), ("y1", 1)])
def test_channels_are_checked(pair: tuple[Any, Any]) -> None:
    model = plugged(GOOD, GOOD, answer=Transfer(("b",), ("a",), 1))
    with pytest.raises(setid.ModelError, match="(out|in)put: found .*, expected 1 to 1"):
        coefficients_of(model, *pair)


def test_families_are_named_where_they_raise() -> None:
    class Wrong:
        pass

    with pytest.raises(setid.ModelError, match="found str and builtin_function_or_method"):
        setid.register_structure("Wrong", print)  # type: ignore[arg-type]
    setid.register_structure(Wrong, lambda order, degree, inputs, outputs: [][order])
    with pytest.raises(setid.ModelError, match="'Wrong' of order 2 and degree 1: raised IndexErr"):
        setid.select(DATA, "Wrong", setid.Noise(equation=0.1), orders=[2])
    setid.register_structure(Wrong, lambda order, degree, inputs, outputs: np.zeros(order))  # type: ignore[arg-type,return-value]
    family = family_of("Wrong")
    assert family is not None
    with pytest.raises(setid.ModelError, match="found ndarray, expected a structure"):
        family(1, 1, 1, 1)
