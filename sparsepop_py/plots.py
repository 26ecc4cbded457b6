"""Pictures of results, drawn with matplotlib.

Colours are those of Okabe and Ito, which colour-blind people tell apart, over the
perceptually uniform map cividis.
"""

from __future__ import annotations

import os
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.errors import FormatError, ProblemError, SolverNotFound
from sparsepop_py.files import as_path, write_file
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.moment import Relaxation
from sparsepop_py.result import Result, Status
from sparsepop_py.verified.arithmetic.display import rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "new_axes",
    "plain",
    "plot_history",
    "plot_result",
    "require_matplotlib",
    "save_figure",
    "save_plot",
]

_GRID = 241  # points a side of the plane
_LARGEST_WINDOW = 1e3  # wider boxes are no help for the eye: the points choose the window
_MOST_CLIQUES = 400  # outlines drawn
_ATTAINED, _CANDIDATE, _EQUATION, _BOUND = "#D55E00", "#56B4E9", "#CC79A7", "#0072B2"
_GREY = "#BBBBBB"


def require_matplotlib() -> ModuleType:
    """Import matplotlib.pyplot.

    Returns
    -------
    module

    Raises
    ------
    SolverNotFound
        If matplotlib is missing; the message says how to install it.
    """
    try:
        from matplotlib import pyplot
    except ImportError as error:
        raise SolverNotFound(
            "plot: matplotlib is missing; install it with: pip install 'sparsepop-py[plot]'"
        ) from error
    return pyplot


def new_axes(ax: Axes | None, size: tuple[float, float] = (7.0, 5.2)) -> Axes:
    """Take the given axes, or make those of a new figure.

    Parameters
    ----------
    ax : matplotlib Axes or None
    size : (float, float)
        Of a new figure, in inches.

    Raises
    ------
    ProblemError
        If ``ax`` is something else.
    """
    pyplot = require_matplotlib()
    if ax is not None:
        if not isinstance(ax, pyplot.Axes):
            raise ProblemError(f"ax: found {type(ax).__name__}, expected Axes of matplotlib")
        return ax
    return pyplot.subplots(figsize=size, layout="constrained")[1]


def plain(text: str) -> str:
    r"""Escape dollar signs of a label, between which matplotlib would read mathematics.

    Parameters
    ----------
    text : str
        With names and units, which may hold any character.

    Examples
    --------
    >>> print(plain("price [$]"))
    price [\$]
    """
    return text.replace("$", r"\$")


def plot_history(result: Result, ax: Axes | None = None) -> Axes:
    """Draw the gap between attained and proved value against CPU seconds, step by step.

    Parameters
    ----------
    result : Result
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; those of a new figure when left out.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    SolverNotFound
        If matplotlib is not installed.
    """
    ax = new_axes(ax)
    seconds = np.cumsum([entry.seconds for entry in result.history])
    gaps = np.array([entry.upper_bound - entry.lower_bound for entry in result.history])
    shown = np.where(np.isfinite(gaps), np.maximum(gaps, 1e-16), np.nan)
    ax.semilogy(seconds, shown, "o-", color=_BOUND)
    for entry, x, y in zip(result.history, seconds, shown, strict=True):
        if np.isfinite(y):
            ax.annotate(entry.name, (x, y), xytext=(4, 4), textcoords="offset points", fontsize=8)
    ax.set_xlabel("CPU seconds")
    ax.set_ylabel("gap between attained and proved value")
    return ax


def plot_result(result: Result, ax: Axes | None = None) -> Axes:
    """Draw a result.

    One variable: the objective, its proved bound, and the feasible set. Two: contours,
    feasible set, equations and points. More: the chordal sparsity pattern of the
    relaxation with its cliques.

    Parameters
    ----------
    result : Result
    ax : Axes, optional
        Of matplotlib; a new figure when left out.

    Returns
    -------
    Axes

    Raises
    ------
    SolverNotFound
        If matplotlib is not installed.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, = sp.variables(1)
    >>> result = sp.solve(sp.Problem(x**2 - x, lower=-1, upper=1))
    >>> plot_result(result).get_xlabel()  # doctest: +SKIP
    'x1'
    """
    ax = new_axes(ax)
    if result.problem.dimension == 1:
        _curve(result, ax)
    elif result.problem.dimension == 2:
        _plane(result, ax)
    else:
        _pattern(result, ax)
    return ax


