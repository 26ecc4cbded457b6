"""Equations of a structure, checked where they come in, since anyone may write structures.

All of :mod:`setid` asks a structure through the functions of this module. A structure that raises
something else than an exception of :mod:`setid`, or states equations that mean nothing, ends in a
:class:`~setid.errors.ModelError` that names it. The regression equations are compared with the
equations: rows of one system must not bound the parameters of another.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from fractions import Fraction
from functools import partial
from numbers import Integral
from types import MemberDescriptorType
from typing import Any, TypeVar, get_args

from setid.data.checks import MOST_TERMS, asked, is_double
from setid.errors import ModelError
from setid.models.equations import Equation, Initial, Lagged, Structure, Term, Transfer

__all__ = ["check_structure", "coefficients_of", "equations_of", "regression_of"]

T = TypeVar("T")
_OWN = "setid.models."  # where structures are that need no check
_WHOLE = f"an integer >= 0, at most {MOST_TERMS}"
_MOST = 10**5  # terms of an equation with internal signals put in
_Word = tuple[tuple[str, ...], tuple[Lagged, ...]]  # parameters and signals


def check_structure(model: Any) -> None:
    """Check that an object is a structure, and what it states.

    Raises
    ------
    ModelError
        If it is none, raises, or states something that means nothing.

    Examples
    --------
    >>> import setid
    >>> check_structure(setid.TransferFunction(na=1, nb=1))
    """
    name = type(model).__name__
    if isinstance(model, type):  # it has the methods too
        raise ModelError(f"model: found the class {model.__name__}, expected a structure")
    if not asked(name, lambda: isinstance(model, Structure), ModelError):
        raise ModelError(f"model: found {name}, expected a structure such as TransferFunction")
    _check_overridden(model)
    if not _plugged(model, "parameters"):
        return
    _check_fields(model)
    equations_of(model)
    equations_of(model, _measured(model))
    regression_of(model)


def equations_of(model: Structure, noisy: Collection[str] = ()) -> tuple[Equation, ...]:
    """Ask a structure for its equations, checked.

    Parameters
    ----------
    model : Structure
    noisy : collection of str
        Measured signals that are not known exactly.

    Raises
    ------
    ModelError
        If the structure raises, or states something else than equations of its outputs.

    Examples
    --------
    >>> import setid
    >>> len(equations_of(setid.TransferFunction(na=1, nb=1)))
    1
    """
    if not _plugged(model, "equations"):
        return tuple(model.equations(noisy))
    return _equations(model, f"{type(model).__name__}.equations", lambda: model.equations(noisy))


def regression_of(model: Structure) -> tuple[Equation, ...]:
    """Ask a structure for its regression equations, which must follow from its equations.

    Parameters
    ----------
    model : Structure

    Raises
    ------
    ModelError
        If the structure raises, or states others than its equations with internal signals put in.

    Examples
    --------
    >>> import setid
    >>> regression_of(setid.TransferFunction(na=1, nb=1, inputs=2))
    ()
    """
    if not _plugged(model, "regression"):
        return tuple(model.regression())
    place = f"{type(model).__name__}.regression"
    found = _equations(model, place, model.regression, none=True)
    for equation in found:
        if not equation.linear_in_parameters:
            raise ModelError(
                f"{place}: found a product of parameters in the equation of {equation.defines}, "
                "expected equations that are linear in them, or ()"
            )
    for noisy in ((), _measured(model)) if found else ():
        own = {e.defines: e for e in equations_of(model, noisy)}
        for equation in found:
            wanted = own.get(equation.defines)
            words, same = (
                _words(equation, {}),
                wanted is not None and equation.error == wanted.error,
            )
            if wanted is None or not same or words is None or words != _words(wanted, own):
                raise ModelError(
                    f"{place}: found an equation of {equation.defines} that is not the one that "
                    f"{type(model).__name__}.equations({list(noisy)}) states with products in "
                    "place of internal signals, expected the same terms in the same order, or ()"
                )
    return found


def coefficients_of(model: Structure, output: int, input: int) -> Transfer:
    """Ask a structure for the coefficients of a transfer function, checked.

    Parameters
    ----------
    model : Structure
    output, input : int
        From 1.

    Raises
    ------
    ModelError
        If the structure raises, or names something else than parameters.

    Examples
    --------
    >>> import setid
    >>> coefficients_of(setid.TransferFunction(na=1, nb=1), 1, 1).denominator
    ('a1',)
    """
    if not _plugged(model, "transfer"):
        return model.transfer(output, input)
    place = f"{type(model).__name__}.transfer"
    for field, number, most in (("output", output, model.outputs), ("input", input, model.inputs)):
        if not _whole(number) or not 1 <= number <= most:
            raise ModelError(f"{field}: found {number!r:.60}, expected 1 to {most}")
    found = asked(place, lambda: model.transfer(output, input), ModelError)
    if not isinstance(found, Transfer):
        raise ModelError(f"{place}: found {type(found).__name__}, expected a Transfer")
    for field in ("numerator", "denominator"):
        names = getattr(found, field)
        if not isinstance(names, tuple) or not all(name in model.parameters for name in names):
            raise ModelError(
                f"{place}: found the {field} {names!r:.60}, expected a tuple of parameters of "
                "the structure"
            )
    if not _whole(found.delay):
        raise ModelError(f"{place}: found the delay {found.delay!r:.60}, expected {_WHOLE}")
    rows = {e.defines: e for e in regression_of(model)}
    if rows and not found.continuous:
        _check_transfer(found, rows[f"y{output}"], f"u{input}", place)
    return found


def _check_transfer(transfer: Transfer, equation: Equation, source: str, place: str) -> None:
    """Compare coefficients with the equation of the output, which has them beside its signals."""
    own, names = equation.defines, transfer.denominator
    past = [Term(1.0, (name,), (Lagged(own, lag),)) for lag, name in enumerate(names, 1)]
    lags = enumerate(transfer.numerator, transfer.delay)
    past += [Term(-1.0, (name,), (Lagged(source, lag),)) for lag, name in lags]
    terms = equation.terms[1:]
    held = [t for t in terms if any(s.signal in (own, source) for s in t.signals)]
    for one, other, missing in ((held, past, "no coefficient"), (past, held, "no term")):
        wrong = next((item for item in one if item not in other), None)
        if wrong is not None or len(one) != len(set(one)):
            raise ModelError(
                f"{place}: found {missing} for {wrong or one}, expected those of the equation "
                f"{own} + sum a {own}(k-i) - sum b {source}(k-j) = ... that the structure states"
            )


# ---- whose it is ------------------------------------------------------------------------


def _plugged(model: Structure, name: str) -> bool:
    """Check that an attribute of a structure comes from outside."""
    kinds = [kind for kind in type(model).__mro__ if kind is not Structure]
    owner = next((kind for kind in kinds if name in vars(kind)), type(model))
    return not owner.__module__.startswith(_OWN)


def _check_overridden(model: Structure) -> None:
    """Refuse structures of this package with other methods: proofs rest on the structure's own."""
    changed = dict[str, Any]()
    for kind in type(model).__mro__:
        if kind.__module__.startswith(_OWN):
            wrong = [name for name, new in changed.items() if _replaces(new, vars(kind).get(name))]
            if wrong and kind is not Structure:
                raise ModelError(
                    f"model: found {type(model).__name__}, a {kind.__name__} with its own "
                    f"{wrong[0]}, expected a {kind.__name__} as it is or a structure of its own"
                )
        else:
            made = {n: value for n, value in vars(kind).items() if not n.startswith("__")}
            changed = made | changed


