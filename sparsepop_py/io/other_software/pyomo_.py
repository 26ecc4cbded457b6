"""The door for Pyomo: a model in, a problem and its variables out.

Pyomo is imported only when a model is handed in. Its solver interface is
:mod:`sparsepop_py.pyomo`.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from types import ModuleType
from typing import Any

from sparsepop_py.algebra.exact_terms import exact_fraction
from sparsepop_py.algebra.polynomial import Constraint, Polynomial, total, variables
from sparsepop_py.errors import ProblemError, SolverNotFound
from sparsepop_py.io.other_software.integers import problem_with_integers
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.rational_problem import RationalProblem

__all__ = ["PyomoModel", "from_pyomo", "read_pyomo", "require_pyomo"]

_KNOWN = frozenset(  # kinds of active components that say nothing beside rows and objective
    "Block BooleanVar BuildAction BuildCheck Constraint ContinuousSet Expression ExternalFunction "
    "Objective Param Port RangeSet Set SetOf Suffix Var".split()
)


def require_pyomo() -> ModuleType:
    """Import ``pyomo.environ``.

    Raises
    ------
    SolverNotFound
        If Pyomo is missing; the message says how to install it.
    """
    try:
        import pyomo.environ as environ
    except ImportError as error:
        raise SolverNotFound("Pyomo is not installed; pip install 'sparsepop-py[pyomo]'") from error
    return environ


@dataclass(frozen=True, eq=False)
class PyomoModel:
    """Problem of a Pyomo model, with the model's own variables.

    Parameters
    ----------
    problem : Problem or RationalProblem
        With further variables, after those of the model, for the bits of integers.
    variables : tuple of pyomo VarData
        Those that are not fixed and occur in an active constraint or the objective, in the order
        in which the model declares them; variable i of ``problem`` is ``variables[i]``.
    """

    problem: Problem | RationalProblem
    variables: tuple[Any, ...]


def from_pyomo(model: Any) -> Problem | RationalProblem:
    """Convert a concrete Pyomo model to a problem.

    Parameters
    ----------
    model : pyomo.environ.ConcreteModel or Block
        Active objective (at most one; none asks for a feasible point) and active constraints,
        polynomials in the variables or ratios of them. Fixed variables and parameters stand for
        their values. Binary variables b add ``b^2 - b == 0``. Integers with two bounds are lower
        bound plus a sum of bits, which are further variables.

    Returns
    -------
    Problem or RationalProblem
        In the variables that occur, by their Pyomo names, as the model declares them. A
        maximisation is stored negated, with ``sense="max"``.

    Raises
    ------
    ProblemError
        Naming the constraint or variable: where something is not polynomial, an integer has no
        bounds, or a component is of a kind that has no polynomial form.
    SolverNotFound
        If Pyomo is not installed.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> import pyomo.environ as pyo
    >>> model = pyo.ConcreteModel()
    >>> model.x = pyo.Var(bounds=(0, 2))
    >>> model.y = pyo.Var()
    >>> model.cost = pyo.Objective(expr=(model.x - 1) ** 2 + model.y)
    >>> model.above = pyo.Constraint(expr=model.x * model.y >= 1)
    >>> print(sp.from_pyomo(model))
    min 1 - 2*x + y + x^2
      s.t. above: -1 + x*y >= 0
      0 <= x <= 2
    """
    return read_pyomo(model).problem


def read_pyomo(model: Any) -> PyomoModel:
    """Convert a model as :func:`from_pyomo`, and keep its variables."""
    environ = require_pyomo()
    _check_model(model, environ)
    objective = _objective(model, environ)
    rows = list(model.component_data_objects(environ.Constraint, active=True, sort=True))
    used = _used(model, [objective, *rows], environ)
    if not used:
        raise ProblemError(
            f"{model.name}: found no variable that is not fixed in the objective or an active "
            "constraint, expected one"
        )
    _check_domains(used)
    x = variables(len(used), [variable.name for variable in used])
    walk = _reader({id(variable): p for variable, p in zip(used, x, strict=True)}, environ)
    constraints = [row for each in rows for row in _rows(each, walk, x[0], environ)]
    cost, sense = _cost(objective, walk, x[0], environ)
    low: list[Any] = [_bound(variable, variable.lb, -math.inf) for variable in used]
    high: list[Any] = [_bound(variable, variable.ub, math.inf) for variable in used]
    whole = [v for v, variable in enumerate(used) if variable.is_integer()]
    names = [variable.name for variable in used]
    if all(isinstance(item, (Polynomial, Constraint)) for item in (cost, *constraints)):
        problem = problem_with_integers(cost, constraints, (low, high), names, whole, sense)
        return PyomoModel(problem, tuple(used))
    binaries = list(_binaries(used, x, whole))
    rational = RationalProblem(cost, [*constraints, *binaries], low, high, names, sense)
    return PyomoModel(rational, tuple(used))


def _binaries(used: list[Any], x: tuple[Polynomial, ...], whole: list[int]) -> Iterator[Constraint]:
    """Write that variables of a model with ratios are binary."""
    for v in whole:
        if not used[v].is_binary() and (used[v].lb, used[v].ub) != (0, 1):
            raise ProblemError(
                f"{used[v].name}: found an integer variable beside ratios, expected binary ones"
            )
        yield _named(x[v] ** 2 - x[v] == 0, f"binary {used[v].name}")


# ---- components -------------------------------------------------------------------------


def _check_model(model: Any, environ: ModuleType) -> None:
    if not all(hasattr(model, name) for name in ("component_data_objects", "is_constructed")):
        raise ProblemError(
            f"model: found {type(model).__name__}, expected a Pyomo model, of pyomo.environ"
        )
    if not model.is_constructed():
        raise ProblemError(
            f"{model.name}: found an abstract model, expected an instance (create_instance)"
        )
    for block in model.block_data_objects(active=True, descend_into=environ.Block):
        for component in block.component_objects(active=True, descend_into=False):
            kind = getattr(component.ctype, "__name__", "")
            if kind not in _KNOWN:
                raise ProblemError(
                    f"{component.name}: found a {kind}, expected variables, constraints and an "
                    "objective that are polynomial"
                )


def _objective(model: Any, environ: ModuleType) -> Any:
    found = list(model.component_data_objects(environ.Objective, active=True))
    if len(found) > 1:
        names = ", ".join(each.name for each in found[:3])
        raise ProblemError(f"{model.name}: found the active objectives {names}, expected one")
    return found[0] if found else None


def _used(model: Any, items: Iterable[Any], environ: ModuleType) -> list[Any]:
    """List the variables that occur and are not fixed, in the order of the model."""
    from pyomo.core.expr.visitor import identify_variables

    found = {
        id(variable): variable
        for item in items
        if item is not None
        for variable in identify_variables(
            item.body if hasattr(item, "body") else item.expr, include_fixed=False
        )
    }
    declared = model.component_data_objects(environ.Var, descend_into=True)
    ordered = [variable for variable in declared if found.pop(id(variable), None) is not None]
    return ordered + list(found.values())  # the last: of other models


def _check_domains(used: Iterable[Any]) -> None:
    """Refuse sets with gaps, which are neither an interval of reals nor one of integers."""
    for variable in used:
        if not variable.is_continuous() and not variable.is_integer():
            raise ProblemError(
                f"{variable.name}: found the domain {variable.domain}, expected an interval of "
                "reals or of integers"
            )


def _bound(variable: Any, bound: Any, otherwise: float) -> float | Fraction:
    if bound is None:
        return otherwise
    if math.isnan(bound):
        raise ProblemError(f"{variable.name}: found a bound that is not a number")
    infinite = isinstance(bound, float) and math.isinf(bound)
    return bound if infinite else _number(bound, variable.name)


def _rows(
    row: Any, walk: Callable[..., Any], some: Polynomial, environ: ModuleType
) -> Iterator[Constraint]:
    body = walk(row.body, f"constraint {row.name}") + 0.0 * some
    low, high = environ.value(row.lower), environ.value(row.upper)
    if any(end is not None and end != end for end in (low, high)):
        raise ProblemError(f"constraint {row.name}: found an end that is not a number")
    if low == math.inf or high == -math.inf:
        raise ProblemError(
            f"constraint {row.name}: found ends {low} and {high}, expected finite ones, or -inf "
            "below and inf above for none"
        )
    if row.equality:
        yield _named(body == low, row.name)
        return
    if low is not None and low > -math.inf:
        yield _named(body >= low, row.name)
    if high is not None and high < math.inf:
        yield _named(body <= high, row.name)


def _named(row: Any, name: str) -> Any:
    object.__setattr__(row, "name", name)
    return row


def _cost(
    objective: Any, walk: Callable[..., Any], some: Polynomial, environ: ModuleType
) -> tuple[Any, Any]:
    if objective is None:
        return 0.0 * some, "min"
    cost = walk(objective.expr, f"objective {objective.name}") + 0.0 * some
    return (-cost, "max") if objective.sense == environ.maximize else (cost, "min")


# ---- expressions ------------------------------------------------------------------------


def _reader(known: dict[int, Polynomial], environ: ModuleType) -> Callable[[Any, str], Any]:
    """Make a function from expressions to polynomials, with names for messages."""
    from pyomo.core.expr.visitor import StreamBasedExpressionVisitor

    where = ""

    def leaf(_: Any, child: Any, __: int = 0) -> tuple[bool, Any]:
        if not hasattr(child, "is_expression_type"):
            return False, _number(child, where)
        if child.is_expression_type():
            return True, None
        if id(child) in known:
            return False, known[id(child)]
        return False, _number(environ.value(child, exception=False), f"{where}, {child.name}")

    def node(expression: Any, parts: list[Any]) -> Any:
        try:
            return _combine(expression, parts)
        except (TypeError, NotImplementedError, ArithmeticError, ProblemError) as error:
            raise ProblemError(
                f"{where}: found {_excerpt(expression)}, expected a polynomial ({error})"
            ) from None

    visitor = StreamBasedExpressionVisitor(
        initializeWalker=lambda expression: leaf(None, expression),
        beforeChild=leaf,
        exitNode=node,
    )

    def walk(expression: Any, place: str) -> Any:
        nonlocal where
        where = place
        return visitor.walk_expression(expression)

    return walk


def _number(value: Any, where: str) -> float | Fraction:
    """Check a number; it stays exact where no double is equal to it."""
    if value is None:
        raise ProblemError(f"{where}: found no value, expected a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ProblemError(f"{where}: found {value!s:.40}, expected a finite number")
    exact = exact_fraction(value)
    return number if exact is None else exact


def _of_numbers(operation: Callable[..., Any], parts: list[Any]) -> float | Fraction:
    """Combine numbers without rounding."""
    return _number(operation(*map(Fraction, parts)), "a constant")


def _combine(expression: Any, parts: list[Any]) -> Any:
    """Apply one operation of an expression to what its arguments have become."""
    kind = type(expression).__name__.removeprefix("NPV_")
    if kind in ("SumExpression", "LinearExpression", "LinearSumExpression"):
        return _sum(parts)
    known = all(isinstance(part, float | Fraction) for part in parts)
    if kind in _OPERATIONS:
        operation = _OPERATIONS[kind]
        return _of_numbers(operation, parts) if known else operation(*parts)
    if kind == "PowExpression":
        return _power(*parts)
    if len(parts) == 1 and getattr(expression, "is_named_expression_type", bool)():
        return parts[0]
    if known:
        values = [float(part) for part in parts]
        return _number(expression.create_node_with_local_data(values)(), "a constant")
    raise ProblemError(f"{expression.getname()} is no polynomial")


_OPERATIONS: dict[str, Callable[..., Any]] = {
    "ProductExpression": operator.mul,
    "MonomialTermExpression": operator.mul,
    "DivisionExpression": operator.truediv,
    "NegationExpression": operator.neg,
}


def _sum(parts: list[Any]) -> Any:
    numbers = [part for part in parts if isinstance(part, float | Fraction)]
    others: list[Any] = [part for part in parts if not isinstance(part, float | Fraction)]
    number: Any = _of_numbers(lambda *all_: sum(all_, Fraction(0)), numbers)
    if not others:
        return number
    if all(isinstance(part, Polynomial) for part in others):
        return total([*others, number])
    return sum(others, number)


def _power(base: Any, exponent: Any) -> Any:
    if isinstance(base, float | Fraction) and isinstance(exponent, float | Fraction):
        return _of_numbers(operator.pow, [base, exponent])
    if not isinstance(exponent, float) or not exponent.is_integer():
        raise ProblemError(f"the exponent {exponent} is no integer")
    return base**exponent if exponent >= 0 else 1.0 / base**-exponent


def _excerpt(expression: Any) -> str:
    text = str(expression)
    return text if len(text) <= 60 else text[:57] + "..."
