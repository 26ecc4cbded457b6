"""Pictures: what they show, in one, two and more variables, without a display."""

from __future__ import annotations

import builtins
import io
import pathlib
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.axes import Axes

import sparsepop_py as sp
from sparsepop_py.errors import SolverNotFound
from sparsepop_py.plots import plot_result, save_plot


@pytest.fixture(autouse=True)
def close() -> Iterator[None]:
    yield
    pyplot.close("all")


def labels(ax: Axes) -> list[str]:
    return ax.get_legend_handles_labels()[1]


def disc(**named: Any) -> sp.Problem:
    a, b = sp.variables(2)
    return sp.Problem(a * b, [a**2 + b**2 <= 1], names=["alpha", "beta"], **named)


def test_two_variables() -> None:
    result = sp.solve(disc())
    ax = plot_result(result)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("alpha", "beta")
    assert {"infeasible", "attained"} <= set(labels(ax))
    assert ax.get_title().startswith("OPTIMAL: minimum in [-0.5")
    assert ax.get_xlim()[0] < result.x[0] < ax.get_xlim()[1]
    assert ax.figure.axes[1].get_ylabel() == "objective"


def test_the_interval_in_the_title_is_rounded_outwards() -> None:
    result = sp.solve(disc())
    low, high = plot_result(result).get_title().split("[")[1].rstrip("]").split(", ")
    assert float(low) <= result.lower_bound <= result.upper_bound <= float(high)


def test_axes_are_taken_and_returned() -> None:
    _, ax = pyplot.subplots()
    assert plot_result(sp.solve(disc()), ax) is ax
    assert isinstance(sp.solve(disc()).plot(), Axes)


def test_what_is_no_axes_is_refused() -> None:
    with pytest.raises(sp.ProblemError, match="ax: found str, expected Axes of matplotlib"):
        sp.solve(disc()).plot("bode")


@pytest.mark.parametrize("n", [1, 2, 3])
def test_names_are_no_mathematics(n: int) -> None:
    names = [r"$\foo$", "a$b$", r"\$"][:n]
    x = sp.variables(n)
    problem = sp.Problem(sum(a**2 for a in x) + x[0] * x[-1], lower=-1, upper=1, names=names)
    ax = plot_result(sp.solve(problem, sp.Options(order=1, refine="none")))
    picture = io.StringIO()
    with pyplot.rc_context({"svg.fonttype": "none"}):
        ax.figure.savefig(picture, format="svg")
    assert all(f">{name}<" in picture.getvalue() for name in names)


def test_equations_and_boxes() -> None:
    a, b = sp.variables(2)
    ax = plot_result(sp.solve(sp.Problem(a + b, [a**2 + b**2 == 1], lower=-2, upper=[2, 3])))
    assert "equation" in labels(ax)
    assert ax.get_xlim()[0] < -2 < 2 < ax.get_xlim()[1]
    assert ax.get_ylim()[0] < -2 < 3 < ax.get_ylim()[1]


def test_huge_boxes_do_not_choose_the_window() -> None:
    a, b = sp.variables(2)
    problem = sp.Problem((a - 1) ** 2 + (b - 2) ** 2, lower=-1e6, upper=1e6)
    ax = plot_result(sp.solve(problem))
    assert ax.get_xlim()[1] - ax.get_xlim()[0] < 100


def test_a_maximum_is_shown_as_one() -> None:
    (x,) = sp.variables(1)
    problem = sp.Problem(x**2 - 1, lower=-1, upper=1, sense="max")  # maximise 1 - x^2
    result = sp.solve(problem)
    ax = plot_result(result)
    assert ax.get_title().startswith(f"{result.status}: maximum in [")
    assert "proved upper bound" in labels(ax)
    assert max(line.get_ydata().max() for line in ax.get_lines() if line.get_label() == "objective")


def test_one_variable() -> None:
    (x,) = sp.variables(1)
    result = sp.solve(sp.Problem(x**3, [x**2 == 4], lower=-5, upper=5), sp.Options(order=2))
    ax = plot_result(result)
    assert ax.get_xlabel() == "x1"
    assert {"objective", "equation", "proved lower bound", "attained"} <= set(labels(ax))
    roots = [line.get_xdata()[0] for line in ax.get_lines() if line.get_label() == "equation"]
    assert np.allclose(sorted(roots), [-2, 2])


@pytest.mark.parametrize("n", [1, 2, 3])
def test_an_infeasible_problem_without_relaxation(n: int) -> None:
    x = sp.variables(n)
    result = sp.solve(sp.Problem(x[0], [sp.total(x) >= 5], lower=0, upper=1))
    assert result.relaxation is None
    assert plot_result(result).get_title() == "INFEASIBLE: proved that no point is feasible"


def test_a_constant_objective() -> None:
    a, _ = sp.variables(2)
    plot_result(sp.solve(sp.Problem(0.0, [a >= 0], lower=-1, upper=1)))


def test_block_pattern() -> None:
    ax = plot_result(sp.solve(sp.problems.rosenbrock(12), sp.Options(order=2, refine="none")))
    assert len(ax.patches) == 11  # each clique of two neighbours is one square
    assert "11 cliques; blocks: " in ax.get_xlabel()
    assert sorted(t.get_text() for t in ax.get_xticklabels())[0] == "x1"
    x, y = ax.get_lines()[0].get_data()
    assert len(x) == len(y) == 12 + 2 * 11


def test_save(tmp_path: pathlib.Path) -> None:
    save_plot(sp.solve(disc()), tmp_path / "disc.png")
    assert (tmp_path / "disc.png").read_bytes().startswith(b"\x89PNG")


def test_without_matplotlib(monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path) -> None:
    result = sp.solve(disc())
    real = builtins.__import__

    def absent(name: str, *rest: Any, **named: Any) -> Any:
        if name.split(".")[0] == "matplotlib":
            raise ImportError(name)
        return real(name, *rest, **named)

    monkeypatch.setattr(builtins, "__import__", absent)
    for draw in (plot_result, lambda r: save_plot(r, tmp_path / "a.png")):
        with pytest.raises(SolverNotFound, match=r"pip install 'sparsepop-py\[plot\]'"):
            draw(result)