def _replaces(new: Any, own: Any) -> bool:
    """Check that an attribute of a class hides what a class of this package computes.

    Values of fields belong to instances: those of a class are defaults, which hide nothing.
    """
    if own is None or isinstance(new, MemberDescriptorType):
        return False
    return not isinstance(own, MemberDescriptorType) or hasattr(type(new), "__get__")


# ---- what it says -----------------------------------------------------------------------


def _whole(given: Any) -> bool:
    whole = isinstance(given, Integral) and not isinstance(given, bool)
    return whole and 0 <= int(given) <= MOST_TERMS


def _check_fields(model: Structure) -> None:
    name = type(model).__name__
    for field in ("inputs", "outputs"):
        count: Any = asked(f"{name}.{field}", partial(getattr, model, field), ModelError)
        if not _whole(count) or count < 1:
            raise ModelError(
                f"{name}.{field}: found {count!r:.60}, expected an integer >= 1, at most "
                f"{MOST_TERMS}"
            )
    initial = asked(f"{name}.initial", lambda: model.initial, ModelError)
    if not isinstance(initial, str) or initial not in get_args(Initial):
        raise ModelError(f"{name}.initial: found {initial!r:.60}, expected 'free' or 'zero'")
    names: Any = asked(f"{name}.parameters", lambda: model.parameters, ModelError)
    good = isinstance(names, tuple) and all(isinstance(n, str) and n for n in names)
    if not good or not names or len(set(names)) < len(names):
        raise ModelError(
            f"{name}.parameters: found {names!r:.60}, expected a tuple of distinct names"
        )