def save_plot(result: Result, path: str | os.PathLike[str]) -> None:
    """Draw a result into a file; no display is needed.

    Parameters
    ----------
    result : Result
    path : path-like
        Its suffix chooses the format: png, pdf, svg ...

    Raises
    ------
    SolverNotFound
        If matplotlib is not installed.
    FormatError
        If the suffix is of no format.
    OutputError
        If the file cannot be written.
    """
    require_matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 5.2), layout="constrained")
    plot_result(result, figure.add_subplot())
    save_figure(figure, path)


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a figure to a file, whole or not at all.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    path : path-like
        Its suffix chooses the format: png, pdf, svg ...

    Raises
    ------
    FormatError
        If the suffix is of no format.
    OutputError
        If the file cannot be written.
    """
    target = as_path(path)
    kind = target.suffix[1:].lower()
    known = figure.canvas.get_supported_filetypes()
    if kind not in known:
        raise FormatError(f"{path}: found the ending {kind!r}, expected one of {', '.join(known)}")
    write_file(target, lambda file: figure.savefig(file, dpi=150, format=kind))


def _sign(problem: Problem) -> float:
    return -1.0 if problem.sense == "max" else 1.0


def _title(result: Result) -> str:
    """Format status and proved interval, in the sense of the input."""
    maximise = result.problem.sense == "max"
    word = "maximum" if maximise else "minimum"
    if result.status is Status.INFEASIBLE:
        return "INFEASIBLE: proved that no point is feasible"
    ends = [result.lower_bound, result.upper_bound]
    low, high = (-ends[1], -ends[0]) if maximise else ends
    shown = [rounded(v, up, 7) for v, up in ((low, False), (high, True))]
    return f"{result.status}: {word} in [{shown[0]}, {shown[1]}]"


# ---- one and two variables --------------------------------------------------------------


def _window(result: Result) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Choose the window: bounds where they are finite and not huge, else around points."""
    problem, n = result.problem, result.problem.dimension
    points = np.concatenate([chosen for _, _, chosen in _kinds(result)] or [np.zeros((1, n))])
    low, high = points.min(axis=0), points.max(axis=0)
    reach = np.maximum(1.0, np.maximum(high - low, 0.5 * np.maximum(np.abs(low), np.abs(high))))
    low, high = low - 0.6 * reach, high + 0.6 * reach
    width = problem.upper - problem.lower
    boxed = np.isfinite(width) & (width <= _LARGEST_WINDOW)
    margin = 0.05 * np.where(boxed & (width > 0), width, 1.0)
    low = np.where(boxed, problem.lower - margin, low)
    high = np.where(boxed, problem.upper + margin, high)
    return low, high


