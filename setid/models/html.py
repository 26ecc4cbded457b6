"""Structures in notebooks: their equations and parameters."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from setid.errors import ModelError
from setid.html import section, table

if TYPE_CHECKING:
    from setid.models.equations import Equation, Structure, Term

__all__ = ["InNotebook", "equation_text", "equations_html"]


class InNotebook:
    """A structure that notebooks show by its equations."""

    __slots__ = ()

    def _repr_html_(self: Structure) -> str:
        return equations_html(self)


def equations_html(model: Structure, errors: bool = True) -> str:
    """Write the equations of a structure as HTML.

    Parameters
    ----------
    model : Structure
    errors : bool
        Whether equation errors are shown.
    """
    try:
        equations = model.equations()
        shown = equations if errors else [replace(e, error=False) for e in equations]
        rows = [[e.defines, equation_text(e)] for e in shown]
    except ModelError:  # continuous time, and no sampling time yet
        rows = [["", ", ".join(model.parameters)]]
    head = f"{model!r}: {len(model.parameters)} parameters"
    return section(head, table(["signal", "equation"], rows))


def equation_text(equation: Equation) -> str:
    """Write an equation as it gives its signal.

    Parameters
    ----------
    equation : Equation

    Examples
    --------
    >>> import setid
    >>> from setid.models.html import equation_text
    >>> equation_text(setid.TransferFunction(na=1, nb=1, nk=1).equations()[0])
    'y1(k) = -a1 y1(k-1) + b1 u1(k-1) + e1(k)'
    """
    right = [_term(term, -1.0) for term in equation.explicit]
    if equation.error:
        right.append(f"+ e{equation.defines.lstrip('y')}(k)")
    text = " ".join(right).removeprefix("+ ") or "0"
    text = f"-{text.removeprefix('- ')}" if text.startswith("- ") else text
    left = "".join(f" {_term(term, 1.0)}" for term in equation.implicit)
    return f"{equation.defines}(k){left} = {text}"


def _term(term: Term, sign: float) -> str:
    value = sign * term.coefficient
    bare = abs(value) == 1.0 and (term.parameters or term.signals)
    parts = [] if bare else [f"{abs(value):g}"]
    parts += term.parameters
    parts += [f"{s.signal}(k{f'-{s.lag}' if s.lag else ''})" for s in term.signals]
    return f"{'-' if value < 0 else '+'} {' '.join(parts)}"