def _measured(model: Structure) -> tuple[str, ...]:
    """Names of all measured signals."""
    counts = (("y", model.outputs), ("u", model.inputs))
    return tuple(f"{letter}{i + 1}" for letter, count in counts for i in range(count))


def _equations(
    model: Structure, place: str, question: Callable[[], Any], none: bool = False
) -> tuple[Equation, ...]:
    """Equations that a structure states, checked; with ``none`` in measured signals, or none."""
    given = asked(place, question, ModelError)
    if not isinstance(given, (tuple, list)) or not all(isinstance(e, Equation) for e in given):
        kind = type(given).__name__
        if isinstance(given, (tuple, list)):
            kind = f"{kind} with {next(type(e).__name__ for e in given if type(e) is not Equation)}"
        raise ModelError(f"{place}: found {kind}, expected a tuple of Equation")
    found = tuple(given)
    outputs = [f"y{i + 1}" for i in range(model.outputs)]
    defined = [e.defines for e in found]
    if not (none and not found):
        for output in outputs:
            if defined.count(output) != 1:
                raise ModelError(
                    f"{place}: found {defined.count(output)} equations of {output}, expected one "
                    "equation for each output"
                )
    known = {*outputs, *(f"u{i + 1}" for i in range(model.inputs))}
    for equation in found:
        _check_defined(equation.defines, place, model, known)
        if equation.defines not in outputs:
            if none:
                raise ModelError(
                    f"{place}: found an equation of {equation.defines!r}, expected equations of "
                    "outputs in measured signals, or ()"
                )
            known.add(equation.defines)
        _check_equation(equation, place, model, known, outputs)
    return found


def _check_defined(name: Any, place: str, model: Structure, taken: set[str]) -> None:
    """Check the name of what an equation defines."""
    outputs = {f"y{i + 1}" for i in range(model.outputs)}
    if isinstance(name, str) and name in outputs:
        return
    looks_measured = isinstance(name, str) and name[:1] in ("y", "u") and name[1:].isdigit()
    reserved = {"theta", "eta", "xi", "e", "y", "u", "slack", "lifted", "", *model.parameters}
    if not isinstance(name, str) or name in taken | reserved or looks_measured:
        raise ModelError(
            f"{place}: found an equation of {name!r:.60}, expected one of {sorted(outputs)} or of "
            "an internal signal, once, with a name of its own"
        )