def _allowed(problem: Problem, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the least slack of inequalities and bounds at (N, n) points.

    Negative where infeasible.
    """
    slack = np.minimum(points - problem.lower, problem.upper - points).min(axis=1)
    for row, equal in zip(problem.constraints, problem.equality, strict=True):
        if not equal:
            slack = np.minimum(slack, row.polynomial(points))
    return np.minimum(slack, problem.matrices.least_eigenvalue(points))


def _curve(result: Result, ax: Axes) -> None:
    problem, sign = result.problem, _sign(result.problem)
    low, high = _window(result)
    x = np.linspace(low[0], high[0], 1001)
    y = sign * problem.objective(x[:, None])
    slack = _allowed(problem, x[:, None])
    ax.plot(x, y, color="black", label="objective")
    ax.fill_between(
        x,
        0,
        1,
        where=slack < 0,
        transform=ax.get_xaxis_transform(),
        color=_GREY,
        alpha=0.6,
        linewidth=0,
        label="infeasible" if np.any(slack < 0) else None,
    )
    for root in _roots(problem, low[0], high[0]):
        ax.axvline(root, color=_EQUATION, linestyle="--", label="equation")
    if np.isfinite(result.lower_bound):
        bound = sign * result.lower_bound
        side = "upper" if sign < 0 else "lower"
        ax.axhline(bound, color=_BOUND, linestyle=":", label=f"proved {side} bound")
    for kind, style, points in _kinds(result):
        ax.plot(points[:, 0], sign * problem.objective(points), label=kind, **style)
    ax.set_xlim(low[0], high[0])
    ax.set_xlabel(plain(problem.names[0]))
    ax.set_ylabel("objective")
    _finish(result, ax)


def _roots(problem: Problem, low: float, high: float) -> NDArray[np.float64]:
    """Compute the real zeros in the window of the equations in one variable."""
    found = [np.zeros(0)]
    for row, equal in zip(problem.constraints, problem.equality, strict=True):
        if equal:
            polynomial = row.polynomial
            values = np.zeros(polynomial.degree + 1)
            power = polynomial.exponents.toarray().ravel()
            values[polynomial.degree - power] = polynomial.coefficients
            roots = np.roots(values)
            found.append(roots.real[np.abs(roots.imag) <= 1e-6 * (1.0 + np.abs(roots))])
    roots = np.concatenate(found)
    return np.unique(np.round(roots[(roots >= low) & (roots <= high)], 9))


def _plane(result: Result, ax: Axes) -> None:
    from matplotlib.colors import BoundaryNorm

    problem, sign = result.problem, _sign(result.problem)
    low, high = _window(result)
    axes = [np.linspace(a, b, _GRID) for a, b in zip(low, high, strict=True)]
    X, Y = np.meshgrid(*axes)
    points = np.stack([X.ravel(), Y.ravel()], axis=1)
    values = sign * problem.objective(points).reshape(X.shape)
    # Levels by quantile: a steep objective keeps its structure near the minimum.
    levels = np.unique(np.quantile(values, np.linspace(0.0, 1.0, 22)))
    if levels.size > 2:
        norm = BoundaryNorm(levels, 256)
        filled = ax.contourf(X, Y, values, levels, cmap="cividis", norm=norm)
        ax.contour(X, Y, values, levels[1:-1], colors="white", linewidths=0.4, alpha=0.6)
        bar = ax.figure.colorbar(filled, ax=ax, ticks=levels[::3], format="%.3g")
        bar.set_label("objective")
    slack = _allowed(problem, points).reshape(X.shape)
    if np.any(slack < 0):
        ax.contourf(X, Y, slack, [min(slack.min(), -1.0) * 2, 0.0], colors=[_GREY], alpha=0.75)
        ax.fill(np.nan, np.nan, color=_GREY, alpha=0.75, label="infeasible")
    if np.any(slack < 0) and np.any(slack > 0):
        ax.contour(X, Y, slack, [0.0], colors="black", linewidths=1.0)
    _equations(problem, X, Y, points, ax)
    for kind, style, chosen in _kinds(result):
        ax.plot(chosen[:, 0], chosen[:, 1], label=kind, **style)
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    ax.set_xlabel(plain(problem.names[0]))
    ax.set_ylabel(plain(problem.names[1]))
    _finish(result, ax)


def _equations(problem: Problem, X: Any, Y: Any, points: NDArray[Any], ax: Axes) -> None:
    drawn = False
    for row, equal in zip(problem.constraints, problem.equality, strict=True):
        values = row.polynomial(points).reshape(X.shape)
        if equal and values.min() < 0 < values.max():
            ax.contour(X, Y, values, [0.0], colors=_EQUATION, linewidths=2.0)
            drawn = True
    if drawn:
        ax.plot([], [], color=_EQUATION, linewidth=2.0, label="equation")


def _kinds(result: Result) -> list[tuple[str, dict[str, Any], NDArray[np.float64]]]:
    """List points by kind, with their drawing style."""
    attained = [result.attained.x] if result.attained is not None else []
    least = min((point.value for point in result.points), default=0.0)
    most = least + 1e-3 * max(1.0, abs(least))  # others are starts and stalls of searches
    others = [point.x for point in result.points[len(attained) :] if point.value <= most]
    base: dict[str, Any] = {"linestyle": "none", "markeredgecolor": "black", "zorder": 5}
    kinds = [
        ("candidate", base | {"marker": "o", "markersize": 7, "color": _CANDIDATE}, others),
        ("attained", base | {"marker": "*", "markersize": 16, "color": _ATTAINED}, attained),
    ]
    return [(kind, style, np.array(found)) for kind, style, found in kinds if found]


def _finish(result: Result, ax: Axes) -> None:
    ax.set_title(_title(result))
    handles, labels = ax.get_legend_handles_labels()
    distinct = dict(zip(labels, handles, strict=True))
    if distinct:
        ax.legend(distinct.values(), distinct.keys(), loc="best", framealpha=0.9)


# ---- more variables ---------------------------------------------------------------------


def _pattern(result: Result, ax: Axes) -> None:
    """Draw the chordal sparsity pattern in elimination order, with the cliques outlined."""
    relaxation, n = result.relaxation, result.problem.dimension
    ax.set_title(_title(result))
    if relaxation is None:
        ax.set_axis_off()
        text = f"{n} variables\nno relaxation was needed"
        ax.text(0.5, 0.5, text, ha="center", va="center", transform=ax.transAxes)
        return
    cliques = relaxation.cliques
    place = np.empty(n, np.int64)
    place[cliques.order[::-1]] = np.arange(n)
    graph = cliques.graph.tocoo()
    rows = np.concatenate([place[graph.row], np.arange(n)])
    columns = np.concatenate([place[graph.col], np.arange(n)])
    ax.plot(columns, rows, "s", color=_BOUND, markersize=_marker(n, ax), markeredgewidth=0)
    for clique in cliques.members[:_MOST_CLIQUES]:
        _outline(np.sort(place[list(clique)]), ax)
    ax.set_xlim(-1.0, n)
    ax.set_ylim(n, -1.0)
    ax.set_aspect("equal")
    ax.set_xlabel(f"variable, in elimination order\n{_blocks(relaxation)}")
    ax.set_ylabel("variable, in elimination order")
    if n <= 24:
        names = [plain(result.problem.names[v]) for v in np.argsort(place)]
        ax.set_xticks(range(n), names, rotation=90)
        ax.set_yticks(range(n), names)


def _marker(n: int, ax: Axes) -> float:
    """Compute the size in points of a cell of the pattern."""
    size: float = ax.get_window_extent().height / ax.figure.dpi * 72.0
    return max(0.4, 0.6 * size / (n + 1))


def _outline(places: NDArray[np.int64], ax: Axes) -> None:
    """Outline a clique in as many pieces as it has runs of neighbouring variables."""
    from matplotlib.patches import Rectangle

    runs = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1)
    for a in runs:
        for b in runs:
            corner = (a[0] - 0.5, b[0] - 0.5)
            ax.add_patch(
                Rectangle(corner, a.size, b.size, fill=False, edgecolor=_ATTAINED, linewidth=0.9)
            )


def _blocks(relaxation: Relaxation) -> str:
    sizes = sorted(relaxation.block_sizes.items(), reverse=True)
    shown = ", ".join(f"{count} of size {size}" for size, count in sizes[:4])
    more = ", ..." if len(sizes) > 4 else ""
    return f"{len(relaxation.cliques)} cliques; blocks: {shown}{more}"
