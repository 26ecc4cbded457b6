"""Relaxation orders of one problem side by side: values proved and attained, sizes, seconds.

The plain relaxation here is that of ``sparsePOP`` with ``tighten = 0``: the relaxation of Waki,
Kim, Kojima and Muramatsu as published, without boxes of our own.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from sparsepop_py import plots
from sparsepop_py.budget import cpu_seconds
from sparsepop_py.errors import ProblemError, check_choice, check_kind, entries_of
from sparsepop_py.options import Options
from sparsepop_py.pipeline import solve
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.sparsepop.relaxation import Switches
from sparsepop_py.result import Result
from sparsepop_py.verified.arithmetic.display import rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["OrderComparison", "OrderRow", "compare_orders"]

_EFFORTS = ("plain", "presolve")
_HEAD = (
    *("order", "effort", "status", "proved", "attained", "solver's value", "solver"),
    *("largest block", "blocks", "moments", "CPU s"),
)
_COLOURS = {"plain": "#0072b2", "presolve": "#d55e00"}  # also apart for the colour-blind


@dataclass(frozen=True, eq=False)
class OrderRow:
    """One solve of a comparison.

    Parameters
    ----------
    effort : {"plain", "presolve"}
    cliques : {"sparse", "dense"}
    order : int
        As asked for; the least legal one is taken where it is smaller.
    result : Result
        About the minimisation that was solved.
    cpu_seconds : float
        Of the whole solve, local searches and verification included.
    """

    effort: str
    cliques: str
    order: int
    result: Result
    cpu_seconds: float

    @property
    def sign(self) -> float:
        """-1 where the problem maximises, else 1."""
        return -1.0 if self.result.problem.sense == "max" else 1.0

    @property
    def proved(self) -> float:
        """Proved bound, in the sense of the problem."""
        return self.sign * self.result.lower_bound

    @property
    def attained(self) -> float:
        """Attained value, in the sense of the problem."""
        return self.sign * self.result.upper_bound

    @property
    def solver_value(self) -> float:
        """Value of the conic solver, in the sense of the problem: no bound."""
        return self.sign * self.result.solver_value

    @property
    def solver_status(self) -> str:
        """Status of the conic solver in a word, empty where none was called."""
        solution = self.result.solution
        return "" if solution is None else solution.status

    @property
    def block_sizes(self) -> dict[int, int]:
        """Number of semidefinite blocks by size."""
        relaxation = self.result.relaxation
        sizes = {} if relaxation is None else relaxation.block_sizes
        return {size: sizes[size] for size in sorted(sizes, reverse=True)}

    @property
    def moments(self) -> int:
        """Number of moments, 0 without a relaxation."""
        relaxation = self.result.relaxation
        return 0 if relaxation is None else relaxation.moments.shape[0]


@dataclass(frozen=True, eq=False)
class OrderComparison:
    """Rows of a comparison, with a table and a picture.

    Parameters
    ----------
    problem : Problem
    rows : tuple of OrderRow
    """

    problem: Problem
    rows: tuple[OrderRow, ...]

    @property
    def proved(self) -> float:
        """Best proved bound of all rows, in the sense of the problem."""
        values = [row.proved for row in self.rows]
        return min(values) if self.problem.sense == "max" else max(values)

    @property
    def attained(self) -> float:
        """Best attained value of all rows, in the sense of the problem."""
        values = [row.attained for row in self.rows]
        return max(values) if self.problem.sense == "max" else min(values)

    def table(self) -> str:
        """Format all rows as a text table, with remarks below it.

        Returns
        -------
        str
        """
        several = len({row.cliques for row in self.rows}) > 1
        cells = [_HEAD, *(_cells(row, several) for row in self.rows)]
        width = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines = [
            "  ".join(cell.rjust(w) for cell, w in zip(row, width, strict=True)).rstrip()
            for row in cells
        ]
        lines.insert(1, "  ".join("-" * w for w in width))
        return "\n".join([*lines, *self._remarks()])

    def _remarks(self) -> Iterator[str]:
        maximum = self.problem.sense == "max"
        word = "maximum" if maximum else "minimum"
        low, high = (self.attained, self.proved) if maximum else (self.proved, self.attained)
        least, most = (rounded(v, up, 10) for v, up in ((low, False), (high, True)))
        yield f"together: {least} <= {word} <= {most}"
        unsure = [row for row in self.rows if row.solver_status not in ("", "solved")]
        if unsure:
            yield (
                "A solver's value is no bound. Where its status is not 'solved', the solver itself "
                "does not vouch for it."
            )
        for row in self.rows:
            for note in row.result.notes:
                yield f"order {row.order}, {row.effort}: {note}"

    def records(self) -> list[dict[str, Any]]:
        """List the rows as plain data, for JSON.

        Returns
        -------
        list of dict
            With NaN and infinities as floats.
        """
        return [
            {
                "order": row.order,
                "effort": row.effort,
                "cliques": row.cliques,
                "status": str(row.result.status),
                "proved": row.proved,
                "attained": row.attained,
                "solver_value": row.solver_value,
                "solver_status": row.solver_status,
                "blocks": {str(size): count for size, count in row.block_sizes.items()},
                "moments": row.moments,
                "cpu_seconds": row.cpu_seconds,
                "notes": list(row.result.notes),
            }
            for row in self.rows
        ]

    def plot(self, path: str | os.PathLike[str] | None = None) -> Any:
        """Draw proved and attained values, and CPU seconds, against the order.

        Parameters
        ----------
        path : path-like, optional
            A file to write; its suffix chooses the format.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        SolverNotFound
            If matplotlib is not installed.
        """
        plots.require_matplotlib()
        from matplotlib.figure import Figure

        figure = Figure(figsize=(10.0, 4.4), layout="constrained")
        left, right = figure.subplots(1, 2)
        self._draw(left, right)
        if path is not None:
            plots.save_figure(figure, path)
        return figure

    def _draw(self, left: Axes, right: Axes) -> None:
        kinds = list(dict.fromkeys((row.effort, row.cliques) for row in self.rows))
        for effort, cliques in kinds:
            rows = [row for row in self.rows if (row.effort, row.cliques) == (effort, cliques)]
            line = "-" if cliques == "sparse" else "--"
            label = f"{effort}, {cliques}" if len({c for _, c in kinds}) > 1 else effort
            style: dict[str, Any] = {"color": _COLOURS.get(effort, "black"), "label": label}
            orders = [row.order for row in rows]
            left.plot(orders, [_finite(row.proved) for row in rows], f"o{line}", **style)
            right.semilogy(orders, [row.cpu_seconds for row in rows], f"o{line}", **style)
            for row in rows:
                size = str(max(row.block_sizes, default=0))
                right.annotate(
                    size, (row.order, row.cpu_seconds), (4, 4), textcoords="offset points"
                )
        if math.isfinite(self.attained):
            left.axhline(self.attained, color="black", linestyle=":", label="best attained value")
        left.set_ylabel(f"proved bound of the {'max' if self.rows[0].sign < 0 else 'min'}imum")
        right.set_ylabel("CPU seconds (numbers: largest block)")
        for axes in (left, right):
            axes.set_xlabel("relaxation order")
            axes.set_xticks(sorted({row.order for row in self.rows}))
            axes.grid(True, alpha=0.4)
            axes.legend()


def compare_orders(
    problem: Problem,
    orders: Sequence[int] = (1, 2, 3),
    efforts: Sequence[str] = _EFFORTS,
    cliques: Sequence[str] = ("sparse",),
    options: Options | None = None,
) -> OrderComparison:
    """Solve a problem at several relaxation orders, plain and with presolve.

    Parameters
    ----------
    problem : Problem
    orders : sequence of int
    efforts : sequence of {"plain", "presolve"}
        ``"plain"`` is the relaxation of ``sparsePOP`` with ``tighten = 0``.
    cliques : sequence of {"sparse", "dense"}
        Cliques of the problem, or one clique of all variables.
    options : Options, optional
        What else is to hold for each solve.

    Returns
    -------
    OrderComparison

    Raises
    ------
    ProblemError
        If an argument is malformed.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> problem = sp.Problem(x * y, [x**2 + y**2 <= 1], lower=-1, upper=1)
    >>> compared = sp.compare_orders(problem, [1, 2])
    >>> [(row.order, row.effort, round(row.proved, 4)) for row in compared.rows[:2]]
    [(1, 'plain', -0.5), (1, 'presolve', -0.5)]
    """
    check_kind(problem, Problem, "problem")
    base = Options() if options is None else options
    check_kind(base, Options, "options")
    orders = entries_of(orders, "orders", "a list of orders")
    efforts = entries_of(efforts, "efforts", "a list of " + " or ".join(_EFFORTS))
    cliques = entries_of(cliques, "cliques", "a list of 'sparse' or 'dense'")
    _check("orders", orders, None)
    _check("efforts", efforts, _EFFORTS)
    _check("cliques", cliques, ("sparse", "dense"))
    chosen = [
        (order, effort, each, _options(base, order, effort, each))
        for order in orders
        for effort in efforts
        for each in cliques
    ]
    _load()
    rows = []
    for order, effort, each, setting in chosen:
        start = cpu_seconds()
        result = solve(problem, setting)
        rows.append(OrderRow(effort, each, order, result, cpu_seconds() - start))
    return OrderComparison(problem, tuple(rows))


def _check(name: str, given: Sequence[Any], known: tuple[str, ...] | None) -> None:
    if not given:
        raise ProblemError(f"{name}: found {given!r}, expected a list with at least one entry")
    for item in given:
        if known is not None:
            check_choice(item, name, known)


def _options(base: Options, order: int, effort: str, cliques: str) -> Options:
    options = replace(base, order=order, sparse=cliques == "sparse", switches=None)
    if effort == "presolve":
        return replace(options, effort="presolve")
    switches = Switches(order=order)
    return replace(options, effort="plain", switches=switches, chordal="min-degree")


def _load() -> None:
    """Load solvers, so that the first row does not pay for their imports."""
    from sparsepop_py.algebra.polynomial import variables

    (x,) = variables(1)
    solve(Problem(x**4 - x, lower=-1, upper=1), Options(order=2))


def _cells(row: OrderRow, several: bool) -> tuple[str, ...]:
    maximum = row.sign < 0
    blocks = ", ".join(f"{count} x {size}" for size, count in row.block_sizes.items() if size > 1)
    return (
        str(row.order),
        f"{row.effort}, {row.cliques}" if several else row.effort,
        str(row.result.status),
        rounded(row.proved, maximum, 9),
        rounded(row.attained, not maximum, 9),
        "" if math.isnan(row.solver_value) else f"{row.solver_value:.8g}",
        row.solver_status,
        str(max(row.block_sizes, default=0)),
        blocks,
        str(row.moments),
        f"{row.cpu_seconds:.2f}",
    )


def _finite(value: float) -> float:
    return value if math.isfinite(value) else math.nan