def _check_equation(
    equation: Equation, place: str, model: Structure, known: set[str], outputs: list[str]
) -> None:
    where = f"{place}: equation of {equation.defines}"
    if not isinstance(equation.terms, tuple):
        kind = type(equation.terms).__name__
        raise ModelError(f"{where}: found a {kind}, expected a tuple of Term")
    if not isinstance(equation.error, bool) or (equation.error and equation.defines not in outputs):
        raise ModelError(
            f"{where}: found error={equation.error!r:.60}, expected True for outputs alone, or "
            "False"
        )
    if not _whole(equation.differences):
        raise ModelError(
            f"{where}: found differences={equation.differences!r:.60}, expected {_WHOLE}"
        )
    for number, item in enumerate(equation.terms, 1):
        _check_term(item, f"{where}, term {number}", model, known)
        now = Lagged(equation.defines)
        if number > 1 and now in item.signals and item not in equation.implicit:
            raise ModelError(
                f"{where}, term {number}: found a product with {equation.defines} at lag 0, "
                "expected it with parameters alone, or at lag 1 and more"
            )
        if number > 1 and item.signals == (now,) and not item.parameters:
            raise ModelError(
                f"{where}, term {number}: found {equation.defines} at lag 0 without a parameter, "
                "expected it once"
            )


def _check_term(item: Any, where: str, model: Structure, known: set[str]) -> None:
    if not isinstance(item, Term):
        raise ModelError(f"{where}: found {type(item).__name__}, expected a Term")
    if not is_double(item.coefficient):
        raise ModelError(
            f"{where}: found the coefficient {item.coefficient!r:.60}, expected a finite double"
        )
    names: Any = item.parameters
    if not isinstance(names, tuple) or not all(n in model.parameters for n in names):
        raise ModelError(
            f"{where}: found the parameters {names!r:.60}, expected a tuple from "
            f"{', '.join(model.parameters):.60}"
        )
    signals: Any = item.signals
    if not isinstance(signals, tuple) or not all(isinstance(s, Lagged) for s in signals):
        raise ModelError(f"{where}: found the signals {signals!r:.60}, expected a tuple of Lagged")
    for factor in signals:
        if not isinstance(factor.signal, str) or factor.signal not in known:
            raise ModelError(
                f"{where}: found the signal {factor.signal!r:.60}, expected a measured one or an "
                f"internal one that is defined before, such as {', '.join(sorted(known)):.60}"
            )
        if not _whole(factor.lag):
            raise ModelError(
                f"{where}: found the lag {factor.lag!r:.60} of {factor.signal}, expected {_WHOLE}"
            )


# ---- whether both say the same ----------------------------------------------------------


def _words(equation: Equation, own: dict[str, Equation]) -> list[tuple[_Word, Fraction]] | None:
    """Terms in order, products in place of internal signals; None if some have none."""
    words = list[tuple[_Word, Fraction]]()
    for item in equation.terms:
        parts = _products(item.signals, 0, own, equation.defines)
        if parts is None or len(words) + len(parts) > _MOST:
            return None
        for factor, signals in parts:
            word = tuple(sorted(item.parameters)), tuple(sorted(signals))
            words.append((word, factor * Fraction(float(item.coefficient))))
    return words


def _products(
    signals: Sequence[Lagged], lag: int, own: dict[str, Equation], defined: str
) -> list[tuple[Fraction, list[Lagged]]] | None:
    """A product of signals as a sum of products of measured ones."""
    found: list[tuple[Fraction, list[Lagged]]] = [(Fraction(1), [])]
    for factor in signals:
        later = lag + int(factor.lag)
        inner = own.get(factor.signal)
        if inner is None or inner.output is not None:
            found = [(c, [*rest, Lagged(factor.signal, later)]) for c, rest in found]
            continue
        recursive = any(s.signal == inner.defines for t in inner.terms[1:] for s in t.signals)
        if inner.parametric or recursive or not all(t.signals for t in inner.terms):
            return None
        sums = list[tuple[Fraction, list[Lagged]]]()
        for item in inner.terms[1:]:
            parts = _products(item.signals, later, own, defined)
            if parts is None or len(sums) + len(parts) > _MOST:
                return None
            sums += [(-Fraction(float(item.coefficient)) * c, part) for c, part in parts]
        if len(found) * len(sums) > _MOST:
            return None
        found = [(a * b, [*one, *two]) for a, one in found for b, two in sums]
    return found
