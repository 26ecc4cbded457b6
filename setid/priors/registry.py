"""Priors by name: one file and one line add one.

A prior is any class with what :class:`setid.priors.base.Prior` asks for (deriving from
:class:`setid.priors.base.Plain` gives the methods that it does not need);
:func:`setid.formulate` takes it as it is. Registered priors may also be written as text, as the
command line takes them: ``--prior "DCGain(0.9, 1.1)"``.
"""

from __future__ import annotations

import ast
import inspect
from typing import Any

from setid.errors import PriorError
from setid.priors.base import Prior
from setid.priors.coefficients import Box, Known, Sign
from setid.priors.physical import Physical
from setid.priors.transfer import DCGain, MinimumPhase, PoleIn, Stable, ZeroIn

__all__ = ["read_prior", "register_prior"]

_KINDS: dict[str, type[Prior]] = {}


def register_prior(kind: type[Prior]) -> None:
    """Make a prior known by the name of its class.

    Parameters
    ----------
    kind : type
        The class of the prior.

    Raises
    ------
    PriorError
        If the class lacks a method, or the name belongs to another class.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import setid, sparsepop_py as sp
    >>> from setid.priors.base import Plain, named
    >>> @dataclass(frozen=True)
    ... class SumAtMost(Plain):
    ...     limit: float  # of the sum of all parameters
    ...
    ...     def rows(self, model, x, facts):
    ...         return named([self.limit - sp.total(x[n] for n in model.parameters) >= 0], "sum")
    >>> setid.register_prior(SumAtMost)
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> known = data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5)
    >>> setid.identify(*known).intervals["b0"]
    b0 in [1.91666, 2.10931], attained [1.91667, 2.1093], certified
    >>> setid.identify(*known, setid.read_prior("SumAtMost(1.5)")).intervals["b0"]
    b0 in [1.91666, 2], attained [1.91667, 1.99999], certified
    """
    if not (isinstance(kind, type) and issubclass(kind, Prior)):
        name = getattr(kind, "__name__", type(kind).__name__)
        raise PriorError(
            f"register_prior: found {name}, expected a class with the methods of Prior"
        )
    known = _KINDS.get(kind.__name__)
    if known is not None and known.__module__ != kind.__module__:
        raise PriorError(
            f"register_prior: found {kind.__name__!r}, which is {known.__module__}."
            f"{kind.__name__} already; expected another name"
        )
    _KINDS[kind.__name__] = kind


def read_prior(text: str) -> Prior:
    """Read a prior that is written as a call with numbers and texts.

    Parameters
    ----------
    text : str
        Such as ``"Stable(margin=0.05)"`` or ``"Box({'a1': (-1, 1)})"``. Nothing is evaluated
        but literals.

    Returns
    -------
    Prior
        To be given to :func:`identify` and :func:`formulate`.

    Raises
    ------
    PriorError
        If the text is no such call, or its name is not registered.

    Examples
    --------
    >>> import setid
    >>> setid.read_prior("Stable(margin=0.05)")
    Stable(margin=0.05)
    """
    if not isinstance(text, str):
        raise PriorError(f"prior: found {text!r:.60}, expected a text")
    try:
        call = ast.parse(text.strip(), mode="eval").body
    except SyntaxError:
        call = None
    if isinstance(call, ast.Name):
        call = ast.Call(call, [], [])
    if not isinstance(call, ast.Call) or not isinstance(call.func, ast.Name):
        raise PriorError(f"prior: found {text!r}, expected a call such as 'Stable(margin=0.05)'")
    if call.func.id not in _KINDS:
        raise PriorError(f"prior: found {call.func.id!r}, expected one of {', '.join(_KINDS)}")
    kind: Any = _KINDS[call.func.id]
    try:
        given = [ast.literal_eval(item) for item in call.args]
        named = {str(item.arg): ast.literal_eval(item.value) for item in call.keywords}
        takes = inspect.signature(kind)
        if not _fits(takes, given, named):
            bare = [item.replace(annotation=item.empty) for item in takes.parameters.values()]
            raise TypeError(f"expected {call.func.id}({', '.join(map(str, bare))})")
        prior: Prior = kind(*given, **named)
    except PriorError:
        raise
    except (ValueError, TypeError) as error:
        why = str(error)
        if why.startswith("malformed node"):  # a message of ast, about objects of its own
            why = "expected numbers, texts in quotes, None, and lists, tuples and dicts of these"
        raise PriorError(f"prior: found {text!r}, which cannot be read: {why}") from None
    return prior


def _fits(takes: inspect.Signature, given: list[Any], named: dict[str, Any]) -> bool:
    """Check that arguments are those of a call."""
    try:
        takes.bind(*given, **named)
    except TypeError:
        return False
    return True


for _kind in (Box, DCGain, Known, MinimumPhase, Physical, PoleIn, Sign, Stable, ZeroIn):
    register_prior(_kind)
